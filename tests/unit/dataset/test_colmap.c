/* SPDX-License-Identifier: Apache-2.0 */
/* Tests COLMAP models: text and binary files, every camera model, tracks and damaged files. Compares two pose sets
 * of the real data set fox. */
#include <pags/dataset.h>

#include "shared_data.h"
#include "unit/scratch.h"

#include <math.h>

static uint8_t grey(int x, int y, int c) {
  (void)x, (void)y, (void)c;
  return 90;
}

static pags_dataset *open_ok(const char *path, const pags_dataset_options *options) {
  pags_dataset *dataset = NULL;
  scratch_ok(pags_dataset_open(path, options, &dataset));
  return dataset;
}

static void open_fails(const char *path, pags_result code, const char *part) {
  pags_dataset *dataset = NULL;
  pags_result result = pags_dataset_open(path, NULL, &dataset);
  assert_null(dataset);
  scratch_expect(result, code, part);
}

/* A text model of three images: the first has no observations, the last has a blank in its name. Image 30 (a.png,
 * first by name) is held out by a split of 8. Point 5 is seen by one training view, point 7 by two. */
static const char cameras_text[] = "# a comment\n\n4 PINHOLE 8 6 10 11 4 3\n";
static const char images_text[] =
    "# more\n"
    "10 1 0 0 0 -1 -2 -3 4 b.png\n"
    "\n"
    "30 0.70710678118654757 0 0 0.70710678118654757 1 0 0 4 a.png\n"
    "1 2 7 3 4 -1\n"
    "20 1e0 0 0 0 0 0 0 4 c d.png\n";
static const char points_text[] =
    "7 1 2 3 10 20 30 0.5 10 0 20 1 30 2\n"
    "# between\n"
    "5 4 5 6 1 2 3 0.5 30 0 10 1\n";

static void write_pictures(scratch *s) {
  scratch_picture(s, "images/a.png", 8, 6, grey);
  scratch_picture(s, "images/b.png", 8, 6, grey);
  scratch_picture(s, "images/c d.png", 8, 6, grey);
}

static void write_text(scratch *s, const char *cameras, const char *images, const char *points) {
  scratch_text(s, "sparse/0/cameras.txt", cameras);
  scratch_text(s, "sparse/0/images.txt", images);
  scratch_text(s, "sparse/0/points3D.txt", points);
}

static void test_text(void **state) {
  scratch *s = *state;
  write_pictures(s);
  write_text(s, cameras_text, images_text, points_text);
  pags_dataset *dataset = open_ok(s->folder, NULL);
  assert_string_equal(pags_dataset_kind(dataset), "colmap");
  assert_int_equal(pags_dataset_up(dataset), PAGS_UP_MINUS_Y);
  assert_int_equal(pags_dataset_view_count(dataset), 3);
  const char *const names[] = {"a.png", "b.png", "c d.png"};
  for (int i = 0; i < 3; i++)
    assert_string_equal(pags_dataset_view(dataset, i)->name, names[i]);
  const pags_camera *a = &pags_dataset_view(dataset, 0)->camera, *b = &pags_dataset_view(dataset, 1)->camera;
  assert_true(a->width == 8 && a->height == 6 && a->fx == 10 && a->fy == 11 && a->cx == 4 && a->cy == 3);
  /* View b: no rotation, x_camera = x_world - (1, 2, 3). View a: a quarter turn about z, centre = -R^T (1, 0, 0) =
   * (0, 1, 0). */
  assert_true(b->world_from_camera[3] == 1 && b->world_from_camera[7] == 2 && b->world_from_camera[11] == 3);
  assert_true(fabs(a->world_from_camera[3]) < 1e-12 && fabs(a->world_from_camera[7] - 1) < 1e-12);
  assert_true(fabs(a->world_from_camera[1] - 1) < 1e-12 && fabs(a->world_from_camera[4] + 1) < 1e-12);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 1 && !random && xyz[0] == 1 && xyz[2] == 3 && rgb[0] == 10 && rgb[2] == 30);
  pags_dataset_close(dataset);

  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0; /* without a held-out view both points count, in the order of their ids */
  dataset = open_ok(s->folder, &options);
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 2 && xyz[0] == 4 && xyz[3] == 1);
  pags_dataset_close(dataset);
}

