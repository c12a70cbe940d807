/* SPDX-License-Identifier: Apache-2.0 */
/* Opens a data set: chooses the reader by the files it finds, has the pictures found and compared with their cameras,
 * marks the held-out views and gives every view its downscaled camera. Also holds the accessors of the public API. */
#include "dataset/internal.h"

#include "dataset/colmap.h"
#include "dataset/driving/check/looks.h"
#include "dataset/driving/reader.h"
#include "dataset/owners.h"
#include "dataset/photo_mask.h"
#include "dataset/pictures.h"
#include "dataset/splits.h"
#include "dataset/unsupported_formats.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "maths/maths.h"
#include "port/port.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

pags_dataset_options pags_dataset_options_default(void) {
  return (pags_dataset_options){.downscale = 1, .split_every = -1, .random_points = 10000, .frame_last = -1};
}

/* ---- Choosing the reader ---- */

/* Reads the COLMAP model in or below `folder`; *found: whether there is one. */
static pags_result read_model(const char *root, const char *folder, pags_parsed_dataset *parsed, bool *found) {
  PAGS_AUTOFREE char *model = NULL;
  PAGS_TRY(pags_colmap_find_model(folder, &model));
  *found = model != NULL;
  if (!model)
    return PAGS_OK;
  PAGS_TRY(pags_colmap_read(root, model, parsed));
  PAGS_TRY(pags_count_unused_pictures(parsed));
  return pags_split_read_text(root, model, parsed);
}

/* The caller named a COLMAP model, or a folder above it. Its path is tried relative to the data set's folder, then as
 * it stands. */
static pags_result read_named_model(const char *path, const char *name, pags_parsed_dataset *parsed) {
  PAGS_AUTOFREE char *root = pags_dir_exists(path) ? pags_text_copy(path) : pags_path_folder(path);
  PAGS_AUTOFREE char *inside = root ? pags_path_join(root, name) : NULL;
  PAGS_CHECK_MEMORY(inside, "%s", path);
  bool found = false;
  if (pags_dir_exists(inside))
    PAGS_TRY(read_model(root, inside, parsed, &found));
  if (!found && pags_dir_exists(name))
    PAGS_TRY(read_model(root, name, parsed, &found));
  if (found)
    return PAGS_OK;
  return pags_fail_at(name,
                      "not a COLMAP model: expected cameras.bin and images.bin, or .txt, in this folder or below, in "
                      "the data set %s or from here",
                      root);
}

/* Reads a folder by the rules that --kind names, if it is in drivestudio's layout at all. */
static pags_result read_of_kind(const char *path, const pags_dataset_options *options, pags_parsed_dataset *parsed) {
  if (pags_driving_is_set(path))
    return pags_driving_read(path, options, parsed);
  PAGS_TRY(pags_unsupported_recording_check(path, true));
  return pags_fail_at(
      path,
      "not in drivestudio's layout, which --kind %s asks for: expected the folders images, intrinsics, extrinsics and "
      "ego_pose (docs/dataset-layout.md), found %s; other data sets are read without --kind",
      options->kind,
      pags_folder_has_folder(path, "images") ? "images, but neither extrinsics nor ego_pose" : "no folder images");
}

