/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a driving data set in drivestudio's processed layout (docs/dataset-layout.md), for importers and `pags
 * synth`.
 *
 * Use: begin, any number of puts in any order, finish. An interrupted import can be continued: files are written
 * under a temporary name and renamed, so that a file that exists is complete, and a put of an existing
 * file of a frame does nothing. Begin writes the source and the options of the import to import.json; a folder that was
 * begun from another source, or that holds other files, is refused. dataset.json is written last, after the import's
 * account has been added to import.json as "result".
 *
 * Frames count from 0, whatever their numbers in the source are. Puts of different files may be called by several
 * threads at once. */
#ifndef PAGS_DATASET_DRIVING_WRITER_H
#define PAGS_DATASET_DRIVING_WRITER_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/object.h>
#include <pags/place.h>
#include <stdbool.h>

#include "dataset/driving/account.h"

enum { PAGS_LAYOUT_CAMERAS = 16 };

typedef struct pags_layout_camera {
  int number;                  /* number C in file names */
  const char *name;            /* e.g. "front_left" */
  const char *rolling_shutter; /* direction, e.g. "left_to_right", or "none"; NULL: unknown */
  int width, height;           /* px */
  double intrinsics[9];        /* fx fy cx cy in px, corners of the picture at 0 and width, height; k1 k2 p1 p2 k3 */
  pags_lens_model lens;        /* a lens that these can't say, all 0: none; k1 to k3 are then 0 */
} pags_layout_camera;

/* Times of a photograph in seconds on the clock of the frames, and the motion of the ego vehicle. Members that the
 * source doesn't have are NaN (see pags_layout_exposure_unknown). */
typedef struct pags_layout_exposure {
  double time;        /* middle of the exposure */
  double shutter;     /* exposure time of one row */
  double trigger;     /* trigger time of the camera */
  double readout;     /* end of the readout of the last row */
  double velocity[6]; /* of the ego vehicle at `time`: linear in m/s, world axes; angular in rad/s, ego axes */
  double pose_time;   /* time of `pose` and, if it is known, of `velocity` */
  double pose[12];    /* 3x4 ego-to-world near `time`, if it differs from the frame's ego_pose */
} pags_layout_exposure;

typedef struct pags_layout_info {
  const char *kind;   /* "kitti" or "waymo": the kind whose conventions the files follow */
  const char *source; /* path and options of the import, compared by means of import.json */
  double fps;
  pags_place place; /* position of the world's origin on the earth */
  int64_t frame_count;
  int64_t first_frame; /* number of frame 0 in the source */
  int camera_count;    /* <= PAGS_LAYOUT_CAMERAS */
  const pags_layout_camera *cameras;
  bool extrinsics_per_frame;  /* extrinsics/TTT_C.txt for each frame TTT of camera C, instead of extrinsics/C.txt */
  bool extrinsics_from_world; /* with extrinsics_per_frame: extrinsics are camera-to-world, not camera-to-ego */
  const char *const *lidar_columns; /* names ended by NULL, e.g. "x", "y", "z", "reflectance"; NULL: no LiDAR */
} pags_layout_info;

/* A labelled object; the frames of its keyframes are those of the layout. `sizes` has 3 numbers per keyframe, or is
 * NULL if every keyframe has object.size. */
typedef struct pags_layout_track {
  pags_object object;
  double *sizes;
} pags_layout_track;

/* The times of all frames; finish writes them. */
typedef struct pags_layout_times {
  const double *frames;                  /* seconds, one per frame */
  const pags_layout_exposure *exposures; /* [frame * camera_count + camera]; NULL: all unknown */
  const double *lidar;                   /* begin and end of each sweep, 2 per frame; NULL: unknown */
} pags_layout_times;

typedef struct pags_layout {
  char *folder;
  const pags_layout_info *info; /* owned by the caller; must outlive the layout */
  struct pags_lock *lock;
} pags_layout;

pags_layout_exposure pags_layout_exposure_unknown(void);
void pags_layout_track_destroy(pags_layout_track *track);

/* Creates and locks the folder and begins or continues an import. `overwrite`: first removes the files and folders of
 * this layout (images, lidar, ..., dataset.json), unless they are unfinished work of the same import. Files with other
 * names are left alone. */
pags_result pags_layout_begin(pags_layout *layout, const char *folder, const pags_layout_info *info, bool overwrite);
void pags_layout_destroy(pags_layout *layout); /* a zeroed layout is allowed */

/* Creates the parent folder of a file, so that each folder appears together with its first file. */
pags_result pags_layout_make_folder(const char *path);

/* Whether `folder`/TTT_C.extension exists, so that a caller can skip an expensive computation. camera -1:
 * TTT.extension; frame -1: C.extension. extension NULL: any of .png .jpg .jpeg. Here and below, `camera` is the
 * camera's number in file names. */
bool pags_layout_has(const pags_layout *layout, const char *folder, int64_t frame, int camera, const char *extension);
/* Whether the data set is finished, that is whether dataset.json exists. */
bool pags_layout_is_finished(const pags_layout *layout);

/* Writes `folder`/TTT_C.extension, such as images/012_0.jpg from the bytes of an encoded picture; `extension` includes
 * its dot. */
pags_result pags_layout_put_file(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                                 const char *extension, const void *bytes, size_t size);
/* Copies a picture file to images/TTT_C with the extension of `path`. */
pags_result pags_layout_copy_image(const pags_layout *layout, int64_t frame, int camera, const char *path);
/* Writes ego_pose/TTT.txt; poses and extrinsics are 3x4 row-major and are written as 4x4. */
pags_result pags_layout_put_ego_pose(const pags_layout *layout, int64_t frame, const double world_from_ego[12]);
/* Writes the extrinsics of a camera with OpenCV axes: camera-to-ego, or camera-to-world if
 * info->extrinsics_from_world. `frame` is a frame if info->extrinsics_per_frame. Frame -1 writes the constant
 * camera-to-ego extrinsics C.txt, which a set with extrinsics per frame may have in addition. */
pags_result pags_layout_put_extrinsics(const pags_layout *layout, int64_t frame, int camera, const double m[12]);
/* Writes lidar/TTT.bin; each row has one float per column named by info->lidar_columns. */
pags_result pags_layout_put_lidar(const pags_layout *layout, int64_t frame, int64_t rows, const float *values);
/* Writes a mask `folder`/TTT_C.png, 8-bit grey, from width * height bytes. "sky_masks": 255 = sky; "semantic":
 * Cityscapes train ids, 255 = unknown. */
pags_result pags_layout_put_mask(const pags_layout *layout, const char *folder, int64_t frame, int camera, int width,
                                 int height, const uint8_t *pixels);
/* Writes dynamic_masks/{all,vehicle,human}/TTT_C.png: 255 inside the box outlines of moving objects, occluded or not.
 * human: pedestrians and cyclists; all: every class. `camera` has the pose of the photograph; `number` is the number
 * of the camera in file names. */
pags_result pags_layout_put_dynamic_masks(const pags_layout *layout, int64_t frame, int number,
                                          const pags_camera *camera, const pags_layout_track *tracks,
                                          int64_t track_count);
/* Maps a photograph with lens distortion to a pinhole camera: pixel i of the photograph (width x height) shows pixel
 * source[i] of the pinhole picture (row-major); -1: no pixel of it. */
typedef struct pags_layout_lens {
  int width, height;
  const int32_t *source;
} pags_layout_lens;
/* Writes the dynamic masks of a photograph with lens distortion: they are drawn for the pinhole `camera` and mapped
 * through `lens`. `lens` NULL: the photograph is the pinhole picture. */
pags_result pags_layout_put_dynamic_masks_through(const pags_layout *layout, int64_t frame, int number,
                                                  const pags_camera *camera, const pags_layout_lens *lens,
                                                  const pags_layout_track *tracks, int64_t track_count);
/* Writes instances/instances_info.json and instances/frame_instances.json. */
pags_result pags_layout_put_instances(const pags_layout *layout, const pags_layout_track *tracks, int64_t count);

/* Counts what was written, with the tracks that are given, and adds the account to import.json. */
pags_result pags_layout_put_account(const pags_layout *layout, const pags_account *account,
                                    const pags_layout_track *tracks, int64_t track_count);
/* Writes intrinsics/C.txt, timestamps.json and, last, dataset.json. */
pags_result pags_layout_finish(const pags_layout *layout, const pags_layout_times *times);

/* ---- Single files about the whole set, at any path, for `pags synth`, which makes its folders itself ---- */

/* Writes instances_info.json; the keys of the tracks are 0, 1, ... */
pags_result pags_layout_write_instances(const char *path, const pags_layout_track *tracks, int64_t count);
/* Writes frame_instances.json: for each frame, the tracks that have a keyframe there. */
pags_result pags_layout_write_frame_instances(const char *path, const pags_layout_track *tracks, int64_t count,
                                              int64_t frame_count);
/* Writes timestamps.json; a member of the exposures is written if any exposure has it. */
pags_result pags_layout_write_times(const char *path, const pags_layout_info *info, const pags_layout_times *times);
/* Writes dataset.json, `indent` spaces per level; without source and first_frame if info->source is NULL. */
pags_result pags_layout_write_description(const char *path, const pags_layout_info *info, int indent);

#endif
