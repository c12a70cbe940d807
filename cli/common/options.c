/* SPDX-License-Identifier: Apache-2.0 */
/* Parses and checks command lines by the verbs' option tables, and prints the tables as help. */
#include "cli/common/options.h"

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/text.h"

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

void pags_nearest_add(pags_nearest *nearest, const char *name) {
  const int distance = edit_distance(nearest->word, name);
  if (distance > (nearest->name ? nearest->distance - 1 : 1 + (int)strlen(nearest->word) / 3))
    return;
  nearest->name = name;
  nearest->distance = distance;
}

/* Describes the values that an option accepts, for error messages: "a whole number of at least 1". */
static void describe(const pags_option *option, char *text, size_t size) {
  static const char *const nouns[] = {[PAGS_OPTION_INT] = "a whole number",
                                      [PAGS_OPTION_INT64] = "a whole number",
                                      [PAGS_OPTION_UINT64] = "a whole number",
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
  *value = strtoll(text, &end, 10);
  return end != text && !*end && !errno;
}

/* A size in bytes, "512M": a number below 9.2e18. */
static bool parse_size(const char *text, double *value) {
  const char *end;
  if (!parse_real(text, &end, value) || *value < 0)
    return false;
  const char *units = "KMGT", *unit = *end ? strchr(units, toupper((unsigned char)*end)) : NULL;
  if (unit) {
    *value = ldexp(*value, 10 * (int)(unit - units + 1));
    end++;
    if (*end == 'i' || *end == 'B') /* 2GiB and 2GB: both mean powers of 1024 */
      end += end[0] == 'i' && end[1] == 'B' ? 2 : 1;
  }
  return !*end && *value < 9.2e18;
}

static bool parse_duration(const char *text, double *seconds) {
  *seconds = 0;
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
    *seconds += number * unit;
    text = *end ? end + 1 : end;
  }
  return true;
}

static bool parse_span(const char *text, int64_t span[2]) {
  char first[24];
  const size_t length = strcspn(text, "-");
  const bool open = text[length] && !text[length + 1];
  snprintf(first, sizeof first, "%.*s", (int)length, text);
  if (length >= sizeof first || !parse_int64(first, &span[0]) || span[0] < 0)
    return false;
  span[1] = open ? -1 : span[0];
  return open || !text[length] || (parse_int64(text + length + 1, &span[1]) && span[1] >= span[0]);
}

static bool parse_color(const char *text, double rgb[3]) {
  for (int c = 0; c < 3; c++, text++)
    if (!parse_real(text, &text, &rgb[c]) || *text != (c < 2 ? ',' : '\0') || rgb[c] < 0 || rgb[c] > 1)
      return false;
  return true;
}

/* Finds the index of a choice in a list such as "off|on", in any letter case. */
static bool find_choice(const char *choices, const char *text, int *index) {
  for (*index = 0;; ++*index) {
    const size_t length = strcspn(choices, "|");
    if (length == strlen(text) && !strncasecmp(choices, text, length))
      return true;
    if (!choices[length])
      return false;
    choices += length + 1;
  }
}

static bool store_word(pags_words *words, const char *name, size_t length, const char *value) {
  if (length == 0 || length > INT32_MAX || words->count == PAGS_MAX_WORDS || (value && !*value))
    return false;
  words->items[words->count].name = name;
  words->items[words->count].length = (int)length;
  words->items[words->count++].value = value;
  return true;
}

/* Stores a pair given as NAME=VALUE in `text`, or as NAME in `text` and VALUE in **next, which is then taken. A VALUE
 * contains a comma, so an '=' with no comma after it belongs to the name. */
static bool store_pair(pags_words *words, const char *text, char ***next) {
  const char *equals = strrchr(text, '=');
  if (equals && strchr(equals, ','))
    return store_word(words, text, (size_t)(equals - text), equals + 1);
  return **next && store_word(words, text, strlen(text), *(*next)++);
}

