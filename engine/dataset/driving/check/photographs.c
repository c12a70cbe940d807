/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the photographs of a dead camera: black ones, and ones that it repeats though it has moved.
 *
 * A photograph is shrunk to means of cells, 32 across, which a new compression changes by some hundredths of a level
 * and noise hardly more. Their standard deviation over the picture is 14 of 255 levels and more in the recordings
 * tried; a picture below 2 shows nothing, be it black, white or a green of a lost signal. Between two photographs of a
 * car that has driven half a metre, cells differ by a root mean square of 1.8 levels and more; below 0.4, or a
 * thirtieth of the deviation of a dim picture, they are the same picture.
 *
 * A camera is looked at in all its photographs if these are few, else in pairs of neighbours spread over the recording
 * and in those whose files are as long as another or much shorter than most; in all if one of them is
 * found wanting. */
#include "dataset/driving/check/looks.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "dataset/driving/driving_set.h"

#include <math.h>
#include <stdlib.h>

enum { CELLS = 32, PAIRS = 8, MOST_LOOKS = 256 };

static const double least_spread = 2, most_difference = 0.4, most_share = 1 / 30.0; /* levels of 255; of the spread */
static const double least_way = 0.5, least_turn = 2;                                /* metres, degrees */

typedef struct look {
  pags_image cells; /* data NULL: not looked at */
  double mean, spread;
  int64_t same_as; /* an earlier view that shows the same; -1: none */
} look;

typedef struct looks {
  const pags_dataset *dataset;
  look *views;                      /* of each view */
  pags_tally blank, repeated, twin; /* twin: the same picture in two cameras */
  int64_t looked;
} looks;

static pags_result look_at(looks *all, int64_t view) {
  look *l = &all->views[view];
  double step, sum = 0, square = 0;
  if (l->cells.data)
    return PAGS_OK;
  PAGS_TRY(pags_small_photo_load(all->dataset, view, CELLS, &l->cells, &step));
  all->looked++;
  const uint8_t *data = l->cells.data;
  const int count = l->cells.width * l->cells.height;
  for (int i = 0; i < count; i++) {
    sum += data[i];
    square += (double)data[i] * data[i];
  }
  l->mean = sum / count;
  l->spread = sqrt(fmax(square / count - l->mean * l->mean, 0));
  return PAGS_OK;
}

static bool is_blank(const look *l) {
  return l->spread < least_spread;
}

static bool are_same(const look *a, const look *b) {
  const uint8_t *p = a->cells.data, *q = b->cells.data;
  double square = 0;
  if (a->cells.width != b->cells.width || a->cells.height != b->cells.height || is_blank(a) || is_blank(b))
    return false;
  const int count = a->cells.width * a->cells.height;
  for (int i = 0; i < count; i++)
    square += (double)(p[i] - q[i]) * (p[i] - q[i]);
  return sqrt(square / count) < fmin(most_difference, most_share * a->spread);
}

/* Compares the photographs of a camera that were looked at with earlier ones from elsewhere. Returns how many are
 * wanting.
 */
static int64_t compare(looks *all, const int64_t *views, int64_t count) {
  int64_t wanting = 0;
  for (int64_t j = 0; j < count; j++) {
    look *b = &all->views[views[j]];
    if (!b->cells.data)
      continue;
    b->same_as = -1;
    for (int64_t i = 0; i < j && b->same_as < 0; i++) {
      const look *a = &all->views[views[i]];
      if (a->cells.data && are_same(a, b) &&
          (pags_view_distance(all->dataset, views[i], views[j]) > least_way ||
           pags_view_angle(all->dataset, views[i], views[j]) > least_turn))
        b->same_as = views[i];
    }
    wanting += is_blank(b) || b->same_as >= 0;
  }
  return wanting;
}

/* Looks at photographs whose files are a third as long as half of the camera's, as black ones are, and at those as long
 * as another. `sizes` has room for two numbers a photograph. */
