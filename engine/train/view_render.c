/* SPDX-License-Identifier: Apache-2.0 */
/* Renders a view for training: composes the parts that exist at its time; before a cluster in view is read, applies
 * its pending Adam steps (adam.c), evaluates colour over time and draws which Gaussians dropout leaves out. */
#include "train/view_render.h"

#include "base/vec3.h"
#include "port/port.h"
#include "train/dropout.h"
#include "train/run.h"

pags_result pags_view_render_create(pags_trainer *t) {
  pags_view_render *p = &t->render;
  const size_t models = (size_t)t->state.model_count, views = (size_t)pags_dataset_view_count(t->dataset);
  p->parts = calloc(models, sizeof *p->parts);
  p->drawn = calloc(models, sizeof *p->drawn);
  p->models = calloc(models, sizeof *p->models);
  p->depth = calloc(views, sizeof *p->depth);
  const int64_t floats = pags_tasks_workers(t->tasks) * pags_row_floats(&t->state.schedule.config);
  p->rows = malloc((size_t)floats * sizeof *p->rows);
  PAGS_CHECK_MEMORY(p->parts && p->drawn && p->models && p->depth && p->rows, "the parts of %lld models",
                    (long long)models);
  PAGS_TRY(pags_frame_create(t->tasks, &p->frame));
  return t->state.model_count > 1 ? pags_frame_create(t->tasks, &p->object_frame) : PAGS_OK;
}

void pags_view_render_destroy(pags_trainer *t) {
  pags_view_render *p = &t->render;
  pags_frame_destroy(p->frame);
  pags_frame_destroy(p->object_frame);
  for (int64_t i = 0; p->models && i < t->state.model_count; i++) {
    free(p->models[i].pose);
    pags_port_aligned_free(p->models[i].sh);
    pags_port_aligned_free(p->models[i].factor);
    pags_gradient_store_destroy(&p->models[i].held);
    pags_gradient_store_destroy(&p->models[i].sum);
  }
  for (int64_t i = 0; p->depth && i < pags_dataset_view_count(t->dataset); i++)
    free(p->depth[i].samples);
  for (int i = 0; i < PAGS_RENDER_PLANES; i++)
    pags_port_aligned_free(p->plane[i]);
  free(p->rows);
  free(p->emphasis);
  free(p->parts);
  free(p->drawn);
  free(p->models);
  free(p->depth);
  *p = (pags_view_render){0};
}

pags_result pags_view_render_reserve_factors(pags_trainer *t) {
  pags_view_render *p = &t->render;
  const pags_dropout dropout = pags_dropout_at(&t->state.schedule, p->photograph, -1);
  for (int i = 0; dropout.most > 0.0 && i < p->part_count; i++) {
    pags_model_room *const room = &p->models[p->drawn[i].model];
    const int64_t stride = t->state.models[p->drawn[i].model].gaussians.stride;
    if (stride > room->factor_room) {
      room->factor_room = 0;
      PAGS_CHECK_MEMORY(pags_floats_renew(&room->factor, stride), "the dropout of %lld Gaussians", (long long)stride);
      room->factor_room = stride;
    }
    p->parts[i].opacity_factor = room->factor;
    p->parts[i].opacity_factor_most = pags_dropout_boost(&dropout);
  }
  return PAGS_OK;
}

static void add_part(pags_trainer *t, int64_t model, int32_t first_id, int64_t keyframe,
                     const double world_from_model[12]) {
  pags_view_render *p = &t->render;
  const pags_train_model *m = &t->state.models[model];
  pags_part *part = &p->parts[p->part_count];
  *part =
      (pags_part){.gaussians = &m->gaussians, .clusters = &m->clusters, .first_id = first_id + (int32_t)m->first_row};
  memcpy(part->world_from_model, world_from_model, sizeof part->world_from_model);
  p->drawn[p->part_count].model = model;
  p->drawn[p->part_count++].keyframe = keyframe;
}

