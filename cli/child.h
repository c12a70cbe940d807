/* The program calling itself: a verb in a process of its own, so that its memory, its peak and its processor time are
 * its own. */
#ifndef PAGS_CLI_CHILD_H
#define PAGS_CLI_CHILD_H

#include <pags/base.h>

enum { PAGS_CHILD_WORDS = 160 };

/* Arguments after the program's name; the strings must outlive the call that runs them. */
typedef struct pags_child_words {
  int count;
  const char *items[PAGS_CHILD_WORDS];
} pags_child_words;

/* Asserts that there is room: callers know their lengths. */
void pags_child_add(pags_child_words *words, const char *word);
void pags_child_add_all(pags_child_words *words, const pags_child_words *more);

/* A line that the child wrote for people, without its end. */
typedef void pags_child_line_fn(void *user, const char *line);

typedef struct pags_child_result {
  int exit_code;      /* of the program; 128 + signal when one killed it */
  double cpu_seconds; /* user and system, all threads */
  char message[512];  /* the last line of its standard error, without "pags: " */
} pags_child_result;

/* Runs this program with `words` and waits. Its standard output comes line by line to `line` (may be NULL). Once
 * pags_interrupted(), the child is asked to stop (SIGTERM, once) and waited for; should this process die, the child
 * gets the same signal (Linux). Fails only where it can't be started. */
pags_result pags_child_run(const pags_child_words *words, pags_child_line_fn *line, void *user, pags_child_result *out);

#endif
