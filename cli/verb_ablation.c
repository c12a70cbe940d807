/* pags bench ablation: rows, one after another, each in processes of its own; the tables are written after each. */
#include "ablation.h"
#include "interrupt.h"
#include "verbs.h"

#include <base/file.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Options that go on to pags train as they are, and where a scene doesn't know them by itself to pags eval. */
enum { PASSED = 11 };
static const struct passed {
  const char *name;
  bool eval;
} passed[PASSED] = {{"--downscale", false}, {"--split-every", false},    {"--cameras", false},
                    {"--frames", false},    {"--holdout-camera", false}, {"--max-gaussians", false},
                    {"--kind", true},       {"--ego-mask", true},        {"--sfm", true},
                    {"--colmap", true},     {"--critical", true}};

typedef struct ablation_arguments {
  pags_session session;
  const char *output, *rows, *lpips_weights, *passed[PASSED];
  int64_t iterations;
  int seeds, moments, moment_views, equal_count;
  uint64_t seed;
} ablation_arguments;

#define AT(member) offsetof(ablation_arguments, member)
#define PASS(index, meta, standard, text) PAGS_TEXT(passed_##index, 0, AT(passed[index]), meta, standard, text)
#define passed_0 "downscale"
#define passed_1 "split-every"
#define passed_2 "cameras"
#define passed_3 "frames"
#define passed_4 "holdout-camera"
#define passed_5 "max-gaussians"
#define passed_6 "kind"
#define passed_7 "ego-mask"
#define passed_8 "sfm"
#define passed_9 "colmap"
#define passed_10 "critical"

static const char default_rows[] = "baseline,sp,sd,sp+sd,spr,pdr,spr+pdr";

static const pags_option options[] = {
    PAGS_OUTPUT(AT(output), "TABLE",
                "writes TABLE.md, TABLE.csv, TABLE_curve.csv and TABLE.svg after every row, and keeps the trainings in the folder "
                "TABLE.runs; a row found finished there is not run again"),
    PAGS_VALUE("iterations", 'n', INT64, AT(iterations), 1, PAGS_UNLIMITED, "N", "steps", NULL,
               "how long to train each row"),
    PAGS_TEXT("rows", 0, AT(rows), "NAME,...", default_rows,
              "rows of the table; NAME*K: with K seeds. Parts joined by '+', later ones win: baseline, sp, sd, spr, lean, "
              "pdr, no-objects, no-tracks, no-fourier, no-sky, no-lidar-start, no-lidar-loss, no-exposure, sh=N; of spr "
              "where no other is named: alpha=X, rate=A/B, preset=NAME, beta=X, gamma=X, hybrid=NAME, critical-weight=W, "
              "s-sem=NAME, s-grad=NAME, s-grad-from=NAME; any option of pags train: --NAME=VALUE"),
    PAGS_VALUE("seeds", 0, INT, AT(seeds), 1, PAGS_ABLATION_SEEDS, "K", NULL, NULL,
               "repeat each row so often, for the spread; differences within it are called none"),
    PAGS_VALUE("seed", 0, UINT64, AT(seed), 0, 0, "N", NULL, NULL, "the first seed"),
    PAGS_FLAG("equal-count", 0, AT(equal_count),
              "compare rows that prune at equal count, too: each goes on from before its last prune, which leaves the "
              "smallest of their counts"),
    PAGS_VALUE("moments", 0, INT, AT(moments), 1, PAGS_ABLATION_MOMENTS, "N", NULL, NULL,
               "how often a training's held-out quality is measured, evenly over its steps"),
    PAGS_VALUE("moment-views", 0, INT, AT(moment_views), 1, 1e6, "N", "views", NULL, "on how many held-out views then"),
    PAGS_TEXT("lpips-weights", 0, AT(lpips_weights), "FILE", "none: no LPIPS", "as for pags eval"),

    PAGS_GROUP("For pags train, as they are (any others: behind --, at the end)"),
    PASS(0, "F", NULL, "shrink the photographs"),
    PASS(1, "N", NULL, "hold out every Nth view or time step"),
    PASS(2, "LIST", NULL, "driving sets: numbers of the cameras to use"),
    PASS(3, "A-B", NULL, "driving sets: time steps to use"),
    PASS(4, "N", NULL, "driving sets: hold out this camera"),
    PASS(5, "N", NULL, "never have more Gaussians"),
    PASS(6, "NAME", NULL, "driving sets: whose rules the layout follows"),
    PASS(7, "FILE|FOLDER", NULL, "driving sets: where the recording car is seen"),
    PASS(8, "FOLDER", NULL, "driving sets: a COLMAP model of the same world"),
    PASS(9, "FOLDER", NULL, "take cameras and points from this COLMAP model"),
    PASS(10, "LIST", NULL, "driving sets: what is critical"),
    PAGS_SESSION_OPTIONS(ablation_arguments),
    {0}};

