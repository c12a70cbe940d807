/* SPDX-License-Identifier: Apache-2.0 */
/* Renderer: a thread with a thread pool of its own that renders submitted jobs in order. */
#include "blender_addon/native/job.h"
#include "port/port.h"

#include <string.h>

static double now_ms(void) {
  return (double)pags_port_clock_ns() * 1e-6;
}

/* ---- The renderer's thread ---- */

/* Draws the picture and its passes, and fills the job's planes. */
static pags_result draw_picture(pags_deadline *renderer, pags_tasks *tasks, native_job *job,
                                const pags_moment moments[2]) {
  const native_contents *const c = &job->contents;
  pags_frame *const frame = pags_deadline_frame(renderer);
  native_layout layout = job->layout;
  native_drawn how = {.place = {layout.x, layout.y, layout.width, layout.height}};
  pags_picture picture;
  pags_passes passes = {.normal = {NULL}};
  PAGS_TRY(native_contents_compose(job, &job->contents));
  if (job->deadline)
    PAGS_TRY(native_deadline_draw(job, renderer, &layout, &picture, &how));
  else
    PAGS_TRY(pags_frame_render(frame, c->parts, c->part_count, &job->camera, &job->options, NULL, NULL, &picture));
  if (job->options.keep_for_passes)
    PAGS_TRY(native_passes_draw(job, moments, frame, &passes));
  const double drawn = now_ms();
  PAGS_TRY(native_planes_fill(tasks, &picture, &passes, c->shown, c->shown_count, &layout, &job->planes));
  job->planes.ms_fill = now_ms() - drawn;
  job->planes.drawn = how;
  return PAGS_OK;
}

static pags_result draw(pags_deadline *renderer, pags_tasks *tasks, native_job *job) {
  double begin = now_ms();

  /* Fill the scenes' tables that the outputs of this job read. */
  bool rgba = job->layout.outputs & (OUTPUT_RGBA | OUTPUT_RGB8);
  for (int i = 0; i < job->contents.shown_count; i++) {
    native_scene *scene = (native_scene *)job->contents.shown[i].scene;
    if ((job->layout.outputs & OUTPUT_OBJECT) || (rgba && job->layout.mode == MODE_CRITICAL))
      PAGS_TRY(native_scene_need_objects(scene));
    if ((job->layout.outputs & (OUTPUT_PRIORITY | OUTPUT_HEAT)) || (rgba && job->layout.mode == MODE_PRIORITY))
      PAGS_TRY(native_scene_need_priorities(scene));
    if (rgba && job->layout.mode == MODE_SIZE)
      PAGS_TRY(native_scene_need_sizes(scene));
  }

  pags_moment moments[2];
  PAGS_TRY(native_passes_moments(job, moments));
  PAGS_TRY(draw_picture(renderer, tasks, job, moments));
  job->planes.stats = *pags_frame_stats_get(pags_deadline_frame(renderer));
  job->planes.ms = now_ms() - begin;
  if (job->deadline)
    native_deadline_tell(job->deadline, job->planes.drawn.step, job->planes.ms);
  return PAGS_OK;
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
  pags_deadline *renderer = NULL;
  pthread_mutex_lock(&self->lock);
  for (native_job *job; (job = next_job(self)) != NULL;) {
    pthread_mutex_unlock(&self->lock);
    job->result = renderer ? PAGS_OK : pags_deadline_create(self->tasks, NULL, 0, &renderer);
    if (job->result == PAGS_OK) {
      native_job_lock(job, true);
      job->result = draw(renderer, self->tasks, job);
      native_job_lock(job, false);
    }
    if (job->result != PAGS_OK)
      strncpy(job->message, pags_error_message(), sizeof job->message - 1);
    pthread_mutex_lock(&self->lock);
    self->running = NULL;
    job->state = JOB_DONE;
    pags_tasks_reset(self->tasks);
    pthread_cond_broadcast(&self->finished);
  }
  pthread_mutex_unlock(&self->lock);
  pags_deadline_destroy(renderer);
  return NULL;
}

/* ---- Renderer ---- */

static bool start(native_renderer *self, int threads) {
  self->process = pags_port_process_id();
  if (pthread_mutex_init(&self->lock, NULL) != 0)
    return false;
  pthread_cond_init(&self->wake, NULL);
  pags_port_condition_create(&self->finished);
  self->has_lock = true;
  self->tasks = pags_tasks_create(threads);
  if (!self->tasks)
    return false;
  self->has_thread = pthread_create(&self->thread, NULL, serve, self) == 0;
  return self->has_thread;
}

