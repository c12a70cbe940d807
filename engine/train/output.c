/* The files of a run, checkpoint apart. All but report.json are functions of the run alone. */
#include "train/output.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <pags/image.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/json.h"
#include "kernels.h"
#include "train/config.h"

static const char *const preview_prefix = "preview_";

pags_result pags_output_find(pags_output *output, const pags_train_options *options, int *found) {
  bool empty = true;
  *output = (pags_output){.folder = pags_path_join(options->output, "")};
  output->checkpoint = pags_path_join(options->output, "checkpoint.pags");
  output->log = pags_path_join(options->output, "log.jsonl");
  output->report = pags_path_join(options->output, "report.json");
  if (!output->folder || !output->checkpoint || !output->log || !output->report)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for paths in %s", options->output);
  if (pags_path_exists(options->output) && !pags_dir_exists(options->output))
    return pags_fail(PAGS_ERROR_IO, "%s: a file; expected a folder to write the scene to", options->output);
  PAGS_TRY(pags_dir_is_empty(options->output, &empty));
  if (!empty && !options->resume && !options->overwrite)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: not empty; pass --resume to go on or --overwrite to begin afresh",
                     options->output);
  output->made = !pags_dir_exists(options->output);
  *found = options->resume && pags_file_exists(output->checkpoint);
  return PAGS_OK;
}

static int is_ours(const char *name) {
  static const char *const names[] = {"checkpoint.pags", "log.jsonl", "report.json", "scene.json", "background.ply"};
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    if (strcmp(name, names[i]) == 0)
      return 1;
  return strncmp(name, preview_prefix, strlen(preview_prefix)) == 0 && strcmp(pags_path_extension(name), ".png") == 0;
}

static pags_result remove_earlier(const pags_output *output) {
  pags_dir_list list;
  PAGS_TRY(pags_dir_list_read(output->folder, &list));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < list.count && result == PAGS_OK; i++) {
    if (!is_ours(list.names[i]))
      continue;
    char *path = pags_path_join(output->folder, list.names[i]);
    result = path ? pags_remove_tree(path) : pags_fail(PAGS_ERROR_MEMORY, "no memory for a path");
    free(path);
  }
  pags_dir_list_destroy(&list);
  return result;
}

/* Bytes of the lines at the log's beginning that are whole and of steps up to `step`. */
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
  else
    PAGS_TRY(remove_earlier(output));
  output->stream = fopen(output->log, "ab");
  if (!output->stream)
    return pags_fail(PAGS_ERROR_IO, "%s: can't be written: %s", output->log, strerror(errno));
  return PAGS_OK;
}

void pags_output_close(pags_output *output, int failed) {
  if (output->stream) {
    fclose(output->stream);
    if (failed && !pags_file_exists(output->checkpoint))
      remove(output->log);
  }
  if (failed && output->made && output->folder)
    rmdir(output->folder); /* does nothing unless empty */
  free(output->folder);
  free(output->checkpoint);
  free(output->log);
  free(output->report);
  *output = (pags_output){0};
}

/* Finishes a line and passes it to the system, so that a killed run's log ends near its end. */
static pags_result put_line(pags_output *output, pags_json_writer *writer) {
  pags_json_end_object(writer);
  pags_result result = pags_json_writer_finish(writer);
  if (result == PAGS_OK &&
      (fwrite(writer->data, 1, writer->size, output->stream) != writer->size || fflush(output->stream) != 0))
    result = pags_fail(PAGS_ERROR_IO, "%s: can't be written: %s", output->log, strerror(errno));
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
  return put_line(output, &w);
}

pags_result pags_output_log_density(pags_output *output, int64_t step, int64_t cloned, int64_t split, int64_t pruned,
                                    int64_t wanted, int64_t gaussians) {
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "step", step);
  pags_json_put_integer(&w, "gaussians", gaussians);
  pags_json_put_integer(&w, "cloned", cloned);
  pags_json_put_integer(&w, "split", split);
  pags_json_put_integer(&w, "pruned", pruned);
  pags_json_put_integer(&w, "wanted", wanted);
  return put_line(output, &w);
}

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
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for a path");
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

