/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the reader of TFRecord files: framing, both CRCs, damage in every part, and lengths that exceed the file. */
#include "unit/scratch.h"

#include "base/bytes.h"
#include "import/tfrecord.h"

enum { MOST = 4096 };

typedef struct file {
  uint8_t bytes[MOST];
  size_t size;
} file;

static uint32_t crc_by_bits(const uint8_t *bytes, size_t size) {
  uint32_t crc = 0xffffffffu;
  for (size_t i = 0; i < size; i++) {
    crc ^= bytes[i];
    for (int k = 0; k < 8; k++)
      crc = crc & 1 ? crc >> 1 ^ 0x82f63b78u : crc >> 1;
  }
  crc = ~crc;
  return (crc >> 15 | crc << 17) + 0xa282ead8u;
}

static void put_record(file *f, const void *data, size_t size) {
  uint8_t *p = f->bytes + f->size;
  pags_store_u64(p, size);
  pags_store_u32(p + 8, crc_by_bits(p, 8));
  memcpy(p + 12, data, size);
  pags_store_u32(p + 12 + size, crc_by_bits(p + 12, size));
  f->size += 16 + size;
}

static const char *path;

static void save(const file *f) {
  scratch_ok(pags_file_write(path, f->bytes, f->size));
}

/* Reads records up to the end or the first failure; `good` receives their number. */
static pags_result read_all(int *good) {
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  *good = 0;
  scratch_ok(pags_tfrecord_open(path, &reader));
  pags_result result;
  while ((result = pags_tfrecord_next(reader, &item)) == PAGS_OK && item.data)
    ++*good;
  pags_tfrecord_close(reader);
  return result;
}

static file three_records(void) {
  file f = {.size = 0};
  put_record(&f, "first", 5);
  put_record(&f, "", 0);
  put_record(&f, "the third record", 16);
  return f;
}

/* CRC-32C: records whose data have these checksums are accepted. */
static void test_crc_is_castagnolis(void **state) {
  (void)state;
  /* The published check value of CRC-32C, and the vectors of RFC 3720 B.4: 32 bytes of zero, of ones, ascending. */
  static const uint32_t published[] = {0xe3069283u, 0x8a9136aau, 0x62a8ab43u, 0x46dd794eu, 0};
  uint8_t blocks[5][32] = {"123456789"};
  static const size_t sizes[] = {9, 32, 32, 32, 0};
  file f = {.size = 0};
  int good;
  memset(blocks[2], 0xff, sizeof blocks[2]);
  for (uint8_t i = 0; i < 32; i++)
    blocks[3][i] = i;
  for (int k = 0; k < 5; k++) {
    put_record(&f, blocks[k], sizes[k]);
    pags_store_u32(f.bytes + f.size - 4, (published[k] >> 15 | published[k] << 17) + 0xa282ead8u);
  }
  save(&f);
  scratch_ok(read_all(&good));
  assert_int_equal(good, 5);
}

static void test_reads_records_in_order(void **state) {
  (void)state;
  const file f = three_records();
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  save(&f);
  scratch_ok(pags_tfrecord_open(path, &reader));
  scratch_ok(pags_tfrecord_next(reader, &item));
  assert_int_equal(item.size, 5);
  assert_memory_equal(item.data, "first", 5);
  assert_int_equal(item.number, 0);
  scratch_ok(pags_tfrecord_next(reader, &item));
  assert_int_equal(item.size, 0);
  assert_non_null(item.data);
  assert_int_equal(item.offset, 21);
  scratch_ok(pags_tfrecord_next(reader, &item));
  assert_memory_equal(item.data, "the third record", 16);
  assert_int_equal(item.number, 2);
  assert_int_equal(item.offset, 37);
  scratch_ok(pags_tfrecord_next(reader, &item));
  assert_null(item.data);
  assert_true(pags_tfrecord_fraction(reader) == 1);
  pags_tfrecord_close(reader);
}

