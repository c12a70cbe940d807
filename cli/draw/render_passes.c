/* SPDX-License-Identifier: Apache-2.0 */
/* The passes of picture.h: copies of the parts at other times, and the names of the parts. */
#include "cli/draw/picture.h"

#include "base/memory.h"

static bool wants(const pags_render_passes *passes, pags_channel channel) {
  return passes->writer->channels >> channel & 1;
}

pags_result pags_render_passes_moment(pags_render_passes *passes, int side, const pags_camera *camera) {
  const pags_part *parts;
  pags_moment *const moment = &passes->moments[side];
  passes->known[side] = camera != NULL;
  if (!camera)
    return PAGS_OK;
  moment->camera = *camera;
  pags_compose(passes->composition, camera->time, &parts, &moment->part_count);
  PAGS_CHECK_MEMORY(pags_grow(&passes->copies[side], moment->part_count + 1, &passes->capacity[side], sizeof *parts),
                    "%d parts", moment->part_count);
  memcpy(passes->copies[side], parts, (size_t)moment->part_count * sizeof *parts);
  moment->parts = passes->copies[side];
  return PAGS_OK;
}

pags_result pags_render_passes_draw(pags_render_passes *passes, pags_frame *frame, const pags_part *parts,
                                    int part_count, pags_passes *out) {
  pags_matte mattes[2];
  pags_pass_request request = {.normal = wants(passes, PAGS_CHANNEL_EXPECTED_NORMAL),
                               .pairs = wants(passes, PAGS_CHANNEL_BLENDED) || wants(passes, PAGS_CHANNEL_OVERDRAW)};
  for (int m = 0; m < 2; m++) {
    const pags_matte_names *const names = &passes->writer->mattes[m];
    if (!wants(passes, m ? PAGS_CHANNEL_CRYPTO_CLASS : PAGS_CHANNEL_CRYPTO_OBJECT))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&passes->names[m], part_count + 1, &passes->capacity[2 + m], sizeof *passes->names[m]),
                      "%d parts", part_count);
    for (int p = 0; p < part_count; p++) /* the last label is the background's */
      passes->names[m][p] = names->name_of_label[parts[p].label < 0 ? names->label_count - 1 : parts[p].label];
    mattes[m] = (pags_matte){names->count, names->values, passes->names[m]};
    request.matte[m] = &mattes[m];
  }
  if (wants(passes, PAGS_CHANNEL_MOTION)) {
    /* The first and the last picture of a sequence have one neighbour; a single one has none, and nothing moves. */
    request.before = passes->known[0] ? &passes->moments[0] : NULL;
    request.after = passes->known[1] ? &passes->moments[1] : NULL;
    request.motion = 1;
  }
  return pags_frame_passes(frame, &request, out);
}

void pags_render_passes_destroy(pags_render_passes *passes) {
  for (int k = 0; k < 2; k++) {
    free(passes->copies[k]);
    free(passes->names[k]);
  }
}
