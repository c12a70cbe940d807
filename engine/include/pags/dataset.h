/* A set of posed photographs, read from transforms.json (nerfstudio, instant-ngp) or a COLMAP model.
 *
 * What a view's camera and image have been brought to: pinhole, undistorted, downscaled. */
#ifndef PAGS_DATASET_H
#define PAGS_DATASET_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_up { PAGS_UP_UNKNOWN, PAGS_UP_Z, PAGS_UP_MINUS_Y } pags_up;

typedef struct pags_dataset_options {
  const char *colmap;  /* model folder to use in place of transforms.json; NULL: choose (transforms.json wins) */
  double downscale;    /* >= 1; 1 = full size */
  int split_every;     /* every Nth view in file-name order (index % N == 0) is held out; 0: none. Default 8 */
  int allow_missing;   /* 1: leave out views whose image is missing (reported by log), 0: an error */
  uint64_t seed;       /* of random points where the data set has none */
  int64_t random_points; /* how many then; default 10000 */
} pags_dataset_options;

PAGS_API pags_dataset_options pags_dataset_options_default(void);

typedef struct pags_view {
  const char *name;       /* file name without folders, unique */
  const char *image_path; /* as opened */
  const char *mask_path;  /* NULL: none. White (>= 128) = use the pixel */
  pags_camera camera;     /* undistorted, downscaled */
  int test;               /* 1: held out */
} pags_view;

typedef struct pags_dataset pags_dataset;

/* `path`: a folder with transforms.json, or a transforms file itself, or a folder with a COLMAP model (., sparse/0, sparse,
 * colmap/sparse/0) and images. Reads every header, decodes no picture but checks that each exists and that its size fits
 * its camera. Views are in file-name order. */
PAGS_API pags_result pags_dataset_open(const char *path, const pags_dataset_options *options, pags_dataset **out);
PAGS_API void pags_dataset_close(pags_dataset *dataset);

PAGS_API const char *pags_dataset_path(const pags_dataset *dataset);
PAGS_API const char *pags_dataset_kind(const pags_dataset *dataset); /* "transforms.json", "colmap" */
PAGS_API int64_t pags_dataset_view_count(const pags_dataset *dataset);
PAGS_API const pags_view *pags_dataset_view(const pags_dataset *dataset, int64_t index);
PAGS_API pags_up pags_dataset_up(const pags_dataset *dataset);
PAGS_API const double *pags_dataset_origin(const pags_dataset *dataset); /* 3 doubles: zero for small coordinates, else
                                                                           the rounded mean of the camera centres */
PAGS_API int64_t pags_dataset_missing(const pags_dataset *dataset); /* views left out by allow_missing */

/* Points to start from: the model's own (their colours; only those with at least 2 observations in training views
 * where tracks are known), else random ones in the cameras' common view. xyz is relative to the origin, 3 floats a point;
 * rgb 3 bytes a point. Owned by the data set. */
PAGS_API void pags_dataset_points(const pags_dataset *dataset, int64_t *count, const float **xyz, const uint8_t **rgb,
                                  int *random);

/* Better than random points where the data set has none: `count` points on random pixels of the training photographs, at
 * the depth where other training photographs agree, with the photographs' colours. Reads every training photograph (of more than
 * 256 an even choice) at a small size. xyz (relative to the origin) and rgb are freed by the caller. */
PAGS_API pags_result pags_dataset_match_points(const pags_dataset *dataset, pags_tasks *tasks, int64_t count, uint64_t seed,
                                               float **xyz, uint8_t **rgb);

/* A photograph ready for the loss: three planes of bytes R, G, B and, where the view has a mask or undistortion left
 * pixels without source, a plane of 255 (use) or 0. Row y of plane c begins at rgb + (c * height + y) * stride. */
typedef struct pags_photo {
  int width, height;
  int stride; /* width rounded up to 16; the padding is 0 */
  const uint8_t *rgb;
  const uint8_t *mask; /* NULL: every pixel counts */
} pags_photo;

/* Decoded photographs within a budget of bytes, decoded ahead by the pool. Belongs to one thread. */
typedef struct pags_photo_cache pags_photo_cache;

/* `budget` bytes are an upper bound as long as it has room for three photographs. `tasks` and `dataset` must outlive it. */
PAGS_API pags_result pags_photo_cache_create(const pags_dataset *dataset, pags_tasks *tasks, uint64_t budget,
                                             pags_photo_cache **out);
PAGS_API void pags_photo_cache_destroy(pags_photo_cache *cache);

/* The photograph of a view shrunk `shrink` times (1, 2, 4, ...; area average; size = pags_camera_downscale's), decoded now if
 * need be. Valid until the next call of get. */
PAGS_API pags_result pags_photo_cache_get(pags_photo_cache *cache, int64_t view, int shrink, pags_photo *out);

/* Says that these views will be wanted in this order; decoding starts in the background as the budget allows. */
PAGS_API void pags_photo_cache_prefetch(pags_photo_cache *cache, const int64_t *views, int64_t count, int shrink);

#ifdef __cplusplus
}
#endif
#endif
