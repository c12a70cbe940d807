/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a COLMAP model (files cameras, images and points3D, all .bin or all .txt) into a parsed data set and finds
 * the folder of its pictures.
 *
 * COLMAP stores a pose as camera_from_world (quaternion w x y z, translation) with OpenCV axes; this file inverts the
 * pose to world_from_camera. The corners of an image lie at pixel coordinate 0 and at its width or height. The
 * observations of the images (points2D) are skipped, because the track of each point lists the images that see it. */
#include "dataset/colmap.h"
#include "dataset/find_file.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Camera models ---- */

typedef struct model_kind {
  const char *name;
  int parameters;
  bool single; /* one focal length for both axes */
  pags_lens_kind lens;
  /* What the parameters behind the principal point are, a letter each: k, d and p count up from the first; q is p with
   * its two numbers exchanged; s[0..3]. */
  const char *rest;
} model_kind;

/* Camera models; the index is COLMAP's numeric id of the model. The orders of their parameters are those of COLMAP's
 * documentation. */
static const model_kind kinds[] = {
    {"SIMPLE_PINHOLE", 3, true, PAGS_LENS_PERSPECTIVE, ""},
    {"PINHOLE", 4, false, PAGS_LENS_PERSPECTIVE, ""},
    {"SIMPLE_RADIAL", 4, true, PAGS_LENS_PERSPECTIVE, "k"},
    {"RADIAL", 5, true, PAGS_LENS_PERSPECTIVE, "kk"},
    {"OPENCV", 8, false, PAGS_LENS_PERSPECTIVE, "kkpp"},
    {"OPENCV_FISHEYE", 8, false, PAGS_LENS_FISHEYE, "kkkk"},
    {"FULL_OPENCV", 12, false, PAGS_LENS_RATIONAL, "kkppkddd"},
    {"FOV", 5, false, PAGS_LENS_FOV, "k"},
    {"SIMPLE_RADIAL_FISHEYE", 4, true, PAGS_LENS_FISHEYE, "k"},
    {"RADIAL_FISHEYE", 5, true, PAGS_LENS_FISHEYE, "kk"},
    {"THIN_PRISM_FISHEYE", 12, false, PAGS_LENS_THIN_PRISM, "kkppkkss"},
    {"RAD_TAN_THIN_PRISM_FISHEYE", 16, false, PAGS_LENS_ARIA, "kkkkkkqqssss"},
    {"SIMPLE_DIVISION", 4, true, PAGS_LENS_DIVISION, "k"},
    {"DIVISION", 5, false, PAGS_LENS_DIVISION, "k"},
    {"SIMPLE_FISHEYE", 3, true, PAGS_LENS_FISHEYE, ""},
    {"FISHEYE", 4, false, PAGS_LENS_FISHEYE, ""},
    {"EUCM", 6, false, PAGS_LENS_EUCM, "kk"},
    {"EQUIRECTANGULAR", 2, false, PAGS_LENS_EQUIRECTANGULAR, NULL} /* width and height of a whole panorama */
};

enum { KINDS = sizeof kinds / sizeof *kinds };

pags_result pags_colmap_find_kind(const char *where, const char *name, int64_t id, int *kind) {
  for (*kind = 0; *kind < KINDS; ++*kind)
    if (name ? strcmp(name, kinds[*kind].name) == 0 : *kind == id)
      return PAGS_OK;
  char number[32];
  snprintf(number, sizeof number, "number %lld", (long long)id);
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s: camera model %s is not known; expected SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, "
                   "FULL_OPENCV, FOV, DIVISION, EUCM, EQUIRECTANGULAR or a FISHEYE model of COLMAP; `colmap "
                   "image_undistorter` makes PINHOLE ones of any",
                   where, name ? name : number);
}

int pags_colmap_parameters(int kind) {
  return kinds[kind].parameters;
}

void pags_colmap_set_lens(int kind, const double *parameters, pags_lens *lens) {
  const model_kind *model = &kinds[kind];
  const double *p = parameters;
  lens->model.kind = model->lens;
  if (model->lens == PAGS_LENS_EQUIRECTANGULAR) {
    pags_lens_set_panorama(p[0], p[1], lens);
    return;
  }
  lens->fx = *p++;
  lens->fy = model->single ? lens->fx : *p++;
  lens->cx = *p++;
  lens->cy = *p++;
  double *const k = lens->model.k, *const tangential = lens->model.p;
  int next_k = 0, next_d = 0, next_p = 0, next_s = 0;
  for (const char *letter = model->rest; letter && *letter; letter++, p++)
    switch (*letter) {
      case 'k': k[next_k++] = *p; break;
      case 'd': lens->model.d[next_d++] = *p; break;
      case 'p': tangential[next_p++] = *p; break;
      case 'q': tangential[1 - next_p++] = *p; break;
      default: lens->model.s[next_s++] = *p; break;
    }
}

