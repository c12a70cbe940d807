/* SPDX-License-Identifier: Apache-2.0 */
/* Merges the scenes of a recording's blocks into one (pags/blocks.h). The scene's models are, first, the background's
 * Gaussians by the degree of their spherical harmonics, then the objects'. Memory holds the merged
 * Gaussians and the scene of one block at a time. */
#include <pags/blocks.h>

#include <math.h>

#include "base/file.h"
#include "base/lock.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "blocks/cells.h"
#include "maths/maths.h"
#include "scene/scene_json.h"

enum { DEGREES = 4, ROWS = 4096 };

/* An object of the merged scene. */
typedef struct merged_object {
  int owner;     /* the block that its model and its track are taken from */
  double seen;   /* how much of it that block's photographs show, square pixels */
  bool modelled; /* that block has a model of it */
  int cell;      /* of a parked object: the block in whose cell its box is; else -1 */
} merged_object;

typedef struct merger {
  pags_blocks split;
  pags_trained trained;
  pags_cells cells;
  pags_scene out;
  merged_object *objects;         /* by number in `out` */
  int32_t **numbers;              /* of each block: the number in `out` of each of its objects */
  pags_gaussians groups[DEGREES]; /* the background's Gaussians, by degree */
  pags_tasks *tasks;
  pags_merge_facts *facts;
} merger;

static void destroy(merger *m) {
  for (int b = 0; m->numbers && b < m->split.count; b++)
    free(m->numbers[b]);
  for (int d = 0; d < DEGREES; d++)
    pags_gaussians_destroy(&m->groups[d]);
  free(m->numbers);
  free(m->objects);
  pags_scene_destroy(&m->out);
  pags_cells_destroy(&m->cells);
  pags_trained_destroy(&m->trained);
  pags_blocks_destroy(&m->split);
}

/* ---- Objects and views ---- */

/* Returns how much of an object the training photographs of a block show: the sum of (focal length x size / depth)^2,
 * square pixels, over the photographs that contain the middle of its box. Occlusion is ignored. */
static double how_seen(const pags_scene *head, const pags_object *object) {
  const double size = fmax(object->size[0], fmax(object->size[1], object->size[2]));
  double sum = 0;
  for (int64_t i = 0; i < head->view_count; i++) {
    const pags_scene_view *view = &head->views[i];
    const pags_keyframe *keyframe = view->test ? NULL : pags_object_keyframe(object, view->frame);
    double inverse[12], at[3];
    if (!keyframe)
      continue;
    const double *p = keyframe->world_from_object;
    pags_rigid_inverse(view->camera.world_from_camera, inverse);
    pags_rigid_point(inverse, (const double[3]){p[3], p[7], p[11]}, at);
    if (pags_camera_bends(&view->camera)) {
      const double away = pags_dot3(at, at);
      double pixel[2];
      if (away > 0.01 && pags_camera_project(&view->camera, at, pixel, NULL) && pixel[0] >= 0 &&
          pixel[0] < view->camera.width && pixel[1] >= 0 && pixel[1] < view->camera.height)
        sum += view->camera.fx * view->camera.fy * size * size / away;
      continue;
    }
    const double x = view->camera.fx * at[0] / at[2] + view->camera.cx;
    const double y = view->camera.fy * at[1] / at[2] + view->camera.cy;
    if (at[2] > 0.1 && x >= 0 && x < view->camera.width && y >= 0 && y < view->camera.height)
      sum += view->camera.fx * view->camera.fy * size * size / (at[2] * at[2]);
  }
  return sum;
}

/* Lists every object once, with its track as the block has it that sees most of it: of those with a model, if one
 * has. */