/* Parses `text` as the option's type into `slot`; false leaves the message to the caller. */
static bool store(const pags_option *option, const char *text, void *slot, char ***next) {
  double real = 0;
  int64_t whole = 0;
  const char *end;
  char *stop;
  switch (option->type) {
    case PAGS_OPTION_INT:
      if (!parse_int64(text, &whole) || whole < INT32_MIN || whole > INT32_MAX)
        return false;
      *(int *)slot = (int)whole;
      return in_range(option, (double)whole);
    case PAGS_OPTION_INT64: return parse_int64(text, slot) && in_range(option, (double)*(int64_t *)slot);
    case PAGS_OPTION_UINT64:
      errno = 0;
      *(uint64_t *)slot = strtoull(text, &stop, 10);
      return isdigit((unsigned char)*text) && !*stop && !errno && in_range(option, (double)*(uint64_t *)slot);
    case PAGS_OPTION_DOUBLE: return parse_real(text, &end, slot) && !*end && in_range(option, *(double *)slot);
    case PAGS_OPTION_DURATION: return parse_duration(text, slot) && in_range(option, *(double *)slot);
    case PAGS_OPTION_SIZE:
      if (!parse_size(text, &real))
        return false;
      *(uint64_t *)slot = (uint64_t)real;
      return in_range(option, (double)*(uint64_t *)slot);
    case PAGS_OPTION_ENUM: return find_choice(option->metavar, text, slot);
    case PAGS_OPTION_COLOR: return parse_color(text, slot);
    case PAGS_OPTION_SPAN: return parse_span(text, slot);
    case PAGS_OPTION_STRING: *(const char **)slot = text; return *text != '\0';
    case PAGS_OPTION_WORDS: return store_word(slot, text, strlen(text), NULL);
    case PAGS_OPTION_PAIRS: return store_pair(slot, text, next);
    default: return false; /* flags have no value */
  }
}

/* ---- Parsing the command line ---- */

static bool was_given(const pags_parsed *parsed, const pags_option *option) {
  size_t row = (size_t)(option - parsed->verb->options);
  return parsed->given[row / 64] >> (row % 64) & 1;
}

static const pags_option *find_long(const pags_verb *verb, const char *name, size_t length) {
  for (const pags_option *option = verb->options; !is_end(option); option++)
    if (option->name && pags_text_is(name, length, option->name))
      return option;
  return NULL;
}

bool pags_option_given(const pags_parsed *parsed, const char *name) {
  const pags_option *option = find_long(parsed->verb, name, strlen(name));
  assert(option);
  return was_given(parsed, option);
}

/* Stores one option's value: `value`, the text after '=' or directly after a short name; if that is NULL, the next
 * argument. Takes the arguments that it uses from *next. Returns an exit code, as the functions below. */
static int take_option(pags_parsed *parsed, const pags_option *option, const char *shown, const char *value,
                       char ***next, void *values) {
  void *slot = (char *)values + option->offset;
  const size_t row = (size_t)(option - parsed->verb->options);
  assert(row < MAX_ROWS);
  parsed->given[row / 64] |= (uint64_t)1 << (row % 64);
  if (option->type == PAGS_OPTION_FLAG) {
    if (value)
      return pags_usage_error(parsed->verb, "%s: takes no value, got '%s'", shown, value);
    *(int *)slot = strncmp(option->name, "no-", 3) != 0;
    return PAGS_EXIT_OK;
  }
  int64_t whole;
  const bool optional = option->metavar && option->metavar[0] == '[';
  if (optional && !value && !(**next && parse_int64(**next, &whole)))
    return PAGS_EXIT_OK;
  char expected[160];
  describe(option, expected, sizeof expected);
  const char *text = value ? value : **next;
  if (!text)
    return pags_usage_error(parsed->verb, "%s: expected %s, got nothing", shown, expected);
  if (!value)
    ++*next;
  if (!store(option, text, slot, next))
    return pags_usage_error(parsed->verb, "%s: expected %s, got '%s'", shown, expected, text);
  return PAGS_EXIT_OK;
}

/* Refuses an unknown option; suggests the one that may be meant. */
static int refuse_long(const pags_verb *verb, const char *name, size_t length) {
  char word[80], replacement[96];
  pags_nearest nearest = {.word = word};
  snprintf(word, sizeof word, "%.*s", (int)(length < 79 ? length : 79), name);
  if (verb->replacement && verb->replacement(word, replacement, sizeof replacement))
    return pags_usage_error(verb, "--%s is now %s", word, replacement);
  for (const pags_option *row = verb->options; !is_end(row); row++)
    if (row->name)
      pags_nearest_add(&nearest, row->name);
  pags_nearest_add(&nearest, "help");
  if (nearest.name)
    return pags_usage_error(verb, "unknown option '--%s'; did you mean '--%s'?", word, nearest.name);
  return pags_usage_error(verb, "unknown option '--%s'; '%s %s --help' lists them", word, pags_program_name,
                          verb->name);
}

static int take_long(pags_parsed *parsed, const char *name, char ***next, void *values) {
  const size_t length = strcspn(name, "=");
  const pags_option *option = find_long(parsed->verb, name, length);
  char shown[84];
  if (!option)
    return refuse_long(parsed->verb, name, length);
  snprintf(shown, sizeof shown, "--%s", option->name);
  return take_option(parsed, option, shown, name[length] ? name + length + 1 : NULL, next, values);
}

