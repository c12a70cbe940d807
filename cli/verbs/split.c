/* SPDX-License-Identifier: Apache-2.0 */
/* pags split: splits a long drive into blocks that are trained separately (docs/blocks.md). First it trains a small
 * scene of the whole drive, from which all blocks take their sky and mean exposure. */
#include "cli/verbs/verbs.h"

#include <pags/blocks.h>
#include <pags/train.h>
#include "base/file.h"
#include "port/port.h"

enum {
  WHOLE_WIDTH = 480, /* maximum width of photographs for the scene of the whole drive, pixels */
  WHOLE_VISITS = 4,  /* steps of its training for each photograph, within these bounds */
  WHOLE_LEAST_STEPS = 1000,
  WHOLE_MOST_STEPS = 30000,
  WHOLE_GAUSSIANS = 200000 /* at most */
};

typedef struct split_arguments {
  pags_session session;
  const char *output;
  double length, overlap;
  int reconstruction;
  pags_dataset_options dataset;
} split_arguments;

#define AT(member) offsetof(split_arguments, member)

static const pags_option options[] = {
    PAGS_OUTPUT(AT(output), "BLOCKS", "Folder for the blocks."),
    {"length", 0, true, PAGS_OPTION_DOUBLE, AT(length), 1, 1e7, "M", "metres", NULL,
     "Maximum length of a block; all blocks are equally long.", NULL},
    PAGS_VALUE("overlap", 0, DOUBLE, AT(overlap), 0, 1e6, "M", "metres", NULL,
               "Also train each block on this length of the drive before and after it."),
    PAGS_GROUP("Recording (applies to all blocks)"),
    PAGS_VALUE("split-every", 0, INT, AT(dataset.split_every), 0, 1e9, "N", NULL, "4",
               "Hold out every Nth time step; 0: none."),
    PAGS_FLAG("reconstruction", 0, AT(reconstruction), "Train on every photograph; hold out none."),
    PAGS_FLAG("allow-missing", 0, AT(dataset.allow_missing), "Skip views whose photograph or pose is missing."),
    PAGS_DRIVING_OPTIONS(AT(dataset)),
    PAGS_SESSION_OPTIONS(split_arguments),
    {0}};

/* ---- The scene of the whole drive ---- */

static int show_progress(void *user, const pags_train_progress *now) {
  pags_progress *progress = user;
  char eta[32];
  if (pags_progress_due(progress))
    pags_progress_show(progress, "the whole drive: step %lld of %lld, %.1f it/s, %lld Gaussians, PSNR %.2f dB, %s left",
                       (long long)now->step, (long long)now->iterations, now->it_per_second, (long long)now->gaussians,
                       now->psnr, pags_format_duration(now->eta_seconds, eta, sizeof eta));
  return 1;
}

/* Trains the scene of the whole drive, or resumes its training. */
static pags_result train_whole(const split_arguments *arguments, const pags_dataset *small, const char *folder) {
  int64_t training = 0;
  for (int64_t i = 0; i < pags_dataset_view_count(small); i++)
    training += !pags_dataset_view(small, i)->test;
  const int64_t steps = WHOLE_VISITS * training;
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = steps < WHOLE_LEAST_STEPS  ? WHOLE_LEAST_STEPS
                               : steps > WHOLE_MOST_STEPS ? WHOLE_MOST_STEPS
                                                          : steps;
  config.size_limit.max_gaussians = WHOLE_GAUSSIANS;
  pags_progress progress = pags_progress_begin(arguments->session.people);
  pags_train_options run = pags_train_options_default();
  const uint64_t available = pags_available_memory();
  run.image_cache = run.image_cache > available / 4 ? available / 4 : run.image_cache;
  run.dataset = small;
  run.output = folder;
  run.tasks = arguments->session.tasks;
  run.preview_every = 0;
  run.resume = 1;
  run.cancel = pags_interrupt_flag();
  run.progress = show_progress;
  run.progress_user = &progress;
  pags_interrupt_install(NULL); /* the trainer polls the flag and finishes its step before it stops */
  pags_train_result result = {0};
  const pags_result status = pags_train(&config, &run, &result);
  pags_progress_end(&progress);
  PAGS_TRY(status);
  if (!result.finished)
    return pags_fail(PAGS_CANCELLED,
                     "interrupted after step %lld of the whole drive's scene; the same command resumes it",
                     (long long)result.iterations);
  char time[32];
  pags_say(&arguments->session, "%s: %lld Gaussians after %lld steps in %s\n", folder, (long long)result.gaussians,
           (long long)result.iterations, pags_format_duration(result.seconds, time, sizeof time));
  return PAGS_OK;
}

