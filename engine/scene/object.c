/* SPDX-License-Identifier: Apache-2.0 */
/* Objects: maps the class names of data sets to categories, and to names in files. object_motion.c decides whether a
 * labelled track moves, object_pose.c computes an object's pose at a time. */
#include "scene/object.h"

#include <assert.h>
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"

/* ---- Categories ---- */

const char *pags_category_name(pags_category category) {
  static const char *const names[] = {"other", "vehicle", "pedestrian", "cyclist"};
  assert((unsigned)category < sizeof names / sizeof *names);
  return names[category];
}

/* Class names as the data sets' documents list them, in lower case, each run of other characters than letters and
 * digits replaced by one blank; NULL: the next category. */
static const char *const class_names[] = {
    /* Vehicles. Waymo, nuPlan; KITTI */
    "vehicle", "type vehicle", "car", "van", "truck", "tram",
    /* PandaSet */
    "pickup truck", "medium sized truck", "semi truck", "towed object", "other vehicle",
    "other vehicle construction vehicle", "other vehicle uncommon", "emergency vehicle", "bus", "train", "trolley",
    "tram subway",
    /* nuScenes: most have the prefix "vehicle", which pags_category_of tests; these are of its detection task */
    "construction vehicle", "trailer",
    /* DGP; other programs */
    "bus rv caravan", "caravan", "automobile", "suv", "pickup", "minivan", "minibus", "lorry",
    /* Argoverse 2 */
    "regular vehicle", "large vehicle", "box truck", "truck cab", "vehicular trailer", "school bus", "articulated bus",
    "message board trailer", "traffic light trailer", "railed vehicle", NULL,
    /* Pedestrians */
    "pedestrian", "type pedestrian", "person", "person sitting", "wheelchair", "stroller", "pedestrian with object",
    "official signaler", "walker", NULL,
    /* Cyclists */
    "cyclist", "type cyclist", "bicycle", "motorcycle", "motorized scooter", "personal mobility device",
    "other vehicle pedicab", "bicyclist", "motorcyclist", "motorbike", "bike", "wheeled rider", "wheeled device",
    "rider", "vehicle bicycle", "vehicle motorcycle"};

pags_category pags_category_of(const char *class_name) {
  enum { NAME_LENGTH = 64, CLASSES = sizeof class_names / sizeof *class_names };
  char name[NAME_LENGTH]; /* in the form of the list, cut to 63 characters */
  size_t length = 0;
  for (const char *c = class_name; *c && length < NAME_LENGTH - 1; c++) {
    if (isalnum((unsigned char)*c))
      name[length++] = (char)tolower((unsigned char)*c);
    else if (length > 0 && name[length - 1] != ' ')
      name[length++] = ' ';
  }
  while (length > 0 && name[length - 1] == ' ')
    length--;
  name[length] = '\0';

  pags_category category = PAGS_CATEGORY_VEHICLE;
  for (int i = 0; i < CLASSES; i++)
    if (!class_names[i])
      category++;
    else if (strcmp(name, class_names[i]) == 0)
      return category;
  return pags_text_starts(name, "human pedestrian") || pags_text_starts(name, "walker ") ? PAGS_CATEGORY_PEDESTRIAN
         : pags_text_starts(name, "vehicle ")                                            ? PAGS_CATEGORY_VEHICLE
                                                                                         : PAGS_CATEGORY_OTHER;
}

/* ---- Tracks ---- */

void pags_object_destroy(pags_object *object) {
  free(object->id);
  free(object->class_name);
  free(object->keyframes);
  memset(object, 0, sizeof *object);
}

const pags_keyframe *pags_object_keyframe(const pags_object *object, int64_t frame) {
  for (int64_t i = 0; i < object->keyframe_count; i++)
    if (object->keyframes[i].frame == frame)
      return &object->keyframes[i];
  return NULL;
}

/* ---- Names in files ---- */

void pags_class_plain_name(const char *class_name, char out[PAGS_OBJECT_NAME]) {
  size_t i = 0;
  for (; class_name[i] && i + 16 < PAGS_OBJECT_NAME; i++) {
    const char c = class_name[i];
    out[i] = c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ? c : '_';
  }
  out[i] = 0;
}

void pags_object_plain_name(const char *class_name, int64_t number, char out[PAGS_OBJECT_NAME]) {
  char plain[PAGS_OBJECT_NAME];
  pags_class_plain_name(class_name, plain);
  snprintf(out, PAGS_OBJECT_NAME, "%.60s_%04lld", plain, (long long)number);
}
