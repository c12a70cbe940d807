/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Python's arguments of submit, render and pick to the camera, frame options and layout of a job. */
#include "blender_addon/native/job.h"

#include <stdlib.h>
#include <string.h>

enum { MOST_CUT = 1000 }; /* pixels; culls nearly everything already */

/* ---- Single arguments ---- */

static unsigned output_named(const char *name) {
  static const char *const names[OUTPUT_KINDS] = {"rgba",   "depth", "object",        "id",           "priority",
                                                  "heat",   "rgb8",  "crypto_object", "crypto_class", "normal",
                                                  "motion", "count", "overdraw"};
  for (unsigned i = 0; i < OUTPUT_KINDS; i++)
    if (!strcmp(name, names[i]))
      return 1u << i;
  PyErr_Format(
      PyExc_ValueError,
      "outputs: expected rgba, rgb8, depth, object, id, priority, heat, crypto_object, crypto_class, normal, motion, "
      "count or overdraw, found \"%s\"",
      name);
  return 0;
}

static bool read_outputs(PyObject *value, unsigned *outputs) {
  *outputs = 0;
  Py_ssize_t count = PySequence_Size(value);
  for (Py_ssize_t i = 0; i < count; i++) {
    PyObject *item = PySequence_GetItem(value, i), *bytes = item ? PyUnicode_AsUTF8String(item) : NULL;
    unsigned output = bytes ? output_named(PyBytes_AsString(bytes)) : 0;
    Py_XDECREF(bytes);
    Py_XDECREF(item);
    if (!output)
      return false;
    *outputs |= output;
  }
  return count >= 0;
}

static bool read_mode(const char *name, native_mode *mode) {
  static const char *const names[MODE_COUNT] = {"rgb", "priority", "critical", "depth", "size", "count", "overdraw"};
  for (int i = 0; i < MODE_COUNT; i++)
    if (!strcmp(name, names[i])) {
      *mode = (native_mode)i;
      return true;
    }
  PyErr_Format(PyExc_ValueError, "mode: expected rgb, priority, critical, depth, size, count or overdraw, found \"%s\"",
               name);
  return false;
}

static bool read_window(PyObject *value, native_job *job) {
  native_layout *l = &job->layout;
  double n[4];
  l->width = job->camera.width;
  l->height = job->camera.height;
  if (value == Py_None)
    return true;
  if (!native_read_numbers(value, "window: x, y, width, height", 4, n))
    return false;
  if (!(n[0] >= 0 && n[1] >= 0 && n[2] >= 1 && n[3] >= 1 && n[0] + n[2] <= l->width && n[1] + n[3] <= l->height)) {
    PyErr_SetString(PyExc_ValueError, "window: x, y, width, height must lie within the picture");
    return false;
  }
  l->x = (int)n[0], l->y = (int)n[1], l->width = (int)n[2], l->height = (int)n[3];
  return true;
}

static bool read_clips(PyObject *value, pags_frame_options *o) {
  Py_ssize_t shape[2] = {-1, 4};
  double *const planes = value == Py_None ? NULL : native_read_array(value, "clips: planes a, b, c, d", true, 2, shape);
  if (!planes)
    return value == Py_None;
  const bool good = shape[0] <= PAGS_MOST_CLIPS;
  if (good) {
    o->clip_count = (int)shape[0];
    memcpy(o->clips, planes, (size_t)shape[0] * sizeof *o->clips);
  } else
    PyErr_Format(PyExc_ValueError, "clips: expected at most %d planes, found %zd", (int)PAGS_MOST_CLIPS, shape[0]);
  free(planes);
  return good;
}

