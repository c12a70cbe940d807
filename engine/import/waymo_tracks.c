/* SPDX-License-Identifier: Apache-2.0 */
/* Groups Waymo's boxes into tracks (waymo_tracks.h) by sorting all labels by id and order, so that the time doesn't
 * grow with the square of their number. */
#include "import/waymo_tracks.h"

#include <assert.h>
#include <math.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "base/vec3.h"
#include "maths/maths.h"

struct pags_waymo_box {
  char *id;
  int64_t frame, order; /* order: index of the label among all usable labels */
  int64_t track;        /* track number: `order` of the first label with this id */
  int type;
  bool renamed; /* another class has the same id: this one's name is added */
  double time;
  double world_from_object[12];
  double size[3];
};

static const char *class_name(int type) {
  static const char *const names[] = {"Unknown", "Vehicle", "Pedestrian", "Sign", "Cyclist"};
  return type >= 0 && type < (int)(sizeof names / sizeof *names) ? names[type] : names[0];
}

/* An id is usable if it is 1..255 printable ASCII characters, since ids are written to JSON. */
static bool is_usable_id(const char *id) {
  size_t length = 0;
  for (; id && id[length]; length++)
    if (id[length] < ' ' || id[length] > '~')
      return false;
  return length > 0 && length < 256;
}

static bool is_usable(const Pags__Waymo__Label *label) {
  const Pags__Waymo__Box *b = label->box;
  return b && is_usable_id(label->id) && isfinite(b->center_x) && isfinite(b->center_y) && isfinite(b->center_z) &&
         isfinite(b->heading) && b->length > 0 && b->width > 0 && b->height > 0 && b->length < 1e4 && b->width < 1e4 &&
         b->height < 1e4;
}

pags_result pags_waymo_boxes_add(pags_waymo_boxes *boxes, const pags_waymo_frame *message, int64_t frame, double time,
                                 const double world_from_vehicle[12], const char *where) {
  assert(boxes && message && where);
  PAGS_CHECK_MEMORY(
      pags_grow(&boxes->boxes, boxes->count + (int64_t)message->n_laser_labels, &boxes->capacity, sizeof *boxes->boxes),
      "%s: %zu boxes", where, 2 * ((size_t)boxes->count + message->n_laser_labels));
  for (size_t i = 0; i < message->n_laser_labels; i++) {
    const Pags__Waymo__Label *label = message->laser_labels[i];
    if (!is_usable(label)) {
      pags_tally_add(&boxes->unusable, "%s '%.40s' in frame %lld", class_name(label->type),
                     is_usable_id(label->id) ? label->id : "", (long long)frame);
      continue;
    }
    pags_waymo_box *box = &boxes->boxes[boxes->count];
    *box = (pags_waymo_box){.id = pags_text_copy(label->id),
                            .frame = frame,
                            .order = boxes->count,
                            .type = label->type,
                            .time = time,
                            .size = {label->box->length, label->box->width, label->box->height}};
    PAGS_CHECK_MEMORY(box->id, "%s", where);
    /* The pose in the vehicle frame: a rotation about z by the heading, origin at the centre of the box. */
    const Pags__Waymo__Box *b = label->box;
    const double c = pags_cos(b->heading), s = pags_sin(b->heading);
    const double local[12] = {c, -s, 0, b->center_x, s, c, 0, b->center_y, 0, 0, 1, b->center_z};
    pags_rigid_multiply(world_from_vehicle, local, box->world_from_object);
    boxes->count++;
  }
  return PAGS_OK;
}

static int by_id(const void *left, const void *right) {
  const pags_waymo_box *a = left, *b = right;
  const int order = strcmp(a->id, b->id);
  if (order || a->type != b->type)
    return order ? order : (a->type > b->type) - (a->type < b->type);
  return (a->order > b->order) - (a->order < b->order);
}

