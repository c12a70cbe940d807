/* SPDX-License-Identifier: Apache-2.0 */
/* The table of vector kernels: the inner loops of all stages, over plain arrays, without scenes and threads.
 *
 * pags_kernels_get() picks the best table that this processor can run, or the one that the environment variable
 * PAGS_CPU=scalar|avx2|avx512|neon names. The scalar table is the reference that the others are tested against. */
#ifndef PAGS_SIMD_KERNELS_H
#define PAGS_SIMD_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
  PAGS_LANES = 16,
  PAGS_TILE = 16, /* pixels per side */
  PAGS_TILE_PIXELS = PAGS_TILE * PAGS_TILE,
  PAGS_TILE_BLOCKS = 16 /* 4x4-pixel blocks of a tile, one vector each; block b at (b & 3, b >> 2) */
};

#define PAGS_ALPHA_MAX 0.99f
#define PAGS_ALPHA_MIN (1.0f / 255.0f) /* the default; Kerbl et al. 2023 */
#define PAGS_T_STOP 1e-4f
#define PAGS_COLOUR_MAX 1e6f      /* of a Gaussian's shaded colour; the loss takes four of these in a product */
#define PAGS_LOG2_255 7.99435344f /* -log2 of it */
/* Limits for Gaussians that are drawn at the time of their line (scan.h): the least q, and the largest motion in pixels
 * per line. */
#define PAGS_SCAN_LEAST 0.1f
#define PAGS_SCAN_MOST 1.0f
/* Added to the cut-off, in powers of two, by every test that excludes pixels before they are computed, so that no
 * pixel is excluded at which the rasteriser, with its rounding of u^2 + v^2, would blend. u has an error of about
 * 2^-23 p |d| <= 1e-3 for |d| <= 4096 px, hence u^2 one of at most 0.01. */
#define PAGS_CUT_SLACK 0.02f

/* Cut-off of a part's Gaussians. With least alpha a, the rasteriser blends at a pixel
 *
 *     hard         alpha        where alpha >= a, else 0
 *     continuous   (alpha - a) / (1 - a)    where alpha > a, else 0
 *
 * capped at 0.99. Both are 2^e - floor where e >= cut: hard has floor 0, cut log2 a and lift 0; continuous has
 * floor a / (1 - a), and e is raised by lift = -log2(1 - a), so that it meets the floor at cut = log2 floor. */
typedef struct pags_alpha_cut {
  float least; /* a */
  float cut, floor, lift;
} pags_alpha_cut;

/* A projected Gaussian, 64 bytes, one cache line.
 * The falloff is 2^(log2_opacity - u^2 - v^2) with u = p (dx - h dy), v = w dy, d = pixel centre - mean: the Cholesky
 * factor of log2(e)/2 times the inverse covariance. Writing it as a sum of squares keeps long thin Gaussians exact
 * where the usual a dx^2 + 2 b dx dy + c dy^2 cancels, and cannot grow. */
typedef struct pags_splat {
  float x, y;    /* mean, px */
  float p, h, w; /* p = sqrt(k C / D), h = B / C, w = sqrt(k / C); covariance [A B; B C], D its det, k = log2(e)/2 */
  float log2_opacity; /* lift included; <= lift unless projection was given factors; alpha is capped in the
                         rasteriser */
  float r, g, b;      /* colour, >= 0 */
  float z;            /* camera depth, metres; its bits are the sort key */
  float slope;        /* B / A: dy / dx of the line where the falloff is largest for a given dx; for the tile test */
  float cut, floor;   /* of its part's pags_alpha_cut */
  int32_t id;
  uint32_t tiles;   /* tiles it touches; set by tile_boxes */
  uint32_t clamped; /* bit c: channel c was clamped at 0 */
} pags_splat;

/* The tiles that a splat's bounding box overlaps: nx by ny tiles from (x0, y0). Bit k of `touched`: the splat touches
 * tile k of the box, row by row, if the box has at most 64 tiles; for larger boxes the tiles are tested again. */
typedef struct pags_tile_box {
  union {
    uint64_t touched;
    float extent[2]; /* before tile_boxes: half the size of the box outside of which the splat isn't blended, px */
  };
  uint16_t x0, y0, nx, ny;
} pags_tile_box;

/* The rectangle [x0, x1) x [y0, y1) of the picture's 4x4-pixel blocks outside of which a splat can't change a pixel.
 * If it is empty, the splat changes no pixel at all. */
