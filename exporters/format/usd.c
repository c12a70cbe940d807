/* SPDX-License-Identifier: Apache-2.0 */
/* pags_export_usd: writes the Gaussians and the proxies of a scene as one USD stage in text (.usda).
 *
 * The stage is Z up, in metres. Each object is an Xform below /scene with its track as time samples: a kinematic
 * rigid body. Below it are its Gaussians as a ParticleField3DGaussianSplat (OpenUSD 26.03) and its proxy as an
 * invisible mesh with a collider. /scene/background holds Gaussians and meshes of the rest. Spherical harmonics are
 * written of degree 0 or of degree 3 (missing terms zero), never between: Isaac Sim hangs on degrees 1 and 2. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/export.h>

#include "exporters/format/bake.h"
#include "exporters/format/object_gaussians.h"

#include "exporters/format/usd_text.h"
#include "exporters/proxy/background.h"
#include "exporters/proxy/object_proxy.h"
#include "frame/owners.h"
#include "maths/maths.h"
#include "scene/object.h"

enum { NAME_SIZE = PAGS_OBJECT_NAME, PADDED_DEGREE = 3 };

typedef struct usd_export {
  const pags_proxy_options *proxies;
  const pags_splat_options *splats;
  pags_tasks *tasks;
  pags_progress_fn *progress;
  void *user;
  int64_t object_count;
  pags_built_object *objects;
  pags_background background;
  pags_composition *composition;
  pags_usd usd;
  double time_zero, rate; /* USD time code = (time - time_zero) * rate; seconds, time codes a second */
  int degree;
  int64_t gaussians; /* bytes written */
} usd_export;

static void forget_export(usd_export *e) {
  pags_objects_destroy(e->objects, e->object_count);
  pags_background_destroy(&e->background);
  pags_composition_destroy_auto(&e->composition);
}

/* ---- Proxies ---- */

static int tell_objects(void *user, double fraction, const char *what) {
  const usd_export *e = user;
  return !e->progress || e->progress(e->user, 0.4 * fraction, what);
}

static int tell_background(void *user, double fraction, const char *what) {
  const usd_export *e = user;
  return !e->progress || e->progress(e->user, 0.4 + 0.4 * fraction, what);
}

static pags_result make_proxies(usd_export *e, const pags_scene *scene) {
  PAGS_AUTO(pags_proxy_maker_close) pags_proxy_maker maker = {0};
  e->object_count = scene->object_count;
  PAGS_TRY(pags_proxy_maker_open(scene, e->proxies, e->tasks, &maker));
  PAGS_TRY(pags_objects_make(&maker, false, tell_objects, e, &e->objects));
  return e->proxies->background ? pags_background_make(&maker, tell_background, e, &e->background) : PAGS_OK;
}

/* Writes `extent`, the axis-aligned bounds of the points, each point widened by its `reach` in metres (NULL:
 * none). */
static void put_extent(pags_usd *usd, const float *positions, int64_t count, const float *reach) {
  float bounds[6] = {0};
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3; k++) {
      float r = reach ? reach[i] : 0, p = positions[3 * i + k];
      bounds[k] = i == 0 || p - r < bounds[k] ? p - r : bounds[k];
      bounds[3 + k] = i == 0 || p + r > bounds[3 + k] ? p + r : bounds[3 + k];
    }
  pags_usd_floats(usd, "float3[] extent", bounds, 2, 3, NULL);
}

/* Writes an attribute that changes when an object comes and goes. */
static void put_presence(usd_export *e, const pags_presence *presence, const char *attribute, const char *there,
                         const char *gone) {
  pags_usd *usd = &e->usd;
  if (!presence || presence->always)
    return;
  pags_usd_line(usd, "%s.timeSamples = {", attribute);
  if (presence->spans[0][0] > e->time_zero)
    pags_usd_line(usd, "    0: %s,", gone);
  for (int64_t i = 0; i < presence->count; i++) {
    pags_usd_line(usd, "    %.9g: %s,", fmax(0, presence->spans[i][0] - e->time_zero) * e->rate, there);
    pags_usd_line(usd, "    %.9g: %s,", (presence->spans[i][1] - e->time_zero) * e->rate, gone);
  }
  pags_usd_line(usd, "}");
}