static int by_track(const void *left, const void *right) {
  const pags_waymo_box *a = left, *b = right;
  if (a->track != b->track)
    return a->track < b->track ? -1 : 1;
  return (a->order > b->order) - (a->order < b->order);
}

/* Sets the track number of each box, sorts the boxes by track and returns the number of tracks. Boxes of one id and two
 * types are two objects: trackers that count each class for itself write such ids. */
static int64_t group(pags_waymo_boxes *boxes) {
  int64_t tracks = 0;
  pags_sort(boxes->boxes, boxes->count, sizeof *boxes->boxes, by_id);
  for (int64_t i = 0; i < boxes->count; i++) {
    pags_waymo_box *box = &boxes->boxes[i];
    const pags_waymo_box *before = i ? box - 1 : NULL;
    const bool same_id = before && strcmp(before->id, box->id) == 0, same = same_id && before->type == box->type;
    if (same_id && !same)
      pags_tally_add(&boxes->renamed, "'%.40s', of a %s and a %s", box->id, class_name(before->type),
                     class_name(box->type));
    box->renamed = same ? before->renamed : same_id;
    box->track = same ? before->track : box->order;
    tracks += !same;
  }
  pags_sort(boxes->boxes, boxes->count, sizeof *boxes->boxes, by_track);
  return tracks;
}

static pags_result make_track(const pags_waymo_box *boxes, int64_t count, const char *where, pags_layout_track *track) {
  for (int64_t i = 1; i < count; i++)
    if (boxes[i].frame == boxes[i - 1].frame)
      return pags_fail_at(where, "frame %lld has two boxes of id '%s'", (long long)boxes[i].frame, boxes[i].id);
  pags_object *object = &track->object;
  object->id =
      boxes->renamed ? pags_text_format("%s-%s", boxes->id, class_name(boxes->type)) : pags_text_copy(boxes->id);
  object->class_name = pags_text_copy(class_name(boxes->type));
  object->category = pags_category_of(class_name(boxes->type));
  object->keyframes = calloc((size_t)count, sizeof *object->keyframes);
  track->sizes = calloc((size_t)count, 3 * sizeof *track->sizes);
  PAGS_CHECK_MEMORY(object->id && object->class_name && object->keyframes && track->sizes, "%s", where);
  object->keyframe_count = count;
  for (int64_t i = 0; i < count; i++) {
    pags_keyframe *keyframe = &object->keyframes[i];
    *keyframe = (pags_keyframe){.frame = (int32_t)boxes[i].frame, .trained = 1, .time = boxes[i].time};
    memcpy(keyframe->world_from_object, boxes[i].world_from_object, sizeof keyframe->world_from_object);
    pags_copy3(boxes[i].size, track->sizes + 3 * i);
    for (int k = 0; k < 3; k++)
      object->size[k] += boxes[i].size[k] / (double)count;
  }
  pags_object_classify_motion(object);
  return PAGS_OK;
}

pags_result pags_waymo_boxes_tracks(pags_waymo_boxes *boxes, const char *where, pags_layout_track **tracks,
                                    int64_t *count) {
  assert(boxes && where && tracks && count);
  *count = boxes->count ? group(boxes) : 0;
  *tracks = calloc((size_t)(*count ? *count : 1), sizeof **tracks);
  PAGS_CHECK_MEMORY(*tracks, "%s", where);
  int64_t begin = 0;
  for (int64_t t = 0; t < *count; t++) {
    int64_t end = begin + 1;
    while (end < boxes->count && boxes->boxes[end].track == boxes->boxes[begin].track)
      end++;
    PAGS_TRY(make_track(boxes->boxes + begin, end - begin, where, &(*tracks)[t]));
    begin = end;
  }
  return PAGS_OK;
}

void pags_waymo_boxes_destroy(pags_waymo_boxes *boxes) {
  for (int64_t i = 0; i < boxes->count; i++)
    free(boxes->boxes[i].id);
  free(boxes->boxes);
  *boxes = (pags_waymo_boxes){0};
}