static void test_places(void **state) {
  scratch *s = *state;
  const char *const models[] = {"", "sparse/", "colmap/sparse/0/"};
  write_pictures(s);
  for (int i = 0; i < 3; i++) {
    char name[64], text[1024];
    snprintf(text, sizeof text, "10 1 0 0 0 -1 -2 -3 4 b.png\n\n11 1 0 0 0 0 0 0 4 a.png\n");
    snprintf(name, sizeof name, "%scameras.txt", models[i]);
    scratch_text(s, name, cameras_text);
    snprintf(name, sizeof name, "%simages.txt", models[i]);
    scratch_text(s, name, text);
    pags_dataset *dataset = open_ok(s->folder, NULL);
    int64_t count;
    const float *xyz;
    const uint8_t *rgb;
    int random;
    pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
    assert_true(random); /* a model without points3D */
    pags_dataset_close(dataset);
    scratch_path(s, name);
    assert_int_equal(remove(s->path), 0);
  }
  /* A COLMAP model named in the options takes precedence over transforms.json; its path may be relative to the data
   * set. */
  scratch_text(s, "transforms.json", "{}");
  scratch_text(s, "other/cameras.txt", cameras_text);
  scratch_text(s, "other/images.txt", "10 1 0 0 0 -1 -2 -3 4 b.png\n\n11 1 0 0 0 0 0 0 4 a.png\n");
  pags_dataset_options options = pags_dataset_options_default();
  options.colmap = "other";
  pags_dataset_close(open_ok(s->folder, &options));
  options.colmap = "nowhere";
  pags_dataset *dataset;
  scratch_expect(pags_dataset_open(s->folder, &options, &dataset), PAGS_ERROR_FORMAT, "nowhere: not a COLMAP model");
}

/* One camera of each model, without distortion if the model is a pinhole. The angle models keep their focal lengths. */
static void test_camera_models(void **state) {
  scratch *s = *state;
  static const struct {
    const char *line;
    double fx, fy, cx, cy;
    bool pinhole;
  } known[] = {
      {"4 SIMPLE_PINHOLE 8 6 10 4 3\n", 10, 10, 4, 3, true},
      {"4 SIMPLE_RADIAL 8 6 10 4 3 0\n", 10, 10, 4, 3, true},
      {"4 RADIAL 8 6 10 4 3 0 0\n", 10, 10, 4, 3, true},
      {"4 OPENCV 8 6 10 11 4 3 0 0 0 0\n", 10, 11, 4, 3, true},
      {"4 FULL_OPENCV 8 6 10 11 4 3 0 0 0 0 0 0 0 0\n", 10, 11, 4, 3, true},
      {"4 FOV 8 6 10 11 4 3 1e-9\n", 10, 11, 4, 3, true},
      {"4 SIMPLE_DIVISION 8 6 10 4 3 0\n", 10, 10, 4, 3, true},
      {"4 DIVISION 8 6 10 11 4 3 0\n", 10, 11, 4, 3, true},
      {"4 EUCM 8 6 10 11 4 3 0 1\n", 10, 11, 4, 3, true},
      {"4 FOV 8 6 10 11 4 3 0.5\n", 10, 11, 4, 3, false},
      {"4 OPENCV_FISHEYE 8 6 10 11 4 3 0 0 0 0\n", 10, 11, 4, 3, false},
      {"4 SIMPLE_RADIAL_FISHEYE 8 6 10 4 3 0\n", 10, 10, 4, 3, false},
      {"4 RADIAL_FISHEYE 8 6 10 4 3 0 0\n", 10, 10, 4, 3, false},
      {"4 SIMPLE_FISHEYE 8 6 10 4 3\n", 10, 10, 4, 3, false},
      {"4 FISHEYE 8 6 10 11 4 3\n", 10, 11, 4, 3, false},
      {"4 THIN_PRISM_FISHEYE 8 6 10 11 4 3 0 0 0 0 0 0 0 0\n", 10, 11, 4, 3, false},
      {"4 RAD_TAN_THIN_PRISM_FISHEYE 8 6 10 11 4 3 0 0 0 0 0 0 0 0 0 0 0 0\n", 10, 11, 4, 3, false},
  };
  const char *const images = "10 1 0 0 0 -1 -2 -3 4 b.png\n\n11 1 0 0 0 0 0 0 4 a.png\n";
  write_pictures(s);
  for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
    write_text(s, known[i].line, images, "");
    pags_dataset *dataset = open_ok(s->folder, NULL);
    const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
    assert_true(camera->fx == known[i].fx && camera->fy == known[i].fy);
    if (known[i].pinhole)
      assert_true(camera->width == 8 && camera->height == 6 && camera->cx == known[i].cx && camera->cy == known[i].cy);
    pags_dataset_close(dataset);
  }
  write_text(s, "4 EQUIRECTANGULAR 8 6 8 6\n", images,
             ""); /* a panorama: directions behind the camera lie left of the picture */
  pags_dataset *panorama = open_ok(s->folder, NULL);
  const pags_camera *whole = &pags_dataset_view(panorama, 0)->camera;
  double direction[3];
  assert_true(whole->lens.kind == PAGS_LENS_EQUIRECTANGULAR && whole->width == 8);
  assert_true(pags_camera_look(whole, 2, 3, direction) && direction[0] < -0.999999);
  assert_true(pags_camera_look(whole, 4, 6 - 1e-9, direction) && direction[1] > 0.999999);
  pags_dataset_close(panorama);
  write_text(s, "4 FULL_OPENCV_2 8 6 10 11 4 3\n", images, "");
  open_fails(s->folder, PAGS_ERROR_UNSUPPORTED, "camera model FULL_OPENCV_2 is not known");
  /* Cameras without a picture may have any model; r(1 - r^2) folds within a picture of 20 pixels at a focal length
   * of 10. */
  write_text(s, "4 PINHOLE 8 6 10 11 4 3\n5 LATER 8 6 10\n6 OPENCV 8 6 -1.#IND 1 1 1 0 0 0 0\n", images, "");
  pags_dataset_close(open_ok(s->folder, NULL));
  write_text(s, "4 SIMPLE_RADIAL 8 6 5 4 3 -1\n", images, "");
  open_fails(s->folder, PAGS_ERROR_FORMAT, "the distortion can't be undone at");
}

