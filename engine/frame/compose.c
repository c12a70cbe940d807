/* SPDX-License-Identifier: Apache-2.0 */
/* Turns a scene into the parts of a frame: sorts the scene's Gaussians into groups that are hidden and moved together,
 * and lists the parts to draw at a given time, with objects hidden, moved, added or placed.
 *
 * Each model's rows are brought into Morton order. The background model is split by object, so that a parked car is a
 * group of its own. With P the pose of an object's labelled box and D an edit's motion, a parked object's group is
 * drawn with world_from_model = P D P^-1, and the group of an object that has its own model and follows its track,
 * with P D. Positions stay relative to the scene's origin, which is subtracted from P in double. */
#include <pags/compose.h>
#include <pags/packed.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/vec3.h"
#include "frame/owners.h"
#include "maths/maths.h"
#include "port/port.h"
#include "scene/packed_rows.h"

enum { CLUSTER_SIZE = 64, ALIGNMENT = 64 };

/* Gaussians that are hidden and moved together: the background, or one object's. */
typedef struct group {
  pags_gaussians gaussians;
  pags_clusters clusters;
  pags_packed packed; /* the rows in packed form; then `gaussians` and `clusters` are empty. Else this is empty */
  int32_t *id;        /* id per row; NULL: first_id + row */
  int32_t first_id;   /* without `id`; 0 in a packed file */
  int64_t object;     /* index of the scene's object; -1: none */
  bool tracked;       /* positions are in the object's frame and follow its track; false: they are in the world */
  float *sh;          /* SH coefficients at sh_time, as in pags_part; NULL: they don't change with time */
  double sh_time;     /* NaN: not computed yet */
  bool hidden, moved;
  double motion[12]; /* D of the move edit; set where `moved` */
} group;

/* A second instance of a group, from an edit that adds the object once more. */
typedef struct addition {
  int64_t group;
  double motion[12];
} addition;

struct pags_composition {
  pags_scene scene;
  int64_t gaussian_count, group_count, group_capacity, addition_count;
  group *groups;
  addition *additions;
  pags_part *parts;        /* of pags_compose: room for every group and addition */
  pags_part *placed_parts; /* of pags_compose_placed: placed_capacity */
  int64_t placed_capacity;
  bool borrowed; /* borrowed: the scene and the groups' Gaussians and clusters belong to another composition */
};

/* What memory is needed for, with the number of Gaussians. */
static const char preparing[] = "preparing %lld Gaussians for rendering";

/* ---- Sorting a scene's Gaussians into groups ---- */

/* Appends an empty group and returns it; NULL if out of memory. */
static group *next_group(pags_composition *c) {
  if (!pags_grow(&c->groups, c->group_count + 1, &c->group_capacity, sizeof *c->groups))
    return NULL;
  group *next = &c->groups[c->group_count++];
  *next = (group){.object = -1, .sh_time = (double)NAN};
  return next;
}

/* The bucket of a row in split_by_object: object + 1, or 0 where object_id names no object of the scene. */
static int64_t bucket_of(int32_t object_id, int64_t object_count) {
  return object_id >= 0 && object_id < object_count ? object_id + 1 : 0;
}

static int sh_planes(const group *g) {
  return 3 * pags_sh_coefficients(g->gaussians.sh_degree);
}

/* Allocates a group's colours at one time, if they change with time. */
static pags_result add_sh(const pags_composition *c, group *g) {
  const size_t bytes = (size_t)g->gaussians.stride * (size_t)sh_planes(g) * sizeof *g->sh;
  if (!g->gaussians.fourier)
    return PAGS_OK;
  g->sh = pags_port_aligned_alloc(ALIGNMENT, bytes);
  PAGS_CHECK_MEMORY(g->sh, preparing, (long long)c->gaussian_count);
  memset(g->sh, 0, bytes);
  return PAGS_OK;
}

