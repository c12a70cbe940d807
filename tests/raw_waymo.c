/* SPDX-License-Identifier: Apache-2.0 */
/* Writes Waymo segments for tests; see raw_waymo.h. */
#include "raw_waymo.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include <pags/camera.h>
#include <pags/image.h>
#include <pags/object.h>
#include "base/bytes.h"
#include "base/file.h"
#include "base/json.h"

#define PI 3.14159265358979323846

enum { MOST_CAMERAS = 5, PATH_SIZE = 768 };

__attribute__((noreturn, format(printf, 1, 2))) static void stop(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fprintf(stderr, "raw_waymo: ");
  vfprintf(stderr, format, arguments);
  fprintf(stderr, "\n");
  va_end(arguments);
  abort();
}

static void check(pags_result result) {
  if (result != PAGS_OK)
    stop("%s", pags_error_message());
}

/* ---- Memory ---- */

static void keep(raw_waymo *w, void *block) {
  if (w->count == w->capacity) {
    w->capacity = w->capacity ? 2 * w->capacity : 64;
    w->blocks = realloc(w->blocks, w->capacity * sizeof *w->blocks);
    if (!w->blocks)
      stop("out of memory");
  }
  w->blocks[w->count++] = block;
}

void *raw_waymo_alloc(raw_waymo *w, size_t count, size_t size) {
  void *block = calloc(count ? count : 1, size);
  if (!block)
    stop("out of memory");
  keep(w, block);
  return block;
}

char *raw_waymo_text(raw_waymo *w, const char *text) {
  char *copy = raw_waymo_alloc(w, strlen(text) + 1, 1);
  strcpy(copy, text);
  return copy;
}

void raw_waymo_free(raw_waymo *w) {
  for (size_t i = 0; i < w->count; i++)
    free(w->blocks[i]);
  free(w->blocks);
  *w = (raw_waymo){0};
}

/* ---- Records ---- */

uint32_t raw_crc32c(const uint8_t *bytes, size_t size) {
  uint32_t crc = 0xffffffffu;
  for (size_t i = 0; i < size; i++) {
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; bit++)
      crc = crc & 1 ? crc >> 1 ^ 0x82f63b78u : crc >> 1;
  }
  return ~crc;
}

uint32_t raw_masked_crc(const uint8_t *bytes, size_t size) {
  const uint32_t crc = raw_crc32c(bytes, size);
  return (crc >> 15 | crc << 17) + 0xa282ead8u;
}

void raw_record_write(FILE *stream, const uint8_t *bytes, size_t size) {
  uint8_t header[12], footer[4];
  pags_store_u64(header, size);
  pags_store_u32(header + 8, raw_masked_crc(header, 8));
  pags_store_u32(footer, raw_masked_crc(bytes, size));
  if (fwrite(header, 1, 12, stream) != 12 || fwrite(bytes, 1, size, stream) != size ||
      fwrite(footer, 1, 4, stream) != 4)
    stop("can't write");
}

uint8_t *raw_frame_pack(raw_waymo *w, const Pags__Waymo__Frame *frame, size_t *size) {
  *size = pags__waymo__frame__get_packed_size(frame);
  uint8_t *bytes = raw_waymo_alloc(w, *size, 1);
  pags__waymo__frame__pack(frame, bytes);
  return bytes;
}

/* ---- Parts of a frame ---- */

Pags__Waymo__Transform *raw_transform(raw_waymo *w, const double m[12]) {
  Pags__Waymo__Transform *t = raw_waymo_alloc(w, 1, sizeof *t);
  pags__waymo__transform__init(t);
  t->n_transform = 16;
  t->transform = raw_waymo_alloc(w, 16, sizeof *t->transform);
  memcpy(t->transform, m, 12 * sizeof *m);
  t->transform[15] = 1;
  return t;
}

