/* SPDX-License-Identifier: Apache-2.0 */
/* Projection of 3D Gaussians to the picture plane (EWA: Zwicker et al. 2001; constants of Kerbl et al. 2023).
 *
 *   M = J W R S, 2x3: S = diag(sigma), R the Gaussian's rotation, W = camera_from_model, J the Jacobian of the pinhole
 *   covariance [A B; B C] = M M' + low_pass I
 *   D0 = det(M M') = sum of the squared 2x2 minors of M (Cauchy-Binet), D = D0 + low_pass (A0 + C0) + low_pass^2
 *
 * Every term of D is non-negative, so a needle's determinant keeps its digits where A C - B^2 loses all of them. */

/* Intermediate values of the projection of sixteen Gaussians, which the backward pass computes again and uses. */
typedef struct projected {
  vf x, y, z;       /* camera space */
  vf mx, my;        /* px */
  vf inv_z, tx, ty; /* clamped x/z, y/z */
  vm clamped_x, clamped_y;
  vf sigma[3];
  vf q[4], q_inv_norm;   /* unit quaternion, and 1/|q|, at most 1e15; 0 for a zero quaternion, which is the identity */
  vf rotation[9];        /* R */
  vf j00, j02, j11, j12; /* J */
  vf t[6];               /* J W, 2x3 */
  vf m[6];               /* M */
  vf minor[3];           /* 12, 13, 23 */
  vf a, b, c, d0, d;
  vf compensation;      /* sqrt(max(2.5e-5, D0 / D)), 1 without antialiasing */
  vf opacity;           /* compensated */
  vf raw_opacity, rest; /* sigmoid(logit), and 1 - sigmoid(logit) computed without cancellation */
} projected;

static inline vf quaternion_square(const vf q[4]) {
  return v_fma(q[0], q[0], v_dot3(q[1], q[2], q[3], q[1], q[2], q[3]));
}

static inline void rotation_from_quaternion(projected *s, const float *data, int64_t stride) {
  vf q[4];
  for (int k = 0; k < 4; k++)
    q[k] = v_load(data + (6 + k) * stride);
  vf norm2 = quaternion_square(q), scale = v_set(1.0f);
  const vm ordinary = m_and(v_gt(norm2, v_set(1e-30f)), v_lt(norm2, v_set(1e38f)));
  const bool scaled = m_bits(ordinary) != 0xFFFFu;
  if (scaled) { /* a power of two brings the squares of every length but 0 into the range of floats */
    const vf other = v_select(v_lt(norm2, scale), v_set(0x1p100f), v_set(0x1p-100f));
    scale = v_select(ordinary, scale, other);
    for (int k = 0; k < 4; k++)
      q[k] = v_mul(q[k], scale);
    norm2 = quaternion_square(q);
  }
  const vm none = v_le(norm2, v_zero()); /* false for NaN, which stays NaN: such a row is not drawn */
  s->q_inv_norm = v_select(none, v_zero(), v_div(v_set(1.0f), v_sqrt(v_select(none, v_set(1.0f), norm2))));
  s->q[0] = v_select(none, v_set(1.0f), v_mul(q[0], s->q_inv_norm));
  for (int k = 1; k < 4; k++)
    s->q[k] = v_mul(q[k], s->q_inv_norm);
  if (scaled)
    s->q_inv_norm = v_min(v_mul(s->q_inv_norm, scale), v_set(1e15f));
  const vf w = s->q[0], x = s->q[1], y = s->q[2], z = s->q[3], two = v_set(2.0f), one = v_set(1.0f);
  const vf xx = v_mul(x, x), yy = v_mul(y, y), zz = v_mul(z, z);
  s->rotation[0] = v_fnma(two, v_add(yy, zz), one);
  s->rotation[1] = v_mul(two, v_fnma(w, z, v_mul(x, y)));
  s->rotation[2] = v_mul(two, v_fma(w, y, v_mul(x, z)));
  s->rotation[3] = v_mul(two, v_fma(w, z, v_mul(x, y)));
  s->rotation[4] = v_fnma(two, v_add(xx, zz), one);
  s->rotation[5] = v_mul(two, v_fnma(w, x, v_mul(y, z)));
  s->rotation[6] = v_mul(two, v_fnma(w, y, v_mul(x, z)));
  s->rotation[7] = v_mul(two, v_fma(w, x, v_mul(y, z)));
  s->rotation[8] = v_fnma(two, v_add(xx, yy), one);
}

