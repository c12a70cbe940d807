/* From the names of rows to options of pags train and pags eval.
 *
 * A name is a list of parts joined by '+'. Later parts win: sp+sd is the pruning of sp with the dropout of sd. */
#include "ablation.h"

#include <math.h>
#include <pags/base.h>
#include <stdlib.h>
#include <string.h>

#include <base/text.h>

typedef struct part {
  const char *name;  /* with '=' at its end: a value follows, which takes the place of %s */
  const char *train; /* options, separated by blanks */
  const char *eval;
  bool of_spr; /* changes something of spr, which is put first where no part says what there is to change */
} part;

static const part parts[] = {
    {"baseline", "", "", false},
    {"sp", "--preset short --alpha 0", "", false},
    {"sd", "--dropout --dropout-beta 0", "", false},
    {"spr", "--preset short --alpha 0.4 --dropout --dropout-beta 0.5", "", false},
    {"lean", "--preset lean", "", false},
    {"pdr", "", "--early-z paper", false},
    {"alpha=", "--alpha %s", "", true},
    {"rate=", "--prune-rate %s", "", true},
    {"preset=", "--preset %s", "", true},
    {"beta=", "--dropout-beta %s", "", true},
    {"gamma=", "--dropout-gamma %s", "", true},
    {"hybrid=", "--hybrid %s", "", true},
    {"critical-weight=", "--critical-weight %s", "", true},
    {"s-sem=", "--s-sem %s", "", true},
    {"s-grad=", "--s-grad %s", "", true},
    {"s-grad-from=", "--s-grad-from %s", "", true},
    {"no-objects", "--no-objects", "", false},
    {"no-tracks", "--no-tracks", "", false},
    {"no-fourier", "--no-fourier", "", false},
    {"no-sky", "--no-sky", "", false},
    {"no-lidar-start", "--no-lidar-start", "", false},
    {"no-lidar-loss", "--depth-weight 0", "", false},
    {"no-exposure", "--no-exposure", "", false},
    {"sh=", "--sh-degree %s", "", false},
};
enum { PART_COUNT = sizeof parts / sizeof parts[0], SPR = 3 };

/* A copy of `text` in the row, or NULL when it is full. */
static const char *keep(pags_ablation_row *row, const char *text, size_t length) {
  char *to = row->text + row->text_used;
  if (row->text_used + length + 1 > sizeof row->text)
    return NULL;
  memcpy(to, text, length);
  to[length] = 0;
  row->text_used += length + 1;
  return to;
}

/* Puts an option (and its value, where there is one) in place of an earlier one of that name, or at the end. */
static void set_option(pags_child_words *words, const char *name, const char *value) {
  int at = 0;
  while (at < words->count && strcmp(words->items[at], name))
    ++at;
  if (at == words->count) {
    pags_child_add(words, name);
    if (value)
      pags_child_add(words, value);
  } else if (value) {
    words->items[at + 1] = value;
  }
}

static pags_result too_long(const char *name) {
  return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': the name is too long", name);
}

/* Options from a template; `value` stands for %s. */
static pags_result add_options(pags_ablation_row *row, pags_child_words *words, const char *text, const char *value) {
  while (*text) {
    size_t length = strcspn(text, " "), value_length = 0;
    const char *next = text + length + (text[length] == ' ');
    const char *name = keep(row, text, length), *kept = NULL;
    if (*next && strncmp(next, "--", 2)) {
      value_length = strcspn(next, " ");
      bool given = !strncmp(next, "%s", 2);
      kept = given ? keep(row, value, strlen(value)) : keep(row, next, value_length);
      if (!kept)
        return too_long(row->name);
      next += value_length + (next[value_length] == ' ');
    }
    if (!name)
      return too_long(row->name);
    set_option(words, name, kept);
    text = next;
  }
  return PAGS_OK;
}

/* "60/30", per cent, to "0.6/0.3", shares. */
static pags_result note_rates(pags_ablation_row *row, const char *value, char *shares, size_t size) {
  char *end;
  double soft = pags_text_to_double(value, &end), hard = -1;
  if (end != value && *end == '/') {
    const char *second = end + 1;
    hard = pags_text_to_double(second, &end);
    if (end == second || *end)
      hard = -1;
  }
  if (!(soft >= 0 && soft < 100 && hard >= 0 && hard < 100))
    return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': expected per cent of both kinds of pruning, as in rate=60/30",
                     row->name);
  snprintf(row->rate_soft, sizeof row->rate_soft, "%g", soft);
  snprintf(row->rate_hard, sizeof row->rate_hard, "%g", hard);
  snprintf(shares, size, "%g/%g", soft / 100, hard / 100);
  return PAGS_OK;
}

static pags_result note_alpha(pags_ablation_row *row, const char *value) {
  char *end;
  row->alpha = pags_text_to_double(value, &end);
  if (end == value || *end)
    return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': expected a number behind alpha=", row->name);
  return PAGS_OK;
}

static const part *find_part(const char *text) {
  for (int i = 0; i < PART_COUNT; ++i) {
    size_t length = strlen(parts[i].name);
    bool takes_value = parts[i].name[length - 1] == '=';
    if (takes_value ? !strncmp(text, parts[i].name, length) : !strcmp(text, parts[i].name))
      return &parts[i];
  }
  return NULL;
}

