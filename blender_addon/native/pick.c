/* Picking: what is seen at a pixel. */
#include "job.h"

/* One number of a plane. */
static double sample(PyObject *picture, const char *plane) {
  PyObject *buffer = PyObject_GetAttrString(picture, plane);
  Py_buffer view;
  double value = 0;
  if (buffer && PyObject_GetBuffer(buffer, &view, PyBUF_FORMAT | PyBUF_ND) == 0) {
    value = view.format[0] == 'i' ? (double)*(const int32_t *)view.buf : (double)*(const float *)view.buf;
    PyBuffer_Release(&view);
  }
  Py_XDECREF(buffer);
  return value;
}

static PyObject *describe(native_scene *scene, const pags_camera *camera, double x, double y, PyObject *picture) {
  int32_t id = (int32_t)sample(picture, "id");
  double depth = sample(picture, "depth"), priority = sample(picture, "priority"), point[3], ray[3];
  if (id < 0 || depth <= 0)
    Py_RETURN_NONE;
  const double *m = camera->world_from_camera;
  ray[0] = (x + 0.5 - camera->cx) / camera->fx * depth;
  ray[1] = (y + 0.5 - camera->cy) / camera->fy * depth;
  ray[2] = depth;
  for (int k = 0; k < 3; ++k)
    point[k] = m[4 * k] * ray[0] + m[4 * k + 1] * ray[1] + m[4 * k + 2] * ray[2] + m[4 * k + 3];
  int32_t object = scene->object_of[id];
  PyObject *dict = PyDict_New(), *none = Py_None;
  Py_INCREF(none);
  bool good =
      dict && native_put(dict, "id", PyLong_FromLong(id)) && native_put(dict, "depth", PyFloat_FromDouble(depth)) &&
      native_put(dict, "priority", PyFloat_FromDouble(priority)) && native_put(dict, "point", native_numbers(point, 3));
  good = good && PyDict_SetItemString(dict, "object", none) == 0;
  Py_DECREF(none);
  good = good && (object < 0 || native_put(dict, "object", PyLong_FromLong(object)));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
}

/* The whole frame is drawn and one pixel of it kept: a camera of one pixel would bend Gaussians off its axis otherwise (the clamp of the
 * projection's Jacobian follows the picture's edges). */
PyObject *native_pick(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", "x", "y", "threads", WISH_NAMES, NULL};
  PyObject *scene, *camera, *result = NULL;
  native_state *state = PyModule_GetState(module);
  int threads = 0, x, y;
  pags_camera read;
  native_wishes w = native_default_wishes();
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOii|$i" WISH_FORMAT ":pick", names, &scene, &camera, &x, &y,
                                   &threads, WISH_TARGETS(w)))
    return NULL;
  if (!native_read_camera(camera, &read))
    return NULL;
  w.outputs = Py_BuildValue("(ssss)", "id", "depth", "priority", "object");
  w.window = Py_BuildValue("(iiii)", x, y, 1, 1);
  w.depth_empty = 0;
  w.depth_scale = 1;
  PyObject *picture = w.outputs && w.window ? native_render_once(state, scene, camera, &w, threads) : NULL;
  if (picture)
    result = describe((native_scene *)scene, &read, x, y, picture);
  Py_XDECREF(picture);
  Py_XDECREF(w.outputs);
  Py_XDECREF(w.window);
  return result;
}
