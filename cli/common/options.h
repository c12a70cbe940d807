/* SPDX-License-Identifier: Apache-2.0 */
/* Command-line options declared in a table.
 *
 * Each verb declares one table, from which parsing, checking, `--help` and the docs are derived. Values are written
 * into the verb's own struct at `offset`; the struct's contents before parsing are the defaults, and help prints them
 * from there, so that no default is written twice. An INT whose metavar is in brackets may stand without its value.
 *
 * Accepted forms: --name VALUE, --name=VALUE, -n VALUE, -nVALUE; flags take no value; `--` ends the options. If an
 * option is given several times, the last one counts. */
#ifndef PAGS_CLI_OPTIONS_H
#define PAGS_CLI_OPTIONS_H

#include <math.h>
#include <pags/base.h>
#include <stdbool.h>

/* The program's name in messages and help: "pags". Each program that links these files defines it. */
extern const char pags_program_name[];

/* Exit codes of the program. */
enum { PAGS_EXIT_OK = 0, PAGS_EXIT_FAILED = 1, PAGS_EXIT_USAGE = 2, PAGS_EXIT_INTERRUPTED = 3 };

typedef enum pags_option_type {
  PAGS_OPTION_END,      /* not an option: the end of the table, {0} */
  PAGS_OPTION_GROUP,    /* not an option: a heading in the help; its text is in `help` */
  PAGS_OPTION_FLAG,     /* int, 1 when given; a flag whose name begins with "no-" sets 0 */
  PAGS_OPTION_INT,      /* int */
  PAGS_OPTION_INT64,    /* int64_t */
  PAGS_OPTION_UINT64,   /* uint64_t */
  PAGS_OPTION_DOUBLE,   /* double */
  PAGS_OPTION_SIZE,     /* uint64_t, bytes; suffix K, M, G, T = 1024 to 1024^4 */
  PAGS_OPTION_DURATION, /* double, seconds; 90, 90s, 30m, 2h, 1h30m */
  PAGS_OPTION_ENUM,     /* int, the index in the choices, which `metavar` lists */
  PAGS_OPTION_COLOR,    /* double[3], "r,g,b", each 0..1 */
  PAGS_OPTION_SPAN,     /* int64_t[2], "A-B", both included, "A-" (to the end, -1) or "A" */
  PAGS_OPTION_STRING,   /* const char *, points into argv */
  PAGS_OPTION_WORDS,    /* pags_words; repeatable */
  PAGS_OPTION_PAIRS     /* pags_words with values: NAME VALUE, or NAME=VALUE if VALUE has a comma; repeatable */
} pags_option_type;

enum { PAGS_MAX_WORDS = 128 }; /* more than the number of fields of the training */

/* The words given to one option, in order. */
typedef struct pags_words {
  int count;
  struct {
    const char *name;  /* points into argv */
    int length;        /* of the name, since in argv "=VALUE" may follow it */
    const char *value; /* NULL for WORDS */
  } items[PAGS_MAX_WORDS];
} pags_words;

typedef struct pags_option {
  const char *name; /* long name without the dashes */
  char short_name;  /* 0: none */
  bool required;
  pags_option_type type;
  size_t offset;           /* of the value in the verb's struct */
  double minimum, maximum; /* range of numbers, sizes and durations, both ends included; equal: unlimited */
  const char *metavar;     /* "N", "FILE"; of an ENUM its choices, "default|mcmc" */
  const char *unit;        /* "steps"; NULL: none */
  /* default shown in the help, if it differs from the stored value; NULL: show the stored value; "": show nothing */
  const char *fallback;
  const char *help;
  /* field of the training's configuration, whose row in the field table completes this one; NULL: this row is
   * complete */
  const char *field;
} pags_option;

/* Rows of a table. letter: the short name, 0 for none; `kind`: what follows PAGS_OPTION_. */
#define PAGS_GROUP(heading) {.type = PAGS_OPTION_GROUP, .help = heading}
#define PAGS_FLAG(long_name, letter, where, text) \
  {.name = long_name, .short_name = letter, .type = PAGS_OPTION_FLAG, .offset = where, .help = text}
#define PAGS_TEXT(long_name, letter, where, meta, standard, text) \
  {long_name, letter, false, PAGS_OPTION_STRING, where, 0, 0, meta, NULL, standard, text, NULL}
#define PAGS_CHOICE(long_name, where, choices, standard, text) \
  {long_name, 0, false, PAGS_OPTION_ENUM, where, 0, 0, choices, NULL, standard, text, NULL}
