/* SPDX-License-Identifier: Apache-2.0 */
/* The classes of the label images of known data sets.
 *
 * Sources: Cityscapes' labels.py (mcordts/cityscapesScripts: train ids and ids), KITTI-360's labels.py
 * (autonomousvision/kitti360Scripts: Cityscapes' ids and some additional ones), KITTI-STEP (Cityscapes' train ids),
 * Waymo's camera_segmentation.proto, PandaSet's classes.json (the class names of its cuboids are the same). A
 * two-wheeler has the category cyclist, like its rider, as in pags_category_of. */
#include "dataset/driving/label_sets.h"

#include <ctype.h>
#include <string.h>

#define O PAGS_CATEGORY_OTHER
#define V PAGS_CATEGORY_VEHICLE
#define P PAGS_CATEGORY_PEDESTRIAN
#define C PAGS_CATEGORY_CYCLIST

static const pags_label_class train_ids[] = {
    {0, O, "road"}, {1, O, "sidewalk"},      {2, O, "building"},     {3, O, "wall"},       {4, O, "fence"},
    {5, O, "pole"}, {6, O, "traffic light"}, {7, O, "traffic sign"}, {8, O, "vegetation"}, {9, O, "terrain"},
    {10, O, "sky"}, {11, P, "person"},       {12, C, "rider"},       {13, V, "car"},       {14, V, "truck"},
    {15, V, "bus"}, {16, V, "train"},        {17, C, "motorcycle"},  {18, C, "bicycle"}};

/* Cityscapes' ids are 0 to 33; ids from 34 on are KITTI-360's. */
static const pags_label_class ids[] = {{0, O, "unlabeled"},
                                       {1, O, "ego vehicle"},
                                       {2, O, "rectification border"},
                                       {3, O, "out of roi"},
                                       {4, O, "static"},
                                       {5, O, "dynamic"},
                                       {6, O, "ground"},
                                       {7, O, "road"},
                                       {8, O, "sidewalk"},
                                       {9, O, "parking"},
                                       {10, O, "rail track"},
                                       {11, O, "building"},
                                       {12, O, "wall"},
                                       {13, O, "fence"},
                                       {14, O, "guard rail"},
                                       {15, O, "bridge"},
                                       {16, O, "tunnel"},
                                       {17, O, "pole"},
                                       {18, O, "polegroup"},
                                       {19, O, "traffic light"},
                                       {20, O, "traffic sign"},
                                       {21, O, "vegetation"},
                                       {22, O, "terrain"},
                                       {23, O, "sky"},
                                       {24, P, "person"},
                                       {25, C, "rider"},
                                       {26, V, "car"},
                                       {27, V, "truck"},
                                       {28, V, "bus"},
                                       {29, V, "caravan"},
                                       {30, V, "trailer"},
                                       {31, V, "train"},
                                       {32, C, "motorcycle"},
                                       {33, C, "bicycle"},
                                       {34, O, "garage"},
                                       {35, O, "gate"},
                                       {36, O, "stop"},
                                       {37, O, "smallpole"},
                                       {38, O, "lamp"},
                                       {39, O, "trash bin"},
                                       {40, O, "vending machine"},
                                       {41, O, "box"},
                                       {42, O, "unknown construction"},
                                       {43, V, "unknown vehicle"},
                                       {44, O, "unknown object"}};

/* "pedestrian object" is something that a pedestrian carries or pushes. */
static const pags_label_class waymo[] = {{0, O, "undefined"},
                                         {1, O, "ego vehicle"},
                                         {2, V, "car"},
                                         {3, V, "truck"},
                                         {4, V, "bus"},
                                         {5, V, "other large vehicle"},
                                         {6, C, "bicycle"},
                                         {7, C, "motorcycle"},
                                         {8, V, "trailer"},
                                         {9, P, "pedestrian"},
                                         {10, C, "cyclist"},
                                         {11, C, "motorcyclist"},
                                         {12, O, "bird"},
                                         {13, O, "ground animal"},
                                         {14, O, "construction cone pole"},
                                         {15, O, "pole"},
                                         {16, P, "pedestrian object"},
                                         {17, O, "sign"},
                                         {18, O, "traffic light"},
                                         {19, O, "building"},
                                         {20, O, "road"},
                                         {21, O, "lane marker"},
                                         {22, O, "road marker"},
                                         {23, O, "sidewalk"},
                                         {24, O, "vegetation"},
                                         {25, O, "sky"},
                                         {26, O, "ground"},
                                         {27, O, "dynamic"},
                                         {28, O, "static"}};

static const pags_label_class pandaset[] = {{1, O, "Smoke"},
                                            {2, O, "Exhaust"},
                                            {3, O, "Spray or rain"},
                                            {4, O, "Reflection"},
                                            {5, O, "Vegetation"},
                                            {6, O, "Ground"},
                                            {7, O, "Road"},
                                            {8, O, "Lane Line Marking"},
                                            {9, O, "Stop Line Marking"},
                                            {10, O, "Other Road Marking"},
                                            {11, O, "Sidewalk"},
                                            {12, O, "Driveway"},
                                            {13, V, "Car"},
                                            {14, V, "Pickup Truck"},
                                            {15, V, "Medium-sized Truck"},
                                            {16, V, "Semi-truck"},
                                            {17, V, "Towed Object"},
                                            {18, C, "Motorcycle"},
                                            {19, V, "Other Vehicle - Construction Vehicle"},
                                            {20, V, "Other Vehicle - Uncommon"},
                                            {21, C, "Other Vehicle - Pedicab"},
                                            {22, V, "Emergency Vehicle"},
                                            {23, V, "Bus"},
                                            {24, C, "Personal Mobility Device"},
                                            {25, C, "Motorized Scooter"},
                                            {26, C, "Bicycle"},
                                            {27, V, "Train"},
                                            {28, V, "Trolley"},
                                            {29, V, "Tram / Subway"},
                                            {30, P, "Pedestrian"},
                                            {31, P, "Pedestrian with Object"},
                                            {32, O, "Animals - Bird"},
                                            {33, O, "Animals - Other"},
                                            {34, O, "Pylons"},
                                            {35, O, "Road Barriers"},
                                            {36, O, "Signs"},
                                            {37, O, "Cones"},
                                            {38, O, "Construction Signs"},
                                            {39, O, "Temporary Construction Barriers"},
                                            {40, O, "Rolling Containers"},
                                            {41, O, "Building"},
                                            {42, O, "Other Static Object"}};

#define LENGTH(list) ((int)(sizeof(list) / sizeof *(list)))
enum { CITYSCAPES_IDS = 34 };

const pags_label_set pags_label_sets[PAGS_LABEL_SETS] = {{"cityscapes", LENGTH(train_ids), train_ids},
                                                         {"step", LENGTH(train_ids), train_ids},
                                                         {"cityscapes-ids", CITYSCAPES_IDS, ids},
                                                         {"kitti-360", LENGTH(ids), ids},
                                                         {"waymo", LENGTH(waymo), waymo},
                                                         {"pandaset", LENGTH(pandaset), pandaset}};

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

const pags_label_class *pags_label_class_named(const pags_label_set *set, const char *name) {
  for (int i = 0; i < set->count; i++)
    if (pags_same_word(set->classes[i].name, name))
      return &set->classes[i];
  return NULL;
}

const pags_label_class *pags_label_class_numbered(const pags_label_set *set, int64_t id) {
  for (int i = 0; i < set->count; i++)
    if (set->classes[i].id == id)
      return &set->classes[i];
  return NULL;
}
