/* Frames within a time: the choice of what the rest gives up, and the two pictures that a frame is put together from. */
#include <assert.h>
#include <math.h>
#include <pags/budget.h>
#include <stdlib.h>
#include <string.h>

#include "stages.h"

/* Ordered by what they cost on trained streets. From scale 1.5 on nothing is gained by cutting more: small things vanish in the pixels. */
static const pags_budget_step steps[PAGS_BUDGET_STEPS] = {
    {1.0f, 0, 0.0f}, {1.0f, 3, 0.0f}, {1.0f, 3, 0.25f}, {1.0f, 3, 1.0f},  {1.5f, 3, 0.25f},
    {2.0f, 3, 0.25f}, {2.5f, 3, 0.5f}, {3.0f, 3, 0.5f},  {4.0f, 3, 0.75f}, {6.0f, 3, 1.0f}};

/* Guesses to begin with; what is measured replaces them. */
static const double first_shares[PAGS_BUDGET_STEPS] = {1.0, 0.97, 0.9, 0.8, 0.75, 0.6, 0.5, 0.45, 0.4, 0.35};

#define MARGIN 1.12 /* frames of one path differ by so much from one to the next */

const pags_budget_step *pags_budget_steps(void) { return steps; }

pags_budget_controller pags_budget_controller_begin(double target_ms) {
  pags_budget_controller out = {.target = target_ms, .last_step = -1};
  memcpy(out.share, first_shares, sizeof out.share);
  return out;
}

/* Two frames one after the other at different steps tell the steps' ratio, the view having hardly changed. */
static void learn(pags_budget_controller *c, double ms) {
  const int k = c->step;
  if (c->last_step < 0 || c->last_step == k || !(c->last_ms > 0.0))
    return;
  const double told = c->share[c->last_step] * ms / c->last_ms;
  if (k == 0) { /* the measure of all others: they are corrected */
    const double by = fmin(fmax(c->share[c->last_step] / told, 0.5), 2.0);
    for (int j = 1; j < PAGS_BUDGET_STEPS; j++)
      c->share[j] *= sqrt(by);
  } else {
    c->share[k] = 0.5 * (c->share[k] + told);
  }
  c->share[k] = k == 0 ? 1.0 : c->share[k];
  for (int j = 1; j < PAGS_BUDGET_STEPS; j++) { /* a later step never costs more */
    c->share[j] = fmin(fmax(c->share[j], 0.01), 1.0);
    if (j < k)
      c->share[j] = fmax(c->share[j], c->share[k]);
    else if (j > k)
      c->share[j] = fmin(c->share[j], c->share[k]);
  }
}

void pags_budget_controller_tell(pags_budget_controller *c, double ms) {
  if (!(ms > 0.0) || !isfinite(ms))
    return;
  learn(c, ms);
  const double now = ms / c->share[c->step];
  c->full = now > c->full ? now : 0.7 * c->full + 0.3 * now; /* up at once, down slowly */
  int next = 0;
  while (next + 1 < PAGS_BUDGET_STEPS && c->full * c->share[next] * MARGIN > c->target)
    next++;
  c->last_step = c->step;
  c->last_ms = ms;
  c->step = next < c->step - 1 ? c->step - 1 : next;
}

struct pags_budget {
  pags_budget_controller controller;
  pags_frame *full, *rest;
  uint8_t *critical; /* per id */
  int64_t count;
  uint8_t *tiles;
  int64_t tile_capacity;
};

pags_result pags_budget_create(pags_tasks *tasks, double target_ms, const float *priority, int64_t count, pags_budget **out) {
  assert(target_ms > 0.0 && count >= 0);
  *out = NULL;
  pags_budget *const b = calloc(1, sizeof *b);
  uint8_t *const critical = calloc((size_t)count + 1, 1);
  if (!b || !critical) {
    free(b);
    free(critical);
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for the priorities of %lld Gaussians", (long long)count);
  }
  *b = (pags_budget){.controller = pags_budget_controller_begin(target_ms), .critical = critical, .count = count};
  for (int64_t i = 0; i < count && priority; i++)
    critical[i] = priority[i] > 0.5f;
  pags_result result = pags_frame_create(tasks, &b->full);
  if (result == PAGS_OK)
    result = pags_frame_create(tasks, &b->rest);
  if (result != PAGS_OK) {
    pags_budget_destroy(b);
    return result;
  }
  *out = b;
  return PAGS_OK;
}