/* Appends a group with copies of rows index[0 .. count) of `model`, in this order. Row r gets the id first_id + r. */
static pags_result add_one_group(pags_composition *c, const pags_gaussians *model, int32_t first_id,
                                 const int64_t *index, int64_t count, int64_t object, bool tracked) {
  group *added = next_group(c);
  PAGS_CHECK_MEMORY(added, preparing, (long long)c->gaussian_count);
  added->object = object;
  added->tracked = tracked;
  PAGS_TRY(pags_gaussians_create_like(&added->gaussians, count, model));
  pags_gaussians_gather(model, index, count, &added->gaussians);
  added->id = malloc((size_t)(count + 1) * sizeof *added->id);
  PAGS_CHECK_MEMORY(added->id, preparing, (long long)c->gaussian_count);
  for (int64_t i = 0; i < count; i++)
    added->id[i] = first_id + (int32_t)index[i];
  PAGS_TRY(add_sh(c, added));
  PAGS_TRY(pags_clusters_create(&added->clusters, count, CLUSTER_SIZE));
  pags_clusters_update(&added->clusters, &added->gaussians, 0, added->clusters.count);
  return PAGS_OK;
}

/* Appends one group for each object that occurs in the model's object_id, and one for the rows without an object, by a
 * stable counting sort of the rows in `order`: bucket o + 1 holds the rows of object o, bucket 0 those without one. */
static pags_result split_by_object(pags_composition *c, const pags_gaussians *model, int32_t first_id,
                                   const int64_t *order) {
  const int64_t objects = c->scene.object_count, count = model->count;
  PAGS_AUTOFREE int64_t *end = calloc((size_t)objects + 2, sizeof *end);
  PAGS_AUTOFREE int64_t *sorted = malloc((size_t)(count + 1) * sizeof *sorted);
  PAGS_CHECK_MEMORY(end && sorted, preparing, (long long)c->gaussian_count);
  for (int64_t i = 0; i < count; i++)
    ++end[bucket_of(model->object_id[i], objects) + 1];
  for (int64_t b = 1; b < objects + 2; b++)
    end[b] += end[b - 1];
  for (int64_t i = 0; i < count; i++)
    sorted[end[bucket_of(model->object_id[order[i]], objects)]++] = order[i];
  for (int64_t b = 0, first = 0; b <= objects; first = end[b++])
    if (end[b] > first)
      PAGS_TRY(add_one_group(c, model, first_id, sorted + first, end[b] - first, b - 1, false));
  return PAGS_OK;
}

/* Per model: the index of the object whose model it is, -1 for the background. NULL if out of memory. */
static int64_t *objects_of_models(const pags_scene *scene) {
  int64_t *object_of = malloc((size_t)(scene->model_count + 1) * sizeof *object_of);
  for (int64_t m = 0; object_of && m < scene->model_count; m++)
    object_of[m] = -1;
  for (int64_t o = 0; object_of && o < scene->object_count; o++)
    if (scene->objects[o].model >= 0)
      object_of[scene->objects[o].model] = o;
  return object_of;
}

enum { MOST_GAUSSIANS = INT32_MAX - 63 }; /* 2^31 - 64: counts rounded up to 64 stay within int32_t */

static pags_result too_many(int64_t count) {
  return pags_fail(PAGS_ERROR_LIMIT, "%lld Gaussians are more than the 2^31 - 64 that can be rendered at once",
                   (long long)count);
}

/* Moves the scene's Gaussians into groups in Morton order, model by model, the background's split by object, and frees
 * the models' own copies. */
static pags_result build(pags_composition *c) {
  c->gaussian_count = pags_scene_gaussian_count(&c->scene);
  if (c->gaussian_count > MOST_GAUSSIANS)
    return too_many(c->gaussian_count);
  PAGS_AUTOFREE int64_t *object_of = objects_of_models(&c->scene);
  PAGS_CHECK_MEMORY(object_of, preparing, (long long)c->gaussian_count);
  int32_t first_id = 0;
  for (int64_t m = 0; m < c->scene.model_count; m++) {
    pags_gaussians *const g = &c->scene.models[m].gaussians;
    const int64_t object = object_of[m], count = g->count;
    PAGS_AUTOFREE int64_t *order = malloc((size_t)(count + 1) * sizeof *order);
    PAGS_CHECK_MEMORY(order, preparing, (long long)c->gaussian_count);
    PAGS_TRY(pags_gaussians_morton_order(g, order));
    PAGS_TRY(object < 0 && g->object_id && c->scene.object_count
                 ? split_by_object(c, g, first_id, order)
                 : add_one_group(c, g, first_id, order, count, object, object >= 0));
    pags_gaussians_destroy(g);
    first_id += (int32_t)count;
  }
  return pags_composition_edit(c, NULL, 0);
}

