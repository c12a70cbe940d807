/* SPDX-License-Identifier: Apache-2.0 */
/* Training: from a data set of posed photographs to a scene folder.
 *
 * The result is a pure function of the data set, the configuration and the seed: it doesn't depend on the number of
 * threads, on when the run was interrupted and resumed, or on checkpoint_every, log_every and preview_every. The one
 * exception is time_limit_seconds, with which the number of steps depends on the speed of the machine.
 *
 * Steps are counted from 1. A step renders one training view, compares the picture with the photograph and
 * updates the Gaussians by the gradient of the loss. */
#ifndef PAGS_TRAIN_H
#define PAGS_TRAIN_H

#include <pags/base.h>
#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

/* ---- The configuration ---- */

/* The strategy of density control, which adds and removes Gaussians. */
typedef enum pags_strategy {
  PAGS_STRATEGY_DEFAULT, /* clone, split, prune and reset opacities (Kerbl et al. 2023) */
  PAGS_STRATEGY_MCMC     /* relocate, grow and add noise to positions (Kheradmand et al. 2024) */
} pags_strategy;

/* Chooses the value of each field that is left to it (PAGS_FIELD_AUTO); fields that are set keep their value. */
typedef enum pags_preset {
  PAGS_PRESET_DEFAULT, /* short lists and few Gaussians at full quality (docs/train.md) */
  PAGS_PRESET_PLAIN,   /* the training of Kerbl et al. (2023): the baseline of comparisons */
  /* PLAIN with scores, pruning and dropout as the paper of PAGS states them (arXiv:2510.12282), for 50 000 steps. */
  PAGS_PRESET_PAPER
} pags_preset;
enum { PAGS_PRESETS = PAGS_PRESET_PAPER + 1 };

/* How prunes score a Gaussian: S_hybrid combines a semantic score S_sem, 0..1, the share of the Gaussian that shows
 * something critical, and a gradient score S_grad, 0..1, the percentile rank of the squared derivatives of the pixels'
 * colour by the projected Gaussian's value (Speedy-Splat, Hanson et al. 2025), summed over pixels. Copies by clone and
 * split inherit S_sem. Measured against each other in docs/lab/paper.md. */
typedef enum pags_score {
  PAGS_SCORE_AUTO, /* DEFAULT, with preset PAPER PAPER */
  /* S_hybrid = (1 - alpha + alpha S_sem) S_grad: to be kept, a Gaussian that isn't critical needs 1 / (1 - alpha) times
   * the S_grad of a critical one. A pass over the training views before each prune measures both. S_sem: by the
   * Gaussian's blending weights (alpha T), measured once more at the end. */
  PAGS_SCORE_DEFAULT,
  /* The paper's, S_hybrid = alpha S_sem + (1 - alpha) S_grad. S_sem: once, before the first step; the mean, over the
   * labelled views that show the Gaussian, of the critical share of its alpha, as if nothing were hidden. S_grad: of
   * the training's own steps since the last prune, as they were drawn: at their size, and without the Gaussians that
   * dropout left out. */
  PAGS_SCORE_PAPER
} pags_score;

/* The structs below hold every constant of the training. Their fields are listed in one table,
 * engine/train/fields.c, with name, type, default, range, unit and text; `pags train --fields` prints it, and
 * pags_train_field_at reads it. pags_train_config_set, checkpoints and scene.json call a member by its own name,
 * without the name of its struct.
 *
 * Members in "steps of 30 000" are steps of a run of 30 000 iterations: they are multiplied by
 * schedule_iterations / 30 000, so that one set of constants serves runs of any length. `extent` is, in metres,
 * 1.1 times the largest distance of a training camera from the mean of the training cameras (for the model of an
 * object: half of the longest side of its box). int members without a unit are 0 or 1. */

