/* SPDX-License-Identifier: Apache-2.0 */
/* One training step, on one view or several.
 *
 * For each of its views, the frame is rendered, with the pending Adam steps of each cluster in view applied before it
 * is read; the losses write dLoss/d(picture); in the frame's backward pass, the receiver updates each cluster's
 * Gaussians while their gradients are in cache. Poses and exposures are updated at the step's end, from sums that are
 * taken in a fixed order.
 *
 * A step of several photographs (a batch) sees all of them with the same parameters. Their gradients by Gaussians and
 * sky are added up in the order of the photographs, and one Adam step follows by the mean. Each photograph separately
 * counts for densify's statistics, dropout, the object opacity term, and one Adam step of the poses and exposures that
 * it shows, in their order. So the bits of a run depend on the size of a batch, not on who computes which photograph.
 */
#include "train/stages.h"

#include "base/parallel.h"
#include "threads/record.h"
#include "train/mcmc.h"

enum { MOST_SAMPLES = 16384 };
/* The object opacity term is evaluated for one of OBJECTS_EVERY photographs: its picture changes slowly, and it costs a
 * tenth of a step. */
enum { OBJECTS_EVERY = 4, FINISH_GRAIN = 8 };
enum { GRADIENT, GRADIENT_T = 3, GRADIENT_DEPTH, ZEROS, ONES, MASKED, SHOWN, PLANES = SHOWN + 3 };

/* ---- Memory ---- */

/* Makes room for the planes of a picture's gradients, with the number of rows rounded up to whole tiles, as the frame
 * reads them. */
static pags_result reserve_planes(pags_trainer *t, const pags_picture *picture) {
  pags_view_render *p = &t->render;
  int64_t floats = (int64_t)picture->stride * ((picture->height + 15) / 16 * 16);
  if (floats <= p->plane_floats)
    return PAGS_OK;
  p->plane_floats = 0;
  for (int i = 0; i < (t->state.photometry.count > 0 ? PLANES : SHOWN); i++)
    PAGS_CHECK_MEMORY(pags_floats_renew(&p->plane[i], floats), "gradients of a %d x %d picture", picture->width,
                      picture->height);
  free(p->emphasis);
  p->emphasis = calloc((size_t)floats, 1);
  PAGS_CHECK_MEMORY(p->emphasis, "loss weights of a %d x %d picture", picture->width, picture->height);
  for (int64_t i = 0; i < floats; i++)
    p->plane[ONES][i] = 1.0f;
  p->plane_floats = floats;
  return PAGS_OK;
}

/* Makes room in a store for the clusters of a model, and for their growth. */
static pags_result reserve_store(const pags_train_model *m, pags_gradient_store *store) {
  const int64_t clusters = m->clusters.count;
  return pags_gradient_store_reserve(store, clusters <= store->clusters ? clusters : clusters + clusters / 2,
                                     pags_all_planes(&m->gaussians) * (int64_t)m->clusters.size);
}

/* ---- Receivers of the backward pass ---- */

/* Whether one of a cluster's rows is drawn, or bad: has a gradient that the frame has set to zero because it wasn't
 * finite. */
static bool any(const uint8_t *flags, int count) {
  int found = 0;
  for (int i = 0; i < count; i++)
    found |= flags[i];
  return found != 0;
}

/* Receiver of the object opacity term's backward pass: keeps an object's gradients until those of the whole picture
 * arrive. A row whose gradient isn't finite gets none from this term, and is counted. */
static void hold(void *user, const pags_cluster_gradient *g, PAGS_UNUSED int worker) {
  const pags_render_context *c = user;
  pags_view_render *p = &c->trainer->render;
  const int64_t model = p->drawn[c->first_part + g->part].model;
  const pags_train_model *m = &c->trainer->state.models[model];
  if (!any(g->drawn, g->count))
    return;
  for (int i = 0; i < g->count; i++)
    if (g->bad[i])
      pags_nonfinite_note(&c->trainer->state.nonfinite, 1,
                          &(pags_nonfinite_row){c->step, m->object, m->first_row + g->first + i, g->bad[i] - 1,
                                                PAGS_NONFINITE_GRADIENT});
  pags_gradient_store_add(&p->models[model].held, g->cluster, p->photograph, g->data, g->planes * g->stride);
}

