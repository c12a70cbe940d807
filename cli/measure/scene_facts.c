/* SPDX-License-Identifier: Apache-2.0 */
/* Reports the facts of a scene for pags info: models, objects, tracks, priorities, views, sky, exposure, memory, and
 * the notes that training left. */
#include "cli/measure/info.h"

#include "cli/draw/camera_paths.h"
#include "cli/draw/picture.h"
#include "cli/measure/decisions.h"

#include <math.h>
#include <pags/train.h>
#include <strings.h>
#include "base/file.h"
#include "base/vec3.h"
#include "frame/owners.h"

const char *pags_up_name(pags_up up) {
  return up == PAGS_UP_Z ? "+z" : up == PAGS_UP_MINUS_Y ? "-y" : up == PAGS_UP_Y ? "+y" : "unknown";
}

/* ---- Models ---- */

/* Reports how many Gaussians need each degree of spherical harmonics, which is what packing by degree would have to
 * store. */
static void put_degrees(pags_report *report, const pags_scene *scene) {
  static const char *const names[] = {"degree_0", "degree_1", "degree_2", "degree_3"};
  int64_t count[4] = {0};
  int most = 0;
  for (int64_t m = 0; m < scene->model_count; m++) {
    const pags_gaussians *g = &scene->models[m].gaussians;
    most = g->sh_degree > most ? g->sh_degree : most;
    for (int64_t i = 0; i < g->count; i++)
      ++count[pags_gaussians_row_degree(g, i)];
  }
  pags_report_begin_group(report, "gaussians_by_colour");
  for (int degree = 0; degree <= most; degree++)
    pags_report_count(report, names[degree], count[degree]);
  pags_report_end_group(report);
}

static const pags_scene_object *object_of(const pags_scene *scene, int64_t model) {
  for (int64_t o = 0; o < scene->object_count; o++)
    if (scene->objects[o].model == model)
      return &scene->objects[o];
  return NULL;
}

/* Computes the bounding box of the means of all models that aren't placed by an object's track, in absolute
 * coordinates; returns false if there are no such Gaussians. */
static bool scene_bounds(const pags_scene *scene, double lo[3], double hi[3]) {
  for (int axis = 0; axis < 3; axis++) {
    lo[axis] = HUGE_VAL;
    hi[axis] = -HUGE_VAL;
    for (int64_t m = 0; m < scene->model_count; m++) {
      const pags_gaussians *gaussians = &scene->models[m].gaussians;
      for (int64_t i = 0; i < gaussians->count && !object_of(scene, m); i++) {
        double at = scene->origin[axis] + (double)pags_plane(gaussians, PAGS_MEAN + axis)[i];
        lo[axis] = fmin(lo[axis], at);
        hi[axis] = fmax(hi[axis], at);
      }
    }
  }
  return lo[0] <= hi[0];
}

/* Size in bytes of the splat file `path`; of an unpacked SOG those of meta.json and all WebP pictures together. */
static pags_result file_bytes(const char *path, uint64_t *bytes) {
  PAGS_TRY(pags_file_size(path, bytes));
  if (strcasecmp(pags_path_name(path), "meta.json") != 0)
    return PAGS_OK;
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_AUTOFREE char *folder = pags_path_folder(path);
  PAGS_CHECK_MEMORY(folder, NULL);
  PAGS_TRY(pags_dir_list_read(folder, &list));
  for (int64_t i = 0; i < list.count; i++) {
    PAGS_AUTOFREE char *picture = pags_path_join(folder, list.names[i]);
    uint64_t size = 0;
    PAGS_CHECK_MEMORY(picture, NULL);
    if (strcasecmp(pags_path_extension(list.names[i]), ".webp") == 0)
      PAGS_TRY(pags_file_size(picture, &size));
    *bytes += size;
  }
  return PAGS_OK;
}

