/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench curve: frame time against error, for drawing modes and time limits (--budget-ms).
 *
 * Errors are those of the picture against the exact one, which the double-precision renderer of the tests draws, and
 * against the photograph, each also over critical pixels. Timed frames take turns: every mode draws a view before the
 * next view begins, so that a change of the machine's speed affects all of them alike, and draws it once more before,
 * so that no frame pays for what another mode left in the caches. Views are in the order of the rig's cameras and of
 * time, since time limits learn from the frames before. */
#include "benchmarks/bench.h"
#include "benchmarks/frame/modes.h"
#include "benchmarks/verbs.h"
#include "cli/common/photographs.h"
#include "cli/common/session.h"
#include "cli/draw/camera_paths.h"

#include <math.h>
#include <pags/compose.h>
#include <pags/deadline.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "base/psnr.h"
#include "base/sort.h"

/* The double-precision picture of EXACT_PIXELS pixels takes about 3 GB; larger pictures are compared with mode off. */
enum {
  MOST_LIMITS = 8,
  MOST_POINTS = PAGS_BENCH_MOST_MODES + PAGS_DEADLINE_WHOLE_STEPS + MOST_LIMITS,
  EXACT_PIXELS = 1 << 19
};

typedef struct curve_arguments {
  pags_session session;
  const char *dataset, *modes, *limits;
  int64_t views;
  int repetitions;
} curve_arguments;

#define AT(member) offsetof(curve_arguments, member)

static const pags_option verb_options[] = {
    PAGS_TEXT("dataset", 0, AT(dataset), "DATASET", "the scene's training data", "Data set with the photographs."),
    PAGS_VALUE("views", 'n', INT64, AT(views), 1, 1e6, "N", "views", NULL,
               "Number of views, spread over the held-out ones; without them over all views, else over an orbit."),
    PAGS_VALUE("repetitions", 'r', INT, AT(repetitions), 1, 1000, "N", "frames", NULL,
               "Timed frames of each view and mode."),
    PAGS_TEXT("modes", 0, AT(modes), "MODE,...", NULL, PAGS_BENCH_MODE_HELP),
    PAGS_TEXT("limits", 0, AT(limits), "T,...", NULL,
              "Time limits as of pags render --budget-ms: milliseconds, or per cent of the first mode's median, as in "
              "90%. The levels of quality that limits choose from are measured, too. \"none\": neither."),
    PAGS_SESSION_OPTIONS(curve_arguments),
    {0}};

/* Errors of pixels against a picture that is taken as the truth, all values clamped to 0..1. */
typedef struct error_sum {
  double squared, largest;
  int64_t pixels, changed; /* changed: pixels of which a channel, rounded to 8 bits, is another */
} error_sum;

enum { ALL, CRITICAL, REGIONS };

/* A mode, a level of quality that time limits choose from (a step of pags/deadline.h), or a time limit. */
typedef struct curve_point {
  char name[PAGS_BENCH_MODE_NAME];
  pags_frame_options options;
  int level;                           /* 0: none */
  double limit_share;                  /* of the first mode's median time; 0: the limit is in milliseconds */
  pags_deadline_controller controller; /* target 0: no limit */
  double *ms;                          /* of view v and repetition r at r * views + v */
  int *steps;                          /* of view v: the level at which its last timed frame was drawn; 0: by mode */
  int64_t met;                         /* timed frames within the limit */
  error_sum exact[REGIONS];            /* over all views */
  double photo_psnr[REGIONS];          /* sums over the views that have such pixels */
} curve_point;

typedef struct curve_view {
  pags_camera camera;
  int64_t photo; /* index in the photographs; -1: none */
  const pags_scene_view *recorded;
} curve_view;

typedef struct curve {
  const curve_arguments *arguments;
  const char *input;
  pags_composition *composition;
  pags_photographs photographs;
  pags_frame *frame;
  pags_deadline *deadline;
  curve_view *views;
  int64_t view_count, photo_views[REGIONS];
  curve_point points[MOST_POINTS];
  int count;
  bool doubles; /* the exact pictures are drawn in double precision */
  pags_progress progress;
} curve;

