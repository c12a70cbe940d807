/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the scene folder of a training run: scene.json with cameras, objects and tracks, one or more PLYs per model,
 * the sky. */
#include "train/output.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include <pags/scene.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "scene/scene_json.h"
#include "train/config.h"
#include "train/stages.h"

/* The scene to write, with the memory of its arrays. */
struct pags_described {
  pags_scene scene;
  char config[PAGS_CONFIG_TEXT];
  int by_degree;           /* 1: PLYs have only the SH degrees that their Gaussians need */
  pags_gaussians parts[4]; /* with by_degree: the background's Gaussians, by degree */
};

/* ---- Views and models ---- */

static char *borrow(const char *text) {
  return (char *)(uintptr_t)text;
}

pags_result pags_output_list_views(const pags_dataset *dataset, const pags_train_state *state, pags_scene *scene) {
  scene->view_count = pags_dataset_view_count(dataset);
  scene->views = calloc((size_t)(scene->view_count > 0 ? scene->view_count : 1), sizeof *scene->views);
  if (!scene->views)
    return pags_out_of_memory("%lld views", (long long)scene->view_count);
  const bool between = pags_dataset_fps(dataset) <= 0 && pags_exposures_follow_names(&state->exposures, dataset);
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    scene->views[i] = (pags_scene_view){.name = borrow(view->name),
                                        .camera = pags_camera_poses_view(&state->cameras, dataset, i),
                                        .test = view->test,
                                        .sensor = view->sensor,
                                        .photometric = pags_photometry_of_sensor(&state->photometry, view->sensor),
                                        .frame = view->frame};

    if (state->cameras.count > 0) {
      /* The correction is what follows the recorded pose. */
      double inverse[12], motion[12];
      pags_rigid_inverse(view->camera.world_from_camera, inverse);
      pags_rigid_multiply(inverse, scene->views[i].camera.world_from_camera, motion);
      pags_increment_rotation(motion, scene->views[i].correction);
      for (int k = 0; k < 3; k++)
        scene->views[i].correction[3 + k] = motion[4 * k + 3];
    }

    /* The exposure of the view; those of a driving set's held-out views are interpolated below. */
    double value[6] = {1.0, 1.0, 1.0, 0.0, 0.0, 0.0};
    if (state->exposures.count > 0 && !view->test)
      pags_exposures_value(&state->exposures, dataset, i, value);
    else if (between)
      pags_exposures_between(&state->exposures, dataset, i, value);
    memcpy(scene->views[i].gain, value, sizeof scene->views[i].gain);
    memcpy(scene->views[i].offset, value + 3, sizeof scene->views[i].offset);

    if (!state->schedule.config.picture.rolling_shutter)
      scene->views[i].camera.shutter = (pags_shutter){0};

    double time = view->camera.time;
    if (!isfinite(time))
      continue;
    scene->time_begin = i == 0 ? time : fmin(scene->time_begin, time);
    scene->time_end = i == 0 ? time : fmax(scene->time_end, time);
  }
  for (int64_t i = 0; i < scene->view_count; i++) {
    pags_scene_view *v = &scene->views[i];
    if (v->test && pags_dataset_fps(dataset) > 0)
      pags_scene_exposure(scene, v->sensor, v->camera.time, v->gain, v->offset);
  }
  return PAGS_OK;
}

/* Adds a model to the scene. If `file` is NULL, its file is named after `name`, the object's name. */
static pags_result add_model(pags_scene *scene, const char *name, const char *file, const pags_gaussians *g) {
  pags_model *model = &scene->models[scene->model_count];
  *model = (pags_model){.name = borrow(name), .gaussians = *g};
  model->file = file ? pags_text_copy(file) : pags_scene_model_file(scene, name);
  scene->model_count++;
  return model->file ? PAGS_OK : pags_out_of_memory("the name of a model");
}

static pags_result add_background(const pags_train_state *state, pags_described *d) {
  static const char *const names[] = {"background-sh0", "background-sh1", "background-sh2"};
  static const char *const files[] = {"background-sh0.ply", "background-sh1.ply", "background-sh2.ply"};
  const pags_gaussians *g = &state->models[0].gaussians;
  int count = 0;
  if (!d->by_degree)
    return add_model(&d->scene, "background", "background.ply", g);

  /* Split the background's rows by the degree they need, highest first, since all rows of a PLY have the same
   * degree. */
  int64_t *index = malloc((size_t)(g->count > 0 ? g->count : 1) * sizeof *index);
  pags_result result = index ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)g->count);
  for (int degree = g->sh_degree; degree >= 0 && result == PAGS_OK; degree--) {
    int64_t rows = 0;
    for (int64_t i = 0; i < g->count; i++)
      if (pags_gaussians_row_degree(g, i) == degree)
        index[rows++] = i;
    if (rows == 0 && (degree > 0 || count > 0))
      continue;
    pags_gaussians *part = &d->parts[count++];
    result = pags_gaussians_create_like(part, rows, g);
    if (result == PAGS_OK)
      pags_gaussians_gather(g, index, rows, part);
    part->sh_degree = degree; /* the planes of higher degrees come last and hold zeros */
  }
  free(index);
  PAGS_TRY(result);

  for (int i = 0; i < count; i++) {
    const int degree = d->parts[i].sh_degree;
    PAGS_TRY(i == 0 ? add_model(&d->scene, "background", "background.ply", &d->parts[i])
                    : add_model(&d->scene, names[degree], files[degree], &d->parts[i]));
  }
  return PAGS_OK;
}

