/* SPDX-License-Identifier: Apache-2.0 */
/* Training: from posed photographs to a scene folder.
 *
 * The run is a pure function of (data set, configuration, seed): not of the number of threads, of the moments at
 * which it was interrupted and resumed, of checkpoint_every, log_every or preview_every. The one exception is
 * time_limit_seconds, which reads a clock once.
 *
 * Steps are counted from 1. A step renders one training view, compares it with its photograph and moves the
 * Gaussians. */
#ifndef PAGS_TRAIN_H
#define PAGS_TRAIN_H

#include <pags/base.h>
#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_strategy {
  PAGS_STRATEGY_DEFAULT, /* clone, split, prune and reset (Kerbl et al. 2023) */
  PAGS_STRATEGY_MCMC     /* relocate, grow and shake (Kheradmand et al. 2024) */
} pags_strategy;

/* When the Gaussians with the lowest scores are removed (docs/priority.md). */
typedef enum pags_preset {
  PAGS_PRESET_NONE,
  PAGS_PRESET_LEAN,  /* after 4000, 8000, 12 000, 16 000 and 20 000 of 30 000 steps: what was measured to lose least for
                        its time */
  PAGS_PRESET_SHORT, /* at 10 000, 15 000, 20 000 and 25 000 of 30 000 steps */
  PAGS_PRESET_PAPER  /* at 10 000, 15 000, ... 45 000 of 50 000 steps */
} pags_preset;

/* How S_hybrid comes of S_sem and S_grad. */
typedef enum pags_hybrid {
  PAGS_HYBRID_OF_PRESET, /* PRODUCT with LEAN, otherwise SUM */
  PAGS_HYBRID_SUM,       /* alpha S_sem + (1 - alpha) S_grad: the paper's */
  PAGS_HYBRID_PRODUCT /* (1 - alpha + alpha S_sem) S_grad: what isn't critical must matter 1 / (1 - alpha) times as much
                         to be kept */
} pags_hybrid;

/* How S_sem, the share of a Gaussian that shows something critical, is found. */
typedef enum pags_s_sem {
  PAGS_S_SEM_PASS,   /* by its weight in the training photographs' pixels (alpha T), anew before each prune */
  PAGS_S_SEM_INIT,   /* once, at the start */
  PAGS_S_SEM_OVERLAP /* as PASS, by alpha alone: as if nothing hid anything */
} pags_s_sem;

/* How S_grad is brought to 0..1 ... */
typedef enum pags_s_grad { PAGS_S_GRAD_RANK, PAGS_S_GRAD_MINMAX, PAGS_S_GRAD_LOG } pags_s_grad;
/* ... and where it comes from: a pass over the training views, or the loss's own gradients since the last prune. */
typedef enum pags_s_grad_from { PAGS_S_GRAD_FROM_PASS, PAGS_S_GRAD_FROM_TRAINING } pags_s_grad_from;

/* Every constant of the training. Fields said to be "of 30 000" are steps of a run of 30 000 iterations and are
 * multiplied by schedule_iterations / 30 000 (design: one set of constants for any length). `extent` is 1.1 times the
 * largest distance of a training camera from their mean, metres. */
