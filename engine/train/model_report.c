/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the report of a run's modelling choices as JSON; see stages.h. */
#include "train/stages.h"

#include "base/json.h"
#include "base/vec3.h"

static void put_object(pags_json_writer *w, const pags_train_state *s, const pags_scene *scene, int64_t object) {
  const pags_object *o = &s->tracks.objects[object];
  const bool asked = s->schedule.config.objects.objects;
  int64_t model = -1;
  for (int64_t i = 1; i < s->model_count; i++)
    if (s->models[i].object == object)
      model = i;
  pags_json_begin_object(w, NULL);
  pags_json_put_string(w, "id", o->id);
  pags_json_put_bool(w, "modelled", model >= 0);
  pags_json_put_string(w, "why",
                       !o->moving   ? "parked: part of the background"
                       : model >= 0 ? "moves"
                       : asked      ? "moves, but nothing was found to start from"
                                    : "objects switched off");
  if (model >= 0) {
    const pags_train_model *m = &s->models[model];

    /* Mean length of a track's trained increments: how far smoothing and training moved the labelled poses. */
    double metres = 0.0, radians = 0.0;
    int64_t keyframes = 0;
    for (int64_t k = 0; k < o->keyframe_count; k++) {
      const pags_keyframe *n = &o->keyframes[k];
      if (!n->trained)
        continue;
      metres += pags_length3(n->translation);
      radians += pags_length3(n->rotation);
      keyframes++;
    }
    pags_json_put_number(w, "mean_shift_metres", keyframes > 0 ? metres / (double)keyframes : 0.0);
    pags_json_put_number(w, "mean_turn_degrees", keyframes > 0 ? radians / (double)keyframes * 57.29577951308232 : 0.0);

    pags_json_put_integer(w, "sh_degree", scene->models[scene->objects[object].model].gaussians.sh_degree);
    pags_json_put_bool(w, "fourier", m->gaussians.fourier != NULL);
    pags_json_put_number(w, "fourier_promised_db", m->fourier_gain); /* null before it is decided */
  }
  pags_json_end_object(w);
}

/* ---- Decisions ---- */

/* The reason by a test. The poses of a capture are looked at even if they aren't corrected. */
static const char *why_tested(pags_train_decision part, const pags_holdout_test *test, bool asked) {
  static const char *const reasons[][2] = {
      [PAGS_DECISION_EXPOSURE] = {"photographs differ in exposure", "photographs hardly differ in exposure"},
      [PAGS_DECISION_POSES] = {"photographs kept out are drawn better", "photographs kept out are not drawn better"},
      [PAGS_DECISION_LIGHT] = {"photographs kept out are drawn better", "photographs kept out are not drawn better"}};
  return test->state == PAGS_HOLDOUT_RUNNING             ? "the holdout test is running"
         : isnan(test->gain)                             ? "too few photographs for a holdout test"
         : !asked && pags_holdout_pays(test, part, true) ? "poses look inexact; camera_poses=1 corrects them"
                                                         : reasons[part][test->state == PAGS_HOLDOUT_FAILED];
}

/* Begins the entry of a part: whether it is modelled, why, and the bytes that it takes in the scene folder, or that
 * leaving it out saves. */
static void begin(pags_json_writer *w, const char *key, bool modelled, const char *why, int64_t bytes) {
  pags_json_begin_object(w, key);
  pags_json_put_bool(w, "modelled", modelled);
  pags_json_put_string(w, "why", why);
  pags_json_put_integer(w, modelled ? "bytes" : "bytes_saved", bytes);
}

