/* One training of an ablation, in stretches, and its evaluation. All of it runs in processes of its own.
 *
 * In the run's folder:
 *   scene/               what pags train writes
 *   run.json             the moments reached, and what was spent since the last
 *   known_STEP.pags      the checkpoint that run.json speaks of (a link to what was scene/checkpoint.pags then); where
 *                        rows are to be compared at equal count, those of earlier moments, too, and in the end the last
 *                        one before the last prune
 *   eval*.json, render*.json   of the finished scene, as far as they are there
 *
 * The time of a stretch is known once pags train has reported it, at its end or when it was interrupted. Work that
 * ended without a report (a killed process, a power cut) is done again from known_STEP.pags, so that no time goes
 * missing from the table. */
#include "ablation.h"
#include "interrupt.h"

#include <base/file.h>
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MOST_PATH = 4096 };

typedef struct run {
  pags_ablation *ablation;
  const pags_ablation_row *row;
  int seed;
  char folder[MOST_PATH], scene[MOST_PATH + 16], state[MOST_PATH + 16];
  char seed_text[24], threads_text[16], most_views[16];
  /* run.json */
  int64_t step;                            /* of the checkpoint that is known; 0: none */
  double seconds, cpu_seconds, peak_bytes; /* spent up to it */
  int count;
  pags_ablation_moment moments[PAGS_ABLATION_MOMENTS];
} run;

/* Names of files. */

/* The options, as a folder's name: "preset-short_alpha-0.4_seed-0". */
static void name_folder(const pags_ablation_row *row, uint64_t seed, char *out, size_t size) {
  size_t at = 0;
  for (int i = 0; i < row->train.count; ++i) {
    const char *word = row->train.items[i];
    bool option = !strncmp(word, "--", 2);
    if (at < size)
      at += (size_t)snprintf(out + at, size - at, "%s%s", at == 0 ? "" : option ? "_" : "-", word + (option ? 2 : 0));
  }
  if (at < size)
    snprintf(out + at, size - at, "%sseed-%llu", at ? "_" : "", (unsigned long long)seed);
  for (char *c = out; *c; ++c)
    if (!isalnum((unsigned char)*c) && !strchr(".-_", *c))
      *c = '_';
}

static pags_result name_run(pags_ablation *ablation, const pags_ablation_row *row, int seed, run *self) {
  char name[512];
  uint64_t number = ablation->first_seed + (uint64_t)seed;
  *self = (run){.ablation = ablation, .row = row, .seed = seed};
  name_folder(row, number, name, sizeof name);
  int length = snprintf(self->folder, sizeof self->folder, "%s/%s", ablation->folder, name);
  if (length < 0 || (size_t)length >= sizeof self->folder)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: the path is too long", ablation->folder);
  snprintf(self->scene, sizeof self->scene, "%s/scene", self->folder);
  snprintf(self->state, sizeof self->state, "%s/run.json", self->folder);
  snprintf(self->seed_text, sizeof self->seed_text, "%llu", (unsigned long long)number);
  snprintf(self->threads_text, sizeof self->threads_text, "%d", ablation->session->threads);
  snprintf(self->most_views, sizeof self->most_views, "%d", ablation->moment_views);
  return PAGS_OK;
}

/* run.json. */

static pags_result read_moment(const pags_json *json, const pags_json_value *value, pags_ablation_moment *m) {
  const double nan = (double)NAN;
  PAGS_TRY(pags_json_as_object(json, value, "moment"));
  PAGS_TRY(pags_json_integer(json, value, "step", 1, INT64_MAX, &m->step));
  PAGS_TRY(pags_json_integer(json, value, "gaussians", 0, INT64_MAX, &m->gaussians));
  PAGS_TRY(pags_json_number(json, value, "seconds", &m->seconds));
  PAGS_TRY(pags_json_number(json, value, "cpu_seconds", &m->cpu_seconds));
  PAGS_TRY(pags_json_number(json, value, "peak_rss_bytes", &m->peak_bytes));
  PAGS_TRY(pags_json_number_or(json, value, "psnr", nan, &m->psnr));
  PAGS_TRY(pags_json_number_or(json, value, "psnr_critical", nan, &m->critical));
  return pags_json_number_or(json, value, "psnr_noncritical", nan, &m->noncritical);
}

