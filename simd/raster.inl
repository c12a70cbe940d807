/* Front-to-back blending of a tile (Kerbl et al. 2023), organised for vectors.
 *
 * A tile is sixteen 4x4 blocks, one vector each. The list is taken in chunks: for every splat of a chunk the blocks it can change
 * are found at once (bin.inl's exact test, one lane a block); then block after block runs down its own splats with
 * transmittance and colour in registers. A stopped pixel carries its transmittance with the sign set, so that no separate
 * mask is kept: what would be blended next turns out below the stop threshold by itself. */

enum { RASTER_CHUNK = 256 };

typedef struct raster_state { /* of one block */
  vf t, r, g, b;
  vf depth, weight, best; /* extra channels only */
  vi id;
  vf hard; /* depth beyond which nothing blends; where that is asked for */
} raster_state;

/* The exponent (base 2) of one splat's falloff at 16 pixel centres; below log2(1/255) it does not contribute. */
V_INLINE vf raster_exponent(const pags_splat *s, vf px, vf py, vf *u, vf *v) {
  const vf dx = v_sub(px, v_set(s->x)), dy = v_sub(py, v_set(s->y));
  *u = v_mul(v_set(s->p), v_fnma(v_set(s->h), dy, dx));
  *v = v_mul(v_set(s->w), dy);
  return v_fnma(*u, *u, v_fnma(*v, *v, v_set(s->log2_opacity)));
}

typedef struct raster_cover { /* what a splat takes away, before transmittance */
  vf alpha;
  vm contributes;
} raster_cover;

V_INLINE raster_cover raster_alpha(vf exponent, int degree) {
  return (raster_cover){v_min(v_set(PAGS_ALPHA_MAX), v_exp2(exponent, degree)), v_ge(exponent, v_set(-PAGS_LOG2_255))};
}

/* What one call of the rasteriser does throughout. */
typedef struct raster_how {
  int degree;
  bool sum, extra, counted, bounded, hard; /* sum: of w z, which extra channels take */
  float eps; /* where bounded */
} raster_how;

/* Transmittance never grows, and rounding is monotone: what blends later can't take it above where it was. So a pixel that has stopped,
 * for either reason, would stop there whatever came in between. */
V_INLINE unsigned raster_blend(raster_state *state, const pags_splat *s, raster_cover cover, raster_how how) {
  if (how.hard)
    cover.contributes = m_and(cover.contributes, v_le(v_set(s->z), state->hard));
  const vf next = v_fnma(state->t, cover.alpha, state->t);
  if (how.bounded) /* whatever remains weighs no more than eps: stop. Told while `next` is under way */
    cover.contributes = m_and(cover.contributes, v_gt(state->t, v_set(how.eps)));
  const vm blends = v_ge_and(cover.contributes, next, v_set(PAGS_T_STOP));
  const vf w = v_maskz(blends, v_mul(cover.alpha, state->t));
  state->r = v_fma(w, v_set(s->r), state->r);
  state->g = v_fma(w, v_set(s->g), state->g);
  state->b = v_fma(w, v_set(s->b), state->b);
  if (how.sum)
    state->depth = v_fma(w, v_set(s->z), state->depth);
  if (how.extra) {
    state->weight = v_add(state->weight, w);
    const vm heavier = v_gt(w, state->best);
    state->best = v_select(heavier, w, state->best);
    state->id = i_select(heavier, i_set(s->id), state->id);
  }
  state->t = v_select(blends, next, v_or_sign(cover.contributes, state->t));
  return how.counted ? (unsigned)__builtin_popcount(m_bits(blends)) : 0;
}

/* Three splats are under way at once: the exponent of k + 2, alpha of k + 1, the blending of k. A splat's chain of
 * dependent operations is some 70 cycles long, more than the scheduler's window covers when they are written one after another. */
typedef struct raster_pipeline {
  raster_cover now;
  vf next;
  const pags_splat *splat, *next_splat; /* whose they are */
} raster_pipeline;

V_INLINE raster_pipeline raster_prime(const pags_splat *first, const pags_splat *second, vf px, vf py, int degree) {
  vf u, v;
  return (raster_pipeline){raster_alpha(raster_exponent(first, px, py, &u, &v), degree),
                           raster_exponent(second, px, py, &u, &v), first, second};
}

