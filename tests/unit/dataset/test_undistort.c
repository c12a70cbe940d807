/* SPDX-License-Identifier: Apache-2.0 */
/* Tests lens models and undistortion against the models' definitions, analytic pictures, and COLMAP's picture size.
 * Also tests which views keep their lens. */
#include <pags/image.h>

#include "dataset/driving/label_plane.h"
#include "dataset/internal.h"
#include "unit/scratch.h"

#include <math.h>
#include <string.h>

static const pags_lens fox_lens = {.width = 540,
                                   .height = 960,
                                   .fx = 688.06464872879812,
                                   .fy = 687.6776936365344,
                                   .cx = 277.279,
                                   .cy = 482.634,
                                   .model.k = {0.053545374500611989, -0.075797193663761461},
                                   .model.p = {-0.00081220164019132803, 5.7733598567121789e-05}};

static const pags_lens barrel_lens = {.width = 320,
                                      .height = 240,
                                      .fx = 200,
                                      .fy = 205,
                                      .cx = 162,
                                      .cy = 118,
                                      .model.k = {-0.25, 0.06, -0.004},
                                      .model.p = {0.001, -0.002}};

static const pags_lens fisheye_lens = {.model.kind = PAGS_LENS_FISHEYE,
                                       .width = 320,
                                       .height = 240,
                                       .fx = 150,
                                       .fy = 150,
                                       .cx = 158,
                                       .cy = 121,
                                       .model.k = {-0.02, 0.003, -0.001, 0.0002}};

/* The parameters of FULL_OPENCV, FOV, THIN_PRISM_FISHEYE, Fisheye624, DIVISION and EUCM as lenses store them. */
static const pags_lens rare[] = {{.model.kind = PAGS_LENS_RATIONAL,
                                  .model.k = {-0.2, 0.05, 0.01},
                                  .model.d = {0.03, -0.02, 0.004},
                                  .model.p = {0.004, -0.006},
                                  .width = 320,
                                  .height = 240,
                                  .fx = 260,
                                  .fy = 255,
                                  .cx = 160,
                                  .cy = 120},
                                 {.model.kind = PAGS_LENS_FOV,
                                  .model.k = {0.8},
                                  .width = 320,
                                  .height = 240,
                                  .fx = 260,
                                  .fy = 260,
                                  .cx = 155,
                                  .cy = 122},
                                 {.model.kind = PAGS_LENS_THIN_PRISM,
                                  .model.k = {0.05, -0.02, 0.005, -0.003},
                                  .model.p = {0.001, -0.002},
                                  .model.s = {0.001, -0.0015},
                                  .width = 320,
                                  .height = 240,
                                  .fx = 200,
                                  .fy = 202,
                                  .cx = 160,
                                  .cy = 120},
                                 {.model.kind = PAGS_LENS_ARIA,
                                  .model.k = {0.05, -0.02, 0.005, -0.003, 0.001, -0.0002},
                                  .model.p = {-0.002, 0.001},
                                  .model.s = {0.0005, -0.0005, 0.0002, -0.0002},
                                  .width = 320,
                                  .height = 240,
                                  .fx = 150,
                                  .fy = 150,
                                  .cx = 160,
                                  .cy = 120},
                                 {.model.kind = PAGS_LENS_DIVISION,
                                  .model.k = {-0.15},
                                  .width = 320,
                                  .height = 240,
                                  .fx = 260,
                                  .fy = 260,
                                  .cx = 160,
                                  .cy = 120},
                                 {.model.kind = PAGS_LENS_EUCM,
                                  .model.k = {0.6, 1.1},
                                  .width = 320,
                                  .height = 240,
                                  .fx = 200,
                                  .fy = 200,
                                  .cx = 160,
                                  .cy = 120}};

static const pags_lens *const lenses[] = {&fox_lens, &barrel_lens, &fisheye_lens, &rare[0], &rare[1],
                                          &rare[2],  &rare[3],     &rare[4],      &rare[5]};

enum { LENSES = sizeof lenses / sizeof *lenses };

static pags_lens prepared(const pags_lens *lens) {
  pags_lens out = *lens;
  scratch_ok(pags_lens_prepare(&out, "lens"));
  return out;
}

static pags_camera pinhole_of(const pags_lens *lens) {
  pags_camera camera = {0};
  scratch_ok(pags_lens_pinhole(lens, "lens", &camera));
  return camera;
}

