/* SPDX-License-Identifier: Apache-2.0 */
/* The data set as a reader hands it to dataset.c: the content of the files, not yet compared with the pictures. */
#ifndef PAGS_DATASET_PARSED_H
#define PAGS_DATASET_PARSED_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/image.h>

#include "scene/lens.h"

/* The part of a data set that a view is stated to belong to. */
typedef enum pags_split {
  PAGS_SPLIT_NONE,
  PAGS_SPLIT_TRAIN,
  PAGS_SPLIT_TEST,    /* held out, for validation or test */
  PAGS_SPLIT_LEFT_OUT /* for neither */
} pags_split;

typedef struct pags_parsed_view {
  char *image_path;             /* path to open */
  char *mask_path;              /* NULL: none */
  char *where;                  /* file and line, e.g. "transforms.json:12"; begins messages about this view */
  bool missing;                 /* the image file, or the pose, does not exist */
  char *no_pose;                /* if the pose is missing: the file that ought to have it; NULL: the image is missing */
  bool sized;                   /* the size was read from the picture because the data set does not state it */
  const char *name;             /* end of image_path: the view's name, unique */
  pags_image_facts picture;     /* what the picture's header says; width 0: not read */
  int turn;                     /* the EXIF orientation by which the picture is turned; 0 and 1: as it is stored */
  pags_lens lens;               /* before pags_lens_prepare; not set if `missing` and the data set gives no size */
  double world_from_camera[12]; /* OpenCV axes */
  int64_t id;                   /* the id by which the tracks of points refer to this view */
  pags_split split;             /* as the data set states; NONE unless it has `split_by` */
  int64_t number;               /* place among all views in file-name order, missing ones included */
  /* Of driving sets only: */
  int sensor, frame;
  double time, shutter_time;                     /* seconds; shutter_time NaN where unknown */
  pags_shutter shutter;                          /* of the camera; all 0: global, or not known */
  char *sky_path, *semantic_path, *dynamic_path; /* NULL: none */
  char *part_path;                               /* dynamic mask of the critical kinds alone; NULL: none */
} pags_parsed_view;

typedef struct pags_parsed_point {
  int64_t id;    /* sort key of the points, so that the binary and the text form of a COLMAP model give one order */
  double xyz[3]; /* world coordinates before the origin is subtracted */
  uint8_t rgb[3];
  int64_t track_begin, track_count; /* range of its observers in `track` */
} pags_parsed_point;

typedef struct pags_parsed_points {
  int64_t count, capacity;
  pags_parsed_point *items;
  bool tracked; /* `track` lists the views that see each point */
  int64_t track_count, track_capacity;
  int64_t *track; /* ids of views (pags_parsed_view.id) */
  /* Points without a finite position, which are left out, and the id of the first; `dropped`: the last one added was
   * such a point. */
  int64_t left_out, first_left_out;
  bool dropped;
} pags_parsed_points;

typedef struct pags_parsed_dataset {
  const char *kind; /* a string constant */
  char *source;     /* the file or folder it was read from, for messages */
  pags_up up;
  const char *split_by; /* what states the split ("test_filenames"), a string constant; NULL: nothing does */
  int64_t count, capacity;
  pags_parsed_view *views;
  pags_parsed_points points;    /* count 0: the data set has none */
  struct pags_driving *driving; /* NULL: a static set */
} pags_parsed_dataset;

void pags_parsed_destroy(pags_parsed_dataset *parsed);
/* Frees what a view owns and zeroes it. */
void pags_parsed_view_destroy(pags_parsed_view *view);
/* Appends a zeroed view; returns NULL when out of memory. */
pags_parsed_view *pags_parsed_add(pags_parsed_dataset *parsed);
/* Appends a point without observers, unless a coordinate is not finite. */
pags_result pags_parsed_add_point(pags_parsed_points *points, int64_t id, const double xyz[3], const uint8_t rgb[3],
                                  const char *where);
/* Adds the view with id `view` to the observers of the last point. */
pags_result pags_parsed_observe(pags_parsed_points *points, int64_t view, const char *where);
/* Reports how many points were left out for want of a finite position; fails if all were. */
pags_result pags_parsed_check_points(const pags_parsed_points *points, const char *where);
void pags_parsed_sort_points(pags_parsed_points *points);

/* Reads a transforms.json of nerfstudio or instant-ngp or, with `splits`, the files transforms_train.json,
 * transforms_val.json and transforms_test.json of the folder `path` as one data set (the layout of the synthetic NeRF
 * scenes); the first must be there. The caller destroys the parsed set, also on failure; so with the other readers. */
pags_result pags_transforms_read(const char *path, bool splits, pags_parsed_dataset *parsed);
/* Reads the COLMAP model in folder `model` (cameras, images, points3D; .bin or .txt). The pictures are looked for in
 * folders around `root` and `model`. */
pags_result pags_colmap_read(const char *root, const char *model, pags_parsed_dataset *parsed);
bool pags_colmap_is_model(const char *folder);

/* Reads the vertices of a PLY file: x y z and, if present, red green blue. */
pags_result pags_ply_points_read(const char *path, pags_parsed_points *points);

/* Estimates the distance of the subject in metres: the median depth of the point nearest to all optical axes. When
 * the cameras have no common subject (they look ahead in parallel, or outward), the distance is 4 times the root mean
 * square distance of the camera centres from their mean; when that is zero, too (a single camera), the distance
 * is 1. */
pags_result pags_focus_distance(const pags_camera *const *cameras, int64_t count, double *out);

/* Maps `draw`, a uniform random number in [0, 1), to a depth: log-uniform between 0.45 and 4 times the distance of
 * the subject. */
double pags_focus_depth(double distance, double draw);

/* Whether `point` projects into the picture of the camera and its depth is at least `nearest` (metres). */
bool pags_camera_sees(const pags_camera *camera, const double point[3], double nearest);

#endif
