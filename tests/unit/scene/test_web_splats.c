/* SPDX-License-Identifier: Apache-2.0 */
/* Tests SOG, and glTF with KHR_gaussian_splatting: known bytes give known values, ignored and guessed parts are
 * reported, and invalid files are refused. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <pags/scene.h>
#include "base/log.h"
#include "unit/scratch.h"
#include "web_files.h"

#include <cmocka.h>

static char said[2048];

static void listen(void *user, pags_log_level level, const char *message) {
  (void)user;
  if (level == PAGS_LOG_WARNING)
    snprintf(said + strlen(said), sizeof said - strlen(said), "%s\n", message);
}

static double value(const pags_gaussians *g, int plane, int64_t i) {
  return (double)pags_plane(g, plane)[i];
}

static void near(double found, double expected, double tolerance) {
  if (!(fabs(found - expected) <= tolerance))
    fail_msg("expected %.9g, found %.9g", expected, found);
}

static void load(const char *path, pags_gaussians *g, const char *kind) {
  const char *found;
  said[0] = 0;
  pags_log_set(listen, NULL);
  scratch_ok(pags_splat_load(path, g, &found, NULL));
  pags_log_set(NULL, NULL);
  assert_string_equal(found, kind);
}

static void refused(const char *path, pags_result code, const char *part) {
  pags_gaussians g;
  scratch_expect(pags_splat_load(path, &g, NULL, NULL), code, part);
  assert_null(g.data);
}

/* ---- SOG ---- */

#ifdef PAGS_WITH_WEBP

static double mean(int i, int k) {
  static const double lo[3] = {-1, -2, 0}, hi[3] = {1, 2, 3};
  const double v = lo[k] + (hi[k] - lo[k]) * (sog_pixel(1, i, k) + 256 * sog_pixel(2, i, k)) / 65535;
  return v < 0 ? 1 - exp(-v) : exp(v) - 1;
}

static void check_sog(const pags_gaussians *g, int version, int degree) {
  static const double scales[4] = {-5, -4, -3, -2}, colours[4] = {-1, 0, 0.5, 2}, terms[4] = {-0.5, 0, 0.25, 0.5};
  static const double lows[4] = {-2, -2, -2, -4}, highs[4] = {2, 2, 3, 5};
  assert_int_equal(g->count, SOG_COUNT);
  assert_int_equal(g->sh_degree, degree);
  for (int i = 0; i < SOG_COUNT; i++) {
    for (int k = 0; k < 3; k++) {
      const int scale = sog_pixel(3, i, k), colour = sog_pixel(5, i, k);
      near(value(g, PAGS_MEAN + k, i), mean(i, k), 1e-5);
      near(value(g, PAGS_SCALE + k, i), version == 2 ? scales[scale] : -6 + (k == 2 ? 6 : 5) * scale / 255.0, 1e-6);
      near(value(g, PAGS_SH + k, i), version == 2 ? colours[colour] : lows[k] + (highs[k] - lows[k]) * colour / 255.0,
           1e-6);
    }
    const double alpha = fmin(fmax(sog_pixel(5, i, 3) / 255.0, 1e-6), 1 - 1e-6);
    near(value(g, PAGS_OPACITY, i), version == 2 ? log(alpha / (1 - alpha)) : lows[3] + 9 * sog_pixel(5, i, 3) / 255.0,
         1e-5);
    double q[4], sum = 0;
    for (int k = 0; k < 4; k++) {
      q[k] = value(g, PAGS_ROTATION + k, i);
      sum += q[k] * q[k];
    }
    near(sum, 1, 1e-5);
    const int largest = sog_pixel(4, i, 3) - 252;
    for (int k = 0, from = 0; k < 4; k++)
      if (k != largest)
        near(q[k], (sog_pixel(4, i, from++) / 127.5 - 1) * sqrt(0.5), 1e-6);
    for (int k = 0; k < 3 * degree; k++)
      for (int c = 0; c < 3; c++) {
        const int entry = sog_pixel(6, 3 * sog_pixel(7, i, 0) + k, c);
        near(value(g, PAGS_SH + 3 + 3 * k + c, i), version == 2 ? terms[entry] : -1 + 2.55 * entry / 255, 1e-6);
      }
  }
}

static void put_sog(scratch *s, const char *folder, file_bytes files[SOG_FILES]) {
  char name[64];
  for (int k = 0; k < SOG_FILES; k++)
    if (files[k].size) {
      snprintf(name, sizeof name, "%s/%s", folder, sog_names[k]);
      scratch_write(s, name, files[k].data, files[k].size);
    }
}

