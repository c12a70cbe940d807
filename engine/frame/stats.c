/* SPDX-License-Identifier: Apache-2.0 */
/* Sums and means of pags_frame_stats (milliseconds by stage, counts of Gaussians, pairs and tiles) over several
 * frames. */
#include <pags/frame.h>

enum { MOST = 32 };

/* times_of and counts_of write pointers to all times, or all counts, of `s` to `out` and return their number. */
static int times_of(pags_frame_stats *s, double *out[MOST]) {
  double *const all[] = {
      &s->ms_cull,    &s->ms_project,         &s->ms_shade,           &s->ms_sort, &s->ms_bin, &s->ms_raster,
      &s->ms_occlude, &s->ms_raster_backward, &s->ms_project_backward};
  const int count = sizeof all / sizeof *all;
  for (int i = 0; i < count; i++)
    out[i] = all[i];
  return count;
}

static int counts_of(pags_frame_stats *s, int64_t *out[MOST]) {
  int64_t *const all[] = {&s->gaussians,       &s->in_view,       &s->loaded,       &s->hidden,
                          &s->shaded,          &s->binned,        &s->pairs_hidden, &s->pairs_binned,
                          &s->pairs_evaluated, &s->pairs_blended, &s->clusters,     &s->clusters_hidden,
                          &s->tiles,           &s->tiles_full,    &s->slabs,        &s->occluders,
                          &s->pairs_reached,   &s->pairs_open,    &s->held,         &s->beyond};
  const int count = sizeof all / sizeof *all;
  for (int i = 0; i < count; i++)
    out[i] = all[i];
  return count;
}

_Static_assert(sizeof(pags_frame_stats) == 9 * sizeof(double) + 20 * sizeof(int64_t), "a member is missing above");

void pags_frame_stats_add(pags_frame_stats *sum, const pags_frame_stats *one) {
  pags_frame_stats copy = *one;
  double *times[2][MOST];
  int64_t *counts[2][MOST];
  const int n = times_of(sum, times[0]), m = counts_of(sum, counts[0]);
  times_of(&copy, times[1]);
  counts_of(&copy, counts[1]);
  for (int i = 0; i < n; i++)
    *times[0][i] += *times[1][i];
  for (int i = 0; i < m; i++)
    *counts[0][i] += *counts[1][i];
}

void pags_frame_stats_divide(pags_frame_stats *sum, double n) {
  double *times[MOST];
  int64_t *counts[MOST];
  const int time_count = times_of(sum, times), count_count = counts_of(sum, counts);
  for (int i = 0; i < time_count; i++)
    *times[i] /= n;
  for (int i = 0; i < count_count; i++)
    *counts[i] = (int64_t)((double)*counts[i] / n);
}
