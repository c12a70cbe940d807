/* SPDX-License-Identifier: Apache-2.0 */
/* Loads the OpenImageIO module pags_oiio.so by dlopen.
 *
 * The module is looked for beside the running program, in ../lib/pags relative to it (an installation) and in the
 * folder it was built in (tests). No path is taken from the environment, because the loaded code runs with our
 * rights. */
#include "image/module.h"

#include <stdio.h>
#include <string.h>

#ifndef PAGS_IMAGES

pags_result pags_oiio_module(const pags_oiio **out) {
  *out = NULL;
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "this build leaves it out: configure with -DPAGS_IMAGES=ON (Debian: libopenimageio-dev)");
}

#else

#include <dlfcn.h>
#include <limits.h>
#include <pthread.h>
#include <stdbool.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define MODULE_NAME "pags_oiio.so"

/* The loaded module, or why there is none. Written once under pthread_once, constant afterwards. */
static pthread_once_t once = PTHREAD_ONCE_INIT;
static const pags_oiio *table;
static char reason[512];

/* Returns whether loading the module succeeds, tried in a child process if address space is limited (ulimit -v):
 * loading brings in a hundred libraries, and some of their initialisers end the process when out of memory. */
static bool survives(const char *path) {
  struct rlimit limit;
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
    return true;
  const pid_t child = fork();
  if (child == 0) {
    close(STDERR_FILENO); /* hides the C++ runtime's messages */
    void *const module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    void *const symbol = module ? dlsym(module, PAGS_OIIO_SYMBOL) : NULL;
    pags_oiio_table_fn *function = NULL;
    memcpy(&function, &symbol, sizeof function);
    _exit(module && function && !function());
  }
  int status = 1;
  return child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static void open_module(const char *path) {
  if (access(path, F_OK) != 0)
    return;
  if (!survives(path)) {
    snprintf(reason, sizeof reason, "there is no memory for OpenImageIO within ulimit -v");
    return;
  }
  void *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (!module) {
    const char *text = dlerror();
    snprintf(reason, sizeof reason, "%s", text ? text : path);
    return;
  }
  /* ISO C has no conversion from an object pointer to a function pointer; POSIX guarantees that both have the same
   * bits, so the bits are copied. */
  void *symbol = dlsym(module, PAGS_OIIO_SYMBOL);
  pags_oiio_table_fn *function = NULL;
  memcpy(&function, &symbol, sizeof function);
  const pags_oiio *found = function ? function() : NULL;
  if (function && !found)
    snprintf(reason, sizeof reason, "there is no memory for OpenImageIO");
  else if (found && found->version == PAGS_OIIO_VERSION)
    table = found; /* never closed: OpenImageIO keeps static objects whose destructors run at exit */
  else
    snprintf(reason, sizeof reason, "%s belongs to another version of PAGS", path);
}

static void find_module(void) {
  char program[PATH_MAX];
  ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
  if (length > 0) {
    program[length] = '\0';
    char *slash = strrchr(program, '/');
    if (slash)
      *slash = '\0';
    static const char *const places[] = {"/" MODULE_NAME, "/../lib/pags/" MODULE_NAME};
    for (size_t i = 0; i < sizeof places / sizeof *places && !table; i++) {
      char path[PATH_MAX + 64];
      snprintf(path, sizeof path, "%s%s", program, places[i]);
      open_module(path);
    }
  }
  if (!table)
    open_module(PAGS_MODULE_DIR "/" MODULE_NAME);
}

pags_result pags_oiio_module(const pags_oiio **out) {
  pthread_once(&once, find_module);
  *out = table;
  if (table)
    return PAGS_OK;
  if (strncmp(reason, "there is no memory", 18) == 0)
    return pags_fail(PAGS_ERROR_MEMORY, "%s", reason);
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s; expected %s beside the program or in ../lib/pags, and OpenImageIO (Debian: libopenimageio2.4) "
                   "installed",
                   reason[0] ? reason : "the module was not found", MODULE_NAME);
}

#endif
