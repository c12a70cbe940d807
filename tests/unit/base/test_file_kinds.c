/* SPDX-License-Identifier: Apache-2.0 */
/* Tests writing to links, FIFOs, sockets and devices, as the caller and as another user. */
#define _XOPEN_SOURCE 700 /* for mknod */
#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "scratch_folder.h"

#include <cmocka.h>

/* A folder with a link is listed and removed; the link's target stays. */
static void a_removed_link_keeps_its_target(void **state) {
  (void)state;
  pags_dir_list list;
  assert_int_equal(pags_make_dirs(scratch("t/b/c")), PAGS_OK);
  scratch_file("t/a", "1", 1);
  assert_int_equal(pags_make_dirs(scratch("elsewhere")), PAGS_OK);
  scratch_file("elsewhere/kept", "1", 1);
  assert_int_equal(symlink(scratch("elsewhere"), scratch("t/link")), 0);
  assert_int_equal(pags_dir_list_read(scratch("t"), &list), PAGS_OK);
  assert_int_equal(list.count, 3);
  assert_string_equal(list.names[2], "link");
  pags_dir_list_destroy(&list);
  assert_int_equal(pags_remove_tree(scratch("t")), PAGS_OK);
  assert_false(pags_path_exists(scratch("t")));
  assert_true(pags_file_exists(scratch("elsewhere/kept")));
}

/* ---- Links, FIFOs, sockets and devices are never replaced by a file ---- */

static mode_t kind_of(const char *path) {
  struct stat status;
  return lstat(path, &status) == 0 ? status.st_mode & S_IFMT : 0;
}

static void assert_holds(const char *path, const char *text) {
  uint8_t *bytes;
  size_t size;
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  assert_string_equal((const char *)bytes, text);
  free(bytes);
}

static void assert_refused(const char *path, const char *words) {
  pags_file_writer writer;
  assert_int_equal(pags_file_write(path, "new", 3), PAGS_ERROR_IO);
  assert_non_null(strstr(pags_error_message(), path));
  if (!strstr(pags_error_message(), words))
    fail_msg("expected \"%s\", got \"%s\"", words, pags_error_message());
  assert_int_equal(pags_file_write_unsynced(path, "new", 3), PAGS_ERROR_IO);
  assert_int_equal(pags_file_writer_append(&writer, path), PAGS_ERROR_IO);
}

static void a_link_is_followed(void) {
  assert_int_equal(symlink("target", scratch("link")), 0);
  assert_int_equal(symlink(scratch("link"), scratch("second")), 0);
  scratch_file("target", "old", 3);
  assert_int_equal(pags_file_write(scratch("second"), "new", 3), PAGS_OK);
  assert_int_equal(kind_of(scratch("link")), S_IFLNK);
  assert_int_equal(kind_of(scratch("second")), S_IFLNK);
  assert_int_equal(kind_of(scratch("target")), S_IFREG);
  assert_holds(scratch("target"), "new");
  assert_false(pags_path_exists(scratch("target.part")));

  assert_int_equal(unlink(scratch("target")), 0); /* now both links dangle */
  assert_int_equal(pags_file_write(scratch("second"), "made", 4), PAGS_OK);
  assert_int_equal(kind_of(scratch("link")), S_IFLNK);
  assert_holds(scratch("target"), "made");

  /* The temporary ".part" file lies in the folder of the link's target, which may be on another file system than the
   * link. */
  pags_file_writer writer;
  assert_int_equal(pags_make_dirs(scratch("far")), PAGS_OK);
  assert_int_equal(symlink("far/away", scratch("there")), 0);
  assert_int_equal(pags_file_writer_begin(&writer, scratch("there")), PAGS_OK);
  assert_true(pags_file_exists(scratch("far/away.part")));
  assert_false(pags_path_exists(scratch("far/away")));
  pags_file_writer_abort(&writer);
  assert_false(pags_path_exists(scratch("far/away.part")));
  assert_int_equal(kind_of(scratch("there")), S_IFLNK);
}

