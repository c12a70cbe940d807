/* SPDX-License-Identifier: Apache-2.0 */
/* Front-to-back blending of a tile (Kerbl et al. 2023), organised for vectors.
 *
 * A tile is sixteen 4x4 blocks, one vector each. The tile's list of splats is processed in chunks: for every splat of
 * a chunk the blocks that it can change are found at once (the exact test of tiles.h, one lane per block) and
 * appended to a list of (splat, block) pairs, which one loop then blends. Neighbouring pairs mostly have different
 * blocks, so that the processor overlaps the chains of transmittance of several blocks. Stopped pixels need no mask:
 * their transmittance is stored negative, so that the test against the stop threshold fails for every later splat. */
#include "blend.h"

/* Splats of a chunk. Stopped blocks are tested once per chunk: with twice as many splats, 3 % more pairs are blended
 * in vain; with half as many, the inner loops end too often. */
enum { RASTER_CHUNK = 32 };

typedef struct raster_chunk {
  pags_splat splats[RASTER_CHUNK] __attribute__((aligned(64)));
  int32_t pairs[RASTER_CHUNK * PAGS_TILE_BLOCKS + V_LANES]; /* 16 splat + block; 2 beyond the end are read */
} raster_chunk;

/* Copies the splats of a chunk and lists their (splat, block) pairs, in one loop, so that pairs are computed while
 * further splats are being loaded from memory. Returns the number of pairs. masks[i], unless NULL, receives the
 * active blocks that splat i can change. */
V_INLINE int load_chunk(const pags_splat *splats, const pags_entry *entries, int count, const block_corners *corners,
                        unsigned active, raster_chunk *chunk, uint16_t *masks) {
  const vm blocks = m_from_bits(active);
  int pairs = 0;
  vi code = v_to_i(v_iota());
  for (int i = 0; i < count; i++, code = i_add(code, i_set(PAGS_TILE_BLOCKS))) {
    const pags_splat *const s = splats + entries[i].splat;
    chunk->splats[i] = *s;
    const vm touched = m_and(blocks_touched(s, corners), blocks);
    if (masks)
      masks[i] = (uint16_t)m_bits(touched);
    pairs += i_compress(chunk->pairs + pairs, touched, code);
  }
  chunk->pairs[pairs] = chunk->pairs[pairs + 1] = 0;
  return pairs;
}

V_INLINE raster_pair pair_of(const raster_chunk *chunk, raster_state *state, int k) {
  const unsigned code = (unsigned)chunk->pairs[k];
  return (raster_pair){chunk->splats + code / PAGS_TILE_BLOCKS, state + code % PAGS_TILE_BLOCKS};
}

V_INLINE void raster_pairs(raster_state *state, const raster_chunk *chunk, int pairs, raster_how how, int64_t *counts) {
  if (pairs == 0)
    return;
  raster_pipeline pipe = raster_prime(pair_of(chunk, state, 0), pair_of(chunk, state, 1), how.degree);
  int64_t blends = 0, open = 0;
  for (int k = 0; k < pairs; k++) {
    const unsigned lanes = raster_step(&pipe, pair_of(chunk, state, k + 2), how);
    blends += lanes % 32;
    open += lanes / 32;
  }
  if (how.counted && counts) {
    counts[0] += (int64_t)pairs * V_LANES;
    counts[1] += blends;
    counts[2] += open;
  }
}

/* Writes the state of an unfinished block, to be resumed by raster_resume. */
V_INLINE void raster_suspend(const pags_raster_out *out, const raster_state *state, int block, bool extra) {
  const int64_t at = block_at(out->stride, block);
  v_store_4x4(out->rgb[0] + at, out->stride, state->r);
  v_store_4x4(out->rgb[1] + at, out->stride, state->g);
  v_store_4x4(out->rgb[2] + at, out->stride, state->b);
  v_store_4x4(out->transmittance + at, out->stride, state->t);
  if (extra && out->depth) {
    v_store_4x4(out->depth + at, out->stride, state->weight);
    v_store_4x4(out->depth_sum + at, out->stride, state->depth);
    v_store_4x4(out->best + at, out->stride, state->best);
    v_store_4x4((float *)(void *)(out->id + at), out->stride, v_from_bits(state->id));
  }
}

V_INLINE void raster_resume(const pags_raster_out *out, raster_state *state, int block, bool extra) {
  const int64_t at = block_at(out->stride, block);
  state->r = v_load_4x4(out->rgb[0] + at, out->stride);
  state->g = v_load_4x4(out->rgb[1] + at, out->stride);
  state->b = v_load_4x4(out->rgb[2] + at, out->stride);
  state->t = v_load_4x4(out->transmittance + at, out->stride);
  if (extra && out->depth) {
    state->weight = v_load_4x4(out->depth + at, out->stride);
    state->depth = v_load_4x4(out->depth_sum + at, out->stride);
    state->best = v_load_4x4(out->best + at, out->stride);
    state->id = v_bits(v_load_4x4((const float *)(const void *)(out->id + at), out->stride));
  }
}

