/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: first hits. Rays leave from the cameras of the drive, from eyes beside its path, on the
 * pavements and above it, and meet the true street and the proxies. A ray to a surface that a training camera saw
 * counts as
 *   near, far   if the true surface is within 15 m or 40 m: good if the distances differ by at most 0.1 m or 0.3 m;
 *   missed      if it hits no proxy, or one clearly behind the surface;
 *   false       if it hits a proxy clearly before the surface, or one within 40 m where the street has nothing.
 * Clearly: by more than 0.3 m along the ray and 0.1 m off the surface's plane (leaves have no plane). */
#include <math.h>

#include "base/parallel.h"
#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"
#include "maths/maths.h"

enum { STEPS = 16, ACROSS = 32, DOWN = 18, LOOKS = 256, PLACES = 5 };
static const double near_range = 15, far_range = 40, near_slack = 0.1, far_slack = 0.3, clear_along = 0.3,
                    clear_off = 0.1;
static const double eye_height = 1.6;

/* The places from which rays leave. Eyes stand at `y` to the left of the car, or of the street's middle line; the
 * sines of the elevations of their rays lie within `sines`. */
static const struct place {
  const char *name;
  bool street;
  double y[2], height, sines[2];
} places[PLACES] = {{.name = "drive's cameras"},
                    {"2 m beside", false, {2, -2}, eye_height, {-0.5, 0.26}},
                    {"5 m beside", false, {5, -5}, eye_height, {-0.5, 0.26}},
                    {"pavements",
                     true,
                     {(double)PAGS_KERB_LEFT + 1.85, (double)PAGS_KERB_RIGHT - 1.85},
                     0.13 + eye_height,
                     {-0.5, 0.26}},
                    {"10 m up", false, {0, 0}, 10, {-0.97, -0.17}}};

/* ---- Rays ---- */

/* Adds the rays of a lattice of pixels of the cameras of a time step. */
static pags_result add_views(pags_proxy_bench *self, double time, pags_bench_rays *rays) {
  for (int64_t i = 0; i < self->scene.view_count; i++) {
    const pags_camera *camera = &self->scene.views[i].camera;
    double eye[3], local[3], way[3];
    pags_pose_position(camera->world_from_camera, eye);
    for (int at = 0; camera->time == time && at < ACROSS * DOWN; at++) {
      const double x = (at % ACROSS + 0.5) / ACROSS * camera->width, y = (at / ACROSS + 0.5) / DOWN * camera->height;
      if (!pags_camera_look(camera, x, y, local))
        continue;
      pags_rotate3(camera->world_from_camera, local, way);
      PAGS_TRY(pags_bench_add_ray(rays, eye, way, 0));
    }
  }
  return PAGS_OK;
}

/* Whether nothing but the ground is below an eye. */
static bool is_free(const pags_proxy_bench *self, const double eye[3]) {
  pags_rays down = {.active = 1, .direction = {{0, 0, -1}}};
  pags_touch touches[PAGS_PACKET];
  pags_narrow3(eye, down.origin[0]);
  return pags_stage_trace(self->stage, &down, touches) & 1 && touches[0].point[2] < 0.3f;
}

/* Adds the rays of the eyes of one place beside the car, in directions of the R2 sequence (Roberts 2018). */
static pags_result add_eyes(pags_proxy_bench *self, double time, int place, pags_bench_rays *rays) {
  const struct place *from = &places[place];
  double ego[12];
  pags_street_ego(&self->options, time, ego);
  for (int side = 0; side < 2; side++) {
    const double eye[3] = {ego[3], (from->street ? 0 : ego[7]) + from->y[side], from->height};
    for (int i = is_free(self, eye) ? 0 : LOOKS; i < LOOKS; i++) {
      const int64_t n = rays->count;
      const double turn = 6.283185307179586 * fmod(0.7548776662466927 * (double)n, 1);
      const double up = from->sines[0] + (from->sines[1] - from->sines[0]) * fmod(0.5698402909980532 * (double)n, 1);
      const double level = sqrt(1 - up * up);
      PAGS_TRY(pags_bench_add_ray(rays, eye, (double[3]){level * pags_cos(turn), level * pags_sin(turn), up}, place));
    }
  }
  return PAGS_OK;
}

