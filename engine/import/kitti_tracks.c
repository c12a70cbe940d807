/* SPDX-License-Identifier: Apache-2.0 */
/* Groups the boxes of KITTI's labels by track and transforms them to world coordinates. */
#include "import/kitti_tracks.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "base/vec3.h"

#define FASTEST_CAR 70.0 /* m/s */

void pags_kitti_tracks_destroy(pags_kitti_tracks *tracks) {
  for (int64_t i = 0; i < tracks->count; i++)
    pags_layout_track_destroy(&tracks->items[i]);
  free(tracks->items);
  *tracks = (pags_kitti_tracks){0};
}

/* Adds a track without keyframes, with room for `keyframes` of them. Its id is the number, with "-SUFFIX" unless the
 * suffix is empty. */
static pags_result add_track(pags_kitti_tracks *tracks, int64_t id, const char *suffix, const char *type,
                             const double size[3], int64_t keyframes, pags_layout_track **out) {
  *out = &tracks->items[tracks->count++];
  pags_object *object = &(*out)->object;
  object->id = pags_text_format("%lld%s%s", (long long)id, *suffix ? "-" : "", suffix);
  object->class_name = pags_text_copy(type);
  object->category = pags_category_of(type);
  object->keyframes = calloc((size_t)keyframes, sizeof *object->keyframes);
  pags_copy3(size, object->size);
  PAGS_CHECK_MEMORY(object->id && object->class_name && object->keyframes, "the track of a %s", type);
  return PAGS_OK;
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

/* Copies the boxes of the imported frames to `rows`, sorted by track and frame, and tells of those that are left out;
 * two boxes of a track in one frame fail unless their classes differ. */
static pags_result choose_rows(const char *path, const pags_kitti_labels *labels, const pags_kitti_span *span,
                               pags_kitti_label *rows, int64_t *count) {
  pags_tally late = {0}, flat = {0}, scores = {0};
  *count = 0;
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
      rows[(*count)++] = *row;
    if (row->scored)
      pags_tally_add(&scores, "%g in line %d", row->score, row->line);
  }
  if (flat.count && !*count)
    return pags_fail_at(path,
                        "%lld boxes in these frames, but none has a height, width, length and place in space; the "
                        "first is a %s; move the file elsewhere to import without boxes",
                        (long long)flat.count, flat.first);
  pags_account_leave_out(span->account, "boxes", &late, "past the last photograph, frame %lld",
                         (long long)span->total - 1);
  pags_account_leave_out(span->account, "boxes", &flat, "no height, width, length or place in space");
  if (late.count)
    PAGS_WARN(
        "%s: %lld of %lld labels are left out, as there are photographs of frames 0 to %lld only; the first is a %s",
        path, (long long)late.count, (long long)labels->count, (long long)span->total - 1, late.first);
  if (flat.count)
    PAGS_WARN(
        "%s: %lld of %lld labels are left out, having no height, width, length or place in space; the first is a %s",
        path, (long long)flat.count, (long long)labels->count, flat.first);
  if (scores.count)
    PAGS_WARN("%s: the scores of %lld labels are ignored, all boxes count alike; the first is %s", path,
              (long long)scores.count, scores.first);
  pags_sort(rows, *count, sizeof *rows, compare_rows);
  for (int64_t i = 1; i < *count; i++) {
    const pags_kitti_label *a = &rows[i - 1], *b = &rows[i];
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

static void pose_in_velo(const pags_kitti_label *row, const double velo_from_cam0[12], double out[12]) {
  pags_kitti_label_pose(row, out);
  pags_rigid_multiply(velo_from_cam0, out, out);
}

static pags_result make_track(const pags_kitti_label *rows, int64_t count, const char *suffix, const char *type,
                              const double velo_from_cam0[12], const pags_kitti_span *span, pags_kitti_tracks *out) {
  double first[3], size[3], pose[12];
  pags_layout_track *track;
  bool constant = true;
  get_size(rows, first);
  PAGS_TRY(add_track(out, rows->track, suffix, type, first, count, &track));
  for (int64_t i = 0; i < count; i++) {
    pose_in_velo(&rows[i], velo_from_cam0, pose);
    add_keyframe(&track->object, span, rows[i].frame, pose);
    get_size(&rows[i], size);
    constant = constant && !memcmp(size, first, sizeof size);
  }
  pags_object_classify_motion(&track->object);
  if (constant)
    return PAGS_OK;
  track->sizes = malloc((size_t)count * 3 * sizeof *track->sizes);
  PAGS_CHECK_MEMORY(track->sizes, "the track of a %s", type);
  for (int64_t i = 0; i < count; i++)
    get_size(&rows[i], track->sizes + 3 * i);
  return PAGS_OK;
}

/* Whether rows of one track number, whose classes differ, are one object nevertheless: of one category, one box a
 * frame, and nowhere faster than a car from one label to the next. */
static bool is_one_object(const pags_kitti_label *rows, int64_t count, const double velo_from_cam0[12],
                          const pags_kitti_span *span) {
  double before[3] = {0}, at[3], pose[12];
  for (int64_t i = 0; i < count; i++, pags_copy3(at, before)) {
    const int64_t frame = rows[i].frame - span->first;
    pose_in_velo(&rows[i], velo_from_cam0, pose);
    pags_rigid_multiply(span->world_from_velo[frame], pose, pose);
    pags_pose_position(pose, at);
    if (i == 0)
      continue;
    const double time = span->times[frame] - span->times[rows[i - 1].frame - span->first];
    if (pags_category_of(rows[i].type) != pags_category_of(rows->type) || !(time > 0) ||
        pags_distance3(at, before) > 1 + FASTEST_CAR * time)
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
                        span, out));
  }
  return PAGS_OK;
}

