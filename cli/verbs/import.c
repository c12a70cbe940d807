/* SPDX-License-Identifier: Apache-2.0 */
/* pags import: converts recordings to a data set in drivestudio's layout: KITTI's and Waymo's here, others by a Python
 * package. */
#include "cli/common/progress.h"
#include "cli/common/session.h"
#include "cli/verbs/verbs.h"

#include <pags/import.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"

typedef struct import_arguments {
  pags_session session;
  const char *output;
  pags_import_options options;
  int pictures;
} import_arguments;

#define AT(member) offsetof(import_arguments, member)

static const pags_option options[] = {
    PAGS_OUTPUT(AT(output), "DATASET", "Folder for the data set."),
    PAGS_TEXT("cameras", 0, AT(options.cameras), "LIST",
              "waymo 0,1,2; kitti 0,1 if present; others: all except stereo pairs",
              "Cameras to import. waymo: 0 front, 1 front left, 2 front right, 3 side left, 4 side right; kitti: 0 "
              "image_02, 1 image_03; others: names such as ring_front_center, CAM_FRONT, front_camera."),
    PAGS_VALUE("frames", 0, SPAN, AT(options.frame_first), 0, 0, "A-B", NULL, "all",
               "Frames to import, both ends included (A-: to the end). DATASET numbers them from 0."),
    PAGS_TEXT("sequence", 0, AT(options.sequence), "NAME", "required if there are several",
              "kitti: sequence (0000), or drive of a raw recording (0001); argoverse2: log; nuscenes: scene; pandaset: "
              "sequence (002)."),
    PAGS_VALUE("pictures", 0, INT, AT(pictures), 3, 2000, "N", "photographs", "120 of a video, all of a folder",
               "photos: maximum number of photographs, well spread."),
    PAGS_FLAG("overwrite", 0, AT(options.overwrite), "Remove the files of another data set from the folder first."),
    PAGS_SESSION_OPTIONS(import_arguments),
    {0}};

typedef pags_result import_fn(const char *source, const char *folder, const pags_import_options *options,
                              pags_tasks *tasks, pags_progress_fn *progress, void *user);

static const struct kind {
  const char *name;
  import_fn *import;
} kinds[] = {{"kitti", pags_import_kitti}, {"waymo", pags_import_waymo}};
enum { KIND_COUNT = sizeof kinds / sizeof kinds[0] };

static const pags_positional positionals[] = {
    {"KIND",
     "kitti: tracking benchmark, or synchronised raw recording; waymo: segment of the Open Dataset v1; argoverse2: log "
     "of the sensor data set; nuscenes: scene of v1.0; pandaset: sequence; waymo2: segment of the Open Dataset v2 "
     "(parquet); kitti360: drive; ncore: sequence of NCore v4; photos: photographs without cameras, or a video (COLMAP "
     "finds the cameras). All except kitti and waymo run the Python package in tools/recordings."},
    {"RAW", "Folder of the recording, Waymo's .tfrecord file, or video."},
    {NULL, NULL}};

static const pags_verb verb = {
    .name = "import",
    .usage = "KIND RAW -o DATASET [options]",
    .about =
        "Convert a recording, or photographs without cameras, to a data set that 'pags train' reads. Photographs are "
        "copied unchanged. An interrupted import resumes when the same command is run again.",
    .positionals = positionals,
    .options = options};

/* ---- Report ---- */

/* Names of the counts in import.json's result, and in words. */
static const struct {
  const char *key, *one, *many;
} counts[] = {{"steps", "time step", "time steps"},
              {"cameras", "camera", "cameras"},
              {"photographs", "photograph", "photographs"},
              {"sweeps", "sweep", "sweeps"},
              {"boxes", "box", "boxes"},
              {"objects", "object", "objects"}};
enum { COUNTS = sizeof counts / sizeof counts[0] };

/* Prints which items were left out and why, as the Python importers do. */
static pags_result say_left_out(const pags_session *session, const pags_json *json, const pags_json_value *row) {
  const char *what, *why;
  const pags_json_value *which;
  int64_t count;
  PAGS_TRY(pags_json_string(json, row, "what", &what));
  PAGS_TRY(pags_json_string(json, row, "why", &why));
  PAGS_TRY(pags_json_array(json, row, "which", &which));
  PAGS_TRY(pags_json_integer(json, row, "count", 0, INT64_MAX, &count));
  const char *first = which->count ? which->first->text : NULL;
  const int shorter = count == 1 ? (strcmp(what, "boxes") == 0 ? 2 : 1) : 0;
  if (!count)
    pags_say(session, "no %s: %s\n", what, why);
  else
    pags_say(session, "left out: %lld %.*s%s%s: %s\n", (long long)count, (int)strlen(what) - shorter, what,
             !first       ? ""
             : count == 1 ? ": "
                          : ", the first is ",
             first ? first : "", why);
  return PAGS_OK;
}