/* Begins the entry of a correction, with the result of its holdout test. `untested`: the reason without a test. */
static pags_result begin_correction(pags_json_writer *w, pags_train_decision part, const pags_dataset *dataset,
                                    const pags_train_state *s, const pags_scene *scene, bool modelled,
                                    const pags_holdout_test *test, const char *untested) {
  int64_t bytes = s->costs.saved[part];
  if (modelled)
    PAGS_TRY(pags_decision_bytes(part, dataset, scene, &bytes));
  begin(w, pags_decision_name(part), modelled,
        test->state == PAGS_HOLDOUT_NONE
            ? untested
            : why_tested(part, test, part != PAGS_DECISION_POSES || s->schedule.config.cameras.camera_poses),
        bytes);
  if (test->state != PAGS_HOLDOUT_NONE && isfinite(test->gain)) {
    pags_json_put_number(w, "gain_db", test->gain);
    pags_json_put_number(w, "standard_error_db", test->uncertain);
    pags_json_put_number(w, "least_gain_db", pags_holdout_least_gain(pags_dataset_fps(dataset) <= 0.0));
  }
  return PAGS_OK;
}

/* The sky: that of driving sets by the share of the photographs' pixels that it has. Others have none; what it would
 * show is drawn by Gaussians, or shows the background: `uncovered`, of the photographs of a holdout test. */
static pags_result put_sky(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s) {
  const bool driving = pags_dataset_fps(dataset) > 0.0, modelled = s->sky.sky.size > 0;
  const bool cut_out =
      pags_dataset_alpha_count(dataset) > 0 && pags_dataset_image_alpha(dataset) == PAGS_ALPHA_COMPOSITE;
  uint64_t bytes;
  PAGS_TRY(pags_sky_file_size(&s->sky.sky, &bytes));
  begin(w, "sky", modelled,
        !driving                      ? cut_out ? "photographs are transparent there and show the background colour"
                                                : "captures have no sky labels; Gaussians show what is far"
        : !s->schedule.config.sky.sky ? "switched off"
        : s->sky.fixed                ? "it is that of the whole recording"
        : modelled                    ? "training photographs show it"
                                      : "less than a thousandth of the training pixels shows it",
        (int64_t)bytes);
  if (modelled)
    pags_json_put_integer(w, "texels", s->sky.sky.size);
  if (driving)
    pags_json_put_number(w, "share_of_pixels", s->sky_share);
  else if (s->costs.uncovered > 0.0)
    pags_json_put_number(w, "share_of_background", s->costs.uncovered);
  pags_json_end_object(w);
  return PAGS_OK;
}

static pags_result put_exposure(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s,
                                const pags_scene *scene) {
  PAGS_TRY(begin_correction(w, PAGS_DECISION_EXPOSURE, dataset, s, scene, s->exposures.count > 0, &s->exposures.holdout,
                            s->exposures.count == 0       ? "switched off"
                            : pags_dataset_block(dataset) ? "the blocks of a recording have one mean exposure"
                                                          : "switched on"));
  pags_json_end_object(w);
  return PAGS_OK;
}

/* Up to which SH degree colours depend on the view, and what that is worth. Bytes are saved compared with the degree of
 * training for all Gaussians; with that of a capture, if the photographs have one colour. */
static void put_sh(pags_json_writer *w, const pags_train_state *s, const pags_scene *scene) {
  const int trained = s->schedule.config.color.sh_degree;
  const bool one_colour = trained == 0 && s->one_colour;
  int degree = 0;
  int64_t terms = 0, all = 0;
  for (int64_t i = 0; i < scene->model_count; i++) {
    const pags_gaussians *g = &scene->models[i].gaussians;
    degree = g->sh_degree > degree ? g->sh_degree : degree;
    terms += g->count * (pags_plane_count(g->sh_degree) - pags_plane_count(0));
    all += g->count * (pags_plane_count(one_colour ? 3 : trained) - pags_plane_count(0));
  }
  begin(w, "sh", degree > 0,
        one_colour     ? "the photographs have one colour"
        : trained == 0 ? "switched off"
        : !s->sh.made  ? "all Gaussians keep the degree of training"
        : degree == 0  ? "training photographs are drawn as well without"
                       : "training photographs are drawn better",
        4 * (degree > 0 ? terms : all));
  pags_json_put_integer(w, "degree", degree);
  if (degree > 0)
    pags_json_put_integer(w, "bytes_saved", 4 * (all - terms));
  if (s->sh.made) {
    pags_json_put_number(w, "gain_db", s->sh.gain);
    pags_json_put_number(w, "loss_db", s->sh.loss);
  }
  pags_json_end_object(w);
}

