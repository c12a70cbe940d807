/* SPDX-License-Identifier: Apache-2.0 */
/* The program pags-bench: measures the engine's speed and its errors on a scene or data set of the user's. It is
 * separate from pags because its verbs `curve` and `reference` link the tests' double-precision renderer. */
#include "benchmarks/bench.h"
#include "benchmarks/verbs.h"
#include "cli/common/progress.h"
#include "cli/common/session.h"
#include "cli/draw/camera_paths.h"

#include <locale.h>
#include <pags/compose.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "port/port.h"

const char pags_program_name[] = "pags-bench";

typedef struct bench_arguments {
  pags_session session;
  const char *input;
  const char *camera, *output, *colmap, *picture;
  int views, repetitions, split_every;
  double downscale, background[3];
  int64_t iterations, snapshot_every, max_gaussians;
} bench_arguments;

#define AT(member) offsetof(bench_arguments, member)

static const pags_option scene_options[] = {
    PAGS_TEXT("camera", 0, AT(camera), "FILE", "the scene's training views, or an orbit", "measure from this camera"),
    PAGS_VALUE("views", 'n', INT, AT(views), 1, 64, "N", "pictures", NULL, "how many views to take the mean over"),
    PAGS_VALUE("repetitions", 'r', INT, AT(repetitions), 1, 1000, "N", "frames", NULL, "the best of so many counts"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(downscale), 1, 64, "F", "times", NULL, "shrink the pictures"),
    PAGS_SESSION_OPTIONS(bench_arguments),
    {0}};

static const pags_option train_options[] = {
    PAGS_OUTPUT(AT(output), "SCENE", "folder to train into; written afresh"),
    PAGS_VALUE("iterations", 'n', INT64, AT(iterations), 1, PAGS_UNLIMITED, "N", "steps", NULL, "how long to train"),
    PAGS_VALUE("snapshot-every", 0, INT64, AT(snapshot_every), 1, PAGS_UNLIMITED, "N", "steps", NULL,
               "measure held-out PSNR every so many steps; its time is not counted"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(downscale), 1, 64, "F", "times", NULL, "shrink the photographs"),
    PAGS_VALUE("split-every", 0, INT, AT(split_every), 2, 1e9, "N", "views", NULL, "hold out every Nth view"),
    PAGS_TEXT("colmap", 0, AT(colmap), "FOLDER", NULL, "take cameras and points from this COLMAP model"),
    PAGS_VALUE("max-gaussians", 0, INT64, AT(max_gaussians), 0, 2147483584.0, "N", "0: none", NULL,
               "never have more Gaussians"),
    PAGS_SESSION_OPTIONS(bench_arguments),
    {0}};

#define SCENE_POSITIONALS {{"SCENE", "a scene folder or a splat file"}}

#define SCENE_VERB(what, text) \
  {.name = what, .usage = "SCENE [options]", .about = text, .positionals = SCENE_POSITIONALS, .options = scene_options}

static const pags_verb stages_verb =
    SCENE_VERB("stages",
               "Milliseconds, nanoseconds and bytes per Gaussian, pair and pixel of each stage of a frame, "
               "forward and backward. Bytes are what the stage's data structures make it move.");
static const pags_verb roofline_verb =
    SCENE_VERB("roofline",
               "The bare blending kernel's peak and the memory's read bandwidth, and what share of the "
               "peak rasterising this scene reaches, forward and backward, on each instruction set that "
               "runs here (PAGS_CPU: on that one).");
#ifdef PAGS_WITH_REFERENCE
static const pags_option reference_options[] = {
    PAGS_OUTPUT(AT(picture), "FILE.pfm", "the picture, three channels of floats; replaced"),
    PAGS_TEXT("camera", 0, AT(camera), "FILE", "the scene's first training view, or an orbit's",
              "draw what this camera sees"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(downscale), 1, 64, "F", "times", NULL, "shrink the picture"),
    PAGS_VALUE("background", 0, COLOR, AT(background), 0, 0, "R,G,B", "sRGB, 0..1", NULL, "colour behind everything"),
    PAGS_SESSION_OPTIONS(bench_arguments),
    {0}};

static const pags_verb reference_verb = {
    .name = "reference",
    .usage = "SCENE -o FILE.pfm [options]",
    .about =
        "Draws a view by the tests' renderer in double precision, to hold the pictures of any program against. "
        "Slow: a second or more for a picture of 960x540.",
    .positionals = SCENE_POSITIONALS,
    .options = reference_options};