/* A point through each lens model, computed from the definition by separate code. */
static void test_models(void **state) {
  (void)state;
  const double x = 0.3, y = -0.2, r = sqrt(0.13);
  pags_lens lens = prepared(&barrel_lens);
  double u, v, radial = 1 - 0.25 * 0.13 + 0.06 * 0.0169 - 0.004 * 0.002197;
  assert_true(pags_lens_project(&lens, x, y, &u, &v));
  assert_true(fabs(u - (200 * (x * radial + 2 * 0.001 * x * y - 0.002 * (0.13 + 2 * x * x)) + 162)) < 1e-9);
  assert_true(fabs(v - (205 * (y * radial + 0.001 * (0.13 + 2 * y * y) - 2 * 0.002 * x * y) + 118)) < 1e-9);
  lens = prepared(&fisheye_lens);
  double t = atan(r), bent = t - 0.02 * pow(t, 3) + 0.003 * pow(t, 5) - 0.001 * pow(t, 7) + 0.0002 * pow(t, 9);
  assert_true(pags_lens_project(&lens, x, y, &u, &v));
  assert_true(fabs(u - (150 * x * bent / r + 158)) < 1e-9);
  assert_true(fabs(v - (150 * y * bent / r + 121)) < 1e-9);
}

/* Compares the rare models at one point with separate code for their definitions. */
static void test_rare_models(void **state) {
  (void)state;
  const double x = 0.31, y = -0.23, r2 = x * x + y * y, r = sqrt(r2), t = atan(r), pi = acos(-1);
  double want[6][2], u, v;
  const double n = 1 - 0.2 * r2 + 0.05 * r2 * r2 + 0.01 * pow(r, 6);
  const double d = 1 + 0.03 * r2 - 0.02 * r2 * r2 + 0.004 * pow(r, 6);
  want[0][0] = x * n / d + 2 * 0.004 * x * y - 0.006 * (r2 + 2 * x * x);
  want[0][1] = y * n / d + 0.004 * (r2 + 2 * y * y) - 2 * 0.006 * x * y;
  const double fov = atan(2 * r * tan(0.4)) / 0.8 / r;
  want[1][0] = x * fov, want[1][1] = y * fov;
  const double a = x * t / r, b = y * t / r, t2 = t * t;
  const double thin = 1 + 0.05 * t2 - 0.02 * t2 * t2 + 0.005 * pow(t, 6) - 0.003 * pow(t, 8);
  want[2][0] = a * thin + 2 * 0.001 * a * b - 0.002 * (t2 + 2 * a * a) + 0.001 * t2;
  want[2][1] = b * thin + 0.001 * (t2 + 2 * b * b) - 2 * 0.002 * a * b - 0.0015 * t2;
  const double six = thin + 0.001 * pow(t, 10) - 0.0002 * pow(t, 12), p = a * six, q = b * six, s2 = p * p + q * q;
  want[3][0] = p + 2 * p * (0.001 * p - 0.002 * q) + 0.001 * s2 + 0.0005 * s2 - 0.0005 * s2 * s2;
  want[3][1] = q + 2 * q * (0.001 * p - 0.002 * q) - 0.002 * s2 + 0.0002 * s2 - 0.0002 * s2 * s2;
  const double eucm = 1 / (0.6 * sqrt(1.1 * r2 + 1) + 0.4);
  want[5][0] = x * eucm, want[5][1] = y * eucm;
  for (int i = 0; i < 6; i++) {
    const pags_lens lens = prepared(&rare[i]);
    assert_true(pags_lens_project(&lens, x, y, &u, &v));
    u = (u - lens.cx) / lens.fx, v = (v - lens.cy) / lens.fy;
    if (i == 4) { /* r = r_d / (1 + k r_d^2) */
      const double k = -0.15, square = u * u + v * v;
      assert_true(fabs(u / (1 + k * square) - x) < 1e-12 && fabs(v / (1 + k * square) - y) < 1e-12);
    } else {
      assert_true(fabs(u - want[i][0]) < 1e-12 && fabs(v - want[i][1]) < 1e-12);
    }
  }
  pags_lens lens = rare[1];
  lens.model.k[0] = 2 * pi;
  scratch_expect(pags_lens_prepare(&lens, "lens"), PAGS_ERROR_FORMAT, "FOV's omega");
  lens = rare[5];
  lens.model.k[0] = 1.5;
  scratch_expect(pags_lens_prepare(&lens, "lens"), PAGS_ERROR_FORMAT, "EUCM's alpha");
}

