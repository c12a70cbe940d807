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

/* The two rows of samples a and b that a row of pixels lies between, and b's weight t in the linear interpolation.
 * Pixels beyond the outermost rows of samples take the outermost row. */
typedef struct between {
  int a, b;
  float t;
} between;

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

typedef struct enlarging {
  const pags_frame *frame;
  const frame_samples *samples;
} enlarging;

/* Block function: interpolates those of tiles [begin, end) that were not rasterised, and adds sky and exposure. */
static void enlarge_tiles(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const enlarging *const e = context;
  const pags_frame *const f = e->frame;
  const frame_samples *const s = e->samples;
  for (int64_t tile = begin; tile < end; tile++) {
    if (f->wanted[tile])
      continue;
    const int x0 = frame_tile_x(f, tile), y0 = frame_tile_y(f, tile), first = x0 / SAMPLE_SIDE;
    for (int y = y0; y < y0 + PAGS_TILE; y++) {
      const float sample = ((float)y + 0.5f) / SAMPLE_SIDE - 0.5f;
      const int above = sample > 0.0f ? (int)sample : 0, last = s->height - 1;
      const between v = {above < last ? above : last, above + 1 < last ? above + 1 : last,
                         sample > 0.0f ? sample - (float)(int)sample : 0.0f};
      const int64_t row = (int64_t)y * f->stride + x0;
      for (int k = 0; k < 3; k++)
        interpolate_row(s->rgb[k], s->stride, first, s->width, v, frame_plane(f, PLANE_R + k) + row);
      interpolate_row(s->transmittance, s->stride, first, s->width, v, frame_plane(f, PLANE_T) + row);

      /* Depth and id are those of the nearest sample, in whose 4 x 4 pixels each pixel lies. */
      const int64_t samples = (int64_t)(y / SAMPLE_SIDE) * s->stride + first;
      for (int x = 0; x < PAGS_TILE && f->options.extra_channels; x++) {
        frame_plane(f, PLANE_DEPTH)[row + x] = s->depth[samples + x / SAMPLE_SIDE];
        frame_plane(f, PLANE_DEPTH_SUM)[row + x] = s->depth_sum[samples + x / SAMPLE_SIDE];
        frame_ids(f)[row + x] = s->id[samples + x / SAMPLE_SIDE];
      }
    }
    /* Less sky than 1/512 isn't visible: that is under half a grey level, if it isn't made brighter. */
    if (f->has_sky && pags_frame_tile_shows(f, tile, 1.0f / 512.0f / f->enlargement)) {
      pags_sky_tile sky;
      pags_frame_find_sky(f, tile, &sky);
      pags_frame_blend_sky(f, tile, &sky);
    }
    if (f->options.exposed)
      pags_frame_expose(f, tile);
    if (f->lens)
      pags_frame_mask_lens(f, tile);
  }
}

pags_result pags_stage_variable_rate(pags_frame *frame) {
  frame_samples samples = {.width = (frame->camera.width + SAMPLE_SIDE - 1) / SAMPLE_SIDE,
                           .height = (frame->camera.height + SAMPLE_SIDE - 1) / SAMPLE_SIDE,
                           .stride = frame->stride / SAMPLE_SIDE};
  /* The planes of samples, padded to whole tiles; depth and ids only with extra channels. */
  void *const planes[] = {&samples.rgb[0],   &samples.rgb[1], &samples.rgb[2],    &samples.transmittance,
                          &samples.critical, &samples.depth,  &samples.depth_sum, &samples.id};
  const int count = frame->options.extra_channels ? 8 : 5;
  for (int k = 0; k < count; k++)
    PAGS_TRY(pags_frame_alloc(frame, planes[k], (int64_t)samples.stride * (frame->rows / SAMPLE_SIDE), sizeof(float),
                              "samples"));
  PAGS_TRY(pags_stage_sample(frame, &samples));

  /* Marks the tiles to rasterise at every pixel: those around samples that show critical Gaussians. */
  const int64_t tiles = (int64_t)frame->tiles_x * frame->tiles_y;
  uint8_t *wanted;
  PAGS_TRY(pags_frame_alloc(frame, &wanted, tiles, 1, "tiles that are drawn in full"));
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
  return pags_frame_for(frame, tiles, 16, enlarge_tiles, &e);
}
