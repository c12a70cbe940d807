/* SPDX-License-Identifier: Apache-2.0 */
/* Clean-up and look: rules, given as JSON, that leave out Gaussians by place, opacity, size and support, change the
 * colours and opacities of those that stay, and move parked objects.
 *
 * A colour is c = 1/2 + C0 dc + sum of C_k(d) sh_k over directions d, so that the affine map c' = M c + t takes each
 * triple of coefficients to M sh_k, and the constant one to M dc + (M (1/2, 1/2, 1/2) + t - 1/2) / C0: exact but for
 * colours below 0, which are drawn as 0 after the map instead of before. */
#include "scene/filter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "scene/axes.h"

enum { MOST_CROPS = 64 };
static const double C0 = 0.28209479177387814;
static const double MOST_OPACITY = 1 - 1e-6; /* its logit is finite */

/* A box (the cube from -1 to 1) or a ball (of radius 1) that is carried by an affine map. */
typedef struct crop {
  bool ball, keep;
  double unit_from_frame[12];
} crop;

typedef struct rule {
  bool everything;
  int64_t object; /* unless `everything`; -1: the Gaussians of no object */
  pags_filter limits;
  crop crops[MOST_CROPS];
  int crop_count;
  bool has_matrix, moves;
  double matrix[12], opacity, sh;
  double motion[12]; /* of the world */
} rule;

/* ---- Reading ---- */

static pags_result check_keys(const pags_json *json, const pags_json_value *object, const char *const *known,
                              int count) {
  for (const pags_json_value *child = object->first; child; child = child->next)
    if (pags_text_find(child->key, known, count) < 0)
      return pags_json_fail(json, child, "'%s' is no member of a rule of clean-up and look", child->key);
  return PAGS_OK;
}

/* A number from lo to hi. */
static pags_result read_number(const pags_json *json, const pags_json_value *object, const char *key, double lo,
                               double hi, double fallback, double *out) {
  PAGS_TRY(pags_json_number_or(json, object, key, fallback, out));
  if (*out >= lo && *out <= hi)
    return PAGS_OK;
  return pags_json_fail(json, pags_json_member(object, key), "expected '%s' from %g to %g, found %g", key, lo, hi,
                        *out);
}

static pags_result read_crop(const pags_json *json, const pags_json_value *value, crop *out) {
  static const char *const known[] = {"shape", "keep", "unit_from_frame"};
  const char *shape;
  PAGS_TRY(pags_json_as_object(json, value, "a crop"));
  PAGS_TRY(check_keys(json, value, known, 3));
  PAGS_TRY(pags_json_string(json, value, "shape", &shape));
  out->ball = strcmp(shape, "sphere") == 0;
  if (!out->ball && strcmp(shape, "box") != 0)
    return pags_json_fail(json, value, "expected the shape 'box' or 'sphere', found '%s'", shape);
  PAGS_TRY(pags_json_bool_or(json, value, "keep", true, &out->keep));
  return pags_json_numbers(json, value, "unit_from_frame", 12, out->unit_from_frame);
}

static pags_result read_rule(const pags_json *json, const pags_json_value *value, const pags_scene *scene, rule *out) {
  static const char *const known[] = {"object", "least_opacity", "least_size", "greatest_size", "least_views", "crops",
                                      "matrix", "opacity",       "sh",         "motion"};
  *out = (rule){0};
  PAGS_TRY(pags_json_as_object(json, value, "a rule"));
  PAGS_TRY(check_keys(json, value, known, sizeof known / sizeof *known));
  out->everything = !pags_json_member(value, "object");
  PAGS_TRY(pags_json_integer_or(json, value, "object", -1, scene->object_count - 1, -1, &out->object));
  PAGS_TRY(read_number(json, value, "least_opacity", 0, 1, 0, &out->limits.least_opacity));
  PAGS_TRY(read_number(json, value, "least_size", 0, 1e6, 0, &out->limits.least_size));
  PAGS_TRY(read_number(json, value, "greatest_size", 0, 1e6, 0, &out->limits.greatest_size));
  PAGS_TRY(pags_json_int_or(json, value, "least_views", 0, INT32_MAX, 0, &out->limits.least_views));
  PAGS_TRY(read_number(json, value, "opacity", 0, 1000, 1, &out->opacity));
  PAGS_TRY(read_number(json, value, "sh", 0, 10, 1, &out->sh));
  out->has_matrix = pags_json_member(value, "matrix") != NULL;
  if (out->has_matrix)
    PAGS_TRY(pags_json_numbers(json, value, "matrix", 12, out->matrix));
  out->moves = pags_json_member(value, "motion") != NULL;
  if (out->moves) {
    PAGS_TRY(pags_json_numbers(json, value, "motion", 12, out->motion));
    PAGS_TRY(pags_rigid_check(out->motion, "motion"));
    if (out->object < 0 || scene->objects[out->object].model >= 0)
      return pags_json_fail(json, value, "expected a 'motion' of a parked object; others follow their tracks");
  }
  const pags_json_value *crops = pags_json_member(value, "crops");
  if (!crops)
    return PAGS_OK;
  if (crops->type != PAGS_JSON_ARRAY || crops->count > MOST_CROPS)
    return pags_json_fail(json, crops, "expected at most %d crops in an array", MOST_CROPS);
  for (const pags_json_value *item = crops->first; item; item = item->next)
    PAGS_TRY(read_crop(json, item, &out->crops[out->crop_count++]));
  return PAGS_OK;
}

