/* SPDX-License-Identifier: Apache-2.0 */
/* Parses and checks command lines by the verbs' option tables, and prints the tables as help. */
#include "cli/common/options.h"

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { MAX_ROWS = 256, HELP_WIDTH = 100, HELP_COLUMN = 30 };

static bool is_end(const pags_option *option) {
  return option->type == PAGS_OPTION_END;
}

/* ---- Messages and nearest names ---- */

static bool silent;

void pags_options_silence(void) {
  silent = true;
}

int pags_usage_error(const pags_verb *verb, const char *format, ...) {
  va_list list;
  if (silent)
    return PAGS_EXIT_USAGE;
  fprintf(stderr, "%s %s: ", pags_program_name, verb->name);
  va_start(list, format);
  vfprintf(stderr, format, list);
  va_end(list);
  fputc('\n', stderr);
  return PAGS_EXIT_USAGE;
}

/* Levenshtein distance of two words, computed with one row of the table; words longer than 64 characters get the
 * distance 64. */
static int edit_distance(const char *a, const char *b) {
  enum { LONGEST = 64 };
  int row[LONGEST + 1];
  size_t na = strlen(a), nb = strlen(b);
  if (na > LONGEST || nb > LONGEST)
    return LONGEST;
  for (size_t j = 0; j <= nb; j++)
    row[j] = (int)j;
  for (size_t i = 1; i <= na; i++) {
    int diagonal = row[0];
    row[0] = (int)i;
    for (size_t j = 1; j <= nb; j++) {
      int replaced = diagonal + (a[i - 1] != b[j - 1]);
      int shorter = row[j] < row[j - 1] ? row[j] : row[j - 1];
      diagonal = row[j];
      row[j] = replaced < shorter + 1 ? replaced : shorter + 1;
    }
  }
  return row[nb];
}

const char *pags_nearest_name(const char *word, const char *const *names) {
  const char *best = NULL;
  int best_distance = 1 + (int)strlen(word) / 3;
  for (; *names; names++) {
    int distance = edit_distance(word, *names);
    if (distance <= best_distance && (!best || distance < best_distance)) {
      best = *names;
      best_distance = distance;
    }
  }
  return best;
}

static const pags_option *find_long(const pags_verb *verb, const char *name, size_t length) {
  for (const pags_option *option = verb->options; !is_end(option); option++)
    if (option->name && strlen(option->name) == length && !strncmp(option->name, name, length))
      return option;
  return NULL;
}

/* Describes the values that an option accepts, for error messages: "a whole number of at least 1". */
static void describe(const pags_option *option, char *text, size_t size) {
  static const char *const nouns[] = {[PAGS_OPTION_INT] = "a whole number",
                                      [PAGS_OPTION_INT64] = "a whole number",
                                      [PAGS_OPTION_UINT64] = "a whole number",
                                      [PAGS_OPTION_FLOAT] = "a number",
                                      [PAGS_OPTION_DOUBLE] = "a number",
                                      [PAGS_OPTION_SIZE] = "a size in bytes such as 512M or 2G",
                                      [PAGS_OPTION_DURATION] = "a time such as 90s, 30m or 2h",
                                      [PAGS_OPTION_COLOR] = "r,g,b, each from 0 to 1",
                                      [PAGS_OPTION_WORDS] = "a value",
                                      [PAGS_OPTION_PAIRS] = "a name and a value",
                                      [PAGS_OPTION_SPAN] = "a span such as 10-49, 10- or 10",
                                      [PAGS_OPTION_STRING] = "a value"};
  if (option->type == PAGS_OPTION_ENUM)
    snprintf(text, size, "one of %s", option->metavar);
  else if (option->minimum == option->maximum)
    snprintf(text, size, "%s", nouns[option->type]);
  else if (option->maximum == HUGE_VAL)
    snprintf(text, size, "%s of at least %.10g", nouns[option->type], option->minimum);
  else if (option->minimum == -HUGE_VAL)
    snprintf(text, size, "%s of at most %.10g", nouns[option->type], option->maximum);
  else
    snprintf(text, size, "%s from %.10g to %.10g", nouns[option->type], option->minimum, option->maximum);
}

