/* SPDX-License-Identifier: Apache-2.0 */
/* The sky behind a frame, a cube map that is blended in by the transmittance T, and the gradient of its texels:
 *   rgb += T sky(direction of the pixel's centre)
 *   dL/dtexel += T weight dL/drgb over the pixels that see the texel
 * Every pixel of the picture shows some sky, since blending stops before T falls below 1e-4; but with
 * PAGS_EARLY_Z_BOUNDED only those that aren't full.
 *
 * For the backward pass the cube map is cut into runs of consecutive texels: at most 64, with many workers 256. First
 * each tile finds out which runs its pixels see. Then each run is one task, which adds up the terms of its tiles in the
 * order of the tiles and hands the run's gradient to the caller's receiver. So a texel's terms are added in the same
 * order for any number of threads, and a run's gradient stays in the cache. */
#include <math.h>
#include <string.h>

#include "frame/lens_view.h"

/* A run has at least 2^12 texels. More runs cost more, since a tile adds its pixels to each run that it sees, but give
 * more workers something to do; the gradient doesn't depend on them. */
enum { FEW_RUNS = 64, MOST_RUNS = 256, FEW_WORKERS = 8, WORDS = MOST_RUNS / 64, LEAST_RUN_BITS = 12 };

typedef struct sky_context {
  pags_frame *frame;
  const pags_picture_gradient *gradient;
  uint64_t (*runs_seen)[WORDS]; /* per tile: bit r is set where it sees run r */
  int run_bits;                 /* a run is 2^run_bits texels */
  float *runs;                  /* per worker: the gradient of one run, 3 floats a texel */
  uint8_t *seen;                /* per worker and block of the run: 1 where `runs` has been written */
} sky_context;

/* ---- Blending the sky ---- */

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

void pags_frame_find_sky(const pags_frame *frame, int64_t tile, pags_sky_tile *out) {
  const int x0 = frame_tile_x(frame, tile), y0 = frame_tile_y(frame, tile);
  const pags_sky_rays rays = pags_frame_rays(frame, tile);
  if (frame->lens)
    pags_frame_lens_sky(frame, x0, y0, out);
  else
    frame->kernels->sky_find(&rays, frame->options.sky->texels, x0, y0, out);
}

void pags_frame_blend_sky(const pags_frame *frame, int64_t tile, const pags_sky_tile *found) {
  const int64_t at = frame_tile_offset(frame, tile);
  float *const rgb[3] = {frame_plane(frame, PLANE_R) + at, frame_plane(frame, PLANE_G) + at,
                         frame_plane(frame, PLANE_B) + at};
  frame->kernels->sky_blend(&frame->rays, frame->options.sky->texels, found, frame->stride,
                            frame_plane(frame, PLANE_T) + at, rgb);
}

/* As pags_kernels.sky_cells, of a pinhole or a lens. */
static void find_cells(const pags_frame *f, int64_t tile, int step, int32_t *row, int32_t *column,
                       float *const weight[4]) {
  const int x0 = frame_tile_x(f, tile), y0 = frame_tile_y(f, tile);
  const pags_sky_rays rays = pags_frame_rays(f, tile);
  if (f->lens)
    pags_frame_lens_cells(f, x0, y0, step, row, column, weight);
  else
    f->kernels->sky_cells(&rays, x0, y0, step, row, column, weight);
}

/* Whether any of 16 pixels of a row has at least this transmittance. */
static bool row_shows(const float *transmittance, float least) {
  int any = 0;
  for (int x = 0; x < PAGS_TILE; x++)
    any |= transmittance[x] >= least;
  return any;
}

bool pags_frame_tile_shows(const pags_frame *frame, int64_t tile, float least) {
  const float *const t = frame_plane(frame, PLANE_T) + frame_tile_offset(frame, tile);
  for (int y = 0; y < PAGS_TILE; y++)
    if (row_shows(t + (int64_t)y * frame->stride, least))
      return true;
  return false;
}

/* ---- Finding the runs of texels that a tile sees ---- */

/* Sets the bits of the runs that texels first..last, both included, lie in. */
static void add_runs_between(int64_t first, int64_t last, int run_bits, uint64_t seen[WORDS]) {
  for (int64_t run = first >> run_bits; run <= last >> run_bits; run++)
    seen[run / 64] |= UINT64_C(1) << run % 64;
}

/* Sets the bits of the runs that a tile's pixels see; none where the tile shows no sky. The directions of a cube face
 * are a convex cone: if the tile's four corner pixels fall onto one face, all of its pixels do, in rows of texels
 * between those of the corners, with a row more on either side for rounding. Otherwise every pixel is looked up. */