static pags_result read_parsed(const char *path, const pags_dataset_options *options, pags_parsed_dataset *parsed) {
  if (!pags_path_exists(path))
    return pags_fail(PAGS_ERROR_IO, "%s: no such file or folder", path);
  if (options->colmap)
    return read_named_model(path, options->colmap, parsed);
  if (pags_folder_has(path, PAGS_SPLIT_FILE))
    return pags_fail_at(
        path, "a recording that was split into blocks; expected one of them (%s/000) or the recording itself", path);
  if (pags_dir_exists(path)) {
    /* The order decides which format wins: an explicit kind of driving set, transforms.json, a driving set, a COLMAP
     * model. */
    const bool has_split = pags_folder_has(path, "transforms_train.json");
    if (options->kind)
      return read_of_kind(path, options, parsed);
    if (pags_folder_has(path, "transforms.json")) {
      if (has_split)
        PAGS_WARN(
            "%s: transforms.json is used; transforms_train.json and the files of its split are not (without "
            "transforms.json they are one data set)",
            path);
      PAGS_AUTOFREE char *transforms = pags_path_join(path, "transforms.json");
      PAGS_CHECK_MEMORY(transforms, "%s", path);
      return pags_transforms_read(transforms, false, parsed);
    }
    if (pags_driving_is_set(path))
      return pags_driving_read(path, options, parsed);
    if (has_split)
      return pags_transforms_read(path, true, parsed);
    bool found;
    PAGS_TRY(read_model(path, path, parsed, &found));
    return found ? PAGS_OK : pags_unsupported_refuse(path);
  }
  if (strcmp(pags_path_name(path), "dataset.json") == 0) {
    PAGS_AUTOFREE char *folder = pags_path_folder(path);
    PAGS_CHECK_MEMORY(folder, "%s", path);
    return pags_driving_read(folder, options, parsed);
  }
  if (strcmp(pags_path_extension(path), ".json") == 0)
    return pags_transforms_read(path, false, parsed);
  return pags_unsupported_refuse(path);
}

/* Reads the recording that a block is of, and leaves in it what the block has. */
static pags_result read_block(const pags_block_file *block, const pags_dataset_options *options,
                              pags_parsed_dataset *parsed) {
  const char *recording = block->facts.recording;
  if (!pags_dir_exists(recording))
    return pags_fail(PAGS_ERROR_IO,
                     "%s: the recording that it is a block of isn't at %s; put it back, or correct 'recording'",
                     block->path, recording);
  PAGS_TRY(read_parsed(recording, options, parsed));
  return parsed->driving ? pags_block_cut(&block->facts, parsed)
                         : pags_fail_at(recording, "expected the driving set that was split, found %s", parsed->kind);
}

/* ---- Leaving out missing views ---- */

/* Refuses or tells of views that lack a file; `what` is "image" or "pose". */
static pags_result report_missing(const pags_dataset *dataset, const pags_parsed_view *first, int64_t count,
                                  int allowed) {
  if (!first)
    return PAGS_OK;
  const long long missing = (long long)count, all = (long long)dataset->parsed.count;
  const char *what = first->no_pose ? "pose" : "image", *path = first->no_pose ? first->no_pose : first->image_path;
  if (dataset->count == 0)
    return pags_fail(PAGS_ERROR_IO, "%s: no such %s: %s; all %lld %ss are missing", first->where, what, path, all,
                     what);
  if (!allowed)
    return pags_fail(PAGS_ERROR_IO,
                     "%s: no such %s: %s; %lld of %lld %ss are missing (--allow-missing leaves them out)", first->where,
                     what, path, missing, all, what);
  PAGS_WARN("%s: %lld of %lld %ss are missing and left out, the first is %s", dataset->parsed.source, missing, all,
            what, path);
  return PAGS_OK;
}

/* Moves the views without an image file or without a pose to the end of the array; the others keep their order, and
 * dataset->count becomes their number. A missing one is an error unless `allowed` is nonzero and a view is left. */
static pags_result leave_out_missing(pags_dataset *dataset, int allowed) {
  pags_parsed_dataset *parsed = &dataset->parsed;
  pags_parsed_view first_image = {0}, first_pose = {0}; /* copies, since views change places */
  int64_t images = 0, poses = 0;
  for (int64_t i = 0; i < parsed->count; i++) {
    const pags_parsed_view view = parsed->views[i];
    if (!view.missing) {
      parsed->views[i] = parsed->views[dataset->count];
      parsed->views[dataset->count++] = view;
    } else if (view.no_pose && poses++ == 0) {
      first_pose = view;
    } else if (!view.no_pose && images++ == 0) {
      first_image = view;
    }
  }
  dataset->missing = images + poses;
  PAGS_TRY(report_missing(dataset, images ? &first_image : NULL, images, allowed));
  return report_missing(dataset, poses ? &first_pose : NULL, poses, allowed);
}

/* ---- Cameras and views ---- */

/* Makes the views and their cameras. Held out are, in a driving set, time steps or a camera, in a static set every
 * split_every-th view in file-name order, or those that the data set states (-1). */