typedef struct pags_train_config {
  uint32_t cookie; /* set by pags_train_config_default; a struct that doesn't come from there is refused */

  /* Run */
  int64_t iterations; /* steps in all; default 30000, 1 to 10 million */
  int64_t
      schedule_iterations; /* steps the schedule is stretched over; 0: iterations. Steps beyond run at its end rates */
  uint64_t seed;           /* of everything random; default 0 */

  /* Optimiser: Adam, one rate per group of planes */
  double position_rate_begin; /* times extent, at step 0; default 1.6e-4 */
  double position_rate_end;   /* times extent, at the schedule's end (log-linear between); default 1.6e-6 */
  double scale_rate;          /* per step, of ln sigma; default 0.005 */
  double rotation_rate;       /* of the raw quaternion; default 0.001 */
  double opacity_rate;        /* of the logit; default 0.05 */
  double sh_dc_rate;          /* of the constant term; default 0.0025 */
  double sh_rest_rate;        /* of the higher terms; default 0.000125 */
  double beta1, beta2;        /* decay of the first and second moment; default 0.9 and 0.999 */
  double epsilon;             /* added to the root of the second moment; default 1e-15 */

  /* Loss */
  double ssim_weight; /* w of (1 - w) L1 + w (1 - SSIM), 0..1; default 0.2 */

  /* Start: the data set's points; where it has none, points found by matching its photographs */
  int random_start;      /* 1: random points in the cameras' common view there. Default 0 */
  double init_opacity;   /* 0.004..0.999 (1/255 is not drawn), default 0.1 */
  double init_scale;     /* times the root mean square distance to the 3 nearest neighbours; default 1 */
  double init_scale_max; /* upper bound of the first sigma, times extent; default 0.1 */

  /* Colour */
  int sh_degree;       /* highest degree, 0..3; default -1: 3 for static sets, 1 for driving ones */
  int64_t sh_interval; /* one degree more every so many steps of 30 000; default 1000 */

  /* Resolution: the first steps see shrunk photographs */
  double quarter_until; /* share of the schedule at 1/4 of the size, 0..1; default 0.05 */
  double half_until;    /* share of the schedule (from 0) at 1/2 or less; default 0.2 */
  int resolution_floor; /* a level is skipped where the shorter side would fall under so many pixels; default 64 */

  /* Density */
  pags_strategy strategy; /* default PAGS_STRATEGY_DEFAULT */
  int64_t densify_from;   /* first step (exclusive) of 30 000; default 500 */
  int64_t densify_until;  /* last step (exclusive) of 30 000; default -1: 15000 (MCMC's paper: 25000); 12000 with preset
                             LEAN, 25000 with SHORT */
  int64_t densify_every;  /* steps of 30 000, but at least one pass over the training views; default 100 */
  double densify_gradient; /* mean NDC gradient above which a Gaussian is cloned or split; default 2e-4 */
  int absgrad;             /* 1: statistics from absolute per-pixel gradients (Ye et al. 2024). Default 0 */
  double absgrad_gradient; /* the threshold then; default 8e-4 */
  double dense_percent;    /* of extent: a larger sigma is split, a smaller cloned; default 0.01 */
  double split_divisor;    /* children's sigma = parent's over this; default 1.6 */
  int revised_opacity;     /* 1: split children get 1 - sqrt(1 - o) (Rota Bulo et al. 2024). Default 0 */
  double prune_opacity;    /* below: removed; default 0.005 */
  double prune_scale;      /* of extent: a larger sigma is removed once an opacity reset has been; default 0.1 */
  int64_t
      reset_every; /* opacity reset, steps of 30 000, but at least three passes; until densify_until; default 3000 */
  double reset_opacity;  /* upper bound set then, 0.004..1; default 0.01 */
  int64_t max_gaussians; /* never exceeded; 0: no bound but 2^31 - 64 (MCMC: 1 000 000). With a preset: kept from the
                            last prune on, which removes those with the lowest scores; until then the run may have more.
                            Default 0 */

  /* Priority: scores and pruning by them (docs/priority.md) */
  pags_preset preset;     /* default PAGS_PRESET_NONE; others not with MCMC */
  double alpha;           /* how much of S_hybrid is semantic, and with LEAN of the loss, 0..1; default 0.4 */
  pags_hybrid hybrid;     /* default PAGS_HYBRID_OF_PRESET */
  double critical_weight; /* how often a critical pixel counts in the photometric loss, 1..100; default -1: 1 + 5 alpha
                             with LEAN, otherwise 1 */
  double critical_growth; /* how often where densify decides what to clone and split, 1..100: the mean gradient times
                             (1 + (critical_growth - 1) s_sem) / (1 + (critical_weight - 1) s_sem). Default -1: as
                             critical_weight */
  double prune_early;  /* share removed at the first three prunes, 0..0.99; default -1: 0.5 with LEAN, otherwise 0.6 */
  double prune_late;   /* at those after; default -1: 0.2 with LEAN, otherwise 0.3 */
  int64_t prune_floor; /* no object is pruned below so many; default 500 */
  pags_s_sem s_sem;    /* default PAGS_S_SEM_PASS */
  pags_s_grad s_grad;  /* default PAGS_S_GRAD_RANK */
  pags_s_grad_from s_grad_from; /* default PAGS_S_GRAD_FROM_PASS */

  /* What the scene may store */
  double target_size; /* MB (10^6 bytes) of the scene folder's scene.json, models and sky: no more Gaussians than fit;
                         0: no bound. Default 0 */
  double
      sh_error; /* 255ths: each Gaussian of the finished scene keeps the lowest SH degree that changes its colour,
                   from any direction    in which a training view sees it, by no more; 0: all keep theirs. Default 0 */

  /* Adaptive stochastic dropout */
  int dropout;         /* 1: each step leaves Gaussians out at random. Default 0 */
  double dropout_beta; /* 0..1: how much semantic priority protects; default 0.5 */
  double
      dropout_gamma; /* share left out at the schedule's end where there is no priority, rising from 0; default 0.25 */

  /* MCMC strategy */
  double mcmc_growth;      /* share of new Gaussians per densify step; default 0.05 */
  double mcmc_noise;       /* of the position noise, times the position rate; default 5e5 */
  double mcmc_opacity_reg; /* weight of the mean opacity in the loss; default 0.01 */
  double mcmc_scale_reg;   /* weight of the mean sigma in the loss; default 0.01 */

  /* Picture */
  double near_plane;    /* metres; default 0.01 */
  double low_pass;      /* px^2; default 0.3 */
  int antialiased;      /* 1: Mip-Splatting's 2D filter; default 0 */
  double background[3]; /* display-referred sRGB, default 0 0 0 */
  int cluster_size;     /* Gaussians culled together: a multiple of 16 up to 256; default 64 */

  /* Driving sets. Weights and rates after Street Gaussians (Yan et al. 2024) unless said otherwise */
  double extent_most;  /* metres: the background's extent is no larger; default 20 */
  int objects;         /* 1: tracks that move get Gaussians of their own; 0: all is background. Default 1 */
  int box_prune;       /* 1: an object's Gaussians outside of its box, enlarged by half, are removed at each densify.
                          Default 1 */
  int tracks;          /* 1: poses of moving objects are optimised. Default 1 */
  int64_t tracks_from; /* of 30 000: held fixed until then; default 3000 */
  double track_translation_rate; /* metres a step in a run that visits each photograph 100 times (inversely more or less
                                    in others, by 4 at most), falling to a tenth; default 3e-3 */
  double track_rotation_rate;    /* radians, likewise; default 3e-4 */
  int fourier;                   /* 1: objects' colour may change over time where that pays. Default 1 */
  int64_t fourier_from;          /* of 30 000: when that is decided; default 15000 */
  double fourier_gain;           /* dB that it must promise on the object's pixels; default 0.1 */
  int sky;                       /* 1: a cube map where training views show sky; 0: none. Default 1 */
  double sky_rate;               /* of texels, falling to a hundredth; default 0.01 */
  double sky_weight;             /* of the sky opacity term; default 0.05 */
  int lidar_start;               /* 1: LiDAR points to start from. Default 1 */
  double depth_weight;           /* of the LiDAR depth term, per metre; default 0.01 */
  double depth_share;            /* of samples that count, the best ones; default 0.95 */
  double lidar_pull;    /* 0..1: share of the way to a plane that LiDAR shows nearby by which the background's Gaussians
                           are moved at    each interval of densify (docs/driving.md); 0: none. Default 0 */
  double object_weight; /* of the object opacity term, from densify_until on; default 0.1 */
  int exposure; /* 1: a gain and an offset per channel of each camera and, beside it, of each photograph. Default 1 */
  double exposure_rate; /* of these, falling to a tenth; default 3e-3 */
} pags_train_config;

