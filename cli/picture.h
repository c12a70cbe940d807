/* SPDX-License-Identifier: Apache-2.0 */
/* A rendered picture's way into files. */
#ifndef PAGS_CLI_PICTURE_H
#define PAGS_CLI_PICTURE_H

#include <pags/compose.h>
#include <pags/image.h>
#include <stdbool.h>

typedef enum pags_channel {
  PAGS_CHANNEL_COLOR,
  PAGS_CHANNEL_ALPHA,
  PAGS_CHANNEL_DEPTH,
  PAGS_CHANNEL_ID,
  PAGS_CHANNEL_OBJECT,
  PAGS_CHANNEL_PRIORITY,
  PAGS_CHANNEL_NORMAL,
  PAGS_CHANNEL_HEAT,
  PAGS_CHANNEL_COUNT
} pags_channel;

/* Reads "color,depth,..." into a set of bits 1 << channel. False, with the word not known in `unknown`, when one isn't.
 */
bool pags_channels_parse(const char *list, unsigned *set, char *unknown, size_t unknown_size);

typedef enum pags_picture_format { PAGS_PICTURE_PNG, PAGS_PICTURE_EXR } pags_picture_format;

/* How pictures are written. Colour and alpha go to NAME.png or NAME.exr and NAME_alpha.*; depth (metres), id, object,
 * priority and normal always to NAME_depth.exr and so on, float32; heat, the priorities as colours, to NAME_heat.png.
 */
typedef struct pags_picture_writer {
  unsigned channels; /* bits 1 << pags_channel */
  pags_picture_format format;
  int bits;           /* of PNG: 8 or 16 */
  int32_t *object_of; /* per id; NULL unless object is written */
  float *priority_of; /* per id; NULL unless priority or heat is written */
} pags_picture_writer;

/* Prepares what the channels need of the scene. PAGS_ERROR_LIMIT when ids don't fit a float exactly,
 * PAGS_ERROR_ARGUMENT when the scene holds no priorities. */
pags_result pags_picture_writer_create(const pags_composition *composition, unsigned channels,
                                       pags_picture_format format, int bits, pags_picture_writer *out);
void pags_picture_writer_destroy(pags_picture_writer *writer);

/* Memory for three planes of the largest picture so far. Zero to begin with. */
typedef struct pags_plane_scratch {
  float *data; /* freed by the owner */
  size_t capacity;
} pags_plane_scratch;

/* Writes every channel of one picture into `folder`; `camera` is what it was rendered with. Several threads may do so
 * at once, each with its own scratch. */
pags_result pags_picture_write(const pags_picture_writer *writer, const pags_picture *picture,
                               const pags_camera *camera, pags_plane_scratch *scratch, const char *folder,
                               const char *name);

/* Whether the channels need a depth and id rendered. */
bool pags_picture_writer_needs_extras(const pags_picture_writer *writer);

/* Writes folder/file. */
pags_result pags_image_save_in(const char *folder, const char *file, const pags_image *image);

/* Colour as an image: F32 clamped to [0, 1], or U8 or U16 rounded. */
pags_result pags_picture_to_image(const pags_picture *picture, pags_sample sample, pags_image *out);

#endif
