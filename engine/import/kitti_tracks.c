/* SPDX-License-Identifier: Apache-2.0 */
/* Groups the boxes of KITTI's labels by track and transforms them to world coordinates. */
#include "import/kitti_tracks.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"

#define FASTEST_CAR 70.0 /* m/s */

void pags_kitti_tracks_destroy(pags_kitti_tracks *tracks) {
  for (int64_t i = 0; i < tracks->count; i++)
    pags_layout_track_destroy(&tracks->items[i]);
  free(tracks->items);
  *tracks = (pags_kitti_tracks){0};
}

/* Makes a track without keyframes, with room for `keyframes` of them. Its id is the number, with "-SUFFIX" unless the
 * suffix is empty. */
static pags_result begin_track(int64_t id, const char *suffix, const char *type, int64_t keyframes,
                               pags_layout_track *track) {
  char text[64];
  snprintf(text, sizeof text, "%lld%s%s", (long long)id, *suffix ? "-" : "", suffix);
  *track = (pags_layout_track){0};
  track->object.id = pags_text_copy(text);
  track->object.class_name = pags_text_copy(type);
  track->object.category = pags_category_of(type);
  track->object.keyframes = calloc((size_t)keyframes, sizeof *track->object.keyframes);
  if (track->object.id && track->object.class_name && track->object.keyframes)
    return PAGS_OK;
  pags_layout_track_destroy(track);
  return pags_out_of_memory("the track of a %s", type);
}

static void add_keyframe(pags_object *object, const pags_kitti_span *span, int64_t frame,
                         const double velo_from_object[12]) {
  pags_keyframe *keyframe = &object->keyframes[object->keyframe_count++];
  keyframe->frame = (int32_t)(frame - span->first);
  keyframe->trained = 1;
  keyframe->time = span->times[keyframe->frame];
  pags_rigid_multiply(span->world_from_velo[keyframe->frame], velo_from_object, keyframe->world_from_object);
}

/* ---- Tracking benchmark ---- */

static int compare_rows(const void *a, const void *b) {
  const pags_kitti_label *p = a, *q = b;
  if (p->track != q->track)
    return p->track < q->track ? -1 : 1;
  if (p->frame != q->frame)
    return p->frame < q->frame ? -1 : 1;
  const int order = strcmp(p->type, q->type);
  return order ? order : (p->line > q->line) - (p->line < q->line);
}

/* Copies the boxes of the imported frames to *rows, sorted by track and frame, and tells of those that are left out;
 * two boxes of a track in one frame fail unless their classes differ. */
static pags_result choose_rows(const char *path, const pags_kitti_labels *labels, const pags_kitti_span *span,
                               pags_kitti_label **rows, int64_t *count) {
  pags_tally late = {0}, flat = {0}, scores = {0};
  *count = 0;
  *rows = malloc((size_t)(labels->count ? labels->count : 1) * sizeof **rows);
  if (!*rows)
    return pags_out_of_memory("%s: its rows", path);
  for (int64_t i = 0; i < labels->count; i++) {
    const pags_kitti_label *row = &labels->rows[i];
    if (!pags_kitti_label_is_box(row) || row->frame < span->first)
      continue;
    if (row->frame >= span->total)
      pags_tally_add(&late, "%s of track %d in frame %d (line %d)", row->type, row->track, row->frame, row->line);
    else if (row->frame > span->last)
      continue;
    else if (!pags_kitti_label_has_volume(row))
      pags_tally_add(&flat, "%s of track %d in frame %d (line %d)", row->type, row->track, row->frame, row->line);
    else
      (*rows)[(*count)++] = *row;
    if (row->scored)
      pags_tally_add(&scores, "%g in line %d", row->score, row->line);
  }
  if (flat.count && !*count)
    return pags_fail(
        PAGS_ERROR_FORMAT,
        "%s: %lld boxes in these frames, but none has a height, width, length and place in space; the first "
        "is a %s; move the file elsewhere to import without boxes",
        path, (long long)flat.count, flat.first);
  pags_account_leave_out(span->account, "boxes", &late, "past the last photograph, frame %lld",
                         (long long)span->total - 1);
  pags_account_leave_out(span->account, "boxes", &flat, "no height, width, length or place in space");
  if (late.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld of %lld labels are left out, as there are photographs of frames 0 to %lld only; the "
                     "first is a %s",
                     path, (long long)late.count, (long long)labels->count, (long long)span->total - 1, late.first);
  if (flat.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld of %lld labels are left out, having no height, width, length or place in space; the "
                     "first is a %s",
                     path, (long long)flat.count, (long long)labels->count, flat.first);
  if (scores.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: the scores of %lld labels are ignored, all boxes count alike; the first is %s", path,
                     (long long)scores.count, scores.first);
  pags_sort(*rows, *count, sizeof **rows, compare_rows);
  for (int64_t i = 1; i < *count; i++) {
    const pags_kitti_label *a = &(*rows)[i - 1], *b = &(*rows)[i];
    if (a->track == b->track && a->frame == b->frame && !strcmp(a->type, b->type))
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: track %d has a box of frame %d in line %d already", path, b->line,
                       b->track, b->frame, a->line);
  }
  return PAGS_OK;
}

