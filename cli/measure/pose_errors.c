/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: errors of the labelled and the trained object poses against a synthetic set's true tracks, in metres and
 * degrees. */
#include "cli/measure/pose_errors.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
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

static void add_offset(pags_pose_error *sum, int labelled, const double p[3], double degrees) {
  *(labelled ? &sum->label_metres : &sum->metres) += pags_length3(p);
  *(labelled ? &sum->label_degrees : &sum->degrees) += fabs(degrees);
}

/* Adds the errors of one track to the sums: unchanged to `absolute`, and with the track's mean error subtracted to
 * `relative`. */
static void add_track(const offset *offsets, int64_t count, int labelled, pags_pose_errors *out) {
  offset mean = {{0, 0, 0}, 0};
  for (int64_t i = 0; i < count; i++) {
    for (int k = 0; k < 3; k++)
      mean.p[k] += offsets[i].p[k] / (double)count;
    mean.degrees += offsets[i].degrees / (double)count;
  }
  for (int64_t i = 0; i < count; i++) {
    double rest[3];
    for (int k = 0; k < 3; k++)
      rest[k] = offsets[i].p[k] - mean.p[k];
    add_offset(&out->absolute, labelled, offsets[i].p, offsets[i].degrees);
    add_offset(&out->relative, labelled, rest, offsets[i].degrees - mean.degrees);
  }
}

typedef struct reading {
  const pags_json *json;
  /* the file's objects face +y: their poses are turned so that they face +x, as the data set's reader does */
  int forward_y;
  offset *labelled, *trained;
  int64_t count, room;
} reading;

/* ---- Reading the true poses ---- */

static pags_result make_room(reading *r) {
  int64_t room = 2 * r->room + 64;
  if (r->count < r->room)
    return PAGS_OK;
  offset *labelled = realloc(r->labelled, (size_t)room * sizeof *labelled);
  r->labelled = labelled ? labelled : r->labelled;
  offset *trained = realloc(r->trained, (size_t)room * sizeof *trained);
  r->trained = trained ? trained : r->trained;
  if (!labelled || !trained)
    return pags_out_of_memory("%lld poses", (long long)room);
  r->room = room;
  return PAGS_OK;
}

/* Computes the errors of one keyframe against the true pose `matrix`. Errors of held-out keyframes are added to the
 * sums at once; those of trained keyframes are kept in `r` until the track's mean is known. */
static pags_result add_keyframe(reading *r, const pags_object *object, const pags_keyframe *keyframe,
                                const pags_json_value *matrix, pags_pose_errors *out) {
  double given[12], pose[12];

  /* Read the 4x4 matrix, given as four rows, and keep its first three rows. */
  int n = 0;
  PAGS_TRY(matrix->type == PAGS_JSON_ARRAY
               ? PAGS_OK
               : pags_json_fail(r->json, matrix, "expected a 4x4 matrix as four arrays of four numbers"));
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
  const offset labelled = offset_of(given, keyframe->world_from_object), drawn = offset_of(given, pose);
  if (!keyframe->trained) {
    add_offset(&out->held_out, 1, labelled.p, labelled.degrees);
    add_offset(&out->held_out, 0, drawn.p, drawn.degrees);
    out->held_out_keyframes++;
    return PAGS_OK;
  }
  PAGS_TRY(make_room(r));
  r->labelled[r->count] = labelled;
  r->trained[r->count++] = drawn;
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
  add_track(r->labelled, r->count, 1, out);
  add_track(r->trained, r->count, 0, out);
  return PAGS_OK;
}

/* Reads from dataset.json whether the data set's objects face +y instead of +x ("object_forward"). */
static pags_result read_forward(const char *dataset, int *forward_y) {
  pags_json *json;
  const char *forward = "+x";
  char *path = pags_path_join(dataset, "dataset.json");
  *forward_y = 0;
  if (!path)
    return pags_out_of_memory(NULL);
  pags_result result = pags_file_exists(path) ? pags_json_parse_file(path, &json) : PAGS_OK;
  if (result == PAGS_OK && pags_file_exists(path)) {
    result = pags_json_string_or(json, pags_json_root(json), "object_forward", "+x", &forward);
    *forward_y = result == PAGS_OK && !strcmp(forward, "+y");
    pags_json_destroy(json);
  }
  free(path);
  return result;
}

static void divide(pags_pose_error *sum, int64_t keyframes) {
  double *sums[] = {&sum->label_metres, &sum->label_degrees, &sum->metres, &sum->degrees};
  if (keyframes)
    for (size_t i = 0; i < sizeof sums / sizeof sums[0]; i++)
      *sums[i] /= (double)keyframes;
}

static pags_result measure(const char *path, const char *dataset, const pags_scene *scene, pags_pose_errors *out) {
  reading r = {0};
  pags_json *json;
  PAGS_TRY(read_forward(dataset, &r.forward_y));
  PAGS_TRY(pags_json_parse_file(path, &json));
  r.json = json;
  pags_result result = pags_json_as_object(json, pags_json_root(json), "the file");
  for (const pags_json_value *v = pags_json_root(json)->first; result == PAGS_OK && v; v = v->next)
    result = add_object(&r, scene, v, out);
  free(r.labelled);
  free(r.trained);
  pags_json_destroy(json);
  divide(&out->absolute, out->keyframes);
  divide(&out->relative, out->keyframes);
  divide(&out->held_out, out->held_out_keyframes);
  return result;
}

pags_result pags_pose_errors_measure(const char *dataset, const pags_scene *scene, pags_pose_errors *out) {
  memset(out, 0, sizeof *out);
  char *path = pags_path_join(dataset, "truth/instances/instances_info.json");
  if (!path)
    return pags_out_of_memory(NULL);
  pags_result result = pags_file_exists(path) ? measure(path, dataset, scene, out) : PAGS_OK;
  free(path);
  return result;
}

/* ---- JSON output ---- */

/* Share of the labels' error that training removed; NaN if the labels have no error. */
static double recovered(double labelled, double trained) {
  return labelled > 0 ? 1 - trained / labelled : (double)NAN;
}

static void put_kind(pags_json_writer *writer, const char *key, const pags_pose_error *e) {
  pags_json_begin_object(writer, key);
  pags_json_put_number(writer, "label_metres", e->label_metres);
  pags_json_put_number(writer, "metres", e->metres);
  pags_json_put_number(writer, "recovered_metres",
                       e->label_metres > least_metres ? recovered(e->label_metres, e->metres) : (double)NAN);
  pags_json_put_number(writer, "label_degrees", e->label_degrees);
  pags_json_put_number(writer, "degrees", e->degrees);
  pags_json_put_number(writer, "recovered_degrees",
                       e->label_degrees > least_degrees ? recovered(e->label_degrees, e->degrees) : (double)NAN);
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
