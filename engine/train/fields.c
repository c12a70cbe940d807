/* SPDX-License-Identifier: Apache-2.0 */
/* The table of the training configuration's fields. Defaults, range checks, --set, --fields, the help of `pags
 * train`, checkpoints, scene.json and the documentation page of the command line are all derived from it. A row
 * without range, unit and text doesn't compile. Units are words of the field; "1" is a number without a unit.
 * The text of a switch is an imperative sentence: the help of a flag --no-NAME is "Don't" and the text. */
#include "train/config.h"

#include "train/schedule.h"

#define MOST_STEPS 1e9
#define MOST_BATCH 64
#define MOST_COUNT 2147483584.0 /* 2^31 - 64: rows are counted in int32_t */
#define LEAST_OPACITY 0.004     /* a Gaussian of opacity at or below 1/255 isn't drawn and never gets a gradient */
#define STEPS "steps of 30 000"
#define EXTENT "times the extent"

/* ---- Macros for rows ---- */

#define NOT_EMPTY(words)                                                                            \
  (&(words)[0 * sizeof(struct {                                                                     \
              _Static_assert(sizeof(words) > 1, "a field of the training needs a unit and a text"); \
              char unused;                                                                          \
            })])
#define TYPE_OF(member)                      \
  _Generic(((pags_train_config *)0)->member, \
      int: PAGS_FIELD_INT,                   \
      int64_t: PAGS_FIELD_INT64,             \
      uint64_t: PAGS_FIELD_UINT64,           \
      double: PAGS_FIELD_DOUBLE)
/* The rest: one value each for the presets default, plain and paper; 0: none. */
#define FIELD(name, group, kind, offset, standard, least, most, choices, unit, rule, text, ...)          \
  {                                                                                                      \
    name, group, kind, offset, standard, least, most, choices, NOT_EMPTY(unit), rule, NOT_EMPTY(text), { \
      __VA_ARGS__                                                                                        \
    }                                                                                                    \
  }
