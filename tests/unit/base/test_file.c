/* SPDX-License-Identifier: Apache-2.0 */
/* Tests reading and writing of files, folders and paths. */
#include "base/file.h"

#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include "scratch_folder.h"

#include <cmocka.h>

static void a_file_round_trips(void **state) {
  (void)state;
  uint8_t *bytes;
  size_t size;
  const char *path = scratch("a.bin");
  assert_int_equal(pags_file_write(path, "ab\0cd", 5), PAGS_OK);
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  assert_int_equal(size, 5);
  assert_memory_equal(bytes, "ab\0cd", 6); /* the reader puts a zero behind the bytes */
  free(bytes);
  assert_int_equal(pags_file_write(path, "", 0), PAGS_OK);
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  assert_int_equal(size, 0);
  free(bytes);
}

static void unreadable_things_are_named(void **state) {
  (void)state;
  uint8_t *bytes;
  size_t size;
  char message[SCRATCH_PATH + 200];
  assert_int_equal(pags_file_read(scratch_folder, &bytes, &size), PAGS_ERROR_IO);
  snprintf(message, sizeof message, "%s: expected a file, found a folder", scratch_folder);
  assert_string_equal(pags_error_message(), message);
  assert_int_equal(pags_file_read(scratch("none"), &bytes, &size), PAGS_ERROR_IO);
  snprintf(message, sizeof message, "%s: can't open: No such file or directory", scratch("none"));
  assert_string_equal(pags_error_message(), message);
  assert_int_equal(pags_file_read(SYSTEM_NULL_DEVICE, &bytes, &size), PAGS_ERROR_IO);
}

static void a_failed_write_leaves_nothing(void **state) {
  (void)state;
  pags_dir_list list;
  assert_int_equal(pags_make_dirs(scratch("w/taken")), PAGS_OK);
  assert_int_equal(pags_file_write(scratch("w/taken"), "x", 1), PAGS_ERROR_IO);
  assert_int_equal(pags_file_write(scratch("w/none/x"), "x", 1), PAGS_ERROR_IO);
  assert_int_equal(pags_dir_list_read(scratch("w"), &list), PAGS_OK);
  assert_int_equal(list.count, 1);
  pags_dir_list_destroy(&list);
}

static void an_aborted_write_keeps_the_old_file(void **state) {
  (void)state;
  pags_file_writer writer;
  uint8_t *bytes;
  size_t size;
  assert_int_equal(pags_file_write(scratch("old"), "old", 3), PAGS_OK);
  assert_int_equal(pags_file_writer_begin(&writer, scratch("old")), PAGS_OK);
  assert_int_equal(pags_file_writer_put(&writer, "new", 3), PAGS_OK);
  pags_file_writer_abort(&writer);
  pags_file_writer_abort(&writer);
  assert_false(pags_path_exists(scratch("old.part")));
  assert_int_equal(pags_file_read(scratch("old"), &bytes, &size), PAGS_OK);
  assert_memory_equal(bytes, "old", 4);
  free(bytes);
}

static void folders_are_made_listed_and_removed(void **state) {
  (void)state;
  pags_dir_list list;
  bool empty;
  assert_int_equal(pags_make_dirs(scratch("t/b/c/")), PAGS_OK);
  assert_int_equal(pags_make_dirs(scratch("t/b/c")), PAGS_OK);
  scratch_file("t/a", "1", 1);
  scratch_file("t/.hidden", "1", 1);
  assert_int_equal(pags_dir_list_read(scratch("t"), &list), PAGS_OK);
  assert_int_equal(list.count, 3);
  assert_string_equal(list.names[0], ".hidden");
  assert_string_equal(list.names[1], "a");
  assert_string_equal(list.names[2], "b");
  pags_dir_list_destroy(&list);
  assert_int_equal(pags_dir_is_empty(scratch("t"), &empty), PAGS_OK);
  assert_false(empty);
  assert_int_equal(pags_dir_is_empty(scratch("t/b/c"), &empty), PAGS_OK);
  assert_true(empty);
  assert_int_equal(pags_remove_tree(scratch("t")), PAGS_OK);
  assert_false(pags_path_exists(scratch("t")));
  assert_int_equal(pags_remove_tree(scratch("t")), PAGS_OK);
  assert_int_equal(pags_dir_is_empty(scratch("t"), &empty), PAGS_OK);
  assert_true(empty);
}

static void a_file_in_the_way_is_named(void **state) {
  (void)state;
  char message[SCRATCH_PATH + 200];
  scratch_file("way", "1", 1);
  assert_int_equal(pags_make_dirs(scratch("way/x")), PAGS_ERROR_IO);
  snprintf(message, sizeof message, "%s: can't make the folder: File exists", scratch("way"));
  assert_string_equal(pags_error_message(), message);
}

static void assert_joined(const char *folder, const char *name, const char *expected) {
  char *joined = pags_path_join(folder, name);
  assert_string_equal(joined, expected);
  free(joined);
}

static void assert_folder(const char *path, const char *expected) {
  char *folder = pags_path_folder(path);
  assert_string_equal(folder, expected);
  free(folder);
}

static void paths_are_split_and_joined(void **state) {
  (void)state;
  assert_joined("a", "b", "a/b");
  assert_joined("a/", "b", "a/b");
  assert_joined("a", "/b", "/b");
  assert_joined("", "b", "b");
  assert_folder("a/b", "a");
  assert_folder("/b", "/");
  assert_folder("b", ".");
  assert_string_equal(pags_path_name("a/b.c"), "b.c");
  assert_string_equal(pags_path_extension("a.x/b.c"), ".c");
  assert_string_equal(pags_path_extension("a.x/b"), "");
  assert_string_equal(pags_path_extension(".b"), "");
  assert_true(pags_path_is_inside("objects/a..ply"));
  assert_false(pags_path_is_inside("/etc/passwd"));
  assert_false(pags_path_is_inside("a/../../b"));
  assert_false(pags_path_is_inside(".."));
  assert_false(pags_path_is_inside(""));
  assert_true(pags_path_is_inside("objects\\a..ply")); /* a name with a backslash; on Windows, two path parts */
  assert_false(pags_path_is_inside("..\\b"));
  assert_false(pags_path_is_inside("a\\..\\..\\b"));
  assert_false(pags_path_is_inside("a/..\\b"));
  assert_false(pags_path_is_inside("\\\\server\\share"));
  assert_false(pags_path_is_inside("C:\\b"));
  assert_false(pags_path_is_inside("C:b"));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_file_round_trips),
      cmocka_unit_test(unreadable_things_are_named),
      cmocka_unit_test(a_failed_write_leaves_nothing),
      cmocka_unit_test(an_aborted_write_keeps_the_old_file),
      cmocka_unit_test(folders_are_made_listed_and_removed),
      cmocka_unit_test(a_file_in_the_way_is_named),
      cmocka_unit_test(paths_are_split_and_joined),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
