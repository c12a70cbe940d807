/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench scaling: predicts how fast this machine's work would be done by 1 to 256 workers, from a record of one,
 * and measures it for the cores there are.
 *
 * For a scene, frames are recorded; for a data set, a training: all cores train up to the first densify step with a
 * prune, one worker records that one, all cores go on, and one worker records the last steps. A lap over all
 * photographs precedes them, so that none has to be decoded in between. */
#include "benchmarks/bench.h"
#include "benchmarks/frame/modes.h"
#include "benchmarks/threads/scaling_report.h"
#include "benchmarks/verbs.h"
#include "cli/common/progress.h"
#include "cli/common/session.h"
#include "cli/draw/camera_paths.h"

#include <pags/compose.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "port/port.h"
#include "simd/kernels.h"
#include "train/config.h"
#include "train/schedule.h"

enum { MOST_MEASURED = 32, MOST_CAMERAS = 4 };
/* Number of workers for splitting the loops of the record, if that depends on it. */
enum { RECORDED_WORKERS = 32 };

typedef struct scaling_arguments {
  pags_session session;
  const char *input, *output, *measure;
  int64_t iterations, steps;
  int views, repetitions;
  double downscale, bandwidth;
} scaling_arguments;

#define AT(member) offsetof(scaling_arguments, member)

static const pags_option options[] = {
    PAGS_TEXT("measure", 0, AT(measure), "FILE", NULL,
              "measure the curve for all cores there are, too, and write it beside the predicted one, as JSON"),
    PAGS_VALUE("bandwidth", 0, DOUBLE, AT(bandwidth), 0, PAGS_UNLIMITED, "GB/S", "GB/s", "as much a core as here",
               "what the memory of the predicted machine gives all of its cores together"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(downscale), 0.25, 64, "F", "times", NULL,
               "shrink the pictures; below 1, of a scene alone, enlarge them"),
    PAGS_GROUP("Of a scene"),
    PAGS_VALUE("views", 'n', INT, AT(views), 1, 1000, "N", "pictures", NULL, "spread evenly over the views"),
    PAGS_VALUE("repetitions", 'r', INT, AT(repetitions), 1, 1000, "N", "frames", NULL, "timed frames of each picture"),
    PAGS_GROUP("Of a data set"),
    PAGS_TEXT("output", 'o', AT(output), "SCENE", NULL, "folder to train into; written afresh"),
    PAGS_VALUE("iterations", 0, INT64, AT(iterations), 10, 1000000, "N", "steps", NULL, "length of the training"),
    PAGS_VALUE("steps", 0, INT64, AT(steps), 2, 100000, "N", "steps", NULL, "how many of its last steps are recorded"),
    PAGS_SESSION_OPTIONS(scaling_arguments),
    {0}};

static const pags_verb verb = {
    .name = "scaling",
    .usage = "SCENE|DATASET [options]",
    .about =
        "Records frames, or the steps, densify, prune, checkpoint and scene of a training, on one worker, and replays "
        "them by the pool's own scheduling for 1 to 256 workers: predicted times as fast as a range, critical path, "
        "and what limits, stage by stage. docs/cluster.md says what is predicted and what isn't.",
    .positionals = {{"SCENE|DATASET", "a scene folder or a splat file; or a data set, as for pags train"}},
    .options = options};

typedef struct measured {
  int workers;
  pags_record record;
} measured;

typedef struct scaling_bench {
  const scaling_arguments *arguments;
  pags_dataset *dataset; /* NULL: of a scene */
  pags_composition *composition;
  pags_camera_path path;
  pags_record record;
  pags_scaling scaling;
  measured measured[MOST_MEASURED];
  int measured_count;
  pags_progress progress;
} scaling_bench;

static pags_result cancelled(void) {
  return pags_fail(PAGS_CANCELLED, "cancelled");
}

/* The next number of workers to measure after `workers`: twice as many, and all cores last. */
static int next_workers(int workers, int all) {
  return workers < all && 2 * workers > all ? all : 2 * workers;
}

/* ---- Frames ---- */

