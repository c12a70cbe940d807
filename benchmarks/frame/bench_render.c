/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench render: measures rendering speed against error, by mode (early-z, exp degree, SH degree) and by stage;
 * writes a table, JSON and CSV. */
#include "benchmarks/frame/modes.h"
#include "benchmarks/verbs.h"
#include "cli/common/progress.h"
#include "cli/common/session.h"
#include "cli/draw/camera_paths.h"
#include "cli/draw/deadline_report.h"

#include <math.h>
#include <pags/compose.h>
#include <pags/packed.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"

enum { MOST_MODES = PAGS_BENCH_MOST_MODES, MOST_SIZES = 8, NAME = 32 };

typedef struct render_bench_arguments {
  pags_session session;
  const char *input, *path, *sizes, *modes, *csv;
  int64_t frames;
  int repetitions, exp_degree; /* exp_degree: index in "3|5" */
  int packed;
  double budget_ms; /* 0: none */
} render_bench_arguments;

#define AT(member) offsetof(render_bench_arguments, member)

static const pags_option options[] = {
    PAGS_TEXT("path", 0, AT(path), "views|ego|orbit|FILE", "views, else orbit",
              "cameras: the scene's training views, the way through them, round the scene, or a camera or path file"),
    PAGS_VALUE("frames", 'n', INT64, AT(frames), 1, 1e6, "N", "pictures", NULL, "spread evenly along the path"),
    PAGS_TEXT("sizes", 0, AT(sizes), "WxH,...", "the cameras'", "sizes to draw at, by width; the middle is kept"),
    PAGS_TEXT("modes", 0, AT(modes), "MODE,...", NULL, PAGS_BENCH_MODE_HELP),
    PAGS_VALUE("repetitions", 'r', INT, AT(repetitions), 1, 1000, "N", "frames", NULL,
               "timed frames of each picture and mode"),
    PAGS_CHOICE("exp-degree", AT(exp_degree), "3|5", NULL, "degree of the polynomial behind exp, as of pags render"),
    PAGS_FLAG("packed", 0, AT(packed), "draw from the packed form"),
    PAGS_VALUE("budget-ms", 0, DOUBLE, AT(budget_ms), 0.1, 1e6, "T", "milliseconds", "none",
               "draw the pictures once more, one after the other, as pags render --budget-ms does, all held against "
               "full quality"),
    PAGS_TEXT("csv", 0, AT(csv), "FILE", NULL, "write a row per size and mode"),
    PAGS_SESSION_OPTIONS(render_bench_arguments),
    {0}};

/* Names the replacement of a removed option. */
static bool replacement(const char *name, char *text, size_t size) {
  if (strcmp(name, "plot") != 0)
    return false;
  snprintf(text, size, "benchmarks/curve.py SCENE -o FILE");
  return true;
}

static const pags_verb verb = {.name = "render",
                               .usage = "SCENE [options]",
                               .about =
                                   "Draws the same pictures by several modes, taking turns, and reports for each: "
                                   "milliseconds by stage (median, 10 and "
                                   "90 per cent of all frames), pictures a second, how much was loaded, shaded, "
                                   "binned, tested and blended, bytes moved by "
                                   "the stages' data structures, and what the picture lost against the first mode: "
                                   "PSNR, largest error, pixels with other bits.",
                               .positionals = {{"SCENE", "a scene folder or a splat file"}},
                               .options = options,
                               .replacement = replacement};

typedef struct size_row {
  int width, height; /* px; 0: the cameras' own size */
} size_row;

/* State of a run. Results are indexed by size, then mode. */
typedef struct render_bench {
  const render_bench_arguments *arguments;
  pags_composition *composition;
  pags_camera_path path;
  pags_bench_mode_list modes;
  size_row sizes[MOST_SIZES];
  int size_count;
  pags_bench_mode_result results[MOST_SIZES][MOST_MODES];
  double layers[MOST_SIZES];
  pags_deadline_report deadlines[MOST_SIZES]; /* with --budget-ms */
  pags_progress progress;
} render_bench;

