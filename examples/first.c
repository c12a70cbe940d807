/* SPDX-License-Identifier: Apache-2.0 */
/* first SCENE CAMERA.json PICTURE.ppm: loads a scene folder or a splat file, draws the view of a camera file, writes
 * it. */
#include <stdio.h>

#include <pags/compose.h>

int main(int argc, char **argv) {
  if (argc < 4)
    return fprintf(stderr, "usage: first SCENE CAMERA.json PICTURE.ppm\n"), 1;
  pags_composition *scene = NULL;
  pags_frame *frame = NULL;
  pags_tasks *tasks = pags_tasks_create(0); /* 0: as many threads as this process may use */
  pags_camera_path view = {0};
  pags_picture picture;
  const pags_part *parts;
  int count;
  if (!tasks || pags_frame_create(tasks, &frame) || pags_composition_load(argv[1], &scene) ||
      pags_camera_path_load(argv[2], &view))
    return fprintf(stderr, "first: %s\n", pags_error_message()), 1;
  const pags_frame_options options = pags_composition_options(scene);
  pags_compose(scene, view.cameras[0].time, &parts, &count);
  FILE *file = fopen(argv[3], "wb");
  if (!file || pags_frame_render(frame, parts, count, &view.cameras[0], &options, NULL, NULL, &picture))
    return fprintf(stderr, "first: %s\n", file ? pags_error_message() : argv[3]), 1;
  fprintf(file, "P6 %d %d 255\n", picture.width, picture.height);
  for (int y = 0; y < picture.height; y++)
    for (int x = 0; x < picture.width; x++)
      for (int channel = 0; channel < 3; channel++) {
        const float value = picture.rgb[channel][y * picture.stride + x]; /* display-referred sRGB, not clamped */
        fputc((int)(255.0F * (value < 0.0F ? 0.0F : value > 1.0F ? 1.0F : value) + 0.5F), file);
      }
  fclose(file);
  pags_frame_destroy(frame);
  pags_camera_path_destroy(&view);
  pags_composition_destroy(scene);
  pags_tasks_destroy(tasks);
  return 0;
}
