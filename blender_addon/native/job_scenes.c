/* SPDX-License-Identifier: Apache-2.0 */
/* The scenes of a job: read from Python's arguments, locked, and composed into the parts of one frame.
 *
 * The frame's world is that of the first scene, relative to its origin o. A part of another scene, whose origin is p
 * and which the caller places by W = world_from_scene, has the pose M relative to p there and T(-o) W T(p) M in the
 * frame. */
#include "blender_addon/native/job.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "base/vec3.h"
#include "port/port.h"

static native_scene *scene_of(const native_shown *shown) {
  return (native_scene *)shown->scene;
}

/* ---- Arguments ---- */

static bool read_object_values(PyObject *value, native_shown *shown) {
  Py_ssize_t count = (Py_ssize_t)pags_composition_scene(scene_of(shown)->composition)->object_count;
  PAGS_AUTOFREE double *numbers = malloc(((size_t)count + 1) * sizeof *numbers);
  shown->object_values = malloc(((size_t)count + 1) * sizeof *shown->object_values);
  if (!numbers || !shown->object_values)
    return PyErr_NoMemory();
  if (!native_read_numbers(value, "object_values: one for each object", count, numbers))
    return false;
  for (Py_ssize_t i = 0; i < count; i++)
    shown->object_values[i] = (float)numbers[i];
  return true;
}

/* Reads a name for each placement. */
static bool read_names(PyObject *value, native_shown *shown) {
  const int64_t count = shown->placement_count;
  if (!shown->placements)
    return PyErr_Format(PyExc_ValueError, "names: are those of placements, which must be given, too");
  if (PyUnicode_Check(value) || !PySequence_Check(value) || PySequence_Size(value) != count) {
    if (!PyErr_Occurred())
      PyErr_Format(PyExc_ValueError, "names: expected a list of %lld, one for each placement", (long long)count);
    return false;
  }
  shown->names = calloc((size_t)count + 1, sizeof *shown->names);
  if (!shown->names)
    return PyErr_NoMemory();
  for (int64_t i = 0; i < count; i++) {
    const char *name;
    NATIVE_OWNED PyObject *item = PySequence_GetItem(value, (Py_ssize_t)i);
    if (!item || !native_read_word(item, "names", &name))
      return false;
    shown->names[i] = pags_text_copy(name);
    if (!shown->names[i])
      return PyErr_NoMemory();
  }
  return true;
}

/* Reads the parts of a scene to draw; each value may be None. */
static bool read_drawn(PyObject *placements, PyObject *object_values, PyObject *names, native_shown *shown) {
  return (placements == Py_None || native_read_placements(placements, &shown->placements, &shown->placement_count)) &&
         (object_values == Py_None || read_object_values(object_values, shown)) &&
         (names == Py_None || read_names(names, shown));
}

enum { SCENE, WORLD_FROM_SCENE, TIME, PLACEMENTS, OBJECT_VALUES, NAMES, KEYS };

/* Reads another scene; `value` receives the values of its keys, which the caller drops. */
static bool read_values(const native_state *state, PyObject *dict, double time, PyObject *value[KEYS],
                        native_shown *shown) {
  static const char *const keys[KEYS] = {"scene", "world_from_scene", "time", "placements", "object_values", "names"};
  Py_ssize_t found = 0;
  if (!dict || !PyMapping_Check(dict))
    return PyErr_Format(PyExc_TypeError, "others: expected dictionaries");
  for (int i = 0; i < KEYS; i++) {
    const int given = PyMapping_HasKeyString(dict, keys[i]);
    value[i] = given ? PyMapping_GetItemString(dict, keys[i]) : Py_NewRef(Py_None);
    found += given;
    if (!value[i])
      return false;
  }
  if (!PyObject_TypeCheck(value[SCENE], state->types[SCENE_TYPE]))
    return PyErr_Format(PyExc_TypeError, "others: expected what pags.load returned as \"scene\"");
  if (PyMapping_Size(dict) != found)
    return PyErr_Format(PyExc_ValueError,
                        "others: expected scene, world_from_scene, time, placements, object_values and names, and "
                        "nothing else");
  shown->scene = Py_NewRef(value[SCENE]);
  shown->time = time;
  if (value[WORLD_FROM_SCENE] != Py_None &&
      !native_read_pose(value[WORLD_FROM_SCENE], "others: world_from_scene", shown->world_from_scene))
    return false;
  if (pags_affine_check(shown->world_from_scene, "others: world_from_scene") != PAGS_OK)
    return native_raise_value(PyExc_ValueError);
  return (value[TIME] == Py_None || native_read_finite(value[TIME], "others: time", &shown->time)) &&
         read_drawn(value[PLACEMENTS], value[OBJECT_VALUES], value[NAMES], shown);
}

