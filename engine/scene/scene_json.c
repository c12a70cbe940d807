/* Reading and writing scene.json. */
#include "scene/scene_json.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/text.h"
#include "scene/camera_json.h"

enum { VERSION = 1 };

static const char *const up_names[] = {[PAGS_UP_UNKNOWN] = "unknown", [PAGS_UP_Z] = "z", [PAGS_UP_MINUS_Y] = "-y"};

static pags_result fail_memory(const pags_json *json) {
  return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for the scene", pags_json_path(json));
}

static pags_result copy_string(const pags_json *json, const pags_json_value *object, const char *key, char **out) {
  const char *text;
  PAGS_TRY(pags_json_string(json, object, key, &text));
  *out = pags_text_copy(text);
  return *out ? PAGS_OK : fail_memory(json);
}

static pags_result read_up(const pags_json *json, const pags_json_value *root, pags_up *up) {
  const char *name;
  PAGS_TRY(pags_json_string(json, root, "up", &name));
  for (int i = 0; i < (int)(sizeof up_names / sizeof *up_names); ++i) {
    if (strcmp(name, up_names[i]) == 0) {
      *up = (pags_up)i;
      return PAGS_OK;
    }
  }
  return pags_json_fail(json, pags_json_member(root, "up"),
                        "expected \"z\", \"-y\" or \"unknown\" for 'up', found \"%.40s\"", name);
}

static pags_result read_model(const pags_json *json, const pags_json_value *value, pags_model *model, int64_t *count) {
  int64_t degree;
  PAGS_TRY(copy_string(json, value, "name", &model->name));
  PAGS_TRY(copy_string(json, value, "file", &model->file));
  PAGS_TRY(pags_json_integer(json, value, "gaussians", 0, INT32_MAX, count));
  PAGS_TRY(pags_json_integer(json, value, "sh_degree", 0, 3, &degree));
  model->gaussians.sh_degree = (int)degree;
  if (!pags_path_is_inside(model->file))
    return pags_json_fail(json, pags_json_member(value, "file"),
                          "expected a 'file' inside of the scene's folder, found \"%s\"", model->file);
  return PAGS_OK;
}

static pags_result read_models(const pags_json *json, const pags_json_value *root, pags_scene *scene,
                               int64_t **counts) {
  const pags_json_value *models;
  PAGS_TRY(pags_json_array(json, root, "models", &models));
  scene->models = calloc((size_t)models->count + 1, sizeof *scene->models);
  *counts = calloc((size_t)models->count + 1, sizeof **counts);
  if (!scene->models || !*counts)
    return fail_memory(json);
  for (const pags_json_value *model = models->first; model; model = model->next) {
    int64_t i = scene->model_count++;
    PAGS_TRY(read_model(json, model, &scene->models[i], &(*counts)[i]));
  }
  return PAGS_OK;
}

static pags_result read_views(const pags_json *json, const pags_json_value *root, pags_scene *scene) {
  const pags_json_value *views;
  PAGS_TRY(pags_json_array(json, root, "cameras", &views));
  scene->views = calloc((size_t)views->count + 1, sizeof *scene->views);
  if (!scene->views)
    return fail_memory(json);
  for (const pags_json_value *value = views->first; value; value = value->next) {
    pags_scene_view *view = &scene->views[scene->view_count++];
    bool test;
    PAGS_TRY(copy_string(json, value, "name", &view->name));
    PAGS_TRY(pags_json_bool_or(json, value, "test", false, &test));
    view->test = test;
    PAGS_TRY(pags_camera_from_json(json, value, &view->camera));
  }
  return PAGS_OK;
}

static pags_result read_dataset_and_config(const pags_json *json, const pags_json_value *root, pags_scene *scene) {
  const char *dataset;
  PAGS_TRY(pags_json_string_or(json, root, "dataset", NULL, &dataset));
  if (dataset && !(scene->dataset = pags_text_copy(dataset)))
    return fail_memory(json);
  const pags_json_value *config = pags_json_member(root, "config");
  if (!config || config->type == PAGS_JSON_NULL)
    return PAGS_OK;
  PAGS_TRY(pags_json_as_object(json, config, "config"));
  size_t length = (size_t)(config->source_end - config->source_begin);
  scene->config = malloc(length + 1);
  if (!scene->config)
    return fail_memory(json);
  memcpy(scene->config, config->source_begin, length);
  scene->config[length] = 0;
  return PAGS_OK;
}

static pags_result read_version(const pags_json *json, const pags_json_value *root) {
  int64_t version;
  const char *units;
  PAGS_TRY(pags_json_integer(json, root, "version", 1, INT32_MAX, &version));
  if (version > VERSION)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s:%d: the scene's version is %lld, this program reads up to %d",
                     pags_json_path(json), pags_json_member(root, "version")->line, (long long)version, VERSION);
  PAGS_TRY(pags_json_string(json, root, "units", &units));
  if (strcmp(units, "metres") != 0)
    return pags_json_fail(json, pags_json_member(root, "units"), "expected \"metres\" for 'units', found \"%.40s\"",
                          units);
  return PAGS_OK;
}

