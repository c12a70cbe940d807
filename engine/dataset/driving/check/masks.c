/* SPDX-License-Identifier: Apache-2.0 */
/* Looks at a mask of each kind and at a label image, when a driving set is opened, and warns of what no mask of its
 * kind looks like: 0 and 1 in place of black and white, sky below, greys, ids that the label set doesn't have.
 *
 * One picture of each kind is decoded, that of the middle of the set, from the top as far as is needed; only where it
 * is empty or looks wrong, up to seven more are, spread over the set. */
#include "dataset/driving/masks.h"
#include "dataset/driving/check/checks.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_LOOKS = 8 };

/* What a mask looks like: counts of pixels. */
typedef struct mask_look {
  int64_t pixels, white, grey;   /* grey: neither near black nor near white */
  int64_t quarter, above, below; /* pixels of a quarter of the height; the white ones of the upper and lower quarter */
  int most;                      /* the largest value */
} mask_look;

/* ---- Choosing files ---- */

typedef struct files {
  const pags_parsed_dataset *parsed;
  size_t member; /* offset in pags_parsed_view of the path */
  int64_t count; /* of views that have such a file */
} files;

static const char *path_of(const files *f, int64_t view) {
  return *(char *const *)((const char *)&f->parsed->views[view] + f->member);
}

static files list_files(const pags_parsed_dataset *parsed, size_t member) {
  files f = {parsed, member, 0};
  for (int64_t i = 0; i < parsed->count; i++)
    f.count += path_of(&f, i) != NULL;
  return f;
}

/* Returns the view with the `look`-th file to be looked at: 0 is in the middle, 1 to 7 are spread over the set. */
static const pags_parsed_view *choose(const files *f, int look) {
  int64_t wanted = look == 0 ? f->count / 2 : (f->count - 1) * (look - 1) / (MOST_LOOKS - 2);
  for (int64_t i = 0; i < f->parsed->count; i++)
    if (path_of(f, i) && wanted-- == 0)
      return &f->parsed->views[i];
  return NULL;
}

/* ---- Masks ---- */

/* Looks at the first `rows` rows, or all if that is 0. */
static pags_result look_at_rows(const char *path, const pags_lens *lens, int rows, mask_look *out) {
  PAGS_AUTO(pags_image_destroy) pags_image mask = {0};
  int64_t counts[256] = {0};
  *out = (mask_look){0};
  PAGS_TRY(pags_driving_load_mask_top(path, lens, rows, &mask));
  const int white = pags_driving_white(&mask), quarter = (mask.height + 3) / 4;
  const uint8_t *row = mask.data;
  for (int y = 0; y < mask.height; y++, row += mask.width) {
    int64_t whites = 0;
    for (int x = 0; x < mask.width; x++)
      whites += row[x] >= white;
    out->white += whites;
    out->above += y < quarter ? whites : 0;
    out->below += y >= mask.height - quarter ? whites : 0;
  }
  const uint8_t *data = mask.data;
  const size_t size = (size_t)mask.width * (size_t)mask.height;
  for (size_t i = 0; i < size; i += 7)
    counts[data[i]]++;
  for (int v = 0; v < 256; v++) {
    out->pixels += counts[v];
    out->grey += v > 16 && v < 239 ? counts[v] : 0;
    out->most = counts[v] ? v : out->most;
  }
  out->most = white == 1 ? 1 : out->most;
  out->quarter = (int64_t)quarter * mask.width;
  return PAGS_OK;
}

static bool is_grey(const mask_look *look) {
  return 5 * look->grey > look->pixels;
}

