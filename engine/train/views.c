/* SPDX-License-Identifier: Apache-2.0 */
/* Lists the training views: their fingerprint, their order (one permutation per pass, schedule.c), their level of
 * resolution, and which ones the photo cache decodes ahead. */
#include "train/views.h"

#include "base/bytes.h"
#include "train/stages.h"

/* Returns a hash of the names, sizes, cameras and roles (training or held out) of all views, of the objects' labelled
 * poses, and of the user's choice of what is critical: the data that the steps of a checkpoint depend on. */
static uint64_t fingerprint_of(const pags_dataset *dataset) {
  uint64_t hash = PAGS_HASH_OF_NOTHING;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *v = pags_dataset_view(dataset, i);
    int sizes[3] = {v->camera.width, v->camera.height, v->test};
    double lens[4] = {v->camera.fx, v->camera.fy, v->camera.cx, v->camera.cy};
    hash = pags_hash_bytes(hash, v->name, strlen(v->name) + 1);
    hash = pags_hash_bytes(hash, sizes, sizeof sizes);
    hash = pags_hash_bytes(hash, lens, sizeof lens);
    hash = pags_hash_bytes(hash, v->camera.world_from_camera, sizeof v->camera.world_from_camera);
    if (pags_camera_rolls(&v->camera))
      hash = pags_hash_bytes(hash, &v->camera.shutter, sizeof v->camera.shutter);
    if (pags_camera_bends(&v->camera)) {
      const pags_lens_model *const m = &v->camera.lens;
      const int kind = (int)m->kind;
      hash = pags_hash_bytes(hash, &kind, sizeof kind);
      hash = pags_hash_bytes(hash, m->k, sizeof m->k);
      hash = pags_hash_bytes(hash, m->d, sizeof m->d);
      hash = pags_hash_bytes(hash, m->p, sizeof m->p);
      hash = pags_hash_bytes(hash, m->s, sizeof m->s);
      hash = pags_hash_bytes(hash, &m->field, sizeof m->field);
    }
  }
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *o = pags_dataset_object(dataset, i);
    hash = pags_hash_bytes(hash, o->id, strlen(o->id) + 1);
    for (int64_t k = 0; k < o->keyframe_count; k++) {
      hash = pags_hash_bytes(hash, &o->keyframes[k].time, sizeof o->keyframes[k].time);
      hash = pags_hash_bytes(hash, o->keyframes[k].world_from_object, sizeof o->keyframes[k].world_from_object);
    }
  }
  if (pags_dataset_critical(dataset))
    hash = pags_hash_bytes(hash, pags_dataset_critical(dataset), strlen(pags_dataset_critical(dataset)));
  return hash;
}

