/* SPDX-License-Identifier: Apache-2.0 */
/* Tests fits of a camera's pose to the left half of a photograph (train/fit_pose.c): a wrong pose is found, a right
 * one stays, and the right half isn't used. */
#include "unit/random_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "train/camera_poses.h"

enum { STRIDE = 112, COUNT = 120 };

typedef struct shot { /* a scene and its camera's photograph */
  fixture f;
  engine e;
  frame_scene scene;
  uint8_t rgb[3 * HEIGHT * STRIDE], mask[HEIGHT * STRIDE];
  pags_photo photo;
} shot;

static const float gain[3] = {0.9f, 0.8f, 0.7f}, offset[3] = {0.05f, 0.0f, 0.1f};

static void begin(shot *s, int threads) {
  s->f = fixture_create(3, COUNT);
  s->e = engine_create(threads);
  s->scene = frame_scene_create(&s->f.part, 1, 16, 0);
  s->scene.parts[0].gaussians = s->scene.gaussians; /* the scene was copied, so its pointers are set again */
  s->scene.parts[0].clusters = s->scene.clusters;
  s->photo = (pags_photo){.width = WIDTH, .height = HEIGHT, .stride = STRIDE, .rgb = s->rgb};
  pags_picture picture;
  assert_int_equal(pags_frame_render(s->e.frame, s->scene.parts, 1, &s->f.camera, &s->f.options, NULL, NULL, &picture),
                   PAGS_OK);
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < HEIGHT; y++)
      for (int x = 0; x < WIDTH; x++) {
        const float v = gain[c] * picture.rgb[c][y * picture.stride + x] + offset[c];
        s->rgb[(c * HEIGHT + y) * STRIDE + x] = (uint8_t)(255.0f * fminf(fmaxf(v, 0.0f), 1.0f) + 0.5f);
      }
  s->f.options.exposed = 1;
  memcpy(s->f.options.gain, gain, sizeof gain);
  memcpy(s->f.options.offset, offset, sizeof offset);
}

static void end(shot *s) {
  frame_scene_destroy(&s->scene);
  engine_destroy(&s->e);
  fixture_destroy(&s->f);
}

static pags_camera moved(const pags_camera *camera) {
  const double turn[3] = {0.008, -0.011, 0.006}, push[3] = {0.02, 0.015, -0.03};
  pags_camera out = *camera;
  double motion[12];
  pags_increment_matrix(turn, push, motion);
  pags_rigid_multiply(camera->world_from_camera, motion, out.world_from_camera);
  return out;
}

static pags_fitted_pose fit(const shot *s, const pags_camera *camera) {
  pags_fitted_pose out;
  assert_int_equal(pags_fit_pose(s->e.frame, s->scene.parts, 1, camera, &s->f.options, NULL, NULL, &s->photo, &out),
                   PAGS_OK);
  return out;
}

/* Returns the angle between the poses, radians. */
static double turned(const pags_camera *a, const pags_camera *b) {
  double inverse[12], motion[12], turn[3];
  pags_rigid_inverse(a->world_from_camera, inverse);
  pags_rigid_multiply(inverse, b->world_from_camera, motion);
  pags_increment_rotation(motion, turn);
  return sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
}

static void test_found(void **state) {
  (void)state;
  shot s = {0};
  begin(&s, 2);
  const pags_camera off = moved(&s.f.camera);
  const pags_fitted_pose found = fit(&s, &off), stayed = fit(&s, &s.f.camera);
  assert_true(turned(&s.f.camera, &found.camera) < 0.3 * turned(&s.f.camera, &off));
  if (!(found.fitted > found.given + 6.0))
    fail_msg("right half %.2f dB as given, %.2f dB as fitted", found.given, found.fitted);
  assert_true(stayed.given > 50.0); /* the photograph's rounding to 8 bits */
  assert_true(stayed.fitted > stayed.given - 0.5);
  assert_true(turned(&s.f.camera, &stayed.camera) < 2e-3);
  end(&s);
}

static void test_left_alone(void **state) {
  (void)state;
  shot s = {0};
  begin(&s, 2);
  const pags_camera off = moved(&s.f.camera);
  const pags_fitted_pose one = fit(&s, &off);
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < HEIGHT; y++)
      for (int x = WIDTH / 2; x < WIDTH; x++)
        s.rgb[(c * HEIGHT + y) * STRIDE + x] ^= 0x55;
  const pags_fitted_pose other = fit(&s, &off); /* another right half changes only the score */
  assert_memory_equal(&one.camera, &other.camera, sizeof one.camera);
  assert_true(other.given < one.given);
  s.photo.mask = s.mask; /* all pixels are masked */
  const pags_fitted_pose none = fit(&s, &off);
  assert_memory_equal(&none.camera, &off, sizeof off);
  assert_true(isnan(none.given) && isnan(none.fitted));
  end(&s);
}

static void test_same_bits(void **state) {
  (void)state;
  pags_fitted_pose by[2];
  for (int i = 0; i < 2; i++) {
    shot s = {0};
    begin(&s, i + 1);
    const pags_camera off = moved(&s.f.camera);
    by[i] = fit(&s, &off);
    end(&s);
  }
  assert_memory_equal(&by[0].camera, &by[1].camera, sizeof by[0].camera);
  assert_true(by[0].fitted == by[1].fitted);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_found), cmocka_unit_test(test_left_alone),
                                     cmocka_unit_test(test_same_bits)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
