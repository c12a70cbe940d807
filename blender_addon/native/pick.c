/* SPDX-License-Identifier: Apache-2.0 */
/* Picking: the Gaussian seen through a pixel, and the object that it belongs to. */
#include "blender_addon/native/job.h"

#include <pags/pick.h>

typedef struct found {
  pags_picked picked;
  float priority;
} found;

/* Picks through a pixel and looks up the priority. Call with the scene's lock held. */
static pags_result pick_locked(native_scene *scene, const native_job *job, int x, int y, found *out) {
  pags_pick_options options = pags_pick_options_default();
  const pags_part *parts;
  double origin[3], direction[3];
  int count;
  options.nearest = (double)job->options.near_plane;

  /* The ray through the pixel, in world coordinates. */
  const double *m = job->camera.world_from_camera;
  double across = (x + 0.5 - job->camera.cx) / job->camera.fx, down = (y + 0.5 - job->camera.cy) / job->camera.fy;
  for (int k = 0; k < 3; k++) {
    origin[k] = m[4 * k + 3];
    direction[k] = m[4 * k] * across + m[4 * k + 1] * down +
                   m[4 * k + 2]; /* camera z is 1: a distance along this vector is a depth */
  }

  PAGS_TRY(native_scene_need_priorities(scene));
  PAGS_TRY(native_job_compose(scene, job, &parts, &count));
  PAGS_TRY(pags_composition_pick(scene->composition, parts, count, origin, direction, &options, &out->picked));
  out->priority = out->picked.part >= 0 ? scene->priority_of[out->picked.id] : 0;
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
              native_put(dict, "object", p->object < 0 ? Py_BuildValue("") : PyLong_FromLongLong(p->object));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
}

PyObject *native_pick(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", "x", "y", "placements", NULL};
  const native_state *state = PyModule_GetState(module);
  native_job_arguments w = native_default_job_arguments();
  PyObject *scene, *camera;
  found f = {.picked = {.part = -1}};
  pags_result result;
  int x, y;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOii|$O:pick", names, &scene, &camera, &x, &y, &w.placements))
    return NULL;
  native_job *job = (native_job *)native_job_new(state, scene, camera, &w);
  if (!job)
    return NULL;
  if (x < 0 || y < 0 || x >= job->camera.width || y >= job->camera.height) {
    PyErr_SetString(PyExc_ValueError, "pick: x and y must lie within the picture");
    Py_DECREF((PyObject *)job);
    return NULL;
  }
  native_scene *of = (native_scene *)scene;
  Py_BEGIN_ALLOW_THREADS pthread_mutex_lock(&of->lock);
  result = pick_locked(of, job, x, y, &f);
  pthread_mutex_unlock(&of->lock);
  Py_END_ALLOW_THREADS Py_DECREF((PyObject *)job);
  return result == PAGS_OK ? describe(&f) : native_raise(state, result);
}
