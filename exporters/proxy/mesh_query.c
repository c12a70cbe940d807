/* SPDX-License-Identifier: Apache-2.0 */
/* Nearest points, distances and ray hits on a triangle mesh or a point cloud, by Embree's bounding volume
 * hierarchies. This is the only file of the exporters that includes Embree (base/embree.h). */
#include "exporters/proxy/mesh_query.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/embree.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

struct pags_mesh_query {
  RTCDevice device;
  RTCScene scene;
  const float *points;       /* the mesh's vertices, or the points of the cloud */
  const uint32_t *triangles; /* NULL: the query is over points */
};

/* A search for the nearest point, and its best result. */
typedef struct nearest_query {
  const pags_mesh_query *query;
  double point[3];
  double best;    /* squared distance */
  double foot[3]; /* the nearest point, relative to `point` */
  uint32_t primitive;
} nearest_query;

/* ---- Nearest points ---- */

/* Returns the squared distance from the origin to the triangle a, b, c: to its plane if the foot of the perpendicular
 * lies in the triangle, else to the nearest edge. `foot` receives the nearest point. */
static double triangle_distance(const double a[3], const double b[3], const double c[3], double foot[3]) {
  const double *corners[3] = {a, b, c};
  double u[3], v[3], n[3], nearest = HUGE_VAL;
  bool inside = true;
  pags_subtract3(b, a, u);
  pags_subtract3(c, a, v);
  pags_cross3(u, v, n);
  double area = pags_dot3(n, n);
  for (int i = 0; i < 3; i++) {
    const double *p = corners[i], *q = corners[(i + 1) % 3];
    double edge[3], side[3], at[3];
    pags_subtract3(q, p, edge);
    pags_cross3(n, edge, side);
    inside = inside && pags_dot3(side, p) <= 0;
    double length = pags_dot3(edge, edge), t = length > 0 ? fmin(fmax(-pags_dot3(edge, p) / length, 0), 1) : 0;
    pags_along3(p, t, edge, at);
    if (pags_dot3(at, at) < nearest) {
      nearest = pags_dot3(at, at);
      pags_copy3(at, foot);
    }
  }
  if (!inside || !(area > 0))
    return nearest;
  double height = pags_dot3(n, a);
  pags_scale3(height / area, n, foot);
  return height * height / area;
}

/* Embree's callback for each primitive whose bounds the query sphere touches: keeps the primitive if it is nearer
 * than the current best, and shrinks the sphere. */
static bool visit(struct RTCPointQueryFunctionArguments *arguments) {
  nearest_query *q = arguments->userPtr;
  double corner[3][3], foot[3], squared;
  int corners = q->query->triangles ? 3 : 1;
  for (int i = 0; i < corners; i++) {
    uint32_t at = corners == 3 ? q->query->triangles[3 * (size_t)arguments->primID + (size_t)i] : arguments->primID;
    pags_widen3(q->query->points + 3 * (size_t)at, corner[i]);
    pags_subtract3(corner[i], q->point, corner[i]);
  }
  pags_copy3(corner[0], foot);
  squared = corners == 3 ? triangle_distance(corner[0], corner[1], corner[2], foot) : pags_dot3(foot, foot);
  if (!(squared < q->best))
    return false;
  q->best = squared;
  pags_copy3(foot, q->foot);
  q->primitive = arguments->primID;
  /* The radius is rounded up to float, so that rounding skips no primitive that is nearer than or as near as this. */
  arguments->query->radius = pags_nextafterf((float)sqrt(squared), INFINITY);
  return true;
}

/* ---- Building ---- */

static void point_bounds(const struct RTCBoundsFunctionArguments *arguments) {
  const pags_mesh_query *query = arguments->geometryUserPtr;
  const float *p = query->points + 3 * (size_t)arguments->primID;
  *arguments->bounds_o = (struct RTCBounds){
      .lower_x = p[0], .lower_y = p[1], .lower_z = p[2], .upper_x = p[0], .upper_y = p[1], .upper_z = p[2]};
}

