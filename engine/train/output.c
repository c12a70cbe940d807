/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the files of a run, except for the scene (write_scene.c) and the checkpoint (checkpoint.c). All but
 * report.json depend on the run alone, not on the machine's speed. */
#include "train/output.h"

#include <pags/image.h>

#include "base/file.h"
#include "base/json.h"
#include "base/lock.h"
#include "base/log.h"
#include "base/text.h"
#include "port/port.h"
#include "scene/scene_json.h"
#include "simd/kernels.h"
#include "train/stages.h"

/* ---- Finding and clearing the folder ---- */

static const char *const preview_prefix = "preview_";

pags_result pags_output_find(pags_output *output, const pags_train_options *options, bool *found) {
  bool empty = true;
  *output = (pags_output){.folder = pags_path_join(options->output, ""),
                          .checkpoint = pags_path_join(options->output, "checkpoint.pags"),
                          .log = pags_path_join(options->output, "log.jsonl"),
                          .report = pags_path_join(options->output, "report.json")};
  PAGS_AUTOFREE char *scene = pags_path_join(options->output, "scene.json");
  PAGS_CHECK_MEMORY(output->folder && output->checkpoint && output->log && output->report && scene, "paths in %s",
                    options->output);
  if (pags_path_exists(options->output) && !pags_dir_exists(options->output))
    return pags_fail(PAGS_ERROR_IO, "%s: a file; expected a folder to write the scene to", options->output);
  if (pags_transport_rank(options->transport) == 0)
    PAGS_TRY(pags_lock_folder(options->output, &output->lock));
  PAGS_TRY(pags_dir_is_empty(options->output, &empty));
  if (!empty && !options->resume && !options->overwrite)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: not empty; pass --resume to go on or --overwrite to begin afresh",
                     options->output);
  *found = options->resume && pags_file_exists(output->checkpoint);
  if (!options->resume || *found)
    return PAGS_OK;

  /* Without a checkpoint, the run begins, as a command line that is queued again needs. But a scene is written after
   * its run's checkpoint: a folder with a scene and no checkpoint holds somebody else's scene, or one whose checkpoint
   * was taken away, which a run that begins must not overwrite: an error. */
  if (pags_path_exists(scene))
    return pags_fail(
        PAGS_ERROR_ARGUMENT,
        "%s: there is a scene.json but no checkpoint to go on from; expected checkpoint.pags in the same folder; "
        "pass --overwrite to begin afresh, or another folder",
        output->folder);
  pags_log_message(PAGS_LOG_INFO, "%s: no checkpoint to go on from: the run begins with step 1", output->folder);
  return PAGS_OK;
}

static bool is_ours(const char *name) {
  static const char *const names[] = {"checkpoint.pags", "log.jsonl", "report.html", "report.json", "scene.json"};
  return pags_text_find(name, names, sizeof names / sizeof *names) >= 0 ||
         (pags_text_starts(name, preview_prefix) && strcmp(pags_path_extension(name), ".png") == 0);
}

/* Removes a file of the folder, if it exists. If it is a symbolic link, the link is removed; with `follow`, as for
 * files that this run writes, the link stays and the file it points to is removed, to be made anew. FIFOs and devices
 * stay. */
static pags_result remove_file(const pags_output *output, const char *name, bool follow) {
  PAGS_AUTOFREE char *path = pags_path_join(output->folder, name);
  PAGS_AUTOFREE char *target = NULL;
  PAGS_CHECK_MEMORY(path, "a path");
  if (!pags_file_exists(path))
    return PAGS_OK;
  bool straight = false;
  if (follow)
    PAGS_TRY(pags_file_find_target(path, &target, &straight));
  return straight ? PAGS_OK : pags_remove_tree(follow ? target : path);
}

/* Removes the files that the folder's scene.json names, and the subfolder "objects" if that leaves it empty. A
 * scene.json that can't be read names nothing: files that may be somebody else's stay, and are overwritten only if a
 * name is the same. */
static pags_result remove_scene(const pags_output *output) {
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_AUTO(pags_scene_files_destroy) pags_scene_files files = {0};
  PAGS_AUTOFREE char *path = pags_path_join(output->folder, "scene.json");
  PAGS_AUTOFREE char *objects = pags_path_join(output->folder, "objects");
  PAGS_CHECK_MEMORY(path && objects, "a path");
  if (!pags_file_exists(path) || pags_scene_json_read(path, &scene, &files) != PAGS_OK)
    return PAGS_OK;
  for (int64_t i = 0; i < scene.model_count; i++)
    PAGS_TRY(remove_file(output, scene.models[i].file, false));
  if (files.sky)
    PAGS_TRY(remove_file(output, files.sky, false));
  pags_port_remove_folder(objects); /* does nothing unless the folder is empty */
  return PAGS_OK;
}

/* Returns the length in bytes of the lines at the log's beginning that are complete and belong to steps up to
 * `step`. */
static size_t sound_part(const char *text, size_t size, int64_t step) {
  static const char *const begin = "{\"step\": ";
  size_t at = 0;
  while (at < size) {
    const char *end = memchr(text + at, '\n', size - at);
    if (!end || size - at < strlen(begin) || memcmp(text + at, begin, strlen(begin)) != 0 ||
        strtoll(text + at + strlen(begin), NULL, 10) > step)
      break;
    at = (size_t)(end - text) + 1;
  }
  return at;
}

