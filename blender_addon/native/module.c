/* SPDX-License-Identifier: Apache-2.0 */
/* The Python module `pags`: its functions, types and exceptions, for the add-on and for plain Python. */
#include "blender_addon/native/job.h"

static struct PyModuleDef module_definition;

native_state *native_state_of(PyObject *self) {
  return PyType_GetModuleState(Py_TYPE(self));
}

PyObject *native_raise_text(const native_state *state, pags_result code, const char *text) {
  PyObject *type = code == PAGS_CANCELLED ? state->cancelled : state->error, *words = native_text(text);
  PyObject *error = words && code != PAGS_ERROR_MEMORY ? PyObject_CallFunctionObjArgs(type, words, NULL) : NULL;
  if (words && code == PAGS_ERROR_MEMORY)
    PyErr_SetObject(PyExc_MemoryError, words);
  Py_XDECREF(words);
  if (!error)
    return NULL;
  PyObject *name = PyUnicode_FromString(pags_result_name(code));
  if (name && PyObject_SetAttrString(error, "code", name) == 0)
    PyErr_SetObject(type, error);
  Py_XDECREF(name);
  Py_DECREF(error);
  return NULL;
}

PyObject *native_raise(const native_state *state, pags_result code) {
  return native_raise_text(state, code, pags_error_message());
}

PyObject *native_raise_value(PyObject *kind) {
  PyObject *words = native_text(pags_error_message());
  if (words)
    PyErr_SetObject(kind, words);
  Py_XDECREF(words);
  return NULL;
}

static PyObject *available_threads(PyObject *module, PyObject *unused) {
  (void)module;
  (void)unused;
  return PyLong_FromLong(pags_available_threads());
}

static PyObject *heat(PyObject *module, PyObject *arguments) {
  PyObject *number;
  double value;
  float rgb[3];
  (void)module;
  if (!PyArg_ParseTuple(arguments, "O:heat", &number) || !native_read_finite(number, "value", &value))
    return NULL;
  pags_colormap_heat((float)value, rgb);
  const double color[3] = {(double)rgb[0], (double)rgb[1], (double)rgb[2]};
  return native_numbers(color, 3);
}

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec, const char *name) {
  PyObject *type = PyType_FromModuleAndSpec(module, spec, NULL);
  if (type && PyModule_AddObjectRef(module, name, type) == 0)
    return (PyTypeObject *)type;
  Py_XDECREF(type);
  return NULL;
}

static PyObject *add_exception(PyObject *module, const char *full, const char *name, const char *about,
                               PyObject *base) {
  PyObject *type = PyErr_NewExceptionWithDoc(full, about, base, NULL);
  if (type && PyModule_AddObjectRef(module, name, type) == 0)
    return type;
  Py_XDECREF(type);
  return NULL;
}

static int module_exec(PyObject *module) {
  native_state *state = PyModule_GetState(module);
  state->error = add_exception(module, "pags.Error", "Error",
                               "An error of the engine with its message; `code` is the kind.", PyExc_RuntimeError);
  if (!state->error)
    return -1;
  state->cancelled = add_exception(module, "pags.Cancelled", "Cancelled", "The work was cancelled.", state->error);
  state->buffer = add_type(module, &native_buffer_spec, "Buffer");
  state->scene = add_type(module, &native_scene_spec, "Scene");
  state->renderer = add_type(module, &native_renderer_spec, "Renderer");
  state->deadline = add_type(module, &native_deadline_spec, "Deadline");
  state->job = add_type(module, &native_job_spec, "Job");
  state->picture = add_type(module, &native_picture_spec, "Picture");
  if (!state->cancelled || !state->buffer || !state->scene || !state->renderer || !state->deadline || !state->job ||
      !state->picture)
    return -1;
  return PyModule_AddStringConstant(module, "__version__", PAGS_VERSION_STRING);
}

static int module_traverse(PyObject *module, visitproc visit, void *arg) {
  native_state *state = PyModule_GetState(module);
  Py_VISIT(state->error);
  Py_VISIT(state->cancelled);
  Py_VISIT(state->buffer);
  Py_VISIT(state->scene);
  Py_VISIT(state->renderer);
  Py_VISIT(state->deadline);
  Py_VISIT(state->job);
  Py_VISIT(state->picture);
  return 0;
}

static int module_clear(PyObject *module) {
  native_state *state = PyModule_GetState(module);
  Py_CLEAR(state->error);
  Py_CLEAR(state->cancelled);
  Py_CLEAR(state->buffer);
  Py_CLEAR(state->scene);
  Py_CLEAR(state->renderer);
  Py_CLEAR(state->deadline);
  Py_CLEAR(state->job);
  Py_CLEAR(state->picture);
  return 0;
}

