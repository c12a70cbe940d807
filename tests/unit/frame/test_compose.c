/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the composition of a scene at a time: objects are drawn at the poses of their tracks and can be hidden,
 * moved and added. Also tests parked objects and colour that varies over time. */
#include <pags/compose.h>
#include "frame_fixture.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "splat_files.h"

#include <cmocka.h>

enum { SIZE = 101 };
enum { PARKED, CAR }; /* indices of the scene's objects */

static const double origin[3] = {500000, 2000, 10};

/* Writes a round, almost opaque Gaussian of one pure colour (sigma 0.1 m). */
static void put_gaussian(pags_gaussians *g, int64_t row, double x, double y, double z, int channel) {
  const double mean[3] = {x, y, z};
  for (int k = 0; k < 3; k++) {
    pags_plane(g, PAGS_MEAN + k)[row] = (float)mean[k];
    pags_plane(g, PAGS_SCALE + k)[row] = -2.3f; /* ln 0.1, for a sigma of 0.1 m */
    pags_plane(g, PAGS_SH + k)[row] = k == channel ? 1.7f : -1.7f;
  }
  pags_plane(g, PAGS_ROTATION)[row] = 1;
  pags_plane(g, PAGS_OPACITY)[row] = 8;
}

static pags_object make_track(const char *id, int keyframes, const double from[3], const double to[3], double yaw) {
  pags_object object = {.id = pags_text_copy(id),
                        .class_name = pags_text_copy("Car"),
                        .category = PAGS_CATEGORY_VEHICLE,
                        .size = {4, 2, 1.5},
                        .moving = from != to,
                        .keyframe_count = keyframes,
                        .keyframes = calloc((size_t)keyframes, sizeof(pags_keyframe))};
  for (int i = 0; i < keyframes; i++) {
    double c = cos(yaw), s = sin(yaw), pose[12] = {c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0};
    for (int k = 0; k < 3; k++)
      pose[4 * k + 3] = origin[k] + from[k] + (to[k] - from[k]) * i / (keyframes > 1 ? keyframes - 1 : 1);
    object.keyframes[i] = (pags_keyframe){.frame = i, .trained = 1, .time = 100 + i};
    memcpy(object.keyframes[i].world_from_object, pose, sizeof pose);
  }
  return object;
}

/* A scene ten metres ahead of the camera: a parked object's green Gaussian half a metre left of its box's centre, and
 * a red car that drives from the left to the right between 100 s and 102 s, facing right. A blue Gaussian belongs to
 * no object. */
static pags_scene make_scene(void) {
  static const double parked[3] = {10, 1, 0}, left[3] = {10, 4, 0}, right[3] = {10, -4, 0};
  pags_scene scene = {
      .up = PAGS_UP_Z, .time_begin = 100, .time_end = 102, .fps = 1, .model_count = 2, .object_count = 2};
  memcpy(scene.origin, origin, sizeof origin);
  scene.models = calloc(2, sizeof *scene.models);
  scene.objects = calloc(2, sizeof *scene.objects);
  scene.objects[PARKED] = (pags_scene_object){.record = make_track("parked", 1, parked, parked, 0), .model = -1};
  scene.objects[CAR] =
      (pags_scene_object){.record = make_track("car", 3, left, right, -1.5707963267948966), .model = 1, .critical = 1};
  for (int m = 0; m < 2; m++) {
    scene.models[m].name = pags_text_copy(m ? "car" : "background");
    scene.models[m].file = pags_text_copy(m ? "objects/car.ply" : "background.ply");
    assert_int_equal(pags_gaussians_create(&scene.models[m].gaussians, m ? 1 : 2, 0), PAGS_OK);
  }
  pags_gaussians *background = &scene.models[0].gaussians;
  put_gaussian(background, 0, 10, 0, 3, 2);
  put_gaussian(background, 1, 10, 1.5, 0, 1);
  assert_int_equal(pags_gaussians_add_object_id(background), PAGS_OK);
  background->object_id[1] = PARKED;
  put_gaussian(&scene.models[1].gaussians, 0, 0, 0, 0, 0);
  return scene;
}

