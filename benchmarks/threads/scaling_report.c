/* SPDX-License-Identifier: Apache-2.0 */
/* Prints what a replay predicts. Each time is given as a range, since the costs of a machine that isn't here are known
 * within bounds only: at its upper end all costs are high and no byte that a stage moves is in a cache. */
#include "benchmarks/threads/scaling_report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { STAGES_AT = 32, WORDS = 96 };
static const int worker_counts[] = {1, 2, 4, 8, 16, 32, 64, 128, 256};
enum { COUNTS = sizeof worker_counts / sizeof *worker_counts };

/* ---- Sums over a phase ---- */

int64_t pags_scaling_times(const pags_record *record, const char *phase) {
  int64_t times = 0;
  for (int64_t i = 0; i < record->count; i++) {
    const pags_event *const e = record->events + i;
    if (e->kind == PAGS_EVENT_JOB)
      times += !strcmp(phase, "jobs");
    else
      times += e->begins && e->phase && !strcmp(e->phase, phase);
  }
  return times;
}

bool pags_scaling_is_listed(const pags_scaling *s, int i) {
  for (int k = 0; k < i; k++)
    if (!strcmp(s->stages[k].phase, s->stages[i].phase))
      return true;
  return false;
}

double pags_scaling_measured(const pags_record *record, const char *phase) {
  const int64_t times = pags_scaling_times(record, phase);
  double ns = 0;
  for (int64_t i = 0; i < record->count; i++) {
    const pags_event *const e = record->events + i;
    if (e->phase && !strcmp(e->phase, phase) && e->kind != PAGS_EVENT_JOB)
      ns += (double)e->ns;
  }
  return times > 0 ? ns / (double)times : 0;
}

static bool is_of(const pags_replay_stage *stage, const char *phase) {
  return !strcmp(stage->phase, phase);
}

static pags_replay_time sum_of(const pags_scaling *s, const pags_replay_time *times, const char *phase) {
  pags_replay_time sum = {0};
  for (int i = 0; i < s->stage_count; i++) {
    if (!is_of(s->stages + i, phase))
      continue;
    sum.total += times[i].total;
    for (int k = 0; k < PAGS_REPLAY_LIMITS; k++)
      sum.lost[k] += times[i].lost[k];
  }
  return sum;
}

pags_result pags_scaling_predict(const pags_scaling *s, const char *phase, int workers, double *least, double *most) {
  pags_replay_time *const times = malloc((size_t)(s->stage_count + 1) * sizeof *times);
  if (!times)
    return pags_out_of_memory("%d stages", s->stage_count);
  const double count = (double)pags_scaling_times(s->record, phase);
  pags_result result = pags_replay_run(s->record, s->stages, s->stage_count, workers, &s->costs.low_cost, times);
  *least = sum_of(s, times, phase).total / count;
  if (result == PAGS_OK)
    result = pags_replay_run(s->record, s->stages, s->stage_count, workers, &s->costs.high_cost, times);
  *most = sum_of(s, times, phase).total / count;
  free(times);
  return result;
}

/* ---- Tables ---- */

/* The predicted times of all stages for all numbers of workers, with low and with high costs. */
typedef struct prediction {
  const pags_scaling *scaling;
  pags_replay_time *low[COUNTS], *high[COUNTS]; /* [stage] */
  FILE *people;
  pags_json_writer *json;
} prediction;

/* Names the two largest losses of at least 2 % of the time. */
static const char *name_losses(const pags_replay_time *t, char text[WORDS]) {
  int first = 0, second = -1;
  for (int k = 1; k < PAGS_REPLAY_LIMITS; k++)
    first = t->lost[k] > t->lost[first] ? k : first;
  for (int k = 0; k < PAGS_REPLAY_LIMITS; k++)
    if (k != first && (second < 0 || t->lost[k] > t->lost[second]))
      second = k;
  const double a = t->total > 0 ? 100 * t->lost[first] / t->total : 0,
               b = t->total > 0 ? 100 * t->lost[second] / t->total : 0;
  if (a < 2)
    snprintf(text, WORDS, "nothing much");
  else if (b < 2)
    snprintf(text, WORDS, "%s %.0f %%", pags_replay_limit_names[first], a);
  else
    snprintf(text, WORDS, "%s %.0f %%, %s %.0f %%", pags_replay_limit_names[first], a, pags_replay_limit_names[second],
             b);
  return text;
}

static void put_losses(pags_json_writer *json, const pags_replay_time *t, double times) {
  pags_json_begin_object(json, "lost_ms");
  for (int k = 0; k < PAGS_REPLAY_LIMITS; k++)
    pags_json_put_number(json, pags_replay_limit_names[k], t->lost[k] / times * 1e-6);
  pags_json_end_object(json);
}

