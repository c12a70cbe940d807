/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of scene.json with the other files of its folder, and of camera and path files. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <pags/compose.h>
#include <pags/scene.h>

#include "base/file.h"
#include "small_scene.h"

/* ---- scene.json ---- */

static void seed_scene(void) {
  pags_scene scene;
  const char *const path = fuzz_file("scene.json", "", 0);
  small_scene_make(&scene);
  fuzz_seed_saved(pags_scene_save(fuzz_folder(), &scene), path);
  pags_scene_destroy(&scene);
}

static int run_scene(const uint8_t *data, size_t size) {
  pags_scene scene;
  pags_composition *composition = NULL;
  const char *const path = fuzz_file("scene.json", data, size);
  (void)path;
  pags_result result = pags_scene_load(fuzz_folder(), &scene);
  if (result != PAGS_OK) {
    FUZZ_CHECK(scene.model_count == 0 && !scene.models);
    fuzz_refused(result, "/");
    return 0;
  }
  double gain[3], offset[3];
  for (int k = -1; k <= 1; k++)
    pags_scene_exposure(&scene, 0, 0.25 * k, gain, offset);
  result = pags_composition_create(&scene, &composition);
  FUZZ_CHECK(result == PAGS_OK || *pags_error_message());
  for (int k = -1; k <= 3 && result == PAGS_OK; k++) {
    double pose[12];
    for (int64_t i = 0; i < scene.object_count; i++)
      if (pags_object_pose(&scene.objects[i].record, 0.2 * k, pose))
        for (int j = 0; j < 12; j++)
          FUZZ_CHECK(isfinite(pose[j]));
  }
  pags_composition_destroy(composition);
  /* An accepted scene can be written and read again. */
  char copy[1024];
  snprintf(copy, sizeof copy, "%.900s/copy", fuzz_folder());
  FUZZ_CHECK(pags_scene_save(copy, &scene) == PAGS_OK);
  pags_scene_destroy(&scene);
  FUZZ_CHECK(pags_scene_load(copy, &scene) == PAGS_OK);
  pags_scene_destroy(&scene);
  FUZZ_CHECK(pags_remove_tree(copy) == PAGS_OK);
  return 1;
}

static const char *const scene_words[] = {"\"models\": [",
                                          "\"cameras\": [",
                                          "\"objects\": [",
                                          "\"knots\": [",
                                          "\"file\": ",
                                          "\"sky\": ",
                                          "\"gaussians\": ",
                                          "null",
                                          "true",
                                          "[[[[",
                                          "{}",
                                          "\\u0000",
                                          "\\ud800",
                                          "1e308",
                                          "-1e-320",
                                          "\"background.ply\"",
                                          "\"../\"",
                                          "\"fps\": ",
                                          "\"time\": [",
                                          "\"modelled\": {",
                                          NULL};
static const fuzz_target scene = {
    .name = "scene_json", .seeds = seed_scene, .run = run_scene, .words = scene_words, .times = 512, .smoke = 6000};

/* ---- Camera and path files ---- */

static int run_path(const uint8_t *data, size_t size) {
  pags_camera_path path;
  const pags_result result = pags_camera_path_load(fuzz_file("path.json", data, size), &path);
  if (result != PAGS_OK) {
    FUZZ_CHECK(!path.cameras);
    fuzz_refused(result, "path.json");
    return 0;
  }
  for (int64_t i = 0; i < path.count; i++) {
    pags_camera *const c = &path.cameras[i];
    FUZZ_CHECK(c->width >= 1 && c->width <= 65535 && c->height >= 1 && c->height <= 65535);
    FUZZ_CHECK(pags_camera_check(c, "again") == PAGS_OK);
    const pags_camera half = pags_camera_downscale(c, 2);
    FUZZ_CHECK(half.width >= 1 && isfinite(half.fx));
  }
  pags_camera_path_destroy(&path);
  return 1;
}

static void seed_path(void) {
  static const char camera[] =
      "{\"width\": 64, \"height\": 48, \"fx\": 50.5, \"fy\": 50, \"cx\": 32, \"cy\": 24, "
      "\"camera_from_world_quaternion_wxyz\": [0.5, 0.5, -0.5, 0.5], "
      "\"camera_from_world_translation\": [1, 2.5, -3], \"time\": 1.5}";
  char text[2048];
  fuzz_seed_text(camera);
  snprintf(text, sizeof text, "{\"fps\": 10, \"frames\": [%s,\n%s]}", camera, camera);
  fuzz_seed_text(text);
  /* cameras.json of INRIA's train.py, and a camera path of nerfstudio */
  fuzz_seed_text(
      "[{\"id\": 0, \"img_name\": \"a\", \"width\": 64, \"height\": 48, \"position\": [1, 2, 3], "
      "\"rotation\": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], \"fy\": 50.5, \"fx\": 50}]");
  fuzz_seed_text(
      "{\"camera_type\": \"perspective\", \"render_width\": 64, \"render_height\": 48, \"fps\": 24, \"crop\": null, "
      "\"camera_path\": [{\"camera_to_world\": [1, 0, 0, 4, 0, 1, 0, 5, 0, 0, 1, 6, 0, 0, 0, 1], \"fov\": 50}]}");
}

static const char *const path_words[] = {"\"camera_path\": [",
                                         "\"fov\": ",
                                         "\"position\": ",
                                         "\"fps\": ",
                                         "\"frames\": [",
                                         "\"time\": ",
                                         "null",
                                         "1e308",
                                         "1e-320",
                                         "{}",
                                         "[]",
                                         "65536",
                                         NULL};
static const fuzz_target camera_path = {
    .name = "camera_path", .seeds = seed_path, .run = run_path, .words = path_words, .times = 256};

const fuzz_target *const fuzz_targets[] = {&scene, &camera_path, NULL};
