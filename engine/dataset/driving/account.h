/* SPDX-License-Identifier: Apache-2.0 */
/* The account of an import: the data left out, and why. It becomes "result" of import.json, in the shape that the
 * Python importers write (tools/recordings/pags_recordings/account.py), and `pags import` prints it. */
#ifndef PAGS_DATASET_DRIVING_ACCOUNT_H
#define PAGS_DATASET_DRIVING_ACCOUNT_H

#include "base/json.h"
#include "base/log.h"

enum { PAGS_ACCOUNT_ROWS = 24 };

typedef struct pags_account_row {
  const char *what; /* in the plural, e.g. "sweeps"; not owned */
  int64_t count;    /* 0: the source has none */
  char why[256];    /* cut off if it is longer */
  char first[320];  /* name of the first one; "": unknown */
} pags_account_row;

typedef struct pags_account {
  int count;
  pags_account_row rows[PAGS_ACCOUNT_ROWS];
} pags_account;

/* What was written. */
typedef struct pags_account_counts {
  int64_t steps, cameras, photographs, sweeps, boxes, objects;
} pags_account_counts;

/* Adds a reason, unless the tally is empty or `account` is NULL. */
void pags_account_leave_out(pags_account *account, const char *what, const pags_tally *left, const char *why, ...)
    PAGS_PRINTF(4, 5);
/* Adds that the source has none of these. */
void pags_account_lacks(pags_account *account, const char *what, const char *why, ...) PAGS_PRINTF(3, 4);

/* Writes the counts and "left_out" as an object. */
void pags_account_put(const pags_account *account, const pags_account_counts *counts, const char *key,
                      pags_json_writer *writer);

#endif
