/* SPDX-License-Identifier: Apache-2.0 */
/* Imports KITTI data (tracking benchmark and raw recordings) into drivestudio's processed layout.
 *
 * The world frame is east, north, up in metres; its origin is the position of the Velodyne LiDAR in frame 0 of the
 * sequence, whichever frames are imported. The ego frame is that of the Velodyne, so that sweeps are copied
 * unchanged. Poses are computed from oxts as in KITTI's development kit and then transformed by Tr_imu_to_velo. */
#include <math.h>
#include <pags/image.h>
#include <pags/import.h>
#include <stdio.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/text.h"
#include "base/vec3.h"
#include "dataset/driving/motion.h"
#include "dataset/driving/writer.h"
#include "import/kitti_files.h"
#include "import/kitti_tracks.h"
#include "import/kitti_tree.h"
#include "port/port.h"

enum { CAMERAS = 2 };

static const char *const lidar_columns[] = {"x", "y", "z", "reflectance", NULL};
static const char *const camera_names[CAMERAS] = {"left", "right"};

typedef struct importer {
  pags_kitti_tree tree;
  pags_kitti_calib calib;
  int64_t count;                 /* number of imported frames */
  double *oxts;                  /* PAGS_KITTI_OXTS values per frame */
  double (*world_from_velo)[12]; /* one per frame */
  double *times;                 /* one per frame, seconds */
  pags_layout_exposure *exposures;
  double *sweep_times; /* begin and end of each sweep, seconds; NULL: unknown */
  pags_place place;
  pags_kitti_form form; /* of the sweeps */
  pags_kitti_tracks tracks;
  pags_layout_camera cameras[CAMERAS];
  double velo_from_camera[CAMERAS][12];
  char *source;
  pags_layout_info info;
  pags_layout layout;
} importer;

static void destroy(importer *im) {
  pags_kitti_tree_close(&im->tree);
  free(im->oxts);
  free(im->world_from_velo);
  free(im->times);
  free(im->exposures);
  free(im->sweep_times);
  pags_kitti_tracks_destroy(&im->tracks);
  free(im->source);
  pags_layout_destroy(&im->layout);
}

static pags_result no_memory(const importer *im) {
  return pags_out_of_memory("%s: %lld frames", im->tree.root, (long long)im->count);
}

/* ---- Poses ---- */

/* Reads the row of the sequence's first frame, and those of the imported frames to im->oxts: in the tracking benchmark
 * from the file of all frames, in raw recordings from a file per frame. */
static pags_result read_oxts(importer *im, double first[PAGS_KITTI_OXTS]) {
  const bool raw = im->tree.raw;
  const size_t size = PAGS_KITTI_OXTS * sizeof *first;
  for (int64_t t = -1; t < (raw ? im->count : 0); t++) {
    PAGS_AUTO(pags_kitti_table_destroy) pags_kitti_table table = {0};
    PAGS_AUTOFREE char *path = pags_kitti_oxts_path(&im->tree, t < 0 ? 0 : im->tree.first + t);
    PAGS_TRY(path ? pags_kitti_table_read(path, PAGS_KITTI_OXTS, &table) : no_memory(im));
    if (raw && table.rows != 1)
      return pags_fail_at(path, "expected one line, found %lld", (long long)table.rows);
    if (!raw && table.rows < im->tree.frames)
      return pags_fail_at(path, "expected a line for each of %lld frames, found %lld", (long long)im->tree.frames,
                          (long long)table.rows);
    memcpy(t < 0 ? first : im->oxts + t * PAGS_KITTI_OXTS, table.values, size);
    if (!raw)
      memcpy(im->oxts, table.values + im->tree.first * PAGS_KITTI_OXTS, (size_t)im->count * size);
  }
  return PAGS_OK;
}

