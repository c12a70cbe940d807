/* SPDX-License-Identifier: Apache-2.0 */
/* OpenEXR files. Reading goes through OpenEXRCore, the C library of OpenEXR. Writing needs no library but zlib: a
 * header, a table of places and blocks of 16 rows. */
#include "image/exr.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <openexr.h>
#include <zlib.h>

#include "base/bytes.h"
#include "base/half.h"
#include "base/memory.h"

enum { MOST_CHANNELS = 1024 };
enum { RATIO = 1032 }; /* the most bytes that deflate makes of one; RLE and PIZ make fewer */

typedef struct exr_state {
  exr_context_t context;
  const pags_encoded *file;
  int width, height, channels;
  uint64_t pixel; /* bytes of a pixel in the file */
  int order[4];   /* which of the file's channels, which are sorted by name, becomes channel i */
  bool alpha;     /* the last of 2, or the fourth of more channels is alpha */
  char message[256];
} exr_state;

/* ---- Callbacks ---- */

/* Counts the thread's allocations that failed. OpenEXRCore's allocator knows of no context, and its error code for
 * lack of memory also stands for damaged blocks. */
static _Thread_local int failed_allocations;

static void *allocate(size_t size) {
  void *const block = calloc(1, size); /* a damaged block may leave parts of a buffer as they were */
  failed_allocations += !block;
  return block;
}

static void release(void *block) {
  free(block);
}

static void on_error(exr_const_context_t context, exr_result_t code, const char *text) {
  void *user = NULL;
  (void)code;
  if (!context || exr_get_user_data(context, &user) != EXR_ERR_SUCCESS || !user)
    return;
  exr_state *const state = user;
  if (state->message[0])
    return; /* the first one is the cause */
  snprintf(state->message, sizeof state->message, "%s", text);
  state->message[strcspn(state->message, "\n")] = '\0';
}

static int64_t size_of_file(exr_const_context_t context, void *user) {
  (void)context;
  return (int64_t)((const exr_state *)user)->file->size;
}

static int64_t read_bytes(exr_const_context_t context, void *user, void *out, uint64_t size, uint64_t at,
                          exr_stream_error_func_ptr_t error) {
  (void)context, (void)error;
  const pags_encoded *const file = ((const exr_state *)user)->file;
  if (at > file->size)
    return 0;
  const size_t left = file->size - (size_t)at, got = size < left ? (size_t)size : left;
  memcpy(out, file->bytes + at, got);
  return (int64_t)got;
}

/* ---- The order of channels ---- */

/* A channel's name LAYER.SUFFIX, or SUFFIX. */
typedef struct channel_name {
  const char *name, *suffix;
  size_t layer; /* length of LAYER */
  int rank;     /* of the suffix among the known ones */
  int index;    /* in the file */
} channel_name;

static channel_name split_name(const char *name, int index) {
  const char *const dot = strrchr(name, '.');
  return (channel_name){
      .name = name, .suffix = dot ? dot + 1 : name, .layer = dot ? (size_t)(dot - name) : 0, .index = index};
}

static int compare_layers(const channel_name *a, const channel_name *b) {
  const int order = memcmp(a->name, b->name, a->layer < b->layer ? a->layer : b->layer);
  return order != 0 ? order : (a->layer > b->layer) - (a->layer < b->layer);
}

static int compare_names(const void *left, const void *right) {
  const channel_name *const a = left, *const b = right;
  int order = compare_layers(a, b);
  if (order == 0)
    order = a->rank - b->rank;
  if (order == 0)
    order = strcmp(a->suffix, b->suffix);
  return order != 0 ? order : a->index - b->index;
}

static bool layer_has(const channel_name *names, int count, const channel_name *like, const char *suffix) {
  for (int i = 0; i < count; i++)
    if (strcasecmp(names[i].suffix, suffix) == 0 && compare_layers(&names[i], like) == 0)
      return true;
  return false;
}

/* Sets the ranks: colours, alpha, depth. In a layer with X and with Y or Z these are coordinates, and follow the
 * colours. */
