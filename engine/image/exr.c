/* SPDX-License-Identifier: Apache-2.0 */
/* Reads OpenEXR files through OpenEXRCore, the C library of OpenEXR. */
#include <stdio.h>

#include <openexr.h>

#include "base/bytes.h"
#include "base/half.h"
#include "base/memory.h"
#include "image/formats.h"
#include "image/layers.h"
#include "image/pixels.h"

enum { MOST_CHANNELS = 1024 };
enum { RATIO = 1032 }; /* the most bytes that deflate makes of one; RLE and PIZ make fewer */

typedef struct exr_state {
  exr_context_t context;
  const pags_encoded *file;
  pags_layer layer;            /* what is read */
  int width, height;           /* of the display window, which is the picture */
  int data_width, data_height; /* of the data window of the layer's part */
  int left, top;               /* of the data window in the display window */
  int first;                   /* line of the data window */
  int channels;                /* of the part */
  uint64_t pixel;              /* bytes of a pixel of the part in the file */
  pags_image_window window;
  float pixel_aspect;
  char message[256];
} exr_state;

static void finish(exr_state *state) {
  exr_finish(&state->context);
}

/* ---- Callbacks ---- */

/* Counts the thread's allocations that failed. OpenEXRCore's allocator knows of no context, and its error code for
 * PAGS_ERROR_MEMORY is also returned for damaged blocks. */
static _Thread_local int failed_allocations;

static void *allocate(size_t size) {
  void *const block = calloc(1, size); /* a damaged block may leave parts of a buffer as they were */
  failed_allocations += !block;
  return block;
}

static void on_error(exr_const_context_t context, PAGS_UNUSED exr_result_t code, const char *text) {
  void *user = NULL;
  if (!context || exr_get_user_data(context, &user) != EXR_ERR_SUCCESS || !user)
    return;
  exr_state *const state = user;
  if (state->message[0])
    return; /* the first one is the cause */
  snprintf(state->message, sizeof state->message, "%s", text);
  state->message[strcspn(state->message, "\n")] = '\0';
}

static int64_t size_of_file(PAGS_UNUSED exr_const_context_t context, void *user) {
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

/* ---- Reading ---- */

/* Fails with OpenEXRCore's message. */
static pags_result explain(const exr_state *state, exr_result_t code, const char *what) {
  if (failed_allocations > 0)
    return pags_out_of_memory("%s", state->file->path);
  return pags_encoded_bad(state->file, what, "EXR",
                          state->message[0] ? state->message : exr_get_default_error_message(code));
}

static pags_result unsupported(const exr_state *state, const char *what) {
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s: an EXR file with %s: expected scan lines, uncompressed or compressed by RLE, ZIP, ZIPS or PIZ, "
                   "and channels as large as the picture",
                   state->file->path, what);
}

/* Lists the channels of all parts and chooses the picture's. */
static pags_result choose_layer(exr_state *state) {
  int parts, count = 0;
  exr_result_t code = exr_get_count(state->context, &parts);
  PAGS_AUTOFREE pags_layer_channel *channels = malloc(MOST_CHANNELS * sizeof *channels);
  PAGS_CHECK_MEMORY(channels, "%s", state->file->path);
  for (int part = 0; code == EXR_ERR_SUCCESS && part < parts; part++) {
    const exr_attr_chlist_t *list;
    const char *name = "";
    code = exr_get_channels(state->context, part, &list);
    if (code == EXR_ERR_SUCCESS && parts > 1)
      code = exr_get_name(state->context, part, &name);
    if (code != EXR_ERR_SUCCESS)
      break;
    if (list->num_channels > MOST_CHANNELS - count)
      return unsupported(state, "more than 1024 channels");
    for (int i = 0; i < list->num_channels; i++)
      channels[count++] = (pags_layer_channel){.name = list->entries[i].name.str,
                                               .part = name,
                                               .part_index = part,
                                               .index = i,
                                               .number = list->entries[i].pixel_type == EXR_PIXEL_UINT};
  }
  return code == EXR_ERR_SUCCESS ? pags_layer_choose(state->file->path, channels, count, &state->layer)
                                 : explain(state, code, PAGS_BAD_HEADER);
}

/* Chooses the layer, checks that its part is of a kind that is read here, and reads its windows and channels. `least`
 * gets the fewest bytes of a file with such samples. */
