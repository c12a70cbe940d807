/* SPDX-License-Identifier: Apache-2.0 */
/* Result codes, their names, and the message of the last failure, one for each thread (pags/base.h). */
#include <pags/base.h>
#include <stdarg.h>
#include <stdio.h>

/* The message of this thread's last failure. */
static _Thread_local char message[1024];

pags_result pags_fail(pags_result code, const char *format, ...) {
  /* Formats into a buffer of its own, since the arguments may include the previous message, as in
   * pags_fail(code, "%s: %s", path, pags_error_message()). */
  char text[sizeof message];
  va_list arguments;
  va_start(arguments, format);
  int length = vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  snprintf(message, sizeof message, "%s", length < 0 ? pags_result_name(code) : text);
  return code;
}

const char *pags_error_message(void) {
  return message;
}

const char *pags_result_name(pags_result code) {
  switch (code) {
    case PAGS_OK: return "ok";
    case PAGS_ERROR_ARGUMENT: return "argument error";
    case PAGS_ERROR_IO: return "input/output error";
    case PAGS_ERROR_FORMAT: return "format error";
    case PAGS_ERROR_MEMORY: return "out of memory";
    case PAGS_ERROR_LIMIT: return "limit exceeded";
    case PAGS_ERROR_UNSUPPORTED: return "unsupported";
    case PAGS_CANCELLED: return "cancelled";
  }
  return "unknown result";
}
