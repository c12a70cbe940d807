/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the detection of processor and memory limits, from file trees laid out like Linux's /proc and /sys. */
#include <pags/tasks.h>
#include "threads/limits.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "system.h"

enum { PATH_BYTES = 512 };

/* A root folder for each test; the list of its files is used to remove them. */
typedef struct tree {
  char root[200];
  char made[64][PATH_BYTES];
  int count;
} tree;

static int make_tree(void **state) {
  tree *t = calloc(1, sizeof *t);
  *state = t;
  return system_make_scratch(t->root, sizeof t->root) ? 0 : -1;
}

static int remove_tree(void **state) {
  tree *t = *state;
  while (t->count > 0)
    if (!pags_port_remove_file(t->made[--t->count]))
      pags_port_remove_folder(t->made[t->count]);
  int result = pags_port_remove_folder(t->root) ? 0 : -1;
  free(t);
  return result;
}

static void note_made(tree *t, const char *path) {
  assert_true(t->count < 64);
  snprintf(t->made[t->count++], PATH_BYTES, "%s", path);
}

static void put(tree *t, const char *name, const char *text) {
  char path[PATH_BYTES];
  snprintf(path, sizeof path, "%s/%s", t->root, name);
  for (char *at = path + strlen(t->root) + 1; (at = strchr(at, '/')) != NULL; *at++ = '/') {
    *at = '\0';
    if (pags_port_make_folder(path))
      note_made(t, path);
  }
  FILE *file = pags_port_open(path, "wb");
  assert_non_null(file);
  fputs(text, file);
  fclose(file);
  note_made(t, path);
}

static void no_files_no_limit(void **state) {
  tree *t = *state;
  assert_int_equal(pags_cgroup_threads(t->root, 12), 12);
  assert_int_equal(pags_cgroup_memory(t->root, 1000), 1000);
}

static void version_2_takes_the_smallest_of_all_ancestors(void **state) {
  tree *t = *state;
  put(t, "proc/self/cgroup", "0::/outer/inner/leaf\n");
  put(t, "sys/fs/cgroup/outer/cpu.max", "300000 100000\n");
  put(t, "sys/fs/cgroup/outer/inner/cpu.max", "max 100000\n");
  put(t, "sys/fs/cgroup/outer/inner/leaf/cpu.max", "800000 100000\n");
  put(t, "sys/fs/cgroup/outer/memory.max", "max\n");
  put(t, "sys/fs/cgroup/outer/inner/memory.max", "5000000000\n");
  put(t, "sys/fs/cgroup/outer/inner/leaf/memory.high", "4000000000\n");
  assert_int_equal(pags_cgroup_threads(t->root, 12), 3);
  assert_int_equal(pags_cgroup_threads(t->root, 2), 2);
  assert_true(pags_cgroup_memory(t->root, UINT64_MAX) == 4000000000u);
  assert_true(pags_cgroup_memory(t->root, 1000) == 1000);
}

static void part_of_a_processor_counts_as_one(void **state) {
  tree *t = *state;
  put(t, "proc/self/cgroup", "0::/\n");
  put(t, "sys/fs/cgroup/cpu.max", "10000 100000\n");
  assert_int_equal(pags_cgroup_threads(t->root, 12), 1);
  put(t, "sys/fs/cgroup/cpu.max", "150000 100000\n");
  assert_int_equal(pags_cgroup_threads(t->root, 12), 2);
}

static void version_1_finds_the_controller_among_others(void **state) {
  tree *t = *state;
  put(t, "proc/self/cgroup", "12:cpuset:/box\n5:cpu,cpuacct:/box/in\n4:memory:/box\n1:name=systemd:/box\n0::/box\n");
  /* This limit is in another controller's folder, so it doesn't count. */
  put(t, "sys/fs/cgroup/cpuset/cpu.cfs_quota_us", "100000\n");
  put(t, "sys/fs/cgroup/cpuset/cpu.cfs_period_us", "100000\n");
  put(t, "sys/fs/cgroup/cpu,cpuacct/box/cpu.cfs_quota_us", "400000\n");
  put(t, "sys/fs/cgroup/cpu,cpuacct/box/cpu.cfs_period_us", "100000\n");
  put(t, "sys/fs/cgroup/cpu,cpuacct/box/in/cpu.cfs_quota_us", "-1\n");
  put(t, "sys/fs/cgroup/cpu,cpuacct/box/in/cpu.cfs_period_us", "100000\n");
  put(t, "sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  put(t, "sys/fs/cgroup/memory/box/memory.limit_in_bytes", "2147483648\n");
  assert_int_equal(pags_cgroup_threads(t->root, 12), 4);
  assert_true(pags_cgroup_memory(t->root, UINT64_MAX) == 2147483648u);
}

static void a_container_sees_its_own_group_as_the_root(void **state) {
  tree *t = *state;
  put(t, "proc/self/cgroup", "3:cpu:/docker/0123456789ab\n2:memory:/docker/0123456789ab\n");
  put(t, "sys/fs/cgroup/cpu/cpu.cfs_quota_us", "200000\n");
  put(t, "sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  put(t, "sys/fs/cgroup/memory/memory.limit_in_bytes", "1073741824\n");
  assert_int_equal(pags_cgroup_threads(t->root, 12), 2);
  assert_true(pags_cgroup_memory(t->root, UINT64_MAX) == 1073741824u);
}

static void nonsense_is_passed_over(void **state) {
  tree *t = *state;
  put(t, "proc/self/cgroup", "\n0\n::\nnothing:here\n0::/x\n");
  put(t, "sys/fs/cgroup/x/cpu.max", "lots of them\n");
  put(t, "sys/fs/cgroup/x/memory.max", "");
  put(t, "sys/fs/cgroup/cpu.max", "0 0\n");
  assert_int_equal(pags_cgroup_threads(t->root, 12), 12);
  assert_true(pags_cgroup_memory(t->root, 1000) == 1000);
}

static void this_machine_has_limits(void **state) {
  (void)state;
  assert_true(pags_available_threads() >= 1);
  assert_true(pags_available_memory() > 1 << 20);
}

#define WITH_TREE(test) cmocka_unit_test_setup_teardown(test, make_tree, remove_tree)

int main(void) {
  const struct CMUnitTest tests[] = {
      WITH_TREE(no_files_no_limit),
      WITH_TREE(version_2_takes_the_smallest_of_all_ancestors),
      WITH_TREE(part_of_a_processor_counts_as_one),
      WITH_TREE(version_1_finds_the_controller_among_others),
      WITH_TREE(a_container_sees_its_own_group_as_the_root),
      WITH_TREE(nonsense_is_passed_over),
      cmocka_unit_test(this_machine_has_limits),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
