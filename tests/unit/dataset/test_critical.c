/* SPDX-License-Identifier: Apache-2.0 */
/* Tests which pixels are critical: label sets, the option --critical, the order of sources, and for PandaSet the
 * union of semantic classes and dynamic masks. */
#include <pags/dataset.h>

#include "dataset/driving/label_sets.h"
#include "dataset/internal.h"
#include "shared_data.h"
#include "unit/driving_tree.h"

/* Every label set has vehicles, pedestrians and cyclists; a class is found by its name and by its number. */
static void label_sets_are_sound(void **state) {
  (void)state;
  for (int i = 0; i < PAGS_LABEL_SETS; i++) {
    const pags_label_set *set = &pags_label_sets[i];
    int kinds[4] = {0};
    char name[PAGS_LABEL_NAME];
    assert_ptr_equal(pags_label_set_find(set->name), set);
    for (int c = 0; c < set->count; c++) {
      assert_int_equal(pags_label_class_named(set, pags_label_name(set, set->first + c, name)), set->first + c);
      assert_true(pags_label_set_has(set, set->first + c));
      kinds[pags_label_category(set, set->first + c)]++;
    }
    assert_false(pags_label_set_has(set, set->first - 1) || pags_label_set_has(set, set->first + set->count));
    assert_true(kinds[PAGS_CATEGORY_VEHICLE] > 2 && kinds[PAGS_CATEGORY_PEDESTRIAN] > 0 &&
                kinds[PAGS_CATEGORY_CYCLIST] > 1);
  }
  assert_ptr_equal(pags_label_set_find("cityscapes train ids"), &pags_label_sets[0]);
  assert_null(pags_label_set_find("cityscape"));
}

/* PandaSet's label images and its boxes use the same class names: the tables of both must agree on each name's
 * category. */
static void label_images_and_boxes_agree(void **state) {
  (void)state;
  const pags_label_set *set = pags_label_set_find("pandaset");
  char name[PAGS_LABEL_NAME];
  assert_string_equal(pags_label_name(set, 42, name), "Other Static Object");
  assert_string_equal(pags_label_name(pags_label_set_find("kitti-360"), 44, name), "unknown object");
  for (int c = 0; c < set->count; c++)
    if (pags_label_category(set, set->first + c) != pags_category_of(pags_label_name(set, set->first + c, name)))
      fail_msg("%s", name);
  assert_true(pags_same_word("Medium-sized Truck", "medium_sized truck"));
  assert_false(pags_same_word("car", "cart") || pags_same_word("traffic light", "trafficlight"));
}

/* ---- On pictures ---- */

enum { LEFT = 1, MIDDLE = 2, RIGHT = 4, TOP = 8, PEDESTRIAN_BOX = 16, CAR_BOX = 32 };

static uint8_t classes(int x, int y) {
  (void)y;
  return x < 4 ? 13 : x < 8 ? 11 : x < 12 ? 0 : 255; /* from left to right: car, person, road, unknown */
}

static uint8_t white_right(int x, int y) {
  (void)y;
  return x >= 44 ? 255 : 0;
}

static uint8_t white_top(int x, int y) {
  (void)x;
  return y < 3 ? 255 : 0;
}

static uint8_t white_both(int x, int y) {
  return white_right(x, y) | white_top(x, y);
}

/* Finds in which regions of the picture view 4 (frame 2, camera 0), which shows both boxes, has critical pixels. */
static void critical_plane(const pags_dataset *dataset, int64_t view, uint8_t *plane, int width, int height) {
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photo_cache *cache;
  pags_photo photo;
  scratch_ok(pags_photo_cache_create(dataset, tasks, UINT64_C(1) << 26, &cache));
  scratch_ok(pags_photo_cache_get(cache, view, 1, &photo));
  assert_true(photo.width == width && photo.height == height && photo.labels);
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++)
      plane[y * width + x] = (photo.labels[y * photo.stride + x] & PAGS_LABEL_CRITICAL) != 0;
  pags_photo_cache_destroy(cache);
  pags_tasks_destroy(tasks);
}

static void draw_box(const pags_dataset *dataset, const pags_view *view, int object, uint8_t bit, uint8_t *plane) {
  double pose[12], corners[32];
  const pags_object *box = pags_dataset_object(dataset, object);
  assert_true(pags_object_pose(box, view->camera.time, pose));
  int count = pags_box_outline(&view->camera, pose, box->size, corners);
  pags_outline_fill(corners, count, TREE_WIDTH, TREE_HEIGHT, TREE_WIDTH, bit, plane);
}

typedef struct critical_case {
  /* Letters of the files that are written: c semantic classes, d dynamic_masks/all, p dynamic_masks/vehicle and
   * human. */
  const char *list, *files;
  int regions;
  const char *note;
} critical_case;

