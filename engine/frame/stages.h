/* SPDX-License-Identifier: Apache-2.0 */
/* The stages that render one frame (cull, project, shade, list, bin, sort, raster) and the state that they share,
 * struct pags_frame. Internal to engine/frame. */
#ifndef PAGS_FRAME_STAGES_H
#define PAGS_FRAME_STAGES_H

#include <pags/frame.h>
#include <pags/packed.h>
#include <stdbool.h>
#include "simd/kernels.h"

#include "base/clock.h"
#include "frame/shared_splats.h"
#include "scene/packed_rows.h"
#include "threads/record.h"

/* A cluster in view: cluster number `cluster` of part `part`, which holds rows [first, first + count) of the part's
 * Gaussians. The results of these members (splats, keys, boxes) lie at [base, base + count) of the frame's dense
 * arrays; base is a multiple of 16. */
typedef struct view_cluster {
  int32_t part;
  int32_t count;
  int64_t cluster, first, base;
  bool turned; /* listed a second time, for members that reach over the seam of an equirectangular picture (lens_view.h)
                */
} view_cluster;

static inline int32_t part_id(const pags_part *part, int64_t row) {
  return part->id_base + (part->id ? part->id[row] : part->first_id + (int32_t)row);
}

/* Bounds of a cluster's drawn members that are known from the cluster's box alone, without reading the members. */
typedef struct cluster_bound {
  float near;       /* lower bound of the members' depth as the projection rounds it; metres, >= 0 */
  pags_reach reach; /* the 4x4-pixel blocks outside of which no member changes a pixel */
  bool seam;        /* members may reach over the seam of an equirectangular picture; set where a lens is */
} cluster_bound;

/* An item to sort by `key`, the bits of a depth z. `splat` is the index of a splat, as in the tiles' lists, of a
 * list's entry, or of a cluster. */
typedef pags_entry depth_key;

/* Which tiles and 4x4-pixel blocks are saturated while a frame is drawn slab by slab (early_z_slabs.c). A pixel is
 * saturated when its blending has stopped; a block or a tile, when all of its pixels inside of the picture are. */
typedef struct saturation {
  float *limits;       /* per tile: -1 where the tile is saturated and its pixels are final, else infinity */
  uint8_t *tile_begun; /* per tile: 1 where the planes hold the blending state of an earlier slab */
  uint16_t *tile_open; /* per tile: bit b is set where block b is not saturated */
  uint64_t *open;      /* the same bits as a bitmap of the picture's blocks: `rows` rows of `words` words each */
  int words, rows;
  int64_t tiles_full; /* number of saturated tiles */
} saturation;

/* Samples for variable-rate shading: one sample in the middle of each block of 4 x 4 pixels, blended without the sky.
 * `width` x `height` samples cover the picture; the planes are padded to whole tiles. */
enum { SAMPLE_SIDE = 4 };
typedef struct frame_samples {
  int width, height, stride;
  float *rgb[3], *transmittance;
  float *critical;          /* sum of the blending weights of critical Gaussians */
  float *depth, *depth_sum; /* these and id: only with options.extra_channels */
  int32_t *id;
} frame_samples;

/* Variable-rate shading (variable_rate.c): the critical Gaussians. Only tiles that show these are shaded at every
 * pixel. */
typedef struct frame_variable_rate {
  const uint8_t *critical; /* per id: 1 where the Gaussian is critical, else 0 */
  int64_t count;           /* number of ids in `critical`; Gaussians with larger ids aren't critical */
  double full_tiles;       /* out: fraction of the tiles that were shaded at every pixel */
} frame_variable_rate;

struct pags_frame {
  pags_tasks *tasks;
  pags_arena *arena; /* memory of one frame, reset when the next one begins; all arrays below but `planes` */
  const pags_kernels *kernels;

  pags_part *parts;             /* copied into the arena */
  pags_projection *projections; /* one per part */
  pags_scan *scans;             /* one per part; NULL: a global shutter */
  int part_count;
  pags_touch_fn *touch; /* called before a cluster is read; NULL: not wanted, or it has been called for all */
  void *touch_user;
  pags_camera camera;
  pags_frame_options options;    /* early_z_eps is divided by `enlargement` */
  float enlargement;             /* pags_frame_enlargement */
  const struct frame_lens *lens; /* NULL: a pinhole */
  float *lens_rays;              /* of the last frame with a lens, of lens_camera (lens_view.h); on the heap */
  pags_camera lens_camera;
  bool rendered, ids_ascend; /* a render has finished; the ids ascend in memory order */
  bool has_sky;
  pags_sky_rays rays; /* directions of the pixels in the sky's cube map; set where has_sky */

