/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a COLMAP model (files cameras, images and points3D, all .bin or all .txt) into a parsed data set and finds
 * the folder of its pictures.
 *
 * COLMAP stores a pose as camera_from_world (quaternion w x y z, translation) with OpenCV axes; this file inverts the
 * pose to world_from_camera. The corners of an image lie at pixel coordinate 0 and at its width or height. The
 * observations of the images (points2D) are skipped, because the track of each point lists the images that see it. */
#include "dataset/colmap.h"

#include "base/file.h"
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
  bool known;
} model_kind;

/* Camera models; the index is COLMAP's numeric id of the model. `known` says whether the model is supported. */
static const model_kind kinds[] = {{"SIMPLE_PINHOLE", 3, true},
                                   {"PINHOLE", 4, true},
                                   {"SIMPLE_RADIAL", 4, true},
                                   {"RADIAL", 5, true},
                                   {"OPENCV", 8, true},
                                   {"OPENCV_FISHEYE", 8, true},
                                   {"FULL_OPENCV", 12, false},
                                   {"FOV", 5, false},
                                   {"SIMPLE_RADIAL_FISHEYE", 4, false},
                                   {"RADIAL_FISHEYE", 5, false},
                                   {"THIN_PRISM_FISHEYE", 12, false}};

enum { KINDS = sizeof kinds / sizeof *kinds };

static pags_result unknown_kind(const char *where, const char *name) {
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s: camera model %s is not supported; expected SIMPLE_PINHOLE, PINHOLE, "
                   "SIMPLE_RADIAL, RADIAL, OPENCV or OPENCV_FISHEYE",
                   where, name);
}

pags_result pags_colmap_kind_by_id(const char *where, int64_t id, int *out) {
  char number[32];
  snprintf(number, sizeof number, "number %lld", (long long)id);
  *out = (int)id;
  if (id < 0 || id >= KINDS || !kinds[id].known)
    return unknown_kind(where, id >= 0 && id < KINDS ? kinds[id].name : number);
  return PAGS_OK;
}

pags_result pags_colmap_kind_by_name(const char *where, const char *name, int *out) {
  for (int i = 0; i < KINDS; i++)
    if (kinds[i].known && strcmp(name, kinds[i].name) == 0) {
      *out = i;
      return PAGS_OK;
    }
  return unknown_kind(where, name);
}

int pags_colmap_parameters(int kind) {
  return kinds[kind].parameters;
}

void pags_colmap_set_lens(int kind, const double *parameters, pags_lens *lens) {
  /* Parameter order: focal lengths (one for SIMPLE_* and RADIAL, two for every other model), principal point, radial
   * coefficients, then p1 and p2 (OPENCV only). */
  const double *p = parameters;
  bool single = kind == 0 || kind == 2 || kind == 3;
  lens->fx = p[0];
  lens->fy = single ? p[0] : p[1];
  p += single ? 1 : 2;
  lens->cx = p[0];
  lens->cy = p[1];
  p += 2;
  lens->kind = kind == 5 ? PAGS_LENS_FISHEYE : PAGS_LENS_PERSPECTIVE;
  int radial = kind == 2 ? 1 : kind == 3 || kind == 4 ? 2 : kind == 5 ? 4 : 0;
  for (int i = 0; i < radial; i++)
    lens->k[i] = p[i];
  for (int i = 0; i < 2 && kind == 4; i++)
    lens->p[i] = p[2 + i];
}

/* ---- Adding cameras and images ---- */

pags_colmap_camera *pags_colmap_add_camera(pags_colmap *model) {
  if (model->camera_count == model->camera_capacity) {
    int64_t capacity = model->camera_capacity ? 2 * model->camera_capacity : 8;
    pags_colmap_camera *cameras = realloc(model->cameras, (size_t)capacity * sizeof *cameras);
    if (!cameras)
      return NULL;
    model->cameras = cameras;
    model->camera_capacity = capacity;
  }
  pags_colmap_camera *camera = &model->cameras[model->camera_count++];
  memset(camera, 0, sizeof *camera);
  return camera;
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
  const double *q = image->pose;
  double square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  if (!(square > 0.25 && square < 4))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: image %s: expected a unit quaternion, found one of squared length %g",
                     where, image->name, square);
  if (*pags_path_name(image->name) == '\0')
    return pags_fail(PAGS_ERROR_FORMAT, "%s: image %lld: expected a name", where, (long long)image->id);
  pags_parsed_view *view = pags_parsed_add(model->parsed);
  if (!view)
    return pags_out_of_memory("%s", where);
  view->where = pags_text_copy(where);
  view->image_path = pags_text_copy(image->name); /* relative; locate_pictures prepends the folder of images */
  if (!view->where || !view->image_path)
    return pags_out_of_memory("%s", where);
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

