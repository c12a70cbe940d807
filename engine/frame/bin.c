/* SPDX-License-Identifier: Apache-2.0 */
/* Binning: makes each tile's list of the splats that can change it. Splats are binned about in memory order, in which
 * neighbours fall into the same tiles, so that only few cache lines of few lists are written at a time. sort.c then
 * sorts each list by depth.
 *
 * This is a stable counting sort by tile, without atomics. The drawn splats are cut into fixed blocks. Each block
 * counts its (Gaussian, tile) pairs per tile; prefix sums over (tile, block) give each block its range in each tile's
 * list; then each block writes its pairs there. */
#include <string.h>

#include "frame/stages.h"

/* Binning uses blocks of at least LEAST_SPLATS drawn splats: at most MOST_BLOCKS, or fewer, but no fewer than
 * FEWEST_BLOCKS, where the tables of all blocks and tiles would have more than MOST_COUNTS counts. The lists don't
 * depend on the number of blocks. The tables are summed in blocks of SUMMED tiles; `drawn` and slot_start are made in
 * blocks of LISTED dense indices. */
enum {
  MOST_BLOCKS = 128,
  FEWEST_BLOCKS = 32,
  MOST_COUNTS = 1 << 19,
  LEAST_SPLATS = 1024,
  SUMMED = 128,
  LISTED = 1 << 12
};

typedef struct list_context {
  pags_frame *frame;
  int64_t *place; /* per block of LISTED dense indices: its count, then the sum of all counts before it */
} list_context;

/* Runs `count` over blocks of LISTED dense indices, then turns the counts into exclusive prefix sums; *sum: total. */
static pags_result count_dense(list_context *c, pags_block_fn *count, int64_t *sum) {
  const int64_t dense = c->frame->dense_count, blocks = (dense + LISTED - 1) / LISTED;
  PAGS_TRY(pags_frame_alloc(c->frame, &c->place, blocks, sizeof *c->place, "counts of members"));
  PAGS_TRY(pags_frame_for(c->frame, dense, LISTED, count, c));
  *sum = 0;
  for (int64_t b = 0; b < blocks; b++) {
    const int64_t n = c->place[b];
    c->place[b] = *sum;
    *sum += n;
  }
  return PAGS_OK;
}

/* Block function: counts the Gaussians of one block that are drawn. */
static void count_drawn(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const list_context *const c = context;
  const uint32_t *const keys = c->frame->keys;
  int64_t drawn = 0;
  for (int64_t i = begin; i < end; i++)
    drawn += keys[i] != UINT32_MAX;
  c->place[begin / LISTED] = drawn;
}

/* Block function: writes the dense indices of a block's drawn Gaussians to the block's range of `drawn`. */
static void list_drawn(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const list_context *const c = context;
  const uint32_t *const keys = c->frame->keys;
  uint32_t *out = c->frame->drawn + c->place[begin / LISTED];
  for (int64_t first = begin; first < end; first += PAGS_LANES) { /* dense_count is a multiple of 16 */
    uint32_t some[PAGS_LANES];
    int n = 0;
    for (int k = 0; k < PAGS_LANES; k++) { /* without a branch, since it would be mispredicted often */
      some[n] = (uint32_t)(first + k);
      n += keys[first + k] != UINT32_MAX;
    }
    memcpy(out, some, (size_t)n * sizeof *out);
    out += n;
  }
}

pags_result pags_stage_list(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "bin");
  list_context c = {.frame = frame};
  PAGS_TRY(count_dense(&c, count_drawn, &frame->drawn_count));
  frame->stats.shaded = frame->drawn_count;
  PAGS_TRY(pags_frame_alloc(frame, &frame->drawn, frame->drawn_count, sizeof *frame->drawn, "list of drawn parts"));
  return pags_frame_for(frame, frame->dense_count, LISTED, list_drawn, &c);
}

typedef struct bin_context {
  pags_frame *frame;
  int64_t tiles, grain, blocks;
  uint32_t *counts; /* [block][tile]: pairs */
  int64_t *offsets; /* [block][tile]: where the block's next pair goes in `entries` */
  int64_t *place;   /* per SUMMED tiles: their pairs, then the pairs of all tiles before them */
  int64_t binned[MOST_BLOCKS], hidden[MOST_BLOCKS];
} bin_context;

static pags_bin bin_input(const pags_frame *f, int64_t begin, int64_t end) {
  return (pags_bin){.splats = f->splats,
                    .boxes = f->boxes,
                    .keys = f->options.keep_for_backward ? NULL : f->keys,
                    .drawn = f->drawn + begin,
                    .count = end - begin,
                    .tiles_x = f->tiles_x,
                    .limits = f->tile_limits};
}

/* Block function: counts a block's pairs per tile, and the pairs that tile_limits leaves out. */
static void count_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  bin_context *const c = context;
  const int64_t block = begin / c->grain;
  uint32_t *const counts = c->counts + block * c->tiles;
  memset(counts, 0, (size_t)c->tiles * sizeof *counts);
  pags_bin in = bin_input(c->frame, begin, end);
  in.hidden = &c->hidden[block];
  c->binned[block] = c->frame->kernels->bin_count(&in, counts);
}

/* Block function: adds up each tile's pairs, in tile_start[tile + 1], and those of all tiles of the block. The loops go
 * through the tables block by block, in the order in which they lie in memory. */