PAGS_API pags_train_config pags_train_config_default(void);

/* Checks the cookie and every range; the message names the field. */
PAGS_API pags_result pags_train_config_check(const pags_train_config *config);

/* Sets the field `name` (as above; background is background_r, _g, _b; strategy "default" or "mcmc") from text.
 * PAGS_ERROR_ARGUMENT names an unknown field or a value that is no number. */
PAGS_API pags_result pags_train_config_set(pags_train_config *config, const char *name, const char *value);

/* The i-th field's name, or NULL beyond the last; its value and default as text go to the buffers (any may be NULL). */
PAGS_API const char *pags_train_config_field(const pags_train_config *config, int index, char *value,
                                             size_t value_size);

/* What a step tells. Running figures are exponential means over about one pass of the training views. */
typedef struct pags_train_progress {
  int64_t step, iterations;
  double it_per_second; /* over the last second or so, waiting included */
  int64_t gaussians;
  double loss;    /* running */
  double psnr;    /* running, dB, of the training views at the present level */
  double seconds; /* of this process's training, time inside of callbacks left out */
  double eta_seconds;
  int level;        /* 1, 2 or 4: how much the photographs are shrunk */
  int64_t bad_rows; /* as in the result */
} pags_train_progress;

/* Returning 0 stops as options.cancel does. */
typedef int pags_train_progress_fn(void *user, const pags_train_progress *progress);