static pags_result attach(pags_mesh_query *query, RTCGeometry geometry) {
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(query->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcSetSceneFlags(query->scene, RTC_SCENE_FLAG_ROBUST);
  rtcCommitScene(query->scene);
  return pags_embree_check(query->device);
}

/* Opens a query over `points` and, unless it is NULL, `triangles`; the caller adds a geometry. */
static pags_result open_query(const float *points, const uint32_t *triangles, pags_mesh_query **out) {
  pags_mesh_query *query = *out = calloc(1, sizeof *query);
  PAGS_CHECK_MEMORY(query, triangles ? "a mesh" : "points");
  *query = (pags_mesh_query){.device = pags_embree_device(), .points = points, .triangles = triangles};
  if (query->device)
    query->scene = rtcNewScene(query->device);
  return query->scene ? PAGS_OK : pags_embree_failed(query->device);
}

pags_result pags_mesh_query_of_mesh(const pags_proxy_mesh *surface, pags_mesh_query **out) {
  PAGS_AUTO(pags_mesh_query_destroy_auto) pags_mesh_query *query = NULL;
  *out = NULL;
  PAGS_TRY(open_query(surface->positions, surface->triangles, &query));
  RTCGeometry geometry = rtcNewGeometry(query->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  if (!geometry)
    return pags_embree_failed(query->device);
  /* Embree reads 16 bytes at each vertex of 12, so that a shared array would need padding behind the last vertex. The
   * vertices are copied into a buffer of Embree's instead. */
  float *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12,
                                            (size_t)surface->vertex_count);
  uint32_t *triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12,
                                                (size_t)surface->triangle_count);
  if (!vertices || !triangles) {
    rtcReleaseGeometry(geometry);
    return pags_embree_failed(query->device);
  }
  for (int64_t i = 0; i < 3 * surface->vertex_count; i++)
    vertices[i] = surface->positions[i];
  for (int64_t i = 0; i < 3 * surface->triangle_count; i++)
    triangles[i] = surface->triangles[i];
  PAGS_TRY(attach(query, geometry));
  *out = pags_take(&query);
  return PAGS_OK;
}

pags_result pags_mesh_query_of_points(const float *points, int64_t count, pags_mesh_query **out) {
  PAGS_AUTO(pags_mesh_query_destroy_auto) pags_mesh_query *query = NULL;
  *out = NULL;
  PAGS_TRY(open_query(points, NULL, &query));
  /* Embree has no geometry of bare points: they are user primitives with boxes of zero size as bounds. */
  RTCGeometry geometry = rtcNewGeometry(query->device, RTC_GEOMETRY_TYPE_USER);
  if (!geometry)
    return pags_embree_failed(query->device);
  rtcSetGeometryUserPrimitiveCount(geometry, (unsigned)count);
  rtcSetGeometryUserData(geometry, query);
  rtcSetGeometryBoundsFunction(geometry, point_bounds, NULL);
  PAGS_TRY(attach(query, geometry));
  *out = pags_take(&query);
  return PAGS_OK;
}

void pags_mesh_query_destroy(pags_mesh_query *query) {
  if (!query)
    return;
  if (query->scene)
    rtcReleaseScene(query->scene);
  if (query->device)
    rtcReleaseDevice(query->device);
  free(query);
}

/* ---- Asking ---- */

static nearest_query ask(const pags_mesh_query *query, const double point[3]) {
  nearest_query q = {
      .query = query, .point = {point[0], point[1], point[2]}, .best = HUGE_VAL, .primitive = UINT32_MAX};
  struct RTCPointQuery sphere = {
      .x = (float)point[0], .y = (float)point[1], .z = (float)point[2], .time = 0, .radius = INFINITY};
  struct RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(query->scene, &sphere, &context, visit, &q);
  return q;
}

double pags_mesh_query_distance(const pags_mesh_query *query, const double point[3], uint32_t *primitive) {
  nearest_query q = ask(query, point);
  if (primitive)
    *primitive = q.primitive;
  return sqrt(q.best);
}

double pags_mesh_query_nearest(const pags_mesh_query *query, const double point[3], double nearest[3]) {
  nearest_query q = ask(query, point);
  pags_add3(point, q.foot, nearest);
  return sqrt(q.best);
}

double pags_mesh_query_ray(const pags_mesh_query *query, const double origin[3], const double direction[3],
                           uint32_t *primitive) {
  struct RTCRayHit ray = {.ray = {.org_x = (float)origin[0],
                                  .org_y = (float)origin[1],
                                  .org_z = (float)origin[2],
                                  .dir_x = (float)direction[0],
                                  .dir_y = (float)direction[1],
                                  .dir_z = (float)direction[2],
                                  .tfar = INFINITY,
                                  .mask = ~0u}};
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
#if PAGS_EMBREE >= 4
  rtcIntersect1(query->scene, &ray, NULL);
#else
  struct RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(query->scene, &context, &ray);
#endif
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID)
    return -1;
  if (primitive)
    *primitive = ray.hit.primID;
  return (double)ray.ray.tfar;
}
