/* SPDX-License-Identifier: Apache-2.0 */
/* Imports a segment of the Waymo Open Dataset v1 (a TFRecord file of frames) into drivestudio's processed layout.
 *
 * The file is read twice: first only the length of each record, which gives the number of frames and finds truncated
 * or damaged framing, then record by record. Boxes are made into tracks, and masks are drawn from the tracks, after
 * all frames have been read.
 *
 * Axes. Waymo's cameras have x forward, y left, z up; the extrinsics are written for OpenCV's camera axes (x right, y
 * down, z forward): E * [0 0 1; -1 0 0; 0 -1 0], which only permutes and negates columns. The vehicle, the LiDAR and
 * the boxes have x forward, y left, z up, as in our layout.
 *
 * Poses. ego_pose is the pose of the frame, in which boxes and LiDAR are given. It is that of the car at about the
 * middle of the LiDAR sweep, while each photograph has a pose of its own up to 30 ms away (0.45 m at 15 m/s) and
 * within 5 ms of the middle of its exposure. Therefore extrinsics are written per photograph, camera-to-world: the
 * photograph's pose, moved by its velocity to the middle of the exposure, times the constant camera-to-vehicle
 * extrinsics, which are also written. The columns of a photograph are read one after another over some 45 ms (rolling
 * shutter, left to right), which a single pose can't correct; timestamps.json keeps the numbers that a correction
 * needs (pose, pose_time, velocity, trigger, readout and shutter of each photograph).
 *
 * LiDAR rows are x y z intensity, 16 bytes, of both returns. drivestudio's rows have 14 columns (56 bytes) with
 * origin, flow, ground, elongation and LiDAR id, which we don't use. */
#include <assert.h>
#include <math.h>
#include <stdio.h>

#include <pags/import.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/vec3.h"
#include "dataset/driving/motion.h"
#include "dataset/driving/writer.h"
#include "dataset/unsupported_formats.h"
#include "import/importer.h"
#include "import/tfrecord.h"
#include "import/waymo_lidar.h"
#include "import/waymo_masks.h"
#include "import/waymo_tracks.h"
#include "maths/maths.h"

enum { WHERE = 1024, MOST_PHOTO_PIXELS = 1 << 26 };

static const char *const lidar_columns[] = {"x", "y", "z", "intensity", NULL};

typedef struct importer {
  const char *source;
  pags_tasks *tasks;
  pags_progress_fn *progress;
  void *user;
  int numbers[16];   /* camera numbers of drivestudio; Waymo's camera names minus one */
  char context[256]; /* name of the segment */
  pags_layout_camera cameras[PAGS_WAYMO_CAMERAS];
  double ego_from_camera[PAGS_WAYMO_CAMERAS][12];
  pags_layout_info info;
  pags_layout layout;
  pags_waymo_boxes boxes;
  pags_layout_track *tracks;
  int64_t track_count;
  double *times;                   /* one per frame, seconds */
  double *ego_poses;               /* 12 numbers per frame */
  pags_layout_exposure *exposures; /* [frame * cameras + camera] */
  double *camera_poses;            /* 12 numbers per photograph: camera-to-world */
  int64_t labelled;                /* number of photographs with panoptic labels */
  int64_t sweeps;                  /* number of frames with LiDAR points */
  pags_account account;            /* omissions and their reasons */
} importer;

/* Calls the progress function; fails if it asks to cancel. */
static pags_result report(const importer *im, double fraction, const char *what) {
  if (im->progress && !im->progress(im->user, fraction, what))
    return pags_fail(PAGS_CANCELLED, "cancelled");
  return PAGS_OK;
}

/* ---- Calibration ---- */

