/* SPDX-License-Identifier: Apache-2.0 */
/* Masks of photographs: reading one, and the checks of all of a data set's. */
#ifndef PAGS_DATASET_PHOTO_MASK_H
#define PAGS_DATASET_PHOTO_MASK_H

#include <pags/dataset.h>
#include <pags/image.h>

#include "dataset/parsed.h"

/* How the values of a mask are read. */
typedef enum pags_mask_values {
  PAGS_MASK_BYTES, /* 128 of 255 and above, at the depth of the file: the pixel is used */
  PAGS_MASK_ONES,  /* no value is larger than 1, which means that the pixel is used */
  PAGS_MASK_NARROW /* bytes in a file of 16 bits: no value is larger than 255 */
} pags_mask_values;

typedef struct pags_mask_facts {
  pags_mask_values values;
  bool alpha; /* its alpha channel is the mask */
  bool blank; /* no pixel is used */
} pags_mask_facts;

/* Reads a mask: U8 of one channel, 255 where the pixel is used, else 0. `facts` may be NULL. */
pags_result pags_photo_mask_load(const char *path, pags_image *mask, pags_mask_facts *facts);

/* Brings a mask to the size of its photograph as it is stored or, with an orientation (2..8), as it is turned. Fails if
 * the sizes don't fit. */
pags_result pags_photo_mask_fit(const char *path, int width, int height, int turn, pags_image *mask);

/* Looks for the masks of a static set whose views have none: FOLDER/NAME.png, FOLDER/NAME.png.png and the like in the
 * folder masks next to the images. `root`: the data set's folder. Reports which photographs have none and which masks
 * no photograph. */
pags_result pags_photo_masks_find(const char *root, pags_parsed_dataset *parsed);

/* Compares the sizes of all masks with their photographs', and states how the masks that are looked at are read and
 * which of them leave no pixel. Those of a set in which no mask leaves any are dropped. */
pags_result pags_photo_masks_check(pags_parsed_dataset *parsed);

/* Writes what may leave out pixels of a view's photograph: "the ego mask of camera 1", if that leaves out all of them,
 * else every mask that the view has. Returns false if it has none but a mask file. */
bool pags_dataset_masks_of(const pags_dataset *dataset, int64_t view, char *text, size_t size);

#endif
