/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: errors of the labelled and the trained object poses against a synthetic set's true tracks, in metres and
 * degrees. */
#include "cli/measure/errors.h"

#include <math.h>
#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

/* A labelled pose that is off by no more than these is right but for rounding: the share of its error that training
 * has removed is not reported. */
static const double least_metres = 1e-6, least_degrees = 1e-4;

/* Error of one pose against the truth: the pose's origin in the true object's frame, in metres, and its rotation
 * about that frame's upward axis, in degrees. */
typedef struct offset {
  double p[3];
  double degrees;
} offset;

/* ---- Errors of one keyframe and of one track ---- */

static offset offset_of(const double given[12], const double pose[12]) {
  double inverse[12], between[12];
  pags_rigid_inverse(given, inverse);
  pags_rigid_multiply(inverse, pose, between);
  return (offset){{between[3], between[7], between[11]},
                  pags_atan2(between[4], between[0]) * 180 / 3.14159265358979323846};
}

static void add_offset(pags_pose_error *sum, bool labelled, const double p[3], double degrees) {
  *(labelled ? &sum->label_metres : &sum->metres) += pags_length3(p);
  *(labelled ? &sum->label_degrees : &sum->degrees) += fabs(degrees);
}

/* The errors of one keyframe's pose as labelled, and as trained. */
typedef struct keyframe_errors {
  offset labelled, trained;
} keyframe_errors;

/* Adds the errors of one track to the sums: unchanged to `absolute`, and with the track's mean error subtracted to
 * `relative`. */
static void add_track(const keyframe_errors *track, int64_t count, bool labelled, pags_pose_errors *out) {
  offset mean = {{0, 0, 0}, 0};
  for (int64_t i = 0; i < count; i++) {
    const offset *const o = labelled ? &track[i].labelled : &track[i].trained;
    for (int k = 0; k < 3; k++)
      mean.p[k] += o->p[k] / (double)count;
    mean.degrees += o->degrees / (double)count;
  }
  for (int64_t i = 0; i < count; i++) {
    const offset *const o = labelled ? &track[i].labelled : &track[i].trained;
    double rest[3];
    pags_subtract3(o->p, mean.p, rest);
    add_offset(&out->absolute, labelled, o->p, o->degrees);
    add_offset(&out->relative, labelled, rest, o->degrees - mean.degrees);
  }
}

typedef struct reading {
  const pags_json *json;
  /* the file's objects face +y: their poses are turned so that they face +x, as the data set's reader does */
  bool forward_y;
  keyframe_errors *track;
  int64_t count, capacity;
} reading;

/* ---- Reading the true poses ---- */

/* Computes the errors of one keyframe against the true pose `matrix`. Errors of held-out keyframes are added to the
 * sums at once; those of trained keyframes are kept in `r` until the track's mean is known. */
static pags_result add_keyframe(reading *r, const pags_object *object, const pags_keyframe *keyframe,
                                const pags_json_value *matrix, pags_pose_errors *out) {
  double given[12], pose[12];

  /* Read the 4x4 matrix, given as four rows, and keep its first three rows. */
  int n = 0;
  if (matrix->type != PAGS_JSON_ARRAY)
    return pags_json_fail(r->json, matrix, "expected a 4x4 matrix as four arrays of four numbers");
  for (const pags_json_value *row = matrix->first; row; row = row->next)
    for (const pags_json_value *v = row->first; v; v = v->next) {
      double value;
      PAGS_TRY(pags_json_as_number(r->json, v, "an entry of 'obj_to_world'", &value));
      if (n < 12)
        given[n] = value;
      n++;
    }
  if (n != 16)
    return pags_json_fail(r->json, matrix, "expected a 4x4 matrix, got %d numbers", n);
  /* turn about z: the new x axis (forward) is the old y, the new y axis (left) the old -x */
  if (r->forward_y)
    for (int k = 0; k < 3; k++) {
      double x = given[4 * k];
      given[4 * k] = given[4 * k + 1];
      given[4 * k + 1] = -x;
    }

  if (!pags_object_pose(object, keyframe->time, pose))
    return PAGS_OK;
  const keyframe_errors errors = {offset_of(given, keyframe->world_from_object), offset_of(given, pose)};
  if (!keyframe->trained) {
    add_offset(&out->held_out, true, errors.labelled.p, errors.labelled.degrees);
    add_offset(&out->held_out, false, errors.trained.p, errors.trained.degrees);
    out->held_out_keyframes++;
    return PAGS_OK;
  }
  PAGS_CHECK_MEMORY(pags_grow(&r->track, r->count + 1, &r->capacity, sizeof *r->track), "%lld poses",
                    (long long)r->count + 1);
  r->track[r->count++] = errors;
  return PAGS_OK;
}

