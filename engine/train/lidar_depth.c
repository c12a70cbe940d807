/* SPDX-License-Identifier: Apache-2.0 */
/* Projects the sweep of a view's time step into its camera, removes hidden points with a z-buffer and picks
 * samples. */
#include "train/driving_losses.h"

#include "base/memory.h"
#include "base/vec3.h"
#include "init/z_buffer.h"

/* The point as the camera sees it; depth 0 if it doesn't. */
static pags_seen_point project(const pags_camera *camera, const double camera_from_sweep[12], const float xyz[3]) {
  double p[3], q[3], at[2];
  pags_widen3(xyz, q);
  pags_rigid_point(camera_from_sweep, q, p);
  const bool bends = pags_camera_bends(camera); /* whose depth is the distance */
  if (!((bends ? pags_length3(p) : p[2]) > 0.1))
    return (pags_seen_point){0};
  pags_camera_see(camera, p, p); /* where the photograph shows it, whether or not training knows of the shutter */
  const double depth = bends ? pags_length3(p) : p[2];
  bool seen = true;
  if (bends)
    seen = pags_camera_project(camera, p, at, NULL);
  else
    at[0] = camera->fx * p[0] / depth + camera->cx, at[1] = camera->fy * p[1] / depth + camera->cy;
  if (!seen || !(at[0] >= 0 && at[1] >= 0 && at[0] < camera->width && at[1] < camera->height))
    return (pags_seen_point){0};
  return (pags_seen_point){(float)at[0], (float)at[1], (float)depth};
}

pags_result pags_lidar_depth_samples(const pags_dataset *dataset, int64_t view, int64_t most, int64_t *count,
                                     pags_lidar_depth_sample **samples) {
  const pags_view *v = pags_dataset_view(dataset, view);
  const pags_camera *camera = &v->camera;
  const int64_t sweeps = pags_dataset_sweep_count(dataset);
  int64_t sweep = 0, points = 0, visible = 0;
  *count = 0;
  *samples = NULL;
  while (sweep < sweeps && pags_dataset_sweep(dataset, sweep)->frame != v->frame)
    sweep++;
  if (sweep == sweeps || v->frame < 0)
    return PAGS_OK;
  PAGS_AUTOFREE float *xyz = NULL;
  PAGS_TRY(pags_dataset_sweep_load(dataset, sweep, &points, &xyz));
  PAGS_AUTOFREE pags_seen_point *seen = malloc((size_t)(points > 0 ? points : 1) * sizeof *seen);
  PAGS_CHECK_MEMORY(seen, "%lld points", (long long)points);
  double inverse[12], camera_from_sweep[12];
  pags_rigid_inverse(camera->world_from_camera, inverse);
  pags_rigid_multiply(inverse, pags_dataset_sweep(dataset, sweep)->world_from_sweep, camera_from_sweep);
  for (int64_t i = 0; i < points; i++)
    seen[i] = project(camera, camera_from_sweep, xyz + 3 * i);

  /* Move the visible points to the front of the list, and choose from them. */
  PAGS_AUTO(pags_z_buffer_destroy) pags_z_buffer z_buffer = {0};
  PAGS_TRY(pags_z_buffer_reset(&z_buffer, camera->width, camera->height, camera->fx));
  pags_z_buffer_add(&z_buffer, seen, points);
  for (int64_t i = 0; i < points; i++)
    if (seen[i].z > 0 && pags_z_buffer_visible(&z_buffer, &seen[i]))
      seen[visible++] = seen[i];
  const int64_t taken = visible < most ? visible : most;
  if (taken <= 0)
    return PAGS_OK;
  *samples = malloc((size_t)taken * sizeof **samples);
  PAGS_CHECK_MEMORY(*samples, "%lld depths", (long long)taken);
  for (int64_t i = 0; i < taken; i++) {
    const pags_seen_point *p = &seen[(int64_t)((double)i * (double)visible / (double)taken)];
    (*samples)[i] = (pags_lidar_depth_sample){p->u, p->v, p->z};
  }
  *count = taken;
  return PAGS_OK;
}