/* A lens that folds outside of the picture is accepted; one that folds inside is refused in a message with the
 * radius. */
static void test_folds(void **state) {
  (void)state;
  double share;
  pags_lens lens = {.width = 100, .height = 100, .fx = 50, .fy = 50, .cx = 50, .cy = 50, .model.k = {-0.05}};
  scratch_ok(pags_lens_prepare(&lens, "lens"));
  scratch_ok(pags_lens_check_inverse(&lens, "lens", &share));
  assert_true(share == 0);
  lens.model.k[0] = -0.11; /* the radius grows up to 1.16; the corners are at 1.41 */
  scratch_ok(pags_lens_prepare(&lens, "lens"));
  scratch_ok(pags_lens_check_inverse(&lens, "lens", &share));
  assert_true(share > 0 && share < 0.1);
  lens.model.k[0] = -0.5; /* the radius grows up to (2/3)^1.5 = 0.544, which is 27 pixels */
  scratch_ok(pags_lens_prepare(&lens, "lens"));
  scratch_expect(pags_lens_check_inverse(&lens, "lens", &share), PAGS_ERROR_FORMAT, "stops growing 27 pixels");
  for (int i = 0; i < 6; i++) {
    lens = prepared(&rare[i]);
    scratch_ok(pags_lens_check_inverse(&lens, "lens", &share));
    assert_true(share == 0);
  }
}

static void test_inverse(void **state) {
  (void)state;
  for (int i = 0; i < LENSES; i++) {
    pags_lens lens = prepared(lenses[i]);
    int found = 0;
    for (int y = 0; y <= lens.height; y += 10)
      for (int x = 0; x <= lens.width; x += 10) {
        double px, py, u, v;
        if (!pags_lens_unproject(&lens, x, y, &px, &py))
          continue;
        assert_true(pags_lens_project(&lens, px, py, &u, &v));
        assert_true(fabs(u - x) < 1e-3 && fabs(v - y) < 1e-3);
        found++;
      }
    assert_true(found > (lens.width / 10 + 1) * (lens.height / 10 + 1) * 95 / 100);
  }
}

static void test_row_equals_points(void **state) {
  (void)state;
  for (int i = 0; i < LENSES; i++) {
    pags_lens lens = prepared(lenses[i]);
    double row[2 * 50], u, v;
    pags_lens_project_row(&lens, 50, -3, 0.125, 0.25, row);
    for (int x = 0; x < 50; x++) {
      if (pags_lens_project(&lens, -3 + x * 0.125, 0.25, &u, &v))
        assert_true(row[2 * x] == u && row[2 * x + 1] == v);
      else
        assert_true(isnan(row[2 * x]) && isnan(row[2 * x + 1]));
    }
  }
}

/* The model is limited to the radius where its radial function stops increasing; beyond it the picture would appear a
 * second time. */
static void test_limit(void **state) {
  (void)state;
  pags_lens lens = {.width = 100, .height = 100, .fx = 50, .fy = 50, .cx = 50, .cy = 50, .model.k = {-0.3}};
  scratch_ok(pags_lens_prepare(&lens, "lens"));
  assert_true(fabs(lens.limit - 1 / 0.9) < 1e-6); /* the root of 1 - 0.9 r^2 */
  double u, v;
  assert_true(pags_lens_project(&lens, 1.05, 0, &u, &v));
  assert_false(pags_lens_project(&lens, 1.06, 0, &u, &v));
  assert_false(pags_lens_unproject(&lens, 95, 95, &u, &v)); /* no ray is projected that far out */
}

/* Every pixel of the pinhole picture has a source pixel, and the picture is as large as that allows: with one more
 * pixel on any side some pixels have none. */
