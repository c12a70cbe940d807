/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of all objects in parallel: each worker takes the next object and draws it with its own frame.
 * Before, rough shapes are made of the best-seen vehicles, as shape priors for what no camera saw of the others. */
#include "exporters/proxy/object_proxy.h"

#include <stdatomic.h>
#include <stdlib.h>

#include "base/parallel.h"
#include "exporters/proxy/proxy_error.h"
#include "frame/owners.h"

enum { MOST_PRIORS = 24 }; /* most vehicles that shape priors are made of */

/* The state of the parallel loop over objects. */
typedef struct making {
  pags_progress_fn *tell;
  void *user;
  bool measure;
  atomic_llong done;
  const pags_proxy_maker *maker;
  pags_frame **frames; /* one for each worker, made when first needed */
  pags_built_object *objects;
  pags_shape_prior priors[MOST_PRIORS]; /* before they are made, only their member `object` is set */
  int64_t prior_count;
} making;

static void forget_making(making *m) {
  for (int i = 0; m->frames && i < pags_tasks_workers(m->maker->tasks); i++)
    pags_frame_destroy_auto(&m->frames[i]);
  free(m->frames);
  for (int64_t i = 0; i < m->prior_count; i++)
    pags_shape_prior_destroy(&m->priors[i]);
}

/* The maker for one worker. */
static pags_result equip(making *m, int worker, pags_proxy_maker *out) {
  *out = *m->maker;
  if (!m->frames[worker])
    PAGS_TRY(pags_frame_create(out->tasks, &m->frames[worker]));
  out->frame = m->frames[worker];
  out->priors = m->priors;
  out->prior_count = m->prior_count;
  return PAGS_OK;
}

static pags_result make_level(const pags_proxy_maker *w, int64_t object, const pags_object_shape *shape,
                              pags_proxy_level level, bool measure, pags_built_level *out) {
  const pags_scene_object *o = &w->scene->objects[object];
  pags_proxy_facts *facts = &out->facts;
  pags_proxy_mesh_topology topology;
  *facts = (pags_proxy_facts){.level = level,
                              .object = object,
                              .critical = o->critical,
                              .moving = o->record.moving,
                              .gaussians = shape->gaussians.count,
                              .s_sem = shape->s_sem};
  PAGS_TRY(pags_object_proxy_make(w, object, shape, out));
  PAGS_TRY(pags_proxy_mesh_inspect(&out->mesh, &topology));
  facts->vertices = out->mesh.vertex_count;
  facts->triangles = out->mesh.triangle_count;
  facts->closed = topology.closed;
  facts->volume = topology.closed ? topology.volume : 0;
  if (measure)
    PAGS_TRY(pags_proxy_compare(&out->mesh, &shape->depth_views, w->tasks, facts));
  if (w->options->texture && facts->level < PAGS_PROXY_HULL)
    PAGS_TRY(pags_texture_bake(&out->mesh, &shape->depth_views, 4 * shape->voxel,
                               pags_texture_limit(w->options->texture), w->tasks, &out->texture));
  if (facts->level == PAGS_PROXY_BOX) /* a box comes from the label, not from what cameras saw */
    facts->observed = 0;
  return PAGS_OK;
}

/* Fuses an object's surface once, then makes each level asked for of it, finest first. */
static pags_result make_levels(const pags_proxy_maker *w, int64_t object, bool measure, pags_built_object *out) {
  const pags_proxy_options *options = w->options;
  PAGS_AUTO(pags_object_shape_destroy) pags_object_shape shape = {0};
  PAGS_TRY(pags_object_shape_make(w, object, &shape));
  if (options->lod) {
    for (int level = 0; level <= PAGS_PROXY_BOX; level++)
      PAGS_TRY(make_level(w, object, &shape, (pags_proxy_level)level, measure, &out->levels[out->level_count++]));
    return PAGS_OK;
  }
  if (options->naming != PAGS_NAMING_PLAIN && options->level >= PAGS_PROXY_HULL &&
      !options->collision) /* the visible mesh, too */
    PAGS_TRY(make_level(w, object, &shape, PAGS_PROXY_MESH, measure, &out->levels[out->level_count++]));
  return make_level(w, object, &shape, options->level, measure, &out->levels[out->level_count++]);
}

static pags_result make_object(void *context, int64_t object, int worker) {
  making *m = context;
  const uint8_t *chosen = m->maker->options->chosen;
  if (!chosen || chosen[object]) {
    pags_proxy_maker own;
    PAGS_TRY(equip(m, worker, &own));
    PAGS_TRY(make_levels(&own, object, m->measure, &m->objects[object]));
  }
  const double done = (double)(atomic_fetch_add(&m->done, 1) + 1) / (double)m->maker->scene->object_count;
  return worker ? PAGS_OK : pags_proxy_tell(m->tell, m->user, done, "objects");
}

static pags_result make_prior(void *context, int64_t i, int worker) {
  making *m = context;
  const int64_t object = m->priors[i].object;
  pags_proxy_maker own;
  pags_result result = equip(m, worker, &own);
  if (result == PAGS_OK)
    result = pags_object_prior_make(&own, object, &m->priors[i]);
  return result == PAGS_OK ? PAGS_OK
                           : pags_fail(result, "the shape prior of object %s can't be made",
                                       m->maker->scene->objects[object].record.id);
}

/* Makes priors of the vehicles that may fill most pixels of the training views; of equals the first. */
static pags_result find_priors(making *m) {
  const pags_scene *scene = m->maker->scene;
  PAGS_AUTOFREE double *pixels = calloc((size_t)scene->object_count + 1, sizeof *pixels);
  PAGS_CHECK_MEMORY(pixels, "%lld objects", (long long)scene->object_count);
  for (int64_t i = 0; i < scene->object_count; i++)
    if (scene->objects[i].record.category == PAGS_CATEGORY_VEHICLE)
      pixels[i] = pags_object_pixels(m->maker, i);
  for (; m->prior_count < MOST_PRIORS; m->prior_count++) {
    int64_t best = 0;
    for (int64_t i = 1; i < scene->object_count; i++)
      best = pixels[i] > pixels[best] ? i : best;
    if (!(pixels[best] > 0))
      break;
    pixels[best] = 0;
    m->priors[m->prior_count].object = best;
  }
  return pags_parallel_try(m->maker->tasks, m->prior_count, make_prior, m, "interrupted");
}

pags_result pags_objects_make(const pags_proxy_maker *maker, bool measure, pags_progress_fn *tell, void *user,
                              pags_built_object **out) {
  const int64_t count = maker->scene->object_count;
  *out = calloc((size_t)count + 1, sizeof **out);
  PAGS_AUTO(forget_making)
  making m = {.tell = tell,
              .user = user,
              .measure = measure,
              .maker = maker,
              .frames = calloc((size_t)pags_tasks_workers(maker->tasks), sizeof *m.frames),
              .objects = *out};
  PAGS_CHECK_MEMORY(m.objects && m.frames, "%lld objects", (long long)count);
  if (count && (maker->options->level != PAGS_PROXY_BOX || maker->options->naming != PAGS_NAMING_PLAIN))
    PAGS_TRY(find_priors(&m));
  return pags_parallel_try(maker->tasks, count, make_object, &m, "interrupted");
}

void pags_objects_destroy(pags_built_object *objects, int64_t count) {
  for (int64_t i = 0; objects && i < count; i++)
    for (int l = 0; l < PAGS_PROXY_LEVELS; l++) {
      pags_proxy_mesh_destroy(&objects[i].levels[l].mesh);
      pags_texture_destroy(&objects[i].levels[l].texture);
    }
  free(objects);
}
