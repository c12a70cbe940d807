/* SPDX-License-Identifier: Apache-2.0 */
/* pags render --shutter: drops the cameras' rolling shutters, or gives those of a path the one of the scene's views. */
#include "cli/draw/viewpoints.h"

#include "base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Gives each camera the readout of `from` and its mean velocity between the cameras before and after it. */
static pags_result roll_along(const pags_shutter *from, pags_viewpoints *v) {
  for (int64_t i = 0; i < v->count; i++) {
    const int64_t before = i > 0 ? i - 1 : i, behind = i + 1 < v->count ? i + 1 : i;
    const pags_camera *const a = &v->items[before].camera, *const b = &v->items[behind].camera;
    pags_camera *const camera = &v->items[i].camera;
    if (!(b->time - a->time > 0))
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "--shutter rolling: expected a path whose times increase, which gives the cameras' velocities; "
                       "%s is at %g s and %s at %g s",
                       v->items[before].name, a->time, v->items[behind].name, b->time);
    camera->shutter.across = from->across, camera->shutter.down = from->down;
    pags_rigid_velocity(a->world_from_camera, camera->world_from_camera, b->world_from_camera, b->time - a->time,
                        camera->shutter.velocity);
  }
  return PAGS_OK;
}

pags_result pags_shutter_choose(pags_shutter_choice choice, const pags_scene *scene, pags_viewpoints *viewpoints) {
  bool rolls = false;
  for (int64_t i = 0; i < viewpoints->count; i++) {
    if (choice == PAGS_SHUTTER_GLOBAL)
      viewpoints->items[i].camera.shutter = (pags_shutter){0};
    rolls = rolls || pags_camera_rolls(&viewpoints->items[i].camera);
  }
  if (choice != PAGS_SHUTTER_ROLLING || rolls)
    return PAGS_OK;
  for (int64_t i = 0; i < scene->view_count; i++)
    if (pags_camera_rolls(&scene->views[i].camera))
      return roll_along(&scene->views[i].camera.shutter, viewpoints);
  return pags_fail(
      PAGS_ERROR_ARGUMENT,
      "--shutter rolling: neither the cameras nor the scene's views have a rolling shutter; expected cameras "
      "with rolling_shutter (docs/lenses.md), or --shutter global");
}
