/* SPDX-License-Identifier: Apache-2.0 */
/* A data set of posed photographs, read from transforms.json (nerfstudio, instant-ngp), a COLMAP model or a driving
 * set in drivestudio's processed layout with its boxes, masks and LiDAR (docs/dataset-layout.md). It also decodes
 * the photographs, with a cache.
 *
 * Every view has an undistorted pinhole camera, downscaled as asked for; photographs, masks and labels are
 * undistorted and shrunk to it when they are decoded. An opened data set is never changed, so that several
 * threads may read from it at the same time. Pointers that a function returns are owned by the data set and valid
 * until it is closed. */
#ifndef PAGS_DATASET_H
#define PAGS_DATASET_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/object.h>
#include <pags/place.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

/* ---- Options, views and labels ---- */

/* What becomes of the alpha channel of photographs (dataset options, image_alpha). */
typedef enum pags_image_alpha {
  PAGS_ALPHA_COMPOSITE, /* the photograph is laid over the background colour */
  PAGS_ALPHA_MASK,      /* alpha is a mask: from 128 of 255 on, the pixel is used */
  PAGS_ALPHA_IGNORE     /* alpha is ignored; the colours are used unchanged */
} pags_image_alpha;

typedef struct pags_dataset_options {
  /* Folder of a COLMAP model, or one above it, to use instead of transforms.json; a path as given or relative to the
   * data set; NULL: transforms.json if present, else the model in the data set. */
  const char *colmap;
  double downscale; /* factor by which cameras and photographs are shrunk, >= 1; default 1 (full size) */
  /* Which views are held out. Static sets: every Nth view in file-name order (index % N == 0, missing pictures
   * counted). Driving sets: all cameras of every Nth time step of the recording but the first, whatever the numbers of
   * its frames are. N = 0: none; N >= 2; -1 (default): as the data set states, else 8 for static sets, 4 for driving
   * sets. */
  int split_every;
  /* Folder to take the photographs of a static set from, in place of the one that it names: images_4, say. Names below
   * it are those of the set, but for the extension. Relative to the data set's folder, or to the current one. NULL:
   * the set's own; input, images_2, images_4 or images_8 where that has none of them. */
  const char *image_folder;
  pags_image_alpha image_alpha; /* default PAGS_ALPHA_COMPOSITE */
  double background[3];         /* display-referred sRGB, 0..1, for PAGS_ALPHA_COMPOSITE; default black */
  /* 0: a camera of which a pinhole would show less than nine tenths (fisheyes, panoramas, strong distortion) keeps its
   * lens, and its photographs their pixels; those of others are undistorted. 1: all are undistorted. */
  int undistort;
  int allow_missing; /* 1: views whose image or pose is missing are left out, with a warning in the log; 0: an error */
  int64_t random_points; /* points to match for a static set that has none, 1..10^8; default 10000 */
  /* Driving sets only: */
  const char
      *kind; /* waymo, pandaset, kitti, nuscenes, argoverse2, nuplan, street-gaussians; NULL: as dataset.json says */
  const char *cameras;             /* numbers of the cameras to use, separated by commas; NULL: all */
  int64_t frame_first, frame_last; /* time steps to use, both included; frame_last -1 (default): to the end */
  const char *holdout_camera;      /* number of a camera all of whose views are held out; NULL: none */
  /* Mask of the ego vehicle, whose pixels are left out of the loss: a picture for all cameras, or a folder with
   * C.png per camera number C, white where the ego vehicle is visible. NULL: ego_masks/C.png of the data set; if
   * that is missing, pixels at the lower edge that never change are searched for. */
  const char *ego_mask;
  /* What is critical: kinds (vehicle, ...), classes of the label images by name or number, and classes of boxes,
   * separated by commas (docs/masks.md). NULL: vehicles, pedestrians and cyclists. */
  const char *critical;
  /* 1: the contents of photographs and sweeps are looked at, too, which takes a second or so; faults are warnings in
   * the log, as those that show on opening are (docs/driving.md). Default 0. */
  int look;
  const char *sfm; /* folder of a COLMAP model in the same world, whose points are added; NULL: none */
} pags_dataset_options;

PAGS_API pags_dataset_options pags_dataset_options_default(void);

/* One photograph and its camera. */
typedef struct pags_view {
  /* File name of the image without folders; where two images have the same file name, the path of each below the
   * folder that they have in common, with slashes. Unique. */
  const char *name;
  const char *image_path; /* path that the image is opened by */
  /* Mask of the photograph: the pixel is used where it is 128 or more of 255, or 1 if it has no larger value. If the
   * file has an alpha channel that isn't opaque everywhere, that is the mask. NULL: none. */
  const char *mask_path;
  pags_camera camera; /* undistorted, downscaled */
  int test;           /* 1: held-out view */
  int sensor;         /* number of the camera in the file names; -1 in a static set */
  /* Time step in the file names; -1 in a static set. camera.time is the time of this step (NaN in a static set):
   * boxes labelled at this step fit the photograph without correction for the time of the exposure. */
  int frame;
  double shutter_time; /* time of the exposure, seconds; NaN if unknown. Never used to move boxes */
} pags_view;