/* Receiver of the backward pass: adds the densify statistics and squared derivatives of a cluster and does an Adam step
 * on its Gaussians, or with several photographs a step adds up their gradients for finish_blocks. A cluster in view
 * none of whose Gaussians was drawn is skipped and its step stays pending: whether a cluster was in view must not
 * change a bit. */
static void receive(void *user, const pags_cluster_gradient *g, int worker) {
  const pags_render_context *c = user;
  pags_view_render *p = &c->trainer->render;
  int64_t model = p->drawn[g->part].model;
  pags_train_model *m = &c->trainer->state.models[model];
  const int columns = pags_gradient_planes(&m->gaussians, g->planes);
  float *const copy = p->rows + worker * pags_row_floats(&m->schedule.config);
  const float *data = g->data;
  if (c->trainer->measuring || !any(g->drawn, g->count))
    return;

  /* Add the densify statistics. */
  for (int i = 0; i < g->count; i++) {
    if (!g->drawn[i])
      continue;
    m->density.gradient[g->first + i] += g->mean2d[i];
    m->density.seen[g->first + i]++;
  }
  for (int i = 0; g->squared && i < g->count; i++)
    m->density.squared[g->first + i] += g->squared[i];

  const bool alone = m->schedule.batch == 1;
  const float *const held = pags_gradient_store_find(&p->models[model].held, g->cluster, p->photograph);
  const bool mcmc = alone && m->schedule.config.density.strategy == PAGS_STRATEGY_MCMC, bad = any(g->bad, g->count);
  if (mcmc || held || bad || m->gaussians.fourier) {
    memcpy(copy, data, (size_t)g->planes * (size_t)g->stride * sizeof(float));
    data = copy;
  }
  for (int64_t i = 0; held && i < (int64_t)g->planes * g->stride; i++)
    copy[i] += held[i];
  if (m->object >= 0 || c->trainer->state.cameras.count > 0)
    pags_pose_gradient(data, g->stride, g->planes, &p->parts[g->part], g->first, g->count,
                       p->models[model].pose[g->cluster]);
  if (mcmc)
    pags_mcmc_regularise(m, g->first, g->count, copy, g->stride);
  if (m->gaussians.fourier)
    pags_fourier_gradient(p->models[model].basis, copy + (int64_t)PAGS_SH * g->stride, g->stride, columns - g->planes,
                          copy + (int64_t)g->planes * g->stride);
  for (int i = 0; bad && i < g->count; i++)
    if (g->bad[i])
      copy[(g->bad[i] - 1) * g->stride + i] = NAN; /* not finite again, so that the update leaves the row out */
  if (alone)
    pags_model_update(m, &c->trainer->state.nonfinite, g->cluster, data, g->stride, g->planes);
  else
    pags_gradient_store_add(&p->models[model].sum, g->cluster, c->step, data, columns * g->stride);
}

/* ---- Loss terms ---- */

/* Whether other ranks draw, too. */
static bool shares(const pags_trainer *t) {
  return t->shared.ranks > 1;
}

static float alpha_min(const pags_trainer *t) {
  return t->state.models[0].gaussians.alpha_min;
}

/* Makes room for the gradients of the object opacity term. */
static pags_result reserve_held(pags_trainer *t) {
  pags_view_render *const p = &t->render;
  for (int i = 1; i < p->part_count; i++)
    PAGS_TRY(reserve_store(&t->state.models[p->drawn[i].model], &p->models[p->drawn[i].model].held));
  return PAGS_OK;
}

/* Evaluates the opacity term of the moving objects on a picture of them alone. Its gradients are kept until those of
 * the whole picture arrive. They are weighted by OBJECTS_EVERY, which makes up for the steps without this term. */
