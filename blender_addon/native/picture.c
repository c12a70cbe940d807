/* SPDX-License-Identifier: Apache-2.0 */
/* Converts the engine's planes to the host's layout: interleaved channels, linear light or sRGB, either row order. One
 * pass on the engine's threads; Python sees the result without a copy. */
#include "blender_addon/native/native.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include <pags/deadline.h>
#include <pags/tasks.h>

#include "base/memory.h"
#include "maths/maths.h"

/* sRGB to linear light for [0, 1] by linear interpolation in a table of spacing h: the error is under h^2 / 8 times the
 * largest second derivative above the knee, 2e-8. */
enum { TABLE = 4096, ROWS = 8 };
enum { MOST_PAIRS = 1000 }; /* Gaussians per pixel shown lightest; one is darkest */

typedef struct decoder {
  float table[TABLE + 2];
} decoder;

static float decode_exactly(float v) {
  return v <= 0.04045f ? v / 12.92f : pags_powf((v + 0.055f) / 1.055f, 2.4f);
}

static float decode(const decoder *d, float v) {
  if (!(v > 0)) /* NaN: 0 */
    return 0;
  if (v > 1)
    return decode_exactly(v < 1e4f ? v : 1e4f);
  float at = v * TABLE;
  int i = (int)at;
  return d->table[i] + (at - (float)i) * (d->table[i + 1] - d->table[i]);
}

typedef struct fill {
  const pags_picture *picture;
  const pags_passes *passes;
  const native_shown *shown;
  int shown_count;
  const native_layout *layout;
  native_planes *out;
  decoder decoder;
} fill;

static bool shows_pairs(const native_layout *layout) {
  return (layout->outputs & (OUTPUT_RGBA | OUTPUT_RGB8)) &&
         (layout->mode == MODE_BLENDED || layout->mode == MODE_OVERDRAW);
}

bool native_layout_needs_pairs(const native_layout *layout) {
  return shows_pairs(layout) || (layout->outputs & (OUTPUT_BLENDED | OUTPUT_OVERDRAW)) != 0;
}

bool native_layout_needs_passes(const native_layout *layout) {
  return shows_pairs(layout) || (layout->outputs & OUTPUTS_PASSES) != 0;
}

bool native_layout_needs_extras(const native_layout *layout) {
  const unsigned colours = OUTPUT_RGBA | OUTPUT_RGB8, asked = layout->outputs & ~(unsigned)OUTPUTS_PASSES;
  return (asked & ~colours) != 0 || ((asked & colours) && layout->mode != MODE_RGB && !shows_pairs(layout));
}

/* Maps a length to [0, 1] on a logarithmic scale: `least` to 0, `most` to 1. */
static float on_scale(float length, float least, float most) {
  return length > 0 ? pags_logf(length / least) / pags_logf(most / least) : 0;
}

const native_shown *native_shown_of(const native_shown *shown, int count, int32_t *id) {
  int low = 0;
  for (int high = count; high - low > 1;) {
    const int middle = low + (high - low) / 2;
    if (shown[middle].id_base <= *id)
      low = middle;
    else
      high = middle;
  }
  *id -= shown[low].id_base;
  return &shown[low];
}

static bool is_critical(const native_scene *scene, int32_t id) {
  int32_t object = scene->object_of[id];
  return object >= 0 && pags_composition_scene(scene->composition)->objects[object].critical;
}

/* The scale of a scene's lengths in the picture: the cube root of its scale of volumes. */
static float size_factor(const native_shown *shown) {
  const double *m = shown->world_from_scene;
  const double volume =
      m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) + m[2] * (m[4] * m[9] - m[5] * m[8]);
  return pags_powf((float)fabs(volume), 1.0f / 3);
}

