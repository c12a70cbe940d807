/* SPDX-License-Identifier: Apache-2.0 */
/* Ways to draw the same frames, measured side by side: time by stage, what was loaded and drawn, and what the picture
 * lost. */
#ifndef PAGS_BENCHMARKS_MODES_H
#define PAGS_BENCHMARKS_MODES_H

#include <pags/frame.h>

enum { PAGS_BENCH_STAGES = 8 }; /* of a frame, the whole frame last */
extern const char *const pags_bench_stage_names[PAGS_BENCH_STAGES];

typedef struct pags_bench_mode {
  const char *name;
  pags_frame_options options;
} pags_bench_mode;

enum { PAGS_BENCH_MOST_MODES = 16, PAGS_BENCH_MODE_NAME = 32 };

/* What a mode is called, in words for people. */
#define PAGS_BENCH_MODE_WORDS "off, lossless, bounded, bounded=EPS, paper, exp3, sh0, sh1, sh2"
#define PAGS_BENCH_MODE_HELP                                                                                    \
  PAGS_BENCH_MODE_WORDS                                                                                         \
  ". The first ones as of pags render --early-z; exp3: exp of degree 3; sh0, sh1, sh2: colour of at most that " \
  "degree. The first in the list is what others are held against"

typedef struct pags_bench_mode_list {
  pags_bench_mode modes[PAGS_BENCH_MOST_MODES]; /* names point into `names` */
  char names[PAGS_BENCH_MOST_MODES][PAGS_BENCH_MODE_NAME];
  int count;
} pags_bench_mode_list;

/* Modes separated by commas, each changing `standard`. The list must not be moved afterwards. PAGS_ERROR_ARGUMENT. */
pags_result pags_bench_modes_parse(const char *text, const pags_frame_options *standard, pags_bench_mode_list *out);
/* Keeps at most `most` views: one of each stretch of equal length, at a place in it that moves on by the golden
 * section, so that of views in turns of several cameras all cameras come up. */
void pags_bench_thin(pags_camera_path *path, int64_t most);
/* The next piece of a list separated by commas; false at its end or where it doesn't fit into `size` bytes. */
int pags_bench_next_word(const char **list, char *word, size_t size);

/* Frames to draw. The first mode is what the others are held against. */
typedef struct pags_bench_frames {
  pags_tasks *tasks;
  void (*compose)(void *user, double time, const pags_part **parts, int *count); /* what there is to draw at a time */
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
  double median, low, high; /* low, high: the tenth and the ninetieth of a hundred */
} pags_bench_span;

typedef struct pags_bench_mode_result {
  pags_bench_span ms[PAGS_BENCH_STAGES]; /* over all cameras and repetitions */
  double speed_up; /* median ratio of the first mode's frame time to this mode's, of frames drawn one after the other */
  pags_frame_stats counts; /* per frame, on average over the cameras; the times in it are not set */
  double bytes;            /* per frame, by the stages' data structures */
  double psnr;      /* dB against the first mode over all frames, values cut to 0..1; infinite where nothing differs */
  double max_error; /* largest difference of a channel, not cut */
  double max_alpha_error; /* of the transmittance */
  double differing;       /* share of pixels whose colour or transmittance has other bits */
  double *frame_ms;       /* camera_count: median of each camera's whole frame */
} pags_bench_mode_result;

/* Draws each camera once per mode to count and to compare, then `repetitions` times with the clock, modes taking turns.
 * `results` has mode_count entries; free them with pags_bench_modes_free, also after a failure. `frame_bytes` (may be
 * NULL) receives what the frame held. */
pags_result pags_bench_modes(const pags_bench_frames *frames, pags_bench_mode_result *results, int64_t *frame_bytes);
void pags_bench_modes_free(pags_bench_mode_result *results, int mode_count);

/* How deep a picture is: (Gaussian, pixel) pairs with alpha >= 1/255 by pixel, whether anything lies before them or
 * not. By the areas of the projected ellipses of Gaussians whose middle is in the picture, in double; low-pass
 * included, antialiasing not. */
double pags_bench_layers(const pags_part *parts, int part_count, const pags_camera *camera,
                         const pags_frame_options *options);

/* Bytes that a forward frame reads and writes, as `pags-bench stages` counts them. `clusters`: the number of clusters
 * in the scene; `packed`: 1 where rows are read in the packed form. */
double pags_bench_forward_bytes(const pags_frame_stats *stats, int sh_degree, double clusters, double pixels,
                                int packed);

#endif
