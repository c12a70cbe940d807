/* An ablation's pictures: quality against time, against alpha, and over a grid of pruning rates. */
#include "ablation.h"
#include "benchmarks/plot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { QUALITIES = 3 };
static const char *const quality_titles[QUALITIES] = {"PSNR", "PSNR, critical pixels", "PSNR, other pixels"};
static const char *const quality_names[QUALITIES] = {"all pixels", "critical", "other"};
static const pags_ablation_figure qualities[QUALITIES] = {PAGS_ABLATION_PSNR, PAGS_ABLATION_CRITICAL,
                                                          PAGS_ABLATION_NONCRITICAL};

static double quality_of(const pags_ablation_moment *m, int quality) {
  return quality == 0 ? m->psnr : quality == 1 ? m->critical : m->noncritical;
}

static bool has_critical(const pags_ablation *self) {
  for (int i = 0; i < self->row_count; ++i)
    if (pags_ablation_mean_of(&self->sets[i], PAGS_ABLATION_CRITICAL).count)
      return true;
  return false;
}

/* The first seed of every row. */
static pags_result plot_times(const pags_ablation *self, pags_plot *plot, int quality) {
  pags_plot_line lines[PAGS_ABLATION_ROWS];
  double *numbers = malloc((size_t)self->row_count * 2 * PAGS_ABLATION_MOMENTS * sizeof *numbers);
  if (!numbers)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for the plot");
  for (int i = 0; i < self->row_count; ++i) {
    double *x = numbers + 2 * i * PAGS_ABLATION_MOMENTS, *y = x + PAGS_ABLATION_MOMENTS;
    const pags_ablation_set *set = &self->sets[i];
    int count = set->count ? set->results[0].moment_count : 0;
    for (int k = 0; k < count; ++k) {
      x[k] = set->results[0].moments[k].seconds;
      y[k] = quality_of(&set->results[0].moments[k], quality);
    }
    lines[i] = (pags_plot_line){self->rows[i].name, count, x, y};
  }
  char title[96];
  snprintf(title, sizeof title, "%s against training time", quality_titles[quality]);
  pags_plot_lines(plot, title, "seconds of training", "dB, held-out views", lines, self->row_count);
  free(numbers);
  return PAGS_OK;
}

/* A family: rows whose names differ in one part's value only, "lean+alpha=0", "lean+alpha=0.4", ...; whether these two are of one, with
 * `what` the part up to its "=". */
static bool same_family(const char *a, const char *b, const char *what) {
  const char *in_a = strstr(a, what), *in_b = strstr(b, what);
  if (!in_a || !in_b || in_a - a != in_b - b || strncmp(a, b, (size_t)(in_a - a)) != 0)
    return false;
  return !strcmp(in_a + strcspn(in_a, "+"), in_b + strcspn(in_b, "+"));
}

static bool begins_family(const pags_ablation *self, int row, const char *what) {
  for (int i = 0; i < row; ++i)
    if (same_family(self->rows[i].name, self->rows[row].name, what))
      return false;
  return strstr(self->rows[row].name, what) != NULL;
}

/* "Over alpha, lean": what else the family's names say. */
static void family_title(const pags_ablation *self, int row, const char *what, const char *title, char *out, size_t size) {
  const char *name = self->rows[row].name, *part = strstr(name, what), *rest = part + strcspn(part, "+");
  bool more = part > name || *rest;
  snprintf(out, size, "%s%s%.*s%s", title, more ? ", " : "", (int)(part > name ? part - name - 1 : 0), name, rest);
}

/* The rows of a family in the order of alpha; returns how many are finished. */
static int alpha_rows(const pags_ablation *self, const pags_ablation_set *sets, const char *family, int *rows) {
  int count = 0;
  for (int i = 0; i < self->row_count; ++i) {
    if (!same_family(self->rows[i].name, family, "alpha=") || !pags_ablation_mean_of(&sets[i], PAGS_ABLATION_PSNR).count)
      continue;
    int at = count++;
    for (; at > 0 && self->rows[rows[at - 1]].alpha > self->rows[i].alpha; --at)
      rows[at] = rows[at - 1];
    rows[at] = i;
  }
  return count;
}

static void plot_alpha(const pags_ablation *self, const pags_ablation_set *sets, int first, pags_plot *plot,
                       const char *kind) {
  int rows[PAGS_ABLATION_ROWS], count = alpha_rows(self, sets, self->rows[first].name, rows);
  double x[PAGS_ABLATION_ROWS], y[QUALITIES][PAGS_ABLATION_ROWS];
  pags_plot_line lines[QUALITIES];
  if (count < 2)
    return;
  for (int k = 0; k < count; ++k) {
    x[k] = self->rows[rows[k]].alpha;
    for (int q = 0; q < QUALITIES; ++q)
      y[q][k] = pags_ablation_mean_of(&sets[rows[k]], qualities[q]).mean;
  }
  for (int q = 0; q < QUALITIES; ++q)
    lines[q] = (pags_plot_line){quality_names[q], count, x, y[q]};
  char title[2 * sizeof self->rows->name];
  family_title(self, first, "alpha=", kind, title, sizeof title);
  pags_plot_lines(plot, title, "alpha: the share of the semantic score", "PSNR, dB, held-out views", lines, QUALITIES);
}

