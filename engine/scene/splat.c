/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes antimatter15's .splat format: 32 bytes per Gaussian and no header. Position f32 x 3, sigma f32 x 3 (not its
 * logarithm), colour and opacity u8 x 4, rotation u8 x 4 (w x y z, (b - 128) / 128). The only spherical harmonic is
 * the constant one. */
#include <math.h>

#include "base/bytes.h"
#include "base/file.h"
#include "maths/maths.h"
#include "scene/splat_formats.h"

enum { ROW_BYTES = 32 };

pags_result pags_splat_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                              pags_splat_facts *facts) {
  facts->kind = "splat";
  if (size % ROW_BYTES != 0 || size == 0)
    return pags_fail_at(path, "expected a positive multiple of %d bytes in a .splat file, found %zu", ROW_BYTES, size);
  PAGS_TRY(pags_gaussians_create(out, (int64_t)(size / ROW_BYTES), 0));
  for (int64_t i = 0; i < out->count; i++) {
    const uint8_t *const row = bytes + i * ROW_BYTES;
    for (int k = 0; k < 3; k++) {
      /* Files with a sigma of 0 occur, whose logarithm isn't finite. One that can't be becomes NaN, and the Gaussian is
       * left out. */
      const float sigma = pags_load_f32(row + 12 + 4 * k);
      pags_plane(out, PAGS_MEAN + k)[i] = pags_load_f32(row + 4 * k);
      pags_plane(out, PAGS_SCALE + k)[i] =
          sigma >= 0 && isfinite(sigma) ? fmaxf((float)pags_log((double)sigma), PAGS_LEAST_SCALE) : NAN;
      pags_plane(out, PAGS_SH + k)[i] = (float)((row[24 + k] / 255.0 - 0.5) / PAGS_SH_C0);
    }
    pags_plane(out, PAGS_OPACITY)[i] = pags_logit_of_byte(row[27]);
    for (int k = 0; k < 4; k++)
      pags_plane(out, PAGS_ROTATION + k)[i] = (float)((row[28 + k] - 128) / 128.0);
  }
  return PAGS_OK;
}
