/* SPDX-License-Identifier: Apache-2.0 */
/* The training configuration: defaults, checks and conversion of its fields to and from text, driven by the table of
 * train/fields.c. */
#include "train/config.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "train/schedule.h"

#define CONFIG_COOKIE 0x70616773u

/* ---- Fields and defaults ---- */

const pags_train_field *pags_train_field_at(int index) {
  return index >= 0 && index < pags_field_count ? &pags_fields[index] : NULL;
}

const pags_train_field *pags_train_field_find(const char *name) {
  for (int i = 0; i < pags_field_count; i++)
    if (strcmp(pags_fields[i].name, name) == 0)
      return &pags_fields[i];
  return NULL;
}

/* The value of a field of any type but a choice's name as a number, which is exact for all but large seeds. */
static double value_of(const pags_train_config *config, const pags_train_field *f) {
  const void *p = (const char *)config + f->offset;
  switch (f->type) {
    case PAGS_FIELD_INT64: return (double)*(const int64_t *)p;
    case PAGS_FIELD_UINT64: return (double)*(const uint64_t *)p;
    case PAGS_FIELD_DOUBLE: return *(const double *)p;
    default: return *(const int *)p;
  }
}

static void set_value(pags_train_config *config, const pags_train_field *f, double value) {
  void *p = (char *)config + f->offset;
  switch (f->type) {
    case PAGS_FIELD_INT64: *(int64_t *)p = (int64_t)value; break;
    case PAGS_FIELD_UINT64: *(uint64_t *)p = (uint64_t)value; break;
    case PAGS_FIELD_DOUBLE: *(double *)p = value; break;
    default: *(int *)p = (int)value;
  }
}

pags_train_config pags_train_config_default(void) {
  pags_train_config config = {.cookie = CONFIG_COOKIE};
  for (int i = 0; i < pags_field_count; i++)
    set_value(&config, &pags_fields[i], pags_fields[i].standard);
  return config;
}

/* Returns the `index`-th name of the list `choices`, "a|b|c", or NULL beyond the last; `length` receives its
 * length. */
static const char *choice_at(const char *choices, int index, int *length) {
  for (; index > 0 && choices[strcspn(choices, "|")]; index--)
    choices += strcspn(choices, "|") + 1;
  *length = (int)strcspn(choices, "|");
  return index == 0 ? choices : NULL;
}

enum { VALUE_TEXT = 64 };

static void print_value(const pags_train_config *config, const pags_train_field *f, char text[VALUE_TEXT]) {
  const void *p = (const char *)config + f->offset;
  int length;
  const char *choice = f->type == PAGS_FIELD_CHOICE ? choice_at(f->choices, *(const int *)p, &length) : NULL;
  switch (f->type) {
    case PAGS_FIELD_INT64: snprintf(text, VALUE_TEXT, "%" PRId64, *(const int64_t *)p); break;
    case PAGS_FIELD_UINT64: snprintf(text, VALUE_TEXT, "%" PRIu64, *(const uint64_t *)p); break;
    case PAGS_FIELD_DOUBLE: /* the shortest text that reads back to the same value */
      for (int digits = 6; digits <= 17; digits++) {
        snprintf(text, VALUE_TEXT, "%.*g", digits, *(const double *)p);
        if (strtod(text, NULL) == *(const double *)p)
          break;
      }
      break;
    default: /* a choice out of range is printed as a number */
      if (choice)
        snprintf(text, VALUE_TEXT, "%.*s", length, choice);
      else
        snprintf(text, VALUE_TEXT, "%d", *(const int *)p);
  }
}

/* ---- Checking, setting and resolving ---- */

