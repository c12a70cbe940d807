/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the report of a run's modelling choices as JSON; see stages.h. */
#include "train/stages.h"

#include "base/json.h"
#include "base/vec3.h"

static void put_object(pags_json_writer *w, const pags_train_state *s, int64_t object) {
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

    pags_json_put_bool(w, "fourier", m->gaussians.fourier != NULL);
    pags_json_put_number(w, "fourier_promised_db", m->fourier_gain); /* null before it is decided */
  }
  pags_json_end_object(w);
}

/* Whether something passed its holdout test, and its gain. */
static void put_holdout_test(pags_json_writer *w, const pags_holdout_test *test) {
  pags_json_put_string(w, "why",
                       test->state == PAGS_HOLDOUT_RUNNING  ? "the holdout test is running"
                       : test->state == PAGS_HOLDOUT_PASSED ? "photographs kept out are drawn better"
                                                            : "photographs kept out are not drawn better");
  if (isfinite(test->gain)) {
    pags_json_put_number(w, "gain_db", test->gain);
    pags_json_put_number(w, "standard_error_db", test->uncertain);
  }
}

/* Whether camera poses are corrected, what that brought on photographs kept out, and how far they moved. */
static void put_cameras(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s) {
  const pags_camera_poses *p = &s->cameras;
  double metres = 0.0, radians = 0.0;
  if (p->holdout.state == PAGS_HOLDOUT_NONE)
    return;
  pags_json_begin_object(w, "camera_poses");
  pags_json_put_bool(w, "corrected", p->count > 0);
  put_holdout_test(w, &p->holdout);
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
}

/* Whether the sky is modelled, at which resolution, and why. */
static void put_sky(pags_json_writer *w, const pags_train_state *s) {
  pags_json_begin_object(w, "sky");
  pags_json_put_bool(w, "modelled", s->sky.sky.size > 0);
  pags_json_put_integer(w, "texels", s->sky.sky.size);
  pags_json_put_number(w, "share_of_pixels", s->sky_share);
  pags_json_put_string(w, "why",
                       !s->schedule.config.sky.sky ? "switched off"
                       : s->sky.fixed              ? "it is that of the whole recording"
                       : s->sky.sky.size > 0       ? "training photographs show it"
                                                   : "less than a thousandth of the training pixels shows it");
  pags_json_end_object(w);
}

/* What is modelled of a driving set. */
static void put_drive(pags_json_writer *w, const pags_dataset *dataset, const pags_train_state *s) {
  put_sky(w, s);
  pags_json_put_bool(w, "exposure", s->exposures.count > 0);
  put_cameras(w, dataset, s);
  if (s->photometry.holdout.state != PAGS_HOLDOUT_NONE) {
    pags_json_begin_object(w, "light");
    pags_json_put_bool(w, "fitted", s->photometry.count > 0);
    put_holdout_test(w, &s->photometry.holdout);
    pags_json_end_object(w);
  }
  pags_json_put_bool(w, "track_optimisation", s->schedule.config.objects.tracks);
  pags_json_put_integer(w, "lidar_points", s->lidar_points);
  pags_json_begin_array(w, "objects");
  for (int64_t i = 0; i < s->tracks.count; i++)
    put_object(w, s, i);
  pags_json_end_array(w);
  pags_json_begin_array(w, "data");
  for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
    pags_json_put_string(w, NULL, pags_dataset_note(dataset, i));
  pags_json_end_array(w);
}

pags_result pags_model_report_write(const pags_dataset *dataset, const pags_train_state *s, char **text) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  if (pags_dataset_fps(dataset) > 0.0)
    put_drive(&w, dataset, s);
  else {
    /* Up to which degree colours depend on the view. */
    const int degree = s->schedule.config.color.sh_degree;
    pags_json_begin_object(&w, "colour");
    pags_json_put_integer(&w, "sh_degree", degree);
    pags_json_put_string(&w, "why",
                         degree == 0 && s->one_colour ? "the photographs have one colour"
                         : degree == 3                ? "captures see a thing from all sides"
                                                      : "as asked for");
    pags_json_end_object(&w);
    pags_json_put_bool(&w, "exposure", s->exposures.count > 0);
    put_cameras(&w, dataset, s);
  }
  pags_json_end_object(&w);
  PAGS_TRY(pags_json_writer_finish(&w));
  *text = pags_take(&w.data);
  return PAGS_OK;
}