/* ---- Adding cameras and images ---- */

pags_colmap_camera *pags_colmap_add_camera(pags_colmap *model) {
  if (!pags_grow(&model->cameras, model->camera_count + 1, &model->camera_capacity, sizeof *model->cameras))
    return NULL;
  pags_colmap_camera *camera = &model->cameras[model->camera_count++];
  *camera = (pags_colmap_camera){0};
  return camera;
}

pags_result pags_colmap_keep_problem(pags_colmap *model, pags_result result) {
  if (result != PAGS_ERROR_FORMAT && result != PAGS_ERROR_UNSUPPORTED)
    return result;
  pags_colmap_camera *camera = &model->cameras[model->camera_count - 1];
  camera->unsupported = result == PAGS_ERROR_UNSUPPORTED;
  camera->problem = pags_text_copy(pags_error_message());
  return camera->problem ? PAGS_OK : pags_out_of_memory(NULL);
}

static int by_id(const void *a, const void *b) {
  int64_t left = ((const pags_colmap_camera *)a)->id, right = ((const pags_colmap_camera *)b)->id;
  return left < right ? -1 : left > right;
}

pags_result pags_colmap_sort_cameras(pags_colmap *model, const char *where) {
  if (model->camera_count == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected at least one camera", where);
  pags_sort(model->cameras, model->camera_count, sizeof *model->cameras, by_id);
  return PAGS_OK;
}

pags_result pags_colmap_add_image(pags_colmap *model, const char *where, const pags_colmap_image *image) {
  pags_colmap_camera key = {.id = image->camera};
  const pags_colmap_camera *camera = bsearch(&key, model->cameras, (size_t)model->camera_count, sizeof key, by_id);
  if (!camera)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: image %s: expected its camera %lld among the cameras", where, image->name,
                     (long long)image->camera);
  if (camera->problem)
    return pags_fail(camera->unsupported ? PAGS_ERROR_UNSUPPORTED : PAGS_ERROR_FORMAT, "%s", camera->problem);
  const double *q = image->pose;
  double square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  if (!(square > 0.25 && square < 4))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: image %s: expected a unit quaternion, found one of squared length %g",
                     where, image->name, square);
  if (*pags_path_name(image->name) == '\0')
    return pags_fail(PAGS_ERROR_FORMAT, "%s: image %lld: expected a name", where, (long long)image->id);
  pags_parsed_view *view = pags_parsed_add(model->parsed);
  PAGS_CHECK_MEMORY(view, "%s", where);
  view->where = pags_text_copy(where);
  view->image_path = pags_text_copy(image->name); /* relative; locate_pictures prepends the folder of images */
  PAGS_CHECK_MEMORY(view->where && view->image_path, "%s", where);
  view->id = image->id;
  view->lens = camera->lens;
  double r[9], m[12];
  pags_rotation_from_quaternion(q, r);
  for (int i = 0; i < 3; i++) {
    memcpy(m + 4 * i, r + 3 * i, 3 * sizeof *r);
    m[4 * i + 3] = image->pose[4 + i];
  }
  pags_rigid_inverse(m, view->world_from_camera);
  return PAGS_OK;
}

/* ---- Finding the pictures ---- */

bool pags_colmap_is_model(const char *folder) {
  return (pags_folder_has(folder, "cameras.bin") && pags_folder_has(folder, "images.bin")) ||
         (pags_folder_has(folder, "cameras.txt") && pags_folder_has(folder, "images.txt"));
}

/* Whether `folder` holds one of the model's pictures; with `tried`, one of the first few under another spelling. */
static bool holds_picture(const char *folder, const pags_parsed_dataset *parsed, pags_file_finder *tried) {
  bool found = false;
  for (int64_t i = 0; i < parsed->count && !found && (!tried || i < 8); i++) {
    PAGS_AUTOFREE char *path = NULL;
    found = pags_folder_has(folder, parsed->views[i].image_path);
    if (!found && tried && pags_find_file(tried, folder, parsed->views[i].image_path, &path, &found) != PAGS_OK)
      break;
  }
  return found;
}

