/* SPDX-License-Identifier: Apache-2.0 */
/* The passes of a job (pags/passes.h): what they need of Python's arguments, and drawing them. */
#include "blender_addon/native/job.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/text.h"

/* ---- Arguments ---- */

/* Reads a moment: a camera, or (camera, placements). */
static bool read_moment(PyObject *value, const char *what, native_moment *out) {
  if (value == Py_None)
    return true;
  const bool pair = PyTuple_Check(value);
  if (pair && PyTuple_Size(value) != 2) {
    PyErr_Format(PyExc_ValueError, "%s: expected a camera, or a tuple of a camera and placements", what);
    return false;
  }
  if (!native_read_camera(pair ? PyTuple_GetItem(value, 0) : value, &out->camera))
    return false;
  if (pags_camera_check(&out->camera, what) != PAGS_OK) {
    PyErr_SetString(PyExc_ValueError, pags_error_message());
    return false;
  }
  out->known = true;
  return !pair || native_read_placements(PyTuple_GetItem(value, 1), &out->placements, &out->placement_count);
}

/* Reads a name for each of `count` labels into `texts`, which are to be freed. */
static bool read_names(PyObject *value, int64_t count, char **texts) {
  if (PyUnicode_Check(value) || PySequence_Size(value) != count) {
    if (!PyErr_Occurred())
      PyErr_Format(PyExc_ValueError, "names: expected a list of %lld, one for each placement", (long long)count);
    return false;
  }
  for (int64_t i = 0; i < count; i++) {
    PyObject *item = PySequence_GetItem(value, (Py_ssize_t)i), *bytes = item ? PyUnicode_AsUTF8String(item) : NULL;
    texts[i] = bytes ? pags_text_copy(PyBytes_AsString(bytes)) : NULL;
    if (bytes && !texts[i])
      PyErr_NoMemory();
    Py_XDECREF(bytes);
    Py_XDECREF(item);
    if (!texts[i])
      return false;
  }
  return true;
}

static const char *name_of_object(const pags_scene *scene, int64_t object, bool classes) {
  if (object < 0 || object >= scene->object_count) /* the latter is refused when the parts are composed */
    return "background";
  return classes ? scene->objects[object].record.class_name : scene->objects[object].record.id;
}

/* Makes the names of a matte: those given, or those of the placements' objects or classes. */
static pags_result name_placements(const native_job *job, const pags_scene *scene, char **given, bool classes,
                                   pags_matte_names *out) {
  const char **const labels = calloc((size_t)job->placement_count + 1, sizeof *labels);
  if (!labels)
    return pags_out_of_memory("%lld names", (long long)job->placement_count);
  for (int64_t i = 0; i < job->placement_count; i++)
    labels[i] = given ? given[i] : name_of_object(scene, job->placements[i].object, classes);
  const pags_result result = pags_matte_names_create(labels, job->placement_count, out);
  free(labels);
  return result;
}

static bool make_mattes(PyObject *names, native_job *job) {
  const pags_scene *const scene = pags_composition_scene(((native_scene *)job->scene)->composition);
  char **given = NULL;
  bool good = true;
  if (names != Py_None && !job->placements) {
    PyErr_SetString(PyExc_ValueError, "names: are those of placements, which must be given, too");
    return false;
  }
  if (names != Py_None) {
    given = calloc((size_t)job->placement_count + 1, sizeof *given);
    good = given && read_names(names, job->placement_count, given);
    if (!given)
      PyErr_NoMemory();
  }
  for (int m = 0; m < 2 && good; m++) {
    if (!(job->layout.outputs & (m ? OUTPUT_CRYPTO_CLASS : OUTPUT_CRYPTO_OBJECT)))
      continue;
    const pags_result result = job->placements
                                   ? name_placements(job, scene, m == 0 ? given : NULL, m == 1, &job->mattes[m])
                                   : pags_matte_names_of_scene(scene, m, &job->mattes[m]);
    good = result == PAGS_OK;
    if (!good)
      PyErr_SetString(PyExc_MemoryError, pags_error_message());
  }
  for (int64_t i = 0; given && i < job->placement_count; i++)
    free(given[i]);
  free(given);
  return good;
}

bool native_passes_read(const native_job_arguments *w, native_job *job) {
  if (!read_moment(w->before, "before", &job->moments[0]) || !read_moment(w->after, "after", &job->moments[1]))
    return false;
  if ((job->layout.outputs & OUTPUT_MOTION) && !job->moments[0].known && !job->moments[1].known) {
    PyErr_SetString(PyExc_ValueError,
                    "outputs: motion needs before or after: a camera, or a tuple of a camera and "
                    "placements, at another time");
    return false;
  }
  return make_mattes(w->names, job);
}

PyObject *native_cryptomatte_hash(PyObject *module, PyObject *arguments) {
  const char *name;
  Py_ssize_t length;
  (void)module;
  if (!PyArg_ParseTuple(arguments, "s#:cryptomatte_hash", &name, &length))
    return NULL;
  return PyLong_FromUnsignedLong(pags_cryptomatte_hash(name, (size_t)length));
}

/* ---- Drawing ---- */

pags_result native_passes_moments(native_scene *scene, const native_job *job, pags_moment out[2]) {
  memset(out, 0, 2 * sizeof *out);
  for (int side = 0; side < 2; side++) {
    const native_moment *const from = &job->moments[side];
    const pags_part *parts;
    if (!from->known || !(job->layout.outputs & OUTPUT_MOTION))
      continue;
    out[side].camera = from->camera;
    if (from->placements)
      PAGS_TRY(pags_compose_placed(scene->composition, from->camera.time, from->placements, from->placement_count,
                                   &parts, &out[side].part_count));
    else
      pags_compose(scene->composition, from->camera.time, &parts, &out[side].part_count);
    pags_part *const copies = malloc(((size_t)out[side].part_count + 1) * sizeof *copies);
    if (!copies)
      return pags_out_of_memory("%d parts", out[side].part_count);
    if (out[side].part_count > 0)
      memcpy(copies, parts, (size_t)out[side].part_count * sizeof *copies);
    out[side].parts = copies;
  }
  return PAGS_OK;
}

pags_result native_passes_draw(const native_job *job, const pags_moment moments[2], pags_frame *frame,
                               const pags_part *parts, int count, pags_passes *out) {
  int32_t *const names = malloc(2 * ((size_t)count + 1) * sizeof *names);
  pags_matte mattes[2];
  pags_pass_request request = {.normal = (job->layout.outputs & OUTPUT_NORMAL) != 0,
                               .motion = (job->layout.outputs & OUTPUT_MOTION) != 0,
                               .before = job->moments[0].known ? &moments[0] : NULL,
                               .after = job->moments[1].known ? &moments[1] : NULL};
  if (!names)
    return pags_out_of_memory("%d parts", count);
  for (int m = 0; m < 2; m++) {
    int32_t *const of_part = names + m * (count + 1);
    const pags_matte_names *const from = &job->mattes[m];
    if (!(job->layout.outputs & (m ? OUTPUT_CRYPTO_CLASS : OUTPUT_CRYPTO_OBJECT)))
      continue;
    for (int p = 0; p < count; p++)
      of_part[p] = from->name_of_label[parts[p].label < 0 ? from->label_count - 1 : parts[p].label];
    mattes[m] = (pags_matte){from->count, from->values, of_part};
    request.matte[m] = &mattes[m];
  }
  const pags_result result = pags_frame_passes(frame, &request, out);
  free(names);
  return result;
}
