/* SPDX-License-Identifier: Apache-2.0 */
/* The training loss and its gradient for a band of rows of one channel: L1 and D-SSIM (Wang et al. 2004), both as
 * sums over the pixels of each row, weighted per pixel.
 *
 *   S = A1 A2 / (B1 B2),  A1 = 2 mx my + C1,  A2 = 2 s_xy + C2,  B1 = mx^2 + my^2 + C1,  B2 = s_xx + s_yy + C2
 *
 * with mx = G*x, my = G*y, s_xy = G*(xy) - mx my, s_xx + s_yy = G*(xx + yy) - mx^2 - my^2; G* is the 11x11 Gaussian of
 * sigma 1.5 with zeros outside. S needs only the sum of s_xx and s_yy, so four blurs suffice. G being symmetric,
 *
 *   d(sum S)/dx = G*(dS/dmx) + 2 x G*(dS/dq) + y G*(dS/dp),  q = G*(xx + yy), p = G*(xy)
 *   dS/dp = 2 A1 / (B1 B2),  dS/dq = -S / B2,  dS/dmx = 2 (my (A2 - A1) - mx S (B2 - B1)) / (B1 B2)
 *
 * Rows pass through ring buffers that stay in the cache: x and y are loaded; blurred along the columns, two rows at a
 * time so that each load serves both; blurred along the row; the three derivatives are computed from them, and
 * blurred along the columns and along the row; these give the gradient. A band computes the derivatives of 5 further
 * rows on either side and loads 10. */
#include "kernel.h"

enum {
  LOSS_RADIUS = 5,
  LOSS_TAPS = 11,
  LOSS_WINDOW = LOSS_TAPS + 1, /* rows that the blurs of two neighbouring rows depend on */
  LOSS_RING = 16,
  LOSS_MARGIN = 16 /* zeros on either side of a row */
};

/* exp(-d^2 / 4.5) / sum, d = 0..5 */
static const float loss_weight[LOSS_RADIUS + 1] = {0.266011725f,  0.213005538f,   0.10936069f,
                                                   0.0360007721f, 0.00759875814f, 0.00102838008f};

typedef struct loss_state {
  const pags_loss_rows *io;
  int64_t pitch;        /* floats from row to row of the scratch */
  float *x, *y;         /* rings of LOSS_RING rows of prediction and target, 0 where masked */
  float *derivative[3]; /* rings of dS/dmx, dS/dq, dS/dp, times ssim_scale, the mask and the pixel's weight */
  float *sums[2][4];    /* two rows of up to four quantities blurred along the columns, not yet along the row */
} loss_state;

/* The sums of a row of the band. */
static inline double *loss_sums(const loss_state *s, int row) {
  return s->io->sums[row - s->io->begin];
}

static inline float *loss_ring(const loss_state *s, float *ring, int row) {
  return ring + (int64_t)((unsigned)row % LOSS_RING) * s->pitch;
}

/* The width in whole vectors: what is computed of a row, however long the stride is. */
static inline int64_t loss_padded(const pags_loss_rows *io) {
  return ((int64_t)io->width + V_LANES - 1) / V_LANES * V_LANES;
}

static inline vm loss_counted(const pags_loss_rows *io, int row, int column) {
  const vm inside = m_first(io->width - column);
  if (!io->mask)
    return inside;
  return m_and(inside, v_gt(v_load_u8(io->mask + row * io->stride + column), v_zero()));
}

/* Returns by how much more than once each pixel counts: gain * emphasis. */
static inline vf loss_more(const pags_loss_rows *io, int row, int column) {
  return io->emphasis ? v_mul(v_load_u8(io->emphasis + row * io->stride + column), v_set(io->gain)) : v_zero();
}

/* Loads a row of prediction and target into the rings. For rows of the band, also sums |x - y| and the squares of
 * x - y with x clamped to [0, 1], as PSNR needs them. */
static void loss_load(loss_state *s, int row) {
  const pags_loss_rows *io = s->io;
  float *x = loss_ring(s, s->x, row), *y = loss_ring(s, s->y, row);
  if (row < 0 || row >= io->height) {
    memset(x, 0, (size_t)io->stride * sizeof *x);
    memset(y, 0, (size_t)io->stride * sizeof *y);
    return;
  }
  const vf scale = v_set(1.0f / 255.0f), gain = v_set(io->exposure[0]), offset = v_set(io->exposure[1]);
  vf l1 = v_zero(), squared = v_zero(), more = v_zero();
  for (int i = 0; i < io->width; i += V_LANES) {
    const vm use = loss_counted(io, row, i);
    /* Bounded so that products of four values stay finite; a NaN becomes the lower bound. */
    const vf exposed = v_fma(v_load(io->prediction + row * io->stride + i), gain, offset);
    const vf bounded = v_min(v_max(exposed, v_set(-PAGS_COLOUR_MAX)), v_set(PAGS_COLOUR_MAX));
    const vf a = v_maskz(use, bounded);
    const vf b = v_maskz(use, v_mul(v_load_u8(io->target + row * io->stride + i), scale));
    const vf d = v_sub(v_clamp(a, v_zero(), v_set(1.0f)), b);
    v_store(x + i, a);
    v_store(y + i, b);
    l1 = v_add(l1, v_abs(v_sub(a, b)));
    more = v_fma(loss_more(io, row, i), v_abs(v_sub(a, b)), more);
    squared = v_fma(d, d, squared);
  }
  if (row >= io->begin && row < io->end) {
    double *const sums = loss_sums(s, row);
    sums[PAGS_LOSS_L1] = (double)v_sum(l1);
    sums[PAGS_LOSS_MORE_L1] = (double)v_sum(more);
    sums[PAGS_LOSS_SQUARED] = (double)v_sum(squared);
  }
}

