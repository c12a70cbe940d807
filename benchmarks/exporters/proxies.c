/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: measures the distances between the proxies exported from a scene (pags export) and the true
 * surfaces of the synthetic street that it was trained on (pags synth street).
 *
 * The street is rebuilt from DATASET/truth/street.json. If that file is missing, as in data sets of other programs,
 * DATASET/truth/depth and truth/ids are used instead: then a vehicle's proxy is compared only at the points where
 * rays of training cameras truly meet the vehicle.
 *
 * A vehicle's observed surface is where the training cameras' rays, traced through the street, meet it first.
 * Training may have moved a track off the true one, so observed points are transformed into the proxy's own frame,
 * and the true mesh is related to the proxy at the middle of its track. Measured are the distances from the
 * observed points to the proxy; from samples spread evenly over the proxy to the true surface, separately for
 * samples whose nearest true point is observed and for the rest; the overlap of the silhouettes; the heights of
 * the ground mesh against the street and against LiDAR ground points of held-out sweeps; and the distances of
 * held-out LiDAR points on objects to their proxies. A measurement fails if a vehicle's mean distance exceeds 0.1
 * m, its overlap is below 0.9, its mesh is open, or the 95th percentile of a ground error exceeds 0.05 m; if a ball
 * passes through a wall, less than 98 % of the level rays to walls are stopped, or something falls through the ground.
 * A line counts the failures. Proxies of every class are then measured together, if the street can be rebuilt:
 * first_hits.c, feet.c, drops.c, parts.c, shadows.c; all meshes of the file count, also collision shapes. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "exporters/proxy/lidar.h"
#include "exporters/proxy/mesh_query.h"

#include "base/memory.h"
#include "benchmarks/exporters/lidar_ground.h"
#include "benchmarks/exporters/proxies.h"
#include "benchmarks/verbs.h"
#include "maths/maths.h"

/* metres: largest 95th percentile of the ground error; distance from a camera that counts as near the path */
static const double ground_bound = 0.05, ground_reach = 10;

/* Reads a node's mesh and prepares it for distance queries. The caller destroys both, also after a failure. */
static pags_result open_mesh(const pags_proxy_bench *self, const pags_json_value *node, pags_proxy_mesh *mesh,
                             pags_mesh_query **query) {
  PAGS_TRY(pags_glb_mesh(&self->file, pags_glb_integer(node, "mesh", -1), mesh));
  return pags_mesh_query_of_mesh(mesh, query);
}

/* The id of the object that a node has the whole proxy of; NULL for other nodes, and for convex parts. */
static const char *whole_object(const pags_json_value *node) {
  const pags_json_value *extras = pags_glb_member(node, "extras");
  const char *level = pags_glb_text(extras, "level");
  return pags_glb_member(node, "mesh") && !(level && !strcmp(level, "convex")) ? pags_glb_text(extras, "track") : NULL;
}

/* ---- The ground ---- */

/* Finds the true height of the road or ground at x, y (world); returns false if something else is there: furniture, a
 * tree or an actor. */
static bool true_height(const pags_proxy_bench *self, double x, double y, double *z) {
  pags_rays rays = {.active = 1, .origin = {{(float)x, (float)y, 2.0f}}, .direction = {{0, 0, -1}}};
  pags_touch touches[PAGS_PACKET];
  if (!(pags_stage_trace(self->stage, &rays, touches) & 1) || self->street.placements[touches[0].placement].actor >= 0)
    return false;
  *z = (double)touches[0].point[2];
  return *z < 0.3 && (double)fabsf(touches[0].flat[2]) > 0.99;
}

static bool near_path(const pags_proxy_bench *self, double x, double y) {
  for (int64_t i = 0; i < self->scene.view_count; i++) {
    const double *m = self->scene.views[i].camera.world_from_camera;
    if (!self->scene.views[i].test && pags_hypot(m[3] - x, m[7] - y) < ground_reach)
      return true;
  }
  return false;
}

