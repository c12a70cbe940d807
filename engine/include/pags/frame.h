/* SPDX-License-Identifier: Apache-2.0 */
/* One frame: cull -> project -> shade -> bin -> raster and sky, and the way back.
 *
 * A pags_frame owns the memory of a frame and is used again and again; from the third frame of a kind on it makes no
 * heap call. Results are the same bits for any number of threads, any cluster size and any order of the Gaussians whose
 * depths are distinct (equal depths: the smaller id in front).
 *
 * Blending (Kerbl et al. 2023): front to back in the order (depth, id); alpha = min(0.99, opacity * exp(-d' S^-1 d /
 * 2)), skipped under 1/255; a pixel stops before the Gaussian that would take its transmittance below 1e-4. */
#ifndef PAGS_FRAME_H
#define PAGS_FRAME_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/clusters.h>
#include <pags/gaussians.h>
#include <pags/sky.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Gaussians that share a frame of reference. */
typedef struct pags_part {
  const pags_gaussians *gaussians;  /* of packed ones: count and degree alone */
  const struct pags_packed *packed; /* pags/packed.h: unpacked cluster by cluster while drawing. NULL: the planes of
                                       `gaussians`. Not with keep_for_backward */
  const pags_clusters *clusters;    /* over those Gaussians */
  const int32_t *id;                /* id of each Gaussian, for output and for ties; NULL: first_id + row */
  int32_t first_id;
  double world_from_model[12]; /* rigid, 3x4; relative to the options' origin */
  const float *dc; /* used in place of the Gaussians' constant colour term: 3 planes of gaussians->stride floats,
                      64-byte aligned, valid for a cluster once touch has returned for it; NULL: their own */
  const float *opacity_factor; /* what each Gaussian's opacity is multiplied by, 0: it isn't drawn; gaussians->stride
                                  floats, valid as dc is. The product may exceed 1: alpha's cap holds as ever. Gradients
                                  are by the logit behind the factor; who is not drawn has none. NULL: 1 */
  float opacity_factor_most;   /* no factor is larger; not looked at without factors */
  float s_sem;                 /* semantic priority of Gaussians that have no s_sem of their own */
} pags_part;

/* What is hidden can be left out before it is read, shaded, sorted or binned: docs/render.md. */
typedef enum pags_early_z {
  PAGS_EARLY_Z_OFF,      /* draw everything; a pixel stops where it is full */
  PAGS_EARLY_Z_LOSSLESS, /* the same bits as OFF: colour, transmittance, depth and id; drawn as OFF where little hides
                          */
  PAGS_EARLY_Z_BOUNDED, /* a pixel stops as soon as T <= eps; no colour channel is off from OFF's by more than eps x the
                           largest of shaded colours, sky and background, transmittance by eps (before clamping; plus
                           rounding); depth and ids carry no bound */
  PAGS_EARLY_Z_PAPER    /* the paper's: what is critical and opaque (S_sem > 0.5, opacity >= 0.7) writes its depth where
                           its alpha is
                           >= 1/2; nothing is drawn behind that. Loses what shines through; its error carries no bound */
} pags_early_z;

typedef enum pags_order {
  PAGS_ORDER_DEPTH, /* front to back by (depth, id) */
  PAGS_ORDER_PAPER  /* the paper's composite key: Gaussians with S_sem > 0.5 in front of all others, each kind by depth.
                       Blends wrongly; for  the ablation */
} pags_order;

