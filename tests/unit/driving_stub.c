/* SPDX-License-Identifier: Apache-2.0 */
/* A synthetic driving data set in memory whose geometry and colours are known exactly; see driving_stub.h. */
#include "unit/driving_stub.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const uint8_t stub_road[3] = {90, 90, 90}, stub_wall[3] = {40, 160, 60}, stub_sky[3] = {60, 120, 240},
              stub_magenta[3] = {255, 0, 255};
const uint8_t stub_colours[STUB_OBJECTS][3] = {{200, 30, 30}, {240, 240, 240}, {230, 220, 20}, {10, 10, 10}};

enum { AZIMUTHS = 160, BEAMS = 48 };

static const double pi = 3.14159265358979323846;
static const double stub_origin[3] = {1000, 2000, 0};

struct pags_dataset {
  pags_view views[STUB_STEPS];
  pags_sweep sweeps[STUB_STEPS];
  pags_object objects[STUB_OBJECTS];
  char names[STUB_STEPS][16];
};

struct pags_photo_cache {
  const pags_dataset *dataset;
  uint8_t rgb[3 * STUB_WIDTH * STUB_HEIGHT], labels[STUB_WIDTH * STUB_HEIGHT];
};

static void make_object(pags_object *o, int index) {
  static const double sizes[STUB_OBJECTS][3] = {{4, 2, 1.6}, {2, 2, 2}, {0.6, 0.6, 1.8}, {4, 2, 1.6}};
  static const double begin[STUB_OBJECTS][2] = {{12, -6}, {15, 6}, {9, -3.5}, {-10, -6}};
  static const double speed[STUB_OBJECTS] = {1.5, 0, 0.4, 1.5};
  *o = (pags_object){.category = index == STUB_WALKER ? PAGS_CATEGORY_PEDESTRIAN : PAGS_CATEGORY_VEHICLE,
                     .moving = speed[index] > 0,
                     .keyframe_count = STUB_STEPS};
  memcpy(o->size, sizes[index], sizeof o->size);
  o->keyframes = calloc(STUB_STEPS, sizeof *o->keyframes);
  for (int t = 0; t < STUB_STEPS; t++) {
    /* The objects' poses: their forward axis is world +y, their left axis is world -x. */
    const double pose[12] = {0, -1, 0, stub_origin[0] + begin[index][0],
                             1, 0,  0, stub_origin[1] + begin[index][1] + speed[index] * t,
                             0, 0,  1, 0.5 * sizes[index][2]};
    o->keyframes[t] = (pags_keyframe){.frame = t, .trained = t != STUB_HELD_OUT, .time = 0.1 * t};
    memcpy(o->keyframes[t].world_from_object, pose, sizeof pose);
  }
}

pags_dataset *stub_open(void) {
  pags_dataset *d = calloc(1, sizeof *d);
  for (int i = 0; i < STUB_OBJECTS; i++)
    make_object(&d->objects[i], i);
  for (int t = 0; t < STUB_STEPS; t++) {
    const double camera[12] = {0, 0, 1, stub_origin[0] + 0.5 * t, -1, 0, 0, stub_origin[1], 0, -1, 0, 1.5};
    /* The LiDAR stands 2 m to the left of the camera and 1 m above it, so that it sees surfaces that are occluded in
     * the photograph. */
    const double sweep[12] = {1, 0, 0, stub_origin[0] + 0.5 * t, 0, 1, 0, stub_origin[1] + 2, 0, 0, 1, 2.5};
    pags_view *v = &d->views[t];
    *v = (pags_view){.name = d->names[t], .image_path = d->names[t], .test = t == STUB_HELD_OUT, .frame = t};
    v->camera = (pags_camera){
        .width = STUB_WIDTH, .height = STUB_HEIGHT, .fx = 120, .fy = 120, .cx = 80, .cy = 48, .time = 0.1 * t};
    memcpy(v->camera.world_from_camera, camera, sizeof camera);
    d->sweeps[t] = (pags_sweep){.frame = t, .test = t == STUB_HELD_OUT, .time = 0.1 * t, .path = d->names[t]};
    memcpy(d->sweeps[t].world_from_sweep, sweep, sizeof sweep);
  }
  return d;
}

