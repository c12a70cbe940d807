/* SPDX-License-Identifier: Apache-2.0 */
/* Watches and fails the allocations of a test program: what our code and the archives linked into it (zlib, zstd) ask
 * malloc for.
 *
 * Works by the linker's --wrap, so shared libraries keep their own (see pags_guard_memory in CMakeLists.txt). One watch
 * at a time, over all threads. */
#ifndef PAGS_TESTS_MEMORY_GUARD_H
#define PAGS_TESTS_MEMORY_GUARD_H

#include <stddef.h>
#include <stdint.h>

/* Starts counting from nothing. `limit`: bytes that may be live at once, beyond which the program is stopped with a
 * line that says so where the allocation is; 0: none. `fail_at`: the n-th allocation from now on, from 1, is refused
 * once; 0: none. */
void memory_guard_begin(size_t limit, int64_t fail_at);
/* Stops counting. */
void memory_guard_end(void);

/* For other allocators' fronts: counts a request and says whether it goes on. */
int memory_guard_allows(size_t size);

/* Of the last watch. */
int64_t memory_guard_count(void); /* allocations asked for */
int64_t memory_guard_live(void);  /* blocks made since the begin less those freed, whatever their age */
size_t memory_guard_peak(void);   /* most bytes live at once */

#endif