static pags_result object_term(pags_trainer *t, int64_t step, pags_step_view *v) {
  pags_view_render *p = &t->render;
  pags_render_context context = {t, step, 1};
  pags_frame_options options = pags_view_render_options(t, step);
  pags_picture picture;
  options.sky = NULL;
  options.keep_for_backward = 1;
  PAGS_TRY(reserve_held(t));
  v->result.objects_drawn = true;
  if (shares(t))
    PAGS_TRY(pags_shared_views_draw(&t->shared, p->object_frame, true, alpha_min(t), &v->camera, &options, &picture));
  else
    PAGS_TRY(pags_frame_render(p->object_frame, p->parts + 1, p->part_count - 1, &v->camera, &options,
                               pags_view_render_touch, &context, &picture));
  pags_tasks_mark(t->tasks, NULL, "loss");
  float *by_t = p->plane[GRADIENT_T];
  memset(by_t, 0, (size_t)p->plane_floats * sizeof(float));
  PAGS_TRY(pags_driving_loss_objects(t->tasks, &picture, &v->photo,
                                     OBJECTS_EVERY * t->state.schedule.config.losses.object_weight, by_t,
                                     &v->result.terms.objects));
  v->result.terms.objects /= OBJECTS_EVERY;
  pags_picture_gradient gradient = {.rgb = {p->plane[ZEROS], p->plane[ZEROS], p->plane[ZEROS]}, .transmittance = by_t};
  return shares(t) ? pags_shared_views_sums(&t->shared, p->object_frame, true, &gradient)
                   : pags_frame_backward(p->object_frame, &gradient, hold, &context, NULL);
}

/* Preparation of the loss, over the pixels of a picture's planes. */
typedef struct prepare_job {
  float *cleared[2];     /* planes of gradients to set to zero; NULL: none */
  const uint8_t *labels; /* NULL: no emphasis */
  uint8_t *emphasis;     /* receives where labels are critical */
  int64_t labelled;      /* pixels of `labels` */
} prepare_job;

static void prepare_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const prepare_job *const job = context;
  for (int k = 0; k < 2; k++)
    if (job->cleared[k])
      memset(job->cleared[k] + begin, 0, (size_t)(end - begin) * sizeof(float));
  const int64_t last = !job->labels ? begin : end < job->labelled ? end : job->labelled;
  for (int64_t i = begin; i < last; i++)
    job->emphasis[i] = (job->labels[i] & PAGS_LABEL_CRITICAL) != 0;
}

/* Sets the planes of the gradients by transmittance and depth sum to zero where `gradient` has them, and gives critical
 * pixels of the view the weight critical_weight in the photometric loss; not in timing probes. */
static pags_result prepare(pags_trainer *t, const pags_step_view *v, const pags_picture_gradient *gradient,
                           pags_comparison *how) {
  enum { GRAIN = 1 << 14 };
  const pags_view_render *const p = &t->render;
  const pags_photo *const photo = &v->photo;
  const double times = t->state.schedule.config.priority.critical_weight;
  prepare_job job = {.cleared = {gradient->transmittance ? p->plane[GRADIENT_T] : NULL,
                                 gradient->depth_sum ? p->plane[GRADIENT_DEPTH] : NULL}};
  if (photo->labels && times > 1.0 && !t->measuring) {
    job.labels = photo->labels;
    job.emphasis = p->emphasis;
    job.labelled = (int64_t)photo->stride * photo->height;
    how->emphasis = p->emphasis;
    how->times = times;
  }
  if (!job.labels && !job.cleared[0] && !job.cleared[1])
    return PAGS_OK;
  return pags_parallel_run(t->tasks, p->plane_floats, GRAIN, prepare_block, &job);
}

