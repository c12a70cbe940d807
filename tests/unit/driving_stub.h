/* SPDX-License-Identifier: Apache-2.0 */
/* A data set in memory that replaces the dataset reader: eight time steps of one camera and a LiDAR in a world whose
 * geometry and colours are known exactly. It defines the functions of pags/dataset.h that the start of a training
 * calls.
 *
 * World z up, metres, origin (1000, 2000, 0). The camera stands 1.5 m high, looks along +x and drives 0.5 m a step.
 * Road z = 0; a wall at x = 30 from the origin, 9 m high, sky above; a car that drives along +y at x = 12, which the
 * LiDAR sees; a crate parked at (15, 6); a pedestrian at x = 9 that the LiDAR never sees; a second car behind the
 * camera. At step 4, which is held out, the photograph is magenta all over and the sweep lies 5 m above the road. */
#ifndef PAGS_TEST_DRIVING_STUB_H
#define PAGS_TEST_DRIVING_STUB_H

#include <pags/dataset.h>

enum { STUB_STEPS = 8, STUB_HELD_OUT = 4, STUB_WIDTH = 160, STUB_HEIGHT = 96 };
enum { STUB_CAR, STUB_CRATE, STUB_WALKER, STUB_BEHIND, STUB_OBJECTS };

extern const uint8_t stub_road[3], stub_wall[3], stub_sky[3], stub_magenta[3];
extern const uint8_t stub_colours[STUB_OBJECTS][3];

pags_dataset *stub_open(void);
void stub_close(pags_dataset *dataset);

/* Traces a ray at a time step: returns the distance in units of the direction's length (camera z if the direction has
 * camera z 1), or infinity for sky. `skip`: bit i leaves out object i. */
double stub_trace(const pags_dataset *dataset, int step, const double from[3], const double direction[3], int skip,
                  int *object, const uint8_t **colour);

/* Camera z of the first surface seen through the pixel position (u, v). */
double stub_depth(const pags_dataset *dataset, int step, double u, double v, int skip);

#endif
