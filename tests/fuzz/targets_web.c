/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the splat formats of the web: SOG in a folder and in an archive, and glTF. */
#include "fuzz/fuzz.h"

#include <string.h>

#include <pags/scene.h>

#include "base/file.h"
#include "scene/splat_formats.h"
#include "web_files.h"

/* ---- SOG: meta.json and its pictures, and the archive ---- */

static int run_sog(const uint8_t *data, size_t size) {
  fuzz_part parts[SOG_FILES];
  pags_gaussians g;
  fuzz_parts(data, size, SOG_FILES, parts);
  for (int k = 1; k < SOG_FILES; k++)
    fuzz_file(sog_names[k], parts[k].bytes, parts[k].size);
  const char *const path = fuzz_file("meta.json", parts[0].bytes ? parts[0].bytes : (const uint8_t *)"", parts[0].size);
  /* A refusal names meta.json, or the file of a damaged picture. */
  const int accepted = fuzz_gaussians(pags_splat_load(path, &g, NULL, NULL), &g, fuzz_folder());
  fuzz_parts_free(SOG_FILES, parts);
  return accepted;
}

static void seed_sog(void) {
#ifdef PAGS_WITH_WEBP
  for (int version = 1; version <= 2; version++)
    for (int degree = 0; degree <= 1; degree++) {
      file_bytes files[SOG_FILES], all = {0};
      make_sog(version, degree, files);
      for (int k = 0; k < SOG_FILES && files[k].size; k++) {
        if (k)
          bytes_text(&all, "%s", FUZZ_CUT);
        bytes_put(&all, files[k].data, files[k].size);
      }
      fuzz_seed_bytes(all);
      free_sog(files);
    }
#endif
}

static const char *const sog_words[] = {"\"version\": 2",
                                        "\"count\": ",
                                        "\"codebook\": [null, ",
                                        "\"mins\": ",
                                        "\"bands\": 3",
                                        "\"files\": [",
                                        "\"shape\": [",
                                        "1e30",
                                        "\"../\"",
                                        NULL};
static const fuzz_target sog = {.name = "sog",
                                .seeds = seed_sog,
                                .run = run_sog,
                                .words = sog_words,
                                .memory = 64u << 20,
                                .times = 1u << 20,
                                .smoke = 3000};

static int run_sog_zip(const uint8_t *data, size_t size) {
  pags_gaussians g;
  pags_splat_facts facts = {0};
  return fuzz_gaussians(pags_splat_run(pags_sog_decode_zip, "a.sog", data, size, &g, &facts), &g, "a.sog");
}

static void seed_sog_zip(void) {
#ifdef PAGS_WITH_WEBP
  for (int version = 1; version <= 2; version++) {
    file_bytes files[SOG_FILES];
    make_sog(version, 1, files);
    fuzz_seed_bytes(make_zip(sog_names, files, SOG_FILES, version == 1 ? "" : "inside/", version == 1));
    free_sog(files);
  }
#endif
}

static const fuzz_target sog_zip = {
    .name = "sog_zip", .seeds = seed_sog_zip, .run = run_sog_zip, .memory = 64u << 20, .times = 1u << 20};

/* ---- glTF ---- */

static int run_gltf(const uint8_t *data, size_t size) {
  pags_gaussians g;
  pags_splat_facts facts = {0};
  return fuzz_gaussians(pags_splat_run(pags_gltf_decode, "a.glb", data, size, &g, &facts), &g, "a.glb");
}

static void seed_gltf(void) {
  static const char json[] =
      "{\"asset\": {\"version\": \"2.0\"}, \"scene\": 0, \"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0, "
      "\"rotation\": [0, 0, 1, 0], \"scale\": [2, 2, 2], \"children\": [1]}, {\"mesh\": 0, \"matrix\": [1, 0, 0, 0, 0, "
      "1, 0, 0, 0, "
      "0, 1, 0, 4, 5, 6, 1]}], \"buffers\": [{\"byteLength\": 64}], \"bufferViews\": [{\"buffer\": 0, \"byteLength\": "
      "64, "
      "\"byteStride\": 32}], \"accessors\": [{\"bufferView\": 0, \"componentType\": 5126, \"count\": 2, \"type\": "
      "\"VEC3\"}, "
      "{\"bufferView\": 0, \"byteOffset\": 12, \"componentType\": 5122, \"normalized\": true, \"count\": 2, \"type\": "
      "\"VEC4\"}, "
      "{\"bufferView\": 0, \"byteOffset\": 20, \"componentType\": 5121, \"normalized\": true, \"count\": 2, \"type\": "
      "\"SCALAR\"}], "
      "\"meshes\": [{\"primitives\": [{\"mode\": 0, \"attributes\": {\"POSITION\": 0, "
      "\"KHR_gaussian_splatting:ROTATION\": 1, "
      "\"KHR_gaussian_splatting:SCALE\": 0, \"KHR_gaussian_splatting:OPACITY\": 2, "
      "\"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0\": 0, \"KHR_gaussian_splatting:SH_DEGREE_1_COEF_0\": 0, "
      "\"KHR_gaussian_splatting:SH_DEGREE_1_COEF_1\": 0, \"KHR_gaussian_splatting:SH_DEGREE_1_COEF_2\": 0}, "
      "\"extensions\": "
      "{\"KHR_gaussian_splatting\": {\"kernel\": \"ellipse\", \"colorSpace\": \"srgb_rec709_display\"}}}]}]}";
  file_bytes chunk = {0};
  for (int i = 0; i < 16; i++)
    bytes_f32(&chunk, 0.25f * (float)(i + 1));
  fuzz_seed_bytes(make_glb(json, &chunk));
  bytes_free(&chunk);
}

static const char *const gltf_words[] = {"\"translation\": [",
                                         "\"sparse\": {",
                                         "\"children\": [",
                                         "\"uri\": \"data:;base64,",
                                         "\"COLOR_0\": 0",
                                         "\"extras\": {",
                                         "\"generator\": \"pags 1\"",
                                         "5120",
                                         "\"byteStride\": 0",
                                         "null",
                                         NULL};
/* A node takes few bytes of the file and can show the same Gaussians again. */
static const fuzz_target gltf = {
    .name = "gltf", .seeds = seed_gltf, .run = run_gltf, .words = gltf_words, .memory = 16u << 20, .times = 4096};

const fuzz_target *const fuzz_targets[] = {&sog, &sog_zip, &gltf, NULL};