static pags_result read_root(const pags_json *json, pags_scene *scene, int64_t **counts) {
  const pags_json_value *root = pags_json_root(json);
  double time[2], background[3];
  bool antialiased;
  PAGS_TRY(pags_json_as_object(json, root, "a scene"));
  PAGS_TRY(read_version(json, root));
  PAGS_TRY(pags_json_numbers(json, root, "origin", 3, scene->origin));
  PAGS_TRY(read_up(json, root, &scene->up));
  PAGS_TRY(pags_json_numbers(json, root, "time", 2, time));
  scene->time_begin = time[0];
  scene->time_end = time[1];
  PAGS_TRY(pags_json_bool_or(json, root, "antialiased", false, &antialiased));
  scene->antialiased = antialiased;
  PAGS_TRY(pags_json_numbers(json, root, "background", 3, background));
  for (int k = 0; k < 3; ++k)
    scene->background[k] = (float)background[k];
  PAGS_TRY(pags_json_unsigned_or(json, root, "seed", 0, &scene->seed));
  PAGS_TRY(pags_json_integer_or(json, root, "iterations", 0, INT64_MAX, 0, &scene->iterations));
  PAGS_TRY(read_dataset_and_config(json, root, scene));
  PAGS_TRY(read_models(json, root, scene, counts));
  return read_views(json, root, scene);
}

pags_result pags_scene_json_read(const char *path, pags_scene *scene, int64_t **counts) {
  pags_json *json;
  *counts = NULL;
  PAGS_TRY(pags_json_parse_file(path, &json));
  pags_result result = read_root(json, scene, counts);
  pags_json_destroy(json);
  return result;
}

static void write_models(pags_json_writer *w, const pags_scene *scene) {
  pags_json_begin_array(w, "models");
  for (int64_t i = 0; i < scene->model_count; ++i) {
    const pags_model *model = &scene->models[i];
    pags_json_begin_object(w, NULL);
    pags_json_put_string(w, "name", model->name);
    pags_json_put_string(w, "file", model->file);
    pags_json_put_integer(w, "gaussians", model->gaussians.count);
    pags_json_put_integer(w, "sh_degree", model->gaussians.sh_degree);
    pags_json_end_object(w);
  }
  pags_json_end_array(w);
}

static void write_views(pags_json_writer *w, const pags_scene *scene) {
  pags_json_begin_array(w, "cameras");
  for (int64_t i = 0; i < scene->view_count; ++i) {
    const pags_scene_view *view = &scene->views[i];
    pags_json_begin_object(w, NULL);
    pags_json_put_string(w, "name", view->name);
    pags_json_put_bool(w, "test", view->test);
    pags_camera_to_json(w, &view->camera);
    pags_json_end_object(w);
  }
  pags_json_end_array(w);
}

/* Without the white space around it, so that reading and writing again gives the same bytes. */
static pags_result write_config(pags_json_writer *w, const char *config) {
  if (!config) {
    pags_json_put_null(w, "config");
    return PAGS_OK;
  }
  while (isspace((unsigned char)*config))
    ++config;
  size_t length = strlen(config);
  while (length && isspace((unsigned char)config[length - 1]))
    --length;
  char *trimmed = pags_text_copy(config);
  if (!trimmed)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for the configuration of a scene");
  trimmed[length] = 0;
  pags_json_put_raw(w, "config", trimmed);
  free(trimmed);
  return PAGS_OK;
}

static pags_result write_root(pags_json_writer *w, const pags_scene *scene) {
  double background[3] = {(double)scene->background[0], (double)scene->background[1], (double)scene->background[2]};
  pags_json_begin_object(w, NULL);
  pags_json_put_integer(w, "version", VERSION);
  pags_json_put_string(w, "units", "metres");
  pags_json_put_numbers(w, "origin", scene->origin, 3);
  pags_json_put_string(w, "up", up_names[scene->up]);
  pags_json_put_numbers(w, "time", (double[]){scene->time_begin, scene->time_end}, 2);
  write_models(w, scene);
  pags_json_put_numbers(w, "background", background, 3);
  pags_json_put_bool(w, "antialiased", scene->antialiased);
  pags_json_put_string(w, "dataset", scene->dataset);
  pags_json_put_unsigned(w, "seed", scene->seed);
  pags_json_put_integer(w, "iterations", scene->iterations);
  PAGS_TRY(write_config(w, scene->config));
  write_views(w, scene);
  pags_json_end_object(w);
  return PAGS_OK;
}

pags_result pags_scene_json_write(const char *path, const pags_scene *scene) {
  pags_json_writer writer;
  pags_json_writer_init(&writer, 1);
  pags_result result = write_root(&writer, scene);
  if (result == PAGS_OK)
    result = pags_json_writer_save(&writer, path);
  pags_json_writer_destroy(&writer);
  return result;
}
