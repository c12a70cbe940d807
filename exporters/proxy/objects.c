/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of all objects in parallel: each worker takes the next object and draws it with its own frame.
 * Before, rough shapes are made of the best-seen vehicles, as shape priors for what no camera saw of the others. */
#include "exporters/proxy/objects.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/memory.h"
#include "exporters/proxy/proxy_error.h"

enum { MOST_PRIORS = 24 }; /* most vehicles that shape priors are made of */

/* The state of the parallel loop over objects. */
typedef struct making {
  const pags_proxy_maker *maker;
  pags_built_object *objects;
  pags_frame **frames; /* one for each worker, made when first needed */
  pags_progress_fn *tell;
  void *user;
  int measure;
  atomic_llong done;
  atomic_int stopped;
} making;

static pags_result make_level(const pags_proxy_maker *w, int64_t object, const pags_object_shape *shape,
                              pags_proxy_level level, int measure, pags_built_level *out) {
  const pags_scene_object *o = &w->scene->objects[object];
  pags_proxy_facts *facts = &out->facts;
  pags_proxy_mesh_topology topology;
  *facts = (pags_proxy_facts){.object = object,
                              .critical = o->critical,
                              .moving = o->record.moving,
                              .gaussians = shape->gaussians.count,
                              .s_sem = shape->s_sem};
  PAGS_TRY(pags_object_proxy_make(w, object, shape, level, &out->mesh, &out->parts, &facts->level, &facts->note));
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

/* The levels that are made of each object, finest first. Returns how many. */
static int levels_of(const pags_proxy_options *options, pags_proxy_level levels[PAGS_PROXY_LEVELS]) {
  int count = 0;
  if (options->lod) {
    for (; count <= PAGS_PROXY_BOX; count++)
      levels[count] = (pags_proxy_level)count;
    return count;
  }
  if (options->naming != PAGS_NAMING_PLAIN && options->level >= PAGS_PROXY_HULL)
    levels[count++] = PAGS_PROXY_MESH; /* the visible surface, in addition to the collision mesh */
  levels[count++] = options->level;
  return count;
}

static void make_objects(void *context, int64_t begin, int64_t end, int worker) {
  making *self = context;
  const pags_scene *scene = self->maker->scene;
  const uint8_t *chosen = self->maker->options->chosen;
  for (int64_t i = begin; i < end; i++) {
    pags_built_object *object = &self->objects[i];
    pags_proxy_maker own = *self->maker;
    if (!atomic_load(&self->stopped) && (!chosen || chosen[i])) {
      if (!self->frames[worker])
        object->result = pags_frame_create(own.tasks, &self->frames[worker]);
      own.frame = self->frames[worker];
      if (object->result == PAGS_OK) {
        /* Fuse the object's surface once, then make each level asked for of it. */
        pags_object_shape shape = {0};
        pags_proxy_level levels[PAGS_PROXY_LEVELS];
        const int count = levels_of(own.options, levels);
        pags_result result = pags_object_shape_make(&own, i, &shape);
        for (int level = 0; level < count && result == PAGS_OK; level++)
          result = make_level(&own, i, &shape, levels[level], self->measure, &object->levels[object->level_count++]);
        pags_object_shape_destroy(&shape);
        object->result = result;
      }
      if (object->result != PAGS_OK) {
        snprintf(object->message, sizeof object->message, "%s", pags_error_message());
        atomic_store(&self->stopped, 1);
      }
    }
    long long done = atomic_fetch_add(&self->done, 1) + 1;
    if (worker == 0 && self->tell && !self->tell(self->user, (double)done / (double)scene->object_count, "objects"))
      atomic_store(&self->stopped, 2);
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
  forming *self = context;
  for (int64_t i = begin; i < end; i++) {
    pags_proxy_maker own = *self->maker;
    if (!self->frames[worker])
      self->results[i] = pags_frame_create(own.tasks, &self->frames[worker]);
    own.frame = self->frames[worker];
    if (self->results[i] == PAGS_OK)
      self->results[i] = pags_object_prior_make(&own, self->priors[i].object, &self->priors[i]);
  }
}

static pags_result find_priors(forming *self) {
  /* Choose the vehicles that may fill most pixels of the training views; of equals the first. */
  const pags_scene *scene = self->maker->scene;
  double *pixels = calloc((size_t)scene->object_count + 1, sizeof *pixels);
  PAGS_CHECK_MEMORY(pixels, "%lld objects", (long long)scene->object_count);
  for (int64_t i = 0; i < scene->object_count; i++)
    if (scene->objects[i].record.category == PAGS_CATEGORY_VEHICLE)
      pixels[i] = pags_object_pixels(self->maker, i);
  for (; self->count < MOST_PRIORS; self->count++) {
    int64_t best = 0;
    for (int64_t i = 1; i < scene->object_count; i++)
      best = pixels[i] > pixels[best] ? i : best;
    if (!(pixels[best] > 0))
      break;
    pixels[best] = 0;
    self->priors[self->count].object = best;
  }
  free(pixels);

  if (!pags_parallel_for(self->maker->tasks, self->count, 1, make_priors, self))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  for (int64_t i = 0; i < self->count; i++)
    if (self->results[i] != PAGS_OK)
      return pags_fail(self->results[i], "the shape prior of object %s can't be made",
                       self->maker->scene->objects[self->priors[i].object].record.id);
  return PAGS_OK;
}

pags_result pags_objects_make(const pags_proxy_maker *maker, int measure, pags_progress_fn *tell, void *user,
                              pags_built_object **out) {
  int64_t count = maker->scene->object_count;
  int workers = pags_tasks_workers(maker->tasks);
  pags_proxy_maker equipped = *maker;
  making self = {.maker = &equipped, .tell = tell, .user = user, .measure = measure};
  *out = NULL;
  self.objects = calloc((size_t)count + 1, sizeof *self.objects);
  self.frames = calloc((size_t)workers, sizeof(pags_frame *));
  pags_result result = self.objects && self.frames ? PAGS_OK : pags_out_of_memory("%lld objects", (long long)count);
  forming rough = {.maker = maker, .frames = self.frames};
  if (result == PAGS_OK && count &&
      (maker->options->level != PAGS_PROXY_BOX || maker->options->naming != PAGS_NAMING_PLAIN))
    result = find_priors(&rough);
  equipped.priors = rough.priors;
  equipped.prior_count = rough.count;
  if (result == PAGS_OK &&
      (!pags_parallel_for(maker->tasks, count, 1, make_objects, &self) || atomic_load(&self.stopped) == 2))
    result = pags_fail(PAGS_CANCELLED, "interrupted");
  for (int64_t i = 0; i < count && result == PAGS_OK; i++)
    if (self.objects[i].result != PAGS_OK)
      result = pags_fail(self.objects[i].result, "%s", self.objects[i].message);
  for (int i = 0; self.frames && i < workers; i++)
    if (self.frames[i])
      pags_frame_destroy(self.frames[i]);
  free(self.frames);
  for (int64_t i = 0; i < rough.count; i++)
    pags_shape_prior_destroy(&rough.priors[i]);
  if (result == PAGS_OK)
    *out = self.objects;
  else
    pags_objects_destroy(self.objects, count);
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