static void rank_names(channel_name *names, int count) {
  static const char *const colours[] = {"R",  "Red", "G",  "Green", "B",  "Blue", "Y", "real",  "imag",  "A", "Alpha",
                                        "AR", "RA",  "AG", "GA",    "AB", "BA",   "Z", "Depth", "Zback", NULL};
  static const char *const positions[] = {"R",  "Red",  "G",    "Green", "B",     "Blue", "X",  "Y",
                                          "Z",  "real", "imag", "A",     "Alpha", "AR",   "RA", "AG",
                                          "GA", "AB",   "BA",   "Depth", "Zback", NULL};
  for (int i = 0; i < count; i++) {
    const bool position = layer_has(names, count, &names[i], "X") &&
                          (layer_has(names, count, &names[i], "Y") || layer_has(names, count, &names[i], "Z"));
    const char *const *const known = position ? positions : colours;
    while (known[names[i].rank] && strcasecmp(names[i].suffix, known[names[i].rank]) != 0)
      names[i].rank++;
  }
}

static pags_result order_channels(exr_state *state, const exr_attr_chlist_t *list) {
  channel_name *const names = malloc((size_t)list->num_channels * sizeof *names);
  if (!names)
    return pags_out_of_memory("%s", state->file->path);
  for (int i = 0; i < list->num_channels; i++)
    names[i] = split_name(list->entries[i].name.str, i);
  rank_names(names, list->num_channels);
  qsort(names, (size_t)list->num_channels, sizeof *names, compare_names);
  for (int i = 0; i < 4 && i < list->num_channels; i++)
    state->order[i] = names[i].index;
  const int last = list->num_channels == 2 ? 1 : 3;
  state->alpha = list->num_channels > last &&
                 (strcasecmp(names[last].suffix, "A") == 0 || strcasecmp(names[last].suffix, "Alpha") == 0);
  free(names);
  return PAGS_OK;
}

/* ---- Reading ---- */

/* Fails with OpenEXRCore's message, as `bad` puts it. */
static pags_result explain(const exr_state *state, exr_result_t code,
                           pags_result (*bad)(const pags_encoded *, const char *, const char *)) {
  if (failed_allocations > 0)
    return pags_out_of_memory("%s", state->file->path);
  return bad(state->file, "EXR", state->message[0] ? state->message : exr_get_default_error_message(code));
}

static pags_result unsupported(const exr_state *state, const char *what) {
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s: an EXR file with %s: expected scan lines, uncompressed or compressed by RLE, ZIP, ZIPS or PIZ, "
                   "and channels as large as the picture",
                   state->file->path, what);
}

/* Checks that the first part is of a kind that is read here, and reads its size and channels. `least` gets the fewest
 * bytes of a file with such samples. */
static pags_result read_header(exr_state *state, uint64_t *least) {
  exr_storage_t storage;
  exr_compression_t compression;
  exr_attr_box2i_t window;
  const exr_attr_chlist_t *list;
  exr_result_t code = exr_get_storage(state->context, 0, &storage);
  if (code == EXR_ERR_SUCCESS)
    code = exr_get_compression(state->context, 0, &compression);
  if (code == EXR_ERR_SUCCESS)
    code = exr_get_data_window(state->context, 0, &window);
  if (code == EXR_ERR_SUCCESS)
    code = exr_get_channels(state->context, 0, &list);
  if (code != EXR_ERR_SUCCESS)
    return explain(state, code, pags_encoded_bad_header);
  if (storage != EXR_STORAGE_SCANLINE)
    return unsupported(state, storage == EXR_STORAGE_TILED ? "tiles" : "deep samples");
  if (compression > EXR_COMPRESSION_PIZ)
    return unsupported(state, "another compression");
  if (list->num_channels > MOST_CHANNELS)
    return unsupported(state, "more than 1024 channels");
  for (int i = 0; i < list->num_channels; i++) {
    if (list->entries[i].x_sampling != 1 || list->entries[i].y_sampling != 1)
      return unsupported(state, "subsampled channels");
    state->pixel += list->entries[i].pixel_type == EXR_PIXEL_HALF ? 2 : 4;
  }
  const pags_picture_info info = {.width = (int64_t)window.max.x - window.min.x + 1,
                                  .height = (int64_t)window.max.y - window.min.y + 1,
                                  .channels = list->num_channels};
  PAGS_TRY(pags_encoded_check(state->file, &info, 0));
  state->width = (int)info.width;
  state->height = (int)info.height;
  state->channels = info.channels;
  *least =
      (uint64_t)info.width * (uint64_t)info.height * state->pixel / (compression == EXR_COMPRESSION_NONE ? 1 : RATIO);
  return order_channels(state, list);
}

