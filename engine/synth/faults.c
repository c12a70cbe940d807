/* SPDX-License-Identifier: Apache-2.0 */
/* Faults of the cameras of the synthetic street, each from its physical definition.
 *
 * Rolling shutter: the lines of a photograph are read one after the other at even distances in time; the middle of the
 * read-out is the time of the exposure. A delay moves all exposures of a camera. The car's pose has two errors of equal
 * variance: one that is drawn afresh in each time step, and one whose correlation falls by a factor of e in half a
 * second, as the drift of a localisation does (an autoregressive process of first order). A camera's mount has a
 * constant error. Each error has independent normal components along the three axes.
 *
 * Light falls off with the squared distance from the image's middle; a camera's electronics bend the display-referred
 * value by a power. The lens has the radial term k1 of OpenCV's model, or is OpenCV's fisheye, whose circle is as wide
 * as the picture; both are inverted by Newton's iteration. */
#include "synth/faults.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/rng.h"
#include "base/text.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum { STREAM_DELAY = 1 << 29, STREAM_MOUNT, STREAM_EGO = STREAM_MOUNT + 3, AXES = 3 };
static const double correlation_seconds = 0.5, radians = 0.017453292519943295;
static const double fisheye_terms[2] = {-0.02, 0.0015}; /* k1 and k2 of the fisheye */

/* ---- Names and ranges ---- */

static const struct fault {
  const char *name;
  size_t offset;
  double least, most;
  int read_out; /* the direction that the name says; -1: none */
} faults[] = {{"rolling-down", offsetof(pags_street_faults, rolling), 0, 0.2, PAGS_READ_DOWN},
              {"rolling-up", offsetof(pags_street_faults, rolling), 0, 0.2, PAGS_READ_UP},
              {"rolling-right", offsetof(pags_street_faults, rolling), 0, 0.2, PAGS_READ_RIGHT},
              {"rolling-left", offsetof(pags_street_faults, rolling), 0, 0.2, PAGS_READ_LEFT},
              {"delay", offsetof(pags_street_faults, delay), 0, 0.2, -1},
              {"position", offsetof(pags_street_faults, position), 0, 2, -1},
              {"angle", offsetof(pags_street_faults, angle), 0, 10, -1},
              {"mount-position", offsetof(pags_street_faults, mount_position), 0, 2, -1},
              {"mount-angle", offsetof(pags_street_faults, mount_angle), 0, 10, -1},
              {"vignette", offsetof(pags_street_faults, vignette), 0, 0.9, -1},
              {"response", offsetof(pags_street_faults, response), 0, 0.5, -1},
              {"distortion", offsetof(pags_street_faults, distortion), -0.3, 0.3, -1},
              {"fisheye", offsetof(pags_street_faults, fisheye), 60, 240, -1}};
enum { FAULTS = sizeof faults / sizeof faults[0] };

static double value_of(const pags_street_faults *f, const struct fault *fault) {
  double value;
  memcpy(&value, (const char *)f + fault->offset, sizeof value);
  return value;
}

/* Whether this name is the one that says a fault that is set: of four names for the read-out, one does. */
static bool is_set(const pags_street_faults *f, const struct fault *fault) {
  return value_of(f, fault) != 0.0 && (fault->read_out < 0 || fault->read_out == (int)f->read_out);
}

static pags_result check(const struct fault *fault, double value) {
  if (value >= fault->least && value <= fault->most)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "fault %s is %.12g, expected %.12g..%.12g", fault->name, value, fault->least,
                   fault->most);
}