void pags_budget_destroy(pags_budget *budget) {
  if (!budget)
    return;
  pags_frame_destroy(budget->full);
  pags_frame_destroy(budget->rest);
  free(budget->critical);
  free(budget->tiles);
  free(budget);
}

/* Covers all of the picture: what is over at the right and at the bottom is drawn, too. */
static pags_camera smaller(const pags_camera *camera, float scale) {
  const double s = (double)scale;
  pags_camera out = *camera;
  out.width = (int)ceil(camera->width / s);
  out.height = (int)ceil(camera->height / s);
  out.fx /= s;
  out.fy /= s;
  out.cx /= s;
  out.cy /= s;
  return out;
}

static pags_result prepare_tiles(pags_budget *b, const pags_camera *camera) {
  const int64_t tiles = (int64_t)((camera->width + PAGS_TILE - 1) / PAGS_TILE) * ((camera->height + PAGS_TILE - 1) / PAGS_TILE);
  if (tiles > b->tile_capacity) {
    free(b->tiles);
    b->tile_capacity = 0;
    b->tiles = malloc((size_t)tiles);
    if (!b->tiles)
      return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld tiles", (long long)tiles);
    b->tile_capacity = tiles;
  }
  memset(b->tiles, 0, (size_t)tiles);
  return PAGS_OK;
}

/* Tiles in which a pixel of the small picture, or one beside it, shows something critical. Returns their share. */
static double mark_tiles(pags_budget *b, const pags_picture *small, const pags_camera *camera, float scale) {
  const int tiles_x = (camera->width + PAGS_TILE - 1) / PAGS_TILE, tiles_y = (camera->height + PAGS_TILE - 1) / PAGS_TILE;
  const float side = scale / PAGS_TILE;
  for (int y = 0; y < small->height; y++)
    for (int x = 0; x < small->width; x++) {
      const int32_t id = small->id[(int64_t)y * small->stride + x];
      if (id < 0 || id >= b->count || !b->critical[id])
        continue;
      const int x0 = (int)(side * (float)(x > 0 ? x - 1 : 0)), y0 = (int)(side * (float)(y > 0 ? y - 1 : 0));
      const int x1 = (int)(side * ((float)x + 1.999f)), y1 = (int)(side * ((float)y + 1.999f));
      for (int ty = y0; ty <= y1 && ty < tiles_y; ty++)
        for (int tx = x0; tx <= x1 && tx < tiles_x; tx++)
          b->tiles[ty * tiles_x + tx] = 1;
    }
  int64_t marked = 0;
  for (int64_t i = 0; i < (int64_t)tiles_x * tiles_y; i++)
    marked += b->tiles[i];
  return (double)marked / ((double)tiles_x * tiles_y);
}

typedef struct enlarging {
  pags_frame *full;
  const pags_picture *small;
  const uint8_t *tiles;
  float scale;
} enlarging;

typedef struct sample { /* between two pixels of a row or column */
  int a, b;
  float t; /* weight of b */
} sample;

static sample sample_at(int x, float scale, int size) {
  const float at = ((float)x + 0.5f) / scale - 0.5f;
  const int a = at > 0.0f ? (int)at : 0, last = size - 1;
  return (sample){a < last ? a : last, a + 1 < last ? a + 1 : last, at > 0.0f ? at - (float)(int)at : 0.0f};
}

static void enlarge_row(const enlarging *e, int y, int x0, int x1) {
  const pags_picture *const p = e->small;
  const float *const from[4] = {p->rgb[0], p->rgb[1], p->rgb[2], p->transmittance};
  float *const to = e->full->planes + (int64_t)y * e->full->stride;
  const sample v = sample_at(y, e->scale, p->height);
  for (int x = x0; x < x1; x++) {
    const sample u = sample_at(x, e->scale, p->width);
    for (int k = 0; k < 4; k++) {
      const float *const top = from[k] + (int64_t)v.a * p->stride, *const bottom = from[k] + (int64_t)v.b * p->stride;
      const float above = top[u.a] + (top[u.b] - top[u.a]) * u.t, below = bottom[u.a] + (bottom[u.b] - bottom[u.a]) * u.t;
      to[k * e->full->plane_size + x] = above + (below - above) * v.t;
    }
  }
}

