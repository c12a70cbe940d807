/* SPDX-License-Identifier: Apache-2.0 */
/* Decides which classes of label images, which boxes and which dynamic masks count as critical, and writes the notes
 * that say so (masks.h).
 *
 * A word of --critical is a kind (vehicle, pedestrian, cyclist), a class of the label images by name or number, or
 * the class of boxes. A class of label images also makes the boxes of the same class critical or, if no box has that
 * class, all boxes of its kind; such boxes are drawn only in views without label images. A class that only boxes have
 * is drawn from the boxes in every view. Dynamic masks distinguish only vehicles and people; they are used if a kind,
 * or a class of label images of that kind, is named. */
#include "dataset/driving/masks.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

enum { CATEGORIES = PAGS_CATEGORY_CYCLIST + 1 };

bool pags_labels_know_sky(const pags_driving *driving) {
  return pags_label_class_named(driving->rules.labels, "sky") >= 0;
}

/* ---- Kinds, classes and boxes ---- */

/* Returns the kind that a word names, in singular or plural; PAGS_CATEGORY_OTHER if it names none. */
static pags_category kind_of(const char *word) {
  static const char *const many[] = {"", "vehicles", "pedestrians", "cyclists"};
  for (int c = PAGS_CATEGORY_VEHICLE; c < CATEGORIES; c++)
    if (pags_same_word(word, pags_category_name((pags_category)c)) || pags_same_word(word, many[c]))
      return (pags_category)c;
  return PAGS_CATEGORY_OTHER;
}

static void take_boxes_of_kind(pags_driving *driving, pags_category category) {
  for (int64_t i = 0; i < driving->object_count; i++)
    if (driving->objects[i].category == category && !driving->critical.objects[i])
      driving->critical.objects[i] = PAGS_CRITICAL_WITHOUT_LABELS;
}

/* Marks all classes and boxes of a kind as critical. */
static void take_kind(pags_driving *driving, pags_category category) {
  const pags_label_set *set = driving->rules.labels;
  driving->critical.kinds[category] = true;
  for (int i = 0; i < set->count; i++)
    if (pags_label_category(set, set->first + i) == category)
      driving->critical.classes[set->first + i] |= PAGS_LABEL_CRITICAL;
  take_boxes_of_kind(driving, category);
}

/* Marks the objects whose class is `name` as critical, in the manner `how` (PAGS_CRITICAL_*); returns how many there
 * are. */
static int64_t take_boxes(pags_driving *driving, const char *name, int how) {
  int64_t count = 0;
  for (int64_t i = 0; i < driving->object_count; i++) {
    uint8_t *to = &driving->critical.objects[i];
    if (!pags_same_word(driving->objects[i].class_name, name))
      continue;
    *to = *to > how ? *to : (uint8_t)how;
    count++;
  }
  return count;
}

/* ---- Reading the list ---- */

/* A text of words with separators, appended to a buffer of fixed size. */
typedef struct phrase {
  char *text;
  size_t size, used;
} phrase;

static void add_word(phrase *to, const char *separator, const char *word) {
  if (to->used >= to->size)
    return;
  int length = snprintf(to->text + to->used, to->size - to->used, "%s%s", to->used ? separator : "", word);
  to->used += length > 0 ? (size_t)length : 0;
}

static pags_result unknown_word(const pags_driving *driving, const char *word) {
  char classes[1500] = "", boxes[600] = "";
  const pags_label_set *set = driving->rules.labels;
  phrase known = {classes, sizeof classes, 0}, named = {boxes, sizeof boxes, 0};
  for (int i = 0; i < set->count; i++) {
    char text[80], name[PAGS_LABEL_NAME];
    snprintf(text, sizeof text, "%d %s", set->first + i, pags_label_name(set, set->first + i, name));
    add_word(&known, ", ", text);
  }

  /* List each class of boxes once. */
  for (int64_t i = 0; i < driving->object_count; i++) {
    bool seen = false;
    for (int64_t j = 0; j < i && !seen; j++)
      seen = pags_same_word(driving->objects[i].class_name, driving->objects[j].class_name);
    if (!seen)
      add_word(&named, ", ", driving->objects[i].class_name);
  }

  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "critical '%s' is not known; expected vehicle, pedestrian, cyclist, or a class of %s labels by name "
                   "or number (%s)%s%s",
                   word, set->name, classes, *boxes ? ", or the class of boxes: " : "", boxes);
}

