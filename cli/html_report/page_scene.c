/* SPDX-License-Identifier: Apache-2.0 */
/* The second half of a report's page: what was modelled, classes and objects, histograms, and how it was made. */
#include "cli/html_report/page.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "cli/measure/decisions.h"

/* ---- What was modelled and why ---- */

/* Begins a row with a key in words. */
static void put_name(pags_html *html, const char *key) {
  char name[200];
  snprintf(name, sizeof name, "%s", key);
  for (char *c = name; *c; c++)
    *c = *c == '_' ? ' ' : *c;
  pags_html_put(html, "<tr><th scope=\"row\"><bdi>%s</bdi></th>", pags_html_text(html, name));
}

static void put_note(pags_html *html, const char *key, const char *text) {
  put_name(html, key);
  pags_html_put(html, "<td><bdi>%s</bdi></td></tr>\n", pags_html_text(html, text));
}

/* What training decided, with the times of report.json. */
static void put_decisions(pags_html *html, const pags_json_value *notes, const pags_json_value *report) {
  bool begun = false;
  for (const pags_json_value *v = notes->first; v; v = v->next) {
    pags_decision_row row;
    if (!pags_decision_read(notes, v, report, &row))
      continue;
    if (!begun)
      pags_html_begin_table(html, "part|modelled|measured|scene folder|training|reason");
    begun = true;
    put_name(html, v->key);
    const char *const columns[] = {row.modelled, row.measured, row.bytes, row.time, row.why};
    for (int i = 0; i < 5; i++)
      pags_html_put(html, "<td><bdi>%s</bdi></td>", pags_html_text(html, columns[i]));
    pags_html_put(html, "</tr>\n");
  }
  if (begun)
    pags_html_end_table(html);
}