static pags_result make_views(pags_dataset *dataset, const pags_dataset_options *options) {
  const pags_driving *driving = dataset->parsed.driving;
  const int every = options->split_every;
  size_t count = (size_t)dataset->count;
  dataset->views = calloc(count, sizeof *dataset->views);
  dataset->cameras = calloc(count, sizeof *dataset->cameras);
  PAGS_CHECK_MEMORY(dataset->views && dataset->cameras, "%s", dataset->path);
  int64_t training = 0;
  const char *lossy = NULL, *bent = NULL; /* the first view of each sort */
  int64_t bent_count = 0;
  double worst = 0;
  for (int64_t i = 0; i < dataset->count; i++) {
    const pags_parsed_view *from = &dataset->parsed.views[i];
    pags_view *view = &dataset->views[i];
    *view = (pags_view){.name = from->name,
                        .image_path = from->image_path,
                        .mask_path = from->mask_path,
                        .sensor = driving ? from->sensor : -1,
                        .frame = driving ? from->frame : -1,
                        .shutter_time = driving ? from->shutter_time : (double)NAN};
    view->test = driving
                     ? driving->steps[pags_driving_step(driving, from->frame)].test || from->sensor == driving->holdout
                 : every < 0 ? from->split == PAGS_SPLIT_TEST
                             : every > 0 && from->number % every == 0;
    double share;
    PAGS_TRY(pags_view_camera_choose(dataset, i, options->undistort, &share));
    lossy = share > 0 && !lossy ? view->name : lossy;
    worst = fmax(worst, share);
    pags_camera camera = dataset->cameras[i];
    memcpy(camera.world_from_camera, from->world_from_camera, sizeof camera.world_from_camera);
    camera.time = driving ? from->time : (double)NAN;
    camera.shutter = from->shutter;
    if (pags_camera_bends(&camera)) {
      bent = bent ? bent : view->name;
      bent_count++;
    }
    PAGS_AUTOFREE char *what = pags_text_format("%s (%s)", from->where, view->name);
    PAGS_CHECK_MEMORY(what, "%s", from->where);
    PAGS_TRY(pags_camera_check(&camera, what));
    view->camera = pags_camera_downscale(&camera, options->downscale);
    training += !view->test;
  }
  if (lossy)
    PAGS_WARN(
        "%s: the distortion can't be undone at up to %.1f %% of a picture, which is left out; the first picture of "
        "such a camera is %s",
        dataset->parsed.source, 100 * worst, lossy);
  if (bent && dataset->parsed.driving)
    PAGS_TRY(pags_driving_note(dataset->parsed.driving,
                               "lenses: %lld of %lld views keep theirs, of which a pinhole would lose a tenth or more, "
                               "the first is %s (--undistort resamples them to pinholes)",
                               (long long)bent_count, (long long)dataset->count, bent));
  else if (bent)
    pags_log_message(PAGS_LOG_INFO,
                     "%s: %lld of %lld views keep their lens, of which a pinhole would lose a tenth or more, the first "
                     "is %s (--undistort resamples them to pinholes)",
                     dataset->parsed.source, (long long)bent_count, (long long)dataset->count, bent);
  if (training == 0)
    return pags_fail_at(dataset->parsed.source,
                        "all of its views are held out; expected more views, or --split-every 0");
  return PAGS_OK;
}

