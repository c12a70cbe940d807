/* SPDX-License-Identifier: Apache-2.0 */
/* Parses and applies the options on a scene. */
#include "cli/common/scene_options.h"

#include <strings.h>

#include "base/file.h"
#include "base/text.h"
#include "base/vec3.h"

pags_result pags_reading_load(const pags_reading *reading, const char *path, pags_scene *scene) {
  PAGS_TRY(pags_scene_load_in_axes(path, reading->axes, scene));
  if (reading->up)
    scene->up = (pags_up)reading->up;
  return PAGS_OK;
}

/* Reads `count` numbers separated by commas. */
static bool parse_numbers(const char *text, int count, double *out) {
  for (int i = 0; i < count; i++) {
    char *end;
    out[i] = strtod(text, &end);
    if (end == text || !isfinite(out[i]) || *end != (i < count - 1 ? ',' : 0))
      return false;
    text = end + 1;
  }
  return true;
}

/* ---- Removed Gaussians ---- */

int pags_crop_check(const pags_parsed *parsed, pags_crop *crop) {
  double box[6], ball[4];
  pags_filter *filter = &crop->filter;
  if (crop->box && !parse_numbers(crop->box, 6, box))
    return pags_usage_error(parsed->verb, "--crop-box: expected X,Y,Z,X,Y,Z, two corners, got '%s'", crop->box);
  if (crop->sphere && (!parse_numbers(crop->sphere, 4, ball) || ball[3] <= 0))
    return pags_usage_error(parsed->verb, "--crop-sphere: expected X,Y,Z,R with R > 0, got '%s'", crop->sphere);
  if (crop->box) {
    filter->has_box = true;
    pags_copy3(box, filter->lo);
    pags_copy3(box, filter->hi);
    pags_box_add3(box + 3, filter->lo, filter->hi);
  }
  if (crop->sphere) {
    filter->has_ball = true;
    pags_copy3(ball, filter->middle);
    filter->radius = ball[3];
  }
  return PAGS_EXIT_OK;
}

pags_result pags_crop_apply(const pags_crop *crop, pags_scene *scene, double time, uint8_t *chosen,
                            const pags_session *session) {
  const int64_t before = pags_scene_gaussian_count(scene);
  int64_t left;
  if (!pags_filter_is_set(&crop->filter) && !crop->edits)
    return PAGS_OK;
  if (crop->edits) {
    PAGS_AUTOFREE uint8_t *text = NULL;
    size_t size;
    PAGS_TRY(pags_file_read(crop->edits, &text, &size));
    PAGS_TRY(pags_scene_cleanup(scene, crop->edits, (const char *)text));
  }
  PAGS_TRY(pags_scene_filter(scene, &crop->filter, time, chosen, &left));
  pags_say(session, "%lld of %lld Gaussians are left\n", (long long)left, (long long)before);
  return PAGS_OK;
}

/* ---- Hidden, moved and added objects ---- */

int pags_object_edits_check(const pags_parsed *parsed, const pags_object_edits *words) {
  const pags_words *const lists[] = {&words->move, &words->add};
  double values[4];
  for (int l = 0; l < 2; l++)
    for (int i = 0; i < lists[l]->count; i++)
      if (!parse_numbers(lists[l]->items[i].value, 4, values))
        return pags_usage_error(parsed->verb, "--move and --add: expected X,Y,Z,YAW, four numbers, got '%s'",
                                lists[l]->items[i].value);
  return PAGS_EXIT_OK;
}

static bool same(const char *name, size_t length, const char *text) {
  return strlen(text) == length && strncasecmp(name, text, length) == 0;
}

static bool is_meant(const pags_object *object, const char *name, size_t length) {
  static const char prefix[] = "class:";
  size_t skip = sizeof prefix - 1;
  if (length > skip && pags_text_starts(name, prefix))
    return same(name + skip, length - skip, pags_category_name(object->category)) ||
           same(name + skip, length - skip, object->class_name);
  return pags_text_is(name, length, object->id);
}

/* Adds a copy of `edit` to the list for each object that `name` (an id or class:CLASS) matches. *found: any does. */
static pags_result find_any(const pags_scene *scene, const char *name, size_t length, pags_edit edit,
                            pags_edit_list *list, bool *found) {
  *found = false;
  for (edit.object = 0; edit.object < scene->object_count; edit.object++) {
    if (!is_meant(&scene->objects[edit.object].record, name, length))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&list->items, list->count + 1, &list->capacity, sizeof edit), "%lld edits",
                      (long long)list->count + 1);
    list->items[list->count++] = edit;
    *found = true;
  }
  return PAGS_OK;
}

/* As find_any, but fails if `name` matches no object. */
static pags_result find(const pags_scene *scene, const char *name, size_t length, pags_edit edit,
                        pags_edit_list *list) {
  static const char *const options[] = {
      [PAGS_EDIT_HIDE] = "without", [PAGS_EDIT_MOVE] = "move", [PAGS_EDIT_ADD] = "add"};
  bool found;
  PAGS_TRY(find_any(scene, name, length, edit, list, &found));
  if (found)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "--%s: expected the id of one of the scene's %lld objects or class:CLASS of one (pags info SCENE "
                   "--objects lists them), found '%.*s'",
                   options[edit.kind], (long long)scene->object_count, (int)(length < 200 ? length : 200), name);
}

static pags_result find_placed(const pags_scene *scene, const pags_words *words, pags_edit_kind kind,
                               pags_edit_list *list) {
  for (int i = 0; i < words->count; i++) {
    double values[4];
    if (!parse_numbers(words->items[i].value, 4, values))
      return pags_fail(PAGS_ERROR_ARGUMENT, "expected X,Y,Z,YAW, found '%s'", words->items[i].value);
    const pags_edit edit = {.kind = kind, .translation = {values[0], values[1], values[2]}, .yaw = values[3]};
    PAGS_TRY(find(scene, words->items[i].name, (size_t)words->items[i].length, edit, list));
  }
  return PAGS_OK;
}

pags_result pags_object_edits_find(const pags_object_edits *words, const pags_scene *scene, pags_edit_list *list) {
  const pags_edit hide = {.kind = PAGS_EDIT_HIDE};
  for (int i = 0; i < words->without.count; i++) {
    /* A word of --without is one id, which may contain commas, or a comma-separated list of ids. */
    const char *word = words->without.items[i].name;
    bool found;
    PAGS_TRY(find_any(scene, word, strlen(word), hide, list, &found));
    while (!found) {
      const size_t length = strcspn(word, ",");
      PAGS_TRY(find(scene, word, length, hide, list));
      found = !word[length];
      word += length + 1;
    }
  }
  PAGS_TRY(find_placed(scene, &words->move, PAGS_EDIT_MOVE, list));
  return find_placed(scene, &words->add, PAGS_EDIT_ADD, list);
}

/* ---- Changes to how pictures are drawn ---- */

void pags_picture_changes_apply(const pags_picture_changes *changes, const pags_parsed *parsed,
                                pags_frame_options *frame) {
  if (pags_option_given(parsed, "background")) {
    pags_narrow3(changes->background, frame->background);
    frame->sky = NULL;
  }
  if (pags_option_given(parsed, "antialiased") || pags_option_given(parsed, "no-antialiased"))
    frame->antialiased = changes->antialiased;
  if (pags_option_given(parsed, "near"))
    frame->near_plane = (float)changes->near_plane;
  if (pags_option_given(parsed, "low-pass"))
    frame->low_pass = (float)changes->low_pass;
}