/* Whether camera poses are corrected, what that brought on photographs kept out, and how far they moved. */
static pags_result put_cameras(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s,
                               const pags_scene *scene) {
  const pags_camera_poses *p = &s->cameras;
  double metres = 0.0, radians = 0.0;
  PAGS_TRY(begin_correction(w, PAGS_DECISION_POSES, dataset, s, scene, p->count > 0, &p->holdout,
                            pags_dataset_fps(dataset) <= 0.0 ? "captures keep their poses; camera_poses=1 corrects them"
                            : pags_dataset_block(dataset)    ? "the blocks of a recording keep its poses"
                                                             : "switched off"));
  for (int64_t i = 0; i < p->count; i++) {
    const pags_camera camera = pags_camera_poses_view(p, dataset, i);
    double correction[6];
    pags_camera_poses_correction(pags_dataset_view(dataset, i), &camera, correction);
    metres += pags_length3(correction + 3) / (double)p->count;
    radians += pags_length3(correction) / (double)p->count;
  }
  if (p->count > 0) {
    pags_json_put_number(w, p->alone ? "mean_shift" : "mean_shift_metres", metres); /* a capture has units of its own */
    pags_json_put_number(w, "mean_turn_degrees", radians * 57.29577951308232);
  }
  if (p->count > 0 && !p->alone) {
    pags_json_begin_array(w, "delays_seconds"); /* of the cameras, in the order in which views first have them */
    for (int64_t k = 0; k < p->sensors; k++)
      pags_json_put_number(w, NULL, p->items[p->steps + p->sensors + k].value[0]);
    pags_json_end_array(w);
  }
  pags_json_end_object(w);
  return PAGS_OK;
}

static pags_result put_light(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s,
                             const pags_scene *scene) {
  PAGS_TRY(begin_correction(w, PAGS_DECISION_LIGHT, dataset, s, scene, s->photometry.count > 0, &s->photometry.holdout,
                            pags_dataset_fps(dataset) <= 0.0 ? "only the cameras of a rig are calibrated"
                            : pags_dataset_block(dataset)    ? "the blocks of a recording keep its light"
                                                             : "switched off"));
  pags_json_end_object(w);
  return PAGS_OK;
}

/* What only driving sets have. */
static void put_drive(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s,
                      const pags_scene *scene) {
  pags_json_put_bool(w, "track_optimisation", s->schedule.config.objects.tracks);
  pags_json_put_integer(w, "lidar_points", s->lidar_points);
  pags_json_begin_array(w, "objects");
  for (int64_t i = 0; i < s->tracks.count; i++)
    put_object(w, s, scene, i);
  pags_json_end_array(w);
  pags_json_begin_array(w, "data");
  for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
    pags_json_put_string(w, NULL, pags_dataset_note(dataset, i));
  pags_json_end_array(w);
}

pags_result pags_model_report_write(const pags_dataset *dataset, const pags_train_state *s, const pags_scene *scene,
                                    char **text) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  PAGS_TRY(put_sky(&w, dataset, s));
  PAGS_TRY(put_exposure(&w, dataset, s, scene));
  put_sh(&w, s, scene);
  PAGS_TRY(put_cameras(&w, dataset, s, scene));
  PAGS_TRY(put_light(&w, dataset, s, scene));
  if (pags_dataset_fps(dataset) > 0.0)
    put_drive(&w, dataset, s, scene);
  pags_json_end_object(&w);
  PAGS_TRY(pags_json_writer_finish(&w));
  *text = pags_take(&w.data);
  return PAGS_OK;
}