/* Length, seed and resolution of the run. The first steps see shrunk photographs. */
typedef struct pags_train_schedule {
  pags_preset preset;          /* chooses all values that are PAGS_FIELD_AUTO */
  int64_t iterations;          /* photographs of the run, each counted as often as it is seen; steps times batch */
  int64_t schedule_iterations; /* photographs that the schedule is stretched over; 0: iterations. Steps beyond them keep
                                  the schedule's last rates */
  /* Photographs a step, 1 to 64. The last step is full, even where iterations isn't a multiple. All of a step's
   * photographs see the same parameters; the bits of a run depend on this number. Learning rates are multiplied by its
   * root and Adam's decays raised to its power (Zhao et al. 2024, arXiv:2406.18533), except those of poses and
   * exposures, which move once for each photograph, at the step's end. */
  int batch;
  uint64_t seed;        /* seed of everything that is random; any number */
  double quarter_until; /* fraction of the schedule during which photographs have a quarter of their size */
  /* Fraction of it, from its begin, during which they have half of their size or less; auto: 0.2 to 0.6, decided after
   * 0.2 from the pixels that a photograph has for each Gaussian (pags_schedule_half_until). scene.json and checkpoints
   * have what was decided. */
  double half_until;
  int resolution_floor; /* px: a smaller size is skipped if its shorter side would be less than this */
} pags_train_schedule;

/* Adam (Kingma and Ba 2015), with one learning rate for each group of planes. */
typedef struct pags_train_optimiser {
  double position_rate_begin; /* rate of means at step 0: fraction of extent per step */
  double position_rate_end;   /* rate of means at the end of the schedule, likewise; log-linear between the two */
  double scale_rate;          /* per step, of ln sigma */
  double rotation_rate;       /* per step, of the quaternion as stored, not normalised */
  double opacity_rate;        /* per step, of the logit of opacity */
  double sh_dc_rate;          /* per step, of the constant SH term */
  double sh_rest_rate;        /* per step, of the higher SH terms */
  double rate_fall;           /* share of themselves to which the last five fall; log-linear */
  double rate_fall_from;      /* they fall from this share of the schedule on, to its end */
  double beta1, beta2;        /* decay per step of the first and the second moment: the fraction that is kept */
  double epsilon;             /* added to the square root of the second moment */
} pags_train_optimiser;

/* Weights of the loss. The terms for driving sets follow Street Gaussians (Yan et al. 2024). */
typedef struct pags_train_losses {
  double ssim_weight;   /* w of the photometric loss (1 - w) L1 + w (1 - SSIM) */
  double depth_weight;  /* weight of the LiDAR depth term, per metre */
  double depth_share;   /* fraction of the LiDAR samples that count: those with the smallest errors */
  double object_weight; /* weight of the object opacity term, which acts in the second half of the schedule */
  double sky_weight;    /* weight of the sky opacity term */
} pags_train_losses;

/* The first Gaussians. They are made from the points of the data set, or, if it has none, from points that
 * matching the photographs finds (pags_dataset_match_points). */
typedef struct pags_train_start {
  double init_opacity; /* their opacity; more than 1/255, below which nothing is drawn */
  int lidar_start;     /* 1: driving sets start from LiDAR points */
  int lidar_points;    /* LiDAR points of the background to start from, at most, merged by voxels; without objects' */
} pags_train_start;

/* Spherical harmonics of the colour. */
typedef struct pags_train_color {
  int sh_degree;       /* highest degree, 0..3; -1: 3 for static sets, 1 for driving sets */
  int64_t sh_interval; /* steps of 30 000 from one degree to the next, from 0 up; 0: the highest degree at once */
} pags_train_color;