/* A row for each number of workers. */
static void put_workers(const prediction *p, const char *phase, double times, double bytes) {
  char words[WORDS];
  const double alone = sum_of(p->scaling, p->low[0], phase).total;
  if (p->people)
    fprintf(p->people, "  %-9s %7s  %15s  %12s  %21s  %6s  %s\n", "predicted", "workers", "times as fast", "efficiency",
            "ms", "GB/s", "lost at the most");
  pags_json_begin_array(p->json, "workers");
  for (int i = 0; i < COUNTS; i++) {
    const int workers = worker_counts[i];
    const pags_replay_time low = sum_of(p->scaling, p->low[i], phase), high = sum_of(p->scaling, p->high[i], phase);
    const double fast = alone / low.total, slow = alone / high.total;
    if (p->people) {
      char needed[16] = "";
      if (bytes > 0)
        snprintf(needed, sizeof needed, "%.0f", bytes / low.total);
      fprintf(p->people, "  %-9s %7d  %6.2f to %5.2f  %3.0f to %3.0f %%  %9.3f to %8.3f  %6s  %s\n", "", workers, slow,
              fast, 100 * slow / workers, 100 * fast / workers, low.total / times * 1e-6, high.total / times * 1e-6,
              needed, name_losses(&high, words));
    }
    pags_json_begin_object(p->json, NULL);
    pags_json_put_integer(p->json, "workers", workers);
    pags_json_put_number(p->json, "times_as_fast_least", slow);
    pags_json_put_number(p->json, "times_as_fast_most", fast);
    pags_json_put_number(p->json, "ms_least", low.total / times * 1e-6);
    pags_json_put_number(p->json, "ms_most", high.total / times * 1e-6);
    if (bytes > 0)
      pags_json_put_number(p->json, "gb_per_second", bytes / low.total);
    put_losses(p->json, &high, times);
    pags_json_end_object(p->json);
  }
  pags_json_end_array(p->json);
}

/* A row for each stage, at STAGES_AT workers. */
static void put_stages(const prediction *p, const char *phase, double times) {
  char words[WORDS];
  int at = 0;
  while (worker_counts[at] < STAGES_AT)
    at++;
  if (p->people)
    fprintf(p->people, "  %-18s %9s %9s %9s %11s %9s  %19s %11s  %s\n", "predicted by stage", "ms alone", "serial",
            "loops", "blocks/loop", "longest", "ms at 32 workers", "efficiency", "lost at the most");
  pags_json_begin_array(p->json, "stages");
  for (int i = 0; i < p->scaling->stage_count; i++) {
    const pags_replay_stage *const s = p->scaling->stages + i;
    if (!is_of(s, phase))
      continue;
    const double alone = (s->serial + s->work) / times * 1e-6;
    const double low = p->low[at][i].total / times * 1e-6, high = p->high[at][i].total / times * 1e-6;
    const double blocks = s->loops > 0 ? (double)s->blocks / (double)s->loops : 0;
    const double longest = s->loops > 0 ? s->longest / (double)s->loops * 1e-6 : 0;
    if (p->people)
      fprintf(p->people, "  %-18s %9.3f %9.3f %9.1f %11.0f %9.3f  %8.3f to %7.3f %3.0f to %2.0f %%  %s\n", s->stage,
              alone, s->serial / times * 1e-6, (double)s->loops / times, blocks, longest, low, high,
              100 * alone / (high * STAGES_AT), 100 * alone / (low * STAGES_AT), name_losses(&p->high[at][i], words));
    pags_json_begin_object(p->json, NULL);
    pags_json_put_string(p->json, "stage", s->stage);
    pags_json_put_number(p->json, "ms_alone", alone);
    pags_json_put_number(p->json, "serial_ms", s->serial / times * 1e-6);
    pags_json_put_number(p->json, "loops", (double)s->loops / times);
    pags_json_put_number(p->json, "blocks_of_a_loop", blocks);
    pags_json_put_number(p->json, "longest_block_ms", longest);
    pags_json_put_integer(p->json, "at_workers", STAGES_AT);
    pags_json_put_number(p->json, "ms_least", low);
    pags_json_put_number(p->json, "ms_most", high);
    put_losses(p->json, &p->high[at][i], times);
    pags_json_end_object(p->json);
  }
  pags_json_end_array(p->json);
}