static const pags_positional positionals[] = {{"DATASET", "as for pags train"}, {NULL, NULL}};

static const pags_verb verb = {.name = "bench ablation",
                               .usage = "DATASET -o TABLE [options] [-- options of pags train]",
                               .about =
                                   "Trains a data set once for each row, the rows differing in one option or a few, "
                                   "and compares their held-out quality, "
                                   "size, training and rendering time, also at equal training time. Each training is a "
                                   "process of its own. Ctrl-C stops "
                                   "with everything saved; the same command goes on.",
                               .positionals = positionals,
                               .options = options};

/* Preparation. */

static void gather_options(const ablation_arguments *arguments, int rest, char **words, pags_ablation *a) {
  for (int i = 0; i < PASSED; ++i) {
    if (!arguments->passed[i])
      continue;
    for (int eval = 0; eval <= (passed[i].eval ? 1 : 0); ++eval) {
      pags_child_add(eval ? &a->eval : &a->train, passed[i].name);
      pags_child_add(eval ? &a->eval : &a->train, arguments->passed[i]);
    }
  }
  for (int i = 0; i < rest; ++i)
    pags_child_add(&a->train, words[i]);
}

/* Asks the program whether it would take these options. */
static pags_result check_verb(const pags_ablation *a, const char *name, const char *what, const char *input,
                              const pags_child_words *common, const pags_child_words *own) {
  pags_child_words words = {0};
  pags_child_result child;
  pags_child_add(&words, what);
  pags_child_add(&words, input);
  if (!strcmp(what, "train")) {
    pags_child_add(&words, "--output");
    pags_child_add(&words, a->folder);
  }
  pags_child_add_all(&words, common);
  pags_child_add_all(&words, own);
  pags_child_add(&words, "--check-options");
  PAGS_TRY(pags_child_run(&words, NULL, NULL, &child));
  if (child.exit_code == PAGS_EXIT_OK)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': %s", name, child.message);
}

static pags_result check_row(const pags_ablation *a, const pags_ablation_row *row) {
  PAGS_TRY(check_verb(a, row->name, "train", a->dataset, &a->train, &row->train));
  return check_verb(a, row->name, "eval", a->folder, &a->eval, &row->eval);
}

/* Of the standard rows those stay that this program can evaluate. */
static pags_result check_rows(pags_ablation *a, bool standard) {
  int kept = 0;
  for (int i = 0; i < a->row_count; ++i) {
    pags_result result = check_row(a, &a->rows[i]);
    if (result != PAGS_OK && !(standard && a->rows[i].eval.count))
      return result;
    if (result != PAGS_OK)
      pags_say(a->session, "left out: %s\n", pags_error_message());
    else if (kept++ != i)
      PAGS_TRY(pags_ablation_rows_parse(a->rows[i].name, a->rows[i].seeds, &a->rows[kept - 1], &(int){0}));
  }
  a->row_count = kept;
  return PAGS_OK;
}

static void put_words(pags_json_writer *writer, const char *key, const pags_child_words *words) {
  pags_json_begin_array(writer, key);
  for (int i = 0; i < words->count; ++i)
    pags_json_put_string(writer, NULL, words->items[i]);
  pags_json_end_array(writer);
}

