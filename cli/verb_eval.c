/* pags eval: a scene beside its photographs. */
#include "interrupt.h"
#include "model_view.h"
#include "picture.h"
#include "session.h"
#include "truth.h"
#include "verbs.h"

#include <base/file.h>
#include <math.h>
#include <pags/eval.h>
#include <stdlib.h>
#include <string.h>

typedef struct eval_arguments {
  pags_session session;
  const char *dataset, *lpips_weights, *images;
  int split; /* index in "all|train|test" */
  pags_dataset_options options;
  uint64_t image_cache;
} eval_arguments;

#define AT(member) offsetof(eval_arguments, member)

static const pags_option options[] = {
    PAGS_TEXT("dataset", 0, AT(dataset), "DATASET", "the one that the scene was trained on", "the photographs"),
    PAGS_TEXT("lpips-weights", 0, AT(lpips_weights), "FILE", "none: no LPIPS",
              "weights of SqueezeNet LPIPS v0.1 (.npz)"),
    PAGS_TEXT("images", 0, AT(images), "FOLDER", NULL,
              "write NAME_render.png and NAME_photo.png of every view compared"),
    PAGS_CHOICE("split", AT(split), "all|train|test", NULL, "which views to compare"),
    PAGS_VALUE("image-cache", 0, SIZE, AT(image_cache), 1, PAGS_UNLIMITED, "SIZE", "bytes; K, M, G", NULL,
               "memory for decoded photographs"),

    PAGS_GROUP("For splat files, which record no views"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(options.downscale), 1, 64, "F", "times", NULL, "shrink the photographs"),
    PAGS_VALUE("split-every", 0, INT, AT(options.split_every), 0, 1e9, "N", "views; 0: none", NULL,
               "every Nth view counts as held out"),
    PAGS_FLAG("allow-missing", 0, AT(options.allow_missing), "leave out views whose photograph is missing"),
    PAGS_TEXT("colmap", 0, AT(options.colmap), "FOLDER", NULL,
              "take cameras from this COLMAP model; for scenes trained with it too"),
    PAGS_SESSION_OPTIONS(eval_arguments),
    {0}};

static const pags_positional positionals[] = {{"SCENE", "a scene folder or a splat file"}, {NULL, NULL}};

static const pags_verb verb = {
    .name = "eval",
    .usage = "SCENE [--dataset DATASET] [options]",
    .about =
        "Renders a scene's training and held-out views and compares each with its photograph, undistorted and "
        "downscaled as for training. Renderings are clamped to [0, 1] and compared as float, not rounded to 8 bits. "
        "Means are over views, pixels outside of a view's mask left out. LPIPS is SqueezeNet's and not comparable "
        "with figures from AlexNet or VGG.",
    .positionals = positionals,
    .options = options};

typedef struct view_score {
  const char *name;
  int test;
  double psnr, ssim, lpips; /* NaN: not measured */
} view_score;

typedef struct evaluation {
  const eval_arguments *arguments;
  pags_model_view view;
  pags_truth truth;
  pags_lpips *lpips;
  pags_frame *frame;
  pags_frame_options options;
  view_score *scores;
  int64_t count;
} evaluation;

static pags_result save_image(const char *folder, const char *name, const char *what, const pags_image *image) {
  char stem[256], file[300];
  pags_stem(name, stem, sizeof stem);
  snprintf(file, sizeof file, "%s_%s.png", stem, what);
  char *path = pags_path_join(folder, file);
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  pags_result result = pags_image_save(path, image);
  free(path);
  return result;
}

/* LPIPS knows no masks: where the mask is 0 the rendering takes the photograph's pixels, so that they add no distance
 * of their own. */
static void copy_masked(pags_image *render, const pags_image *photo, const uint8_t *mask) {
  float *to = render->data;
  const float *from = photo->data;
  size_t count = (size_t)render->width * (size_t)render->height;
  for (size_t i = 0; i < count; ++i)
    if (!mask[i])
      memcpy(to + 3 * i, from + 3 * i, 3 * sizeof *to);
}

