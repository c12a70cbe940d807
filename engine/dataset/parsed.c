/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation and release of the parsed data set that the readers fill in (parsed.h). */
#include "dataset/driving/driving_set.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"

void pags_parsed_view_destroy(pags_parsed_view *view) {
  free(view->image_path);
  free(view->mask_path);
  free(view->where);
  free(view->sky_path);
  free(view->semantic_path);
  free(view->dynamic_path);
  free(view->part_path);
  free(view->no_pose);
  *view = (pags_parsed_view){0};
}

void pags_parsed_destroy(pags_parsed_dataset *parsed) {
  for (int64_t i = 0; i < parsed->count; i++)
    pags_parsed_view_destroy(&parsed->views[i]);
  free(parsed->views);
  free(parsed->source);
  free(parsed->points.items);
  free(parsed->points.track);
  pags_driving_destroy(parsed->driving);
  memset(parsed, 0, sizeof *parsed);
}

pags_parsed_view *pags_parsed_add(pags_parsed_dataset *parsed) {
  if (!pags_grow(&parsed->views, parsed->count + 1, &parsed->capacity, sizeof *parsed->views))
    return NULL;
  pags_parsed_view *view = &parsed->views[parsed->count++];
  *view = (pags_parsed_view){0};
  return view;
}

pags_result pags_parsed_add_point(pags_parsed_points *points, int64_t id, const double xyz[3], const uint8_t rgb[3],
                                  const char *where) {
  /* Positions beyond 1e30 have no place among single-precision numbers. */
  points->dropped = !(fabs(xyz[0]) < 1e30 && fabs(xyz[1]) < 1e30 && fabs(xyz[2]) < 1e30);
  if (points->dropped) {
    points->first_left_out = points->left_out ? points->first_left_out : id;
    points->left_out++;
    return PAGS_OK;
  }
  PAGS_CHECK_MEMORY(pags_grow(&points->items, points->count + 1, &points->capacity, sizeof *points->items), "%s",
                    where);
  pags_parsed_point *point = &points->items[points->count++];
  *point = (pags_parsed_point){.id = id, .track_begin = points->track_count};
  memcpy(point->xyz, xyz, sizeof point->xyz);
  memcpy(point->rgb, rgb, sizeof point->rgb);
  return PAGS_OK;
}

pags_result pags_parsed_observe(pags_parsed_points *points, int64_t view, const char *where) {
  if (points->dropped)
    return PAGS_OK;
  assert(points->count > 0);
  PAGS_CHECK_MEMORY(pags_grow(&points->track, points->track_count + 1, &points->track_capacity, sizeof *points->track),
                    "%s", where);
  points->track[points->track_count++] = view;
  points->items[points->count - 1].track_count++;
  return PAGS_OK;
}

pags_result pags_parsed_check_points(const pags_parsed_points *points, const char *where) {
  const long long all = (long long)(points->count + points->left_out), lost = (long long)points->left_out;
  if (lost && points->count == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: none of its %lld points has a finite position", where, all);
  if (lost)
    PAGS_WARN("%s: %lld of %lld points have no finite position and are left out, the first is point %lld", where, lost,
              all, (long long)points->first_left_out);
  return PAGS_OK;
}

static int by_id(const void *a, const void *b) {
  int64_t left = ((const pags_parsed_point *)a)->id, right = ((const pags_parsed_point *)b)->id;
  return left < right ? -1 : left > right;
}

void pags_parsed_sort_points(pags_parsed_points *points) {
  pags_sort(points->items, points->count, sizeof *points->items, by_id);
}
