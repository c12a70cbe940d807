/* SPDX-License-Identifier: Apache-2.0 */
/* Picking: the Gaussian seen through a pixel, and the object that it belongs to. */
#include "blender_addon/native/job.h"

#include <pags/pick.h>

#include <math.h>

#include "base/vec3.h"

typedef struct found {
  pags_picked picked;
  float priority;
  int scene; /* which of the job's */
} found;

/* Clips a ray to the picture's clip planes. `origin` and `direction` as in pags_pick. */
static void clip_ray(const pags_frame_options *frame, const double origin[3], const double direction[3],
                     pags_pick_options *options) {
  for (int i = 0; i < frame->clip_count; i++) {
    const double *const p = frame->clips[i];
    const double at = pags_dot3(p, origin) + p[3], along = pags_dot3(p, direction);
    if (along > 0)
      options->nearest = fmax(options->nearest, -at / along);
    else if (along < 0)
      options->farthest = fmin(options->farthest, -at / along);
    else if (at < 0)
      options->farthest = -1; /* all of the ray is outside */
  }
}

/* Picks through a pixel and looks up scene, object and priority. Call with the job's scenes locked. */
static pags_result pick_locked(native_job *job, int x, int y, found *out) {
  pags_pick_options options = pags_pick_options_default();
  pags_picked *picked = &out->picked;
  double origin[3], direction[3];
  options.nearest = (double)job->options.near_plane;
  pags_copy3(job->options.origin, options.origin);

  /* The ray through the pixel, in world coordinates: a distance along this vector is a depth. */
  const pags_camera *const camera = &job->camera;
  double m[12], look[3] = {(x + 0.5 - camera->cx) / camera->fx, (y + 0.5 - camera->cy) / camera->fy, 1};
  if (pags_camera_bends(camera) && !pags_camera_look(camera, x + 0.5, y + 0.5, look))
    return PAGS_OK; /* outside of the lens's image circle */
  pags_rigid_move(camera->world_from_camera, camera->shutter.velocity, pags_camera_read_at(camera, x + 0.5, y + 0.5),
                  m);
  pags_pose_position(m, origin);
  pags_rotate3(m, look, direction);
  clip_ray(&job->options, origin, direction, &options);
  if (options.farthest < options.nearest)
    return PAGS_OK;
  PAGS_TRY(native_contents_compose(job, &job->contents));
  PAGS_TRY(pags_pick(job->contents.parts, job->contents.part_count, origin, direction, &options, picked));
  if (picked->part < 0)
    return PAGS_OK;
  const native_shown *shown = native_shown_of(job->contents.shown, job->contents.shown_count, &picked->id);
  native_scene *scene = (native_scene *)shown->scene;
  PAGS_TRY(native_scene_need_priorities(scene));
  out->scene = (int)(shown - job->contents.shown);
  out->priority = scene->priority_of[picked->id];
  picked->object = pags_composition_part_object(scene->composition, &job->contents.parts[picked->part]);
  return PAGS_OK;
}

PyObject *native_pick(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", "x", "y", "placements", "others", "clips", NULL};
  const native_state *state = PyModule_GetState(module);
  native_job_arguments w = native_default_job_arguments();
  PyObject *scene, *camera, *column, *row;
  found f = {.picked = {.part = -1}};
  pags_result result;
  long long x, y;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOOO|$OOO:pick", names, &scene, &camera, &column, &row,
                                   &w.placements, &w.others, &w.clips))
    return NULL;
  NATIVE_OWNED PyObject *object = native_job_new(state, scene, camera, &w);
  native_job *job = (native_job *)object;
  if (!job || !native_read_integer(column, "x", 0, job->camera.width - 1, &x) ||
      !native_read_integer(row, "y", 0, job->camera.height - 1, &y))
    return NULL;
  Py_BEGIN_ALLOW_THREADS native_job_lock(job, true);
  result = pick_locked(job, (int)x, (int)y, &f);
  native_job_lock(job, false);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) return native_raise(state, result);
  const pags_picked *p = &f.picked;
  if (p->part < 0)
    Py_RETURN_NONE;
  return Py_BuildValue("{s:i,s:d,s:d,s:N,s:N,s:i}", "id", (int)p->id, "depth", p->depth, "priority", (double)f.priority,
                       "point", native_numbers(p->point, 3), "object",
                       p->object < 0 ? Py_NewRef(Py_None) : PyLong_FromLongLong(p->object), "scene", f.scene);
}
