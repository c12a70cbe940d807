/* SPDX-License-Identifier: Apache-2.0 */
/* State and functions shared by all verbs: --threads, --json, --strict and --quiet, the thread pool, the stream for
 * messages, the warnings, the error line and the exit code. */
#ifndef PAGS_CLI_SESSION_H
#define PAGS_CLI_SESSION_H

#include "cli/common/options.h"
#include "cli/common/progress.h"

#include <pags/base.h>
#include <pags/tasks.h>
#include "base/json.h"
#include "base/lock.h"
#include "dataset/owners.h"

/* Lines of the library, without repetitions. */
typedef struct pags_lines {
  char **items;
  int64_t count, capacity;
} pags_lines;

/* The first member of every verb's struct. */
typedef struct pags_session {
  int threads;      /* 0: the number of processors that this process may use */
  const char *json; /* file, "-" for stdout, NULL: none */
  int strict, quiet;
  bool answers; /* the printed lines are the verb's result, unless --json is given */
  FILE *people; /* stream for messages to people: stdout; stderr if JSON goes to stdout; NULL if quiet */
  pags_tasks *tasks;
  pags_lines warnings, notes;
  pags_lock *lock; /* of the output folder, or file; NULL: none */
  bool parted;     /* the ranks have agreed on a failure; no collective call may follow */
} pags_session;

/* Rows for the end of a verb's option table; `owner` is the verb's struct, which has a member `session`. */
#define PAGS_SESSION_OPTIONS(owner)                                                                         \
  PAGS_GROUP("General"),                                                                                    \
      PAGS_VALUE("threads", 'j', INT, offsetof(owner, session.threads), 0, 256, "N", NULL,                  \
                 "0: as CPU affinity and cgroup allow",                                                     \
                 "Number of threads. Results are bit-identical for any number."),                           \
      PAGS_TEXT("json", 0, offsetof(owner, session.json), "FILE|-", NULL,                                   \
                "Write the results as JSON to FILE (\"-\": standard output)."),                             \
      PAGS_FLAG("strict", 0, offsetof(owner, session.strict), "Treat warnings about the input as errors."), \
      PAGS_FLAG("quiet", 'q', offsetof(owner, session.quiet), "Print only warnings and errors, on standard error.")

/* Runs a verb: parses and checks its arguments, begins the session, calls verb->run and ends the session. `arguments`:
 * the verb's struct with its defaults. Returns the exit code. */
int pags_verb_run(const pags_verb *verb, int argc, char **argv, void *arguments);

/* Chooses the message stream, checks that the --json file can be written, sends the library's notes to the message
 * stream and its warnings to standard error, and starts the threads. A standard output that is closed takes no
 * messages; it is an error where the verb's result goes there. */
pags_result pags_session_begin(pags_session *session);

/* Synchronises the ranks at the end of each piece of work: all get the result of the lowest rank that failed, and rank
 * 0 gets all warnings. The first failed piece of work must be the last. With one process it returns `result`. */
pags_result pags_session_meet(pags_session *session, pags_result result);

/* Ends the threads, prints the error message if `result` is an error, and returns the exit code. With several ranks,
 * all meet, and one prints. */
int pags_session_end(pags_session *session, pags_result result);

/* Prints to the message stream; nothing with --quiet. */
void pags_say(const pags_session *session, const char *format, ...) PAGS_PRINTF(2, 3);

/* Fails if --strict was given and there are warnings. Verbs call it once their inputs are open; pags_session_end does
 * as well. */
pags_result pags_session_check(const pags_session *session);

/* Begins the JSON document of a verb, an object; ended by pags_session_json. */
pags_json_writer pags_session_json_begin(void);

/* Adds the warnings to the JSON document, closes its object and writes it where --json says; nothing without --json.
 * Destroys the writer. */
pags_result pags_session_json(const pags_session *session, pags_json_writer *writer);

/* Checks that a file of this name could be created, without leaving one. */
pags_result pags_check_writable(const char *path);

/* Creates the folder if it is missing, checks that files can be created in it and locks it until the session ends, on
 * rank 0 alone. A folder that was created and has stayed empty is removed then. */
pags_result pags_prepare_folder(pags_session *session, const char *path);

/* Checks that a file of this name could be created, and locks it until the session ends. */
pags_result pags_prepare_file(pags_session *session, const char *path);

/* Writes the name of a view without extension into `out`: "cam0/DSC_01.JPG" -> "cam0/DSC_01". A name that leaves its
 * folder, such as "../DSC_01.JPG", is reduced to the part after the last slash. */
void pags_stem(const char *name, char *out, size_t size);

#endif