static pags_result list_objects(merger *m) {
  int64_t room = 0;
  for (int b = 0; b < m->split.count; b++)
    room += m->trained.heads[b].object_count;
  m->out.objects = calloc((size_t)room + 1, sizeof *m->out.objects);
  m->objects = calloc((size_t)room + 1, sizeof *m->objects);
  m->numbers = calloc((size_t)m->trained.count + 1, sizeof *m->numbers);
  PAGS_CHECK_MEMORY(m->out.objects && m->objects && m->numbers, "%lld objects", (long long)room);
  for (int b = 0; b < m->split.count; b++) {
    pags_scene *head = &m->trained.heads[b];
    m->numbers[b] = calloc((size_t)head->object_count + 1, sizeof *m->numbers[b]);
    PAGS_CHECK_MEMORY(m->numbers[b], "%lld objects", (long long)head->object_count);
    for (int64_t i = 0; i < head->object_count; i++) {
      const pags_scene_object *const found = pags_scene_find_object(&m->out, head->objects[i].record.id);
      const int64_t j = found ? found - m->out.objects : m->out.object_count++;
      const bool modelled = head->objects[i].model >= 0;
      merged_object *object = &m->objects[j];
      const double seen = how_seen(head, &head->objects[i].record);
      m->numbers[b][i] = (int32_t)j;
      if (found && (object->modelled > modelled || (object->modelled == modelled && object->seen >= seen)))
        continue;
      *object = (merged_object){.owner = b, .seen = seen, .modelled = modelled, .cell = -1};
      const pags_scene_object keep = m->out.objects[j]; /* the records change places, so that each has one owner */
      m->out.objects[j] = head->objects[i];
      m->out.objects[j].model = -1;
      head->objects[i].record = keep.record;
    }
  }

  /* Find the cell of every parked object: that of the mean of its labels. */
  for (int64_t j = 0; j < m->out.object_count; j++) {
    const pags_object *object = &m->out.objects[j].record;
    double middle[3] = {0, 0, 0};
    for (int64_t k = 0; k < object->keyframe_count; k++)
      for (int a = 0; a < 3; a++)
        middle[a] += object->keyframes[k].world_from_object[4 * a + 3] / (double)object->keyframe_count;
    if (!object->moving && object->keyframe_count > 0)
      m->objects[j].cell = pags_cells_find(&m->cells, middle);
  }
  return PAGS_OK;
}

/* Lists the views, each as the block has it whose own it is. */
static pags_result list_views(merger *m) {
  int64_t room = 0;
  for (int b = 0; b < m->split.count; b++)
    room += m->trained.heads[b].view_count;
  m->out.views = calloc((size_t)room + 1, sizeof *m->out.views);
  PAGS_CHECK_MEMORY(m->out.views, "%lld views", (long long)room);
  for (int b = 0; b < m->split.count; b++) {
    const struct pags_block_range *range = &m->split.ranges[b];
    pags_scene *head = &m->trained.heads[b];
    for (int64_t i = 0; i < head->view_count; i++) {
      pags_scene_view *view = &head->views[i];
      if (view->frame < range->own_first || view->frame > range->own_last)
        continue;
      m->out.views[m->out.view_count++] = *view;
      view->name = NULL;
    }
  }
  return PAGS_OK;
}

/* Takes what all blocks have in common from the first, and finds the origin: theirs if they have the same, else the
 * mean of theirs in whole metres. */
static pags_result describe(merger *m) {
  const pags_scene *first = &m->trained.heads[0];
  m->out = (pags_scene){.up = first->up,
                        .antialiased = first->antialiased,
                        .seed = first->seed,
                        .iterations = first->iterations,
                        .fps = first->fps,
                        .place = first->place,
                        .image_alpha = first->image_alpha,
                        .time_begin = first->time_begin,
                        .time_end = first->time_end,
                        .dataset = pags_text_copy(m->split.recording),
                        .config = pags_text_copy(first->config)};
  pags_scene *out = &m->out;
  pags_copy3f(first->background, out->background);
  PAGS_CHECK_MEMORY(out->dataset && out->config, "a scene");
  bool same = true;
  double sum[3] = {0, 0, 0};
  for (int b = 0; b < m->split.count; b++) {
    const pags_scene *head = &m->trained.heads[b];
    out->time_begin = fmin(out->time_begin, head->time_begin);
    out->time_end = fmax(out->time_end, head->time_end);
    pags_add3(sum, head->origin, sum);
    for (int k = 0; k < 3; k++)
      same &= head->origin[k] == first->origin[k];
  }
  for (int k = 0; k < 3; k++)
    out->origin[k] = same ? first->origin[k] : pags_round(sum[k] / m->split.count);
  return PAGS_OK;
}

/* ---- Gaussians ---- */

typedef struct sieve {
  const merger *m;
  const pags_gaussians *from;
  const double *origin;
  int block;
  uint8_t *kept; /* per row */
} sieve;

