/* SPDX-License-Identifier: Apache-2.0 */
/* Clock, processors, memory, locale, signals and timed waits (port.h) by POSIX, for Linux and macOS. */
#ifndef _WIN32
#ifdef __linux__
#define _GNU_SOURCE /* sched_getaffinity */
#else
#define _DARWIN_C_SOURCE
#endif
#include "port/port.h"

#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>
#ifdef __linux__
#include <malloc.h>
#include <sched.h>
#else
#include <mach-o/dyld.h>
#include <mach/mach.h>
#include <sys/sysctl.h>
#include <xlocale.h>
#endif

/* ---- Clock and resources ---- */

static int64_t read_clock(clockid_t clock) {
  struct timespec now;
  clock_gettime(clock, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

int64_t pags_port_clock_ns(void) {
  return read_clock(CLOCK_MONOTONIC);
}

int64_t pags_port_thread_clock_ns(void) {
  return read_clock(CLOCK_THREAD_CPUTIME_ID);
}

int pags_port_processors(void) {
#ifdef __linux__
  /* The set must be at least as large as the kernel's, which is not known, so larger and larger ones are tried. */
  for (int cpus = 1024; cpus <= 1 << 20; cpus *= 4) {
    cpu_set_t *set = CPU_ALLOC((size_t)cpus);
    if (!set)
      break;
    const size_t bytes = CPU_ALLOC_SIZE((size_t)cpus);
    const int count = sched_getaffinity(0, bytes, set) == 0 ? CPU_COUNT_S(bytes, set) : 0;
    CPU_FREE(set);
    if (count > 0)
      return count;
  }
#endif
  const long online = sysconf(_SC_NPROCESSORS_ONLN);
  return online > 0 ? (int)online : 1;
}

uint64_t pags_port_physical_memory(void) {
#ifdef __linux__
  const long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
  return pages > 0 && page_bytes > 0 ? (uint64_t)pages * (uint64_t)page_bytes : UINT64_MAX;
#else
  uint64_t bytes = 0;
  size_t size = sizeof bytes;
  return sysctlbyname("hw.memsize", &bytes, &size, NULL, 0) == 0 && bytes ? bytes : UINT64_MAX;
#endif
}

uint64_t pags_port_peak_memory(void) {
  struct rusage usage;
  if (getrusage(RUSAGE_SELF, &usage) != 0)
    return 0;
#ifdef __linux__
  return (uint64_t)usage.ru_maxrss * 1024;
#else
  return (uint64_t)usage.ru_maxrss;
#endif
}

uint64_t pags_port_resident_memory(void) {
#ifdef __linux__
  unsigned long long pages = 0;
  FILE *file = fopen("/proc/self/statm", "r");
  const bool found = file && fscanf(file, "%*u %llu", &pages) == 1;
  if (file)
    fclose(file);
  return found ? (uint64_t)pages * (uint64_t)sysconf(_SC_PAGESIZE) : 0;
#else
  mach_task_basic_info_data_t info;
  mach_msg_type_number_t count = MACH_TASK_BASIC_INFO_COUNT;
  return task_info(mach_task_self(), MACH_TASK_BASIC_INFO, (task_info_t)&info, &count) == KERN_SUCCESS
             ? (uint64_t)info.resident_size
             : 0;
#endif
}

int64_t pags_port_process_id(void) {
  return (int64_t)getpid();
}

void pags_port_host_name(char *name, size_t size) {
  if (gethostname(name, size) != 0 || !memchr(name, '\0', size))
    name[0] = '\0';
}

bool pags_port_set_environment(const char *name, const char *value) {
  return (value ? setenv(name, value, 1) : unsetenv(name)) == 0;
}

/* ---- Locale ---- */

pags_port_locale pags_port_enter_c_locale(void) {
  pags_port_locale scope = {0};
  const locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0);
  if (c == (locale_t)0)
    return scope; /* the host's locale stays */
  scope.c = c;
  scope.previous = uselocale(c);
  return scope;
}

void pags_port_leave_c_locale(pags_port_locale scope) {
  if (!scope.c)
    return;
  uselocale(scope.previous);
  freelocale(scope.c);
}

/* ---- Signals ---- */

_Static_assert(sizeof(sigset_t) <= sizeof(((pags_port_signals *)0)->mask), "a signal mask must fit");

pags_port_signals pags_port_block_signals(void) {
  pags_port_signals before = {0};
  sigset_t all, mask;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &mask);
  memcpy(before.mask, &mask, sizeof mask);
  return before;
}

void pags_port_restore_signals(const pags_port_signals *signals) {
  sigset_t mask;
  memcpy(&mask, signals->mask, sizeof mask);
  pthread_sigmask(SIG_SETMASK, &mask, NULL);
}

/* SIGPIPE is blocked on this thread while it writes, and a signal that came meanwhile is consumed. No handler is set,
 * since that is not for a library to do. */
pags_port_signals pags_port_hold_broken_pipe(void) {
  pags_port_signals held = {0};
  sigset_t pending, pipe, mask;
  sigemptyset(&pending);
  sigpending(&pending);
  held.pending = sigismember(&pending, SIGPIPE) == 1; /* it was pending before already, and must stay so */
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  pthread_sigmask(SIG_BLOCK, &pipe, &mask);
  memcpy(held.mask, &mask, sizeof mask);
  return held;
}

void pags_port_release_broken_pipe(const pags_port_signals *held) {
  const int error = errno;
  sigset_t pipe, pending;
  int taken;
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  sigemptyset(&pending);
  sigpending(&pending);
  if (!held->pending && sigismember(&pending, SIGPIPE) == 1)
    sigwait(&pipe, &taken);
  pags_port_restore_signals(held);
  errno = error;
}

