/* SPDX-License-Identifier: Apache-2.0 */
/* Format, gzip-compressed: u32 size of the header, the header as JSON, then planes of bytes in the order of the
 * header's `planes`. Neighbours in a plane are neighbours in space, which gzip exploits. */
#include "cli/scene_html/write.h"

#include <math.h>
#include <zlib.h>
#include "base/bytes.h"
#include "base/json.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "exporters/format/bake.h"
#include "exporters/format/object_gaussians.h"
#include "exporters/format/palette.h"

enum { CELL_FLOATS = 6, STEPS = 65535, MOST_MODELS = 65535, ROTATION_STEPS = 1023, EVEN = 8192 };
static const double cell_side = 16;  /* metres */
static const float scale_range = 14; /* ln of the ratio of the largest to the smallest distinct sigma, 1e6 */

/* Gaussians that share a frame: the background, or those of an object. */
typedef struct web_model {
  const pags_part *part;
  int64_t object; /* -1: none */
  int64_t first, count, cells;
} web_model;

typedef struct packer {
  pags_composition *composition;
  const pags_web_settings *settings;
  int degree, fourier_degree; /* SH degrees of the harmonics, and of those that change with time */
  web_model *models;
  int64_t model_count;
  int64_t count, fourier_count; /* rows; those of models whose colour changes with time come first */
  int32_t *row, *model_of;      /* of each packed row: its row in its model's part, and its model */
  float *cells;                 /* CELL_FLOATS a cell: the least corner, the step */
  int64_t *cell_rows;           /* rows of each cell */
  int64_t cell_count;
  uint8_t *bytes;
  int64_t size, capacity;
  pags_json_writer header;
} packer;

static void destroy_packer(packer *p) {
  void *const owned[] = {p->models, p->row, p->model_of, p->cells, p->cell_rows, p->bytes};
  for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
    free(owned[i]);
  pags_json_writer_destroy(&p->header);
}

static double value_of(const packer *p, int plane, int64_t i) {
  return (double)pags_plane(p->models[p->model_of[i]].part->gaussians, plane)[p->row[i]];
}

static int changing_planes(const packer *p) {
  return PAGS_FOURIER_PLANES * pags_sh_coefficients(p->fourier_degree);
}

/* ---- Planes ---- */

/* Adds planes named `name`, which are zero; the header lists name and size. */
static pags_result add_planes(packer *p, const char *name, int64_t planes, int64_t rows, uint8_t **out) {
  const int64_t size = planes * rows;
  PAGS_CHECK_MEMORY(pags_grow(&p->bytes, p->size + size + 1, &p->capacity, 1), "%lld Gaussians", (long long)p->count);
  *out = memset(p->bytes + p->size, 0, (size_t)size);
  p->size += size;
  pags_json_begin_object(&p->header, NULL);
  pags_json_put_string(&p->header, "name", name);
  pags_json_put_integer(&p->header, "planes", planes);
  pags_json_put_integer(&p->header, "rows", rows);
  pags_json_end_object(&p->header);
  return PAGS_OK;
}

/* Writes values, `planes` of `rows` each, one plane after the other, through a codebook. The codebook minimises the
 * squared errors of these values and of a tenth as many spread evenly over their range, so that rare values such as
 * large sigmas are approximated as well. */
static pags_result put_values(packer *p, const char *name, const char *book_name, const float *values, int64_t planes,
                              int64_t rows) {
  double lo = HUGE_VAL, hi = -HUGE_VAL;
  PAGS_AUTO(pags_codebook_destroy) pags_codebook book = {0};
  uint8_t *out;
  const int64_t count = planes * rows;
  for (int64_t i = 0; i < count; i++) {
    lo = fmin(lo, (double)values[i]);
    hi = fmax(hi, (double)values[i]);
  }
  PAGS_TRY(pags_codebook_create(&book, count ? lo : 0, count ? hi : 0));
  for (int64_t i = 0; i < count; i++)
    pags_codebook_add(&book, (double)values[i], 1);
  if (count)
    for (int i = 0; i < EVEN; i++)
      pags_codebook_add(&book, lo + (hi - lo) * (i + 0.5) / EVEN, 0.1 * (double)count / EVEN);
  PAGS_TRY(pags_codebook_choose(&book));
  PAGS_TRY(add_planes(p, book_name, PAGS_CODEBOOK, 4, &out));
  for (int i = 0; i < PAGS_CODEBOOK; i++)
    pags_store_f32(out + 4 * i, book.values[i]);
  PAGS_TRY(add_planes(p, name, planes, rows, &out));
  for (int64_t i = 0; i < count; i++)
    out[i] = pags_codebook_index(&book, (double)values[i]);
  return PAGS_OK;
}