ProtobufCBinaryData raw_matrix(raw_waymo *w, const float *values, int rows, int columns, int depth) {
  Pags__Waymo__Matrix matrix = PAGS__WAYMO__MATRIX__INIT;
  Pags__Waymo__Shape shape = PAGS__WAYMO__SHAPE__INIT;
  int32_t dims[3] = {rows, columns, depth};
  shape.n_dims = 3;
  shape.dims = dims;
  matrix.shape = &shape;
  matrix.n_data = (size_t)rows * (size_t)columns * (size_t)depth;
  matrix.data = raw_waymo_alloc(w, matrix.n_data, sizeof *matrix.data);
  memcpy(matrix.data, values, matrix.n_data * sizeof *values);
  const size_t size = pags__waymo__matrix__get_packed_size(&matrix);
  uint8_t *plain = raw_waymo_alloc(w, size, 1);
  pags__waymo__matrix__pack(&matrix, plain);
  uLongf packed = compressBound((uLong)size);
  uint8_t *out = raw_waymo_alloc(w, packed, 1);
  if (compress2(out, &packed, plain, (uLong)size, 1) != Z_OK)
    stop("zlib");
  return (ProtobufCBinaryData){.len = packed, .data = out};
}

static void apply(const double m[12], const double p[3], double w, double out[3]) {
  for (int i = 0; i < 3; i++)
    out[i] = m[4 * i] * p[0] + m[4 * i + 1] * p[1] + m[4 * i + 2] * p[2] + m[4 * i + 3] * w;
}

/* R = Rz(yaw) Ry(pitch) Rx(roll), multiplied one rotation after the other. */
static void pose_from(const float pose[6], double out[12]) {
  const double r = (double)pose[0], p = (double)pose[1], y = (double)pose[2];
  const double x[12] = {1, 0, 0, 0, 0, cos(r), -sin(r), 0, 0, sin(r), cos(r), 0};
  const double turn_y[12] = {cos(p), 0, sin(p), 0, 0, 1, 0, 0, -sin(p), 0, cos(p), 0};
  const double turn_z[12] = {cos(y), -sin(y), 0, (double)pose[3], sin(y), cos(y), 0, (double)pose[4],
                             0,      0,       1, (double)pose[5]};
  double both[12];
  pags_rigid_multiply(turn_y, x, both);
  pags_rigid_multiply(turn_z, both, out);
}

/* Inclination of a row's beam; row 0 is the highest beam. */
static double inclination_of(const raw_lidar *l, int row) {
  const int beam = l->rows - 1 - row;
  return l->inclinations ? l->inclinations[beam] : l->low + (l->high - l->low) * (beam + 0.5) / l->rows;
}

/* Direction of a pixel in the LiDAR's own frame; column 0 looks to the back of the vehicle and slightly to its left. */
static void pixel_direction(const raw_lidar *l, int row, int column, double out[3]) {
  const double yaw = atan2(l->vehicle_from_laser[4], l->vehicle_from_laser[0]);
  const double azimuth = PI - 2 * PI * (column + 0.5) / l->columns - yaw, up = inclination_of(l, row);
  out[0] = cos(azimuth) * cos(up);
  out[1] = sin(azimuth) * cos(up);
  out[2] = sin(up);
}

static void scan(const raw_lidar *l, const double world_from_frame[12], int which, float *image, float *poses) {
  for (int c = 0; c < l->columns; c++) {
    double vehicle[12], laser[12], origin[3], direction[3], local[3];
    float pose[6];
    memcpy(vehicle, world_from_frame, sizeof vehicle);
    if (l->pose) {
      l->pose(l->user, c, pose);
      pose_from(pose, vehicle);
    }
    pags_rigid_multiply(vehicle, l->vehicle_from_laser, laser);
    apply(laser, (double[]){0, 0, 0}, 1, origin);
    for (int r = 0; r < l->rows; r++) {
      float *pixel = image + 4 * ((size_t)r * (size_t)l->columns + (size_t)c);
      pixel_direction(l, r, c, local);
      apply(laser, local, 0, direction);
      pixel[0] = l->range(l->user, origin, direction, which);
      pixel[1] = (float)(r + 100 * which);
      if (l->pose)
        memcpy(poses + 6 * ((size_t)r * (size_t)l->columns + (size_t)c), pose, sizeof pose);
    }
  }
}

