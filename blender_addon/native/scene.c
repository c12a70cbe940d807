/* SPDX-License-Identifier: Apache-2.0 */
/* Scene: a composition with its lock, its contents as Python values, and a sample of its Gaussians as points. */
#include "blender_addon/native/native.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec3.h"
#include "maths/maths.h"
#include "scene/axes.h"
#include "scene/filter.h"
#include "scene/packed_rows.h"

enum { ROWS = PAGS_PACKED_ROWS }; /* rows read at a time: the size of a packed cluster */

native_scene *native_scene_create(PyTypeObject *type) {
  native_scene *self = native_allocate(type);
  if (!self || native_lock_create(&self->lock))
    return self;
  Py_DECREF(self);
  return NULL;
}

/* Reads a scene and applies rules of clean-up and look; the caller destroys the scene, also after a failure. */
static pags_result load_edited(const char *path, const char *edits, pags_scene *scene) {
  PAGS_TRY(pags_scene_load(path, scene));
  return pags_scene_cleanup(scene, "edits", edits);
}

static pags_result load(const char *path, const char *edits, native_scene *self) {
  const pags_part *parts;
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  int count;
  if (edits) {
    PAGS_TRY(load_edited(path, edits, &scene));
    PAGS_TRY(pags_composition_create(&scene, &self->composition));
  } else {
    PAGS_TRY(pags_composition_load(path, &self->composition));
  }
  pags_compose(self->composition, (double)NAN, &parts, &count);
  self->alpha_min = count > 0 ? parts[0].gaussians->alpha_min : 0;
  return PAGS_OK;
}

PyObject *native_scene_load(PyObject *module, PyObject *arguments) {
  native_state *state = PyModule_GetState(module);
  PyObject *file, *rules = Py_None;
  NATIVE_OWNED PyObject *bytes = NULL;
  const char *edits = NULL;
  if (!PyArg_ParseTuple(arguments, "O|O:load", &file, &rules) ||
      (rules != Py_None && !native_read_word(rules, "edits", &edits)) || !native_read_path(file, "path", &bytes))
    return NULL;
  NATIVE_OWNED PyObject *scene = (PyObject *)native_scene_create(state->types[SCENE_TYPE]);
  pags_result result;
  if (!scene)
    return NULL;
  const char *path = PyBytes_AsString(bytes);
  Py_BEGIN_ALLOW_THREADS result = load(path, edits, (native_scene *)scene);
  Py_END_ALLOW_THREADS return result == PAGS_OK ? pags_take(&scene) : native_raise(state, result);
}

static pags_result write_edited(const char *path, const char *edits, const char *folder) {
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_TRY(load_edited(path, edits, &scene));
  return pags_scene_save(folder, &scene);
}

PyObject *native_write_edited(PyObject *module, PyObject *arguments) {
  PyObject *file, *rules, *out;
  NATIVE_OWNED PyObject *from = NULL, *to = NULL;
  const char *edits;
  pags_result result;
  if (!PyArg_ParseTuple(arguments, "OOO:write_edited", &file, &rules, &out) ||
      !native_read_word(rules, "edits", &edits) || !native_read_path(file, "path", &from) ||
      !native_read_path(out, "folder", &to))
    return NULL;
  const char *path = PyBytes_AsString(from), *folder = PyBytes_AsString(to);
  Py_BEGIN_ALLOW_THREADS result = write_edited(path, edits, folder);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) return native_raise(PyModule_GetState(module), result);
  Py_RETURN_NONE;
}

static void scene_dealloc(PyObject *object) {
  native_scene *self = (native_scene *)object;
  if (native_lock_is_alive(&self->lock)) /* else a thread of another process was modifying it */
    pags_composition_destroy(self->composition);
  native_lock_destroy(&self->lock);
  free(self->object_of);
  free(self->priority_of);
  free(self->size_of);
  native_deallocate(object);
}