/* ---- Rows: which, and in which order ---- */

typedef struct placed_row {
  uint64_t cell;
  int32_t row;
} placed_row;

static int compare_rows(const void *a, const void *b) {
  const placed_row *x = a, *y = b;
  return x->cell != y->cell ? (x->cell > y->cell) - (x->cell < y->cell) : (x->row > y->row) - (x->row < y->row);
}

/* The number of the cell that holds a row, 21 bits an axis. */
static uint64_t cell_of(const pags_gaussians *g, int64_t row) {
  uint64_t cell = 0;
  for (int k = 0; k < 3; k++) {
    const double at = floor((double)pags_plane(g, PAGS_MEAN + k)[row] / cell_side) + (1 << 20);
    cell = cell << 21 | (uint64_t)fmin(fmax(at, 0), (1 << 21) - 1);
  }
  return cell;
}

static bool is_kept(const packer *p, const pags_part *part, int64_t row) {
  const double least = part->gaussians->alpha_min > 0.0f ? (double)part->gaussians->alpha_min : 1 / 255.0;
  if (pags_splat_opacity(part->gaussians, row) < least)
    return false;
  const int64_t id = part->id ? part->id[row] : part->first_id + row;
  return !p->settings->rank || p->settings->rank[id] >= p->settings->least_rank;
}

/* Adds a cell of the rows [first, p->count): its bounds become the range of 16 bits. */
static void add_cell(packer *p, int64_t first) {
  float *cell = p->cells + CELL_FLOATS * p->cell_count;
  for (int k = 0; k < 3; k++) {
    double lo = HUGE_VAL, hi = -HUGE_VAL;
    for (int64_t i = first; i < p->count; i++) {
      lo = fmin(lo, value_of(p, PAGS_MEAN + k, i));
      hi = fmax(hi, value_of(p, PAGS_MEAN + k, i));
    }
    cell[k] = (float)lo;
    cell[3 + k] = (float)((hi - lo) / STEPS);
  }
  p->cell_rows[p->cell_count++] = p->count - first;
}

static void add_model(packer *p, const pags_part *part, int64_t object, placed_row *rows) {
  web_model *model = &p->models[p->model_count];
  int64_t count = 0;
  for (int64_t i = 0; i < part->gaussians->count; i++)
    if (is_kept(p, part, i))
      rows[count++] = (placed_row){cell_of(part->gaussians, i), (int32_t)i};
  pags_sort(rows, count, sizeof *rows, compare_rows);
  if (!count)
    return;
  *model = (web_model){.part = part, .object = object, .first = p->count, .count = count};
  for (int64_t i = 0, first = p->count; i < count; i++) {
    p->row[p->count] = rows[i].row;
    p->model_of[p->count++] = (int32_t)p->model_count;
    if (i + 1 == count || rows[i + 1].cell != rows[i].cell) {
      add_cell(p, first);
      model->cells++;
      first = p->count;
    }
  }
  p->model_count++;
}

/* Lists all models and their rows. Each part of the composition becomes a model. Its pose is irrelevant, since rows are
 * relative to the origin, or in the frame of an object with a track. */
