/* SPDX-License-Identifier: Apache-2.0 */
/* Reads tracklet_labels.xml of KITTI's raw recordings, a Boost serialization archive of a vector of tracklets, with
 * the XML parser expat. These elements are used, all others are ignored:
 *
 *   tracklets / item / {objectType, h, w, l, first_frame} and poses / item / {tx, ty, tz, rx, ry, rz}
 *
 * Memory use is bounded by the size of the file: entities are rejected and the depth of nesting is limited. */
#include <expat.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include <pags/camera.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "import/kitti_files.h"

enum { MAX_DEPTH = 16, TEXT = 64 };

/* Depths of the elements that are used: boost_serialization 1, tracklets 2, item 3, its members 4, a pose 5, its
 * members 6. */
enum { TRACKLETS = 2, TRACKLET, MEMBER, POSE, NUMBER };

typedef struct reader {
  const char *path;
  XML_Parser parser;
  pags_kitti_tracklets *out;
  int64_t capacity, pose_capacity;
  int depth;
  char names[MAX_DEPTH + 1][32];
  char text[TEXT];
  size_t length;      /* length of `text`; TEXT: the text is too long */
  unsigned seen;      /* bit i: members[i] of the tracklet has been read */
  unsigned seen_pose; /* bit i: numbers[i] of the pose has been read */
  pags_result result;
} reader;

static const char *const members[] = {"objectType", "h", "w", "l", "first_frame", "poses"};
static const char *const numbers[] = {"tx", "ty", "tz", "rx", "ry", "rz"};
enum { MEMBERS = 6, ALL_MEMBERS = (1 << MEMBERS) - 1 }; /* of a tracklet, and numbers of a pose */

static void fail(reader *r, pags_result code, const char *format, ...) PAGS_PRINTF(3, 4);
static void fail(reader *r, pags_result code, const char *format, ...) {
  char text[256];
  va_list arguments;
  if (r->result != PAGS_OK)
    return;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  r->result = pags_fail(code, "%s:%lu: %s", r->path, (unsigned long)XML_GetCurrentLineNumber(r->parser), text);
  XML_StopParser(r->parser, XML_FALSE);
}

/* ---- Elements ---- */

static bool is_at(const reader *r, int depth, const char *name) {
  return r->depth >= depth && !strcmp(r->names[depth], name);
}

static bool in_tracklet(const reader *r) {
  return is_at(r, 1, "boost_serialization") && is_at(r, TRACKLETS, "tracklets") && is_at(r, TRACKLET, "item");
}

static bool in_pose(const reader *r) {
  return in_tracklet(r) && is_at(r, MEMBER, "poses") && is_at(r, POSE, "item");
}

static void XMLCALL on_begin(void *user, const XML_Char *name, PAGS_UNUSED const XML_Char **attributes) {
  reader *r = user;
  if (r->result != PAGS_OK)
    return;
  if (r->depth == MAX_DEPTH) {
    fail(r, PAGS_ERROR_FORMAT, "expected no more than %d elements inside of each other", MAX_DEPTH);
    return;
  }
  /* A name that is too long is replaced by "?", so that its beginning never matches an element that is used. */
  snprintf(r->names[++r->depth], sizeof r->names[0], "%s", strlen(name) < sizeof r->names[0] ? name : "?");
  r->length = 0;
  pags_kitti_tracklets *out = r->out;
  if (r->depth == TRACKLET && in_tracklet(r)) {
    if (!pags_grow(&out->items, out->count + 1, &r->capacity, sizeof *out->items)) {
      fail(r, PAGS_ERROR_MEMORY, "no memory for its tracklets");
      return;
    }
    out->items[out->count++] = (pags_kitti_tracklet){0};
    r->pose_capacity = 0;
    r->seen = 0;
  } else if (r->depth == POSE && in_pose(r)) {
    pags_kitti_tracklet *tracklet = &out->items[out->count - 1];
    if (!pags_grow(&tracklet->poses, tracklet->count + 1, &r->pose_capacity, sizeof *tracklet->poses)) {
      fail(r, PAGS_ERROR_MEMORY, "no memory for its poses");
      return;
    }
    tracklet->count++;
    r->seen_pose = 0;
  }
}

