/* SPDX-License-Identifier: Apache-2.0 */
/* Parses the texts of an importer's options that choose cameras ("0,2,3") and frames ("10-50"), and finds inputs in
 * other forms. */
#include "import/importer.h"

#include <strings.h>

#include "base/file.h"
#include "base/memory.h"

pags_import_options pags_import_options_default(void) {
  return (pags_import_options){.frame_last = -1};
}

pags_result pags_import_cameras(const char *text, int limit, int usual, int numbers[16], int *count) {
  unsigned chosen = (1U << usual) - 1;
  if (text) {
    chosen = 0;
    const char *at = text;
    for (;;) {
      char *end = NULL;
      const long number = *at >= '0' && *at <= '9' ? strtol(at, &end, 10) : -1;
      if (!end || number < 0 || number >= limit || (*end && *end != ','))
        return pags_fail(PAGS_ERROR_ARGUMENT, "cameras: expected numbers of 0..%d separated by commas, got '%s'",
                         limit - 1, text);
      if (chosen & 1U << number)
        return pags_fail(PAGS_ERROR_ARGUMENT, "cameras: %ld is named twice in '%s'", number, text);
      chosen |= 1U << number;
      if (!*end)
        break;
      at = end + 1;
    }
  }
  *count = 0;
  for (int i = 0; i < limit; i++)
    if (chosen & 1U << i)
      numbers[(*count)++] = i;
  return PAGS_OK;
}

pags_result pags_import_frames(const pags_import_options *options, int64_t count, int64_t *first, int64_t *last) {
  *first = options->frame_first;
  *last = options->frame_last < 0 || options->frame_last >= count ? count - 1 : options->frame_last;
  if (*first < 0 || *first > *last)
    return pags_fail(PAGS_ERROR_ARGUMENT, "frames: nothing is left of %lld to %lld; the source has %lld, from 0 on",
                     (long long)*first, (long long)options->frame_last, (long long)count);
  return PAGS_OK;
}

static bool ends_in(const char *name, const char *end) {
  const size_t length = strlen(name), tail = strlen(end);
  return length >= tail && !strcasecmp(name + length - tail, end);
}

/* Whether `entry` may be `name` in another form: the same but for letters, or with the same part before the first dot
 * and, where `name` has no ending, packed. */
static bool is_form_of(const char *entry, const char *name) {
  static const char *const endings[] = {".zip", ".tar", ".tgz", ".gz", ".7z", ".rar", ".bz2", ".xz", ".zst"};
  const size_t stem = strcspn(name, ".");
  if (!strcmp(entry, name) || strcspn(entry, ".") != stem || strncasecmp(entry, name, stem) != 0)
    return false;
  bool packed = false;
  for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
    packed = packed || ends_in(entry, endings[i]);
  return name[stem] || !entry[stem] || packed;
}

pags_result pags_other_form_check(const char *folder, const char *name, const char *what) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  PAGS_CHECK_MEMORY(path, "%s", folder);
  if (!pags_path_exists(path) && pags_dir_exists(folder))
    PAGS_TRY(pags_dir_list_read(folder, &list));
  for (int64_t i = 0; i < list.count; i++)
    if (is_form_of(list.names[i], name))
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s/%s: %s are read from %s; unpack, convert or rename it, or move it elsewhere to import "
                       "without %s",
                       folder, list.names[i], what, name, what);
  return PAGS_OK;
}

pags_result pags_other_files_check(const char *folder, const char *extension, const char *what) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  const char *other = NULL;
  if (pags_dir_exists(folder))
    PAGS_TRY(pags_dir_list_read(folder, &list));
  for (int64_t i = 0; i < list.count; i++) {
    const char *name = list.names[i];
    if (ends_in(name, extension))
      return PAGS_OK;
    if (!other && name[0] != '.')
      other = name;
  }
  if (!other)
    return PAGS_OK;
  return pags_fail_at(folder,
                      "has %s, but no file that ends in %s, which %s are read from; convert or unpack them, or move "
                      "the folder elsewhere to import without %s",
                      other, extension, what, what);
}
