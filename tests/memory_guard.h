/* SPDX-License-Identifier: Apache-2.0 */
/* Counts and fails the allocations of a test program: the calls of malloc by our code and by the static libraries
 * linked into it (zlib, zstd).
 *
 * Uses the linker's --wrap, so that allocations of shared libraries aren't seen (see pags_guard_memory in
 * CMakeLists.txt). There is one watch at a time, over all threads. */
#ifndef PAGS_TESTS_MEMORY_GUARD_H
#define PAGS_TESTS_MEMORY_GUARD_H

#include <stddef.h>
#include <stdint.h>

/* Starts counting from zero. `limit`: bytes that may be allocated at once, beyond which the program is stopped with a
 * message at that allocation; 0: no limit. `fail_at`: the n-th allocation from now on, counted from 1, fails once; 0:
 * none. */
void memory_guard_begin(size_t limit, int64_t fail_at);
/* Stops counting. */
void memory_guard_end(void);

/* Wrappers of other allocators call this: it counts a request and returns whether it may proceed. */
int memory_guard_allows(size_t size);

/* Figures of the last watch. */
int64_t memory_guard_count(void); /* allocations requested */
int64_t memory_guard_live(void);  /* blocks allocated since the begin less blocks freed, including older ones */
size_t memory_guard_peak(void);   /* largest number of bytes allocated at once */

#endif
