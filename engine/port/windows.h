/* SPDX-License-Identifier: Apache-2.0 */
/* Windows's header and conversions between UTF-8 and its wide text. Internal to port/. */
#ifndef PAGS_PORT_WINDOWS_H
#define PAGS_PORT_WINDOWS_H

#define WIN32_LEAN_AND_MEAN
#define NOMINMAX
#ifndef _WIN32_WINNT
#define _WIN32_WINNT 0x0A00 /* Windows 10 */
#endif
#include <windows.h>

#include "port/port.h"

/* Freed by the caller; NULL with errno. */
wchar_t *pags_port_wide(const char *text);
char *pags_port_narrow(const wchar_t *text);

#endif