/* Computes world_from_velo of each frame and the place of the world on the earth from the oxts rows. */
static pags_result compute_poses(importer *im) {
  double first[PAGS_KITTI_OXTS], imu_from_velo[12], origin[12];
  if (!im->calib.has_imu)
    return pags_fail(PAGS_ERROR_FORMAT, "%s/calib/%s.txt: expected a line 'Tr_imu_to_velo:'", im->tree.root,
                     im->tree.sequence);
  PAGS_TRY(read_oxts(im, first));
  const double scale = pags_kitti_oxts_scale(first);
  pags_rigid_inverse(im->calib.velo_from_imu, imu_from_velo);
  pags_kitti_oxts_pose(first, scale, origin);
  pags_rigid_multiply(origin, imu_from_velo, origin);
  const double zero[3] = {origin[3], origin[7], origin[11]};
  im->place = pags_kitti_place(zero, scale);
  for (int64_t t = 0; t < im->count; t++) {
    double *pose = im->world_from_velo[t];
    pags_kitti_oxts_pose(im->oxts + t * PAGS_KITTI_OXTS, scale, pose);
    pags_rigid_multiply(pose, imu_from_velo, pose);
    for (int i = 3; i < 12; i += 4) {
      pose[i] -= origin[i];
      if (!isfinite(pose[i]))
        return pags_fail_at(im->tree.root, "the position of frame %lld is not finite (latitude %g)",
                            (long long)(im->tree.first + t), im->oxts[t * PAGS_KITTI_OXTS + PAGS_OXTS_LAT]);
    }
  }
  return PAGS_OK;
}

/* Computes the velocity of the Velodyne at frame t, linear along world axes, angular along its own: the velocity of
 * the IMU plus angular velocity x lever arm from the IMU to the Velodyne. */
static void compute_velocity(const importer *im, int64_t t, double out[6]) {
  const double *row = im->oxts + t * PAGS_KITTI_OXTS, *w = row + PAGS_OXTS_WX;
  const double v[3] = {row[PAGS_OXTS_VE], row[PAGS_OXTS_VN], row[PAGS_OXTS_VU]};
  double imu_from_velo[12], pose[12], lever[3], turn[3];
  pags_rigid_inverse(im->calib.velo_from_imu, imu_from_velo);
  pags_kitti_oxts_pose(row, 1, pose);
  pags_pose_position(imu_from_velo, lever);
  pags_cross3(w, lever, turn);
  for (int i = 0; i < 3; i++)
    out[i] = v[i] + pose[4 * i] * turn[0] + pose[4 * i + 1] * turn[1] + pose[4 * i + 2] * turn[2];
  pags_rotate3(im->calib.velo_from_imu, w, out + 3);
}

/* ---- Times ---- */

/* Fills in the times that were lost (NaN): on the line through the known ones before and after, or through the two
 * nearest at an end. Returns the number of the first one; -1 if none was lost. */
static int64_t fill_times(double *times, int64_t count) {
  int64_t first = -1;
  for (int64_t t = 0; t < count; t++) {
    if (!isnan(times[t]))
      continue;
    first = first < 0 ? t : first;
    int64_t before = t - 1, behind = t + 1; /* all times before t are known or filled in */
    while (behind < count && isnan(times[behind]))
      behind++;
    int64_t from = before, to = behind;
    if (before < 0) {
      for (from = behind, to = from + 1; to < count && isnan(times[to]);)
        to++;
    } else if (behind >= count)
      from = before - 1, to = before;
    if (from >= 0 && to < count)
      times[t] = times[from] + (times[to] - times[from]) * (double)(t - from) / (double)(to - from);
  }
  return first;
}

/* Reads the times of the imported frames from a file of times into out[0], out[stride], ... The times of photographs
 * must be there, but for empty lines, which are filled in; those of lost sweeps may be missing and are NaN. */
