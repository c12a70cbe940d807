/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians as arrays: scenes from arrays, arrays from scenes, and files of them. Units are those of splat files (ln
 * sigma, logits), so that a round trip keeps all bits; names and shapes are gsplat's (Ye et al. 2025). */
#include "blender_addon/native/native.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>

#include "base/file.h"
#include "base/text.h"
#include "base/vec3.h"
#include "scene/axes.h"
#include "scene/splat_formats.h"

/* ---- From arrays ---- */

/* The arrays of a scene: destination and shape of a row. */
enum { MEANS, QUATS, SCALES, OPACITIES, SH, ARRAYS };
static const struct {
  const char *name;
  int plane, planes; /* planes 0: the number of harmonics */
} arrays[ARRAYS] = {[MEANS] = {"means", PAGS_MEAN, 3},
                    [QUATS] = {"quats", PAGS_ROTATION, 4},
                    [SCALES] = {"scales", PAGS_SCALE, 3},
                    [OPACITIES] = {"opacities", PAGS_OPACITY, 1},
                    [SH] = {"sh", PAGS_SH, 0}};

typedef struct scene_arguments {
  PyObject *array[ARRAYS], *priorities, *background, *origin, *up, *antialiased, *alpha_min; /* NULL: not given */
} scene_arguments;

/* Copies rows of `planes` numbers to planes. Raises and returns false at a non-finite number. */
static bool fill_planes(const char *name, const float *from, int planes, pags_gaussians *g, int plane) {
  for (int64_t i = 0; i < g->count; i++)
    for (int p = 0; p < planes; p++) {
      const float value = from[i * planes + p];
      if (!isfinite(value))
        return PyErr_Format(PyExc_ValueError, "%s: row %lld: expected finite numbers of float32's range", name,
                            (long long)i);
      pags_plane(g, plane + p)[i] = value;
    }
  return true;
}

static bool fill_priorities(PyObject *value, pags_gaussians *g) {
  Py_ssize_t shape[1] = {(Py_ssize_t)g->count};
  PAGS_AUTOFREE float *from = native_read_array(value, "priorities", false, 1, shape);
  if (!from)
    return false;
  if (pags_gaussians_add_s_sem(g) != PAGS_OK)
    return PyErr_NoMemory();
  for (int64_t i = 0; i < g->count; i++) {
    if (!(from[i] >= 0 && from[i] <= 1))
      return PyErr_Format(PyExc_ValueError, "priorities: row %lld: expected a number from 0 to 1", (long long)i);
    g->s_sem[i] = from[i];
  }
  return true;
}

/* Creates `g` with the SH degree of an array [n][k][3], whose numbers `first` receives. */
static bool create_gaussians(const scene_arguments *w, Py_ssize_t rows, float **first, pags_gaussians *g) {
  Py_ssize_t shape[3] = {rows, -1, 3};
  int degree = 0;
  *first = native_read_array(w->array[SH], arrays[SH].name, false, 3, shape);
  if (!*first)
    return false;
  while (degree < 3 && pags_sh_coefficients(degree) < shape[1])
    degree++;
  if (pags_sh_coefficients(degree) != shape[1])
    return PyErr_Format(PyExc_ValueError, "sh: expected [n][k][3] with k of 1, 4, 9 or 16 harmonics, found k = %zd",
                        shape[1]);
  return pags_gaussians_create(g, rows, degree) == PAGS_OK || native_raise_value(PyExc_MemoryError);
}

/* Finds the origin (scene/splat_formats.h) of an axis of the means, by up to 1,024 of their rows; 0 if floats lose no
 * digit. */
static double origin_of(const double *means, Py_ssize_t rows, int axis) {
  enum { MOST = 1024 };
  double values[MOST];
  bool lost = false;
  const int count = rows < MOST ? (int)rows : MOST;
  for (int i = 0; i < count; i++) {
    values[i] = means[3 * (Py_ssize_t)((double)rows / count * i) + axis];
    lost = lost || (double)(float)values[i] != values[i];
  }
  return lost ? pags_large_origin(values, count) : 0;
}

/* Reads the means as floats, which the caller frees. Large means may get an origin if the caller gives none. */
static float *read_means(const scene_arguments *w, Py_ssize_t shape[2], double origin[3]) {
  PAGS_AUTOFREE double *means = native_read_array(w->array[MEANS], arrays[MEANS].name, true, 2, shape);
  if (!means)
    return NULL;
  float *const floats = malloc((size_t)(3 * shape[0]) * sizeof *floats + 1);
  if (!floats)
    return (float *)PyErr_NoMemory();
  for (int k = 0; k < 3 && w->origin == Py_None; k++)
    origin[k] = origin_of(means, shape[0], k);
  for (Py_ssize_t i = 0; i < 3 * shape[0]; i++)
    floats[i] = (float)(means[i] - (w->origin == Py_None ? origin[i % 3] : 0));
  return floats;
}

