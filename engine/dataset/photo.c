/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes a photograph into the planes of bytes that the loss reads: load the files, undistort, shrink, split the
 * colours, the mask and the labels into planes. */
#include "dataset/internal.h"

#include "base/memory.h"
#include "dataset/driving/driving_set.h"
#include "dataset/driving/label_plane.h"
#include "dataset/photo_colour.h"
#include "dataset/photo_mask.h"
#include "dataset/undistort.h"
#include "dataset/view_camera.h"
#include "image/pixels.h"
#include "port/port.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct pictures {
  pags_image colour;
  pags_image mask;   /* data NULL: no mask, every pixel is used */
  pags_image labels; /* data NULL: no label files */
} pictures;

static const pictures nothing = {{0}, {0}, {0}};

static void destroy(pictures *p) {
  pags_image_destroy(&p->colour);
  pags_image_destroy(&p->mask);
  pags_image_destroy(&p->labels);
}

static pags_result check_size(const pags_image *image, const char *path, const pags_lens *lens) {
  if (image->width == lens->width && image->height == lens->height)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_FORMAT, "%s: %d x %d pixels, expected %d x %d as its camera has", path, image->width,
                   image->height, lens->width, lens->height);
}

/* Loads the mask file of a view. A pixel is used if it and the photograph's alpha, if that is a mask, say so. */
static pags_result load_mask(const pags_parsed_view *from, pictures *out) {
  pags_image mask;
  PAGS_TRY(pags_photo_mask_load(from->mask_path, &mask, NULL));
  pags_result result = pags_photo_mask_fit(from->mask_path, from->lens.width, from->lens.height, from->turn, &mask);
  if (result != PAGS_OK || !out->mask.data) {
    pags_image_destroy(&out->mask);
    out->mask = mask;
    return result;
  }
  const uint8_t *more = mask.data;
  uint8_t *used = out->mask.data;
  for (size_t i = 0; i < (size_t)mask.width * (size_t)mask.height; i++)
    used[i] &= more[i];
  pags_image_destroy(&mask);
  return PAGS_OK;
}

static pags_result load(const pags_dataset *dataset, int64_t index, pictures *out) {
  const pags_view *view = &dataset->views[index];
  const pags_parsed_view *from = &dataset->parsed.views[index];
  pags_alpha_rule rule = {.what = dataset->image_alpha};
  memcpy(rule.background, dataset->background, sizeof rule.background);
  PAGS_TRY(pags_photo_colour_load(view->image_path, &from->picture, &rule, &out->colour, &out->mask));
  if (from->turn > 1)
    PAGS_TRY(pags_image_turn(&out->colour, from->turn));
  if (from->turn > 1 && out->mask.data)
    PAGS_TRY(pags_image_turn(&out->mask, from->turn));
  PAGS_TRY(check_size(&out->colour, view->image_path, &from->lens));
  if (view->mask_path)
    PAGS_TRY(load_mask(from, out));
  return pags_label_plane_load(dataset, index, &out->labels, &out->mask);
}

static bool is_white(const pags_image *image) {
  const uint8_t *data = image->data;
  const size_t size = (size_t)image->width * (size_t)image->height;
  size_t white = 0;
  while (white < size && data[white] >= 128)
    white++;
  return data && white == size;
}

bool pags_dataset_masks_of(const pags_dataset *dataset, int64_t index, char *text, size_t size) {
  const pags_parsed_view *view = &dataset->parsed.views[index];
  const pags_driving *driving = dataset->parsed.driving;
  const pags_sensor *sensor = driving ? pags_driving_sensor(driving, view->sensor) : NULL;
  const pags_lens *lens = &view->lens;
  const bool ego = sensor && sensor->ego.data, all = ego && is_white(&sensor->ego);
  const bool alpha = !all && view->picture.alpha && dataset->image_alpha != PAGS_ALPHA_IGNORE;
  const bool file = !all && view->mask_path, bent = !all && !pags_lens_is_pinhole(lens);
  char camera[48] = "";
  if (ego)
    snprintf(camera, sizeof camera, "the ego mask of camera %d", sensor->number);
  snprintf(text, size, "%s%s%s%s%s%s%s", camera, ego && file ? ", " : "", file ? "its mask" : "",
           (ego || file) && alpha ? ", " : "", alpha ? "its alpha" : "", (ego || file || alpha) && bent ? ", " : "",
           bent ? "its lens, which doesn't see every pixel" : "");
  return ego || alpha || bent || !file;
}

