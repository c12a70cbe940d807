/* SPDX-License-Identifier: Apache-2.0 */
/* Drivers of the fuzz targets: libFuzzer's (PAGS_LIBFUZZER), and a plain one that mutates the seeds itself, a fixed
 * number of times.
 *
 *   fuzz_GROUP --list                             names of the group's targets
 *   fuzz_GROUP --target=NAME --seeds=FOLDER       writes the seeds there
 *   fuzz_GROUP --target=NAME [--runs=N] [--seed=N] [FILE|FOLDER...]    plain: files, seeds, then mutated ones
 *   fuzz_GROUP --target=NAME CORPUS... -FLAG...                        libFuzzer */
#include "fuzz/fuzz.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/rng.h"
#include "memory_guard.h"
#include "scratch_folder.h"

enum { MEMORY = 1 << 20, TIMES = 64, RUNS = 10000, MOST_SEEDS = 64 };

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const fuzz_target *target;
static struct {
  uint8_t *bytes;
  size_t size;
} seeds[MOST_SEEDS];
static int seed_count;
static const uint8_t *current; /* the input under test, which fuzz_stop saves */
static size_t current_size;

/* ---- Functions that targets call ---- */

void fuzz_seed(const void *bytes, size_t size) {
  if (seed_count == MOST_SEEDS)
    abort();
  seeds[seed_count].bytes = malloc(size + 1);
  if (!seeds[seed_count].bytes)
    abort();
  memcpy(seeds[seed_count].bytes, bytes, size);
  seeds[seed_count++].size = size;
}

void fuzz_seed_text(const char *text) {
  fuzz_seed(text, strlen(text));
}

void fuzz_seed_bytes(file_bytes bytes) {
  fuzz_seed(bytes.data, bytes.size);
  bytes_free(&bytes);
}

void fuzz_seed_saved(pags_result saved, const char *path) {
  uint8_t *bytes;
  size_t size;
  FUZZ_CHECK(saved == PAGS_OK && pags_file_read(path, &bytes, &size) == PAGS_OK);
  fuzz_seed(bytes, size);
  free(bytes);
}

static uint8_t *find_cut(uint8_t *at, size_t size) {
  const size_t length = sizeof FUZZ_CUT - 1;
  for (; size >= length; ++at, --size)
    if (memcmp(at, FUZZ_CUT, length) == 0)
      return at;
  return NULL;
}

static void copy_part(const uint8_t *at, size_t size, fuzz_part *part) {
  part->bytes = malloc(size + 1);
  if (!part->bytes)
    abort();
  if (size)
    memcpy(part->bytes, at, size);
  part->bytes[size] = 0;
  part->size = size;
}

void fuzz_parts(const uint8_t *data, size_t size, int count, fuzz_part *parts) {
  const uint8_t *const end = data + size;
  for (int i = 0; i < count; i++)
    parts[i] = (fuzz_part){0};
  for (int i = 0; i < count; i++) {
    const uint8_t *const cut =
        i + 1 < count && data < end ? find_cut((uint8_t *)(uintptr_t)data, (size_t)(end - data)) : NULL;
    copy_part(data, (size_t)((cut ? cut : end) - data), &parts[i]);
    if (!cut)
      return;
    data = cut + sizeof FUZZ_CUT - 1;
  }
}

void fuzz_parts_free(int count, fuzz_part *parts) {
  for (int i = 0; i < count; i++)
    free(parts[i].bytes);
}

const char *fuzz_folder(void) {
  return scratch_folder;
}

const char *fuzz_file(const char *name, const void *bytes, size_t size) {
  if (!bytes) {
    const char *const path = scratch(name);
    remove(path);
    return path;
  }
  const char *const slash = strrchr(name, '/');
  if (slash) {
    char folder[SCRATCH_PATH];
    snprintf(folder, sizeof folder, "%.300s/%.*s", scratch_folder, (int)(slash - name), name);
    if (!pags_dir_exists(folder) && pags_make_dirs(folder) != PAGS_OK)
      abort();
  }
  return scratch_file(name, bytes, size);
}

void fuzz_refused(pags_result result, const char *name) {
  FUZZ_CHECK(result == PAGS_ERROR_FORMAT || result == PAGS_ERROR_UNSUPPORTED || result == PAGS_ERROR_LIMIT ||
             result == PAGS_ERROR_IO || result == PAGS_ERROR_ARGUMENT);
  if (!strstr(pags_error_message(), name)) {
    fprintf(stderr, "fuzz: the message names no %s: %s\n", name, pags_error_message());
    fuzz_stop(__FILE__, __LINE__, "a refusal says where");
  }
}