static bool fill_gaussians(const scene_arguments *w, pags_gaussians *g, double origin[3]) {
  Py_ssize_t rows = -1;
  PAGS_AUTOFREE float *sh = NULL;
  for (int a = 0; a < SH; a++) {
    Py_ssize_t shape[2] = {rows, arrays[a].planes};
    PAGS_AUTOFREE float *from =
        a == MEANS ? read_means(w, shape, origin)
                   : native_read_array(w->array[a], arrays[a].name, false, a == OPACITIES ? 1 : 2, shape);
    rows = shape[0];
    if (!from || (a == MEANS && !create_gaussians(w, rows, &sh, g)) ||
        !fill_planes(arrays[a].name, from, arrays[a].planes, g, arrays[a].plane))
      return false;
  }
  for (int64_t i = 0; i < g->count; i++) {
    bool any = false;
    for (int k = 0; k < 4; k++)
      any = any || pags_plane(g, PAGS_ROTATION + k)[i] != 0;
    if (!any)
      return PyErr_Format(PyExc_ValueError, "quats: row %lld: expected a quaternion (w, x, y, z), found zeros",
                          (long long)i);
  }
  return fill_planes(arrays[SH].name, sh, 3 * pags_sh_coefficients(g->sh_degree), g, PAGS_SH) &&
         (w->priorities == Py_None || fill_priorities(w->priorities, g));
}

static bool fill_scene(const scene_arguments *w, pags_scene *scene) {
  double background[3] = {0, 0, 0}, alpha_min = 0;
  const char *up = "-y";
  bool antialiased = false;
  if (!native_read_word(w->up, "up", &up) || !native_read_finite(w->alpha_min, "alpha_min", &alpha_min) ||
      !native_read_flag(w->antialiased, "antialiased", &antialiased))
    return false;
  if (!pags_up_from_code(up, &scene->up))
    return PyErr_Format(PyExc_ValueError, "up: expected z, -y, y or unknown, found %s", up);
  if (alpha_min != 0 && !(alpha_min >= (double)PAGS_LEAST_ALPHA_MIN && alpha_min < 1))
    return PyErr_Format(PyExc_ValueError, "alpha_min: expected 0, or a number from 1/255 to 1, found %.80R",
                        w->alpha_min);
  if ((w->background && !native_read_numbers(w->background, "background", 3, background)) ||
      (w->origin != Py_None && !native_read_numbers(w->origin, "origin", 3, scene->origin)))
    return false;
  pags_narrow3(background, scene->background);
  scene->antialiased = antialiased;
  scene->models = calloc(1, sizeof *scene->models);
  if (!scene->models)
    return PyErr_NoMemory();
  scene->model_count = 1;
  pags_model *model = scene->models;
  model->name = pags_text_copy("background");
  model->file = pags_text_copy("background.ply");
  if (!model->name || !model->file)
    return PyErr_NoMemory();
  if (!fill_gaussians(w, &model->gaussians, scene->origin))
    return false;
  model->gaussians.alpha_min = (float)alpha_min;
  return true;
}

PyObject *native_scene_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"means",       "quats",     "scales",     "opacities", "sh", "priorities",
                          "antialiased", "alpha_min", "background", "origin",    "up", NULL};
  scene_arguments w = {.priorities = Py_None, .origin = Py_None};
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOOOO|$OOOOOO:Scene", names, &w.array[MEANS], &w.array[QUATS],
                                   &w.array[SCALES], &w.array[OPACITIES], &w.array[SH], &w.priorities, &w.antialiased,
                                   &w.alpha_min, &w.background, &w.origin, &w.up))
    return NULL;
  NATIVE_OWNED PyObject *object = (PyObject *)native_scene_create(type);
  if (!object || !fill_scene(&w, &scene))
    return NULL;
  native_scene *self = (native_scene *)object;
  self->alpha_min = scene.models->gaussians.alpha_min;
  pags_result result;
  Py_BEGIN_ALLOW_THREADS result = pags_composition_create(&scene, &self->composition);
  Py_END_ALLOW_THREADS return result == PAGS_OK ? pags_take(&object) : native_raise(native_state_of(object), result);
}

/* ---- To arrays ---- */

/* A Buffer [count], or [count][planes], or of harmonics [count][planes / 3][3]. */
static PyObject *rows_of(const native_state *state, const pags_gaussians *g, int array) {
  const bool harmonics = array == SH;
  const int planes = harmonics ? 3 * pags_sh_coefficients(g->sh_degree) : arrays[array].planes;
  float *rows = malloc((size_t)g->count * (size_t)planes * sizeof *rows + 1);
  const Py_ssize_t shape[3] = {(Py_ssize_t)g->count, harmonics ? planes / 3 : planes, 3};
  if (!rows)
    return PyErr_NoMemory();
  for (int p = 0; p < planes; p++)
    for (int64_t i = 0; i < g->count; i++)
      rows[i * planes + p] = g->data[(arrays[array].plane + p) * g->stride + i];
  return native_buffer_own(state, rows, 'f', harmonics ? 3 : planes > 1 ? 2 : 1, shape);
}

