/* SPDX-License-Identifier: Apache-2.0 */
/* Maps the steps of a run to events: learning rates, SH degree, resolution, densify, reset, prune, the order
 * of views. All are pure functions of (configuration, extent, number of training views, step). */
#ifndef PAGS_TRAIN_SCHEDULE_H
#define PAGS_TRAIN_SCHEDULE_H

#include <stdbool.h>

#include <pags/train.h>

/* Groups of parameters that share a learning rate. */
typedef enum pags_rate_group {
  PAGS_RATE_POSITION,
  PAGS_RATE_SCALE,
  PAGS_RATE_ROTATION,
  PAGS_RATE_OPACITY,
  PAGS_RATE_SH_DC,
  PAGS_RATE_SH_REST,
  PAGS_RATE_FOURIER,
  PAGS_RATE_GROUPS
} pags_rate_group;

/* Purposes of random draws. The argument `a` of the random number functions (base/rng.h) is 16 * step + purpose, so
 * that no two draws of a run share a counter. */
enum {
  PAGS_DRAW_ORDER,
  PAGS_DRAW_SPLIT /* uses 4 numbers */,
  PAGS_DRAW_RELOCATE = 5,
  PAGS_DRAW_ADD,
  PAGS_DRAW_NOISE /* uses 2 numbers */,
  PAGS_DRAW_DROP = 9,
  PAGS_DRAW_PRUNE = 15
};
static inline uint64_t pags_draw(int64_t step, int purpose) {
  return 16u * (uint64_t)step + (uint64_t)purpose;
}

enum { PAGS_MOST_PRUNES = 8 };

/* The least fraction of the schedule at half size, where it follows from the data. */
#define PAGS_LEAST_HALF_UNTIL 0.2

/* The configuration with its steps, which it gives for a run of 30 000, scaled to the length of the run. A step sees
 * `batch` photographs; photographs are numbered from 1 through the run. */
typedef struct pags_schedule {
  pags_train_config config;
  double extent; /* metres */
  int64_t views; /* training views, >= 1 */
  int64_t batch; /* photographs a step, >= 1 */
  /* What a step of `batch` photographs makes of the rates and of Adam's decays (Zhao et al. 2024, arXiv:2406.18533):
   * its root times the rates, its power of the decays. 1, and the configuration's, with one photograph. */
  double rate_factor, beta1, beta2;
  int64_t length; /* number of steps that the schedule is stretched over */
  int64_t densify_from, densify_until, densify_every;
  int64_t reset_every; /* a multiple of densify_every, so that each reset comes right after densify's prune of
                          transparent Gaussians and no such prune follows closely */
  int64_t scale_reset_from, scale_reset_every, scale_reset_until;
  int64_t sh_interval;
  int64_t quarter_until, half_until;
  int64_t tracks_from, fourier_from, object_term_from;
  int prunes;
  int64_t prune_step[PAGS_MOST_PRUNES]; /* rising; during densification, multiples of densify_every, but with preset
                                           paper */
  double prune_rate[PAGS_MOST_PRUNES];  /* the share of Gaussians that each prune removes */
} pags_schedule;

pags_schedule pags_schedule_make(const pags_train_config *config, double extent, int64_t views);

/* The number of steps that see `photographs` photographs, rounded up. */
int64_t pags_schedule_steps(const pags_schedule *schedule, int64_t photographs);

/* What all rates but those of positions are multiplied by at a step: 1 to rate_fall, times rate_factor. */
double pags_schedule_fall(const pags_schedule *schedule, int64_t step);
/* The rates of all groups but that of positions, times `fall`. */
void pags_schedule_falling_rates(const pags_train_config *config, double fall, double rates[PAGS_RATE_GROUPS]);
/* Learning rates of a step; that of positions is in metres. */
void pags_schedule_rates(const pags_schedule *schedule, int64_t step, double rates[PAGS_RATE_GROUPS]);
int pags_schedule_sh_degree(const pags_schedule *schedule, int64_t step);
bool pags_schedule_is_densify(const pags_schedule *schedule, int64_t step);
/* Whether the step pulls Gaussians towards the planes that LiDAR shows (init/lidar_planes.h): at densify's interval,
 * but up to the end of the schedule. */
bool pags_schedule_is_draw(const pags_schedule *schedule, int64_t step);
/* Whether the step lays Gaussians into those planes: after the step densify_from, 20 times as often as densify, since
 * each step of the optimiser lifts some out of them again. */
bool pags_schedule_is_lay(const pags_schedule *schedule, int64_t step);
/* Whether opacities are reset after the step. A reset that would be followed by a prune by score within a third of
 * the interval between resets is put off until after that prune: while opacities haven't recovered, no Gaussian hides
 * another, and the scores say little. */
bool pags_schedule_is_reset(const pags_schedule *schedule, int64_t step);
/* Whether scales are reset after the step: never so late that less than the interval is left to recover. */
bool pags_schedule_is_scale_reset(const pags_schedule *schedule, int64_t step);
/* Returns the number, from 0, of the prune by score that follows a step; -1: none. */
int pags_schedule_prune(const pags_schedule *schedule, int64_t step);
/* Whether densify also prunes Gaussians that are too large: only once an opacity reset has happened, since before it
 * the large Gaussians are those that cover the background. */
bool pags_schedule_prunes_large(const pags_schedule *schedule, int64_t step);
/* Returns the factor by which a photograph of that size is shrunk at a step: 1, 2 or 4. */
int pags_schedule_level(const pags_schedule *schedule, int64_t step, int width, int height);

/* Whether the step is the one after which the length of the phase of half size is decided. */
bool pags_schedule_is_half_decision(const pags_schedule *schedule, int64_t step);
/* Returns the fraction of the schedule at half size for photographs that have `ratio` pixels at their full size for
 * each Gaussian: 0.2 up to 1, 0.6 from 4 on, and linear in the logarithm between. Where Gaussians outnumber pixels,
 * their own work is most of a step's, and small photographs save little (DashGaussian, arXiv:2503.18402, grows both
 * together). */
double pags_schedule_half_until(double ratio);
/* Sets the fraction of the schedule at half size. */
void pags_schedule_set_half_until(pags_schedule *schedule, double fraction);

/* Writes the order of the training views in pass `epoch` (from 0): a random permutation of 0 .. views - 1. */
void pags_schedule_order(const pags_schedule *schedule, int64_t epoch, int64_t *order);

#endif
