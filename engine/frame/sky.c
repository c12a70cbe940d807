/* The sky behind a frame, and the gradient of its texels.
 *
 *   rgb += T sky(direction of the pixel's centre)        dL/dtexel += T weight dL/drgb over the pixels that see the texel
 *
 * Every pixel of the picture takes part: blending stops before T falls below 1e-4, so that none has lost all of the sky.
 *
 * On the way back the cube map is cut into at most 64 runs of texels. First each tile finds out which runs it sees, then each run is
 * one task that goes through its tiles in order: a texel's terms are added in the same order for any number of threads. */
#include <math.h>

#include "stages.h"

enum { MOST_RUNS = 64, LEAST_RUN_BITS = 12 };

typedef struct sky_context {
  pags_frame *frame;
  const pags_picture_gradient *gradient;
  uint64_t *runs_seen; /* per tile: bit r, it sees run r */
  int run_bits;        /* a run is 2^run_bits texels */
} sky_context;

void pags_frame_prepare_sky(pags_frame *frame) {
  const pags_sky *const sky = frame->options.sky;
  frame->has_sky = sky && sky->size > 0;
  if (!frame->has_sky)
    return;
  const pags_camera *const c = &frame->camera;
  frame->rays.size = sky->size;
  for (int k = 0; k < 3; k++) {
    const double *const r = c->world_from_camera + 4 * k;
    frame->rays.across[k] = (float)(r[0] / c->fx);
    frame->rays.downwards[k] = (float)(r[1] / c->fy);
    frame->rays.forward[k] = (float)r[2];
  }
  frame->rays.cx = (float)c->cx, frame->rays.cy = (float)c->cy;
}

static int tile_x(const pags_frame *frame, int64_t tile) { return (int)(tile % frame->tiles_x) * PAGS_TILE; }
static int tile_y(const pags_frame *frame, int64_t tile) { return (int)(tile / frame->tiles_x) * PAGS_TILE; }

void pags_frame_find_sky(const pags_frame *frame, int64_t tile, pags_sky_tile *out) {
  frame->kernels->sky_find(&frame->rays, frame->options.sky->texels, tile_x(frame, tile), tile_y(frame, tile), out);
}

void pags_frame_blend_sky(const pags_frame *frame, int64_t tile, const pags_sky_tile *found) {
  const int64_t at = (int64_t)tile_y(frame, tile) * frame->stride + tile_x(frame, tile);
  float *const rgb[3] = {frame_plane(frame, PLANE_R) + at, frame_plane(frame, PLANE_G) + at, frame_plane(frame, PLANE_B) + at};
  frame->kernels->sky_blend(&frame->rays, frame->options.sky->texels, found, frame->stride, frame_plane(frame, PLANE_T) + at, rgb);
}

/* From a cell's first texel to its last. A run is longer than that, so a cell lies in one run or two. */
static int cell_reach(int size) { return size > 1 ? size + 1 : 0; }

/* Runs of texels first..last, both included. */
static uint64_t runs_between(int64_t first, int64_t last, int run_bits) {
  const uint64_t upto = UINT64_MAX >> (MOST_RUNS - 1 - (last >> run_bits));
  return upto & UINT64_MAX << (first >> run_bits);
}

/* Of a row of a tile, which may reach beyond the picture's edge: whether any pixel lets as much of the sky through as counts. */
static bool row_shows_sky(const sky_context *c, int64_t at) {
  const float *const t = frame_plane(c->frame, PLANE_T) + at;
  int any = 0;
  for (int x = 0; x < PAGS_TILE; x++)
    any |= t[x] >= c->gradient->sky_cut;
  return any;
}

static bool tile_shows_sky(const sky_context *c, int64_t tile) {
  const int64_t at = (int64_t)tile_y(c->frame, tile) * c->frame->stride + tile_x(c->frame, tile);
  for (int y = 0; y < PAGS_TILE; y++)
    if (row_shows_sky(c, at + y * c->frame->stride))
      return true;
  return false;
}

/* A face's directions are a convex cone: where a tile's four corners lie on one face, so do all its pixels, and in between of the corners'
 * rows. A row more on either side is for rounding. Elsewhere every pixel is looked at. */
