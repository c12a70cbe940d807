/* SPDX-License-Identifier: Apache-2.0 */
/* Procedural scenes, ray-traced: data sets with known truth that need no download. */
#ifndef PAGS_SYNTH_H
#define PAGS_SYNTH_H

#include <pags/base.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_street_options {
  int width, height;    /* px, 16..8192; default 480x270 */
  int frames;           /* time steps, 2..10000; default 40 */
  double fps;           /* default 10 */
  int cameras;          /* 1..3: front, front left, front right; default 3 */
  int samples;          /* rays a pixel, 1..1024; default 8 */
  int objects;          /* moving cars, pedestrians and cyclists, 0..64; default 8 */
  int64_t lidar_points; /* rays a sweep, 0..10^6; default 20000 */
  double lidar_noise;   /* sigma of the range, metres; default 0.02 */
  double pose_noise;    /* sigma of the error put on the boxes' translations (x and y), metres; default 0 */
  double yaw_noise;     /* sigma of the error put on their yaw, degrees; default 0 */
  int shifts;           /* 1: write truth pictures from cameras 1, 2, 3 m to the right and 1 m up. Default 1 */
  uint64_t seed;        /* default 0 */
  int overwrite;        /* 1: write into a folder that is not empty. Default 0 */
} pags_street_options;

PAGS_API pags_street_options pags_street_options_default(void);

/* A street with buildings, trees, parked and moving cars, pedestrians and a cyclist under sun and sky, seen from a car
 * that drives along it: a data set in drivestudio's layout (docs/dataset-layout.md) with dataset.json, images, exact
 * ego poses, LiDAR from the same ray tracer, tracks (with noise if asked for; the exact ones in truth/), semantic, sky
 * and dynamic masks, and, in truth/, depth and object ids of every image and pictures from shifted cameras. World z up,
 * metres; the street runs along +x. The same bytes for any number of threads. dataset.json comes last: without it
 * the folder is no data set. `progress` may be NULL. Errors: PAGS_ERROR_ARGUMENT (an option out of range), _IO,
 * _MEMORY, _UNSUPPORTED (Embree or OpenImageIO failed), PAGS_CANCELLED. */
PAGS_API pags_result pags_synth_street(const char *folder, const pags_street_options *options, pags_tasks *tasks,
                                       pags_progress_fn *progress, void *user);

/* The surfaces of a street that pags_synth_street wrote, where they truly are. */
typedef struct pags_street_truth pags_street_truth;

/* `folder`: the data set. *out = NULL where it has no truth/street.json, which is no error. Closing NULL is allowed. */
PAGS_API pags_result pags_street_truth_open(const char *folder, pags_street_truth **out);
PAGS_API void pags_street_truth_close(pags_street_truth *truth);

/* Of `count` points (3 floats each, world) the distances, in metres, to the nearest surface of something critical
 * (cars, people, bicycles, moving or not) and of anything else, at `time` (seconds): exact up to `reach` metres, beyond
 * it that or more. For one thread at a time. */
PAGS_API pags_result pags_street_truth_distances(pags_street_truth *truth, double time, const float *points,
                                                 int64_t count, double reach, float *critical, float *other);

typedef struct pags_town_options {
  int64_t gaussians; /* at density 1; 1000..2 * 10^8, default 2 million */
  double density;    /* times as many Gaussians on the same surfaces, 0.05..20; default 1 */
  int width, height; /* px of the views, 16..8192; default 960x540 */
  int frames;        /* positions along the middle street, 3 cameras each, 1..10000; default 24 */
  uint64_t seed;     /* default 0 */
  int overwrite;     /* 1: write into a folder that is not empty. Default 0 */
} pags_town_options;

PAGS_API pags_town_options pags_town_options_default(void);

typedef struct pags_town_facts { /* what was made */
  int64_t gaussians;
  int streets, blocks;
  double length, breadth; /* of the town along x and y, metres */
  double square_metres;   /* of surface seen from the streets */
} pags_town_facts;

/* Gaussians of degree 1 on the surfaces of a town made of the street's own houses, trees, cars and people: parallel
 * streets with blocks of houses between them, cut by lanes. No training: sizes and opacities are drawn jointly from
 * trained streets' histograms, colours from the street's shading; only what the streets see is covered. The town is as
 * large as `gaussians` cover at a trained street's density (about 150 a square metre, by surface); fewer than about 900
 * thousand make the smallest town, two streets of two blocks, thinner than that. Writes a scene folder
 * (docs/scene-folder.md) with s_sem 1 on cars, people and bicycles and 0 elsewhere, a sky, and as views a drive along
 * the middle street 1.6 m above it, cameras in front, 50 degrees to the left and to the right. World z up, metres. The
 * same bytes for any number of threads. `progress` and `facts` may be NULL. Errors as pags_synth_street. */
PAGS_API pags_result pags_synth_town(const char *folder, const pags_town_options *options, pags_tasks *tasks,
                                     pags_progress_fn *progress, void *user, pags_town_facts *facts);

#ifdef __cplusplus
}
#endif
#endif
