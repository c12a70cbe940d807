/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of splat files of every format, packed scenes and skies. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include <pags/packed.h>
#include <pags/scene.h>
#include <pags/sky.h>

#include "base/bytes.h"
#include "base/file.h"
#include "scene/splat_formats.h"

/* Returns a copy with a zero byte after its end, as pags_file_read does. */
static uint8_t *terminated(const uint8_t *data, size_t size) {
  uint8_t *const copy = malloc(size + 1);
  if (!copy)
    abort();
  memcpy(copy, data, size);
  copy[size] = 0;
  return copy;
}

/* ---- PLY, plain and compressed: header words, rows as text and as bytes of either order ---- */

static int run_ply(const uint8_t *data, size_t size) {
  pags_gaussians g;
  pags_splat_facts facts = {0};
  uint8_t *const bytes = terminated(data, size);
  /* The format check by which loaders choose the reader. */
  const int is_ply = size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r');
  const int accepted =
      is_ply && fuzz_gaussians(pags_splat_run(pags_ply_decode, "a.ply", bytes, size, &g, &facts), &g, "a.ply");
  free(bytes);
  return accepted;
}

static void seed_ply(void) {
  pags_gaussians g;
  for (int degree = 0; degree <= 3; degree++) {
    sample_gaussians(&g, 5, degree, 1);
    fuzz_seed_bytes(make_ply(&g));
    pags_gaussians_destroy(&g);
  }
  sample_gaussians(&g, 4, 1, 1);
  fuzz_seed_bytes(make_scrambled_ply(&g, "ascii 1.0"));
  fuzz_seed_bytes(make_scrambled_ply(&g, "binary_big_endian 1.0"));
  FUZZ_CHECK(pags_gaussians_add_s_sem(&g) == PAGS_OK && pags_gaussians_add_object_id(&g) == PAGS_OK &&
             pags_gaussians_add_fourier(&g, 1) == PAGS_OK);
  const char *const path = fuzz_file("all.ply", "", 0);
  fuzz_seed_saved(pags_ply_save(path, &g), path);
  pags_gaussians_destroy(&g);
}

static const char *const ply_words[] = {"element vertex ",
                                        "element chunk ",
                                        "property float ",
                                        "property double ",
                                        "property uchar ",
                                        "property list uchar int ",
                                        "end_header\n",
                                        "format ascii 1.0\n",
                                        "s_sem",
                                        "object_id",
                                        "f_dc_t1_0",
                                        "f_sh1_t1_0",
                                        "f_rest_0",
                                        "packed_position",
                                        "comment SplatRenderMode: mip",
                                        "rot_3",
                                        NULL};
static const fuzz_target ply = {.name = "ply", .seeds = seed_ply, .run = run_ply, .words = ply_words};

static void seed_compressed(void) {
  fuzz_seed_bytes(make_compressed_ply(5, 0, 1, 1));
  fuzz_seed_bytes(make_compressed_ply(3, 3, 1, 1));
  fuzz_seed_bytes(make_compressed_ply(260, 1, 0, 1));
}

static const fuzz_target compressed = {
    .name = "compressed_ply", .seeds = seed_compressed, .run = run_ply, .words = ply_words};

/* ---- SPZ: whole files, and the content of the gzip stream, which mutations of whole files rarely reach because of
 * its checksum ---- */

static int run_spz(const uint8_t *data, size_t size) {
  pags_gaussians g;
  pags_splat_facts facts = {0};
  return fuzz_gaussians(pags_splat_run(pags_spz_decode, "a.spz", data, size, &g, &facts), &g, "a.spz");
}

/* Appends the records of a coordinate system and of a scene after the attributes, where versions 2 and 3 have them;
 * version 4 has a separate record. */
static void add_records(spz_parts *parts) {
  static const uint32_t words[12] = {0xADBE0003, 4, 6, 0x50470001, 28, 1, 0, 0x411E8480, 0, 0, 0, 0};
  parts->flags = 2;
  for (int i = 0; i < 12 && parts->version < 4; i++)
    bytes_u32(&parts->stream[5], words[i]);
}

static void seed_spz(void) {
  for (int version = 2; version <= 4; version++)
    for (int degree = 0; degree <= 3; degree++) {
      spz_parts parts = make_spz_parts(version, 7, degree, 1);
      fuzz_seed_bytes(pack_spz(&parts));
      add_records(&parts);
      fuzz_seed_bytes(pack_spz(&parts));
      free_spz_parts(&parts);
    }
}

/* The memory limit: deflate compresses by up to 1032, zstd by more; planes of floats take 3 times the bytes of the
 * attributes, and growing buffers double their size. */
static const fuzz_target spz = {.name = "spz", .seeds = seed_spz, .run = run_spz, .memory = 64u << 20, .times = 4096};