#define PAGS_VALUE(long_name, letter, kind, where, least, most, meta, units, standard, text) \
  {long_name, letter, false, PAGS_OPTION_##kind, where, least, most, meta, units, standard, text, NULL}
/* The option -o/--output, which is required. */
#define PAGS_OUTPUT(where, meta, text) \
  {"output", 'o', true, PAGS_OPTION_STRING, where, 0, 0, meta, NULL, NULL, text, NULL}
/* Row for a field of the training's configuration; `meta` is NULL for switches and choices. */
#define PAGS_FIELD(long_name, letter, meta, field_name) \
  {.name = long_name, .short_name = letter, .type = PAGS_OPTION_FLAG, .metavar = meta, .field = field_name}
#define PAGS_UNLIMITED HUGE_VAL

typedef struct pags_verb pags_verb;

enum { PAGS_MAX_POSITIONALS = 4 };

/* A command line that was parsed. */
typedef struct pags_parsed {
  const pags_verb *verb;
  int argc; /* of the arguments after the verb */
  char **argv;
  const char *positionals[PAGS_MAX_POSITIONALS];
  uint64_t given[4]; /* bit per row of the table */
  bool check_only;   /* --check-options was given */
} pags_parsed;

struct pags_verb {
  const char *name;  /* "train" */
  const char *usage; /* after "pags train " */
  const char *about; /* a paragraph */
  struct {
    const char *metavar; /* in brackets: optional; NULL ends the list */
    const char *help;
  } positionals[PAGS_MAX_POSITIONALS + 1];
  const pags_option *options; /* ends with a row of zeros */
  /* Writes into `text` the replacement of a removed option, such as "--set densify_from=N"; returns false if the name
   * is unknown. May be NULL. */
  bool (*replacement)(const char *name, char *text, size_t size);
  /* For pags_verb_run (session.h); `arguments` is the verb's struct. `check` refuses values that exclude each other: it
   * returns PAGS_EXIT_OK or pags_usage_error. May be NULL. */
  int (*check)(void *arguments, const pags_parsed *parsed);
  pags_result (*run)(void *arguments, const pags_parsed *parsed);
};

typedef enum pags_parse_status {
  PAGS_PARSE_OK,
  PAGS_PARSE_HELP, /* --help was given and printed, or --check-options was given and all is valid: exit 0 */
  PAGS_PARSE_USAGE /* usage error, one line was printed on stderr: exit 2 */
} pags_parse_status;

/* Parses `argv`, which excludes program and verb and ends with NULL. `values` holds the defaults and receives the
 * options' values. */
pags_parse_status pags_options_parse(const pags_verb *verb, int argc, char **argv, void *values, pags_parsed *parsed);

/* Whether the option was given on the command line; `name` must be in the table. */
bool pags_option_given(const pags_parsed *parsed, const char *name);

/* Turns usage errors and help off: another rank of the job prints them. */
void pags_options_silence(void);

/* Prints "PROGRAM VERB: <message>" on stderr; returns PAGS_EXIT_USAGE. */
int pags_usage_error(const pags_verb *verb, const char *format, ...) PAGS_PRINTF(2, 3);

/* Prints one help entry: `left`, then, from the help column on, `text` wrapped to `width` columns. */
void pags_options_entry(const char *left, const char *text, int width);

/* Prints the shortest decimal that is parsed to the same double: 0.0001, 20, 1e9. */
void pags_options_real(char *text, size_t size, double value);

/* Copies a choice of a list such as "off|on" into `text`. */
void pags_options_choice(const char *choices, int index, char *text, size_t size);

/* Of the names added, the first with the smallest edit distance to `word`. */
typedef struct pags_nearest {
  const char *word, *name; /* NULL: none is close */
  int distance;
} pags_nearest;
void pags_nearest_add(pags_nearest *nearest, const char *name);

/* ---- Options without effect on the given input ---- */

typedef struct pags_option_rule {
  const char *names; /* options of the verb's table, separated by blanks; NULL ends the rules */
  bool applies;      /* whether they have an effect on the given input */
  const char *needs; /* what they require, for the message */
} pags_option_rule;

/* Returns the first violated rule, and the given options without effect in `names`, such as "--shift, --fps"; NULL if
 * every given option has an effect. */
const pags_option_rule *pags_option_idle(const pags_parsed *parsed, const pags_option_rule *rules, char *names,
                                         size_t size);
/* Refuses such options: returns PAGS_EXIT_OK, or pags_usage_error with "--shift, --fps: no effect without NEEDS". */
int pags_options_check_effect(const pags_parsed *parsed, const pags_option_rule *rules);

#endif