/* A track number is unique within a class only if a tracker counts each class for itself. */
pags_result pags_kitti_tracks_from_labels(const char *path, const pags_kitti_labels *labels,
                                          const double cam0_from_velo[12], const pags_kitti_span *span,
                                          pags_kitti_tracks *out) {
  double velo_from_cam0[12];
  pags_tally split = {0}, mixed = {0};
  int64_t count;
  PAGS_AUTOFREE pags_kitti_label *rows = malloc((size_t)(labels->count ? labels->count : 1) * sizeof *rows);
  PAGS_CHECK_MEMORY(rows, "%s: its rows", path);
  pags_rigid_inverse(cam0_from_velo, velo_from_cam0);
  PAGS_TRY(choose_rows(path, labels, span, rows, &count));
  *out = (pags_kitti_tracks){.items = calloc((size_t)(count ? count : 1), sizeof *out->items)}; /* a row or more each */
  PAGS_CHECK_MEMORY(out->items, "%lld tracks", (long long)count);
  for (int64_t begin = 0, end; begin < count; begin = end) {
    const pags_kitti_label *first = rows + begin, *other = NULL;
    for (end = begin + 1; end < count && rows[end].track == first->track; end++)
      if (strcmp(rows[end].type, first->type) != 0)
        other = &rows[end];
    const bool is_split = other && !is_one_object(first, end - begin, velo_from_cam0, span);
    if (other)
      pags_tally_add(is_split ? &split : &mixed, "%d, a %s in frame %d and a %s in frame %d", first->track, first->type,
                     first->frame, other->type, other->frame);
    const char *type = other ? commonest_class(first, end - begin) : first->type;
    PAGS_TRY(is_split ? split_classes(rows + begin, end - begin, velo_from_cam0, span, out)
                      : make_track(first, end - begin, "", type, velo_from_cam0, span, out));
  }
  if (split.count)
    PAGS_WARN(
        "%s: %lld track numbers belong to things of several classes, each of which became an object of its own; the "
        "first is %s",
        path, (long long)split.count, split.first);
  if (mixed.count)
    PAGS_WARN("%s: the class of %lld tracks changes, each got the class of most of its labels; the first is %s", path,
              (long long)mixed.count, mixed.first);
  return PAGS_OK;
}

/* ---- Raw recordings ---- */

static pags_result add_tracklet(const pags_kitti_tracklet *tracklet, int64_t id, const pags_kitti_span *span,
                                pags_kitti_tracks *out) {
  const int64_t begin = tracklet->first_frame > span->first ? tracklet->first_frame : span->first;
  const int64_t after = tracklet->first_frame + tracklet->count;
  const int64_t end = after <= span->last ? after : span->last + 1;
  const double size[3] = {tracklet->length, tracklet->width, tracklet->height};
  if (begin >= end)
    return PAGS_OK;
  pags_layout_track *track;
  PAGS_TRY(add_track(out, id, "", tracklet->type, size, end - begin, &track));
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
  PAGS_CHECK_MEMORY(out->items, "%s: its tracks", path);
  pags_tally late = {0}, empty = {0};
  int64_t flat = 0; /* tracklets with poses, but without a size */
  for (int64_t i = 0; i < tracklets->count; i++) {
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
      PAGS_TRY(add_tracklet(tracklet, i, span, out));
  }
  pags_account_leave_out(span->account, "tracklets", &late, "their boxes past the last photograph, frame %lld",
                         (long long)span->total - 1);
  pags_account_leave_out(span->account, "tracklets", &empty, "no poses or no size");
  if (late.count)
    PAGS_WARN(
        "%s: the boxes of %lld of %lld tracklets past frame %lld, the last photograph's, are left out; the first is %s",
        path, (long long)late.count, (long long)tracklets->count, (long long)span->total - 1, late.first);
  if (empty.count)
    PAGS_WARN("%s: %lld of %lld tracklets are left out, having no poses or no size; the first is %s", path,
              (long long)empty.count, (long long)tracklets->count, empty.first);
  if (flat == tracklets->count && flat)
    return pags_fail_at(
        path, "%lld tracklets, but none has a size; the first is %s; move the file elsewhere to import without boxes",
        (long long)flat, empty.first);
  return PAGS_OK;
}
