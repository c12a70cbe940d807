/* SPDX-License-Identifier: Apache-2.0 */
/* Tests locks of folders and files: which processes are refused, when a lock ends, and which files remain. */
#define _GNU_SOURCE /* for syscall */
#include "base/lock.h"

#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/log.h"
#include "scratch_folder.h"

#include <cmocka.h>

/* 1: flock fails as on a file system without locks. Replaces the C library's function. */
static int no_locks;

int flock(int file, int operation) {
  if (!no_locks)
    return (int)syscall(SYS_flock, file, operation);
  errno = no_locks;
  return -1;
}

static pags_lock *locked(const char *folder) {
  pags_lock *lock;
  if (pags_lock_folder(folder, &lock) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return lock;
}

static void assert_refused(pags_result result, const char *words) {
  assert_int_equal(result, PAGS_ERROR_IO);
  if (!strstr(pags_error_message(), words))
    fail_msg("expected '%s' in '%s'", words, pags_error_message());
}

/* Starts a process that locks the folder, starts another program and then waits for ever. Returns once the folder is
 * locked. */
static pid_t start_holder(const char *folder) {
  int ready[2];
  char byte;
  assert_int_equal(pipe(ready), 0);
  const pid_t child = fork();
  if (child == 0) {
    pags_lock *lock;
    pags_lock_set_holder("pags sleep");
    if (pags_lock_folder(folder, &lock) != PAGS_OK)
      _exit(1);
    if (fork() == 0) {
      close(STDOUT_FILENO); /* ctest waits until the output is closed */
      close(STDERR_FILENO);
      execlp("sleep", "sleep", "20", (char *)NULL);
      _exit(1);
    }
    usleep(100000); /* the other program has started and inherited the file descriptors */
    if (write(ready[1], "", 1) != 1)
      _exit(1);
    for (;;)
      pause();
  }
  close(ready[1]);
  assert_int_equal(read(ready[0], &byte, 1), 1);
  close(ready[0]);
  return child;
}

static void a_second_lock_is_refused_and_names_the_first(void **state) {
  (void)state;
  char process[40];
  pags_lock *second;
  bool empty;
  pags_lock_set_holder("pags train");
  pags_lock *first = locked(scratch("a/b/"));
  snprintf(process, sizeof process, "pags train, process %d", (int)getpid());
  assert_refused(pags_lock_folder(scratch("a/b"), &second), process);
  assert_null(second);
  assert_true(pags_path_exists(scratch("a/b/.pags.lock")));
  assert_int_equal(pags_dir_is_empty(scratch("a/b"), &empty), PAGS_OK);
  assert_true(empty);
  pags_lock_release(first);
  assert_false(pags_path_exists(scratch("a")));
}

/* A process that has the lock may be suspended before it writes its name; the refused process waits for the name. */
static void a_late_name_is_waited_for(void **state) {
  (void)state;
  assert_int_equal(mkdir(scratch("late"), 0777), 0);
  const int file = open(scratch("late/.pags.lock"), O_RDWR | O_CREAT, 0666);
  assert_int_equal(flock(file, LOCK_EX), 0);
  const pid_t child = fork();
  if (child == 0) {
    usleep(300000);
    _exit(write(file, "late, process 7", 15) != 15);
  }
  pags_lock *lock;
  assert_refused(pags_lock_folder(scratch("late"), &lock), "late, process 7");
  int status;
  assert_int_equal(waitpid(child, &status, 0), child);
  assert_int_equal(status, 0);
  close(file);
}

static void a_lock_removes_only_empty_folders_it_made(void **state) {
  (void)state;
  assert_int_equal(pags_make_dirs(scratch("there")), PAGS_OK);
  pags_lock_release(locked(scratch("there/")));
  assert_true(pags_dir_exists(scratch("there")));
  pags_lock *lock = locked(scratch("there/made/deep"));
  scratch_file("there/made/file", "1", 1);
  pags_lock_release(lock);
  assert_false(pags_path_exists(scratch("there/made/deep")));
  assert_true(pags_file_exists(scratch("there/made/file")));
}

static void a_lock_ends_with_its_process(void **state) {
  (void)state;
  pags_lock *lock;
  int how;
  const pid_t child = start_holder(scratch("folder"));
  assert_refused(pags_lock_folder(scratch("folder"), &lock), "pags sleep, process ");
  kill(child, SIGKILL);
  assert_int_equal(waitpid(child, &how, 0), child);
  assert_true(pags_path_exists(scratch("folder/.pags.lock")));
  lock = locked(scratch("folder"));
  assert_int_equal(pags_remove_tree(scratch("folder")), PAGS_OK); /* the lock file is in the folder */
  pags_lock *other = locked(scratch("folder"));                   /* a new folder of the same name */
  pags_lock_release(lock);
  assert_refused(pags_lock_folder(scratch("folder"), &lock), "another process is writing there");
  pags_lock_release(other);
}

/* A lock file that a killed process on another host left is ignored. */
static void a_file_of_a_dead_process_locks_nothing(void **state) {
  (void)state;
  assert_int_equal(pags_make_dirs(scratch("folder")), PAGS_OK);
  scratch_file("folder/.pags.lock", "pags train, process 1 on elsewhere\n", 35);
  pags_lock_release(locked(scratch("folder")));
  assert_false(pags_path_exists(scratch("folder/.pags.lock")));
}

static void warn(void *user, pags_log_level level, const char *line) {
  if (level == PAGS_LOG_WARNING)
    snprintf(user, 400, "%s", line);
}

static void missing_locks_cause_a_warning(void **state) {
  (void)state;
  static const int answers[] = {ENOLCK, ENOSYS, EOPNOTSUPP, EINVAL, EBADF};
  for (size_t i = 0; i < sizeof answers / sizeof *answers; i++) {
    char said[400] = "";
    pags_log_set(warn, said);
    no_locks = answers[i];
    pags_lock *lock = locked(scratch("folder"));
    assert_int_equal(pags_file_write(scratch("folder/file"), "1", 1), PAGS_OK);
    no_locks = 0;
    pags_log_set(NULL, NULL);
    assert_non_null(strstr(said, "no locks"));
    pags_lock_release(lock);
    assert_false(pags_path_exists(scratch("folder/.pags.lock")));
  }
}

static void files_of_one_folder_are_locked_separately(void **state) {
  (void)state;
  pags_lock *a, *b, *again;
  assert_int_equal(pags_make_dirs(scratch("out")), PAGS_OK);
  assert_int_equal(pags_lock_file(scratch("out/a.gltf"), &a), PAGS_OK);
  assert_int_equal(pags_lock_file(scratch("out/b.gltf"), &b), PAGS_OK);
  assert_refused(pags_lock_file(scratch("out/a.gltf"), &again), "another process is writing it");
  pags_lock_release(a);
  pags_lock_release(b);
  a = locked(scratch("out"));
  assert_refused(pags_lock_file(scratch("out/a.gltf"), &again), "to its folder: ");
  pags_lock_release(a);
  pags_dir_list list;
  assert_int_equal(pags_dir_list_read(scratch("out"), &list), PAGS_OK);
  assert_int_equal(list.count, 0);
  assert_int_equal(rmdir(scratch("out")), 0);
  assert_int_equal(pags_lock_file("/dev/null", &a), PAGS_OK);
  assert_null(a);
}

/* A file has one writer at a time: the second is refused, and the bytes of the first are complete. */
static void a_file_has_one_writer_at_a_time(void **state) {
  (void)state;
  pags_file_writer first, second;
  uint8_t *bytes;
  size_t size;
  assert_int_equal(pags_file_writer_begin(&first, scratch("file")), PAGS_OK);
  assert_int_equal(pags_file_writer_put(&first, "first", 5), PAGS_OK);
  assert_refused(pags_file_writer_begin(&second, scratch("file")), "another process is writing it");
  assert_int_equal(pags_file_writer_commit(&first), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("file"), &bytes, &size), PAGS_OK);
  assert_string_equal((char *)bytes, "first");
  free(bytes);
  scratch_file("file.part", "left by a killed process, and longer", 36);
  assert_int_equal(pags_file_write(scratch("file"), "second", 6), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("file"), &bytes, &size), PAGS_OK);
  assert_int_equal(size, 6);
  free(bytes);
}

static void names_of_locks(void **state) {
  (void)state;
  assert_true(pags_path_is_lock(".pags.lock"));
  assert_true(pags_path_is_lock(".a.ply.pags.lock"));
  assert_false(pags_path_is_lock("a.pags.lock"));
  assert_false(pags_path_is_lock(".pags.lock.ply"));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(a_second_lock_is_refused_and_names_the_first),
                                     cmocka_unit_test(a_lock_removes_only_empty_folders_it_made),
                                     cmocka_unit_test(a_lock_ends_with_its_process),
                                     cmocka_unit_test(a_file_of_a_dead_process_locks_nothing),
                                     cmocka_unit_test(a_late_name_is_waited_for),
                                     cmocka_unit_test(missing_locks_cause_a_warning),
                                     cmocka_unit_test(files_of_one_folder_are_locked_separately),
                                     cmocka_unit_test(a_file_has_one_writer_at_a_time),
                                     cmocka_unit_test(names_of_locks)};
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
