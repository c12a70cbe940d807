/* SPDX-License-Identifier: Apache-2.0 */
/* The table of vector kernels: every stage's inner loop over plain arrays. Knows neither scenes nor threads.
 *
 * pags_kernels_get() picks the best table this processor runs, or the one that PAGS_CPU=scalar|avx2|avx512|neon names.
 * The scalar table is always complete and is what the others are tested against. */
#ifndef PAGS_SIMD_KERNELS_H
#define PAGS_SIMD_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
  PAGS_LANES = 16,
  PAGS_TILE = 16, /* pixels a side */
  PAGS_TILE_PIXELS = PAGS_TILE * PAGS_TILE,
  PAGS_TILE_BLOCKS = 16 /* 4x4-pixel blocks of a tile: what one vector covers; block b at (b & 3, b >> 2) */
};

#define PAGS_ALPHA_MAX 0.99f
#define PAGS_ALPHA_MIN (1.0f / 255.0f)
#define PAGS_T_STOP 1e-4f
#define PAGS_COLOUR_MAX 1e6f /* of a Gaussian's shaded colour; the loss takes four of these in a product */
#define PAGS_LOG2_255 7.99435344f
/* Added to the cut-off, in powers of two, by whatever rules out pixels before they are computed: the rasteriser's
 * rounding of u^2 + v^2 must never find a pixel that was ruled out. u carries an error of about 2^-23 p |d| <= 1e-3 for
 * |d| <= 4096 px, hence u^2 at most 0.01. */
#define PAGS_CUT_SLACK 0.02f

/* A projected Gaussian, 64 bytes, one cache line.
 * The falloff is 2^(log2_opacity - u^2 - v^2) with u = p (dx - h dy), v = w dy, d = pixel centre - mean: the Cholesky
 * factor of log2(e)/2 times the inverse covariance. Writing it as a sum of squares keeps long thin Gaussians exact
 * where the usual a dx^2 + 2 b dx dy + c dy^2 cancels, and cannot grow. */
typedef struct pags_splat {
  float x, y;         /* mean, px */
  float p, h, w;      /* p = sqrt(k C / D), h = B / C, w = sqrt(k / C); covariance [A B; B C], D = det, k = log2(e)/2 */
  float log2_opacity; /* <= 0 but where projection was given factors: the cap on alpha is the rasteriser's */
  float r, g, b;      /* colour, >= 0 */
  float z;            /* camera depth, metres; its bits are the sort key */
  float slope;        /* B / A: the other regression line, for the tile test */
  float extent_x, extent_y; /* half size of the box in which alpha >= 1/255, px */
  int32_t id;
  uint32_t tiles;   /* tiles it touches; set by tile_boxes */
  uint32_t clamped; /* bit c: channel c was clamped at 0 */
} pags_splat;

/* The tiles that a splat's bounding box meets, from (x0, y0), nx by ny. Bit k: tile k of the box, row by row, is
 * touched, where the box has at most 64; larger ones are tested again. */
typedef struct pags_tile_box {
  uint64_t touched;
  uint16_t x0, y0, nx, ny;
} pags_tile_box;

/* The 4x4-pixel blocks of the picture, [x0, x1) x [y0, y1), outside of which a splat can't change a pixel. Empty: it
 * changes none. */
typedef struct pags_reach {
  uint16_t x0, x1, y0, y1;
} pags_reach;

/* What projection needs of a camera and a part; floats derived in double. */
typedef struct pags_projection {
  float r[9], t[3];                     /* camera_from_model: p_cam = r p + t */
  float eye[3];                         /* camera centre in the model's frame */
  float fx, fy, cx, cy;                 /* px */
  float lim_x0, lim_x1, lim_y0, lim_y1; /* clamp of x/z and y/z in the Jacobian */
  float width, height;                  /* px */
  float near_plane, low_pass;
  int32_t antialiased;
  int32_t sh_degree;
} pags_projection;