V_INLINE unsigned raster_step(raster_pipeline *pipe, raster_state *state, const pags_splat *after_next, vf px, vf py,
                              raster_how how) {
  vf u, v;
  const vf exponent = raster_exponent(after_next, px, py, &u, &v);
  const raster_cover cover = raster_alpha(pipe->next, how.degree);
  const unsigned blends = raster_blend(state, pipe->splat, pipe->now, how);
  *pipe = (raster_pipeline){cover, exponent, pipe->next_splat, after_next};
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
  return (block_corners){v_add(v_load(lane_x), v_set((float)x0 + 0.5f)), v_add(v_load(lane_y), v_set((float)y0 + 0.5f))};
}

/* The blocks of the tile that a splat can change. */
V_INLINE uint16_t block_mask(const pags_splat *s, const block_corners *corners, unsigned active) {
  const vf side = v_set(3.0f), x = v_sub(corners->x, v_set(s->x)), y = v_sub(corners->y, v_set(s->y));
  const vf q = quadratic_min(quadratic_of(s), x, v_add(x, side), y, v_add(y, side));
  return (uint16_t)(m_bits(v_ge(v_set(cut_off(s)), q)) & active);
}

/* Copies splats and finds the masks of their blocks, in one loop, so that masks are worked out while splats come from memory. Masks are
 * padded with zeros to whole vectors. */
V_INLINE void load_chunk(const pags_splat *splats, const pags_entry *entries, int count, const block_corners *corners,
                         unsigned active, pags_splat *chunk, uint16_t *masks) {
  for (int i = 0; i < count; i++) {
    const pags_splat *const s = splats + entries[i].splat;
    if (i + 24 < count)
      __builtin_prefetch(splats + entries[i + 24].splat);
    chunk[i] = *s;
    masks[i] = block_mask(s, corners, active);
  }
  memset(masks + count, 0, (size_t)((V_LANES - count % V_LANES) % V_LANES) * sizeof *masks);
}

/* While a chunk's blocks are blended the splats of the next chunk, or of the next tile's first, are fetched into the second-level cache, a
 * sixteenth beside each block: they lie anywhere, and there are too few in flight while they are copied. */
V_INLINE void fetch_ahead(const pags_raster_in *in, int64_t next, int block) {
  enum { PART = RASTER_CHUNK / PAGS_TILE_BLOCKS };
  const bool more = next < in->count;
  const pags_entry *const entries = more ? in->entries + next : in->ahead;
  const int64_t count = more ? in->count - next : in->ahead_count;
  for (int i = PART * block; i < PART * (block + 1) && i < count; i++)
    __builtin_prefetch(in->splats + entries[i].splat, 0, 2);
}

V_INLINE bool raster_stopped(const raster_state *state, raster_how how) {
  unsigned stopped = v_sign_bits(state->t);
  if (how.bounded)
    stopped |= m_bits(v_le(state->t, v_set(how.eps)));
  return stopped == 0xFFFFu;
}

/* Blends the chunk's splats with bit `block` set into one block. Returns the chunk position from which on the block no longer
 * changes (count if it may). */
V_INLINE int raster_block(raster_state *block_state, const pags_splat *chunk, int count, uint16_t *masks, int block, vf px,
                               vf py, raster_how how, int64_t *pairs) {
  int32_t list[RASTER_CHUNK + V_LANES];
  int n = 0;
  vi index = v_to_i(v_iota());
  for (int i = 0; i < count; i += V_LANES, index = i_add(index, i_set(V_LANES)))
    n += i_compress(list + n, m_test_u16(masks + i, block), index);
  if (n == 0)
    return count;
  list[n] = list[n + 1] = list[n - 1]; /* fetched by the pipeline, never blended */
  raster_state state = *block_state;
  raster_pipeline pipe = raster_prime(chunk + list[0], chunk + list[1], px, py, how.degree);
  int64_t blends = 0;
  int stopped_at = count, done = n;
  for (int k = 0; k < n;) {
    const int end = k + 8 < n ? k + 8 : n; /* stopping is looked for every 8 splats */
    for (; k < end; k++)
      blends += raster_step(&pipe, &state, chunk + list[k + 2], px, py, how);
    if (raster_stopped(&state, how)) {
      stopped_at = list[k - 1] + 1;
      done = k;
      break;
    }
  }
  *block_state = state;
  if (how.counted && pairs) {
    pairs[0] += (int64_t)done * V_LANES;
    pairs[1] += blends;
  }
  return stopped_at;
}

