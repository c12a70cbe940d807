/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the pixels in which each camera sees the ego vehicle: from masks of the user, else by a search for pixels
 * that never change.
 *
 * The search compares training photographs of one camera, at least half a metre from each other and spread over the
 * distance driven, shrunk to a width of about 240 pixels. A pixel is still if the standard deviation of its brightness
 * over the photographs is below two of 255 levels; the texture of a road varies by more, however grey it looks. After a
 * 3x3 morphological opening, which removes isolated pixels, a connected component of still pixels becomes the mask if
 * it covers at least a hundredth of the picture and touches at least a twentieth of its lower edge. Four photographs
 * rule out most cameras; only the remaining ones are searched with all chosen photographs (up to twelve). Cameras that
 * don't stand upright aren't searched: at the lower edge of one that looks up there may be clear sky, which is as
 * still. Where a lens sees a circle of the picture, its lower edge is that of the circle in each column. */
#include "dataset/internal.h"

#include "dataset/driving/check/looks.h"
#include "dataset/driving/driving_set.h"
#include "dataset/driving/masks.h"
#include "image/pixels.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SMALL_WIDTH = 240, FEW = 4, MANY = 12 };

static const double still_deviation = 2; /* brightness levels of 255, below which a pixel is still */
static const double spacing = 0.5;       /* metres: least distance between two photographs */

/* ---- Masks of the user ---- */

static pags_result load_mask(const char *path, pags_sensor *sensor) {
  PAGS_TRY(pags_image_load(path, PAGS_U8, 1, &sensor->ego));
  const size_t size = (size_t)sensor->ego.width * (size_t)sensor->ego.height;
  uint8_t *data = sensor->ego.data;
  sensor->ego_of_ones = pags_driving_white(&sensor->ego) == 1;
  for (size_t i = 0; sensor->ego_of_ones && i < size; i++)
    data[i] = data[i] ? 255 : 0;
  return PAGS_OK;
}

static pags_result check_size(const pags_dataset *dataset, const pags_sensor *sensor, const char *given) {
  for (int64_t i = 0; i < dataset->count; i++) {
    const pags_parsed_view *view = &dataset->parsed.views[i];
    if (view->sensor != sensor->number)
      continue;
    if (view->lens.width == sensor->ego.width && view->lens.height == sensor->ego.height)
      return PAGS_OK;
    return pags_fail(PAGS_ERROR_FORMAT, "%s: ego mask of %d x %d pixels, expected %d x %d as %s has", given,
                     sensor->ego.width, sensor->ego.height, view->lens.width, view->lens.height, view->image_path);
  }
  return PAGS_OK;
}

/* Warns of masks of 0 and 1, and of masks that leave out most of the picture. */
static void warn_of_masks(const pags_driving *driving, const char *given) {
  int ones = 0, wide = 0, first_one = 0, first_wide = 0, total = 0;
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const pags_sensor *sensor = &driving->sensors[i];
    const size_t size = (size_t)sensor->ego.width * (size_t)sensor->ego.height;
    const uint8_t *data = sensor->ego.data;
    size_t white = 0;
    for (size_t k = 0; data && k < size; k++)
      white += data[k] >= 128;
    total += data != NULL;
    if (sensor->ego_of_ones)
      first_one = ones++ ? first_one : sensor->number;
    if (2 * white > size)
      first_wide = wide++ ? first_wide : sensor->number;
  }
  if (ones > 0)
    PAGS_WARN(
        "%s: %d of %d ego masks are of 0 and 1, the first is camera %d's, in place of 0 and 255: 1 is taken as white",
        given, ones, total, first_one);
  if (wide > 0)
    PAGS_WARN(
        "%s: %d of %d ego masks leave out more than half of the picture, the first is camera %d's: they may be "
        "inverted; expected white for the recording car",
        given, wide, total, first_wide);
}