/* ---- Creating and describing a composition ---- */

pags_result pags_composition_create(pags_scene *scene, pags_composition **out) {
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *c = calloc(1, sizeof *c);
  *out = NULL;
  if (!c) {
    pags_scene_destroy(scene);
    return pags_out_of_memory("a scene");
  }
  c->scene = *scene;
  *scene = (pags_scene){0};
  PAGS_TRY(build(c));
  *out = pags_take(&c);
  return PAGS_OK;
}

pags_result pags_composition_borrow(const pags_scene *scene, const pags_clusters *const *clusters,
                                    pags_composition **out) {
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *c = calloc(1, sizeof *c);
  *out = NULL;
  PAGS_CHECK_MEMORY(c, "a scene");
  c->borrowed = true;
  c->scene = *scene;
  PAGS_AUTOFREE int64_t *object_of = objects_of_models(scene);
  PAGS_CHECK_MEMORY(object_of, preparing, (long long)c->gaussian_count);
  for (int64_t m = 0; m < scene->model_count; m++) {
    group *added = next_group(c);
    PAGS_CHECK_MEMORY(added, preparing, (long long)c->gaussian_count);
    added->gaussians = scene->models[m].gaussians;
    added->clusters = *clusters[m];
    added->first_id = (int32_t)c->gaussian_count;
    added->object = object_of[m];
    added->tracked = added->object >= 0;
    c->gaussian_count += added->gaussians.count;
    PAGS_TRY(add_sh(c, added));
  }
  PAGS_TRY(pags_composition_edit(c, NULL, 0));
  *out = pags_take(&c);
  return PAGS_OK;
}

pags_result pags_composition_load(const char *path, pags_composition **out) {
  pags_scene scene;
  *out = NULL;
  if (pags_packed_is_file(path))
    return pags_composition_open_packed(path, out);
  PAGS_TRY(pags_scene_load(path, &scene));
  return pags_composition_create(&scene, out);
}

void pags_composition_destroy(pags_composition *composition) {
  if (!composition)
    return;
  for (int64_t i = 0; i < composition->group_count; i++) {
    group *const g = &composition->groups[i];
    if (!composition->borrowed) {
      pags_gaussians_destroy(&g->gaussians);
      pags_clusters_destroy(&g->clusters);
    }
    pags_packed_destroy(&g->packed);
    free(g->id);
    pags_port_aligned_free(g->sh);
  }
  free(composition->groups);
  free(composition->additions);
  free(composition->parts);
  free(composition->placed_parts);
  if (!composition->borrowed)
    pags_scene_destroy(&composition->scene);
  free(composition);
}

const pags_scene *pags_composition_scene(const pags_composition *composition) {
  return &composition->scene;
}

int64_t pags_composition_gaussian_count(const pags_composition *composition) {
  return composition->gaussian_count;
}

size_t pags_composition_bytes(const pags_composition *composition) {
  size_t bytes = 0;
  for (int64_t i = 0; i < composition->group_count; i++) {
    const group *g = &composition->groups[i];
    int planes = pags_plane_count(g->gaussians.sh_degree) + (g->gaussians.s_sem ? 1 : 0) +
                 (g->gaussians.object_id ? 1 : 0) + pags_fourier_planes(&g->gaussians) + (g->sh ? sh_planes(g) : 0);
    bytes += (size_t)g->gaussians.stride * (size_t)planes * 4 + (size_t)g->gaussians.count * 4 +
             (size_t)g->clusters.count * 28;
    bytes += pags_packed_bytes(&g->packed) + (g->id ? (size_t)g->packed.shape.count * 4 : 0);
  }
  return bytes;
}

