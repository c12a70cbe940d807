/* SPDX-License-Identifier: Apache-2.0 */
/* Finds, names and checks the files of a data set's photographs (pictures.h). Pictures smaller than their cameras, as
 * images_4 of Mip-NeRF 360 or the photographs of Tanks and Temples in the release of Kerbl et al. (2023), are taken
 * with scaled intrinsics. */
#include "dataset/pictures.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "dataset/find_file.h"
#include "image/colour.h"

/* ---- Folders ---- */

const char *pags_path_below(const char *root, const char *path) {
  size_t length = strlen(root);
  while (length > 1 && root[length - 1] == '/')
    length--;
  const bool here = length == 1 && root[0] == '.';
  if (here && strncmp(path, "./", 2) != 0)
    return path;
  if (!here && (strncmp(path, root, length) != 0 || path[length] != '/'))
    return path;
  path += length;
  return path + strspn(path, "/");
}

/* Looks in `folder` for the picture that the set calls `name`, below as many of its folders as there are, with its
 * extension or another. *out NULL: not found. */
static pags_result find_in(const char *folder, const char *name, char **out) {
  static const char *const extensions[] = {"",     ".png",  ".jpg", ".jpeg", ".JPG",
                                           ".PNG", ".JPEG", ".exr", ".webp", ".tif"};
  *out = NULL;
  for (const char *tail = name; tail && !*out; tail = strchr(tail, '/') ? strchr(tail, '/') + 1 : NULL) {
    const int whole = (int)strlen(tail), stem = whole - (int)strlen(pags_path_extension(tail));
    for (size_t i = 0; i < sizeof extensions / sizeof *extensions && !*out; i++)
      PAGS_TRY(pags_find_extension(folder, tail, i ? stem : whole, extensions[i], out));
  }
  return PAGS_OK;
}

/* Points every view to its picture in `folder`. A view without one there becomes missing. */
static pags_result move_views(const char *root, const char *folder, pags_parsed_dataset *parsed) {
  for (int64_t i = 0; i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i];
    const char *name = pags_path_below(root, view->image_path);
    char *found;
    PAGS_TRY(find_in(folder, name, &found));
    view->missing = !found;
    if (!found)
      found = pags_path_join(folder, pags_path_name(name));
    PAGS_CHECK_MEMORY(found, "%s", folder);
    free(view->image_path);
    view->image_path = found;
    view->picture = (pags_image_facts){0};
    view->sized = false;
    if (view->lens.width == 0 && !view->missing)
      return pags_fail_at(view->where, "its picture is %s, for which no camera size is known; expected 'w' and 'h'",
                          view->image_path);
  }
  return PAGS_OK;
}

/* Finds the folder of other usual names that has the most of the pictures. */
static pags_result find_usual(const char *root, pags_parsed_dataset *parsed) {
  static const char *const usual[] = {"images", "input", "images_2", "images_4", "images_8"};
  int64_t most = 0;
  PAGS_AUTOFREE char *best = NULL;
  for (size_t i = 0; i < sizeof usual / sizeof *usual; i++) {
    PAGS_AUTOFREE char *folder = pags_path_join(root, usual[i]);
    PAGS_CHECK_MEMORY(folder, "%s", root);
    int64_t count = 0;
    for (int64_t k = 0; k < parsed->count && pags_dir_exists(folder); k++) {
      PAGS_AUTOFREE char *found = NULL;
      PAGS_TRY(find_in(folder, pags_path_below(root, parsed->views[k].image_path), &found));
      count += found != NULL;
    }
    if (count > most) {
      most = count;
      free(best);
      best = pags_take(&folder);
    }
  }
  if (!best)
    return PAGS_OK;
  PAGS_WARN("%s: no picture is where it says; %lld of %lld are in %s, which is taken (--image-folder %s)",
            parsed->source, (long long)most, (long long)parsed->count, best, pags_path_name(best));
  return move_views(root, best, parsed);
}

pags_result pags_pictures_relocate(const char *root, const char *image_folder, pags_parsed_dataset *parsed) {
  if (parsed->count == 0)
    return PAGS_OK;
  if (image_folder && parsed->driving)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "%s: --image-folder isn't supported for driving sets; their photographs are in images",
                     parsed->source);
  if (image_folder)
    return move_views(root, image_folder, parsed);
  for (int64_t i = 0; i < parsed->count; i++)
    if (!parsed->views[i].missing)
      return PAGS_OK;
  return parsed->driving ? PAGS_OK : find_usual(root, parsed);
}

/* ---- Names ---- */

