/* SPDX-License-Identifier: Apache-2.0 */
/* Rendering one frame of Gaussians, and its gradients: cull -> project -> shade -> bin -> raster and sky, and the
 * backward pass through the same stages.
 *
 * A pags_frame owns the memory of a frame and is reused for frame after frame; from the third frame of the same kind
 * on it makes no heap calls. Results are the same bits for any number of threads, any cluster size and any order of
 * the Gaussians as long as their depths are distinct (of equal depths, the smaller id is in front).
 *
 * Blending is that of Kerbl et al. 2023: front to back in the order (depth, id), with
 *
 *     alpha = min(0.99, opacity * exp(-d' S^-1 d / 2))
 *
 * where d is the pixel's centre minus the projected mean and S the 2D covariance. A Gaussian is skipped where
 * alpha < 1/255. For Gaussians with an alpha_min a, (alpha - a) / (1 - a) is blended instead, where it is positive;
 * with the antialiased projection a is scaled as the opacity is, but not below 1/255. A pixel stops before the Gaussian
 * that would take its transmittance T below 1e-4. Such a pixel, and a tile all of whose pixels have stopped, is called
 * saturated. "The paper" is Priority-Adaptive Gaussian Splatting (arXiv:2510.12282).
 *
 * With a rolling shutter (pags_camera.shutter) each Gaussian is drawn with the poses that the camera and its part had
 * when the line that shows its mean was read; its depth and colour are those of that moment (docs/lenses.md). */
#ifndef PAGS_FRAME_H
#define PAGS_FRAME_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/clusters.h>
#include <pags/gaussians.h>
#include <pags/photometric.h>
#include <pags/sky.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

/* ---- Parts and options ---- */

/* A part: Gaussians that share a frame of reference, with their pose in the world. All pointers must stay valid
 * for the render, and with keep_for_backward until the last call of pags_frame_backward and pags_frame_scores for
 * it. */
typedef struct pags_part {
  const pags_gaussians *gaussians; /* of a packed part only count, sh_degree and alpha_min are read */
  /* Packed Gaussians (pags/packed.h), unpacked cluster by cluster while drawing. NULL: the planes of `gaussians`
   * are drawn. Not with keep_for_backward. */
  const struct pags_packed *packed;
  const pags_clusters *clusters; /* clusters of these Gaussians */
  const int32_t *id;             /* id of each Gaussian, for the output and for equal depths; NULL: first_id + row */
  int32_t first_id;
  int32_t id_base; /* added to all ids of the part, for frames with the parts of several scenes; 0 otherwise */
  /* 3x4 pose, metres, relative to the options' origin. It may scale, stretch and mirror, which is exact: the
   * covariances become A S A', and colours are those of the direction in the model's frame. */
  double world_from_model[12];
  /* Motion while a camera with a rolling shutter reads the picture: t seconds after the middle of the exposure the pose
   * is world_from_model * [Exp(t w) | t v], as in pags_shutter; in the model's frame. 0: no motion. */
  double velocity[6];
  float low_pass;  /* px^2, in place of the options' low_pass; 0: the options' */
  int antialiased; /* 1: on, -1: off, 0: as in the options */
  /* SH coefficients to use instead of those of the Gaussians, as pags_fourier_colour writes them: planes of
   * gaussians->stride floats in the order of pags/gaussians.h, 64-byte aligned; those of a cluster must be valid once
   * `touch` has returned for it. NULL: the Gaussians' own. */
  const float *sh;
  /* Factor on each Gaussian's opacity, gaussians->stride floats, valid when `sh` is; 0: the Gaussian isn't drawn.
   * The product may exceed 1, since alpha is capped anyway. Gradients are with respect to the logit, before the
   * factor; Gaussians that are not drawn have none. NULL: 1. */
  const float *opacity_factor;
  float opacity_factor_most; /* upper bound of all factors; ignored if opacity_factor is NULL */
  float s_sem;               /* semantic priority S_sem of the Gaussians if they have no s_sem of their own */
  int64_t label;             /* for the caller's use (pags/compose.h sets it); has no effect on the result */
} pags_part;

