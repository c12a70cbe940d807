/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a driving data set in drivestudio's processed layout (docs/dataset-layout.md), for importers and `pags synth`.
 *
 * Begin, any number of puts in any order, finish. A file that exists is complete, because files are written beside
 * and renamed: puts of such files do nothing, so that an import that was stopped goes on where it was. What the
 * folder was begun from stands in import.json, and a folder begun from something else, or that holds anything else,
 * is refused. dataset.json comes last.
 *
 * Frames count from 0 whatever their numbers in the source. Puts may be called by several threads at once for
 * different files. */
#ifndef PAGS_DATASET_DRIVING_WRITER_H
#define PAGS_DATASET_DRIVING_WRITER_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/object.h>
#include <pags/place.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_LAYOUT_CAMERAS = 16 };

typedef struct pags_layout_camera {
  int number;                  /* C of the file names */
  const char *name;            /* "front_left" */
  const char *rolling_shutter; /* "left_to_right", "none", ...; NULL: unknown */
  int width, height;           /* px */
  double intrinsics[9];        /* fx fy cx cy, px, corners of the picture at 0 and width, height; k1 k2 p1 p2 k3 */
} pags_layout_camera;

/* When a photograph was taken; NaN (see pags_layout_exposure_unknown) where the source doesn't say. Seconds, on the
 * frames' clock. */
typedef struct pags_layout_exposure {
  double time;        /* of the exposure: its middle */
  double shutter;     /* duration of one row's exposure */
  double trigger;     /* the camera was told to */
  double readout;     /* the last row was read */
  double velocity[6]; /* of the recording car at `time`: linear m/s, in the world; angular rad/s, in the ego frame */
  double pose_time;   /* of `pose` (and, where it is known, of `velocity`) */
  double pose[12]; /* 3x4 ego-to-world of the recording car near `time`, where it differs from the frame's ego_pose */
} pags_layout_exposure;

typedef struct pags_layout_info {
  const char *kind; /* "kitti", "waymo": whose rules the files follow */
  const char *
      source; /* path of what is imported, with everything that chooses what becomes of it: told apart by import.json */
  double fps;
  pags_place place; /* of the world's zero */
  int64_t frame_count;
  int64_t first_frame; /* number of frame 0 in the source */
  int camera_count;    /* <= PAGS_LAYOUT_CAMERAS */
  const pags_layout_camera *cameras;
  bool extrinsics_per_frame;        /* TTT_C.txt instead of C.txt */
  bool extrinsics_from_world;       /* with extrinsics_per_frame: they are camera-to-world, not camera-to-ego */
  const char *const *lidar_columns; /* "x", "y", "z", "reflectance", NULL; NULL: there is no LiDAR */
} pags_layout_info;

/* A labelled object; its knots' frames are those of the layout. `sizes` has 3 numbers a knot: NULL where the size is
 * object.size. */
typedef struct pags_layout_track {
  pags_object object;
  double *sizes;
} pags_layout_track;

/* What needs all frames: written by finish. */
typedef struct pags_layout_times {
  const double *frames;                  /* seconds, of each frame */
  const pags_layout_exposure *exposures; /* [frame * camera_count + camera]; NULL: nothing is known */
  const double *lidar;                   /* begin and end of each sweep, 2 a frame; NULL: unknown */
} pags_layout_times;

typedef struct pags_layout {
  char *folder;
  const pags_layout_info *info; /* the caller's, must outlive the layout */
} pags_layout;

pags_layout_exposure pags_layout_exposure_unknown(void);
void pags_layout_track_destroy(pags_layout_track *track);

/* Makes the folder. `overwrite`: first removes what the folder has of this layout's names (images, lidar, ...
 * dataset.json), unless it is unfinished work begun from this same source. Other files are left alone. */
pags_result pags_layout_begin(pags_layout *layout, const char *folder, const pags_layout_info *info, bool overwrite);
void pags_layout_destroy(pags_layout *layout); /* frees; a zeroed one is allowed */

/* Makes the folder that a file of this path lies in, so that folders appear with their first file. */
pags_result pags_layout_make_folder(const char *path);

/* Whether `folder`/TTT_C.extension is there: what costs much to make need not be made. camera -1: TTT.extension;
 * frame -1: C.extension. extension NULL: any of .png .jpg .jpeg. `camera` is the number in file names here and
 * below. */