static pags_composition *compose_scene(pags_scene scene) {
  pags_composition *c;
  if (pags_composition_create(&scene, &c) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_null(scene.models);
  return c;
}

/* A camera at the scene's origin that looks along x: a point (10, y, 0) projects to column 50.5 - 10 y. */
static pags_camera ahead(void) {
  return (pags_camera){.width = SIZE,
                       .height = SIZE,
                       .fx = 100,
                       .fy = 100,
                       .cx = 50.5,
                       .cy = 50.5,
                       .world_from_camera = {0, 0, 1, origin[0], -1, 0, 0, origin[1], 0, -1, 0, origin[2]}};
}

static pags_picture draw(pags_composition *c, double time) {
  const pags_part *parts;
  int count;
  pags_picture picture;
  pags_camera camera = ahead();
  pags_frame_options options = pags_composition_options(c);
  pags_compose(c, time, &parts, &count);
  assert_int_equal(pags_frame_render(frame, parts, count, &camera, &options, NULL, NULL, &picture), PAGS_OK);
  return picture;
}

/* Asserts the column of the middle row in which a channel is brightest; -1: the channel is nowhere above 0.5. */
static void assert_column(pags_composition *c, double time, int channel, int wanted) {
  pags_picture picture = draw(c, time);
  int best = -1;
  float highest = 0.5f;
  for (int x = 0; x < SIZE; x++) {
    float value = picture.rgb[channel][50 * picture.stride + x];
    if (value > highest) {
      highest = value;
      best = x;
    }
  }
  if (best != wanted)
    fail_msg("at %g: channel %d is highest in column %d, expected %d", time, channel, best, wanted);
}

static void edit(pags_composition *c, const pags_edit *edits, int64_t count) {
  if (pags_composition_edit(c, edits, count) != PAGS_OK)
    fail_msg("%s", pags_error_message());
}

static void objects_are_where_their_tracks_are(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  static const double times[] = {100, 101, 100.5, 101.25, 102, 102.4};
  static const int columns[] = {10, 50, 30, 60, 90, 90};
  for (int i = 0; i < 6; i++) {
    assert_column(c, times[i], 0, columns[i]);
    assert_column(c, times[i], 1, 35);
  }
  assert_column(c, 103, 0, -1); /* after the end of the car's track */
  assert_column(c, 99, 0, -1);  /* before the begin of the car's track */
  assert_column(c, 103, 1, 35);
  assert_column(c, (double)NAN, 0, 10); /* NaN: the beginning of the scene */
  pags_composition_destroy(c);
}

static void corrections_move_the_track(void **state) {
  (void)state;
  pags_scene scene = make_scene();
  /* Along the car's forward axis, which points right in the picture. */
  for (int i = 0; i < 3; i++)
    scene.objects[CAR].record.keyframes[i].translation[0] = 0.5;
  pags_composition *c = compose_scene(scene);
  assert_column(c, 101, 0, 55);
  pags_composition_destroy(c);
}

static void hidden_objects_are_left_out(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  edit(c, &(pags_edit){.kind = PAGS_EDIT_HIDE, .object = CAR}, 1);
  assert_column(c, 101, 0, -1);
  assert_column(c, 101, 1, 35);
  edit(c, &(pags_edit){.kind = PAGS_EDIT_HIDE, .object = PARKED}, 1);
  assert_column(c, 101, 0, 50);
  assert_column(c, 101, 1, -1);
  edit(c, NULL, 0);
  assert_column(c, 101, 1, 35);
  pags_composition_destroy(c);
}

static void objects_move_in_their_frame(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  edit(c, &(pags_edit){.kind = PAGS_EDIT_MOVE, .object = CAR, .translation = {1, 0, 0}}, 1);
  assert_column(c, 101, 0, 60);
  edit(c, &(pags_edit){.kind = PAGS_EDIT_MOVE, .object = PARKED, .translation = {0, 1, 0}}, 1);
  assert_column(c, 101, 1, 25);
  /* Half a turn about the box's centre, beside which the Gaussian lies. */
  edit(c, &(pags_edit){.kind = PAGS_EDIT_MOVE, .object = PARKED, .yaw = 180}, 1);
  assert_column(c, 101, 1, 45);
  edit(c, &(pags_edit){.kind = PAGS_EDIT_MOVE, .object = PARKED, .translation = {0, 1, 0}, .yaw = 180}, 1);
  /* The object is turned first and then moved along the left axis that its box had before the turn. */
  assert_column(c, 101, 1, 35);
  const pags_edit both[] = {{.kind = PAGS_EDIT_HIDE, .object = CAR},
                            {.kind = PAGS_EDIT_ADD, .object = CAR, .translation = {-2, 0, 0}}};
  edit(c, both, 2);
  assert_column(c, 101, 0, 30);
  pags_composition_destroy(c);
}

static void adding_objects_keeps_the_original(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  const pags_edit edits[] = {{.kind = PAGS_EDIT_ADD, .object = PARKED, .translation = {0, -3, 0}},
                             {.kind = PAGS_EDIT_ADD, .object = CAR, .translation = {3, 0, 0}}};
  edit(c, edits, 2);
  pags_picture picture = draw(c, 101);
  const float *green = picture.rgb[1] + 50 * picture.stride, *red = picture.rgb[0] + 50 * picture.stride;
  assert_true(green[35] > 0.5f && green[65] > 0.5f);
  assert_true(red[50] > 0.5f && red[80] > 0.5f);
  picture = draw(
      c,
      103); /* at 103 s the copy of the car has disappeared with the car's track; the copy of the parked object stays */
  green = picture.rgb[1] + 50 * picture.stride, red = picture.rgb[0] + 50 * picture.stride;
  assert_true(green[65] > 0.5f && red[80] < 0.1f);
  pags_composition_destroy(c);
}

static void bad_edits_change_nothing(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  edit(c, &(pags_edit){.kind = PAGS_EDIT_HIDE, .object = CAR}, 1);
  assert_int_equal(pags_composition_edit(c, &(pags_edit){.object = 2}, 1), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_composition_edit(c, &(pags_edit){.object = -1}, 1), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_composition_edit(c, &(pags_edit){.yaw = (double)NAN}, 1), PAGS_ERROR_ARGUMENT);
  assert_column(c, 101, 0, -1);
  pags_composition_destroy(c);
}

static void colour_follows_the_track(void **state) {
  (void)state;
  pags_scene scene = make_scene();
  pags_gaussians *car = &scene.models[1].gaussians;
  assert_int_equal(pags_gaussians_add_fourier(car, 0), PAGS_OK);
  const double terms[4] = {0.3, -0.2, 0.1, 0.05};
  for (int k = 0; k < 4; k++)
    car->fourier[(3 * k + 1) * car->stride] = (float)terms[k]; /* the terms of the green channel */
  pags_composition *c = compose_scene(scene);
  static const double times[] = {100, 100.3, 101.9, 100.3};
  for (int i = 0; i < 4; i++) {
    const pags_part *parts;
    int count;
    pags_compose(c, times[i], &parts, &count);
    const pags_part *part = &parts[count - 1];
    double u = (times[i] - 100) / 2, a = 6.283185307179586 * u;
    double green = -1.7 + 0.3 * sin(a) - 0.2 * cos(a) + 0.1 * sin(2 * a) + 0.05 * cos(2 * a);
    assert_non_null(part->sh);
    assert_float_equal(part->sh[0], 1.7, 1e-6);
    assert_float_equal(part->sh[part->gaussians->stride], green, 1e-5);
    assert_null(parts[0].sh);
  }
  pags_composition_destroy(c);
}

/* A series of a coefficient of degree 1: the colour from one side changes over time, that from the other side the
 * opposite way; files written by id keep coefficients and series. */
static void harmonics_follow_the_track(void **state) {
  (void)state;
  pags_scene scene = make_scene();
  pags_gaussians flat = scene.models[1].gaussians, *const car = &scene.models[1].gaussians, all;
  assert_int_equal(pags_gaussians_create(car, flat.count, 1), PAGS_OK);
  for (int p = 0; p < pags_plane_count(0); p++)
    for (int64_t i = 0; i < flat.count; i++)
      pags_plane(car, p)[i] = pags_plane(&flat, p)[i];
  car->alpha_min = flat.alpha_min;
  pags_gaussians_destroy(&flat);
  assert_int_equal(pags_gaussians_add_fourier(car, 1), PAGS_OK);
  pags_plane(car, PAGS_SH + 3 * 3 + 1)[0] = 0.25F;
  car->fourier[(12 * 3 + 3 * 0 + 1) * car->stride] = 0.5F; /* sin 2 pi u of green of the third coefficient */
  pags_composition *c = compose_scene(scene);
  for (int i = 0; i < 2; i++) {
    const pags_part *parts;
    int count;
    pags_compose(c, i ? 101.5 : 100.5, &parts, &count);
    const pags_part *part = &parts[count - 1];
    assert_float_equal(part->sh[(3 * 3 + 1) * part->gaussians->stride], i ? -0.25 : 0.75, 1e-6);
    assert_float_equal(part->sh[(3 * 2 + 1) * part->gaussians->stride], 0, 0);
  }
  assert_int_equal(pags_composition_gaussians(c, &all), PAGS_OK);
  assert_int_equal(all.fourier_degree, 1);
  int found = 0;
  for (int64_t i = 0; i < all.count; i++)
    found += pags_plane(&all, PAGS_SH + 3 * 3 + 1)[i] == 0.25F && all.fourier[(12 * 3 + 1) * all.stride + i] == 0.5F;
  assert_int_equal(found, 1);
  pags_gaussians_destroy(&all);
  pags_composition_destroy(c);
}

static void absurd_numbers_stay_finite(void **state) {
  (void)state;
  static const double far[] = {1e12, 1e300, -1e308};
  for (int n = 0; n < 3; n++) {
    pags_scene scene = make_scene();
    pags_gaussians *car = &scene.models[1].gaussians;
    assert_int_equal(pags_gaussians_add_fourier(car, 0), PAGS_OK);
    for (int p = 0; p < 12; p++)
      car->fourier[p * car->stride] = 3e38f;
    if (n)
      scene.objects[CAR].record.keyframes[1].world_from_object[3 + 4 * (n - 1)] = far[n];
    scene.objects[CAR].record.keyframes[2].translation[n] = far[n];
    pags_composition *c = compose_scene(scene);
    edit(c, &(pags_edit){.kind = PAGS_EDIT_MOVE, .object = PARKED, .translation = {far[n], 0, 0}}, 1);
    for (int t = 0; t < 5; t++) {
      const pags_part *parts;
      int count;
      pags_compose(c, 100 + 0.5 * t, &parts, &count);
      for (int p = 0; p < count; p++)
        assert_true(!parts[p].sh || isfinite(parts[p].sh[0]));
      pags_picture picture = draw(c, 100 + 0.5 * t);
      for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++)
          assert_true(isfinite(picture.rgb[1][y * picture.stride + x]));
    }
    pags_composition_destroy(c);
  }
}