pags_result pags_street_faults_set(pags_street_faults *out, const char *text) {
  const char *equals = strchr(text, '=');
  char names[256], *end;
  size_t used = 0;
  const struct fault *found = NULL;
  for (int i = 0; i < FAULTS; i++) {
    used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", i ? ", " : "", faults[i].name);
    if (equals && pags_text_is(text, (size_t)(equals - text), faults[i].name))
      found = &faults[i];
  }
  if (!found)
    return pags_fail(PAGS_ERROR_ARGUMENT, "fault '%s': expected NAME=VALUE with one of the names %s", text, names);
  const double value = strtod(equals + 1, &end);
  if (end == equals + 1 || *end)
    return pags_fail(PAGS_ERROR_ARGUMENT, "fault '%s': expected a number after '='", text);
  PAGS_TRY(check(found, value));
  memcpy((char *)out + found->offset, &value, sizeof value);
  if (found->read_out >= 0)
    out->read_out = (pags_read_out)found->read_out;
  return PAGS_OK;
}

pags_result pags_faults_check(const pags_street_faults *f) {
  for (int i = 0; i < FAULTS; i++)
    if (is_set(f, &faults[i]) || isnan(value_of(f, &faults[i])))
      PAGS_TRY(check(&faults[i], value_of(f, &faults[i])));
  if (f->fisheye > 0.0 && f->distortion != 0.0)
    return pags_fail(PAGS_ERROR_ARGUMENT, "fault fisheye: expected no distortion with it, found %g", f->distortion);
  return PAGS_OK;
}

void pags_faults_to_json(pags_json_writer *writer, const pags_street_faults *f) {
  pags_json_begin_object(writer, "faults");
  for (int i = 0; i < FAULTS; i++)
    if (is_set(f, &faults[i]))
      pags_json_put_number(writer, faults[i].name, value_of(f, &faults[i]));
  pags_json_end_object(writer);
}

/* ---- Times ---- */

bool pags_faults_reads_rows(const pags_street_options *o) {
  return o->faults.read_out == PAGS_READ_DOWN || o->faults.read_out == PAGS_READ_UP;
}

int pags_faults_lines(const pags_street_options *o) {
  return o->faults.rolling == 0.0 ? 1 : pags_faults_reads_rows(o) ? o->height : o->width;
}

pags_camera pags_faults_camera(const pags_street_options *o, int frame, int camera, int line) {
  const int lines = pags_faults_lines(o);
  double normal[2], share = line < 0 ? 0.0 : (line + 0.5) / lines - 0.5; /* of the read-out, from its middle */
  if (o->faults.read_out == PAGS_READ_UP || o->faults.read_out == PAGS_READ_LEFT)
    share = -share;
  pags_rng_normal2(o->seed, STREAM_DELAY, (uint64_t)camera, normal);
  const double time = frame / o->fps + o->faults.delay * normal[0] + share * o->faults.rolling;
  pags_camera out = pags_street_camera(o, time, camera, 0.0, 0.0);
  if (o->faults.fisheye > 0.0) {
    const double edge = 0.5 * radians * o->faults.fisheye, square = edge * edge;
    out.fx = out.fy = 0.5 * o->width / (edge * (1.0 + square * (fisheye_terms[0] + square * fisheye_terms[1])));
    out.lens = (pags_lens_model){
        .kind = PAGS_LENS_FISHEYE, .k = {fisheye_terms[0], fisheye_terms[1]}, .field = o->faults.fisheye};
  }
  return out;
}

/* ---- Poses ---- */

/* Three independent normal numbers. */
static void normal3(uint64_t seed, uint64_t stream, uint64_t index, double out[3]) {
  double two[2], more[2];
  pags_rng_normal2(seed, stream, 2 * index, two);
  pags_rng_normal2(seed, stream, 2 * index + 1, more);
  out[0] = two[0];
  out[1] = two[1];
  out[2] = more[0];
}

/* Multiplies `pose` from the right by a small motion: `turn` and `move` are normal numbers, scaled so that the root
 * mean square of the angle is `degrees` and that of the distance `metres`. */
static void disturb(double pose[12], const double turn[3], const double move[3], double degrees, double metres) {
  const double each = 1.0 / sqrt(3.0);
  double angles[3], place[3], motion[12];
  pags_scale3(each * degrees * radians, turn, angles);
  pags_scale3(each * metres, move, place);
  pags_rigid_from_angles(angles, place, motion);
  pags_rigid_multiply(pose, motion, pose);
}