static void curve_destroy(curve *self) {
  pags_progress_end(&self->progress);
  for (int k = 0; k < self->count; k++) {
    free(self->points[k].ms);
    free(self->points[k].steps);
  }
  free(self->views);
  pags_deadline_destroy(self->deadline);
  pags_frame_destroy(self->frame);
  pags_photographs_close(&self->photographs);
  pags_composition_destroy(self->composition);
}

/* ---- Views and points ---- */

static pags_result open_photographs(curve *self, const pags_scene *scene) {
  const curve_arguments *a = self->arguments;
  const pags_dataset_options standard = pags_dataset_options_default();
  if (!a->dataset && !scene->dataset)
    return PAGS_OK;
  if (!a->dataset && !pags_path_exists(scene->dataset)) {
    pags_say(&a->session, "%s: missing, so there are no photographs to compare with; --dataset names another folder\n",
             scene->dataset);
    return PAGS_OK;
  }
  return pags_photographs_open_for(scene, a->dataset, &standard, a->session.tasks, (uint64_t)256 << 20,
                                   &self->photographs);
}

/* By sensor, then by time. */
static int compare_views(const void *a, const void *b) {
  const curve_view *const x = a, *const y = b;
  const int first = x->recorded ? x->recorded->sensor : 0, second = y->recorded ? y->recorded->sensor : 0;
  const double earlier = x->camera.time, later = y->camera.time;
  return first != second    ? (first > second) - (first < second)
         : earlier != later ? (earlier > later) - (earlier < later)
                            : (x->photo > y->photo) - (x->photo < y->photo);
}

/* Lists the held-out views, or all views if none are held out, with photographs if there are any; without recorded
 * views, cameras of an orbit. Sorts them by camera and time, and thins them to --views. */
static pags_result find_views(curve *self, const pags_camera_path *orbit) {
  const pags_scene *const scene = pags_composition_scene(self->composition);
  const pags_photographs *const photographs = &self->photographs;
  PAGS_TRY(open_photographs(self, scene));
  const int64_t all = photographs->count ? photographs->count : scene->view_count ? scene->view_count : orbit->count;
  self->views = calloc((size_t)all + 1, sizeof *self->views);
  PAGS_CHECK_MEMORY(self->views, "%lld views", (long long)all);
  for (int held_out = 1; held_out >= 0 && !self->view_count; held_out--)
    for (int64_t i = 0; i < all; i++) {
      curve_view view = {.photo = -1};
      int test = 0;
      if (photographs->count) {
        view = (curve_view){pags_photographs_camera(photographs, i), i, photographs->views[i].scene_view};
        test = photographs->views[i].test;
      } else if (scene->view_count) {
        view = (curve_view){scene->views[i].camera, -1, &scene->views[i]};
        test = scene->views[i].test;
      } else {
        view.camera = orbit->cameras[i];
      }
      if (!held_out || test)
        self->views[self->view_count++] = view;
    }
  if (scene->view_count)
    qsort(self->views, (size_t)self->view_count, sizeof *self->views, compare_views);
  const int64_t most = self->arguments->views, count = self->view_count;
  for (int64_t i = 0; i < most && most < count; i++)
    self->views[i] = self->views[pags_bench_spread(i, most, count)];
  self->view_count = most < count ? most : count;
  return self->view_count ? PAGS_OK : pags_fail(PAGS_ERROR_FORMAT, "%s: there is no view to draw", self->input);
}

