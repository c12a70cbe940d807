/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: shadows on the road. At a lattice of points of the driven road that a training camera saw and on
 * which nothing stands, is the sun hidden by the true street, and by the proxies? */
#include <math.h>

#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"
#include "maths/maths.h"

enum { SUNS = 3 };
/* metres: of the lattice; above the road, from which rays look down; above the higher of both roads, from which rays
 * look at the sun; of what stands on the proxies' road */
static const double cell = 0.25, above = 1.2, lift = 0.03, ledge = 0.3;
static const struct sun {
  const char *name;
  double height, turn; /* degrees above the horizon, and from the street's direction to the left */
} suns[SUNS] = {{"noon, 60 degrees", 60, -60}, {"30 degrees, right", 30, -45}, {"30 degrees, left", 30, 45}};

pags_result pags_bench_shadows(pags_proxy_bench *self) {
  PAGS_AUTO(pags_bench_free_rays) pags_bench_rays road = {0};
  const double begin = pags_street_ego_x(&self->options, 0), time = pags_bench_middle(self),
               degree = 0.017453292519943295;
  for (double x = begin; x < self->street.end + 15; x += cell)
    for (double y = (double)PAGS_KERB_RIGHT + cell; y < (double)PAGS_KERB_LEFT; y += cell)
      PAGS_TRY(pags_bench_add_ray(&road, (double[3]){x, y, above}, (double[3]){0, 0, -1}, 0));
  PAGS_TRY(pags_bench_cast(self, time, &road, 0));
  PAGS_TRY(pags_bench_see(self, &road));
  pags_say(&self->session, "\nShadows on the road\n%-20s %7s %8s %8s %7s\n", "sun", "points", "true", "proxies", "IoU");
  pags_json_begin_array(&self->json, "shadows");
  for (int i = 0; i < SUNS; i++) {
    PAGS_AUTO(pags_bench_free_rays) pags_bench_rays rays = {0};
    const double level = pags_cos(degree * suns[i].height);
    const double way[3] = {level * pags_cos(degree * suns[i].turn), level * pags_sin(degree * suns[i].turn),
                           pags_sin(degree * suns[i].height)};
    for (const pags_bench_ray *at = road.list; at < road.list + road.count; at++) {
      double from[3];
      if (!at->seen || at->kind != PAGS_KIND_ROAD)
        continue;
      pags_bench_point(at, (at->proxy > at->truth - ledge ? fmin(at->truth, at->proxy) : at->truth) - lift, from);
      PAGS_TRY(pags_bench_add_ray(&rays, from, way, 0));
    }
    PAGS_TRY(pags_bench_cast(self, time, &rays, 0));
    int64_t truth = 0, proxies = 0, both = 0, either = 0;
    for (const pags_bench_ray *ray = rays.list; ray < rays.list + rays.count; ray++) {
      const bool dark = ray->truth < HUGE_VAL, covered = ray->proxy < HUGE_VAL;
      truth += dark;
      proxies += covered;
      both += dark && covered;
      either += dark || covered;
    }
    char text[2][16];
    const double iou = (double)both / (double)either;
    pags_say(&self->session, "%-20s %7lld %8s %8s %7.3f\n", suns[i].name, (long long)rays.count,
             pags_bench_share(text[0], truth, rays.count), pags_bench_share(text[1], proxies, rays.count), iou);
    pags_json_begin_object(&self->json, NULL);
    pags_json_put_string(&self->json, "sun", suns[i].name);
    pags_json_put_integer(&self->json, "points", rays.count);
    pags_json_put_number(&self->json, "iou", iou);
    pags_json_end_object(&self->json);
  }
  pags_json_end_array(&self->json);
  return PAGS_OK;
}
