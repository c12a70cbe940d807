/* SPDX-License-Identifier: Apache-2.0 */
/* A library for LD_PRELOAD that makes one allocation of a rank's main thread fail. PAGS_REFUSE is the number of this
 * allocation among those of at least 64 bytes. PAGS_REFUSE_RANK is the rank in the job of Open MPI. The number of
 * allocations is written to the file that PAGS_REFUSE_COUNT names. Functions with names that begin with __libc belong
 * to glibc. */
#define _DEFAULT_SOURCE /* for syscall */
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

static long all, left; /* `left`: allocations until the one that fails; 0: none fails */

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