static pags_result read_state(const pags_json *json, run *self) {
  const pags_json_value *root = pags_json_root(json), *moments;
  PAGS_TRY(pags_json_integer(json, root, "step", 0, INT64_MAX, &self->step));
  PAGS_TRY(pags_json_number(json, root, "seconds", &self->seconds));
  PAGS_TRY(pags_json_number(json, root, "cpu_seconds", &self->cpu_seconds));
  PAGS_TRY(pags_json_number(json, root, "peak_rss_bytes", &self->peak_bytes));
  PAGS_TRY(pags_json_array(json, root, "moments", &moments));
  self->count = 0;
  for (const pags_json_value *m = moments->first; m; m = m->next) {
    if (self->count == PAGS_ABLATION_MOMENTS)
      return pags_json_fail(json, m, "expected at most %d moments", PAGS_ABLATION_MOMENTS);
    PAGS_TRY(read_moment(json, m, &self->moments[self->count++]));
  }
  return PAGS_OK;
}

static pags_result load_state(run *self) {
  pags_json *json;
  if (!pags_file_exists(self->state))
    return PAGS_OK;
  PAGS_TRY(pags_json_parse_file(self->state, &json));
  pags_result result = read_state(json, self);
  pags_json_destroy(json);
  return result;
}

static pags_result save_state(const run *self) {
  pags_json_writer w;
  pags_json_writer_init(&w, 1);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "step", self->step);
  pags_json_put_number(&w, "seconds", self->seconds);
  pags_json_put_number(&w, "cpu_seconds", self->cpu_seconds);
  pags_json_put_number(&w, "peak_rss_bytes", self->peak_bytes);
  pags_json_begin_array(&w, "moments");
  for (int i = 0; i < self->count; ++i) {
    const pags_ablation_moment *m = &self->moments[i];
    pags_json_begin_object(&w, NULL);
    pags_json_put_integer(&w, "step", m->step);
    pags_json_put_integer(&w, "gaussians", m->gaussians);
    pags_json_put_number(&w, "seconds", m->seconds);
    pags_json_put_number(&w, "cpu_seconds", m->cpu_seconds);
    pags_json_put_number(&w, "peak_rss_bytes", m->peak_bytes);
    pags_json_put_number(&w, "psnr", m->psnr);
    pags_json_put_number(&w, "psnr_critical", m->critical);
    pags_json_put_number(&w, "psnr_noncritical", m->noncritical);
    pags_json_end_object(&w);
  }
  pags_json_end_array(&w);
  pags_json_end_object(&w);
  pags_result result = pags_json_writer_save(&w, self->state);
  pags_json_writer_destroy(&w);
  return result;
}

/* Checkpoints. */

static void name_known(const run *self, int64_t step, char out[MOST_PATH + 64]) {
  snprintf(out, MOST_PATH + 64, "%s/known_%lld.pags", self->folder, (long long)step);
}

static pags_result link_file(const char *from, const char *to) {
  if ((unlink(to) != 0 && errno != ENOENT) || link(from, to) != 0)
    return pags_fail(PAGS_ERROR_IO, "%s: can't be linked as %s: %s", from, to, strerror(errno));
  return PAGS_OK;
}

static bool may_branch(const run *self) {
  return self->ablation->equal && self->row->prunes;
}

/* Makes the scene's checkpoint, at `step`, the known one. The trainer writes checkpoints beside and renames, so the
 * link keeps its bytes. */
static pags_result keep_checkpoint(run *self, int64_t step) {
  char checkpoint[MOST_PATH + 64], known[MOST_PATH + 64], before[MOST_PATH + 64];
  int64_t last = self->step;
  snprintf(checkpoint, sizeof checkpoint, "%s/checkpoint.pags", self->scene);
  name_known(self, step, known);
  name_known(self, last, before);
  PAGS_TRY(link_file(checkpoint, known));
  self->step = step;
  PAGS_TRY(save_state(self));
  return last > 0 && last != step && !may_branch(self) ? pags_remove_tree(before) : PAGS_OK;
}

/* Puts the known checkpoint where the trainer looks for it: what was trained beyond it without a report is forgotten.
 */
static pags_result restore_checkpoint(const run *self) {
  char checkpoint[MOST_PATH + 64], known[MOST_PATH + 64];
  if (self->step == 0)
    return pags_remove_tree(self->scene);
  PAGS_TRY(pags_make_dirs(self->scene));
  snprintf(checkpoint, sizeof checkpoint, "%s/checkpoint.pags", self->scene);
  name_known(self, self->step, known);
  return link_file(known, checkpoint);
}