static pags_result list_models(packer *p) {
  const pags_scene *scene = pags_composition_scene(p->composition);
  const size_t objects = (size_t)scene->object_count + 1;
  const size_t all = (size_t)pags_composition_gaussian_count(p->composition) + 1;
  PAGS_AUTOFREE pags_placement *places = calloc(objects, sizeof *places);
  PAGS_AUTOFREE placed_row *rows = malloc(all * sizeof *rows);
  p->row = malloc(all * sizeof *p->row);
  p->model_of = malloc(all * sizeof *p->model_of);
  p->cells = malloc(all * CELL_FLOATS * sizeof *p->cells);
  p->cell_rows = malloc(all * sizeof *p->cell_rows);
  const pags_part *parts = NULL;
  int count = 0;
  PAGS_CHECK_MEMORY(places && rows && p->row && p->model_of && p->cells && p->cell_rows, "%lld Gaussians",
                    (long long)all - 1);
  for (size_t i = 0; i < objects; i++) {
    places[i] = (pags_placement){.object = (int64_t)i - 1, .world_from_object = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    if (i > 0)
      pags_pose_place(places[i].world_from_object, scene->origin);
  }
  PAGS_TRY(pags_compose_placed(p->composition, (double)NAN, places, (int64_t)objects, &parts, &count));
  if (count > MOST_MODELS)
    return pags_fail(PAGS_ERROR_LIMIT, "%d models: scene.html holds at most %d", count, MOST_MODELS);
  p->models = calloc((size_t)count + 1, sizeof *p->models);
  PAGS_CHECK_MEMORY(p->models, "%d models", count);
  for (int changes = 1; changes >= 0; changes--) {
    for (int i = 0; i < count; i++)
      if ((parts[i].gaussians->fourier != NULL) == (changes != 0))
        add_model(p, &parts[i], pags_composition_part_object(p->composition, &parts[i]), rows);
    p->fourier_count = changes ? p->count : p->fourier_count;
  }
  return PAGS_OK;
}

/* ---- What the planes hold ---- */

/* Coordinates in steps of their cell, each less that of the row before, in the order 0, -1, 1, -2, ... so that small
 * differences have a high byte of 0. */
static pags_result put_means(packer *p) {
  uint8_t *out;
  PAGS_TRY(add_planes(p, "mean", 6, p->count, &out));
  int64_t i = 0;
  for (int64_t c = 0; c < p->cell_count; c++) {
    const float *cell = p->cells + CELL_FLOATS * c;
    uint16_t before[3] = {0, 0, 0};
    for (const int64_t end = i + p->cell_rows[c]; i < end; i++)
      for (int k = 0; k < 3; k++) {
        const double step = (double)cell[3 + k];
        const double at = step > 0 ? (value_of(p, PAGS_MEAN + k, i) - (double)cell[k]) / step : 0;
        const uint16_t steps = (uint16_t)fmin(fmax(floor(at + 0.5), 0), STEPS);
        const uint16_t by = (uint16_t)(steps - before[k]);
        const uint16_t folded = (uint16_t)(by & 0x8000 ? 2 * (0x10000 - by) - 1 : 2 * by);
        out[k * p->count + i] = (uint8_t)(folded >> 8);
        out[(3 + k) * p->count + i] = (uint8_t)folded;
        before[k] = steps;
      }
  }
  PAGS_TRY(add_planes(p, "cells", p->cell_count, 4 * CELL_FLOATS, &out));
  for (int64_t k = 0; k < CELL_FLOATS * p->cell_count; k++)
    pags_store_f32(out + 4 * k, p->cells[k]);
  PAGS_TRY(add_planes(p, "cellRows", p->cell_count, 4, &out));
  for (int64_t c = 0; c < p->cell_count; c++)
    pags_store_u32(out + 4 * c, (uint32_t)p->cell_rows[c]);
  return PAGS_OK;
}

/* Unit quaternions without their largest component, which is made positive: 10 bits for each of the others, in the
 * order w, x, y, z, and 2 bits for its index at the top. */
static pags_result put_rotations(packer *p) {
  uint8_t *out;
  PAGS_TRY(add_planes(p, "rotation", 4, p->count, &out));
  for (int64_t i = 0; i < p->count; i++) {
    double q[4];
    int largest = 0;
    pags_splat_rotation(p->models[p->model_of[i]].part->gaussians, p->row[i], q);
    for (int k = 1; k < 4; k++)
      largest = fabs(q[k]) > fabs(q[largest]) ? k : largest;
    uint32_t bits = (uint32_t)largest << 30;
    for (int k = 0, to = 0; k < 4; k++)
      if (k != largest) {
        const double part = (q[largest] < 0 ? -q[k] : q[k]) * 1.41421356237309505; /* -1..1 */
        bits |= (uint32_t)fmin(fmax(floor((part + 1) / 2 * ROTATION_STEPS + 0.5), 0), ROTATION_STEPS) << 10 * to++;
      }
    for (int k = 0; k < 4; k++)
      out[k * p->count + i] = (uint8_t)(bits >> 8 * k);
  }
  return PAGS_OK;
}

static pags_result put_shapes(packer *p, float *values) {
  float largest = -HUGE_VALF;
  for (int64_t i = 0; i < 3 * p->count; i++) {
    values[i] = (float)value_of(p, PAGS_SCALE + (int)(i / p->count), i % p->count);
    largest = fmaxf(largest, values[i]);
  }
  for (int64_t i = 0; i < 3 * p->count; i++)
    values[i] = fmaxf(values[i], largest - scale_range);
  PAGS_TRY(put_values(p, "scale", "scaleBook", values, 3, p->count));
  for (int64_t i = 0; i < p->count; i++)
    values[i] = (float)pags_splat_opacity(p->models[p->model_of[i]].part->gaussians, p->row[i]);
  PAGS_TRY(put_values(p, "opacity", "opacityBook", values, 1, p->count));
  for (int k = 0; k < 3; k++)
    for (int64_t i = 0; i < p->count; i++)
      values[k * p->count + i] = (float)value_of(p, PAGS_SH + k, i);
  PAGS_TRY(put_values(p, "color", "colorBook", values, 3, p->count));
  for (int k = 0; k < changing_planes(p); k++)
    for (int64_t i = 0; i < p->fourier_count; i++) {
      const pags_gaussians *g = p->models[p->model_of[i]].part->gaussians;
      values[k * p->fourier_count + i] = k < pags_fourier_planes(g) ? g->fourier[k * g->stride + p->row[i]] : 0.0f;
    }
  return put_values(p, "fourier", "fourierBook", values, changing_planes(p), p->fourier_count);
}

/* A palette of harmonics, 1,024 to 65,536 entries by the number of rows, in planes by coefficient; two bytes a row. */
static pags_result put_harmonics(packer *p) {
  const int width = 3 * (pags_sh_coefficients(p->degree) - 1);
  int64_t most = 1024, found = 0;
  uint8_t *out;
  while (most < 65536 && 2 * most <= p->count)
    most *= 2;
  most = p->count < most ? p->count : most;
  PAGS_AUTOFREE float *rows = malloc((size_t)(p->count * width + 1) * sizeof *rows);
  PAGS_AUTOFREE float *entries = malloc((size_t)(most * width + 1) * sizeof *entries);
  PAGS_AUTOFREE int32_t *labels = malloc((size_t)(p->count + 1) * sizeof *labels);
  PAGS_CHECK_MEMORY(rows && entries && labels, "harmonics of %lld Gaussians", (long long)p->count);
  for (int64_t i = 0; i < p->count; i++) {
    const int own = 3 * (pags_sh_coefficients(p->models[p->model_of[i]].part->gaussians->sh_degree) - 1);
    for (int k = 0; k < width; k++)
      rows[i * width + k] = k < own ? (float)value_of(p, PAGS_SH + 3 + k, i) : 0.0f;
  }
  PAGS_TRY(pags_palette_make(rows, p->count, width, most, entries, labels, &found));
  for (int k = 0; k < width; k++)
    for (int64_t i = 0; i < found; i++)
      rows[k * found + i] = entries[i * width + k];
  PAGS_TRY(put_values(p, "palette", "paletteBook", rows, width, found));
  PAGS_TRY(add_planes(p, "label", 2, p->count, &out));
  for (int64_t i = 0; i < p->count; i++) {
    out[i] = (uint8_t)(labels[i] >> 8);
    out[p->count + i] = (uint8_t)labels[i];
  }
  return PAGS_OK;
}

/* The sky, by face, channel, row, through a codebook of its own: each index less what its neighbours to the left and
 * above predict, left + above - above left, where there are any. */
static pags_result put_sky(packer *p, const pags_sky *sky) {
  const int64_t size = sky ? sky->size : 0, area = size * size;
  PAGS_AUTOFREE float *values = calloc((size_t)(18 * area + 1), sizeof *values);
  PAGS_CHECK_MEMORY(values, "a sky");
  for (int64_t i = 0; i < 18 * area; i++) {
    const int64_t plane = i / area;
    values[i] = sky->texels[3 * (plane / 3 * area + i % area) + plane % 3];
  }
  PAGS_TRY(put_values(p, "sky", "skyBook", values, 18, area));
  uint8_t *const indices = p->bytes + p->size - 18 * area;
  for (int64_t i = 18 * area - 1; i >= 0; i--) { /* from the end, so that neighbours are still themselves */
    const bool left = i % size > 0, above = i % area >= size;
    const int guess =
        (left ? indices[i - 1] : 0) + (above ? indices[i - size] : 0) - (left && above ? indices[i - size - 1] : 0);
    indices[i] = (uint8_t)(indices[i] - guess);
  }
  return PAGS_OK;
}

/* ---- Tracks of moving objects ---- */

enum { PARTS = 8 }; /* samples from one label to the next: chords are within a millimetre of the curve */

/* Rounded to a part of one, so that the text is short. */
static double rounded(double value, double parts) {
  return round(value * parts) / parts;
}

/* Writes the samples of one presence, `times` ascending. */
static void put_samples(pags_json_writer *json, const pags_scene *scene, const pags_object *object, const double *times,
                        int64_t count, bool poses) {
  pags_json_begin_array(json, NULL);
  for (int64_t i = 0; i < count; i++) {
    double pose[12], row[7];
    if (!pags_object_pose(object, times[i], pose))
      continue;
    if (!poses) {
      pags_json_put_number(json, NULL, rounded(times[i] - scene->time_begin, 1e6));
      continue;
    }
    const double r[9] = {pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]};
    double q[4];
    pags_quaternion_from_rotation(r, q);
    for (int k = 0; k < 3; k++)
      row[k] = rounded(pose[4 * k + 3] - scene->origin[k], 1e4);
    for (int k = 0; k < 4; k++)
      row[3 + k] = rounded(q[k], 1e6);
    pags_json_put_numbers(json, NULL, row, 7);
  }
  pags_json_end_array(json);
}