  view_cluster *clusters;
  cluster_bound *bounds;       /* per cluster in view; NULL unless drawn in slabs or with PAGS_EARLY_Z_PAPER */
  pags_project_counts *counts; /* per cluster in view, with a rolling shutter or a lens; else NULL */
  int64_t cluster_count, dense_count;
  pags_splat *splats;   /* dense_count */
  uint32_t *keys;       /* dense_count sort keys: the bits of z; UINT32_MAX where the Gaussian isn't drawn */
  pags_tile_box *boxes; /* dense_count; set for Gaussians that are drawn */
  /* dense_count: the boxes' extents, kept for another frame (shared_splats.c), for which each splat has one slot
   * instead of one per tile; NULL: not wanted */
  float (*extents)[2];
  uint32_t *drawn; /* drawn_count dense indices of the Gaussians that are drawn, about in memory order */
  int64_t drawn_count;

  int tiles_x, tiles_y;
  int64_t *tile_start;   /* tiles + 1: tile t's list is entries [tile_start[t], tile_start[t + 1]) */
  pags_entry *entries;   /* the lists of all tiles; each goes front to back once it is sorted */
  uint16_t *block_masks; /* per entry: the tile's 4x4-pixel blocks that the splat may change; if frame_keeps_lists */
  saturation *full;      /* NULL: the frame is drawn at once, in one slab */
  bool last_slab;
  frame_variable_rate *variable_rate; /* variable rate for the next frame; NULL: every pixel is shaded */
  const uint8_t *wanted;    /* per tile: 0 where the raster stage leaves the tile out; NULL: it draws all tiles */
  const float *tile_limits; /* per tile: splats with a larger z aren't binned; NULL: no limits */
  float *hard;              /* a plane of z: splats with a larger z don't change the pixel; NULL: none */
  bool guessed;             /* `hiding` has been set */
  double hiding; /* fraction hidden in the last Early-Z frame: of Gaussians (slabs) or of list entries (at once) */
  int64_t *slot_start; /* dense_count + 1: each splat's first gradient slot; if keep_for_backward */
  /* In an owner whose splats have been taken (shared_splats.c), in place of splats, keys, boxes and slot_start: flags
   * of the dense_count members (members.h), and each cluster's first slot, cluster_count + 1; else NULL. */
  uint8_t *member_flags;
  int64_t *cluster_slots;

  float *planes; /* 7 float planes and one of int32 ids, plane_size pixels each, in the order of PLANE_R .. */
  int64_t plane_capacity, plane_size; /* pixels per plane: allocated, used */
  int stride, rows;                   /* width and height, padded to whole tiles */
  uint64_t plane_calls;               /* number of heap allocations of `planes` */
  pags_frame_stats stats;
};

enum { PLANE_R, PLANE_G, PLANE_B, PLANE_T, PLANE_DEPTH, PLANE_DEPTH_SUM, PLANE_BEST, PLANE_ID, PLANE_COUNT };
static inline float *frame_plane(const pags_frame *frame, int plane) {
  return frame->planes + plane * frame->plane_size;
}
static inline int32_t *frame_ids(const pags_frame *frame) {
  return (int32_t *)(void *)frame_plane(frame, PLANE_ID);
}
/* A tile's top left pixel: its x and y, and its offset in a plane. */
static inline int frame_tile_x(const pags_frame *frame, int64_t tile) {
  return (int)(tile % frame->tiles_x) * PAGS_TILE;
}
static inline int frame_tile_y(const pags_frame *frame, int64_t tile) {
  return (int)(tile / frame->tiles_x) * PAGS_TILE;
}
static inline int64_t frame_tile_offset(const pags_frame *frame, int64_t tile) {
  return (int64_t)frame_tile_y(frame, tile) * frame->stride + frame_tile_x(frame, tile);
}
/* A tile after the forward pass, for the kernels that write to the slots of its pairs. */
static inline pags_drawn_tile frame_drawn_tile(const pags_frame *frame, int64_t tile, float *slots) {
  const int64_t start = frame->tile_start[tile], at = frame_tile_offset(frame, tile);
  return (pags_drawn_tile){
      .splats = frame->splats,
      .entries = frame->entries + start,
      .block_masks = frame->block_masks + start,
      .count = frame->tile_start[tile + 1] - start,
      .slot_start = frame->slot_start,
      .slots = slots,
      .x0 = frame_tile_x(frame, tile),
      .y0 = frame_tile_y(frame, tile),
      .width = frame->camera.width,
      .height = frame->camera.height,
      .stride = frame->stride,
      .rgb = {frame_plane(frame, PLANE_R) + at, frame_plane(frame, PLANE_G) + at, frame_plane(frame, PLANE_B) + at}};
}

