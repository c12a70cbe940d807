/* SPDX-License-Identifier: Apache-2.0 */
/* The sky's gradients and texels on their way between ranks; see sky_parts.h. */
#include "train/sky_parts.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "cluster/shares.h"

enum { FLOATS = 3 * PAGS_SKY_BLOCK };

void pags_sky_parts_begin(pags_sky_parts *parts) {
  parts->caught = false;
  atomic_store(&parts->count, 0);
}

void pags_sky_parts_destroy(pags_sky_parts *parts) {
  free(parts->caught_blocks);
  free(parts->moved);
  *parts = (pags_sky_parts){0};
}

/* Blocks come from several threads at once, each of them once. */
static void keep(void *user, const pags_sky_gradient *g, int worker) {
  pags_sky_parts *const parts = user;
  (void)worker;
  for (int64_t b = 0; b < g->blocks; b++)
    if (g->seen[b]) {
      pags_sky_part *const to = parts->caught_blocks + atomic_fetch_add(&parts->count, 1);
      to->block = g->first / PAGS_SKY_BLOCK + b;
      memcpy(to->data, g->data + b * FLOATS, sizeof to->data);
    }
}

pags_result pags_sky_parts_catch(pags_sky_parts *parts, const pags_sky_fit *fit, pags_picture_gradient *gradient) {
  if (!gradient->sky)
    return PAGS_OK;
  if (!parts->caught_blocks) /* memory is taken as it is written */
    parts->caught_blocks = malloc((size_t)pags_sky_fit_blocks(fit) * sizeof *parts->caught_blocks);
  if (!parts->caught_blocks)
    return pags_out_of_memory("the gradient of a sky of %d texels a side", fit->sky.size);
  parts->caught = true;
  gradient->sky = keep;
  gradient->sky_user = parts;
  return PAGS_OK;
}

/* ---- To the owners ---- */

typedef struct parcel {
  pags_sky_part *blocks; /* for rank 0, then for rank 1, and so on */
  int64_t *counts;       /* [ranks] sent, then received */
} parcel;

static pags_result pack(const pags_sky_parts *parts, int ranks, parcel *out) {
  const int64_t count = parts->caught ? (int64_t)atomic_load(&parts->count) : 0;
  int64_t *const at = calloc((size_t)ranks, sizeof *at);
  out->blocks = malloc((size_t)(count + 1) * sizeof *out->blocks);
  out->counts = calloc(2 * (size_t)ranks, sizeof *out->counts);
  const bool room = at && out->blocks && out->counts;
  for (int64_t i = 0; room && i < count; i++)
    out->counts[parts->caught_blocks[i].block % ranks]++;
  for (int r = 1; room && r < ranks; r++)
    at[r] = at[r - 1] + out->counts[r - 1];
  for (int64_t i = 0; room && i < count; i++)
    out->blocks[at[parts->caught_blocks[i].block % ranks]++] = parts->caught_blocks[i];
  free(at);
  return room ? PAGS_OK : pags_out_of_memory("the gradient of a sky");
}

static pags_result exchange(pags_transport *transport, const parcel *sent, pags_sky_part **arrived, int64_t *count) {
  const int ranks = pags_transport_ranks(transport);
  int64_t *const received = sent->counts + ranks, *const ones = malloc((size_t)ranks * sizeof *ones);
  for (int r = 0; ones && r < ranks; r++)
    ones[r] = 1;
  pags_result result = pags_transport_agree(transport, ones ? PAGS_OK : pags_out_of_memory("the gradient of a sky"));
  if (result == PAGS_OK)
    result = pags_share_items(transport, sent->counts, ones, received, ones, sizeof *received);
  free(ones);
  PAGS_TRY(result);
  for (int r = 0; r < ranks; r++)
    *count += received[r];
  *arrived = malloc((size_t)(*count + 1) * sizeof **arrived);
  PAGS_TRY(pags_transport_agree(transport, *arrived ? PAGS_OK : pags_out_of_memory("the gradient of a sky")));
  return pags_share_items(transport, sent->blocks, sent->counts, *arrived, received, sizeof **arrived);
}

