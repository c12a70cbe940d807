/* SPDX-License-Identifier: Apache-2.0 */
/* The stages of a frame and what they hand each other. Internal to engine/frame. */
#ifndef PAGS_FRAME_STAGES_H
#define PAGS_FRAME_STAGES_H

#include <pags/frame.h>
#include <pags/packed.h>
#include <stdbool.h>
#include "simd/kernels.h"

#include "base/clock.h"
#include "scene/packed_rows.h"

/* A cluster in view. Its members' results lie at [base, base + count) of the dense arrays below; base is a multiple
 * of 16. */
typedef struct view_cluster {
  int32_t part;
  int32_t count;
  int64_t cluster, first, base;
} view_cluster;

/* What can be said of a cluster's members that are drawn without reading them. */
typedef struct cluster_bound {
  float near;       /* no member's camera z, as the projection kernel rounds it, is smaller; metres, >= 0 */
  pags_reach reach; /* no member changes a pixel beyond */
} cluster_bound;

/* What is sorted: bits of z, and whose. */
typedef struct depth_key {
  uint32_t key, index;
} depth_key;

/* What is full while a frame is drawn slab by slab (early_z_slabs.c). */
typedef struct saturation {
  float *limits;       /* per tile: -1 where every pixel has stopped and the tile is finished, else infinity */
  uint8_t *tile_begun; /* per tile: 1, its planes hold what an earlier slab left */
  uint16_t *tile_open; /* per tile: blocks that have a pixel which hasn't stopped */
  uint64_t *open;      /* the same, row of blocks after row of blocks, a bit a block */
  int words, rows;     /* a row's words, rows of blocks */
  int64_t tiles_full;
} saturation;

/* What every 4 x 4 pixels see in their middle, without the sky. Planes have samples for whole tiles. */
enum { SAMPLE_SIDE = 4 };
typedef struct frame_samples {
  int width, height, stride;
  float *rgb[3], *transmittance;
  float *critical;          /* weight of what is critical */
  float *depth, *depth_sum; /* with extra channels, as is id */
  int32_t *id;
} frame_samples;

/* How a frame is drawn of which only what is critical is wanted in full (variable_rate.c). */
typedef struct frame_apart {
  const uint8_t *critical; /* per id: 1, it is */
  int64_t count;           /* of ids; those beyond aren't critical */
  double full_tiles;       /* out: share of tiles drawn in full */
} frame_apart;

struct pags_frame {
  pags_tasks *tasks;
  pags_arena *arena; /* everything of one frame */
  const pags_kernels *kernels;

  pags_part *parts;             /* copied into the arena */
  pags_projection *projections; /* one per part */
  int part_count;
  pags_camera camera;
  pags_frame_options options;
  bool rendered, ids_ascend;
  bool has_sky;
  pags_sky_rays rays; /* where there is a sky */

  view_cluster *clusters;
  cluster_bound *bounds; /* per cluster, only of frames drawn slab by slab */
  int64_t cluster_count, dense_count;
  pags_splat *splats;   /* dense_count */
  uint32_t *keys;       /* dense_count: bits of z, by which lists are sorted; UINT32_MAX = nothing to draw */
  pags_tile_box *boxes; /* dense_count; of what is drawn */
  uint32_t *drawn;      /* drawn_count dense indices, about as they lie in memory */
  int64_t drawn_count;

  int tiles_x, tiles_y;
  int64_t *tile_start;   /* tiles + 1 */
  pags_entry *entries;   /* tile after tile; front to back once sorted */
  uint16_t *block_masks; /* per entry */
  saturation *full;      /* NULL: one slab */
  bool last_slab;
  frame_apart *apart;       /* how the next frame is drawn; NULL: all of it in full */
  const uint8_t *wanted;    /* per tile: 0, it isn't drawn; NULL: all are */
  const float *tile_limits; /* per tile: what has a larger z isn't binned; may be NULL */
  float *hard;              /* a plane: what has a larger z isn't drawn; may be NULL */
  int64_t looked_at;        /* entries that the rasteriser came to */
  bool guessed;             /* whether `hiding` holds anything */
  double hiding; /* share of what is in view that hid, or would have hidden, in the last frame with Early-Z; a guess */
  int64_t *slot_start; /* dense_count + 1 */

  float *planes; /* 7 float planes and one of ids, of plane_size each */
  int64_t plane_capacity, plane_size;
  int stride, rows; /* padded to whole tiles */
  uint64_t plane_calls;
  pags_frame_stats stats;
};

enum { PLANE_R, PLANE_G, PLANE_B, PLANE_T, PLANE_DEPTH, PLANE_DEPTH_SUM, PLANE_BEST, PLANE_ID, PLANE_COUNT };
static inline float *frame_plane(const pags_frame *frame, int plane) {
  return frame->planes + plane * frame->plane_size;
}
/* A tile's first pixel, and where it lies in a plane. */
static inline int frame_tile_x(const pags_frame *frame, int64_t tile) {
  return (int)(tile % frame->tiles_x) * PAGS_TILE;
}
static inline int frame_tile_y(const pags_frame *frame, int64_t tile) {
  return (int)(tile / frame->tiles_x) * PAGS_TILE;
}
static inline int64_t frame_tile_offset(const pags_frame *frame, int64_t tile) {
  return (int64_t)frame_tile_y(frame, tile) * frame->stride + frame_tile_x(frame, tile);
}

