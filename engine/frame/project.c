/* SPDX-License-Identifier: Apache-2.0 */
/* The stages project and shade: projection of Gaussians to the screen (EWA splatting, Zwicker et al. 2001) and their
 * colours from spherical harmonics. They run the kernels over the clusters in view; the maths is in simd/projection.h
 * and simd/sh.h. Where nothing is left out in between, clusters are shaded while their splats are in the cache. */
#include <string.h>

#include "frame/stages.h"

enum { CLUSTERS_AT_A_TIME = 8 }; /* a worker's block, whose splats stay in its cache until they are shaded */

/* 2^x with a relative error of a third of a per cent, for -100 < x < 100. That is precise enough to decide which
 * Gaussians rest_cut removes. */
static float exp2_about(float x) {
  const int whole = (int)(x + 128.0f) - 128; /* floor(x), without a call of floorf */
  const float f = x - (float)whole;
  const uint32_t bits = (uint32_t)(whole + 127) << 23;
  float power;
  memcpy(&power, &bits, sizeof power);
  return power * (1.0f + f * (0.6565f + 0.3435f * f));
}

void pags_frame_project_cluster(const pags_frame *frame, const view_cluster *c, bool tiles, pags_reach *reaches) {
  const pags_part *const part = frame->parts + c->part;
  pags_splat *const splats = frame->splats + c->base;
  uint32_t *const keys = frame->keys + c->base;
  row_scratch scratch;
  int64_t stride;
  const float *const rows = pags_frame_geometry(part, c, &scratch, &stride);
  const pags_projection view = frame_projection(frame, c);
  const pags_project_counts counts =
      frame->kernels->project(&view, rows, stride, part->opacity_factor ? part->opacity_factor + c->first : NULL,
                              c->count, splats, keys, tiles, frame->boxes + c->base, reaches);
  if (frame->counts)
    frame->counts[c - frame->clusters] = counts;
  /* Drops Gaussians that aren't critical and whose opacity times area on the picture, px, is below options.rest_cut.
   * With k = log2(e) / 2: area = 2 pi sqrt(det),  p w = k / sqrt(det). */
  for (int k = 0; k < c->count && frame->options.rest_cut > 0.0f; k++)
    if (keys[k] != UINT32_MAX &&
        exp2_about(splats[k].log2_opacity) * 4.5323601f / (splats[k].p * splats[k].w) < frame->options.rest_cut &&
        !frame_is_critical(part, c->first + k))
      keys[k] = UINT32_MAX;
  for (int k = 0; k < c->count; k++)
    if (keys[k] != UINT32_MAX)
      splats[k].id = part_id(part, c->first + k);
  /* In the paper's order the sign bit, unused since z > 0, sorts the others behind critical ones. */
  if (frame->options.order == PAGS_ORDER_PAPER)
    for (int k = 0; k < c->count; k++)
      if (keys[k] != UINT32_MAX && !frame_is_critical(part, c->first + k))
        keys[k] |= UINT32_C(1) << 31;
  for (int k = c->count; k % 16 != 0; k++)
    keys[k] = UINT32_MAX;
}

void pags_frame_box_members(const pags_frame *frame, int64_t first, int count) {
  frame->kernels->tile_boxes(frame->splats + first, frame->keys + first, count, frame->tiles_x, frame->tiles_y,
                             frame->boxes + first);
}

pags_result pags_frame_reserve_splats(pags_frame *frame) {
  PAGS_TRY(pags_frame_alloc(frame, &frame->splats, frame->dense_count, sizeof *frame->splats, "projected Gaussians"));
  PAGS_TRY(pags_frame_alloc(frame, &frame->keys, frame->dense_count, sizeof *frame->keys, "depth keys"));
  return pags_frame_alloc(frame, &frame->boxes, frame->dense_count, sizeof *frame->boxes, "tiles of Gaussians");
}

pags_projection pags_frame_shading(const pags_frame *frame, const view_cluster *c) {
  pags_projection view = frame->projections[c->part];
  for (int k = 0; k < c->count && frame->options.rest_sh_less; k++)
    if (frame_is_critical(frame->parts + c->part, c->first + k))
      return view;
  view.sh_degree = view.sh_degree > frame->options.rest_sh_less ? view.sh_degree - frame->options.rest_sh_less : 0;
  return view;
}