static pags_result open_scene(scaling_bench *self, const char *path) {
  pags_scene scene;
  PAGS_TRY(pags_scene_load(path, &scene));
  pags_result result = pags_camera_path_views(&scene, &self->path);
  if (result == PAGS_OK && self->path.count == 0) {
    pags_camera_path_destroy(&self->path);
    result = pags_camera_path_orbit(&scene, self->arguments->views, PAGS_STAND_AUTO, &self->path);
  }
  if (result != PAGS_OK) {
    pags_scene_destroy(&scene);
    return result;
  }
  pags_bench_thin(&self->path, self->arguments->views);
  for (int64_t i = 0; !self->dataset && i < self->path.count; i++)
    self->path.cameras[i] = pags_camera_downscale(&self->path.cameras[i], self->arguments->downscale);
  return pags_composition_create(&scene, &self->composition);
}

/* Draws each view once unrecorded, then `repetitions` times recorded. */
static pags_result draw_frames(scaling_bench *self, pags_tasks *tasks, pags_record *record) {
  pags_frame *frame;
  pags_frame_options o = pags_composition_options(self->composition);
  o.early_z = PAGS_EARLY_Z_OFF; /* so that each stage does all of its work */
  PAGS_TRY(pags_frame_create(tasks, &frame));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < self->path.count && result == PAGS_OK; i++) {
    for (int r = 0; r <= self->arguments->repetitions && result == PAGS_OK; r++) {
      const pags_camera *const camera = self->path.cameras + i;
      const pags_part *parts;
      pags_picture picture;
      int count;
      pags_tasks_record(tasks, r > 0 ? record : NULL);
      pags_tasks_mark(tasks, "frame", "compose");
      pags_compose(self->composition, camera->time, &parts, &count);
      result = pags_frame_render(frame, parts, count, camera, &o, NULL, NULL, &picture);
      pags_tasks_record(tasks, NULL);
    }
    if (!pags_progress_watch(&self->progress, (double)(i + 1) / (double)self->path.count, "frames"))
      result = cancelled();
  }
  pags_frame_destroy(frame);
  return result;
}

/* ---- Trainings ---- */

/* A piece of the training by one pool: up to step `until`, recorded after step `from` (-1: not at all). */
typedef struct piece {
  scaling_bench *self;
  pags_tasks *tasks;
  pags_record *record;
  int64_t from, until;
  const char *what;
} piece;

static int on_step(void *user, const pags_train_progress *progress) {
  const piece *const p = user;
  if (p->record && progress->step == p->from) {
    p->record->phase = "host";
    pags_tasks_record(p->tasks, p->record);
  }
  return pags_progress_watch(&p->self->progress, (double)progress->step / (double)p->until, p->what) &&
         progress->step < p->until;
}

static pags_result train(piece *p, bool resume) {
  const scaling_arguments *const a = p->self->arguments;
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = a->iterations;
  pags_train_options o = pags_train_options_default();
  pags_train_result trained;
  o.dataset = p->self->dataset;
  o.output = a->output;
  o.tasks = p->tasks;
  o.resume = resume;
  o.overwrite = !resume;
  o.checkpoint_every = o.preview_every = 0;
  o.progress = on_step;
  o.progress_user = p;
  o.cancel = pags_interrupt_flag();
  const pags_result result = pags_train(&config, &o, &trained);
  pags_tasks_record(p->tasks, NULL);
  PAGS_TRY(result);
  return pags_interrupted() ? cancelled() : PAGS_OK;
}

/* Steps of the training: `prune` is the last with both a densify and a prune, if there is one; recording begins after
 * `first`, ends at `prune`, and begins again after `last`, a lap after `lap`. */
typedef struct plan {
  int64_t first, prune, lap, last;
} plan;