static void XMLCALL on_text(void *user, const XML_Char *text, int length) {
  reader *r = user;
  if ((size_t)length >= TEXT - r->length) {
    r->length = TEXT;
    return;
  }
  memcpy(r->text + r->length, text, (size_t)length);
  r->length += (size_t)length;
}

/* ---- Texts and numbers ---- */

/* Returns the text of the current element without surrounding blanks; fails and returns NULL if it is longer than any
 * valid text. */
static const char *element_text(reader *r) {
  if (r->length >= TEXT) {
    fail(r, PAGS_ERROR_FORMAT, "expected a short text in <%s>", r->names[r->depth]);
    return NULL;
  }
  size_t begin = 0;
  while (r->length && strchr(" \t\r\n", r->text[r->length - 1]))
    r->length--;
  r->text[r->length] = 0;
  begin = strspn(r->text, " \t\r\n");
  return r->text + begin;
}

static double element_number(reader *r) {
  double value = 0;
  const char *text = element_text(r);
  if (text && !pags_word_number(text, &value))
    fail(r, PAGS_ERROR_FORMAT, "expected a number in <%s>, found '%s'", r->names[r->depth], text);
  return r->result == PAGS_OK ? value : 0;
}

/* A size of 0 or less is left to the caller, who can name the tracklet. */
static double element_size(reader *r) {
  const double value = element_number(r);
  if (r->result == PAGS_OK && value > 100)
    fail(r, PAGS_ERROR_FORMAT, "expected a size below 100 m in <%s> of tracklet %lld, found %g", r->names[r->depth],
         (long long)r->out->count - 1, value);
  return value;
}

static void end_member(reader *r) {
  pags_kitti_tracklet *tracklet = &r->out->items[r->out->count - 1];
  const int which = pags_text_find(r->names[MEMBER], members, MEMBERS);
  if (which < 0)
    return;
  if (r->seen & 1U << which)
    fail(r, PAGS_ERROR_FORMAT, "<%s> stands twice in a tracklet", members[which]);
  r->seen |= 1U << which;
  const char *text = which == 0 || which == 4 ? element_text(r) : NULL;
  switch (which) {
    case 0:
      if (text && (!*text || strlen(text) >= sizeof tracklet->type))
        fail(r, PAGS_ERROR_FORMAT, "expected a class name shorter than 32 letters in <objectType>, found '%s'", text);
      else if (text)
        memcpy(tracklet->type, text, strlen(text) + 1);
      break;
    case 1: tracklet->height = element_size(r); break;
    case 2: tracklet->width = element_size(r); break;
    case 3: tracklet->length = element_size(r); break;
    case 4:
      if (text && !pags_word_integer(text, 0, 1000000, &tracklet->first_frame))
        fail(r, PAGS_ERROR_FORMAT, "expected the number of a frame in <first_frame>, found '%s'", text);
      break;
    default: break;
  }
}

static void end_number(reader *r) {
  pags_kitti_tracklet *tracklet = &r->out->items[r->out->count - 1];
  const int which = pags_text_find(r->names[NUMBER], numbers, MEMBERS);
  if (which < 0)
    return;
  const double value = element_number(r);
  if (r->result == PAGS_OK && fabs(value) > (which < 3 ? 1000 : 12.6))
    fail(r, PAGS_ERROR_FORMAT, "expected %s in <%s> of tracklet %lld, a %s, found %g",
         which < 3 ? "metres in the axes of the Velodyne, below 1000," : "an angle in radians (-pi to pi)",
         numbers[which], (long long)r->out->count - 1, tracklet->type, value);
  tracklet->poses[tracklet->count - 1][which] = value;
  r->seen_pose |= 1U << which;
}

