/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the initial Gaussians from points, as Kerbl et al. (2023) do it: scales from the distances of the three
 * nearest neighbours. */
#include "init/from_points.h"

#include <assert.h>
#include <math.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "dataset/internal.h"
#include "maths/maths.h"
#include "scene/morton.h"

/* Lower bound of the mean squared neighbour distance, m^2: duplicate points have distance 0. It is INRIA's bound. */
static const float least_square = 1e-7f;

/* Lower bound of the extent, relative to the median distance of the points. Cameras round an object or through a room
 * spread over more than that. */
static const double least_share = 0.25;

/* Upper bound of the initial sigma, fraction of the extent. */
static const double most_sigma = 0.1;

/* Smallest initial colour, in levels of 0..255: rendering clamps colours at 0, where no gradient flows back, so that
 * a black point cloud would stay black. */
static const double least_level = 0.5;

/* The median distance of the finite points from `centre`, of at most MOST of them; 0 without any. */
static pags_result median_distance(int64_t points, const float *xyz, const double centre[3], double *median) {
  enum { MOST = 100000 };
  const int64_t step = points / MOST + 1;
  int64_t count = 0;
  *median = 0.0;
  PAGS_AUTOFREE double *distances = malloc((size_t)(points / step + 1) * sizeof *distances);
  PAGS_CHECK_MEMORY(distances, "%lld points", (long long)points);
  for (int64_t i = 0; i < points; i += step) {
    double p[3];
    pags_widen3(xyz + 3 * i, p);
    const double square = pags_distance_squared3(p, centre);
    if (isfinite(square))
      distances[count++] = sqrt(square);
  }
  if (count > 0) {
    pags_sort_doubles(distances, count);
    *median = distances[count / 2];
  }
  return PAGS_OK;
}

pags_result pags_init_extent(const pags_dataset *dataset, const int64_t *views, int64_t count, int64_t points,
                             const float *xyz, double *extent) {
  double mean[3] = {0.0, 0.0, 0.0}, centre[3], at[3], largest = 0.0, median;
  int64_t near = 0;
  for (int64_t i = 0; i < count; i++)
    near += !pags_dataset_is_far(dataset, views[i]);
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3 && !pags_dataset_is_far(dataset, views[i]); k++)
      mean[k] += pags_dataset_view(dataset, views[i])->camera.world_from_camera[4 * k + 3] / (double)near;
  for (int64_t i = 0; i < count; i++) {
    if (pags_dataset_is_far(dataset, views[i]))
      continue;
    pags_pose_position(pags_dataset_view(dataset, views[i])->camera.world_from_camera, at);
    largest = fmax(largest, pags_distance3(at, mean));
  }
  pags_subtract3(mean, pags_dataset_origin(dataset), centre);
  PAGS_TRY(median_distance(points, xyz, centre, &median));
  *extent = fmax(1.1 * largest, least_share * median);
  if (*extent <= 1e-6)
    *extent = 1.0;
  return PAGS_OK;
}

static bool is_finite(const float p[3]) {
  return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

/* Writes the indices of the points to use, finite ones and at most `most` of them, to `chosen`; returns how many. */
static int64_t choose_points(int64_t points, const float *xyz, int64_t most, int64_t *chosen) {
  int64_t finite = 0, taken = 0;
  for (int64_t i = 0; i < points; i++)
    if (is_finite(xyz + 3 * i))
      chosen[finite++] = i;
  if (finite <= most)
    return finite;
  for (; taken < most; taken++) /* evenly spread over the order of the points */
    chosen[taken] = chosen[(int64_t)((double)taken * (double)finite / (double)most)];
  return taken;
}

int64_t pags_init_count(int64_t points, const float *xyz, int64_t most) {
  int64_t finite = 0;
  for (int64_t i = 0; i < points; i++)
    finite += is_finite(xyz + 3 * i);
  return finite < most ? finite : most;
}

pags_result pags_init_gaussians(const pags_train_config *config, int64_t points, const float *xyz, const uint8_t *rgb,
                                int64_t most, double extent, const int64_t *rows, pags_tasks *tasks,
                                pags_gaussians *out) {
  *out = (pags_gaussians){0};
  PAGS_AUTOFREE int64_t *chosen = malloc((size_t)(points > 0 ? points : 1) * sizeof *chosen);
  PAGS_CHECK_MEMORY(chosen, "%lld points", (long long)points);
  const int64_t count = choose_points(points, xyz, most, chosen);
  if (count == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "the data set has no point to start from: %lld points, none finite",
                     (long long)points);
  PAGS_AUTOFREE float *positions = malloc((size_t)count * 4 * sizeof *positions);
  PAGS_AUTOFREE float *planes = malloc((size_t)count * 3 * sizeof *planes);
  PAGS_AUTOFREE int64_t *order = malloc((size_t)count * sizeof *order); /* along a Morton curve */
  PAGS_CHECK_MEMORY(positions && planes && order, "%lld points", (long long)points);
  float *const square = positions + 3 * count; /* mean squared neighbour distances */
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3; k++)
      positions[3 * i + k] = planes[k * count + i] = xyz[3 * chosen[i] + k];
  PAGS_TRY(pags_knn_mean_squared(positions, count, tasks, square));
  static_assert(PAGS_MEAN == 0, "means are the first planes");
  PAGS_TRY(pags_morton_order(&(pags_gaussians){.count = count, .stride = count, .data = planes}, tasks, order));

  const int64_t begin = rows ? rows[0] : 0, end = rows ? rows[1] : count;
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  PAGS_TRY(pags_gaussians_create(&g, end - begin, config->color.sh_degree));
  if (end == begin)
    PAGS_TRY(pags_gaussians_reserve(&g, 1)); /* without room there would be no columns */
  g.alpha_min = (float)config->picture.alpha_min;
  const float opacity = (float)pags_log(config->start.init_opacity / (1.0 - config->start.init_opacity));
  for (int64_t n = begin; n < end; n++) {
    const int64_t i = order[n], row = n - begin;
    const double sigma = sqrt((double)fmaxf(square[i], least_square));
    const float log_sigma = (float)pags_log(fmin(sigma, most_sigma * extent));
    for (int k = 0; k < 3; k++) {
      const double level = fmax((double)rgb[3 * chosen[i] + k], least_level);
      pags_plane(&g, PAGS_MEAN + k)[row] = positions[3 * i + k];
      pags_plane(&g, PAGS_SCALE + k)[row] = log_sigma;
      pags_plane(&g, PAGS_SH + k)[row] = (float)((level / 255.0 - 0.5) / PAGS_SH_C0);
    }
    pags_plane(&g, PAGS_ROTATION)[row] = 1.0f;
    pags_plane(&g, PAGS_OPACITY)[row] = opacity;
  }
  *out = g;
  g = (pags_gaussians){0};
  return PAGS_OK;
}
