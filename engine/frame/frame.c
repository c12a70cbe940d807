/* SPDX-License-Identifier: Apache-2.0 */
/* pags_frame_render: prepares the planes and each part's projection, decides whether the frame is drawn at once, in
 * slabs of depth or with the paper's Early-Z, and runs the stages in order. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "frame/lens_view.h"
#include "maths/maths.h"
#include "port/port.h"

pags_result pags_frame_reserve_planes(pags_frame *frame) {
  if (frame->plane_size <= frame->plane_capacity)
    return PAGS_OK;
  pags_port_aligned_free(frame->planes);
  frame->plane_capacity = 0;
  frame->planes = pags_port_aligned_alloc(64, (size_t)frame->plane_size * PLANE_COUNT * sizeof(float));
  frame->plane_calls++;
  if (!frame->planes)
    return pags_out_of_memory("a picture of %d x %d", frame->camera.width, frame->camera.height);
  frame->plane_capacity = frame->plane_size;
  return PAGS_OK;
}

pags_alpha_cut pags_frame_alpha_cut(float alpha_min) {
  const double least = (double)alpha_min;
  if (!(least > 0.0))
    return (pags_alpha_cut){.least = PAGS_ALPHA_MIN, .cut = -PAGS_LOG2_255};
  /* The cut is a little above the floor, so that alpha is positive there with the rasteriser's 2^x, of an error up to
   * 7.5e-5, too. */
  const double floor = least / (1.0 - least);
  return (pags_alpha_cut){.least = (float)least,
                          .cut = (float)(pags_log2(floor) + 2e-4),
                          .floor = (float)floor,
                          .lift = (float)-pags_log2(1.0 - least)};
}

/* The projection of a part: camera_from_model and the intrinsics as floats. All differences of large world
 * coordinates are taken here, in double. */
static pags_projection make_projection(const pags_camera *camera, const pags_frame_options *options,
                                       const pags_part *part) {
  pags_projection v = {.fx = (float)camera->fx,
                       .fy = (float)camera->fy,
                       .cx = (float)camera->cx,
                       .cy = (float)camera->cy,
                       .width = (float)camera->width,
                       .height = (float)camera->height,
                       .near_plane = options->near_plane,
                       .low_pass = part->low_pass > 0 ? part->low_pass : options->low_pass,
                       .alpha = pags_frame_alpha_cut(part->gaussians->alpha_min),
                       .antialiased = part->antialiased ? part->antialiased > 0 : options->antialiased,
                       .clip_count = options->clip_count};
  v.sh_degree = options->sh_degree < part->gaussians->sh_degree ? options->sh_degree : part->gaussians->sh_degree;
  /* The float positions of a part are relative to the scene's origin or, where it follows a track, in the object's
   * frame; world_from_model takes either of them to the world relative to the origin. */
  double local[12], camera_from_model[12], model_from_camera[12];
  memcpy(local, camera->world_from_camera, sizeof local);
  pags_pose_subtract(local, options->origin);
  for (int i = 0; i < options->clip_count; i++) { /* planes, to camera space */
    const double *const p = options->clips[i];
    double d = p[3];
    for (int k = 0; k < 3; k++) {
      v.clips[i][k] = (float)(p[0] * local[k] + p[1] * local[4 + k] + p[2] * local[8 + k]);
      d += p[k] * (local[4 * k + 3] + options->origin[k]);
    }
    v.clips[i][3] = (float)d;
  }
  pags_frame_pose(camera->world_from_camera, options->origin, part->world_from_model, camera_from_model,
                  model_from_camera);
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 3; k++)
      v.r[3 * i + k] = (float)camera_from_model[4 * i + k];
    v.t[i] = (float)camera_from_model[4 * i + 3];
    v.eye[i] = (float)model_from_camera[4 * i + 3];
  }
  const double tan_x = 0.5 * camera->width / camera->fx, tan_y = 0.5 * camera->height / camera->fy;
  v.lim_x0 = (float)(-camera->cx / camera->fx - 0.3 * tan_x);
  v.lim_x1 = (float)((camera->width - camera->cx) / camera->fx + 0.3 * tan_x);
  v.lim_y0 = (float)(-camera->cy / camera->fy - 0.3 * tan_y);
  v.lim_y1 = (float)((camera->height - camera->cy) / camera->fy + 0.3 * tan_y);
  return v;
}