/* Warns of intrinsics of static sets that no usual camera has, and refuses those that none can have. */
static pags_result check_plausible(const pags_dataset *dataset) {
  int64_t odd = 0, first = 0;
  for (int64_t i = 0; i < dataset->count; i++) {
    const pags_parsed_view *view = &dataset->parsed.views[i];
    const pags_lens *lens = &view->lens;
    const double ratio = fmin(lens->fx / lens->width, lens->fy / lens->height), even = lens->fx / lens->fy;
    if (ratio < 0.02)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s (%s): focal lengths %g and %g for %d x %d pixels, an angle of view of %.0f degrees; "
                       "expected pixels (are they in millimetres, or the pictures of another size?)",
                       view->where, pags_path_name(view->image_path), lens->fx, lens->fy, lens->width, lens->height,
                       2 * pags_atan(0.5 / ratio) * 180 / 3.14159265358979323846);
    const double left = (double)dataset->cameras[i].width / lens->width;
    if (left < 0.1)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s (%s): its distortion leaves %d x %d pixels of %d x %d; expected parameters of a lens",
                       view->where, pags_path_name(view->image_path), dataset->cameras[i].width,
                       dataset->cameras[i].height, lens->width, lens->height);
    const bool usual = ratio > 0.1 && ratio < 50 && even > 0.5 && even < 2 && left > 0.5;
    if (!usual && !odd++)
      first = i;
  }
  const pags_parsed_view *view = &dataset->parsed.views[first];
  const pags_lens *lens = &view->lens;
  if (odd)
    PAGS_WARN(
        "%s: %lld of %lld views have unlikely intrinsics, the first is %s: focal lengths %g and %g, centre %g, %g for "
        "%d x %d pixels, of which the distortion leaves %d x %d",
        dataset->parsed.source, (long long)odd, (long long)dataset->count, pags_path_name(view->image_path), lens->fx,
        lens->fy, lens->cx, lens->cy, lens->width, lens->height, dataset->cameras[first].width,
        dataset->cameras[first].height);
  return PAGS_OK;
}

/* Finds, names and checks the photographs and their masks. */
static pags_result find_pictures(pags_dataset *dataset, const pags_dataset_options *options) {
  pags_parsed_dataset *parsed = &dataset->parsed;
  if (parsed->count == 0)
    return pags_fail_at(parsed->source, "expected at least one image, found none");
  PAGS_AUTOFREE char *root =
      pags_dir_exists(dataset->path) ? pags_text_copy(dataset->path) : pags_path_folder(dataset->path);
  PAGS_CHECK_MEMORY(root, "%s", dataset->path);
  PAGS_AUTOFREE char *folder = NULL;
  if (options->image_folder) {
    /* One below the data set's folder stays as it is named, another becomes absolute. */
    const char *name = options->image_folder;
    const bool inside = pags_folder_has_folder(root, name);
    if (!inside && !pags_dir_exists(name))
      return pags_fail(PAGS_ERROR_IO, "%s: no such image folder, neither in %s nor here", name, root);
    dataset->image_folder = inside ? pags_text_copy(name) : pags_port_real_path(name);
    folder = dataset->image_folder ? pags_path_join(root, dataset->image_folder) : NULL;
    PAGS_CHECK_MEMORY(folder, "%s", name);
  }
  PAGS_TRY(pags_pictures_relocate(root, folder, parsed));
  PAGS_TRY(pags_pictures_name(parsed));
  PAGS_TRY(pags_pictures_check(parsed, folder != NULL, options->image_alpha));
  if (parsed->driving)
    return PAGS_OK;
  PAGS_TRY(pags_photo_masks_find(root, parsed));
  return pags_photo_masks_check(parsed);
}

/* Refuses options of driving sets for a static one, on which they have no effect. */
static pags_result check_static(const char *path, const pags_parsed_dataset *parsed,
                                const pags_dataset_options *options) {
  char frames[48];
  snprintf(frames, sizeof frames, "%lld-%lld", (long long)options->frame_first, (long long)options->frame_last);
  if (options->frame_last < 0)
    frames[strcspn(frames, "-") + 1] = '\0';
  const bool some = options->frame_first != 0 || options->frame_last >= 0;
  const struct {
    const char *name, *value, *has;
  } rows[] = {{"kind", options->kind, "the layout that it names"},
              {"cameras", options->cameras, "numbered cameras"},
              {"frames", some ? frames : NULL, "time steps"},
              {"holdout-camera", options->holdout_camera, "numbered cameras"},
              {"ego-mask", options->ego_mask, "a recording car"},
              {"critical", options->critical, "labels"},
              {"sfm", options->sfm, "points of a further model (expected --colmap to choose a model)"}};
  for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
    if (rows[i].value)
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: --%s '%s' was given, but only driving sets have %s; this is %s", path,
                       rows[i].name, rows[i].value, rows[i].has, parsed->kind);
  return PAGS_OK;
}