static plan make_plan(const scaling_bench *self) {
  const scaling_arguments *const a = self->arguments;
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = a->iterations;
  const bool driving = pags_dataset_fps(self->dataset) > 0;
  int64_t views = 0, count = pags_dataset_view_count(self->dataset);
  for (int64_t i = 0; i < count; i++)
    views += !pags_dataset_view(self->dataset, i)->test;
  config = pags_config_resolve(&config, driving);
  const pags_schedule schedule = pags_schedule_make(&config, 1.0, views);
  plan p = {.prune = a->iterations / 2};
  for (int64_t step = 1; step < a->iterations; step++)
    if (pags_schedule_is_densify(&schedule, step) && (pags_schedule_prune(&schedule, step) >= 0 || !schedule.prunes))
      p.prune = step;
  p.first = p.prune > 4 ? p.prune - 4 : 1;
  p.last = a->iterations - a->steps > p.prune ? a->iterations - a->steps : p.prune;
  p.lap = p.last - views > p.prune ? p.last - views : p.prune;
  return p;
}

/* Events of `phase` from number `first` on are left out of the replay. */
static void leave_out(pags_record *record, int64_t first, const char *phase) {
  for (int64_t i = first; i < record->count; i++)
    if (record->events[i].kind != PAGS_EVENT_JOB && record->events[i].phase && !strcmp(record->events[i].phase, phase))
      record->events[i].phase = "host";
}

/* Trains as the plan says; at its lap, *checkpoint receives the bytes of the checkpoint. */
static pags_result record_training(scaling_bench *self, pags_tasks *one, const plan *p, uint8_t **checkpoint,
                                   size_t *size) {
  pags_tasks *const all = self->arguments->session.tasks;
  char *const path = pags_path_join(self->arguments->output, "checkpoint.pags");
  if (!path)
    return pags_out_of_memory("a path");
  pags_result result = train(&(piece){self, all, NULL, -1, p->first, "training with all cores"}, false);
  if (result == PAGS_OK) {
    self->record.phase = "host";
    pags_tasks_record(one, &self->record);
    result = train(&(piece){self, one, NULL, -1, p->prune, "densify and prune on one worker"}, true);
    leave_out(&self->record, 0, "step"); /* their photographs had to be decoded */
  }
  if (result == PAGS_OK && p->lap > p->prune)
    result = train(&(piece){self, all, NULL, -1, p->lap, "training with all cores"}, true);
  if (result == PAGS_OK)
    result = pags_file_read(path, checkpoint, size);
  if (result == PAGS_OK)
    result =
        train(&(piece){self, one, &self->record, p->last, self->arguments->iterations, "steps on one worker"}, true);
  free(path);
  return result;
}

/* Repeats what follows the plan's lap with other numbers of workers. */
static pags_result measure_trainings(scaling_bench *self, const plan *p, const uint8_t *checkpoint, size_t size) {
  const int all = pags_available_threads();
  char *const path = pags_path_join(self->arguments->output, "checkpoint.pags");
  pags_result result = path ? PAGS_OK : pags_out_of_memory("a path");
  for (int w = 1; w <= all && result == PAGS_OK && self->measured_count < MOST_MEASURED; w = next_workers(w, all)) {
    measured *const m = &self->measured[self->measured_count++];
    pags_tasks *const tasks = pags_tasks_create(w);
    m->workers = w;
    result = tasks ? pags_file_write(path, checkpoint, size) : pags_out_of_memory("%d threads", w);
    if (result == PAGS_OK)
      result = train(&(piece){self, tasks, &m->record, p->last, self->arguments->iterations, "measured steps"}, true);
    pags_tasks_destroy(tasks);
  }
  free(path);
  return result;
}

/* ---- Bytes ---- */

/* Gives the stages of frames and steps the bytes that they move at most. A step's are those of a frame of the trained
 * scene with its backward pass, and those of the optimiser: a cluster's parameters and both moments, read and
 * written. */