/* The step of the last prune by score, as the log tells; 0: none. */
static pags_result last_prune(const run *self, int64_t *step) {
  static const char begin[] = "{\"step\": ";
  char path[MOST_PATH + 64];
  uint8_t *bytes;
  size_t size;
  *step = 0;
  snprintf(path, sizeof path, "%s/log.jsonl", self->scene);
  if (!pags_file_exists(path))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  for (char *line = (char *)bytes; *line;) {
    size_t length = strcspn(line, "\n");
    char *next = line + length + (line[length] != 0);
    line[length] = 0;
    if (strstr(line, "\"pruned_by_score\"") && !strncmp(line, begin, sizeof begin - 1))
      *step = strtoll(line + sizeof begin - 1, NULL, 10);
    line = next;
  }
  free(bytes);
  return PAGS_OK;
}

/* The last moment before the last prune whose checkpoint is kept, which a run with another bound can go on from; -1:
 * none. */
static pags_result find_branch(const run *self, int *moment) {
  int64_t prune;
  char known[MOST_PATH + 64];
  *moment = -1;
  PAGS_TRY(last_prune(self, &prune));
  for (int i = 0; i < self->count && self->moments[i].step < prune; ++i) {
    name_known(self, self->moments[i].step, known);
    if (pags_file_exists(known))
      *moment = i;
  }
  return PAGS_OK;
}

static pags_result remove_known(const run *self, int64_t but) {
  pags_dir_list list;
  char kept[64];
  snprintf(kept, sizeof kept, "known_%lld.pags", (long long)but);
  PAGS_TRY(pags_dir_list_read(self->folder, &list));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < list.count && result == PAGS_OK; ++i) {
    if (strncmp(list.names[i], "known_", 6) || !strcmp(list.names[i], kept))
      continue;
    char *path = pags_path_join(self->folder, list.names[i]);
    result = path ? pags_remove_tree(path) : pags_fail(PAGS_ERROR_MEMORY, "out of memory");
    free(path);
  }
  pags_dir_list_destroy(&list);
  return result;
}

static pags_result drop_checkpoints(const run *self) {
  char checkpoint[MOST_PATH + 64];
  int branch;
  snprintf(checkpoint, sizeof checkpoint, "%s/checkpoint.pags", self->scene);
  PAGS_TRY(pags_remove_tree(checkpoint));
  PAGS_TRY(find_branch(self, &branch));
  return remove_known(self, branch < 0 ? -1 : self->moments[branch].step);
}

/* Children. */

static void show_line(void *user, const char *line) {
  run *self = user;
  pags_ablation *a = self->ablation;
  char left[32];
  long long at, all;
  if (sscanf(line, "step %lld of %lld", &at, &all) == 2)
    a->steps_told = at - self->step;
  else if (sscanf(line, "view %lld of %lld", &at, &all) != 2)
    return;
  double done = (double)(a->steps_done + a->steps_told - a->steps_begun);
  double rate = done > 0 ? done / (pags_seconds() - a->begun) : 0;
  double rest = (double)(a->steps_wanted - a->steps_done - a->steps_told);
  pags_progress_show(&a->progress, "row %d of %d (%s, seed %s): %s; %s for all", a->row_number, a->row_count,
                     a->row_name, self->seed_text, line,
                     rate > 0 ? pags_format_duration(rest / rate, left, sizeof left) : "not yet known");
}

/* Runs a verb; what it says goes to the progress. An error names the row. */
static pags_result call(run *self, const pags_child_words *words, pags_child_result *child) {
  PAGS_TRY(pags_child_run(words, self->ablation->session->people ? show_line : NULL, self, child));
  if (child->exit_code == PAGS_EXIT_OK)
    return PAGS_OK;
  if (pags_interrupted())
    return pags_fail(PAGS_CANCELLED, "interrupted; the same command goes on from here");
  return pags_fail(PAGS_ERROR_FORMAT, "row '%s', seed %s: pags %s: %s (exit code %d)", self->row->name, self->seed_text,
                   words->items[0], child->message[0] ? child->message : "no message", child->exit_code);
}

static void add_pair(pags_child_words *words, const char *name, const char *value) {
  pags_child_add(words, name);
  pags_child_add(words, value);
}

/* Training. */

static int64_t moment_step(const pags_ablation *ablation, int moment) {
  return ablation->iterations * (moment + 1) / ablation->moments;
}

