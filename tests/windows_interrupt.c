/* SPDX-License-Identifier: Apache-2.0 */
/* windows_interrupt WHEN PROGRAM [ARGUMENT...]: starts the program, presses Ctrl-C in its console and returns its
 * exit code. 125: the program ended before; 126: it couldn't be started or has no console. WHEN is a number of seconds,
 * or the path of a file for which to wait. */
#define WIN32_LEAN_AND_MEAN
#include <windows.h>

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <wchar.h>

/* Returns the rest of the command line after two words; words in quotes may contain blanks. */
static wchar_t *skip_two_words(wchar_t *at) {
  for (int word = 0; word < 2; word++) {
    int quoted = 0;
    for (; *at && (quoted || *at != L' '); at++)
      quoted ^= *at == L'"';
    while (*at == L' ')
      at++;
  }
  return at;
}

/* Waits for the time to press Ctrl-C; returns false if the program ends before. */
static bool wait_for(const char *when, HANDLE program) {
  char *end;
  const double seconds = strtod(when, &end);
  if (!*end)
    return WaitForSingleObject(program, (DWORD)(1000 * seconds)) == WAIT_TIMEOUT;
  while (GetFileAttributesA(when) == INVALID_FILE_ATTRIBUTES)
    if (WaitForSingleObject(program, 20) != WAIT_TIMEOUT)
      return false;
  return true;
}

int main(int argc, char **argv) {
  STARTUPINFOW startup = {.cb = sizeof startup};
  PROCESS_INFORMATION process;
  DWORD code = 126;
  if (argc < 3) {
    fprintf(stderr, "usage: %s WHEN PROGRAM [ARGUMENT...]\n", argv[0]);
    return 2;
  }
  if (!GetConsoleCP())
    AllocConsole(); /* Ctrl-C goes to all programs of the same console */
  if (!CreateProcessW(NULL, skip_two_words(GetCommandLineW()), NULL, NULL, TRUE, 0, NULL, NULL, &startup, &process)) {
    fprintf(stderr, "%s: can't start %s (error %lu)\n", argv[0], argv[2], GetLastError());
    return 126;
  }
  if (!wait_for(argv[1], process.hProcess))
    return 125;
  SetConsoleCtrlHandler(NULL, TRUE); /* all programs of the console get Ctrl-C, including this one */
  if (!GenerateConsoleCtrlEvent(CTRL_C_EVENT, 0)) {
    fprintf(stderr, "%s: can't send Ctrl-C (error %lu)\n", argv[0], GetLastError());
    TerminateProcess(process.hProcess, 126);
  }
  WaitForSingleObject(process.hProcess, INFINITE);
  GetExitCodeProcess(process.hProcess, &code);
  return (int)code;
}