static pags_result read_camera(importer *im, const pags_waymo_frame *frame, int index, const char *where) {
  const int number = im->numbers[index], name = number + 1;
  const Pags__Waymo__CameraCalibration *c = pags_waymo_camera(frame, name);
  if (!c)
    return pags_fail_at(where, "no calibration of camera %d (%s)", number, pags_waymo_camera_name(name));
  if (c->n_intrinsic != 9)
    return pags_fail_at(where, "camera %d has %zu intrinsics, expected 9", number, c->n_intrinsic);
  if (c->width < 1 || c->height < 1 || (int64_t)c->width * c->height > MOST_PHOTO_PIXELS)
    return pags_fail_at(where, "camera %d has %d x %d pixels, expected at most %d in all", number, c->width, c->height,
                        MOST_PHOTO_PIXELS);
  static const char *const shutters[] = {NULL,  "top_to_bottom", "left_to_right", "bottom_to_top", "right_to_left",
                                         "none"};
  const int shutter = c->rolling_shutter_direction;
  const bool known = shutter > 0 && shutter < (int)(sizeof shutters / sizeof *shutters);
  pags_layout_camera *camera = &im->cameras[index];
  *camera = (pags_layout_camera){.number = number,
                                 .name = pags_waymo_camera_name(name),
                                 .rolling_shutter = known ? shutters[shutter] : NULL,
                                 .width = c->width,
                                 .height = c->height};
  for (int i = 0; i < 9; i++) {
    camera->intrinsics[i] = c->intrinsic[i];
    if (!isfinite(c->intrinsic[i]) || (i < 2 && !(c->intrinsic[i] > 0)))
      return pags_fail_at(where, "intrinsic %d of camera %d is %g", i, number, c->intrinsic[i]);
  }
  double ego_from_waymo[12];
  PAGS_TRY(pags_waymo_transform(c->extrinsic, where, "extrinsic of a camera", ego_from_waymo));
  for (int row = 0; row < 3; row++) { /* from Waymo's camera axes to OpenCV's */
    const double *m = ego_from_waymo + 4 * row;
    const double columns[4] = {0 - m[1], 0 - m[2], m[0], m[3]}; /* subtraction from 0 never gives -0 */
    memcpy(im->ego_from_camera[index] + 4 * row, columns, sizeof columns);
  }
  return PAGS_OK;
}

/* ---- One frame ---- */

static pags_result read_exposure(const Pags__Waymo__CameraImage *image, const char *where, pags_layout_exposure *out) {
  *out = pags_layout_exposure_unknown();
  if (image->has_shutter && isfinite(image->shutter))
    out->shutter = image->shutter;
  if (image->has_camera_trigger_time && isfinite(image->camera_trigger_time))
    out->trigger = image->camera_trigger_time;
  if (image->has_camera_readout_done_time && isfinite(image->camera_readout_done_time))
    out->readout = image->camera_readout_done_time;
  if (image->has_pose_timestamp && isfinite(image->pose_timestamp))
    out->pose_time = image->pose_timestamp;
  out->time = out->readout >= out->trigger ? 0.5 * (out->trigger + out->readout) : out->pose_time;
  if (!image->pose)
    return PAGS_OK;
  PAGS_TRY(pags_waymo_transform(image->pose, where, "pose of a photograph", out->pose));
  const Pags__Waymo__Velocity *v = image->velocity;
  if (v && isfinite(v->v_x) && isfinite(v->v_y) && isfinite(v->v_z) && isfinite(v->w_x) && isfinite(v->w_y) &&
      isfinite(v->w_z)) {
    /* Waymo gives the angular velocity in world axes, which become those of the ego vehicle. */
    const double linear[3] = {(double)v->v_x, (double)v->v_y, (double)v->v_z}, w[3] = {v->w_x, v->w_y, v->w_z};
    const double *m = out->pose;
    pags_copy3(linear, out->velocity);
    for (int i = 0; i < 3; i++)
      out->velocity[3 + i] = m[i] * w[0] + m[4 + i] * w[1] + m[8 + i] * w[2];
  }
  return PAGS_OK;
}

/* Computes the pose of the car in the middle of the exposure: the photograph's pose moved by its velocity, or the
 * pose of the frame if the photograph has none. Without a velocity, or if the exposure is 0.1 s or more away from the
 * pose, the photograph's pose is used unchanged. */
