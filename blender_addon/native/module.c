/* SPDX-License-Identifier: Apache-2.0 */
/* The Python module `pags`: its functions, types and exceptions, for the add-on and for plain Python. */
#include "base/vec3.h"
#include "blender_addon/native/job.h"
#include "dataset/driving/reader.h"

static struct PyModuleDef module_definition;

native_state *native_state_of(PyObject *self) {
  return PyType_GetModuleState(Py_TYPE(self));
}

void *native_allocate(PyTypeObject *type) {
  return ((allocfunc)(size_t)PyType_GetSlot(type, Py_tp_alloc))(type, 0);
}

void native_deallocate(PyObject *object) {
  PyTypeObject *type = Py_TYPE(object);
  ((freefunc)(size_t)PyType_GetSlot(type, Py_tp_free))(object);
  Py_DECREF(type);
}

PyObject *native_raise_text(const native_state *state, pags_result code, const char *text) {
  PyObject *type = code == PAGS_CANCELLED ? state->cancelled : state->error;
  NATIVE_OWNED PyObject *words = native_text(text);
  if (words && code == PAGS_ERROR_MEMORY)
    PyErr_SetObject(PyExc_MemoryError, words);
  if (!words || code == PAGS_ERROR_MEMORY)
    return NULL;
  NATIVE_OWNED PyObject *error = PyObject_CallFunctionObjArgs(type, words, NULL);
  NATIVE_OWNED PyObject *name = error ? PyUnicode_FromString(pags_result_name(code)) : NULL;
  if (name && PyObject_SetAttrString(error, "code", name) == 0)
    PyErr_SetObject(type, error);
  return NULL;
}

PyObject *native_raise(const native_state *state, pags_result code) {
  return native_raise_text(state, code, pags_error_message());
}

PyObject *native_raise_value(PyObject *kind) {
  NATIVE_OWNED PyObject *words = native_text(pags_error_message());
  if (words)
    PyErr_SetObject(kind, words);
  return NULL;
}

static PyObject *available_threads(PyObject *module, PyObject *unused) {
  (void)module, (void)unused;
  return PyLong_FromLong(pags_available_threads());
}

static PyObject *heat(PAGS_UNUSED PyObject *module, PyObject *arguments) {
  PyObject *number;
  double value, color[3];
  float rgb[3];
  if (!PyArg_ParseTuple(arguments, "O:heat", &number) || !native_read_finite(number, "value", &value))
    return NULL;
  pags_colormap_heat((float)value, rgb);
  pags_widen3(rgb, color);
  return native_numbers(color, 3);
}

static PyObject *sweep_format(PyObject *module, PyObject *arguments) {
  PyObject *folder;
  pags_rules rules;
  if (!PyArg_ParseTuple(arguments, "O&:sweep_format", PyUnicode_FSConverter, &folder))
    return NULL;
  const pags_result result = pags_sweep_rules_read(PyBytes_AsString(folder), &rules);
  Py_DECREF(folder);
  if (result != PAGS_OK)
    return native_raise(PyModule_GetState(module), result);
  return Py_BuildValue("i(iii)si", rules.columns, rules.position[0], rules.position[1], rules.position[2],
                       rules.lidar_world   ? "world"
                       : rules.lidar_frame ? "laser"
                                           : "ego",
                       rules.intensity);
}

/* Adds a new reference to the module, and returns it; NULL after a failure. */
static PyObject *add(PyObject *module, const char *name, PyObject *type) {
  if (type && PyModule_AddObjectRef(module, name, type) == 0)
    return type;
  Py_XDECREF(type);
  return NULL;
}

static int module_exec(PyObject *module) {
  static const struct {
    const char *name;
    PyType_Spec *spec;
  } types[NATIVE_TYPES] = {[BUFFER_TYPE] = {"Buffer", &native_buffer_spec},
                           [SCENE_TYPE] = {"Scene", &native_scene_spec},
                           [RENDERER_TYPE] = {"Renderer", &native_renderer_spec},
                           [DEADLINE_TYPE] = {"Deadline", &native_deadline_spec},
                           [JOB_TYPE] = {"Job", &native_job_spec},
                           [PICTURE_TYPE] = {"Picture", &native_picture_spec}};
  native_state *state = PyModule_GetState(module);
  state->error =
      add(module, "Error",
          PyErr_NewExceptionWithDoc("pags.Error", "An error of the engine with its message; `code` is the kind.",
                                    PyExc_RuntimeError, NULL));
  if (!state->error)
    return -1;
  state->cancelled = add(module, "Cancelled",
                         PyErr_NewExceptionWithDoc("pags.Cancelled", "The work was cancelled.", state->error, NULL));
  if (!state->cancelled)
    return -1;
  for (int i = 0; i < NATIVE_TYPES; i++) {
    state->types[i] = (PyTypeObject *)add(module, types[i].name, PyType_FromModuleAndSpec(module, types[i].spec, NULL));
    if (!state->types[i])
      return -1;
  }
  return PyModule_AddStringConstant(module, "__version__", PAGS_VERSION_STRING);
}

