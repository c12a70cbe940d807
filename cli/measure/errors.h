/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: errors of a scene against the truth that synthetic data sets include (cameras, object tracks, priorities,
 * pictures from shifted cameras), and of rendered depth against LiDAR. */
#ifndef PAGS_CLI_ERRORS_H
#define PAGS_CLI_ERRORS_H

#include "base/json.h"
#include "cli/common/photographs.h"
#include "cli/common/session.h"

#include <pags/compose.h>

/* ---- Cameras ---- */

/* Root mean squares over views. */
typedef struct pags_camera_error {
  double metres, degrees;
} pags_camera_error;

/* Errors of training and held-out views, as recorded and as corrected by training; each after the rigid motion that
 * brings all recorded (or corrected) training cameras nearest to the truth, since the placement of the world is
 * arbitrary. */
typedef struct pags_camera_errors {
  int64_t views[2]; /* training views, held-out views; 0: the data set has no truth */
  pags_camera_error recorded[2], corrected[2];
} pags_camera_errors;

/* Measures against truth/cameras/C.json of the data set; all zero without such files. */
pags_result pags_camera_errors_measure(const char *dataset, const pags_scene *scene, pags_camera_errors *out);

/* Writes the JSON member `cameras`: an object, or null without truth. */
void pags_camera_errors_put_json(pags_json_writer *writer, const pags_camera_errors *errors);

/* ---- Object tracks ---- */

/* Mean pose errors over the keyframes of the tracks. */
typedef struct pags_pose_error {
  double label_metres, label_degrees; /* errors of the labelled poses */
  double metres, degrees;             /* errors of the scene's poses, corrected by training */
} pags_pose_error;

/* Errors of objects with a model of their own. In `relative`, each track's mean error in the object's frame is
 * subtracted first: the origin of an object is a convention of the labels that no photograph determines. */
typedef struct pags_pose_errors {
  int64_t objects, keyframes, held_out_keyframes; /* objects 0: the data set has no truth */
  pags_pose_error absolute, relative;             /* errors at trained keyframes */
  pags_pose_error held_out;                       /* errors at the other keyframes, which training never used */
} pags_pose_errors;

/* Measures the errors against truth/instances/instances_info.json of the data set; all zero if there is no such
 * file. */
pags_result pags_pose_errors_measure(const char *dataset, const pags_scene *scene, pags_pose_errors *out);

/* Writes the JSON member `poses`: an object, or null without truth. Its recovered shares are 1 - trained / labelled,
 * null if the labels have no error. */
void pags_pose_errors_put_json(pags_json_writer *writer, const pags_pose_errors *errors);

/* ---- Priorities: Gaussians on critical objects should have a high priority, and only those ---- */

/* A Gaussian's owner is the true surface nearest to its mean at the time of the training view in which the Gaussian
 * has its largest weight. A Gaussian is seen if its weights alpha T over all training views sum up to at least one
 * pixel. A seen Gaussian is counted if its mean lies within 5 cm of its owner and more than 15 cm from any surface of
 * the other kind; the kinds are critical and other. */
typedef struct pags_priority_truth {
  int64_t seen, counted; /* seen 0: no truth */
  /* of the seen ones not counted: further than 5 cm from any surface; within 15 cm of both kinds */
  int64_t astray, between;
  double left_out_weight; /* the left-out Gaussians' share of the summed weights of all seen ones */
  /* counted Gaussians on critical surfaces; those of them with a priority over 0.5 */
  int64_t critical, critical_high;
  int64_t other, other_high; /* the same for counted Gaussians on other surfaces */
} pags_priority_truth;

/* Renders the training views once more and compares the priorities. `out` is all zero if the data set has no
 * truth/street.json or the scene has no priorities. */
pags_result pags_priority_truth_measure(pags_composition *composition, const pags_photographs *photographs,
                                        pags_frame *frame, const pags_frame_options *options, pags_priority_truth *out);