pags_frame_options pags_composition_options(const pags_composition *composition) {
  const pags_scene *scene = &composition->scene;
  pags_frame_options options = pags_frame_options_default();
  pags_copy3(scene->origin, options.origin);
  pags_copy3f(scene->background, options.background);
  options.sky = scene->sky.size > 0 ? &scene->sky : NULL;
  options.antialiased = scene->antialiased;

  /* near_plane and low_pass as in the scene's training configuration, if they are there, since a scene must be drawn
   * with the values that it was trained with. A configuration that another program wrote is no error; the defaults
   * stay. */
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  double value;
  if (!scene->config || pags_json_parse_text("config", scene->config, strlen(scene->config), &json) != PAGS_OK)
    return options;
  const pags_json_value *root = pags_json_root(json);
  if (pags_json_number_or(json, root, "near_plane", (double)options.near_plane, &value) == PAGS_OK && value > 0)
    options.near_plane = (float)value;
  if (pags_json_number_or(json, root, "low_pass", (double)options.low_pass, &value) == PAGS_OK && value >= 0)
    options.low_pass = (float)value;
  return options;
}

/* ---- Edits, and the parts at a time ---- */

/* Whether an edit that moves or adds `object` applies to group `g`: to the object's own model if it has one, else to
 * its Gaussians in the background. */
static bool follows_edits(const pags_composition *c, const group *g, int64_t object) {
  return g->object == object && g->tracked == (c->scene.objects[object].model >= 0);
}

/* Marks the groups that the edit hides or moves, and appends the groups that it adds to `additions`. */
static void apply_edit(pags_composition *c, const pags_edit *edit) {
  const double angle = edit->yaw * (3.14159265358979323846 / 180), cosine = pags_cos(angle), sine = pags_sin(angle);
  const double motion[12] = {cosine, -sine, 0, edit->translation[0], sine, cosine, 0, edit->translation[1],
                             0,      0,     1, edit->translation[2]}; /* D = [Rz(yaw) | translation] */
  for (int64_t i = 0; i < c->group_count; i++) {
    group *g = &c->groups[i];
    if (edit->kind == PAGS_EDIT_HIDE) {
      g->hidden = g->hidden || g->object == edit->object;
    } else if (follows_edits(c, g, edit->object)) {
      if (edit->kind == PAGS_EDIT_ADD)
        c->additions[c->addition_count].group = i;
      memcpy(edit->kind == PAGS_EDIT_ADD ? c->additions[c->addition_count++].motion : g->motion, motion, sizeof motion);
      g->moved = g->moved || edit->kind == PAGS_EDIT_MOVE;
    }
  }
}

pags_result pags_composition_edit(pags_composition *composition, const pags_edit *edits, int64_t count) {
  /* All edits are checked before anything changes: if one is refused, the earlier edits stay in force. */
  for (int64_t i = 0; i < count; i++) {
    const pags_edit *e = &edits[i];
    if (e->object < 0 || e->object >= composition->scene.object_count)
      return pags_fail(PAGS_ERROR_ARGUMENT, "edit %lld: expected one of the scene's %lld objects, found number %lld",
                       (long long)i, (long long)composition->scene.object_count, (long long)e->object);
    if (!isfinite(e->translation[0] + e->translation[1] + e->translation[2] + e->yaw))
      return pags_fail(PAGS_ERROR_ARGUMENT, "edit %lld: expected finite metres and degrees", (long long)i);
  }

  /* Allocates room for the parts of all groups and additions, so that pags_compose needs no memory. */
  int64_t additions = 0;
  for (int64_t i = 0; i < count; i++)
    for (int64_t g = 0; edits[i].kind == PAGS_EDIT_ADD && g < composition->group_count; g++)
      additions += follows_edits(composition, &composition->groups[g], edits[i].object);
  PAGS_AUTOFREE addition *list = malloc((size_t)(additions + 1) * sizeof *list);
  PAGS_AUTOFREE pags_part *parts = calloc((size_t)(composition->group_count + additions) + 1, sizeof *parts);
  PAGS_CHECK_MEMORY(list && parts, preparing, (long long)composition->gaussian_count);
  free(composition->additions);
  free(composition->parts);
  composition->additions = pags_take(&list);
  composition->parts = pags_take(&parts);
  composition->addition_count = 0;

  for (int64_t i = 0; i < composition->group_count; i++)
    composition->groups[i].hidden = composition->groups[i].moved = false;
  for (int64_t i = 0; i < count; i++)
    apply_edit(composition, &edits[i]);
  return PAGS_OK;
}