static void exposure_pose(const pags_layout_exposure *e, const double ego_pose[12], double out[12]) {
  static const double still[3] = {0, 0, 0};
  const double dt = e->time - e->pose_time;
  memcpy(out, isnan(e->pose[0]) ? ego_pose : e->pose, 12 * sizeof *out);
  if (isnan(e->pose[0]) || isnan(e->velocity[0]) || !(fabs(dt) < 0.1))
    return;
  double turn[3], turned[12];
  pags_scale3(dt, e->velocity + 3, turn);
  pags_increment_matrix(turn, still, turned);
  pags_rigid_multiply(e->pose, turned, out);
  for (int i = 0; i < 3; i++)
    out[4 * i + 3] += e->velocity[i] * dt;
}

static pags_result read_image(importer *im, const pags_waymo_frame *message, int64_t frame, int index,
                              const char *where) {
  const pags_layout_camera *camera = &im->cameras[index];
  const Pags__Waymo__CameraImage *image = pags_waymo_image(message, camera->number + 1);
  bool labelled;
  if (!image || image->image.len < 4)
    return pags_fail_at(where, "no photograph of camera %d (%s); --cameras and --frames choose others", camera->number,
                        camera->name);
  if (image->image.data[0] != 0xff || image->image.data[1] != 0xd8)
    return pags_fail_at(where, "the photograph of camera %d is no JPEG", camera->number);
  const int64_t photo = frame * im->info.camera_count + index;
  double *pose = im->camera_poses + 12 * photo, ego[12];
  PAGS_TRY(read_exposure(image, where, &im->exposures[photo]));
  exposure_pose(&im->exposures[photo], im->ego_poses + 12 * frame, ego);
  pags_rigid_multiply(ego, im->ego_from_camera[index], pose);
  PAGS_TRY(pags_layout_put_extrinsics(&im->layout, frame, camera->number, pose));
  PAGS_TRY(
      pags_layout_put_file(&im->layout, "images", frame, camera->number, ".jpg", image->image.data, image->image.len));
  PAGS_TRY(pags_waymo_put_semantic(&im->layout, image, frame, camera, where, &labelled));
  im->labelled += labelled;
  return PAGS_OK;
}

static pags_result read_frame(importer *im, const pags_waymo_frame *message, int64_t frame, const char *where) {
  PAGS_AUTO(pags_waymo_points_destroy) pags_waymo_points points = {0};
  double *pose = im->ego_poses + 12 * frame;
  const char *name = message->context && message->context->name ? message->context->name : "";
  if (strncmp(name, im->context, sizeof im->context - 1) != 0)
    return pags_fail_at(where, "belongs to segment '%.200s', the file begins with '%s'", name, im->context);
  im->times[frame] = (double)message->timestamp_micros * 1e-6;
  if (frame && !(im->times[frame] > im->times[frame - 1]))
    return pags_fail_at(where, "its time is %.6f s, not after the %.6f s of the frame before", im->times[frame],
                        im->times[frame - 1]);
  PAGS_TRY(pags_waymo_transform(message->pose, where, "pose of the frame", pose));
  PAGS_TRY(pags_layout_put_ego_pose(&im->layout, frame, pose));
  for (int c = 0; c < im->info.camera_count; c++)
    PAGS_TRY(read_image(im, message, frame, c, where));
  const bool done = pags_layout_has(&im->layout, "lidar", frame, -1, ".bin");
  if (!done)
    PAGS_TRY(pags_waymo_lidar_points(message, where, &points));
  if (points.count)
    PAGS_TRY(pags_layout_put_lidar(&im->layout, frame, points.count, points.rows));
  im->sweeps += done || points.count;
  return pags_waymo_boxes_add(&im->boxes, message, frame, im->times[frame], pose, where);
}

/* ---- Reading the file ---- */

