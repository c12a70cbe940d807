/* SPDX-License-Identifier: Apache-2.0 */
/* pick SCENE CAMERA.json X Y: prints the Gaussian and the object that are visible at pixel (X, Y). */
#include <stdio.h>
#include <stdlib.h>

#include <pags/pick.h>

int main(int argc, char **argv) {
  if (argc < 5)
    return fprintf(stderr, "usage: pick SCENE CAMERA.json X Y\n"), 1;
  pags_composition *scene = NULL;
  pags_camera_path view = {0};
  if (pags_composition_load(argv[1], &scene) || pags_camera_path_load(argv[2], &view))
    return fprintf(stderr, "pick: %s\n", pags_error_message()), 1;

  /* The ray of the pixel's centre in the camera's axes, then in the world. */
  const pags_camera *camera = &view.cameras[0];
  const double *m = camera->world_from_camera;
  const double across = (atof(argv[3]) + 0.5 - camera->cx) / camera->fx;
  const double down = (atof(argv[4]) + 0.5 - camera->cy) / camera->fy;
  const double origin[3] = {m[3], m[7], m[11]};
  const double direction[3] = {m[0] * across + m[1] * down + m[2], m[4] * across + m[5] * down + m[6],
                               m[8] * across + m[9] * down + m[10]};

  const pags_part *parts;
  int count;
  pags_picked picked;
  pags_compose(scene, camera->time, &parts, &count);
  if (pags_composition_pick(scene, parts, count, origin, direction, NULL, &picked))
    return fprintf(stderr, "pick: %s\n", pags_error_message()), 1;
  if (picked.part < 0)
    printf("nothing\n");
  else
    printf("Gaussian %d, %.2f m away, of %s %s\n", (int)picked.id, picked.depth,
           picked.class_name ? picked.class_name : "no object", picked.object_id ? picked.object_id : "");
  pags_camera_path_destroy(&view);
  pags_composition_destroy(scene);
  return 0;
}
