/* SPDX-License-Identifier: Apache-2.0 */
/* The backward pass of a frame: from the loss's gradient by the picture to the gradients of the Gaussians'
 * parameters. Each tile writes one partial gradient per (Gaussian, tile) pair to a slot of its own, so no atomics are
 * needed. Then each cluster sums its members' slots, goes back through shading and projection, and hands the
 * gradients of its rows to the caller's receiver while they are in the cache. No array of all gradients exists.
 *
 * A sky needs no extra work in the tiles: its term of the picture, T sky, depends on the transmittance T as that of a
 * background colour does. The kernel (simd/raster_backward.c) subtracts the Gaussians' contributions from the
 * picture's colours front to back, so that either term is contained in the remainder. Only the texels of the sky have
 * a gradient of their own (sky.c). */
#include <assert.h>
#include <stdatomic.h>
#include <string.h>

#include "frame/members.h"

typedef struct backward_context {
  pags_frame *frame;
  const pags_picture_gradient *gradient;
  float *written;     /* the slots, where they are written */
  const float *slots; /* and where they are read */
  int first_part;     /* clusters of parts before it are left out */
  pags_receive_fn *receive;
  void *user;
  float *scratch;       /* per worker: SCRATCH_PLANES planes of MOST_MEMBERS floats */
  uint8_t *drawn, *bad; /* per worker: MOST_MEMBERS flags each */
  member_scratch *members;
  atomic_llong bad_rows;
} backward_context;

enum { SCRATCH_PLANES = PAGS_MAX_PLANES + 3 };
enum { TILES_AT_A_TIME = 4 }; /* a worker's block of tiles, as in raster.c */

static const float *at_tile(const float *plane, int64_t at) {
  return plane ? plane + at : NULL;
}

/* Block function: the backward pass of the rasteriser over tiles [begin, end). */
static void tiles_backward(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const backward_context *const c = context;
  const pags_frame *const f = c->frame;
  for (int64_t tile = begin; tile < end; tile++) {
    const int64_t at = frame_tile_offset(f, tile);
    pags_raster_back in = {.tile = frame_drawn_tile(f, tile, c->written),
                           .transmittance = frame_plane(f, PLANE_T) + at,
                           .depth_sum = frame_plane(f, PLANE_DEPTH_SUM) + at,
                           .transmittance_gradient = at_tile(c->gradient->transmittance, at),
                           .counted = at_tile(c->gradient->counted, at)};
    /* Depth gradients are sparse, since they come from LiDAR points; tiles whose pixels all have 0 take the faster
     * kernel without depth, which gives the same bits. */
    const float *const depth = at_tile(c->gradient->depth_sum, at);
    for (int i = 0; depth && i < PAGS_TILE_PIXELS && !in.depth_gradient; i++)
      if (depth[(int64_t)(i / PAGS_TILE) * f->stride + i % PAGS_TILE] != 0.0f)
        in.depth_gradient = depth;
    for (int k = 0; k < 3; k++)
      in.rgb_gradient[k] = c->gradient->rgb[k] + at;
    if (tile + 1 < end) { /* the worker's next tile, which the kernel prefetches */
      const pags_picture_gradient *const g = c->gradient;
      const float *const planes[PAGS_BACK_PLANES] = {frame_plane(f, PLANE_R),
                                                     frame_plane(f, PLANE_G),
                                                     frame_plane(f, PLANE_B),
                                                     frame_plane(f, PLANE_T),
                                                     g->rgb[0],
                                                     g->rgb[1],
                                                     g->rgb[2],
                                                     g->transmittance,
                                                     g->depth_sum,
                                                     g->depth_sum ? frame_plane(f, PLANE_DEPTH_SUM) : NULL};
      in.next_count = f->tile_start[tile + 2] - f->tile_start[tile + 1];
      for (int k = 0; k < PAGS_BACK_PLANES; k++)
        in.next[k] = at_tile(planes[k], frame_tile_offset(f, tile + 1));
    }
    f->kernels->raster_backward(&in);
  }
}

/* Adds up the squared derivatives in a cluster's slots, in the order of their tiles; `out` receives one float per
 * member. */
static void add_squares(const view_cluster *v, const frame_members *members, const float *slots, float *out) {
  for (int k = 0; k < v->count; k++) {
    const float *slot = slots + members->slot_start[k] * PAGS_SLOT_FLOATS + PAGS_SLOT_SQUARED;
    const uint32_t tiles = members->keys[k] != UINT32_MAX ? members->splats[k].tiles : 0;
    out[k] = tiles > 0 ? *slot : 0.0f;
    for (uint32_t i = 1; i < tiles; i++)
      out[k] += slot[i * PAGS_SLOT_FLOATS];
  }
}

/* Block function: sums the slots of the members of clusters [begin, end), goes back through shading and projection,
 * and calls the receiver. */
