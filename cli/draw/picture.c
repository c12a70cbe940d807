/* SPDX-License-Identifier: Apache-2.0 */
/* Renders pictures with their passes, converts their planes to images and writes PNG and EXR files, one per channel. */
#include "cli/draw/picture.h"

#include <stdio.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

/* float32 can't represent every integer above 2^24. */
static const int64_t largest_float_id = 16777216;

#define MATTE(layer)                                                                   \
  {layer "00.R", layer "00.G", layer "00.B", layer "00.A", layer "01.R", layer "01.G", \
   layer "01.B", layer "01.A", layer "02.R", layer "02.G", layer "02.B", layer "02.A"}

/* Name of each channel, its planes, and their names in EXR files. */
static const struct {
  const char *name;
  int planes;
  const char *exr[PAGS_MATTE_PLANES];
} channels[PAGS_CHANNEL_COUNT] = {{"color", 3, {"R", "G", "B"}},
                                  {"alpha", 1, {"A"}},
                                  {"depth", 1, {"Z"}},
                                  {"id", 1, {"id"}},
                                  {"object", 1, {"object"}},
                                  {"priority", 1, {"priority"}},
                                  {"normal", 3, {"X", "Y", "Z"}},
                                  {"heat", 3, {"R", "G", "B"}},
                                  {"crypto-object", PAGS_MATTE_PLANES, MATTE("CryptoObject")},
                                  {"crypto-class", PAGS_MATTE_PLANES, MATTE("CryptoClass")},
                                  {"expected-normal", 3, {"X", "Y", "Z"}},
                                  {"motion", 4, {"X", "Y", "Z", "W"}},
                                  {"count", 1, {"count"}},
                                  {"overdraw", 1, {"overdraw"}}};

/* ---- Channels ---- */

static bool has(const pags_picture_writer *writer, pags_channel channel) {
  return writer->channels >> channel & 1;
}

bool pags_channels_parse(const char *list, unsigned *set, char *unknown, size_t unknown_size) {
  *set = 0;
  for (;; list++) {
    const size_t length = strcspn(list, ",");
    int channel = 0;
    while (channel < PAGS_CHANNEL_COUNT && !pags_text_is(list, length, channels[channel].name))
      channel++;
    if (channel == PAGS_CHANNEL_COUNT) {
      snprintf(unknown, unknown_size, "%.*s", (int)(length < 64 ? length : 64), list);
      return false;
    }
    *set |= 1u << channel;
    list += length;
    if (!*list)
      return true;
  }
}

pags_result pags_picture_writer_create(const pags_composition *composition, unsigned set, pags_picture_format format,
                                       int bits, pags_picture_writer *out) {
  const int64_t gaussians = pags_composition_gaussian_count(composition);
  *out = (pags_picture_writer){.channels = set, .format = format, .bits = bits};
  if (has(out, PAGS_CHANNEL_ID) && gaussians > largest_float_id)
    return pags_fail(PAGS_ERROR_LIMIT,
                     "--channel id: %lld Gaussians are more than the 2^24 ids that a float EXR can represent",
                     (long long)gaussians);
  if (has(out, PAGS_CHANNEL_OBJECT)) {
    out->object_of = malloc(((size_t)gaussians + 1) * sizeof *out->object_of);
    PAGS_CHECK_MEMORY(out->object_of, "the channels of %lld Gaussians", (long long)gaussians);
    pags_composition_objects(composition, out->object_of);
  }
  if (has(out, PAGS_CHANNEL_PRIORITY) || has(out, PAGS_CHANNEL_HEAT)) {
    out->priority_of = malloc(((size_t)gaussians + 1) * sizeof *out->priority_of);
    PAGS_CHECK_MEMORY(out->priority_of, "the channels of %lld Gaussians", (long long)gaussians);
    if (!pags_composition_priorities(composition, out->priority_of))
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "--channel priority: the scene holds neither priorities (property s_sem) nor objects");
  }
  for (int m = 0; m < 2; m++)
    if (has(out, m ? PAGS_CHANNEL_CRYPTO_CLASS : PAGS_CHANNEL_CRYPTO_OBJECT))
      PAGS_TRY(pags_matte_names_of_scene(pags_composition_scene(composition), m, &out->mattes[m]));
  return PAGS_OK;
}

void pags_picture_writer_destroy(pags_picture_writer *writer) {
  free(writer->object_of);
  free(writer->priority_of);
  for (int m = 0; m < 2; m++)
    pags_matte_names_destroy(&writer->mattes[m]);
}