int fuzz_gaussians(pags_result result, pags_gaussians *g, const char *name) {
  if (result != PAGS_OK) {
    FUZZ_CHECK(!g->data && g->count == 0);
    fuzz_refused(result, name);
    return 0;
  }
  FUZZ_CHECK(pags_gaussians_find_bad(g, NULL) == 0);
  pags_gaussians_destroy(g);
  return 1;
}

void fuzz_stop(const char *file, int line, const char *what) {
  fprintf(stderr, "fuzz: %s:%d: not so: %s (target %s)\n", file, line, what, target ? target->name : "?");
  abort();
}

/* ---- Running ---- */

static int run(const uint8_t *data, size_t size) {
  /* The input in a block of exactly its size, so that the address sanitizer guards its end. */
  uint8_t *const copy = malloc(size ? size : 1);
  if (!copy)
    abort();
  if (size)
    memcpy(copy, data, size);
  current = data;
  current_size = size;
  memory_guard_begin((target->memory ? target->memory : MEMORY) + (target->times ? target->times : TIMES) * size, 0);
  const int accepted = target->run(copy, size);
  memory_guard_end();
  free(copy);
  return accepted;
}

static const char *argument(int argc, char **argv, const char *name) {
  const size_t length = strlen(name);
  for (int i = 1; i < argc; i++)
    if (strncmp(argv[i], name, length) == 0 && argv[i][length] == '=')
      return argv[i] + length + 1;
  return NULL;
}

static void remove_scratch(void) {
  scratch_remove();
}

static void write_seeds(const char *folder) {
  if (pags_make_dirs(folder) != PAGS_OK)
    exit(1);
  for (int i = 0; i < seed_count; i++) {
    char path[SCRATCH_PATH];
    snprintf(path, sizeof path, "%.400s/seed%02d", folder, i);
    if (pags_file_write(path, seeds[i].bytes, seeds[i].size) != PAGS_OK) {
      fprintf(stderr, "fuzz: %s\n", pags_error_message());
      exit(1);
    }
  }
}

static void list_targets(void) {
  for (int i = 0; fuzz_targets[i]; i++)
    puts(fuzz_targets[i]->name);
}

/* Writes the format's words as a dictionary for libFuzzer. */
static void write_words(const char *path) {
  FILE *const file = fopen(path, "w");
  if (!file)
    exit(1);
  fprintf(file, "\"\\x0a=8<=\\x0a\"\n");
  for (int i = 0; target->words && target->words[i]; i++) {
    fputc('"', file);
    for (const unsigned char *c = (const unsigned char *)target->words[i]; *c; c++)
      fprintf(file, *c < 32 || *c > 126 || *c == '"' || *c == '\\' ? "\\x%02x" : "%c", *c);
    fprintf(file, "\"\n");
  }
  fclose(file);
}

/* Selects the target and handles the options that need no driver. */
static void begin(int argc, char **argv) {
  const char *const name = argument(argc, argv, "--target");
  if (argc > 1 && strcmp(argv[1], "--list") == 0) {
    list_targets();
    exit(0);
  }
  for (int i = 0; fuzz_targets[i] && name; i++)
    if (strcmp(fuzz_targets[i]->name, name) == 0)
      target = fuzz_targets[i];
  if (!target) {
    fprintf(stderr, "usage: %s --target=NAME, one of\n", argv[0]);
    list_targets();
    exit(2);
  }
  system_prefer_memory(); /* the targets write thousands of small files */
  if (scratch_make() != 0)
    exit(1);
  atexit(remove_scratch);
  target->seeds();
  if (argument(argc, argv, "--words"))
    write_words(argument(argc, argv, "--words"));
  if (argument(argc, argv, "--seeds")) {
    write_seeds(argument(argc, argv, "--seeds"));
    exit(0);
  }
}

#ifdef PAGS_LIBFUZZER

size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t capacity);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t capacity, unsigned seed);

int LLVMFuzzerInitialize(int *argc, char ***argv) {
  begin(*argc, *argv);
  return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  run(data, size);
  return 0;
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t capacity, unsigned seed) {
  size = LLVMFuzzerMutate(data, size, capacity);
  return target->mend && seed % 8 ? target->mend(data, size, capacity) : size;
}

