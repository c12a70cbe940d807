/* SPDX-License-Identifier: Apache-2.0 */
/* The file is the player's page (page/, joined by cmake/page.cmake) with the pack in base64. All texts of a scene,
 * above all names of objects, are inside the pack, so that none can be read as HTML. */
#include "cli/scene_html/write.h"

#include "cli/draw/camera_paths.h"
#include "cli/draw/picture.h"

#include <math.h>
#include "base/bytes.h"
#include "base/file.h"
#include "base/sort.h"
#include "frame/owners.h"

enum { MOST_CAMERAS = 48, MOST_SIDE = 640 };
enum { CHUNK = 3 << 18 }; /* bytes in one element, which become 2^20 characters */

static const char chunk_begin[] = "<script type=\"text/plain\" class=\"data\">", chunk_end[] = "</script>\n";

/* ---- The file ---- */

static uint64_t file_size(const pags_web_pack *pack) {
  const uint64_t chunks = (pack->size + CHUNK - 1) / CHUNK;
  return pags_player_head_size + pags_player_tail_size + (pack->size + 2) / 3 * 4 +
         chunks * (sizeof chunk_begin - 1 + sizeof chunk_end - 1);
}

static pags_result save(const char *path, const pags_web_pack *pack) {
  PAGS_AUTOFREE char *text = malloc(CHUNK / 3 * 4);
  PAGS_CHECK_MEMORY(text, "a part of the file");
  PAGS_AUTO(pags_file_writer_abort) pags_file_writer file = {0}; /* unless it was committed */
  PAGS_TRY(pags_file_writer_begin(&file, path));
  PAGS_TRY(pags_file_writer_put(&file, pags_player_head, pags_player_head_size));
  for (size_t at = 0; at < pack->size; at += CHUNK) {
    const size_t size = pack->size - at < CHUNK ? pack->size - at : CHUNK;
    for (size_t i = 0; i < size; i += 3)
      pags_base64_three(pack->bytes + at + i, size - i, text + i / 3 * 4);
    PAGS_TRY(pags_file_writer_put(&file, chunk_begin, sizeof chunk_begin - 1));
    PAGS_TRY(pags_file_writer_put(&file, text, (size + 2) / 3 * 4));
    PAGS_TRY(pags_file_writer_put(&file, chunk_end, sizeof chunk_end - 1));
  }
  PAGS_TRY(pags_file_writer_put(&file, pags_player_tail, pags_player_tail_size));
  return pags_file_writer_commit(&file);
}

/* ---- The size ---- */

static void add_weight(void *user, int64_t id, double weight) {
  float *const sums = user;
  sums[id] += (float)weight;
}

/* Adds up the contribution of each Gaussian, the sum of its weights alpha T over the pixels of some pictures: over at
 * most 48 cameras of the path, drawn at no more than 640 pixels a side. weight[id] has room for all Gaussians. The same
 * bits for any number of threads. PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
static pags_result measure_contributions(pags_composition *composition, const pags_camera_path *path,
                                         const pags_html_settings *settings, float *weight) {
  const pags_frame_options options = pags_composition_options(composition);
  PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL;
  PAGS_TRY(pags_frame_create(settings->tasks, &frame));
  memset(weight, 0, (size_t)pags_composition_gaussian_count(composition) * sizeof *weight);
  const int64_t count = path->count < MOST_CAMERAS ? path->count : MOST_CAMERAS;
  for (int64_t i = 0; i < count; i++) {
    pags_camera camera = path->cameras[i * path->count / count];
    const double by = fmin(1, (double)MOST_SIDE / (camera.width > camera.height ? camera.width : camera.height));
    camera.width = (int)fmax(1, floor(camera.width * by));
    camera.height = (int)fmax(1, floor(camera.height * by));
    camera.fx *= by;
    camera.fy *= by;
    camera.cx *= by;
    camera.cy *= by;
    PAGS_TRY(pags_picture_weights(composition, frame, &camera, &options, add_weight, weight));
    if (settings->progress && !settings->progress(settings->user, (double)(i + 1) / (double)count, "contributions"))
      return pags_fail(PAGS_CANCELLED, "interrupted");
  }
  return PAGS_OK;
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

static pags_result leave_out(pags_composition *composition, const pags_web_settings *web,
                             const pags_html_settings *settings, const pags_camera_path *cameras, pags_web_pack *pack,
                             pags_html_report *report) {
  const int64_t all = pags_composition_gaussian_count(composition), before = pack->gaussians;
  PAGS_AUTOFREE float *weight = malloc((size_t)all * sizeof *weight);
  PAGS_AUTOFREE contributor *order = malloc((size_t)all * sizeof *order);
  PAGS_AUTOFREE int32_t *rank = malloc((size_t)all * sizeof *rank);
  PAGS_CHECK_MEMORY(weight && order && rank, "%lld Gaussians", (long long)all);
  PAGS_TRY(measure_contributions(composition, cameras, settings, weight));
  for (int64_t i = 0; i < all; i++)
    order[i] = (contributor){weight[i], (int32_t)i};
  pags_sort(order, all, sizeof *order, compare_contributors);
  for (int64_t i = 0; i < all; i++)
    rank[order[i].id] = (int32_t)i;
  pags_web_settings ranked = *web;
  ranked.rank = rank;
  PAGS_TRY(shrink(composition, &ranked, settings, all, pack));
  double lost = 0, sum = 0;
  for (int64_t i = 0; i < all; i++) {
    lost += i < ranked.least_rank ? (double)order[i].weight : 0;
    sum += (double)order[i].weight;
  }
  report->left = sum > 0 ? lost / sum : 0;
  report->left_out = before - pack->gaussians;
  return PAGS_OK;
}

pags_result pags_html_write(pags_scene *scene, const char *path, const pags_html_settings *settings,
                            pags_html_report *report) {
  pags_view_start start;
  PAGS_AUTO(pags_scene_destroy) pags_scene owned = *scene;
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path cameras = {0};
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *composition = NULL;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer description = {0};
  PAGS_AUTO(pags_web_pack_destroy) pags_web_pack pack = {0};
  *scene = (pags_scene){0};
  *report = (pags_html_report){0};
  PAGS_TRY(pags_view_start_find(&owned, &start));
  if (settings->target_size) {
    /* Cameras for measuring contributions: the training cameras, else an orbit. */
    PAGS_TRY(pags_camera_path_views(&owned, &cameras));
    if (!cameras.count) {
      pags_camera_path_destroy(&cameras);
      PAGS_TRY(pags_camera_path_orbit(&owned, 24, PAGS_STAND_AUTO, &cameras));
    }
  }
  PAGS_TRY(pags_composition_create(&owned, &composition));
  PAGS_TRY(pags_view_describe(composition, &start, settings->name, false, &description));
  pags_web_settings web = {.description = description.data,
                           .sh_degree = settings->sh_degree,
                           .progress = settings->progress,
                           .user = settings->user};
  PAGS_TRY(pags_web_pack_make(composition, &web, &pack));
  report->sh_degree_asked = pack.sh_degree;
  while (settings->target_size && file_size(&pack) > settings->target_size && pack.sh_degree > 0) {
    web.sh_degree = pack.sh_degree - 1;
    PAGS_TRY(pack_again(composition, &web, &pack));
  }
  if (settings->target_size && file_size(&pack) > settings->target_size)
    PAGS_TRY(leave_out(composition, &web, settings, &cameras, &pack, report));
  PAGS_TRY(save(path, &pack));
  report->gaussians = pack.gaussians;
  report->sh_degree = pack.sh_degree;
  report->bytes = file_size(&pack);
  return PAGS_OK;
}