static pags_result count_records(const char *source, int64_t *count) {
  PAGS_AUTO(pags_tfrecord_close_auto) pags_tfrecord *reader = NULL;
  int end = 0;
  if (pags_dir_exists(source)) {
    PAGS_TRY(pags_unsupported_recording_check(source, false));
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: is a folder, expected one segment's .tfrecord file", source);
  }
  PAGS_TRY(pags_tfrecord_open(source, &reader));
  for (*count = 0;; ++*count) {
    const pags_result result = pags_tfrecord_skip(reader, &end);
    /* Report what a file is that begins with no record, if that is known; else keep the message that there is. */
    if (result == PAGS_ERROR_FORMAT && *count == 0 && pags_unsupported_recording_check(source, false) != PAGS_OK) {
      char message[WHERE];
      snprintf(message, sizeof message, "%s", pags_error_message());
      return pags_fail(PAGS_ERROR_FORMAT, "%.900s; expected an uncompressed TFRecord file of Waymo Open v1", message);
    }
    PAGS_TRY(result);
    if (end)
      break;
  }
  return *count ? PAGS_OK : pags_fail_at(source, "expected a TFRecord file of Waymo frames, found no record");
}

/* Begins the import with the first frame, whose calibration applies to the whole segment. */
static pags_result begin(importer *im, const pags_waymo_frame *first, const char *where, const char *folder,
                         bool overwrite) {
  if (first->context && first->context->name)
    snprintf(im->context, sizeof im->context, "%s", first->context->name);
  pags_tally others = {0};
  for (int name = 1, c = 0; name <= PAGS_WAYMO_CAMERAS; name++) {
    if (c < im->info.camera_count && im->numbers[c] == name - 1)
      c++;
    else if (pags_waymo_image(first, name))
      pags_tally_add(&others, "%d, %s", name - 1, pags_waymo_camera_name(name));
  }
  pags_account_leave_out(&im->account, "cameras", &others, "--cameras takes them");
  for (int c = 0; c < im->info.camera_count; c++)
    PAGS_TRY(read_camera(im, first, c, where));
  const size_t frames = (size_t)im->info.frame_count; /* each takes at least 16 bytes of the file */
  const size_t cameras = (size_t)im->info.camera_count;
  im->times = calloc(frames, sizeof *im->times);
  im->ego_poses = calloc(frames, 12 * sizeof *im->ego_poses);
  im->exposures = calloc(frames, cameras * sizeof *im->exposures);
  im->camera_poses = calloc(frames, cameras * 12 * sizeof *im->camera_poses);
  PAGS_CHECK_MEMORY(im->times && im->ego_poses && im->exposures && im->camera_poses, "%s: %zu frames", im->source,
                    frames);
  PAGS_TRY(pags_layout_begin(&im->layout, folder, &im->info, overwrite));
  for (int c = 0; c < im->info.camera_count; c++)
    PAGS_TRY(pags_layout_put_extrinsics(&im->layout, -1, im->cameras[c].number, im->ego_from_camera[c]));
  return PAGS_OK;
}

static pags_result read_records(importer *im, const char *folder, bool overwrite) {
  PAGS_AUTO(pags_tfrecord_close_auto) pags_tfrecord *reader = NULL;
  PAGS_TRY(pags_tfrecord_open(im->source, &reader));
  int end;
  for (int64_t i = 0; i < im->info.first_frame; i++)
    PAGS_TRY(pags_tfrecord_skip(reader, &end));
  for (int64_t frame = 0; frame < im->info.frame_count; frame++) {
    char where[WHERE];
    pags_tfrecord_item item;
    PAGS_AUTO(pags_waymo_free_frame_auto) pags_waymo_frame *message = NULL;
    PAGS_TRY(report(im, 0.7 * pags_tfrecord_fraction(reader), "frames"));
    PAGS_TRY(pags_tfrecord_next(reader, &item));
    if (!item.data)
      return pags_fail(PAGS_ERROR_IO, "%s: has become shorter", im->source);
    snprintf(where, WHERE, "%s: record %lld at byte %llu", im->source, (long long)item.number,
             (unsigned long long)item.offset);
    PAGS_TRY(pags_waymo_unpack_frame(item.data, item.size, where, &message));
    if (frame == 0)
      PAGS_TRY(begin(im, message, where, folder, overwrite));
    if (pags_layout_is_finished(&im->layout))
      return PAGS_OK;
    PAGS_TRY(read_frame(im, message, frame, where));
  }
  return PAGS_OK;
}