/* Writes the members `span` (the track's first and last time, over which colours change), `times` and `poses` (each
 * begins a new list where the object was away): seconds after the scene's begin, positions relative to its origin with
 * quaternions w, x, y, z. Samples are so dense that straight lines follow the curve. */
static pags_result put_track(pags_json_writer *json, const pags_scene *scene, int64_t object) {
  const pags_object *o = &scene->objects[object].record;
  const double ends[2] = {o->keyframes[0].time - scene->time_begin,
                          o->keyframes[o->keyframe_count - 1].time - scene->time_begin};
  PAGS_AUTO(pags_presence_destroy) pags_presence presence = {0};
  PAGS_TRY(pags_presence_find(scene, object, &presence));
  PAGS_AUTOFREE double *times = malloc(((size_t)o->keyframe_count * PARTS + 4) * sizeof *times);
  PAGS_CHECK_MEMORY(times, "a track");
  pags_json_put_numbers(json, "span", ends, 2);
  for (int poses = 0; poses < 2; poses++) {
    pags_json_begin_array(json, poses ? "poses" : "times");
    for (int64_t s = 0; s < presence.count; s++) {
      const double *span = presence.spans[s], inside = fmin(1e-6, 0.25 * (span[1] - span[0]));
      int64_t count = 0;
      times[count++] = span[0] + inside; /* the ends themselves may fall outside by rounding */
      for (int64_t k = 0; k < o->keyframe_count; k++) {
        const double next = k + 1 < o->keyframe_count ? o->keyframes[k + 1].time : o->keyframes[k].time;
        for (int part = 0; part < (k + 1 < o->keyframe_count ? PARTS : 1); part++) {
          const double time = o->keyframes[k].time + (next - o->keyframes[k].time) * part / PARTS;
          if (time > span[0] + inside && time < span[1] - inside)
            times[count++] = time;
        }
      }
      times[count++] = span[1] - inside;
      put_samples(json, scene, o, times, count, poses != 0);
    }
    pags_json_end_array(json);
  }
  return PAGS_OK;
}

