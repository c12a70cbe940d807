/* SPDX-License-Identifier: Apache-2.0 */
/* Puts decisions of a training into words, and those to come of a data set; see decisions.h. */
#include "cli/measure/decisions.h"

#include <math.h>

#include "train/config.h"
#include "train/holdout_test.h"

/* ---- Words ---- */

const char *pags_spoken_value(const pags_json_value *v, char text[PAGS_DOUBLE_TEXT]) {
  switch (v->type) {
    case PAGS_JSON_STRING: return v->text;
    case PAGS_JSON_NUMBER: snprintf(text, PAGS_DOUBLE_TEXT, "%.6g", v->number); return text;
    case PAGS_JSON_BOOL: return v->boolean ? "yes" : "no";
    case PAGS_JSON_NULL: return "-";
    case PAGS_JSON_ARRAY:
    case PAGS_JSON_OBJECT: break;
  }
  return "...";
}

void pags_spoken_members(const pags_json_value *parent, const char *but, char *text, size_t size) {
  size_t used = 0;
  text[0] = 0;
  for (const pags_json_value *v = parent->first; v && used < size; v = v->next) {
    char number[PAGS_DOUBLE_TEXT];
    if (!v->key || !but || strcmp(v->key, but) != 0)
      used += (size_t)snprintf(text + used, size - used, "%s%s%s%s", used ? ", " : "", v->key ? v->key : "",
                               v->key ? " " : "", pags_spoken_value(v, number));
  }
}

/* ---- The columns of a decision ---- */

double pags_spoken_number(const pags_json_value *object, const char *key) {
  const pags_json_value *const v = pags_json_member(object, key);
  return v && v->type == PAGS_JSON_NUMBER ? v->number : (double)NAN;
}

static void put_measured(const pags_json_value *note, pags_decision_row *out) {
  const double gain = pags_spoken_number(note, "gain_db"), sky = pags_spoken_number(note, "share_of_pixels"),
               behind = pags_spoken_number(note, "share_of_background"),
               alpha = pags_spoken_number(note, "photographs_with_alpha");
  char *const text = out->measured;
  const size_t size = sizeof out->measured;
  const double error = pags_spoken_number(note, "standard_error_db"), limit = pags_spoken_number(note, "least_gain_db");
  if (isfinite(gain) && isfinite(error))
    snprintf(text, size, "%+.2f dB (error %.2f, limit %.2g)", gain, error, limit);
  else if (isfinite(gain))
    snprintf(text, size, "%+.2f dB", gain);
  else if (isfinite(sky))
    snprintf(text, size, "%.3g %% of pixels", 100 * sky);
  else if (isfinite(behind))
    snprintf(text, size, "%.3g %% background", 100 * behind);
  else if (isfinite(alpha))
    snprintf(text, size, "%.0f photographs with alpha", alpha);
  else
    snprintf(text, size, "-");
}

static void put_bytes(const pags_json_value *note, pags_decision_row *out) {
  const double takes = pags_spoken_number(note, "bytes"), saves = pags_spoken_number(note, "bytes_saved");
  char a[32], b[32];
  pags_format_bytes(takes, a, sizeof a);
  pags_format_bytes(saves, b, sizeof b);
  snprintf(out->bytes, sizeof out->bytes, "%s%s%s%s",
           takes > 0   ? a
           : saves > 0 ? ""
                       : "-",
           takes > 0 && saves > 0 ? ", " : "", saves > 0 ? "saves " : "", saves > 0 ? b : "");
}

/* The time spent on the part and on its test; a step's time is saved once the part is left out. */
static void put_time(const char *part, const pags_json_value *report, bool modelled, pags_decision_row *out) {
  const pags_json_value *const own = pags_json_member(pags_json_member(report, "decisions"), part);
  const double seconds = pags_spoken_number(own, "seconds"), test = pags_spoken_number(own, "test_seconds"),
               steps = pags_spoken_number(own, "steps");
  int used = 0;
  if (steps > 0 && modelled)
    used = snprintf(out->time, sizeof out->time, "%.2g ms a step, %.2g s", 1e3 * seconds / steps, seconds);
  else if (steps > 0)
    used = snprintf(out->time, sizeof out->time, "saves %.2g ms a step", 1e3 * seconds / steps);
  if (test > 0)
    snprintf(out->time + used, sizeof out->time - (size_t)used, "%stest %.2g s", used ? ", " : "", test);
  else if (!used)
    snprintf(out->time, sizeof out->time, "-");
}