#else

#include <signal.h>

/* ---- The plain driver's mutations ---- */

typedef struct dice {
  uint64_t seed, run, next;
} dice;

static size_t draw(dice *d, size_t below) {
  return below ? (size_t)pags_rng_below(d->seed, d->run, d->next++, below) : 0;
}

typedef struct input {
  uint8_t *bytes;
  size_t size, capacity;
} input;

static void put_number(dice *d, input *in) {
  static const uint64_t numbers[] = {0,
                                     1,
                                     2,
                                     127,
                                     128,
                                     255,
                                     256,
                                     32767,
                                     32768,
                                     65535,
                                     65536,
                                     0x7fffffff,
                                     0x80000000,
                                     0xffffffff,
                                     UINT64_MAX,
                                     0x7f800000,
                                     0x7fc00000,
                                     0xff800000,
                                     0x7ff0000000000000,
                                     1ull << 62};
  const uint64_t number = numbers[draw(d, sizeof numbers / sizeof *numbers)];
  const size_t width = (size_t)1 << draw(d, 4);
  if (in->size >= width)
    memcpy(in->bytes + draw(d, in->size - width + 1), &number,
           width); /* the test runs only on little-endian machines */
}

static void remove_range(dice *d, input *in) {
  const size_t at = draw(d, in->size), length = 1 + draw(d, draw(d, 2) ? 8 : in->size - at);
  const size_t cut = length < in->size - at ? length : in->size - at;
  memmove(in->bytes + at, in->bytes + at + cut, in->size - at - cut);
  in->size -= cut;
}

/* Replaces `old` bytes at `at` by other bytes. */
static void splice(input *in, size_t at, size_t old, const void *bytes, size_t size) {
  if (in->size - old + size > in->capacity)
    return;
  memmove(in->bytes + at + size, in->bytes + at + old, in->size - at - old);
  if (size)
    memcpy(in->bytes + at, bytes, size);
  in->size += size - old;
}

static void repeat_range(dice *d, input *in) {
  uint8_t copy[256];
  const size_t at = draw(d, in->size), most = in->size - at < sizeof copy ? in->size - at : sizeof copy,
               size = 1 + draw(d, most);
  const size_t used = size < most ? size : most;
  memcpy(copy, in->bytes + at, used);
  splice(in, draw(d, in->size + 1), 0, copy, used);
}

static void put_word(dice *d, input *in) {
  size_t count = 0;
  while (target->words && target->words[count])
    count++;
  if (count) {
    const char *const word = target->words[draw(d, count)];
    splice(in, draw(d, in->size + 1), 0, word, strlen(word));
  }
}

/* Replaces a number in a text by one that is likely to cause errors. */
static void edit_number(dice *d, input *in) {
  static const char *const numbers[] = {"0",
                                        "-1",
                                        "1",
                                        "4294967295",
                                        "4294967296",
                                        "9223372036854775807",
                                        "-9223372036854775808",
                                        "1e9",
                                        "1e308",
                                        "1e999",
                                        "",
                                        "nan",
                                        "-0",
                                        "2147483648",
                                        "1e-310",
                                        "0.5",
                                        "[]",
                                        "null",
                                        "18446744073709551616"};
  size_t at = draw(d, in->size), end;
  while (at < in->size && (in->bytes[at] < '0' || in->bytes[at] > '9'))
    at++;
  for (end = at; end < in->size && in->bytes[end] >= '0' && in->bytes[end] <= '9';)
    end++;
  const char *const number = numbers[draw(d, sizeof numbers / sizeof *numbers)];
  if (end > at)
    splice(in, at, end - at, number, strlen(number));
}

/* Replaces the end of an input by the end of another seed. */
static void cross(dice *d, input *in) {
  const int other = (int)draw(d, (size_t)seed_count);
  const size_t from = draw(d, seeds[other].size), at = draw(d, in->size);
  splice(in, at, in->size - at, seeds[other].bytes + from, seeds[other].size - from);
}