/* A gzip file of stored blocks: nothing is compressed, so that only a small multiple of the size may be allocated. */
static int run_spz_content(const uint8_t *data, size_t size) {
  file_bytes file = {0};
  bytes_put(&file, "\x1f\x8b\x08\0\0\0\0\0\0\xff", 10);
  bytes_stored(&file, data, size);
  bytes_u32(&file, (uint32_t)crc32(0, data, (uInt)size));
  bytes_u32(&file, (uint32_t)size);
  const int accepted = run_spz(file.data, file.size);
  bytes_free(&file);
  return accepted;
}

static void seed_spz_content(void) {
  for (int version = 2; version <= 3; version++)
    for (int degree = 0; degree <= 4; degree++) {
      spz_parts parts = make_spz_parts(version, 6, degree, 1);
      fuzz_seed_bytes(spz_plain(&parts));
      add_records(&parts);
      fuzz_seed_bytes(spz_plain(&parts));
      free_spz_parts(&parts);
    }
}

static const fuzz_target spz_content = {.name = "spz_content", .seeds = seed_spz_content, .run = run_spz_content};

/* ---- Packed scenes ---- */

static int run_packed(const uint8_t *data, size_t size) {
  pags_packed packed;
  pags_gaussians g;
  const char *const path = fuzz_file("a.pagsz", data, size);
  const pags_result result = pags_packed_open(path, &packed);
  if (result != PAGS_OK) {
    FUZZ_CHECK(!packed.block);
    fuzz_refused(result, "a.pagsz");
    return 0;
  }
  FUZZ_CHECK(pags_packed_unpack(&packed, &g) == PAGS_OK);
  FUZZ_CHECK(pags_gaussians_find_bad(&g, NULL) == 0);
  /* A cluster's bounds must contain the visible extent of its rows. */
  for (int64_t c = 0; c < packed.clusters.count; c++)
    FUZZ_CHECK(isfinite(packed.clusters.lo[0][c]) && isfinite(packed.clusters.sigma[c]));
  pags_gaussians_destroy(&g);
  pags_packed_destroy(&packed);
  return 1;
}

static void seed_packed(void) {
  for (int degree = 0; degree <= 3; degree += 3) {
    pags_gaussians g;
    pags_packed head = {.background = {0.5f, 0, 1}};
    sample_gaussians(&g, degree ? 70 : 3, degree, 2);
    FUZZ_CHECK(pags_gaussians_add_s_sem(&g) == PAGS_OK);
    pags_plane(&g, PAGS_MEAN)[1] = 1e9f; /* a Gaussian that is stored whole */
    const char *const path = fuzz_file("seed.pagsz", "", 0);
    fuzz_seed_saved(pags_packed_export(path, &g, &head), path);
    pags_gaussians_destroy(&g);
  }
}

static const fuzz_target packed = {.name = "packed", .seeds = seed_packed, .run = run_packed};

/* ---- .splat, through the loader for any file: PLY and packed files are recognised by their first bytes ---- */

static int run_splat(const uint8_t *data, size_t size) {
  pags_gaussians g;
  return fuzz_gaussians(pags_splat_load(fuzz_file("a.splat", data, size), &g, NULL, NULL), &g, "a.splat");
}

static void seed_splat(void) {
  pags_gaussians g;
  fuzz_seed_bytes(make_splat(1, 1));
  fuzz_seed_bytes(make_splat(30, 1));
  sample_gaussians(&g, 2, 0, 1);
  fuzz_seed_bytes(make_ply(&g));
  pags_gaussians_destroy(&g);
  seed_packed();
}

static const fuzz_target splat = {.name = "splat", .seeds = seed_splat, .run = run_splat};

/* ---- sky.npz, sky.npy ---- */

static int run_sky(const uint8_t *data, size_t size) {
  pags_sky sky;
  const pags_result result = pags_sky_load(fuzz_file("sky.npy", data, size), &sky);
  if (result != PAGS_OK) {
    FUZZ_CHECK(!sky.texels);
    fuzz_refused(result, "sky.npy");
    return 0;
  }
  for (size_t i = 0; i < 18 * (size_t)sky.size * (size_t)sky.size; i++)
    FUZZ_CHECK(isfinite(sky.texels[i]));
  pags_sky_destroy(&sky);
  return 1;
}

static void seed_sky(void) {
  pags_sky sky;
  FUZZ_CHECK(pags_sky_create(&sky, 3) == PAGS_OK);
  for (int i = 0; i < 18 * 9; i++)
    sky.texels[i] = (float)i / 100.0f;
  static const char *const names[] = {"seed.npy", "seed.npz"};
  for (int i = 0; i < 2; i++) {
    const char *const path = fuzz_file(names[i], "", 0);
    fuzz_seed_saved(pags_sky_save(path, &sky), path);
  }
  pags_sky_destroy(&sky);
}

static const char *const sky_words[] = {"'descr': ",     "'<f2'",       "'fortran_order': False",
                                        "'shape': (6, ", "\x93NUMPY\1", NULL};
static const fuzz_target sky = {.name = "sky", .seeds = seed_sky, .run = run_sky, .words = sky_words};

const fuzz_target *const fuzz_targets[] = {&ply, &compressed, &splat, &spz, &spz_content, &packed, &sky, NULL};
