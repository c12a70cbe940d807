/* SPDX-License-Identifier: Apache-2.0 */
/* Converts numbers, words, poses and placements from and to Python. Invalid values raise a TypeError or ValueError that
 * names the argument; non-finite numbers are always invalid. */
#include "blender_addon/native/native.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Single values ---- */

/* Replaces Python's error about a value, which doesn't name the argument. Others, such as KeyboardInterrupt, stay. */
static bool expected(PyObject *value, const char *what, const char *wanted) {
  PyObject *kind = PyExc_ValueError;
  if (PyErr_Occurred()) {
    if (PyErr_ExceptionMatches(PyExc_TypeError))
      kind = PyExc_TypeError;
    else if (!PyErr_ExceptionMatches(PyExc_ValueError) && !PyErr_ExceptionMatches(PyExc_OverflowError))
      return false;
    PyErr_Clear();
  }
  return PyErr_Format(kind, "%s: expected %s, found %.80R", what, wanted, value);
}

bool native_read_number(PyObject *value, const char *what, double least, double most, double *out) {
  char wanted[96];
  if (!value)
    return true;
  *out = PyFloat_AsDouble(value);
  if (!PyErr_Occurred() && *out >= least && *out <= most)
    return true;
  if (least <= -NATIVE_LARGEST && most >= NATIVE_LARGEST)
    snprintf(wanted, sizeof wanted, "a finite number");
  else if (most >= NATIVE_LARGEST)
    snprintf(wanted, sizeof wanted, "a finite number of at least %g", least);
  else
    snprintf(wanted, sizeof wanted, "a number from %g to %g", least, most);
  return expected(value, what, wanted);
}

bool native_read_finite(PyObject *value, const char *what, double *out) {
  return native_read_number(value, what, -NATIVE_LARGEST, NATIVE_LARGEST, out);
}

bool native_read_integer(PyObject *value, const char *what, long long least, long long most, long long *out) {
  char wanted[96];
  int overflow = 1;
  if (!value)
    return true;
  NATIVE_OWNED PyObject *index = PyNumber_Index(value);
  if (index) {
    *out = PyLong_AsLongLongAndOverflow(index, &overflow);
  } else if (PyErr_ExceptionMatches(PyExc_TypeError)) { /* accepts a float such as 640.0 */
    PyErr_Clear();
    const double number = PyFloat_AsDouble(value);
    overflow = PyErr_Occurred() || !(fabs(number) < 9e18) || number != floor(number);
    *out = overflow ? 0 : (long long)number;
  }
  if (!PyErr_Occurred() && !overflow && *out >= least && *out <= most)
    return true;
  if (most == LLONG_MAX)
    snprintf(wanted, sizeof wanted, "a whole number");
  else
    snprintf(wanted, sizeof wanted, "a whole number from %lld to %lld", least, most);
  return expected(value, what, wanted);
}

bool native_read_flag(PyObject *value, const char *what, bool *out) {
  if (!value)
    return true;
  const int yes = PyObject_RichCompareBool(value, Py_True, Py_EQ);
  const int no = yes == 0 ? PyObject_RichCompareBool(value, Py_False, Py_EQ) : 0;
  *out = yes > 0;
  return yes > 0 || no > 0 || expected(value, what, "True or False");
}

bool native_read_word(PyObject *value, const char *what, const char **out) {
  if (!value)
    return true;
  *out = PyUnicode_Check(value) ? PyUnicode_AsUTF8AndSize(value, NULL) : NULL;
  return *out || expected(value, what, "a string");
}

bool native_read_path(PyObject *value, const char *what, PyObject **bytes) {
  return PyUnicode_FSConverter(value, bytes) || expected(value, what, "a path");
}

PyObject *native_text(const char *text) {
  return PyUnicode_DecodeUTF8(text, (Py_ssize_t)strlen(text), "surrogateescape");
}

/* ---- Several ---- */

bool native_read_numbers(PyObject *value, const char *what, Py_ssize_t count, double *out) {
  Py_ssize_t length = PySequence_Check(value) ? PySequence_Size(value) : -1;
  if (length != count) {
    char wanted[48];
    snprintf(wanted, sizeof wanted, "%lld numbers", (long long)count);
    return expected(value, what, wanted);
  }
  for (Py_ssize_t i = 0; i < count; i++) {
    NATIVE_OWNED PyObject *item = PySequence_GetItem(value, i);
    if (!item || !native_read_finite(item, what, &out[i]))
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
  PAGS_AUTOFREE double *rows = native_read_array(value, what, true, 2, shape);
  if (!rows)
    return false;
  bool good = shape[0] == 3 || shape[0] == 4;
  for (int k = 0; good && shape[0] == 4 && k < 4; k++)
    good = fabs(rows[12 + k] - (k == 3)) < 1e-6;
  if (!good)
    return PyErr_Format(PyExc_ValueError, "%s: expected a matrix of 3 x 4, or of 4 x 4 whose last row is 0 0 0 1",
                        what);
  for (int k = 0; k < 12; k++)
    if (!isfinite(rows[k]))
      return PyErr_Format(PyExc_ValueError, "%s: expected finite numbers, found one that isn't in row %d", what, k / 4);
  memcpy(out, rows, 12 * sizeof *out);
  return true;
}

bool native_read_placements(PyObject *value, pags_placement **out, int64_t *count) {
  const Py_ssize_t size = PySequence_Check(value) ? PySequence_Size(value) : -1;
  if (size < 0)
    return expected(value, "placements", "a list of (object, world_from_object)");
  *out = calloc((size_t)size + 1, sizeof **out);
  if (!*out)
    return PyErr_NoMemory();
  *count = size;
  for (Py_ssize_t i = 0; i < size; i++) {
    NATIVE_OWNED PyObject *item = PySequence_GetItem(value, i);
    const bool pair = item && PySequence_Check(item) && PySequence_Size(item) == 2;
    NATIVE_OWNED PyObject *object = pair ? PySequence_GetItem(item, 0) : NULL;
    NATIVE_OWNED PyObject *pose = object ? PySequence_GetItem(item, 1) : NULL;
    long long number = 0;
    if (!pose)
      return item && expected(item, "placements", "pairs of object and world_from_object");
    if (!native_read_integer(object, "placements: object", -1, INT_MAX, &number) ||
        !native_read_pose(pose, "placements: world_from_object", (*out)[i].world_from_object))
      return false;
    (*out)[i].object = number;
  }
  return true;
}

PyObject *native_list(int64_t count, PyObject *(*item)(const void *context, int64_t index), const void *context) {
  NATIVE_OWNED PyObject *list = PyList_New((Py_ssize_t)count);
  for (int64_t i = 0; list && i < count; i++) {
    PyObject *own = item(context, i);
    if (!own)
      return NULL;
    PyList_SetItem(list, (Py_ssize_t)i, own);
  }
  return pags_take(&list);
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
