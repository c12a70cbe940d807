/* SPDX-License-Identifier: Apache-2.0 */
/* Write locks: two processes never write to one folder or one file at the same time.
 *
 * A lock is a hidden file, .pags.lock in the folder or .NAME.pags.lock next to a file. The system keeps it locked until
 * the process ends or is killed; a file that remains locks nothing. It names the holder of the lock, for the error
 * message of the second process. Reading needs no lock. */
#ifndef PAGS_BASE_LOCK_H
#define PAGS_BASE_LOCK_H

#include <pags/base.h>
#include <stdbool.h>

#include "base/memory.h"

/* Sets the name of this process in its locks, such as "pags train"; a program calls it once, at its start. */
void pags_lock_set_holder(const char *program);

typedef struct pags_lock pags_lock;

/* Locks a folder for a writer of many files; creates it, with its parents, where it is missing. PAGS_ERROR_IO if
 * another process has locked it, with a message that names that process, or if it can't be written to. Where the file
 * system has no locks, the lock is a warning in the log. */
pags_result pags_lock_folder(const char *folder, pags_lock **out);
/* Locks one file and the files next to it that belong to it. Also fails if its folder is locked. Files of one
 * folder may be locked by several processes at the same time. */
pags_result pags_lock_file(const char *path, pags_lock **out);
/* Unlocks; removes the lock file and the empty folders that the lock has created. NULL is allowed.
 */
void pags_lock_release(pags_lock *lock);
PAGS_DEFINE_AUTO(pags_lock, pags_lock_release)

#endif
