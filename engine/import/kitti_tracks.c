/* SPDX-License-Identifier: Apache-2.0 */
/* Groups the boxes of KITTI's labels by track and transforms them to world coordinates. */
#include "import/kitti_tracks.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"

void pags_kitti_tracks_destroy(pags_kitti_tracks *tracks) {
  for (int64_t i = 0; i < tracks->count; i++)
    pags_layout_track_destroy(&tracks->items[i]);
  free(tracks->items);
  *tracks = (pags_kitti_tracks){0};
}

/* Makes a track without knots, with room for `knots` of them. */
static pags_result begin_track(int64_t id, const char *type, int64_t knots, pags_layout_track *track) {
  char text[24];
  snprintf(text, sizeof text, "%lld", (long long)id);
  *track = (pags_layout_track){0};
  track->object.id = pags_text_copy(text);
  track->object.class_name = pags_text_copy(type);
  track->object.category = pags_category_of(type);
  track->object.knots = calloc((size_t)knots, sizeof *track->object.knots);
  if (track->object.id && track->object.class_name && track->object.knots)
    return PAGS_OK;
  pags_layout_track_destroy(track);
  return pags_out_of_memory("the track of a %s", type);
}

static void add_knot(pags_object *object, const pags_kitti_span *span, int64_t frame,
                     const double velo_from_object[12]) {
  pags_knot *knot = &object->knots[object->knot_count++];
  knot->frame = (int32_t)(frame - span->first);
  knot->trained = 1;
  knot->time = span->times[knot->frame];
  pags_rigid_multiply(span->world_from_velo[knot->frame], velo_from_object, knot->world_from_object);
}

/* ---- Tracking benchmark ---- */

static int compare_rows(const void *a, const void *b) {
  const pags_kitti_label *p = a, *q = b;
  if (p->track != q->track)
    return p->track < q->track ? -1 : 1;
  return (p->frame > q->frame) - (p->frame < q->frame);
}

/* Copies the boxes of the imported frames to *rows, sorted by track and frame; two boxes of a track in one frame
 * fail. */
static pags_result choose_rows(const char *path, const pags_kitti_labels *labels, const pags_kitti_span *span,
                               pags_kitti_label **rows, int64_t *count) {
  *count = 0;
  *rows = malloc((size_t)(labels->count ? labels->count : 1) * sizeof **rows);
  if (!*rows)
    return pags_out_of_memory("%s: its rows", path);
  for (int64_t i = 0; i < labels->count; i++) {
    const pags_kitti_label *row = &labels->rows[i];
    if (row->frame >= span->total)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s:%d: a label of frame %d, but there are photographs of frames 0 to %lld only", path,
                       row->line, row->frame, (long long)span->total - 1);
    if (pags_kitti_label_is_box(row) && row->frame >= span->first && row->frame <= span->last)
      (*rows)[(*count)++] = *row;
  }
  pags_sort(*rows, *count, sizeof **rows, compare_rows);
  for (int64_t i = 1; i < *count; i++)
    if (compare_rows(*rows + i - 1, *rows + i) == 0)
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: track %d has a box of frame %d in line %d already", path,
                       (*rows)[i].line, (*rows)[i].track, (*rows)[i].frame, (*rows)[i - 1].line);
  return PAGS_OK;
}

static void get_size(const pags_kitti_label *row, double size[3]) {
  size[0] = row->length;
  size[1] = row->width;
  size[2] = row->height;
}

static pags_result make_track(const pags_kitti_label *rows, int64_t count, const double velo_from_cam0[12],
                              const pags_kitti_span *span, pags_layout_track *track) {
  bool constant = true;
  PAGS_TRY(begin_track(rows->track, rows->type, count, track));
  get_size(rows, track->object.size);
  for (int64_t i = 0; i < count; i++) {
    double size[3], pose[12];
    pags_kitti_label_pose(&rows[i], pose);
    pags_rigid_multiply(velo_from_cam0, pose, pose);
    add_knot(&track->object, span, rows[i].frame, pose);
    get_size(&rows[i], size);
    constant = constant && !memcmp(size, track->object.size, sizeof size);
  }
  pags_object_classify_motion(&track->object);
  if (constant)
    return PAGS_OK;
  track->sizes = malloc((size_t)count * 3 * sizeof *track->sizes);
  if (!track->sizes)
    return pags_out_of_memory("the track of a %s", rows->type);
  for (int64_t i = 0; i < count; i++)
    get_size(&rows[i], track->sizes + 3 * i);
  return PAGS_OK;
}

