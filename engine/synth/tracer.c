/* SPDX-License-Identifier: Apache-2.0 */
/* The room as an Embree scene of two geometries: quads (six a box) and sphere points. */
#include "synth/tracer.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "synth/embree.h"

enum { QUADS = 0, BALLS = 1 }; /* geometry ids, in the order of attaching */

struct pags_tracer {
  const pags_room *room;
  RTCDevice device;
  RTCScene scene;
};

/* Corners (pags_box_corner) of the six faces, going around. */
static const unsigned faces[6][4] = {{0, 2, 6, 4}, {1, 5, 7, 3}, {0, 4, 5, 1},
                                     {2, 3, 7, 6}, {0, 1, 3, 2}, {4, 6, 7, 5}};

static pags_result attach(const pags_tracer *tracer, RTCGeometry geometry, unsigned id) {
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(tracer->scene, geometry, id);
  rtcReleaseGeometry(geometry);
  return PAGS_OK;
}

static pags_result add_quads(const pags_tracer *tracer) {
  const size_t count = (size_t)tracer->room->box_count;
  RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_QUAD);
  float *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 8 * count);
  unsigned *indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4, 16, 6 * count);
  if (!vertices || !indices) {
    rtcReleaseGeometry(geometry);
    return pags_embree_failed(tracer->device);
  }
  for (size_t b = 0; b < count; b++) {
    for (int i = 0; i < 8; i++)
      pags_box_corner(&tracer->room->boxes[b], i, vertices + 3 * (8 * b + (size_t)i));
    for (size_t i = 0; i < 24; i++)
      indices[24 * b + i] = (unsigned)(8 * b) + faces[i / 4][i % 4];
  }
  return attach(tracer, geometry, QUADS);
}

static pags_result add_balls(const pags_tracer *tracer) {
  const size_t count = (size_t)tracer->room->ball_count;
  RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_SPHERE_POINT);
  float *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 16, count);
  if (!vertices) {
    rtcReleaseGeometry(geometry);
    return pags_embree_failed(tracer->device);
  }
  for (size_t b = 0; b < count; b++) {
    for (int k = 0; k < 3; k++)
      vertices[4 * b + (size_t)k] = tracer->room->balls[b].center[k];
    vertices[4 * b + 3] = tracer->room->balls[b].radius;
  }
  return attach(tracer, geometry, BALLS);
}

static pags_result build(pags_tracer *tracer) {
  /* One thread: what it builds from a few dozen primitives must not depend on how many there are. */
  tracer->device = rtcNewDevice("threads=1");
  if (!tracer->device)
    return pags_embree_failed(NULL);
  tracer->scene = rtcNewScene(tracer->device);
  if (!tracer->scene)
    return pags_embree_failed(tracer->device);
  PAGS_TRY(add_quads(tracer));
  PAGS_TRY(add_balls(tracer));
  rtcSetSceneFlags(tracer->scene, RTC_SCENE_FLAG_ROBUST); /* no ray slips through between two quads */
  rtcCommitScene(tracer->scene);
  return rtcGetDeviceError(tracer->device) == RTC_ERROR_NONE ? PAGS_OK : pags_embree_failed(tracer->device);
}

pags_result pags_tracer_create(const pags_room *room, pags_tracer **out) {
  *out = NULL;
  pags_tracer *tracer = calloc(1, sizeof *tracer);
  if (!tracer)
    return pags_out_of_memory("the ray tracer");
  tracer->room = room;
  const pags_result result = build(tracer);
  if (result == PAGS_OK)
    *out = tracer;
  else
    pags_tracer_destroy(tracer);
  return result;
}

void pags_tracer_destroy(pags_tracer *tracer) {
  if (!tracer)
    return;
  if (tracer->scene)
    rtcReleaseScene(tracer->scene);
  if (tracer->device)
    rtcReleaseDevice(tracer->device);
  free(tracer);
}

static struct RTCRay make_ray(const float origin[3], const float direction[3], float from) {
  return (struct RTCRay){.org_x = origin[0],
                         .org_y = origin[1],
                         .org_z = origin[2],
                         .dir_x = direction[0],
                         .dir_y = direction[1],
                         .dir_z = direction[2],
                         .tnear = from,
                         .tfar = INFINITY,
                         .mask = ~0u};
}

static void trace(RTCScene scene, struct RTCRayHit *ray) {
#if PAGS_EMBREE >= 4
  rtcIntersect1(scene, ray, NULL);
#else
  struct RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, ray);
#endif
}

static void trace_shadow(RTCScene scene, struct RTCRay *ray) {
#if PAGS_EMBREE >= 4
  rtcOccluded1(scene, ray, NULL);
#else
  struct RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, ray);
#endif
}

static void fill_surface(const pags_room *room, unsigned geometry, unsigned primitive, pags_hit *hit) {
  if (geometry == QUADS) {
    const pags_box *box = &room->boxes[primitive / 6];
    hit->texture = &box->texture;
    pags_box_local(box, hit->point, hit->local);
    return;
  }
  const pags_ball *ball = &room->balls[primitive];
  hit->texture = &ball->texture;
  for (int k = 0; k < 3; k++)
    hit->local[k] = hit->point[k] - ball->center[k];
}

bool pags_tracer_hit(const pags_tracer *tracer, const float origin[3], const float direction[3], pags_hit *hit) {
  struct RTCRayHit ray = {.ray = make_ray(origin, direction, 0.0f)};
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  trace(tracer->scene, &ray);
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID)
    return false;
  const float normal[3] = {ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z};
  float length = sqrtf(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
  if (normal[0] * direction[0] + normal[1] * direction[1] + normal[2] * direction[2] > 0.0f)
    length = -length;
  hit->distance = ray.ray.tfar;
  for (int k = 0; k < 3; k++) {
    hit->point[k] = origin[k] + hit->distance * direction[k];
    hit->normal[k] = normal[k] / length;
  }
  fill_surface(tracer->room, ray.hit.geomID, ray.hit.primID, hit);
  return true;
}

bool pags_tracer_blocked(const pags_tracer *tracer, const float origin[3], const float direction[3]) {
  struct RTCRay ray = make_ray(origin, direction, 1e-4f);
  trace_shadow(tracer->scene, &ray);
  return ray.tfar < 0.0f; /* -inf marks a hit */
}