static void ids_and_objects_match_the_files(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  int32_t object_of[3];
  float priority_of[3];
  assert_int_equal(pags_composition_gaussian_count(c), 3);
  pags_composition_objects(c, object_of);
  assert_memory_equal(object_of, ((int32_t[]){-1, PARKED, CAR}), sizeof object_of);
  assert_int_equal(pags_composition_priorities(c, priority_of), 1);
  assert_memory_equal(priority_of, ((float[]){0, 0, 1}), sizeof priority_of);
  pags_frame_options options = pags_composition_options(c);
  options.extra_channels = 1;
  pags_camera camera = ahead();
  const pags_part *parts;
  int count;
  pags_picture picture;
  pags_compose(c, 101, &parts, &count);
  assert_int_equal(pags_frame_render(frame, parts, count, &camera, &options, NULL, NULL, &picture), PAGS_OK);
  assert_int_equal(picture.id[50 * picture.stride + 50], 2);
  assert_int_equal(picture.id[50 * picture.stride + 35], 1);
  assert_int_equal(picture.id[20 * picture.stride + 50], 0);
  pags_composition_destroy(c);
}

/* 600 Gaussians, divided by object id into two objects and the background, give the same picture bits as in one
 * part. */
static void dividing_into_parts_changes_no_bit(void **state) {
  (void)state;
  pags_composition *c[2];
  float *kept = malloc(3 * SIZE * SIZE * sizeof *kept);
  for (int cut = 0; cut < 2; cut++) {
    pags_scene scene = make_scene();
    pags_gaussians *g = &scene.models[0].gaussians;
    pags_gaussians_destroy(g);
    sample_gaussians(g, 600, 2, 5);
    for (int64_t i = 0; i < g->count; i++) {
      pags_plane(g, PAGS_MEAN)[i] += 10;
      pags_plane(g, PAGS_SCALE)[i] += 2.5f;
    }
    if (cut)
      assert_int_equal(pags_gaussians_add_object_id(g), PAGS_OK);
    for (int64_t i = 0; cut && i < g->count; i++)
      g->object_id[i] = (int32_t)(i % 3) - 1;
    c[cut] = compose_scene(scene);
    pags_picture picture = draw(c[cut], 101);
    for (int k = 0; k < 3; k++)
      for (int y = 0; y < SIZE; y++) {
        float *row = kept + (k * SIZE + y) * SIZE;
        if (cut)
          assert_memory_equal(row, picture.rgb[k] + y * picture.stride, SIZE * sizeof *row);
        else
          memcpy(row, picture.rgb[k] + y * picture.stride, SIZE * sizeof *row);
      }
    pags_composition_destroy(c[cut]);
  }
  free(kept);
}

