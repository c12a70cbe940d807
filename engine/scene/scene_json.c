/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes scene.json (docs/scene-folder.md lists its keys); models' Gaussians and the sky are files of their
 * own. */
#include "scene/scene_json.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "scene/axes.h"

/* 2: Fourier terms of SH coefficients beyond the constant one, which programs of version 1 would leave out. */
enum { OLD_VERSION = 1, VERSION = 2 };

static const char *const alpha_names[] = {"composite", "mask", "ignore"}; /* pags_image_alpha */

/* ---- Reading ---- */

static pags_result read_models(const pags_json *json, const pags_json_value *root, pags_scene *scene,
                               int64_t **counts) {
  const pags_json_value *models;
  PAGS_TRY(pags_json_array(json, root, "models", &models));
  scene->models = calloc((size_t)models->count + 1, sizeof *scene->models);
  *counts = calloc((size_t)models->count + 1, sizeof **counts);
  PAGS_CHECK_MEMORY(scene->models && *counts, "%s: the scene", pags_json_path(json));
  for (const pags_json_value *value = models->first; value; value = value->next) {
    int64_t *const count = &(*counts)[scene->model_count];
    pags_model *const model = &scene->models[scene->model_count++]; /* without its Gaussians */
    double alpha_min;
    int64_t fourier_degree;
    PAGS_TRY(pags_json_string_copy(json, value, "name", &model->name));
    PAGS_TRY(pags_json_string_copy(json, value, "file", &model->file));
    PAGS_TRY(pags_json_integer(json, value, "gaussians", 0, INT32_MAX, count));
    PAGS_TRY(pags_json_int(json, value, "sh_degree", 0, 3, &model->gaussians.sh_degree));
    PAGS_TRY(pags_json_integer_or(json, value, "fourier_degree", 0, 3, 0, &fourier_degree));
    model->gaussians.fourier_degree = (int)fourier_degree;
    PAGS_TRY(pags_json_number_or(json, value, "alpha_min", 0, &alpha_min));
    if (alpha_min != 0 && !(alpha_min >= (double)PAGS_LEAST_ALPHA_MIN && alpha_min < 1))
      return pags_json_fail(json, pags_json_member(value, "alpha_min"),
                            "expected a number from 1/255 to 1 for 'alpha_min', found %g", alpha_min);
    model->gaussians.alpha_min = (float)alpha_min;
    if (!pags_path_is_inside(model->file))
      return pags_json_fail(json, pags_json_member(value, "file"),
                            "expected a 'file' inside of the scene's folder, found \"%s\"", model->file);
  }
  /* Names of models must differ, since objects refer to models by name. */
  return pags_json_names_differ(json, models, "models", &scene->models->name, sizeof *scene->models,
                                scene->model_count);
}

/* Copies the JSON text of the object under `key` unparsed, to be written back unchanged; leaves *out alone if the key
 * is missing or null. */
static pags_result read_raw(const pags_json *json, const pags_json_value *root, const char *key, char **out) {
  const pags_json_value *value = pags_json_member(root, key);
  if (!value || value->type == PAGS_JSON_NULL)
    return PAGS_OK;
  PAGS_TRY(pags_json_as_object(json, value, key));
  size_t length = (size_t)(value->source_end - value->source_begin);
  *out = malloc(length + 1);
  PAGS_CHECK_MEMORY(*out, "%s: the scene", pags_json_path(json));
  memcpy(*out, value->source_begin, length);
  (*out)[length] = 0;
  return PAGS_OK;
}

/* Fails if one of three numbers is too large for sums in float. */
static pags_result check_sizes(const pags_json *json, const pags_json_value *object, const char *key,
                               const double numbers[3]) {
  static const double most = 1e12;
  for (int k = 0; k < 3; k++)
    if (!(fabs(numbers[k]) <= most))
      return pags_json_fail(json, pags_json_member(object, key), "expected numbers from -%g to %g for '%s', found %g",
                            most, most, key, numbers[k]);
  return PAGS_OK;
}

/* Copies a string; leaves *out alone if the key is missing or null. */
static pags_result read_text(const pags_json *json, const pags_json_value *root, const char *key, char **out) {
  const char *text;
  PAGS_TRY(pags_json_string_or(json, root, key, NULL, &text));
  return text ? pags_json_string_copy(json, root, key, out) : PAGS_OK;
}

