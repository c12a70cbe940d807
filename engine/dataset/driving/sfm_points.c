/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the points of a COLMAP model that is in the world frame of a driving set. The poses of the model are not
 * used. Its tracks are, so that points triangulated from held-out photographs can be left out. */
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"

#include <stdlib.h>
#include <string.h>

/* Finds the folder of the model: `named` itself or one of COLMAP's subfolders, taken as a path as it is, then
 * relative to the data set. Returns NULL if not found; the caller frees the path. */
static char *find_model(const char *root, const char *named) {
  static const char *const below[] = {"", "sparse/0", "sparse"};
  for (size_t i = 0; i < 2; i++)
    for (size_t j = 0; j < sizeof below / sizeof *below; j++) {
      PAGS_AUTOFREE char *base = i ? pags_path_join(root, named) : pags_text_copy(named);
      PAGS_AUTOFREE char *folder = base && *below[j] ? pags_path_join(base, below[j]) : pags_text_copy(base);
      if (folder && pags_colmap_is_model(folder))
        return pags_take(&folder);
    }
  return NULL;
}

enum { FARTHEST = 10000 }; /* m; beyond it, a photograph of a street shows nothing that a point could represent */

/* Leaves out the points that are farther than FARTHEST from the car's place in the middle of the recording. */
static void drop_far(const pags_driving *driving, pags_parsed_points *points, const char *model) {
  const double *eye = driving->steps[driving->step_count / 2].eye;
  const int64_t all = points->count;
  points->count = 0;
  for (int64_t i = 0; i < all; i++)
    if (!(pags_distance_squared3(points->items[i].xyz, eye) > (double)FARTHEST * FARTHEST))
      points->items[points->count++] = points->items[i];
  if (points->count < all)
    PAGS_WARN(
        "%s: %lld of %lld points are more than %d km from the car and left out; expected a model in the recording's "
        "world, in metres",
        model, (long long)(all - points->count), (long long)all, FARTHEST / 1000);
}

static pags_result take_points(pags_parsed_dataset *model, const char *folder, pags_parsed_dataset *parsed) {
  pags_driving *driving = parsed->driving;
  drop_far(driving, &model->points, folder);
  long long count = (long long)model->points.count;
  /* The id of a view is that of the model's image with the same file name, or -1 (in no track) without one. */
  int64_t matched = 0;
  for (int64_t i = 0; i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i];
    view->id = -1;
    for (int64_t j = 0; j < model->count && view->id < 0; j++)
      if (strcmp(pags_path_name(view->image_path), pags_path_name(model->views[j].image_path)) == 0)
        view->id = model->views[j].id;
    matched += view->id >= 0;
  }
  parsed->points = model->points;
  memset(&model->points, 0, sizeof model->points);
  parsed->points.tracked = matched > 0;
  if (count > 0)
    driving->provides |= PAGS_PROVIDES_SFM;
  if (matched > 0)
    return pags_driving_note(driving, "SfM: %lld points; those that fewer than two training views see are left out",
                             count);
  return pags_driving_note(driving, "SfM: %lld points, all used: none of the model's images has the name of a view",
                           count);
}

pags_result pags_sfm_points_read(const char *named, pags_parsed_dataset *parsed) {
  PAGS_AUTOFREE char *folder = find_model(parsed->driving->root, named);
  if (!folder)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: not a COLMAP model: expected cameras.bin and images.bin, or .txt", named);
  PAGS_AUTO(pags_parsed_destroy) pags_parsed_dataset model = {0};
  PAGS_TRY(pags_colmap_read(folder, folder, &model));
  return take_points(&model, folder, parsed);
}