/* Whether the frame is drawn at once, and its lists and masks are kept, for a second walk through them. */
static inline bool frame_keeps_lists(const pags_frame *frame) {
  return frame->options.keep_for_backward || frame->options.keep_for_passes;
}

/* Begins a frame: forgets the last one, takes options, camera and parts, and sets the planes' size. */
pags_result pags_frame_begin(pags_frame *frame, const pags_part *parts, int part_count, const pags_camera *camera,
                             const pags_frame_options *options);
/* Factor, at least 1, by which exposure enlarges the error of PAGS_EARLY_Z_BOUNDED at a pixel. */
double pags_frame_enlargement(const pags_frame_options *options, const pags_camera *camera);
/* Grows the planes' memory where needed; it never shrinks. */
pags_result pags_frame_reserve_planes(pags_frame *frame);
/* Ends the forward part of a frame: sets the picture's pointers into the frame's planes. */
void pags_frame_show(pags_frame *frame, pags_picture *out);
/* The cut-off of Gaussians with this alpha_min. */
pags_alpha_cut pags_frame_alpha_cut(float alpha_min);

/* The stages, in the order in which frame.c runs them, each with the members of pags_frame that it writes. They
 * return PAGS_OK, PAGS_CANCELLED or PAGS_ERROR_MEMORY; culling also PAGS_ERROR_LIMIT. `bounded`: write `bounds`
 * too. */
pags_result pags_stage_cull(pags_frame *frame, bool bounded); /* -> clusters, bounds */
pags_result pags_stage_touch(pags_frame *frame);
pags_result pags_stage_project(pags_frame *frame); /* -> splats, keys, boxes, and their times; shades, too */
pags_result pags_stage_shade(pags_frame *frame);   /* -> colours, where a stage of its own projects */
pags_result pags_stage_list(pags_frame *frame);    /* -> drawn */
pags_result pags_stage_bin(pags_frame *frame);     /* -> tile_start, entries in the order of `drawn` */
pags_result pags_stage_sort(pags_frame *frame);    /* -> entries of each tile front to back */
pags_result pags_stage_raster(pags_frame *frame);  /* -> planes */
pags_result pags_stage_sample(pags_frame *frame, const frame_samples *samples); /* -> samples of all tiles */
pags_result pags_stage_variable_rate(
    pags_frame *frame); /* -> planes; in place of raster where `variable_rate` is set */

/* The backward pass in its two halves. raster: the gradient slots of all (Gaussian, tile) pairs, from the frame's
 * arena, in the order of slot_start; and the sky's gradient. project: from the slots to the gradients of the parameters
 * of the parts from `first_part` on. */
pags_result pags_stage_raster_backward(pags_frame *frame, const pags_picture_gradient *gradient, float **slots);
pags_result pags_stage_project_backward(pags_frame *frame, int first_part, const float *slots, pags_receive_fn *receive,
                                        void *user, int64_t *bad_rows);
/* The scores in the same halves. add: the sums over the slots of one Gaussian. receive: takes the slots, or one sum
 * for each Gaussian in the order of slot_start. */
pags_result pags_stage_score(pags_frame *frame, const pags_score_planes *planes, float **slots);
pags_splat_scores pags_frame_add_scores(const pags_frame *frame, const float *slots, int64_t dense);
pags_result pags_stage_receive_scores(pags_frame *frame, const float *slots, const pags_splat_scores *sums,
                                      pags_score_fn *receive, void *user);

/* Saturation of the picture's blocks (frame->full): begin allocates the state, with no block inside of the picture
 * saturated; update gathers which blocks the last raster stage has left unsaturated. */
pags_result pags_frame_saturation_begin(pags_frame *frame);
void pags_frame_saturation_update(pags_frame *frame);
/* Makes room for splats, keys and boxes of dense_count Gaussians. */
pags_result pags_frame_reserve_splats(pags_frame *frame);
/* Computes slot_start. */
pags_result pags_frame_place_slots(pags_frame *frame);
/* The stages from list to raster, timed. */
pags_result pags_frame_draw_projected(pags_frame *frame);
/* The PAGS paper's two passes after culling: a depth pre-pass of occluders, then colour (early_z_paper.c). */
pags_result pags_frame_early_z_paper(pags_frame *frame);
/* All stages after culling, one slab of depth after another, front to back (early_z_slabs.c). */
pags_result pags_frame_early_z_slabs(pags_frame *frame);