/* Early-Z: how hidden Gaussians are excluded before they are read, shaded, sorted or binned;
 * docs/render.md. */
typedef enum pags_early_z {
  PAGS_EARLY_Z_OFF,      /* everything in view is drawn; only pixels stop when they are saturated */
  PAGS_EARLY_Z_LOSSLESS, /* the same bits as OFF in colour, transmittance, depth and id; if little is hidden, drawn as
                            OFF */
  /* A pixel stops as soon as T is small enough, and then becomes opaque: T becomes 0, and the remaining light gets the
   * mean colour of the Gaussians in front. Compared with OFF, no colour channel of the picture, exposed or not, is off
   * by more than eps times the largest of the shaded colours, the sky and the background (before exposure, in
   * magnitude), and transmittance by no more than eps (before clamping, plus rounding). T is small enough at eps
   * divided by the factors that enlarge the error: the largest gain, the steepest slope of vignetting and response, and
   * 1 to 2 if the sky or the background is negative somewhere. Depth and ids have no bound. */
  PAGS_EARLY_Z_BOUNDED,
  /* As in the paper: critical, opaque Gaussians (S_sem > 0.5, opacity >= 0.7) write their depth at pixels where
   * their alpha is >= 1/2, and nothing is drawn behind that depth. Gaussians visible through them are lost; the
   * error has no bound. */
  PAGS_EARLY_Z_PAPER
} pags_early_z;

typedef enum pags_order {
  PAGS_ORDER_DEPTH, /* front to back by (depth, id) */
  /* The paper's composite key: Gaussians with S_sem > 0.5 in front of all others, both kinds by depth. This order
   * blends wrongly; it exists for the ablation. */
  PAGS_ORDER_PAPER
} pags_order;

enum { PAGS_MOST_CLIPS = 8 }; /* six planes of a box, and two of the depth */

typedef struct pags_frame_options {
  double origin[3];    /* world position of the origin of all float positions, metres */
  float background[3]; /* colour behind everything, display-referred sRGB, 0..1; not used if there is a sky */
  /* Blended behind everything: rgb = sum of the Gaussians + T * sky(direction of the pixel's centre). NULL: the
   * background colour. Must outlive the frame's use. */
  const pags_sky *sky;
  float near_plane; /* Gaussians whose mean has camera z <= this are not drawn; metres, default 0.01 */
  /* Planes in absolute world coordinates: Gaussians whose mean has a x + b y + c z + d < 0 for one of them, with a
   * rolling shutter at the middle of the exposure, are not drawn. Sky and background are. Default 0 planes. */
  int clip_count; /* 0..PAGS_MOST_CLIPS */
  double clips[PAGS_MOST_CLIPS][4];
  float low_pass;        /* px^2, added to both variances of the 2D covariance; default 0.3 (Mip-Splatting: 0.1) */
  int antialiased;       /* 1: opacity is scaled by sqrt(det before / det after the low-pass). Default 0 */
  int sh_degree;         /* highest SH degree used, 0..3; default 3 */
  int exp_degree;        /* degree of the polynomial for exp2 in the rasteriser: 5 (relative error 2e-7; default, and
                            required by keep_for_backward) or 3 (7.5e-5; for viewing only) */
  int extra_channels;    /* 1: also compute depth, depth_sum and id. Default 0 */
  int depth_sum;         /* 1: also compute depth_sum, which suffices for a depth loss and is cheaper than
                            extra_channels. Only with keep_for_backward. Default 0 */
  int count_pairs;       /* 1: fill pairs_evaluated and pairs_blended (costs a few per cent). Default 0 */
  int keep_for_backward; /* 1: keep the data for pags_frame_backward and pags_frame_scores. Default 0 */
  int squared; /* 1: pags_frame_backward also computes the scores `squared`. Only with keep_for_backward. Default 0 */
  int keep_for_passes; /* 1: keep the data for pags_frame_passes (pags/passes.h). Default 0 */
  /* 1: rgb becomes gain * rgb + offset per channel, as a camera with that exposure shows the scene
   * (pags_scene_exposure). Not with keep_for_backward. Default 0. */
  int exposed;
  float gain[3], offset[3];
  union { /* vignetting and response, applied before gain and offset (pags/photometric.h); default zeros: none */
    pags_photometric photometric;
    pags_photometric light; /* deprecated name */
  };
  pags_early_z early_z; /* default LOSSLESS; a render with one of the keep options is always drawn with OFF */
  float early_z_eps;    /* eps of BOUNDED: 0 < eps < 1, default 1/255 */
  pags_order order;     /* default DEPTH; PAPER not with keep_for_backward */
  /* With early_z LOSSLESS or BOUNDED, a frame is drawn in slabs of depth, and before each slab the Gaussians
   * behind saturated tiles are dropped. slab_size is the number of Gaussians read per slab. 0 (default): chosen
   * from the hidden fraction of the previous frame, so that a view without occlusion is drawn in one slab, as is a
   * first frame of up to eight million Gaussians. Changes no bit of the result. */
  int64_t slab_size;
  float rest_cut;   /* px: non-critical Gaussians (S_sem <= 0.5) whose opacity times area on the picture is
                       smaller are not drawn; default 0 */
  int rest_sh_less; /* SH degrees taken off clusters without critical Gaussians, 0..3; default 0 */
} pags_frame_options;

