/* SPDX-License-Identifier: Apache-2.0 */
/* Front-to-back blending of splats (Kerbl et al. 2023) over the sixteen pixels of a 4x4 block, one vector: alpha,
 * colour and transmittance, a software pipeline over (splat, block) pairs, and the blocks of a tile. */
#ifndef PAGS_SIMD_BLEND_H
#define PAGS_SIMD_BLEND_H

#include "tiles.h"

typedef struct raster_state { /* of one block */
  vf px, py;                  /* pixel centres */
  vf t, r, g, b;
  vf depth, weight, best; /* extra channels only */
  vi id;
  vf hard;   /* only if raster_how.hard: depth beyond which no splat is blended */
  vf marked; /* only if raster_how.marks: sum of the weights of marked splats */
} raster_state;

/* The exponent (base 2) of one splat's falloff at 16 pixel centres; below its cut it does not contribute. */
V_INLINE vf raster_exponent(const pags_splat *s, vf px, vf py, vf *u, vf *v) {
  const vf dx = v_sub(px, v_set(s->x)), dy = v_sub(py, v_set(s->y));
  *u = v_mul(v_set(s->p), v_fnma(v_set(s->h), dy, dx));
  *v = v_mul(v_set(s->w), dy);
  return v_fnma(*u, *u, v_fnma(*v, *v, v_set(s->log2_opacity)));
}

/* Returns alpha (pags_alpha_cut), at most 0.99, from the exponent; 0 where that is below the cut, so that the splat
 * does not contribute. */
V_INLINE vf raster_alpha(const pags_splat *s, vf exponent, int degree) {
  const vf alpha = v_sub(v_exp2(exponent, degree), v_set(s->floor));
  return v_maskz(v_ge(exponent, v_set(s->cut)), v_min(v_set(PAGS_ALPHA_MAX), alpha));
}

/* The variant of the rasteriser: constant within each function made from it, so that unused code is removed.
 *   sum      the sum of w z, which `extra` needs, too
 *   extra    depth, sum of weights, and the id of the splat with the largest weight
 *   counted  blended lanes, and those that hadn't stopped before, are counted
 *   bounded  pixels stop at transmittance eps
 *   hard     splats behind a given depth plane are not blended */
typedef struct raster_how {
  int degree; /* of the polynomial for 2^x: 3 or 5 */
  bool sum, extra, counted, bounded, hard;
  float eps;            /* if bounded */
  const uint8_t *marks; /* per id, 0 or 1; NULL: no sum of marked weights */
  int64_t mark_count;
} raster_how;

/* Blends one splat over the sixteen pixels of a block. Returns, if how.counted, the number of pixels where it was
 * blended plus 32 times the number that had not stopped before; else 0.
 *
 * Transmittance never grows, and rounding is monotone. So a pixel whose transmittance has fallen below a threshold
 * stays below it, and it stops whatever splats are blended in between. */
V_INLINE unsigned raster_blend(raster_state *state, const pags_splat *s, vf alpha, raster_how how) {
  const vf t = state->t;
  if (how.hard)
    alpha = v_maskz(v_le(v_set(s->z), state->hard), alpha);
  if (how.bounded) /* all remaining splats together weigh no more than eps: stop */
    alpha = v_maskz(v_gt(t, v_set(how.eps)), alpha);
  const vf next = v_fnma(t, alpha, t);
  const vm goes_on = v_ge(next, v_set(PAGS_T_STOP));
  const vf w = v_maskz(goes_on, v_mul(alpha, t));
  state->r = v_fma(w, v_set(s->r), state->r);
  state->g = v_fma(w, v_set(s->g), state->g);
  state->b = v_fma(w, v_set(s->b), state->b);
  if (how.sum)
    state->depth = v_fma(w, v_set(s->z), state->depth);
  if (how.marks)
    state->marked =
        v_fma(w, v_set(s->id >= 0 && s->id < how.mark_count ? (float)how.marks[s->id] : 0.0f), state->marked);
  if (how.extra) {
    state->weight = v_add(state->weight, w);
    const vm heavier = v_gt(w, state->best);
    state->best = v_select(heavier, w, state->best);
    state->id = i_select(heavier, i_set(s->id), state->id);
  }
  state->t = v_select(goes_on, next, v_minus_abs(t));
  if (!how.counted)
    return 0;
  const vm open = v_gt(t, v_set(how.bounded ? how.eps : 0.0f));
  return (unsigned)__builtin_popcount(m_bits(v_gt(w, v_zero()))) + 32 * (unsigned)__builtin_popcount(m_bits(open));
}

/* A splat and a block that it can change. */
typedef struct raster_pair {
  const pags_splat *splat;
  raster_state *block;
} raster_pair;

V_INLINE vf pair_exponent(raster_pair pair) {
  vf u, v;
  return raster_exponent(pair.splat, pair.block->px, pair.block->py, &u, &v);
}

/* A software pipeline of three pairs: a step computes the exponent of pair k + 2, alpha of pair k + 1, and blends
 * pair k. The chain of dependent operations of one pair takes some 70 cycles, more than the processor's out-of-order
 * window covers if the pairs are computed one after another. */
typedef struct raster_pipeline {
  vf now, next; /* alpha of `pair`, exponent of `next_pair` */
  raster_pair pair, next_pair;
} raster_pipeline;

V_INLINE raster_pipeline raster_prime(raster_pair first, raster_pair second, int degree) {
  return (raster_pipeline){raster_alpha(first.splat, pair_exponent(first), degree), pair_exponent(second), first,
                           second};
}