/* Evaluates the photometric loss of what the camera shows of the picture. */
static pags_result compare(pags_trainer *t, pags_step_view *v, const pags_comparison *how) {
  float **const gradient = t->render.plane + GRADIENT, **const shown = t->render.plane + SHOWN;
  const pags_photometry *const p = &t->state.photometry;
  if (p->count == 0)
    return pags_photometric_loss_evaluate(t->tasks, &v->picture, &v->photo, how, gradient, &v->result.loss);
  const pags_photometric light = pags_photometry_of_sensor(p, pags_dataset_view(t->dataset, v->view)->sensor);
  pags_picture picture = v->picture;
  pags_stage_time clock = pags_stage_now();
  PAGS_TRY(pags_photometry_apply(t->tasks, &light, &v->camera, &v->picture, shown));
  for (int c = 0; c < 3; c++)
    picture.rgb[c] = shown[c];
  pags_stage_lap(&clock, &t->ms.of[PAGS_DECISION_LIGHT]);
  PAGS_TRY(pags_photometric_loss_evaluate(t->tasks, &picture, &v->photo, how, gradient, &v->result.loss));
  clock = pags_stage_now();
  PAGS_TRY(pags_photometry_back(t->tasks, &light, &v->camera, &v->picture, gradient, &v->result.by_light));
  pags_stage_lap(&clock, &t->ms.of[PAGS_DECISION_LIGHT]);
  return PAGS_OK;
}

/* Whether the step adds to S_grad of a prune to come. */
static bool adds_squares(const pags_trainer *t, int64_t step) {
  const pags_schedule *const s = &t->state.schedule;
  return s->config.priority.score == PAGS_SCORE_PAPER && s->prunes > 0 && step <= s->prune_step[s->prunes - 1];
}

/* Returns a plane that is 1 at the pixels that the photograph's mask leaves, and 0 at others. */
static const float *masked_pixels(const pags_view_render *p, const pags_photo *photo) {
  float *const plane = p->plane[MASKED];
  for (int64_t i = 0; photo->mask && i < (int64_t)photo->stride * photo->height; i++)
    plane[i] = photo->mask[i] ? 1.0f : 0.0f;
  return photo->mask ? plane : p->plane[ONES];
}

/* Evaluates all loss terms and writes dLoss/d(picture) to the planes. `gradient` receives the planes; those of T and
 * sum(w z) are NULL if no term has a gradient by them. */
static pags_result losses(pags_trainer *t, int64_t step, pags_step_view *v, pags_picture_gradient *gradient) {
  pags_view_render *p = &t->render;
  const pags_train_config *c = &t->state.schedule.config;
  int late = step >= t->state.schedule.object_term_from && p->part_count > 1 && v->photo.labels && !t->measuring;
  if (late && c->losses.object_weight > 0.0 && v->number % OBJECTS_EVERY == 0)
    PAGS_TRY(object_term(t, step, v));
  pags_tasks_mark(t->tasks, NULL, "loss");

  /* The photometric loss, with exposure and emphasis. */
  pags_comparison how = {
      .ssim_weight = t->state.schedule.config.losses.ssim_weight, .exposure = {1.0, 1.0, 1.0}, .times = 1.0};
  if (t->state.exposures.count > 0)
    pags_exposures_value(&t->state.exposures, t->dataset, v->view, how.exposure);
  *gradient = (pags_picture_gradient){.rgb = {p->plane[0], p->plane[1], p->plane[2]},
                                      .counted = adds_squares(t, step) ? masked_pixels(p, &v->photo) : NULL};
  int sky = t->state.sky.sky.size > 0 && v->photo.labels && c->losses.sky_weight > 0.0;
  int depth = v->picture.depth_sum && p->depth[v->view].count > 0;
  if (sky || depth)
    gradient->transmittance = p->plane[GRADIENT_T];
  if (depth)
    gradient->depth_sum = p->plane[GRADIENT_DEPTH];
  PAGS_TRY(prepare(t, v, gradient, &how));
  PAGS_TRY(compare(t, v, &how));

  pags_stage_time clock = pags_stage_now();
  if (sky) {
    PAGS_TRY(pags_driving_loss_sky(t->tasks, &v->picture, &v->photo, c->losses.sky_weight, p->plane[GRADIENT_T],
                                   &v->result.terms.sky));
    pags_stage_lap(&clock, &t->ms.of[PAGS_DECISION_SKY]);
  }
  if (depth)
    PAGS_TRY(pags_driving_loss_depth(t->tasks, &v->picture, &v->photo, p->depth[v->view].samples,
                                     p->depth[v->view].count, v->level, c->losses.depth_weight, c->losses.depth_share,
                                     p->plane[GRADIENT_DEPTH], p->plane[GRADIENT_T], &v->result.terms.depth));
  if (t->state.sky.sky.size > 0 && !t->state.sky.fixed && !t->measuring)
    PAGS_TRY(pags_sky_fit_receive(&t->state.sky, &t->state.schedule, step, gradient));
  return PAGS_OK;
}

