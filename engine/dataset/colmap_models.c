/* SPDX-License-Identifier: Apache-2.0 */
/* Looks for COLMAP models below a folder, compares their numbers of pictures and states what is left out. */
#include "dataset/colmap_models.h"

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
  int64_t count = 0;
  if (pags_folder_has(folder, "images.bin")) {
    char *path = pags_path_join(folder, "images.bin");
    FILE *file = path ? pags_port_open(path, "rb") : NULL;
    uint64_t value = 0;
    if (file && fread(&value, sizeof value, 1, file) == 1 && value < INT32_MAX)
      count = (int64_t)value;
    if (file)
      fclose(file);
    free(path);
    return count;
  }
  char *path = pags_path_join(folder, "images.txt");
  uint8_t *bytes = NULL;
  size_t size;
  if (path && pags_file_read(path, &bytes, &size) == PAGS_OK) {
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
  }
  free(bytes);
  free(path);
  return count;
}

/* Adds the folder if it is a model; takes it over. */
static pags_result consider(candidates *all, char *folder) {
  if (!folder)
    return pags_out_of_memory(NULL);
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
  pags_dir_list list = list_of(folder);
  pags_result result = PAGS_OK;
  for (int64_t i = 0; result == PAGS_OK && i < list.count; i++)
    if (!pags_is_picture_name(list.names[i]))
      result = consider(all, pags_path_join(folder, list.names[i]));
  pags_dir_list_destroy(&list);
  return result == PAGS_OK ? consider(all, pags_text_copy(folder)) : result;
}

static int64_t most_pictures(const candidates *all) {
  int64_t most = 0;
  for (int i = 0; i < all->count; i++)
    most = all->items[i].pictures > most ? all->items[i].pictures : most;
  return most;
}

/* Whether the folder is a data set that isn't COLMAP's. */
static bool is_other_set(const char *folder) {
  static const char *const files[] = {"transforms.json", "transforms_train.json", "dataset.json"};
  bool found = false;
  for (size_t i = 0; i < sizeof files / sizeof *files; i++)
    found = found || pags_folder_has(folder, files[i]);
  return found;
}

static bool has_images(const char *folder) {
  char *images = pags_path_join(folder, "images");
  const bool found = images && pags_dir_exists(images);
  free(images);
  return found;
}

/* Notes that `folder`, a data set with the models `more`, if any, lies next to `home`, which has those of `all`. Models
 * of the same pictures, dense/sparse next to distorted/sparse say, have as many, and one of the folders has no
 * pictures.
 */
static pags_result add_other(candidates *all, const char *home, const candidates *more, const char *folder) {
  all->others += 1 + more->others;
  all->differ = all->differ || !more->count || more->differ || most_pictures(more) != most_pictures(all) ||
                (has_images(home) && has_images(folder));
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
  pags_result result = PAGS_OK;
  bool found = false;
  for (int depth = 0; depth < levels && result == PAGS_OK && !found; depth++)
    result = consider_level(all, folder, depth, left, &found);
  return result;
}

/* Looks for models `depth` levels below the children of `folder`. Of those next to the child that has them, data sets a
 * level further down are noted, too: a/sparse lies next to b/sparse/0. */
