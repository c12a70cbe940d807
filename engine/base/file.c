/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes whole files. A regular file is written to PATH.part, which is then renamed, so that the old file
 * or the whole new one is there at any moment; devices, FIFOs and sockets are written directly. Writes end in an
 * error, not in SIGPIPE, when a reader goes away. */
#include "base/file.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/text.h"

pags_result pags_fail_errno(const char *path, const char *what) {
  return pags_fail(errno == ENOMEM ? PAGS_ERROR_MEMORY : PAGS_ERROR_IO, "%s: %s: %s", path, what, strerror(errno));
}

/* ---- Reading ---- */

/* Opens a regular file for reading and returns its size in bytes; anything else is refused. */
static pags_result open_regular(const char *path, FILE **stream, uint64_t *size) {
  struct stat status;
  *stream = fopen(path, "rb");
  if (!*stream)
    return pags_fail_errno(path, "can't open");
  pags_result result = PAGS_OK;
  if (fstat(fileno(*stream), &status) != 0)
    result = pags_fail_errno(path, "can't open");
  else if (S_ISDIR(status.st_mode))
    result = pags_fail(PAGS_ERROR_IO, "%s: expected a file, found a folder", path);
  else if (!S_ISREG(status.st_mode))
    result = pags_fail(PAGS_ERROR_IO, "%s: expected a regular file", path);
  if (result != PAGS_OK) {
    fclose(*stream);
    *stream = NULL;
    return result;
  }
  *size = (uint64_t)status.st_size;
  return PAGS_OK;
}

pags_result pags_file_size(const char *path, uint64_t *size) {
  FILE *stream;
  PAGS_TRY(open_regular(path, &stream, size));
  fclose(stream);
  return PAGS_OK;
}

pags_result pags_file_read(const char *path, uint8_t **bytes, size_t *size) {
  FILE *stream;
  uint64_t expected = 0;
  *bytes = NULL;
  *size = 0;
  PAGS_TRY(open_regular(path, &stream, &expected));
  uint8_t *block = expected < SIZE_MAX ? malloc((size_t)expected + 1) : NULL;
  if (!block) {
    fclose(stream);
    return pags_out_of_memory("%s: its %llu bytes", path, (unsigned long long)expected);
  }
  size_t got = fread(block, 1, (size_t)expected, stream);
  bool failed = got != expected && ferror(stream);
  int error = errno;
  fclose(stream);
  if (got != expected) {
    free(block);
    errno = error;
    return failed
               ? pags_fail_errno(path, "can't read")
               : pags_fail(PAGS_ERROR_IO, "%s: shrank while it was read, at byte %llu", path, (unsigned long long)got);
  }
  block[got] = 0;
  *bytes = block;
  *size = got;
  return PAGS_OK;
}

/* ---- Finding the target of a write ---- */

/* Returns whether a link lies in /proc. Such links, like the target of /dev/stdout, lead to open descriptors, not to
 * paths. */
static bool is_of_proc(const struct stat *link) {
  struct stat proc;
  return stat("/proc", &proc) == 0 && link->st_dev == proc.st_dev;
}

/* Returns the path that the symbolic link `path` points to, one step only, freed by the caller; NULL with errno. */
static char *follow_link(const char *path) {
  char to[PATH_MAX];
  const ssize_t length = readlink(path, to, sizeof to);
  if (length < 0 || length == (ssize_t)sizeof to) {
    errno = length < 0 ? errno : ENAMETOOLONG;
    return NULL;
  }
  to[length] = 0;
  char *folder = pags_path_folder(path);
  char *next = folder ? pags_path_join(folder, to) : NULL;
  free(folder);
  errno = ENOMEM;
  return next;
}

