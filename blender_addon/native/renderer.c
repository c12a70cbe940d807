/* Renderer and Job: a thread that draws what is submitted, one after another, on a pool of its own.
 *
 * A job belongs to the thread of its renderer from submit until its state is JOB_DONE; what is shared is guarded by the renderer's
 * lock. A Job object holds its Scene and Renderer, and its end cancels and waits, so that nothing is freed under a running
 * frame. */
#include "native.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

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

static double now_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

/* ---- The renderer's thread ---- */

static pags_result need_tables(native_scene *scene, const native_layout *layout) {
  bool rgba = layout->outputs & OUTPUT_RGBA;
  if ((layout->outputs & OUTPUT_OBJECT) || (rgba && layout->mode == MODE_CRITICAL))
    PAGS_TRY(native_scene_need_objects(scene));
  if ((layout->outputs & (OUTPUT_PRIORITY | OUTPUT_HEAT)) || (rgba && layout->mode == MODE_PRIORITY))
    PAGS_TRY(native_scene_need_priorities(scene));
  if (rgba && layout->mode == MODE_SIZE)
    PAGS_TRY(native_scene_need_sizes(scene));
  return PAGS_OK;
}

static pags_result draw_locked(pags_frame *frame, pags_tasks *tasks, native_scene *scene, native_job *job) {
  const pags_part *parts;
  int count;
  pags_picture picture;
  double begin = now_ms();
  PAGS_TRY(need_tables(scene, &job->layout));
  if (job->placements)
    PAGS_TRY(pags_compose_placed(scene->composition, job->camera.time, job->placements, job->placement_count, &parts,
                                 &count));
  else
    pags_compose(scene->composition, job->camera.time, &parts, &count);
  PAGS_TRY(pags_frame_render(frame, parts, count, &job->camera, &job->options, NULL, NULL, &picture));
  PAGS_TRY(native_planes_fill(tasks, &picture, scene, &job->layout, &job->planes));
  job->planes.stats = *pags_frame_stats_get(frame);
  job->planes.ms = now_ms() - begin;
  return PAGS_OK;
}

static void draw(pags_frame *frame, pags_tasks *tasks, native_job *job) {
  native_scene *scene = (native_scene *)job->scene;
  pthread_mutex_lock(&scene->lock);
  job->result = draw_locked(frame, tasks, scene, job);
  if (job->result != PAGS_OK)
    strncpy(job->message, pags_error_message(), sizeof job->message - 1);
  pthread_mutex_unlock(&scene->lock);
}

static native_job *next_job(native_renderer *self) {
  while (!self->stopping && !self->first)
    pthread_cond_wait(&self->wake, &self->lock);
  native_job *job = self->stopping ? NULL : self->first;
  if (job) {
    self->first = job->next;
    if (!self->first)
      self->last = NULL;
    job->next = NULL;
    job->state = JOB_RUNNING;
    self->running = job;
  }
  return job;
}

static void *serve(void *context) {
  native_renderer *self = context;
  pags_frame *frame = NULL;
  pthread_mutex_lock(&self->lock);
  for (native_job *job; (job = next_job(self)) != NULL;) {
    pthread_mutex_unlock(&self->lock);
    job->result = frame ? PAGS_OK : pags_frame_create(self->tasks, &frame);
    if (job->result == PAGS_OK)
      draw(frame, self->tasks, job);
    else
      strncpy(job->message, pags_error_message(), sizeof job->message - 1);
    pthread_mutex_lock(&self->lock);
    self->running = NULL;
    job->state = JOB_DONE;
    pags_tasks_reset(self->tasks);
    pthread_cond_broadcast(&self->finished);
  }
  pthread_mutex_unlock(&self->lock);
  pags_frame_destroy(frame);
  return NULL;
}

/* ---- Renderer ---- */

static bool start(native_renderer *self, int threads) {
  if (pthread_mutex_init(&self->lock, NULL) != 0)
    return false;
  pthread_condattr_t attributes;
  pthread_condattr_init(&attributes);
  pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
  pthread_cond_init(&self->wake, NULL);
  pthread_cond_init(&self->finished, &attributes);
  pthread_condattr_destroy(&attributes);
  self->has_lock = true;
  self->tasks = pags_tasks_create(threads);
  if (!self->tasks)
    return false;
  self->has_thread = pthread_create(&self->thread, NULL, serve, self) == 0;
  return self->has_thread;
}