/* The same files with byte order marks, Windows' line ends, and the separators of kapture. */
static void test_other_text(void **state) {
  scratch *s = *state;
  write_pictures(s);
  write_text(s, "\xef\xbb\xbf# a comment\r\n4, PINHOLE, 8, 6, 10, 11, 4, 3\r\n",
             "\xef\xbb\xbf"
             "10, 1, 0, 0, 0, -1, -2, -3, 4, b.png\r\n1, 2, 7, 3, 4, -1\r\n"
             "11 1 0 0 0\v0 0 0 4 a.png\r\n\r\n20 1 0 0 0 0 0 0 4 c d.png\r\n",
             "\xef\xbb\xbf"
             "7, 1, 2, 3, 10, 20, 30, 0.5, 10, 0, 20, 1\r\n");
  pags_dataset *dataset = open_ok(s->folder, NULL);
  assert_int_equal(pags_dataset_view_count(dataset), 3);
  assert_string_equal(pags_dataset_view(dataset, 2)->name, "c d.png");
  assert_true(pags_dataset_view(dataset, 0)->camera.fy == 11);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 1 && !random && rgb[2] == 30);
  pags_dataset_close(dataset);
  write_text(s, "4 PINHOLE 8 6 10,5 11 4 3\n", images_text, "");
  open_fails(s->folder, PAGS_ERROR_FORMAT, "cameras.txt:1: expected another parameter of the camera, found '10,5'");
  write_text(s, "\xff\xfe", images_text, "");
  open_fails(s->folder, PAGS_ERROR_FORMAT, "is UTF-16 text");
}

static int64_t points_of(scratch *s, const char *points, bool *is_random) {
  write_text(s, cameras_text, images_text, points);
  pags_dataset *dataset = open_ok(s->folder, NULL);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  pags_dataset_close(dataset);
  *is_random = random;
  return count;
}

/* Points of scanners have no tracks, or tracks with unknown views; points from depth have one view each. */
static void test_tracks(void **state) {
  scratch *s = *state;
  bool random;
  write_pictures(s);
  assert_int_equal(points_of(s, "1 1 2 3 1 1 1 0\n2 4 5 6 1 1 1 0\n", &random), 2);
  assert_false(random);
  assert_int_equal(points_of(s, "1 1 2 3 1 1 1 0 77 0 78 0\n2 4 5 6 1 1 1 0\n", &random), 2);
  /* View 30 is held out. */
  assert_int_equal(points_of(s, "1 1 2 3 1 1 1 0 10 0\n2 4 5 6 1 1 1 0 20 0\n3 4 5 6 1 1 1 0 30 0\n", &random), 2);
  assert_int_equal(points_of(s, "1 1 2 3 1 1 1 0 10 0 20 0\n2 4 5 6 1 1 1 0 20 0\n3 4 5 6 1 1 1 0\n", &random), 2);
  /* A point without a finite position is left out, with its track. */
  assert_int_equal(points_of(s, "1 nan 2 3 1 1 1 0 10 0 20 0\n2 4 5 6 1 1 1 0 10 0 20 0\n", &random), 1);
  assert_false(random);
}

