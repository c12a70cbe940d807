/* SPDX-License-Identifier: Apache-2.0 */
/* Tests pixel labels of driving sets, from label pictures and from boxes; sky guessed from LiDAR; masks of the ego
 * vehicle. */
#include <pags/dataset.h>

#include "dataset/internal.h"
#include "shared_data.h"
#include "unit/driving_tree.h"

static void with_photo(const pags_dataset *dataset, int64_t view, int shrink, void (*look)(const pags_photo *, void *),
                       void *context) {
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photo_cache *cache;
  pags_photo photo;
  scratch_ok(pags_photo_cache_create(dataset, tasks, UINT64_C(1) << 26, &cache));
  scratch_ok(pags_photo_cache_get(cache, view, shrink, &photo));
  look(&photo, context);
  pags_photo_cache_destroy(cache);
  pags_tasks_destroy(tasks);
}

static void copy_photo(const pags_photo *photo, void *context) {
  pags_photo *out = context;
  size_t plane = (size_t)photo->stride * (size_t)photo->height;
  *out = *photo;
  out->rgb = NULL;
  uint8_t *labels = photo->labels ? malloc(plane) : NULL, *mask = photo->mask ? malloc(plane) : NULL;
  if (labels)
    memcpy(labels, photo->labels, plane);
  if (mask)
    memcpy(mask, photo->mask, plane);
  out->labels = labels;
  out->mask = mask;
}

static void drop_photo(pags_photo *photo) {
  free((void *)(uintptr_t)photo->labels);
  free((void *)(uintptr_t)photo->mask);
}

static uint8_t white_above(int x, int y) {
  (void)x;
  return y < 6 ? 255 : 0;
}

static uint8_t white_right(int x, int y) {
  (void)y;
  return x >= 40 ? 255 : 0;
}

static uint8_t white_low(int x, int y) {
  (void)x;
  return y >= 30 ? 255 : 0;
}

static uint8_t classes(int x, int y) {
  return y < 4    ? 10
         : x < 5  ? 13
         : x < 10 ? 11
         : x < 15 ? 19
                  : 0; /* sky above; below from left: car, person, unknown, road */
}

static int label_at(const pags_photo *photo, int x, int y) {
  return photo->labels[y * photo->stride + x];
}

/* Returns the label bits that the boxes give a pixel, drawn from the boxes' outlines. */
static int box_bits(const pags_dataset *dataset, const pags_view *view, int x, int y, const int bits[2]) {
  int sum = 0;
  for (int i = 0; i < 2; i++) {
    double pose[12], corners[32];
    uint8_t plane[TREE_WIDTH * TREE_HEIGHT] = {0};
    const pags_object *object = pags_dataset_object(dataset, i);
    if (!pags_object_pose(object, view->camera.time, pose) || (i == 1 && (view->frame == 0 || view->frame == 4)))
      continue;
    int count = pags_box_outline(&view->camera, pose, object->size, corners);
    pags_outline_fill(corners, count, view->camera.width, view->camera.height, view->camera.width, 1, plane);
    sum |= plane[y * view->camera.width + x] ? bits[i] : 0;
  }
  return sum;
}

/* Compares the label bits of every pixel with the expected bits. `files` lists the sources that were written: s sky
 * masks, c semantic classes, d dynamic masks, b boxes, e boxes at all frames but this one. */