static void add_calibration(raw_waymo *w, Pags__Waymo__Frame *frame, const raw_lidar *l) {
  Pags__Waymo__LaserCalibration *c = raw_waymo_alloc(w, 1, sizeof *c);
  pags__waymo__laser_calibration__init(c);
  c->has_name = 1;
  c->name = l->name;
  c->extrinsic = raw_transform(w, l->vehicle_from_laser);
  c->has_beam_inclination_min = c->has_beam_inclination_max = 1;
  c->beam_inclination_min = l->low;
  c->beam_inclination_max = l->high;
  if (l->inclinations) {
    c->n_beam_inclinations = (size_t)l->rows;
    c->beam_inclinations = raw_waymo_alloc(w, (size_t)l->rows, sizeof *c->beam_inclinations);
    memcpy(c->beam_inclinations, l->inclinations, (size_t)l->rows * sizeof *l->inclinations);
  }
  frame->context->laser_calibrations[frame->context->n_laser_calibrations++] = c;
}

static Pags__Waymo__RangeImage *range_image(raw_waymo *w, const float *image, int rows, int columns,
                                            const float *poses) {
  Pags__Waymo__RangeImage *r = raw_waymo_alloc(w, 1, sizeof *r);
  pags__waymo__range_image__init(r);
  r->has_range_image_compressed = 1;
  r->range_image_compressed = raw_matrix(w, image, rows, columns, 4);
  if (poses) {
    r->has_range_image_pose_compressed = 1;
    r->range_image_pose_compressed = raw_matrix(w, poses, rows, columns, 6);
  }
  return r;
}

static void add_returns(raw_waymo *w, Pags__Waymo__Frame *frame, const raw_lidar *l, const float *first,
                        const float *second, const float *poses) {
  Pags__Waymo__Laser *laser = raw_waymo_alloc(w, 1, sizeof *laser);
  pags__waymo__laser__init(laser);
  laser->has_name = 1;
  laser->name = l->name;
  laser->ri_return1 = range_image(w, first, l->rows, l->columns, poses);
  laser->ri_return2 = range_image(w, second, l->rows, l->columns, NULL);
  frame->lasers[frame->n_lasers++] = laser;
}

void raw_lidar_add(raw_waymo *w, Pags__Waymo__Frame *frame, const raw_lidar *l) {
  const size_t pixels = (size_t)l->rows * (size_t)l->columns;
  float *images[2], *poses = l->pose ? raw_waymo_alloc(w, pixels, 6 * sizeof *poses) : NULL;
  for (int which = 0; which < 2; which++) {
    images[which] = raw_waymo_alloc(w, pixels, 4 * sizeof *images[which]);
    scan(l, frame->pose->transform, which, images[which], poses);
  }
  add_calibration(w, frame, l);
  add_returns(w, frame, l, images[0], images[1], poses);
}

/* ---- Converting a data set ---- */

typedef struct source {
  raw_waymo *w;
  const char *folder;
  pags_json *times, *info;
  int cameras[MOST_CAMERAS], camera_count;
  int64_t frames;
  char path[PATH_SIZE];
} source;

static const char *name_of(source *s, const char *format, ...) __attribute__((format(printf, 2, 3)));
static const char *name_of(source *s, const char *format, ...) {
  va_list arguments;
  const int at = snprintf(s->path, sizeof s->path, "%s/", s->folder);
  va_start(arguments, format);
  vsnprintf(s->path + at, sizeof s->path - (size_t)at, format, arguments);
  va_end(arguments);
  return s->path;
}

static void read_numbers(const char *path, int count, double *out) {
  FILE *stream = fopen(path, "r");
  for (int i = 0; i < count; i++)
    if (!stream || fscanf(stream, "%lf", &out[i]) != 1)
      stop("%s: expected %d numbers", path, count);
  fclose(stream);
}