/* A scene with 600 Gaussians of degree 2 in the background that belong in turn to no object, PARKED and CAR; `back`:
 * in reverse order. */
static pags_scene make_many(bool back) {
  pags_scene scene = make_scene();
  pags_gaussians *g = &scene.models[0].gaussians, sampled;
  int64_t *index = malloc(600 * sizeof *index);
  pags_gaussians_destroy(g);
  sample_gaussians(&sampled, 600, 2, 5);
  assert_int_equal(pags_gaussians_add_object_id(&sampled), PAGS_OK);
  for (int64_t i = 0; i < 600; i++) {
    pags_plane(&sampled, PAGS_MEAN)[i] += 10;
    pags_plane(&sampled, PAGS_SCALE)[i] += 2.5f;
    sampled.object_id[i] = (int32_t)(i % 3) - 1;
    index[i] = back ? 599 - i : i;
  }
  assert_int_equal(pags_gaussians_create_like(g, 600, &sampled), PAGS_OK);
  pags_gaussians_gather(&sampled, index, 600, g);
  pags_gaussians_destroy(&sampled);
  free(index);
  return scene;
}

static void gaussians_are_returned_in_order_of_ids(void **state) {
  (void)state;
  pags_scene kept = make_many(false);
  pags_composition *c = compose_scene(make_many(false));
  pags_gaussians all;
  for (int packed = 0; packed < 2; packed++) {
    if (packed)
      assert_int_equal(pags_composition_pack(c), PAGS_OK);
    assert_int_equal(pags_composition_gaussians(c, &all), PAGS_OK);
    assert_int_equal(all.count, 601);
    assert_int_equal(all.sh_degree, 2);
    for (int p = 0; p < pags_plane_count(2); p++) {
      const float *found = pags_plane(&all, p), *wanted = pags_plane(&kept.models[0].gaussians, p);
      if (!packed)
        assert_memory_equal(found, wanted, 600 * sizeof *found);
      /* Packed means are exact to 1/131070 of their cluster's box; the largest errors are those of harmonics, 1/254
       * of up to 4. */
      for (int i = 0; i < 600 && (p < PAGS_ROTATION || p >= PAGS_OPACITY); i++)
        assert_true(fabsf(found[i] - wanted[i]) < 0.02f);
      const float car = p < PAGS_SH + 3 ? pags_plane(&kept.models[1].gaussians, p)[0] : 0;
      assert_true(fabsf(found[600] - car) < (packed ? 0.01f : 1e-30f));
    }
    if (!packed) {
      assert_memory_equal(all.object_id, kept.models[0].gaussians.object_id, 600 * sizeof(int32_t));
      assert_int_equal(all.object_id[600], CAR);
    }
    pags_gaussians_destroy(&all);
  }
  pags_composition_destroy(c);
  pags_scene_destroy(&kept);
}

