/* SPDX-License-Identifier: Apache-2.0 */
/* PSNR, SSIM and LPIPS of views, by region, and their means, as text and as JSON.
 *
 * PSNR of a region is computed from the squared error over the region's pixels and all three channels; SSIM of a
 * region is the mean of the whole picture's SSIM map over its pixels. Means are over the views that have pixels of
 * the region. */
#include "cli/measure/view_scores.h"

#include <math.h>
#include <pags/eval.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/psnr.h"

static const char *const suffixes[PAGS_REGION_COUNT] = {"",          "_critical",    "_noncritical", "_moving",
                                                        "_vehicles", "_pedestrians", "_cyclists"};

pags_view_score pags_view_score_make(const char *name, int test) {
  pags_view_score score = {.name = name, .test = test};
  score.lpips = score.psnr_unexposed = score.psnr_right = score.psnr_right_fitted = (double)NAN;
  for (int r = 0; r < PAGS_REGION_COUNT; r++)
    score.psnr[r] = score.ssim[r] = (double)NAN;
  return score;
}

static unsigned regions_of(unsigned labels) {
  unsigned bits = labels & PAGS_LABEL_CRITICAL ? 1u << PAGS_REGION_CRITICAL : 1u << PAGS_REGION_NONCRITICAL;
  bits |= labels & PAGS_LABEL_MOVING ? 1u << PAGS_REGION_MOVING : 0;
  bits |= labels & PAGS_LABEL_VEHICLE ? 1u << PAGS_REGION_VEHICLES : 0;
  bits |= labels & PAGS_LABEL_PEDESTRIAN ? 1u << PAGS_REGION_PEDESTRIANS : 0;
  bits |= labels & PAGS_LABEL_CYCLIST ? 1u << PAGS_REGION_CYCLISTS : 0;
  return bits;
}

void pags_regions_fill(int width, int height, const uint8_t *mask, const uint8_t *labels, int stride,
                       uint16_t *regions) {
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      size_t at = (size_t)y * (size_t)width + (size_t)x;
      unsigned bits = 1u << PAGS_REGION_WHOLE;
      if (labels)
        bits |= regions_of(labels[(size_t)y * (size_t)stride + (size_t)x]);
      regions[at] = (uint16_t)(mask && !mask[at] ? 0 : bits);
    }
}

pags_result pags_view_score_measure(const pags_image *render, const pags_photograph *photograph, pags_tasks *tasks,
                                    pags_view_score *score) {
  const int width = render->width, height = render->height;
  uint16_t *regions = malloc((size_t)width * (size_t)height * sizeof *regions);
  if (!regions)
    return pags_out_of_memory("a picture of %dx%d", width, height);
  pags_regions_fill(width, height, photograph->mask, photograph->photo.labels, photograph->photo.stride, regions);
  const pags_result result =
      pags_eval_regions(render, &photograph->image, regions, PAGS_REGION_COUNT, tasks, score->psnr, score->ssim);
  free(regions);
  for (int r = 0; result == PAGS_OK && r < PAGS_REGION_COUNT; r++)
    score->psnr[r] = pags_psnr_capped(score->psnr[r]);
  return result;
}

/* A running mean; NaN is skipped. */
typedef struct running_mean {
  double sum;
  int64_t count;
} running_mean;

static void mean_add(running_mean *m, double value) {
  if (isnan(value))
    return;
  m->sum += value;
  m->count++;
}

static double mean_of(const running_mean *m) {
  return m->count ? m->sum / (double)m->count : (double)NAN; /* JSON writes NaN as null */
}

