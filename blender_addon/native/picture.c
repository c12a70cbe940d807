/* SPDX-License-Identifier: Apache-2.0 */
/* Converts the engine's planes to the host's layout: interleaved channels, linear light or sRGB, either row order. One
 * pass on the engine's threads; Python sees the result without a copy. */
#include "blender_addon/native/native.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <pags/deadline.h>

#include "base/parallel.h"
#include "base/vec3.h"
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

const native_output native_outputs[PLANES] = {[PLANE_RGBA] = {"rgba", 'f', 4},
                                              [PLANE_RGB8] = {"rgb8", 'B', 3},
                                              [PLANE_DEPTH] = {"depth", 'f', 1},
                                              [PLANE_OBJECT] = {"object", 'f', 1},
                                              [PLANE_PRIORITY] = {"priority", 'f', 1},
                                              [PLANE_HEAT] = {"heat", 'f', 4},
                                              [PLANE_ID] = {"id", 'i', 1},
                                              [PLANE_CRYPTO_OBJECT] = {"crypto_object", 'f', PAGS_MATTE_PLANES},
                                              [PLANE_CRYPTO_CLASS] = {"crypto_class", 'f', PAGS_MATTE_PLANES},
                                              [PLANE_NORMAL] = {"normal", 'f', 3},
                                              [PLANE_MOTION] = {"motion", 'f', 4},
                                              [PLANE_BLENDED] = {"count", 'f', 1},
                                              [PLANE_OVERDRAW] = {"overdraw", 'f', 1}};

static bool shows_pairs(const native_layout *layout) {
  return (layout->outputs & (OUTPUT_RGBA | OUTPUT_RGB8)) &&
         (layout->mode == MODE_BLENDED || layout->mode == MODE_OVERDRAW);
}

bool native_layout_needs_pairs(const native_layout *layout) {
  return shows_pairs(layout) || (layout->outputs & OUTPUTS_PAIRS) != 0;
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
  const int32_t object = scene->object_of[id];
  const bool critical = object >= 0 && pags_composition_scene(scene->composition)->objects[object].critical;
  rgb[0] = critical ? 0.5f + 0.5f * grey : 0.35f * grey;
  rgb[1] = critical ? 0.45f * grey : 0.35f * grey;
  rgb[2] = critical ? 0.1f * grey : 0.4f * grey;
}

