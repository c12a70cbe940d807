/* SPDX-License-Identifier: Apache-2.0 */
/* Objects: maps the class names of data sets to categories, and to names in files. object_motion.c decides whether a
 * labelled track moves, object_pose.c computes an object's pose at a time. */
#include "scene/object.h"

#include <assert.h>
#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Categories ---- */

const char *pags_category_name(pags_category category) {
  static const char *const names[] = {"other", "vehicle", "pedestrian", "cyclist"};
  assert((unsigned)category < sizeof names / sizeof *names);
  return names[category];
}

/* Class names as the data sets' documents list them, in the form that normalise gives: lower case, each run of other
 * characters than letters and digits replaced by one blank. */
static const char *const vehicles[] = {
    /* Waymo, nuPlan; KITTI */
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
    "message board trailer", "traffic light trailer", "railed vehicle"};

static const char *const pedestrians[] = {"pedestrian",
                                          "type pedestrian",
                                          "person",
                                          "person sitting",
                                          "wheelchair",
                                          "stroller",
                                          "pedestrian with object",
                                          "official signaler",
                                          "walker"};

static const char *const cyclists[] = {"cyclist",
                                       "type cyclist",
                                       "bicycle",
                                       "motorcycle",
                                       "motorized scooter",
                                       "personal mobility device",
                                       "other vehicle pedicab",
                                       "bicyclist",
                                       "motorcyclist",
                                       "motorbike",
                                       "bike",
                                       "wheeled rider",
                                       "wheeled device",
                                       "rider",
                                       "vehicle bicycle",
                                       "vehicle motorcycle"};

enum { NAME_LENGTH = 64 };

/* Brings a class name into the form of the lists above, cut to 63 characters. */
static void normalise(const char *name, char out[NAME_LENGTH]) {
  size_t length = 0;
  for (; *name && length < NAME_LENGTH - 1; name++) {
    unsigned char c = (unsigned char)*name;
    if (isalnum(c))
      out[length++] = (char)tolower(c);
    else if (length > 0 && out[length - 1] != ' ')
      out[length++] = ' ';
  }
  while (length > 0 && out[length - 1] == ' ')
    length--;
  out[length] = '\0';
}

static bool is_listed(const char *name, const char *const *list, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (strcmp(name, list[i]) == 0)
      return true;
  return false;
}

static bool begins(const char *name, const char *prefix) {
  return strncmp(name, prefix, strlen(prefix)) == 0;
}

#define LISTED(name, list) is_listed(name, list, sizeof(list) / sizeof *(list))

pags_category pags_category_of(const char *class_name) {
  char name[NAME_LENGTH];
  normalise(class_name, name);
  if (LISTED(name, cyclists))
    return PAGS_CATEGORY_CYCLIST;
  if (LISTED(name, pedestrians) || begins(name, "human pedestrian") || begins(name, "walker "))
    return PAGS_CATEGORY_PEDESTRIAN;
  if (LISTED(name, vehicles) || begins(name, "vehicle "))
    return PAGS_CATEGORY_VEHICLE;
  return PAGS_CATEGORY_OTHER;
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