/* The pose of a parked object at a time that its labels don't cover: that of the label nearest in time. */
static void nearest_pose(const pags_object *object, double time, double out[12]) {
  double best = object->keyframes[0].time;
  for (int64_t i = 1; i < object->keyframe_count; i++)
    if (fabs(object->keyframes[i].time - time) < fabs(best - time))
      best = object->keyframes[i].time;
  if (!pags_object_pose(object, best, out))
    memcpy(out, object->keyframes[0].world_from_object, 12 * sizeof *out);
}

/* Computes a group's world_from_model, relative to the scene's origin, with the edit's `motion` (NULL: not edited).
 * Returns false where the group follows a track that doesn't cover `time`: it isn't drawn then. */
static bool place(const pags_composition *c, const group *g, const double *motion, double time, double out[12]) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  double box[12], back[12];
  memcpy(out, identity, sizeof identity);
  if (!g->tracked && !motion)
    return true;
  const pags_object *object = &c->scene.objects[g->object].record;
  if (!pags_object_pose(object, time, box)) {
    if (g->tracked)
      return false;
    nearest_pose(object, time, box);
  }
  pags_pose_subtract(box, c->scene.origin);
  pags_rigid_multiply(box, motion ? motion : identity, out);
  if (!g->tracked) {
    pags_rigid_inverse(box, back);
    pags_rigid_multiply(out, back, out);
  }
  return true;
}

static int64_t group_rows(const group *g) {
  return g->gaussians.count + g->packed.shape.count;
}

/* S_sem of a group whose Gaussians store none: 1 for a critical object, else 0. */
static float priority_of_object(const pags_composition *c, const group *g) {
  return g->object >= 0 && c->scene.objects[g->object].critical ? 1 : 0;
}

/* Fills in all members of a part but world_from_model, for drawing the group at `time`. */
static void fill_part(pags_composition *c, group *g, double time, pags_part *part) {
  if (g->sh && g->sh_time != time) { /* the Fourier series over the object's track or the scene */
    double basis[5];
    const pags_object *const object = g->object < 0 ? NULL : &c->scene.objects[g->object].record;
    const double begin = object ? object->keyframes[0].time : c->scene.time_begin,
                 end = object ? object->keyframes[object->keyframe_count - 1].time : c->scene.time_end;
    pags_fourier_basis(pags_fourier_phase(begin, end, time), basis);
    pags_fourier_colour(&g->gaussians, basis, 0, g->gaussians.count, g->sh);
    g->sh_time = time;
  }
  const bool packed = g->packed.shape.count > 0;
  part->gaussians = packed ? &g->packed.shape : &g->gaussians;
  part->clusters = packed ? &g->packed.clusters : &g->clusters;
  part->packed = packed ? &g->packed : NULL;
  part->id = g->id;
  part->first_id = g->id ? g->id[0] : g->first_id;
  part->sh = g->sh;
  part->s_sem = priority_of_object(c, g);
  part->label = g->object;
}

/* The velocity of a group that follows a track and is drawn with an edit's motion D (NULL: none): that of the object,
 * P(t) = P [Exp(t w) | t v], seen from the frame of P D. */
static void find_velocity(const pags_composition *c, const group *g, const double *motion, double time,
                          double velocity[6]) {
  double own[6];
  memset(velocity, 0, 6 * sizeof *velocity);
  if (!g->tracked)
    return;
  pags_object_velocity(&c->scene.objects[g->object].record, time, own);
  if (!motion) {
    memcpy(velocity, own, sizeof own);
    return;
  }
  const double *const w = own, *const d = motion;
  const double v[3] = {own[3] + w[1] * d[11] - w[2] * d[7], own[4] + w[2] * d[3] - w[0] * d[11],
                       own[5] + w[0] * d[7] - w[1] * d[3]};
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) {
      velocity[k] += d[4 * i + k] * w[i];
      velocity[3 + k] += d[4 * i + k] * v[i];
    }
}

