/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the scenes of a report, draws their views and puts the page together; see html_report.h. */
#include "cli/html_report/html_report.h"

#include <math.h>
#include <string.h>

#include <pags/packed.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "cli/html_report/page.h"
#include "eval/metric.h"

/* ---- Reading ---- */

static pags_result parse(const char *name, const char *text, pags_json **out) {
  return text ? pags_json_parse_text(name, text, strlen(text), out) : PAGS_OK;
}

/* Reads a scene with its folder's files, and opens its photographs. */
static pags_result open_run(const char *path, const pags_html_report_settings *settings, pags_report_run *run) {
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  *run = (pags_report_run){.path = path, .name = *pags_path_name(path) ? pags_path_name(path) : path};
  if (pags_packed_is_file(path))
    return pags_fail(
        PAGS_ERROR_UNSUPPORTED,
        "%s: a packed file has no views to compare: expected the scene or splat file from which it was made", path);
  PAGS_TRY(pags_scene_load(path, &scene));
  PAGS_TRY(pags_scene_contents_find(path, &scene, &run->contents));
  PAGS_TRY(pags_composition_create(&scene, &run->composition));
  run->scene = pags_composition_scene(run->composition);
  if (pags_dir_exists(path))
    PAGS_TRY(pags_run_log_read(path, &run->log));
  PAGS_TRY(parse("modelled", run->scene->notes, &run->notes));
  PAGS_TRY(parse("config", run->scene->config, &run->config));
  return pags_report_views_open(run->scene, path, settings, &run->views);
}

static void close_runs(pags_report_run (*runs)[2]) {
  for (int k = 0; k < 2; k++) {
    pags_report_run *const run = &(*runs)[k];
    pags_report_views_destroy(&run->views);
    pags_json_destroy(run->config);
    pags_json_destroy(run->notes);
    pags_run_log_destroy(&run->log);
    free(run->contents.of_object);
    pags_composition_destroy(run->composition);
  }
}

/* ---- Writing ---- */

static pags_result write_page(const pags_report_run *runs, const pags_html_report_settings *settings,
                              const char *output) {
  const int count = settings->count;
  PAGS_AUTO(pags_html_destroy) pags_html html = {0};
  pags_page_begin(&html, runs, count);
  pags_page_figures(&html, runs, count, settings->lpips ? pags_lpips_network(settings->lpips) : "");
  pags_page_curves(&html, runs, count);
  pags_page_quality(&html, runs, count);
  pags_page_views(&html, runs, count);
  pags_page_modelled(&html, runs, count);
  pags_page_objects(&html, runs, count);
  pags_page_histograms(&html, runs, count);
  pags_page_making(&html, runs, count);
  pags_html_put(&html, "</body>\n</html>\n");
  PAGS_CHECK_MEMORY(!html.failed, "%s", output);
  return pags_file_write(output, html.sink.bytes, html.sink.size);
}

pags_result pags_html_report_write(const pags_html_report_settings *settings, const char *output,
                                   pags_html_report_facts *facts) {
  PAGS_AUTO(close_runs) pags_report_run runs[2] = {{0}};
  for (int k = 0; k < settings->count; k++)
    PAGS_TRY(open_run(settings->scenes[k], settings, &runs[k]));
  if (settings->count == 2 && !strcmp(runs[0].name, runs[1].name))
    for (int k = 0; k < 2; k++)
      runs[k].name = runs[k].path;
  pags_report_views_choose(&runs[0].views, settings->count == 2 ? &runs[1].views : NULL, settings->pictures);
  for (int k = 0; k < settings->count; k++) {
    const pags_report_views *const views = &runs[k].views;
    PAGS_TRY(pags_report_views_draw(&runs[k].views, runs[k].composition, settings));
    facts[k] = (pags_html_report_facts){.views = views->count,
                                        .measured = views->mean.views,
                                        .pictures = pags_report_views_pictures(views),
                                        .psnr = views->mean.mean.psnr[PAGS_REGION_WHOLE],
                                        .ssim = views->mean.mean.ssim[PAGS_REGION_WHOLE],
                                        .lpips = views->mean.mean.lpips};
  }
  PAGS_TRY(pags_session_check(settings->session));
  return write_page(runs, settings, output);
}

void pags_html_report_of_training(const pags_session *session, const char *scene,
                                  const pags_dataset_options *dataset_options, const pags_train_result *result) {
  PAGS_AUTOFREE char *page = pags_path_join(scene, "report.html");
  pags_html_report_facts facts;
  pags_progress progress = pags_progress_begin(session->people);
  PAGS_AUTO(pags_lpips_destroy_auto) pags_lpips *lpips = NULL;
  pags_result written = page ? pags_view_lpips_load(NULL, &lpips) : pags_out_of_memory("a path");
  const pags_html_report_settings settings = {
      .scenes = {scene, NULL},
      .count = 1,
      .dataset_options = *dataset_options,
      .pictures = PAGS_REPORT_PICTURES,
      .seconds = result->finished ? fmin(fmax(result->seconds / 30, 1), 10) : 1,
      .session = session,
      .progress = &progress,
      .lpips = lpips,
      .cancel = result->finished ? pags_interrupt_flag() : NULL, /* else the signal is known already */
  };
  if (written == PAGS_OK)
    written = pags_html_report_write(&settings, page, &facts);
  pags_progress_end(&progress);
  if (written == PAGS_OK)
    pags_say(session, "report: %s\n", page);
  else if (written == PAGS_CANCELLED)
    pags_say(session, "interrupted: no report was written; 'pags report %s' writes it\n", scene);
  else
    pags_log_message(PAGS_LOG_WARNING, "the scene was written, but its report wasn't: %s", pags_error_message());
}

/* ---- The command ---- */

static bool put_word(pags_sink *sink, const char *word) {
  static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./=,:+@%";
  if (*word && !word[strspn(word, plain)])
    return pags_sink_put(sink, " ", 1) && pags_sink_put(sink, word, strlen(word));
  bool room = pags_sink_put(sink, " '", 2);
  for (; *word && room; word++)
    room = *word == '\'' ? pags_sink_put(sink, "'\\''", 4) : pags_sink_put(sink, word, 1);
  return room && pags_sink_put(sink, "'", 1);
}

char *pags_command_line(const char *verb, int argc, char *const *argv) {
  pags_sink sink = {0};
  bool room = pags_sink_put(&sink, pags_program_name, strlen(pags_program_name)) && put_word(&sink, verb);
  for (int i = 0; i < argc && room; i++)
    room = put_word(&sink, argv[i]);
  if (room && pags_sink_put(&sink, "", 1))
    return (char *)sink.bytes;
  free(sink.bytes);
  return NULL;
}