/* Density control (Kerbl et al. 2023). */
typedef struct pags_train_density {
  pags_strategy strategy;
  int64_t densify_from;    /* steps of 30 000: densify only after this step */
  int64_t densify_until;   /* steps of 30 000: densify only before this */
  int64_t densify_every;   /* steps of 30 000 between densify steps, but at least one pass over the training views */
  int64_t densify_apart;   /* and at least this number of steps, or a 40th of the schedule if that is less */
  double densify_gradient; /* NDC: a Gaussian with a larger mean screen-space gradient is cloned or split */
  /* 1: the children of a split lie on either side of the parent's mean on its longest axis, and only that axis' sigma
   * is divided (ImprovedGS+, arXiv:2603.08661); 0: their means are drawn from the parent, and all sigmas are divided.
   */
  int long_axis_split;
  double prune_opacity; /* Gaussians with a lower opacity are removed; times 255 alpha_min if that is set */
  int64_t reset_every;  /* steps of 30 000 between opacity resets, but at least three passes over the training
                           views; until densify_until */
  double reset_opacity; /* a reset lowers opacities to at most this; times 255 alpha_min if that is set */
  /* After steps 6000, 9000, ... 21 000, all sigmas are multiplied by `scale_reset` and their moments forgotten
   * (ShorterSplatting, arXiv:2603.09277): lists of pixels get shorter, and what is missing afterwards grows back only
   * where it is needed. Steps of 30 000, with at least 200 steps from one reset to the next and to the end; 1: never.
   */
  double scale_reset;
  /* Every densify_every steps from densify_from to the end of the schedule, Gaussians of the background move by
   * this fraction of the way to the plane that LiDAR shows nearby (docs/driving.md); 0: they don't. */
  double lidar_pull;
  /* 20 times as often, those within 0.1 m of the ground are laid into it by this fraction of the way: the mean moves,
   * the axis nearest to the plane's normal turns to it, and a sigma of more than 5 mm across falls to that; 0: they
   * aren't. */
  double lidar_lay;
} pags_train_density;

/* The strategy MCMC (Kheradmand et al. 2024). */
typedef struct pags_train_mcmc {
  double mcmc_noise;       /* scale of the noise added to positions, times the position rate */
  double mcmc_opacity_reg; /* weight of the mean opacity in the loss */
  double mcmc_scale_reg;   /* weight of the mean sigma in the loss */
} pags_train_mcmc;

/* Limits on the size of the scene. */
typedef struct pags_train_size_limit {
  /* Most Gaussians; 0: 2^31 - 64, with strategy MCMC 1 000 000. Once densify is over, prunes by score don't go below
   * it. With preset PAPER the run may have more until the last prune, which keeps those with the highest scores. */
  int64_t max_gaussians;
  double target_size; /* MB (10^6 bytes): limit on scene.json, models and sky together, as files; 0: none */
  /* dB: the finished scene keeps, per Gaussian of the background and per object, the SH degrees with the fewest bytes
   * that lower the PSNR of training photographs by at most this; 0: all keep their degree; -1: by preset. */
  double sh_loss;
} pags_train_size_limit;

/* Scores, pruning by score, and adaptive stochastic dropout (docs/priority.md). */
typedef struct pags_train_priority {
  double alpha;           /* 0..1: share of semantics in S_hybrid and in the weight of critical pixels */
  pags_score score;       /* how S_hybrid is found */
  double critical_weight; /* weight of a critical pixel in the photometric loss, other pixels having 1;
                             auto: 1 + 2.5 alpha, with presets PLAIN and PAPER 1 */
  /* Weight of critical content in densify: the mean gradient of a Gaussian is multiplied by
   *     (1 + (critical_growth - 1) s_sem) / (1 + (critical_weight - 1) s_sem)
   * auto: as critical_weight. */
  double critical_growth;
  int prunes;          /* number of prunes by S_hybrid, 0..8; must be 0 or auto with strategy MCMC */
  int64_t prune_from;  /* steps of 30 000: the first prune */
  int64_t prune_every; /* steps of 30 000 from one prune to the next */
  double prune_early;  /* fraction removed at each prune before densify_until */
  double prune_late;   /* fraction removed at each later prune */
  int64_t prune_floor; /* no object is pruned below this number of Gaussians; auto: 500, with PAPER 0 */
  int dropout;         /* 1: each step leaves Gaussians out at random; auto: 1 with preset PAPER */
  /* The probability that a Gaussian is left out of a step is
   *     (1 - dropout_beta S_sem) dropout_gamma step / steps
   * where dropout_beta, 0..1, is how much semantic priority protects from dropout, and dropout_gamma is the
   * fraction left out of the last step among Gaussians without priority. */
  double dropout_beta;
  double dropout_gamma;
} pags_train_priority;

