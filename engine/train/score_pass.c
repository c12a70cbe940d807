/* SPDX-License-Identifier: Apache-2.0 */
/* Measures the scores of all Gaussians by a pass over the training views; see score_pass.h. */
#include "train/score_pass.h"

#include "cluster/shares.h"
#include "threads/record.h"
#include "train/stages.h"
#include "train/views.h"

typedef struct score_pass {
  pags_trainer *trainer;
  pags_score_pass_kind kind;
  pags_score_pass *scores;
  int64_t *first; /* per model: its first row in `scores` */
  float *counted, *critical;
  int64_t plane_floats;
  bool labelled; /* the current view has labels */
} score_pass;

void pags_score_pass_destroy(pags_score_pass *scores) {
  free(scores->seen);
  *scores = (pags_score_pass){0};
}

bool pags_score_pass_has_labels(const pags_dataset *dataset) {
  return (pags_dataset_provides(dataset) &
          (PAGS_PROVIDES_BOXES | PAGS_PROVIDES_SEMANTIC | PAGS_PROVIDES_DYNAMIC_MASKS)) != 0;
}

/* Makes room for the two mask planes, with the number of rows rounded up to whole tiles, as the frame reads them. */
static pags_result reserve_planes(score_pass *p, const pags_picture *picture) {
  int64_t floats = (int64_t)picture->stride * ((picture->height + 15) / 16 * 16);
  if (floats <= p->plane_floats)
    return PAGS_OK;
  free(p->counted);
  p->counted = calloc(2 * (size_t)floats, sizeof *p->counted);
  p->plane_floats = p->counted ? floats : 0;
  PAGS_CHECK_MEMORY(p->counted, "the masks of a picture of %dx%d", picture->width, picture->height);
  return PAGS_OK;
}

static void add_cluster(void *user, const pags_cluster_score *c, PAGS_UNUSED int worker) {
  const score_pass *p = user;
  const pags_score_pass *const s = p->scores;
  const int64_t first = p->first[p->trainer->render.drawn[c->part].model] + c->first;
  for (int i = 0; i < c->count; i++) {
    s->squared[first + i] += c->squared[i];
    s->drawn[first + i] += c->seen[i];
    if (!p->labelled || !(c->seen[i] > 0.0))
      continue;
    const double weight = p->kind == PAGS_SCORE_PASS_PAPER ? 1.0 / c->seen[i] : 1.0; /* there each view counts once */
    s->seen[first + i] += weight * c->seen[i];
    s->critical[first + i] += weight * c->critical[i];
  }
}

/* Returns the factor by which the photograph of training view `index` is shrunk. */
static int level_of(const score_pass *p, int64_t index) {
  return p->kind == PAGS_SCORE_PASS_PAPER ? 1 : pags_views_level(p->trainer, index);
}

/* Returns the factor by which a rough pass shrinks training's picture of training view `index`: 2, or 1 if the picture
 * would be smaller than training's pictures ever are. */
static int factor_of(const score_pass *p, int64_t index) {
  const pags_trainer *const t = p->trainer;
  const pags_camera *camera = &pags_dataset_view(t->dataset, t->views[index])->camera;
  const int shorter = camera->width < camera->height ? camera->width : camera->height, level = level_of(p, index);
  return p->kind == PAGS_SCORE_PASS_ROUGH && level < 4 &&
                 shorter / (2 * level) >= t->state.schedule.config.schedule.resolution_floor
             ? 2
             : 1;
}

/* Fills the mask planes from the photograph's mask and labels; of each block of `factor` x `factor` pixels, one is
 * sampled. */
static pags_result mask(score_pass *p, const pags_picture *picture, const pags_photo *photo, int factor,
                        pags_score_planes *planes) {
  PAGS_TRY(reserve_planes(p, picture));
  pags_tasks_mark(p->trainer->tasks, NULL, "masks");
  p->critical = p->counted + p->plane_floats;
  p->labelled = photo->labels != NULL;
  for (int y = 0; y < picture->height; y++) {
    int64_t from = (int64_t)(y * factor + factor / 2) * photo->stride + factor / 2, to = (int64_t)y * picture->stride;
    for (int x = 0; x < picture->width; x++, from += factor, to++) {
      p->counted[to] = !photo->mask || photo->mask[from] ? 1.0f : 0.0f;
      p->critical[to] = photo->labels && photo->labels[from] & PAGS_LABEL_CRITICAL ? 1.0f : 0.0f;
    }
  }
  *planes =
      (pags_score_planes){.counted = p->counted, .critical = p->critical, .overlap = p->kind == PAGS_SCORE_PASS_PAPER};
  return PAGS_OK;
}

/* Draws and scores this rank's view, the training view `index`. */
static pags_result look_at(score_pass *p, int64_t index, const pags_frame_options *options) {
  pags_trainer *t = p->trainer;
  int level;
  pags_photo photo;
  pags_picture picture;
  pags_score_planes planes;
  pags_tasks_mark(t->tasks, NULL, "photograph");
  PAGS_TRY(p->kind == PAGS_SCORE_PASS_PAPER ? pags_photo_cache_get(t->cache, t->views[index], 1, &photo)
                                            : pags_views_photo(t, index, &level, &photo));
  pags_tasks_mark(t->tasks, NULL, "compose");
  PAGS_TRY(pags_round_draw(t, t->state.step, options, &picture));
  PAGS_TRY(mask(p, &picture, &photo, factor_of(p, index), &planes));
  return t->ranks > 1 ? pags_shared_views_scores(&t->shared, t->render.frame, &planes)
                      : pags_frame_scores(t->render.frame, &planes, add_cluster, p);
}