pags_result pags_sky_parts_add(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit,
                               const pags_schedule *schedule, int64_t step) {
  const int ranks = pags_transport_ranks(transport);
  pags_picture_gradient own_way = {.sky = NULL};
  parcel sent = {0};
  pags_sky_part *arrived = NULL;
  int64_t count = 0;
  if (fit->sky.size == 0 || fit->fixed)
    return PAGS_OK;
  pags_result mine = pags_sky_fit_receive(fit, schedule, step, &own_way);
  if (!parts->moved)
    parts->moved = calloc((size_t)pags_sky_fit_own_blocks(fit, fit->rank) + 1, 1);
  if (mine == PAGS_OK)
    mine = parts->moved ? pack(parts, ranks, &sent) : pags_out_of_memory("the gradient of a sky");
  pags_result result = pags_transport_agree(transport, mine);
  if (result == PAGS_OK)
    result = exchange(transport, &sent, &arrived, &count);
  const uint8_t seen = 1;
  for (int64_t i = 0; result == PAGS_OK && i < count; i++) {
    parts->moved[arrived[i].block / ranks] = 1;
    own_way.sky(own_way.sky_user, &(pags_sky_gradient){arrived[i].block * PAGS_SKY_BLOCK, 1, &seen, arrived[i].data},
                0);
  }
  free(sent.blocks);
  free(sent.counts);
  free(arrived);
  return result;
}

/* ---- To all ---- */

/* The texels of a block, of which the last may be cut off. */
static float *texels_of(pags_sky_fit *fit, int64_t block, size_t *bytes) {
  const int64_t first = block * PAGS_SKY_BLOCK, left = 6 * (int64_t)fit->sky.size * fit->sky.size - first;
  *bytes = (size_t)(left < PAGS_SKY_BLOCK ? left : PAGS_SKY_BLOCK) * 3 * sizeof(float);
  return fit->sky.texels + 3 * first;
}

static pags_result pack_moved(const pags_sky_parts *parts, pags_sky_fit *fit, pags_sky_part **out, int64_t *count) {
  const int64_t own = parts->moved ? pags_sky_fit_own_blocks(fit, fit->rank) : 0;
  *count = 0;
  for (int64_t b = 0; b < own; b++)
    *count += parts->moved[b];
  pags_sky_part *to = *out = calloc((size_t)(*count + 1), sizeof **out);
  if (!to)
    return pags_out_of_memory("a sky");
  for (int64_t b = 0; b < own; b++)
    if (parts->moved[b]) {
      size_t bytes;
      to->block = b * fit->ranks + fit->rank;
      const float *const texels = texels_of(fit, to->block, &bytes);
      memcpy(to++->data, texels, bytes);
    }
  if (own > 0)
    memset(parts->moved, 0, (size_t)own);
  return PAGS_OK;
}

pags_result pags_sky_parts_spread(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit) {
  const int ranks = pags_transport_ranks(transport);
  pags_sky_part *own, *all = NULL;
  int64_t count, *const bytes_of = calloc((size_t)ranks, sizeof *bytes_of);
  if (fit->sky.size == 0 || fit->fixed) {
    free(bytes_of);
    return PAGS_OK;
  }
  pags_result result = pack_moved(parts, fit, &own, &count);
  if (!bytes_of)
    result = pags_out_of_memory("a sky");
  result = pags_transport_agree(transport, result);
  if (result == PAGS_OK)
    result = pags_share_parts(transport, own, count * (int64_t)sizeof *own, (void **)&all, bytes_of);
  int64_t arrived = 0;
  for (int r = 0; result == PAGS_OK && r < ranks; r++)
    arrived += bytes_of[r] / (int64_t)sizeof *all;
  for (int64_t i = 0; i < arrived; i++) {
    size_t bytes;
    float *const texels = texels_of(fit, all[i].block, &bytes);
    memcpy(texels, all[i].data, bytes);
  }
  free(own);
  free(all);
  free(bytes_of);
  return result;
}