/* Appends the group's part to c->parts, unless the group is empty or isn't there at `time`. */
static void put_part(pags_composition *c, group *g, const double *motion, double time, int *count) {
  pags_part *part = &c->parts[*count];
  if (group_rows(g) == 0 || !place(c, g, motion, time, part->world_from_model))
    return;
  fill_part(c, g, time, part);
  find_velocity(c, g, motion, time, part->velocity);
  ++*count;
}

void pags_compose(pags_composition *composition, double time, const pags_part **parts, int *part_count) {
  pags_composition *c = composition;
  double when = isnan(time) ? c->scene.time_begin : time;
  *part_count = 0;
  for (int64_t i = 0; i < c->group_count; i++)
    if (!c->groups[i].hidden)
      put_part(c, &c->groups[i], c->groups[i].moved ? c->groups[i].motion : NULL, when, part_count);
  for (int64_t i = 0; i < c->addition_count; i++)
    put_part(c, &c->groups[c->additions[i].group], c->additions[i].motion, when, part_count);
  *parts = c->parts;
}

int pags_composition_is_tracked(const pags_composition *composition, int64_t object) {
  return composition->scene.objects[object].model >= 0;
}

void pags_composition_rest_pose(const pags_composition *composition, int64_t object, double out[12]) {
  const pags_scene *scene = &composition->scene;
  if (!pags_object_pose(&scene->objects[object].record, scene->time_begin, out))
    nearest_pose(&scene->objects[object].record, scene->time_begin, out);
}

/* ---- Parts where the caller places them ---- */

/* Whether a placement of `object` draws group `g`; `object` -1 is the background: all groups that
 * no object's placement draws. */
static bool is_placed_by(const pags_composition *c, const group *g, int64_t object) {
  return object < 0 ? g->object < 0 || !follows_edits(c, g, g->object) : follows_edits(c, g, object);
}

/* Computes world_from_model, relative to the scene's origin, of a group that a placement draws; the placement has
 * passed pags_compose_placed's checks. A parked object's group is carried from the object's rest pose to the
 * placement. */
static void place_at(const pags_composition *c, const group *g, const pags_placement *placement, double out[12]) {
  double there[12], rest[12], back[12];
  memcpy(there, placement->world_from_object, sizeof there);
  pags_affine_check(there, "placement");
  for (int k = 0; k < 3; k++)
    for (int j = 0; placement->object < 0 && j < 3; j++) /* the background's p becomes A (p + origin) + t - origin */
      there[4 * k + 3] += there[4 * k + j] * c->scene.origin[j];
  pags_pose_subtract(there, c->scene.origin);
  memcpy(out, there, sizeof there);
  if (placement->object < 0 || g->tracked)
    return;
  pags_composition_rest_pose(c, g->object, rest);
  pags_pose_subtract(rest, c->scene.origin);
  pags_rigid_inverse(rest, back);
  pags_rigid_multiply(there, back, out);
}

pags_result pags_compose_placed(pags_composition *composition, double time, const pags_placement *placements,
                                int64_t count, const pags_part **parts, int *part_count) {
  pags_composition *c = composition;
  double when = isnan(time) ? c->scene.time_begin : time;
  *parts = NULL;
  *part_count = 0;

  /* Each placement must name an object of the scene, or -1, and hold a pose that can be inverted. */
  for (int64_t i = 0; i < count; i++) {
    double pose[12];
    char what[64];
    if (placements[i].object < -1 || placements[i].object >= c->scene.object_count)
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "placement %lld: expected one of the scene's %lld objects or -1, found %lld", (long long)i,
                       (long long)c->scene.object_count, (long long)placements[i].object);
    snprintf(what, sizeof what, "placement %lld", (long long)i);
    memcpy(pose, placements[i].world_from_object, sizeof pose);
    PAGS_TRY(pags_affine_check(pose, what));
  }

  int64_t needed = 0;
  for (int64_t i = 0; i < count; i++)
    for (int64_t g = 0; g < c->group_count; g++)
      needed += is_placed_by(c, &c->groups[g], placements[i].object);
  if (needed > INT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld parts are more than can be drawn at once", (long long)needed);
  if (needed > c->placed_capacity) {
    pags_part *grown = calloc((size_t)needed, sizeof *grown);
    PAGS_CHECK_MEMORY(grown, preparing, (long long)c->gaussian_count);
    free(c->placed_parts);
    c->placed_parts = grown;
    c->placed_capacity = needed;
  }
  for (int64_t i = 0; i < count; i++)
    for (int64_t k = 0; k < c->group_count; k++) {
      group *g = &c->groups[k];
      if (group_rows(g) == 0 || !is_placed_by(c, g, placements[i].object))
        continue;
      pags_part *part = &c->placed_parts[(*part_count)++];
      fill_part(c, g, when, part);
      part->label = i;
      place_at(c, g, &placements[i], part->world_from_model);
    }
  *parts = c->placed_parts;
  return PAGS_OK;
}