PAGS_API pags_frame_options pags_frame_options_default(void);

/* Sets gain and offset, and `exposed` to whether they or `photometric` change anything; returns `exposed`. */
PAGS_API int pags_frame_options_expose(pags_frame_options *options, const double gain[3], const double offset[3]);

/* Parses "off", "lossless", "paper", "bounded" or "bounded=EPS" (0 < EPS < 1) into early_z and early_z_eps. For
 * any other text it returns PAGS_ERROR_ARGUMENT, with a message that lists the valid texts, and `options` is unchanged.
 */
PAGS_API pags_result pags_early_z_parse(const char *text, pags_frame_options *options);

/* Returns the name of a mode as pags_early_z_parse reads it, without EPS; a static string. */
PAGS_API const char *pags_early_z_name(pags_early_z mode);

/* ---- Rendering ---- */

/* A rendered picture: planes of `height` rows (in memory up to 15 more rows of padding) that lie `stride` floats
 * apart. They are owned by the frame and valid until its next render. Members that the options don't enable are NULL. w
 * = alpha T is the weight of a Gaussian at a pixel. */
typedef struct pags_picture {
  int width, height;          /* pixels */
  int stride;                 /* width rounded up to a multiple of 16 */
  const float *rgb[3];        /* display-referred sRGB, background or sky included; not clamped */
  const float *transmittance; /* T: the fraction of the background that remains, 1 - accumulated alpha */
  const float *depth;     /* extra_channels: sum(w z) / sum(w), camera z, with a lens the distance, in metres; 0 where
                             nothing is blended */
  const int32_t *id;      /* extra_channels: id of the Gaussian of the largest w (equal: the nearer); -1: none */
  const float *depth_sum; /* extra_channels or depth_sum: sum(w z), the numerator of `depth` */
} pags_picture;