/* Prints the result in import.json as a line of text and adds it to --json. */
static pags_result report_account(import_arguments *arguments, const pags_json *json, double seconds,
                                  pags_json_writer *writer) {
  const pags_json_value *result, *rows, *row;
  char words[256] = "", text[32];
  PAGS_TRY(pags_json_object(json, pags_json_root(json), "result", &result));
  for (int i = 0; i < COUNTS; i++) {
    int64_t count;
    const size_t length = strlen(words);
    PAGS_TRY(pags_json_integer(json, result, counts[i].key, 0, INT64_MAX, &count));
    pags_json_put_integer(writer, counts[i].key, count);
    snprintf(words + length, sizeof words - length, "%s%lld %s", i ? ", " : "", (long long)count,
             count == 1 ? counts[i].one : counts[i].many);
  }
  pags_say(&arguments->session, "%s: %s; imported in %s\n", arguments->output, words,
           pags_format_duration(seconds, text, sizeof text));
  PAGS_TRY(pags_json_array(json, result, "left_out", &rows));
  for (row = rows->first; row; row = row->next)
    PAGS_TRY(say_left_out(&arguments->session, json, row));
  char *raw = pags_text_format("%.*s", (int)(rows->source_end - rows->source_begin), rows->source_begin);
  if (!raw)
    return pags_out_of_memory("%s", arguments->output);
  pags_json_put_raw(writer, "left_out", raw);
  free(raw);
  return PAGS_OK;
}

/* Prints what was imported and left out, and writes the JSON. Data sets of earlier versions have no result in
 * import.json. */
static pags_result report(import_arguments *arguments, const char *kind, double seconds) {
  pags_json_writer writer;
  pags_json *json = NULL;
  char *path = pags_path_join(arguments->output, "import.json");
  pags_json_writer_init(&writer, 2);
  pags_json_begin_object(&writer, NULL);
  pags_json_put_string(&writer, "kind", kind);
  pags_json_put_string(&writer, "dataset", arguments->output);
  pags_json_put_number(&writer, "seconds", seconds);
  pags_result result = path ? pags_json_parse_file(path, &json) : pags_out_of_memory("%s", arguments->output);
  if (result == PAGS_OK && pags_json_member(pags_json_root(json), "result"))
    result = report_account(arguments, json, seconds, &writer);
  else if (result == PAGS_OK)
    pags_say(&arguments->session, "%s: is complete\n", arguments->output);
  pags_json_destroy(json);
  free(path);
  if (result == PAGS_OK)
    return pags_session_json(&arguments->session, &writer);
  pags_json_writer_destroy(&writer);
  return result;
}

static pags_result import(import_arguments *arguments, const struct kind *kind, const char *source) {
  pags_progress progress = pags_progress_begin(arguments->session.people);
  pags_interrupt_install(arguments->session.tasks);
  const double begun = pags_seconds();
  const pags_result result = kind->import(source, arguments->output, &arguments->options, arguments->session.tasks,
                                          pags_progress_watch, &progress);
  pags_progress_end(&progress);
  if (result == PAGS_CANCELLED)
    return pags_fail(result, "interrupted; the same command resumes from here");
  PAGS_TRY(result);

  return report(arguments, kind->name, pags_seconds() - begun);
}

int pags_verb_import(int argc, char **argv) {
  import_arguments arguments = {.options = pags_import_options_default()};
  const struct kind *kind = NULL;
  pags_parsed parsed;
  pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  for (int i = 0; i < KIND_COUNT; i++)
    if (!strcmp(kinds[i].name, parsed.positionals[0]))
      kind = &kinds[i];
  const bool by_python = !kind && pags_python_import_knows(parsed.positionals[0]);
  if (!kind && !by_python)
    return pags_usage_error(&verb, "KIND: expected kitti, waymo, " PAGS_PYTHON_IMPORT_KINDS ", got '%s'",
                            parsed.positionals[0]);
  if (arguments.pictures && strcmp(parsed.positionals[0], "photos"))
    return pags_usage_error(&verb, "--pictures: only for KIND photos");
  if (arguments.options.sequence && kind && kind->import == pags_import_waymo)
    return pags_usage_error(&verb, "--sequence: a Waymo segment is one sequence; give its file as RAW");
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK && by_python)
    result = pags_python_import(parsed.positionals[0], parsed.positionals[1], arguments.output, &arguments.options,
                                arguments.pictures, arguments.session.json, arguments.session.quiet != 0);
  else if (result == PAGS_OK)
    result = import(&arguments, kind, parsed.positionals[1]);
  return pags_session_end(&arguments.session, result);
}