static PyObject *create_renderer(PyTypeObject *type, int threads) {
  if (threads < 0 || threads > 256) {
    PyErr_SetString(PyExc_ValueError, "threads: expected 0 (all) to 256");
    return NULL;
  }
  allocfunc alloc = (allocfunc)(size_t)PyType_GetSlot(type, Py_tp_alloc);
  native_renderer *self = (native_renderer *)alloc(type, 0);
  if (!self)
    return NULL;
  if (start(self, threads))
    return (PyObject *)self;
  PyErr_SetString(PyExc_MemoryError, "threads or memory for them can't be had");
  Py_DECREF(self);
  return NULL;
}

static PyObject *renderer_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"threads", NULL};
  int threads = 0;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "|i:Renderer", names, &threads))
    return NULL;
  return create_renderer(type, threads);
}

static void stop(native_renderer *self) {
  pthread_mutex_lock(&self->lock);
  self->stopping = true;
  pthread_cond_broadcast(&self->wake);
  pthread_mutex_unlock(&self->lock);
  pthread_join(self->thread, NULL);
}

static void renderer_dealloc(PyObject *object) {
  native_renderer *self = (native_renderer *)object;
  PyTypeObject *type = Py_TYPE(object);
  Py_BEGIN_ALLOW_THREADS if (self->has_thread) stop(self);
  pags_tasks_destroy(self->tasks);
  if (self->has_lock) {
    pthread_cond_destroy(&self->wake);
    pthread_cond_destroy(&self->finished);
    pthread_mutex_destroy(&self->lock);
  }
  Py_END_ALLOW_THREADS((freefunc)(size_t)PyType_GetSlot(type, Py_tp_free))(object);
  Py_DECREF(type);
}

/* ---- What a job is asked for ---- */

static unsigned output_named(const char *name) {
  static const char *const names[OUTPUT_KINDS] = {"rgba", "depth", "object", "id", "priority", "heat"};
  for (unsigned i = 0; i < OUTPUT_KINDS; ++i)
    if (!strcmp(name, names[i]))
      return 1u << i;
  PyErr_Format(PyExc_ValueError, "outputs: expected rgba, depth, object, id, priority or heat, found \"%s\"", name);
  return 0;
}

