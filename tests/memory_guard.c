/* SPDX-License-Identifier: Apache-2.0 */
/* Wrappers around malloc and related functions, with which tests are linked; see memory_guard.h. */
#include "memory_guard.h"

#ifndef _WIN32
#include <errno.h>
#include <malloc.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The linker's --wrap gives the real functions these names, and calls of malloc end in ours. */
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *block, size_t size);
void *__real_aligned_alloc(size_t alignment, size_t size);
int __real_posix_memalign(void **block, size_t alignment, size_t size);
char *__real_strdup(const char *text);
void __real_free(void *block);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *block, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size);
int __wrap_posix_memalign(void **block, size_t alignment, size_t size);
char *__wrap_strdup(const char *text);
void __wrap_free(void *block);

static atomic_int watching;
static _Atomic int64_t asked, live, bytes, peak;
static int64_t fail_number;
static size_t most;

void memory_guard_begin(size_t limit, int64_t fail_at) {
  most = limit;
  fail_number = fail_at;
  asked = live = bytes = peak = 0;
  watching = 1;
}

void memory_guard_end(void) {
  watching = 0;
}
int64_t memory_guard_count(void) {
  return asked;
}
int64_t memory_guard_live(void) {
  return live;
}
size_t memory_guard_peak(void) {
  return (size_t)peak;
}

/* Writes its message without stdio, which may itself call malloc. */
static void stop(size_t size) {
  static const char head[] = "memory_guard: more memory is asked for than the input justifies: ";
  char digits[24];
  size_t at = sizeof digits;
  digits[--at] = '\n';
  for (uint64_t rest = (uint64_t)bytes + size, first = 1; rest || first; rest /= 10, first = 0)
    digits[--at] = (char)('0' + rest % 10);
  watching = 0;
  if (write(2, head, sizeof head - 1) < 0 || write(2, digits + at, sizeof digits - at) < 0)
    _exit(70);
  abort();
}

static int allow(size_t size) {
  if (!watching)
    return 1;
  if (++asked == fail_number) {
    errno = ENOMEM;
    return 0;
  }
  if (most && (size > most || (size_t)(bytes > 0 ? bytes : 0) > most - size))
    stop(size);
  return 1;
}

int memory_guard_allows(size_t size) {
  return allow(size);
}

static void *made(void *block) {
  if (block && watching) {
    live++;
    const int64_t size = (int64_t)malloc_usable_size(block), now = atomic_fetch_add(&bytes, size) + size;
    int64_t before = peak;
    while (now > before && !atomic_compare_exchange_weak(&peak, &before, now)) {
    }
  }
  return block;
}

static void gone(void *block) {
  if (block && watching) {
    live--;
    bytes -= (int64_t)malloc_usable_size(block);
  }
}

void *__wrap_malloc(size_t size) {
  return allow(size) ? made(__real_malloc(size)) : NULL;
}

void *__wrap_calloc(size_t count, size_t size) {
  const size_t total = size && count > SIZE_MAX / size ? SIZE_MAX : count * size;
  return allow(total) ? made(__real_calloc(count, size)) : NULL;
}

void *__wrap_realloc(void *block, size_t size) {
  const size_t before = block ? malloc_usable_size(block) : 0;
  if (!allow(size > before ? size - before : 0))
    return NULL;
  void *const grown = __real_realloc(block, size);
  if (watching && block && grown) {
    live--;
    bytes -= (int64_t)before;
  }
  return made(grown);
}

void *__wrap_aligned_alloc(size_t alignment, size_t size) {
  return allow(size) ? made(__real_aligned_alloc(alignment, size)) : NULL;
}

int __wrap_posix_memalign(void **block, size_t alignment, size_t size) {
  if (!allow(size))
    return ENOMEM;
  const int result = __real_posix_memalign(block, alignment, size);
  if (result == 0)
    made(*block);
  return result;
}

char *__wrap_strdup(const char *text) {
  const size_t size = strlen(text) + 1;
  char *const copy = __wrap_malloc(size);
  return copy ? memcpy(copy, text, size) : NULL;
}

void __wrap_free(void *block) {
  gone(block);
  __real_free(block);
}

#else

/* Nothing is counted: zig's linker for Windows has no --wrap. */
void memory_guard_begin(size_t limit, int64_t fail_at) {
  (void)limit;
  (void)fail_at;
}

void memory_guard_end(void) {}

int64_t memory_guard_count(void) {
  return 0;
}

int64_t memory_guard_live(void) {
  return 0;
}

size_t memory_guard_peak(void) {
  return 0;
}

int memory_guard_allows(size_t size) {
  (void)size;
  return 1;
}

#endif
