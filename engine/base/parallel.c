/* SPDX-License-Identifier: Apache-2.0 */
/* Parallel loops whose items can fail (base/parallel.h). Error messages are local to threads, so that the first failure
 * is copied. */
#include "base/parallel.h"

#include <stdatomic.h>
#include <stdio.h>

typedef struct loop {
  pags_item_fn *fn;
  void *context;
  _Atomic int64_t failed; /* number of the first item that failed; the number of items: none */
  atomic_flag lock;       /* of the members below */
  pags_result result;
  char message[1024];
} loop;

static void run_block(void *context, int64_t begin, int64_t end, int worker) {
  loop *l = context;
  for (int64_t i = begin; i < end && i < atomic_load(&l->failed); i++) {
    const pags_result result = l->fn(l->context, i, worker);
    if (result == PAGS_OK)
      continue;
    while (atomic_flag_test_and_set(&l->lock)) /* for the time of a copy, and only after failures */
      ;
    if (i < l->failed) {
      l->failed = i;
      l->result = result;
      snprintf(l->message, sizeof l->message, "%s", pags_error_message());
    }
    atomic_flag_clear(&l->lock);
  }
}

pags_result pags_parallel_try(pags_tasks *tasks, int64_t count, pags_item_fn *fn, void *context,
                              const char *cancelled) {
  loop l = {.fn = fn, .context = context, .failed = count, .lock = ATOMIC_FLAG_INIT};
  if (!pags_parallel_for(tasks, count, 1, run_block, &l))
    return pags_fail(PAGS_CANCELLED, "%s", cancelled);
  return l.result == PAGS_OK ? PAGS_OK : pags_fail(l.result, "%s", l.message);
}
