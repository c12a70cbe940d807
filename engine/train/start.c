/* How a run begins: from nothing, or from its checkpoint. */
#include <stdlib.h>
#include <string.h>

#include "train/checkpoint.h"
#include "train/config.h"
#include "train/init.h"
#include "train/trainer.h"

static uint64_t hash_bytes(uint64_t hash, const void *bytes, size_t size) { /* FNV-1a */
  const uint8_t *b = bytes;
  for (size_t i = 0; i < size; i++)
    hash = (hash ^ b[i]) * 1099511628211u;
  return hash;
}

/* Names, sizes, cameras and roles of all views: what a checkpoint's steps depend on. */
static uint64_t fingerprint_of(const pags_dataset *dataset) {
  uint64_t hash = 14695981039346656037u;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *v = pags_dataset_view(dataset, i);
    int sizes[3] = {v->camera.width, v->camera.height, v->test};
    double lens[4] = {v->camera.fx, v->camera.fy, v->camera.cx, v->camera.cy};
    hash = hash_bytes(hash, v->name, strlen(v->name) + 1);
    hash = hash_bytes(hash, sizes, sizeof sizes);
    hash = hash_bytes(hash, lens, sizeof lens);
    hash = hash_bytes(hash, v->camera.world_from_camera, sizeof v->camera.world_from_camera);
  }
  return hash;
}

pags_result pags_trainer_list_views(pags_trainer *t) {
  int64_t all = pags_dataset_view_count(t->dataset);
  t->views = malloc((size_t)(all > 0 ? all : 1) * sizeof *t->views);
  t->order = malloc(2 * (size_t)(all > 0 ? all : 1) * sizeof *t->order);
  if (!t->views || !t->order)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for %lld views", (long long)all);
  for (int64_t i = 0; i < all; i++)
    if (!pags_dataset_view(t->dataset, i)->test)
      t->views[t->view_count++] = i;
  t->order_epoch = -1;
  if (t->view_count == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: no view to train on: %lld views, all held out",
                     pags_dataset_path(t->dataset), (long long)all);
  t->fingerprint = fingerprint_of(t->dataset);
  return PAGS_OK;
}

static void largest_picture(const pags_trainer *t, int *width, int *height) {
  int64_t most = 0;
  for (int64_t i = 0; i < t->view_count; i++) {
    const pags_camera *c = &pags_dataset_view(t->dataset, t->views[i])->camera;
    if ((int64_t)c->width * c->height <= most)
      continue;
    most = (int64_t)c->width * c->height;
    *width = c->width;
    *height = c->height;
  }
}

/* The smaller of max_gaussians and of what max_memory has room for; 0: neither. */
static int64_t choose_cap(const pags_trainer *t, const pags_train_config *config) {
  int width = 1, height = 1;
  uint64_t memory = t->options->max_memory;
  if (memory == 0)
    return config->max_gaussians;
  largest_picture(t, &width, &height);
  uint64_t fixed = pags_train_bytes(0, config->sh_degree, width, height) + t->options->image_cache;
  uint64_t each =
      (pags_train_bytes(1 << 20, config->sh_degree, 1, 1) - pags_train_bytes(0, config->sh_degree, 1, 1)) >> 20;
  uint64_t room = memory > fixed ? (memory - fixed) / each : 0;
  int64_t fits = room < 1 << 10 ? 1 << 10 : room > INT32_MAX - 64 ? INT32_MAX - 64 : (int64_t)room;
  return config->max_gaussians > 0 && config->max_gaussians < fits ? config->max_gaussians : fits;
}

/* From the data set's points, or, where those are random, from as many that matching finds. */
static pags_result first_gaussians(pags_trainer *t, const pags_train_config *config, int64_t most, double extent,
                                   pags_gaussians *g) {
  int64_t points;
  const float *xyz;
  const uint8_t *rgb;
  float *matched_xyz = NULL;
  uint8_t *matched_rgb = NULL;
  int random;
  pags_dataset_points(t->dataset, &points, &xyz, &rgb, &random);
  if (random && !config->random_start) {
    PAGS_TRY(pags_dataset_match_points(t->dataset, t->tasks, points, config->seed, &matched_xyz, &matched_rgb));
    xyz = matched_xyz;
    rgb = matched_rgb;
  }
  pags_result result = pags_init_gaussians(config, points, xyz, rgb, most, extent, t->tasks, g);
  free(matched_xyz);
  free(matched_rgb);
  return result;
}

pags_result pags_trainer_start(pags_trainer *t, const pags_train_config *config) {
  int64_t cap = choose_cap(t, config);
  pags_gaussians g;
  double extent = pags_init_extent(t->dataset, t->views, t->view_count);
  pags_schedule schedule = pags_schedule_make(config, extent, t->view_count);
  PAGS_TRY(first_gaussians(t, config, cap > 0 ? cap : INT32_MAX - 64, extent, &g));
  PAGS_TRY(pags_state_create(&t->state, &schedule, config->iterations, &g));
  t->state.cap = cap;
  return PAGS_OK;
}

pags_result pags_trainer_resume(pags_trainer *t, const pags_train_config *config) {
  uint64_t fingerprint;
  const char *path = t->output.checkpoint;
  PAGS_TRY(pags_checkpoint_load(path, &t->state, &fingerprint));
  pags_train_state *s = &t->state;
  const char *field = pags_config_difference(config, &s->schedule.config);
  if (fingerprint != t->fingerprint || s->schedule.views != t->view_count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: belongs to other views than those of %s", path,
                     pags_dataset_path(t->dataset));
  if (field)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "%s: was begun with another %s; pass the same, or --overwrite to begin afresh", path, field);
  if (s->clocked || config->iterations == s->stop)
    return PAGS_OK;
  if (config->iterations < s->stop)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: is of a run of %lld iterations; %lld asked for can't be fewer", path,
                     (long long)s->stop, (long long)config->iterations);
  s->schedule.config.iterations = config->iterations;
  s->schedule.config.schedule_iterations = s->schedule.length;
  s->stop = config->iterations;
  return pags_adam_retime(&s->adam, s->stop);
}
