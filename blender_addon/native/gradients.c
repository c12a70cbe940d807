/* SPDX-License-Identifier: Apache-2.0 */
/* pags.gradients: backpropagates the gradient of a loss by a picture to the parameters of all Gaussians. The picture is
 * rendered again, with the same bits, so that no state is kept between the two calls. */
#include "blender_addon/native/job.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "frame/owners.h"
#include "port/port.h"

typedef struct backward {
  native_scene *scene;
  native_job *job;
  int threads, channels; /* of rgb: 3 or 4 */
  float *rgb, *depth;    /* [height][width][channels]; [height][width] or NULL */
  pags_gaussians out;
  int64_t bad_rows;
} backward;

static void forget_backward(backward *b) {
  Py_XDECREF((PyObject *)b->job);
  free(b->rgb);
  free(b->depth);
  pags_gaussians_destroy(&b->out);
}

enum { BY_T = 3, BY_DEPTH_SUM, GRADIENTS };

/* ---- Without the interpreter's lock ---- */

/* Splits the gradients into the engine's planes. alpha is 1 - T. Depth is S / W, with S = sum(w z) and W = sum(w)
 * = 1 - T: dL/dS = g / W, dL/dT = g S / W^2. */
static void fill_planes(const backward *b, const pags_picture *picture, float *const plane[GRADIENTS]) {
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->width; x++) {
      const int64_t to = (int64_t)y * picture->stride + x, from = (int64_t)y * picture->width + x;
      for (int c = 0; c < 3; c++)
        plane[c][to] = b->rgb[from * b->channels + c];
      if (b->channels == 4 && b->job->layout.transparent)
        plane[BY_T][to] = -b->rgb[from * b->channels + 3];
      const float weight = 1 - picture->transmittance[to];
      if (!b->depth || !(picture->depth[to] > 0) || !(weight > 0))
        continue;
      plane[BY_DEPTH_SUM][to] = b->depth[from] / weight;
      plane[BY_T][to] += b->depth[from] * picture->depth[to] / weight;
    }
}

static pags_result differentiate(backward *b, pags_frame *frame) {
  const native_contents *const c = &b->job->contents;
  pags_picture picture;
  float *plane[GRADIENTS];
  PAGS_TRY(native_contents_compose(b->job, &b->job->contents));
  for (int p = 0; p < c->part_count; p++)
    if (c->parts[p].packed)
      return pags_fail(PAGS_ERROR_UNSUPPORTED,
                       "packed Gaussians (.pagsz) have no gradients: expected those of another "
                       "file, or a Scene of this one's arrays");
  PAGS_TRY(pags_frame_render(frame, c->parts, c->part_count, &b->job->camera, &b->job->options, NULL, NULL, &picture));
  /* One block, zeros beyond the picture. */
  const size_t floats = (size_t)picture.stride * (size_t)((picture.height + 15) / 16 * 16);
  plane[0] = pags_port_aligned_alloc(64, GRADIENTS * floats * sizeof(float));
  PAGS_CHECK_MEMORY(plane[0], "gradients of a picture of %d x %d", picture.width, picture.height);
  memset(plane[0], 0, GRADIENTS * floats * sizeof(float));
  for (int k = 1; k < GRADIENTS; k++)
    plane[k] = plane[0] + (size_t)k * floats;
  fill_planes(b, &picture, plane);
  const pags_picture_gradient gradient = {.rgb = {plane[0], plane[1], plane[2]},
                                          .transmittance = b->depth || b->channels == 4 ? plane[BY_T] : NULL,
                                          .depth_sum = b->depth ? plane[BY_DEPTH_SUM] : NULL};
  const pags_result result = pags_frame_gradients(
      frame, &gradient, pags_composition_gaussian_count(b->scene->composition), &b->out, &b->bad_rows);
  pags_port_aligned_free(plane[0]);
  return result;
}

static pags_result run(backward *b) {
  PAGS_AUTO(pags_tasks_destroy_auto) pags_tasks *tasks = pags_tasks_create(b->threads);
  PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL;
  PAGS_CHECK_MEMORY(tasks, "threads");
  PAGS_TRY(pags_frame_create(tasks, &frame));
  native_job_lock(b->job, true);
  const pags_result result = differentiate(b, frame);
  native_job_lock(b->job, false);
  return result;
}

/* ---- With it ---- */

static float *read_plane(PyObject *value, const char *what, const native_job *job, int dimensions, int *channels) {
  const int width = job->camera.width, height = job->camera.height;
  Py_ssize_t shape[3] = {height, width, -1};
  PAGS_AUTOFREE float *plane = native_read_array(value, what, false, dimensions, shape);
  if (!plane)
    return NULL;
  *channels = dimensions == 3 ? (int)shape[2] : 1;
  if (dimensions == 3 && *channels != 3 && *channels != 4)
    return (float *)PyErr_Format(PyExc_ValueError, "%s: expected 3 or 4 channels, found %d", what, *channels);
  for (int64_t i = 0; i < (int64_t)height * width * *channels; i++)
    if (!isfinite(plane[i]))
      return (float *)PyErr_Format(PyExc_ValueError, "%s: pixel (%d, %d): expected a finite number", what,
                                   (int)(i / *channels % width), (int)(i / *channels / width));
  return pags_take(&plane);
}

PyObject *native_gradients(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene",      "camera",      "rgb",         "depth",     "threads",    "placements",
                          "background", "transparent", "antialiased", "sh_degree", "near_plane", NULL};
  const native_state *state = PyModule_GetState(module);
  native_job_arguments w = native_default_job_arguments();
  PyObject *scene, *camera, *rgb, *depth = Py_None, *threads = NULL;
  PAGS_AUTO(forget_backward) backward b = {0};
  pags_result result;
  int one;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOO|$OOOOOOOO:gradients", names, &scene, &camera, &rgb, &depth,
                                   &threads, &w.placements, &w.background, &w.transparent, &w.antialiased, &w.sh_degree,
                                   &w.near_plane) ||
      !native_read_threads(threads, &b.threads))
    return NULL;
  b.job = (native_job *)native_job_new(state, scene, camera, &w);
  if (!b.job)
    return NULL;
  b.scene = (native_scene *)scene;
  b.job->options.keep_for_backward = 1;
  b.rgb = read_plane(rgb, "rgb", b.job, 3, &b.channels);
  if (b.rgb && depth != Py_None) {
    b.depth = read_plane(depth, "depth", b.job, 2, &one);
    b.job->options.extra_channels = 1;
  }
  if (PyErr_Occurred())
    return NULL;
  Py_BEGIN_ALLOW_THREADS result = run(&b);
  Py_END_ALLOW_THREADS if (result != PAGS_OK) return native_raise(state, result);
  if (b.bad_rows != 0 &&
      PyErr_WarnFormat(PyExc_RuntimeWarning, 1, "the gradients of %lld Gaussians aren't finite and were set to 0",
                       (long long)b.bad_rows) != 0)
    return NULL;
  return native_arrays_dict(state, &b.out);
}