static pags_result read_times(const importer *im, const char *name, bool sweeps, double *out, int stride) {
  int64_t count;
  PAGS_AUTOFREE double *all = NULL;
  PAGS_AUTOFREE char *path = pags_path_join(im->tree.root, name);
  PAGS_TRY(path ? pags_kitti_times_read(path, &count, &all) : no_memory(im));
  if (!sweeps) {
    int64_t lost = 0;
    for (int64_t t = 0; t < count; t++)
      lost += isnan(all[t]) ? 1 : 0;
    const int64_t known = count - lost, first = fill_times(all, count);
    if (count < im->tree.frames || (lost && known < 2))
      return pags_fail_at(path, "expected a time for each of %lld frames, found %lld", (long long)im->tree.frames,
                          (long long)known);
    if (lost)
      PAGS_WARN("%s: %lld of %lld times are empty lines and were filled in; the first is frame %lld's", path,
                (long long)lost, (long long)count, (long long)first);
  }
  for (int64_t t = 0; t < im->count; t++)
    out[t * stride] = im->tree.first + t < count ? all[im->tree.first + t] : (double)NAN;
  return PAGS_OK;
}

/* Sets the times of frames, photographs and sweeps. The time of a frame is that of its first camera's photograph; the
 * Velodyne triggers all cameras when it faces forward. */
static pags_result set_times(importer *im) {
  const int cameras = im->tree.camera_count;
  for (int64_t t = 0; t < im->count; t++) {
    im->times[t] = (double)(im->tree.first + t) / 10; /* the tracking benchmark has no times: 10 Hz */
    for (int c = 0; c < cameras; c++) {
      im->exposures[t * cameras + c] = pags_layout_exposure_unknown();
      compute_velocity(im, t, im->exposures[t * cameras + c].velocity);
    }
  }
  if (!im->tree.raw)
    return PAGS_OK;
  for (int c = cameras - 1; c >= 0; c--) {
    char name[40];
    snprintf(name, sizeof name, "image_%02d/timestamps.txt", im->tree.cameras[c] + 2);
    PAGS_TRY(read_times(im, name, false, im->times, 1));
    for (int64_t t = 0; t < im->count; t++)
      im->exposures[t * cameras + c].time = im->times[t];
  }
  for (int64_t t = 1; t < im->count; t++)
    if (!(im->times[t] > im->times[t - 1]))
      return pags_fail(PAGS_ERROR_FORMAT, "%s/image_%02d/timestamps.txt:%lld: expected a time after the line before",
                       im->tree.root, im->tree.cameras[0] + 2, (long long)(im->tree.first + t + 1));
  static const char *const sweeps[2] = {"velodyne_points/timestamps_start.txt", "velodyne_points/timestamps_end.txt"};
  if (!im->tree.has_points || !pags_folder_has(im->tree.root, sweeps[0]) || !pags_folder_has(im->tree.root, sweeps[1]))
    return PAGS_OK;
  im->sweep_times = malloc((size_t)im->count * 2 * sizeof *im->sweep_times);
  PAGS_TRY(im->sweep_times ? read_times(im, sweeps[0], true, im->sweep_times, 2) : no_memory(im));
  return read_times(im, sweeps[1], true, im->sweep_times + 1, 2);
}

/* Warns of poses that no car takes, and of positions that the receiver itself calls rough: 5 m and more. */
static void check_motion(const importer *im) {
  pags_tally rough = {0};
  const long long first = (long long)im->tree.first, count = (long long)im->count;
  const pags_leaps leaps = pags_find_leaps((const double(*)[12])im->world_from_velo, im->times, im->count);
  for (int64_t t = 0; t < im->count; t++) {
    const double accuracy = im->oxts[t * PAGS_KITTI_OXTS + PAGS_OXTS_ACCURACY];
    if (accuracy >= 5)
      pags_tally_add(&rough, "frame %lld, %g m", first + (long long)t, accuracy);
  }
  if (leaps.count)
    PAGS_WARN(
        "%s: %lld of %lld steps between poses leap (oxts may be wrong there); the first is from frame %lld to "
        "%lld, %.2f m and %.1f degrees off in %.2f s",
        im->tree.root, (long long)leaps.count, count - 1, first + (long long)leaps.first,
        first + (long long)leaps.first + 1, leaps.metres, leaps.degrees, leaps.seconds);
  if (rough.count)
    PAGS_WARN("%s: oxts says of %lld of %lld frames that the position is known to 5 m or worse; the first is %s",
              im->tree.root, (long long)rough.count, count, rough.first);
}

