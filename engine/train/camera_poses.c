/* SPDX-License-Identifier: Apache-2.0 */
/* Fits corrections of the poses of cameras by Adam; see camera_poses.h.
 *
 * The pose of view i, of time step t and camera s, is
 *     T(p_t) exp(a_t) T(-p_t) P_i exp(b_s + d_s u_i)
 * with the recorded pose P_i and its speed u_i, the middle p_t of the cameras of the step, and the parts a_t, b_s, d_s.
 * Moving the camera by M changes a picture as moving the world by the inverse of M does. To first order a motion (w, v)
 * of the world about the origin changes the loss by G_w . w + G_v . v. Hence, with the camera's rotation R and position
 * c, the gradient by a_t is (-G_w - G_v x p_t, -G_v), that by b_s is R^T (-G_w - G_v x c, -G_v), and that by d_s is the
 * latter times u_i. The sky, which doesn't move with the Gaussians, adds nothing to G. */
#include "train/camera_poses.h"

#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

/* The learning rates at the schedule's end as a share of the first; they fall log-linearly. */
static const double final_share = 0.1;
/* Visits of a time step, or of a camera, in a run that need no correction of the rates. */
static const double reference_visits = 100.0;
/* The extent of a scene for which camera_translation_rate is meant, metres. */
static const double reference_extent = 10.0;
/* Photographs of a camera to either side over which its speed is the mean: the error of their poses matters less. */
enum { SPEED_SPAN = 2 };

/* ---- The corrections ---- */

int64_t pags_camera_poses_items(const pags_camera_poses *p) {
  return p->count > 0 ? p->steps + 2 * p->sensors : 0;
}

/* Numbers the time steps and the cameras of all views, these in the order in which they appear. */
static void number_items(pags_camera_poses *p, const pags_dataset *dataset) {
  int frame = 0;
  for (int64_t i = 0; i < p->count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    p->steps += i == 0 || p->alone || view->frame != frame; /* views are sorted by frame */
    frame = view->frame;
    p->step_of[i] = (int32_t)p->steps - 1;
    p->sensor_of[i] = (int32_t)p->sensors;
    for (int64_t j = 0; j < i && p->sensor_of[i] == p->sensors; j++)
      if (pags_dataset_view(dataset, j)->sensor == view->sensor)
        p->sensor_of[i] = p->sensor_of[j];
    p->sensors += p->sensor_of[i] == p->sensors;
  }
}

pags_result pags_camera_poses_create(pags_camera_poses *p, const pags_dataset *dataset) {
  const int64_t count = pags_dataset_view_count(dataset);
  *p = (pags_camera_poses){.holdout = pags_holdout_test_begin(),
                           .count = count,
                           .alone = pags_dataset_fps(dataset) <= 0.0,
                           .step_of = calloc((size_t)count, sizeof *p->step_of),
                           .sensor_of = calloc((size_t)count, sizeof *p->sensor_of)};
  if (p->step_of && p->sensor_of) {
    number_items(p, dataset);
    p->items = calloc((size_t)pags_camera_poses_items(p), sizeof *p->items);
    p->speeds = calloc((size_t)count, sizeof *p->speeds);
    p->places = calloc((size_t)p->steps, sizeof *p->places);
    p->turns = calloc((size_t)p->sensors, sizeof *p->turns);
  }
  PAGS_CHECK_MEMORY(p->items && p->speeds && p->places && p->turns, "the poses of %lld cameras", (long long)count);
  for (int64_t i = count; i-- > 0;) {
    /* Views of the same time step, and the camera's views some time steps before and after, between which its mean
     * speed counts. */
    const double *const m = pags_dataset_view(dataset, i)->camera.world_from_camera;
    int64_t alike = 0, before = i, after = i;
    for (int64_t j = 0; j < count; j++) {
      const int32_t away = p->step_of[j] - p->step_of[i];
      alike += away == 0;
      if (p->sensor_of[j] != p->sensor_of[i] || away < -SPEED_SPAN || away > SPEED_SPAN)
        continue;
      before = j < before ? j : before;
      after = j > after ? j : after;
    }
    for (int k = 0; k < 3; k++) {
      p->places[p->step_of[i]][k] += (m[4 * k + 3] - pags_dataset_origin(dataset)[k]) / (double)alike;
      pags_copy3(m + 4 * k, p->turns[p->sensor_of[i]] + 3 * k);
    }
    const pags_camera *a = &pags_dataset_view(dataset, before)->camera, *b = &pags_dataset_view(dataset, after)->camera;
    if (b->time > a->time)
      pags_rigid_velocity(a->world_from_camera, m, b->world_from_camera, b->time - a->time, p->speeds[i]);
  }
  return PAGS_OK;
}