static pags_result measure(const evaluation *self, pags_image *render, const pags_image *photo, const uint8_t *mask,
                           view_score *score) {
  pags_tasks *tasks = self->arguments->session.tasks;
  PAGS_TRY(pags_eval_psnr(render, photo, mask, &score->psnr));
  PAGS_TRY(pags_eval_ssim(render, photo, mask, tasks, &score->ssim));
  if (self->arguments->images) {
    PAGS_TRY(save_image(self->arguments->images, score->name, "render", render));
    PAGS_TRY(save_image(self->arguments->images, score->name, "photo", photo));
  }
  if (self->lpips && mask)
    copy_masked(render, photo, mask);
  if (self->lpips)
    PAGS_TRY(pags_lpips_distance(self->lpips, render, photo, tasks, &score->lpips));
  return PAGS_OK;
}

static pags_result compare_view(evaluation *self, int64_t i) {
  const pags_view *view = pags_dataset_view(self->truth.dataset, self->truth.views[i].index);
  view_score *score = &self->scores[self->count];
  pags_picture picture;
  pags_image render = {0}, photo = {0};
  uint8_t *mask;
  *score = (view_score){view->name, self->truth.views[i].test, (double)NAN, (double)NAN, (double)NAN};
  PAGS_TRY(pags_frame_render(self->frame, self->view.parts, self->view.part_count, &view->camera, &self->options, NULL,
                             NULL, &picture));
  PAGS_TRY(pags_picture_to_image(&picture, PAGS_F32, &render));
  pags_result result = pags_truth_photograph(&self->truth, i, &photo, &mask);
  if (result == PAGS_OK) {
    result = measure(self, &render, &photo, mask, score);
    pags_image_destroy(&photo);
    free(mask);
  }
  pags_image_destroy(&render);
  if (result == PAGS_OK)
    ++self->count;
  return result;
}

static bool wanted(const eval_arguments *arguments, int test) {
  return arguments->split == 0 || (arguments->split == 2) == (test != 0);
}

static pags_result compare_all(evaluation *self) {
  pags_progress progress = pags_progress_begin(self->arguments->session.people);
  pags_result result = PAGS_OK;
  pags_interrupt_install(self->arguments->session.tasks);
  for (int64_t i = 0; result == PAGS_OK && i < self->truth.count; ++i) {
    if (pags_interrupted())
      result = PAGS_CANCELLED;
    else if (wanted(self->arguments, self->truth.views[i].test))
      result = compare_view(self, i);
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "view %lld of %lld", (long long)i + 1, (long long)self->truth.count);
  }
  pags_progress_end(&progress);
  if (result != PAGS_OK && pags_interrupted())
    return pags_fail(PAGS_CANCELLED, "interrupted after %lld of %lld views", (long long)self->count,
                     (long long)self->truth.count);
  return result;
}

typedef struct mean_score {
  int64_t views;
  double psnr, ssim, lpips; /* NaN where there is nothing to average */
} mean_score;

static mean_score mean_of(const evaluation *self, int test) {
  mean_score mean = {0};
  for (int64_t i = 0; i < self->count; ++i)
    if (self->scores[i].test == test) {
      ++mean.views;
      mean.psnr += self->scores[i].psnr;
      mean.ssim += self->scores[i].ssim;
      mean.lpips += self->scores[i].lpips;
    }
  double n = (double)mean.views; /* 0 gives NaN, which JSON writes as null */
  mean.psnr /= n;
  mean.ssim /= n;
  mean.lpips /= n;
  return mean;
}