/* ---- Sweeps ---- */

/* Finds the form of the sweeps by the first and the last one that have points. The last one is the farther from the
 * world's origin, where the world's axes show. */
static pags_result find_form(importer *im) {
  pags_tally empty = {0};
  PAGS_AUTOFREE char *first = NULL, *last = NULL;
  for (int64_t frame = im->tree.first; im->tree.has_points && frame <= im->tree.last; frame++) {
    uint64_t size = 0;
    PAGS_AUTOFREE char *path = pags_kitti_points_path(&im->tree, frame);
    PAGS_TRY(path ? PAGS_OK : no_memory(im));
    if (!pags_file_exists(path))
      continue;
    PAGS_TRY(pags_file_size(path, &size));
    char **end = first ? &last : &first;
    if (size == 0)
      pags_tally_add(&empty, "%s", path);
    else {
      free(*end);
      *end = pags_take(&path);
    }
  }
  pags_account_leave_out(&im->tree.account, "sweeps", &empty, "the files are empty");
  if (empty.count)
    PAGS_WARN("%s: %lld of %lld sweeps are empty files and are left out; the first is %s", im->tree.root,
              (long long)empty.count, (long long)im->count, empty.first);
  if (!first)
    return !empty.count
               ? PAGS_OK
               : pags_fail_at(im->tree.root, "%lld sweeps in these frames, but all are empty files; the first is %s",
                              (long long)empty.count, empty.first);
  PAGS_TRY(pags_kitti_form_find(first, &im->form));
  if (last) {
    pags_kitti_form other;
    PAGS_TRY(pags_kitti_form_find(last, &other));
    if (other.columns != im->form.columns || other.width != im->form.width || other.scale != im->form.scale)
      return pags_fail_at(last, "has rows of another form than %s", first);
  }
  if (!pags_kitti_form_is_usual(&im->form))
    PAGS_WARN("%s: taken for rows of %d %s in %s, as all other sweeps; KITTI's have 4 floats in metres", first,
              im->form.columns, im->form.width == 8 ? "doubles" : "floats",
              im->form.scale == 1 ? "metres" : "millimetres");
  return PAGS_OK;
}

/* ---- Cameras, boxes and the description of the set ---- */

/* The calibration holds for pictures of KITTI's size. Pictures that were resized or cut need the original ones. */
static pags_result check_size(const importer *im, const pags_layout_camera *camera, const char *path) {
  const double *size = im->calib.size[camera->number + 2];
  const double x = camera->intrinsics[2] / camera->width, y = camera->intrinsics[3] / camera->height;
  if (size[0] > 0 && (fabs(size[0] - camera->width) > 0.5 || fabs(size[1] - camera->height) > 0.5))
    return pags_fail_at(path,
                        "has %d x %d pixels, expected %g x %g as S_rect_%02d of the calibration says; the original "
                        "pictures are needed",
                        camera->width, camera->height, size[0], size[1], camera->number + 2);
  if (!(x > 0.25 && x < 0.75 && y > 0.1 && y < 0.9))
    return pags_fail_at(path,
                        "has %d x %d pixels, but the calibration's principal point is %.1f, %.1f, far from its "
                        "middle; pictures that were resized or cut need the original ones",
                        camera->width, camera->height, camera->intrinsics[2], camera->intrinsics[3]);
  return PAGS_OK;
}

static pags_result set_cameras(importer *im) {
  double velo_from_cam0[12];
  pags_rigid_inverse(im->calib.cam0_from_velo, velo_from_cam0);
  for (int c = 0; c < im->tree.camera_count; c++) {
    const int number = im->tree.cameras[c];
    pags_layout_camera *camera = &im->cameras[c];
    *camera = (pags_layout_camera){.number = number, .name = camera_names[number], .rolling_shutter = "none"};
    double pose[12];
    PAGS_TRY(pags_kitti_camera(&im->calib, number + 2, camera->intrinsics, pose));
    pags_rigid_multiply(velo_from_cam0, pose, im->velo_from_camera[c]);
    PAGS_AUTOFREE char *path = pags_kitti_image_path(&im->tree, number, im->tree.first);
    PAGS_TRY(path ? pags_image_size(path, &camera->width, &camera->height) : no_memory(im));
    PAGS_TRY(check_size(im, camera, path));
  }
  return PAGS_OK;
}

