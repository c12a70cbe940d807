/* SPDX-License-Identifier: Apache-2.0 */
/* Variable-rate shading: only tiles that show critical Gaussians are shaded at every pixel. First all tiles are
 * shaded at samples 4 pixels apart. Tiles in which a sample, or a neighbour of one, shows a critical Gaussian are
 * then rasterised at every pixel, to the same bits as in a frame without variable rate; the other tiles are
 * interpolated between their samples. Both use the same tile lists. The sky is blended at every pixel of either kind
 * of tile. */
#include <string.h>

#include "frame/lens_view.h"

enum { TILE_SAMPLES = PAGS_TILE / SAMPLE_SIDE }; /* along a tile's side */
#define SHOWS 0.125f /* a sample shows critical Gaussians if the sum of their weights is at least this */

/* Allocates a plane of samples, padded to whole tiles. */
static float *sample_plane(pags_frame *f, const frame_samples *s) {
  return pags_frame_alloc(f, (int64_t)s->stride * (f->rows / SAMPLE_SIDE), sizeof(float), "samples");
}

/* The two rows of samples a and b that a row of pixels lies between, and b's weight t in the linear interpolation.
 * Pixels beyond the outermost rows of samples take the outermost row. */
typedef struct between {
  int a, b;
  float t;
} between;

/* The rows of samples for pixel row y, of `height` rows of samples in all. */
static between between_at(int y, int height) {
  const float at = ((float)y + 0.5f) / SAMPLE_SIDE - 0.5f;
  const int a = at > 0.0f ? (int)at : 0, last = height - 1;
  return (between){a < last ? a : last, a + 1 < last ? a + 1 : last, at > 0.0f ? at - (float)(int)at : 0.0f};
}

/* Interpolates one row of 16 pixels of a tile bilinearly: the tile's samples, from sample `first` on, and one on
 * either side are interpolated vertically to the row, then between neighbouring samples. `size`: samples in a row of
 * the plane. */
static void interpolate_row(const float *plane, int64_t stride, int first, int size, between v, float *out) {
  /* Weights of the right one of two samples, for pixels x mod 4. A sample lies between pixels 1 and 2 of its
   * block. */
  static const float weight[SAMPLE_SIDE] = {0.625f, 0.875f, 0.125f, 0.375f};
  const float *const top = plane + (int64_t)v.a * stride, *const bottom = plane + (int64_t)v.b * stride;
  float row[TILE_SAMPLES + 2];
  for (int k = 0; k < TILE_SAMPLES + 2; k++) {
    const int x = first + k - 1, at = x < 0 ? 0 : x < size ? x : size - 1;
    row[k] = top[at] + (bottom[at] - top[at]) * v.t;
  }
  for (int x = 0; x < PAGS_TILE; x++) {
    const int k = (x + SAMPLE_SIDE / 2) / SAMPLE_SIDE;
    out[x] = row[k] + (row[k + 1] - row[k]) * weight[x % SAMPLE_SIDE];
  }
}

/* Sets depth, depth sum and id of a row of 16 pixels of a tile to those of the nearest sample, in whose 4 x 4 pixels
 * each pixel lies. */
static void take_nearest(const pags_frame *f, const frame_samples *s, int x0, int y) {
  int32_t *const ids = (int32_t *)(void *)frame_plane(f, PLANE_ID);
  for (int x = x0; x < x0 + PAGS_TILE; x++) {
    const int64_t from = (int64_t)(y / SAMPLE_SIDE) * s->stride + x / SAMPLE_SIDE, to = (int64_t)y * f->stride + x;
    frame_plane(f, PLANE_DEPTH)[to] = s->depth[from];
    frame_plane(f, PLANE_DEPTH_SUM)[to] = s->depth_sum[from];
    ids[to] = s->id[from];
  }
}

typedef struct enlarging {
  const pags_frame *frame;
  const frame_samples *samples;
} enlarging;