static ProtobufCBinaryData read_file(source *s, const char *path) {
  uint8_t *bytes;
  size_t size;
  check(pags_file_read(path, &bytes, &size));
  keep(s->w, bytes);
  return (ProtobufCBinaryData){.len = size, .data = bytes};
}

static double time_of(const source *s, const char *key, int camera, int64_t frame, double fallback) {
  char text[16];
  snprintf(text, sizeof text, "%d", camera);
  const pags_json_value *v = pags_json_member(pags_json_root(s->times), key);
  if (v && camera >= 0)
    v = pags_json_member(v, text);
  v = v ? v->first : NULL;
  for (int64_t i = 0; v && i < frame; i++)
    v = v->next;
  return v && v->type == PAGS_JSON_NUMBER ? v->number : fallback;
}

static const char *photo_path(source *s, int64_t t, int camera) {
  if (pags_file_exists(name_of(s, "images/%03d_%d.jpg", (int)t, camera)))
    return s->path;
  return name_of(s, "images/%03d_%d.png", (int)t, camera);
}

/* The photograph's bytes if it is a JPEG, else the photograph encoded as one. */
static ProtobufCBinaryData jpeg_of(source *s, int64_t t, int camera) {
  char path[PATH_SIZE + 16];
  pags_image image;
  if (strcmp(pags_path_extension(photo_path(s, t, camera)), ".jpg") == 0)
    return read_file(s, s->path);
  snprintf(path, sizeof path, "%s.raw.jpg", s->path);
  check(pags_image_load(s->path, PAGS_U8, 3, &image));
  check(pags_image_save(path, &image));
  pags_image_destroy(&image);
  const ProtobufCBinaryData jpeg = read_file(s, path);
  remove(path);
  return jpeg;
}

static void add_camera(source *s, Pags__Waymo__Frame *frame, int camera) {
  /* Rotation from Waymo's camera axes to OpenCV's: x forward = z, y left = -x, z up = -y. */
  static const double cv_from_waymo[12] = {0, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0};
  double intrinsics[9], extrinsics[12], waymo[12];
  int width, height;
  read_numbers(name_of(s, "intrinsics/%d.txt", camera), 9, intrinsics);
  read_numbers(name_of(s, "extrinsics/%d.txt", camera), 12, extrinsics);
  check(pags_image_size(photo_path(s, 0, camera), &width, &height));
  pags_rigid_multiply(extrinsics, cv_from_waymo, waymo);
  Pags__Waymo__CameraCalibration *c = raw_waymo_alloc(s->w, 1, sizeof *c);
  pags__waymo__camera_calibration__init(c);
  c->has_name = c->has_width = c->has_height = c->has_rolling_shutter_direction = 1;
  c->name = camera + 1;
  c->width = width;
  c->height = height;
  c->rolling_shutter_direction = 2;
  c->n_intrinsic = 9;
  c->intrinsic = raw_waymo_alloc(s->w, 9, sizeof *c->intrinsic);
  memcpy(c->intrinsic, intrinsics, sizeof intrinsics);
  c->extrinsic = raw_transform(s->w, waymo);
  frame->context->camera_calibrations[frame->context->n_camera_calibrations++] = c;
}

static const int waymo_classes[19] = {20, 23, 19, 19, 19, 15, 18, 17, 24, 24, 25, 9, 10, 2, 3, 4, 4, 7, 6};

