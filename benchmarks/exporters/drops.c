/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: heights at which things rest on the true ground and on that of the proxies. A box, and a wheel
 * that rolls along the street, are lowered without turning until they touch: the highest of a lattice of points below
 * them. A car with a wheelbase of 2 m follows the path on both tracks. */
#include <math.h>

#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"

enum { PLACES = 200, SIDE = 7, LATTICE = SIDE * SIDE, AREAS = 3, BODIES = 2, WHEELBASE = 20 };
/* metres: half sides of the box; radius and half width of the wheel; from which rays look down, above the ground;
 * between the car's path's points; half its track */
static const double box_half = 0.2, wheel_radius = 0.3, wheel_half = 0.1, above = 1, path_step = 0.1, track_half = 0.75;

/* Where things are dropped: distances from the kerb's edge, positive on the pavement. */
static const struct area {
  const char *name;
  double from, to;
} areas[AREAS] = {{"road", -6, -0.5}, {"kerb", -0.15, 0.15}, {"pavement", 0.5, 3}};
static const char *const bodies[BODIES] = {"box", "wheel"};

static bool is_ground(const pags_bench_ray *ray) {
  return ray->kind <= PAGS_KIND_TERRAIN && ray->truth < above + 0.3;
}

static pags_result look_down(pags_bench_rays *rays, double x, double y, int group) {
  return pags_bench_add_ray(rays, (double[3]){x, y, above}, (double[3]){0, 0, -1}, group);
}

/* ---- Drops ---- */

/* Adds a lattice of rays for each body at places of the R2 sequence (Roberts 2018) on both sides of the street. */
static pags_result add_places(const pags_proxy_bench *self, int area, pags_bench_rays *rays) {
  const double begin = pags_street_ego_x(&self->options, 0), length = self->street.end + 15 - begin;
  for (int i = 0; i < PLACES; i++) {
    const double across = areas[area].from + (areas[area].to - areas[area].from) * fmod(0.7548776662466927 * i, 1);
    const double x = begin + length * fmod(0.5698402909980532 * i, 1);
    const double y = i % 2 ? (double)PAGS_KERB_LEFT + across : (double)PAGS_KERB_RIGHT - across;
    for (int body = 0; body < BODIES; body++)
      for (int k = 0; k < LATTICE; k++) {
        const double u = 2.0 * (k % SIDE) / (SIDE - 1) - 1, v = 2.0 * (k / SIDE) / (SIDE - 1) - 1;
        PAGS_TRY(look_down(rays, x + u * (body ? wheel_radius : box_half), y + v * (body ? wheel_half : box_half), 0));
      }
  }
  return PAGS_OK;
}

/* The height at which a body rests, by the distances of its lattice; -infinity if nothing is below it. */
static double rest(const pags_bench_ray *lattice, int body, bool proxy) {
  double best = -HUGE_VAL;
  for (int k = 0; k < LATTICE; k++) {
    const double u = (2.0 * (k % SIDE) / (SIDE - 1) - 1) * wheel_radius;
    const double lift = body ? sqrt(fmax(wheel_radius * wheel_radius - u * u, 0)) - wheel_radius : 0;
    best = fmax(best, above - (proxy ? lattice[k].proxy : lattice[k].truth) + lift);
  }
  return best;
}

static pags_result drop(pags_proxy_bench *self, int area) {
  PAGS_AUTO(pags_bench_free_rays) pags_bench_rays rays = {0};
  PAGS_TRY(add_places(self, area, &rays));
  PAGS_TRY(pags_bench_cast(self, pags_bench_middle(self), &rays, 0));
  PAGS_TRY(pags_bench_see(self, &rays));
  for (int body = 0; body < BODIES; body++) {
    double errors[PLACES];
    int64_t count = 0, through = 0;
    for (int i = 0; i < PLACES; i++) {
      const pags_bench_ray *lattice = rays.list + (i * BODIES + body) * LATTICE;
      bool usable = lattice[LATTICE / 2].seen;
      for (int k = 0; k < LATTICE; k++)
        usable = usable && is_ground(&lattice[k]);
      const double error = fabs(rest(lattice, body, true) - rest(lattice, body, false));
      if (!usable)
        continue;
      if (error < HUGE_VAL)
        errors[count++] = error;
      else
        through++;
    }
    const pags_proxy_distance d = pags_distance_summary(errors, count);
    const bool bad = through > 0 && count > 0; /* without ground in the file all fall through */
    self->failures += bad;
    pags_say(&self->session, "%-10s %-6s %7lld %8lld %8.3f %8.3f %8.3f%s\n", areas[area].name, bodies[body],
             (long long)(count + through), (long long)through, d.mean, d.p95, d.max, bad ? "  <<<" : "");
    pags_json_begin_object(&self->json, NULL);
    pags_json_put_string(&self->json, "area", areas[area].name);
    pags_json_put_string(&self->json, "body", bodies[body]);
    pags_json_put_integer(&self->json, "places", count + through);
    pags_json_put_integer(&self->json, "through", through);
    pags_proxy_bench_put(&self->json, "error", &d);
    pags_json_end_object(&self->json);
  }
  return PAGS_OK;
}

