/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench scale: measures whether the time of a frame depends on the number of visible Gaussians or on the number
 * in the scene.
 *
 * The scene's background is copied along x, so that the number of Gaussians grows while the same cameras look from
 * the first copy. Each number is measured in two forms: as parts that share one set of rows (memory of one copy,
 * whatever the number, so that only time is measured), and as a packed file that contains every row and is
 * memory-mapped. */
#include "benchmarks/frame/modes.h"
#include "benchmarks/verbs.h"
#include "cli/common/progress.h"
#include "cli/common/session.h"
#include "cli/draw/camera_paths.h"

#include <math.h>
#include <pags/compose.h>
#include <pags/packed.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "port/port.h"

enum { MOST_STEPS = 16, WORD = 32, FORMS = 2 };
static const char *const form_names[FORMS] = {"shared", "packed"};

typedef struct scale_arguments {
  pags_session session;
  const char *input, *millions, *modes, *folder, *csv, *camera;
  int frames, repetitions, form; /* form: index in "both|shared|packed" */
  double spacing;
} scale_arguments;

#define AT(member) offsetof(scale_arguments, member)

static const pags_option options[] = {
    PAGS_TEXT("millions", 0, AT(millions), "M,...", NULL, "Gaussians to measure with, in millions"),
    PAGS_CHOICE("form", AT(form), "both|shared|packed", NULL, "parts that share rows, files with every row, or both"),
    PAGS_TEXT("scratch", 0, AT(folder), "FOLDER", NULL, "where the packed files go, one at a time, removed after use"),
    PAGS_TEXT("modes", 0, AT(modes), "MODE,...", NULL, PAGS_BENCH_MODE_HELP),
    PAGS_TEXT("camera", 0, AT(camera), "FILE", "the scene's training views", "measure from this camera or path file"),
    PAGS_VALUE("frames", 'n', INT, AT(frames), 1, 1000, "N", "pictures", NULL, "spread evenly over the views"),
    PAGS_VALUE("repetitions", 'r', INT, AT(repetitions), 1, 1000, "N", "frames", NULL,
               "timed frames of each picture and mode"),
    PAGS_VALUE("spacing", 0, DOUBLE, AT(spacing), 0, PAGS_UNLIMITED, "METRES", "metres", "the scene's own length",
               "from one copy to the next, along x"),
    PAGS_TEXT("csv", 0, AT(csv), "FILE", NULL, "write a row per number, form and mode"),
    PAGS_SESSION_OPTIONS(scale_arguments),
    {0}};

static const pags_verb verb = {
    .name = "scale",
    .usage = "SCENE [options]",
    .about =
        "Copies a scene's background along x until there are so many Gaussians and draws the same views: milliseconds "
        "against "
        "what exists, what is in view and what is loaded, and memory. Shared: copies are parts over the same rows, "
        "which costs "
        "the memory of one. Packed: a file with every row, mapped; resident is what was looked at.",
    .positionals = {{"SCENE", "a scene folder; its background is copied (pags synth town)"}},
    .options = options};

typedef struct scale_row {
  int form, mode;
  double millions;
  int64_t gaussians;
  int64_t rows_bytes, frame_bytes, resident;
  pags_bench_mode_result result;
} scale_row;

typedef struct scale_bench {
  const scale_arguments *arguments;
  pags_gaussians rows; /* the background's Gaussians in Morton order */
  pags_clusters clusters;
  pags_frame_options options;
  pags_sky sky;
  pags_camera_path path;
  double spacing;
  pags_bench_mode_list modes;
  double steps[MOST_STEPS]; /* numbers of Gaussians to measure, in millions */
  int step_count;
  scale_row *table;
  int table_count;
  pags_progress progress;
} scale_bench;

/* ---- Loading the scene ---- */

static bool parse_steps(const char *list, scale_bench *self) {
  char word[WORD], *end;
  while (self->step_count < MOST_STEPS && pags_bench_next_word(&list, word, sizeof word)) {
    const double value = strtod(word, &end);
    if (*end || !(value >= 0.001 && value <= 2000))
      return false;
    self->steps[self->step_count++] = value;
  }
  return !*list && self->step_count > 0;
}

static pags_result out_of_memory(const scale_bench *self) {
  return pags_out_of_memory("%s", self->arguments->input);
}

static pags_result find_cameras(scale_bench *self, const pags_scene *scene) {
  const scale_arguments *a = self->arguments;
  PAGS_TRY(a->camera ? pags_camera_path_load(a->camera, &self->path) : pags_camera_path_views(scene, &self->path));
  pags_bench_thin(&self->path, a->frames);
  return self->path.count > 0 ? PAGS_OK
                              : pags_fail(PAGS_ERROR_FORMAT, "%s: there is no view to measure from", a->input);
}