static pags_result read_root(const pags_json *json, pags_scene *scene, pags_scene_files *files) {
  const pags_json_value *root = pags_json_root(json);
  double time[2], background[3];
  PAGS_TRY(pags_json_as_object(json, root, "a scene"));

  /* Version and units come first, since they decide whether the other keys can be understood. */
  int64_t version;
  const char *units, *up, *alpha;
  PAGS_TRY(pags_json_integer(json, root, "version", 1, INT32_MAX, &version));
  if (version > VERSION)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s:%d: the scene's version is %lld, this program reads up to %d",
                     pags_json_path(json), pags_json_member(root, "version")->line, (long long)version, VERSION);
  PAGS_TRY(pags_json_string(json, root, "units", &units));
  if (strcmp(units, "metres") != 0)
    return pags_json_fail(json, pags_json_member(root, "units"), "expected \"metres\" for 'units', found \"%.40s\"",
                          units);

  PAGS_TRY(pags_json_numbers(json, root, "origin", 3, scene->origin));
  PAGS_TRY(check_sizes(json, root, "origin", scene->origin));
  PAGS_TRY(pags_json_string(json, root, "up", &up));
  if (!pags_up_from_code(up, &scene->up))
    return pags_json_fail(json, pags_json_member(root, "up"),
                          "expected \"z\", \"-y\", \"y\" or \"unknown\" for 'up', found \"%.40s\"", up);
  PAGS_TRY(pags_json_numbers(json, root, "time", 2, time));
  scene->time_begin = time[0];
  scene->time_end = time[1];
  PAGS_TRY(pags_json_flag_or(json, root, "antialiased", false, &scene->antialiased));
  PAGS_TRY(pags_json_numbers(json, root, "background", 3, background));
  PAGS_TRY(check_sizes(json, root, "background", background));
  pags_narrow3(background, scene->background);
  PAGS_TRY(pags_json_number_or(json, root, "fps", 0, &scene->fps));
  if (scene->fps < 0)
    return pags_json_fail(json, pags_json_member(root, "fps"), "expected a number from 0 on for 'fps', found %g",
                          scene->fps);
  PAGS_TRY(pags_place_from_json(json, root, &scene->place));

  /* How the scene was trained: data set, seed, steps, configuration, notes on the models. */
  PAGS_TRY(read_text(json, root, "dataset", &scene->dataset));
  PAGS_TRY(read_text(json, root, "colmap", &scene->colmap));
  /* How the photographs were opened for the training. */
  PAGS_TRY(read_text(json, root, "image_folder", &scene->image_folder));
  PAGS_TRY(pags_json_string_or(json, root, "image_alpha", alpha_names[0], &alpha));
  scene->image_alpha = pags_text_find(alpha, alpha_names, 3);
  if (scene->image_alpha < 0)
    return pags_json_fail(json, pags_json_member(root, "image_alpha"),
                          "expected \"composite\", \"mask\" or \"ignore\" for 'image_alpha', found \"%.40s\"", alpha);
  PAGS_TRY(pags_json_unsigned_or(json, root, "seed", 0, &scene->seed));
  PAGS_TRY(pags_json_integer_or(json, root, "iterations", 0, INT64_MAX, 0, &scene->iterations));
  PAGS_TRY(read_raw(json, root, "config", &scene->config));
  PAGS_TRY(read_raw(json, root, "block", &scene->block));
  PAGS_TRY(read_raw(json, root, "modelled", &scene->notes));

  PAGS_TRY(read_text(json, root, "sky", &files->sky));
  if (files->sky && !pags_path_is_inside(files->sky))
    return pags_json_fail(json, pags_json_member(root, "sky"),
                          "expected a file inside of the scene's folder for 'sky', found \"%s\"", files->sky);
  PAGS_TRY(read_models(json, root, scene, &files->counts));
  PAGS_TRY(pags_scene_objects_from_json(json, root, scene));

  /* The photographs of the data set with their cameras and exposures. */
  const pags_json_value *views;
  PAGS_TRY(pags_json_array(json, root, "cameras", &views));
  scene->views = calloc((size_t)views->count + 1, sizeof *scene->views);
  PAGS_CHECK_MEMORY(scene->views, "%s: the scene", pags_json_path(json));
  for (const pags_json_value *value = views->first; value; value = value->next) {
    pags_scene_view *view = &scene->views[scene->view_count++];
    *view = (pags_scene_view){.gain = {1, 1, 1}};
    PAGS_TRY(pags_json_string_copy(json, value, "name", &view->name));
    PAGS_TRY(pags_json_flag_or(json, value, "test", false, &view->test));
    PAGS_TRY(pags_json_int_or(json, value, "sensor", -1, INT32_MAX, -1, &view->sensor));
    PAGS_TRY(pags_json_int_or(json, value, "frame", -1, INT32_MAX, -1, &view->frame));
    PAGS_TRY(pags_json_numbers_or(json, value, "gain", 3, view->gain));
    PAGS_TRY(pags_json_numbers_or(json, value, "offset", 3, view->offset));
    PAGS_TRY(check_sizes(json, value, "gain", view->gain));
    PAGS_TRY(check_sizes(json, value, "offset", view->offset));
    PAGS_TRY(pags_camera_from_json(json, value, &view->camera));
    PAGS_TRY(pags_json_numbers_if(json, value, "correction", 6, view->correction));
    PAGS_TRY(pags_json_numbers_if(json, value, "vignette", PAGS_VIGNETTING_RINGS, view->photometric.vignette));
    PAGS_TRY(pags_json_numbers_if(json, value, "response", PAGS_RESPONSE_PIECES - 1, view->photometric.response));
    if (!pags_photometric_is_valid(&view->photometric))
      return pags_json_fail(json, value, "expected a 'response' that rises from 0 to 1");
  }
  return PAGS_OK;
}