typedef struct pags_frame_options {
  double origin[3];    /* of the float positions, metres */
  float background[3]; /* display-referred sRGB, 0..1; not used where there is a sky */
  const pags_sky *sky; /* blended behind everything: rgb = sum of Gaussians + transmittance * sky(direction of the
                          pixel's centre); NULL: the background colour. Must outlive the frame's use */
  float near_plane;    /* Gaussians with camera z <= this are not drawn; metres, default 0.01 */
  float low_pass;      /* px^2 added to both variances, default 0.3 (0.1 is Mip-Splatting's) */
  int antialiased;     /* 1: opacity is scaled by sqrt(det before / det after the low-pass). Default 0 */
  int sh_degree;       /* highest degree used, 0..3; default 3 */
  int exp_degree;      /* polynomial degree of exp2 in the rasteriser: 3 (7.5e-5 relative; viewing only) or
                          5 (2e-7, default, and what backward asks for) */
  int extra_channels;  /* 1: depth, depth_sum and id too */
  int depth_sum;   /* 1, with keep_for_backward: depth_sum too, which is all that a loss on depth needs and costs less.
                      Default 0 */
  int count_pairs; /* 1: fill pairs_evaluated and pairs_blended (costs some per cent) */
  int keep_for_backward; /* 1: keep what pags_frame_backward needs */
  int exposed;           /* 1: rgb becomes gain * rgb + offset per channel, as a camera of that exposure shows it
                            (pags_scene_exposure).           Not with keep_for_backward. Default 0 */
  float gain[3], offset[3];
  pags_early_z early_z; /* default LOSSLESS. A render with keep_for_backward is always drawn with OFF */
  float early_z_eps;    /* of BOUNDED: 0 < eps < 1, default 1/255 */
  pags_order order;     /* default DEPTH. PAPER is not for keep_for_backward */
  int64_t slab_size;    /* with early_z: Gaussians read between two looks at what is full; 0 (default): chosen by
                           what hid in the frame before, so that a view without occlusion is drawn at once, and so is the
                           first frame of up to eight million Gaussians. Changes no bit */
  float rest_cut;   /* px: Gaussians that aren't critical (S_sem <= 0.5) and whose opacity times area on the picture is
                       less are left   out; default 0 */
  int rest_sh_less; /* degrees of colour taken off clusters that hold nothing critical, 0..3; default 0 */
  int absolute_gradient; /* 1: fill pags_cluster_gradient.mean2d_abs (costs some per cent of the backward pass), else 0s
                          */
} pags_frame_options;

PAGS_API pags_frame_options pags_frame_options_default(void);
/* Sets `exposed`, gain and offset; returns whether they change anything, which is what `exposed` becomes. */
PAGS_API int pags_frame_options_expose(pags_frame_options *options, const double gain[3], const double offset[3]);

/* Reads "off", "lossless", "paper", "bounded" or "bounded=EPS" (0 < EPS < 1) into early_z and early_z_eps.
 * PAGS_ERROR_ARGUMENT names what was expected; then the options stay as they were. */
PAGS_API pags_result pags_early_z_parse(const char *text, pags_frame_options *options);
PAGS_API const char *pags_early_z_name(pags_early_z mode); /* as parse reads it, without EPS */

/* Planes of `stride` floats a row, `height` rows (and up to 15 of padding); owned by the frame, valid until its next
 * render. */
typedef struct pags_picture {
  int width, height;
  int stride;                 /* width rounded up to 16 */
  const float *rgb[3];        /* background included; not clamped */
  const float *transmittance; /* what is left of the background: 1 - alpha */
  const float *depth;     /* sum(w z)/sum(w), camera z in metres, 0 where nothing was blended; NULL without extras */
  const int32_t *id;      /* id of the Gaussian with the largest weight (tie: the nearer), -1 for none; NULL without */
  const float *depth_sum; /* sum(w z), what depth is the quotient of; NULL without */
} pags_picture;

