/* SPDX-License-Identifier: Apache-2.0 */
/* The names of objects in files for other programs, and beside pictures: class and number, "car_0007". */
#ifndef PAGS_SCENE_OBJECT_NAME_H
#define PAGS_SCENE_OBJECT_NAME_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_OBJECT_NAME = 96 }; /* room for a name and for what files add to it */

/* Lower-case letters, digits and '_': "Pedestrian with Object" becomes "pedestrian_with_object". */
void pags_class_plain_name(const char *class_name, char out[PAGS_OBJECT_NAME]);
/* The plain name of the class and the object's number in its scene. */
void pags_object_plain_name(const char *class_name, int64_t number, char out[PAGS_OBJECT_NAME]);

#ifdef __cplusplus
}
#endif
#endif