/* What pags train has reported: at the end of a stretch, or interrupted within it. */
static pags_result take_report(run *self, const char *path, double cpu_seconds) {
  pags_json *json;
  int64_t step = 0, gaussians = 0;
  double seconds = 0, peak = 0;
  PAGS_TRY(pags_json_parse_file(path, &json));
  const pags_json_value *root = pags_json_root(json);
  pags_result result = pags_json_integer(json, root, "iterations", 0, INT64_MAX, &step);
  if (result == PAGS_OK)
    result = pags_json_integer(json, root, "gaussians", 0, INT64_MAX, &gaussians);
  if (result == PAGS_OK)
    result = pags_json_number(json, root, "seconds", &seconds);
  if (result == PAGS_OK)
    result = pags_json_number(json, root, "peak_rss_bytes", &peak);
  pags_json_destroy(json);
  PAGS_TRY(result);
  self->ablation->steps_done += step - self->step;
  self->ablation->steps_told = 0;
  self->seconds += seconds;
  self->cpu_seconds += cpu_seconds;
  self->peak_bytes = fmax(self->peak_bytes, peak);
  if (step == moment_step(self->ablation, self->count))
    self->moments[self->count++] = (pags_ablation_moment){.step = step,
                                                          .gaussians = gaussians,
                                                          .seconds = self->seconds,
                                                          .cpu_seconds = self->cpu_seconds,
                                                          .peak_bytes = self->peak_bytes,
                                                          .psnr = (double)NAN,
                                                          .critical = (double)NAN,
                                                          .noncritical = (double)NAN};
  return step > 0 ? keep_checkpoint(self, step) : PAGS_OK;
}

static pags_result train_stretch(run *self) {
  const pags_ablation *a = self->ablation;
  char target[24], length[24], report[MOST_PATH + 32];
  pags_child_words words = {0};
  pags_child_result child;
  snprintf(target, sizeof target, "%lld", (long long)moment_step(a, self->count));
  snprintf(length, sizeof length, "%lld", (long long)a->iterations);
  snprintf(report, sizeof report, "%s/train.json", self->folder);
  PAGS_TRY(restore_checkpoint(self));
  PAGS_TRY(pags_remove_tree(report));
  pags_child_add(&words, "train");
  pags_child_add(&words, a->dataset);
  add_pair(&words, "--output", self->scene);
  add_pair(&words, "--iterations", target);
  add_pair(&words, "--schedule-iterations", length);
  add_pair(&words, "--checkpoint-every", "0");
  add_pair(&words, "--preview-every", "0");
  add_pair(&words, "--json", report);
  add_pair(&words, "--seed", self->seed_text);
  add_pair(&words, "--threads", self->threads_text);
  pags_child_add(&words, "--resume");
  pags_child_add_all(&words, &a->train);
  pags_child_add_all(&words, &self->row->train);
  pags_result result = call(self, &words, &child);
  if (pags_file_exists(report)) {
    pags_result taken = take_report(self, report, child.cpu_seconds);
    result = result == PAGS_OK ? taken : result;
  }
  return result;
}

/* Evaluation. */

static void begin_eval(const run *self, const char *verb, const char *json, pags_child_words *words) {
  pags_child_add(words, verb);
  pags_child_add(words, self->scene);
  add_pair(words, "--split", "test");
  add_pair(words, "--json", json);
  add_pair(words, "--threads", self->threads_text);
}

static pags_result read_quality(const char *path, const char *const *keys, double *const *values, int count) {
  pags_json *json;
  const pags_json_value *test;
  PAGS_TRY(pags_json_parse_file(path, &json));
  pags_result result = pags_json_object(json, pags_json_root(json), "test", &test);
  for (int i = 0; i < count && result == PAGS_OK; ++i)
    result = pags_json_number_or(json, test, keys[i], (double)NAN, values[i]);
  pags_json_destroy(json);
  return result;
}

/* Of some held-out views: enough to see how quality grows. */
static pags_result measure_moment(run *self) {
  static const char *const keys[] = {"psnr", "psnr_critical", "psnr_noncritical"};
  char path[MOST_PATH + 32];
  pags_child_words words = {0};
  pags_child_result child;
  pags_ablation_moment *m = &self->moments[self->count - 1];
  snprintf(path, sizeof path, "%s/moment.json", self->folder);
  begin_eval(self, "eval", path, &words);
  add_pair(&words, "--views", self->most_views);
  pags_child_add_all(&words, &self->ablation->eval);
  PAGS_TRY(call(self, &words, &child));
  PAGS_TRY(read_quality(path, keys, (double *const[]){&m->psnr, &m->critical, &m->noncritical}, 3));
  if (isnan(m->psnr))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected held-out views to compare with", self->ablation->dataset);
  PAGS_TRY(pags_remove_tree(path));
  return save_state(self);
}

