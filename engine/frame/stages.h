/* The stages of a frame and what they hand each other. Internal to engine/frame. */
#ifndef PAGS_FRAME_STAGES_H
#define PAGS_FRAME_STAGES_H

#include <kernels.h>
#include <pags/frame.h>
#include <stdbool.h>

/* A cluster in view. Its members' results lie at [base, base + count) of the dense arrays below; base is a multiple of 16. */
typedef struct view_cluster {
  int32_t part;
  int32_t count;
  int64_t cluster, first, base;
} view_cluster;

struct pags_frame {
  pags_tasks *tasks;
  pags_arena *arena; /* everything of one frame */
  const pags_kernels *kernels;

  pags_part *parts; /* copied into the arena */
  pags_projection *projections; /* one per part */
  int part_count;
  pags_camera camera;
  pags_frame_options options;
  bool rendered, ids_ascend;
  bool has_sky;
  pags_sky_rays rays; /* where there is a sky */

  view_cluster *clusters;
  int64_t cluster_count, dense_count;
  pags_splat *splats;  /* dense_count */
  uint32_t *keys;      /* dense_count; UINT32_MAX = nothing to draw */
  uint32_t *order;     /* drawn_count dense indices, front to back */
  int64_t drawn_count;

  int tiles_x, tiles_y;
  int64_t *tile_start; /* tiles + 1 */
  pags_entry *entries; /* tile after tile, front to back */
  uint16_t *block_masks; /* per entry */
  int64_t *slot_start;   /* dense_count + 1 */

  float *planes;       /* 6 float planes and one of ids, of plane_size each */
  int64_t plane_capacity, plane_size;
  int stride, rows;    /* padded to whole tiles */
  uint64_t plane_calls;
  pags_frame_stats stats;
};

enum { PLANE_R, PLANE_G, PLANE_B, PLANE_T, PLANE_DEPTH, PLANE_DEPTH_SUM, PLANE_ID, PLANE_COUNT };
static inline float *frame_plane(const pags_frame *frame, int plane) { return frame->planes + plane * frame->plane_size; }

/* In the order in which frame.c runs them; each returns PAGS_OK, PAGS_CANCELLED or PAGS_ERROR_MEMORY. */
pags_result pags_stage_cull(pags_frame *frame, pags_touch_fn *touch, void *user); /* -> clusters */
pags_result pags_stage_project(pags_frame *frame);                                /* -> splats (no colour), keys */
pags_result pags_stage_shade(pags_frame *frame);                                  /* -> colours */
pags_result pags_stage_sort(pags_frame *frame);                                   /* -> order */
pags_result pags_stage_bin(pags_frame *frame);                                    /* -> tile lists */
pags_result pags_stage_raster(pags_frame *frame);                                 /* -> planes */

/* Of the sky (sky.c): directions, before anything is drawn; a tile that has just been blended over zeros; the way back, which adds to the
 * gradient's texels. */
void pags_frame_prepare_sky(pags_frame *frame);
void pags_frame_blend_sky(const pags_frame *frame, int64_t tile);
pags_result pags_frame_sky_backward(pags_frame *frame, const pags_picture_gradient *gradient);

void pags_frame_expose(const pags_frame *frame, int64_t tile); /* when all else is in it */

/* count * size bytes of this frame, or NULL after pags_fail. */
void *pags_frame_alloc(pags_frame *frame, int64_t count, size_t size, const char *what);
/* pags_parallel_for as a result code. */
pags_result pags_frame_for(pags_frame *frame, int64_t count, int64_t grain, pags_block_fn *fn, void *context);
double pags_frame_clock_ms(void);

#endif
