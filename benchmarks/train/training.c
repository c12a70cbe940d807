/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench train: trains a scene and reports milliseconds per step by stage, held-out PSNR against training time,
 * and the stages and roofline of the trained Gaussians. */
#include "benchmarks/bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "maths/maths.h"

enum { MOST_SNAPSHOTS = 1000 };

typedef struct snapshot {
  int64_t step, gaussians;
  double seconds, psnr;
} snapshot;

typedef struct training {
  const pags_train_config *config;
  const pags_train_options *options;
  pags_photo_cache *photos;
  pags_frame *frame;
  FILE *people;
  snapshot snapshots[MOST_SNAPSHOTS];
  int count;
  pags_gaussians last; /* copy of the Gaussians of the last snapshot */
  double origin[3];
  pags_result result;
} training;

/* ---- Held-out PSNR ---- */

/* Mean squared error of a picture, clamped to [0, 1], over the pixels of the photograph's mask. */
static double mean_square(const pags_picture *picture, const pags_photo *photo) {
  double sum = 0;
  int64_t count = 0;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < photo->height; y++) {
      const float *const row = picture->rgb[c] + (int64_t)y * picture->stride;
      const uint8_t *const truth = photo->rgb + ((int64_t)c * photo->height + y) * photo->stride;
      for (int x = 0; x < photo->width; x++) {
        if (photo->mask && !photo->mask[(int64_t)y * photo->stride + x])
          continue;
        const double d = fmin(1.0, fmax(0.0, (double)row[x])) - truth[x] / 255.0;
        sum += d * d;
        count++;
      }
    }
  return count ? sum / (double)count : 0;
}

static pags_frame_options frame_options(const pags_train_config *config, const double origin[3]) {
  pags_frame_options options = pags_frame_options_default();
  memcpy(options.origin, origin, sizeof options.origin);
  for (int c = 0; c < 3; c++)
    options.background[c] = (float)config->picture.background[c];
  options.near_plane = (float)config->picture.near_plane;
  options.low_pass = (float)config->picture.low_pass;
  options.antialiased = config->picture.antialiased;
  return options;
}

static pags_result held_out_psnr(training *t, const pags_gaussians *gaussians, const double origin[3], double *psnr) {
  pags_clusters clusters;
  PAGS_TRY(pags_clusters_create(&clusters, gaussians->count, t->config->picture.cluster_size));
  pags_clusters_update(&clusters, gaussians, 0, clusters.count);
  const pags_part part = {
      .gaussians = gaussians, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const pags_frame_options options = frame_options(t->config, origin);
  const pags_dataset *const dataset = t->options->dataset;
  double sum = 0;
  int64_t count = 0;
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset) && result == PAGS_OK; i++) {
    const pags_view *const view = pags_dataset_view(dataset, i);
    if (!view->test)
      continue;
    pags_picture picture;
    pags_photo photo;
    result = pags_photo_cache_get(t->photos, i, 1, &photo);
    if (result == PAGS_OK)
      result = pags_frame_render(t->frame, &part, 1, &view->camera, &options, NULL, NULL, &picture);
    if (result == PAGS_OK) {
      sum += -10 * pags_log10(fmax(mean_square(&picture, &photo), 1e-12));
      count++;
    }
  }
  *psnr = count ? sum / (double)count : NAN;
  pags_clusters_destroy(&clusters);
  return result;
}

/* ---- Snapshots ---- */

static pags_result keep_copy(training *t, const pags_gaussians *gaussians) {
  pags_gaussians_destroy(&t->last);
  PAGS_TRY(pags_gaussians_create_like(&t->last, gaussians->count, gaussians));
  const int planes = pags_plane_count(gaussians->sh_degree);
  for (int p = 0; p < planes; p++)
    memcpy(pags_plane(&t->last, p), pags_plane(gaussians, p), (size_t)gaussians->count * sizeof(float));
  return PAGS_OK;
}

static void take_snapshot(void *user, const pags_train_progress *progress, const pags_gaussians *gaussians,
                          const double origin[3]) {
  training *const t = user;
  if (t->result != PAGS_OK || t->count == MOST_SNAPSHOTS)
    return;
  snapshot *const s = &t->snapshots[t->count];
  *s = (snapshot){progress->step, gaussians->count, progress->seconds, NAN};
  t->result = held_out_psnr(t, gaussians, origin, &s->psnr);
  if (t->result == PAGS_OK)
    t->result = keep_copy(t, gaussians);
  memcpy(t->origin, origin, sizeof t->origin);
  t->count++;
  if (t->people) {
    fprintf(t->people, "step %6lld  %8.1f s  %8.1f it/s  %7lld Gaussians  held-out PSNR %.2f dB\n", (long long)s->step,
            s->seconds, progress->it_per_second, (long long)s->gaussians, s->psnr);
    fflush(t->people);
  }
}

/* ---- The trained scene and the report ---- */