static pags_result read_header(exr_state *state, uint64_t *least) {
  exr_storage_t storage;
  exr_compression_t compression;
  exr_attr_box2i_t data, display;
  const exr_attr_chlist_t *list;
  PAGS_TRY(choose_layer(state));
  const int part = state->layer.part;
  const exr_const_context_t context = state->context;
  exr_result_t code = exr_get_storage(context, part, &storage);
  code = code ? code : exr_get_compression(context, part, &compression);
  code = code ? code : exr_get_data_window(context, part, &data);
  code = code ? code : exr_get_display_window(context, part, &display);
  code = code ? code : exr_get_pixel_aspect_ratio(context, part, &state->pixel_aspect);
  code = code ? code : exr_get_channels(context, part, &list);
  if (code != EXR_ERR_SUCCESS)
    return explain(state, code, PAGS_BAD_HEADER);
  if (storage != EXR_STORAGE_SCANLINE)
    return unsupported(state, storage == EXR_STORAGE_TILED ? "tiles" : "deep samples");
  if (compression > EXR_COMPRESSION_PIZ)
    return unsupported(state, "another compression");
  for (int i = 0; i < list->num_channels; i++) {
    if (list->entries[i].x_sampling != 1 || list->entries[i].y_sampling != 1)
      return unsupported(state, "subsampled channels");
    state->pixel += list->entries[i].pixel_type == EXR_PIXEL_HALF ? 2 : 4;
  }
  state->channels = list->num_channels;
  const pags_window_box stored = {data.min.x, data.min.y, (int64_t)data.max.x + 1, (int64_t)data.max.y + 1};
  const pags_window_box shown = {display.min.x, display.min.y, (int64_t)display.max.x + 1, (int64_t)display.max.y + 1};
  PAGS_TRY(pags_window_compare(state->file->path, &stored, &shown, &state->window));
  state->width = (int)(shown.right - shown.left);
  state->height = (int)(shown.bottom - shown.top);
  state->data_width = (int)(stored.right - stored.left);
  state->data_height = (int)(stored.bottom - stored.top);
  state->left = (int)(stored.left - shown.left);
  state->top = (int)(stored.top - shown.top);
  state->first = data.min.y;
  *least = (uint64_t)state->data_width * (uint64_t)state->data_height * state->pixel /
           (compression == EXR_COMPRESSION_NONE ? 1 : RATIO);
  return PAGS_OK;
}

/* Opens the file and reads its header. Whatever it returns, finish is due. */
static pags_result begin(exr_state *state, uint64_t *least) {
  exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
  setup.error_handler_fn = on_error;
  setup.alloc_fn = allocate;
  setup.free_fn = free;
  setup.user_data = state;
  setup.read_fn = read_bytes;
  setup.size_fn = size_of_file;
  setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
  failed_allocations = 0;
  const exr_result_t code = exr_start_read(&state->context, state->file->path, &setup);
  return code == EXR_ERR_SUCCESS ? read_header(state, least) : explain(state, code, PAGS_BAD_HEADER);
}

/* Converts a row of one channel, stored little-endian, to floats with a stride of `step`. */
static void convert_row(const uint8_t *from, exr_pixel_type_t type, int width, float *to, size_t step) {
  const bool half = type == EXR_PIXEL_HALF;
  for (int x = 0; x < width; x++, to += step, from += half ? 2 : 4)
    *to = half ? pags_float_from_half(pags_load_u16(from)) : pags_load_f32(from);
}

/* Converts a block that lies decompressed in the pipeline, row by row and in each channel by channel: line `y` of the
 * data window and what follows. Pixels outside of the picture are left out. OpenEXRCore's own conversion (3.1.5)
 * mixes up four channels of halves. */
static void convert_block(const exr_state *state, const exr_decode_pipeline_t *pipeline, const pags_image *out, int y) {
  const uint8_t *from = pipeline->unpacked_buffer;
  const int begin = state->left < 0 ? -state->left : 0; /* columns of the data window that lie in the picture */
  const int end = state->data_width < out->width - state->left ? state->data_width : out->width - state->left;
  const size_t step = (size_t)out->channels;
  for (int row = 0; row < pipeline->chunk.height; row++) {
    const int to_row = state->top + y + row;
    const bool inside = to_row >= 0 && to_row < out->height;
    float *const to =
        inside ? (float *)out->data + ((size_t)to_row * (size_t)out->width + (size_t)(state->left + begin)) * step
               : NULL;
    for (int i = 0; i < pipeline->channel_count; i++) {
      const exr_coding_channel_info_t *const channel = &pipeline->channels[i];
      const size_t bytes = (size_t)channel->bytes_per_element;
      for (int c = 0; to && c < state->layer.channels && c < out->channels; c++)
        if (state->layer.order[c] == i)
          convert_row(from + (size_t)begin * bytes, (exr_pixel_type_t)channel->data_type, end - begin, to + c, step);
      from += (size_t)state->data_width * bytes;
    }
    for (int x = begin; to && out->channels > state->layer.channels && x < end; x++)
      to[(size_t)(x - begin) * step + step - 1] = 1; /* alpha of what has samples */
  }
}

