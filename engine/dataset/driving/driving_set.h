/* SPDX-License-Identifier: Apache-2.0 */
/* What a driving set has beyond posed photographs. It belongs to a parsed data set and is NULL in a static one. */
#ifndef PAGS_DATASET_DRIVING_DRIVING_SET_H
#define PAGS_DATASET_DRIVING_DRIVING_SET_H

#include <stdbool.h>

#include <pags/image.h>

#include "dataset/driving/label_sets.h"
#include "dataset/parsed.h"

/* What drivestudio's layout leaves open: the kind's defaults and what dataset.json says (rules.c). */
typedef struct pags_rules {
  const char *kind;             /* static */
  bool waymo_axes;              /* cameras x forward, y left, z up; else OpenCV's */
  bool per_frame;               /* extrinsics/TTT_C.txt, camera-to-world; else extrinsics/C.txt, camera-to-ego */
  bool lidar_frame;             /* sweeps in the LiDAR's frame, posed by lidar_pose/TTT.txt; else in the ego frame */
  bool forward_y;               /* boxes' front is their +y; else +x */
  int columns;                  /* floats a row of a sweep; 0: not stated */
  int position[3];              /* which of them are x, y, z */
  double fps;                   /* 0: not stated */
  const pags_label_set *labels; /* what label images hold */
  pags_place place;
} pags_rules;

/* One camera of the rig. */
typedef struct pags_sensor {
  int number;
  char *name;
  pags_lens lens;             /* without width and height */
  double ego_from_camera[12]; /* OpenCV axes; constant extrinsics only */
  pags_image ego; /* one channel, of the photographs' size, 255 where the recording car is seen; data NULL: nowhere */
} pags_sensor;

typedef struct pags_time_step {
  int frame;
  bool test;
  double time;
} pags_time_step;

/* Whether a box is critical: no; in views without label images, which know better; in all. */
enum { PAGS_CRITICAL_NOT, PAGS_CRITICAL_WITHOUT_LABELS, PAGS_CRITICAL_ALWAYS };

/* What counts as critical (critical.c). */
typedef struct pags_critical {
  char *list;           /* as asked for; NULL: vehicles, pedestrians and cyclists */
  uint8_t classes[256]; /* of label images: PAGS_LABEL_SKY, PAGS_LABEL_CRITICAL, PAGS_LABEL_MOVING = what could move */
  uint8_t *objects;     /* PAGS_CRITICAL_*, by object */
  bool kinds[4];        /* by category: some of it is critical */
  bool all_dynamic;     /* dynamic_masks/all is critical; else the views' part_path */
} pags_critical;

typedef struct pags_driving {
  char *root;
  pags_rules rules;
  int digits; /* of frame numbers in file names */
  int provides;
  double fps;
  int64_t sensor_count;
  pags_sensor *sensors; /* ascending numbers */
  int holdout;          /* sensor held out, -1: none */
  int64_t step_count;
  pags_time_step *steps; /* ascending frames and times */
  int64_t object_count;
  pags_object *objects;
  pags_critical critical;
  int64_t sweep_count;
  pags_sweep *sweeps; /* `path` owned */
  int64_t note_count;
  char **notes;
} pags_driving;

void pags_driving_destroy(pags_driving *driving); /* NULL is allowed */

/* Index of the time step, -1: not among those used. */
int64_t pags_driving_step(const pags_driving *driving, int64_t frame);
pags_sensor *pags_driving_sensor(const pags_driving *driving, int number); /* NULL: not used */

/* Adds a line that says how the set was read, for `pags info` and `pags train`. */
pags_result pags_driving_note(pags_driving *driving, const char *format, ...) PAGS_PRINTF(2, 3);

#endif
