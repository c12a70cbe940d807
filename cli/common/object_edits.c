/* SPDX-License-Identifier: Apache-2.0 */
/* Parses the arguments of --without, --move and --add and finds the objects that they name. */
#include "cli/common/object_edits.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/memory.h"

enum { VALUES = 4 };

static bool parse_values(const char *text, double out[VALUES]) {
  for (int i = 0; i < VALUES; i++) {
    char *end;
    out[i] = strtod(text, &end);
    if (end == text || !isfinite(out[i]) || *end != (i < VALUES - 1 ? ',' : 0))
      return false;
    text = end + 1;
  }
  return true;
}

const char *pags_object_edits_misspelt(const pags_object_edits *words) {
  const pags_words *const lists[] = {&words->move, &words->add};
  double values[VALUES];
  for (int l = 0; l < 2; l++)
    for (int i = 0; i < lists[l]->count; i++)
      if (!parse_values(lists[l]->items[i].value, values))
        return lists[l]->items[i].value;
  return NULL;
}

static bool same(const char *name, size_t length, const char *text) {
  return strlen(text) == length && strncasecmp(name, text, length) == 0;
}

static bool is_meant(const pags_object *object, const char *name, size_t length) {
  static const char prefix[] = "class:";
  size_t skip = sizeof prefix - 1;
  if (length > skip && strncmp(name, prefix, skip) == 0)
    return same(name + skip, length - skip, pags_category_name(object->category)) ||
           same(name + skip, length - skip, object->class_name);
  return strlen(object->id) == length && strncmp(object->id, name, length) == 0;
}

typedef struct edit_list {
  pags_edit *edits;
  int64_t count, capacity;
} edit_list;

/* Adds a copy of `edit` to the list for each object that `name` (an id or class:CLASS) matches. */
static pags_result find_any(const pags_scene *scene, const char *name, size_t length, pags_edit edit, edit_list *list) {
  for (int64_t o = 0; o < scene->object_count; o++) {
    edit.object = o;
    if (is_meant(&scene->objects[o].record, name, length)) {
      /* Append to the list, growing it if it is full. */
      if (list->count == list->capacity) {
        int64_t capacity = 2 * list->capacity + 64;
        pags_edit *grown = realloc(list->edits, (size_t)capacity * sizeof *grown);
        if (!grown)
          return pags_out_of_memory("%lld edits", (long long)capacity);
        list->edits = grown;
        list->capacity = capacity;
      }
      list->edits[list->count++] = edit;
    }
  }
  return PAGS_OK;
}

/* As find_any, but fails if `name` matches no object. */
static pags_result find(const pags_scene *scene, const char *name, size_t length, pags_edit edit, edit_list *list) {
  static const char *const options[] = {
      [PAGS_EDIT_HIDE] = "without", [PAGS_EDIT_MOVE] = "move", [PAGS_EDIT_ADD] = "add"};
  int64_t before = list->count;
  PAGS_TRY(find_any(scene, name, length, edit, list));
  if (list->count > before)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "--%s: expected the id of one of the scene's %lld objects or class:CLASS of one (pags info SCENE "
                   "--objects lists them), found '%.*s'",
                   options[edit.kind], (long long)scene->object_count, (int)(length < 200 ? length : 200), name);
}

/* Adds edits that hide the objects of one word of --without: the word is one id, which may contain commas, or a
 * comma-separated list of ids. */
static pags_result find_listed(const pags_scene *scene, const char *word, edit_list *list) {
  const pags_edit edit = {.kind = PAGS_EDIT_HIDE};
  int64_t before = list->count;
  PAGS_TRY(find_any(scene, word, strlen(word), edit, list));
  if (list->count > before)
    return PAGS_OK;
  for (;;) {
    size_t length = strcspn(word, ",");
    PAGS_TRY(find(scene, word, length, edit, list));
    if (!word[length])
      return PAGS_OK;
    word += length + 1;
  }
}

static pags_result find_hidden(const pags_scene *scene, const pags_words *words, edit_list *list) {
  for (int i = 0; i < words->count; i++)
    PAGS_TRY(find_listed(scene, words->items[i].name, list));
  return PAGS_OK;
}

static pags_result find_placed(const pags_scene *scene, const pags_words *words, pags_edit_kind kind, edit_list *list) {
  for (int i = 0; i < words->count; i++) {
    double values[VALUES];
    if (!parse_values(words->items[i].value, values))
      return pags_fail(PAGS_ERROR_ARGUMENT, "expected X,Y,Z,YAW, found '%s'", words->items[i].value);
    pags_edit edit = {.kind = kind, .translation = {values[0], values[1], values[2]}, .yaw = values[3]};
    PAGS_TRY(find(scene, words->items[i].name, (size_t)words->items[i].length, edit, list));
  }
  return PAGS_OK;
}

pags_result pags_object_edits_find(const pags_object_edits *words, const pags_scene *scene, pags_edit **edits,
                                   int64_t *count) {
  edit_list list = {0};
  pags_result result = find_hidden(scene, &words->without, &list);
  if (result == PAGS_OK)
    result = find_placed(scene, &words->move, PAGS_EDIT_MOVE, &list);
  if (result == PAGS_OK)
    result = find_placed(scene, &words->add, PAGS_EDIT_ADD, &list);
  if (result != PAGS_OK) {
    free(list.edits);
    list = (edit_list){0};
  }
  *edits = list.edits;
  *count = list.count;
  return result;
}
