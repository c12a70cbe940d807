/* Damaged splat files: whatever is done to them, loading returns, and either gives finite Gaussians or a message that names
 * the file. Run it in the asan-ubsan preset to see more than crashes. The damage is pseudo-random with a fixed seed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include "base/rng.h"
#include "pags/scene.h"
#include "scratch_folder.h"
#include "splat_files.h"

#include <cmocka.h>

enum { FLIPS = 150, EDITS = 50 };

static int loads, accepted;

static void try_load(const char *name, const uint8_t *bytes, size_t size) {
  pags_gaussians g;
  const char *path = scratch_file(name, bytes, size);
  pags_result result = pags_splat_load(path, &g, NULL, NULL);
  ++loads;
  if (result != PAGS_OK) {
    assert_null(g.data);
    assert_non_null(strstr(pags_error_message(), name));
    return;
  }
  ++accepted;
  assert_int_equal(pags_gaussians_find_bad(&g, NULL), 0);
  pags_gaussians_destroy(&g);
}

static uint64_t draw(uint64_t stream, uint64_t index, uint64_t below) {
  return pags_rng_below(2026, stream, index, below);
}

/* Cut at every 1/200th. */
static void truncate_it(const char *name, const file_bytes *file) {
  for (size_t k = 0; k < 200; ++k)
    try_load(name, file->data, file->size * k / 200);
}

/* One to eight bytes changed, half of the times within the first 400, where headers are. */
static void flip_bytes(const char *name, const file_bytes *file, uint64_t stream) {
  file_bytes copy = {0};
  for (uint64_t i = 0; i < FLIPS; ++i) {
    copy.size = 0;
    bytes_put(&copy, file->data, file->size);
    size_t reach = i % 2 && file->size > 400 ? 400 : file->size;
    for (uint64_t k = 0; k <= draw(stream, 16 * i, 8); ++k)
      copy.data[draw(stream + 1, 16 * i + k, reach)] = (uint8_t)draw(stream + 2, 16 * i + k, 256);
    try_load(name, copy.data, copy.size);
  }
  bytes_free(&copy);
}

/* A number in the text of a header replaced by one that hurts. */
static void edit_header(const char *name, const file_bytes *file, uint64_t stream) {
  static const char *const numbers[] = {"0", "-1", "1", "4294967295", "4294967296", "9223372036854775807", "1e9", ""};
  size_t header = 0, starts[600], count = 0;
  for (; header + 10 < file->size && memcmp(file->data + header, "end_header", 10) != 0 && count < 600; ++header)
    if (file->data[header] >= '0' && file->data[header] <= '9' && strchr(" _", file->data[header - 1]))
      starts[count++] = header;
  for (uint64_t i = 0; i < EDITS && count; ++i) {
    size_t at = starts[draw(stream, i, i % 2 ? count : (count < 4 ? count : 4))], end = at;
    while (file->data[end] >= '0' && file->data[end] <= '9')
      ++end;
    file_bytes copy = {0};
    bytes_put(&copy, file->data, at);
    bytes_text(&copy, "%s", numbers[draw(stream + 1, i, sizeof numbers / sizeof *numbers)]);
    bytes_put(&copy, file->data + end, file->size - end);
    try_load(name, copy.data, copy.size);
    bytes_free(&copy);
  }
}

static void damage(const char *name, file_bytes file, uint64_t stream) {
  int before = accepted;
  try_load(name, file.data, file.size);
  assert_int_equal(accepted, before + 1); /* undamaged, it loads */
  truncate_it(name, &file);
  flip_bytes(name, &file, stream);
  if (file.data[0] == 'p')
    edit_header(name, &file, stream + 3);
  bytes_free(&file);
}

static void plies(void **state) {
  (void)state;
  pags_gaussians g;
  sample_gaussians(&g, 30, 1, 1);
  damage("inria.ply", make_ply(&g), 100);
  damage("ascii.ply", make_scrambled_ply(&g, "ascii 1.0"), 200);
  damage("big.ply", make_scrambled_ply(&g, "binary_big_endian 1.0"), 300);
  pags_gaussians_destroy(&g);
}

static void compressed_plies(void **state) {
  (void)state;
  damage("compressed.ply", make_compressed_ply(300, 1, 1, 1), 400);
}

static void splats(void **state) {
  (void)state;
  damage("a.splat", make_splat(60, 1), 500);
}

static void spzs(void **state) {
  (void)state;
  static const char *const names[] = {"v2.spz", "v3.spz", "v4.spz"};
  for (int version = 2; version <= 4; ++version) {
    spz_parts parts = make_spz_parts(version, 100, 2, 1);
    damage(names[version - 2], pack_spz(&parts), 600 + 10 * (uint64_t)version);
    free_spz_parts(&parts);
  }
}

/* Damage inside of the gzip data, which its checksum would hide: headers and lengths of any value, then packed. */
static void spz_contents(void **state) {
  (void)state;
  for (uint64_t i = 0; i < FLIPS; ++i) {
    spz_parts parts = make_spz_parts(i % 2 ? 2 : 3, 20, (int)(i % 4), 1);
    file_bytes plain = {0};
    bytes_text(&plain, "NGSP");
    bytes_u32(&plain, (uint32_t)parts.version);
    bytes_u32(&plain, 20);
    bytes_u32(&plain, (uint32_t)parts.sh_degree | 12 << 8);
    for (int s = 0; s < 6; ++s)
      bytes_put(&plain, parts.stream[s].data, parts.stream[s].size);
    plain.data[4 + draw(700, i, 12)] = (uint8_t)draw(701, i, 256);
    file_bytes file = gzip_bytes(&plain);
    try_load("inside.spz", file.data, file.size);
    bytes_free(&file);
    bytes_free(&plain);
    free_spz_parts(&parts);
  }
}

static int setup(void **state) {
  (void)state;
  return scratch_make();
}

static int teardown(void **state) {
  (void)state;
  printf("%d files loaded, %d of them accepted\n", loads, accepted);
  return scratch_remove();
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(plies), cmocka_unit_test(compressed_plies), cmocka_unit_test(splats),
      cmocka_unit_test(spzs),  cmocka_unit_test(spz_contents),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