/* Returns the first of the usual folders that holds at least one of the model's pictures, or `root`/images when no
 * folder does; NULL when out of memory. The caller frees the returned path. */
static char *find_pictures(const char *root, const char *model, const pags_parsed_dataset *parsed) {
  const char *const bases[] = {root, root, model, model, model};
  static const char *const places[] = {"images", ".", "images", "../images", "../../images"};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    char *folder = strcmp(places[i], ".") == 0 ? pags_text_copy(bases[i]) : pags_path_join(bases[i], places[i]);
    bool found = false;
    for (int64_t j = 0; folder && j < parsed->count && !found && pags_dir_exists(folder); j++)
      found = pags_folder_has(folder, parsed->views[j].image_path);
    if (found)
      return folder;
    free(folder);
  }
  return pags_path_join(root, "images");
}

static pags_result locate_pictures(const char *root, const char *model, pags_parsed_dataset *parsed) {
  char *folder = find_pictures(root, model, parsed);
  pags_result result = folder ? PAGS_OK : pags_out_of_memory("%s", root);
  for (int64_t i = 0; result == PAGS_OK && i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i];
    char *path = pags_path_join(folder, view->image_path);
    if (path) {
      free(view->image_path);
      view->image_path = path;
      view->missing = !pags_path_exists(path);
    } else {
      result = pags_out_of_memory("%s", root);
    }
  }
  free(folder);
  return result;
}

/* ---- Reading a model ---- */

/* Reads one file of the model (`part`.`extension`) with `read`. A missing file is an error only if it is required. */
static pags_result read_part(const char *model, const char *part, const char *extension, pags_colmap_read_fn *read,
                             bool required, pags_colmap *into) {
  char *path = pags_text_format("%s/%s.%s", model, part, extension);
  if (!path)
    return pags_out_of_memory("%s", model);
  pags_result result = PAGS_OK;
  if (required || pags_file_exists(path)) {
    pags_colmap_bytes bytes = {.path = path};
    result = pags_file_read(path, &bytes.data, &bytes.size);
    if (result == PAGS_OK)
      result = read(into, &bytes);
    free(bytes.data);
  }
  free(path);
  return result;
}

static pags_result read_model(const char *model, pags_colmap *into) {
  if (pags_folder_has(model, "cameras.bin") && pags_folder_has(model, "images.bin")) {
    PAGS_TRY(read_part(model, "cameras", "bin", pags_colmap_cameras_bin, true, into));
    PAGS_TRY(read_part(model, "images", "bin", pags_colmap_images_bin, true, into));
    return read_part(model, "points3D", "bin", pags_colmap_points_bin, false, into);
  }
  PAGS_TRY(read_part(model, "cameras", "txt", pags_colmap_cameras_txt, true, into));
  PAGS_TRY(read_part(model, "images", "txt", pags_colmap_images_txt, true, into));
  return read_part(model, "points3D", "txt", pags_colmap_points_txt, false, into);
}

pags_result pags_colmap_read(const char *root, const char *model, pags_parsed_dataset *parsed) {
  memset(parsed, 0, sizeof *parsed);
  parsed->kind = "colmap";
  parsed->up = PAGS_UP_MINUS_Y;
  parsed->source = pags_text_copy(model);
  pags_colmap into = {.parsed = parsed};
  pags_result result = parsed->source ? read_model(model, &into) : pags_out_of_memory("%s", model);
  if (result == PAGS_OK)
    result = locate_pictures(root, model, parsed);
  parsed->points.tracked = true;
  pags_parsed_sort_points(&parsed->points);
  free(into.cameras);
  if (result != PAGS_OK)
    pags_parsed_destroy(parsed);
  return result;
}
