/* SPDX-License-Identifier: Apache-2.0 */
/* Tests which LiDAR points belong to an object, and how TSDF surfaces are pulled to them. */
#include <pags/scene.h>

#include "exporters/proxy/lidar.h"
#include "unit/driving_tree.h"

static const double step = 0.05;

/* A TSDF of the level surface z = 0, truncated at four steps. */
static pags_tsdf level_grid(void) {
  static const double lo[3] = {-1, -1, -0.5}, hi[3] = {1, 1, 0.5};
  pags_tsdf grid;
  scratch_ok(pags_tsdf_create(&grid, lo, hi, step, 0));
  for (int64_t i = 0; i < (int64_t)grid.n[0] * grid.n[1] * grid.n[2]; i++) {
    double z = grid.origin[2] + (double)(i / grid.n[0] / grid.n[1]) * step;
    grid.distance[i] = (float)fmin(fmax(z, -4 * step), 4 * step);
  }
  return grid;
}

/* Height of the surface above the lattice column nearest to x, y. */
static double height(const pags_tsdf *g, double x, double y) {
  int64_t layer = (int64_t)g->n[0] * g->n[1];
  int64_t at =
      (int64_t)floor((y - g->origin[1]) / step + 0.5) * g->n[0] + (int64_t)floor((x - g->origin[0]) / step + 0.5);
  for (int z = 0; z + 1 < g->n[2]; z++) {
    double a = (double)g->distance[at + z * layer], b = (double)g->distance[at + (z + 1) * layer];
    if (a < 0 && b >= 0)
      return g->origin[2] + (z + a / (a - b)) * step;
  }
  return (double)NAN;
}

/* A patch of points at height z, every 0.1 m for x and y in -0.3..0.3. */
static pags_lidar_fit patch_at(double z) {
  pags_lidar_fit cloud = {0};
  for (int i = -3; i <= 3; i++)
    for (int j = -3; j <= 3; j++) {
      const double p[3] = {0.1 * i, 0.1 * j, z};
      scratch_ok(pags_lidar_fit_add(&cloud, p));
    }
  assert_int_equal(cloud.count, 49);
  return cloud;
}

static void a_surface_is_pulled_to_its_points(void **state) {
  (void)state;
  pags_tsdf grid = level_grid();
  pags_lidar_fit cloud = patch_at(0.06);
  scratch_ok(pags_lidar_fit_pull(&cloud, &grid, 0.13));
  /* Few points are trusted less: the first pull leaves a twentieth of the distance, later ones reduce the rest. */
  assert_true(fabs(height(&grid, 0, 0) - 0.06) < 0.002);
  assert_true(fabs(height(&grid, 0.25, -0.25) - 0.06) < 0.006);
  assert_true(height(&grid, 0.5, 0) > 0 && height(&grid, 0.5, 0) < 0.06);
  assert_true(fabs(height(&grid, -0.9, 0.9)) < 1e-6); /* 0.85 m from the nearest point */
  pags_lidar_fit_destroy(&cloud);
  pags_tsdf_destroy(&grid);
}

static void a_single_point_counts_less(void **state) {
  (void)state;
  static const double p[3] = {0, 0, 0.06}, outside[3] = {5, 0, 0};
  pags_tsdf grid = level_grid();
  pags_lidar_fit cloud = {0};
  scratch_ok(pags_lidar_fit_pull(&cloud, &grid, 0.13)); /* a cloud without points */
  scratch_ok(pags_lidar_fit_add(&cloud, outside));
  scratch_ok(pags_lidar_fit_pull(&cloud, &grid, 0.13));
  assert_true(fabs(height(&grid, 0, 0)) < 1e-6);
  scratch_ok(pags_lidar_fit_add(&cloud, p));
  scratch_ok(pags_lidar_fit_pull(&cloud, &grid, 0.13));
  /* Three passes move the surface by 1/2, 1/5 and 1/17 of the remaining distance. */
  assert_true(fabs(height(&grid, 0, 0) - 0.0374) < 0.002);
  pags_lidar_fit_destroy(&cloud);
  pags_tsdf_destroy(&grid);
}