/* All else that training noted, whatever keys it has, but for the objects, which have a table of their own. */
static void put_notes(pags_html *html, const pags_json_value *notes) {
  char text[1000];
  bool begun = false;
  for (const pags_json_value *v = notes->first; v; v = v->next) {
    pags_decision_row row;
    if (!strcmp(v->key, "objects") || pags_decision_read(notes, v, NULL, &row))
      continue;
    if (!begun)
      pags_html_begin_table(html, "subject|model and reason");
    begun = true;
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
  if (begun)
    pags_html_end_table(html);
}

void pags_page_modelled(pags_html *html, const pags_report_run *runs, int count) {
  if (!runs[0].notes && !runs[1].notes)
    return;
  pags_html_put(html, "<h2>Models and reasons</h2>\n");
  for (int k = 0; k < count; k++) {
    pags_page_scene_heading(html, runs, count, k);
    if (runs[k].notes) {
      put_decisions(html, pags_json_root(runs[k].notes), runs[k].log.facts);
      put_notes(html, pags_json_root(runs[k].notes));
    } else
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
  const char *const name = pags_category_name(category);
  const int64_t counts[] = {count, critical, moving, own, gaussians};
  pags_html_put(html, "<tr><th scope=\"row\">%s%s%.1s</th>", name, letter ? ", " : "", &letter);
  for (int i = 0; i < 5; i++)
    pags_html_put(html, "<td class=\"n\">%s</td>", pags_html_count(html, counts[i]));
  pags_html_put(html, "<td class=\"n\">%s</td></tr>\n",
                pags_html_number(html, 2, region ? run->views.mean.mean.psnr[region] : (double)NAN));
}

/* What training noted of an object, or NULL. */
static const pags_json_value *note_of(const pags_report_run *run, const char *id) {
  const pags_json_value *list = run->notes ? pags_json_member(pags_json_root(run->notes), "objects") : NULL;
  for (const pags_json_value *v = list ? list->first : NULL; v; v = v->next) {
    const char *const name = pags_page_string(v, "id");
    if (name && !strcmp(name, id))
      return v;
  }
  return NULL;
}

typedef struct ranked {
  int64_t object, gaussians;
} ranked;

static int compare_ranked(const void *a, const void *b) {
  const ranked *x = a, *y = b;
  const int fewer = (x->gaussians < y->gaussians) - (x->gaussians > y->gaussians);
  return fewer ? fewer : (x->object > y->object) - (x->object < y->object);
}

/* The objects with the most Gaussians. */
static void put_object_table(pags_html *html, const pags_report_run *run) {
  enum { MOST = 100 };
  const int64_t count = run->scene->object_count;
  PAGS_AUTOFREE ranked *order = calloc((size_t)count + 1, sizeof *order);
  html->failed = html->failed || !order;
  if (!order)
    return;
  for (int64_t o = 0; o < count; o++)
    order[o] = (ranked){o, run->contents.of_object[o]};
  pags_sort(order, count, sizeof *order, compare_ranked);
  pags_html_begin_table(
      html, "object|class|#Gaussians|critical|model and reason|#moved by training, m|#turned, degrees|#seen, s");
  for (int64_t i = 0; i < count && i < MOST; i++) {
    const pags_scene_object *object = &run->scene->objects[order[i].object];
    const pags_object *record = &object->record;
    const pags_json_value *note = note_of(run, record->id);
    const char *const why = pags_page_string(note, "why");
    pags_html_put(
        html,
        "<tr><td><bdi>%s</bdi></td><td><bdi>%s</bdi></td><td class=\"n\">%s</td><td>%s</td><td><bdi>%s</bdi></td><td "
        "class=\"n\">%s</td><td class=\"n\">%s</td><td class=\"n\">%.1f to %.1f</td></tr>\n",
        pags_html_text(html, record->id), pags_html_text(html, record->class_name),
        pags_html_count(html, order[i].gaussians), object->critical ? "yes" : "no",
        pags_html_text(html, why              ? why
                             : record->moving ? "moves"
                                              : "parked"),
        pags_html_number(html, 3, pags_spoken_number(note, "mean_shift_metres")),
        pags_html_number(html, 2, pags_spoken_number(note, "mean_turn_degrees")),
        record->keyframes[0].time - run->scene->time_begin,
        record->keyframes[record->keyframe_count - 1].time - run->scene->time_begin);
  }
  pags_html_end_table(html);
  if (count > MOST)
    pags_html_put(
        html,
        "<p>%lld objects with fewer Gaussians aren't listed; <code>pags info SCENE --objects</code> lists all.</p>\n",
        (long long)(count - MOST));
}

void pags_page_objects(pags_html *html, const pags_report_run *runs, int count) {
  static const struct {
    pags_category category;
    int region;
  } classes[] = {{PAGS_CATEGORY_VEHICLE, PAGS_REGION_VEHICLES},
                 {PAGS_CATEGORY_PEDESTRIAN, PAGS_REGION_PEDESTRIANS},
                 {PAGS_CATEGORY_CYCLIST, PAGS_REGION_CYCLISTS},
                 {PAGS_CATEGORY_OTHER, 0}};
  if (!runs[0].scene->object_count && !runs[count - 1].scene->object_count)
    return;
  pags_html_put(html, "<h2>Classes and objects</h2>\n");
  pags_html_begin_table(
      html, "class|#objects|#critical|#moving|#models of their own|#Gaussians|#PSNR of those that move, dB");
  for (int c = 0; c < 4; c++)
    for (int k = 0; k < count; k++)
      put_class(html, &runs[k], classes[c].category, count == 2 ? (char)('A' + k) : 0, classes[c].region);
  pags_html_end_table(html);
  for (int k = 0; k < count; k++) {
    pags_page_scene_heading(html, runs, count, k);
    if (runs[k].scene->object_count)
      put_object_table(html, &runs[k]);
  }
}

/* ---- Histograms ---- */

void pags_page_histograms(pags_html *html, const pags_report_run *runs, int count) {
  static const pags_chart of_priorities = {.title = "Priorities, % of the Gaussians that have one",
                                           .x_name = "priority, 0 to 1",
                                           .y_name = "share",
                                           .from_zero = true,
                                           .bins = true};
  static const pags_chart of_sizes = {.title = "Sizes, % of the Gaussians",
                                      .x_name = "largest standard deviation, m",
                                      .y_name = "share",
                                      .from_zero = true,
                                      .bins = true,
                                      .log_x = true};
  pags_scene_contents contents[2] = {runs[0].contents, runs[1].contents};
  pags_curve priorities[2], sizes[2];
  for (int k = 0; k < count; k++) {
    pags_scene_contents *const c = &contents[k];
    priorities[k] = (pags_curve){.points = c->priorities, .count = c->has_priorities ? PAGS_PRIORITY_BINS + 1 : 0};
    sizes[k] = (pags_curve){.points = c->sizes, .count = c->gaussians ? PAGS_SIZE_BINS + 1 : 0};
  }
  pags_html_put(html, "<h2>Gaussians</h2>\n<div class=\"charts\">\n");
  const bool known = pags_chart_put(html, &of_priorities, priorities, count);
  pags_chart_put(html, &of_sizes, sizes, count);
  pags_html_put(html, "</div>\n%s", known ? "" : "<p class=\"soft\">The Gaussians have no priorities.</p>\n");
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
  for (int k = 0; k < count; k++) {
    const pags_json_value *const of_stages = pags_json_member(runs[k].log.facts, "ms_per_step");
    for (int i = 0; i < STAGES; i++) {
      ms[i][k] = pags_spoken_number(of_stages, stages[i][0]);
      sum[k] += isfinite(ms[i][k]) ? ms[i][k] : 0;
    }
  }
  const double most = fmax(sum[0], sum[1]);
  if (!(most > 0))
    return;
  pags_html_put(html, "<h3>Time by stage</h3>\n");
  pags_html_begin_table(html, count == 2 ? "stage|#A, ms per step|#B, ms per step|" : "stage|#ms per step|#share|");
  for (int i = 0; i < STAGES; i++) {
    pags_html_put(html, "<tr><th scope=\"row\">%s</th>", stages[i][1]);
    for (int k = 0; k < count; k++)
      pags_html_put(html, "<td class=\"n\">%s</td>", pags_html_number(html, 2, ms[i][k]));
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
  if (value)
    pags_html_put(html, "<tr><th scope=\"row\">%s</th><td><bdi>%s</bdi></td></tr>\n", name,
                  pags_html_text(html, value));
}

static void put_origin(pags_html *html, const pags_report_run *run) {
  const pags_json_value *const facts = run->log.facts;
  const char *const command = pags_page_string(facts, "command_line");
  const double threads = pags_spoken_number(facts, "threads");
  char text[64];
  if (command)
    pags_html_put(html, "<pre>%s</pre>\n", pags_html_text(html, command));
  pags_html_begin_table(html, "|");
  put_fact(html, "scene", run->path);
  put_fact(html, "data set", run->scene->dataset ? run->scene->dataset : "not known");
  put_fact(html, "trained by version", pags_page_string(facts, "version"));
  put_fact(html, "kernels", pags_page_string(facts, "kernels"));
  snprintf(text, sizeof text, "%.0f", threads);
  put_fact(html, "threads", isfinite(threads) ? text : NULL);
  snprintf(text, sizeof text, "%llu", (unsigned long long)run->scene->seed);
  put_fact(html, "seed", text);
  pags_html_end_table(html);
}

/* The training's configuration; of two scenes the settings that differ come first. */
static void put_settings(pags_html *html, const pags_report_run *runs, int count, bool differing) {
  char a[PAGS_DOUBLE_TEXT], b[PAGS_DOUBLE_TEXT];
  const pags_json_value *const there = count == 2 && runs[1].config ? pags_json_root(runs[1].config) : NULL;
  pags_html_begin_table(html, count == 2 ? "setting|A|B" : "setting|value");
  for (const pags_json_value *v = pags_json_root(runs[0].config)->first; v; v = v->next) {
    const pags_json_value *const other = pags_json_member(there, v->key);
    const char *const of_a = pags_spoken_value(v, a), *const of_b = other ? pags_spoken_value(other, b) : "-";
    if (differing && !strcmp(of_a, of_b))
      continue;
    pags_html_put(html, "<tr><th scope=\"row\"><bdi>%s</bdi></th><td><bdi>%s</bdi></td>", pags_html_text(html, v->key),
                  pags_html_text(html, of_a));
    if (count == 2)
      pags_html_put(html, "<td><bdi>%s</bdi></td>", pags_html_text(html, of_b));
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
