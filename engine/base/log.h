/* SPDX-License-Identifier: Apache-2.0 */
/* Lines for the user that are not errors ("12 views left out: image missing"). The library is silent until a receiver
 * is set. */
#ifndef PAGS_BASE_LOG_H
#define PAGS_BASE_LOG_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_log_level { PAGS_LOG_DEBUG, PAGS_LOG_INFO, PAGS_LOG_WARNING } pags_log_level;

/* `line` has no newline and is valid during the call only. Called on the thread that logs, possibly several at once. */
typedef void pags_log_fn(void *user, pags_log_level level, const char *line);

/* One receiver for the process; NULL for none. To be set while no other thread works. */
PAGS_API void pags_log_set(pags_log_fn *receiver, void *user);

/* printf style, at most 1023 bytes. */
void pags_log(pags_log_level level, const char *format, ...) PAGS_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
