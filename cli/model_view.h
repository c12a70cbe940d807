/* A scene made ready for rendering: each model's Gaussians in Morton order with clusters over them, keeping the numbers
 * they have in their files. */
#ifndef PAGS_CLI_MODEL_VIEW_H
#define PAGS_CLI_MODEL_VIEW_H

#include <pags/frame.h>
#include <pags/scene.h>
#include <stdbool.h>

typedef struct pags_model_view {
  pags_scene scene; /* the rows of its models are re-ordered; ids name the order of the files */
  int part_count;
  pags_part *parts;        /* one per model; ids run on from model to model */
  pags_clusters *clusters; /* one per model */
  int32_t **ids;           /* one array per model */
  int64_t gaussian_count;
} pags_model_view;

/* Loads a scene folder or splat file. `view` is zeroed on failure. */
pags_result pags_model_view_load(const char *path, pags_model_view *view);
void pags_model_view_destroy(pags_model_view *view); /* a zeroed struct is allowed */

/* Frame options as the scene asks for: origin, background, antialiasing, and the training's near plane and low-pass. */
pags_frame_options pags_model_view_options(const pags_model_view *view);

/* Per id, in the order of the files: object number (-1: none) and semantic priority. `out` has gaussian_count entries.
 * priority returns false when the scene holds none. */
void pags_model_view_objects(const pags_model_view *view, int32_t *out);
bool pags_model_view_priorities(const pags_model_view *view, float *out);

#endif
