/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the scene folder of a training run: scene.json with cameras, objects and tracks, one or more PLYs per model,
 * the sky. */
#include "train/output.h"

#include "base/text.h"
#include "base/vec3.h"
#include "scene/scene_json.h"
#include "train/config.h"
#include "train/stages.h"

/* The scene to write, with the memory of its arrays. */
struct pags_described {
  pags_scene scene;
  char config[PAGS_CONFIG_TEXT];
  pags_gaussians parts[4]; /* once SH degrees are chosen: the background's Gaussians, by degree */
};

/* ---- Views and models ---- */

static char *borrow(const char *text) {
  return (char *)(uintptr_t)text;
}

pags_result pags_output_list_views(const pags_dataset *dataset, const pags_train_state *state, pags_scene *scene) {
  scene->view_count = pags_dataset_view_count(dataset);
  scene->views = calloc((size_t)(scene->view_count > 0 ? scene->view_count : 1), sizeof *scene->views);
  PAGS_CHECK_MEMORY(scene->views, "%lld views", (long long)scene->view_count);
  const bool between = pags_dataset_fps(dataset) <= 0 && pags_exposures_follow_names(&state->exposures, dataset);
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    pags_scene_view *const v = &scene->views[i];
    *v = (pags_scene_view){.name = borrow(view->name),
                           .camera = pags_camera_poses_view(&state->cameras, dataset, i),
                           .test = view->test,
                           .sensor = view->sensor,
                           .photometric = pags_photometry_of_sensor(&state->photometry, view->sensor),
                           .frame = view->frame};
    if (state->cameras.count > 0)
      pags_camera_poses_correction(view, &v->camera, v->correction);

    /* The exposure of the view; those of a driving set's held-out views are interpolated below. */
    double value[6] = {1.0, 1.0, 1.0, 0.0, 0.0, 0.0};
    if (state->exposures.count > 0 && !view->test)
      pags_exposures_value(&state->exposures, dataset, i, value);
    else if (between)
      pags_exposures_between(&state->exposures, dataset, i, value);
    pags_copy3(value, v->gain);
    pags_copy3(value + 3, v->offset);

    if (!state->schedule.config.picture.rolling_shutter)
      v->camera.shutter = (pags_shutter){0};

    const double time = view->camera.time;
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
  pags_model *model = &scene->models[scene->model_count++];
  *model = (pags_model){
      .name = borrow(name), .file = file ? pags_text_copy(file) : pags_scene_model_file(scene, name), .gaussians = *g};
  PAGS_CHECK_MEMORY(model->file, "the name of a model");
  return PAGS_OK;
}

static pags_result add_background(const pags_train_state *state, pags_described *d) {
  static const char *const names[] = {"background-sh0", "background-sh1", "background-sh2"};
  static const char *const files[] = {"background-sh0.ply", "background-sh1.ply", "background-sh2.ply"};
  const pags_gaussians *g = &state->models[0].gaussians;
  int count = 0;
  if (!state->sh.made)
    return add_model(&d->scene, "background", "background.ply", g);

  /* Split the background's rows by the degree they need, highest first, since all rows of a PLY have the same
   * degree. */
  PAGS_AUTOFREE int64_t *index = malloc((size_t)(g->count > 0 ? g->count : 1) * sizeof *index);
  PAGS_CHECK_MEMORY(index, "%lld Gaussians", (long long)g->count);
  for (int degree = g->sh_degree; degree >= 0; degree--) {
    int64_t rows = 0;
    for (int64_t i = 0; i < g->count; i++)
      if (pags_gaussians_row_degree(g, i) == degree)
        index[rows++] = i;
    if (rows == 0 && (degree > 0 || count > 0))
      continue;
    pags_gaussians *part = &d->parts[count];
    PAGS_TRY(pags_gaussians_create_like(part, rows, g));
    pags_gaussians_gather(g, index, rows, part);
    part->sh_degree = degree; /* the planes of higher degrees come last and hold zeros */
    PAGS_TRY(count++ == 0 ? add_model(&d->scene, "background", "background.ply", part)
                          : add_model(&d->scene, names[degree], files[degree], part));
  }
  return PAGS_OK;
}

/* Lists the models of the scene, whose Gaussians remain the state's; only the file names (and the background's parts
 * by degree) are newly allocated. */
static pags_result list_models(const pags_train_state *state, pags_described *d) {
  pags_scene *scene = &d->scene;
  scene->models = calloc((size_t)state->model_count + 3, sizeof *scene->models);
  PAGS_CHECK_MEMORY(scene->models, "%lld models", (long long)state->model_count);
  PAGS_TRY(add_background(state, d));
  for (int64_t i = 1; i < state->model_count; i++) {
    const pags_train_model *m = &state->models[i];
    pags_gaussians g = m->gaussians;
    int highest = state->sh.made ? 0 : g.sh_degree;
    for (int64_t row = 0; row < g.count && highest < g.sh_degree; row++) {
      const int degree = pags_gaussians_row_degree(&g, row);
      highest = degree > highest ? degree : highest;
    }
    g.sh_degree = highest; /* the planes of higher degrees come last and hold zeros */
    g.fourier_degree = highest < g.fourier_degree ? highest : g.fourier_degree;
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
  pags_copy3(pags_dataset_origin(dataset), scene->origin);
  pags_narrow3(config->picture.background, scene->background);
  PAGS_TRY(pags_output_list_views(dataset, state, scene));

  /* The objects. */
  scene->object_count = state->tracks.count;
  scene->objects = calloc((size_t)(scene->object_count > 0 ? scene->object_count : 1), sizeof *scene->objects);
  PAGS_CHECK_MEMORY(scene->objects, "%lld objects", (long long)scene->object_count);
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
  return pags_model_report_write(dataset, state, scene, &scene->notes);
}

pags_result pags_output_describe(const pags_dataset *dataset, const pags_train_state *state, pags_described **out) {
  *out = calloc(1, sizeof **out);
  PAGS_CHECK_MEMORY(*out, "the description of a scene");
  return describe(dataset, state, *out);
}

const pags_scene *pags_described_scene(const pags_described *d) {
  return &d->scene;
}

pags_result pags_output_scene(const pags_output *output, const pags_dataset *dataset, const pags_train_state *state) {
  PAGS_AUTO(pags_described_destroy_auto) pags_described *d = NULL;
  PAGS_TRY(pags_output_describe(dataset, state, &d));
  return pags_scene_write(output->folder, &d->scene);
}

pags_result pags_output_bytes(const pags_dataset *dataset, const pags_train_state *state, uint64_t *bytes) {
  PAGS_AUTO(pags_described_destroy_auto) pags_described *d = NULL;
  PAGS_TRY(pags_output_describe(dataset, state, &d));
  d->scene.dataset = d->scene.colmap = d->scene.image_folder =
      NULL; /* paths must not decide how many Gaussians a run has */
  for (int64_t i = 0; i < d->scene.model_count; i++)
    d->scene.models[i].gaussians.count = state->models[i].total; /* of which only the digits count here */
  return pags_scene_json_size(&d->scene, bytes);
}
