/* SPDX-License-Identifier: Apache-2.0 */
/* Looks for COLMAP models below a folder, compares their numbers of pictures and reports the others. */
#include "dataset/colmap.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "dataset/find_file.h"
#include "port/port.h"

/* ---- Candidates ---- */

typedef struct candidate {
  char *folder;
  int64_t pictures;
} candidate;

typedef struct candidates {
  int count;
  candidate items[64]; /* of one parent; more are not looked at */
  /* Other captures next to that one, found on the same level: how many, the folder of the first, and whether they have
   * pictures of their own or another number of them. */
  int others;
  char *other;
  bool differ;
} candidates;

static void candidates_destroy(candidates *all) {
  for (int i = 0; i < all->count; i++)
    free(all->items[i].folder);
  free(all->other);
}

/* The number of images of a model: the count at the head of images.bin, or the records of images.txt. 0 if it can't be
 * read, which is said when the model is opened. */
static int64_t count_images(const char *folder) {
  const bool binary = pags_folder_has(folder, "images.bin");
  PAGS_AUTOFREE char *path = pags_path_join(folder, binary ? "images.bin" : "images.txt");
  if (!path)
    return 0;
  if (binary) {
    uint64_t value;
    return pags_file_head(path, &value, sizeof value) == sizeof value && value < INT32_MAX ? (int64_t)value : 0;
  }
  int64_t count = 0;
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  if (pags_file_read(path, &bytes, &size) != PAGS_OK)
    return 0;
  /* Two lines an image: its pose, and observations that may be an empty line. */
  bool pose = true;
  for (const char *line = (const char *)bytes; *line;) {
    const size_t length = strcspn(line, "\n");
    const bool comment = *line == '#', empty = strspn(line, " \t\r") >= length;
    if (!comment && !(pose && empty)) {
      count += pose;
      pose = !pose;
    }
    line += length + (line[length] == '\n');
  }
  return count;
}

/* Adds the folder if it is a model; takes it over. */
static pags_result consider(candidates *all, char *folder) {
  PAGS_CHECK_MEMORY(folder, NULL);
  if (all->count < (int)(sizeof all->items / sizeof *all->items) && pags_colmap_is_model(folder))
    all->items[all->count++] = (candidate){folder, count_images(folder)};
  else
    free(folder);
  return PAGS_OK;
}

/* The names in `folder` that may be folders; none if it can't be listed. */
static pags_dir_list list_of(const char *folder) {
  pags_dir_list list = {0};
  if (!pags_dir_exists(folder) || pags_dir_list_read(folder, &list) != PAGS_OK)
    return (pags_dir_list){0};
  return list;
}

/* The models that are children of `folder`, and `folder` itself. */
static pags_result consider_children(candidates *all, const char *folder) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = list_of(folder);
  for (int64_t i = 0; i < list.count; i++)
    if (!pags_is_picture_name(list.names[i]))
      PAGS_TRY(consider(all, pags_path_join(folder, list.names[i])));
  return consider(all, pags_text_copy(folder));
}

static int64_t most_pictures(const candidates *all) {
  int64_t most = 0;
  for (int i = 0; i < all->count; i++)
    most = all->items[i].pictures > most ? all->items[i].pictures : most;
  return most;
}

/* Notes that `folder`, a data set with the models `more`, if any, lies next to `home`, which has those of `all`. Models
 * of the same pictures, dense/sparse next to distorted/sparse say, have as many, and one of the folders has no
 * pictures.
 */
static pags_result add_other(candidates *all, const char *home, const candidates *more, const char *folder) {
  all->others += 1 + more->others;
  all->differ = all->differ || !more->count || more->differ || most_pictures(more) != most_pictures(all) ||
                (pags_folder_has_folder(home, "images") && pags_folder_has_folder(folder, "images"));
  if (!all->other)
    all->other = pags_text_copy(more->count ? more->items[0].folder : folder);
  return all->other ? PAGS_OK : pags_out_of_memory("%s", folder);
}

static pags_result consider_level(candidates *all, const char *folder, int depth, int *left, bool *found);

/* Looks `levels` levels below `folder`, each level before the next; *left bounds how many folders are opened. The first
 * folder with models counts. */
static pags_result consider_below(candidates *all, const char *folder, int levels, int *left) {
  PAGS_TRY(consider_children(all, folder));
  if (all->count || levels == 0 || (*left)-- <= 0)
    return PAGS_OK;
  bool found = false;
  for (int depth = 0; depth < levels && !found; depth++)
    PAGS_TRY(consider_level(all, folder, depth, left, &found));
  return PAGS_OK;
}

/* Looks for models `depth` levels below the children of `folder`. Data sets next to the child that has them are noted,
 * a level further down, too: a/sparse lies next to b/sparse/0. */
static pags_result consider_level(candidates *all, const char *folder, int depth, int *left, bool *found) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = list_of(folder);
  PAGS_AUTOFREE char *home = NULL; /* the child that has the models of `all` */
  for (int pass = 0; pass < 2 && (pass == 0 || home); pass++)
    for (int64_t i = 0; i < list.count && (pass == 1 || !home); i++) {
      if (pags_is_picture_name(list.names[i]) || list.names[i][0] == '.')
        continue;
      PAGS_AUTOFREE char *inside = pags_path_join(folder, list.names[i]);
      if (!inside || (home && strcmp(inside, home) == 0) || !pags_dir_exists(inside))
        continue;
      PAGS_AUTO(candidates_destroy) candidates more = {0};
      PAGS_TRY(consider_below(pass ? &more : all, inside, depth + pass, left));
      if (pass && (more.count || pags_folder_is_data_set(inside)))
        PAGS_TRY(add_other(all, home, &more, inside));
      if (!pass && all->count) {
        home = pags_text_copy(inside);
        PAGS_CHECK_MEMORY(home, "%s", inside);
      }
    }
  *found = home != NULL;
  return PAGS_OK;
}

