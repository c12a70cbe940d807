/* SPDX-License-Identifier: Apache-2.0 */
/* Cameras from and to Python: dictionaries with the keys of camera files (scene/scene_json.h), but world_from_camera
 * in place of the quaternion and translation. */
#include "blender_addon/native/native.h"

#include <math.h>
#include <string.h>

/* ---- Dictionaries ---- */

static bool read_size(PyObject *value, const char *what, int *out) {
  long long size = 0;
  const bool good = native_read_integer(value, what, 1, 65535, &size);
  *out = (int)size;
  return good;
}

/* A new reference to dict[key]; NULL, without an error set, if it is missing or None. */
static PyObject *item_of(PyObject *dict, const char *key) {
  PyObject *value = PyMapping_HasKeyString(dict, key) ? PyMapping_GetItemString(dict, key) : NULL;
  if (value != Py_None)
    return value;
  Py_DECREF(value);
  return NULL;
}

static bool missing(const char *owner, const char *key) {
  if (!PyErr_Occurred())
    PyErr_Format(PyExc_ValueError, "%s: expected \"%s\", which is missing", owner, key);
  return false;
}

/* Reads `count` finite numbers of a key; 0: a single number. `what`: for example "camera: fx". A missing optional key
 * leaves `out` unchanged. */
static bool read_key(PyObject *dict, const char *what, bool optional, Py_ssize_t count, double *out) {
  NATIVE_OWNED PyObject *value = item_of(dict, strrchr(what, ' ') + 1);
  if (!value)
    return (optional && !PyErr_Occurred()) || missing("camera", what + strlen("camera: "));
  return count ? native_read_numbers(value, what, count, out) : native_read_finite(value, what, out);
}

static bool read_size_key(PyObject *dict, const char *what, int *out) {
  NATIVE_OWNED PyObject *value = item_of(dict, strrchr(what, ' ') + 1);
  return value ? read_size(value, what, out) : missing("camera", what + strlen("camera: "));
}

/* Whether a dictionary has exactly these keys, so that no input is ignored. */
static bool has_only(PyObject *dict, const char *what, const char *const *keys, const char *listed) {
  Py_ssize_t known = 0;
  if (!PyMapping_Check(dict) || PyUnicode_Check(dict))
    return PyErr_Format(PyExc_TypeError, "%s: expected a dictionary with %s, found %.80R", what, listed, dict);
  for (; *keys; keys++)
    known += PyMapping_HasKeyString(dict, *keys);
  if (PyMapping_Size(dict) == known)
    return true;
  if (!PyErr_Occurred())
    PyErr_Format(PyExc_ValueError, "%s: expected %s and nothing else, found %.200R", what, listed, dict);
  return false;
}

/* Reads the string of a key: a new reference to the Python string, and its text. */
static PyObject *read_word_key(PyObject *dict, const char *what, const char **out) {
  PyObject *value = item_of(dict, strrchr(what, ' ') + 1);
  if (!value)
    missing("camera", what + strlen("camera: "));
  else if (!native_read_word(value, what, out))
    Py_CLEAR(value);
  return value;
}

static bool read_lens(PyObject *dict, pags_lens_model *lens) {
  static const char *const keys[] = {"kind", "k", "d", "p", "s", "field", NULL};
  const char *kind = "";
  int found = 0;
  if (!has_only(dict, "camera: lens", keys, "kind, k, d, p, s and field"))
    return false;
  NATIVE_OWNED PyObject *word = read_word_key(dict, "camera: lens: kind", &kind);
  if (!word)
    return false;
  while (found < PAGS_LENS_KINDS && strcmp(kind, pags_lens_kind_name((pags_lens_kind)found)) != 0)
    found++;
  if (found == PAGS_LENS_KINDS)
    return PyErr_Format(PyExc_ValueError,
                        "camera: lens: kind: expected perspective, fisheye, rational, fov, thin_prism, aria, division, "
                        "eucm, ftheta or equirectangular, found %.80R",
                        word);
  lens->kind = (pags_lens_kind)found;
  return read_key(dict, "camera: lens: k", true, 6, lens->k) && read_key(dict, "camera: lens: d", true, 3, lens->d) &&
         read_key(dict, "camera: lens: p", true, 2, lens->p) && read_key(dict, "camera: lens: s", true, 4, lens->s) &&
         read_key(dict, "camera: lens: field", true, 0, &lens->field);
}

