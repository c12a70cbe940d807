/* SPDX-License-Identifier: Apache-2.0 */
/* What a driving set has beyond posed photographs. Belongs to the draft of a data set; NULL in a static one. */
#ifndef PAGS_DATASET_DRIVING_READER_H
#define PAGS_DATASET_DRIVING_READER_H

#include <stdbool.h>

#include <pags/image.h>

#include "dataset/driving/label_sets.h"
#include "dataset/parsed.h"

/* What drivestudio's layout leaves open: the kind's defaults and what dataset.json says (rules.c). */
typedef struct pags_rules {
  const char *kind;             /* static */
  bool waymo_axes;              /* cameras x forward, y left, z up; else OpenCV's */
  bool per_frame;               /* extrinsics/TTT_C.txt, camera-to-world; else extrinsics/C.txt, camera-to-ego */
  bool laser_frame;             /* sweeps in the laser's frame, posed by lidar_pose/TTT.txt; else in the ego frame */
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

/* A folder that has what only this layout has: dataset.json, or images with ego_pose or extrinsics. */
bool pags_driving_is_set(const char *folder);
/* Leaves an empty draft on failure. */
pags_result pags_driving_read(const char *folder, const pags_dataset_options *options, pags_parsed_dataset *draft);

/* `kind` as asked for, NULL: as dataset.json says. `per_frame_files`: there are extrinsics named TTT_C, which settles
 * the kind where neither says it. Names of cameras, as far as dataset.json has them, go to `names(context, number,
 * name)`. */
typedef pags_result pags_camera_name_fn(void *context, int number, const char *name);
pags_result pags_rules_read(const char *root, const char *kind, bool per_frame_files, pags_rules *rules,
                            pags_camera_name_fn *name, void *context);

/* timestamps.json, or t / fps. Fills in the steps' times and driving->fps. */
pags_result pags_times_read(pags_driving *driving, pags_parsed_dataset *draft);
/* instances/: objects with their knots at the steps. */
pags_result pags_tracks_read(pags_driving *driving);
/* lidar/: the sweeps of the steps. */
pags_result pags_sweeps_find(pags_driving *driving);
pags_result pags_sweep_read(const pags_driving *driving, int64_t index, int64_t *count, float **xyz);

/* The points of a COLMAP model in the same world are added to the draft's. */
pags_result pags_sfm_points_read(const char *model, pags_parsed_dataset *draft);

/* Index of the time step, -1: not among those used. */
int64_t pags_driving_step(const pags_driving *driving, int64_t frame);
pags_sensor *pags_driving_sensor(const pags_driving *driving, int number); /* NULL: not used */

/* FOLDER/TTT_C.png of a view where it exists, else NULL. */
pags_result pags_driving_find_mask(const pags_driving *driving, const char *folder, const pags_parsed_view *view,
                                   char **out);

pags_result pags_driving_note(pags_driving *driving, const char *format, ...) PAGS_PRINTF(2, 3);

/* All numbers of a text file, separated by blanks, line breaks or commas; at most `capacity`. */
pags_result pags_text_matrix_read(const char *path, int capacity, double *out, int *count);
/* A rigid motion as 4x4 or 3x4 numbers. */
pags_result pags_text_pose_read(const char *path, double out[12]);

#endif