static pags_result measure_ground(pags_proxy_bench *self, const pags_proxy_mesh *ground, const pags_mesh_query *query) {
  double lo[3], hi[3];
  pags_proxy_mesh_bounds(ground, lo, hi);
  const double step = 0.25;
  const int64_t most = (int64_t)(((hi[0] - lo[0]) / step + 2) * ((hi[1] - lo[1]) / step + 2));
  PAGS_AUTOFREE double *all = malloc(((size_t)most + 1) * sizeof *all);
  PAGS_AUTOFREE double *close = malloc(((size_t)most + 1) * sizeof *close);
  PAGS_CHECK_MEMORY(all && close, "%lld heights", (long long)most);
  int64_t count = 0, close_count = 0, holes = 0;
  for (double y = lo[1]; y <= hi[1]; y += step)
    for (double x = lo[0]; x <= hi[0] && count < most; x += step) {
      const double from[3] = {x, y, 1000}, down[3] = {0, 0, -1};
      double z, world[2] = {x + self->scene.origin[0], y + self->scene.origin[1]};
      double t = pags_mesh_query_ray(query, from, down, NULL);
      int close_by = near_path(self, world[0], world[1]);
      holes += close_by && !(t > 0);
      if (!(t > 0) || !true_height(self, world[0], world[1], &z))
        continue;
      all[count] = fabs(1000 - t + self->scene.origin[2] - z);
      if (close_by)
        close[close_count++] = all[count];
      count++;
    }
  pags_proxy_distance far = pags_distance_summary(all, count), near = pags_distance_summary(close, close_count);
  int good = far.p95 <= ground_bound && !holes;
  self->failures += !good;
  pags_say(&self->session,
           "ground: %lld heights, off by %.3f (p95 %.3f, max %.2f); within %g m of the path %.3f (%.3f, %.2f), %lld "
           "holes%s\n",
           (long long)count, far.mean, far.p95, far.max, ground_reach, near.mean, near.p95, near.max, (long long)holes,
           good ? "" : "  <<<");
  pags_json_begin_object(&self->json, "ground");
  pags_proxy_bench_put(&self->json, "error", &far);
  pags_proxy_bench_put(&self->json, "error_near_path", &near);
  pags_json_put_integer(&self->json, "holes", holes);
  pags_json_end_object(&self->json);
  return PAGS_OK;
}

static pags_result measure_lidar(pags_proxy_bench *self, const pags_mesh_query *query) {
  pags_lidar_ground found;
  PAGS_TRY(pags_lidar_ground_measure(&self->scene, query, &found));
  if (!found.points)
    return PAGS_OK;
  int good = found.error.p95 <= ground_bound;
  self->failures += !good;
  pags_say(&self->session,
           "ground against %lld points of %lld held-out sweeps: %.3f (p95 %.3f, max %.2f) m, %lld beyond it%s\n",
           (long long)found.points, (long long)found.sweeps, found.error.mean, found.error.p95, found.error.max,
           (long long)found.missed, good ? "" : "  <<<");
  pags_json_begin_object(&self->json, "lidar_ground");
  pags_proxy_bench_put(&self->json, "error", &found.error);
  pags_json_put_integer(&self->json, "points", found.points);
  pags_json_put_integer(&self->json, "missed", found.missed);
  pags_json_end_object(&self->json);
  return PAGS_OK;
}

/* Measures the pieces of the ground, whose names begin so, as one. */
static pags_result measure_all_ground(pags_proxy_bench *self) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh ground = {0};
  PAGS_AUTO(pags_mesh_query_destroy_auto) pags_mesh_query *query = NULL;
  for (int64_t i = 0; i < self->placed.count; i++)
    if (!strncmp(self->placed.list[i].name, "ground", 6))
      PAGS_TRY(pags_proxy_mesh_append(&self->placed.list[i].mesh, &ground));
  if (!ground.triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_mesh_query_of_mesh(&ground, &query));
  if (!self->pictures)
    PAGS_TRY(measure_ground(self, &ground, query));
  return measure_lidar(self, query);
}

/* ---- Objects against LiDAR ---- */

/* Computes the distance of each point of `cloud` to a node's mesh. */
static pags_result add_distances(pags_proxy_bench *self, const pags_json_value *node, const pags_lidar_fit *cloud,
                                 double *distances) {
  pags_proxy_mesh mesh = {0};
  pags_mesh_query *query = NULL;
  pags_result result = open_mesh(self, node, &mesh, &query);
  for (int64_t i = 0; i < cloud->count && result == PAGS_OK; i++) {
    const double p[3] = {(double)cloud->points[3 * i], (double)cloud->points[3 * i + 1],
                         (double)cloud->points[3 * i + 2]};
    distances[i] = pags_mesh_query_distance(query, p, NULL);
  }
  pags_mesh_query_destroy(query);
  pags_proxy_mesh_destroy(&mesh);
  return result;
}

/* Measures the proxies of parked, then of moving objects against the points of held-out LiDAR sweeps. */
static pags_result measure_objects(pags_proxy_bench *self, const pags_json_value *nodes, const pags_lidar *lidar) {
  static const char *const kinds[] = {"parked", "moving"};
  for (int moving = 0; moving < 2; moving++) {
    double *distances = NULL;
    int64_t count = 0, objects = 0;
    for (const pags_json_value *node = nodes ? nodes->first : NULL; node; node = node->next) {
      const char *track = whole_object(node);
      const pags_scene_object *object = track ? pags_scene_find_object(&self->scene, track) : NULL;
      const pags_lidar_fit *cloud = object ? &lidar->objects[object - self->scene.objects] : NULL;
      if (!object || object->record.moving != moving || !cloud->count)
        continue;
      double *grown = realloc(distances, (size_t)(count + cloud->count) * sizeof *grown);
      pags_result result = grown ? PAGS_OK : pags_out_of_memory("distances");
      distances = grown ? grown : distances;
      if (result == PAGS_OK)
        result = add_distances(self, node, cloud, distances + count);
      if (result != PAGS_OK) {
        free(distances);
        return result;
      }
      count += cloud->count;
      objects++;
    }
    pags_proxy_distance d = pags_distance_summary(distances, count);
    if (count)
      pags_say(&self->session, "%lld %s objects against %lld points of held-out sweeps: %.3f (p95 %.3f, max %.2f) m\n",
               (long long)objects, kinds[moving], (long long)count, d.mean, d.p95, d.max);
    free(distances);
  }
  return PAGS_OK;
}