/* Sets one of the fields that `score` has replaced: the values that make up SCORE_DEFAULT choose it. */
static pags_result set_part_of_score(pags_train_config *config, const char *name, const char *text) {
  static const char *const parts[][2] = {
      {"hybrid", "product"}, {"s_sem", "pass"}, {"s_grad", "rank"}, {"s_grad_from", "pass"}};
  for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++)
    if (strcmp(name, parts[i][0]) == 0) {
      const bool is_auto = strcmp(text, "auto") == 0 && strcmp(name, "s_grad") != 0;
      if (!is_auto && strcmp(text, parts[i][1]) != 0)
        return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s is now score=auto|default|paper, got '%s'", name, text);
      if (!is_auto && strcmp(name, "s_grad") != 0) /* both definitions rank */
        config->priority.score = PAGS_SCORE_DEFAULT;
      return PAGS_OK;
    }
  return pags_fail(PAGS_ERROR_ARGUMENT, "unknown training field '%s'", name);
}

/* Sets a field that no longer exists: checkpoints and command lines may still name it with its constant value. */
static pags_result set_retired(pags_train_config *config, const char *name, const char *text) {
  static const struct {
    const char *name;
    double value;
  } retired[] = {{"absgrad", 0},
                 {"absgrad_gradient", 8e-4},
                 {"dense_percent", 0.01},
                 {"extent_most", 20},
                 {"init_scale", 1},
                 {"init_scale_max", 0.1},
                 {"mcmc_growth", 0.05},
                 {"prune_scale", 0.1},
                 {"random_start", 0},
                 {"revised_opacity", 0},
                 {"scale_reset_every", 3000},
                 {"scale_reset_from", 6000},
                 {"scale_reset_until", 21000},
                 {"sh_error", 0},
                 {"sky_rate", 0.01},
                 {"split_divisor", 1.6}};
  for (size_t i = 0; i < sizeof retired / sizeof retired[0]; i++)
    if (strcmp(name, retired[i].name) == 0) {
      char *end;
      const bool same = strtod(text, &end) == retired[i].value && end != text && !*end;
      if (!same && strcmp(name, "sh_error") == 0)
        return pags_fail(PAGS_ERROR_UNSUPPORTED,
                         "sh_error is now sh_loss: a loss of PSNR in dB instead of an error in 255ths; got '%s'", text);
      return same ? PAGS_OK
                  : pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: always %g since PAGS 0.2, got '%s'", name, retired[i].value,
                              text);
    }
  return set_part_of_score(config, name, text);
}

pags_result pags_train_config_check(const pags_train_config *config) {
  if (config->cookie != CONFIG_COOKIE)
    return pags_fail(PAGS_ERROR_ARGUMENT, "training configuration doesn't come from pags_train_config_default");
  for (int i = 0; i < pags_field_count; i++) {
    const pags_train_field *f = &pags_fields[i];
    const double value = value_of(config, f);
    const bool follows_rule = f->rule && value == PAGS_FIELD_AUTO;
    if (!follows_rule && !(value >= f->least && value <= f->most))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: %.10g lies outside of %.10g..%.10g%s", f->name, value, f->least,
                       f->most, f->rule ? " and isn't auto" : "");
  }
  if (config->picture.cluster_size % 16)
    return pags_fail(PAGS_ERROR_ARGUMENT, "cluster_size: %d is no multiple of 16", config->picture.cluster_size);
  const bool mcmc = config->density.strategy == PAGS_STRATEGY_MCMC;
  if (mcmc && config->schedule.preset == PAGS_PRESET_PAPER)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "preset: strategy mcmc keeps its own count; expected default or plain with it");
  if (mcmc && config->priority.prunes > 0)
    return pags_fail(PAGS_ERROR_ARGUMENT, "prunes: strategy mcmc keeps its own count; expected 0 with it");
  const double alpha_min = config->picture.alpha_min;
  if (alpha_min > 0 && alpha_min < (double)PAGS_LEAST_ALPHA_MIN)
    return pags_fail(PAGS_ERROR_ARGUMENT, "alpha_min: expected 0 or at least 1/255, got %g", alpha_min);
  if (alpha_min > 0 && config->picture.antialiased)
    return pags_fail(PAGS_ERROR_ARGUMENT, "alpha_min: antialiased Gaussians are cut at 1/255; expected 0 with them");
  if (alpha_min > 0 && mcmc)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "alpha_min: strategy mcmc counts on opacities from 0.005; expected 0 with it");
  if (config->start.init_opacity <= alpha_min)
    return pags_fail(PAGS_ERROR_ARGUMENT, "init_opacity: at %g nothing is drawn and learns with alpha_min %g",
                     config->start.init_opacity, alpha_min);
  if (config->optimiser.position_rate_begin > 0 && config->optimiser.position_rate_end == 0)
    return pags_fail(PAGS_ERROR_ARGUMENT, "position_rate_end: a log-linear rate can't end at %g",
                     config->optimiser.position_rate_end);
  return PAGS_OK;
}