static pags_result add_bytes(scaling_bench *self, pags_tasks *tasks) {
  pags_bench_view view = {.tasks = tasks,
                          .cameras = self->path.cameras,
                          .camera_count = self->path.count < MOST_CAMERAS ? (int)self->path.count : MOST_CAMERAS,
                          .options = pags_composition_options(self->composition),
                          .repetitions = 1};
  view.options.early_z = PAGS_EARLY_Z_OFF;
  pags_compose(self->composition, view.cameras[0].time, &view.parts, &view.part_count);
  bool backward = self->dataset != NULL;
  int degree = 0;
  for (int i = 0; i < view.part_count; i++) {
    backward &= !view.parts[i].packed;
    degree = view.parts[i].gaussians->sh_degree > degree ? view.parts[i].gaussians->sh_degree : degree;
  }
  pags_bench_frame frame;
  pags_bench_stage_bytes bytes[PAGS_BENCH_BYTE_STAGES];
  PAGS_TRY(pags_bench_measure(&view, backward, &frame));
  const int count = pags_bench_bytes_of(&frame, degree, bytes);
  for (int i = 0; i < self->scaling.stage_count; i++) {
    pags_replay_stage *const s = self->scaling.stages + i;
    const bool step = !strcmp(s->phase, "step");
    const double times = (double)pags_scaling_times(&self->record, s->phase);
    for (int k = 0; k < count && (step || !strcmp(s->phase, "frame")); k++)
      if (!strcmp(bytes[k].stage, s->stage))
        s->bytes = times * bytes[k].bytes;
    if (step && !strcmp(s->stage, "project backward"))
      s->bytes += times * (double)frame.stats.loaded * pags_plane_count(degree) * 6 * sizeof(float);
  }
  return PAGS_OK;
}

/* ---- Output ---- */

static void put_machine(pags_json_writer *json) {
  const char *why = "";
  const pags_kernels *const kernels = pags_kernels_get(&why);
  pags_json_put_string(json, "version", PAGS_VERSION_STRING);
  pags_json_put_integer(json, "cores", pags_available_threads());
  pags_json_put_unsigned(json, "memory_bytes", pags_port_physical_memory());
  pags_json_put_string(json, "kernels", kernels ? kernels->name : NULL);
}

/* Prints measurements next to predictions. */
static pags_result put_measured(const scaling_bench *self, FILE *people, pags_json_writer *json) {
  static const char *const phases[] = {"step", "frame"};
  pags_json_begin_array(json, "measured");
  for (size_t i = 0; i < sizeof phases / sizeof *phases; i++) {
    double alone = 0;
    for (int k = 0; k < self->measured_count; k++) {
      const measured *const m = self->measured + k;
      const double ns = pags_scaling_measured(&m->record, phases[i]);
      double least = 0, most = 0;
      if (ns <= 0)
        continue;
      PAGS_TRY(pags_scaling_predict(&self->scaling, phases[i], m->workers, &least, &most));
      if (alone <= 0 && people)
        fprintf(people, "\n%-9s %9s %14s %12s  %s\n", phases[i], "workers", "measured ms", "times", "predicted ms");
      alone = alone > 0 ? alone : ns;
      if (people)
        fprintf(people, "%-9s %9d %14.3f %12.2f  %.3f to %.3f\n", "", m->workers, ns * 1e-6, alone / ns, least * 1e-6,
                most * 1e-6);
      pags_json_begin_object(json, NULL);
      pags_json_put_string(json, "phase", phases[i]);
      pags_json_put_integer(json, "workers", m->workers);
      pags_json_put_number(json, "ms", ns * 1e-6);
      pags_json_put_number(json, "times_as_fast", alone / ns);
      pags_json_put_number(json, "predicted_ms_least", least * 1e-6);
      pags_json_put_number(json, "predicted_ms_most", most * 1e-6);
      pags_json_end_object(json);
    }
  }
  pags_json_end_array(json);
  return PAGS_OK;
}

/* Prints the tables and writes their figures into a new document, whose object stays open. */
static pags_result put_document(const scaling_bench *self, FILE *people, pags_json_writer *json) {
  pags_json_writer_init(json, 2);
  pags_json_begin_object(json, NULL);
  put_machine(json);
  pags_json_put_string(json, "input", pags_path_name(self->arguments->input));
  PAGS_TRY(pags_scaling_report(&self->scaling, people, json));
  return self->measured_count > 0 ? put_measured(self, people, json) : PAGS_OK;
}

static pags_result report(const scaling_bench *self) {
  const scaling_arguments *const a = self->arguments;
  pags_json_writer json;
  if (a->measure) {
    pags_result result = put_document(self, NULL, &json);
    pags_json_end_object(&json);
    if (result == PAGS_OK)
      result = pags_json_writer_save(&json, a->measure);
    pags_json_writer_destroy(&json);
    PAGS_TRY(result);
  }
  const pags_result result = put_document(self, a->session.people, &json);
  if (result == PAGS_OK)
    return pags_session_json(&a->session, &json);
  pags_json_writer_destroy(&json);
  return result;
}