static void test_pinhole_is_filled(void **state) {
  (void)state;
  for (int i = 0; i < 2; i++) {
    pags_lens lens = prepared(lenses[i]);
    pags_camera camera = pinhole_of(&lens);
    assert_true(camera.fx == lens.fx && camera.fy == lens.fy);
    int lacking = 0, lacking_around = 0;
    for (int y = -1; y <= camera.height; y++)
      for (int x = -1; x <= camera.width; x++) {
        double u, v;
        bool inside = x >= 0 && x < camera.width && y >= 0 && y < camera.height;
        bool seen =
            pags_lens_project(&lens, (x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, &u, &v);
        seen = seen && u >= 0 && u <= lens.width && v >= 0 && v <= lens.height;
        lacking += inside && !seen;
        lacking_around += !inside && !seen;
      }
    assert_int_equal(lacking, 0);
    assert_true(lacking_around > 0);
  }
}

static void test_fox_size(void **state) {
  (void)state;
  pags_lens lens = prepared(&fox_lens);
  pags_camera camera = pinhole_of(&lens);
  /* COLMAP's undistorter gives 534 x 948. */
  assert_in_range(camera.width, 532, 536);
  assert_in_range(camera.height, 946, 954);
}

static void test_pinhole_stays(void **state) {
  (void)state;
  pags_lens lens = {.width = 30, .height = 20, .fx = 25, .fy = 26, .cx = 15.5, .cy = 9};
  scratch_ok(pags_lens_prepare(&lens, "lens"));
  assert_true(pags_lens_is_pinhole(&lens));
  pags_camera camera = pinhole_of(&lens);
  assert_true(camera.width == 30 && camera.height == 20 && camera.fx == 25 && camera.fy == 26);
  assert_true(camera.cx == 15.5 && camera.cy == 9);
}

/* The distorted photograph shows, where the lens model projects a ray (x, y, 1), a colour that is a smooth function
 * of that ray (red, green). After undistortion every pixel must show the colour of its own ray, which also makes
 * straight lines straight. */
static double red(double x, double y) {
  return 128 + 60 * sin(7 * x + 2 * y) + 60 * cos(5 * y);
}

static double green(double x, double y) {
  return 128 + 110 * x / (1 + fabs(x)) - 20 * sin(9 * y);
}

static pags_image photograph(const pags_lens *lens) {
  pags_image image;
  scratch_ok(pags_image_create(&image, lens->width, lens->height, 3, PAGS_U8));
  uint8_t *out = image.data;
  for (int y = 0; y < lens->height; y++)
    for (int x = 0; x < lens->width; x++, out += 3) {
      double rx, ry;
      if (!pags_lens_unproject(lens, x + 0.5, y + 0.5, &rx, &ry))
        continue;
      out[0] = (uint8_t)(red(rx, ry) + 0.5);
      out[1] = (uint8_t)(green(rx, ry) + 0.5);
      out[2] = 200;
    }
  return image;
}

static void test_analytic_picture(void **state) {
  (void)state;
  for (int i = 0; i < LENSES; i++) {
    pags_lens lens = prepared(lenses[i]);
    pags_camera camera = pinhole_of(&lens);
    pags_image from = photograph(&lens), to, mask;
    scratch_ok(pags_undistort(&lens, &camera, &from, NULL, &to, &mask));
    assert_true(to.width == camera.width && to.height == camera.height);
    if (i < 2)
      assert_null(mask.data);
    double square = 0, largest = 0;
    for (int y = 1; y < to.height - 1; y++)
      for (int x = 1; x < to.width - 1; x++) {
        if (mask.data && !((uint8_t *)mask.data)[y * to.width + x])
          continue;
        const uint8_t *p = (const uint8_t *)to.data + 3 * (y * to.width + x);
        double rx = (x + 0.5 - camera.cx) / camera.fx, ry = (y + 0.5 - camera.cy) / camera.fy;
        double off = fmax(fabs(p[0] - red(rx, ry)), fabs(p[1] - green(rx, ry)));
        square += off * off / (to.width * to.height);
        largest = fmax(largest, off);
        assert_in_range(p[2], 199, 200);
      }
    /* Rounding to 8 bits twice gives 0.4 RMS; an error of half a pixel in the position would give more than 2. */
    assert_true(sqrt(square) < 0.7);
    assert_true(largest < 4);
    pags_image_destroy(&from);
    pags_image_destroy(&to);
    pags_image_destroy(&mask);
  }
}

static void test_masks(void **state) {
  (void)state;
  pags_lens lens = prepared(&barrel_lens);
  pags_camera camera = pinhole_of(&lens);
  pags_image from = photograph(&lens), from_mask, to, mask;
  scratch_ok(pags_image_create(&from_mask, lens.width, lens.height, 1, PAGS_U8));
  for (int i = 0; i < lens.width * lens.height; i++) /* the left half is masked */
    ((uint8_t *)from_mask.data)[i] = i % lens.width < 160 ? 127 : 128;
  scratch_ok(pags_undistort(&lens, &camera, &from, &from_mask, &to, &mask));
  assert_non_null(mask.data);
  for (int y = 0; y < mask.height; y++)
    for (int x = 0; x < mask.width; x++) {
      double u, v;
      pags_lens_project(&lens, (x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, &u, &v);
      int used = ((uint8_t *)mask.data)[y * mask.width + x];
      assert_true(used == 0 || used == 255);
      if (u < 160.49)
        assert_int_equal(used, 0);
      if (u > 160.51)
        assert_int_equal(used, 255);
    }
  pags_image_destroy(&to);
  pags_image_destroy(&mask);

  /* A pinhole picture larger than the lens covers: pixels without a source are masked and black. */
  camera.width += 100;
  camera.cx += 50;
  scratch_ok(pags_undistort(&lens, &camera, &from, NULL, &to, &mask));
  assert_non_null(mask.data);
  assert_int_equal(((uint8_t *)mask.data)[0], 0);
  assert_int_equal(((uint8_t *)to.data)[2], 0);
  assert_int_equal(((uint8_t *)mask.data)[mask.height / 2 * mask.width + mask.width / 2], 255);
  pags_image_destroy(&to);
  pags_image_destroy(&mask);
  pags_image_destroy(&from);
  pags_image_destroy(&from_mask);
}

static void test_bad_numbers(void **state) {
  (void)state;
  pags_lens lens = fox_lens;
  lens.model.k[1] = NAN;
  scratch_expect(pags_lens_prepare(&lens, "a.json:7"), PAGS_ERROR_FORMAT, "a.json:7: expected finite");
  lens = fox_lens;
  lens.fy = 0;
  scratch_expect(pags_lens_prepare(&lens, "a.json:7"), PAGS_ERROR_FORMAT, "focal");
  lens = fox_lens;
  lens.width = 0;
  scratch_expect(pags_lens_prepare(&lens, "a.json:7"), PAGS_ERROR_FORMAT, "0 x 960");
  lens = fox_lens;
  lens.cx = 5000; /* the whole picture lies to the left of the optical axis */
  scratch_ok(pags_lens_prepare(&lens, "a.json:7"));
  pags_camera camera = {0};
  pags_result result = pags_lens_pinhole(&lens, "a.json:7", &camera);
  assert_true(result == PAGS_OK || result == PAGS_ERROR_FORMAT);
}

/* ---- Lenses that views keep ---- */

/* A set of one view. */
static void choose(pags_lens lens, bool undistort, pags_camera *out) {
  pags_parsed_view parsed = {.where = (char *)"a.json:7", .lens = lens};
  pags_dataset dataset = {.parsed = {.views = &parsed, .count = 1}, .cameras = out, .count = 1};
  double share;
  scratch_ok(pags_view_camera_choose(&dataset, 0, undistort, &share));
}

/* A view keeps its lens if a pinhole camera would lose a tenth of the picture, unless the options forbid lenses. */
static void test_which_lens_is_kept(void **state) {
  (void)state;
  pags_lens wide = fisheye_lens, panorama = {.model.kind = PAGS_LENS_EQUIRECTANGULAR, .width = 400, .height = 200};
  wide.fx = wide.fy = 0.3 * wide.width;
  wide.model.field = 190;
  panorama.fx = panorama.fy = 200 / 3.14159265358979;
  panorama.cx = 200;
  panorama.cy = 100;
  const struct {
    pags_lens lens;
    bool undistort, kept;
  } rows[] = {{fox_lens, false, false},
              {wide, false, true},
              {wide, true, false},
              {panorama, false, true},
              {panorama, true, false}};
  for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
    pags_camera camera = {0};
    choose(rows[i].lens, rows[i].undistort, &camera);
    assert_int_equal(pags_camera_bends(&camera), rows[i].kept);
    if (rows[i].kept) {
      assert_int_equal(camera.width, rows[i].lens.width);
      assert_true(camera.fx == rows[i].lens.fx && camera.lens.field == rows[i].lens.model.field);
    }
  }
}

/* Every pixel of the mask has a viewing direction; every pixel left out has none within two pixels. */
static void test_what_is_seen(void **state) {
  (void)state;
  enum { W = 90, H = 70 };
  const pags_lens_model models[] = {
      {.kind = PAGS_LENS_FISHEYE, .k = {-0.03, 0.002}, .field = 160},
      {.kind = PAGS_LENS_FTHETA, .k = {0.02, -0.03}, .s = {0.05, 0.02, -0.03}, .field = 150},
      {.kind = PAGS_LENS_THIN_PRISM, .k = {0.02}, .p = {0.004, -0.003}, .s = {0.002, 0.001}, .field = 120},
      {.kind = PAGS_LENS_PERSPECTIVE, .k = {-0.3}},
      {.kind = PAGS_LENS_EQUIRECTANGULAR, .field = 200}};
  for (size_t i = 0; i < sizeof models / sizeof *models; i++) {
    pags_camera camera = {.width = W, .height = H, .fx = 26, .fy = 25, .cx = 47, .cy = 33, .lens = models[i]};
    scratch_ok(pags_lens_model_check(&camera.lens, "lens"));
    bool seen[H + 4][W + 4]; /* also two pixels beyond each side */
    int count = 0;
    for (int y = 0; y < H + 4; y++)
      for (int x = 0; x < W + 4; x++) {
        double direction[3];
        seen[y][x] = pags_camera_look(&camera, x - 1.5, y - 1.5, direction);
        count += seen[y][x];
      }
    assert_true(count > W * H / 10 && count < (W + 4) * (H + 4) - 50);
    pags_image mask = {0};
    scratch_ok(pags_view_camera_mask(&camera, &mask));
    assert_non_null(mask.data);
    const uint8_t *used = mask.data;
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++) {
        bool inside = true;
        for (int j = 0; j < 5; j++)
          for (int k = 0; k < 5; k++)
            inside = inside && seen[y + j][x + k];
        if (used[y * W + x] ? !seen[y + 2][x + 2] : inside)
          fail_msg("lens %zu: pixel %d, %d", i, x, y);
      }
    pags_image_destroy(&mask);
  }
}