/* Blurs `count` quantities of the rows of a ring along the columns, for rows `row` and `row` + 1. The four moments x,
 * y, xx + yy and xy are made from x and y; of three, each has a ring of its own. Rings are `apart` floats apart. */
V_INLINE void loss_down(const loss_state *s, float *ring, int64_t apart, int count, int row) {
  vf w[LOSS_RADIUS + 1];
  const float *rows[LOSS_WINDOW];
  for (int k = 0; k <= LOSS_RADIUS; k++)
    w[k] = v_set(loss_weight[k]);
  for (int k = 0; k < LOSS_WINDOW; k++)
    rows[k] = loss_ring(s, ring, row - LOSS_RADIUS + k);
  for (int64_t i = 0; i < s->io->width; i += V_LANES) {
    vf sum[2][4];
    for (int j = 0; j < count; j++)
      sum[0][j] = sum[1][j] = v_zero();
#pragma GCC unroll 12
    for (int k = 0; k < LOSS_WINDOW; k++) {
      const vf a = v_load(rows[k] + i), b = v_load(rows[k] + apart + i);
      const vf c = count == 4 ? v_fma(a, a, v_mul(b, b)) : v_load(rows[k] + 2 * apart + i);
      const vf value[4] = {a, b, c, count == 4 ? v_mul(a, b) : v_zero()};
      for (int j = 0; j < count; j++) {
        if (k < LOSS_TAPS)
          sum[0][j] = v_fma(w[k < LOSS_RADIUS ? LOSS_RADIUS - k : k - LOSS_RADIUS], value[j], sum[0][j]);
        if (k > 0)
          sum[1][j] = v_fma(w[k <= LOSS_RADIUS ? LOSS_RADIUS - k + 1 : k - 1 - LOSS_RADIUS], value[j], sum[1][j]);
      }
    }
    for (int j = 0; j < count; j++) {
      v_store(s->sums[0][j] + i, sum[0][j]);
      v_store(s->sums[1][j] + i, sum[1][j]);
    }
  }
}

/* The blur along a row: eleven taps, adding the two values of equal weight first. */
static inline vf loss_along(const float *row) {
  vf sum = v_mul(v_set(loss_weight[0]), v_load(row));
#pragma GCC unroll 5
  for (int k = 1; k <= LOSS_RADIUS; k++)
    sum = v_fma(v_set(loss_weight[k]), v_add(v_load(row - k), v_load(row + k)), sum);
  return sum;
}

/* Computes SSIM and the three derivatives of one row from its sums along the columns; sums SSIM for rows of the
 * band. */
static void loss_differentiate(loss_state *s, int row, float *const sums[4]) {
  const pags_loss_rows *io = s->io;
  float *out[3];
  for (int j = 0; j < 3; j++)
    out[j] = loss_ring(s, s->derivative[j], row);
  const vf c1 = v_set(0.01f * 0.01f), c2 = v_set(0.03f * 0.03f), two = v_set(2.0f), half = v_set(0.5f);
  const vf scale = v_set(io->ssim_scale);
  vf total = v_zero(), more = v_zero();
  for (int i = 0; i < io->width; i += V_LANES) {
    const vf mx = loss_along(sums[0] + i), my = loss_along(sums[1] + i);
    const vf q = loss_along(sums[2] + i), p = loss_along(sums[3] + i);
    const vf cross = v_mul(mx, my), power = v_fma(mx, mx, v_mul(my, my));
    /* Variances can't be negative nor a covariance exceed them, but rounding of large predictions can make them so. */
    const vf variance = v_max(v_sub(q, power), v_zero()), bound = v_mul(half, variance);
    const vf covariance = v_clamp(v_sub(p, cross), v_sub(v_zero(), bound), bound);
    const vf a1 = v_fma(two, cross, c1), a2 = v_fma(two, covariance, c2);
    const vf b1 = v_add(power, c1), b2 = v_add(variance, c2);
    const vf inverse = v_div(v_set(1.0f), v_mul(b1, b2));
    const vf ssim = v_mul(v_mul(a1, a2), inverse);
    const vm use = loss_counted(io, row, i);
    const vf extra = loss_more(io, row, i), weight = v_fma(extra, scale, scale);
    const vf k = v_maskz(use, v_mul(weight, inverse)), k2 = v_mul(two, k);
    const vf towards = v_fnma(v_mul(mx, ssim), v_sub(b2, b1), v_mul(my, v_sub(a2, a1)));
    v_store(out[0] + i, v_mul(k2, towards));
    v_store(out[1] + i, v_sub(v_zero(), v_mul(k, v_mul(ssim, b1))));
    v_store(out[2] + i, v_mul(k2, a1));
    total = v_add(total, v_maskz(use, ssim));
    more = v_fma(extra, v_maskz(use, v_sub(v_set(1.0f), ssim)), more);
  }
  if (row < io->begin || row >= io->end)
    return;
  double *const row_sums = loss_sums(s, row);
  row_sums[PAGS_LOSS_SSIM] = (double)v_sum(total);
  row_sums[PAGS_LOSS_MORE_DSSIM] = (double)v_sum(more);
}

