/* SPDX-License-Identifier: Apache-2.0 */
/* train DATASET SCENE STEPS: trains a scene on a data set and prints its progress after each tenth of the steps. */
#include <inttypes.h>
#include <stdio.h>

#include <pags/train.h>

/* Called after every step. Returning 0 stops the training; its checkpoint and its scene are still written. */
static int print_progress(void *user, const pags_train_progress *progress) {
  (void)user;
  if (progress->step * 10 % progress->iterations < 10)
    printf("step %" PRId64 " of %" PRId64 ": %" PRId64 " Gaussians, %.1f dB\n", progress->step, progress->iterations,
           progress->gaussians, progress->psnr);
  return 1;
}

int main(int argc, char **argv) {
  if (argc < 4)
    return fprintf(stderr, "usage: train DATASET SCENE STEPS\n"), 1;
  pags_tasks *tasks = pags_tasks_create(0);
  pags_dataset *dataset = NULL;
  const pags_dataset_options reading = pags_dataset_options_default();
  if (!tasks || pags_dataset_open(argv[1], &reading, &dataset))
    return fprintf(stderr, "train: %s\n", pags_error_message()), 1;

  pags_train_config config = pags_train_config_default();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.dataset = dataset;
  options.output = argv[2];
  options.tasks = tasks;
  options.progress = print_progress;
  if (pags_train_config_set(&config, "iterations", argv[3]) || pags_train(&config, &options, &result))
    return fprintf(stderr, "train: %s\n", pags_error_message()), 1;
  printf("%s: %" PRId64 " Gaussians after %" PRId64 " steps\n", argv[2], result.gaussians, result.iterations);
  pags_dataset_close(dataset);
  pags_tasks_destroy(tasks);
  return 0;
}
