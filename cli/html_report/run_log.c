/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the contents of a scene for its report, and reads log.jsonl and report.json of its training; see page.h. */
#include "cli/html_report/page.h"

#include <math.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "cli/measure/decisions.h"
#include "cli/measure/info.h"
#include "maths/maths.h"

/* ---- Contents ---- */

static const double size_least = -4, size_most = 3; /* 0.1 mm to 1 km */

/* 0 for a file that can't be looked at. */
static double file_size(const char *folder, const char *name) {
  uint64_t bytes = 0;
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  return path && pags_file_size(path, &bytes) == PAGS_OK ? (double)bytes : 0;
}

static int bin_of(double share, int bins) {
  const double at = floor(share * bins);
  return at > 0 ? at < bins ? (int)at : bins - 1 : 0;
}

/* Turns counts into per cent of `whole`, and fills the edges. */
static void finish(double (*points)[2], int bins, double lo, double hi, double whole) {
  for (int i = 0; i <= bins; i++) {
    points[i][0] = lo + (hi - lo) * i / bins;
    points[i][1] *= whole > 0 ? 100 / whole : 0;
  }
}

pags_result pags_scene_contents_find(const char *path, const pags_scene *scene, pags_scene_contents *out) {
  double known = 0;
  const bool folder = pags_dir_exists(path);
  *out = (pags_scene_contents){.bytes = folder ? file_size(path, "scene.json") : file_size(".", path)};
  if (folder && scene->sky.size > 0) {
    const double sky = file_size(path, "sky.npz");
    out->bytes += sky > 0 ? sky : file_size(path, "sky.npy"); /* the latter of PAGS 0.1 */
  }
  for (int64_t m = 0; m < scene->model_count; m++) {
    const pags_gaussians *g = &scene->models[m].gaussians;
    if (folder && scene->models[m].file)
      out->bytes += file_size(path, scene->models[m].file);
    for (int64_t i = 0; i < g->count; i++) {
      const float *scale = pags_plane(g, PAGS_SCALE) + i;
      const double largest = fmax(fmax((double)scale[0], (double)scale[g->stride]), (double)scale[2 * g->stride]);
      const double decades = largest / pags_log(10);
      out->sizes[bin_of((decades - size_least) / (size_most - size_least), PAGS_SIZE_BINS)][1]++;
      if (g->s_sem)
        out->priorities[bin_of((double)g->s_sem[i], PAGS_PRIORITY_BINS)][1]++;
    }
    out->gaussians += g->count;
    known += g->s_sem ? (double)g->count : 0;
    out->has_priorities = out->has_priorities || g->s_sem;
  }
  finish(out->priorities, PAGS_PRIORITY_BINS, 0, 1, known);
  finish(out->sizes, PAGS_SIZE_BINS, size_least, size_most, (double)out->gaussians);
  return pags_scene_object_gaussians(scene, &out->of_object);
}

/* ---- Logs ---- */

const pags_log_curve pags_log_curves[PAGS_LOG_CURVES] = {
    {"loss", "Loss, training views", "running mean", true},
    {"psnr", "PSNR, training views, dB", "running mean, dB", false},
    {"held_out_psnr", "PSNR, held-out views while training, dB", "mean of the views measured, dB", false},
    {"gaussians", "Gaussians", "Gaussians", true},
};

const char *pags_page_string(const pags_json_value *object, const char *key) {
  const pags_json_value *value = pags_json_member(object, key);
  return value && value->type == PAGS_JSON_STRING ? value->text : NULL;
}

bool pags_page_flag(const pags_json_value *object, const char *key, bool wanted) {
  const pags_json_value *value = pags_json_member(object, key);
  return value && value->type == PAGS_JSON_BOOL && value->boolean == wanted;
}

static pags_result read_line(pags_run_log *log, const char *path, const char *line, size_t size) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  log->lines++;
  const pags_result result = pags_json_parse_text(path, line, size, &json);
  if (result == PAGS_ERROR_MEMORY)
    return result;
  const pags_json_value *root = json ? pags_json_root(json) : NULL;
  const double step = pags_spoken_number(root, "step");
  log->unread += isnan(step);
  if (isnan(step))
    return PAGS_OK;
  for (int k = 0; k < PAGS_LOG_CURVES; k++) {
    const double value = pags_spoken_number(root, pags_log_curves[k].key);
    pags_curve *const curve = &log->curves[k];
    if (isnan(value))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&curve->points, curve->count + 1, &curve->capacity, sizeof *curve->points), "%s", path);
    curve->points[curve->count][0] = step;
    curve->points[curve->count++][1] = value;
  }
  return PAGS_OK;
}

static pags_result read_log(pags_run_log *log, const char *path) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const char *const end = (const char *)bytes + size;
  for (const char *line = (const char *)bytes; line < end;) {
    const char *const newline = memchr(line, '\n', (size_t)(end - line)), *const next = newline ? newline : end;
    if (next > line)
      PAGS_TRY(read_line(log, path, line, (size_t)(next - line)));
    line = next + 1;
  }
  return PAGS_OK;
}

/* Stores the message about an unreadable file, which the page shows; not an error. */
static pags_result note_fault(pags_run_log *log, pags_result result) {
  if (result == PAGS_OK || result == PAGS_ERROR_MEMORY)
    return result;
  free(log->fault);
  log->fault = pags_text_copy(pags_error_message());
  PAGS_CHECK_MEMORY(log->fault, NULL);
  return PAGS_OK;
}

pags_result pags_run_log_read(const char *folder, pags_run_log *out) {
  *out = (pags_run_log){0};
  PAGS_AUTOFREE char *log = pags_path_join(folder, "log.jsonl");
  PAGS_CHECK_MEMORY(log, "a path");
  PAGS_TRY(note_fault(out, pags_json_parse_in_folder(folder, "report.json", &out->report)));
  out->facts = out->report ? pags_json_root(out->report) : NULL;
  return pags_file_exists(log) ? note_fault(out, read_log(out, log)) : PAGS_OK;
}

void pags_run_log_destroy(pags_run_log *log) {
  for (int k = 0; k < PAGS_LOG_CURVES; k++)
    free(log->curves[k].points);
  pags_json_destroy(log->report);
  free(log->fault);
}