static void sog_decodes_in_folders_and_archives(void **state) {
  scratch *s = *state;
  for (int version = 1; version <= 2; version++)
    for (int degree = 0; degree <= 1; degree++) {
      pags_gaussians g;
      file_bytes files[SOG_FILES];
      const char *const kind = version == 2 ? "SOG v2" : "SOG v1";
      make_sog(version, degree, files);
      put_sog(s, "sog", files);
      for (int way = 0; way < 4; way++) {
        file_bytes zip = make_zip(sog_names, files, SOG_FILES, way == 3 ? "inner/" : "", way == 2);
        if (way >= 2)
          scratch_write(s, "a.sog", zip.data, zip.size);
        load(scratch_path(s, way == 0 ? "sog" : way == 1 ? "sog/meta.json" : "a.sog"), &g, kind);
        assert_string_equal(said, "");
        check_sog(&g, version, degree);
        pags_gaussians_destroy(&g);
        bytes_free(&zip);
      }
      free_sog(files);
    }
}

/* Writes a SOG of version 2 whose meta.json has `from` replaced by `to`. */
static const char *changed(scratch *s, const char *from, const char *to) {
  file_bytes files[SOG_FILES], meta = {0};
  make_sog(2, 1, files);
  bytes_u8(&files[0], 0);
  char *text = (char *)files[0].data, *at = strstr(text, from);
  assert_non_null(at);
  bytes_text(&meta, "%.*s%s%s", (int)(at - text), text, to, at + strlen(from));
  bytes_free(&files[0]);
  files[0] = meta;
  put_sog(s, "sog", files);
  free_sog(files);
  return scratch_path(s, "sog/meta.json");
}

static void sog_reports_guesses(void **state) {
  scratch *s = *state;
  pags_gaussians g;
  load(changed(s, "[-5, -4", "[null, -4"), &g, "SOG v2");
  assert_non_null(strstr(said, "the first number of 'codebook' is null"));
  near((double)pags_plane(&g, PAGS_SCALE)[0], -4 - (4.0 - 2) / 3, 1e-5);
  pags_gaussians_destroy(&g);
  load(changed(s, "\"count\": 3", "\"count\": 2"), &g, "SOG v2");
  assert_non_null(strstr(said, "1 of 5 Gaussians name no entry of the palette of 2, the first is Gaussian 2"));
  pags_gaussians_destroy(&g);
  load(changed(s, "\"antialias\": true", "\"model\": \"2dgs\""), &g, "SOG v2");
  assert_non_null(strstr(said, "flat discs"));
  pags_gaussians_destroy(&g);
}

/* Positions far from zero, which need more digits than a float has, are read relative to an origin. */
static void sog_far_away_keeps_its_digits(void **state) {
  pags_gaussians g;
  pags_splat_facts facts;
  const char *const path =
      changed(*state, "[-1, -2, 0], \"maxs\": [1, 2, 3]", "[15.3, -2, 0], \"maxs\": [15.3001, 2, 3]");
  scratch_ok(pags_splat_read(path, PAGS_AXES_UNKNOWN, &g, &facts));
  assert_true(facts.origin[0] > 4e6 && facts.origin[0] == facts.taken_off[0] && facts.origin[1] == 0);
  for (int i = 0; i < SOG_COUNT; i++) {
    const double v = 15.3 + 0.0001 * (sog_pixel(1, i, 0) + 256 * sog_pixel(2, i, 0)) / 65535;
    near(facts.origin[0] + value(&g, 0, i), exp(v) - 1, 1e-4);
    near(value(&g, 1, i), mean(i, 1), 1e-6);
  }
  pags_gaussians_destroy(&g);
}