pags_result pags_file_find_target(const char *path, char **target, bool *straight) {
  enum { MOST_LINKS = 40 }; /* as many as Linux follows */
  struct stat status;
  *target = NULL;
  *straight = false;
  const bool there = stat(path, &status) == 0;
  if (!there && errno == ELOOP)
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: its links lead in a loop", path);
  if (!there && errno != ENOENT)
    return pags_fail_errno(path, "can't write");
  if (there && S_ISDIR(status.st_mode))
    return pags_fail(PAGS_ERROR_IO, "%s: can't write a file, a folder of that name exists", path);
  /* A rename needs no permission for the file it replaces, and access() allows root everything: so both the mode and
   * access() are asked, and a read-only file isn't replaced. */
  if (there && !(status.st_mode & (S_IWUSR | S_IWGRP | S_IWOTH)))
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: it is read-only (mode %04o)", path,
                     (unsigned)(status.st_mode & 07777));
  if (there && access(path, W_OK) != 0)
    return pags_fail_errno(path, "can't write");
  *straight = there && !S_ISREG(status.st_mode);
  char *at = pags_text_copy(path);
  for (int links = 0; at && !*straight && lstat(at, &status) == 0 && S_ISLNK(status.st_mode); links++) {
    if (is_of_proc(&status)) {
      *straight = true;
      break;
    }
    char *next = links < MOST_LINKS ? follow_link(at) : NULL;
    if (!next) {
      free(at);
      return links < MOST_LINKS ? pags_fail_errno(path, "can't write, its link can't be read")
                                : pags_fail(PAGS_ERROR_IO, "%s: can't write: its links lead in a loop", path);
    }
    free(at);
    at = next;
  }
  if (!at)
    return pags_out_of_memory("%s", path);
  *target = at;
  return PAGS_OK;
}

/* Opens `path` for writing without a part file; connects to it if it is a socket. Returns the descriptor, -1 with
 * errno. Regular files are opened to append, since those that come here are logs or the program's own output
 * (/dev/stdout). Devices are not: with O_APPEND a block device would be written to behind its end. */
static int open_straight(const char *path) {
  struct stat status;
  const int common = O_WRONLY | O_NOCTTY | O_CLOEXEC;
  if (stat(path, &status) != 0)
    return open(path, common | O_CREAT | O_APPEND, 0666);
  if (S_ISSOCK(status.st_mode)) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path) {
      errno = ENAMETOOLONG;
      return -1;
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    const int descriptor = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (descriptor >= 0 && connect(descriptor, (const struct sockaddr *)&address, sizeof address) != 0) {
      const int error = errno;
      close(descriptor);
      errno = error;
      return -1;
    }
    return descriptor;
  }
  return open(path, common | (S_ISREG(status.st_mode) ? O_APPEND : 0));
}

/* If the reader of a FIFO or a socket goes away, a write must fail, not end the process by SIGPIPE. The signal is
 * blocked on this thread while it writes, and a signal that came meanwhile is consumed. No handler is set, since that
 * is not for a library to do. */
typedef struct held_signal {
  sigset_t before; /* signal mask before the write */
  bool pending;    /* SIGPIPE was pending before the write already: must stay so */
} held_signal;

static held_signal hold_sigpipe(void) {
  held_signal held;
  sigset_t pending, pipe;
  sigemptyset(&pending);
  sigpending(&pending);
  held.pending = sigismember(&pending, SIGPIPE) == 1;
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  pthread_sigmask(SIG_BLOCK, &pipe, &held.before);
  return held;
}

static void release_sigpipe(const held_signal *held) {
  const int error = errno;
  sigset_t pipe;
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  while (!held->pending && sigtimedwait(&pipe, NULL, &(struct timespec){0}) < 0 && errno == EINTR)
    ;
  pthread_sigmask(SIG_SETMASK, &held->before, NULL);
  errno = error;
}

/* ---- Writing ---- */

void pags_file_writer_abort(pags_file_writer *writer) {
  if (writer->stream) {
    const held_signal held = hold_sigpipe();
    fclose(writer->stream);
    release_sigpipe(&held);
    if (writer->part)
      unlink(writer->part);
  }
  free(writer->path);
  free(writer->target);
  free(writer->part);
  *writer = (pags_file_writer){0};
}

static pags_result writer_fail(pags_file_writer *writer, const char *what) {
  pags_result result = pags_fail_errno(writer->path, what);
  pags_file_writer_abort(writer);
  return result;
}

/* Opens the part file TARGET.part. One that a killed process has left is overwritten; anything else than a regular
 * file of that name is an error. */
static pags_result open_part(pags_file_writer *writer, int *descriptor) {
  struct stat status;
  const size_t length = strlen(writer->target);
  writer->part = malloc(length + sizeof ".part");
  if (!writer->part)
    return pags_out_of_memory("%s", writer->path);
  memcpy(writer->part, writer->target, length);
  memcpy(writer->part + length, ".part", sizeof ".part");
  if (lstat(writer->part, &status) == 0 && !S_ISREG(status.st_mode))
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: %s is in the way; expected a regular file there or nothing",
                     writer->path, writer->part);
  *descriptor = open(writer->part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0666);
  if (*descriptor < 0 && (errno == EACCES || errno == EROFS))
    return pags_fail_errno(writer->path, "can't write into its folder");
  return *descriptor < 0 ? pags_fail_errno(writer->path, "can't write") : PAGS_OK;
}