static void sift(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sieve *s = context;
  for (int64_t i = begin; i < end; i++) {
    const int32_t id = s->from->object_id ? s->from->object_id[i] : -1;
    const int64_t all = s->m->trained.heads[s->block].object_count;
    const int cell = id >= 0 && id < all ? s->m->objects[s->m->numbers[s->block][id]].cell : -1;
    double place[3];
    for (int k = 0; k < 3; k++)
      place[k] = (double)pags_plane(s->from, PAGS_MEAN + k)[i] + s->origin[k];
    s->kept[i] = (cell >= 0 ? cell : pags_cells_find(&s->m->cells, place)) == s->block;
  }
}

/* Appends the rows `index` of a block's Gaussians to those of the same degree, with positions relative to the merged
 * scene's origin and its numbers of objects. */
static pags_result append(merger *m, int block, const double origin[3], const pags_gaussians *from,
                          const int64_t *index, int64_t count) {
  const int64_t all = m->trained.heads[block].object_count;
  pags_gaussians *to = &m->groups[from->sh_degree];
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians rows = {0};
  if (to->stride == 0)
    PAGS_TRY(pags_gaussians_create_like(to, 0, from));
  if (to->count + count > to->stride)
    PAGS_TRY(pags_gaussians_reserve(to, to->count + count + (to->count + count) / 2));
  to->alpha_min = from->alpha_min;
  if (from->s_sem)
    PAGS_TRY(pags_gaussians_add_s_sem(to));
  if (from->object_id)
    PAGS_TRY(pags_gaussians_add_object_id(to));
  PAGS_TRY(pags_gaussians_create_like(&rows, count, from));
  pags_gaussians_gather(from, index, count, &rows);
  for (int64_t i = 0; i < count; i++) {
    const int64_t at = to->count + i;
    const int32_t id = rows.object_id ? rows.object_id[i] : -1;
    for (int p = 0; p < pags_plane_count(from->sh_degree); p++)
      pags_plane(to, p)[at] = pags_plane(&rows, p)[i];
    for (int k = 0; k < 3; k++)
      pags_plane(to, PAGS_MEAN + k)[at] = (float)((double)pags_plane(&rows, k)[i] + (origin[k] - m->out.origin[k]));
    if (to->s_sem)
      to->s_sem[at] = rows.s_sem ? rows.s_sem[i] : 0.0F;
    if (to->object_id)
      to->object_id[at] = id >= 0 && id < all ? m->numbers[block][id] : -1;
  }
  to->count += count;
  return PAGS_OK;
}

/* Keeps the Gaussians of one of a block's background models that lie in its cell. */
static pags_result take_background(merger *m, int block, const double origin[3], const pags_gaussians *from) {
  PAGS_AUTOFREE uint8_t *kept = malloc((size_t)from->count + 1);
  PAGS_AUTOFREE int64_t *index = malloc(((size_t)from->count + 1) * sizeof *index);
  int64_t count = 0;
  PAGS_CHECK_MEMORY(kept && index, "%lld Gaussians", (long long)from->count);
  if (!pags_parallel_for(m->tasks, from->count, ROWS, sift, &(sieve){m, from, origin, block, kept}))
    return pags_fail(PAGS_CANCELLED, "merging was cancelled");
  for (int64_t i = 0; i < from->count; i++)
    if (kept[i])
      index[count++] = i;
  m->facts->ghosts += from->count - count;
  return count > 0 ? append(m, block, origin, from, index, count) : PAGS_OK;
}

/* Adds a model to the merged scene; the Gaussians change their owner. */
static pags_result add_model(merger *m, const char *name, char *file, pags_gaussians *g) {
  pags_model *model = &m->out.models[m->out.model_count++];
  *model = (pags_model){.name = pags_text_copy(name), .file = file, .gaussians = *g};
  *g = (pags_gaussians){0};
  PAGS_CHECK_MEMORY(model->name && model->file, "a model");
  return PAGS_OK;
}