/* Removes a folder of the layout whose content this segment doesn't have. */
static pags_result drop_folder(const importer *im, const char *name) {
  PAGS_AUTOFREE char *path = pags_path_join(im->layout.folder, name);
  PAGS_CHECK_MEMORY(path, "%s", im->source);
  return pags_remove_tree(path);
}

/* ---- Masks ---- */

typedef struct mask_job {
  const importer *im;
  pags_waymo_lens lenses[PAGS_WAYMO_CAMERAS];
  int64_t first; /* photograph at index 0 of the parallel loop */
} mask_job;

static void destroy_lenses(mask_job *job) {
  for (int c = 0; c < PAGS_WAYMO_CAMERAS; c++)
    pags_waymo_lens_destroy(&job->lenses[c]);
}

static pags_result put_mask(void *context, int64_t item, PAGS_UNUSED int worker) {
  const mask_job *job = context;
  const importer *im = job->im;
  const int64_t photo = job->first + item, frame = photo / im->info.camera_count;
  const int index = (int)(photo % im->info.camera_count);
  const pags_waymo_lens *lens = &job->lenses[index];
  pags_camera camera = lens->pinhole;
  memcpy(camera.world_from_camera, im->camera_poses + 12 * photo, sizeof camera.world_from_camera);
  return pags_layout_put_dynamic_masks_through(&im->layout, frame, im->cameras[index].number, &camera,
                                               lens->source ? &lens->lens : NULL, im->tracks, im->track_count);
}

static pags_result put_masks(const importer *im) {
  const int64_t photos = im->info.frame_count * im->info.camera_count;
  const int64_t step = 4 * (int64_t)pags_tasks_workers(im->tasks);
  PAGS_AUTO(destroy_lenses) mask_job job = {.im = im};
  for (int c = 0; c < im->info.camera_count; c++)
    PAGS_TRY(pags_waymo_lens_make(&im->cameras[c], im->source, im->tasks, &job.lenses[c]));
  for (; job.first < photos; job.first += step) {
    PAGS_TRY(report(im, 0.7 + 0.3 * (double)job.first / (double)photos, "masks"));
    const int64_t count = photos - job.first < step ? photos - job.first : step;
    PAGS_TRY(pags_parallel_try(im->tasks, count, put_mask, &job, "cancelled"));
  }
  return PAGS_OK;
}

/* ---- Finishing ---- */

static void log_findings(importer *im) {
  const long long frames = im->info.frame_count;
  const pags_leaps leaps = pags_find_leaps((const double(*)[12])im->ego_poses, im->times, im->info.frame_count);
  if (leaps.count)
    PAGS_WARN(
        "%s: %lld of %lld steps between poses leap; the first is from frame %lld to %lld, %.2f m and %.1f degrees off "
        "in %.2f s",
        im->source, (long long)leaps.count, frames - 1, (long long)leaps.first, (long long)leaps.first + 1,
        leaps.metres, leaps.degrees, leaps.seconds);
  const pags_tally dark = {.count = im->sweeps ? frames - im->sweeps : 0};
  pags_account_leave_out(&im->account, "sweeps", &dark, "the frames have no LiDAR");
  if (!im->sweeps)
    pags_account_lacks(&im->account, "sweeps", "no frame has LiDAR");
  pags_account_leave_out(&im->account, "boxes", &im->boxes.unusable, "no id, no size or numbers that aren't finite");
  if (!im->boxes.count)
    pags_account_lacks(&im->account, "boxes", "no frame has labels");
  if (im->sweeps < frames)
    PAGS_WARN("%s: %lld of %lld frames have no LiDAR", im->source, frames - (long long)im->sweeps, frames);
  if (!im->boxes.count)
    PAGS_WARN("%s: no boxes: no instances and no dynamic masks are written", im->source);
  if (im->boxes.unusable.count)
    PAGS_WARN("%s: %lld boxes without id, size or finite numbers were left out; the first is %s", im->source,
              (long long)im->boxes.unusable.count, im->boxes.unusable.first);
  if (im->boxes.renamed.count)
    PAGS_WARN(
        "%s: %lld ids belong to things of several classes, each of which became an object of its own; the first is %s",
        im->source, (long long)im->boxes.renamed.count, im->boxes.renamed.first);
  pags_log_message(PAGS_LOG_INFO, "%s: %lld of %lld photographs have panoptic labels", im->source,
                   (long long)im->labelled, frames * im->info.camera_count);
}

