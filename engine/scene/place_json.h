/* SPDX-License-Identifier: Apache-2.0 */
/* Places in scene.json and dataset.json: "geographic_origin": [latitude, longitude, altitude]; may be missing. */
#ifndef PAGS_SCENE_PLACE_JSON_H
#define PAGS_SCENE_PLACE_JSON_H

#include <pags/place.h>

#include "base/json.h"

/* Of the object `root`; a latitude beyond the poles or a longitude beyond 180 degrees is an error that names the line.
 */
pags_result pags_place_from_json(const pags_json *json, const pags_json_value *root, pags_place *out);
/* Nothing where nothing is known. */
void pags_place_to_json(pags_json_writer *writer, const pags_place *place);

#endif
