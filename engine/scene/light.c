/* SPDX-License-Identifier: Apache-2.0 */
/* Vignette and response curve of a camera (pags/light.h). */
#include <pags/light.h>

#include <math.h>

int pags_light_is_plain(const pags_light *light) {
  int plain = 1;
  for (int k = 0; k < PAGS_LIGHT_RINGS; k++)
    plain &= light->vignette[k] == 0;
  for (int i = 0; i < PAGS_LIGHT_PIECES - 1; i++)
    plain &= light->response[i] == 0;
  return plain;
}

double pags_light_knot(const pags_light *light, int i) {
  return i / (double)PAGS_LIGHT_PIECES + (i > 0 && i < PAGS_LIGHT_PIECES ? light->response[i - 1] : 0);
}

int pags_light_is_sound(const pags_light *light) {
  int sound = 1;
  for (int k = 0; k < PAGS_LIGHT_RINGS; k++)
    sound &= isfinite(light->vignette[k]) != 0;
  for (int i = 0; i < PAGS_LIGHT_PIECES; i++)
    sound &= pags_light_knot(light, i + 1) > pags_light_knot(light, i);
  return sound;
}

double pags_light_most(const pags_light *light, const pags_camera *camera) {
  double steepest = 1, brightest = 0; /* beyond 0..1 the curve's slope is 1 */
  for (int i = 0; i < PAGS_LIGHT_PIECES; i++)
    steepest = fmax(steepest, (pags_light_knot(light, i + 1) - pags_light_knot(light, i)) * PAGS_LIGHT_PIECES);
  /* The vignette is straight between its rings and from the last one to the corners. */
  for (int k = 0; k < PAGS_LIGHT_RINGS - 1; k++)
    brightest = fmax(brightest, pags_light_vignette(light, k / (double)(PAGS_LIGHT_RINGS - 1)));
  for (int corner = 0; corner < 4; corner++) {
    const double x = corner & 1 ? camera->width : 0, y = corner & 2 ? camera->height : 0;
    brightest = fmax(brightest, pags_light_vignette(light, pags_light_distance(camera, x, y)));
  }
  return steepest * brightest;
}

double pags_light_vignette(const pags_light *light, double q) {
  const int piece = q < 2.0 / 3.0 ? (int)(3 * q) : 2;
  const double begin = light->vignette[piece], end = light->vignette[piece + 1];
  return fmax(1 + begin + (end - begin) * (3 * q - piece), 0.01);
}

double pags_light_response(const pags_light *light, double value, double *slope) {
  double steep = 1, out = value;
  if (value > 0 && value < 1) {
    const int piece = (int)(value * PAGS_LIGHT_PIECES);
    const double begin = pags_light_knot(light, piece);
    steep = (pags_light_knot(light, piece + 1) - begin) * PAGS_LIGHT_PIECES;
    out = begin + steep * (value - piece / (double)PAGS_LIGHT_PIECES);
  }
  if (slope)
    *slope = steep;
  return out;
}