/* Reads block after block; all but the last have the same number of rows. */
static exr_result_t read_blocks(exr_state *state, exr_decode_pipeline_t *pipeline, const pags_image *out) {
  const int part = state->layer.part;
  exr_chunk_info_t block;
  exr_result_t code = EXR_ERR_SUCCESS;
  for (int y = 0; code == EXR_ERR_SUCCESS && y < state->data_height; y += block.height) {
    code = exr_read_scanline_chunk_info(state->context, part, state->first + y, &block);
    if (code == EXR_ERR_SUCCESS)
      code = y == 0 ? exr_decoding_initialize(state->context, part, &block, pipeline)
                    : exr_decoding_update(state->context, part, &block, pipeline);
    if (code == EXR_ERR_SUCCESS && y == 0)
      code = exr_decoding_choose_default_routines(state->context, part, pipeline);
    if (code != EXR_ERR_SUCCESS)
      break;
    if (pipeline->channel_count != state->channels || block.height < 1 || block.height > state->data_height - y ||
        block.unpacked_size != state->pixel * (uint64_t)state->data_width * (uint64_t)block.height ||
        (block.compression == EXR_COMPRESSION_NONE && block.packed_size != block.unpacked_size))
      return EXR_ERR_CORRUPT_CHUNK;
    pipeline->unpack_and_convert_fn = NULL;
    code = exr_decoding_run(state->context, part, pipeline);
    if (code == EXR_ERR_SUCCESS)
      convert_block(state, pipeline, out, y);
  }
  return code;
}

pags_result pags_exr_inspect(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour) {
  PAGS_AUTO(finish) exr_state state = {.file = file};
  uint64_t least;
  PAGS_TRY(begin(&state, &least));
  *facts = (pags_image_facts){.width = state.width,
                              .height = state.height,
                              .alpha = state.layer.alpha,
                              .sample = PAGS_F32,
                              .orientation = 1,
                              .pixel_aspect = pags_pixel_aspect(state.pixel_aspect),
                              .window = state.window,
                              .layer_rule = state.layer.rule};
  memcpy(facts->layer, state.layer.name, sizeof facts->layer);
  /* The primaries are those of sRGB where none are stated. */
  exr_attr_chromaticities_t c;
  memset(colour, 0, sizeof *colour);
  if (exr_attr_get_chromaticities(state.context, state.layer.part, "chromaticities", &c) == EXR_ERR_SUCCESS) {
    const double xy[8] = {(double)c.red_x,  (double)c.red_y,  (double)c.green_x, (double)c.green_y,
                          (double)c.blue_x, (double)c.blue_y, (double)c.white_x, (double)c.white_y};
    pags_colour_set_primaries(colour, xy);
  }
  pags_colour_state(colour, facts);
  return PAGS_OK;
}

pags_result pags_exr_decode(const pags_encoded *file, int most, pags_image *out) {
  PAGS_AUTO(finish) exr_state state = {.file = file};
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  uint64_t least;
  memset(out, 0, sizeof *out);
  PAGS_TRY(begin(&state, &least));
  const pags_picture_info stored = {.width = state.data_width, .height = state.data_height, .channels = state.channels};
  PAGS_TRY(pags_encoded_check(file, &stored, least));
  const int channels = pags_layer_channels(&state.layer, state.window, most);
  PAGS_TRY(pags_image_create(&image, state.width, state.height, channels, PAGS_F32));
  exr_decode_pipeline_t pipeline = EXR_DECODE_PIPELINE_INITIALIZER;
  const exr_result_t code = read_blocks(&state, &pipeline, &image);
  exr_decoding_destroy(state.context, &pipeline);
  if (code != EXR_ERR_SUCCESS)
    return explain(&state, code, PAGS_BAD_SAMPLES);
  pags_image_move(&image, out);
  return PAGS_OK;
}
