/* SPDX-License-Identifier: Apache-2.0 */
/* How near a picture comes to the truth: PSNR, SSIM, LPIPS. Sums are double and in fixed order. */
#ifndef PAGS_EVAL_H
#define PAGS_EVAL_H

#include <pags/base.h>
#include <pags/image.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Both images: F32, 3 channels, same size, display-referred; values are clamped to [0, 1] first. `mask`: one byte a
 * pixel, non-zero counts; NULL counts all. Results are NaN where no pixel counts; PSNR of equal images is +inf. */
PAGS_API pags_result pags_eval_psnr(const pags_image *a, const pags_image *b, const uint8_t *mask, double *psnr);

/* Wang et al. 2004 as 3DGS computes it: 11x11 Gaussian of sigma 1.5, zero padding, C1 = 0.01^2, C2 = 0.03^2, mean over
 * channels and counted pixels. */
PAGS_API pags_result pags_eval_ssim(const pags_image *a, const pags_image *b, const uint8_t *mask, pags_tasks *tasks,
                                    double *ssim);

/* Both of several regions at once, at the price of one: bit r of a pixel's word says that it counts in region r, r <
 * count <= 16. SSIM's map is that of the whole pictures. Results as above, one per region. */
PAGS_API pags_result pags_eval_regions(const pags_image *a, const pags_image *b, const uint16_t *regions, int count,
                                       pags_tasks *tasks, double *psnr, double *ssim);

/* LPIPS v0.1 with SqueezeNet 1.1 (Zhang et al. 2018); weights in the layout of docs/lpips.md (.npz of stored float32
 * members). Not comparable with figures from AlexNet or VGG. */
typedef struct pags_lpips pags_lpips;
PAGS_API pags_result pags_lpips_load(const char *npz_path, pags_lpips **out);
PAGS_API void pags_lpips_destroy(pags_lpips *lpips);
/* Any size from 32x32 up. Deterministic for any number of threads. */
PAGS_API pags_result pags_lpips_distance(const pags_lpips *lpips, const pags_image *a, const pags_image *b,
                                         pags_tasks *tasks, double *distance);

#ifdef __cplusplus
}
#endif
#endif