bool native_read_threads(PyObject *value, int *threads) {
  long long number = 0;
  const bool good = native_read_integer(value, "threads", 0, 256, &number);
  *threads = (int)number;
  return good;
}

static PyObject *create_renderer(PyTypeObject *type, PyObject *wanted) {
  int threads;
  if (!native_read_threads(wanted, &threads))
    return NULL;
  NATIVE_OWNED PyObject *renderer = native_allocate(type);
  if (renderer && !start((native_renderer *)renderer, threads))
    return PyErr_Format(PyExc_MemoryError, "threads or memory for them can't be had");
  return pags_take(&renderer);
}

static PyObject *renderer_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"threads", NULL};
  PyObject *threads = NULL;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "|O:Renderer", names, &threads))
    return NULL;
  return create_renderer(type, threads);
}

static void renderer_dealloc(PyObject *object) {
  native_renderer *self = (native_renderer *)object;
  const bool mine = !native_forked_since(self->process); /* else nothing can be ended */
  Py_BEGIN_ALLOW_THREADS if (mine && self->has_thread) {
    pthread_mutex_lock(&self->lock);
    self->stopping = true;
    pthread_cond_broadcast(&self->wake);
    pthread_mutex_unlock(&self->lock);
    pthread_join(self->thread, NULL);
  }
  if (mine)
    pags_tasks_destroy(self->tasks);
  if (mine && self->has_lock) {
    pthread_cond_destroy(&self->wake);
    pthread_cond_destroy(&self->finished);
    pthread_mutex_destroy(&self->lock);
  }
  Py_END_ALLOW_THREADS native_deallocate(object);
}

void native_job_enqueue(native_renderer *self, native_job *job) {
  job->renderer = Py_NewRef((PyObject *)self);
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&self->lock);
  job->state = JOB_QUEUED;
  if (self->last)
    self->last->next = job;
  else
    self->first = job;
  self->last = job;
  pthread_cond_signal(&self->wake);
}

static PyObject *renderer_submit(PyObject *object, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", JOB_ARGUMENT_NAMES, NULL};
  PyObject *scene, *camera;
  native_job_arguments w = native_default_job_arguments();
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OO|$" JOB_ARGUMENT_FORMAT ":submit", names, &scene, &camera,
                                   JOB_ARGUMENT_TARGETS(w)))
    return NULL;
  if (native_forked_since(((native_renderer *)object)->process))
    return native_raise_text(native_state_of(object), PAGS_ERROR_UNSUPPORTED,
                             "Renderer: was made before this process was forked, and its threads stayed in the parent; "
                             "make another Renderer here, or start processes by multiprocessing's \"spawn\"");
  PyObject *job = native_job_new(native_state_of(object), scene, camera, &w);
  if (job)
    native_job_enqueue((native_renderer *)object, (native_job *)job);
  return job;
}

static PyObject *renderer_threads(PyObject *object, PAGS_UNUSED void *closure) {
  return PyLong_FromLong(pags_tasks_workers(((native_renderer *)object)->tasks));
}

static PyObject *renderer_repr(PyObject *object) {
  return PyUnicode_FromFormat("<pags.Renderer of %d threads>", pags_tasks_workers(((native_renderer *)object)->tasks));
}

/* ---- Rendering without a renderer ---- */

/* Draws the jobs of a list and replaces each by its picture. A signal such as Ctrl-C ends it between two jobs. */
static bool draw_all(const native_state *state, PyObject *renderer, PyObject *jobs) {
  const Py_ssize_t count = PyList_Size(jobs);
  for (Py_ssize_t i = 0; i < count; i++)
    native_job_enqueue((native_renderer *)renderer, (native_job *)PyList_GetItem(jobs, i));
  for (Py_ssize_t i = 0; i < count; i++) {
    PyObject *picture = native_job_take(state, (native_job *)PyList_GetItem(jobs, i));
    if (!picture || PyList_SetItem(jobs, i, picture) < 0 || PyErr_CheckSignals() < 0)
      return false;
  }
  return true;
}

/* Adds which camera of a list the raised exception is about. */
static void note_camera(Py_ssize_t number) {
  PyObject *type, *error, *traceback;
  char text[64];
  PyOS_snprintf(text, sizeof text, "camera %lld of the list, counted from 0", (long long)number);
  PyErr_Fetch(&type, &error, &traceback);
  PyErr_NormalizeException(&type, &error, &traceback);
  NATIVE_OWNED PyObject *done = error ? PyObject_CallMethod(error, "add_note", "s", text) : NULL;
  PyErr_Restore(type, error, traceback);
}