enum { PAGS_SLOT_FLOATS = 12 }; /* partial gradient of one (Gaussian, tile) pair */
enum {                          /* its layout: sums over the pair's pixels; s = dL/d(exponent, base 2) */
       PAGS_SLOT_S,
       PAGS_SLOT_SU,
       PAGS_SLOT_SV,
       PAGS_SLOT_SUU,
       PAGS_SLOT_SUV,
       PAGS_SLOT_SVV,
       PAGS_SLOT_R,
       PAGS_SLOT_G,
       PAGS_SLOT_B,
       PAGS_SLOT_Z,
       PAGS_SLOT_ABS_X,
       PAGS_SLOT_ABS_Y
};

/* One entry of a tile's list: which splat, and which of that splat's tiles this is (row by row, from 0,
 * those left out not counted). */
typedef struct pags_entry {
  uint32_t splat, rank;
} pags_entry;

typedef struct pags_bin {
  const pags_splat *splats;
  const pags_tile_box *boxes; /* per splat */
  const uint32_t *drawn;      /* count of them */
  int64_t count;
  int tiles_x;
  const float *limits; /* per tile: pairs with a larger z are left out; NULL: none */
  int64_t *hidden;     /* out, of bin_count: how many; may be NULL */
} pags_bin;

/* Top left pixel of the tile in each plane; NULL where not wanted (all of depth, depth_sum, best and id, or none, or
 * depth_sum alone where nothing is resumed or left unfinished). A tile that is not finished leaves what it is resumed
 * from: colour without background, transmittance with the sign set where the pixel has stopped, sum(w) in depth. */
typedef struct pags_raster_out {
  float *rgb[3];
  float *transmittance;
  float *depth, *depth_sum; /* sum(w z)/sum(w); sum(w z) */
  float *best;              /* the largest weight; only read and written where a tile is resumed or left unfinished */
  int32_t *id;
  int64_t stride;
  float background[3];
} pags_raster_out;

typedef struct pags_raster_in {
  const pags_splat *splats;
  const pags_entry *entries; /* front to back */
  int64_t count;
  const pags_entry
      *ahead; /* ahead_count entries that will be drawn next: their splats are fetched meanwhile; changes no result */
  int64_t ahead_count;
  int x0, y0;            /* of the tile, px */
  int width, height;     /* of the picture: pixels outside count as stopped */
  int exp_degree;        /* 3 or 5 */
  uint16_t *block_masks; /* count entries: blocks of the tile that each pair may still change; written; may be NULL */
  int64_t *pairs;        /* [2], lanes evaluated and lanes blended, added to; NULL: not counted */
  int64_t *looked_at;    /* entries before the tile was full, in steps of some ten, added to; may be NULL */
  bool resume;           /* go on from what the planes hold, not from nothing */
  bool unfinished;       /* more may follow: don't finish the tile unless all of its pixels have stopped */
  float eps;             /* > 0: a pixel also stops as soon as its transmittance is <= eps */
  const float
      *hard; /* a plane as the output's: a splat with z > hard changes no pixel there; NULL: none. Not with eps */
} pags_raster_in;

enum { PAGS_BACK_PLANES = 10 }; /* that a tile reads at most */

typedef struct pags_raster_back {
  const pags_splat *splats;
  const pags_entry *entries;
  const uint16_t *block_masks; /* as forward left them */
  int64_t count;
  const int64_t *slot_start; /* per splat */
  float *slots;              /* PAGS_SLOT_FLOATS each; slot of a pair = slot_start[splat] + rank */
  int x0, y0, width, height; /* as forward's; forward must have used exp_degree 5 */
  int64_t stride;            /* of all planes below; each points at the tile's top left pixel */
  const float *rgb[3];       /* as forward left them (background included) */
  const float *transmittance;
  const float *depth_sum; /* sum(w z) or NULL when depth_gradient is */
  const float *rgb_gradient[3];
  const float *transmittance_gradient; /* NULL: zero */
  const float *depth_gradient;         /* NULL: zero */
  int32_t absolute;                    /* 1: fill the absolute sums too, else zeros */
  float background[3];
  /* What the same worker goes on with, to be fetched meanwhile. */
  int64_t next_count;                  /* entries that follow these */
  const float *next[PAGS_BACK_PLANES]; /* planes at the tile's top left pixel, NULL: none */
} pags_raster_back;

