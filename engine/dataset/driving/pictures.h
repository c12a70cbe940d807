/* SPDX-License-Identifier: Apache-2.0 */
/* The photographs of a driving set by the names of their files: images/TTT_C.jpg or .png. */
#ifndef PAGS_DATASET_DRIVING_PICTURES_H
#define PAGS_DATASET_DRIVING_PICTURES_H

#include <stdbool.h>

#include "base/file.h"

typedef struct pags_driving_picture {
  int frame, camera;
  int digits;       /* of the frame's number, leading zeros included */
  const char *name; /* file name, owned by the listing of the folder */
} pags_driving_picture;

/* Reads a decimal number and moves *at behind it; returns false if not found or if it is above 99999999. */
bool pags_driving_number(const char **at, int *out);

/* Parses the name of a picture like "012_3.jpg": frame 12, camera 3. */
bool pags_driving_parse_picture(const char *name, pags_driving_picture *out);

/* Lists the pictures among the files of a folder, sorted by frame, then by camera. The caller frees *out. */
pags_result pags_driving_pictures(const char *folder, const pags_dir_list *list, int64_t *count,
                                  pags_driving_picture **out);

/* Whether the sorted pictures have one of that frame and camera; -1 matches any. */
bool pags_driving_has_picture(const pags_driving_picture *pictures, int64_t count, int frame, int camera);

#endif