typedef struct pags_frame_stats {
  double ms_cull, ms_project, ms_shade, ms_sort, ms_bin, ms_raster; /* forward */
  double ms_raster_backward, ms_project_backward;                   /* backward; the latter with the receiver's work */
  double ms_occlude;                 /* of early-z: ordering clusters, testing them, keeping account of what is full */
  int64_t gaussians;                 /* that exist */
  int64_t in_view;                   /* members of clusters in view */
  int64_t loaded;                    /* read: in_view less the members of clusters known to be hidden */
  int64_t hidden;                    /* projected, then known to be hidden before their colour was read */
  int64_t shaded;                    /* colour computed */
  int64_t binned;                    /* in at least one tile */
  int64_t pairs_hidden;              /* (Gaussian, tile): not binned, the tile being full */
  int64_t pairs_binned;              /* (Gaussian, tile) */
  int64_t pairs_evaluated;           /* (Gaussian, pixel) lanes computed; 0 unless counted */
  int64_t pairs_blended;             /* of these, blended; 0 unless counted */
  int64_t clusters, clusters_hidden; /* in view; of these, never read */
  int64_t tiles, tiles_full;         /* of the picture; of these, full before the last slab (0 with one) */
  int64_t occluders;                 /* of PAPER: Gaussians that wrote depth */
  int64_t slabs;                     /* of depth, drawn one after another: 1 with OFF */
} pags_frame_stats;

/* For means over frames: every member of `one` is added to `sum`; counts are rounded down by divide. */
PAGS_API void pags_frame_stats_add(pags_frame_stats *sum, const pags_frame_stats *one);
PAGS_API void pags_frame_stats_divide(pags_frame_stats *sum, double n);

typedef struct pags_frame pags_frame;

PAGS_API pags_result pags_frame_create(pags_tasks *tasks, pags_frame **out); /* `tasks` must outlive it */
PAGS_API void pags_frame_destroy(pags_frame *frame);

/* Called for each cluster in view, before any of its Gaussians is read, from several threads at once but once per
 * cluster: a trainer brings deferred parameters up to date here. May change the members' parameters, not the bounds. */
typedef void pags_touch_fn(void *user, int part, int64_t cluster, int worker);

/* PAGS_CANCELLED when the tasks were; PAGS_ERROR_MEMORY; PAGS_ERROR_LIMIT beyond 2^31 Gaussians. `touch` may be NULL.
 */
PAGS_API pags_result pags_frame_render(pags_frame *frame, const pags_part *parts, int part_count,
                                       const pags_camera *camera, const pags_frame_options *options,
                                       pags_touch_fn *touch, void *user, pags_picture *out);

enum { PAGS_SKY_BLOCK = 16 }; /* texels of the sky that follow each other */

/* Gradients of neighbouring texels of the sky, in the worker's scratch: read them before returning. */
typedef struct pags_sky_gradient {
  int64_t first; /* the first texel, a multiple of PAGS_SKY_BLOCK; the last block may reach beyond the sky's end */
  int64_t blocks;
  const uint8_t *seen; /* per block: 1 where a pixel sees it or lies close by, 0 where data isn't written */
  const float *data;   /* [blocks * PAGS_SKY_BLOCK][3] dLoss/d(texel) */
} pags_sky_gradient;

/* Called with every texel that a pixel adds to, from several threads at once, at most once each. The same bits for any
 * number of threads. */
typedef void pags_sky_receive_fn(void *user, const pags_sky_gradient *gradient, int worker);

/* dLoss/d(picture); each plane has the picture's stride and its height rounded up to 16 rows (the last
 * are not used but must be readable). NULL planes mean zero; rgb must be given. */
typedef struct pags_picture_gradient {
  const float *rgb[3];
  const float *transmittance;
  const float *depth_sum;   /* by sum(w z), not by the quotient; asks for a render with extra_channels or depth_sum */
  pags_sky_receive_fn *sky; /* called for the sky's gradient; NULL: not wanted */
  void *sky_user;
  float sky_cut; /* pixels with less transmittance add nothing to the sky's; 0: all do */
} pags_picture_gradient;