static void put_split(pags_json_writer *writer, const evaluation *self, const char *key, int test) {
  mean_score mean = mean_of(self, test);
  pags_json_begin_object(writer, key);
  pags_json_put_integer(writer, "views", mean.views);
  pags_json_put_number(writer, "psnr", mean.psnr);
  pags_json_put_number(writer, "ssim", mean.ssim);
  pags_json_put_number(writer, "lpips", mean.lpips);
  pags_json_put_null(writer, "psnr_critical"); /* a static scene has no masks of critical or moving things */
  pags_json_put_null(writer, "psnr_noncritical");
  pags_json_put_null(writer, "psnr_moving");
  pags_json_begin_array(writer, "per_view");
  for (int64_t i = 0; i < self->count; ++i) {
    const view_score *score = &self->scores[i];
    if (score->test != test)
      continue;
    pags_json_begin_object(writer, NULL);
    pags_json_put_string(writer, "name", score->name);
    pags_json_put_number(writer, "psnr", score->psnr);
    pags_json_put_number(writer, "ssim", score->ssim);
    pags_json_put_number(writer, "lpips", score->lpips);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
  pags_json_end_object(writer);
}

static pags_result write_json(const evaluation *self) {
  pags_json_writer writer;
  pags_json_writer_init(&writer, 2);
  pags_json_begin_object(&writer, NULL);
  pags_json_put_integer(&writer, "gaussians", self->view.gaussian_count);
  put_split(&writer, self, "train", 0);
  put_split(&writer, self, "test", 1);
  pags_json_end_object(&writer);
  return pags_session_json(&self->arguments->session, &writer);
}

static void print_row(const pags_session *session, const char *name, const char *set, double psnr, double ssim,
                      double lpips) {
  char distance[16] = "-";
  if (isfinite(lpips))
    snprintf(distance, sizeof distance, "%.4f", lpips);
  pags_say(session, "%-32s %-5s %9.3f %8.4f %8s\n", name, set, psnr, ssim, distance);
}

static void print_table(const evaluation *self) {
  const pags_session *session = &self->arguments->session;
  pags_say(session, "%-32s %-5s %9s %8s %8s\n", "view", "set", "PSNR dB", "SSIM", "LPIPS");
  for (int test = 0; test < 2; ++test)
    for (int64_t i = 0; i < self->count; ++i) {
      const view_score *score = &self->scores[i];
      if (score->test == test)
        print_row(session, score->name, test ? "test" : "train", score->psnr, score->ssim, score->lpips);
    }
  for (int test = 0; test < 2; ++test) {
    mean_score mean = mean_of(self, test);
    char name[48];
    snprintf(name, sizeof name, "mean of %lld", (long long)mean.views);
    if (mean.views)
      print_row(session, name, test ? "test" : "train", mean.psnr, mean.ssim, mean.lpips);
  }
}

static pags_result evaluate(evaluation *self, const char *scene_path) {
  const eval_arguments *arguments = self->arguments;
  PAGS_TRY(pags_model_view_load(scene_path, &self->view));
  const char *dataset = arguments->dataset ? arguments->dataset : self->view.scene.dataset;
  if (!dataset)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: doesn't say what it was trained on; expected --dataset DATASET",
                     scene_path);
  if (arguments->lpips_weights)
    PAGS_TRY(pags_lpips_load(arguments->lpips_weights, &self->lpips));
  PAGS_TRY(pags_truth_open(&self->view.scene, dataset, &arguments->options, arguments->session.tasks,
                           arguments->image_cache, &self->truth));
  self->scores = calloc((size_t)self->truth.count, sizeof *self->scores);
  if (!self->scores)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld views", (long long)self->truth.count);
  self->options = pags_model_view_options(&self->view);
  PAGS_TRY(pags_frame_create(arguments->session.tasks, &self->frame));
  if (arguments->images)
    PAGS_TRY(pags_prepare_folder(arguments->images, NULL));
  PAGS_TRY(compare_all(self));
  if (!self->count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: no %s views to compare", scene_path,
                     arguments->split == 2 ? "held-out" : "training");
  print_table(self);
  return write_json(self);
}

static void destroy(evaluation *self) {
  if (self->frame)
    pags_frame_destroy(self->frame);
  pags_truth_close(&self->truth);
  if (self->lpips)
    pags_lpips_destroy(self->lpips);
  pags_model_view_destroy(&self->view);
  free(self->scores);
}

int pags_verb_eval(int argc, char **argv) {
  eval_arguments arguments = {.options = pags_dataset_options_default(), .image_cache = (uint64_t)256 << 20};
  evaluation self = {.arguments = &arguments};
  pags_parsed parsed;
  pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK)
    result = evaluate(&self, parsed.positionals[0]);
  destroy(&self);
  return pags_session_end(&arguments.session, result);
}
