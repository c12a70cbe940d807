/* SPDX-License-Identifier: Apache-2.0 */
/* Converts numbers, poses and cameras from and to Python. */
#include "blender_addon/native/native.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

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

bool native_read_pose(PyObject *value, const char *what, double out[12]) {
  const int dimensions = native_array_dimensions(value);
  Py_ssize_t shape[2] = {-1, 4};
  if (dimensions < 0)
    return false;
  if (dimensions != 2)
    return native_read_numbers(value, what, 12, out);
  double *rows = native_read_array(value, what, true, 2, shape);
  if (!rows)
    return false;
  bool good = shape[0] == 3 || shape[0] == 4;
  for (int k = 0; good && shape[0] == 4 && k < 4; k++)
    good = fabs(rows[12 + k] - (k == 3)) < 1e-6;
  if (good)
    memcpy(out, rows, 12 * sizeof *out);
  else
    PyErr_Format(PyExc_ValueError, "%s: expected a matrix of 3 x 4, or of 4 x 4 whose last row is 0 0 0 1", what);
  free(rows);
  return good;
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
  bool good = pose && native_read_pose(pose, "camera: world_from_camera", out->world_from_camera);
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
        native_read_pose(pose, "placements: world_from_object", (*out)[i].world_from_object);
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
              (isnan(camera->time) || native_put(dict, "time", PyFloat_FromDouble(camera->time))) &&
              (!pags_camera_bends(camera) ||
               native_put(dict, "lens", PyUnicode_FromString(pags_lens_kind_name(camera->lens.kind))));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
}

/* ---- pags.camera ---- */

/* Takes focal lengths and principal point from K, in pixels. */
static bool read_intrinsics(PyObject *value, pags_camera *out) {
  Py_ssize_t shape[2] = {3, 3};
  double *k = native_read_array(value, "K", true, 2, shape);
  if (!k)
    return false;
  const bool good = k[1] == 0 && k[3] == 0 && k[6] == 0 && k[7] == 0 && k[8] == 1;
  if (good)
    out->fx = k[0], out->fy = k[4], out->cx = k[2], out->cy = k[5];
  else
    PyErr_SetString(PyExc_ValueError, "K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, without skew");
  free(k);
  return good;
}

/* Sets the pose from whichever of two matrices is given, in OpenCV's axes or OpenGL's (y up, z back). */
static bool read_extrinsics(PyObject *to_world, PyObject *to_camera, const char *axes, pags_camera *out) {
  const bool opengl = strcmp(axes, "opengl") == 0, inverse = to_world == Py_None;
  double pose[12];
  if (!opengl && strcmp(axes, "opencv") != 0) {
    PyErr_Format(PyExc_ValueError,
                 "axes: expected opencv (x right, y down, z forward) or opengl (y up, z back), found %s", axes);
    return false;
  }
  if ((to_world == Py_None) == (to_camera == Py_None)) {
    PyErr_SetString(PyExc_ValueError, "expected one of world_from_camera and camera_from_world");
    return false;
  }
  if (!native_read_pose(inverse ? to_camera : to_world, inverse ? "camera_from_world" : "world_from_camera", pose))
    return false;
  if (pags_rigid_check(pose, inverse ? "camera_from_world" : "world_from_camera") != PAGS_OK) {
    PyErr_SetString(PyExc_ValueError, pags_error_message());
    return false;
  }
  if (inverse)
    pags_rigid_inverse(pose, pose);
  for (int i = 0; opengl && i < 3; i++) {
    pose[4 * i + 1] = -pose[4 * i + 1];
    pose[4 * i + 2] = -pose[4 * i + 2];
  }
  memcpy(out->world_from_camera, pose, sizeof pose);
  return true;
}

PyObject *native_camera(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"width", "height", "K", "world_from_camera", "camera_from_world", "axes", "time", NULL};
  PyObject *intrinsics, *to_world = Py_None, *to_camera = Py_None, *time = Py_None;
  const char *axes = "opencv";
  pags_camera camera = {.time = (double)NAN};
  (void)module;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "iiO|O$OsO:camera", names, &camera.width, &camera.height,
                                   &intrinsics, &to_world, &to_camera, &axes, &time))
    return NULL;
  if (!read_intrinsics(intrinsics, &camera) || !read_extrinsics(to_world, to_camera, axes, &camera))
    return NULL;
  if (time != Py_None)
    camera.time = PyFloat_AsDouble(time);
  if (PyErr_Occurred())
    return NULL;
  if (pags_camera_check(&camera, "camera") == PAGS_OK)
    return native_camera_dict(&camera);
  PyErr_SetString(PyExc_ValueError, pags_error_message());
  return NULL;
}
