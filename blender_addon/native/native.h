/* SPDX-License-Identifier: Apache-2.0 */
/* Declarations shared by the files of the Python module. The module is limited-API Python (abi3) over the public C API;
 * rows of packed Gaussians are read by scene/packed_rows.h.
 *
 * Scenes, renderers, jobs and pictures are Python objects that own their engine objects. Long calls release the
 * interpreter lock; the engine's threads never touch Python. */
#ifndef PAGS_NATIVE_H
#define PAGS_NATIVE_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <float.h>
#include <pags/compose.h>
#include <pags/frame.h>
#include <pags/passes.h>
#include <pthread.h>
#include <stdbool.h>

#include "base/memory.h"

enum { BUFFER_TYPE, SCENE_TYPE, RENDERER_TYPE, DEADLINE_TYPE, JOB_TYPE, PICTURE_TYPE, NATIVE_TYPES };

typedef struct native_state {
  PyObject *error, *cancelled; /* exceptions */
  PyTypeObject *types[NATIVE_TYPES];
} native_state;

/* Before the declaration of a reference: it is dropped where its scope ends. NULL is allowed. */
#define NATIVE_OWNED PAGS_AUTO(native_drop)
static inline void native_drop(PyObject **reference) {
  Py_XDECREF(*reference);
}

/* A new, zeroed object of a type of this module, and the end of such an object's destructor. */
void *native_allocate(PyTypeObject *type);
void native_deallocate(PyObject *object);

/* The state of the module that defined the object's type. */
native_state *native_state_of(PyObject *self);

/* Raises an exception with this thread's last error message of the engine; returns NULL. */
PyObject *native_raise(const native_state *state, pags_result code);
PyObject *native_raise_text(const native_state *state, pags_result code, const char *text);
PyObject *native_raise_value(PyObject *kind); /* kind: such as PyExc_ValueError */
/* A Python string from the engine's text; decodes non-UTF-8 bytes of file names like os.fsdecode. */
PyObject *native_text(const char *text);

/* ---- Locks, which a fork may lose (fork.c) ---- */

/* Whether this process was forked from the one with that id (pags_port_process_id). */
bool native_forked_since(int64_t process);

typedef struct native_lock {
  pthread_mutex_t mutex;
  int64_t process; /* process of its creation or last check */
  bool made, lost;
} native_lock;

bool native_lock_create(native_lock *lock); /* raises on failure */
void native_lock_destroy(native_lock *lock);
/* Whether the lock and its data can be used in this process. */
bool native_lock_is_alive(native_lock *lock);
/* The same; raises that `what` was lost by a fork. To be called before the mutex is locked by a call from Python. */
bool native_lock_check(native_lock *lock, const native_state *state, const char *what);

/* ---- Buffers ---- */

/* A read-only block of memory with a shape, seen through the buffer protocol; `owner` keeps the memory alive. */
PyObject *native_buffer_new(const native_state *state, PyObject *owner, const void *data, char format, int dimensions,
                            const Py_ssize_t *shape);
/* A buffer that owns `data` and frees it, on failure as well. */
PyObject *native_buffer_own(const native_state *state, void *data, char format, int dimensions,
                            const Py_ssize_t *shape);
extern PyType_Spec native_buffer_spec;

/* ---- Scenes ---- */

typedef struct native_scene {
  PyObject_HEAD pags_composition *composition;
  native_lock lock;   /* guards the composition and the tables below */
  float alpha_min;    /* of the Gaussians drawn first, the background's */
  int32_t *object_of; /* these tables by Gaussian id are filled at first use */
  float *priority_of;
  float *size_of; /* largest sigma, metres */
} native_scene;

extern PyType_Spec native_scene_spec;
PyObject *native_scene_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords); /* of arrays */
PyObject *native_scene_arrays(PyObject *self, PyObject *unused);
PyObject *native_scene_normals(PyObject *self, PyObject *unused);
PyObject *native_scene_object_of(PyObject *self, void *closure);
PyObject *native_scene_save(PyObject *self, PyObject *arguments);
native_scene *native_scene_create(PyTypeObject *type); /* without a composition yet */
/* A dictionary of Buffers with the planes of Gaussians, or of gradients by them, as pags.Scene takes them. */
PyObject *native_arrays_dict(const native_state *state, const pags_gaussians *gaussians);
PyObject *native_scene_load(PyObject *module, PyObject *arguments);
PyObject *native_write_edited(PyObject *module, PyObject *arguments);
/* Each fills its table. Call with the scene's lock held, from any thread. */
pags_result native_scene_need_objects(native_scene *scene);
pags_result native_scene_need_priorities(native_scene *scene);
pags_result native_scene_need_sizes(native_scene *scene);

