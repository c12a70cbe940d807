/* One depth sort a frame: front to back by (bits of z, id).
 *
 * z > 0, so its bits order as an unsigned number does. A stable radix sort of 11 bits a pass over fixed blocks of keys: the same
 * order however blocks are scheduled. Passes whose digit is the same for all keys are skipped. */
#include <string.h>

#include "stages.h"

enum { DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS, PASSES = 3, BLOCK = 1 << 15 };

typedef struct sort_context {
  pags_frame *frame;
  depth_key *from, *to;
  int64_t count;
  int64_t *block_count;        /* drawn per block of dense indices */
  uint32_t (*histogram)[DIGITS]; /* per block of keys */
  int shift;
} sort_context;

static void count_drawn(void *context, int64_t begin, int64_t end, int worker) {
  sort_context *const c = context;
  (void)worker;
  int64_t drawn = 0;
  for (int64_t i = begin; i < end; i++)
    drawn += c->frame->keys[i] != UINT32_MAX;
  c->block_count[begin / BLOCK] = drawn;
}

static void gather_drawn(void *context, int64_t begin, int64_t end, int worker) {
  sort_context *const c = context;
  (void)worker;
  depth_key *out = c->from + c->block_count[begin / BLOCK];
  for (int64_t i = begin; i < end; i++)
    if (c->frame->keys[i] != UINT32_MAX)
      *out++ = (depth_key){c->frame->keys[i], (uint32_t)i};
}

static void count_digits(void *context, int64_t begin, int64_t end, int worker) {
  sort_context *const c = context;
  (void)worker;
  uint32_t *const histogram = c->histogram[begin / BLOCK];
  memset(histogram, 0, DIGITS * sizeof *histogram);
  for (int64_t i = begin; i < end; i++)
    histogram[c->from[i].key >> c->shift & (DIGITS - 1)]++;
}

static void scatter_digits(void *context, int64_t begin, int64_t end, int worker) {
  sort_context *const c = context;
  (void)worker;
  uint32_t *const next = c->histogram[begin / BLOCK];
  for (int64_t i = begin; i < end; i++)
    c->to[next[c->from[i].key >> c->shift & (DIGITS - 1)]++] = c->from[i];
}

/* Turns counts into the places where each block's share of each digit begins. False if one digit holds everything. */
static bool digit_places(sort_context *c, int64_t blocks) {
  uint32_t place = 0;
  bool several = false;
  for (int d = 0; d < DIGITS; d++) {
    const uint32_t before = place;
    for (int64_t b = 0; b < blocks; b++) {
      const uint32_t n = c->histogram[b][d];
      c->histogram[b][d] = place;
      place += n;
    }
    several |= place != before && (int64_t)(place - before) != c->count;
  }
  return several;
}

/* Equal depths are ordered by id; a stable sort has done so already where ids ascend with the index. Shell sort: runs are short, and
 * a long one (a wall of equal depths) still costs n^1.3. */
void pags_frame_order_ties(const pags_frame *frame, depth_key *keys, int64_t count) {
  for (int64_t begin = 0; begin < count;) {
    int64_t end = begin + 1;
    while (end < count && keys[end].key == keys[begin].key)
      end++;
    const int64_t n = end - begin;
    depth_key *const run = keys + begin;
    int64_t gap = 1;
    while (gap < n / 9)
      gap = 3 * gap + 1;
    for (; n > 1 && gap > 0; gap /= 3)
      for (int64_t i = gap; i < n; i++) {
        const depth_key moving = run[i];
        const int32_t id = frame->splats[moving.index].id;
        int64_t k = i;
        for (; k >= gap && frame->splats[run[k - gap].index].id > id; k -= gap)
          run[k] = run[k - gap];
        run[k] = moving;
      }
    begin = end;
  }
}

static pags_result radix_sort(sort_context *c) {
  const int64_t blocks = (c->count + BLOCK - 1) / BLOCK;
  c->histogram = pags_frame_alloc(c->frame, blocks, sizeof *c->histogram, "sort histograms");
  if (!c->histogram)
    return PAGS_ERROR_MEMORY;
  for (int pass = 0; pass < PASSES; pass++) {
    c->shift = pass * DIGIT_BITS;
    PAGS_TRY(pags_frame_for(c->frame, c->count, BLOCK, count_digits, c));
    if (!digit_places(c, blocks))
      continue;
    PAGS_TRY(pags_frame_for(c->frame, c->count, BLOCK, scatter_digits, c));
    depth_key *const swap = c->from;
    c->from = c->to;
    c->to = swap;
  }
  return PAGS_OK;
}

pags_result pags_frame_radix_sort(pags_frame *frame, depth_key **keys, depth_key **spare, int64_t count) {
  sort_context c = {.frame = frame, .from = *keys, .to = *spare, .count = count};
  PAGS_TRY(radix_sort(&c));
  *keys = c.from;
  *spare = c.to;
  return PAGS_OK;
}

pags_result pags_stage_sort(pags_frame *frame) {
  const int64_t dense_blocks = (frame->dense_count + BLOCK - 1) / BLOCK;
  sort_context c = {.frame = frame};
  c.block_count = pags_frame_alloc(frame, dense_blocks, sizeof *c.block_count, "drawn counts");
  if (!c.block_count)
    return PAGS_ERROR_MEMORY;
  PAGS_TRY(pags_frame_for(frame, frame->dense_count, BLOCK, count_drawn, &c));
  for (int64_t b = 0; b < dense_blocks; b++) {
    const int64_t n = c.block_count[b];
    c.block_count[b] = c.count;
    c.count += n;
  }
  frame->drawn_count = frame->stats.shaded = c.count;
  c.from = pags_frame_alloc(frame, c.count, sizeof *c.from, "depth keys");
  c.to = pags_frame_alloc(frame, c.count, sizeof *c.to, "depth keys");
  frame->order = pags_frame_alloc(frame, c.count, sizeof *frame->order, "depth order");
  if (!c.from || !c.to || !frame->order)
    return PAGS_ERROR_MEMORY;
  PAGS_TRY(pags_frame_for(frame, frame->dense_count, BLOCK, gather_drawn, &c));
  PAGS_TRY(radix_sort(&c));
  if (!frame->ids_ascend)
    pags_frame_order_ties(frame, c.from, c.count);
  for (int64_t i = 0; i < c.count; i++)
    frame->order[i] = c.from[i].index;
  return PAGS_OK;
}