static pags_result put_models(pags_report *report, const char *path, const pags_scene *scene, uint64_t *total) {
  const bool folder = pags_dir_exists(path);
  pags_report_begin_list(report, "models");
  for (int64_t i = 0; i < scene->model_count; i++) {
    const pags_model *model = &scene->models[i];
    const pags_scene_object *object = object_of(scene, i);
    PAGS_AUTOFREE char *inside = folder ? pags_path_join(path, model->file) : NULL;
    uint64_t bytes;
    PAGS_CHECK_MEMORY(inside || !folder, NULL);
    PAGS_TRY(file_bytes(folder ? inside : path, &bytes));
    *total += bytes;
    if (object) {
      /* Print one line per object's model, since there may be a hundred of them. */
      const pags_gaussians *g = &model->gaussians;
      char size[32];
      pags_report_named(report, model->name, "%s, %lld Gaussians of SH degree %d, %s%s%s", object->record.class_name,
                        (long long)g->count, g->sh_degree, pags_format_bytes((double)bytes, size, sizeof size),
                        g->fourier ? ", colour over time" : "", object->rigid ? "" : ", not rigid");
      pags_json_writer *w = &report->json;
      pags_json_begin_object(w, NULL);
      pags_json_put_string(w, "name", model->name);
      pags_json_put_string(w, "file", model->file);
      pags_json_put_integer(w, "gaussians", g->count);
      pags_json_put_integer(w, "sh_degree", g->sh_degree);
      pags_json_put_unsigned(w, "bytes", bytes);
      pags_json_put_string(w, "object", object->record.id);
      pags_json_put_string(w, "class", object->record.class_name);
      pags_json_put_bool(w, "fourier_colour", g->fourier != NULL);
      pags_json_put_bool(w, "rigid", object->rigid != 0);
      pags_json_end_object(w);
      continue;
    }
    pags_report_begin_item(report, model->name);
    if (folder)
      pags_report_text(report, "file", model->file);
    pags_report_count(report, "gaussians", model->gaussians.count);
    pags_report_count(report, "sh_degree", model->gaussians.sh_degree);
    pags_report_bytes(report, "bytes", (double)bytes);
    pags_report_end_item(report);
  }
  pags_report_end_list(report);
  return PAGS_OK;
}

/* ---- Objects and tracks ---- */

/* Reports how many objects of a category there are, and how many of them are critical, moving, parked, and have
 * models of their own. */
static void put_category(pags_report *report, const pags_scene *scene, pags_category category) {
  int64_t count = 0, moving = 0, own = 0, critical = 0, rigid = 0, fourier = 0;
  for (int64_t o = 0; o < scene->object_count; o++) {
    const pags_scene_object *object = &scene->objects[o];
    if (object->record.category != category)
      continue;
    count++;
    moving += object->record.moving != 0;
    critical += object->critical != 0;
    own += object->model >= 0;
    rigid += object->model >= 0 && object->rigid;
    fourier += object->model >= 0 && scene->models[object->model].gaussians.fourier;
  }
  if (!count)
    return;
  pags_report_begin_item(report, pags_category_name(category));
  pags_report_count(report, "count", count);
  pags_report_count(report, "critical", critical);
  pags_report_count(report, "moving", moving);
  pags_report_count(report, "parked", count - moving);
  pags_report_count(report, "own_models", own);
  pags_report_count(report, "rigid_models", rigid);
  pags_report_count(report, "fourier_models", fourier);
  pags_report_end_item(report);
}

pags_result pags_scene_object_gaussians(const pags_scene *scene, int64_t **out) {
  int64_t *counts = calloc((size_t)scene->object_count + 1, sizeof *counts);
  *out = counts;
  PAGS_CHECK_MEMORY(counts, "%lld objects", (long long)scene->object_count);
  for (int64_t m = 0; m < scene->model_count; m++) {
    const pags_gaussians *g = &scene->models[m].gaussians;
    for (int64_t i = 0; g->object_id && !object_of(scene, m) && i < g->count; i++)
      if (g->object_id[i] >= 0 && g->object_id[i] < scene->object_count) /* a splat file has ids but no objects */
        counts[g->object_id[i]]++;
  }
  for (int64_t o = 0; o < scene->object_count; o++)
    if (scene->objects[o].model >= 0)
      counts[o] = scene->models[scene->objects[o].model].gaussians.count;
  return PAGS_OK;
}

