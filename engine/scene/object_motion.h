/* SPDX-License-Identifier: Apache-2.0 */
/* Tells the motion of a labelled track from errors of its labels. */
#ifndef PAGS_SCENE_OBJECT_MOTION_H
#define PAGS_SCENE_OBJECT_MOTION_H

#include <stdbool.h>

#include <pags/object.h>

/* Whether a track would be that of an object that moves by how far its labels are apart, but these are six or more and
 * lie about one place. */
bool pags_object_jitters(const pags_object *object);

#endif