/* How pictures are rendered (see pags_frame_options). */
typedef struct pags_train_picture {
  double near_plane;    /* metres */
  double low_pass;      /* px^2, added to both variances of the 2D covariance */
  int antialiased;      /* 1: the 2D filter of Mip-Splatting */
  int rolling_shutter;  /* 1: photographs are drawn as read line by line, if the data set has readout times
                           (pags_shutter) */
  double alpha_min;     /* pags_gaussians.alpha_min of all models, 0..0.1; 0 with `antialiased` and MCMC */
  double background[3]; /* display-referred sRGB, 0..1; its fields are background_r, background_g and background_b */
  int cluster_size;     /* Gaussians culled together, a multiple of 16; changes speed, not results */
} pags_train_picture;

/* Which SH coefficients of moving objects are Fourier series of time (pags_fourier_basis). */
typedef enum pags_fourier_choice {
  PAGS_FOURIER_NONE,    /* colours don't change over time */
  PAGS_FOURIER_BY_GAIN, /* the constant coefficient of objects where that pays (engine/train/color_over_time.c) */
  PAGS_FOURIER_ALL      /* all coefficients of all objects, from the start: the paper's four-dimensional SH */
} pags_fourier_choice;

/* Moving objects of driving sets (Street Gaussians, Yan et al. 2024). */
typedef struct pags_train_objects {
  int objects;         /* 1: each moving object has a model of its own; 0: everything is background */
  int box_prune;       /* 1: densify removes an object's Gaussians outside of its box enlarged by half */
  int tracks;          /* 1: the poses of moving objects are optimised */
  int64_t tracks_from; /* steps of 30 000 for which poses are held fixed */
  /* Learning rates of poses: metres and radians per step at the start of a run that visits each photograph 100
   * times, falling to a tenth. With fewer visits the rates are inversely larger, with more visits smaller, by a
   * factor of at most 4. */
  double track_translation_rate;
  double track_rotation_rate;
  int fourier; /* which SH coefficients of objects are Fourier series of time: pags_fourier_choice; -1: of the preset */
  int64_t fourier_from; /* BY_GAIN: steps of 30 000: when it is decided which objects' colours change */
  double fourier_gain;  /* BY_GAIN: dB: least gain on the object's pixels that the change must promise */
} pags_train_objects;

/* The sky of driving sets. */
typedef struct pags_train_sky {
  int sky;         /* 1: a cube map is fitted if training views show sky */
  double sky_rate; /* per step, of texels, falling to a hundredth */
} pags_train_sky;

/* The exposures of photographs. */
typedef struct pags_train_exposure {
  /* 1: a gain and an offset per channel are fitted, sums of a camera's and a photograph's. Auto: likewise, but they are
   * tested after 0.3 of the schedule: on driving sets as camera_poses, on static sets on up to 32 training photographs,
   * which must gain 0.6 dB, since the exposure of another photograph tells nothing there. With presets PLAIN and PAPER
   * auto is 1 on driving sets and 0 on static sets; on blocks 1. */
  int exposure;
  double exposure_rate; /* per step, of gains and offsets, falling to a tenth */
} pags_train_exposure;

/* Corrections of the recorded camera poses of a driving set: one per time step, which moves the whole rig, one per
 * camera, and a time offset per camera. */
typedef struct pags_train_cameras {
  /* 1: they are fitted without every eighth training photograph, and tested on these after 0.3 of the schedule: kept if
   * they bring 0.3 dB or more. Then these photographs are trained on, too. Poses of held-out views lie between those of
   * their neighbours in time. Auto: 1 on driving sets, but 0 on a block of one and with presets PLAIN and PAPER. Not in
   * static sets. */
  int camera_poses;
  double camera_rotation_rate;    /* radians per step, falling to a tenth; divided by the visits of a time step / 100 */
  double camera_translation_rate; /* metres per step, likewise */
  double camera_delay_rate;       /* seconds per step, likewise, by the visits of a camera */
  /* 1: a vignette and a response curve of each camera (pags/photometric.h) are fitted, tested and kept likewise;
   * auto: as of camera_poses. */
  int light;
  double
      light_rate; /* per step, of the vignette's numbers and the logarithms of the curve's slopes; falls to a tenth */
} pags_train_cameras;

/* The whole configuration. */
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
  pags_train_cameras cameras;
} pags_train_config;

/* Returns the default configuration. */
PAGS_API pags_train_config pags_train_config_default(void);