static void tile_runs(const sky_context *c, int64_t tile, uint64_t seen[WORDS]) {
  enum { LAST = PAGS_TILE - 1 };
  memset(seen, 0, WORDS * sizeof *seen);
  if (!pags_frame_tile_shows(c->frame, tile, c->gradient->sky_cut))
    return;
  const pags_frame *const f = c->frame;
  const int size = f->rays.size;
  int32_t row[PAGS_TILE_PIXELS], column[PAGS_TILE_PIXELS];
  float unused[4][PAGS_TILE_PIXELS];
  float *const weight[4] = {unused[0], unused[1], unused[2], unused[3]};
  find_cells(f, tile, LAST, row, column, weight);
  const int32_t corner[4] = {row[0], row[LAST], row[PAGS_TILE], row[PAGS_TILE + LAST]};
  int64_t first = corner[0], last = corner[0];
  bool one_face = !f->lens; /* a lens bends the tile's sides */
  for (int k = 1; k < 4; k++) {
    one_face &= corner[k] / size == corner[0] / size;
    first = corner[k] < first ? corner[k] : first;
    last = corner[k] > last ? corner[k] : last;
  }
  if (one_face) {
    first = first > 2 ? first - 2 : 0, last = last + 2 < 6 * size ? last + 2 : 6 * size - 1;
    add_runs_between(first * size, (last + 1) * size - 1, c->run_bits, seen);
    return;
  }
  find_cells(f, tile, 1, row, column, weight);
  for (int i = 0; i < PAGS_TILE_PIXELS; i++) { /* pixels beyond the picture's edge do no harm: they only add runs */
    const int64_t texel = (int64_t)row[i] * size + column[i];
    /* From the first to the last of the cell's four texels; a run is longer, so that they lie in one run or in
     * two. */
    add_runs_between(texel, texel + (size > 1 ? size + 1 : 0), c->run_bits, seen);
  }
}

/* Block function: finds the runs that tiles [begin, end) see. */
static void find_runs(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sky_context *const c = context;
  for (int64_t tile = begin; tile < end; tile++)
    tile_runs(c, tile, c->runs_seen[tile]);
}

/* ---- Adding a tile's pixels to a run's gradient ---- */

/* A run of texels whose gradient is being added up, in blocks of PAGS_SKY_BLOCK. */
typedef struct texel_run {
  int32_t first, last; /* texels [first, last) */
  int size;            /* of the cube map, texels a side */
  float *gradient;     /* 3 floats a texel; a block is set to zeros before the first gradient is added to it */
  uint8_t *seen;       /* per block: 1 where the gradient has been set */
} texel_run;

enum { PATCH_TEXELS = 1024 }; /* in the largest patch */

/* What a tile's pixels, row after row, add to the sky's gradient: the cell of four texels that each pixel sees, their
 * bilinear weights, and T dL/drgb, which is zero where the sky doesn't count. */
typedef struct tile_terms {
  int32_t row[PAGS_TILE_PIXELS],
      column[PAGS_TILE_PIXELS]; /* the cell's top left texel; rows are numbered through all faces */
  float weight[4][PAGS_TILE_PIXELS];
  float colour[PAGS_TILE_PIXELS][4]; /* the fourth is 0, to fill a vector */
  bool shows[PAGS_TILE];             /* per row: whether any of its pixels counts */
} tile_terms;

typedef struct pixel_box {
  int x0, y0, x1, y1; /* pixels of a tile, [x0, x1) by [y0, y1) */
} pixel_box;

/* A rectangle of texels of the cube map, rows numbered through all faces. */
typedef struct texel_patch {
  int32_t row, column, rows, columns;
} texel_patch;

/* The smallest patch that holds all texels that the pixels of `box` add to. */
static texel_patch patch_of(const tile_terms *t, const pixel_box *box, int size) {
  int32_t least[2] = {INT32_MAX, INT32_MAX}, most[2] = {0, 0};
  for (int y = box->y0; y < box->y1; y++)
    for (int x = box->x0; x < box->x1; x++) {
      const int32_t at[2] = {t->row[y * PAGS_TILE + x], t->column[y * PAGS_TILE + x]};
      for (int k = 0; k < 2; k++) {
        least[k] = at[k] < least[k] ? at[k] : least[k];
        most[k] = at[k] > most[k] ? at[k] : most[k];
      }
    }
  const int32_t beyond = size > 1 ? 2 : 1;
  return (texel_patch){least[0], least[1], most[0] - least[0] + beyond, most[1] - least[1] + beyond};
}