/* Resamples the pictures to the pinhole of a view or, if it keeps its lens, masks what that doesn't see. */
static pags_result undistort(const pags_lens *lens, const pags_camera *camera, pictures *p) {
  if (pags_lens_is_pinhole(lens))
    return PAGS_OK;
  if (pags_camera_bends(camera))
    return pags_view_camera_mask(camera, &p->mask);
  pictures out = nothing;
  PAGS_TRY(pags_undistort(lens, camera, &p->colour, p->mask.data ? &p->mask : NULL, &out.colour, &out.mask));
  pags_result result = p->labels.data ? pags_undistort_labels(lens, camera, &p->labels, &out.labels) : PAGS_OK;
  destroy(p);
  *p = out;
  return result;
}

static bool is_full_size(const pags_camera *from, const pags_camera *to) {
  return from->fx / to->fx < 1 + 1e-9;
}

/* Shrinks a label image by taking the source label at each target pixel's centre; label bits can't be averaged. */
static void pick_labels(const pags_image *from, double step_x, double step_y, pags_image *to) {
  const uint8_t *labels = from->data;
  uint8_t *out = to->data;
  for (int y = 0; y < to->height; y++) {
    int row = (int)fmin((y + 0.5) * step_y, from->height - 1);
    for (int x = 0; x < to->width; x++)
      *out++ = labels[(size_t)row * (size_t)from->width + (size_t)fmin((x + 0.5) * step_x, from->width - 1)];
  }
}

/* Shrinks the pictures from camera `from` to camera `to` with a single area average, which covers both the downscale
 * of the data set and the trainer's own shrink factor. The step is the ratio of the focal lengths, so that pixels and
 * intrinsics agree even where a size was rounded down. */
static pags_result shrink(const pags_camera *from, const pags_camera *to, pictures *p) {
  double step_x = fmax(from->fx / to->fx, 1), step_y = fmax(from->fy / to->fy, 1);
  if (is_full_size(from, to))
    return PAGS_OK;
  pictures out = nothing;
  pags_result result = pags_image_create(&out.colour, to->width, to->height, 3, PAGS_U8);
  if (result == PAGS_OK)
    result = pags_shrink_mean(&p->colour, step_x, step_y, &out.colour);
  if (result == PAGS_OK && p->mask.data) {
    result = pags_image_create(&out.mask, to->width, to->height, 1, PAGS_U8);
    if (result == PAGS_OK)
      pags_shrink_mask(&p->mask, step_x, step_y, &out.mask);
  }
  if (result == PAGS_OK && p->labels.data) {
    result = pags_image_create(&out.labels, to->width, to->height, 1, PAGS_U8);
    if (result == PAGS_OK)
      pick_labels(&p->labels, step_x, step_y, &out.labels);
  }
  destroy(p);
  *p = out;
  return result;
}

static int stride_of(int width) {
  return (width + 15) & ~15;
}

static uint64_t plane_bytes(int width, int height) {
  return (uint64_t)stride_of(width) * (uint64_t)height;
}

static void split_plane(const uint8_t *from, int channels, const pags_photo_data *photo, uint8_t *plane) {
  for (int y = 0; y < photo->height; y++) {
    uint8_t *row = plane + (size_t)y * (size_t)photo->stride;
    for (int x = 0; x < photo->width; x++, from += channels)
      row[x] = *from;
    memset(row + photo->width, 0, (size_t)(photo->stride - photo->width));
  }
}

