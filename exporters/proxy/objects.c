/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of all objects in parallel: each worker takes the next object and draws it with its own frame.
 * Before, rough shapes are made of the best-seen vehicles, as shape priors for what no camera saw of the others. */
#include "exporters/proxy/objects.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

#include "exporters/proxy/proxy_error.h"
#include "frame/owners.h"

enum { MOST_PRIORS = 24 }; /* most vehicles that shape priors are made of */

/* The state of the parallel loop over objects. */
typedef struct making {
  const pags_proxy_maker *maker;
  pags_built_object *objects;
  pags_frame **frames; /* one for each worker, made when first needed */
  pags_progress_fn *tell;
  void *user;
  bool measure;
  atomic_llong done;
  atomic_int stopped;
} making;

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
    PAGS_TRY(pags_texture_bake(&out->mesh, &shape->depth_views, 4 * shape->voxel, w->options->texture, w->tasks,
                               &out->texture));
  if (facts->level == PAGS_PROXY_BOX) /* a box comes from the label, not from what cameras saw */
    facts->observed = 0;
  return PAGS_OK;
}

/* Fuses an object's surface once, then makes each level asked for of it, finest first. */
static pags_result make_object(const pags_proxy_maker *w, int64_t object, bool measure, pags_built_object *out) {
  const pags_proxy_options *options = w->options;
  PAGS_AUTO(pags_object_shape_destroy) pags_object_shape shape = {0};
  PAGS_TRY(pags_object_shape_make(w, object, &shape));
  if (options->lod) {
    for (int level = 0; level <= PAGS_PROXY_BOX; level++)
      PAGS_TRY(make_level(w, object, &shape, (pags_proxy_level)level, measure, &out->levels[out->level_count++]));
    return PAGS_OK;
  }
  if (options->naming != PAGS_NAMING_PLAIN && options->level >= PAGS_PROXY_HULL) /* what is seen, too */
    PAGS_TRY(make_level(w, object, &shape, PAGS_PROXY_MESH, measure, &out->levels[out->level_count++]));
  return make_level(w, object, &shape, options->level, measure, &out->levels[out->level_count++]);
}

static void make_objects(void *context, int64_t begin, int64_t end, int worker) {
  making *m = context;
  const int64_t count = m->maker->scene->object_count;
  const uint8_t *chosen = m->maker->options->chosen;
  for (int64_t i = begin; i < end; i++) {
    pags_built_object *object = &m->objects[i];
    if (!atomic_load(&m->stopped) && (!chosen || chosen[i])) {
      pags_proxy_maker own = *m->maker;
      if (!m->frames[worker])
        object->result = pags_frame_create(own.tasks, &m->frames[worker]);
      own.frame = m->frames[worker];
      if (object->result == PAGS_OK)
        object->result = make_object(&own, i, m->measure, object);
      if (object->result != PAGS_OK) {
        snprintf(object->message, sizeof object->message, "%s", pags_error_message());
        atomic_store(&m->stopped, 1);
      }
    }
    long long done = atomic_fetch_add(&m->done, 1) + 1;
    if (worker == 0 && m->tell && !m->tell(m->user, (double)done / (double)count, "objects"))
      atomic_store(&m->stopped, 2);
  }
}

/* The state of the parallel loop that makes shape priors. */
typedef struct forming {
  const pags_proxy_maker *maker;
  pags_shape_prior priors[MOST_PRIORS]; /* before they are made, only their member `object` is set */
  pags_result results[MOST_PRIORS];
  int64_t count;
  pags_frame **frames;
} forming;

static void make_priors(void *context, int64_t begin, int64_t end, int worker) {
  forming *f = context;
  for (int64_t i = begin; i < end; i++) {
    pags_proxy_maker own = *f->maker;
    if (!f->frames[worker])
      f->results[i] = pags_frame_create(own.tasks, &f->frames[worker]);
    own.frame = f->frames[worker];
    if (f->results[i] == PAGS_OK)
      f->results[i] = pags_object_prior_make(&own, f->priors[i].object, &f->priors[i]);
  }
}

static pags_result find_priors(forming *f) {
  /* Choose the vehicles that may fill most pixels of the training views; of equals the first. */
  const pags_scene *scene = f->maker->scene;
  PAGS_AUTOFREE double *pixels = calloc((size_t)scene->object_count + 1, sizeof *pixels);
  PAGS_CHECK_MEMORY(pixels, "%lld objects", (long long)scene->object_count);
  for (int64_t i = 0; i < scene->object_count; i++)
    if (scene->objects[i].record.category == PAGS_CATEGORY_VEHICLE)
      pixels[i] = pags_object_pixels(f->maker, i);
  for (; f->count < MOST_PRIORS; f->count++) {
    int64_t best = 0;
    for (int64_t i = 1; i < scene->object_count; i++)
      best = pixels[i] > pixels[best] ? i : best;
    if (!(pixels[best] > 0))
      break;
    pixels[best] = 0;
    f->priors[f->count].object = best;
  }
  PAGS_TRY(pags_proxy_for(f->maker->tasks, f->count, 1, make_priors, f));
  for (int64_t i = 0; i < f->count; i++)
    if (f->results[i] != PAGS_OK)
      return pags_fail(f->results[i], "the shape prior of object %s can't be made",
                       scene->objects[f->priors[i].object].record.id);
  return PAGS_OK;
}

/* Makes the objects of `m`, after the shape priors `f` where they are needed. */
static pags_result run(making *m, forming *f, pags_proxy_maker *maker) {
  const int64_t count = maker->scene->object_count;
  PAGS_CHECK_MEMORY(m->objects && m->frames, "%lld objects", (long long)count);
  if (count && (maker->options->level != PAGS_PROXY_BOX || maker->options->naming != PAGS_NAMING_PLAIN))
    PAGS_TRY(find_priors(f));
  maker->priors = f->priors;
  maker->prior_count = f->count;
  PAGS_TRY(pags_proxy_for(maker->tasks, count, 1, make_objects, m));
  if (atomic_load(&m->stopped) == 2)
    return pags_fail(PAGS_CANCELLED, "interrupted");
  for (int64_t i = 0; i < count; i++)
    if (m->objects[i].result != PAGS_OK)
      return pags_fail(m->objects[i].result, "%s", m->objects[i].message);
  return PAGS_OK;
}

pags_result pags_objects_make(const pags_proxy_maker *maker, bool measure, pags_progress_fn *tell, void *user,
                              pags_built_object **out) {
  const int64_t count = maker->scene->object_count;
  const int workers = pags_tasks_workers(maker->tasks);
  pags_proxy_maker own = *maker;
  *out = calloc((size_t)count + 1, sizeof **out);
  making m = {.maker = &own,
              .objects = *out,
              .frames = calloc((size_t)workers, sizeof *m.frames),
              .tell = tell,
              .user = user,
              .measure = measure};
  forming f = {.maker = maker, .frames = m.frames};
  const pags_result result = run(&m, &f, &own);
  for (int i = 0; m.frames && i < workers; i++)
    pags_frame_destroy_auto(&m.frames[i]);
  free(m.frames);
  for (int64_t i = 0; i < f.count; i++)
    pags_shape_prior_destroy(&f.priors[i]);
  return result;
}

void pags_objects_destroy(pags_built_object *objects, int64_t count) {
  for (int64_t i = 0; objects && i < count; i++)
    for (int l = 0; l < PAGS_PROXY_LEVELS; l++) {
      pags_proxy_mesh_destroy(&objects[i].levels[l].mesh);
      pags_texture_destroy(&objects[i].levels[l].texture);
    }
  free(objects);
}
