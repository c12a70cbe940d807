/* SPDX-License-Identifier: Apache-2.0 */
/* The account of an import (account.h). */
#include "dataset/driving/account.h"

#include <assert.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static pags_account_row *add_row(pags_account *account, const char *what, int64_t count, const char *why,
                                 va_list arguments) {
  assert(account->count < PAGS_ACCOUNT_ROWS);
  pags_account_row *row = &account->rows[account->count++];
  *row = (pags_account_row){.what = what, .count = count};
  vsnprintf(row->why, sizeof row->why, why, arguments);
  return row;
}

void pags_account_leave_out(pags_account *account, const char *what, const pags_tally *left, const char *why, ...) {
  if (!account || !left->count)
    return;
  va_list arguments;
  va_start(arguments, why);
  pags_account_row *row = add_row(account, what, left->count, why, arguments);
  va_end(arguments);
  snprintf(row->first, sizeof row->first, "%s", left->first);
}

void pags_account_lacks(pags_account *account, const char *what, const char *why, ...) {
  if (!account)
    return;
  va_list arguments;
  va_start(arguments, why);
  add_row(account, what, 0, why, arguments);
  va_end(arguments);
}

void pags_account_put(const pags_account *account, const pags_account_counts *counts, const char *key,
                      pags_json_writer *writer) {
  pags_json_begin_object(writer, key);
  pags_json_put_integer(writer, "steps", counts->steps);
  pags_json_put_integer(writer, "cameras", counts->cameras);
  pags_json_put_integer(writer, "photographs", counts->photographs);
  pags_json_put_integer(writer, "sweeps", counts->sweeps);
  pags_json_put_integer(writer, "boxes", counts->boxes);
  pags_json_put_integer(writer, "objects", counts->objects);
  pags_json_begin_array(writer, "left_out");
  for (int i = 0; i < account->count; i++) {
    const pags_account_row *row = &account->rows[i];
    pags_json_begin_object(writer, NULL);
    pags_json_put_string(writer, "what", row->what);
    pags_json_put_integer(writer, "count", row->count);
    pags_json_put_string(writer, "why", row->why);
    pags_json_begin_array(writer, "which");
    if (*row->first)
      pags_json_put_string(writer, NULL, row->first);
    pags_json_end_array(writer);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
  pags_json_end_object(writer);
}