static bool read_outputs(PyObject *value, unsigned *outputs) {
  *outputs = 0;
  Py_ssize_t count = PySequence_Size(value);
  for (Py_ssize_t i = 0; i < count; ++i) {
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
  static const char *const names[MODE_COUNT] = {"rgb", "priority", "critical", "depth", "size"};
  for (int i = 0; i < MODE_COUNT; ++i)
    if (!strcmp(name, names[i])) {
      *mode = (native_mode)i;
      return true;
    }
  PyErr_Format(PyExc_ValueError, "mode: expected rgb, priority, critical, depth or size, found \"%s\"", name);
  return false;
}

/* A list of (object, 12 numbers). */
static bool read_placements(PyObject *value, native_job *job) {
  Py_ssize_t count = PySequence_Size(value);
  if (count < 0)
    return false;
  job->placements = calloc((size_t)count + 1, sizeof *job->placements);
  if (!job->placements) {
    PyErr_NoMemory();
    return false;
  }
  job->placement_count = count;
  for (Py_ssize_t i = 0; i < count; ++i) {
    PyObject *item = PySequence_GetItem(value, i), *object = item ? PySequence_GetItem(item, 0) : NULL;
    PyObject *pose = object ? PySequence_GetItem(item, 1) : NULL;
    if (pose) {
      job->placements[i].object = PyLong_AsLongLong(object);
      if (!PyErr_Occurred())
        native_read_numbers(pose, "placements: world_from_object", 12, job->placements[i].world_from_object);
    }
    Py_XDECREF(pose);
    Py_XDECREF(object);
    Py_XDECREF(item);
    if (PyErr_Occurred())
      return false;
  }
  return true;
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

static bool read_object_values(PyObject *value, native_job *job) {
  Py_ssize_t count = (Py_ssize_t)pags_composition_scene(((native_scene *)job->scene)->composition)->object_count;
  if (value == Py_None)
    return true;
  double *numbers = malloc(((size_t)count + 1) * sizeof *numbers);
  job->object_values = malloc(((size_t)count + 1) * sizeof *job->object_values);
  bool good = numbers && job->object_values;
  if (!good)
    PyErr_NoMemory();
  good = good && native_read_numbers(value, "object_values: one for each object", count, numbers);
  for (Py_ssize_t i = 0; good && i < count; ++i)
    job->object_values[i] = (float)numbers[i];
  free(numbers);
  job->layout.object_values = job->object_values;
  return good;
}

/* Everything that submit, render and pick take after scene and camera; -1 and NaN stand for "as the scene asks for". */
typedef struct wishes {
  PyObject *outputs, *placements, *window, *object_values, *background, *exposure;
  const char *mode, *early_z;
  int linear, flip, transparent, antialiased, sh_degree, exp_degree;
  double near_plane, depth_empty, depth_scale;
} wishes;

static bool read_options(const wishes *w, const native_scene *scene, native_job *job) {
  pags_frame_options *o = &job->options;
  double background[3];
  *o = pags_composition_options(scene->composition);
  if (w->sh_degree < 0 || w->sh_degree > 3 || (w->exp_degree != 3 && w->exp_degree != 5)) {
    PyErr_SetString(PyExc_ValueError, "sh_degree: expected 0 to 3; exp_degree: 3 or 5");
    return false;
  }
  if (w->antialiased >= 0)
    o->antialiased = w->antialiased;
  if (w->near_plane > 0)
    o->near_plane = (float)w->near_plane;
  if (w->background != Py_None) {
    if (!native_read_numbers(w->background, "background", 3, background))
      return false;
    o->sky = NULL;
    for (int c = 0; c < 3; ++c)
      o->background[c] = (float)background[c];
  }
  if (w->transparent) {
    o->sky = NULL;
    memset(o->background, 0, sizeof o->background);
  }
  if (w->exposure != Py_None) {
    double values[6]; /* gain, offset */
    if (!native_read_numbers(w->exposure, "exposure: gain and offset", 6, values))
      return false;
    pags_frame_options_expose(o, values, values + 3);
  }
  if (pags_early_z_parse(w->early_z, o) != PAGS_OK) {
    PyErr_SetString(PyExc_ValueError, pags_error_message());
    return false;
  }
  o->sh_degree = w->sh_degree;
  o->exp_degree = w->exp_degree;
  o->extra_channels = native_layout_needs_extras(&job->layout);
  return true;
}

static bool read_wishes(const wishes *w, native_job *job) {
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
  return read_window(w->window, job) && (w->placements == Py_None || read_placements(w->placements, job)) &&
         read_object_values(w->object_values, job) && read_options(w, (const native_scene *)job->scene, job);
}

static bool check_scene(const native_state *state, PyObject *scene) {
  if (PyObject_TypeCheck(scene, state->scene))
    return true;
  PyErr_SetString(PyExc_TypeError, "scene: expected what pags.load returned");
  return false;
}

static PyObject *create_job(const native_state *state, PyObject *scene, PyObject *camera, const wishes *w) {
  if (!check_scene(state, scene))
    return NULL;
  allocfunc alloc = (allocfunc)(size_t)PyType_GetSlot(state->job, Py_tp_alloc);
  native_job *job = (native_job *)alloc(state->job, 0);
  if (!job)
    return NULL;
  Py_INCREF(scene);
  job->scene = scene;
  job->state = JOB_DONE;
  if (native_read_camera(camera, &job->camera)) {
    pags_result result = pags_camera_check(&job->camera, "camera");
    if (result != PAGS_OK)
      native_raise(state, result);
    else if (read_wishes(w, job))
      return (PyObject *)job;
  }
  Py_DECREF(job);
  return NULL;
}

static wishes default_wishes(void) {
  return (wishes){.outputs = Py_None,
                  .placements = Py_None,
                  .window = Py_None,
                  .object_values = Py_None,
                  .background = Py_None,
                  .exposure = Py_None,
                  .mode = "rgb",
                  .early_z = "off",
                  .antialiased = -1,
                  .sh_degree = 3,
                  .exp_degree = 5,
                  .depth_scale = 1};
}

#define WISH_NAMES                                                                                                   \
  "outputs", "placements", "window", "object_values", "background", "exposure", "mode", "early_z", "linear", "flip", \
      "transparent", "antialiased", "sh_degree", "exp_degree", "near_plane", "depth_empty", "depth_scale"
#define WISH_FORMAT "OOOOOOsspppiiiddd"
#define WISH_TARGETS(w)                                                                                          \
  &(w).outputs, &(w).placements, &(w).window, &(w).object_values, &(w).background, &(w).exposure, &(w).mode,     \
      &(w).early_z, &(w).linear, &(w).flip, &(w).transparent, &(w).antialiased, &(w).sh_degree, &(w).exp_degree, \
      &(w).near_plane, &(w).depth_empty, &(w).depth_scale

static void enqueue(native_renderer *self, native_job *job) {
  Py_INCREF((PyObject *)self);
  job->renderer = (PyObject *)self;
  pthread_mutex_lock(&self->lock);
  job->state = JOB_QUEUED;
  if (self->last)
    self->last->next = job;
  else
    self->first = job;
  self->last = job;
  pthread_cond_signal(&self->wake);
  pthread_mutex_unlock(&self->lock);
}

static PyObject *renderer_submit(PyObject *object, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", WISH_NAMES, NULL};
  PyObject *scene, *camera;
  wishes w = default_wishes();
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OO|$" WISH_FORMAT ":submit", names, &scene, &camera,
                                   WISH_TARGETS(w)))
    return NULL;
  PyObject *job = create_job(native_state_of(object), scene, camera, &w);
  if (job)
    enqueue((native_renderer *)object, (native_job *)job);
  return job;
}

