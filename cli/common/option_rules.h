/* SPDX-License-Identifier: Apache-2.0 */
/* Which options have an effect on which input. A verb lists its rules in one table, so that none is taken without a
 * word. */
#ifndef PAGS_CLI_OPTION_RULES_H
#define PAGS_CLI_OPTION_RULES_H

#include "cli/common/options.h"

typedef struct pags_option_rule {
  const char *names; /* options of the verb's table, separated by blanks; NULL ends the rules */
  bool applies;      /* whether they have an effect on what is given */
  const char *needs; /* what they need, for the message */
} pags_option_rule;

/* Returns the first rule of which options are given that have no effect, and writes those into `names`, such as
 * "--shift, --fps"; NULL if all that are given have one. */
const pags_option_rule *pags_option_idle(const pags_parsed *parsed, const pags_option_rule *rules, char *names,
                                         size_t size);

#endif
