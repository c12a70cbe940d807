/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes Gaussians in glTF, KHR_gaussian_splatting (Khronos, ratified): point primitives with attributes for rotation
 * (x y z w), scale (sigma), opacity (0 to 1) and harmonics, in the frame of their node. Those of all nodes of the scene
 * become one set.
 *
 * glTF's axes, x left, y up, z forward by Khronos' convention, become PLY's by half a turn about z, which is what
 * splat-transform and Niantic's converters undo. A file that PAGS wrote is known by its generator: its root node holds
 * the turn from the scene's axes, which is left out, so that the scene comes back as it was. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "scene/axes.h"
#include "scene/gltf_file.h"
#include "scene/splat_formats.h"

#define EXTENSION "KHR_gaussian_splatting"

enum { DEEPEST = 200 };

/* A primitive of Gaussians in a node. */
typedef struct placed {
  const pags_json_value *attributes;
  double pose[12]; /* file from node, 3x4 row-major: `rotation` times `size`, and a translation */
  double size, rotation[9];
  bool turned; /* the pose isn't the identity */
  int64_t count;
  int degree;
} placed;

typedef struct gltf_splats {
  gltf_file file;
  placed *items;
  int64_t count, capacity;
  uint8_t *visited; /* a byte a node */
  bool own;         /* PAGS wrote the file */
  pags_up up;
  bool up_stated;           /* by the extras of the asset; else the root node of PAGS' own says it */
  int64_t other_primitives; /* meshes and points that are no Gaussians */
  int64_t logarithms, clamped, without_dc, linear, kernels, partial;
} gltf_splats;

/* ---- Nodes ---- */

/* From the file's axes to PLY's, and to themselves. */
static const double to_ply[12] = {-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0},
                    identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

/* Reads `count` numbers, unless the key is missing. */
static pags_result numbers_or(const gltf_file *f, const pags_json_value *object, const char *key, int count,
                              double *out) {
  return pags_json_member(object, key) ? pags_json_numbers(f->json, object, key, count, out) : PAGS_OK;
}

/* The node's own transform, by its matrix or by translation, rotation and scale. */
static pags_result node_matrix(const gltf_file *f, const pags_json_value *node, double out[12]) {
  if (pags_json_member(node, "matrix")) {
    double m[16];
    PAGS_TRY(pags_json_numbers(f->json, node, "matrix", 16, m));
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 4; j++)
        out[4 * i + j] = m[4 * j + i];
    return PAGS_OK;
  }
  double t[3] = {0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1}, r[9];
  PAGS_TRY(numbers_or(f, node, "translation", 3, t));
  PAGS_TRY(numbers_or(f, node, "rotation", 4, q));
  PAGS_TRY(numbers_or(f, node, "scale", 3, s));
  pags_rotation_from_quaternion((const double[4]){q[3], q[0], q[1], q[2]}, r);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 4; j++)
      out[4 * i + j] = j < 3 ? r[3 * i + j] * s[j] : t[i];
  return PAGS_OK;
}

/* Sets size, rotation and turned of an item by its pose, which may scale evenly only: a Gaussian that is stretched
 * unevenly has other axes, and colours that don't turn. */
