/* SPDX-License-Identifier: Apache-2.0 */
/* Files and folders (port.h) by POSIX, for Linux and macOS. */
#ifndef _WIN32
#define _XOPEN_SOURCE 700 /* realpath */
#define _DARWIN_C_SOURCE  /* O_NOFOLLOW on macOS */
#include "port/port.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

/* ---- What lies at a path ---- */

/* Closes a descriptor on a path that fails: errno stays. */
static void drop(int descriptor) {
  const int error = errno;
  close(descriptor);
  errno = error;
}

static void describe(const struct stat *from, pags_port_status *out) {
  *out = (pags_port_status){.kind = S_ISREG(from->st_mode)    ? PAGS_PORT_FILE
                                    : S_ISDIR(from->st_mode)  ? PAGS_PORT_FOLDER
                                    : S_ISLNK(from->st_mode)  ? PAGS_PORT_LINK
                                    : S_ISSOCK(from->st_mode) ? PAGS_PORT_SOCKET
                                                              : PAGS_PORT_DEVICE,
                            .size = (uint64_t)from->st_size,
                            .mode = from->st_mode & 07777};
  struct stat proc; /* links in it, like the target of /dev/stdout, lead to open descriptors */
  out->of_proc = out->kind == PAGS_PORT_LINK && stat("/proc", &proc) == 0 && from->st_dev == proc.st_dev;
}

bool pags_port_stat(const char *path, bool follow, pags_port_status *status) {
  struct stat found;
  if ((follow ? stat(path, &found) : lstat(path, &found)) != 0)
    return false;
  describe(&found, status);
  return true;
}

bool pags_port_stream_stat(FILE *stream, pags_port_status *status) {
  struct stat found;
  if (fstat(fileno(stream), &found) != 0)
    return false;
  describe(&found, status);
  return true;
}

bool pags_port_may_write(const char *path) {
  return access(path, W_OK) == 0;
}

char *pags_port_read_link(const char *path) {
  for (size_t size = 256; size <= 65536; size *= 4) {
    char *text = malloc(size);
    if (!text) {
      errno = ENOMEM;
      return NULL;
    }
    const ssize_t length = readlink(path, text, size);
    if (length >= 0 && (size_t)length < size) {
      text[length] = 0;
      return text;
    }
    const int error = length < 0 ? errno : ENAMETOOLONG;
    free(text);
    errno = error;
    if (length < 0)
      return NULL;
  }
  return NULL;
}

char *pags_port_real_path(const char *path) {
  char real[PATH_MAX];
  if (!realpath(path, real))
    return NULL;
  const size_t size = strlen(real) + 1;
  char *const copy = malloc(size);
  if (copy)
    memcpy(copy, real, size);
  else
    errno = ENOMEM;
  return copy;
}

/* ---- Streams ---- */

FILE *pags_port_open(const char *path, const char *mode) {
  return fopen(path, mode);
}

/* A stream over a descriptor, which is closed if that fails. */
static FILE *stream_of(int descriptor) {
  FILE *stream = descriptor < 0 ? NULL : fdopen(descriptor, "wb");
  if (!stream && descriptor >= 0)
    drop(descriptor);
  return stream;
}

/* Whether the path still leads to the open file. */
static bool is_at(int file, const char *path) {
  struct stat opened, there;
  return fstat(file, &opened) == 0 && lstat(path, &there) == 0 && opened.st_dev == there.st_dev &&
         opened.st_ino == there.st_ino;
}

/* Whether a lock was refused because another one holds the file; shared folders of Windows return EACCES. */
static bool is_held(int error) {
  return error == EWOULDBLOCK || error == EAGAIN || error == EACCES;
}