static pags_result unknown_part(const pags_ablation_row *row, const char *text) {
  char known[512];
  size_t at = 0;
  for (int i = 0; i < PART_COUNT; ++i)
    at += (size_t)snprintf(known + at, sizeof known - at, "%s%s%s", i ? ", " : "", parts[i].name,
                           strchr(parts[i].name, '=') ? "..." : "");
  return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': '%s' is none of %s, nor an option of pags train (--NAME=VALUE)",
                   row->name, text, known);
}

/* "--NAME=VALUE" or "--NAME": an option of pags train as it is. */
static pags_result add_raw(pags_ablation_row *row, const char *text) {
  size_t length = strcspn(text, "=");
  const char *name = keep(row, text, length);
  const char *value = text[length] ? keep(row, text + length + 1, strlen(text + length + 1)) : NULL;
  if (!name || (text[length] && !value))
    return too_long(row->name);
  set_option(&row->train, name, value);
  return PAGS_OK;
}

static pags_result add_part(pags_ablation_row *row, const char *text) {
  if (!strncmp(text, "--", 2))
    return add_raw(row, text);
  const part *found = find_part(text);
  if (!found)
    return unknown_part(row, text);
  const char *equals = strchr(text, '='), *value = equals ? equals + 1 : "";
  char shares[48];
  if (equals && !*value)
    return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': expected a value behind '%s'", row->name, text);
  if (!strcmp(found->name, "alpha="))
    PAGS_TRY(note_alpha(row, value));
  if (!strcmp(found->name, "rate=")) {
    PAGS_TRY(note_rates(row, value, shares, sizeof shares));
    value = shares;
  }
  PAGS_TRY(add_options(row, &row->train, found->train, value));
  return add_options(row, &row->eval, found->eval, value);
}

/* Whether the name changes something of spr without saying of what. */
static bool needs_spr(char *const *names, int count) {
  static const char *const whole[] = {"sp", "sd", "spr", "lean"};
  bool changes = false;
  for (int i = 0; i < count; ++i) {
    const part *found = find_part(names[i]);
    if (found && found->of_spr)
      changes = true;
    for (size_t k = 0; found && k < sizeof whole / sizeof *whole; ++k)
      if (!strcmp(found->name, whole[k]))
        return false;
  }
  return changes;
}

static bool prunes(const pags_ablation_row *row) {
  for (int i = 0; i + 1 < row->train.count; ++i)
    if (!strcmp(row->train.items[i], "--preset"))
      return strcmp(row->train.items[i + 1], "none") != 0;
  return false;
}

static pags_result parse_row(const char *text, size_t length, int seeds, pags_ablation_row *row) {
  enum { MOST_PARTS = 16 };
  char name[sizeof row->name], *names[MOST_PARTS], *star;
  int count = 0;
  *row = (pags_ablation_row){.seeds = seeds, .alpha = (double)NAN};
  if (length == 0 || length >= sizeof row->name)
    return pags_fail(PAGS_ERROR_ARGUMENT, "'%.*s': expected the name of a row, at most %d characters", (int)length,
                     text, (int)sizeof row->name - 1);
  snprintf(row->name, sizeof row->name, "%.*s", (int)length, text);
  star = strchr(row->name, '*');
  if (star) {
    char *end;
    row->seeds = (int)strtol(star + 1, &end, 10);
    if (*end || row->seeds < 1 || row->seeds > PAGS_ABLATION_SEEDS)
      return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s': expected NAME*SEEDS, 1 to %d seeds", row->name,
                       PAGS_ABLATION_SEEDS);
    *star = 0;
  }
  memcpy(name, row->name, sizeof name);
  for (char *at = name; at && count < MOST_PARTS; ++count) {
    names[count] = at;
    at = strchr(at, '+');
    if (at)
      *at++ = 0;
  }
  if (needs_spr(names, count))
    PAGS_TRY(add_part(row, parts[SPR].name));
  for (int i = 0; i < count; ++i)
    PAGS_TRY(add_part(row, names[i]));
  row->prunes = prunes(row);
  return PAGS_OK;
}

pags_result pags_ablation_rows_parse(const char *list, int seeds, pags_ablation_row *rows, int *count) {
  *count = 0;
  for (const char *at = list;;) {
    size_t length = strcspn(at, ",");
    if (*count == PAGS_ABLATION_ROWS)
      return pags_fail(PAGS_ERROR_ARGUMENT, "more than %d rows", PAGS_ABLATION_ROWS);
    PAGS_TRY(parse_row(at, length, seeds, &rows[*count]));
    for (int i = 0; i < *count; ++i)
      if (!strcmp(rows[i].name, rows[*count].name))
        return pags_fail(PAGS_ERROR_ARGUMENT, "row '%s' is named twice", rows[i].name);
    ++*count;
    if (!at[length])
      return PAGS_OK;
    at += length + 1;
  }
}

void pags_ablation_row_bounded(const pags_ablation_row *row, const char *bound, pags_ablation_row *out) {
  *out = *row;
  set_option(&out->train, "--max-gaussians", bound);
}