static bool read_shutter(PyObject *dict, pags_shutter *shutter) {
  static const char *const keys[] = {"direction", "seconds", "velocity", NULL};
  const char *direction = "";
  double seconds = 0;
  if (!has_only(dict, "camera: rolling_shutter", keys, "direction, seconds and velocity") ||
      !read_key(dict, "camera: rolling_shutter: seconds", false, 0, &seconds) ||
      !read_key(dict, "camera: rolling_shutter: velocity", false, 6, shutter->velocity))
    return false;
  NATIVE_OWNED PyObject *word = read_word_key(dict, "camera: rolling_shutter: direction", &direction);
  if (!word || (seconds >= 0 && seconds <= 1 && pags_shutter_set(shutter, direction, seconds)))
    return word;
  return PyErr_Format(PyExc_ValueError,
                      "camera: rolling_shutter: expected a direction top_to_bottom, bottom_to_top, left_to_right, "
                      "right_to_left or none, and 0 to 1 seconds, found %.200R",
                      dict);
}

bool native_read_camera(PyObject *value, const char *what, pags_camera *out) {
  *out = (pags_camera){.time = (double)NAN};
  if (!PyMapping_Check(value) || PyUnicode_Check(value))
    return PyErr_Format(PyExc_TypeError, "%s: expected a dictionary, found %.80R", what, value);
  NATIVE_OWNED PyObject *pose = item_of(value, "world_from_camera");
  NATIVE_OWNED PyObject *lens = item_of(value, "lens"), *shutter = item_of(value, "rolling_shutter");
  const bool good =
      !PyErr_Occurred() && read_size_key(value, "camera: width", &out->width) &&
      read_size_key(value, "camera: height", &out->height) && read_key(value, "camera: fx", false, 0, &out->fx) &&
      read_key(value, "camera: fy", false, 0, &out->fy) && read_key(value, "camera: cx", false, 0, &out->cx) &&
      read_key(value, "camera: cy", false, 0, &out->cy) && read_key(value, "camera: time", true, 0, &out->time) &&
      (pose ? native_read_pose(pose, "camera: world_from_camera", out->world_from_camera)
            : missing("camera", "world_from_camera")) &&
      (!lens || read_lens(lens, &out->lens)) && (!shutter || read_shutter(shutter, &out->shutter));
  if (good && (pags_rigid_check(out->world_from_camera, "camera: world_from_camera") != PAGS_OK ||
               pags_camera_check(out, what) != PAGS_OK))
    return native_raise_value(PyExc_ValueError);
  return good;
}

/* Puts numbers under a key unless all are 0. */
static bool put_numbers(PyObject *dict, const char *key, const double *numbers, int count) {
  double size = 0;
  for (int k = 0; k < count; k++)
    size += fabs(numbers[k]);
  return size == 0 || native_put(dict, key, native_numbers(numbers, count));
}

static PyObject *lens_dict(const pags_lens_model *lens) {
  NATIVE_OWNED PyObject *dict = Py_BuildValue("{s:s}", "kind", pags_lens_kind_name(lens->kind));
  const bool good = dict && put_numbers(dict, "k", lens->k, 6) && put_numbers(dict, "d", lens->d, 3) &&
                    put_numbers(dict, "p", lens->p, 2) && put_numbers(dict, "s", lens->s, 4) &&
                    (lens->field == 0 || native_put(dict, "field", PyFloat_FromDouble(lens->field)));
  return good ? pags_take(&dict) : NULL;
}

