/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: compares one vehicle's proxy with its true surface: distances in both directions and overlap of
 * the silhouettes in the training views. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/image.h>
#include "base/file.h"
#include "base/sort.h"
#include "exporters/proxy/lidar.h"
#include "exporters/proxy/mesh_query.h"

#include "base/memory.h"
#include "benchmarks/exporters/proxies.h"

enum { LATTICE = 64, PROXY_SAMPLES = 6000 };
/* metres: cell size of the observed points; distance to an observed point within which a true point counts as
 * observed */
static const double cloud_cell = 0.02, near_observed = 0.06;
static const double mean_bound = 0.1, iou_bound = 0.9;

/* ---- The true mesh ---- */

/* Collects the actor's meshes in the frame of its box, as at the stage's time. */
static pags_result true_mesh(const pags_proxy_bench *self, int actor, pags_proxy_mesh *out) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  double world_from_box[12], box_from_world[12];
  pags_actor_pose(&self->street.actors[actor], self->stage_time, world_from_box);
  pags_rigid_inverse(world_from_box, box_from_world);
  *out = (pags_proxy_mesh){0};
  for (int i = 0; i < self->street.placement_count; i++) {
    const pags_stage_placement *placed = &self->street.placements[i];
    if (placed->actor != actor)
      continue;
    const pags_mesh *mesh = &self->street.meshes[placed->mesh];
    double pose[12];
    uint32_t first = (uint32_t)out->vertex_count;
    for (int k = 0; k < 12; k++)
      pose[k] = (double)placed->pose[k];
    for (int64_t v = 0; v < mesh->vertex_count; v++) {
      const float *p = mesh->vertices[v].position;
      const double local[3] = {(double)p[0], (double)p[1], (double)p[2]};
      double world[3], box[3];
      pags_rigid_point(pose, local, world);
      pags_rigid_point(box_from_world, world, box);
      const float q[3] = {(float)box[0], (float)box[1], (float)box[2]};
      pags_proxy_mesh_vertex(out, q, grey, 0);
    }
    for (int64_t f = 0; f < mesh->face_count; f++) {
      const uint32_t *c = mesh->faces + 4 * f;
      pags_proxy_mesh_triangle(out, first + c[0], first + c[1], first + c[2]);
      pags_proxy_mesh_triangle(out, first + c[0], first + c[2], first + c[3]);
    }
  }
  return pags_proxy_mesh_check(out);
}

/* ---- Rays of the training views ---- */

typedef struct vehicle {
  const pags_object *record;
  int actor;
  double truth_from_proxy[12]; /* from the proxy's frame to that of the true box */
  pags_proxy_mesh truth, proxy;
  pags_mesh_query *truth_query, *proxy_query, *cloud_query;
  /* where rays of training cameras meet the vehicle first, in its frame; one point per cell */
  pags_lidar_fit cloud;
  int64_t pixels;                 /* rays of the lattice that meet the vehicle first */
  int64_t both, either;           /* rays in both or in either silhouette of truth and proxy, without occlusion */
  int64_t seen_both, seen_either; /* the same where nothing of the street occludes them */
  /* with the truth in pictures: points where the rays that truly meet the vehicle meet the proxy */
  pags_lidar_fit met;
} vehicle;

/* Poses of the true vehicle and of its proxy at the time of a view. */
typedef struct frames {
  double truth_from_world[12], proxy_from_world[12];
} frames;

static void bring(const double m[12], const double origin[3], const double direction[3], double from[3],
                  double along[3]) {
  pags_rigid_point(m, origin, from);
  for (int k = 0; k < 3; k++)
    along[k] = m[4 * k] * direction[0] + m[4 * k + 1] * direction[1] + m[4 * k + 2] * direction[2];
}

/* Counts one camera ray: what the street shows along it (`met` something at `distance`; `is_it`: the vehicle), and
 * whether truth and proxy alone would be hit; adds the observed point. */
