/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a transforms.json file of nerfstudio or instant-ngp.
 *
 * The keys of a camera may stand at the top level, where they apply to all frames, or in a frame; the value of the
 * frame takes precedence. transform_matrix is camera-to-world with OpenGL camera axes (x right, y up, z backward);
 * negating its y and z columns gives OpenCV's axes. The world axes are left as they are; nerfstudio's tools rotate
 * the world so that +z is up. */
#include "dataset/colmap.h"
#include "dataset/find_file.h"
#include "dataset/splits.h"
#include "dataset/unsupported_formats.h"

#include "base/file.h"
#include "base/json.h"
#include "base/log.h"
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
  pags_file_finder files;
  pags_split_lists lists;
  int64_t scaled;           /* frames whose matrix has a scale, which is left out */
  double scale_range[2];    /* the least and the greatest of these scales */
  const char *first_scaled; /* file_path of the first */
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

/* The same for numbers of several keys, 0 where they are missing. */
static pags_result find_numbers(const reader *r, const pags_json_value *frame, const char *const *keys, int count,
                                double *out) {
  for (int i = 0; i < count; i++)
    PAGS_TRY(find_number_or(r, frame, keys[i], 0, &out[i]));
  return PAGS_OK;
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

/* Names of camera models, those of nerfstudio and of COLMAP. */
static const struct {
  pags_lens_kind kind;
  const char *names;
} models[] = {{PAGS_LENS_PERSPECTIVE, "OPENCV PINHOLE SIMPLE_PINHOLE SIMPLE_RADIAL RADIAL PERSPECTIVE"},
              {PAGS_LENS_FISHEYE, "OPENCV_FISHEYE SIMPLE_RADIAL_FISHEYE RADIAL_FISHEYE SIMPLE_FISHEYE FISHEYE"},
              {PAGS_LENS_RATIONAL, "FULL_OPENCV"},
              {PAGS_LENS_FOV, "FOV"},
              {PAGS_LENS_THIN_PRISM, "THIN_PRISM_FISHEYE"},
              {PAGS_LENS_EQUIRECTANGULAR, "EQUIRECTANGULAR LATLONG"}};

static pags_result find_kind(const reader *r, const pags_json_value *frame, pags_lens_kind *kind) {
  const char *model;
  PAGS_TRY(pags_json_string_or(r->json, r->root, "camera_model", "OPENCV", &model));
  PAGS_TRY(pags_json_string_or(r->json, frame, "camera_model", model, &model));
  /* The keys by which instant-ngp marks lenses: its latlong is longitude and latitude, its equirectangular a cylinder
   * of equal areas. */
  static const char *const others[] = {"equirectangular", "latlong", "orthographic", "ftheta"};
  static const char *const theirs[] = {"equal-area cylinder", "EQUIRECTANGULAR", "orthographic", "ftheta"};
  bool fisheye, other;
  for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
    PAGS_TRY(pags_json_bool_or(r->json, r->root, others[i], false, &other));
    PAGS_TRY(pags_json_bool_or(r->json, frame, others[i], other, &other));
    if (other)
      model = theirs[i];
  }
  if (pags_json_member(r->root, "ftheta_p0") || pags_json_member(frame, "ftheta_p0"))
    model = "ftheta";
  PAGS_TRY(pags_json_bool_or(r->json, r->root, "is_fisheye", false, &fisheye));
  PAGS_TRY(pags_json_bool_or(r->json, frame, "is_fisheye", fisheye, &fisheye));
  for (size_t i = 0; i < sizeof models / sizeof *models; i++)
    if (pags_words_have(models[i].names, model)) {
      *kind = fisheye ? PAGS_LENS_FISHEYE : models[i].kind;
      return PAGS_OK;
    }
  return pags_json_fail(r->json, frame,
                        "camera_model '%s' is not known; expected PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, "
                        "OPENCV, FULL_OPENCV, FOV, OPENCV_FISHEYE, THIN_PRISM_FISHEYE or EQUIRECTANGULAR",
                        model);
}

/* Reads one focal length in pixels, for a side of `size` pixels: keys[0] is the focal length itself, keys[1] a full
 * angle of view in radians, keys[2] one in degrees (instant-ngp's). */
