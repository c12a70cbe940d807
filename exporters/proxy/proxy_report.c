/* SPDX-License-Identifier: Apache-2.0 */
/* The report of an export: a growing list of the facts of all proxies written, with its own copies of their names. */
#include "exporters/proxy/proxy_report.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/text.h"

pags_result pags_proxy_report_add(pags_proxy_report *report, const pags_proxy_facts *facts) {
  pags_proxy_facts *grown = realloc(report->proxies, (size_t)(report->count + 1) * sizeof *grown);
  if (grown)
    report->proxies = grown;
  char *name = pags_text_copy(facts->name), *class_name = pags_text_copy(facts->class_name);
  if (!grown || !name || !class_name) {
    free(name);
    free(class_name);
    return pags_out_of_memory("a report");
  }
  grown[report->count] = *facts;
  grown[report->count].name = name;
  grown[report->count].class_name = class_name;
  report->count++;
  return PAGS_OK;
}

void pags_proxy_report_destroy(pags_proxy_report *report) {
  for (int64_t i = 0; i < report->count; i++) {
    free((char *)(uintptr_t)report->proxies[i].name);
    free((char *)(uintptr_t)report->proxies[i].class_name);
  }
  free(report->proxies);
  memset(report, 0, sizeof *report);
}