/* The semantic mask as a 16-bit PNG of class * 1000 + an instance number; 255 (unknown) becomes class 28. */
static Pags__Waymo__CameraSegmentationLabel *panoptic_of(source *s, int64_t t, int camera) {
  pags_image mask, label;
  if (!pags_file_exists(name_of(s, "semantic/%03d_%d.png", (int)t, camera)))
    return NULL;
  check(pags_image_load(s->path, PAGS_U8, 1, &mask));
  check(pags_image_create(&label, mask.width, mask.height, 1, PAGS_U16));
  for (size_t i = 0; i < (size_t)mask.width * (size_t)mask.height; i++) {
    const uint8_t id = ((uint8_t *)mask.data)[i];
    ((uint16_t *)label.data)[i] = (uint16_t)(1000 * (id < 19 ? waymo_classes[id] : 28) + (int)(i % 7));
  }
  char path[PATH_SIZE + 16];
  snprintf(path, sizeof path, "%s.raw.png", name_of(s, "semantic/%03d_%d", (int)t, camera));
  check(pags_image_save(path, &label));
  Pags__Waymo__CameraSegmentationLabel *out = raw_waymo_alloc(s->w, 1, sizeof *out);
  pags__waymo__camera_segmentation_label__init(out);
  out->has_panoptic_label_divisor = out->has_panoptic_label = 1;
  out->panoptic_label_divisor = 1000;
  out->panoptic_label = read_file(s, path);
  remove(path);
  pags_image_destroy(&mask);
  pags_image_destroy(&label);
  return out;
}

static Pags__Waymo__CameraImage *image_of(source *s, int64_t t, int camera, const double ego[12]) {
  Pags__Waymo__CameraImage *m = raw_waymo_alloc(s->w, 1, sizeof *m);
  pags__waymo__camera_image__init(m);
  m->has_name = m->has_image = m->has_pose_timestamp = m->has_shutter = 1;
  m->has_camera_trigger_time = m->has_camera_readout_done_time = 1;
  m->name = camera + 1;
  m->image = jpeg_of(s, t, camera);
  m->pose = raw_transform(s->w, ego);
  m->pose_timestamp = time_of(s, "cameras", camera, t, time_of(s, "frames", -1, t, 0));
  m->shutter = time_of(s, "shutter", camera, t, 0.002);
  m->camera_trigger_time = m->pose_timestamp - 0.02;
  m->camera_readout_done_time = m->pose_timestamp + 0.02;
  m->camera_segmentation_label = panoptic_of(s, t, camera);
  return m;
}

static int type_of(const char *class_name) {
  static const char *const names[] = {"Unknown", "Vehicle", "Pedestrian", "Sign", "Cyclist"};
  for (int i = 1; i < 5; i++)
    if (strcmp(class_name, names[i]) == 0)
      return i;
  static const int types[] = {[PAGS_CATEGORY_OTHER] = 3,
                              [PAGS_CATEGORY_VEHICLE] = 1,
                              [PAGS_CATEGORY_PEDESTRIAN] = 2,
                              [PAGS_CATEGORY_CYCLIST] = 4};
  return types[pags_category_of(class_name)];
}

static Pags__Waymo__Label *label_of(source *s, const double ego[12], const char *id, const char *class_name,
                                    const double world_from_box[12], const double size[3]) {
  double back[12], local[12];
  pags_rigid_inverse(ego, back);
  pags_rigid_multiply(back, world_from_box, local);
  Pags__Waymo__Label *l = raw_waymo_alloc(s->w, 1, sizeof *l);
  Pags__Waymo__Box *b = raw_waymo_alloc(s->w, 1, sizeof *b);
  pags__waymo__label__init(l);
  pags__waymo__box__init(b);
  l->box = b;
  l->id = raw_waymo_text(s->w, id);
  l->has_type = b->has_center_x = b->has_center_y = b->has_center_z = 1;
  b->has_length = b->has_width = b->has_height = b->has_heading = 1;
  l->type = type_of(class_name);
  b->center_x = local[3];
  b->center_y = local[7];
  b->center_z = local[11];
  b->length = size[0];
  b->width = size[1];
  b->height = size[2];
  b->heading = atan2(local[4], local[0]);
  return l;
}

/* Reads `count` numbers of element `index` of an array of arrays, nested to any depth. */
static void numbers_of(const pags_json_value *v, int *at, int count, double *out) {
  for (; v && *at < count; v = v->next)
    if (v->type == PAGS_JSON_NUMBER)
      out[(*at)++] = v->number;
    else
      numbers_of(v->first, at, count, out);
}