/* Display-referred colour of one pixel in a mode other than RGB, from its depth and Gaussian. */
static void mode_color(const fill *f, int64_t at, int32_t id, float rgb[3]) {
  const pags_picture *p = f->picture;
  const native_shown *shown = native_shown_of(f->shown, f->shown_count, &id);
  const native_scene *scene = (const native_scene *)shown->scene;
  const float scale = f->layout->depth_scale;
  float grey = 0.299f * p->rgb[0][at] + 0.587f * p->rgb[1][at] + 0.114f * p->rgb[2][at];
  switch (f->layout->mode) {
    case MODE_PRIORITY: pags_colormap_heat(scene->priority_of[id], rgb); return;
    case MODE_DEPTH: pags_colormap_heat(1 - on_scale(p->depth[at] * scale, 1, 200), rgb); return;
    case MODE_SIZE:
      pags_colormap_heat(on_scale(scene->size_of[id] * size_factor(shown) * scale, 0.003f, 3), rgb);
      return;
    default: break;
  }
  bool critical = is_critical(scene, id);
  rgb[0] = critical ? 0.5f + 0.5f * grey : 0.35f * grey;
  rgb[1] = critical ? 0.45f * grey : 0.35f * grey;
  rgb[2] = critical ? 0.1f * grey : 0.4f * grey;
}

static void put_rgba(const fill *f, int64_t at, float alpha, const float rgb[3], float *out) {
  float cover = f->layout->transparent ? alpha : 1;
  for (int c = 0; c < 3; c++) {
    /* Colours are premultiplied by alpha: divide by alpha before sRGB is decoded, multiply again after. */
    float own = f->layout->transparent && cover > 0 ? rgb[c] / cover : rgb[c];
    float light = f->layout->linear ? decode(&f->decoder, own) : own;
    out[c] = f->layout->transparent ? light * cover : light;
  }
  out[3] = cover;
  (void)at;
}

/* Display-referred whatever `linear` says, rounded as the program's PNG files are. */
static void put_rgb8(const float rgb[3], uint8_t *out) {
  for (int c = 0; c < 3; c++) {
    const float v = rgb[c] > 0 ? (rgb[c] < 1 ? rgb[c] : 1) : 0; /* NaN: 0 */
    out[c] = (uint8_t)(v * 255.0f + 0.5f);
  }
}

static float priority_of(const fill *f, int32_t id) {
  const native_shown *shown = native_shown_of(f->shown, f->shown_count, &id);
  return ((const native_scene *)shown->scene)->priority_of[id];
}

/* The value of the object plane at a pixel that shows this Gaussian. */
static float object_value(const fill *f, int32_t id) {
  const native_shown *shown = native_shown_of(f->shown, f->shown_count, &id);
  const int32_t object = ((const native_scene *)shown->scene)->object_of[id];
  if (object < 0)
    return 0;
  return shown->object_values ? shown->object_values[object] : (float)(object + 1);
}

static void put_heat(const fill *f, int64_t at, float *out) {
  int32_t id = f->picture->id[at];
  float rgb[3] = {0, 0, 0}, alpha = 1 - f->picture->transmittance[at];
  if (id >= 0)
    pags_colormap_heat(priority_of(f, id), rgb);
  for (int c = 0; c < 3; c++)
    rgb[c] *= alpha;
  put_rgba(f, at, alpha, rgb, out);
}

/* Interleaves `count` planes of a row. */
static void put_planes(const float *const *planes, int count, int64_t from, int width, float *out) {
  for (int x = 0; out && x < width; x++)
    for (int c = 0; c < count; c++)
      *out++ = planes[c][from + x];
}

static float *row_of(float *block, int64_t pixel, int floats) {
  return block ? block + floats * pixel : NULL;
}