static void put_rgba(const fill *f, float alpha, const float rgb[3], float *out) {
  float cover = f->layout->transparent ? alpha : 1;
  for (int c = 0; c < 3; c++) {
    /* Colours are premultiplied by alpha: divide by alpha before sRGB is decoded, multiply again after. */
    float own = f->layout->transparent && cover > 0 ? rgb[c] / cover : rgb[c];
    float light = f->layout->linear ? decode(&f->decoder, own) : own;
    out[c] = f->layout->transparent ? light * cover : light;
  }
  out[3] = cover;
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

/* Interleaves the planes of a row of a pass. */
static void put_pass(const fill *f, int which, const float *const *planes, int64_t from, int64_t to) {
  const int count = native_outputs[which].channels;
  float *out = f->out->plane[which];
  if (!out)
    return;
  out += count * to;
  for (int x = 0; x < f->layout->width; x++)
    for (int c = 0; c < count; c++)
      *out++ = planes[c][from + x];
}

static void fill_row(const fill *f, int y) {
  const native_layout *l = f->layout;
  const pags_picture *p = f->picture;
  void *const *plane = f->out->plane;
  int64_t from = (int64_t)(l->y + y) * p->stride + l->x;
  int64_t to = (int64_t)(l->flip ? l->height - 1 - y : y) * l->width;
  float *rgba = plane[PLANE_RGBA], *depth = plane[PLANE_DEPTH], *objects = plane[PLANE_OBJECT],
        *priorities = plane[PLANE_PRIORITY], *heat = plane[PLANE_HEAT];
  int32_t *ids = plane[PLANE_ID];
  uint8_t *rgb8 = plane[PLANE_RGB8];
  /* Fast path of the Rendered viewport: only opaque colours, no other output, no mode. */
  if (l->outputs == OUTPUT_RGBA && l->mode == MODE_RGB && !l->transparent && l->linear) {
    float *out = rgba + 4 * to;
    for (int64_t at = from; at < from + l->width; ++at, out += 4) {
      for (int c = 0; c < 3; c++)
        out[c] = decode(&f->decoder, p->rgb[c][at]);
      out[3] = 1;
    }
    return;
  }
  for (int m = 0; m < 2; m++)
    put_pass(f, PLANE_CRYPTO_OBJECT + m, f->passes->matte[m], from, to);
  put_pass(f, PLANE_NORMAL, f->passes->normal, from, to);
  put_pass(f, PLANE_MOTION, f->passes->motion, from, to);
  for (int k = 0; k < 2; k++)
    put_pass(f, PLANE_BLENDED + k, f->passes->pairs + k, from, to);
  for (int x = 0; x < l->width; ++x, ++from, ++to) {
    int32_t id = p->id ? p->id[from] : -1;
    if (rgba || rgb8) {
      /* The pixel's colour and alpha. */
      float alpha = 1 - p->transmittance[from], rgb[3] = {p->rgb[0][from], p->rgb[1][from], p->rgb[2][from]};
      if (shows_pairs(l)) {
        const float pairs = f->passes->pairs[l->mode - MODE_BLENDED][from], cover = l->transparent ? alpha : 1;
        pags_colormap_heat(on_scale(pairs, 1, MOST_PAIRS), rgb);
        pags_scale3f(cover, rgb, rgb);
      } else if (l->mode != MODE_RGB) {
        float shown[3] = {0, 0, 0};
        if (p->id[from] >= 0)
          mode_color(f, from, p->id[from], shown);
        pags_scale3f(alpha, shown, rgb);
      }
      if (rgba)
        put_rgba(f, alpha, rgb, rgba + 4 * to);
      for (int c = 0; rgb8 && c < 3; c++) { /* display-referred whatever `linear` says, rounded as in PNG files */
        const float v = rgb[c] > 0 ? (rgb[c] < 1 ? rgb[c] : 1) : 0; /* NaN: 0 */
        rgb8[3 * to + c] = (uint8_t)(v * 255.0f + 0.5f);
      }
    }
    if (depth)
      depth[to] = p->depth[from] > 0 && 1 - p->transmittance[from] >= l->depth_alpha ? p->depth[from] * l->depth_scale
                                                                                     : l->depth_empty;
    if (objects)
      objects[to] = id < 0 ? 0 : object_value(f, id);
    if (priorities)
      priorities[to] = id < 0 ? 0 : priority_of(f, id);
    if (heat) {
      float rgb[3] = {0, 0, 0};
      const float alpha = 1 - p->transmittance[from];
      if (id >= 0)
        pags_colormap_heat(priority_of(f, id), rgb);
      pags_scale3f(alpha, rgb, rgb);
      put_rgba(f, alpha, rgb, heat + 4 * to);
    }
    if (ids)
      ids[to] = id;
  }
}

static void fill_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  for (int64_t y = begin; y < end; y++)
    fill_row(context, (int)y);
}

pags_result native_planes_fill(pags_tasks *tasks, const pags_picture *picture, const pags_passes *passes,
                               const native_shown *shown, int shown_count, const native_layout *layout,
                               native_planes *out) {
  fill f = {
      .picture = picture, .passes = passes, .shown = shown, .shown_count = shown_count, .layout = layout, .out = out};
  *out = (native_planes){.width = layout->width, .height = layout->height};
  for (int k = 0; k < PLANES; k++) {
    const size_t bytes = (size_t)native_outputs[k].channels * (native_outputs[k].format == 'B' ? 1 : 4);
    if (!(layout->outputs >> k & 1))
      continue;
    out->plane[k] = malloc((size_t)layout->width * (size_t)layout->height * bytes);
    PAGS_CHECK_MEMORY(out->plane[k], "a picture of %dx%d", layout->width, layout->height);
  }
  for (int i = 0; i < TABLE + 2; i++)
    f.decoder.table[i] = decode_exactly((float)i / TABLE);
  return pags_parallel_run(tasks, layout->height, ROWS, fill_rows, &f);
}

