/* SPDX-License-Identifier: Apache-2.0 */
/* pags export SCENE scene.html: one file that shows a scene in any browser, by WebGL, without a network. */
#ifndef PAGS_CLI_SCENE_HTML_WRITE_H
#define PAGS_CLI_SCENE_HTML_WRITE_H

#include <pags/compose.h>
#include <pags/scene.h>
#include <pags/tasks.h>
#include <stddef.h>

typedef struct pags_html_settings {
  const char *name;     /* name of the scene */
  int sh_degree;        /* highest degree of harmonics, 0..3 */
  uint64_t target_size; /* maximum size of the file, bytes; 0: no limit */
  pags_tasks *tasks;
  pags_progress_fn *progress; /* NULL: none */
  void *user;
} pags_html_settings;

typedef struct pags_html_report {
  int64_t gaussians;   /* written */
  int64_t left_out;    /* visible Gaussians left out for the size */
  int sh_degree;       /* of what was written */
  int sh_degree_asked; /* what the scene and the settings would have given */
  double left;         /* share of all contributions that those left out had */
  uint64_t bytes;
} pags_html_report;

/* Writes the file, complete or not at all. Takes over the scene, which is zeroed, also on failure. For a target size,
 * degrees of harmonics are dropped first, then Gaussians, lowest contribution first; PAGS_ERROR_LIMIT if even a tenth
 * of them don't fit. Bit-identical for any number of threads. */
pags_result pags_html_write(pags_scene *scene, const char *path, const pags_html_settings *settings,
                            pags_html_report *report);

/* ---- The pack: some 19 bytes a Gaussian before compression, 16 bits a coordinate within cells of 16 m, 256 values
 * each for scales, opacities and colours, a palette for harmonics; objects in their own frames, with their tracks.
 * docs/scene-html.md describes the bytes. ---- */

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

/* ---- The page before and after its data, made by cmake/page.cmake of cli/scene_html/page/ ---- */

extern const unsigned char pags_player_head[], pags_player_tail[];
extern const size_t pags_player_head_size, pags_player_tail_size;

#endif
