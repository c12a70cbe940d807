/* SPDX-License-Identifier: Apache-2.0 */
/* The error for memory that cannot be allocated, with the same wording everywhere. */
#ifndef PAGS_BASE_MEMORY_H
#define PAGS_BASE_MEMORY_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Fails with PAGS_ERROR_MEMORY and "out of memory for WHAT", or "out of memory" if `what` is NULL. WHAT is `what`
 * formatted as by printf; it names the thing that memory was needed for, with its size if known, or the file that was
 * being read or written. */
pags_result pags_out_of_memory(const char *what, ...) PAGS_PRINTF(1, 2);

#ifdef __cplusplus
}
#endif
#endif