static pags_result list_objects(pags_report *report, const pags_scene *scene) {
  PAGS_AUTOFREE int64_t *gaussians = NULL;
  PAGS_TRY(pags_scene_object_gaussians(scene, &gaussians));
  pags_report_begin_list(report, "every_object");
  for (int64_t o = 0; o < scene->object_count; o++) {
    const pags_scene_object *object = &scene->objects[o];
    const pags_object *record = &object->record;
    double seen[2] = {record->keyframes[0].time - scene->time_begin,
                      record->keyframes[record->keyframe_count - 1].time - scene->time_begin};
    pags_report_begin_item(report, record->id);
    pags_report_text(report, "class", record->class_name);
    pags_report_text(report, "category", pags_category_name(record->category));
    pags_report_flag(report, "moving", record->moving != 0);
    pags_report_text(report, "model", object->model >= 0 ? scene->models[object->model].name : "background");
    pags_report_count(report, "gaussians", gaussians[o]);
    pags_report_vector(report, "size", record->size, 3);
    pags_report_vector(report, "seconds", seen, 2);
    pags_report_end_item(report);
  }
  pags_report_end_list(report);
  return PAGS_OK;
}

/* Reports the mean correction that training made to the poses of objects with models, in metres and degrees. */
static void put_tracks(pags_report *report, const pags_scene *scene) {
  int64_t tracks = 0, keyframes = 0, trained = 0;
  double metres = 0, radians = 0;
  for (int64_t o = 0; o < scene->object_count; o++) {
    const pags_object *record = &scene->objects[o].record;
    if (scene->objects[o].model < 0)
      continue;
    tracks++;
    keyframes += record->keyframe_count;
    for (int64_t k = 0; k < record->keyframe_count; k++) {
      if (!record->keyframes[k].trained)
        continue;
      trained++;
      metres += pags_length3(record->keyframes[k].translation);
      radians += pags_length3(record->keyframes[k].rotation);
    }
  }
  if (!tracks)
    return;
  pags_report_begin_group(report, "tracks");
  pags_report_count(report, "count", tracks);
  pags_report_count(report, "knots", keyframes);
  pags_report_count(report, "trained_knots", trained);
  pags_report_number(report, "mean_correction_metres", trained ? metres / (double)trained : 0);
  pags_report_number(report, "mean_correction_degrees", trained ? radians / (double)trained * 57.29577951308232 : 0);
  pags_report_end_group(report);
}

/* ---- Exposure ---- */

static void put_exposure(pags_report *report, const pags_scene *scene) {
  int64_t exposed = 0;
  double lo = HUGE_VAL, hi = -HUGE_VAL;
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *view = &scene->views[i];
    bool changed = false;
    for (int k = 0; k < 3; k++) {
      changed = changed || view->gain[k] != 1 || view->offset[k] != 0;
      lo = fmin(lo, view->gain[k]);
      hi = fmax(hi, view->gain[k]);
    }
    exposed += changed;
  }
  if (!exposed) {
    pags_report_text(report, "exposure", "the same in every view");
    return;
  }
  pags_report_begin_group(report, "exposure");
  pags_report_count(report, "views", exposed);
  pags_report_vector(report, "gains", (double[]){lo, hi}, 2);
  pags_report_end_group(report);
}

/* ---- Memory and priorities ---- */

/* Renders one frame from the first camera of an orbit and reports the bytes per Gaussian of storage (float32),
 * rendering and training. Takes over the scene's contents. */
