/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the files of a run, except for the scene (write_scene.c) and the checkpoint (checkpoint.c). All but
 * report.json depend on the run alone, not on the machine's speed. */
#include "train/output.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include <pags/image.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/json.h"
#include "base/lock.h"
#include "base/log.h"
#include "base/memory.h"
#include "port/port.h"
#include "scene/scene_json.h"
#include "simd/kernels.h"
#include "train/config.h"
#include "train/stages.h"

/* ---- Finding and clearing the folder ---- */

static const char *const preview_prefix = "preview_";

/* Decides what --resume does if there is no checkpoint: the run begins, as a command line that is queued again needs.
 * But a scene is written after its run's checkpoint: a folder with a scene and no checkpoint holds somebody else's
 * scene, or one whose checkpoint was taken away, which a run that begins must not overwrite: an error. */
static pags_result begin_instead(const pags_output *output) {
  bool scene = false;

  /* Look for a scene.json in the folder. */
  bool *out = &scene;
  char *path = pags_path_join(output->folder, "scene.json");
  if (!path)
    return pags_out_of_memory("a path");
  *out = pags_path_exists(path);
  free(path);

  if (scene)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "%s: there is a scene.json but no checkpoint to go on from; expected checkpoint.pags beside it; "
                     "pass --overwrite to "
                     "begin afresh, or another folder",
                     output->folder);
  pags_log_message(PAGS_LOG_INFO, "%s: no checkpoint to go on from: the run begins with step 1", output->folder);
  return PAGS_OK;
}

pags_result pags_output_find(pags_output *output, const pags_train_options *options, int *found) {
  bool empty = true;
  *output = (pags_output){.folder = pags_path_join(options->output, "")};
  output->checkpoint = pags_path_join(options->output, "checkpoint.pags");
  output->log = pags_path_join(options->output, "log.jsonl");
  output->report = pags_path_join(options->output, "report.json");
  if (!output->folder || !output->checkpoint || !output->log || !output->report)
    return pags_out_of_memory("paths in %s", options->output);
  if (pags_path_exists(options->output) && !pags_dir_exists(options->output))
    return pags_fail(PAGS_ERROR_IO, "%s: a file; expected a folder to write the scene to", options->output);
  if (pags_transport_rank(options->transport) == 0)
    PAGS_TRY(pags_lock_folder(options->output, &output->lock));
  PAGS_TRY(pags_dir_is_empty(options->output, &empty));
  if (!empty && !options->resume && !options->overwrite)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: not empty; pass --resume to go on or --overwrite to begin afresh",
                     options->output);
  *found = options->resume && pags_file_exists(output->checkpoint);
  return options->resume && !*found ? begin_instead(output) : PAGS_OK;
}

static bool is_ours(const char *name) {
  static const char *const names[] = {"checkpoint.pags", "log.jsonl", "report.html", "report.json", "scene.json"};
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    if (strcmp(name, names[i]) == 0)
      return true;
  return strncmp(name, preview_prefix, strlen(preview_prefix)) == 0 && strcmp(pags_path_extension(name), ".png") == 0;
}

/* Removes a file of the folder, if it exists. If it is a symbolic link, the link is removed; with `follow`, as for
 * files that this run writes, the link stays and the file it points to is removed, to be made anew. FIFOs and devices
 * stay. */
static pags_result remove_file(const pags_output *output, const char *name, bool follow) {
  char *path = pags_path_join(output->folder, name), *target = NULL;
  if (!path)
    return pags_out_of_memory("a path");
  bool straight = false;
  pags_result result = PAGS_OK;
  if (pags_file_exists(path)) {
    result = follow ? pags_file_find_target(path, &target, &straight) : PAGS_OK;
    if (result == PAGS_OK && !straight)
      result = pags_remove_tree(follow ? target : path);
  }
  free(target);
  free(path);
  return result;
}

/* Removes the files that the folder's scene.json names, and the subfolder "objects" if that leaves it empty. A
 * scene.json that can't be read names nothing: files that may be somebody else's stay, and are overwritten only if a
 * name is the same. */
static pags_result remove_scene(const pags_output *output) {
  pags_scene scene = {0};
  pags_scene_files files = {0};
  char *path = pags_path_join(output->folder, "scene.json"), *objects = pags_path_join(output->folder, "objects");
  pags_result result = path && objects ? PAGS_OK : pags_out_of_memory("a path");
  if (result == PAGS_OK && pags_file_exists(path) && pags_scene_json_read(path, &scene, &files) == PAGS_OK) {
    for (int64_t i = 0; i < scene.model_count && result == PAGS_OK; i++)
      result = remove_file(output, scene.models[i].file, false);
    if (result == PAGS_OK && files.sky)
      result = remove_file(output, files.sky, false);
    pags_port_remove_folder(objects); /* does nothing unless the folder is empty */
  }
  pags_scene_destroy(&scene);
  free(files.counts);
  free(files.sky);
  free(path);
  free(objects);
  return result;
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

static pags_result cut_log(const pags_output *output, int64_t step) {
  uint8_t *bytes;
  size_t size;
  if (!pags_file_exists(output->log))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(output->log, &bytes, &size));
  pags_result result = pags_file_write(output->log, bytes, sound_part((const char *)bytes, size, step));
  free(bytes);
  return result;
}