static pags_result check_pose(const gltf_file *f, const pags_json_value *node, placed *item) {
  const double *m = item->pose;
  double length[3], worst = 0, finite = 0;
  for (int j = 0; j < 3; j++)
    length[j] = sqrt(m[j] * m[j] + m[4 + j] * m[4 + j] + m[8 + j] * m[8 + j]);
  item->size = (length[0] + length[1] + length[2]) / 3;
  for (int j = 0; j < 3; j++) {
    const int k = (j + 1) % 3;
    worst = fmax(worst, fabs(length[j] - item->size));
    worst = fmax(worst, fabs(m[j] * m[k] + m[4 + j] * m[4 + k] + m[8 + j] * m[8 + k]) / item->size);
    finite += m[4 * j + 3];
  }
  const double turn =
      m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) + m[2] * (m[4] * m[9] - m[5] * m[8]);
  if (!(item->size > 1e-12 && item->size < 1e12 && isfinite(finite) && worst <= 1e-3 * item->size && turn > 0))
    return pags_json_fail(
        f->json, node,
        "expected a node of Gaussians that is moved, turned and scaled evenly, found one of scale %.4g, %.4g, %.4g%s",
        length[0], length[1], length[2], turn < 0 ? ", mirrored" : "");
  for (int k = 0; k < 12; k++)
    item->turned = item->turned || m[k] != identity[k];
  for (int k = 0; k < 9; k++)
    item->rotation[k] = m[4 * (k / 3) + k % 3] / item->size;
  return PAGS_OK;
}

/* Checks kernel and colour space of the extension object, and that neither it nor the primitive names a compression. */
static pags_result check_extension(gltf_splats *s, const pags_json_value *primitive, const pags_json_value *extension) {
  const gltf_file *f = &s->file;
  const char *kernel, *space;
  const pags_json_value *const places[] = {pags_json_member(extension, "extensions"),
                                           pags_json_member(primitive, "extensions")};
  for (int i = 0; i < 2; i++)
    for (const pags_json_value *v = places[i] ? places[i]->first : NULL; v; v = v->next)
      if (v->key && (strstr(v->key, "compression") || strstr(v->key, "draco") || strstr(v->key, "L-GSC")))
        return pags_fail(PAGS_ERROR_UNSUPPORTED,
                         "%s:%d: its Gaussians are packed by '%.60s', which PAGS can't read: expected plain "
                         "attributes, or the .spz file itself",
                         f->path, primitive->line, v->key);
  PAGS_TRY(pags_json_as_object(f->json, extension, EXTENSION));
  PAGS_TRY(pags_json_string_or(f->json, extension, "kernel", "ellipse", &kernel));
  PAGS_TRY(pags_json_string_or(f->json, extension, "colorSpace", "srgb_rec709_display", &space));
  s->kernels += strcmp(kernel, "ellipse") != 0;
  s->linear += strncmp(space, "lin", 3) == 0;
  return PAGS_OK;
}

enum { NAME_SIZE = 64 };

static void name_harmonic(int degree, int n, char name[NAME_SIZE]) {
  snprintf(name, NAME_SIZE, EXTENSION ":SH_DEGREE_%d_COEF_%d", degree, n);
}

/* The SH degree whose coefficients are all there; some of a higher degree are counted as partial. */
static int degree_of(gltf_splats *s, const pags_json_value *attributes) {
  char name[NAME_SIZE];
  for (int degree = 1; degree <= 3; degree++) {
    int found = 0;
    for (int n = 0; n <= 2 * degree; n++) {
      name_harmonic(degree, n, name);
      found += pags_json_member(attributes, name) != NULL;
    }
    if (found <= 2 * degree) {
      s->partial += found > 0;
      return degree - 1;
    }
  }
  return 3;
}

static pags_result add_mesh(gltf_splats *s, const pags_json_value *node, const pags_json_value *mesh,
                            const double pose[12]) {
  const pags_json_value *primitives, *position;
  gltf_file *f = &s->file;
  PAGS_TRY(pags_json_array(f->json, mesh, "primitives", &primitives));
  for (const pags_json_value *p = primitives->first; p; p = p->next) {
    const pags_json_value *extension = pags_json_member(pags_json_member(p, "extensions"), EXTENSION);
    placed item = {0};
    if (!extension) {
      s->other_primitives++;
      continue;
    }
    PAGS_TRY(check_extension(s, p, extension));
    PAGS_TRY(pags_json_object(f->json, p, "attributes", &item.attributes));
    PAGS_TRY(pags_gltf_refer(f, item.attributes, "POSITION", GLTF_ACCESSORS, &position));
    if (!position)
      return pags_json_fail(f->json, item.attributes, "expected the attribute POSITION");
    PAGS_TRY(pags_gltf_accessor_count(f, position, &item.count));
    memcpy(item.pose, pose, sizeof item.pose);
    PAGS_TRY(check_pose(f, node, &item));
    item.degree = degree_of(s, item.attributes);
    PAGS_CHECK_MEMORY(pags_grow(&s->items, s->count + 1, &s->capacity, sizeof *s->items), "%s: its nodes", f->path);
    s->items[s->count++] = item;
  }
  return PAGS_OK;
}

