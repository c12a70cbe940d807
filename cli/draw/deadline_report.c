/* SPDX-License-Identifier: Apache-2.0 */
/* Statistics of --budget-ms, for pags render and pags-bench render: times, the quality steps taken, and PSNR and
 * largest error against full quality. */
#include "cli/draw/deadline_report.h"

#include <math.h>

#include "base/memory.h"
#include "base/psnr.h"

pags_result pags_deadline_report_create(const pags_composition *composition, pags_tasks *tasks, double ms,
                                        int check_every, pags_deadline_report *out) {
  *out = (pags_deadline_report){.check_every = check_every, .ids = pags_composition_gaussian_count(composition)};
  out->controller = pags_deadline_controller_begin(ms);
  out->priority = calloc((size_t)out->ids + 1, sizeof *out->priority);
  PAGS_CHECK_MEMORY(out->priority, "the priorities of %lld Gaussians", (long long)out->ids);
  pags_composition_priorities(composition, out->priority);
  PAGS_TRY(pags_deadline_create(tasks, out->priority, out->ids, &out->deadline));
  return pags_frame_create(tasks, &out->full_frame);
}

void pags_deadline_report_destroy(pags_deadline_report *deadline) {
  pags_deadline_destroy(deadline->deadline);
  pags_frame_destroy(deadline->full_frame);
  free(deadline->priority);
}

static double cut(float v) {
  return v <= 0.0f ? 0.0 : v >= 1.0f ? 1.0 : (double)v;
}

static void add_pixel(pags_deadline_error *error, double squared, double largest) {
  error->squared += squared;
  error->samples += 3;
  error->largest = fmax(error->largest, largest);
}

pags_result pags_deadline_report_draw(pags_deadline_report *d, const pags_part *parts, int part_count,
                                      const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                                      pags_deadline_result *report) {
  pags_frame_options full = *options;
  pags_picture full_picture;
  PAGS_TRY(pags_deadline_render(d->deadline, &d->controller, parts, part_count, camera, options, out, report));
  d->met += report->met;
  d->at_step[report->step]++;
  d->sum_ms += report->ms;
  d->sum_full_tiles += report->full_tiles;
  d->worst_ms = fmax(d->worst_ms, report->ms);
  if (d->frames++ % d->check_every != 0)
    return PAGS_OK;
  full.extra_channels = 1;
  PAGS_TRY(pags_frame_render(d->full_frame, parts, part_count, camera, &full, NULL, NULL, &full_picture));

  /* Compare values clamped to 0..1, as pictures show them. A pixel is critical if the Gaussian with the largest
   * weight there in the full-quality picture has a priority over 0.5. */
  for (int y = 0; y < full_picture.height; y++)
    for (int x = 0; x < full_picture.width; x++) {
      const int64_t at = (int64_t)y * full_picture.stride + x, id = full_picture.id[at];
      const bool critical = id >= 0 && id < d->ids && d->priority[id] > 0.5f;
      double sum = 0, largest = 0;
      for (int k = 0; k < 3; k++) {
        const double error = fabs(cut(out->rgb[k][at]) - cut(full_picture.rgb[k][at]));
        sum += error * error;
        largest = fmax(largest, error);
      }
      add_pixel(&d->all, sum, largest);
      if (critical)
        add_pixel(&d->critical, sum, largest);
    }
  d->checked++;
  return PAGS_OK;
}

static void say_error(const pags_session *session, const char *what, const pags_deadline_error *error) {
  if (error->samples == 0)
    pags_say(session, "; %s: none", what);
  else if (error->squared == 0)
    pags_say(session, "; %s: no error", what);
  else
    pags_say(session, "; %s: %.2f dB, largest error %.4f", what, pags_psnr(error->squared / error->samples),
             error->largest);
}

void pags_deadline_report_print(const pags_deadline_report *d, const pags_session *session) {
  const double n = d->frames ? (double)d->frames : 1;
  pags_say(session, "budget %g ms: %lld of %lld frames within (%.1f %%), %.2f ms on average, %.2f at worst\n",
           d->controller.target, (long long)d->met, (long long)d->frames, 100 * (double)d->met / n, d->sum_ms / n,
           d->worst_ms);
  for (int k = 0; k < PAGS_DEADLINE_WHOLE_STEPS; k++) {
    /* Print what this step reduces, and in which share of the frames (in per cent) it was used. */
    const pags_deadline_step *step = &pags_deadline_steps()[k];
    const double share = 100 * (double)d->at_step[k] / n;
    if (d->at_step[k] && step->eps <= 0) /* only the first step has full quality */
      pags_say(session, "  %5.1f %% of frames: full quality\n", share);
    else if (d->at_step[k])
      pags_say(session,
               "  %5.1f %% of frames: early stop at %.4f; non-critical areas %s, SH degree reduced by %d, without "
               "Gaussians below %g px\n",
               share, (double)step->eps, step->sampled ? "at a quarter of the resolution" : "at full resolution",
               step->sh_less, (double)step->cut);
  }
  pags_say(session, "  %.0f %% of tiles at full resolution; against full quality (%lld frames)",
           100 * d->sum_full_tiles / n, (long long)d->checked);
  say_error(session, "all", &d->all);
  say_error(session, "critical", &d->critical);
  pags_say(session, "\n");
}

static void put_error(pags_json_writer *json, const char *name, const pags_deadline_error *error) {
  pags_json_begin_object(json, name);
  pags_json_put_integer(json, "pixels", (int64_t)(error->samples / 3));
  pags_json_put_number(json, "psnr", error->samples > 0 ? pags_psnr(error->squared / error->samples) : (double)NAN);
  pags_json_put_number(json, "max_error", error->largest);
  pags_json_end_object(json);
}

void pags_deadline_report_put(const pags_deadline_report *d, pags_json_writer *json) {
  const double n = d->frames ? (double)d->frames : 1;
  pags_json_begin_object(json, "budget");
  pags_json_put_number(json, "ms", d->controller.target);
  pags_json_put_integer(json, "frames", d->frames);
  pags_json_put_integer(json, "met", d->met);
  pags_json_put_number(json, "mean_ms", d->sum_ms / n);
  pags_json_put_number(json, "worst_ms", d->worst_ms);
  pags_json_put_number(json, "full_tiles", d->sum_full_tiles / n);
  pags_json_begin_array(json, "steps");
  for (int k = 0; k < PAGS_DEADLINE_WHOLE_STEPS; k++) {
    const pags_deadline_step *step = &pags_deadline_steps()[k];
    pags_json_begin_object(json, NULL);
    pags_json_put_number(json, "eps", (double)step->eps);
    pags_json_put_integer(json, "scale", step->sampled ? 4 : 1);
    pags_json_put_integer(json, "sh_less", step->sh_less);
    pags_json_put_number(json, "cut", (double)step->cut);
    pags_json_put_integer(json, "frames", d->at_step[k]);
    pags_json_end_object(json);
  }
  pags_json_end_array(json);
  pags_json_put_integer(json, "checked", d->checked);
  put_error(json, "error", &d->all);
  put_error(json, "error_critical", &d->critical);
  pags_json_end_object(json);
}

void pags_deadline_report_put_frame(const pags_deadline_result *report, pags_json_writer *json) {
  pags_json_put_integer(json, "step", report->step);
  pags_json_put_number(json, "budget_ms", report->ms);
  pags_json_put_bool(json, "met", report->met);
  pags_json_put_number(json, "full_tiles", report->full_tiles);
}