pags_result pags_scene_json_read(const char *path, pags_scene *scene, pags_scene_files *files) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  *files = (pags_scene_files){0};
  PAGS_TRY(pags_json_parse_file(path, &json));
  return read_root(json, scene, files);
}

/* ---- Writing ---- */

static void write_views(pags_json_writer *w, const pags_scene *scene) {
  pags_json_begin_array(w, "cameras");
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *view = &scene->views[i];
    pags_json_begin_object(w, NULL);
    pags_json_put_string(w, "name", view->name);
    pags_json_put_bool(w, "test", view->test);

    /* Keys that only views of driving scenes have; left out where they have no value. */
    if (view->sensor >= 0)
      pags_json_put_integer(w, "sensor", view->sensor);
    if (view->frame >= 0)
      pags_json_put_integer(w, "frame", view->frame);
    bool exposed = false;
    for (int k = 0; k < 3; k++)
      exposed = exposed || view->gain[k] != 1 || view->offset[k] != 0;
    if (exposed) {
      pags_json_put_numbers(w, "gain", view->gain, 3);
      pags_json_put_numbers(w, "offset", view->offset, 3);
    }

    pags_camera_to_json(w, &view->camera);
    if (pags_scene_view_is_corrected(view))
      pags_json_put_numbers(w, "correction", view->correction, 6);
    if (!pags_photometric_is_identity(&view->photometric)) {
      pags_json_put_numbers(w, "vignette", view->photometric.vignette, PAGS_VIGNETTING_RINGS);
      pags_json_put_numbers(w, "response", view->photometric.response, PAGS_RESPONSE_PIECES - 1);
    }
    pags_json_end_object(w);
  }
  pags_json_end_array(w);
}

/* Writes `text`, which is JSON, under `key`; null if it is NULL. White space around it is cut off, so that reading
 * and writing a file again gives the same bytes. */
static pags_result write_raw(pags_json_writer *w, const char *key, const char *text) {
  if (!text) {
    pags_json_put_null(w, key);
    return PAGS_OK;
  }
  while (isspace((unsigned char)*text))
    text++;
  size_t length = strlen(text);
  while (length && isspace((unsigned char)text[length - 1]))
    length--;
  PAGS_AUTOFREE char *trimmed = pags_text_copy(text);
  PAGS_CHECK_MEMORY(trimmed, "'%s' of a scene", key);
  trimmed[length] = 0;
  pags_json_put_raw(w, key, trimmed);
  return PAGS_OK;
}

