/* SPDX-License-Identifier: Apache-2.0 */
/* PSNR, SSIM and LPIPS of views, by region, and their means, as text and as JSON.
 *
 * PSNR of a region is computed from the squared error over the region's pixels and all three channels; SSIM of a
 * region is the mean of the whole picture's SSIM map over its pixels. Means are over the views that have pixels of
 * the region. */
#include "cli/measure/view_scores.h"

#include <math.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/psnr.h"
#include "base/vec3.h"
#include "port/port.h"

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

pags_result pags_view_score_measure(const pags_image *render, const pags_photograph *photograph, pags_tasks *tasks,
                                    pags_view_score *score) {
  const int width = render->width, height = render->height;
  /* Bit r of a pixel is set if the pixel counts in region r; without labels only the whole picture is a region. */
  PAGS_AUTOFREE uint16_t *regions = calloc((size_t)width * (size_t)height, sizeof *regions);
  PAGS_CHECK_MEMORY(regions, "a picture of %dx%d", width, height);
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      const size_t at = (size_t)y * (size_t)width + (size_t)x;
      const uint8_t *const labels = photograph->photo.labels;
      const unsigned bits = labels ? regions_of(labels[(size_t)y * (size_t)photograph->photo.stride + (size_t)x]) : 0;
      if (!photograph->mask || photograph->mask[at])
        regions[at] = (uint16_t)(1u << PAGS_REGION_WHOLE | bits);
    }
  PAGS_TRY(pags_eval_regions(render, &photograph->image, regions, PAGS_REGION_COUNT, tasks, score->psnr, score->ssim));
  for (int r = 0; r < PAGS_REGION_COUNT; r++)
    score->psnr[r] = pags_psnr_capped(score->psnr[r]);
  return PAGS_OK;
}

/* ---- LPIPS ---- */

pags_result pags_view_lpips_load(const char *given, pags_lpips **out) {
  char folder[4096];
  *out = NULL;
  if (given)
    return strcmp(given, "none") ? pags_lpips_load(given, out) : PAGS_OK;
  if (!pags_port_data_folder(folder, sizeof folder))
    return PAGS_OK;
  PAGS_AUTOFREE char *path = pags_path_join(folder, "lpips_alex.npz");
  PAGS_CHECK_MEMORY(path, NULL);
  return pags_file_exists(path) ? pags_lpips_load(path, out) : PAGS_OK;
}

pags_result pags_view_score_lpips(const pags_lpips *lpips, pags_image *render, const pags_photograph *photograph,
                                  pags_tasks *tasks, pags_view_score *score) {
  if (render->width < PAGS_LPIPS_SMALLEST || render->height < PAGS_LPIPS_SMALLEST)
    return PAGS_OK;
  const size_t count = photograph->mask ? (size_t)render->width * (size_t)render->height : 0;
  for (size_t i = 0; i < count; i++)
    if (!photograph->mask[i])
      pags_copy3f((const float *)photograph->image.data + 3 * i, (float *)render->data + 3 * i);
  return pags_lpips_distance(lpips, render, &photograph->image, tasks, &score->lpips);
}

/* ---- Means and tables ---- */

/* The mean of the doubles at `offset` in the scores of a split, without those that are NaN; NaN if all are. */
static double mean_of(const pags_view_score *scores, int64_t count, int test, size_t offset) {
  double sum = 0;
  int64_t known = 0;
  for (int64_t i = 0; i < count; i++) {
    double value;
    memcpy(&value, (const char *)&scores[i] + offset, sizeof value);
    if (scores[i].test != test || isnan(value))
      continue;
    sum += value;
    known++;
  }
  return known ? sum / (double)known : (double)NAN;
}

pags_mean_score pags_view_scores_mean(const pags_view_score *scores, int64_t count, int test) {
  pags_mean_score out = {.mean = {.test = test}};
  pags_view_score *const mean = &out.mean;
  for (int64_t i = 0; i < count; i++)
    out.views += scores[i].test == test;
  for (int r = 0; r < PAGS_REGION_COUNT; r++) {
    mean->psnr[r] = mean_of(scores, count, test, offsetof(pags_view_score, psnr[0]) + (size_t)r * sizeof(double));
    mean->ssim[r] = mean_of(scores, count, test, offsetof(pags_view_score, ssim[0]) + (size_t)r * sizeof(double));
  }
  mean->lpips = mean_of(scores, count, test, offsetof(pags_view_score, lpips));
  mean->psnr_unexposed = mean_of(scores, count, test, offsetof(pags_view_score, psnr_unexposed));
  mean->psnr_right = mean_of(scores, count, test, offsetof(pags_view_score, psnr_right));
  mean->psnr_right_fitted = mean_of(scores, count, test, offsetof(pags_view_score, psnr_right_fitted));
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

  /* Print each split's mean, then one line for each region that occurs, then what else was measured. */
  for (int test = 0; test < 2; test++) {
    const pags_mean_score mean = pags_view_scores_mean(scores, count, test);
    const pags_view_score *const m = &mean.mean;
    char name[48];
    if (!mean.views)
      continue;
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