/* Whether the part's Gaussian `row` is critical: its semantic priority S_sem is above 0.5. */
static inline bool frame_is_critical(const pags_part *part, int64_t row) {
  if (part->packed && part->packed->has_s_sem)
    return pags_packed_s_sem(part->packed, row) > 0.5f;
  return (part->gaussians->s_sem ? part->gaussians->s_sem[row] : part->s_sem) > 0.5f;
}
/* Projects one cluster's members: writes their splats (without colours), ids and keys, if `tiles` their boxes and
 * tiles, else the boxes' extents, and, unless `reaches` is NULL, the 4x4-pixel blocks that each may change. */
void pags_frame_project_cluster(const pags_frame *frame, const view_cluster *cluster, bool tiles, pags_reach *reaches);
/* The projection of a cluster: its part's, or that of the second place over the seam. */
static inline pags_projection frame_projection(const pags_frame *frame, const view_cluster *cluster) {
  pags_projection view = frame->projections[cluster->part];
  view.turned = cluster->turned;
  return view;
}
/* The projection to shade a cluster with: the part's own, with the SH degree lowered by options.rest_sh_less where
 * the cluster holds nothing critical. */
pags_projection pags_frame_shading(const pags_frame *frame, const view_cluster *cluster);
/* Finds the tiles that projected Gaussians [first, first + count) of the dense arrays touch; count <= 256. */
void pags_frame_box_members(const pags_frame *frame, int64_t first, int count);
/* Sorts `count` items by ascending key, stably, with `spare` as a second buffer of `count` items. Returns `keys` or
 * `spare`, whichever holds the result. */
depth_key *pags_frame_sort_keys(depth_key *keys, depth_key *spare, int64_t count);

/* Fills in how the parts move while a rolling shutter reads the picture (shutter.c); `scans` is NULL if it doesn't. */
pags_result pags_frame_scan(pags_frame *frame);
/* camera_from_model and its inverse, as make_projection takes them: with the world's origin at `origin`. */
void pags_frame_pose(const double world_from_camera[12], const double origin[3], const double world_from_model[12],
                     double camera_from_model[12], double model_from_camera[12]);
/* The directions of a tile's pixels: frame->rays, with a rolling shutter as the camera stood when they were read. */
pags_sky_rays pags_frame_rays(const pags_frame *frame, int64_t tile);

/* The sky (sky.c). prepare sets has_sky and the pixels' directions, before any tile is drawn. find looks up the cube
 * map cells that a tile's pixels see and prefetches their texels, so it is best called before the tile's Gaussians
 * are blended. blend adds transmittance times sky to a tile whose Gaussians were blended over black. sky_backward
 * passes the gradient of the texels to gradient->sky. */
void pags_frame_prepare_sky(pags_frame *frame);
void pags_frame_find_sky(const pags_frame *frame, int64_t tile, pags_sky_tile *out);
void pags_frame_blend_sky(const pags_frame *frame, int64_t tile, const pags_sky_tile *found);
/* Whether any pixel of the finished tile, also beyond the picture's edge, has a transmittance of at least `least`. */
bool pags_frame_tile_shows(const pags_frame *frame, int64_t tile, float least);
pags_result pags_frame_sky_backward(pags_frame *frame, const pags_picture_gradient *gradient);

void pags_frame_expose(const pags_frame *frame, int64_t tile); /* rgb = gain rgb + offset; after Gaussians and sky */

/* Buffer that one packed cluster is unpacked into. */
typedef struct row_scratch {
  float planes[PAGS_MAX_PLANES * PAGS_PACKED_ROWS] __attribute__((aligned(64)));
} row_scratch;
/* Return a cluster's parameter planes, `*stride` floats apart and in the order of pags/gaussians.h: `geometry` those
 * of mean, scale, rotation and opacity, `colours` those of the mean and of SH up to `sh_degree`. A packed part's
 * cluster is unpacked into `scratch`; otherwise the planes are the part's own. */
const float *pags_frame_geometry(const pags_part *part, const view_cluster *cluster, row_scratch *scratch,
                                 int64_t *stride);
const float *pags_frame_colours(const pags_part *part, const view_cluster *cluster, int sh_degree, row_scratch *scratch,
                                int64_t *stride);

/* Allocates `count` items of `size` bytes from the frame's arena. `array`: the address of the pointer to them. */
pags_result pags_frame_alloc(pags_frame *frame, void *array, int64_t count, size_t size, const char *what);
/* pags_parallel_for over [0, count) that returns PAGS_OK, or PAGS_CANCELLED after pags_fail. */
pags_result pags_frame_for(pags_frame *frame, int64_t count, int64_t grain, pags_block_fn *fn, void *context);

#endif