#define ROW(group, member, kind, ...) \
  FIELD(#member, #group, kind, offsetof(pags_train_config, group.member), __VA_ARGS__)

#define NUMBER(group, member, standard, least, most, unit, text) \
  ROW(group, member, TYPE_OF(group.member), standard, least, most, NULL, unit, NULL, text, 0)
/* A number that is computed by a rule unless the user sets it. */
#define AUTO(group, member, least, most, unit, rule, text) \
  ROW(group, member, TYPE_OF(group.member), PAGS_FIELD_AUTO, least, most, NULL, unit, NOT_EMPTY("auto: " rule), text, 0)
/* A number that the preset chooses unless the user sets it: one each for default, plain and paper. `but` says, if
 * it isn't empty, where pags_config_resolve deviates. */
#define PRESET_TYPE(type, group, member, normal, plain, paper, but, least, most, unit, text) \
  ROW(group, member, type, PAGS_FIELD_AUTO, least, most, NULL, unit,                         \
      "auto: " #normal "; preset plain " #plain ", paper " #paper but, text, normal, plain, paper)
#define PRESET(group, member, ...) PRESET_TYPE(TYPE_OF(group.member), group, member, __VA_ARGS__)
#define PRESET_SWITCH(group, member, normal, plain, paper, text) \
  PRESET_TYPE(PAGS_FIELD_SWITCH, group, member, normal, plain, paper, "", 0, 1, "0 or 1", text)
#define AUTO_SWITCH(group, member, rule, text) \
  ROW(group, member, PAGS_FIELD_SWITCH, PAGS_FIELD_AUTO, 0, 1, NULL, "0 or 1", "auto: " rule, text, 0)
#define SWITCH(group, member, standard, text) \
  ROW(group, member, PAGS_FIELD_SWITCH, standard, 0, 1, NULL, "0 or 1", NULL, text, 0)
/* A choice by name from an enum; `last` is the enum's last value. */
#define CHOICE(group, member, standard, last, choices, text) \
  ROW(group, member, PAGS_FIELD_CHOICE, standard, 0, last, choices, "a name", NULL, text, 0)
#define BACKGROUND(suffix, i)                                                                                \
  FIELD("background_" suffix, "picture", PAGS_FIELD_DOUBLE,                                                  \
        offsetof(pags_train_config, picture.background) + (i) * sizeof(double), 0, 0, 1, NULL, "sRGB", NULL, \
        "Background colour where nothing covers the view.", 0)

/* ---- The table ---- */

_Static_assert(sizeof(pags_strategy) == sizeof(int) && sizeof(pags_preset) == sizeof(int), "enums are read as int");

const pags_train_field pags_fields[] = {
    CHOICE(schedule, preset, PAGS_PRESET_DEFAULT, PAGS_PRESET_PAPER, "default|plain|paper",
           "Preset for fields left at \"auto\": default; plain: as 3D Gaussian "
           "Splatting (Kerbl et al. 2023); paper: as in the PAGS paper (arXiv:2510.12282)."),
    NUMBER(schedule, iterations, 30000, 1, PAGS_CONFIG_STEPS, "photographs", "Photographs to train on, with repeats."),
    NUMBER(schedule, schedule_iterations, 0, 0, MOST_STEPS, "photographs",
           "Photographs over which the schedule is stretched; later steps keep its final learning rates. 0: as "
           "iterations."),
    NUMBER(schedule, batch, 1, 1, MOST_BATCH, "photographs", "Photographs per training step."),
    NUMBER(schedule, seed, 0, 0, 18446744073709551615.0, "1", "Seed of the random number generator."),
    NUMBER(schedule, quarter_until, 0.05, 0, 1, "of the schedule",
           "Train at a quarter of the image size until this point."),
    AUTO(schedule, half_until, 0, 1, "of the schedule",
         "0.2 to 0.6, the more pixels a photograph has for each Gaussian the longer; presets plain and paper 0.2",
         "Train at half of the image size until this point."),
    NUMBER(schedule, resolution_floor, 64, 1, 65535, "px",
           "Skip reduced image sizes whose shorter side has fewer pixels."),

    PRESET(optimiser, position_rate_begin, 3.2e-4, 1.6e-4, 1.6e-4, "", 0, 1, EXTENT,
           "Initial learning rate of positions."),
    PRESET(optimiser, position_rate_end, 3.2e-6, 1.6e-6, 1.6e-6, "", 0, 1, EXTENT,
           "Final learning rate of positions; log-linear in between."),
    PRESET(optimiser, scale_rate, 0.008, 0.005, 0.005, "", 0, 1, "per step", "Learning rate of ln sigma."),
    NUMBER(optimiser, rotation_rate, 0.001, 0, 1, "per step", "Learning rate of quaternions."),
    NUMBER(optimiser, opacity_rate, 0.05, 0, 1, "per step", "Learning rate of opacity logits."),
    PRESET(optimiser, sh_dc_rate, 0.005, 0.0025, 0.0025, "", 0, 1, "per step",
           "Learning rate of the constant term of the spherical harmonics."),
    PRESET(optimiser, sh_rest_rate, 0.00025, 0.000125, 0.000125, "", 0, 1, "per step",
           "Learning rate of the higher terms of the spherical harmonics."),
    PRESET(optimiser, rate_fall, 0.1, 1, 1, "", 1e-6, 1, "times",
           "Final factor on all learning rates except those of positions; log-linear in between."),
    NUMBER(optimiser, rate_fall_from, 0.7, 0, 0.99, "of the schedule",
           "Start of the learning rate decay by rate_fall, which lasts to the end of the schedule."),
    NUMBER(optimiser, beta1, 0.9, 0, 0.95, "per step", "Adam's decay of the first moment."),
    NUMBER(optimiser, beta2, 0.999, 0.95, 0.99999, "per step", "Adam's decay of the second moment."),
    NUMBER(optimiser, epsilon, 1e-15, 1e-20, 1, "1", "Term added to the square root of Adam's second moment."),

    PRESET(losses, ssim_weight, 0.4, 0.2, 0.2, "", 0, 1, "1",
           "Weight w of the photometric loss (1 - w) L1 + w (1 - SSIM)."),
    NUMBER(losses, depth_weight, 0.01, 0, 1e3, "per metre", "Weight of the LiDAR depth loss; 0: off."),
    NUMBER(losses, depth_share, 0.95, 0.01, 1, "of the samples",
           "Share of the LiDAR samples in the depth loss: those with the smallest errors."),
    NUMBER(losses, object_weight, 0.1, 0, 1e3, "1",
           "Weight of the object opacity loss, which applies in the second half of the schedule; 0: off."),
    NUMBER(losses, sky_weight, 0.05, 0, 1e3, "1", "Weight of the sky opacity loss; 0: off."),

    NUMBER(start, init_opacity, 0.1, LEAST_OPACITY, 0.999, "1", "Initial opacity of Gaussians."),
    SWITCH(start, lidar_start, 1, "Start from LiDAR points."),
    PRESET(start, lidar_points, 100000, 200000, 200000, "", 1000, 600000, "points",
           "Maximum number of initial LiDAR points of the background; voxels merge the rest."),

    AUTO(color, sh_degree, 0, 3, "1", "3; driving sets 1", "Highest degree of the spherical harmonics."),
    NUMBER(color, sh_interval, 1000, 0, MOST_STEPS, STEPS,
           "Raise the degree of the spherical harmonics by one every N steps; 0: start at the highest degree."),

    CHOICE(density, strategy, PAGS_STRATEGY_DEFAULT, PAGS_STRATEGY_MCMC, "default|mcmc",
           "Density control: default (Kerbl et al. 2023) clones, splits, prunes; mcmc (Kheradmand et al. 2024) "
           "relocates, adds."),
    NUMBER(density, densify_from, 500, 0, MOST_STEPS, STEPS, "Densify after this step."),
    PRESET(density, densify_until, 9500, 15000, 15000, "", 0, MOST_STEPS, STEPS, "Densify before this step."),
    NUMBER(
        density, densify_every, 100, 1, MOST_STEPS, STEPS,
        "Densify every N steps, but at most once per pass over the training views and once per densify_apart steps."),
    PRESET(density, densify_apart, 125, 1, 1, "", 1, MOST_STEPS, "steps",
           "Minimum number of steps between two densify steps, or a 40th of the schedule if that is less."),
    PRESET(density, densify_gradient, 0.0003, 0.0002, 0.0002, "", 0, 1e6, "NDC",
           "Clone or split Gaussians whose mean gradient in screen space is larger."),
    PRESET_SWITCH(density, long_axis_split, 1, 0, 0, "Split along the longest axis only."),
    NUMBER(density, prune_opacity, 0.005, 0, 1, "1",
           "Remove Gaussians with a lower opacity. Multiplied by 255 alpha_min unless alpha_min is 0."),
    NUMBER(density, reset_every, 3000, 1, MOST_STEPS, STEPS,
           "Reset opacities every N steps until densify_until, but at most once per three passes over the training "
           "views."),
    NUMBER(density, reset_opacity, 0.01, LEAST_OPACITY, 1, "1",
           "Upper bound of opacities after a reset. Multiplied by 255 alpha_min unless alpha_min is 0."),
    PRESET(density, scale_reset, 0.6, 1, 1, "; 1 with strategy mcmc", 0.1, 1, "times",
           "Factor on all sigmas at each scale reset; 1: no scale resets."),
    NUMBER(density, lidar_pull, 0, 0, 1, "of the way",
           "Every densify_every steps, move Gaussians of the background this fraction of the way to the nearby plane "
           "of LiDAR points; 0: off."),
    NUMBER(density, lidar_lay, 0, 0, 1, "of the way",
           "Every densify_every / 20 steps, flatten Gaussians of the background within 0.1 m of the LiDAR ground by "
           "this fraction; 0: off."),

    NUMBER(mcmc, mcmc_noise, 5e5, 0, 1e9, "times the position rate",
           "Amplitude of the position noise of strategy mcmc."),
    NUMBER(mcmc, mcmc_opacity_reg, 0.01, 0, 1e3, "1", "Weight of the mean opacity in the loss of strategy mcmc."),
    NUMBER(mcmc, mcmc_scale_reg, 0.01, 0, 1e3, "1", "Weight of the mean sigma in the loss of strategy mcmc."),

    NUMBER(size_limit, max_gaussians, 0, 0, MOST_COUNT, "Gaussians",
           "Limit on Gaussians; preset paper applies it at the last prune. 0: none, but 1000000 with strategy mcmc."),
    NUMBER(size_limit, target_size, 0, 0, 1e9, "MB",
           "Maximum size of scene.json, models and sky together; 0: no limit."),
    PRESET(size_limit, sh_loss, 0.05, 0, 0, "; 0 with target_size", 0, 10, "dB",
           "Maximum loss of PSNR on training photographs when the SH degrees of the finished scene are reduced; 0: "
           "off."),

    NUMBER(priority, alpha, 0.4, 0, 1, "1",
           "Weight of semantics in the pruning score; the rest is the gradient score."),
    CHOICE(
        priority, score, PAGS_SCORE_AUTO, PAGS_SCORE_PAPER, "auto|default|paper",
        "Pruning score. default: (1 - alpha + alpha S_sem) S_grad, both measured before each prune. paper: alpha S_sem "
        "+ (1 - alpha) S_grad; S_sem measured once at the start, S_grad summed over training steps. auto: paper "
        "with preset paper, else default."),
    AUTO(priority, critical_weight, 1, 100, "times", "1 + 2.5 alpha; presets plain and paper 1",
         "Loss weight of pixels that show vehicles or people."),
    AUTO(priority, critical_growth, 1, 100, "times", "as critical_weight",
         "Densify weight of pixels that show vehicles or people."),
    PRESET(priority, prunes, 6, 0, 8, "; 0 with strategy mcmc", 0, PAGS_MOST_PRUNES, "prunes",
           "Number of prunes by score."),
    PRESET(priority, prune_from, 1000, 1000, 6000, "", 1, MOST_STEPS, STEPS, "Step of the first prune by score."),
    PRESET(priority, prune_every, 2500, 2500, 3000, "", 1, MOST_STEPS, STEPS, "Prune by score every N steps."),
    PRESET(priority, prune_early, 0.3, 0.35, 0.6, "", 0, 0.99, "of the Gaussians",
           "Share of the Gaussians that each prune by score removes before densify_until."),
    PRESET(priority, prune_late, 0.1, 0.1, 0.3, "", 0, 0.99, "of the Gaussians",
           "Share of the Gaussians that each later prune by score removes."),
    PRESET(priority, prune_floor, 500, 500, 0, "", 0, MOST_COUNT, "Gaussians",
           "Minimum number of Gaussians per object, below which no prune by score applies."),
    AUTO_SWITCH(priority, dropout, "0; preset paper 1",
                "Drop random Gaussians in each step, with lower probability for a high semantic score."),
    NUMBER(priority, dropout_beta, 0.5, 0, 1, "1",
           "Protection from dropout by the semantic score: the probability is (1 - beta S_sem) gamma step / steps."),
    NUMBER(priority, dropout_gamma, 0.25, 0, 0.9, "of the Gaussians",
           "Share of Gaussians with S_sem 0 that the last step drops."),

    NUMBER(picture, near_plane, 0.01, 1e-6, 1e6, "metres", "Near plane: nearer Gaussians are not drawn."),
    NUMBER(picture, low_pass, 0.3, 0, 100, "px^2",
           "Low-pass filter: addition to both variances of a projected Gaussian."),
    SWITCH(picture, antialiased, 0, "Compensate opacities for the low-pass filter (Mip-Splatting)."),
    SWITCH(
        picture, rolling_shutter, 1,
        "Model the rolling shutter: camera and objects move while lines are read, if the data set has readout times."),
    PRESET(picture, alpha_min, 0.0196, 0, 0, "; 0 with strategy mcmc or antialiased", 0, 0.1, "1",
           "Cut-off of alpha: blend (alpha - alpha_min) / (1 - alpha_min) where positive. 0: blend alpha where it is "
           "at least 1/255."),
    BACKGROUND("r", 0),
    BACKGROUND("g", 1),
    BACKGROUND("b", 2),
    NUMBER(picture, cluster_size, 64, 16, 256, "Gaussians",
           "Gaussians per culling cluster, a multiple of 16; affects speed, not results."),

    SWITCH(objects, objects, 1, "Model moving objects separately from the background."),
    SWITCH(objects, box_prune, 1, "Remove an object's Gaussians outside of its box enlarged by half."),
    SWITCH(objects, tracks, 1, "Optimise the labelled poses of moving objects."),
    NUMBER(objects, tracks_from, 3000, 0, MOST_STEPS, STEPS, "Optimise poses of objects after this step."),
    NUMBER(objects, track_translation_rate, 3e-3, 0, 1, "metres",
           "Learning rate of object positions; decays to a tenth."),
    NUMBER(objects, track_rotation_rate, 3e-4, 0, 1, "radians",
           "Learning rate of object rotations; decays to a tenth."),
    PRESET_TYPE(PAGS_FIELD_INT, objects, fourier, 1, 1, 2, "", 0, PAGS_FOURIER_ALL, "1",
                "Colour of objects over time: 0 constant; 1 the constant colour term varies if this reduces the error; "
                "2 all colour terms of all objects vary from the start, as in the paper."),
    NUMBER(objects, fourier_from, 15000, 0, MOST_STEPS, STEPS,
           "Step that selects the objects whose colour varies over time."),
    NUMBER(objects, fourier_gain, 0.1, 0, 100, "dB",
           "Minimum expected gain in PSNR on the object's pixels for a colour that varies over time."),

    SWITCH(sky, sky, 1, "Model the sky as a cube map."),

    AUTO_SWITCH(exposure, exposure, "keep if photographs improve; presets plain and paper 1 on driving sets, else 0",
                "Fit a gain and an offset for each photograph."),
    NUMBER(exposure, exposure_rate, 3e-3, 0, 1, "per step", "Learning rate of exposures; decays to a tenth."),

    AUTO_SWITCH(cameras, camera_poses, "1 on driving sets, but for blocks; captures, presets plain and paper 0",
                "Correct camera poses; keep the corrections if they improve held-out training photographs."),
    NUMBER(cameras, camera_rotation_rate, 3e-4, 0, 1, "radians per step",
           "Learning rate of camera rotations; decays to a tenth."),
    NUMBER(cameras, camera_translation_rate, 3e-3, 0, 10, "metres per step",
           "Learning rate of camera positions; decays to a tenth."),
    NUMBER(cameras, camera_delay_rate, 1.5e-3, 0, 1, "seconds per step",
           "Learning rate of camera time offsets; decays to a tenth."),
    AUTO_SWITCH(
        cameras, light, "1 on driving sets, but for blocks; presets plain and paper 0",
        "Fit each camera's vignetting and response curve; keep them if they improve held-out training photographs."),
    NUMBER(cameras, light_rate, 2e-3, 0, 1, "per step",
           "Learning rate of vignetting and response curves; decays to a tenth."),
};
const int pags_field_count = sizeof pags_fields / sizeof pags_fields[0];