/* ---- The car on its path ---- */

static pags_result drive(pags_proxy_bench *self) {
  PAGS_AUTO(pags_bench_free_rays) pags_bench_rays rays = {0};
  const double begin = pags_street_ego_x(&self->options, 0);
  const int steps = (int)((self->street.end - begin) / path_step) + 1;
  for (int side = 0; side < 2; side++)
    for (int i = 0; i < steps; i++) {
      double ego[12];
      const double x = begin + i * path_step;
      pags_street_ego(&self->options, (x - begin) / fmax(self->street.end - begin, 1e-9) * self->street.duration, ego);
      PAGS_TRY(look_down(&rays, x, ego[7] + (side ? -track_half : track_half), 0));
    }
  PAGS_TRY(pags_bench_cast(self, pags_bench_middle(self), &rays, 0));
  PAGS_AUTOFREE double *errors = malloc((size_t)(2 * steps) * sizeof *errors);
  PAGS_CHECK_MEMORY(errors, "%d heights", 2 * steps);
  int64_t count = 0, through = 0;
  double step = 0;
  for (int64_t i = 0; i < rays.count; i++) {
    const pags_bench_ray *here = &rays.list[i];
    if (!is_ground(here))
      continue; /* something stands there */
    through += here->proxy == HUGE_VAL;
    if (i % steps == 0 || !is_ground(here - 1))
      continue;
    const double rise = (here->truth - here->proxy) - (here[-1].truth - here[-1].proxy);
    if (fabs(rise) < HUGE_VAL)
      step = fmax(step, fabs(rise));
    if (i % steps < WHEELBASE || !is_ground(here - WHEELBASE))
      continue;
    const double error = 0.5 * fabs((here->truth - here->proxy) + (here[-WHEELBASE].truth - here[-WHEELBASE].proxy));
    if (error < HUGE_VAL)
      errors[count++] = error;
  }
  const pags_proxy_distance d = pags_distance_summary(errors, count);
  pags_say(&self->session,
           "2 m wheelbase along the path: %lld places, height off by %.3f m (p95 %.3f, max %.3f); largest step that "
           "the truth lacks %.3f m; %lld of %lld points without ground\n",
           (long long)count, d.mean, d.p95, d.max, step, (long long)through, (long long)rays.count);
  pags_json_begin_object(&self->json, "wheelbase");
  pags_proxy_bench_put(&self->json, "error", &d);
  pags_json_put_number(&self->json, "step", step);
  pags_json_put_integer(&self->json, "through", through);
  pags_json_end_object(&self->json);
  return PAGS_OK;
}

pags_result pags_bench_drops(pags_proxy_bench *self) {
  pags_say(&self->session,
           "\nDrops, lowered without turning, where a training camera saw the ground: error of the height at rest, "
           "metres.\n%-10s %-6s %7s %8s %8s %8s %8s\n",
           "ground", "body", "places", "through", "mean", "95 %", "max");
  pags_json_begin_object(&self->json, "drops");
  pags_json_begin_array(&self->json, "bodies");
  for (int area = 0; area < AREAS; area++)
    PAGS_TRY(drop(self, area));
  pags_json_end_array(&self->json);
  PAGS_TRY(drive(self));
  pags_json_end_object(&self->json);
  return PAGS_OK;
}
