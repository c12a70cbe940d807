/* SPDX-License-Identifier: Apache-2.0 */
/* The classes of the label images of known data sets.
 *
 * Sources: Cityscapes' labels.py (mcordts/cityscapesScripts: train ids and ids), KITTI-360's labels.py
 * (autonomousvision/kitti360Scripts: Cityscapes' ids and some additional ones), KITTI-STEP (Cityscapes' train ids),
 * Waymo's camera_segmentation.proto, PandaSet's classes.json (the class names of its cuboids are the same). Ids follow
 * each other. */
#include "dataset/driving/label_sets.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

static const char train_ids[] =
    "road, sidewalk, building, wall, fence, pole, traffic light, traffic sign, vegetation, terrain, sky, person, "
    "rider, car, truck, bus, train, motorcycle, bicycle";

/* Cityscapes' ids are 0 to 33; ids from 34 on are KITTI-360's. */
static const char ids[] =
    "unlabeled, ego vehicle, rectification border, out of roi, static, dynamic, ground, road, sidewalk, parking, rail "
    "track, building, wall, fence, guard rail, bridge, tunnel, pole, polegroup, traffic light, traffic sign, "
    "vegetation, terrain, sky, person, rider, car, truck, bus, caravan, trailer, train, motorcycle, bicycle, garage, "
    "gate, stop, smallpole, lamp, trash bin, vending machine, box, unknown construction, unknown vehicle, unknown "
    "object";

/* "pedestrian object" is something that a pedestrian carries or pushes. */
static const char waymo[] =
    "undefined, ego vehicle, car, truck, bus, other large vehicle, bicycle, motorcycle, trailer, pedestrian, cyclist, "
    "motorcyclist, bird, ground animal, construction cone pole, pole, pedestrian object, sign, traffic light, "
    "building, road, lane marker, road marker, sidewalk, vegetation, sky, ground, dynamic, static";

static const char pandaset[] =
    "Smoke, Exhaust, Spray or rain, Reflection, Vegetation, Ground, Road, Lane Line Marking, Stop Line Marking, Other "
    "Road Marking, Sidewalk, Driveway, Car, Pickup Truck, Medium-sized Truck, Semi-truck, Towed Object, Motorcycle, "
    "Other Vehicle - Construction Vehicle, Other Vehicle - Uncommon, Other Vehicle - Pedicab, Emergency Vehicle, Bus, "
    "Personal Mobility Device, Motorized Scooter, Bicycle, Train, Trolley, Tram / Subway, Pedestrian, Pedestrian with "
    "Object, Animals - Bird, Animals - Other, Pylons, Road Barriers, Signs, Cones, Construction Signs, Temporary "
    "Construction Barriers, Rolling Containers, Building, Other Static Object";

const pags_label_set pags_label_sets[PAGS_LABEL_SETS] = {
    {"cityscapes", 0, 19, train_ids}, {"step", 0, 19, train_ids}, {"cityscapes-ids", 0, 34, ids},
    {"kitti-360", 0, 45, ids},        {"waymo", 0, 29, waymo},    {"pandaset", 1, 42, pandaset}};

const pags_label_set *pags_label_set_find(const char *name) {
  size_t length = strcspn(name, " ");
  for (int i = 0; i < PAGS_LABEL_SETS; i++)
    if (strlen(pags_label_sets[i].name) == length && strncmp(name, pags_label_sets[i].name, length) == 0)
      return &pags_label_sets[i];
  return NULL;
}

/* Returns the next letter or digit of a name in lower case and moves on; one blank for any run of other characters
 * between words; 0 at the end. */
static int next_letter(const char **at) {
  bool gap = false;
  for (; **at && !isalnum((unsigned char)**at); ++*at)
    gap = true;
  if (**at && gap)
    return ' ';
  return **at ? tolower((unsigned char)*(*at)++) : 0;
}

bool pags_same_word(const char *a, const char *b) {
  for (;;) {
    int left = next_letter(&a), right = next_letter(&b);
    if (left != right)
      return false;
    if (left == 0)
      return true;
  }
}

const char *pags_label_name(const pags_label_set *set, int id, char out[PAGS_LABEL_NAME]) {
  const char *at = set->names;
  for (int i = set->first; i < id; i++)
    at += strcspn(at, ",") + 2;
  snprintf(out, PAGS_LABEL_NAME, "%.*s", (int)strcspn(at, ","), at);
  return out;
}

int pags_label_class_named(const pags_label_set *set, const char *name) {
  char known[PAGS_LABEL_NAME];
  for (int id = set->first; id < set->first + set->count; id++)
    if (pags_same_word(pags_label_name(set, id, known), name))
      return id;
  return -1;
}

bool pags_label_set_has(const pags_label_set *set, int64_t id) {
  return id >= set->first && id < set->first + set->count;
}

pags_category pags_label_category(const pags_label_set *set, int id) {
  char name[PAGS_LABEL_NAME];
  pags_label_name(set, id, name);
  if (strcmp(name, "unknown vehicle") == 0 || strcmp(name, "other large vehicle") == 0)
    return PAGS_CATEGORY_VEHICLE;
  return strcmp(name, "pedestrian object") == 0 ? PAGS_CATEGORY_PEDESTRIAN : pags_category_of(name);
}
