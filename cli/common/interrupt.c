/* SPDX-License-Identifier: Apache-2.0 */
/* Interrupts. Ctrl-C and termination requests (SIGTERM, SIGHUP, SIGUSR1, SIGUSR2, SIGXCPU) cancel the current work,
 * which then saves its state. A second Ctrl-C ends the program immediately. Access to a truncated memory-mapped file
 * ends it with a message. */
#include "cli/common/progress.h"

#include "port/port.h"

/* Set to 1 by the first interrupt. */
static volatile int interrupted;
static volatile int64_t last_counted; /* when, ns */
static pags_tasks *volatile cancelled_tasks;

static void on_interrupt(bool keyboard) {
  enum { BY_CTRL_C = 130 }; /* the exit code of shells: 128 + SIGINT */
  /* One Ctrl-C may arrive as several signals, from the terminal and from a parent such as mpirun or make. */
  const int64_t now = pags_port_clock_ns(), one_press = 300000000;
  if (interrupted && keyboard && now - last_counted >= one_press)
    pags_port_exit_at_once(BY_CTRL_C);
  if (!interrupted)
    last_counted = now;
  interrupted = 1;
  if (cancelled_tasks)
    pags_tasks_cancel(cancelled_tasks);
}

void pags_interrupt_install(pags_tasks *tasks) {
  cancelled_tasks = tasks;
  pags_port_on_interrupt(on_interrupt);
  pags_port_on_lost_mapping("pags: a mapped file (.pagsz) was cut short while it was in use\n");
}

void pags_interrupt_ask(void) {
  on_interrupt(false);
}

bool pags_interrupted(void) {
  return interrupted != 0;
}

const volatile int *pags_interrupt_flag(void) {
  return &interrupted;
}