/* Measures stages and roofline of the trained Gaussians from up to four training views. */
static pags_result put_trained(const training *t, FILE *people, pags_json_writer *json) {
  pags_camera cameras[4];
  int count = 0;
  const pags_dataset *const dataset = t->options->dataset;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset) && count < 4; i++)
    if (!pags_dataset_view(dataset, i)->test)
      cameras[count++] = pags_dataset_view(dataset, i)->camera;
  pags_clusters clusters;
  PAGS_TRY(pags_clusters_create(&clusters, t->last.count, t->config->picture.cluster_size));
  pags_clusters_update(&clusters, &t->last, 0, clusters.count);
  const pags_part part = {
      .gaussians = &t->last, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const pags_bench_view view = {.tasks = t->options->tasks,
                                .parts = &part,
                                .part_count = 1,
                                .cameras = cameras,
                                .camera_count = count,
                                .options = frame_options(t->config, t->origin),
                                .repetitions = 5};
  pags_result result = pags_bench_stages(&view, people, json);
  if (result == PAGS_OK)
    result = pags_bench_roofline(&view, people, json);
  pags_clusters_destroy(&clusters);
  return result;
}

static pags_result run(training *t, int64_t snapshot_every, pags_json_writer *json) {
  PAGS_TRY(pags_frame_create(t->options->tasks, &t->frame));
  PAGS_TRY(pags_photo_cache_create(t->options->dataset, t->options->tasks, t->options->image_cache, &t->photos));
  pags_train_options options = *t->options;
  options.snapshot_every = snapshot_every;
  options.snapshot = take_snapshot;
  options.snapshot_user = t;
  pags_train_result trained;
  PAGS_TRY(pags_train(t->config, &options, &trained));
  PAGS_TRY(t->result);

  /* Write and print the training's figures. */
  pags_json_put_bool(json, "finished", trained.finished != 0);
  pags_json_put_integer(json, "iterations", trained.iterations);
  pags_json_put_integer(json, "gaussians", trained.gaussians);
  pags_json_put_number(json, "seconds", trained.seconds);
  pags_json_put_number(json, "iterations_per_second", trained.iterations_per_second);
  pags_json_put_unsigned(json, "peak_rss_bytes", trained.peak_rss_bytes);
  pags_json_begin_object(json, "ms_per_step");
  pags_json_put_number(json, "wait", trained.ms_wait);
  pags_json_put_number(json, "forward", trained.ms_forward);
  pags_json_put_number(json, "loss", trained.ms_loss);
  pags_json_put_number(json, "backward", trained.ms_backward);
  pags_json_put_number(json, "density", trained.ms_density);
  pags_json_end_object(json);
  if (t->people)
    fprintf(
        t->people,
        "%lld steps in %.1f s, %.1f it/s over the last tenth, %lld Gaussians, peak memory %.0f MB\n"
        "ms a step, mean of the whole run: wait %.2f, forward %.2f, loss %.2f, backward and Adam %.2f, density %.2f\n",
        (long long)trained.iterations, trained.seconds, trained.iterations_per_second, (long long)trained.gaussians,
        (double)trained.peak_rss_bytes * 1e-6, trained.ms_wait, trained.ms_forward, trained.ms_loss,
        trained.ms_backward, trained.ms_density);

  pags_json_begin_array(json, "held_out");
  for (int i = 0; i < t->count; i++) {
    pags_json_begin_object(json, NULL);
    pags_json_put_integer(json, "step", t->snapshots[i].step);
    pags_json_put_number(json, "seconds", t->snapshots[i].seconds);
    pags_json_put_integer(json, "gaussians", t->snapshots[i].gaussians);
    pags_json_put_number(json, "psnr", t->snapshots[i].psnr);
    pags_json_end_object(json);
  }
  pags_json_end_array(json);

  /* Report the training time at which each whole decibel from 20 to 30 was first reached. */
  pags_json_begin_object(json, "seconds_to_psnr");
  for (int level = 20; level <= 30; level++) {
    int i = 0;
    while (i < t->count && !(t->snapshots[i].psnr >= level))
      i++;
    if (i == t->count)
      break;
    char key[8];
    snprintf(key, sizeof key, "%d", level);
    pags_json_put_number(json, key, t->snapshots[i].seconds);
    if (t->people)
      fprintf(t->people, "%d dB held out after %.1f s (step %lld)\n", level, t->snapshots[i].seconds,
              (long long)t->snapshots[i].step);
  }
  pags_json_end_object(json);

  return t->last.count > 0 ? put_trained(t, t->people, json) : PAGS_OK;
}

pags_result pags_bench_train(const pags_train_config *config, const pags_train_options *options, int64_t snapshot_every,
                             FILE *people, pags_json_writer *json) {
  training *const t = calloc(1, sizeof *t);
  if (!t)
    return pags_out_of_memory("the benchmark");
  t->config = config;
  t->options = options;
  t->people = people;
  const pags_result result = run(t, snapshot_every, json);
  pags_gaussians_destroy(&t->last);
  pags_photo_cache_destroy(t->photos);
  pags_frame_destroy(t->frame);
  free(t);
  return result;
}
