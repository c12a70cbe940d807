/* SPDX-License-Identifier: Apache-2.0 */
/* Converts the size limit of the scene folder into limits on the number of Gaussians; see stages.h. */
#include "train/stages.h"

#include "base/log.h"

enum {
  FOURIER_BYTES = 4 * PAGS_FOURIER_PLANES,
  HEADER_BYTES = 4096,       /* header of a PLY, at most */
  GENERAL_BYTES = 8192,      /* the data set's path, and counts and notes that get longer */
  KEYFRAME_BYTES = 6 * 24,   /* six numbers of a keyframe's increment, which are 0 at the start */
  VIEW_BYTES = 12 * 24,      /* a view's gains and offsets, which may be missing at the start */
  CORRECTION_BYTES = 8 * 24, /* a view's correction */
  LIGHT_BYTES = 12 * 24,     /* a view's vignette and response */
  SKY_TEXEL = 3 * 2,         /* a texel of the sky, undeflated */
  SQUARE = 16,               /* texels a side in which the sky counts as shown or not */
  LOOK_APART = 8             /* pixels from ray to ray: less than a square even at a face's corners */
};
static const int64_t least_background = 16;

/* See stages.h. Counts Fourier terms for objects whose colour over time isn't decided yet. */
int pags_size_limit_row(const pags_train_state *s, int64_t model) {
  const pags_train_model *m = &s->models[model];
  const bool undecided = m->object >= 0 && s->schedule.config.objects.fourier == PAGS_FOURIER_BY_GAIN &&
                         isnan(m->fourier_gain) && !m->gaussians.fourier;
  return pags_ply_row_bytes(&m->gaussians) + (undecided ? FOURIER_BYTES : 0);
}

/* Returns the bytes by which scene.json may still grow: numbers that are short at the start get more digits in
 * training. */
static int64_t to_come(const pags_dataset *dataset, const pags_train_state *s) {
  const int a_view = (s->photometry.count > 0 ? LIGHT_BYTES : 0) + (s->cameras.count > 0 ? CORRECTION_BYTES : 0) +
                     (s->exposures.count > 0 ? VIEW_BYTES : 0);
  int64_t bytes = GENERAL_BYTES + a_view * pags_dataset_view_count(dataset);
  for (int64_t i = 1; i < s->model_count && s->schedule.config.objects.tracks; i++)
    bytes += KEYFRAME_BYTES * s->tracks.objects[s->models[i].object].keyframe_count;
  return bytes;
}

/* Squares of the sky's texels that a photograph shows or may come to show. */
typedef struct shown_squares {
  int size, across; /* texels and squares a side of a face */
  uint8_t *shown;   /* [6][across][across] */
} shown_squares;

/* Marks a square and those around it on its face, which corrected cameras may come to see. */
static void mark(const shown_squares *s, int face, int row, int column) {
  for (int y = row > 0 ? row - 1 : 0; y <= row + 1 && y < s->across; y++)
    for (int x = column > 0 ? column - 1 : 0; x <= column + 1 && x < s->across; x++)
      s->shown[((int64_t)face * s->across + y) * s->across + x] = 1;
}

/* Marks what the training views' cameras look at. */
static void mark_views(const shown_squares *s, const pags_dataset *dataset) {
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *const v = pags_dataset_view(dataset, i);
    const double *const m = v->camera.world_from_camera;
    for (int y = 0; !v->test && y < v->camera.height + LOOK_APART; y += LOOK_APART)
      for (int x = 0; x < v->camera.width + LOOK_APART; x += LOOK_APART) {
        double ray[3], turned[3], at[2];
        if (!pags_camera_look(&v->camera, x < v->camera.width ? x : v->camera.width,
                              y < v->camera.height ? y : v->camera.height, ray))
          continue;
        for (int k = 0; k < 3; k++)
          turned[k] = m[4 * k] * ray[0] + m[4 * k + 1] * ray[1] + m[4 * k + 2] * ray[2];
        const int face = pags_sky_face(turned, at), last = s->across - 1;
        const int row = (int)(at[1] * s->size) / SQUARE, column = (int)(at[0] * s->size) / SQUARE;
        mark(s, face, row < last ? row : last, column < last ? column : last);
      }
  }
}

/* Whether all texels of a square of a face have one colour, as those that no photograph has shown yet. */
static bool is_even(const float *face, int size, int row, int column) {
  const float *const first = face + 3 * ((int64_t)row * size + column);
  for (int y = row; y < row + SQUARE && y < size; y++)
    for (int x = column; x < column + SQUARE && x < size; x++)
      if (memcmp(face + 3 * ((int64_t)y * size + x), first, 3 * sizeof *first) != 0)
        return false;
  return true;
}

/* Marks what training has changed. */
static void mark_uneven(const shown_squares *s, const float *texels) {
  for (int face = 0; face < 6; face++)
    for (int i = 0; i < s->across; i++)
      for (int k = 0; k < s->across; k++)
        if (!is_even(texels + 3 * (int64_t)face * s->size * s->size, s->size, i * SQUARE, k * SQUARE))
          mark(s, face, i, k);
}

/* Returns the most bytes that the sky's file may have in the end: of the texels that the views look at, and once each
 * view has been seen, of those that they show. */
