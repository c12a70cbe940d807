/* SPDX-License-Identifier: Apache-2.0 */
/* PAGS_EARLY_Z_PAPER: Early-Z as the paper describes it (Priority-Adaptive Gaussian Splatting, arXiv:2510.12282). It
 * is lossy and only here for comparison; no other mode uses it. There are two passes: a depth pre-pass writes the
 * depth of occluders, then the colour pass draws nothing that lies behind this depth.
 *
 * Occluders are Gaussians with S_sem > 0.5 and opacity >= 0.7; they write their depth at pixels where their alpha is
 * >= 1/2. (Of these three numbers, the paper gives only the first.) The second pass tests clusters, then Gaussians,
 * then (Gaussian, tile) pairs, then pixels. It loses what would have been visible through an occluder: one of alpha a
 * hides Gaussians whose weights at the pixel sum to up to 1 - a. The error has no bound. */
#include <math.h>
#include <string.h>

#include "frame/stages.h"

#define OCCLUDER_LOG2 (-0.51457317f) /* log2(0.7) */

enum { SIDE = 4, LEVELS = 16 }; /* 4x4-pixel blocks on a tile's side; pyramid levels, for up to 2^16 blocks a side */

typedef struct paper {
  pags_frame *frame;
  uint8_t *loaded;      /* per cluster: projected */
  uint8_t *hidden;      /* per cluster: 1 where all of it lies behind the occluders' depth */
  int32_t *dropped;     /* per cluster: number of projected members that lie behind the occluders' depth */
  int32_t *occluders;   /* per cluster: number of occluders */
  uint32_t *all_keys;   /* per dense index: the keys for the colour pass, while `keys` holds those of the pre-pass */
  pags_reach *reaches;  /* per dense index: the 4x4-pixel blocks that the splat may change */
  float *limits;        /* per tile: the occluders' farthest depth over its pixels; infinity if one is uncovered */
  float *level[LEVELS]; /* depth pyramid: the farthest depth over 1, 2x2, 4x4, ... blocks */
  int width[LEVELS], height[LEVELS], levels;
} paper;

/* ---- Finding occluders and drawing their depth ---- */

/* Reads and projects cluster i, and finds the tiles of its members. */
static void load(const paper *p, int64_t i, int worker) {
  const view_cluster *const c = p->frame->clusters + i;
  if (p->frame->touch)
    p->frame->touch(p->frame->touch_user, c->part, c->cluster, worker);
  pags_frame_project_cluster(p->frame, c, true, p->reaches + c->base);
  p->loaded[i] = 1;
}

/* Block function of the pre-pass: projects the clusters that hold critical Gaussians. On return, only occluders have
 * a key, so that only they are binned; the keys of all members are saved in all_keys. */
static void find_occluders(void *context, int64_t begin, int64_t end, int worker) {
  const paper *const p = context;
  const pags_frame *const f = p->frame;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const c = f->clusters + i;
    uint32_t *const keys = f->keys + c->base;
    const int padded = (c->count + 15) / 16 * 16;
    bool critical = false;
    p->loaded[i] = 0;
    for (int k = 0; k < c->count && !critical; k++)
      critical = frame_is_critical(f->parts + c->part, c->first + k);
    if (critical)
      load(p, i, worker);
    else
      memset(keys, 0xFF, (size_t)padded * sizeof *keys);
    memcpy(p->all_keys + c->base, keys, (size_t)padded * sizeof *keys);
    p->occluders[i] = 0;
    for (int k = 0; k < c->count; k++) {
      const float opacity = f->splats[c->base + k].log2_opacity - f->projections[c->part].alpha.lift;
      if (keys[k] != UINT32_MAX && opacity >= OCCLUDER_LOG2 && frame_is_critical(f->parts + c->part, c->first + k))
        p->occluders[i]++;
      else
        keys[k] = UINT32_MAX;
    }
  }
}

/* Block function: draws the occluders' depth into `hard`, tile by tile, and fills level 0 of the pyramid and the
 * tiles' limits. */