/* ---- Ids, priorities and packing ---- */

/* The id of a group's row. */
static int64_t id_of(const group *g, int64_t row) {
  return g->id ? g->id[row] : g->first_id + row;
}

/* Finds the part's group by its pointer to the group's clusters. */
int64_t pags_composition_part_object(const pags_composition *composition, const pags_part *part) {
  for (int64_t i = 0; i < composition->group_count; i++)
    if (part->clusters == &composition->groups[i].clusters || part->clusters == &composition->groups[i].packed.clusters)
      return composition->groups[i].object;
  return -1;
}

void pags_composition_objects(const pags_composition *composition, int32_t *object_of) {
  for (int64_t k = 0; k < composition->group_count; k++) {
    const group *g = &composition->groups[k];
    for (int64_t i = 0; i < group_rows(g); i++)
      object_of[id_of(g, i)] = g->object < 0 && g->gaussians.object_id ? g->gaussians.object_id[i] : (int32_t)g->object;
  }
}

int pags_composition_priorities(const pags_composition *composition, float *priority_of) {
  bool known = composition->scene.object_count > 0;
  for (int64_t k = 0; k < composition->group_count; k++) {
    const group *g = &composition->groups[k];
    float rest = priority_of_object(composition, g);
    known = known || g->gaussians.s_sem || g->packed.has_s_sem;
    for (int64_t i = 0; i < group_rows(g); i++)
      priority_of[id_of(g, i)] = g->gaussians.s_sem    ? g->gaussians.s_sem[i]
                                 : g->packed.has_s_sem ? pags_packed_s_sem(&g->packed, i)
                                                       : rest;
  }
  return known;
}

/* Packs group by group, except groups whose colour changes with time; the rows are in Morton order already. Packed
 * rows have no object_id, so ids in the background that belong to no object of the scene are lost. */
pags_result pags_composition_pack(pags_composition *composition) {
  for (int64_t k = 0; k < composition->group_count; k++) {
    group *g = &composition->groups[k];
    if (g->gaussians.count == 0 || g->gaussians.fourier)
      continue;
    PAGS_TRY(pags_packed_create(&g->gaussians, &g->packed));
    pags_gaussians_destroy(&g->gaussians);
    pags_clusters_destroy(&g->clusters);
  }
  return PAGS_OK;
}

pags_result pags_composition_open_packed(const char *path, pags_composition **out) {
  PAGS_AUTO(pags_packed_destroy) pags_packed packed = {0};
  *out = NULL;
  PAGS_TRY(pags_packed_open(path, &packed));
  if (packed.shape.count > MOST_GAUSSIANS)
    return too_many(packed.shape.count);
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *c = calloc(1, sizeof *c);
  group *g = c ? next_group(c) : NULL;
  PAGS_CHECK_MEMORY(g, "%s: a scene", path);
  c->gaussian_count = packed.shape.count;
  c->scene.up = (pags_up)packed.up;
  c->scene.antialiased = packed.antialiased;
  pags_copy3(packed.origin, c->scene.origin);
  pags_copy3f(packed.background, c->scene.background);
  g->packed = packed;
  packed = (pags_packed){0};
  PAGS_TRY(pags_composition_edit(c, NULL, 0));
  *out = pags_take(&c);
  return PAGS_OK;
}