static void fill_row(const fill *f, int y) {
  const native_layout *l = f->layout;
  const native_planes *o = f->out;
  int64_t from = (int64_t)(l->y + y) * f->picture->stride + l->x;
  int64_t to = (int64_t)(l->flip ? l->height - 1 - y : y) * l->width;
  /* Fast path of the Rendered viewport: only opaque colours, no other output, no mode. */
  if (l->outputs == OUTPUT_RGBA && l->mode == MODE_RGB && !l->transparent && l->linear) {
    /* Colours of the row, alpha 1. */
    float *out = o->rgba + 4 * to;
    const decoder *d = &f->decoder;
    const float *const r = f->picture->rgb[0] + from, *const g = f->picture->rgb[1] + from,
                       *const b = f->picture->rgb[2] + from;
    for (int x = 0; x < f->layout->width; ++x, out += 4) {
      out[0] = decode(d, r[x]);
      out[1] = decode(d, g[x]);
      out[2] = decode(d, b[x]);
      out[3] = 1;
    }

    return;
  }
  for (int m = 0; m < 2; m++)
    put_planes(f->passes->matte[m], PAGS_MATTE_PLANES, from, l->width, row_of(o->crypto[m], to, PAGS_MATTE_PLANES));
  put_planes(f->passes->normal, 3, from, l->width, row_of(o->normal, to, 3));
  put_planes(f->passes->motion, 4, from, l->width, row_of(o->motion, to, 4));
  for (int k = 0; k < 2; k++)
    put_planes(f->passes->pairs + k, 1, from, l->width, row_of(o->pairs[k], to, 1));
  for (int x = 0; x < l->width; ++x, ++from, ++to) {
    int32_t id = f->picture->id ? f->picture->id[from] : -1;
    if (o->rgba || o->rgb8) {
      /* The pixel's colour and alpha. */
      const pags_picture *p = f->picture;
      float alpha = 1 - p->transmittance[from], rgb[3] = {p->rgb[0][from], p->rgb[1][from], p->rgb[2][from]};
      if (shows_pairs(l)) {
        const float pairs = f->passes->pairs[l->mode - MODE_BLENDED][from], cover = l->transparent ? alpha : 1;
        pags_colormap_heat(on_scale(pairs, 1, MOST_PAIRS), rgb);
        for (int c = 0; c < 3; c++)
          rgb[c] *= cover;
      } else if (l->mode != MODE_RGB) {
        float shown[3] = {0, 0, 0};
        if (p->id[from] >= 0)
          mode_color(f, from, p->id[from], shown);
        for (int c = 0; c < 3; c++)
          rgb[c] = alpha * shown[c];
      }
      if (o->rgba)
        put_rgba(f, from, alpha, rgb, o->rgba + 4 * to);
      if (o->rgb8)
        put_rgb8(rgb, o->rgb8 + 3 * to);
    }
    if (o->depth)
      o->depth[to] = f->picture->depth[from] > 0 ? f->picture->depth[from] * l->depth_scale : l->depth_empty;
    if (o->object)
      o->object[to] = id < 0 ? 0 : object_value(f, id);
    if (o->priority)
      o->priority[to] = id < 0 ? 0 : priority_of(f, id);
    if (o->heat)
      put_heat(f, from, o->heat + 4 * to);
    if (o->id)
      o->id[to] = id;
  }
}

static void fill_rows(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  for (int64_t y = begin; y < end; y++)
    fill_row(context, (int)y);
}

