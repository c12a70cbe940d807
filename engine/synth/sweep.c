/* SPDX-License-Identifier: Apache-2.0 */
/* Simulates a spinning LiDAR: 32 beams one above another, from 22 degrees below the horizon to 8 above, densest at 3
 * degrees below. All rays of a sweep leave at the frame's time. */
#include <math.h>
#include <string.h>

#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/view.h"

enum { BEAMS = 32, STREAM_RANGE = 1 << 20 };
#define TWO_PI 6.283185307179586
#define REACH 80.0 /* metres */

typedef struct sweep_job {
  const pags_street *street;
  const pags_stage *stage;
  int frame;
  int64_t columns;
  double ego[12];
  float *points; /* 4 floats for each ray, as pags_sweep_trace gives them; intensity -1: no return */
} sweep_job;

static const double sensor[3] = {1.1, 0.0, 1.95}; /* position in the ego frame, metres */

static void set_point(const sweep_job *job, int64_t ray, const double direction[3], const pags_touch *touch) {
  float *out = job->points + 4 * ray;
  out[3] = -1.0f;
  if (!touch || (double)touch->distance > REACH)
    return;
  double noise[2];
  pags_rng_normal2(job->street->options->seed, STREAM_RANGE + (uint64_t)job->frame, (uint64_t)ray, noise);
  const double range = fmax((double)touch->distance + job->street->options->lidar_noise * noise[0], 0.1);
  const pags_material *material = &job->street->materials.list[touch->material];
  double at[3], way[3], flat[3];
  pags_along3(sensor, range, direction, at);
  pags_narrow3(at, out);
  pags_rotate3(job->ego, direction, way);
  pags_widen3(touch->flat, flat);
  const double grey = (double)(material->color[0] + material->color[1] + material->color[2]) / 3.0;
  out[3] = (float)(grey * fabs(pags_dot3(flat, way)));
}

static void trace_rays(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sweep_job *job = context;
  const int64_t most = job->columns * BEAMS;
  for (int64_t first = begin * PAGS_PACKET; first < end * PAGS_PACKET && first < most; first += PAGS_PACKET) {
    double directions[PAGS_PACKET][3];
    pags_touch touches[PAGS_PACKET];
    pags_rays rays = {0};
    for (int i = 0; i < PAGS_PACKET && first + i < most; i++) {
      /* Unit direction in the ego frame. Each sweep's azimuths are shifted by 0.618 of a column against the last
       * one's, so that successive sweeps fill each other's gaps. */
      int64_t ray = first + i;
      const int beam = (int)(ray % BEAMS);
      const double share = (beam + 0.5) / BEAMS * 2.0 - 1.0,
                   degrees = -3.0 + (share > 0.0 ? 11.0 : 19.0) * share * fabs(share);
      const double turn = ((double)(ray / BEAMS) + fmod(job->frame * 0.6180339887498949, 1.0)) / (double)job->columns;
      const double high = degrees * TWO_PI / 360.0, around = TWO_PI * turn;
      directions[i][0] = pags_cos(high) * pags_cos(around);
      directions[i][1] = -pags_cos(high) * pags_sin(around);
      directions[i][2] = pags_sin(high);

      double origin[3], direction[3];
      pags_rigid_point(job->ego, sensor, origin);
      pags_rotate3(job->ego, directions[i], direction);
      pags_narrow3(origin, rays.origin[i]);
      pags_narrow3(direction, rays.direction[i]);
      rays.active |= 1u << i;
    }
    const unsigned met = pags_stage_trace(job->stage, &rays, touches);
    for (int i = 0; i < PAGS_PACKET && first + i < most; i++)
      set_point(job, first + i, directions[i], met >> i & 1u ? &touches[i] : NULL);
  }
}

int64_t pags_sweep_trace(const pags_street *street, const pags_stage *stage, int frame, pags_tasks *tasks,
                         float *points) {
  sweep_job job = {.street = street, .stage = stage, .frame = frame, .points = points};
  int64_t count = 0;
  job.columns = street->options->lidar_points / BEAMS;
  pags_street_ego(street->options, frame / street->options->fps, job.ego);
  const int64_t rays = job.columns * BEAMS;
  for (int64_t i = 0; i < rays; i++)
    points[4 * i + 3] = -1.0f; /* for rays that a cancelled loop leaves out */
  pags_parallel_for(tasks, (rays + PAGS_PACKET - 1) / PAGS_PACKET, 64, trace_rays, &job);
  for (int64_t i = 0; i < rays; i++)
    if (points[4 * i + 3] >= 0.0f)
      memmove(points + 4 * count++, points + 4 * i, 4 * sizeof *points);
  return count;
}