static pags_result find_focal(const reader *r, const pags_json_value *frame, const char *const keys[3], int size,
                              double *out, bool *given) {
  const double pi = 3.14159265358979323846;
  double angle = 0;
  PAGS_TRY(find_number(r, frame, keys[0], out, given));
  if (*given)
    return PAGS_OK;
  PAGS_TRY(find_number(r, frame, keys[1], &angle, given));
  if (*given && !(angle > 0 && angle < pi))
    return pags_json_fail(r->json, frame, "'%s' is %g, expected radians above 0 and below pi%s", keys[1], angle,
                          angle >= pi && angle < 180 ? " (is it in degrees? then multiply it by pi / 180)" : "");
  if (!*given) {
    PAGS_TRY(find_number(r, frame, keys[2], &angle, given));
    if (*given && !(angle > 0 && angle < 180))
      return pags_json_fail(r->json, frame, "'%s' is %g, expected degrees above 0 and below 180", keys[2], angle);
    angle *= pi / 180;
  }
  if (*given)
    *out = 0.5 * size / pags_tan(0.5 * angle);
  return PAGS_OK;
}

static pags_result find_lens(const reader *r, const pags_json_value *frame, pags_parsed_view *view) {
  static const char *const radial[] = {"k1", "k2", "k3", "k4"}, *const tangential[] = {"p1", "p2"};
  static const char *const below[] = {"k4", "k5", "k6"}, *const prism[] = {"sx1", "sy1"};
  static const char *const x_keys[] = {"fl_x", "camera_angle_x", "x_fov"};
  static const char *const y_keys[] = {"fl_y", "camera_angle_y", "y_fov"};
  pags_lens *lens = &view->lens;
  PAGS_TRY(find_kind(r, frame, &lens->model.kind));
  PAGS_TRY(find_side(r, frame, "w", &lens->width));
  PAGS_TRY(find_side(r, frame, "h", &lens->height));
  if (lens->width == 0 || lens->height == 0) {
    if (view->missing)
      return PAGS_OK;
    PAGS_TRY(pags_image_inspect(view->image_path, &view->picture));
    lens->width = view->picture.width;
    lens->height = view->picture.height;
    view->sized = true;
  }

  if (lens->model.kind == PAGS_LENS_EQUIRECTANGULAR) {
    pags_lens_set_panorama(lens->width, lens->height, lens);
    return PAGS_OK;
  }

  /* A missing focal length equals the other. */
  bool given_x, given_y;
  PAGS_TRY(find_focal(r, frame, x_keys, lens->width, &lens->fx, &given_x));
  PAGS_TRY(find_focal(r, frame, y_keys, lens->height, &lens->fy, &given_y));
  if (!given_x && !given_y)
    return pags_json_fail(r->json, frame, "expected 'fl_x' or 'camera_angle_x' in the frame or at the top");
  if (!given_y)
    lens->fy = lens->fx;
  if (!given_x)
    lens->fx = lens->fy;

  PAGS_TRY(find_number_or(r, frame, "cx", 0.5 * lens->width, &lens->cx));
  PAGS_TRY(find_number_or(r, frame, "cy", 0.5 * lens->height, &lens->cy));
  if (lens->model.kind == PAGS_LENS_FOV) /* COLMAP's omega, under the name of its first distortion parameter */
    return find_number_or(r, frame,
                          pags_json_member(r->root, "omega") || pags_json_member(frame, "omega") ? "omega" : "k1", 0,
                          &lens->model.k[0]);
  const bool rational = lens->model.kind == PAGS_LENS_RATIONAL, thin_prism = lens->model.kind == PAGS_LENS_THIN_PRISM;
  PAGS_TRY(find_numbers(r, frame, radial, rational ? 3 : 4, lens->model.k));
  PAGS_TRY(find_numbers(r, frame, below, rational ? 3 : 0, lens->model.d));
  PAGS_TRY(find_numbers(r, frame, tangential, 2, lens->model.p));
  return find_numbers(r, frame, prism, thin_prism ? 2 : 0, lens->model.s);
}

/* ---- Files of a frame ---- */