static void take_nearest(const enlarging *e, int y, int x0, int x1) {
  const pags_picture *const p = e->small;
  const int sy = (int)((float)y / e->scale), row = sy < p->height ? sy : p->height - 1;
  int32_t *const ids = (int32_t *)(void *)frame_plane(e->full, PLANE_ID);
  for (int x = x0; x < x1; x++) {
    const int sx = (int)((float)x / e->scale);
    const int64_t from = (int64_t)row * p->stride + (sx < p->width ? sx : p->width - 1), to = (int64_t)y * e->full->stride + x;
    frame_plane(e->full, PLANE_DEPTH)[to] = p->depth[from];
    frame_plane(e->full, PLANE_DEPTH_SUM)[to] = p->depth_sum[from];
    ids[to] = p->id[from];
  }
}

_Static_assert(PLANE_R == 0 && PLANE_G == 1 && PLANE_B == 2 && PLANE_T == 3, "enlarge_row goes through them");

static void enlarge_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const enlarging *const e = context;
  const pags_frame *const f = e->full;
  (void)worker;
  for (int64_t tile = begin; tile < end; tile++) {
    if (e->tiles[tile])
      continue;
    const int x0 = (int)(tile % f->tiles_x) * PAGS_TILE, y0 = (int)(tile / f->tiles_x) * PAGS_TILE;
    const int x1 = x0 + PAGS_TILE < f->camera.width ? x0 + PAGS_TILE : f->camera.width;
    for (int y = y0; y < y0 + PAGS_TILE && y < f->camera.height; y++) {
      enlarge_row(e, y, x0, x1);
      if (f->options.extra_channels)
        take_nearest(e, y, x0, x1);
    }
  }
}

static pags_result draw_apart(pags_budget *b, const pags_budget_step *step, const pags_part *parts, int part_count,
                              const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                              pags_budget_facts *facts) {
  const pags_camera small_camera = smaller(camera, step->scale);
  pags_frame_options rest = *options, full = *options;
  pags_picture small;
  rest.rest_cut = step->cut;
  rest.rest_sh_less = step->sh_less;
  rest.extra_channels = 1;
  rest.exp_degree = 3;
  PAGS_TRY(prepare_tiles(b, camera));
  PAGS_TRY(pags_frame_render(b->rest, parts, part_count, &small_camera, &rest, NULL, NULL, &small));
  facts->rest = *pags_frame_stats_get(b->rest);
  facts->full_tiles = mark_tiles(b, &small, camera, step->scale);
  full.tiles = b->tiles;
  PAGS_TRY(pags_frame_render(b->full, parts, part_count, camera, &full, NULL, NULL, out));
  enlarging e = {b->full, &small, b->tiles, step->scale};
  return pags_frame_for(b->full, (int64_t)b->full->tiles_x * b->full->tiles_y, 16, enlarge_tiles, &e);
}

pags_result pags_budget_render_step(pags_budget *b, int step, const pags_part *parts, int part_count, const pags_camera *camera,
                                    const pags_frame_options *options, pags_picture *out, pags_budget_facts *facts) {
  assert(step >= 0 && step < PAGS_BUDGET_STEPS && options->early_z != PAGS_EARLY_Z_PAPER);
  const double begun = pags_clock_ms();
  const pags_budget_step *const s = steps + step;
  *facts = (pags_budget_facts){.step = step, .full_tiles = 1.0};
  if (s->scale > 1.0f) {
    PAGS_TRY(draw_apart(b, s, parts, part_count, camera, options, out, facts));
  } else {
    pags_frame_options reduced = *options;
    reduced.rest_cut = s->cut;
    reduced.rest_sh_less = s->sh_less;
    PAGS_TRY(pags_frame_render(b->full, parts, part_count, camera, &reduced, NULL, NULL, out));
  }
  facts->full = *pags_frame_stats_get(b->full);
  facts->ms = pags_clock_ms() - begun;
  facts->met = facts->ms <= b->controller.target;
  return PAGS_OK;
}

pags_result pags_budget_render(pags_budget *b, const pags_part *parts, int part_count, const pags_camera *camera,
                               const pags_frame_options *options, pags_picture *out, pags_budget_facts *facts) {
  const bool first = b->controller.last_step < 0;
  PAGS_TRY(pags_budget_render_step(b, b->controller.step, parts, part_count, camera, options, out, facts));
  pags_budget_controller_tell(&b->controller, facts->ms);
  if (!first || facts->met)
    return PAGS_OK;
  PAGS_TRY(pags_budget_render_step(b, b->controller.step, parts, part_count, camera, options, out, facts));
  pags_budget_controller_tell(&b->controller, facts->ms);
  return PAGS_OK;
}
