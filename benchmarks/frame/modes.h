/* SPDX-License-Identifier: Apache-2.0 */
/* Renders the same frames by several modes (sets of frame options) and compares them: time by stage, amount of work,
 * and error of the picture against the first mode. */
#ifndef PAGS_BENCHMARKS_MODES_H
#define PAGS_BENCHMARKS_MODES_H

#include <stdbool.h>

#include <pags/frame.h>

/* The stages of a frame; the last one is the whole frame. */
enum {
  PAGS_BENCH_CULL,
  PAGS_BENCH_OCCLUDE,
  PAGS_BENCH_PROJECT,
  PAGS_BENCH_SHADE,
  PAGS_BENCH_SORT,
  PAGS_BENCH_BIN,
  PAGS_BENCH_RASTER,
  PAGS_BENCH_FRAME,
  PAGS_BENCH_STAGES
};
extern const char *const pags_bench_stage_names[PAGS_BENCH_STAGES];

typedef struct pags_bench_mode {
  const char *name;
  pags_frame_options options;
} pags_bench_mode;

enum { PAGS_BENCH_MOST_MODES = 16, PAGS_BENCH_MODE_NAME = 32 };

/* Names of the modes, for help and messages. */
#define PAGS_BENCH_MODE_WORDS "off, lossless, bounded, bounded=EPS, paper, paper-order, exp3, sh0, sh1, sh2"
#define PAGS_BENCH_MODE_HELP                                                                                     \
  PAGS_BENCH_MODE_WORDS                                                                                          \
  ". The first ones as of pags render --early-z; paper-order: paper with --order paper; exp3: exp of degree 3; " \
  "sh0, sh1, sh2: colour of at most that degree. Speed-ups and, except for curve, errors are relative to the first"

typedef struct pags_bench_mode_list {
  pags_bench_mode modes[PAGS_BENCH_MOST_MODES]; /* names point into `names` */
  char names[PAGS_BENCH_MOST_MODES][PAGS_BENCH_MODE_NAME];
  int count;
} pags_bench_mode_list;

/* Parses mode names separated by commas, each a change of `standard`. The names in `out` point into it, so it must
 * not be moved. PAGS_ERROR_ARGUMENT for an unknown name or too many. */
pags_result pags_bench_modes_parse(const char *text, const pags_frame_options *standard, pags_bench_mode_list *out);
/* Index of camera i of `most` chosen ones of `count`: one from each of `most` equal stretches, at an offset that
 * advances by the golden ratio from stretch to stretch, so that a path that cycles through several sensors keeps
 * cameras of each. */
int64_t pags_bench_spread(int64_t i, int64_t most, int64_t count);
/* Thins a path to at most `most` cameras by pags_bench_spread. */
void pags_bench_thin(pags_camera_path *path, int64_t most);
/* Copies the next word of a comma-separated list; returns false at the list's end or if the word doesn't fit into
 * `size` bytes. */
bool pags_bench_next_word(const char **list, char *word, size_t size);

/* The frames to render. All other modes are compared with the first one. */
typedef struct pags_bench_frames {
  pags_tasks *tasks;
  void (*compose)(void *user, double time, const pags_part **parts, int *count); /* the parts to render at a time */
  void *user;
  const pags_camera *cameras;
  int64_t camera_count;
  const pags_bench_mode *modes;
  int mode_count;
  int repetitions;            /* timed frames of each camera and mode, >= 1 */
  pags_progress_fn *progress; /* may be NULL */
  void *progress_user;
} pags_bench_frames;

typedef struct pags_bench_span {
  double median, low, high; /* low, high: 10 % and 90 % quantiles */
} pags_bench_span;

typedef struct pags_bench_mode_result {
  pags_bench_span ms[PAGS_BENCH_STAGES]; /* of all cameras and repetitions */
  /* median ratio of the first mode's frame time to this mode's, of frames rendered one after the other */
  double speed_up;
  pags_frame_stats counts; /* per frame, mean over the cameras; its times are not set */
  double peak;             /* lanes a second of the bare blending kernel with the mode's exp degree, on all threads */
  double bytes;            /* bytes moved per frame, by the stages' data structures */
  double psnr;             /* dB against the first mode over all frames, values clamped to 0..1; infinite if equal */
  double max_error;        /* largest difference of a colour channel, not clamped */
  double max_alpha_error;  /* largest difference of the transmittance */
  double differing;        /* share of pixels whose colour or transmittance differs in any bit */
  double *frame_ms;        /* of each camera: median time of the whole frame */
} pags_bench_mode_result;

/* Milliseconds of a frame in which no pair beyond a pixel's or a tile's stop were binned, sorted or blended, the
 * stages' time being in proportion: what a perfect early stop could bring, but for Gaussians that it needn't project.
 */
double pags_bench_perfect_ms(const pags_bench_mode_result *result);

/* Renders each camera once per mode to count and to compare, then `repetitions` times with the clock, the modes
 * taking turns. `results` has mode_count entries; free them with pags_bench_modes_free, also after a failure.
 * `frame_bytes` (may be NULL) receives the memory that the frame held. */
pags_result pags_bench_modes(const pags_bench_frames *frames, pags_bench_mode_result *results, int64_t *frame_bytes);
void pags_bench_modes_free(pags_bench_mode_result *results, int mode_count);

/* Returns the depth complexity of a picture: the number of (Gaussian, pixel) pairs with alpha >= 1/255, occluded ones
 * included, divided by the number of pixels. Computed in double from the areas of the projected ellipses of the
 * Gaussians whose mean lies in the picture; with the low-pass, without the antialiasing compensation. */
double pags_bench_layers(const pags_part *parts, int part_count, const pags_camera *camera,
                         const pags_frame_options *options);

/* Bytes that a forward frame reads and writes, by the model of `pags-bench stages`. `clusters`: number of clusters in
 * the scene; `packed`: 1 if rows are read in the packed form. */
double pags_bench_forward_bytes(const pags_frame_stats *stats, int sh_degree, double clusters, double pixels,
                                int packed);

#endif
