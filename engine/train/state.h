/* What a training run consists of between two steps: all that a checkpoint holds. */
#ifndef PAGS_TRAIN_STATE_H
#define PAGS_TRAIN_STATE_H

#include <pags/frame.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "train/adam.h"
#include "train/schedule.h"

/* Statistics since the last densify, per row; zero beyond the rows in use. */
typedef struct pags_density {
  int64_t capacity;
  float *gradient; /* sum of |dL/d mean2D|, NDC, over the views it was drawn in */
  int32_t *seen;   /* how many */
} pags_density;

typedef struct pags_train_state {
  pags_schedule schedule;
  int64_t stop;     /* last step to do; beyond schedule.length after --resume --iterations */
  int64_t step;     /* steps done */
  int64_t resets;   /* opacity resets done */
  int64_t cap;      /* the bound on Gaussians that the run keeps: max_gaussians or what max_memory allows; 0: none */
  int64_t clocked;  /* 1: the length was set from a clock, so it need not be the one asked for */
  double loss, mse; /* running means; 0 steps: 0 */
  pags_gaussians gaussians;
  pags_adam adam;
  pags_density density;
  pags_clusters clusters; /* derived: not in the checkpoint */
} pags_train_state;

/* Takes over `g` (zeroed) as the start of a run of `stop` steps; on failure everything is freed. */
pags_result pags_state_create(pags_train_state *state, const pags_schedule *schedule, int64_t stop, pags_gaussians *g);
void pags_state_destroy(pags_train_state *state);

/* Parameters and moments of all rows current as of the step done, for decisions that look at all of them. */
void pags_state_settle(pags_train_state *state, pags_tasks *tasks);

/* Row i becomes the old row source[i] (all planes, moments, statistics); rows from `fresh` on start with moments of
 * zero. Capacity grows as needed. The clusters no longer fit: sort follows. */
pags_result pags_state_gather(pags_train_state *state, const int64_t *source, int64_t count, int64_t fresh,
                              pags_tasks *tasks);
/* Morton order, clusters and bounds anew. The state must be settled. */
pags_result pags_state_sort(pags_train_state *state, pags_tasks *tasks);
/* Statistics back to zero. */
void pags_state_clear_density(pags_train_state *state);

#endif