static void sum_tiles(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const bin_context *const c = context;
  int64_t *const pairs = c->frame->tile_start + 1;
  int64_t sum = 0;
  for (int64_t tile = begin; tile < end; tile++)
    pairs[tile] = 0;
  for (int64_t b = 0; b < c->blocks; b++)
    for (int64_t tile = begin; tile < end; tile++)
      pairs[tile] += c->counts[b * c->tiles + tile];
  for (int64_t tile = begin; tile < end; tile++)
    sum += pairs[tile];
  c->place[begin / SUMMED] = sum;
}

/* Block function: turns the sums into the ends of the tiles' lists and into each block's range in each list. */
static void place_tiles(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const bin_context *const c = context;
  int64_t *const list_end = c->frame->tile_start + 1;
  int64_t at = c->place[begin / SUMMED];
  for (int64_t tile = begin; tile < end; tile++) {
    c->offsets[tile] = at; /* there is room for one block at least */
    at += list_end[tile];
    list_end[tile] = at;
  }
  for (int64_t b = 1; b < c->blocks; b++)
    for (int64_t tile = begin; tile < end; tile++)
      c->offsets[b * c->tiles + tile] = c->offsets[(b - 1) * c->tiles + tile] + c->counts[(b - 1) * c->tiles + tile];
}

/* Prefix sums over (tile, block): tile_start and `offsets`. */
static pags_result place_lists(bin_context *c) {
  const int64_t ranges = (c->tiles + SUMMED - 1) / SUMMED;
  int64_t pairs = 0;
  PAGS_TRY(pags_frame_alloc(c->frame, &c->place, ranges, sizeof *c->place, "tile counts"));
  PAGS_TRY(pags_frame_for(c->frame, c->tiles, SUMMED, sum_tiles, c));
  for (int64_t r = 0; r < ranges; r++) {
    const int64_t n = c->place[r];
    c->place[r] = pairs;
    pairs += n;
  }
  c->frame->tile_start[0] = 0;
  return pags_frame_for(c->frame, c->tiles, SUMMED, place_tiles, c);
}

/* Block function: writes a block's pairs to the tiles' lists. */
static void fill_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const bin_context *const c = context;
  const pags_bin in = bin_input(c->frame, begin, end);
  c->frame->kernels->bin_fill(&in, c->offsets + begin / c->grain * c->tiles, c->frame->entries);
}

/* Gradient slots of dense index i: one for each tile that its splat touches. */
static int64_t slots_of(const pags_frame *f, int64_t i) {
  return f->keys[i] != UINT32_MAX ? f->splats[i].tiles : 0;
}

static void count_slots(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const list_context *const c = context;
  int64_t slots = 0;
  for (int64_t i = begin; i < end; i++)
    slots += slots_of(c->frame, i);
  c->place[begin / LISTED] = slots;
}

static void fill_slots(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const list_context *const c = context;
  int64_t place = c->place[begin / LISTED];
  for (int64_t i = begin; i < end; i++) {
    c->frame->slot_start[i] = place;
    place += slots_of(c->frame, i);
  }
}

/* Computes slot_start: where each splat's gradient slots begin. Slots follow the dense order, so that those of a
 * cluster are contiguous. */
pags_result pags_frame_place_slots(pags_frame *frame) {
  list_context c = {.frame = frame};
  PAGS_TRY(
      pags_frame_alloc(frame, &frame->slot_start, frame->dense_count + 1, sizeof *frame->slot_start, "slot places"));
  PAGS_TRY(count_dense(&c, count_slots, frame->slot_start + frame->dense_count));
  return pags_frame_for(frame, frame->dense_count, LISTED, fill_slots, &c);
}

pags_result pags_stage_bin(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "bin");
  bin_context c = {.frame = frame, .tiles = (int64_t)frame->tiles_x * frame->tiles_y};
  int64_t most = MOST_COUNTS / c.tiles;
  most = most < FEWEST_BLOCKS ? FEWEST_BLOCKS : most > MOST_BLOCKS ? MOST_BLOCKS : most;
  c.grain = (frame->drawn_count + most - 1) / most;
  c.grain = c.grain < LEAST_SPLATS ? LEAST_SPLATS : c.grain;
  const int64_t blocks = c.blocks = (frame->drawn_count + c.grain - 1) / c.grain;
  PAGS_TRY(pags_frame_alloc(frame, &c.counts, blocks * c.tiles, sizeof *c.counts, "tile counts"));
  PAGS_TRY(pags_frame_alloc(frame, &c.offsets, (blocks > 0 ? blocks : 1) * c.tiles, sizeof *c.offsets, "tile offsets"));
  PAGS_TRY(pags_frame_alloc(frame, &frame->tile_start, c.tiles + 1, sizeof *frame->tile_start, "tile lists"));
  PAGS_TRY(pags_frame_for(frame, frame->drawn_count, c.grain, count_block, &c));

  PAGS_TRY(place_lists(&c));
  const int64_t pairs = frame->tile_start[c.tiles];
  frame->stats.pairs_binned += pairs;
  PAGS_TRY(pags_frame_alloc(frame, &frame->entries, pairs, sizeof *frame->entries, "tile lists"));
  PAGS_TRY(pags_frame_for(frame, frame->drawn_count, c.grain, fill_block, &c));
  for (int64_t b = 0; b < blocks; b++) {
    frame->stats.binned += c.binned[b];
    frame->stats.pairs_hidden += c.hidden[b];
  }
  if (!frame_keeps_lists(frame))
    return PAGS_OK;
  PAGS_TRY(pags_frame_alloc(frame, &frame->block_masks, pairs, sizeof *frame->block_masks, "block masks"));
  return frame->options.keep_for_backward ? pags_frame_place_slots(frame) : PAGS_OK;
}
