/* SPDX-License-Identifier: Apache-2.0 */
/* Buffer: a read-only view of the engine's memory for Python, without a copy. */
#include "blender_addon/native/native.h"

#include <stdlib.h>
#include <string.h>

enum { MAX_DIMENSIONS = 3 };

typedef struct native_buffer {
  PyObject_HEAD PyObject *owner; /* owner of `data`; NULL: the buffer frees `data` */
  void *data;
  char format[2];
  int dimensions;
  Py_ssize_t item, shape[MAX_DIMENSIONS], strides[MAX_DIMENSIONS];
} native_buffer;

static PyObject *create(const native_state *state, PyObject *owner, void *data, char format, int dimensions,
                        const Py_ssize_t *shape) {
  native_buffer *self = native_allocate(state->types[BUFFER_TYPE]);
  if (!self)
    return NULL;
  Py_XINCREF(owner);
  self->owner = owner;
  self->data = data;
  self->format[0] = format;
  self->dimensions = dimensions;
  self->item = format == 'd' || format == 'q' ? 8 : format == 'B' ? 1 : 4;
  Py_ssize_t stride = self->item;
  for (int d = dimensions - 1; d >= 0; d--) {
    self->shape[d] = shape[d];
    self->strides[d] = stride;
    stride *= shape[d];
  }
  return (PyObject *)self;
}

PyObject *native_buffer_new(const native_state *state, PyObject *owner, const void *data, char format, int dimensions,
                            const Py_ssize_t *shape) {
  return create(state, owner, (void *)(size_t)data, format, dimensions, shape);
}

PyObject *native_buffer_own(const native_state *state, void *data, char format, int dimensions,
                            const Py_ssize_t *shape) {
  PyObject *self = create(state, NULL, data, format, dimensions, shape);
  if (!self)
    free(data);
  return self;
}

static void buffer_dealloc(PyObject *object) {
  native_buffer *self = (native_buffer *)object;
  if (self->owner)
    Py_DECREF(self->owner);
  else
    free(self->data);
  native_deallocate(object);
}

static int buffer_get(PyObject *object, Py_buffer *view, int flags) {
  native_buffer *self = (native_buffer *)object;
  if (flags & PyBUF_WRITABLE) {
    PyErr_SetString(PyExc_BufferError, "pictures of the engine are read-only; copy them");
    return -1;
  }
  *view = (Py_buffer){.buf = self->data, .itemsize = self->item, .readonly = 1, .ndim = self->dimensions};
  view->len = self->item;
  for (int d = 0; d < self->dimensions; d++)
    view->len *= self->shape[d];
  view->format = flags & PyBUF_FORMAT ? self->format : NULL;
  view->shape = flags & PyBUF_ND ? self->shape : NULL;
  view->strides = (flags & PyBUF_STRIDES) == PyBUF_STRIDES ? self->strides : NULL;
  view->obj = Py_NewRef(object);
  return 0;
}

static PyObject *buffer_shape(PyObject *object, PAGS_UNUSED void *closure) {
  native_buffer *self = (native_buffer *)object;
  PyObject *shape = PyTuple_New(self->dimensions);
  for (int d = 0; shape && d < self->dimensions; d++)
    PyTuple_SetItem(shape, d, PyLong_FromSsize_t(self->shape[d]));
  return shape;
}

static Py_ssize_t buffer_length(PyObject *object) {
  return ((native_buffer *)object)->shape[0];
}

static PyObject *buffer_repr(PyObject *object) {
  native_buffer *self = (native_buffer *)object;
  const char *kind = self->format[0] == 'd'   ? "float64"
                     : self->format[0] == 'i' ? "int32"
                     : self->format[0] == 'B' ? "uint8"
                     : self->format[0] == 'q' ? "int64"
                                              : "float32";
  char shape[96] = "";
  for (int d = 0; d < self->dimensions; d++)
    PyOS_snprintf(shape + strlen(shape), sizeof shape - strlen(shape), "[%lld]", (long long)self->shape[d]);
  return PyUnicode_FromFormat("<pags.Buffer %s of %s>", shape, kind);
}

static PyGetSetDef buffer_getset[] = {{"shape", buffer_shape, NULL, "sizes, the last varying fastest", NULL}, {0}};
static PyType_Slot buffer_slots[] = {
    {Py_tp_dealloc, buffer_dealloc},
    {Py_tp_repr, buffer_repr},
    {Py_bf_getbuffer, buffer_get},
    {Py_tp_getset, buffer_getset},
    {Py_sq_length, buffer_length},
    {Py_tp_doc, "Memory of the engine: memoryview(x) and numpy.asarray(x) give access without a copy."},
    {0, NULL}};
PyType_Spec native_buffer_spec = {.name = "pags.Buffer",
                                  .basicsize = sizeof(native_buffer),
                                  .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION,
                                  .slots = buffer_slots};