/* Bits of a pixel in the label plane of a photograph (pags_photo.labels). */
enum {
  PAGS_LABEL_SKY = 1, /* from sky_masks; else from semantic; else guessed: above the horizon and all LiDAR returns */
  /* Vehicle, pedestrian or cyclist, or what options.critical says: pixels of these classes in semantic and pixels
   * in dynamic_masks/all; in a view without semantic also pixels in the boxes of such objects. */
  PAGS_LABEL_CRITICAL = 2,
  PAGS_LABEL_MOVING = 4,      /* in dynamic_masks/all; in a view without it, in the box of a moving object */
  PAGS_LABEL_VEHICLE = 8,     /* in the box of a moving vehicle */
  PAGS_LABEL_PEDESTRIAN = 16, /* in the box of a moving pedestrian */
  PAGS_LABEL_CYCLIST = 32,    /* in the box of a moving cyclist */
  PAGS_LABEL_PARKED = 64,     /* in the box of an object that doesn't move */
  /* Nothing says whether this is sky: the view has no mask and the set no LiDAR, the label image has an id that its
   * label set doesn't have (255), or LiDAR didn't look there. The pixel isn't taken for something that isn't sky. */
  PAGS_LABEL_SKY_UNKNOWN = 128
};

/* What a data set provides besides photographs: bits of pags_dataset_provides. */
enum {
  PAGS_PROVIDES_BOXES = 1,
  PAGS_PROVIDES_LIDAR = 2,
  PAGS_PROVIDES_SKY_MASKS = 4, /* files in sky_masks/, or semantic labels that have a class sky */
  PAGS_PROVIDES_SEMANTIC = 8,
  PAGS_PROVIDES_DYNAMIC_MASKS = 16,
  PAGS_PROVIDES_SFM = 32
};

/* A sweep: one turn of the LiDAR. Its points are in the sweep's own frame, corrected for the motion of the car. */
typedef struct pags_sweep {
  int frame;                   /* time step */
  int test;                    /* 1: of a held-out time step, not for training */
  double time;                 /* time of the time step, seconds */
  const char *path;            /* file with the points */
  double world_from_sweep[12]; /* rigid 3x4 pose of the sweep's frame, metres, absolute */
} pags_sweep;

/* A block of a recording, as `pags split` writes it (docs/blocks.md). Time steps are numbers of frames; of both ranges
 * both ends are included. */
typedef struct pags_block {
  const char *split;       /* names the split: the same in all of its blocks */
  int number, count;       /* of this block, from 0, and of the blocks */
  const char *recording;   /* folder of the recording's data set */
  const char *whole;       /* scene of the whole recording, whose sky and mean exposure hold; NULL: none */
  int first, last;         /* time steps that the block is trained on */
  int own_first, own_last; /* those of them that are its own: no other block's */
} pags_block;

/* ---- Opening a data set ---- */

typedef struct pags_dataset pags_dataset;

/* Opens a data set. `path` is a folder with transforms.json, a transforms file itself, a driving set (a folder with
 * dataset.json, or with images and ego_pose or extrinsics), a folder with transforms_train.json and, as held-out views,
 * transforms_val.json and transforms_test.json, or a folder with images and a COLMAP model in it, in sparse/N, sparse,
 * colmap/sparse/N or elsewhere at most 4 levels below: of several in one folder the one with the most pictures. Or a
 * block of a driving set (a folder with block.json): the views and sweeps of its time steps, and the objects labelled
 * in them with their whole tracks; options that block.json states may not be given another value.
 * `options` may be NULL (the defaults).
 *
 * Ignored, guessed or excluded data is logged as a warning, one line per kind.
 *
 * No photograph is decoded, but every header is read: each image must exist. If it has another size than its camera
 * states, but the same ratio of sides within a pixel, the intrinsics are scaled to it; where its EXIF orientation
 * explains the size, it is turned. In a static set whose file names no masks, masks/NAME.png and masks/NAME.png.png
 * in the folder of the images are masks. Labels with faults are mended or left out (docs/dataset-layout.md). Whatever
 * is guessed, mended or left out so is a warning in the log. Views of static sets are in the order of their names,
 * those of driving sets are sorted by frame, then by camera.
 *
 * PAGS_ERROR_ARGUMENT (an option out of range or that names nothing known), PAGS_ERROR_IO (missing files),
 * PAGS_ERROR_FORMAT (no data set, or one of another program, which is named; damaged files; all views held out),
 * PAGS_ERROR_LIMIT, PAGS_ERROR_UNSUPPORTED (an unknown camera model; a picture that takes OpenImageIO where there is
 * none) or PAGS_ERROR_MEMORY; then *out is NULL. */