static void check_labels(scratch *s, const char *files, int shrink) {
  pags_dataset_options options = tree_options("pandaset");
  pags_dataset *dataset;
  pags_photo photo;
  options.downscale = shrink;
  scratch_ok(pags_dataset_open(s->folder, &options, &dataset));
  const pags_view *view = pags_dataset_view(dataset, 4);
  with_photo(dataset, 4, 1, copy_photo, &photo);
  bool sky = strchr(files, 's'), semantic = strchr(files, 'c'), dynamic = strchr(files, 'd'),
       boxes = strchr(files, 'b');
  const int critical = semantic ? 0 : PAGS_LABEL_CRITICAL;
  const int bits[2] = {PAGS_LABEL_VEHICLE | critical | (dynamic ? 0 : PAGS_LABEL_MOVING), PAGS_LABEL_PARKED | critical};
  int seen = 0;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      int u = x * shrink + shrink / 2, v = y * shrink + shrink / 2,
          expected = boxes ? box_bits(dataset, view, x, y, bits) : 0;
      expected |= (sky ? white_above(u, v) : semantic && classes(u, v) == 10) ? PAGS_LABEL_SKY : 0;
      const bool known = sky || (semantic && classes(u, v) <= 18); /* of the sky; other ids are no classes */
      expected |= known ? 0 : PAGS_LABEL_SKY_UNKNOWN;
      expected |= semantic && classes(u, v) >= 11 && classes(u, v) <= 18 ? PAGS_LABEL_CRITICAL : 0;
      expected |= dynamic && white_right(u, v) ? PAGS_LABEL_MOVING | PAGS_LABEL_CRITICAL : 0;
      if (label_at(&photo, x, y) != expected)
        fail_msg("%s / %d: label %d at %d %d, expected %d", files, shrink, label_at(&photo, x, y), x, y, expected);
      seen |= expected;
      bool used =
          boxes || !((semantic && classes(u, v) >= 11 && classes(u, v) <= 18) || (dynamic && white_right(u, v)));
      if (shrink == 1)
        assert_int_equal(photo.mask ? photo.mask[y * photo.stride + x] : 255, used ? 255 : 0);
    }
  if (boxes)
    assert_true((seen & PAGS_LABEL_VEHICLE) && (seen & PAGS_LABEL_PARKED));
  drop_photo(&photo);
  pags_dataset_close(dataset);
}

static void labels_come_from_available_sources(void **state) {
  (void)state;
  static const char *const sets[] = {"s", "c", "d", "b", "sc", "cb", "db", "sdb", "scdb", "ce", "de"};
  for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
    for (int shrink = 1; shrink <= 2; shrink++) {
      scratch s;
      scratch_begin(&s);
      tree_write_cameras(&s, &tree_kinds[1]);
      if (strchr(sets[i], 's'))
        tree_write_grey(&s, "sky_masks/002_0.png", white_above);
      if (strchr(sets[i], 'c'))
        tree_write_grey(&s, "semantic/002_0.png", classes);
      if (strchr(sets[i], 'd'))
        tree_write_grey(&s, "dynamic_masks/all/002_0.png", white_right);
      if (strchr(sets[i], 'b'))
        tree_write_boxes(&s, &tree_kinds[1]);
      if (strchr(sets[i], 'e')) { /* boxes at all frames but this one */
        tree_write_boxes(&s, &tree_kinds[1]);
        tree_text(&s, "instances/frame_instances.json", "{\"0\":[0],\"1\":[0,1],\"3\":[1,0],\"4\":[0]}");
      }
      check_labels(&s, sets[i], shrink);
      scratch_end(&s);
    }
}

/* Label planes count in the cache's size limit; photographs and labels are the same with a small and a large limit. */
static void size_limits_include_labels(void **state) {
  (void)state;
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &tree_kinds[1]);
  for (int t = 0; t < TREE_FRAMES; t++) {
    char name[64];
    snprintf(name, sizeof name, "semantic/%03d_0.png", t);
    tree_write_grey(&s, name, classes);
  }
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  /* Room for three photographs with a label plane; a decode also holds the source's six bytes a pixel. */
  const uint64_t room = 3 * (5 * 48 * TREE_HEIGHT + 64) + 6 * 48 * TREE_HEIGHT;
  for (int round = 0; round < 3; round++) {
    uint64_t budget = room + (uint64_t)round * 9000, used, peak, decoded;
    pags_tasks *tasks = pags_tasks_create(2);
    pags_photo_cache *cache;
    int64_t order[TREE_FRAMES * TREE_CAMERAS];
    scratch_ok(pags_photo_cache_create(dataset, tasks, budget, &cache));
    for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++)
      order[i] = i * 3 % (TREE_FRAMES * TREE_CAMERAS);
    pags_photo_cache_prefetch(cache, order, TREE_FRAMES * TREE_CAMERAS, 1);
    for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++) {
      pags_photo photo, alone;
      with_photo(dataset, order[i], 1, copy_photo, &alone);
      scratch_ok(pags_photo_cache_get(cache, order[i], 1, &photo));
      assert_memory_equal(photo.labels, alone.labels, (size_t)(photo.stride * photo.height));
      drop_photo(&alone);
      pags_photo_cache_figures(cache, &used, &peak, &decoded);
      assert_true(used >= 4 * 48 * TREE_HEIGHT && peak <= budget);
    }
    pags_photo_cache_destroy(cache);
    pags_tasks_destroy(tasks);
  }
  pags_dataset_close(dataset);
  scratch_end(&s);
}