/* Whether the folder has a finished scene. */
static pags_result find_finished(const char *folder, bool *finished) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  int64_t done, asked;
  *finished = false;
  PAGS_TRY(pags_json_parse_in_folder(folder, "scene.json", &json));
  if (!json)
    return PAGS_OK;
  const pags_json_value *root = pags_json_root(json);
  PAGS_TRY(pags_json_integer_or(json, root, "iterations", 0, INT64_MAX, 0, &done));
  PAGS_TRY(pags_json_integer_or(json, pags_json_member(root, "config"), "iterations", 0, INT64_MAX, 0, &asked));
  *finished = done >= asked;
  return PAGS_OK;
}

/* Trains the scene of the whole drive unless a finished one exists, from an earlier call or from the user. Afterwards
 * the checkpoint is deleted. `width`: of the widest photograph. */
static pags_result make_whole(const split_arguments *arguments, const char *path, int width) {
  PAGS_AUTOFREE char *folder = pags_path_join(arguments->output, "whole");
  PAGS_AUTOFREE char *checkpoint = folder ? pags_path_join(folder, "checkpoint.pags") : NULL;
  PAGS_CHECK_MEMORY(checkpoint, "a path");
  bool finished;
  PAGS_TRY(find_finished(folder, &finished));
  if (finished) {
    pags_say(&arguments->session, "%s: finished earlier, used unchanged\n", folder);
    return PAGS_OK;
  }
  PAGS_AUTO(pags_dataset_close_auto) pags_dataset *small = NULL;
  pags_dataset_options chosen = arguments->dataset;
  chosen.downscale = fmax(1, (double)width / WHOLE_WIDTH);
  PAGS_TRY(pags_dataset_open(path, &chosen, &small));
  PAGS_TRY(train_whole(arguments, small, folder));
  return pags_remove_tree(checkpoint);
}

/* ---- The verb ---- */

/* Writes split.json into a folder that is empty, or holds the same split or a scene of the whole drive. */
static pags_result begin_folder(pags_session *session, const char *folder, const pags_blocks *split) {
  bool empty;
  PAGS_TRY(pags_prepare_folder(session, folder));
  PAGS_TRY(pags_dir_is_empty(folder, &empty));
  if (pags_folder_has(folder, "split.json")) {
    PAGS_AUTO(pags_blocks_destroy) pags_blocks there = {0};
    PAGS_TRY(pags_blocks_load(folder, &there));
    if (strcmp(there.id, split->id) != 0)
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "%s: holds another split: %d blocks of %.1f m of %s; choose another folder, or remove this one",
                       folder, there.count, there.block, there.recording);
  } else if (!empty && !pags_folder_has(folder, "whole/scene.json")) {
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: not empty; expected a new folder", folder);
  }
  return pags_blocks_save(split, folder);
}