static uint64_t tile_runs(const sky_context *c, int64_t tile) {
  enum { LAST = PAGS_TILE - 1 };
  if (!tile_shows_sky(c, tile))
    return 0;
  const pags_frame *const f = c->frame;
  const int size = f->rays.size, x0 = tile_x(f, tile), y0 = tile_y(f, tile);
  const int64_t face_texels = (int64_t)size * size;
  int32_t texel[PAGS_TILE_PIXELS];
  float unused[4][PAGS_TILE_PIXELS];
  float *const weight[4] = {unused[0], unused[1], unused[2], unused[3]};
  f->kernels->sky_cells(&f->rays, x0, y0, LAST, texel, weight);
  const int32_t corner[4] = {texel[0], texel[LAST], texel[PAGS_TILE], texel[PAGS_TILE + LAST]};
  const int64_t face = corner[0] / face_texels;
  int64_t first = corner[0], last = corner[0];
  bool one_face = true;
  for (int k = 1; k < 4; k++) {
    one_face &= corner[k] / face_texels == face;
    first = corner[k] < first ? corner[k] : first;
    last = corner[k] > last ? corner[k] : last;
  }
  if (one_face) {
    first -= 2 * size, last += 3 * size;
    return runs_between(first > 0 ? first : 0, last < 6 * face_texels ? last : 6 * face_texels - 1, c->run_bits);
  }
  uint64_t seen = 0;
  f->kernels->sky_cells(&f->rays, x0, y0, 1, texel, weight);
  for (int i = 0; i < PAGS_TILE_PIXELS; i++) /* those beyond the picture's edge do no harm */
    seen |= runs_between(texel[i], texel[i] + cell_reach(size), c->run_bits);
  return seen;
}

static void find_runs(void *context, int64_t begin, int64_t end, int worker) {
  const sky_context *const c = context;
  (void)worker;
  for (int64_t tile = begin; tile < end; tile++)
    c->runs_seen[tile] = tile_runs(c, tile);
}

typedef struct texel_run {
  int32_t first, last; /* texels [first, last) */
  int size;
  float *gradient;     /* of all texels */
  uint8_t *blocks;     /* as in pags_picture_gradient; runs hold whole blocks */
} texel_run;

static void add_texel(const texel_run *run, int32_t texel, const float *colour) {
  const bool any = colour[0] != 0.0f || colour[1] != 0.0f || colour[2] != 0.0f;
  if (!any || texel < run->first || texel >= run->last)
    return;
  float *const to = run->gradient + 3 * (int64_t)texel;
  to[0] += colour[0], to[1] += colour[1], to[2] += colour[2];
  if (run->blocks)
    run->blocks[texel / PAGS_SKY_BLOCK] = 1;
}

/* What the texels on a cell's left and right get: above and below, each red, green, blue and nothing. */
typedef struct cell_side {
  float above[4], below[4];
} cell_side;

/* `column`: 0 of the cell's left side, 1 of its right one. */
static void add_side(const texel_run *run, int32_t texel, int column, const cell_side *side) {
  const int right = run->size > 1 ? column : 0, below = run->size > 1 ? run->size : 0;
  add_texel(run, texel + right, side->above);
  add_texel(run, texel + right + below, side->below);
}

/* T dL/drgb of a tile's row, channel by channel, nothing where T is below the cut; values that aren't finite count for nothing, as with
 * Gaussians. */
static void row_colours(const sky_context *c, int64_t at, float colour[3][PAGS_TILE]) {
  const float *const t = frame_plane(c->frame, PLANE_T) + at;
  for (int k = 0; k < 3; k++) {
    const float *const gradient = c->gradient->rgb[k] + at;
    for (int x = 0; x < PAGS_TILE; x++) {
      const float product = t[x] * gradient[x];
      colour[k][x] = fabsf(product) < 3e38f && t[x] >= c->gradient->sky_cut ? product : 0.0f;
    }
  }
}