/* Lists the levels, and the limits of --limits; those in per cent get their time once the first mode was timed. */
static pags_result list_limits(curve *self, const pags_frame_options *standard) {
  const char *list = self->arguments->limits;
  char word[16];
  if (!strcmp(list, "none"))
    return PAGS_OK;
  for (int level = 1; level < PAGS_DEADLINE_WHOLE_STEPS; level++) {
    curve_point *const point = &self->points[self->count++];
    *point = (curve_point){.options = *standard, .level = level};
    snprintf(point->name, sizeof point->name, "level %d", level);
  }
  for (int n = 0; n < MOST_LIMITS && pags_bench_next_word(&list, word, sizeof word); n++) {
    curve_point *const point = &self->points[self->count++];
    char *end;
    const double value = strtod(word, &end);
    const bool share = !strcmp(end, "%");
    if (!(value > 0 && value <= 1e6) || (*end && !share))
      return pags_fail(PAGS_ERROR_ARGUMENT, "--limits: expected milliseconds or per cent, as in 16.7 or 90%%, got '%s'",
                       word);
    *point = (curve_point){.options = *standard, .limit_share = share ? 0.01 * value : 0};
    point->options.early_z = PAGS_EARLY_Z_LOSSLESS; /* as pags render */
    point->controller = pags_deadline_controller_begin(value);
    snprintf(point->name, sizeof point->name, share ? "limit %s" : "limit %s ms", word);
  }
  return *list ? pags_fail(PAGS_ERROR_ARGUMENT, "--limits: expected at most %d limits separated by commas, got '%s'",
                           MOST_LIMITS, self->arguments->limits)
               : PAGS_OK;
}

static pags_result list_points(curve *self) {
  const pags_scene *const scene = pags_composition_scene(self->composition);
  pags_bench_mode_list modes;
  pags_frame_options standard = pags_composition_options(self->composition);
  standard.early_z = PAGS_EARLY_Z_OFF;
  standard.exp_degree = 5;
  PAGS_TRY(pags_bench_modes_parse(self->arguments->modes, &standard, &modes));

  /* A mode that lowers the SH degree to the scene's own or a higher one draws the same frames as the standard. */
  const pags_part *parts;
  int part_count, degree = 0;
  pags_compose(self->composition, self->views[0].camera.time, &parts, &part_count);
  for (int p = 0; p < part_count; p++)
    degree = parts[p].gaussians->sh_degree > degree ? parts[p].gaussians->sh_degree : degree;
  for (int k = 0; k < modes.count; k++)
    if (k == 0 || modes.modes[k].options.sh_degree == standard.sh_degree || modes.modes[k].options.sh_degree < degree) {
      curve_point *const point = &self->points[self->count++];
      *point = (curve_point){.options = modes.modes[k].options};
      snprintf(point->name, sizeof point->name, "%s", modes.modes[k].name);
    }
  PAGS_TRY(list_limits(self, &standard));
  for (int k = 0; k < self->count; k++) {
    self->points[k].ms = calloc((size_t)self->view_count * (size_t)self->arguments->repetitions, sizeof(double));
    self->points[k].steps = calloc((size_t)self->view_count, sizeof(int));
    PAGS_CHECK_MEMORY(self->points[k].ms && self->points[k].steps, "times of %lld views", (long long)self->view_count);
  }

  /* Limits need the priority of each Gaussian. */
  const int64_t ids = pags_composition_gaussian_count(self->composition);
  PAGS_AUTOFREE float *priority = calloc((size_t)ids + 1, sizeof *priority);
  PAGS_CHECK_MEMORY(priority, "the priorities of %lld Gaussians of %s", (long long)ids,
                    scene->dataset ? scene->dataset : self->input);
  pags_composition_priorities(self->composition, priority);
  PAGS_TRY(pags_deadline_create(self->arguments->session.tasks, priority, ids, &self->deadline));
  return pags_frame_create(self->arguments->session.tasks, &self->frame);
}

/* ---- Timing ---- */

/* Draws a view at a level; by the point's mode if that is 0 and the point is no limit. */
static pags_result draw(curve *self, const curve_point *point, const curve_view *view, int level,
                        const pags_frame_options *options, const pags_part *parts, int part_count,
                        pags_picture *picture) {
  pags_deadline_result facts;
  if (level > 0 || point->controller.target > 0)
    return pags_deadline_render_step(self->deadline, level, parts, part_count, &view->camera, options, picture, &facts);
  return pags_frame_render(self->frame, parts, part_count, &view->camera, options, NULL, NULL, picture);
}