static pags_result read_tracks(importer *im) {
  const pags_kitti_span span = {
      im->tree.first,   im->tree.last, im->tree.frames, im->times, (const double(*)[12])im->world_from_velo,
      &im->tree.account};
  if (!im->tree.has_labels)
    return PAGS_OK;
  PAGS_AUTO(pags_kitti_tracklets_destroy) pags_kitti_tracklets tracklets = {0};
  PAGS_AUTO(pags_kitti_labels_destroy) pags_kitti_labels labels = {0};
  PAGS_AUTOFREE char *path = pags_kitti_labels_path(&im->tree);
  PAGS_TRY(path ? PAGS_OK : no_memory(im));
  if (im->tree.raw) {
    PAGS_TRY(pags_kitti_tracklets_read(path, &tracklets));
    return pags_kitti_tracks_from_tracklets(path, &tracklets, &span, &im->tracks);
  }
  PAGS_TRY(pags_kitti_labels_read(path, true, &labels));
  return pags_kitti_tracks_from_labels(path, &labels, im->calib.cam0_from_velo, &span, &im->tracks);
}

static pags_result set_info(importer *im) {
  PAGS_AUTOFREE char *full = pags_port_real_path(im->tree.root);
  if (full)
    im->source = pags_text_format(im->tree.raw ? "%s" : "%s, sequence %s", full, im->tree.sequence);
  if (!im->source)
    return no_memory(im);
  const int64_t steps = im->count - 1;
  im->info = (pags_layout_info){.kind = "kitti",
                                .source = im->source,
                                .fps = im->tree.raw && steps ? (double)steps / (im->times[steps] - im->times[0]) : 10,
                                .place = im->place,
                                .frame_count = im->count,
                                .first_frame = im->tree.first,
                                .camera_count = im->tree.camera_count,
                                .cameras = im->cameras,
                                .lidar_columns = im->tree.has_points ? lidar_columns : NULL};
  return PAGS_OK;
}

static pags_result prepare(importer *im) {
  im->count = im->tree.last - im->tree.first + 1;
  im->oxts = malloc((size_t)im->count * PAGS_KITTI_OXTS * sizeof *im->oxts);
  im->world_from_velo = malloc((size_t)im->count * sizeof *im->world_from_velo);
  im->times = malloc((size_t)im->count * sizeof *im->times);
  im->exposures = malloc((size_t)(im->count * im->tree.camera_count) * sizeof *im->exposures);
  PAGS_AUTOFREE char *calib = pags_kitti_calib_path(&im->tree);
  if (!im->oxts || !im->world_from_velo || !im->times || !im->exposures || !calib)
    return no_memory(im);
  PAGS_TRY(im->tree.raw ? pags_kitti_calib_read_raw(calib, &im->calib) : pags_kitti_calib_read(calib, &im->calib));
  PAGS_TRY(compute_poses(im));
  PAGS_TRY(set_times(im));
  check_motion(im);
  PAGS_TRY(find_form(im));
  PAGS_TRY(set_cameras(im));
  PAGS_TRY(read_tracks(im));
  return set_info(im);
}

/* ---- Frames ---- */

