/* SPDX-License-Identifier: Apache-2.0 */
/* The small driving scene for tests; see small_scene.h. */
#include "small_scene.h"

#include <stdlib.h>

#include "base/text.h"
#include "splat_files.h"

enum { STILL = 6, MOVING = 4, OBJECTS = 2 };

static void *need(void *block) {
  if (!block)
    abort();
  return block;
}

static void add_objects(pags_scene *scene) {
  scene->object_count = OBJECTS;
  scene->objects = need(calloc(OBJECTS, sizeof *scene->objects));
  for (int i = 0; i < OBJECTS; i++) {
    scene->objects[i] = (pags_scene_object){.model = i ? 1 : -1, .critical = i, .rigid = !i};
    scene->objects[i].record = (pags_object){.id = need(pags_text_copy(i ? "a/b" : "parked")),
                                             .class_name = need(pags_text_copy("car")),
                                             .category = PAGS_CATEGORY_VEHICLE,
                                             .size = {4, 2, 1.5},
                                             .moving = i,
                                             .keyframe_count = 2,
                                             .keyframes = need(calloc(2, sizeof(pags_keyframe)))};
    for (int k = 0; k < 2; k++)
      scene->objects[i].record.keyframes[k] =
          (pags_keyframe){.frame = k,
                          .trained = 1,
                          .time = 0.5 * k,
                          .world_from_object = {0, -1, 0, 10, 1, 0, 0, 2, 0, 0, 1, k},
                          .rotation = {0, 0, 0.01}};
  }
}

static void add_view(pags_scene *scene) {
  scene->view_count = 1;
  scene->views = need(calloc(1, sizeof *scene->views));
  scene->views[0] = (pags_scene_view){.name = need(pags_text_copy("000_0.png")), .gain = {1, 1.1, 1}};
  scene->views[0].camera = (pags_camera){.width = 40,
                                         .height = 30,
                                         .fx = 30,
                                         .fy = 30,
                                         .cx = 20,
                                         .cy = 15,
                                         .time = 0.25,
                                         .world_from_camera = {1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, -6}};
}

void small_scene_make(pags_scene *scene) {
  *scene = (pags_scene){.up = PAGS_UP_Z, .time_end = 0.5, .model_count = 2, .fps = 2, .iterations = 10, .seed = 3};
  scene->models = need(calloc(2, sizeof *scene->models));
  for (int i = 0; i < 2; i++) {
    scene->models[i] = (pags_model){.name = need(pags_text_copy(i ? "a/b" : "background")),
                                    .file = need(pags_text_copy(i ? "objects/a_b.ply" : "background.ply"))};
    sample_gaussians(&scene->models[i].gaussians, i ? MOVING : STILL, 1, 5);
  }
  if (pags_gaussians_add_object_id(&scene->models[0].gaussians) != PAGS_OK ||
      pags_sky_create(&scene->sky, 2) != PAGS_OK)
    abort();
  scene->models[0].gaussians.object_id[2] = 0;
  scene->config = need(pags_text_copy("{\"iterations\": 10}"));
  scene->notes = need(pags_text_copy("{\"sky\": \"a cube map\"}"));
  scene->dataset = need(pags_text_copy("data/street"));
  add_objects(scene);
  add_view(scene);
}