static void test_bad_text(void **state) {
  scratch *s = *state;
  static const char good_images[] = "10 1 0 0 0 -1 -2 -3 4 b.png\n\n11 1 0 0 0 0 0 0 4 a.png\n";
  static const struct {
    const char *cameras, *images, *points, *part;
  } cases[] = {
      {"", good_images, "", "cameras.txt: expected at least one camera"},
      {"4 PINHOLE 8 6 10 11 4\n", good_images, "", "cameras.txt:1: expected another parameter"},
      {"4 PINHOLE 0 6 10 11 4 3\n", good_images, "", "cameras.txt:1: expected a width"},
      {"x PINHOLE 8 6 10 11 4 3\n", good_images, "", "cameras.txt:1: expected a camera's number"},
      {"4 PINHOLE 8 12 10 11 4 3\n", good_images, "", "8 x 6 pixels, expected 8 x 12"},
      {"4 PINHOLE 8 6 nan 11 4 3\n", good_images, "", "images.txt:"},
      {cameras_text, "", "", "at least one image"},
      {cameras_text, "10 1 0 0 0 -1 -2 -3 5 b.png\n", "", "images.txt:1: image b.png: expected its camera 5"},
      {cameras_text, "10 1 0 0 0 -1 -2\n", "", "images.txt:1: expected a number of the image's pose"},
      {cameras_text, "10 1 0 0 0 -1 -2 -3 4\n", "", "images.txt:1: image 10: expected a name"},
      {cameras_text, "10 0 0 0 0 -1 -2 -3 4 b.png\n", "", "images.txt:1: image b.png: expected a unit quaternion"},
      {cameras_text, "10 1 0 0 0 nan -2 -3 4 b.png\n", "", "images.txt:1"},
      {cameras_text, "1 1 0 0 0 0 0 0 4 b.png\n2 1 0 0 0 0 0 0 4 a.png\n", "", "images.txt:2: expected a line of obs"},
      {cameras_text, good_images, "7 1 2\n", "points3D.txt:1: expected a coordinate"},
      {cameras_text, good_images, "7 1 2 inf 1 1 1 0 10 1\n", "none of its 1 points has a finite position"},
      {cameras_text, good_images, "7 1 2 3 256 1 1 0 10 1\n", "points3D.txt:1: expected a colour"},
      {cameras_text, good_images, "7 1 2 3 25 1 1 0 10\n", "points3D.txt:1: expected the number of an obs"},
  };
  write_pictures(s);
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    write_text(s, cases[i].cameras, cases[i].images, cases[i].points);
    open_fails(s->folder, PAGS_ERROR_FORMAT, cases[i].part);
  }
}

/* The binary files of a model of one camera, two images and one point; the tests damage them. */
typedef struct buffer {
  uint8_t bytes[1024];
  size_t size;
} buffer;

static void put(buffer *b, const void *value, size_t size) {
  memcpy(b->bytes + b->size, value, size);
  b->size += size;
}

static void put_u64(buffer *b, uint64_t value) {
  put(b, &value, 8);
}

static void put_u32(buffer *b, uint32_t value) {
  put(b, &value, 4);
}

static void put_doubles(buffer *b, int count, ...) {
  va_list list;
  va_start(list, count);
  for (int i = 0; i < count; i++) {
    double value = va_arg(list, double);
    put(b, &value, 8);
  }
  va_end(list);
}

static void make_binary(buffer *cameras, buffer *images, buffer *points) {
  memset(cameras, 0, sizeof *cameras);
  memset(images, 0, sizeof *images);
  memset(points, 0, sizeof *points);
  put_u64(cameras, 1);
  put_u32(cameras, 4);
  put_u32(cameras, 1); /* the model PINHOLE */
  put_u64(cameras, 8);
  put_u64(cameras, 6);
  put_doubles(cameras, 4, 10.0, 11.0, 4.0, 3.0);
  put_u64(images, 2);
  for (uint32_t i = 0; i < 2; i++) {
    put_u32(images, 20 + i);
    put_doubles(images, 7, 1.0, 0.0, 0.0, 0.0, -1.0 - i, -2.0, -3.0);
    put_u32(images, 4);
    put(images, i ? "b.png" : "a.png", 6);
    put_u64(images, 1);
    put_doubles(images, 2, 1.5, 2.5);
    put_u64(images, UINT64_MAX);
  }
  put_u64(points, 1);
  put_u64(points, 99);
  put_doubles(points, 3, 1.0, 2.0, 3.0);
  put(points, "\1\2\3", 3);
  put_doubles(points, 1, 0.5);
  put_u64(points, 2);
  for (uint32_t i = 0; i < 2; i++) {
    put_u32(points, 20 + i);
    put_u32(points, 0);
  }
}

