/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the label plane of a photograph: bits PAGS_LABEL_* for sky, critical, moving, kinds of moving objects,
 * parked. critical.c decides what is critical.
 *
 * Label files are loaded at the photograph's own resolution and are undistorted and shrunk with it. Boxes are drawn
 * last, directly into the plane of the finished photograph: for every camera, the labelled pose of the box at the
 * frame's time step is used without correction for the exposure time. */
#include "dataset/driving/label_plane.h"

#include "base/memory.h"
#include "dataset/driving/masks.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

bool pags_label_planes_exist(const pags_dataset *dataset, int64_t view) {
  const pags_parsed_view *from = &dataset->parsed.views[view];
  const pags_driving *driving = dataset->parsed.driving;
  return driving && (from->sky_path || from->semantic_path || from->dynamic_path || from->part_path ||
                     (driving->provides & (PAGS_PROVIDES_BOXES | PAGS_PROVIDES_LIDAR)));
}

static size_t area(const pags_lens *lens) {
  return (size_t)lens->width * (size_t)lens->height;
}

/* Sets `bits` in `labels` where the mask file is white and, unless `mask` is NULL, clears `mask` there. */
static pags_result add_mask(const char *path, const pags_lens *lens, uint8_t bits, uint8_t *labels, uint8_t *mask) {
  PAGS_AUTO(pags_image_destroy) pags_image white = {0};
  PAGS_TRY(pags_driving_load_mask(path, lens, &white));
  const uint8_t *from = white.data, least = pags_driving_white(&white);
  for (size_t i = 0; i < area(lens); i++) {
    labels[i] |= from[i] >= least ? bits : 0;
    if (mask && from[i] >= least)
      mask[i] = 0;
  }
  return PAGS_OK;
}

/* Creates a mask that uses every pixel, unless there is a mask already. */
static pags_result make_mask(const pags_lens *lens, pags_image *mask) {
  if (mask->data)
    return PAGS_OK;
  PAGS_TRY(pags_image_create(mask, lens->width, lens->height, 1, PAGS_U8));
  memset(mask->data, 255, area(lens));
  return PAGS_OK;
}

/* Excludes the pixels that show the ego vehicle from the mask. */
static pags_result clear_ego(const pags_sensor *sensor, const pags_lens *lens, pags_image *mask) {
  const pags_image *ego = &sensor->ego;
  if (!ego->data)
    return PAGS_OK;
  if (ego->width != lens->width || ego->height != lens->height)
    return pags_fail(PAGS_ERROR_FORMAT, "camera %d: ego mask of %d x %d pixels for a photograph of %d x %d",
                     sensor->number, ego->width, ego->height, lens->width, lens->height);
  PAGS_TRY(make_mask(lens, mask));
  const uint8_t *from = ego->data;
  uint8_t *to = mask->data;
  for (size_t i = 0; i < area(lens); i++)
    to[i] = from[i] >= 128 ? 0 : to[i];
  return PAGS_OK;
}

/* Loads the label files of a view into `labels`. At a time step without boxes no model shows moving objects, so that
 * pixels of moving classes and of dynamic masks are excluded from the loss by `mask`. */
static pags_result load_files(const pags_driving *driving, const pags_parsed_view *view, uint8_t *labels,
                              pags_image *mask) {
  bool without =
      (view->semantic_path || view->dynamic_path || view->part_path) && !pags_driving_has_boxes(driving, view->frame);
  if (without)
    PAGS_TRY(make_mask(&view->lens, mask));
  uint8_t *left_out = without ? mask->data : NULL;
  if (view->sky_path)
    PAGS_TRY(add_mask(view->sky_path, &view->lens, PAGS_LABEL_SKY, labels, NULL));
  if (view->semantic_path) {
    /* Class ids become label bits; a sky mask takes precedence over the class sky. */
    PAGS_AUTO(pags_image_destroy) pags_image classes = {0};
    int wanted = PAGS_LABEL_CRITICAL | (view->sky_path ? 0 : PAGS_LABEL_SKY | PAGS_LABEL_SKY_UNKNOWN);
    PAGS_TRY(pags_driving_load_labels(view->semantic_path, &view->lens, &classes));
    const uint8_t *from = classes.data;
    for (size_t i = 0; i < area(&view->lens); i++) {
      int bits = driving->critical.classes[from[i]];
      labels[i] |= (uint8_t)(bits & wanted);
      if (left_out && bits & PAGS_LABEL_MOVING)
        left_out[i] = 0;
    }
  }
  uint8_t dynamic = PAGS_LABEL_MOVING | (driving->critical.all_dynamic ? PAGS_LABEL_CRITICAL : 0);
  if (view->dynamic_path)
    PAGS_TRY(add_mask(view->dynamic_path, &view->lens, dynamic, labels, left_out));
  if (view->part_path)
    PAGS_TRY(add_mask(view->part_path, &view->lens, PAGS_LABEL_CRITICAL, labels, left_out));
  return PAGS_OK;
}

