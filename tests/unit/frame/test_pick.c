/* SPDX-License-Identifier: Apache-2.0 */
/* Tests picking: the nearest hit is compared with a test of every Gaussian and with Embree, over rotated and packed
 * parts. Also tests the object that a hit reports. */
#include <pags/pick.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <pags/packed.h>
#include "base/rng.h"
#include "base/text.h"

#include <cmocka.h>

#if PAGS_EMBREE >= 4
#include <embree4/rtcore.h>
#elif PAGS_EMBREE
#include <embree3/rtcore.h>
#endif

enum { ROWS = 3000, RAYS = 400, PARTS = 2 };
static const double origin[3] = {500000, 4000, 10};

typedef struct world {
  pags_gaussians gaussians[PARTS];
  pags_clusters clusters[PARTS];
  pags_part parts[PARTS];
} world;

static double random_between(uint64_t stream, uint64_t index, double lo, double hi) {
  return lo + (hi - lo) * pags_rng_uniform(7, stream, index);
}

/* Fills a box of 20 m with flat, long and round Gaussians of every opacity, in Morton order. */
static void fill(pags_gaussians *g, uint64_t stream) {
  pags_gaussians loose;
  int64_t index[ROWS];
  assert_int_equal(pags_gaussians_create(&loose, ROWS, 0), PAGS_OK);
  for (int64_t i = 0; i < ROWS; i++) {
    uint64_t at = 16 * (uint64_t)i;
    for (int k = 0; k < 3; k++) {
      pags_plane(&loose, PAGS_MEAN + k)[i] = (float)random_between(stream, at++, -10, 10);
      pags_plane(&loose, PAGS_SCALE + k)[i] = (float)random_between(stream, at++, -4, -0.7);
    }
    for (int k = 0; k < 4; k++)
      pags_plane(&loose, PAGS_ROTATION + k)[i] = (float)random_between(stream, at++, -1, 1);
    pags_plane(&loose, PAGS_OPACITY)[i] = (float)random_between(stream, at++, -6, 4);
  }
  assert_int_equal(pags_gaussians_morton_order(&loose, index), PAGS_OK);
  assert_int_equal(pags_gaussians_create_like(g, ROWS, &loose), PAGS_OK);
  pags_gaussians_gather(&loose, index, ROWS, g);
  pags_gaussians_destroy(&loose);
}

/* Two parts, the second rotated about z and translated. */
static void make_world(world *w) {
  const double c = cos(0.7), s = sin(0.7),
               poses[PARTS][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, {c, -s, 0, 3, s, c, 0, -2, 0, 0, 1, 1}};
  for (int p = 0; p < PARTS; p++) {
    fill(&w->gaussians[p], (uint64_t)p);
    assert_int_equal(pags_clusters_create(&w->clusters[p], ROWS, 64), PAGS_OK);
    pags_clusters_update(&w->clusters[p], &w->gaussians[p], 0, w->clusters[p].count);
    w->gaussians[p].alpha_min = p ? 0.05f : 0.0f;
    w->parts[p] = (pags_part){.gaussians = &w->gaussians[p], .clusters = &w->clusters[p], .first_id = p * ROWS};
    memcpy(w->parts[p].world_from_model, poses[p], sizeof poses[p]);
  }
}

static void destroy_world(world *w) {
  for (int p = 0; p < PARTS; p++) {
    pags_gaussians_destroy(&w->gaussians[p]);
    pags_clusters_destroy(&w->clusters[p]);
  }
}

/* A ray from outside of the box through a point within; its direction isn't of unit length. */
static void make_ray(int number, double from[3], double along[3]) {
  for (int k = 0; k < 3; k++) {
    from[k] = origin[k] + random_between(9, 8 * (uint64_t)number + (uint64_t)k, -25, 25);
    along[k] = 0.3 * (origin[k] + random_between(10, 8 * (uint64_t)number + (uint64_t)k, -8, 8) - from[k]);
  }
  if (number % 10 == 0)
    along[number / 10 % 3] = 0;
}

typedef struct hit {
  double t, alpha;
  int32_t id;
} hit;

/* Intersects a ray with one Gaussian by the inverse covariance S^-1, a being the ray's origin relative to the mean
 * and d its direction: the largest density lies at t = -a' S^-1 d / d' S^-1 d, with m^2 = a' S^-1 a - (a' S^-1 d)^2 /
 * d' S^-1 d. */