/* ---- Cameras and sizes ---- */

static bool parse_sizes(const char *list, render_bench *self) {
  char word[NAME], rest;
  while (list && self->size_count < MOST_SIZES && pags_bench_next_word(&list, word, sizeof word)) {
    size_row *size = &self->sizes[self->size_count++];
    if (sscanf(word, "%5dx%5d%c", &size->width, &size->height, &rest) != 2 || size->width < 16 || size->width > 16384 ||
        size->height < 16 || size->height > 16384)
      return false;
  }
  if (self->size_count == 0)
    self->size_count = 1;
  return !list || !*list;
}

/* The same camera at another picture size: scaled by the ratio of the widths, cropped or extended evenly above and
 * below. */
static pags_camera at_size(const pags_camera *camera, const size_row *size) {
  pags_camera out = *camera;
  if (size->width == 0)
    return out;
  const double scale = (double)size->width / camera->width;
  out.width = size->width;
  out.height = size->height;
  out.fx *= scale;
  out.fy *= scale;
  out.cx *= scale;
  out.cy = 0.5 * size->height + (camera->cy - 0.5 * camera->height) * scale;
  return out;
}

static pags_result find_path(const render_bench_arguments *a, const pags_scene *scene, pags_camera_path *path) {
  const char *kind = a->path ? a->path : scene->view_count > 0 ? "views" : "orbit";
  if (!strcmp(kind, "views"))
    PAGS_TRY(pags_camera_path_views(scene, path));
  else if (!strcmp(kind, "orbit"))
    PAGS_TRY(pags_camera_path_orbit(scene, a->frames, PAGS_STAND_AUTO, path));
  else if (strcmp(kind, "ego"))
    PAGS_TRY(pags_camera_path_load(kind, path));
  else if (pags_scene_is_drive(scene))
    PAGS_TRY(pags_camera_path_drive(scene, a->frames, 0, path));
  else
    PAGS_TRY(pags_camera_path_ego(scene, a->frames, path));
  pags_bench_thin(path, a->frames);
  return path->count > 0 ? PAGS_OK : pags_fail(PAGS_ERROR_FORMAT, "%s: there is no view to measure from", a->input);
}

/* ---- Measuring ---- */

static void compose(void *user, double time, const pags_part **parts, int *count) {
  pags_compose(user, time, parts, count);
}

/* With --budget-ms: renders the path's frames in order, as a viewer would request them, within the budget, and
 * compares each with full quality. */
