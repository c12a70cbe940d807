/* SPDX-License-Identifier: Apache-2.0 */
/* What a reader hands to dataset.c: the file's own words, nothing checked against the pictures yet. */
#ifndef PAGS_DATASET_PARSED_H
#define PAGS_DATASET_PARSED_H

#include <stdbool.h>

#include <pags/dataset.h>

#include "dataset/lens.h"

typedef struct pags_parsed_view {
  char *image_path;             /* as it would be opened */
  char *mask_path;              /* NULL: none */
  char *where;                  /* "transforms.json:12": begins messages about this view */
  bool missing;                 /* no such image */
  bool sized;                   /* width and height were taken from the picture, not from the file */
  pags_lens lens;               /* not prepared; not filled in where `missing` and the file gives no size */
  double world_from_camera[12]; /* OpenCV axes */
  int64_t id;                   /* by which tracks name it */
  /* Driving sets */
  int sensor, frame;
  double time, shutter_time;                     /* seconds; shutter_time NaN where unknown */
  char *sky_path, *semantic_path, *dynamic_path; /* NULL: none */
  char *part_path;                               /* the dynamic mask of what is critical alone; NULL: none */
} pags_parsed_view;

typedef struct pags_parsed_point {
  int64_t id;    /* points are sorted by it, so that both forms of a COLMAP model give the same order */
  double xyz[3]; /* absolute */
  uint8_t rgb[3];
  int64_t track_begin, track_count; /* in `track` */
} pags_parsed_point;

typedef struct pags_parsed_points {
  int64_t count, capacity;
  pags_parsed_point *items;
  bool tracked; /* it is known which views see a point */
  int64_t track_count, track_capacity;
  int64_t *track; /* ids of views */
} pags_parsed_points;

typedef struct pags_parsed_dataset {
  const char *kind; /* static */
  char *source;     /* the file or folder it was read from, for messages */
  pags_up up;
  int64_t count, capacity;
  pags_parsed_view *views;
  pags_parsed_points points;    /* count 0: the data set has none */
  struct pags_driving *driving; /* NULL: a static set */
} pags_parsed_dataset;

void pags_parsed_destroy(pags_parsed_dataset *parsed);
/* A zeroed view at the end; NULL when memory is out. */
pags_parsed_view *pags_parsed_add(pags_parsed_dataset *parsed);
/* A point at the end, without observers yet; fails where a coordinate is not finite. */
pags_result pags_parsed_add_point(pags_parsed_points *points, int64_t id, const double xyz[3], const uint8_t rgb[3],
                                  const char *where);
/* One more observer of the last point. */
pags_result pags_parsed_observe(pags_parsed_points *points, int64_t view, const char *where);
void pags_parsed_sort_points(pags_parsed_points *points);

/* A file of nerfstudio's or instant-ngp's. Both readers leave an empty parsed set on failure. */
pags_result pags_transforms_read(const char *path, pags_parsed_dataset *parsed);
/* `model` holds cameras/images/points3D (.bin or .txt); pictures are looked for around `root` and `model`. */
pags_result pags_colmap_read(const char *root, const char *model, pags_parsed_dataset *parsed);
bool pags_colmap_is_model(const char *folder);

/* Vertices of a PLY file with x y z and, where it has them, red green blue. */
pags_result pags_ply_points_read(const char *path, pags_parsed_points *points);

/* Random points in what the cameras see together; xyz is relative to `origin`. See random_points.c. */
pags_result pags_random_points(const pags_camera *const *cameras, int64_t camera_count, const double origin[3],
                               uint64_t seed, int64_t count, float *xyz, uint8_t *rgb);

#endif