/* Writes the whole of scene.json. */
static pags_result write_root(pags_json_writer *w, const pags_scene *scene) {
  double background[3];
  int version = OLD_VERSION;
  for (int64_t i = 0; i < scene->model_count; i++)
    if (scene->models[i].gaussians.fourier_degree > 0)
      version = VERSION;
  pags_widen3(scene->background, background);
  pags_json_begin_object(w, NULL);
  pags_json_put_integer(w, "version", version);
  pags_json_put_string(w, "units", "metres");
  pags_json_put_numbers(w, "origin", scene->origin, 3);
  pags_json_put_string(w, "up", pags_up_code(scene->up));
  pags_json_put_numbers(w, "time", (double[]){scene->time_begin, scene->time_end}, 2);

  pags_json_begin_array(w, "models");
  for (int64_t i = 0; i < scene->model_count; i++) {
    const pags_model *model = &scene->models[i];
    pags_json_begin_object(w, NULL);
    pags_json_put_string(w, "name", model->name);
    pags_json_put_string(w, "file", model->file);
    pags_json_put_integer(w, "gaussians", model->gaussians.count);
    pags_json_put_integer(w, "sh_degree", model->gaussians.sh_degree);
    if (model->gaussians.fourier_degree > 0)
      pags_json_put_integer(w, "fourier_degree", model->gaussians.fourier_degree);
    if (model->gaussians.alpha_min > 0.0f)
      pags_json_put_number(w, "alpha_min", (double)model->gaussians.alpha_min);
    pags_json_end_object(w);
  }
  pags_json_end_array(w);

  pags_json_put_numbers(w, "background", background, 3);
  pags_json_put_bool(w, "antialiased", scene->antialiased);
  pags_json_put_string(w, "dataset", scene->dataset);
  if (scene->colmap)
    pags_json_put_string(w, "colmap", scene->colmap);
  if (scene->image_folder)
    pags_json_put_string(w, "image_folder", scene->image_folder);
  if (scene->image_alpha)
    pags_json_put_string(w, "image_alpha", alpha_names[scene->image_alpha]);
  pags_json_put_unsigned(w, "seed", scene->seed);
  pags_json_put_integer(w, "iterations", scene->iterations);
  PAGS_TRY(write_raw(w, "config", scene->config));
  if (scene->fps > 0)
    pags_json_put_number(w, "fps", scene->fps);
  pags_place_to_json(w, &scene->place);
  if (scene->sky.size > 0)
    pags_json_put_string(w, "sky", PAGS_SKY_FILE);
  if (scene->block)
    PAGS_TRY(write_raw(w, "block", scene->block));
  if (scene->notes)
    PAGS_TRY(write_raw(w, "modelled", scene->notes));
  if (scene->object_count)
    pags_scene_objects_to_json(w, scene);
  write_views(w, scene);
  pags_json_end_object(w);
  return PAGS_OK;
}

pags_result pags_scene_json_size(const pags_scene *scene, uint64_t *bytes) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {.indent = 1};
  PAGS_TRY(write_root(&writer, scene));
  PAGS_TRY(pags_json_writer_finish(&writer));
  *bytes = writer.size;
  return PAGS_OK;
}

pags_result pags_scene_json_write(const char *path, const pags_scene *scene) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {.indent = 1};
  PAGS_TRY(write_root(&writer, scene));
  return pags_json_writer_save(&writer, path);
}

/* ---- The place on the earth, which dataset.json has too ---- */

static const char place_key[] = "geographic_origin";

pags_result pags_place_from_json(const pags_json *json, const pags_json_value *root, pags_place *out) {
  const pags_json_value *value = pags_json_member(root, place_key);
  double numbers[3];
  *out = (pags_place){0};
  if (!value || value->type == PAGS_JSON_NULL)
    return PAGS_OK;
  PAGS_TRY(pags_json_numbers(json, root, place_key, 3, numbers));
  if (!(fabs(numbers[0]) <= 90 && fabs(numbers[1]) <= 180))
    return pags_json_fail(json, value,
                          "expected latitude (-90..90), longitude (-180..180) and altitude for '%s', found %g, %g",
                          place_key, numbers[0], numbers[1]);
  *out = (pags_place){numbers[0], numbers[1], numbers[2], 1};
  return PAGS_OK;
}

void pags_place_to_json(pags_json_writer *writer, const pags_place *place) {
  if (place->known)
    pags_json_put_numbers(writer, place_key, (double[]){place->latitude, place->longitude, place->altitude}, 3);
}