pags_result pags_output_open(pags_output *output, int resumed, int64_t step) {
  PAGS_TRY(pags_make_dirs(output->folder));
  if (resumed)
    PAGS_TRY(cut_log(output, step));
  else {
    /* Remove what an earlier run left. scene.json goes before its checkpoint, so that a run killed at any time never
     * leaves a scene without a checkpoint. */
    pags_dir_list list;
    PAGS_TRY(remove_scene(output));
    PAGS_TRY(remove_file(output, "scene.json", true));
    PAGS_TRY(pags_dir_list_read(output->folder, &list));
    pags_result result = PAGS_OK;
    for (int64_t i = 0; i < list.count && result == PAGS_OK; i++)
      if (is_ours(list.names[i]))
        result = remove_file(output, list.names[i], true);
    pags_dir_list_destroy(&list);
    PAGS_TRY(result);
  }
  PAGS_TRY(pags_file_writer_append(&output->lines, output->log));
  output->begun = true;
  return PAGS_OK;
}

void pags_output_close(pags_output *output, int failed) {
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

/* Finishes a line and hands it to the operating system at once, so that the log of a killed run is almost
 * complete. */
static pags_result put_line(pags_output *output, pags_json_writer *writer) {
  pags_json_end_object(writer);
  pags_result result = pags_json_writer_finish(writer);
  if (result == PAGS_OK)
    result = pags_file_writer_put(&output->lines, writer->data, writer->size);
  pags_json_writer_destroy(writer);
  return result;
}

pags_result pags_output_log(pags_output *output, const pags_log_entry *e) {
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "step", e->step);
  pags_json_put_integer(&w, "gaussians", e->gaussians);
  pags_json_put_integer(&w, "shrink", e->level);
  pags_json_put_integer(&w, "sh_degree", e->sh_degree);
  pags_json_put_number(&w, "loss", e->loss);
  pags_json_put_number(&w, "psnr", e->psnr);
  pags_json_put_number(&w, "view_loss", e->step_loss);
  pags_json_put_number(&w, "view_l1", e->step_l1);
  pags_json_put_number(&w, "view_ssim", e->step_ssim);
  pags_json_put_number(&w, "view_psnr", e->step_psnr);
  if (e->terms.sky > 0.0)
    pags_json_put_number(&w, "view_sky", e->terms.sky);
  if (e->terms.depth > 0.0)
    pags_json_put_number(&w, "view_depth", e->terms.depth);
  if (e->terms.objects > 0.0)
    pags_json_put_number(&w, "view_objects", e->terms.objects);
  if (e->bad_rows > 0)
    pags_json_put_integer(&w, "bad_rows", e->bad_rows);
  return put_line(output, &w);
}

pags_result pags_output_log_held_out(pags_output *output, int64_t step, int64_t gaussians, double psnr, int views) {
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "step", step);
  pags_json_put_integer(&w, "gaussians", gaussians);
  pags_json_put_number(&w, "held_out_psnr", psnr);
  pags_json_put_integer(&w, "held_out_views", views);
  return put_line(output, &w);
}

pags_result pags_output_log_density(pags_output *output, int64_t step, const pags_density_change *change,
                                    int64_t gaussians) {
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "step", step);
  pags_json_put_integer(&w, "gaussians", gaussians);
  pags_json_put_integer(&w, "cloned", change->cloned);
  pags_json_put_integer(&w, "split", change->split);
  pags_json_put_integer(&w, "pruned", change->pruned);
  pags_json_put_integer(&w, "wanted", change->wanted);
  return put_line(output, &w);
}

pags_result pags_output_log_prune(pags_output *output, int64_t step, int64_t pruned, int64_t gaussians) {
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "step", step);
  pags_json_put_integer(&w, "gaussians", gaussians);
  pags_json_put_integer(&w, "pruned_by_score", pruned);
  return put_line(output, &w);
}

/* ---- Previews and report ---- */

static uint8_t to_byte(float x) {
  float clamped = x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
  return (uint8_t)(clamped * 255.0f + 0.5f);
}

pags_result pags_output_preview(const pags_output *output, int64_t step, const pags_picture *picture,
                                const pags_photo *photo) {
  char name[64];
  pags_image image;
  snprintf(name, sizeof name, "%s%07lld.png", preview_prefix, (long long)step);
  char *path = pags_path_join(output->folder, name);
  if (!path)
    return pags_out_of_memory("a path");
  pags_result result = pags_image_create(&image, 2 * picture->width, picture->height, 3, PAGS_U8);
  for (int y = 0; result == PAGS_OK && y < picture->height; y++) {
    uint8_t *row = (uint8_t *)image.data + (int64_t)y * image.width * 3;
    for (int x = 0; x < picture->width; x++)
      for (int c = 0; c < 3; c++) {
        row[3 * x + c] = to_byte(picture->rgb[c][(int64_t)y * picture->stride + x]);
        row[3 * (picture->width + x) + c] = photo->rgb[((int64_t)c * photo->height + y) * photo->stride + x];
      }
  }
  if (result == PAGS_OK)
    result = pags_image_save(path, &image);
  pags_image_destroy(&image);
  free(path);
  return result;
}

pags_result pags_output_report(const pags_output *output, const pags_train_result *r, const char *command_line,
                               pags_tasks *tasks) {
  pags_json_writer w;
  pags_json_writer_init(&w, 2);
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

  /* The machine: threads, vector kernels and version. */
  const pags_kernels *kernels = pags_kernels_get(NULL);
  pags_json_put_integer(&w, "threads", pags_tasks_workers(tasks));
  pags_json_put_string(&w, "kernels", kernels ? kernels->name : NULL);
  pags_json_put_string(&w, "version", PAGS_VERSION_STRING);
  if (command_line)
    pags_json_put_string(&w, "command_line", command_line);

  pags_json_end_object(&w);
  pags_result result = pags_json_writer_save(&w, output->report);
  pags_json_writer_destroy(&w);
  return result;
}