#endif
static const pags_verb train_verb = {
    .name = "train",
    .usage = "DATASET -o SCENE [options]",
    .about =
        "Trains and reports milliseconds by stage, held-out PSNR against seconds, when whole decibels were "
        "reached, and the roofline of what was trained.",
    .positionals = {{"DATASET", "as for pags train"}},
    .options = train_options};

/* ---- Benchmarks on a scene ---- */

/* Chooses at most `views` evenly spread cameras, downscaled. */
static pags_result choose_cameras(const bench_arguments *arguments, const pags_scene *scene, pags_camera_path *path) {
  if (arguments->camera)
    PAGS_TRY(pags_camera_path_load(arguments->camera, path));
  else if (scene->view_count > 0)
    PAGS_TRY(pags_camera_path_views(scene, path));
  else
    PAGS_TRY(pags_camera_path_orbit(scene, arguments->views, PAGS_STAND_AUTO, path));
  const int64_t wanted = path->count < arguments->views ? path->count : arguments->views;
  for (int64_t i = 0; i < wanted; i++)
    path->cameras[i] = pags_camera_downscale(&path->cameras[i * path->count / wanted], arguments->downscale);
  path->count = wanted;
  return wanted > 0 ? PAGS_OK : pags_fail(PAGS_ERROR_FORMAT, "%s: there is no view to measure from", arguments->input);
}

