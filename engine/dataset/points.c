/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the initial points of training: the points of the data set's reconstruction (COLMAP or SfM) if it has some,
 * else a number of points to match. A driving set without such points gets none here, because its training starts from
 * LiDAR points. */
#include "dataset/driving/reader.h"
#include "dataset/internal.h"

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Whether the view with this id is a training view. The tracks of points name their observers by these ids; the table
 * is sorted by id. */
typedef struct id_use {
  int64_t id;
  bool training;
} id_use;

static int by_id(const void *a, const void *b) {
  int64_t left = ((const id_use *)a)->id, right = ((const id_use *)b)->id;
  return left < right ? -1 : left > right;
}

/* Whether a point is used: at least `least` training views must observe it, if tracks are known. `least` is 2 where
 * points were triangulated, because the position of any other point came about with the help of held-out views, and
 * training must not use information from these. Where no track has two views (points from depth, or from a network
 * that sees one picture at a time), it is 1. A point of which no view is known is used like one of a PLY file: it comes
 * from a scanner or another program. */
static bool is_used(const pags_parsed_points *points, const pags_parsed_point *point, const id_use *uses, int64_t views,
                    int least) {
  int seen = 0; /* training views that observe the point, counted up to 2 */
  bool known = false;
  for (int64_t i = 0; i < point->track_count && seen < 2; i++) {
    id_use key = {.id = points->track[point->track_begin + i]};
    const id_use *found = bsearch(&key, uses, (size_t)views, sizeof key, by_id);
    known = known || found;
    seen += found && found->training;
  }
  return !points->tracked || seen >= least || !known;
}

/* Copies the usable points of the reconstruction, relative to the origin. */
static pags_result use_reconstruction(pags_dataset *dataset) {
  const pags_parsed_points *points = &dataset->parsed.points;
  free(dataset->xyz);
  free(dataset->rgb);
  dataset->xyz = malloc(((size_t)points->count + 1) * 3 * sizeof *dataset->xyz);
  dataset->rgb = malloc(((size_t)points->count + 1) * 3);
  PAGS_AUTOFREE id_use *uses = malloc((size_t)dataset->count * sizeof *uses);
  PAGS_CHECK_MEMORY(dataset->xyz && dataset->rgb && uses, "%s", dataset->path);
  for (int64_t i = 0; i < dataset->count; i++)
    uses[i] = (id_use){dataset->parsed.views[i].id, !dataset->views[i].test};
  pags_sort(uses, dataset->count, sizeof *uses, by_id);
  int64_t longest = 0, kept = 0;
  for (int64_t i = 0; i < points->count; i++)
    longest = points->items[i].track_count > longest ? points->items[i].track_count : longest;
  const int least = longest < 2 ? 1 : 2;
  for (int64_t i = 0; i < points->count; i++) {
    const pags_parsed_point *point = &points->items[i];
    if (!is_used(points, point, uses, dataset->count, least))
      continue;
    for (int c = 0; c < 3; c++)
      dataset->xyz[3 * kept + c] = (float)(point->xyz[c] - dataset->origin[c]);
    memcpy(dataset->rgb + 3 * kept, point->rgb, 3);
    kept++;
  }
  dataset->point_count = kept;
  if (kept < points->count)
    pags_log_message(kept ? PAGS_LOG_INFO : PAGS_LOG_WARNING,
                     "%s: %lld of %lld points are left out: fewer than %d training view%s them", dataset->parsed.source,
                     (long long)(points->count - kept), (long long)points->count, least,
                     least == 1 ? " sees" : "s see");
  return PAGS_OK;
}

pags_result pags_dataset_make_points(pags_dataset *dataset, const pags_dataset_options *options) {
  if (dataset->parsed.driving && options->sfm)
    PAGS_TRY(pags_sfm_points_read(options->sfm, &dataset->parsed));
  if (dataset->parsed.points.count > 0)
    PAGS_TRY(use_reconstruction(dataset));
  if (dataset->point_count == 0 && !dataset->parsed.driving) {
    dataset->point_count = options->random_points;
    dataset->to_match = 1;
  }
  return PAGS_OK;
}
