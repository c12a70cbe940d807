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

/* Every constant of the training. engine/train/fields.c holds the one table of them: name, type, default, range, unit
 * and text; `pags train --fields` prints it. `set`, checkpoints and scene.json call a member by its own name, without
 * that of its struct. Members counted in "steps of 30 000" are steps of a run of 30 000 iterations: they are multiplied
 * by schedule_iterations / 30 000, so that one set of constants serves runs of any length. `extent` is 1.1 times the
 * largest distance of a training camera from their mean, in metres. int members are 0 or 1 where no unit is given. */

/* How long, from which seed, and at which resolution. The first steps see shrunk photographs. */
typedef struct pags_train_schedule {
  int64_t iterations;          /* steps of the run */
  int64_t schedule_iterations; /* steps that the schedule is stretched over; 0: iterations. Later steps keep its last
                                  rates */
  uint64_t seed;               /* any number: of everything that is random */
  double quarter_until;        /* fraction of the schedule that sees photographs at a quarter of their size */
  double half_until;           /* fraction of the schedule, counted from 0, that sees them at half size or less */
  int resolution_floor;        /* px: a level is skipped where the shorter side would be smaller */
} pags_train_schedule;

/* Adam (Kingma and Ba 2015), with one learning rate for each group of planes. */
typedef struct pags_train_optimiser {
  double position_rate_begin; /* fraction of extent per step, at step 0 */
  double position_rate_end;   /* fraction of extent per step, at the schedule's end; log-linear between */
  double scale_rate;          /* per step, of ln sigma */
  double rotation_rate;       /* per step, of the raw quaternion */
  double opacity_rate;        /* per step, of the logit of opacity */
  double sh_dc_rate;          /* per step, of the constant term of colour */
  double sh_rest_rate;        /* per step, of the higher terms of colour */
  double beta1, beta2;        /* fraction kept per step of the first and the second moment */
  double epsilon;             /* added to the root of the second moment */
} pags_train_optimiser;

/* Weights of the loss. The terms of driving sets follow Street Gaussians (Yan et al. 2024). */
typedef struct pags_train_losses {
  double ssim_weight;   /* w of (1 - w) L1 + w (1 - SSIM) */
  double depth_weight;  /* of the LiDAR depth term, per metre */
  double depth_share;   /* fraction of the LiDAR samples that count: those with the smallest error */
  double object_weight; /* of the object opacity term, from densify_until on */
  double sky_weight;    /* of the sky opacity term */
} pags_train_losses;

/* The first Gaussians: from the data set's points; where it has none, from points found by matching photographs. */
typedef struct pags_train_start {
  int random_start;      /* 1: random points in the cameras' common view in place of matched ones */
  double init_opacity;   /* opacity, more than 1/255, below which nothing is drawn */
  double init_scale;     /* sigma, times the root mean square distance to the 3 nearest neighbours */
  double init_scale_max; /* upper bound of that sigma, fraction of extent */
  int lidar_start;       /* 1: driving sets start from LiDAR points */
  double extent_most;    /* metres: upper bound of the extent of a driving set's background */
} pags_train_start;

/* Spherical harmonics of the colour. */
typedef struct pags_train_color {
  int sh_degree;       /* highest degree; -1: 3 for static sets, 1 for driving ones */
  int64_t sh_interval; /* steps of 30 000 from one degree to the next */
} pags_train_color;