static void get_size(const pags_kitti_label *row, double size[3]) {
  size[0] = row->length;
  size[1] = row->width;
  size[2] = row->height;
}

static pags_result make_track(const pags_kitti_label *rows, int64_t count, const char *suffix, const char *type,
                              const double velo_from_cam0[12], const pags_kitti_span *span, pags_layout_track *track) {
  bool constant = true;
  PAGS_TRY(begin_track(rows->track, suffix, type, count, track));
  get_size(rows, track->object.size);
  for (int64_t i = 0; i < count; i++) {
    double size[3], pose[12];
    pags_kitti_label_pose(&rows[i], pose);
    pags_rigid_multiply(velo_from_cam0, pose, pose);
    add_keyframe(&track->object, span, rows[i].frame, pose);
    get_size(&rows[i], size);
    constant = constant && !memcmp(size, track->object.size, sizeof size);
  }
  pags_object_classify_motion(&track->object);
  if (constant)
    return PAGS_OK;
  track->sizes = malloc((size_t)count * 3 * sizeof *track->sizes);
  if (!track->sizes)
    return pags_out_of_memory("the track of a %s", type);
  for (int64_t i = 0; i < count; i++)
    get_size(&rows[i], track->sizes + 3 * i);
  return PAGS_OK;
}

/* Whether rows of one track number, whose classes differ, are one object nevertheless: of one category, one box a
 * frame, and nowhere faster than a car from one label to the next. */
static bool is_one_object(const pags_kitti_label *rows, int64_t count, const double velo_from_cam0[12],
                          const pags_kitti_span *span) {
  double before[3] = {0};
  for (int64_t i = 0; i < count; i++) {
    double pose[12], at[3], way = 0;
    pags_kitti_label_pose(&rows[i], pose);
    pags_rigid_multiply(velo_from_cam0, pose, pose);
    pags_rigid_multiply(span->world_from_velo[rows[i].frame - span->first], pose, pose);
    for (int k = 0; k < 3; k++) {
      at[k] = pose[4 * k + 3];
      way += (at[k] - before[k]) * (at[k] - before[k]);
      before[k] = at[k];
    }
    if (i == 0)
      continue;
    const double time = span->times[rows[i].frame - span->first] - span->times[rows[i - 1].frame - span->first];
    if (pags_category_of(rows[i].type) != pags_category_of(rows->type) || !(time > 0) ||
        sqrt(way) > 1 + FASTEST_CAR * time)
      return false;
  }
  return true;
}

/* Finds the class that most rows have; of several, the first one. */
static const char *commonest_class(const pags_kitti_label *rows, int64_t count) {
  int64_t best = 0, most = 0;
  for (int64_t i = 0; i < count; i++) {
    int64_t same = 0;
    for (int64_t j = 0; j < count; j++)
      same += !strcmp(rows[i].type, rows[j].type);
    if (same > most)
      best = i, most = same;
  }
  return rows[best].type;
}

/* Makes the track of each class among the rows of one track number, which are sorted by frame. They are moved within
 * the array. */
static pags_result split_classes(pags_kitti_label *rows, int64_t count, const double velo_from_cam0[12],
                                 const pags_kitti_span *span, pags_kitti_tracks *out) {
  for (int64_t begin = 0, end; begin < count; begin = end) {
    /* Bring the rows of the first row's class to the front; both parts keep their order. */
    end = begin + 1;
    for (int64_t i = end; i < count; i++)
      if (!strcmp(rows[i].type, rows[begin].type)) {
        const pags_kitti_label row = rows[i];
        memmove(rows + end + 1, rows + end, (size_t)(i - end) * sizeof row);
        rows[end++] = row;
      }
    PAGS_TRY(make_track(rows + begin, end - begin, begin ? rows[begin].type : "", rows[begin].type, velo_from_cam0,
                        span, &out->items[out->count++]));
  }
  return PAGS_OK;
}