typedef struct pags_reach {
  uint16_t x0, x1, y0, y1;
} pags_reach;

/* How a part moves in camera space while a rolling shutter reads the picture. Time u counts read-outs from the middle
 * of the exposure: -1/2 at one edge of the picture, 1/2 at the opposite one. The pose is the parabola through the exact
 * poses at u = -1/2, 0 and 1/2. */
typedef struct pags_scan {
  float x, y, start;                /* a pixel at (x, y) is read at u = x X + y Y + start; one of x and y is 0 */
  float r1[9], t1[3], r2[9], t2[3]; /* camera_from_model is r + u r1 + u^2 r2, t + u t1 + u^2 t2 */
  float eye1[3], eye2[3];           /* the camera's centre is eye + u eye1 + u^2 eye2 */
} pags_scan;

/* A lens as the kernels see points through it (lens.h); filled in by the engine. */
enum { PAGS_LENS_STEPS = 512 };
typedef enum pags_lens_terms { /* of what the tangential and prism terms are */
                               PAGS_LENS_NO_TERMS,
                               PAGS_LENS_TERMS_OF_SLOPE, /* X / Z, Y / Z */
                               PAGS_LENS_TERMS_OF_ANGLE,
                               PAGS_LENS_TERMS_OF_RADIUS
} pags_lens_terms;
typedef struct pags_lens_table {
  float turn;     /* px per full turn, of longitude and latitude; 0: any other lens */
  float a[4];     /* from focal lengths to px, row by row */
  float farthest; /* means are drawn up to this angle from the axis, radians */
  int32_t clamps; /* derivatives are taken at x/z and y/z clamped to [least, most] */
  float least[2], most[2];
  int32_t terms_of;                 /* pags_lens_terms */
  float p[2], prism[4];             /* prism: coefficients of r^2 and r^4 of x, then of y */
  float per_radian;                 /* steps a radian */
  float radius[PAGS_LENS_STEPS][4]; /* cubics in steps from 0 to `farthest`, in focal lengths */
} pags_lens_table;

/* The parameters of projection: a camera and the pose of a part, computed in double and stored as floats. */
typedef struct pags_projection {
  float r[9], t[3];                     /* camera_from_model: p_cam = r p + t */
  float eye[3];                         /* camera centre in the model's frame */
  float fx, fy, cx, cy;                 /* px */
  float lim_x0, lim_x1, lim_y0, lim_y1; /* clamp of x/z and y/z in the Jacobian */
  float width, height;                  /* px */
  float near_plane, low_pass;
  float clips[8][4]; /* planes in camera space; a mean with a x + b y + c z + d < 0 isn't drawn */
  int32_t clip_count;
  pags_alpha_cut alpha;
  int32_t antialiased;
  int32_t sh_degree;
  const pags_scan *scan;       /* NULL: all pixels are read at once */
  const pags_lens_table *lens; /* NULL: a pinhole. Depth is the distance, and the near plane a sphere */
  int32_t turned;              /* seen at its second place, over the seam of longitude */
} pags_projection;

/* What `project` has counted. */
typedef struct pags_project_counts {
  int32_t held;   /* rows that are drawn at mid-exposure since they are too fast for the read-out (scan.h) */
  int32_t beyond; /* rows beyond the angle to which a lens is drawn */
} pags_project_counts;

enum { PAGS_SLOT_FLOATS = 12 }; /* partial gradient of one (Gaussian, tile) pair; the last is 0 */
enum {                          /* the layout of a slot: sums over the pair's pixels; s = dL/d(exponent), base 2 */
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
       PAGS_SLOT_SQUARED /* as PAGS_SCORE_SQUARED of score.c; 0 if not wanted */
};

/* One entry of a tile's list: the index of the splat, and either the splat's key, by which the list is sorted, or the
 * rank of the tile among the tiles of that splat that have an entry (row by row, from 0), where a backward pass will
 * need it. */
typedef struct pags_entry {
  uint32_t splat;
  union {
    uint32_t key, rank;
  };
} pags_entry;

typedef struct pags_bin {
  const pags_splat *splats;
  const pags_tile_box *boxes; /* per splat */
  const uint32_t *drawn;      /* indices of the `count` splats that are drawn */
  int64_t count;
  int tiles_x;
  const float *limits;  /* per tile: pairs with a larger z are left out; NULL: no limits */
  int64_t *hidden;      /* out, by bin_count: number of pairs left out; may be NULL */
  const uint32_t *keys; /* per splat, which bin_fill gives to the entries; NULL: ranks, and no limits */
} pags_bin;