/* `presence` may be NULL: it is there all the time. */
static void put_mesh(usd_export *e, const char *name, const char *label, const pags_proxy_mesh *mesh,
                     const char *approximation, const pags_presence *presence) {
  pags_usd *usd = &e->usd;
  PAGS_AUTOFREE float *colors = malloc(((size_t)mesh->vertex_count * 3 + 1) * sizeof *colors);
  pags_usd_line(usd, "def Mesh \"%s\" (", name);
  pags_usd_line(
      usd,
      "    prepend apiSchemas = [\"PhysicsCollisionAPI\", \"PhysicsMeshCollisionAPI\", \"SemanticsLabelsAPI:class\"]");
  pags_usd_open(usd, ")");
  put_extent(usd, mesh->positions, mesh->vertex_count, NULL);
  pags_usd_integers(usd, "int[] faceVertexCounts", NULL, 3, mesh->triangle_count);
  pags_usd_integers(usd, "int[] faceVertexIndices", mesh->triangles, 0, 3 * mesh->triangle_count);
  pags_usd_floats(usd, "point3f[] points", mesh->positions, mesh->vertex_count, 3, NULL);
  for (int64_t i = 0; colors && i < 3 * mesh->vertex_count; i++)
    colors[i] = (float)pags_splat_linear((double)mesh->colors[i]);
  if (colors)
    pags_usd_floats(usd, "color3f[] primvars:displayColor", colors, mesh->vertex_count, 3, "vertex");
  else
    usd->result = pags_out_of_memory("a mesh's colours");
  pags_usd_line(usd, "uniform token subdivisionScheme = \"none\"");
  pags_usd_line(usd, "token visibility = \"invisible\"");
  pags_usd_line(usd, "uniform token purpose = \"default\"");
  put_presence(e, presence, "bool physics:collisionEnabled", "1", "0");
  pags_usd_line(usd, "uniform token physics:approximation = \"%s\"", approximation);
  pags_usd_line(usd, "token[] semantics:labels:class = [\"%s\"]", label);
  pags_usd_close(usd);
}

/* ---- Gaussians ---- */

/* The attributes of a splat prim, arrays in one block of memory. */
typedef struct columns {
  float *positions, *orientations, *scales, *opacities, *harmonics, *reach, *block;
} columns;

static void forget_columns(columns *c) {
  free(c->block);
}

static pags_result fill_columns(const pags_gaussians *g, int degree, columns *c) {
  size_t count = (size_t)g->count, coefficients = (size_t)pags_sh_coefficients(degree);
  c->block = malloc((count * (12 + 3 * coefficients) + 1) * sizeof *c->block);
  PAGS_CHECK_MEMORY(c->block, "%lld Gaussians", (long long)g->count);
  c->positions = c->block;
  c->orientations = c->positions + 3 * count;
  c->scales = c->orientations + 4 * count;
  c->opacities = c->scales + 3 * count;
  c->reach = c->opacities + count;
  c->harmonics = c->reach + count;
  for (int64_t i = 0; i < g->count; i++) {
    double q[4];
    pags_splat_rotation(g, i, q);
    for (int k = 0; k < 4; k++) /* w x y z, as USD's text has quaternions */
      c->orientations[4 * i + k] = (float)q[k];
    c->reach[i] = 0;
    for (int k = 0; k < 3; k++) {
      c->positions[3 * i + k] = pags_plane(g, PAGS_MEAN + k)[i];
      c->scales[3 * i + k] = pags_expf(pags_plane(g, PAGS_SCALE + k)[i]);
      c->reach[i] = fmaxf(c->reach[i], 3 * c->scales[3 * i + k]);
    }
    c->opacities[i] = (float)pags_splat_opacity(g, i);
    for (size_t k = 0; k < 3 * coefficients; k++)
      c->harmonics[(size_t)i * 3 * coefficients + k] =
          (int)k < 3 * pags_sh_coefficients(g->sh_degree) ? pags_plane(g, PAGS_SH + (int)k)[i] : 0;
  }
  return PAGS_OK;
}