/* Initialises the blocks. Returns the mask of active ones: those inside of the picture that haven't stopped. */
V_INLINE unsigned raster_begin(raster_state *state, const pags_raster_in *in, const pags_raster_out *out,
                               raster_how how) {
  unsigned active = 0;
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    state[b].px = block_x(b, in->x0);
    state[b].py = block_y(b, in->y0);
    const vm inside = block_inside(state[b].px, state[b].py, in->width, in->height);
    state[b].t = v_select(inside, v_set(1.0f), v_set(-1.0f));
    state[b].r = state[b].g = state[b].b = v_zero();
    if (how.sum)
      state[b].depth = v_zero();
    if (how.extra) {
      state[b].weight = state[b].best = v_zero();
      state[b].id = i_set(-1);
    }
    if (how.hard)
      state[b].hard = v_load_4x4(in->hard + block_at(out->stride, b), out->stride);
    if (in->resume)
      raster_resume(out, state + b, b, how.extra);
    active |= (unsigned)(m_bits(inside) != 0 && !(in->resume && raster_stopped(state + b, how))) << b;
  }
  return active;
}

V_INLINE unsigned raster_tile(const pags_raster_in *in, const pags_raster_out *out, raster_how how) {
  raster_state state[PAGS_TILE_BLOCKS];
  raster_chunk chunk;
  unsigned active = raster_begin(state, in, out, how);
  const block_corners corners = corners_of(in->x0, in->y0);
  int64_t start = 0;
  for (; start < in->count && active; start += RASTER_CHUNK) {
    const int count = in->count - start < RASTER_CHUNK ? (int)(in->count - start) : RASTER_CHUNK;
    uint16_t *const masks = in->block_masks ? in->block_masks + start : NULL;
    const int pairs = load_chunk(in->splats, in->entries + start, count, &corners, active, &chunk, masks);
    /* Prefetches the splats of the next chunk, or of the next tile, while this chunk is blended: they are scattered in
     * memory. */
    const int64_t next = start + RASTER_CHUNK, left_over = in->count - next;
    const pags_entry *const ahead = left_over > 0 ? in->entries + next : in->ahead;
    for (int i = 0; i < RASTER_CHUNK && i < (left_over > 0 ? left_over : in->ahead_count); i++)
      __builtin_prefetch(in->splats + ahead[i].splat);
    raster_pairs(state, &chunk, pairs, how, in->pairs);
    for (unsigned left = active; left; left &= left - 1)
      if (raster_stopped(state + __builtin_ctz(left), how))
        active ^= left & (0u - left); /* the lowest bit */
  }
  if (in->looked_at)
    *in->looked_at += start < in->count ? start : in->count;
  if (in->block_masks && start < in->count)
    memset(in->block_masks + start, 0, (size_t)(in->count - start) * sizeof *in->block_masks);
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
    if (in->unfinished && active)
      raster_suspend(out, state + b, b, how.extra);
    else
      raster_write(out, state + b, b, how);
  return active;
}

/* Each variant is a function of its own, so that nothing is decided in the inner loop. Extra channels and counting
 * share one variant: callers that want one can afford the few per cent of the other, and each function takes seconds
 * to compile. */
#define RASTER_VARIANT(name, exp_degree, extras, stops, hidden)                \
  static unsigned name(const pags_raster_in *in, const pags_raster_out *out) { \
    return raster_tile(in, out,                                                \
                       (raster_how){.degree = exp_degree,                      \
                                    .sum = extras,                             \
                                    .extra = extras,                           \
                                    .counted = extras,                         \
                                    .bounded = stops,                          \
                                    .hard = hidden,                            \
                                    .eps = in->eps});                          \
  }
RASTER_VARIANT(raster_5, 5, false, false, false)
RASTER_VARIANT(raster_5_extra, 5, true, false, false)
RASTER_VARIANT(raster_5_bounded, 5, false, true, false)
RASTER_VARIANT(raster_5_extra_bounded, 5, true, true, false)
RASTER_VARIANT(raster_5_hard, 5, false, false, true)
RASTER_VARIANT(raster_5_extra_hard, 5, true, false, true)
RASTER_VARIANT(raster_3, 3, false, false, false)
RASTER_VARIANT(raster_3_extra, 3, true, false, false)
RASTER_VARIANT(raster_3_bounded, 3, false, true, false)
RASTER_VARIANT(raster_3_extra_bounded, 3, true, true, false)
RASTER_VARIANT(raster_3_hard, 3, false, false, true)
RASTER_VARIANT(raster_3_extra_hard, 3, true, false, true)

/* The variant for training: colour, transmittance and the sum of w z. */
static unsigned raster_5_sum(const pags_raster_in *in, const pags_raster_out *out) {
  return raster_tile(in, out, (raster_how){.degree = 5, .sum = true});
}

unsigned KERNEL(raster)(const pags_raster_in *in, const pags_raster_out *out) {
  typedef unsigned variant(const pags_raster_in *, const pags_raster_out *);
  static variant *const variants[2][2][3] = {
      {{raster_3, raster_3_bounded, raster_3_hard}, {raster_3_extra, raster_3_extra_bounded, raster_3_extra_hard}},
      {{raster_5, raster_5_bounded, raster_5_hard}, {raster_5_extra, raster_5_extra_bounded, raster_5_extra_hard}}};
  const bool exact = in->exp_degree >= 5;
  const int stop = in->hard ? 2 : in->eps > 0.0f;
  if (exact && out->depth_sum && !out->depth && !in->pairs && stop == 0)
    return raster_5_sum(in, out);
  return variants[exact][out->depth_sum || in->pairs][stop](in, out);
}
