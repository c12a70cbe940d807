/* SPDX-License-Identifier: Apache-2.0 */
/* The report of an export: a list of the facts of all proxies written. */
#ifndef PAGS_PROXY_PROXY_REPORT_H
#define PAGS_PROXY_PROXY_REPORT_H

#include <pags/export.h>

/* Appends a copy of the facts, with copies of their name and class, to the report. */
pags_result pags_proxy_report_add(pags_proxy_report *report, const pags_proxy_facts *facts);

#endif