/* Block function: interpolates those of tiles [begin, end) that were not rasterised, and adds sky and exposure. */
static void enlarge_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const enlarging *const e = context;
  (void)worker;
  for (int64_t tile = begin; tile < end; tile++)
    if (!e->frame->wanted[tile]) {
      /* Interpolates colour and transmittance row by row; depth and ids are the nearest sample's. */
      const int x0 = frame_tile_x(e->frame, tile), y0 = frame_tile_y(e->frame, tile);
      const int64_t at = frame_tile_offset(e->frame, tile);
      const int first = x0 / SAMPLE_SIDE;
      for (int y = 0; y < PAGS_TILE; y++) {
        const between v = between_at(y0 + y, e->samples->height);
        const int64_t row = at + (int64_t)y * e->frame->stride;
        for (int k = 0; k < 3; k++)
          interpolate_row(e->samples->rgb[k], e->samples->stride, first, e->samples->width, v,
                          frame_plane(e->frame, PLANE_R + k) + row);
        interpolate_row(e->samples->transmittance, e->samples->stride, first, e->samples->width, v,
                        frame_plane(e->frame, PLANE_T) + row);
        if (e->frame->options.extra_channels)
          take_nearest(e->frame, e->samples, x0, y0 + y);
      }
      /* Less sky than 1/512 isn't visible: that is under half a grey level, if it isn't made brighter. */
      if (e->frame->has_sky && pags_frame_tile_shows(e->frame, tile, 1.0f / 512.0f / e->frame->enlargement)) {
        pags_sky_tile sky;
        pags_frame_find_sky(e->frame, tile, &sky);
        pags_frame_blend_sky(e->frame, tile, &sky);
      }
      if (e->frame->options.exposed)
        pags_frame_expose(e->frame, tile);
      if (e->frame->lens)
        pags_frame_mask_lens(e->frame, tile);
    }
}

pags_result pags_stage_variable_rate(pags_frame *frame) {
  frame_samples samples;

  /* Allocates the planes of samples; depth and ids only with extra channels. */
  frame_samples *s = &samples;
  *s = (frame_samples){.width = (frame->camera.width + SAMPLE_SIDE - 1) / SAMPLE_SIDE,
                       .height = (frame->camera.height + SAMPLE_SIDE - 1) / SAMPLE_SIDE,
                       .stride = frame->stride / SAMPLE_SIDE};
  float **const planes[] = {&s->rgb[0],   &s->rgb[1], &s->rgb[2],   &s->transmittance,
                            &s->critical, &s->depth,  &s->depth_sum};
  const int count = frame->options.extra_channels ? 7 : 5;
  for (int k = 0; k < count; k++)
    if (!(*planes[k] = sample_plane(frame, s)))
      return PAGS_ERROR_MEMORY;
  if (frame->options.extra_channels && !(s->id = (int32_t *)(void *)sample_plane(frame, s)))
    return PAGS_ERROR_MEMORY;

  PAGS_TRY(pags_stage_sample(frame, &samples));

  /* Marks the tiles to rasterise at every pixel: those around samples that show critical Gaussians. */
  const int64_t tiles = (int64_t)frame->tiles_x * frame->tiles_y;
  uint8_t *const wanted = pags_frame_alloc(frame, tiles, 1, "tiles that are drawn in full");
  if (!wanted)
    return PAGS_ERROR_MEMORY;
  memset(wanted, 0, (size_t)tiles);
  for (int y = 0; y < samples.height; y++)
    for (int x = 0; x < samples.width; x++)
      if (samples.critical[(int64_t)y * samples.stride + x] >= SHOWS) {
        /* The tiles that hold the sample or one of its eight neighbours. */
        const int x0 = x > 0 ? (x - 1) / TILE_SAMPLES : 0, x1 = (x + 1 < samples.width ? x + 1 : x) / TILE_SAMPLES;
        const int y0 = y > 0 ? (y - 1) / TILE_SAMPLES : 0, y1 = (y + 1 < samples.height ? y + 1 : y) / TILE_SAMPLES;
        for (int ty = y0; ty <= y1; ty++)
          for (int tx = x0; tx <= x1; tx++)
            wanted[(int64_t)ty * frame->tiles_x + tx] = 1;
      }
  int64_t marked = 0;
  for (int64_t i = 0; i < tiles; i++)
    marked += wanted[i];
  frame->variable_rate->full_tiles = (double)marked / (double)tiles;
  frame->wanted = wanted;

  PAGS_TRY(pags_stage_raster(frame));
  enlarging e = {frame, &samples};
  return pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, 16, enlarge_tiles, &e);
}