/* Splits the list at its commas, strips blanks around the words, and marks what each word names as critical. */
static pags_result take_list(pags_driving *driving, const char *list) {
  PAGS_AUTOFREE char *copy = pags_text_copy(list);
  driving->critical.list = pags_text_copy(list);
  PAGS_CHECK_MEMORY(copy && driving->critical.list, "%s", driving->root);
  for (char *word = copy, *next; word; word = next) {
    next = strchr(word, ',');
    if (next)
      *next++ = '\0';
    while (*word == ' ')
      word++;
    for (size_t length = strlen(word); length > 0 && word[length - 1] == ' '; length--)
      word[length - 1] = '\0';

    /* A word that is a number is the id of a class. A kind takes precedence over a class, a class over boxes. */
    const pags_label_set *set = driving->rules.labels;
    char *end;
    long number = strtol(word, &end, 10);
    const int id =
        *word && !*end ? (pags_label_set_has(set, number) ? (int)number : -1) : pags_label_class_named(set, word);
    const pags_category kind = kind_of(word);
    if (kind != PAGS_CATEGORY_OTHER) {
      take_kind(driving, kind);
    } else if (id >= 0) {
      const pags_category category = pags_label_category(set, id);
      driving->critical.classes[id] |= PAGS_LABEL_CRITICAL;
      driving->critical.kinds[category] = true;
      char name[PAGS_LABEL_NAME];
      if (take_boxes(driving, pags_label_name(set, id, name), PAGS_CRITICAL_WITHOUT_LABELS) == 0 &&
          category != PAGS_CATEGORY_OTHER)
        take_boxes_of_kind(driving, category);
    } else if (!*word || take_boxes(driving, word, PAGS_CRITICAL_ALWAYS) == 0) {
      return unknown_word(driving, word);
    }
  }
  return PAGS_OK;
}

pags_result pags_critical_choose(pags_driving *driving, const char *list, pags_parsed_dataset *parsed) {
  driving->critical.objects = calloc((size_t)driving->object_count + 1, 1);
  PAGS_CHECK_MEMORY(driving->critical.objects, "%s", driving->root);

  /* Bits of each class of the label images that don't depend on the list: sky, a class of things that can move, or no
   * class. */
  const pags_label_set *set = driving->rules.labels;
  const int sky = pags_label_class_named(set, "sky");
  for (int id = 0; id < 256; id++)
    driving->critical.classes[id] = !pags_label_set_has(set, id) ? (sky >= 0 ? PAGS_LABEL_SKY_UNKNOWN : 0)
                                    : id == sky                  ? PAGS_LABEL_SKY
                                    : pags_label_category(set, id) == PAGS_CATEGORY_OTHER ? 0
                                                                                          : PAGS_LABEL_MOVING;

  if (list)
    PAGS_TRY(take_list(driving, list));
  else
    for (int c = PAGS_CATEGORY_VEHICLE; c < CATEGORIES; c++)
      take_kind(driving, (pags_category)c);

  /* If both vehicles and people are critical, dynamic_masks/all is used; if only one of them is, the folder of that
   * one. */
  const bool *kinds = driving->critical.kinds;
  bool vehicle = kinds[PAGS_CATEGORY_VEHICLE], human = kinds[PAGS_CATEGORY_PEDESTRIAN] || kinds[PAGS_CATEGORY_CYCLIST];
  driving->critical.all_dynamic = vehicle && human;
  for (int64_t i = 0; i < parsed->count && vehicle != human; i++) {
    pags_parsed_view *view = &parsed->views[i];
    if (!view->missing)
      PAGS_TRY(pags_driving_find_mask(driving, vehicle ? "dynamic_masks/vehicle" : "dynamic_masks/human", view,
                                      &view->part_path));
  }
  return PAGS_OK;
}

/* ---- Notes ---- */

typedef struct tally {
  int64_t views, sky, semantic, dynamic;
  int64_t critical[8]; /* number of views by the sources of their critical pixels (bits FROM_*) */
} tally;

enum { FROM_LABELS = 4, FROM_DYNAMIC = 2, FROM_BOXES = 1 };

