/* SPDX-License-Identifier: Apache-2.0 */
/* The table of the training configuration's fields. Defaults, range checks, --set, --fields, the help of `pags
 * train`, checkpoints, scene.json and the documentation page of the command line are all derived from it. A row
 * without range, unit and text doesn't compile. Units are words of the field; "1" stands for a number without a unit.
 * Texts are in the imperative: the help of a flag --no-NAME is "don't" and the text. */
#include "train/fields.h"

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
#define ROW(group, member, kind, standard, least, most, choices, unit, rule, text) \
  {#member,                                                                        \
   #group,                                                                         \
   kind,                                                                           \
   offsetof(pags_train_config, group.member),                                      \
   standard,                                                                       \
   least,                                                                          \
   most,                                                                           \
   choices,                                                                        \
   NOT_EMPTY(unit),                                                                \
   rule,                                                                           \
   NOT_EMPTY(text),                                                                \
   {0}}

#define NUMBER(group, member, standard, least, most, unit, text) \
  ROW(group, member, TYPE_OF(group.member), standard, least, most, NULL, unit, NULL, text)
/* A number that is computed by a rule unless the user sets it. */
#define AUTO(group, member, least, most, unit, rule, text) \
  ROW(group, member, TYPE_OF(group.member), PAGS_FIELD_AUTO, least, most, NULL, unit, NOT_EMPTY("auto: " rule), text)
/* A number that the preset chooses unless the user sets it: one each for default, fast, plain and paper. `but` says, if
 * it isn't empty, where pags_config_resolve deviates. */
#define PRESET_TYPE(type, group, member, normal, fast, plain, paper, but, least, most, unit, text)        \
  {                                                                                                       \
    #member, #group, type, offsetof(pags_train_config, group.member), PAGS_FIELD_AUTO, least, most, NULL, \
        NOT_EMPTY(unit), "auto: " #normal "; preset fast " #fast ", plain " #plain ", paper " #paper but, \
        NOT_EMPTY(text), {                                                                                \
      normal, fast, plain, paper                                                                          \
    }                                                                                                     \
  }
#define PRESET(group, member, ...) PRESET_TYPE(TYPE_OF(group.member), group, member, __VA_ARGS__)
#define PRESET_SWITCH(group, member, normal, fast, plain, paper, text) \
  PRESET_TYPE(PAGS_FIELD_SWITCH, group, member, normal, fast, plain, paper, "", 0, 1, "0 or 1", text)
#define AUTO_SWITCH(group, member, rule, text) \
  ROW(group, member, PAGS_FIELD_SWITCH, PAGS_FIELD_AUTO, 0, 1, NULL, "0 or 1", "auto: " rule, text)
#define SWITCH(group, member, standard, text) \
  ROW(group, member, PAGS_FIELD_SWITCH, standard, 0, 1, NULL, "0 or 1", NULL, text)
/* A choice by name from an enum; `last` is the enum's last value. */
#define CHOICE(group, member, standard, last, choices, text) \
  ROW(group, member, PAGS_FIELD_CHOICE, standard, 0, last, choices, "a name", NULL, text)
#define BACKGROUND(suffix, i)                                              \
  {"background_" suffix,                                                   \
   "picture",                                                              \
   PAGS_FIELD_DOUBLE,                                                      \
   offsetof(pags_train_config, picture.background) + (i) * sizeof(double), \
   0,                                                                      \
   0,                                                                      \
   1,                                                                      \
   NULL,                                                                   \
   "sRGB",                                                                 \
   NULL,                                                                   \
   "show this colour where nothing covers the view",                       \
   {0}}

/* ---- The table ---- */

_Static_assert(sizeof(pags_strategy) == sizeof(int) && sizeof(pags_preset) == sizeof(int), "enums are read as int");

