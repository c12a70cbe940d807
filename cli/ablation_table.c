/* What an ablation found, as Markdown for people and as CSV. */
#include "ablation.h"

#include <base/file.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

typedef struct figure_info {
  const char *title, *column; /* of Markdown and of CSV */
  double unit;                /* what a table's number is multiplied by */
  int decimals;
  bool quality; /* compared as a difference; else as a ratio, or not at all */
} figure_info;

static const figure_info infos[PAGS_ABLATION_FIGURES] = {
    {"PSNR", "psnr", 1, 2, true},
    {"PSNR unexposed", "psnr_unexposed", 1, 2, true},
    {"SSIM", "ssim", 1, 4, true},
    {"LPIPS", "lpips", 1, 4, true},
    {"PSNR-C", "psnr_critical", 1, 2, true},
    {"PSNR-NC", "psnr_noncritical", 1, 2, true},
    {"PSNR moving", "psnr_moving", 1, 2, true},
    {"Gaussians", "gaussians", 1, 0, false},
    {"MB", "bytes", 1e-6, 1, false},
    {"training s", "training_seconds", 1, 1, false},
    {"CPU s", "training_cpu_seconds", 1, 1, false},
    {"peak MB", "peak_rss_bytes", 1e-6, 0, false},
    {"render ms", "render_ms", 1, 2, false},
};

pags_ablation_mean pags_ablation_mean_of(const pags_ablation_set *set, pags_ablation_figure figure) {
  double sum = 0, least = HUGE_VAL, largest = -HUGE_VAL;
  pags_ablation_mean out = {0};
  for (int i = 0; i < set->count; ++i) {
    double value = set->results[i].figures[figure];
    if (!set->results[i].finished || !isfinite(value))
      continue;
    sum += value;
    least = fmin(least, value);
    largest = fmax(largest, value);
    ++out.count;
  }
  out.mean = out.count ? sum / out.count : (double)NAN;
  out.range = out.count > 1 ? largest - least : (double)NAN;
  return out;
}

/* Of all rows with several seeds, the largest range: what chance alone may do. NaN: no row has several. */
static double spread_of(const pags_ablation *self, pags_ablation_figure figure) {
  double spread = (double)NAN;
  for (int i = 0; i < self->row_count; ++i)
    spread = fmax(spread, pags_ablation_mean_of(&self->sets[i], figure).range);
  return spread;
}

static bool any_has(const pags_ablation *self, const pags_ablation_set *sets, pags_ablation_figure figure) {
  for (int i = 0; i < self->row_count; ++i)
    if (pags_ablation_mean_of(&sets[i], figure).count)
      return true;
  return false;
}

static bool finished(const pags_ablation_set *set) {
  return pags_ablation_mean_of(set, PAGS_ABLATION_PSNR).count > 0;
}

/* A file that grows line by line; the first error is kept. */
typedef struct report {
  pags_file_writer writer;
  pags_result result;
} report;

static void put(report *page, const char *format, ...) PAGS_PRINTF(2, 3);
static void put(report *page, const char *format, ...) {
  char text[2048];
  va_list list;
  va_start(list, format);
  int length = vsnprintf(text, sizeof text, format, list);
  va_end(list);
  if (length >= (int)sizeof text)
    length = (int)sizeof text - 1;
  if (page->result == PAGS_OK)
    page->result = pags_file_writer_put(&page->writer, text, (size_t)length);
}

static pags_result begin_page(const pags_ablation *self, const char *ending, report *page) {
  char path[4096];
  *page = (report){0};
  snprintf(path, sizeof path, "%s%s", self->output, ending);
  return page->result = pags_file_writer_begin(&page->writer, path);
}

static pags_result end_page(report *page) {
  return page->result == PAGS_OK ? pags_file_writer_commit(&page->writer) : page->result;
}

/* Markdown. */

static void put_heads(report *page, const pags_ablation *self, const pags_ablation_set *sets, bool quality_only) {
  put(page, "| row |");
  for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f)
    if (any_has(self, sets, (pags_ablation_figure)f) && (infos[f].quality || !quality_only))
      put(page, " %s |", infos[f].title);
}

static void put_rule(report *page, const pags_ablation *self, const pags_ablation_set *sets, bool quality_only,
                     int more) {
  put(page, "\n|---|");
  for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f)
    if (any_has(self, sets, (pags_ablation_figure)f) && (infos[f].quality || !quality_only))
      put(page, "---:|");
  while (more-- > 0)
    put(page, "---:|");
  put(page, "\n");
}