/* Opens the file and reads its header. Whatever it returns, exr_finish is due. */
static pags_result begin(exr_state *state, uint64_t *least) {
  exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
  setup.error_handler_fn = on_error;
  setup.alloc_fn = allocate;
  setup.free_fn = release;
  setup.user_data = state;
  setup.read_fn = read_bytes;
  setup.size_fn = size_of_file;
  setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
  failed_allocations = 0;
  const exr_result_t code = exr_start_read(&state->context, state->file->path, &setup);
  return code == EXR_ERR_SUCCESS ? read_header(state, least) : explain(state, code, pags_encoded_bad_header);
}

/* Converts a row of one channel, stored little-endian, to floats that lie `step` apart. */
static void convert_row(const uint8_t *from, exr_pixel_type_t type, int width, float *to, size_t step) {
  for (int x = 0; x < width; x++, to += step) {
    if (type == EXR_PIXEL_HALF) {
      *to = pags_float_from_half(pags_load_u16(from));
      from += 2;
      continue;
    }
    *to = type == EXR_PIXEL_UINT ? (float)pags_load_u32(from) * 0x1p-32f : pags_load_f32(from);
    from += 4;
  }
}

/* Converts a block that lies decompressed in the pipeline, row by row and in each channel by channel, to the rows of
 * the picture from `y` on. OpenEXRCore's own conversion (3.1.5) mixes up four channels of halves. */
static void convert_block(const exr_state *state, const exr_decode_pipeline_t *pipeline, const pags_image *out, int y) {
  const uint8_t *from = pipeline->unpacked_buffer;
  for (int row = 0; row < pipeline->chunk.height; row++)
    for (int i = 0; i < pipeline->channel_count; i++) {
      const exr_coding_channel_info_t *const channel = &pipeline->channels[i];
      float *const to = (float *)out->data + (size_t)(y + row) * (size_t)out->width * (size_t)out->channels;
      for (int c = 0; c < out->channels; c++)
        if (state->order[c] == i)
          convert_row(from, (exr_pixel_type_t)channel->data_type, out->width, to + c, (size_t)out->channels);
      from += (size_t)out->width * (size_t)channel->bytes_per_element;
    }
}

/* Reads block after block; all but the last have the same number of rows. */
static exr_result_t read_blocks(exr_state *state, exr_decode_pipeline_t *pipeline, const pags_image *out) {
  exr_attr_box2i_t window;
  exr_chunk_info_t block;
  exr_result_t code = exr_get_data_window(state->context, 0, &window);
  for (int y = 0; code == EXR_ERR_SUCCESS && y < out->height; y += block.height) {
    code = exr_read_scanline_chunk_info(state->context, 0, window.min.y + y, &block);
    if (code == EXR_ERR_SUCCESS)
      code = y == 0 ? exr_decoding_initialize(state->context, 0, &block, pipeline)
                    : exr_decoding_update(state->context, 0, &block, pipeline);
    if (code == EXR_ERR_SUCCESS && y == 0)
      code = exr_decoding_choose_default_routines(state->context, 0, pipeline);
    if (code != EXR_ERR_SUCCESS)
      break;
    if (pipeline->channel_count != state->channels || block.height < 1 || block.height > out->height - y ||
        block.unpacked_size != state->pixel * (uint64_t)out->width * (uint64_t)block.height ||
        (block.compression == EXR_COMPRESSION_NONE && block.packed_size != block.unpacked_size))
      return EXR_ERR_CORRUPT_CHUNK;
    pipeline->unpack_and_convert_fn = NULL;
    code = exr_decoding_run(state->context, 0, pipeline);
    if (code == EXR_ERR_SUCCESS)
      convert_block(state, pipeline, out, y);
  }
  return code;
}