static int take_short(pags_parsed *parsed, const char *argument, char ***next, void *values) {
  const pags_option *option = parsed->verb->options;
  const char shown[3] = {'-', argument[1], 0};
  while (!is_end(option) && option->short_name != argument[1])
    option++;
  if (is_end(option))
    return pags_usage_error(parsed->verb, "unknown option '%s'; '%s %s --help' lists them", argument, pags_program_name,
                            parsed->verb->name);
  const char *value = argument[2] == '=' ? argument + 3 : argument[2] ? argument + 2 : NULL;
  return take_option(parsed, option, shown, value, next, values);
}

static int refuse_usage(const pags_verb *verb, const char *before, const char *what, const char *after) {
  return pags_usage_error(verb, "%s%s%s; usage: %s %s %s", before, what, after, pags_program_name, verb->name,
                          verb->usage);
}

/* Whether all required arguments were given. */
static int check_complete(const pags_parsed *parsed, int positionals) {
  const pags_verb *verb = parsed->verb;
  const char *lacking = verb->positionals[positionals].metavar;
  if (lacking && lacking[0] != '[')
    return refuse_usage(verb, "", lacking, " is missing");
  for (const pags_option *option = verb->options; !is_end(option); option++)
    if (option->required && !was_given(parsed, option)) {
      char shown[84];
      if (option->short_name)
        snprintf(shown, sizeof shown, "-%c ", option->short_name);
      else
        snprintf(shown, sizeof shown, "--%s ", option->name);
      return refuse_usage(verb, shown, option->metavar, " is missing");
    }
  return PAGS_EXIT_OK;
}

/* ---- Help ---- */

/* Prints the shortest decimal that reads back as the same value; whole numbers below a million print as 20, not 2e+01.
 */
static void print_real(char *text, size_t size, double value) {
  if (value == floor(value) && fabs(value) < 1e6) {
    snprintf(text, size, "%.0f", value);
    return;
  }
  for (int digits = 1; digits <= 17; digits++) {
    snprintf(text, size, "%.*g", digits, value);
    if (strtod(text, NULL) == value)
      return;
  }
}

void pags_options_real(char *text, size_t size, double value) {
  print_real(text, size, value);
  char *exponent = strchr(text, 'e');
  if (exponent) { /* shorten the exponent: 1e+09 to 1e9, 1e-06 to 1e-6 */
    char *sign = exponent + 1, *digits = sign + 1 + strspn(sign + 1, "0");
    memmove(sign + (*sign == '-'), digits, strlen(digits) + 1);
  }
}

void pags_options_choice(const char *choices, int index, char *text, size_t size) {
  for (; index > 0; index--)
    choices += strcspn(choices, "|") + 1;
  snprintf(text, size, "%.*s", (int)strcspn(choices, "|"), choices);
}

static void print_size(uint64_t bytes, char *text, size_t size) {
  int k = 0;
  for (; k < 3 && bytes && bytes % 1024 == 0; k++)
    bytes /= 1024;
  snprintf(text, size, "%llu%.*s", (unsigned long long)bytes, k > 0, &"KMG"[k > 0 ? k - 1 : 0]);
}

