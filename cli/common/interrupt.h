/* SPDX-License-Identifier: Apache-2.0 */
/* Signal handling: the first Ctrl-C, SIGTERM, SIGHUP, SIGUSR1, SIGUSR2 or SIGXCPU asks for a clean stop; a Ctrl-C more
 * than 0.3 s later exits at once. */
#ifndef PAGS_CLI_INTERRUPT_H
#define PAGS_CLI_INTERRUPT_H

#include <pags/tasks.h>
#include <stdbool.h>

/* Installs the signal handlers. A signal sets the flag and, unless `tasks` is NULL, cancels its parallel loops. Pass
 * NULL for work that polls the flag and finishes its step before it stops. Must be called again with NULL before the
 * tasks are destroyed. */
void pags_interrupt_install(pags_tasks *tasks);

/* Does as if Ctrl-C had been pressed, but any number of times. */
void pags_interrupt_ask(void);

bool pags_interrupted(void);

/* Returns the flag itself, for work that polls it; non-zero after a signal. */
const volatile int *pags_interrupt_flag(void);

#endif
