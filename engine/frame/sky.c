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

void pags_frame_blend_sky(const pags_frame *frame, int64_t tile) {
  const int x0 = tile_x(frame, tile), y0 = tile_y(frame, tile);
  const int64_t at = (int64_t)y0 * frame->stride + x0;
  float *const rgb[3] = {frame_plane(frame, PLANE_R) + at, frame_plane(frame, PLANE_G) + at, frame_plane(frame, PLANE_B) + at};
  frame->kernels->sky_blend(&frame->rays, frame->options.sky->texels, x0, y0, frame->stride, frame_plane(frame, PLANE_T) + at,
                            rgb);
}

typedef struct tile_cells {
  int32_t texel[PAGS_TILE_PIXELS];
  float along[PAGS_TILE_PIXELS], down[PAGS_TILE_PIXELS];
  int x0, y0, width, height; /* of the part within the picture */
} tile_cells;

static void find_cells(const pags_frame *f, int64_t tile, tile_cells *cells) {
  cells->x0 = tile_x(f, tile), cells->y0 = tile_y(f, tile);
  const int width = f->camera.width - cells->x0, height = f->camera.height - cells->y0;
  cells->width = width < PAGS_TILE ? width : PAGS_TILE;
  cells->height = height < PAGS_TILE ? height : PAGS_TILE;
  f->kernels->sky_cells(&f->rays, cells->x0, cells->y0, cells->texel, cells->along, cells->down);
}

/* From a cell's first texel to its last. A run is longer than that, so a cell lies in one run or two. */
static int cell_reach(int size) { return size > 1 ? size + 1 : 0; }

static void find_runs(void *context, int64_t begin, int64_t end, int worker) {
  const sky_context *const c = context;
  const int reach = cell_reach(c->frame->rays.size);
  (void)worker;
  for (int64_t tile = begin; tile < end; tile++) {
    tile_cells cells;
    find_cells(c->frame, tile, &cells);
    uint64_t seen = 0;
    for (int i = 0; i < PAGS_TILE_PIXELS; i++) /* those beyond the picture's edge do no harm */
      seen |= UINT64_C(1) << (cells.texel[i] >> c->run_bits) | UINT64_C(1) << ((cells.texel[i] + reach) >> c->run_bits);
    c->runs_seen[tile] = seen;
  }
}

typedef struct texel_run {
  int32_t first, last; /* texels [first, last) */
  int size;
  float *gradient;     /* of all texels */
} texel_run;

static void add_texel(float *texel, float weight, const float *colour) {
  for (int k = 0; k < 3; k++)
    texel[k] += weight * colour[k];
}

/* `colour` = T dL/drgb of a pixel. */
static void add_cell(const texel_run *run, int32_t texel, float along, float down, const float *colour) {
  const float right = along * down, left = down - right; /* of the lower two */
  const float weight[4] = {1.0f - along - left, along - right, left, right};
  if (run->size == 1) {
    if (texel >= run->first && texel < run->last)
      add_texel(run->gradient + 3 * (int64_t)texel, 1.0f, colour);
    return;
  }
  const int32_t corner[4] = {texel, texel + 1, texel + run->size, texel + run->size + 1};
  if (corner[0] >= run->first && corner[3] < run->last) {
    float *const top = run->gradient + 3 * (int64_t)texel, *const bottom = top + 3 * (int64_t)run->size;
    add_texel(top, weight[0], colour);
    add_texel(top + 3, weight[1], colour);
    add_texel(bottom, weight[2], colour);
    add_texel(bottom + 3, weight[3], colour);
    return;
  }
  for (int k = 0; k < 4; k++)
    if (corner[k] >= run->first && corner[k] < run->last)
      add_texel(run->gradient + 3 * (int64_t)corner[k], weight[k], colour);
}

static void add_tile(const sky_context *c, const texel_run *run, int64_t tile) {
  const pags_frame *const f = c->frame;
  tile_cells cells;
  find_cells(f, tile, &cells);
  for (int y = 0; y < cells.height; y++) {
    const int64_t at = (int64_t)(cells.y0 + y) * f->stride + cells.x0;
    const float *const t = frame_plane(f, PLANE_T) + at;
    const float *const r = c->gradient->rgb[0] + at, *const g = c->gradient->rgb[1] + at, *const b = c->gradient->rgb[2] + at;
    for (int x = 0; x < cells.width; x++) {
      const int i = y * PAGS_TILE + x;
      const float colour[3] = {t[x] * r[x], t[x] * g[x], t[x] * b[x]};
      if (fabsf(colour[0]) + fabsf(colour[1]) + fabsf(colour[2]) < 3e38f) /* as Gaussians' rows that aren't finite count for nothing */
        add_cell(run, cells.texel[i], cells.along[i], cells.down[i], colour);
    }
  }
}

static void add_runs(void *context, int64_t begin, int64_t end, int worker) {
  const sky_context *const c = context;
  const int64_t tiles = (int64_t)c->frame->tiles_x * c->frame->tiles_y;
  (void)worker;
  for (int64_t r = begin; r < end; r++) {
    const texel_run run = {(int32_t)(r << c->run_bits), (int32_t)((r + 1) << c->run_bits), c->frame->rays.size,
                           c->gradient->sky};
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
