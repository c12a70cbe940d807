/* pags bench ablation: one training for each set of options, measured alike.
 * A row of the table has a name from which its options follow (ablation_rows.c). Rows that train alike share a run: a
 * training kept in a folder of its own, named by its options (ablation_run.c). A run is trained in stretches between
 * moments, at each of which its held-out quality is measured; what is known of it is written after every stretch, so
 * that it can be stopped and gone on with anywhere. Tables and pictures are made from what is finished
 * (ablation_table.c, ablation_plot.c). */
#ifndef PAGS_CLI_ABLATION_H
#define PAGS_CLI_ABLATION_H

#include "child.h"
#include "progress.h"
#include "session.h"

enum { PAGS_ABLATION_ROWS = 128, PAGS_ABLATION_SEEDS = 16, PAGS_ABLATION_MOMENTS = 64 };

/* What a row's name means. Strings point into `text`: rows must not be moved. */
typedef struct pags_ablation_row {
  char name[96];
  char text[384];
  size_t text_used;
  pags_child_words train, eval;      /* options that it adds to those of all rows */
  int seeds;                         /* how often it is repeated */
  bool prunes;                       /* it has a score of its own, so it takes part at equal count */
  double alpha;                      /* NaN: not named alpha=X */
  char rate_soft[24], rate_hard[24]; /* "": not named rate=A/B */
} pags_ablation_row;

/* Rows from a list separated by commas, each NAME or NAME*SEEDS; `seeds` where a name doesn't say. */
pags_result pags_ablation_rows_parse(const char *list, int seeds, pags_ablation_row *rows, int *count);

/* The same row with another bound on its Gaussians, `bound` as text; `row` and `bound` must outlive it. */
void pags_ablation_row_bounded(const pags_ablation_row *row, const char *bound, pags_ablation_row *out);

/* What is measured of a finished row. */
typedef enum pags_ablation_figure {
  PAGS_ABLATION_PSNR,
  PAGS_ABLATION_PSNR_UNEXPOSED,
  PAGS_ABLATION_SSIM,
  PAGS_ABLATION_LPIPS,
  PAGS_ABLATION_CRITICAL,
  PAGS_ABLATION_NONCRITICAL,
  PAGS_ABLATION_MOVING,
  PAGS_ABLATION_GAUSSIANS,
  PAGS_ABLATION_BYTES,
  PAGS_ABLATION_SECONDS,
  PAGS_ABLATION_CPU_SECONDS,
  PAGS_ABLATION_PEAK_BYTES,
  PAGS_ABLATION_RENDER_MS,
  PAGS_ABLATION_FIGURES
} pags_ablation_figure;

typedef struct pags_ablation_moment {
  int64_t step, gaussians;
  double seconds, cpu_seconds; /* of training since the run's begin */
  double peak_bytes;
  double psnr, critical, noncritical; /* of some held-out views; psnr NaN: not measured yet */
} pags_ablation_moment;

typedef struct pags_ablation_result {
  int seed;
  bool finished;
  double figures[PAGS_ABLATION_FIGURES]; /* NaN: there is no such thing in this data */
  int moment_count;
  pags_ablation_moment moments[PAGS_ABLATION_MOMENTS];
} pags_ablation_result;

/* The results of a row, one per seed; `count` 0 where it takes no part. */
typedef struct pags_ablation_set {
  int count;
  pags_ablation_result *results;
} pags_ablation_set;

typedef struct pags_ablation {
  pags_session *session;
  const char *dataset;       /* absolute */
  const char *output;        /* of the tables, without extension */
  const char *folder;        /* of the runs */
  const char *lpips_weights; /* NULL: no LPIPS */
  int64_t iterations;
  int moments, moment_views;
  uint64_t first_seed;
  pags_child_words train, eval; /* options for every row */
  int row_count;
  pags_ablation_row *rows;
  pags_ablation_set *sets;       /* [row_count] */
  pags_ablation_set *equal_sets; /* [row_count]: at equal count */
  bool equal;                    /* rows that prune are to be compared at equal count, too */
  int64_t equal_count;           /* Gaussians; 0: not asked for or not known yet */
  pags_progress progress;
  double begun;                                  /* pags_seconds() */
  int64_t steps_begun, steps_done, steps_wanted; /* of all runs: at the begin, by now, in all */
  int64_t steps_told;                            /* of the stretch under way */
  const char *row_name;                          /* of the row under way */
  int row_number;
} pags_ablation;

/* Trains what is missing of the row's run of that seed, evaluates it as the row says and fills `out`. PAGS_CANCELLED:
 * interrupted, to be gone on with. */
pags_result pags_ablation_run(pags_ablation *self, const pags_ablation_row *row, int seed, pags_ablation_result *out);

/* The same with the last prune leaving `count` Gaussians, and training on from there where the row's own run has kept
 * a checkpoint before it. */
pags_result pags_ablation_run_equal(pags_ablation *self, const pags_ablation_row *row, int seed, int64_t count,
                                    pags_ablation_result *out);

/* Steps that the run of that row has done. */
int64_t pags_ablation_run_steps(pags_ablation *self, const pags_ablation_row *row, int seed);

/* TABLE.md, TABLE.csv, TABLE_curve.csv from the finished results. */
pags_result pags_ablation_write_tables(const pags_ablation *self);
/* An object with name, seed, figures and moments. */
void pags_ablation_put_json(pags_json_writer *writer, const pags_ablation *self, int row,
                            const pags_ablation_result *result);
/* TABLE.svg. */
pags_result pags_ablation_write_plots(const pags_ablation *self);

typedef struct pags_ablation_mean {
  int count;          /* of finished results that have the figure */
  double mean, range; /* NaN where count is 0; range is the largest less the smallest, NaN where count is 1 */
} pags_ablation_mean;

pags_ablation_mean pags_ablation_mean_of(const pags_ablation_set *set, pags_ablation_figure figure);

#endif