static tally count_views(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  tally t = {0};
  int box = PAGS_CRITICAL_NOT; /* the most critical one */
  bool label = false;          /* some class of label images is critical */
  for (int64_t i = 0; i < driving->object_count; i++)
    box = driving->critical.objects[i] > box ? driving->critical.objects[i] : box;
  for (int i = 0; i < 256; i++)
    label = label || driving->critical.classes[i] & PAGS_LABEL_CRITICAL;
  for (int64_t i = 0; i < parsed->count; i++) {
    const pags_parsed_view *view = &parsed->views[i];
    if (view->missing)
      continue;
    bool dynamic = view->part_path || (view->dynamic_path && driving->critical.all_dynamic);
    t.views++;
    t.sky += view->sky_path != NULL;
    t.semantic += view->semantic_path != NULL;
    t.dynamic += view->dynamic_path != NULL;
    const bool boxes = box > (view->semantic_path ? PAGS_CRITICAL_WITHOUT_LABELS : PAGS_CRITICAL_NOT);
    t.critical[(view->semantic_path && label ? FROM_LABELS : 0) | (dynamic ? FROM_DYNAMIC : 0) |
               (boxes ? FROM_BOXES : 0)]++;
  }
  return t;
}

pags_result pags_critical_note(pags_driving *driving, const pags_parsed_dataset *parsed) {
  const tally t = count_views(driving, parsed);
  bool lidar = driving->provides & PAGS_PROVIDES_LIDAR;
  PAGS_TRY(pags_driving_note(driving, "masks: of %lld views %lld have sky_masks, %lld semantic, %lld dynamic_masks",
                             (long long)t.views, (long long)t.sky, (long long)t.semantic, (long long)t.dynamic));
  PAGS_TRY(pags_driving_note(driving, "sky: %s",
                             t.sky > 0                                         ? "from sky_masks"
                             : t.semantic > 0 && pags_labels_know_sky(driving) ? "from semantic, class sky"
                             : lidar ? "guessed: above the horizon and above all that LiDAR met"
                                     : "unknown (neither masks nor LiDAR)"));

  /* The text has the form "semantic and dynamic_masks in 200 of 240 views, boxes in 40 of 240 views". */
  char text[300] = "", classes[500] = "", count[64];
  phrase sources = {text, sizeof text, 0}, names = {classes, sizeof classes, 0};
  static const char *const from_names[] = {"unknown (neither masks nor boxes)",
                                           "boxes",
                                           "dynamic_masks",
                                           "dynamic_masks and boxes",
                                           "semantic",
                                           "semantic and boxes",
                                           "semantic and dynamic_masks",
                                           "semantic and dynamic_masks and boxes"};
  for (int from = 7; from >= 0; from--) {
    if (t.critical[from] == 0)
      continue;
    add_word(&sources, ", ", from_names[from]);
    snprintf(count, sizeof count, " in %lld of %lld views", (long long)t.critical[from], (long long)t.views);
    add_word(&sources, "", count);
  }
  const pags_label_set *set = driving->rules.labels;
  char name[PAGS_LABEL_NAME];
  for (int id = set->first; id < set->first + set->count && t.semantic > 0; id++)
    if (driving->critical.classes[id] & PAGS_LABEL_CRITICAL)
      add_word(&names, ", ", pags_label_name(set, id, name));
  PAGS_TRY(pags_driving_note(driving, "critical: %s from %s%s%s%s%s",
                             driving->critical.list ? driving->critical.list : "vehicles, pedestrians and cyclists",
                             text, *classes ? "; classes of " : "", *classes ? set->name : "", *classes ? ": " : "",
                             classes));

  int64_t bare = 0, first = 0;
  for (int64_t i = driving->step_count - 1; i >= 0; i--)
    if (!pags_driving_has_boxes(driving, driving->steps[i].frame)) {
      bare++;
      first = i;
    }
  if ((t.semantic == 0 && t.dynamic == 0) || bare == 0)
    return PAGS_OK;
  const char *left_out = "pixels of dynamic classes and of dynamic_masks are left out of the loss";
  if (bare == driving->step_count)
    return pags_driving_note(driving, "no boxes: %s", left_out);
  return pags_driving_note(driving, "no boxes at %lld of %lld time steps, the first is %0*d: there, %s",
                           (long long)bare, (long long)driving->step_count, driving->digits,
                           driving->steps[first].frame, left_out);
}
