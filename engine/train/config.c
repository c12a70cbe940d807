/* SPDX-License-Identifier: Apache-2.0 */
/* The configuration: one table of fields serves defaults' printing, flags, checkpoints, scene.json and range checks. */
#include "train/config.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CONFIG_COOKIE 0x70616773u

typedef enum field_kind { FIELD_INT, FIELD_I64, FIELD_U64, FIELD_F64, FIELD_CHOICE } field_kind;

typedef struct field {
  const char *name;
  field_kind kind;
  size_t offset;
  double least, most;         /* inclusive */
  const char *const *choices; /* of an enum, in order; else NULL */
} field;

#define FIELD(group, member, kind, least, most) \
  {#member, kind, offsetof(pags_train_config, group.member), least, most, NULL}
#define CHOICE(group, member, names) \
  {#member, FIELD_CHOICE, offsetof(pags_train_config, group.member), 0, sizeof(names) / sizeof *(names) - 1, names}
#define COLOUR(suffix, i) \
  {"background_" suffix, FIELD_F64, offsetof(pags_train_config, picture.background) + (i) * sizeof(double), 0, 1, NULL}

/* Enums begin at 0, so their fields hold an index; all are of int's size. */
static const char *const strategies[] = {"default", "mcmc"};
static const char *const presets[] = {"none", "lean", "short", "paper"};
static const char *const hybrids[] = {"preset", "sum", "product"};
static const char *const s_sems[] = {"pass", "init", "overlap"};
static const char *const s_grads[] = {"rank", "minmax", "log"};
static const char *const s_grads_from[] = {"pass", "training"};
_Static_assert(sizeof(pags_strategy) == sizeof(int) && sizeof(pags_preset) == sizeof(int), "enums are read as int");

static const double max_count = 2147483584.0; /* 2^31 - 64 */
#define MAX_STEPS 1e9
#define LEAST_OPACITY 0.004 /* what is at or below 1/255 isn't drawn and never gets a gradient */

static const field fields[] = {
    FIELD(schedule, iterations, FIELD_I64, 1, PAGS_CONFIG_STEPS),
    FIELD(schedule, schedule_iterations, FIELD_I64, 0, MAX_STEPS),
    FIELD(schedule, seed, FIELD_U64, 0, INFINITY),
    FIELD(optimiser, position_rate_begin, FIELD_F64, 0, 1),
    FIELD(optimiser, position_rate_end, FIELD_F64, 0, 1),
    FIELD(optimiser, scale_rate, FIELD_F64, 0, 1),
    FIELD(optimiser, rotation_rate, FIELD_F64, 0, 1),
    FIELD(optimiser, opacity_rate, FIELD_F64, 0, 1),
    FIELD(optimiser, sh_dc_rate, FIELD_F64, 0, 1),
    FIELD(optimiser, sh_rest_rate, FIELD_F64, 0, 1),
    FIELD(optimiser, beta1, FIELD_F64, 0, 0.95),
    FIELD(optimiser, beta2, FIELD_F64, 0.95, 0.99999),
    FIELD(optimiser, epsilon, FIELD_F64, 1e-20, 1),
    FIELD(losses, ssim_weight, FIELD_F64, 0, 1),
    FIELD(start, random_start, FIELD_INT, 0, 1),
    FIELD(start, init_opacity, FIELD_F64, LEAST_OPACITY, 0.999),
    FIELD(start, init_scale, FIELD_F64, 1e-6, 1e6),
    FIELD(start, init_scale_max, FIELD_F64, 1e-6, 1e6),
    FIELD(color, sh_degree, FIELD_INT, -1, 3),
    FIELD(color, sh_interval, FIELD_I64, 0, MAX_STEPS),
    FIELD(schedule, quarter_until, FIELD_F64, 0, 1),
    FIELD(schedule, half_until, FIELD_F64, 0, 1),
    FIELD(schedule, resolution_floor, FIELD_INT, 1, 65535),
    CHOICE(density, strategy, strategies),
    FIELD(density, densify_from, FIELD_I64, 0, MAX_STEPS),
    FIELD(density, densify_until, FIELD_I64, -1, MAX_STEPS),
    FIELD(density, densify_every, FIELD_I64, 1, MAX_STEPS),
    FIELD(density, densify_gradient, FIELD_F64, 0, 1e6),
    FIELD(density, absgrad, FIELD_INT, 0, 1),
    FIELD(density, absgrad_gradient, FIELD_F64, 0, 1e6),
    FIELD(density, dense_percent, FIELD_F64, 0, 1e6),
    FIELD(density, split_divisor, FIELD_F64, 1, 100),
    FIELD(density, revised_opacity, FIELD_INT, 0, 1),
    FIELD(density, prune_opacity, FIELD_F64, 0, 1),
    FIELD(density, prune_scale, FIELD_F64, 0, 1e6),
    FIELD(density, reset_every, FIELD_I64, 1, MAX_STEPS),
    FIELD(density, reset_opacity, FIELD_F64, LEAST_OPACITY, 1),
    FIELD(size_limit, max_gaussians, FIELD_I64, 0, max_count),
    FIELD(size_limit, target_size, FIELD_F64, 0, 1e9),
    FIELD(size_limit, sh_error, FIELD_F64, 0, 255),
    FIELD(priority, dropout, FIELD_INT, 0, 1),
    FIELD(priority, dropout_beta, FIELD_F64, 0, 1),
    FIELD(priority, dropout_gamma, FIELD_F64, 0, 0.9),
    CHOICE(priority, preset, presets),
    FIELD(priority, alpha, FIELD_F64, 0, 1),
    CHOICE(priority, hybrid, hybrids),
    FIELD(priority, critical_weight, FIELD_F64, -1, 100),
    FIELD(priority, critical_growth, FIELD_F64, -1, 100),
    FIELD(priority, prune_early, FIELD_F64, -1, 0.99),
    FIELD(priority, prune_late, FIELD_F64, -1, 0.99),
    FIELD(priority, prune_floor, FIELD_I64, 0, max_count),
    CHOICE(priority, s_sem, s_sems),
    CHOICE(priority, s_grad, s_grads),
    CHOICE(priority, s_grad_from, s_grads_from),
    FIELD(mcmc, mcmc_growth, FIELD_F64, 0, 10),
    FIELD(mcmc, mcmc_noise, FIELD_F64, 0, 1e9),
    FIELD(mcmc, mcmc_opacity_reg, FIELD_F64, 0, 1e3),
    FIELD(mcmc, mcmc_scale_reg, FIELD_F64, 0, 1e3),
    FIELD(picture, near_plane, FIELD_F64, 1e-6, 1e6),
    FIELD(picture, low_pass, FIELD_F64, 0, 100),
    FIELD(picture, antialiased, FIELD_INT, 0, 1),
    COLOUR("r", 0),
    COLOUR("g", 1),
    COLOUR("b", 2),
    FIELD(picture, cluster_size, FIELD_INT, 16, 256),
    FIELD(start, extent_most, FIELD_F64, 1e-3, 1e6),
    FIELD(objects, objects, FIELD_INT, 0, 1),
    FIELD(objects, box_prune, FIELD_INT, 0, 1),
    FIELD(objects, tracks, FIELD_INT, 0, 1),
    FIELD(objects, tracks_from, FIELD_I64, 0, MAX_STEPS),
    FIELD(objects, track_translation_rate, FIELD_F64, 0, 1),
    FIELD(objects, track_rotation_rate, FIELD_F64, 0, 1),
    FIELD(objects, fourier, FIELD_INT, 0, 1),
    FIELD(objects, fourier_from, FIELD_I64, 0, MAX_STEPS),
    FIELD(objects, fourier_gain, FIELD_F64, 0, 100),
    FIELD(sky, sky, FIELD_INT, 0, 1),
    FIELD(sky, sky_rate, FIELD_F64, 0, 1),
    FIELD(losses, sky_weight, FIELD_F64, 0, 1e3),
    FIELD(start, lidar_start, FIELD_INT, 0, 1),
    FIELD(losses, depth_weight, FIELD_F64, 0, 1e3),
    FIELD(losses, depth_share, FIELD_F64, 0.01, 1),
    FIELD(density, lidar_pull, FIELD_F64, 0, 1),
    FIELD(losses, object_weight, FIELD_F64, 0, 1e3),
    FIELD(exposure, exposure, FIELD_INT, 0, 1),
    FIELD(exposure, exposure_rate, FIELD_F64, 0, 1),
};
enum { FIELD_COUNT = sizeof fields / sizeof fields[0] };

pags_train_config pags_train_config_default(void) {
  return (pags_train_config){
      .cookie = CONFIG_COOKIE,
      .schedule.iterations = 30000,
      .optimiser.position_rate_begin = 1.6e-4,
      .optimiser.position_rate_end = 1.6e-6,
      .optimiser.scale_rate = 0.005,
      .optimiser.rotation_rate = 0.001,
      .optimiser.opacity_rate = 0.05,
      .optimiser.sh_dc_rate = 0.0025,
      .optimiser.sh_rest_rate = 0.0025 / 20,
      .optimiser.beta1 = 0.9,
      .optimiser.beta2 = 0.999,
      .optimiser.epsilon = 1e-15,
      .losses.ssim_weight = 0.2,
      .start.init_opacity = 0.1,
      .start.init_scale = 1.0,
      .start.init_scale_max = 0.1,
      .color.sh_degree = -1,
      .color.sh_interval = 1000,
      .schedule.quarter_until = 0.05,
      .schedule.half_until = 0.2,
      .schedule.resolution_floor = 64,
      .density.strategy = PAGS_STRATEGY_DEFAULT,
      .density.densify_from = 500,
      .density.densify_until = -1,
      .density.densify_every = 100,
      .density.densify_gradient = 2e-4,
      .density.absgrad_gradient = 8e-4,
      .density.dense_percent = 0.01,
      .density.split_divisor = 1.6,
      .density.prune_opacity = 0.005,
      .density.prune_scale = 0.1,
      .density.reset_every = 3000,
      .density.reset_opacity = 0.01,
      .priority.dropout_beta = 0.5,
      .priority.dropout_gamma = 0.25,
      .priority.alpha = 0.4,
      .priority.critical_weight = -1,
      .priority.critical_growth = -1,
      .priority.prune_early = -1,
      .priority.prune_late = -1,
      .priority.prune_floor = 500,
      .mcmc.mcmc_growth = 0.05,
      .mcmc.mcmc_noise = 5e5,
      .mcmc.mcmc_opacity_reg = 0.01,
      .mcmc.mcmc_scale_reg = 0.01,
      .picture.near_plane = 0.01,
      .picture.low_pass = 0.3,
      .picture.cluster_size = 64,
      .start.extent_most = 20.0,
      .objects.objects = 1,
      .objects.box_prune = 1,
      .objects.tracks = 1,
      .objects.tracks_from = 3000,
      .objects.track_translation_rate = 3e-3,
      .objects.track_rotation_rate = 3e-4,
      .objects.fourier = 1,
      .objects.fourier_from = 15000,
      .objects.fourier_gain = 0.1,
      .sky.sky = 1,
      .sky.sky_rate = 0.01,
      .losses.sky_weight = 0.05,
      .start.lidar_start = 1,
      .losses.depth_weight = 0.01,
      .losses.depth_share = 0.95,
      .losses.object_weight = 0.1,
      .exposure.exposure = 1,
      .exposure.exposure_rate = 3e-3,
  };
}

static void *member(pags_train_config *config, const field *f) {
  return (char *)config + f->offset;
}
static const void *member_const(const pags_train_config *config, const field *f) {
  return (const char *)config + f->offset;
}

/* The field's value for the range check; 64-bit seeds have no range. */
static double value_of(const pags_train_config *config, const field *f) {
  const void *p = member_const(config, f);
  switch (f->kind) {
    case FIELD_INT: return *(const int *)p;
    case FIELD_I64: return (double)*(const int64_t *)p;
    case FIELD_U64: return 0.0;
    case FIELD_F64: return *(const double *)p;
    case FIELD_CHOICE: return *(const int *)p;
  }
  return NAN;
}

static void print_value(const pags_train_config *config, const field *f, char *text, size_t size) {
  const void *p = member_const(config, f);
  switch (f->kind) {
    case FIELD_INT: snprintf(text, size, "%d", *(const int *)p); break;
    case FIELD_I64: snprintf(text, size, "%" PRId64, *(const int64_t *)p); break;
    case FIELD_U64: snprintf(text, size, "%" PRIu64, *(const uint64_t *)p); break;
    case FIELD_F64: { /* the shortest text that reads back to the same value */
      double value = *(const double *)p;
      for (int digits = 6; digits <= 17; digits++) {
        snprintf(text, size, "%.*g", digits, value);
        if (strtod(text, NULL) == value)
          break;
      }
      break;
    }
    case FIELD_CHOICE: { /* out of range until the check: as a number */
      int i = *(const int *)p;
      if (i >= 0 && i <= (int)f->most)
        snprintf(text, size, "%s", f->choices[i]);
      else
        snprintf(text, size, "%d", i);
      break;
    }
  }
}

/* 'a', 'b' or 'c' */
static pags_result parse_choice(int *out, const field *f, const char *text) {
  char expected[128] = "";
  int count = (int)f->most + 1;
  for (int i = 0; i < count; i++) {
    if (strcmp(text, f->choices[i]) == 0) {
      *out = i;
      return PAGS_OK;
    }
    size_t used = strlen(expected);
    snprintf(expected + used, sizeof expected - used, "%s'%s'",
             i == 0           ? ""
             : i + 1 == count ? " or "
                              : ", ",
             f->choices[i]);
  }
  return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected %s, got '%s'", f->name, expected, text);
}

static pags_result parse_value(pags_train_config *config, const field *f, const char *text) {
  void *p = member(config, f);
  char *end = NULL;
  errno = 0;
  if (f->kind == FIELD_CHOICE)
    return parse_choice(p, f, text);
  if (f->kind == FIELD_F64) {
    double value = strtod(text, &end);
    if (end == text || *end || !isfinite(value))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a number, got '%s'", f->name, text);
    *(double *)p = value;
    return PAGS_OK;
  }
  if (f->kind == FIELD_U64) {
    uint64_t value = strtoull(text, &end, 10);
    if (end == text || *end || errno || *text == '-')
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a whole number from 0 to 2^64 - 1, got '%s'", f->name, text);
    *(uint64_t *)p = value;
    return PAGS_OK;
  }
  long long value = strtoll(text, &end, 10);
  if (end == text || *end || errno || (f->kind == FIELD_INT && (value < INT32_MIN || value > INT32_MAX)))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a whole number, got '%s'", f->name, text);
  if (f->kind == FIELD_INT)
    *(int *)p = (int)value;
  else
    *(int64_t *)p = value;
  return PAGS_OK;
}

/* Between -1, which leaves it to the preset, and the least there is nothing to ask for. */
static pags_result check_of_preset(const char *name, double value, double least, double most) {
  if (value > -1 && value < least)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: %g: expected %g to %g (-1: the preset's)", name, value, least, most);
  return PAGS_OK;
}

pags_result pags_train_config_check(const pags_train_config *config) {
  if (config->cookie != CONFIG_COOKIE)
    return pags_fail(PAGS_ERROR_ARGUMENT, "training configuration doesn't come from pags_train_config_default");
  for (int i = 0; i < FIELD_COUNT; i++) {
    const field *f = &fields[i];
    double value = value_of(config, f);
    if (!(value >= f->least && value <= f->most))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: %g lies outside of %g..%g", f->name, value, f->least, f->most);
  }
  PAGS_TRY(check_of_preset("critical_weight", config->priority.critical_weight, 1, 100));
  PAGS_TRY(check_of_preset("critical_growth", config->priority.critical_growth, 1, 100));
  PAGS_TRY(check_of_preset("prune_early", config->priority.prune_early, 0, 0.99));
  PAGS_TRY(check_of_preset("prune_late", config->priority.prune_late, 0, 0.99));
  if (config->picture.cluster_size % 16)
    return pags_fail(PAGS_ERROR_ARGUMENT, "cluster_size: %d is no multiple of 16", config->picture.cluster_size);
  if (config->priority.preset != PAGS_PRESET_NONE && config->density.strategy == PAGS_STRATEGY_MCMC)
    return pags_fail(PAGS_ERROR_ARGUMENT, "preset: strategy mcmc keeps its own count; expected none with it");
  if (config->optimiser.position_rate_begin > 0 && config->optimiser.position_rate_end <= 0)
    return pags_fail(PAGS_ERROR_ARGUMENT, "position_rate_end: a log-linear rate can't end at %g",
                     config->optimiser.position_rate_end);
  return PAGS_OK;
}

pags_result pags_train_config_set(pags_train_config *config, const char *name, const char *value) {
  for (int i = 0; i < FIELD_COUNT; i++)
    if (strcmp(fields[i].name, name) == 0)
      return parse_value(config, &fields[i], value);
  return pags_fail(PAGS_ERROR_ARGUMENT, "'%s' is no field of the training configuration", name);
}

const char *pags_train_config_field(const pags_train_config *config, int index, char *value, size_t value_size) {
  if (index < 0 || index >= FIELD_COUNT)
    return NULL;
  if (value)
    print_value(config, &fields[index], value, value_size);
  return fields[index].name;
}

/* What a preset sets where nothing else was asked for. LEAN's figures are those of docs/lab/priority.md; densifying
 * ends at the same step in SHORT and PAPER, whose it is half of its schedule. */
static void resolve_preset(pags_train_config *c) {
  int lean = c->priority.preset == PAGS_PRESET_LEAN;
  if (c->density.densify_until < 0)
    c->density.densify_until = c->priority.preset == PAGS_PRESET_SHORT ? 25000 : lean ? 12000 : 15000;
  if (c->priority.prune_early < 0)
    c->priority.prune_early = lean ? 0.5 : 0.6;
  if (c->priority.prune_late < 0)
    c->priority.prune_late = lean ? 0.2 : 0.3;
  if (c->priority.hybrid == PAGS_HYBRID_OF_PRESET)
    c->priority.hybrid = lean ? PAGS_HYBRID_PRODUCT : PAGS_HYBRID_SUM;
  if (c->priority.critical_weight < 0)
    c->priority.critical_weight = lean ? 1.0 + 5.0 * c->priority.alpha : 1.0;
  if (c->priority.critical_growth < 0)
    c->priority.critical_growth = c->priority.critical_weight;
}

/* Degree 1 on driving sets, as Street Gaussians: a road is passed once, in one direction. */
pags_train_config pags_config_resolve(const pags_train_config *config, int driving) {
  pags_train_config resolved = *config;
  if (resolved.color.sh_degree < 0)
    resolved.color.sh_degree = driving ? 1 : 3;
  resolve_preset(&resolved);
  return resolved;
}

/* Appends formatted text; the table is far smaller than PAGS_CONFIG_TEXT. */
static size_t append(char *text, size_t used, const char *before, const char *name, const char *between,
                     const char *value, const char *after) {
  int written = snprintf(text + used, PAGS_CONFIG_TEXT - used, "%s%s%s%s%s", before, name, between, value, after);
  return used + (size_t)written;
}

void pags_config_write(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]) {
  size_t used = 0;
  for (int i = 0; i < FIELD_COUNT; i++) {
    char value[64];
    print_value(config, &fields[i], value, sizeof value);
    used = append(text, used, "", fields[i].name, "=", value, "\n");
  }
}

void pags_config_write_json(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]) {
  size_t used = 0;
  for (int i = 0; i < FIELD_COUNT; i++) {
    char value[64];
    const char *quote = fields[i].kind == FIELD_CHOICE ? "\"" : "";
    print_value(config, &fields[i], value, sizeof value);
    used = append(text, used, i ? ", \"" : "{\"", fields[i].name, *quote ? "\": \"" : "\": ", value, quote);
  }
  snprintf(text + used, PAGS_CONFIG_TEXT - used, "}");
}

pags_result pags_config_read(pags_train_config *config, const char *text, size_t size, const char *where) {
  int line_number = 1;
  for (size_t at = 0; at < size; line_number++) {
    char line[128];
    const char *end = memchr(text + at, '\n', size - at);
    size_t length = end ? (size_t)(end - (text + at)) : size - at;
    if (!end || length >= sizeof line)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: configuration line %d is cut off", where, line_number);
    memcpy(line, text + at, length);
    line[length] = 0;
    at += length + 1;
    char *equals = strchr(line, '=');
    if (!equals)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: configuration line %d: expected name=value", where, line_number);
    *equals = 0;
    PAGS_TRY(pags_train_config_set(config, line, equals + 1));
  }
  return PAGS_OK;
}

const char *pags_config_difference(const pags_train_config *a, const pags_train_config *b) {
  for (int i = 0; i < FIELD_COUNT; i++) {
    char left[64], right[64];
    if (fields[i].offset == offsetof(pags_train_config, schedule.iterations) ||
        fields[i].offset == offsetof(pags_train_config, schedule.schedule_iterations))
      continue;
    print_value(a, &fields[i], left, sizeof left);
    print_value(b, &fields[i], right, sizeof right);
    if (strcmp(left, right) != 0)
      return fields[i].name;
  }
  return NULL;
}