/* Slabs pay where much hides (docs/lab/early-z.md has the figures behind this), else all is drawn at once. What hid in
 * one frame tells of the next. */
static inline bool frame_hides_enough(const pags_frame *frame) {
  return frame->hiding > 0.35;
}

/* In the order in which frame.c runs them; each returns PAGS_OK, PAGS_CANCELLED or PAGS_ERROR_MEMORY. */
pags_result pags_stage_cull(pags_frame *frame, bool bounded); /* -> clusters, bounds */
pags_result pags_stage_touch(pags_frame *frame, pags_touch_fn *touch, void *user);
pags_result pags_stage_project(pags_frame *frame); /* -> splats (no colour), keys, boxes */
pags_result pags_stage_shade(pags_frame *frame);   /* -> colours */
pags_result pags_stage_list(pags_frame *frame);    /* -> drawn */
pags_result pags_stage_bin(pags_frame *frame);     /* -> tile lists, in the order of `drawn` */
pags_result pags_stage_sort(pags_frame *frame);    /* -> tile lists, front to back */
pags_result pags_stage_raster(pags_frame *frame);  /* -> planes */
pags_result pags_stage_sample(pags_frame *frame, const frame_samples *samples); /* -> samples, of all tiles */
pags_result pags_stage_variable_rate(pags_frame *frame); /* -> planes, in place of raster, as `apart` says */

/* Saturation of the picture's blocks: begin marks none as saturated; update reads which pixels the last raster stage
 * has saturated. */
pags_result pags_frame_saturation_begin(pags_frame *frame);
void pags_frame_saturation_update(pags_frame *frame);
/* Everything after culling, at once. */
pags_result pags_frame_draw(pags_frame *frame, pags_touch_fn *touch, void *user);
/* The paper's two passes, after culling. */
pags_result pags_frame_early_z_paper(pags_frame *frame, pags_touch_fn *touch, void *user);
/* Everything after culling, slab of depth by slab. */
pags_result pags_frame_early_z_slabs(pags_frame *frame, pags_touch_fn *touch, void *user);

/* Whether the row counts as critical: S_sem > 0.5. */
static inline bool frame_is_critical(const pags_part *part, int64_t row) {
  if (part->packed && part->packed->has_s_sem)
    return pags_packed_s_sem(part->packed, row) > 0.5f;
  return (part->gaussians->s_sem ? part->gaussians->s_sem[row] : part->s_sem) > 0.5f;
}
/* Projects one cluster's members and gives them their ids. `reaches` may be NULL. */
void pags_frame_project_cluster(const pags_frame *frame, const view_cluster *cluster, pags_reach *reaches);
/* The projection that a cluster is shaded by: of a lower degree where the options say so. */
pags_projection pags_frame_shading(const pags_frame *frame, const view_cluster *cluster);
/* Finds the tiles of projected members [first, first + count) of the dense arrays, at most 256. */
void pags_frame_box_members(const pags_frame *frame, int64_t first, int count);
/* Sorts by key, stable; returns whichever of `keys` and `spare` holds the result. */
depth_key *pags_frame_sort_keys(depth_key *keys, depth_key *spare, int64_t count);

/* Of the sky (sky.c): directions, before anything is drawn; what a tile sees of it, best before its Gaussians are
 * blended; the tile when they have been blended over zeros; the way back, which adds to the gradient's texels. */
void pags_frame_prepare_sky(pags_frame *frame);
void pags_frame_find_sky(const pags_frame *frame, int64_t tile, pags_sky_tile *out);
void pags_frame_blend_sky(const pags_frame *frame, int64_t tile, const pags_sky_tile *found);
pags_result pags_frame_sky_backward(pags_frame *frame, const pags_picture_gradient *gradient);

void pags_frame_expose(const pags_frame *frame, int64_t tile); /* when all else is in it */

/* What a packed cluster is unpacked into. */
typedef struct row_scratch {
  float planes[PAGS_MAX_PLANES * PAGS_PACKED_ROWS] __attribute__((aligned(64)));
} row_scratch;
/* Planes of a cluster's rows, `stride` floats apart: those of geometry; means and colours up to a degree. Unpacked into
 * the scratch where the part is packed. */
const float *pags_frame_geometry(const pags_part *part, const view_cluster *cluster, row_scratch *scratch,
                                 int64_t *stride);
const float *pags_frame_colours(const pags_part *part, const view_cluster *cluster, int sh_degree, row_scratch *scratch,
                                int64_t *stride);

/* count * size bytes of this frame, or NULL after pags_fail. */
void *pags_frame_alloc(pags_frame *frame, int64_t count, size_t size, const char *what);
/* pags_parallel_for as a result code. */
pags_result pags_frame_for(pags_frame *frame, int64_t count, int64_t grain, pags_block_fn *fn, void *context);

#endif