/* Makes the tracks. A track number is unique within a class only if a tracker counts each class for itself. */
static pags_result make_tracks(const char *path, pags_kitti_label *rows, int64_t count, const double velo_from_cam0[12],
                               const pags_kitti_span *span, pags_kitti_tracks *out) {
  pags_tally split = {0}, mixed = {0};
  out->items = calloc((size_t)(count ? count : 1), sizeof *out->items); /* a track has a row or more */
  if (!out->items)
    return pags_out_of_memory("%lld tracks", (long long)count);
  for (int64_t begin = 0, end; begin < count; begin = end) {
    const pags_kitti_label *first = rows + begin, *other = NULL;
    for (end = begin + 1; end < count && rows[end].track == first->track; end++)
      if (strcmp(rows[end].type, first->type) != 0)
        other = &rows[end];
    if (other && !is_one_object(first, end - begin, velo_from_cam0, span)) {
      pags_tally_add(&split, "%d, a %s in frame %d and a %s in frame %d", first->track, first->type, first->frame,
                     other->type, other->frame);
      PAGS_TRY(split_classes(rows + begin, end - begin, velo_from_cam0, span, out));
      continue;
    }
    const char *type = other ? commonest_class(first, end - begin) : first->type;
    if (other)
      pags_tally_add(&mixed, "%d, a %s in frame %d and a %s in frame %d", first->track, first->type, first->frame,
                     other->type, other->frame);
    PAGS_TRY(make_track(first, end - begin, "", type, velo_from_cam0, span, &out->items[out->count++]));
  }
  if (split.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld track numbers belong to things of several classes, each of which became an object of "
                     "its own; the first is %s",
                     path, (long long)split.count, split.first);
  if (mixed.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: the class of %lld tracks changes, each got the class of most of its labels; the first is %s",
                     path, (long long)mixed.count, mixed.first);
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
    result = make_tracks(path, rows, count, velo_from_cam0, span, out);
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
  PAGS_TRY(begin_track(id, "", tracklet->type, end - begin, track));
  out->count++;
  track->object.size[0] = tracklet->length;
  track->object.size[1] = tracklet->width;
  track->object.size[2] = tracklet->height;
  for (int64_t frame = begin; frame < end; frame++) {
    double pose[12];
    pags_kitti_tracklet_pose(tracklet, frame - tracklet->first_frame, pose);
    add_keyframe(&track->object, span, frame, pose);
  }
  pags_object_classify_motion(&track->object);
  return PAGS_OK;
}

pags_result pags_kitti_tracks_from_tracklets(const char *path, const pags_kitti_tracklets *tracklets,
                                             const pags_kitti_span *span, pags_kitti_tracks *out) {
  *out = (pags_kitti_tracks){.items = calloc((size_t)(tracklets->count ? tracklets->count : 1), sizeof *out->items)};
  pags_result result = out->items ? PAGS_OK : pags_out_of_memory("%s: its tracks", path);
  pags_tally late = {0}, empty = {0};
  int64_t flat = 0; /* tracklets with poses, but without a size */
  for (int64_t i = 0; i < tracklets->count && result == PAGS_OK; i++) {
    const pags_kitti_tracklet *tracklet = &tracklets->items[i];
    const int64_t last = tracklet->first_frame + tracklet->count - 1;
    if (tracklet->count && last >= span->total)
      pags_tally_add(&late, "tracklet %lld, a %s of frames %lld to %lld", (long long)i, tracklet->type,
                     (long long)tracklet->first_frame, (long long)last);
    const bool sized = tracklet->height > 0 && tracklet->width > 0 && tracklet->length > 0;
    flat += tracklet->count && !sized;
    if (!tracklet->count || !sized)
      pags_tally_add(&empty, "tracklet %lld, a %s of frame %lld", (long long)i, tracklet->type,
                     (long long)tracklet->first_frame);
    else
      result = add_tracklet(tracklet, i, span, out);
  }
  pags_account_leave_out(span->account, "tracklets", &late, "their boxes past the last photograph, frame %lld",
                         (long long)span->total - 1);
  pags_account_leave_out(span->account, "tracklets", &empty, "no poses or no size");
  if (result == PAGS_OK && flat == tracklets->count && flat)
    result = pags_fail(PAGS_ERROR_FORMAT,
                       "%s: %lld tracklets, but none has a size; the first is %s; move the file elsewhere to import "
                       "without boxes",
                       path, (long long)flat, empty.first);
  if (late.count)
    pags_log_message(
        PAGS_LOG_WARNING,
        "%s: the boxes of %lld of %lld tracklets past frame %lld, the last photograph's, are left out; the "
        "first is %s",
        path, (long long)late.count, (long long)tracklets->count, (long long)span->total - 1, late.first);
  if (empty.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld of %lld tracklets are left out, having no poses or no size; the first is %s", path,
                     (long long)empty.count, (long long)tracklets->count, empty.first);
  if (result != PAGS_OK)
    pags_kitti_tracks_destroy(out);
  return result;
}