/* ---- Tables by id ---- */

static void *allocate(const native_scene *scene) {
  return malloc(4 * ((size_t)pags_composition_gaussian_count(scene->composition) + 1));
}

static const char tables[] = "a table of the scene's Gaussians";

pags_result native_scene_need_objects(native_scene *scene) {
  if (scene->object_of)
    return PAGS_OK;
  scene->object_of = allocate(scene);
  PAGS_CHECK_MEMORY(scene->object_of, tables);
  pags_composition_objects(scene->composition, scene->object_of);
  return PAGS_OK;
}

pags_result native_scene_need_priorities(native_scene *scene) {
  if (scene->priority_of)
    return PAGS_OK;
  scene->priority_of = allocate(scene);
  PAGS_CHECK_MEMORY(scene->priority_of, tables);
  pags_composition_priorities(scene->composition, scene->priority_of); /* zeros for models without priorities */
  return PAGS_OK;
}

/* Geometry of up to ROWS Gaussians from row ROWS * block on, as planes of distance `*stride` floats. The rows of packed
 * parts are unpacked into `unpacked`, which has room for PAGS_SH planes of ROWS floats. */
static const float *read_geometry(const pags_part *part, int64_t block, float *unpacked, int64_t *stride) {
  *stride = part->packed ? ROWS : part->gaussians->stride;
  if (!part->packed)
    return part->gaussians->data + ROWS * block;
  pags_packed_geometry(part->packed, block, unpacked);
  return unpacked;
}

static void fill_sizes(const pags_part *part, float *size_of) {
  float unpacked[PAGS_SH * ROWS];
  const int64_t count = part->gaussians->count;
  for (int64_t first = 0; first < count; first += ROWS) {
    int64_t stride;
    const float *const planes = read_geometry(part, first / ROWS, unpacked, &stride);
    for (int64_t i = first; i < count && i < first + ROWS; i++) {
      float largest = planes[PAGS_SCALE * stride + i - first];
      for (int k = 1; k < 3; k++)
        largest = fmaxf(largest, planes[(PAGS_SCALE + k) * stride + i - first]);
      size_of[part->id ? part->id[i] : part->first_id + (int32_t)i] = pags_expf(largest);
    }
  }
}

