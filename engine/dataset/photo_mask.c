/* SPDX-License-Identifier: Apache-2.0 */
/* Masks of photographs (photo_mask.h). A mask has one meaning whatever its file is: 128 of 255 and above uses the
 * pixel. Files with only 0 and 1 are recognised by their largest value. */
#include "dataset/photo_mask.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "dataset/find_file.h"
#include "dataset/pictures.h"

/* ---- Reading one ---- */

/* The sample at index `at`, at the file's depth. */
static unsigned sample_of(const pags_image *image, size_t at) {
  return image->sample == PAGS_U16 ? ((const uint16_t *)image->data)[at] : ((const uint8_t *)image->data)[at];
}

/* The largest and smallest value of channel `c`. */
static void find_range(const pags_image *image, int c, unsigned *least, unsigned *most) {
  const size_t pixels = (size_t)image->width * (size_t)image->height, step = (size_t)image->channels;
  *least = UINT16_MAX;
  *most = 0;
  for (size_t i = 0, at = (size_t)c; i < pixels; i++, at += step) {
    const unsigned v = sample_of(image, at);
    *least = v < *least ? v : *least;
    *most = v > *most ? v : *most;
  }
}

pags_result pags_photo_mask_load(const char *path, pags_image *mask, pags_mask_facts *facts) {
  pags_image_facts file;
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  pags_mask_facts found = {PAGS_MASK_BYTES, false, false};
  unsigned least, most;
  *mask = (pags_image){0};
  PAGS_TRY(pags_image_inspect(path, &file));
  PAGS_TRY(pags_image_load(path, file.sample == PAGS_U8 ? PAGS_U8 : PAGS_U16, file.alpha ? 4 : 1, &image));
  const unsigned full = image.sample == PAGS_U8 ? 255 : UINT16_MAX, half = full / 2 + 1;
  int channel = 0;
  if (file.alpha) {
    find_range(&image, 3, &least, &most);
    found.alpha = least < full;
    channel = found.alpha ? 3 : 0;
  }
  find_range(&image, channel, &least, &most);
  unsigned least_used = half;
  if (most == 1) {
    found.values = PAGS_MASK_ONES;
    least_used = 1;
  } else if (full != 255 && most > 1 && most <= 255) {
    found.values = PAGS_MASK_NARROW;
    least_used = 128;
  }
  found.blank = most < least_used;
  if (facts)
    *facts = found;
  PAGS_TRY(pags_image_create(mask, image.width, image.height, 1, PAGS_U8));
  uint8_t *to = mask->data;
  for (size_t i = 0; i < (size_t)image.width * (size_t)image.height; i++)
    to[i] = sample_of(&image, i * (size_t)image.channels + (size_t)channel) >= least_used ? 255 : 0;
  return PAGS_OK;
}

pags_result pags_photo_mask_fit(const char *path, int width, int height, int turn, pags_image *mask) {
  const bool exchanged = turn >= 5; /* the mask may be as the photograph is stored, then it's turned with it */
  if (exchanged && pags_size_fits(mask->width, mask->height, width, height) == PAGS_FIT_NONE)
    PAGS_TRY(pags_image_turn(mask, turn));
  const pags_size_fit fit = pags_size_fits(mask->width, mask->height, width, height);
  if (fit == PAGS_FIT_NONE)
    return pags_fail(
        PAGS_ERROR_FORMAT,
        "%s: a mask of %d x %d pixels for a photograph of %d x %d; expected the same size, or the same ratio of sides",
        path, mask->width, mask->height, width, height);
  if (fit == PAGS_FIT_EXACT)
    return PAGS_OK;
  pags_image out;
  PAGS_TRY(pags_image_create(&out, width, height, 1, PAGS_U8));
  const uint8_t *from = mask->data;
  uint8_t *to = out.data;
  for (int y = 0; y < height; y++) {
    const size_t row = (size_t)((2 * (int64_t)y + 1) * mask->height / (2 * (int64_t)height));
    for (int x = 0; x < width; x++)
      *to++ = from[row * (size_t)mask->width + (size_t)((2 * (int64_t)x + 1) * mask->width / (2 * (int64_t)width))];
  }
  pags_image_destroy(mask);
  *mask = out;
  return PAGS_OK;
}

/* ---- Finding those next to the images ---- */

/* The place in a path at which its folder of images begins (images, images_4, input); the last, if it has several.
 * NULL: it has none. */
static const char *find_images(const char *path) {
  const char *found = NULL;
  for (const char *at = path, *slash; (slash = strchr(at, '/')); at = slash + 1)
    if (pags_text_starts(at, "input/") || pags_text_starts(at, "images/") || pags_text_starts(at, "images_"))
      found = at;
  return found;
}

