/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a driving set in drivestudio's processed layout: lists the pictures, reads the calibration and the poses of
 * their cameras, and calls the readers of boxes, times, masks and sweeps.
 *
 * docs/dataset-layout.md describes every file. TTT is the number of the frame, C that of the camera, both decimal:
 *     images/TTT_C.jpg|png        extrinsics/TTT_C.txt or C.txt   intrinsics/C.txt   ego_pose/TTT.txt
 * The world axes of the files are kept: z up, metres. */
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "dataset/driving/check/checks.h"
#include "dataset/driving/masks.h"
#include "dataset/driving/pictures.h"

#include <pags/camera.h>

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool pags_driving_is_set(const char *folder) {
  return pags_folder_has(folder, "dataset.json") ||
         (pags_folder_has_folder(folder, "images") &&
          (pags_folder_has_folder(folder, "ego_pose") || pags_folder_has_folder(folder, "extrinsics")));
}

/* ---- Selection of cameras and frames ---- */

enum { MOST_CAMERAS = 64 };

typedef struct selection {
  int64_t count; /* number of selected cameras; 0: all cameras */
  int cameras[MOST_CAMERAS];
  int64_t first, last; /* selected frames, both included */
} selection;

static bool is_selected(const selection *selected, const pags_driving_picture *picture) {
  if (picture->frame < selected->first || picture->frame > selected->last)
    return false;
  for (int64_t i = 0; i < selected->count; i++)
    if (selected->cameras[i] == picture->camera)
      return true;
  return selected->count == 0;
}

static pags_result check_pictures(const char *folder, const pags_dir_list *list, const pags_driving_picture *pictures,
                                  int64_t count, int64_t all) {
  if (count == 0)
    return pags_fail_at(folder,
                        "expected pictures named TTT_C.jpg or TTT_C.png (frame, camera) of the cameras and frames "
                        "asked for, found none among %lld files%s%s and %lld such pictures",
                        (long long)list->count, list->count ? ", the first is " : "", list->count ? list->names[0] : "",
                        (long long)all);
  for (int64_t i = 1; i < count; i++)
    if (pictures[i - 1].frame == pictures[i].frame && pictures[i - 1].camera == pictures[i].camera)
      return pags_fail_at(folder, "%s and %s are the same frame and camera; expected one picture", pictures[i - 1].name,
                          pictures[i].name);
  return PAGS_OK;
}

/* ---- Time steps and cameras ---- */

static int by_number(const void *a, const void *b) {
  return ((const pags_sensor *)a)->number - ((const pags_sensor *)b)->number;
}

static pags_result add_sensor(pags_driving *driving, int number) {
  if (pags_driving_sensor(driving, number))
    return PAGS_OK;
  PAGS_CHECK_MEMORY(
      pags_grow(&driving->sensors, driving->sensor_count + 1, &driving->sensor_capacity, sizeof *driving->sensors),
      "%s", driving->root);
  pags_sensor *sensor = &driving->sensors[driving->sensor_count];
  *sensor = (pags_sensor){.number = number, .name = pags_text_format("%d", number)};
  PAGS_CHECK_MEMORY(sensor->name, "%s", driving->root);
  driving->sensor_count++;
  return PAGS_OK;
}

/* Makes the time steps and the cameras of the chosen pictures. `all` lists those of the whole recording; both lists are
 * sorted by frame. Every `every`-th time step of the recording is held out, whatever the numbers of its frames are and
 * whichever part of it is chosen, except the first (0: none). */
static pags_result make_steps(pags_driving *driving, const pags_driving_picture *chosen, int64_t count,
                              const pags_driving_picture *all, int every) {
  driving->steps = calloc((size_t)count, sizeof *driving->steps);
  PAGS_CHECK_MEMORY(driving->steps, "%s", driving->root);
  int64_t step = 0; /* of the recording */
  for (int64_t i = 0, at = 0; i < count; i++) {
    const int frame = chosen[i].frame;
    PAGS_TRY(add_sensor(driving, chosen[i].camera));
    if (i > 0 && chosen[i - 1].frame == frame)
      continue;
    for (; all[at].frame < frame; at++)
      step += all[at].frame != all[at + 1].frame;
    const bool test = every > 0 && step > 0 && step % every == 0;
    driving->steps[driving->step_count++] = (pags_time_step){.frame = frame, .test = test};
  }
  driving->digits = chosen[0].digits;
  pags_sort(driving->sensors, driving->sensor_count, sizeof *driving->sensors, by_number);
  return PAGS_OK;
}

