/* SPDX-License-Identifier: Apache-2.0 */
/* What every verb shares: --threads, --json and --quiet, the pool of threads, the stream for people, the one line of
 * error. */
#ifndef PAGS_CLI_SESSION_H
#define PAGS_CLI_SESSION_H

#include "cli/options.h"
#include "cli/progress.h"

#include <pags/base.h>
#include <pags/tasks.h>
#include "base/json.h"

typedef struct pags_session {
  int threads;      /* 0: as many processors as this process may use */
  const char *json; /* file, "-" for stdout, NULL: none */
  int quiet;
  FILE *people; /* stdout, stderr when JSON goes to stdout, NULL when quiet */
  pags_tasks *tasks;
} pags_session;

/* Rows for the end of a verb's table; `owner` is the verb's struct, which has a member `session`. */
#define PAGS_SESSION_OPTIONS(owner)                                                                                   \
  PAGS_GROUP("In general"),                                                                                           \
      PAGS_VALUE("threads", 'j', INT, offsetof(owner, session.threads), 0, 256, "N", NULL,                            \
                 "0: as affinity and cgroup allow", "use so many threads; results are the same bits for any number"), \
      PAGS_TEXT("json", 0, offsetof(owner, session.json), "FILE|-", NULL,                                             \
                "write what a machine reads to FILE, or to standard output"),                                         \
      PAGS_FLAG("quiet", 'q', offsetof(owner, session.quiet), "print nothing but errors")

/* Rows for verbs that open driving sets; `where` is the offset of a pags_dataset_options. */
#define PAGS_DRIVING_OPTIONS(where)                                                                                   \
  PAGS_TEXT("kind", 0, (where) + offsetof(pags_dataset_options, kind),                                                \
            "waymo|pandaset|kitti|nuscenes|argoverse2|nuplan", "as dataset.json says",                                \
            "driving sets: read drivestudio's layout by the rules of this source"),                                   \
      PAGS_TEXT("cameras", 0, (where) + offsetof(pags_dataset_options, cameras), "LIST", "all",                       \
                "driving sets: use these cameras, numbers separated by commas"),                                      \
      PAGS_VALUE("frames", 0, SPAN, (where) + offsetof(pags_dataset_options, frame_first), 0, 0, "A-B", "time steps", \
                 "all", "driving sets: use these time steps, both ends included"),                                    \
      PAGS_TEXT("holdout-camera", 0, (where) + offsetof(pags_dataset_options, holdout_camera), "N", "none",           \
                "driving sets: hold this camera out altogether"),                                                     \
      PAGS_TEXT("ego-mask", 0, (where) + offsetof(pags_dataset_options, ego_mask), "FILE|FOLDER",                     \
                "ego_masks/C.png, else found", "driving sets: leave out what is white here, the recording car"),      \
      PAGS_TEXT("critical", 0, (where) + offsetof(pags_dataset_options, critical), "LIST",                            \
                "vehicle,pedestrian,cyclist",                                                                         \
                "driving sets: treat these kinds or classes (of semantic or of boxes) as critical"),                  \
      PAGS_TEXT("sfm", 0, (where) + offsetof(pags_dataset_options, sfm), "FOLDER", "none",                            \
                "driving sets: add the points of this COLMAP model of the same world")

/* Opens the streams, checks that --json can be written, sends the library's log lines to people, starts the threads. */
pags_result pags_session_begin(pags_session *session);

/* Frees the threads. Prints the error if `result` is one; returns the exit code. */
int pags_session_end(pags_session *session, pags_result result);

/* Prints to people if there are any. */
void pags_say(const pags_session *session, const char *format, ...) PAGS_PRINTF(2, 3);

/* Sends a finished document where --json says; nothing without --json. Destroys the writer. */
pags_result pags_session_json(const pags_session *session, pags_json_writer *writer);

/* Checks that a file of this name could be created, without leaving anything. */
pags_result pags_check_writable(const char *path);

/* Makes the folder if need be and checks that files can be created in it. `made` (may be NULL) tells whether it is new.
 */
pags_result pags_prepare_folder(const char *path, bool *made);

/* "a/b/DSC_01.JPG" -> "DSC_01" into `out`; always a plain file name. */
void pags_stem(const char *name, char *out, size_t size);

#endif