/* What all rows share is written beside the runs: a folder holds runs that can be compared. */
static pags_result check_settings(const pags_ablation *a) {
  char *path = pags_path_join(a->folder, "settings.json");
  uint8_t *before = NULL;
  size_t size = 0;
  pags_json_writer w;
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  pags_json_writer_init(&w, 1);
  pags_json_begin_object(&w, NULL);
  pags_json_put_string(&w, "dataset", a->dataset);
  pags_json_put_integer(&w, "iterations", a->iterations);
  pags_json_put_integer(&w, "moments", a->moments);
  pags_json_put_integer(&w, "moment_views", a->moment_views);
  put_words(&w, "train", &a->train);
  put_words(&w, "eval", &a->eval);
  pags_json_end_object(&w);
  pags_result result = pags_json_writer_finish(&w);
  if (result == PAGS_OK && !pags_file_exists(path)) {
    result = pags_file_write(path, w.data, w.size);
  } else if (result == PAGS_OK) {
    result = pags_file_read(path, &before, &size);
    if (result == PAGS_OK && (size != w.size || memcmp(before, w.data, size)))
      result = pags_fail(PAGS_ERROR_ARGUMENT,
                         "%s: says that the runs there are of another data set or other options; expected the same, or "
                         "another -o TABLE",
                         path);
  }
  free(before);
  pags_json_writer_destroy(&w);
  free(path);
  return result;
}

/* The work. */

static bool same_words(const pags_child_words *a, const pags_child_words *b) {
  if (a->count != b->count)
    return false;
  for (int i = 0; i < a->count; ++i)
    if (strcmp(a->items[i], b->items[i]))
      return false;
  return true;
}

/* Whether an earlier row trains the same. */
static bool shares_run(const pags_ablation *a, int row, int seed) {
  for (int i = 0; i < row; ++i)
    if (seed < a->rows[i].seeds && same_words(&a->rows[i].train, &a->rows[row].train))
      return true;
  return false;
}

static void count_steps(pags_ablation *a) {
  for (int i = 0; i < a->row_count; ++i)
    for (int k = 0; k < a->rows[i].seeds; ++k)
      if (!shares_run(a, i, k)) {
        a->steps_wanted += a->iterations;
        a->steps_done += pags_ablation_run_steps(a, &a->rows[i], k);
      }
  a->steps_begun = a->steps_done;
}

static void tell_row(pags_ablation *a, int row, const pags_ablation_result *result, const char *how) {
  const double *f = result->figures;
  char regions[64] = "";
  if (isfinite(f[PAGS_ABLATION_CRITICAL]))
    snprintf(regions, sizeof regions, " (critical %.2f, other %.2f)", f[PAGS_ABLATION_CRITICAL],
             f[PAGS_ABLATION_NONCRITICAL]);
  pags_progress_say(&a->progress, "%-16s seed %llu%s: PSNR %.2f dB%s, %.0f Gaussians, %.0f s, %.2f ms a frame",
                    a->rows[row].name, (unsigned long long)a->first_seed + (unsigned long long)result->seed, how,
                    f[PAGS_ABLATION_PSNR], regions, f[PAGS_ABLATION_GAUSSIANS], f[PAGS_ABLATION_SECONDS],
                    f[PAGS_ABLATION_RENDER_MS]);
}

static pags_result run_row(pags_ablation *a, int row, int seed) {
  pags_ablation_set *set = &a->sets[row];
  a->row_number = row + 1;
  a->row_name = a->rows[row].name;
  PAGS_TRY(pags_ablation_run(a, &a->rows[row], seed, &set->results[seed]));
  set->count = seed + 1;
  tell_row(a, row, &set->results[seed], "");
  PAGS_TRY(pags_ablation_write_tables(a));
  return pags_ablation_write_plots(a);
}