static pags_result refuse_retired_preset(const char *name) {
  static const struct retired_preset {
    const char *name, *instead;
  } all[] = {
      {"lean", "what it did is part of the default now: leave --preset out"},
      {"short", "use paper, which spreads the same prunes over the whole run"},
      {"fast",
       "it saved 5 to 35 % of the time for 0.5 to 0.9 dB: train for fewer steps, or give --prune-rate 0.55/0.1"}};
  for (size_t i = 0; i < sizeof all / sizeof *all; i++)
    if (!strcmp(name, all[i].name))
      return pags_fail(PAGS_ERROR_ARGUMENT, "preset: %s is gone; %s", name, all[i].instead);
  return PAGS_OK;
}

pags_result pags_train_config_set(pags_train_config *config, const char *name, const char *text) {
  const pags_train_field *f = pags_train_field_find(name);
  if (!f)
    return set_retired(config, name, text);
  void *p = (char *)config + f->offset;
  char *end = NULL;
  if (f->type == PAGS_FIELD_CHOICE) {
    const char *choice;
    int length;
    for (int i = 0; (choice = choice_at(f->choices, i, &length)); i++)
      if (pags_text_is(choice, (size_t)length, text)) {
        *(int *)p = i;
        return PAGS_OK;
      }
    if (f->offset == offsetof(pags_train_config, schedule.preset))
      PAGS_TRY(refuse_retired_preset(text));
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected one of %s, got '%s'", f->name, f->choices, text);
  }
  if (f->rule && strcmp(text, "auto") == 0)
    text = "-1"; /* the value of PAGS_FIELD_AUTO */
  errno = 0;
  if (f->type == PAGS_FIELD_DOUBLE) {
    const double value = strtod(text, &end);
    if (end == text || *end || !isfinite(value))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a number, got '%s'", f->name, text);
    *(double *)p = value;
  } else if (f->type == PAGS_FIELD_UINT64) {
    const uint64_t value = strtoull(text, &end, 10);
    if (end == text || *end || errno || *text == '-')
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a whole number from 0 to 2^64 - 1, got '%s'", f->name, text);
    *(uint64_t *)p = value;
  } else {
    const long long value = strtoll(text, &end, 10);
    const bool narrow = f->type != PAGS_FIELD_INT64;
    if (end == text || *end || errno || (narrow && (value < INT32_MIN || value > INT32_MAX)))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a whole number, got '%s'", f->name, text);
    if (narrow)
      *(int *)p = (int)value;
    else
      *(int64_t *)p = value;
  }
  return PAGS_OK;
}

/* Sets every field that is left to the preset to the preset's value. */
static void take_preset(pags_train_config *config) {
  for (int i = 0; i < pags_field_count; i++) {
    const pags_train_field *f = &pags_fields[i];
    bool has_values = false;
    for (int k = 0; k < PAGS_PRESETS; k++)
      has_values |= f->of_preset[k] != 0;
    if (has_values && value_of(config, f) == PAGS_FIELD_AUTO)
      set_value(config, f, f->of_preset[config->schedule.preset]);
  }
}

/* Fills in the fields that are set to auto; their rows in train/fields.c state the same rules in words. SH degree 1
 * on driving sets is that of Street Gaussians (Yan et al. 2024): a road is passed once, in one direction. The numbers
 * of the preset DEFAULT are those of docs/lab/fewer-pairs.md. */