/* ---- A round: one photograph per rank ---- */

/* Adds up the gradients of the clusters of a part by a rigid motion of the world. */
static void add_by_world(const double (*pose)[6], int64_t clusters, const double world_from_model[12],
                         pags_exact_sum *by_world) {
  for (int64_t c = 0; c < clusters; c++) {
    double moved[6] = {0.0};
    bool any = false;
    for (int k = 0; k < 6; k++)
      any |= pose[c][k] != 0.0;
    if (!any)
      continue;
    pags_pose_gradient_by_world(world_from_model, pose[c], moved);
    pags_exact_sum_add(by_world, moved);
  }
}

/* Keeps the gradients by exposure and poses until the step's end. The pose of a keyframe is summed over
 * clusters in their order; all clusters of an object are those of one rank. */
static void keep_rest(pags_trainer *t, const pags_step_view *v) {
  pags_step_rest *r = &t->rest;
  struct pags_photograph_rest *const photograph = &r->photographs[r->count++];
  *photograph = (struct pags_photograph_rest){.view = v->view, .by_light = v->result.by_light};
  memcpy(photograph->by_exposure, v->result.loss.by_exposure, sizeof photograph->by_exposure);
  for (int i = 0; i < t->render.part_count; i++) {
    const int64_t model = t->render.drawn[i].model, keyframe = t->render.drawn[i].keyframe;
    const pags_train_model *m = &t->state.models[model];
    const double(*const pose)[6] = (const double(*)[6])t->render.models[model].pose;
    if (t->state.cameras.count > 0) {
      pags_stage_time clock = pags_stage_now();
      add_by_world(pose, m->clusters.count, t->render.parts[i].world_from_model, &photograph->by_world);
      pags_stage_lap(&clock, &t->ms.of[PAGS_DECISION_POSES]);
    }
    const bool own = m->gaussians.count > 0 || (m->total == 0 && t->shared.rank == 0);
    if (!own || m->object < 0 || keyframe < 0)
      continue;
    struct pags_pose_rest *const rest = &r->poses[r->pose_count++];
    *rest = (struct pags_pose_rest){.object = m->object, .keyframe = keyframe};
    for (int64_t c = 0; c < m->clusters.count; c++)
      for (int k = 0; k < 6; k++)
        rest->by_pose[k] += pose[c][k];
  }
}

/* Composes the view's parts and makes room for what a step keeps of them. */
static pags_result compose(pags_trainer *t, pags_step_view *v) {
  t->render.photograph = v->number;
  v->camera = pags_view_render_camera(t, v->view, v->level);
  pags_view_render_compose(t, v->view);
  for (int i = 0; t->state.schedule.batch > 1 && i < t->render.part_count; i++)
    PAGS_TRY(
        reserve_store(&t->state.models[t->render.drawn[i].model], &t->render.models[t->render.drawn[i].model].sum));
  return pags_view_render_reserve_factors(t);
}

/* Projects this rank's Gaussians for each view of the round. */
static pags_result project_views(pags_trainer *t, int64_t step, pags_step_view *views, int count) {
  pags_render_context context = {t, step, 0};
  for (int i = 0; i < count; i++) {
    PAGS_TRY(compose(t, views + i));
    PAGS_TRY(pags_view_render_prepare(t, step));
    pags_frame_options options = pags_view_render_options(t, step);
    options.keep_for_backward = 1;
    options.squared = adds_squares(t, step);
    PAGS_TRY(pags_shared_views_project(&t->shared, i, t->render.frame, t->render.parts, t->render.part_count,
                                       &views[i].camera, &options, pags_view_render_touch, &context));
  }
  return PAGS_OK;
}