/* Computes the gradient of the loss by the prediction for one row, from the sums of the derivatives along the
 * columns, and adds the row's part of the gradient by the exposure. Zero in the padding and where a pixel doesn't
 * count. */
static void loss_gradient(loss_state *s, int row, float *const sums[3]) {
  const pags_loss_rows *io = s->io;
  const float *x = loss_ring(s, s->x, row), *y = loss_ring(s, s->y, row);
  float *out = io->gradient + row * io->stride;
  const vf scale = v_set(io->l1_scale), gain = v_set(io->exposure[0]);
  vf by_gain = v_zero(), by_offset = v_zero();
  memset(out + loss_padded(io), 0, (size_t)(io->stride - loss_padded(io)) * sizeof *out);
  for (int i = 0; i < io->width; i += V_LANES) {
    const vf a = v_load(x + i), b = v_load(y + i);
    const vf l1 = v_fma(loss_more(io, row, i), scale, scale);
    const vf sign = v_select(v_gt(a, b), l1, v_maskz(v_lt(a, b), v_sub(v_zero(), l1)));
    const vf dq = loss_along(sums[1] + i), dp = loss_along(sums[2] + i);
    const vf ssim = v_fma(v_add(a, a), dq, v_fma(b, dp, loss_along(sums[0] + i)));
    const vm use = loss_counted(io, row, i);
    const vf g = v_maskz(use, v_add(sign, ssim));
    by_gain = v_fma(g, v_maskz(use, v_load(io->prediction + row * io->stride + i)), by_gain);
    by_offset = v_add(by_offset, g);
    v_store(out + i, v_mul(g, gain));
  }
  double *const row_sums = loss_sums(s, row);
  row_sums[PAGS_LOSS_BY_GAIN] = (double)v_sum(by_gain);
  row_sums[PAGS_LOSS_BY_OFFSET] = (double)v_sum(by_offset);
}

void KERNEL(loss_rows)(pags_loss_rows *io) {
  loss_state s = {.io = io, .pitch = pags_loss_pitch(io->stride)};
  float *next = io->scratch + LOSS_MARGIN;
  float **const rings[] = {&s.x, &s.y, &s.derivative[0], &s.derivative[1], &s.derivative[2]};
  for (int j = 0; j < 5; j++, next += LOSS_RING * s.pitch)
    *rings[j] = next;
  for (int j = 0; j < 8; j++, next += s.pitch) { /* the only rows whose margins are read */
    s.sums[j / 4][j % 4] = next;
    memset(next - LOSS_MARGIN, 0, LOSS_MARGIN * sizeof *next);
    memset(next + loss_padded(io), 0, LOSS_MARGIN * sizeof *next);
  }
  for (int row = io->begin - 2 * LOSS_RADIUS; row < io->begin; row++)
    loss_load(&s, row);
  for (int row = io->begin - LOSS_RADIUS; row < io->end + LOSS_RADIUS; row += 2) {
    loss_load(&s, row + LOSS_RADIUS);
    loss_load(&s, row + LOSS_RADIUS + 1);
    loss_down(&s, s.x, s.y - s.x, 4, row);
    for (int r = 0; r < 2; r++)
      if (row + r >= 0 && row + r < io->height)
        loss_differentiate(&s, row + r, s.sums[r]);
      else
        for (int j = 0; j < 3; j++)
          memset(loss_ring(&s, s.derivative[j], row + r), 0, (size_t)io->stride * sizeof(float));
    const int done = row - LOSS_RADIUS; /* its derivatives reach from done - 5 to done + 6 */
    if (done < io->begin)
      continue;
    loss_down(&s, s.derivative[0], s.derivative[1] - s.derivative[0], 3, done);
    for (int r = 0; r < 2 && done + r < io->end; r++)
      loss_gradient(&s, done + r, s.sums[r]);
  }
}
