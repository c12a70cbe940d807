/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the decoders of PNG, JPEG and EXR with OpenImageIO's. Both give the same size, samples and refusals for
 * generated files of every kind, whole, truncated and damaged, and for the test data's pictures. Skipped without
 * OpenImageIO. */
#include <pags/image.h>

#include "base/rng.h"
#include "image/other.h"
#include "picture_files.h"
#include "shared_data.h"
#include "unit/scratch.h"

#include <strings.h>

static const pags_oiio *oiio;

/* A picture as one of both decoders gives it. */
typedef struct decoded {
  pags_result result;
  int channels; /* channels of the file, at most 4 */
  pags_image image;
} decoded;

static decoded decode_theirs(const char *path, int most) {
  decoded d = {.image = {0}};
  pags_colour colour;
  d.result = pags_other_load(path, most, &d.image, &colour);
  return d;
}

static size_t bytes_of(const pags_image *image) {
  return (size_t)image->width * (size_t)image->height * (size_t)image->channels *
         (image->sample == PAGS_U8    ? 1
          : image->sample == PAGS_U16 ? 2
                                      : 4);
}

/* Decodes a file by both decoders, with all channels and without alpha. Returns 1 if both give the same and 0 if
 * both refuse the file. Otherwise prints the difference and returns -1. */
static int compare(const char *path, const char *name) {
  int outcome = 0;
  for (int most = 4; most >= 3; most--) {
    decoded theirs = decode_theirs(path, most);
    pags_image ours = {0};
    const pags_sample sample = theirs.result == PAGS_OK ? theirs.image.sample : PAGS_U8;
    const int channels = most == 4 ? 0 : theirs.image.channels == 4 ? 3 : theirs.image.channels;
    const pags_result result = pags_image_load(path, sample, theirs.result == PAGS_OK ? channels : 0, &ours);
    const int refused = theirs.result != PAGS_OK;
    outcome = refused ? 0 : 1;
    if ((result != PAGS_OK) != refused) {
      printf("%s: %s, OpenImageIO %s\n", name, result == PAGS_OK ? "is read" : pags_error_message(),
             refused ? "refuses it" : "reads it");
      outcome = -1;
    } else if (!refused && (ours.width != theirs.image.width || ours.height != theirs.image.height ||
                            ours.channels != theirs.image.channels)) {
      printf("%s: %d x %d x %d, OpenImageIO: %d x %d x %d\n", name, ours.width, ours.height, ours.channels,
             theirs.image.width, theirs.image.height, theirs.image.channels);
      outcome = -1;
    } else if (!refused && memcmp(ours.data, theirs.image.data, bytes_of(&ours)) != 0) {
      size_t at = 0;
      while (((uint8_t *)ours.data)[at] == ((uint8_t *)theirs.image.data)[at])
        at++;
      printf("%s: byte %zu of %zu differs: %d, OpenImageIO: %d\n", name, at, bytes_of(&ours),
             ((uint8_t *)ours.data)[at], ((uint8_t *)theirs.image.data)[at]);
      outcome = -1;
    }
    pags_image_destroy(&ours);
    pags_image_destroy(&theirs.image);
    if (outcome < 1)
      break;
  }
  return outcome;
}

static void need_oiio(void) {
  if (pags_oiio_module(&oiio) == PAGS_OK)
    return;
  printf("skipped: needs OpenImageIO: %s\n", pags_error_message());
  skip();
}

static void test_every_kind(void **state) {
  need_oiio();
  static const int sizes[][2] = {{37, 21}, {1, 1}, {3, 40}, {64, 64}, {200, 70}};
  int equal = 0, different = 0;
  for (picture_format format = PICTURE_PNG; format <= PICTURE_EXR; format++)
    for (int size = 0; size < 5; size++) {
      file_bytes bytes;
      char name[96];
      for (int kind = 0; picture_file(format, kind, sizes[size][0], sizes[size][1], &bytes, name); kind++) {
        scratch_write(*state, name, bytes.data, bytes.size);
        bytes_free(&bytes);
        const int outcome = compare(((scratch *)*state)->path, name);
        equal += outcome == 1;
        different += outcome != 1;
        if (outcome == 0)
          printf("%s: refused: %s\n", name, pags_error_message());
        remove(((scratch *)*state)->path);
      }
    }
  printf("%d generated files are equal, %d differ\n", equal, different);
  assert_int_equal(different, 0);
}

/* Truncated files, and files with a few changed bits. OpenImageIO uses libpng too, so both decoders accept the same
 * PNG files. Both use libjpeg, but OpenImageIO takes its warnings for errors, so only our decoder's refusal of
 * truncated JPEG files is checked. The EXR decoders differ and may accept different files. */