/* ---- The header ---- */

static pags_result put_models(packer *p) {
  const pags_scene *scene = pags_composition_scene(p->composition);
  pags_json_begin_array(&p->header, "models");
  for (int64_t m = 0; m < p->model_count; m++) {
    const web_model *model = &p->models[m];
    pags_json_begin_object(&p->header, NULL);
    pags_json_put_integer(&p->header, "object", model->object);
    pags_json_put_integer(&p->header, "gaussians", model->count);
    pags_json_put_integer(&p->header, "cells", model->cells);
    pags_json_put_number(&p->header, "alphaMin", (double)model->part->gaussians->alpha_min);
    if (model->object >= 0 && pags_composition_is_tracked(p->composition, model->object))
      PAGS_TRY(put_track(&p->header, scene, model->object));
    pags_json_end_object(&p->header);
  }
  pags_json_end_array(&p->header);
  return PAGS_OK;
}

static pags_result tell(const packer *p, double share) {
  if (p->settings->progress && !p->settings->progress(p->settings->user, share, "packing"))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  return PAGS_OK;
}

static pags_result put_all(packer *p) {
  const pags_frame_options options = pags_composition_options(p->composition);
  double background[3];
  const size_t most = 3 * (size_t)p->count + (size_t)changing_planes(p) * (size_t)p->fourier_count;
  PAGS_AUTOFREE float *values = malloc((most + 1) * sizeof *values);
  PAGS_CHECK_MEMORY(values, "%lld Gaussians", (long long)p->count);
  pags_widen3(options.background, background);
  pags_json_begin_object(&p->header, NULL);
  pags_json_put_integer(&p->header, "format", 1);
  pags_json_put_integer(&p->header, "gaussians", p->count);
  pags_json_put_integer(&p->header, "fourierRows", p->fourier_count);
  pags_json_put_integer(&p->header, "fourierDegree", p->fourier_degree);
  pags_json_put_integer(&p->header, "shDegree", p->degree);
  pags_json_put_numbers(&p->header, "origin", options.origin, 3);
  pags_json_put_numbers(&p->header, "background", background, 3);
  pags_json_put_integer(&p->header, "skySize", options.sky ? options.sky->size : 0);
  pags_json_put_number(&p->header, "near", (double)options.near_plane);
  pags_json_put_number(&p->header, "lowPass", (double)options.low_pass);
  pags_json_put_bool(&p->header, "antialiased", options.antialiased != 0);
  PAGS_TRY(put_models(p));
  pags_json_put_raw(&p->header, "scene", p->settings->description);
  pags_json_begin_array(&p->header, "planes");
  PAGS_TRY(put_means(p));
  PAGS_TRY(put_rotations(p));
  PAGS_TRY(put_shapes(p, values));
  PAGS_TRY(tell(p, 0.2));
  if (p->degree)
    PAGS_TRY(put_harmonics(p));
  PAGS_TRY(tell(p, 0.6));
  PAGS_TRY(put_sky(p, options.sky));
  pags_json_end_array(&p->header);
  pags_json_end_object(&p->header);
  return pags_json_writer_finish(&p->header);
}