static bool read_options(const native_job_arguments *w, const native_scene *scene, native_job *job) {
  pags_frame_options *o = &job->options;
  double background[3];
  *o = pags_composition_options(scene->composition);
  if (w->sh_degree < 0 || w->sh_degree > 3 || (w->exp_degree != 3 && w->exp_degree != 5)) {
    PyErr_SetString(PyExc_ValueError, "sh_degree: expected 0 to 3; exp_degree: 3 or 5");
    return false;
  }
  if (!(w->cut >= 0 && w->cut <= MOST_CUT)) {
    PyErr_Format(PyExc_ValueError, "cut: expected 0 to %d pixels", MOST_CUT);
    return false;
  }
  o->rest_cut = (float)w->cut;
  job->antialiased = w->antialiased;
  if (w->antialiased >= 0)
    o->antialiased = w->antialiased;
  if (w->near_plane > 0)
    o->near_plane = (float)w->near_plane;
  if (!read_clips(w->clips, o))
    return false;
  if (w->background != Py_None) {
    if (!native_read_numbers(w->background, "background", 3, background))
      return false;
    o->sky = NULL;
    for (int c = 0; c < 3; c++)
      o->background[c] = (float)background[c];
  }
  if (w->transparent) {
    o->sky = NULL;
    memset(o->background, 0, sizeof o->background);
  }
  if (w->exposure != Py_None) {
    double values[6]; /* gain r g b, offset r g b */
    if (!native_read_numbers(w->exposure, "exposure: gain and offset", 6, values))
      return false;
    pags_frame_options_expose(o, values, values + 3);
  }
  if (pags_early_z_parse(w->early_z, o) != PAGS_OK) {
    PyErr_SetString(PyExc_ValueError, pags_error_message());
    return false;
  }
  if (job->deadline && o->early_z == PAGS_EARLY_Z_PAPER) {
    PyErr_SetString(PyExc_ValueError, "deadline: expected early_z off, lossless or bounded, found paper");
    return false;
  }
  o->sh_degree = w->sh_degree;
  o->exp_degree = w->exp_degree;
  o->extra_channels = native_layout_needs_extras(&job->layout);
  o->keep_for_passes = native_layout_needs_passes(&job->layout);
  return true;
}

static bool read_arguments(const native_state *state, PyObject *scene, const native_job_arguments *w, native_job *job) {
  native_layout *l = &job->layout;
  if (!read_mode(w->mode, &l->mode))
    return false;
  l->outputs = OUTPUT_RGBA;
  if (w->outputs != Py_None && !read_outputs(w->outputs, &l->outputs))
    return false;
  l->linear = w->linear != 0;
  l->flip = w->flip != 0;
  l->transparent = w->transparent != 0;
  l->depth_empty = (float)w->depth_empty;
  l->depth_scale = (float)w->depth_scale;
  if (w->deadline != Py_None && !PyObject_TypeCheck(w->deadline, state->deadline)) {
    PyErr_SetString(PyExc_TypeError, "deadline: expected a Deadline or None");
    return false;
  }
  job->deadline = w->deadline != Py_None ? Py_NewRef(w->deadline) : NULL;
  const native_contents_arguments contents = {w->placements, w->object_values, w->names, w->others};
  return read_window(w->window, job) &&
         native_contents_read(state, scene, &contents, job->camera.time, &job->contents) &&
         native_passes_read(state, w, job) && read_options(w, (const native_scene *)scene, job);
}

/* ---- The job ---- */

PyObject *native_job_new(const native_state *state, PyObject *scene, PyObject *camera, const native_job_arguments *w) {
  if (!PyObject_TypeCheck(scene, state->scene)) {
    PyErr_SetString(PyExc_TypeError, "scene: expected what pags.load returned");
    return NULL;
  }
  allocfunc alloc = (allocfunc)(size_t)PyType_GetSlot(state->job, Py_tp_alloc);
  native_job *job = (native_job *)alloc(state->job, 0);
  if (!job)
    return NULL;
  job->state = JOB_DONE;
  if (native_read_camera(camera, &job->camera)) {
    pags_result result = pags_camera_check(&job->camera, "camera");
    if (result != PAGS_OK)
      native_raise(state, result);
    else if (read_arguments(state, scene, w, job))
      return (PyObject *)job;
  }
  Py_DECREF(job);
  return NULL;
}

native_job_arguments native_default_job_arguments(void) {
  return (native_job_arguments){.outputs = Py_None,
                                .placements = Py_None,
                                .others = Py_None,
                                .window = Py_None,
                                .object_values = Py_None,
                                .background = Py_None,
                                .exposure = Py_None,
                                .before = Py_None,
                                .after = Py_None,
                                .names = Py_None,
                                .clips = Py_None,
                                .deadline = Py_None,
                                .mode = "rgb",
                                .early_z = "lossless",
                                .antialiased = -1,
                                .sh_degree = 3,
                                .exp_degree = 5,
                                .depth_scale = 1};
}