static void draw_depth(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const paper *const p = context;
  const pags_frame *const f = p->frame;
  for (int64_t tile = begin; tile < end; tile++) {
    const int tx = (int)(tile % f->tiles_x), ty = (int)(tile / f->tiles_x);
    const int64_t start = f->tile_start[tile];
    const pags_raster_in in = {.splats = f->splats,
                               .entries = f->entries + start,
                               .count = f->tile_start[tile + 1] - start,
                               .x0 = tx * PAGS_TILE,
                               .y0 = ty * PAGS_TILE,
                               .width = f->camera.width,
                               .height = f->camera.height};
    float farthest[PAGS_TILE_BLOCKS], limit = 0.0f;
    f->kernels->raster_depth(&in, f->hard + frame_tile_offset(f, tile), f->stride, farthest);
    for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
      p->level[0][(int64_t)(SIDE * ty + b / SIDE) * p->width[0] + SIDE * tx + b % SIDE] = farthest[b];
      limit = farthest[b] > limit ? farthest[b] : limit;
    }
    p->limits[tile] = limit;
  }
}

/* ---- Testing against the depth pyramid ---- */

/* Whether depth z lies behind the occluders' depth at all blocks of `r`. The test is made on the pyramid level on
 * which `r` covers at most 2 x 2 cells. */
static bool is_behind(const paper *p, pags_reach r, float z) {
  if (r.x0 >= r.x1 || r.y0 >= r.y1)
    return true;
  int level = 0, x0 = r.x0, x1 = r.x1 - 1, y0 = r.y0, y1 = r.y1 - 1;
  for (; level + 1 < p->levels && (x1 - x0 > 1 || y1 - y0 > 1); level++)
    x0 >>= 1, x1 >>= 1, y0 >>= 1, y1 >>= 1;
  for (int y = y0; y <= y1; y++)
    for (int x = x0; x <= x1; x++)
      if (!(z > p->level[level][(int64_t)y * p->width[level] + x]))
        return false;
  return true;
}

/* Block function of the colour pass: projects the clusters that are not hidden and not projected yet, and drops
 * members that lie behind the occluders' depth. */
static void choose_members(void *context, int64_t begin, int64_t end, int worker) {
  const paper *const p = context;
  const pags_frame *const f = p->frame;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const c = f->clusters + i;
    uint32_t *const keys = f->keys + c->base;
    p->dropped[i] = 0;
    p->hidden[i] = is_behind(p, f->bounds[i].reach, f->bounds[i].near);
    if (p->loaded[i])
      memcpy(keys, p->all_keys + c->base, (size_t)c->count * sizeof *keys);
    else if (!p->hidden[i])
      load(p, i, worker);
    for (int k = 0; k < c->count; k++)
      if (keys[k] != UINT32_MAX && (p->hidden[i] || is_behind(p, p->reaches[c->base + k], f->splats[c->base + k].z))) {
        keys[k] = UINT32_MAX;
        p->dropped[i]++;
      }
  }
}

/* ---- The two passes ---- */

static pags_result allocate(paper *p) {
  pags_frame *const f = p->frame;
  const int64_t clusters = f->cluster_count, dense = f->dense_count, tiles = (int64_t)f->tiles_x * f->tiles_y;
  PAGS_TRY(pags_frame_alloc(f, &p->loaded, clusters, 1, "cluster flags"));
  PAGS_TRY(pags_frame_alloc(f, &p->hidden, clusters, 1, "cluster flags"));
  PAGS_TRY(pags_frame_alloc(f, &p->dropped, clusters, sizeof *p->dropped, "cluster counts"));
  PAGS_TRY(pags_frame_alloc(f, &p->occluders, clusters, sizeof *p->occluders, "cluster counts"));
  PAGS_TRY(pags_frame_alloc(f, &p->all_keys, dense, sizeof *p->all_keys, "depth keys"));
  PAGS_TRY(pags_frame_alloc(f, &p->reaches, dense, sizeof *p->reaches, "reaches"));
  PAGS_TRY(pags_frame_alloc(f, &p->limits, tiles, sizeof *p->limits, "tile depths"));
  PAGS_TRY(pags_frame_alloc(f, &f->hard, f->plane_size, sizeof *f->hard, "occluders' depth"));
  PAGS_TRY(pags_frame_reserve_splats(f));
  do { /* the depth pyramid, down to one cell */
    const int l = p->levels++;
    p->width[l] = l ? (p->width[l - 1] + 1) / 2 : SIDE * f->tiles_x;
    p->height[l] = l ? (p->height[l - 1] + 1) / 2 : SIDE * f->tiles_y;
    PAGS_TRY(pags_frame_alloc(f, &p->level[l], (int64_t)p->width[l] * p->height[l], sizeof(float), "depth pyramid"));
  } while (p->levels < LEVELS && (p->width[p->levels - 1] > 1 || p->height[p->levels - 1] > 1));
  return PAGS_OK;
}