static bool allocate(const native_layout *layout, native_planes *out) {
  struct {
    unsigned output;
    size_t bytes;
    void *block;
  } wanted[] = {{OUTPUT_RGBA, 16, NULL},
                {OUTPUT_HEAT, 16, NULL},
                {OUTPUT_DEPTH, 4, NULL},
                {OUTPUT_OBJECT, 4, NULL},
                {OUTPUT_PRIORITY, 4, NULL},
                {OUTPUT_ID, 4, NULL},
                {OUTPUT_RGB8, 3, NULL},
                {OUTPUT_CRYPTO_OBJECT, 4 * PAGS_MATTE_PLANES, NULL},
                {OUTPUT_CRYPTO_CLASS, 4 * PAGS_MATTE_PLANES, NULL},
                {OUTPUT_NORMAL, 12, NULL},
                {OUTPUT_MOTION, 16, NULL},
                {OUTPUT_BLENDED, 4, NULL},
                {OUTPUT_OVERDRAW, 4, NULL}};
  bool good = true;
  for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; i++)
    if (layout->outputs & wanted[i].output) {
      wanted[i].block = malloc((size_t)layout->width * (size_t)layout->height * wanted[i].bytes);
      good = good && wanted[i].block;
    }
  *out = (native_planes){.width = layout->width, .height = layout->height};
  out->rgba = wanted[0].block;
  out->heat = wanted[1].block;
  out->depth = wanted[2].block;
  out->object = wanted[3].block;
  out->priority = wanted[4].block;
  out->id = wanted[5].block;
  out->rgb8 = wanted[6].block;
  out->crypto[0] = wanted[7].block;
  out->crypto[1] = wanted[8].block;
  out->normal = wanted[9].block;
  out->motion = wanted[10].block;
  out->pairs[0] = wanted[11].block;
  out->pairs[1] = wanted[12].block;
  return good;
}

pags_result native_planes_fill(pags_tasks *tasks, const pags_picture *picture, const pags_passes *passes,
                               const native_shown *shown, int shown_count, const native_layout *layout,
                               native_planes *out) {
  fill f = {
      .picture = picture, .passes = passes, .shown = shown, .shown_count = shown_count, .layout = layout, .out = out};
  if (!allocate(layout, out)) {
    native_planes_free(out);
    return pags_out_of_memory("a picture of %dx%d", layout->width, layout->height);
  }
  for (int i = 0; i < TABLE + 2; i++)
    f.decoder.table[i] = decode_exactly((float)i / TABLE);
  if (pags_parallel_for(tasks, layout->height, ROWS, fill_rows, &f))
    return PAGS_OK;
  native_planes_free(out);
  return pags_fail(PAGS_CANCELLED, "cancelled");
}

void native_planes_free(native_planes *planes) {
  free(planes->rgba);
  free(planes->depth);
  free(planes->object);
  free(planes->priority);
  free(planes->heat);
  free(planes->id);
  free(planes->rgb8);
  free(planes->crypto[0]);
  free(planes->crypto[1]);
  free(planes->normal);
  free(planes->motion);
  free(planes->pairs[0]);
  free(planes->pairs[1]);
  *planes = (native_planes){0};
}

/* ---- The Python object ---- */

typedef struct native_picture {
  PyObject_HEAD native_planes planes;
} native_picture;

PyObject *native_picture_new(const native_state *state, native_planes *planes) {
  allocfunc alloc = (allocfunc)(size_t)PyType_GetSlot(state->picture, Py_tp_alloc);
  native_picture *self = (native_picture *)alloc(state->picture, 0);
  if (self)
    self->planes = *planes;
  else
    native_planes_free(planes);
  *planes = (native_planes){0};
  return (PyObject *)self;
}

static void picture_dealloc(PyObject *object) {
  PyTypeObject *type = Py_TYPE(object);
  native_planes_free(&((native_picture *)object)->planes);
  ((freefunc)(size_t)PyType_GetSlot(type, Py_tp_free))(object);
  Py_DECREF(type);
}

enum {
  PLANE_RGBA,
  PLANE_DEPTH,
  PLANE_OBJECT,
  PLANE_PRIORITY,
  PLANE_HEAT,
  PLANE_ID,
  PLANE_RGB8,
  PLANE_CRYPTO_OBJECT,
  PLANE_CRYPTO_CLASS,
  PLANE_NORMAL,
  PLANE_MOTION,
  PLANE_COUNT,
  PLANE_OVERDRAW,
  PLANES
};