/* Times and counts of a frame. A pair is a Gaussian and a tile that it touches, or a Gaussian and a pixel. */
typedef struct pags_frame_stats {
  double ms_cull, ms_project, ms_shade, ms_sort, ms_bin, ms_raster; /* forward stages */
  /* Backward pass through the rasteriser, and through shade and project with the time of the receiver. */
  double ms_raster_backward, ms_project_backward;
  double ms_sky_backward;            /* of the sky's texels, contained in ms_raster_backward */
  double ms_occlude;                 /* of Early-Z: sorting clusters, testing them, updating the saturation */
  int64_t gaussians;                 /* Gaussians in all parts */
  int64_t in_view;                   /* members of the clusters in view */
  int64_t loaded;                    /* Gaussians read: in_view minus the members of clusters known to be hidden */
  int64_t hidden;                    /* Gaussians projected, then found to be hidden before their colour was read */
  int64_t shaded;                    /* Gaussians whose colour was computed */
  int64_t binned;                    /* Gaussians in at least one tile */
  int64_t pairs_hidden;              /* (Gaussian, tile) pairs excluded because the tile was saturated */
  int64_t pairs_binned;              /* (Gaussian, tile) pairs in the tiles' lists */
  int64_t pairs_reached;             /* pairs_binned that the rasteriser reached before their tiles had stopped */
  int64_t pairs_evaluated;           /* (Gaussian, pixel) pairs computed, in vector lanes; 0 without count_pairs */
  int64_t pairs_blended;             /* pairs_evaluated that were blended; 0 without count_pairs */
  int64_t pairs_open;                /* pairs_evaluated at pixels that hadn't stopped; 0 without count_pairs */
  int64_t clusters, clusters_hidden; /* clusters in view; those of them that were hidden and never read */
  int64_t tiles, tiles_full;         /* tiles of the picture; tiles saturated before the last slab (0 with one) */
  int64_t occluders;                 /* EARLY_Z_PAPER: Gaussians that wrote depth */
  int64_t slabs;                     /* slabs of depth drawn one after another; 1 with OFF */
  int64_t held;   /* too fast for the rolling shutter, so drawn as at mid-exposure (docs/lenses.md) */
  int64_t beyond; /* in clusters in view, but outside of the lens's field of view, so not drawn (docs/lenses.md) */
} pags_frame_stats;

/* Compute means over frames: pags_frame_stats_add adds every member of `one` to `sum`; pags_frame_stats_divide
 * divides every member by n, counts rounded down. */
PAGS_API void pags_frame_stats_add(pags_frame_stats *sum, const pags_frame_stats *one);
PAGS_API void pags_frame_stats_divide(pags_frame_stats *sum, double n);

/* A renderer. It may be used by one thread at a time and runs its loops on `tasks`. */
typedef struct pags_frame pags_frame;

/* Creates a renderer; `tasks` must outlive it. PAGS_ERROR_MEMORY; PAGS_ERROR_UNSUPPORTED if this machine's
 * processor lacks the instructions that the build needs. */
PAGS_API pags_result pags_frame_create(pags_tasks *tasks, pags_frame **out);

/* Frees a renderer. NULL is allowed. */
PAGS_API void pags_frame_destroy(pags_frame *frame);

/* A callback that a render calls once for each cluster in view before any of its Gaussians is read, from several
 * threads at once, e.g. for a trainer to apply deferred updates of the parameters. With Early-Z it isn't called
 * for clusters that are hidden and never read. It may change the parameters of the cluster's Gaussians; the
 * cluster's bounds must not be changed and must still hold. `part` is the index of the part. */
typedef void pags_touch_fn(void *user, int part, int64_t cluster, int worker);

/* Draws a frame. `camera` is absolute; `touch` may be NULL; `out` receives the planes. Options that exclude each
 * other (see pags_frame_options) fail an assert. PAGS_ERROR_LIMIT beyond 2^31 - 1 Gaussians in view;
 * PAGS_ERROR_MEMORY; PAGS_CANCELLED if the tasks were cancelled. After a failure no picture is valid. */
PAGS_API pags_result pags_frame_render(pags_frame *frame, const pags_part *parts, int part_count,
                                       const pags_camera *camera, const pags_frame_options *options,
                                       pags_touch_fn *touch, void *user, pags_picture *out);

/* ---- Gradients ---- */

enum { PAGS_SKY_BLOCK = 16 }; /* consecutive texels of the sky that make up a block */

/* Gradients of consecutive texels of the sky. They lie in the worker's scratch memory, valid during the call
 * only. */
