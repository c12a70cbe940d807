/* The photographs that a scene is to be compared with, brought to what the scene was trained on. */
#ifndef PAGS_CLI_TRUTH_H
#define PAGS_CLI_TRUTH_H

#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/scene.h>
#include <stdbool.h>

typedef struct pags_truth_view {
  int64_t index; /* of the view in the data set */
  int test;
} pags_truth_view;

typedef struct pags_truth {
  pags_dataset *dataset;
  pags_photo_cache *photos;
  int64_t count;
  pags_truth_view *views; /* in the data set's order */
} pags_truth;

/* Opens the data set `path`. A scene that records its views decides by them: the downscale (from the focal lengths),
 * which views count and which of them were held out; a view whose photograph is gone, or whose pose differs, is an
 * error. A scene without views (a bare splat file) leaves all that to `options`. */
pags_result pags_truth_open(const pags_scene *scene, const char *path, const pags_dataset_options *options,
                            pags_tasks *tasks, uint64_t image_cache, pags_truth *out);
void pags_truth_close(pags_truth *truth);

/* The photograph of views[i] as F32 RGB in [0, 1], and its mask, one byte a pixel (NULL: every pixel counts). The
 * caller destroys the image and frees the mask. */
pags_result pags_truth_photograph(pags_truth *truth, int64_t i, pags_image *image, uint8_t **mask);

#endif