/* `gaussians` is a copy brought up to date, valid during the call. */
typedef void pags_train_snapshot_fn(void *user, const pags_train_progress *progress, const pags_gaussians *gaussians,
                                    const double origin[3]);

typedef struct pags_train_options {
  const pags_dataset *dataset; /* must hold at least one training view */
  const char *output;          /* scene folder */
  pags_tasks *tasks;
  uint64_t image_cache;     /* bytes for decoded photographs; default 1 GiB */
  uint64_t max_memory;      /* bytes; converted to a bound on Gaussians by pags_train_bytes. 0: none */
  int64_t checkpoint_every; /* steps; 0: only when stopped or done. Default 1000 */
  int64_t log_every;        /* steps per line of log.jsonl; default 100 */
  int64_t preview_every;    /* steps per preview PNG; 0: none. Default 1000 */
  int resume;    /* 1: go on from the folder's checkpoint, or start where there is neither that nor a scene */
  int overwrite; /* 1: a non-empty folder is trained into afresh */
  double time_limit_seconds; /* > 0: iterations are set once, from the speed measured early, to fit. Not reproducible */
  int64_t
      bad_rows_most; /* more such updates left out (pags_train_result.bad_rows) are PAGS_ERROR_LIMIT; default 1000 */
  int estimate;      /* 1: run 50 steps, fill the estimates of the result, write nothing */
  const volatile int *cancel; /* polled once a step; non-zero stops, with checkpoint and scene written. May be NULL */
  pags_train_progress_fn *progress; /* after every step; may be NULL */
  void *progress_user;
  int64_t snapshot_every;           /* steps; 0: never */
  pags_train_snapshot_fn *snapshot; /* may be NULL */
  void *snapshot_user;
} pags_train_options;

PAGS_API pags_train_options pags_train_options_default(void);

typedef struct pags_train_result {
  int finished;       /* 0: stopped before the last step */
  int resumed;        /* 1: went on from a checkpoint */
  int64_t iterations; /* steps done, those before a resume included */
  int64_t gaussians;
  double seconds;               /* of training in this process: set-up, decoding and files included, callbacks not */
  double iterations_per_second; /* over the last tenth of the run; over what this process ran of it */
  uint64_t peak_rss_bytes;      /* of the process */
  double loss, psnr;            /* running figures at the end */
  int64_t bad_rows; /* updates left out because a gradient or a parameter wasn't finite, over the whole run: a Gaussian,
                       an object's pose or a view's exposure each that didn't move in a step. None of it spreads */
  char first_bad_row[256];    /* what and where the first of them was, in words; empty: none */
  uint64_t heap_calls_steady; /* heap calls of the frame in the last tenth of the run */
  double ms_wait, ms_forward, ms_loss, ms_backward, ms_density; /* mean per step of this process */
  double estimated_seconds;                                     /* options.estimate: of the whole run */
  uint64_t estimated_bytes; /* options.estimate: of memory at the bound on Gaussians, or at 8 times the start */
} pags_train_result;

/* Trains and leaves in options->output: scene.json and background.ply, checkpoint.pags, log.jsonl, report.json,
 * preview PNGs. `config` is what a fresh run uses. A resumed run takes the checkpoint's; fields that differ are
 * refused by name, except for iterations, which may be larger (the run goes on at the end-of-schedule rates),
 * max_gaussians before a preset's last prune, and except after a time limit. A non-empty folder is refused, untouched,
 * without resume or overwrite; so is, without overwrite, one with a scene but no checkpoint. Stopping early is PAGS_OK
 * with finished = 0. PAGS_CANCELLED when pags_tasks_cancel was called: then the last checkpoint stands and nothing is
 * written. */
PAGS_API pags_result pags_train(const pags_train_config *config, const pags_train_options *options,
                                pags_train_result *result);

/* Bytes a training of `gaussians` of that degree at the given largest picture needs at most, image cache and sky left
 * out: the statement that max_memory, less these, is converted by. */
PAGS_API uint64_t pags_train_bytes(int64_t gaussians, int sh_degree, int width, int height);

#ifdef __cplusplus
}
#endif
#endif