pags_result pags_views_list(pags_trainer *t) {
  int64_t all = pags_dataset_view_count(t->dataset);
  t->views = malloc((size_t)(all > 0 ? all : 1) * sizeof *t->views);
  t->order = malloc(2 * (size_t)(all > 0 ? all : 1) * sizeof *t->order);
  PAGS_CHECK_MEMORY(t->views && t->order, "%lld views", (long long)all);
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

double pags_views_mean_pixels(const pags_trainer *t) {
  double pixels = 0;
  for (int64_t i = 0; i < t->view_count; i++) {
    const pags_camera *camera = &pags_dataset_view(t->dataset, t->views[i])->camera;
    pixels += (double)camera->width * camera->height / (double)t->view_count;
  }
  return pixels;
}

void pags_views_largest(const pags_trainer *t, int *width, int *height) {
  *width = *height = 1;
  for (int64_t i = 0; i < t->view_count; i++) {
    const pags_camera *camera = &pags_dataset_view(t->dataset, t->views[i])->camera;
    if ((int64_t)camera->width * camera->height > (int64_t)*width * *height) {
      *width = camera->width;
      *height = camera->height;
    }
  }
}

/* Returns the data set's view of a photograph of these two passes. In place of one that holdout tests use, the
 * next one is seen. */
static int64_t view_of(const pags_trainer *t, int64_t photograph) {
  int64_t index = t->order[(photograph - 1) - t->order_epoch * t->view_count];
  if (pags_holdout_tests_active(t, pags_schedule_steps(&t->state.schedule, photograph)) && pags_is_holdout_view(index))
    index = (index + 1) % t->view_count;
  return t->views[index];
}

static int level_of(const pags_trainer *t, int64_t step, int64_t view) {
  const pags_camera *camera = &pags_dataset_view(t->dataset, view)->camera;
  return pags_schedule_level(&t->state.schedule, step, camera->width, camera->height);
}

/* Tells the photo cache the next views, up to the first that is needed at another level. */
static void announce(pags_trainer *t, int64_t photograph, int level) {
  const int64_t batch = t->state.schedule.batch;
  int64_t ahead[PAGS_TRAIN_AHEAD], known = (t->order_epoch + 2) * t->view_count;
  int64_t last = known < t->state.stop * batch ? known : t->state.stop * batch;
  int count = 0;
  for (int64_t k = photograph; k <= last && count < PAGS_TRAIN_AHEAD; k++) {
    if ((k - 1) % batch % t->ranks != t->shared.rank) /* another rank draws it */
      continue;
    int64_t view = view_of(t, k);
    if (level_of(t, pags_schedule_steps(&t->state.schedule, k), view) != level)
      break;
    ahead[count++] = view;
  }
  pags_photo_cache_prefetch(t->cache, ahead, count, level);
}

/* Widens the range of each colour by the pixels of a photograph that count, until one is wider than a level. */
static bool within_a_level(const pags_photo *photo, int lo[3], int hi[3]) {
  for (int y = 0; y < photo->height; y++)
    for (int x = 0; x < photo->width; x++) {
      const size_t at = (size_t)y * (size_t)photo->stride + (size_t)x;
      for (int c = 0; c < 3 && (!photo->mask || photo->mask[at]); c++) {
        const int value = photo->rgb[(size_t)c * (size_t)photo->stride * (size_t)photo->height + at];
        lo[c] = value < lo[c] ? value : lo[c];
        hi[c] = value > hi[c] ? value : hi[c];
        if (hi[c] - lo[c] > 1)
          return false;
      }
    }
  return true;
}

pags_result pags_views_find_one_colour(pags_trainer *t, bool *out) {
  int lo[3] = {255, 255, 255}, hi[3] = {0};
  *out = true;
  for (int64_t i = 0; i < t->view_count && *out; i++) {
    pags_photo photo;
    PAGS_TRY(pags_photo_cache_get(t->cache, t->views[i], 1, &photo));
    *out = within_a_level(&photo, lo, hi);
  }
  *out = *out && hi[0] >= lo[0];
  return PAGS_OK;
}

int pags_views_level(const pags_trainer *t, int64_t index) {
  return level_of(t, t->state.step, t->views[index]);
}

pags_result pags_views_photo(pags_trainer *t, int64_t index, int *level, pags_photo *photo) {
  const int64_t left = t->view_count - index;
  *level = pags_views_level(t, index);
  if (t->ranks == 1)
    pags_photo_cache_prefetch(t->cache, t->views + index, left < PAGS_TRAIN_AHEAD ? left : PAGS_TRAIN_AHEAD, *level);
  return pags_photo_cache_get(t->cache, t->views[index], *level, photo);
}

int64_t pags_views_next(pags_trainer *t, int64_t photograph, int *level) {
  const int64_t epoch = (photograph - 1) / t->view_count;
  if (epoch != t->order_epoch) { /* the permutations of this pass and of the next */
    pags_schedule_order(&t->state.schedule, epoch, t->order);
    pags_schedule_order(&t->state.schedule, epoch + 1, t->order + t->view_count);
    t->order_epoch = epoch;
  }
  const int64_t view = view_of(t, photograph);
  *level = level_of(t, pags_schedule_steps(&t->state.schedule, photograph), view);
  announce(t, photograph, *level);
  return view;
}