static void test_damage(void **state) {
  need_oiio();
  int same = 0, stricter = 0, laxer = 0, different = 0;
  for (picture_format format = PICTURE_PNG; format <= PICTURE_EXR; format++)
    for (int round = 0; round < 6; round++) {
      file_bytes bytes;
      char name[96];
      for (int kind = 0; picture_file(format, kind, 33, 20, &bytes, name); kind++) {
        const uint64_t stream = 1000 * (uint64_t)format + (uint64_t)kind;
        if (round < 2)
          bytes.size = (size_t)pags_rng_below((uint64_t)round, stream, 0, bytes.size);
        for (uint64_t i = 0; round >= 2 && i < (uint64_t)round - 1; i++)
          bytes.data[pags_rng_below((uint64_t)round, stream, 2 * i, bytes.size)] ^=
              (uint8_t)(1 << pags_rng_below((uint64_t)round, stream, 2 * i + 1, 8));
        scratch_write(*state, name, bytes.data, bytes.size);
        const char *const path = ((scratch *)*state)->path;
        pags_image ours;
        const pags_result result = pags_image_load(path, PAGS_F32, 0, &ours);
        pags_image_destroy(&ours);
        decoded theirs = decode_theirs(path, 4);
        pags_image_destroy(&theirs.image);
        if (result == PAGS_OK && theirs.result != PAGS_OK) {
          laxer++;
          different += format == PICTURE_PNG;
        } else if (result == PAGS_OK) {
          const int outcome = compare(path, name);
          same += outcome == 1;
          different += outcome != 1 && format != PICTURE_EXR;
        } else {
          assert_true(result == PAGS_ERROR_FORMAT || result == PAGS_ERROR_UNSUPPORTED);
          same += theirs.result != PAGS_OK;
          stricter += theirs.result == PAGS_OK;
          assert_true(theirs.result != PAGS_OK || format == PICTURE_EXR || strstr(pags_error_message(), "cut off"));
        }
        bytes_free(&bytes);
        remove(path);
      }
    }
  printf("%d damaged files: the same; OpenImageIO reads %d more, and refuses %d more; %d differ\n", same, stricter,
         laxer, different);
  assert_int_equal(different, 0);
}

/* Both decoders read the files that pags writes alike, PNG and EXR without loss. */
static void test_written_files(void **state) {
  need_oiio();
  static const char *const names[] = {"a.png", "a.jpg", "a.exr"};
  scratch *const s = *state;
  for (int i = 0; i < 3 * 4 * 3; i++) {
    pags_image image, back;
    const pags_sample sample = (pags_sample)(i / 12);
    const int channels = i % 4 + 1;
    assert_int_equal(pags_image_create(&image, 61, 35, channels, sample), PAGS_OK);
    for (size_t k = 0; k < (size_t)(61 * 35 * channels); k++) {
      const uint16_t value = (uint16_t)(k * 77 + k * k % 1000);
      if (sample == PAGS_U8)
        ((uint8_t *)image.data)[k] = (uint8_t)value;
      else if (sample == PAGS_U16)
        ((uint16_t *)image.data)[k] = value;
      else
        ((float *)image.data)[k] = (float)value * 1e-3f - 7;
    }
    const char *const path = scratch_path(s, names[i / 4 % 3]);
    scratch_ok(pags_image_save(path, &image));
    assert_int_equal(compare(path, names[i / 4 % 3]), 1);
    const bool exr = i / 4 % 3 == 2, png = i / 4 % 3 == 0;
    if (exr ? sample == PAGS_F32 : png && sample != PAGS_F32) {
      scratch_ok(pags_image_load(path, sample, 0, &back));
      assert_int_equal(back.channels, channels);
      assert_memory_equal(back.data, image.data, bytes_of(&image));
      pags_image_destroy(&back);
    }
    pags_image_destroy(&image);
  }
  static float plane[20 * 40];
  for (int k = 0; k < 20 * 40; k++)
    plane[k] = (float)k;
  const char *const channels[] = {"R", "a name of more than thirty-one characters", "B", "G", "A"};
  const float *const planes[] = {plane, plane + 1, plane + 2, plane + 3, plane + 4};
  const char *const path = scratch_path(s, "names.exr");
  scratch_ok(pags_image_save_exr(path, 30, 20, 5, channels, planes, 34, NULL));
  assert_int_equal(compare(path, "names.exr"), 1);
}

/* Compares all pictures in a folder and its subfolders. */
static void compare_folder(const char *folder, int *equal, int *different) {
  pags_dir_list names;
  if (pags_dir_list_read(folder, &names) != PAGS_OK)
    return;
  for (int64_t i = 0; i < names.count; i++) {
    char *const path = pags_path_join(folder, names.names[i]);
    const char *const end = pags_path_extension(path);
    assert_non_null(path);
    if (pags_dir_exists(path)) {
      compare_folder(path, equal, different);
    } else if (strcasecmp(end, ".png") == 0 || strcasecmp(end, ".jpg") == 0 || strcasecmp(end, ".jpeg") == 0 ||
               strcasecmp(end, ".exr") == 0) {
      const int outcome = compare(path, path);
      *equal += outcome == 1;
      *different += outcome != 1;
    }
    free(path);
  }
  pags_dir_list_destroy(&names);
}

static void test_pictures_of_the_test_data(void **state) {
  (void)state;
  char path[512];
  need_oiio();
  if (!pags_shared_data(".", path, sizeof path))
    skip();
  int equal = 0, different = 0;
  compare_folder(path, &equal, &different);
  printf("%d pictures of the test data are equal, %d differ\n", equal, different);
  assert_int_equal(different, 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      scratch_test(test_every_kind),
      scratch_test(test_damage),
      scratch_test(test_written_files),
      cmocka_unit_test(test_pictures_of_the_test_data),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