/* ---- Choosing ---- */

/* Reports which of several models was chosen. Others with as many pictures are copies or refinements as a rule. */
static void say_choice(const char *root, const candidates *all, const candidate *chosen) {
  const candidate *other = NULL;
  bool differ = false;
  for (int i = 0; i < all->count; i++) {
    if (&all->items[i] == chosen)
      continue;
    other = other ? other : &all->items[i];
    differ = differ || all->items[i].pictures != chosen->pictures;
  }
  const size_t skip = strlen(root) + 1;
  if (other)
    pags_log_message(differ ? PAGS_LOG_WARNING : PAGS_LOG_INFO,
                     "%s: %d COLMAP models: the largest, %s with %lld pictures, is used, and %d left out, the first is "
                     "%s with %lld (--colmap FOLDER takes another)",
                     root, all->count, chosen->folder + skip, (long long)chosen->pictures, all->count - 1,
                     strlen(other->folder) > skip ? other->folder + skip : ".", (long long)other->pictures);
  if (all->others)
    pags_log_message(all->differ ? PAGS_LOG_WARNING : PAGS_LOG_INFO,
                     "%s: holds %d data sets: %s is used, and %d left out, the first is %s (give the folder of one)",
                     root, all->others + 1, chosen->folder + skip, all->others, all->other + skip);
}

pags_result pags_colmap_find_model(const char *root, char **out) {
  static const char *const usual[] = {"sparse", "colmap/sparse"};
  PAGS_AUTO(candidates_destroy) candidates all = {0};
  int left = 500;
  *out = NULL;
  PAGS_TRY(consider(&all, pags_text_copy(root)));
  for (size_t i = 0; i < sizeof usual / sizeof *usual && !all.count; i++) {
    PAGS_AUTOFREE char *folder = pags_path_join(root, usual[i]);
    PAGS_CHECK_MEMORY(folder, "%s", root);
    PAGS_TRY(consider_children(&all, folder));
  }
  if (!all.count)
    PAGS_TRY(consider_below(&all, root, 4, &left));
  candidate *chosen = NULL;
  for (int i = 0; i < all.count; i++)
    if (!chosen || all.items[i].pictures > chosen->pictures)
      chosen = &all.items[i];
  if (chosen) {
    say_choice(root, &all, chosen);
    *out = pags_take(&chosen->folder);
  }
  return PAGS_OK;
}

/* ---- Pictures of no model ---- */

/* The path without the extensions of pictures: a copy in another format, or a mask NAME.jpg.png, belongs to its
 * picture. */
static char *stem_of(const char *folder, const char *name) {
  char *path = folder ? pags_path_join(folder, name) : pags_text_copy(name);
  for (char *end = path; path && end && pags_is_picture_name(pags_path_name(path));) {
    end = path + strlen(path) - strlen(pags_path_extension(path));
    *end = '\0';
  }
  return path;
}

/* The pictures of the views, and what is found next to them. */
typedef struct unused_search {
  int64_t count, pictures, unused;
  char **stems; /* of the views' pictures, sorted */
  char *first;  /* path of the first that is unused, kept */
} unused_search;

static void unused_search_destroy(unused_search *s) {
  for (int64_t i = 0; s->stems && i < s->count; i++)
    free(s->stems[i]);
  free(s->stems);
  free(s->first);
}

static pags_result count_unused_in(const char *folder, unused_search *s) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = list_of(folder);
  for (int64_t i = 0; i < list.count; i++) {
    if (!pags_is_picture_name(list.names[i]))
      continue;
    s->pictures++;
    PAGS_AUTOFREE char *stem = stem_of(folder, list.names[i]);
    PAGS_CHECK_MEMORY(stem, "%s", folder);
    if (!bsearch(&stem, s->stems, (size_t)s->count, sizeof *s->stems, pags_text_compare) && !s->unused++)
      s->first = pags_path_join(folder, list.names[i]);
  }
  return PAGS_OK;
}

pags_result pags_count_unused_pictures(const pags_parsed_dataset *parsed) {
  PAGS_AUTO(unused_search_destroy) unused_search s = {.stems = calloc((size_t)parsed->count + 1, sizeof *s.stems)};
  PAGS_CHECK_MEMORY(s.stems, "%s", parsed->source);
  for (int64_t i = 0; i < parsed->count; i++)
    if (!parsed->views[i].missing)
      PAGS_CHECK_MEMORY(s.stems[s.count++] = stem_of(NULL, parsed->views[i].image_path), "%s", parsed->source);
  pags_sort(s.stems, s.count, sizeof *s.stems, pags_text_compare);
  PAGS_AUTOFREE char *folder = NULL;
  for (int64_t i = 0; i < s.count; i++) {
    PAGS_AUTOFREE char *next = pags_path_folder(s.stems[i]);
    PAGS_CHECK_MEMORY(next, "%s", parsed->source);
    if (folder && strcmp(folder, next) == 0)
      continue;
    free(folder);
    folder = pags_take(&next);
    PAGS_TRY(count_unused_in(folder, &s));
  }
  if (s.unused)
    PAGS_WARN("%s: %lld of %lld pictures in the folders of the ones used are not in it, the first is %s",
              parsed->source, (long long)s.unused, (long long)s.pictures, s.first ? s.first : folder);
  return PAGS_OK;
}