/* The gradients of the sum of all pixels, by id. */
static void gradients_of(pags_composition *c, int threads, pags_gaussians *out) {
  pags_tasks *own = pags_tasks_create(threads);
  pags_frame *f;
  pags_picture picture;
  const pags_part *parts;
  int count;
  pags_camera camera = ahead();
  pags_frame_options options = pags_composition_options(c);
  options.keep_for_backward = 1;
  assert_int_equal(pags_frame_create(own, &f), PAGS_OK);
  pags_compose(c, 101, &parts, &count);
  assert_int_equal(pags_frame_render(f, parts, count, &camera, &options, NULL, NULL, &picture), PAGS_OK);
  float *ones = malloc((size_t)picture.stride * (SIZE + 16) * sizeof *ones);
  for (int i = 0; i < picture.stride * (SIZE + 16); i++)
    ones[i] = 1;
  const pags_picture_gradient gradient = {.rgb = {ones, ones, ones}};
  assert_int_equal(pags_frame_gradients(f, &gradient, pags_composition_gaussian_count(c), out, NULL), PAGS_OK);
  free(ones);
  pags_frame_destroy(f);
  pags_tasks_destroy(own);
}

/* Numbering the Gaussians in reverse order reverses the gradients and changes no bit of them; nor does the number of
 * threads. */