static pags_result read_points(reader *r) {
  const char *file;
  PAGS_TRY(pags_json_string_or(r->json, r->root, "ply_file_path", NULL, &file));
  if (!file || !*file)
    return PAGS_OK;
  PAGS_AUTOFREE char *path = NULL;
  bool exists; /* if not, the reader says so */
  PAGS_TRY(pags_find_file(&r->files, r->folder, file, &path, &exists));
  PAGS_TRY(pags_ply_points_read(path, &r->parsed->points));
  return pags_parsed_check_points(&r->parsed->points, path);
}

/* ---- What is not used ---- */

/* Reports which keys with a meaning of their own are ignored: how many frames have them, or the top. */
static void report_unused(const reader *r, const pags_json_value *frames) {
  static const struct {
    const char *key, *what;
  } unused[] = {{"depth_file_path", "depth pictures aren't used"},
                {"depth_path", "depth pictures aren't used"},
                {"normal_path", "pictures of normals aren't used"},
                {"rolling_shutter", "the time at which a row is exposed isn't used"},
                {"transform_matrix_start", "motion during the exposure isn't used"},
                {"fisheye_crop_radius", "the radius isn't used; a mask leaves out what is beyond"},
                {"time", "captures are taken to stand still"}};
  for (size_t i = 0; i < sizeof unused / sizeof *unused; i++) {
    int64_t count = pags_json_member(r->root, unused[i].key) != NULL;
    const char *first = count ? "the top of the file" : NULL;
    for (const pags_json_value *frame = frames->first; frame; frame = frame->next) {
      const pags_json_value *has = pags_json_member(frame, unused[i].key);
      if (!has || has->type == PAGS_JSON_NULL)
        continue;
      const pags_json_value *file = pags_json_member(frame, "file_path");
      first = first ? first : file && file->type == PAGS_JSON_STRING ? file->text : "a frame";
      count++;
    }
    if (count)
      PAGS_WARN("%s: '%s' of %lld frames is ignored: %s; the first is %s", pags_json_path(r->json), unused[i].key,
                (long long)count, unused[i].what, first);
  }
}

/* ---- Reading the whole file ---- */

/* The pose has 3 or 4 rows. Negating the y and z columns turns OpenGL camera axes into OpenCV axes. The scale of a
 * camera object, as Blender and pyrender have it, says nothing of the view and is left out. */
static pags_result read_pose(reader *r, const pags_json_value *frame, const char *file, pags_parsed_view *view) {
  const pags_json_value *rows;
  double all[16] = {[15] = 1};
  PAGS_TRY(pags_json_array(r->json, frame, "transform_matrix", &rows));
  PAGS_TRY(pags_json_numbers(r->json, frame, "transform_matrix", rows->count == 3 ? 12 : 16, all));
  if (fabs(all[12]) + fabs(all[13]) + fabs(all[14]) + fabs(all[15] - 1) > 1e-6)
    return pags_json_fail(r->json, rows,
                          "the last row of 'transform_matrix' is %g %g %g %g, expected 0 0 0 1: the matrix is written "
                          "row by row, with the camera's position in its last column",
                          all[12], all[13], all[14], all[15]);
  for (int i = 0; i < 12; i++)
    view->world_from_camera[i] = i % 4 == 1 || i % 4 == 2 ? -all[i] : all[i];
  const double scale = pags_rigid_unscale(view->world_from_camera);
  if (scale == 1)
    return PAGS_OK;
  r->scale_range[0] = r->scaled ? fmin(r->scale_range[0], scale) : scale;
  r->scale_range[1] = fmax(r->scale_range[1], scale);
  r->first_scaled = r->first_scaled ? r->first_scaled : file;
  r->scaled++;
  return PAGS_OK;
}

static pags_result read_frame(reader *r, const pags_json_value *frame, pags_split split) {
  const char *file, *mask;
  PAGS_TRY(pags_json_as_object(r->json, frame, "a frame"));
  PAGS_TRY(pags_json_string(r->json, frame, "file_path", &file));
  if (*pags_path_name(file) == '\0')
    return pags_json_fail(r->json, frame, "expected 'file_path' to name a file, found '%s'", file);
  if (split == PAGS_SPLIT_NONE)
    split = pags_split_of(&r->lists, file);
  if (split == PAGS_SPLIT_LEFT_OUT)
    return PAGS_OK;
  pags_parsed_view *view = pags_parsed_add(r->parsed);
  PAGS_CHECK_MEMORY(view, "%s", pags_json_path(r->json));
  view->where = pags_text_format("%s:%d", pags_json_path(r->json), frame->line);
  PAGS_CHECK_MEMORY(view->where, "%s", pags_json_path(r->json));
  view->split = split;
  bool exists;
  PAGS_TRY(pags_find_file(&r->files, r->folder, file, &view->image_path, &exists));
  view->missing = !exists;
  PAGS_TRY(pags_json_string_or(r->json, frame, "mask_path", NULL, &mask));
  if (mask && !view->missing) {
    PAGS_TRY(pags_find_file(&r->files, r->folder, mask, &view->mask_path, &exists));
    if (!exists)
      return pags_json_fail(r->json, frame, "mask_path names %s, which does not exist", view->mask_path);
  }
  PAGS_TRY(read_pose(r, frame, file, view));
  return find_lens(r, frame, view);
}

