/* SPDX-License-Identifier: Apache-2.0 */
/* Functions of the operating system for tests, in addition to port/port.h: a folder for their files and names of
 * special places. */
#ifndef PAGS_TESTS_SYSTEM_H
#define PAGS_TESTS_SYSTEM_H

#include <errno.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "port/port.h"

#ifdef _WIN32
#define SYSTEM_NULL_DEVICE "NUL"
#define SYSTEM_NO_PLACE "NUL/no/such/place" /* nobody can make a folder there */
#else
#define SYSTEM_NULL_DEVICE "/dev/null"
#define SYSTEM_NO_PLACE "/proc/no/such/place"
#endif

/* The folder for temporary files: TMPDIR, else TEMP on Windows, else /tmp. */
static inline const char *system_temporary(void) {
  const char *folder = getenv("TMPDIR");
#ifdef _WIN32
  folder = folder ? folder : getenv("TEMP");
#endif
  return folder ? folder : "/tmp";
}

/* Puts this process's temporary files into a file system in memory if there is one, unless TMPDIR names a folder. */
static inline void system_prefer_memory(void) {
  if (!getenv("TMPDIR") && pags_port_may_write("/dev/shm"))
    pags_port_set_environment("TMPDIR", "/dev/shm");
}

/* Creates a new folder and writes its path, separated by '/'; returns whether that worked. */
static inline bool system_make_scratch(char *path, size_t size) {
  for (int i = 0; i < 1000; i++) {
    const uint64_t random = ((uint64_t)pags_port_clock_ns() + (uint64_t)i) * UINT64_C(0x9E3779B97F4A7C15);
    const int length =
        snprintf(path, size, "%s/pags-test-%08x", system_temporary(), (unsigned)(random >> 32 & 0xffffffffu));
    if (length < 0 || (size_t)length >= size)
      return false;
#ifdef _WIN32
    for (char *at = path; *at; at++)
      *at = *at == '\\' ? '/' : *at;
#endif
    if (pags_port_make_folder(path))
      return true;
    if (errno != EEXIST)
      return false;
  }
  return false;
}

#endif
