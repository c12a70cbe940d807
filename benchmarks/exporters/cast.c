/* SPDX-License-Identifier: Apache-2.0 */
/* Casts rays through the true street and through the proxies of pags-bench proxies, and finds out which true surfaces
 * the training cameras saw. Results are stored by ray, so that they don't depend on the number of threads. */
#include <math.h>
#include <stdio.h>

#include "base/parallel.h"
#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"

enum { GRAIN = 32 }; /* packets of a block */
/* What counts as seen: distance in metres, cosine of the angle from the normal (3 degrees from the surface); metres by
 * which a first hit may lie before the point, on what rests and on what moves, since limbs swing. */
static const double seen_range = 40, seen_cosine = 0.05, still_slack = 0.02, moving_slack = 0.2;

/* ---- Lists of rays ---- */

pags_result pags_bench_add_ray(pags_bench_rays *rays, const double origin[3], const double direction[3], int group) {
  PAGS_CHECK_MEMORY(pags_grow(&rays->list, rays->count + 1, &rays->capacity, sizeof *rays->list), "%lld rays",
                    (long long)rays->count + 1);
  pags_bench_ray *ray = &rays->list[rays->count++];
  *ray = (pags_bench_ray){
      .group = group, .truth = HUGE_VAL, .proxy = HUGE_VAL, .kind = PAGS_KIND_NONE, .placement = -1, .placed = -1};
  pags_copy3(origin, ray->origin);
  pags_scale3(1 / pags_length3(direction), direction, ray->direction);
  return PAGS_OK;
}

void pags_bench_free_rays(pags_bench_rays *rays) {
  free(rays->list);
  *rays = (pags_bench_rays){0};
}

void pags_bench_point(const pags_bench_ray *ray, double distance, double out[3]) {
  pags_along3(ray->origin, distance, ray->direction, out);
}

const char *pags_bench_share(char text[16], int64_t part, int64_t of) {
  snprintf(text, 16, of ? "%.1f %%" : "-", 100 * (double)part / (double)of);
  return text;
}

/* ---- Casting ---- */

typedef struct job {
  pags_proxy_bench *self;
  pags_bench_rays *rays;
  int64_t first;
  const pags_camera *camera; /* whose sight is tested */
  double camera_from_world[12];
} job;

static void load_ray(pags_rays *packet, int lane, const double origin[3], const double direction[3]) {
  packet->active |= 1u << lane;
  pags_narrow3(origin, packet->origin[lane]);
  pags_narrow3(direction, packet->direction[lane]);
}

static pags_kind kind_of_label(uint8_t label) {
  switch (label) {
    case PAGS_CLASS_ROAD: return PAGS_KIND_ROAD;
    case PAGS_CLASS_SIDEWALK: return PAGS_KIND_SIDEWALK;
    case PAGS_CLASS_TERRAIN: return PAGS_KIND_TERRAIN;
    case PAGS_CLASS_BUILDING:
    case PAGS_CLASS_WALL: return PAGS_KIND_BUILDING;
    case PAGS_CLASS_FENCE: return PAGS_KIND_FENCE;
    case PAGS_CLASS_VEGETATION: return PAGS_KIND_TREE;
    case PAGS_CLASS_POLE: return PAGS_KIND_POLE;
    case PAGS_CLASS_LIGHT:
    case PAGS_CLASS_SIGN: return PAGS_KIND_SIGN;
    case PAGS_CLASS_CAR: return PAGS_KIND_VEHICLE;
    case PAGS_CLASS_PERSON: return PAGS_KIND_PEDESTRIAN;
    case PAGS_CLASS_RIDER:
    case PAGS_CLASS_BICYCLE: return PAGS_KIND_CYCLIST;
    default: return PAGS_KIND_OTHER;
  }
}

static void cast_packets(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const job *j = context;
  for (int64_t packet = begin; packet < end; packet++) {
    pags_bench_ray *list = j->rays->list + j->first + packet * PAGS_PACKET;
    const int64_t left = j->rays->count - j->first - packet * PAGS_PACKET;
    pags_rays rays = {.active = 0};
    pags_touch touches[PAGS_PACKET];
    for (int i = 0; i < PAGS_PACKET && i < left; i++)
      load_ray(&rays, i, list[i].origin, list[i].direction);
    const unsigned met = pags_stage_trace(j->self->stage, &rays, touches);
    for (int i = 0; i < PAGS_PACKET && i < left; i++) {
      pags_bench_ray *ray = &list[i];
      ray->time = j->self->stage_time;
      ray->proxy = pags_placed_ray(&j->self->placed, ray->origin, ray->direction, &ray->placed);
      if (!(met >> i & 1))
        continue;
      ray->truth = (double)touches[i].distance;
      ray->placement = touches[i].placement;
      ray->kind = kind_of_label(j->self->street.materials.list[touches[i].material].label);
      pags_widen3(touches[i].flat, ray->normal);
    }
  }
}