typedef struct pags_sky_gradient {
  int64_t first;       /* index of the first texel, a multiple of PAGS_SKY_BLOCK */
  int64_t blocks;      /* number of blocks; the last one may reach beyond the end of the sky */
  const uint8_t *seen; /* per block: 1: `data` is set, since a pixel sees the block or a texel close by; 0: not set */
  const float *data;   /* [blocks * PAGS_SKY_BLOCK][3]: dL/d(texel) */
} pags_sky_gradient;

/* A callback that receives the gradients of all texels that a pixel sees, from several threads at once, each
 * texel at most once. The values are the same bits for any number of threads. */
typedef void pags_sky_receive_fn(void *user, const pags_sky_gradient *gradient, int worker);

/* dL/d(picture) of a loss L. Each plane has the picture's stride, and its height rounded up to 16 rows; the
 * additional rows are not used but must be readable. A NULL plane means zeros; rgb must be given. */
typedef struct pags_picture_gradient {
  const float *rgb[3];
  const float
      *counted; /* with the option `squared`: weight of each pixel in that score, 0..1; NULL: the scores are 0 */
  const float *transmittance;
  const float *depth_sum;   /* dL/d sum(w z), not dL/d(depth), the quotient; needs extra_channels or depth_sum */
  pags_sky_receive_fn *sky; /* receives the gradient of the sky; NULL: not wanted */
  void *sky_user;
  float sky_cut; /* pixels with a smaller transmittance add nothing to the sky's gradient; 0: all add */
} pags_picture_gradient;

/* Gradients of the Gaussians of one cluster. They lie in the worker's scratch memory, valid during the call only. */
typedef struct pags_cluster_gradient {
  int part;        /* index of the part */
  int64_t cluster; /* index of the cluster in the part */
  int64_t first;   /* row of the first member */
  int count;       /* number of members */
  int stride;      /* floats from plane to plane: a multiple of 16, >= count */
  int planes;      /* pags_plane_count(active SH degree); gradients of further planes are zero and not stored */
  /* dL/d(parameter): plane p of member i is data[p * stride + i]; 0 for members that were not drawn. The gradient
   * of SH coefficients is with respect to those that were drawn, the part's `sh` if it has them. */
  const float *data;
  const float *mean2d;  /* |dL/d(projected mean)| in NDC: the gradient per pixel times W/2, H/2; 0 if not drawn */
  const float *squared; /* as `squared` of pags_cluster_score; NULL without the option `squared` */
  const float *radius;  /* 3 sigma along the larger axis of the 2D covariance, px; 0 if not drawn */
  const uint8_t *drawn; /* 1: the member passed the projection and touches at least one tile */
  /* 0, or 1 + the index of the first plane whose gradient wasn't finite; all gradients of such a member are set
   * to 0. */
  const uint8_t *bad;
} pags_cluster_gradient;

/* A callback that receives the gradients of each cluster in view, exactly the clusters that `touch` was called
 * for, once each, from several threads at once. */
typedef void pags_receive_fn(void *user, const pags_cluster_gradient *gradient, int worker);

/* Computes the gradients of the last render, which must have had keep_for_backward. A row with a gradient that
 * isn't finite is set to zero and counted; *bad_rows (`bad_rows` may be NULL) receives the number of these rows.
 * PAGS_ERROR_MEMORY; PAGS_CANCELLED. */
PAGS_API pags_result pags_frame_backward(pags_frame *frame, const pags_picture_gradient *gradient,
                                         pags_receive_fn *receive, void *user, int64_t *bad_rows);

/* As pags_frame_backward, but writes the gradients of all Gaussians to one array in the order of their ids, for callers
 * that update them elsewhere: plane p of row i of `out` is dL/d(plane p) of the Gaussian with id i, with respect to the
 * parameters as pags/gaussians.h has them (ln sigma, the logit of the opacity, the quaternion as stored, means in their
 * part's frame); 0 for those that were not drawn. `count` is larger than all ids (pags_composition_gaussian_count).
 * `out` is overwritten, gets the highest SH degree of the parts and belongs to the caller; it is the same bits for any
 * number of threads. The gradient of SH coefficients is with respect to the part's `sh`, if it has them. Also
 * PAGS_ERROR_ARGUMENT if two parts have the same Gaussians; on failure `out` is empty. */
