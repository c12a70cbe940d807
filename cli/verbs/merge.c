/* SPDX-License-Identifier: Apache-2.0 */
/* pags merge: merges the scenes of a split drive's blocks (docs/blocks.md). */
#include "cli/common/progress.h"
#include "cli/common/session.h"
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

static const pags_positional positionals[] = {
    {"BLOCKS", "Folder written by pags split, with the scene of each block in BLOCKS/000/scene, ..."}, {NULL, NULL}};

static const pags_verb verb = {
    .name = "merge",
    .usage = "BLOCKS -o SCENE [options]",
    .about =
        "Merge the scenes of all blocks. Each block contributes the Gaussians nearest to its own stretch of the drive; "
        "a moving object comes entirely from the block that sees most of it.",
    .positionals = positionals,
    .options = options};

static pags_result merge(merge_arguments *arguments, const char *folder) {
  pags_merge_facts facts;
  pags_progress progress = pags_progress_begin(arguments->session.people);
  pags_interrupt_install(arguments->session.tasks);
  const pags_result result =
      pags_merge(folder, arguments->output, arguments->session.tasks, pags_progress_watch, &progress, &facts);
  pags_progress_end(&progress);
  if (result == PAGS_CANCELLED)
    return pags_fail(result, "interrupted; nothing was written");
  PAGS_TRY(result);
  pags_say(&arguments->session,
           "%s: %lld Gaussians of %d blocks, without %lld that imitated the view beyond their block; %lld views, %lld "
           "objects, %lld of them with a model of their own\n",
           arguments->output, (long long)facts.gaussians, facts.blocks, (long long)facts.ghosts, (long long)facts.views,
           (long long)facts.objects, (long long)facts.object_models);
  pags_json_writer w;
  pags_json_writer_init(&w, 2);
  pags_json_begin_object(&w, NULL);
  pags_json_put_string(&w, "scene", arguments->output);
  pags_json_put_integer(&w, "blocks", facts.blocks);
  pags_json_put_integer(&w, "gaussians", facts.gaussians);
  pags_json_put_integer(&w, "ghosts", facts.ghosts);
  pags_json_put_integer(&w, "views", facts.views);
  pags_json_put_integer(&w, "objects", facts.objects);
  pags_json_put_integer(&w, "object_models", facts.object_models);
  return pags_session_json(&arguments->session, &w);
}

int pags_verb_merge(int argc, char **argv) {
  merge_arguments arguments = {0};
  pags_parsed parsed;
  const pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK)
    result = merge(&arguments, parsed.positionals[0]);
  return pags_session_end(&arguments.session, result);
}