const pags_train_field pags_fields[] = {
    CHOICE(schedule, preset, PAGS_PRESET_DEFAULT, PAGS_PRESET_PAPER, "default|fast|plain|paper",
           "choose all values that are auto; fast: fewer Gaussians, less quality; plain: as 3D Gaussian "
           "Splatting trains (Kerbl et al. 2023); paper: as the paper of PAGS trains (arXiv:2510.12282)"),
    NUMBER(schedule, iterations, 30000, 1, PAGS_CONFIG_STEPS, "photographs", "train on so many photographs"),
    NUMBER(schedule, schedule_iterations, 0, 0, MOST_STEPS, "photographs",
           "stretch the schedule over so many photographs; later ones keep its last rates; 0: as iterations"),
    NUMBER(schedule, batch, 1, 1, MOST_BATCH, "photographs", "let a step see so many photographs"),
    NUMBER(schedule, seed, 0, 0, 18446744073709551615.0, "1", "seed everything that is random"),
    NUMBER(schedule, quarter_until, 0.05, 0, 1, "of the schedule",
           "show photographs at a quarter of their size until then"),
    AUTO(schedule, half_until, 0, 1, "of the schedule",
         "0.2 to 0.6, the more pixels a photograph has for each Gaussian the longer; presets plain and paper 0.2",
         "show photographs at half of their size until then"),
    NUMBER(schedule, resolution_floor, 64, 1, 65535, "px",
           "skip a smaller size where the shorter side would have fewer pixels"),

    PRESET(optimiser, position_rate_begin, 3.2e-4, 3.2e-4, 1.6e-4, 1.6e-4, "", 0, 1, EXTENT,
           "set the learning rate of positions at the first step"),
    PRESET(optimiser, position_rate_end, 3.2e-6, 3.2e-6, 1.6e-6, 1.6e-6, "", 0, 1, EXTENT,
           "set the learning rate of positions at the schedule's end; log-linear between"),
    PRESET(optimiser, scale_rate, 0.008, 0.008, 0.005, 0.005, "", 0, 1, "per step",
           "set the learning rate of ln sigma"),
    NUMBER(optimiser, rotation_rate, 0.001, 0, 1, "per step", "set the learning rate of quaternions"),
    NUMBER(optimiser, opacity_rate, 0.05, 0, 1, "per step", "set the learning rate of opacity logits"),
    PRESET(optimiser, sh_dc_rate, 0.005, 0.005, 0.0025, 0.0025, "", 0, 1, "per step",
           "set the learning rate of the constant term of colour"),
    PRESET(optimiser, sh_rest_rate, 0.00025, 0.00025, 0.000125, 0.000125, "", 0, 1, "per step",
           "set the learning rate of the higher terms of colour"),
    PRESET(optimiser, rate_fall, 0.1, 0.1, 1, 1, "", 1e-6, 1, "times",
           "let all rates but those of positions fall to this share of themselves; log-linear"),
    NUMBER(optimiser, rate_fall_from, 0.7, 0, 0.99, "of the schedule",
           "let rates fall from then on, to the schedule's end"),
    NUMBER(optimiser, beta1, 0.9, 0, 0.95, "per step", "set Adam's decay of the first moment"),
    NUMBER(optimiser, beta2, 0.999, 0.95, 0.99999, "per step", "set Adam's decay of the second moment"),
    NUMBER(optimiser, epsilon, 1e-15, 1e-20, 1, "1", "add this to the root of Adam's second moment"),

    PRESET(losses, ssim_weight, 0.4, 0.4, 0.2, 0.2, "", 0, 1, "1",
           "set w of the photometric loss (1 - w) L1 + w (1 - SSIM)"),
    NUMBER(losses, depth_weight, 0.01, 0, 1e3, "per metre", "weigh the LiDAR depth term; 0: none"),
    NUMBER(losses, depth_share, 0.95, 0.01, 1, "of the samples",
           "count only the LiDAR samples with the smallest errors"),
    NUMBER(losses, object_weight, 0.1, 0, 1e3, "1",
           "weigh the object opacity term in the second half of the schedule; 0: none"),
    NUMBER(losses, sky_weight, 0.05, 0, 1e3, "1", "weigh the sky opacity term; 0: none"),

    SWITCH(start, random_start, 0,
           "start from random points, where the data set has none, without matching photographs"),
    NUMBER(start, init_opacity, 0.1, LEAST_OPACITY, 0.999, "1", "set the opacity of the first Gaussians"),
    NUMBER(start, init_scale, 1, 1e-6, 1e6, "times the distance to the 3 nearest points",
           "set the sigma of the first Gaussians"),
    NUMBER(start, init_scale_max, 0.1, 1e-6, 1e6, EXTENT, "limit the sigma of the first Gaussians"),
    SWITCH(start, lidar_start, 1, "start from LiDAR points"),
    PRESET(start, lidar_points, 100000, 100000, 200000, 200000, "", 1000, 600000, "points",
           "merge the background's LiDAR points until no more are left to start from"),
    NUMBER(start, extent_most, 20, 1e-3, 1e6, "metres",
           "limit the extent of a driving set's background, to which rates and sizes are relative"),

    AUTO(color, sh_degree, 0, 3, "1", "3; driving sets 1",
         "set the highest degree of the spherical harmonics of colour"),
    NUMBER(color, sh_interval, 1000, 0, MOST_STEPS, STEPS,
           "raise the degree by one each time so many steps are over; 0: begin with the highest"),

    CHOICE(density, strategy, PAGS_STRATEGY_DEFAULT, PAGS_STRATEGY_MCMC, "default|mcmc",
           "default: clone, split, prune, reset (Kerbl et al. 2023); mcmc: relocate, grow, add noise (Kheradmand et "
           "al. 2024)"),
    NUMBER(density, densify_from, 500, 0, MOST_STEPS, STEPS, "densify after this step"),
    PRESET(density, densify_until, 9500, 9500, 15000, 15000, "", 0, MOST_STEPS, STEPS, "densify before this step"),
    NUMBER(density, densify_every, 100, 1, MOST_STEPS, STEPS,
           "densify so often, but at most once in a pass over the training views and in densify_apart steps"),
    PRESET(
        density, densify_apart, 125, 125, 1, 1, "", 1, MOST_STEPS, "steps",
        "let so many steps pass at least from one densify to the next, or a 40th of the schedule where that is less"),
    PRESET(density, densify_gradient, 0.0003, 0.0003, 0.0002, 0.0002, "", 0, 1e6, "NDC",
           "clone or split a Gaussian whose mean screen gradient is larger"),
    SWITCH(density, absgrad, 0, "densify by absolute per-pixel gradients (Ye et al. 2024)"),
    NUMBER(density, absgrad_gradient, 8e-4, 0, 1e6, "NDC", "use this threshold with absgrad"),
    NUMBER(density, dense_percent, 0.01, 0, 1e6, EXTENT,
           "split a Gaussian whose sigma is larger, clone one whose sigma is smaller"),
    NUMBER(density, split_divisor, 1.6, 1, 100, "1", "divide the parent's sigma by this for the children of a split"),
    PRESET_SWITCH(density, long_axis_split, 1, 1, 0, 0, "split along the longest axis alone"),
    SWITCH(density, revised_opacity, 0,
           "give the children of a split the opacity 1 - sqrt(1 - o) (Rota Bulo et al. 2024)"),
    NUMBER(density, prune_opacity, 0.005, 0, 1, "1", "remove Gaussians whose opacity is lower; times 255 alpha_min"),
    NUMBER(density, prune_scale, 0.1, 0, 1e6, EXTENT,
           "remove Gaussians whose sigma is larger, once opacities have been reset"),
    NUMBER(density, reset_every, 3000, 1, MOST_STEPS, STEPS,
           "reset opacities so often, but at most once in three passes, until densify_until"),
    NUMBER(density, reset_opacity, 0.01, LEAST_OPACITY, 1, "1",
           "lower opacities to this at a reset; times 255 alpha_min"),
    PRESET(density, scale_reset, 0.6, 0.6, 1, 1, "; 1 with strategy mcmc", 0.1, 1, "times",
           "multiply sigmas by this at each scale reset; 1: never"),
    NUMBER(density, scale_reset_from, 6000, 1, MOST_STEPS, STEPS, "reset scales after this step first"),
    NUMBER(density, scale_reset_every, 3000, 1, MOST_STEPS, STEPS,
           "reset scales so often, but at most every 200 steps"),
    NUMBER(density, scale_reset_until, 21000, 0, MOST_STEPS, STEPS, "reset scales up to this step"),
    NUMBER(density, lidar_pull, 0, 0, 1, "of the way",
           "move Gaussians of the background towards the plane that LiDAR shows nearby, as often as densify; 0: don't"),
    NUMBER(
        density, lidar_lay, 0, 0, 1, "of the way",
        "lay Gaussians of the background within 0.1 m of the ground that LiDAR shows flat into it, 20 times as often "
        "as densify; 0: don't"),

    NUMBER(mcmc, mcmc_growth, 0.05, 0, 10, "of the Gaussians",
           "add so many Gaussians at each densify step of strategy mcmc"),
    NUMBER(mcmc, mcmc_noise, 5e5, 0, 1e9, "times the position rate", "add this noise to positions with strategy mcmc"),
    NUMBER(mcmc, mcmc_opacity_reg, 0.01, 0, 1e3, "1", "weigh the mean opacity in the loss of strategy mcmc"),
    NUMBER(mcmc, mcmc_scale_reg, 0.01, 0, 1e3, "1", "weigh the mean sigma in the loss of strategy mcmc"),

    NUMBER(size_limit, max_gaussians, 0, 0, MOST_COUNT, "Gaussians",
           "limit the number of Gaussians; preset paper applies it at its last prune; 0: none, with strategy mcmc "
           "1000000"),
    NUMBER(size_limit, target_size, 0, 0, 1e9, "MB",
           "limit what scene.json, models and sky of the finished scene take; 0: none"),
    NUMBER(size_limit, sh_error, 0, 0, 255, "255ths",
           "give each Gaussian of the finished scene the lowest degree of colour that changes what training views see "
           "by no more; 0: don't"),

    NUMBER(priority, alpha, 0.4, 0, 1, "1",
           "set the share of vehicles and people in the score; the rest is how much the picture changes with the "
           "Gaussian"),
    CHOICE(priority, hybrid, PAGS_HYBRID_AUTO, PAGS_HYBRID_PRODUCT, "auto|sum|product",
           "combine S_sem and S_grad; sum: alpha S_sem + (1 - alpha) S_grad; product: (1 - alpha + alpha S_sem) "
           "S_grad; auto: product, preset paper sum"),
    AUTO(priority, critical_weight, 1, 100, "times", "1 + 2.5 alpha; presets plain and paper 1",
         "count pixels of vehicles and people so often in the loss"),
    AUTO(priority, critical_growth, 1, 100, "times", "as critical_weight",
         "count pixels of vehicles and people so often when densify chooses"),
    PRESET(priority, prunes, 6, 6, 0, 8, "; 0 with strategy mcmc", 0, PAGS_MOST_PRUNES, "prunes",
           "prune Gaussians of a low score so many times"),
    PRESET(priority, prune_from, 1000, 1000, 1000, 6000, "", 1, MOST_STEPS, STEPS,
           "prune by score after this step first"),
    PRESET(priority, prune_every, 2500, 2500, 2500, 3000, "", 1, MOST_STEPS, STEPS, "prune by score so often"),
    PRESET(priority, prune_early, 0.3, 0.55, 0.35, 0.6, "", 0, 0.99, "of the Gaussians",
           "remove so many at each prune by score while densify goes on"),
    PRESET(priority, prune_late, 0.1, 0.1, 0.1, 0.3, "", 0, 0.99, "of the Gaussians",
           "remove so many at each later prune by score"),
    NUMBER(priority, prune_floor, 500, 0, MOST_COUNT, "Gaussians", "prune no object below so many"),
    CHOICE(
        priority, s_sem, PAGS_S_SEM_PASS, PAGS_S_SEM_OVERLAP, "pass|init|overlap",
        "find S_sem, the share of a Gaussian that shows vehicles and people; pass: by its weight in the photographs' "
        "pixels, again before each prune; init: once at the start; overlap: as pass, as if nothing hid anything"),
    CHOICE(priority, s_grad, PAGS_S_GRAD_RANK, PAGS_S_GRAD_LOG, "rank|minmax|log", "bring S_grad to 0..1"),
    CHOICE(priority, s_grad_from, PAGS_S_GRAD_FROM_PASS, PAGS_S_GRAD_FROM_TRAINING, "pass|training",
           "measure S_grad in a pass over the training views, or take the loss's gradients since the last prune"),
    AUTO_SWITCH(priority, dropout, "0; preset paper 1",
                "leave Gaussians out of each step at random; those of high semantic priority least"),
    NUMBER(priority, dropout_beta, 0.5, 0, 1, "1",
           "protect semantic priority from dropout: leave out (1 - beta priority) gamma step / steps"),
    NUMBER(priority, dropout_gamma, 0.25, 0, 0.9, "of the Gaussians",
           "leave so many Gaussians without priority out of the last step"),

    NUMBER(picture, near_plane, 0.01, 1e-6, 1e6, "metres", "don't draw Gaussians that are nearer"),
    NUMBER(picture, low_pass, 0.3, 0, 100, "px^2", "add this to both variances of a Gaussian on the screen"),
    SWITCH(picture, antialiased, 0,
           "lower opacities by what the low-pass filter adds (the 2D filter of Mip-Splatting)"),
    SWITCH(
        picture, rolling_shutter, 1,
        "draw each Gaussian as the camera and its object stood when its line was read, where the data set says when"),
    PRESET(picture, alpha_min, 0.0196, 0.0196, 0, 0, "; 0 with strategy mcmc or antialiased", 0, 0.1, "1",
           "blend (alpha - alpha_min) / (1 - alpha_min) where that is positive; 0: alpha where it is at least 1/255"),
    BACKGROUND("r", 0),
    BACKGROUND("g", 1),
    BACKGROUND("b", 2),
    NUMBER(picture, cluster_size, 64, 16, 256, "Gaussians",
           "cull so many Gaussians together, a multiple of 16; changes speed, not results"),

    SWITCH(objects, objects, 1, "model moving objects apart from the background"),
    SWITCH(objects, box_prune, 1, "remove an object's Gaussians that leave its box enlarged by half"),
    SWITCH(objects, tracks, 1, "optimise the labelled poses of moving objects"),
    NUMBER(objects, tracks_from, 3000, 0, MOST_STEPS, STEPS, "optimise poses after this step"),
    NUMBER(objects, track_translation_rate, 3e-3, 0, 1, "metres",
           "set the learning rate of objects' positions; it falls to a tenth"),
    NUMBER(objects, track_rotation_rate, 3e-4, 0, 1, "radians",
           "set the learning rate of objects' rotations; it falls to a tenth"),
    SWITCH(objects, fourier, 1, "let an object's colour change over time where that pays"),
    NUMBER(objects, fourier_from, 15000, 0, MOST_STEPS, STEPS, "decide then which objects' colour changes over time"),
    NUMBER(objects, fourier_gain, 0.1, 0, 100, "dB",
           "let colour change over time where it promises so much on the object's pixels"),

    SWITCH(sky, sky, 1, "model the sky as a cube map"),
    NUMBER(sky, sky_rate, 0.01, 0, 1, "per step", "set the learning rate of the sky; it falls to a hundredth"),

    AUTO_SWITCH(exposure, exposure, "1; presets plain and paper 0 on static sets",
                "fit a gain and an offset for each photograph"),
    NUMBER(exposure, exposure_rate, 3e-3, 0, 1, "per step", "set the learning rate of exposures; it falls to a tenth"),

    AUTO_SWITCH(cameras, camera_poses, "1 on driving sets, but for blocks; captures, presets plain and paper 0",
                "correct the cameras' poses where that pays"),
    NUMBER(cameras, camera_rotation_rate, 3e-4, 0, 1, "radians per step",
           "set the learning rate of their rotations; it falls to a tenth"),
    NUMBER(cameras, camera_translation_rate, 3e-3, 0, 10, "metres per step",
           "set the learning rate of their positions; it falls to a tenth"),
    NUMBER(cameras, camera_delay_rate, 1.5e-3, 0, 1, "seconds per step",
           "set the learning rate of their delays; it falls to a tenth"),
    AUTO_SWITCH(cameras, light, "1 on driving sets, but for blocks; presets plain and paper 0",
                "fit a vignette and a response curve of each camera of a driving set where that pays"),
    NUMBER(cameras, light_rate, 2e-3, 0, 1, "per step",
           "set the learning rate of vignettes and response curves; it falls to a tenth"),
};
const int pags_field_count = sizeof pags_fields / sizeof pags_fields[0];