static pags_result most_sky_bytes(const pags_dataset *dataset, const pags_train_state *s, int64_t *bytes) {
  const pags_sky *const sky = &s->sky.sky;
  const int64_t all = 6 * (int64_t)sky->size * sky->size * SKY_TEXEL;
  shown_squares squares = {.size = sky->size, .across = (sky->size + SQUARE - 1) / SQUARE};
  const int64_t count = 6 * (int64_t)squares.across * squares.across;
  int64_t shown = 0;
  *bytes = 0;
  if (sky->size == 0)
    return PAGS_OK;
  PAGS_AUTOFREE uint8_t *marks = squares.shown = calloc((size_t)count, 1);
  PAGS_CHECK_MEMORY(marks, "a sky of %d texels a side", sky->size);
  if (s->step * s->schedule.batch < s->schedule.views)
    mark_views(&squares, dataset);
  else
    mark_uneven(&squares, sky->texels);
  for (int64_t i = 0; i < count; i++)
    shown += marks[i];
  const int64_t packed = shown * SQUARE * SQUARE * SKY_TEXEL * 21 / 20 + all / 200; /* even texels: 1000 to 1 */
  *bytes = (packed < all ? packed : all) + HEADER_BYTES;
  return PAGS_OK;
}

pags_result pags_size_limit_rows(const pags_dataset *dataset, const pags_train_state *s, int64_t *bytes) {
  uint64_t rest = 0;
  int64_t sky;
  PAGS_TRY(pags_output_bytes(dataset, s, &rest));
  PAGS_TRY(most_sky_bytes(dataset, s, &sky));
  *bytes = (int64_t)(s->schedule.config.size_limit.target_size * 1e6) - (int64_t)rest - sky -
           HEADER_BYTES * s->model_count - to_come(dataset, s);
  return PAGS_OK;
}

/* Returns whether a prune by score is still to come, which will apply the size limit. */
static bool is_later(const pags_train_state *s) {
  int prunes = s->schedule.prunes;
  int64_t last = prunes > 0 ? s->schedule.prune_step[prunes - 1] : 0;
  return s->step < last && last < s->stop;
}

static int64_t bytes_used(const pags_train_state *s, int *most) {
  int64_t used = 0;
  *most = 1;
  for (int64_t i = 0; i < s->model_count; i++) {
    int row = pags_size_limit_row(s, i);
    used += row * s->models[i].total;
    *most = row > *most ? row : *most;
  }
  return used;
}

pags_result pags_size_limit_room(const pags_dataset *dataset, const pags_train_state *s, int64_t *gaussians) {
  int64_t bytes = 0;
  int most;
  *gaussians = INT32_MAX;
  if (s->schedule.config.size_limit.target_size <= 0.0 || is_later(s))
    return PAGS_OK;
  PAGS_TRY(pags_size_limit_rows(dataset, s, &bytes));
  bytes -= bytes_used(s, &most);
  *gaussians = bytes > 0 ? bytes / most : 0;
  return PAGS_OK;
}

/* Keeps an even choice of `kept` rows of all ranks. */
static pags_result keep_evenly(pags_train_model *m, int64_t kept, pags_tasks *tasks) {
  const int64_t total = m->total, begin = m->first_row, end = begin + m->gaussians.count;
  PAGS_AUTOFREE int64_t *source = malloc((size_t)kept * sizeof *source);
  PAGS_AUTOFREE uint32_t *numbers = malloc((size_t)kept * sizeof *numbers); /* among all that are kept */
  const bool room = source && numbers;
  int64_t own = 0;
  for (int64_t i = 0; room && i < kept; i++) {
    const int64_t row = i * total / kept;
    if (row < begin || row >= end)
      continue;
    source[own] = row - begin;
    numbers[own++] = (uint32_t)i;
  }
  PAGS_TRY(pags_transport_agree(pags_model_transport(m),
                                room ? pags_model_gather(m, source, own, own, tasks)
                                     : pags_out_of_memory("from %lld Gaussians", (long long)total)));
  return pags_model_sort(m, numbers, tasks);
}

/* How many Gaussians of the background the run may start with. */
static pags_result count_kept(const pags_dataset *dataset, const pags_train_state *s, int64_t *kept) {
  int64_t bytes = 0;
  int most, row = pags_size_limit_row(s, 0);
  PAGS_TRY(pags_size_limit_rows(dataset, s, &bytes));
  int64_t over = bytes_used(s, &most) - bytes, count = s->models[0].total;
  *kept = over > 0 ? count - (over + row - 1) / row : count;
  const int64_t least = count < least_background ? count : least_background;
  if (*kept < least)
    return pags_fail(
        PAGS_ERROR_LIMIT, "target_size: %g MB is too small: %lld Gaussians of the background and all else take %.3f MB",
        s->schedule.config.size_limit.target_size, (long long)least,
        ceil(1e3 * s->schedule.config.size_limit.target_size + 1e-3 * (double)((least - *kept) * row)) / 1e3);
  return PAGS_OK;
}

pags_result pags_size_limit_start(const pags_dataset *dataset, pags_train_state *s, pags_tasks *tasks) {
  int64_t kept = 0;
  if (s->schedule.config.size_limit.target_size <= 0.0)
    return PAGS_OK;
  PAGS_TRY(pags_transport_agree(pags_model_transport(&s->models[0]), count_kept(dataset, s, &kept)));
  if (kept == s->models[0].total || is_later(s))
    return PAGS_OK;
  pags_log_message(PAGS_LOG_INFO, "start: %lld of %lld Gaussians of the background fit the target size",
                   (long long)kept, (long long)s->models[0].total);
  return keep_evenly(&s->models[0], kept, tasks);
}