static int by_file(const void *a, const void *b) {
  const pags_parsed_view *left = a, *right = b;
  const int order = strcmp(pags_path_name(left->image_path), pags_path_name(right->image_path));
  return order ? order : strcmp(left->image_path, right->image_path);
}

static int by_path(const void *a, const void *b) {
  return strcmp(((const pags_parsed_view *)a)->image_path, ((const pags_parsed_view *)b)->image_path);
}

/* The length of the folders, with their last slash, that all paths have in common. */
static size_t common_folders(const pags_parsed_dataset *parsed) {
  const char *first = parsed->views[0].image_path;
  size_t length = strlen(first) - strlen(pags_path_name(first));
  for (int64_t i = 1; i < parsed->count; i++) {
    size_t same = 0;
    while (same < length && parsed->views[i].image_path[same] == first[same])
      same++;
    while (same > 0 && first[same - 1] != '/')
      same--;
    length = same;
  }
  return length;
}

pags_result pags_pictures_name(pags_parsed_dataset *parsed) {
  bool unique = true;
  if (!parsed->driving) /* the driving reader has sorted the views by frame, then by camera */
    pags_sort(parsed->views, parsed->count, sizeof *parsed->views, by_file);
  for (int64_t i = 0; i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i], *before = i ? view - 1 : NULL;
    view->name = pags_path_name(view->image_path);
    if (!before || parsed->driving)
      continue;
    if (strcmp(before->image_path, view->image_path) == 0)
      return pags_fail_at(view->where, "the image %s occurs twice (also at %s); expected each once", view->image_path,
                          before->where);
    unique = unique && strcmp(before->name, view->name) != 0;
  }
  if (unique)
    return PAGS_OK;
  const size_t folders = common_folders(parsed);
  pags_sort(parsed->views, parsed->count, sizeof *parsed->views, by_path);
  for (int64_t i = 0; i < parsed->count; i++)
    parsed->views[i].name = parsed->views[i].image_path + folders;
  return PAGS_OK;
}

/* ---- Sizes and orientations ---- */

/* Views of a kind: how many, and the first. */
typedef struct tally {
  long long count;
  const pags_parsed_view *first;
} tally;

static void add(tally *t, const pags_parsed_view *view) {
  if (!t->count++)
    t->first = view;
}

typedef struct findings {
  long long views;
  tally scaled, turned, as_stored, unclear, alpha, light, aside, stretched, oblong, larger, partial, layer, first_layer,
      space;
  int lens_width, lens_height; /* of the first that is scaled */
} findings;

/* How well a picture of this number of pixels fits its camera; one whose pixels aren't square may also fit it stretched
 * to square ones. `aspect` is a pixel's width over its height. */
static pags_size_fit fit_size(const pags_lens *lens, int width, int height, double aspect) {
  const pags_size_fit fit = pags_size_fits(width, height, lens->width, lens->height);
  if (fit != PAGS_FIT_NONE || aspect == 1)
    return fit;
  const int wider = (int)floor(width * aspect + 0.5), taller = (int)floor(height / aspect + 0.5);
  return pags_size_fits(wider, height, lens->width, lens->height) != PAGS_FIT_NONE ||
                 pags_size_fits(width, taller, lens->width, lens->height) != PAGS_FIT_NONE
             ? PAGS_FIT_SCALED
             : PAGS_FIT_NONE;
}

/* How well a picture fits its camera as it is stored and, if its orientation exchanges the sides, turned. */
static void compare(const pags_parsed_view *view, pags_size_fit *stored, pags_size_fit *turned) {
  const pags_image_facts *p = &view->picture;
  *stored = fit_size(&view->lens, p->width, p->height, p->pixel_aspect);
  *turned = p->orientation >= 5  ? fit_size(&view->lens, p->height, p->width, 1 / p->pixel_aspect)
            : p->orientation > 1 ? *stored
                                 : PAGS_FIT_NONE;
}

static pags_result refuse(const pags_parsed_view *view) {
  const pags_image_facts *p = &view->picture;
  char turn[128] = "";
  if (p->orientation > 1)
    snprintf(turn, sizeof turn, " (its EXIF orientation is %d, with which it has %d x %d)", p->orientation,
             p->orientation >= 5 ? p->height : p->width, p->orientation >= 5 ? p->width : p->height);
  return pags_fail_at(view->where,
                      "%s has %d x %d pixels%s, expected %d x %d as its camera says, or another size of the same "
                      "ratio; --image-folder takes the pictures from elsewhere",
                      view->image_path, p->width, p->height, turn, view->lens.width, view->lens.height);
}

