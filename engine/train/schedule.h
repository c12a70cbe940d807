/* SPDX-License-Identifier: Apache-2.0 */
/* What happens at which step: pure functions of (configuration, extent, number of training views, step). */
#ifndef PAGS_TRAIN_SCHEDULE_H
#define PAGS_TRAIN_SCHEDULE_H

#include <pags/train.h>

/* Groups of planes that share a rate. */
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

/* The `a` of a random draw is 16 * step + purpose, so that no two draws of a run share a counter. */
enum {
  PAGS_DRAW_ORDER,
  PAGS_DRAW_SPLIT /* 4 of them */,
  PAGS_DRAW_RELOCATE = 5,
  PAGS_DRAW_ADD,
  PAGS_DRAW_NOISE /* 2 */,
  PAGS_DRAW_DROP = 9,
  PAGS_DRAW_PRUNE = 15
};
static inline uint64_t pags_draw(int64_t step, int purpose) {
  return 16u * (uint64_t)step + (uint64_t)purpose;
}

enum { PAGS_MOST_PRUNES = 8 };

/* The configuration's steps of 30 000, resolved. */
typedef struct pags_schedule {
  pags_train_config config;
  double extent;  /* metres */
  int64_t views;  /* training views, >= 1 */
  int64_t length; /* steps the schedule is stretched over */
  int64_t densify_from, densify_until, densify_every;
  int64_t reset_every; /* a multiple of densify_every, so that a prune precedes each reset and none follows closely */
  int64_t sh_interval;
  int64_t quarter_until, half_until;
  int64_t tracks_from, fourier_from;
  int prunes;
  int64_t prune_step[PAGS_MOST_PRUNES]; /* rising; while densifying, multiples of densify_every */
  double prune_rate[PAGS_MOST_PRUNES];  /* the share that each removes */
} pags_schedule;

pags_schedule pags_schedule_make(const pags_train_config *config, double extent, int64_t views);

/* Learning rates of a step, positions' in metres. */
void pags_schedule_rates(const pags_schedule *schedule, int64_t step, double rates[PAGS_RATE_GROUPS]);
int pags_schedule_sh_degree(const pags_schedule *schedule, int64_t step);
int pags_schedule_is_densify(const pags_schedule *schedule, int64_t step);
/* Whether Gaussians are drawn to the planes that LiDAR shows (init/lidar_planes.h): at densify's interval, but up to
 * the end. */
int pags_schedule_is_draw(const pags_schedule *schedule, int64_t step);
/* A reset that a prune follows within a third of the interval between resets waits for it: scores taken of Gaussians
 * that have not recovered say little, as nothing hides anything. */
int pags_schedule_is_reset(const pags_schedule *schedule, int64_t step);
/* Which prune by score follows a step, from 0; -1: none. */
int pags_schedule_prune(const pags_schedule *schedule, int64_t step);
/* Gaussians too large are pruned only once an opacity reset has been: before it, large is what covers the background.
 */
int pags_schedule_prunes_large(const pags_schedule *schedule, int64_t step);
/* 1, 2 or 4 for a photograph of that size. */
int pags_schedule_level(const pags_schedule *schedule, int64_t step, int width, int height);

/* The order of the training views in pass `epoch` (from 0): a permutation of 0 .. views - 1. */
void pags_schedule_order(const pags_schedule *schedule, int64_t epoch, int64_t *order);

#endif