static bool read_other(const native_state *state, PyObject *dict, double time, native_shown *shown) {
  PyObject *value[KEYS] = {NULL};
  const bool good = read_values(state, dict, time, value, shown);
  for (int i = 0; i < KEYS; i++)
    Py_XDECREF(value[i]);
  return good;
}

/* Numbers the Gaussians and labels of all scenes, one scene after another. */
static bool number(const native_state *state, native_contents *contents) {
  int64_t gaussians = 0, labels = 0;
  for (int i = 0; i < contents->shown_count; i++)
    if (!native_lock_check(&scene_of(&contents->shown[i])->lock, state, "Scene"))
      return false;
  for (int i = 0; i < contents->shown_count; i++) {
    native_shown *const shown = &contents->shown[i];
    const pags_composition *const c = scene_of(shown)->composition;
    shown->id_base = (int32_t)gaussians;
    shown->label_base = labels;
    gaussians += pags_composition_gaussian_count(c);
    labels += shown->placements ? shown->placement_count : pags_composition_scene(c)->object_count + 1;
    if (gaussians > INT32_MAX - 63)
      return native_raise(state, pags_fail(PAGS_ERROR_LIMIT,
                                           "the scenes have more than the 2^31 - 64 Gaussians that can be rendered at "
                                           "once"));
  }
  return true;
}

bool native_contents_read(const native_state *state, PyObject *scene, const native_contents_arguments *w, double time,
                          native_contents *out) {
  const bool list = PySequence_Check(w->others) && !PyUnicode_Check(w->others);
  const Py_ssize_t others = w->others == Py_None ? 0 : list ? PySequence_Size(w->others) : -1;
  if (others < 0) {
    if (!list)
      PyErr_Format(PyExc_TypeError, "others: expected a sequence of dictionaries, found %.80R", w->others);
    return false;
  }
  out->shown = others < 65536 ? calloc((size_t)others + 1, sizeof *out->shown) : NULL;
  if (!out->shown)
    return PyErr_NoMemory();
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  for (Py_ssize_t i = 0; i <= others; i++)
    memcpy(out->shown[i].world_from_scene, identity, sizeof identity);
  out->shown_count = 1;
  out->shown[0].scene = Py_NewRef(scene);
  out->shown[0].time = time;
  if (!read_drawn(w->placements, w->object_values, w->names, &out->shown[0]))
    return false;
  for (Py_ssize_t i = 0; i < others; i++) {
    NATIVE_OWNED PyObject *dict = PySequence_GetItem(w->others, i);
    const bool good = read_other(state, dict, time, &out->shown[out->shown_count]);
    out->shown_count += out->shown[out->shown_count].scene != NULL;
    if (!good)
      return false;
  }
  return number(state, out);
}

void native_contents_free(native_contents *contents) {
  for (int i = 0; i < contents->shown_count; i++) {
    native_shown *const shown = &contents->shown[i];
    for (int64_t k = 0; shown->names && k < shown->placement_count; k++)
      free(shown->names[k]);
    Py_DECREF(shown->scene);
    free(shown->names);
    free(shown->placements);
    free(shown->object_values);
  }
  for (int i = 0; i < contents->colour_count; i++)
    pags_port_aligned_free(contents->colours[i]);
  free(contents->colours);
  free(contents->parts);
  free(contents->shown);
  *contents = (native_contents){0};
}

/* ---- Locks ---- */

/* The scene of the job with the lowest address above `last`, or NULL. */
static native_scene *next_scene(const native_job *job, const native_scene *last) {
  native_scene *next = NULL;
  for (int i = 0; i < job->contents.shown_count; i++) {
    native_scene *scene = scene_of(&job->contents.shown[i]);
    if ((uintptr_t)scene > (uintptr_t)last && (!next || (uintptr_t)scene < (uintptr_t)next))
      next = scene;
  }
  return next;
}

