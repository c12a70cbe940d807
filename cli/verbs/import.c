/* SPDX-License-Identifier: Apache-2.0 */
/* pags import: converts recordings to a data set in drivestudio's layout: KITTI's and Waymo's here, others by a Python
 * package. */
#include "cli/verbs/verbs.h"

#include <pags/import.h>

#include "base/file.h"
#include "base/text.h"
#include "port/port.h"

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
  import_fn *import; /* NULL: by the Python package pags_recordings (tools/recordings) */
} kinds[] = {{"kitti", pags_import_kitti},
             {"waymo", pags_import_waymo},
             {"argoverse2", NULL},
             {"nuscenes", NULL},
             {"pandaset", NULL},
             {"waymo2", NULL},
             {"kitti360", NULL},
             {"ncore", NULL},
             {"photos", NULL}};

static const struct kind *find_kind(const char *name) {
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (!strcmp(kinds[i].name, name))
      return &kinds[i];
  return NULL;
}

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
static pags_result report_account(const import_arguments *arguments, const pags_json *json, double seconds,
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
  PAGS_AUTOFREE char *raw = pags_text_format("%.*s", (int)(rows->source_end - rows->source_begin), rows->source_begin);
  PAGS_CHECK_MEMORY(raw, "%s", arguments->output);
  pags_json_put_raw(writer, "left_out", raw);
  return PAGS_OK;
}

/* Prints what was imported and left out, and writes the JSON. Data sets of earlier versions have no result in
 * import.json. */
static pags_result report(const import_arguments *arguments, const char *kind, double seconds) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = pags_session_json_begin();
  pags_json_put_string(&writer, "kind", kind);
  pags_json_put_string(&writer, "dataset", arguments->output);
  pags_json_put_number(&writer, "seconds", seconds);
  PAGS_AUTOFREE char *path = pags_path_join(arguments->output, "import.json");
  PAGS_CHECK_MEMORY(path, "%s", arguments->output);
  PAGS_TRY(pags_json_parse_file(path, &json));
  if (pags_json_member(pags_json_root(json), "result"))
    PAGS_TRY(report_account(arguments, json, seconds, &writer));
  else
    pags_say(&arguments->session, "%s: is complete\n", arguments->output);
  return pags_session_json(&arguments->session, &writer);
}

/* ---- Imports by Python ---- */

#ifdef _WIN32
static const char python[] = "python";
static const char own_python[] = "/.venv/Scripts/python.exe";
#else
static const char python[] = "python3";
static const char own_python[] = "/.venv/bin/python";
#endif

/* Runs the installed package if its version matches. */
static const char installed[] =
    "import sys\n"
    "sys.path[:] = [p for p in sys.path if p]\n"
    "try:\n"
    "  from pags_recordings import __version__\n"
    "  from pags_recordings.__main__ import main\n"
    "except ImportError:\n"
    "  sys.exit('pags: importing ' + sys.argv[1] + ' needs the Python package pags-recordings ' + '" PAGS_VERSION_STRING
    "' + ', which is expected in ../share/pags/recordings relative to this program, or installed for ' + "
    "sys.executable)\n"
    "if __version__ != '" PAGS_VERSION_STRING
    "':\n"
    "  sys.exit('pags: the Python package pags-recordings is of version ' + __version__ + ', this program is ' + "
    "'" PAGS_VERSION_STRING
    "' + '; install that one')\n"
    "sys.exit(main())\n";

/* Finds the package next to the program: installed, or in the source tree of a build. */
static char *find_beside(void) {
  static const char *const places[] = {"../share/pags/recordings", "../tools/recordings"};
  char folder[4096];
  if (!pags_port_program_folder(folder, sizeof folder))
    return NULL;
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    PAGS_AUTOFREE char *path = pags_text_format("%s/%s", folder, places[i]);
    if (path && pags_folder_has(path, "run.py"))
      return pags_take(&path);
  }
  return NULL;
}

/* The words of a command. */
typedef struct python_call {
  const char *words[24];
  int count;
} python_call;

static void add_word(python_call *call, const char *word) {
  if (word)
    call->words[call->count++] = word;
}

static void add_option(python_call *call, const char *name, const char *value) {
  add_word(call, value ? name : NULL);
  add_word(call, value);
}

/* Replaces this program by the package's: the one next to this program, or the installed one of the same version. It
 * isn't looked for in the working directory: a file of the package is started by its path, or that directory is removed
 * from Python's path. Returns only if it can't be started: PAGS_ERROR_UNSUPPORTED with the remedy, PAGS_ERROR_MEMORY.
 */
