/* SPDX-License-Identifier: Apache-2.0 */
/* The tables of pags-bench scaling: what a replay predicts, phase by phase and stage by stage, and the measurements
 * next to it. */
#ifndef PAGS_BENCHMARKS_SCALING_REPORT_H
#define PAGS_BENCHMARKS_SCALING_REPORT_H

#include <stdio.h>
#include "base/json.h"
#include "benchmarks/threads/pool_costs.h"

/* A record's stages, in the order in which a report lists them, and how often each phase came. */
typedef struct pags_scaling {
  const pags_record *record;
  pags_replay_stage *stages;
  int stage_count;
  pags_pool_costs costs;
} pags_scaling;

/* How often a phase begins in a record. Jobs: how many there are. */
int64_t pags_scaling_times(const pags_record *record, const char *phase);

/* Whether `phase` of stage `i` is listed by an earlier stage already. */
bool pags_scaling_is_listed(const pags_scaling *scaling, int i);

/* Prints the tables of all phases and writes them as members of the open object. */
pags_result pags_scaling_report(const pags_scaling *scaling, FILE *people, pags_json_writer *json);

/* The predicted times of a phase, ns each time, with the least and with the most costs. */
pags_result pags_scaling_predict(const pags_scaling *scaling, const char *phase, int workers, double *least,
                                 double *most);

/* The measured time of a phase, ns each time; 0 if it isn't in the record. */
double pags_scaling_measured(const pags_record *record, const char *phase);

#endif