static void mutate(dice *d, input *in) {
  if (in->size == 0) {
    put_word(d, in);
    return;
  }
  /* Half of the mutations go to the first 400 bytes, where headers are. */
  const size_t reach = draw(d, 2) && in->size > 400 ? 400 : in->size;
  switch (target->nested && draw(d, 8) ? draw(d, 3) : draw(d, 10)) {
    case 0: in->bytes[draw(d, reach)] ^= (uint8_t)(1u << draw(d, 8)); break;
    case 1: in->bytes[draw(d, reach)] = (uint8_t)draw(d, 256); break;
    case 2: put_number(d, in); break;
    case 3: remove_range(d, in); break;
    case 4: repeat_range(d, in); break;
    case 5: put_word(d, in); break;
    case 6: in->size = draw(d, in->size); break;
    case 7: cross(d, in); break;
    default: edit_number(d, in); break;
  }
}

static int run_mutated(uint64_t seed, uint64_t number, input *in) {
  dice d = {.seed = seed, .run = number};
  const int from = (int)draw(&d, (size_t)seed_count);
  in->size = 0;
  splice(in, 0, 0, seeds[from].bytes, seeds[from].size);
  for (size_t k = 0, count = 1 + draw(&d, 4); k < count; k++)
    mutate(&d, in);
  if (target->mend && number % 8)
    in->size = target->mend(in->bytes, in->size, in->capacity);
  return run(in->bytes, in->size);
}

/* Runs a file, or all files of a folder. */
static int run_path(const char *path) {
  if (pags_dir_exists(path)) {
    pags_dir_list names;
    int count = 0;
    if (pags_dir_list_read(path, &names) != PAGS_OK)
      return 0;
    for (int64_t i = 0; i < names.count; i++) {
      char *const below = pags_path_join(path, names.names[i]);
      count += below ? run_path(below) : 0;
      free(below);
    }
    pags_dir_list_destroy(&names);
    return count;
  }
  uint8_t *bytes;
  size_t size;
  if (pags_file_read(path, &bytes, &size) != PAGS_OK) {
    fprintf(stderr, "fuzz: %s\n", pags_error_message());
    exit(1);
  }
  run(bytes, size);
  free(bytes);
  return 1;
}

static void save_current(void) {
  if (!current)
    return;
  const char *const path = "fuzz-crash.bin";
  FILE *const file = fopen(path, "wb");
  if (!file)
    return;
  fwrite(current, 1, current_size, file);
  fclose(file);
  fprintf(stderr, "fuzz: the input is in %s (%zu bytes)\n", path, current_size);
}

static void on_crash(int number) {
  save_current();
  signal(number, SIG_DFL);
  raise(number);
}

static void run_all(int argc, char **argv) {
  const char *const runs = argument(argc, argv, "--runs"), *const seed = argument(argc, argv, "--seed");
  const int64_t count = runs ? strtoll(runs, NULL, 10) : target->smoke ? target->smoke : RUNS;
  int files = 0;
  int64_t accepted = 0;
  size_t largest = 0;
  for (int i = 1; i < argc; i++)
    if (argv[i][0] != '-' && pags_path_exists(argv[i]))
      files += run_path(argv[i]);
  for (int i = 0; i < seed_count; i++) {
    if (!run(seeds[i].bytes, seeds[i].size)) {
      fprintf(stderr, "fuzz: %s: seed %d is refused: %s\n", target->name, i, pags_error_message());
      exit(1);
    }
    largest = seeds[i].size > largest ? seeds[i].size : largest;
  }
  input in = {.capacity = 2 * largest + 4096};
  in.bytes = malloc(in.capacity);
  if (!in.bytes)
    abort();
  for (int64_t i = 0; i < count; i++)
    accepted += run_mutated(seed ? strtoull(seed, NULL, 10) : 2026, (uint64_t)i, &in);
  free(in.bytes);
  printf("%s: %d files, %d seeds, %lld mutated of which %lld accepted\n", target->name, files, seed_count,
         (long long)count, (long long)accepted);
  if (count >= 1000 && (accepted == 0 || accepted == count)) {
    fprintf(stderr, "fuzz: expected some to be refused and some accepted\n");
    exit(1);
  }
}

int main(int argc, char **argv) {
#ifdef SIGBUS
  static const int crashes[] = {SIGABRT, SIGSEGV, SIGFPE, SIGBUS};
#else
  static const int crashes[] = {SIGABRT, SIGSEGV, SIGFPE};
#endif
  begin(argc, argv);
  for (size_t i = 0; i < sizeof crashes / sizeof *crashes; i++)
    signal(crashes[i], on_crash);
  run_all(argc, argv);
  for (int i = 0; i < seed_count; i++)
    free(seeds[i].bytes);
  return 0;
}

#endif