typedef struct gap_job {
  const pags_placed *placed;
  pags_bench_ray *rays;
} gap_job;

static void find_gaps(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const gap_job *j = context;
  for (pags_bench_ray *ray = j->rays + begin; ray < j->rays + end; ray++) {
    double at[3];
    pags_bench_point(ray, ray->truth, at);
    ray->gap = ray->truth <= far_range ? pags_placed_distance(j->placed, at) : 0;
  }
}

/* Casts the rays of up to STEPS time steps, evenly spread over the drive. */
static pags_result cast(pags_proxy_bench *self, pags_bench_rays *rays) {
  const int frames = self->options.frames, steps = frames < STEPS ? frames : STEPS;
  for (int step = 0; step < steps; step++) {
    const int frame = (2 * step + 1) * frames / (2 * steps);
    const int64_t first = rays->count;
    double time = frame / self->options.fps;
    for (int64_t i = 0; i < self->scene.view_count; i++) /* the same bits as those of the views */
      if (self->scene.views[i].frame == frame)
        time = self->scene.views[i].camera.time;
    PAGS_TRY(pags_proxy_bench_time(self, time));
    PAGS_TRY(add_views(self, time, rays));
    for (int place = 1; place < PLACES; place++)
      PAGS_TRY(add_eyes(self, time, place, rays));
    PAGS_TRY(pags_bench_cast(self, time, rays, first));
    gap_job gaps = {&self->placed, rays->list + first};
    PAGS_TRY(pags_parallel_run(self->session.tasks, rays->count - first, 256, find_gaps, &gaps));
  }
  return pags_bench_see(self, rays);
}

/* ---- Counting ---- */

typedef struct tally {
  int64_t rays, unseen, near, near_good, far, far_good, missed, wrong; /* wrong: false hits */
  int64_t wrong_by[PAGS_KINDS];                                        /* by the kind of proxy that is hit */
} tally;

/* Whether two hits lie clearly apart, the first one before the second one. */
static bool is_clear(double first, double second, double cosine) {
  return second - first > clear_along && (second - first) * cosine > clear_off;
}

static void count_ray(const pags_proxy_bench *self, const pags_bench_ray *ray, tally *t) {
  const bool shown = ray->truth <= far_range;
  const double cosine = !shown || ray->kind == PAGS_KIND_TREE ? 1 : fabs(pags_dot3(ray->normal, ray->direction));
  if (shown && !ray->seen) {
    t->unseen++;
    return;
  }
  t->rays++;
  if (ray->proxy <= far_range && is_clear(ray->proxy, ray->truth, cosine)) {
    t->wrong++;
    t->wrong_by[self->placed.list[ray->placed].kind]++;
  }
  if (!shown)
    return;
  t->far++;
  t->far_good += fabs(ray->proxy - ray->truth) <= far_slack;
  t->near += ray->truth <= near_range;
  t->near_good += ray->truth <= near_range && fabs(ray->proxy - ray->truth) <= near_slack;
  t->missed += is_clear(ray->truth, ray->proxy, cosine);
}

/* Prints a row; of a class, also the false hits of its proxies, and `gap`, the distance of the true surface from the
 * nearest proxy. */