static int module_traverse(PyObject *module, visitproc visit, void *arg) {
  native_state *state = PyModule_GetState(module);
  Py_VISIT(state->error);
  Py_VISIT(state->cancelled);
  for (int i = 0; i < NATIVE_TYPES; i++)
    Py_VISIT(state->types[i]);
  return 0;
}

static int module_clear(PyObject *module) {
  native_state *state = PyModule_GetState(module);
  Py_CLEAR(state->error);
  Py_CLEAR(state->cancelled);
  for (int i = 0; i < NATIVE_TYPES; i++)
    Py_CLEAR(state->types[i]);
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
     "camera($module, /, width, height, K, world_from_camera=None, *, camera_from_world=None, axes='opencv', time=None)"
     "\n--\n\nThe dictionary of a camera, of matrices: K is 3 x 3 (pixels; corners at 0 and width), and one of "
     "world_from_camera and its\ninverse camera_from_world (gsplat's viewmat) is 3 x 4 or 4 x 4. axes: opencv (x "
     "right, y down, z forward) or opengl (y up,\nz back, as NeRF and Blender have them)."},
    {"render", (PyCFunction)(void (*)(void))native_render, METH_VARARGS | METH_KEYWORDS,
     "render($module, /, scene, camera, *, threads=0, " JOB_ARGUMENT_SIGNATURE
     ")\n--\n\nDraws and waits: the Picture of a camera, or of a list of cameras the list of Pictures. Arguments as of "
     "Renderer.submit."},
    {"gradients", (PyCFunction)(void (*)(void))native_gradients, METH_VARARGS | METH_KEYWORDS,
     "gradients($module, /, scene, camera, rgb, *, depth=None, threads=0, placements=None, background=None, "
     "transparent=False, antialiased=-1, sh_degree=3, near_plane=0)\n--\n\nThe gradients of a loss by all parameters, "
     "as Buffers in a dictionary like Scene.arrays(), from its gradients by the picture\nthat render() draws with the "
     "same arguments: rgb [height][width][3], or [4] with that by alpha, and depth [height][width]."},
    {"pick", (PyCFunction)(void (*)(void))native_pick, METH_VARARGS | METH_KEYWORDS,
     "pick($module, /, scene, camera, x, y, *, placements=None, others=None, clips=None)\n--\n\nWhat is met through "
     "pixel (x, y), row 0 at the top, as a dictionary or None: id of the Gaussian behind which\nless than half of the "
     "ray is left, object (number or None), priority, depth (metres along the camera's axis),\npoint (world, metres), "
     "scene (0: the first). placements, others, clips: as for Renderer.submit."},
    {"cryptomatte_hash", native_cryptomatte_hash, METH_VARARGS,
     "cryptomatte_hash($module, name, /)\n--\n\nThe 32-bit hash of a name in a Cryptomatte's manifest."},
    {"sweep_format", sweep_format, METH_VARARGS,
     "sweep_format($module, folder, /)\n--\n\nThe format of the sweeps in a driving set: floats per row, indices of x, "
     "y and z, their frame (ego, laser or world), and the index of the intensity (-1: none)."},
    {"heat", heat, METH_VARARGS,
     "heat($module, value, /)\n--\n\nThe colour (r, g, b), as a screen shows it, of a number from 0 to 1 "
     "in pictures of priorities and other\nmodes: from dark violet over red to pale yellow."},
    {"available_threads", available_threads, METH_NOARGS,
     "available_threads($module, /)\n--\n\nProcessors that this process may use."},
    {0}};

static PyModuleDef_Slot slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};
static struct PyModuleDef module_definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "pags",
    .m_doc =
        "Priority-Adaptive Gaussian Splatting on CPUs.\n\nCameras are dictionaries (camera() makes one of matrices): "
        "width, height, fx, fy, cx, cy (pixels; corners at 0 and width), world_from_camera (12 numbers\nrow by row, or "
        "a matrix of 3 x 4 or 4 x 4; x right, y down, z forward; metres). time (seconds), lens and rolling_shutter\n"
        "(dictionaries, as in camera files) may be left out.",
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
