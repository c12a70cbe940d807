/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the scenes of a report, draws their views and puts the page together; see html_report.h. */
#include "cli/html_report/html_report.h"

#include <stdlib.h>
#include <string.h>

#include <pags/packed.h>

#include "base/file.h"
#include "base/memory.h"
#include "cli/html_report/page.h"

/* ---- Reading ---- */

static pags_result parse(const char *name, const char *text, pags_json **out) {
  return text ? pags_json_parse_text(name, text, strlen(text), out) : PAGS_OK;
}

/* Reads a scene with its folder's files, and opens its photographs. */
static pags_result open_run(const char *path, const pags_html_report_settings *settings, pags_report_run *run) {
  pags_scene scene;
  *run = (pags_report_run){.path = path, .name = *pags_path_name(path) ? pags_path_name(path) : path};
  if (pags_packed_is_file(path))
    return pags_fail(
        PAGS_ERROR_UNSUPPORTED,
        "%s: a packed file has no views to compare: expected the scene or splat file from which it was made", path);
  PAGS_TRY(pags_scene_load(path, &scene));
  pags_result result = pags_scene_contents_find(path, &scene, &run->contents);
  if (result == PAGS_OK)
    result = pags_composition_create(&scene, &run->composition);
  else
    pags_scene_destroy(&scene);
  PAGS_TRY(result);
  run->scene = pags_composition_scene(run->composition);
  if (pags_dir_exists(path))
    PAGS_TRY(pags_run_log_read(path, &run->log));
  PAGS_TRY(parse("modelled", run->scene->notes, &run->notes));
  PAGS_TRY(parse("config", run->scene->config, &run->config));
  return pags_report_views_open(run->scene, path, settings, &run->views);
}

static void close_run(pags_report_run *run) {
  pags_report_views_destroy(&run->views);
  pags_json_destroy(run->config);
  pags_json_destroy(run->notes);
  pags_run_log_destroy(&run->log);
  pags_scene_contents_destroy(&run->contents);
  pags_composition_destroy(run->composition);
}

/* ---- Writing ---- */

static pags_result write_page(const pags_report_run *runs, int count, const char *output) {
  pags_html html = {0};
  pags_page_begin(&html, runs, count);
  pags_page_figures(&html, runs, count);
  pags_page_curves(&html, runs, count);
  pags_page_quality(&html, runs, count);
  pags_page_views(&html, runs, count);
  pags_page_modelled(&html, runs, count);
  pags_page_objects(&html, runs, count);
  pags_page_histograms(&html, runs, count);
  pags_page_making(&html, runs, count);
  pags_page_end(&html);
  const pags_result result =
      html.failed ? pags_out_of_memory("%s", output) : pags_file_write(output, html.sink.bytes, html.sink.size);
  free(html.sink.bytes);
  return result;
}

static pags_html_report_facts facts_of(const pags_report_views *views) {
  pags_html_report_facts facts = {.views = views->count,
                                  .measured = views->mean.views,
                                  .psnr = views->mean.mean.psnr[PAGS_REGION_WHOLE],
                                  .ssim = views->mean.mean.ssim[PAGS_REGION_WHOLE]};
  for (int64_t i = 0; i < views->count; i++)
    facts.pictures += views->items[i].jpeg[PAGS_VIEW_PICTURE_RENDER].size > 0;
  return facts;
}

pags_result pags_html_report_write(const pags_html_report_settings *settings, const char *output,
                                   pags_html_report_facts *facts) {
  pags_report_run runs[2] = {{0}};
  pags_result result = PAGS_OK;
  for (int k = 0; k < settings->count && result == PAGS_OK; k++)
    result = open_run(settings->scenes[k], settings, &runs[k]);
  if (settings->count == 2 && result == PAGS_OK && !strcmp(runs[0].name, runs[1].name))
    for (int k = 0; k < 2; k++)
      runs[k].name = runs[k].path;
  if (result == PAGS_OK)
    pags_report_views_choose(&runs[0].views, settings->count == 2 ? &runs[1].views : NULL, settings->pictures);
  for (int k = 0; k < settings->count && result == PAGS_OK; k++) {
    result = pags_report_views_draw(&runs[k].views, runs[k].composition, settings);
    if (result == PAGS_OK)
      facts[k] = facts_of(&runs[k].views);
  }
  if (result == PAGS_OK)
    result = pags_session_check(settings->session);
  if (result == PAGS_OK)
    result = write_page(runs, settings->count, output);
  for (int k = 0; k < settings->count; k++)
    close_run(&runs[k]);
  return result;
}
