/* Signal handling of the program. */
#include "interrupt.h"

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

void pags_interrupt_install(pags_tasks *tasks) {
  struct sigaction action;
  memset(&action, 0, sizeof action);
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  cancelled_tasks = tasks;
  sigaction(SIGINT, &action, NULL);
  sigaction(SIGTERM, &action, NULL);
}

bool pags_interrupted(void) {
  return interrupted != 0;
}

const volatile int *pags_interrupt_flag(void) {
  return &interrupted;
}