static pags_result open_into(pags_dataset *dataset, const char *path, const pags_dataset_options *options) {
  dataset->path = pags_text_copy(path);
  dataset->colmap = pags_text_copy(options->colmap);
  PAGS_CHECK_MEMORY(dataset->path && (dataset->colmap || !options->colmap), "%s", path);
  dataset->image_alpha = options->image_alpha;
  for (int c = 0; c < 3; c++)
    dataset->background[c] = (uint8_t)(fmin(fmax(options->background[c], 0), 1) * 255 + 0.5);
  PAGS_TRY(dataset->block.path ? read_block(&dataset->block, options, &dataset->parsed)
                               : read_parsed(path, options, &dataset->parsed));
  if (!dataset->parsed.driving)
    PAGS_TRY(check_static(path, &dataset->parsed, options));
  pags_dataset_options resolved = *options;
  PAGS_TRY(find_pictures(dataset, options));          /* sorts the views */
  for (int64_t i = 0; i < dataset->parsed.count; i++) /* a missing picture doesn't change which others are held out */
    dataset->parsed.views[i].number = i;
  /* The default of static sets; the driving reader applies its own default. */
  if (resolved.split_every == -1 && !dataset->parsed.split_by)
    resolved.split_every = dataset->parsed.count > 1 || dataset->parsed.driving ? 8 : 0;
  PAGS_TRY(leave_out_missing(dataset, options->allow_missing));
  PAGS_TRY(make_views(dataset, &resolved));
  if (!dataset->parsed.driving)
    PAGS_TRY(check_plausible(dataset));
  const char *const by = dataset->parsed.split_by;
  int64_t held_out = 0;
  for (int64_t i = 0; i < dataset->count; i++)
    held_out += dataset->views[i].test;
  if (by && resolved.split_every != 0)
    pags_log_message(PAGS_LOG_INFO, "%s: %lld of %lld views are held out by %s%s", dataset->parsed.source,
                     (long long)held_out, (long long)dataset->count,
                     resolved.split_every < 0 ? "" : "--split-every, not those of ", by);
  PAGS_TRY(pags_dataset_set_origin(dataset));
  if (dataset->parsed.driving) {
    PAGS_TRY(pags_ego_masks_make(dataset, options));
    pags_held_out_check(dataset);
  }
  if (dataset->parsed.driving && options->look) {
    PAGS_TRY(pags_look_at_photographs(dataset));
    PAGS_TRY(pags_look_for_mirror(dataset));
  }
  PAGS_TRY(pags_dataset_make_points(dataset, options));
  pags_dataset_check_in_view(dataset);
  return PAGS_OK;
}

/* ---- Opening, closing, and accessors of every set ---- */

pags_result pags_dataset_open(const char *path, const pags_dataset_options *options, pags_dataset **out) {
  assert(path && out);
  *out = NULL;
  pags_dataset_options chosen = options ? *options : pags_dataset_options_default();

  /* Reject numeric options out of range. */
  if (!(chosen.downscale >= 1) || !isfinite(chosen.downscale))
    return pags_fail(PAGS_ERROR_ARGUMENT, "downscale %g: expected 1 or more", chosen.downscale);
  if (chosen.split_every < -1 || chosen.split_every == 1)
    return pags_fail(PAGS_ERROR_ARGUMENT, "split %d: expected 0 (hold nothing out) or at least 2", chosen.split_every);
  if (chosen.random_points < 1 || chosen.random_points > 100000000)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%lld points to match: expected 1..100000000",
                     (long long)chosen.random_points);

  PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = calloc(1, sizeof *dataset);
  PAGS_CHECK_MEMORY(dataset, "%s", path);
  if (pags_block_is(path))
    PAGS_TRY(pags_block_read(path, &dataset->block, &chosen));
  PAGS_TRY(open_into(dataset, path, &chosen));
  *out = pags_take(&dataset);
  return PAGS_OK;
}

void pags_dataset_close(pags_dataset *dataset) {
  if (!dataset)
    return;
  pags_parsed_destroy(&dataset->parsed);
  pags_block_file_destroy(&dataset->block);
  free(dataset->path);
  free(dataset->colmap);
  free(dataset->image_folder);
  free(dataset->views);
  free(dataset->cameras);
  free(dataset->far);
  free(dataset->xyz);
  free(dataset->rgb);
  free(dataset);
}