/* Density control (Kerbl et al. 2023). */
typedef struct pags_train_density {
  pags_strategy strategy;
  int64_t densify_from;  /* steps of 30 000: densify after this step */
  int64_t densify_until; /* steps of 30 000: densify before this step; -1: 15000; with preset LEAN 12000, SHORT 25000 */
  int64_t densify_every; /* steps of 30 000, but at least one pass over the training views */
  double densify_gradient; /* NDC: a Gaussian with a larger mean screen gradient is cloned or split */
  int absgrad;             /* 1: the mean of absolute per-pixel gradients (Ye et al. 2024) */
  double absgrad_gradient; /* NDC: the threshold with absgrad */
  double dense_percent;    /* fraction of extent: a larger sigma is split, a smaller one cloned */
  double split_divisor;    /* a child's sigma is its parent's over this */
  int revised_opacity;     /* 1: children of a split get 1 - sqrt(1 - o) (Rota Bulo et al. 2024) */
  double prune_opacity;    /* opacity: Gaussians below are removed */
  double prune_scale;      /* fraction of extent: Gaussians with a larger sigma are removed after the first reset */
  int64_t reset_every;     /* steps of 30 000 between opacity resets, but at least three passes; until densify_until */
  double reset_opacity;    /* upper bound of opacity that a reset sets */
  double lidar_pull;       /* fraction of the way to a plane that LiDAR shows nearby, by which each densify interval
                              moves Gaussians of the background (docs/driving.md); 0: none */
} pags_train_density;

/* The strategy MCMC (Kheradmand et al. 2024). */
typedef struct pags_train_mcmc {
  double mcmc_growth;      /* fraction of new Gaussians per densify step */
  double mcmc_noise;       /* position noise, times the position rate */
  double mcmc_opacity_reg; /* weight of the mean opacity in the loss */
  double mcmc_scale_reg;   /* weight of the mean sigma in the loss */
} pags_train_mcmc;

/* How large the scene may become. */
typedef struct pags_train_size_limit {
  int64_t max_gaussians; /* Gaussians; 0: 2^31 - 64 (MCMC: 1 000 000). With a preset the run may have more until the
                            last prune, which keeps those with the highest scores */
  double target_size;    /* MB (10^6 bytes) of the scene folder's scene.json, models and sky; 0: none */
  double sh_error;       /* 255ths: each Gaussian of the finished scene keeps the lowest SH degree that changes its
                            colour, in any direction from which a training view sees it, by no more; 0: all keep theirs */
} pags_train_size_limit;

/* Scores, pruning by them, and adaptive stochastic dropout (docs/priority.md). */
typedef struct pags_train_priority {
  pags_preset preset;     /* others than NONE not with MCMC */
  double alpha;           /* fraction of S_hybrid, and with LEAN of the loss, that is semantic */
  pags_hybrid hybrid;     /* how S_hybrid comes of S_sem and S_grad */
  double critical_weight; /* times a critical pixel counts in the photometric loss; -1: 1 + 5 alpha with LEAN, else 1 */
  double critical_growth; /* times it counts for densify: the mean gradient is multiplied by (1 + (critical_growth - 1)
                             s_sem) / (1 + (critical_weight - 1) s_sem). -1: as critical_weight */
  double prune_early;     /* fraction removed at each of the first three prunes; -1: 0.5 with LEAN, else 0.6 */
  double prune_late;      /* fraction removed at each later prune; -1: 0.2 with LEAN, else 0.3 */
  int64_t prune_floor;    /* Gaussians: no object is pruned below */
  pags_s_sem s_sem;
  pags_s_grad s_grad;
  pags_s_grad_from s_grad_from;
  int dropout;          /* 1: each step leaves Gaussians out at random */
  double dropout_beta;  /* 0..1: how much semantic priority protects a Gaussian from dropout */
  double dropout_gamma; /* fraction left out by the last step of those without priority; rises from 0 */
} pags_train_priority;

/* How pictures are drawn. */
typedef struct pags_train_picture {
  double near_plane;    /* metres */
  double low_pass;      /* px^2, added to both variances on the screen */
  int antialiased;      /* 1: the 2D filter of Mip-Splatting */
  double background[3]; /* display-referred sRGB, 0..1; its fields are background_r, _g and _b */
  int cluster_size;     /* Gaussians culled together, a multiple of 16; changes speed, not results */
} pags_train_picture;