pags_result pags_label_plane_load(const pags_dataset *dataset, int64_t index, pags_image *labels, pags_image *mask) {
  const pags_driving *driving = dataset->parsed.driving;
  const pags_parsed_view *view = &dataset->parsed.views[index];
  if (!driving)
    return PAGS_OK;
  const pags_sensor *sensor = pags_driving_sensor(driving, view->sensor);
  assert(sensor);
  PAGS_TRY(clear_ego(sensor, &view->lens, mask));
  if (!view->sky_path && !view->semantic_path && !view->dynamic_path && !view->part_path)
    return PAGS_OK;
  PAGS_TRY(pags_image_create(labels, view->lens.width, view->lens.height, 1, PAGS_U8));
  return load_files(driving, view, labels->data, mask);
}

/* Label bits that the box of an object sets in a view. Where the view has dynamic masks, these state what moves, and
 * where it has label images, these state what is critical, because both are more precise than boxes. */
static uint8_t bits_of(const pags_driving *driving, int64_t index, const pags_parsed_view *view) {
  const pags_object *object = &driving->objects[index];
  static const uint8_t kinds[] = {0, PAGS_LABEL_VEHICLE, PAGS_LABEL_PEDESTRIAN, PAGS_LABEL_CYCLIST};
  int bits = object->moving ? kinds[object->category] : PAGS_LABEL_PARKED;
  if (object->moving && !view->dynamic_path)
    bits |= PAGS_LABEL_MOVING;
  if (driving->critical.objects[index] > (view->semantic_path ? PAGS_CRITICAL_WITHOUT_LABELS : PAGS_CRITICAL_NOT))
    bits |= PAGS_LABEL_CRITICAL;
  return (uint8_t)bits;
}

pags_result pags_label_plane_add(const pags_dataset *dataset, int64_t index, const pags_camera *camera, int stride,
                                 uint8_t *plane) {
  const pags_driving *driving = dataset->parsed.driving;
  const pags_parsed_view *view = &dataset->parsed.views[index];
  PAGS_AUTO(pags_pixel_rays_destroy) pags_pixel_rays rays = {0};
  PAGS_TRY(pags_pixel_rays_create(camera, &rays));

  for (int64_t i = 0; i < driving->object_count; i++) {
    const pags_object *object = &driving->objects[i];
    const pags_keyframe *keyframe = pags_object_keyframe(object, view->frame);
    if (!keyframe)
      continue;
    const uint8_t bits = bits_of(driving, i, view);
    double corners[32];
    if (rays.direction) {
      pags_pixel_rays_fill_box(&rays, camera, keyframe->world_from_object, object->size, stride, bits, plane);
      continue;
    }
    const int count = pags_box_outline(camera, keyframe->world_from_object, object->size, corners);
    pags_outline_fill(corners, count, camera->width, camera->height, stride, bits, plane);
  }

  if (view->sky_path || (view->semantic_path && pags_labels_know_sky(driving)))
    return PAGS_OK;
  if (driving->sweep_count > 0)
    return pags_sky_from_lidar(driving, view->frame, camera, &rays, stride, plane);
  for (int y = 0; y < camera->height; y++)
    for (int x = 0; x < camera->width; x++)
      plane[(size_t)y * (size_t)stride + (size_t)x] |= PAGS_LABEL_SKY_UNKNOWN;
  return PAGS_OK;
}
