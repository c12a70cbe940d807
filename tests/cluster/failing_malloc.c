/* SPDX-License-Identifier: Apache-2.0 */
/* A library for LD_PRELOAD that refuses one allocation of a process's main thread, which is a rank's own: the one with
 * the number PAGS_REFUSE of those of at least 64 bytes, if the process is the rank PAGS_REFUSE_RANK of a job of Open
 * MPI. PAGS_REFUSE_COUNT names a file that receives how many there were. The names beginning with __libc are glibc's
 * own functions. */
#define _DEFAULT_SOURCE /* syscall */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <unistd.h>

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *block, size_t size);
void *__libc_memalign(size_t alignment, size_t size);

#define SEEN __attribute__((visibility("default")))

static long all, left; /* `left`: allocations until the one that is refused; 0: none is */

__attribute__((constructor)) static void begin(void) {
  const char *const number = getenv("PAGS_REFUSE"), *const rank = getenv("PAGS_REFUSE_RANK"),
                    *const own = getenv("OMPI_COMM_WORLD_RANK");
  if (number && rank && own && atoi(rank) == atoi(own))
    all = left = atol(number);
}

__attribute__((destructor)) static void end(void) {
  const char *const path = getenv("PAGS_REFUSE_COUNT");
  FILE *const file = path && left > 0 ? fopen(path, "w") : NULL;
  if (!file)
    return;
  fprintf(file, "%ld\n", all - left);
  fclose(file);
}

static int refuses(size_t size) {
  enum { LEAST = 64 };
  if (left == 0 || size < LEAST || syscall(SYS_gettid) != getpid())
    return 0;
  if (--left > 0)
    return 0;
  errno = ENOMEM;
  return 1;
}

SEEN void *malloc(size_t size) {
  return refuses(size) ? NULL : __libc_malloc(size);
}

SEEN void *calloc(size_t count, size_t size) {
  return refuses(count * size) ? NULL : __libc_calloc(count, size);
}

SEEN void *realloc(void *block, size_t size) {
  return refuses(size) ? NULL : __libc_realloc(block, size);
}

SEEN void *aligned_alloc(size_t alignment, size_t size) {
  return refuses(size) ? NULL : __libc_memalign(alignment, size);
}