static int meet(const pags_part *part, int64_t row, const double from[3], const double along[3], hit *out) {
  const pags_gaussians *g = part->gaussians;
  const double *m = part->world_from_model;
  double q[4], r[9], axis[3], aa = 0, ad = 0, dd = 0;
  for (int k = 0; k < 4; k++)
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[row];
  pags_rotation_from_quaternion(q, r);
  for (int k = 0; k < 3; k++) {
    double a = 0, d = 0, sigma = exp((double)pags_plane(g, PAGS_SCALE + k)[row]);
    for (int i = 0; i < 3; i++)
      axis[i] = m[4 * i] * r[k] + m[4 * i + 1] * r[3 + k] + m[4 * i + 2] * r[6 + k];
    for (int i = 0; i < 3; i++) {
      double mean = m[4 * i + 3] + origin[i];
      for (int j = 0; j < 3; j++)
        mean += m[4 * i + j] * (double)pags_plane(g, PAGS_MEAN + j)[row];
      a += axis[i] * (from[i] - mean);
      d += axis[i] * along[i];
    }
    aa += a * a / (sigma * sigma);
    ad += a * d / (sigma * sigma);
    dd += d * d / (sigma * sigma);
  }
  out->t = -ad / dd;
  const double least = g->alpha_min > 0 ? (double)g->alpha_min : 1.0 / 255;
  double alpha = exp(-0.5 * (aa - ad * ad / dd)) / (1 + exp(-(double)pags_plane(g, PAGS_OPACITY)[row]));
  const bool blended = alpha >= least;
  if (g->alpha_min > 0)
    alpha = (alpha - least) / (1 - least);
  out->alpha = fmin(0.99, alpha);
  out->id = part->first_id + (int32_t)row;
  return out->t >= 0 && blended;
}

static int compare_hits(const void *left, const void *right) {
  const hit *a = left, *b = right;
  return a->t < b->t ? -1 : a->t > b->t;
}

static int all_hits(const world *w, const double from[3], const double along[3], hit *hits) {
  int count = 0;
  for (int p = 0; p < PARTS; p++)
    for (int64_t i = 0; i < ROWS; i++)
      count += meet(&w->parts[p], i, from, along, &hits[count]);
  qsort(hits, (size_t)count, sizeof *hits, compare_hits);
  return count;
}

static void test_brute_force(void **state) {
  (void)state;
  static const double blocked[3] = {0, 0.5, 0.95};
  hit *hits = malloc(PARTS * ROWS * sizeof *hits);
  int met = 0, missed = 0;
  world w;
  make_world(&w);
  for (int n = 0; n < RAYS; n++) {
    double from[3], along[3];
    make_ray(n, from, along);
    int count = all_hits(&w, from, along, hits);
    for (int b = 0; b < 3; b++) {
      pags_pick_options options = pags_pick_options_default();
      pags_picked picked;
      memcpy(options.origin, origin, sizeof origin);
      options.blocked = blocked[b];
      assert_int_equal(pags_pick(w.parts, PARTS, from, along, &options, &picked), PAGS_OK);
      double left = 1;
      int at = 0;
      while (at < count && 1 - left * (1 - hits[at].alpha) < blocked[b])
        left *= 1 - hits[at++].alpha;
      if (at == count) {
        assert_int_equal(picked.part, -1);
        missed++;
        continue;
      }
      met++;
      assert_int_equal(picked.id, hits[at].id);
      assert_true(fabs(picked.depth - hits[at].t) < 1e-6);
      assert_true(fabs(picked.alpha - hits[at].alpha) < 1e-5);
      assert_int_equal(picked.id, w.parts[picked.part].first_id + picked.row);
      for (int k = 0; k < 3; k++)
        assert_true(fabs(picked.point[k] - from[k] - picked.depth * along[k]) < 1e-9);
    }
  }
  assert_true(met > RAYS / 2 && missed > 0);
  free(hits);
  destroy_world(&w);
}

