/* SPDX-License-Identifier: Apache-2.0 */
/* Lambertian shading: reflectance times (sun, where nothing stands before it, + sky dome). The dome lights a surface
 * of unit normal n by (1 + n_z) / 2, the share of the dome it sees without obstacles. */
#include "synth/render.h"

#include <math.h>

enum { SHADOW_GAP_MICROMETRES = 200 };

void pags_camera_ray(const pags_camera *camera, double x, double y, float direction[3]) {
  const double u = (x - camera->cx) / camera->fx, v = (y - camera->cy) / camera->fy;
  const double *m = camera->world_from_camera;
  for (int k = 0; k < 3; k++)
    direction[k] = (float)(m[4 * k] * u + m[4 * k + 1] * v + m[4 * k + 2]);
}

static void shade(const pags_tracer *tracer, const pags_room *room, const pags_hit *hit, uint64_t seed,
                  float color[3]) {
  const float *n = hit->normal;
  float start[3], facing = n[0] * room->sun[0] + n[1] * room->sun[1] + n[2] * room->sun[2];
  for (int k = 0; k < 3; k++)
    start[k] = hit->point[k] + n[k] * (SHADOW_GAP_MICROMETRES * 1e-6f);
  if (facing < 0.0f || pags_tracer_blocked(tracer, start, room->sun))
    facing = 0.0f;
  pags_texture_at(hit->texture, hit->local, seed, color);
  for (int c = 0; c < 3; c++)
    color[c] *= room->sun_light[c] * facing + room->sky_light[c] * (0.5f + 0.5f * n[2]);
}

float pags_render_ray(const pags_tracer *tracer, const pags_room *room, const float origin[3], const float direction[3],
                      uint64_t seed, float color[3]) {
  pags_hit hit;
  if (pags_tracer_hit(tracer, origin, direction, &hit)) {
    shade(tracer, room, &hit, seed, color);
    return hit.distance;
  }
  for (int c = 0; c < 3; c++)
    color[c] = room->sky_light[c];
  return 0.0f;
}

uint8_t pags_encode_srgb(float linear) {
  const float v = linear <= 0.0f ? 0.0f : linear >= 1.0f ? 1.0f : linear;
  const float s = v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1.0f / 2.4f) - 0.055f;
  return (uint8_t)(s * 255.0f + 0.5f);
}

typedef struct view_job {
  const pags_tracer *tracer;
  const pags_room *room;
  const pags_camera *camera;
  int samples;
  uint64_t seed;
  uint8_t *pixels;
  float *depth;
  float origin[3];
} view_job;

/* Positions in the pixel: Roberts' R2 sequence, which fills the square evenly for any number of samples. */
static void render_pixel(const view_job *job, int x, int y, uint8_t out[3]) {
  float sum[3] = {0}, direction[3], color[3];
  for (int s = 0; s < job->samples; s++) {
    const double dx = fmod(0.5 + s * 0.7548776662466927, 1.0), dy = fmod(0.5 + s * 0.5698402909980532, 1.0);
    pags_camera_ray(job->camera, x + dx, y + dy, direction);
    pags_render_ray(job->tracer, job->room, job->origin, direction, job->seed, color);
    for (int c = 0; c < 3; c++)
      sum[c] += color[c];
  }
  for (int c = 0; c < 3; c++)
    out[c] = pags_encode_srgb(sum[c] / (float)job->samples);
}

static void render_rows(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const view_job *job = context;
  const int width = job->camera->width;
  float direction[3];
  pags_hit hit;
  for (int y = (int)begin; y < (int)end; y++)
    for (int x = 0; x < width; x++) {
      const int64_t at = (int64_t)y * width + x;
      render_pixel(job, x, y, job->pixels + 3 * at);
      if (!job->depth)
        continue;
      pags_camera_ray(job->camera, x + 0.5, y + 0.5, direction);
      job->depth[at] = pags_tracer_hit(job->tracer, job->origin, direction, &hit) ? hit.distance : 0.0f;
    }
}

pags_result pags_render_view(const pags_tracer *tracer, const pags_room *room, const pags_camera *camera, int samples,
                             uint64_t seed, pags_tasks *tasks, pags_image *image, float *depth) {
  view_job job = {.tracer = tracer,
                  .room = room,
                  .camera = camera,
                  .samples = samples,
                  .seed = seed,
                  .pixels = image->data,
                  .depth = depth};
  for (int k = 0; k < 3; k++)
    job.origin[k] = (float)camera->world_from_camera[4 * k + 3];
  return pags_parallel_for(tasks, camera->height, 4, render_rows, &job) ? PAGS_OK
                                                                        : pags_fail(PAGS_CANCELLED, "cancelled");
}
