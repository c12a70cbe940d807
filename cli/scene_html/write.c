/* SPDX-License-Identifier: Apache-2.0 */
/* The file is the player's page (page/, joined by cmake/page.cmake) with the pack in base64. All texts of a scene,
 * above all names of objects, are inside the pack, so that none can be read as HTML. */
#include "cli/scene_html/write.h"

#include "cli/draw/camera_paths.h"
#include "cli/scene_html/pack.h"

#include <math.h>
#include <stdlib.h>
#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"

enum { CHUNK = 3 << 18 }; /* bytes in one element, which become 2^20 characters */

static const char chunk_begin[] = "<script type=\"text/plain\" class=\"data\">", chunk_end[] = "</script>\n";

/* ---- The file ---- */

static uint64_t file_size(const pags_web_pack *pack) {
  const uint64_t chunks = (pack->size + CHUNK - 1) / CHUNK;
  return pags_player_head_size + pags_player_tail_size + (pack->size + 2) / 3 * 4 +
         chunks * (sizeof chunk_begin - 1 + sizeof chunk_end - 1);
}

static pags_result put_chunks(pags_file_writer *file, const pags_web_pack *pack) {
  char *text = malloc(CHUNK / 3 * 4);
  if (!text)
    return pags_out_of_memory("a part of the file");
  pags_result result = PAGS_OK;
  for (size_t at = 0; at < pack->size && result == PAGS_OK; at += CHUNK) {
    const size_t size = pack->size - at < CHUNK ? pack->size - at : CHUNK;
    for (size_t i = 0; i < size; i += 3)
      pags_base64_three(pack->bytes + at + i, size - i, text + i / 3 * 4);
    result = pags_file_writer_put(file, chunk_begin, sizeof chunk_begin - 1);
    if (result == PAGS_OK)
      result = pags_file_writer_put(file, text, (size + 2) / 3 * 4);
    if (result == PAGS_OK)
      result = pags_file_writer_put(file, chunk_end, sizeof chunk_end - 1);
  }
  free(text);
  return result;
}

static pags_result save(const char *path, const pags_web_pack *pack) {
  pags_file_writer file;
  PAGS_TRY(pags_file_writer_begin(&file, path));
  pags_result result = pags_file_writer_put(&file, pags_player_head, pags_player_head_size);
  if (result == PAGS_OK)
    result = put_chunks(&file, pack);
  if (result == PAGS_OK)
    result = pags_file_writer_put(&file, pags_player_tail, pags_player_tail_size);
  if (result == PAGS_OK)
    return pags_file_writer_commit(&file);
  pags_file_writer_abort(&file);
  return result;
}

/* ---- The size ---- */

/* Cameras for measuring contributions: the training cameras, else an orbit. */
static pags_result find_cameras(const pags_scene *scene, pags_camera_path *out) {
  PAGS_TRY(pags_camera_path_views(scene, out));
  if (out->count)
    return PAGS_OK;
  pags_camera_path_destroy(out);
  return pags_camera_path_orbit(scene, 24, PAGS_STAND_AUTO, out);
}

static pags_result pack_again(pags_composition *composition, const pags_web_settings *settings, pags_web_pack *pack) {
  pags_web_pack_destroy(pack);
  return pags_web_pack_make(composition, settings, pack);
}

typedef struct contributor {
  float weight;
  int32_t id;
} contributor;

static int compare_contributors(const void *a, const void *b) {
  const contributor *x = a, *y = b;
  return x->weight < y->weight ? -1 : x->weight > y->weight ? 1 : (x->id > y->id) - (x->id < y->id);
}

/* Packs fewer Gaussians, lowest ranks first, until the file is small enough; never less than a tenth. The number
 * follows from the bytes per Gaussian between the last two files, with a margin. */