bool pags_layout_has(const pags_layout *layout, const char *folder, int64_t frame, int camera, const char *extension);
/* Whether the finished data set is there. */
bool pags_layout_is_finished(const pags_layout *layout);

/* images/TTT_C.extension, the bytes as they are; extension with its dot. */
pags_result pags_layout_put_image(const pags_layout *layout, int64_t frame, int camera, const char *extension,
                                  const void *bytes, size_t size);
/* `folder`/TTT_C.extension, any other picture, the bytes as they are. */
pags_result pags_layout_put_picture(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                                    const char *extension, const void *bytes, size_t size);
/* The same as put_image of a file, whose extension it keeps. */
pags_result pags_layout_copy_image(const pags_layout *layout, int64_t frame, int camera, const char *path);
/* Poses and extrinsics: 3x4 row-major, written as 4x4. */
pags_result pags_layout_put_ego_pose(const pags_layout *layout, int64_t frame, const double world_from_ego[12]);
/* Camera to ego (or to the world, as info says), OpenCV camera axes, for a frame if info says per frame. Frame -1: the
 * constant camera-to-ego C.txt, which sets with extrinsics per frame may have beside them. */
pags_result pags_layout_put_extrinsics(const pags_layout *layout, int64_t frame, int camera, const double m[12]);
/* lidar/TTT.bin: rows of as many floats as info names columns. */
pags_result pags_layout_put_lidar(const pags_layout *layout, int64_t frame, int64_t rows, const float *values);
/* `folder`/TTT_C.png (TTT the frame, C the camera), 8-bit grey; "sky_masks": 255 = sky; "semantic": Cityscapes train
 * ids, 255 = unknown. */
pags_result pags_layout_put_mask(const pags_layout *layout, const char *folder, int64_t frame, int camera, int width,
                                 int height, const uint8_t *pixels);
/* dynamic_masks/{all,vehicle,human}/TTT_C.png: 255 in the outlines of the boxes of objects that move, whether hidden
 * or not. human: pedestrians and cyclists; all: every class. `camera` has the pose of the photograph; info's camera
 * is found by `number`. */
pags_result pags_layout_put_dynamic_masks(const pags_layout *layout, int64_t frame, int number,
                                          const pags_camera *camera, const pags_layout_track *tracks,
                                          int64_t track_count);
/* How a photograph with lens distortion sees a pinhole camera: its pixel i, of width x height, shows the pinhole's
 * pixel source[i] (row-major), -1: none of them. */
typedef struct pags_layout_lens {
  int width, height;
  const int32_t *source;
} pags_layout_lens;
/* The same for such a photograph; `camera` is the pinhole. NULL lens: the photograph is the pinhole's. */
pags_result pags_layout_put_dynamic_masks_through(const pags_layout *layout, int64_t frame, int number,
                                                  const pags_camera *camera, const pags_layout_lens *lens,
                                                  const pags_layout_track *tracks, int64_t track_count);
/* instances/{instances_info,frame_instances}.json. */
pags_result pags_layout_put_instances(const pags_layout *layout, const pags_layout_track *tracks, int64_t count);

/* intrinsics/C.txt, timestamps.json and then dataset.json. */
pags_result pags_layout_finish(const pags_layout *layout, const pags_layout_times *times);

/* ---- The files about the whole, each at a path of its own: for `pags synth`, which makes its folders itself ---- */

/* instances_info.json: the tracks' keys are 0, 1, ... */
pags_result pags_layout_write_instances(const char *path, const pags_layout_track *tracks, int64_t count);
/* frame_instances.json: the tracks that have a knot at a frame. */
pags_result pags_layout_write_frame_instances(const char *path, const pags_layout_track *tracks, int64_t count,
                                              int64_t frame_count);
/* timestamps.json; of the exposures what is known of any. */
pags_result pags_layout_write_times(const char *path, const pags_layout_info *info, const pags_layout_times *times);
/* dataset.json, `indent` spaces a level; without source and first_frame where info->source is NULL. */
pags_result pags_layout_write_description(const char *path, const pags_layout_info *info, int indent);

#ifdef __cplusplus
}
#endif
#endif
