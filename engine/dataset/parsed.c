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

/* Makes room for one more item of `size` bytes in *items by doubling the capacity; false when out of memory. */
static bool grow(void **items, int64_t count, int64_t *capacity, size_t size) {
  if (count < *capacity)
    return true;
  int64_t larger = *capacity ? 2 * *capacity : 64;
  void *moved = (uint64_t)larger <= SIZE_MAX / size ? realloc(*items, (size_t)larger * size) : NULL;
  if (!moved)
    return false;
  *items = moved;
  *capacity = larger;
  return true;
}

pags_parsed_view *pags_parsed_add(pags_parsed_dataset *parsed) {
  void *views = parsed->views;
  if (!grow(&views, parsed->count, &parsed->capacity, sizeof *parsed->views))
    return NULL;
  parsed->views = views;
  pags_parsed_view *view = &parsed->views[parsed->count++];
  memset(view, 0, sizeof *view);
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
  void *items = points->items;
  if (!grow(&items, points->count, &points->capacity, sizeof *points->items))
    return pags_out_of_memory("%s", where);
  points->items = items;
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
  void *track = points->track;
  if (!grow(&track, points->track_count, &points->track_capacity, sizeof *points->track))
    return pags_out_of_memory("%s", where);
  points->track = track;
  points->track[points->track_count++] = view;
  points->items[points->count - 1].track_count++;
  return PAGS_OK;
}

pags_result pags_parsed_check_points(const pags_parsed_points *points, const char *where) {
  const long long all = (long long)(points->count + points->left_out), lost = (long long)points->left_out;
  if (lost && points->count == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: none of its %lld points has a finite position", where, all);
  if (lost)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld of %lld points have no finite position and are left out, the first is point %lld", where,
                     lost, all, (long long)points->first_left_out);
  return PAGS_OK;
}

static int by_id(const void *a, const void *b) {
  int64_t left = ((const pags_parsed_point *)a)->id, right = ((const pags_parsed_point *)b)->id;
  return left < right ? -1 : left > right;
}

void pags_parsed_sort_points(pags_parsed_points *points) {
  if (points->count > 0)
    pags_sort(points->items, points->count, sizeof *points->items, by_id);
}