/* Gradients of the Gaussians of one cluster, in the worker's scratch: read them before returning. */
typedef struct pags_cluster_gradient {
  int part;
  int64_t cluster;
  int64_t first;       /* row of the first member */
  int count;           /* members */
  int stride;          /* floats from plane to plane, multiple of 16, >= count */
  int planes;          /* pags_plane_count(active degree): planes beyond are zero and not stored */
  const float *data;   /* plane p of member i: data[p * stride + i]; 0 for members not drawn. The constant colour term's
                          is by the   term that was shown: the part's dc where it has one */
  const float *mean2d; /* |dL/d mean2D| in NDC units (pixel gradient times W/2, H/2), 0 if not drawn */
  const float *mean2d_abs; /* the same of the per-pixel absolute sums (gsplat's absgrad), if asked for */
  const float *radius;     /* 3 sigma of the larger axis in px; 0 if not drawn */
  const uint8_t *drawn;    /* 1: passed projection and fell into at least one tile */
  const uint8_t
      *bad; /* 0; for a member whose gradient wasn't finite, and is zero therefore, 1 + the first plane that wasn't */
} pags_cluster_gradient;

/* Called for every cluster in view (touched ones exactly), from several threads at once, once each. The gradient of a
 * row with a non-finite value is set to zero and counted. */
typedef void pags_receive_fn(void *user, const pags_cluster_gradient *gradient, int worker);

/* After a render with keep_for_backward. `bad_rows` (may be NULL) receives the number of rows whose gradient was
 * not finite. */
PAGS_API pags_result pags_frame_backward(pags_frame *frame, const pags_picture_gradient *gradient,
                                         pags_receive_fn *receive, void *user, int64_t *bad_rows);

/* What the Gaussians of one cluster matter to a picture, in the worker's scratch: read it before returning. Members not
 * drawn have 0s. */
typedef struct pags_cluster_score {
  int part;
  int64_t cluster;
  int64_t first;          /* row of the first member */
  int count;              /* members */
  const double *seen;     /* sum over pixels of alpha T: about the pixels that show the Gaussian */
  const double *critical; /* of these, where something critical is */
  const double *squared;  /* sum over pixels of the squared derivative of L by the value of the projected Gaussian, L
                             being the sum of  the picture's channels (Speedy-Splat's score, Hanson et al. 2025) or what
                             `rgb` is the gradient of */
} pags_cluster_score;

typedef void pags_score_fn(void *user, const pags_cluster_score *score, int worker);

/* Planes as pags_picture_gradient's. */
typedef struct pags_score_planes {
  const float *counted;  /* 0..1: how much a pixel counts */
  const float *critical; /* 0..1 */
  const float *rgb[3];   /* dL/d(picture); NULL: 1 */
  int overlap;           /* 1: sums of alpha, not of alpha T: as if nothing hid anything. Not with rgb */
} pags_score_planes;

/* After a render with keep_for_backward, instead of or before pags_frame_backward. Called for every cluster in view,
 * from several threads at once, once each; the same bits for any number of threads. */
PAGS_API pags_result pags_frame_scores(pags_frame *frame, const pags_score_planes *planes, pags_score_fn *receive,
                                       void *user);

/* The gradient by the pose of a part whose world_from_model becomes world_from_model * exp(increment) (pags/object.h)
 * at increment 0: out[0..2] by the rotation (axis times angle), out[3..5] by the translation, both in the model's
 * frame. Adds the rows [first, first + count) of `gaussians`, whose gradients are `data`, `stride` and `planes` of
 * their pags_cluster_gradient, in double and row after row: clusters added in a fixed order give the same bits. The
 * parameters must be those that were drawn. */
PAGS_API void pags_pose_gradient(const float *data, int64_t stride, int planes, const pags_gaussians *gaussians,
                                 int64_t first, int count, double out[6]);

PAGS_API const pags_frame_stats *pags_frame_stats_get(const pags_frame *frame);
PAGS_API uint64_t pags_frame_heap_calls(const pags_frame *frame); /* made so far, for the test of steady state */
PAGS_API size_t pags_frame_bytes(const pags_frame *frame);        /* held now */

#ifdef __cplusplus
}
#endif
#endif