static pags_result decode(exr_state *state, int most, pags_image *out) {
  uint64_t least;
  PAGS_TRY(begin(state, &least));
  const pags_picture_info info = {.width = state->width, .height = state->height, .channels = state->channels};
  PAGS_TRY(pags_encoded_check(state->file, &info, least));
  PAGS_TRY(
      pags_image_create(out, state->width, state->height, state->channels < most ? state->channels : most, PAGS_F32));
  exr_decode_pipeline_t pipeline = EXR_DECODE_PIPELINE_INITIALIZER;
  const exr_result_t code = read_blocks(state, &pipeline, out);
  const pags_result result = code == EXR_ERR_SUCCESS ? PAGS_OK : explain(state, code, pags_encoded_bad_samples);
  exr_decoding_destroy(state->context, &pipeline);
  return result;
}

pags_result pags_exr_inspect(const pags_encoded *file, pags_image_facts *facts) {
  exr_state state = {.file = file};
  uint64_t least;
  const pags_result result = begin(&state, &least);
  exr_finish(&state.context);
  if (result == PAGS_OK)
    *facts = (pags_image_facts){
        .width = state.width, .height = state.height, .alpha = state.alpha, .sample = PAGS_F32, .orientation = 1};
  return result;
}

pags_result pags_exr_decode(const pags_encoded *file, int most, pags_image *out) {
  exr_state state = {.file = file};
  memset(out, 0, sizeof *out);
  const pags_result result = decode(&state, most, out);
  exr_finish(&state.context);
  if (result != PAGS_OK)
    pags_image_destroy(out);
  return result;
}

/* ---- Writing ---- */

enum { BLOCK_ROWS = 16, LEVEL = 4 }; /* rows of a ZIP block; of compression */

/* A sink, and whether all puts so far have succeeded. Numbers are little-endian. */
typedef struct exr_output {
  pags_sink *sink;
  bool ok;
} exr_output;

static void put(exr_output *out, const void *bytes, size_t size) {
  out->ok = out->ok && pags_sink_put(out->sink, bytes, size);
}

static void put_u32(exr_output *out, uint32_t value) {
  uint8_t bytes[4];
  pags_store_u32(bytes, value);
  put(out, bytes, sizeof bytes);
}

static void put_float(exr_output *out, float value) {
  uint8_t bytes[4];
  pags_store_f32(bytes, value);
  put(out, bytes, sizeof bytes);
}

static void put_text(exr_output *out, const char *text) {
  put(out, text, strlen(text) + 1);
}

static void put_attribute(exr_output *out, const char *name, const char *type, size_t size) {
  put_text(out, name);
  put_text(out, type);
  put_u32(out, (uint32_t)size);
}

static void put_window(exr_output *out, const char *name, const pags_exr_planes *picture) {
  put_attribute(out, name, "box2i", 16);
  put_u32(out, 0);
  put_u32(out, 0);
  put_u32(out, (uint32_t)picture->width - 1);
  put_u32(out, (uint32_t)picture->height - 1);
}

/* Writes magic number, version and attributes. The date is always the same, so that the same picture is the same
 * bytes. `order` lists the channels by name. */
static void put_header(exr_output *out, const pags_exr_planes *picture, const int *order) {
  static const char date[] = "1970:01:01 00:00:00";
  static const uint8_t zip = 3, increasing = 0, end = 0;
  enum { FLOAT = 2 };
  size_t list = 1, longest = 0;
  for (int c = 0; c < picture->channels; c++) {
    const size_t length = strlen(picture->names[c]);
    list += length + 17;
    longest = length > longest ? length : longest;
  }
  put_u32(out, 20000630);
  put_u32(out, longest > 31 ? 0x402 : 2); /* version 2, and whether names are long */
  put_attribute(out, "capDate", "string", sizeof date - 1);
  put(out, date, sizeof date - 1);
  put_attribute(out, "channels", "chlist", list);
  for (int c = 0; c < picture->channels; c++) {
    put_text(out, picture->names[order[c]]);
    put_u32(out, FLOAT);
    put_u32(out, 0); /* not perceptually linear */
    put_u32(out, 1); /* a sample for each pixel, across and down */
    put_u32(out, 1);
  }
  put(out, &end, 1);
  put_attribute(out, "compression", "compression", 1);
  put(out, &zip, 1);
  put_window(out, "dataWindow", picture);
  put_window(out, "displayWindow", picture);
  put_attribute(out, "lineOrder", "lineOrder", 1);
  put(out, &increasing, 1);
  put_attribute(out, "pixelAspectRatio", "float", 4);
  put_float(out, 1);
  put_attribute(out, "screenWindowCenter", "v2f", 8);
  put_float(out, 0);
  put_float(out, 0);
  put_attribute(out, "screenWindowWidth", "float", 4);
  put_float(out, 1);
  for (const char *const *text = picture->texts; text && *text; text += 2) {
    put_attribute(out, text[0], "string", strlen(text[1]));
    put(out, text[1], strlen(text[1]));
  }
  put(out, &end, 1);
}