void pags_view_render_compose(pags_trainer *t, int64_t view) {
  const pags_view *v = pags_dataset_view(t->dataset, view);
  double pose[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  int32_t first_id = 0;
  t->render.part_count = 0;
  for (int64_t i = 0; i < t->state.model_count; first_id += (int32_t)t->state.models[i++].total) {
    const int64_t number = t->state.models[i].object;
    if (number < 0) {
      add_part(t, i, first_id, -1, pose);
      continue;
    }
    const pags_object *object = &t->state.tracks.objects[number];
    if (!pags_object_pose(object, v->camera.time, pose))
      continue;
    pags_pose_subtract(pose, pags_dataset_origin(t->dataset));
    const double begin = object->keyframes[0].time, end = object->keyframes[object->keyframe_count - 1].time;
    pags_fourier_basis(pags_fourier_phase(begin, end, v->camera.time), t->render.models[i].basis);
    add_part(t, i, first_id, pags_track_poses_keyframe(object, v->frame), pose);
    if (pags_camera_rolls(&v->camera))
      pags_object_velocity(object, v->camera.time, t->render.parts[t->render.part_count - 1].velocity);
  }
}

pags_camera pags_view_render_camera(const pags_trainer *t, int64_t view, double factor) {
  const pags_camera whole = pags_camera_poses_view(&t->state.cameras, t->dataset, view);
  pags_camera camera = pags_camera_downscale(&whole, factor);
  if (!t->state.schedule.config.picture.rolling_shutter)
    camera.shutter = (pags_shutter){0};
  return camera;
}

pags_frame_options pags_view_render_options(const pags_trainer *t, int64_t step) {
  const pags_train_config *c = &t->state.schedule.config;
  pags_frame_options o = pags_frame_options_default();
  for (int k = 0; k < 3; k++) {
    o.origin[k] = pags_dataset_origin(t->dataset)[k];
    o.background[k] = (float)c->picture.background[k];
  }
  o.near_plane = (float)c->picture.near_plane;
  o.low_pass = (float)c->picture.low_pass;
  o.antialiased = c->picture.antialiased;
  o.early_z = PAGS_EARLY_Z_OFF; /* the previous view says nothing about the next */
  o.sh_degree = pags_schedule_sh_degree(&t->state.schedule, step);
  o.sky = t->state.sky.sky.size > 0 ? &t->state.sky.sky : NULL;
  return o;
}

void pags_view_render_touch(void *user, int part, int64_t cluster, PAGS_UNUSED int worker) {
  const pags_render_context *c = user;
  const pags_view_render *const p = &c->trainer->render;
  const int64_t model = p->drawn[c->first_part + part].model;
  pags_train_model *m = &c->trainer->state.models[model];
  pags_adam_touch(&m->adam, &m->gaussians, cluster, c->step);

  /* The cluster's rows, padding included. */
  const int64_t first = cluster * m->clusters.size, end = first + m->clusters.size;
  const int64_t last = end < m->gaussians.stride ? end : m->gaussians.stride;
  if (m->gaussians.fourier)
    pags_fourier_colour(&m->gaussians, p->models[model].basis, first, last, p->models[model].sh);
  if (p->parts[c->first_part + part].opacity_factor) {
    pags_dropout dropout = pags_dropout_at(&c->trainer->state.schedule, p->photograph, m->object);
    dropout.first_row = m->first_row;
    pags_dropout_draw(&dropout, m->gaussians.s_sem, first, last - first, p->models[model].factor);
  }
}

pags_result pags_view_render_prepare(pags_trainer *t, int64_t step) {
  pags_view_render *const p = &t->render;
  for (int i = 0; i < p->part_count; i++) {
    pags_model_room *const room = &p->models[p->drawn[i].model];
    pags_train_model *const m = &t->state.models[p->drawn[i].model];

    /* Make room for the buffers of the model, whose sizes follow its number of clusters or Gaussians. */
    const int64_t clusters = m->clusters.count, stride = m->gaussians.stride;
    const bool posed = m->object >= 0 || t->state.cameras.count > 0;
    if (posed && clusters > room->pose_room) {
      free(room->pose);
      room->pose_room = 0;
      room->pose = calloc((size_t)(clusters + clusters / 2), sizeof *room->pose);
      PAGS_CHECK_MEMORY(room->pose, "pose gradients");
      room->pose_room = clusters + clusters / 2;
    }
    if (m->gaussians.fourier && room->sh_stride != stride) {
      const int planes = 3 * pags_sh_coefficients(m->gaussians.sh_degree);
      room->sh_stride = 0;
      PAGS_CHECK_MEMORY(pags_floats_renew(&room->sh, planes * stride), "colours over time");
      room->sh_stride = stride;
    }
    p->parts[i].sh = m->gaussians.fourier ? room->sh : NULL;
    pags_adam_begin(&m->adam, step);
  }
  return PAGS_OK;
}

pags_result pags_view_render_draw(pags_trainer *t, int64_t step, const pags_camera *camera,
                                  const pags_frame_options *options, pags_picture *picture) {
  pags_render_context context = {t, step, 0};
  PAGS_TRY(pags_view_render_prepare(t, step));
  return pags_frame_render(t->render.frame, t->render.parts, t->render.part_count, camera, options,
                           pags_view_render_touch, &context, picture);
}
