/* SPDX-License-Identifier: Apache-2.0 */
/* The second half of a report's page: what was modelled, classes and objects, histograms, and how it was made. */
#include "cli/html_report/page.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "cli/measure/info.h"

/* ---- What was modelled and why ---- */

static void put_note(pags_html *html, const char *key, const char *text) {
  char name[200];
  snprintf(name, sizeof name, "%s", key);
  for (char *c = name; *c; c++)
    *c = *c == '_' ? ' ' : *c;
  pags_html_put(html, "<tr>");
  pags_html_element(html, "th scope=\"row\"", name);
  pags_html_cell(html, text);
  pags_html_put(html, "</tr>\n");
}

/* All that training noted, whatever keys it has, but for the objects, which have a table of their own. */
static void put_notes(pags_html *html, const pags_json_value *notes) {
  char text[1000];
  pags_html_begin_table(html, "subject|model and reason");
  for (const pags_json_value *v = notes->first; v; v = v->next) {
    if (!strcmp(v->key, "objects"))
      continue;
    if (v->type == PAGS_JSON_ARRAY) {
      for (const pags_json_value *e = v->first; e; e = e->next)
        put_note(html, e == v->first ? v->key : "", pags_spoken_value(e, text));
    } else if (v->type == PAGS_JSON_OBJECT) {
      pags_spoken_members(v, NULL, text, sizeof text);
      put_note(html, v->key, text);
    } else {
      put_note(html, v->key, pags_spoken_value(v, text));
    }
  }
  pags_html_end_table(html);
}

void pags_page_modelled(pags_html *html, const pags_report_run *runs, int count) {
  bool any = false;
  for (int k = 0; k < count; k++)
    any = any || runs[k].notes;
  if (!any)
    return;
  pags_html_put(html, "<h2>Models and reasons</h2>\n");
  for (int k = 0; k < count; k++) {
    pags_page_scene_heading(html, runs, count, k);
    if (runs[k].notes)
      put_notes(html, pags_json_root(runs[k].notes));
    else
      pags_html_put(html, "<p class=\"soft\">Not stored in the scene.</p>\n");
  }
}

/* ---- Classes and objects ---- */

static void put_class(pags_html *html, const pags_report_run *run, pags_category category, char letter, int region) {
  int64_t count = 0, moving = 0, own = 0, critical = 0, gaussians = 0;
  for (int64_t o = 0; o < run->scene->object_count; o++) {
    const pags_scene_object *object = &run->scene->objects[o];
    if (object->record.category != category)
      continue;
    count++;
    critical += object->critical != 0;
    moving += object->record.moving != 0;
    own += object->model >= 0;
    gaussians += run->contents.of_object[o];
  }
  if (!count)
    return;
  pags_html_put(html, "<tr><th scope=\"row\">%s%s%.1s</th>", pags_category_name(category), letter ? ", " : "", &letter);
  pags_html_count(html, count);
  pags_html_count(html, critical);
  pags_html_count(html, moving);
  pags_html_count(html, own);
  pags_html_count(html, gaussians);
  pags_html_number(html, 2, region ? run->views.mean.mean.psnr[region] : (double)NAN);
  pags_html_put(html, "</tr>\n");
}

/* What training noted of an object, or NULL. */
static const pags_json_value *note_of(const pags_report_run *run, const char *id) {
  const pags_json_value *list = run->notes ? pags_json_member(pags_json_root(run->notes), "objects") : NULL;
  for (const pags_json_value *v = list ? list->first : NULL; v; v = v->next) {
    const pags_json_value *name = v->type == PAGS_JSON_OBJECT ? pags_json_member(v, "id") : NULL;
    if (name && name->type == PAGS_JSON_STRING && !strcmp(name->text, id))
      return v;
  }
  return NULL;
}

static double note_number(const pags_json_value *note, const char *key) {
  const pags_json_value *value = note ? pags_json_member(note, key) : NULL;
  return value && value->type == PAGS_JSON_NUMBER ? value->number : (double)NAN;
}

static void put_object(pags_html *html, const pags_report_run *run, int64_t o) {
  const pags_scene_object *object = &run->scene->objects[o];
  const pags_object *record = &object->record;
  const pags_json_value *note = note_of(run, record->id);
  const pags_json_value *why = note ? pags_json_member(note, "why") : NULL;
  pags_html_put(html, "<tr>");
  pags_html_cell(html, record->id);
  pags_html_cell(html, record->class_name);
  pags_html_count(html, run->contents.of_object[o]);
  pags_html_put(html, "<td>%s</td>", object->critical ? "yes" : "no");
  pags_html_cell(html, why && why->type == PAGS_JSON_STRING ? why->text : record->moving ? "moves" : "parked");
  pags_html_number(html, 3, note_number(note, "mean_shift_metres"));
  pags_html_number(html, 2, note_number(note, "mean_turn_degrees"));
  pags_html_put(html, "<td class=\"n\">%.1f to %.1f</td></tr>\n", record->keyframes[0].time - run->scene->time_begin,
                record->keyframes[record->keyframe_count - 1].time - run->scene->time_begin);
}