/* If dataset.json lists frames as "held_out", holds out these time steps and no others. `all` as above. */
static pags_result take_held_out(pags_driving *driving, const pags_driving_picture *all, int64_t all_count) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_in_folder(driving->root, "dataset.json", &json));
  const pags_json_value *list = json ? pags_json_member(pags_json_root(json), "held_out") : NULL;
  if (!list)
    return PAGS_OK;
  PAGS_TRY(pags_json_array(json, pags_json_root(json), "held_out", &list));
  for (int i = 0; i < driving->step_count; i++)
    driving->steps[i].test = false;
  for (const pags_json_value *item = list->first; item; item = item->next) {
    double frame;
    bool known = false;
    PAGS_TRY(pags_json_as_number(json, item, "the number of a frame", &frame));
    for (int64_t i = 0; i < all_count && !known; i++)
      known = all[i].frame == frame;
    if (!known)
      return pags_json_fail(json, item, "'held_out': expected numbers of frames of images/, found %g", frame);
    for (int i = 0; i < driving->step_count; i++)
      driving->steps[i].test = driving->steps[i].test || driving->steps[i].frame == frame;
  }
  return PAGS_OK;
}

/* ---- Calibration ---- */

/* Makes the lens of the numbers of intrinsics/C.txt: fx fy cx cy, which may go on with k1 k2 p1 p2 and k3, or a camera
 * matrix of 3x3, 3x4 or 4x4, recognised by its last numbers. Returns false if they are neither. */
static bool take_lens(const double *n, int count, pags_lens *out) {
  const int stride = count == 9 ? 3 : 4;
  const double *last = n + 2 * stride; /* the third row of a matrix */
  const bool matrix = count >= 9 && last[0] == 0 && last[1] == 0 && last[2] == 1;
  *out = (pags_lens){.fx = n[0], .fy = n[1], .cx = n[2], .cy = n[3]};
  if (matrix) {
    *out = (pags_lens){.fx = n[0], .fy = n[stride + 1], .cx = n[2], .cy = n[stride + 2]};
    return n[1] == 0 && n[stride] == 0 && (stride == 3 || (n[3] == 0 && n[7] == 0 && n[11] == 0));
  }
  if (count != 4 && count != 8 && count != 9)
    return false;
  for (int i = 0; i < 2 && count >= 8; i++) {
    out->model.k[i] = n[4 + i];
    out->model.p[i] = n[6 + i];
  }
  out->model.k[2] = count == 9 ? n[8] : 0;
  return true;
}

static pags_result read_intrinsics(const pags_driving *driving, pags_sensor *sensor) {
  double n[16] = {0};
  int count = 0;
  PAGS_AUTOFREE char *path = pags_text_format("%s/intrinsics/%d.txt", driving->root, sensor->number);
  PAGS_CHECK_MEMORY(path, "%s", driving->root);
  const pags_lens_model stated = sensor->lens.model;
  PAGS_TRY(pags_text_matrix_read(path, 16, n, &count));
  if (!take_lens(n, count, &sensor->lens))
    return pags_fail_at(path,
                        "%d numbers, expected fx fy cx cy, or these and k1 k2 p1 p2 or k1 k2 p1 p2 k3, or a camera "
                        "matrix of 3x3, 3x4 or 4x4 without skew and without a fourth column",
                        count);
  if (sensor->lens_stated && !pags_lens_is_pinhole(&sensor->lens))
    return pags_fail_at(
        path, "%d numbers, expected fx fy cx cy alone, since 'lenses' of dataset.json has the distortion of camera %d",
        count, sensor->number);
  if (sensor->lens_stated)
    sensor->lens.model = stated;
  if (!(sensor->lens.fx > 0 && sensor->lens.fy > 0))
    return pags_fail(PAGS_ERROR_FORMAT, "%s:1: expected focal lengths above 0, found %g and %g", path, sensor->lens.fx,
                     sensor->lens.fy);
  return PAGS_OK;
}