void native_job_lock(const native_job *job, bool lock) {
  for (native_scene *scene = next_scene(job, NULL); scene; scene = next_scene(job, scene))
    if (lock)
      pthread_mutex_lock(&scene->lock.mutex);
    else
      pthread_mutex_unlock(&scene->lock.mutex);
}

/* ---- Parts ---- */

/* Whether the scene of contents i is composed again at another time after it, so that colours which change with time
 * have to be copied. */
static bool is_shown_again(const native_contents *contents, int i) {
  const native_shown *const shown = contents->shown;
  for (int k = i + 1; k < contents->shown_count; k++)
    if (shown[k].scene == shown[i].scene && shown[k].time != shown[i].time)
      return true;
  return false;
}

static pags_result keep_colours(native_contents *contents, pags_part *part) {
  const pags_gaussians *const g = part->gaussians;
  const size_t bytes = (size_t)g->stride * 3 * (size_t)pags_sh_coefficients(g->sh_degree) * sizeof(float);
  float **grown = realloc(contents->colours, (size_t)(contents->colour_count + 1) * sizeof *grown);
  float *copy = grown ? pags_port_aligned_alloc(64, bytes) : NULL;
  contents->colours = grown ? grown : contents->colours;
  PAGS_CHECK_MEMORY(copy, "the colours of a scene that is shown at two times");
  memcpy(copy, part->sh, bytes);
  part->sh = contents->colours[contents->colour_count++] = copy;
  return PAGS_OK;
}

/* Transforms the parts of a scene other than the first from its own origin to the frame. */
static void bring_in(const native_job *job, const native_shown *shown, pags_part *parts, int count) {
  const pags_frame_options own = pags_composition_options(scene_of(shown)->composition);
  double frame_from_scene[12];
  memcpy(frame_from_scene, shown->world_from_scene, sizeof frame_from_scene);
  for (int k = 0; k < 3; k++) {
    double *row = frame_from_scene + 4 * k;
    row[3] += pags_dot3(row, own.origin) - job->options.origin[k];
  }
  for (int p = 0; p < count; p++) {
    pags_rigid_multiply(frame_from_scene, parts[p].world_from_model, parts[p].world_from_model);
    parts[p].id_base = shown->id_base;
    parts[p].low_pass = fmaxf(own.low_pass, FLT_MIN); /* as trained, like antialiasing */
    parts[p].antialiased = job->antialiased < 0 ? (own.antialiased ? 1 : -1) : 0;
  }
}

pags_result native_contents_compose(const native_job *job, native_contents *contents) {
  contents->part_count = 0;
  for (int i = 0; i < contents->shown_count; i++) {
    const native_shown *shown = &contents->shown[i];
    pags_composition *c = scene_of(shown)->composition;
    const pags_part *own;
    int count;
    if (shown->placements)
      PAGS_TRY(pags_compose_placed(c, shown->time, shown->placements, shown->placement_count, &own, &count));
    else
      pags_compose(c, shown->time, &own, &count);
    if (count > INT32_MAX - 1 - contents->part_count)
      return pags_fail(PAGS_ERROR_LIMIT, "the scenes have more parts than can be drawn at once");
    pags_part *parts = realloc(contents->parts, (size_t)(contents->part_count + count + 1) * sizeof *parts);
    PAGS_CHECK_MEMORY(parts, "the parts of a scene");
    contents->parts = parts;
    parts += contents->part_count;
    if (count > 0)
      memcpy(parts, own, (size_t)count * sizeof *parts);
    const bool again = is_shown_again(contents, i);
    for (int p = 0; p < count; p++) {
      if (again && parts[p].sh)
        PAGS_TRY(keep_colours(contents, &parts[p]));
      const int64_t label = parts[p].label < 0 ? pags_composition_scene(c)->object_count : parts[p].label;
      parts[p].label = shown->label_base + label;
    }
    if (i > 0)
      bring_in(job, shown, parts, count);
    contents->part_count += count;
  }
  return PAGS_OK;
}
