/* SPDX-License-Identifier: Apache-2.0 */
/* Procedural data: a ray-traced street as a driving data set with exact ground truth, and a town as a large scene
 * of Gaussians. Neither needs a download. */
#ifndef PAGS_SYNTH_H
#define PAGS_SYNTH_H

#include <pags/base.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

/* The order in which a rolling shutter reads a picture: rows from the top down or from the bottom up, columns from the
 * left to the right or from the right to the left. */
typedef enum pags_read_out { PAGS_READ_DOWN, PAGS_READ_UP, PAGS_READ_RIGHT, PAGS_READ_LEFT } pags_read_out;

/* What is wrong with the cameras of a street; 0: nothing. Errors are random, by the seed; those of poses and
 * times are in what the data set says: truth/cameras/C.json has the true cameras. */
typedef struct pags_street_faults {
  double rolling;         /* time to read a picture, 0..0.2 seconds; its middle is the time of the exposure */
  pags_read_out read_out; /* its direction */
  double delay;           /* standard deviation of the time by which a camera is late, 0..0.2 seconds */
  /* Root mean square of the error of the car's pose in a time step, half of its variance independent and half
   * correlated over half a second: 0..2 metres, 0..10 degrees. */
  double position, angle;
  double mount_position, mount_angle; /* that of the constant error of a camera's pose in the car */
  double vignette;   /* share of the light, 0..0.9, that is lost in a corner of the picture; the squared distance from
                        the middle scales it */
  double response;   /* exponent of the response curve less 1, 0..0.5: camera 1 has it, camera 2 its negative, camera 0
                        none */
  double distortion; /* radial term k1 of the lens, -0.3..0.3 */
  /* Degrees across the circle of OpenCV fisheyes, as wide as the picture, in place of pinholes, 60..240; 0: pinholes.
   * truth/depth then holds distances. */
  double fisheye;
} pags_street_faults;

/* Sets a fault from "NAME=VALUE" (docs/synth.md). PAGS_ERROR_ARGUMENT: no such name, no number, or out of range. */
PAGS_API pags_result pags_street_faults_set(pags_street_faults *faults, const char *text);

typedef struct pags_street_options {
  int width, height;         /* of the images, px, 16..8192; default 480x270 */
  int frames;                /* time steps, 2..10000; default 40 */
  double fps;                /* time steps per second, 0.1..1000; frames / fps is at most 1000 s; default 10 */
  int cameras;               /* 1..3: front, front left, front right; default 3 */
  int samples;               /* rays per pixel, 1..1024; default 8 */
  int objects;               /* moving cars, pedestrians and cyclists, 0..64; default 8 */
  int64_t lidar_points;      /* LiDAR rays per sweep, 0..10^6; default 20000 */
  int lively;                /* 1: the car brakes, speeds up and swerves, rather than drive steadily. Default 0 */
  double lidar_noise;        /* standard deviation of the LiDAR's range, 0..10 metres; default 0.02 */
  double pose_noise;         /* standard deviation of the error added to the boxes' x and y, 0..10 metres; default 0 */
  double yaw_noise;          /* standard deviation of the error added to the boxes' yaw, 0..180 degrees; default 0 */
  int shifts;                /* 1: also write true pictures from cameras 1, 2, 3 m to the right and 1 m up. Default 1 */
  uint64_t seed;             /* default 0 */
  int overwrite;             /* 1: write into a folder that is not empty. Default 0 */
  pags_street_faults faults; /* default none */
} pags_street_options;

PAGS_API pags_street_options pags_street_options_default(void);

