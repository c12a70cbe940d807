/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a transforms.json file of nerfstudio or instant-ngp.
 *
 * The keys of a camera may stand at the top level, where they apply to all frames, or in a frame; the value of the
 * frame takes precedence. transform_matrix is camera-to-world with OpenGL camera axes (x right, y up, z backward);
 * negating its y and z columns gives OpenCV's axes. The world axes are left as they are; nerfstudio's tools rotate
 * the world so that +z is up. */
#include "dataset/parsed.h"

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "maths/maths.h"

#include <pags/image.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct reader {
  pags_json *json;
  const pags_json_value *root;
  char *folder; /* folder of the file; file_path is relative to it */
  pags_parsed_dataset *parsed;
} reader;

/* ---- Camera parameters of a frame ---- */

/* Reads the number `key` of a frame or, if the frame doesn't have it, of the top level. *given says whether either of
 * them has it; *out is unchanged if neither has. */
static pags_result find_number(const reader *r, const pags_json_value *frame, const char *key, double *out,
                               bool *given) {
  const pags_json_value *own = pags_json_member(frame, key);
  const pags_json_value *from = own && own->type != PAGS_JSON_NULL ? frame : r->root;
  const pags_json_value *value = pags_json_member(from, key);
  *given = value && value->type != PAGS_JSON_NULL;
  return *given ? pags_json_number(r->json, from, key, out) : PAGS_OK;
}

static pags_result find_number_or(const reader *r, const pags_json_value *frame, const char *key, double fallback,
                                  double *out) {
  bool given;
  *out = fallback;
  return find_number(r, frame, key, out, &given);
}

/* Reads a width or a height: a whole number of pixels, though often written as 540.0. The result is 0 if it is not
 * given. */
static pags_result find_side(const reader *r, const pags_json_value *frame, const char *key, int *out) {
  double value;
  PAGS_TRY(find_number_or(r, frame, key, 0, &value));
  if (value != floor(value) || value < 0 || value > 65535)
    return pags_json_fail(r->json, frame, "expected '%s' to be a whole number of pixels in 1..65535, found %g", key,
                          value);
  *out = (int)value;
  return PAGS_OK;
}

static pags_result find_kind(const reader *r, const pags_json_value *frame, pags_lens_kind *kind) {
  static const char *const perspective[] = {"OPENCV",        "PINHOLE", "SIMPLE_PINHOLE",
                                            "SIMPLE_RADIAL", "RADIAL",  "PERSPECTIVE"};
  const char *model;
  PAGS_TRY(pags_json_string_or(r->json, r->root, "camera_model", "OPENCV", &model));
  PAGS_TRY(pags_json_string_or(r->json, frame, "camera_model", model, &model));
  bool fisheye; /* the key by which instant-ngp marks a fisheye lens */
  PAGS_TRY(pags_json_bool_or(r->json, r->root, "is_fisheye", false, &fisheye));
  PAGS_TRY(pags_json_bool_or(r->json, frame, "is_fisheye", fisheye, &fisheye));
  *kind = fisheye || strcmp(model, "OPENCV_FISHEYE") == 0 ? PAGS_LENS_FISHEYE : PAGS_LENS_PERSPECTIVE;
  if (*kind == PAGS_LENS_FISHEYE)
    return PAGS_OK;
  for (size_t i = 0; i < sizeof perspective / sizeof *perspective; i++)
    if (strcmp(model, perspective[i]) == 0)
      return PAGS_OK;
  return pags_json_fail(r->json, frame,
                        "camera_model '%s' is not known; expected PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, "
                        "RADIAL, OPENCV or OPENCV_FISHEYE",
                        model);
}

static pags_result find_lens(const reader *r, const pags_json_value *frame, pags_parsed_view *view) {
  static const char *const radial[] = {"k1", "k2", "k3", "k4"}, *const tangential[] = {"p1", "p2"};
  pags_lens *lens = &view->lens;
  PAGS_TRY(find_kind(r, frame, &lens->kind));
  PAGS_TRY(find_side(r, frame, "w", &lens->width));
  PAGS_TRY(find_side(r, frame, "h", &lens->height));
  if (lens->width == 0 || lens->height == 0) {
    if (view->missing)
      return PAGS_OK;
    PAGS_TRY(pags_image_size(view->image_path, &lens->width, &lens->height));
    view->sized = true;
  }

  /* Focal lengths are given in pixels (fl_x, fl_y) or as full angles of view in radians (camera_angle_x,
   * camera_angle_y). A missing fl_y is derived from camera_angle_y, else it equals fl_x. */
  bool given_x, given_y, angle_x, angle_y;
  double ax = 0, ay = 0;
  PAGS_TRY(find_number(r, frame, "fl_x", &lens->fx, &given_x));
  PAGS_TRY(find_number(r, frame, "fl_y", &lens->fy, &given_y));
  PAGS_TRY(find_number(r, frame, "camera_angle_x", &ax, &angle_x));
  PAGS_TRY(find_number(r, frame, "camera_angle_y", &ay, &angle_y));
  if (!given_x && angle_x) {
    lens->fx = 0.5 * lens->width / pags_tan(0.5 * ax);
    given_x = true;
  }
  if (!given_y && angle_y) {
    lens->fy = 0.5 * lens->height / pags_tan(0.5 * ay);
    given_y = true;
  }
  if (!given_x && !given_y)
    return pags_json_fail(r->json, frame, "expected 'fl_x' or 'camera_angle_x' in the frame or at the top");
  if (!given_y)
    lens->fy = lens->fx;
  if (!given_x)
    lens->fx = lens->fy;

  PAGS_TRY(find_number_or(r, frame, "cx", 0.5 * lens->width, &lens->cx));
  PAGS_TRY(find_number_or(r, frame, "cy", 0.5 * lens->height, &lens->cy));
  for (int i = 0; i < 4; i++)
    PAGS_TRY(find_number_or(r, frame, radial[i], 0, &lens->k[i]));
  for (int i = 0; i < 2; i++)
    PAGS_TRY(find_number_or(r, frame, tangential[i], 0, &lens->p[i]));
  return PAGS_OK;
}

