/* SPDX-License-Identifier: Apache-2.0 */
/* Options and reports of an export of proxies: the default options, a growing list of the facts of all
 * proxies written, with its own copies of their names, and those facts as JSON. */
#include <math.h>
#include <stdlib.h>

#include "base/json.h"
#include "base/text.h"
#include "exporters/proxy/proxy_error.h"

pags_proxy_options pags_proxy_options_default(void) {
  return (pags_proxy_options){.level = PAGS_PROXY_MESH,
                              .triangles = 4000,
                              .ground_triangles = 60000,
                              .chunk_triangles = 200000,
                              .cage_level = 1,
                              .background = 1};
}

const char *pags_proxy_level_name(pags_proxy_level level) {
  static const char *const names[] = {"mesh", "cage", "hull", "box", "convex"};
  return names[level];
}

pags_result pags_proxy_report_add(pags_proxy_report *report, const pags_proxy_facts *facts) {
  int64_t capacity = report->count;
  PAGS_AUTOFREE char *name = pags_text_copy(facts->name), *class_name = pags_text_copy(facts->class_name);
  PAGS_CHECK_MEMORY(
      name && class_name && pags_grow(&report->proxies, report->count + 1, &capacity, sizeof *report->proxies),
      "a report");
  pags_proxy_facts *added = &report->proxies[report->count++];
  *added = *facts;
  added->name = pags_take(&name);
  added->class_name = pags_take(&class_name);
  return PAGS_OK;
}

void pags_proxy_report_destroy(pags_proxy_report *report) {
  for (int64_t i = 0; i < report->count; i++) {
    free((char *)(uintptr_t)report->proxies[i].name);
    free((char *)(uintptr_t)report->proxies[i].class_name);
  }
  free(report->proxies);
  *report = (pags_proxy_report){0};
}

static void put_distance(pags_json_writer *w, const char *key, const pags_proxy_distance *d) {
  if (isnan(d->mean))
    return;
  pags_json_begin_object(w, key);
  pags_json_put_number(w, "mean", d->mean);
  pags_json_put_number(w, "p95", d->p95);
  pags_json_put_number(w, "max", d->max);
  pags_json_end_object(w);
}

void pags_proxy_facts_put(pags_json_writer *w, const pags_proxy_facts *f) {
  pags_json_put_string(w, "level", pags_proxy_level_name(f->level));
  pags_json_put_string(w, "class", f->class_name);
  pags_json_put_bool(w, "critical", f->critical);
  pags_json_put_bool(w, "moving", f->moving);
  pags_json_put_integer(w, "gaussians", f->gaussians);
  if (!isnan(f->s_sem))
    pags_json_put_number(w, "s_sem", f->s_sem);
  pags_json_put_integer(w, "vertices", f->vertices);
  pags_json_put_integer(w, "triangles", f->triangles);
  pags_json_put_bool(w, "watertight", f->closed);
  if (f->closed)
    pags_json_put_number(w, "volume", f->volume);
  pags_json_put_number(w, "observed", f->observed);
  if (f->unseen_depth > 0)
    pags_json_put_number(w, "unseen_depth", f->unseen_depth);
  pags_json_begin_object(w, "error");
  pags_json_put_string(w, "unit", "metres");
  put_distance(w, "proxy_to_gaussians", &f->to_gaussians);
  put_distance(w, "gaussians_to_proxy", &f->from_gaussians);
  if (!isnan(f->silhouette_iou)) {
    pags_json_put_number(w, "silhouette_iou", f->silhouette_iou);
    pags_json_put_integer(w, "silhouette_views", f->silhouette_views);
  }
  pags_json_end_object(w);
  if (f->note)
    pags_json_put_string(w, "note", f->note);
}