void native_planes_free(native_planes *planes) {
  for (int k = 0; k < PLANES; k++)
    free(planes->plane[k]);
  *planes = (native_planes){0};
}

/* ---- The Python object ---- */

typedef struct native_picture {
  PyObject_HEAD native_planes planes;
} native_picture;

PyObject *native_picture_new(const native_state *state, native_planes *planes) {
  native_picture *self = native_allocate(state->types[PICTURE_TYPE]);
  if (self)
    self->planes = *planes;
  else
    native_planes_free(planes);
  *planes = (native_planes){0};
  return (PyObject *)self;
}

static void picture_dealloc(PyObject *object) {
  native_planes_free(&((native_picture *)object)->planes);
  native_deallocate(object);
}

/* `closure` is a row of native_outputs. */

static PyObject *picture_plane(PyObject *object, void *closure) {
  const native_planes *p = &((native_picture *)object)->planes;
  const native_output *const output = closure;
  const void *const block = p->plane[output - native_outputs];
  const Py_ssize_t shape[3] = {p->height, p->width, output->channels};
  if (!block)
    Py_RETURN_NONE;
  return native_buffer_new(native_state_of(object), object, block, output->format, output->channels > 1 ? 3 : 2, shape);
}

static PyObject *picture_size(PyObject *object, void *closure) {
  const native_planes *p = &((native_picture *)object)->planes;
  return PyLong_FromLong(closure ? p->height : p->width);
}

static PyObject *picture_stats(PyObject *object, PAGS_UNUSED void *closure) {
  const native_planes *p = &((native_picture *)object)->planes;
  const pags_frame_stats *s = &p->stats;
  double frame = s->ms_cull + s->ms_project + s->ms_shade + s->ms_sort + s->ms_bin + s->ms_raster + s->ms_occlude;
  const pags_deadline_step *const step = pags_deadline_steps() + p->drawn.step;
  return Py_BuildValue("{s:d,s:d,s:d,s:d,s:i,s:d,s:i,s:L,s:L,s:L,s:L,s:L,s:L,s:L}", "ms", frame, "ms_job", p->ms,
                       "ms_fill", p->ms_fill, "ms_raster", s->ms_raster, "step", p->drawn.step, "divisor",
                       (double)step->divisor, "sampled", (int)step->sampled, "gaussians", (long long)s->gaussians,
                       "hidden", (long long)s->hidden, "in_view", (long long)s->in_view, "loaded", (long long)s->loaded,
                       "shaded", (long long)s->shaded, "binned", (long long)s->binned, "pairs_binned",
                       (long long)s->pairs_binned);
}

static PyObject *picture_place(PyObject *object, PAGS_UNUSED void *closure) {
  const int *const place = ((native_picture *)object)->planes.drawn.place;
  return Py_BuildValue("(iiii)", place[0], place[1], place[2], place[3]);
}

#define PLANE(which) ((void *)(size_t)&native_outputs[which])

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
     PLANE(PLANE_BLENDED)},
    {"overdraw", picture_plane, NULL, "Buffer [height][width] float32: Gaussians computed for the pixel",
     PLANE(PLANE_OVERDRAW)},
    {0}};
static PyObject *picture_repr(PyObject *object) {
  const native_planes *p = &((native_picture *)object)->planes;
  char text[160] = "";
  for (int k = 0; k < PLANES; k++)
    if (p->plane[k]) {
      strcat(text, text[0] ? ", " : " of ");
      strcat(text, native_outputs[k].name);
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