/* ---- Rendering ---- */

pags_result pags_picture_render(pags_composition *composition, pags_frame *frame, const pags_camera *camera,
                                const pags_frame_options *options, pags_picture *out) {
  const pags_part *parts;
  int count;
  pags_compose(composition, camera->time, &parts, &count);
  return pags_frame_render(frame, parts, count, camera, options, NULL, NULL, out);
}

typedef struct weighing {
  const pags_part *parts;
  pags_weight_fn *add;
  void *user;
} weighing;

/* Receives the scores of one cluster; no two clusters share a Gaussian. */
static void add_scores(void *user, const pags_cluster_score *score, PAGS_UNUSED int worker) {
  const weighing *const w = user;
  const pags_part *const part = &w->parts[score->part];
  for (int k = 0; k < score->count; k++) {
    const int64_t row = score->first + k;
    w->add(w->user, part->id ? part->id[row] : part->first_id + row, score->seen[k]);
  }
}

pags_result pags_picture_weights(pags_composition *composition, pags_frame *frame, const pags_camera *camera,
                                 const pags_frame_options *options, pags_weight_fn *add, void *user) {
  weighing w = {.add = add, .user = user};
  pags_frame_options kept = *options;
  pags_picture picture;
  int count;
  kept.keep_for_backward = 1;
  pags_compose(composition, camera->time, &w.parts, &count);
  PAGS_TRY(pags_frame_render(frame, w.parts, count, camera, &kept, NULL, NULL, &picture));
  const size_t pixels = (size_t)picture.stride * (((size_t)picture.height + 15) / 16 * 16);
  PAGS_AUTOFREE float *ones = calloc(2 * pixels, sizeof *ones); /* then zeros */
  PAGS_CHECK_MEMORY(ones, "a picture of %dx%d", picture.width, picture.height);
  for (size_t i = 0; i < pixels; i++)
    ones[i] = 1;
  const pags_score_planes planes = {.counted = ones, .critical = ones + pixels};
  return pags_frame_scores(frame, &planes, add_scores, &w);
}

/* ---- Conversion to images ---- */

/* Interleaves planes into an image, clamping to 0..1 and rounding to nearest; NaN becomes 0. */
static void fill(const float *const *planes, int stride, pags_image *image) {
  const int count = image->channels;
  for (int y = 0; y < image->height; y++)
    for (int c = 0; c < count; c++) {
      const float *row = planes[c] + (size_t)y * (size_t)stride;
      size_t at = (size_t)y * (size_t)image->width * (size_t)count + (size_t)c;
      for (int x = 0; x < image->width; x++, at += (size_t)count) {
        const float v = row[x] > 0 ? (row[x] < 1 ? row[x] : 1) : 0;
        if (image->sample == PAGS_U8)
          ((uint8_t *)image->data)[at] = (uint8_t)(v * 255.0f + 0.5f);
        else if (image->sample == PAGS_U16)
          ((uint16_t *)image->data)[at] = (uint16_t)(v * 65535.0f + 0.5f);
        else
          ((float *)image->data)[at] = v;
      }
    }
}

pags_result pags_picture_to_image(const pags_picture *picture, pags_sample sample, pags_image *out) {
  PAGS_TRY(pags_image_create(out, picture->width, picture->height, 3, sample));
  fill(picture->rgb, picture->stride, out);
  return PAGS_OK;
}

/* Joins folder and file; where the file's name has folders, makes them. */
static pags_result join(const char *folder, const char *file, char **path) {
  *path = pags_path_join(folder, file);
  PAGS_CHECK_MEMORY(*path, NULL);
  if (!strchr(file, '/'))
    return PAGS_OK;
  PAGS_AUTOFREE char *within = pags_path_folder(*path);
  PAGS_CHECK_MEMORY(within, NULL);
  return pags_make_dirs(within);
}

pags_result pags_image_save_in(const char *folder, const char *file, const pags_image *image) {
  PAGS_AUTOFREE char *path = NULL;
  PAGS_TRY(join(folder, file, &path));
  return pags_image_save(path, image);
}

static pags_result save_png(const pags_picture *picture, const float *const *planes, int count, int bits,
                            const char *path) {
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  PAGS_TRY(pags_image_create(&image, picture->width, picture->height, count, bits == 16 ? PAGS_U16 : PAGS_U8));
  fill(planes, picture->stride, &image);
  return pags_image_save(path, &image);
}