/* Loads the masks of the cameras from a picture, which serves all cameras, or from a folder of C.png. */
static pags_result take_given(pags_dataset *dataset, const char *given) {
  pags_driving *driving = dataset->parsed.driving;
  const bool each = pags_dir_exists(given);
  int total = 0;
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    pags_sensor *sensor = &driving->sensors[i];
    PAGS_AUTOFREE char *path = each ? pags_text_format("%s/%d.png", given, sensor->number) : pags_text_copy(given);
    PAGS_CHECK_MEMORY(path, "%s", driving->root);
    if (each && !pags_file_exists(path))
      continue;
    total++;
    PAGS_TRY(load_mask(path, sensor));
    PAGS_TRY(check_size(dataset, sensor, given));
  }
  warn_of_masks(driving, given);
  return pags_driving_note(driving, "ego mask: of %d cameras from %s", total, given);
}

/* ---- Choosing photographs ---- */

typedef struct search {
  const pags_dataset *dataset;
  int64_t views[MANY];
  int count;
  int width, height;
  double step;              /* source pixels per pixel of the search */
  float *sum, *square;      /* sums of brightness and of its square over the photographs, by pixel */
  uint8_t *still, *scratch; /* still: 0 no, 1 still, 2 in the component being filled, 3 proposed as mask */
  pags_image seen;          /* 255: the lens sees the pixel; data NULL: it sees all */
  int *stack;
} search;

static void search_destroy(search *s) {
  free(s->sum);
  free(s->square);
  free(s->still);
  free(s->scratch);
  free(s->stack);
  pags_image_destroy(&s->seen);
}

/* Chooses training views of camera `number` in order of time: the first one, then each view that is at least `reach`
 * metres of driven path after the last chosen one; at most `most`. Returns their number. */
static int choose_spaced(const search *s, int number, double reach, int most, int64_t *out) {
  int count = 0;
  double since = 0;
  int64_t before = -1;
  for (int64_t i = 0; i < s->dataset->count && count < most; i++) {
    const pags_view *view = &s->dataset->views[i];
    if (view->sensor != number || view->test)
      continue;
    since += before >= 0 ? pags_view_distance(s->dataset, before, i) : 0;
    before = i;
    if (count > 0 && since < reach)
      continue;
    out[count++] = i;
    since = 0;
  }
  return count;
}

/* Length of the path of camera `number` over its training views, metres. */
static double way_driven(const search *s, int number) {
  double sum = 0;
  int64_t before = -1;
  for (int64_t i = 0; i < s->dataset->count; i++) {
    if (s->dataset->views[i].sensor != number || s->dataset->views[i].test)
      continue;
    sum += before >= 0 ? pags_view_distance(s->dataset, before, i) : 0;
    before = i;
  }
  return sum;
}

static pags_result add_photograph(search *s, int64_t view) {
  PAGS_AUTO(pags_image_destroy) pags_image full = {0};
  PAGS_AUTO(pags_image_destroy) pags_image small = {0};
  PAGS_TRY(pags_image_load_display(s->dataset->views[view].image_path, 3, &full));
  PAGS_TRY(pags_image_create(&small, s->width, s->height, 3, PAGS_U8));
  PAGS_TRY(pags_shrink_mean(&full, s->step, s->step, &small));
  const uint8_t *p = small.data;
  for (int i = 0; i < s->width * s->height; i++, p += 3) {
    float level = (float)(p[0] + 2 * p[1] + p[2]) / 4;
    s->sum[i] += level;
    s->square[i] += level * level;
  }
  return PAGS_OK;
}

/* ---- Finding still pixels ---- */

