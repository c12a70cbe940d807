/* SPDX-License-Identifier: Apache-2.0 */
/* Parallel loops whose items can fail. */
#ifndef PAGS_BASE_PARALLEL_H
#define PAGS_BASE_PARALLEL_H

#include <pags/base.h>
#include <pags/tasks.h>

/* As pags_parallel_for; PAGS_CANCELLED with the message "cancelled" if blocks were left undone. */
static inline pags_result pags_parallel_run(pags_tasks *tasks, int64_t count, int64_t grain, pags_block_fn *fn,
                                            void *context) {
  return pags_parallel_for(tasks, count, grain, fn, context) ? PAGS_OK : pags_fail(PAGS_CANCELLED, "cancelled");
}

/* The body of a loop: does one item as worker `worker` (see pags_block_fn). */
typedef pags_result pags_item_fn(void *context, int64_t item, int worker);

/* Calls fn for the items [0, count). If some fail, returns the failure of the first of them, by number, with its
 * message; items after it may be left undone. PAGS_CANCELLED with the message `cancelled` after pags_tasks_cancel. */
pags_result pags_parallel_try(pags_tasks *tasks, int64_t count, pags_item_fn *fn, void *context, const char *cancelled);

#endif