/* Adds the node that an element of the list `key` names, and its children. */
static pags_result add_node(gltf_splats *s, const pags_json_value *number, const char *key, const double parent[12],
                            int depth) {
  gltf_file *f = &s->file;
  const gltf_list *const nodes = &f->lists[GLTF_NODES];
  double value;
  PAGS_TRY(pags_json_as_number(f->json, number, key, &value));
  const int64_t index = value >= 0 && value < 1e9 ? (int64_t)value : -1;
  if (index < 0 || index >= nodes->count || depth > DEEPEST || s->visited[index])
    return pags_fail_at(f->path, "node %lld: expected a tree of %lld nodes, at most %d deep", (long long)index,
                        (long long)nodes->count, DEEPEST);
  const pags_json_value *node = nodes->items[index], *mesh, *children = pags_json_member(node, "children");
  const char *name;
  double own[12], pose[12];
  s->visited[index] = 1;
  PAGS_TRY(node_matrix(f, node, own));
  PAGS_TRY(pags_json_string_or(f->json, node, "name", "", &name));
  if (s->own && depth == 0 && strcmp(name, "scene") == 0) {
    /* The root node of PAGS turns the scene's up axis to that of glTF, by its rotation about x. */
    s->up = s->up_stated ? s->up : own[9] < -0.5 ? PAGS_UP_Z : PAGS_UP_MINUS_Y;
    memcpy(pose, parent, sizeof pose);
  } else
    pags_rigid_multiply(parent, own, pose);
  PAGS_TRY(pags_gltf_refer(f, node, "mesh", GLTF_MESHES, &mesh));
  if (mesh)
    PAGS_TRY(add_mesh(s, node, mesh, pose));
  for (const pags_json_value *v = children ? children->first : NULL; v; v = v->next)
    PAGS_TRY(add_node(s, v, "children", pose, depth + 1));
  return PAGS_OK;
}

/* Walks through the nodes of the scene that the file shows first. */
static pags_result add_nodes(gltf_splats *s) {
  gltf_file *f = &s->file;
  const pags_json_value *scenes = pags_json_member(f->root, "scenes"), *scene = scenes ? scenes->first : NULL, *nodes;
  int64_t chosen;
  PAGS_TRY(pags_json_integer_or(f->json, f->root, "scene", 0, INT32_MAX, 0, &chosen));
  for (int64_t i = 0; i < chosen && scene; i++)
    scene = scene->next;
  if (!scene)
    return pags_fail_at(f->path, "expected a scene with nodes, found none");
  PAGS_TRY(pags_json_array(f->json, scene, "nodes", &nodes));
  for (const pags_json_value *v = nodes->first; v; v = v->next)
    PAGS_TRY(add_node(s, v, "nodes", s->own ? identity : to_ply, 0));
  return PAGS_OK;
}

/* ---- Attributes ---- */

/* Reads an attribute; one that is missing is an error. */
static pags_result read_attribute(gltf_splats *s, const placed *item, const char *name, int components, float *out) {
  const pags_json_value *accessor;
  PAGS_TRY(pags_gltf_refer(&s->file, item->attributes, name, GLTF_ACCESSORS, &accessor));
  if (!accessor)
    return pags_json_fail(s->file.json, item->attributes,
                          "expected the attribute %s; drafts of the extension had others: write the file anew with a "
                          "program that knows the ratified one",
                          name);
  return pags_gltf_accessor_read(&s->file, accessor, name, item->count, components, out);
}

