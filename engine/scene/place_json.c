/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes the key "geographic_origin" of scene.json and dataset.json. */
#include "scene/place_json.h"

#include <math.h>

static const char key[] = "geographic_origin";

pags_result pags_place_from_json(const pags_json *json, const pags_json_value *root, pags_place *out) {
  double numbers[3];
  const pags_json_value *value = pags_json_member(root, key);
  *out = (pags_place){0};
  if (!value || value->type == PAGS_JSON_NULL)
    return PAGS_OK;
  PAGS_TRY(pags_json_numbers(json, root, key, 3, numbers));
  if (!(fabs(numbers[0]) <= 90 && fabs(numbers[1]) <= 180))
    return pags_json_fail(json, value,
                          "expected latitude (-90..90), longitude (-180..180) and altitude for '%s', found %g, %g", key,
                          numbers[0], numbers[1]);
  *out = (pags_place){numbers[0], numbers[1], numbers[2], 1};
  return PAGS_OK;
}

void pags_place_to_json(pags_json_writer *writer, const pags_place *place) {
  if (place->known)
    pags_json_put_numbers(writer, key, (double[]){place->latitude, place->longitude, place->altitude}, 3);
}