/* Neighbours in a cell are summed before they go to memory, and a side that the next cell shares waits for its part. weight[k *
 * PAGS_TILE_PIXELS]: of corner k. */
static void add_row(const texel_run *run, int width, const int32_t *texel, const float *weight,
                    float colour[3][PAGS_TILE]) {
  static const cell_side nothing = {{0.0f}, {0.0f}};
  cell_side side[2] = {nothing, nothing};
  for (int x = 0; x < width; x++) {
    const float rgb[4] = {colour[0][x], colour[1][x], colour[2][x], 0.0f};
    for (int j = 0; j < 4; j++) {
      side[0].above[j] += weight[x] * rgb[j];
      side[1].above[j] += weight[PAGS_TILE_PIXELS + x] * rgb[j];
      side[0].below[j] += weight[2 * PAGS_TILE_PIXELS + x] * rgb[j];
      side[1].below[j] += weight[3 * PAGS_TILE_PIXELS + x] * rgb[j];
    }
    const int32_t here = texel[x], on = x + 1 < width ? texel[x + 1] - here : 2;
    if (on == 0)
      continue;
    const bool to_right = on == 1 && run->size > 1, to_left = on == -1 && run->size > 1;
    const cell_side shared = side[to_right];
    if (!to_left)
      add_side(run, here, 0, side);
    if (!to_right)
      add_side(run, here, 1, side + 1);
    side[0] = to_right ? shared : nothing;
    side[1] = to_left ? shared : nothing;
  }
}

static void add_tile(const sky_context *c, const texel_run *run, int64_t tile) {
  const pags_frame *const f = c->frame;
  const int x0 = tile_x(f, tile), y0 = tile_y(f, tile), width = f->camera.width - x0, height = f->camera.height - y0;
  int32_t texel[PAGS_TILE_PIXELS];
  float weight[4 * PAGS_TILE_PIXELS];
  float *const corners[4] = {weight, weight + PAGS_TILE_PIXELS, weight + 2 * PAGS_TILE_PIXELS, weight + 3 * PAGS_TILE_PIXELS};
  f->kernels->sky_cells(&f->rays, x0, y0, 1, texel, corners);
  for (int y = 0; y < PAGS_TILE && y < height; y++) {
    const int64_t at = (int64_t)(y0 + y) * f->stride + x0;
    float colour[3][PAGS_TILE];
    if (!row_shows_sky(c, at))
      continue;
    row_colours(c, at, colour);
    add_row(run, width < PAGS_TILE ? width : PAGS_TILE, texel + y * PAGS_TILE,
            weight + y * PAGS_TILE, colour);
  }
}

static void add_runs(void *context, int64_t begin, int64_t end, int worker) {
  const sky_context *const c = context;
  const int64_t tiles = (int64_t)c->frame->tiles_x * c->frame->tiles_y;
  (void)worker;
  for (int64_t r = begin; r < end; r++) {
    const texel_run run = {(int32_t)(r << c->run_bits), (int32_t)((r + 1) << c->run_bits), c->frame->rays.size,
                           c->gradient->sky, c->gradient->sky_blocks};
    for (int64_t tile = 0; tile < tiles; tile++)
      if (c->runs_seen[tile] >> r & 1)
        add_tile(c, &run, tile);
  }
}

pags_result pags_frame_sky_backward(pags_frame *frame, const pags_picture_gradient *gradient) {
  const int64_t tiles = (int64_t)frame->tiles_x * frame->tiles_y;
  const int64_t texels = 6 * (int64_t)frame->rays.size * frame->rays.size;
  sky_context c = {.frame = frame, .gradient = gradient, .run_bits = LEAST_RUN_BITS};
  while (texels > (int64_t)MOST_RUNS << c.run_bits)
    c.run_bits++;
  c.runs_seen = pags_frame_alloc(frame, tiles, sizeof *c.runs_seen, "sky's tiles");
  if (!c.runs_seen)
    return PAGS_ERROR_MEMORY;
  PAGS_TRY(pags_frame_for(frame, tiles, 16, find_runs, &c));
  return pags_frame_for(frame, ((texels - 1) >> c.run_bits) + 1, 1, add_runs, &c);
}
