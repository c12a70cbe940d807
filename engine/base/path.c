/* SPDX-License-Identifier: Apache-2.0 */
/* Functions on paths as text (base/file.h), without access to the file system. '/' separates the parts of a path; on
 * Windows '\\' does, too, and a path may begin with a drive ("C:"). */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/text.h"

#ifdef _WIN32
static const char separators[] = "/\\";
#else
static const char separators[] = "/";
#endif

static bool is_separator(char c) {
  return c && strchr(separators, c);
}

/* The length of a drive's name at the beginning of a path: 2 or 0. */
static size_t drive_length(const char *path) {
  return isalpha((unsigned char)path[0]) && path[1] == ':' ? 2 : 0;
}

static bool is_absolute(const char *path) {
#ifdef _WIN32
  if (drive_length(path))
    return true;
#endif
  return is_separator(path[0]);
}

/* The last separator of a path, or NULL. */
static const char *last_separator(const char *path) {
  const char *last = NULL;
  for (const char *at = path; *at; at++)
    if (is_separator(*at))
      last = at;
  return last;
}

int pags_path_print(char *out, size_t size, const char *folder, const char *name) {
  const size_t length = strlen(folder);
  if (is_absolute(name) || length == 0)
    return snprintf(out, size, "%s", name);
  return snprintf(out, size, "%s%s%s", folder, is_separator(folder[length - 1]) ? "" : "/", name);
}

char *pags_path_join(const char *folder, const char *name) {
  const int length = pags_path_print(NULL, 0, folder, name);
  char *path = length < 0 ? NULL : malloc((size_t)length + 1);
  if (path)
    pags_path_print(path, (size_t)length + 1, folder, name);
  return path;
}

const char *pags_path_name(const char *path) {
  const char *slash = last_separator(path);
  return slash ? slash + 1 : path;
}

char *pags_path_folder(const char *path) {
  const char *slash = last_separator(path);
  if (!slash)
    return pags_text_copy(".");
  size_t length = slash == path ? 1 : (size_t)(slash - path);
#ifdef _WIN32
  if (length == 2 && drive_length(path)) /* "C:" alone is the drive's current folder, not its root */
    length = 3;
#endif
  return pags_text_format("%.*s", (int)length, path);
}

const char *pags_path_extension(const char *path) {
  const char *name = pags_path_name(path);
  const char *dot = strrchr(name, '.');
  return dot && dot != name ? dot : name + strlen(name);
}

/* Judged as on Windows on every system: a data set or scene may have been made there, or be opened there next. */
bool pags_path_is_inside(const char *path) {
  if (path[0] == '/' || path[0] == '\\' || path[0] == 0 || drive_length(path))
    return false;
  for (const char *part = path; *part; part += part[0] != 0) {
    const size_t length = strcspn(part, "/\\");
    if (length == 2 && part[0] == '.' && part[1] == '.')
      return false;
    part += length;
  }
  return true;
}

bool pags_path_is_lock(const char *name) {
  return name[0] == '.' && pags_text_ends(name, PAGS_LOCK_NAME);
}