static void a_loop_is_refused(void) {
  assert_int_equal(symlink("b", scratch("a")), 0);
  assert_int_equal(symlink("a", scratch("b")), 0);
  assert_refused(scratch("a"), "its links lead in a loop");
  assert_int_equal(kind_of(scratch("a")), S_IFLNK);
  assert_int_equal(kind_of(scratch("b")), S_IFLNK);
  assert_int_equal(symlink("itself", scratch("itself")), 0);
  assert_refused(scratch("itself"), "its links lead in a loop");
}

static void folders_and_read_only_files_are_refused(void) {
  assert_int_equal(pags_make_dirs(scratch("folder")), PAGS_OK);
  assert_int_equal(symlink("folder", scratch("to_folder")), 0);
  assert_refused(scratch("folder"), "a folder of that name exists");
  assert_refused(scratch("to_folder"), "a folder of that name exists");
  scratch_file("kept", "kept", 4);
  assert_int_equal(chmod(scratch("kept"), 0444), 0);
  assert_int_equal(symlink("kept", scratch("to_kept")), 0);
  assert_refused(scratch("kept"), "can't write: it is read-only (mode 0444)");
  assert_refused(scratch("to_kept"), "can't write: it is read-only (mode 0444)");
  assert_holds(scratch("kept"), "kept");
  assert_int_equal(kind_of(scratch("to_kept")), S_IFLNK);
  if (geteuid() == 0)
    return; /* root may write into any folder, so there is nothing to test */
  assert_int_equal(pags_make_dirs(scratch("shut")), PAGS_OK);
  assert_int_equal(chmod(scratch("shut"), 0555), 0);
  assert_int_equal(pags_file_write(scratch("shut/x"), "new", 3), PAGS_ERROR_IO);
  assert_non_null(strstr(pags_error_message(), "shut/x: can't write into its folder: Permission denied"));
  assert_int_equal(chmod(scratch("shut"), 0755), 0);
}

static void what_lies_where_the_part_file_goes_stays(void) {
  scratch_file("precious", "kept", 4);
  assert_int_equal(symlink("precious", scratch("new.part")), 0);
  assert_int_equal(pags_file_write(scratch("new"), "new", 3), PAGS_ERROR_IO);
  assert_non_null(strstr(pags_error_message(), "new.part is in the way"));
  assert_holds(scratch("precious"), "kept");
  assert_int_equal(kind_of(scratch("new.part")), S_IFLNK);
  assert_int_equal(unlink(scratch("new.part")), 0);
}

/* A thread that reads a FIFO or a socket while the test writes to it. */
typedef struct reader {
  pthread_t thread;
  int descriptor; /* a listening socket, or -1: `path` is opened */
  const char *path;
  char got[64];
} reader;

static void *read_all(void *argument) {
  reader *self = argument;
  const int from = self->descriptor >= 0 ? accept(self->descriptor, NULL, NULL) : open(self->path, O_RDONLY);
  size_t size = 0;
  for (ssize_t more = 1; from >= 0 && more > 0; size += more > 0 ? (size_t)more : 0)
    more = read(from, self->got + size, sizeof self->got - 1 - size);
  close(from);
  return NULL;
}

static void a_fifo_is_written_straight(void) {
  const char *path = scratch("fifo");
  reader self = {.descriptor = -1, .path = path};
  assert_int_equal(mkfifo(path, 0600), 0);
  assert_int_equal(pthread_create(&self.thread, NULL, read_all, &self), 0);
  assert_int_equal(pags_file_write(path, "through", 7), PAGS_OK);
  /* Checked before the thread is joined, which would block for ever if the FIFO had been replaced. */
  assert_int_equal(kind_of(path), S_IFIFO);
  assert_int_equal(pthread_join(self.thread, NULL), 0);
  assert_string_equal(self.got, "through");

  /* A reader that closes its end: SIGPIPE has its default action here and would end the process if it were raised. */
  static char much[1 << 18];
  pags_file_writer writer;
  const int from = open(path, O_RDONLY | O_NONBLOCK);
  assert_true(from >= 0);
  assert_int_equal(pags_file_writer_begin(&writer, path), PAGS_OK);
  assert_int_equal(pags_file_writer_put(&writer, "x", 1), PAGS_OK);
  close(from);
  assert_int_equal(pags_file_writer_put(&writer, much, sizeof much), PAGS_ERROR_IO);
  assert_non_null(strstr(pags_error_message(), "fifo: can't write: Broken pipe"));
  assert_null(writer.stream);
  sigset_t pending;
  sigpending(&pending);
  assert_int_equal(sigismember(&pending, SIGPIPE), 0);
  pthread_sigmask(SIG_BLOCK, NULL, &pending);
  assert_int_equal(sigismember(&pending, SIGPIPE), 0);
  assert_int_equal(kind_of(path), S_IFIFO);
  assert_false(pags_path_exists(scratch("fifo.part")));
}

