/* SPDX-License-Identifier: Apache-2.0 */
/* Projects the sweep of a view's time step into its camera, removes hidden points with a z-buffer and picks
 * samples. */
#include "train/driving_losses.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "init/z_buffer.h"

static int64_t find_sweep(const pags_dataset *dataset, int frame) {
  for (int64_t i = 0; frame >= 0 && i < pags_dataset_sweep_count(dataset); i++)
    if (pags_dataset_sweep(dataset, i)->frame == frame)
      return i;
  return -1;
}

static void project(const pags_camera *camera, const double camera_from_sweep[12], const float *xyz, int64_t count,
                    pags_seen_point *out) {
  for (int64_t i = 0; i < count; i++) {
    double p[3], q[3] = {(double)xyz[3 * i], (double)xyz[3 * i + 1], (double)xyz[3 * i + 2]};
    for (int k = 0; k < 3; k++) {
      const double *m = camera_from_sweep + 4 * k;
      p[k] = m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + m[3];
    }
    out[i] = (pags_seen_point){0};
    if (pags_camera_bends(camera)) { /* whose depth is the distance */
      double at[2], away = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
      if (away > 0.1 && pags_camera_project(camera, p, at, NULL) && at[0] >= 0 && at[1] >= 0 && at[0] < camera->width &&
          at[1] < camera->height)
        out[i] = (pags_seen_point){(float)at[0], (float)at[1], (float)away};
      continue;
    }
    if (!(p[2] > 0.1))
      continue;
    pags_camera_see(camera, p, p); /* where the photograph shows it, whether or not training knows of the shutter */
    double u = camera->fx * p[0] / p[2] + camera->cx, v = camera->fy * p[1] / p[2] + camera->cy;
    if (u >= 0 && v >= 0 && u < camera->width && v < camera->height)
      out[i] = (pags_seen_point){(float)u, (float)v, (float)p[2]};
  }
}

/* Moves the points that the camera sees to the front of the list; `count` becomes their number. */
static pags_result keep_visible(const pags_camera *camera, pags_seen_point *points, int64_t *count) {
  pags_z_buffer z_buffer = {0};
  int64_t kept = 0;
  PAGS_TRY(pags_z_buffer_reset(&z_buffer, camera->width, camera->height, camera->fx));
  pags_z_buffer_add(&z_buffer, points, *count);
  for (int64_t i = 0; i < *count; i++)
    if (points[i].z > 0 && pags_z_buffer_visible(&z_buffer, &points[i]))
      points[kept++] = points[i];
  *count = kept;
  pags_z_buffer_destroy(&z_buffer);
  return PAGS_OK;
}

static pags_result choose(const pags_seen_point *points, int64_t visible, int64_t most, int64_t *count,
                          pags_lidar_depth_sample **samples) {
  int64_t taken = visible < most ? visible : most;
  if (taken <= 0)
    return PAGS_OK;
  *samples = malloc((size_t)taken * sizeof **samples);
  if (!*samples)
    return pags_out_of_memory("%lld depths", (long long)taken);
  for (int64_t i = 0; i < taken; i++) {
    const pags_seen_point *p = &points[(int64_t)((double)i * (double)visible / (double)taken)];
    (*samples)[i] = (pags_lidar_depth_sample){p->u, p->v, p->z};
  }
  *count = taken;
  return PAGS_OK;
}

pags_result pags_lidar_depth_samples(const pags_dataset *dataset, int64_t view, int64_t most, int64_t *count,
                                     pags_lidar_depth_sample **samples) {
  const pags_view *v = pags_dataset_view(dataset, view);
  int64_t sweep = find_sweep(dataset, v->frame), points = 0;
  float *xyz = NULL;
  *count = 0;
  *samples = NULL;
  if (sweep < 0)
    return PAGS_OK;
  PAGS_TRY(pags_dataset_sweep_load(dataset, sweep, &points, &xyz));
  pags_seen_point *seen = malloc((size_t)(points > 0 ? points : 1) * sizeof *seen);
  pags_result result = seen ? PAGS_OK : pags_out_of_memory("%lld points", (long long)points);
  if (result == PAGS_OK) {
    double inverse[12], camera_from_sweep[12];
    pags_rigid_inverse(v->camera.world_from_camera, inverse);
    pags_rigid_multiply(inverse, pags_dataset_sweep(dataset, sweep)->world_from_sweep, camera_from_sweep);
    project(&v->camera, camera_from_sweep, xyz, points, seen);
    result = keep_visible(&v->camera, seen, &points);
  }
  if (result == PAGS_OK)
    result = choose(seen, points, most, count, samples);
  free(seen);
  free(xyz);
  return result;
}