/* Returns the first of the usual folders that holds at least one of the model's pictures, or `root`/images when no
 * folder does; NULL when out of memory. The caller frees the returned path. */
static char *find_pictures(const char *root, const char *model, const pags_parsed_dataset *parsed) {
  const char *const bases[] = {root, root, model, model, model};
  static const char *const places[] = {"images", ".", "images", "../images", "../../images"};
  enum { PLACES = sizeof places / sizeof *places };
  for (int i = 0; i < 2 * PLACES; i++) { /* as named in all places, then under other spellings */
    const char *base = bases[i % PLACES], *place = places[i % PLACES];
    PAGS_AUTO(pags_file_finder_drop) pags_file_finder finder = {0};
    PAGS_AUTOFREE char *folder = strcmp(place, ".") == 0 ? pags_text_copy(base) : pags_path_join(base, place);
    const bool other_case = folder && i >= PLACES && strcmp(place, "images") == 0 && !pags_dir_exists(folder);
    if (other_case) {
      free(folder);
      folder = pags_find_folder(&finder, base, "images");
    }
    if (!folder || !pags_dir_exists(folder) || !holds_picture(folder, parsed, i < PLACES ? NULL : &finder))
      continue;
    if (other_case)
      PAGS_WARN("%s: there is no folder images; its pictures are taken from %s", model, folder);
    return pags_take(&folder);
  }
  return pags_path_join(root, "images");
}

static pags_result locate_pictures(const char *root, const char *model, pags_parsed_dataset *parsed) {
  PAGS_AUTOFREE char *folder = find_pictures(root, model, parsed);
  PAGS_CHECK_MEMORY(folder, "%s", root);
  PAGS_AUTO(pags_file_finder_drop) pags_file_finder finder = {0};
  for (int64_t i = 0; i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i];
    char *path;
    bool exists = false;
    PAGS_TRY(pags_find_file(&finder, folder, view->image_path, &path, &exists));
    free(view->image_path);
    view->image_path = path;
    view->missing = !exists;
  }
  pags_file_finder_end(&finder, model, "pictures");
  return PAGS_OK;
}

/* ---- Reading a model ---- */

/* Reads one file of the model (`part`.`extension`) with `read`. A missing file is an error only if it is required. */
static pags_result read_part(const char *model, const char *part, const char *extension, pags_colmap_read_fn *read,
                             bool required, pags_colmap *into) {
  PAGS_AUTOFREE char *path = pags_text_format("%s/%s.%s", model, part, extension);
  PAGS_CHECK_MEMORY(path, "%s", model);
  if (!required && !pags_file_exists(path))
    return PAGS_OK;
  PAGS_AUTOFREE uint8_t *data = NULL;
  size_t size;
  PAGS_TRY(pags_file_read(path, &data, &size));
  return read(into, &(pags_colmap_bytes){path, data, size});
}

/* Frees what the data set doesn't take over. */
static void colmap_destroy(pags_colmap *model) {
  for (int64_t i = 0; i < model->camera_count; i++)
    free(model->cameras[i].problem);
  free(model->cameras);
}

pags_result pags_colmap_read(const char *root, const char *model, pags_parsed_dataset *parsed) {
  *parsed = (pags_parsed_dataset){.kind = "colmap", .up = PAGS_UP_MINUS_Y, .source = pags_text_copy(model)};
  PAGS_CHECK_MEMORY(parsed->source, "%s", model);
  PAGS_AUTO(colmap_destroy) pags_colmap into = {.parsed = parsed};
  if (pags_folder_has(model, "cameras.bin") && pags_folder_has(model, "images.bin")) {
    PAGS_TRY(read_part(model, "cameras", "bin", pags_colmap_cameras_bin, true, &into));
    PAGS_TRY(read_part(model, "images", "bin", pags_colmap_images_bin, true, &into));
    PAGS_TRY(read_part(model, "points3D", "bin", pags_colmap_points_bin, false, &into));
  } else {
    PAGS_TRY(read_part(model, "cameras", "txt", pags_colmap_cameras_txt, true, &into));
    PAGS_TRY(read_part(model, "images", "txt", pags_colmap_images_txt, true, &into));
    PAGS_TRY(read_part(model, "points3D", "txt", pags_colmap_points_txt, false, &into));
  }
  PAGS_TRY(pags_parsed_check_points(&parsed->points, model));
  parsed->points.tracked = true;
  pags_parsed_sort_points(&parsed->points);
  return locate_pictures(root, model, parsed);
}
