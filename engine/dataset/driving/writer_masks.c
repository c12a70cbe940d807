/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the mask pictures of a driving set: masks that a recording has, and dynamic masks drawn from the outlines of
 * labelled boxes. */
#include <pags/dataset.h>
#include <pags/image.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/driving/writer.h"

enum { ALL, VEHICLE, HUMAN, MASKS };
static const char *const mask_folders[MASKS] = {"dynamic_masks/all", "dynamic_masks/vehicle", "dynamic_masks/human"};

pags_result pags_layout_put_mask(const pags_layout *layout, const char *folder, int64_t frame, int camera, int width,
                                 int height, const uint8_t *pixels) {
  PAGS_AUTOFREE char *path = pags_text_format("%s/%s/%03lld_%d.png", layout->folder, folder, (long long)frame, camera);
  PAGS_CHECK_MEMORY(path, "%s", layout->folder);
  if (pags_file_exists(path))
    return PAGS_OK;
  PAGS_TRY(pags_layout_make_folder(path));
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  PAGS_TRY(pags_image_create(&image, width, height, 1, PAGS_U8));
  memcpy(image.data, pixels, (size_t)width * (size_t)height);
  return pags_image_save(path, &image);
}

static void draw_track(const pags_camera *camera, const pags_layout_track *track, int64_t frame,
                       uint8_t *planes[MASKS]) {
  const pags_object *object = &track->object;
  const pags_keyframe *keyframe = object->moving ? pags_object_keyframe(object, frame) : NULL;
  double corners[32];
  if (!keyframe)
    return;
  const double *size = track->sizes ? track->sizes + 3 * (keyframe - object->keyframes) : object->size;
  const int count = pags_box_outline(camera, keyframe->world_from_object, size, corners);
  if (count == 0)
    return;
  const bool drawn[MASKS] = {
      [ALL] = true,
      [VEHICLE] = object->category == PAGS_CATEGORY_VEHICLE,
      [HUMAN] = object->category == PAGS_CATEGORY_PEDESTRIAN || object->category == PAGS_CATEGORY_CYCLIST};
  for (int m = 0; m < MASKS; m++)
    if (drawn[m])
      pags_outline_fill(corners, count, camera->width, camera->height, camera->width, 255, planes[m]);
}

pags_result pags_layout_put_dynamic_masks_through(const pags_layout *layout, int64_t frame, int number,
                                                  const pags_camera *camera, const pags_layout_lens *lens,
                                                  const pags_layout_track *tracks, int64_t track_count) {
  bool there = true;
  for (int m = 0; m < MASKS; m++)
    there = there && pags_layout_has(layout, mask_folders[m], frame, number, ".png");
  if (there)
    return PAGS_OK;
  const size_t pixels = (size_t)camera->width * (size_t)camera->height;
  const size_t seen = lens ? (size_t)lens->width * (size_t)lens->height : 0;
  PAGS_AUTOFREE uint8_t *block = calloc(1, MASKS * pixels + seen);
  PAGS_CHECK_MEMORY(block, "%s: masks of %dx%d", layout->folder, camera->width, camera->height);
  uint8_t *planes[MASKS] = {block, block + pixels, block + 2 * pixels};
  for (int64_t i = 0; i < track_count; i++)
    draw_track(camera, &tracks[i], frame, planes);
  const int width = lens ? lens->width : camera->width, height = lens ? lens->height : camera->height;
  uint8_t *mapped = block + MASKS * pixels; /* a mask mapped from the pinhole picture to the photograph */
  for (int m = 0; m < MASKS; m++) {
    for (size_t i = 0; i < seen; i++)
      mapped[i] = lens->source[i] >= 0 ? planes[m][lens->source[i]] : 0;
    PAGS_TRY(pags_layout_put_mask(layout, mask_folders[m], frame, number, width, height, lens ? mapped : planes[m]));
  }
  return PAGS_OK;
}

pags_result pags_layout_put_dynamic_masks(const pags_layout *layout, int64_t frame, int number,
                                          const pags_camera *camera, const pags_layout_track *tracks,
                                          int64_t track_count) {
  return pags_layout_put_dynamic_masks_through(layout, frame, number, camera, NULL, tracks, track_count);
}