PAGS_API pags_result pags_dataset_open(const char *path, const pags_dataset_options *options, pags_dataset **out);

/* Frees a data set. NULL is allowed. */
PAGS_API void pags_dataset_close(pags_dataset *dataset);

/* Returns the path that the data set was opened by. */
PAGS_API const char *pags_dataset_path(const pags_dataset *dataset);

/* Returns options.colmap as it was given; NULL: none was. */
PAGS_API const char *pags_dataset_colmap(const pags_dataset *dataset);

/* Returns "transforms.json" or "colmap", or the kind of a driving set ("waymo", ..., "pags"). */
PAGS_API const char *pags_dataset_kind(const pags_dataset *dataset);

PAGS_API int64_t pags_dataset_view_count(const pags_dataset *dataset);
PAGS_API const pags_view *pags_dataset_view(const pags_dataset *dataset, int64_t index);

/* Returns the direction of the world that is up. */
PAGS_API pags_up pags_dataset_up(const pags_dataset *dataset);

/* Returns the origin (3 doubles, metres) that is subtracted from positions stored as floats: zero if no
 * coordinate of a camera exceeds 4096 m, otherwise the mean of the camera centres rounded to whole metres. */
PAGS_API const double *pags_dataset_origin(const pags_dataset *dataset);

/* Returns the block if the data set is a block of a drive, else NULL. */
PAGS_API const pags_block *pags_dataset_block(const pags_dataset *dataset);

/* Returns the number of views that were left out because of allow_missing. */
PAGS_API int64_t pags_dataset_missing(const pags_dataset *dataset);

/* Returns the options' image_folder (absolute unless it lies in the data set's folder; NULL if none was given) and
 * image_alpha. */
PAGS_API const char *pags_dataset_image_folder(const pags_dataset *dataset);
PAGS_API pags_image_alpha pags_dataset_image_alpha(const pags_dataset *dataset);

/* Returns the number of views whose photographs have an alpha channel, whatever image_alpha makes of it. */
PAGS_API int64_t pags_dataset_alpha_count(const pags_dataset *dataset);

/* ---- Driving sets ---- */

/* The functions of this section return zero or NULL for static sets, except for pags_box_outline and
 * pags_outline_fill, which need no data set. */

/* Returns the bits PAGS_PROVIDES_* of what the data set provides. */
PAGS_API int pags_dataset_provides(const pags_dataset *dataset);

/* Returns the time steps per second. */
PAGS_API double pags_dataset_fps(const pags_dataset *dataset);

/* Returns the geographic position of the world, as dataset.json says. */
PAGS_API pags_place pags_dataset_place(const pags_dataset *dataset);

/* The objects: every labelled box with at least one keyframe within the frames used. Keyframes of held-out time steps
 * have trained = 0. */
PAGS_API int64_t pags_dataset_object_count(const pags_dataset *dataset);
PAGS_API const pags_object *pags_dataset_object(const pags_dataset *dataset, int64_t index);

/* Returns whether an object is critical: whether it is a vehicle, pedestrian or cyclist, or what options.critical
 * names instead. */
PAGS_API int pags_dataset_object_is_critical(const pags_dataset *dataset, int64_t index);

/* Returns options.critical; NULL: the default. */
PAGS_API const char *pags_dataset_critical(const pags_dataset *dataset);

/* The LiDAR sweeps, in the order of time. */
PAGS_API int64_t pags_dataset_sweep_count(const pags_dataset *dataset);
PAGS_API const pags_sweep *pags_dataset_sweep(const pags_dataset *dataset, int64_t index);

/* Reads the points of a sweep: 3 floats per point (x, y, z), metres, in the sweep's frame. Points that are not
 * finite are left out. The caller frees *xyz, which is not NULL on success. PAGS_ERROR_IO, PAGS_ERROR_FORMAT,
 * PAGS_ERROR_MEMORY; then *xyz is NULL. */
PAGS_API pags_result pags_dataset_sweep_load(const pags_dataset *dataset, int64_t index, int64_t *count, float **xyz);

/* Returns the name of a camera ("front"), or its number as text if it has no name; NULL if there is no such
 * camera. */
PAGS_API const char *pags_dataset_sensor_name(const pags_dataset *dataset, int sensor);