/* Looks for the mask of the picture `name` in `folder`: the name with another extension or with one more. *out NULL:
 * none exists. */
static pags_result find_mask(const char *folder, const char *name, char **out) {
  static const char *const extensions[] = {".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"};
  const int whole = (int)strlen(name), stem = whole - (int)strlen(pags_path_extension(name));
  *out = NULL;
  for (size_t i = 0; i < 2 * sizeof extensions / sizeof *extensions && !*out; i++)
    PAGS_TRY(pags_find_extension(folder, name, i % 2 ? stem : whole, extensions[i / 2], out));
  return PAGS_OK;
}

/* Reports which files of the folder are the mask of no photograph. Only the folder itself is looked at. */
static pags_result say_unused(const char *folder, const pags_parsed_dataset *parsed) {
  long long unused = 0, shared = 0;
  const char *first = NULL, *first_shared = NULL;
  PAGS_AUTOFREE const char **used = malloc((size_t)parsed->count * sizeof *used);
  PAGS_CHECK_MEMORY(used, "%s", folder);
  for (int64_t i = 0; i < parsed->count; i++)
    used[i] = parsed->views[i].mask_path ? parsed->views[i].mask_path + strlen(folder) + 1 : "";
  pags_sort(used, parsed->count, sizeof *used, pags_text_compare);
  for (int64_t i = 1; i < parsed->count; i++)
    if (*used[i] && strcmp(used[i], used[i - 1]) == 0) {
      first_shared = first_shared ? first_shared : used[i];
      shared++;
    }
  if (shared)
    PAGS_WARN(
        "%s: %lld photographs share the mask of another whose name differs in the extension alone, the first is %s; a "
        "mask for each is NAME.jpg.png and NAME.png.png",
        folder, shared, first_shared);
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(folder, &list));
  for (int64_t i = 0; i < list.count; i++) {
    const char *name = list.names[i];
    if (name[0] == '.' || !pags_folder_has(folder, name) ||
        bsearch(&name, used, (size_t)parsed->count, sizeof *used, pags_text_compare))
      continue;
    first = first ? first : name;
    unused++;
  }
  if (unused)
    PAGS_WARN("%s: %lld of %lld files are masks of no photograph, the first is %s", folder, unused,
              (long long)list.count, first);
  return PAGS_OK;
}

/* Gives every view its mask in `folder`, if it has one there under its path below the folder of images, or below the
 * data set's folder. */
static pags_result find_all(const char *root, const char *folder, pags_parsed_dataset *parsed) {
  long long without = 0;
  const char *first = NULL;
  for (int64_t i = 0; i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i];
    const char *images = find_images(view->image_path), *name = pags_path_below(root, view->image_path);
    const char *slash = strchr(images ? images : name, '/');
    if (slash)
      PAGS_TRY(find_mask(folder, slash + 1, &view->mask_path));
    if (!view->mask_path)
      PAGS_TRY(find_mask(folder, name, &view->mask_path));
    first = view->mask_path || view->missing || first ? first : view->name;
    without += !view->mask_path && !view->missing;
  }
  if (without == parsed->count)
    PAGS_WARN("%s: no file there is the mask of a photograph; expected %s%s", folder,
              pags_path_name(parsed->views[0].image_path), ".png and the like");
  else if (without)
    PAGS_WARN("%s: %lld of %lld photographs have no mask there, and all of their pixels are used, the first is %s",
              folder, without, (long long)parsed->count, first);
  return without == parsed->count ? PAGS_OK : say_unused(folder, parsed);
}

pags_result pags_photo_masks_find(const char *root, pags_parsed_dataset *parsed) {
  for (int64_t i = 0; i < parsed->count; i++)
    if (parsed->views[i].mask_path)
      return PAGS_OK;
  /* Next to the folder of images; for images_4, masks_4 comes first. */
  const char *path = parsed->views[0].image_path, *images = find_images(path);
  PAGS_AUTOFREE char *base = !images         ? pags_text_copy(root)
                             : images > path ? pags_text_format("%.*s", (int)(images - path), path)
                                             : pags_text_copy(".");
  PAGS_CHECK_MEMORY(base, "%s", root);
  const int suffix = images && pags_text_starts(images, "images_") ? (int)strcspn(images, "/") - 6 : 0;
  for (int i = suffix ? 0 : 1; i < 3; i++) {
    PAGS_AUTOFREE char *folder =
        pags_text_format("%s/mask%s%.*s", base, i < 2 ? "s" : "", i == 0 ? suffix : 0, images ? images + 6 : "");
    PAGS_CHECK_MEMORY(folder, "%s", root);
    if (pags_dir_exists(folder))
      return find_all(root, folder, parsed);
  }
  return PAGS_OK;
}

