/* SPDX-License-Identifier: Apache-2.0 */
/* Write locks (lock.h). */
#include "base/lock.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "port/port.h"

static const char lock_name[] = PAGS_LOCK_NAME;
enum { WHO = 320 }; /* characters of a lock file's text */

struct pags_lock {
  char *path; /* of the lock file */
  int made;   /* number of folders that were created for it: its folder, and those above */
  intptr_t handle;
  bool held;
};

static char holder_name[64] = "a program with libpags";

void pags_lock_set_holder(const char *program) {
  snprintf(holder_name, sizeof holder_name, "%s", program);
}

static pags_result fail_held(const char *path, const char *where, char *holder) {
  holder[strcspn(holder, "\r\n")] = '\0'; /* one printable line: anybody may have written the lock file */
  for (char *c = holder; *c; c++)
    if ((unsigned char)*c < ' ' || *c == 127)
      *c = '?';
  return pags_fail(PAGS_ERROR_IO,
                   "%s: another process is writing %s%s%s; wait until it has ended, or give another name", path, where,
                   holder[0] ? ": " : "", holder);
}

/* ---- Locking ---- */

void pags_lock_release(pags_lock *lock) {
  if (!lock)
    return;
  if (lock->held)
    pags_port_unlock(lock->path, lock->handle);
  /* Removes the folders that the lock has created, from its own on upwards, as far as they are empty. */
  char *folder = lock->path ? pags_path_folder(lock->path) : NULL;
  for (int i = 0; folder && i < lock->made && pags_port_remove_folder(folder); i++) {
    char *const above = pags_path_folder(folder);
    free(folder);
    folder = above;
  }
  free(folder);
  free(lock->path);
  free(lock);
}

/* Takes the lock, a file in `place`; `path` is its name in messages. */
static pags_result take(pags_lock *lock, const char *path, const char *place, const char *name) {
  char self[WHO], holder[WHO] = "", host[128], since[40] = "";
  PAGS_AUTOFREE char *real = pags_port_real_path(place); /* the working directory may change meanwhile */
  lock->path = real ? pags_path_join(real, name) : NULL;
  if (!lock->path)
    return pags_fail_errno(path, "can't write there");
  const time_t now = time(NULL);
  const struct tm *const utc = gmtime(&now);
  pags_port_host_name(host, sizeof host);
  if (utc)
    strftime(since, sizeof since, ", since %Y-%m-%d %H:%M:%S UTC", utc);
  snprintf(self, sizeof self, "%s, process %lld%s%s%s\n", holder_name, (long long)pags_port_process_id(),
           host[0] ? " on " : "", host, since);
  switch (pags_port_lock(lock->path, self, &lock->handle, holder, sizeof holder)) {
    case PAGS_PORT_LOCKED: lock->held = true; return PAGS_OK;
    case PAGS_PORT_HELD: return fail_held(path, strcmp(name, lock_name) == 0 ? "there" : "it", holder);
    case PAGS_PORT_NO_LOCKS:
      pags_log_message(PAGS_LOG_WARNING,
                       "%s: the file system has no locks (%s); two programs that write there at the same time would "
                       "damage each other's files",
                       path, strerror(errno));
      return PAGS_OK;
    default: return pags_fail_errno(path, "can't write there");
  }
}

/* The number of folders, from `folder` on upwards, that aren't there. */
static int count_missing(const char *folder) {
  int count = 0;
  char *at = pags_text_copy(folder);
  while (at && !pags_dir_exists(at)) {
    const char *const name = pags_path_name(at);
    char *above = pags_path_folder(at);
    count += name[0] && strcmp(name, ".") != 0; /* a path may end in a slash */
    if (above && strcmp(above, at) == 0) {      /* a drive that isn't there */
      free(above);
      above = NULL;
    }
    free(at);
    at = above;
  }
  free(at);
  return count;
}

pags_result pags_lock_folder(const char *folder, pags_lock **out) {
  enum { TRIES = 5 };
  PAGS_AUTO(pags_lock_release_auto) pags_lock *lock = calloc(1, sizeof *lock);
  *out = NULL;
  PAGS_CHECK_MEMORY(lock, "a lock");
  pags_result result = PAGS_OK;
  for (int i = 0; i < TRIES && !lock->path; i++) { /* another process may just be removing the folder it has made */
    lock->made = count_missing(folder);
    result = pags_make_dirs(folder);
    if (result == PAGS_OK)
      result = take(lock, folder, folder, lock_name);
    if (result != PAGS_OK && lock->path && !pags_dir_exists(folder)) {
      free(lock->path);
      lock->path = NULL;
    }
  }
  PAGS_TRY(result);
  *out = pags_take(&lock);
  return PAGS_OK;
}

pags_result pags_lock_file(const char *path, pags_lock **out) {
  PAGS_AUTOFREE char *target = NULL;
  bool straight;
  *out = NULL;
  PAGS_TRY(pags_file_find_target(path, &target, &straight));
  if (straight) /* a device or a FIFO */
    return PAGS_OK;
  PAGS_AUTOFREE char *folder = pags_path_folder(target);
  PAGS_AUTOFREE char *name = pags_text_format(".%s%s", pags_path_name(target), lock_name);
  PAGS_AUTOFREE char *above = folder ? pags_path_join(folder, lock_name) : NULL;
  PAGS_AUTO(pags_lock_release_auto) pags_lock *lock = calloc(1, sizeof *lock);
  PAGS_CHECK_MEMORY(above && name && lock, "a lock");
  char holder[WHO] = "";
  if (pags_port_is_locked(above, holder, sizeof holder))
    return fail_held(path, "to its folder", holder);
  PAGS_TRY(take(lock, path, folder, name));
  *out = pags_take(&lock);
  return PAGS_OK;
}
