/* SPDX-License-Identifier: Apache-2.0 */
/* Replaces the export of proxies, glTF and USD in builds without the libraries for proxies: functions that
 * say so. Splat files are written by every build. */
#include "exporters/format/splat_save.h"

static pags_result left_out(const char *path) {
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s: this build writes .ply, .spz, .sog, .splat, .pagsz and .html alone; glTF, USD and proxies need "
                   "a build with the CMake options PAGS_EXPORT and PAGS_EMBREE",
                   path);
}

pags_result pags_gltf_splats_save(const char *path, const pags_scene *scene, const pags_gaussians *g,
                                  PAGS_UNUSED float converted_from) {
  (void)scene, (void)g;
  return left_out(path);
}

pags_result pags_gltf_tracks_save(const char *path, pags_composition *composition, const pags_splat_options *options,
                                  int64_t *count) {
  (void)composition, (void)options, (void)count;
  return left_out(path);
}

pags_result pags_export_proxies(const pags_scene *scene, const char *path, const pags_proxy_options *options,
                                pags_tasks *tasks, pags_progress_fn *progress, void *user, pags_proxy_report *report) {
  (void)scene, (void)options, (void)tasks, (void)progress, (void)user, (void)report;
  return left_out(path);
}

pags_result pags_export_usd(pags_scene *scene, const char *path, const pags_proxy_options *proxies,
                            const pags_splat_options *splats, pags_tasks *tasks, pags_progress_fn *progress, void *user,
                            int64_t *count) {
  pags_scene_destroy(scene);
  (void)proxies, (void)splats, (void)tasks, (void)progress, (void)user, (void)count;
  return left_out(path);
}