static pags_result consider_level(candidates *all, const char *folder, int depth, int *left, bool *found) {
  pags_dir_list list = list_of(folder);
  pags_result result = PAGS_OK;
  char *home = NULL; /* the child that has the models of `all` */
  for (int pass = 0; pass < 2 && result == PAGS_OK && (pass == 0 || home); pass++)
    for (int64_t i = 0; i < list.count && result == PAGS_OK && (pass == 1 || !home); i++) {
      if (pags_is_picture_name(list.names[i]) || list.names[i][0] == '.')
        continue;
      char *inside = pags_path_join(folder, list.names[i]);
      candidates more = {0};
      const bool same = home && inside && strcmp(inside, home) == 0;
      if (inside && !same && pags_dir_exists(inside)) {
        result = consider_below(pass ? &more : all, inside, depth + pass, left);
        if (result == PAGS_OK && pass && (more.count || is_other_set(inside)))
          result = add_other(all, home, &more, inside);
        if (result == PAGS_OK && !pass && all->count && !(home = pags_text_copy(inside)))
          result = pags_out_of_memory("%s", inside);
      }
      candidates_destroy(&more);
      free(inside);
    }
  *found = home != NULL;
  free(home);
  pags_dir_list_destroy(&list);
  return result;
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
  candidates all = {0};
  int left = 500;
  *out = NULL;
  pags_result result = consider(&all, pags_text_copy(root));
  for (size_t i = 0; i < sizeof usual / sizeof *usual && result == PAGS_OK && !all.count; i++) {
    char *folder = pags_path_join(root, usual[i]);
    result = folder ? consider_children(&all, folder) : pags_out_of_memory("%s", root);
    free(folder);
  }
  if (result == PAGS_OK && !all.count)
    result = consider_below(&all, root, 4, &left);
  candidate *chosen = NULL;
  for (int i = 0; i < all.count; i++)
    if (!chosen || all.items[i].pictures > chosen->pictures)
      chosen = &all.items[i];
  if (result == PAGS_OK && chosen) {
    say_choice(root, &all, chosen);
    *out = chosen->folder;
    chosen->folder = NULL;
  }
  candidates_destroy(&all);
  return result;
}

/* ---- Pictures of no model ---- */

static int by_text(const void *a, const void *b) {
  return strcmp(*(const char *const *)a, *(const char *const *)b);
}

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

/* Counts the pictures in `folder` whose stems are not among `used`, sorted; *first: the path of the first, kept. */
static pags_result count_unused_in(const char *folder, char *const *used, int64_t count, int64_t *pictures,
                                   int64_t *unused, char **first) {
  pags_dir_list list = list_of(folder);
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < list.count && result == PAGS_OK; i++) {
    if (!pags_is_picture_name(list.names[i]))
      continue;
    char *stem = stem_of(folder, list.names[i]);
    (*pictures)++;
    if (!stem)
      result = pags_out_of_memory("%s", folder);
    else if (!bsearch(&stem, used, (size_t)count, sizeof *used, by_text) && !(*unused)++)
      *first = pags_path_join(folder, list.names[i]);
    free(stem);
  }
  pags_dir_list_destroy(&list);
  return result;
}

pags_result pags_count_unused_pictures(const pags_parsed_dataset *parsed) {
  char **used = calloc((size_t)parsed->count + 1, sizeof *used), *folder = NULL, *first = NULL;
  pags_result result = used ? PAGS_OK : pags_out_of_memory("%s", parsed->source);
  int64_t count = 0, pictures = 0, unused = 0;
  for (int64_t i = 0; i < parsed->count && result == PAGS_OK; i++)
    if (!parsed->views[i].missing && !(used[count++] = stem_of(NULL, parsed->views[i].image_path)))
      result = pags_out_of_memory("%s", parsed->source);
  if (result == PAGS_OK)
    pags_sort(used, count, sizeof *used, by_text);
  for (int64_t i = 0; i < count && result == PAGS_OK; i++) {
    char *next = pags_path_folder(used[i]);
    if (!next) {
      result = pags_out_of_memory("%s", parsed->source);
    } else if (folder && strcmp(folder, next) == 0) {
      free(next);
    } else {
      free(folder);
      folder = next;
      result = count_unused_in(folder, used, count, &pictures, &unused, &first);
    }
  }
  if (result == PAGS_OK && unused)
    pags_log_message(PAGS_LOG_WARNING, "%s: %lld of %lld pictures beside the ones used are not in it, the first is %s",
                     parsed->source, (long long)unused, (long long)pictures, first ? first : folder);
  for (int64_t i = 0; used && i < count; i++)
    free(used[i]);
  free(used);
  free(first);
  free(folder);
  return result;
}