static pags_result look_at_odd_files(looks *all, const int64_t *views, int64_t count, double *sizes) {
  double *sorted = sizes + count;
  for (int64_t i = 0; i < count; i++) {
    uint64_t size;
    PAGS_TRY(pags_file_size(all->dataset->views[views[i]].image_path, &size));
    sizes[i] = sorted[i] = (double)size;
  }
  pags_sort_doubles(sorted, count);
  for (int64_t i = 0; i < count; i++) {
    const double *same = bsearch(&sizes[i], sorted, (size_t)count, sizeof *sorted, pags_compare_doubles);
    if (3 * sizes[i] < sorted[count / 2] || (same > sorted && same[-1] == *same) ||
        (same + 1 < sorted + count && same[1] == *same))
      PAGS_TRY(look_at(all, views[i]));
  }
  return PAGS_OK;
}

static pags_result look_at_camera(looks *all, const int64_t *views, int64_t count, double *sizes) {
  PAGS_TRY(look_at_odd_files(all, views, count, sizes));
  for (int64_t i = 0; i < count; i++)
    /* the first or the second of a pair */
    if (count <= 2 * PAIRS || i * PAIRS / (count - 1) != (i + 1) * PAIRS / (count - 1) ||
        (i && (i - 1) * PAIRS / (count - 1) != i * PAIRS / (count - 1)))
      PAGS_TRY(look_at(all, views[i]));
  if (compare(all, views, count) == 0)
    return PAGS_OK;
  for (int64_t i = 0; i < count; i += 1 + (count - 1) / MOST_LOOKS)
    PAGS_TRY(look_at(all, views[i]));
  compare(all, views, count);
  for (int64_t i = 0; i < count; i++) {
    const look *l = &all->views[views[i]];
    const char *name = all->dataset->views[views[i]].name;
    if (l->cells.data && is_blank(l))
      pags_tally_add(&all->blank, "%s (mean %.0f of 255, deviation %.1f)", name, l->mean, l->spread);
    else if (l->cells.data && l->same_as >= 0)
      pags_tally_add(&all->repeated, "%s, which shows what %s does from %.1f m away", name,
                     all->dataset->views[l->same_as].name, pags_view_distance(all->dataset, views[i], l->same_as));
  }
  return PAGS_OK;
}

static void looks_destroy(looks *all) {
  for (int64_t i = 0; all->views && i < all->dataset->count; i++)
    pags_image_destroy(&all->views[i].cells);
  free(all->views);
}

pags_result pags_look_at_photographs(const pags_dataset *dataset) {
  const pags_driving *driving = dataset->parsed.driving;
  PAGS_AUTO(looks_destroy)
  looks all = {.dataset = dataset, .views = calloc((size_t)dataset->count, sizeof *all.views)};
  PAGS_AUTOFREE int64_t *views = malloc((size_t)dataset->count * sizeof *views);
  PAGS_AUTOFREE double *sizes = malloc(2 * (size_t)dataset->count * sizeof *sizes);
  PAGS_CHECK_MEMORY(all.views && views && sizes, "%s", driving->root);
  for (int64_t s = 0; s < driving->sensor_count; s++) {
    int64_t count = 0;
    for (int64_t i = 0; i < dataset->count; i++)
      if (dataset->views[i].sensor == driving->sensors[s].number)
        views[count++] = i;
    PAGS_TRY(look_at_camera(&all, views, count, sizes));
  }
  /* Compare photographs of different cameras at one time step; views are sorted by it. */
  const pags_view *v = dataset->views;
  for (int64_t j = 0; j < dataset->count; j++)
    for (int64_t i = j - 1; i >= 0 && v[i].frame == v[j].frame; i--)
      if (all.views[i].cells.data && all.views[j].cells.data && are_same(&all.views[i], &all.views[j]))
        pags_tally_add(&all.twin, "%s, which shows what %s does", v[j].name, v[i].name);
  const struct {
    const pags_tally *tally;
    const char *what;
  } kinds[] = {{&all.blank, "show nothing: they are black or of one colour"},
               {&all.repeated, "repeat an earlier one though the camera moved"},
               {&all.twin, "are those of another camera"}};
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (kinds[i].tally->count)
      PAGS_WARN(
          "%s/images: %lld of %lld photographs looked at %s; the first is %s. Delete them and pass --allow-missing, or "
          "choose others by --cameras and --frames",
          driving->root, (long long)kinds[i].tally->count, (long long)all.looked, kinds[i].what, kinds[i].tally->first);
  return PAGS_OK;
}
