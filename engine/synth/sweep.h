/* SPDX-License-Identifier: Apache-2.0 */
/* The LiDAR of the synthetic street, by the ray tracer that also draws its pictures. */
#ifndef PAGS_SYNTH_SWEEP_H
#define PAGS_SYNTH_SWEEP_H

#include "synth/stage.h"
#include "synth/street.h"

/* Traces one sweep of the LiDAR with objects where the stage has them. Writes 4 floats a point (x, y, z in the ego
 * frame, metres; intensity 0..1) to `points`, which has room for street->options->lidar_points points, and returns
 * the number of points. */
int64_t pags_sweep_trace(const pags_street *street, const pags_stage *stage, int frame, pags_tasks *tasks,
                         float *points);

#endif