static pags_result read_all(reader *r, const char *path, pags_split split) {
  r->folder = pags_path_folder(path);
  PAGS_CHECK_MEMORY(r->folder, "%s", path);
  PAGS_TRY(pags_json_parse_file(path, &r->json));
  r->root = pags_json_root(r->json);
  const pags_json_value *frames = pags_json_member(r->root, "frames");
  if (!frames || (frames->type == PAGS_JSON_ARRAY && frames->first && frames->first->type == PAGS_JSON_NUMBER))
    return pags_unsupported_refuse_json(r->json);
  PAGS_TRY(pags_json_array(r->json, r->root, "frames", &frames));
  PAGS_TRY(pags_split_lists_read(r->json, r->root, &r->lists));
  if (r->lists.names)
    r->parsed->split_by = "its lists of file names";
  for (const pags_json_value *frame = frames->first; frame; frame = frame->next)
    PAGS_TRY(read_frame(r, frame, split));
  if (r->lists.left_out && r->lists.left_out == frames->count)
    return pags_json_fail(r->json, frames,
                          "none of its %lld frames is in train_filenames, val_filenames or test_filenames; expected "
                          "the names that 'file_path' has",
                          (long long)frames->count);
  report_unused(r, frames);
  if (r->scaled)
    PAGS_WARN(
        "%s: 'transform_matrix' of %lld of %lld frames has a scale (%.4g to %.4g), which is left out: rotation and "
        "position are used as they are; the first is %s",
        pags_json_path(r->json), (long long)r->scaled, (long long)frames->count, r->scale_range[0], r->scale_range[1],
        r->first_scaled);
  return r->parsed->points.count ? PAGS_OK : read_points(r);
}

/* Appends the frames of a file; `split`: the one that all are of, NONE: as the file says. */
static pags_result append(const char *path, pags_split split, pags_parsed_dataset *parsed) {
  reader r = {.parsed = parsed};
  pags_result result = read_all(&r, path, split);
  pags_file_finder_end(&r.files, path, "files");
  pags_split_lists_end(&r.lists, path);
  pags_json_destroy(r.json);
  free(r.folder);
  return result;
}

pags_result pags_transforms_read(const char *file, bool splits, pags_parsed_dataset *parsed) {
  static const char *const names[] = {"transforms_train.json", "transforms_val.json", "transforms_test.json"};
  *parsed = (pags_parsed_dataset){.kind = "transforms.json", .up = PAGS_UP_Z, .source = pags_text_copy(file)};
  PAGS_CHECK_MEMORY(parsed->source, "%s", file);
  if (!splits) {
    PAGS_TRY(append(file, PAGS_SPLIT_NONE, parsed));
    /* A file of another name may be meant as a part of the capture. */
    const bool whole = !parsed->split_by && strcmp(pags_path_name(file), "transforms.json") == 0;
    return whole ? pags_count_unused_pictures(parsed) : PAGS_OK;
  }
  int files = 0;
  for (int i = 0; i < 3; i++) {
    if (!pags_folder_has(file, names[i]))
      continue;
    PAGS_AUTOFREE char *path = pags_path_join(file, names[i]);
    PAGS_CHECK_MEMORY(path, "%s", file);
    PAGS_TRY(append(path, i == 0 ? PAGS_SPLIT_TRAIN : PAGS_SPLIT_TEST, parsed));
    files++;
  }
  if (files > 1)
    parsed->split_by = "transforms_val.json or transforms_test.json";
  return PAGS_OK;
}