/* ---- Parsing values ---- */

static bool in_range(const pags_option *option, double value) {
  return option->minimum == option->maximum || (value >= option->minimum && value <= option->maximum);
}

static bool parse_real(const char *text, const char **end, double *value) {
  char *stop;
  if (isspace((unsigned char)*text))
    return false;
  *value = strtod(text, &stop);
  *end = stop;
  return stop != text && isfinite(*value);
}

static bool parse_int64(const char *text, int64_t *value) {
  char *end;
  if (isspace((unsigned char)*text))
    return false;
  errno = 0;
  long long parsed = strtoll(text, &end, 10);
  *value = parsed;
  return end != text && !*end && !errno;
}

static bool parse_size(const char *text, uint64_t *value) {
  const char *end;
  double number, unit = 1;
  if (!parse_real(text, &end, &number) || number < 0)
    return false;
  switch (toupper((unsigned char)*end)) {
    case 'K': unit = 1024.0; break;
    case 'M': unit = 1048576.0; break;
    case 'G': unit = 1073741824.0; break;
    case 'T': unit = 1099511627776.0; break;
    default: break;
  }
  if (unit > 1)
    end++;
  if (unit > 1 && (*end == 'i' || *end == 'B')) /* 2GiB and 2GB: both mean powers of 1024 */
    end += end[0] == 'i' && end[1] == 'B' ? 2 : 1;
  if (*end || number * unit >= 9.2e18)
    return false;
  *value = (uint64_t)(number * unit);
  return true;
}

static bool parse_duration(const char *text, double *seconds) {
  double total = 0;
  if (!*text)
    return false;
  while (*text) {
    double number;
    const char *end;
    if (!parse_real(text, &end, &number) || number < 0)
      return false;
    double unit = *end == 'd' ? 86400 : *end == 'h' ? 3600 : *end == 'm' ? 60 : *end == 's' || !*end ? 1 : 0;
    if (unit == 0)
      return false;
    total += number * unit;
    text = *end ? end + 1 : end;
  }
  *seconds = total;
  return true;
}

static bool parse_span(const char *text, int64_t span[2]) {
  const char *dash = strchr(text, '-');
  char first[24];
  int64_t begin, end = -1;
  size_t length = dash ? (size_t)(dash - text) : strlen(text);
  if (length >= sizeof first)
    return false;
  memcpy(first, text, length);
  first[length] = 0;
  if (!parse_int64(first, &begin) || begin < 0)
    return false;
  if (!dash)
    end = begin;
  else if (dash[1] && (!parse_int64(dash + 1, &end) || end < begin))
    return false;
  span[0] = begin;
  span[1] = end;
  return true;
}

static bool store_word(pags_words *words, const char *name, size_t length, const char *value) {
  if (length == 0 || length > INT32_MAX || words->count == PAGS_MAX_WORDS || (value && !*value))
    return false;
  words->items[words->count].name = name;
  words->items[words->count].length = (int)length;
  words->items[words->count++].value = value;
  return true;
}

