/* SPDX-License-Identifier: Apache-2.0 */
/* Vignetting and response of a camera (pags/photometric.h). */
#include <pags/photometric.h>

#include <math.h>

int pags_photometric_is_identity(const pags_photometric *calibration) {
  int plain = 1;
  for (int k = 0; k < PAGS_VIGNETTING_RINGS; k++)
    plain &= calibration->vignette[k] == 0;
  for (int i = 0; i < PAGS_RESPONSE_PIECES - 1; i++)
    plain &= calibration->response[i] == 0;
  return plain;
}

double pags_photometric_curve_point(const pags_photometric *calibration, int i) {
  return i / (double)PAGS_RESPONSE_PIECES + (i > 0 && i < PAGS_RESPONSE_PIECES ? calibration->response[i - 1] : 0);
}

int pags_photometric_is_valid(const pags_photometric *calibration) {
  int sound = 1;
  for (int k = 0; k < PAGS_VIGNETTING_RINGS; k++)
    sound &= isfinite(calibration->vignette[k]) != 0;
  for (int i = 0; i < PAGS_RESPONSE_PIECES; i++)
    sound &= pags_photometric_curve_point(calibration, i + 1) > pags_photometric_curve_point(calibration, i);
  return sound;
}

double pags_photometric_max_gain(const pags_photometric *calibration, const pags_camera *camera) {
  double steepest = 1, brightest = 0; /* beyond 0..1 the curve's slope is 1 */
  for (int i = 0; i < PAGS_RESPONSE_PIECES; i++)
    steepest = fmax(steepest,
                    (pags_photometric_curve_point(calibration, i + 1) - pags_photometric_curve_point(calibration, i)) *
                        PAGS_RESPONSE_PIECES);
  /* The vignette is straight between its rings and from the last one to the corners. */
  for (int k = 0; k < PAGS_VIGNETTING_RINGS - 1; k++)
    brightest = fmax(brightest, pags_photometric_vignetting(calibration, k / (double)(PAGS_VIGNETTING_RINGS - 1)));
  for (int corner = 0; corner < 4; corner++) {
    const double x = corner & 1 ? camera->width : 0, y = corner & 2 ? camera->height : 0;
    brightest = fmax(brightest, pags_photometric_vignetting(calibration, pags_photometric_radius2(camera, x, y)));
  }
  return steepest * brightest;
}

double pags_photometric_vignetting(const pags_photometric *calibration, double q) {
  const int piece = q < 2.0 / 3.0 ? (int)(3 * q) : 2;
  const double begin = calibration->vignette[piece], end = calibration->vignette[piece + 1];
  return fmax(1 + begin + (end - begin) * (3 * q - piece), 0.01);
}

double pags_photometric_response(const pags_photometric *calibration, double value, double *slope) {
  double steep = 1, out = value;
  if (value > 0 && value < 1) {
    const int piece = (int)(value * PAGS_RESPONSE_PIECES);
    const double begin = pags_photometric_curve_point(calibration, piece);
    steep = (pags_photometric_curve_point(calibration, piece + 1) - begin) * PAGS_RESPONSE_PIECES;
    out = begin + steep * (value - piece / (double)PAGS_RESPONSE_PIECES);
  }
  if (slope)
    *slope = steep;
  return out;
}