/* Whether the sizes of some pictures show that the cameras are those of turned pictures (1) or of pictures as they are
 * stored (-1); 0: both or neither. */
static int find_habit(const pags_parsed_dataset *parsed) {
  bool turn = false, keep = false;
  for (int64_t i = 0; i < parsed->count; i++) {
    const pags_parsed_view *view = &parsed->views[i];
    pags_size_fit stored, turned;
    if (view->missing || view->picture.orientation < 5)
      continue;
    compare(view, &stored, &turned);
    turn = turn || (turned > stored && !view->sized);
    keep = keep || (stored > turned && !view->sized);
  }
  return turn == keep ? 0 : turn ? 1 : -1;
}

/* Chooses how the picture of a view is turned, and fits the camera to its size. */
static pags_result fit_camera(pags_parsed_view *view, int habit, findings *found) {
  pags_size_fit stored, turned;
  compare(view, &stored, &turned);
  if (stored == PAGS_FIT_NONE && turned == PAGS_FIT_NONE)
    return refuse(view);
  const int orientation = view->picture.orientation;
  const bool open = turned == stored || view->sized; /* the sizes don't tell */
  const bool turn = orientation > 1 && (open ? habit > 0 : turned > stored);
  view->turn = turn ? orientation : 1;
  if (turn)
    add(&found->turned, view);
  else if (orientation > 1 && open && habit == 0)
    add(&found->unclear, view);
  else if (orientation > 1)
    add(&found->as_stored, view);
  const bool exchanged = turn && orientation >= 5;
  const int width = exchanged ? view->picture.height : view->picture.width;
  const int height = exchanged ? view->picture.width : view->picture.height;
  pags_lens *lens = &view->lens;
  if (lens->width == width && lens->height == height)
    return PAGS_OK;
  const bool stretched = pags_size_fits(width, height, lens->width, lens->height) == PAGS_FIT_NONE;
  if (!stretched && !found->scaled.count) {
    found->lens_width = lens->width;
    found->lens_height = lens->height;
  }
  add(stretched ? &found->stretched : &found->scaled, view);
  const double x = (double)width / lens->width, y = (double)height / lens->height;
  lens->fx *= x;
  lens->cx *= x;
  lens->fy *= y;
  lens->cy *= y;
  lens->width = width;
  lens->height = height;
  return PAGS_OK;
}

static const char *layer_of(const pags_parsed_view *view) {
  return view->picture.layer[0] ? view->picture.layer : "what has no layer";
}

/* The first view of a kind; an empty view without one. */
static const pags_parsed_view *first_of(const tally *t) {
  static const pags_parsed_view none = {.name = ""};
  return t->count ? t->first : &none;
}

/* Logs "SOURCE: COUNT of ALL " and the text, if there is a view of this kind. */
PAGS_PRINTF(5, 6)
static void note(const pags_parsed_dataset *parsed, const findings *found, pags_log_level level, const tally *t,
                 const char *format, ...) {
  if (!t->count)
    return;
  char text[1024];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  pags_log_message(level, "%s: %lld of %lld %s", parsed->source, t->count, found->views, text);
}