static void print_default(const pags_option *option, const void *defaults, char *text, size_t size) {
  const void *slot = (const char *)defaults + option->offset;
  const double *reals = slot;
  const int64_t *wholes = slot;
  const char *string;
  text[0] = 0;
  if (option->fallback) {
    snprintf(text, size, "%s", option->fallback);
    return;
  }
  switch (option->type) {
    case PAGS_OPTION_INT: snprintf(text, size, "%d", *(const int *)slot); break;
    case PAGS_OPTION_INT64: snprintf(text, size, "%lld", (long long)*wholes); break;
    case PAGS_OPTION_UINT64: snprintf(text, size, "%llu", (unsigned long long)*(const uint64_t *)slot); break;
    case PAGS_OPTION_DOUBLE:
    case PAGS_OPTION_DURATION: print_real(text, size, *reals); break;
    case PAGS_OPTION_SIZE: print_size(*(const uint64_t *)slot, text, size); break;
    case PAGS_OPTION_COLOR: snprintf(text, size, "%g,%g,%g", reals[0], reals[1], reals[2]); break;
    case PAGS_OPTION_ENUM: pags_options_choice(option->metavar, *(const int *)slot, text, size); break;
    case PAGS_OPTION_SPAN:
      if (wholes[1] >= 0)
        snprintf(text, size, "%lld-%lld", (long long)wholes[0], (long long)wholes[1]);
      break;
    case PAGS_OPTION_STRING:
      string = *(const char *const *)slot;
      snprintf(text, size, "%s", string ? string : "");
      break;
    default: break; /* flags and repeatable options have none */
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
    text += strspn(text, " ");
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

static void print_option(const pags_option *option, const void *defaults) {
  char left[160], standard[120], text[1024], short_form[5] = "    ";
  const bool value = option->type != PAGS_OPTION_FLAG;
  if (option->short_name)
    snprintf(short_form, sizeof short_form, "-%c, ", option->short_name);
  snprintf(left, sizeof left, "  %s--%s%s%s", short_form, option->name, value ? " " : "", value ? option->metavar : "");
  print_default(option, defaults, standard, sizeof standard);
  const bool unit = option->unit != NULL, shown = standard[0] && !option->required; /* required options have none */
  snprintf(text, sizeof text, "%s%s%s%s%s%s%s%s", option->help, unit || shown ? " [" : "", unit ? option->unit : "",
           unit && shown ? "; " : "", shown ? "default " : "", shown ? standard : "", unit || shown ? "]" : "",
           option->required ? " (required)" : "");
  pags_options_entry(left, text, HELP_WIDTH);
}

static void print_help(const pags_verb *verb, const void *defaults) {
  char line[512];
  if (silent)
    return;
  snprintf(line, sizeof line, "usage: %s %s %s", pags_program_name, verb->name, verb->usage);
  print_wrapped(line, 0, 0, HELP_WIDTH);
  putchar('\n');
  print_wrapped(verb->about, 0, 0, HELP_WIDTH);
  putchar('\n');
  for (int i = 0; verb->positionals[i].metavar; i++) {
    snprintf(line, sizeof line, "  %s", verb->positionals[i].metavar);
    pags_options_entry(line, verb->positionals[i].help, HELP_WIDTH);
  }
  for (const pags_option *option = verb->options; !is_end(option); option++)
    if (option->type == PAGS_OPTION_GROUP)
      printf("\n%s\n", option->help);
    else
      print_option(option, defaults);
  pags_options_entry("  -h, --help", "Print this help.", HELP_WIDTH);
  printf("\nExit codes: 0 done, 1 failed, 2 wrong usage, 3 interrupted with its state saved.\n");
}

pags_parse_status pags_options_parse(const pags_verb *verb, int argc, char **argv, void *values, pags_parsed *parsed) {
  int positionals = 0;
  bool options_end = false;
  *parsed = (pags_parsed){.verb = verb, .argc = argc, .argv = argv};
  for (int i = 0; i < argc && strcmp(argv[i], "--"); i++)
    if (!strcmp(argv[i], "--help") || !strcmp(argv[i], "-h")) {
      print_help(verb, values);
      return PAGS_PARSE_HELP;
    }
  for (char **next = argv; *next;) {
    const char *argument = *next++;
    int code = PAGS_EXIT_OK;
    if (!options_end && !strcmp(argument, "--"))
      options_end = true;
    else if (!options_end && !strcmp(argument, "--check-options"))
      parsed->check_only = true;
    else if (!options_end && argument[0] == '-' && argument[1] == '-')
      code = take_long(parsed, argument + 2, &next, values);
    else if (!options_end && argument[0] == '-' && argument[1])
      code = take_short(parsed, argument, &next, values);
    else if (verb->positionals[positionals].metavar)
      parsed->positionals[positionals++] = argument;
    else
      code = refuse_usage(verb, "unexpected '", argument, "'");
    if (code)
      return PAGS_PARSE_USAGE;
  }
  if (check_complete(parsed, positionals))
    return PAGS_PARSE_USAGE;
  return parsed->check_only ? PAGS_PARSE_HELP : PAGS_PARSE_OK;
}

/* ---- Options without effect on the given input ---- */

const pags_option_rule *pags_option_idle(const pags_parsed *parsed, const pags_option_rule *rules, char *names,
                                         size_t size) {
  *names = '\0';
  for (const pags_option_rule *rule = rules; rule->names; rule++) {
    if (rule->applies)
      continue;
    for (const char *at = rule->names; *at;) {
      char name[32];
      const size_t length = strcspn(at, " "), used = strlen(names);
      snprintf(name, sizeof name, "%.*s", (int)length, at);
      if (pags_option_given(parsed, name))
        snprintf(names + used, size - used, "%s--%s", used ? ", " : "", name);
      at += length + strspn(at + length, " ");
    }
    if (*names)
      return rule;
  }
  return NULL;
}

int pags_options_check_effect(const pags_parsed *parsed, const pags_option_rule *rules) {
  char names[128];
  const pags_option_rule *idle = pags_option_idle(parsed, rules, names, sizeof names);
  return idle ? pags_usage_error(parsed->verb, "%s: no effect without %s", names, idle->needs) : PAGS_EXIT_OK;
}
