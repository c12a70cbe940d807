/* SPDX-License-Identifier: Apache-2.0 */
/* The part of a parsed data set that only driving sets have: camera rig, time steps, objects, sweeps. NULL in a
 * static set. */
#ifndef PAGS_DATASET_DRIVING_DRIVING_SET_H
#define PAGS_DATASET_DRIVING_DRIVING_SET_H

#include <stdbool.h>

#include <pags/image.h>

#include "dataset/driving/label_sets.h"
#include "dataset/parsed.h"

/* Conventions that drivestudio's layout does not fix; they come from the defaults of the set's kind and from
 * dataset.json (rules.c). */
typedef struct pags_rules {
  const char *kind; /* a string constant */
  bool waymo_axes;  /* camera axes: Waymo's (x forward, y left, z up); else OpenCV's (x right, y down, z forward) */
  bool per_frame;   /* extrinsics/TTT_C.txt, camera-to-world; else extrinsics/C.txt, camera-to-ego, constant */
  bool lidar_frame; /* sweeps are in the LiDAR's frame, with poses lidar_pose/TTT.txt; else in the ego frame */
  bool lidar_world; /* sweeps are in the world's frame */
  bool forward_y;   /* the front of a box is its +y side; else +x */
  int columns;      /* float32 values per point of a sweep; 0: not stated */
  int position[3];  /* column indices of x, y, z */
  int intensity;    /* column index of the intensity; -1: none */
  double fps;       /* time steps per second; 0: not stated */
  const pags_label_set *labels; /* class ids of the label images */
  pags_place place;
} pags_rules;

/* A camera of the rig. */
typedef struct pags_sensor {
  int number;
  char *name;
  pags_lens lens;             /* width and height are not set */
  bool lens_stated;           /* dataset.json states what lens it is, not the count of numbers in its intrinsics */
  double ego_from_camera[12]; /* OpenCV axes; only with constant extrinsics */
  pags_image ego;   /* one channel, size of the photographs, 255 where the ego vehicle is seen; data NULL: none */
  bool ego_of_ones; /* the file of `ego` has 1 in place of 255 */
} pags_sensor;

typedef struct pags_time_step {
  int frame;
  bool test;
  double time;
  double eye[3]; /* where its first camera with a pose stands, in the world; NaN: no camera has one */
} pags_time_step;

/* Whether an object's box marks critical pixels: never; only in views without label images, which are more precise
 * than boxes; in every view. */
enum { PAGS_CRITICAL_NOT, PAGS_CRITICAL_WITHOUT_LABELS, PAGS_CRITICAL_ALWAYS };

/* Which labels are critical (critical.c). */
typedef struct pags_critical {
  char *list;           /* options.critical; NULL: vehicles, pedestrians and cyclists */
  uint8_t classes[256]; /* bits PAGS_LABEL_* by class id of label images; PAGS_LABEL_MOVING: class can move */
  uint8_t *objects;     /* PAGS_CRITICAL_* of each object */
  bool kinds[4];        /* by pags_category: whether some class of that category is critical */
  bool all_dynamic;     /* all pixels of dynamic_masks/all are critical; else those of the views' part_path */
} pags_critical;

typedef struct pags_driving {
  char *root;
  pags_rules rules;
  int digits; /* number of digits of a frame number in file names */
  /* Folders of the masks: sky_masks and dynamic_masks/all or, where these aren't there, sky_mask and dynamic_mask, as
   * Street Gaussians' converter names them. String constants. */
  const char *sky_folder, *dynamic_folder;
  bool poses_leap;     /* some poses follow each other as those of no car do */
  bool street_tracks;  /* the objects are those of Street Gaussians' track/track_info.txt */
  bool exposure_poses; /* views have ego_pose/TTT_C.txt, the car's pose at the exposure, in place of ego_pose/TTT.txt */
  int provides;
  double fps;
  int64_t sensor_count, sensor_capacity;
  pags_sensor *sensors; /* in ascending order of their numbers */
  int holdout;          /* number of the held-out camera, -1: none */
  int64_t step_count;
  pags_time_step *steps; /* in ascending order of frame and time */
  int64_t object_count;
  pags_object *objects;
  pags_critical critical;
  int64_t sweep_count;
  pags_sweep *sweeps; /* each sweep owns its `path` */
  int64_t note_count, note_capacity;
  char **notes;
} pags_driving;

void pags_driving_destroy(pags_driving *driving); /* `driving` may be NULL */

/* Returns the index of the time step with this frame number; -1 if it is not used. */
int64_t pags_driving_step(const pags_driving *driving, int64_t frame);
/* Whether an object has a box at this frame. */
bool pags_driving_has_boxes(const pags_driving *driving, int frame);
pags_sensor *pags_driving_sensor(const pags_driving *driving, int number); /* NULL if the camera is not used */

/* Adds a line that states how the set was read; `pags info` and `pags train` print it. */
pags_result pags_driving_note(pags_driving *driving, const char *format, ...) PAGS_PRINTF(2, 3);

#endif