/* Moving objects of driving sets (Street Gaussians). */
typedef struct pags_train_objects {
  int objects;                   /* 1: a track that moves has Gaussians of its own; 0: all is background */
  int box_prune;                 /* 1: densify removes an object's Gaussians outside of its box enlarged by half */
  int tracks;                    /* 1: poses of moving objects are optimised */
  int64_t tracks_from;           /* steps of 30 000 for which poses are held fixed */
  double track_translation_rate; /* metres per step in a run that visits each photograph 100 times (inversely more or
                                    less in others, by 4 at most), falling to a tenth */
  double track_rotation_rate;    /* radians per step, likewise */
  int fourier;                   /* 1: an object's colour may change over time where that pays */
  int64_t fourier_from;          /* steps of 30 000: when that is decided */
  double fourier_gain;           /* dB that it must promise on the object's pixels */
} pags_train_objects;

typedef struct pags_train_sky {
  int sky;         /* 1: a cube map where training views show sky */
  double sky_rate; /* per step, of texels, falling to a hundredth */
} pags_train_sky;

typedef struct pags_train_exposure {
  int exposure;         /* 1: a gain and an offset per channel of each camera and, beside it, of each photograph */
  double exposure_rate; /* per step, of these, falling to a tenth */
} pags_train_exposure;

typedef struct pags_train_config {
  uint32_t cookie; /* set by pags_train_config_default; a struct that doesn't come from there is refused */
  pags_train_schedule schedule;
  pags_train_optimiser optimiser;
  pags_train_losses losses;
  pags_train_start start;
  pags_train_color color;
  pags_train_density density;
  pags_train_mcmc mcmc;
  pags_train_size_limit size_limit;
  pags_train_priority priority;
  pags_train_picture picture;
  pags_train_objects objects;
  pags_train_sky sky;
  pags_train_exposure exposure;
} pags_train_config;

PAGS_API pags_train_config pags_train_config_default(void);

/* Checks the cookie and every range; the message names the field. */
PAGS_API pags_result pags_train_config_check(const pags_train_config *config);

typedef enum pags_field_type {
  PAGS_FIELD_SWITCH, /* int, 0 or 1 */
  PAGS_FIELD_INT,    /* int */
  PAGS_FIELD_INT64,  /* int64_t */
  PAGS_FIELD_UINT64, /* uint64_t */
  PAGS_FIELD_DOUBLE, /* double */
  PAGS_FIELD_CHOICE  /* int, the index in `choices` */
} pags_field_type;

enum { PAGS_FIELD_AUTO = -1 }; /* the value of a field that follows its rule */

/* A row of the table of fields. */
typedef struct pags_train_field {
  const char *name;  /* "densify_from"; background has three: background_r, _g, _b */
  const char *group; /* "density", the struct that it lies in */
  pags_field_type type;
  size_t offset;       /* of the value in pags_train_config, bytes */
  double standard;     /* the default */
  double least, most;  /* both included */
  const char *choices; /* "default|mcmc"; NULL for other types */
  const char *unit;    /* "1": no unit */
  const char *rule;    /* "auto: ...", what PAGS_FIELD_AUTO means; NULL: the field has no such value */
  const char *text;    /* what a value does, in the imperative */
} pags_train_field;

/* The i-th row, or NULL beyond the last; rows of a group follow each other. */
PAGS_API const pags_train_field *pags_train_field_at(int index);
/* The row of that name, or NULL. */
PAGS_API const pags_train_field *pags_train_field_find(const char *name);

/* Sets the field `name` from text: a number, "auto" where the field has a rule, one of its choices.
 * PAGS_ERROR_ARGUMENT names an unknown field or a value that is no number. Ranges are left to the check. */
PAGS_API pags_result pags_train_config_set(pags_train_config *config, const char *name, const char *value);

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
  double time_limit_seconds; /* seconds; > 0: the number of steps is chosen once, from the speed measured early, so that
                                the run takes this long; not reproducible. 0: no limit */
  int64_t bad_rows_most;     /* more updates left out (bad_rows of the result) are PAGS_ERROR_LIMIT; default 1000 */
  int estimate;              /* 1: run 50 steps, fill the estimates of the result, write nothing */
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
