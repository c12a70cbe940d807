/* SPDX-License-Identifier: Apache-2.0 */
/* Implements html_report.h. */
#include "cli/html_report/html_report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "cli/common/progress.h"
#include "image/encoded.h"

static pags_result write_page(const pags_session *session, const char *scene,
                              const pags_dataset_options *dataset_options, const pags_train_result *result,
                              const char *page) {
  pags_html_report_facts facts;
  pags_progress progress = pags_progress_begin(session->people);
  const pags_html_report_settings settings = {
      .scenes = {scene, NULL},
      .count = 1,
      .dataset_options = *dataset_options,
      .pictures = PAGS_REPORT_PICTURES,
      .seconds = result->finished ? fmin(fmax(result->seconds / 30, 1), 10) : 1,
      .session = session,
      .progress = &progress,
      .cancel = result->finished ? pags_interrupt_flag() : NULL, /* else the signal is known already */
  };
  const pags_result written = pags_html_report_write(&settings, page, &facts);
  pags_progress_end(&progress);
  return written;
}

void pags_html_report_of_training(const pags_session *session, const char *scene,
                                  const pags_dataset_options *dataset_options, const pags_train_result *result) {
  char *page = pags_path_join(scene, "report.html");
  const pags_result written =
      page ? write_page(session, scene, dataset_options, result, page) : pags_out_of_memory("a path");
  if (written == PAGS_OK)
    pags_say(session, "report: %s\n", page);
  else if (written == PAGS_CANCELLED)
    pags_say(session, "interrupted: no report was written; 'pags report %s' writes it\n", scene);
  else
    pags_log_message(PAGS_LOG_WARNING, "the scene was written, but its report wasn't: %s", pags_error_message());
  free(page);
}

/* Whether a word needs no quotes in a shell. */
static bool is_plain(const char *word) {
  static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./=,:+@%";
  return *word && word[strspn(word, plain)] == 0;
}

static bool put_word(pags_sink *sink, const char *word) {
  bool room = pags_sink_put(sink, " ", 1);
  if (is_plain(word))
    return room && pags_sink_put(sink, word, strlen(word));
  room = room && pags_sink_put(sink, "'", 1);
  for (; *word && room; word++)
    room = *word == '\'' ? pags_sink_put(sink, "'\\''", 4) : pags_sink_put(sink, word, 1);
  return room && pags_sink_put(sink, "'", 1);
}

char *pags_command_line(const char *verb, int argc, char *const *argv) {
  pags_sink sink = {0};
  bool room = pags_sink_put(&sink, pags_program_name, strlen(pags_program_name)) && put_word(&sink, verb);
  for (int i = 0; i < argc && room; i++)
    room = put_word(&sink, argv[i]);
  room = room && pags_sink_put(&sink, "", 1);
  if (!room) {
    free(sink.bytes);
    return NULL;
  }
  return (char *)sink.bytes;
}