PAGS_API pags_result pags_frame_gradients(pags_frame *frame, const pags_picture_gradient *gradient, int64_t count,
                                          pags_gaussians *out, int64_t *bad_rows);

/* ---- Scores ---- */

/* Contributions of the Gaussians of one cluster to a picture; 0 for members that were not drawn. The arrays
 * lie in the worker's scratch memory, valid during the call only. `counted` and `critical` of a pixel are those
 * of pags_score_planes. */
typedef struct pags_cluster_score {
  int part;               /* index of the part */
  int64_t cluster;        /* index of the cluster in the part */
  int64_t first;          /* row of the first member */
  int count;              /* number of members */
  const double *seen;     /* sum over pixels of counted * alpha T: about the pixels that show the Gaussian */
  const double *critical; /* sum over pixels of counted * critical * alpha T: those with critical content */
  /* Speedy-Splat's score (Hanson et al. 2025): sum over pixels of counted * (dL/dG)^2, G being the value of the
   * projected Gaussian at the pixel, alpha = opacity * G, and L the sum of the pixel's channels. */
  const double *squared;
} pags_cluster_score;

/* A callback that receives the scores of each cluster in view, once each, from several threads at once. */
typedef void pags_score_fn(void *user, const pags_cluster_score *score, int worker);

/* The weights of the pixels for pags_frame_scores; planes as in pags_picture_gradient. */
typedef struct pags_score_planes {
  const float *counted;  /* weight of the pixel, 0..1 */
  const float *critical; /* criticality of the pixel's content, 0..1 */
  int overlap;           /* 1: `seen` and `critical` are sums of alpha instead of alpha T, as if nothing were hidden */
} pags_score_planes;

/* Computes the scores of the last render, which must have had keep_for_backward, instead of pags_frame_backward
 * or before it. The scores are the same bits for any number of threads. PAGS_ERROR_MEMORY; PAGS_CANCELLED. */
PAGS_API pags_result pags_frame_scores(pags_frame *frame, const pags_score_planes *planes, pags_score_fn *receive,
                                       void *user);

/* ---- Gradient of a pose, and figures ---- */

/* Adds to `out` the gradient with respect to the pose of a part, at increment 0, for a pose that becomes
 *     world_from_model * exp(increment)                    (pags/object.h)
 * out[0..2] by the rotation (axis times angle, radians), out[3..5] by the translation (metres), both in the
 * model's frame. The rows [first, first + count) of the part's Gaussians are added; `data`, `stride` and `planes` are
 * those of their pags_cluster_gradient. Sums are in double and row after row, so that clusters added in a fixed
 * order give the same bits. The parameters, and the part's `sh`, must be those that were drawn. */
PAGS_API void pags_pose_gradient(const float *data, int64_t stride, int planes, const pags_part *part, int64_t first,
                                 int count, double out[6]);

/* Converts a part's gradient `by_pose` to the gradient with respect to a motion of the whole world (rotation and
 * translation about the origin that parts are relative to) and adds it to `by_world`. The negative of the sum over all
 * parts is the gradient with respect to a motion of the camera. The sky, which doesn't move, contributes nothing. */
PAGS_API void pags_pose_gradient_by_world(const double world_from_model[12], const double by_pose[6],
                                          double by_world[6]);

/* Returns the statistics of the last render and its backward pass, owned by the frame. */
PAGS_API const pags_frame_stats *pags_frame_stats_get(const pags_frame *frame);

/* Returns the number of heap calls until now, for tests that the steady state makes none. */
PAGS_API uint64_t pags_frame_heap_calls(const pags_frame *frame);

/* Returns the peak memory of the frame's arena and planes, bytes. */
PAGS_API size_t pags_frame_bytes(const pags_frame *frame);

PAGS_END_C
#endif
