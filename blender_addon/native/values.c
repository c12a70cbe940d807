/* SPDX-License-Identifier: Apache-2.0 */
/* Converts numbers and cameras from and to Python. */
#include "blender_addon/native/native.h"

#include <math.h>
#include <stdlib.h>

bool native_read_numbers(PyObject *value, const char *what, Py_ssize_t count, double *out) {
  Py_ssize_t length = PySequence_Check(value) ? PySequence_Size(value) : -1;
  if (length != count) {
    PyErr_Clear();
    PyErr_Format(PyExc_ValueError, "%s: expected %zd numbers", what, count);
    return false;
  }
  for (Py_ssize_t i = 0; i < count; i++) {
    PyObject *item = PySequence_GetItem(value, i);
    out[i] = item ? PyFloat_AsDouble(item) : 0;
    Py_XDECREF(item);
    if (PyErr_Occurred())
      return false;
  }
  return true;
}

static bool read_number(PyObject *dict, const char *key, double *out) {
  PyObject *value = PyMapping_GetItemString(dict, key);
  *out = value ? PyFloat_AsDouble(value) : 0;
  Py_XDECREF(value);
  if (!PyErr_Occurred())
    return true;
  PyErr_Clear();
  PyErr_Format(PyExc_ValueError, "camera: expected a number as \"%s\"", key);
  return false;
}

static bool read_size(PyObject *dict, const char *key, int *out) {
  double value;
  if (!read_number(dict, key, &value))
    return false;
  if (!(value >= 1 && value <= 65535)) {
    PyErr_Format(PyExc_ValueError, "camera: %s must be 1 to 65535 pixels", key);
    return false;
  }
  *out = (int)value;
  return true;
}

bool native_read_camera(PyObject *value, pags_camera *out) {
  *out = (pags_camera){.time = (double)NAN};
  if (!PyMapping_Check(value)) {
    PyErr_SetString(PyExc_TypeError, "camera: expected a dictionary");
    return false;
  }
  if (!read_size(value, "width", &out->width) || !read_size(value, "height", &out->height) ||
      !read_number(value, "fx", &out->fx) || !read_number(value, "fy", &out->fy) ||
      !read_number(value, "cx", &out->cx) || !read_number(value, "cy", &out->cy))
    return false;
  PyObject *pose = PyMapping_GetItemString(value, "world_from_camera");
  bool good = pose && native_read_numbers(pose, "camera: world_from_camera", 12, out->world_from_camera);
  Py_XDECREF(pose);
  if (!good)
    return false;
  return PyMapping_HasKeyString(value, "time") ? read_number(value, "time", &out->time) : true;
}

bool native_read_placements(PyObject *value, pags_placement **out, int64_t *count) {
  const Py_ssize_t size = PySequence_Size(value);
  if (size < 0)
    return false;
  *out = calloc((size_t)size + 1, sizeof **out);
  if (!*out) {
    PyErr_NoMemory();
    return false;
  }
  *count = size;
  for (Py_ssize_t i = 0; i < size; i++) {
    PyObject *item = PySequence_GetItem(value, i), *object = item ? PySequence_GetItem(item, 0) : NULL;
    PyObject *pose = object ? PySequence_GetItem(item, 1) : NULL;
    if (pose) {
      (*out)[i].object = PyLong_AsLongLong(object);
      if (!PyErr_Occurred())
        native_read_numbers(pose, "placements: world_from_object", 12, (*out)[i].world_from_object);
    }
    Py_XDECREF(pose);
    Py_XDECREF(object);
    Py_XDECREF(item);
    if (PyErr_Occurred())
      return false;
  }
  return true;
}

bool native_put(PyObject *dict, const char *key, PyObject *value) {
  bool good = value && PyDict_SetItemString(dict, key, value) == 0;
  Py_XDECREF(value);
  return good;
}

PyObject *native_numbers(const double *values, Py_ssize_t count) {
  PyObject *tuple = PyTuple_New(count);
  for (Py_ssize_t i = 0; tuple && i < count; i++)
    PyTuple_SetItem(tuple, i, PyFloat_FromDouble(values[i]));
  return tuple;
}

PyObject *native_camera_dict(const pags_camera *camera) {
  PyObject *dict = PyDict_New();
  bool good = dict && native_put(dict, "width", PyLong_FromLong(camera->width)) &&
              native_put(dict, "height", PyLong_FromLong(camera->height)) &&
              native_put(dict, "fx", PyFloat_FromDouble(camera->fx)) &&
              native_put(dict, "fy", PyFloat_FromDouble(camera->fy)) &&
              native_put(dict, "cx", PyFloat_FromDouble(camera->cx)) &&
              native_put(dict, "cy", PyFloat_FromDouble(camera->cy)) &&
              native_put(dict, "world_from_camera", native_numbers(camera->world_from_camera, 12)) &&
              (isnan(camera->time) || native_put(dict, "time", PyFloat_FromDouble(camera->time)));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
}