/* Writes the minimum (`smallest`) or maximum of each 3x3 neighbourhood (erosion or dilation) to `out`. */
static void spread(const search *s, const uint8_t *from, bool smallest, uint8_t *out) {
  for (int y = 0; y < s->height; y++)
    for (int x = 0; x < s->width; x++) {
      uint8_t best = from[y * s->width + x];
      for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < s->height; j++)
        for (int i = x > 0 ? x - 1 : 0; i <= x + 1 && i < s->width; i++) {
          uint8_t value = from[j * s->width + i];
          best = (smallest ? value < best : value > best) ? value : best;
        }
      out[y * s->width + x] = best;
    }
}

static bool sees(const search *s, int at) {
  return !s->seen.data || ((const uint8_t *)s->seen.data)[at] != 0;
}

/* Flood fill: marks the connected component of still pixels around `seed` with 2. Returns its number of pixels;
 * *lowest is the number of them at the lower edge. */
static int flood(search *s, int seed, int *lowest) {
  int depth = 0, size = 0;
  *lowest = 0;
  s->stack[depth++] = seed;
  s->still[seed] = 2;
  while (depth > 0) {
    int at = s->stack[--depth], x = at % s->width, y = at / s->width;
    const int next[4] = {x > 0 ? at - 1 : at, x + 1 < s->width ? at + 1 : at, y > 0 ? at - s->width : at,
                         y + 1 < s->height ? at + s->width : at};
    size++;
    *lowest += y + 1 == s->height || !sees(s, at + s->width); /* nothing is seen below the pixel */
    for (int i = 0; i < 4; i++)
      if (s->still[next[i]] == 1) {
        s->still[next[i]] = 2;
        s->stack[depth++] = next[i];
      }
  }
  return size;
}

/* Marks the components that are large enough and touch the lower edge with 3 and clears other components that touch
 * it. Returns the number of pixels marked. */
static int propose(search *s) {
  int total = 0;
  for (int x = 0; x < s->width; x++) {
    int lowest, seed = (s->height - 1) * s->width + x;
    while (seed >= s->width && !sees(s, seed))
      seed -= s->width;
    if (s->still[seed] != 1)
      continue;
    int size = flood(s, seed, &lowest);
    const bool large = 100 * size >= s->width * s->height && 20 * lowest >= s->width;
    for (int i = 0; i < s->width * s->height; i++)
      if (s->still[i] == 2)
        s->still[i] = large ? 3 : 0;
    total += large ? size : 0;
  }
  return total;
}

/* Searches with `count` of the chosen photographs; *proposed is the number of mask pixels found. */
static pags_result look_at(search *s, int count, int *proposed) {
  for (int i = 0; i < s->width * s->height; i++)
    s->sum[i] = s->square[i] = 0;
  for (int i = 0; i < count; i++) /* evenly spread over the chosen photographs */
    PAGS_TRY(add_photograph(s, s->views[count == 1 ? 0 : i * (s->count - 1) / (count - 1)]));

  /* A pixel is still if the variance of its brightness is small; then a morphological opening. */
  for (int i = 0; i < s->width * s->height; i++) {
    float mean = s->sum[i] / (float)count, variance = s->square[i] / (float)count - mean * mean;
    s->still[i] = (double)variance < still_deviation * still_deviation && sees(s, i);
  }
  spread(s, s->still, true, s->scratch);
  spread(s, s->scratch, false, s->still);

  *proposed = propose(s);
  return PAGS_OK;
}

/* ---- Searching the cameras ---- */

