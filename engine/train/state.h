/* SPDX-License-Identifier: Apache-2.0 */
/* The state of a training run between two steps. It holds everything that a checkpoint holds. */
#ifndef PAGS_TRAIN_STATE_H
#define PAGS_TRAIN_STATE_H

#include <pags/train.h>

#include "train/camera_poses.h"
#include "train/exposure.h"
#include "train/model.h"
#include "train/nonfinite.h"
#include "train/photometry.h"
#include "train/sky_fit.h"
#include "train/track_poses.h"

/* Names of the kernels that computed a run: [0] of those that round products by themselves, [1] of those that fuse
 * multiply-add (simd/kernels.h); the last of several, empty if there were none. Both: the run has other bits than an
 * undisturbed one. */
enum { PAGS_KERNEL_NAME = 8 };
typedef struct pags_kernel_names {
  char of[2][PAGS_KERNEL_NAME];
} pags_kernel_names;

/* What was measured for the report when corrections were tested. */
typedef struct pags_costs {
  int64_t saved[PAGS_DECISIONS]; /* bytes in scene.json of corrections that were discarded */
  double uncovered;              /* of a static set: light that comes from behind all Gaussians, 0..1; 0: unknown */
} pags_costs;

/* The SH degrees of the finished scene (sh_trim.h). */
typedef struct pags_sh_choice {
  bool made;
  int64_t rows[4], saved; /* Gaussians by degree, of all ranks; bytes that the scene has less */
  double gain, loss;      /* PSNR of training photographs, dB: with SH against none; lost by what was removed */
} pags_sh_choice;

typedef struct pags_train_state {
  pags_schedule schedule;
  int64_t stop;     /* last step to do; larger than schedule.length after --resume --iterations */
  int64_t step;     /* number of steps done */
  int64_t resets;   /* number of opacity resets done */
  int64_t cap;      /* limit on Gaussians that the run keeps: max_gaussians or what max_memory allows; 0: none */
  int64_t clocked;  /* 1: the number of steps was set by the time limit, so it may differ from the one asked for */
  double loss, mse; /* running means over about one pass; 0 before the first step */
  int64_t model_count;
  pags_train_model *models;   /* the background first, then objects in the data set's order */
  pags_track_poses tracks;    /* tracks of all labelled objects */
  pags_sky_fit sky;           /* size 0: no sky */
  bool one_colour;            /* the photographs have no second one */
  double sky_share;           /* share of the training photographs' pixels that is sky */
  int64_t lidar_points;       /* number of LiDAR points that the background started from */
  pags_exposures exposures;   /* count 0: exposure isn't modelled */
  pags_camera_poses cameras;  /* count 0: poses are as recorded */
  pags_photometry photometry; /* count 0: no vignettes and response curves */
  pags_costs costs;
  pags_sh_choice sh;         /* of a run that has ended */
  pags_nonfinite nonfinite;  /* updates skipped because a number wasn't finite */
  pags_kernel_names kernels; /* of the processes before this one */
} pags_train_state;

/* Creates the state of a run of `stop` steps, without models but with room for `models` of them. */
pags_result pags_state_create(pags_train_state *state, const pags_schedule *schedule, int64_t stop, int64_t models);
void pags_state_destroy(pags_train_state *state);

/* Adds a model made of the Gaussians `g`, which it takes over. `object` is the object's number, -1 for the
 * background; `extent` is in metres. */
pags_result pags_state_add_model(pags_train_state *state, int64_t object, double extent, pags_gaussians *g);

int64_t pags_state_gaussian_count(const pags_train_state *state);
/* Sets the number of steps done of the run and of its models. */
void pags_state_set_step(pags_train_state *state, int64_t step);
/* Settles all models: applies all pending Adam steps (see pags_model_settle). */
void pags_state_settle(pags_train_state *state, pags_tasks *tasks);
/* Makes the parameters of all models current as of the last step done; changes no bit of the run's results. */
void pags_state_flush(pags_train_state *state, pags_tasks *tasks);
/* Replaces the schedule by one of another length. The models must be settled; they keep their extents. */
pags_result pags_state_retime(pags_train_state *state, const pags_schedule *schedule, int64_t stop);

/* Sets the box limits of an object's model, outside of which its Gaussians are pruned, if box_prune is set. */
void pags_state_fit_box(pags_train_state *state, int64_t model);

#endif
