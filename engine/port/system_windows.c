/* SPDX-License-Identifier: Apache-2.0 */
/* Clock, processors, memory, locale, interrupts and timed waits (port.h) on Windows. */
#ifdef _WIN32
#include "port/windows.h"

#include <errno.h>
#include <fcntl.h>
#include <io.h>
#include <locale.h>
#include <process.h>
#include <psapi.h>
#include <shellapi.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* ---- Clock and resources ---- */

int64_t pags_port_clock_ns(void) {
  LARGE_INTEGER frequency, now;
  QueryPerformanceFrequency(&frequency);
  QueryPerformanceCounter(&now);
  return now.QuadPart / frequency.QuadPart * 1000000000 +
         now.QuadPart % frequency.QuadPart * 1000000000 / frequency.QuadPart;
}

int64_t pags_port_thread_clock_ns(void) {
  FILETIME made, ended, kernel, user; /* in units of 100 ns */
  if (!GetThreadTimes(GetCurrentThread(), &made, &ended, &kernel, &user))
    return 0;
  return 100 * (int64_t)(((uint64_t)kernel.dwHighDateTime << 32 | kernel.dwLowDateTime) +
                         ((uint64_t)user.dwHighDateTime << 32 | user.dwLowDateTime));
}

int pags_port_processors(void) {
  DWORD_PTR process = 0, system = 0;
  int count = 0;
  if (GetActiveProcessorGroupCount() > 1) /* the mask is of one group of 64 */
    return (int)GetActiveProcessorCount(ALL_PROCESSOR_GROUPS);
  if (GetProcessAffinityMask(GetCurrentProcess(), &process, &system))
    for (; process; process &= process - 1)
      count++;
  return count > 0 ? count : 1;
}

uint64_t pags_port_physical_memory(void) {
  MEMORYSTATUSEX status = {.dwLength = sizeof status};
  return GlobalMemoryStatusEx(&status) ? status.ullTotalPhys : UINT64_MAX;
}

static bool memory_counters(PROCESS_MEMORY_COUNTERS *counters) {
  counters->cb = sizeof *counters;
  return K32GetProcessMemoryInfo(GetCurrentProcess(), counters, sizeof *counters) != 0;
}

uint64_t pags_port_peak_memory(void) {
  PROCESS_MEMORY_COUNTERS counters;
  return memory_counters(&counters) ? counters.PeakWorkingSetSize : 0;
}

uint64_t pags_port_resident_memory(void) {
  PROCESS_MEMORY_COUNTERS counters;
  return memory_counters(&counters) ? counters.WorkingSetSize : 0;
}

int64_t pags_port_process_id(void) {
  return (int64_t)GetCurrentProcessId();
}

void pags_port_host_name(char *name, size_t size) {
  wchar_t wide[MAX_COMPUTERNAME_LENGTH + 1];
  DWORD length = MAX_COMPUTERNAME_LENGTH + 1;
  char *narrow = GetComputerNameW(wide, &length) ? pags_port_narrow(wide) : NULL;
  const size_t bytes = narrow ? strlen(narrow) + 1 : 1;
  memcpy(name, narrow && bytes <= size ? narrow : "", narrow && bytes <= size ? bytes : 1);
  free(narrow);
}

bool pags_port_set_environment(const char *name, const char *value) {
  return _putenv_s(name, value ? value : "") == 0;
}

/* ---- Locale ---- */

pags_port_locale pags_port_enter_c_locale(void) {
  pags_port_locale scope = {0};
  const int before = _configthreadlocale(_ENABLE_PER_THREAD_LOCALE);
  const char *name = setlocale(LC_NUMERIC, NULL);
  scope.previous = name ? _strdup(name) : NULL;
  if (scope.previous && setlocale(LC_NUMERIC, "C"))
    scope.c = (void *)(intptr_t)(before + 16); /* any number but 0 */
  else
    free(scope.previous);
  return scope;
}

void pags_port_leave_c_locale(pags_port_locale scope) {
  if (!scope.c)
    return;
  setlocale(LC_NUMERIC, scope.previous);
  free(scope.previous);
  _configthreadlocale((int)(intptr_t)scope.c - 16);
}

/* ---- Signals: none to block; a write to a broken pipe fails ---- */

pags_port_signals pags_port_block_signals(void) {
  return (pags_port_signals){0};
}

void pags_port_restore_signals(const pags_port_signals *signals) {
  (void)signals;
}

pags_port_signals pags_port_hold_broken_pipe(void) {
  return (pags_port_signals){0};
}

void pags_port_release_broken_pipe(const pags_port_signals *held) {
  (void)held;
}

static void (*on_interrupt)(bool keyboard);

static BOOL WINAPI interrupted(DWORD event) {
  on_interrupt(event == CTRL_C_EVENT || event == CTRL_BREAK_EVENT);
  if (event != CTRL_C_EVENT && event != CTRL_BREAK_EVENT)
    Sleep(
        10000); /* the console closes or the user logs off: the process ends on return, so the work gets time to save */
  return TRUE;
}

void pags_port_on_interrupt(void (*handler)(bool keyboard)) {
  on_interrupt = handler;
  SetConsoleCtrlHandler(interrupted, TRUE);
}

