/* SPDX-License-Identifier: Apache-2.0 */
/* Objects: the motion of their tracks, and their names in files. */
#ifndef PAGS_SCENE_OBJECT_H
#define PAGS_SCENE_OBJECT_H

#include <stdbool.h>
#include <stdint.h>

#include <pags/object.h>

/* Whether a track has six labels or more, with the distances of a moving object, that nevertheless scatter about one
 * place. */
bool pags_object_jitters(const pags_object *object);

enum { PAGS_OBJECT_NAME = 96 }; /* room for a name and for what files add to it */

/* The names of objects in files for other programs and of pictures. Lower-case letters, digits and '_': "Pedestrian
 * with Object" becomes "pedestrian_with_object". */
void pags_class_plain_name(const char *class_name, char out[PAGS_OBJECT_NAME]);
/* The plain name of the class and the object's number in its scene. */
void pags_object_plain_name(const char *class_name, int64_t number, char out[PAGS_OBJECT_NAME]);

#endif
