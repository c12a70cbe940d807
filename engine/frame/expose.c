/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures as a camera of a given exposure would show them. */
#include "frame/stages.h"

int pags_frame_options_expose(pags_frame_options *options, const double gain[3], const double offset[3]) {
  options->exposed = 0;
  for (int c = 0; c < 3; c++) {
    options->gain[c] = (float)gain[c];
    options->offset[c] = (float)offset[c];
    options->exposed |= options->gain[c] != 1.0f || options->offset[c] != 0.0f;
  }
  return options->exposed;
}

void pags_frame_expose(const pags_frame *frame, int64_t tile) {
  const int64_t at = frame_tile_offset(frame, tile);
  for (int c = 0; c < 3; c++) {
    const float gain = frame->options.gain[c], offset = frame->options.offset[c];
    float *row = frame_plane(frame, PLANE_R + c) + at;
    for (int y = 0; y < PAGS_TILE; y++, row += frame->stride)
      for (int x = 0; x < PAGS_TILE; x++)
        row[x] = gain * row[x] + offset;
  }
}