static uint8_t paint_sky(int x, int y, int c) {
  (void)x, (void)c;
  return y < 8 ? 255 : 0;
}

static void a_mask_of_another_size_is_refused(void **state) {
  (void)state;
  pags_dataset *dataset;
  pags_photo_cache *cache;
  pags_photo photo;
  pags_tasks *tasks = pags_tasks_create(1);
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  scratch_picture(&s, "sky_masks/000_0.png", 20, 10, tree_paint);
  scratch_expect(pags_dataset_open(s.folder, NULL, &dataset), PAGS_ERROR_FORMAT,
                 "sky_masks/000_0.png: 20 x 10 pixels, expected 48 x 32");
  /* A label picture that isn't read when the set is opened is refused when it is used. */
  scratch_picture(&s, "sky_masks/000_1.png", TREE_WIDTH, TREE_HEIGHT, paint_sky);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  scratch_ok(pags_photo_cache_create(dataset, tasks, UINT64_C(1) << 24, &cache));
  scratch_expect(pags_photo_cache_get(cache, 0, 1, &photo), PAGS_ERROR_FORMAT, "sky_masks/000_0.png: 20 x 10 pixels");
  pags_photo_cache_destroy(cache);
  pags_dataset_close(dataset);
  pags_tasks_destroy(tasks);
  scratch_end(&s);
}

/* Labels are undistorted like the picture: a straight border in the source mask is found where the barrel distortion
 * maps it. */
static void labels_are_undistorted(void **state) {
  (void)state;
  pags_dataset *dataset;
  pags_photo photo;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_text(&s, "intrinsics/0.txt", "40 40 24 16 -0.2 0.01 0 0 0");
  tree_write_grey(&s, "dynamic_masks/all/000_0.png", white_right);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  with_photo(dataset, 0, 1, copy_photo, &photo);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  int moving = 0;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      double a = (x + 0.5 - camera->cx) / camera->fx, b = (y + 0.5 - camera->cy) / camera->fy, r = a * a + b * b;
      double u = 40 * a * (1 - 0.2 * r + 0.01 * r * r) + 24;
      assert_int_equal(label_at(&photo, x, y),
                       PAGS_LABEL_SKY_UNKNOWN | (u >= 40 ? PAGS_LABEL_MOVING | PAGS_LABEL_CRITICAL : 0));
      moving += u >= 40;
    }
  assert_true(moving > 0 && photo.width < TREE_WIDTH + 8);
  drop_photo(&photo);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* Without label files sky is guessed from LiDAR. Here a wall fills the left half up to an elevation of some 5
 * degrees, and the right half has only a road. */