enum {
  PAGS_SCORE_SEEN,
  PAGS_SCORE_CRITICAL,
  PAGS_SCORE_SQUARED,
  PAGS_SCORE_SUMS
}; /* of one (Gaussian, tile) pair; score.inl */

typedef struct pags_raster_score {
  const pags_splat *splats;
  const pags_entry *entries;
  const uint16_t *block_masks; /* as forward left them */
  int64_t count;
  const int64_t *slot_start;       /* per splat */
  float *slots;                    /* PAGS_SCORE_SUMS each; slot of a pair = slot_start[splat] + rank */
  int x0, y0, width, height;       /* as forward's; forward must have used exp_degree 5 */
  int64_t stride;                  /* of all planes below; each points at the tile's top left pixel */
  const float *rgb[3];             /* as forward left them (background included) */
  const float *rgb_gradient[3];    /* NULL: 1 everywhere */
  const float *counted, *critical; /* 0..1 */
  int32_t overlap;                 /* 1: sums of alpha in place of alpha T; without rgb_gradient */
} pags_raster_score;

/* Directions of a picture's points (px, py), world axes, not of unit length: forward + (px - cx) across + (py - cy)
 * downwards. */
typedef struct pags_sky_rays {
  float forward[3], across[3], downwards[3];
  float cx, cy; /* px */
  int32_t size; /* of the cube map, texels a side, >= 1 */
} pags_sky_rays;

/* Where a tile's pixels, row after row, meet the cube map: the top left texel of four and how far they are from it,
 * 0..1. */
typedef struct pags_sky_tile {
  int32_t texel[PAGS_TILE_PIXELS];
  float along[PAGS_TILE_PIXELS], down[PAGS_TILE_PIXELS];
} pags_sky_tile;

/* dL/d(raw parameters) of up to 16 neighbouring rows and what densification asks for. */
typedef struct pags_row_gradient {
  float *data; /* plane p at data + p * stride */
  int64_t stride;
  float *mean2d, *mean2d_abs, *radius;
  uint8_t *bad; /* of rows set to zero because a value wasn't finite: 1 + the first plane that wasn't; others aren't
                   written. May be NULL */
} pags_row_gradient;

typedef struct pags_adam_step { /* of one plane; symbols as in adam.inl */
  float decay1, decay2;         /* b1^n, b2^n, n - 1 being the steps without a gradient since the last with one */
  float blend1, blend2;         /* 1 - b1, 1 - b2 */
  float rate;                   /* r c_k */
  float eps;                    /* e_k */
} pags_adam_step;

/* A band of rows of one channel for the training loss. Planes begin at their row 0; rows of all of them are `stride`
 * samples (a multiple of 16 >= width) apart. */
typedef struct pags_loss_rows {
  int width, height; /* px */
  int begin, end;    /* rows of the band */
  int64_t stride;
  const float *prediction;
  float exposure[2];       /* gain and offset: what is compared is gain * prediction + offset. 1, 0: as it is */
  const uint8_t *target;   /* 0..255 for 0..1; readable to the stride */
  const uint8_t *mask;     /* 0: neither picture is seen there and nothing counts; NULL: every pixel does */
  const uint8_t *emphasis; /* how often a pixel counts: 1 + emphasis * gain; NULL: once */
  float gain;
  float *gradient;            /* by the prediction: rows [begin, end) written, zero beyond the width */
  float l1_scale, ssim_scale; /* d(loss)/d(sum |x - y|), d(loss)/d(sum of SSIM values), of pixels that count once */
  float *scratch;             /* pags_loss_scratch(stride) floats, aligned to 64 bytes */
  double l1, squared, ssim; /* out: sums over the band's counted pixels, each once; `squared` of x clamped to [0, 1] */
  double more_l1,
      more_dssim; /* out: sums of what pixels count more than once: |x - y| and 1 - SSIM, times emphasis and gain */
  double by_exposure[2]; /* out: the band's part of the gradient by the exposure */
} pags_loss_rows;