/* ---- The benchmark ---- */

static pags_result run_dataset(scaling_bench *self, pags_tasks *one) {
  const scaling_arguments *const a = self->arguments;
  pags_dataset_options o = pags_dataset_options_default();
  uint8_t *checkpoint = NULL;
  size_t size = 0;
  if (!a->output)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a data set is trained: pass -o SCENE, a folder that is written afresh",
                     a->input);
  if (a->downscale < 1)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--downscale %g: photographs can't be enlarged; expected 1 or more",
                     a->downscale);
  o.downscale = a->downscale;
  PAGS_TRY(pags_dataset_open(a->input, &o, &self->dataset));
  const plan p = make_plan(self);
  pags_result result = record_training(self, one, &p, &checkpoint, &size);
  if (result == PAGS_OK && a->measure)
    result = measure_trainings(self, &p, checkpoint, size);
  free(checkpoint);
  return result == PAGS_OK ? open_scene(self, a->output) : result;
}

static pags_result measure_frames(scaling_bench *self) {
  const int all = pags_available_threads();
  for (int w = 1; w <= all && self->measured_count < MOST_MEASURED; w = next_workers(w, all)) {
    measured *const m = &self->measured[self->measured_count++];
    pags_tasks *const tasks = pags_tasks_create(w);
    m->workers = w;
    const pags_result result = tasks ? draw_frames(self, tasks, &m->record) : pags_out_of_memory("%d threads", w);
    pags_tasks_destroy(tasks);
    PAGS_TRY(result);
  }
  return PAGS_OK;
}

static pags_result run(scaling_bench *self, pags_tasks *one) {
  const scaling_arguments *const a = self->arguments;
  if (a->measure)
    PAGS_TRY(pags_check_writable(a->measure));
  const bool scene = pags_file_exists(a->input) || pags_folder_has(a->input, "scene.json");
  self->progress = pags_progress_begin(a->session.people);
  pags_result result = scene ? open_scene(self, a->input) : run_dataset(self, one);
  if (result == PAGS_OK)
    result = draw_frames(self, one, &self->record);
  if (result == PAGS_OK && a->measure)
    result = measure_frames(self);
  pags_progress_end(&self->progress);
  PAGS_TRY(result);
  if (self->record.lost)
    return pags_out_of_memory("the record of %s", a->input);

  self->scaling.record = &self->record;
  PAGS_TRY(pags_pool_costs_measure(&self->scaling.costs));
  if (a->bandwidth > 0)
    self->scaling.costs.high_cost.together = a->bandwidth; /* GB/s are bytes per ns */
  PAGS_TRY(pags_replay_list(&self->record, &self->scaling.stages, &self->scaling.stage_count));
  PAGS_TRY(add_bytes(self, one));
  return report(self);
}

int pags_bench_scaling(int argc, char **argv) {
  scaling_arguments arguments = {.iterations = 3000, .steps = 60, .views = 12, .repetitions = 3, .downscale = 1};
  scaling_bench self = {.arguments = &arguments, .record = {.workers = RECORDED_WORKERS}};
  pags_parsed parsed;
  const pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  arguments.input = parsed.positionals[0];
  pags_result result = pags_session_begin(&arguments.session);
  pags_tasks *one = NULL;
  if (result == PAGS_OK) {
    one = pags_tasks_create(1);
    pags_interrupt_install(NULL); /* polled after each step and picture */
    result = one ? run(&self, one) : pags_out_of_memory("a pool");
  }
  pags_tasks_destroy(one);
  for (int i = 0; i < self.measured_count; i++)
    pags_record_destroy(&self.measured[i].record);
  pags_record_destroy(&self.record);
  free(self.scaling.stages);
  pags_camera_path_destroy(&self.path);
  pags_composition_destroy(self.composition);
  pags_dataset_close(self.dataset);
  return pags_session_end(&arguments.session, result);
}