void pags_faults_ego(const pags_street_options *o, int frame, double pose[12]) {
  pags_street_ego(o, frame / o->fps, pose);
  if (o->faults.position == 0.0 && o->faults.angle == 0.0)
    return;
  const double kept = pags_exp(-1.0 / (o->fps * correlation_seconds)), fresh = sqrt(1.0 - kept * kept);
  double error[2][3] = {{0}}, own[3];
  for (int kind = 0; kind < 2; kind++) {
    const uint64_t stream = STREAM_EGO + 2 * (uint64_t)kind;
    for (int f = 0; f <= frame; f++) { /* the slow error */
      normal3(o->seed, stream, (uint64_t)f, own);
      for (int k = 0; k < AXES; k++)
        error[kind][k] = f == 0 ? own[k] : kept * error[kind][k] + fresh * own[k];
    }
    normal3(o->seed, stream + 1, (uint64_t)frame, own);
    for (int k = 0; k < AXES; k++)
      error[kind][k] = (error[kind][k] + own[k]) / sqrt(2.0);
  }
  disturb(pose, error[0], error[1], o->faults.angle, o->faults.position);
}

void pags_faults_mount(const pags_street_options *o, int camera, double pose[12]) {
  double turn[3], move[3];
  pags_street_mount(camera, pose);
  if (o->faults.mount_position == 0.0 && o->faults.mount_angle == 0.0)
    return;
  normal3(o->seed, STREAM_MOUNT, (uint64_t)camera, turn);
  normal3(o->seed, STREAM_MOUNT + 1, (uint64_t)camera, move);
  disturb(pose, turn, move, o->faults.mount_angle, o->faults.mount_position);
}

/* ---- Light and lens ---- */

float pags_faults_vignette(const pags_street_options *o, double x, double y) {
  const double cx = 0.5 * o->width, cy = 0.5 * o->height;
  return (float)(1.0 - o->faults.vignette * ((x - cx) * (x - cx) + (y - cy) * (y - cy)) / (cx * cx + cy * cy));
}

float pags_faults_response(const pags_street_options *o, int camera) {
  static const double sides[3] = {0.0, 1.0, -1.0};
  return (float)(1.0 + o->faults.response * sides[camera]);
}

/* Solves theta (1 + k1 theta^2 + k2 theta^4) = |(u, v)|; the direction has the length 1. */
static bool fisheye_ray(const pags_street_options *o, double u, double v, double direction[3]) {
  const double bent = sqrt(u * u + v * v), k1 = fisheye_terms[0], k2 = fisheye_terms[1];
  double theta = bent;
  for (int i = 0; i < 30; i++) {
    const double t = theta * theta;
    theta -= (theta * (1.0 + t * (k1 + t * k2)) - bent) / (1.0 + t * (3.0 * k1 + t * 5.0 * k2));
  }
  const double across = bent > 0.0 ? pags_sin(theta) / bent : 1.0;
  direction[0] = across * u;
  direction[1] = across * v;
  direction[2] = pags_cos(theta);
  return theta <= 0.5 * radians * o->faults.fisheye;
}

bool pags_faults_ray(const pags_street_options *o, const pags_camera *camera, double x, double y, double direction[3]) {
  double u = (x - camera->cx) / camera->fx, v = (y - camera->cy) / camera->fy;
  const double bent = sqrt(u * u + v * v);
  if (o->faults.fisheye > 0.0)
    return fisheye_ray(o, u, v, direction);
  direction[2] = 1.0;
  if (o->faults.distortion != 0.0 && bent > 0.0) {
    double r = bent; /* solves r (1 + k1 r^2) = bent */
    for (int i = 0; i < 30; i++)
      r -= (r * (1.0 + o->faults.distortion * r * r) - bent) / (1.0 + 3.0 * o->faults.distortion * r * r);
    u *= r / bent;
    v *= r / bent;
  }
  direction[0] = u;
  direction[1] = v;
  return true;
}