const char *pags_dataset_path(const pags_dataset *dataset) {
  return dataset->path;
}

const char *pags_dataset_colmap(const pags_dataset *dataset) {
  return dataset->colmap;
}

const char *pags_dataset_kind(const pags_dataset *dataset) {
  return dataset->parsed.kind;
}

int64_t pags_dataset_view_count(const pags_dataset *dataset) {
  return dataset->count;
}

const pags_view *pags_dataset_view(const pags_dataset *dataset, int64_t index) {
  assert(index >= 0 && index < dataset->count);
  return &dataset->views[index];
}

pags_up pags_dataset_up(const pags_dataset *dataset) {
  return dataset->parsed.up;
}

const double *pags_dataset_origin(const pags_dataset *dataset) {
  return dataset->origin;
}

const pags_block *pags_dataset_block(const pags_dataset *dataset) {
  return dataset->block.path ? &dataset->block.facts : NULL;
}

int64_t pags_dataset_missing(const pags_dataset *dataset) {
  return dataset->missing;
}

const char *pags_dataset_image_folder(const pags_dataset *dataset) {
  return dataset->image_folder;
}

pags_image_alpha pags_dataset_image_alpha(const pags_dataset *dataset) {
  return dataset->image_alpha;
}

int64_t pags_dataset_alpha_count(const pags_dataset *dataset) {
  int64_t count = 0;
  for (int64_t i = 0; i < dataset->parsed.count; i++)
    count += !dataset->parsed.views[i].missing && dataset->parsed.views[i].picture.alpha;
  return count;
}

void pags_dataset_points(const pags_dataset *dataset, int64_t *count, const float **xyz, const uint8_t **rgb,
                         int *to_match) {
  *count = dataset->point_count;
  *xyz = dataset->xyz;
  *rgb = dataset->rgb;
  *to_match = dataset->to_match;
}

/* ---- Accessors of driving sets ---- */

int pags_dataset_provides(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->provides : 0;
}

double pags_dataset_fps(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->fps : 0;
}

pags_place pags_dataset_place(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->rules.place : (pags_place){0};
}

int64_t pags_dataset_object_count(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->object_count : 0;
}

const pags_object *pags_dataset_object(const pags_dataset *dataset, int64_t index) {
  assert(index >= 0 && index < pags_dataset_object_count(dataset));
  return &dataset->parsed.driving->objects[index];
}

int pags_dataset_object_is_critical(const pags_dataset *dataset, int64_t index) {
  assert(index >= 0 && index < pags_dataset_object_count(dataset));
  return dataset->parsed.driving->critical.objects[index] != PAGS_CRITICAL_NOT;
}

const char *pags_dataset_critical(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->critical.list : NULL;
}

int64_t pags_dataset_sweep_count(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->sweep_count : 0;
}

const pags_sweep *pags_dataset_sweep(const pags_dataset *dataset, int64_t index) {
  assert(index >= 0 && index < pags_dataset_sweep_count(dataset));
  return &dataset->parsed.driving->sweeps[index];
}

pags_result pags_dataset_sweep_load(const pags_dataset *dataset, int64_t index, int64_t *count, float **xyz) {
  assert(index >= 0 && index < pags_dataset_sweep_count(dataset));
  return pags_sweep_read(dataset->parsed.driving, index, count, xyz, NULL);
}

const char *pags_dataset_sensor_name(const pags_dataset *dataset, int sensor) {
  const pags_sensor *found = dataset->parsed.driving ? pags_driving_sensor(dataset->parsed.driving, sensor) : NULL;
  return found ? found->name : NULL;
}

int64_t pags_dataset_note_count(const pags_dataset *dataset) {
  return dataset->parsed.driving ? dataset->parsed.driving->note_count : 0;
}

const char *pags_dataset_note(const pags_dataset *dataset, int64_t index) {
  assert(index >= 0 && index < pags_dataset_note_count(dataset));
  return dataset->parsed.driving->notes[index];
}