/* Returns the scores of a round to the owners of the Gaussians. */
static pags_result give_back(score_pass *p, int count) {
  pags_trainer *t = p->trainer;
  pags_transport *const transport = t->shared.transport;
  uint8_t labelled[PAGS_RANKS_MOST];
  const uint8_t own = p->labelled;
  PAGS_TRY(pags_share_all(transport, &own, sizeof own, labelled));
  PAGS_TRY(pags_shared_views_return_scores(&t->shared));
  pags_result mine = PAGS_OK;
  for (int i = 0; mine == PAGS_OK && i < count; i++) {
    pags_view_render_compose(t, t->round[i].view);
    p->labelled = labelled[i] != 0;
    mine = pags_shared_views_receive_scores(&t->shared, i, add_cluster, p);
  }
  return pags_transport_agree(transport, mine);
}

/* Looks at `count` views, one a rank. */
static pags_result add_round(score_pass *p, const int64_t *indices, int count) {
  pags_trainer *t = p->trainer;
  pags_frame_options options = pags_view_render_options(t, t->state.step);
  options.keep_for_backward = 1;
  for (int i = 0; i < count; i++) {
    const int factor = level_of(p, indices[i]) * factor_of(p, indices[i]);
    t->round[i] = (pags_step_view){.view = t->views[indices[i]],
                                   .camera = pags_view_render_camera(t, t->views[indices[i]], factor)};
  }
  PAGS_TRY(pags_round_project(t, t->state.step, count, &options));
  p->labelled = false;
  const bool draws = t->shared.rank < count;
  PAGS_TRY(pags_transport_agree(t->shared.transport, draws ? look_at(p, indices[t->shared.rank], &options) : PAGS_OK));
  return t->ranks > 1 ? give_back(p, count) : PAGS_OK;
}

/* Returns whether a rough pass looks at view `index`: at half of the views where there are many, by a sequence that
 * takes its share of every camera, whichever way views are listed. */
static bool is_looked_at(int64_t index, int64_t views, pags_score_pass_kind kind) {
  enum { MANY_VIEWS = 100 };
  const double golden = 0.6180339887498949, turns = (double)index * golden;
  return kind != PAGS_SCORE_PASS_ROUGH || views < MANY_VIEWS || turns - (double)(int64_t)turns < 0.5;
}

static pags_result add_views(score_pass *p) {
  pags_trainer *const t = p->trainer;
  int64_t indices[PAGS_RANKS_MOST];
  int count = 0;
  for (int64_t i = 0; i < t->view_count; i++) {
    if (is_looked_at(i, t->view_count, p->kind))
      indices[count++] = i;
    if (count == 0 || (count < t->ranks && i + 1 < t->view_count))
      continue;
    PAGS_TRY(add_round(p, indices, count));
    count = 0;
  }
  return PAGS_OK;
}

pags_result pags_score_pass_measure(pags_trainer *t, pags_score_pass_kind kind, pags_score_pass *out) {
  const pags_train_state *const s = &t->state;
  score_pass p = {.trainer = t, .kind = kind, .scores = out, .first = malloc((size_t)s->model_count * sizeof *p.first)};
  *out = (pags_score_pass){0};
  for (int64_t i = 0; p.first && i < s->model_count; i++) {
    p.first[i] = out->count;
    out->count += s->models[i].gaussians.count;
  }
  pags_result result = PAGS_OK;
  out->seen = calloc(4 * (size_t)(out->count > 0 ? out->count : 1), sizeof *out->seen);
  if (!p.first)
    result = pags_out_of_memory("the scores of %lld models", (long long)s->model_count);
  else if (!out->seen)
    result = pags_out_of_memory("the scores of %lld Gaussians", (long long)out->count);
  result = pags_transport_agree(t->options->transport, result);
  if (result == PAGS_OK) {
    out->critical = out->seen + out->count;
    out->squared = out->critical + out->count;
    out->drawn = out->squared + out->count;
    result = add_views(&p);
  }
  free(p.first);
  free(p.counted);
  return result;
}

void pags_score_pass_write_s_sem(pags_train_state *s, const pags_score_pass *scores) {
  int64_t at = 0;
  for (int64_t m = 0; m < s->model_count; m++) {
    pags_gaussians *g = &s->models[m].gaussians;
    for (int64_t i = 0; i < g->count; i++, at++)
      if (g->s_sem && scores->seen[at] > 0.0) {
        double share = scores->critical[at] / scores->seen[at];
        g->s_sem[i] = share < 1.0 ? (float)share : 1.0f; /* rounding may give more than 1 */
      }
  }
}

pags_result pags_score_pass_set_s_sem(pags_trainer *t) {
  PAGS_AUTO(pags_score_pass_destroy) pags_score_pass scores = {0};
  if (!pags_score_pass_has_labels(t->dataset) || t->state.schedule.config.priority.score != PAGS_SCORE_PAPER)
    return PAGS_OK;
  PAGS_TRY(pags_score_pass_measure(t, PAGS_SCORE_PASS_PAPER, &scores));
  pags_score_pass_write_s_sem(&t->state, &scores);
  return PAGS_OK;
}