/* Parses `text` as the option's type into `slot`; false leaves the message to the caller. */
static bool store(const pags_option *option, const char *text, void *slot) {
  double real;
  int64_t whole;
  uint64_t natural;
  const char *end;
  char *stop;
  switch (option->type) {
    case PAGS_OPTION_INT:
      if (!parse_int64(text, &whole) || whole < INT32_MIN || whole > INT32_MAX || !in_range(option, (double)whole))
        return false;
      *(int *)slot = (int)whole;
      return true;
    case PAGS_OPTION_INT64:
      if (!parse_int64(text, &whole) || !in_range(option, (double)whole))
        return false;
      *(int64_t *)slot = whole;
      return true;
    case PAGS_OPTION_UINT64:
      errno = 0;
      natural = strtoull(text, &stop, 10);
      if (!isdigit((unsigned char)*text) || *stop || errno || !in_range(option, (double)natural))
        return false;
      *(uint64_t *)slot = natural;
      return true;
    case PAGS_OPTION_FLOAT:
    case PAGS_OPTION_DOUBLE:
      if (!parse_real(text, &end, &real) || *end || !in_range(option, real))
        return false;
      if (option->type == PAGS_OPTION_FLOAT)
        *(float *)slot = (float)real;
      else
        *(double *)slot = real;
      return true;
    case PAGS_OPTION_SIZE:
      if (!parse_size(text, &natural) || !in_range(option, (double)natural))
        return false;
      *(uint64_t *)slot = natural;
      return true;
    case PAGS_OPTION_DURATION:
      if (!parse_duration(text, &real) || !in_range(option, real))
        return false;
      *(double *)slot = real;
      return true;
    case PAGS_OPTION_ENUM:
      end = option->metavar;
      for (int index = 0;; index++) {
        const size_t n = strcspn(end, "|");
        if (n == strlen(text) && !strncasecmp(end, text, n)) {
          *(int *)slot = index;
          return true;
        }
        if (!end[n])
          return false;
        end += n + 1;
      }
    case PAGS_OPTION_COLOR:
      for (int c = 0; c < 3; c++, text = end + 1) {
        if (!parse_real(text, &end, &real) || *end != (c < 2 ? ',' : '\0') || real < 0 || real > 1)
          return false;
        ((double *)slot)[c] = real;
      }
      return true;
    case PAGS_OPTION_SPAN: return parse_span(text, (int64_t *)slot);
    case PAGS_OPTION_STRING:
      if (!*text)
        return false;
      *(const char **)slot = text;
      return true;
    case PAGS_OPTION_WORDS: return store_word(slot, text, strlen(text), NULL);
    case PAGS_OPTION_PAIRS:
    case PAGS_OPTION_FLAG:
    case PAGS_OPTION_GROUP:
    case PAGS_OPTION_END: break;
  }
  return false;
}

/* ---- Parsing the command line ---- */

static bool was_given(const pags_parsed *parsed, const pags_option *option) {
  size_t row = (size_t)(option - parsed->verb->options);
  return parsed->given[row / 64] >> (row % 64) & 1;
}

bool pags_option_given(const pags_parsed *parsed, const char *name) {
  const pags_option *option = find_long(parsed->verb, name, strlen(name));
  assert(option);
  return was_given(parsed, option);
}

/* Stores a pair given as NAME=VALUE in `text`, or as NAME in `text` and VALUE in `after`. A VALUE contains a comma,
 * so an '=' with no comma after it belongs to the name. Returns how many arguments after `text` were used, -1 if
 * neither form fits. */
static int store_pair(pags_words *words, const char *text, const char *after) {
  const char *equals = strrchr(text, '=');
  if (equals && strchr(equals, ','))
    return store_word(words, text, (size_t)(equals - text), equals + 1) ? 0 : -1;
  return after && store_word(words, text, strlen(text), after) ? 1 : -1;
}

/* Stores one option's value. `value` is the text after '=' or directly after a short name; if NULL, the value is the
 * next argument. Returns how many further arguments were used, or -1 after printing a message. */
static int take_option(pags_parsed *parsed, const pags_option *option, const char *shown, const char *value,
                       char **next, void *values) {
  void *slot = (char *)values + option->offset;
  char expected[160];
  const size_t row = (size_t)(option - parsed->verb->options);
  assert(row < MAX_ROWS);
  parsed->given[row / 64] |= (uint64_t)1 << (row % 64);
  if (option->type == PAGS_OPTION_FLAG) {
    if (value) {
      pags_usage_error(parsed->verb, "%s: takes no value, got '%s'", shown, value);
      return -1;
    }
    *(int *)slot = strncmp(option->name, "no-", 3) != 0;
    return 0;
  }
  int64_t whole;
  const bool optional = option->metavar && option->metavar[0] == '[';
  if (optional && !value && !(next[0] && parse_int64(next[0], &whole)))
    return 0;
  describe(option, expected, sizeof expected);
  const char *text = value ? value : next[0];
  if (!text) {
    pags_usage_error(parsed->verb, "%s: expected %s, got nothing", shown, expected);
    return -1;
  }
  int more = 0;
  if (option->type == PAGS_OPTION_PAIRS)
    more = store_pair(slot, text, value || !next[0] ? next[0] : next[1]);
  else if (!store(option, text, slot))
    more = -1;
  if (more < 0) {
    pags_usage_error(parsed->verb, "%s: expected %s, got '%s'", shown, expected, text);
    return -1;
  }
  return more + !value;
}

