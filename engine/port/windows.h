/* SPDX-License-Identifier: Apache-2.0 */
/* Windows's header and conversions between UTF-8 and its wide text. Internal to port/. */
#ifndef PAGS_PORT_WINDOWS_H
#define PAGS_PORT_WINDOWS_H

#define WIN32_LEAN_AND_MEAN
#define NOMINMAX
#ifndef _WIN32_WINNT
#define _WIN32_WINNT 0x0A00 /* Windows 10 */
#endif
#include <stdlib.h>
#include <windows.h>

#include "port/port.h"

/* In declarations: the text is freed, the handle closed, where the scope ends. */
#define AUTO_WIDE __attribute__((cleanup(free_wide))) wchar_t
#define AUTO_HANDLE __attribute__((cleanup(close_handle))) HANDLE

static inline void free_wide(wchar_t **text) {
  free(*text);
}
static inline void close_handle(HANDLE *handle) {
  if (*handle && *handle != INVALID_HANDLE_VALUE)
    CloseHandle(*handle);
}

/* Freed by the caller; NULL with errno. */
wchar_t *pags_port_wide(const char *text);
char *pags_port_narrow(const wchar_t *text);

#endif
