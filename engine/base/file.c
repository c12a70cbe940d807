/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes whole files. A regular file is written to PATH.part, which is then renamed, so that the old file
 * or the whole new one is there at any moment; devices, FIFOs and sockets are written directly. Writes end in an
 * error, not in SIGPIPE, when a reader goes away. */
#include "base/file.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/text.h"
#include "port/port.h"

pags_result pags_fail_errno(const char *path, const char *what) {
  return pags_fail(errno == ENOMEM ? PAGS_ERROR_MEMORY : PAGS_ERROR_IO, "%s: %s: %s", path, what, strerror(errno));
}

/* ---- Reading ---- */

/* Opens a regular file for reading and returns its size in bytes; anything else is refused. */
static pags_result open_regular(const char *path, FILE **stream, uint64_t *size) {
  pags_port_status status;
  *stream = pags_port_open(path, "rb");
  if (!*stream && errno == EISDIR)
    return pags_fail(PAGS_ERROR_IO, "%s: expected a file, found a folder", path);
  if (!*stream)
    return pags_fail_errno(path, "can't open");
  pags_result result = PAGS_OK;
  if (!pags_port_stream_stat(*stream, &status))
    result = pags_fail_errno(path, "can't open");
  else if (status.kind == PAGS_PORT_FOLDER)
    result = pags_fail(PAGS_ERROR_IO, "%s: expected a file, found a folder", path);
  else if (status.kind != PAGS_PORT_FILE)
    result = pags_fail(PAGS_ERROR_IO, "%s: expected a regular file", path);
  if (result != PAGS_OK) {
    fclose(*stream);
    *stream = NULL;
    return result;
  }
  *size = status.size;
  return PAGS_OK;
}

pags_result pags_file_size(const char *path, uint64_t *size) {
  FILE *stream;
  PAGS_TRY(open_regular(path, &stream, size));
  fclose(stream);
  return PAGS_OK;
}

size_t pags_file_head(const char *path, void *head, size_t size) {
  memset(head, 0, size);
  FILE *stream = pags_port_open(path, "rb");
  if (!stream)
    return 0;
  const size_t got = fread(head, 1, size, stream);
  fclose(stream);
  return got;
}

/* Fails if a file is a pointer of Git LFS ('git lfs pull' gets the content). */
static pags_result refuse_pointer(const char *path, const uint8_t *bytes, size_t size) {
  static const char begin[] = "version https://git-lfs";
  if (size < sizeof begin - 1 || memcmp(bytes, begin, sizeof begin - 1) != 0)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_FORMAT,
                   "%s: a Git LFS pointer, not the file itself: 'git lfs pull' in its repository gets that", path);
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
  const pags_result result = refuse_pointer(path, block, got);
  if (result != PAGS_OK) {
    free(block);
    return result;
  }
  *bytes = block;
  *size = got;
  return PAGS_OK;
}

/* ---- Finding the target of a write ---- */

/* Returns the path that the symbolic link `path` points to, one step only, freed by the caller; NULL with errno. */
static char *follow_link(const char *path) {
  char *to = pags_port_read_link(path);
  if (!to)
    return NULL;
  char *folder = pags_path_folder(path);
  char *next = folder ? pags_path_join(folder, to) : NULL;
  free(folder);
  free(to);
  errno = ENOMEM;
  return next;
}

