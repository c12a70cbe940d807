/* SPDX-License-Identifier: Apache-2.0 */
/* Point i: what a random position of a random view's picture shows. Rays that meet the sky are drawn again. */
#include "synth/points.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/rng.h"
#include "synth/render.h"

enum { VERTEX_BYTES = 15, TRIES = 64 };

static void put_float(uint8_t *out, float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  for (int i = 0; i < 4; i++)
    out[i] = (uint8_t)(bits >> (8 * i));
}

/* Leaves zeros, the middle of the floor, if every try meets the sky. */
static void make_point(const pags_tracer *tracer, const pags_room *room, const pags_synth_options *o, int64_t index,
                       uint8_t out[VERTEX_BYTES]) {
  memset(out, 0, VERTEX_BYTES);
  for (uint64_t t = 0; t < TRIES; t++) {
    const int view = (int)pags_rng_below(o->seed, 2 * t, (uint64_t)index, (uint64_t)o->views);
    double at[2];
    float origin[3], direction[3], color[3];
    pags_rng_uniform2(o->seed, 2 * t + 1, (uint64_t)index, at);
    const pags_camera camera = pags_room_camera(view, o->views, o->width, o->height);
    pags_camera_ray(&camera, at[0] * o->width, at[1] * o->height, direction);
    for (int k = 0; k < 3; k++)
      origin[k] = (float)camera.world_from_camera[4 * k + 3];
    const float depth = pags_render_ray(tracer, room, origin, direction, o->seed, color);
    if (depth <= 0.0f)
      continue;
    for (int k = 0; k < 3; k++) {
      put_float(out + 4 * k, origin[k] + depth * direction[k]);
      out[12 + k] = pags_encode_srgb(color[k]);
    }
    return;
  }
}

pags_result pags_points_write(const char *path, const pags_tracer *tracer, const pags_room *room,
                              const pags_synth_options *options) {
  char header[256];
  const int length = snprintf(header, sizeof header,
                              "ply\nformat binary_little_endian 1.0\nelement vertex %lld\nproperty float x\n"
                              "property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
                              "property uchar blue\nend_header\n",
                              (long long)options->points);
  const size_t size = (size_t)length + VERTEX_BYTES * (size_t)options->points;
  uint8_t *bytes = malloc(size);
  if (!bytes)
    return pags_out_of_memory("%s: %lld points", path, (long long)options->points);
  memcpy(bytes, header, (size_t)length);
  for (int64_t i = 0; i < options->points; i++)
    make_point(tracer, room, options, i, bytes + length + VERTEX_BYTES * i);
  const pags_result result = pags_file_write(path, bytes, size);
  free(bytes);
  return result;
}