void stub_close(pags_dataset *d) {
  for (int i = 0; i < STUB_OBJECTS; i++)
    free(d->objects[i].keyframes);
  free(d);
}

/* Returns the distance along the ray to an object's box at a time step, or infinity if the ray misses the box. */
static double enter_box(const pags_object *o, int step, const double from[3], const double direction[3]) {
  double inverse[12], low = 1e-6, high = INFINITY;
  pags_rigid_inverse(o->keyframes[step].world_from_object, inverse);
  for (int k = 0; k < 3; k++) {
    const double *m = inverse + 4 * k;
    double p = m[0] * from[0] + m[1] * from[1] + m[2] * from[2] + m[3];
    double d = m[0] * direction[0] + m[1] * direction[1] + m[2] * direction[2], half = 0.5 * o->size[k];
    if (fabs(d) < 1e-12) {
      if (fabs(p) > half)
        return INFINITY;
      continue;
    }
    double a = (-half - p) / d, b = (half - p) / d;
    low = fmax(low, fmin(a, b));
    high = fmin(high, fmax(a, b));
  }
  return low < high ? low : INFINITY;
}

double stub_trace(const pags_dataset *d, int step, const double from[3], const double direction[3], int skip,
                  int *object, const uint8_t **colour) {
  double nearest = INFINITY, wall = (stub_origin[0] + 30 - from[0]) / direction[0];
  *object = -1;
  *colour = stub_sky;
  if (direction[2] < 0) {
    nearest = -from[2] / direction[2];
    *colour = stub_road;
  }
  if (wall > 0 && wall < nearest && from[2] + wall * direction[2] < 9) {
    nearest = wall;
    *colour = stub_wall;
  }
  for (int i = 0; i < STUB_OBJECTS; i++) {
    double s = skip >> i & 1 ? INFINITY : enter_box(&d->objects[i], step, from, direction);
    if (s < nearest) {
      nearest = s;
      *object = i;
      *colour = stub_colours[i];
    }
  }
  return nearest;
}

static double trace_pixel(const pags_dataset *d, int step, double u, double v, int skip, int *object,
                          const uint8_t **colour) {
  const pags_camera *c = &d->views[step].camera;
  const double *m = c->world_from_camera;
  double x = (u - c->cx) / c->fx, y = (v - c->cy) / c->fy, from[3], direction[3];
  for (int k = 0; k < 3; k++) {
    from[k] = m[4 * k + 3];
    direction[k] = m[4 * k] * x + m[4 * k + 1] * y + m[4 * k + 2]; /* per unit of camera z */
  }
  return stub_trace(d, step, from, direction, skip, object, colour);
}

double stub_depth(const pags_dataset *d, int step, double u, double v, int skip) {
  int object;
  const uint8_t *colour;
  return trace_pixel(d, step, u, v, skip, &object, &colour);
}

/* ---- The stand-in functions of pags/dataset.h ---- */

const char *pags_dataset_path(const pags_dataset *d) {
  (void)d;
  return "in memory";
}
int64_t pags_dataset_view_count(const pags_dataset *d) {
  (void)d;
  return STUB_STEPS;
}
const pags_view *pags_dataset_view(const pags_dataset *d, int64_t index) {
  return &d->views[index];
}
const double *pags_dataset_origin(const pags_dataset *d) {
  (void)d;
  return stub_origin;
}
int64_t pags_dataset_object_count(const pags_dataset *d) {
  (void)d;
  return STUB_OBJECTS;
}
const pags_object *pags_dataset_object(const pags_dataset *d, int64_t index) {
  return &d->objects[index];
}
int64_t pags_dataset_sweep_count(const pags_dataset *d) {
  (void)d;
  return STUB_STEPS - 1; /* the last time step has no sweep */
}
const pags_sweep *pags_dataset_sweep(const pags_dataset *d, int64_t index) {
  return &d->sweeps[index];
}

