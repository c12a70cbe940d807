/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera makes of the light that it sees: a lens is darker towards its corners, and the electronics bend values.
 * Both in display-referred sRGB, the same for all three channels, before an exposure's gain and offset. All functions
 * are safe to call from several threads at once. */
#ifndef PAGS_LIGHT_H
#define PAGS_LIGHT_H

#include <pags/base.h>
#include <pags/camera.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_LIGHT_RINGS = 4, PAGS_LIGHT_PIECES = 6 };

typedef struct pags_light {
  /* A value is first multiplied by a factor that depends on the squared distance q from the principal point, which is 1
   * at the corner (0, 0) of the picture: straight pieces through 1 + vignette[i] at q = i / 3, and on beyond the last.
   */
  double vignette[PAGS_LIGHT_RINGS];
  /* Then it goes through a curve of straight pieces from (0, 0) to (1, 1), which rises: at (i + 1) / 6 it is higher
   * than that by response[i]. Values outside of 0..1 stay as they are. */
  double response[PAGS_LIGHT_PIECES - 1];
} pags_light;

/* Whether there is no vignette and the curve is straight: all numbers are 0. */
PAGS_API int pags_light_is_plain(const pags_light *light);
/* Whether the curve rises and its numbers are finite. */
PAGS_API int pags_light_is_sound(const pags_light *light);

/* By what factor a difference between two values can grow at most in a picture of `camera`. */
PAGS_API double pags_light_most(const pags_light *light, const pags_camera *camera);

/* The squared distance q of the image position (x, y), pixels. */
static inline double pags_light_distance(const pags_camera *camera, double x, double y) {
  const double u = x - camera->cx, v = y - camera->cy;
  return (u * u + v * v) / (camera->cx * camera->cx + camera->cy * camera->cy);
}

/* The curve's value at i / 6, i from 0 to 6. */
PAGS_API double pags_light_knot(const pags_light *light, int i);
/* The factor of the vignette at the squared distance `q`, at least 0.01. */
PAGS_API double pags_light_vignette(const pags_light *light, double q);
/* The curve's value at `value`; *slope (may be NULL): its derivative there. */
PAGS_API double pags_light_response(const pags_light *light, double value, double *slope);

#ifdef __cplusplus
}
#endif
#endif