/* Rotation whose columns are OpenCV's axes x (right), y (down), z (forward) in Waymo's camera axes (x forward, y
 * left, z up). */
static const double waymo_from_opencv[12] = {0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0};

static pags_result read_extrinsics(const pags_driving *driving, const char *path, double out[12]) {
  PAGS_TRY(pags_text_pose_read(path, out));
  if (driving->rules.waymo_axes)
    pags_rigid_multiply(out, waymo_from_opencv, out);
  return PAGS_OK;
}

/* ---- Views and the whole set ---- */

/* Adds the view of a camera at a frame: image size, masks, pose. `name` NULL: the picture is missing; the view then
 * gets a path with `extension` for messages. */
static pags_result add_view(pags_driving *driving, const pags_sensor *sensor, int frame, const char *name,
                            const char *extension, pags_parsed_dataset *parsed) {
  pags_parsed_view *view = pags_parsed_add(parsed);
  PAGS_CHECK_MEMORY(view, "%s", driving->root);
  view->frame = frame;
  view->sensor = sensor->number;
  view->missing = !name;
  view->sized = true;
  view->image_path =
      name ? pags_text_format("%s/images/%s", driving->root, name)
           : pags_text_format("%s/images/%0*d_%d%s", driving->root, driving->digits, frame, sensor->number, extension);
  view->where = pags_text_format("%s/images", driving->root);
  PAGS_CHECK_MEMORY(view->image_path && view->where, "%s", driving->root);
  if (!name)
    return PAGS_OK;
  view->lens = sensor->lens;
  PAGS_TRY(pags_image_inspect(view->image_path, &view->picture));
  view->lens.width = view->picture.width;
  view->lens.height = view->picture.height;

  PAGS_TRY(pags_driving_find_mask(driving, driving->sky_folder, view, &view->sky_path));
  PAGS_TRY(pags_driving_find_mask(driving, "semantic", view, &view->semantic_path));
  PAGS_TRY(pags_driving_find_mask(driving, driving->dynamic_folder, view, &view->dynamic_path));
  driving->provides |=
      (view->sky_path || (view->semantic_path && pags_labels_know_sky(driving)) ? PAGS_PROVIDES_SKY_MASKS : 0) |
      (view->semantic_path ? PAGS_PROVIDES_SEMANTIC : 0) | (view->dynamic_path ? PAGS_PROVIDES_DYNAMIC_MASKS : 0);

  /* The pose is camera-to-world itself (per-frame extrinsics) or ego-to-world times camera-to-ego. */
  const char *root = driving->root;
  int digits = driving->digits;
  PAGS_AUTOFREE char *path =
      driving->rules.per_frame  ? pags_text_format("%s/extrinsics/%0*d_%d.txt", root, digits, frame, sensor->number)
      : driving->exposure_poses ? pags_text_format("%s/ego_pose/%0*d_%d.txt", root, digits, frame, sensor->number)
                                : pags_text_format("%s/ego_pose/%0*d.txt", root, digits, frame);
  PAGS_CHECK_MEMORY(path, "%s", root);
  const pags_result result = driving->rules.per_frame ? read_extrinsics(driving, path, view->world_from_camera)
                                                      : pags_text_pose_read(path, view->world_from_camera);
  if (result == PAGS_OK && !driving->rules.per_frame)
    pags_rigid_multiply(view->world_from_camera, sensor->ego_from_camera, view->world_from_camera);
  if (result == PAGS_OK || !pags_text_pose_is_missing(path))
    return result;
  view->missing = true; /* dataset.c says so, or refuses */
  view->no_pose = pags_take(&path);
  return PAGS_OK;
}

/* Takes a camera's name or lens from dataset.json (pags_camera_fact_fn). */
static pags_result take_fact(void *context, int number, const char *name, const pags_lens_model *lens) {
  pags_driving *driving = context;
  pags_sensor *sensor = pags_driving_sensor(driving, number);
  if (sensor && lens) {
    sensor->lens.model = *lens;
    sensor->lens_stated = true;
  }
  if (!sensor || !name)
    return PAGS_OK;
  char *copy = pags_text_copy(name);
  PAGS_CHECK_MEMORY(copy, "%s", driving->root);
  free(sensor->name);
  sensor->name = copy;
  return PAGS_OK;
}