/* Through an almost undistorted lens, a box covers the same pixels as its outline through a pinhole camera; a box
 * around the camera covers all pixels. */
static void test_boxes_by_rays(void **state) {
  (void)state;
  enum { W = 64, H = 48 };
  const double pose[12] = {0.8, 0, 0.6, 0.7, 0, 1, 0, -0.4, -0.6, 0, 0.8, 6}, size[3] = {4, 1.5, 1.6};
  const double here[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  pags_camera plain = {.width = W, .height = H, .fx = 50, .fy = 50, .cx = 32, .cy = 24}, bent;
  memcpy(plain.world_from_camera, here, sizeof here);
  bent = plain;
  bent.lens.k[0] = 1e-9;
  scratch_ok(pags_camera_check(&bent, "camera"));
  uint8_t wanted[H * W] = {0}, found[H * W] = {0};
  double corners[32];
  pags_outline_fill(corners, pags_box_outline(&plain, pose, size, corners), W, H, W, 4, wanted);
  pags_pixel_rays rays;
  scratch_ok(pags_pixel_rays_create(&plain, &rays));
  assert_null(rays.direction);
  scratch_ok(pags_pixel_rays_create(&bent, &rays));
  pags_pixel_rays_fill_box(&rays, &bent, pose, size, W, 4, found);
  int count = 0, other = 0;
  for (int i = 0; i < W * H; i++) {
    count += wanted[i] != 0;
    other += wanted[i] != found[i];
  }
  assert_true(count > 400 && other <= 2);
  pags_pixel_rays_fill_box(&rays, &bent, here, size, W, 1, found);
  for (int i = 0; i < W * H; i++)
    assert_true(found[i] & 1);
  pags_pixel_rays_destroy(&rays);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_models),
      cmocka_unit_test(test_inverse),
      cmocka_unit_test(test_rare_models),
      cmocka_unit_test(test_folds),
      cmocka_unit_test(test_row_equals_points),
      cmocka_unit_test(test_limit),
      cmocka_unit_test(test_pinhole_is_filled),
      cmocka_unit_test(test_fox_size),
      cmocka_unit_test(test_pinhole_stays),
      cmocka_unit_test(test_analytic_picture),
      cmocka_unit_test(test_masks),
      cmocka_unit_test(test_bad_numbers),
      cmocka_unit_test(test_which_lens_is_kept),
      cmocka_unit_test(test_what_is_seen),
      cmocka_unit_test(test_boxes_by_rays),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
