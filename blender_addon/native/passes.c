/* SPDX-License-Identifier: Apache-2.0 */
/* The passes of a job (pags/passes.h): reads their arguments from Python, and draws them. */
#include "blender_addon/native/job.h"

#include <stdlib.h>
#include <string.h>

/* ---- Arguments ---- */

/* Reads a moment: a camera, (camera, placements) or (camera, placements, others). */
static bool read_moment(const native_state *state, const native_job *job, PyObject *value, const char *what,
                        native_moment *out) {
  if (value == Py_None)
    return true;
  const Py_ssize_t size = PyTuple_Check(value) ? PyTuple_Size(value) : 0;
  if (size != 0 && size != 2 && size != 3)
    return PyErr_Format(PyExc_ValueError, "%s: expected a camera, or a tuple of a camera, placements and others", what);
  if (!native_read_camera(size ? PyTuple_GetItem(value, 0) : value, what, &out->camera))
    return false;
  if (pags_camera_bends(&out->camera))
    return PyErr_Format(PyExc_ValueError, "%s: has a lens, and motion is that of a pinhole", what);
  out->known = true;
  const native_contents_arguments w = {.placements = size ? PyTuple_GetItem(value, 1) : Py_None,
                                       .object_values = Py_None,
                                       .names = Py_None,
                                       .others = size == 3 ? PyTuple_GetItem(value, 2) : Py_None};
  if (!native_contents_read(state, job->contents.shown[0].scene, &w, out->camera.time, &out->contents))
    return false;
  for (int i = 0; i < out->contents.shown_count; i++) { /* only the picture's scenes are locked while it is drawn */
    bool known = false;
    for (int k = 0; k < job->contents.shown_count; k++)
      known |= job->contents.shown[k].scene == out->contents.shown[i].scene;
    if (!known)
      return PyErr_Format(PyExc_ValueError, "%s: others has a scene that isn't in the picture", what);
  }
  return true;
}

static const char *name_of_object(const pags_scene *scene, int64_t object, bool classes) {
  if (object < 0 || object >= scene->object_count) /* the latter is refused when the parts are composed */
    return "background";
  return classes ? scene->objects[object].record.class_name : scene->objects[object].record.id;
}

/* The names of a scene's labels: those given or, of classes or where none are given, those of the objects or classes.
 */
static void name_labels(const native_shown *shown, bool classes, const char **labels) {
  const pags_scene *const scene = pags_composition_scene(((native_scene *)shown->scene)->composition);
  if (!shown->placements)
    for (int64_t i = 0; i <= scene->object_count; i++)
      labels[i] = name_of_object(scene, i, classes);
  for (int64_t i = 0; i < shown->placement_count; i++)
    labels[i] =
        shown->names && !classes ? shown->names[i] : name_of_object(scene, shown->placements[i].object, classes);
}

bool native_passes_read(const native_state *state, const native_job_arguments *w, native_job *job) {
  if (!read_moment(state, job, w->before, "before", &job->moments[0]) ||
      !read_moment(state, job, w->after, "after", &job->moments[1]))
    return false;
  if ((job->layout.outputs & OUTPUT_MOTION) && !job->moments[0].known && !job->moments[1].known)
    return PyErr_Format(PyExc_ValueError,
                        "outputs: motion needs before or after: a camera, or a tuple of a camera and placements, at "
                        "another time");
  const native_contents *const c = &job->contents;
  const native_shown *const last = &c->shown[c->shown_count - 1];
  const int64_t objects = pags_composition_scene(((native_scene *)last->scene)->composition)->object_count;
  const int64_t count = last->label_base + (last->placements ? last->placement_count : objects + 1);
  for (int m = 0; m < 2; m++) {
    if (!(job->layout.outputs & (m ? OUTPUT_CRYPTO_CLASS : OUTPUT_CRYPTO_OBJECT)))
      continue;
    PAGS_AUTOFREE const char **labels = calloc((size_t)count + 1, sizeof *labels);
    for (int i = 0; labels && i < c->shown_count; i++)
      name_labels(&c->shown[i], m == 1, labels + c->shown[i].label_base);
    const pags_result result = labels ? pags_matte_names_create(labels, count, &job->mattes[m])
                                      : pags_out_of_memory("%lld names", (long long)count);
    if (result != PAGS_OK)
      return native_raise_value(PyExc_MemoryError);
  }
  return true;
}

PyObject *native_cryptomatte_hash(PAGS_UNUSED PyObject *module, PyObject *arguments) {
  const char *name;
  PyObject *value;
  if (!PyArg_ParseTuple(arguments, "O:cryptomatte_hash", &value) || !native_read_word(value, "name", &name))
    return NULL;
  return PyLong_FromUnsignedLong(pags_cryptomatte_hash(name, strlen(name)));
}

/* ---- Drawing ---- */

pags_result native_passes_moments(native_job *job, pags_moment out[2]) {
  memset(out, 0, 2 * sizeof *out);
  for (int side = 0; side < 2; side++) {
    native_moment *const from = &job->moments[side];
    if (!from->known || !(job->layout.outputs & OUTPUT_MOTION))
      continue;
    PAGS_TRY(native_contents_compose(job, &from->contents));
    out[side] = (pags_moment){from->camera, from->contents.parts, from->contents.part_count};
  }
  return PAGS_OK;
}

pags_result native_passes_draw(const native_job *job, const pags_moment moments[2], pags_frame *frame,
                               pags_passes *out) {
  const int count = job->contents.part_count;
  PAGS_AUTOFREE int32_t *names = malloc(2 * ((size_t)count + 1) * sizeof *names);
  pags_matte mattes[2];
  pags_pass_request request = {.normal = (job->layout.outputs & OUTPUT_NORMAL) != 0,
                               .motion = (job->layout.outputs & OUTPUT_MOTION) != 0,
                               .pairs = native_layout_needs_pairs(&job->layout),
                               .before = job->moments[0].known ? &moments[0] : NULL,
                               .after = job->moments[1].known ? &moments[1] : NULL};
  PAGS_CHECK_MEMORY(names, "%d parts", count);
  for (int m = 0; m < 2; m++) {
    int32_t *const of_part = names + m * (count + 1);
    const pags_matte_names *const from = &job->mattes[m];
    if (!(job->layout.outputs & (m ? OUTPUT_CRYPTO_CLASS : OUTPUT_CRYPTO_OBJECT)))
      continue;
    for (int p = 0; p < count; p++)
      of_part[p] = from->name_of_label[job->contents.parts[p].label];
    mattes[m] = (pags_matte){from->count, from->values, of_part};
    request.matte[m] = &mattes[m];
  }
  return pags_frame_passes(frame, &request, out);
}
