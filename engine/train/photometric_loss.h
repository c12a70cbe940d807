/* SPDX-License-Identifier: Apache-2.0 */
/* The photometric loss L = (1 - w) L1 + w (1 - SSIM) of a rendered picture against its photograph (Kerbl et al.
 * 2023), and its gradient by the picture.
 *
 * L1 and SSIM are means over the three channels of the counted pixels. A pixel of weight W > 1 enters the sums W
 * times, but the sums are still divided by the number of pixels, so that the gradient of the pixels of weight 1 is
 * the same as without any weights. SSIM has an 11x11 Gaussian window of sigma 1.5 and zeros outside of the picture.
 * If there is a mask, both pictures are multiplied by it first, and only its pixels are counted. The rendered picture
 * is not clamped, except in the mean square error, which is that of pags_eval_psnr. */
#ifndef PAGS_TRAIN_PHOTOMETRIC_LOSS_H
#define PAGS_TRAIN_PHOTOMETRIC_LOSS_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

/* How a picture is compared with its photograph. */
typedef struct pags_comparison {
  double ssim_weight; /* w, 0..1 */
  double exposure[6]; /* gains, then offsets of the photograph, per channel: gain * picture + offset is compared with
                         the photograph; 1 and 0: the picture as it is */
  const uint8_t *emphasis; /* 1 where a pixel has weight `times`, 0 where it has weight 1; stride as the photograph's;
                              NULL: 0 everywhere */
  double times;            /* weight of emphasised pixels, >= 1; 1 if emphasis is NULL */
} pags_comparison;

typedef struct pags_photometric_loss {
  double loss;
  double l1;             /* mean |x - y|, every pixel with weight 1, as in mse and ssim */
  double mse;            /* mean square of x - y, both clamped: PSNR = -10 log10(mse) */
  double ssim;           /* mean SSIM */
  int64_t counted;       /* number of counted pixels; if 0, everything else is 0, too */
  double by_exposure[6]; /* gradient of the loss by gains and offsets */
} pags_photometric_loss;

/* Computes the loss and its gradient. `photo` must have the picture's size. gradient[c] receives the gradient by
 * channel c of the picture before the exposure is applied, as a plane of its stride and height; padding is set to
 * zero. The same bits for any number of threads. PAGS_ERROR_ARGUMENT on different sizes, PAGS_ERROR_MEMORY,
 * PAGS_CANCELLED, PAGS_ERROR_UNSUPPORTED when PAGS_CPU asks for kernels that can't run here. */
pags_result pags_photometric_loss_evaluate(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                           const pags_comparison *how, float *const gradient[3],
                                           pags_photometric_loss *out);

/* PAGS_ERROR_ARGUMENT unless the photograph has the picture's size. */
pags_result pags_photo_check_size(const pags_picture *picture, const pags_photo *photo);

/* Returns the number of pixels inside of the photograph's mask, all pixels if it has none. */
int64_t pags_photo_counted(const pags_photo *photo);

#endif