/* Computes the mean in camera space and in pixels, and the Jacobian J at the clamped direction. The clamp (INRIA's
 * 1.3 tan, around the principal point as in gsplat) bounds how far a Gaussian outside of the picture is stretched
 * into it; the mean itself is not clamped. */
V_INLINE void project_mean(projected *s, scanned *scan, const pags_projection *view, const float *data,
                           int64_t stride) {
  const vf px = v_load(data), py = v_load(data + stride), pz = v_load(data + 2 * stride);
  vf cam[3];
  for (int k = 0; k < 3; k++)
    cam[k] = v_fma(v_set(view->r[3 * k]), px,
                   v_fma(v_set(view->r[3 * k + 1]), py, v_fma(v_set(view->r[3 * k + 2]), pz, v_set(view->t[k]))));
  if (scan)
    scan_mean(scan, view, px, py, pz, cam);
  s->x = cam[0], s->y = cam[1], s->z = cam[2];
  /* A Gaussian behind the near plane is masked later; z = 1 keeps the division finite until then. */
  const vf z = v_select(v_gt(s->z, v_set(view->near_plane)), s->z, v_set(1.0f));
  s->inv_z = v_div(v_set(1.0f), z);
  const vf dx = v_mul(s->x, s->inv_z), dy = v_mul(s->y, s->inv_z);
  s->mx = v_fma(v_set(view->fx), dx, v_set(view->cx));
  s->my = v_fma(v_set(view->fy), dy, v_set(view->cy));
  s->tx = v_clamp(dx, v_set(view->lim_x0), v_set(view->lim_x1));
  s->ty = v_clamp(dy, v_set(view->lim_y0), v_set(view->lim_y1));
  s->clamped_x = m_or(v_lt(dx, v_set(view->lim_x0)), v_gt(dx, v_set(view->lim_x1)));
  s->clamped_y = m_or(v_lt(dy, v_set(view->lim_y0)), v_gt(dy, v_set(view->lim_y1)));
  s->j00 = v_mul(v_set(view->fx), s->inv_z);
  s->j11 = v_mul(v_set(view->fy), s->inv_z);
  s->j02 = v_mul(v_set(-1.0f), v_mul(s->j00, s->tx));
  s->j12 = v_mul(v_set(-1.0f), v_mul(s->j11, s->ty));
}

V_INLINE void project_covariance(projected *s, scanned *scan, const pags_projection *view, const float *data,
                                 int64_t stride) {
  for (int k = 0; k < 3; k++) {
    s->sigma[k] = v_exp(v_load(data + (3 + k) * stride));
    s->t[k] = v_fma(s->j00, scan_turn(scan, view, k), v_mul(s->j02, scan_turn(scan, view, 6 + k)));
    s->t[3 + k] = v_fma(s->j11, scan_turn(scan, view, 3 + k), v_mul(s->j12, scan_turn(scan, view, 6 + k)));
  }
  if (scan)
    scan_shear(scan, view->scan, s->t);
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++)
      s->m[3 * i + k] = v_mul(
          v_dot3(s->t[3 * i], s->t[3 * i + 1], s->t[3 * i + 2], s->rotation[k], s->rotation[3 + k], s->rotation[6 + k]),
          s->sigma[k]);
  const vf *const m = s->m;
  s->minor[0] = v_fnma(m[1], m[3], v_mul(m[0], m[4]));
  s->minor[1] = v_fnma(m[2], m[3], v_mul(m[0], m[5]));
  s->minor[2] = v_fnma(m[2], m[4], v_mul(m[1], m[5]));
  const vf a0 = v_dot3(m[0], m[1], m[2], m[0], m[1], m[2]), c0 = v_dot3(m[3], m[4], m[5], m[3], m[4], m[5]);
  const vf low = v_set(view->low_pass);
  s->b = v_dot3(m[0], m[1], m[2], m[3], m[4], m[5]);
  s->a = v_add(a0, low);
  s->c = v_add(c0, low);
  s->d0 = v_dot3(s->minor[0], s->minor[1], s->minor[2], s->minor[0], s->minor[1], s->minor[2]);
  s->d = v_add(s->d0, v_fma(low, v_add(a0, c0), v_mul(low, low)));
}

