/* SPDX-License-Identifier: Apache-2.0 */
/* Opens a training run. A fresh run chooses its limit on Gaussians and creates the first Gaussians, the sky and the
 * exposures; a resumed run loads its checkpoint and checks that it belongs to the data set and configuration. */
#include "base/log.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "cluster/shares.h"
#include "init/driving_points.h"
#include "init/from_points.h"
#include "port/port.h"
#include "simd/kernels.h"
#include "train/config.h"
#include "train/score_pass.h"
#include "train/shards.h"
#include "train/stages.h"
#include "train/views.h"

/* Upper bound, metres, of the extent of the background of a driving set. */
static const double most_extent = 20;

/* ---- Limit on Gaussians ---- */

/* Returns the limit on Gaussians that the run keeps: the smaller of max_gaussians and the number that fits
 * max_memory; 0: neither is set. */
static int64_t choose_cap(const pags_trainer *t, const pags_train_config *config) {
  int width, height;
  const uint64_t memory = t->options->max_memory;
  /* With preset paper, max_gaussians is applied by the last prune instead. */
  const int64_t most = config->schedule.preset == PAGS_PRESET_PAPER ? 0 : config->size_limit.max_gaussians;
  if (memory == 0)
    return most;
  pags_views_largest(t, &width, &height);
  uint64_t fixed = pags_train_bytes(0, config->color.sh_degree, width, height) + t->options->image_cache;
  if (config->sky.sky && pags_dataset_fps(t->dataset) > 0.0)
    fixed += pags_sky_fit_most_bytes(t->dataset);
  const int million = 1 << 20;
  const uint64_t each = (pags_train_bytes(million, config->color.sh_degree, 1, 1) -
                         pags_train_bytes(0, config->color.sh_degree, 1, 1) + pags_batch_bytes(config, million, 0)) /
                        (uint64_t)million;
  const uint64_t room = memory > fixed ? (memory - fixed) / each : 0;
  const int64_t fits = room < 1 << 10 ? 1 << 10 : room > INT32_MAX - 64 ? INT32_MAX - 64 : (int64_t)room;
  return most > 0 && most < fits ? most : fits;
}

/* ---- First models ---- */

/* What a model begins with. `most`: of its Gaussians. */
typedef struct first_model {
  int64_t object; /* -1: the background */
  double extent;
  int64_t count; /* points */
  const float *xyz;
  const uint8_t *rgb;
  int64_t most;
} first_model;

/* Adds the models. With several ranks each makes the Gaussians of its share alone. */
static pags_result add_models(pags_trainer *t, const pags_train_config *config, const first_model *models,
                              int64_t count) {
  const int rank = pags_transport_rank(t->options->transport), ranks = pags_transport_ranks(t->options->transport);
  PAGS_AUTOFREE int64_t *rows = malloc((size_t)count * (size_t)(ranks + 2) * sizeof *rows);
  PAGS_CHECK_MEMORY(rows, "%lld models", (long long)count);
  int64_t *const begin = rows + count;
  for (int64_t i = 0; i < count; i++)
    rows[i] = pags_init_count(models[i].count, models[i].xyz, models[i].most);
  pags_shares_cut(rows, count, config->picture.cluster_size, ranks, begin);
  for (int64_t i = 0; i < count; i++) {
    const first_model *const m = models + i;
    const int64_t *const own = begin + i * (ranks + 1) + rank; /* rows own[0] .. own[1] - 1 */
    pags_gaussians g;
    PAGS_TRY(pags_init_gaussians(config, m->count, m->xyz, m->rgb, m->most, m->extent, own, t->tasks, &g));
    PAGS_TRY(pags_state_add_model(&t->state, m->object, m->extent, &g));
    pags_train_model *const added = &t->state.models[t->state.model_count - 1];
    added->first_row = own[0];
    added->total = rows[i];
    if (m->object >= 0 && t->state.schedule.config.objects.fourier == PAGS_FOURIER_ALL)
      PAGS_TRY(pags_model_add_fourier(added, config->color.sh_degree));
  }
  return PAGS_OK;
}