/* Copies rows [begin, end) to `raw`, row by row and in each channel by channel; returns their bytes. */
static size_t gather(const pags_exr_planes *picture, const int *order, int begin, int end, uint8_t *raw) {
  size_t size = 0;
  for (int y = begin; y < end; y++)
    for (int c = 0; c < picture->channels; c++) {
      const float *const row = picture->planes[order[c]] + (size_t)y * picture->row_step;
      for (int x = 0; x < picture->width; x++, size += 4)
        pags_store_f32(raw + size, row[(size_t)x * picture->pixel_step]);
    }
  return size;
}

/* Splits the bytes into those at even and at odd places, and replaces each but the first by its difference from the
 * one before, plus 128: what ZIP blocks hold, compressed. */
static void predict(const uint8_t *raw, size_t size, uint8_t *out) {
  const size_t half = (size + 1) / 2;
  for (size_t i = 0; i < size; i++)
    out[i % 2 == 0 ? i / 2 : half + i / 2] = raw[i];
  for (size_t i = size - 1; i > 0; i--)
    out[i] = (uint8_t)(out[i] - out[i - 1] + 128);
}

/* Writes the blocks and, into the table at byte `table` of the sink, where each begins. `work` holds three times
 * `most` bytes, those of a block and what it may be compressed to. */
static void put_blocks(exr_output *out, const pags_exr_planes *picture, const int *order, uint8_t *work, size_t most) {
  const size_t table = out->sink->size;
  uint8_t *const raw = work, *const predicted = work + most, *const packed = work + 2 * most;
  const int blocks = (picture->height + BLOCK_ROWS - 1) / BLOCK_ROWS;
  for (int i = 0; i < 2 * blocks; i++)
    put_u32(out, 0);
  for (int i = 0; out->ok && i < blocks; i++) {
    const int begin = i * BLOCK_ROWS;
    const int end = begin + BLOCK_ROWS < picture->height ? begin + BLOCK_ROWS : picture->height;
    pags_store_u64(out->sink->bytes + table + 8 * (size_t)i, out->sink->size);
    const size_t size = gather(picture, order, begin, end, raw);
    uLongf length = (uLongf)most;
    predict(raw, size, predicted);
    /* A block that zlib can't make shorter is stored as it is. */
    const bool shorter = compress2(packed, &length, predicted, (uLong)size, LEVEL) == Z_OK && length < size;
    put_u32(out, (uint32_t)begin);
    put_u32(out, (uint32_t)(shorter ? length : size));
    put(out, shorter ? packed : raw, shorter ? length : size);
  }
}

pags_result pags_exr_encode(const char *path, const pags_exr_planes *picture, pags_sink *out) {
  assert(picture->channels >= 1 && picture->channels <= 64);
  int order[64];
  for (int c = 0; c < picture->channels; c++) { /* by insertion */
    int at = c;
    for (; at > 0 && strcmp(picture->names[order[at - 1]], picture->names[c]) > 0; at--)
      order[at] = order[at - 1];
    order[at] = c;
  }
  exr_output output = {.sink = out, .ok = true};
  const size_t most = 4 * (size_t)picture->width * (size_t)picture->channels * BLOCK_ROWS;
  uint8_t *const work = malloc(3 * most);
  if (work) {
    put_header(&output, picture, order);
    put_blocks(&output, picture, order, work, most);
  }
  free(work);
  return work && output.ok ? PAGS_OK : pags_out_of_memory("%s", path);
}