/* ---- Values from Python; each raises and returns false, NULL or -1 ---- */

enum { NATIVE_DIMENSIONS = 3 }; /* most of an array */

/* The part of one scene in a picture. The picture's world is that of its first scene. */
typedef struct native_shown {
  PyObject *scene;             /* a native_scene, referenced */
  double world_from_scene[12]; /* may scale, stretch and mirror; the identity for the first */
  double time;
  pags_placement *placements; /* NULL: the scene's own tracks */
  int64_t placement_count;
  float *object_values; /* value of the object plane by object; NULL: index + 1 */
  char **names;         /* of the placements, in a matte of objects; NULL: the objects' ids */
  int32_t id_base;      /* added to the ids of the scene's Gaussians in the picture */
  int64_t label_base;   /* added to the labels of its parts */
} native_shown;

/* The scene among `count` whose Gaussian has this id; *id becomes the Gaussian's id in that scene. */
const native_shown *native_shown_of(const native_shown *shown, int count, int32_t *id);

#define NATIVE_LARGEST ((double)FLT_MAX) /* of a number that counts as finite */

/* `what` names the value in messages. Numbers must be within [least, most], which implies finite. For a value that is
 * NULL, an argument that isn't given, the first five leave `out` as it is. */
bool native_read_number(PyObject *value, const char *what, double least, double most, double *out);
bool native_read_finite(PyObject *value, const char *what, double *out);
bool native_read_integer(PyObject *value, const char *what, long long least, long long most, long long *out);
bool native_read_flag(PyObject *value, const char *what, bool *out);                        /* True or False, 1 or 0 */
bool native_read_word(PyObject *value, const char *what, const char **out);                 /* valid while `value` is */
bool native_read_path(PyObject *value, const char *what, PyObject **bytes);                 /* a new reference */
bool native_read_camera(PyObject *value, const char *what, pags_camera *out);               /* and checks it */
bool native_read_numbers(PyObject *value, const char *what, Py_ssize_t count, double *out); /* finite */
/* A pose of finite numbers: 12, a matrix of 3 x 4, or one of 4 x 4 whose last row is 0 0 0 1. Not checked further. */
bool native_read_pose(PyObject *value, const char *what, double out[12]);
/* Reads an array of numbers from a buffer or nested sequences into a new block of floats, of doubles if `wide`, which
 * the caller frees. `shape`: the expected shape (-1: any); receives the actual one. */
void *native_read_array(PyObject *value, const char *what, bool wide, int dimensions, Py_ssize_t *shape);
/* The number of dimensions that native_read_array would find. */
int native_array_dimensions(PyObject *value);
/* Reads placements: a list of (object index, 12 numbers world_from_object, row-major 3 x 4); `out` is to be freed. */
bool native_read_placements(PyObject *value, pags_placement **out, int64_t *count);
PyObject *native_camera_dict(const pags_camera *camera);
/* Puts a new reference into a dictionary and drops it; false when `value` is NULL or memory is out. */
bool native_put(PyObject *dict, const char *key, PyObject *value);
/* A list of `count` new references that `item` makes; NULL, after it has raised. */
PyObject *native_list(int64_t count, PyObject *(*item)(const void *context, int64_t index), const void *context);
PyObject *native_numbers(const double *values, Py_ssize_t count);

/* ---- Pictures ---- */

