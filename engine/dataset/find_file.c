/* SPDX-License-Identifier: Apache-2.0 */
/* Finds files under other spellings of their names (find_file.h). */
#include "dataset/find_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

/* ---- Names ---- */

static char lower(char c) {
  return c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : c;
}

/* Whether the first `count` bytes are the same but for the case of ASCII letters; a text may end in them. */
static bool same_letters(const char *a, const char *b, size_t count) {
  size_t i = 0;
  while (i < count && a[i] && lower(a[i]) == lower(b[i]))
    i++;
  return i == count || (!a[i] && !b[i]);
}

const char *pags_words_next(const char **list, char out[64]) {
  const size_t length = strcspn(*list, " ");
  snprintf(out, 64, "%.*s", (int)length, *list);
  *list += length + ((*list)[length] == ' ');
  return length ? out : NULL;
}

bool pags_words_have(const char *list, const char *word) {
  char known[64];
  while (pags_words_next(&list, known))
    if (strcasecmp(known, word) == 0)
      return true;
  return false;
}

bool pags_is_picture_name(const char *name) {
  return name[0] != '.' &&
         pags_words_have(".png .jpg .jpeg .webp .tif .tiff .bmp .exr .hdr .jxl .avif .heic .dng .jp2 .tga .ppm",
                         pags_path_extension(name));
}

bool pags_folder_is_data_set(const char *folder) {
  return pags_folder_has(folder, "transforms.json") || pags_folder_has(folder, "transforms_train.json") ||
         pags_folder_has(folder, "dataset.json");
}

pags_result pags_find_extension(const char *folder, const char *name, int length, const char *extension, char **out) {
  PAGS_AUTOFREE char *path = pags_text_format("%s/%.*s%s", folder, length, name, extension);
  PAGS_CHECK_MEMORY(path, "%s", folder);
  *out = pags_file_exists(path) ? pags_take(&path) : NULL;
  return PAGS_OK;
}

/* Absolute on this or another system. */
static bool is_absolute(const char *name) {
  return name[0] == '/' || (name[0] && name[1] == ':' && name[2] == '/');
}

/* ---- One component ---- */

/* Lists `folder`; false if it can't be, or for want of memory. */
static bool list_folder(pags_file_finder *finder, const char *folder) {
  if (finder->folder && strcmp(finder->folder, folder) == 0)
    return true;
  free(finder->folder);
  pags_dir_list_destroy(&finder->list);
  finder->list = (pags_dir_list){0};
  finder->folder = pags_dir_exists(folder) ? pags_text_copy(folder) : NULL;
  if (finder->folder && pags_dir_list_read(folder, &finder->list) == PAGS_OK)
    return true;
  free(finder->folder);
  finder->folder = NULL;
  return false;
}

/* The only entry of the listed folder that has the name but for letter case; NULL if not found or several. */
static const char *entry_of_case(const pags_file_finder *finder, const char *name, size_t length) {
  const char *found = NULL;
  for (int64_t i = 0; i < finder->list.count; i++)
    if (strlen(finder->list.names[i]) == length && same_letters(name, finder->list.names[i], length)) {
      if (found)
        return NULL;
      found = finder->list.names[i];
    }
  return found;
}

/* The only picture of the listed folder whose name without extension is `name`, or `name` without its own; NULL if
 * none exists or several. *bare: `name` has no extension of a picture. */
static const char *entry_of_stem(const pags_file_finder *finder, const char *name, bool *bare) {
  const char *found = NULL;
  *bare = !pags_is_picture_name(name);
  const size_t length = strlen(name) - (*bare ? 0 : strlen(pags_path_extension(name)));
  for (int64_t i = 0; i < finder->list.count; i++) {
    const char *entry = finder->list.names[i];
    if (strlen(entry) - strlen(pags_path_extension(entry)) != length || !pags_is_picture_name(entry) ||
        !same_letters(name, entry, length))
      continue;
    if (found)
      return NULL;
    found = entry;
  }
  return found;
}

/* ---- A whole name ---- */

/* Raises *how to a worse spelling. */
static void worsen(pags_spelling *how, pags_spelling spelling) {
  *how = spelling > *how ? spelling : *how;
}

/* The path of `part`, the next component of a name, in the folder `at`; NULL if not found. `last`: it is the file. */
static char *follow_part(pags_file_finder *finder, const char *at, const char *part, bool last, pags_spelling *how) {
  PAGS_AUTOFREE char *next = pags_path_join(at, part);
  if (!next || (last ? pags_file_exists(next) : pags_dir_exists(next)))
    return pags_take(&next);
  const char *entry = NULL;
  bool bare = false;
  if (list_folder(finder, at)) {
    entry = entry_of_case(finder, part, strlen(part));
    if (entry)
      worsen(how, PAGS_SPELLING_CASE);
    else if (last && (entry = entry_of_stem(finder, part, &bare)))
      worsen(how, bare ? PAGS_SPELLING_SAME : PAGS_SPELLING_EXTENSION);
  }
  return entry ? pags_path_join(at, entry) : NULL;
}

/* Follows `name` from `folder`, component by component, and returns the path of the file; NULL if not found.
 * *how: the worst spelling on the way. */
