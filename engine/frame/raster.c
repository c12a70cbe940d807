/* SPDX-License-Identifier: Apache-2.0 */
/* The stages raster and sample: front-to-back blending of each tile's list (Kerbl et al. 2023),
 *   C += T alpha c,  T *= 1 - alpha.
 * They run the kernels over the tiles: raster at every pixel (simd/raster.c, which has the maths), then adding sky
 * and exposure; sample at points 4 pixels apart (simd/sample.c). */
#include <float.h>
#include <string.h>

#include "frame/lens_view.h"

/* Tiles in a worker's block, within which it prefetches the next tile's splats. With more, some workers would have
 * nothing left to do at the end. */
enum { TILES_AT_A_TIME = 4 };

typedef struct raster_context {
  pags_frame *frame;
  const frame_samples *samples; /* output of the sample stage; NULL: the raster stage */
  int64_t (*counts)[8]; /* per worker: lanes evaluated, blended, open; entries reached; on separate cache lines */
} raster_context;

/* The kernel's input for a tile. `goes_on`: the same worker draws the next tile after this one, so that tile's splats
 * are prefetched. */
static pags_raster_in tile_input(const raster_context *c, int64_t tile, bool goes_on, int worker) {
  const pags_frame *const f = c->frame;
  const int64_t start = f->tile_start[tile];
  return (pags_raster_in){.splats = f->splats,
                          .entries = f->entries + start,
                          .count = f->tile_start[tile + 1] - start,
                          .ahead = f->entries + f->tile_start[tile + 1],
                          .ahead_count = goes_on ? f->tile_start[tile + 2] - f->tile_start[tile + 1] : 0,
                          .x0 = frame_tile_x(f, tile),
                          .y0 = frame_tile_y(f, tile),
                          .width = f->camera.width,
                          .height = f->camera.height,
                          .exp_degree = f->options.exp_degree,
                          .pairs = f->options.count_pairs ? c->counts[worker] : NULL,
                          .looked_at = &c->counts[worker][3],
                          .eps = f->options.early_z == PAGS_EARLY_Z_BOUNDED ? f->options.early_z_eps : 0.0f};
}

/* Blends a tile's list onto the state of earlier slabs, if any. If that finishes the tile (in the last slab, or since
 * all of its pixels are saturated), adds sky and exposure. */
static void raster_tile(const raster_context *c, int64_t tile, bool goes_on, int worker) {
  const pags_frame *const f = c->frame;
  pags_raster_in in = tile_input(c, tile, goes_on, worker);
  const int64_t at = frame_tile_offset(f, tile);
  in.block_masks = frame_keeps_lists(f) ? f->block_masks + f->tile_start[tile] : NULL;
  in.hard = f->hard ? f->hard + at : NULL;
  in.resume = f->full && f->full->tile_begun[tile];
  in.unfinished = f->full && !f->last_slab;
  pags_raster_out out = {.transmittance = frame_plane(f, PLANE_T) + at, .stride = f->stride};
  for (int k = 0; k < 3; k++) {
    out.rgb[k] = frame_plane(f, PLANE_R + k) + at;
    out.background[k] = f->has_sky ? 0.0f : f->options.background[k]; /* the sky is added afterwards */
  }
  if (f->options.extra_channels || f->options.depth_sum)
    out.depth_sum = frame_plane(f, PLANE_DEPTH_SUM) + at;
  if (f->options.extra_channels) {
    out.depth = frame_plane(f, PLANE_DEPTH) + at;
    out.best = frame_plane(f, PLANE_BEST) + at;
    out.id = frame_ids(f) + at;
  }
  pags_sky_tile sky;
  /* Early, so that its texels are fetched while Gaussians are blended; but most tiles of a bounded frame show none. */
  const bool early = f->has_sky && !in.unfinished && in.eps <= 0.0f;
  if (early)
    pags_frame_find_sky(f, tile, &sky);
  const unsigned open = f->kernels->raster(&in, &out);
  if (f->full) {
    f->full->tile_begun[tile] = 1;
    f->full->tile_open[tile] = (uint16_t)open;
    if (!open)
      f->full->limits[tile] = -1.0f;
  }
  if (in.unfinished && open)
    return;
  if (early || (f->has_sky && pags_frame_tile_shows(f, tile, FLT_MIN))) {
    if (!early)
      pags_frame_find_sky(f, tile, &sky);
    pags_frame_blend_sky(f, tile, &sky); /* while the tile is in the cache */
  }
  if (f->options.exposed)
    pags_frame_expose(f, tile);
  if (f->lens)
    pags_frame_mask_lens(f, tile);
}

