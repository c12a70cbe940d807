/* SPDX-License-Identifier: Apache-2.0 */
/* The training loss L = (1 - w) L1 + w (1 - SSIM) and its gradient by the picture.
 *
 * L1 and SSIM are means over the three channels of the counted pixels; a pixel that counts W times stands W times in
 * the sums, while they are divided by the number of pixels as ever, so that those that count once pull as hard as
 * without the others. SSIM has an 11x11 Gaussian window of sigma 1.5 and zeros outside of the picture (Kerbl et al.
 * 2023). Where there is a mask, both pictures are multiplied by it first, and only its pixels count. The prediction is
 * not clamped, except in the mean square, which is that of pags_eval_psnr. */
#ifndef PAGS_TRAIN_PHOTOMETRIC_LOSS_H
#define PAGS_TRAIN_PHOTOMETRIC_LOSS_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

/* How a picture is held against its photograph. */
typedef struct pags_comparison {
  double ssim_weight; /* w, 0..1 */
  double exposure[6]; /* the photograph's gains, then offsets, per channel: gain * picture + offset is compared. 1 and
                         0: the picture */
  const uint8_t
      *emphasis; /* 1 where a pixel counts `times` times, otherwise 0; stride as the photograph's; NULL: nowhere */
  double times;  /* >= 1; 1 where emphasis is NULL */
} pags_comparison;

typedef struct pags_photometric_loss {
  double loss;
  double l1;             /* mean |x - y|, every pixel once; so are those below */
  double mse;            /* mean square of clamped x - y: PSNR = -10 log10(mse) */
  double ssim;           /* mean */
  int64_t counted;       /* pixels; where 0, everything else is 0, too */
  double by_exposure[6]; /* the gradient by gains and offsets */
} pags_photometric_loss;

/* `photo` has the picture's size. gradient[c], by the picture as it is unexposed, receives planes of its stride and
 * height; padding is set to zero. The same bits for any number of threads. PAGS_ERROR_ARGUMENT on different sizes,
 * PAGS_ERROR_MEMORY, PAGS_CANCELLED, PAGS_ERROR_UNSUPPORTED when PAGS_CPU asks for kernels that can't run here. */
pags_result pags_photometric_loss_evaluate(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                           const pags_comparison *how, float *const gradient[3],
                                           pags_photometric_loss *out);

/* Pixels that the photograph's mask lets count. */
int64_t pags_photo_counted(const pags_photo *photo);

#endif
