/* SPDX-License-Identifier: Apache-2.0 */
/* pags render --shutter: whether pictures are read line by line. */
#ifndef PAGS_CLI_SHUTTER_H
#define PAGS_CLI_SHUTTER_H

#include "cli/draw/viewpoints.h"

/* An index in the option's choices; AS_RECORDED without it: rolling where a camera says so. */
typedef enum pags_shutter_choice {
  PAGS_SHUTTER_AS_RECORDED = -1,
  PAGS_SHUTTER_GLOBAL,
  PAGS_SHUTTER_ROLLING
} pags_shutter_choice;

/* Sets the cameras' shutters as chosen. ROLLING: if none of them has one, they get the read-out of the scene's first
 * view that has one, and their velocities along the path. PAGS_ERROR_ARGUMENT if there is none, or no time between the
 * cameras. */
pags_result pags_shutter_choose(pags_shutter_choice choice, const pags_scene *scene, pags_viewpoints *viewpoints);

#endif
