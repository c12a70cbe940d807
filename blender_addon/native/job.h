/* SPDX-License-Identifier: Apache-2.0 */
/* Renderers, jobs and what a job is asked for, as the files that read, queue and draw them share them.
 *
 * A job belongs to the thread of its renderer from submit until its state is JOB_DONE; what is shared is guarded by the
 * renderer's lock. A Job object holds its Scene and Renderer, and its end cancels and waits, so that nothing is freed
 * under a running frame. */
#ifndef PAGS_NATIVE_JOB_H
#define PAGS_NATIVE_JOB_H

#include "blender_addon/native/native.h"

#include <pags/tasks.h>

typedef enum job_state { JOB_QUEUED, JOB_RUNNING, JOB_DONE } job_state;

typedef struct native_job native_job;

typedef struct native_renderer {
  PyObject_HEAD pags_tasks *tasks;
  pthread_t thread;
  bool has_thread, has_lock;
  pthread_mutex_t lock;
  pthread_cond_t wake, finished;
  bool stopping;
  native_job *first, *last, *running;
} native_renderer;

struct native_job {
  PyObject_HEAD PyObject *scene, *renderer;
  native_job *next;
  job_state state;
  bool cancelled, taken;
  pags_camera camera;
  pags_frame_options options;
  native_layout layout;
  float *object_values;
  pags_placement *placements; /* NULL: the scene's own tracks */
  int64_t placement_count;
  native_planes planes;
  pags_result result;
  char message[1024];
};

/* Everything that submit, render and pick take after scene and camera; -1 and 0 stand for "as the scene asks for". */
typedef struct native_wishes {
  PyObject *outputs, *placements, *window, *object_values, *background, *exposure;
  const char *mode, *early_z;
  int linear, flip, transparent, antialiased, sh_degree, exp_degree;
  double cut, near_plane, depth_empty, depth_scale;
} native_wishes;

#define WISH_NAMES                                                                                                   \
  "outputs", "placements", "window", "object_values", "background", "exposure", "mode", "early_z", "linear", "flip", \
      "transparent", "antialiased", "sh_degree", "exp_degree", "cut", "near_plane", "depth_empty", "depth_scale"
#define WISH_FORMAT "OOOOOOsspppiiidddd"
#define WISH_TARGETS(w)                                                                                          \
  &(w).outputs, &(w).placements, &(w).window, &(w).object_values, &(w).background, &(w).exposure, &(w).mode,     \
      &(w).early_z, &(w).linear, &(w).flip, &(w).transparent, &(w).antialiased, &(w).sh_degree, &(w).exp_degree, \
      &(w).cut, &(w).near_plane, &(w).depth_empty, &(w).depth_scale

native_wishes native_default_wishes(void);
/* A job of what is wanted, of no renderer yet. Raises and returns NULL. */
PyObject *native_job_new(const native_state *state, PyObject *scene, PyObject *camera, const native_wishes *w);
void native_job_enqueue(native_renderer *renderer, native_job *job);
/* The parts that it draws, valid until the scene's composition is asked again; with the scene's lock held. */
pags_result native_job_compose(native_scene *scene, const native_job *job, const pags_part **parts, int *count);
/* Waits; a new Picture, or raises. */
PyObject *native_job_take(const native_state *state, native_job *job);
#endif