static void sog_refuses_invalid_files(void **state) {
  scratch *s = *state;
  static const struct {
    const char *from, *to, *part;
  } rows[] = {{"\"version\": 2", "\"version\": 3", "SOG version 3; versions 1 and 2 can be read"},
              {"\"count\": 5", "\"count\": 17", "expected 17 to"},
              {"\"count\": 5", "\"count\": 2000000000", "are no picture of 2000000000 Gaussians"},
              {"[-5, -4, -3, -2]", "[-5, -4]", "'scales': pixel 0: expected an index of the 2 values"},
              {"[-1, -2, 0]", "[-1, -200, 0]", "within -89 and 89"},
              {"quats.webp", "none.webp", "meta.json: names 'none.webp', which isn't in its folder"},
              {"quats.webp", "../quats.webp", "expected names of files in the folder of meta.json"},
              {"quats.webp", "meta.json", "expected a WebP picture"},
              {"\"bands\": 1", "\"bands\": 2", "expected a palette 512 pixels wide for degree 2, found 192 x 1"}};
  for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
    refused(changed(s, rows[i].from, rows[i].to),
            i == 0   ? PAGS_ERROR_UNSUPPORTED
            : i == 5 ? PAGS_ERROR_IO
                     : PAGS_ERROR_FORMAT,
            rows[i].part);
  file_bytes files[SOG_FILES];
  make_sog(2, 0, files);
  scratch_write(s, "bare/meta.json", files[0].data, files[0].size);
  free_sog(files);
  assert_string_equal(pags_scene_folder_kind(scratch_path(s, "bare")), "SOG");
  refused(scratch_path(s, "bare"), PAGS_ERROR_IO, "names 'means_l.webp', which isn't in its folder");
  scratch_text(s, "other/meta.json", "{\"frames\": []}");
  assert_null(pags_scene_folder_kind(scratch_path(s, "other")));
  scratch_text(s, "sog/meta.json", "{\"lodLevels\": 2, \"filenames\": [\"0_0/meta.json\"]}");
  refused(scratch_path(s, "sog/meta.json"), PAGS_ERROR_UNSUPPORTED, "the list of a streamed SOG");
}

static void archives_are_checked(void **state) {
  scratch *s = *state;
  file_bytes files[SOG_FILES];
  make_sog(2, 0, files);
  for (int deflate = 0; deflate <= 1; deflate++) {
    file_bytes zip = make_zip(sog_names, files, SOG_FILES, "", deflate);
    scratch_write(s, "a.sog", zip.data, zip.size - 30);
    refused(scratch_path(s, "a.sog"), PAGS_ERROR_FORMAT, "found no end record");
    zip.data[60] ^= 1;
    scratch_write(s, "a.sog", zip.data, zip.size);
    refused(scratch_path(s, "a.sog"), PAGS_ERROR_FORMAT, "'meta.json': wrong CRC");
    bytes_free(&zip);
  }
  file_bytes other = make_zip(sog_names + 1, files + 1, 5, "", 0);
  scratch_write(s, "a.zip", other.data, other.size);
  refused(scratch_path(s, "a.zip"), PAGS_ERROR_FORMAT, "a zip archive without meta.json");
  bytes_free(&other);
  static const char pointer[] = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n";
  put_sog(s, "sog", files);
  scratch_text(s, "sog/quats.webp", pointer);
  refused(scratch_path(s, "sog"), PAGS_ERROR_FORMAT, "quats.webp: a Git LFS pointer");
  free_sog(files);
}

#endif

/* ---- glTF ---- */

/* Two Gaussians in rows of 48 bytes: position, quaternion as shorts, sigma, opacity as a byte, colour. */
static file_bytes rows(float sign) {
  static const float position[2][3] = {{1, 2, 3}, {-4, 5, 0.5f}};
  static const int quaternion[2][4] = {{0, 0, 0, 32767}, {23170, 0, 0, 23170}};
  file_bytes out = {0};
  for (int i = 0; i < 2; i++) {
    for (int k = 0; k < 3; k++)
      bytes_f32(&out, position[i][k]);
    for (int k = 0; k < 4; k += 2)
      bytes_u32(&out, (uint32_t)quaternion[i][k] | (uint32_t)quaternion[i][k + 1] << 16);
    for (int k = 0; k < 3; k++)
      bytes_f32(&out, sign * 0.1f * (float)(k + 1));
    bytes_u32(&out, 51);
    for (int k = 0; k < 3; k++)
      bytes_f32(&out, 0.25f * (float)(k + i));
  }
  return out;
}

#define VIEW(offset, type, kind, more)                                                                           \
  "{\"bufferView\": 0, \"byteOffset\": " offset ", \"componentType\": " type ", \"count\": 2, \"type\": \"" kind \
  "\"" more "}"