static pags_result put_splats(usd_export *e, int64_t object) {
  pags_usd *usd = &e->usd;
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  PAGS_AUTO(forget_columns) columns c = {0};
  PAGS_TRY(pags_object_gaussians(e->composition, object, e->splats->time, e->degree, &g));
  if (!g.count)
    return PAGS_OK;
  PAGS_TRY(fill_columns(&g, e->degree, &c));
  pags_usd_open(usd, "def ParticleField3DGaussianSplat \"splats\"");
  put_extent(usd, c.positions, g.count, c.reach);
  pags_usd_floats(usd, "float[] opacities", c.opacities, g.count, 1, NULL);
  pags_usd_floats(usd, "quatf[] orientations", c.orientations, g.count, 4, NULL);
  pags_usd_floats(usd, "point3f[] positions", c.positions, g.count, 3, NULL);
  pags_usd_floats(usd, "float3[] radiance:sphericalHarmonicsCoefficients", c.harmonics,
                  g.count * pags_sh_coefficients(e->degree), 3, NULL);
  pags_usd_line(usd, "uniform int radiance:sphericalHarmonicsDegree = %d", e->degree);
  pags_usd_floats(usd, "float3[] scales", c.scales, g.count, 3, NULL);
  pags_usd_close(usd);
  e->gaussians += g.count;
  return PAGS_OK;
}

/* ---- Objects and the stage ---- */

/* The rotation of a pose as a quaternion. */
static void quaternion_of(const double pose[12], double q[4]) {
  const double r[9] = {pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]};
  pags_quaternion_from_rotation(r, q);
}

/* Writes an object's track as time samples: its rotations with `turns`, else its translations. */
static void put_samples(usd_export *e, const pags_object_track *track, bool turns) {
  pags_usd *usd = &e->usd;
  double before[4] = {0};
  pags_usd_line(usd, "%s = {", turns ? "quatf xformOp:orient.timeSamples" : "double3 xformOp:translate.timeSamples");
  for (int64_t i = 0; i < track->count; i++) {
    const double *p = track->poses[i];
    double q[4], along = 0;
    quaternion_of(p, q);
    for (int k = 0; k < 4; k++)
      along += q[k] * before[k];
    for (int k = 0; k < 4; k++)
      before[k] = along < 0 ? -q[k] : q[k]; /* q and -q are the same rotation: the nearer one turns the shorter way */
    if (turns)
      pags_usd_line(usd, "    %.9g: (%.9g, %.9g, %.9g, %.9g),", track->times[i] * e->rate, before[0], before[1],
                    before[2], before[3]);
    else
      pags_usd_line(usd, "    %.9g: (%.9g, %.9g, %.9g),", track->times[i] * e->rate, p[3], p[7], p[11]);
  }
  pags_usd_line(usd, "}");
}

/* Writes an object's pose: a track of one pose as a constant transform, a longer one as time samples. */
static void put_pose(usd_export *e, const pags_object_track *track) {
  pags_usd *usd = &e->usd;
  const double *p = track->poses[0];
  double q[4];
  quaternion_of(p, q);
  if (track->count > 1) {
    put_samples(e, track, true);
    put_samples(e, track, false);
  } else {
    pags_usd_line(usd, "quatf xformOp:orient = (%.9g, %.9g, %.9g, %.9g)", q[0], q[1], q[2], q[3]);
    pags_usd_line(usd, "double3 xformOp:translate = (%.9g, %.9g, %.9g)", p[3], p[7], p[11]);
  }
  pags_usd_line(usd, "uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"]");
}

