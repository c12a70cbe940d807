/* SPDX-License-Identifier: Apache-2.0 */
/* Renderers, jobs, and the scenes and arguments of a job, for the files that read, queue and render them.
 *
 * A job belongs to the thread of its renderer from submit until its state is JOB_DONE; what both threads use is guarded
 * by the renderer's lock. A Job object holds references to its Scenes and Renderer; its destructor cancels and waits,
 * so that nothing is freed under a running frame. */
#ifndef PAGS_NATIVE_JOB_H
#define PAGS_NATIVE_JOB_H

#include "blender_addon/native/native.h"

#include <pags/deadline.h>
#include <pags/tasks.h>

typedef enum job_state { JOB_QUEUED, JOB_RUNNING, JOB_DONE } job_state;

typedef struct native_job native_job;

typedef struct native_renderer {
  PyObject_HEAD pags_tasks *tasks;
  pthread_t thread;
  int64_t process; /* whose threads draw */
  bool has_thread, has_lock;
  pthread_mutex_t lock;
  pthread_cond_t wake, finished;
  bool stopping;
  native_job *first, *last, *running;
} native_renderer;

typedef struct native_deadline {
  PyObject_HEAD native_lock lock; /* guards the controller */
  pags_deadline_controller controller;
} native_deadline;

/* The scenes of a picture, at least one, and their parts. */
typedef struct native_contents {
  native_shown *shown;
  int shown_count;
  pags_part *parts;
  int part_count;
  float **colours; /* copies of the constant colour terms of parts whose scene is shown at two times */
  int colour_count;
} native_contents;

/* Values from Python, or None: the parts of the first scene, and the other scenes. */
typedef struct native_contents_arguments {
  PyObject *placements, *object_values, *names, *others;
} native_contents_arguments;

/* The moment before or after that motion refers to. */
typedef struct native_moment {
  bool known;
  pags_camera camera;
  native_contents contents;
} native_moment;

struct native_job {
  PyObject_HEAD PyObject *renderer;
  PyObject *deadline; /* NULL: the picture is drawn in full */
  native_job *next;
  job_state state;
  bool cancelled, taken;
  pags_camera camera;
  pags_frame_options options;
  native_layout layout;
  int antialiased;          /* the argument; -1: each scene as trained */
  native_contents contents; /* what the picture shows */
  native_moment moments[2]; /* before, after, for motion */
  /* Names in the requested mattes of objects and classes, by the labels of the parts. */
  pags_matte_names mattes[2];
  native_planes planes;
  pags_result result;
  char message[1024];
};

/* The arguments of submit, render, gradients and pick after scene and camera, as Python gives them: borrowed
 * references. Those of the first row may be None; those of the others are NULL where they aren't given. */
typedef struct native_job_arguments {
  PyObject *outputs, *placements, *others, *window, *object_values, *background, *exposure, *before, *after, *names,
      *clips, *deadline;
  PyObject *mode, *early_z, *linear, *flip, *transparent, *antialiased, *sh_degree, *exp_degree, *cut, *near_plane,
      *depth_empty, *depth_scale, *depth_alpha;
} native_job_arguments;

#define JOB_ARGUMENT_NAMES                                                                                            \
  "outputs", "placements", "others", "window", "object_values", "background", "exposure", "before", "after", "names", \
      "clips", "deadline", "mode", "early_z", "linear", "flip", "transparent", "antialiased", "sh_degree",            \
      "exp_degree", "cut", "near_plane", "depth_empty", "depth_scale", "depth_alpha"
#define JOB_ARGUMENT_SIGNATURE                                                                                     \
  "outputs=None, placements=None, others=None, window=None, object_values=None, background=None, exposure=None, "  \
  "before=None, after=None, names=None, clips=None, deadline=None, mode='rgb', early_z='lossless', linear=False, " \
  "flip=False, transparent=False, antialiased=-1, sh_degree=3, exp_degree=5, cut=0, near_plane=0, depth_empty=0, " \
  "depth_scale=1, depth_alpha=0"
#define JOB_ARGUMENT_FORMAT "OOOOOOOOOOOOOOOOOOOOOOOOO"
#define JOB_ARGUMENT_TARGETS(w)                                                                                        \
  &(w).outputs, &(w).placements, &(w).others, &(w).window, &(w).object_values, &(w).background, &(w).exposure,         \
      &(w).before, &(w).after, &(w).names, &(w).clips, &(w).deadline, &(w).mode, &(w).early_z, &(w).linear, &(w).flip, \
      &(w).transparent, &(w).antialiased, &(w).sh_degree, &(w).exp_degree, &(w).cut, &(w).near_plane,                  \
      &(w).depth_empty, &(w).depth_scale, &(w).depth_alpha

native_job_arguments native_default_job_arguments(void);
/* Reads a number of threads; NULL: 0, all. Raises and returns false if out of range. */
bool native_read_threads(PyObject *value, int *threads);
/* A new job with these arguments, not yet queued. On failure raises and returns NULL. */
PyObject *native_job_new(const native_state *state, PyObject *scene, PyObject *camera, const native_job_arguments *w);
void native_job_enqueue(native_renderer *renderer, native_job *job);
/* Reads the scene and `others` into `out`, to be freed. Raises and returns false on failure. `time` is that of what has
 * none of its own. */
bool native_contents_read(const native_state *state, PyObject *scene, const native_contents_arguments *w, double time,
                          native_contents *out);
void native_contents_free(native_contents *contents);
/* Locks, or unlocks, the job's scenes, in an order in which no two threads wait for each other. */
void native_job_lock(const native_job *job, bool lock);
/* Composes the parts of the contents, those of the job's picture or of another moment, for a frame of the job; valid
 * while the job's scenes stay locked. A part's label is counted on from scene to scene: the index of a placement or,
 * without placements, of an object, with the background's after them. */
pags_result native_contents_compose(const native_job *job, native_contents *contents);
/* Reads the inputs of a job's passes; call after reading its outputs and contents. */
bool native_passes_read(const native_state *state, const native_job_arguments *w, native_job *job);
/* Composes the moments of the job's motion, before the picture's own parts. Call with the job's scenes locked. */
pags_result native_passes_moments(native_job *job, pags_moment out[2]);
/* Computes the passes of the picture that `frame` has drawn of the job's parts. */
pags_result native_passes_draw(const native_job *job, const pags_moment moments[2], pags_frame *frame,
                               pags_passes *out);
/* Draws the composed parts of a job at the step that its deadline has chosen, and shrinks the window of `layout` as the
 * picture was. Call with the job's scenes locked. */
pags_result native_deadline_draw(const native_job *job, pags_deadline *renderer, native_layout *layout,
                                 pags_picture *picture, native_drawn *drawn);
/* Reports the time of a picture drawn at a step. */
void native_deadline_tell(PyObject *deadline, int step, double ms);
/* Waits for the job. Returns a new Picture, or raises the job's error. */
PyObject *native_job_take(const native_state *state, native_job *job);
#endif