static pags_result write_json(const split_arguments *arguments, const pags_blocks *split) {
  pags_json_writer w = pags_session_json_begin();
  pags_json_put_string(&w, "split", split->id);
  pags_json_put_string(&w, "recording", split->recording);
  pags_json_put_number(&w, "length", split->length);
  pags_json_put_number(&w, "block_length", split->block);
  pags_json_put_number(&w, "overlap", split->overlap);
  pags_json_begin_array(&w, "blocks");
  for (int b = 0; b < split->count; b++) {
    const struct pags_block_range *range = &split->ranges[b];
    char name[16];
    snprintf(name, sizeof name, "%03d", b);
    pags_json_begin_object(&w, NULL);
    pags_json_put_string(&w, "name", name);
    pags_json_put_numbers(&w, "frames", (double[]){range->first, range->last}, 2);
    pags_json_put_numbers(&w, "own", (double[]){range->own_first, range->own_last}, 2);
    pags_json_end_object(&w);
  }
  pags_json_end_array(&w);
  return pags_session_json(&arguments->session, &w);
}

static int check(void *user, const pags_parsed *parsed) {
  split_arguments *arguments = user;
  if (arguments->reconstruction && pags_option_given(parsed, "split-every"))
    return pags_usage_error(parsed->verb, "--reconstruction and --split-every exclude each other");
  if (arguments->reconstruction)
    arguments->dataset.split_every = 0;
  return PAGS_EXIT_OK;
}

static pags_result run(void *user, const pags_parsed *parsed) {
  split_arguments *arguments = user;
  pags_session *session = &arguments->session;
  PAGS_AUTOFREE char *absolute = pags_port_real_path(parsed->positionals[0]); /* works from any folder */
  const char *path = absolute ? absolute : parsed->positionals[0];
  PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = NULL;
  PAGS_AUTO(pags_blocks_destroy) pags_blocks split = {0};
  PAGS_TRY(pags_dataset_open(path, &arguments->dataset, &dataset));
  PAGS_TRY(pags_blocks_plan(dataset, arguments->length, arguments->overlap, &split));
  pags_say(session, "%s: %.1f m in %d blocks of %.1f m, with %.1f m more at each end\n", pags_dataset_path(dataset),
           split.length, split.count, split.block, split.overlap);
  for (int b = 0; b < split.count; b++)
    pags_say(session, "  %03d: time steps %d to %d, trained on %d to %d\n", b, split.ranges[b].own_first,
             split.ranges[b].own_last, split.ranges[b].first, split.ranges[b].last);
  if (split.count == 1)
    pags_say(session, "one block is the whole drive: training the data set without pags split gives the same result\n");
  PAGS_TRY(pags_session_check(session));
  PAGS_TRY(begin_folder(session, arguments->output, &split));
  int width = 1;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const int wide = pags_dataset_view(dataset, i)->camera.width;
    width = wide > width ? wide : width;
  }
  PAGS_TRY(make_whole(arguments, path, width));
  PAGS_TRY(pags_blocks_write(&split, arguments->output, &arguments->dataset, "../whole"));
  pags_say(session, "next: pags train %s/000 -o %s/000/scene, and so on; then pags merge %s -o SCENE\n",
           arguments->output, arguments->output, arguments->output);
  return write_json(arguments, &split);
}

static const pags_verb verb = {
    .name = "split",
    .usage = "DATASET -o BLOCKS --length M [options]",
    .about =
        "Split a long drive into overlapping blocks BLOCKS/000, BLOCKS/001, ..., which refer to the drive's files "
        "instead of copying them. Train each one separately (pags train BLOCKS/000 -o BLOCKS/000/scene), here or on "
        "other machines, and merge the scenes with pags merge. First, a small scene of the whole drive is trained into "
        "BLOCKS/whole, which gives all blocks the same sky and exposure. Ctrl-C saves that training; the same command "
        "resumes it.",
    .positionals = {{"DATASET", "Driving set."}},
    .options = options,
    .check = check,
    .run = run};

int pags_verb_split(int argc, char **argv) {
  split_arguments arguments = {.dataset = pags_dataset_options_default(), .overlap = 50};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