/* ---- Planes of a channel ---- */

static void fill_values(const pags_picture_writer *writer, const pags_picture *picture, pags_channel channel,
                        float *out) {
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  for (size_t i = 0; i < count; i++) {
    int32_t id = channel == PAGS_CHANNEL_ALPHA ? 0 : picture->id[i];
    out[i] = channel == PAGS_CHANNEL_ALPHA    ? 1 - picture->transmittance[i]
             : channel == PAGS_CHANNEL_ID     ? (float)id
             : channel == PAGS_CHANNEL_OBJECT ? (id < 0 ? -1.0f : (float)writer->object_of[id])
                                              : (id < 0 ? 0.0f : writer->priority_of[id]);
  }
}

static void fill_heat(const pags_picture_writer *writer, const pags_picture *picture, float *const out[3]) {
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  for (size_t i = 0; i < count; i++) {
    float rgb[3] = {0, 0, 0}, shown = 1 - picture->transmittance[i];
    if (picture->id[i] >= 0)
      pags_colormap_heat(writer->priority_of[picture->id[i]], rgb);
    for (int c = 0; c < 3; c++)
      out[c][i] = shown * rgb[c];
  }
}

/* Finds the planes of a channel, computing them into `scratch` if neither picture nor passes have them. */
static void find_planes(const pags_picture_writer *writer, const pags_picture *picture, const pags_passes *passes,
                        const pags_camera *camera, pags_channel channel, float *scratch,
                        const float *planes[PAGS_MATTE_PLANES]) {
  const size_t count = (size_t)picture->stride * (size_t)picture->height;
  float *const own[3] = {scratch, scratch + count, scratch + 2 * count};
  const float *const computed[3] = {own[0], own[1], own[2]}, *const *from = computed;
  switch (channel) {
    case PAGS_CHANNEL_COLOR: from = picture->rgb; break;
    case PAGS_CHANNEL_DEPTH: from = &picture->depth; break;
    case PAGS_CHANNEL_NORMAL: pags_normals_from_depth(picture, camera, own); break;
    case PAGS_CHANNEL_HEAT: fill_heat(writer, picture, own); break;
    case PAGS_CHANNEL_CRYPTO_OBJECT: from = passes->matte[0]; break;
    case PAGS_CHANNEL_CRYPTO_CLASS: from = passes->matte[1]; break;
    case PAGS_CHANNEL_EXPECTED_NORMAL: from = passes->normal; break;
    case PAGS_CHANNEL_MOTION: from = passes->motion; break;
    case PAGS_CHANNEL_BLENDED: from = &passes->pairs[0]; break;
    case PAGS_CHANNEL_OVERDRAW: from = &passes->pairs[1]; break;
    default: fill_values(writer, picture, channel, scratch);
  }
  for (int c = 0; c < channels[channel].planes; c++)
    planes[c] = from[c];
}

/* ---- Writing ---- */

static pags_result write_exr(const pags_picture_writer *writer, const pags_picture *picture, const float *const *planes,
                             pags_channel channel, const char *path) {
  const int m = channel == PAGS_CHANNEL_CRYPTO_CLASS;
  char keys[4][40], hash[9];
  const char *texts[9] = {NULL};
  if (channel == PAGS_CHANNEL_CRYPTO_OBJECT || m) {
    /* The attributes by which other programs know a Cryptomatte (specification 1.2.0): name and value by turns. The key
     * is made of the first seven digits of the hash of the layer's name. */
    const char *const layer = m ? "CryptoClass" : "CryptoObject";
    const char *const attributes[4][2] = {{"name", layer},
                                          {"hash", "MurmurHash3_32"},
                                          {"conversion", "uint32_to_float32"},
                                          {"manifest", writer->mattes[m].manifest}};
    snprintf(hash, sizeof hash, "%08x", pags_cryptomatte_hash(layer, strlen(layer)));
    for (int k = 0; k < 4; k++) {
      snprintf(keys[k], sizeof keys[k], "cryptomatte/%.7s/%s", hash, attributes[k][0]);
      texts[2 * k] = keys[k];
      texts[2 * k + 1] = attributes[k][1];
    }
  }
  return pags_image_save_exr(path, picture->width, picture->height, channels[channel].planes, channels[channel].exr,
                             planes, picture->stride, texts);
}