static int take_long(pags_parsed *parsed, const char *argument, char **next, void *values) {
  const char *name = argument + 2, *equals = strchr(name, '=');
  size_t length = equals ? (size_t)(equals - name) : strlen(name);
  const pags_option *option = find_long(parsed->verb, name, length);
  char shown[84];
  if (!option) {
    const char *names[MAX_ROWS + 2];
    char word[80];
    int count = 0;
    for (const pags_option *row = parsed->verb->options; !is_end(row); row++)
      if (row->name && count < MAX_ROWS)
        names[count++] = row->name;
    names[count++] = "help";
    names[count] = NULL;
    snprintf(word, sizeof word, "%.*s", (int)(length < 79 ? length : 79), name);
    char replacement[96];
    if (parsed->verb->replacement && parsed->verb->replacement(word, replacement, sizeof replacement)) {
      pags_usage_error(parsed->verb, "--%s is now %s", word, replacement);
      return -1;
    }
    const char *nearest = pags_nearest_name(word, names);
    if (nearest)
      pags_usage_error(parsed->verb, "unknown option '--%s'; did you mean '--%s'?", word, nearest);
    else
      pags_usage_error(parsed->verb, "unknown option '--%s'; '%s %s --help' lists them", word, pags_program_name,
                       parsed->verb->name);
    return -1;
  }
  snprintf(shown, sizeof shown, "--%s", option->name);
  return take_option(parsed, option, shown, equals ? equals + 1 : NULL, next, values);
}

static int take_short(pags_parsed *parsed, const char *argument, char **next, void *values) {
  const pags_option *option = parsed->verb->options;
  char shown[3] = {'-', argument[1], 0};
  while (!is_end(option) && option->short_name != argument[1])
    option++;
  if (is_end(option)) {
    pags_usage_error(parsed->verb, "unknown option '%s'; '%s %s --help' lists them", argument, pags_program_name,
                     parsed->verb->name);
    return -1;
  }
  const char *value = argument[2] == '=' ? argument + 3 : argument[2] ? argument + 2 : NULL;
  return take_option(parsed, option, shown, value, next, values);
}

static int positional_count(const pags_verb *verb) {
  int count = 0;
  while (verb->positionals[count].metavar)
    count++;
  assert(count <= PAGS_MAX_POSITIONALS);
  return count;
}

static pags_parse_status check_complete(const pags_parsed *parsed, int positionals) {
  const pags_verb *verb = parsed->verb;
  if (positionals < positional_count(verb) && verb->positionals[positionals].metavar[0] != '[') {
    pags_usage_error(verb, "%s is missing; usage: %s %s %s", verb->positionals[positionals].metavar, pags_program_name,
                     verb->name, verb->usage);
    return PAGS_PARSE_USAGE;
  }
  for (const pags_option *option = verb->options; !is_end(option); option++)
    if (option->required && !was_given(parsed, option)) {
      pags_usage_error(verb, "%s%c%s%s %s is missing; usage: %s %s %s", option->short_name ? "-" : "",
                       option->short_name ? option->short_name : '-', option->short_name ? "" : "-",
                       option->short_name ? "" : option->name, option->metavar, pags_program_name, verb->name,
                       verb->usage);
      return PAGS_PARSE_USAGE;
    }
  return PAGS_PARSE_OK;
}

