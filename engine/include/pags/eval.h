/* SPDX-License-Identifier: Apache-2.0 */
/* Image metrics: how close a picture comes to its ground truth, as PSNR, SSIM and LPIPS. Sums are computed in
 * double and in a fixed order, so that results are the same bits for any number of threads. All functions may be
 * called from several threads at once, each with its own `tasks`. */
#ifndef PAGS_EVAL_H
#define PAGS_EVAL_H

#include <pags/base.h>
#include <pags/image.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

/* Computes the peak signal-to-noise ratio of two pictures in dB: 10 log10(1 / MSE), the mean squared error taken
 * over the three channels of the counted pixels.
 *
 * For all metrics here: both pictures are PAGS_F32 with 3 channels, of the same size and display-referred; values
 * are clamped to [0, 1] first, and NaN counts as 0. `mask` has one byte per pixel, row by row; pixels with a
 * non-zero byte count; NULL counts all. The result is NaN if no pixel counts; PSNR of equal pictures is
 * +infinity. PAGS_ERROR_ARGUMENT for pictures of another kind or of different sizes. */
PAGS_API pags_result pags_eval_psnr(const pags_image *a, const pags_image *b, const uint8_t *mask, double *psnr);

/* Computes the structural similarity (Wang et al. 2004) as 3DGS does: 11x11 Gaussian window of sigma 1.5, zero
 * padding, C1 = 0.01^2, C2 = 0.03^2; the mean of the SSIM map over channels and counted pixels. The map is
 * computed from the unmasked pictures. Also PAGS_ERROR_MEMORY and PAGS_CANCELLED. */
PAGS_API pags_result pags_eval_ssim(const pags_image *a, const pags_image *b, const uint8_t *mask, pags_tasks *tasks,
                                    double *ssim);

/* Computes PSNR and SSIM of several regions at once, for about the time of one: a pixel counts in region r if bit
 * r of its word in `regions` (row by row) is set, r < count, count 1..16. The SSIM map is that of the whole
 * pictures. `psnr` and `ssim` receive `count` results each, with values and errors as above. */
PAGS_API pags_result pags_eval_regions(const pags_image *a, const pags_image *b, const uint16_t *regions, int count,
                                       pags_tasks *tasks, double *psnr, double *ssim);

/* The network and weights of LPIPS v0.1 (Zhang et al. 2018): SqueezeNet 1.1 or AlexNet. Values of different networks
 * can't be compared. */
typedef struct pags_lpips pags_lpips;

/* Reads the weights from an .npz file of stored (not compressed) float32 members in the layout of docs/eval.md; the
 * members' names tell the network.
 * PAGS_ERROR_IO, PAGS_ERROR_FORMAT (damaged, or members missing or of the wrong shape), PAGS_ERROR_UNSUPPORTED
 * (compressed, another sample type) or PAGS_ERROR_MEMORY; then *out is NULL. */
PAGS_API pags_result pags_lpips_load(const char *npz_path, pags_lpips **out);

/* Frees the weights. NULL is allowed. */
PAGS_API void pags_lpips_destroy(pags_lpips *lpips);

/* The network's name, "SqueezeNet 1.1" or "AlexNet"; a constant. */
PAGS_API const char *pags_lpips_network(const pags_lpips *lpips);

enum { PAGS_LPIPS_SMALLEST = 32 }; /* pixels of the shortest side of a picture */

/* Computes the LPIPS distance of two pictures of at least 32x32 pixels: 0 for equal pictures, larger for less
 * similar ones. The result is the same for any number of threads. PAGS_ERROR_ARGUMENT for pictures of another
 * kind, of different sizes or too small; PAGS_ERROR_MEMORY; PAGS_CANCELLED. */
PAGS_API pags_result pags_lpips_distance(const pags_lpips *lpips, const pags_image *a, const pags_image *b,
                                         pags_tasks *tasks, double *distance);

PAGS_END_C
#endif
