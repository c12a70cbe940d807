/* SPDX-License-Identifier: Apache-2.0 */
/* Creates, lists and removes folders (base/file.h). */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "port/port.h"

bool pags_folder_has(const char *folder, const char *name) {
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  return path && pags_file_exists(path);
}

bool pags_folder_has_folder(const char *folder, const char *name) {
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  return path && pags_dir_exists(path);
}

static pags_result fail_memory(const char *path) {
  return pags_out_of_memory("%s: its name", path);
}

pags_result pags_make_dirs(const char *path) {
  if (pags_dir_exists(path))
    return PAGS_OK;
  char *parent = pags_path_folder(path);
  if (!parent)
    return fail_memory(path);
  const bool root = strcmp(parent, path) == 0; /* also of a drive that isn't there */
  pags_result result = root ? PAGS_OK : pags_make_dirs(parent);
  if (result == PAGS_OK && !pags_port_make_folder(path) && !(errno == EEXIST && pags_dir_exists(path)))
    result = pags_fail_errno(path, "can't make the folder");
  free(parent);
  return result;
}

static int compare_names(const void *a, const void *b) {
  return strcmp(*(char *const *)a, *(char *const *)b);
}

/* Appends a copy of `name` to the list; false if out of memory. */
static bool append_name(pags_dir_list *list, int64_t *capacity, const char *name) {
  if (list->count == *capacity) {
    int64_t grown = *capacity ? *capacity * 2 : 64;
    char **names = realloc(list->names, (size_t)grown * sizeof *names);
    if (!names)
      return false;
    list->names = names;
    *capacity = grown;
  }
  list->names[list->count] = pags_text_copy(name);
  return list->names[list->count] ? ++list->count > 0 : false;
}

static pags_result read_names(const char *path, bool locks, pags_dir_list *out) {
  *out = (pags_dir_list){0};
  pags_port_folder *dir = pags_port_folder_open(path);
  if (!dir)
    return pags_fail_errno(path, "can't list the folder");
  pags_result result = PAGS_OK;
  int64_t capacity = 0;
  for (;;) {
    const char *name = pags_port_folder_next(dir);
    if (!name) {
      if (errno)
        result = pags_fail_errno(path, "can't list the folder");
      break;
    }
    if ((locks || !pags_path_is_lock(name)) && !append_name(out, &capacity, name)) {
      result = fail_memory(path);
      break;
    }
  }
  pags_port_folder_close(dir);
  if (result != PAGS_OK)
    pags_dir_list_destroy(out);
  else if (out->count)
    pags_sort(out->names, out->count, sizeof *out->names, compare_names);
  return result;
}

pags_result pags_dir_list_read(const char *path, pags_dir_list *out) {
  return read_names(path, false, out);
}

void pags_dir_list_destroy(pags_dir_list *list) {
  for (int64_t i = 0; i < list->count; i++)
    free(list->names[i]);
  free(list->names);
  *list = (pags_dir_list){0};
}

pags_result pags_dir_is_empty(const char *path, bool *empty) {
  *empty = true;
  if (!pags_path_exists(path))
    return PAGS_OK;
  pags_dir_list list;
  PAGS_TRY(pags_dir_list_read(path, &list));
  *empty = list.count == 0;
  pags_dir_list_destroy(&list);
  return PAGS_OK;
}

pags_result pags_remove_tree(const char *path) {
  pags_port_status status;
  if (!pags_port_stat(path, false, &status))
    return errno == ENOENT ? PAGS_OK : pags_fail_errno(path, "can't remove");
  if (status.kind == PAGS_PORT_FOLDER) {
    pags_dir_list list;
    PAGS_TRY(read_names(path, true, &list));
    pags_result result = PAGS_OK;
    for (int64_t i = 0; i < list.count && result == PAGS_OK; i++) {
      char *child = pags_path_join(path, list.names[i]);
      result = child ? pags_remove_tree(child) : fail_memory(path);
      free(child);
    }
    pags_dir_list_destroy(&list);
    PAGS_TRY(result);

    return pags_port_remove_folder(path) ? PAGS_OK : pags_fail_errno(path, "can't remove the folder");
  }
  return pags_port_remove_file(path) ? PAGS_OK : pags_fail_errno(path, "can't remove");
}