static void add_labels(source *s, Pags__Waymo__Frame *frame, int64_t t, const double ego[12]) {
  const pags_json_value *root = s->info ? pags_json_root(s->info) : NULL;
  frame->laser_labels = raw_waymo_alloc(s->w, root ? (size_t)root->count : 0, sizeof *frame->laser_labels);
  for (const pags_json_value *v = root ? root->first : NULL; v; v = v->next) {
    const pags_json_value *notes = pags_json_member(v, "frame_annotations");
    const pags_json_value *index = pags_json_member(notes, "frame_idx")->first;
    const pags_json_value *pose = pags_json_member(notes, "obj_to_world")->first;
    const pags_json_value *size = pags_json_member(notes, "box_size")->first;
    for (; index; index = index->next, pose = pose->next, size = size->next) {
      double m[12], extent[3];
      int at = 0, got = 0;
      if ((int64_t)index->number != t)
        continue;
      numbers_of(pose->first, &at, 12, m);
      numbers_of(size->first, &got, 3, extent);
      frame->laser_labels[frame->n_laser_labels++] =
          label_of(s, ego, pags_json_member(v, "id")->text, pags_json_member(v, "class_name")->text, m, extent);
    }
  }
}

/* ---- The data set's LiDAR points ---- */

enum { ROWS = 192, COLUMNS = 2048 };

/* The roof LiDAR: rotated by a yaw of 148 degrees and slightly tilted, like Waymo's. */
static raw_lidar roof_lidar(void) {
  raw_lidar l = {.name = 1, .rows = ROWS, .columns = COLUMNS, .low = -0.9, .high = 0.5};
  const double turned[12] = {cos(2.58), -sin(2.58), 0, 1.43, sin(2.58), cos(2.58), 0, 0, 0, 0, 1, 2.18};
  memcpy(l.vehicle_from_laser, turned, sizeof turned);
  return l;
}

/* Writes a point of the vehicle's frame into the range image pixel of its nearest beam. */
static void put_point(const raw_lidar *l, const double laser_from_vehicle[12], const double p[3], float value,
                      float *images[2]) {
  double q[3];
  apply(laser_from_vehicle, p, 1, q);
  const double range = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]), yaw = 2.58;
  const double turn = (PI - atan2(q[1], q[0]) - yaw) / (2 * PI), up = asin(q[2] / range);
  const int column = (int)((turn - floor(turn)) * l->columns) % l->columns;
  const double beam = floor((up - l->low) / (l->high - l->low) * l->rows);
  if (beam < 0 || beam >= l->rows || !(range > 0))
    return;
  const size_t at = 4 * ((size_t)(l->rows - 1 - (int)beam) * (size_t)l->columns + (size_t)column);
  float *image = images[0][at] > 0 ? images[1] : images[0];
  image[at] = (float)range;
  image[at + 1] = value;
}

static size_t lidar_columns(source *s) {
  pags_json *json;
  check(pags_json_parse_file(name_of(s, "dataset.json"), &json));
  const pags_json_value *v = pags_json_member(pags_json_root(json), "lidar_columns");
  const size_t count = v ? (size_t)v->count : 0;
  pags_json_destroy(json);
  return count;
}