static PyObject *renderer_threads(PyObject *object, void *closure) {
  (void)closure;
  return PyLong_FromLong(pags_tasks_workers(((native_renderer *)object)->tasks));
}

/* ---- Job ---- */

/* With the lock held. */
static void unqueue(native_renderer *r, native_job *job) {
  native_job *before = NULL;
  for (native_job *at = r->first; at && at != job; at = at->next)
    before = at;
  if (before)
    before->next = job->next;
  else
    r->first = job->next;
  if (r->last == job)
    r->last = before;
  job->next = NULL;
  job->state = JOB_DONE;
  job->result = PAGS_CANCELLED;
  strcpy(job->message, "cancelled");
  pthread_cond_broadcast(&r->finished);
}

static void cancel(native_job *job) {
  native_renderer *r = (native_renderer *)job->renderer;
  if (!r)
    return;
  pthread_mutex_lock(&r->lock);
  if (job->state == JOB_QUEUED)
    unqueue(r, job);
  else if (r->running == job)
    pags_tasks_cancel(r->tasks);
  pthread_mutex_unlock(&r->lock);
}

/* seconds < 0: until it is done. */
static bool wait_for(native_job *job, double seconds) {
  native_renderer *r = (native_renderer *)job->renderer;
  struct timespec until;
  if (!r)
    return true;
  clock_gettime(CLOCK_MONOTONIC, &until);
  if (seconds >= 0) {
    double whole = floor(seconds < 1e6 ? seconds : 1e6);
    until.tv_sec += (time_t)whole;
    until.tv_nsec += (long)((seconds < 1e6 ? seconds - whole : 0) * 1e9);
    until.tv_sec += until.tv_nsec / 1000000000;
    until.tv_nsec %= 1000000000;
  }
  pthread_mutex_lock(&r->lock);
  int late = 0;
  while (job->state != JOB_DONE && !late)
    late = seconds < 0 ? pthread_cond_wait(&r->finished, &r->lock)
                       : pthread_cond_timedwait(&r->finished, &r->lock, &until);
  bool done = job->state == JOB_DONE;
  pthread_mutex_unlock(&r->lock);
  return done;
}

static void job_dealloc(PyObject *object) {
  native_job *job = (native_job *)object;
  PyTypeObject *type = Py_TYPE(object);
  Py_BEGIN_ALLOW_THREADS cancel(job);
  wait_for(job, -1);
  Py_END_ALLOW_THREADS native_planes_free(&job->planes);
  free(job->placements);
  free(job->object_values);
  Py_XDECREF(job->scene);
  Py_XDECREF(job->renderer);
  ((freefunc)(size_t)PyType_GetSlot(type, Py_tp_free))(object);
  Py_DECREF(type);
}

