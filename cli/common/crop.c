/* SPDX-License-Identifier: Apache-2.0 */
/* Parses and applies the options that remove Gaussians. */
#include "cli/common/crop.h"

#include <math.h>
#include <stdlib.h>

#include "base/file.h"
#include "scene/filter.h"

/* Reads `count` numbers separated by commas. */
static bool parse_numbers(const char *text, int count, double *out) {
  for (int i = 0; i < count; i++) {
    char *end;
    out[i] = strtod(text, &end);
    if (end == text || !isfinite(out[i]) || *end != (i < count - 1 ? ',' : 0))
      return false;
    text = end + 1;
  }
  return true;
}

const char *pags_crop_parse(const pags_crop *crop, pags_filter *out, const char **expected) {
  double box[6], ball[4];
  *out = (pags_filter){.has_box = crop->box,
                       .has_ball = crop->sphere,
                       .least_opacity = crop->least_opacity,
                       .least_size = crop->least_size,
                       .greatest_size = crop->greatest_size,
                       .least_views = crop->least_views};
  *expected = "--crop-box: expected X,Y,Z,X,Y,Z, two corners";
  if (crop->box && !parse_numbers(crop->box, 6, box))
    return crop->box;
  if (crop->box)
    for (int k = 0; k < 3; k++) {
      out->lo[k] = fmin(box[k], box[3 + k]);
      out->hi[k] = fmax(box[k], box[3 + k]);
    }
  *expected = "--crop-sphere: expected X,Y,Z,R with R > 0";
  if (crop->sphere && (!parse_numbers(crop->sphere, 4, ball) || ball[3] <= 0))
    return crop->sphere;
  if (crop->sphere)
    for (int k = 0; k < 3; k++)
      out->middle[k] = ball[k];
  out->radius = crop->sphere ? ball[3] : 0;
  return NULL;
}

pags_result pags_crop_apply(const pags_crop *crop, pags_scene *scene, double time, uint8_t *chosen,
                            const pags_session *session) {
  const int64_t before = pags_scene_gaussian_count(scene);
  pags_filter filter;
  const char *expected;
  int64_t left;
  pags_crop_parse(crop, &filter, &expected); /* the arguments were checked when the options were read */
  if (!pags_filter_is_set(&filter) && !crop->edits)
    return PAGS_OK;
  if (crop->edits) {
    uint8_t *text;
    size_t size;
    PAGS_TRY(pags_file_read(crop->edits, &text, &size));
    const pags_result result = pags_scene_cleanup(scene, crop->edits, (const char *)text);
    free(text);
    PAGS_TRY(result);
  }
  PAGS_TRY(pags_scene_filter(scene, &filter, time, chosen, &left));
  pags_say(session, "%lld of %lld Gaussians are left\n", (long long)left, (long long)before);
  return PAGS_OK;
}