typedef pags_result scene_bench(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Runs one benchmark on a composed scene. All frames show the scene at the first camera's time, so that every
 * measured frame is of the same scene. */
static pags_result bench_scene(const bench_arguments *arguments, scene_bench *bench, pags_composition *composition,
                               const pags_camera_path *path) {
  const pags_part *parts;
  pags_json_writer json;
  pags_bench_view view = {.tasks = arguments->session.tasks,
                          .cameras = path->cameras,
                          .camera_count = (int)path->count,
                          .options = pags_composition_options(composition),
                          .repetitions = arguments->repetitions,
                          .picture = arguments->picture};
  for (int c = 0; c < 3 && arguments->picture; c++)
    view.options.background[c] = (float)arguments->background[c];
  view.options.early_z = PAGS_EARLY_Z_OFF; /* early-z off, so that each stage does all of its work */
  pags_compose(composition, path->cameras[0].time, &parts, &view.part_count);
  view.parts = parts;
  pags_json_writer_init(&json, 2);
  pags_json_begin_object(&json, NULL);
  pags_result result = bench(&view, arguments->session.people, &json);
  if (result == PAGS_OK)
    return pags_session_json(&arguments->session, &json);
  pags_json_writer_destroy(&json);
  return result;
}

static pags_result run_on_scene(bench_arguments *arguments, scene_bench *bench) {
  pags_scene scene;
  pags_composition *composition = NULL;
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path path = {0};
  if (arguments->picture)
    PAGS_TRY(pags_check_writable(arguments->picture));
  PAGS_TRY(pags_scene_load(arguments->input, &scene));
  pags_result result = choose_cameras(arguments, &scene, &path);
  if (result == PAGS_OK)
    result = pags_composition_create(&scene, &composition);
  else
    pags_scene_destroy(&scene);
  if (result == PAGS_OK)
    result = bench_scene(arguments, bench, composition, &path);
  pags_composition_destroy(composition);
  return result;
}

/* ---- Benchmark of the training ---- */

static pags_result run_training(bench_arguments *arguments) {
  pags_dataset_options dataset_options = pags_dataset_options_default();
  dataset_options.downscale = arguments->downscale;
  dataset_options.split_every = arguments->split_every;
  dataset_options.colmap = arguments->colmap;
  pags_dataset *dataset;
  PAGS_TRY(pags_dataset_open(arguments->input, &dataset_options, &dataset));
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = arguments->iterations;
  config.size_limit.max_gaussians = arguments->max_gaussians;
  pags_train_options options = pags_train_options_default();
  options.dataset = dataset;
  options.output = arguments->output;
  options.tasks = arguments->session.tasks;
  options.overwrite = 1;
  options.preview_every = 0;
  pags_json_writer json;
  pags_json_writer_init(&json, 2);
  pags_json_begin_object(&json, NULL);
  pags_result result = pags_bench_train(&config, &options, arguments->snapshot_every, arguments->session.people, &json);
  if (result == PAGS_OK)
    result = pags_session_json(&arguments->session, &json);
  else
    pags_json_writer_destroy(&json);
  pags_dataset_close(dataset);
  return result;
}

/* ---- The program ---- */

typedef struct bench_entry {
  const pags_verb *verb;
  scene_bench *on_scene; /* NULL: the benchmark trains instead */
  double downscale;
  int repetitions;
} bench_entry;

static int run_entry(const bench_entry *entry, int argc, char **argv) {
  bench_arguments arguments = {.views = 4,
                               .repetitions = entry->repetitions,
                               .split_every = 8,
                               .downscale = entry->downscale,
                               .iterations = 7000,
                               .snapshot_every = 250};
  pags_parsed parsed;
  pags_parse_status status = pags_options_parse(entry->verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  arguments.input = parsed.positionals[0];
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK) {
    pags_interrupt_install(arguments.session.tasks);
    result = entry->on_scene ? run_on_scene(&arguments, entry->on_scene) : run_training(&arguments);
  }
  return pags_session_end(&arguments.session, result);
}

static const bench_entry entries[] = {
    {&stages_verb, pags_bench_stages, 1, 10},
    {&roofline_verb, pags_bench_roofline, 1, 10},
    {&train_verb, NULL, 1, 10},
#ifdef PAGS_WITH_REFERENCE
    {&reference_verb, pags_bench_reference, 1, 1},
#endif
};
enum { ENTRY_COUNT = sizeof entries / sizeof entries[0] };

/* Benchmarks that parse their own options, each in a file of its own. */
static const struct own_entry {
  const char *name, *about;
  int (*run)(int argc, char **argv);
} own_entries[] = {
    {"curve", "Frame time against error, exact and to the photographs, by mode and time limit.", pags_bench_curve},
    {"render", "Frame time stage by stage, work and error of each mode; table and CSV.", pags_bench_render},
    {"scale", "Whether the time of a frame follows what is visible or what exists, to 50 million Gaussians.",
     pags_bench_scale},
    {"scaling",
     "What 1 to 256 workers would make of frames or a training, predicted from one; measured for the cores here.",
     pags_bench_scaling},
#ifdef PAGS_WITH_PROXIES
    {"proxies", "Distances of exported proxies from the true meshes of a synthetic street.", pags_bench_proxies},
#endif
};
enum { OWN_COUNT = sizeof own_entries / sizeof own_entries[0] };

static void print_help(void) {
  printf("usage: pags-bench WHAT ...\n\n");
  for (int i = 0; i < ENTRY_COUNT; i++)
    printf("  %-9s %s\n", entries[i].verb->name, entries[i].verb->about);
  for (int i = 0; i < OWN_COUNT; i++)
    printf("  %-9s %s\n", own_entries[i].name, own_entries[i].about);
  printf(
      "\n'pags-bench WHAT --help' lists its options with units and defaults. benchmarks/ablation.py trains once for "
      "each set of options and\n"
      "compares quality, size and time.\n");
#ifndef PAGS_WITH_REFERENCE
  printf(
      "'reference' is not in this build, which lacks the tests' double-precision renderer (CMake option PAGS_TESTS); "
      "'curve' compares with the mode off.\n");
#endif
#ifndef PAGS_WITH_PROXIES
  printf("'proxies' is not in this build, which lacks pags synth or pags export.\n");
#endif
}

static int run(int argc, char **argv) {
  const char *const what = argc > 1 ? argv[1] : "";
  if (!strcmp(what, "--help") || !strcmp(what, "-h")) {
    print_help();
    return PAGS_EXIT_OK;
  }
  for (int i = 0; i < ENTRY_COUNT; i++)
    if (!strcmp(what, entries[i].verb->name))
      return run_entry(&entries[i], argc - 2, argv + 2);
  for (int i = 0; i < OWN_COUNT; i++)
    if (!strcmp(what, own_entries[i].name))
      return own_entries[i].run(argc - 2, argv + 2);
  if (!strcmp(what, "error"))
    fprintf(stderr, "pags-bench: 'error' was removed; 'pags-bench curve SCENE' measures frame time against error\n");
  else
    fprintf(stderr,
            "pags-bench: expected stages, roofline, train, curve, reference, render, scale, scaling or proxies; see "
            "'pags-bench --help'\n");
  return PAGS_EXIT_USAGE;
}

int main(int argc, char **argv) {
  setlocale(LC_ALL, "C");
  pags_port_let_writes_fail();
  return pags_output_end(run(argc, argv));
}
