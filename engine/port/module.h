/* SPDX-License-Identifier: Apache-2.0 */
/* Modules: shared libraries of ours that bring in libraries of others and are loaded when they are first needed, so
 * that the program starts without those. Each exports one function, which returns its table. POSIX only. */
#ifndef PAGS_PORT_MODULE_H
#define PAGS_PORT_MODULE_H

#include <stdbool.h>

typedef struct pags_port_module {
  const void *table; /* NULL: not loaded; its first member is an int, the version */
  bool no_memory;    /* not loaded since address space is too small (ulimit -v) */
  char reason[512];  /* why it was not loaded */
} pags_port_module;

/* Returns the module's table; NULL if the module can't work. */
typedef const void *pags_port_table_fn(void);

/* Loads the module. It is searched for in the folder of the running program, in ../lib/pags relative to it (an
 * installation) and in `built_in`, the folder it was built in (tests). No path is taken from the environment, because
 * the loaded code runs with our rights. It is never closed: libraries of others keep static objects whose destructors
 * run at exit. */
void pags_port_load_module(const char *name, const char *built_in, const char *symbol, int version,
                           pags_port_module *out);

#endif
