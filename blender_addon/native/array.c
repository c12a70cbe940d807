/* SPDX-License-Identifier: Apache-2.0 */
/* Reads arrays of numbers from Python: objects with the buffer protocol (numpy arrays, array.array, memoryview, Buffer)
 * directly from memory, and nested sequences item by item.
 *
 * Buffers are opened through the slots of their type, like CPython's PyObject_GetBuffer and PyBuffer_Release: these two
 * are in the limited API only from Python 3.11, and Windows' python3.dll of 3.10, included in Blender 3.4 to 4.0,
 * doesn't export them. */
#include "blender_addon/native/native.h"

#include <stdlib.h>
#include <string.h>

/* The destination: floats, or doubles if `wide`. */
typedef struct sink {
  void *data;
  Py_ssize_t at;
  bool wide;
} sink;

static void put(sink *s, double value) {
  if (s->wide)
    ((double *)s->data)[s->at++] = value;
  else
    ((float *)s->data)[s->at++] = (float)value;
}

/* ---- Shapes ---- */

static void write_shape(char *text, size_t room, int dimensions, const Py_ssize_t *shape) {
  size_t length = 0;
  text[0] = 0;
  for (int d = 0; d < dimensions && length + 24 < room; d++) {
    if (shape[d] < 0)
      strcpy(text + length, d == 0 ? "[n]" : "[k]");
    else
      PyOS_snprintf(text + length, room - length, "[%lld]", (long long)shape[d]);
    length += strlen(text + length);
  }
}

/* Raises that an array of `wanted` (-1: any) was expected; returns NULL. */
static void *refuse(const char *what, int dimensions, const Py_ssize_t *wanted, int found_dimensions,
                    const Py_ssize_t *found) {
  char expected[128], got[128];
  write_shape(expected, sizeof expected, dimensions, wanted);
  write_shape(got, sizeof got, found_dimensions, found);
  return PyErr_Format(PyExc_ValueError, "%s: expected numbers of shape %s, found %s", what, expected,
                      found_dimensions ? got : "no array");
}

static bool fits(int dimensions, const Py_ssize_t *wanted, int found_dimensions, const Py_ssize_t *found) {
  bool same = dimensions == found_dimensions;
  for (int d = 0; same && d < dimensions; d++)
    same = wanted[d] < 0 || wanted[d] == found[d];
  return same;
}

static void *allocate(int dimensions, const Py_ssize_t *shape, bool wide) {
  size_t bytes = wide ? sizeof(double) : sizeof(float);
  for (int d = 0; d < dimensions; d++)
    if (shape[d] && bytes > (size_t)PY_SSIZE_T_MAX / (size_t)shape[d])
      return PyErr_NoMemory();
    else
      bytes *= (size_t)shape[d];
  void *data = malloc(bytes + 1);
  return data ? data : PyErr_NoMemory();
}

/* ---- Buffers ---- */

typedef int (*opener)(PyObject *, Py_buffer *, int);
typedef void (*closer)(PyObject *, Py_buffer *);

static bool has_buffer(PyObject *value) {
  return PyType_GetSlot(Py_TYPE(value), Py_bf_getbuffer) != NULL;
}

/* Opens the buffer of a value, with strides and format; on failure returns false with Python's error set. */
static bool open_buffer(PyObject *value, Py_buffer *view) {
  const opener open = (opener)(size_t)PyType_GetSlot(Py_TYPE(value), Py_bf_getbuffer);
  return open(value, view, PyBUF_STRIDES | PyBUF_FORMAT) == 0;
}

/* Closes an open buffer; a zeroed one is allowed. */
static void close_buffer(Py_buffer *view) {
  NATIVE_OWNED PyObject *object = view->obj; /* NULL: the type requires no release */
  if (!object)
    return;
  const closer close = (closer)(size_t)PyType_GetSlot(Py_TYPE(object), Py_bf_releasebuffer);
  if (close)
    close(object, view);
  view->obj = NULL;
}

/* 'f' or 'd' if the buffer has floats or doubles in native byte order, else 0. */
static char float_kind(const Py_buffer *view) {
  const char *format = view->format ? view->format : "B";
  format += *format == '@' || *format == '=' || *format == '<';
  const bool single = format[0] == 'f' || format[0] == 'd';
  return single && !format[1] ? format[0] : 0;
}

static void copy(const Py_buffer *view, int dimension, const char *at, sink *s) {
  const Py_ssize_t count = view->shape[dimension], stride = view->strides[dimension];
  if (dimension + 1 < view->ndim) {
    for (Py_ssize_t i = 0; i < count; i++)
      copy(view, dimension + 1, at + i * stride, s);
    return;
  }
  const bool is_double = float_kind(view) == 'd';
  for (Py_ssize_t i = 0; i < count; i++) {
    double wide = 0;
    float narrow = 0;
    if (is_double)
      memcpy(&wide, at + i * stride, sizeof wide);
    else
      memcpy(&narrow, at + i * stride, sizeof narrow);
    put(s, is_double ? wide : (double)narrow);
  }
}