static inline int64_t block_at(const pags_raster_out *out, int block) {
  return (int64_t)(block >> 2) * 4 * out->stride + 4 * (block & 3);
}

V_INLINE void raster_write(const pags_raster_out *out, const raster_state *state, int block, raster_how how) {
  const int64_t at = block_at(out, block);
  const vf t = v_abs(state->t);
  v_store_4x4(out->rgb[0] + at, out->stride, v_fma(t, v_set(out->background[0]), state->r));
  v_store_4x4(out->rgb[1] + at, out->stride, v_fma(t, v_set(out->background[1]), state->g));
  v_store_4x4(out->rgb[2] + at, out->stride, v_fma(t, v_set(out->background[2]), state->b));
  v_store_4x4(out->transmittance + at, out->stride, t);
  if (how.sum && out->depth_sum)
    v_store_4x4(out->depth_sum + at, out->stride, state->depth);
  if (how.extra && out->depth) {
    const vm any = v_gt(state->weight, v_zero());
    const vf depth = v_maskz(any, v_div(state->depth, v_select(any, state->weight, v_set(1.0f))));
    v_store_4x4(out->depth + at, out->stride, depth);
    v_store_4x4((float *)(void *)(out->id + at), out->stride, v_from_bits(state->id));
  }
}

/* As it is, to be resumed. */
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