static void put_phase(const prediction *p, const char *phase) {
  double critical = 0, bytes = 0;
  const double times = (double)pags_scaling_times(p->scaling->record, phase);
  const double alone = sum_of(p->scaling, p->low[0], phase).total;
  for (int i = 0; i < p->scaling->stage_count; i++) {
    const pags_replay_stage *const s = p->scaling->stages + i;
    critical += is_of(s, phase) ? s->serial + s->longest : 0;
    bytes += is_of(s, phase) ? s->bytes : 0;
  }
  if (p->people)
    fprintf(p->people,
            "\n%s: predicted from %.0f on one worker, %.3f ms each; critical path %.3f ms: never more than %.0f times "
            "as fast\n",
            phase, times, alone / times * 1e-6, critical / times * 1e-6, alone / fmax(critical, 1));
  pags_json_begin_object(p->json, NULL);
  pags_json_put_string(p->json, "phase", phase);
  pags_json_put_number(p->json, "times", times);
  pags_json_put_number(p->json, "ms_alone", alone / times * 1e-6);
  pags_json_put_number(p->json, "critical_path_ms", critical / times * 1e-6);
  put_workers(p, phase, times, bytes);
  put_stages(p, phase, times);
  pags_json_end_object(p->json);
}

static void put_costs(const prediction *p) {
  const pags_replay_costs *const a = &p->scaling->costs.low_cost, *const b = &p->scaling->costs.high_cost;
  const struct {
    const char *name;
    double low, high;
  } rows[] = {{"fork_ns", a->fork, b->fork},
              {"join_ns", a->join, b->join},
              {"claim_ns", a->claim, b->claim},
              {"wake_ns", a->wake, b->wake},
              {"wake_next_ns", a->wake_next, b->wake_next},
              {"wake_call_ns", a->wake_call, b->wake_call},
              {"slow", a->slow, b->slow}};
  pags_json_begin_object(p->json, "costs");
  pags_json_put_integer(p->json, "cores", p->scaling->costs.cores);
  pags_json_put_number(p->json, "read_gb_per_second", p->scaling->costs.bandwidth);
  pags_json_put_number(p->json, "memory_gb_per_second_per_worker", b->bandwidth);
  for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
    pags_json_put_numbers(p->json, rows[i].name, (const double[]){rows[i].low, rows[i].high}, 2);
  pags_json_end_object(p->json);
  if (!p->people)
    return;
  fprintf(
      p->people,
      "Costs measured on %d cores, least and most: a loop begins after %.1f to %.1f us and ends after %.1f to %.1f, "
      "a sleeper\nwakes after %.0f to %.0f us and each further one %.1f to %.1f later, a block is taken every %.0f to "
      "%.0f ns; cores slow each other\ndown %.2f to %.2f times; memory is read at %.1f GB/s, and a machine that is "
      "predicted is bounded by %.1f GB/s a worker.\n",
      p->scaling->costs.cores, a->fork * 1e-3, b->fork * 1e-3, a->join * 1e-3, b->join * 1e-3, a->wake * 1e-3,
      b->wake * 1e-3, a->wake_next * 1e-3, b->wake_next * 1e-3, a->claim, b->claim, a->slow, b->slow,
      p->scaling->costs.bandwidth, b->bandwidth);
}

pags_result pags_scaling_report(const pags_scaling *s, FILE *people, pags_json_writer *json) {
  prediction p = {.scaling = s, .people = people, .json = json};
  pags_result result = PAGS_OK;
  for (int i = 0; i < COUNTS && result == PAGS_OK; i++) {
    const size_t bytes = (size_t)(s->stage_count + 1) * sizeof(pags_replay_time);
    p.low[i] = malloc(bytes);
    p.high[i] = malloc(bytes);
    if (!p.low[i] || !p.high[i]) {
      result = pags_out_of_memory("%d stages", s->stage_count);
      break;
    }
    result = pags_replay_run(s->record, s->stages, s->stage_count, worker_counts[i], &s->costs.low_cost, p.low[i]);
    if (result == PAGS_OK)
      result = pags_replay_run(s->record, s->stages, s->stage_count, worker_counts[i], &s->costs.high_cost, p.high[i]);
  }
  if (result == PAGS_OK) {
    pags_json_begin_object(json, "predicted");
    put_costs(&p);
    pags_json_begin_array(json, "phases");
    for (int i = 0; i < s->stage_count; i++)
      if (!pags_scaling_is_listed(s, i))
        put_phase(&p, s->stages[i].phase);
    pags_json_end_array(json);
    pags_json_end_object(json);
  }
  for (int i = 0; i < COUNTS; i++) {
    free(p.low[i]);
    free(p.high[i]);
  }
  return result;
}