/* ---- Checking all ---- */

/* A mask to look at, and how few bytes its file has for its pixels: those of one value have the fewest. */
typedef struct candidate {
  int64_t view;
  double pixels, bytes_per_pixel;
} candidate;

static int by_density(const void *a, const void *b) {
  const candidate *left = a, *right = b;
  if (left->bytes_per_pixel != right->bytes_per_pixel)
    return left->bytes_per_pixel < right->bytes_per_pixel ? -1 : 1;
  return left->view < right->view ? -1 : left->view > right->view;
}

/* What the masks looked at had. */
typedef struct findings {
  long long looked_at, ones, narrow, blank;
  const char *first_ones, *first_narrow, *first_blank;
} findings;

static pags_result look_at(const pags_parsed_view *view, findings *found) {
  PAGS_AUTO(pags_image_destroy) pags_image mask = {0};
  pags_mask_facts facts;
  PAGS_TRY(pags_photo_mask_load(view->mask_path, &mask, &facts));
  found->looked_at++;
  if (facts.values == PAGS_MASK_ONES && !found->ones++)
    found->first_ones = view->mask_path;
  if (facts.values == PAGS_MASK_NARROW && !found->narrow++)
    found->first_narrow = view->mask_path;
  if (facts.blank && !found->blank++)
    found->first_blank = view->name;
  return PAGS_OK;
}

/* Reads the headers of all masks and lists them in the order in which they are worth a look. */
static pags_result list_masks(const pags_parsed_dataset *parsed, candidate *list, int64_t *count) {
  *count = 0;
  for (int64_t i = 0; i < parsed->count; i++) {
    const pags_parsed_view *view = &parsed->views[i];
    pags_image_facts facts;
    uint64_t bytes;
    if (!view->mask_path || view->missing)
      continue;
    PAGS_TRY(pags_image_inspect(view->mask_path, &facts));
    PAGS_TRY(pags_file_size(view->mask_path, &bytes));
    const int width = view->lens.width, height = view->lens.height;
    if (pags_size_fits(facts.width, facts.height, width, height) == PAGS_FIT_NONE &&
        (view->turn < 5 || pags_size_fits(facts.height, facts.width, width, height) == PAGS_FIT_NONE))
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s: a mask of %d x %d pixels for the photograph %s of %d x %d; expected the same size, or the "
                       "same ratio of sides",
                       view->mask_path, facts.width, facts.height, view->name, width, height);
    const double pixels = (double)facts.width * facts.height;
    list[(*count)++] = (candidate){i, pixels, (double)bytes / pixels};
  }
  pags_sort(list, *count, sizeof *list, by_density);
  return PAGS_OK;
}

pags_result pags_photo_masks_check(pags_parsed_dataset *parsed) {
  const double most_pixels = 4e6; /* looked at: some 30 ms */
  PAGS_AUTOFREE candidate *list = malloc((size_t)parsed->count * sizeof *list);
  PAGS_CHECK_MEMORY(list, "%s", parsed->source);
  int64_t count;
  findings found = {0};
  PAGS_TRY(list_masks(parsed, list, &count));
  double pixels = 0;
  for (int64_t i = 0; i < count; i++) {
    pixels += list[i].pixels;
    if (i == 0 || pixels <= most_pixels || found.blank == found.looked_at)
      PAGS_TRY(look_at(&parsed->views[list[i].view], &found));
  }
  if (found.ones)
    PAGS_WARN(
        "%s: %lld of the %lld masks looked at have no value over 1: 1 is taken for 255, use the pixel; the first is %s",
        parsed->source, found.ones, found.looked_at, found.first_ones);
  if (found.narrow)
    PAGS_WARN(
        "%s: %lld of the %lld masks looked at have 16 bits but no value over 255, and are taken for bytes; the first "
        "is %s",
        parsed->source, found.narrow, found.looked_at, found.first_narrow);
  if (found.blank && found.blank == parsed->count) {
    PAGS_WARN(
        "%s: the masks leave no pixel of any of the %lld photographs, and are ignored; expected 128 or more of 255 "
        "where a pixel is used",
        parsed->source, (long long)count);
    for (int64_t i = 0; i < parsed->count; i++)
      free(pags_take(&parsed->views[i].mask_path));
  } else if (found.blank) {
    PAGS_WARN(
        "%s: %lld of the %lld masks looked at leave no pixel of their photograph, which then teaches nothing; the "
        "first photograph is %s",
        parsed->source, found.blank, found.looked_at, found.first_blank);
  }
  return PAGS_OK;
}