/* Linear light to sRGB (IEC 61966-2-1). */
static double display(double v) {
  v = fmin(fmax(v, 0), 1);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * pags_pow(v, 1 / 2.4) - 0.055;
}

static pags_result read_shape(gltf_splats *s, const placed *item, float *values, pags_gaussians *out, int64_t first) {
  double t[4];
  PAGS_TRY(read_attribute(s, item, EXTENSION ":SCALE", 3, values));
  /* The drafts before March 2026 stored logarithms; sigma is never negative. */
  bool logarithms = false;
  for (int64_t i = 0; i < 3 * item->count; i++)
    logarithms = logarithms || values[i] < 0;
  s->logarithms += logarithms;
  const double more = item->turned ? pags_log(item->size) : 0;
  for (int64_t i = 0; i < item->count; i++)
    for (int k = 0; k < 3; k++) {
      const double value = (double)values[3 * i + k];
      pags_plane(out, PAGS_SCALE + k)[first + i] =
          (float)(more + (logarithms || isnan(value) ? value : pags_log(fmax(value, 1e-12))));
    }

  PAGS_TRY(read_attribute(s, item, EXTENSION ":ROTATION", 4, values));
  pags_quaternion_from_rotation(item->rotation, t);
  for (int64_t i = 0; i < item->count; i++) {
    const float *v = values + 4 * i;
    const double q[4] = {(double)v[3], (double)v[0], (double)v[1], (double)v[2]};
    const double product[4] = {
        t[0] * q[0] - t[1] * q[1] - t[2] * q[2] - t[3] * q[3], t[0] * q[1] + t[1] * q[0] + t[2] * q[3] - t[3] * q[2],
        t[0] * q[2] - t[1] * q[3] + t[2] * q[0] + t[3] * q[1], t[0] * q[3] + t[1] * q[2] - t[2] * q[1] + t[3] * q[0]};
    for (int k = 0; k < 4; k++)
      pags_plane(out, PAGS_ROTATION + k)[first + i] = (float)(item->turned ? product[k] : q[k]);
  }
  return PAGS_OK;
}

/* Reads the opacity, which the file holds as such, as its logit. 1 becomes the largest logit whose sigmoid isn't 1. */
static pags_result read_opacity(gltf_splats *s, const placed *item, float *values, pags_gaussians *out, int64_t first) {
  PAGS_TRY(read_attribute(s, item, EXTENSION ":OPACITY", 1, values));
  for (int64_t i = 0; i < item->count; i++) {
    const double p = (double)values[i];
    s->clamped += p < -1e-6 || p > 1 + 1e-6;
    const double inside = fmin(fmax(p, 1e-8), 1 - 3e-8);
    pags_plane(out, PAGS_OPACITY)[first + i] = isnan(p) ? values[i] : (float)pags_log(inside / (1 - inside));
  }
  return PAGS_OK;
}