typedef struct pags_opacity_row {
  int width;
  const float
      *transmittance; /* this and what follows up to the next multiple of 16 pixels readable, `gradient` writable */
  const uint8_t *labels, *mask; /* mask: 0 doesn't count; NULL: every pixel does */
  uint8_t chosen;               /* pixels with any of these labels are to be empty and the others full; */
  bool unsure;                  /* or, where it is true: they may be either, and the others are to be empty */
  float *gradient;              /* by the transmittance, times `scale`: added to */
  float scale;
} pags_opacity_row;

/* Floats from row to row of the scratch: an odd number of cache lines, so that rows don't fall into the same set. */
static inline int64_t pags_loss_pitch(int64_t stride) {
  return 16 * ((stride + 2 * 16) / 16 | 1);
}
static inline int64_t pags_loss_scratch(int64_t stride) {
  return (5 * 16 + 8) * pags_loss_pitch(stride);
}

typedef struct pags_kernels {
  const char *name; /* "scalar", "avx2", "avx512", "neon" */

  /* Projects rows [0, count) of the planes (plane p at data + p * stride; rounded up to 16 rows must be readable) into
   * `splats` (colour untouched), `keys`: the bits of z, or UINT32_MAX where nothing is to be drawn, and `reaches` of
   * what is to be drawn, unless that is NULL. count <= 256. Zhou/Zwicker's EWA with INRIA's constants; det by
   * Cauchy-Binet (a sum of squares: never negative). `factor`: what each row's opacity is multiplied by, 0 for a row
   * that isn't to be drawn, readable as the planes are; NULL: 1. The way back needs none: it goes by the logarithm of
   * the opacity. */
  void (*project)(const pags_projection *view, const float *data, int64_t stride, const float *factor, int count,
                  pags_splat *splats, uint32_t *keys, pags_reach *reaches);

  /* Colours of the rows whose key is not UINT32_MAX: max(0, 0.5 + SH(direction)). `dc`: three planes of the constant
   * term, as far apart as the data's, to be used in place of the data's own; NULL: the own. */
  void (*shade)(const pags_projection *view, const float *data, int64_t stride, const float *dc, int count,
                const uint32_t *keys, pags_splat *splats);

  /* The tiles of the rows whose key is not UINT32_MAX, in a picture of tiles_x by tiles_y, and their .tiles; count <=
   * 256. */
  void (*tile_boxes)(pags_splat *splats, const uint32_t *keys, int count, int tiles_x, int tiles_y,
                     pags_tile_box *boxes);
  /* Adds to counts[tile] for each tile that a splat touches. Returns how many splats have a pair. */
  int64_t (*bin_count)(const pags_bin *in, uint32_t *counts);
  /* Writes each pair to entries[offsets[tile]++]. */
  void (*bin_fill)(const pags_bin *in, int64_t *offsets, pags_entry *entries);

  /* Returns the tile's blocks that have a pixel which hasn't stopped, bit by bit. */
  unsigned (*raster)(const pags_raster_in *in, const pags_raster_out *out);
  /* 4 x 4 samples of the tile, in the middle of each 4 x 4 pixels, one after the other in planes of `out`; inside of
   * the picture or not. Of `in`, splats, entries, count, x0, y0 and eps (which may be 0) count. marked: the sum of
   * weights of splats whose id has marks[id] = 1, ids >= mark_count being without. */
  void (*sample)(const pags_raster_in *in, const uint8_t *marks, int64_t mark_count, const pags_raster_out *out,
                 float *marked);
  /* The depth-only pre-pass of the paper: the least z of the tile's splats whose alpha at the pixel is >= 1/2, infinity
   * where there is none, to depth (stride as out's); in any order. farthest[b]: the largest of block b's pixels inside
   * of the picture. Of `in`, splats, entries, count, x0, y0, width and height count. */
  void (*raster_depth)(const pags_raster_in *in, float *depth, int64_t stride, float farthest[PAGS_TILE_BLOCKS]);
  void (*raster_backward)(const pags_raster_back *in);
  void (*raster_score)(const pags_raster_score *in);

  /* Fills `tile` for the tile with its top left pixel at (x0, y0) and has the texels fetched, which takes a while. */
  void (*sky_find)(const pags_sky_rays *rays, const float *texels, int x0, int y0, pags_sky_tile *tile);
  /* rgb += transmittance * sky over a whole tile, to whose top left pixel the planes point; sky.inl. */
  void (*sky_blend)(const pags_sky_rays *rays, const float *texels, const pags_sky_tile *tile, int64_t stride,
                    const float *transmittance, float *const rgb[3]);
  /* What sky_blend takes for the tile's rows y0, y0 + step, ... (1 + 15 / step of them): of each pixel, row after row,
   * where the top left texel of four is (texel = row * size + column, rows counting on from face to face; the others: +
   * 1, + size, + size + 1; at size 1 it stands for all) and the four weights, weight[k] that of the k-th. */
  void (*sky_cells)(const pags_sky_rays *rays, int x0, int y0, int step, int32_t *row, int32_t *column,
                    float *const weight[4]);

  /* Sums `slots` of each drawn row and goes on to the raw parameters (shade's and project's backward). Rows whose key
   * is UINT32_MAX or whose splat has no tiles get zeros. Returns how many rows were not finite (and set to zero). */
  int (*project_backward)(const pags_projection *view, const float *data, int64_t stride, int count,
                          const uint32_t *keys, const pags_splat *splats, const int64_t *slot_start, const float *slots,
                          const pags_row_gradient *out);

  /* Adam over `rows` rows of one plane of parameters and moments (adam.inl). Rows up to the next multiple of 16 are
   * read and written too, with a gradient of zero. */
  void (*adam_replay)(float *p, const float *m, const float *v, int rows, const float *weights, int steps, float eps);
  void (*adam_update)(float *p, float *m, float *v, const float *gradient, int rows, const pags_adam_step *step);
  /* Which rows can't take a step: bit i & 15 of bad[i / 16] is set where a plane of row i has a parameter of 3e38 or
   * more, or a gradient of 1e18 or more (its square would not be a float for long). Plane k lies at p + k * p_stride
   * and gradient + k * gradient_stride. Other bits stay; returns whether any was set. */
  int (*adam_check)(const float *p, int64_t p_stride, const float *gradient, int64_t gradient_stride, int planes,
                    int rows, uint16_t *bad);
  /* range[0] = min, range[1] = max over rows of p and p - weight u, and of what range held. */
  void (*adam_reach)(const float *p, const float *m, const float *v, int rows, float weight, float eps, float range[2]);

  /* L1 + D-SSIM and their gradient (ssim.inl). */
  void (*loss_rows)(pags_loss_rows *io);
  /* Cross-entropy (of those that may be either: entropy) of a row of pixels; opacity.inl. Returns its sum, without
   * `scale`. */
  double (*opacity_row)(const pags_opacity_row *in);

  /* Peak blended lanes: `steps` Gaussians over one 4x4 block, all from registers. Returns something to keep. */
  float (*roofline)(const pags_splat *splats, int64_t steps, int exp_degree);
} pags_kernels;

/* NULL, with the reason in *why (a static string), when PAGS_CPU names a table that this machine or build lacks. */
const pags_kernels *pags_kernels_get(const char **why);
/* The table of that name, NULL if it can't run here. */
const pags_kernels *pags_kernels_named(const char *name);

extern const pags_kernels pags_kernels_scalar;
#if defined(__x86_64__)
extern const pags_kernels pags_kernels_avx2, pags_kernels_avx512;
#elif defined(__aarch64__)
extern const pags_kernels pags_kernels_neon;
#endif

#endif