/* Draws this rank's view and evaluates the losses. *gradient: by the picture. With several ranks, sums up the gradients
 * of each splat and keeps those of the sky. */
static pags_result draw_view(pags_trainer *t, int64_t step, pags_step_view *v, pags_picture_gradient *gradient) {
  pags_stage_time clock = pags_stage_now();
  pags_tasks_mark(t->tasks, NULL, "photograph");
  PAGS_TRY(pags_photo_cache_get(t->cache, v->view, v->level, &v->photo));
  pags_view_samples *const samples = &t->render.depth[v->view];
  if (t->state.schedule.config.losses.depth_weight > 0.0 && !samples->loaded) {
    samples->loaded = true;
    PAGS_TRY(pags_lidar_depth_samples(t->dataset, v->view, MOST_SAMPLES, &samples->count, &samples->samples));
  }
  pags_stage_lap(&clock, &t->ms.wait);
  pags_tasks_mark(t->tasks, NULL, "compose");
  PAGS_TRY(compose(t, v));
  pags_frame_options options = pags_view_render_options(t, step);
  options.keep_for_backward = 1;
  options.squared = adds_squares(t, step);
  options.depth_sum = samples->count > 0;
  if (shares(t))
    PAGS_TRY(
        pags_shared_views_draw(&t->shared, t->render.frame, false, alpha_min(t), &v->camera, &options, &v->picture));
  else
    PAGS_TRY(pags_view_render_draw(t, step, &v->camera, &options, &v->picture));
  pags_stage_lap(&clock, &t->ms.forward);
  PAGS_TRY(reserve_planes(t, &v->picture));
  pags_tasks_mark(t->tasks, NULL, "loss");
  PAGS_TRY(losses(t, step, v, gradient));
  pags_stage_lap(&clock, &t->ms.loss);
  if (!shares(t))
    return PAGS_OK;
  PAGS_TRY(pags_sky_parts_catch(&t->sky_parts, &t->state.sky, gradient));
  return pags_shared_views_sums(&t->shared, t->render.frame, false, gradient);
}

/* Collective, with several ranks: shares the losses of a round and returns the sums of splats to their owners.
 * objects[i]: the object opacity term was evaluated for view i. */
static pags_result return_sums(pags_trainer *t, int64_t step, pags_step_view *views, int count, uint8_t *objects) {
  PAGS_TRY(pags_shared_step_results(t, views, count));
  int any = 0;
  for (int i = 0; i < count; i++)
    any |= objects[i] = views[i].result.objects_drawn;
  if (any)
    PAGS_TRY(pags_shared_views_return_sums(&t->shared, true, objects));
  PAGS_TRY(pags_shared_views_return_sums(&t->shared, false, NULL));
  return t->measuring ? PAGS_OK
                      : pags_sky_parts_add(&t->sky_parts, t->shared.transport, &t->state.sky, &t->state.schedule, step);
}

/* With several ranks, evaluates the colours over time of the composed parts again: the backward pass reads them, and
 * other views of the round have been projected since. */
static void recall_colours(pags_trainer *t) {
  pags_view_render *const p = &t->render;
  for (int i = 0; i < p->part_count; i++) {
    const pags_train_model *const m = &t->state.models[p->drawn[i].model];
    const pags_model_room *const room = &p->models[p->drawn[i].model];
    if (!m->gaussians.fourier)
      continue;
    p->parts[i].sh = room->sh;
    if (m->gaussians.fourier_degree > 0)
      pags_fourier_colour(&m->gaussians, room->basis, 0, m->gaussians.count, room->sh);
  }
}

/* Takes the gradients of view `i` of the round to the parameters of this rank's Gaussians. A process without other
 * ranks has the view's parts and its object term in place; with several ranks they come back as sums. */