static char *follow(pags_file_finder *finder, const char *folder, const char *name, pags_spelling *how) {
  PAGS_AUTOFREE char *at = pags_text_copy(folder);
  while (at && *name) {
    const size_t length = strcspn(name, "/");
    const bool last = name[length] == '\0';
    if (length) {
      PAGS_AUTOFREE char *before = at;
      PAGS_AUTOFREE char *part = pags_text_format("%.*s", (int)length, name);
      at = part ? follow_part(finder, before, part, last, how) : NULL;
    }
    name += length + !last;
  }
  return at && pags_file_exists(at) ? pags_take(&at) : NULL;
}

/* Looks for `name`, which has slashes alone, in all the ways. */
static char *search(pags_file_finder *finder, const char *folder, const char *name, pags_spelling *how) {
  const bool elsewhere = is_absolute(name) || strncmp(name, "../", 3) == 0;
  if (!is_absolute(name)) {
    char *found = follow(finder, folder, name, how);
    if (found || !elsewhere)
      return found;
  }
  /* What lay below a folder of another machine: the longest end of the path that is a file here. */
  for (const char *end = strchr(name, '/'); end; end = strchr(end + 1, '/')) {
    pags_spelling spelling = PAGS_SPELLING_FOLDER;
    char *found = end[1] ? follow(finder, folder, end + 1, &spelling) : NULL;
    if (found) {
      *how = spelling;
      return found;
    }
  }
  return NULL;
}

/* Counts a file that was found in this way, and keeps the first. */
static void count_found(pags_file_finder *finder, pags_spelling how, const char *name, const char *found) {
  if (finder->counts[how]++)
    return;
  finder->named[how] = pags_text_copy(name);
  finder->found[how] = pags_text_copy(found);
}

/* Looks for a picture that is named without its extension. */
static char *find_with_extension(pags_file_finder *finder, const char *path, const char *name) {
  static const char *const usual[] = {".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG", ".exr"};
  PAGS_AUTOFREE char *found = NULL;
  for (size_t i = 0; i < sizeof usual / sizeof *usual; i++) {
    PAGS_AUTOFREE char *longer = pags_text_format("%s%s", path, usual[i]);
    if (!longer || !pags_file_exists(longer)) /* out of memory: the search by component may still find it */
      continue;
    if (!found)
      found = pags_take(&longer);
    else if (!same_letters(found, longer, strlen(longer) + 1))
      count_found(finder, PAGS_SPELLING_SEVERAL, name, found);
  }
  return pags_take(&found);
}

pags_result pags_find_file(pags_file_finder *finder, const char *folder, const char *name, char **out, bool *exists) {
  finder->asked++;
  *out = pags_path_join(folder, pags_text_starts(name, "./") ? name + 2 : name);
  PAGS_CHECK_MEMORY(*out, "%s", name);
  *exists = pags_path_exists(*out);
  if (*exists)
    return PAGS_OK;
  char *found = pags_is_picture_name(name) ? NULL : find_with_extension(finder, *out, name);
  if (!found) {
    pags_spelling how = PAGS_SPELLING_SAME;
    PAGS_AUTOFREE char *slashes =
        pags_text_copy(pags_text_starts(name, "./") || pags_text_starts(name, ".\\") ? name + 2 : name);
    for (char *c = slashes; c && *c; c++)
      if (*c == '\\') {
        *c = '/';
        how = PAGS_SPELLING_SLASHES;
      }
    found = slashes ? search(finder, folder, slashes, &how) : NULL;
    if (!found)
      return PAGS_OK;
    count_found(finder, how, name, found);
  }
  free(*out);
  *out = found;
  *exists = true;
  return PAGS_OK;
}

char *pags_find_folder(pags_file_finder *finder, const char *folder, const char *name) {
  const char *entry = list_folder(finder, folder) ? entry_of_case(finder, name, strlen(name)) : NULL;
  return entry && pags_folder_has_folder(folder, entry) ? pags_path_join(folder, entry) : NULL;
}

void pags_file_finder_drop(pags_file_finder *finder) {
  for (int i = 0; i < PAGS_SPELLINGS; i++) {
    free(finder->named[i]);
    free(finder->found[i]);
  }
  free(finder->folder);
  pags_dir_list_destroy(&finder->list);
  memset(finder, 0, sizeof *finder);
}

void pags_file_finder_end(pags_file_finder *finder, const char *source, const char *what) {
  static const char *const ways[PAGS_SPELLINGS] = {"",
                                                   "by reading backslashes as slashes",
                                                   "below this folder, not below the one that they name",
                                                   "in other letter case",
                                                   "with another extension",
                                                   "with several extensions, of which the first is taken"};
  for (int i = PAGS_SPELLING_SAME + 1; i < PAGS_SPELLINGS; i++)
    if (finder->counts[i] && finder->named[i] && finder->found[i])
      PAGS_WARN("%s: %lld of %lld %s are found %s, the first is %s for '%s'", source, (long long)finder->counts[i],
                (long long)finder->asked, what, ways[i], finder->found[i], finder->named[i]);
  pags_file_finder_drop(finder);
}
