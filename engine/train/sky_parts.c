/* SPDX-License-Identifier: Apache-2.0 */
/* Catches the sky's gradient of a view and shares it with all ranks; see sky_parts.h. */
#include "train/sky_parts.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "cluster/shares.h"

enum { FLOATS = 3 * PAGS_SKY_BLOCK };

/* A block of texels on its way. */
typedef struct sent_block {
  int64_t block;
  float data[FLOATS];
} sent_block;

void pags_sky_parts_begin(pags_sky_parts *parts) {
  parts->caught = false;
  if (parts->blocks > 0)
    memset(parts->seen, 0, (size_t)parts->blocks);
}

void pags_sky_parts_destroy(pags_sky_parts *parts) {
  free(parts->data);
  free(parts->seen);
  *parts = (pags_sky_parts){0};
}

static void keep(void *user, const pags_sky_gradient *g, int worker) {
  pags_sky_parts *const parts = user;
  const int64_t first = g->first / PAGS_SKY_BLOCK;
  (void)worker;
  for (int64_t b = 0; b < g->blocks; b++)
    if (g->seen[b]) {
      parts->seen[first + b] = 1;
      memcpy(parts->data + (first + b) * FLOATS, g->data + b * FLOATS, FLOATS * sizeof(float));
    }
}

pags_result pags_sky_parts_catch(pags_sky_parts *parts, const pags_sky_fit *fit, pags_picture_gradient *gradient) {
  const int64_t texels = 6 * (int64_t)fit->sky.size * fit->sky.size;
  const int64_t blocks = (texels + PAGS_SKY_BLOCK - 1) / PAGS_SKY_BLOCK;
  if (!gradient->sky)
    return PAGS_OK;
  if (parts->blocks == 0) {
    parts->data = malloc((size_t)blocks * FLOATS * sizeof(float));
    parts->seen = calloc((size_t)blocks, 1);
    if (!parts->data || !parts->seen)
      return pags_out_of_memory("the gradient of a sky of %d texels a side", fit->sky.size);
    parts->blocks = blocks;
  }
  parts->caught = true;
  gradient->sky = keep;
  gradient->sky_user = parts;
  return PAGS_OK;
}

static pags_result pack(const pags_sky_parts *parts, sent_block **out, int64_t *count) {
  *count = 0;
  for (int64_t b = 0; parts->caught && b < parts->blocks; b++)
    *count += parts->seen[b];
  sent_block *at = *out = malloc((size_t)(*count + 1) * sizeof **out);
  if (!at)
    return pags_out_of_memory("the gradient of a sky");
  for (int64_t b = 0; parts->caught && b < parts->blocks; b++)
    if (parts->seen[b]) {
      at->block = b;
      memcpy(at++->data, parts->data + b * FLOATS, sizeof at->data);
    }
  return PAGS_OK;
}

pags_result pags_sky_parts_add(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit,
                               const pags_schedule *schedule, int64_t step) {
  pags_picture_gradient own_way = {.sky = NULL};
  if (fit->sky.size == 0 || fit->fixed)
    return PAGS_OK;
  PAGS_TRY(pags_transport_agree(transport, pags_sky_fit_receive(fit, schedule, step, &own_way)));
  sent_block *own, *all = NULL;
  int64_t count, *const bytes = calloc((size_t)pags_transport_ranks(transport), sizeof *bytes);
  pags_result result = pack(parts, &own, &count);
  if (!bytes)
    result = pags_out_of_memory("the gradient of a sky");
  result = pags_transport_agree(transport, result);
  if (result == PAGS_OK)
    result = pags_share_parts(transport, own, count * (int64_t)sizeof *own, (void **)&all, bytes);
  int64_t arrived = 0;
  for (int r = 0; result == PAGS_OK && r < pags_transport_ranks(transport); r++)
    arrived += bytes[r] / (int64_t)sizeof *all;
  const uint8_t seen = 1;
  for (int64_t i = 0; result == PAGS_OK && i < arrived; i++)
    own_way.sky(own_way.sky_user, &(pags_sky_gradient){all[i].block * PAGS_SKY_BLOCK, 1, &seen, all[i].data}, 0);
  free(own);
  free(all);
  free(bytes);
  return result;
}