static int highest_degree(const pags_gaussians *g) {
  int most = 0;
  for (int64_t i = 0; i < g->count && most < g->sh_degree; i++) {
    int degree = pags_gaussians_row_degree(g, i);
    most = degree > most ? degree : most;
  }
  return most;
}

/* Lists the models of the scene, whose Gaussians remain the state's; only the file names (and the background's parts
 * by degree) are newly allocated. */
static pags_result list_models(const pags_train_state *state, pags_described *d) {
  pags_scene *scene = &d->scene;
  scene->models = calloc((size_t)state->model_count + 3, sizeof *scene->models);
  if (!scene->models)
    return pags_out_of_memory("%lld models", (long long)state->model_count);
  PAGS_TRY(add_background(state, d));
  for (int64_t i = 1; i < state->model_count; i++) {
    const pags_train_model *m = &state->models[i];
    pags_gaussians g = m->gaussians;
    if (d->by_degree)
      g.sh_degree = highest_degree(&g);
    scene->objects[m->object].model = scene->model_count;
    PAGS_TRY(add_model(scene, state->tracks.objects[m->object].id, NULL, &g));
  }
  return PAGS_OK;
}

/* ---- Describing and writing ---- */

void pags_described_destroy(pags_described *d) {
  if (!d)
    return;
  for (int64_t i = 0; i < d->scene.model_count; i++)
    free(d->scene.models[i].file);
  for (int i = 0; i < 4; i++)
    pags_gaussians_destroy(&d->parts[i]);
  free(d->scene.models);
  free(d->scene.objects);
  free(d->scene.views);
  free(d->scene.block);
  free(d->scene.notes);
  free(d);
}

/* Describes the scene to write. `d` must be destroyed on failure, too, and must not be moved, since the scene points
 * into it. */
static pags_result describe(const pags_dataset *dataset, const pags_train_state *state, pags_described *d) {
  const pags_train_config *config = &state->schedule.config;
  pags_scene *scene = &d->scene;
  pags_config_write_json(config, d->config);
  *scene = (pags_scene){.up = pags_dataset_up(dataset),
                        .antialiased = config->picture.antialiased,
                        .seed = config->schedule.seed,
                        .dataset = borrow(pags_dataset_path(dataset)),
                        .colmap = borrow(pags_dataset_colmap(dataset)),
                        .image_folder = borrow(pags_dataset_image_folder(dataset)),
                        .image_alpha = (int)pags_dataset_image_alpha(dataset),
                        .config = d->config,
                        .iterations = state->step * state->schedule.batch,
                        .fps = pags_dataset_fps(dataset),
                        .place = pags_dataset_place(dataset),
                        .sky = state->sky.sky};
  for (int k = 0; k < 3; k++) {
    scene->origin[k] = pags_dataset_origin(dataset)[k];
    scene->background[k] = (float)config->picture.background[k];
  }
  PAGS_TRY(pags_output_list_views(dataset, state, scene));

  /* The objects. */
  scene->object_count = state->tracks.count;
  scene->objects = calloc((size_t)(scene->object_count > 0 ? scene->object_count : 1), sizeof *scene->objects);
  if (!scene->objects)
    return pags_out_of_memory("%lld objects", (long long)scene->object_count);
  for (int64_t i = 0; i < scene->object_count; i++)
    scene->objects[i] = (pags_scene_object){.record = state->tracks.objects[i],
                                            .model = -1,
                                            .critical = pags_dataset_object_is_critical(dataset, i),
                                            .rigid = 1};

  const pags_block *block = pags_dataset_block(dataset);
  if (block && !(scene->block = pags_text_format("{\"split\": \"%s\", \"number\": %d, \"count\": %d}", block->split,
                                                 block->number, block->count)))
    return pags_out_of_memory("the description of a scene");

  PAGS_TRY(list_models(state, d));
  return pags_model_report_write(dataset, state, &scene->notes);
}

/* Creates the description of the current scene. */
static pags_result create(const pags_dataset *dataset, const pags_train_state *state, bool by_degree,
                          pags_described **out) {
  pags_described *d = calloc(1, sizeof *d);
  *out = NULL;
  if (!d)
    return pags_out_of_memory("the description of a scene");
  d->by_degree = by_degree;
  const pags_result result = describe(dataset, state, d);
  if (result == PAGS_OK)
    *out = d;
  else
    pags_described_destroy(d);
  return result;
}

pags_result pags_output_describe(const pags_dataset *dataset, const pags_train_state *state, pags_described **out) {
  return create(dataset, state, false, out);
}

const pags_scene *pags_described_scene(const pags_described *d) {
  return &d->scene;
}

pags_result pags_output_scene(const pags_output *output, const pags_dataset *dataset, const pags_train_state *state) {
  pags_described *d;
  PAGS_TRY(create(dataset, state, state->schedule.config.size_limit.sh_error > 0.0, &d));
  const pags_result result = pags_scene_write(output->folder, &d->scene);
  pags_described_destroy(d);
  return result;
}

pags_result pags_output_bytes(const pags_dataset *dataset, const pags_train_state *state, uint64_t *bytes) {
  pags_described *d;
  PAGS_TRY(create(dataset, state, false, &d));
  d->scene.dataset = d->scene.colmap = d->scene.image_folder =
      NULL; /* paths must not decide how many Gaussians a run has */
  for (int64_t i = 0; i < d->scene.model_count; i++)
    d->scene.models[i].gaussians.count = state->models[i].total; /* of which only the digits count here */
  const pags_result result = pags_scene_json_size(&d->scene, bytes);
  *bytes += d->scene.sky.size > 0 ? pags_sky_file_size(&d->scene.sky) : 0;
  pags_described_destroy(d);
  return result;
}