/* pags_passes has only pointers to planes. */
enum { MOST_SLOTS = 16, PICTURE_PLANES = 6, PASS_PLANES = sizeof(pags_passes) / sizeof(const float *) };
enum { PLANES = PICTURE_PLANES + PASS_PLANES };

struct pags_picture_slot {
  pags_picture picture; /* its planes and those of the passes point into `memory` */
  pags_passes passes;
  pags_camera camera;
  float *memory;
  int64_t capacity; /* floats */
  float *scratch;   /* three planes */
  int64_t scratch_capacity;
  char name[PAGS_STEM];
  bool written;
  pags_result result;
  char message[1024]; /* copy of the error message, which is local to the worker thread that failed */
};

/* Writes every channel of a slot's picture. */
static pags_result write_picture(const pags_picture_queue *queue, pags_picture_slot *slot) {
  const pags_picture_writer *const writer = queue->writer;
  const pags_picture *const picture = &slot->picture;
  PAGS_CHECK_MEMORY(pags_grow(&slot->scratch, (int64_t)3 * picture->stride * picture->height, &slot->scratch_capacity,
                              sizeof *slot->scratch),
                    "a picture of %dx%d", picture->width, picture->height);
  for (int c = 0; c < PAGS_CHANNEL_COUNT; c++) {
    const pags_channel channel = (pags_channel)c;
    const float *planes[PAGS_MATTE_PLANES];
    char file[PAGS_STEM + 24];
    PAGS_AUTOFREE char *path = NULL;
    if (!has(writer, channel))
      continue;
    const bool color = channel == PAGS_CHANNEL_COLOR;
    const bool png = channel == PAGS_CHANNEL_HEAT || (writer->format == PAGS_PICTURE_PNG && c <= PAGS_CHANNEL_ALPHA);
    snprintf(file, sizeof file, "%s%s%s%s", slot->name, color ? "" : "_", color ? "" : channels[c].name,
             png ? ".png" : ".exr");
    PAGS_TRY(join(queue->folder, file, &path));
    find_planes(writer, picture, &slot->passes, &slot->camera, channel, slot->scratch, planes);
    PAGS_TRY(png ? save_png(picture, planes, channels[c].planes, writer->bits, path)
                 : write_exr(writer, picture, planes, channel, path));
  }
  return PAGS_OK;
}

bool pags_picture_writer_needs_extras(const pags_picture_writer *writer) {
  return (writer->channels & ~(1u << PAGS_CHANNEL_COLOR | 1u << PAGS_CHANNEL_ALPHA | PAGS_CHANNELS_PASSES)) != 0;
}

/* ---- Passes ---- */

pags_result pags_render_passes_moment(pags_render_passes *passes, int side, const pags_camera *camera) {
  const pags_part *parts;
  pags_moment *const moment = &passes->moments[side];
  passes->known[side] = camera != NULL;
  if (!camera)
    return PAGS_OK;
  moment->camera = *camera;
  pags_compose(passes->composition, camera->time, &parts, &moment->part_count);
  PAGS_CHECK_MEMORY(pags_grow(&passes->copies[side], moment->part_count + 1, &passes->capacity[side], sizeof *parts),
                    "%d parts", moment->part_count);
  memcpy(passes->copies[side], parts, (size_t)moment->part_count * sizeof *parts);
  moment->parts = passes->copies[side];
  return PAGS_OK;
}

pags_result pags_render_passes_draw(pags_render_passes *passes, pags_frame *frame, const pags_part *parts,
                                    int part_count, pags_passes *out) {
  pags_matte mattes[2];
  pags_pass_request request = {
      .normal = has(passes->writer, PAGS_CHANNEL_EXPECTED_NORMAL),
      .pairs = has(passes->writer, PAGS_CHANNEL_BLENDED) || has(passes->writer, PAGS_CHANNEL_OVERDRAW)};
  for (int m = 0; m < 2; m++) {
    const pags_matte_names *const names = &passes->writer->mattes[m];
    if (!has(passes->writer, m ? PAGS_CHANNEL_CRYPTO_CLASS : PAGS_CHANNEL_CRYPTO_OBJECT))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&passes->names[m], part_count + 1, &passes->capacity[2 + m], sizeof *passes->names[m]),
                      "%d parts", part_count);
    for (int p = 0; p < part_count; p++) /* the last label is the background's */
      passes->names[m][p] = names->name_of_label[parts[p].label < 0 ? names->label_count - 1 : parts[p].label];
    mattes[m] = (pags_matte){names->count, names->values, passes->names[m]};
    request.matte[m] = &mattes[m];
  }
  if (has(passes->writer, PAGS_CHANNEL_MOTION)) {
    /* The first and the last picture of a sequence have one neighbour; a single one has none, and nothing moves. */
    request.before = passes->known[0] ? &passes->moments[0] : NULL;
    request.after = passes->known[1] ? &passes->moments[1] : NULL;
    request.motion = 1;
  }
  return pags_frame_passes(frame, &request, out);
}