static pags_result measure_by_lidar(pags_proxy_bench *self, const pags_json_value *nodes) {
  pags_lidar lidar;
  PAGS_TRY(pags_lidar_read(&self->scene, 1, &lidar));
  pags_result result = lidar.objects ? measure_objects(self, nodes, &lidar) : PAGS_OK;
  pags_lidar_destroy(&lidar);
  return result;
}

/* ---- The benchmark ---- */

static pags_result run(pags_proxy_bench *self) {
  const pags_json_value *nodes = pags_glb_member(self->file.root, "nodes");
  bool found;
  PAGS_TRY(pags_street_read_truth(self->scene.dataset ? self->scene.dataset : ".", &self->options, &found));
  self->pictures = !found;
  char *pictures = pags_path_join(self->scene.dataset ? self->scene.dataset : ".", "truth/ids");
  int has_truth = !self->pictures || (pictures && pags_dir_exists(pictures));
  free(pictures);
  if (self->pictures)
    pags_say(&self->session, "no truth/street.json: %s\n",
             has_truth ? "the truth's pictures stand for it" : "the ground alone is measured, against LiDAR's");
  PAGS_TRY(pags_street_build(&self->options, &self->street));
  pags_street_number(&self->street);
  PAGS_TRY(pags_stage_create(self->street.meshes, self->street.mesh_count, self->street.placements,
                             self->street.placement_count, &self->stage));
  self->stage_time = (double)NAN;
  PAGS_TRY(pags_proxy_bench_time(self, 0));
  pags_json_begin_array(&self->json, "objects");
  for (const pags_json_value *node = nodes ? nodes->first : NULL; node; node = node->next) {
    const char *track = whole_object(node);
    if (has_truth && track)
      PAGS_TRY(pags_proxy_bench_vehicle(self, node, track));
  }
  pags_json_end_array(&self->json);
  PAGS_TRY(pags_placed_open(&self->file, &self->scene, &self->placed));
  PAGS_TRY(measure_all_ground(self));
  PAGS_TRY(measure_by_lidar(self, nodes));
  if (!self->pictures) {
    PAGS_TRY(pags_bench_first_hits(self));
    PAGS_TRY(pags_bench_feet(self));
    PAGS_TRY(pags_bench_drops(self));
    PAGS_TRY(pags_bench_parts(self));
    PAGS_TRY(pags_bench_shadows(self));
  }
  pags_say(&self->session, "%d of these exceed the bounds\n", self->failures);
  return PAGS_OK;
}

static const pags_option options[] = {PAGS_SESSION_OPTIONS(pags_proxy_bench), {0}};

static const pags_verb verb = {
    .name = "proxies",
    .usage = "SCENE FILE.glb [options]",
    .about =
        "Measures how far exported proxies are from the true meshes of the synthetic "
        "street: of vehicles the distances both ways and "
        "the overlap in the training views, of the ground its heights against the street "
        "and against held-out LiDAR, of other objects "
        "their distances from held-out LiDAR. Fails (exit code 1) where one exceeds its "
        "bound: means of 0.1 m, an overlap of 0.9, a 95th "
        "percentile of the ground of 0.05 m; and where a ball passes through a wall, less than 98 % of level rays to "
        "walls "
        "are stopped, or something falls through the ground. Then of all proxies, by class: first hits of rays, leaks "
        "at the feet of "
        "walls and poles, heights at which things rest, pieces and open edges, feet of trees and poles, shadows.",
    .positionals = {{"SCENE", "a scene trained on pags synth street"}, {"FILE.glb", "what pags export wrote of it"}},
    .options = options};

int pags_bench_proxies(int argc, char **argv) {
  pags_proxy_bench self = {0};
  pags_parsed parsed;
  const pags_parse_status status = pags_options_parse(&verb, argc, argv, &self, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  pags_json_writer_init(&self.json, 1);
  pags_json_begin_object(&self.json, NULL);
  pags_result result = pags_session_begin(&self.session);
  if (result == PAGS_OK)
    result = pags_scene_load(parsed.positionals[0], &self.scene);
  if (result == PAGS_OK)
    result = pags_glb_open(parsed.positionals[1], &self.file);
  if (result == PAGS_OK)
    result = run(&self);
  if (result == PAGS_OK)
    result = pags_session_json(&self.session, &self.json);
  else
    pags_json_writer_destroy(&self.json);
  pags_placed_close(&self.placed);
  pags_stage_destroy(self.stage);
  pags_street_destroy(&self.street);
  pags_glb_close(&self.file);
  pags_scene_destroy(&self.scene);
  const int code = pags_session_end(&self.session, result);
  return code == PAGS_EXIT_OK && self.failures > 0 ? PAGS_EXIT_FAILED : code;
}
