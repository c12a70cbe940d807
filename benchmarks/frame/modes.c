/* SPDX-License-Identifier: Apache-2.0 */
/* Renders cameras by several modes and compares times and pictures.
 *
 * Timed frames of the modes take turns, so that disturbances of the machine affect all of them alike, and the
 * speed-up is the median of ratios of frames rendered one after the other. */
#include "benchmarks/frame/modes.h"
#include "benchmarks/threads/pool_costs.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/sort.h"
#include "maths/maths.h"

const char *const pags_bench_stage_names[PAGS_BENCH_STAGES] = {"cull", "occlude", "project", "shade",
                                                               "sort", "bin",     "raster",  "frame"};

static const size_t stage_at[PAGS_BENCH_STAGES - 1] = {
    offsetof(pags_frame_stats, ms_cull),    offsetof(pags_frame_stats, ms_occlude),
    offsetof(pags_frame_stats, ms_project), offsetof(pags_frame_stats, ms_shade),
    offsetof(pags_frame_stats, ms_sort),    offsetof(pags_frame_stats, ms_bin),
    offsetof(pags_frame_stats, ms_raster)};

static const size_t count_at[] = {
    offsetof(pags_frame_stats, gaussians),     offsetof(pags_frame_stats, in_view),
    offsetof(pags_frame_stats, loaded),        offsetof(pags_frame_stats, hidden),
    offsetof(pags_frame_stats, shaded),        offsetof(pags_frame_stats, binned),
    offsetof(pags_frame_stats, pairs_binned),  offsetof(pags_frame_stats, pairs_evaluated),
    offsetof(pags_frame_stats, pairs_blended), offsetof(pags_frame_stats, pairs_open),
    offsetof(pags_frame_stats, pairs_reached)};
enum { COUNTS = sizeof count_at / sizeof count_at[0] };

/* ---- Lists of cameras and modes ---- */

int64_t pags_bench_spread(int64_t i, int64_t most, int64_t count) {
  const double at = (double)i + fmod((double)i * 0.61803398874989485, 1.0);
  const int64_t index = (int64_t)(at * (double)count / (double)most);
  return most >= count ? i : index < count ? index : count - 1;
}

void pags_bench_thin(pags_camera_path *path, int64_t most) {
  if (most >= path->count)
    return;
  for (int64_t i = 0; i < most; i++)
    path->cameras[i] = path->cameras[pags_bench_spread(i, most, path->count)];
  path->count = most;
}

bool pags_bench_next_word(const char **list, char *word, size_t size) {
  const size_t length = strcspn(*list, ",");
  if (length == 0 || length >= size)
    return false;
  memcpy(word, *list, length);
  word[length] = 0;
  *list += length + ((*list)[length] == ',');
  return true;
}

pags_result pags_bench_modes_parse(const char *text, const pags_frame_options *standard, pags_bench_mode_list *out) {
  const char *list = text;
  out->count = 0;
  while (out->count < PAGS_BENCH_MOST_MODES &&
         pags_bench_next_word(&list, out->names[out->count], PAGS_BENCH_MODE_NAME)) {
    pags_bench_mode *mode = &out->modes[out->count];
    *mode = (pags_bench_mode){out->names[out->count], *standard};

    /* Apply the mode's change to the options. */
    if (!strcmp(mode->name, "exp3"))
      mode->options.exp_degree = 3;
    else if (!strcmp(mode->name, "paper-order"))
      mode->options.early_z = PAGS_EARLY_Z_PAPER, mode->options.order = PAGS_ORDER_PAPER;
    else if (!strncmp(mode->name, "sh", 2) && mode->name[2] >= '0' && mode->name[2] <= '2' && !mode->name[3])
      mode->options.sh_degree = mode->name[2] - '0';
    else if (pags_early_z_parse(mode->name, &mode->options) != PAGS_OK)
      return pags_fail(PAGS_ERROR_ARGUMENT, "--modes: expected " PAGS_BENCH_MODE_WORDS ", got '%s'", mode->name);

    out->count++;
  }
  return *list || out->count == 0
             ? pags_fail(PAGS_ERROR_ARGUMENT, "--modes: expected at most %d modes separated by commas, got '%s'",
                         PAGS_BENCH_MOST_MODES, text)
             : PAGS_OK;
}

/* ---- Comparing pictures ---- */

static double stage_ms(const pags_frame_stats *stats, int stage) {
  double ms = 0;
  if (stage < PAGS_BENCH_STAGES - 1) {
    memcpy(&ms, (const char *)stats + stage_at[stage], sizeof ms);
    return ms;
  }
  for (int i = 0; i < PAGS_BENCH_STAGES - 1; i++)
    ms += stage_ms(stats, i);
  return ms;
}

/* Sums of a mode over all frames, from which its means are computed. */
typedef struct mode_sums {
  double counts[COUNTS], bytes;
  /* squared errors; number of channel values; pixels that differ; all pixels */
  double squared, samples, differing, pixels;
  double *ms; /* PAGS_BENCH_STAGES x camera_count x repetitions */
} mode_sums;