/* Views borrow the data set's names. */
static pags_scene_view *list_views(const pags_dataset *dataset, int64_t count) {
  pags_scene_view *views = calloc((size_t)(count > 0 ? count : 1), sizeof *views);
  for (int64_t i = 0; views && i < count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    views[i] = (pags_scene_view){.name = (char *)(uintptr_t)view->name,
                                 .camera = view->camera,
                                 .test = view->test,
                                 .sensor = -1,
                                 .frame = -1,
                                 .gain = {1, 1, 1}};
  }
  return views;
}

pags_result pags_output_scene(const pags_output *output, const pags_dataset *dataset, const pags_train_state *state) {
  const pags_train_config *config = &state->schedule.config;
  char name[] = "background", file[] = "background.ply", text[PAGS_CONFIG_TEXT];
  pags_model model = {.name = name, .file = file, .gaussians = state->gaussians};
  pags_config_write_json(config, text);
  pags_scene scene = {.up = pags_dataset_up(dataset),
                      .antialiased = config->antialiased,
                      .seed = config->seed,
                      .dataset = (char *)(uintptr_t)pags_dataset_path(dataset),
                      .config = text,
                      .iterations = state->step,
                      .model_count = 1,
                      .models = &model,
                      .view_count = pags_dataset_view_count(dataset)};
  for (int k = 0; k < 3; k++) {
    scene.origin[k] = pags_dataset_origin(dataset)[k];
    scene.background[k] = (float)config->background[k];
  }
  scene.views = list_views(dataset, scene.view_count);
  if (!scene.views)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for %lld views", (long long)scene.view_count);
  pags_result result = pags_scene_save(output->folder, &scene);
  free(scene.views);
  return result;
}

static void put_machine(pags_json_writer *w, pags_tasks *tasks) {
  const pags_kernels *kernels = pags_kernels_get(NULL);
  pags_json_put_integer(w, "threads", pags_tasks_workers(tasks));
  pags_json_put_string(w, "kernels", kernels ? kernels->name : NULL);
  pags_json_put_string(w, "version", PAGS_VERSION_STRING);
}

pags_result pags_output_report(const pags_output *output, const pags_train_result *r, pags_tasks *tasks) {
  pags_json_writer w;
  pags_json_writer_init(&w, 2);
  pags_json_begin_object(&w, NULL);
  pags_json_put_bool(&w, "finished", r->finished);
  pags_json_put_bool(&w, "resumed", r->resumed);
  pags_json_put_integer(&w, "iterations", r->iterations);
  pags_json_put_integer(&w, "gaussians", r->gaussians);
  pags_json_put_number(&w, "seconds", r->seconds);
  pags_json_put_number(&w, "iterations_per_second", r->iterations_per_second);
  pags_json_put_unsigned(&w, "peak_rss_bytes", r->peak_rss_bytes);
  pags_json_put_number(&w, "loss", r->loss);
  pags_json_put_number(&w, "psnr", r->psnr);
  pags_json_put_integer(&w, "bad_rows", r->bad_rows);
  pags_json_put_unsigned(&w, "frame_heap_calls_in_last_tenth", r->heap_calls_steady);
  pags_json_begin_object(&w, "ms_per_step");
  pags_json_put_number(&w, "wait", r->ms_wait);
  pags_json_put_number(&w, "forward", r->ms_forward);
  pags_json_put_number(&w, "loss", r->ms_loss);
  pags_json_put_number(&w, "backward", r->ms_backward);
  pags_json_put_number(&w, "density", r->ms_density);
  pags_json_end_object(&w);
  put_machine(&w, tasks);
  pags_json_end_object(&w);
  pags_result result = pags_json_writer_save(&w, output->report);
  pags_json_writer_destroy(&w);
  return result;
}