static pags_result finish(importer *im) {
  if (pags_layout_is_finished(&im->layout)) {
    report(im, 1, "done");
    return PAGS_OK;
  }
  if (im->boxes.count) {
    PAGS_TRY(pags_waymo_boxes_tracks(&im->boxes, im->source, &im->tracks, &im->track_count));
    PAGS_TRY(pags_layout_put_instances(&im->layout, im->tracks, im->track_count));
    PAGS_TRY(put_masks(im));
  } else if (im->boxes.unusable.count)
    return pags_fail_at(im->source, "%lld boxes, but none has an id, a size and finite numbers; the first is %s",
                        (long long)im->boxes.unusable.count, im->boxes.unusable.first);
  else {
    PAGS_TRY(drop_folder(im, "instances"));
    PAGS_TRY(drop_folder(im, "dynamic_masks"));
  }
  if (!im->sweeps) {
    im->info.lidar_columns = NULL;
    PAGS_TRY(drop_folder(im, "lidar"));
  }
  const int64_t steps = im->info.frame_count - 1;
  if (steps > 0)
    im->info.fps = pags_round(100 * (double)steps / (im->times[steps] - im->times[0])) / 100;
  log_findings(im);
  PAGS_TRY(pags_layout_put_account(&im->layout, &im->account, im->tracks, im->track_count));
  const pags_layout_times times = {.frames = im->times, .exposures = im->exposures};
  PAGS_TRY(pags_layout_finish(&im->layout, &times));
  report(im, 1, "done"); /* the return value is ignored, as nothing is left to cancel */
  return PAGS_OK;
}

static void destroy(importer *im) {
  for (int64_t i = 0; i < im->track_count; i++)
    pags_layout_track_destroy(&im->tracks[i]);
  free(im->tracks);
  pags_waymo_boxes_destroy(&im->boxes);
  pags_layout_destroy(&im->layout);
  free(im->times);
  free(im->ego_poses);
  free(im->exposures);
  free(im->camera_poses);
}

pags_result pags_import_waymo(const char *source, const char *folder, const pags_import_options *options,
                              pags_tasks *tasks, pags_progress_fn *progress, void *user) {
  assert(source && folder && tasks);
  const pags_import_options chosen = options ? *options : pags_import_options_default();
  PAGS_AUTO(destroy) importer im = {.source = source, .tasks = tasks, .progress = progress, .user = user};
  im.info = (pags_layout_info){.kind = "waymo",
                               .source = source,
                               .fps = 10, /* the rate of Waymo's LiDAR */
                               .cameras = im.cameras,
                               .lidar_columns = lidar_columns,
                               .extrinsics_per_frame = true,
                               .extrinsics_from_world = true};
  int64_t records, last;
  PAGS_TRY(pags_import_cameras(chosen.cameras, PAGS_WAYMO_CAMERAS, 3, im.numbers, &im.info.camera_count));
  PAGS_TRY(count_records(source, &records));
  PAGS_TRY(pags_import_frames(&chosen, records, &im.info.first_frame, &last));
  im.info.frame_count = last - im.info.first_frame + 1;
  const pags_tally others = {.count = records - im.info.frame_count};
  pags_account_leave_out(&im.account, "time steps", &others, "--frames chose others");
  PAGS_TRY(read_records(&im, folder, chosen.overwrite));
  return finish(&im);
}