/* Installs a handler: a plain one, or one that receives the address (SA_SIGINFO). */
static void install(int signal_number, struct sigaction action) {
  sigemptyset(&action.sa_mask);
  sigaction(signal_number, &action, NULL);
}

static void (*on_interrupt)(bool keyboard);

static void interrupted(int signal_number) {
  on_interrupt(signal_number == SIGINT);
}

void pags_port_on_interrupt(void (*handler)(bool keyboard)) {
  const struct sigaction action = {.sa_handler = interrupted, .sa_flags = SA_RESTART};
  /* Queues send SIGUSR1, SIGUSR2 or SIGXCPU before a job's time is over, and mpirun hands these on. */
  static const int signals[] = {SIGINT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU};
  struct sigaction hangup;
  on_interrupt = handler;
  for (size_t i = 0; i < sizeof signals / sizeof *signals; i++)
    install(signals[i], action);
  if (sigaction(SIGHUP, NULL, &hangup) == 0 && hangup.sa_handler != SIG_IGN)
    install(SIGHUP, action);
}

void pags_port_exit_at_once(int code) {
  _exit(code);
}

static const int write_signals[] = {SIGPIPE, SIGXFSZ};
enum { WRITE_SIGNALS = sizeof write_signals / sizeof *write_signals };
static struct sigaction found[WRITE_SIGNALS]; /* as they were when the program started */
static bool writes_may_fail;

void pags_port_let_writes_fail(void) {
  for (int i = 0; i < WRITE_SIGNALS; i++) {
    sigaction(write_signals[i], NULL, &found[i]);
    signal(write_signals[i], SIG_IGN);
  }
  writes_may_fail = true;
}

static const char *lost_mapping;

static void on_bus_error(int signal_number, siginfo_t *info, void *context) {
  (void)context;
  if (info->si_code == BUS_ADRERR && write(STDERR_FILENO, lost_mapping, strlen(lost_mapping)) > 0)
    _exit(1);
  signal(signal_number, SIG_DFL);
}

void pags_port_on_lost_mapping(const char *message) {
  lost_mapping = message;
  install(SIGBUS, (struct sigaction){.sa_sigaction = on_bus_error, .sa_flags = SA_SIGINFO});
}

void pags_port_begin_program(int *argc, char ***argv) {
  (void)argc;
  (void)argv;
  for (int stream = STDIN_FILENO; stream <= STDERR_FILENO; stream++)
    if (fcntl(stream, F_GETFL) < 0) /* open takes the lowest free descriptor; other programs find it closed */
      open("/dev/null", O_RDONLY | O_CLOEXEC);
#ifdef __GLIBC__
  /* Otherwise the limit grows to the largest block that was ever freed, up to 32 MB: later blocks then lie in the heap,
   * which isn't given back, and calloc writes zeros to memory that would otherwise not be allocated until it is used.
   */
  mallopt(M_MMAP_THRESHOLD, 2 << 20);
#endif
}

bool pags_port_program_folder(char *path, size_t size) {
#ifdef __linux__
  const ssize_t length = readlink("/proc/self/exe", path, size - 1);
#else
  uint32_t room = (uint32_t)size;
  const ssize_t length = _NSGetExecutablePath(path, &room) == 0 ? (ssize_t)strlen(path) : 0;
#endif
  if (length <= 0)
    return false;
  path[length] = '\0';
  char *const slash = strrchr(path, '/');
  if (slash)
    *slash = '\0';
  return slash != NULL;
}

bool pags_port_data_folder(char *path, size_t size) {
  const char *const data = getenv("XDG_DATA_HOME"), *const home = getenv("HOME");
  const bool named = data && *data, known = named || (home && *home);
  const int length = known ? snprintf(path, size, "%s%s/pags", named ? data : home, named ? "" : "/.local/share") : -1;
  return length > 0 && (size_t)length < size;
}

void pags_port_become(const char *const *words) {
  /* Handlers are dropped when another program takes over; ignored signals stay ignored. */
  for (int i = 0; writes_may_fail && i < WRITE_SIGNALS; i++)
    sigaction(write_signals[i], &found[i], NULL);
  execvp(words[0], (char *const *)(uintptr_t)words);
  if (writes_may_fail)
    pags_port_let_writes_fail();
}

/* ---- Waiting ---- */

bool pags_port_condition_create(pthread_cond_t *condition) {
#ifdef __linux__
  pthread_condattr_t attributes;
  if (pthread_condattr_init(&attributes) != 0)
    return false;
  const bool made =
      pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC) == 0 && pthread_cond_init(condition, &attributes) == 0;
  pthread_condattr_destroy(&attributes);
  return made;
#else
  return pthread_cond_init(condition, NULL) == 0;
#endif
}

bool pags_port_condition_wait(pthread_cond_t *condition, pthread_mutex_t *lock, double seconds) {
  const double most = 1e9;
  const double wait = seconds > most ? most : seconds > 0 ? seconds : 0;
  struct timespec until = {.tv_sec = (time_t)wait};
  until.tv_nsec = (long)((wait - (double)until.tv_sec) * 1e9);
#ifdef __linux__
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  until.tv_sec += now.tv_sec;
  until.tv_nsec += now.tv_nsec;
  if (until.tv_nsec >= 1000000000) {
    until.tv_sec++;
    until.tv_nsec -= 1000000000;
  }
  return pthread_cond_timedwait(condition, lock, &until) != ETIMEDOUT;
#else
  return pthread_cond_timedwait_relative_np(condition, lock, &until) != ETIMEDOUT;
#endif
}

#else
typedef int pags_port_system_is_in_system_windows;
#endif