/* The first mode's picture of the current camera. */
typedef struct saved_picture {
  float *planes; /* red, green, blue, transmittance; width x height each */
  int64_t size;
} saved_picture;

static pags_result save_picture(const pags_picture *picture, saved_picture *out) {
  const int64_t size = (int64_t)picture->width * picture->height;
  if (size > out->size) {
    free(out->planes);
    out->size = size;
    out->planes = malloc((size_t)size * 4 * sizeof *out->planes);
  }
  if (!out->planes)
    return pags_out_of_memory("a picture of %d x %d", picture->width, picture->height);
  for (int k = 0; k < 4; k++)
    for (int y = 0; y < picture->height; y++)
      memcpy(out->planes + k * size + (int64_t)y * picture->width,
             (k < 3 ? picture->rgb[k] : picture->transmittance) + (int64_t)y * picture->stride,
             (size_t)picture->width * sizeof(float));
  return PAGS_OK;
}

static double cut(float v) {
  return v <= 0.0f ? 0.0 : v >= 1.0f ? 1.0 : (double)v;
}

static void compare(const pags_picture *picture, const saved_picture *saved, mode_sums *sums,
                    pags_bench_mode_result *out) {
  const int64_t size = (int64_t)picture->width * picture->height;
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->width; x++) {
      const int64_t here = (int64_t)y * picture->stride + x, there = (int64_t)y * picture->width + x;
      int differs = 0;
      for (int k = 0; k < 3; k++) {
        const float now = picture->rgb[k][here], then = saved->planes[k * size + there];
        const double error = cut(now) - cut(then);
        sums->squared += error * error;
        out->max_error = fmax(out->max_error, fabs((double)now - (double)then));
        differs |= memcmp(&now, &then, sizeof now) != 0;
      }
      const float now = picture->transmittance[here], then = saved->planes[3 * size + there];
      out->max_alpha_error = fmax(out->max_alpha_error, fabs((double)now - (double)then));
      differs |= memcmp(&now, &then, sizeof now) != 0;
      sums->differing += differs;
    }
  sums->samples += 3.0 * (double)size;
  sums->pixels += (double)size;
}

/* ---- Measuring ---- */

typedef struct measuring {
  const pags_bench_frames *frames;
  pags_bench_mode_result *results;
  mode_sums *sums;
  pags_frame *frame;
  saved_picture saved;
} measuring;

static int highest_degree(const pags_part *parts, int count, int most) {
  int degree = 0;
  for (int p = 0; p < count; p++)
    degree = parts[p].gaussians->sh_degree > degree ? parts[p].gaussians->sh_degree : degree;
  return degree < most ? degree : most;
}

static pags_result time_camera(measuring *m, int64_t index, const pags_part *parts, int part_count) {
  const pags_bench_frames *f = m->frames;
  const int64_t samples = f->camera_count * f->repetitions;
  for (int r = 0; r < f->repetitions; r++)
    for (int k = 0; k < f->mode_count; k++) {
      pags_picture picture;
      PAGS_TRY(pags_frame_render(m->frame, parts, part_count, f->cameras + index, &f->modes[k].options, NULL, NULL,
                                 &picture));
      const pags_frame_stats *stats = pags_frame_stats_get(m->frame);
      for (int s = 0; s < PAGS_BENCH_STAGES; s++)
        m->sums[k].ms[s * samples + index * f->repetitions + r] = stage_ms(stats, s);
    }
  return PAGS_OK;
}

/* Returns the median and the 10 % and 90 % quantiles of `values`, which are sorted in place. */
static pags_bench_span span_of(double *values, int64_t count) {
  pags_sort_doubles(values, count);
  const double middle = 0.5 * (values[(count - 1) / 2] + values[count / 2]);
  return (pags_bench_span){middle, values[(count - 1) / 10], values[(count - 1) - (count - 1) / 10]};
}

static void sum_up(measuring *m) {
  const pags_bench_frames *f = m->frames;
  const int64_t samples = f->camera_count * f->repetitions, whole = (PAGS_BENCH_STAGES - 1) * samples;
  double *const spare = m->sums[f->mode_count].ms;
  /* the first mode last: its unsorted times are needed by all others */
  for (int k = f->mode_count - 1; k >= 0; k--) {
    mode_sums *sums = &m->sums[k];
    pags_bench_mode_result *out = &m->results[k];
    for (int64_t i = 0; i < samples; i++)
      spare[i] = sums->ms[whole + i] > 0 ? m->sums[0].ms[whole + i] / sums->ms[whole + i] : 1.0;
    out->speed_up = span_of(spare, samples).median;
    for (int64_t c = 0; c < f->camera_count; c++) {
      memcpy(spare, sums->ms + whole + c * f->repetitions, (size_t)f->repetitions * sizeof *spare);
      out->frame_ms[c] = span_of(spare, f->repetitions).median;
    }
    for (int s = 0; s < PAGS_BENCH_STAGES; s++)
      out->ms[s] = span_of(sums->ms + s * samples, samples);
    for (int i = 0; i < COUNTS; i++) {
      const int64_t mean = (int64_t)(sums->counts[i] / (double)f->camera_count);
      memcpy((char *)&out->counts + count_at[i], &mean, sizeof mean);
    }
    out->bytes = sums->bytes / (double)f->camera_count;
    out->psnr = sums->squared > 0 ? -10 * pags_log10(sums->squared / sums->samples) : (double)INFINITY;
    out->differing = sums->pixels > 0 ? sums->differing / sums->pixels : 0;
  }
}