pags_result pags_bench_cast(pags_proxy_bench *self, double time, pags_bench_rays *rays, int64_t first) {
  job j = {.self = self, .rays = rays, .first = first};
  PAGS_TRY(pags_proxy_bench_time(self, time));
  PAGS_TRY(pags_placed_set_time(&self->placed, time));
  const int64_t packets = (rays->count - first + PAGS_PACKET - 1) / PAGS_PACKET;
  return pags_parallel_run(self->session.tasks, packets, GRAIN, cast_packets, &j);
}

/* ---- What the cameras saw ---- */

/* Sets `at` to where the true point of a ray is at the time of the stage, and `normal` to its normal there. Returns
 * whether it moves. */
static bool find_now(const pags_proxy_bench *self, const pags_bench_ray *ray, double at[3], double normal[3]) {
  const int actor = self->street.placements[ray->placement].actor;
  pags_bench_point(ray, ray->truth, at);
  pags_copy3(ray->normal, normal);
  if (actor < 0 || !self->street.actors[actor].moving)
    return false;
  double then[12], now[12], local[3];
  pags_actor_pose(&self->street.actors[actor], ray->time, then);
  pags_actor_pose(&self->street.actors[actor], self->stage_time, now);
  pags_rigid_inverse(then, then);
  pags_rigid_multiply(now, then, now);
  pags_rigid_point(now, at, local);
  pags_copy3(local, at);
  pags_rotate3(now, ray->normal, normal);
  return true;
}

/* Sets `way` to the vector from the camera to a point. Returns its length, or 0 where the camera doesn't look at it. */
static double look(const job *j, const double at[3], const double normal[3], double way[3]) {
  double eye[3], local[3], pixel[2];
  pags_pose_position(j->camera->world_from_camera, eye);
  pags_subtract3(at, eye, way);
  const double distance = pags_length3(way);
  if (distance > seen_range || fabs(pags_dot3(way, normal)) < seen_cosine * distance)
    return 0;
  pags_rigid_point(j->camera_from_world, at, local);
  const bool inside = pags_camera_project(j->camera, local, pixel, NULL) && pixel[0] >= 0 && pixel[1] >= 0 &&
                      pixel[0] < j->camera->width && pixel[1] < j->camera->height;
  return inside ? distance : 0;
}

static void see_rays(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const job *j = context;
  pags_rays packet = {.active = 0};
  pags_touch touches[PAGS_PACKET];
  pags_bench_ray *looked[PAGS_PACKET];
  double limits[PAGS_PACKET];
  int lanes = 0;
  for (int64_t i = begin; i < end; i++) {
    pags_bench_ray *ray = &j->rays->list[i];
    double at[3], normal[3], way[3], eye[3];
    if (!ray->seen && ray->placement >= 0) {
      const double slack = find_now(j->self, ray, at, normal) ? moving_slack : still_slack;
      const double distance = look(j, at, normal, way);
      if (distance > 0) {
        pags_divide3(way, distance);
        pags_pose_position(j->camera->world_from_camera, eye);
        load_ray(&packet, lanes, eye, way);
        looked[lanes] = ray;
        limits[lanes++] = distance - slack;
      }
    }
    if (lanes < PAGS_PACKET && (i + 1 < end || !lanes))
      continue;
    const unsigned met = pags_stage_trace(j->self->stage, &packet, touches);
    for (int lane = 0; lane < lanes; lane++)
      looked[lane]->seen = !(met >> lane & 1) || (double)touches[lane].distance >= limits[lane];
    packet.active = 0;
    lanes = 0;
  }
}

pags_result pags_bench_see(pags_proxy_bench *self, pags_bench_rays *rays) {
  for (int64_t i = 0; i < self->scene.view_count; i++) {
    const pags_scene_view *view = &self->scene.views[i];
    job j = {.self = self, .rays = rays, .camera = &view->camera};
    if (view->test)
      continue;
    PAGS_TRY(pags_proxy_bench_time(self, view->camera.time));
    pags_rigid_inverse(view->camera.world_from_camera, j.camera_from_world);
    PAGS_TRY(pags_parallel_run(self->session.tasks, rays->count, (int64_t)GRAIN * PAGS_PACKET, see_rays, &j));
  }
  return PAGS_OK;
}