static void gradients_are_in_order_of_ids(void **state) {
  (void)state;
  pags_gaussians forth, back, threaded;
  pags_composition *c = compose_scene(make_many(false)), *reversed = compose_scene(make_many(true));
  gradients_of(c, 1, &forth);
  gradients_of(c, 3, &threaded);
  gradients_of(reversed, 2, &back);
  int drawn = 0;
  for (int p = 0; p < pags_plane_count(2); p++) {
    assert_memory_equal(pags_plane(&forth, p), pags_plane(&threaded, p), 601 * sizeof(float));
    for (int i = 0; i < 600; i++) {
      drawn += p == PAGS_OPACITY && pags_plane(&forth, p)[i] != 0;
      assert_memory_equal(pags_plane(&forth, p) + i, pags_plane(&back, p) + 599 - i, sizeof(float));
    }
  }
  assert_true(drawn > 100);
  assert_true(pags_plane(&forth, PAGS_SH)[600] > 0); /* the car's model is of degree 0 */
  assert_true(pags_plane(&forth, PAGS_SH + 3)[600] == 0);
  pags_gaussians_destroy(&forth);
  pags_gaussians_destroy(&back);
  pags_gaussians_destroy(&threaded);

  const pags_placement twice[2] = {{CAR, {1, 0, 0, 500010, 0, 1, 0, 2000, 0, 0, 1, 10}},
                                   {CAR, {1, 0, 0, 500012, 0, 1, 0, 2000, 0, 0, 1, 10}}};
  const pags_part *parts;
  int count;
  pags_picture picture;
  pags_camera camera = ahead();
  pags_frame_options options = pags_composition_options(c);
  options.keep_for_backward = 1;
  assert_int_equal(pags_compose_placed(c, 101, twice, 2, &parts, &count), PAGS_OK);
  assert_int_equal(pags_frame_render(frame, parts, count, &camera, &options, NULL, NULL, &picture), PAGS_OK);
  const pags_picture_gradient gradient = {.rgb = {picture.rgb[0], picture.rgb[1], picture.rgb[2]}};
  assert_int_equal(pags_frame_gradients(frame, &gradient, 601, &back, NULL), PAGS_ERROR_ARGUMENT);
  assert_null(back.data);
  pags_composition_destroy(c);
  pags_composition_destroy(reversed);
}

static void steady_composition_keeps_its_memory(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  const pags_part *first, *parts;
  int count;
  pags_compose(c, 100, &first, &count);
  assert_int_equal(count, 3);
  pags_compose(c, 103, &parts, &count);
  assert_int_equal(count, 2);
  assert_ptr_equal(parts, first);
  draw(c, 100);
  draw(c, 101);
  uint64_t calls = pags_frame_heap_calls(frame);
  draw(c, 101.5);
  assert_true(pags_frame_heap_calls(frame) == calls);
  pags_composition_destroy(c);
}

/* Placements that repeat the tracks' poses give the same parts as the tracks; other placements move, leave out or
 * repeat objects. */
static void placements_are_drawn_at_their_poses(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  pags_placement placements[4] = {{-1, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}}, {PARKED, {0}}, {CAR, {0}}, {CAR, {0}}};
  const pags_part *tracks, *parts;
  int track_count, count;
  assert_true(pags_composition_is_tracked(c, CAR) && !pags_composition_is_tracked(c, PARKED));
  pags_composition_rest_pose(c, PARKED, placements[1].world_from_object);
  assert_true(pags_object_pose(&pags_composition_scene(c)->objects[CAR].record, 101, placements[2].world_from_object));
  assert_int_equal(pags_compose_placed(c, 101, placements, 3, &parts, &count), PAGS_OK);
  pags_compose(c, 101, &tracks, &track_count);
  assert_int_equal(count, track_count);
  for (int p = 0; p < count; p++)
    for (int k = 0; k < 12; k++)
      assert_true(fabs(parts[p].world_from_model[k] - tracks[p].world_from_model[k]) < 1e-9);
  placements[1].world_from_object[7] += 2;
  memcpy(&placements[3], &placements[2], sizeof placements[3]);
  placements[3].world_from_object[11] += 5;
  assert_int_equal(pags_compose_placed(c, 101, placements + 1, 3, &parts, &count), PAGS_OK);
  assert_int_equal(count, 3);
  assert_true(fabs(parts[0].world_from_model[7] - 2) < 1e-6);
  assert_true(fabs(parts[2].world_from_model[11] - parts[1].world_from_model[11] - 5) < 1e-6);
  placements[0].object = 2;
  assert_int_equal(pags_compose_placed(c, 101, placements, 1, &parts, &count), PAGS_ERROR_ARGUMENT);
  placements[0].object = CAR;
  placements[0].world_from_object[0] = 0;
  assert_int_not_equal(pags_compose_placed(c, 101, placements, 1, &parts, &count), PAGS_OK);
  assert_int_equal(count, 0);
  pags_composition_destroy(c);
}

