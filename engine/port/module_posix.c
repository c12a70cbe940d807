/* SPDX-License-Identifier: Apache-2.0 */
/* Loads modules by dlopen (module.h). */
#ifndef _WIN32
#include "port/module.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "port/port.h"

/* Opens the module and calls its function; NULL if either fails. `opened`: whether it is a module at all. */
static const void *open_table(const char *path, const char *symbol, bool *opened) {
  void *const module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  /* ISO C has no conversion from an object pointer to a function pointer; POSIX guarantees that both have the same
   * bits, so the bits are copied. */
  void *const found = module ? dlsym(module, symbol) : NULL;
  pags_port_table_fn *function = NULL;
  memcpy(&function, &found, sizeof function);
  *opened = function != NULL;
  return function ? function() : NULL;
}

/* Returns whether loading the module succeeds, tried in a child process if address space is limited (ulimit -v):
 * loading brings in a hundred libraries, and some of their initialisers end the process when out of memory. */
static bool survives(const char *path, const char *symbol) {
  struct rlimit limit;
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
    return true;
  const pid_t child = fork();
  if (child == 0) {
    close(STDERR_FILENO); /* hides the C++ runtime's messages */
    bool opened;
    const void *table = open_table(path, symbol, &opened);
    _exit(opened && !table);
  }
  int status = 1;
  return child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static void try_path(const char *path, const char *symbol, int version, pags_port_module *out) {
  if (access(path, F_OK) != 0)
    return;
  bool opened = true;
  const bool alive = survives(path, symbol);
  const void *table = alive ? open_table(path, symbol, &opened) : NULL;
  int found = 0;
  if (table)
    memcpy(&found, table, sizeof found);
  out->no_memory = opened && !table;
  if (!opened) {
    const char *text = dlerror();
    snprintf(out->reason, sizeof out->reason, "%s", text ? text : path);
  } else if (!table)
    snprintf(out->reason, sizeof out->reason, "there is no memory for %s%s", path, alive ? "" : " within ulimit -v");
  else if (found != version)
    snprintf(out->reason, sizeof out->reason, "%s belongs to another version of PAGS", path);
  else
    out->table = table;
}

void pags_port_load_module(const char *name, const char *built_in, const char *symbol, int version,
                           pags_port_module *out) {
  char folder[PATH_MAX], path[2 * PATH_MAX];
  *out = (pags_port_module){.reason = "the module was not found"};
  static const char *const places[] = {"", "/../lib/pags"};
  const bool known = pags_port_program_folder(folder, sizeof folder);
  for (int i = 0; known && i < 2 && !out->table; i++) {
    snprintf(path, sizeof path, "%s%s/%s", folder, places[i], name);
    try_path(path, symbol, version, out);
  }
  if (!out->table) {
    snprintf(path, sizeof path, "%s/%s", built_in, name);
    try_path(path, symbol, version, out);
  }
}

#else
typedef int pags_port_modules_are_posix;
#endif