void pags_priority_truth_put_json(pags_json_writer *writer, const pags_priority_truth *priority_truth);

/* ---- Objects ---- */

/* Error of an object in a view, over the pixels where one of its Gaussians has the largest weight. */
typedef struct pags_object_error {
  int64_t view; /* in the data set */
  int64_t object, pixels;
  double squared; /* summed over pixels and channels */
} pags_object_error;

typedef struct pags_object_errors {
  int64_t count, capacity;
  pags_object_error *items; /* freed by the caller */
} pags_object_errors;

/* Adds the errors of a view's objects. `picture`: with extra channels; `object_of`: pags_composition_objects. */
pags_result pags_object_errors_add(pags_object_errors *errors, const int32_t *object_of, int64_t object_count,
                                   int64_t view, const pags_picture *picture, const pags_image *render,
                                   const pags_photograph *photo);
/* Brings the errors of all ranks to the first. */
pags_result pags_object_errors_gather(pags_object_errors *errors);
/* Writes the JSON member `objects`, an array with PSNR and the worst view of each object that is seen. Sorts. */
void pags_object_errors_put_json(pags_json_writer *writer, const pags_object_errors *errors, const pags_scene *scene,
                                 const pags_dataset *dataset);

/* ---- Pictures from cameras shifted off the recorded path ---- */

typedef struct pags_shifted_view_score {
  char name[64]; /* name of the folder, such as "right_1" */
  int64_t views;
  double psnr, ssim;  /* means over the views */
  int64_t road_views; /* views with road pixels, according to NNNNN_semantic.png in the same folder */
  double road_psnr;   /* mean over these views of the PSNR of road pixels; NaN without such views */
} pags_shifted_view_score;

typedef struct pags_shifted_view_scores {
  int64_t count;
  pags_shifted_view_score *items; /* sorted by name; freed by the caller, also after a failure */
} pags_shifted_view_scores;

/* Renders the cameras of every DATASET/truth/shift/NAME/path.json, `downscale` times smaller, and measures PSNR and
 * SSIM against the pictures in that folder. Fails if the data set has none. With `images` (a folder, may be NULL) also
 * writes NAME_00000_render.png and NAME_00000_truth.png, and so on. */
pags_result pags_shifted_views_measure(const char *dataset, double downscale, pags_composition *composition,
                                       pags_frame *frame, const pags_frame_options *options,
                                       const pags_session *session, const char *images, pags_shifted_view_scores *out);

/* ---- Depth against LiDAR: errors are gathered view by view and summarised ---- */

typedef struct pags_depth_errors {
  int64_t count, capacity;
  double *errors;    /* |rendered - measured|, metres; freed by the caller */
  int64_t within;    /* number of errors that are at most 5 % of the measured depth */
  int64_t unblended; /* number of LiDAR points on pixels without a rendered depth */
} pags_depth_errors;

typedef struct pags_depth_figures {
  int64_t samples;
  double median, mean; /* metres; NaN without samples */
  double mean95;       /* mean of the smallest 95 % of the errors */
  /* Share of the LiDAR points, unblended ones included, whose error is within 5 % of the measured depth. */
  double within;
} pags_depth_figures;

/* Adds the depth errors at the LiDAR points of a view's time step. The picture must have its extra channels (depth)
 * and the size of the view's camera; pixels where the mask (one byte a pixel; NULL: no mask) is 0 are left out. */
pags_result pags_depth_errors_add(pags_depth_errors *errors, const pags_dataset *dataset, int64_t view,
                                  const pags_picture *picture, const uint8_t *mask);

/* Appends errors that another rank has gathered. */
pags_result pags_depth_errors_append(pags_depth_errors *errors, const double *more, int64_t count);

/* Summarises all errors; sorts them in place. */
pags_depth_figures pags_depth_errors_figures(pags_depth_errors *errors);
/* Writes the JSON member `depth`: an object, or null without samples. */
void pags_depth_figures_put_json(pags_json_writer *writer, const pags_depth_figures *figures);

#endif
