/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle: the forward and backward pass of pags/frame.h in simple, readable double-precision C.
 *
 * It has no tiles, threads or tolerances and uses only the engine's public structs, so that a mistake of the engine
 * can't be a mistake of the oracle. tests/gradients/test_reference.c compares its gradient with finite differences. It
 * is test code: running out of memory aborts.
 *
 * Definition (Zwicker et al. 2001; Kerbl et al. 2023; gsplat for the compensation and the off-centre clamp):
 *   Sigma  = R(q) diag(sigma)^2 R(q)',  sigma = exp(raw scale), q normalised, identity when zero
 *   p      = camera_from_model * mean;  drawn only when p.z > near_plane
 *   J      = [fx/z 0 -fx u/z; 0 fy/z -fy v/z],  u = clamp(x/z), v = clamp(y/z) to the picture widened by 15 % of its
 *            size (0.3 tan of half the field of view) on every side; the mean itself is not clamped
 *   cov    = J W Sigma W' J' + low_pass I,  conic = cov^-1;  not drawn when det cov isn't positive and finite
 *   o      = sigmoid(logit), antialiased: times sqrt(max(2.5e-5, det before / det after)), times the part's factor;
 *     not drawn below 1/255, or below a = alpha_min of its part
 *   colour = max(0, 1/2 + SH(direction from the camera to the mean, in the part's frame))
 *   pixel  = front to back: raw = o exp(-d' conic d / 2), alpha = min(0.99, raw), skipped when raw < 1/255; the pixel
 *            stops before T (1 - alpha) < 1e-4; what T is left shows the sky towards the pixel's centre or the
 *              background. In a part with alpha_min a, instead of raw: (raw - a') / (1 - a), skipped when raw < a';
 *              a' = a, antialiased: times the compensation, but at least 1/255
 * With a rolling shutter (reference_shutter.c) camera_from_model is that of the time t at which the mean's line is
 * read, with t clamped to half a read-out beyond the picture. J becomes (I + m' s / (1 - s m')) J with the
 * velocity m' of the mean on the picture and s = dt/d(pixel), but stays J where t is clamped; where 1 - s m' < 0.1 or
 * |s| (|m'_x| + |m'_y|) > 1, t is 0. There is no backward pass.
 * With a lens (reference_lens.c) the mean is seen where the lens shows it and J is the derivative there; depth and near
 * plane are distances; means beyond the field of view at the picture's border by more than 0.35 radians aren't drawn.
 * There is no backward pass. */
#ifndef PAGS_TESTS_REFERENCE_H
#define PAGS_TESTS_REFERENCE_H

#include <pags/camera.h>
#include <pags/frame.h>
#include <pags/gaussians.h>
#include <stdbool.h>

typedef struct reference_part {
  int64_t count;
  int sh_degree;
  double *planes;    /* raw parameters: plane p of Gaussian i is planes[p * count + i]; planes as in pags/gaussians.h */
  const int32_t *id; /* NULL: first_id + i */
  int32_t first_id;
  double world_from_model[12];
  double velocity[6]; /* as in pags_part */
  double *sh; /* replaces the SH coefficients: planes from PAGS_SH on, laid out as `planes`; NULL: those of `planes` */
  double *factor;   /* factor of the opacity of Gaussian i, 0: not drawn; NULL: all are 1 */
  double alpha_min; /* as in pags_gaussians; 0: a hard cut at the limits' alpha_min */
} reference_part;

/* Allocates zeroed planes with an identity pose. */
reference_part reference_part_create(int64_t count, int sh_degree);
/* Copies the engine's part to double: Gaussians, ids, pose, constant terms and factors. The part must not be packed. */
reference_part reference_part_from(const pags_part *part);
void reference_part_destroy(reference_part *part);

/* A Gaussian projected to the picture. If it isn't drawn, only `drawn` is defined. */
typedef struct reference_splat {
  int drawn;
  int32_t id;
  double camera[3]; /* mean in camera axes in metres */
  double depth;     /* camera[2]; with a lens, the distance */
  double mean2d[2]; /* pixels */
  double cov[3];    /* xx, xy, yy with the low-pass filter in px^2 */
  double conic[3];  /* inverse of cov */
  double opacity;   /* includes the compensation and the part's factor */
  double compensation;
  double least, gain, floor; /* alpha = gain raw - floor where raw >= least */
  double colour[3];
  int clamped_axis[2];   /* Jacobian: -1 or 1 where x/z, y/z was clamped, else 0 */
  int clamped_colour[3]; /* 1: the colour was negative before max(0, .) */
  int floored;           /* 1: the compensation is at its floor */
  int held;              /* rolling shutter: 1 if the mean moves along with the read-out and is drawn at mid-exposure */
  double margin;         /* relative distance to the nearest of the clamps above */
} reference_splat;

/* One Gaussian blended into one pixel. */
typedef struct reference_contribution {
  int32_t pixel;        /* y * width + x */
  int64_t gaussian;     /* index over all parts, in order */
  double falloff;       /* exp(-d' conic d / 2) */
  double alpha_raw;     /* alpha after the cut and before the cap */
  double transmittance; /* transmittance in front of this Gaussian */
} reference_contribution;

/* Limits by which blending departs from the plain product of alphas, and the margin beyond the picture within which J
 * isn't clamped: in tangents of half the field of view on every side. */
typedef struct reference_limits {
  double alpha_min, alpha_cap, stop, widened;
  int sigma_points; /* 1: with a lens, covariances by sigma points in place of J */
} reference_limits;
#define REFERENCE_LIMITS \
  ((reference_limits){REFERENCE_ALPHA_MIN, REFERENCE_ALPHA_CAP, REFERENCE_STOP, REFERENCE_WIDENED, 0})
#define REFERENCE_NO_LIMITS ((reference_limits){0, 1, 0, REFERENCE_WIDENED, 0})

typedef struct reference_picture {
  int width, height;
  double *rgb; /* three planes of width * height */
  double *transmittance;
  double *depth_sum; /* sum of w z */
  double *depth;     /* depth_sum / sum of w; 0 where nothing was blended */
  int32_t *id;       /* id of the Gaussian of the largest weight (tie: the nearer); -1 for none */

  /* margin: how close a pixel is to a different decision, relative: alpha to 1/255 or 0.99, transmittance to 1e-4,
   * its Gaussians to their clamps. depth_margin: the smallest gap of depth between neighbours in its list. A float
   * renderer may decide otherwise where these are of the order of its rounding. */
  double *margin;
  double *depth_margin;

  reference_limits limits;
  double turn, middle; /* of the lens: px a turn, and the column across from the seam */
  int64_t splat_count;
  reference_splat *splats; /* of all parts, in order */
  int64_t contribution_count;
  reference_contribution *contributions; /* front to back */
  uint64_t decisions;                    /* hash of every discrete decision: contributors, caps, clamps */
} reference_picture;

reference_picture reference_render(const reference_part *parts, int part_count, const pags_camera *camera,
                                   const pags_frame_options *options);

/* Like reference_render with other limits, for pictures whose gradient isn't needed. */
reference_picture reference_render_within(reference_limits limits, const reference_part *parts, int part_count,
                                          const pags_camera *camera, const pags_frame_options *options);
void reference_picture_destroy(reference_picture *picture);

/* Writes the drawn Gaussians in blending order: by depth, ties by id. `gaussians`: room for splat_count indices over
 * all parts. Returns their number. */
int64_t reference_front_to_back(const reference_picture *picture, int64_t *gaussians);

/* The colours of a picture in which each Gaussian's alpha comes from its largest density along the pixel's ray
 * instead of from its affine projection (reference_rays.c); Gaussians, order and limits are those of `from`, a render
 * of the same arguments. Three planes, freed by the caller. */
double *reference_ray_picture(const reference_part *parts, int part_count, const pags_camera *camera,
                              const pags_frame_options *options, const reference_picture *from);

/* Derivatives of a loss by the picture, planes of width * height without padding; NULL means zero. */
typedef struct reference_picture_gradient {
  const double *rgb; /* three planes */
  const double *transmittance;
  const double *depth_sum;
  double *sky; /* out: dL/d(texel) is added; NULL: not wanted */
} reference_picture_gradient;

typedef struct reference_part_gradient {
  int64_t count;
  /* Laid out like reference_part.planes; the gradient of SH coefficients is by `sh` if the part has it. */
  double *planes;
  double *mean2d; /* dL/d mean2D in px, x and y of Gaussian i at 2 i */
} reference_part_gradient;

/* Writes one gradient per part. `picture` is the render of the same arguments. */
void reference_backward(const reference_part *parts, int part_count, const pags_camera *camera,
                        const pags_frame_options *options, const reference_picture *picture,
                        const reference_picture_gradient *gradient, reference_part_gradient *out);
void reference_gradient_destroy(reference_part_gradient *gradients, int part_count);

/* ---- Rolling shutter ---- */

/* A part and a camera with the poses that they have `seconds` after the middle of the exposure; the camera's shutter is
 * global. The part shares the planes. */
typedef struct reference_moment {
  reference_part part;
  pags_camera camera;
} reference_moment;

reference_moment reference_moment_at(const reference_part *part, const pags_camera *camera, double seconds);

/* The read-out time of the line that shows a Gaussian's mean. */
typedef struct reference_line {
  double seconds, seen; /* time from mid-exposure of the Gaussian's pose, and of the camera's position for its colour */
  double shear[4];      /* 2x2, I + m' s / (1 - s m') */
  bool held;
  double margin; /* relative distance to a different decision */
} reference_line;

reference_line reference_find_line(const reference_part *part, int64_t i, const pags_camera *camera,
                                   const pags_frame_options *options);

/* ---- Shared by the forward and the backward pass ---- */

#define REFERENCE_ALPHA_MIN (1.0 / 255.0)
#define REFERENCE_ALPHA_CAP 0.99
#define REFERENCE_STOP 1e-4
#define REFERENCE_WIDENED 0.3
#define REFERENCE_COMPENSATION_FLOOR 2.5e-5 /* floor of the ratio of determinants */

/* The limits of a lens: the largest angle of means from the axis, and the range of x/z and y/z for J. */
typedef struct reference_lens {
  int is, clamps;
  double farthest, least[2], most[2];
  double turn; /* width of a full turn in px; 0: the picture has no seam */
} reference_lens;

reference_lens reference_lens_of(const pags_camera *camera);
int reference_has_lens(const pags_camera *camera);
void reference_lens_pixel(const pags_camera *camera, const double point[3], double pixel[2]);
void reference_lens_jacobian(const pags_camera *camera, const double point[3], double jacobian[6]);
/* Writes the unit direction that the camera sees at (x, y) px; returns 0 if it sees none there. */
int reference_lens_ray(const pags_camera *camera, double x, double y, double direction[3]);
/* Writes mean and covariance on the picture by sigma points; axes: the columns R S in camera axes. */
void reference_lens_sigma_points(const pags_camera *camera, const double mean[3], const double axes[9], double pixel[2],
                                 double covariance[3]);

/* A part's frame of reference seen from the camera. */
typedef struct reference_view {
  double rotation[9]; /* camera_from_model */
  double translation[3];
  double position[3]; /* camera position in the model's frame */
  double widened;     /* reference_limits.widened; by default REFERENCE_WIDENED */
  reference_lens lens;
  int sigma_points; /* reference_limits.sigma_points */
} reference_view;

reference_view reference_view_of(const reference_part *part, const pags_camera *camera,
                                 const pags_frame_options *options);

/* Intermediate results from raw parameters to the 2D covariance, kept for the backward pass. */
typedef struct reference_projection {
  double sigma[3];
  double unit_quaternion[4];
  double quaternion_length; /* 0: the identity replaces it */
  double rotation[9];       /* R(q) */
  double slope[2];          /* x/z, y/z after the clamp */
  double jacobian[6];       /* 2x3 */
  double factor[6];         /* 2x3: J W R(q) diag(sigma); covariance before the low-pass is factor factor' */
} reference_projection;

reference_projection reference_project(const reference_part *part, int64_t i, const reference_view *view,
                                       const pags_camera *camera, reference_splat *splat);

/* Writes the unit direction from the camera to a mean and returns the distance; (0, 0, 1) and 0 if they coincide. */
double reference_direction(const reference_part *part, int64_t i, const reference_view *view, double direction[3]);
/* Writes the 16 real SH of degree <= 3 in INRIA's order and signs, and their derivatives by x, y and z. */
void reference_sh(const double direction[3], double basis[16], double derivative[16][3]);
int reference_sh_degree(const reference_part *part, const pags_frame_options *options);

/* The four texels that a pixel interpolates. */
typedef struct reference_sky_taps {
  int64_t texel[4]; /* (face * size + row) * size + column */
  double weight[4];
  double margin; /* relative distance of the direction to another face */
} reference_sky_taps;

reference_sky_taps reference_sky_look(const pags_sky *sky, const pags_camera *camera, int x, int y);
/* Writes the sky or background behind all Gaussians of a pixel; lowers *margin to that of the choice of face. */
void reference_behind(const pags_camera *camera, const pags_frame_options *options, int64_t pixel, double rgb[3],
                      double *margin);
void reference_sky_colour(const pags_sky *sky, const reference_sky_taps *taps, double rgb[3]);

static inline double reference_factor(const reference_part *part, int64_t i) {
  return part->factor ? part->factor[i] : 1;
}

static inline double reference_value(const reference_part *part, int plane, int64_t i) {
  if (part->sh && plane >= PAGS_SH)
    return part->sh[(plane - PAGS_SH) * part->count + i];
  return part->planes[(int64_t)plane * part->count + i];
}

void *reference_alloc(int64_t count, size_t size); /* zeroed memory; aborts if out of memory */

#endif