static PyObject *job_done(PyObject *object, PyObject *unused) {
  (void)unused;
  return PyBool_FromLong(wait_for((native_job *)object, 0));
}

static PyObject *job_wait(PyObject *object, PyObject *arguments) {
  double seconds = -1;
  bool done;
  if (!PyArg_ParseTuple(arguments, "|d:wait", &seconds))
    return NULL;
  Py_BEGIN_ALLOW_THREADS done = wait_for((native_job *)object, seconds);
  Py_END_ALLOW_THREADS return PyBool_FromLong(done);
}

static PyObject *job_cancel(PyObject *object, PyObject *unused) {
  (void)unused;
  cancel((native_job *)object);
  Py_RETURN_NONE;
}

static PyObject *take(const native_state *state, native_job *job) {
  if (job->result != PAGS_OK)
    return native_raise_text(state, job->result, job->message);
  if (job->taken) {
    PyErr_SetString(PyExc_ValueError, "the picture of this job was taken already");
    return NULL;
  }
  job->taken = true;
  return native_picture_new(state, &job->planes);
}

static PyObject *job_take(PyObject *object, PyObject *unused) {
  (void)unused;
  Py_BEGIN_ALLOW_THREADS wait_for((native_job *)object, -1);
  Py_END_ALLOW_THREADS return take(native_state_of(object), (native_job *)object);
}

/* ---- At once ---- */

static PyObject *run_once(const native_state *state, PyObject *scene, PyObject *camera, const wishes *w, int threads) {
  PyObject *renderer = create_renderer(state->renderer, threads), *picture = NULL;
  PyObject *job = renderer ? create_job(state, scene, camera, w) : NULL;
  if (job) {
    enqueue((native_renderer *)renderer, (native_job *)job);
    picture = job_take(job, NULL);
  }
  Py_XDECREF(job);
  Py_XDECREF(renderer);
  return picture;
}

PyObject *native_render(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", "threads", WISH_NAMES, NULL};
  PyObject *scene, *camera;
  int threads = 0;
  wishes w = default_wishes();
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OO|$i" WISH_FORMAT ":render", names, &scene, &camera, &threads,
                                   WISH_TARGETS(w)))
    return NULL;
  return run_once(PyModule_GetState(module), scene, camera, &w, threads);
}

/* One number of a plane. */
static double sample(PyObject *picture, const char *plane) {
  PyObject *buffer = PyObject_GetAttrString(picture, plane);
  Py_buffer view;
  double value = 0;
  if (buffer && PyObject_GetBuffer(buffer, &view, PyBUF_FORMAT | PyBUF_ND) == 0) {
    value = view.format[0] == 'i' ? (double)*(const int32_t *)view.buf : (double)*(const float *)view.buf;
    PyBuffer_Release(&view);
  }
  Py_XDECREF(buffer);
  return value;
}

static PyObject *describe(native_scene *scene, const pags_camera *camera, double x, double y, PyObject *picture) {
  int32_t id = (int32_t)sample(picture, "id");
  double depth = sample(picture, "depth"), priority = sample(picture, "priority"), point[3], ray[3];
  if (id < 0 || depth <= 0)
    Py_RETURN_NONE;
  const double *m = camera->world_from_camera;
  ray[0] = (x + 0.5 - camera->cx) / camera->fx * depth;
  ray[1] = (y + 0.5 - camera->cy) / camera->fy * depth;
  ray[2] = depth;
  for (int k = 0; k < 3; ++k)
    point[k] = m[4 * k] * ray[0] + m[4 * k + 1] * ray[1] + m[4 * k + 2] * ray[2] + m[4 * k + 3];
  int32_t object = scene->object_of[id];
  PyObject *dict = PyDict_New(), *none = Py_None;
  Py_INCREF(none);
  bool good =
      dict && native_put(dict, "id", PyLong_FromLong(id)) && native_put(dict, "depth", PyFloat_FromDouble(depth)) &&
      native_put(dict, "priority", PyFloat_FromDouble(priority)) && native_put(dict, "point", native_numbers(point, 3));
  good = good && PyDict_SetItemString(dict, "object", none) == 0;
  Py_DECREF(none);
  good = good && (object < 0 || native_put(dict, "object", PyLong_FromLong(object)));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
}