/* Adds the errors of one object of instances_info.json; skips objects that have no model of their own in the
 * scene. */
static pags_result add_object(reading *r, const pags_scene *scene, const pags_json_value *entry,
                              pags_pose_errors *out) {
  const char *id;
  const pags_json_value *annotations, *frames, *poses;
  PAGS_TRY(pags_json_string(r->json, entry, "id", &id));
  const pags_scene_object *object = pags_scene_find_object(scene, id);
  if (!object || object->model < 0)
    return PAGS_OK;
  PAGS_TRY(pags_json_object(r->json, entry, "frame_annotations", &annotations));
  PAGS_TRY(pags_json_array(r->json, annotations, "frame_idx", &frames));
  PAGS_TRY(pags_json_array(r->json, annotations, "obj_to_world", &poses));
  r->count = 0;
  const pags_json_value *pose = poses->first;
  for (const pags_json_value *frame = frames->first; frame && pose; frame = frame->next, pose = pose->next) {
    double number;
    PAGS_TRY(pags_json_as_number(r->json, frame, "an entry of 'frame_idx'", &number));
    const pags_keyframe *keyframe = pags_object_keyframe(&object->record, (int64_t)number);
    if (keyframe)
      PAGS_TRY(add_keyframe(r, &object->record, keyframe, pose, out));
  }
  if (!r->count)
    return PAGS_OK;
  out->objects++;
  out->keyframes += r->count;
  add_track(r->track, r->count, true, out);
  add_track(r->track, r->count, false, out);
  return PAGS_OK;
}

static void divide(pags_pose_error *sum, int64_t keyframes) {
  double *sums[] = {&sum->label_metres, &sum->label_degrees, &sum->metres, &sum->degrees};
  if (keyframes)
    for (size_t i = 0; i < sizeof sums / sizeof sums[0]; i++)
      *sums[i] /= (double)keyframes;
}

pags_result pags_pose_errors_measure(const char *dataset, const pags_scene *scene, pags_pose_errors *out) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL, *about = NULL;
  const char *forward = "+x";
  memset(out, 0, sizeof *out);
  PAGS_TRY(pags_json_parse_in_folder(dataset, "truth/instances/instances_info.json", &json));
  if (!json)
    return PAGS_OK;
  PAGS_TRY(pags_json_parse_in_folder(dataset, "dataset.json", &about));
  if (about)
    PAGS_TRY(pags_json_string_or(about, pags_json_root(about), "object_forward", "+x", &forward));
  PAGS_TRY(pags_json_as_object(json, pags_json_root(json), "the file"));
  reading r = {.json = json, .forward_y = !strcmp(forward, "+y")};
  pags_result result = PAGS_OK;
  for (const pags_json_value *v = pags_json_root(json)->first; result == PAGS_OK && v; v = v->next)
    result = add_object(&r, scene, v, out);
  free(r.track);
  divide(&out->absolute, out->keyframes);
  divide(&out->relative, out->keyframes);
  divide(&out->held_out, out->held_out_keyframes);
  return result;
}

/* ---- JSON output ---- */

/* Share of the labels' error that training removed; NaN if the labels have no error. */
static double recovered(double least, double labelled, double trained) {
  return labelled > least ? 1 - trained / labelled : (double)NAN;
}

static void put_kind(pags_json_writer *writer, const char *key, const pags_pose_error *e) {
  pags_json_begin_object(writer, key);
  pags_json_put_number(writer, "label_metres", e->label_metres);
  pags_json_put_number(writer, "metres", e->metres);
  pags_json_put_number(writer, "recovered_metres", recovered(least_metres, e->label_metres, e->metres));
  pags_json_put_number(writer, "label_degrees", e->label_degrees);
  pags_json_put_number(writer, "degrees", e->degrees);
  pags_json_put_number(writer, "recovered_degrees", recovered(least_degrees, e->label_degrees, e->degrees));
  pags_json_end_object(writer);
}

void pags_pose_errors_put_json(pags_json_writer *writer, const pags_pose_errors *e) {
  if (!e->keyframes) {
    pags_json_put_null(writer, "poses");
    return;
  }
  pags_json_begin_object(writer, "poses");
  pags_json_put_integer(writer, "objects", e->objects);
  pags_json_put_integer(writer, "knots", e->keyframes);
  put_kind(writer, "absolute", &e->absolute);
  put_kind(writer, "relative", &e->relative);
  pags_json_put_integer(writer, "held_out_knots", e->held_out_keyframes);
  if (e->held_out_keyframes)
    put_kind(writer, "held_out", &e->held_out);
  else
    pags_json_put_null(writer, "held_out");
  pags_json_end_object(writer);
}
