/* SPDX-License-Identifier: Apache-2.0 */
/* Ray tracing with Embree: one scene for each mesh, and a top scene of instances of them, whose poses may change from
 * frame to frame. */
#include "synth/stage.h"

#include <math.h>

#include "base/embree.h"
#include "base/vec3.h"

struct pags_stage {
  const pags_mesh *meshes;
  const pags_stage_placement *placements;
  int mesh_count, placement_count;
  RTCDevice device;
  RTCScene *parts;        /* one for each mesh */
  RTCGeometry *instances; /* one for each placement */
  RTCScene scene;
};

/* ---- Building the scenes ---- */

pags_result pags_stage_create(const pags_mesh *meshes, int mesh_count, const pags_stage_placement *placements,
                              int placement_count, pags_stage **out) {
  *out = NULL;
  PAGS_AUTO(pags_stage_destroy_auto) pags_stage *stage = calloc(1, sizeof *stage);
  PAGS_CHECK_MEMORY(stage, "the ray tracer");
  *stage = (pags_stage){
      .meshes = meshes, .placements = placements, .mesh_count = mesh_count, .placement_count = placement_count};
  stage->device = pags_embree_device();
  stage->parts = calloc((size_t)stage->mesh_count + 1, sizeof(RTCScene));
  stage->instances = calloc((size_t)stage->placement_count + 1, sizeof(RTCGeometry));
  PAGS_CHECK_MEMORY(stage->parts && stage->instances, "the ray tracer");
  if (!stage->device)
    return pags_embree_failed(NULL);
  for (int i = 0; i < stage->mesh_count; i++) {
    /* The mesh's own scene: its quads. Vertices and faces are shared with Embree, not copied. */
    const pags_mesh *mesh = &stage->meshes[i];
    stage->parts[i] = rtcNewScene(stage->device);
    RTCGeometry geometry = rtcNewGeometry(stage->device, RTC_GEOMETRY_TYPE_QUAD);
    if (!stage->parts[i] || !geometry)
      return pags_embree_failed(stage->device);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, mesh->vertices, 0,
                               sizeof(pags_vertex), (size_t)mesh->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4, mesh->faces, 0, 16,
                               (size_t)mesh->face_count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(stage->parts[i], geometry, 0);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(stage->parts[i], RTC_SCENE_FLAG_ROBUST);
    rtcCommitScene(stage->parts[i]);
    PAGS_TRY(pags_embree_check(stage->device));
  }
  stage->scene = rtcNewScene(stage->device);
  if (!stage->scene)
    return pags_embree_failed(stage->device);
  rtcSetSceneFlags(stage->scene, RTC_SCENE_FLAG_ROBUST);
  for (int i = 0; i < stage->placement_count; i++) {
    /* An instance of the mesh's scene; its pose is set by pags_stage_commit. */
    RTCGeometry instance = rtcNewGeometry(stage->device, RTC_GEOMETRY_TYPE_INSTANCE);
    if (!instance)
      return pags_embree_failed(stage->device);
    stage->instances[i] = instance;
    rtcSetGeometryInstancedScene(instance, stage->parts[stage->placements[i].mesh]);
    rtcSetGeometryTimeStepCount(instance, 1);
    rtcAttachGeometryByID(stage->scene, instance, (unsigned)i);
  }
  PAGS_TRY(pags_stage_commit(stage, 0, stage->placement_count));
  *out = pags_take(&stage);
  return PAGS_OK;
}

void pags_stage_destroy(pags_stage *stage) {
  if (!stage)
    return;
  for (int i = 0; stage->instances && i < stage->placement_count; i++)
    if (stage->instances[i])
      rtcReleaseGeometry(stage->instances[i]);
  if (stage->scene)
    rtcReleaseScene(stage->scene);
  for (int i = 0; stage->parts && i < stage->mesh_count; i++)
    if (stage->parts[i])
      rtcReleaseScene(stage->parts[i]);
  if (stage->device)
    rtcReleaseDevice(stage->device);
  free(stage->parts);
  free(stage->instances);
  free(stage);
}

pags_result pags_stage_commit(pags_stage *stage, int first, int count) {
  for (int i = first; i < first + count; i++) {
    rtcSetGeometryTransform(stage->instances[i], 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, stage->placements[i].pose);
    rtcCommitGeometry(stage->instances[i]);
  }
  rtcCommitScene(stage->scene);
  return pags_embree_check(stage->device);
}

/* ---- Tracing rays ---- */

/* Fills an Embree packet with the active rays, each to be traced over distances [from, to]; lanes that are not active
 * get an empty range. */
