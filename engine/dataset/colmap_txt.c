/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the text files of a COLMAP model: lines that begin with '#' are comments, every other line is a record of
 * fields separated by blanks, or by commas and blanks as in files of kapture, which COLMAP takes, too. In images.txt
 * each image has a second line that lists its observations and may be empty; its content is not used. */
#include "dataset/colmap.h"

#include "base/memory.h"
#include "base/text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct lines {
  const pags_colmap_bytes *bytes;
  char *at;    /* the rest of the file */
  char *field; /* the rest of the line */
  int number;
} lines;

/* Begins behind the byte order mark, if there is one. */
static pags_result begin(const pags_colmap_bytes *bytes, lines *out) {
  const uint8_t *b = bytes->data;
  if (bytes->size >= 2 && ((b[0] == 0xff && b[1] == 0xfe) || (b[0] == 0xfe && b[1] == 0xff)))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: is UTF-16 text; expected UTF-8, as COLMAP writes it", bytes->path);
  const bool marked = bytes->size >= 3 && b[0] == 0xef && b[1] == 0xbb && b[2] == 0xbf;
  *out = (lines){.bytes = bytes, .at = (char *)bytes->data + (marked ? 3 : 0)};
  return PAGS_OK;
}

static bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

static char *skip_blanks(char *text) {
  while (is_blank(*text))
    text++;
  return text;
}

/* The end of a field: a blank, the end of the line, or a comma before one of these. */
static bool is_end(const char *at) {
  return !*at || is_blank(*at) || (*at == ',' && (!at[1] || is_blank(at[1])));
}

/* Goes behind the separator at the end of a field. */
static char *skip_separator(char *end) {
  return skip_blanks(*end == ',' ? end + 1 : end);
}

/* Goes to the next line and terminates it with a zero byte in place; returns false at the end of the file. A zero
 * byte inside the file counts as its end. */
static bool next_line(lines *l) {
  if (!*l->at)
    return false;
  char *stop = strchr(l->at, '\n');
  l->field = skip_blanks(l->at);
  l->at = stop ? stop + 1 : l->at + strlen(l->at);
  if (stop)
    *stop = '\0';
  l->number++;
  return true;
}

/* Goes to the next line that is neither empty nor a comment; returns false at the end of the file. */
static bool next_record(lines *l) {
  while (next_line(l))
    if (*l->field && *l->field != '#')
      return true;
  return false;
}

static pags_result expected(const lines *l, const char *what) {
  const size_t length = strcspn(l->field, " \t\r");
  if (length == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected %s, found the end of the line", l->bytes->path, l->number,
                     what);
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected %s, found '%.*s'", l->bytes->path, l->number, what,
                   (int)(length < 60 ? length : 60), l->field);
}

static pags_result take_number(lines *l, const char *what, double *out) {
  char *end = l->field;
  if (*l->field)
    *out = pags_text_to_double(l->field, &end);
  if (end == l->field || !is_end(end))
    return expected(l, what);
  l->field = skip_separator(end);
  return PAGS_OK;
}

static pags_result take_integer(lines *l, const char *what, int64_t low, int64_t high, int64_t *out) {
  double value = 0;
  char *const field = l->field;
  PAGS_TRY(take_number(l, what, &value));
  if (!(value >= (double)low && value <= (double)high) || value != (double)(int64_t)value) {
    l->field = field;
    return expected(l, what);
  }
  *out = (int64_t)value;
  return PAGS_OK;
}

/* Ids of cameras and images are unsigned 32-bit, ids of points 64-bit. Fields are read as doubles, which are exact up
 * to 2^53; no real model has ids that large. */
#define LARGEST_ID (INT64_C(1) << 53)

/* Reads what follows the number of a camera. */
static pags_result take_lens(lines *l, pags_colmap_camera *camera) {
  const char *name = l->field;
  char *end = l->field, text[64];
  while (!is_end(end))
    end++;
  l->field = skip_separator(end);
  snprintf(text, sizeof text, "%.*s", (int)(end - name < 63 ? end - name : 63), name);
  int kind;
  PAGS_AUTOFREE char *place = pags_text_format("%s:%d", l->bytes->path, l->number);
  PAGS_CHECK_MEMORY(place, "%s", l->bytes->path);
  PAGS_TRY(pags_colmap_find_kind(place, text, 0, &kind));
  int64_t width = 0, height = 0;
  double parameters[PAGS_COLMAP_PARAMETERS];
  PAGS_TRY(take_integer(l, "a width in pixels, 1..65535", 1, 65535, &width));
  PAGS_TRY(take_integer(l, "a height in pixels, 1..65535", 1, 65535, &height));
  for (int i = 0; i < pags_colmap_parameters(kind); i++)
    PAGS_TRY(take_number(l, "another parameter of the camera", &parameters[i]));
  camera->lens.width = (int)width;
  camera->lens.height = (int)height;
  pags_colmap_set_lens(kind, parameters, &camera->lens);
  return PAGS_OK;
}

