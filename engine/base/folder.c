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

static bool has(const char *folder, const char *name, bool exists(const char *path)) {
  char usual[1024];
  const int length = pags_path_print(usual, sizeof usual, folder, name);
  if (length >= 0 && (size_t)length < sizeof usual)
    return exists(usual);
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  return path && exists(path);
}

bool pags_folder_has(const char *folder, const char *name) {
  return has(folder, name, pags_file_exists);
}

bool pags_folder_has_folder(const char *folder, const char *name) {
  return has(folder, name, pags_dir_exists);
}

bool pags_folder_has_entry(const char *folder, const char *name) {
  return has(folder, name, pags_path_exists);
}

pags_result pags_make_dirs(const char *path) {
  if (pags_dir_exists(path))
    return PAGS_OK;
  PAGS_AUTOFREE char *parent = pags_path_folder(path);
  PAGS_CHECK_MEMORY(parent, "%s: its name", path);
  if (strcmp(parent, path) != 0) /* equal: the root, also of a drive that isn't there */
    PAGS_TRY(pags_make_dirs(parent));
  if (!pags_port_make_folder(path) && !(errno == EEXIST && pags_dir_exists(path)))
    return pags_fail_errno(path, "can't make the folder");
  return PAGS_OK;
}

static void close_folder(pags_port_folder **folder) {
  if (*folder)
    pags_port_folder_close(*folder);
}

static pags_result read_names(const char *path, bool locks, pags_dir_list *out) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_AUTO(close_folder) pags_port_folder *folder = pags_port_folder_open(path);
  const char *name;
  int64_t capacity = 0;
  *out = (pags_dir_list){0};
  if (!folder)
    return pags_fail_errno(path, "can't list the folder");
  while ((name = pags_port_folder_next(folder))) {
    if (!locks && pags_path_is_lock(name))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&list.names, list.count + 1, &capacity, sizeof *list.names), "%s: its name", path);
    list.names[list.count] = pags_text_copy(name);
    PAGS_CHECK_MEMORY(list.names[list.count], "%s: its name", path);
    list.count++;
  }
  if (errno)
    return pags_fail_errno(path, "can't list the folder");
  pags_sort(list.names, list.count, sizeof *list.names, pags_text_compare);
  *out = list;
  list = (pags_dir_list){0};
  return PAGS_OK;
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
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(path, &list));
  *empty = list.count == 0;
  return PAGS_OK;
}

pags_result pags_remove_tree(const char *path) {
  pags_port_status status;
  if (!pags_port_stat(path, false, &status))
    return errno == ENOENT ? PAGS_OK : pags_fail_errno(path, "can't remove");
  if (status.kind != PAGS_PORT_FOLDER)
    return pags_port_remove_file(path) ? PAGS_OK : pags_fail_errno(path, "can't remove");
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(read_names(path, true, &list));
  for (int64_t i = 0; i < list.count; i++) {
    PAGS_AUTOFREE char *child = pags_path_join(path, list.names[i]);
    PAGS_CHECK_MEMORY(child, "%s: its name", path);
    PAGS_TRY(pags_remove_tree(child));
  }
  return pags_port_remove_folder(path) ? PAGS_OK : pags_fail_errno(path, "can't remove the folder");
}