static pags_result make_tracks(const pags_kitti_label *rows, int64_t count, const double velo_from_cam0[12],
                               const pags_kitti_span *span, pags_kitti_tracks *out) {
  int64_t tracks = 0;
  for (int64_t i = 0; i < count; i++)
    tracks += i == 0 || rows[i].track != rows[i - 1].track;
  out->items = calloc((size_t)(tracks ? tracks : 1), sizeof *out->items);
  if (!out->items)
    return pags_out_of_memory("%lld tracks", (long long)tracks);
  for (int64_t begin = 0, end; begin < count; begin = end) {
    for (end = begin + 1; end < count && rows[end].track == rows[begin].track;)
      end++;
    PAGS_TRY(make_track(rows + begin, end - begin, velo_from_cam0, span, &out->items[out->count++]));
  }
  return PAGS_OK;
}

pags_result pags_kitti_tracks_from_labels(const char *path, const pags_kitti_labels *labels,
                                          const double cam0_from_velo[12], const pags_kitti_span *span,
                                          pags_kitti_tracks *out) {
  pags_kitti_label *rows = NULL;
  int64_t count = 0;
  double velo_from_cam0[12];
  *out = (pags_kitti_tracks){0};
  pags_rigid_inverse(cam0_from_velo, velo_from_cam0);
  pags_result result = choose_rows(path, labels, span, &rows, &count);
  if (result == PAGS_OK)
    result = make_tracks(rows, count, velo_from_cam0, span, out);
  free(rows);
  if (result != PAGS_OK)
    pags_kitti_tracks_destroy(out);
  return result;
}

/* ---- Raw recordings ---- */

static pags_result add_tracklet(const pags_kitti_tracklet *tracklet, int64_t id, const pags_kitti_span *span,
                                pags_kitti_tracks *out) {
  const int64_t begin = tracklet->first_frame > span->first ? tracklet->first_frame : span->first;
  const int64_t after = tracklet->first_frame + tracklet->count;
  const int64_t end = after <= span->last ? after : span->last + 1;
  if (begin >= end)
    return PAGS_OK;
  pags_layout_track *track = &out->items[out->count];
  PAGS_TRY(begin_track(id, tracklet->type, end - begin, track));
  out->count++;
  track->object.size[0] = tracklet->length;
  track->object.size[1] = tracklet->width;
  track->object.size[2] = tracklet->height;
  for (int64_t frame = begin; frame < end; frame++) {
    double pose[12];
    pags_kitti_tracklet_pose(tracklet, frame - tracklet->first_frame, pose);
    add_knot(&track->object, span, frame, pose);
  }
  pags_object_classify_motion(&track->object);
  return PAGS_OK;
}

pags_result pags_kitti_tracks_from_tracklets(const char *path, const pags_kitti_tracklets *tracklets,
                                             const pags_kitti_span *span, pags_kitti_tracks *out) {
  *out = (pags_kitti_tracks){.items = calloc((size_t)(tracklets->count ? tracklets->count : 1), sizeof *out->items)};
  pags_result result = out->items ? PAGS_OK : pags_out_of_memory("%s: its tracks", path);
  for (int64_t i = 0; i < tracklets->count && result == PAGS_OK; i++) {
    const pags_kitti_tracklet *tracklet = &tracklets->items[i];
    if (tracklet->count > span->total - tracklet->first_frame)
      result = pags_fail(
          PAGS_ERROR_FORMAT,
          "%s: tracklet %lld has boxes of frames %lld to %lld, but there are photographs of frames 0 to %lld only",
          path, (long long)i, (long long)tracklet->first_frame,
          (long long)(tracklet->first_frame + tracklet->count - 1), (long long)span->total - 1);
    else
      result = add_tracklet(tracklet, i, span, out);
  }
  if (result != PAGS_OK)
    pags_kitti_tracks_destroy(out);
  return result;
}
