/* SPDX-License-Identifier: Apache-2.0 */
/* Which channels of an OpenEXR file are its picture. A file may hold several parts and layers: colours, depth, normals
 * and lights of one frame. A channel is named LAYER.SUFFIX or SUFFIX; in files of several parts, a part's name is that
 * of a layer, too. */
#ifndef PAGS_IMAGE_LAYERS_H
#define PAGS_IMAGE_LAYERS_H

#include <stdbool.h>

#include <pags/image.h>

typedef struct pags_layer_channel {
  const char *name; /* as in the file */
  const char *part; /* name of its part, "" where the file has only one */
  int part_index;
  int index;   /* in its part */
  bool number; /* it holds unsigned integers */
} pags_layer_channel;

typedef struct pags_layer {
  int part, channels; /* 1..4: grey, grey and alpha, RGB, RGBA */
  int order[4];       /* their places in the part */
  bool alpha;
  pags_layer_rule rule;
  char name[PAGS_IMAGE_NAME]; /* of the layer; "": it has none */
} pags_layer;

/* Chooses the picture: R, G, B and A, or Y and A, in order of preference
 *   - without a layer, in a file of one part;
 *   - of a layer Combined, as Blender calls a rendered picture: of the compositor, of ViewLayer, of another view layer;
 *   - of a layer with another name of rendered pictures (rgba, beauty, main, ...);
 *   - of the only layer that has colours; in a file of several parts, without a layer in the first.
 * A file of one channel is grey, whatever the channel's name. PAGS_ERROR_FORMAT, with the names that are there, where
 * none of these is the case, for luminance with chroma (Y, RY, BY), and for integers. */
pags_result pags_layer_choose(const char *path, const pags_layer_channel *channels, int count, pags_layer *out);

/* Channels of the picture that is decoded with at most `most`: where the data window covers only a part of it, alpha is
 * added that states which, if the layer has none and there is room. */
static inline int pags_layer_channels(const pags_layer *layer, pags_image_window window, int most) {
  const int channels = layer->channels + (window == PAGS_WINDOW_PARTIAL && !layer->alpha);
  return channels < most ? channels : most;
}

/* A window: columns [left, right), rows [top, bottom). */
typedef struct pags_window_box {
  int64_t left, top, right, bottom;
} pags_window_box;

/* Compares the data window with the display window. PAGS_ERROR_FORMAT for sides beyond 1..65535, for windows without a
 * common pixel, and for a display window that is beyond all proportion to the data. */
pags_result pags_window_compare(const char *path, const pags_window_box *data, const pags_window_box *display,
                                pags_image_window *out);

#endif