/* A glTF document of these rows with the given nodes and with `more` among the attributes. */
static const char *document(const char *nodes, const char *more, const char *extension, const char *root) {
  static char text[4096];
  snprintf(text, sizeof text,
           "{\"asset\": {\"version\": \"2.0\"}, %s\"scenes\": [{\"nodes\": [0]}], \"nodes\": %s, \"buffers\": [{\"byteLength\": "
           "96}], \"bufferViews\": [{\"buffer\": 0, \"byteLength\": 96, \"byteStride\": 48}], \"accessors\": [" VIEW(
               "0", "5126", "VEC3", "") ", " VIEW("12", "5122", "VEC4", ", \"normalized\": true") ", " VIEW(
               "20", "5126", "VEC3", "") ", " VIEW("32", "5121", "SCALAR", ", \"normalized\": true") ", " VIEW(
               "36", "5126", "VEC3", "") "], \"meshes\": [{\"primitives\": [{\"mode\": 0, \"attributes\": {\"POSITION\": 0, "
           "\"KHR_gaussian_splatting:ROTATION\": 1, \"KHR_gaussian_splatting:SCALE\": 2, "
           "\"KHR_gaussian_splatting:OPACITY\": 3%s}, \"extensions\": {\"KHR_gaussian_splatting\": %s}}]}]}",
           root, nodes, more, extension);
  return text;
}

static const char dc[] = ", \"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0\": 4";
static const char degree_1[] =
    ", \"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0\": 4, \"KHR_gaussian_splatting:SH_DEGREE_1_COEF_0\": "
    "4, \"KHR_gaussian_splatting:SH_DEGREE_1_COEF_1\": 0, "
    "\"KHR_gaussian_splatting:SH_DEGREE_1_COEF_2\": 2";
static const char plain[] = "{\"kernel\": \"ellipse\", \"colorSpace\": \"srgb_rec709_display\"}";

static const char *put_glb(scratch *s, const char *json, float sign) {
  file_bytes chunk = rows(sign), file = make_glb(json, &chunk);
  scratch_write(s, "a.glb", file.data, file.size);
  bytes_free(&chunk);
  bytes_free(&file);
  return scratch_path(s, "a.glb");
}

static void gltf_attributes_of_all_types_decode(void **state) {
  scratch *s = *state;
  pags_gaussians g;
  load(put_glb(s, document("[{\"mesh\": 0}]", degree_1, plain, ""), 1), &g, "glTF");
  assert_string_equal(said, "");
  assert_int_equal(g.count, 2);
  assert_int_equal(g.sh_degree, 1);
  /* glTF has x left, y up, z forward; PLY has x right, y down, z forward: half a turn about z. */
  near(value(&g, 0, 0), -1, 0);
  near(value(&g, 1, 0), -2, 0);
  near(value(&g, 2, 0), 3, 0);
  near(value(&g, PAGS_SCALE + 1, 0), log(0.2), 1e-6);
  near(value(&g, PAGS_OPACITY, 0), log(0.2 / 0.8), 1e-5);
  near(value(&g, PAGS_SH + 2, 1), 0.75, 0);
  near(fabs(value(&g, PAGS_ROTATION + 3, 0)), 1, 1e-6); /* (0, 0, 0, 1) turned about z */
  near(fabs(value(&g, PAGS_ROTATION + 2, 1)), sqrt(0.5), 1e-4);
  /* The terms of degree 1 are (y, z, x): y and x change sign. */
  near(value(&g, PAGS_SH + 3, 1), -0.25, 1e-6);
  near(value(&g, PAGS_SH + 6, 1), -4, 1e-6);
  near(value(&g, PAGS_SH + 9, 1), -0.1, 1e-6);
  pags_gaussians_destroy(&g);
}

static void gltf_nodes_place_gaussians(void **state) {
  scratch *s = *state;
  pags_gaussians g;
  /* A child node, turned by 90 degrees about z, scaled by 2 and moved, and its parent. */
  load(put_glb(s,
               document(
                   "[{\"mesh\": 0, \"translation\": [10, 0, 0], \"children\": [1]}, {\"mesh\": 0, \"rotation\": [0, 0, "
                   "0.70710678, 0.70710678], \"scale\": [2, 2, 2], \"translation\": [0, 0, 7]}]",
                   dc, plain, ""),
               1),
       &g, "glTF");
  assert_int_equal(g.count, 4);
  near(value(&g, 0, 0), -11, 1e-5);
  near(value(&g, 1, 0), -2, 1e-5);
  /* (1, 2, 3) -> 2 * (-2, 1, 3) + (10, 0, 7) = (6, 2, 13), then half a turn */
  near(value(&g, 0, 2), -6, 1e-5);
  near(value(&g, 1, 2), -2, 1e-5);
  near(value(&g, 2, 2), 13, 1e-5);
  near(value(&g, PAGS_SCALE, 2), log(0.2), 1e-6);
  pags_gaussians_destroy(&g);
  /* A node far away on the globe: positions are read relative to an origin. */
  pags_scene scene;
  scratch_ok(pags_scene_load(
      put_glb(s, document("[{\"mesh\": 0, \"translation\": [0, 0, 5000000.25]}]", dc, plain, ""), 1), &scene));
  near(scene.origin[2] + value(&scene.models[0].gaussians, 2, 0), 5000003.25, 1e-6);
  pags_scene_destroy(&scene);
}

