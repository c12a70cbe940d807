/* SPDX-License-Identifier: Apache-2.0 */
/* Ctrl-C and SIGTERM: the first asks for a clean stop, a second Ctrl-C exits at once. */
#ifndef PAGS_CLI_INTERRUPT_H
#define PAGS_CLI_INTERRUPT_H

#include <pags/tasks.h>
#include <stdbool.h>

/* From now on a signal sets the flag and, with `tasks` not NULL, cancels their loops. NULL suits work that must come to
 * the end of its step before it stops. Call again with NULL before the tasks are destroyed. */
void pags_interrupt_install(pags_tasks *tasks);

bool pags_interrupted(void);

/* The flag itself, for work that polls it; non-zero once a signal came. */
const volatile int *pags_interrupt_flag(void);

#endif