static void sky_is_guessed_from_the_lidar(void **state) {
  (void)state;
  enum { COUNT = 40 * 60 };
  static float rows[COUNT * 5];
  pags_dataset *dataset;
  pags_photo photo;
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &tree_kinds[1]);
  scratch_ok(pags_remove_tree(scratch_path(&s, "instances")));
  for (int i = 0; i < COUNT; i++) {
    double azimuth = (i % 60 - 30) * 0.03, elevation = i / 60 * 0.006 - 0.14, range = 30;
    bool wall = azimuth > 0; /* the vehicle's y axis points left */
    float *row = rows + 5 * i;
    row[0] = (float)(range * cos(azimuth) + 1.5), row[1] = (float)(range * sin(azimuth) + 0.3);
    row[2] = (float)(1.6 + range * tan(wall ? elevation : -0.1));
    if (!wall && i == 0) /* a point on a mast far to the right sets the LiDAR's highest elevation */
      row[2] = (float)(1.6 + range * tan(0.4));
  }
  tree_bytes(&s, "lidar/000.bin", rows, sizeof rows);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  with_photo(dataset, 0, 1, copy_photo, &photo);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  int sky = 0;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      double azimuth = -atan((x + 0.5 - camera->cx) / camera->fx);
      double elevation = atan((camera->cy - y - 0.5) / hypot(camera->fx, x + 0.5 - camera->cx));
      int found = label_at(&photo, x, y) & PAGS_LABEL_SKY;
      if (fabs(azimuth) < 0.06 || azimuth < -0.4)
        continue;
      assert_false(label_at(&photo, x, y) & PAGS_LABEL_SKY_UNKNOWN);
      double top = azimuth > 0 ? 39 * 0.006 - 0.14 + 0.026 : 0.0175;
      if (fabs(elevation - top) > 0.02)
        assert_int_equal(found, elevation > top);
      sky += found;
    }
  assert_true(sky > 100);
  drop_photo(&photo);
  pags_dataset_close(dataset);

  /* With only the LiDAR point of the mast, sky is unknown above the horizon, and nothing below it is sky. */
  tree_bytes(&s, "lidar/000.bin", rows, 5 * sizeof *rows);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  with_photo(dataset, 0, 1, copy_photo, &photo);
  for (int y = 0; y < photo.height; y++) {
    int bits = label_at(&photo, 24, y) & (PAGS_LABEL_SKY | PAGS_LABEL_SKY_UNKNOWN);
    if (abs(y - 15) > 4) /* not at the horizon */
      assert_int_equal(bits, y < 15 ? PAGS_LABEL_SKY_UNKNOWN : 0);
  }
  drop_photo(&photo);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* ---- Masks of the ego vehicle ---- */

enum { WIDE = 320, HIGH = 200, DRIVE = 24 };

static int drive_frame;

/* Paints noise that changes with each frame, and below it a patterned bonnet that stays. */
static uint8_t paint_drive(int x, int y, int c) {
  bool bonnet = y > 150 + (x - 160) * (x - 160) / 400;
  unsigned seed =
      (unsigned)(x / 4) * 73856093u ^ (unsigned)(y / 4) * 19349663u ^ (bonnet ? 0 : (unsigned)drive_frame * 83492791u);
  seed = (seed ^ seed >> 13) * 1274126177u;
  return (uint8_t)((seed >> 16 & 127) + (unsigned)c);
}

static uint8_t paint_open(int x, int y, int c) {
  return paint_drive(x, y > 150 ? 300 - y : y, c);
}

static void write_drive(scratch *s, uint8_t (*paint)(int x, int y, int c), bool looks_up) {
  for (drive_frame = 0; drive_frame < DRIVE; drive_frame++) {
    double pose[12];
    char name[64];
    snprintf(name, sizeof name, "images/%03d_0.png", drive_frame);
    scratch_picture(s, name, WIDE, HIGH, paint);
    snprintf(name, sizeof name, "extrinsics/%03d_0.txt", drive_frame);
    tree_view(drive_frame, 0, pose);
    for (int k = 0; looks_up && k < 12; k += 4) { /* forward becomes up, and down becomes forward */
      const double down = pose[k + 1];
      pose[k + 1] = pose[k + 2];
      pose[k + 2] = -down;
    }
    tree_write_matrix(s, name, pose);
  }
  tree_text(s, "intrinsics/0.txt", "200 200 160 100 0 0 0 0 0");
}