void pags_camera_poses_destroy(pags_camera_poses *p) {
  free(p->items);
  free(p->step_of);
  free(p->sensor_of);
  free(p->speeds);
  free(p->places);
  free(p->turns);
  *p = (pags_camera_poses){.holdout = p->holdout};
}

/* Time of a time step: that of its first view. */
static double time_of(const pags_camera_poses *p, const pags_dataset *dataset, int64_t step) {
  int64_t i = 0;
  while (p->step_of[i] != step)
    i++;
  return pags_dataset_view(dataset, i)->camera.time;
}

/* The correction of a time step; of one without gradients yet, linear in time between the next ones that have
 * some, or in a capture none. */
static void step_value(const pags_camera_poses *p, const pags_dataset *dataset, int64_t step, double out[6]) {
  int64_t before = step, after = step;
  while (!p->alone && before >= 0 && p->items[before].moments.count == 0)
    before--;
  while (!p->alone && after < p->steps && p->items[after].moments.count == 0)
    after++;
  before = before < 0 ? after : before;
  after = after >= p->steps ? before : after;
  memset(out, 0, 6 * sizeof *out);
  if (before < 0 || before >= p->steps)
    return;
  const double begin = time_of(p, dataset, before), end = time_of(p, dataset, after);
  const double u = after > before ? (time_of(p, dataset, step) - begin) / (end - begin) : 0.0;
  for (int k = 0; k < 6; k++)
    out[k] = (1.0 - u) * p->items[before].value[k] + u * p->items[after].value[k];
}

pags_camera pags_camera_poses_view(const pags_camera_poses *p, const pags_dataset *dataset, int64_t view) {
  pags_camera camera = pags_dataset_view(dataset, view)->camera;
  if (p->count == 0)
    return camera;
  double motion[12], value[6], own[6], place[3], *m = camera.world_from_camera;
  const pags_camera_part *part = &p->items[p->steps + p->sensor_of[view]];
  for (int k = 0; k < 6; k++)
    own[k] = part->value[k] + part[p->sensors].value[0] * p->speeds[view][k];
  pags_increment_matrix(own, own + 3, motion);
  pags_rigid_multiply(m, motion, m);
  step_value(p, dataset, p->step_of[view], value);
  pags_increment_matrix(value, value + 3, motion);
  pags_add3(pags_dataset_origin(dataset), p->places[p->step_of[view]], place);
  pags_pose_subtract(m, place);
  pags_rigid_multiply(motion, m, m);
  for (int k = 0; k < 3; k++)
    m[4 * k + 3] += place[k];
  return camera;
}

void pags_camera_poses_correction(const pags_view *view, const pags_camera *corrected, double out[6]) {
  double inverse[12], motion[12];
  pags_rigid_inverse(view->camera.world_from_camera, inverse);
  pags_rigid_multiply(inverse, corrected->world_from_camera, motion);
  pags_increment_rotation(motion, out);
  pags_pose_position(motion, out + 3);
}

/* ---- Training ---- */

/* Sets the mean of the time steps' corrections that photographs have moved, and that of all cameras' in the world's
 * axes, and of their delays to zero. */
static void hold_means(pags_camera_poses *p) {
  pags_camera_part *const of_cameras = p->items + p->steps, *const delays = of_cameras + p->sensors;
  const double sensors = (double)p->sensors;
  double mean[6] = {0.0}, moved = 0.0, world[6] = {0.0}, delay = 0.0;
  for (int64_t i = 0; i < p->steps; i++) {
    moved += p->items[i].moments.count > 0;
    for (int k = 0; k < 6 && p->items[i].moments.count > 0; k++)
      mean[k] += p->items[i].value[k];
  }
  for (int64_t i = 0; i < p->steps; i++)
    for (int k = 0; k < 6 && p->items[i].moments.count > 0; k++)
      p->items[i].value[k] -= mean[k] / moved;
  for (int64_t s = 0; s < p->sensors; s++) {
    delay += delays[s].value[0] / sensors;
    for (int k = 0; k < 6; k++)
      world[k] += pags_dot3(p->turns[s] + 3 * (k % 3), of_cameras[s].value + k / 3 * 3);
  }
  for (int64_t s = 0; s < p->sensors; s++) {
    delays[s].value[0] -= delay;
    for (int k = 0; k < 6; k++) {
      const double *turn = p->turns[s] + k % 3; /* a column */
      of_cameras[s].value[k] -=
          (turn[0] * world[k / 3 * 3] + turn[3] * world[k / 3 * 3 + 1] + turn[6] * world[k / 3 * 3 + 2]) / sensors;
    }
  }
}