/* Checks the cookie, every range and the combination of fields. Returns PAGS_ERROR_ARGUMENT if a check fails; the
 * message names the field. */
PAGS_API pags_result pags_train_config_check(const pags_train_config *config);

/* ---- The table of fields ---- */

typedef enum pags_field_type {
  PAGS_FIELD_SWITCH, /* int, 0 or 1 */
  PAGS_FIELD_INT,    /* int */
  PAGS_FIELD_INT64,  /* int64_t */
  PAGS_FIELD_UINT64, /* uint64_t */
  PAGS_FIELD_DOUBLE, /* double */
  PAGS_FIELD_CHOICE  /* int, the index of a name in `choices` */
} pags_field_type;

enum { PAGS_FIELD_AUTO = -1 }; /* the value of a field that is chosen by the preset or computed by its rule */

/* A row of the table of fields. All strings are static. */
typedef struct pags_train_field {
  const char *name;  /* "densify_from"; `background` has three fields: background_r, _g, _b */
  const char *group; /* the member of pags_train_config that holds the field: "density" */
  pags_field_type type;
  size_t offset;                  /* of the value in pags_train_config, bytes */
  double standard;                /* the default */
  double least, most;             /* the range, both ends included */
  const char *choices;            /* names of a CHOICE: "default|mcmc"; NULL for other types */
  const char *unit;               /* "1": no unit */
  const char *rule;               /* "auto: ...", the rule behind PAGS_FIELD_AUTO; NULL: the field has no such value */
  const char *text;               /* what the value does */
  double of_preset[PAGS_PRESETS]; /* the value of PAGS_FIELD_AUTO with each preset; all 0: another rule */
} pags_train_field;

/* Returns row `index` of the table, or NULL beyond its end. The rows of a group follow each other. */
PAGS_API const pags_train_field *pags_train_field_at(int index);

/* Returns the row of the field `name`, or NULL if there is no such field. */
PAGS_API const pags_train_field *pags_train_field_find(const char *name);

/* Sets the field `name` from text: a number, one of the field's choices, or "auto" if the field has a rule.
 * A field of earlier versions that is constant now accepts only that constant; PAGS_ERROR_UNSUPPORTED otherwise.
 * Returns PAGS_ERROR_ARGUMENT for an unknown field or an invalid value. Ranges are not checked here
 * but by pags_train_config_check. */
PAGS_API pags_result pags_train_config_set(pags_train_config *config, const char *name, const char *value);

/* ---- Options and callbacks of a run ---- */

/* A run between two steps, in the calls of a progress callback. Its use doesn't change the results of the
 * run, and its time counts neither for rates and estimates nor for the time limit. */
typedef struct pags_train_moment pags_train_moment;

/* How well a view is shown. */
typedef struct pags_train_score {
  int64_t view; /* index of the data set's view */
  double psnr;  /* dB; NaN where no pixel counts */
} pags_train_score;

/* The state of a run after a step. Running figures are exponential means over about one pass of the training
 * views. */
typedef struct pags_train_progress {
  int64_t step, iterations; /* steps done, those before a resume included; steps of the whole run */
  double it_per_second;     /* steps per second over the last second or so, waiting for photographs included */
  int64_t gaussians;        /* Gaussians of all models */
  double loss;              /* running mean */
  double psnr;              /* running mean, dB, of the training views at their present size */
  double seconds;           /* time of this process's training, without the time spent in callbacks */
  double eta_seconds;       /* estimated time to the last step */
  int level;                /* 1, 2 or 4: factor by which the photographs are shrunk at present */
  int64_t bad_rows;         /* as pags_train_result.bad_rows */
  pags_train_score seen;    /* the step's last photograph, at its present size */
  /* Held-out views as they were measured last, after `held_out_step` steps, and their mean PSNR in dB; count 0: not
   * measured in this process. */
  int held_out_count;
  const pags_train_score *held_out;
  double held_out_psnr;
  int64_t held_out_step;
  pags_train_moment *moment; /* the run, valid during the call */
} pags_train_progress;

/* A callback on the thread that called pags_train, after every step. Returning 0 stops the run as options.cancel
 * does. */
