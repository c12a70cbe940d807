/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the names of pictures differ; see picture.h. */
#include "cli/draw/picture.h"

#include <strings.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"

typedef struct entry {
  const char *view;
  char *name;
  int64_t number; /* of the view */
  int tries;
} entry;

static int by_name(const void *a, const void *b) {
  const entry *left = a, *right = b;
  const int order = strcasecmp(left->name, right->name);
  return order ? order : (left->number > right->number) - (left->number < right->number);
}

/* Moves an entry to its next candidate name: the stem, the whole name, the whole name with its number. */
static pags_result rename_entry(entry *e) {
  const char *whole = pags_path_is_inside(e->view) ? e->view : pags_path_name(e->view);
  const size_t length = strlen(whole), stem = length - strlen(pags_path_extension(whole));
  char *name = e->tries == 0   ? pags_text_format("%.*s", (int)(stem ? stem : length), whole)
               : e->tries == 1 ? pags_text_copy(whole)
                               : pags_text_format("%s-%lld", e->name, (long long)e->number);
  PAGS_CHECK_MEMORY(name, "the name of a picture");
  free(e->name);
  e->name = name;
  e->tries++;
  return PAGS_OK;
}

/* Names the views, and renames them until no two names are equal. */
static pags_result make_differ(entry *entries, int64_t count) {
  for (int64_t i = 0; i < count; i++)
    PAGS_TRY(rename_entry(&entries[i]));
  for (bool same = true; same;) {
    same = false;
    pags_sort(entries, count, sizeof *entries, by_name);
    const char *first = NULL;
    for (int64_t i = 0; i < count; i++) {
      const bool taken = first && strcasecmp(first, entries[i].name) == 0;
      first = taken ? first : entries[i].name;
      if (taken)
        PAGS_TRY(rename_entry(&entries[i]));
      same = same || taken;
    }
  }
  return PAGS_OK;
}

pags_result pags_picture_names_make(const pags_scene *scene, const pags_dataset *dataset, pags_picture_names *out) {
  const int64_t count = scene ? scene->view_count : pags_dataset_view_count(dataset);
  PAGS_AUTOFREE entry *entries = calloc((size_t)count + 1, sizeof *entries);
  *out = (pags_picture_names){.count = count, .items = calloc((size_t)count + 1, sizeof *out->items)};
  PAGS_CHECK_MEMORY(entries && out->items, "%lld names", (long long)count);
  for (int64_t i = 0; i < count; i++)
    entries[i] = (entry){.view = scene ? scene->views[i].name : pags_dataset_view(dataset, i)->name, .number = i};
  const pags_result result = make_differ(entries, count);
  for (int64_t i = 0; i < count; i++)
    out->items[entries[i].number] = entries[i].name;
  return result;
}

void pags_picture_names_destroy(pags_picture_names *names) {
  if (names->items)
    for (int64_t i = 0; i < names->count; i++)
      free(names->items[i]);
  free(names->items);
}