typedef struct ranked {
  int64_t object, gaussians;
} ranked;

static int compare_ranked(const void *a, const void *b) {
  const ranked *x = a, *y = b;
  if (x->gaussians != y->gaussians)
    return x->gaussians < y->gaussians ? 1 : -1;
  return x->object < y->object ? -1 : x->object > y->object;
}

/* The objects with the most Gaussians. */
static void put_object_table(pags_html *html, const pags_report_run *run) {
  enum { MOST = 100 };
  const int64_t count = run->scene->object_count;
  ranked *order = calloc((size_t)count + 1, sizeof *order);
  html->failed = html->failed || !order;
  if (!order)
    return;
  for (int64_t o = 0; o < count; o++)
    order[o] = (ranked){o, run->contents.of_object[o]};
  qsort(order, (size_t)count, sizeof *order, compare_ranked);
  pags_html_begin_table(html,
                        "object|class|#Gaussians|critical|model and reason|#moved by training, m|#turned, degrees|"
                        "#seen, s");
  for (int64_t i = 0; i < count && i < MOST; i++)
    put_object(html, run, order[i].object);
  pags_html_end_table(html);
  if (count > MOST)
    pags_html_put(html,
                  "<p>%lld objects with fewer Gaussians aren't listed; <code>pags info SCENE --objects</code> lists "
                  "all.</p>\n",
                  (long long)(count - MOST));
  free(order);
}

void pags_page_objects(pags_html *html, const pags_report_run *runs, int count) {
  static const pags_category categories[] = {PAGS_CATEGORY_VEHICLE, PAGS_CATEGORY_PEDESTRIAN, PAGS_CATEGORY_CYCLIST,
                                             PAGS_CATEGORY_OTHER};
  static const int regions[] = {PAGS_REGION_VEHICLES, PAGS_REGION_PEDESTRIANS, PAGS_REGION_CYCLISTS, 0};
  bool any = false;
  for (int k = 0; k < count; k++)
    any = any || runs[k].scene->object_count;
  if (!any)
    return;
  pags_html_put(html, "<h2>Classes and objects</h2>\n");
  pags_html_begin_table(html,
                        "class|#objects|#critical|#moving|#models of their own|#Gaussians|#PSNR of those that "
                        "move, dB");
  for (int c = 0; c < 4; c++)
    for (int k = 0; k < count; k++)
      put_class(html, &runs[k], categories[c], count == 2 ? (char)('A' + k) : 0, regions[c]);
  pags_html_end_table(html);
  for (int k = 0; k < count; k++) {
    pags_page_scene_heading(html, runs, count, k);
    if (runs[k].scene->object_count)
      put_object_table(html, &runs[k]);
  }
}

/* ---- Histograms ---- */

void pags_page_histograms(pags_html *html, const pags_report_run *runs, int count) {
  pags_curve priorities[2], sizes[2];
  for (int k = 0; k < count; k++) {
    const pags_scene_contents *c = &runs[k].contents;
    priorities[k] = (pags_curve){c->priority_edges, c->priorities, c->has_priorities ? PAGS_PRIORITY_BINS + 1 : 0};
    sizes[k] = (pags_curve){c->size_edges, c->sizes, c->gaussians ? PAGS_SIZE_BINS + 1 : 0};
  }
  pags_html_put(html, "<h2>Gaussians</h2>\n<div class=\"charts\">\n");
  const pags_chart of_priorities = {.title = "Priorities, % of the Gaussians that have one",
                                    .x_name = "priority, 0 to 1",
                                    .y_name = "share",
                                    .from_zero = true,
                                    .bins = true};
  const pags_chart of_sizes = {.title = "Sizes, % of the Gaussians",
                               .x_name = "largest standard deviation, m",
                               .y_name = "share",
                               .from_zero = true,
                               .bins = true,
                               .log_x = true};
  const bool known = pags_chart_put(html, &of_priorities, priorities, count);
  pags_chart_put(html, &of_sizes, sizes, count);
  pags_html_put(html, "</div>\n");
  if (!known)
    pags_html_put(html, "<p class=\"soft\">The Gaussians have no priorities.</p>\n");
}

/* ---- How it was made ---- */