/* Block function: computes the colours of the drawn members of clusters [begin, end). */
static void shade_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const pags_frame *const frame = context;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const c = frame->clusters + i;
    const pags_part *const part = frame->parts + c->part;
    row_scratch scratch;
    int64_t stride;
    int k = 0;
    while (part->packed && k < c->count && frame->keys[c->base + k] == UINT32_MAX)
      k++;
    if (k == c->count) /* nothing to unpack */
      continue;
    const pags_projection view = pags_frame_shading(frame, c);
    const float *const rows = pags_frame_colours(part, c, view.sh_degree, &scratch, &stride);
    frame->kernels->shade(&view, rows, stride, part->sh ? part->sh + c->first : NULL, c->count, frame->keys + c->base,
                          frame->splats + c->base);
  }
}

pags_result pags_stage_shade(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "shade");
  return pags_frame_for(frame, frame->cluster_count, CLUSTERS_AT_A_TIME, shade_block, frame);
}

typedef struct project_context {
  pags_frame *frame;
  double (*ms)[8]; /* per worker: of projecting, of shading; on separate cache lines */
} project_context;

/* Block function: projects clusters [begin, end), finds their tiles and shades them. */
static void project_block(void *context, int64_t begin, int64_t end, int worker) {
  const project_context *const p = context;
  pags_frame *const frame = p->frame;
  const double t0 = pags_clock_ms();
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const c = frame->clusters + i;
    pags_frame_project_cluster(frame, c, !frame->extents, NULL);
    if (!frame->extents)
      continue;
    for (int64_t k = c->base; k < c->base + c->count; k++)
      memcpy(frame->extents[k], frame->boxes[k].extent, sizeof frame->extents[k]);
    pags_frame_box_members(frame, c->base, c->count);
    for (int64_t k = c->base; k < c->base + c->count; k++)
      if (frame->keys[k] != UINT32_MAX && frame->splats[k].tiles > 0)
        frame->splats[k].tiles = 1;
  }
  const double t1 = pags_clock_ms();
  shade_block(frame, begin, end, worker);
  p->ms[worker][0] += t1 - t0;
  p->ms[worker][1] += pags_clock_ms() - t1;
}

pags_result pags_stage_project(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "project");
  const double t0 = pags_clock_ms();
  const int workers = pags_tasks_workers(frame->tasks);
  project_context p = {.frame = frame};
  PAGS_TRY(pags_frame_alloc(frame, &p.ms, workers, sizeof *p.ms, "times"));
  PAGS_TRY(pags_frame_reserve_splats(frame));
  memset(p.ms, 0, (size_t)workers * sizeof *p.ms);
  PAGS_TRY(pags_frame_for(frame, frame->cluster_count, CLUSTERS_AT_A_TIME, project_block, &p));

  /* The time of both is shared out as the workers spent it. */
  double sums[2] = {0, 0};
  for (int w = 0; w < workers; w++)
    sums[0] += p.ms[w][0], sums[1] += p.ms[w][1];
  const double whole = pags_clock_ms() - t0, shading = sums[1] > 0 ? whole * sums[1] / (sums[0] + sums[1]) : 0;
  frame->stats.ms_project = whole - shading;
  frame->stats.ms_shade = shading;
  return PAGS_OK;
}

const float *pags_frame_geometry(const pags_part *part, const view_cluster *cluster, row_scratch *scratch,
                                 int64_t *stride) {
  *stride = part->packed ? PAGS_PACKED_ROWS : part->gaussians->stride;
  if (!part->packed)
    return part->gaussians->data + cluster->first;
  pags_packed_geometry(part->packed, cluster->cluster, scratch->planes);
  return scratch->planes;
}

const float *pags_frame_colours(const pags_part *part, const view_cluster *cluster, int sh_degree, row_scratch *scratch,
                                int64_t *stride) {
  *stride = part->packed ? PAGS_PACKED_ROWS : part->gaussians->stride;
  if (!part->packed)
    return part->gaussians->data + cluster->first;
  pags_packed_means(part->packed, cluster->cluster, scratch->planes);
  pags_packed_colours(part->packed, cluster->cluster, sh_degree, scratch->planes + PAGS_SH * PAGS_PACKED_ROWS);
  return scratch->planes;
}