typedef int pags_train_progress_fn(void *user, const pags_train_progress *progress);

/* A callback that looks at the Gaussians of the background, with all pending updates applied. `gaussians` belongs
 * to the run, must not be changed and is valid during the call; positions are relative to `origin`. */
typedef void pags_train_snapshot_fn(void *user, const pags_train_progress *progress, const pags_gaussians *gaussians,
                                    const double origin[3]);

typedef struct pags_train_options {
  const pags_dataset *dataset; /* must have at least one training view */
  const char *output;          /* path of the scene folder; may be NULL with `estimate` */
  const char *command_line;    /* how the run was started, which report.json repeats; may be NULL */
  pags_tasks *tasks;
  uint64_t image_cache;      /* size limit of the cache of decoded photographs, bytes; default 1 GiB */
  uint64_t max_memory;       /* memory limit, bytes, from which pags_train_bytes gives a limit on Gaussians; 0: none */
  int64_t checkpoint_every;  /* steps between checkpoints; 0: only when the run stops or is done. Default 1000 */
  double checkpoint_minutes; /* minutes between checkpoints, in addition to checkpoint_every; 0: none */
  int64_t log_every;         /* steps per line of log.jsonl; default 100 */
  int64_t preview_every;     /* steps per preview PNG; 0: none. Default 1000 */
  int held_out;              /* 1: with each preview, at most 8 held-out views are measured and logged. Default 0 */
  /* 1: continue from the checkpoint in the folder; if the folder has neither a checkpoint nor a scene, begin a
   * run. */
  int resume;
  int overwrite; /* 1: begin a run even if the folder isn't empty; files of an earlier run are removed */
  /* > 0, seconds: the number of steps is chosen once, from the speed measured over the first steps, so that the
   * run takes this long, and the run stops when the time has passed; such a run is not reproducible. 0: no limit. */
  double time_limit_seconds;
  int64_t bad_rows_most; /* the run fails with PAGS_ERROR_LIMIT beyond this number of bad_rows; default 1000 */
  int estimate;          /* 1: only run 50 steps and fill the estimates of the result; no file is written */
  /* Checked once per step; a non-zero value stops the run, which then writes its checkpoint and its scene. May be
   * NULL. */
  const volatile int *cancel;
  pags_train_progress_fn *progress; /* called after every step; may be NULL */
  void *progress_user;
  int64_t snapshot_every;           /* steps between calls of `snapshot`; 0: never */
  pags_train_snapshot_fn *snapshot; /* may be NULL */
  void *snapshot_user;
  /* The other ranks of a run that several processes share (cluster/transport.h): all call pags_train with the same data
   * set, configuration and options, and rank 0 writes the folder. NULL: this process is alone. */
  struct pags_transport *transport;
} pags_train_options;

PAGS_API pags_train_options pags_train_options_default(void);

/* ---- Between two steps ---- */

struct pags_composition; /* compose.h */

/* Creates a composition of the current scene, with all pending updates applied, which borrows the run's
 * Gaussians (pags_composition_borrow) and is valid until pags_train_moment_release. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_train_moment_compose(pags_train_moment *moment, struct pags_composition **out);
/* Frees what pags_train_moment_compose made; call it before the callback returns. */
PAGS_API void pags_train_moment_release(pags_train_moment *moment, struct pags_composition *composition);

/* Writes the checkpoint, as is done every checkpoint_every steps. PAGS_ERROR_IO. */
PAGS_API pags_result pags_train_moment_save(pags_train_moment *moment);

/* ---- Training ---- */

/* Parts of a model that a run decides about (member "modelled" of scene.json, docs/scene-folder.md). */
typedef enum pags_train_decision {
  PAGS_DECISION_SKY,
  PAGS_DECISION_EXPOSURE,
  PAGS_DECISION_POSES, /* corrections of camera poses */
  PAGS_DECISION_LIGHT, /* vignettes and response curves */
  PAGS_DECISIONS
} pags_train_decision;

/* What the photographs that a rank has drawn took of other ranks. */
typedef struct pags_train_traffic {
  int64_t views, splats;           /* photographs; splats drawn in them, of all ranks */
  int64_t bytes_there, bytes_back; /* splats that other ranks sent for them; sums that were sent back */
} pags_train_traffic;

