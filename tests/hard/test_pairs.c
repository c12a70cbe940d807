/* SPDX-License-Identifier: Apache-2.0 */
/* Case 11 of docs/lab/numerics.md: there are more pairs of Gaussian and tile than 32 bits can count. */
#include "hard/hard.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

enum { NO_LIMIT = 77 }; /* exit code of the child: it got more memory than its limit */

/* Rows that each cover all of 1024 tiles, more than 2^31 pairs in total, whose lists would take 32 GiB. Runs in
 * a child process limited to 1 GiB. */
static int overflow_in_child(void) {
  enum { ROWS = 2100000 };
  const pags_camera camera = {.width = 512,
                              .height = 512,
                              .fx = 512,
                              .fy = 512,
                              .cx = 256,
                              .cy = 256,
                              .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  pags_frame_options options = pags_frame_options_default();
  pags_tasks *tasks = pags_tasks_create(2);
  pags_gaussians g;
  pags_clusters clusters;
  pags_frame *frame;
  pags_picture picture;
  if (!tasks || pags_gaussians_create(&g, ROWS, 0) != PAGS_OK || pags_clusters_create(&clusters, ROWS, 64) != PAGS_OK ||
      pags_frame_create(tasks, &frame) != PAGS_OK)
    return 2;
  for (int64_t i = 0; i < ROWS; i++) {
    pags_plane(&g, PAGS_MEAN + 2)[i] = 1.0f + 1e-6f * (float)i;
    for (int k = 0; k < 3; k++)
      pags_plane(&g, PAGS_SCALE + k)[i] = 3.0f;
    pags_plane(&g, PAGS_ROTATION)[i] = 1.0f;
  }
  pags_clusters_update(&clusters, &g, 0, clusters.count);
  const pags_part part = {
      .gaussians = &g, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const pags_result result = pags_frame_render(frame, &part, 1, &camera, &options, NULL, NULL, &picture);
  if (result != PAGS_ERROR_MEMORY || !strstr(pags_error_message(), "2150400000"))
    return 3;
  options.near_plane = 100.0f; /* after the error the frame can be used again */
  return pags_frame_render(frame, &part, 1, &camera, &options, NULL, NULL, &picture) == PAGS_OK ? 0 : 4;
}

static void more_pairs_than_32_bits(void **state) {
  (void)state;
  if (hard_leaves_out()) /* the scalar kernels take minutes to count 2^31 pairs */
    return;
  int status = 0;
  const pid_t child = fork();
  assert_true(child >= 0);
  if (child == 0) {
    const struct rlimit most = {(rlim_t)1 << 30, (rlim_t)1 << 30};
    if (setrlimit(RLIMIT_AS, &most) != 0)
      _exit(1);
    void *volatile more = malloc((size_t)1 << 31);
    _exit(more ? NO_LIMIT : overflow_in_child());
  }
  assert_int_equal(waitpid(child, &status, 0), child);
  assert_true(WIFEXITED(status));
  if (WEXITSTATUS(status) == NO_LIMIT) {
    printf("skipped: a limit on memory doesn't hold here, as under qemu-user\n");
    skip();
  }
  assert_int_equal(WEXITSTATUS(status), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(more_pairs_than_32_bits)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