/* The parts of an object (-1: of the background), in the frame of the object. */
static pags_result parts_of(native_scene *scene, int64_t object, const pags_part **parts, int *count) {
  pags_placement placement = {.object = object, .world_from_object = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const double *origin = pags_composition_scene(scene->composition)->origin;
  if (object >= 0)
    pags_pose_place(placement.world_from_object, origin); /* cancels the composition's shift to the origin */
  return pags_compose_placed(scene->composition, (double)NAN, &placement, 1, parts, count);
}

pags_result native_scene_need_sizes(native_scene *scene) {
  if (scene->size_of)
    return PAGS_OK;
  PAGS_AUTOFREE float *sizes = allocate(scene);
  PAGS_CHECK_MEMORY(sizes, tables);
  for (int64_t o = -1; o < pags_composition_scene(scene->composition)->object_count; o++) {
    const pags_part *parts;
    int count;
    PAGS_TRY(parts_of(scene, o, &parts, &count));
    for (int p = 0; p < count; p++)
      fill_sizes(&parts[p], sizes);
  }
  scene->size_of = pags_take(&sizes);
  return PAGS_OK;
}

/* ---- What the scene holds ---- */

static const pags_scene *scene_of(PyObject *self) {
  return pags_composition_scene(((native_scene *)self)->composition);
}

static PyObject *text_or_none(const char *text) {
  return text ? PyUnicode_DecodeUTF8(text, (Py_ssize_t)strlen(text), "replace") : Py_NewRef(Py_None);
}

/* The same for a file name, as os.fsencode decodes it back. */
static PyObject *name_or_none(const char *text) {
  return text ? native_text(text) : Py_NewRef(Py_None);
}

static PyObject *scene_info(PyObject *self, PAGS_UNUSED void *closure) {
  const pags_scene *s = scene_of(self);
  const pags_composition *c = ((native_scene *)self)->composition;
  return Py_BuildValue("{s:L,s:n,s:N,s:s,s:d,s:d,s:d,s:d,s:N,s:N,s:L,s:L,s:N,s:N}", "gaussians",
                       (long long)pags_composition_gaussian_count(c), "bytes", (Py_ssize_t)pags_composition_bytes(c),
                       "origin", native_numbers(s->origin, 3), "up", pags_up_code(s->up), "time_begin", s->time_begin,
                       "time_end", s->time_end, "fps", s->fps, "alpha_min", (double)((native_scene *)self)->alpha_min,
                       "antialiased", PyBool_FromLong(s->antialiased), "sky", PyBool_FromLong(s->sky.size > 0),
                       "models", (long long)s->model_count, "iterations", (long long)s->iterations, "dataset",
                       name_or_none(s->dataset), "config", text_or_none(s->config));
}

static PyObject *object_dict(const void *context, int64_t index) {
  native_scene *self = (native_scene *)(uintptr_t)context;
  const pags_scene_object *o = &pags_composition_scene(self->composition)->objects[index];

  /* The number of Gaussians that one placement of the object draws. */
  const pags_part *parts;
  int count;
  long long gaussians = 0;
  if (!native_lock_check(&self->lock, native_state_of((PyObject *)self), "Scene"))
    return NULL;
  pthread_mutex_lock(&self->lock.mutex); /* not while Python objects are made: those may destroy jobs, which wait */
  if (parts_of(self, index, &parts, &count) != PAGS_OK)
    count = 0;
  for (int p = 0; p < count; p++)
    gaussians += parts[p].gaussians->count;
  pthread_mutex_unlock(&self->lock.mutex);
  return Py_BuildValue("{s:N,s:N,s:s,s:N,s:N,s:N,s:N,s:N,s:L}", "id", text_or_none(o->record.id), "class",
                       text_or_none(o->record.class_name), "category", pags_category_name(o->record.category),
                       "critical", PyBool_FromLong(o->critical), "moving", PyBool_FromLong(o->record.moving), "rigid",
                       PyBool_FromLong(o->rigid), "size", native_numbers(o->record.size, 3), "tracked",
                       PyBool_FromLong(o->model >= 0), "gaussians", gaussians);
}

static PyObject *scene_objects(PyObject *self, PAGS_UNUSED void *closure) {
  return native_list(scene_of(self)->object_count, object_dict, self);
}

static PyObject *view_dict(const void *context, int64_t index) {
  const pags_scene_view *view = &((const pags_scene *)context)->views[index];
  NATIVE_OWNED PyObject *dict = native_camera_dict(&view->camera);
  const bool good = dict && native_put(dict, "name", name_or_none(view->name)) &&
                    native_put(dict, "test", PyBool_FromLong(view->test)) &&
                    native_put(dict, "sensor", PyLong_FromLong(view->sensor)) &&
                    native_put(dict, "frame", PyLong_FromLong(view->frame)) &&
                    native_put(dict, "gain", native_numbers(view->gain, 3)) &&
                    native_put(dict, "offset", native_numbers(view->offset, 3));
  return good ? pags_take(&dict) : NULL;
}

static PyObject *scene_views(PyObject *self, PAGS_UNUSED void *closure) {
  return native_list(scene_of(self)->view_count, view_dict, scene_of(self));
}

/* Reads an object index (-1: background). Raises and returns -2 where it is not valid. */
static int64_t read_object(PyObject *self, PyObject *value, int64_t least) {
  const int64_t count = scene_of(self)->object_count;
  long long object = -2;
  if (!native_read_integer(value, "object", LLONG_MIN, LLONG_MAX, &object) && !PyErr_ExceptionMatches(PyExc_ValueError))
    return -2;
  if (!PyErr_Occurred() && object >= least && object < count)
    return object;
  PyErr_Clear();
  PyErr_Format(PyExc_IndexError, "object: the scene has %lld objects; there is no number %.80R", (long long)count,
               value);
  return -2;
}

static PyObject *scene_pose(PyObject *self, PyObject *arguments) {
  const pags_composition *c = ((native_scene *)self)->composition;
  PyObject *number, *when;
  double time, pose[12];
  if (!PyArg_ParseTuple(arguments, "OO:pose", &number, &when))
    return NULL;
  int64_t object = read_object(self, number, 0);
  if (object < 0 || !native_read_finite(when, "time", &time))
    return NULL;
  if (!pags_composition_is_tracked(c, object))
    pags_composition_rest_pose(c, object, pose);
  else if (!pags_object_pose(&scene_of(self)->objects[object].record, time, pose))
    Py_RETURN_NONE;
  return native_numbers(pose, 12);
}

static PyObject *scene_exposure(PyObject *self, PyObject *arguments) {
  PyObject *number, *when;
  long long sensor;
  double time, values[6];
  if (!PyArg_ParseTuple(arguments, "OO:exposure", &number, &when) ||
      !native_read_integer(number, "sensor", INT_MIN, INT_MAX, &sensor) || !native_read_finite(when, "time", &time))
    return NULL;
  pags_scene_exposure(scene_of(self), (int)sensor, time, values, values + 3);
  return native_numbers(values, 6);
}

static PyObject *scene_track(PyObject *self, PyObject *arguments) {
  PyObject *number;
  if (!PyArg_ParseTuple(arguments, "O:track", &number))
    return NULL;
  int64_t object = read_object(self, number, 0);
  if (object < 0)
    return NULL;
  const pags_object *record = &scene_of(self)->objects[object].record;
  double *rows = malloc((size_t)record->keyframe_count * 13 * sizeof *rows);
  if (!rows)
    return PyErr_NoMemory();
  for (int64_t i = 0; i < record->keyframe_count; i++) {
    rows[13 * i] = record->keyframes[i].time;
    pags_object_pose(record, record->keyframes[i].time, rows + 13 * i + 1);
  }
  const Py_ssize_t shape[2] = {(Py_ssize_t)record->keyframe_count, 13};
  return native_buffer_own(native_state_of(self), rows, 'd', 2, shape);
}

/* ---- A sample as points ---- */

/* SH coefficients of degree 0 of the rows that read_geometry gave, as planes of distance `*stride` floats; where colour
 * changes over time, those of the scene's begin. `unpacked` has room for 3 planes of ROWS floats. */
static const float *read_colours(const pags_part *part, int64_t block, float *unpacked, int64_t *stride) {
  *stride = part->packed ? ROWS : part->gaussians->stride;
  if (!part->packed)
    return (part->sh ? part->sh : pags_plane(part->gaussians, PAGS_SH)) + ROWS * block;
  pags_packed_colours(part->packed, block, 0, unpacked);
  return unpacked;
}

static void put_color(const float *dc, int64_t stride, float *color) {
  for (int c = 0; c < 3; c++) {
    float v = 0.5f + 0.28209479f * dc[c * stride];
    v = v > 0 ? (v < 1 ? v : 1) : 0; /* NaN: 0 */
    color[c] = v <= 0.04045f ? v / 12.92f : pags_powf((v + 0.055f) / 1.055f, 2.4f);
  }
  color[3] = 1;
}

/* Counts of visible Gaussians (opacity of 0.2 or more): all, visited, sampled, and the maximum to sample. */
typedef struct sampling {
  int64_t visible, seen, taken, most;
} sampling;

/* One pass over a part: counts its visible Gaussians or, with `points`, takes every n-th of them. Gaussians are in
 * Morton order, so that the sample covers the surface evenly. */
static void sample_part(const pags_part *part, sampling *s, float *points, float *colors) {
  float geometry[PAGS_SH * ROWS], colour[3 * ROWS];
  const int64_t count = part->gaussians->count;
  for (int64_t first = 0; first < count; first += ROWS) {
    int64_t stride, colour_stride = 0;
    const float *const planes = read_geometry(part, first / ROWS, geometry, &stride), *dc = NULL;
    for (int64_t i = 0; i < ROWS && first + i < count; i++) {
      if (1 / (1 + pags_expf(-planes[PAGS_OPACITY * stride + i])) < 0.2f)
        continue;
      if (!points) {
        s->visible++;
        continue;
      }
      if ((s->visible <= s->most || (s->seen * s->most) / s->visible >= s->taken) && s->taken < s->most) {
        dc = dc ? dc : read_colours(part, first / ROWS, colour, &colour_stride);

        /* Its mean and colour. */
        const float *mean = planes + PAGS_MEAN * stride + i;
        double p[3] = {(double)mean[0], (double)mean[stride], (double)mean[2 * stride]}, moved[3];
        pags_rigid_point(part->world_from_model, p, moved);
        pags_narrow3(moved, points + 3 * s->taken);

        put_color(dc + i, colour_stride, colors + 4 * s->taken);
        s->taken++;
      }
      s->seen++;
    }
  }
}

static PyObject *scene_points(PyObject *object, PyObject *arguments) {
  native_scene *self = (native_scene *)object;
  native_state *state = native_state_of(object);
  PyObject *number, *limit;
  long long budget;
  if (!PyArg_ParseTuple(arguments, "OO:points", &number, &limit))
    return NULL;
  int64_t which = read_object(object, number, -1);
  if (which < -1 || !native_read_integer(limit, "budget", LLONG_MIN, LLONG_MAX, &budget) ||
      !native_lock_check(&self->lock, state, "Scene"))
    return NULL;
  int64_t most = pags_composition_gaussian_count(self->composition);
  budget = budget < 1 ? 1 : budget < most ? budget : most;
  PAGS_AUTOFREE float *points = malloc((size_t)(budget + 1) * 3 * sizeof *points);
  PAGS_AUTOFREE float *colors = malloc((size_t)(budget + 1) * 4 * sizeof *colors);
  sampling s = {.most = budget};
  pags_result result = points && colors ? PAGS_OK : pags_out_of_memory("a sample");
  Py_BEGIN_ALLOW_THREADS pthread_mutex_lock(&self->lock.mutex);
  const pags_part *parts;
  int count = 0;
  if (result == PAGS_OK)
    result = parts_of(self, which, &parts, &count);
  for (int p = 0; p < count && result == PAGS_OK; p++)
    sample_part(&parts[p], &s, NULL, NULL);
  for (int p = 0; p < count && result == PAGS_OK; p++)
    sample_part(&parts[p], &s, points, colors);
  pthread_mutex_unlock(&self->lock.mutex);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) return native_raise(state, result);
  const Py_ssize_t point_shape[2] = {(Py_ssize_t)s.taken, 3}, color_shape[2] = {(Py_ssize_t)s.taken, 4};
  return Py_BuildValue("(NN)", native_buffer_own(state, pags_take(&points), 'f', 2, point_shape),
                       native_buffer_own(state, pags_take(&colors), 'f', 2, color_shape));
}

