/* SPDX-License-Identifier: Apache-2.0 */
/* Deadline: the Python object of the controller that keeps the pictures of a view within a time budget
 * (pags/deadline.h). */
#include "blender_addon/native/job.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "port/port.h"

/* ---- For jobs ---- */

/* The window of a reduced picture: its whole pixels around the requested window. `place` receives the pixels of the
 * requested picture that they cover. */
static void shrink_window(const pags_camera *asked, const pags_picture *picture, native_layout *layout, int place[4]) {
  const double across = (double)picture->width / asked->width, down = (double)picture->height / asked->height;
  const int x0 = (int)(layout->x * across), y0 = (int)(layout->y * down);
  const int x1 = (int)fmin(ceil((layout->x + layout->width) * across), picture->width);
  const int y1 = (int)fmin(ceil((layout->y + layout->height) * down), picture->height);
  layout->x = x0, layout->y = y0;
  layout->width = x1 > x0 ? x1 - x0 : 1;
  layout->height = y1 > y0 ? y1 - y0 : 1;
  place[0] = (int)floor(x0 / across + 0.5), place[1] = (int)floor(y0 / down + 0.5);
  place[2] = (int)floor((x0 + layout->width) / across + 0.5) - place[0];
  place[3] = (int)floor((y0 + layout->height) / down + 0.5) - place[1];
}

pags_result native_deadline_draw(const native_job *job, pags_deadline *renderer, native_layout *layout,
                                 pags_picture *picture, native_drawn *drawn) {
  native_deadline *const self = (native_deadline *)job->deadline;
  pags_deadline_result facts;
  pthread_mutex_lock(&self->lock.mutex);
  drawn->step = self->controller.step;
  pthread_mutex_unlock(&self->lock.mutex);
  if (pags_deadline_steps()[drawn->step].sampled) {
    /* The priorities by id of all scenes of the job, one scene after another. */
    const native_shown *const shown = job->contents.shown, *const last = &shown[job->contents.shown_count - 1];
    const int64_t count = last->id_base + pags_composition_gaussian_count(((native_scene *)last->scene)->composition);
    PAGS_AUTOFREE float *all = malloc((size_t)(count + 1) * sizeof *all);
    PAGS_CHECK_MEMORY(all, "the priorities of %lld Gaussians", (long long)count);
    for (int i = 0; i < job->contents.shown_count; i++) {
      native_scene *const scene = (native_scene *)shown[i].scene;
      PAGS_TRY(native_scene_need_priorities(scene));
      memcpy(all + shown[i].id_base, scene->priority_of,
             (size_t)pags_composition_gaussian_count(scene->composition) * sizeof *all);
    }
    PAGS_TRY(pags_deadline_set_priorities(renderer, all, count));
  }
  PAGS_TRY(pags_deadline_render_step(renderer, drawn->step, job->contents.parts, job->contents.part_count, &job->camera,
                                     &job->options, picture, &facts));
  shrink_window(&job->camera, picture, layout, drawn->place);
  return PAGS_OK;
}

void native_deadline_tell(PyObject *object, int step, double ms) {
  native_deadline *const self = (native_deadline *)object;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&self->lock.mutex);
  if (self->controller.step == step)
    pags_deadline_controller_tell(&self->controller, ms);
}

/* ---- The object ---- */

static bool read_ms(PyObject *value, double *out) {
  if (!native_read_finite(value, "ms", out))
    return false;
  return *out > 0 || PyErr_Format(PyExc_ValueError, "ms: expected milliseconds over 0, found %.80R", value);
}

static PyObject *deadline_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"ms", NULL};
  PyObject *value;
  double ms;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "O:Deadline", names, &value) || !read_ms(value, &ms))
    return NULL;
  NATIVE_OWNED PyObject *object = native_allocate(type);
  native_deadline *self = (native_deadline *)object;
  if (!self || !native_lock_create(&self->lock))
    return NULL;
  self->controller = pags_deadline_controller_begin_live(ms);
  return pags_take(&object);
}

static void deadline_dealloc(PyObject *object) {
  native_lock_destroy(&((native_deadline *)object)->lock);
  native_deallocate(object);
}

static bool is_alive(PyObject *object) {
  return native_lock_check(&((native_deadline *)object)->lock, native_state_of(object), "Deadline");
}

enum { MS, STEP, HASTE, MEMBERS };
static const int members[MEMBERS] = {MS, STEP, HASTE};
#define MEMBER(which) ((void *)(size_t)&members[which])

static PyObject *get_member(PyObject *object, void *closure) {
  native_deadline *self = (native_deadline *)object;
  const int which = *(const int *)closure;
  if (!is_alive(object))
    return NULL;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&self->lock.mutex);
  return which == STEP ? PyLong_FromLong(self->controller.step)
                       : PyFloat_FromDouble(which == MS ? self->controller.target : self->controller.haste);
}

static int set_ms(PyObject *object, PyObject *value, PAGS_UNUSED void *closure) {
  native_deadline *self = (native_deadline *)object;
  double ms;
  if (!value) {
    PyErr_SetString(PyExc_AttributeError, "ms can't be deleted");
    return -1;
  }
  if (!read_ms(value, &ms) || !is_alive(object))
    return -1;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&self->lock.mutex);
  self->controller.target = ms;
  return 0;
}

static PyObject *pace(PyObject *object, PyObject *arguments) {
  native_deadline *self = (native_deadline *)object;
  PyObject *took, *wish;
  double ms, wanted;
  if (!PyArg_ParseTuple(arguments, "OO:pace", &took, &wish) ||
      !native_read_number(took, "ms", 0, NATIVE_LARGEST, &ms) ||
      !native_read_number(wish, "wanted", 0, NATIVE_LARGEST, &wanted) || !is_alive(object))
    return NULL;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&self->lock.mutex);
  pags_deadline_controller_pace(&self->controller, ms, wanted);
  Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"pace", pace, METH_VARARGS,
     "pace($self, ms, wanted, /)\n--\n\nReports the milliseconds between the last two pictures, and "
     "the wanted ones: if the viewer's own drawing\nslows pictures down, each gets less time."},
    {0}};
static PyGetSetDef getset[] = {
    {"ms", get_member, set_ms, "time budget of a picture, milliseconds", MEMBER(MS)},
    {"step", get_member, NULL, "quality step of the next picture: 1 (bounded Early-Z) to 11", MEMBER(STEP)},
    {"haste", get_member, NULL, "fraction of ms for a picture, see pace", MEMBER(HASTE)},
    {0}};
static PyType_Slot slots[] = {
    {Py_tp_new, deadline_new},
    {Py_tp_dealloc, deadline_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_getset, getset},
    {Py_tp_doc,
     "Deadline(ms)\n--\n\nKeeps the pictures of a moving view within a time budget: the times of earlier "
     "jobs determine the quality of the next,\nreduced first in non-critical areas, last in size."},
    {0, NULL}};
PyType_Spec native_deadline_spec = {
    .name = "pags.Deadline", .basicsize = sizeof(native_deadline), .flags = Py_TPFLAGS_DEFAULT, .slots = slots};