V_INLINE unsigned raster_step(raster_pipeline *pipe, raster_pair after_next, raster_how how) {
  const vf exponent = pair_exponent(after_next);
  const vf alpha = raster_alpha(pipe->next_pair.splat, pipe->next, how.degree);
  const unsigned blends = raster_blend(pipe->pair.block, pipe->pair.splat, pipe->now, how);
  *pipe = (raster_pipeline){alpha, exponent, pipe->next_pair, after_next};
  return blends;
}

static inline vf block_x(int block, int x0) {
  static const float lane[V_LANES] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
  return v_add(v_load(lane), v_set((float)(x0 + 4 * (block & 3)) + 0.5f));
}
static inline vf block_y(int block, int y0) {
  static const float lane[V_LANES] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
  return v_add(v_load(lane), v_set((float)(y0 + 4 * (block >> 2)) + 0.5f));
}
static inline vm block_inside(vf px, vf py, int width, int height) {
  return m_and(v_lt(px, v_set((float)width)), v_lt(py, v_set((float)height)));
}

typedef struct block_corners { /* centres of the blocks' top left pixels */
  vf x, y;
} block_corners;

static inline block_corners corners_of(int x0, int y0) {
  static const float lane_x[V_LANES] = {0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12};
  static const float lane_y[V_LANES] = {0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12};
  return (block_corners){v_add(v_load(lane_x), v_set((float)x0 + 0.5f)),
                         v_add(v_load(lane_y), v_set((float)y0 + 0.5f))};
}

/* The blocks of the tile that a splat can change. */
V_INLINE vm blocks_touched(const pags_splat *s, const block_corners *corners) {
  const vf side = v_set(3.0f), x = v_sub(corners->x, v_set(s->x)), y = v_sub(corners->y, v_set(s->y));
  const vf q = quadratic_min(quadratic_of(s), x, v_add(x, side), y, v_add(y, side));
  return v_ge(v_set(cut_off(s)), q);
}
static inline uint16_t block_mask(const pags_splat *s, const block_corners *corners) {
  return (uint16_t)m_bits(blocks_touched(s, corners));
}

/* Returns whether all sixteen pixels have stopped. */
V_INLINE bool raster_stopped(const raster_state *state, raster_how how) {
  return m_bits(v_le(state->t, v_set(how.bounded ? how.eps : 0.0f))) == 0xFFFFu;
}

/* Where a block begins in a plane, from the tile's top left pixel. */
static inline int64_t block_at(int64_t stride, int block) {
  return (int64_t)(block >> 2) * 4 * stride + 4 * (block & 3);
}

/* A tile whose pairs are walked again: transmittance, what lies behind (raster_backward.c), the gradient by rgb and the
 * sum of w z, and the pixel centres. */
typedef struct drawn_tile {
  vf t[PAGS_TILE_BLOCKS], behind[PAGS_TILE_BLOCKS];
  vf g[4][PAGS_TILE_BLOCKS];
  vf px[PAGS_TILE_BLOCKS], py[PAGS_TILE_BLOCKS];
} drawn_tile;

/* Sets the pixel centres of block b and its transmittance, 1 inside of the picture, else 0; returns which pixels are
 * inside. */
V_INLINE vm begin_block(drawn_tile *tile, const pags_drawn_tile *in, int b) {
  tile->px[b] = block_x(b, in->x0);
  tile->py[b] = block_y(b, in->y0);
  const vm inside = block_inside(tile->px[b], tile->py[b], in->width, in->height);
  tile->t[b] = v_maskz(inside, v_set(1.0f));
  return inside;
}

/* The first float of a pair's slot, of `floats` floats. */
V_INLINE float *slot_of(const pags_drawn_tile *in, int64_t i, int floats) {
  return in->slots + (in->slot_start[in->entries[i].splat] + in->entries[i].rank) * floats;
}

/* Writes the finished block: colour over the background, and the extra channels. If how.bounded, the pixels whose
 * transmittance is at most eps become opaque: the light from the unvisited splats behind is replaced by the mean colour
 * of those in front. */
V_INLINE void raster_write(const pags_raster_out *out, const raster_state *state, int block, raster_how how) {
  const int64_t at = block_at(out->stride, block);
  raster_state s = *state;
  s.t = v_abs(s.t);
  if (how.bounded) {
    const vf one = v_set(1.0f);
    const vm closed = v_le(s.t, v_set(how.eps));
    const vf scale = v_select(closed, v_div(one, v_sub(one, s.t)), one);
    s.r = v_mul(s.r, scale);
    s.g = v_mul(s.g, scale);
    s.b = v_mul(s.b, scale);
    s.t = v_select(closed, v_zero(), s.t);
  }
  v_store_4x4(out->rgb[0] + at, out->stride, v_fma(s.t, v_set(out->background[0]), s.r));
  v_store_4x4(out->rgb[1] + at, out->stride, v_fma(s.t, v_set(out->background[1]), s.g));
  v_store_4x4(out->rgb[2] + at, out->stride, v_fma(s.t, v_set(out->background[2]), s.b));
  v_store_4x4(out->transmittance + at, out->stride, s.t);
  if (how.sum && out->depth_sum)
    v_store_4x4(out->depth_sum + at, out->stride, state->depth);
  if (how.extra && out->depth) {
    const vm any = v_gt(state->weight, v_zero());
    const vf depth = v_maskz(any, v_div(state->depth, v_select(any, state->weight, v_set(1.0f))));
    v_store_4x4(out->depth + at, out->stride, depth);
    v_store_4x4((float *)(void *)(out->id + at), out->stride, v_from_bits(state->id));
  }
}

#endif