/* Output planes of a tile: pointers to its top left pixel in each plane; NULL if not wanted. depth, depth_sum,
 * best and id are given all or not at all, or depth_sum alone if no tile is resumed or left unfinished. An
 * unfinished tile leaves in the planes the state that it is resumed from: colour without background, transmittance
 * with a negative sign where the pixel has stopped, sum(w) in depth. */
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
      *ahead; /* ahead_count entries that will be drawn next: their splats are prefetched; changes no result */
  int64_t ahead_count;
  int x0, y0;            /* of the tile, px */
  int width, height;     /* of the picture: pixels outside count as stopped */
  int exp_degree;        /* 3 or 5 */
  uint16_t *block_masks; /* out, count entries: blocks of the tile that each pair may still change; may be NULL */
  int64_t *pairs;        /* [3], lanes evaluated, blended, and evaluated at pixels that hadn't stopped; added to; NULL:
                            not counted */
  int64_t *looked_at;    /* entries processed until saturation, rounded up to a chunk, added to; may be NULL */
  bool resume;           /* continue from the state in the planes instead of from empty pixels */
  bool unfinished;       /* more entries may follow: leave the tile unfinished unless all pixels have stopped */
  float eps;             /* > 0: a pixel also stops as soon as its transmittance is <= eps, and is opaque then */
  const float
      *hard; /* a plane as the output's: a splat with z > hard changes no pixel there; NULL: none. Not with eps */
} pags_raster_in;

/* The pairs of a tile that has been drawn, for the kernels that walk through them again. */
typedef struct pags_drawn_tile {
  const pags_splat *splats;
  const pags_entry *entries;   /* front to back */
  const uint16_t *block_masks; /* of each pair; written by the forward pass, as the entries and rgb */
  int64_t count;
  const int64_t *slot_start; /* per splat */
  float *slots;              /* out; slot of a pair = slot_start[splat] + rank */
  int x0, y0, width, height; /* as in the forward pass, which must have used exp_degree 5 */
  int64_t stride;            /* of all planes; each points at the tile's top left pixel */
  const float *rgb[3];       /* background included */
} pags_drawn_tile;

enum { PAGS_BACK_PLANES = 10 }; /* most planes that a tile reads */

typedef struct pags_raster_back {
  pags_drawn_tile tile; /* slots of PAGS_SLOT_FLOATS */
  const float *transmittance;
  const float *depth_sum; /* sum(w z) or NULL when depth_gradient is */
  const float *rgb_gradient[3];
  const float *transmittance_gradient; /* NULL: zero */
  const float *depth_gradient;         /* NULL: zero */
  const float *counted;                /* weights of the pixels in PAGS_SLOT_SQUARED; NULL: not wanted */
  /* The tile that the same worker processes next, to be prefetched. */
  int64_t next_count;                  /* its entries, which follow these */
  const float *next[PAGS_BACK_PLANES]; /* planes at the tile's top left pixel, NULL: none */
} pags_raster_back;

enum {
  PAGS_SCORE_SEEN,
  PAGS_SCORE_CRITICAL,
  PAGS_SCORE_SQUARED,
  PAGS_SCORE_SUMS
}; /* of one (Gaussian, tile) pair; score.c */

typedef struct pags_raster_score {
  pags_drawn_tile tile;            /* slots of PAGS_SCORE_SUMS */
  const float *counted, *critical; /* 0..1 */
  int32_t overlap;                 /* 1: sums of alpha in place of alpha T */
} pags_raster_score;

typedef struct pags_raster_weights {
  const pags_splat *splats;
  const pags_entry *entries;   /* a run of the tile's list; runs are given front to back */
  const uint16_t *block_masks; /* as forward left them */
  int64_t count;
  int x0, y0, width, height, exp_degree; /* as forward's, which must have had neither eps nor hard */
  bool first;                            /* the list begins with this run: transmittance isn't read */
  /* [PAGS_TILE_PIXELS], block after block, the 16 pixels of each row by row: T behind the run, with a negative sign
   * where the pixel has stopped. Aligned to 64 bytes, as `weights`. */
  float *transmittance;
  float *weights;    /* out: [count][PAGS_TILE_PIXELS], in this order; unset in blocks without their bit in `blended` */
  uint16_t *blended; /* out, per entry: the blocks in which it has a weight */
} pags_raster_weights;