static PyObject *picture_plane(PyObject *object, void *closure) {
  native_planes *p = &((native_picture *)object)->planes;
  const void *const blocks[PLANES] = {p->rgba,   p->depth,    p->object,    p->priority,  p->heat,
                                      p->id,     p->rgb8,     p->crypto[0], p->crypto[1], p->normal,
                                      p->motion, p->pairs[0], p->pairs[1]};
  static const int numbers[PLANES] = {4, 1, 1, 1, 4, 1, 3, PAGS_MATTE_PLANES, PAGS_MATTE_PLANES, 3, 4, 1, 1};
  int which = *(const int *)closure;
  int channels = numbers[which];
  const Py_ssize_t shape[3] = {p->height, p->width, channels};
  if (!blocks[which])
    Py_RETURN_NONE;
  const char format = which == PLANE_ID ? 'i' : which == PLANE_RGB8 ? 'B' : 'f';
  return native_buffer_new(native_state_of(object), object, blocks[which], format, channels > 1 ? 3 : 2, shape);
}

static PyObject *picture_size(PyObject *object, void *closure) {
  const native_planes *p = &((native_picture *)object)->planes;
  return PyLong_FromLong(closure ? p->height : p->width);
}

static PyObject *picture_stats(PyObject *object, void *closure) {
  const native_planes *p = &((native_picture *)object)->planes;
  const pags_frame_stats *s = &p->stats;
  double frame = s->ms_cull + s->ms_project + s->ms_shade + s->ms_sort + s->ms_bin + s->ms_raster + s->ms_occlude;
  const pags_deadline_step *const step = pags_deadline_steps() + p->drawn.step;
  PyObject *dict = PyDict_New();
  (void)closure;
  bool good = dict && native_put(dict, "ms", PyFloat_FromDouble(frame)) &&
              native_put(dict, "ms_job", PyFloat_FromDouble(p->ms)) &&
              native_put(dict, "ms_fill", PyFloat_FromDouble(p->ms_fill)) &&
              native_put(dict, "ms_raster", PyFloat_FromDouble(s->ms_raster)) &&
              native_put(dict, "step", PyLong_FromLong(p->drawn.step)) &&
              native_put(dict, "divisor", PyFloat_FromDouble(step->divisor)) &&
              native_put(dict, "sampled", PyLong_FromLong(step->sampled)) &&
              native_put(dict, "gaussians", PyLong_FromLongLong(s->gaussians)) &&
              native_put(dict, "hidden", PyLong_FromLongLong(s->hidden)) &&
              native_put(dict, "in_view", PyLong_FromLongLong(s->in_view)) &&
              native_put(dict, "loaded", PyLong_FromLongLong(s->loaded)) &&
              native_put(dict, "shaded", PyLong_FromLongLong(s->shaded)) &&
              native_put(dict, "binned", PyLong_FromLongLong(s->binned)) &&
              native_put(dict, "pairs_binned", PyLong_FromLongLong(s->pairs_binned));
  if (good)
    return dict;
  Py_XDECREF(dict);
  return NULL;
}

static PyObject *picture_place(PyObject *object, void *closure) {
  const int *const place = ((native_picture *)object)->planes.drawn.place;
  (void)closure;
  return Py_BuildValue("(iiii)", place[0], place[1], place[2], place[3]);
}

static const int plane_numbers[PLANES] = {
    PLANE_RGBA,          PLANE_DEPTH,        PLANE_OBJECT, PLANE_PRIORITY, PLANE_HEAT,  PLANE_ID,      PLANE_RGB8,
    PLANE_CRYPTO_OBJECT, PLANE_CRYPTO_CLASS, PLANE_NORMAL, PLANE_MOTION,   PLANE_COUNT, PLANE_OVERDRAW};
#define PLANE(which) ((void *)(size_t)&plane_numbers[which])

