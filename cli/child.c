/* Starting this program again and listening to it. */
#include "child.h"

#include "interrupt.h"

#include <assert.h>
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

void pags_child_add(pags_child_words *words, const char *word) {
  assert(words->count < PAGS_CHILD_WORDS - 2); /* the program's name and the terminating NULL */
  words->items[words->count++] = word;
}

void pags_child_add_all(pags_child_words *words, const pags_child_words *more) {
  for (int i = 0; i < more->count; ++i)
    pags_child_add(words, more->items[i]);
}

/* Lines out of what comes in pieces. */
typedef struct line_reader {
  char text[512];
  size_t length;
} line_reader;

static void take_piece(line_reader *reader, const char *piece, ssize_t size, pags_child_line_fn *line, void *user) {
  for (ssize_t i = 0; i < size; ++i) {
    if (piece[i] == '\n') {
      reader->text[reader->length] = 0;
      reader->length = 0;
      if (line && reader->text[0])
        line(user, reader->text);
    } else if (reader->length < sizeof reader->text - 1) {
      reader->text[reader->length++] = piece[i];
    }
  }
}

static void remember(void *user, const char *text) {
  static const char prefix[] = "pags: ";
  pags_child_result *out = user;
  size_t skip = strncmp(text, prefix, sizeof prefix - 1) ? 0 : sizeof prefix - 1;
  size_t length = strlen(text + skip);
  if (length > sizeof out->message - 1)
    length = sizeof out->message - 1;
  memcpy(out->message, text + skip, length);
  out->message[length] = 0;
}

/* Between fork and exec: nothing but calls that are safe in a copy of a process with threads. */
static void become(char *const *arguments, const int *out, const int *error, pid_t parent) {
#ifdef __linux__
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) /* it died before the line above */
    _exit(127);
#else
  (void)parent;
#endif
  /* A group of its own: Ctrl-C on the terminal reaches the caller, who passes it on once. */
  setpgid(0, 0);
  if (dup2(out[1], STDOUT_FILENO) < 0 || dup2(error[1], STDERR_FILENO) < 0)
    _exit(127);
  close(out[0]);
  close(out[1]);
  close(error[0]);
  close(error[1]);
  execv("/proc/self/exe", arguments);
  _exit(127);
}

/* Reads both streams until they end. */
static void listen_to(pid_t child, const int ends[2], pags_child_line_fn *line, void *user, pags_child_result *out) {
  line_reader readers[2] = {{{0}, 0}, {{0}, 0}};
  struct pollfd polled[2] = {{.fd = ends[0], .events = POLLIN}, {.fd = ends[1], .events = POLLIN}};
  int open_ends = 2;
  bool told = false;
  while (open_ends > 0) {
    if (pags_interrupted() && !told) {
      kill(child, SIGTERM);
      told = true;
    }
    if (poll(polled, 2, 200) < 0 && errno != EINTR)
      break;
    for (int i = 0; i < 2; ++i) {
      char piece[4096];
      if (polled[i].fd < 0 || !(polled[i].revents & (POLLIN | POLLHUP | POLLERR)))
        continue;
      ssize_t size = read(polled[i].fd, piece, sizeof piece);
      if (size > 0) {
        take_piece(&readers[i], piece, size, i ? remember : line, i ? out : user);
      } else if (size == 0 || errno != EINTR) {
        polled[i].fd = -1;
        --open_ends;
      }
    }
  }
}

static double children_seconds(void) {
  struct rusage usage;
  getrusage(RUSAGE_CHILDREN, &usage);
  return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

static pags_result start(const pags_child_words *words, const int *out, const int *error, pid_t *child) {
  char *arguments[PAGS_CHILD_WORDS + 2] = {0};
  static char name[] = "pags";
  pid_t parent = getpid();
  arguments[0] = name;
  for (int i = 0; i < words->count; ++i)
    arguments[i + 1] = (char *)(uintptr_t)words->items[i]; /* execv's parameter lacks a const that it keeps */
  *child = fork();
  if (*child == 0)
    become(arguments, out, error, parent);
  if (*child < 0)
    return pags_fail(PAGS_ERROR_IO, "can't start a process: %s", strerror(errno));
  return PAGS_OK;
}

pags_result pags_child_run(const pags_child_words *words, pags_child_line_fn *line, void *user,
                           pags_child_result *out) {
  int output[2], error[2], status = 0;
  pid_t child;
  double before = children_seconds();
  *out = (pags_child_result){0};
  if (pipe(output) != 0)
    return pags_fail(PAGS_ERROR_IO, "can't make a pipe: %s", strerror(errno));
  if (pipe(error) != 0) {
    close(output[0]);
    close(output[1]);
    return pags_fail(PAGS_ERROR_IO, "can't make a pipe: %s", strerror(errno));
  }
  pags_result result = start(words, output, error, &child);
  close(output[1]);
  close(error[1]);
  if (result == PAGS_OK) {
    listen_to(child, (const int[2]){output[0], error[0]}, line, user, out);
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
      continue;
    out->exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    if (WIFSIGNALED(status))
      snprintf(out->message, sizeof out->message, "killed by signal %d", WTERMSIG(status));
    out->cpu_seconds = children_seconds() - before;
  }
  close(output[0]);
  close(error[0]);
  return result;
}