/* All rows with the first seed come first, so that a whole table is there early. */
static pags_result run_rows(pags_ablation *a) {
  for (int seed = 0; seed < PAGS_ABLATION_SEEDS; ++seed)
    for (int row = 0; row < a->row_count; ++row)
      if (seed < a->rows[row].seeds)
        PAGS_TRY(run_row(a, row, seed));
  return PAGS_OK;
}

/* The smallest count that a row which prunes has come to; 0 where there is nothing to compare. */
static int64_t smallest_count(const pags_ablation *a) {
  double least = 0;
  int rows = 0;
  for (int i = 0; i < a->row_count; ++i) {
    for (int k = 0; k < (a->rows[i].prunes ? a->sets[i].count : 0); ++k) {
      double count = a->sets[i].results[k].figures[PAGS_ABLATION_GAUSSIANS];
      least = least > 0 && least < count ? least : count;
    }
    rows += a->rows[i].prunes && !shares_run(a, i, 0);
  }
  return rows > 1 ? (int64_t)least : 0;
}

/* A run that has come to this count by itself is the same run. */
static pags_result run_equal_row(pags_ablation *a, int row, int seed) {
  pags_ablation_set *set = &a->equal_sets[row];
  const pags_ablation_result *own = &a->sets[row].results[seed];
  a->row_number = row + 1;
  if ((int64_t)own->figures[PAGS_ABLATION_GAUSSIANS] == a->equal_count)
    set->results[seed] = *own;
  else
    PAGS_TRY(pags_ablation_run_equal(a, &a->rows[row], seed, a->equal_count, &set->results[seed]));
  set->count = seed + 1;
  tell_row(a, row, &set->results[seed], " at equal count");
  PAGS_TRY(pags_ablation_write_tables(a));
  return pags_ablation_write_plots(a);
}

static pags_result run_equal(pags_ablation *a) {
  a->equal_count = smallest_count(a);
  if (a->equal_count == 0) {
    pags_say(a->session, "--equal-count: fewer than two rows prune by a score\n");
    return PAGS_OK;
  }
  a->row_name = "equal count";
  for (int seed = 0; seed < PAGS_ABLATION_SEEDS; ++seed)
    for (int row = 0; row < a->row_count; ++row)
      if (a->rows[row].prunes && seed < a->rows[row].seeds)
        PAGS_TRY(run_equal_row(a, row, seed));
  return PAGS_OK;
}

static pags_result write_json(const pags_ablation *a) {
  pags_json_writer w;
  pags_json_writer_init(&w, 2);
  pags_json_begin_object(&w, NULL);
  pags_json_begin_array(&w, "rows");
  for (int i = 0; i < a->row_count; ++i)
    for (int k = 0; k < a->sets[i].count; ++k)
      pags_ablation_put_json(&w, a, i, &a->sets[i].results[k]);
  pags_json_end_array(&w);
  pags_json_put_integer(&w, "equal_count", a->equal_count);
  pags_json_begin_array(&w, "equal_rows");
  for (int i = 0; i < a->row_count; ++i)
    for (int k = 0; k < a->equal_sets[i].count; ++k)
      pags_ablation_put_json(&w, a, i, &a->equal_sets[i].results[k]);
  pags_json_end_array(&w);
  pags_json_end_object(&w);
  return pags_session_json(a->session, &w);
}

static pags_result make_sets(pags_ablation *a) {
  a->sets = calloc((size_t)a->row_count, sizeof *a->sets);
  a->equal_sets = calloc((size_t)a->row_count, sizeof *a->equal_sets);
  bool made = a->sets && a->equal_sets;
  for (int i = 0; made && i < a->row_count; ++i) {
    a->sets[i].results = calloc((size_t)a->rows[i].seeds, sizeof *a->sets[i].results);
    a->equal_sets[i].results = calloc((size_t)a->rows[i].seeds, sizeof *a->equal_sets[i].results);
    made = a->sets[i].results && a->equal_sets[i].results;
  }
  return made ? PAGS_OK : pags_fail(PAGS_ERROR_MEMORY, "out of memory for %d rows", a->row_count);
}

