/* SPDX-License-Identifier: Apache-2.0 */
#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#define _DEFAULT_SOURCE /* for MAP_ANONYMOUS */
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>
#endif
#include "pages.h"

#include <string.h>

static const char what[] = "crashed (a guard page or a frozen buffer touched?) in ";
static const char *crash_where;

#ifdef _WIN32

size_t pages_size(void) {
  SYSTEM_INFO info;
  GetSystemInfo(&info);
  return info.dwPageSize;
}

unsigned char *pages_make(size_t size) {
  return VirtualAlloc(NULL, size, MEM_RESERVE | MEM_COMMIT, PAGE_READWRITE);
}

bool pages_allow(unsigned char *pages, size_t size, pages_access access) {
  static const DWORD rights[] = {PAGE_NOACCESS, PAGE_READONLY, PAGE_READWRITE};
  DWORD before;
  return size == 0 || VirtualProtect(pages, size, rights[access], &before) != 0;
}

void pages_free(unsigned char *pages, size_t size) {
  (void)size;
  VirtualFree(pages, 0, MEM_RELEASE);
}

static LONG WINAPI crashed(EXCEPTION_POINTERS *exception) {
  const HANDLE out = GetStdHandle(STD_OUTPUT_HANDLE);
  DWORD written;
  if (exception->ExceptionRecord->ExceptionCode != EXCEPTION_ACCESS_VIOLATION)
    return EXCEPTION_CONTINUE_SEARCH;
  WriteFile(out, what, sizeof what - 1, &written, NULL);
  WriteFile(out, crash_where, (DWORD)strlen(crash_where), &written, NULL);
  WriteFile(out, "\n", 1, &written, NULL);
  return EXCEPTION_CONTINUE_SEARCH;
}

void pages_on_crash(const char *where) {
  crash_where = where;
  SetUnhandledExceptionFilter(crashed);
}

#else

size_t pages_size(void) {
  return (size_t)sysconf(_SC_PAGESIZE);
}

unsigned char *pages_make(size_t size) {
  void *pages = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return pages == MAP_FAILED ? NULL : pages;
}

bool pages_allow(unsigned char *pages, size_t size, pages_access access) {
  static const int rights[] = {PROT_NONE, PROT_READ, PROT_READ | PROT_WRITE};
  return mprotect(pages, size, rights[access]) == 0;
}

void pages_free(unsigned char *pages, size_t size) {
  munmap(pages, size);
}

static void crashed(int signal_number) {
  ssize_t ignored = write(STDOUT_FILENO, what, sizeof what - 1);
  ignored = write(STDOUT_FILENO, crash_where, strlen(crash_where));
  ignored = write(STDOUT_FILENO, "\n", 1);
  (void)ignored;
  signal(signal_number, SIG_DFL);
  raise(signal_number);
}

void pages_on_crash(const char *where) {
  crash_where = where;
  signal(SIGSEGV, crashed);
  signal(SIGBUS, crashed);
}

#endif