static pags_result sort_rows(scale_bench *self, const pags_gaussians *from) {
  int64_t *order = malloc((size_t)(from->count + 1) * sizeof *order);
  if (!order)
    return out_of_memory(self);
  pags_result result = pags_gaussians_morton_order(from, order);
  if (result == PAGS_OK)
    result = pags_gaussians_create(&self->rows, from->count, from->sh_degree);
  if (result == PAGS_OK && from->s_sem)
    result = pags_gaussians_add_s_sem(&self->rows);
  if (result == PAGS_OK)
    pags_gaussians_gather(from, order, from->count, &self->rows);
  free(order);
  PAGS_TRY(result);
  PAGS_TRY(pags_clusters_create(&self->clusters, self->rows.count, PAGS_PACKED_ROWS));
  pags_clusters_update(&self->clusters, &self->rows, 0, self->clusters.count);
  return pags_clusters_add_runs(&self->clusters);
}

static pags_result load(scale_bench *self) {
  pags_scene scene;
  PAGS_TRY(pags_scene_load(self->arguments->input, &scene));
  pags_result result = scene.model_count > 0 && scene.models[0].gaussians.count >= PAGS_PACKED_ROWS
                           ? find_cameras(self, &scene)
                           : pags_fail(PAGS_ERROR_FORMAT, "%s: expected a background of at least %d Gaussians",
                                       self->arguments->input, PAGS_PACKED_ROWS);
  if (result == PAGS_OK)
    result = sort_rows(self, &scene.models[0].gaussians);
  self->options = pags_frame_options_default();
  for (int k = 0; k < 3; k++) {
    self->options.origin[k] = scene.origin[k];
    self->options.background[k] = scene.background[k];
  }
  self->options.antialiased = scene.antialiased;
  self->sky = scene.sky;
  scene.sky = (pags_sky){0};
  self->options.sky = self->sky.size ? &self->sky : NULL;
  pags_scene_destroy(&scene);
  PAGS_TRY(result);

  /* The spacing of the copies: --spacing, else the background's length along x between its 0.1 % and 99.9 %
   * quantiles. */
  const int64_t count = self->rows.count;
  float *x = malloc((size_t)(count + 1) * sizeof *x);
  if (!x)
    return out_of_memory(self);
  memcpy(x, pags_plane(&self->rows, PAGS_MEAN), (size_t)count * sizeof *x);
  pags_sort_floats(x, count);
  self->spacing = self->arguments->spacing > 0 ? self->arguments->spacing
                  : count > 0                  ? (double)(x[count - 1 - count / 1000] - x[count / 1000])
                                               : 1;
  free(x);
  return PAGS_OK;
}

/* ---- Measuring ---- */

/* The parts to render for one number of Gaussians. */
typedef struct stage {
  pags_part *parts;
  int count;
} stage;

static void compose(void *user, double time, const pags_part **parts, int *count) {
  const stage *s = user;
  (void)time;
  *parts = s->parts;
  *count = s->count;
}

static pags_result measure(scale_bench *self, stage *s, int form, double millions, int64_t rows_bytes) {
  const pags_bench_frames frames = {.tasks = self->arguments->session.tasks,
                                    .compose = compose,
                                    .user = s,
                                    .cameras = self->path.cameras,
                                    .camera_count = self->path.count,
                                    .modes = self->modes.modes,
                                    .mode_count = self->modes.count,
                                    .repetitions = self->arguments->repetitions,
                                    .progress = pags_progress_watch,
                                    .progress_user = &self->progress};
  pags_bench_mode_result results[PAGS_BENCH_MOST_MODES];
  int64_t frame_bytes = 0;
  const pags_result result = pags_bench_modes(&frames, results, &frame_bytes);
  for (int k = 0; k < self->modes.count && result == PAGS_OK; k++)
    self->table[self->table_count++] = (scale_row){.form = form,
                                                   .mode = k,
                                                   .millions = millions,
                                                   .gaussians = results[k].counts.gaussians,
                                                   .rows_bytes = rows_bytes,
                                                   .frame_bytes = frame_bytes,
                                                   .resident = (int64_t)pags_port_resident_memory(),
                                                   .result = results[k]};
  pags_bench_modes_free(results, self->modes.count);
  return result;
}

/* ---- Shared and packed copies ---- */

/* Returns the number of rows in a packed copy, in whole clusters: all of them, or, if only `left` more Gaussians are
 * wanted, the first ones along the Morton curve. */
static int64_t rows_of_copy(const scale_bench *self, int64_t left) {
  const int64_t whole = self->rows.count / PAGS_PACKED_ROWS * PAGS_PACKED_ROWS;
  return left < whole ? (left + PAGS_PACKED_ROWS - 1) / PAGS_PACKED_ROWS * PAGS_PACKED_ROWS : whole;
}