/* ---- Which Gaussians ---- */

/* The object of a Gaussian: that of its model or, in the background, the parked object of its id; -1: none. */
static int64_t object_of_row(const pags_scene *scene, const pags_gaussians *g, int64_t own, int64_t row) {
  if (own >= 0 || !g->object_id)
    return own;
  const int64_t id = g->object_id[row];
  return id >= 0 && id < scene->object_count && scene->objects[id].model < 0 ? id : -1;
}

/* From the rows of a model to the frame of the rule's crops: the object's, of a parked one at its first label. */
static void find_frame(const pags_scene *scene, const rule *r, int64_t own, double out[12]) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  memcpy(out, identity, sizeof identity);
  if (r->everything || r->object < 0 || own >= 0)
    return;
  const pags_object *o = &scene->objects[r->object].record;
  double pose[12];
  if (!pags_object_pose(o, scene->time_begin, pose) && !pags_object_pose(o, o->keyframes[0].time, pose))
    memcpy(pose, o->keyframes[0].world_from_object, sizeof pose);
  pags_pose_subtract(pose, scene->origin);
  pags_rigid_inverse(pose, out);
}

/* Whether a point is in one of the crops to keep, if the rule has any, and outside all crops to remove. */
static bool is_left(const rule *r, const double p[3]) {
  bool inside = false, any = false;
  for (int i = 0; i < r->crop_count; i++) {
    const crop *const c = &r->crops[i];
    double unit[3];
    pags_rigid_point(c->unit_from_frame, p, unit);
    const bool in =
        c->ball ? pags_dot3(unit, unit) <= 1 : fabs(unit[0]) <= 1 && fabs(unit[1]) <= 1 && fabs(unit[2]) <= 1;
    if (in && !c->keep)
      return false;
    any = any || c->keep;
    inside = inside || (in && c->keep);
  }
  return inside || !any;
}

/* ---- The look ---- */

/* Multiplies the triple at `planes`, planes + step and planes + 2 step by the 3x3 part of M. */
static void turn_colour(const double m[12], float *planes, int64_t step) {
  const double c[3] = {(double)planes[0], (double)planes[step], (double)planes[2 * step]};
  for (int k = 0; k < 3; k++)
    planes[k * step] = (float)pags_dot3(m + 4 * k, c);
}

static void look_row(const rule *r, pags_gaussians *g, int64_t i) {
  const int harmonics = pags_sh_coefficients(g->sh_degree);
  for (int h = 0; h < harmonics; h++) {
    float *sh = pags_plane(g, PAGS_SH + 3 * h) + i;
    if (r->has_matrix)
      turn_colour(r->matrix, sh, g->stride);
    for (int k = 0; k < 3; k++) {
      const double *row = r->matrix + 4 * k;
      if (h > 0)
        sh[k * g->stride] *= (float)r->sh;
      else if (r->has_matrix)
        sh[k * g->stride] += (float)((0.5 * (row[0] + row[1] + row[2]) + row[3] - 0.5) / C0);
    }
  }
  for (int p = 0; p < pags_fourier_planes(g); p += 3) {
    float *const term = g->fourier + p * g->stride + i;
    if (r->has_matrix)
      turn_colour(r->matrix, term, g->stride);
    for (int k = 0; k < 3 && p >= PAGS_FOURIER_PLANES; k++)
      term[k * g->stride] *= (float)r->sh;
  }
  if (r->opacity == 1)
    return;
  float *logit = pags_plane(g, PAGS_OPACITY) + i;
  const double opacity = fmin(r->opacity / (1 + pags_exp(-(double)*logit)), MOST_OPACITY);
  *logit = (float)pags_log(opacity / (1 - opacity));
}

/* Applies the map to a background colour, clamped to 0 or more. */
static void look_behind(const double m[12], float rgb[3]) {
  turn_colour(m, rgb, 1);
  for (int k = 0; k < 3; k++)
    rgb[k] = (float)fmax((double)rgb[k] + m[4 * k + 3], 0);
}

/* ---- Motion ---- */