static pags_result split(const pictures *p, bool has_labels, pags_photo_data *out) {
  out->width = p->colour.width;
  out->height = p->colour.height;
  out->stride = stride_of(out->width);
  out->has_mask = p->mask.data != NULL;
  out->has_labels = has_labels;
  uint64_t plane = plane_bytes(out->width, out->height);
  uint64_t bytes = plane * (uint64_t)(3 + out->has_mask + out->has_labels);
  out->planes = pags_port_aligned_alloc(64, (size_t)((bytes + 63) & ~(uint64_t)63));
  if (!out->planes)
    return pags_out_of_memory("a photograph of %d x %d pixels", out->width, out->height);
  const uint8_t *colour = p->colour.data;
  for (size_t c = 0; c < 3; c++)
    split_plane(colour + c, 3, out, out->planes + c * plane);
  uint8_t *next = out->planes + 3 * plane;
  if (out->has_mask)
    split_plane(p->mask.data, 1, out, next);
  next += out->has_mask ? plane : 0;
  if (p->labels.data)
    split_plane(p->labels.data, 1, out, next);
  else if (has_labels)
    memset(next, 0, (size_t)plane);
  return PAGS_OK;
}

static pags_result add_labels(const pags_dataset *dataset, int64_t index, const pags_camera *target,
                              pags_photo_data *out) {
  if (!out->has_labels)
    return PAGS_OK;
  uint8_t *plane = out->planes + (out->has_mask ? 4 : 3) * plane_bytes(out->width, out->height);
  pags_result result = pags_label_plane_add(dataset, index, target, out->stride, plane);
  if (result == PAGS_OK)
    return PAGS_OK;
  pags_port_aligned_free(out->planes);
  memset(out, 0, sizeof *out);
  return result;
}

pags_result pags_photo_decode(const pags_dataset *dataset, int64_t index, int factor, pags_photo_data *out) {
  assert(index >= 0 && index < dataset->count && factor >= 1);
  const pags_lens *lens = &dataset->parsed.views[index].lens;
  const pags_camera *camera = &dataset->cameras[index];
  pags_camera target = pags_camera_downscale(&dataset->views[index].camera, factor);
  memset(out, 0, sizeof *out);
  pictures p = nothing;
  pags_result result = load(dataset, index, &p);
  if (result == PAGS_OK)
    result = undistort(lens, camera, &p);
  if (result == PAGS_OK)
    result = shrink(camera, &target, &p);
  if (result == PAGS_OK)
    result = split(&p, pags_label_planes_exist(dataset, index), out);
  destroy(&p);
  return result == PAGS_OK ? add_labels(dataset, index, &target, out) : result;
}

void pags_photo_bytes(const pags_dataset *dataset, int64_t index, int factor, uint64_t *kept, uint64_t *decoding) {
  const pags_lens *lens = &dataset->parsed.views[index].lens;
  const pags_camera *camera = &dataset->cameras[index];
  pags_camera target = pags_camera_downscale(&dataset->views[index].camera, factor);
  bool straight = pags_lens_is_pinhole(lens) || pags_camera_bends(camera), same = is_full_size(camera, &target);
  /* Upper bound: the decoded files, the undistorted pictures, the shrunk pictures and the planes are counted as if
   * they existed together, although each step only holds its input and its output. Two source planes are counted for
   * labels: the label image and one of the files it is made of, which are loaded one at a time. */
  uint64_t labels = pags_label_planes_exist(dataset, index) ? 1 : 0;
  const pags_parsed_view *view = &dataset->parsed.views[index];
  const bool alpha = pags_photo_has_alpha(&view->picture, dataset->image_alpha);
  /* What a photograph takes more before it is colours and a mask of bytes: alpha, linear light, that it is turned, and
   * what its lens sees. */
  const int channels = alpha ? 4 : 3;
  const uint64_t loaded = (alpha ? 4u : 0u) +
                          (view->picture.sample == PAGS_F32           ? 5u * (unsigned)channels
                           : view->picture.colour != PAGS_COLOUR_SRGB ? 3u * (unsigned)channels
                                                                      : 0u) +
                          (view->turn > 1 ? 4u : 0u) + (pags_camera_bends(camera) ? 1u : 0u);
  uint64_t source = (4 + 2 * labels + loaded) * (uint64_t)lens->width * (uint64_t)lens->height;
  uint64_t upright = straight ? 0 : (4 + labels) * (uint64_t)camera->width * (uint64_t)camera->height;
  uint64_t shrunk = same ? 0 : (4 + labels) * (uint64_t)target.width * (uint64_t)target.height;
  *kept = (4 + labels) * plane_bytes(target.width, target.height) + 64;
  *decoding = source + upright + shrunk + *kept;
}