static pags_result put_image(const importer *im, int64_t t, int c) {
  const pags_layout_camera *camera = &im->cameras[c];
  PAGS_AUTOFREE char *path = pags_kitti_image_path(&im->tree, camera->number, im->tree.first + t);
  int width = 0, height = 0;
  PAGS_TRY(path ? pags_image_size(path, &width, &height) : no_memory(im));
  if (width != camera->width || height != camera->height)
    return pags_fail_at(path, "has %d x %d pixels, the first photograph of this camera %d x %d", width, height,
                        camera->width, camera->height);
  PAGS_TRY(pags_layout_copy_image(&im->layout, t, camera->number, path));
  if (!im->tree.has_labels)
    return PAGS_OK;
  const double *k = camera->intrinsics;
  pags_camera view = {.width = camera->width,
                      .height = camera->height,
                      .fx = k[0],
                      .fy = k[1],
                      .cx = k[2],
                      .cy = k[3],
                      .time = im->times[t]};
  pags_rigid_multiply(im->world_from_velo[t], im->velo_from_camera[c], view.world_from_camera);
  return pags_layout_put_dynamic_masks(&im->layout, t, camera->number, &view, im->tracks.items, im->tracks.count);
}

static pags_result put_sweep(const importer *im, int64_t t) {
  int64_t count;
  PAGS_AUTOFREE float *points = NULL;
  if (!im->tree.has_points || pags_layout_has(&im->layout, "lidar", t, -1, ".bin"))
    return PAGS_OK;
  PAGS_AUTOFREE char *path = pags_kitti_points_path(&im->tree, im->tree.first + t);
  PAGS_TRY(path ? PAGS_OK : no_memory(im));
  if (!pags_file_exists(path))
    return PAGS_OK;
  PAGS_TRY(pags_kitti_points_read(path, &im->form, &count, &points));
  return count ? pags_layout_put_lidar(&im->layout, t, count, points) : PAGS_OK;
}

typedef struct batch {
  const importer *im;
  int64_t first;
} batch;

static pags_result put_frame(void *context, int64_t item, PAGS_UNUSED int worker) {
  const batch *b = context;
  const int64_t t = b->first + item;
  PAGS_TRY(pags_layout_put_ego_pose(&b->im->layout, t, b->im->world_from_velo[t]));
  for (int c = 0; c < b->im->tree.camera_count; c++)
    PAGS_TRY(put_image(b->im, t, c));
  return put_sweep(b->im, t);
}

static pags_result run(importer *im, const char *folder, bool overwrite, pags_tasks *tasks, pags_progress_fn *progress,
                       void *user) {
  const pags_layout_times times = {im->times, im->exposures, im->sweep_times};
  PAGS_TRY(pags_layout_begin(&im->layout, folder, &im->info, overwrite));
  if (pags_layout_is_finished(&im->layout))
    return PAGS_OK;
  for (int c = 0; c < im->tree.camera_count; c++)
    PAGS_TRY(pags_layout_put_extrinsics(&im->layout, -1, im->cameras[c].number, im->velo_from_camera[c]));
  enum { BATCH = 8 }; /* frames per worker between two calls of the progress function */
  const int64_t size = BATCH * (int64_t)pags_tasks_workers(tasks);
  for (batch b = {.im = im}; b.first < im->count; b.first += size) {
    const int64_t left = im->count - b.first < size ? im->count - b.first : size;
    if (progress && !progress(user, (double)b.first / (double)im->count, "frames"))
      return pags_fail(PAGS_CANCELLED, "import cancelled");
    PAGS_TRY(pags_parallel_try(tasks, left, put_frame, &b, "import cancelled"));
  }
  if (im->tree.has_labels)
    PAGS_TRY(pags_layout_put_instances(&im->layout, im->tracks.items, im->tracks.count));
  PAGS_TRY(pags_layout_put_account(&im->layout, &im->tree.account, im->tracks.items, im->tracks.count));
  PAGS_TRY(pags_layout_finish(&im->layout, &times));
  if (progress)
    progress(user, 1, "frames");
  return PAGS_OK;
}

pags_result pags_import_kitti(const char *source, const char *folder, const pags_import_options *options,
                              pags_tasks *tasks, pags_progress_fn *progress, void *user) {
  PAGS_AUTO(destroy) importer im = {0};
  const pags_import_options chosen = options ? *options : pags_import_options_default();
  PAGS_TRY(pags_kitti_tree_open(source, &chosen, &im.tree));
  PAGS_TRY(prepare(&im));
  return run(&im, folder, chosen.overwrite, tasks, progress, user);
}