pags_result pags_frame_draw_projected(pags_frame *frame) {
  pags_frame_stats *const s = &frame->stats;
  double since = pags_clock_ms();
  PAGS_TRY(pags_stage_list(frame));
  PAGS_TRY(pags_stage_bin(frame));
  s->ms_bin = pags_clock_lap_ms(&since);
  PAGS_TRY(pags_stage_sort(frame));
  s->ms_sort = pags_clock_lap_ms(&since);
  PAGS_TRY(frame->variable_rate ? pags_stage_variable_rate(frame) : pags_stage_raster(frame));
  s->ms_raster = pags_clock_lap_ms(&since);
  s->slabs = 1;
  return PAGS_OK;
}

/* The hidden fraction from which drawing in slabs is faster than drawing at once, as measured (docs/lab/early-z.md);
 * that of the last frame is used as an estimate for the next. */
#define SLABS_FROM 0.35

/* Whether drawing all of the scene's Gaussians in view at once might take more than two gigabytes of memory. */
static bool is_large(const pags_frame *frame) {
  return frame->stats.gaussians > 8000000;
}

pags_result pags_frame_begin(pags_frame *frame, const pags_part *parts, int part_count, const pags_camera *camera,
                             const pags_frame_options *options) {
  assert(options->exp_degree == 5 || (options->exp_degree == 3 && !options->keep_for_backward));
  assert(!(options->exposed && options->keep_for_backward));
  assert(!options->depth_sum || options->keep_for_backward);
  assert(options->order == PAGS_ORDER_DEPTH || !options->keep_for_backward);
  assert(!frame->variable_rate || !options->keep_for_passes);
  assert(options->slab_size >= 0);
  assert(options->early_z != PAGS_EARLY_Z_BOUNDED || (options->early_z_eps > 0.0f && options->early_z_eps < 1.0f));
  frame->camera = *camera;
  frame->options = *options;
  frame->enlargement = (float)pags_frame_enlargement(options, camera);
  frame->options.early_z_eps /= frame->enlargement;
  frame->rendered = false;
  frame->full = NULL;
  frame->wanted = NULL;
  frame->tile_limits = NULL;
  frame->hard = NULL;
  frame->extents = NULL;
  frame->member_flags = NULL;
  frame->cluster_slots = NULL;
  memset(&frame->stats, 0, sizeof frame->stats);
  pags_arena_reset(frame->arena);
  frame->part_count = part_count;
  PAGS_TRY(pags_frame_alloc(frame, &frame->parts, part_count, sizeof *parts, "parts"));
  PAGS_TRY(pags_frame_alloc(frame, &frame->projections, part_count, sizeof *frame->projections, "parts"));
  frame->ids_ascend = true;
  int64_t next_id = 0;
  for (int p = 0; p < part_count; p++) {
    assert(!parts[p].packed || !options->keep_for_backward);
    frame->parts[p] = parts[p];
    frame->projections[p] = make_projection(camera, options, parts + p);
    frame->stats.gaussians += parts[p].gaussians->count;
    const int64_t first = (int64_t)parts[p].id_base + parts[p].first_id;
    const bool follows = p == 0 || first >= next_id;
    next_id = first + parts[p].gaussians->count;
    frame->ids_ascend &= !parts[p].id && follows;
  }
  frame->tiles_x = (frame->camera.width + PAGS_TILE - 1) / PAGS_TILE;
  frame->tiles_y = (frame->camera.height + PAGS_TILE - 1) / PAGS_TILE;
  frame->stride = frame->tiles_x * PAGS_TILE;
  frame->rows = frame->tiles_y * PAGS_TILE;
  frame->plane_size = (int64_t)frame->stride * frame->rows;
  if (frame_keeps_lists(frame))
    frame->options.early_z = PAGS_EARLY_Z_OFF;
  PAGS_TRY(pags_frame_prepare_lens(frame));
  return pags_frame_scan(frame);
}