static PyGetSetDef picture_getset[] = {
    {"width", picture_size, NULL, "pixels", NULL},
    {"height", picture_size, NULL, "pixels", PLANE(0)},
    {"stats", picture_stats, NULL,
     "dictionary: ms of the frame, of the whole job and of filling these planes, Gaussians that exist, loaded, shaded, "
     "...; step of the deadline (0: full quality), divisor of the size, 1 as sampled where the rest is",
     NULL},
    {"place", picture_place, NULL,
     "x, y, width, height: pixels of the picture that was asked for which this one covers; a deadline may make it "
     "smaller, never its field of view",
     NULL},
    {"rgba", picture_plane, NULL, "Buffer [height][width][4] float32, premultiplied; None where it wasn't asked for",
     PLANE(PLANE_RGBA)},
    {"rgb8", picture_plane, NULL, "Buffer [height][width][3] uint8: the colours as image files have them",
     PLANE(PLANE_RGB8)},
    {"depth", picture_plane, NULL, "Buffer [height][width] float32, along the camera's axis", PLANE(PLANE_DEPTH)},
    {"object", picture_plane, NULL,
     "Buffer [height][width] float32: number of the object + 1, or its given value; 0: none", PLANE(PLANE_OBJECT)},
    {"priority", picture_plane, NULL, "Buffer [height][width] float32, 0 to 1", PLANE(PLANE_PRIORITY)},
    {"heat", picture_plane, NULL, "Buffer [height][width][4] float32: the priority as colours", PLANE(PLANE_HEAT)},
    {"id", picture_plane, NULL, "Buffer [height][width] int32: Gaussian of the largest weight, -1: none",
     PLANE(PLANE_ID)},
    {"crypto_object", picture_plane, NULL,
     "Buffer [height][width][12] float32: six times the value of a name and its weight, largest first",
     PLANE(PLANE_CRYPTO_OBJECT)},
    {"crypto_class", picture_plane, NULL, "the same for classes", PLANE(PLANE_CRYPTO_CLASS)},
    {"normal", picture_plane, NULL, "Buffer [height][width][3] float32: expected normal, world axes",
     PLANE(PLANE_NORMAL)},
    {"motion", picture_plane, NULL,
     "Buffer [height][width][4] float32, pixels, x right, y up: position before less now, now less after",
     PLANE(PLANE_MOTION)},
    {"count", picture_plane, NULL, "Buffer [height][width] float32: Gaussians blended into the pixel",
     PLANE(PLANE_COUNT)},
    {"overdraw", picture_plane, NULL, "Buffer [height][width] float32: Gaussians computed for the pixel",
     PLANE(PLANE_OVERDRAW)},
    {0}};
static PyObject *picture_repr(PyObject *object) {
  const native_planes *p = &((native_picture *)object)->planes;
  const struct {
    const char *name;
    const void *block;
  } planes[PLANES] = {{"rgba", p->rgba},
                      {"rgb8", p->rgb8},
                      {"depth", p->depth},
                      {"object", p->object},
                      {"priority", p->priority},
                      {"heat", p->heat},
                      {"id", p->id},
                      {"crypto_object", p->crypto[0]},
                      {"crypto_class", p->crypto[1]},
                      {"normal", p->normal},
                      {"motion", p->motion},
                      {"count", p->pairs[0]},
                      {"overdraw", p->pairs[1]}};
  char text[160] = "";
  for (int k = 0; k < PLANES; k++)
    if (planes[k].block) {
      strcat(text, text[0] ? ", " : " of ");
      strcat(text, planes[k].name);
    }
  return PyUnicode_FromFormat("<pags.Picture %d x %d%s>", p->width, p->height, text);
}

static PyType_Slot picture_slots[] = {{Py_tp_dealloc, picture_dealloc},
                                      {Py_tp_repr, picture_repr},
                                      {Py_tp_getset, picture_getset},
                                      {Py_tp_doc, "A rendered picture."},
                                      {0, NULL}};
PyType_Spec native_picture_spec = {.name = "pags.Picture",
                                   .basicsize = sizeof(native_picture),
                                   .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION,
                                   .slots = picture_slots};