void pags_port_exit_at_once(int code) {
  _exit(code);
}

void pags_port_let_writes_fail(void) {}

static const char *lost_mapping;

static LONG WINAPI on_exception(EXCEPTION_POINTERS *exception) {
  DWORD written;
  if (exception->ExceptionRecord->ExceptionCode != EXCEPTION_IN_PAGE_ERROR)
    return EXCEPTION_CONTINUE_SEARCH;
  WriteFile(GetStdHandle(STD_ERROR_HANDLE), lost_mapping, (DWORD)strlen(lost_mapping), &written, NULL);
  _exit(1);
}

void pags_port_on_lost_mapping(const char *message) {
  lost_mapping = message;
  AddVectoredExceptionHandler(0, on_exception);
}

void pags_port_begin_program(int *argc, char ***argv) {
  int count = 0;
  wchar_t **wide = CommandLineToArgvW(GetCommandLineW(), &count);
  char **narrow = wide ? calloc((size_t)count + 1, sizeof *narrow) : NULL;
  SetConsoleOutputCP(CP_UTF8);
  _setmode(_fileno(stdin), _O_BINARY);
  _setmode(_fileno(stdout), _O_BINARY); /* else each line break becomes two characters */
  _setmode(_fileno(stderr), _O_BINARY);
  if (!narrow)
    return;
  for (int i = 0; i < count; i++)
    if (!(narrow[i] = pags_port_narrow(wide[i])))
      return; /* out of memory: the arguments stay as they are */
  LocalFree(wide);
  *argc = count;
  *argv = narrow; /* lives as long as the program */
}

bool pags_port_program_folder(char *path, size_t size) {
  enum { LONGEST = 32768 }; /* characters of a path */
  AUTO_WIDE *wide = malloc(LONGEST * sizeof *wide);
  const DWORD length = wide ? GetModuleFileNameW(NULL, wide, LONGEST) : 0;
  char *const narrow = length > 0 && length < LONGEST ? pags_port_narrow(wide) : NULL;
  char *const slash = narrow ? strrchr(narrow, '\\') : NULL;
  const bool fits = slash && (size_t)(slash - narrow) < size;
  if (fits) {
    memcpy(path, narrow, (size_t)(slash - narrow));
    path[slash - narrow] = '\0';
  }
  free(narrow);
  return fits;
}

bool pags_port_data_folder(char *path, size_t size) {
  const wchar_t *const wide = _wgetenv(L"LOCALAPPDATA");
  char *const narrow = wide && *wide ? pags_port_narrow(wide) : NULL;
  const int length = narrow ? snprintf(path, size, "%s/pags", narrow) : -1;
  free(narrow);
  return length > 0 && (size_t)length < size;
}

/* Writes an argument so that a program that parses its command line by the rules of the C library gets it back: in
 * quotes, with backslashes doubled where they precede a quote. */
static char *quote(const char *word) {
  char *out = malloc(2 * strlen(word) + 3), *at = out;
  if (!out)
    return NULL;
  *at++ = '"';
  for (size_t slashes = 0;; word++) {
    if (*word == '\\') {
      slashes++;
    } else {
      for (size_t i = 0; (*word == '"' || !*word) && i < slashes; i++)
        *at++ = '\\';
      slashes = 0;
      if (*word == '"')
        *at++ = '\\';
    }
    if (!*word)
      break;
    *at++ = *word;
  }
  *at++ = '"';
  *at = '\0';
  return out;
}

static void leave_to_the_other(bool keyboard) {
  (void)keyboard;
}

void pags_port_become(const char *const *words) {
  size_t count = 0;
  while (words[count])
    count++;
  wchar_t *program = pags_port_wide(words[0]), **wide = calloc(count + 1, sizeof *wide);
  bool right = program && wide;
  for (size_t i = 0; right && i < count; i++) {
    char *quoted = quote(words[i]);
    right = quoted && (wide[i] = pags_port_wide(quoted));
    free(quoted);
  }
  pags_port_on_interrupt(leave_to_the_other); /* Ctrl-C reaches both; the other one ends first */
  const intptr_t code = right ? _wspawnvp(_P_WAIT, program, (const wchar_t *const *)wide) : -1;
  if (code != -1)
    exit((int)code);
}

/* ---- Waiting ---- */

bool pags_port_condition_create(pthread_cond_t *condition) {
  return pthread_cond_init(condition, NULL) == 0;
}

/* The system's clock may be set meanwhile, so a wait may be longer or shorter; callers look at their own clock. */
bool pags_port_condition_wait(pthread_cond_t *condition, pthread_mutex_t *lock, double seconds) {
  const double wait = seconds > 1e9 ? 1e9 : seconds > 0 ? seconds : 0;
  struct timespec until;
  clock_gettime(CLOCK_REALTIME, &until);
  until.tv_sec += (time_t)wait;
  until.tv_nsec += (long)((wait - (double)(time_t)wait) * 1e9);
  if (until.tv_nsec >= 1000000000) {
    until.tv_sec++;
    until.tv_nsec -= 1000000000;
  }
  return pthread_cond_timedwait(condition, lock, &until) != ETIMEDOUT;
}

#else
typedef int pags_port_system_is_in_system_posix;
#endif