/* Adds up the terms of the pixels of `box`, texel by texel, in `sum`, which has the patch's rows and columns. */
static void sum_patch(const tile_terms *t, const pixel_box *box, const texel_patch *p, int size, float (*sum)[4]) {
  const int32_t right = size > 1 ? 1 : 0, below = size > 1 ? p->columns : 0,
                corner[4] = {0, right, below, below + right};
  memset(sum, 0, (size_t)p->rows * (size_t)p->columns * sizeof *sum);
  for (int y = box->y0; y < box->y1; y++)
    for (int x = box->x0; t->shows[y] && x < box->x1; x++) {
      const int i = y * PAGS_TILE + x;
      float(*const at)[4] = sum + (t->row[i] - p->row) * p->columns + t->column[i] - p->column;
      for (int k = 0; k < 4; k++)
        for (int j = 0; j < 4; j++)
          at[corner[k]][j] += t->weight[k][i] * t->colour[i][j];
    }
}

/* Adds a patch to the gradient of those of its texels that lie in the run. */
static void add_patch(const texel_run *run, const texel_patch *p, float (*sum)[4]) {
  for (int32_t i = 0; i < p->rows; i++, sum += p->columns) {
    const int32_t row = (p->row + i) * run->size + p->column - run->first,
                  all = run->last - run->first; /* texels of the run */
    const int32_t begin = row < 0 ? -row : 0,
                  end = row + p->columns > all ? all - row : p->columns; /* columns in the run */
    if (begin >= end)
      continue;

    /* Blocks that hold texels first..last of the run are set to zeros when they are added to for the first time. */
    int32_t first = row + begin;
    int32_t last = row + end - 1;
    for (int32_t block = first / PAGS_SKY_BLOCK; block <= last / PAGS_SKY_BLOCK; block++)
      if (!run->seen[block]) {
        memset(run->gradient + 3 * PAGS_SKY_BLOCK * (int64_t)block, 0, 3 * PAGS_SKY_BLOCK * sizeof(float));
        run->seen[block] = 1;
      }

    float *to = run->gradient + 3 * (int64_t)(row + begin);
    for (int32_t j = begin; j < end; j++, to += 3)
      for (int k = 0; k < 3; k++)
        to[k] += sum[j][k];
  }
}

/* Adds the terms of the pixels of `box` to the run. Neighbouring pixels share texels, so their terms are first summed
 * in a small patch. Where the patch would be large, as across faces or where texels are much smaller than pixels,
 * each half of the pixels is added with a patch of its own. */
static void add_pixels(const texel_run *run, const tile_terms *t, const pixel_box *box) {
  const texel_patch patch = patch_of(t, box, run->size);
  if ((int64_t)patch.rows * patch.columns <= PATCH_TEXELS) {
    float sum[PATCH_TEXELS][4];
    sum_patch(t, box, &patch, run->size, sum);
    add_patch(run, &patch, sum);
    return;
  }
  pixel_box half[2] = {*box, *box};
  if (box->x1 - box->x0 > box->y1 - box->y0)
    half[0].x1 = half[1].x0 = (box->x0 + box->x1) / 2;
  else
    half[0].y1 = half[1].y0 = (box->y0 + box->y1) / 2;
  add_pixels(run, t, half);
  add_pixels(run, t, half + 1);
}

/* T dL/drgb of one row of a tile; 0 where T is below sky_cut and where a value isn't finite, as with Gaussians. */
static void find_colours(const sky_context *c, int64_t at, float (*restrict colour)[4]) {
  const float *const restrict t = frame_plane(c->frame, PLANE_T) + at;
  const float cut = c->gradient->sky_cut;
  float product[3][PAGS_TILE];
  for (int k = 0; k < 3; k++) {
    const float *const restrict gradient = c->gradient->rgb[k] + at;
    for (int x = 0; x < PAGS_TILE; x++) {
      const float p = t[x] * gradient[x];
      product[k][x] = ((fabsf(p) < 3e38f) & (t[x] >= cut)) ? p : 0.0f;
    }
  }
  for (int x = 0; x < PAGS_TILE; x++) {
    colour[x][0] = product[0][x];
    colour[x][1] = product[1][x];
    colour[x][2] = product[2][x];
    colour[x][3] = 0.0f;
  }
}

/* ---- The gradient run by run ---- */