pags_result pags_file_find_target(const char *path, char **target, bool *straight) {
  enum { MOST_LINKS = 40 }; /* as many as Linux follows */
  pags_port_status status;
  *target = NULL;
  *straight = false;
  const bool there = pags_port_stat(path, true, &status);
  if (!there && errno == ELOOP)
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: its links lead in a loop", path);
  if (!there && errno != ENOENT)
    return pags_fail_errno(path, "can't write");
  if (there && status.kind == PAGS_PORT_FOLDER)
    return pags_fail(PAGS_ERROR_IO, "%s: can't write a file, a folder of that name exists", path);
  /* A rename needs no permission for the file it replaces, and root may write everything: so both the mode and the
   * permission are checked, and a read-only file isn't replaced. */
  if (there && !(status.mode & 0222))
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: it is read-only (mode %04o)", path, status.mode);
  if (there && status.kind != PAGS_PORT_DEVICE && !pags_port_may_write(path))
    return pags_fail_errno(path, "can't write");
  *straight = there && status.kind != PAGS_PORT_FILE;
  char *at = pags_text_copy(path);
  for (int links = 0; at && !*straight && pags_port_stat(at, false, &status) && status.kind == PAGS_PORT_LINK;
       links++) {
    if (status.of_proc) {
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

/* ---- Writing ---- */

void pags_file_writer_abort(pags_file_writer *writer) {
  if (writer->stream) {
    const pags_port_signals held = pags_port_hold_broken_pipe();
    fclose(writer->stream);
    pags_port_release_broken_pipe(&held);
    if (writer->part)
      pags_port_remove_file(writer->part);
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
static pags_result open_part(pags_file_writer *writer) {
  pags_port_status status;
  const size_t length = strlen(writer->target);
  writer->part = malloc(length + sizeof ".part");
  if (!writer->part)
    return pags_out_of_memory("%s", writer->path);
  memcpy(writer->part, writer->target, length);
  memcpy(writer->part + length, ".part", sizeof ".part");
  if (pags_port_stat(writer->part, false, &status) && status.kind != PAGS_PORT_FILE)
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: %s is in the way; expected a regular file there or nothing",
                     writer->path, writer->part);
  writer->stream = pags_port_open_part(writer->part);
  if (!writer->stream && errno == EBUSY)
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: another process is writing it", writer->path);
  if (!writer->stream && (errno == EACCES || errno == EROFS))
    return pags_fail_errno(writer->path, "can't write into its folder");
  return writer->stream ? PAGS_OK : pags_fail_errno(writer->path, "can't write");
}

/* Opens the writer on `path`: on a part file, or directly on a file that can't be replaced or is to be appended to. */
static pags_result writer_open(pags_file_writer *writer, const char *path, bool append) {
  bool straight = false;
  *writer = (pags_file_writer){0};
  PAGS_TRY(pags_file_find_target(path, &writer->target, &straight));
  writer->path = pags_text_copy(path);
  pags_result result = writer->path ? PAGS_OK : pags_out_of_memory("%s", path);
  if (result == PAGS_OK && (straight || append)) {
    writer->stream = pags_port_open_straight(writer->target);
    result = writer->stream ? PAGS_OK : pags_fail_errno(path, "can't write");
  } else if (result == PAGS_OK) {
    result = open_part(writer);
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

static const volatile int *stop;

void pags_file_stop_when(const volatile int *asked) {
  stop = asked;
}

pags_result pags_file_writer_put(pags_file_writer *writer, const void *bytes, size_t size) {
  assert(writer->stream);
  if (stop && *stop) {
    const pags_result result = pags_fail(PAGS_CANCELLED, "%s: interrupted; nothing was written", writer->path);
    pags_file_writer_abort(writer);
    return result;
  }
  pags_port_signals held;
  if (!writer->part) /* part files raise no signal: saves system calls for many small puts */
    held = pags_port_hold_broken_pipe();
  const bool written = !size || fwrite(bytes, 1, size, writer->stream) == size;
  if (!writer->part)
    pags_port_release_broken_pipe(&held);
  return written ? PAGS_OK : writer_fail(writer, "can't write");
}

pags_result pags_file_writer_put_first(pags_file_writer *writer, const void *bytes, size_t size) {
  assert(writer->stream && writer->part);
  if (fseek(writer->stream, 0, SEEK_SET) != 0)
    return writer_fail(writer, "can't write");
  return pags_file_writer_put(writer, bytes, size);
}

/* Flushes, syncs (FIFOs and most devices cannot be synced, which is no failure), closes and, for a part file, renames
 * it to the target; on failure the part file is removed. */
static pags_result writer_finish(pags_file_writer *writer, bool sync) {
  assert(writer->stream);
  const pags_port_signals held = pags_port_hold_broken_pipe();
  bool done = fflush(writer->stream) == 0 && (!sync || pags_port_sync(writer->stream));
  if (done) {
    done = writer->part ? pags_port_rename_part(writer->stream, writer->part, writer->target)
                        : fclose(writer->stream) == 0;
    writer->stream = NULL;
    const int error = errno;
    if (!done && writer->part)
      pags_port_remove_file(writer->part);
    errno = error;
  }
  pags_port_release_broken_pipe(&held);
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
  pags_port_status status;
  return pags_port_stat(path, true, &status) && status.kind == PAGS_PORT_FILE;
}

bool pags_dir_exists(const char *path) {
  pags_port_status status;
  return pags_port_stat(path, true, &status) && status.kind == PAGS_PORT_FOLDER;
}

bool pags_path_exists(const char *path) {
  pags_port_status status;
  return pags_port_stat(path, false, &status);
}