static void write_binary(scratch *s, const buffer *cameras, const buffer *images, const buffer *points) {
  scratch_write(s, "sparse/0/cameras.bin", cameras->bytes, cameras->size);
  scratch_write(s, "sparse/0/images.bin", images->bytes, images->size);
  scratch_write(s, "sparse/0/points3D.bin", points->bytes, points->size);
}

static void test_binary(void **state) {
  scratch *s = *state;
  buffer files[3];
  make_binary(&files[0], &files[1], &files[2]);
  write_pictures(s);
  write_binary(s, &files[0], &files[1], &files[2]);
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  pags_dataset *dataset = open_ok(s->folder, &options);
  assert_int_equal(pags_dataset_view_count(dataset), 2);
  const pags_camera *b = &pags_dataset_view(dataset, 1)->camera;
  assert_true(b->fy == 11 && b->world_from_camera[3] == 2 && b->world_from_camera[11] == 3);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 1 && xyz[1] == 2 && rgb[2] == 3);
  pags_dataset_close(dataset);
}

/* Every truncation of every file, and record counts larger than the file, must be refused with a message that names
 * the file. */
static void test_damaged_binary(void **state) {
  scratch *s = *state;
  static const char *const names[] = {"cameras.bin", "images.bin", "points3D.bin"};
  write_pictures(s);
  for (int i = 0; i < 3; i++) {
    buffer files[3];
    make_binary(&files[0], &files[1], &files[2]);
    size_t size = files[i].size;
    for (size_t cut = 0; cut < size; cut += 3) {
      files[i].size = cut;
      write_binary(s, &files[0], &files[1], &files[2]);
      open_fails(s->folder, PAGS_ERROR_FORMAT, names[i]);
    }
    files[i].size = size;
    memset(files[i].bytes, 0x7f, 8); /* overwrites the count of records */
    write_binary(s, &files[0], &files[1], &files[2]);
    open_fails(s->folder, PAGS_ERROR_FORMAT, names[i]);
  }
  buffer cameras, images, points;
  make_binary(&cameras, &images, &points);
  cameras.bytes[12] = 18;
  write_binary(s, &cameras, &images, &points);
  open_fails(s->folder, PAGS_ERROR_UNSUPPORTED, "number 18");
  cameras.bytes[12] = 200;
  write_binary(s, &cameras, &images, &points);
  open_fails(s->folder, PAGS_ERROR_UNSUPPORTED, "number 200");
}

/* ---- Real data ---- */

static void test_fox_forms_agree(void **state) {
  scratch *s = *state;
  char path[512], from[600], target[32];
  if (!pags_shared_data("fox/sparse/0/points3D.txt", path, sizeof path))
    skip();
  static const char *const parts[] = {"cameras", "images", "points3D"};
  char *model = pags_path_folder(path);
  scratch_text(s, "model/README", "the text form alone");
  for (int i = 0; i < 3; i++) {
    uint8_t *bytes;
    size_t size;
    snprintf(from, sizeof from, "%s/%s.txt", model, parts[i]);
    snprintf(target, sizeof target, "model/%s.txt", parts[i]);
    scratch_ok(pags_file_read(from, &bytes, &size));
    scratch_write(s, target, bytes, size);
    free(bytes);
  }
  free(model);
  assert_true(pags_shared_data("fox", path, sizeof path));
  pags_dataset_options options = pags_dataset_options_default();
  options.colmap = "sparse/0";
  pags_dataset *binary = open_ok(path, &options);
  options.colmap = scratch_path(s, "model");
  pags_dataset *text = open_ok(path, &options);
  assert_int_equal(pags_dataset_view_count(binary), 50);
  assert_int_equal(pags_dataset_view_count(text), 50);
  for (int64_t i = 0; i < 50; i++) {
    const pags_view *a = pags_dataset_view(binary, i), *b = pags_dataset_view(text, i);
    assert_string_equal(a->name, b->name);
    assert_memory_equal(&a->camera, &b->camera, offsetof(pags_camera, time));
  }
  int64_t count[2];
  const float *xyz[2];
  const uint8_t *rgb[2];
  int random[2];
  pags_dataset_points(binary, &count[0], &xyz[0], &rgb[0], &random[0]);
  pags_dataset_points(text, &count[1], &xyz[1], &rgb[1], &random[1]);
  assert_true(count[0] == count[1] && count[0] > 9000 && count[0] < 9919 && !random[0] && !random[1]);
  assert_memory_equal(xyz[0], xyz[1], (size_t)count[0] * 12);
  assert_memory_equal(rgb[0], rgb[1], (size_t)count[0] * 3);
  pags_dataset_close(binary);
  pags_dataset_close(text);
}

