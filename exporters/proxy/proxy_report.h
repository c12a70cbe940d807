/* SPDX-License-Identifier: Apache-2.0 */
/* The list of what was exported. */
#ifndef PAGS_PROXY_PROXY_REPORT_H
#define PAGS_PROXY_PROXY_REPORT_H

#include <pags/export.h>

/* Copies the facts with their name and class. */
pags_result pags_proxy_report_add(pags_proxy_report *report, const pags_proxy_facts *facts);

#endif