/* Whether the folder has a file TTT_C.txt for the first frame and camera. */
static bool has_poses_per_view(const pags_driving *driving, const char *folder) {
  PAGS_AUTOFREE char *path = pags_text_format("%s/%s/%0*d_%d.txt", driving->root, folder, driving->digits,
                                              driving->steps[0].frame, driving->sensors[0].number);
  return path && pags_file_exists(path);
}

/* Reads the conventions, calibration, views, times, objects and sweeps of the set; `pictures` is sorted by frame and
 * camera. */
static pags_result read_parts(pags_driving *driving, const pags_dataset_options *options,
                              const pags_driving_picture *pictures, int64_t count, pags_parsed_dataset *parsed) {
  PAGS_TRY(pags_rules_read(driving->root, options->kind, has_poses_per_view(driving, "extrinsics"), &driving->rules,
                           take_fact, driving));

  const pags_rules *rules = &driving->rules;
  PAGS_TRY(pags_driving_note(driving, "kind %s: %s, camera axes %s, sweeps in the %s frame, boxes' front %s",
                             rules->kind, rules->per_frame ? "extrinsics per frame" : "constant extrinsics",
                             rules->waymo_axes ? "Waymo's" : "OpenCV's",
                             rules->lidar_frame   ? "LiDAR's"
                             : rules->lidar_world ? "world's"
                                                  : "ego",
                             rules->forward_y ? "+y" : "+x"));

  driving->sky_folder = pags_folder_has_folder(driving->root, "sky_masks") ? "sky_masks" : "sky_mask";
  driving->dynamic_folder =
      pags_folder_has_folder(driving->root, "dynamic_masks/all") ? "dynamic_masks/all" : "dynamic_mask";
  driving->exposure_poses = !rules->per_frame && has_poses_per_view(driving, "ego_pose");
  if (driving->exposure_poses)
    PAGS_TRY(pags_driving_note(driving, "poses: the car's at each exposure, ego_pose/TTT_C.txt"));
  const char *holdout = options->holdout_camera;
  driving->holdout = -1;
  if (holdout) {
    const char *end = holdout;
    if (!pags_driving_number(&end, &driving->holdout) || *end || !pags_driving_sensor(driving, driving->holdout))
      return pags_fail(PAGS_ERROR_ARGUMENT, "held-out camera '%s': expected the number of one of the cameras used",
                       holdout);
    PAGS_TRY(pags_driving_note(driving, "held out: all views of camera %d", driving->holdout));
  }
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    pags_sensor *sensor = &driving->sensors[i];
    PAGS_TRY(read_intrinsics(driving, sensor));
    if (rules->per_frame)
      continue;
    PAGS_AUTOFREE char *path = pags_text_format("%s/extrinsics/%d.txt", driving->root, sensor->number);
    PAGS_CHECK_MEMORY(path, "%s", driving->root);
    PAGS_TRY(read_extrinsics(driving, path, sensor->ego_from_camera));
  }

  /* One view for every camera at every time step, ordered by step, then by camera, so that the index of a view is
   * step * sensor_count + sensor. */
  const char *extension = pags_path_extension(pictures[0].name);
  int64_t at = 0;
  for (int64_t i = 0; i < driving->step_count; i++)
    for (int64_t j = 0; j < driving->sensor_count; j++) {
      const pags_sensor *sensor = &driving->sensors[j];
      int frame = driving->steps[i].frame;
      bool found = at < count && pictures[at].frame == frame && pictures[at].camera == sensor->number;
      PAGS_TRY(add_view(driving, sensor, frame, found ? pictures[at].name : NULL, extension, parsed));
      at += found;
    }

  /* The car is where the first of its cameras is that has a pose. */
  for (int64_t i = 0; i < driving->step_count; i++) {
    const pags_parsed_view *view = &parsed->views[i * driving->sensor_count], *end = view + driving->sensor_count;
    while (view < end && view->missing)
      view++;
    for (int k = 0; k < 3; k++)
      driving->steps[i].eye[k] = view < end ? view->world_from_camera[4 * k + 3] : (double)NAN;
  }
  PAGS_TRY(pags_calibration_check(driving, parsed));
  PAGS_TRY(pags_times_read(driving, parsed));
  PAGS_TRY(pags_rolling_read(driving, parsed));
  PAGS_TRY(pags_driving_check_motion(driving, parsed));
  driving->street_tracks = !pags_folder_has(driving->root, "instances/instances_info.json") &&
                           pags_folder_has(driving->root, PAGS_STREET_TRACKS);
  PAGS_TRY(driving->street_tracks ? pags_street_tracks_read(driving) : pags_tracks_read(driving));
  for (int64_t i = 0; i < driving->object_count; i++)
    driving->objects[i].time_step = 1 / driving->fps;
  pags_driving_check_places(driving);
  pags_world_check(driving, parsed);
  PAGS_TRY(pags_critical_choose(driving, options->critical, parsed));
  PAGS_TRY(pags_sweeps_find(driving));
  PAGS_TRY(pags_sweeps_check(driving, options->look != 0));
  PAGS_TRY(pags_sweep_poses_check(driving));
  PAGS_TRY(pags_masks_check(driving, parsed));
  return pags_critical_note(driving, parsed);
}