static void put_custom(usd_export *e, const pags_scene_object *o, int64_t number) {
  pags_usd *usd = &e->usd;
  char track[NAME_SIZE];
  pags_usd_name(o->record.id, track, sizeof track);
  pags_usd_line(usd, "    customData = {");
  pags_usd_line(usd, "        bool critical = %d", o->critical != 0);
  pags_usd_line(usd, "        string level = \"%s\"", pags_proxy_level_name(e->objects[number].levels[0].facts.level));
  pags_usd_line(usd, "        bool moving = %d", o->record.moving != 0);
  pags_usd_line(usd, "        int number = %lld", (long long)number);
  pags_usd_line(usd, "        double3 size = (%.9g, %.9g, %.9g)", o->record.size[0], o->record.size[1],
                o->record.size[2]);
  pags_usd_line(usd, "        string track = \"%s\"", track);
  pags_usd_line(usd, "    }");
}

static const char *const approximations[PAGS_PROXY_LEVELS] = {"none", "none", "convexHull", "boundingCube",
                                                              "convexHull"};

static pags_result put_object(usd_export *e, int64_t object) {
  const pags_scene *scene = pags_composition_scene(e->composition);
  const pags_scene_object *o = &scene->objects[object];
  const pags_built_level *built = &e->objects[object].levels[0];
  const char *approximation = approximations[built->facts.level];
  pags_usd *usd = &e->usd;
  PAGS_AUTO(pags_object_track_destroy) pags_object_track track = {0};
  PAGS_AUTO(pags_presence_destroy) pags_presence presence = {0};
  char plain[NAME_SIZE], label[NAME_SIZE], name[NAME_SIZE];
  pags_class_plain_name(o->record.class_name, plain);
  pags_usd_name(plain, label, sizeof label - 16);
  snprintf(name, sizeof name, "%.60s_%04lld", label, (long long)object);
  PAGS_TRY(pags_object_track_make(scene, &o->record, e->time_zero, &track));
  PAGS_TRY(pags_presence_find(scene, object, &presence));
  pags_usd_line(usd, "def Xform \"%s\" (", name);
  put_custom(e, o, object);
  pags_usd_line(usd, "    prepend apiSchemas = [\"PhysicsRigidBodyAPI\", \"SemanticsLabelsAPI:class\"]");
  pags_usd_open(usd, ")");
  pags_usd_line(usd, "bool physics:kinematicEnabled = 1");
  pags_usd_line(usd, "token[] semantics:labels:class = [\"%s\"]", label);
  put_pose(e, &track);
  put_presence(e, &presence, "token visibility", "\"inherited\"", "\"invisible\"");
  PAGS_TRY(put_splats(e, object));
  if (!built->parts.count)
    put_mesh(e, "proxy", label, &built->mesh, approximation, &presence);
  for (int i = 0; i < built->parts.count; i++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh part = {0};
    PAGS_TRY(pags_convex_part(&built->mesh, &built->parts, i, &part));
    snprintf(name, sizeof name, "proxy_%02d", i);
    put_mesh(e, name, label, &part, approximation, &presence);
  }
  pags_usd_close(usd);
  return PAGS_OK;
}

static pags_result put_background(usd_export *e) {
  char name[NAME_SIZE];
  pags_usd_open(&e->usd, "def Xform \"background\"");
  PAGS_TRY(put_splats(e, -1));
  for (int64_t i = 0; i < e->background.chunk_count; i++) {
    const pags_chunk *chunk = &e->background.chunks[i];
    snprintf(name, sizeof name, "%s_%03d", chunk->class_name, chunk->number);
    put_mesh(e, name, chunk->class_name, &chunk->mesh, approximations[chunk->level], NULL);
  }
  pags_usd_close(&e->usd);
  return PAGS_OK;
}