static pags_result take_ray(vehicle *v, const frames *f, const double origin[3], const double direction[3],
                            double distance, int met, int is_it) {
  double from[3], along[3], p[3], truth = -1;
  if (v->truth_query) {
    bring(f->truth_from_world, origin, direction, from, along);
    truth = pags_mesh_query_ray(v->truth_query, from, along, NULL);
  }
  bring(f->proxy_from_world, origin, direction, from, along);
  double proxy = pags_mesh_query_ray(v->proxy_query, from, along, NULL);
  v->both += truth > 0 && proxy > 0;
  v->either += truth > 0 || proxy > 0;
  int shows = proxy > 0 && (is_it || !met || proxy < distance);
  v->seen_both += is_it && shows;
  v->seen_either += is_it || shows;
  if (!is_it)
    return PAGS_OK;
  v->pixels++;
  if (!v->truth_query && proxy > 0) {
    for (int k = 0; k < 3; k++)
      p[k] = from[k] + proxy * along[k];
    PAGS_TRY(pags_lidar_fit_add(&v->met, p));
  }
  for (int k = 0; k < 3; k++)
    p[k] = from[k] + distance * along[k];
  return pags_lidar_fit_add(&v->cloud, p);
}

typedef struct truth_pictures {
  pags_image depth, ids;
} truth_pictures;

/* Returns the number at the end of an id, which is the object's number in the data set's list; -1 if there is
 * none. */
static int number_of(const char *id) {
  const char *digits = strrchr(id, '_');
  return digits ? atoi(digits + 1) : -1;
}

/* Takes the rays of every pixel of `crop` from the truth's pictures. Depth is camera z, and the rays' directions have
 * z = 1, so that depth is the distance along a ray. */
static pags_result take_pictures(const pags_proxy_bench *self, vehicle *v, const pags_scene_view *view, const frames *f,
                                 const pags_camera *crop) {
  truth_pictures p;
  const pags_camera *camera = &view->camera;
  const double *m = camera->world_from_camera;
  const double origin[3] = {m[3], m[7], m[11]};

  /* Load the view's true depth and object ids. */
  truth_pictures *out = &p;
  char path[1024];
  const char *name = pags_path_name(view->name);
  int stem = (int)(strlen(name) - strlen(pags_path_extension(name)));
  *out = (truth_pictures){0};
  snprintf(path, sizeof path, "%s/truth/depth/%.*s.exr", self->scene.dataset, stem, name);
  PAGS_TRY(pags_image_load(path, PAGS_F32, 1, &out->depth));
  snprintf(path, sizeof path, "%s/truth/ids/%.*s.png", self->scene.dataset, stem, name);
  pags_result result = pags_image_load(path, PAGS_U16, 1, &out->ids);

  int x0 = (int)floor(camera->cx - crop->cx + 0.5), y0 = (int)floor(camera->cy - crop->cy + 0.5);
  for (int y = 0; y < crop->height && result == PAGS_OK; y++)
    for (int x = 0; x < crop->width && result == PAGS_OK; x++) {
      size_t at = (size_t)(y0 + y) * (size_t)p.ids.width + (size_t)(x0 + x);
      double depth = (double)((const float *)p.depth.data)[at], direction[3];
      const double d[3] = {(x + 0.5 - crop->cx) / crop->fx, (y + 0.5 - crop->cy) / crop->fy, 1};
      for (int k = 0; k < 3; k++)
        direction[k] = m[4 * k] * d[0] + m[4 * k + 1] * d[1] + m[4 * k + 2] * d[2];
      int is_it = ((const uint16_t *)p.ids.data)[at] == number_of(v->record->id) + 1;
      result = take_ray(v, f, origin, direction, depth, depth > 0, is_it);
    }
  pags_image_destroy(&p.depth);
  pags_image_destroy(&p.ids);
  return result;
}

/* Takes the rays of one view: a lattice of at most LATTICE x LATTICE pixels over the part of the picture where the
 * vehicle's box may be. */