bool pags_decision_read(const pags_json_value *notes, const pags_json_value *note, const pags_json_value *report,
                        pags_decision_row *out) {
  static const char *const told[] = {"modelled",
                                     "why",
                                     "gain_db",
                                     "standard_error_db",
                                     "least_gain_db",
                                     "bytes",
                                     "bytes_saved",
                                     "share_of_pixels",
                                     "degree",
                                     "photographs_with_alpha",
                                     "share_of_background"};
  const pags_json_value *const form = pags_json_member(notes, "exposure");
  if (!form || form->type != PAGS_JSON_OBJECT || note->type != PAGS_JSON_OBJECT)
    return false;
  const pags_json_value *const modelled = pags_json_member(note, "modelled"), *const why =
                                                                                  pags_json_member(note, "why");
  if (!modelled || !why || why->type != PAGS_JSON_STRING)
    return false;
  const double degree = pags_spoken_number(note, "degree");
  const bool yes = modelled->type == PAGS_JSON_BOOL && modelled->boolean;
  snprintf(out->modelled, sizeof out->modelled, "%s", modelled->type == PAGS_JSON_NULL ? "open" : yes ? "yes" : "no");
  if (isfinite(degree))
    snprintf(out->modelled, sizeof out->modelled, "degree %.0f", degree);
  put_measured(note, out);
  put_bytes(note, out);
  put_time(note->key, report, yes, out);

  /* Further members follow the reason. */
  int used = snprintf(out->why, sizeof out->why, "%s", why->text);
  for (const pags_json_value *v = note->first; v && used < (int)sizeof out->why; v = v->next) {
    char value[PAGS_DOUBLE_TEXT];
    if (pags_text_find(v->key, told, sizeof told / sizeof *told) < 0)
      used += snprintf(out->why + used, sizeof out->why - (size_t)used, "; %s %s", v->key, pags_spoken_value(v, value));
  }
  return true;
}

/* ---- After a training ---- */

/* Prints an array of JSON objects, one line each, beginning with the object's "id". */
static void list_notes(pags_report *report, const pags_json_value *array) {
  char text[1000];
  pags_report_line(report, array->key, "%s", "");
  report->indent += 2;
  for (const pags_json_value *v = array->first; v; v = v->next) {
    const pags_json_value *id = pags_json_member(v, "id");
    pags_spoken_members(v, "id", text, sizeof text);
    pags_report_named(report, id && id->type == PAGS_JSON_STRING ? id->text : "-", "%s", text);
  }
  report->indent -= 2;
}

static void put_note(pags_report *report, const pags_json_value *v) {
  char text[1000];
  if (v->type == PAGS_JSON_OBJECT) {
    pags_spoken_members(v, NULL, text, sizeof text);
    pags_report_line(report, v->key, "%s", text);
  } else if (v->type == PAGS_JSON_ARRAY && v->first && v->first->type == PAGS_JSON_OBJECT) {
    list_notes(report, v);
  } else if (v->type == PAGS_JSON_ARRAY) {
    for (const pags_json_value *e = v->first; e; e = e->next)
      pags_report_line(report, e == v->first ? v->key : "", "%s", pags_spoken_value(e, text));
  } else {
    pags_report_line(report, v->key, "%s", pags_spoken_value(v, text));
  }
}

