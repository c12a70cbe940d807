/* SPDX-License-Identifier: Apache-2.0 */
/* Builds the synthetic street from its options: its extent, then the scenery, then parked and moving objects. */
#include <string.h>

#include "base/memory.h"
#include "synth/layout.h"
#include "synth/street.h"

static bool complete(const pags_street *street) {
  bool failed = street->failed || street->materials.failed;
  for (int i = 0; i < street->mesh_count; i++)
    failed |= street->meshes[i].failed;
  return !failed;
}

pags_result pags_street_build(const pags_street_options *options, pags_street *street) {
  memset(street, 0, sizeof *street);
  street->options = options;
  street->duration = (options->frames - 1) / options->fps;
  street->end = pags_street_ego_x(options, street->duration);
  street->begin_x = -45.0f;
  street->end_x = (float)street->end + 130.0f;
  street->markings = (pags_markings){.first_crossing = (float)street->end + 22.0f, .spacing = 84.0f};
  pags_scenery_add(street);
  pags_actors_add(street);
  return complete(street) ? PAGS_OK : pags_out_of_memory("a street of %d frames", options->frames);
}