/* Draws every view by the first `count` points in turn. */
static pags_result time_frames(curve *self, int count, int repetition) {
  for (int64_t v = 0; v < self->view_count; v++) {
    const curve_view *const view = &self->views[v];
    const pags_part *parts;
    int part_count;
    const double done = (double)v / (double)self->view_count, all = self->arguments->repetitions;
    if (!pags_progress_watch(&self->progress, ((double)repetition + done) / all, "timing"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    pags_compose(self->composition, view->camera.time, &parts, &part_count);
    for (int k = 0; k < count; k++) {
      curve_point *const point = &self->points[k];
      pags_picture picture;
      pags_deadline_result facts = {0};
      const int level = point->controller.target > 0 ? point->controller.step : point->level;
      PAGS_TRY(draw(self, point, view, level, &point->options, parts, part_count, &picture)); /* not timed */
      const double begin = pags_seconds();
      if (point->controller.target > 0)
        PAGS_TRY(pags_deadline_render(self->deadline, &point->controller, parts, part_count, &view->camera,
                                      &point->options, &picture, &facts));
      else
        PAGS_TRY(draw(self, point, view, level, &point->options, parts, part_count, &picture));
      point->ms[repetition * self->view_count + v] = 1e3 * (pags_seconds() - begin);
      point->steps[v] = point->level + facts.step;
      point->met += facts.met;
    }
  }
  return PAGS_OK;
}

/* The value below which a share of `count` values lies; sorts them in place. */
static double quantile(double *values, int64_t count, double share) {
  pags_sort_doubles(values, count);
  return 0.5 *
         (values[(int64_t)floor(share * (double)(count - 1))] + values[(int64_t)ceil(share * (double)(count - 1))]);
}

static pags_result time_all(curve *self) {
  PAGS_TRY(time_frames(self, 1, 0)); /* warms up, and sets the limits in per cent */
  PAGS_AUTOFREE double *first = malloc((size_t)self->view_count * sizeof *first);
  PAGS_CHECK_MEMORY(first, "times of %lld views", (long long)self->view_count);
  memcpy(first, self->points[0].ms, (size_t)self->view_count * sizeof *first);
  const double median = quantile(first, self->view_count, 0.5);
  for (int k = 0; k < self->count; k++)
    if (self->points[k].limit_share > 0)
      self->points[k].controller = pags_deadline_controller_begin(self->points[k].limit_share * median);
  for (int r = 0; r < self->arguments->repetitions; r++)
    PAGS_TRY(time_frames(self, self->count, r));
  return PAGS_OK;
}

/* ---- Errors ---- */

/* A picture to compare with: three planes of width x height, and flags of each pixel. */
typedef struct truth {
  double *rgb;
  uint8_t *flags; /* bits of MASKED and LABELLED */
} truth;

enum { MASKED = 1, LABELLED = 2 }; /* masked pixels count against the exact picture only; labelled ones are critical */

static double cut(double v) {
  return v <= 0 ? 0 : v >= 1 ? 1 : v;
}

/* Adds the errors of a picture's pixels, without those that have a flag of `without`. */
static void compare(const pags_picture *picture, const double *rgb, const uint8_t *flags, int without,
                    error_sum sums[REGIONS]) {
  const int64_t plane = (int64_t)picture->width * picture->height;
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->width; x++) {
      const int64_t at = (int64_t)y * picture->width + x;
      double squared = 0, largest = 0;
      bool changed = false;
      if (flags[at] & without)
        continue;
      for (int c = 0; c < 3; c++) {
        const double is = cut((double)picture->rgb[c][(int64_t)y * picture->stride + x]), of = cut(rgb[c * plane + at]);
        squared += (is - of) * (is - of);
        largest = fmax(largest, fabs(is - of));
        changed |= floor(255 * is + 0.5) != floor(255 * of + 0.5);
      }
      for (int r = ALL; r < REGIONS; r++)
        if (r == ALL || flags[at] & LABELLED) {
          sums[r].squared += squared;
          sums[r].largest = fmax(sums[r].largest, largest);
          sums[r].pixels++;
          sums[r].changed += changed;
        }
    }
}

/* NaN without pixels, infinite for equal pictures. */
static double psnr_of(const error_sum *sum) {
  return sum->pixels ? -10 * pags_log10(sum->squared / (3 * (double)sum->pixels)) : (double)NAN;
}

/* Draws the exact picture of a view, without exposure. */
static pags_result draw_exact(curve *self, const curve_view *view, const pags_part *parts, int part_count,
                              double **rgb) {
  const int64_t plane = (int64_t)view->camera.width * view->camera.height;
  pags_frame_options exact = self->points[0].options;
  exact.early_z = PAGS_EARLY_Z_OFF;
  exact.order = PAGS_ORDER_DEPTH;
  exact.exp_degree = 5;
  exact.sh_degree = pags_composition_options(self->composition).sh_degree;
#ifdef PAGS_WITH_REFERENCE
  int64_t pairs;
  if (self->doubles)
    return pags_bench_exact(parts, part_count, &view->camera, &exact, rgb, &pairs);
#endif
  pags_picture picture;
  PAGS_TRY(pags_frame_render(self->frame, parts, part_count, &view->camera, &exact, NULL, NULL, &picture));
  *rgb = malloc(3 * (size_t)plane * sizeof **rgb);
  PAGS_CHECK_MEMORY(*rgb, "a picture of %dx%d", picture.width, picture.height);
  for (int64_t i = 0; i < 3 * plane; i++)
    (*rgb)[i] = (double)picture.rgb[i / plane][i % plane / picture.width * picture.stride + i % picture.width];
  return PAGS_OK;
}

/* Reads a view's photograph into `rgb`, and its masks and labels into `flags`. */
static pags_result read_photograph(curve *self, const curve_view *view, double *rgb, uint8_t *flags) {
  PAGS_AUTO(pags_photograph_destroy) pags_photograph photo = {0};
  const int width = view->camera.width;
  const int64_t plane = (int64_t)width * view->camera.height;
  PAGS_TRY(pags_photographs_read(&self->photographs, view->photo, &photo));
  const float *const from = photo.image.data;
  const uint8_t *const labels = photo.photo.labels;
  for (int64_t i = 0; i < plane; i++) {
    for (int c = 0; c < 3; c++)
      rgb[c * plane + i] = (double)from[3 * i + c];
    flags[i] |= photo.mask && !photo.mask[i] ? MASKED : 0;
    flags[i] |= labels && labels[i / width * photo.photo.stride + i % width] & PAGS_LABEL_CRITICAL ? LABELLED : 0;
  }
  return PAGS_OK;
}

/* Compares every point's picture of a view with the exact picture and, with the camera's exposure, the photograph. */
static pags_result judge_view(curve *self, int64_t v) {
  const curve_view *const view = &self->views[v];
  const size_t plane = (size_t)view->camera.width * (size_t)view->camera.height;
  const pags_part *parts;
  int part_count;
  pags_compose(self->composition, view->camera.time, &parts, &part_count);
  PAGS_AUTOFREE double *exact = NULL, *photo = malloc(3 * plane * sizeof *photo);
  PAGS_AUTOFREE uint8_t *flags = calloc(plane, 1);
  PAGS_CHECK_MEMORY(photo && flags, "a picture of %dx%d", view->camera.width, view->camera.height);
  PAGS_TRY(draw_exact(self, view, parts, part_count, &exact));
  if (view->photo >= 0)
    PAGS_TRY(read_photograph(self, view, photo, flags));
  for (int k = 0; k < self->count; k++) {
    curve_point *const point = &self->points[k];
    pags_picture picture;
    error_sum sums[REGIONS] = {0};
    PAGS_TRY(draw(self, point, view, point->steps[v], &point->options, parts, part_count, &picture));
    compare(&picture, exact, flags, 0, point->exact);
    if (view->photo < 0)
      continue;
    pags_frame_options exposed = point->options;
    if (view->recorded)
      exposed.photometric = view->recorded->photometric;
    if (view->recorded && pags_frame_options_expose(&exposed, view->recorded->gain, view->recorded->offset))
      PAGS_TRY(draw(self, point, view, point->steps[v], &exposed, parts, part_count, &picture));
    compare(&picture, photo, flags, MASKED, sums);
    for (int r = ALL; r < REGIONS; r++)
      if (sums[r].pixels) {
        point->photo_psnr[r] += pags_psnr_capped(psnr_of(&sums[r]));
        self->photo_views[r] += k == 0;
      }
  }
  return PAGS_OK;
}

static pags_result judge_all(curve *self) {
  for (int64_t v = 0; v < self->view_count; v++) {
    if (!pags_progress_watch(&self->progress, (double)v / (double)self->view_count, "exact pictures"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    PAGS_TRY(judge_view(self, v));
  }
  return PAGS_OK;
}

/* ---- Table and JSON ---- */

/* Median and 95 per cent quantile of a point's times, and the median ratio of the first point's time to its. */
typedef struct point_times {
  double median, p95, speed_up;
} point_times;

static pags_result measure_times(const curve *self, int k, point_times *out) {
  const int64_t count = self->view_count * self->arguments->repetitions;
  PAGS_AUTOFREE double *values = malloc((size_t)count * sizeof *values);
  PAGS_CHECK_MEMORY(values, "times of %lld frames", (long long)count);
  for (int64_t i = 0; i < count; i++)
    values[i] = self->points[0].ms[i] / fmax(self->points[k].ms[i], 1e-6);
  out->speed_up = quantile(values, count, 0.5);
  memcpy(values, self->points[k].ms, (size_t)count * sizeof *values);
  out->median = quantile(values, count, 0.5);
  out->p95 = quantile(values, count, 0.95);
  return PAGS_OK;
}

/* Mean PSNR against the photographs; NaN without any. */
static double photo_psnr(const curve *self, const curve_point *point, int region) {
  const int64_t views = self->photo_views[region];
  return views ? point->photo_psnr[region] / (double)views : (double)NAN;
}

static double share(int64_t part, int64_t whole) {
  return whole ? (double)part / (double)whole : (double)NAN;
}

static void put_point(pags_json_writer *json, const curve *self, const curve_point *point, const point_times *times) {
  const bool limited = point->controller.target > 0;
  const int64_t frames = self->view_count * self->arguments->repetitions;
  pags_json_begin_object(json, NULL);
  pags_json_put_string(json, "point", point->name);
  pags_json_put_number(json, "limit_ms", limited ? point->controller.target : (double)NAN);
  pags_json_put_number(json, "met", limited ? share(point->met, frames) : (double)NAN);
  pags_json_put_number(json, "ms", times->median);
  pags_json_put_number(json, "ms_p95", times->p95);
  pags_json_put_number(json, "speed_up", times->speed_up);
  for (int r = ALL; r < REGIONS; r++) {
    const error_sum *const sum = &point->exact[r];
    pags_json_begin_object(json, r == ALL ? "all" : "critical");
    pags_json_put_number(json, "psnr_exact", psnr_of(sum));
    pags_json_put_number(json, "psnr_photo", photo_psnr(self, point, r));
    pags_json_put_number(json, "max_error", sum->pixels ? sum->largest : (double)NAN);
    pags_json_put_number(json, "changed", share(sum->changed, sum->pixels));
    pags_json_end_object(json);
  }
  pags_json_end_object(json);
}

static void say_number(const pags_session *session, int width, int decimals, double value) {
  if (isfinite(value))
    pags_say(session, " %*.*f", width, decimals, value);
  else
    pags_say(session, " %*s", width, isnan(value) ? "-" : "same");
}

static pags_result report(const curve *self) {
  const curve_arguments *a = self->arguments;
  const pags_session *session = &a->session;
  const pags_camera *camera = &self->views[0].camera;
  const char *const exact = self->doubles ? "double precision" : "mode off, exp of degree 5";
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "scene", self->input);
  pags_json_put_integer(&json, "gaussians", pags_composition_gaussian_count(self->composition));
  pags_json_put_integer(&json, "threads", pags_tasks_workers(session->tasks));
  pags_json_put_integer(&json, "views", self->view_count);
  pags_json_put_integer(&json, "width", camera->width);
  pags_json_put_integer(&json, "height", camera->height);
  pags_json_put_integer(&json, "repetitions", a->repetitions);
  pags_json_put_string(&json, "exact", exact);
  pags_json_begin_array(&json, "points");
  pags_say(session, "%s: %lld Gaussians, %lld views of %dx%d, %d frames each, %d threads; exact: %s\n", self->input,
           (long long)pags_composition_gaussian_count(self->composition), (long long)self->view_count, camera->width,
           camera->height, a->repetitions, pags_tasks_workers(session->tasks), exact);
  pags_say(session, "%-16s %8s %8s %8s %8s | %9s %9s %9s %9s | %9s %9s\n", "", "ms", "ms, 95 %", "speed-up", "in time",
           "exact, dB", "critical", "max error", "changed", "photo, dB", "critical");
  for (int k = 0; k < self->count; k++) {
    const curve_point *const point = &self->points[k];
    point_times times = {0};
    PAGS_TRY(measure_times(self, k, &times));
    put_point(&json, self, point, &times);

    /* Print the point's line. */
    const bool limited = point->controller.target > 0;
    char met[16] = "-";
    if (limited)
      snprintf(met, sizeof met, "%.0f %%", 100 * share(point->met, self->view_count * a->repetitions));
    pags_say(session, "%-16s %8.2f %8.2f %8.2f %8s |", point->name, times.median, times.p95, times.speed_up, met);
    say_number(session, 9, 2, psnr_of(&point->exact[ALL]));
    say_number(session, 9, 2, psnr_of(&point->exact[CRITICAL]));
    say_number(session, 9, 4, point->exact[ALL].largest);
    pags_say(session, " %7.2f %% |", 100 * share(point->exact[ALL].changed, point->exact[ALL].pixels));
    say_number(session, 9, 3, photo_psnr(self, point, ALL));
    say_number(session, 9, 3, photo_psnr(self, point, CRITICAL));
    pags_say(session, "\n");
  }
  pags_json_end_array(&json);
  return pags_session_json(session, &json);
}

/* ---- The verb ---- */

static pags_result run(void *user, const pags_parsed *parsed) {
  curve_arguments *const a = user;
  PAGS_AUTO(curve_destroy) curve self = {.arguments = a, .input = parsed->positionals[0]};
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path orbit = {0};
  PAGS_TRY(pags_scene_load(self.input, &scene));
  if (scene.view_count == 0)
    PAGS_TRY(pags_camera_path_orbit(&scene, a->views, PAGS_STAND_AUTO, &orbit));
  PAGS_TRY(pags_composition_create(&scene, &self.composition));
  PAGS_TRY(find_views(&self, &orbit));
  PAGS_TRY(list_points(&self));
  self.doubles = false;
#ifdef PAGS_WITH_REFERENCE
  self.doubles = (int64_t)self.views[0].camera.width * self.views[0].camera.height <= EXACT_PIXELS;
#endif
  PAGS_TRY(pags_session_check(&a->session));
  pags_interrupt_install(a->session.tasks);
  self.progress = pags_progress_begin(a->session.people);
  PAGS_TRY(time_all(&self));
  PAGS_TRY(judge_all(&self));
  pags_progress_end(&self.progress);
  return report(&self);
}

static const pags_verb verb = {
    .name = "curve",
    .usage = "SCENE [options]",
    .about =
        "Measure the time of a frame against its error, for drawing modes, levels of quality and time limits. Times: "
        "median and 95 per "
        "cent quantile over views and repetitions; modes take turns. Errors against the exact picture: PSNR over all "
        "pixels of all views, the largest error, and the share of pixels that are another colour in 8 bits. Exact "
        "pictures are drawn in double precision, or, above 524,288 pixels, by mode off. PSNR against photographs: "
        "mean over views, with the exposures found in training. Critical: vehicles, pedestrians and cyclists. "
        "benchmarks/curve.py plots the results.",
    .positionals = {{"SCENE", "Scene folder or splat file."}},
    .options = verb_options,
    .run = run};

int pags_bench_curve(int argc, char **argv) {
  curve_arguments arguments = {
      .session = {.answers = true},
      .modes = "off,exp3,lossless,bounded=0.001,bounded,bounded=0.016,bounded=0.06,paper,paper-order,sh2,sh1,sh0",
      .limits = "150%,100%,50%",
      .views = 24,
      .repetitions = 3};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