/* Reads the harmonics, turned with the node. Without a constant term, COLOR_0, which is linear light, replaces it. */
static pags_result read_colours(gltf_splats *s, const placed *item, float *values, pags_gaussians *out, int64_t first) {
  const pags_json_value *attributes = item->attributes;
  char name[NAME_SIZE];
  name_harmonic(0, 0, name);
  const bool fallback = !pags_json_member(attributes, name) && pags_json_member(attributes, "COLOR_0");
  PAGS_TRY(read_attribute(s, item, fallback ? "COLOR_0" : name, 3, values));
  s->without_dc += fallback;
  for (int64_t i = 0; i < item->count; i++)
    for (int c = 0; c < 3; c++) {
      const float v = values[3 * i + c];
      pags_plane(out, PAGS_SH + c)[first + i] = fallback ? (float)((display((double)v) - 0.5) / PAGS_SH_C0) : v;
    }
  for (int degree = 1, k = 1; degree <= item->degree; degree++)
    for (int n = 0; n <= 2 * degree; ++n, ++k) {
      name_harmonic(degree, n, name);
      PAGS_TRY(read_attribute(s, item, name, 3, values));
      for (int64_t i = 0; i < item->count; i++)
        for (int c = 0; c < 3; c++)
          pags_plane(out, PAGS_SH + 3 * k + c)[first + i] = values[3 * i + c];
    }
  if (!item->turned || item->degree == 0)
    return PAGS_OK;
  pags_sh_rotation turn;
  pags_sh_rotation_make(item->rotation, &turn);
  for (int64_t i = first; i < first + item->count; i++)
    pags_sh_rotation_apply_row(&turn, item->degree, out, i);
  return PAGS_OK;
}

/* Reads the positions. Those of a node far from zero (a place on the earth, say) are relative to `origin`, which the
 * first of them sets. */
static pags_result read_positions(gltf_splats *s, const placed *item, float *values, pags_gaussians *out, int64_t first,
                                  double origin[3]) {
  const double *m = item->pose;
  PAGS_TRY(read_attribute(s, item, "POSITION", 3, values));
  for (int k = 0; k < 3 && first == 0; k++)
    origin[k] = fabs(m[4 * k + 3]) > 1e4 ? floor(m[4 * k + 3]) : 0;
  for (int64_t i = 0; i < item->count; i++) {
    const float *v = values + 3 * i;
    double local[3], p[3];
    pags_widen3(v, local);
    pags_rigid_point(m, local, p);
    for (int k = 0; k < 3; k++)
      pags_plane(out, PAGS_MEAN + k)[first + i] = item->turned || origin[k] != 0 ? (float)(p[k] - origin[k]) : v[k];
  }
  return PAGS_OK;
}

static pags_result read_items(gltf_splats *s, pags_gaussians *out, double origin[3]) {
  int64_t total = 0, most = 0, first = 0;
  int degree = 0;
  for (int64_t i = 0; i < s->count; i++) {
    total += s->items[i].count;
    most = s->items[i].count > most ? s->items[i].count : most;
    degree = s->items[i].degree > degree ? s->items[i].degree : degree;
  }
  PAGS_AUTOFREE float *values = malloc(((size_t)most * 4 + 1) * sizeof *values);
  PAGS_CHECK_MEMORY(values, "%s: %lld Gaussians", s->file.path, (long long)total);
  PAGS_TRY(pags_gaussians_create(out, total, degree));
  for (int64_t i = 0; i < s->count; first += s->items[i++].count) {
    const placed *item = &s->items[i];
    PAGS_TRY(read_positions(s, item, values, out, first, origin));
    PAGS_TRY(read_shape(s, item, values, out, first));
    PAGS_TRY(read_opacity(s, item, values, out, first));
    PAGS_TRY(read_colours(s, item, values, out, first));
  }
  return PAGS_OK;
}

/* ---- The file ---- */

/* Reads the program that wrote the file and, if that is PAGS, the metadata of the scene. */
static pags_result read_asset(gltf_splats *s, pags_splat_facts *facts) {
  const gltf_file *f = &s->file;
  const pags_json_value *asset, *extras;
  const char *generator, *up;
  bool antialiased = false;
  double converted_from;
  PAGS_TRY(pags_json_object(f->json, f->root, "asset", &asset));
  PAGS_TRY(pags_json_string_or(f->json, asset, "generator", "", &generator));
  s->own = strncmp(generator, "pags ", 5) == 0;
  s->up = PAGS_UP_MINUS_Y;
  extras = pags_json_member(asset, "extras");
  if (!s->own || !extras)
    return PAGS_OK;
  PAGS_TRY(pags_json_bool_or(f->json, extras, "antialiased", false, &antialiased));
  facts->antialiased = antialiased;
  PAGS_TRY(numbers_or(f, extras, "origin", 3, facts->origin));
  PAGS_TRY(pags_json_number_or(f->json, extras, "converted_from_alpha_min", 0, &converted_from));
  facts->converted_from = (float)converted_from;
  PAGS_TRY(pags_json_string_or(f->json, extras, "up", "", &up));
  s->up_stated = pags_up_from_code(up, &s->up);
  return PAGS_OK;
}