static inline void project_opacity(projected *s, const pags_projection *view, const float *data, int64_t stride) {
  const vf logit = v_load(data + 10 * stride);
  const vf fade = v_exp(v_sub(v_zero(), logit));
  s->raw_opacity = v_div(v_set(1.0f), v_add(v_set(1.0f), fade));
  s->rest = v_mul(fade, s->raw_opacity);
  s->compensation = v_set(1.0f);
  if (view->antialiased)
    s->compensation = v_sqrt(v_max(v_set(2.5e-5f), v_div(s->d0, s->d)));
  s->opacity = v_mul(s->raw_opacity, s->compensation);
}

/* `scan`: NULL without a rolling shutter; a constant, so that each has code of its own. */
V_INLINE void project_all(projected *s, scanned *scan, const pags_projection *view, const float *data, int64_t stride) {
  rotation_from_quaternion(s, data, stride);
  project_mean(s, scan, view, data, stride);
  project_covariance(s, scan, view, data, stride);
  project_opacity(s, view, data, stride);
}

#define PAGS_HALF_LOG2E 0.72134752f

/* Computes the range [first, end) of 4-pixel blocks along one axis that have a pixel centre within `extent` of the
 * mean:
 *     first = floor((m - e + 1/2) / 4),  end = floor((m + e - 1/2) / 4) + 1
 * floor(x) being computed as round(x - 1/2). e is slightly larger than `extent`, to cover earlier rounding errors. */
static inline void project_blocks(vm drawn, vf mean, vf extent, float size, int32_t *first, int32_t *end) {
  const vf e = v_fma(extent, v_set(1.00001f), v_fma(v_abs(mean), v_set(1e-6f), v_set(1e-3f)));
  const vf zero = v_zero(), blocks = v_set(ceilf(size * 0.25f)), quarter = v_set(0.25f), half = v_set(0.5f);
  const vf lo = v_mul(v_add(v_sub(mean, e), half), quarter), hi = v_mul(v_sub(v_add(mean, e), half), quarter);
  i_store(first, v_to_i(v_clamp(v_maskz(drawn, v_sub(lo, half)), zero, blocks)));
  i_store(end, v_to_i(v_clamp(v_maskz(drawn, v_add(hi, half)), zero, blocks)));
}

/* Computes the rectangles of blocks outside of which u^2 + v^2 exceeds the cut-off, slack included, of the
 * rasteriser's test of blocks (bin.inl). */
static inline void project_reaches(const projected *s, const pags_projection *view, vf log2_opacity, vf cut, vm drawn,
                                   int lanes, pags_reach *reaches) {
  const vf reach = v_mul(v_add(log2_opacity, v_sub(v_set(PAGS_CUT_SLACK), cut)), v_set(1.0f / PAGS_HALF_LOG2E));
  int32_t x0[V_LANES], x1[V_LANES], y0[V_LANES], y1[V_LANES];
  project_blocks(drawn, s->mx, v_sqrt(v_max(v_mul(reach, s->a), v_zero())), view->width, x0, x1);
  project_blocks(drawn, s->my, v_sqrt(v_max(v_mul(reach, s->c), v_zero())), view->height, y0, y1);
  for (int k = 0; k < lanes; k++)
    reaches[k] = (pags_reach){(uint16_t)x0[k], (uint16_t)x1[k], (uint16_t)y0[k], (uint16_t)y1[k]};
}

typedef struct row_cuts { /* pags_alpha_cut of sixteen rows */
  vf least, cut, floor;
} row_cuts;

/* Antialiasing lowers the opacity of what is smaller than a pixel, and the cut of the part with it, but not below
 * 1/255: otherwise what is far away would vanish. */
