/* SPDX-License-Identifier: Apache-2.0 */
/* Looks for COLMAP models below a folder, compares their numbers of pictures and says what is left out. */
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
} candidates;

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

/* Looks `levels` levels below `folder`, each level before the next; *left bounds how many folders are opened. */
static pags_result consider_below(candidates *all, const char *folder, int levels, int *left) {
  PAGS_TRY(consider_children(all, folder));
  if (all->count || levels == 0 || (*left)-- <= 0)
    return PAGS_OK;
  pags_dir_list list = list_of(folder);
  pags_result result = PAGS_OK;
  for (int depth = 0; depth < levels && result == PAGS_OK && !all->count; depth++)
    for (int64_t i = 0; i < list.count && result == PAGS_OK && !all->count; i++) {
      char *inside =
          pags_is_picture_name(list.names[i]) || list.names[i][0] == '.' ? NULL : pags_path_join(folder, list.names[i]);
      if (inside && pags_dir_exists(inside))
        result = consider_below(all, inside, depth, left);
      free(inside);
    }
  pags_dir_list_destroy(&list);
  return result;
}

/* ---- Choosing ---- */

/* Says which of several models was chosen. Others with as many pictures are copies or refinements as a rule. */
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
  for (int i = 0; i < all.count; i++)
    free(all.items[i].folder);
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