/* Fails for an extension that the file can't be read without. */
static pags_result check_required(const gltf_file *f) {
  static const char *const known[] = {EXTENSION, "KHR_mesh_quantization", "KHR_node_visibility", "MSFT_lod"};
  const pags_json_value *required = pags_json_member(f->root, "extensionsRequired");
  for (const pags_json_value *v = required ? required->first : NULL; v; v = v->next) {
    const char *name;
    PAGS_TRY(pags_json_as_string(f->json, v, "extensionsRequired", &name));
    if (pags_text_find(name, known, 4) < 0)
      return pags_fail(
          PAGS_ERROR_UNSUPPORTED,
          "%s:%d: needs the extension '%.60s', which PAGS can't read: expected Gaussians as plain attributes", f->path,
          v->line, name);
  }
  return PAGS_OK;
}

/* Logs ignored and guessed properties. */
static void say(const gltf_splats *s) {
  const struct {
    int64_t primitives;
    const char *what;
  } guessed[] = {
      {s->logarithms, "have negative scales: taken as logarithms, as drafts of the extension had them"},
      {s->linear, "have colours in linear light, drawn as display values: too dark"},
      {s->kernels, "have another kernel than 'ellipse', drawn as ellipses"},
      {s->partial, "have a degree of harmonics with terms missing, which is dropped"},
      {s->without_dc, "have no SH_DEGREE_0_COEF_0; COLOR_0 is used as linear light"},
  };
  const char *path = s->file.path;
  const pags_json_value *animations = pags_json_member(s->file.root, "animations");
  if (s->other_primitives)
    PAGS_WARN("%s: %lld primitives are no Gaussians and aren't read", path, (long long)s->other_primitives);
  if (animations && animations->count)
    PAGS_WARN("%s: %lld animations aren't read: everything stands where its node does", path,
              (long long)animations->count);
  for (size_t i = 0; i < sizeof guessed / sizeof *guessed; i++)
    if (guessed[i].primitives)
      PAGS_WARN("%s: %lld of %lld primitives %s", path, (long long)guessed[i].primitives, (long long)s->count,
                guessed[i].what);
  if (s->clamped)
    PAGS_WARN("%s: %lld opacities are outside of 0..1 and clamped", path, (long long)s->clamped);
}

static void destroy(gltf_splats *s) {
  pags_gltf_close(&s->file);
  free(s->visited);
  free(s->items);
}

pags_result pags_gltf_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                             pags_splat_facts *facts) {
  PAGS_AUTO(destroy) gltf_splats s = {0};
  facts->kind = "glTF";
  PAGS_TRY(pags_gltf_open(path, bytes, size, &s.file));
  PAGS_TRY(read_asset(&s, facts));
  PAGS_TRY(check_required(&s.file));
  s.visited = calloc((size_t)s.file.lists[GLTF_NODES].count + 1, 1);
  PAGS_CHECK_MEMORY(s.visited, "%s: its nodes", path);
  PAGS_TRY(add_nodes(&s));
  if (!s.count)
    return pags_fail_at(path, "a glTF without Gaussians (%s), with %lld other primitives: expected a splat file",
                        EXTENSION, (long long)s.other_primitives);
  PAGS_TRY(read_items(&s, out, facts->taken_off));
  facts->up = s.up;
  pags_add3(facts->origin, facts->taken_off, facts->origin);
  say(&s);
  return PAGS_OK;
}