static PyObject *scene_repr(PyObject *object) {
  const pags_composition *c = ((native_scene *)object)->composition;
  const pags_scene *s = pags_composition_scene(c);
  return PyUnicode_FromFormat("<pags.Scene of %lld Gaussians, %lld objects, %lld views>",
                              (long long)pags_composition_gaussian_count(c), (long long)s->object_count,
                              (long long)s->view_count);
}

#define SCENE_DOC                                                                                                      \
  "Scene(means, quats, scales, opacities, sh, *, priorities=None, antialiased=False, alpha_min=0, background=(0, 0, "  \
  "0), origin=None, up='-y')\n--\n\n"                                                                                  \
  "A scene ready for drawing: of arrays, or by load(path) of files.\n\n"                                               \
  "means [n][3] (metres, relative to origin), quats [n][4] (w, x, y, z, of any length), scales [n][3] (ln sigma, not " \
  "sigma), opacities [n] (logits), sh [n][k][3] (spherical harmonics, k of 1, 4, 9 or 16: colour = 0.5 + 0.2821 "      \
  "sh[0] + ..., sRGB), priorities [n] (0 to 1). Arrays are numpy's, anything else with the buffer protocol, or "       \
  "nested lists; they are copied. antialiased: as Mip-Splatting. alpha_min: the least alpha that is drawn, 0: 1/255. " \
  "origin None: 0; if the means lose digits as floats and most lie beyond 4096 m along an axis, whole metres, taken "  \
  "off them."