static pags_result search_camera(search *s, pags_sensor *sensor) {
  pags_driving *driving = s->dataset->parsed.driving;
  const pags_lens *lens = &s->dataset->parsed.views[s->views[0]].lens;
  int proposed;
  PAGS_TRY(look_at(s, FEW, &proposed));
  if (proposed > 0)
    PAGS_TRY(look_at(s, s->count, &proposed));
  if (proposed == 0)
    return PAGS_OK;

  /* Scale the mask to full size, dilated by one pixel of the search: along the outline of the car, pixels are a
   * mixture of the car and of what lies behind it. */
  for (int i = 0; i < s->width * s->height; i++)
    s->scratch[i] = s->still[i] == 3;
  spread(s, s->scratch, false, s->still);
  PAGS_TRY(pags_image_create(&sensor->ego, lens->width, lens->height, 1, PAGS_U8));
  uint8_t *to = sensor->ego.data;
  for (int y = 0; y < lens->height; y++)
    for (int x = 0; x < lens->width; x++) {
      int i = (int)fmin(x / s->step, s->width - 1), j = (int)fmin(y / s->step, s->height - 1);
      *to++ = s->still[j * s->width + i] ? 255 : 0;
    }

  return pags_driving_note(driving,
                           "ego mask: camera %d sees what never changes in %.1f %% of its pixels, at the lower edge: "
                           "left out (give --ego-mask to overrule)",
                           sensor->number, 100.0 * proposed / (s->width * s->height));
}

static pags_result begin_search(search *s) {
  const pags_lens *lens = &s->dataset->parsed.views[s->views[0]].lens;
  s->step = fmax(1, (double)lens->width / SMALL_WIDTH);
  s->width = (int)fmax(1, floor(lens->width / s->step + 1e-9));
  s->height = (int)fmax(1, floor(lens->height / s->step + 1e-9));
  size_t pixels = (size_t)s->width * (size_t)s->height;
  s->sum = malloc(pixels * sizeof *s->sum);
  s->square = malloc(pixels * sizeof *s->square);
  s->still = malloc(pixels);
  s->scratch = malloc(pixels);
  s->stack = malloc(pixels * sizeof *s->stack);
  PAGS_CHECK_MEMORY(s->sum && s->square && s->still && s->scratch && s->stack, "%s", s->dataset->path);
  pags_camera small = pags_camera_downscale(&s->dataset->cameras[s->views[0]], s->step);
  small.width = s->width;
  small.height = s->height;
  return pags_view_camera_mask(&small, &s->seen);
}

static pags_result search_all(pags_dataset *dataset) {
  pags_driving *driving = dataset->parsed.driving;
  int slow = 0, tilted = 0, first_tilted = 0; /* cameras that move too little, and that don't stand upright */
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    pags_sensor *sensor = &driving->sensors[i];
    PAGS_AUTO(search_destroy) search s = {.dataset = dataset};
    double reach = fmax(spacing, way_driven(&s, sensor->number) / MANY);
    s.count = choose_spaced(&s, sensor->number, reach, MANY, s.views);
    /* Upright, give or take 45 degrees: the second column is the picture's downward direction, and z is up. */
    if (s.count > 0 && !(dataset->views[s.views[0]].camera.world_from_camera[9] < -0.7)) {
      first_tilted = tilted++ ? first_tilted : sensor->number;
      continue;
    }
    if (s.count < MANY / 2) {
      slow++;
      continue;
    }
    PAGS_TRY(begin_search(&s));
    PAGS_TRY(search_camera(&s, sensor));
  }
  if (tilted > 0)
    PAGS_TRY(pags_driving_note(
        driving, "ego mask: %d of %lld cameras don't stand upright and aren't searched, the first is camera %d", tilted,
        (long long)driving->sensor_count, first_tilted));
  if (slow > 0)
    return pags_driving_note(driving, "ego mask: none given, and the car moves too little to look for one");
  for (int64_t i = 0; i < driving->sensor_count; i++)
    if (driving->sensors[i].ego.data)
      return PAGS_OK;
  return pags_driving_note(driving, "ego mask: none given, none found");
}

pags_result pags_ego_masks_make(pags_dataset *dataset, const pags_dataset_options *options) {
  if (options->ego_mask)
    return take_given(dataset, options->ego_mask);
  PAGS_AUTOFREE char *folder = pags_path_join(dataset->parsed.driving->root, "ego_masks");
  PAGS_CHECK_MEMORY(folder, "%s", dataset->path);
  return pags_dir_exists(folder) ? take_given(dataset, folder) : search_all(dataset);
}