static pags_result take_view(pags_proxy_bench *self, vehicle *v, const pags_scene_view *view) {
  const pags_camera *camera = &view->camera;
  double world_from_box[12], lo[3], hi[3];
  pags_camera own = *camera, crop;
  frames f = {0};
  if (!self->pictures) {
    PAGS_TRY(pags_proxy_bench_time(self, camera->time));
    pags_actor_pose(&self->street.actors[v->actor], camera->time, world_from_box);
    pags_rigid_inverse(world_from_box, f.truth_from_world);
  }
  if (!pags_object_pose(v->record, camera->time, world_from_box)) {
    if (v->record->moving)
      return PAGS_OK;
    memcpy(world_from_box, v->record->keyframes[v->record->keyframe_count / 2].world_from_object,
           sizeof world_from_box);
  }
  pags_rigid_inverse(world_from_box, f.proxy_from_world);
  pags_rigid_multiply(f.proxy_from_world, camera->world_from_camera, own.world_from_camera);
  for (int k = 0; k < 3; k++) {
    hi[k] = 0.55 * v->record->size[k] + 0.15;
    lo[k] = -hi[k];
  }
  if (!pags_camera_crop(&own, lo, hi, 0.2, &crop) || crop.width < 6 || crop.height < 6)
    return PAGS_OK;
  if (self->pictures)
    return take_pictures(self, v, view, &f, &crop);
  const double *m = camera->world_from_camera;
  const double origin[3] = {m[3], m[7], m[11]};
  int nx = crop.width < LATTICE ? crop.width : LATTICE, ny = crop.height < LATTICE ? crop.height : LATTICE;
  for (int i = 0; i < nx * ny; i += PAGS_PACKET) {
    pags_rays rays = {.active = 0};
    pags_touch touches[PAGS_PACKET];
    double directions[PAGS_PACKET][3];
    for (int r = 0; r < PAGS_PACKET && i + r < nx * ny; r++) {
      int x = (2 * ((i + r) % nx) + 1) * crop.width / (2 * nx), y = (2 * ((i + r) / nx) + 1) * crop.height / (2 * ny);
      const double d[3] = {(x + 0.5 - crop.cx) / crop.fx, (y + 0.5 - crop.cy) / crop.fy, 1};
      rays.active |= 1u << r;
      for (int k = 0; k < 3; k++) {
        directions[r][k] = m[4 * k] * d[0] + m[4 * k + 1] * d[1] + m[4 * k + 2] * d[2];
        rays.origin[r][k] = (float)origin[k];
        rays.direction[r][k] = (float)directions[r][k];
      }
    }
    unsigned met = pags_stage_trace(self->stage, &rays, touches);
    for (int r = 0; r < PAGS_PACKET && i + r < nx * ny; r++)
      PAGS_TRY(take_ray(v, &f, origin, directions[r], (double)touches[r].distance, met >> r & 1,
                        met >> r & 1 && self->street.placements[touches[r].placement].actor == v->actor));
  }
  return PAGS_OK;
}

/* ---- Distances from the proxy ---- */

static int compare_points(const void *left, const void *right) {
  const float *a = left, *b = right;
  for (int k = 0; k < 3; k++) {
    double x = floor((double)a[k] / cloud_cell), y = floor((double)b[k] / cloud_cell);
    if (x != y)
      return x < y ? -1 : 1;
  }
  return 0;
}