pags_result pags_output_open(pags_output *output, bool resumed, int64_t step) {
  PAGS_TRY(pags_make_dirs(output->folder));
  if (!resumed) {
    /* Remove what an earlier run left. scene.json goes before its checkpoint, so that a run killed at any time never
     * leaves a scene without a checkpoint. */
    PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
    PAGS_TRY(remove_scene(output));
    PAGS_TRY(remove_file(output, "scene.json", true));
    PAGS_TRY(pags_dir_list_read(output->folder, &list));
    for (int64_t i = 0; i < list.count; i++)
      if (is_ours(list.names[i]))
        PAGS_TRY(remove_file(output, list.names[i], true));
  } else if (pags_file_exists(output->log)) {
    PAGS_AUTOFREE uint8_t *bytes = NULL;
    size_t size;
    PAGS_TRY(pags_file_read(output->log, &bytes, &size));
    PAGS_TRY(pags_file_write(output->log, bytes, sound_part((const char *)bytes, size, step)));
  }
  PAGS_TRY(pags_file_writer_append(&output->lines, output->log));
  output->begun = true;
  return PAGS_OK;
}

void pags_output_close(pags_output *output, bool failed) {
  pags_port_status status;
  pags_file_writer_abort(&output->lines);
  if (output->begun && failed && !pags_file_exists(output->checkpoint) && pags_port_stat(output->log, false, &status) &&
      status.kind == PAGS_PORT_FILE)
    pags_port_remove_file(output->log);
  pags_lock_release(output->lock);
  free(output->folder);
  free(output->checkpoint);
  free(output->log);
  free(output->report);
  *output = (pags_output){0};
}

/* ---- The log ---- */

pags_result pags_output_log(pags_output *output, const pags_log_value *values, int count) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  for (int i = 0; i < count; i++)
    if (values[i].value != PAGS_LOG_NOTHING)
      pags_json_put_number(&w, values[i].name, values[i].value);
  pags_json_end_object(&w);
  PAGS_TRY(pags_json_writer_finish(&w));
  return pags_file_writer_put(&output->lines, w.data, w.size);
}

/* ---- Previews and report ---- */

pags_result pags_output_preview(const pags_output *output, int64_t step, const pags_picture *picture,
                                const pags_photo *photo) {
  PAGS_AUTOFREE char *path = pags_text_format("%s%s%07lld.png", output->folder, preview_prefix, (long long)step);
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  PAGS_CHECK_MEMORY(path, "a path");
  PAGS_TRY(pags_image_create(&image, 2 * picture->width, picture->height, 3, PAGS_U8));
  for (int y = 0; y < picture->height; y++) {
    uint8_t *row = (uint8_t *)image.data + (int64_t)y * image.width * 3;
    for (int x = 0; x < picture->width; x++)
      for (int c = 0; c < 3; c++) {
        const float value = picture->rgb[c][(int64_t)y * picture->stride + x];
        const float clamped = value > 0.0f ? (value < 1.0f ? value : 1.0f) : 0.0f;
        row[3 * x + c] = (uint8_t)(clamped * 255.0f + 0.5f);
        row[3 * (picture->width + x) + c] = photo->rgb[((int64_t)c * photo->height + y) * photo->stride + x];
      }
  }
  return pags_image_save(path, &image);
}

pags_result pags_output_report(const pags_output *output, const pags_train_result *r, const char *command_line,
                               pags_tasks *tasks) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {.indent = 2};
  pags_json_begin_object(&w, NULL);
  pags_json_put_bool(&w, "finished", r->finished);
  pags_json_put_bool(&w, "resumed", r->resumed);
  pags_json_put_integer(&w, "iterations", r->iterations);
  pags_json_put_integer(&w, "gaussians", r->gaussians);
  pags_json_put_number(&w, "seconds", r->seconds);
  pags_json_put_number(&w, "seconds_watched", r->seconds_watched);
  pags_json_put_number(&w, "iterations_per_second", r->iterations_per_second);
  pags_json_put_unsigned(&w, "peak_rss_bytes", r->peak_rss_bytes);
  pags_json_put_number(&w, "loss", r->loss);
  pags_json_put_number(&w, "psnr", r->psnr);
  pags_json_put_integer(&w, "bad_rows", r->bad_rows);
  if (r->bad_rows > 0)
    pags_json_put_string(&w, "first_bad_row", r->first_bad_row);
  pags_json_put_unsigned(&w, "frame_heap_calls_in_last_tenth", r->heap_calls_steady);
  pags_json_begin_object(&w, "ms_per_step");
  pags_json_put_number(&w, "wait", r->ms_wait);
  pags_json_put_number(&w, "forward", r->ms_forward);
  pags_json_put_number(&w, "loss", r->ms_loss);
  pags_json_put_number(&w, "backward", r->ms_backward);
  pags_json_put_number(&w, "density", r->ms_density);
  pags_json_end_object(&w);
  pags_json_begin_object(&w, "decisions");
  for (int k = 0; k < PAGS_DECISIONS; k++) {
    pags_json_begin_object(&w, pags_decision_name((pags_train_decision)k));
    pags_json_put_number(&w, "seconds", r->decision_seconds[k]);
    pags_json_put_integer(&w, "steps", r->decision_steps[k]);
    pags_json_put_number(&w, "test_seconds", r->decision_test_seconds[k]);
    pags_json_end_object(&w);
  }
  pags_json_end_object(&w);

  /* The machine: threads, vector kernels and version. */
  const pags_kernels *kernels = pags_kernels_get(NULL);
  pags_json_put_integer(&w, "threads", pags_tasks_workers(tasks));
  pags_json_put_string(&w, "kernels", kernels ? kernels->name : NULL);
  pags_json_put_string(&w, "version", PAGS_VERSION_STRING);
  if (command_line)
    pags_json_put_string(&w, "command_line", command_line);

  pags_json_end_object(&w);
  return pags_json_writer_save(&w, output->report);
}