static void put_mean(report *page, const pags_ablation_mean *m, const figure_info *info) {
  if (!m->count)
    put(page, " - |");
  else if (m->count == 1)
    put(page, " %.*f |", info->decimals, m->mean * info->unit);
  else
    put(page, " %.*f (%.*f) |", info->decimals, m->mean * info->unit, info->decimals, m->range * info->unit);
}

static void put_figures(report *page, const pags_ablation *self, const pags_ablation_set *sets) {
  put_heads(page, self, sets, false);
  put_rule(page, self, sets, false, 0);
  for (int i = 0; i < self->row_count; ++i) {
    if (!finished(&sets[i]))
      continue;
    put(page, "| `%s` |", self->rows[i].name);
    for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f) {
      pags_ablation_mean m = pags_ablation_mean_of(&sets[i], (pags_ablation_figure)f);
      if (any_has(self, sets, (pags_ablation_figure)f))
        put_mean(page, &m, &infos[f]);
    }
    put(page, "\n");
  }
}

/* The row that others are compared with: `baseline`, or the first that is finished. */
static int reference_row(const pags_ablation *self, const pags_ablation_set *sets) {
  int first = -1;
  for (int i = self->row_count - 1; i >= 0; --i)
    if (finished(&sets[i])) {
      first = i;
      if (!strcmp(self->rows[i].name, "baseline"))
        return i;
    }
  return first;
}

static void put_difference(report *page, double difference, double spread, int decimals) {
  if (!isfinite(difference))
    put(page, " - |");
  else if (fabs(difference) <= spread)
    put(page, " none |");
  else
    put(page, " %+.*f |", decimals, difference);
}

static void put_ratio(report *page, const pags_ablation_set *set, const pags_ablation_set *of, pags_ablation_figure f) {
  double ratio = pags_ablation_mean_of(set, f).mean / pags_ablation_mean_of(of, f).mean;
  if (isfinite(ratio))
    put(page, " %.2fx |", ratio);
  else
    put(page, " - |");
}

static void put_differences(report *page, const pags_ablation *self, const pags_ablation_set *sets) {
  static const pags_ablation_figure ratios[] = {PAGS_ABLATION_GAUSSIANS, PAGS_ABLATION_SECONDS,
                                                PAGS_ABLATION_CPU_SECONDS, PAGS_ABLATION_RENDER_MS};
  enum { RATIOS = sizeof ratios / sizeof ratios[0] };
  int reference = reference_row(self, sets);
  put_heads(page, self, sets, true);
  for (int r = 0; r < RATIOS; ++r)
    put(page, " %s |", infos[ratios[r]].title);
  put_rule(page, self, sets, true, RATIOS);
  for (int i = 0; i < self->row_count; ++i) {
    if (i == reference || !finished(&sets[i]))
      continue;
    put(page, "| `%s` |", self->rows[i].name);
    for (int k = 0; k < PAGS_ABLATION_FIGURES; ++k) {
      pags_ablation_figure f = (pags_ablation_figure)k;
      double difference = pags_ablation_mean_of(&sets[i], f).mean - pags_ablation_mean_of(&sets[reference], f).mean;
      if (infos[k].quality && any_has(self, sets, f))
        put_difference(page, difference, spread_of(self, f), infos[k].decimals);
    }
    for (int r = 0; r < RATIOS; ++r)
      put_ratio(page, &sets[i], &sets[reference], ratios[r]);
    put(page, "\n");
  }
}

static void put_spread(report *page, const pags_ablation *self) {
  bool any = false;
  for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f) {
    double spread = infos[f].quality ? spread_of(self, (pags_ablation_figure)f) : (double)NAN;
    if (!isfinite(spread))
      continue;
    put(page, "%s%s %.*f",
        any ? ", " : "Spread over seeds (largest less smallest, the largest of all rows that were repeated): ",
        infos[f].title, infos[f].decimals, spread);
    any = true;
  }
  put(page, any ? ". A difference within it is called none.\n\n"
                : "Each row was trained once: how much of a difference is chance is not known.\n\n");
}

static void put_compared(report *page, const pags_ablation *self, const pags_ablation_set *sets) {
  int reference = reference_row(self, sets), others = 0;
  for (int i = 0; i < self->row_count; ++i)
    others += i != reference && finished(&sets[i]);
  if (reference < 0 || !others)
    return;
  put(page, "\nAgainst `%s`:\n\n", self->rows[reference].name);
  put_differences(page, self, sets);
}

