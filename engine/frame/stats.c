/* SPDX-License-Identifier: Apache-2.0 */
/* Sums and means of pags_frame_stats (milliseconds by stage, counts of Gaussians, pairs and tiles) over several
 * frames. */
#include <assert.h>
#include <pags/frame.h>
#include <string.h>

enum { TIMES = 10, COUNTS = 20 };

/* pags_frame_stats as two arrays. */
typedef struct flat_stats {
  double times[TIMES];
  int64_t counts[COUNTS];
} flat_stats;
static_assert(sizeof(flat_stats) == sizeof(pags_frame_stats) &&
                  offsetof(pags_frame_stats, gaussians) == sizeof(double[TIMES]),
              "times, then counts");

static flat_stats flatten(const pags_frame_stats *stats) {
  flat_stats out;
  memcpy(&out, stats, sizeof out);
  return out;
}

void pags_frame_stats_add(pags_frame_stats *sum, const pags_frame_stats *one) {
  flat_stats all = flatten(sum);
  const flat_stats more = flatten(one);
  for (int i = 0; i < TIMES; i++)
    all.times[i] += more.times[i];
  for (int i = 0; i < COUNTS; i++)
    all.counts[i] += more.counts[i];
  memcpy(sum, &all, sizeof all);
}

void pags_frame_stats_divide(pags_frame_stats *sum, double n) {
  flat_stats all = flatten(sum);
  for (int i = 0; i < TIMES; i++)
    all.times[i] /= n;
  for (int i = 0; i < COUNTS; i++)
    all.counts[i] = (int64_t)((double)all.counts[i] / n);
  memcpy(sum, &all, sizeof all);
}