static pags_result check_kind(const pags_driving *driving, const char *folder, const files *f, bool sky) {
  mask_look look = {0};
  const char *path = NULL;
  int looks = f->count < MOST_LOOKS ? (int)f->count : MOST_LOOKS, inverted = 0, looked = 0;
  for (int i = 0; i < looks; i++) {
    const pags_parsed_view *view = choose(f, i);
    mask_look other;
    const char *at = path_of(f, view - f->parsed->views);
    /* Look at the upper rows, and at all of them unless these show that the mask is as it should be: sky that gets less
     * downwards, or little that moves. */
    PAGS_TRY(look_at_rows(at, &view->lens, view->lens.height / (sky ? 4 : 2), &other));
    const bool upright = sky ? other.above > other.below : 2 * other.white <= 4 * other.quarter;
    if (other.most < 128 || !upright || is_grey(&other))
      PAGS_TRY(look_at_rows(at, &view->lens, 0, &other));
    looked++;
    /* White lies where it can't be: the sky below, or most of the picture moving. */
    inverted +=
        sky ? 2 * other.below > other.quarter && other.below >= other.above : 2 * other.white > 4 * other.quarter;
    if (!path || (look.white == 0 && look.most == 0)) {
      look = other;
      path = at;
    }
    if (!inverted && look.most > 0)
      break;
  }
  if (!path)
    return PAGS_OK;
  const char *root = driving->root, *name = pags_path_name(path);
  if (look.most == 1)
    PAGS_WARN("%s/%s: masks of 0 and 1, as %s is, in place of 0 and 255: 1 is taken as white (%lld masks)", root,
              folder, name, (long long)f->count);
  else if (look.most > 0 && look.white == 0)
    PAGS_WARN(
        "%s/%s: no pixel of %s is white (128 or above), though values go up to %d; expected 0 and 255 (%lld masks)",
        root, folder, name, look.most, (long long)f->count);
  else if (is_grey(&look))
    PAGS_WARN("%s/%s: %.0f %% of the pixels of %s are grey: it may be no mask; expected 0 and 255 (%lld masks)", root,
              folder, 100.0 * (double)look.grey / (double)look.pixels, name, (long long)f->count);
  if (4 * inverted >= 3 * looked && inverted > 0)
    PAGS_WARN("%s/%s: masks look inverted: %s in %d of %d looked at, %s among them; expected white for %s", root,
              folder, sky ? "the lower quarter is white" : "more than half is white", inverted, looked, name,
              sky ? "the sky" : "what moves");
  return PAGS_OK;
}

/* ---- Label images ---- */

/* Returns how many of the counted pixels have an id that the set doesn't have; 255 is unknown in every set. */
static int64_t count_unknown(const pags_label_set *set, const int64_t counts[256]) {
  int64_t unknown = 0;
  for (int id = 1; id < 255; id++)
    unknown += pags_label_set_has(set, id) ? 0 : counts[id];
  return unknown;
}

/* Loads up to MOST_LOOKS label images that have colours by their headers: they are refused unless these are greys. */
static pags_result check_colours(const files *f) {
  int looks = 0;
  for (int64_t i = 0; i < f->parsed->count && looks < MOST_LOOKS; i++) {
    const pags_parsed_view *view = &f->parsed->views[i];
    PAGS_AUTO(pags_image_destroy) pags_image labels = {0};
    if (!view->semantic_path || !pags_driving_has_colours(view->semantic_path))
      continue;
    looks++;
    PAGS_TRY(pags_driving_load_labels(view->semantic_path, &view->lens, &labels));
  }
  return PAGS_OK;
}

static pags_result check_labels(const pags_driving *driving, const files *f) {
  const pags_label_set *set = driving->rules.labels, *other = NULL;
  if (f->count == 0)
    return PAGS_OK;
  PAGS_TRY(check_colours(f));
  const pags_parsed_view *view = choose(f, 0);
  PAGS_AUTO(pags_image_destroy) pags_image labels = {0};
  int64_t counts[256] = {0}, looked = 0;
  PAGS_TRY(pags_driving_load_labels(view->semantic_path, &view->lens, &labels));
  const size_t size = (size_t)labels.width * (size_t)labels.height;
  for (size_t i = 0; i < size; i += 3, looked++)
    counts[((const uint8_t *)labels.data)[i]]++;
  const int64_t unknown = count_unknown(set, counts);
  if (100 * unknown <= looked)
    return PAGS_OK;
  int most = 254;
  while (counts[most] == 0)
    most--;
  for (int i = 0; i < PAGS_LABEL_SETS && !other; i++)
    other = 100 * count_unknown(&pags_label_sets[i], counts) <= looked ? &pags_label_sets[i] : NULL;
  PAGS_WARN(
      "%s/semantic: %.0f %% of the pixels of %s have ids (up to %d) that %s labels don't have; expected 'labels' of "
      "dataset.json to name them%s%s (%lld label images)",
      driving->root, 100.0 * (double)unknown / (double)looked, pags_path_name(view->semantic_path), most, set->name,
      other ? ", such as " : "", other ? other->name : "", (long long)f->count);
  return PAGS_OK;
}

pags_result pags_masks_check(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  const files sky = list_files(parsed, offsetof(pags_parsed_view, sky_path));
  const files dynamic = list_files(parsed, offsetof(pags_parsed_view, dynamic_path));
  const files labels = list_files(parsed, offsetof(pags_parsed_view, semantic_path));
  PAGS_TRY(check_kind(driving, driving->sky_folder, &sky, true));
  PAGS_TRY(check_kind(driving, driving->dynamic_folder, &dynamic, false));
  return check_labels(driving, &labels);
}