/* The depth pre-pass: finds the occluders, bins them, draws their depth, and builds the depth pyramid from it. */
static pags_result draw_occluders(paper *p) {
  pags_frame *const f = p->frame;
  const pags_frame_stats before = f->stats;
  PAGS_TRY(pags_frame_for(f, f->cluster_count, 8, find_occluders, p));
  PAGS_TRY(pags_stage_list(f));
  PAGS_TRY(pags_stage_bin(f));
  PAGS_TRY(pags_frame_for(f, (int64_t)f->tiles_x * f->tiles_y, 1, draw_depth, p));
  for (int l = 1; l < p->levels; l++) {
    /* A cell of level l holds the farthest depth of 2 x 2 cells of level l - 1. */
    const float *const from = p->level[l - 1];
    const int w = p->width[l - 1], h = p->height[l - 1];
    for (int y = 0; y < p->height[l]; y++)
      for (int x = 0; x < p->width[l]; x++) {
        float farthest = 0.0f;
        for (int k = 0; k < 4; k++) {
          const int fx = 2 * x + (k & 1), fy = 2 * y + (k >> 1);
          const float depth = fx < w && fy < h ? from[(int64_t)fy * w + fx] : 0.0f;
          farthest = depth > farthest ? depth : farthest;
        }
        p->level[l][(int64_t)y * p->width[l] + x] = farthest;
      }
  }
  f->stats = before; /* the pre-pass's pairs and Gaussians don't count in the picture's statistics */
  for (int64_t i = 0; i < f->cluster_count; i++)
    f->stats.occluders += p->occluders[i];
  return PAGS_OK;
}

pags_result pags_frame_early_z_paper(pags_frame *frame) {
  paper p = {.frame = frame};
  double since = pags_clock_ms();
  PAGS_TRY(allocate(&p));
  PAGS_TRY(draw_occluders(&p)); /* which sets back the statistics */
  pags_frame_stats *const s = &frame->stats;
  s->ms_occlude = pags_clock_lap_ms(&since);
  PAGS_TRY(pags_frame_for(frame, frame->cluster_count, 8, choose_members, &p));
  for (int64_t i = 0; i < frame->cluster_count; i++) {
    s->clusters_hidden += p.hidden[i] && !p.loaded[i];
    s->loaded += p.loaded[i] ? frame->clusters[i].count : 0;
    s->hidden += p.dropped[i];
  }
  s->ms_project = pags_clock_lap_ms(&since);
  PAGS_TRY(pags_stage_shade(frame));
  s->ms_shade = pags_clock_lap_ms(&since);
  frame->tile_limits = p.limits;
  PAGS_TRY(pags_stage_list(frame));
  PAGS_TRY(pags_stage_bin(frame));
  s->ms_bin = pags_clock_lap_ms(&since);
  PAGS_TRY(pags_stage_sort(frame));
  s->ms_sort = pags_clock_lap_ms(&since);
  PAGS_TRY(pags_stage_raster(frame));
  s->ms_raster = pags_clock_lap_ms(&since);
  s->slabs = 1;
  return PAGS_OK;
}
