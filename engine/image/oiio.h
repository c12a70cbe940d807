/* SPDX-License-Identifier: Apache-2.0 */
/* The table through which files.c reaches the OpenImageIO module (oiio.cc, built as pags_oiio.so).
 *
 * The module links none of the engine's code, so it cannot set the engine's error message: every call takes a buffer
 * for a one-line message instead. All calls may run on several threads at once, each with its own reader. */
#ifndef PAGS_IMAGE_OIIO_H
#define PAGS_IMAGE_OIIO_H

#include <pags/image.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PAGS_OIIO_VERSION 7 /* version of this table; a module built for another one is refused */
#define PAGS_OIIO_SYMBOL "pags_oiio_table"

typedef struct pags_oiio_message {
  char text[512];
} pags_oiio_message;

/* Size and format of one part (subimage) of an image file. `sample` is the narrowest pags_sample that holds the file's
 * samples without loss (but double becomes float). */
typedef struct pags_oiio_info {
  int64_t width, height, depth;
  int64_t left, top;                 /* of the data window */
  int64_t shown_left, shown_top;     /* the display window */
  int64_t shown_width, shown_height; /* 0: the format has none */
  int channels;
  pags_sample sample;
  int alpha;       /* 1: the last of 2, or the fourth of more channels is alpha */
  int straight;    /* 1: colours are not multiplied by alpha */
  int orientation; /* as EXIF numbers them, 1..8 */
  double pixel_aspect;
  const char *part;             /* name of the part, "": none; valid until the reader is closed or reads another part */
  const unsigned char *profile; /* ICC, NULL: none; valid as `part` */
  size_t profile_size;
  float chromaticities[8]; /* of red, green, blue and white; all 0: not stated */
  int cicp[4];             /* primaries, transfer, matrix, full range (ITU-T H.273); all 0: not stated */
  char space[32];          /* OpenImageIO's name of the colour space, "": none */
} pags_oiio_info;

typedef struct pags_oiio {
  int version;
  /* Opens the file at its first part. */
  pags_result (*open)(const char *path, void **reader, pags_oiio_info *info, pags_oiio_message *message);
  /* Goes to a part; returns 0 if the file has fewer. */
  int (*part)(void *reader, int index, pags_oiio_info *info);
  /* Name of a channel of this part, valid as info->part; `number` gets 1 if it holds 32-bit integers. */
  const char *(*channel)(void *reader, int index, int *number);
  /* Reads `count` channels of this part as `sample`, interleaved with `step` samples a pixel, without conversion of
   * alpha or colour. */
  pags_result (*read)(void *reader, const int *channels, int count, pags_sample sample, int step, void *data,
                      pags_oiio_message *message);
  void (*close)(void *reader);
} pags_oiio;

/* The module's only exported function; returns its table, a pags_oiio, or NULL when out of memory. */
PAGS_API const void *pags_oiio_table(void);

#ifdef __cplusplus
}
#endif
#endif