static pags_result import_by_python(const import_arguments *arguments, const char *kind, const char *source) {
  const pags_import_options *chosen = &arguments->options;
  char last[24] = "", frames[64], pictures[16];
  python_call call = {.count = 0};
  PAGS_AUTOFREE char *beside = find_beside();
  PAGS_AUTOFREE char *script = beside ? pags_path_join(beside, "run.py") : NULL;
  PAGS_AUTOFREE char *own = beside ? pags_text_format("%s%s", beside, own_python) : NULL;
  PAGS_CHECK_MEMORY(!beside || (script && own), "the path of run.py");
  add_word(&call, own && pags_file_exists(own) ? own : python);
  add_word(&call, script ? script : "-c");
  add_word(&call, script ? NULL : installed);
  add_word(&call, kind);
  add_word(&call, source);
  add_option(&call, "--output", arguments->output);
  add_option(&call, "--cameras", chosen->cameras);
  if (chosen->frame_last >= 0)
    snprintf(last, sizeof last, "%lld", (long long)chosen->frame_last);
  snprintf(frames, sizeof frames, "%lld-%s", (long long)chosen->frame_first, last);
  add_option(&call, "--frames", chosen->frame_first > 0 || *last ? frames : NULL);
  add_option(&call, "--sequence", chosen->sequence);
  snprintf(pictures, sizeof pictures, "%d", arguments->pictures);
  add_option(&call, "--pictures", arguments->pictures > 0 ? pictures : NULL);
  add_word(&call, chosen->overwrite ? "--overwrite" : NULL);
  add_option(&call, "--json", arguments->session.json);
  add_word(&call, arguments->session.quiet ? "--quiet" : NULL);
  fflush(NULL);
  pags_port_set_environment("PAGS_RECORDINGS_FOR", "pags");
  pags_port_become(call.words);
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "importing %s needs Python: %s can't be started; install Python 3.9 or later and its packages "
                   "numpy, pillow, pandas and pyarrow",
                   kind, call.words[0]);
}

/* ---- The verb ---- */

static int check(void *user, const pags_parsed *parsed) {
  const import_arguments *arguments = user;
  const struct kind *kind = find_kind(parsed->positionals[0]);
  if (!kind)
    return pags_usage_error(
        parsed->verb,
        "KIND: expected kitti, waymo, argoverse2, nuscenes, pandaset, waymo2, kitti360, ncore or photos, got '%s'",
        parsed->positionals[0]);
  if (arguments->pictures && strcmp(kind->name, "photos"))
    return pags_usage_error(parsed->verb, "--pictures: only for KIND photos");
  if (arguments->options.sequence && kind->import == pags_import_waymo)
    return pags_usage_error(parsed->verb, "--sequence: a Waymo segment is one sequence; give its file as RAW");
  return PAGS_EXIT_OK;
}

static pags_result run(void *user, const pags_parsed *parsed) {
  const import_arguments *arguments = user;
  const pags_session *session = &arguments->session;
  const struct kind *kind = find_kind(parsed->positionals[0]);
  if (!kind->import)
    return import_by_python(arguments, kind->name, parsed->positionals[1]);
  pags_progress progress = pags_progress_begin(session->people);
  pags_interrupt_install(session->tasks);
  const double begun = pags_seconds();
  const pags_result result = kind->import(parsed->positionals[1], arguments->output, &arguments->options,
                                          session->tasks, pags_progress_watch, &progress);
  pags_progress_end(&progress);
  if (result == PAGS_CANCELLED)
    return pags_fail(result, "interrupted; the same command resumes from here");
  PAGS_TRY(result);
  return report(arguments, kind->name, pags_seconds() - begun);
}

static const pags_verb verb = {
    .name = "import",
    .usage = "KIND RAW -o DATASET [options]",
    .about =
        "Convert a recording, or photographs without cameras, to a data set that 'pags train' reads. Photographs are "
        "copied unchanged. An interrupted import resumes when the same command is run again.",
    .positionals = {{"KIND",
                     "kitti: tracking benchmark, or synchronised raw recording; waymo: segment of the Open Dataset v1; "
                     "argoverse2: log of the sensor data set; nuscenes: scene of v1.0; pandaset: sequence; waymo2: "
                     "segment of the Open Dataset v2 (parquet); kitti360: drive; ncore: sequence of NCore v4; photos: "
                     "photographs without cameras, or a video (COLMAP finds the cameras). All except kitti and waymo "
                     "run the Python package in tools/recordings."},
                    {"RAW", "Folder of the recording, Waymo's .tfrecord file, or video."}},
    .options = options,
    .check = check,
    .run = run};

int pags_verb_import(int argc, char **argv) {
  import_arguments arguments = {.options = pags_import_options_default()};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