static inline row_cuts project_cuts(const pags_projection *view, vf compensation) {
  const pags_alpha_cut *a = &view->alpha;
  row_cuts c = {v_set(a->least), v_set(a->cut), v_set(a->floor)};
  if (!view->antialiased || a->floor == 0.0f)
    return c;
  const vf scale = v_max(compensation, v_set(PAGS_ALPHA_MIN / a->least));
  c.least = v_mul(c.least, scale);
  c.cut = v_add(c.cut, v_log2(scale));
  c.floor = v_mul(c.floor, scale);
  return c;
}

/* The rows of a call that are drawn, without gaps: what projection finds of their splats, half the sizes of their
 * boxes, and their numbers. */
enum { PACKED_ROWS = 256 + V_LANES };
typedef struct packed_splats {
  float x[PACKED_ROWS], y[PACKED_ROWS], p[PACKED_ROWS], h[PACKED_ROWS], w[PACKED_ROWS], log2_opacity[PACKED_ROWS];
  float z[PACKED_ROWS], slope[PACKED_ROWS], cut[PACKED_ROWS], floor[PACKED_ROWS];
  float extent_x[PACKED_ROWS], extent_y[PACKED_ROWS];
  int32_t rows[PACKED_ROWS];
  int count;
} packed_splats;

/* Projects the sixteen rows from `first` on and appends those that are drawn to `out`; returns how many of them are
 * held at mid-exposure. */
V_INLINE int project_rows(bool rolls, const pags_projection *view, const float *data, int64_t stride,
                          const float *factor, int first, int count, uint32_t *keys, pags_reach *reaches,
                          packed_splats *out) {
  projected s;
  scanned scan;
  project_all(&s, rolls ? &scan : NULL, view, data + first, stride);
  if (factor)
    s.opacity = v_mul(s.opacity, v_load(factor + first));
  const row_cuts cuts = project_cuts(view, s.compensation);
  const vf raw = v_log2(v_max(s.opacity, v_set(1e-30f)));
  const vf l = v_add(factor ? raw : v_min(raw, v_zero()), v_set(view->alpha.lift));
  /* Half size of the box in which it is blended (the opacity-aware bound of StopThePop, not 3 sigma). */
  const vf reach = v_mul(v_sub(l, cuts.cut), v_set(1.0f / PAGS_HALF_LOG2E));
  const vf extent_x = v_sqrt(v_max(v_mul(reach, s.a), v_zero()));
  const vf extent_y = v_sqrt(v_max(v_mul(reach, s.c), v_zero()));
  /* Comparisons are false for NaN, so a row with any non-finite value that matters drops out here. */
  const vf huge = v_set(1e18f);
  vm drawn = m_and(v_gt(s.z, v_set(view->near_plane)), v_ge(s.opacity, cuts.least));
  for (int k = 0; k < view->clip_count; k++) {
    const float *const p = view->clips[k];
    const vf x = rolls ? scan.c0[0] : s.x, y = rolls ? scan.c0[1] : s.y, z = rolls ? scan.c0[2] : s.z;
    const vf inside = v_add(v_dot3(v_set(p[0]), v_set(p[1]), v_set(p[2]), x, y, z), v_set(p[3]));
    drawn = m_and(drawn, v_ge(inside, v_zero()));
  }
  drawn = m_and(drawn, m_and(v_lt(s.a, huge), v_lt(s.c, huge)));
  drawn = m_and(drawn, m_and(v_gt(s.d, v_zero()), v_lt(s.d, v_set(1e36f))));
  drawn = m_and(drawn, m_and(v_gt(v_add(s.mx, extent_x), v_zero()), v_lt(v_sub(s.mx, extent_x), v_set(view->width))));
  drawn = m_and(drawn, m_and(v_gt(v_add(s.my, extent_y), v_zero()), v_lt(v_sub(s.my, extent_y), v_set(view->height))));
  drawn = m_and(drawn, m_and(v_lt(s.z, huge), m_and(v_lt(v_abs(s.mx), huge), v_lt(v_abs(s.my), huge))));
  drawn = m_and(drawn, m_first(count - first));

  const int lanes = count - first < V_LANES ? count - first : V_LANES;
  int32_t key[V_LANES];
  i_store(key, i_select(drawn, v_bits(s.z), i_set(-1)));
  memcpy(keys + first, key, (size_t)lanes * sizeof *keys);
  if (m_bits(drawn) == 0)
    return 0;
  if (reaches)
    project_reaches(&s, view, l, cuts.cut, drawn, lanes, reaches + first);

  const vf inv_c = v_div(v_set(1.0f), s.c);
  const v_packing packing = v_packing_of(drawn);
  const int at = out->count;
  v_pack(out->x + at, packing, s.mx);
  v_pack(out->y + at, packing, s.my);
  v_pack(out->p + at, packing, v_sqrt(v_div(v_mul(v_set(PAGS_HALF_LOG2E), s.c), s.d)));
  v_pack(out->h + at, packing, v_mul(s.b, inv_c));
  v_pack(out->w + at, packing, v_sqrt(v_mul(v_set(PAGS_HALF_LOG2E), inv_c)));
  v_pack(out->log2_opacity + at, packing, l);
  v_pack(out->z + at, packing, s.z);
  v_pack(out->slope + at, packing, v_div(s.b, s.a));
  v_pack(out->cut + at, packing, cuts.cut);
  v_pack(out->floor + at, packing, cuts.floor);
  v_pack(out->extent_x + at, packing, extent_x);
  v_pack(out->extent_y + at, packing, extent_y);
  out->count += i_compress(out->rows + out->count, drawn, i_add(v_to_i(v_iota()), i_set(first)));
  return rolls ? __builtin_popcount(m_bits(drawn) & ~m_bits(scan.found)) : 0;
}

