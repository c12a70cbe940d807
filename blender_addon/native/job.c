/* SPDX-License-Identifier: Apache-2.0 */
/* Job: the Python object of one submitted render. */
#include "blender_addon/native/job.h"

#include <string.h>

#include "port/port.h"

/* Whether the job was unfinished when this process was forked, and so never ends here. */
static bool is_lost(const native_job *job) {
  return job->state != JOB_DONE && native_forked_since(((const native_renderer *)job->renderer)->process);
}

static bool check_alive(PyObject *object) {
  return !is_lost((native_job *)object) ||
         native_raise_text(native_state_of(object), PAGS_ERROR_UNSUPPORTED,
                           "Job: wasn't done when this process was forked, and is drawn in the parent alone; submit it "
                           "here to a Renderer made here");
}

/* Call with the renderer's lock held. */
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
  if (!r || native_forked_since(r->process))
    return;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&r->lock);
  if (job->state == JOB_QUEUED)
    unqueue(r, job);
  else if (r->running == job)
    pags_tasks_cancel(r->tasks);
}

/* Waits at most this number of seconds; < 0: until the job is done. */
static bool wait_for(native_job *job, double seconds) {
  native_renderer *r = (native_renderer *)job->renderer;
  if (!r || native_forked_since(r->process))
    return job->state == JOB_DONE;
  const int64_t begin = pags_port_clock_ns();
  double left = seconds;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&r->lock);
  while (job->state != JOB_DONE && (seconds < 0 || left > 0)) {
    if (seconds < 0)
      pthread_cond_wait(&r->finished, &r->lock);
    else
      pags_port_condition_wait(&r->finished, &r->lock, left);
    left = seconds - 1e-9 * (double)(pags_port_clock_ns() - begin);
  }
  return job->state == JOB_DONE;
}

static void job_dealloc(PyObject *object) {
  native_job *job = (native_job *)object;
  const bool lost = job->renderer && is_lost(job); /* partly drawn: keep the old content */
  Py_BEGIN_ALLOW_THREADS cancel(job);
  wait_for(job, -1);
  Py_END_ALLOW_THREADS if (!lost) native_planes_free(&job->planes);
  if (!lost)
    native_contents_free(&job->contents);
  for (int k = 0; k < 2 && !lost; k++) {
    native_contents_free(&job->moments[k].contents);
    pags_matte_names_destroy(&job->mattes[k]);
  }
  Py_XDECREF(job->renderer);
  Py_XDECREF(job->deadline);
  native_deallocate(object);
}

static PyObject *job_done(PyObject *object, PAGS_UNUSED PyObject *unused) {
  return check_alive(object) ? PyBool_FromLong(wait_for((native_job *)object, 0)) : NULL;
}

static PyObject *job_wait(PyObject *object, PyObject *arguments) {
  PyObject *value = NULL;
  double seconds = -1;
  bool done;
  if (!PyArg_ParseTuple(arguments, "|O:wait", &value) || (value && !native_read_finite(value, "seconds", &seconds)) ||
      !check_alive(object))
    return NULL;
  Py_BEGIN_ALLOW_THREADS done = wait_for((native_job *)object, seconds);
  Py_END_ALLOW_THREADS return PyBool_FromLong(done);
}

static PyObject *job_cancel(PyObject *object, PAGS_UNUSED PyObject *unused) {
  if (!check_alive(object))
    return NULL;
  cancel((native_job *)object);
  Py_RETURN_NONE;
}

PyObject *native_job_take(const native_state *state, native_job *job) {
  Py_BEGIN_ALLOW_THREADS wait_for(job, -1);
  Py_END_ALLOW_THREADS if (job->result != PAGS_OK) return native_raise_text(state, job->result, job->message);
  if (job->taken)
    return PyErr_Format(PyExc_ValueError, "the picture of this job was taken already");
  job->taken = true;
  return native_picture_new(state, &job->planes);
}

static PyObject *job_take(PyObject *object, PAGS_UNUSED PyObject *unused) {
  return check_alive(object) ? native_job_take(native_state_of(object), (native_job *)object) : NULL;
}

static PyObject *job_repr(PyObject *object) {
  native_job *job = (native_job *)object;
  return PyUnicode_FromFormat("<pags.Job %d x %d, %s>", job->layout.width, job->layout.height,
                              job->taken         ? "taken"
                              : is_lost(job)     ? "lost by a fork"
                              : wait_for(job, 0) ? "done"
                                                 : "waiting or drawing");
}

static PyMethodDef job_methods[] = {
    {"done", job_done, METH_NOARGS, "done($self, /)\n--\n\nWhether take() would return at once."},
    {"wait", job_wait, METH_VARARGS,
     "wait($self, seconds=-1, /)\n--\n\nWaits at most this number of seconds, if negative until the job is done; "
     "returns whether it is done."},
    {"take", job_take, METH_NOARGS,
     "take($self, /)\n--\n\nWaits; returns the Picture, or raises Cancelled, or Error with the engine's message."},
    {"cancel", job_cancel, METH_NOARGS, "cancel($self, /)\n--\n\nRequests a stop; doesn't wait."},
    {0}};
static PyType_Slot job_slots[] = {{Py_tp_dealloc, job_dealloc},
                                  {Py_tp_repr, job_repr},
                                  {Py_tp_methods, job_methods},
                                  {Py_tp_doc, "A submitted picture. Deleting the last reference cancels it."},
                                  {0, NULL}};
PyType_Spec native_job_spec = {.name = "pags.Job",
                               .basicsize = sizeof(native_job),
                               .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION,
                               .slots = job_slots};