static pags_result put_memory(pags_report *report, pags_tasks *tasks, pags_scene *scene) {
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path path = {0};
  PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL;
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *composition = NULL;
  pags_picture picture;
  double stored = 0;
  int degree = 0;
  for (int64_t i = 0; i < scene->model_count; i++) {
    const pags_gaussians *g = &scene->models[i].gaussians;
    const int planes =
        pags_plane_count(g->sh_degree) + (g->s_sem ? 1 : 0) + (g->object_id ? 1 : 0) + pags_fourier_planes(g);
    stored += (double)g->count * 4.0 * planes;
    degree = g->sh_degree > degree ? g->sh_degree : degree;
  }
  PAGS_TRY(pags_camera_path_orbit(scene, 1, PAGS_STAND_AUTO, &path));
  const pags_camera *const camera = &path.cameras[0];
  PAGS_TRY(pags_frame_create(tasks, &frame));
  PAGS_TRY(pags_composition_create(scene, &composition));
  const pags_frame_options options = pags_composition_options(composition);
  PAGS_TRY(pags_picture_render(composition, frame, camera, &options, &picture));
  const int64_t gaussians = pags_composition_gaussian_count(composition);
  const double count = (double)(gaussians ? gaussians : 1);
  const uint64_t training = pags_train_bytes(gaussians, degree, camera->width, camera->height);
  pags_report_begin_group(report, "memory");
  pags_report_text(report, "unit", "bytes per Gaussian");
  pags_report_number(report, "parameters", stored / count);
  pags_report_number(report, "ready_to_draw", (double)pags_composition_bytes(composition) / count);
  pags_report_number(report, "frame", (double)pags_frame_bytes(frame) / count);
  pags_report_number(report, "training", (double)training / count);
  pags_report_count(report, "width", camera->width);
  pags_report_count(report, "height", camera->height);
  pags_report_end_group(report);
  return PAGS_OK;
}

/* Reports the mean priority of the Gaussians that have one, and the shares over 0.1, 0.5 and 0.9. */
static void put_priorities(pags_report *report, const pags_scene *scene) {
  static const float bounds[3] = {0.1f, 0.5f, 0.9f};
  static const char *const names[3] = {"over_0.1", "over_0.5", "over_0.9"};
  int64_t known = 0, over[3] = {0};
  double sum = 0;
  for (int64_t i = 0; i < scene->model_count; i++) {
    const pags_gaussians *g = &scene->models[i].gaussians;
    known += g->s_sem ? g->count : 0;
    for (int64_t row = 0; g->s_sem && row < g->count; row++) {
      sum += (double)g->s_sem[row];
      for (int k = 0; k < 3; k++)
        over[k] += g->s_sem[row] > bounds[k];
    }
  }
  if (!known)
    return;
  pags_report_begin_group(report, "priority");
  pags_report_count(report, "gaussians", known);
  pags_report_number(report, "mean", sum / (double)known);
  for (int k = 0; k < 3; k++)
    pags_report_number(report, names[k], (double)over[k] / (double)known);
  pags_report_end_group(report);
}

/* ---- The whole report ---- */

/* Reports the up axis and its source: the file (also the record of its axes), an option, or the default -y. */
static void put_up(pags_report *report, const pags_scene *scene, const pags_reading *reading) {
  const pags_splat_facts *file = &scene->file;
  const bool record = file->axes_from && strcmp(file->axes_from, "record") == 0;
  const char *const from = reading->up || (reading->axes && file->up == PAGS_UP_UNKNOWN) ? "option"
                           : !file->kind || file->up != PAGS_UP_UNKNOWN || record        ? "file"
                                                                                         : "default";
  const char *const name = pags_up_name(scene->up);
  pags_report_line(report, "up", "%s%s", name, strcmp(from, "default") == 0 ? ", assumed; --up overrides" : "");
  pags_json_put_string(&report->json, "up", name);
  pags_json_put_string(&report->json, "up_from", from);
}

