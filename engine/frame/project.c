/* SPDX-License-Identifier: Apache-2.0 */
/* The stages project and shade: projection of Gaussians to the screen (EWA splatting, Zwicker et al. 2001) and their
 * colours from spherical harmonics. They run the kernels over the clusters in view; the maths is in simd/project.inl
 * and simd/shade.inl. */
#include <string.h>

#include "frame/stages.h"

enum { CLUSTERS_AT_A_TIME = 4 }; /* a worker's block */

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

/* The opacity of a projected Gaussian times its area on the screen, px. With k = log2(e) / 2:
 *   area = 2 pi sqrt(det),  p w = k / sqrt(det). */
static float weight_of(const pags_splat *s) {
  return exp2_about(s->log2_opacity) * 4.5323601f / (s->p * s->w);
}

/* Drops the cluster's Gaussians that aren't critical and whose opacity times area is below options.rest_cut. */
static void cut_rest(const pags_frame *frame, const view_cluster *c, const pags_splat *splats, uint32_t *keys) {
  const pags_part *const part = frame->parts + c->part;
  for (int k = 0; k < c->count; k++)
    if (keys[k] != UINT32_MAX && weight_of(splats + k) < frame->options.rest_cut &&
        !frame_is_critical(part, c->first + k))
      keys[k] = UINT32_MAX;
}

void pags_frame_project_cluster(const pags_frame *frame, const view_cluster *c, pags_reach *reaches) {
  const pags_part *const part = frame->parts + c->part;
  pags_splat *const splats = frame->splats + c->base;
  uint32_t *const keys = frame->keys + c->base;
  row_scratch scratch;
  int64_t stride;
  const float *const rows = pags_frame_geometry(part, c, &scratch, &stride);
  frame->kernels->project(frame->projections + c->part, rows, stride,
                          part->opacity_factor ? part->opacity_factor + c->first : NULL, c->count, splats, keys,
                          frame->boxes + c->base, reaches);
  if (frame->options.rest_cut > 0.0f)
    cut_rest(frame, c, splats, keys);
  for (int k = 0; k < c->count; k++)
    if (keys[k] != UINT32_MAX)
      splats[k].id = part_id(part, c->first + k);
  if (frame->options.order ==
      PAGS_ORDER_PAPER) /* the sign bit, unused since z > 0, sorts the others behind critical ones */
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

static void project_block(void *context, int64_t begin, int64_t end, int worker) {
  const pags_frame *const frame = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const c = frame->clusters + i;
    pags_frame_project_cluster(frame, c, NULL);
    for (int64_t k = c->base; frame->extents && k < c->base + c->count; k++)
      memcpy(frame->extents[k], frame->boxes[k].extent, sizeof frame->extents[k]);
    pags_frame_box_members(frame, c->base, c->count);
    for (int64_t k = c->base; frame->extents && k < c->base + c->count; k++)
      if (frame->keys[k] != UINT32_MAX && frame->splats[k].tiles > 0)
        frame->splats[k].tiles = 1;
  }
}

pags_result pags_frame_reserve_splats(pags_frame *frame) {
  frame->splats = pags_frame_alloc(frame, frame->dense_count, sizeof *frame->splats, "projected Gaussians");
  frame->keys = pags_frame_alloc(frame, frame->dense_count, sizeof *frame->keys, "depth keys");
  frame->boxes = pags_frame_alloc(frame, frame->dense_count, sizeof *frame->boxes, "tiles of Gaussians");
  return frame->splats && frame->keys && frame->boxes ? PAGS_OK : PAGS_ERROR_MEMORY;
}

pags_result pags_stage_project(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "project");
  PAGS_TRY(pags_frame_reserve_splats(frame));
  return pags_frame_for(frame, frame->cluster_count, CLUSTERS_AT_A_TIME, project_block, frame);
}

static bool is_any_drawn(const uint32_t *keys, int count) {
  for (int k = 0; k < count; k++)
    if (keys[k] != UINT32_MAX)
      return true;
  return false;
}

pags_projection pags_frame_shading(const pags_frame *frame, const view_cluster *c) {
  pags_projection view = frame->projections[c->part];
  if (frame->options.rest_sh_less == 0)
    return view;
  for (int k = 0; k < c->count; k++)
    if (frame_is_critical(frame->parts + c->part, c->first + k))
      return view;
  view.sh_degree = view.sh_degree > frame->options.rest_sh_less ? view.sh_degree - frame->options.rest_sh_less : 0;
  return view;
}

static void shade_block(void *context, int64_t begin, int64_t end, int worker) {
  const pags_frame *const frame = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const c = frame->clusters + i;
    const pags_part *const part = frame->parts + c->part;
    row_scratch scratch;
    int64_t stride;
    if (part->packed && !is_any_drawn(frame->keys + c->base, c->count))
      continue;
    const pags_projection view = pags_frame_shading(frame, c);
    const float *const rows = pags_frame_colours(part, c, view.sh_degree, &scratch, &stride);
    frame->kernels->shade(&view, rows, stride, part->dc ? part->dc + c->first : NULL, c->count, frame->keys + c->base,
                          frame->splats + c->base);
  }
}

pags_result pags_stage_shade(pags_frame *frame) {
  pags_tasks_mark(frame->tasks, NULL, "shade");
  return pags_frame_for(frame, frame->cluster_count, CLUSTERS_AT_A_TIME, shade_block, frame);
}

const float *pags_frame_geometry(const pags_part *part, const view_cluster *cluster, row_scratch *scratch,
                                 int64_t *stride) {
  if (!part->packed) {
    *stride = part->gaussians->stride;
    return part->gaussians->data + cluster->first;
  }
  *stride = PAGS_PACKED_ROWS;
  pags_packed_geometry(part->packed, cluster->cluster, scratch->planes);
  return scratch->planes;
}

const float *pags_frame_colours(const pags_part *part, const view_cluster *cluster, int sh_degree, row_scratch *scratch,
                                int64_t *stride) {
  if (!part->packed) {
    *stride = part->gaussians->stride;
    return part->gaussians->data + cluster->first;
  }
  *stride = PAGS_PACKED_ROWS;
  pags_packed_means(part->packed, cluster->cluster, scratch->planes);
  pags_packed_colours(part->packed, cluster->cluster, sh_degree, scratch->planes + PAGS_SH * PAGS_PACKED_ROWS);
  return scratch->planes;
}