static PyGetSetDef scene_getset[] = {
    {"info", scene_info, NULL,
     "dictionary: gaussians, bytes, alpha_min, origin, up, time_begin, time_end, fps, sky, ...", NULL},
    {"objects", scene_objects, NULL,
     "list of dictionaries: id, class, category, critical, moving, tracked, size, gaussians", NULL},
    {"views", scene_views, NULL, "list of cameras with name, test, sensor, frame, gain, offset", NULL},
    {"object_of", native_scene_object_of, NULL, "Buffer [n] int32: the object of each Gaussian, -1: none", NULL},
    {0}};
static PyMethodDef scene_methods[] = {
    {"pose", scene_pose, METH_VARARGS,
     "pose($self, object, time, /)\n--\n\n12 numbers, world_from_object, metres; of a parked object always its rest "
     "pose; None where a tracked one isn't there."},
    {"exposure", scene_exposure, METH_VARARGS,
     "exposure($self, sensor, time, /)\n--\n\nGain and offset, 6 numbers: how that camera of the rig exposes at that "
     "time."},
    {"track", scene_track, METH_VARARGS,
     "track($self, object, /)\n--\n\nBuffer [keyframes][13]: time and world_from_object at each label."},
    {"points", scene_points, METH_VARARGS,
     "points($self, object, budget, /)\n--\n\nAn even sample of at most `budget` Gaussians in the object's frame; "
     "object "
     "-1: what belongs to none, relative to the scene's origin. Buffer [n][3] metres, Buffer [n][4] linear RGBA."},
    {"arrays", native_scene_arrays, METH_NOARGS,
     "arrays($self, /)\n--\n\nAll Gaussians in the order of their ids, as Scene takes them: a dictionary of Buffers "
     "means, quats, scales, opacities, sh and, if they are known, priorities. Means are relative to info['origin'], of "
     "objects that follow a track (object_of) in the object's frame. Colours that change over time: their mean."},
    {"normals", native_scene_normals, METH_NOARGS,
     "normals($self, /)\n--\n\nBuffer [n][3]: the direction of each Gaussian's shortest axis, of length 1; which way "
     "round is left open."},
    {"save", native_scene_save, METH_VARARGS,
     "save($self, path, /)\n--\n\nWrites the Gaussians as .ply (all bits) or .pagsz (packed). Not of scenes whose "
     "objects follow tracks."},
    {0}};
static PyType_Slot scene_slots[] = {{Py_tp_new, native_scene_new},
                                    {Py_tp_dealloc, scene_dealloc},
                                    {Py_tp_repr, scene_repr},
                                    {Py_tp_getset, scene_getset},
                                    {Py_tp_methods, scene_methods},
                                    {Py_tp_doc, SCENE_DOC},
                                    {0, NULL}};
PyType_Spec native_scene_spec = {
    .name = "pags.Scene", .basicsize = sizeof(native_scene), .flags = Py_TPFLAGS_DEFAULT, .slots = scene_slots};
