/* SPDX-License-Identifier: Apache-2.0 */
/* Looks whether the points of a data set are in view of its cameras. Where not one is, poses and points are of
 * different worlds, or the axes are not the ones that the format says: the training would begin, and end, with nothing
 * in view. */
#include "dataset/internal.h"

#include "base/log.h"
#include "dataset/parsed.h"

void pags_dataset_check_in_view(const pags_dataset *dataset) {
  enum { MOST_POINTS = 2000, MOST_VIEWS = 64 };
  const int64_t points = dataset->to_match ? 0 : dataset->point_count;
  const int64_t step = points / MOST_POINTS + 1, view_step = dataset->count / MOST_VIEWS + 1;
  for (int64_t i = 0; i < points; i += step) {
    double point[3];
    for (int c = 0; c < 3; c++)
      point[c] = (double)dataset->xyz[3 * i + c] + dataset->origin[c];
    for (int64_t v = 0; v < dataset->count; v += view_step)
      if (pags_camera_sees(&dataset->views[v].camera, point, 0))
        return;
  }
  if (points > 0)
    PAGS_WARN(
        "%s: none of the %lld points looked at is in view of any camera: poses and points don't belong together, or "
        "their axes or units differ",
        dataset->parsed.source, (long long)((points + step - 1) / step));
}
