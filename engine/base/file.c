/* Files as a whole, and their atomic replacement. */
#include "base/file.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.h"

pags_result pags_fail_errno(const char *path, const char *what) {
  return pags_fail(errno == ENOMEM ? PAGS_ERROR_MEMORY : PAGS_ERROR_IO, "%s: %s: %s", path, what, strerror(errno));
}

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
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for its %llu bytes", path, (unsigned long long)expected);
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

void pags_file_writer_abort(pags_file_writer *writer) {
  if (writer->stream) {
    fclose(writer->stream);
    unlink(writer->part);
  }
  free(writer->path);
  free(writer->part);
  *writer = (pags_file_writer){0};
}

static pags_result writer_fail(pags_file_writer *writer, const char *what) {
  pags_result result = pags_fail_errno(writer->path, what);
  pags_file_writer_abort(writer);
  return result;
}

pags_result pags_file_writer_begin(pags_file_writer *writer, const char *path) {
  *writer = (pags_file_writer){0};
  /* Renaming a file over a folder fails only after all has been written: say so before. */
  if (pags_dir_exists(path))
    return pags_fail(PAGS_ERROR_IO, "%s: can't write a file, a folder of that name exists", path);
  size_t length = strlen(path);
  writer->path = pags_text_copy(path);
  writer->part = malloc(length + sizeof ".part");
  if (!writer->path || !writer->part) {
    pags_file_writer_abort(writer);
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory to write it", path);
  }
  memcpy(writer->part, path, length);
  memcpy(writer->part + length, ".part", sizeof ".part");
  writer->stream = fopen(writer->part, "wb");
  return writer->stream ? PAGS_OK : writer_fail(writer, "can't write");
}

pags_result pags_file_writer_put(pags_file_writer *writer, const void *bytes, size_t size) {
  assert(writer->stream);
  if (size && fwrite(bytes, 1, size, writer->stream) != size)
    return writer_fail(writer, "can't write");
  return PAGS_OK;
}

pags_result pags_file_writer_commit(pags_file_writer *writer) {
  assert(writer->stream);
  if (fflush(writer->stream) != 0 || fsync(fileno(writer->stream)) != 0)
    return writer_fail(writer, "can't write");
  int closed = fclose(writer->stream);
  writer->stream = NULL;
  if (closed != 0 || rename(writer->part, writer->path) != 0) {
    int error = errno;
    unlink(writer->part);
    errno = error;
    return writer_fail(writer, "can't write");
  }
  pags_file_writer_abort(writer); /* closed by now: frees the names only */
  return PAGS_OK;
}

pags_result pags_file_write(const char *path, const void *bytes, size_t size) {
  pags_file_writer writer;
  PAGS_TRY(pags_file_writer_begin(&writer, path));
  PAGS_TRY(pags_file_writer_put(&writer, bytes, size));
  return pags_file_writer_commit(&writer);
}

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
