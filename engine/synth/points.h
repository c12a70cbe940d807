/* SPDX-License-Identifier: Apache-2.0 */
/* Surface points as structure from motion would find them: seen from the cameras, with their colours. */
#ifndef PAGS_SYNTH_POINTS_H
#define PAGS_SYNTH_POINTS_H

#include <pags/synth.h>

#include "synth/tracer.h"

/* Writes a binary PLY of options->points vertices (x y z float, red green blue uchar). */
pags_result pags_points_write(const char *path, const pags_tracer *tracer, const pags_room *room,
                              const pags_synth_options *options);

#endif
