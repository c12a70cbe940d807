/* SPDX-License-Identifier: Apache-2.0 */
/* Ctrl-C and SIGTERM cancel the work under way, which then saves its state; a second Ctrl-C ends the program. */
#include "cli/interrupt.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

/* sig_atomic_t is int on every system we build for; the trainer's header, which knows no signals, asks for an int. */
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

/* A packed scene is mapped: where its file ends too early by now, reading it raises this. Nothing can be drawn then. */
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