/* Exposures are tested unless the user asks for them. */
static pags_result start_exposures(pags_trainer *t, const pags_train_config *config) {
  if (!config->exposure.exposure)
    return PAGS_OK;
  PAGS_TRY(pags_exposures_create(&t->state.exposures, t->dataset));
  if (config->exposure.exposure < 0)
    t->state.exposures.holdout = pags_holdout_test_begin();
  return PAGS_OK;
}

static pags_result start_static(pags_trainer *t, const pags_train_config *config, const first_model *only) {
  pags_train_state *const s = &t->state;
  if (config->cameras.light)
    pags_log_message(
        PAGS_LOG_WARNING,
        "%s: light is left out: it is for the rigs of driving sets, whose cameras are the same in all time "
        "steps",
        pags_dataset_path(t->dataset));
  if (config->cameras.camera_poses && t->ranks > 1) /* their holdout test draws the whole scene repeatedly */
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: camera_poses is left out: a capture's poses are corrected by one process, not by %d ranks",
                     pags_dataset_path(t->dataset), t->ranks);
  else if (config->cameras.camera_poses)
    PAGS_TRY(pags_camera_poses_create(&s->cameras, t->dataset));
  PAGS_TRY(add_models(t, config, only, 1));
  return start_exposures(t, config);
}

/* ---- Driving sets ---- */

/* A start point's position, object number and priority. Each Gaussian gets the number and priority of the point it
 * was made from, which is found by its position, since the initialisation has sorted the rows. */
typedef struct point_key {
  float xyz[3];
  int32_t object;
  float s_sem;
} point_key;

static int by_position(const void *a, const void *b) {
  const point_key *x = a, *y = b;
  for (int k = 0; k < 3; k++)
    if (x->xyz[k] != y->xyz[k])
      return x->xyz[k] < y->xyz[k] ? -1 : 1;
  return 0;
}

static pags_result mark_rows(const pags_point_set *points, pags_gaussians *g) {
  PAGS_AUTOFREE point_key *keys = malloc((size_t)(points->count > 0 ? points->count : 1) * sizeof *keys);
  PAGS_CHECK_MEMORY(keys, "%lld points", (long long)points->count);
  PAGS_TRY(pags_gaussians_add_object_id(g));
  PAGS_TRY(pags_gaussians_add_s_sem(g));
  for (int64_t i = 0; i < points->count; i++) {
    keys[i] = (point_key){.object = points->object[i], .s_sem = points->s_sem[i]};
    pags_copy3f(points->xyz + 3 * i, keys[i].xyz);
  }
  pags_sort(keys, points->count, sizeof *keys, by_position);
  for (int64_t row = 0; row < g->count; row++) {
    const point_key key = {
        {pags_plane(g, PAGS_MEAN)[row], pags_plane(g, PAGS_MEAN + 1)[row], pags_plane(g, PAGS_MEAN + 2)[row]}, 0, 0};
    const point_key *found = bsearch(&key, keys, (size_t)points->count, sizeof *keys, by_position);
    g->object_id[row] = found ? found->object : -1;
    g->s_sem[row] = found ? found->s_sem : 0.0f;
  }
  return PAGS_OK;
}

/* Creates the background's and the objects' models, with numbers and priorities of their rows. If the number of
 * Gaussians is limited, objects get at most half of it, shared out in proportion to their numbers of points. */