static void load_rays(const pags_rays *rays, float from, float to, struct RTCRay8 *out, int valid[PAGS_PACKET]) {
  memset(out, 0, sizeof *out);
  for (int i = 0; i < PAGS_PACKET; i++) {
    valid[i] = rays->active >> i & 1u ? -1 : 0;
    out->tfar[i] = -INFINITY;
    out->dir_z[i] = 1.0f; /* Embree reads inactive lanes, too: they need a valid direction */
    if (!valid[i])
      continue;
    out->org_x[i] = rays->origin[i][0];
    out->org_y[i] = rays->origin[i][1];
    out->org_z[i] = rays->origin[i][2];
    out->dir_x[i] = rays->direction[i][0];
    out->dir_y[i] = rays->direction[i][1];
    out->dir_z[i] = rays->direction[i][2];
    out->tnear[i] = from;
    out->tfar[i] = to;
    out->mask[i] = ~0u;
  }
}

/* Normalises n and flips it, if needed, so that it points against `direction`, towards the ray's origin. */
static void face_ray(float n[3], const float direction[3]) {
  const float length = pags_length3f(n), towards = pags_dot3f(n, direction) > 0.0f ? -1.0f : 1.0f;
  pags_scale3f(towards / (length > 0.0f ? length : 1.0f), n, n);
}

/* Fills `out` for lane i of a traced packet; the point is left to the caller. */
static void fill_touch(const pags_stage *stage, const struct RTCRayHit8 *ray, int i, const float direction[3],
                       pags_touch *out) {
  const pags_stage_placement *placement = &stage->placements[ray->hit.instID[0][i]];
  const pags_mesh *mesh = &stage->meshes[placement->mesh];
  const uint32_t face = ray->hit.primID[i];
  const float flat[3] = {ray->hit.Ng_x[i], ray->hit.Ng_y[i], ray->hit.Ng_z[i]};
  float weight[4], smooth[3] = {0};
  *out = (pags_touch){.distance = ray->ray.tfar[i],
                      .placement = (int)ray->hit.instID[0][i],
                      .face = face,
                      .material = mesh->materials[face]};

  /* Weights of the quad's corners. Embree splits a quad into the triangles of corners 0 1 3 and 2 3 1; in the second
   * one, u and v count backwards from 1. */
  const bool second = ray->hit.u[i] + ray->hit.v[i] > 1.0f;
  weight[0] = second ? 0.0f : 1.0f - ray->hit.u[i] - ray->hit.v[i];
  weight[1] = second ? 1.0f - ray->hit.v[i] : ray->hit.u[i];
  weight[2] = second ? ray->hit.u[i] + ray->hit.v[i] - 1.0f : 0.0f;
  weight[3] = second ? 1.0f - ray->hit.u[i] : ray->hit.v[i];

  for (int c = 0; c < 4; c++) {
    const pags_vertex *vertex = &mesh->vertices[mesh->faces[4 * face + (uint32_t)c]];
    pags_add_scaled3f(weight[c], vertex->position, out->local);
    pags_add_scaled3f(weight[c], vertex->normal, smooth);
    out->uv[0] += weight[c] * vertex->uv[0];
    out->uv[1] += weight[c] * vertex->uv[1];
  }
  const bool has_smooth = pags_dot3f(smooth, smooth) > 0.01f;
  pags_rotate3f(placement->pose, flat, out->flat);
  pags_rotate3f(placement->pose, has_smooth ? smooth : flat, out->normal);
  face_ray(out->flat, direction);
  face_ray(out->normal, direction);
}

unsigned pags_stage_trace(const pags_stage *stage, const pags_rays *rays, pags_touch touches[PAGS_PACKET]) {
  struct RTCRayHit8 ray;
  int valid[PAGS_PACKET] __attribute__((aligned(32)));
  unsigned met = 0;
  load_rays(rays, 0.0f, INFINITY, &ray.ray, valid);
  for (int i = 0; i < PAGS_PACKET; i++)
    ray.hit.geomID[i] = ray.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
#if PAGS_EMBREE >= 4
  struct RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect8(valid, stage->scene, &ray, &arguments);
#else
  struct RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect8(valid, stage->scene, &context, &ray);
#endif
  for (int i = 0; i < PAGS_PACKET; i++)
    if (valid[i] && ray.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID) {
      met |= 1u << i;
      fill_touch(stage, &ray, i, rays->direction[i], &touches[i]);
      pags_along3f(rays->origin[i], touches[i].distance, rays->direction[i], touches[i].point);
    }
  return met;
}

unsigned pags_stage_blocked(const pags_stage *stage, const pags_rays *rays, bool parallel) {
  struct RTCRay8 ray;
  int valid[PAGS_PACKET] __attribute__((aligned(32)));
  unsigned blocked = 0;
  load_rays(rays, 1e-4f, INFINITY, &ray, valid);
#if PAGS_EMBREE >= 4
  struct RTCOccludedArguments arguments;
  rtcInitOccludedArguments(&arguments);
  if (parallel)
    arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcOccluded8(valid, stage->scene, &ray, &arguments);
#else
  struct RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (parallel)
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcOccluded8(valid, stage->scene, &context, &ray);
#endif
  for (int i = 0; i < PAGS_PACKET; i++)
    if (valid[i] && ray.tfar[i] < 0.0f) /* Embree sets tfar to -infinity on a hit */
      blocked |= 1u << i;
  return blocked;
}
