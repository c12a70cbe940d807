/* SPDX-License-Identifier: Apache-2.0 */
/* Writes KITTI's files as its development kits describe them; see raw_kitti.h. */
#include "raw_kitti.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/file.h"

static const double pi = 3.14159265358979323846;
enum { LAT, LON, ALT, ROLL, PITCH, YAW, VN, VE, VF, VL, VU, WX = 17, OXTS = 30 };

/* ---- Text files ---- */

typedef struct out_file {
  char *text;
  size_t size, capacity;
} out_file;

static void put(out_file *f, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void put(out_file *f, const char *format, ...) {
  char piece[512];
  va_list arguments;
  va_start(arguments, format);
  const int length = vsnprintf(piece, sizeof piece, format, arguments);
  va_end(arguments);
  assert(length >= 0 && (size_t)length < sizeof piece);
  if (f->size + (size_t)length + 1 > f->capacity) {
    f->capacity = 2 * f->capacity + 4096;
    f->text = realloc(f->text, f->capacity);
    if (!f->text)
      abort();
  }
  memcpy(f->text + f->size, piece, (size_t)length + 1);
  f->size += (size_t)length;
}

static pags_result write_bytes(const char *folder, const char *name, const void *bytes, size_t size) {
  char *path = pags_path_join(folder, name);
  char *parent = pags_path_folder(path);
  pags_result result = pags_make_dirs(parent);
  if (result == PAGS_OK)
    result = pags_file_write(path, bytes, size);
  free(parent);
  free(path);
  return result;
}

static pags_result save(out_file *f, const char *folder, const char *name) {
  const pags_result result = write_bytes(folder, name, f->text ? f->text : "", f->size);
  free(f->text);
  *f = (out_file){0};
  return result;
}

static pags_result copy(const char *from, const char *folder, const char *name) {
  uint8_t *bytes;
  size_t size;
  PAGS_TRY(pags_file_read(from, &bytes, &size));
  const pags_result result = write_bytes(folder, name, bytes, size);
  free(bytes);
  return result;
}

/* ---- Geometry ---- */

/* R = Rz(yaw) Ry(pitch) Rx(roll). */
static void rotate(double roll, double pitch, double yaw, const double t[3], double out[12]) {
  const double cx = cos(roll), sx = sin(roll), cy = cos(pitch), sy = sin(pitch), cz = cos(yaw), sz = sin(yaw);
  const double m[12] = {cz * cy,
                        cz * sy * sx - sz * cx,
                        cz * sy * cx + sz * sx,
                        t[0],
                        sz * cy,
                        sz * sy * sx + cz * cx,
                        sz * sy * cx - cz * sx,
                        t[1],
                        -sy,
                        cy * sx,
                        cy * cx,
                        t[2]};
  memcpy(out, m, sizeof m);
}

static void angles_of(const double m[12], double *roll, double *pitch, double *yaw) {
  *roll = atan2(m[9], m[10]);
  *pitch = atan2(-m[8], hypot(m[0], m[4]));
  *yaw = atan2(m[4], m[0]);
}

static const pags_view *find_view(const raw_kitti *s, int sensor, int frame) {
  for (int64_t i = 0; i < pags_dataset_view_count(s->dataset); i++) {
    const pags_view *view = pags_dataset_view(s->dataset, i);
    if (view->sensor == sensor && view->frame == frame)
      return view;
  }
  abort();
}

static const double *world_from_velo(const raw_kitti *s, int64_t frame) {
  const pags_sweep *sweep = pags_dataset_sweep(s->dataset, frame);
  assert(sweep->frame == frame);
  return sweep->world_from_sweep;
}

typedef struct rig {
  double velo_from_imu[12], cam0_from_velo[12];
  double rect[12], cam_from_velo[12]; /* cam0_from_velo = rect * cam_from_velo */
  double projection[4][12];
} rig;

/* A sensor rig with about KITTI's dimensions: the inertial unit 0.8 m behind and below the Velodyne, camera 2 six
 * centimetres to the side of camera 0. */
static rig make_rig(const raw_kitti *s) {
  static const double lever[3] = {-0.8086759, 0.3195559, -0.7997231}, none[3] = {0, 0, 0};
  const double t2[3] = {0.0597, -0.0003, 0.0027}, shifts[4] = {0, -s->baseline, t2[0], t2[0] - s->baseline};
  const pags_camera *camera = &find_view(s, s->sensor, 0)->camera;
  rig r;
  double velo_from_world[12], velo_from_camera[12], camera_from_velo[12], inverse[12];
  rotate(0.01482454, 0.00202417, -0.00078535, lever, r.velo_from_imu);
  rotate(0.0043, -0.0074, -0.0099, none, r.rect);
  pags_rigid_inverse(world_from_velo(s, 0), velo_from_world);
  pags_rigid_multiply(velo_from_world, camera->world_from_camera, velo_from_camera);
  pags_rigid_inverse(velo_from_camera, camera_from_velo);
  memcpy(r.cam0_from_velo, camera_from_velo, sizeof r.cam0_from_velo);
  for (int i = 0; i < 3; i++)
    r.cam0_from_velo[4 * i + 3] -= t2[i];
  pags_rigid_inverse(r.rect, inverse);
  pags_rigid_multiply(inverse, r.cam0_from_velo, r.cam_from_velo);
  for (int c = 0; c < 4; c++) { /* P = K [I | t], in which the first pixel's centre is at 0 */
    const double t[3] = {shifts[c], c < 2 ? 0 : t2[1], c < 2 ? 0 : t2[2]}, cx = camera->cx - 0.5, cy = camera->cy - 0.5;
    const double p[12] = {camera->fx, 0,          cx, camera->fx * t[0] + cx * t[2],
                          0,          camera->fy, cy, camera->fy * t[1] + cy * t[2],
                          0,          0,          1,  t[2]};
    memcpy(r.projection[c], p, sizeof p);
  }
  return r;
}

static void world_from_imu(const raw_kitti *s, const rig *r, int64_t frame, double out[12]) {
  pags_rigid_multiply(world_from_velo(s, frame), r->velo_from_imu, out);
}

/* ---- oxts ---- */

static double time_of(const raw_kitti *s, int64_t frame) {
  return pags_dataset_sweep(s->dataset, frame)->time - pags_dataset_sweep(s->dataset, 0)->time;
}

/* Velocities from differences between the frames before and after. */
static void fill_velocity(const raw_kitti *s, const rig *r, int64_t frame, double row[OXTS]) {
  const int64_t last = pags_dataset_sweep_count(s->dataset) - 1;
  const int64_t before = frame > 0 ? frame - 1 : 0, after = frame < last ? frame + 1 : last;
  const double seconds = time_of(s, after) - time_of(s, before);
  double a[12], b[12], here[12], inverse[12], turn[12], v[3];
  world_from_imu(s, r, before, a);
  world_from_imu(s, r, after, b);
  world_from_imu(s, r, frame, here);
  for (int i = 0; i < 3; i++)
    v[i] = (b[4 * i + 3] - a[4 * i + 3]) / seconds;
  row[VE] = v[0];
  row[VN] = v[1];
  row[VU] = v[2];
  row[VF] = cos(row[YAW]) * v[0] + sin(row[YAW]) * v[1];
  row[VL] = -sin(row[YAW]) * v[0] + cos(row[YAW]) * v[1];
  pags_rigid_inverse(a, inverse);
  pags_rigid_multiply(inverse, b, turn);
  const double axis[3] = {turn[9] - turn[6], turn[2] - turn[8], turn[4] - turn[1]}; /* 2 sin(angle) times the axis */
  const double sine = 0.5 * sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  const double factor = sine > 1e-12 ? asin(sine) / sine : 1;
  for (int i = 0; i < 3; i++)
    row[WX + i] = 0.5 * axis[i] * factor / seconds;
}

/* Writes latitude, longitude and angles by the inverse of the development kit's Mercator projection. Frame 0 is at
 * about 49 degrees north. */
static void fill_oxts(const raw_kitti *s, const rig *r, int64_t frame, double row[OXTS]) {
  const double lat = 49.0150, lon = 8.4343, radius = 6378137, scale = cos(lat * pi / 180);
  double first[12], pose[12];
  world_from_imu(s, r, 0, first);
  world_from_imu(s, r, frame, pose);
  memset(row, 0, OXTS * sizeof *row);
  const double x = scale * radius * lon * pi / 180 + pose[3] - first[3];
  const double y = scale * radius * log(tan((90 + lat) * pi / 360)) + pose[7] - first[7];
  row[LON] = frame ? x / (scale * radius) * 180 / pi : lon;
  row[LAT] = frame ? atan(exp(y / (scale * radius))) * 360 / pi - 90 : lat;
  row[ALT] = pose[11];
  angles_of(pose, &row[ROLL], &row[PITCH], &row[YAW]);
  fill_velocity(s, r, frame, row);
}

/* Writes an oxts row: KITTI's files have 14 digits, for roll and pitch six decimals. */
static void put_oxts(const raw_kitti *s, const rig *r, int64_t frame, out_file *f) {
  double row[OXTS];
  fill_oxts(s, r, frame, row);
  for (int i = 0; i < OXTS; i++) {
    const char *end = i < OXTS - 1 ? " " : "\n";
    if (!s->kitti_digits)
      put(f, "%.17g%s", row[i], end);
    else if (i == ROLL || i == PITCH)
      put(f, "%.6f%s", row[i], end);
    else
      put(f, "%.14g%s", row[i], end);
  }
}

/* ---- Calibration ---- */

static void put_numbers(const raw_kitti *s, out_file *f, const char *key, const double *values, int count) {
  put(f, "%s", key);
  for (int i = 0; i < count; i++)
    put(f, s->kitti_digits ? " %.12e" : " %.17g", values[i]);
  put(f, "\n");
}

static void put_rotation(const raw_kitti *s, out_file *f, const char *key, const double m[12]) {
  const double r[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
  put_numbers(s, f, key, r, 9);
}

static pags_result write_benchmark_calib(const raw_kitti *s, const rig *r, const char *folder) {
  out_file f = {0};
  char key[8];
  for (int c = 0; c < 4; c++) {
    snprintf(key, sizeof key, "P%d:", c);
    put_numbers(s, &f, key, r->projection[c], 12);
  }
  put_rotation(s, &f, "R_rect", r->rect); /* the tracking benchmark's file has no colon after this name */
  put_numbers(s, &f, "Tr_velo_cam", r->cam_from_velo, 12);
  put_numbers(s, &f, "Tr_imu_velo", r->velo_from_imu, 12);
  return save(&f, folder, "calib/0000.txt");
}

static pags_result write_rigid(const raw_kitti *s, const char *folder, const char *name, const double m[12]) {
  const double t[3] = {m[3], m[7], m[11]};
  out_file f = {0};
  put(&f, "calib_time: 15-Mar-2012 11:37:16\n");
  put_rotation(s, &f, "R:", m);
  put_numbers(s, &f, "T:", t, 3);
  return save(&f, folder, name);
}

static pags_result write_day_calib(const raw_kitti *s, const rig *r, const char *folder) {
  static const double none[5] = {0};
  out_file f = {0};
  char key[16];
  put(&f, "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\n");
  for (int c = 0; c < 4; c++) {
    snprintf(key, sizeof key, "D_%02d:", c);
    put_numbers(s, &f, key, none, 5);
    snprintf(key, sizeof key, "R_rect_%02d:", c);
    put_rotation(s, &f, key, r->rect);
    snprintf(key, sizeof key, "P_rect_%02d:", c);
    put_numbers(s, &f, key, r->projection[c], 12);
  }
  PAGS_TRY(save(&f, folder, "2011_09_26/calib_cam_to_cam.txt"));
  PAGS_TRY(write_rigid(s, folder, "2011_09_26/calib_velo_to_cam.txt", r->cam_from_velo));
  return write_rigid(s, folder, "2011_09_26/calib_imu_to_velo.txt", r->velo_from_imu);
}

/* ---- Labels ---- */

static void put_2d_box(const raw_kitti *s, out_file *f, const pags_object *object, const pags_keyframe *keyframe) {
  const pags_camera *camera = &find_view(s, s->sensor, keyframe->frame)->camera;
  double corners[32], box[4] = {0, 0, 0, 0};
  const int count = pags_box_outline(camera, keyframe->world_from_object, object->size, corners);
  for (int i = 0; i < count; i++)
    for (int k = 0; k < 2; k++) {
      const double value = fmin(fmax(corners[2 * i + k], 0), k ? camera->height : camera->width);
      box[k] = i == 0 || value < box[k] ? value : box[k];
      box[2 + k] = i == 0 || value > box[2 + k] ? value : box[2 + k];
    }
  for (int i = 0; i < 4; i++)
    put(f, "%.6f ", box[i]);
}

static void put_label(const raw_kitti *s, const rig *r, out_file *f, int64_t track, const pags_object *object,
                      const pags_keyframe *keyframe) {
  double velo_from_world[12], cam0_from_object[12];
  pags_rigid_inverse(world_from_velo(s, keyframe->frame), velo_from_world);
  pags_rigid_multiply(velo_from_world, keyframe->world_from_object, cam0_from_object);
  pags_rigid_multiply(r->cam0_from_velo, cam0_from_object, cam0_from_object);
  /* The forward axis is (cos, ., -sin) of the label's rotation_y. */
  const double *m = cam0_from_object, yaw = atan2(-m[8], m[0]);
  const double numbers[7] = {
      object->size[2], object->size[1], object->size[0], m[3], m[7] + object->size[2] / 2, m[11], yaw};
  put(f, "%d %lld %s 0 0 %.6f ", keyframe->frame, (long long)track, object->class_name, yaw - atan2(m[3], m[11]));
  put_2d_box(s, f, object, keyframe);
  for (int i = 0; i < 7; i++)
    put(f, s->kitti_digits ? "%.6f%s" : "%.17g%s", numbers[i], i < 6 ? " " : "\n");
}

static pags_result write_labels(const raw_kitti *s, const rig *r, const char *folder) {
  out_file f = {0};
  for (int64_t frame = 0; frame < pags_dataset_sweep_count(s->dataset); frame++) {
    put(&f, "%lld -1 DontCare -1 -1 -10.000000 219.310000 188.490000 245.500000 218.560000", (long long)frame);
    put(&f, " -1000.000000 -1000.000000 -1000.000000 -10.000000 -1.000000 -1.000000 -1.000000\n");
    for (int64_t i = 0; i < pags_dataset_object_count(s->dataset); i++) {
      const pags_object *object = pags_dataset_object(s->dataset, i);
      const pags_keyframe *keyframe = pags_object_keyframe(object, frame);
      if (keyframe)
        put_label(s, r, &f, i, object, keyframe);
    }
  }
  return save(&f, folder, "label_02/0000.txt");
}

static void put_tracklet_pose(const raw_kitti *s, out_file *f, const pags_object *object,
                              const pags_keyframe *keyframe) {
  double velo_from_world[12], m[12], a[3];
  static const char *const names[] = {"tx", "ty", "tz", "rx", "ry", "rz"};
  pags_rigid_inverse(world_from_velo(s, keyframe->frame), velo_from_world);
  pags_rigid_multiply(velo_from_world, keyframe->world_from_object, m);
  angles_of(m, &a[0], &a[1], &a[2]);
  put(f, "        <item>\n");
  for (int i = 0; i < 6; i++) {
    const double value = i < 3 ? m[4 * i + 3] - m[4 * i + 2] * object->size[2] / 2 : a[i - 3];
    put(f, s->kitti_digits ? "          <%s>%.14g</%s>\n" : "          <%s>%.17g</%s>\n", names[i], value, names[i]);
  }
  put(f, "          <state>2</state>\n          <occlusion>0</occlusion>\n        </item>\n");
}

static int64_t run_length(const pags_object *object, int64_t first) {
  int64_t count = 1;
  while (first + count < object->keyframe_count &&
         object->keyframes[first + count].frame == object->keyframes[first].frame + count)
    count++;
  return count;
}

static void put_tracklets(const raw_kitti *s, out_file *f, const pags_object *object) {
  for (int64_t first = 0, count; first < object->keyframe_count; first += count) {
    count = run_length(object, first);
    put(f, "    <item class_id=\"1\" tracking_level=\"0\" version=\"1\">\n      <objectType>%s</objectType>\n",
        object->class_name);
    put(f, "      <h>%.17g</h>\n      <w>%.17g</w>\n      <l>%.17g</l>\n", object->size[2], object->size[1],
        object->size[0]);
    put(f, "      <first_frame>%d</first_frame>\n      <poses class_id=\"2\">\n        <count>%lld</count>\n",
        object->keyframes[first].frame, (long long)count);
    put(f, "        <item_version>2</item_version>\n");
    for (int64_t k = first; k < first + count; k++)
      put_tracklet_pose(s, f, object, &object->keyframes[k]);
    put(f, "      </poses>\n      <finished>1</finished>\n    </item>\n");
  }
}

static pags_result write_tracklets(const raw_kitti *s, const char *folder) {
  const int64_t count = pags_dataset_object_count(s->dataset);
  out_file f = {0};
  put(&f, "<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"yes\" ?>\n<!DOCTYPE boost_serialization>\n");
  put(&f, "<boost_serialization signature=\"serialization::archive\" version=\"9\">\n  <tracklets class_id=\"0\">\n");
  put(&f, "    <count>%lld</count>\n    <item_version>1</item_version>\n", (long long)count);
  for (int64_t i = 0; i < count; i++)
    put_tracklets(s, &f, pags_dataset_object(s->dataset, i));
  put(&f, "  </tracklets>\n</boost_serialization>\n");
  return save(&f, folder, RAW_KITTI_DRIVE "/tracklet_labels.xml");
}

/* ---- Frames ---- */

static pags_result write_sweep(const raw_kitti *s, int64_t frame, const char *folder, const char *name) {
  int64_t count;
  float *xyz;
  PAGS_TRY(pags_dataset_sweep_load(s->dataset, frame, &count, &xyz));
  uint8_t *bytes = malloc((size_t)count * 16 + 1);
  if (!bytes)
    abort();
  for (int64_t i = 0; i < count; i++) {
    for (int k = 0; k < 3; k++)
      pags_store_f32(bytes + 16 * i + 4 * k, xyz[3 * i + k]);
    pags_store_f32(bytes + 16 * i + 12, (float)(i % 100) / 100);
  }
  const pags_result result = write_bytes(folder, name, bytes, (size_t)count * 16);
  free(bytes);
  free(xyz);
  return result;
}

/* Writes pictures and sweeps. The formats turn a frame's number into the path of a sweep, and a camera and a frame
 * into that of a picture. */
static pags_result write_frames(const raw_kitti *s, const char *folder, bool raw) {
  char name[128];
  for (int64_t frame = 0; frame < pags_dataset_sweep_count(s->dataset); frame++) {
    const long long number = frame;
    for (int c = 0; c < 2; c++) {
      const pags_view *view = find_view(s, c ? s->right : s->sensor, (int)frame);
      if (raw)
        snprintf(name, sizeof name, "image_%02d/data/%010lld.png", c + 2, number);
      else
        snprintf(name, sizeof name, "image_%02d/0000/%06lld.png", c + 2, number);
      PAGS_TRY(copy(view->image_path, folder, name));
    }
    if (raw)
      snprintf(name, sizeof name, "velodyne_points/data/%010lld.bin", number);
    else
      snprintf(name, sizeof name, "velodyne/0000/%06lld.bin", number);
    PAGS_TRY(write_sweep(s, frame, folder, name));
  }
  return PAGS_OK;
}

pags_result raw_kitti_write_tracking(const raw_kitti *source, const char *folder) {
  const rig r = make_rig(source);
  out_file oxts = {0};
  PAGS_TRY(write_frames(source, folder, false));
  PAGS_TRY(write_benchmark_calib(source, &r, folder));
  for (int64_t frame = 0; frame < pags_dataset_sweep_count(source->dataset); frame++)
    put_oxts(source, &r, frame, &oxts);
  PAGS_TRY(save(&oxts, folder, "oxts/0000.txt"));
  return write_labels(source, &r, folder);
}

/* Writes timestamps that begin at 13:02:25 plus `shift` seconds on the day of the recording. */
static pags_result write_times(const raw_kitti *s, const char *folder, const char *name, double shift) {
  out_file f = {0};
  for (int64_t frame = 0; frame < pags_dataset_sweep_count(s->dataset); frame++) {
    const double second = 25 + time_of(s, frame) + shift;
    const int minute = (int)floor(second / 60);
    put(&f, "2011-09-26 13:%02d:%012.9f\n", 2 + minute, second - 60 * minute);
  }
  return save(&f, folder, name);
}

pags_result raw_kitti_write_drive(const raw_kitti *source, const char *folder) {
  const rig r = make_rig(source);
  char *drive = pags_path_join(folder, RAW_KITTI_DRIVE);
  pags_result result = write_frames(source, drive, true);
  for (int64_t frame = 0; result == PAGS_OK && frame < pags_dataset_sweep_count(source->dataset); frame++) {
    char name[64];
    out_file oxts = {0};
    put_oxts(source, &r, frame, &oxts);
    snprintf(name, sizeof name, "oxts/data/%010lld.txt", (long long)frame);
    result = save(&oxts, drive, name);
  }
  static const struct {
    const char *name;
    double shift;
  } times[] = {{"image_02/timestamps.txt", 0},
               {"image_03/timestamps.txt", 0.001},
               {"oxts/timestamps.txt", -0.002},
               {"velodyne_points/timestamps.txt", -0.003},
               {"velodyne_points/timestamps_start.txt", -0.053},
               {"velodyne_points/timestamps_end.txt", 0.047}};
  for (size_t i = 0; result == PAGS_OK && i < sizeof times / sizeof times[0]; i++)
    result = write_times(source, drive, times[i].name, times[i].shift);
  free(drive);
  PAGS_TRY(result);
  PAGS_TRY(write_day_calib(source, &r, folder));
  return write_tracklets(source, folder);
}