pags_parse_status pags_options_parse(const pags_verb *verb, int argc, char **argv, void *values, pags_parsed *parsed) {
  int positionals = 0, limit = positional_count(verb);
  bool options_end = false;
  memset(parsed, 0, sizeof *parsed);
  parsed->verb = verb;
  for (int i = 0; i < argc && strcmp(argv[i], "--"); i++)
    if (!strcmp(argv[i], "--help") || !strcmp(argv[i], "-h")) {
      pags_options_help(verb, values);
      return PAGS_PARSE_HELP;
    }
  for (int i = 0; i < argc; i++) {
    const char *argument = argv[i];
    char *next[2] = {i + 1 < argc ? argv[i + 1] : NULL, i + 2 < argc ? argv[i + 2] : NULL};
    if (!options_end && !strcmp(argument, "--")) {
      options_end = true;
    } else if (!options_end && !strcmp(argument, "--check-options")) {
      parsed->check_only = true;
    } else if (!options_end && argument[0] == '-' && argument[1]) {
      int used =
          argument[1] == '-' ? take_long(parsed, argument, next, values) : take_short(parsed, argument, next, values);
      if (used < 0)
        return PAGS_PARSE_USAGE;
      i += used;
    } else if (positionals < limit) {
      parsed->positionals[positionals++] = argument;
    } else {
      pags_usage_error(verb, "unexpected '%s'; usage: %s %s %s", argument, pags_program_name, verb->name, verb->usage);
      return PAGS_PARSE_USAGE;
    }
  }
  pags_parse_status status = check_complete(parsed, positionals);
  return status == PAGS_PARSE_OK && parsed->check_only ? PAGS_PARSE_HELP : status;
}

/* ---- Help ---- */

/* Prints the shortest decimal that reads back as the same value of its type: 1e-4f prints as 0.0001, and whole
 * numbers below a million print as 20, not 2e+01. */
static void print_real(char *text, size_t size, double value, bool single) {
  if (value == floor(value) && fabs(value) < 1e6) {
    snprintf(text, size, "%.0f", value);
    return;
  }
  for (int digits = 1; digits <= 17; digits++) {
    snprintf(text, size, "%.*g", digits, value);
    double back = strtod(text, NULL);
    if (single ? (float)back == (float)value : back == value)
      return;
  }
}

void pags_options_real(char *text, size_t size, double value) {
  print_real(text, size, value, false);
  char *exponent = strchr(text, 'e');
  if (exponent) { /* shorten the exponent: 1e+09 to 1e9, 1e-06 to 1e-6 */
    char *sign = exponent + 1, *digits = sign + 1 + strspn(sign + 1, "0");
    memmove(sign + (*sign == '-'), digits, strlen(digits) + 1);
  }
}

static void print_default(const pags_option *option, const void *defaults, char *text, size_t size) {
  const void *slot = (const char *)defaults + option->offset;
  text[0] = 0;
  if (option->fallback) {
    snprintf(text, size, "%s", option->fallback);
    return;
  }
  switch (option->type) {
    case PAGS_OPTION_INT: snprintf(text, size, "%d", *(const int *)slot); break;
    case PAGS_OPTION_INT64: snprintf(text, size, "%lld", (long long)*(const int64_t *)slot); break;
    case PAGS_OPTION_UINT64: snprintf(text, size, "%llu", (unsigned long long)*(const uint64_t *)slot); break;
    case PAGS_OPTION_FLOAT: print_real(text, size, (double)*(const float *)slot, true); break;
    case PAGS_OPTION_DOUBLE:
    case PAGS_OPTION_DURATION: print_real(text, size, *(const double *)slot, false); break;
    case PAGS_OPTION_SIZE: {
      uint64_t bytes = *(const uint64_t *)slot;
      int k = 0;
      for (; k < 3 && bytes && bytes % 1024 == 0; k++)
        bytes /= 1024;
      snprintf(text, size, "%llu%.*s", (unsigned long long)bytes, k > 0, &"KMG"[k > 0 ? k - 1 : 0]);
      break;
    }
    case PAGS_OPTION_COLOR: {
      const double *rgb = slot;
      snprintf(text, size, "%g,%g,%g", rgb[0], rgb[1], rgb[2]);
      break;
    }
    case PAGS_OPTION_ENUM: {
      const char *choice = option->metavar;
      for (int i = *(const int *)slot; i > 0; i--)
        choice += strcspn(choice, "|") + 1;
      snprintf(text, size, "%.*s", (int)strcspn(choice, "|"), choice);
      break;
    }
    case PAGS_OPTION_SPAN:
      if (((const int64_t *)slot)[1] >= 0)
        snprintf(text, size, "%lld-%lld", (long long)((const int64_t *)slot)[0], (long long)((const int64_t *)slot)[1]);
      break;
    case PAGS_OPTION_STRING:
      if (*(const char *const *)slot)
        snprintf(text, size, "%s", *(const char *const *)slot);
      break;
    case PAGS_OPTION_WORDS:
    case PAGS_OPTION_PAIRS:
    case PAGS_OPTION_FLAG:
    case PAGS_OPTION_GROUP:
    case PAGS_OPTION_END: break;
  }
}