/* Returns the blocks that are to be blended: those inside of the picture that haven't stopped. */
V_INLINE unsigned raster_begin(raster_state *state, const pags_raster_in *in, const pags_raster_out *out, raster_how how) {
  unsigned active = 0;
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    const vm inside = block_inside(block_x(b, in->x0), block_y(b, in->y0), in->width, in->height);
    state[b] = (raster_state){.r = v_zero(), .g = v_zero(), .b = v_zero()};
    state[b].t = v_select(inside, v_set(1.0f), v_set(-1.0f));
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
  unsigned active = raster_begin(state, in, out, how);
  const block_corners corners = corners_of(in->x0, in->y0);
  pags_splat chunk[RASTER_CHUNK];
  uint16_t masks[RASTER_CHUNK];
  int64_t start = 0;
  for (; start < in->count && active; start += RASTER_CHUNK) {
    const int count = in->count - start < RASTER_CHUNK ? (int)(in->count - start) : RASTER_CHUNK;
    load_chunk(in->splats, in->entries + start, count, &corners, active, chunk, masks);
    for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
      if (!(active >> b & 1u))
        continue;
      fetch_ahead(in, start + RASTER_CHUNK, b);
      const int stopped_at =
          raster_block(state + b, chunk, count, masks, b, block_x(b, in->x0), block_y(b, in->y0), how, in->pairs);
      if (stopped_at < count || raster_stopped(state + b, how)) {
        active &= ~(1u << b);
        for (int i = stopped_at; i < count; i++)
          masks[i] = (uint16_t)(masks[i] & ~(1u << b));
      }
    }
    if (in->block_masks)
      memcpy(in->block_masks + start, masks, (size_t)count * sizeof *masks);
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

/* Every choice is a function of its own, so that none is left to the inner loop. Extra channels and counting go together: who
 * asks for either doesn't mind the other's few per cent, and each function costs seconds of compiling. The hard test, which is there to be
 * compared with, always has both. */
#define RASTER_VARIANT(name, degree, extra, bounded, hard)                          \
  static unsigned name(const pags_raster_in *in, const pags_raster_out *out) {      \
    return raster_tile(in, out, (raster_how){degree, extra, extra, extra, bounded, hard, in->eps}); \
  }
RASTER_VARIANT(raster_5, 5, false, false, false)
RASTER_VARIANT(raster_5_extra, 5, true, false, false)
RASTER_VARIANT(raster_3, 3, false, false, false)
RASTER_VARIANT(raster_3_extra, 3, true, false, false)
RASTER_VARIANT(raster_5_bounded, 5, false, true, false)
RASTER_VARIANT(raster_5_extra_bounded, 5, true, true, false)
RASTER_VARIANT(raster_3_bounded, 3, false, true, false)
RASTER_VARIANT(raster_3_extra_bounded, 3, true, true, false)
RASTER_VARIANT(raster_5_hard, 5, true, false, true)
RASTER_VARIANT(raster_3_hard, 3, true, false, true)

/* What training asks for. */
static unsigned raster_5_sum(const pags_raster_in *in, const pags_raster_out *out) {
  return raster_tile(in, out, (raster_how){.degree = 5, .sum = true});
}

static unsigned raster(const pags_raster_in *in, const pags_raster_out *out) {
  typedef unsigned variant(const pags_raster_in *, const pags_raster_out *);
  static variant *const variants[2][2][2] = {{{raster_3, raster_3_bounded}, {raster_3_extra, raster_3_extra_bounded}},
                                             {{raster_5, raster_5_bounded}, {raster_5_extra, raster_5_extra_bounded}}};
  const int exact = in->exp_degree >= 5;
  if (in->hard)
    return (exact ? raster_5_hard : raster_3_hard)(in, out);
  if (exact && out->depth_sum && !out->depth && !in->pairs && !(in->eps > 0.0f))
    return raster_5_sum(in, out);
  return variants[exact][out->depth_sum || in->pairs][in->eps > 0.0f](in, out);
}

#define RASTER_COVERS (-1.0f) /* log2 of the alpha at which an occluder writes its depth */

static void raster_depth(const pags_raster_in *in, float *depth, int64_t stride, float farthest[PAGS_TILE_BLOCKS]) {
  const block_corners corners = corners_of(in->x0, in->y0);
  vf nearest[PAGS_TILE_BLOCKS];
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
    nearest[b] = v_set(INFINITY);
  for (int64_t i = 0; i < in->count; i++) {
    const pags_splat *const s = in->splats + in->entries[i].splat;
    for (unsigned left = block_mask(s, &corners, 0xFFFFu); left; left &= left - 1) {
      const int b = __builtin_ctz(left);
      vf u, v;
      const vm covers = v_ge(raster_exponent(s, block_x(b, in->x0), block_y(b, in->y0), &u, &v), v_set(RASTER_COVERS));
      nearest[b] = v_select(covers, v_min(v_set(s->z), nearest[b]), nearest[b]);
    }
  }
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    v_store_4x4(depth + (int64_t)(b >> 2) * 4 * stride + 4 * (b & 3), stride, nearest[b]);
    float lane[V_LANES];
    v_store(lane, v_select(block_inside(block_x(b, in->x0), block_y(b, in->y0), in->width, in->height), nearest[b], v_zero()));
    farthest[b] = 0.0f;
    for (int k = 0; k < V_LANES; k++)
      farthest[b] = lane[k] > farthest[b] ? lane[k] : farthest[b];
  }
}

/* The same steps with nothing to fetch: the block moves by a hair each step so that no part of one is invariant. */
V_INLINE float roofline_steps(const pags_splat *splats, int64_t steps, int degree) {
  raster_state state = {.t = v_set(1.0f), .r = v_zero(), .g = v_zero(), .b = v_zero()};
  vf px = block_x(0, 0), py = block_y(0, 0);
  const vf hair = v_set(1e-6f);
  const pags_splat s = *splats;
  raster_pipeline pipe = raster_prime(&s, &s, px, py, degree);
  for (int64_t i = 0; i < steps; i++) {
    raster_step(&pipe, &state, &s, px, py, (raster_how){.degree = degree});
    px = v_add(px, hair);
    py = v_add(py, hair);
  }
  return v_sum(state.r) + v_sum(state.g) + v_sum(state.b) + v_sum(state.t);
}
static float roofline(const pags_splat *splats, int64_t steps, int exp_degree) {
  return exp_degree >= 5 ? roofline_steps(splats, steps, 5) : roofline_steps(splats, steps, 3);
}