static pags_result keep_deadline(render_bench *self, int index, const pags_camera *cameras) {
  pags_deadline_report *deadline = &self->deadlines[index];
  if (self->arguments->budget_ms <= 0)
    return PAGS_OK;
  PAGS_TRY(pags_deadline_report_create(self->composition, self->arguments->session.tasks, self->arguments->budget_ms, 1,
                                       deadline));
  for (int64_t i = 0; i < self->path.count; i++) {
    const pags_part *parts;
    int count;
    pags_picture picture;
    pags_deadline_result facts;
    if (!pags_progress_watch(&self->progress, (double)i / (double)self->path.count, "within the time"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    pags_compose(self->composition, cameras[i].time, &parts, &count);
    PAGS_TRY(pags_deadline_report_draw(deadline, parts, count, cameras + i, &self->modes.modes[0].options, &picture,
                                       &facts));
  }
  return PAGS_OK;
}

static pags_result measure_size(render_bench *self, int index) {
  pags_camera *cameras = malloc((size_t)self->path.count * sizeof *cameras);
  if (!cameras)
    return pags_out_of_memory("%lld cameras", (long long)self->path.count);
  for (int64_t i = 0; i < self->path.count; i++)
    cameras[i] = at_size(self->path.cameras + i, &self->sizes[index]);
  self->sizes[index] = (size_row){cameras[0].width, cameras[0].height};
  const pags_bench_frames frames = {.tasks = self->arguments->session.tasks,
                                    .compose = compose,
                                    .user = self->composition,
                                    .cameras = cameras,
                                    .camera_count = self->path.count,
                                    .modes = self->modes.modes,
                                    .mode_count = self->modes.count,
                                    .repetitions = self->arguments->repetitions,
                                    .progress = pags_progress_watch,
                                    .progress_user = &self->progress};
  pags_result result = pags_bench_modes(&frames, self->results[index], NULL);
  if (result == PAGS_OK) {
    /* Mean depth complexity over the cameras, in Gaussians per pixel. */
    double sum = 0;
    for (int64_t i = 0; i < self->path.count; i++) {
      const pags_part *parts;
      int count;
      pags_compose(self->composition, cameras[i].time, &parts, &count);
      sum += pags_bench_layers(parts, count, cameras + i, &self->modes.modes[0].options);
    }
    self->layers[index] = sum / (double)self->path.count;
  }
  if (result == PAGS_OK)
    result = keep_deadline(self, index, cameras);
  free(cameras);
  return result;
}

/* ---- Printed table and JSON ---- */

/* Milliseconds over a million units, in nanoseconds a unit; 0 where there is nothing to do. */
static double each_ns(const pags_bench_mode_result *r, int stage, int64_t units) {
  return units > 0 ? r->ms[stage].median * 1e6 / (double)units : 0.0;
}

/* Share of the bare kernel's speed that the raster stage has, the sky's blending included. */
static double share_of_bare(const pags_bench_mode_result *r) {
  const double ms = r->ms[PAGS_BENCH_RASTER].median;
  return ms > 0 && r->peak > 0 ? (double)r->counts.pairs_evaluated / ms * 1e3 / r->peak : 0.0;
}

/* The work of each stage: time per unit, the rasteriser compared with the bare kernel, and what an early stop could
 * still bring. */
static void say_work(const render_bench *self, const pags_bench_mode_result *results) {
  const pags_session *session = &self->arguments->session;
  pags_say(session, "%-16s %11s %11s %11s %11s %11s %9s   %s\n", "ns each", "project", "shade", "bin", "sort", "raster",
           "of bare", "perfect stop: pairs, tested, ms (times as fast)");
  pags_say(session, "%-16s %11s %11s %11s %11s %11s\n", "", "loaded", "shaded", "pair", "pair", "tested");
  for (int k = 0; k < self->modes.count; k++) {
    const pags_bench_mode_result *const r = &results[k];
    const pags_frame_stats *const s = &r->counts;
    const double perfect = pags_bench_perfect_ms(r);
    pags_say(session, "%-16s %11.2f %11.2f %11.2f %11.2f %11.4f %7.0f %%   ", self->modes.modes[k].name,
             each_ns(r, PAGS_BENCH_PROJECT, s->loaded), each_ns(r, PAGS_BENCH_SHADE, s->shaded),
             each_ns(r, PAGS_BENCH_BIN, s->pairs_binned), each_ns(r, PAGS_BENCH_SORT, s->pairs_binned),
             each_ns(r, PAGS_BENCH_RASTER, s->pairs_evaluated), 100 * share_of_bare(r));
    pags_say(session, "%lld, %.1fM, %.2f (%.2f)\n", (long long)s->pairs_reached, (double)s->pairs_open * 1e-6, perfect,
             perfect > 0 ? r->ms[PAGS_BENCH_FRAME].median / perfect : 0.0);
  }
}

static void say_size(const render_bench *self, int index) {
  const pags_session *session = &self->arguments->session;
  const pags_bench_mode_result *results = self->results[index];
  const double pixels = (double)self->sizes[index].width * self->sizes[index].height;
  pags_say(session, "\n%dx%d, %lld pictures, %d frames each; %.1f Gaussians a pixel, %.1f of them blended by %s\n",
           self->sizes[index].width, self->sizes[index].height, (long long)self->path.count,
           self->arguments->repetitions, self->layers[index], (double)results[0].counts.pairs_blended / pixels,
           self->modes.modes[0].name);
  pags_say(session, "%-16s %8s %15s %7s %8s %9s %9s %9s %9s %9s %8s %8s %8s %9s %9s %7s\n", "mode", "ms", "10..90 %",
           "FPS", "speed-up", "in view", "loaded", "shaded", "binned", "pairs", "tested", "blended", "MB", "PSNR dB",
           "max error", "differ");
  for (int k = 0; k < self->modes.count; k++) {
    const pags_bench_mode_result *r = &results[k];
    const pags_frame_stats *s = &r->counts;
    const pags_bench_span *ms = &r->ms[PAGS_BENCH_STAGES - 1];
    pags_say(session, "%-16s %8.2f %7.2f %7.2f %7.1f %8.2f %9lld %9lld %9lld %9lld %9lld %7.1fM %7.1fM %8.1f ",
             self->modes.modes[k].name, ms->median, ms->low, ms->high, 1000 / ms->median, r->speed_up,
             (long long)s->in_view, (long long)s->loaded, (long long)s->shaded, (long long)s->binned,
             (long long)s->pairs_binned, (double)s->pairs_evaluated * 1e-6, (double)s->pairs_blended * 1e-6,
             r->bytes * 1e-6);

    /* Print the error against the first mode. */
    bool reference = k == 0;
    if (reference)
      pags_say(session, "%9s %9s %7s\n", "-", "-", "-");
    else if (isinf(r->psnr))
      pags_say(session, "%9s %9.2g %6.2f%%\n", "same", r->max_error, 100 * r->differing);
    else
      pags_say(session, "%9.2f %9.2g %6.2f%%\n", r->psnr, r->max_error, 100 * r->differing);
  }
  pags_say(session, "%-16s", "ms by stage");
  for (int i = 0; i < PAGS_BENCH_STAGES - 1; i++)
    pags_say(session, " %8s", pags_bench_stage_names[i]);
  pags_say(session, "\n");
  for (int k = 0; k < self->modes.count; k++) {
    pags_say(session, "%-16s", self->modes.modes[k].name);
    for (int i = 0; i < PAGS_BENCH_STAGES - 1; i++)
      pags_say(session, " %8.2f", results[k].ms[i].median);
    pags_say(session, "\n");
  }
  say_work(self, results);
  if (self->arguments->budget_ms > 0)
    pags_deadline_report_print(&self->deadlines[index], session);
}

static void put_mode(pags_json_writer *json, const char *name, const pags_bench_mode_result *r, int64_t pictures) {
  const pags_frame_stats *s = &r->counts;
  pags_json_begin_object(json, NULL);
  pags_json_put_string(json, "mode", name);
  pags_json_begin_object(json, "ms");
  for (int i = 0; i < PAGS_BENCH_STAGES; i++) {
    /* Write the stage's median and 10 and 90 per cent quantiles. */
    pags_json_begin_object(json, pags_bench_stage_names[i]);
    pags_json_put_number(json, "median", r->ms[i].median);
    pags_json_put_number(json, "low", r->ms[i].low);
    pags_json_put_number(json, "high", r->ms[i].high);
    pags_json_end_object(json);
  }
  pags_json_end_object(json);
  pags_json_begin_array(json, "frame_ms"); /* of each picture along the path */
  for (int64_t i = 0; i < pictures; i++)
    pags_json_put_number(json, NULL, r->frame_ms[i]);
  pags_json_end_array(json);
  pags_json_put_number(json, "fps", 1000 / r->ms[PAGS_BENCH_STAGES - 1].median);
  pags_json_put_number(json, "speed_up", r->speed_up);
  pags_json_put_integer(json, "gaussians", s->gaussians);
  pags_json_put_integer(json, "in_view", s->in_view);
  pags_json_put_integer(json, "loaded", s->loaded);
  pags_json_put_integer(json, "hidden", s->hidden);
  pags_json_put_integer(json, "shaded", s->shaded);
  pags_json_put_integer(json, "binned", s->binned);
  pags_json_put_integer(json, "pairs_binned", s->pairs_binned);
  pags_json_put_integer(json, "pairs_evaluated", s->pairs_evaluated);
  pags_json_put_integer(json, "pairs_blended", s->pairs_blended);
  pags_json_put_integer(json, "pairs_reached", s->pairs_reached);
  pags_json_put_integer(json, "pairs_open", s->pairs_open);
  pags_json_put_number(json, "share_of_bare", share_of_bare(r));
  pags_json_put_number(json, "perfect_stop_ms", pags_bench_perfect_ms(r));
  pags_json_put_number(json, "bytes_moved", r->bytes);
  if (isinf(r->psnr))
    pags_json_put_null(json, "psnr"); /* infinite: the pictures are equal */
  else
    pags_json_put_number(json, "psnr", r->psnr);
  pags_json_put_number(json, "max_error", r->max_error);
  pags_json_put_number(json, "max_alpha_error", r->max_alpha_error);
  pags_json_put_number(json, "differing", r->differing);
  pags_json_end_object(json);
}

/* ---- CSV ---- */

static pags_result put_csv_row(pags_file_writer *file, const render_bench *self, int size, int mode) {
  const pags_bench_mode_result *r = &self->results[size][mode];
  const pags_frame_stats *s = &r->counts;
  char line[1024];
  int length = snprintf(line, sizeof line, "%d,%d,%s", self->sizes[size].width, self->sizes[size].height,
                        self->modes.modes[mode].name);
  for (int i = 0; i < PAGS_BENCH_STAGES; i++)
    length += snprintf(line + length, sizeof line - (size_t)length, ",%.4f,%.4f,%.4f", r->ms[i].median, r->ms[i].low,
                       r->ms[i].high);
  length += snprintf(line + length, sizeof line - (size_t)length,
                     ",%.3f,%.4f,%lld,%lld,%lld,%lld,%lld,%lld,%lld,%lld,%lld,%.0f,%.3f,%.4f",
                     1000 / r->ms[PAGS_BENCH_STAGES - 1].median, r->speed_up, (long long)s->gaussians,
                     (long long)s->in_view, (long long)s->loaded, (long long)s->hidden, (long long)s->shaded,
                     (long long)s->binned, (long long)s->pairs_binned, (long long)s->pairs_evaluated,
                     (long long)s->pairs_blended, r->bytes, self->layers[size], r->psnr);
  length += snprintf(line + length, sizeof line - (size_t)length, ",%.3e,%.3e,%.6f\n", r->max_error, r->max_alpha_error,
                     r->differing);
  return pags_file_writer_put(file, line, (size_t)length);
}

static pags_result write_csv(const render_bench *self) {
  char head[1024];
  int length = snprintf(head, sizeof head, "width,height,mode");
  for (int i = 0; i < PAGS_BENCH_STAGES; i++)
    length += snprintf(head + length, sizeof head - (size_t)length, ",%s_ms,%s_ms_low,%s_ms_high",
                       pags_bench_stage_names[i], pags_bench_stage_names[i], pags_bench_stage_names[i]);
  length += snprintf(head + length, sizeof head - (size_t)length,
                     ",fps,speed_up,gaussians,in_view,loaded,hidden,shaded,binned,pairs_binned,pairs_evaluated,pairs_"
                     "blended,bytes_moved,"
                     "gaussians_per_pixel,psnr,max_error,max_alpha_error,differing\n");
  pags_file_writer file;
  if (!self->arguments->csv)
    return PAGS_OK;
  PAGS_TRY(pags_file_writer_begin(&file, self->arguments->csv));
  PAGS_TRY(pags_file_writer_put(&file, head, (size_t)length));
  for (int i = 0; i < self->size_count; i++)
    for (int k = 0; k < self->modes.count; k++)
      PAGS_TRY(put_csv_row(&file, self, i, k));
  return pags_file_writer_commit(&file);
}

/* ---- The benchmark ---- */

static pags_result load(render_bench *self) {
  const render_bench_arguments *a = self->arguments;
  pags_scene scene;
  if (pags_packed_is_file(a->input)) {
    PAGS_TRY(pags_composition_open_packed(a->input, &self->composition));
    return a->path && strcmp(a->path, "orbit")
               ? find_path(a, pags_composition_scene(self->composition), &self->path)
               : pags_fail(PAGS_ERROR_ARGUMENT, "%s: a packed file has no views: expected --path FILE", a->input);
  }
  PAGS_TRY(pags_scene_load(a->input, &scene));
  const pags_result result = find_path(a, &scene, &self->path);
  if (result == PAGS_OK)
    PAGS_TRY(pags_composition_create(&scene, &self->composition));
  else
    pags_scene_destroy(&scene);
  if (result == PAGS_OK && a->packed)
    PAGS_TRY(pags_composition_pack(self->composition));
  return result;
}

static pags_result run(render_bench *self) {
  const render_bench_arguments *a = self->arguments;
  if (a->csv)
    PAGS_TRY(pags_check_writable(a->csv));
  PAGS_TRY(load(self));

  /* Parse --modes, each mode being a change of the scene's options with early-z off. */
  pags_frame_options standard = pags_composition_options(self->composition);
  standard.early_z = PAGS_EARLY_Z_OFF;
  standard.exp_degree = self->arguments->exp_degree ? 5 : 3;
  PAGS_TRY(pags_bench_modes_parse(self->arguments->modes, &standard, &self->modes));

  pags_interrupt_install(a->session.tasks);
  self->progress = pags_progress_begin(a->session.people);
  pags_result result = PAGS_OK;
  for (int i = 0; i < self->size_count && result == PAGS_OK; i++)
    result = measure_size(self, i);
  pags_progress_end(&self->progress);
  PAGS_TRY(result);
  pags_say(&a->session, "%s: %lld Gaussians on %d threads\n", a->input,
           (long long)pags_composition_gaussian_count(self->composition), pags_tasks_workers(a->session.tasks));
  for (int i = 0; i < self->size_count; i++)
    say_size(self, i);
  PAGS_TRY(write_csv(self));

  /* Write the results as JSON, by size and mode. */
  pags_json_writer json;
  pags_json_writer_init(&json, 2);
  pags_json_begin_object(&json, NULL);
  pags_json_put_integer(&json, "threads", pags_tasks_workers(self->arguments->session.tasks));
  pags_json_put_integer(&json, "gaussians", pags_composition_gaussian_count(self->composition));
  pags_json_put_integer(&json, "pictures", self->path.count);
  pags_json_put_integer(&json, "repetitions", self->arguments->repetitions);
  pags_json_begin_array(&json, "sizes");
  for (int i = 0; i < self->size_count; i++) {
    pags_json_begin_object(&json, NULL);
    pags_json_put_integer(&json, "width", self->sizes[i].width);
    pags_json_put_integer(&json, "height", self->sizes[i].height);
    pags_json_put_number(&json, "gaussians_per_pixel", self->layers[i]);
    pags_json_begin_array(&json, "modes");
    for (int k = 0; k < self->modes.count; k++)
      put_mode(&json, self->modes.modes[k].name, &self->results[i][k], self->path.count);
    pags_json_end_array(&json);
    if (self->arguments->budget_ms > 0)
      pags_deadline_report_put(&self->deadlines[i], &json);
    pags_json_end_object(&json);
  }
  pags_json_end_array(&json);
  return pags_session_json(&self->arguments->session, &json);
}

int pags_bench_render(int argc, char **argv) {
  render_bench_arguments arguments = {.modes = "off,lossless,bounded", .frames = 12, .repetitions = 5, .exp_degree = 1};
  render_bench self = {.arguments = &arguments};
  pags_parsed parsed;
  const pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  arguments.input = parsed.positionals[0];
  if (!parse_sizes(arguments.sizes, &self))
    return pags_usage_error(&verb,
                            "--sizes: expected WIDTHxHEIGHT, each 16..16384, at most %d separated by commas, got '%s'",
                            MOST_SIZES, arguments.sizes);
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK)
    result = run(&self);
  for (int i = 0; i < self.size_count; i++) {
    pags_bench_modes_free(self.results[i], self.modes.count);
    pags_deadline_report_destroy(&self.deadlines[i]);
  }
  pags_composition_destroy(self.composition);
  pags_camera_path_destroy(&self.path);
  return pags_session_end(&arguments.session, result);
}