static void gltf_reports_guesses(void **state) {
  scratch *s = *state;
  static const struct {
    const char *more, *extension, *root;
    float sign;
    const char *part;
  } cases[] = {
      {dc, plain, "", -1, "1 of 1 primitives have negative scales: taken as logarithms"},
      {dc, "{\"colorSpace\": \"lin_rec709_display\"}", "", 1, "colours in linear light"},
      {dc, "{\"kernel\": \"disc\"}", "", 1, "another kernel than 'ellipse'"},
      {", \"COLOR_0\": 4", plain, "", 1, "no SH_DEGREE_0_COEF_0; COLOR_0"},
      {", \"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0\": 4, \"KHR_gaussian_splatting:SH_DEGREE_1_COEF_2\": 2", plain,
       "", 1, "a degree of harmonics with terms missing"},
      {dc, plain, "\"animations\": [{}], ", 1, "1 animations aren't read"},
  };
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    pags_gaussians g;
    load(put_glb(s, document("[{\"mesh\": 0}]", cases[i].more, cases[i].extension, cases[i].root), cases[i].sign), &g,
         "glTF");
    if (!strstr(said, cases[i].part))
      fail_msg("expected '%s', found '%s'", cases[i].part, said);
    pags_gaussians_destroy(&g);
  }
}

static void gltf_refuses_invalid_files(void **state) {
  scratch *s = *state;
  static const struct {
    const char *nodes, *more, *extension, *root, *part;
  } cases[] = {
      {"[{\"mesh\": 0}]", "", plain, "", "expected the attribute KHR_gaussian_splatting:SH_DEGREE_0_COEF_0"},
      {"[{\"mesh\": 0}]", dc, "{\"extensions\": {\"KHR_gaussian_splatting_compression_spz_2\": {}}}", "",
       "packed by 'KHR_gaussian_splatting_compression_spz_2'"},
      {"[{\"mesh\": 0}]", dc, plain, "\"extensionsRequired\": [\"EXT_meshopt_compression\"], ", "needs the extension"},
      {"[{\"mesh\": 0, \"scale\": [1, 2, 1]}]", dc, plain, "", "scaled evenly, found one of scale 1, 2, 1"},
      {"[{\"mesh\": 0, \"scale\": [-1, 1, 1]}]", dc, plain, "", "mirrored"},
      {"[{\"children\": [0]}]", dc, plain, "", "expected a tree of 1 nodes"},
      {"[{\"mesh\": 3}]", dc, plain, "", "expected 'mesh' below 1, found 3"},
      {"[{}]", dc, plain, "", "a glTF without Gaussians"},
  };
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
    refused(put_glb(s, document(cases[i].nodes, cases[i].more, cases[i].extension, cases[i].root), 1),
            i == 1 || i == 2 ? PAGS_ERROR_UNSUPPORTED : PAGS_ERROR_FORMAT, cases[i].part);
}

static void gltf_meshes_are_refused(void **state) {
  scratch *s = *state;
  scratch_text(
      s, "a.gltf",
      "{\"asset\": {\"version\": \"2.0\"}, \"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0}], \"meshes\": "
      "[{\"primitives\": [{\"attributes\": {\"POSITION\": 0}}]}], \"buffers\": []}");
  refused(scratch_path(s, "a.gltf"), PAGS_ERROR_FORMAT, "a glTF without Gaussians");
}

int main(void) {
  const struct CMUnitTest tests[] = {
#ifdef PAGS_WITH_WEBP
      scratch_test(sog_decodes_in_folders_and_archives),
      scratch_test(sog_reports_guesses),
      scratch_test(sog_far_away_keeps_its_digits),
      scratch_test(sog_refuses_invalid_files),
      scratch_test(archives_are_checked),
#endif
      scratch_test(gltf_attributes_of_all_types_decode),
      scratch_test(gltf_nodes_place_gaussians),
      scratch_test(gltf_reports_guesses),
      scratch_test(gltf_refuses_invalid_files),
      scratch_test(gltf_meshes_are_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