static pags_result measure_shared(scale_bench *self, double millions) {
  const int64_t wanted = (int64_t)(millions * 1e6 + 0.5), all = self->rows.count, copies = (wanted + all - 1) / all;
  const int64_t left = wanted - (copies - 1) * all,
                rounded = (left + PAGS_PACKED_ROWS - 1) / PAGS_PACKED_ROWS * PAGS_PACKED_ROWS;
  pags_gaussians cut = self->rows; /* the last copy: the first of the shared rows only */
  pags_clusters few = self->clusters;
  stage s = {calloc((size_t)copies, sizeof(pags_part)), (int)copies};
  if (!s.parts)
    return out_of_memory(self);
  cut.count = rounded < all ? rounded : all;
  few.count = (cut.count + PAGS_PACKED_ROWS - 1) / PAGS_PACKED_ROWS;
  for (int64_t i = 0; i < copies; i++) {
    const bool last = i + 1 == copies;
    s.parts[i] = (pags_part){.gaussians = last ? &cut : &self->rows,
                             .clusters = last ? &few : &self->clusters,
                             .first_id = (int32_t)(i * self->rows.count),
                             .world_from_model = {1, 0, 0, (double)i * self->spacing, 0, 1, 0, 0, 0, 0, 1, 0}};
  }
  const int64_t bytes = self->rows.stride * (pags_plane_count(self->rows.sh_degree) + (self->rows.s_sem != NULL)) * 4 +
                        self->clusters.count * 28;
  const pags_result result = measure(self, &s, 0, millions, bytes);
  free(s.parts);
  return result;
}

static pags_result write_packed(const scale_bench *self, const char *path, double millions) {
  const int64_t wanted = (int64_t)(millions * 1e6 + 0.5), whole = rows_of_copy(self, INT64_MAX);
  const int64_t copies = wanted < whole ? 1 : (wanted + whole / 2) / whole;
  pags_gaussians cut = self->rows;
  pags_packed packed;
  double *offsets = calloc((size_t)copies, 3 * sizeof *offsets);
  if (!offsets)
    return out_of_memory(self);
  for (int64_t i = 0; i < copies; i++)
    offsets[3 * i] = (double)i * self->spacing;
  if (copies == 1)
    cut.count = rows_of_copy(self, wanted);
  pags_result result = pags_packed_create(&cut, &packed);
  if (result == PAGS_OK) {
    result = pags_packed_save(path, &packed, copies, offsets);
    pags_packed_destroy(&packed);
  }
  free(offsets);
  return result;
}

