/* SPDX-License-Identifier: Apache-2.0 */
/* The sky's gradients and texels on their way between ranks; see sky_parts.h. */
#include "train/sky_parts.h"

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
static void keep(void *user, const pags_sky_gradient *g, PAGS_UNUSED int worker) {
  pags_sky_parts *const parts = user;
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
  PAGS_CHECK_MEMORY(parts->caught_blocks, "the gradient of a sky of %d texels a side", fit->sky.size);
  parts->caught = true;
  gradient->sky = keep;
  gradient->sky_user = parts;
  return PAGS_OK;
}

pags_result pags_sky_parts_add(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit,
                               const pags_schedule *schedule, int64_t step) {
  const int ranks = pags_transport_ranks(transport);
  const int64_t caught = parts->caught ? (int64_t)atomic_load(&parts->count) : 0;
  pags_picture_gradient own_way = {.sky = NULL};
  if (fit->sky.size == 0 || fit->fixed)
    return PAGS_OK;
  PAGS_AUTOFREE pags_sky_part *blocks = malloc((size_t)(caught + 1) * sizeof *blocks); /* for rank 0, rank 1, ... */
  PAGS_AUTOFREE int64_t *sent = calloc(3 * (size_t)ranks, sizeof *sent);
  if (!parts->moved)
    parts->moved = calloc((size_t)pags_sky_fit_own_blocks(fit, fit->rank) + 1, 1);
  pags_result mine = pags_sky_fit_receive(fit, schedule, step, &own_way);
  if (mine == PAGS_OK && !(blocks && sent && parts->moved))
    mine = pags_out_of_memory("the gradient of a sky");
  PAGS_TRY(pags_transport_agree(transport, mine));
  int64_t *const received = sent + ranks, *const at = received + ranks, count = 0;
  for (int64_t i = 0; i < caught; i++)
    sent[parts->caught_blocks[i].block % ranks]++;
  for (int r = 1; r < ranks; r++)
    at[r] = at[r - 1] + sent[r - 1];
  for (int64_t i = 0; i < caught; i++)
    blocks[at[parts->caught_blocks[i].block % ranks]++] = parts->caught_blocks[i];
  PAGS_TRY(pags_share_each(transport, sent, received, sizeof *sent));
  for (int r = 0; r < ranks; r++)
    count += received[r];
  PAGS_AUTOFREE pags_sky_part *arrived = malloc((size_t)(count + 1) * sizeof *arrived);
  PAGS_TRY(pags_transport_agree(transport, arrived ? PAGS_OK : pags_out_of_memory("the gradient of a sky")));
  PAGS_TRY(pags_share_items(transport, blocks, sent, arrived, received, sizeof *arrived));
  const uint8_t seen = 1;
  for (int64_t i = 0; i < count; i++) {
    parts->moved[arrived[i].block / ranks] = 1;
    own_way.sky(own_way.sky_user, &(pags_sky_gradient){arrived[i].block * PAGS_SKY_BLOCK, 1, &seen, arrived[i].data},
                0);
  }
  return PAGS_OK;
}

/* The texels of a block, of which the last may be cut off. */
static float *texels_of(pags_sky_fit *fit, int64_t block, size_t *bytes) {
  const int64_t first = block * PAGS_SKY_BLOCK, left = 6 * (int64_t)fit->sky.size * fit->sky.size - first;
  *bytes = (size_t)(left < PAGS_SKY_BLOCK ? left : PAGS_SKY_BLOCK) * 3 * sizeof(float);
  return fit->sky.texels + 3 * first;
}

pags_result pags_sky_parts_spread(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit) {
  const int ranks = pags_transport_ranks(transport);
  if (fit->sky.size == 0 || fit->fixed)
    return PAGS_OK;
  const int64_t own = parts->moved ? pags_sky_fit_own_blocks(fit, fit->rank) : 0;
  int64_t count = 0, arrived = 0;
  size_t bytes;
  for (int64_t b = 0; b < own; b++)
    count += parts->moved[b];
  PAGS_AUTOFREE pags_sky_part *moved = calloc((size_t)(count + 1), sizeof *moved);
  PAGS_AUTOFREE int64_t *bytes_of = calloc((size_t)ranks, sizeof *bytes_of);
  PAGS_AUTOFREE void *all = NULL;
  PAGS_TRY(pags_transport_agree(transport, moved && bytes_of ? PAGS_OK : pags_out_of_memory("a sky")));
  pags_sky_part *to = moved;
  for (int64_t b = 0; b < own; b++)
    if (parts->moved[b]) {
      parts->moved[b] = 0;
      to->block = b * fit->ranks + fit->rank;
      const float *const texels = texels_of(fit, to->block, &bytes);
      memcpy(to++->data, texels, bytes);
    }
  PAGS_TRY(pags_share_parts(transport, moved, count * (int64_t)sizeof *moved, &all, bytes_of));
  for (int r = 0; r < ranks; r++)
    arrived += bytes_of[r] / (int64_t)sizeof *moved;
  for (const pags_sky_part *from = all; arrived > 0; from++, arrived--) {
    float *const texels = texels_of(fit, from->block, &bytes);
    memcpy(texels, from->data, bytes);
  }
  return PAGS_OK;
}