void pags_frame_show(pags_frame *frame, pags_picture *out) {
  frame->rendered = true;
  *out = (pags_picture){.width = frame->camera.width, .height = frame->camera.height, .stride = frame->stride};
  for (int c = 0; c < 3; c++)
    out->rgb[c] = frame_plane(frame, PLANE_R + c);
  out->transmittance = frame_plane(frame, PLANE_T);
  if (frame->options.extra_channels || frame->options.depth_sum)
    out->depth_sum = frame_plane(frame, PLANE_DEPTH_SUM);
  if (frame->options.extra_channels) {
    out->depth = frame_plane(frame, PLANE_DEPTH);
    out->id = frame_ids(frame);
  }
}

pags_result pags_frame_render(pags_frame *frame, const pags_part *parts, int part_count, const pags_camera *camera,
                              const pags_frame_options *options, pags_touch_fn *touch, void *user, pags_picture *out) {
  PAGS_TRY(pags_frame_begin(frame, parts, part_count, camera, options));
  frame->touch = touch, frame->touch_user = user;
  pags_frame_prepare_sky(frame);
  PAGS_TRY(pags_frame_reserve_planes(frame));
  const bool early_z = frame->options.early_z != PAGS_EARLY_Z_OFF;
  const bool paper = frame->options.early_z == PAGS_EARLY_Z_PAPER;

  /* Before the first frame there is no measured hidden fraction. That frame is drawn at once or, of a large scene, in
   * slabs, as if three quarters were hidden. */
  if (!frame->guessed && early_z)
    frame->hiding = is_large(frame) ? 0.75 : 0.0;
  frame->guessed |= early_z;
  const bool slabs = early_z && !paper && options->order == PAGS_ORDER_DEPTH &&
                     (!frame->variable_rate || is_large(frame)) &&
                     (options->slab_size > 0 || frame->hiding > SLABS_FROM);

  double since = pags_clock_ms();
  PAGS_TRY(pags_stage_cull(frame, slabs || paper));
  frame->stats.ms_cull = pags_clock_lap_ms(&since);
  frame->stats.tiles = (int64_t)frame->tiles_x * frame->tiles_y;
  if (frame->touch && frame->lens &&
      frame->lens->sphere) { /* each cluster once, before either of its two places is read */
    PAGS_TRY(pags_stage_touch(frame));
    frame->touch = NULL;
  }
  if (paper) {
    PAGS_TRY(pags_frame_early_z_paper(frame));
  } else if (slabs) {
    PAGS_TRY(pags_frame_early_z_slabs(frame));
  } else {
    since = pags_clock_ms();
    PAGS_TRY(pags_stage_touch(frame));
    frame->stats.ms_cull += pags_clock_lap_ms(&since);
    PAGS_TRY(pags_stage_project(frame));
    PAGS_TRY(pags_frame_draw_projected(frame));
  }

  /* The estimate for the next frame: of a frame drawn at once, the fraction of the (Gaussian, tile) pairs that the
   * rasteriser did not reach because their tiles were saturated. */
  if (!slabs && !paper && !frame->variable_rate && early_z) {
    const int64_t pairs = frame->stats.pairs_binned;
    frame->hiding = pairs > 0 ? 1.0 - (double)frame->stats.pairs_reached / (double)pairs : 0.0;
  }
  for (int64_t i = 0; frame->counts && i < frame->cluster_count; i++) {
    frame->stats.held += frame->counts[i].held;
    frame->stats.beyond += frame->counts[i].beyond;
  }
  pags_frame_show(frame, out);
  return PAGS_OK;
}
