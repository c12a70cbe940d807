/* Lists, for each tile, of the splats that can change it, front to back.
 *
 * The depth order is cut into fixed blocks. Each block counts its pairs per tile; sums over (tile, block) give every block its own
 * place in each tile's list; then each block writes its pairs there. Stable, and no atomics. */
#include <string.h>

#include "stages.h"

enum { MOST_BLOCKS = 32, LEAST_SPLATS = 1024 };

typedef struct bin_context {
  pags_frame *frame;
  int64_t tiles, grain;
  uint32_t *counts; /* tiles per block */
  int64_t *offsets; /* tiles per block */
  uint64_t *touched; /* per drawn splat */
  int64_t binned[MOST_BLOCKS], hidden[MOST_BLOCKS];
} bin_context;

static void count_block(void *context, int64_t begin, int64_t end, int worker) {
  bin_context *const c = context;
  pags_frame *const f = c->frame;
  (void)worker;
  uint32_t *const counts = c->counts + begin / c->grain * c->tiles;
  memset(counts, 0, (size_t)c->tiles * sizeof *counts);
  c->binned[begin / c->grain] =
      f->kernels->bin_count(f->splats, f->order + begin, end - begin, f->tiles_x, f->tiles_y, f->tile_limits, c->touched + begin,
                            counts, &c->hidden[begin / c->grain]);
}

static void fill_block(void *context, int64_t begin, int64_t end, int worker) {
  bin_context *const c = context;
  pags_frame *const f = c->frame;
  (void)worker;
  f->kernels->bin_fill(f->splats, f->order + begin, end - begin, f->tiles_x, f->tiles_y, f->tile_limits, c->touched + begin,
                       c->offsets + begin / c->grain * c->tiles, f->entries);
}

static int64_t place_blocks(bin_context *c, int64_t blocks) {
  int64_t place = 0;
  for (int64_t tile = 0; tile < c->tiles; tile++) {
    c->frame->tile_start[tile] = place;
    for (int64_t b = 0; b < blocks; b++) {
      c->offsets[b * c->tiles + tile] = place;
      place += c->counts[b * c->tiles + tile];
    }
  }
  c->frame->tile_start[c->tiles] = place;
  return place;
}

/* Where each splat's gradient slots begin; in dense order, so that a cluster's slots lie together. */
static pags_result place_slots(pags_frame *frame) {
  frame->slot_start = pags_frame_alloc(frame, frame->dense_count + 1, sizeof *frame->slot_start, "slot places");
  if (!frame->slot_start)
    return PAGS_ERROR_MEMORY;
  int64_t place = 0;
  for (int64_t i = 0; i < frame->dense_count; i++) {
    frame->slot_start[i] = place;
    if (frame->keys[i] != UINT32_MAX)
      place += frame->splats[i].tiles;
  }
  frame->slot_start[frame->dense_count] = place;
  return PAGS_OK;
}

pags_result pags_stage_bin(pags_frame *frame) {
  bin_context c = {.frame = frame, .tiles = (int64_t)frame->tiles_x * frame->tiles_y};
  c.grain = (frame->drawn_count + MOST_BLOCKS - 1) / MOST_BLOCKS;
  c.grain = c.grain < LEAST_SPLATS ? LEAST_SPLATS : c.grain;
  const int64_t blocks = (frame->drawn_count + c.grain - 1) / c.grain;
  c.counts = pags_frame_alloc(frame, blocks * c.tiles, sizeof *c.counts, "tile counts");
  c.offsets = pags_frame_alloc(frame, blocks * c.tiles, sizeof *c.offsets, "tile offsets");
  frame->tile_start = pags_frame_alloc(frame, c.tiles + 1, sizeof *frame->tile_start, "tile lists");
  c.touched = pags_frame_alloc(frame, frame->drawn_count, sizeof *c.touched, "touched tiles");
  if (!c.counts || !c.offsets || !c.touched || !frame->tile_start)
    return PAGS_ERROR_MEMORY;
  PAGS_TRY(pags_frame_for(frame, frame->drawn_count, c.grain, count_block, &c));
  const int64_t pairs = place_blocks(&c, blocks);
  frame->stats.pairs_binned += pairs;
  frame->entries = pags_frame_alloc(frame, pairs, sizeof *frame->entries, "tile lists");
  if (!frame->entries)
    return PAGS_ERROR_MEMORY;
  PAGS_TRY(pags_frame_for(frame, frame->drawn_count, c.grain, fill_block, &c));
  for (int64_t b = 0; b < blocks; b++) {
    frame->stats.binned += c.binned[b];
    frame->stats.pairs_hidden += c.hidden[b];
  }
  if (!frame->options.keep_for_backward)
    return PAGS_OK;
  frame->block_masks = pags_frame_alloc(frame, pairs, sizeof *frame->block_masks, "block masks");
  return frame->block_masks ? place_slots(frame) : PAGS_ERROR_MEMORY;
}