/* The direction of a picture's point (px, py), along the world's axes, not of unit length, is
 *     forward + (px - cx) across + (py - cy) downwards. */
typedef struct pags_sky_rays {
  float forward[3], across[3], downwards[3];
  float cx, cy; /* px */
  int32_t size; /* of the cube map, texels per side, >= 1 */
} pags_sky_rays;

/* Where a tile's pixels, row after row, meet the cube map: the index of the top left one of the four texels around
 * that point, and the distance from it along the row and down the columns, 0..1 texel. */
typedef struct pags_sky_tile {
  int32_t texel[PAGS_TILE_PIXELS];
  float along[PAGS_TILE_PIXELS], down[PAGS_TILE_PIXELS];
} pags_sky_tile;

/* An Adam step of the sky. Each colour has its own bias corrections, since texels are seen at different steps. */
typedef struct pags_sky_step {
  float decay1, decay2, eps;
  /* Per colour: dL/d(colour); the rate times 1 / (1 - decay1^k), 0: not seen, stays as it is; 1 / (1 - decay2^k). */
  const float *gradient, *rate, *correction;
} pags_sky_step;

/* Output of project_backward: dL/d(raw parameters) of consecutive rows, and two values for densification, as in
 * pags_cluster_gradient: |dL/d(projected mean)| in NDC, and the radius of three sigma, px. */
typedef struct pags_row_gradient {
  float *data; /* plane p at data + p * stride */
  int64_t stride;
  float *mean2d, *radius;
  uint8_t *bad; /* written only for rows set to zero, a value not being finite: 1 + the first such plane; may be
                 * NULL */
} pags_row_gradient;

typedef struct pags_adam_step { /* of one plane; symbols as in adam.c */
  float decay1, decay2;         /* b1^n, b2^n, n - 1 being the steps without a gradient since the last with one */
  float blend1, blend2;         /* 1 - b1, 1 - b2 */
  float rate;                   /* r c_k */
  float eps;                    /* e_k */
} pags_adam_step;

/* A band of rows of one channel for the training loss. Planes begin at their row 0; rows of all of them are `stride`
 * samples (a multiple of 16 >= width) apart. */
/* Sums over the pixels of a row that count. */
typedef enum pags_loss_sum {
  PAGS_LOSS_L1,
  PAGS_LOSS_SQUARED, /* of the difference with the prediction clamped to [0, 1] */
  PAGS_LOSS_SSIM,
  PAGS_LOSS_MORE_L1, /* of |x - y| and of 1 - SSIM times emphasis * gain, to be added to those above */
  PAGS_LOSS_MORE_DSSIM,
  PAGS_LOSS_BY_GAIN, /* the row's part of the gradient by the exposure */
  PAGS_LOSS_BY_OFFSET,
  PAGS_LOSS_SUMS
} pags_loss_sum;

typedef struct pags_loss_rows {
  int width, height; /* px */
  int begin, end;    /* rows of the band */
  int64_t stride;
  const float *prediction;
  float exposure[2];       /* gain and offset: gain * prediction + offset is compared; 1, 0: no change */
  const uint8_t *target;   /* 0..255 for 0..1; readable to the stride */
  const uint8_t *mask;     /* 0: both pictures are taken as 0 there and the pixel doesn't count; NULL: all count */
  const uint8_t *emphasis; /* the weight of a pixel is 1 + emphasis * gain; NULL: 1 */
  float gain;
  float *gradient;                /* by the prediction: rows [begin, end) written, zero beyond the width */
  float l1_scale, ssim_scale;     /* d(loss)/d(sum |x - y|), d(loss)/d(sum of SSIM values), of pixels of weight 1 */
  float *scratch;                 /* pags_loss_scratch(stride) floats, aligned to 64 bytes */
  double (*sums)[PAGS_LOSS_SUMS]; /* of the rows [begin, end), from sums[0] on; they don't depend on the band */
} pags_loss_rows;

typedef struct pags_opacity_row {
  int width;
  const float
      *transmittance; /* all arrays must be readable, `gradient` writable, up to the next multiple of 16 pixels */
  const uint8_t *labels, *mask; /* mask: 0 doesn't count; NULL: every pixel does */
  uint8_t chosen;               /* label bits: pixels with any of these should be empty, the others full; */
  uint8_t unknown;              /* label bits: pixels with any of these don't count */
  bool unsure;                  /* or, if true: the former should be empty or full, the others empty */
  float *gradient;              /* by the transmittance, times `scale`: added to */
  float scale;
} pags_opacity_row;

