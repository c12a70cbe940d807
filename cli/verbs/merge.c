/* SPDX-License-Identifier: Apache-2.0 */
/* pags merge: merges the scenes of a split drive's blocks (docs/blocks.md). */
#include "cli/verbs/verbs.h"

#include <pags/blocks.h>

typedef struct merge_arguments {
  pags_session session;
  const char *output;
} merge_arguments;

static const pags_option options[] = {
    PAGS_OUTPUT(offsetof(merge_arguments, output), "SCENE", "Folder for the scene of the whole drive."),
    PAGS_SESSION_OPTIONS(merge_arguments),
    {0}};

static pags_result run(void *user, const pags_parsed *parsed) {
  const merge_arguments *arguments = user;
  const pags_session *session = &arguments->session;
  pags_merge_facts facts;
  pags_progress progress = pags_progress_begin(session->people);
  pags_interrupt_install(session->tasks);
  const pags_result result =
      pags_merge(parsed->positionals[0], arguments->output, session->tasks, pags_progress_watch, &progress, &facts);
  pags_progress_end(&progress);
  if (result == PAGS_CANCELLED)
    return pags_fail(result, "interrupted; nothing was written");
  PAGS_TRY(result);
  pags_say(session,
           "%s: %lld Gaussians of %d blocks, without %lld that imitated the view beyond their block; %lld views, %lld "
           "objects, %lld of them with a model of their own\n",
           arguments->output, (long long)facts.gaussians, facts.blocks, (long long)facts.ghosts, (long long)facts.views,
           (long long)facts.objects, (long long)facts.object_models);
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "scene", arguments->output);
  pags_json_put_integer(&json, "blocks", facts.blocks);
  pags_json_put_integer(&json, "gaussians", facts.gaussians);
  pags_json_put_integer(&json, "ghosts", facts.ghosts);
  pags_json_put_integer(&json, "views", facts.views);
  pags_json_put_integer(&json, "objects", facts.objects);
  pags_json_put_integer(&json, "object_models", facts.object_models);
  return pags_session_json(session, &json);
}

static const pags_verb verb = {
    .name = "merge",
    .usage = "BLOCKS -o SCENE [options]",
    .about =
        "Merge the scenes of all blocks. Each block contributes the Gaussians nearest to its own stretch of the drive; "
        "a moving object comes entirely from the block that sees most of it.",
    .positionals = {{"BLOCKS", "Folder written by pags split, with the scene of each block in BLOCKS/000/scene, ..."}},
    .options = options,
    .run = run};

int pags_verb_merge(int argc, char **argv) {
  merge_arguments arguments = {0};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