static void put_stages(pags_html *html, const pags_report_run *runs, int count) {
  static const char *const stages[][2] = {{"wait", "waiting for photographs"},
                                          {"forward", "rendering the view"},
                                          {"loss", "loss"},
                                          {"backward", "gradients and optimiser"},
                                          {"density", "densify and prune"}};
  enum { STAGES = sizeof stages / sizeof stages[0] };
  double ms[STAGES][2], sum[2] = {0, 0};
  for (int k = 0; k < count; k++)
    for (int i = 0; i < STAGES; i++) {
      ms[i][k] = pags_run_log_number(&runs[k].log, "ms_per_step", stages[i][0]);
      sum[k] += isfinite(ms[i][k]) ? ms[i][k] : 0;
    }
  const double most = fmax(sum[0], sum[1]);
  if (!(most > 0))
    return;
  pags_html_put(html, "<h3>Time by stage</h3>\n");
  pags_html_begin_table(html, count == 2 ? "stage|#A, ms per step|#B, ms per step|" : "stage|#ms per step|#share|");
  for (int i = 0; i < STAGES; i++) {
    pags_html_put(html, "<tr><th scope=\"row\">%s</th>", stages[i][1]);
    for (int k = 0; k < count; k++)
      pags_html_number(html, 2, ms[i][k]);
    if (count == 1)
      pags_html_put(html, "<td class=\"n\">%.0f %%</td>", 100 * ms[i][0] / sum[0]);
    pags_html_put(html, "<td>");
    for (int k = 0; k < count; k++)
      pags_html_put(html, "<span class=\"bar\" style=\"width:%.1fpx;background:var(--%c)\"></span>%s",
                    isfinite(ms[i][k]) ? 160 * ms[i][k] / most : 0, 'a' + k, k + 1 < count ? "<br>" : "");
    pags_html_put(html, "</td></tr>\n");
  }
  pags_html_end_table(html);
}

static void put_fact(pags_html *html, const char *name, const char *value) {
  pags_html_put(html, "<tr><th scope=\"row\">%s</th>", name);
  pags_html_cell(html, value);
  pags_html_put(html, "</tr>\n");
}

static void put_origin(pags_html *html, const pags_report_run *run) {
  const char *command = pags_run_log_text(&run->log, "command_line");
  const char *version = pags_run_log_text(&run->log, "version");
  const char *kernels = pags_run_log_text(&run->log, "kernels");
  const double threads = pags_run_log_number(&run->log, NULL, "threads");
  char text[64];
  if (command) {
    pags_html_put(html, "<pre>");
    pags_html_text(html, command);
    pags_html_put(html, "</pre>\n");
  }
  pags_html_begin_table(html, "|");
  put_fact(html, "scene", run->path);
  put_fact(html, "data set", run->scene->dataset ? run->scene->dataset : "not known");
  if (version)
    put_fact(html, "trained by version", version);
  if (kernels)
    put_fact(html, "kernels", kernels);
  snprintf(text, sizeof text, "%.0f", threads);
  if (isfinite(threads))
    put_fact(html, "threads", text);
  snprintf(text, sizeof text, "%llu", (unsigned long long)run->scene->seed);
  put_fact(html, "seed", text);
  pags_html_end_table(html);
}

static const pags_json_value *setting_of(const pags_report_run *run, const char *key) {
  return run->config ? pags_json_member(pags_json_root(run->config), key) : NULL;
}

/* The training's configuration; of two scenes the settings that differ come first. */
static void put_settings(pags_html *html, const pags_report_run *runs, int count, bool differing) {
  char a[1000], b[1000];
  const pags_json_value *root = pags_json_root(runs[0].config);
  pags_html_begin_table(html, count == 2 ? "setting|A|B" : "setting|value");
  for (const pags_json_value *v = root->first; v; v = v->next) {
    const pags_json_value *other = count == 2 ? setting_of(&runs[1], v->key) : NULL;
    const char *here = pags_spoken_value(v, a), *there = other ? pags_spoken_value(other, b) : "-";
    if (differing && !strcmp(here, there))
      continue;
    pags_html_put(html, "<tr>");
    pags_html_element(html, "th scope=\"row\"", v->key);
    pags_html_cell(html, here);
    if (count == 2)
      pags_html_cell(html, there);
    pags_html_put(html, "</tr>\n");
  }
  pags_html_end_table(html);
}

void pags_page_making(pags_html *html, const pags_report_run *runs, int count) {
  pags_html_put(html, "<h2>How it was made</h2>\n");
  put_stages(html, runs, count);
  for (int k = 0; k < count; k++) {
    pags_page_scene_heading(html, runs, count, k);
    put_origin(html, &runs[k]);
  }
  if (!runs[0].config)
    return;
  if (count == 2 && runs[1].config) {
    pags_html_put(html, "<h3>Settings that differ</h3>\n");
    put_settings(html, runs, count, true);
  }
  pags_html_put(html, "<details><summary>All training settings</summary>\n");
  put_settings(html, runs, count, false);
  pags_html_put(html, "</details>\n");
}
