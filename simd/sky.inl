/* The cube map behind the Gaussians (pags/sky.h): which texels a pixel sees, and their colour blended in by what transmittance is left.
 *
 * A cell is the square between four texel centres, named by its top left texel; a pixel's texels are the cell's corners, weighted
 * bilinearly by where in the cell (along, down in [0, 1]) its direction falls. Half a texel from a face's border the clamp puts
 * directions onto the cell's edge. A map of one texel a side has one cell a face, all of whose corners are that texel. */

typedef struct sky_cells16 {
  vi texel; /* top left */
  vf along, down;
} sky_cells16;

V_INLINE vf sky_negated(vf x) { return v_sub(v_zero(), x); }

/* From -1..1 over a face to the first texel and the rest. NaN, of a direction without length, becomes the last texel. */
V_INLINE vi sky_axis(vf position, int size, vf *rest) {
  const float half = 0.5f * (float)size;
  const vf last = v_set((float)(size - 1)), last_cell = v_set(size > 1 ? (float)(size - 2) : 0.0f);
  const vf u = v_max(v_min(v_fma(position, v_set(half), v_set(half - 0.5f)), last), v_zero());
  const vi first = v_to_i(v_min(v_sub(u, v_set(0.5f)), last_cell)); /* a whole u may fall to the left: the rest is 1 then */
  *rest = v_sub(u, i_to_v(first));
  return first;
}

V_INLINE sky_cells16 sky_cells_of(const pags_sky_rays *rays, int x0, int y) {
  const vf px = v_sub(v_add(v_iota(), v_set((float)x0 + 0.5f)), v_set(rays->cx)), py = v_set((float)y + 0.5f - rays->cy);
  vf d[3], a[3];
  vm minus[3];
  for (int k = 0; k < 3; k++) {
    d[k] = v_fma(px, v_set(rays->across[k]), v_fma(py, v_set(rays->downwards[k]), v_set(rays->forward[k])));
    a[k] = v_abs(d[k]);
    minus[k] = v_lt(d[k], v_zero());
  }
  const vm on_x = v_ge_and(v_ge(a[0], a[1]), a[0], a[2]), on_y = v_ge(a[1], a[2]); /* in this order */
  const vf major = v_select(on_x, a[0], v_select(on_y, a[1], a[2]));
  const vf up = sky_negated(d[1]), aside = sky_negated(d[2]);
  const vf s = v_select(on_x, v_select(minus[0], d[2], aside),
                        v_select(on_y, d[0], v_select(minus[2], sky_negated(d[0]), d[0])));
  const vf t = v_select(on_x, up, v_select(on_y, v_select(minus[1], aside, d[2]), up));
  const vi face = i_select(on_x, i_select(minus[0], i_set(1), i_set(0)),
                           i_select(on_y, i_select(minus[1], i_set(3), i_set(2)), i_select(minus[2], i_set(5), i_set(4))));
  const vf inverse = v_div(v_set(1.0f), major);
  sky_cells16 c;
  const vi column = sky_axis(v_mul(s, inverse), rays->size, &c.along), row = sky_axis(v_mul(t, inverse), rays->size, &c.down);
  const vi size = i_set(rays->size);
  c.texel = i_add(i_mul(i_add(i_mul(face, size), row), size), column);
  return c;
}

static void sky_cells(const pags_sky_rays *rays, int x0, int y0, int32_t *texel, float *along, float *down) {
  for (int y = 0; y < PAGS_TILE; y++) {
    const sky_cells16 c = sky_cells_of(rays, x0, y0 + y);
    i_store(texel + y * PAGS_TILE, c.texel);
    v_store(along + y * PAGS_TILE, c.along);
    v_store(down + y * PAGS_TILE, c.down);
  }
}

/* Four weights a pixel, then pixel by pixel: twelve gathers of a lane each took three times as long. */
static void sky_blend(const pags_sky_rays *rays, const float *texels, int x0, int y0, int64_t stride,
                      const float *transmittance, float *const rgb[3]) {
  const int right = rays->size > 1 ? 3 : 0, below = right * rays->size;
  for (int y = 0; y < PAGS_TILE; y++) {
    const sky_cells16 cells = sky_cells_of(rays, x0, y0 + y);
    const vf t = v_load(transmittance + y * stride);
    const vf lower = v_mul(t, cells.down), upper = v_sub(t, lower);
    int32_t texel[V_LANES];
    float weight[4][V_LANES], colour[3][V_LANES];
    i_store(texel, cells.texel);
    v_store(weight[1], v_mul(upper, cells.along));
    v_store(weight[0], v_fnma(upper, cells.along, upper));
    v_store(weight[3], v_mul(lower, cells.along));
    v_store(weight[2], v_fnma(lower, cells.along, lower));
    for (int k = 0; k < V_LANES; k++) {
      const float *const top = texels + 3 * (int64_t)texel[k], *const bottom = top + below;
      const float a = weight[0][k], b = weight[1][k], c = weight[2][k], d = weight[3][k];
      colour[0][k] = (a * top[0] + b * top[right]) + (c * bottom[0] + d * bottom[right]);
      colour[1][k] = (a * top[1] + b * top[right + 1]) + (c * bottom[1] + d * bottom[right + 1]);
      colour[2][k] = (a * top[2] + b * top[right + 2]) + (c * bottom[2] + d * bottom[right + 2]);
    }
    for (int c = 0; c < 3; c++)
      v_store(rgb[c] + y * stride, v_add(v_load(rgb[c] + y * stride), v_load(colour[c])));
  }
}