static void the_ego_vehicle_is_found(void **state) {
  (void)state;
  pags_dataset *dataset;
  pags_photo photo;
  scratch s;
  scratch_begin(&s);
  write_drive(&s, paint_drive, false);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  assert_true(tree_has_note(dataset, "ego mask: camera 0 sees"));
  with_photo(dataset, 3, 1, copy_photo, &photo);
  assert_non_null(photo.mask);
  for (int y = 0; y < HIGH; y++)
    for (int x = 0; x < WIDE; x++) {
      int depth = y - (150 + (x - 160) * (x - 160) / 400); /* pixels below the bonnet's edge */
      if (depth > 4 && abs(x - 160) < 100)
        assert_int_equal(photo.mask[y * photo.stride + x], 0);
      if (depth < -8)
        assert_int_equal(photo.mask[y * photo.stride + x], 255);
    }
  drop_photo(&photo);
  pags_dataset_close(dataset);
  write_drive(&s, paint_open, false);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  assert_true(tree_has_note(dataset, "none found"));
  pags_dataset_close(dataset);

  /* An upward-looking camera sees sky at the picture's lower edge, which never changes and isn't taken for the ego
   * vehicle. */
  write_drive(&s, paint_drive, true);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  assert_true(tree_has_note(dataset, "don't stand upright and aren't searched, the first is camera 0"));
  assert_true(tree_has_note(dataset, "none found"));
  pags_dataset_close(dataset);
  scratch_end(&s);
}

static void given_ego_masks_are_used(void **state) {
  (void)state;
  for (int given = 0; given < 3; given++) {
    pags_dataset_options options = tree_options("pandaset");
    pags_dataset *dataset;
    scratch s;
    scratch_begin(&s);
    tree_write_cameras(&s, &tree_kinds[1]);
    tree_write_grey(&s, given == 0 ? "ego_masks/1.png" : "elsewhere/1.png", white_low);
    char path[256];
    snprintf(path, sizeof path, "%s/%s", s.folder, given == 1 ? "elsewhere" : "elsewhere/1.png");
    options.ego_mask = given > 0 ? path : NULL;
    scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
    for (int view = 0; view < 2; view++) { /* the first views of cameras 0 and 1 */
      pags_photo photo;
      with_photo(dataset, view, 1, copy_photo, &photo);
      bool masked = given == 2 || view == 1;
      assert_true((photo.mask != NULL) == masked);
      for (int i = 0; masked && i < TREE_WIDTH * TREE_HEIGHT; i++)
        assert_int_equal(photo.mask[i / TREE_WIDTH * photo.stride + i % TREE_WIDTH],
                         white_low(0, i / TREE_WIDTH) ? 0 : 255);
      drop_photo(&photo);
    }
    pags_dataset_close(dataset);
    scratch_picture(&s, given == 0 ? "ego_masks/1.png" : "elsewhere/1.png", 20, 10, tree_paint);
    scratch_expect(tree_open(&s, &options), PAGS_ERROR_FORMAT, "ego mask of 20 x 10 pixels");
    scratch_end(&s);
  }
}

/* ---- Scene 002 of PandaSet ---- */

/* The boxes of all objects cover dynamic_masks/all, which other software drew from the same boxes. */
static void pandaset_boxes_match_masks(void **state) {
  (void)state;
  pags_dataset *dataset = tree_pandaset();
  if (!dataset)
    skip();
  int64_t both = 0, either = 0;
  for (int64_t i = 0; i < 240; i += 7) {
    pags_photo photo;
    const pags_view *view = pags_dataset_view(dataset, i);
    with_photo(dataset, i, 1, copy_photo, &photo);
    uint8_t *plane = calloc((size_t)photo.stride, (size_t)photo.height);
    assert_non_null(plane);
    for (int64_t k = 0; k < pags_dataset_object_count(dataset); k++) {
      const pags_object *object = pags_dataset_object(dataset, k);
      const pags_keyframe *keyframe = pags_object_keyframe(object, view->frame);
      double corners[32];
      if (keyframe)
        pags_outline_fill(corners, pags_box_outline(&view->camera, keyframe->world_from_object, object->size, corners),
                          photo.width, photo.height, photo.stride, 1, plane);
    }
    for (int j = 0; j < photo.stride * photo.height; j++) {
      bool mask = photo.labels[j] & PAGS_LABEL_MOVING, box = plane[j];
      both += mask && box;
      either += mask || box;
    }
    free(plane);
    drop_photo(&photo);
  }
  assert_true(either > 100000);
  if (!((double)both / (double)either >= 0.97))
    fail_msg("intersection over union %g", (double)both / (double)either);
  pags_dataset_close(dataset);
}