/* The notes: one line of text each about what was found or assumed when the data set was opened ("sky from
 * masks"), for logs and `pags info`. */
PAGS_API int64_t pags_dataset_note_count(const pags_dataset *dataset);
PAGS_API const char *pags_dataset_note(const pags_dataset *dataset, int64_t index);

/* Computes the outline of a 3D box in a picture: the convex hull of its projection, after clipping the part of
 * the box nearer than 0.1 m to the camera. `size` is the full extents, metres; world_from_object is absolute.
 * Writes x and y of each corner in pixels, in order around the outline, to `corners` and returns the number of
 * corners: at most 16, or 0 if the box lies behind the camera. The outline is not clipped to the picture. */
PAGS_API int pags_box_outline(const pags_camera *camera, const double world_from_object[12], const double size[3],
                              double corners[32]);

/* Sets `bits` in the bytes of `plane` (`height` rows with a stride of `stride` bytes) at all pixels whose centre
 * lies inside of a convex outline of `count` corners. */
PAGS_API void pags_outline_fill(const double *corners, int count, int width, int height, int stride, uint8_t bits,
                                uint8_t *plane);

/* ---- Points and photographs ---- */

/* Returns the points to start a training from, owned by the data set. They are the points of the COLMAP model or
 * the point file of the data set (with options.sfm those of that model) with their colours; where the tracks of
 * the points are known, only points that at least 2 training views observe (1 if no track has 2), or of whose views
 * none is in the data set. For a static set without such points *to_match becomes 1, *count the number of points to
 * match (options.random_points, for pags_dataset_match_points), and xyz and rgb are not to be read; a driving set
 * without them has none (*count is 0). xyz: 3 floats per point, metres, relative to the origin; rgb: 3 bytes per point.
 */
PAGS_API void pags_dataset_points(const pags_dataset *dataset, int64_t *count, const float **xyz, const uint8_t **rgb,
                                  int *to_match);

/* Computes points from the training photographs by plane-sweep stereo (Collins 1996): `count` (1..2^31 - 2) points on
 * random pixels, at the depth at which other training photographs agree best, or, if there is no clear depth, at that
 * of the nearest pixel that has one. Colours are the photographs'. Reads every training photograph, or an even choice
 * of 256, at a small size. The result depends on `seed` but not on the number of threads. The caller frees *xyz (3
 * floats per point, metres, relative to the origin) and *rgb (3 bytes per point). Errors of decoding as
 * pags_image_load; PAGS_CANCELLED; then both are NULL. */
PAGS_API pags_result pags_dataset_match_points(const pags_dataset *dataset, pags_tasks *tasks, int64_t count,
                                               uint64_t seed, float **xyz, uint8_t **rgb);

/* A photograph as the loss needs it: planes of bytes. Row y of colour plane c (R, G, B) begins at
 *     rgb + (c * height + y) * stride */
typedef struct pags_photo {
  int width, height;     /* pixels */
  int stride;            /* bytes from row to row: width rounded up to 16; the padding is 0 */
  const uint8_t *rgb;    /* display-referred sRGB */
  const uint8_t *mask;   /* 255: use the pixel; 0: masked out, or undistortion found no source; NULL: use all */
  const uint8_t *labels; /* bits PAGS_LABEL_* per pixel, with the same stride; NULL: nothing is known of this view */
} pags_photo;

/* A cache of decoded photographs within a size limit, which decodes announced views ahead on the thread pool. It
 * may be used by one thread at a time. */
typedef struct pags_photo_cache pags_photo_cache;

/* Creates a cache. `budget` is the size limit in bytes; it holds as long as it has room for three photographs.
 * `tasks` and `dataset` must outlive the cache. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_photo_cache_create(const pags_dataset *dataset, pags_tasks *tasks, uint64_t budget,
                                             pags_photo_cache **out);

/* Waits for decodes under way and frees the cache. NULL is allowed. */
PAGS_API void pags_photo_cache_destroy(pags_photo_cache *cache);

/* Gets the photograph of a view, shrunk by the factor `shrink` (1, 2, 4, ...) by area average, at the size of
 * pags_camera_downscale(view's camera, shrink). Decodes it now unless it is in the cache. `out` points into the
 * cache and is valid until the next get. Errors as pags_image_load, also if the decoding failed ahead in the
 * background. */
PAGS_API pags_result pags_photo_cache_get(pags_photo_cache *cache, int64_t view, int shrink, pags_photo *out);

/* Announces that these views will be needed in this order, shrunk by `shrink`, and replaces an earlier
 * announcement. Decoding starts in the background as far as the size limit allows. */
PAGS_API void pags_photo_cache_prefetch(pags_photo_cache *cache, const int64_t *views, int64_t count, int shrink);

PAGS_END_C
#endif
