/* SPDX-License-Identifier: Apache-2.0 */
/* Keeps account of which 4x4-pixel blocks and tiles of the picture are saturated, while a frame is drawn slab by slab
 * (early_z_slabs.c). */
#include <math.h>
#include <string.h>

#include "frame/stages.h"

enum { BLOCK_SIDE = 4, BLOCKS = PAGS_TILE / BLOCK_SIDE, WORD = 64 };

/* Builds the bitmap of unsaturated blocks from the tiles' masks (four bits of a tile's mask go into each of four rows
 * of blocks), and counts the saturated tiles. */
void pags_frame_saturation_update(pags_frame *frame) {
  saturation *const f = frame->full;
  memset(f->open, 0, (size_t)(f->rows * f->words) * sizeof *f->open);
  f->tiles_full = 0;
  for (int ty = 0; ty < frame->tiles_y; ty++)
    for (int tx = 0; tx < frame->tiles_x; tx++) {
      const int64_t tile = (int64_t)ty * frame->tiles_x + tx;
      const uint64_t open = f->tile_open[tile];
      f->tiles_full += f->limits[tile] < 0.0f;
      for (int row = 0; row < BLOCKS && open; row++)
        f->open[(int64_t)(BLOCKS * ty + row) * f->words + BLOCKS * tx / WORD] |= (open >> BLOCKS * row & 15u)
                                                                                 << BLOCKS * tx % WORD;
    }
}

pags_result pags_frame_saturation_begin(pags_frame *frame) {
  const int64_t tiles = (int64_t)frame->tiles_x * frame->tiles_y;
  PAGS_TRY(pags_frame_alloc(frame, &frame->full, 1, sizeof *frame->full, "saturated tiles"));
  saturation *const f = frame->full;
  f->words = (BLOCKS * frame->tiles_x + WORD - 1) / WORD;
  f->rows = BLOCKS * frame->tiles_y;
  PAGS_TRY(pags_frame_alloc(frame, &f->limits, tiles, sizeof *f->limits, "saturated tiles"));
  PAGS_TRY(pags_frame_alloc(frame, &f->tile_begun, tiles, sizeof *f->tile_begun, "saturated tiles"));
  PAGS_TRY(pags_frame_alloc(frame, &f->tile_open, tiles, sizeof *f->tile_open, "saturated tiles"));
  PAGS_TRY(pags_frame_alloc(frame, &f->open, (int64_t)f->rows * f->words, sizeof *f->open, "saturated tiles"));
  memset(f->tile_begun, 0, (size_t)tiles);
  for (int64_t tile = 0; tile < tiles; tile++) {
    f->limits[tile] = INFINITY;

    /* Blocks of 4x4 pixels that lie wholly in the padding count as saturated from the beginning. */
    const int x0 = frame_tile_x(frame, tile), y0 = frame_tile_y(frame, tile);
    unsigned inside = 0;
    for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
      if (x0 + BLOCK_SIDE * (b % BLOCKS) < frame->camera.width && y0 + BLOCK_SIDE * (b / BLOCKS) < frame->camera.height)
        inside |= 1u << b;
    f->tile_open[tile] = (uint16_t)inside;
  }
  frame->tile_limits = f->limits;
  pags_frame_saturation_update(frame);
  return PAGS_OK;
}