pags_train_config pags_config_resolve(const pags_train_config *config, bool driving) {
  pags_train_config c = *config;
  const bool paper = c.schedule.preset == PAGS_PRESET_PAPER, baseline = paper || c.schedule.preset == PAGS_PRESET_PLAIN;
  const bool mcmc = c.density.strategy == PAGS_STRATEGY_MCMC;
  if (c.color.sh_degree < 0)
    c.color.sh_degree = driving ? 1 : 3;
  if (c.schedule.half_until < 0 && baseline)
    c.schedule.half_until = PAGS_LEAST_HALF_UNTIL;
  if (c.density.scale_reset < 0 && mcmc)
    c.density.scale_reset = 1;
  if (c.priority.prunes < 0 && mcmc)
    c.priority.prunes = 0;
  if (c.picture.alpha_min < 0 && (mcmc || c.picture.antialiased))
    c.picture.alpha_min = 0;
  if (c.priority.score == PAGS_SCORE_AUTO)
    c.priority.score = paper ? PAGS_SCORE_PAPER : PAGS_SCORE_DEFAULT;
  if (c.priority.critical_weight < 0)
    c.priority.critical_weight = baseline ? 1 : 1 + 2.5 * c.priority.alpha;
  if (c.priority.critical_growth < 0)
    c.priority.critical_growth = c.priority.critical_weight;
  if (c.priority.dropout < 0)
    c.priority.dropout = paper;
  if (c.exposure.exposure < 0 && baseline)
    c.exposure.exposure = driving;
  if (c.cameras.camera_poses < 0)
    c.cameras.camera_poses = driving && !baseline;
  if (c.cameras.light < 0)
    c.cameras.light = driving && !baseline;
  if (c.size_limit.sh_loss < 0 && c.size_limit.target_size > 0)
    c.size_limit.sh_loss = 0;
  take_preset(&c);
  return c;
}

/* ---- To and from text ---- */

void pags_config_write(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]) {
  int used = 0; /* the table's text is far shorter than PAGS_CONFIG_TEXT, so that it always fits */
  for (int i = 0; i < pags_field_count; i++) {
    char value[VALUE_TEXT];
    print_value(config, &pags_fields[i], value);
    used += snprintf(text + used, PAGS_CONFIG_TEXT - (size_t)used, "%s=%s\n", pags_fields[i].name, value);
  }
}

void pags_config_write_json(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]) {
  int used = 0;
  for (int i = 0; i < pags_field_count; i++) {
    char value[VALUE_TEXT];
    const char *quote = pags_fields[i].type == PAGS_FIELD_CHOICE ? "\"" : "";
    print_value(config, &pags_fields[i], value);
    used += snprintf(text + used, PAGS_CONFIG_TEXT - (size_t)used, "%s\"%s\": %s%s%s", i ? ", " : "{",
                     pags_fields[i].name, quote, value, quote);
  }
  snprintf(text + used, PAGS_CONFIG_TEXT - (size_t)used, "}");
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
    if (strcmp(line, "preset") == 0 && strcmp(equals + 1, "none") == 0)
      equals = "=plain"; /* the name that plain had once */
    PAGS_TRY(pags_train_config_set(config, line, equals + 1));
  }
  return PAGS_OK;
}

const char *pags_config_difference(const pags_train_config *a, const pags_train_config *b) {
  for (int i = 0; i < pags_field_count; i++) {
    char left[VALUE_TEXT], right[VALUE_TEXT];
    if (pags_fields[i].offset == offsetof(pags_train_config, schedule.iterations) ||
        pags_fields[i].offset == offsetof(pags_train_config, schedule.schedule_iterations) ||
        pags_fields[i].offset == offsetof(pags_train_config, size_limit.sh_loss))
      continue;
    print_value(a, &pags_fields[i], left);
    print_value(b, &pags_fields[i], right);
    if (strcmp(left, right) != 0)
      return pags_fields[i].name;
  }
  return NULL;
}