static void destroy(pags_ablation *a) {
  for (int i = 0; i < a->row_count; ++i) {
    if (a->sets)
      free(a->sets[i].results);
    if (a->equal_sets)
      free(a->equal_sets[i].results);
  }
  free(a->sets);
  free(a->equal_sets);
  free(a->rows);
}

static pags_result prepare(const ablation_arguments *arguments, pags_ablation *a) {
  bool standard = !arguments->rows;
  a->rows = calloc(PAGS_ABLATION_ROWS, sizeof *a->rows);
  if (!a->rows)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  PAGS_TRY(
      pags_ablation_rows_parse(standard ? default_rows : arguments->rows, arguments->seeds, a->rows, &a->row_count));
  PAGS_TRY(check_rows(a, standard));
  PAGS_TRY(pags_prepare_folder(a->folder, NULL));
  PAGS_TRY(check_settings(a));
  return make_sets(a);
}

static pags_result run_all(const ablation_arguments *arguments, pags_ablation *a) {
  pags_interrupt_install(NULL);
  PAGS_TRY(prepare(arguments, a));
  count_steps(a);
  a->progress = pags_progress_begin(a->session->people);
  a->begun = pags_seconds();
  pags_result result = run_rows(a);
  if (result == PAGS_OK && a->equal)
    result = run_equal(a);
  pags_progress_end(&a->progress);
  if (result == PAGS_OK)
    pags_say(a->session, "%s.md, %s.csv, %s_curve.csv, %s.svg\n", a->output, a->output, a->output, a->output);
  return result == PAGS_OK ? write_json(a) : result;
}

/* "TABLE.md" means TABLE. Freed by the caller. */
static char *without_extension(const char *name) {
  size_t length = strlen(name);
  if (!strcmp(pags_path_extension(name), ".md"))
    length -= 3;
  char *copy = malloc(length + 1);
  if (copy) {
    memcpy(copy, name, length);
    copy[length] = 0;
  }
  return copy;
}

static pags_result ablate(ablation_arguments *arguments, const char *dataset, int rest, char **words) {
  char *output = without_extension(arguments->output), *folder = NULL, *absolute = realpath(dataset, NULL);
  pags_ablation a = {.session = &arguments->session,
                     .dataset = absolute ? absolute : dataset,
                     .output = output,
                     .lpips_weights = arguments->lpips_weights,
                     .iterations = arguments->iterations,
                     .moments = arguments->moments,
                     .moment_views = arguments->moment_views,
                     .first_seed = arguments->seed,
                     .equal = arguments->equal_count};
  size_t size = output ? strlen(output) + sizeof ".runs" : 0;
  pags_result result = PAGS_OK;
  if (output)
    folder = malloc(size);
  if (!folder)
    result = pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  else
    snprintf(folder, size, "%s.runs", output);
  a.folder = folder;
  if (result == PAGS_OK) {
    gather_options(arguments, rest, words, &a);
    result = run_all(arguments, &a);
  }
  destroy(&a);
  free(absolute);
  free(folder);
  free(output);
  return result;
}

int pags_verb_ablation(int argc, char **argv) {
  enum { MOST_REST = 64 };
  ablation_arguments arguments = {.iterations = 5000, .seeds = 1, .moments = 8, .moment_views = 12};
  pags_parsed parsed;
  int own = 0;
  while (own < argc && strcmp(argv[own], "--"))
    ++own;
  pags_parse_status status = pags_options_parse(&verb, own, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  int rest = own < argc ? argc - own - 1 : 0;
  if (rest > MOST_REST)
    return pags_usage_error(&verb, "more than %d words behind --", MOST_REST);
  if (arguments.moments > arguments.iterations)
    return pags_usage_error(&verb, "--moments: expected at most --iterations");
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK)
    result = ablate(&arguments, parsed.positionals[0], rest, argv + own + (rest ? 1 : 0));
  return pags_session_end(&arguments.session, result);
}