/* Whether the shutter rolls is a constant, so that a global one has code of its own. */
V_INLINE int pack_rows(bool rolls, const pags_projection *view, const float *data, int64_t stride, const float *factor,
                       int count, uint32_t *keys, pags_reach *reaches, packed_splats *packed) {
  int held = 0;
  packed->count = 0;
  for (int first = 0; first < count; first += V_LANES)
    held += project_rows(rolls, view, data, stride, factor, first, count, keys, reaches, packed);
  return held;
}

static int project(const pags_projection *view, const float *data, int64_t stride, const float *factor, int count,
                   pags_splat *splats, uint32_t *keys, bool tiles, pags_tile_box *boxes, pags_reach *reaches) {
  packed_splats packed;
  const int held = view->scan ? pack_rows(true, view, data, stride, factor, count, keys, reaches, &packed)
                              : pack_rows(false, view, data, stride, factor, count, keys, reaches, &packed);

  const int tiles_x = ((int)view->width + PAGS_TILE - 1) / PAGS_TILE,
            tiles_y = ((int)view->height + PAGS_TILE - 1) / PAGS_TILE;
  for (int first = 0; first < packed.count; first += V_LANES) {
    const int n = packed.count - first < V_LANES ? packed.count - first : V_LANES;
    const int32_t *const rows = packed.rows + first;
    const vm there = m_first(n);
#define PACKED(member) v_maskz(there, v_load(packed.member + first))
    const vf none = v_zero();
    vf fields[] = {PACKED(x),     PACKED(y), PACKED(p), PACKED(h), PACKED(w),     PACKED(log2_opacity),
                   none,          none,      none,      PACKED(z), PACKED(slope), PACKED(cut),
                   PACKED(floor), none,      none,      none};
    boxes_found found = {.large = 0};
    if (tiles) {
      found = find_boxes(fields, PACKED(extent_x), PACKED(extent_y), rows, n, tiles_x, tiles_y, boxes);
      fields[SPLAT_AT(tiles)] = v_from_bits(found.tiles);
    } else {
      for (int k = 0; k < n; k++)
        boxes[rows[k]].extent[0] = packed.extent_x[first + k], boxes[rows[k]].extent[1] = packed.extent_y[first + k];
    }
#undef PACKED
    v_transpose(fields);
    for (int k = 0; k < n; k++)
      store_splat(splats + rows[k], fields[k]);
    large_boxes(found.large, rows, splats, boxes);
  }
  return held;
}