static void a_socket_is_connected_to(void) {
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  const char *path = scratch("socket");
  snprintf(address.sun_path, sizeof address.sun_path, "%.*s", (int)sizeof address.sun_path - 1, path);
  reader self = {.descriptor = socket(AF_UNIX, SOCK_STREAM, 0)};
  assert_int_equal(bind(self.descriptor, (const struct sockaddr *)&address, sizeof address), 0);
  assert_refused(path, "can't write: Connection refused"); /* no process listens */
  assert_int_equal(listen(self.descriptor, 1), 0);
  assert_int_equal(pthread_create(&self.thread, NULL, read_all, &self), 0);
  assert_int_equal(pags_file_write(path, "through", 7), PAGS_OK);
  assert_int_equal(pthread_join(self.thread, NULL), 0);
  close(self.descriptor);
  assert_string_equal(self.got, "through");
  assert_int_equal(kind_of(path), S_IFSOCK);
}

/* `device` is a null device made for the test, or "" where making one isn't permitted. */
static void a_device_is_written_straight(const char *device) {
  pags_file_writer writer;
  if (!device[0])
    return;
  assert_int_equal(symlink(device, scratch("to_device")), 0);
  assert_int_equal(pags_file_write(device, "gone", 4), PAGS_OK);
  assert_int_equal(pags_file_write(scratch("to_device"), "gone", 4), PAGS_OK);
  assert_int_equal(pags_file_writer_append(&writer, device), PAGS_OK);
  assert_int_equal(pags_file_writer_put(&writer, "gone", 4), PAGS_OK);
  pags_file_writer_abort(&writer);
  assert_int_equal(kind_of(device), S_IFCHR);
  assert_int_equal(kind_of(scratch("to_device")), S_IFLNK);
}

static void a_link_to_a_descriptor_is_written_straight(void) {
  char path[64];
  int ends[2];
  char got[8] = {0};
  const int file = open(scratch_file("out", "first ", 6), O_WRONLY);
  snprintf(path, sizeof path, "/proc/self/fd/%d", file);
  if (kind_of(path) != S_IFLNK)
    return;
  assert_int_equal(pags_file_write(path, "second", 6), PAGS_OK);
  close(file);
  assert_holds(scratch("out"), "first second");
  assert_int_equal(pipe(ends), 0);
  snprintf(path, sizeof path, "/proc/self/fd/%d", ends[1]);
  assert_int_equal(pags_file_write(path, "piped", 5), PAGS_OK);
  assert_int_equal(read(ends[0], got, sizeof got), 5);
  assert_string_equal(got, "piped");
  close(ends[0]);
  close(ends[1]);
}

static void an_appended_file_keeps_what_it_holds(void) {
  pags_file_writer writer;
  assert_int_equal(symlink("log", scratch("to_log")), 0);
  for (int i = 0; i < 2; i++) {
    assert_int_equal(pags_file_writer_append(&writer, scratch("to_log")), PAGS_OK);
    assert_int_equal(pags_file_writer_put(&writer, i ? "two" : "one ", i ? 3 : 4), PAGS_OK);
    if (i) /* each write goes to the device at once */
      assert_holds(scratch("log"), "one two");
    pags_file_writer_abort(&writer);
  }
  assert_int_equal(kind_of(scratch("to_log")), S_IFLNK);
}