static void tell_row(pags_proxy_bench *self, const char *name, const tally *t, const tally *all, pags_kind kind,
                     const pags_proxy_distance *gap) {
  char text[6][16];
  pags_say(&self->session, "%-16s %7lld %8s %8s %8s %8s %8s", name, (long long)t->rays,
           pags_bench_share(text[0], t->unseen, t->rays + t->unseen), pags_bench_share(text[1], t->near_good, t->near),
           pags_bench_share(text[2], t->far_good, t->far), pags_bench_share(text[3], t->missed, t->far),
           pags_bench_share(text[4], t->wrong, t->rays));
  if (kind < PAGS_KINDS)
    pags_say(&self->session, " %8s  %6.3f %6.3f", pags_bench_share(text[5], all->wrong_by[kind], all->rays), gap->mean,
             gap->p95);
  pags_say(&self->session, "\n");

  pags_json_writer *w = &self->json;
  pags_json_begin_object(w, NULL);
  pags_json_put_string(w, kind < PAGS_KINDS ? "class" : "place", name);
  pags_json_put_integer(w, "rays", t->rays);
  pags_json_put_integer(w, "unseen", t->unseen);
  pags_json_put_integer(w, "to_15_m", t->near);
  pags_json_put_number(w, "within_0.1_m", (double)t->near_good / (double)t->near);
  pags_json_put_integer(w, "to_40_m", t->far);
  pags_json_put_number(w, "within_0.3_m", (double)t->far_good / (double)t->far);
  pags_json_put_number(w, "missed", (double)t->missed / (double)t->far);
  pags_json_put_number(w, "false", (double)t->wrong / (double)t->rays);
  if (kind < PAGS_KINDS) {
    pags_json_put_number(w, "false_by_this", (double)all->wrong_by[kind] / (double)all->rays);
    pags_proxy_bench_put(w, "distance", gap);
  }
  pags_json_end_object(w);
}

/* The kind of a ray's true surface, of those that count. */
static pags_kind kind_of_ray(const pags_bench_ray *ray) {
  return ray->truth <= far_range ? ray->kind : PAGS_KIND_NONE;
}

static pags_result report(pags_proxy_bench *self, const pags_bench_rays *rays) {
  tally kinds[PAGS_KINDS] = {0}, from[PLACES] = {0}, all = {0};
  PAGS_AUTOFREE double *gaps = malloc((size_t)(rays->count + 1) * sizeof *gaps);
  PAGS_CHECK_MEMORY(gaps, "%lld rays", (long long)rays->count);
  for (int64_t i = 0; i < rays->count; i++) {
    const pags_bench_ray *ray = &rays->list[i];
    count_ray(self, ray, &kinds[kind_of_ray(ray)]);
    count_ray(self, ray, &from[ray->group]);
    count_ray(self, ray, &all);
  }
  pags_say(
      &self->session,
      "\nFirst hits of %lld rays. They count into the open, and to surfaces that a training camera saw: within 40 "
      "m, unhidden, no flatter than 3 degrees.\nmissed: no proxy, or one clearly behind the surface; false: a "
      "proxy clearly before it, or within 40 m in the open (by more than 0.3 m, and 0.1 m off its plane);\n"
      "by it: false hits of proxies of this class, of all rays; mean, 95 %%: distances from the true surface to the "
      "nearest proxy, metres\n%-16s %7s %8s %8s %8s %8s %8s %8s  %6s %6s\n",
      (long long)rays->count, "true surface", "rays", "unseen", "0.1 m@15", "0.3 m@40", "missed", "false", "by it",
      "mean", "95 %");
  pags_json_begin_object(&self->json, "first_hits");
  pags_json_begin_array(&self->json, "classes");
  for (int k = 0; k < PAGS_KINDS; k++) {
    int64_t count = 0;
    for (int64_t i = 0; i < rays->count; i++)
      if (rays->list[i].seen && k < PAGS_KIND_NONE && kind_of_ray(&rays->list[i]) == (pags_kind)k)
        gaps[count++] = rays->list[i].gap;
    const pags_proxy_distance gap = pags_distance_summary(gaps, count);
    if (kinds[k].rays || kinds[k].unseen || all.wrong_by[k])
      tell_row(self, k == PAGS_KIND_NONE ? "open" : pags_kind_names[k], &kinds[k], &all, (pags_kind)k, &gap);
  }
  pags_json_end_array(&self->json);
  pags_json_begin_array(&self->json, "places");
  for (int i = 0; i < PLACES; i++)
    tell_row(self, places[i].name, &from[i], &all, PAGS_KINDS, NULL);
  tell_row(self, "all", &all, &all, PAGS_KINDS, NULL);
  pags_json_end_array(&self->json);
  pags_json_end_object(&self->json);
  return PAGS_OK;
}

pags_result pags_bench_first_hits(pags_proxy_bench *self) {
  PAGS_AUTO(pags_bench_free_rays) pags_bench_rays rays = {0};
  PAGS_TRY(cast(self, &rays));
  return report(self, &rays);
}