/* A part scaled by its pose is picked like a part of scaled means and sigmas; ids count from id_base. */
static void test_scaled_part(void **state) {
  (void)state;
  const double scale = 0.4;
  world w, scaled;
  int met = 0;
  make_world(&w);
  make_world(&scaled);
  pags_gaussians *g = &w.gaussians[1];
  for (int64_t i = 0; i < ROWS; i++)
    for (int k = 0; k < 3; k++) {
      pags_plane(g, PAGS_MEAN + k)[i] *= (float)scale;
      pags_plane(g, PAGS_SCALE + k)[i] += (float)log(scale);
    }
  pags_clusters_update(&w.clusters[1], g, 0, w.clusters[1].count);
  for (int k = 0; k < 12; k++)
    scaled.parts[1].world_from_model[k] *= k % 4 < 3 ? scale : 1;
  scaled.parts[1].id_base = 100000;
  for (int n = 0; n < RAYS; n++) {
    double from[3], along[3];
    pags_pick_options options = pags_pick_options_default();
    pags_picked wanted, found;
    make_ray(n, from, along);
    memcpy(options.origin, origin, sizeof origin);
    assert_int_equal(pags_pick(w.parts, PARTS, from, along, &options, &wanted), PAGS_OK);
    assert_int_equal(pags_pick(scaled.parts, PARTS, from, along, &options, &found), PAGS_OK);
    assert_int_equal(found.part, wanted.part);
    if (found.part != 1)
      continue;
    met++;
    assert_int_equal(found.id, wanted.id + 100000);
    assert_true(fabs(found.depth - wanted.depth) < 1e-5); /* means are rounded to float once more */
  }
  assert_true(met > RAYS / 20);
  destroy_world(&w);
  destroy_world(&scaled);
}

/* Only hits between the options' nearest and farthest distance count. */
static void test_limits(void **state) {
  (void)state;
  hit *hits = malloc(PARTS * ROWS * sizeof *hits);
  pags_pick_options options = pags_pick_options_default();
  pags_picked picked;
  world w;
  make_world(&w);
  memcpy(options.origin, origin, sizeof origin);
  options.blocked = 0;
  for (int n = 0; n < 40; n++) {
    double from[3], along[3];
    make_ray(n, from, along);
    int count = all_hits(&w, from, along, hits);
    if (count < 4)
      continue;
    options.nearest = 0.5 * (hits[1].t + hits[2].t);
    options.farthest = HUGE_VAL;
    assert_int_equal(pags_pick(w.parts, PARTS, from, along, &options, &picked), PAGS_OK);
    assert_int_equal(picked.id, hits[2].id);
    options.nearest = 0;
    options.farthest = 0.5 * hits[0].t;
    assert_int_equal(pags_pick(w.parts, PARTS, from, along, &options, &picked), PAGS_OK);
    assert_int_equal(picked.part, -1);
  }
  free(hits);
  destroy_world(&w);
}

/* A ray that passes a single Gaussian of opacity 0.99 at 3 sigma hits it (alpha 0.011); at 3.5 sigma it doesn't
 * (0.0022). The cluster's bounds must extend to that distance, though it has no other Gaussian. */