typedef struct rate_grid {
  int rows, columns;
  const char *row_labels[PAGS_ABLATION_ROWS], *column_labels[PAGS_ABLATION_ROWS];
  int row_of[PAGS_ABLATION_ROWS], column_of[PAGS_ABLATION_ROWS]; /* of a row of the table; -1: not in the grid */
} rate_grid;

static int place_label(const char **labels, int *count, const char *label) {
  for (int i = 0; i < *count; ++i)
    if (!strcmp(labels[i], label))
      return i;
  labels[*count] = label;
  return (*count)++;
}

/* Of a family; rates in the order in which they were named. */
static void make_grid(const pags_ablation *self, int first, rate_grid *out) {
  memset(out, 0, sizeof *out);
  for (int i = 0; i < self->row_count; ++i) {
    const pags_ablation_row *row = &self->rows[i];
    bool in = same_family(row->name, self->rows[first].name, "rate=");
    out->row_of[i] = in ? place_label(out->row_labels, &out->rows, row->rate_soft) : -1;
    out->column_of[i] = in ? place_label(out->column_labels, &out->columns, row->rate_hard) : -1;
  }
}

static pags_result plot_rates(const pags_ablation *self, const rate_grid *grid, pags_plot *plot,
                              pags_ablation_figure figure, const char *title, double unit, int decimals) {
  double *values = malloc((size_t)grid->rows * (size_t)grid->columns * sizeof *values);
  if (!values)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for the plot");
  for (int i = 0; i < grid->rows * grid->columns; ++i)
    values[i] = (double)NAN;
  for (int i = 0; i < self->row_count; ++i)
    if (grid->row_of[i] >= 0)
      values[grid->row_of[i] * grid->columns + grid->column_of[i]] =
          unit * pags_ablation_mean_of(&self->sets[i], figure).mean;
  pags_plot_cells(plot, title, "% pruned while densifying", grid->row_labels, grid->rows, "% pruned afterwards",
                  grid->column_labels, grid->columns, values, decimals);
  free(values);
  return PAGS_OK;
}

static pags_result plot_grid(const pags_ablation *self, int first, pags_plot *plot) {
  static const struct {
    pags_ablation_figure figure;
    const char *title;
    double unit;
    int decimals;
  } shown[] = {{PAGS_ABLATION_PSNR, "PSNR, dB", 1, 2},
               {PAGS_ABLATION_CRITICAL, "PSNR of critical pixels, dB", 1, 2},
               {PAGS_ABLATION_GAUSSIANS, "thousands of Gaussians", 1e-3, 1},
               {PAGS_ABLATION_SECONDS, "seconds of training", 1, 0}};
  rate_grid grid;
  char title[2 * sizeof self->rows->name];
  make_grid(self, first, &grid);
  if (grid.rows * grid.columns < 2)
    return PAGS_OK;
  for (size_t i = 0; i < sizeof shown / sizeof *shown; ++i)
    if (shown[i].figure != PAGS_ABLATION_CRITICAL || has_critical(self)) {
      family_title(self, first, "rate=", shown[i].title, title, sizeof title);
      PAGS_TRY(plot_rates(self, &grid, plot, shown[i].figure, title, shown[i].unit, shown[i].decimals));
    }
  return PAGS_OK;
}

pags_result pags_ablation_write_plots(const pags_ablation *self) {
  pags_plot plot;
  char path[4096];
  pags_plot_begin(&plot, 2);
  pags_result result = PAGS_OK;
  for (int q = 0; q < (has_critical(self) ? QUALITIES : 1) && result == PAGS_OK; ++q)
    result = plot_times(self, &plot, q);
  for (int i = 0; i < self->row_count && result == PAGS_OK; ++i) {
    if (begins_family(self, i, "alpha=")) {
      plot_alpha(self, self->sets, i, &plot, "Over alpha");
      if (self->equal_count > 0)
        plot_alpha(self, self->equal_sets, i, &plot, "Over alpha, at equal count");
    }
    if (begins_family(self, i, "rate="))
      result = plot_grid(self, i, &plot);
  }
  snprintf(path, sizeof path, "%s.svg", self->output);
  pags_result saved = pags_plot_save(&plot, path);
  return result == PAGS_OK ? saved : result;
}
