/* SPDX-License-Identifier: Apache-2.0 */
/* Packs a scene for the player of scene.html: some 19 bytes a Gaussian before compression, 16 bits a coordinate within
 * cells of 16 m, 256 values each for scales, opacities and colours, a palette for harmonics; objects in their own
 * frames, with their tracks. docs/scene-html.md describes the bytes. */
#ifndef PAGS_CLI_SCENE_HTML_PACK_H
#define PAGS_CLI_SCENE_HTML_PACK_H

#include <pags/compose.h>
#include <pags/tasks.h>

typedef struct pags_web_settings {
  const char *description; /* JSON: what pags_view_describe writes */
  int sh_degree;           /* highest degree of harmonics, 0..3 */
  /* A rank for each Gaussian, by id, and the least that is packed; NULL: all are. Gaussians that no picture can show,
   * fainter than their model's alpha_min, never are. */
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

#endif
