/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Python's arguments of submit, render and pick to the camera, frame options and layout of a job. */
#include "blender_addon/native/job.h"

#include <math.h>
#include <string.h>

#include "base/vec3.h"

enum { MOST_CUT = 1000 }; /* pixels; this limit already culls nearly everything */

/* ---- Single arguments ---- */

static bool read_outputs(PyObject *value, unsigned *outputs) {
  *outputs = 0;
  const Py_ssize_t count = PyUnicode_Check(value) || !PySequence_Check(value) ? -1 : PySequence_Size(value);
  if (count < 0 && !PyErr_Occurred())
    PyErr_Format(PyExc_TypeError, "outputs: expected names in a list or tuple, found %.80R", value);
  for (Py_ssize_t i = 0; i < count; i++) {
    const char *name;
    int k = 0;
    NATIVE_OWNED PyObject *item = PySequence_GetItem(value, i);
    if (!item || !native_read_word(item, "outputs", &name))
      return false;
    while (k < PLANES && strcmp(name, native_outputs[k].name) != 0)
      k++;
    if (k == PLANES)
      return PyErr_Format(PyExc_ValueError,
                          "outputs: expected rgba, rgb8, depth, object, id, priority, heat, crypto_object, "
                          "crypto_class, normal, motion, count or overdraw, found \"%s\"",
                          name);
    *outputs |= 1u << k;
  }
  return count >= 0;
}

static bool read_mode(PyObject *value, native_mode *mode) {
  static const char *const names[MODE_COUNT] = {"rgb", "priority", "critical", "depth", "size", "count", "overdraw"};
  const char *name = "rgb";
  if (!native_read_word(value, "mode", &name))
    return false;
  for (int i = 0; i < MODE_COUNT; i++)
    if (!strcmp(name, names[i])) {
      *mode = (native_mode)i;
      return true;
    }
  return PyErr_Format(PyExc_ValueError,
                      "mode: expected rgb, priority, critical, depth, size, count or overdraw, found \"%s\"", name);
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
  for (int k = 0; k < 4; k++)
    if (n[k] != floor(n[k]))
      return PyErr_Format(PyExc_ValueError, "window: expected whole pixels, found %.80R", value);
  if (!(n[0] >= 0 && n[1] >= 0 && n[2] >= 1 && n[3] >= 1 && n[0] + n[2] <= l->width && n[1] + n[3] <= l->height))
    return PyErr_Format(PyExc_ValueError, "window: x, y, width, height must lie within the picture");
  l->x = (int)n[0], l->y = (int)n[1], l->width = (int)n[2], l->height = (int)n[3];
  return true;
}

static bool read_clips(PyObject *value, pags_frame_options *o) {
  Py_ssize_t shape[2] = {-1, 4};
  if (value == Py_None)
    return true;
  PAGS_AUTOFREE double *planes = native_read_array(value, "clips: planes a, b, c, d", true, 2, shape);
  if (!planes)
    return false;
  for (Py_ssize_t i = 0; i < 4 * shape[0]; i++)
    if (!isfinite(planes[i]))
      return PyErr_Format(PyExc_ValueError, "clips: planes a, b, c, d: expected finite numbers, found %.200R", value);
  if (shape[0] > PAGS_MOST_CLIPS)
    return PyErr_Format(PyExc_ValueError, "clips: expected at most %d planes, found %zd", (int)PAGS_MOST_CLIPS,
                        shape[0]);
  o->clip_count = (int)shape[0];
  memcpy(o->clips, planes, (size_t)shape[0] * sizeof *o->clips);
  return true;
}

/* Reads an integer argument; `out` keeps its value if it is missing. */
static bool read_count(PyObject *value, const char *what, int least, int most, int *out) {
  long long number = *out;
  const bool good = native_read_integer(value, what, least, most, &number);
  *out = (int)number;
  return good;
}

static bool read_degrees(const native_job_arguments *w, native_job *job) {
  pags_frame_options *const o = &job->options;
  o->sh_degree = 3;
  o->exp_degree = 5;
  job->antialiased = -1;
  if (!read_count(w->sh_degree, "sh_degree", 0, 3, &o->sh_degree) ||
      !read_count(w->exp_degree, "exp_degree", 3, 5, &o->exp_degree) ||
      !read_count(w->antialiased, "antialiased", -1, 1, &job->antialiased))
    return false;
  if (job->antialiased >= 0)
    o->antialiased = job->antialiased;
  return o->exp_degree != 4 || PyErr_Format(PyExc_ValueError, "exp_degree: expected 3 or 5, found 4");
}