pags_result pags_decisions_put(pags_report *report, const char *notes, const char *folder) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL, *made = NULL;
  PAGS_TRY(pags_json_parse_text("modelled", notes, strlen(notes), &json));
  if (folder && pags_json_parse_in_folder(folder, "report.json", &made) == PAGS_ERROR_MEMORY)
    return PAGS_ERROR_MEMORY;
  const pags_json_value *const root = pags_json_root(json), *const times = made ? pags_json_root(made) : NULL;
  const pags_json_value *const all = pags_json_member(times, "decisions");
  bool headed = false;
  pags_report_line(report, "modelled", "%s", "");
  report->indent += 2;
  for (const pags_json_value *v = root->first; v; v = v->next) {
    static const char format[] = "%-8s %-36s %-24s %-40s %s";
    pags_decision_row row;
    if (!pags_decision_read(root, v, times, &row)) {
      put_note(report, v);
      continue;
    }
    if (!headed)
      pags_report_line(report, "part", format, "modelled", "measured", "scene folder", "training", "reason");
    headed = true;
    pags_report_line(report, v->key, format, row.modelled, row.measured, row.bytes, row.time, row.why);
  }
  report->indent -= 2;
  pags_json_put_raw(&report->json, "modelled", notes);
  if (headed && all && all->type == PAGS_JSON_OBJECT) {
    pags_json_begin_object(&report->json, "modelled_times");
    for (const pags_json_value *v = all->first; v; v = v->next) {
      pags_json_begin_object(&report->json, v->key);
      for (const pags_json_value *m = v->type == PAGS_JSON_OBJECT ? v->first : NULL; m; m = m->next)
        pags_json_put_number(&report->json, m->key, m->number);
      pags_json_end_object(&report->json);
    }
    pags_json_end_object(&report->json);
  }
  return PAGS_OK;
}

/* ---- Before a training ---- */

typedef enum answer { NO, YES, OPEN } answer;

/* Begins the entry of a part. */
static void begin(pags_json_writer *w, const char *key, answer modelled, const char *why) {
  pags_json_begin_object(w, key);
  if (modelled == OPEN)
    pags_json_put_null(w, "modelled");
  else
    pags_json_put_bool(w, "modelled", modelled == YES);
  pags_json_put_string(w, "why", why);
}

static void put(pags_json_writer *w, const char *key, answer modelled, const char *why) {
  begin(w, key, modelled, why);
  pags_json_end_object(w);
}

pags_result pags_decisions_put_ahead(pags_report *report, const pags_dataset *dataset) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  const bool driving = pags_dataset_fps(dataset) > 0.0, block = pags_dataset_block(dataset) != NULL;
  const pags_train_config standard = pags_train_config_default(), config = pags_config_resolve(&standard, driving);
  const int64_t alpha = pags_dataset_alpha_count(dataset);
  const bool cut_out = alpha > 0 && pags_dataset_image_alpha(dataset) == PAGS_ALPHA_COMPOSITE;
  const bool seen = pags_dataset_provides(dataset) & (PAGS_PROVIDES_SKY_MASKS | PAGS_PROVIDES_LIDAR);
  pags_json_begin_object(&w, NULL);
  if (driving)
    put(&w, "sky", seen ? OPEN : NO, seen ? "yes if it is 0.1 % of the training pixels" : "no sky masks and no LiDAR");
  else {
    begin(&w, "sky", NO,
          cut_out ? "transparent pixels show the background colour"
                  : "captures have no sky labels; Gaussians show what is far");
    if (cut_out)
      pags_json_put_integer(&w, "photographs_with_alpha", alpha);
    pags_json_end_object(&w);
  }
  char gain[96];
  snprintf(gain, sizeof gain, "yes if photographs%s gain %g dB, at 30 %% of the steps",
           driving ? " kept out of training" : "", pags_holdout_least_gain(!driving));
  put(&w, "exposure", block ? YES : OPEN, block ? "the blocks of a recording have one mean exposure" : gain);
  begin(&w, "sh", OPEN, "at most this degree, as photographs need; 0 if they have one colour");
  pags_json_put_integer(&w, "degree", config.color.sh_degree);
  pags_json_end_object(&w);
  put(&w, "camera_poses", driving && !block ? OPEN : NO,
      block     ? "the blocks of a recording keep its poses"
      : driving ? gain
                : "captures keep their poses; camera_poses=1 corrects them");
  put(&w, "light", driving && !block ? OPEN : NO,
      block     ? "the blocks of a recording keep its light"
      : driving ? gain
                : "only the cameras of a rig are calibrated");
  pags_json_end_object(&w);
  PAGS_TRY(pags_json_writer_finish(&w));
  return pags_decisions_put(report, w.data, NULL);
}