/* The whole frame is drawn and one pixel of it kept: a camera of one pixel would bend Gaussians off its axis otherwise (the clamp of the
 * projection's Jacobian follows the picture's edges). */
PyObject *native_pick(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", "x", "y", "threads", WISH_NAMES, NULL};
  PyObject *scene, *camera, *result = NULL;
  native_state *state = PyModule_GetState(module);
  int threads = 0, x, y;
  pags_camera read;
  wishes w = default_wishes();
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OOii|$i" WISH_FORMAT ":pick", names, &scene, &camera, &x, &y,
                                   &threads, WISH_TARGETS(w)))
    return NULL;
  if (!native_read_camera(camera, &read))
    return NULL;
  w.outputs = Py_BuildValue("(ssss)", "id", "depth", "priority", "object");
  w.window = Py_BuildValue("(iiii)", x, y, 1, 1);
  w.depth_empty = 0;
  w.depth_scale = 1;
  PyObject *picture = w.outputs && w.window ? run_once(state, scene, camera, &w, threads) : NULL;
  if (picture)
    result = describe((native_scene *)scene, &read, x, y, picture);
  Py_XDECREF(picture);
  Py_XDECREF(w.outputs);
  Py_XDECREF(w.window);
  return result;
}

static PyMethodDef renderer_methods[] = {
    {"submit", (PyCFunction)(void (*)(void))renderer_submit, METH_VARARGS | METH_KEYWORDS,
     "submit(scene, camera, *, outputs=('rgba',), placements=None, window=None, object_values=None, background=None,\n"
     "       exposure=None, mode='rgb', early_z='off', linear=False, flip=False, transparent=False, antialiased=-1, "
     "sh_degree=3, exp_degree=5,\n"
     "       near_plane=0, depth_empty=0, depth_scale=1) -> Job\n\n"
     "Queues a picture and returns at once. placements: list of (object, world_from_object) in place of the scene's "
     "own tracks,\n"
     "object -1 for what belongs to none. window: (x, y, width, height) of the picture to hand over. mode: rgb, "
     "priority,\n"
     "critical, depth or size. exposure: gain and offset, 6 numbers. early_z: off, lossless or bounded=EPS. linear: "
     "decode sRGB. flip: bottom row first. -1 and 0: as the scene asks for."},
    {0}};
static PyGetSetDef renderer_getset[] = {{"threads", renderer_threads, NULL, "that draw", NULL}, {0}};
static PyType_Slot renderer_slots[] = {
    {Py_tp_new, renderer_new},
    {Py_tp_dealloc, renderer_dealloc},
    {Py_tp_methods, renderer_methods},
    {Py_tp_getset, renderer_getset},
    {Py_tp_doc, "Renderer(threads=0)\n\nDraws what is submitted, one after another; 0: on all processors."},
    {0, NULL}};
PyType_Spec native_renderer_spec = {.name = "pags.Renderer",
                                    .basicsize = sizeof(native_renderer),
                                    .flags = Py_TPFLAGS_DEFAULT,
                                    .slots = renderer_slots};

static PyMethodDef job_methods[] = {
    {"done", job_done, METH_NOARGS, "done() -> whether take() would return at once"},
    {"wait", job_wait, METH_VARARGS, "wait(seconds=forever) -> whether it is done"},
    {"take", job_take, METH_NOARGS,
     "take() -> Picture\n\nWaits; raises Cancelled, or Error with the engine's message."},
    {"cancel", job_cancel, METH_NOARGS, "Asks it to stop soon; doesn't wait."},
    {0}};
static PyType_Slot job_slots[] = {{Py_tp_dealloc, job_dealloc},
                                  {Py_tp_methods, job_methods},
                                  {Py_tp_doc, "A picture on its way. Dropping it cancels it."},
                                  {0, NULL}};
PyType_Spec native_job_spec = {.name = "pags.Job",
                               .basicsize = sizeof(native_job),
                               .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION,
                               .slots = job_slots};
