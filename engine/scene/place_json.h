/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes the place on the earth in scene.json and dataset.json, "geographic_origin": [latitude, longitude,
 * altitude] in degrees and metres. The key may be missing. */
#ifndef PAGS_SCENE_PLACE_JSON_H
#define PAGS_SCENE_PLACE_JSON_H

#include <pags/place.h>

#include "base/json.h"

/* Reads the place from the JSON object `root`. A latitude beyond +-90 or a longitude beyond +-180 degrees is an error
 * that names the line. If the key is missing, out->known is 0. */
pags_result pags_place_from_json(const pags_json *json, const pags_json_value *root, pags_place *out);
/* Writes the key; writes nothing if the place isn't known. */
void pags_place_to_json(pags_json_writer *writer, const pags_place *place);

#endif