typedef enum native_mode {
  MODE_RGB,
  MODE_PRIORITY,
  MODE_CRITICAL,
  MODE_DEPTH,
  MODE_SIZE,
  MODE_BLENDED,
  MODE_OVERDRAW,
  MODE_COUNT
} native_mode;
/* The outputs of a picture, each a plane; their bits are in layouts. */
enum {
  PLANE_RGBA, /* premultiplied */
  PLANE_RGB8,
  PLANE_DEPTH,
  PLANE_OBJECT,
  PLANE_PRIORITY,
  PLANE_HEAT,
  PLANE_ID,
  PLANE_CRYPTO_OBJECT, /* these six are passes (pags/passes.h) */
  PLANE_CRYPTO_CLASS,
  PLANE_NORMAL,
  PLANE_MOTION,
  PLANE_BLENDED, /* Gaussians blended, and computed */
  PLANE_OVERDRAW,
  PLANES
};
enum {
  OUTPUT_RGBA = 1 << PLANE_RGBA,
  OUTPUT_RGB8 = 1 << PLANE_RGB8,
  OUTPUT_DEPTH = 1 << PLANE_DEPTH,
  OUTPUT_OBJECT = 1 << PLANE_OBJECT,
  OUTPUT_PRIORITY = 1 << PLANE_PRIORITY,
  OUTPUT_HEAT = 1 << PLANE_HEAT,
  OUTPUT_CRYPTO_OBJECT = 1 << PLANE_CRYPTO_OBJECT,
  OUTPUT_CRYPTO_CLASS = 1 << PLANE_CRYPTO_CLASS,
  OUTPUT_NORMAL = 1 << PLANE_NORMAL,
  OUTPUT_MOTION = 1 << PLANE_MOTION,
  OUTPUTS_PAIRS = 1 << PLANE_BLENDED | 1 << PLANE_OVERDRAW,
  OUTPUTS_PASSES = OUTPUT_CRYPTO_OBJECT | OUTPUT_CRYPTO_CLASS | OUTPUT_NORMAL | OUTPUT_MOTION | OUTPUTS_PAIRS
};

/* An output's name in Python, and its plane. */
typedef struct native_output {
  const char *name;
  char format; /* of native_buffer_new */
  int channels;
} native_output;
extern const native_output native_outputs[PLANES];

/* The layout of the planes that a job returns. */
typedef struct native_layout {
  int x, y, width, height; /* window of the picture, row 0 at the top */
  unsigned outputs;
  native_mode mode;
  bool linear;       /* colours decoded from sRGB to linear light */
  bool flip;         /* bottom row first, as Blender has it */
  bool transparent;  /* alpha as drawn, colours premultiplied; else alpha is 1 */
  float depth_empty; /* depth of pixels without a surface */
  float depth_scale;
  float depth_alpha; /* pixels with a smaller alpha have no surface */
} native_layout;

/* How a picture was drawn. */
typedef struct native_drawn {
  int step;     /* of the deadline's ladder; 0: full quality */
  int place[4]; /* x, y, width, height: pixels of the requested picture that the planes cover */
} native_drawn;

typedef struct native_planes {
  int width, height;
  void *plane[PLANES]; /* NULL if not requested */
  pags_frame_stats stats;
  native_drawn drawn;
  double ms;      /* of the whole job */
  double ms_fill; /* of these, the time to fill the planes */
} native_planes;

/* Whether the layout's outputs or mode need a second walk through the tiles' lists (pags/passes.h). */
bool native_layout_needs_passes(const native_layout *layout);
/* Whether they need counts of pairs. */
bool native_layout_needs_pairs(const native_layout *layout);
/* Whether the layout's outputs need the frame's depth and id planes. */
bool native_layout_needs_extras(const native_layout *layout);
/* Fills `out`, which the caller frees, on the renderer's threads; the scenes' tables must have been filled.
 * PAGS_ERROR_MEMORY or PAGS_CANCELLED. */
pags_result native_planes_fill(pags_tasks *tasks, const pags_picture *picture, const pags_passes *passes,
                               const native_shown *shown, int shown_count, const native_layout *layout,
                               native_planes *out);
void native_planes_free(native_planes *planes);
/* A new Picture that owns the planes. */
PyObject *native_picture_new(const native_state *state, native_planes *planes);
extern PyType_Spec native_picture_spec;

/* ---- Renderers and jobs ---- */

extern PyType_Spec native_renderer_spec, native_deadline_spec, native_job_spec;
PyObject *native_camera(PyObject *module, PyObject *arguments, PyObject *keywords);
PyObject *native_gradients(PyObject *module, PyObject *arguments, PyObject *keywords);
PyObject *native_render(PyObject *module, PyObject *arguments, PyObject *keywords);
PyObject *native_pick(PyObject *module, PyObject *arguments, PyObject *keywords);

/* ---- Passes ---- */

PyObject *native_cryptomatte_hash(PyObject *module, PyObject *arguments);

#endif
