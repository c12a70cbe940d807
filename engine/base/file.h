/* SPDX-License-Identifier: Apache-2.0 */
/* Files, folders and paths: whole-file reading, atomic replacement, listing and removal. Sizes are 64 bits. Messages
 * name the path and the system's reason. */
#ifndef PAGS_BASE_FILE_H
#define PAGS_BASE_FILE_H

#include <stdbool.h>
#include <stdio.h>

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Reads a whole regular file into a block that the caller frees, with a zero byte after the end that `size` doesn't
 * count. Anything but a regular file is refused. PAGS_ERROR_IO or PAGS_ERROR_MEMORY. */
pags_result pags_file_read(const char *path, uint8_t **bytes, size_t *size);
pags_result pags_file_size(const char *path, uint64_t *size);

/* Reads the first `size` bytes of a file into `head` and zeroes the bytes beyond its end. Returns the number of bytes
 * read; 0 if it can't be read. */
size_t pags_file_head(const char *path, void *head, size_t size);

/* For PAGS_AUTO(pags_file_close) FILE *stream = NULL; */
static inline void pags_file_close(FILE **stream) {
  if (*stream)
    fclose(*stream);
}

/* Fails with PAGS_ERROR_FORMAT and the message "WHERE: ...", WHERE being a file or what of it has the fault. */
pags_result pags_fail_at(const char *where, const char *format, ...) PAGS_PRINTF(2, 3);

/* Fails with "path: what: " and the text of errno. PAGS_ERROR_IO, or PAGS_ERROR_MEMORY for ENOMEM. */
pags_result pags_fail_errno(const char *path, const char *what);

/* Writes the file to PATH.part, syncs it and renames it to PATH, so that the old file or the whole new one is at PATH
 * at any moment. On failure the part file is removed.
 *
 * A path that is no regular file is never replaced:
 * - A symbolic link is followed; its target is created or replaced as above, and the link stays. A loop is refused.
 * - A device, a FIFO or a link into /proc (/dev/stdout) is opened and written directly; a stream socket is connected
 *   to. There is no part file and no rename, and on failure the first bytes may have been written already. Opening a
 *   FIFO waits for its reader. A reader that goes away causes PAGS_ERROR_IO ("Broken pipe"), not SIGPIPE.
 * - A folder is refused. So is a file that the user may not write or, even for root, whose mode lacks write bits. */
pags_result pags_file_write(const char *path, const void *bytes, size_t size);
/* The same without syncing to disk: for rendered pictures, since these are many and can be rendered again. */
pags_result pags_file_write_unsynced(const char *path, const void *bytes, size_t size);

/* Finds the target of a write to `path`; fails if the write would be refused (see above). Opens nothing.
 * *target is `path` with symbolic links followed, freed by the caller. *straight: it would be written directly,
 * without part file and rename. */
pags_result pags_file_find_target(const char *path, char **target, bool *straight);

/* Writes a file as pags_file_write does, but in pieces: begin, any number of puts, then commit or abort. A put or
 * commit that fails has aborted already; aborting a writer that is not open does nothing. */
typedef struct pags_file_writer {
  FILE *stream;        /* NULL if the writer is not open */
  char *path, *target; /* the path as given, and with symbolic links followed */
  char *part;          /* path of the part file; NULL if the target is written directly */
} pags_file_writer;

pags_result pags_file_writer_begin(pags_file_writer *writer, const char *path);
/* For logs: each put is appended to the file at once, unbuffered; an abort closes the file and keeps its contents. */
pags_result pags_file_writer_append(pags_file_writer *writer, const char *path);
pags_result pags_file_writer_put(pags_file_writer *writer, const void *bytes, size_t size);
/* Writes over the first bytes of a part file, which has at least as many; to be followed by commit. */
pags_result pags_file_writer_put_first(pags_file_writer *writer, const void *bytes, size_t size);
pags_result pags_file_writer_commit(pags_file_writer *writer);
void pags_file_writer_abort(pags_file_writer *writer);
/* For programs: from now on puts fail with PAGS_CANCELLED as soon as *asked isn't 0, so that an incomplete file is
 * abandoned. NULL: never. */
void pags_file_stop_when(const volatile int *asked);

bool pags_file_exists(const char *path); /* a regular file, or a link to one */
bool pags_dir_exists(const char *path);
bool pags_path_exists(const char *path); /* file, folder, link or anything else of that name */
/* pags_file_exists, pags_dir_exists and pags_path_exists of FOLDER/NAME. Memory is allocated only for paths of more
 * than 1,000 characters, so that lack of memory isn't taken for a missing file. */
bool pags_folder_has(const char *folder, const char *name);
bool pags_folder_has_folder(const char *folder, const char *name);
bool pags_folder_has_entry(const char *folder, const char *name);

/* Joins "a" and "b" to "a/b"; an absolute `name` is returned as it is. Freed by the caller; NULL if out of memory. */
char *pags_path_join(const char *folder, const char *name);
/* The same into `out`, by the rules of snprintf. */
int pags_path_print(char *out, size_t size, const char *folder, const char *name);
/* Returns the part after the last slash of `path`: a pointer into `path`. */
const char *pags_path_name(const char *path);
/* Returns the part before the last slash; "." without a slash. Freed by the caller; NULL if out of memory. */
char *pags_path_folder(const char *path);
/* Returns the extension with its dot, or "": a pointer into `path`. */
const char *pags_path_extension(const char *path);
/* Returns whether `path` is relative and stays inside of the folder it is relative to: not empty, no leading slash,
 * no drive, no component "..", with '\\' as a separator, too. */
bool pags_path_is_inside(const char *path);

/* How the names of lock files end (base/lock.h), and whether a file's name is that of one; lists of folders leave them
 * out. */
#define PAGS_LOCK_NAME ".pags.lock"
bool pags_path_is_lock(const char *name);

/* Creates the folder and its parents where they are missing. */
pags_result pags_make_dirs(const char *path);

/* The names in a folder without "." and ".." and without locks (base/lock.h), sorted by bytes. */
typedef struct pags_dir_list {
  int64_t count;
  char **names;
} pags_dir_list;
pags_result pags_dir_list_read(const char *path, pags_dir_list *out);
void pags_dir_list_destroy(pags_dir_list *list); /* a zeroed list is allowed */

/* Sets *empty to whether the folder has no entries but locks; also true if there is no such folder. */
pags_result pags_dir_is_empty(const char *path, bool *empty);
/* Removes a file, or a folder with all its contents, without following links. A missing path is no error. */
pags_result pags_remove_tree(const char *path);

#ifdef __cplusplus
}
#endif
#endif
