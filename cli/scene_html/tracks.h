/* SPDX-License-Identifier: Apache-2.0 */
/* The way of a moving object, sampled so finely that straight lines between the samples follow its curve. */
#ifndef PAGS_CLI_SCENE_HTML_TRACKS_H
#define PAGS_CLI_SCENE_HTML_TRACKS_H

#include <pags/scene.h>
#include "base/json.h"

/* Writes the members `span` (the track's first and last time, over which colours change), `times` and `poses` (each
 * begins a new list where the object was away): seconds after the scene's begin, positions relative to its origin with
 * quaternions w, x, y, z. PAGS_ERROR_MEMORY. */
pags_result pags_web_track_put(pags_json_writer *json, const pags_scene *scene, int64_t object);

#endif