/* Quality at a time, joined between the moments; NaN before the first. */
static double quality_at(const pags_ablation_result *r, double seconds, size_t offset) {
  for (int k = 0; k < r->moment_count; ++k) {
    const pags_ablation_moment *m = &r->moments[k];
    double value = *(const double *)(const void *)((const char *)m + offset);
    if (m->seconds < seconds && k + 1 < r->moment_count)
      continue;
    if (m->seconds <= seconds)
      return value;
    if (k == 0)
      return (double)NAN;
    double before = *(const double *)(const void *)((const char *)(m - 1) + offset);
    return before + (value - before) * (seconds - m[-1].seconds) / (m->seconds - m[-1].seconds);
  }
  return (double)NAN;
}

static const pags_ablation_result *first_finished(const pags_ablation_set *set) {
  for (int i = 0; i < set->count; ++i)
    if (set->results[i].finished)
      return &set->results[i];
  return NULL;
}

/* What each row had reached when the quickest was done, and at a half of that. */
static void put_equal_time(report *page, const pags_ablation *self) {
  double end = HUGE_VAL;
  int count = 0;
  for (int i = 0; i < self->row_count; ++i) {
    const pags_ablation_result *r = first_finished(&self->sets[i]);
    if (r)
      end = fmin(end, r->figures[PAGS_ABLATION_SECONDS]);
    count += r != NULL;
  }
  if (count < 2)
    return;
  put(page,
      "\nAt equal time: what each row had reached after %.0f s and after %.0f s of training, when the quickest was "
      "done "
      "(first seed, at most %d held-out views, between moments interpolated):\n\n",
      end / 2, end, self->moment_views);
  put(page,
      "| row | PSNR, half | PSNR | PSNR-C, half | PSNR-C | PSNR-NC, half | PSNR-NC "
      "|\n|---|---:|---:|---:|---:|---:|---:|\n");
  for (int i = 0; i < self->row_count; ++i) {
    const pags_ablation_result *r = first_finished(&self->sets[i]);
    if (!r)
      continue;
    put(page, "| `%s` |", self->rows[i].name);
    for (int k = 0; k < 6; ++k) {
      static const size_t offsets[] = {offsetof(pags_ablation_moment, psnr), offsetof(pags_ablation_moment, critical),
                                       offsetof(pags_ablation_moment, noncritical)};
      double value = quality_at(r, k % 2 ? end : end / 2, offsets[k / 2]);
      if (isfinite(value))
        put(page, " %.2f |", value);
      else
        put(page, " - |");
    }
    put(page, "\n");
  }
}

static void put_words(report *page, const pags_child_words *words) {
  for (int i = 0; i < words->count; ++i)
    put(page, "%s%s", i ? " " : "", words->items[i]);
}

static void put_row_options(report *page, const pags_ablation *self) {
  put(page, "\nRows, as options of `pags train`");
  if (self->train.count) {
    put(page, ", each behind `");
    put_words(page, &self->train);
    put(page, "`");
  }
  put(page, ":\n\n");
  for (int i = 0; i < self->row_count; ++i) {
    put(page, "- `%s`: ", self->rows[i].name);
    put(page, self->rows[i].train.count ? "`" : "no other");
    put_words(page, &self->rows[i].train);
    put(page, self->rows[i].train.count ? "`" : "");
    if (self->rows[i].eval.count) {
      put(page, "; evaluated with `");
      put_words(page, &self->rows[i].eval);
      put(page, "`");
    }
    put(page, finished(&self->sets[i]) ? "\n" : "; not finished\n");
  }
}

static pags_result write_markdown(const pags_ablation *self) {
  report page;
  PAGS_TRY(begin_page(self, ".md", &page));
  put(&page, "# Ablation on %s, %lld steps\n\n", pags_path_name(self->dataset), (long long)self->iterations);
  put(&page,
      "Held-out views. PSNR in dB; C: critical, NC: not critical pixels; means of the seeds (largest less smallest in "
      "brackets). MB: the scene's files. Training: wall clock and processor time. Render: mean of a frame of the "
      "held-out views.\n\n");
  put_spread(&page, self);
  put_figures(&page, self, self->sets);
  put_compared(&page, self, self->sets);
  if (self->equal_count > 0) {
    put(&page,
        "\n## At equal count\n\nEach row that prunes by a score was pruned by it to %lld Gaussians, the smallest of "
        "their "
        "counts, at the last prune, and trained on.\n\n",
        (long long)self->equal_count);
    put_figures(&page, self, self->equal_sets);
    put_compared(&page, self, self->equal_sets);
  }
  put_equal_time(&page, self);
  put_row_options(&page, self);
  return end_page(&page);
}

