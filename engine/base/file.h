/* SPDX-License-Identifier: Apache-2.0 */
/* Files and folders. Sizes are 64 bits; messages name the path and what the system said. */
#ifndef PAGS_BASE_FILE_H
#define PAGS_BASE_FILE_H

#include <stdbool.h>
#include <stdio.h>

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The whole file in a block that the caller frees, with a zero byte after the end that `size` doesn't count. Folders
 * are refused. PAGS_ERROR_IO or PAGS_ERROR_MEMORY. */
pags_result pags_file_read(const char *path, uint8_t **bytes, size_t *size);
pags_result pags_file_size(const char *path, uint64_t *size);

/* What errno says of `what`, which failed; PAGS_ERROR_IO, or _MEMORY for ENOMEM. */
pags_result pags_fail_errno(const char *path, const char *what);

/* Writes beside (path + ".part"), syncs, renames: at `path` lies the old file or the whole new one at any moment. On
 * failure what was written beside is removed.
 *
 * A path that is no regular file is never replaced:
 * - A link is followed, its target is made or replaced as above, and the link stays. A loop of links is refused.
 * - A device, a FIFO or a link into /proc (/dev/stdout) is opened and written straight; a socket is connected to, as a
 *   stream. Nothing lies beside, nothing is renamed, and on failure the first bytes may have gone out.
 *   Opening a FIFO waits for its reader. A reader that goes away is PAGS_ERROR_IO ("Broken pipe"), not SIGPIPE.
 * - A folder is refused, and so is what the user may not write or what has no write bit in its mode, which root is held
 *   to as well. */
pags_result pags_file_write(const char *path, const void *bytes, size_t size);
/* The same without the sync: for pictures, which are many and can be drawn again. */
pags_result pags_file_write_unsynced(const char *path, const void *bytes, size_t size);

/* Where a write to `path` would go, with the refusals above; opens nothing. `target` is `path` with its links followed,
 * freed by the caller. `straight`: no part file, no rename. */
pags_result pags_file_find_target(const char *path, char **target, bool *straight);

/* The same in pieces: begin, any number of puts, then commit or abort. A failed put or commit has aborted already;
 * abort of a writer that is not open does nothing. */
typedef struct pags_file_writer {
  FILE *stream;        /* NULL when not open */
  char *path, *target; /* as given; with its links followed */
  char *part;          /* beside the target; NULL when written straight */
} pags_file_writer;

pags_result pags_file_writer_begin(pags_file_writer *writer, const char *path);
/* For logs: each put goes to the end of the file at once, and an abort closes it and keeps what is there. */
pags_result pags_file_writer_append(pags_file_writer *writer, const char *path);
pags_result pags_file_writer_put(pags_file_writer *writer, const void *bytes, size_t size);
pags_result pags_file_writer_commit(pags_file_writer *writer);
void pags_file_writer_abort(pags_file_writer *writer);

bool pags_file_exists(const char *path); /* a regular file, or a link to one */
bool pags_dir_exists(const char *path);
bool pags_path_exists(const char *path);                    /* anything */
bool pags_folder_has(const char *folder, const char *name); /* as pags_file_exists; false when memory is out */

/* "a" + "b" -> "a/b"; an absolute b stays as it is. Freed by the caller; NULL when memory is out. */
char *pags_path_join(const char *folder, const char *name);
/* What follows the last slash; points into `path`. */
const char *pags_path_name(const char *path);
/* What precedes the last slash: "." where there is none. Freed by the caller; NULL when memory is out. */
char *pags_path_folder(const char *path);
/* Extension with the dot, "" where there is none; points into `path`. */
const char *pags_path_extension(const char *path);
/* A relative path that stays inside of the folder it is relative to: no leading slash, no "..", not empty. */
bool pags_path_is_inside(const char *path);

/* The folder and its parents; one that exists is fine. */
pags_result pags_make_dirs(const char *path);

/* Names in a folder without "." and "..", in byte order. */
typedef struct pags_dir_list {
  int64_t count;
  char **names;
} pags_dir_list;
pags_result pags_dir_list_read(const char *path, pags_dir_list *out);
void pags_dir_list_destroy(pags_dir_list *list);

/* True for a missing folder as well. */
pags_result pags_dir_is_empty(const char *path, bool *empty);
/* Removes a file or a folder with all that is in it, not following links. A missing one is fine. */
pags_result pags_remove_tree(const char *path);

#ifdef __cplusplus
}
#endif
#endif