static void XMLCALL on_end(void *user, PAGS_UNUSED const XML_Char *name) {
  reader *r = user;
  if (r->result != PAGS_OK)
    return;
  if (r->depth == NUMBER && in_pose(r))
    end_number(r);
  else if (r->depth == POSE && in_pose(r)) {
    if (r->seen_pose != ALL_MEMBERS)
      fail(r, PAGS_ERROR_FORMAT, "expected tx ty tz rx ry rz in a pose");
  } else if (r->depth == MEMBER && in_tracklet(r))
    end_member(r);
  else if (r->depth == TRACKLET && in_tracklet(r) && r->seen != ALL_MEMBERS)
    fail(r, PAGS_ERROR_FORMAT, "expected objectType h w l first_frame poses in a tracklet");
  r->depth--;
  r->length = 0;
}

/* ---- Parsing the file ---- */

/* Rejects entities: their expansion can grow without bound, and no tracklet file has any. */
static void XMLCALL on_entity(void *user, const XML_Char *name, int is_parameter, const XML_Char *value, int length,
                              const XML_Char *base, const XML_Char *system, const XML_Char *public_id,
                              const XML_Char *notation) {
  (void)is_parameter, (void)value, (void)length, (void)base, (void)system, (void)public_id, (void)notation;
  fail(user, PAGS_ERROR_FORMAT, "expected no entities, found '%.40s'", name);
}

void pags_kitti_tracklets_destroy(pags_kitti_tracklets *tracklets) {
  for (int64_t i = 0; i < tracklets->count; i++)
    free(tracklets->items[i].poses);
  free(tracklets->items);
  *tracklets = (pags_kitti_tracklets){0};
}

static void free_parser(XML_Parser *parser) {
  XML_ParserFree(*parser);
}

pags_result pags_kitti_tracklets_read(const char *path, pags_kitti_tracklets *out) {
  PAGS_AUTO(pags_kitti_tracklets_destroy) pags_kitti_tracklets tracklets = {0};
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t left = 0;
  *out = (pags_kitti_tracklets){0};
  PAGS_TRY(pags_file_read(path, &bytes, &left));
  PAGS_AUTO(free_parser) XML_Parser parser = XML_ParserCreate(NULL);
  PAGS_CHECK_MEMORY(parser, "%s", path);
  reader r = {.path = path, .parser = parser, .out = &tracklets};
  XML_SetUserData(parser, &r);
  XML_SetElementHandler(parser, on_begin, on_end);
  XML_SetCharacterDataHandler(parser, on_text);
  XML_SetEntityDeclHandler(parser, on_entity);
  const char *at = (const char *)bytes;
  for (bool last = false; !last;) {
    const size_t step = left < 1 << 20 ? left : 1 << 20;
    last = step == left;
    if (XML_Parse(parser, at, (int)step, last) != XML_STATUS_OK)
      return r.result != PAGS_OK
                 ? r.result
                 : pags_fail(PAGS_ERROR_FORMAT, "%s:%lu: %s", path, (unsigned long)XML_GetCurrentLineNumber(parser),
                             XML_ErrorString(XML_GetErrorCode(parser)));
    at += step;
    left -= step;
  }
  PAGS_TRY(r.result);
  *out = tracklets;
  tracklets = (pags_kitti_tracklets){0};
  return PAGS_OK;
}

/* R = Rz Ry Rx. The pose in the file is that of the centre of the bottom face; half the height along z is added. */
void pags_kitti_tracklet_pose(const pags_kitti_tracklet *tracklet, int64_t index, double out[12]) {
  const double *p = tracklet->poses[index];
  pags_rigid_from_angles(p + 3, p, out);
  for (int i = 0; i < 3; i++)
    out[4 * i + 3] += out[4 * i + 2] * tracklet->height / 2;
}