static void check_all(const char *device) {
  a_link_is_followed();
  a_loop_is_refused();
  folders_and_read_only_files_are_refused();
  what_lies_where_the_part_file_goes_stays();
  a_fifo_is_written_straight();
  a_socket_is_connected_to();
  a_device_is_written_straight(device);
  a_link_to_a_descriptor_is_written_straight();
  an_appended_file_keeps_what_it_holds();
}

/* Makes a null device for the test that everyone may write to; `out` is "" if this isn't permitted. Devices of the
 * system are never touched. */
static void make_device(char out[SCRATCH_PATH + 128]) {
  snprintf(out, SCRATCH_PATH + 128, "%s", scratch("device"));
  const bool made = mknod(out, S_IFCHR | 0666, makedev(1, 3)) == 0 && chmod(out, 0666) == 0;
  const int opened = made ? open(out, O_WRONLY) : -1;
  if (opened >= 0) {
    close(opened);
    return;
  }
  print_message("devices are left out: mknod isn't permitted here (%s)\n", strerror(errno));
  out[0] = 0;
}

static void special_files_are_never_replaced(void **state) {
  (void)state;
  char device[SCRATCH_PATH + 128], root[SCRATCH_PATH];
  make_device(device);
  snprintf(root, sizeof root, "%s", scratch_folder);
  alarm(60); /* a FIFO without a reader would block for ever */
  snprintf(scratch_folder, sizeof scratch_folder, "%.*s/caller", SCRATCH_PATH - 8, root);
  assert_int_equal(pags_make_dirs(scratch_folder), PAGS_OK);
  check_all(device);
  alarm(0);
  snprintf(scratch_folder, sizeof scratch_folder, "%s", root);
}

/* Runs the checks in a child process as the user nobody, since root may do what a user may not. cmocka's assertions
 * use longjmp, so the child runs its own cmocka group. */
static const char *device_of_child;

static void check_as_nobody(void **state) {
  (void)state;
  check_all(device_of_child);
}

static void a_user_replaces_no_special_file(void **state) {
  (void)state;
  char device[SCRATCH_PATH + 128], root[SCRATCH_PATH];
  if (geteuid() != 0) {
    print_message("left out: only root can become nobody; what a user may not was tried above\n");
    return;
  }
  snprintf(device, sizeof device, "%s", scratch("device"));
  snprintf(root, sizeof root, "%s", scratch_folder);
  assert_int_equal(chmod(root, 0755), 0);
  snprintf(scratch_folder, sizeof scratch_folder, "%.*s/nobody", SCRATCH_PATH - 8, root);
  assert_int_equal(mkdir(scratch_folder, 0777), 0);
  assert_int_equal(chmod(scratch_folder, 0777), 0);
  /* Mode 0644: a user could replace it by a rename in a folder of their own, but must not. */
  scratch_file("foreign", "root's", 6);
  const pid_t child = fork();
  assert_true(child >= 0);
  if (child == 0) {
    alarm(60);
    device_of_child = kind_of(device) == S_IFCHR ? device : "";
    if (setgid(65534) != 0 || setuid(65534) != 0 || access(scratch_folder, W_OK) != 0)
      _exit(77);
    if (pags_file_write(scratch("foreign"), "new", 3) != PAGS_ERROR_IO ||
        !strstr(pags_error_message(), "foreign: can't write: Permission denied"))
      _exit(3);
    const struct CMUnitTest tests[] = {cmocka_unit_test(check_as_nobody)};
    _exit(cmocka_run_group_tests_name("nobody", tests, NULL, NULL) != 0);
  }
  int status = 0;
  assert_int_equal(waitpid(child, &status, 0), child);
  const bool ended = WIFEXITED(status), tried = ended && WEXITSTATUS(status) != 77;
  if (ended && !tried)
    print_message("left out: becoming nobody isn't permitted here, or the scratch folder is shut to others\n");
  else {
    assert_true(ended);
    assert_int_equal(WEXITSTATUS(status), 0);
    assert_holds(scratch("foreign"), "root's");
  }
  snprintf(scratch_folder, sizeof scratch_folder, "%s", root);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_removed_link_keeps_its_target),
      cmocka_unit_test(special_files_are_never_replaced),
      cmocka_unit_test(a_user_replaces_no_special_file),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
