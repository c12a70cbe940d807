/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a room as a nerfstudio data set. */
#include <pags/synth.h>

#include <stdio.h>
#include <stdlib.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "synth/points.h"
#include "synth/range.h"
#include "synth/render.h"

pags_synth_options pags_synth_options_default(void) {
  return (pags_synth_options){.width = 360, .height = 240, .views = 36, .samples = 8, .points = 4000};
}

typedef struct writer {
  const char *folder;
  const pags_synth_options *options;
  const pags_room *room;
  pags_tracer *tracer;
  pags_tasks *tasks;
  pags_image image;
  float *depth; /* NULL unless asked for */
} writer;

static pags_result check_options(const pags_synth_options *o) {
  PAGS_TRY(pags_synth_in_range("width", o->width, 16, 8192));
  PAGS_TRY(pags_synth_in_range("height", o->height, 16, 8192));
  PAGS_TRY(pags_synth_in_range("views", o->views, 3, 10000));
  PAGS_TRY(pags_synth_in_range("samples", o->samples, 1, 1024));
  return pags_synth_in_range("points", (double)o->points, 0, 10000000);
}

/* folder/name/NNNN.extension or, without number, folder/name. */
static pags_result make_path(const char *folder, const char *name, int number, const char *extension, char **out) {
  char relative[64];
  if (number)
    snprintf(relative, sizeof relative, "%s/%04d.%s", name, number, extension);
  else
    snprintf(relative, sizeof relative, "%s", name);
  *out = pags_path_join(folder, relative);
  return *out ? PAGS_OK : pags_out_of_memory("%s", folder);
}

static pags_result make_folder(const char *folder, const char *name) {
  char *path = NULL;
  PAGS_TRY(make_path(folder, name, 0, "", &path));
  const pags_result result = pags_make_dirs(path);
  free(path);
  return result;
}

static pags_result make_folders(const writer *w) {
  bool empty = true;
  PAGS_TRY(pags_dir_is_empty(w->folder, &empty));
  if (!empty && !w->options->overwrite)
    return pags_fail(PAGS_ERROR_IO, "%s: expected an empty or a new folder", w->folder);
  PAGS_TRY(make_folder(w->folder, "images"));
  return w->options->depth ? make_folder(w->folder, "depth") : PAGS_OK;
}

static pags_result write_image(const writer *w, int index) {
  char *path = NULL;
  PAGS_TRY(make_path(w->folder, "images", index + 1, "png", &path));
  const pags_result result = pags_image_save(path, &w->image);
  free(path);
  return result;
}

static pags_result write_depth(const writer *w, int index) {
  static const char *const name = "Z";
  const float *plane = w->depth;
  char *path = NULL;
  PAGS_TRY(make_path(w->folder, "depth", index + 1, "exr", &path));
  const pags_result result =
      pags_image_save_exr(path, w->options->width, w->options->height, 1, &name, &plane, w->options->width);
  free(path);
  return result;
}

static pags_result write_views(writer *w, pags_progress_fn *progress, void *user) {
  const pags_synth_options *o = w->options;
  for (int i = 0; i < o->views; i++) {
    if (progress && !progress(user, (double)i / o->views, "views"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    const pags_camera camera = pags_room_camera(i, o->views, o->width, o->height);
    PAGS_TRY(pags_render_view(w->tracer, w->room, &camera, o->samples, o->seed, w->tasks, &w->image, w->depth));
    PAGS_TRY(write_image(w, i));
    if (w->depth)
      PAGS_TRY(write_depth(w, i));
  }
  return PAGS_OK;
}

static void put_frame(pags_json_writer *json, const pags_camera *camera, int index) {
  char name[32];
  snprintf(name, sizeof name, "images/%04d.png", index + 1);
  pags_json_begin_object(json, NULL);
  pags_json_put_string(json, "file_path", name);
  pags_json_begin_array(json, "transform_matrix");
  for (int r = 0; r < 3; r++) { /* y and z turned: OpenGL's axes */
    const double *m = camera->world_from_camera + 4 * r;
    pags_json_put_numbers(json, NULL, (double[]){m[0], -m[1], -m[2], m[3]}, 4);
  }
  pags_json_put_numbers(json, NULL, (double[]){0, 0, 0, 1}, 4);
  pags_json_end_array(json);
  pags_json_end_object(json);
}

static pags_result write_transforms(const writer *w) {
  const pags_synth_options *o = w->options;
  const pags_camera first = pags_room_camera(0, o->views, o->width, o->height);
  pags_json_writer json;
  pags_json_writer_init(&json, 2);
  pags_json_begin_object(&json, NULL);
  pags_json_put_string(&json, "camera_model", "PINHOLE");
  pags_json_put_integer(&json, "w", o->width);
  pags_json_put_integer(&json, "h", o->height);
  pags_json_put_number(&json, "fl_x", first.fx);
  pags_json_put_number(&json, "fl_y", first.fy);
  pags_json_put_number(&json, "cx", first.cx);
  pags_json_put_number(&json, "cy", first.cy);
  if (o->points)
    pags_json_put_string(&json, "ply_file_path", "points.ply");
  pags_json_begin_array(&json, "frames");
  for (int i = 0; i < o->views; i++) {
    const pags_camera camera = pags_room_camera(i, o->views, o->width, o->height);
    put_frame(&json, &camera, i);
  }
  pags_json_end_array(&json);
  pags_json_end_object(&json);
  char *path = NULL;
  pags_result result = make_path(w->folder, "transforms.json", 0, "", &path);
  if (result == PAGS_OK)
    result = pags_json_writer_save(&json, path);
  pags_json_writer_destroy(&json);
  free(path);
  return result;
}

static pags_result write_points(const writer *w) {
  char *path = NULL;
  if (!w->options->points)
    return PAGS_OK;
  PAGS_TRY(make_path(w->folder, "points.ply", 0, "", &path));
  const pags_result result = pags_points_write(path, w->tracer, w->room, w->options);
  free(path);
  return result;
}

static pags_result write_all(writer *w, pags_progress_fn *progress, void *user) {
  const pags_synth_options *o = w->options;
  PAGS_TRY(check_options(o));
  PAGS_TRY(pags_tracer_create(w->room, &w->tracer));
  PAGS_TRY(pags_image_create(&w->image, o->width, o->height, 3, PAGS_U8));
  if (o->depth) {
    w->depth = malloc((size_t)o->width * (size_t)o->height * sizeof *w->depth);
    if (!w->depth)
      return pags_out_of_memory("a picture of %dx%d", o->width, o->height);
  }
  PAGS_TRY(make_folders(w));
  PAGS_TRY(write_points(w));
  PAGS_TRY(write_views(w, progress, user));
  return write_transforms(w);
}

pags_result pags_synth_room(const char *folder, const pags_synth_options *options, pags_tasks *tasks,
                            pags_progress_fn *progress, void *user) {
  writer w = {.folder = folder, .options = options, .room = pags_room_get(), .tasks = tasks};
  const pags_result result = write_all(&w, progress, user);
  pags_tracer_destroy(w.tracer);
  pags_image_destroy(&w.image);
  free(w.depth);
  return result;
}