pags_result pags_scene_facts(pags_report *report, const char *path, const pags_scene_facts_options *options) {
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  uint64_t bytes = 0;
  PAGS_TRY(pags_reading_load(&options->reading, path, &scene));
  const char *const folder = pags_dir_exists(path) ? pags_scene_folder_kind(path) : NULL;
  pags_report_text(report, "kind", folder ? folder : scene.file.kind ? scene.file.kind : "scene");
  pags_report_count(report, "gaussians", pags_scene_gaussian_count(&scene));
  PAGS_TRY(put_models(report, path, &scene, &bytes));
  pags_report_bytes(report, "bytes", (double)bytes);
  put_degrees(report, &scene);

  /* Report up, origin, place and bounds in the world; the axes of a splat file, unless its format fixes them. */
  double lo[3], hi[3];
  if (scene.file.axes != PAGS_AXES_UNKNOWN) {
    char text[64];
    snprintf(text, sizeof text, "%s, by the %s", pags_axes_name(scene.file.axes), scene.file.axes_from);
    pags_report_text(report, "axes", text);
  }
  put_up(report, &scene, &options->reading);
  pags_report_flag(report, "antialiased", scene.antialiased != 0);
  if (scene.model_count > 0 && scene.models[0].gaussians.alpha_min > 0.0f)
    pags_report_number(report, "alpha_min", (double)scene.models[0].gaussians.alpha_min);
  pags_report_vector(report, "origin", scene.origin, 3);
  pags_report_place(report, &scene.place);
  if (scene_bounds(&scene, lo, hi)) {
    pags_report_vector(report, "bounds_lo", lo, 3);
    pags_report_vector(report, "bounds_hi", hi, 3);
  }
  if (scene.iterations)
    pags_report_count(report, "iterations", scene.iterations);
  if (scene.dataset)
    pags_report_text(report, "dataset", scene.dataset);

  put_priorities(report, &scene);
  int64_t held_out = 0;
  for (int64_t i = 0; i < scene.view_count; i++)
    held_out += scene.views[i].test != 0;
  if (scene.view_count) {
    pags_report_count(report, "views_train", scene.view_count - held_out);
    pags_report_count(report, "views_test", held_out);
    pags_report_count(report, "width", scene.views[0].camera.width);
    pags_report_count(report, "height", scene.views[0].camera.height);
  }

  /* Report the time span and exposure of scenes that have time. */
  double time[2] = {scene.time_begin, scene.time_end};
  if (scene.time_end > scene.time_begin || scene.fps > 0) {
    pags_report_line(report, "time", "%.3f to %.3f s", time[0], time[1]);
    pags_json_put_numbers(&report->json, "time", time, 2);
    pags_report_number(report, "seconds", scene.time_end - scene.time_begin);
    pags_report_number(report, "steps_per_second", scene.fps);
    put_exposure(report, &scene);
  }
  if (scene.sky.size > 0)
    pags_report_count(report, "sky_texels_a_side", scene.sky.size);
  else if (scene.object_count)
    pags_report_text(report, "sky", "none");

  if (scene.object_count) {
    pags_report_begin_list(report, "objects");
    for (int c = PAGS_CATEGORY_VEHICLE; c <= PAGS_CATEGORY_CYCLIST; c++)
      put_category(report, &scene, (pags_category)c);
    put_category(report, &scene, PAGS_CATEGORY_OTHER);
    pags_report_end_list(report);
    put_tracks(report, &scene);
  }
  if (scene.object_count && options->objects)
    PAGS_TRY(list_objects(report, &scene));
  if (scene.notes)
    PAGS_TRY(pags_decisions_put(report, scene.notes, pags_dir_exists(path) ? path : NULL));
  return options->memory ? put_memory(report, options->tasks, &scene) : PAGS_OK;
}