/* CSV. */

/* Names of rows hold no quotes or commas but in raw options. */
static void put_name(report *page, const char *name) {
  put(page, strpbrk(name, "\",") ? "\"" : "");
  for (const char *c = name; *c; ++c)
    put(page, *c == '"' ? "\"\"" : "%c", *c);
  put(page, strpbrk(name, "\",") ? "\"" : "");
}

static void put_number(report *page, double value) {
  if (isfinite(value))
    put(page, ",%.10g", value);
  else
    put(page, ",");
}

static void put_csv_rows(report *page, const pags_ablation *self, const pags_ablation_set *sets, const char *kind) {
  for (int i = 0; i < self->row_count; ++i)
    for (int k = 0; k < sets[i].count; ++k) {
      const pags_ablation_result *r = &sets[i].results[k];
      if (!r->finished)
        continue;
      put_name(page, self->rows[i].name);
      put(page, ",%llu,%s", (unsigned long long)self->first_seed + (unsigned long long)r->seed, kind);
      for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f)
        put_number(page, r->figures[f]);
      put(page, "\n");
    }
}

static pags_result write_csv(const pags_ablation *self) {
  report page;
  PAGS_TRY(begin_page(self, ".csv", &page));
  put(&page, "row,seed,count");
  for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f)
    put(&page, ",%s", infos[f].column);
  put(&page, "\n");
  put_csv_rows(&page, self, self->sets, "own");
  put_csv_rows(&page, self, self->equal_sets, "equal");
  return end_page(&page);
}

static void put_curves(report *page, const pags_ablation *self, const pags_ablation_set *sets, const char *kind) {
  for (int i = 0; i < self->row_count; ++i)
    for (int k = 0; k < sets[i].count; ++k)
      for (int m = 0; m < sets[i].results[k].moment_count; ++m) {
        const pags_ablation_result *r = &sets[i].results[k];
        const pags_ablation_moment *at = &r->moments[m];
        put_name(page, self->rows[i].name);
        put(page, ",%llu,%s,%lld,%lld", (unsigned long long)self->first_seed + (unsigned long long)r->seed, kind,
            (long long)at->step, (long long)at->gaussians);
        for (int c = 0; c < 5; ++c)
          put_number(page, (const double[]){at->seconds, at->cpu_seconds, at->psnr, at->critical, at->noncritical}[c]);
        put(page, "\n");
      }
}

static pags_result write_curves(const pags_ablation *self) {
  report page;
  PAGS_TRY(begin_page(self, "_curve.csv", &page));
  put(&page,
      "row,seed,count,step,gaussians,training_seconds,training_cpu_seconds,psnr,psnr_critical,psnr_noncritical\n");
  put_curves(&page, self, self->sets, "own");
  put_curves(&page, self, self->equal_sets, "equal");
  return end_page(&page);
}

pags_result pags_ablation_write_tables(const pags_ablation *self) {
  PAGS_TRY(write_markdown(self));
  PAGS_TRY(write_csv(self));
  return write_curves(self);
}

void pags_ablation_put_json(pags_json_writer *writer, const pags_ablation *self, int row,
                            const pags_ablation_result *result) {
  pags_json_begin_object(writer, NULL);
  pags_json_put_string(writer, "row", self->rows[row].name);
  pags_json_put_unsigned(writer, "seed", self->first_seed + (uint64_t)result->seed);
  for (int f = 0; f < PAGS_ABLATION_FIGURES; ++f)
    pags_json_put_number(writer, infos[f].column, result->figures[f]);
  pags_json_begin_array(writer, "moments");
  for (int m = 0; m < result->moment_count; ++m) {
    const pags_ablation_moment *at = &result->moments[m];
    pags_json_begin_object(writer, NULL);
    pags_json_put_integer(writer, "step", at->step);
    pags_json_put_integer(writer, "gaussians", at->gaussians);
    pags_json_put_number(writer, "seconds", at->seconds);
    pags_json_put_number(writer, "psnr", at->psnr);
    pags_json_put_number(writer, "psnr_critical", at->critical);
    pags_json_put_number(writer, "psnr_noncritical", at->noncritical);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
  pags_json_end_object(writer);
}
