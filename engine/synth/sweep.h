/* SPDX-License-Identifier: Apache-2.0 */
/* LiDAR of the street by the same ray tracer. */
#ifndef PAGS_SYNTH_SWEEP_H
#define PAGS_SYNTH_SWEEP_H

#include "synth/stage.h"
#include "synth/street.h"

/* One turn of the LiDAR at the stage's time: 4 floats a point (x y z in the ego frame, metres; intensity 0..1), in
 * `points`, which has room for street->options->lidar_points of them. Returns how many. */
int64_t pags_sweep_trace(const pags_street *street, const pags_stage *stage, int frame, pags_tasks *tasks,
                         float *points);

#endif