static pags_result view_backward(pags_trainer *t, int64_t step, int i, pags_step_view *v,
                                 const pags_picture_gradient *gradient, const uint8_t *objects) {
  pags_render_context context = {t, step, 0};
  if (shares(t)) {
    PAGS_TRY(compose(t, v));
    recall_colours(t);
  }

  /* Set the pose gradients of the drawn parts to zero. */
  for (int k = 0; k < t->render.part_count; k++) {
    const int64_t model = t->render.drawn[k].model, clusters = t->state.models[model].clusters.count;
    if ((t->state.models[model].object >= 0 || t->state.cameras.count > 0) && clusters > 0)
      memset(t->render.models[model].pose, 0, (size_t)clusters * sizeof *t->render.models[model].pose);
  }
  if (objects[i]) {
    PAGS_TRY(reserve_held(t));
    PAGS_TRY(pags_shared_views_backward(&t->shared, i, true, objects, hold, &context));
  }
  if (shares(t))
    PAGS_TRY(pags_shared_views_backward(&t->shared, i, false, NULL, receive, &context));
  else
    PAGS_TRY(pags_frame_backward(t->render.frame, gradient, receive, &context, NULL));
  if (!t->measuring)
    keep_rest(t, v);
  return PAGS_OK;
}

pags_result pags_train_round(pags_trainer *t, int64_t step, pags_step_view *views, int count) {
  pags_shared_views *const shared = &t->shared;
  uint8_t objects[PAGS_RANKS_MOST] = {0};
  pags_picture_gradient gradient;
  pags_stage_time clock = pags_stage_now();
  pags_step_rest *const rest = &t->rest;
  const size_t batch = (size_t)t->state.schedule.batch;
  if (!rest->photographs)
    rest->photographs = calloc(batch, sizeof *rest->photographs);
  if (!rest->poses)
    rest->poses = calloc(batch * (size_t)t->state.model_count, sizeof *rest->poses);
  pags_result mine =
      rest->photographs && rest->poses ? PAGS_OK : pags_out_of_memory("a step of %zu photographs", batch);
  if (shares(t)) {
    pags_shared_views_begin(shared, count);
    if (mine == PAGS_OK)
      mine = project_views(t, step, views, count);
    PAGS_TRY(pags_shared_views_send(shared, mine));
    pags_stage_lap(&clock, &t->ms.forward);
    pags_sky_parts_begin(&t->sky_parts);
  }
  if (mine == PAGS_OK && shared->rank < count)
    mine = draw_view(t, step, views + shared->rank, &gradient);
  PAGS_TRY(pags_transport_agree(shared->transport, mine));
  clock = pags_stage_now();
  if (shares(t))
    PAGS_TRY(return_sums(t, step, views, count, objects));
  for (int i = 0; mine == PAGS_OK && i < count; i++)
    mine = view_backward(t, step, i, views + i, &gradient, objects);
  PAGS_TRY(pags_transport_agree(shared->transport, mine));
  if (shares(t) && !t->measuring)
    pags_shared_views_count(shared, &t->traffic);
  t->ms.of[PAGS_DECISION_SKY].wall += pags_frame_stats_get(t->render.frame)->ms_sky_backward;
  pags_stage_lap(&clock, &t->ms.backward);
  return PAGS_OK;
}

/* ---- The end of a step ---- */

typedef struct finish_job {
  pags_trainer *trainer;
  int64_t model, step;
} finish_job;

/* Block function: updates the clusters [begin, end) that one of the step's photographs shows by the mean of their
 * gradients. */
static void finish_blocks(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const finish_job *const job = context;
  pags_train_model *const m = &job->trainer->state.models[job->model];
  const pags_gradient_store *const sum = &job->trainer->render.models[job->model].sum;
  const int planes = pags_plane_count(pags_schedule_sh_degree(&m->schedule, job->step));
  const int all = pags_gradient_planes(&m->gaussians, planes);
  const float share = 1.0f / (float)m->schedule.batch;
  for (int64_t c = begin; c < end; c++) {
    float *const data = pags_gradient_store_find(sum, c, job->step);
    if (!data)
      continue;
    const int rows = pags_cluster_rows(m->gaussians.count, m->clusters.size, c), stride = (rows + 15) / 16 * 16;
    for (int64_t i = 0; i < (int64_t)all * stride; i++)
      data[i] *= share;
    if (m->schedule.config.density.strategy == PAGS_STRATEGY_MCMC)
      pags_mcmc_regularise(m, c * m->clusters.size, rows, data, stride);
    pags_model_update(m, &job->trainer->state.nonfinite, c, data, stride, planes);
  }
}