/* ---- Files of a frame ---- */

/* Finds the image file of a frame. Files of instant-ngp and of the synthetic NeRF scenes leave out the extension of
 * file_path, so that the usual extensions are tried. */
static pags_result find_image(const reader *r, const pags_json_value *frame, pags_parsed_view *view) {
  static const char *const extensions[] = {".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG", ".exr"};
  const char *file;
  PAGS_TRY(pags_json_string(r->json, frame, "file_path", &file));
  if (*pags_path_name(file) == '\0')
    return pags_json_fail(r->json, frame, "expected 'file_path' to name a file, found '%s'", file);
  view->image_path = pags_path_join(r->folder, strncmp(file, "./", 2) == 0 ? file + 2 : file);
  if (!view->image_path)
    return pags_out_of_memory("%s", view->where);
  view->missing = !pags_path_exists(view->image_path);
  for (size_t i = 0; i < sizeof extensions / sizeof *extensions && view->missing; i++) {
    char *longer = pags_text_format("%s%s", view->image_path, extensions[i]);
    if (!longer)
      return pags_out_of_memory("%s", view->where);
    if (pags_file_exists(longer)) {
      free(view->image_path);
      view->image_path = longer;
      view->missing = false;
    } else {
      free(longer);
    }
  }
  return PAGS_OK;
}

static pags_result find_mask(const reader *r, const pags_json_value *frame, pags_parsed_view *view) {
  const char *file;
  PAGS_TRY(pags_json_string_or(r->json, frame, "mask_path", NULL, &file));
  if (!file || view->missing)
    return PAGS_OK;
  view->mask_path = pags_path_join(r->folder, file);
  if (!view->mask_path)
    return pags_out_of_memory("%s", view->where);
  if (!pags_file_exists(view->mask_path))
    return pags_json_fail(r->json, frame, "mask_path names %s, which does not exist", view->mask_path);
  return PAGS_OK;
}

static pags_result read_points(const reader *r) {
  const char *file;
  PAGS_TRY(pags_json_string_or(r->json, r->root, "ply_file_path", NULL, &file));
  if (!file || !*file)
    return PAGS_OK;
  char *path = pags_path_join(r->folder, file);
  if (!path)
    return pags_out_of_memory("%s", pags_json_path(r->json));
  pags_result result = pags_ply_points_read(path, &r->parsed->points);
  free(path);
  return result;
}

/* ---- Reading the whole file ---- */

static pags_result read_all(reader *r, const char *path) {
  r->folder = pags_path_folder(path);
  r->parsed->source = pags_text_copy(path);
  if (!r->folder || !r->parsed->source)
    return pags_out_of_memory("%s", path);
  r->parsed->kind = "transforms.json";
  r->parsed->up = PAGS_UP_Z;
  PAGS_TRY(pags_json_parse_file(path, &r->json));
  r->root = pags_json_root(r->json);
  PAGS_TRY(pags_json_as_object(r->json, r->root, "a transforms file"));
  const pags_json_value *frames;
  PAGS_TRY(pags_json_array(r->json, r->root, "frames", &frames));
  for (const pags_json_value *frame = frames->first; frame; frame = frame->next) {
    PAGS_TRY(pags_json_as_object(r->json, frame, "a frame"));
    pags_parsed_view *view = pags_parsed_add(r->parsed);
    if (!view)
      return pags_out_of_memory("%s", pags_json_path(r->json));
    view->where = pags_text_format("%s:%d", pags_json_path(r->json), frame->line);
    if (!view->where)
      return pags_out_of_memory("%s", pags_json_path(r->json));
    PAGS_TRY(find_image(r, frame, view));
    PAGS_TRY(find_mask(r, frame, view));

    /* The pose has 3 or 4 rows. Negating the y and z columns turns OpenGL camera axes into OpenCV axes. */
    const pags_json_value *rows;
    PAGS_TRY(pags_json_array(r->json, frame, "transform_matrix", &rows));
    double all[16];
    if (rows->count == 3)
      PAGS_TRY(pags_json_numbers(r->json, frame, "transform_matrix", 12, all));
    else
      PAGS_TRY(pags_json_numbers(r->json, frame, "transform_matrix", 16, all));
    for (int i = 0; i < 12; i++)
      view->world_from_camera[i] = i % 4 == 1 || i % 4 == 2 ? -all[i] : all[i];

    PAGS_TRY(find_lens(r, frame, view));
  }
  return read_points(r);
}

pags_result pags_transforms_read(const char *path, pags_parsed_dataset *parsed) {
  memset(parsed, 0, sizeof *parsed);
  reader r = {.parsed = parsed};
  pags_result result = read_all(&r, path);
  pags_json_destroy(r.json);
  free(r.folder);
  if (result != PAGS_OK)
    pags_parsed_destroy(parsed);
  return result;
}