static void distant_points_are_ignored(void **state) {
  (void)state;
  pags_tsdf grid = level_grid();
  pags_lidar_fit cloud = patch_at(0.15);
  scratch_ok(pags_lidar_fit_pull(&cloud, &grid, 0.13));
  assert_true(fabs(height(&grid, 0, 0)) < 1e-6);
  pags_lidar_fit_destroy(&cloud);
  pags_tsdf_destroy(&grid);
}

/* Position in the world of LiDAR point `index` of the test tree at a frame. */
static void world_point(int frame, int index, double out[3]) {
  double ego[12];
  tree_ego(frame, ego);
  pags_rigid_point(ego, tree_points[index], out);
}

/* Makes an object whose box moves with the first LiDAR point, `above` metres below it. A point at the foot of a box
 * may belong to something else and isn't taken; a point in the upper half is. */
static void follow(pags_object *object, pags_keyframe *keyframes, double above) {
  *object = (pags_object){.category = PAGS_CATEGORY_VEHICLE,
                          .moving = 1,
                          .size = {2, 1, 2},
                          .keyframe_count = TREE_FRAMES,
                          .keyframes = keyframes};
  for (int t = 0; t < TREE_FRAMES; t++) {
    double p[3];
    world_point(t, 0, p);
    const double pose[12] = {0, -1, 0, p[0], 1, 0, 0, p[1] - 0.3, 0, 0, 1, p[2] - above};
    keyframes[t] = (pags_keyframe){.frame = t, .trained = 1, .time = 100 + 0.5 * t};
    memcpy(keyframes[t].world_from_object, pose, sizeof pose);
  }
}

static void points_are_sorted_by_boxes(void **state) {
  (void)state;
  static const double expected[3] = {0.3, 0, 0.4};
  const tree_kind kind = {"waymo", 1, 0, 0, 0, 14, 3};
  pags_scene_object objects[2] = {{.model = -1}, {.model = -1}};
  pags_scene_view views[TREE_FRAMES] = {0};
  pags_keyframe keyframes[2][TREE_FRAMES];
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &kind);
  tree_text(&s, "dataset.json", "{\"kind\": \"waymo\"}");
  pags_scene scene = {
      .dataset = s.folder, .fps = 2, .object_count = 2, .objects = objects, .view_count = TREE_FRAMES, .views = views};
  follow(&objects[0].record, keyframes[0], -0.9);
  follow(&objects[1].record, keyframes[1], 0.4);
  for (int t = 0; t < TREE_FRAMES; t++)
    views[t] = (pags_scene_view){.frame = t, .test = t == 4};
  scene.origin[0] = 7;
  for (int held_out = 0; held_out < 2; held_out++) {
    pags_lidar lidar;
    double first[3];
    int64_t sweeps = held_out ? 1 : 4;
    scratch_ok(pags_lidar_read(&scene, held_out, &lidar));
    assert_true(lidar.object_count == 2 && lidar.objects[0].count == 0 && lidar.objects[1].count == sweeps);
    for (int64_t i = 0; i < sweeps; i++)
      for (int k = 0; k < 3; k++)
        assert_true(fabs((double)lidar.objects[1].points[3 * i + k] - expected[k]) < 1e-5);
    assert_int_equal(lidar.count, sweeps); /* the second point is in no box */
    world_point(held_out ? 4 : 0, 1, first);
    assert_true(fabs((double)lidar.points[0] + 7 - first[0]) < 1e-5 && fabs((double)lidar.points[2] - first[2]) < 1e-5);
    pags_lidar_destroy(&lidar);
    assert_null(lidar.objects);
  }
  scratch_end(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_surface_is_pulled_to_its_points),
      cmocka_unit_test(a_single_point_counts_less),
      cmocka_unit_test(distant_points_are_ignored),
      cmocka_unit_test(points_are_sorted_by_boxes),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