/* Times the bare kernel once more, and keeps the best of all times. */
static void measure_peaks(measuring *m) {
  const char *why = "";
  const pags_kernels *const kernels = pags_kernels_get(&why);
  double rate[2] = {0, 0}; /* by exp degree 3 and 5 */
  for (int k = 0; kernels && k < m->frames->mode_count; k++) {
    const int degree = m->frames->modes[k].options.exp_degree;
    double *const now = &rate[degree == 5];
    *now = *now > 0 ? *now : pags_peak_rate(m->frames->tasks, kernels, degree);
    m->results[k].peak = fmax(m->results[k].peak, *now);
  }
}

double pags_bench_perfect_ms(const pags_bench_mode_result *result) {
  const pags_frame_stats *const s = &result->counts;
  double ms = result->ms[PAGS_BENCH_STAGES - 1].median;
  if (s->pairs_binned > 0)
    ms -= (result->ms[PAGS_BENCH_SORT].median + result->ms[PAGS_BENCH_BIN].median) *
          (1 - (double)s->pairs_reached / (double)s->pairs_binned);
  if (s->pairs_evaluated > 0)
    ms -= result->ms[PAGS_BENCH_RASTER].median * (1 - (double)s->pairs_open / (double)s->pairs_evaluated);
  return ms;
}

static pags_result measure_all(measuring *m) {
  const pags_bench_frames *f = m->frames;
  const int64_t samples = f->camera_count * f->repetitions;
  for (int k = 0; k <= f->mode_count; k++) {
    m->sums[k].ms = malloc((size_t)samples * PAGS_BENCH_STAGES * sizeof(double));
    if (k < f->mode_count)
      m->results[k].frame_ms = malloc((size_t)f->camera_count * sizeof(double));
    if (!m->sums[k].ms || (k < f->mode_count && !m->results[k].frame_ms))
      return pags_out_of_memory("the times of %lld frames", (long long)samples);
  }
  for (int64_t c = 0; c < f->camera_count; c++) {
    const pags_part *parts;
    int part_count;
    if (f->progress && !f->progress(f->progress_user, (double)c / (double)f->camera_count, "frames"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    f->compose(f->user, f->cameras[c].time, &parts, &part_count);

    /* Render one frame of each mode with pairs counted and compare it with the first mode's. */
    const pags_camera *camera = f->cameras + c;
    double clusters = 0;
    for (int p = 0; p < part_count; p++)
      clusters += (double)parts[p].clusters->count;
    for (int k = 0; k < m->frames->mode_count; k++) {
      pags_frame_options options = m->frames->modes[k].options;
      pags_picture picture;
      options.count_pairs = 1;
      PAGS_TRY(pags_frame_render(m->frame, parts, part_count, camera, &options, NULL, NULL, &picture));
      const pags_frame_stats *stats = pags_frame_stats_get(m->frame);

      /* Add the frame's counts to the mode's sums. */
      for (int i = 0; i < COUNTS; i++) {
        int64_t value;
        memcpy(&value, (const char *)stats + count_at[i], sizeof value);
        m->sums[k].counts[i] += (double)value;
      }

      m->sums[k].bytes +=
          pags_bench_forward_bytes(stats, highest_degree(parts, part_count, options.sh_degree), clusters,
                                   (double)camera->width * camera->height, part_count > 0 && parts[0].packed);
      if (k == 0)
        PAGS_TRY(save_picture(&picture, &m->saved));
      compare(&picture, &m->saved, &m->sums[k], &m->results[k]);
    }

    PAGS_TRY(time_camera(m, c, parts, part_count));
    measure_peaks(m);
  }
  sum_up(m);
  return PAGS_OK;
}

pags_result pags_bench_modes(const pags_bench_frames *frames, pags_bench_mode_result *results, int64_t *frame_bytes) {
  measuring m = {.frames = frames, .results = results};
  memset(results, 0, (size_t)frames->mode_count * sizeof *results);
  m.sums = calloc((size_t)frames->mode_count + 1, sizeof *m.sums);
  if (!m.sums)
    return pags_out_of_memory("%d modes", frames->mode_count);
  pags_result result = pags_frame_create(frames->tasks, &m.frame);
  if (result == PAGS_OK)
    result = measure_all(&m);
  for (int k = 0; k <= frames->mode_count; k++)
    free(m.sums[k].ms);
  if (m.frame && frame_bytes)
    *frame_bytes = (int64_t)pags_frame_bytes(m.frame);
  if (m.frame)
    pags_frame_destroy(m.frame);
  free(m.saved.planes);
  free(m.sums);
  return result;
}

void pags_bench_modes_free(pags_bench_mode_result *results, int mode_count) {
  for (int k = 0; k < mode_count; k++) {
    free(results[k].frame_ms);
    results[k].frame_ms = NULL;
  }
}