static void clusters_backward(void *context, int64_t begin, int64_t end, int worker) {
  backward_context *const c = context;
  const pags_frame *const f = c->frame;
  float *const scratch = c->scratch + (int64_t)worker * SCRATCH_PLANES * MOST_MEMBERS;
  uint8_t *const drawn = c->drawn + (int64_t)worker * MOST_MEMBERS, *const bad_planes =
                                                                        c->bad + (int64_t)worker * MOST_MEMBERS;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const v = f->clusters + i;
    if (v->part < c->first_part)
      continue;
    const pags_part *const part = f->parts + v->part;
    const pags_gaussians *const g = part->gaussians;
    const pags_projection *const view = f->projections + v->part;
    const int stride = (v->count + 15) / 16 * 16, planes = pags_plane_count(view->sh_degree);
    float *const extra = scratch + (int64_t)planes * stride;
    const pags_row_gradient rows = {scratch, stride, extra, extra + stride, bad_planes};
    memset(bad_planes, 0, (size_t)v->count);
    const frame_members members = pags_frame_members(f, v, c->members, worker);
    const int bad =
        f->kernels->project_backward(view, g->data + v->first, g->stride, part->sh ? part->sh + v->first : NULL,
                                     v->count, members.keys, members.splats, members.slot_start, c->slots, &rows);
    if (bad)
      atomic_fetch_add(&c->bad_rows, bad);
    float *const squared = f->options.squared ? extra + 2 * stride : NULL;
    if (squared)
      add_squares(v, &members, c->slots, squared);
    for (int k = 0; k < v->count; k++)
      drawn[k] = members.keys[k] != UINT32_MAX && members.splats[k].tiles > 0;
    const pags_cluster_gradient out = {.part = v->part,
                                       .cluster = v->cluster,
                                       .first = v->first,
                                       .count = v->count,
                                       .stride = stride,
                                       .planes = planes,
                                       .data = scratch,
                                       .mean2d = rows.mean2d,
                                       .squared = squared,
                                       .radius = rows.radius,
                                       .drawn = drawn,
                                       .bad = bad_planes};
    c->receive(c->user, &out, worker);
  }
}

pags_result pags_stage_raster_backward(pags_frame *frame, const pags_picture_gradient *gradient, float **slots) {
  assert(frame->rendered && frame->options.keep_for_backward && gradient->rgb[0]);
  assert(!gradient->depth_sum || frame->options.extra_channels || frame->options.depth_sum);
  const double t0 = pags_clock_ms();
  pags_tasks_mark(frame->tasks, NULL, "raster backward");
  backward_context c = {.frame = frame, .gradient = gradient};
  PAGS_TRY(pags_frame_alloc(frame, &c.written, frame->stats.pairs_binned * PAGS_SLOT_FLOATS, sizeof *c.written,
                            "gradient slots"));
  *slots = c.written;
  PAGS_TRY(pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, TILES_AT_A_TIME, tiles_backward, &c));
  const double t1 = pags_clock_ms();
  if (frame->has_sky && gradient->sky)
    PAGS_TRY(pags_frame_sky_backward(frame, gradient));
  const double t2 = pags_clock_ms();
  frame->stats.ms_sky_backward = t2 - t1;
  frame->stats.ms_raster_backward = t2 - t0;
  return PAGS_OK;
}

pags_result pags_stage_project_backward(pags_frame *frame, int first_part, const float *slots, pags_receive_fn *receive,
                                        void *user, int64_t *bad_rows) {
  const double t0 = pags_clock_ms();
  const int workers = pags_tasks_workers(frame->tasks);
  pags_tasks_mark(frame->tasks, NULL, "project backward");
  backward_context c = {.frame = frame, .slots = slots, .first_part = first_part, .receive = receive, .user = user};
  atomic_init(&c.bad_rows, 0);
  PAGS_TRY(pags_frame_alloc(frame, &c.scratch, (int64_t)workers * SCRATCH_PLANES * MOST_MEMBERS, sizeof *c.scratch,
                            "gradient rows"));
  PAGS_TRY(pags_frame_alloc(frame, &c.drawn, (int64_t)workers * MOST_MEMBERS, 1, "drawn flags"));
  PAGS_TRY(pags_frame_alloc(frame, &c.bad, (int64_t)workers * MOST_MEMBERS, 1, "flags of gradients"));
  PAGS_TRY(pags_frame_reserve_members(frame, &c.members));
  PAGS_TRY(pags_frame_for(frame, frame->cluster_count, 4, clusters_backward, &c));
  frame->stats.ms_project_backward = pags_clock_ms() - t0;
  if (bad_rows)
    *bad_rows = (int64_t)atomic_load(&c.bad_rows);
  return PAGS_OK;
}

pags_result pags_frame_backward(pags_frame *frame, const pags_picture_gradient *gradient, pags_receive_fn *receive,
                                void *user, int64_t *bad_rows) {
  float *slots;
  assert(receive);
  PAGS_TRY(pags_stage_raster_backward(frame, gradient, &slots));
  return pags_stage_project_backward(frame, 0, slots, receive, user, bad_rows);
}