/* A placement of twice the size, mirrored, moves points of the object's frame and of the world to the expected
 * places. */
static void placements_scale(void **state) {
  (void)state;
  pags_composition *c = compose_scene(make_scene());
  const double point[3] = {0.5, -1, 2};
  const pags_part *parts;
  int count;
  for (int64_t object = -1; object < 2; object++) {
    pags_placement placement = {object, {-2, 0, 0, 7, 0, 0, -2, 3, 0, 2, 0, -4}};
    double rest[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, in_model[3], found[3];
    assert_int_equal(pags_compose_placed(c, 101, &placement, 1, &parts, &count), PAGS_OK);
    assert_int_equal(count, 1);
    if (object == PARKED) /* the object's Gaussians are stored in world coordinates at the rest pose */
      pags_composition_rest_pose(c, PARKED, rest);
    pags_rigid_point(rest, point, in_model);
    for (int k = 0; k < 3; k++)
      in_model[k] -= object == CAR ? 0 : origin[k];
    pags_rigid_point(parts[0].world_from_model, in_model, found);
    for (int k = 0; k < 3; k++) {
      const double *row = placement.world_from_object + 4 * k;
      const double wanted = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3];
      assert_true(fabs(found[k] + origin[k] - wanted) < 1e-9);
    }
  }
  pags_composition_destroy(c);
}

/* A pose whose rotation is slightly inexact becomes exactly rigid; a scale slightly different from 1 is kept. */
static void nearly_rigid_poses(void **state) {
  (void)state;
  double turned[12] = {1 + 4e-6, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1 - 3e-6, 3},
         scaled[12] = {1.001, 0, 0, 1, 0, 1.001, 0, 2, 0, 0, 1.001, 3};
  double flat[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0}, inverse[12], product[12];
  assert_int_equal(pags_affine_check(turned, "test"), PAGS_OK);
  assert_true(turned[0] == 1 && turned[10] == 1 && pags_affine_stretch(turned) == 1);
  assert_int_equal(pags_affine_check(scaled, "test"), PAGS_OK);
  assert_true(fabs(scaled[0] - 1.001) < 1e-15 && fabs(pags_affine_stretch(scaled) - 1.001) < 1e-12);
  assert_int_equal(pags_affine_check(flat, "test"), PAGS_ERROR_FORMAT);
  pags_affine_inverse(scaled, inverse);
  pags_rigid_multiply(inverse, scaled, product);
  for (int k = 0; k < 12; k++)
    assert_true(fabs(product[k] - (k % 5 == 0)) < 1e-12);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(objects_are_where_their_tracks_are),
      cmocka_unit_test(corrections_move_the_track),
      cmocka_unit_test(hidden_objects_are_left_out),
      cmocka_unit_test(objects_move_in_their_frame),
      cmocka_unit_test(adding_objects_keeps_the_original),
      cmocka_unit_test(bad_edits_change_nothing),
      cmocka_unit_test(colour_follows_the_track),
      cmocka_unit_test(harmonics_follow_the_track),
      cmocka_unit_test(absurd_numbers_stay_finite),
      cmocka_unit_test(ids_and_objects_match_the_files),
      cmocka_unit_test(dividing_into_parts_changes_no_bit),
      cmocka_unit_test(gaussians_are_returned_in_order_of_ids),
      cmocka_unit_test(gradients_are_in_order_of_ids),
      cmocka_unit_test(steady_composition_keeps_its_memory),
      cmocka_unit_test(placements_are_drawn_at_their_poses),
      cmocka_unit_test(placements_scale),
      cmocka_unit_test(nearly_rigid_poses),
  };
  return cmocka_run_group_tests(tests, frame_set_up, frame_tear_down);
}