typedef struct pags_train_result {
  int finished;                 /* 1: the last step is done; 0: stopped before */
  int resumed;                  /* 1: continued from a checkpoint */
  int64_t iterations;           /* photographs seen, each time counted, those before a resume included */
  int64_t gaussians;            /* Gaussians of all models at the end */
  double seconds;               /* time of training in this process with set-up, decoding, files; without callbacks */
  double iterations_per_second; /* photographs, over the last tenth of the run, or what this process did of it */
  uint64_t peak_rss_bytes;      /* peak resident memory of the process */
  double loss, psnr;            /* running means at the end, as in pags_train_progress */
  /* Updates left out, over the whole run, because a gradient or a parameter wasn't finite: each counts one
   * Gaussian, one object's pose or one view's exposure that wasn't moved in one step. Values that are not finite
   * never spread to others. */
  int64_t bad_rows;
  char first_bad_row[256];    /* what and where the first of these was, in words; empty if there was none */
  uint64_t heap_calls_steady; /* heap calls of the frame renderer in the last tenth of the run */
  /* Mean times per step in this process, ms: waiting for photographs, rendering, loss, backward pass with Adam,
   * density control. */
  double ms_wait, ms_forward, ms_loss, ms_backward, ms_density;
  double ms_processor; /* of the calling thread's processor time a step, without waiting for photographs and ranks */
  /* Of this process: the number of steps that trained each part; the seconds that passed in them with what this part
   * alone needs: for the sky its loss and backward pass, for the others their gradients and updates, except the sums of
   * poses over a cluster's rows, which are part of the backward pass of Gaussians; and the seconds of its holdout
   * test. */
  int64_t decision_steps[PAGS_DECISIONS];
  double decision_seconds[PAGS_DECISIONS], decision_test_seconds[PAGS_DECISIONS];
  pags_train_traffic traffic; /* of this rank; zero if it is alone */
  double seconds_watched;     /* time spent in callbacks, which `seconds` leaves out */
  double estimated_seconds;   /* with options.estimate: time of the whole run */
  uint64_t estimated_bytes;   /* with options.estimate: memory at the most Gaussians expected (train/estimate.c) */
} pags_train_result;

/* Trains, and writes to the folder options->output: scene.json with the models (background.ply, ...) and the sky,
 * checkpoint.pags, log.jsonl, report.json and preview PNGs. Loops run on options->tasks; the call blocks until the
 * run ends.
 *
 * `config` is the configuration of a fresh run. A resumed run takes the checkpoint's, and `config` must be the same,
 * except that iterations may be larger (the run continues at the rates of the schedule's end; after a time limit the
 * number is ignored), that schedule_iterations is ignored, and that with preset PAPER max_gaussians may differ
 * before the last prune. A folder that isn't empty is refused, and not changed, without `resume` or `overwrite`; so is,
 * without `overwrite`, a folder with a scene but no checkpoint, and always a folder that another process is writing.
 *
 * Stopping early by options.cancel or the progress callback is PAGS_OK with finished = 0. PAGS_CANCELLED if
 * pags_tasks_cancel was called: then nothing is written and the last checkpoint stands. PAGS_ERROR_ARGUMENT (a
 * bad configuration, a folder that is refused, a checkpoint of another data set or configuration; the message
 * names the field), PAGS_ERROR_IO, PAGS_ERROR_FORMAT (a damaged checkpoint or file of the data set),
 * PAGS_ERROR_LIMIT (bad_rows_most; a target_size that is too small), PAGS_ERROR_UNSUPPORTED or PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_train(const pags_train_config *config, const pags_train_options *options,
                                pags_train_result *result);

/* Returns an upper bound of the bytes of memory that training needs with `gaussians` Gaussians of an SH degree,
 * the largest picture having width x height pixels; the image cache and the sky come on top. max_memory, less
 * these two, is converted to a limit on Gaussians by this figure. */
PAGS_API uint64_t pags_train_bytes(int64_t gaussians, int sh_degree, int width, int height);

PAGS_END_C
#endif
