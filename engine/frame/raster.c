/* Runs the blending kernel over the tiles. */
#include "stages.h"

enum { TILES_AT_A_TIME = 4 }; /* whose splats are fetched ahead; more would leave some workers without any at the end */

typedef struct raster_context {
  pags_frame *frame;
  int64_t (*counts)[8]; /* per worker: lanes evaluated, lanes blended, entries looked at; a cache line apart */
} raster_context;

static pags_raster_out tile_output(const pags_frame *frame, int64_t at) {
  pags_raster_out out = {.transmittance = frame_plane(frame, PLANE_T) + at, .stride = frame->stride};
  for (int c = 0; c < 3; c++) {
    out.rgb[c] = frame_plane(frame, PLANE_R + c) + at;
    out.background[c] = frame->has_sky ? 0.0f : frame->options.background[c];
  }
  if (frame->options.extra_channels || frame->options.depth_sum)
    out.depth_sum = frame_plane(frame, PLANE_DEPTH_SUM) + at;
  if (frame->options.extra_channels) {
    out.depth = frame_plane(frame, PLANE_DEPTH) + at;
    out.best = frame_plane(frame, PLANE_BEST) + at;
    out.id = (int32_t *)(void *)frame_plane(frame, PLANE_ID) + at;
  }
  return out;
}

/* Whether this slab has nothing to do there: the tile is finished, or nothing was added and more may come. */
static bool tile_rests(const pags_frame *f, int64_t tile) {
  return f->full && (f->full->limits[tile] < 0.0f || (!f->last_slab && f->tile_start[tile + 1] == f->tile_start[tile]));
}

/* `goes_on`: the same worker draws the next tile after this one. */
static void raster_tile(const raster_context *c, int64_t tile, bool goes_on, int worker) {
  const pags_frame *const f = c->frame;
  const int x0 = (int)(tile % f->tiles_x) * PAGS_TILE, y0 = (int)(tile / f->tiles_x) * PAGS_TILE;
  const int64_t start = f->tile_start[tile];
  const pags_raster_in in = {.splats = f->splats,
                             .entries = f->entries + start,
                             .count = f->tile_start[tile + 1] - start,
                             .ahead = f->entries + f->tile_start[tile + 1],
                             .ahead_count = goes_on ? f->tile_start[tile + 2] - f->tile_start[tile + 1] : 0,
                             .x0 = x0,
                             .y0 = y0,
                             .width = f->camera.width,
                             .height = f->camera.height,
                             .exp_degree = f->options.exp_degree,
                             .block_masks = f->options.keep_for_backward ? f->block_masks + start : NULL,
                             .pairs = f->options.count_pairs ? c->counts[worker] : NULL,
                             .looked_at = &c->counts[worker][2],
                             .hard = f->hard ? f->hard + (int64_t)y0 * f->stride + x0 : NULL,
                             .resume = f->full && f->full->tile_begun[tile],
                             .unfinished = f->full && !f->last_slab,
                             .eps = f->options.early_z == PAGS_EARLY_Z_BOUNDED ? f->options.early_z_eps : 0.0f};
  const pags_raster_out out = tile_output(f, (int64_t)y0 * f->stride + x0);
  pags_sky_tile sky;
  if (f->has_sky && !in.unfinished)
    pags_frame_find_sky(f, tile, &sky); /* whose texels come while Gaussians are blended */
  const unsigned open = f->kernels->raster(&in, &out);
  if (f->full) {
    f->full->tile_begun[tile] = 1;
    f->full->tile_open[tile] = (uint16_t)open;
    if (!open)
      f->full->limits[tile] = -1.0f;
  }
  if (in.unfinished && open)
    return;
  if (f->has_sky && in.unfinished)
    pags_frame_find_sky(f, tile, &sky);
  if (f->has_sky) /* while the tile is in the cache */
    pags_frame_blend_sky(f, tile, &sky);
  if (f->options.exposed)
    pags_frame_expose(f, tile);
}

static void raster_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const raster_context *const c = context;
  for (int64_t tile = begin; tile < end; tile++)
    if (!tile_rests(c->frame, tile))
      raster_tile(c, tile, tile + 1 < end, worker);
}

pags_result pags_stage_raster(pags_frame *frame) {
  raster_context c = {.frame = frame};
  const int workers = pags_tasks_workers(frame->tasks);
  c.counts = pags_frame_alloc(frame, workers, sizeof *c.counts, "pair counts");
  if (!c.counts)
    return PAGS_ERROR_MEMORY;
  for (int w = 0; w < workers; w++)
    c.counts[w][0] = c.counts[w][1] = c.counts[w][2] = 0;
  PAGS_TRY(pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, TILES_AT_A_TIME, raster_tiles, &c));
  for (int w = 0; w < workers; w++) {
    frame->stats.pairs_evaluated += c.counts[w][0];
    frame->stats.pairs_blended += c.counts[w][1];
    frame->looked_at += c.counts[w][2];
  }
  return PAGS_OK;
}