static void check_case(const critical_case *c) {
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset;
  uint8_t found[TREE_WIDTH * TREE_HEIGHT], boxes[TREE_WIDTH * TREE_HEIGHT] = {0};
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_write_boxes(&s, &tree_kinds[1]);
  if (strchr(c->files, 'c'))
    tree_write_grey(&s, "semantic/002_0.png", classes);
  if (strchr(c->files, 'd'))
    tree_write_grey(&s, "dynamic_masks/all/002_0.png", white_both);
  if (strchr(c->files, 'p')) {
    tree_write_grey(&s, "dynamic_masks/vehicle/002_0.png", white_right);
    tree_write_grey(&s, "dynamic_masks/human/002_0.png", white_top);
  }
  options.kind = "pandaset";
  options.critical = c->list;
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  critical_plane(dataset, 4, found, TREE_WIDTH, TREE_HEIGHT);
  draw_box(dataset, pags_dataset_view(dataset, 4), 0, CAR_BOX, boxes);
  draw_box(dataset, pags_dataset_view(dataset, 4), 1, PEDESTRIAN_BOX, boxes);
  for (int i = 0; i < TREE_WIDTH * TREE_HEIGHT; i++) {
    int x = i % TREE_WIDTH, y = i / TREE_WIDTH;
    int regions = (x < 4 ? LEFT : x < 8 ? MIDDLE : x >= 44 ? RIGHT : 0) | (y < 3 ? TOP : 0) | boxes[i];
    if (found[i] != ((regions & c->regions) != 0))
      fail_msg("critical '%s' with '%s': %d at %d %d", c->list ? c->list : "-", c->files, found[i], x, y);
  }
  if (!tree_has_note(dataset, c->note))
    fail_msg("critical '%s' with '%s': no note '%s'", c->list ? c->list : "-", c->files, c->note);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

static void sources_come_in_order(void **state) {
  (void)state;
  static const critical_case cases[] = {
      {NULL, "cdp", LEFT | MIDDLE | RIGHT | TOP,
       "from semantic and dynamic_masks in 1 of 10 views, boxes in 9 of 10 views"},
      {NULL, "c", LEFT | MIDDLE, "from semantic in 1 of 10 views"},
      {NULL, "dp", RIGHT | TOP | CAR_BOX | PEDESTRIAN_BOX, "from dynamic_masks and boxes in 1"},
      {NULL, "", CAR_BOX | PEDESTRIAN_BOX, "pedestrians and cyclists from boxes in 10 of 10 views"},
      {"vehicle, pedestrian,cyclist", "cdp", LEFT | MIDDLE | RIGHT | TOP, "classes of cityscapes: person, rider, car"},
      {"car", "cdp", LEFT | RIGHT, "critical: car from semantic and dynamic_masks"},
      {"Vehicles", "", CAR_BOX, "critical: Vehicles from boxes"},
      {"11", "cp", MIDDLE | TOP, "classes of cityscapes: person"},
      /* The mask of all moving objects doesn't tell persons from others, so it isn't used for one class. */
      {"person", "d", PEDESTRIAN_BOX, "from boxes"},
      {"pedestrian", "cp", MIDDLE | TOP, "from semantic and dynamic_masks"},
      {"truck", "", CAR_BOX, "from boxes"}, /* no box has the class truck: boxes of its category are taken */
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
    check_case(&cases[i]);
}

/* The key labels of dataset.json names the table by which label images are read. */
static void other_label_sets_are_read(void **state) {
  (void)state;
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset;
  uint8_t found[TREE_WIDTH * TREE_HEIGHT];
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_write_boxes(&s, &tree_kinds[1]);
  tree_write_grey(&s, "semantic/002_0.png", classes);
  tree_text(&s, "dataset.json", "{\"kind\": \"pandaset\", \"labels\": \"kitti-360 ids\"}");
  options.critical = "Pedestrian";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  assert_true(pags_dataset_object_is_critical(dataset, 1) && !pags_dataset_object_is_critical(dataset, 0));
  assert_string_equal(pags_dataset_critical(dataset), "Pedestrian");
  pags_dataset_close(dataset);
  /* Label 11 is a building in this label set; in Cityscapes' train ids it would be a person. */
  options.critical = "11, Car";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  critical_plane(dataset, 4, found, TREE_WIDTH, TREE_HEIGHT);
  for (int i = 0; i < TREE_WIDTH * TREE_HEIGHT; i++) {
    int x = i % TREE_WIDTH;
    assert_int_equal(found[i], x >= 4 && x < 8);
  }
  pags_dataset_close(dataset);
  tree_text(&s, "dataset.json", "{\"kind\": \"pandaset\", \"labels\": \"waymo\"}");
  options.critical = "other large vehicle,Car";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  assert_true(pags_dataset_object_is_critical(dataset, 0) && !pags_dataset_object_is_critical(dataset, 1));
  pags_dataset_close(dataset);
  tree_text(&s, "dataset.json", "{\"kind\": \"pandaset\", \"labels\": \"step\"}");
  tree_text(&s, "instances/instances_info.json", "{}");
  tree_text(&s, "instances/frame_instances.json", "{}");
  options.critical = NULL;
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  critical_plane(dataset, 4, found, TREE_WIDTH, TREE_HEIGHT);
  for (int i = 0; i < TREE_WIDTH * TREE_HEIGHT; i++)
    assert_int_equal(found[i], i % TREE_WIDTH < 8);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* A class that no label image has is taken from boxes only, even if label images and dynamic masks exist. */
static void boxes_give_classes_without_labels(void **state) {
  (void)state;
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset;
  uint8_t found[TREE_WIDTH * TREE_HEIGHT], boxes[TREE_WIDTH * TREE_HEIGHT] = {0};
  uint8_t *text;
  size_t size;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_write_boxes(&s, &tree_kinds[1]);
  scratch_ok(pags_file_read(scratch_path(&s, "instances/instances_info.json"), &text, &size));
  for (size_t i = 0; i + 5 < size; i++)
    if (memcmp(text + i, "\"Car\"", 5) == 0)
      memcpy(text + i, "\"Bot\"", 5);
  tree_bytes(&s, "instances/instances_info.json", text, size);
  free(text);
  tree_write_grey(&s, "semantic/002_0.png", classes);
  tree_write_grey(&s, "dynamic_masks/all/002_0.png", white_both);
  options.kind = "pandaset";
  options.critical = "bot";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  critical_plane(dataset, 4, found, TREE_WIDTH, TREE_HEIGHT);
  draw_box(dataset, pags_dataset_view(dataset, 4), 0, 1, boxes);
  assert_memory_equal(found, boxes, sizeof found);
  assert_int_equal(pags_dataset_object_is_critical(dataset, 0), 1);
  pags_dataset_close(dataset);
  options.critical = NULL;
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  assert_int_equal(pags_dataset_object_is_critical(dataset, 0), 0);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

static void unknown_words_are_refused(void **state) {
  (void)state;
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_write_boxes(&s, &tree_kinds[1]);
  static const char *const lists[] = {"car,lorry", "19", "-1", "car,", "", " , car", "99999999999999999999"};
  static const char *const words[] = {"'lorry'", "'19'", "'-1'", "''", "''", "''", "'99999999999999999999'"};
  for (int i = 0; i < 7; i++) {
    options.kind = "pandaset";
    options.critical = lists[i];
    pags_result result = pags_dataset_open(s.folder, &options, &dataset);
    scratch_expect(result, PAGS_ERROR_ARGUMENT, words[i]);
    scratch_expect(result, PAGS_ERROR_ARGUMENT, "13 car");
    scratch_expect(result, PAGS_ERROR_ARGUMENT, "class of boxes: Car, Pedestrian");
  }
  scratch_end(&s);
}

/* In the real scene, a view's critical pixels are exactly the union of its semantic classes and dynamic masks, which
 * the test reads directly. */
static void pandaset_is_the_union(void **state) {
  (void)state;
  enum { WIDTH = 960, HEIGHT = 540 };
  char path[512], file[600];
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset;
  pags_image semantic, dynamic;
  static uint8_t found[WIDTH * HEIGHT];
  if (!pags_shared_data("pandaset-002", path, sizeof path))
    skip();
  options.frame_first = 60;
  options.frame_last = 61;
  scratch_ok(pags_dataset_open(path, &options, &dataset));
  int64_t critical = 0, by_mask = 0;
  for (int64_t v = 0; v < 3; v++) {
    critical_plane(dataset, v, found, WIDTH, HEIGHT);
    snprintf(file, sizeof file, "%s/semantic/060_%d.png", path, (int)v);
    scratch_ok(pags_image_load(file, PAGS_U8, 1, &semantic));
    snprintf(file, sizeof file, "%s/dynamic_masks/all/060_%d.png", path, (int)v);
    scratch_ok(pags_image_load(file, PAGS_U8, 1, &dynamic));
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
      int class = ((uint8_t *)semantic.data)[i], moving = ((uint8_t *)dynamic.data)[i] >= 128;
      int wanted = (class >= 11 && class <= 18) || moving;
      if (found[i] != wanted)
        fail_msg("view %d, pixel %d: class %d, moving %d", (int)v, i, class, moving);
      critical += wanted;
      by_mask += moving && !(class >= 11 && class <= 18);
    }
    pags_image_destroy(&semantic);
    pags_image_destroy(&dynamic);
  }
  assert_true(by_mask > 100 && critical > 50000);
  pags_dataset_close(dataset);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(label_sets_are_sound),
      cmocka_unit_test(label_images_and_boxes_agree),
      cmocka_unit_test(sources_come_in_order),
      cmocka_unit_test(other_label_sets_are_read),
      cmocka_unit_test(boxes_give_classes_without_labels),
      cmocka_unit_test(unknown_words_are_refused),
      cmocka_unit_test(pandaset_is_the_union),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