/* Returns whether a point of the world lies in the box of a moving vehicle at a frame. */
static bool in_vehicle(const pags_dataset *dataset, int frame, const double p[3]) {
  for (int64_t k = 0; k < pags_dataset_object_count(dataset); k++) {
    const pags_object *object = pags_dataset_object(dataset, k);
    const pags_keyframe *keyframe = pags_object_keyframe(object, frame);
    if (!keyframe || !object->moving || object->category != PAGS_CATEGORY_VEHICLE)
      continue;
    const double *m = keyframe->world_from_object;
    bool inside = true;
    for (int c = 0; c < 3; c++)
      inside = inside && fabs(m[c] * (p[0] - m[3]) + m[4 + c] * (p[1] - m[7]) + m[8 + c] * (p[2] - m[11])) <
                             0.5 * object->size[c];
    if (inside)
      return true;
  }
  return false;
}

/* LiDAR points inside boxes of moving vehicles project into dynamic_masks/vehicle, which shows that poses, axes and
 * times agree. */
static void pandaset_lidar_hits_masks(void **state) {
  (void)state;
  char path[1024], name[1100];
  pags_dataset *dataset = tree_pandaset();
  if (!dataset || !pags_shared_data("pandaset-002", path, sizeof path))
    skip();
  int64_t inside = 0, all = 0;
  for (int64_t i = 0; i < pags_dataset_sweep_count(dataset); i += 5) {
    const pags_sweep *sweep = pags_dataset_sweep(dataset, i);
    const pags_camera *camera = &pags_dataset_view(dataset, 3 * sweep->frame)->camera;
    double from_world[12];
    int64_t count;
    float *xyz;
    pags_image mask;
    snprintf(name, sizeof name, "%s/dynamic_masks/vehicle/%03d_0.png", path, sweep->frame);
    scratch_ok(pags_image_load(name, PAGS_U8, 1, &mask));
    scratch_ok(pags_dataset_sweep_load(dataset, i, &count, &xyz));
    pags_rigid_inverse(camera->world_from_camera, from_world);
    for (int64_t k = 0; k < count; k++) {
      const double point[3] = {(double)xyz[3 * k], (double)xyz[3 * k + 1], (double)xyz[3 * k + 2]};
      double world[3], p[3];
      pags_rigid_point(sweep->world_from_sweep, point, world);
      pags_rigid_point(from_world, world, p);
      double u = camera->fx * p[0] / p[2] + camera->cx, v = camera->fy * p[1] / p[2] + camera->cy;
      if (p[2] < 0.5 || u < 0 || v < 0 || u >= camera->width || v >= camera->height ||
          !in_vehicle(dataset, sweep->frame, world))
        continue;
      all++;
      inside += ((uint8_t *)mask.data)[(int)v * mask.width + (int)u] >= 128;
    }
    pags_image_destroy(&mask);
    free(xyz);
  }
  assert_true(all > 500);
  if (!((double)inside / (double)all >= 0.99))
    fail_msg("%g of %d points", (double)inside / (double)all, (int)all);
  assert_true(tree_has_note(dataset, "ego mask: none given, none found"));
  assert_true(tree_has_note(dataset, "none for 4 frames: 056 057 058 071"));
  pags_dataset_close(dataset);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(labels_come_from_available_sources), cmocka_unit_test(size_limits_include_labels),
      cmocka_unit_test(a_mask_of_another_size_is_refused),  cmocka_unit_test(labels_are_undistorted),
      cmocka_unit_test(sky_is_guessed_from_the_lidar),      cmocka_unit_test(the_ego_vehicle_is_found),
      cmocka_unit_test(given_ego_masks_are_used),           cmocka_unit_test(pandaset_boxes_match_masks),
      cmocka_unit_test(pandaset_lidar_hits_masks),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
