/* SPDX-License-Identifier: Apache-2.0 */
/* Functions on paths as text (base/file.h), without access to the file system. */
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/text.h"

char *pags_path_join(const char *folder, const char *name) {
  size_t length = strlen(folder);
  if (name[0] == '/' || length == 0)
    return pags_text_copy(name);
  int slash = folder[length - 1] != '/';
  size_t name_size = strlen(name) + 1;
  char *joined = malloc(length + (size_t)slash + name_size);
  if (!joined)
    return NULL;
  memcpy(joined, folder, length);
  if (slash)
    joined[length++] = '/';
  memcpy(joined + length, name, name_size);
  return joined;
}

const char *pags_path_name(const char *path) {
  const char *slash = strrchr(path, '/');
  return slash ? slash + 1 : path;
}

char *pags_path_folder(const char *path) {
  const char *slash = strrchr(path, '/');
  if (!slash)
    return pags_text_copy(".");
  size_t length = slash == path ? 1 : (size_t)(slash - path);
  char *folder = malloc(length + 1);
  if (!folder)
    return NULL;
  memcpy(folder, path, length);
  folder[length] = 0;
  return folder;
}

const char *pags_path_extension(const char *path) {
  const char *name = pags_path_name(path);
  const char *dot = strrchr(name, '.');
  return dot && dot != name ? dot : name + strlen(name);
}

bool pags_path_is_inside(const char *path) {
  if (path[0] == '/' || path[0] == 0)
    return false;
  for (const char *part = path; part; part = strchr(part, '/')) {
    part += *part == '/';
    if (part[0] == '.' && part[1] == '.' && (part[2] == '/' || part[2] == 0))
      return false;
  }
  return true;
}