static void raster_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const raster_context *const c = context;
  const pags_frame *const f = c->frame;
  for (int64_t tile = begin; tile < end; tile++) {
    /* Saturated, or this slab put nothing into the tile's list and isn't the last. */
    const bool rests =
        f->full && (f->full->limits[tile] < 0.0f || (!f->last_slab && f->tile_start[tile + 1] == f->tile_start[tile]));
    if ((!f->wanted || f->wanted[tile]) && !rests)
      raster_tile(c, tile, tile + 1 < end, worker);
  }
}

/* Block function: blends tiles [begin, end) at their 4 x 4 samples, for variable-rate shading. */
static void sample_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const raster_context *const c = context;
  const pags_frame *const f = c->frame;
  const frame_samples *const s = c->samples;
  for (int64_t tile = begin; tile < end; tile++) {
    const pags_raster_in in = tile_input(c, tile, false, worker);
    const int64_t at = (int64_t)(in.y0 / SAMPLE_SIDE) * s->stride + in.x0 / SAMPLE_SIDE;
    pags_raster_out out = {.transmittance = s->transmittance + at, .stride = s->stride};
    for (int k = 0; k < 3; k++) {
      out.rgb[k] = s->rgb[k] + at;
      out.background[k] = f->has_sky ? 0.0f : f->options.background[k];
    }
    if (f->options.extra_channels) {
      out.depth = s->depth + at;
      out.depth_sum = s->depth_sum + at;
      out.id = s->id + at;
    }
    f->kernels->sample(&in, f->variable_rate->critical, f->variable_rate->count, &out, s->critical + at);
  }
}

/* Runs a block function over all tiles and adds the workers' counts to the frame's statistics. */
static pags_result run_tiles(pags_frame *frame, const frame_samples *samples, pags_block_fn *fn) {
  pags_tasks_mark(frame->tasks, NULL, "raster");
  raster_context c = {.frame = frame, .samples = samples};
  const int workers = pags_tasks_workers(frame->tasks);
  PAGS_TRY(pags_frame_alloc(frame, &c.counts, workers, sizeof *c.counts, "pair counts"));
  memset(c.counts, 0, (size_t)workers * sizeof *c.counts);
  PAGS_TRY(pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, TILES_AT_A_TIME, fn, &c));
  for (int w = 0; w < workers; w++) {
    frame->stats.pairs_evaluated += c.counts[w][0];
    frame->stats.pairs_blended += c.counts[w][1];
    frame->stats.pairs_open += c.counts[w][2];
    frame->stats.pairs_reached += c.counts[w][3];
  }
  return PAGS_OK;
}

pags_result pags_stage_raster(pags_frame *frame) {
  return run_tiles(frame, NULL, raster_tiles);
}
pags_result pags_stage_sample(pags_frame *frame, const frame_samples *samples) {
  return run_tiles(frame, samples, sample_tiles);
}

void pags_frame_expose(const pags_frame *frame, int64_t tile) {
  const int64_t at = frame_tile_offset(frame, tile);
  const pags_photometric *const calibration = &frame->options.photometric;
  if (!pags_photometric_is_identity(calibration))
    for (int i = 0; i < PAGS_TILE_PIXELS; i++) { /* vignetting and response */
      const int x = i % PAGS_TILE, y = i / PAGS_TILE;
      const double q = pags_photometric_radius2(&frame->camera, (double)(frame_tile_x(frame, tile) + x) + 0.5,
                                                (double)(frame_tile_y(frame, tile) + y) + 0.5);
      const double bright = pags_photometric_vignetting(calibration, q);
      for (int c = 0; c < 3; c++) {
        float *const value = frame_plane(frame, PLANE_R + c) + at + y * frame->stride + x;
        *value = (float)pags_photometric_response(calibration, bright * (double)*value, NULL);
      }
    }
  for (int c = 0; c < 3; c++) {
    const float gain = frame->options.gain[c], offset = frame->options.offset[c];
    float *row = frame_plane(frame, PLANE_R + c) + at;
    for (int y = 0; y < PAGS_TILE; y++, row += frame->stride)
      for (int x = 0; x < PAGS_TILE; x++)
        row[x] = gain * row[x] + offset;
  }
}