/* A row of pixels through a camera's vignette and response curve (photometric.c). */
enum { PAGS_LIGHT_BENDS = 6 };
typedef struct pags_light_row {
  int width;                     /* planes are readable and writable up to the next multiple of 16 pixels */
  float cx, y_squared;           /* the principal point, px; the row's squared distance from it, px^2 */
  float per_corner;              /* 1 / the corner's squared distance, px^-2 */
  float vignette[4];             /* base, slope, and its changes at q = 1/3 and 2/3 */
  float bends[PAGS_LIGHT_BENDS]; /* changes of the curve's slope at u = k/6, from 1 */
  const float *rgb[3];           /* radiance of the scene */
  float *planes[3]; /* out: values after vignetting and response; in light_back: the gradient by these, replaced by the
                       gradient by rgb */
} pags_light_row;

/* Distance between rows of the scratch, in floats: an odd number of cache lines, so that rows lie in different
 * cache sets. */
static inline int64_t pags_loss_pitch(int64_t stride) {
  return 16 * ((stride + 2 * 16) / 16 | 1);
}
static inline int64_t pags_loss_scratch(int64_t stride) {
  return (5 * 16 + 8) * pags_loss_pitch(stride);
}

typedef struct pags_kernels {
  const char *name; /* "scalar", "avx2", "avx512", "neon"; fewer than 8 characters */
  bool fuses;       /* multiply-add in one rounding; tables that agree in this give the same bits */

  /* Projects rows [0, count), count <= 256, of the planes (plane p at data + p * stride; rows up to the next multiple
   * of 16 must be readable). Writes `keys` (the bits of z; UINT32_MAX if the row isn't drawn) and, of the rows that are
   * drawn, `splats`, with zeros as colours and id, and, unless NULL, the `reaches`; of `boxes` the extents or, if
   * `tiles`, all that tile_boxes would find for the view's picture. The method is EWA
   * splatting (Zwicker et al. 2001) with INRIA's constants; the determinant of the covariance is computed by the
   * Cauchy-Binet formula, as a sum of squares that is never negative. `factor`: per row, the opacity is multiplied by
   * this, readable as far as the planes; 0: the row isn't drawn; NULL: 1. The backward pass needs no factor, since it
   * differentiates by the logarithm of the opacity. */
  pags_project_counts (*project)(const pags_projection *view, const float *data, int64_t stride, const float *factor,
                                 int count, pags_splat *splats, uint32_t *keys, bool tiles, pags_tile_box *boxes,
                                 pags_reach *reaches);

  /* Computes the colours of the rows whose key is not UINT32_MAX: max(0, 0.5 + SH(direction)). `sh`: planes of the
   * SH coefficients, `stride` floats apart, that replace those of the data; NULL: those of the data are used. */
  void (*shade)(const pags_projection *view, const float *data, int64_t stride, const float *sh, int count,
                const uint32_t *keys, pags_splat *splats);

  /* Finds the tiles that the splats touch whose key is not UINT32_MAX, from the extents of their boxes, in a picture of
   * tiles_x by tiles_y tiles, and sets their member `tiles`; count <= 256. */
  void (*tile_boxes)(pags_splat *splats, const uint32_t *keys, int count, int tiles_x, int tiles_y,
                     pags_tile_box *boxes);
  /* Adds to counts[tile] for each tile that a splat touches. Returns how many splats have a pair. */
  int64_t (*bin_count)(const pags_bin *in, uint32_t *counts);
  /* Writes each pair to entries[offsets[tile]++]. */
  void (*bin_fill)(const pags_bin *in, int64_t *offsets, pags_entry *entries);

  /* Blends a tile's entries front to back. Returns the mask of blocks that have a pixel which hasn't stopped. */
  unsigned (*raster)(const pags_raster_in *in, const pags_raster_out *out);
  /* Blends the tile at 4 x 4 sample points, in the middle of each 4 x 4 pixels, and writes them to a 4x4 rectangle of
   * the planes of `out`; also samples outside of the picture. Only splats, entries, count, x0, y0 and eps (which may
   * be 0) of `in` are used. marked: the sum of the weights of splats whose id has marks[id] = 1; others
   * and ids >= mark_count have no mark. */
  void (*sample)(const pags_raster_in *in, const uint8_t *marks, int64_t mark_count, const pags_raster_out *out,
                 float *marked);
  /* The depth-only pre-pass of the paper: writes to `depth`, for each pixel, the smallest z of the tile's splats
   * whose alpha there is >= 1/2, or infinity; the entries may have any order. farthest[b]: the largest
   * depth of block b's pixels inside of the picture. Only splats, entries, count, x0, y0, width and height of `in`
   * are used. */
  void (*raster_depth)(const pags_raster_in *in, float *depth, int64_t stride, float farthest[PAGS_TILE_BLOCKS]);
  void (*raster_backward)(const pags_raster_back *in);
  void (*raster_score)(const pags_raster_score *in);
  /* The weight of each splat at each pixel; weights.c. */
  void (*raster_weights)(const pags_raster_weights *in);

  /* Fills `tile` for the tile with its top left pixel at (x0, y0) and prefetches its texels for sky_blend. */
  void (*sky_find)(const pags_sky_rays *rays, const float *texels, int x0, int y0, pags_sky_tile *tile);
  /* rgb += transmittance * sky over a whole tile, to whose top left pixel the planes point; sky.c. */
  void (*sky_blend)(const pags_sky_rays *rays, const float *texels, const pags_sky_tile *tile, int64_t stride,
                    const float *transmittance, float *const rgb[3]);
  /* Computes, for the pixels of the tile's rows y0, y0 + step, ... (1 + 15 / step rows), the texels and weights that
   * sky_blend uses: the row and column of the top left one of four texels (its index is row * size + column, rows
   * counting on from face to face; the others are at + 1, + size and + size + 1; at size 1 all four are the same),
   * and the weight weight[k] of the k-th texel. */
  void (*sky_cells)(const pags_sky_rays *rays, int x0, int y0, int step, int32_t *row, int32_t *column,
                    float *const weight[4]);
  /* One Adam step of `floats` colours of the sky, a multiple of 16; sky.c. */
  void (*sky_adam)(const pags_sky_step *step, int floats, float *colour, float *first, float *second);

  /* Sums the slots of each drawn row and computes from them the gradients of the raw parameters (backward of shade
   * and project). `sh` as shade had it. Rows whose key is UINT32_MAX or whose splat has no tiles get zeros. Returns how
   * many rows were not finite (and set to zero). */
  int (*project_backward)(const pags_projection *view, const float *data, int64_t stride, const float *sh, int count,
                          const uint32_t *keys, const pags_splat *splats, const int64_t *slot_start, const float *slots,
                          const pags_row_gradient *out);

  /* Adam over `rows` rows of one plane of parameters and moments (adam.c). Rows up to the next multiple of 16 are
   * read and written too, with a gradient of zero. */
  void (*adam_replay)(float *p, const float *m, const float *v, int rows, const float *weights, int steps, float eps);
  void (*adam_update)(float *p, float *m, float *v, const float *gradient, int rows, const pags_adam_step *step);
  /* Finds rows that must not be updated: bit i & 15 of bad[i / 16] is set if a plane of row i has a parameter of 3e38
   * or more, or a gradient of 1e18 or more (sums of its square would overflow a float), or NaN. Plane k lies at
   * p + k * p_stride and gradient + k * gradient_stride. Other bits stay; returns whether any was set. */
  int (*adam_check)(const float *p, int64_t p_stride, const float *gradient, int64_t gradient_stride, int planes,
                    int rows, uint16_t *bad);
  /* range[0] = min, range[1] = max over rows of p and p - weight u, and of what range held. */
  void (*adam_reach)(const float *p, const float *m, const float *v, int rows, float weight, float eps, float range[2]);

  /* L1 + D-SSIM and their gradient (ssim.c). */
  void (*loss_rows)(pags_loss_rows *io);
  /* Cross-entropy of the opacity of a row of pixels, or entropy for those that may be empty or full (opacity.c).
   * Returns the sum, not multiplied by `scale`. */
  double (*opacity_row)(const pags_opacity_row *in);

  /* Vignetting and camera response over a row of pixels, and the gradient by the four numbers of the vignette and by
   * the logarithm of the slope of each piece of the curve divided by the piece's rise (photometric.c). */
  void (*light_row)(const pags_light_row *in);
  void (*light_back)(const pags_light_row *in, double by_vignette[4], double by_rises[PAGS_LIGHT_BENDS]);

  /* Benchmark of the peak blending rate: blends `steps` Gaussians over one 4x4 block, all in registers. Returns a sum
   * of the result, so that the work isn't optimised away. */
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