/* Takes a block's share: the background in its cell and the models of the objects that it owns. */
static pags_result take_block(merger *m, int block) {
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_TRY(pags_scene_load(m->trained.folders[block], &scene));
  PAGS_AUTOFREE bool *of_object = calloc((size_t)scene.model_count + 1, sizeof *of_object);
  PAGS_CHECK_MEMORY(of_object, "%lld models", (long long)scene.model_count);
  if (scene.object_count != m->trained.heads[block].object_count)
    return pags_fail_at(m->trained.folders[block], "changed while it was read");
  for (int64_t i = 0; i < scene.object_count; i++) {
    const int64_t j = m->numbers[block][i], model = scene.objects[i].model;
    if (model < 0)
      continue;
    of_object[model] = true;
    if (m->objects[j].owner != block)
      continue;
    m->out.objects[j].model = m->out.model_count;
    PAGS_TRY(add_model(m, m->out.objects[j].record.id, pags_scene_model_file(&m->out, m->out.objects[j].record.id),
                       &scene.models[model].gaussians));
    m->facts->object_models++;
  }
  for (int64_t i = 0; i < scene.model_count; i++)
    if (!of_object[i])
      PAGS_TRY(take_background(m, block, scene.origin, &scene.models[i].gaussians));
  if (m->out.sky.size == 0) {
    m->out.sky = scene.sky;
    scene.sky = (pags_sky){0};
  }
  return PAGS_OK;
}

/* ---- The whole ---- */

/* Puts the background's Gaussians, highest degree first, before the models of objects. */
static pags_result add_background(merger *m) {
  int groups = 0;
  for (int d = DEGREES - 1; d >= 0; d--)
    groups += m->groups[d].count > 0;
  groups = groups > 0 ? groups : 1;
  pags_scene *out = &m->out;
  const int64_t objects = out->model_count;
  pags_model *models = calloc((size_t)(objects + groups), sizeof *models);
  PAGS_CHECK_MEMORY(models, "%lld models", (long long)(objects + groups));
  memcpy(models + groups, out->models, (size_t)objects * sizeof *models);
  free(out->models);
  out->models = models;
  out->model_count = 0;
  pags_result result = PAGS_OK;
  for (int d = DEGREES - 1; d >= 0 && result == PAGS_OK; d--) {
    if (m->groups[d].count == 0 && !(d == 0 && out->model_count == 0))
      continue;
    PAGS_AUTOFREE char *name =
        out->model_count == 0 ? pags_text_copy("background") : pags_text_format("background-sh%d", d);
    result = name ? add_model(m, name, pags_text_format("%s.ply", name), &m->groups[d]) : pags_out_of_memory("a model");
  }
  out->model_count = objects + groups;
  for (int64_t j = 0; j < out->object_count; j++)
    out->objects[j].model += out->objects[j].model >= 0 ? groups : 0;
  return result;
}

static pags_result merge(merger *m, const char *folder, const char *output, pags_progress_fn *progress, void *user) {
  PAGS_TRY(pags_blocks_load(folder, &m->split));
  PAGS_TRY(pags_trained_load(&m->split, folder, &m->trained));
  PAGS_TRY(pags_cells_create(&m->split, &m->cells));
  PAGS_TRY(describe(m));
  PAGS_TRY(list_objects(m));
  PAGS_TRY(list_views(m));
  m->out.models = calloc((size_t)m->out.object_count + 1, sizeof *m->out.models);
  PAGS_CHECK_MEMORY(m->out.models, "%lld models", (long long)m->out.object_count);
  for (int b = 0; b < m->split.count; b++) {
    if (progress && !progress(user, (double)b / m->split.count, "merging blocks"))
      return pags_fail(PAGS_CANCELLED, "merging was cancelled");
    PAGS_TRY(take_block(m, b));
  }
  PAGS_TRY(add_background(m));
  m->facts->blocks = m->split.count;
  m->facts->gaussians = pags_scene_gaussian_count(&m->out);
  m->facts->objects = m->out.object_count;
  m->facts->views = m->out.view_count;
  if (progress && !progress(user, 0.0, "writing the scene"))
    return pags_fail(PAGS_CANCELLED, "merging was cancelled");
  return pags_scene_write(output, &m->out);
}

pags_result pags_merge(const char *folder, const char *output, pags_tasks *tasks, pags_progress_fn *progress,
                       void *user, pags_merge_facts *facts) {
  PAGS_AUTO(pags_lock_release_auto) pags_lock *lock = NULL;
  PAGS_AUTO(destroy) merger m = {.tasks = tasks, .facts = facts};
  *facts = (pags_merge_facts){0};
  PAGS_TRY(pags_lock_folder(output, &lock));
  if (pags_folder_has(output, "scene.json"))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: holds a scene already; give another folder, or remove it", output);
  return merge(&m, folder, output, progress, user);
}
