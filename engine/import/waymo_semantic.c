/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Waymo's panoptic labels to semantic masks and sky masks (waymo_semantic.h). */
#include "import/waymo_semantic.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>

#include <pags/image.h>

#include "base/file.h"
#include "base/memory.h"

enum { UNKNOWN = 255, SKY = 10 };

uint8_t pags_waymo_train_id(int waymo_class) {
  static const uint8_t ids[] = {UNKNOWN, UNKNOWN, 13,      14,      15,      14, 18,      17,      14,     11,
                                12,      12,      UNKNOWN, UNKNOWN, UNKNOWN, 5,  11,      7,       6,      2,
                                0,       0,       0,       1,       8,       10, UNKNOWN, UNKNOWN, UNKNOWN};
  return waymo_class >= 0 && waymo_class < (int)sizeof ids ? ids[waymo_class] : UNKNOWN;
}

static pags_result load_panoptic(const pags_layout *layout, int64_t frame, int camera, pags_image *image) {
  char name[64];
  snprintf(name, sizeof name, "panoptic/%03lld_%d.png", (long long)frame, camera);
  char *path = pags_path_join(layout->folder, name);
  if (!path)
    return pags_out_of_memory("%s", layout->folder);
  const pags_result result = pags_image_load(path, PAGS_U16, 1, image);
  free(path);
  return result;
}

static pags_result put_masks(const pags_layout *layout, const pags_image *panoptic, int divisor, int64_t frame,
                             int camera) {
  const size_t pixels = (size_t)panoptic->width * (size_t)panoptic->height;
  const uint16_t *labels = panoptic->data;
  uint8_t *plane = malloc(pixels);
  if (!plane)
    return pags_out_of_memory("%s: a mask", layout->folder);
  for (size_t i = 0; i < pixels; i++)
    plane[i] = pags_waymo_train_id(labels[i] / divisor);
  pags_result result =
      pags_layout_put_mask(layout, "semantic", frame, camera, panoptic->width, panoptic->height, plane);
  for (size_t i = 0; i < pixels; i++)
    plane[i] = plane[i] == SKY ? 255 : 0;
  if (result == PAGS_OK)
    result = pags_layout_put_mask(layout, "sky_masks", frame, camera, panoptic->width, panoptic->height, plane);
  free(plane);
  return result;
}

pags_result pags_waymo_put_semantic(const pags_layout *layout, const Pags__Waymo__CameraImage *image, int64_t frame,
                                    int camera, int width, int height, const char *where, int *labelled) {
  const Pags__Waymo__CameraSegmentationLabel *label = image->camera_segmentation_label;
  *labelled = label && label->panoptic_label.len;
  if (!*labelled || (pags_layout_has(layout, "semantic", frame, camera, ".png") &&
                     pags_layout_has(layout, "sky_masks", frame, camera, ".png")))
    return PAGS_OK;
  if (label->panoptic_label_divisor < 1)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: panoptic label of camera %d: divisor %d, expected at least 1", where,
                     camera, label->panoptic_label_divisor);
  PAGS_TRY(pags_layout_put_picture(layout, "panoptic", frame, camera, ".png", label->panoptic_label.data,
                                   label->panoptic_label.len));
  pags_image panoptic;
  PAGS_TRY(load_panoptic(layout, frame, camera, &panoptic));
  pags_result result = PAGS_OK;
  if (panoptic.width != width || panoptic.height != height)
    result = pags_fail(PAGS_ERROR_FORMAT, "%s: panoptic label of camera %d: %d x %d pixels, expected %d x %d", where,
                       camera, panoptic.width, panoptic.height, width, height);
  else
    result = put_masks(layout, &panoptic, label->panoptic_label_divisor, frame, camera);
  pags_image_destroy(&panoptic);
  return result;
}