static PyObject *priorities_of(const native_state *state, const pags_gaussians *g) {
  const Py_ssize_t shape[1] = {(Py_ssize_t)g->count};
  float *values = malloc((size_t)g->count * sizeof *values + 1);
  if (!values)
    return PyErr_NoMemory();
  memcpy(values, g->s_sem, (size_t)g->count * sizeof *values);
  return native_buffer_own(state, values, 'f', 1, shape);
}

PyObject *native_arrays_dict(const native_state *state, const pags_gaussians *gaussians) {
  NATIVE_OWNED PyObject *dict = PyDict_New();
  bool good = dict != NULL;
  for (int a = 0; good && a < ARRAYS; a++)
    good = native_put(dict, arrays[a].name, rows_of(state, gaussians, a));
  if (good && gaussians->s_sem)
    good = native_put(dict, "priorities", priorities_of(state, gaussians));
  return good ? pags_take(&dict) : NULL;
}

/* All Gaussians by id; raises and returns false if memory is out. */
static bool gather(PyObject *object, pags_gaussians *out) {
  native_scene *self = (native_scene *)object;
  pags_result result;
  if (!native_lock_check(&self->lock, native_state_of(object), "Scene"))
    return false;
  Py_BEGIN_ALLOW_THREADS pthread_mutex_lock(&self->lock.mutex);
  result = pags_composition_gaussians(self->composition, out);
  pthread_mutex_unlock(&self->lock.mutex);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) native_raise(native_state_of(object), result);
  return result == PAGS_OK;
}

PyObject *native_scene_arrays(PyObject *self, PAGS_UNUSED PyObject *unused) {
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  return gather(self, &g) ? native_arrays_dict(native_state_of(self), &g) : NULL;
}

PyObject *native_scene_normals(PyObject *self, PAGS_UNUSED PyObject *unused) {
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  if (!gather(self, &g))
    return NULL;
  float *normals = malloc((size_t)g.count * 3 * sizeof *normals + 1);
  for (int64_t i = 0; normals && i < g.count; i++) {
    double normal[3];
    pags_gaussian_normal(g.data, g.stride, i, normal);
    pags_narrow3(normal, normals + 3 * i);
  }
  const Py_ssize_t shape[2] = {(Py_ssize_t)g.count, 3};
  return normals ? native_buffer_own(native_state_of(self), normals, 'f', 2, shape) : PyErr_NoMemory();
}

PyObject *native_scene_object_of(PyObject *object, PAGS_UNUSED void *closure) {
  native_scene *self = (native_scene *)object;
  const Py_ssize_t shape[1] = {(Py_ssize_t)pags_composition_gaussian_count(self->composition)};
  pags_result result;
  if (!native_lock_check(&self->lock, native_state_of(object), "Scene"))
    return NULL;
  Py_BEGIN_ALLOW_THREADS pthread_mutex_lock(&self->lock.mutex);
  result = native_scene_need_objects(self);
  pthread_mutex_unlock(&self->lock.mutex);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) return native_raise(native_state_of(object), result);
  return native_buffer_new(native_state_of(object), object, self->object_of, 'i', 1, shape);
}

/* ---- To files ---- */

static pags_result save(const char *path, const pags_scene *scene, const pags_gaussians *g, bool packed) {
  PAGS_TRY(pags_ply_check_name(path));
  if (packed) {
    pags_packed head = {.up = (int)scene->up, .antialiased = scene->antialiased};
    pags_copy3(scene->origin, head.origin);
    pags_copy3f(scene->background, head.background);
    return pags_packed_export(path, g, &head);
  }
  pags_splat_facts facts = {.antialiased = scene->antialiased, .up = scene->up};
  pags_copy3(scene->origin, facts.origin);
  return pags_ply_save_facts(path, g, &facts);
}

PyObject *native_scene_save(PyObject *self, PyObject *arguments) {
  const pags_scene *scene = pags_composition_scene(((native_scene *)self)->composition);
  PyObject *file;
  NATIVE_OWNED PyObject *bytes = NULL;
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  pags_result result;
  /* Objects with their own models would first require their poses, and rotated harmonics: exporters do that. */
  for (int64_t i = 0; i < scene->object_count; i++)
    if (scene->objects[i].model >= 0)
      return PyErr_Format(PyExc_ValueError,
                          "save: object %lld follows a track, which no splat file holds: 'pags export SCENE FILE' "
                          "writes all objects as they are at a time",
                          (long long)i);
  if (!PyArg_ParseTuple(arguments, "O:save", &file) || !native_read_path(file, "path", &bytes))
    return NULL;
  const char *path = PyBytes_AsString(bytes);
  const char *extension = pags_path_extension(path);
  const bool ply = strcasecmp(extension, ".ply") == 0, packed = strcasecmp(extension, ".pagsz") == 0;
  if (!ply && !packed)
    return PyErr_Format(PyExc_ValueError,
                        "%s: expected a name that ends in .ply or .pagsz; 'pags export' makes other files of these",
                        path);
  if (!gather(self, &g))
    return NULL;
  Py_BEGIN_ALLOW_THREADS result = save(path, scene, &g, packed);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) return native_raise(native_state_of(self), result);
  Py_RETURN_NONE;
}
