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

/* Times `t`; 16 floats from weight to weight where the caller has no say. */
V_INLINE void sky_weights(const sky_cells16 *c, vf t, float *const weight[4]) {
  const vf lower = v_mul(t, c->down), upper = v_sub(t, lower);
  v_store(weight[0], v_fnma(upper, c->along, upper));
  v_store(weight[1], v_mul(upper, c->along));
  v_store(weight[2], v_fnma(lower, c->along, lower));
  v_store(weight[3], v_mul(lower, c->along));
}

static void sky_cells(const pags_sky_rays *rays, int x0, int y0, int step, int32_t *texel, float *const weight[4]) {
  for (int row = 0; row * step < PAGS_TILE; row++) {
    const sky_cells16 c = sky_cells_of(rays, x0, y0 + row * step);
    float *const to[4] = {weight[0] + row * PAGS_TILE, weight[1] + row * PAGS_TILE, weight[2] + row * PAGS_TILE,
                          weight[3] + row * PAGS_TILE};
    i_store(texel + row * PAGS_TILE, c.texel);
    sky_weights(&c, v_set(1.0f), to);
  }
}

/* Texels lie in a map of tens of megabytes: without this, waiting for them is two thirds of the blending. Enough of a row's are asked for
 * to name each cache line that a row of one texel a pixel or fewer comes to. */
V_INLINE void sky_fetch(const float *texels, const int32_t *texel, int below) {
  for (int k = 0; k < V_LANES; k += 5) {
    const float *const at = texels + 3 * (int64_t)texel[k];
    __builtin_prefetch(at, 0, 2);
    __builtin_prefetch(at + 3 * below, 0, 2);
  }
}

static void sky_find(const pags_sky_rays *rays, const float *texels, int x0, int y0, pags_sky_tile *tile) {
  for (int y = 0; y < PAGS_TILE; y++) {
    const sky_cells16 cells = sky_cells_of(rays, x0, y0 + y);
    int32_t *const texel = tile->texel + y * PAGS_TILE;
    i_store(texel, cells.texel);
    v_store(tile->along + y * PAGS_TILE, cells.along);
    v_store(tile->down + y * PAGS_TILE, cells.down);
    sky_fetch(texels, texel, rays->size > 1 ? rays->size : 0);
  }
}

/* Pixel by pixel, red, green, blue and what comes after them at once: gathers of a lane each take five times as long. After the map's very
 * last texel nothing comes, so that the cell it belongs to is copied first. */
static void sky_blend(const pags_sky_rays *rays, const float *texels, const pags_sky_tile *tile, int64_t stride,
                      const float *transmittance, float *const rgb[3]) {
  const int right = rays->size > 1, below = right * rays->size;
  const int32_t last = 6 * rays->size * rays->size - 1 - right - below;
  float corner[4][4] = {{0.0f}};
  for (int k = 0; k < 3; k++) {
    corner[0][k] = texels[3 * (int64_t)last + k], corner[1][k] = texels[3 * (int64_t)(last + right) + k];
    corner[2][k] = texels[3 * (int64_t)(last + below) + k], corner[3][k] = texels[3 * (int64_t)(last + below + right) + k];
  }
  for (int y = 0; y < PAGS_TILE; y++) {
    const int32_t *const texel = tile->texel + y * PAGS_TILE;
    const sky_cells16 cells = {i_load(texel), v_load(tile->along + y * PAGS_TILE), v_load(tile->down + y * PAGS_TILE)};
    float weight[4 * V_LANES], colour[4 * V_LANES];
    float *const to[4] = {weight, weight + 16, weight + 32, weight + 48};
    sky_weights(&cells, v_load(transmittance + y * stride), to);
    for (int k = 0; k < V_LANES; k++) {
      const float *const at = texels + 3 * (int64_t)texel[k], *const under = at + 3 * below;
      if (texel[k] == last)
        v_mix4(colour + 4 * k, corner[0], corner[1], corner[2], corner[3], weight + k);
      else
        v_mix4(colour + 4 * k, at, at + 3 * right, under, under + 3 * right, weight + k);
    }
    vf sky[3];
    v_columns3(colour, &sky[0], &sky[1], &sky[2]);
    for (int c = 0; c < 3; c++)
      v_store(rgb[c] + y * stride, v_add(v_load(rgb[c] + y * stride), sky[c]));
  }
}
