/* SPDX-License-Identifier: Apache-2.0 */
/* Signal handlers. Ctrl-C (SIGINT) and SIGTERM cancel the work under way, which then saves its state; a second Ctrl-C
 * ends the program at once. SIGBUS on a mapped file ends it with a message. */
#include "cli/interrupt.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

/* Set to 1 by the first signal. It is an int and not a sig_atomic_t because the trainer's header, which polls it,
 * doesn't include <signal.h>; both are the same type on every system we build for. */
static volatile int interrupted;
_Static_assert(sizeof(sig_atomic_t) == sizeof(int), "the flag must be written in one piece");
static pags_tasks *volatile cancelled_tasks;

static void on_signal(int signal_number) {
  if (interrupted && signal_number == SIGINT)
    _exit(128 + signal_number);
  interrupted = 1;
  if (cancelled_tasks)
    pags_tasks_cancel(cancelled_tasks);
}

/* SIGBUS: a packed scene (.pagsz) is memory-mapped, and reading it beyond the end of a file that has since been cut
 * short raises this signal. Prints a message and exits, since nothing can be drawn then. */
static void on_bus_error(int signal_number, siginfo_t *info, void *context) {
  static const char text[] = "pags: a mapped file (.pagsz) was cut short while it was in use\n";
  (void)context;
  if (info->si_code == BUS_ADRERR && write(STDERR_FILENO, text, sizeof text - 1) > 0)
    _exit(1);
  signal(signal_number, SIG_DFL);
}

static void install_bus_error(void) {
  struct sigaction action;
  memset(&action, 0, sizeof action);
  action.sa_sigaction = on_bus_error;
  action.sa_flags = SA_SIGINFO;
  sigemptyset(&action.sa_mask);
  sigaction(SIGBUS, &action, NULL);
}

void pags_interrupt_install(pags_tasks *tasks) {
  struct sigaction action;
  memset(&action, 0, sizeof action);
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  cancelled_tasks = tasks;
  sigaction(SIGINT, &action, NULL);
  sigaction(SIGTERM, &action, NULL);
  install_bus_error();
}

bool pags_interrupted(void) {
  return interrupted != 0;
}

const volatile int *pags_interrupt_flag(void) {
  return &interrupted;
}