static pags_result shrink(pags_composition *composition, pags_web_settings *web, const pags_html_settings *settings,
                          int64_t all, pags_web_pack *pack) {
  const double target = (double)settings->target_size, average = (double)pack->size / (double)pack->gaussians;
  double slope = 1.4 * average, size = (double)file_size(pack); /* base64 is a third longer */
  int64_t kept = all;
  while (size > target) {
    const int64_t fewer = kept - (int64_t)(1.02 * (size - target) / slope) - 1;
    const int64_t next = fewer > all / 10 ? fewer : all / 10;
    if (next == kept || !pack->gaussians)
      return pags_fail(PAGS_ERROR_LIMIT,
                       "--target-size %llu: the file takes %llu bytes even without view-dependent colour and with a "
                       "tenth of the Gaussians: expected at least that",
                       (unsigned long long)settings->target_size, (unsigned long long)file_size(pack));
    web->least_rank = all - next;
    PAGS_TRY(pack_again(composition, web, pack));
    const double now = (double)file_size(pack);
    slope = fmax((size - now) / (double)(kept - next), 0.3 * average);
    size = now;
    kept = next;
  }
  return PAGS_OK;
}

static pags_result leave_out(pags_composition *composition, pags_web_settings *web, const pags_html_settings *settings,
                             const pags_camera_path *cameras, pags_web_pack *pack, pags_html_report *report) {
  const int64_t all = pags_composition_gaussian_count(composition), before = pack->gaussians;
  float *weight = malloc((size_t)all * sizeof *weight);
  contributor *order = malloc((size_t)all * sizeof *order);
  int32_t *rank = malloc((size_t)all * sizeof *rank);
  pags_result result = weight && order && rank ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)all);
  if (result == PAGS_OK)
    result =
        pags_contribution_measure(composition, cameras, settings->tasks, settings->progress, settings->user, weight);
  for (int64_t i = 0; i < all && result == PAGS_OK; i++)
    order[i] = (contributor){weight[i], (int32_t)i};
  if (result == PAGS_OK)
    pags_sort(order, all, sizeof *order, compare_contributors);
  for (int64_t i = 0; i < all && result == PAGS_OK; i++)
    rank[order[i].id] = (int32_t)i;
  web->rank = rank;
  if (result == PAGS_OK)
    result = shrink(composition, web, settings, all, pack);
  double lost = 0, sum = 0;
  for (int64_t i = 0; i < all && result == PAGS_OK; i++) {
    lost += i < web->least_rank ? (double)order[i].weight : 0;
    sum += (double)order[i].weight;
  }
  report->left = sum > 0 ? lost / sum : 0;
  report->left_out = before - pack->gaussians;
  web->rank = NULL;
  free(weight);
  free(order);
  free(rank);
  return result;
}

static pags_result make_pack(pags_composition *composition, pags_web_settings *web, const pags_html_settings *settings,
                             const pags_camera_path *cameras, pags_web_pack *pack, pags_html_report *report) {
  PAGS_TRY(pags_web_pack_make(composition, web, pack));
  report->sh_degree_asked = pack->sh_degree;
  while (settings->target_size && file_size(pack) > settings->target_size && pack->sh_degree > 0) {
    web->sh_degree = pack->sh_degree - 1;
    PAGS_TRY(pack_again(composition, web, pack));
  }
  return settings->target_size && file_size(pack) > settings->target_size
             ? leave_out(composition, web, settings, cameras, pack, report)
             : PAGS_OK;
}

pags_result pags_html_write(pags_scene *scene, const char *path, const pags_html_settings *settings,
                            pags_html_report *report) {
  pags_view_start start;
  pags_camera_path cameras = {0};
  pags_composition *composition = NULL;
  pags_json_writer description = {0};
  pags_web_pack pack = {0};
  *report = (pags_html_report){0};
  pags_result result = pags_view_start_find(scene, &start);
  if (result == PAGS_OK && settings->target_size)
    result = find_cameras(scene, &cameras);
  if (result != PAGS_OK)
    pags_scene_destroy(scene);
  else
    result = pags_composition_create(scene, &composition);
  if (result == PAGS_OK)
    result = pags_view_describe(composition, &start, settings->name, false, &description);
  pags_web_settings web = {.description = description.data,
                           .sh_degree = settings->sh_degree,
                           .progress = settings->progress,
                           .user = settings->user};
  if (result == PAGS_OK)
    result = make_pack(composition, &web, settings, &cameras, &pack, report);
  if (result == PAGS_OK)
    result = save(path, &pack);
  report->gaussians = pack.gaussians;
  report->sh_degree = pack.sh_degree;
  report->bytes = file_size(&pack);
  pags_web_pack_destroy(&pack);
  pags_json_writer_destroy(&description);
  pags_camera_path_destroy(&cameras);
  pags_composition_destroy(composition);
  return result;
}