/* A job for each camera of a list or tuple; all are checked before any is drawn. */
static PyObject *jobs_of(const native_state *state, PyObject *scene, PyObject *cameras, const native_job_arguments *w) {
  const Py_ssize_t count = PySequence_Size(cameras);
  NATIVE_OWNED PyObject *jobs = PyList_New(0);
  for (Py_ssize_t i = 0; jobs && i < count; i++) {
    NATIVE_OWNED PyObject *camera = PySequence_GetItem(cameras, i);
    NATIVE_OWNED PyObject *job = camera ? native_job_new(state, scene, camera, w) : NULL;
    if (!job)
      note_camera(i);
    if (!job || PyList_Append(jobs, job) < 0)
      return NULL;
  }
  return pags_take(&jobs);
}

PyObject *native_render(PyObject *module, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"scene", "camera", "threads", JOB_ARGUMENT_NAMES, NULL};
  PyObject *scene, *camera, *threads = NULL;
  native_job_arguments w = native_default_job_arguments();
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "OO|$O" JOB_ARGUMENT_FORMAT ":render", names, &scene, &camera,
                                   &threads, JOB_ARGUMENT_TARGETS(w)))
    return NULL;

  /* A renderer for this call alone draws the jobs. */
  const native_state *state = PyModule_GetState(module);
  const bool several = PyList_Check(camera) || PyTuple_Check(camera);
  NATIVE_OWNED PyObject *cameras = several ? Py_NewRef(camera) : PyTuple_Pack(1, camera);
  NATIVE_OWNED PyObject *renderer = cameras ? create_renderer(state->types[RENDERER_TYPE], threads) : NULL;
  NATIVE_OWNED PyObject *list = renderer ? jobs_of(state, scene, cameras, &w) : NULL;
  if (!list || !draw_all(state, renderer, list))
    return NULL;
  return several ? pags_take(&list) : Py_NewRef(PyList_GetItem(list, 0));
}

static PyMethodDef renderer_methods[] = {
    {"submit", (PyCFunction)(void (*)(void))renderer_submit, METH_VARARGS | METH_KEYWORDS,
     "submit($self, scene, camera, *, " JOB_ARGUMENT_SIGNATURE ")\n--\n\n"
     "Queues a picture and returns its Job at once. outputs: any of rgba, rgb8, depth, object, priority, heat, id, "
     "crypto_object, crypto_class, normal, motion, count, overdraw. placements: list of (object, world_from_object) in "
     "place of the scene's own tracks,\nobject -1 for what belongs to none. others: scenes drawn in the same picture, "
     "dictionaries of scene, world_from_scene (a pose that may scale), time,\nplacements, object_values and names, all "
     "but scene may be left out; sky and near plane are the first scene's. window: (x, y, width, height) of the "
     "picture to hand over. mode: rgb, priority,\ncritical, depth, size, count or overdraw. before, after: a camera, "
     "(camera, placements) or (camera, placements, others), that the motion refers to; None: nothing moves on that "
     "side.\nnames: of the placements, for crypto_object. clips: planes a, b, c, d; what has a x + b y + c z + d < 0 "
     "isn't drawn. deadline: a Deadline, whose time the picture keeps by giving up quality and size. exposure: gain "
     "and offset, 6 numbers. early_z: off, lossless or bounded=EPS. linear: decode sRGB. flip: bottom row first. cut: "
     "leave out Gaussians that aren't critical and whose opacity times area is below this number of pixels. -1 and 0: "
     "as in the scene."},
    {0}};
static PyGetSetDef renderer_getset[] = {{"threads", renderer_threads, NULL, "that draw", NULL}, {0}};
static PyType_Slot renderer_slots[] = {
    {Py_tp_new, renderer_new},
    {Py_tp_dealloc, renderer_dealloc},
    {Py_tp_repr, renderer_repr},
    {Py_tp_methods, renderer_methods},
    {Py_tp_getset, renderer_getset},
    {Py_tp_doc, "Renderer(threads=0)\n--\n\nDraws submitted jobs in order; threads 0: on all processors."},
    {0, NULL}};
PyType_Spec native_renderer_spec = {.name = "pags.Renderer",
                                    .basicsize = sizeof(native_renderer),
                                    .flags = Py_TPFLAGS_DEFAULT,
                                    .slots = renderer_slots};