static void centre(const pags_dataset *dataset, int64_t i, double c[3]) {
  for (int j = 0; j < 3; j++)
    c[j] = pags_dataset_view(dataset, i)->camera.world_from_camera[4 * j + 3];
}

static double mean_centre(const pags_dataset *dataset, double mean[3]) {
  double c[3], square = 0;
  int64_t count = pags_dataset_view_count(dataset);
  memset(mean, 0, 3 * sizeof *mean);
  for (int64_t i = 0; i < count; i++) {
    centre(dataset, i, c);
    for (int j = 0; j < 3; j++)
      mean[j] += c[j] / (double)count;
  }
  for (int64_t i = 0; i < count; i++) {
    centre(dataset, i, c);
    for (int j = 0; j < 3; j++)
      square += (c[j] - mean[j]) * (c[j] - mean[j]);
  }
  return sqrt(square / (double)count);
}

/* The rotation between the worlds of two data sets: the mean of R_a R_b^T over the views, made a rotation again by
 * the camera check. */
static void mean_rotation(const pags_dataset *a, const pags_dataset *b, double r[9]) {
  pags_camera mean = pags_dataset_view(a, 0)->camera;
  int64_t count = pags_dataset_view_count(a);
  memset(mean.world_from_camera, 0, sizeof mean.world_from_camera);
  for (int64_t i = 0; i < count; i++) {
    double inverse[12], between[12];
    pags_rigid_inverse(pags_dataset_view(b, i)->camera.world_from_camera, inverse);
    pags_rigid_multiply(pags_dataset_view(a, i)->camera.world_from_camera, inverse, between);
    for (int j = 0; j < 12; j++)
      mean.world_from_camera[j] += between[j] / (double)count;
  }
  scratch_ok(pags_camera_check(&mean, "mean rotation"));
  for (int i = 0; i < 9; i++)
    r[i] = mean.world_from_camera[i / 3 * 4 + i % 3];
}

/* As stated in the data set's README: after a similarity of scale 0.87549, the camera centres of both pose sets
 * differ by 0.0029 RMS and by 0.012 at most. */
static void test_fox_poses_agree(void **state) {
  (void)state;
  char path[512];
  if (!pags_shared_data("fox", path, sizeof path))
    skip();
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *transforms = open_ok(path, &options);
  options.colmap = "sparse/0";
  pags_dataset *colmap = open_ok(path, &options);
  double mean_t[3], mean_c[3], r[9], square = 0, largest = 0;
  double scale = mean_centre(transforms, mean_t) / mean_centre(colmap, mean_c);
  mean_rotation(transforms, colmap, r);
  for (int64_t i = 0; i < 50; i++) {
    double t[3], c[3], distance = 0;
    assert_string_equal(pags_dataset_view(transforms, i)->name, pags_dataset_view(colmap, i)->name);
    centre(transforms, i, t);
    centre(colmap, i, c);
    for (int j = 0; j < 3; j++) {
      double moved = mean_t[j];
      for (int k = 0; k < 3; k++)
        moved += scale * r[3 * j + k] * (c[k] - mean_c[k]);
      distance += (moved - t[j]) * (moved - t[j]);
    }
    square += distance / 50;
    largest = fmax(largest, sqrt(distance));
  }
  assert_true(fabs(scale - 0.87549) < 2e-4);
  assert_true(sqrt(square) < 0.0033);
  assert_true(largest < 0.0135);
  pags_dataset_close(transforms);
  pags_dataset_close(colmap);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      scratch_test(test_text),
      scratch_test(test_places),
      scratch_test(test_camera_models),
      scratch_test(test_other_text),
      scratch_test(test_tracks),
      scratch_test(test_bad_text),
      scratch_test(test_binary),
      scratch_test(test_damaged_binary),
      scratch_test(test_fox_forms_agree),
      cmocka_unit_test(test_fox_poses_agree),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
