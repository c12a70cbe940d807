/* SPDX-License-Identifier: Apache-2.0 */
/* Packs a scene for the player of scene.html: some 19 bytes a Gaussian before compression, 16 bits a coordinate within
 * cells of 16 m, 256 values each for scales, opacities and colours, a palette for harmonics; objects in their own
 * frames, with their tracks. docs/scene-html.md describes the bytes. */
#ifndef PAGS_CLI_SCENE_HTML_PACK_H
#define PAGS_CLI_SCENE_HTML_PACK_H

#include <pags/camera.h>
#include <pags/compose.h>
#include <pags/scene.h>
#include <pags/tasks.h>
#include <stddef.h>
#include "base/json.h"

typedef struct pags_web_settings {
  const char *description; /* JSON: what pags_view_describe writes */
  int sh_degree;           /* highest degree of harmonics, 0..3 */
  /* Rank of each Gaussian, by id, and the lowest rank packed; NULL: all. Gaussians that no picture can show, fainter
   * than their model's alpha_min, are never packed. */
  const int32_t *rank;
  int64_t least_rank;
  pags_progress_fn *progress; /* NULL: none */
  void *user;
} pags_web_settings;

typedef struct pags_web_pack {
  uint8_t *bytes; /* gzip */
  size_t size;
  int64_t gaussians;
  int sh_degree;
} pags_web_pack;

/* Packs all Gaussians. The bytes depend on nothing but scene, settings and version of zlib. Composes: earlier parts
 * become invalid. PAGS_ERROR_MEMORY; PAGS_ERROR_LIMIT beyond 65,535 models or 2 GB; PAGS_CANCELLED. */
pags_result pags_web_pack_make(pags_composition *composition, const pags_web_settings *settings, pags_web_pack *out);
void pags_web_pack_destroy(pags_web_pack *pack);

/* ---- Contribution of each Gaussian: the sum of its weights alpha T over the pixels of some pictures ---- */

/* Adds up the contributions over at most 48 cameras of the path, drawn at no more than 640 pixels a side: weight[id],
 * room for all Gaussians. The same bits for any number of threads. PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_contribution_measure(pags_composition *composition, const pags_camera_path *path, pags_tasks *tasks,
                                      pags_progress_fn *progress, void *user, float *weight);

/* ---- Tracks of moving objects, sampled so finely that straight lines follow the curve ---- */

/* Writes the members `span` (the track's first and last time, over which colours change), `times` and `poses` (each
 * begins a new list where the object was away): seconds after the scene's begin, positions relative to its origin with
 * quaternions w, x, y, z. PAGS_ERROR_MEMORY. */
pags_result pags_web_track_put(pags_json_writer *json, const pags_scene *scene, int64_t object);

/* ---- The page before and after its data, made by cmake/page.cmake of cli/scene_html/page/ ---- */

extern const unsigned char pags_player_head[], pags_player_tail[];
extern const size_t pags_player_head_size, pags_player_tail_size;

#endif