static bool read_early_z(PyObject *value, native_job *job) {
  const char *text = "lossless";
  if (!native_read_word(value, "early_z", &text))
    return false;
  if (pags_early_z_parse(text, &job->options) != PAGS_OK)
    return PyErr_Format(
        PyExc_ValueError,
        "early_z: expected off, lossless, paper, bounded or bounded=EPS with 0 < EPS < 1, found \"%.80s\"", text);
  if (job->deadline && job->options.early_z == PAGS_EARLY_Z_PAPER)
    return PyErr_Format(PyExc_ValueError, "deadline: expected early_z off, lossless or bounded, found paper");
  return true;
}

static bool read_options(const native_job_arguments *w, const native_scene *scene, native_job *job) {
  pags_frame_options *o = &job->options;
  double background[3], cut = 0, near_plane = 0, light[6]; /* light: gain r g b, offset r g b */
  *o = pags_composition_options(scene->composition);
  if (!read_degrees(w, job) || !native_read_number(w->cut, "cut", 0, MOST_CUT, &cut) ||
      !native_read_number(w->near_plane, "near_plane", 0, NATIVE_LARGEST, &near_plane) || !read_clips(w->clips, o) ||
      (w->background != Py_None && !native_read_numbers(w->background, "background", 3, background)) ||
      (w->exposure != Py_None && !native_read_numbers(w->exposure, "exposure: gain and offset", 6, light)))
    return false;
  o->rest_cut = (float)cut;
  if (near_plane > 0)
    o->near_plane = (float)near_plane;
  if (w->background != Py_None)
    pags_narrow3(background, o->background);
  if (job->layout.transparent)
    memset(o->background, 0, sizeof o->background);
  if (job->layout.transparent || w->background != Py_None)
    o->sky = NULL;
  if (w->exposure != Py_None)
    pags_frame_options_expose(o, light, light + 3);
  o->extra_channels = native_layout_needs_extras(&job->layout);
  o->keep_for_passes = native_layout_needs_passes(&job->layout);
  return read_early_z(w->early_z, job);
}

static bool read_layout(const native_job_arguments *w, native_layout *l) {
  double empty = 0, scale = 1, alpha = 0;
  l->outputs = OUTPUT_RGBA;
  if (!read_mode(w->mode, &l->mode) || (w->outputs != Py_None && !read_outputs(w->outputs, &l->outputs)) ||
      !native_read_flag(w->linear, "linear", &l->linear) || !native_read_flag(w->flip, "flip", &l->flip) ||
      !native_read_flag(w->transparent, "transparent", &l->transparent) ||
      !native_read_finite(w->depth_empty, "depth_empty", &empty) ||
      !native_read_finite(w->depth_scale, "depth_scale", &scale) ||
      !native_read_number(w->depth_alpha, "depth_alpha", 0, 1, &alpha))
    return false;
  l->depth_empty = (float)empty;
  l->depth_scale = (float)scale;
  l->depth_alpha = (float)alpha;
  return true;
}

static bool read_arguments(const native_state *state, PyObject *scene, const native_job_arguments *w, native_job *job) {
  if (!read_layout(w, &job->layout))
    return false;
  if (w->deadline != Py_None) {
    if (!PyObject_TypeCheck(w->deadline, state->types[DEADLINE_TYPE]))
      return PyErr_Format(PyExc_TypeError, "deadline: expected a Deadline or None");
    if (!native_lock_check(&((native_deadline *)w->deadline)->lock, state, "Deadline"))
      return false;
    job->deadline = Py_NewRef(w->deadline);
  }
  const native_contents_arguments contents = {w->placements, w->object_values, w->names, w->others};
  return read_window(w->window, job) &&
         native_contents_read(state, scene, &contents, job->camera.time, &job->contents) &&
         native_passes_read(state, w, job) && read_options(w, (const native_scene *)scene, job);
}

/* ---- The job ---- */

PyObject *native_job_new(const native_state *state, PyObject *scene, PyObject *camera, const native_job_arguments *w) {
  if (!PyObject_TypeCheck(scene, state->types[SCENE_TYPE]))
    return PyErr_Format(PyExc_TypeError, "scene: expected what pags.load returned");
  NATIVE_OWNED PyObject *object = native_allocate(state->types[JOB_TYPE]);
  native_job *job = (native_job *)object;
  if (!job)
    return NULL;
  job->state = JOB_DONE;
  if (!native_read_camera(camera, "camera", &job->camera) || !read_arguments(state, scene, w, job))
    return NULL;
  return pags_take(&object);
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
                                .deadline = Py_None};
}
