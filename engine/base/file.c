/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes whole files. A regular file is written to PATH.part, which is then renamed, so that the old file
 * or the whole new one is there at any moment; devices, FIFOs and sockets are written directly. Writes end in an
 * error, not in SIGPIPE, when a reader goes away. */
#include "base/file.h"

#include <assert.h>
#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/text.h"
#include "port/port.h"

pags_result pags_fail_at(const char *where, const char *format, ...) {
  char text[1024];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return pags_fail(PAGS_ERROR_FORMAT, "%s: %s", where, text);
}

pags_result pags_fail_errno(const char *path, const char *what) {
  return pags_fail(errno == ENOMEM ? PAGS_ERROR_MEMORY : PAGS_ERROR_IO, "%s: %s: %s", path, what, strerror(errno));
}

/* ---- Reading ---- */

/* Opens a regular file for reading and returns its size in bytes; anything else is refused. */
static pags_result open_regular(const char *path, FILE **out, uint64_t *size) {
  pags_port_status status;
  PAGS_AUTO(pags_file_close) FILE *stream = pags_port_open(path, "rb");
  if (!stream && errno == EISDIR)
    return pags_fail(PAGS_ERROR_IO, "%s: expected a file, found a folder", path);
  if (!stream || !pags_port_stream_stat(stream, &status))
    return pags_fail_errno(path, "can't open");
  if (status.kind == PAGS_PORT_FOLDER)
    return pags_fail(PAGS_ERROR_IO, "%s: expected a file, found a folder", path);
  if (status.kind != PAGS_PORT_FILE)
    return pags_fail(PAGS_ERROR_IO, "%s: expected a regular file", path);
  *out = pags_take(&stream);
  *size = status.size;
  return PAGS_OK;
}

pags_result pags_file_size(const char *path, uint64_t *size) {
  PAGS_AUTO(pags_file_close) FILE *stream = NULL;
  return open_regular(path, &stream, size);
}

size_t pags_file_head(const char *path, void *head, size_t size) {
  memset(head, 0, size);
  PAGS_AUTO(pags_file_close) FILE *stream = pags_port_open(path, "rb");
  return stream ? fread(head, 1, size, stream) : 0;
}

pags_result pags_file_read(const char *path, uint8_t **bytes, size_t *size) {
  static const char pointer[] = "version https://git-lfs";
  PAGS_AUTO(pags_file_close) FILE *stream = NULL;
  uint64_t expected = 0;
  *bytes = NULL;
  *size = 0;
  PAGS_TRY(open_regular(path, &stream, &expected));
  PAGS_AUTOFREE uint8_t *block = expected < SIZE_MAX ? malloc((size_t)expected + 1) : NULL;
  PAGS_CHECK_MEMORY(block, "%s: its %llu bytes", path, (unsigned long long)expected);
  const size_t got = fread(block, 1, (size_t)expected, stream);
  if (got != expected)
    return ferror(stream)
               ? pags_fail_errno(path, "can't read")
               : pags_fail(PAGS_ERROR_IO, "%s: shrank while it was read, at byte %llu", path, (unsigned long long)got);
  block[got] = 0;
  if (pags_text_starts((const char *)block, pointer))
    return pags_fail(PAGS_ERROR_FORMAT,
                     "%s: a Git LFS pointer, not the file itself: 'git lfs pull' in its repository gets that", path);
  *bytes = pags_take(&block);
  *size = got;
  return PAGS_OK;
}

/* ---- Finding the target of a write ---- */

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
  PAGS_AUTOFREE char *at = pags_text_copy(path);
  for (int links = 0; at && !*straight && pags_port_stat(at, false, &status) && status.kind == PAGS_PORT_LINK;
       links++) {
    if (status.of_proc) {
      *straight = true;
      break;
    }
    if (links == MOST_LINKS)
      return pags_fail(PAGS_ERROR_IO, "%s: can't write: its links lead in a loop", path);
    PAGS_AUTOFREE char *to = pags_port_read_link(at); /* one step */
    PAGS_AUTOFREE char *folder = to ? pags_path_folder(at) : NULL;
    char *next = folder ? pags_path_join(folder, to) : NULL;
    if (to && !next)
      errno = ENOMEM;
    if (!next)
      return pags_fail_errno(path, "can't write, its link can't be read");
    free(at);
    at = next;
  }
  PAGS_CHECK_MEMORY(at, "%s", path);
  *target = pags_take(&at);
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

/* Opens the writer on `path`: directly on a file that can't be replaced or is to be appended to, else on the part file
 * TARGET.part. A part file that a killed process has left is overwritten; anything else than a regular file of that
 * name is an error. */
static pags_result writer_open(pags_file_writer *writer, const char *path, bool append) {
  bool straight = false;
  pags_port_status status;
  PAGS_AUTO(pags_file_writer_abort) pags_file_writer w = {0};
  *writer = (pags_file_writer){0};
  PAGS_TRY(pags_file_find_target(path, &w.target, &straight));
  w.path = pags_text_copy(path);
  PAGS_CHECK_MEMORY(w.path, "%s", path);
  if (!straight && !append) {
    w.part = pags_text_format("%s.part", w.target);
    PAGS_CHECK_MEMORY(w.part, "%s", path);
    if (pags_port_stat(w.part, false, &status) && status.kind != PAGS_PORT_FILE)
      return pags_fail(PAGS_ERROR_IO, "%s: can't write: %s is in the way; expected a regular file there or nothing",
                       path, w.part);
  }
  w.stream = w.part ? pags_port_open_part(w.part) : pags_port_open_straight(w.target);
  if (!w.stream && w.part && errno == EBUSY)
    return pags_fail(PAGS_ERROR_IO, "%s: can't write: another process is writing it", path);
  if (!w.stream)
    return pags_fail_errno(
        path, w.part && (errno == EACCES || errno == EROFS) ? "can't write into its folder" : "can't write");
  *writer = w;
  w = (pags_file_writer){0};
  return PAGS_OK;
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