static pags_result add_driving_models(pags_trainer *t, const pags_train_config *config,
                                      const pags_driving_points *start, double extent) {
  pags_train_state *const s = &t->state;
  int64_t cap = s->cap > 0 ? s->cap : INT32_MAX - 64, points = 0, count = 0;
  for (int64_t i = 0; config->objects.objects && i < start->object_count; i++)
    points += start->objects[i].count;
  const int64_t most = points < cap / 2 ? points : cap / 2;
  PAGS_AUTOFREE first_model *models = malloc((size_t)(start->object_count + 1) * sizeof *models);
  PAGS_CHECK_MEMORY(models, "%lld models", (long long)start->object_count + 1);
  const pags_point_set *const p = &start->background;
  models[count++] = (first_model){-1, extent, p->count, p->xyz, p->rgb, cap - most};
  for (int64_t i = 0; points > 0 && i < start->object_count; i++) {
    const pags_point_set *const o = start->objects + i;
    const int64_t share = o->count * most / points; /* both factors are below 2^31 */
    /* The extent in metres is half of the longest side of the box, as in Street Gaussians (Yan et al. 2024). */
    const double *const size = s->tracks.objects[i].size;
    if (share > 0)
      models[count++] = (first_model){i, 0.5 * fmax(fmax(size[0], size[1]), size[2]), o->count, o->xyz, o->rgb, share};
  }
  PAGS_TRY(add_models(t, config, models, count));
  if (p->object)
    PAGS_TRY(mark_rows(p, &s->models[0].gaussians));
  for (int64_t m = 1; m < s->model_count; m++) {
    pags_gaussians *const g = &s->models[m].gaussians;
    PAGS_TRY(pags_gaussians_add_s_sem(g));
    for (int64_t row = 0; row < g->count; row++)
      g->s_sem[row] = pags_dataset_object_is_critical(t->dataset, s->models[m].object) ? 1.0f : 0.0f;
    pags_state_fit_box(s, m);
  }
  return PAGS_OK;
}

static pags_result start_driving(pags_trainer *t, const pags_train_config *config, double extent) {
  pags_train_state *s = &t->state;
  PAGS_AUTO(pags_driving_points_destroy) pags_driving_points start = {0};
  PAGS_TRY(pags_track_poses_create(&s->tracks, t->dataset));
  if (config->objects.tracks)
    PAGS_TRY(pags_tracks_smooth(&s->tracks));
  PAGS_TRY(pags_driving_points_create(t->dataset, config, config->start.lidar_start, t->cache, t->tasks, &start));
  s->lidar_points = start.lidar_points;
  PAGS_TRY(add_driving_models(t, config, &start, extent));
  const pags_block *block = pags_dataset_block(t->dataset);
  if (config->sky.sky && !(block && block->whole))
    PAGS_TRY(pags_sky_fit_create(&s->sky, t->dataset, t->cache, &s->sky_share));
  PAGS_TRY(start_exposures(t, config));
  if (config->cameras.camera_poses)
    PAGS_TRY(pags_camera_poses_create(&s->cameras, t->dataset));
  if (config->cameras.light)
    PAGS_TRY(pags_photometry_create(&s->photometry, t->dataset));
  PAGS_TRY(pags_shared_parts_load(t->dataset, true, s));
  pags_log_message(PAGS_LOG_INFO, "start: %lld Gaussians in the background, %lld in %lld moving objects; sky %s",
                   (long long)s->models[0].total, (long long)(pags_state_gaussian_count(s) - s->models[0].total),
                   (long long)s->model_count - 1, s->sky.sky.size > 0 ? "modelled" : "not seen");
  return PAGS_OK;
}

/* ---- Starting and resuming ---- */

