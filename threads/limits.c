/* SPDX-License-Identifier: Apache-2.0 */
/* Determines how many processors and how much memory this process may use: from the affinity mask, the physical
 * memory and the limits of its control group (cgroup).
 *
 * A limit may be set on the process's group or on any ancestor, so all are read. Inside a container /proc/self/cgroup
 * may give the path as the host sees it, while the mount shows the container's own group as the root; levels that
 * don't exist are therefore skipped, and the walk always ends at the root. Both layouts of Linux are read: version 2
 * (one tree) and version 1 (a tree per controller).
 * Source: Documentation/admin-guide/cgroup-v2.rst and cgroup-v1/memory.rst of the Linux kernel. */
#include "limits.h"

#include <pags/tasks.h>

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "port/port.h"

enum { PATH_BYTES = 4096 };

/* Reads a limit of one group from its folder `group` and lowers *limit to it. */
typedef void limit_fn(const char *group, uint64_t *limit);

/* Reads up to two numbers from the first line of group/name; returns how many there are. */
static int read_numbers(const char *group, const char *name, int64_t numbers[2]) {
  char path[PATH_BYTES], line[128];
  const int length = snprintf(path, sizeof path, "%s/%s", group, name);
  FILE *file = length > 0 && length < (int)sizeof path ? fopen(path, "r") : NULL;
  if (!file)
    return 0;
  const bool found = fgets(line, sizeof line, file) != NULL;
  fclose(file);
  return found ? sscanf(line, "%" SCNd64 " %" SCNd64, &numbers[0], &numbers[1]) : 0;
}

/* Lowers *limit to a CPU quota in whole threads, rounded up: with a quota of 1.5 processors, two threads get more
 * done than one. */
static void lower_to_quota(uint64_t *limit, int64_t quota, int64_t period) {
  const uint64_t threads = quota > 0 && period > 0 ? (uint64_t)(quota / period) + (quota % period != 0) : *limit;
  *limit = threads < *limit ? threads : *limit;
}

static void cpu_limit_v2(const char *group, uint64_t *limit) {
  int64_t numbers[2];
  if (read_numbers(group, "cpu.max", numbers) == 2)
    lower_to_quota(limit, numbers[0], numbers[1]);
}

static void cpu_limit_v1(const char *group, uint64_t *limit) {
  int64_t quota[2], period[2];
  if (read_numbers(group, "cpu.cfs_quota_us", quota) > 0 && read_numbers(group, "cpu.cfs_period_us", period) > 0)
    lower_to_quota(limit, quota[0], period[0]);
}

static void memory_limit_from(const char *group, const char *name, uint64_t *limit) {
  int64_t bytes[2];
  if (read_numbers(group, name, bytes) > 0 && (uint64_t)bytes[0] < *limit)
    *limit = (uint64_t)bytes[0];
}

/* memory.high counts as a limit, too, since the kernel throttles a group that exceeds it until it makes no
 * progress. */
static void memory_limit_v2(const char *group, uint64_t *limit) {
  memory_limit_from(group, "memory.max", limit);
  memory_limit_from(group, "memory.high", limit);
}

static void memory_limit_v1(const char *group, uint64_t *limit) {
  memory_limit_from(group, "memory.limit_in_bytes", limit);
}

/* Applies `read` to mount/path and every ancestor down to `mount` itself. */
static void walk_up(const char *root, const char *mount, const char *path, limit_fn *read, uint64_t *limit) {
  char group[PATH_BYTES];
  int length = snprintf(group, sizeof group, "%s/sys/fs/cgroup%s%s", root, mount, path);
  if (length < 0 || length >= (int)sizeof group)
    return;
  size_t mount_length = strlen(root) + strlen("/sys/fs/cgroup") + strlen(mount);
  for (;;) {
    read(group, limit);
    char *slash = strrchr(group + mount_length, '/');
    if (!slash)
      return;
    *slash = '\0';
  }
}

static bool list_has(const char *list, const char *name) {
  size_t length = strlen(name);
  for (const char *at = list; at; at = strchr(at, ',')) {
    at += *at == ',';
    if (strncmp(at, name, length) == 0 && (at[length] == ',' || at[length] == '\0'))
      return true;
  }
  return false;
}

/* Applies the limits that a line "id:controllers:path" of /proc/self/cgroup leads to; version 2 has no
 * controllers. */
static void apply_line(const char *root, char *line, const char *controller, limit_fn *v1, limit_fn *v2,
                       uint64_t *limit) {
  line[strcspn(line, "\n")] = '\0';
  char *controllers = strchr(line, ':');
  char *path = controllers ? strchr(controllers + 1, ':') : NULL;
  if (!path)
    return;
  ++controllers;
  *path++ = '\0';
  if (controllers[0] == '\0') {
    walk_up(root, "", path, v2, limit);
    walk_up(root, "/unified", path, v2, limit);
  } else if (list_has(controllers, controller)) {
    /* The folder is named by all controllers of the tree ("cpu,cpuacct"); single names may be links to it. */
    char mount[256];
    int length = snprintf(mount, sizeof mount, "/%s", controllers);
    if (length > 0 && length < (int)sizeof mount)
      walk_up(root, mount, path, v1, limit);
    snprintf(mount, sizeof mount, "/%s", controller);
    walk_up(root, mount, path, v1, limit);
  }
}

static uint64_t cgroup_limit(const char *root, const char *controller, limit_fn *v1, limit_fn *v2, uint64_t ceiling) {
  char path[PATH_BYTES];
  int length = snprintf(path, sizeof path, "%s/proc/self/cgroup", root);
  if (length < 0 || length >= (int)sizeof path)
    return ceiling;
  FILE *file = fopen(path, "r");
  if (!file)
    return ceiling;
  uint64_t limit = ceiling;
  char line[PATH_BYTES];
  while (fgets(line, sizeof line, file))
    apply_line(root, line, controller, v1, v2, &limit);
  fclose(file);
  return limit;
}

int pags_cgroup_threads(const char *root, int ceiling) {
  return (int)cgroup_limit(root, "cpu", cpu_limit_v1, cpu_limit_v2, (uint64_t)ceiling);
}

uint64_t pags_cgroup_memory(const char *root, uint64_t ceiling) {
  return cgroup_limit(root, "memory", memory_limit_v1, memory_limit_v2, ceiling);
}

int pags_available_threads(void) {
  return pags_cgroup_threads("", pags_port_processors());
}

uint64_t pags_available_memory(void) {
  return pags_cgroup_memory("", pags_port_physical_memory());
}