static PyObject *shutter_dict(const pags_shutter *shutter) {
  return Py_BuildValue("{s:s,s:d,s:N}", "direction", pags_shutter_direction(shutter), "seconds",
                       fabs(shutter->across + shutter->down), "velocity", native_numbers(shutter->velocity, 6));
}

PyObject *native_camera_dict(const pags_camera *camera) {
  NATIVE_OWNED PyObject *dict =
      Py_BuildValue("{s:i,s:i,s:d,s:d,s:d,s:d,s:N}", "width", camera->width, "height", camera->height, "fx", camera->fx,
                    "fy", camera->fy, "cx", camera->cx, "cy", camera->cy, "world_from_camera",
                    native_numbers(camera->world_from_camera, 12));
  const bool good = dict && (isnan(camera->time) || native_put(dict, "time", PyFloat_FromDouble(camera->time))) &&
                    (!pags_camera_bends(camera) || native_put(dict, "lens", lens_dict(&camera->lens))) &&
                    (!pags_camera_rolls(camera) || native_put(dict, "rolling_shutter", shutter_dict(&camera->shutter)));
  return good ? pags_take(&dict) : NULL;
}

/* ---- pags.camera ---- */

/* Reads focal lengths and principal point from K, in pixels. */
static bool read_intrinsics(PyObject *value, pags_camera *out) {
  Py_ssize_t shape[2] = {3, 3};
  PAGS_AUTOFREE double *k = native_read_array(value, "K", true, 2, shape);
  if (!k)
    return false;
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
    return PyErr_Format(PyExc_ValueError, "K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, without skew");
  out->fx = k[0], out->fy = k[4], out->cx = k[2], out->cy = k[5];
  return true;
}

/* Sets the pose from the given one of two matrices, in OpenCV's axes or OpenGL's (y up, z back). */
static bool read_extrinsics(PyObject *to_world, PyObject *to_camera, PyObject *frame, pags_camera *out) {
  const char *axes = "opencv";
  if (!native_read_word(frame, "axes", &axes))
    return false;
  const bool opengl = strcmp(axes, "opengl") == 0, inverse = to_world == Py_None;
  const char *const what = inverse ? "camera_from_world" : "world_from_camera";
  double pose[12];
  if (!opengl && strcmp(axes, "opencv") != 0)
    return PyErr_Format(PyExc_ValueError,
                        "axes: expected opencv (x right, y down, z forward) or opengl (y up, z back), found %s", axes);
  if ((to_world == Py_None) == (to_camera == Py_None))
    return PyErr_Format(PyExc_ValueError, "expected one of world_from_camera and camera_from_world");
  if (!native_read_pose(inverse ? to_camera : to_world, what, pose))
    return false;
  if (pags_rigid_check(pose, what) != PAGS_OK)
    return native_raise_value(PyExc_ValueError);
  if (inverse)
    pags_rigid_inverse(pose, pose);
  for (int i = 0; opengl && i < 3; i++) {
    pose[4 * i + 1] = -pose[4 * i + 1];
    pose[4 * i + 2] = -pose[4 * i + 2];
  }
  memcpy(out->world_from_camera, pose, sizeof pose);
  return true;
}

PyObject *native_camera(PAGS_UNUSED PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"width", "height", "K", "world_from_camera", "camera_from_world", "axes", "time", NULL};
  PyObject *width, *height, *intrinsics, *to_world = Py_None, *to_camera = Py_None, *axes = NULL, *time = Py_None;
  pags_camera camera = {.time = (double)NAN};
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOO|O$OOO:camera", names, &width, &height, &intrinsics,
                                   &to_world, &to_camera, &axes, &time) ||
      !read_size(width, "width", &camera.width) || !read_size(height, "height", &camera.height) ||
      !read_intrinsics(intrinsics, &camera) || !read_extrinsics(to_world, to_camera, axes, &camera) ||
      (time != Py_None && !native_read_finite(time, "time", &camera.time)))
    return NULL;
  if (pags_camera_check(&camera, "camera") == PAGS_OK)
    return native_camera_dict(&camera);
  return native_raise_value(PyExc_ValueError);
}