static PyMethodDef methods[] = {
    {"load", native_scene_load, METH_VARARGS,
     "load($module, path, edits=None, /)\n--\n\nThe Scene of a scene folder or a splat file (.ply, .spz, .sog, .splat, "
     ".glb, .pagsz). edits: rules of clean-up and look, JSON text (docs/cleanup.md)."},
    {"write_edited", native_write_edited, METH_VARARGS,
     "write_edited($module, path, edits, folder, /)\n--\n\nWrites the scene at `path` with rules of clean-up and look "
     "as a scene folder."},
    {"camera", (PyCFunction)(void (*)(void))native_camera, METH_VARARGS | METH_KEYWORDS,
     "camera($module, /, width, height, K, world_from_camera=None, *, camera_from_world=None, axes='opencv', "
     "time=None)\n"
     "--\n\nThe dictionary of a camera, of matrices: K is 3 x 3 (pixels; corners at 0 and width), and one of "
     "world_from_camera and its\ninverse camera_from_world (gsplat's viewmat) is 3 x 4 or 4 x 4. axes: opencv (x "
     "right, y "
     "down, z forward) or opengl (y up,\nz back, as NeRF and Blender have them)."},
    {"render", (PyCFunction)(void (*)(void))native_render, METH_VARARGS | METH_KEYWORDS,
     "render($module, /, scene, camera, *, threads=0, " JOB_ARGUMENT_SIGNATURE
     ")\n--\n\nDraws and waits: the Picture of a camera, or of a list of cameras the list of Pictures. Arguments as of "
     "Renderer.submit."},
    {"gradients", (PyCFunction)(void (*)(void))native_gradients, METH_VARARGS | METH_KEYWORDS,
     "gradients($module, /, scene, camera, rgb, *, depth=None, threads=0, placements=None, background=None, "
     "transparent=False, antialiased=-1, sh_degree=3, near_plane=0)\n--\n\n"
     "The gradients of a loss by all parameters, as Buffers in a dictionary like Scene.arrays(), from its gradients by "
     "the picture\nthat render() draws with the same arguments: rgb [height][width][3], or [4] with that by alpha, and "
     "depth [height][width]."},
    {"pick", (PyCFunction)(void (*)(void))native_pick, METH_VARARGS | METH_KEYWORDS,
     "pick($module, /, scene, camera, x, y, *, placements=None, others=None, clips=None)\n--\n\nWhat is met through "
     "pixel (x, y), "
     "row 0 at the "
     "top, as a dictionary or None: id of the "
     "Gaussian behind which\nless than half of the ray is left, object (number or None), priority, depth (metres along "
     "the camera's "
     "axis),\npoint (world, metres), scene (0: the first). placements, others, clips: as for Renderer.submit."},
    {"cryptomatte_hash", native_cryptomatte_hash, METH_VARARGS,
     "cryptomatte_hash($module, name, /)\n--\n\nThe 32-bit hash of a name in a Cryptomatte's manifest."},
    {"heat", heat, METH_VARARGS,
     "heat($module, value, /)\n--\n\nThe colour (r, g, b), as a screen shows it, that stands for a number from 0 to 1 "
     "in "
     "pictures of priorities and other\nmodes: from dark violet over red to pale yellow."},
    {"available_threads", available_threads, METH_NOARGS,
     "available_threads($module, /)\n--\n\nProcessors that this process may use."},
    {0}};

static PyModuleDef_Slot slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};
static struct PyModuleDef module_definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "pags",
    .m_doc =
        "Priority-Adaptive Gaussian Splatting on CPUs.\n\n"
        "Cameras are dictionaries (camera() makes one of matrices): width, height, fx, fy, cx, cy (pixels; corners at "
        "0 and width), world_from_camera "
        "(12 "
        "numbers\nrow by row, or a matrix of 3 x 4 or 4 x 4; x right, y down, z forward; metres). time (seconds), lens "
        "and rolling_shutter\n(dictionaries, as in camera files) may be left out.",
    .m_size = sizeof(native_state),
    .m_methods = methods,
    .m_slots = slots,
    .m_traverse = module_traverse,
    .m_clear = module_clear};

/* PyMODINIT_FUNC makes the function visible outside the library. */
PyMODINIT_FUNC PyInit_pags(void);
PyMODINIT_FUNC PyInit_pags(void) {
  return PyModuleDef_Init(&module_definition);
}
