/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: the feet of walls, poles, signs and trees. Level rays just above the ground must be stopped where
 * the street has them, and a ball must not pass through. The ball moves by conservative advancement (Mirtich 1996): as
 * far as its distance from the nearest proxy allows. */
#include <math.h>

#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"
#include "maths/maths.h"

enum { SIDES = 8, LOW = 4, BALL = LOW, HEIGHTS = 6, MOST_BALLS = 100 }; /* balls: at walls, and as many at the rest */
/* metres above the ground: of the low rays, of the ball's centre, and where a pole is seen over parked cars */
static const double heights[HEIGHTS] = {0.05, 0.1, 0.2, 0.3, 0.5, 1.8};
/* metres: between rays at walls, and the farthest wall; distance from which rays aim at a pole; by which a hit may be
 * off; radius of the ball, and the way of its centre before and behind the true surface */
static const double wall_step = 0.5, wall_reach = 6, pole_reach = 1.6, slack = 0.3, radius = 0.15, before = 1.4,
                    behind = 0.6;

/* ---- Rays ---- */

/* Adds rays at all heights above a point on the ground. Their group is the placement that they aim at. */
static pags_result add_column(pags_bench_rays *rays, double x, double y, double ground, const double way[3],
                              int placement) {
  for (int h = 0; h < HEIGHTS; h++)
    PAGS_TRY(pags_bench_add_ray(rays, (double[3]){x, y, ground + heights[h]}, way, placement));
  return PAGS_OK;
}

pags_result pags_bench_aim_at_feet(const pags_proxy_bench *self, pags_bench_rays *rays) {
  const double begin = pags_street_ego_x(&self->options, 0), pavement = (double)PAGS_KERB_HEIGHT;
  const double middles[2] = {(double)PAGS_KERB_LEFT + 1.85, (double)PAGS_KERB_RIGHT - 1.85};
  for (double x = begin; x < self->street.end + 30; x += wall_step)
    for (int side = 0; side < 2; side++)
      PAGS_TRY(add_column(rays, x, middles[side], pavement, (double[3]){0, side ? -1 : 1, 0}, 0));
  /* The street's first placement is its ground with the houses. */
  for (int i = 1; i < self->street.placement_count && self->street.placements[i].actor < 0; i++) {
    const float *pose = self->street.placements[i].pose;
    for (int side = 0; side < SIDES; side++) {
      const double turn = 6.283185307179586 * (side + 0.5) / SIDES, c = pags_cos(turn), s = pags_sin(turn);
      PAGS_TRY(add_column(rays, (double)pose[3] - pole_reach * c, (double)pose[7] - pole_reach * s, (double)pose[11],
                          (double[3]){c, s, 0}, i));
    }
  }
  return PAGS_OK;
}

/* Whether a ray hits what it aims at, where a training camera saw it. */
static bool counts(const pags_bench_ray *ray) {
  return ray->seen && ray->placement == ray->group &&
         (ray->group ? ray->truth < pole_reach : ray->kind == PAGS_KIND_BUILDING && ray->truth < wall_reach);
}

/* ---- Balls ---- */

typedef struct balls {
  int64_t thrown, passed, early; /* early: stopped clearly before the true surface */
} balls;

/* Moves a ball along a ray, to and through its true surface. */
static void throw_ball(const pags_proxy_bench *self, const pags_bench_ray *ray, balls *out) {
  const double end = ray->truth + behind;
  double at[3], way = ray->truth - before, gap = HUGE_VAL;
  while (way < end && gap > 1e-3) {
    pags_bench_point(ray, way, at);
    gap = pags_placed_distance(&self->placed, at) - radius;
    way += gap;
  }
  out->thrown++;
  out->passed += !(gap <= 1e-3);
  out->early += gap <= 1e-3 && way < ray->truth - radius - slack;
}

/* ---- Report ---- */

static const double least_stopped = 0.98; /* share of the level rays to walls */

/* Whether the file has proxies of walls at all. */
static bool has_walls(const pags_proxy_bench *self) {
  bool any = false;
  for (int64_t i = 0; i < self->placed.count; i++)
    any = any || self->placed.list[i].kind == PAGS_KIND_BUILDING;
  return any;
}

static pags_result report(pags_proxy_bench *self, const pags_bench_rays *rays) {
  static const char *const names[2] = {"walls", "poles, signs, trees"};
  pags_json_writer *w = &self->json;
  pags_say(
      &self->session,
      "\nFeet. Level rays 0.05 to 0.3 m above the ground: stopped within 0.3 m of the true surface, clearly before "
      "it (early), or not (leak). A ball of 0.3 m, 0.5 m above the ground: passes, or is stopped early.\n"
      "%-20s %7s %8s %8s %8s %7s %7s %7s\n",
      "true surface", "rays", "stopped", "early", "leak", "balls", "pass", "early");
  pags_json_begin_object(w, "feet");
  for (int kind = 0; kind < 2; kind++) {
    int64_t count = 0, stopped = 0, early = 0, ball_rays = 0, next = 0;
    balls thrown = {0};
    char text[3][16];
    for (int64_t i = 0; i < rays->count; i++)
      ball_rays += (rays->list[i].group > 0) == kind && i % HEIGHTS == BALL && counts(&rays->list[i]);
    for (int64_t i = 0; i < rays->count; i++) {
      const pags_bench_ray *ray = &rays->list[i];
      if ((ray->group > 0) != kind || !counts(ray))
        continue;
      if (i % HEIGHTS < LOW) {
        count++;
        stopped += fabs(ray->proxy - ray->truth) <= slack;
        early += ray->proxy < ray->truth - slack;
      } else if (i % HEIGHTS == BALL &&
                 next++ * MOST_BALLS / (ball_rays > MOST_BALLS ? ball_rays : MOST_BALLS) == thrown.thrown) {
        throw_ball(self, ray, &thrown); /* evenly chosen, at most MOST_BALLS */
      }
    }
    const int64_t leaks = count - stopped - early;
    const bool bad = !kind && has_walls(self) && (thrown.passed || (double)stopped < least_stopped * (double)count);
    self->failures += bad;
    pags_say(&self->session, "%-20s %7lld %8s %8s %8s %7lld %7lld %7lld%s\n", names[kind], (long long)count,
             pags_bench_share(text[0], stopped, count), pags_bench_share(text[1], early, count),
             pags_bench_share(text[2], leaks, count), (long long)thrown.thrown, (long long)thrown.passed,
             (long long)thrown.early, bad ? "  <<<" : "");
    pags_json_begin_object(w, kind ? "uprights" : "walls");
    pags_json_put_integer(w, "rays", count);
    pags_json_put_number(w, "stopped", (double)stopped / (double)count);
    pags_json_put_number(w, "early", (double)early / (double)count);
    pags_json_put_number(w, "leaks", (double)leaks / (double)count);
    pags_json_put_integer(w, "balls", thrown.thrown);
    pags_json_put_integer(w, "passed", thrown.passed);
    pags_json_put_integer(w, "stopped_early", thrown.early);
    pags_json_end_object(w);
  }
  pags_json_end_object(w);
  return PAGS_OK;
}

pags_result pags_bench_feet(pags_proxy_bench *self) {
  PAGS_AUTO(pags_bench_free_rays) pags_bench_rays rays = {0};
  PAGS_TRY(pags_bench_aim_at_feet(self, &rays));
  PAGS_TRY(pags_bench_cast(self, pags_bench_middle(self), &rays, 0));
  PAGS_TRY(pags_bench_see(self, &rays));
  return report(self, &rays);
}