/* Opens the writer on `path`: on a part file, or directly on what can't be replaced or is to be appended to. */
static pags_result writer_open(pags_file_writer *writer, const char *path, bool append) {
  bool straight = false;
  int descriptor = -1;
  *writer = (pags_file_writer){0};
  PAGS_TRY(pags_file_find_target(path, &writer->target, &straight));
  writer->path = pags_text_copy(path);
  pags_result result = writer->path ? PAGS_OK : pags_out_of_memory("%s", path);
  if (result == PAGS_OK && (straight || append)) {
    descriptor = open_straight(writer->target);
    result = descriptor < 0 ? pags_fail_errno(path, "can't write") : PAGS_OK;
  } else if (result == PAGS_OK) {
    result = open_part(writer, &descriptor);
  }
  if (result == PAGS_OK) {
    writer->stream = fdopen(descriptor, "wb");
    if (!writer->stream) {
      result = pags_fail_errno(path, "can't write");
      close(descriptor);
      if (writer->part)
        unlink(writer->part);
    }
  }
  if (result != PAGS_OK)
    pags_file_writer_abort(writer);
  return result;
}

pags_result pags_file_writer_begin(pags_file_writer *writer, const char *path) {
  return writer_open(writer, path, false);
}

pags_result pags_file_writer_append(pags_file_writer *writer, const char *path) {
  PAGS_TRY(writer_open(writer, path, true));
  setvbuf(writer->stream, NULL, _IONBF, 0);
  return PAGS_OK;
}

pags_result pags_file_writer_put(pags_file_writer *writer, const void *bytes, size_t size) {
  assert(writer->stream);
  held_signal held;
  if (!writer->part) /* part files raise no signal: saves system calls for many small puts */
    held = hold_sigpipe();
  const bool written = !size || fwrite(bytes, 1, size, writer->stream) == size;
  if (!writer->part)
    release_sigpipe(&held);
  return written ? PAGS_OK : writer_fail(writer, "can't write");
}

/* Flushes the stream and, if `sync`, syncs the file to disk. FIFOs and most devices cannot be synced: no failure. */
static bool flush_and_sync(pags_file_writer *writer, bool sync) {
  if (fflush(writer->stream) != 0)
    return false;
  return !sync || fsync(fileno(writer->stream)) == 0 ||
         (!writer->part && (errno == EINVAL || errno == EROFS || errno == ENOTSUP));
}

/* Flushes, closes and, for a part file, renames it to the target; on failure the part file is removed. */
static pags_result writer_finish(pags_file_writer *writer, bool sync) {
  assert(writer->stream);
  const held_signal held = hold_sigpipe();
  bool done = flush_and_sync(writer, sync);
  if (done) {
    done = fclose(writer->stream) == 0;
    writer->stream = NULL;
    if (writer->part) {
      done = done && rename(writer->part, writer->target) == 0;
      const int error = errno;
      if (!done)
        unlink(writer->part);
      errno = error;
    }
  }
  release_sigpipe(&held);
  if (!done)
    return writer_fail(writer, "can't write");
  pags_file_writer_abort(writer); /* the stream is closed already: this only frees the names */
  return PAGS_OK;
}

pags_result pags_file_writer_commit(pags_file_writer *writer) {
  return writer_finish(writer, true);
}

static pags_result write_whole(const char *path, const void *bytes, size_t size, bool sync) {
  pags_file_writer writer;
  PAGS_TRY(pags_file_writer_begin(&writer, path));
  PAGS_TRY(pags_file_writer_put(&writer, bytes, size));
  return writer_finish(&writer, sync);
}

pags_result pags_file_write(const char *path, const void *bytes, size_t size) {
  return write_whole(path, bytes, size, true);
}

pags_result pags_file_write_unsynced(const char *path, const void *bytes, size_t size) {
  return write_whole(path, bytes, size, false);
}

/* ---- Existence ---- */

bool pags_file_exists(const char *path) {
  struct stat status;
  return stat(path, &status) == 0 && S_ISREG(status.st_mode);
}

bool pags_dir_exists(const char *path) {
  struct stat status;
  return stat(path, &status) == 0 && S_ISDIR(status.st_mode);
}

bool pags_path_exists(const char *path) {
  struct stat status;
  return lstat(path, &status) == 0;
}