static void test_grazing(void **state) {
  (void)state;
  pags_pick_options options = pags_pick_options_default();
  pags_gaussians g;
  pags_clusters clusters;
  pags_picked picked;
  assert_int_equal(pags_gaussians_create(&g, 1, 0), PAGS_OK);
  for (int k = 0; k < 3; k++) {
    pags_plane(&g, PAGS_MEAN + k)[0] = 0;
    pags_plane(&g, PAGS_SCALE + k)[0] = (float)log(0.1);
    pags_plane(&g, PAGS_ROTATION + 1 + k)[0] = 0;
  }
  pags_plane(&g, PAGS_ROTATION)[0] = 1;
  pags_plane(&g, PAGS_OPACITY)[0] = (float)log(0.99 / 0.01);
  assert_int_equal(pags_clusters_create(&clusters, 1, 64), PAGS_OK);
  pags_clusters_update(&clusters, &g, 0, clusters.count);
  const pags_part part = {
      .gaussians = &g, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  options.blocked = 0;
  for (int axis = 0; axis < 3; axis++)
    for (int out = 0; out < 2; out++) {
      double from[3] = {0, 0, 0}, along[3] = {0, 0, 0};
      from[axis] = -5;
      from[(axis + 1) % 3] = out ? 0.35 : 0.3;
      along[axis] = 1;
      assert_int_equal(pags_pick(&part, 1, from, along, &options, &picked), PAGS_OK);
      assert_int_equal(picked.part, out ? -1 : 0);
      if (!out)
        assert_true(fabs(picked.depth - 5) < 1e-5);
    }
  pags_clusters_destroy(&clusters);
  pags_gaussians_destroy(&g);
}

/* Packing rounds positions, so that another Gaussian of nearly the same depth may be picked: all depths agree, and
 * nearly all ids. */
static void test_packed(void **state) {
  (void)state;
  pags_packed packed[PARTS];
  world w;
  int same = 0, both = 0;
  make_world(&w);
  pags_part parts[PARTS];
  for (int p = 0; p < PARTS; p++) {
    assert_int_equal(pags_packed_create(&w.gaussians[p], &packed[p]), PAGS_OK);
    parts[p] = w.parts[p];
    parts[p].packed = &packed[p];
    parts[p].gaussians = &packed[p].shape;
    parts[p].clusters = &packed[p].clusters;
  }
  for (int n = 0; n < RAYS; n++) {
    double from[3], along[3];
    pags_pick_options options = pags_pick_options_default();
    pags_picked a, b;
    make_ray(n, from, along);
    memcpy(options.origin, origin, sizeof origin);
    assert_int_equal(pags_pick(w.parts, PARTS, from, along, &options, &a), PAGS_OK);
    assert_int_equal(pags_pick(parts, PARTS, from, along, &options, &b), PAGS_OK);
    both += a.part >= 0 && b.part >= 0;
    same += a.part >= 0 && b.part >= 0 && a.id == b.id && fabs(a.depth - b.depth) < 1e-3;
  }
  assert_true(both > RAYS / 4 && same > both * 95 / 100);
  for (int p = 0; p < PARTS; p++)
    pags_packed_destroy(&packed[p]);
  destroy_world(&w);
}

static void test_bad_rays(void **state) {
  (void)state;
  const double from[3] = {0, 0, 0}, nowhere[3] = {0, 0, 0}, along[3] = {1, 0, 0}, lost[3] = {(double)NAN, 0, 0};
  pags_picked picked;
  assert_int_equal(pags_pick(NULL, 0, from, nowhere, NULL, &picked), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_pick(NULL, 0, lost, along, NULL, &picked), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_pick(NULL, 0, from, along, NULL, &picked), PAGS_OK);
  assert_int_equal(picked.part, -1);
}

/* A scene of a parked object in the background model and a moving object ten metres further. */
static void test_objects(void **state) {
  (void)state;
  pags_scene scene = {.up = PAGS_UP_Z, .model_count = 2, .object_count = 2};
  memcpy(scene.origin, origin, sizeof origin);
  scene.models = calloc(2, sizeof *scene.models);
  scene.objects = calloc(2, sizeof *scene.objects);
  for (int i = 0; i < 2; i++) {
    pags_gaussians *g = &scene.models[i].gaussians;
    scene.models[i].name = pags_text_copy(i ? "car" : "background");
    assert_int_equal(pags_gaussians_create(g, 1, 0), PAGS_OK);
    pags_plane(g, PAGS_MEAN)[0] = i ? 0 : 5;
    for (int k = 0; k < 3; k++)
      pags_plane(g, PAGS_SCALE + k)[0] = -1;
    pags_plane(g, PAGS_ROTATION)[0] = 1;
    pags_plane(g, PAGS_OPACITY)[0] = 4;
    pags_object *o = &scene.objects[i].record;
    scene.objects[i].model = i ? 1 : -1;
    scene.objects[i].critical = i;
    o->id = pags_text_copy(i ? "car_1" : "hydrant_0");
    o->class_name = pags_text_copy(i ? "Car" : "Hydrant");
    o->size[0] = o->size[1] = o->size[2] = 2;
    o->moving = i;
    o->keyframe_count = 1;
    o->keyframes = calloc(1, sizeof *o->keyframes);
    double *pose = o->keyframes[0].world_from_object;
    pose[0] = pose[5] = pose[10] = 1;
    for (int k = 0; k < 3; k++)
      pose[4 * k + 3] = origin[k] + (k ? 0 : i ? 15 : 5);
  }
  assert_int_equal(pags_gaussians_add_object_id(&scene.models[0].gaussians), PAGS_OK);
  scene.models[0].gaussians.object_id[0] = 0;
  pags_composition *composition;
  const pags_part *parts;
  int count;
  assert_int_equal(pags_composition_create(&scene, &composition), PAGS_OK);
  pags_compose(composition, 0, &parts, &count);
  assert_int_equal(count, 2);
  const double from[3] = {origin[0], origin[1], origin[2]}, ahead[3] = {1, 0, 0}, back[3] = {-1, 0, 0};
  const double behind[3] = {origin[0] + 30, origin[1], origin[2]};
  pags_picked picked;
  assert_int_equal(pags_composition_pick(composition, parts, count, from, ahead, NULL, &picked), PAGS_OK);
  assert_int_equal(picked.object, 0);
  assert_string_equal(picked.class_name, "Hydrant");
  assert_true(fabs(picked.depth - 5) < 1e-6);
  assert_int_equal(pags_composition_pick(composition, parts, count, behind, back, NULL, &picked), PAGS_OK);
  assert_int_equal(picked.object, 1);
  assert_string_equal(picked.class_name, "Car");
  assert_string_equal(picked.object_id, "car_1");
  assert_int_equal(picked.critical, 1);
  assert_int_equal(picked.id, 1);
  assert_true(fabs(picked.depth - 15) < 1e-6);
  assert_int_equal(pags_composition_pick(composition, parts, count, from, back, NULL, &picked), PAGS_OK);
  assert_int_equal(picked.part, -1);
  pags_composition_destroy(composition);
}

#ifdef PAGS_EMBREE
typedef struct ray_query {
  struct RTCIntersectContext context; /* must be the first member */
  double from[3], along[3];
} ray_query;

/* The bounding box for Embree, which contains the region where alpha reaches 1/255: 3.4 sigmas of the largest axis in
 * every direction. */
static void bounds_of(const struct RTCBoundsFunctionArguments *arguments) {
  const world *w = arguments->geometryUserPtr;
  const pags_part *part = &w->parts[arguments->primID / ROWS];
  int64_t row = arguments->primID % ROWS;
  const double *m = part->world_from_model;
  double reach = 0, mean[3];
  for (int k = 0; k < 3; k++) {
    reach = fmax(reach, 3.4 * exp((double)pags_plane(part->gaussians, PAGS_SCALE + k)[row]));
    mean[k] = m[4 * k + 3];
    for (int j = 0; j < 3; j++)
      mean[k] += m[4 * k + j] * (double)pags_plane(part->gaussians, PAGS_MEAN + j)[row];
  }
  struct RTCBounds *b = arguments->bounds_o;
  b->lower_x = (float)(mean[0] - reach), b->upper_x = (float)(mean[0] + reach);
  b->lower_y = (float)(mean[1] - reach), b->upper_y = (float)(mean[1] + reach);
  b->lower_z = (float)(mean[2] - reach), b->upper_z = (float)(mean[2] + reach);
}

static void intersect(const struct RTCIntersectFunctionNArguments *arguments) {
  const world *w = arguments->geometryUserPtr;
  const ray_query *query = (const ray_query *)(const void *)arguments->context;
  struct RTCRayHit *ray = (struct RTCRayHit *)arguments->rayhit;
  hit met;
  if (!arguments->valid[0] ||
      !meet(&w->parts[arguments->primID / ROWS], arguments->primID % ROWS, query->from, query->along, &met) ||
      !((float)met.t < ray->ray.tfar))
    return;
  ray->ray.tfar = (float)met.t;
  ray->hit.primID = arguments->primID;
  ray->hit.geomID = arguments->geomID;
}

/* The nearest hit found by Embree's BVH. */
static void test_embree(void **state) {
  (void)state;
  world w;
  int met = 0;
  make_world(&w);
  RTCDevice device = rtcNewDevice("threads=1");
  RTCScene scene = rtcNewScene(device);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, PARTS * ROWS);
  rtcSetGeometryUserData(geometry, &w);
  rtcSetGeometryBoundsFunction(geometry, bounds_of, NULL);
  rtcSetGeometryIntersectFunction(geometry, intersect);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  for (int n = 0; n < RAYS; n++) {
    ray_query query;
    pags_pick_options options = pags_pick_options_default();
    pags_picked picked;
    make_ray(n, query.from, query.along);
    memcpy(options.origin, origin, sizeof origin);
    options.blocked = 0;
    assert_int_equal(pags_pick(w.parts, PARTS, query.from, query.along, &options, &picked), PAGS_OK);
    struct RTCRayHit ray = {.ray = {.org_x = (float)(query.from[0] - origin[0]),
                                    .org_y = (float)(query.from[1] - origin[1]),
                                    .org_z = (float)(query.from[2] - origin[2]),
                                    .dir_x = (float)query.along[0],
                                    .dir_y = (float)query.along[1],
                                    .dir_z = (float)query.along[2],
                                    .tfar = INFINITY,
                                    .mask = ~0u}};
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcInitIntersectContext(&query.context);
    rtcIntersect1(scene, &query.context, &ray);
    assert_int_equal(picked.part >= 0, ray.hit.geomID != RTC_INVALID_GEOMETRY_ID);
    if (picked.part < 0)
      continue;
    met++;
    assert_int_equal(picked.id, ray.hit.primID);
  }
  assert_true(met > RAYS / 2);
  rtcReleaseScene(scene);
  rtcReleaseDevice(device);
  destroy_world(&w);
}
#endif

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_brute_force), cmocka_unit_test(test_scaled_part), cmocka_unit_test(test_limits),
      cmocka_unit_test(test_grazing),     cmocka_unit_test(test_packed),      cmocka_unit_test(test_bad_rays),
      cmocka_unit_test(test_objects),
#ifdef PAGS_EMBREE
      cmocka_unit_test(test_embree),
#endif
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
