/* SPDX-License-Identifier: Apache-2.0 */
/* Finds inputs in other forms (other_forms.h). */
#include "import/other_forms.h"

#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"

static char lower(char c) {
  return c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : c;
}

/* Whether two texts begin with the same `length` characters, capital or small. */
static bool same_letters(const char *a, const char *b, size_t length) {
  for (size_t i = 0; i < length; i++)
    if (lower(a[i]) != lower(b[i]) || !a[i])
      return false;
  return true;
}

static bool ends_in(const char *name, const char *end) {
  const size_t length = strlen(name), tail = strlen(end);
  return length >= tail && same_letters(name + length - tail, end, tail);
}

static bool is_packed(const char *name) {
  static const char *const endings[] = {".zip", ".tar", ".tgz", ".gz", ".7z", ".rar", ".bz2", ".xz", ".zst"};
  for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
    if (ends_in(name, endings[i]))
      return true;
  return false;
}

/* Whether `entry` may be `name` in another form: the same but for letters, or with the same part before the first dot
 * and, where `name` has no ending, packed. */
static bool is_form_of(const char *entry, const char *name) {
  const size_t stem = strcspn(name, ".");
  if (!strcmp(entry, name) || strcspn(entry, ".") != stem || !same_letters(entry, name, stem))
    return false;
  return name[stem] || !entry[stem] || is_packed(entry);
}

pags_result pags_other_form_check(const char *folder, const char *name, const char *what) {
  pags_dir_list list = {0};
  char *path = pags_path_join(folder, name);
  pags_result result = path ? PAGS_OK : pags_out_of_memory("%s", folder);
  if (path && !pags_path_exists(path) && pags_dir_exists(folder))
    result = pags_dir_list_read(folder, &list);
  for (int64_t i = 0; i < list.count && result == PAGS_OK; i++)
    if (is_form_of(list.names[i], name))
      result = pags_fail(PAGS_ERROR_FORMAT,
                         "%s/%s: %s are read from %s; unpack, convert or rename it, or move it elsewhere to import "
                         "without %s",
                         folder, list.names[i], what, name, what);
  pags_dir_list_destroy(&list);
  free(path);
  return result;
}

pags_result pags_other_files_check(const char *folder, const char *extension, const char *what) {
  pags_dir_list list = {0};
  const char *other = NULL;
  bool right = false;
  pags_result result = pags_dir_exists(folder) ? pags_dir_list_read(folder, &list) : PAGS_OK;
  for (int64_t i = 0; i < list.count; i++) {
    const char *name = list.names[i];
    right = right || ends_in(name, extension);
    if (!other && name[0] != '.' && !ends_in(name, extension))
      other = name;
  }
  if (result == PAGS_OK && other && !right)
    result = pags_fail(PAGS_ERROR_FORMAT,
                       "%s: has %s, but no file that ends in %s, which %s are read from; convert or unpack them, or "
                       "move the folder elsewhere to import without %s",
                       folder, other, extension, what, what);
  pags_dir_list_destroy(&list);
  return result;
}
