/* What the laser of a recording measured, where the data set of a scene is at hand. */
#ifndef PAGS_EXPORTERS_LASER_H
#define PAGS_EXPORTERS_LASER_H

#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_laser {
  int64_t count;
  float *points; /* 3 each, metres, relative to the scene's origin */
} pags_laser;

/* The points of all sweeps but those of held-out time steps, outside of labelled boxes. None where there is no data set, or no laser, or where
 * it can't be read (a line in the log). */
pags_result pags_laser_read(const pags_scene *scene, pags_laser *out);
void pags_laser_destroy(pags_laser *laser); /* frees and zeroes */

#ifdef __cplusplus
}
#endif
#endif
