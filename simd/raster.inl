/* SPDX-License-Identifier: Apache-2.0 */
/* Front-to-back blending of a tile (Kerbl et al. 2023), organised for vectors.
 *
 * A tile is sixteen 4x4 blocks, one vector each. The tile's list of splats is processed in chunks: for every splat of
 * a chunk the blocks that it can change are found at once (the exact test of bin.inl, one lane per block) and
 * appended to a list of (splat, block) pairs, which one loop then blends. Neighbouring pairs mostly have different
 * blocks, so that the processor overlaps the chains of transmittance of several blocks. Stopped pixels need no mask:
 * their transmittance is stored negative, so that the test against the stop threshold fails for every later splat. */

/* Splats of a chunk. Once per chunk it is tested which blocks have stopped: with twice as many splats, three per cent
 * more pairs are blended in vain; with half as many, the inner loops end too often. */
enum { RASTER_CHUNK = 32 };

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

/* Blends one splat over the sixteen pixels of a block. Returns, if how.counted, at how many it was blended, and 32
 * times as many as hadn't stopped before; else 0.
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

/* Prefetches the splats of the next chunk, or of the next tile, while this chunk is blended: they are scattered in
 * memory. */
V_INLINE void fetch_ahead(const pags_raster_in *in, int64_t next) {
  const bool more = next < in->count;
  const pags_entry *const entries = more ? in->entries + next : in->ahead;
  const int64_t count = more ? in->count - next : in->ahead_count;
  for (int i = 0; i < RASTER_CHUNK && i < count; i++)
    __builtin_prefetch(in->splats + entries[i].splat);
}

/* Returns whether all sixteen pixels have stopped. */
V_INLINE bool raster_stopped(const raster_state *state, raster_how how) {
  return m_bits(v_le(state->t, v_set(how.bounded ? how.eps : 0.0f))) == 0xFFFFu;
}

static inline int64_t block_at(const pags_raster_out *out, int block) {
  return (int64_t)(block >> 2) * 4 * out->stride + 4 * (block & 3);
}

/* If how.bounded, lets the finished pixels whose transmittance is at most eps be opaque: what of the light comes from
 * behind, which wasn't looked at, gets the mean colour of what lies in front. */
V_INLINE raster_state raster_close(const raster_state *state, raster_how how) {
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
  return s;
}

/* Writes the finished block: colour over the background, and the extra channels. */
V_INLINE void raster_write(const pags_raster_out *out, const raster_state *state, int block, raster_how how) {
  const int64_t at = block_at(out, block);
  const raster_state s = raster_close(state, how);
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

/* Writes the state of an unfinished block, to be resumed by raster_resume. */
V_INLINE void raster_suspend(const pags_raster_out *out, const raster_state *state, int block, bool extra) {
  const int64_t at = block_at(out, block);
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
  const int64_t at = block_at(out, block);
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
      state[b].hard = v_load_4x4(in->hard + block_at(out, b), out->stride);
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
    fetch_ahead(in, start + RASTER_CHUNK);
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

static unsigned raster(const pags_raster_in *in, const pags_raster_out *out) {
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

#define RASTER_COVERS 0.5f /* the alpha from which a splat counts as an occluder in the depth pre-pass */

static void raster_depth(const pags_raster_in *in, float *depth, int64_t stride, float farthest[PAGS_TILE_BLOCKS]) {
  const block_corners corners = corners_of(in->x0, in->y0);
  vf nearest[PAGS_TILE_BLOCKS];
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
    nearest[b] = v_set(INFINITY);
  for (int64_t i = 0; i < in->count; i++) {
    const pags_splat *const s = in->splats + in->entries[i].splat;
    const vf least = v_log2(v_set(RASTER_COVERS + s->floor));
    for (unsigned left = block_mask(s, &corners); left; left &= left - 1) {
      const int b = __builtin_ctz(left);
      vf u, v;
      const vm covers = v_ge(raster_exponent(s, block_x(b, in->x0), block_y(b, in->y0), &u, &v), least);
      nearest[b] = v_select(covers, v_min(v_set(s->z), nearest[b]), nearest[b]);
    }
  }
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    v_store_4x4(depth + (int64_t)(b >> 2) * 4 * stride + 4 * (b & 3), stride, nearest[b]);
    float lane[V_LANES];
    v_store(lane, v_select(block_inside(block_x(b, in->x0), block_y(b, in->y0), in->width, in->height), nearest[b],
                           v_zero()));
    farthest[b] = 0.0f;
    for (int k = 0; k < V_LANES; k++)
      farthest[b] = lane[k] > farthest[b] ? lane[k] : farthest[b];
  }
}

/* Measures the peak rate of blending: the steps of the rasteriser with all data in registers. The pixel centres move
 * by 1e-6 each step, so that the compiler cannot move any part of a step out of the loop. */
V_INLINE float roofline_steps(const pags_splat *splats, int64_t steps, int degree) {
  const pags_splat s = *splats;
  raster_state state;
  const raster_pair pair = {&s, &state};
  state.px = block_x(0, 0);
  state.py = block_y(0, 0);
  state.t = v_set(1.0f);
  state.r = state.g = state.b = v_zero();
  const vf hair = v_set(1e-6f);
  raster_pipeline pipe = raster_prime(pair, pair, degree);
  for (int64_t i = 0; i < steps; i++) {
    raster_step(&pipe, pair, (raster_how){.degree = degree});
    state.px = v_add(state.px, hair);
    state.py = v_add(state.py, hair);
  }
  return v_sum(state.r) + v_sum(state.g) + v_sum(state.b) + v_sum(state.t);
}
static float roofline(const pags_splat *splats, int64_t steps, int exp_degree) {
  return exp_degree >= 5 ? roofline_steps(splats, steps, 5) : roofline_steps(splats, steps, 3);
}