/* The first tile from `tile` on that sees the run; the number of tiles if none does. */
static int64_t next_tile(const sky_context *c, int64_t tile, int64_t run) {
  const int64_t tiles = (int64_t)c->frame->tiles_x * c->frame->tiles_y;
  while (tile < tiles && !(c->runs_seen[tile][run / 64] >> run % 64 & 1))
    tile++;
  return tile;
}

/* Block function: adds up the gradient of each run over all tiles that see it, and calls the receiver if any does. */
static void add_runs(void *context, int64_t begin, int64_t end, int worker) {
  const sky_context *const c = context;
  const pags_frame *const f = c->frame;
  const float *const planes[] = {frame_plane(f, PLANE_T), c->gradient->rgb[0], c->gradient->rgb[1],
                                 c->gradient->rgb[2]};
  const int64_t tiles = (int64_t)f->tiles_x * f->tiles_y, texels = (int64_t)1 << c->run_bits;
  for (int64_t index = begin; index < end; index++) {
    const texel_run run = {(int32_t)(index * texels), (int32_t)((index + 1) * texels), f->rays.size,
                           c->runs + 3 * texels * worker, c->seen + texels / PAGS_SKY_BLOCK * worker};
    int64_t tile = next_tile(c, 0, index);
    if (tile == tiles)
      continue;
    memset(run.seen, 0, (size_t)(texels / PAGS_SKY_BLOCK));
    for (int64_t next; tile < tiles; tile = next) {
      next = next_tile(c, tile + 1, index);
      /* Prefetches the rows of its planes. They lie a picture's width apart, too far for the hardware prefetcher. */
      for (int y = 0; y < PAGS_TILE && next < tiles; y++)
        for (int k = 0; k < 4; k++)
          __builtin_prefetch(planes[k] + frame_tile_offset(f, next) + y * f->stride);

      /* Adds the tile's pixels, without rows at its top and bottom that show no sky. */
      const int x0 = frame_tile_x(f, tile), y0 = frame_tile_y(f, tile), width = f->camera.width - x0,
                height = f->camera.height - y0;
      pixel_box box = {0, 0, width < PAGS_TILE ? width : PAGS_TILE, height < PAGS_TILE ? height : PAGS_TILE};
      tile_terms terms;
      float *const weight[4] = {terms.weight[0], terms.weight[1], terms.weight[2], terms.weight[3]};
      find_cells(f, tile, 1, terms.row, terms.column, weight);
      for (int y = 0; y < box.y1; y++) {
        const int64_t at = (int64_t)(y0 + y) * f->stride + x0;
        terms.shows[y] = row_shows(frame_plane(f, PLANE_T) + at, c->gradient->sky_cut);
        if (terms.shows[y])
          find_colours(c, at, terms.colour + y * PAGS_TILE);
      }
      while (box.y0 < box.y1 && !terms.shows[box.y0])
        box.y0++;
      while (box.y0 < box.y1 && !terms.shows[box.y1 - 1])
        box.y1--;
      if (box.y0 < box.y1)
        add_pixels(&run, &terms, &box);
    }
    const pags_sky_gradient out = {
        .first = run.first, .blocks = texels / PAGS_SKY_BLOCK, .seen = run.seen, .data = run.gradient};
    c->gradient->sky(c->gradient->sky_user, &out, worker);
  }
}

pags_result pags_frame_sky_backward(pags_frame *frame, const pags_picture_gradient *gradient) {
  pags_tasks_mark(frame->tasks, NULL, "sky backward");
  const int64_t tiles = (int64_t)frame->tiles_x * frame->tiles_y;
  const int64_t texels = 6 * (int64_t)frame->rays.size * frame->rays.size, workers = pags_tasks_workers(frame->tasks);
  sky_context c = {.frame = frame, .gradient = gradient, .run_bits = LEAST_RUN_BITS};
  const int64_t most = workers > FEW_WORKERS ? MOST_RUNS : FEW_RUNS;
  while (texels > most << c.run_bits)
    c.run_bits++;
  PAGS_TRY(pags_frame_alloc(frame, &c.runs_seen, tiles, sizeof *c.runs_seen, "sky's tiles"));
  PAGS_TRY(pags_frame_alloc(frame, &c.runs, 3 * workers << c.run_bits, sizeof *c.runs, "sky's gradient"));
  PAGS_TRY(pags_frame_alloc(frame, &c.seen, (workers << c.run_bits) / PAGS_SKY_BLOCK, 1, "sky's blocks"));
  PAGS_TRY(pags_frame_for(frame, tiles, 16, find_runs, &c));
  return pags_frame_for(frame, ((texels - 1) >> c.run_bits) + 1, 1, add_runs, &c);
}
