/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/common/options.h"

#include <stdio.h>
#include <string.h>

const pags_option_rule *pags_option_idle(const pags_parsed *parsed, const pags_option_rule *rules, char *names,
                                         size_t size) {
  *names = '\0';
  for (const pags_option_rule *rule = rules; rule->names; rule++) {
    if (rule->applies)
      continue;
    for (const char *at = rule->names; *at;) {
      char name[32];
      const size_t length = strcspn(at, " "), used = strlen(names);
      snprintf(name, sizeof name, "%.*s", (int)length, at);
      if (pags_option_given(parsed, name))
        snprintf(names + used, size - used, "%s--%s", used ? ", " : "", name);
      at += length + strspn(at + length, " ");
    }
    if (*names)
      return rule;
  }
  return NULL;
}