/* Compresses header and planes. */
static pags_result compress_all(const packer *p, pags_web_pack *out) {
  const size_t size = 4 + p->header.size + (size_t)p->size;
  if (size > INT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld Gaussians are too many for a browser", (long long)p->count);
  PAGS_AUTOFREE uint8_t *plain = malloc(size);
  PAGS_CHECK_MEMORY(plain, "%zu bytes", size);
  pags_store_u32(plain, (uint32_t)p->header.size);
  memcpy(plain + 4, p->header.data, p->header.size);
  if (p->size)
    memcpy(plain + 4 + p->header.size, p->bytes, (size_t)p->size);
  z_stream z = {.next_in = plain, .avail_in = (uInt)size};
  if (deflateInit2(&z, Z_BEST_COMPRESSION, Z_DEFLATED, 15 + 16, 9, Z_DEFAULT_STRATEGY) != Z_OK)
    return pags_out_of_memory("compression");
  const size_t most = deflateBound(&z, (uLong)size);
  z.next_out = out->bytes = malloc(most);
  z.avail_out = (uInt)most;
  const bool done = out->bytes && deflate(&z, Z_FINISH) == Z_STREAM_END;
  out->size = z.total_out;
  deflateEnd(&z);
  PAGS_CHECK_MEMORY(done, "%zu bytes", most);
  return PAGS_OK;
}

pags_result pags_web_pack_make(pags_composition *composition, const pags_web_settings *settings, pags_web_pack *out) {
  PAGS_AUTO(destroy_packer) packer p = {.composition = composition, .settings = settings};
  *out = (pags_web_pack){0};
  PAGS_TRY(list_models(&p));
  for (int64_t m = 0; m < p.model_count; m++) {
    const pags_gaussians *const g = p.models[m].part->gaussians;
    p.degree = g->sh_degree > p.degree ? g->sh_degree : p.degree;
    p.fourier_degree = g->fourier_degree > p.fourier_degree ? g->fourier_degree : p.fourier_degree;
  }
  p.degree = p.degree < settings->sh_degree ? p.degree : settings->sh_degree;
  p.fourier_degree = p.fourier_degree < p.degree ? p.fourier_degree : p.degree;
  out->gaussians = p.count;
  out->sh_degree = p.degree;
  PAGS_TRY(put_all(&p));
  return compress_all(&p, out);
}

void pags_web_pack_destroy(pags_web_pack *pack) {
  free(pack->bytes);
  *pack = (pags_web_pack){0};
}