pags_result pags_colmap_cameras_txt(pags_colmap *model, const pags_colmap_bytes *bytes) {
  lines l;
  PAGS_TRY(begin(bytes, &l));
  while (next_record(&l)) {
    pags_colmap_camera *camera = pags_colmap_add_camera(model);
    PAGS_CHECK_MEMORY(camera, "%s", l.bytes->path);
    PAGS_TRY(take_integer(&l, "a camera's number", 0, LARGEST_ID, &camera->id));
    PAGS_TRY(pags_colmap_keep_problem(model, take_lens(&l, camera)));
  }
  return pags_colmap_sort_cameras(model, bytes->path);
}

/* Whether three fields are those of an observation: x, y and the number of a point, or -1. */
static bool is_observation(lines l, char *fields) {
  int64_t point;
  double at;
  l.field = fields;
  return take_number(&l, "x", &at) == PAGS_OK && take_number(&l, "y", &at) == PAGS_OK &&
         take_integer(&l, "a point's number", -1, LARGEST_ID, &point) == PAGS_OK;
}

/* Goes to the line of observations of an image, which may be empty, and checks that it has triples of fields, of which
 * the first and the last are observations. Any other line is that of the next image, read in its place: the empty lines
 * are missing from the file. */
static pags_result pass_observations(lines *l) {
  char *last[3] = {NULL};
  int fields = 0;
  do
    if (!next_line(l))
      return PAGS_OK;
  while (*l->field == '#');
  for (char *at = l->field; *at; fields++) {
    last[fields % 3] = at;
    while (!is_end(at))
      at++;
    at = skip_separator(at);
  }
  if (fields == 0 || (fields % 3 == 0 && is_observation(*l, l->field) && is_observation(*l, last[0])))
    return PAGS_OK;
  return expected(l,
                  "a line of observations (x y point) after each image, or an empty one; are the empty lines missing "
                  "from this file?");
}

pags_result pags_colmap_images_txt(pags_colmap *model, const pags_colmap_bytes *bytes) {
  lines l;
  PAGS_TRY(begin(bytes, &l));
  while (next_record(&l)) {
    pags_colmap_image image;
    PAGS_TRY(take_integer(&l, "an image's number", 0, LARGEST_ID, &image.id));
    for (int i = 0; i < 7; i++)
      PAGS_TRY(take_number(&l, "a number of the image's pose", &image.pose[i]));
    PAGS_TRY(take_integer(&l, "the number of the image's camera", 0, LARGEST_ID, &image.camera));
    char *end = l.field + strlen(l.field);
    while (end > l.field && is_blank(end[-1]))
      *--end = '\0';
    image.name = l.field; /* a file name may contain blanks */
    PAGS_AUTOFREE char *where = pags_text_format("%s:%d", l.bytes->path, l.number);
    PAGS_CHECK_MEMORY(where, "%s", l.bytes->path);
    PAGS_TRY(pags_colmap_add_image(model, where, &image));
    PAGS_TRY(pass_observations(&l));
  }
  return PAGS_OK;
}

pags_result pags_colmap_points_txt(pags_colmap *model, const pags_colmap_bytes *bytes) {
  lines l;
  PAGS_TRY(begin(bytes, &l));
  while (next_record(&l)) {
    int64_t id = 0, colour = 0, view = 0, observation;
    double xyz[3], error;
    uint8_t rgb[3];
    PAGS_TRY(take_integer(&l, "a point's number", 0, LARGEST_ID, &id));
    for (int i = 0; i < 3; i++)
      PAGS_TRY(take_number(&l, "a coordinate", &xyz[i]));
    for (int i = 0; i < 3; i++) {
      PAGS_TRY(take_integer(&l, "a colour, 0..255", 0, 255, &colour));
      rgb[i] = (uint8_t)colour;
    }
    PAGS_TRY(take_number(&l, "the point's error", &error));
    PAGS_TRY(pags_parsed_add_point(&model->parsed->points, id, xyz, rgb, l.bytes->path));
    while (*l.field) {
      PAGS_TRY(take_integer(&l, "the number of an image", 0, LARGEST_ID, &view));
      PAGS_TRY(take_integer(&l, "the number of an observation", 0, LARGEST_ID, &observation));
      PAGS_TRY(pags_parsed_observe(&model->parsed->points, view, l.bytes->path));
    }
  }
  return PAGS_OK;
}
