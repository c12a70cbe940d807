/* SPDX-License-Identifier: Apache-2.0 */
/* What is said when memory runs out: one wording everywhere. */
#ifndef PAGS_BASE_MEMORY_H
#define PAGS_BASE_MEMORY_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Fails with PAGS_ERROR_MEMORY and "out of memory for WHAT", or "out of memory" where `what` is NULL. WHAT names what
 * was to be made, with its size where that is known, or the file that was read or written. */
pags_result pags_out_of_memory(const char *what, ...) PAGS_PRINTF(1, 2);

#ifdef __cplusplus
}
#endif
#endif