/* Prints the words of `text` wrapped to `width` columns; `used` columns of the first line are taken already, and
 * further lines are indented to `column`. */
static void print_wrapped(const char *text, int used, int column, int width) {
  int at = used;
  while (*text) {
    int length = (int)strcspn(text, " ");
    if (at + length + (at > column) > width && at > column) {
      printf("\n%*s", column, "");
      at = column;
    } else if (at > column) {
      putchar(' ');
      at++;
    }
    printf("%.*s", length, text);
    at += length;
    text += length;
    while (*text == ' ')
      text++;
  }
  putchar('\n');
}

void pags_options_entry(const char *left, const char *text, int width) {
  int used = printf("%s", left);
  if (used > HELP_COLUMN - 2) {
    putchar('\n');
    used = 0;
  }
  printf("%*s", HELP_COLUMN - used, "");
  print_wrapped(text, HELP_COLUMN, HELP_COLUMN, width);
}

void pags_options_help(const pags_verb *verb, const void *defaults) {
  if (silent)
    return;
  char usage[512];
  snprintf(usage, sizeof usage, "usage: %s %s %s", pags_program_name, verb->name, verb->usage);
  print_wrapped(usage, 0, 0, HELP_WIDTH);
  putchar('\n');
  print_wrapped(verb->about, 0, 0, HELP_WIDTH);
  putchar('\n');
  for (const pags_positional *positional = verb->positionals; positional->metavar; positional++) {
    char left[80];
    snprintf(left, sizeof left, "  %s", positional->metavar);
    pags_options_entry(left, positional->help, HELP_WIDTH);
  }
  for (const pags_option *option = verb->options; !is_end(option); option++) {
    if (option->type == PAGS_OPTION_GROUP) {
      printf("\n%s\n", option->help);
      continue;
    }
    char left[160], standard[120], text[1024];
    bool value = option->type != PAGS_OPTION_FLAG;
    char short_form[5] = "    ";
    if (option->short_name)
      snprintf(short_form, sizeof short_form, "-%c, ", option->short_name);
    snprintf(left, sizeof left, "  %s--%s%s%s", short_form, option->name, value ? " " : "",
             value ? option->metavar : "");
    print_default(option, defaults, standard, sizeof standard);
    bool unit = option->unit != NULL, shown = standard[0] != 0 && !option->required; /* required options have none */
    snprintf(text, sizeof text, "%s%s%s%s%s%s%s%s", option->help, unit || shown ? " [" : "", unit ? option->unit : "",
             unit && shown ? "; " : "", shown ? "default " : "", shown ? standard : "", unit || shown ? "]" : "",
             option->required ? " (required)" : "");
    pags_options_entry(left, text, HELP_WIDTH);
  }
  pags_options_entry("  -h, --help", "Print this help.", HELP_WIDTH);
  printf("\nExit codes: 0 done, 1 failed, 2 wrong usage, 3 interrupted with its state saved.\n");
}