static pags_result measure_packed(scale_bench *self, double millions) {
  char name[64];
  pags_packed packed;
  snprintf(name, sizeof name, "scale_%g.pagsz", millions);
  char *path = pags_path_join(self->arguments->folder, name);
  if (!path)
    return out_of_memory(self);
  pags_result result = write_packed(self, path, millions);
  if (result == PAGS_OK)
    result = pags_packed_open(path, &packed);
  if (result == PAGS_OK) {
    pags_part part = {.gaussians = &packed.shape,
                      .clusters = &packed.clusters,
                      .packed = &packed,
                      .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    stage s = {&part, 1};
    result = measure(self, &s, 1, millions, (int64_t)pags_packed_bytes(&packed));
    pags_packed_destroy(&packed);
  }
  pags_port_remove_file(path);
  free(path);
  return result;
}

/* ---- Output ---- */

static pags_result write_json(const scale_bench *self) {
  pags_json_writer json;
  pags_json_writer_init(&json, 2);
  pags_json_begin_object(&json, NULL);
  pags_json_put_integer(&json, "threads", pags_tasks_workers(self->arguments->session.tasks));
  pags_json_put_number(&json, "spacing", self->spacing);
  pags_json_begin_array(&json, "rows");
  for (int i = 0; i < self->table_count; i++) {
    const scale_row *r = &self->table[i];
    const pags_bench_span *ms = &r->result.ms[PAGS_BENCH_STAGES - 1];
    pags_json_begin_object(&json, NULL);
    pags_json_put_number(&json, "millions", r->millions);
    pags_json_put_string(&json, "form", form_names[r->form]);
    pags_json_put_string(&json, "mode", self->modes.names[r->mode]);
    pags_json_put_integer(&json, "gaussians", r->gaussians);
    pags_json_put_integer(&json, "in_view", r->result.counts.in_view);
    pags_json_put_integer(&json, "loaded", r->result.counts.loaded);
    pags_json_put_integer(&json, "shaded", r->result.counts.shaded);
    pags_json_put_number(&json, "ms_median", ms->median);
    pags_json_put_number(&json, "ms_low", ms->low);
    pags_json_put_number(&json, "ms_high", ms->high);
    pags_json_put_number(&json, "max_error", r->result.max_error);
    pags_json_put_integer(&json, "rows_bytes", r->rows_bytes);
    pags_json_put_integer(&json, "frame_bytes", r->frame_bytes);
    pags_json_put_integer(&json, "resident_bytes", r->resident);
    pags_json_end_object(&json);
  }
  pags_json_end_array(&json);
  return pags_session_json(&self->arguments->session, &json);
}

static pags_result write_csv(const scale_bench *self) {
  static const char head[] =
      "millions,form,mode,gaussians,in_view,loaded,shaded,ms,ms_low,ms_high,rows_bytes,frame_bytes,resident_bytes\n";
  pags_file_writer file;
  if (!self->arguments->csv)
    return PAGS_OK;
  PAGS_TRY(pags_file_writer_begin(&file, self->arguments->csv));
  PAGS_TRY(pags_file_writer_put(&file, head, sizeof head - 1));
  for (int i = 0; i < self->table_count; i++) {
    const scale_row *r = &self->table[i];
    const pags_bench_span *ms = &r->result.ms[PAGS_BENCH_STAGES - 1];
    char line[400];
    const int length = snprintf(line, sizeof line, "%g,%s,%s,%lld,%lld,%lld,%lld,%.3f,%.3f,%.3f,%lld,%lld,%lld\n",
                                r->millions, form_names[r->form], self->modes.names[r->mode], (long long)r->gaussians,
                                (long long)r->result.counts.in_view, (long long)r->result.counts.loaded,
                                (long long)r->result.counts.shaded, ms->median, ms->low, ms->high,
                                (long long)r->rows_bytes, (long long)r->frame_bytes, (long long)r->resident);
    PAGS_TRY(pags_file_writer_put(&file, line, (size_t)length));
  }
  return pags_file_writer_commit(&file);
}

/* ---- The benchmark ---- */

static pags_result run(scale_bench *self) {
  const scale_arguments *a = self->arguments;
  if (a->csv)
    PAGS_TRY(pags_check_writable(a->csv));
  PAGS_TRY(load(self));
  PAGS_TRY(pags_bench_modes_parse(a->modes, &self->options, &self->modes));
  self->table = calloc((size_t)(self->step_count * self->modes.count * FORMS), sizeof *self->table);
  if (!self->table)
    return out_of_memory(self);
  pags_interrupt_install(a->session.tasks);
  self->progress = pags_progress_begin(a->session.people);
  pags_result result = PAGS_OK;
  for (int i = 0; i < self->step_count && result == PAGS_OK; i++) {
    if (a->form != 2)
      result = measure_shared(self, self->steps[i]);
    if (a->form != 1 && result == PAGS_OK)
      result = measure_packed(self, self->steps[i]);
  }
  pags_progress_end(&self->progress);
  PAGS_TRY(result);

  /* Print the table. */
  const pags_session *session = &self->arguments->session;
  pags_say(session, "%8s %-7s %-14s %12s %10s %10s %10s %9s %17s %9s %8s %9s %9s\n", "millions", "form", "mode",
           "Gaussians", "in view", "loaded", "shaded", "ms", "10..90 %", "rows MB", "B/Gauss", "frame MB", "RSS MB");
  for (int i = 0; i < self->table_count; i++) {
    const scale_row *r = &self->table[i];
    const pags_bench_span *ms = &r->result.ms[PAGS_BENCH_STAGES - 1];
    pags_say(session, "%8g %-7s %-14s %12lld %10lld %10lld %10lld %9.2f %8.2f %8.2f %9.1f %8.1f %9.1f %9.1f\n",
             r->millions, form_names[r->form], self->modes.names[r->mode], (long long)r->gaussians,
             (long long)r->result.counts.in_view, (long long)r->result.counts.loaded,
             (long long)r->result.counts.shaded, ms->median, ms->low, ms->high, (double)r->rows_bytes * 1e-6,
             (double)r->rows_bytes / (double)r->gaussians, (double)r->frame_bytes * 1e-6, (double)r->resident * 1e-6);
  }

  PAGS_TRY(write_csv(self));
  return write_json(self);
}

int pags_bench_scale(int argc, char **argv) {
  scale_arguments arguments = {
      .millions = "0.1,1,5,20,50", .modes = "off,lossless", .folder = ".", .frames = 6, .repetitions = 3};
  scale_bench self = {.arguments = &arguments};
  pags_parsed parsed;
  const pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  arguments.input = parsed.positionals[0];
  if (!parse_steps(arguments.millions, &self))
    return pags_usage_error(&verb,
                            "--millions: expected at most %d numbers from 0.001 to 2000 separated by commas, got '%s'",
                            MOST_STEPS, arguments.millions);
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK)
    result = run(&self);
  pags_gaussians_destroy(&self.rows);
  pags_clusters_destroy(&self.clusters);
  pags_sky_destroy(&self.sky);
  pags_camera_path_destroy(&self.path);
  free(self.table);
  return pags_session_end(&arguments.session, result);
}
