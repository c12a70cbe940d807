/* SPDX-License-Identifier: Apache-2.0 */
/* Picking: the Gaussian seen through a pixel, and the object that it belongs to. */
#include "blender_addon/native/job.h"

#include <pags/pick.h>

#include <math.h>
#include <string.h>

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
    const double at = p[0] * origin[0] + p[1] * origin[1] + p[2] * origin[2] + p[3];
    const double along = p[0] * direction[0] + p[1] * direction[1] + p[2] * direction[2];
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
  memcpy(options.origin, job->options.origin, sizeof options.origin);

  /* The ray through the pixel, in world coordinates: a distance along this vector is a depth. */
  const pags_camera *const camera = &job->camera;
  double m[12], look[3] = {(x + 0.5 - camera->cx) / camera->fx, (y + 0.5 - camera->cy) / camera->fy, 1};
  if (pags_camera_bends(camera) && !pags_camera_look(camera, x + 0.5, y + 0.5, look))
    return PAGS_OK; /* outside of the lens's image circle */
  pags_rigid_move(camera->world_from_camera, camera->shutter.velocity, pags_camera_read_at(camera, x + 0.5, y + 0.5),
                  m);
  for (int k = 0; k < 3; k++) {
    origin[k] = m[4 * k + 3];
    direction[k] = m[4 * k] * look[0] + m[4 * k + 1] * look[1] + m[4 * k + 2] * look[2];
  }

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

static PyObject *describe(const found *f) {
  const pags_picked *p = &f->picked;
  if (p->part < 0)
    Py_RETURN_NONE;
  PyObject *dict = PyDict_New();
  bool good = dict && native_put(dict, "id", PyLong_FromLong(p->id)) &&
              native_put(dict, "depth", PyFloat_FromDouble(p->depth)) &&
              native_put(dict, "priority", PyFloat_FromDouble((double)f->priority)) &&
              native_put(dict, "point", native_numbers(p->point, 3)) &&
              native_put(dict, "object", p->object < 0 ? Py_BuildValue("") : PyLong_FromLongLong(p->object)) &&
              native_put(dict, "scene", PyLong_FromLong(f->scene));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
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
  native_job *job = (native_job *)native_job_new(state, scene, camera, &w);
  if (!job)
    return NULL;
  if (!native_read_integer(column, "x", 0, job->camera.width - 1, &x) ||
      !native_read_integer(row, "y", 0, job->camera.height - 1, &y)) {
    Py_DECREF((PyObject *)job);
    return NULL;
  }
  Py_BEGIN_ALLOW_THREADS native_job_lock(job, true);
  result = pick_locked(job, (int)x, (int)y, &f);
  native_job_lock(job, false);
  Py_END_ALLOW_THREADS Py_DECREF((PyObject *)job);
  return result == PAGS_OK ? describe(&f) : native_raise(state, result);
}