/* Notes that the update of a pose or of an exposure was left out. */
static void note(pags_trainer *t, int64_t step, int64_t object, int64_t row, pags_nonfinite_kind kind) {
  pags_nonfinite_note(&t->state.nonfinite, 1, &(pags_nonfinite_row){step, object, row, 0, (int32_t)kind});
}

pags_result pags_train_finish(pags_trainer *t, int64_t step) {
  pags_train_state *const state = &t->state;
  const pags_schedule *s = &state->schedule;
  pags_step_rest *r = &t->rest;
  pags_stage_time clock = pags_stage_now();
  pags_tasks_mark(t->tasks, NULL, "finish");
  for (int64_t i = 0; s->batch > 1 && i < state->model_count; i++)
    if (t->render.models[i].sum.rows)
      PAGS_TRY(pags_parallel_run(t->tasks, state->models[i].clusters.count, FINISH_GRAIN, finish_blocks,
                                 &(finish_job){t, i, step}));
  if (shares(t))
    PAGS_TRY(pags_shared_step_rest(t));
  pags_stage_time part = pags_stage_now();
  if (s->batch > 1 && state->sky.sky.size > 0 && !state->sky.fixed)
    PAGS_TRY(pags_sky_fit_finish(&state->sky, s, step, t->tasks));
  if (shares(t))
    PAGS_TRY(pags_sky_parts_spread(&t->sky_parts, t->shared.transport, &state->sky));
  pags_stage_lap(&part, &t->ms.of[PAGS_DECISION_SKY]);
  for (int64_t i = 0; s->config.objects.tracks && step > s->tracks_from && i < r->pose_count; i++)
    if (!pags_track_poses_update(&state->tracks, r->poses[i].object, r->poses[i].keyframe, r->poses[i].by_pose, s,
                                 step))
      note(t, step, r->poses[i].object, r->poses[i].keyframe, PAGS_NONFINITE_POSE);
  const bool corrects = step > pags_holdout_test_from(s);
  for (int64_t i = 0; i < r->count; i++) {
    const int64_t view = r->photographs[i].view;
    double by_world[6];
    pags_exact_sum_value(&r->photographs[i].by_world, by_world);
    part = pags_stage_now();
    if (state->exposures.count > 0 &&
        !pags_exposures_update(&state->exposures, t->dataset, view, r->photographs[i].by_exposure, s, step))
      note(t, step, -1, view, PAGS_NONFINITE_EXPOSURE);
    pags_stage_lap(&part, &t->ms.of[PAGS_DECISION_EXPOSURE]);
    if (corrects && state->cameras.count > 0 &&
        !pags_camera_poses_update(&state->cameras, t->dataset, view, by_world, s, step))
      note(t, step, -1, view, PAGS_NONFINITE_CAMERA);
    pags_stage_lap(&part, &t->ms.of[PAGS_DECISION_POSES]);
    if (corrects && state->photometry.count > 0 &&
        !pags_photometry_update(&state->photometry, pags_dataset_view(t->dataset, view)->sensor,
                                &r->photographs[i].by_light, s, step))
      note(t, step, -1, view, PAGS_NONFINITE_EXPOSURE);
    pags_stage_lap(&part, &t->ms.of[PAGS_DECISION_LIGHT]);
  }
  t->done[PAGS_DECISION_SKY] += state->sky.sky.size > 0;
  t->done[PAGS_DECISION_EXPOSURE] += state->exposures.count > 0;
  t->done[PAGS_DECISION_POSES] += state->cameras.count > 0;
  t->done[PAGS_DECISION_LIGHT] += state->photometry.count > 0;
  r->count = r->pose_count = 0;
  pags_stage_lap(&clock, &t->ms.backward);
  return PAGS_OK;
}