FILE *pags_port_open_part(const char *path) {
  enum { TRIES = 100 }; /* the file may get its own name between open and lock */
  for (int i = 0; i < TRIES; i++) {
    const int file = open(path, O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (file < 0)
      return NULL;
    const bool locked = flock(file, LOCK_EX | LOCK_NB) == 0;
    if (!locked && is_held(errno)) {
      close(file);
      break;
    }
    if (locked && !is_at(file, path)) {
      close(file);
      continue;
    }
    if (ftruncate(file, 0) == 0)
      return stream_of(file);
    drop(file);
    return NULL;
  }
  errno = EBUSY;
  return NULL;
}

bool pags_port_rename_part(FILE *stream, const char *from, const char *to) {
  const int lock = fcntl(fileno(stream), F_DUPFD_CLOEXEC, 0); /* a lock lasts until its last descriptor is closed */
  const bool done = fclose(stream) == 0 && rename(from, to) == 0;
  if (lock >= 0)
    drop(lock);
  return done;
}

static int connect_to(const char *path) {
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  if (strlen(path) >= sizeof address.sun_path) {
    errno = ENAMETOOLONG;
    return -1;
  }
  memcpy(address.sun_path, path, strlen(path) + 1);
  const int descriptor = socket(AF_UNIX, SOCK_STREAM, 0);
  if (descriptor < 0)
    return -1;
  fcntl(descriptor, F_SETFD, FD_CLOEXEC);
  if (connect(descriptor, (const struct sockaddr *)&address, sizeof address) == 0)
    return descriptor;
  drop(descriptor);
  return -1;
}

/* Regular files are opened to append, since those that come here are logs or the program's own output (/dev/stdout).
 * Devices are not: with O_APPEND a block device would be written to behind its end. */
FILE *pags_port_open_straight(const char *path) {
  struct stat status;
  const int common = O_WRONLY | O_NOCTTY | O_CLOEXEC;
  if (stat(path, &status) != 0)
    return stream_of(open(path, common | O_CREAT | O_APPEND, 0666));
  return stream_of(S_ISSOCK(status.st_mode) ? connect_to(path)
                                            : open(path, common | (S_ISREG(status.st_mode) ? O_APPEND : 0)));
}

bool pags_port_sync(FILE *stream) {
  return fsync(fileno(stream)) == 0 || errno == EINVAL || errno == EROFS || errno == ENOTSUP;
}

bool pags_port_seek(FILE *stream, int64_t offset, int whence) {
  return fseeko(stream, (off_t)offset, whence) == 0;
}

bool pags_port_is_terminal(FILE *stream) {
  return isatty(fileno(stream)) == 1;
}

bool pags_port_is_writable(FILE *stream) {
  const int flags = fcntl(fileno(stream), F_GETFL);
  return flags >= 0 && (flags & O_ACCMODE) != O_RDONLY;
}

/* ---- Names ---- */

bool pags_port_rename(const char *from, const char *to) {
  return rename(from, to) == 0;
}

bool pags_port_remove_file(const char *path) {
  return unlink(path) == 0;
}

bool pags_port_make_folder(const char *path) {
  return mkdir(path, 0777) == 0;
}

bool pags_port_remove_folder(const char *path) {
  return rmdir(path) == 0;
}

bool pags_port_try_file(char *pattern) {
  const int descriptor = mkstemp(pattern);
  if (descriptor < 0)
    return false;
  close(descriptor);
  unlink(pattern);
  return true;
}

/* A pags_port_folder is the system's own DIR. */
pags_port_folder *pags_port_folder_open(const char *path) {
  return (pags_port_folder *)opendir(path);
}

const char *pags_port_folder_next(pags_port_folder *folder) {
  for (;;) {
    errno = 0;
    const struct dirent *entry = readdir((DIR *)folder);
    if (!entry)
      return NULL;
    if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
      return entry->d_name;
  }
}

void pags_port_folder_close(pags_port_folder *folder) {
  closedir((DIR *)folder);
}

/* ---- Locks ---- */

static void read_text(int file, char *text, size_t size) {
  const ssize_t got = pread(file, text, size - 1, 0);
  text[got > 0 ? got : 0] = '\0';
}

/* flock, not fcntl: it belongs to the open file, so that no other close of the file drops it; NFS keeps it as a lock of
 * the server's. A lock counts only if its file still has the name, which the former holder may just have removed. */
pags_port_lock_state pags_port_lock(const char *path, const char *text, intptr_t *lock, char *holder, size_t size) {
  enum { TRIES = 5, TRIES_WITHOUT_HOLDER = 100 }; /* a holder may not have written its name yet */
  holder[0] = '\0';
  for (int i = 0; i < (holder[0] ? TRIES : TRIES_WITHOUT_HOLDER); i++) {
    int file = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    const bool foreign = file < 0 && errno == EACCES; /* left by another user, whose process may have ended */
    if (foreign && (file = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW)) < 0)
      errno = EACCES;
    if (file < 0)
      return PAGS_PORT_LOCK_FAILS;
    *lock = file;
    if (flock(file, LOCK_EX | LOCK_NB) == 0) {
      const bool ours = is_at(file, path);
      const bool written = ours && !foreign && ftruncate(file, 0) == 0 && pwrite(file, text, strlen(text), 0) > 0;
      (void)written; /* on a full disk the lock holds without its text */
      if (ours && (!foreign || unlink(path) != 0))
        return PAGS_PORT_LOCKED;
    } else if (is_held(errno)) {
      read_text(file, holder, size);
      nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    } else if (errno != ESTALE) {
      const int error = errno;
      if (!foreign)
        unlink(path);
      close(file);
      errno = error;
      return PAGS_PORT_NO_LOCKS;
    }
    close(file);
  }
  return PAGS_PORT_HELD;
}

void pags_port_unlock(const char *path, intptr_t lock) {
  const int file = (int)lock;
  if (is_at(file, path))
    unlink(path);
  close(file);
}

bool pags_port_is_locked(const char *path, char *holder, size_t size) {
  const int file = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (file < 0)
    return false;
  const bool held = flock(file, LOCK_SH | LOCK_NB) != 0 && is_held(errno);
  read_text(file, holder, size);
  close(file);
  return held;
}

/* ---- Mapping ---- */

bool pags_port_map(const char *path, uint64_t size, uint8_t **bytes) {
  const int file = open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0)
    return false;
  void *const map = mmap(NULL, (size_t)size, PROT_READ | PROT_WRITE, MAP_PRIVATE, file, 0);
  drop(file);
  *bytes = map == MAP_FAILED ? NULL : map;
  return map != MAP_FAILED;
}

void pags_port_unmap(uint8_t *bytes, uint64_t size) {
  munmap(bytes, (size_t)size);
}

#else
typedef int pags_port_files_are_in_files_windows;
#endif