void pags_render_passes_destroy(pags_render_passes *passes) {
  for (int k = 0; k < 2; k++) {
    free(passes->copies[k]);
    free(passes->names[k]);
  }
}

/* ---- The queue: pictures are copied into slots, all of which are written in parallel when they are full ---- */

static void write_slots(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const pags_picture_queue *queue = context;
  for (int64_t i = begin; i < end; i++) {
    pags_picture_slot *slot = &queue->slots[i];
    slot->result = write_picture(queue, slot);
    slot->written = true;
    if (slot->result != PAGS_OK)
      snprintf(slot->message, sizeof slot->message, "%s", pags_error_message());
  }
}

pags_result pags_picture_queue_create(const pags_picture_writer *writer, pags_tasks *tasks, const char *folder,
                                      pags_picture_queue *out) {
  int workers = pags_tasks_workers(tasks), count = workers < MOST_SLOTS ? workers : MOST_SLOTS;
  *out = (pags_picture_queue){.writer = writer, .tasks = tasks, .folder = folder, .count = count};
  out->slots = calloc((size_t)count, sizeof *out->slots);
  PAGS_CHECK_MEMORY(out->slots, NULL);
  return PAGS_OK;
}

void pags_picture_queue_destroy(pags_picture_queue *queue) {
  if (queue->slots)
    for (int i = 0; i < queue->count; i++) {
      free(queue->slots[i].memory);
      free(queue->slots[i].scratch);
    }
  free(queue->slots);
}

/* The pointers to planes in a slot; returns how many. */
static int list_planes(pags_picture_slot *slot, const float **list[PLANES]) {
  int count = 0;
  for (int c = 0; c < 3; c++)
    list[count++] = &slot->picture.rgb[c];
  list[count++] = &slot->picture.transmittance;
  list[count++] = &slot->picture.depth;
  list[count++] = (const float **)(void *)&slot->picture.id;
  const float **const passes = (const float **)&slot->passes;
  for (int k = 0; k < PASS_PLANES; k++)
    list[count++] = &passes[k];
  return count;
}

pags_result pags_picture_queue_put(pags_picture_queue *queue, const pags_picture *picture, const pags_passes *passes,
                                   const pags_camera *camera, const char *name) {
  pags_picture_slot *slot = &queue->slots[queue->used];

  /* Copy the planes into the slot, growing its memory if they need more than any before. */
  const size_t count = (size_t)picture->stride * (size_t)picture->height;
  const float **list[PLANES];
  int64_t planes = 0;
  slot->picture = *picture;
  slot->passes = *passes;
  const int listed = list_planes(slot, list);
  for (int k = 0; k < listed; k++)
    planes += *list[k] != NULL;
  PAGS_CHECK_MEMORY(pags_grow(&slot->memory, planes * (int64_t)count, &slot->capacity, sizeof *slot->memory),
                    "a picture of %dx%d", picture->width, picture->height);
  float *to = slot->memory;
  for (int k = 0; k < listed; k++)
    if (*list[k]) {
      memcpy(to, *list[k], count * sizeof *to);
      *list[k] = to;
      to += count;
    }

  slot->camera = *camera;
  slot->picture.depth_sum = NULL;
  snprintf(slot->name, sizeof slot->name, "%s", name);
  slot->written = false;
  queue->used++;
  return queue->used == queue->count ? pags_picture_queue_finish(queue) : PAGS_OK;
}

pags_result pags_picture_queue_finish(pags_picture_queue *queue) {
  int used = queue->used;
  queue->used = 0;
  pags_parallel_for(queue->tasks, used, 1, write_slots, queue);
  for (int i = 0; i < used; i++) {
    if (!queue->slots[i].written) /* the parallel loop was cancelled before it reached this slot */
      write_slots(queue, i, i + 1, 0);
    if (queue->slots[i].result != PAGS_OK)
      return pags_fail(queue->slots[i].result, "%s", queue->slots[i].message);
  }
  return PAGS_OK;
}