static double triangle_area(const pags_proxy_mesh *s, int64_t triangle) {
  const float *c[3];
  double u[3], w[3], n[3];
  for (int i = 0; i < 3; i++)
    c[i] = s->positions + 3 * (int64_t)s->triangles[3 * triangle + i];
  for (int k = 0; k < 3; k++) {
    u[k] = (double)c[1][k] - (double)c[0][k];
    w[k] = (double)c[2][k] - (double)c[0][k];
  }
  for (int k = 0; k < 3; k++)
    n[k] = u[(k + 1) % 3] * w[(k + 2) % 3] - u[(k + 2) % 3] * w[(k + 1) % 3];
  return 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

/* Returns point `n` of a low-discrepancy sequence in a triangle: the R2 sequence of Roberts 2018, based on the
 * plastic number. */
static void place_in(const pags_proxy_mesh *s, int64_t triangle, int64_t n, double out[3]) {
  double a = fmod(0.5 + 0.7548776662466927 * (double)n, 1), b = fmod(0.5 + 0.5698402909980532 * (double)n, 1);
  if (a + b > 1) {
    a = 1 - a;
    b = 1 - b;
  }
  const uint32_t *t = s->triangles + 3 * triangle;
  for (int k = 0; k < 3; k++) {
    double p = (double)s->positions[3 * (int64_t)t[0] + k];
    out[k] = p + a * ((double)s->positions[3 * (int64_t)t[1] + k] - p) +
             b * ((double)s->positions[3 * (int64_t)t[2] + k] - p);
  }
}

typedef struct spread {
  double *seen, *rest; /* distances from the proxy to the true surface: where it is observed, and elsewhere */
  int64_t seen_count, rest_count;
} spread;

/* Measures the distances from the proxy to the true surface at samples spread evenly over the proxy's area, or, with
 * the truth in pictures, from the points in v->met to the observed points. */
static void measure_proxy(const vehicle *v, spread *out) {
  if (!v->truth_query) {
    int64_t step = v->met.count / PROXY_SAMPLES + 1;
    for (int64_t i = 0; i < v->met.count; i += step) {
      const double p[3] = {(double)v->met.points[3 * i], (double)v->met.points[3 * i + 1],
                           (double)v->met.points[3 * i + 2]};
      out->seen[out->seen_count++] = pags_mesh_query_distance(v->cloud_query, p, NULL);
    }
    return;
  }
  double area = 0, owed = 0;
  for (int64_t t = 0; t < v->proxy.triangle_count; t++)
    area += triangle_area(&v->proxy, t);
  int64_t n = 0;
  for (int64_t t = 0; t < v->proxy.triangle_count; t++)
    for (owed += PROXY_SAMPLES * triangle_area(&v->proxy, t) / area; owed >= 1; --owed, ++n) {
      double p[3], q[3], foot[3], back[12];
      place_in(&v->proxy, t, n, p);
      pags_rigid_point(v->truth_from_proxy, p, q);
      double distance = pags_mesh_query_nearest(v->truth_query, q, foot);
      pags_rigid_inverse(v->truth_from_proxy, back);
      pags_rigid_point(back, foot, q);
      if (pags_mesh_query_distance(v->cloud_query, q, NULL) <= near_observed)
        out->seen[out->seen_count++] = distance;
      else
        out->rest[out->rest_count++] = distance;
    }
}

/* ---- Report ---- */

static pags_result tell(pags_proxy_bench *self, vehicle *v, spread *to) {
  double *from = malloc(((size_t)v->cloud.count + 1) * sizeof *from);
  pags_proxy_mesh_topology topology;
  if (!from)
    return pags_out_of_memory("%lld distances", (long long)v->cloud.count);
  for (int64_t i = 0; i < v->cloud.count; i++) {
    const double p[3] = {(double)v->cloud.points[3 * i], (double)v->cloud.points[3 * i + 1],
                         (double)v->cloud.points[3 * i + 2]};
    from[i] = pags_mesh_query_distance(v->proxy_query, p, NULL);
  }
  pags_proxy_distance back = pags_distance_summary(from, v->cloud.count),
                      seen = pags_distance_summary(to->seen, to->seen_count),
                      rest = pags_distance_summary(to->rest, to->rest_count);
  free(from);
  PAGS_TRY(pags_proxy_mesh_inspect(&v->proxy, &topology));
  double alone = (double)v->both / (double)v->either, shown = (double)v->seen_both / (double)v->seen_either;
  double share = (double)to->seen_count / (double)(to->seen_count + to->rest_count);
  int good = back.mean <= mean_bound && seen.mean <= mean_bound && shown >= iou_bound && topology.closed;
  self->failures += !good;
  pags_say(
      &self->session,
      "%-16s %8lld px, truth to proxy %.3f (%.3f, %.2f), proxy to truth %.3f (%.3f, %.2f), rest %.3f (%.3f, %.2f), "
      "near observed %2.0f %%, IoU alone %.3f, shown %.3f, %s%s\n",
      v->record->id, (long long)v->pixels, back.mean, back.p95, back.max, seen.mean, seen.p95, seen.max, rest.mean,
      rest.p95, rest.max, 100 * share, alone, shown, topology.closed ? "closed" : "OPEN", good ? "" : "  <<<");
  pags_json_writer *w = &self->json;
  pags_json_begin_object(w, NULL);
  pags_json_put_string(w, "object", v->record->id);
  pags_json_put_integer(w, "pixels", v->pixels);
  pags_proxy_bench_put(w, "truth_to_proxy", &back);
  pags_proxy_bench_put(w, "proxy_to_truth", &seen);
  pags_proxy_bench_put(w, "proxy_to_truth_unobserved", &rest);
  pags_json_put_number(w, "near_observed", share);
  pags_json_put_number(w, "iou_alone", alone);
  pags_json_put_number(w, "iou_shown", shown);
  pags_json_put_bool(w, "closed", topology.closed);
  pags_json_put_bool(w, "good", good);
  pags_json_end_object(w);
  return PAGS_OK;
}

/* ---- Measuring a vehicle ---- */

static pags_result measure(pags_proxy_bench *self, vehicle *v) {
  for (int64_t i = 0; i < self->scene.view_count; i++)
    if (!self->scene.views[i].test)
      PAGS_TRY(take_view(self, v, &self->scene.views[i]));
  if (!v->cloud.count) {
    pags_say(&self->session, "%-16s is seen by no training camera\n", v->record->id);
    return PAGS_OK;
  }

  /* Keep one observed point per cell, so that near views don't count for more. */
  int64_t kept = 0;
  pags_sort(v->cloud.points, v->cloud.count, 3 * sizeof(float), compare_points);
  for (int64_t i = 0; i < v->cloud.count; i++)
    if (!kept || compare_points(v->cloud.points + 3 * (kept - 1), v->cloud.points + 3 * i) != 0)
      memmove(v->cloud.points + 3 * kept++, v->cloud.points + 3 * i, 3 * sizeof(float));
  v->cloud.count = kept;

  PAGS_TRY(pags_mesh_query_of_points(v->cloud.points, v->cloud.count, &v->cloud_query));
  spread to = {.seen = malloc((PROXY_SAMPLES + 2) * sizeof(double)),
               .rest = malloc((PROXY_SAMPLES + 2) * sizeof(double))};
  pags_result result = to.seen && to.rest ? PAGS_OK : pags_out_of_memory(NULL);
  if (result == PAGS_OK) {
    measure_proxy(v, &to);
    result = tell(self, v, &to);
  }
  free(to.seen);
  free(to.rest);
  return result;
}

/* Returns the index of the street's actor with the number at the end of the id, or -1. */
static int actor_of(const pags_proxy_bench *self, const char *id) {
  for (int i = 0; i < self->street.actor_count; i++)
    if (self->street.actors[i].number == number_of(id))
      return i;
  return -1;
}

/* Computes truth_from_proxy at the middle of the track, to whose time the stage is set. */
static pags_result relate(pags_proxy_bench *self, vehicle *v) {
  double truth[12], truth_from_world[12], proxy[12];
  const pags_keyframe *keyframe = &v->record->keyframes[v->record->keyframe_count / 2];
  PAGS_TRY(pags_proxy_bench_time(self, keyframe->time));
  pags_actor_pose(&self->street.actors[v->actor], keyframe->time, truth);
  if (!pags_object_pose(v->record, keyframe->time, proxy))
    memcpy(proxy, keyframe->world_from_object, sizeof proxy);
  pags_rigid_inverse(truth, truth_from_world);
  pags_rigid_multiply(truth_from_world, proxy, v->truth_from_proxy);
  return PAGS_OK;
}

pags_result pags_proxy_bench_vehicle(pags_proxy_bench *self, const pags_json_value *node, const char *track) {
  const pags_scene_object *object = pags_scene_find_object(&self->scene, track);
  vehicle v = {.record = object ? &object->record : NULL, .actor = actor_of(self, track)};
  if (!v.record || (v.actor < 0 && !self->pictures) || v.record->category != PAGS_CATEGORY_VEHICLE)
    return PAGS_OK;
  pags_result result = pags_glb_mesh(&self->file, pags_glb_integer(node, "mesh", -1), &v.proxy);
  if (result == PAGS_OK && !self->pictures)
    result = relate(self, &v);
  if (result == PAGS_OK && !self->pictures)
    result = true_mesh(self, v.actor, &v.truth);
  if (result == PAGS_OK && !self->pictures)
    result = pags_mesh_query_of_mesh(&v.truth, &v.truth_query);
  if (result == PAGS_OK)
    result = pags_mesh_query_of_mesh(&v.proxy, &v.proxy_query);
  if (result == PAGS_OK)
    result = measure(self, &v);
  pags_mesh_query_destroy(v.truth_query);
  pags_mesh_query_destroy(v.proxy_query);
  pags_mesh_query_destroy(v.cloud_query);
  pags_proxy_mesh_destroy(&v.truth);
  pags_proxy_mesh_destroy(&v.proxy);
  pags_lidar_fit_destroy(&v.cloud);
  pags_lidar_fit_destroy(&v.met);
  return result;
}
