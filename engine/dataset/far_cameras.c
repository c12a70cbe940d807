/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the far cameras of a capture by its size, which is a quarter of the distance of what the cameras see. */
#include "dataset/internal.h"

#include <math.h>
#include <stdlib.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "dataset/parsed.h"
#include "maths/maths.h"
#include "scene/splat_formats.h"
#include "scene/survey.h"

static const double seen_share = 0.25; /* of the distance of the scene: from_points.c has the same least extent */
enum { MOST_POINTS = 100000 };

/* The median distance of the points from `middle`; without points, the distance of the subject of the other cameras. */
static pags_result find_seen(const pags_dataset *dataset, const double middle[3], double *out) {
  const pags_parsed_points *points = &dataset->parsed.points;
  const int64_t step = points->count / MOST_POINTS + 1;
  int64_t count = 0, others = 0;
  PAGS_AUTOFREE double *distances = malloc((size_t)(points->count / step + 1) * sizeof *distances);
  PAGS_AUTOFREE const pags_camera **cameras = malloc((size_t)dataset->count * sizeof *cameras);
  PAGS_CHECK_MEMORY(distances && cameras, "%s", dataset->path);
  for (int64_t i = 0; i < points->count; i += step)
    distances[count++] = pags_distance3(points->items[i].xyz, middle);
  for (int64_t i = 0; i < dataset->count; i++)
    if (!dataset->far[i])
      cameras[others++] = &dataset->views[i].camera;
  if (count == 0)
    return pags_focus_distance(cameras, others, out);
  pags_sort_doubles(distances, count);
  *out = distances[count / 2];
  return PAGS_OK;
}

/* Marks the far cameras. */
static pags_result mark(pags_dataset *dataset, const double *positions) {
  const int64_t n = dataset->count;
  pags_far_cameras found;
  double seen;
  PAGS_TRY(pags_far_cameras_find(positions, n, 0, dataset->far, &found));
  if (!found.count) /* as in nearly every capture */
    return PAGS_OK;
  PAGS_TRY(find_seen(dataset, found.middle, &seen));
  PAGS_TRY(pags_far_cameras_find(positions, n, seen_share * seen, dataset->far, &found));
  int64_t training = 0, first = n;
  for (int64_t i = n - 1; i >= 0; i--) {
    training += !dataset->far[i] && !dataset->views[i].test;
    first = dataset->far[i] ? i : first;
  }
  for (int64_t i = 0; i < n && !training; i++)
    dataset->far[i] = false;
  if (found.count && training)
    PAGS_WARN(
        "%s: %lld of %lld cameras stand far from the others, the first is %s: %.3g from their middle, of which three "
        "quarters are within %.3g; the size of the scene is taken from the others; leave the picture out if its pose "
        "is wrong",
        dataset->parsed.source, (long long)found.count, (long long)n, dataset->views[first].name,
        pags_distance3(positions + 3 * first, found.middle), found.near);
  return PAGS_OK;
}

pags_result pags_dataset_set_origin(pags_dataset *dataset) {
  dataset->far = calloc((size_t)dataset->count, sizeof *dataset->far);
  PAGS_AUTOFREE double *positions = malloc(3 * (size_t)dataset->count * sizeof *positions);
  PAGS_CHECK_MEMORY(dataset->far && positions, "%s", dataset->path);
  for (int64_t i = 0; i < 3 * dataset->count; i++)
    positions[i] = dataset->views[i / 3].camera.world_from_camera[4 * (i % 3) + 3];
  if (!dataset->parsed.driving)
    PAGS_TRY(mark(dataset, positions));
  double mean[3] = {0}, largest = 0;
  int64_t count = 0;
  for (int64_t i = 0; i < dataset->count; i++)
    count += !dataset->far[i];
  for (int64_t i = 0; i < dataset->count; i++)
    for (int c = 0; c < 3 && !dataset->far[i]; c++) {
      const double at = dataset->views[i].camera.world_from_camera[4 * c + 3];
      mean[c] += at / (double)count;
      largest = fmax(largest, fabs(at));
    }
  for (int c = 0; c < 3; c++)
    dataset->origin[c] = largest > PAGS_LARGE_COORDINATE ? pags_round(mean[c]) : 0;
  return PAGS_OK;
}

bool pags_dataset_is_far(const pags_dataset *dataset, int64_t view) {
  return dataset->far && dataset->far[view];
}