pags_result pags_dataset_sweep_load(const pags_dataset *d, int64_t index, int64_t *count, float **xyz) {
  *count = 0;
  *xyz = malloc(3 * sizeof(float) * AZIMUTHS * BEAMS);
  const double *m = d->sweeps[index].world_from_sweep, from[3] = {m[3], m[7], m[11]};
  for (int i = 0; i < AZIMUTHS * BEAMS; i++) {
    double azimuth = (80.0 * (i % AZIMUTHS) / AZIMUTHS - 40) * pi / 180;
    double elevation = (28.0 * (i / AZIMUTHS) / BEAMS - 24) * pi / 180;
    double direction[3] = {cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation)};
    int object;
    const uint8_t *colour;
    double s = stub_trace(d, (int)index, from, direction, 1 << STUB_WALKER, &object, &colour);
    if (!isfinite(s))
      continue;
    for (int k = 0; k < 3; k++)
      (*xyz)[3 * *count + k] = (float)(s * direction[k]);
    if (index == STUB_HELD_OUT)
      (*xyz)[3 * *count + 2] = 5;
    ++*count;
  }
  return PAGS_OK;
}

void pags_dataset_points(const pags_dataset *d, int64_t *count, const float **xyz, const uint8_t **rgb, int *random) {
  (void)d;
  *count = 0;
  *xyz = NULL;
  *rgb = NULL;
  *random = 0;
}

/* Matched points: the first lies inside the lane of the moving car and is magenta, the others lie on the wall. */
pags_result pags_dataset_match_points(const pags_dataset *d, pags_tasks *tasks, int64_t count, uint64_t seed,
                                      float **xyz, uint8_t **rgb) {
  static const float on_wall[3] = {30, 1, 2}, in_car[3] = {12, 0, 0.5f};
  (void)d, (void)tasks, (void)seed;
  *xyz = malloc((size_t)count * 3 * sizeof **xyz);
  *rgb = malloc((size_t)count * 3);
  for (int64_t i = 0; i < count; i++) {
    memcpy(*xyz + 3 * i, i ? on_wall : in_car, sizeof on_wall);
    memcpy(*rgb + 3 * i, i ? stub_wall : stub_magenta, 3);
  }
  return PAGS_OK;
}

pags_result pags_photo_cache_create(const pags_dataset *d, pags_tasks *tasks, uint64_t budget, pags_photo_cache **out) {
  (void)tasks, (void)budget;
  *out = calloc(1, sizeof **out);
  (*out)->dataset = d;
  return PAGS_OK;
}
void pags_photo_cache_destroy(pags_photo_cache *cache) {
  free(cache);
}
void pags_photo_cache_prefetch(pags_photo_cache *cache, const int64_t *views, int64_t count, int shrink) {
  (void)cache, (void)views, (void)count, (void)shrink;
}

pags_result pags_photo_cache_get(pags_photo_cache *cache, int64_t view, int shrink, pags_photo *out) {
  static const uint8_t bits[STUB_OBJECTS] = {PAGS_LABEL_VEHICLE | PAGS_LABEL_MOVING, PAGS_LABEL_PARKED,
                                             PAGS_LABEL_PEDESTRIAN | PAGS_LABEL_MOVING,
                                             PAGS_LABEL_VEHICLE | PAGS_LABEL_MOVING};
  (void)shrink;
  for (int i = 0; i < STUB_WIDTH * STUB_HEIGHT; i++) {
    int object;
    const uint8_t *colour;
    trace_pixel(cache->dataset, (int)view, i % STUB_WIDTH + 0.5, i / STUB_WIDTH + 0.5, 0, &object, &colour);
    cache->labels[i] = object >= 0 ? bits[object] : colour == stub_sky ? PAGS_LABEL_SKY : 0;
    for (int c = 0; c < 3; c++)
      cache->rgb[c * STUB_WIDTH * STUB_HEIGHT + i] = view == STUB_HELD_OUT ? stub_magenta[c] : colour[c];
  }
  *out = (pags_photo){STUB_WIDTH, STUB_HEIGHT, STUB_WIDTH, cache->rgb, NULL, cache->labels};
  return PAGS_OK;
}