/* "eval.json", or with what the row adds to the evaluation: "eval_early-z-paper.json". */
static void name_measured(const run *self, const char *what, char out[MOST_PATH + 256]) {
  int at = snprintf(out, MOST_PATH + 256, "%s/%s", self->folder, what);
  for (int i = 0; i < self->row->eval.count; ++i) {
    const char *word = self->row->eval.items[i];
    bool option = !strncmp(word, "--", 2);
    at += snprintf(out + at, MOST_PATH + 256 - (size_t)at, "%s%s", option ? "_" : "-", word + (option ? 2 : 0));
  }
  snprintf(out + at, MOST_PATH + 256 - (size_t)at, ".json");
}

static pags_result evaluate(run *self, const char *path) {
  pags_child_words words = {0};
  pags_child_result child;
  begin_eval(self, "eval", path, &words);
  if (self->ablation->lpips_weights)
    add_pair(&words, "--lpips-weights", self->ablation->lpips_weights);
  pags_child_add_all(&words, &self->ablation->eval);
  pags_child_add_all(&words, &self->row->eval);
  return call(self, &words, &child);
}

/* Draws the held-out views for the time it takes; the pictures go again. */
static pags_result time_rendering(run *self, const char *path) {
  char pictures[MOST_PATH + 32];
  pags_child_words words = {0};
  pags_child_result child;
  snprintf(pictures, sizeof pictures, "%s/pictures", self->folder);
  begin_eval(self, "render", path, &words);
  add_pair(&words, "--output", pictures);
  pags_child_add_all(&words, &self->row->eval);
  pags_result result = call(self, &words, &child), removed = pags_remove_tree(pictures);
  return result == PAGS_OK ? removed : result;
}

/* Results. */

static pags_result add_size(const char *folder, const char *name, double *bytes) {
  uint64_t size = 0;
  char *path = pags_path_join(folder, name);
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  pags_result result = pags_file_size(path, &size);
  free(path);
  *bytes += (double)size;
  return result;
}

/* Whether a file of the scene's folder is needed to draw it: log, reports, previews and checkpoint aren't. */
static bool is_drawn(const char *name) {
  const char *extension = pags_path_extension(name);
  return !strcmp(name, "scene.json") || !strcmp(extension, ".ply") || !strcmp(extension, ".npy");
}

static pags_result add_folder(const char *folder, double *bytes) {
  pags_dir_list list;
  PAGS_TRY(pags_dir_list_read(folder, &list));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < list.count && result == PAGS_OK; ++i)
    if (is_drawn(list.names[i]))
      result = add_size(folder, list.names[i], bytes);
  pags_dir_list_destroy(&list);
  return result;
}

static pags_result scene_bytes(const char *scene, double *bytes) {
  char path[MOST_PATH + 64];
  *bytes = 0;
  PAGS_TRY(add_folder(scene, bytes));
  snprintf(path, sizeof path, "%s/objects", scene);
  return pags_dir_exists(path) ? add_folder(path, bytes) : PAGS_OK;
}

static pags_result read_render_ms(const char *path, double *ms) {
  pags_json *json;
  const pags_json_value *mean, *times = NULL;
  PAGS_TRY(pags_json_parse_file(path, &json));
  pags_result result = pags_json_object(json, pags_json_root(json), "mean", &mean);
  if (result == PAGS_OK)
    result = pags_json_object(json, mean, "ms", &times);
  if (result == PAGS_OK)
    result = pags_json_number(json, times, "total", ms);
  pags_json_destroy(json);
  return result;
}

static pags_result fill_result(const run *self, const char *eval, const char *render, pags_ablation_result *out) {
  static const char *const keys[] = {"psnr",          "psnr_unexposed",   "ssim",       "lpips",
                                     "psnr_critical", "psnr_noncritical", "psnr_moving"};
  double *f = out->figures;
  const pags_ablation_moment *last = &self->moments[self->count - 1];
  *out = (pags_ablation_result){.seed = self->seed, .moment_count = self->count};
  memcpy(out->moments, self->moments, sizeof out->moments);
  PAGS_TRY(read_quality(eval, keys, (double *const[]){&f[0], &f[1], &f[2], &f[3], &f[4], &f[5], &f[6]}, 7));
  PAGS_TRY(scene_bytes(self->scene, &f[PAGS_ABLATION_BYTES]));
  PAGS_TRY(read_render_ms(render, &f[PAGS_ABLATION_RENDER_MS]));
  f[PAGS_ABLATION_GAUSSIANS] = (double)last->gaussians;
  f[PAGS_ABLATION_SECONDS] = last->seconds;
  f[PAGS_ABLATION_CPU_SECONDS] = last->cpu_seconds;
  f[PAGS_ABLATION_PEAK_BYTES] = last->peak_bytes;
  out->finished = true;
  return PAGS_OK;
}