/* Makes a street with buildings, trees, parked and moving cars, pedestrians and a cyclist under sun and sky, seen
 * from a car that drives along it, and writes it to `folder` as a data set in drivestudio's layout
 * (docs/dataset-layout.md): dataset.json, images, exact ego poses, LiDAR from the same ray tracer, tracks (with
 * noise if asked for; the exact ones are in truth/), semantic, sky and dynamic masks; and in truth/ the depth and
 * object ids of every image and pictures from shifted cameras. The world is in metres, z up; the street runs along
 * +x.
 *
 * The result is the same bytes for any number of threads. dataset.json is written last: without it the folder is
 * no data set. `progress` may be NULL. PAGS_ERROR_ARGUMENT (an option out of range), PAGS_ERROR_IO (also if the
 * folder isn't empty and `overwrite` is 0), PAGS_ERROR_MEMORY, PAGS_ERROR_UNSUPPORTED (Embree failed) or
 * PAGS_CANCELLED. */
PAGS_API pags_result pags_synth_street(const char *folder, const pags_street_options *options, pags_tasks *tasks,
                                       pags_progress_fn *progress, void *user);

/* The exact surfaces of a street that pags_synth_street wrote, to measure reconstructed geometry against. May be
 * used by one thread at a time. */
typedef struct pags_street_truth pags_street_truth;

/* Rebuilds the surfaces for the data set in `folder` from its truth/street.json. If there is no such file, *out
 * becomes NULL, which is no error. PAGS_ERROR_IO, PAGS_ERROR_FORMAT (a damaged file) or PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_street_truth_open(const char *folder, pags_street_truth **out);

/* Frees the surfaces. NULL is allowed. */
PAGS_API void pags_street_truth_close(pags_street_truth *truth);

/* Computes for `count` points (3 floats each, world, metres) the distances in metres to the nearest surface of
 * something critical (cars, people, bicycles, moving or not) and to the nearest surface of anything else, as they
 * stand at `time` (seconds). `critical` and `other` receive `count` distances each, exact up to `reach` metres; a
 * larger distance gives some value of at least `reach`, possibly infinity. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_street_truth_distances(pags_street_truth *truth, double time, const float *points,
                                                 int64_t count, double reach, float *critical, float *other);

typedef struct pags_town_options {
  int64_t gaussians; /* number of Gaussians at density 1, 1000..2 * 10^8; default 2 million */
  double density;    /* factor on the number of Gaussians on the same surfaces, 0.05..20; default 1 */
  int width, height; /* of the views, px, 16..8192; default 960x540 */
  int frames;        /* positions along the middle street with 3 cameras each, 1..10000; default 24 */
  uint64_t seed;     /* default 0 */
  int overwrite;     /* 1: write into a folder that is not empty. Default 0 */
} pags_town_options;

PAGS_API pags_town_options pags_town_options_default(void);

/* Figures of a town that was made. */
typedef struct pags_town_facts {
  int64_t gaussians;
  int streets, blocks;
  double length, breadth; /* extent of the town along x and y, metres */
  double square_metres;   /* area of the surfaces that are visible from the streets */
} pags_town_facts;

/* Makes a town of Gaussians of SH degree 1 on the surfaces of the synthetic street's houses, trees, cars and people:
 * parallel streets with blocks of houses between them, which lanes cut, and writes it as a scene folder
 * (docs/scene-folder.md). There is no training: sizes and opacities are drawn jointly from the histograms of trained
 * streets, colours come from the street's shading. Only surfaces that are visible from the streets are covered. The
 * town is as large as `gaussians` cover at the density of a trained street (about 150 per square metre, depending on
 * the surface); fewer than about 900,000 make the smallest town, two streets of two blocks, at a lower density.
 *
 * The scene has s_sem 1 on cars, people and bicycles and 0 elsewhere, a sky, and as views a drive along the
 * middle street, 1.6 m above it, with cameras to the front and 50 degrees to the left and to the right. The world
 * is in metres, z up. The result is the same bytes for any number of threads. `progress` and `facts` may be NULL.
 * Errors as pags_synth_street. */
PAGS_API pags_result pags_synth_town(const char *folder, const pags_town_options *options, pags_tasks *tasks,
                                     pags_progress_fn *progress, void *user, pags_town_facts *facts);

PAGS_END_C
#endif