/* ---- Sequences ---- */

/* The lengths along the first items, at most `most`. Returns the number of dimensions, or -1 after raising. */
static int measure(PyObject *value, int most, Py_ssize_t *shape) {
  int dimensions = 0;
  PyObject *at = value;
  Py_INCREF(at);
  while (dimensions < most && PySequence_Check(at) && !PyUnicode_Check(at)) {
    shape[dimensions] = PySequence_Size(at);
    if (shape[dimensions] < 0)
      break;
    PyObject *first = shape[dimensions++] > 0 ? PySequence_GetItem(at, 0) : NULL;
    Py_DECREF(at);
    at = first;
    if (!at)
      break;
  }
  Py_XDECREF(at);
  return PyErr_Occurred() ? -1 : dimensions;
}

static bool walk(PyObject *value, const char *what, int dimensions, const Py_ssize_t *shape, sink *s) {
  if (dimensions == 0) {
    const double number = PyFloat_AsDouble(value);
    put(s, number);
    if (number != -1 || !PyErr_Occurred())
      return true;
    if (PyErr_ExceptionMatches(PyExc_TypeError)) {
      PyErr_Clear();
      PyErr_Format(PyExc_TypeError, "%s: expected numbers, found %.80R", what, value);
    }
    return false;
  }
  const Py_ssize_t length = PySequence_Check(value) && !PyUnicode_Check(value) ? PySequence_Size(value) : -1;
  if (length != shape[0])
    return PyErr_Format(PyExc_ValueError, "%s: expected sequences of the same length, %zd", what, shape[0]);
  for (Py_ssize_t i = 0; i < length; i++) {
    NATIVE_OWNED PyObject *item = PySequence_GetItem(value, i);
    if (!item || !walk(item, what, dimensions - 1, shape + 1, s))
      return false;
  }
  return true;
}

/* ---- Either ---- */

/* Reads from the buffer of a value if it has one of floats or doubles; *read: it has. */
static void *read_buffer(PyObject *value, const char *what, bool wide, int dimensions, Py_ssize_t *shape, bool *read) {
  PAGS_AUTO(close_buffer) Py_buffer view = {0};
  sink s = {.wide = wide};
  *read = true;
  if (!open_buffer(value, &view))
    return NULL;
  *read = float_kind(&view) != 0; /* integers and others: item by item */
  if (!*read)
    return NULL;
  if (!fits(dimensions, shape, view.ndim, view.shape))
    return refuse(what, dimensions, shape, view.ndim, view.shape);
  s.data = allocate(view.ndim, view.shape, wide);
  if (!s.data)
    return NULL;
  memcpy(shape, view.shape, (size_t)dimensions * sizeof *shape);
  if (view.len > 0)
    copy(&view, 0, view.buf, &s);
  return s.data;
}

void *native_read_array(PyObject *value, const char *what, bool wide, int dimensions, Py_ssize_t *shape) {
  Py_ssize_t found[NATIVE_DIMENSIONS + 1];
  bool read = false;
  void *const data = has_buffer(value) ? read_buffer(value, what, wide, dimensions, shape, &read) : NULL;
  if (read)
    return data;
  int found_dimensions = measure(value, NATIVE_DIMENSIONS + 1, found);
  if (found_dimensions < 0)
    return NULL;
  if (found_dimensions > 0 && found[found_dimensions - 1] == 0) /* the rest of a shape such as [] for [n][3] */
    for (; found_dimensions < dimensions; found_dimensions++)
      found[found_dimensions] = shape[found_dimensions] < 0 ? 1 : shape[found_dimensions];
  if (!fits(dimensions, shape, found_dimensions, found))
    return refuse(what, dimensions, shape, found_dimensions, found);
  PAGS_AUTOFREE void *values = allocate(dimensions, found, wide);
  if (!values || !walk(value, what, dimensions, found, &(sink){.data = values, .wide = wide}))
    return NULL;
  memcpy(shape, found, (size_t)dimensions * sizeof *shape);
  return pags_take(&values);
}

int native_array_dimensions(PyObject *value) {
  Py_ssize_t found[NATIVE_DIMENSIONS + 1];
  PAGS_AUTO(close_buffer) Py_buffer view = {0};
  if (!has_buffer(value))
    return measure(value, NATIVE_DIMENSIONS + 1, found);
  return open_buffer(value, &view) ? view.ndim : -1;
}