/* LPIPS may be asked for after a row was finished without it. */
static bool lacks_lpips(const run *self, const pags_ablation_result *out) {
  return self->ablation->lpips_weights && isnan(out->figures[PAGS_ABLATION_LPIPS]);
}

static pags_result finish(run *self, pags_ablation_result *out) {
  char eval[MOST_PATH + 256], render[MOST_PATH + 256];
  name_measured(self, "eval", eval);
  name_measured(self, "render", render);
  if (!pags_file_exists(eval))
    PAGS_TRY(evaluate(self, eval));
  if (!pags_file_exists(render))
    PAGS_TRY(time_rendering(self, render));
  PAGS_TRY(fill_result(self, eval, render, out));
  if (lacks_lpips(self, out)) {
    PAGS_TRY(evaluate(self, eval));
    PAGS_TRY(fill_result(self, eval, render, out));
  }
  return drop_checkpoints(self);
}

static pags_result go_on(run *self, pags_ablation_result *out) {
  PAGS_TRY(load_state(self));
  for (;;) {
    if (self->count > 0 && isnan(self->moments[self->count - 1].psnr))
      PAGS_TRY(measure_moment(self));
    else if (self->count < self->ablation->moments)
      PAGS_TRY(train_stretch(self));
    else
      return finish(self, out);
  }
}

static pags_result open_run(pags_ablation *ablation, const pags_ablation_row *row, int seed, run **out) {
  *out = malloc(sizeof **out);
  if (!*out)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  PAGS_TRY(name_run(ablation, row, seed, *out));
  return pags_make_dirs((*out)->folder);
}

pags_result pags_ablation_run(pags_ablation *ablation, const pags_ablation_row *row, int seed,
                              pags_ablation_result *out) {
  run *self = NULL;
  pags_result result = open_run(ablation, row, seed, &self);
  if (result == PAGS_OK)
    result = go_on(self, out);
  free(self);
  return result;
}

/* Begins a run as `from` was at its branch. */
static pags_result branch_off(const run *from, run *self) {
  char there[MOST_PATH + 64], here[MOST_PATH + 64];
  int branch;
  PAGS_TRY(find_branch(from, &branch));
  if (branch < 0)
    return PAGS_OK;
  const pags_ablation_moment *m = &from->moments[branch];
  self->count = branch + 1;
  memcpy(self->moments, from->moments, (size_t)self->count * sizeof *self->moments);
  self->step = m->step;
  self->seconds = m->seconds;
  self->cpu_seconds = m->cpu_seconds;
  self->peak_bytes = m->peak_bytes;
  name_known(from, m->step, there);
  name_known(self, m->step, here);
  PAGS_TRY(link_file(there, here));
  return save_state(self);
}

pags_result pags_ablation_run_equal(pags_ablation *ablation, const pags_ablation_row *row, int seed, int64_t count,
                                    pags_ablation_result *out) {
  char bound[24];
  pags_ablation_row bounded;
  run *from = NULL, *self = NULL;
  snprintf(bound, sizeof bound, "%lld", (long long)count);
  pags_ablation_row_bounded(row, bound, &bounded);
  pags_result result = open_run(ablation, row, seed, &from);
  if (result == PAGS_OK)
    result = load_state(from);
  if (result == PAGS_OK)
    result = open_run(ablation, &bounded, seed, &self);
  if (result == PAGS_OK && !pags_file_exists(self->state))
    result = branch_off(from, self);
  if (result == PAGS_OK)
    result = go_on(self, out);
  free(from);
  free(self);
  return result;
}

int64_t pags_ablation_run_steps(pags_ablation *ablation, const pags_ablation_row *row, int seed) {
  int64_t steps = 0;
  run *self = malloc(sizeof *self);
  if (self && name_run(ablation, row, seed, self) == PAGS_OK && load_state(self) == PAGS_OK)
    steps = self->step;
  free(self);
  return steps;
}