static pags_result read_listed(pags_driving *driving, const char *folder, const pags_dir_list *list,
                               const pags_dataset_options *options, pags_parsed_dataset *parsed) {
  selection selected = {.first = options->frame_first,
                        .last = options->frame_last < 0 ? INT64_MAX : options->frame_last};
  if (selected.first < 0 || selected.last < selected.first)
    return pags_fail(PAGS_ERROR_ARGUMENT, "frames %lld to %lld: expected 0 <= first <= last",
                     (long long)options->frame_first, (long long)options->frame_last);

  /* Parse the list of camera numbers. */
  const char *at = options->cameras;
  while (options->cameras) {
    if (selected.count == MOST_CAMERAS || !pags_driving_number(&at, &selected.cameras[selected.count]) ||
        (*at && *at != ','))
      return pags_fail(PAGS_ERROR_ARGUMENT, "cameras '%s': expected at most %d numbers separated by commas",
                       options->cameras, (int)MOST_CAMERAS);
    selected.count++;
    if (*at++ == '\0')
      break;
  }

  int64_t all, count = 0;
  PAGS_AUTOFREE pags_driving_picture *pictures = NULL;
  PAGS_TRY(pags_driving_pictures(folder, list, &all, &pictures));
  PAGS_AUTOFREE pags_driving_picture *chosen = malloc(((size_t)all + 1) * sizeof *chosen);
  PAGS_CHECK_MEMORY(chosen, "%s", folder);
  for (int64_t i = 0; i < all; i++)
    if (is_selected(&selected, &pictures[i]))
      chosen[count++] = pictures[i];
  PAGS_TRY(check_pictures(folder, list, chosen, count, all));
  PAGS_TRY(make_steps(driving, chosen, count, pictures, options->split_every == -1 ? 4 : options->split_every));
  if (options->split_every == -1)
    PAGS_TRY(take_held_out(driving, pictures, all));
  for (int64_t i = 0; i < selected.count; i++)
    if (!pags_driving_sensor(driving, selected.cameras[i]))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s/images: camera %d was requested, but it has no picture", driving->root,
                       selected.cameras[i]);
  PAGS_TRY(read_parts(driving, options, chosen, count, parsed));
  return pags_driving_say_unread(driving, list, pictures, all);
}

pags_result pags_driving_read(const char *root, const pags_dataset_options *options, pags_parsed_dataset *parsed) {
  *parsed = (pags_parsed_dataset){.up = PAGS_UP_Z};
  pags_driving *driving = parsed->driving = calloc(1, sizeof *parsed->driving);
  PAGS_CHECK_MEMORY(driving, "%s", root);
  PAGS_AUTOFREE char *folder = pags_path_join(root, "images");
  driving->root = pags_text_copy(root);
  parsed->source = pags_text_copy(root);
  PAGS_CHECK_MEMORY(folder && driving->root && parsed->source, "%s", root);
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(folder, &list));
  PAGS_TRY(read_listed(driving, folder, &list, options, parsed));
  parsed->kind = driving->rules.kind;
  return PAGS_OK;
}
