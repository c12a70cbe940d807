/* SPDX-License-Identifier: Apache-2.0 */
/* The stage sort: brings each tile's list into front-to-back order, by (bits of z, id). Each list is sorted by one
 * worker, in that worker's cache. The Gaussians as a whole are never sorted: binning writes the lists about in memory
 * order (bin.c), in which neighbours fall into the same tiles. Entries carry the key that they are sorted by, unless a
 * backward pass needs their ranks in its place: then keys are gathered first, and the entries follow the order.
 *
 * Since z > 0, the bits of z as an unsigned integer have the order of z. */
#include <string.h>

#include "frame/stages.h"

/* Up to FEW items an insertion sort is used; up to SOME, the digits of the radix sort are one bit narrower. */
enum { FEW = 32, SOME = 256, MOST_DIGIT_BITS = 9, MOST_PASSES = 4 };

/* LSD radix sort over only as many bits as the range of the keys has, which is some 26 for the depths of a street.
 * Short lists are sorted by insertion. */
depth_key *pags_frame_sort_keys(depth_key *keys, depth_key *spare, int64_t count) {
  if (count <= FEW) {
    /* Insertion sort, which needs no histograms. */
    for (int64_t i = 1; i < count; i++) {
      const depth_key moving = keys[i];
      int64_t k = i;
      for (; k > 0 && keys[k - 1].key > moving.key; k--)
        keys[k] = keys[k - 1];
      keys[k] = moving;
    }

    return keys;
  }
  uint32_t least = UINT32_MAX, most = 0;
  for (int64_t i = 0; i < count; i++) {
    least = keys[i].key < least ? keys[i].key : least;
    most = keys[i].key > most ? keys[i].key : most;
  }
  if (least == most)
    return keys;
  const int bits = 32 - __builtin_clz(most - least);
  /* Digits of short lists are one bit narrower, since clearing and summing the histograms takes time too. */
  const int most_bits = count <= SOME ? MOST_DIGIT_BITS - 1 : MOST_DIGIT_BITS;
  const int passes = (bits + most_bits - 1) / most_bits, width = (bits + passes - 1) / passes;
  uint32_t place[MOST_PASSES][1 << MOST_DIGIT_BITS];

  /* The histograms of all digits are made in one pass over the keys, then turned into exclusive prefix sums: where
   * the keys with each digit value begin. */
  const uint32_t mask = (1u << width) - 1;
  for (int pass = 0; pass < passes; pass++)
    memset(place[pass], 0, sizeof(uint32_t) << width);
  for (int64_t i = 0; i < count; i++)
    for (int pass = 0; pass < passes; pass++)
      place[pass][(keys[i].key - least) >> pass * width & mask]++;
  for (int pass = 0; pass < passes; pass++) {
    uint32_t before = 0;
    for (uint32_t d = 0; d <= mask; d++) {
      const uint32_t n = place[pass][d];
      place[pass][d] = before;
      before += n;
    }
  }

  for (int pass = 0; pass < passes; pass++) {
    uint32_t *const next = place[pass];
    for (int64_t i = 0; i < count; i++)
      spare[next[(keys[i].key - least) >> pass * width & ((1u << width) - 1)]++] = keys[i];
    depth_key *const swap = keys;
    keys = spare;
    spare = swap;
  }
  return keys;
}

typedef struct sort_context {
  pags_frame *frame;
  depth_key *scratch; /* two buffers of `stretch` items per worker or, where that is less, two per tile */
  int64_t stretch;    /* length of the longest list; 0: buffers per tile */
} sort_context;

/* Sorts items by (depth, id); returns `keys` or `spare`, whichever holds the result. `entries`: what the items are the
 * indices of; NULL: of splats. */
static depth_key *sort_items(const pags_frame *f, const pags_entry *entries, depth_key *keys, depth_key *spare,
                             int64_t count) {
  depth_key *const order = pags_frame_sort_keys(keys, spare, count);
  /* Equal depths are ordered by id. Where ids ascend in memory order, the stable sort has done so already, but the
   * dense order of slabs isn't that of the ids. */
  if (f->ids_ascend && !f->full)
    return order;
#define ID_OF(item) (f->splats[entries ? entries[(item).splat].splat : (item).splat].id)
  for (int64_t begin = 0, end = 1; end <= count; end++) {
    if (end < count && order[end].key == order[begin].key)
      continue;
    /* Shell sort: most runs are short, and a long one (a wall that faces the camera) still takes only about n^1.3
     * steps. */
    depth_key *const run = order + begin;
    int64_t gap = end - begin > 1;
    while (gap < (end - begin) / 9)
      gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3)
      for (int64_t i = gap; i < end - begin; i++) {
        const depth_key moving = run[i];
        const int32_t id = ID_OF(moving);
        int64_t k = i;
        for (; k >= gap && ID_OF(run[k - gap]) > id; k -= gap)
          run[k] = run[k - gap];
        run[k] = moving;
      }
    begin = end;
  }
#undef ID_OF
  return order;
}

static void sort_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const sort_context *const c = context;
  const pags_frame *const f = c->frame;
  for (int64_t tile = begin; tile < end; tile++) {
    const int64_t start = f->tile_start[tile], count = f->tile_start[tile + 1] - start;
    depth_key *const keys = c->scratch + 2 * (c->stretch ? worker * c->stretch : start);
    pags_entry *const entries = f->entries + start;
    if (!f->options.keep_for_backward) {
      if (sort_items(f, NULL, entries, keys, count) == keys)
        memcpy(entries, keys, (size_t)count * sizeof *keys);
      continue;
    }
    /* Entries with ranks: their keys are gathered, and the entries follow the order of these. */
    depth_key *const spare = keys + (c->stretch ? c->stretch : count);
    for (int64_t i = 0; i < count; i++)
      keys[i] = (depth_key){.key = f->keys[entries[i].splat], .splat = (uint32_t)i};
    depth_key *const order = sort_items(f, entries, keys, spare, count);
    pags_entry *const copy = order == keys ? spare : keys;
    memcpy(copy, entries, (size_t)count * sizeof *copy);
    for (int64_t i = 0; i < count; i++)
      entries[i] = copy[order[i].splat];
  }
}

pags_result pags_stage_sort(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "sort");
  const int64_t tiles = (int64_t)frame->tiles_x * frame->tiles_y, pairs = frame->tile_start[tiles];
  const int workers = pags_tasks_workers(frame->tasks);
  int64_t longest = 0;
  for (int64_t tile = 0; tile < tiles; tile++) {
    const int64_t count = frame->tile_start[tile + 1] - frame->tile_start[tile];
    longest = count > longest ? count : longest;
  }
  sort_context c = {.frame = frame, .stretch = workers * longest < pairs ? longest : 0};
  PAGS_TRY(pags_frame_alloc(frame, &c.scratch, 2 * (c.stretch ? workers * c.stretch : pairs), sizeof *c.scratch,
                            "lists to sort"));
  return pags_frame_for(frame, tiles, 1, sort_tiles, &c);
}