void pags_camera_gradient(const double m[12], const double origin[3], const double by_world[6], double out[6]) {
  const double at[3] = {m[3] - origin[0], m[7] - origin[1], m[11] - origin[2]}, *const push = by_world + 3;
  double about[3];
  pags_cross3(push, at, about);
  for (int k = 0; k < 3; k++)
    about[k] += by_world[k];
  for (int k = 0; k < 3; k++) {
    out[k] = -(m[k] * about[0] + m[4 + k] * about[1] + m[8 + k] * about[2]);
    out[3 + k] = -(m[k] * push[0] + m[4 + k] * push[1] + m[8 + k] * push[2]);
  }
}

void pags_camera_poses_gradient(const pags_camera_poses *p, const pags_dataset *dataset, int64_t view,
                                const double by_world[6], double by_step[6], double by_sensor[6], double *by_delay) {
  const pags_camera camera = pags_camera_poses_view(p, dataset, view);
  const double *push = by_world + 3;
  double about_place[3];
  pags_cross3(push, p->places[p->step_of[view]], about_place);
  for (int k = 0; k < 3; k++) {
    by_step[k] = -(by_world[k] + about_place[k]);
    by_step[3 + k] = -push[k];
  }
  pags_camera_gradient(camera.world_from_camera, pags_dataset_origin(dataset), by_world, by_sensor);
  *by_delay = pags_dot3(by_sensor, p->speeds[view]) + pags_dot3(by_sensor + 3, p->speeds[view] + 3);
}

bool pags_camera_poses_update(pags_camera_poses *p, const pags_dataset *dataset, int64_t view, const double by_world[6],
                              const pags_schedule *schedule, int64_t step) {
  const pags_train_config *c = &schedule->config;
  double by_step[6], by_sensor[6], by_delay[6] = {0.0}, direction[3][6], begun[6];
  pags_camera_poses_gradient(p, dataset, view, by_world, by_step, by_sensor, by_delay);

  /* A step that is visited for the first time starts from the interpolation of its neighbours. */
  pags_camera_part *rig = &p->items[p->step_of[view]], *own = &p->items[p->steps + p->sensor_of[view]];
  step_value(p, dataset, p->step_of[view], begun);
  if (!pags_adam6_step(&rig->moments, by_step, c, direction[0]) ||
      !pags_adam6_step(&own->moments, by_sensor, c, direction[1]) ||
      !pags_adam6_step(&own[p->sensors].moments, by_delay, c, direction[2]))
    return false;
  memcpy(rig->value, begun, sizeof begun);
  const double t = fmin((double)step / (double)schedule->length, 1.0),
               photographs = (double)(schedule->length * schedule->batch);
  const double fall = pags_pow(final_share, t);
  /* Lengths of a capture are in units of its own. */
  const double push = c->cameras.camera_translation_rate * (p->alone ? schedule->extent / reference_extent : 1.0);
  const double rigs = fmin(reference_visits * (double)p->steps / photographs, 4.0),
               owns = fmin(reference_visits * (double)p->sensors / photographs, 4.0);
  for (int k = 0; k < 6; k++) {
    const double rate = fall * (k < 3 ? c->cameras.camera_rotation_rate : push);
    rig->value[k] -= rate * rigs * direction[0][k];
    own->value[k] -= p->sensors > 1 ? rate * owns * direction[1][k] : 0.0;
  }
  own[p->sensors].value[0] -= p->sensors > 1 ? fall * owns * c->cameras.camera_delay_rate * direction[2][0] : 0.0;
  hold_means(p);
  return true;
}