pags_mean_score pags_view_scores_mean(const pags_view_score *scores, int64_t count, int test) {
  pags_mean_score out = {.mean = pags_view_score_make(NULL, test)};
  running_mean psnr[PAGS_REGION_COUNT] = {{0}}, ssim[PAGS_REGION_COUNT] = {{0}}, lpips = {0}, unexposed = {0};
  running_mean right = {0}, right_fitted = {0};
  for (int64_t i = 0; i < count; i++) {
    if (scores[i].test != test)
      continue;
    out.views++;
    for (int r = 0; r < PAGS_REGION_COUNT; r++) {
      mean_add(&psnr[r], scores[i].psnr[r]);
      mean_add(&ssim[r], scores[i].ssim[r]);
    }
    mean_add(&lpips, scores[i].lpips);
    mean_add(&unexposed, scores[i].psnr_unexposed);
    mean_add(&right, scores[i].psnr_right);
    mean_add(&right_fitted, scores[i].psnr_right_fitted);
  }
  for (int r = 0; r < PAGS_REGION_COUNT; r++) {
    out.mean.psnr[r] = mean_of(&psnr[r]);
    out.mean.ssim[r] = mean_of(&ssim[r]);
  }
  out.mean.lpips = mean_of(&lpips);
  out.mean.psnr_unexposed = mean_of(&unexposed);
  out.mean.psnr_right = mean_of(&right);
  out.mean.psnr_right_fitted = mean_of(&right_fitted);
  return out;
}

void pags_view_scores_put_json(pags_json_writer *writer, const pags_view_score *score) {
  char key[32];
  pags_json_put_number(writer, "psnr", score->psnr[PAGS_REGION_WHOLE]);
  pags_json_put_number(writer, "ssim", score->ssim[PAGS_REGION_WHOLE]);
  pags_json_put_number(writer, "lpips", score->lpips);
  pags_json_put_number(writer, "psnr_unexposed", score->psnr_unexposed);
  pags_json_put_number(writer, "psnr_right", score->psnr_right);
  pags_json_put_number(writer, "psnr_right_fitted", score->psnr_right_fitted);
  for (int r = PAGS_REGION_WHOLE + 1; r < PAGS_REGION_COUNT; r++) {
    snprintf(key, sizeof key, "psnr%s", suffixes[r]);
    pags_json_put_number(writer, key, score->psnr[r]);
    snprintf(key, sizeof key, "ssim%s", suffixes[r]);
    pags_json_put_number(writer, key, score->ssim[r]);
  }
}

static void print_row(const pags_session *session, const char *name, const char *set, double psnr, double ssim,
                      double lpips) {
  char distance[16] = "-";
  if (isfinite(lpips))
    snprintf(distance, sizeof distance, "%.4f", lpips);
  pags_say(session, "%-32s %-5s %9.3f %8.4f %8s\n", name, set, psnr, ssim, distance);
}

void pags_view_scores_print(const pags_session *session, const pags_view_score *scores, int64_t count) {
  static const char *const sets[2] = {"train", "test"};
  pags_say(session, "%-32s %-5s %9s %8s %8s\n", "view", "set", "PSNR dB", "SSIM", "LPIPS");
  for (int test = 0; test < 2; test++)
    for (int64_t i = 0; i < count; i++)
      if (scores[i].test == test)
        print_row(session, scores[i].name, sets[test], scores[i].psnr[PAGS_REGION_WHOLE],
                  scores[i].ssim[PAGS_REGION_WHOLE], scores[i].lpips);
  for (int test = 0; test < 2; test++) {
    pags_mean_score mean = pags_view_scores_mean(scores, count, test);
    if (mean.views) {
      /* Print the split's mean, then one line for each region that occurs, then what else was measured. */
      const pags_view_score *m = &mean.mean;
      char name[48];
      snprintf(name, sizeof name, "mean of %lld", (long long)mean.views);
      print_row(session, name, sets[test], m->psnr[PAGS_REGION_WHOLE], m->ssim[PAGS_REGION_WHOLE], m->lpips);
      for (int r = PAGS_REGION_WHOLE + 1; r < PAGS_REGION_COUNT; r++) {
        snprintf(name, sizeof name, "  %s", suffixes[r] + 1);
        if (!isnan(m->psnr[r]))
          print_row(session, name, sets[test], m->psnr[r], m->ssim[r], (double)NAN);
      }
      if (!isnan(m->psnr_unexposed))
        pags_say(session, "%-32s %-5s %9.3f\n", "  without exposure", sets[test], m->psnr_unexposed);
      if (!isnan(m->psnr_right)) {
        pags_say(session, "%-32s %-5s %9.3f\n", "  right halves", sets[test], m->psnr_right);
        pags_say(session, "%-32s %-5s %9.3f\n", "  with poses fitted to the left", sets[test], m->psnr_right_fitted);
      }
    }
  }
}
