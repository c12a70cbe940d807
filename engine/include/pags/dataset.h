/* SPDX-License-Identifier: Apache-2.0 */
/* A set of posed photographs, read from transforms.json (nerfstudio, instant-ngp), a COLMAP model or a driving set in
 * drivestudio's processed layout with its boxes, masks and LiDAR (docs/dataset-layout.md).
 *
 * What a view's camera and image have been brought to: pinhole, undistorted, downscaled. */
#ifndef PAGS_DATASET_H
#define PAGS_DATASET_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/object.h>
#include <pags/place.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_dataset_options {
  const char *colmap; /* model folder to use in place of transforms.json; NULL: choose (transforms.json wins) */
  double downscale;   /* >= 1; 1 = full size */
  int split_every;    /* held out. Static: every Nth view in file-name order (index % N == 0); driving: all cameras of
                         every time step t > 0 with t % N == 0. 0: none; -1 (default): 8 for static sets, 4 for driving
                         ones */
  int allow_missing;  /* 1: leave out views whose image is missing (reported by log), 0: an error */
  uint64_t seed;      /* of random points where the data set has none */
  int64_t random_points; /* how many then; default 10000 */
  /* Driving sets only */
  const char *kind;    /* waymo, pandaset, kitti, nuscenes, argoverse2, nuplan; NULL: as dataset.json says */
  const char *cameras; /* numbers separated by commas; NULL: all there are */
  int64_t frame_first, frame_last; /* time steps used, both included; frame_last -1 (default): to the end */
  const char *holdout_camera;      /* number of a camera all of whose views are held out; NULL: none */
  const char *ego_mask; /* picture, or folder of C.png, white where the recording car is seen; NULL: ego_masks/C.png,
                           else a detector of pixels that never change */
  const char *critical; /* what is critical: kinds, classes of the label images by name or number, classes of boxes,
                           separated by commas (docs/masks.md); NULL: vehicles, pedestrians and cyclists */
  const char *sfm;      /* folder of a COLMAP model in the same world: points to add; NULL: none */
} pags_dataset_options;

PAGS_API pags_dataset_options pags_dataset_options_default(void);

typedef struct pags_view {
  const char *name;       /* file name without folders, unique */
  const char *image_path; /* as opened */
  const char *mask_path;  /* NULL: none. White (>= 128) = use the pixel */
  pags_camera camera;     /* undistorted, downscaled */
  int test;               /* 1: held out */
  int sensor;             /* number of the camera as the files name it; -1: a static set */
  int frame; /* time step as the files name it; -1: a static set. camera.time is this step's time, which boxes fit as
                they stand; NaN in a static set */
  double shutter_time; /* when the exposure was, seconds, where the set knows; NaN else. Never used to move boxes */
} pags_view;

/* What the rows of a photograph's label plane consist of. */
enum {
  PAGS_LABEL_SKY = 1,      /* from sky_masks, else semantic, else above the horizon without LiDAR returns */
  PAGS_LABEL_CRITICAL = 2, /* vehicle, pedestrian or cyclist, or what options.critical says: of semantic's classes or in
                              dynamic_masks/all; without semantic in a box of theirs, too */
  PAGS_LABEL_MOVING = 4,   /* in dynamic_masks/all, else in the box of a moving object */
  PAGS_LABEL_VEHICLE = 8,  /* in the box of a moving vehicle */
  PAGS_LABEL_PEDESTRIAN = 16, /* in the box of a moving pedestrian */
  PAGS_LABEL_CYCLIST = 32,    /* in the box of a moving cyclist */
  PAGS_LABEL_PARKED = 64      /* in the box of an object that doesn't move */
};

/* What a data set brings besides photographs: bits for pags_dataset_provides. */
enum {
  PAGS_PROVIDES_BOXES = 1,
  PAGS_PROVIDES_LIDAR = 2,
  PAGS_PROVIDES_SKY_MASKS = 4, /* files in sky_masks/, or semantic labels that have a class sky */
  PAGS_PROVIDES_SEMANTIC = 8,
  PAGS_PROVIDES_DYNAMIC_MASKS = 16,
  PAGS_PROVIDES_SFM = 32
};

/* One turn of the LiDAR. Points are in the sweep's own frame, corrected for the motion of the car. */
typedef struct pags_sweep {
  int frame;
  int test;    /* 1: of a held-out time step: not for training */
  double time; /* of the time step, seconds */
  const char *path;
  double world_from_sweep[12]; /* absolute */
} pags_sweep;

typedef struct pags_dataset pags_dataset;

/* `path`: a folder with transforms.json, or a transforms file itself, or a driving set (dataset.json, or images with
 * ego_pose or extrinsics), or a folder with a COLMAP model (., sparse/0, sparse, colmap/sparse/0) and images. Reads
 * every header, decodes no picture but checks that each exists and that its size fits its camera. Views are in
 * file-name order, those of driving sets by frame, then by camera. */
PAGS_API pags_result pags_dataset_open(const char *path, const pags_dataset_options *options, pags_dataset **out);
PAGS_API void pags_dataset_close(pags_dataset *dataset);

PAGS_API const char *pags_dataset_path(const pags_dataset *dataset);
PAGS_API const char *pags_dataset_kind(
    const pags_dataset *dataset); /* "transforms.json", "colmap"; driving: "waymo", ... or "pags" */