pags_result pags_trainer_start(pags_trainer *t, const pags_train_config *config) {
  pags_train_state *const s = &t->state;
  const bool driving = pags_dataset_fps(t->dataset) > 0.0;
  first_model only = {.object = -1}; /* of a photograph set */
  PAGS_AUTOFREE float *matched_xyz = NULL;
  PAGS_AUTOFREE uint8_t *matched_rgb = NULL;
  int to_match = 0;
  if (!driving)
    pags_dataset_points(t->dataset, &only.count, &only.xyz, &only.rgb, &to_match);
  if (to_match) {
    PAGS_TRY(
        pags_dataset_match_points(t->dataset, t->tasks, only.count, config->schedule.seed, &matched_xyz, &matched_rgb));
    only.xyz = matched_xyz;
    only.rgb = matched_rgb;
  }
  PAGS_TRY(pags_init_extent(t->dataset, t->views, t->view_count, only.count, only.xyz, &only.extent));
  if (driving) /* in metres: a car that stands still sees a street, too */
    only.extent = fmin(fmax(only.extent, 1.0), most_extent);
  pags_schedule schedule = pags_schedule_make(config, only.extent, t->view_count);
  PAGS_TRY(pags_state_create(s, &schedule, pags_schedule_steps(&schedule, config->schedule.iterations),
                             1 + pags_dataset_object_count(t->dataset)));
  s->cap = choose_cap(t, config);
  only.most = s->cap > 0 ? s->cap : INT32_MAX - 64;
  PAGS_TRY(driving ? start_driving(t, config, only.extent) : start_static(t, config, &only));

  /* Gaussians have a semantic priority S_sem exactly if the data set has labels of what is critical. */
  for (int64_t i = 0; i < s->model_count; i++) {
    pags_gaussians *const g = &s->models[i].gaussians;
    if (pags_score_pass_has_labels(t->dataset)) {
      PAGS_TRY(pags_gaussians_add_s_sem(g));
    } else {
      pags_port_aligned_free(g->s_sem);
      g->s_sem = NULL;
    }
  }
  return PAGS_OK;
}

pags_result pags_trainer_resume(pags_trainer *t, const pags_train_config *config) {
  uint64_t fingerprint;
  const char *path = t->output.checkpoint;
  PAGS_TRY(pags_shards_load(path, t->options->transport, pags_shares_cut, t->dataset, &t->state, &fingerprint));
  pags_train_state *s = &t->state;
  /* With preset paper, max_gaussians only sets what the last prune leaves: before that prune, the user may still ask
   * for another number. */
  const pags_schedule *d = &s->schedule;
  if (d->config.schedule.preset == PAGS_PRESET_PAPER && d->prunes > 0 && s->step < d->prune_step[d->prunes - 1])
    s->schedule.config.size_limit.max_gaussians = config->size_limit.max_gaussians;
  s->schedule.config.size_limit.sh_loss = config->size_limit.sh_loss; /* applied at the end, to the scene alone */
  pags_train_config asked = *config;
  if (asked.schedule.half_until < 0) /* the run has decided it, or will */
    asked.schedule.half_until = s->schedule.config.schedule.half_until;
  if (asked.exposure.exposure < 0) /* before exposures were tested, they were 0 or 1 */
    asked.exposure.exposure = s->schedule.config.exposure.exposure;
  const char *field = pags_config_difference(&asked, &s->schedule.config);
  if (fingerprint != t->fingerprint || s->schedule.views != t->view_count) {
    PAGS_AUTOFREE char *text = pags_other_views(t->output.folder, t->dataset);
    return pags_fail(
        PAGS_ERROR_ARGUMENT,
        "%s: belongs to other views, or another choice of what is critical, than those of %s%s%s; give the data "
        "set as it was, or --overwrite to begin afresh",
        path, pags_dataset_path(t->dataset), text ? ": " : "", text ? text : "");
  }
  if (field)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "%s: was begun with another %s; pass the same, or --overwrite to begin afresh", path, field);
  PAGS_TRY(pags_shared_parts_load(t->dataset, false, s));
  const int64_t batch = s->schedule.batch, stop = pags_schedule_steps(&s->schedule, config->schedule.iterations);
  const pags_kernels *const own = pags_kernels_get(NULL);
  const char *const other = own ? s->kernels.of[!own->fuses] : "";
  if (s->step < (s->clocked ? s->stop : stop) && *other)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: steps were computed with the kernels %s, this process has %s, which round differently: "
                     "the bits will differ from those of an undisturbed run; PAGS_CPU=%s selects the former",
                     path, other, own->name, other);
  if (s->clocked || stop == s->stop)
    return PAGS_OK;
  if (stop < s->stop)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: is of a run of %lld iterations; %lld asked for can't be fewer", path,
                     (long long)(s->stop * batch), (long long)config->schedule.iterations);
  pags_schedule schedule = s->schedule;
  schedule.config.schedule.iterations = config->schedule.iterations;
  schedule.config.schedule.schedule_iterations = s->schedule.length * batch;
  return pags_state_retime(s, &schedule, stop);
}
