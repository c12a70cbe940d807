/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes a photograph into the planes of bytes that the loss reads: load the files, undistort, shrink, split the
 * colours, the mask and the labels into planes. Alpha is composited in display values (as INRIA's trainer does it for
 * its synthetic scenes) or taken for a mask. */
#include "dataset/internal.h"

#include "base/memory.h"
#include "dataset/driving/driving_set.h"
#include "dataset/driving/label_plane.h"
#include "dataset/photo_mask.h"
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

static void destroy(pictures *p) {
  pags_image_destroy(&p->colour);
  pags_image_destroy(&p->mask);
  pags_image_destroy(&p->labels);
}

/* Takes over what was made of the pictures, which is destroyed as the source then. */
static void replace(pictures *p, pictures *made) {
  const pictures source = *p;
  *p = *made;
  *made = source;
}

/* Loads the mask file of a view. A pixel is used if it and the photograph's alpha, if that is a mask, say so. */
static pags_result load_mask(const pags_parsed_view *from, pictures *out) {
  PAGS_AUTO(pags_image_destroy) pags_image mask = {0};
  PAGS_TRY(pags_photo_mask_load(from->mask_path, &mask, NULL));
  PAGS_TRY(pags_photo_mask_fit(from->mask_path, from->lens.width, from->lens.height, from->turn, &mask));
  if (!out->mask.data) {
    out->mask = mask;
    mask = (pags_image){0};
    return PAGS_OK;
  }
  const uint8_t *more = mask.data;
  uint8_t *used = out->mask.data;
  for (size_t i = 0; i < (size_t)mask.width * (size_t)mask.height; i++)
    used[i] &= more[i];
  return PAGS_OK;
}

/* Whether alpha is read: that of the file, or what the data window of an EXR file covers of its picture. */
static bool has_alpha(const pags_image_facts *facts, pags_image_alpha what) {
  return (facts->alpha || facts->window == PAGS_WINDOW_PARTIAL) && what != PAGS_ALPHA_IGNORE;
}

/* Loads the colours of a photograph and, for PAGS_ALPHA_MASK, if it has alpha, the mask: 255 where alpha is 128 or
 * more, else 0. */
static pags_result load_colour(const pags_dataset *dataset, const char *path, pictures *out) {
  PAGS_AUTO(pags_image_destroy) pags_image rgba = {0};
  PAGS_TRY(pags_image_load_display(path, 4, &rgba));
  PAGS_TRY(pags_image_create(&out->colour, rgba.width, rgba.height, 3, PAGS_U8));
  if (dataset->image_alpha == PAGS_ALPHA_MASK)
    PAGS_TRY(pags_image_create(&out->mask, rgba.width, rgba.height, 1, PAGS_U8));
  const size_t pixels = (size_t)rgba.width * (size_t)rgba.height;
  const uint8_t *from = rgba.data;
  uint8_t *to = out->colour.data, *used = out->mask.data;
  for (size_t i = 0; i < pixels; i++, from += 4, to += 3) {
    const unsigned alpha = used ? 255 : from[3];
    for (int c = 0; c < 3; c++)
      to[c] = (uint8_t)((alpha * from[c] + (255 - alpha) * dataset->background[c] + 127) / 255);
    if (used)
      *used++ = from[3] >= 128 ? 255 : 0;
  }
  return PAGS_OK;
}

static pags_result load(const pags_dataset *dataset, int64_t index, pictures *out) {
  const char *path = dataset->views[index].image_path;
  const pags_parsed_view *from = &dataset->parsed.views[index];
  const pags_lens *lens = &from->lens;
  pags_image *colour = &out->colour;
  PAGS_TRY(has_alpha(&from->picture, dataset->image_alpha) ? load_colour(dataset, path, out)
                                                           : pags_image_load_display(path, 3, colour));
  if (from->turn > 1)
    PAGS_TRY(pags_image_turn(colour, from->turn));
  if (from->turn > 1 && out->mask.data)
    PAGS_TRY(pags_image_turn(&out->mask, from->turn));
  if (colour->width != lens->width || colour->height != lens->height)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: %d x %d pixels, expected %d x %d as its camera has", path, colour->width,
                     colour->height, lens->width, lens->height);
  if (from->mask_path)
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
  PAGS_AUTO(destroy) pictures out = {0};
  PAGS_TRY(pags_undistort(lens, camera, &p->colour, p->mask.data ? &p->mask : NULL, &out.colour, &out.mask));
  if (p->labels.data)
    PAGS_TRY(pags_undistort_labels(lens, camera, &p->labels, &out.labels));
  replace(p, &out);
  return PAGS_OK;
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
  PAGS_AUTO(destroy) pictures out = {0};
  PAGS_TRY(pags_image_create(&out.colour, to->width, to->height, 3, PAGS_U8));
  PAGS_TRY(pags_shrink_mean(&p->colour, step_x, step_y, &out.colour));
  if (p->mask.data) {
    PAGS_TRY(pags_image_create(&out.mask, to->width, to->height, 1, PAGS_U8));
    pags_shrink_mask(&p->mask, step_x, step_y, &out.mask);
  }
  if (p->labels.data) {
    PAGS_TRY(pags_image_create(&out.labels, to->width, to->height, 1, PAGS_U8));
    pick_labels(&p->labels, step_x, step_y, &out.labels);
  }
  replace(p, &out);
  return PAGS_OK;
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
  PAGS_CHECK_MEMORY(out->planes, "a photograph of %d x %d pixels", out->width, out->height);
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

void pags_photo_data_destroy(pags_photo_data *photo) {
  pags_port_aligned_free(photo->planes);
  *photo = (pags_photo_data){0};
}

pags_result pags_photo_decode(const pags_dataset *dataset, int64_t index, int factor, pags_photo_data *out) {
  assert(index >= 0 && index < dataset->count && factor >= 1);
  const pags_camera *camera = &dataset->cameras[index];
  const pags_camera target = pags_camera_downscale(&dataset->views[index].camera, factor);
  *out = (pags_photo_data){0};
  PAGS_AUTO(destroy) pictures p = {0};
  PAGS_TRY(load(dataset, index, &p));
  PAGS_TRY(undistort(&dataset->parsed.views[index].lens, camera, &p));
  PAGS_TRY(shrink(camera, &target, &p));
  PAGS_TRY(split(&p, pags_label_planes_exist(dataset, index), out));
  destroy(&p); /* before the labels need memory */
  if (!out->has_labels)
    return PAGS_OK;
  uint8_t *plane = out->planes + (out->has_mask ? 4 : 3) * plane_bytes(out->width, out->height);
  const pags_result result = pags_label_plane_add(dataset, index, &target, out->stride, plane);
  if (result != PAGS_OK)
    pags_photo_data_destroy(out);
  return result;
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
  const bool alpha = has_alpha(&view->picture, dataset->image_alpha);
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
