/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the limits of the process's control group (cgroup) on threads and memory, below a given root folder, so that
 * tests can use files of their own. */
#ifndef PAGS_THREADS_LIMITS_H
#define PAGS_THREADS_LIMITS_H

#include <stdint.h>

/* `root` is "" for the machine itself; the files read are ROOT/proc/self/cgroup and those below ROOT/sys/fs/cgroup.
 * Each returns the smallest limit of the process's group and its ancestors, or `ceiling` where none is smaller. */
int pags_cgroup_threads(const char *root, int ceiling);
uint64_t pags_cgroup_memory(const char *root, uint64_t ceiling);

#endif