/* Moves a parked object: its Gaussians, and the places of its labels. */
static void move(pags_scene *scene, const rule *r) {
  const double *const m = r->motion;
  const double rotation[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
  pags_object *const object = &scene->objects[r->object].record;
  double turn[4];
  pags_sh_rotation harmonics;
  pags_quaternion_from_rotation(rotation, turn);
  pags_sh_rotation_make(rotation, &harmonics);
  for (int64_t k = 0; k < object->keyframe_count; k++) {
    double *const pose = object->keyframes[k].world_from_object;
    pags_rigid_multiply(m, pose, pose);
  }
  for (int64_t model = 0; model < scene->model_count; model++) {
    pags_gaussians *const g = &scene->models[model].gaussians;
    for (int64_t i = 0; i < g->count; i++) {
      if (!g->object_id || g->object_id[i] != r->object)
        continue;
      double p[3], moved[3], q[4];
      pags_gaussian_mean(g, i, p);
      pags_add3(p, scene->origin, p);
      pags_rigid_point(m, p, moved);
      pags_subtract3(moved, scene->origin, moved);
      for (int k = 0; k < 3; k++)
        pags_plane(g, PAGS_MEAN + k)[i] = (float)moved[k];
      for (int k = 0; k < 4; k++)
        q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
      pags_quaternion_multiply(turn, q, q);
      for (int k = 0; k < 4; k++)
        pags_plane(g, PAGS_ROTATION + k)[i] = (float)q[k];
      pags_sh_rotation_apply_row(&harmonics, g->sh_degree, g, i);
    }
  }
}

/* ---- Rules ---- */

static pags_result apply_to_model(pags_scene *scene, int64_t model, const rule *r, const pags_support *support,
                                  int64_t *index) {
  pags_gaussians *g = &scene->models[model].gaussians;
  int64_t own = 0; /* the object with this model; -1: the background */
  while (own < scene->object_count && scene->objects[own].model != model)
    own++;
  own = own < scene->object_count ? own : -1;
  const bool placed = own < 0 || !r->everything; /* whether the rows have the frame of the crops */
  double frame[12];
  int64_t count = 0;
  find_frame(scene, r, own, frame);
  for (int64_t i = 0; i < g->count; i++) {
    bool stays = true;
    if (r->everything || object_of_row(scene, g, own, i) == r->object) {
      double mean[3], p[3];
      pags_gaussian_mean(g, i, mean);
      pags_rigid_point(frame, mean, p);
      stays = r->opacity > 0 && pags_filter_fits(&r->limits, g, i) && (!placed || is_left(r, p)) &&
              (own >= 0 || !r->limits.least_views || pags_support_has(support, r->limits.least_views, mean));
    }
    if (stays)
      index[count++] = i;
  }
  PAGS_TRY(pags_gaussians_keep(g, index, count));
  for (int64_t i = 0; i < g->count && (r->has_matrix || r->opacity != 1 || r->sh != 1); i++)
    if (r->everything || object_of_row(scene, g, own, i) == r->object)
      look_row(r, g, i);
  return PAGS_OK;
}

static pags_result apply(pags_scene *scene, const rule *r, const pags_support *support, int64_t *index) {
  PAGS_TRY(pags_support_check(support, r->limits.least_views));
  for (int64_t m = 0; m < scene->model_count; m++)
    PAGS_TRY(apply_to_model(scene, m, r, support, index));
  if (r->moves)
    move(scene, r);
  if (!r->everything || !r->has_matrix)
    return PAGS_OK;
  look_behind(r->matrix, scene->background);
  const int64_t texels = 6 * (int64_t)scene->sky.size * scene->sky.size;
  for (int64_t i = 0; i < texels; i++)
    look_behind(r->matrix, scene->sky.texels + 3 * i);
  return PAGS_OK;
}

pags_result pags_scene_cleanup(pags_scene *scene, const char *name, const char *text) {
  const int64_t before = pags_scene_gaussian_count(scene);
  PAGS_AUTO(pags_support_destroy) pags_support support = {0};
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_text(name, text, strlen(text), &json));
  const pags_json_value *root = pags_json_root(json);
  PAGS_AUTOFREE int64_t *index = malloc(((size_t)before + 1) * sizeof *index);
  PAGS_CHECK_MEMORY(index, "%lld Gaussians", (long long)before);
  PAGS_TRY(pags_support_find(scene, &support));
  if (root->type != PAGS_JSON_ARRAY)
    return pags_json_fail(json, root, "expected an array of rules of clean-up and look");
  for (const pags_json_value *value = root->first; value; value = value->next) {
    rule r;
    PAGS_TRY(read_rule(json, value, scene, &r));
    PAGS_TRY(apply(scene, &r, &support, index));
  }
  if (before && !pags_scene_gaussian_count(scene))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: none of the %lld Gaussians is left by clean-up and look", name,
                     (long long)before);
  return PAGS_OK;
}
