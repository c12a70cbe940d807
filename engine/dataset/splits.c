/* SPDX-License-Identifier: Apache-2.0 */
/* Reads stated splits (splits.h). Names are compared without "./" and with slashes for backslashes; a name that no
 * picture has is tried without its folders. */
#include "dataset/splits.h"

#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"

typedef struct pags_split_name {
  char *name;
  pags_split split;
  bool used;
} split_name;

static char *plain_name(const char *name) {
  char *copy = pags_text_copy(pags_text_starts(name, "./") || pags_text_starts(name, ".\\") ? name + 2 : name);
  for (char *c = copy; c && *c; c++)
    *c = *c == '\\' ? '/' : *c;
  return copy;
}

/* By name; held out before training, so that a name in two lists is held out. */
static int by_name(const void *a, const void *b) {
  const split_name *left = a, *right = b;
  const int order = strcmp(left->name, right->name);
  return order ? order : (int)right->split - (int)left->split;
}

static int by_name_alone(const void *a, const void *b) {
  return strcmp(((const split_name *)a)->name, ((const split_name *)b)->name);
}

/* ---- Lists of a transforms.json ---- */

static pags_result add_list(const pags_json *json, const pags_json_value *root, const char *key, pags_split split,
                            pags_split_lists *out, bool *given) {
  const pags_json_value *list = pags_json_member(root, key);
  *given = list && list->type != PAGS_JSON_NULL;
  if (!*given)
    return PAGS_OK;
  PAGS_TRY(pags_json_array(json, root, key, &list));
  split_name *names = realloc(out->names, ((size_t)(out->count + list->count) + 1) * sizeof *names);
  PAGS_CHECK_MEMORY(names, "%s", pags_json_path(json));
  out->names = names;
  for (const pags_json_value *item = list->first; item; item = item->next) {
    const char *name;
    PAGS_TRY(pags_json_as_string(json, item, key, &name));
    char *plain = plain_name(name);
    PAGS_CHECK_MEMORY(plain, "%s", pags_json_path(json));
    names[out->count++] = (split_name){.name = plain, .split = split};
  }
  return PAGS_OK;
}

pags_result pags_split_lists_read(const pags_json *json, const pags_json_value *root, pags_split_lists *out) {
  bool val, test;
  PAGS_TRY(add_list(json, root, "train_filenames", PAGS_SPLIT_TRAIN, out, &out->trains));
  PAGS_TRY(add_list(json, root, "val_filenames", PAGS_SPLIT_TEST, out, &val));
  PAGS_TRY(add_list(json, root, "test_filenames", PAGS_SPLIT_TEST, out, &test));
  if (out->count == 0) { /* lists without names state nothing */
    free(out->names);
    out->names = NULL;
    return PAGS_OK;
  }
  pags_sort(out->names, out->count, sizeof *out->names, by_name);
  /* Of a name in several lists the first, which holds it out, is the one that counts. */
  int64_t kept = 0, twice = 0;
  for (int64_t i = 0; i < out->count; i++) {
    split_name *before = kept ? &out->names[kept - 1] : NULL;
    if (before && strcmp(before->name, out->names[i].name) == 0) {
      twice += before->split != out->names[i].split;
      free(out->names[i].name);
    } else {
      out->names[kept++] = out->names[i];
    }
  }
  out->count = kept;
  if (twice)
    PAGS_WARN("%s: %lld pictures are in train_filenames and held out, too; they are held out", pags_json_path(json),
              (long long)twice);
  return PAGS_OK;
}

static split_name *find(const pags_split_lists *lists, const char *name) {
  split_name key = {.name = (char *)name};
  return lists->count ? bsearch(&key, lists->names, (size_t)lists->count, sizeof key, by_name_alone) : NULL;
}

pags_split pags_split_of(pags_split_lists *lists, const char *name) {
  if (!lists->names)
    return PAGS_SPLIT_NONE;
  PAGS_AUTOFREE char *plain = plain_name(name);
  split_name *found = plain ? find(lists, plain) : NULL;
  if (plain && !found)
    found = find(lists, pags_path_name(plain));
  if (found) {
    found->used = true;
    return found->split;
  }
  if (!lists->trains)
    return PAGS_SPLIT_TRAIN;
  if (!lists->left_out++)
    lists->first_left_out = pags_text_copy(name);
  return PAGS_SPLIT_LEFT_OUT;
}

void pags_split_lists_end(pags_split_lists *lists, const char *source) {
  int64_t unused = 0;
  const char *first = NULL;
  for (int64_t i = 0; i < lists->count; i++)
    if (!lists->names[i].used) {
      first = first ? first : lists->names[i].name;
      unused++;
    }
  if (unused)
    PAGS_WARN(
        "%s: %lld of %lld names in train_filenames, val_filenames and test_filenames are of no frame, the first is %s",
        source, (long long)unused, (long long)lists->count, first);
  if (lists->left_out)
    PAGS_WARN("%s: %lld frames are in none of its lists of file names and left out, the first is %s", source,
              (long long)lists->left_out, lists->first_left_out ? lists->first_left_out : "?");
  for (int64_t i = 0; i < lists->count; i++)
    free(lists->names[i].name);
  free(lists->names);
  free(lists->first_left_out);
  memset(lists, 0, sizeof *lists);
}

/* ---- Lists in text files ---- */

/* Whether the last components of the path are `name`. */
static bool ends_in(const char *path, const char *name) {
  const size_t length = strlen(path), end = strlen(name);
  return end && pags_text_ends(path, name) && (length == end || path[length - end - 1] == '/');
}

/* Marks the views of the pictures that `text` lists, names with or without folders and extension. Views are few
 * thousands at most, and so are names. */
static void mark_views(char *text, pags_parsed_dataset *parsed, int64_t *names, int64_t *held_out) {
  for (char *line = text; *line;) {
    size_t length = strcspn(line, "\r\n");
    char *next = line + length + (line[length] != '\0');
    line[length] = '\0';
    *names += *line != '\0' && *line != '#';
    for (int64_t i = 0; i < parsed->count && *line && *line != '#'; i++) {
      pags_parsed_view *view = &parsed->views[i];
      const char *name = pags_path_name(view->image_path);
      const size_t stem = strlen(name) - strlen(pags_path_extension(name));
      if (view->split != PAGS_SPLIT_TEST &&
          (ends_in(view->image_path, line) || (strlen(line) == stem && strncmp(line, name, stem) == 0))) {
        view->split = PAGS_SPLIT_TEST;
        (*held_out)++;
      }
    }
    line = next;
  }
}

pags_result pags_split_read_text(const char *root, const char *model, pags_parsed_dataset *parsed) {
  const char *const folders[] = {model, root}, *const files[] = {"test.txt", "test_list.txt"};
  for (int i = 0; i < 2; i++) {
    if (!pags_folder_has(folders[i], files[i]))
      continue;
    PAGS_AUTOFREE char *path = pags_path_join(folders[i], files[i]);
    PAGS_CHECK_MEMORY(path, "%s", root);
    PAGS_AUTOFREE uint8_t *bytes = NULL;
    size_t size;
    int64_t names = 0, held_out = 0;
    PAGS_TRY(pags_file_read(path, &bytes, &size));
    mark_views((char *)bytes, parsed, &names, &held_out);
    if (held_out < names)
      PAGS_WARN("%s: %lld of its %lld names are of no picture of the model", path, (long long)(names - held_out),
                (long long)names);
    parsed->split_by = held_out ? files[i] : NULL;
    return PAGS_OK;
  }
  return PAGS_OK;
}