PAGS_API int64_t pags_dataset_view_count(const pags_dataset *dataset);
PAGS_API const pags_view *pags_dataset_view(const pags_dataset *dataset, int64_t index);
PAGS_API pags_up pags_dataset_up(const pags_dataset *dataset);
PAGS_API const double *pags_dataset_origin(const pags_dataset *dataset); /* 3 doubles: zero for small coordinates, else
                                                                           the rounded mean of the camera centres */
PAGS_API int64_t pags_dataset_missing(const pags_dataset *dataset);      /* views left out by allow_missing */

/* Driving sets; zero or NULL for static ones. */
PAGS_API int pags_dataset_provides(const pags_dataset *dataset);     /* bits PAGS_PROVIDES_* */
PAGS_API double pags_dataset_fps(const pags_dataset *dataset);       /* time steps per second, 0: static */
PAGS_API pags_place pags_dataset_place(const pags_dataset *dataset); /* as dataset.json says */
PAGS_API int64_t pags_dataset_object_count(const pags_dataset *dataset);
/* Every labelled box with at least one knot within the frames used; knots of held-out time steps have trained 0. */
PAGS_API const pags_object *pags_dataset_object(const pags_dataset *dataset, int64_t index);
/* Whether vehicles, pedestrians and cyclists, or what options.critical names instead, include this object. */
PAGS_API int pags_dataset_object_is_critical(const pags_dataset *dataset, int64_t index);
PAGS_API const char *pags_dataset_critical(const pags_dataset *dataset); /* options.critical; NULL: the default */
PAGS_API int64_t pags_dataset_sweep_count(const pags_dataset *dataset);
PAGS_API const pags_sweep *pags_dataset_sweep(const pags_dataset *dataset, int64_t index); /* in the order of time */
/* Reads a sweep: 3 floats a point, metres, in its frame; points that are not finite are left out. `xyz` is freed by the
 * caller. */
PAGS_API pags_result pags_dataset_sweep_load(const pags_dataset *dataset, int64_t index, int64_t *count, float **xyz);
/* Names of the cameras, "front", ... or their number; NULL where there is no such sensor. */
PAGS_API const char *pags_dataset_sensor_name(const pags_dataset *dataset, int sensor);
/* What was found out or assumed at opening, one line each ("sky from masks", ...), for logs and pags info. */
PAGS_API int64_t pags_dataset_note_count(const pags_dataset *dataset);
PAGS_API const char *pags_dataset_note(const pags_dataset *dataset, int64_t index);

/* The convex outline of a box in a picture, the part nearer than 0.1 m cut off before projecting: at most 16 corners, x
 * and y in px by turns, in order around; returns how many (0: behind the camera). Not clipped to the picture. */
PAGS_API int pags_box_outline(const pags_camera *camera, const double world_from_object[12], const double size[3],
                              double corners[32]);
/* Sets `bits` in `plane` (stride bytes a row) at pixels whose centre lies inside of the outline. */
PAGS_API void pags_outline_fill(const double *corners, int count, int width, int height, int stride, uint8_t bits,
                                uint8_t *plane);

/* Points to start from: the model's own (their colours; only those with at least 2 observations in training views
 * where tracks are known), else random ones in the cameras' common view. xyz is relative to the origin, 3 floats a
 * point; rgb 3 bytes a point. Owned by the data set. */
PAGS_API void pags_dataset_points(const pags_dataset *dataset, int64_t *count, const float **xyz, const uint8_t **rgb,
                                  int *random);

/* Better than random points where the data set has none: `count` points on random pixels of the training photographs,
 * at the depth where other training photographs agree, with the photographs' colours. Reads every training photograph
 * (of more than 256 an even choice) at a small size. xyz (relative to the origin) and rgb are freed by the caller. */
PAGS_API pags_result pags_dataset_match_points(const pags_dataset *dataset, pags_tasks *tasks, int64_t count,
                                               uint64_t seed, float **xyz, uint8_t **rgb);

/* A photograph ready for the loss: three planes of bytes R, G, B and, where the view has a mask or undistortion left
 * pixels without source, a plane of 255 (use) or 0. Row y of plane c begins at rgb + (c * height + y) * stride. */
typedef struct pags_photo {
  int width, height;
  int stride; /* width rounded up to 16; the padding is 0 */
  const uint8_t *rgb;
  const uint8_t *mask;   /* NULL: every pixel counts */
  const uint8_t *labels; /* bits PAGS_LABEL_*, stride as rgb's; NULL: nothing is known of this view */
} pags_photo;

/* Decoded photographs within a budget of bytes, decoded ahead by the pool. Belongs to one thread. */
typedef struct pags_photo_cache pags_photo_cache;

/* `budget` bytes are an upper bound as long as it has room for three photographs. `tasks` and `dataset` must outlive
 * it. */
PAGS_API pags_result pags_photo_cache_create(const pags_dataset *dataset, pags_tasks *tasks, uint64_t budget,
                                             pags_photo_cache **out);
PAGS_API void pags_photo_cache_destroy(pags_photo_cache *cache);

/* The photograph of a view shrunk `shrink` times (1, 2, 4, ...; area average; size = pags_camera_downscale's), decoded
 * now if need be. Valid until the next call of get. */
PAGS_API pags_result pags_photo_cache_get(pags_photo_cache *cache, int64_t view, int shrink, pags_photo *out);

/* Says that these views will be wanted in this order; decoding starts in the background as the budget allows. */
PAGS_API void pags_photo_cache_prefetch(pags_photo_cache *cache, const int64_t *views, int64_t count, int shrink);

#ifdef __cplusplus
}
#endif
#endif