static void report(const pags_parsed_dataset *parsed, const findings *found, bool asked, pags_image_alpha alpha) {
  static const char *const rest[] = {"the background colour", "left out of the loss", "black"};
  static const char *const rules[] = {"have an alpha channel and are laid over the background colour",
                                      "have an alpha channel, which is their mask",
                                      "have an alpha channel, which is ignored"};
  const pags_log_level warning = PAGS_LOG_WARNING, info = PAGS_LOG_INFO;
  const pags_parsed_view *first = first_of(&found->scaled);
  note(parsed, found, asked ? info : warning, &found->scaled,
       "photographs have another size than their cameras, whose intrinsics are scaled; the first is %s, %d x %d for a "
       "camera of %d x %d",
       first->name, first->picture.width, first->picture.height, found->lens_width, found->lens_height);
  first = first_of(&found->unclear);
  note(parsed, found, warning, &found->unclear,
       "photographs have an EXIF orientation that their size doesn't tell the meaning of, and are taken as they are "
       "stored; the first is %s (orientation %d). If the cameras are those of upright pictures, store them upright",
       first->name, first->picture.orientation);
  first = first_of(&found->aside);
  note(parsed, found, warning, &found->aside,
       "cameras have their principal point at the edge of the picture or outside, the first is that of %s, at "
       "%.0f,%.0f in %d x %d pixels: intrinsics of pictures of another size? 'w' and 'h' say of which",
       first->name, first->lens.cx, first->lens.cy, first->lens.width, first->lens.height);
  note(parsed, found, info, &found->turned,
       "photographs are turned by their EXIF orientation, as their cameras are; the first is %s",
       first_of(&found->turned)->name);
  note(parsed, found, info, &found->as_stored,
       "photographs are not turned by their EXIF orientation, as their cameras aren't; the first is %s",
       first_of(&found->as_stored)->name);
  note(parsed, found, warning, &found->partial,
       "photographs are EXR files whose data window covers only a part of their display window, the rest of which is "
       "%s (--image-alpha); the first is %s",
       rest[alpha], first_of(&found->partial)->name);
  first = first_of(&found->first_layer);
  note(parsed, found, warning, &found->first_layer,
       "photographs are EXR files in which several layers may be the picture; of %s, %s is used", first->name,
       layer_of(first));
  first = first_of(&found->oblong);
  note(parsed, found, warning, &found->oblong,
       "photographs have pixels that are not square, but cameras whose focal lengths are equal; the first is %s, with "
       "pixels of %.4g times their height. If these cameras are of square pixels, store the pictures so, or give both "
       "focal lengths",
       first->name, first->picture.pixel_aspect);
  first = first_of(&found->stretched);
  note(parsed, found, info, &found->stretched,
       "photographs have pixels that are not square, and cameras of square pixels, whose intrinsics are scaled across "
       "or down; the first is %s, with pixels of %.4g times their height",
       first->name, first->picture.pixel_aspect);
  first = first_of(&found->space);
  note(parsed, found, info, &found->space,
       "photographs have colours that are not sRGB and are converted to it; those of %s are %s", first->name,
       first->picture.space);
  first = first_of(&found->layer);
  note(parsed, found, info, &found->layer, "photographs are EXR files of several layers; of %s, %s is used",
       first->name, layer_of(first));
  note(
      parsed, found, info, &found->larger,
      "photographs are EXR files whose data window is larger than their display window, which is used; the first is %s",
      first_of(&found->larger)->name);
  note(parsed, found, info, &found->light,
       "photographs are linear light, encoded for display by the curve of sRGB; the first is %s",
       first_of(&found->light)->name);
  note(parsed, found, info, &found->alpha, "photographs %s; the first is %s", rules[alpha],
       first_of(&found->alpha)->name);
}
pags_result pags_pictures_check(pags_parsed_dataset *parsed, bool asked, pags_image_alpha alpha) {
  findings found = {0};
  for (int64_t i = 0; i < parsed->count; i++) {
    pags_parsed_view *view = &parsed->views[i];
    if (view->missing)
      continue;
    if (view->picture.width == 0)
      PAGS_TRY(pags_image_inspect(view->image_path, &view->picture));
    found.views++;
    if (view->picture.colour == PAGS_COLOUR_UNKNOWN)
      return pags_colour_refuse(view->image_path, view->picture.space);
    const pags_image_facts *p = &view->picture;
    if (p->window != PAGS_WINDOW_WHOLE)
      add(p->window == PAGS_WINDOW_LARGER ? &found.larger : &found.partial, view);
    if (p->colour == PAGS_COLOUR_OTHER)
      add(&found.space, view);
    if (p->layer_rule != PAGS_LAYER_ONLY)
      add(p->layer_rule == PAGS_LAYER_FIRST ? &found.first_layer : &found.layer, view);
    if (p->alpha)
      add(&found.alpha, view);
    if (p->sample == PAGS_F32)
      add(&found.light, view);
    if (parsed->driving && p->orientation > 1)
      add(&found.unclear, view);
    const double x = view->lens.cx / view->lens.width, y = view->lens.cy / view->lens.height;
    if (!parsed->driving && !(x > 0.05 && x < 0.95 && y > 0.05 && y < 0.95))
      add(&found.aside, view);
  }
  const int habit = parsed->driving ? 0 : find_habit(parsed);
  for (int64_t i = 0; i < parsed->count && !parsed->driving; i++)
    if (!parsed->views[i].missing)
      PAGS_TRY(fit_camera(&parsed->views[i], habit, &found));
  for (int64_t i = 0; i < parsed->count; i++) {
    const pags_parsed_view *view = &parsed->views[i];
    if (!view->missing && view->picture.pixel_aspect != 1 && fabs(view->lens.fx / view->lens.fy - 1) < 0.005 &&
        view->lens.model.kind != PAGS_LENS_EQUIRECTANGULAR)
      add(&found.oblong, view);
  }
  report(parsed, &found, asked, alpha);
  return PAGS_OK;
}
