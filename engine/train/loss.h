/* The training loss L = (1 - w) L1 + w (1 - SSIM) and its gradient by the picture.
 *
 * L1 and SSIM are means over the three channels of the counted pixels; a pixel that counts W times stands W times in the sums, while
 * they are divided by the number of pixels as ever, so that those that count once pull as hard as without the others. SSIM has an 11x11 Gaussian window of sigma 1.5
 * and zeros outside of the picture (Kerbl et al. 2023). Where there is a mask, both pictures are multiplied by it
 * first, and only its pixels count. The prediction is not clamped, except in the mean square, which is that of
 * pags_eval_psnr. */
#ifndef PAGS_TRAIN_LOSS_H
#define PAGS_TRAIN_LOSS_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

/* What counts more than once. */
typedef struct pags_emphasis {
  const uint8_t *pixels; /* 0, or 1 where it does; stride as the photograph's; NULL: nowhere */
  double times;          /* how often, >= 1; 1 where pixels is NULL */
} pags_emphasis;

typedef struct pags_loss {
  double loss;
  double l1;       /* mean |x - y|, every pixel once; so are those below */
  double mse;      /* mean square of clamped x - y: PSNR = -10 log10(mse) */
  double ssim;     /* mean */
  int64_t counted; /* pixels; where 0, everything else is 0, too */
} pags_loss;

/* `photo` has the picture's size. gradient[c] receives planes of the picture's stride and height; padding is set to
 * zero. The same bits for any number of threads. PAGS_ERROR_ARGUMENT on different sizes, PAGS_ERROR_MEMORY,
 * PAGS_CANCELLED, PAGS_ERROR_UNSUPPORTED when PAGS_CPU asks for kernels that can't run here. */
pags_result pags_loss_evaluate(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                               const pags_emphasis *emphasis, double ssim_weight, float *const gradient[3],
                               pags_loss *out);

/* Pixels that the photograph's mask lets count. */
int64_t pags_photo_counted(const pags_photo *photo);

#endif
