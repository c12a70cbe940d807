/* SPDX-License-Identifier: Apache-2.0 */
/* pags report: writes an HTML report of a scene, or of two scenes side by side. */
#include "cli/html_report/html_report.h"
#include "cli/measure/view_scores.h"
#include "cli/verbs/verbs.h"

#include "base/file.h"
#include "base/text.h"
#include "eval/metric.h"

typedef struct report_arguments {
  pags_session session;
  const char *output, *lpips_weights;
  int64_t pictures;
  const char *dataset;
  pags_dataset_options dataset_options;
} report_arguments;

#define AT(member) offsetof(report_arguments, member)

static const pags_option options[] = {
    PAGS_TEXT("output", 'o', AT(output), "FILE", "SCENE/report.html", "Output file; required for two scenes."),
    PAGS_VALUE("views", 0, INT64, AT(pictures), 0, 1000, "N", "views", NULL,
               "Number of held-out views shown as pictures, evenly spaced; all are measured."),

    PAGS_TEXT("lpips-weights", 0, AT(lpips_weights), "FILE|none", "AlexNet's, if installed", "As for eval."),

    PAGS_GROUP("Photographs"),
    PAGS_TEXT("dataset", 0, AT(dataset), "DATASET", "as stored in the scene",
              "Compare with the photographs of this data set."),
    PAGS_TEXT("colmap", 0, AT(dataset_options.colmap), "FOLDER", NULL,
              "With --dataset: read cameras from this COLMAP model."),
    PAGS_TEXT("image-folder", 0, AT(dataset_options.image_folder), "FOLDER", "as in training",
              "Read the photographs from this folder."),

    PAGS_GROUP("Driving sets, as for train"),
    PAGS_DRIVING_OPTIONS(AT(dataset_options)),
    PAGS_SESSION_OPTIONS(report_arguments),
    {0}};

/* Returns the folder of a scene.json; a copy of any other path. */
static char *folder_of(const char *path) {
  return !strcmp(pags_path_name(path), "scene.json") && pags_file_exists(path) ? pags_path_folder(path)
                                                                               : pags_text_copy(path);
}

static int check(void *user, const pags_parsed *parsed) {
  const report_arguments *arguments = user;
  const pags_option_rule rules[] = {{"colmap", arguments->dataset != NULL, "--dataset"}, {0}};
  if (pags_options_check_effect(parsed, rules))
    return PAGS_EXIT_USAGE;
  if (parsed->positionals[1] && !arguments->output)
    return pags_usage_error(parsed->verb, "two scenes: expected -o FILE, the page to write");
  return PAGS_EXIT_OK;
}

static pags_result run(void *user, const pags_parsed *parsed) {
  report_arguments *arguments = user;
  pags_session *session = &arguments->session;
  const int count = parsed->positionals[1] ? 2 : 1;
  PAGS_AUTOFREE char *first = folder_of(parsed->positionals[0]);
  PAGS_AUTOFREE char *second = count == 2 ? folder_of(parsed->positionals[1]) : NULL;
  PAGS_CHECK_MEMORY(first && (second || count == 1), "a path");
  PAGS_AUTO(pags_lpips_destroy_auto) pags_lpips *lpips = NULL;
  PAGS_TRY(pags_view_lpips_load(arguments->lpips_weights, &lpips));
  pags_html_report_facts facts[2] = {{0}};
  pags_progress progress = pags_progress_begin(session->people);
  const pags_html_report_settings settings = {.scenes = {first, second},
                                              .count = count,
                                              .dataset = arguments->dataset,
                                              .dataset_options = arguments->dataset_options,
                                              .pictures = arguments->pictures,
                                              .session = session,
                                              .progress = &progress,
                                              .lpips = lpips,
                                              .cancel = pags_interrupt_flag()};
  if (!arguments->output && !pags_dir_exists(first))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: %s; expected a scene folder, or -o FILE", first,
                     pags_path_exists(first) ? "a file, not a folder" : "no such folder");
  PAGS_AUTOFREE char *output =
      arguments->output ? pags_text_copy(arguments->output) : pags_path_join(first, "report.html");
  PAGS_CHECK_MEMORY(output, "a path");
  PAGS_TRY(pags_prepare_file(session, output));
  pags_interrupt_install(session->tasks);
  const pags_result result = pags_html_report_write(&settings, output, facts);
  pags_progress_end(&progress);
  if (result != PAGS_OK && pags_interrupted())
    return pags_fail(PAGS_CANCELLED, "interrupted; %s wasn't written", output);
  PAGS_TRY(result);
  for (int k = 0; k < count; k++)
    pags_say(session, "%s: %lld of %lld views measured, %lld shown\n", settings.scenes[k], (long long)facts[k].measured,
             (long long)facts[k].views, (long long)facts[k].pictures);
  pags_say(session, "%s\n", output);
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "report", output);
  pags_json_begin_array(&json, "scenes");
  for (int k = 0; k < count; k++) {
    pags_json_begin_object(&json, NULL);
    pags_json_put_string(&json, "scene", settings.scenes[k]);
    pags_json_put_integer(&json, "views", facts[k].views);
    pags_json_put_integer(&json, "measured", facts[k].measured);
    pags_json_put_integer(&json, "pictures", facts[k].pictures);
    pags_json_put_number(&json, "psnr", facts[k].psnr);
    pags_json_put_number(&json, "ssim", facts[k].ssim);
    pags_json_put_number(&json, "lpips", facts[k].lpips);
    pags_json_end_object(&json);
  }
  pags_json_end_array(&json);
  return pags_session_json(session, &json);
}

static const pags_verb verb = {
    .name = "report",
    .usage = "SCENE [OTHER] [-o FILE] [options]",
    .about =
        "Write one HTML page without scripts or other files: figures and curves of the training, held-out views "
        "(photograph, rendering, error), classes and objects, how each object was modelled, histograms, time per "
        "stage, command line. Two scenes are shown side by side. The page names missing inputs, such as the log or the "
        "photographs.",
    .positionals = {{"SCENE", "Scene folder or splat file."}, {"[OTHER]", "Another scene, for comparison."}},
    .options = options,
    .check = check,
    .run = run};

int pags_verb_report(int argc, char **argv) {
  report_arguments arguments = {.pictures = PAGS_REPORT_PICTURES, .dataset_options = pags_dataset_options_default()};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