static pags_result put_stage(usd_export *e) {
  const pags_scene *scene = pags_composition_scene(e->composition);
  pags_usd *usd = &e->usd;
  pags_usd_line(usd, "(");
  pags_usd_line(usd, "    customLayerData = {");
  pags_usd_line(usd, "        bool antialiased = %d", scene->antialiased != 0);
  pags_usd_line(usd, "        double3 origin = (%.17g, %.17g, %.17g)", scene->origin[0], scene->origin[1],
                scene->origin[2]);
  if (scene->place.known)
    pags_usd_line(usd, "        double3 geographicOrigin = (%.17g, %.17g, %.17g)", scene->place.latitude,
                  scene->place.longitude, scene->place.altitude);
  pags_usd_line(usd, "        double timeZero = %.17g", e->time_zero);
  pags_usd_line(usd, "    }");
  pags_usd_line(usd, "    defaultPrim = \"scene\"");
  pags_usd_line(usd, "    endTimeCode = %.9g", fmax(0, (scene->time_end - e->time_zero) * e->rate));
  pags_usd_line(usd, "    framesPerSecond = %.9g", e->rate);
  pags_usd_line(usd, "    metersPerUnit = 1");
  pags_usd_line(usd, "    startTimeCode = 0");
  pags_usd_line(usd, "    timeCodesPerSecond = %.9g", e->rate);
  pags_usd_line(usd, "    upAxis = \"Z\"");
  pags_usd_line(usd, ")");
  pags_usd_line(usd, "def Xform \"scene\" (");
  pags_usd_line(usd, "    kind = \"assembly\"");
  pags_usd_open(usd, ")");
  if (scene->up != PAGS_UP_Z) { /* worlds with -y up are turned by -90 degrees about x to z up, those with y up by 90 */
    pags_usd_line(usd, "float xformOp:rotateX = %d", scene->up == PAGS_UP_Y ? 90 : -90);
    pags_usd_line(usd, "uniform token[] xformOpOrder = [\"xformOp:rotateX\"]");
  }
  pags_usd_open(usd, "def PhysicsScene \"physics\"");
  pags_usd_line(usd, "vector3f physics:gravityDirection = (0, 0, -1)");
  pags_usd_line(usd, "float physics:gravityMagnitude = 9.81");
  pags_usd_close(usd);
  if (e->proxies->background)
    PAGS_TRY(put_background(e));
  for (int64_t i = 0; i < scene->object_count; i++) {
    PAGS_TRY(pags_proxy_tell(e->progress, e->user, 0.8 + 0.2 * (double)i / (double)scene->object_count, "writing"));
    if (e->objects[i].level_count)
      PAGS_TRY(put_object(e, i));
  }
  pags_usd_close(usd);
  return PAGS_OK;
}

pags_result pags_export_usd(pags_scene *scene, const char *path, const pags_proxy_options *proxies,
                            const pags_splat_options *splats, pags_tasks *tasks, pags_progress_fn *progress, void *user,
                            int64_t *count) {
  pags_proxy_options plain = *proxies; /* names of programs and textures are for glTF */
  plain.naming = PAGS_NAMING_PLAIN;
  plain.texture = 0;
  PAGS_AUTO(forget_export)
  usd_export e = {.proxies = &plain, .splats = splats, .tasks = tasks, .progress = progress, .user = user};
  if (count)
    *count = 0;
  PAGS_TRY(make_proxies(&e, scene));
  e.time_zero = pags_scene_time_zero(scene);
  e.rate = scene->fps > 0 ? scene->fps : 24;
  PAGS_TRY(pags_composition_create(scene, &e.composition));
  PAGS_TRY(pags_object_gaussians_degree(e.composition, splats->sh_degree, &e.degree));
  e.degree = e.degree > 0 ? PADDED_DEGREE : 0;
  pags_usd_begin(&e.usd, path);
  const pags_result result = put_stage(&e);
  if (result != PAGS_OK)
    e.usd.result = result;
  if (count)
    *count = e.gaussians;
  return pags_usd_end(&e.usd);
}