static void test_skips_records(void **state) {
  (void)state;
  const file f = three_records();
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  int end;
  save(&f);
  scratch_ok(pags_tfrecord_open(path, &reader));
  for (int i = 0; i < 2; i++) {
    scratch_ok(pags_tfrecord_skip(reader, &end));
    assert_false(end);
  }
  scratch_ok(pags_tfrecord_next(reader, &item));
  assert_memory_equal(item.data, "the third record", 16);
  scratch_ok(pags_tfrecord_skip(reader, &end));
  assert_true(end);
  pags_tfrecord_close(reader);
}

static void test_an_empty_file_has_no_records(void **state) {
  (void)state;
  int good;
  save(&(file){.size = 0});
  scratch_ok(read_all(&good));
  assert_int_equal(good, 0);
}

/* Flips each bit of the third record, which begins at byte 37: the length, its CRC, the data or the data's CRC. */
static void test_refuses_every_flipped_bit(void **state) {
  (void)state;
  for (size_t at = 37; at < three_records().size; at++)
    for (int bit = 0; bit < 8; bit++) {
      file f = three_records();
      int good;
      f.bytes[at] ^= (uint8_t)(1 << bit);
      save(&f);
      const char *part =
          at < 49 ? "record 2 at byte 37: the CRC of its length" : "record 2 at byte 37: the CRC of its data";
      scratch_expect(read_all(&good), PAGS_ERROR_FORMAT, part);
      assert_int_equal(good, 2);
    }
}

static void test_refuses_every_cut(void **state) {
  (void)state;
  for (size_t size = 38; size < three_records().size; size++) {
    file f = three_records();
    int good;
    f.size = size;
    save(&f);
    scratch_expect(read_all(&good), PAGS_ERROR_FORMAT, "record 2 at byte 37: ");
    assert_int_equal(good, 2);
  }
}

/* A length beyond the end of the file is refused, though its CRC is right. */
static void test_believes_no_length_beyond_the_file(void **state) {
  (void)state;
  static const uint64_t lengths[] = {17, 1u << 30, UINT64_C(1) << 62, UINT64_MAX, UINT64_MAX - 11};
  for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++) {
    file f = three_records();
    int good, end = 0;
    pags_tfrecord *reader;
    pags_store_u64(f.bytes + 37, lengths[i]);
    pags_store_u32(f.bytes + 45, crc_by_bits(f.bytes + 37, 8));
    save(&f);
    scratch_expect(read_all(&good), PAGS_ERROR_FORMAT, "record 2 at byte 37: ");
    scratch_ok(pags_tfrecord_open(path, &reader));
    scratch_ok(pags_tfrecord_skip(reader, &end));
    scratch_ok(pags_tfrecord_skip(reader, &end));
    scratch_expect(pags_tfrecord_skip(reader, &end), PAGS_ERROR_FORMAT, "the file has 20 left");
    pags_tfrecord_close(reader);
  }
}

static void test_names_missing_files(void **state) {
  (void)state;
  pags_tfrecord *reader;
  scratch_expect(pags_tfrecord_open("/nowhere/segment.tfrecord", &reader), PAGS_ERROR_IO, "/nowhere/segment.tfrecord");
  assert_null(reader);
  assert_int_not_equal(pags_tfrecord_open(system_temporary(), &reader), PAGS_OK);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_crc_is_castagnolis),
      cmocka_unit_test(test_reads_records_in_order),
      cmocka_unit_test(test_skips_records),
      cmocka_unit_test(test_an_empty_file_has_no_records),
      cmocka_unit_test(test_refuses_every_flipped_bit),
      cmocka_unit_test(test_refuses_every_cut),
      cmocka_unit_test(test_believes_no_length_beyond_the_file),
      cmocka_unit_test(test_names_missing_files),
  };
  scratch folder;
  scratch_begin(&folder);
  path = scratch_path(&folder, "records");
  const int failed = cmocka_run_group_tests(tests, NULL, NULL);
  scratch_end(&folder);
  return failed;
}