static void add_lidar(source *s, Pags__Waymo__Frame *frame, int64_t t, const double ego[12]) {
  const size_t stride = lidar_columns(s);
  if (!stride || !pags_file_exists(name_of(s, "lidar/%03d.bin", (int)t)))
    return;
  const ProtobufCBinaryData rows = read_file(s, s->path);
  const raw_lidar l = roof_lidar();
  double back[12];
  float *images[2], *poses = raw_waymo_alloc(s->w, (size_t)ROWS * COLUMNS, 6 * sizeof *poses);
  for (int i = 0; i < 2; i++)
    images[i] = raw_waymo_alloc(s->w, (size_t)ROWS * COLUMNS, 4 * sizeof *images[i]);
  pags_rigid_inverse(l.vehicle_from_laser, back);
  for (size_t i = 0; i + 4 * stride <= rows.len; i += 4 * stride) {
    double p[3];
    for (size_t k = 0; k < 3; k++)
      p[k] = (double)pags_load_f32(rows.data + i + 4 * k);
    put_point(&l, back, p, stride > 3 ? pags_load_f32(rows.data + i + 12) : 0, images);
  }
  const float pose[6] = {(float)atan2(ego[9], ego[10]),
                         (float)-asin(ego[8]),
                         (float)atan2(ego[4], ego[0]),
                         (float)ego[3],
                         (float)ego[7],
                         (float)ego[11]};
  for (size_t i = 0; i < (size_t)ROWS * COLUMNS; i++)
    memcpy(poses + 6 * i, pose, sizeof pose);
  add_calibration(s->w, frame, &l);
  add_returns(s->w, frame, &l, images[0], images[1], poses);
}

/* ---- The whole segment ---- */

static Pags__Waymo__Frame *frame_of(source *s, int64_t t) {
  double ego[12];
  Pags__Waymo__Frame *f = raw_waymo_alloc(s->w, 1, sizeof *f);
  Pags__Waymo__Context *c = raw_waymo_alloc(s->w, 1, sizeof *c);
  pags__waymo__frame__init(f);
  pags__waymo__context__init(c);
  read_numbers(name_of(s, "ego_pose/%03d.txt", (int)t), 12, ego);
  f->context = c;
  f->pose = raw_transform(s->w, ego);
  f->has_timestamp_micros = 1;
  f->timestamp_micros = llround(1e6 * time_of(s, "frames", -1, t, 0.1 * (double)t));
  c->name = raw_waymo_text(s->w, "a written segment");
  c->camera_calibrations = raw_waymo_alloc(s->w, MOST_CAMERAS, sizeof *c->camera_calibrations);
  c->laser_calibrations = raw_waymo_alloc(s->w, 1, sizeof *c->laser_calibrations);
  f->images = raw_waymo_alloc(s->w, MOST_CAMERAS, sizeof *f->images);
  f->lasers = raw_waymo_alloc(s->w, 1, sizeof *f->lasers);
  /* Cameras are written in reverse order, so that a reader that takes them by index instead of by name gets the
   * wrong camera. */
  for (int i = s->camera_count - 1; i >= 0; i--) {
    add_camera(s, f, s->cameras[i]);
    f->images[f->n_images++] = image_of(s, t, s->cameras[i], ego);
  }
  add_labels(s, f, t, ego);
  add_lidar(s, f, t, ego);
  return f;
}

void raw_waymo_write(const char *folder, const char *path) {
  source s = {.folder = folder};
  check(pags_json_parse_file(name_of(&s, "timestamps.json"), &s.times));
  if (pags_file_exists(name_of(&s, "instances/instances_info.json")))
    check(pags_json_parse_file(s.path, &s.info));
  for (int c = 0; c < MOST_CAMERAS; c++)
    if (pags_file_exists(name_of(&s, "intrinsics/%d.txt", c)))
      s.cameras[s.camera_count++] = c;
  while (pags_file_exists(name_of(&s, "ego_pose/%03d.txt", (int)s.frames)))
    s.frames++;
  FILE *stream = fopen(path, "wb");
  if (!stream || !s.frames || !s.camera_count)
    stop("%s: can't write %s from it", folder, path);
  for (int64_t t = 0; t < s.frames; t++) {
    raw_waymo w = {0};
    size_t size;
    s.w = &w;
    uint8_t *bytes = raw_frame_pack(&w, frame_of(&s, t), &size);
    raw_record_write(stream, bytes, size);
    raw_waymo_free(&w);
  }
  if (fclose(stream) != 0)
    stop("%s: can't write", path);
  pags_json_destroy(s.times);
  pags_json_destroy(s.info);
}
