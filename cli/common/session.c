/* SPDX-License-Identifier: Apache-2.0 */
/* The start and end of every verb: threads, quiet mode, the destination of --json, the warnings, the error line and the
 * exit code; checks that outputs can be written before the work starts. */
#include "cli/common/session.h"

#include "cli/common/ranks.h"

#include <errno.h>
#include <stdarg.h>
#include "base/file.h"
#include "base/log.h"
#include "base/text.h"
#include "port/port.h"

/* ---- Warnings ---- */

static pthread_mutex_t warnings_lock = PTHREAD_MUTEX_INITIALIZER;

/* Stores a line; false if it was stored before (an input may be opened twice). If memory is short, the line is printed
 * but missing in --json. */
static bool keep_line(pags_lines *lines, const char *line) {
  for (int64_t i = 0; i < lines->count; i++)
    if (!strcmp(lines->items[i], line))
      return false;
  if (pags_grow(&lines->items, lines->count + 1, &lines->capacity, sizeof *lines->items)) {
    lines->items[lines->count] = pags_text_copy(line);
    lines->count += lines->items[lines->count] != NULL;
  }
  return true;
}

static void free_lines(pags_lines *lines) {
  for (int64_t i = 0; i < lines->count; i++)
    free(lines->items[i]);
  free(lines->items);
}

static void receive_log(void *user, pags_log_level level, const char *line) {
  pags_session *session = user;
  const bool warning = level == PAGS_LOG_WARNING;
  if (level == PAGS_LOG_DEBUG)
    return;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&warnings_lock);
  const bool fresh = keep_line(warning ? &session->warnings : &session->notes, line);
  if (fresh && session->people && !warning)
    fprintf(session->people, "%s\n", line);
  if (fresh && session->people && warning)
    pags_output_flush(session->people); /* so that the warning comes after what was printed before it */
  if (fresh && warning && pags_ranks_lead())
    fprintf(stderr, "warning: %s\n", line);
}

pags_result pags_session_check(const pags_session *session) {
  const pags_lines *warnings = &session->warnings;
  if (!session->strict || !warnings->count)
    return PAGS_OK;
  if (warnings->count == 1)
    return pags_fail(PAGS_ERROR_FORMAT, "%s (an error because of --strict)", warnings->items[0]);
  return pags_fail(PAGS_ERROR_FORMAT, "%s; and %lld more (errors because of --strict)", warnings->items[0],
                   (long long)warnings->count - 1);
}

/* Gathers the warnings of all ranks on rank 0, which prints the new ones. */
static pags_result gather_warnings(pags_session *session) {
  const pags_lines *warnings = &session->warnings;
  size_t size = 1;
  for (int64_t i = 0; i < warnings->count; i++)
    size += strlen(warnings->items[i]) + 1;
  PAGS_AUTOFREE char *own = malloc(size);
  char *end = own;
  if (!own)
    return pags_transport_give_up(pags_ranks(), pags_out_of_memory("%lld warnings", (long long)warnings->count));
  if (!pags_ranks_lead())
    for (int64_t i = 0; i < warnings->count; i++)
      end += snprintf(end, size - (size_t)(end - own), "%s", warnings->items[i]) + 1;
  PAGS_AUTOFREE char *all = NULL;
  int64_t bytes;
  const pags_result result = pags_ranks_gather(own, end - own, 1, &all, &bytes);
  for (const char *line = all; line && line < all + bytes; line += strlen(line) + 1)
    receive_log(session, PAGS_LOG_WARNING, line);
  return result;
}

pags_result pags_session_meet(pags_session *session, pags_result result) {
  if (!pags_ranks() || session->parted)
    return result;
  char message[1024];
  result = pags_transport_agree(pags_ranks(), result);
  snprintf(message, sizeof message, "%s", pags_error_message());
  const pags_result gathered = gather_warnings(session);
  session->parted = result != PAGS_OK || gathered != PAGS_OK;
  return result == PAGS_OK ? gathered : pags_fail(result, "%s", message);
}

/* ---- Start and end ---- */

pags_result pags_session_begin(pags_session *session) {
  bool json_on_stdout = session->json && !strcmp(session->json, "-");
  session->people = session->quiet || !pags_ranks_lead() ? NULL : json_on_stdout ? stderr : stdout;
  pags_log_set(receive_log, session);
  if (!pags_port_is_writable(stdout) && pags_ranks_lead()) {
    if (json_on_stdout || (session->people && session->answers && !session->json))
      return pags_fail(PAGS_ERROR_IO,
                       "standard output is closed, but the result goes there; expected an open one, or --json FILE");
    session->people = session->people == stdout ? NULL : session->people;
  }
  if (session->json && !json_on_stdout && pags_ranks_lead())
    PAGS_TRY(pags_check_writable(session->json));
  session->tasks = pags_tasks_create(session->threads);
  return session->tasks ? PAGS_OK : pags_fail(PAGS_ERROR_MEMORY, "can't start %d threads", session->threads);
}

int pags_session_end(pags_session *session, pags_result result) {
  pags_interrupt_install(NULL);
  pags_tasks_destroy(session->tasks);
  session->tasks = NULL;
  pags_lock_release(session->lock);
  session->lock = NULL;
  pags_log_set(NULL, NULL);
  if (session->people)
    pags_output_flush(session->people);
  if (result == PAGS_OK)
    result = pags_session_check(session);
  result = pags_session_meet(session, result);
  free_lines(&session->warnings);
  free_lines(&session->notes);
  if (result == PAGS_OK)
    return PAGS_EXIT_OK;
  if (pags_transport_speaks(pags_ranks()))
    fprintf(stderr, "%s: %s\n", pags_program_name, pags_error_message());
  return result == PAGS_CANCELLED && (pags_interrupted() || pags_ranks()) ? PAGS_EXIT_INTERRUPTED : PAGS_EXIT_FAILED;
}

int pags_verb_run(const pags_verb *verb, int argc, char **argv, void *arguments) {
  pags_session *session = arguments;
  pags_parsed parsed;
  const pags_parse_status status = pags_options_parse(verb, argc, argv, arguments, &parsed);
  if (status == PAGS_PARSE_USAGE || (status == PAGS_PARSE_HELP && !parsed.check_only))
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  if (verb->check && verb->check(arguments, &parsed))
    return PAGS_EXIT_USAGE;
  if (parsed.check_only)
    return PAGS_EXIT_OK;
  pags_result result = pags_session_begin(session);
  if (result == PAGS_OK)
    result = verb->run(arguments, &parsed);
  return pags_session_end(session, result);
}

void pags_say(const pags_session *session, const char *format, ...) {
  va_list list;
  if (!session->people)
    return;
  va_start(list, format);
  vfprintf(session->people, format, list);
  va_end(list);
  pags_output_flush(session->people);
}

pags_json_writer pags_session_json_begin(void) {
  pags_json_writer writer = {.indent = 2};
  pags_json_begin_object(&writer, NULL);
  return writer;
}

pags_result pags_session_json(const pags_session *session, pags_json_writer *writer) {
  pags_result result = PAGS_OK;
  pags_json_begin_array(writer, "warnings");
  for (int64_t i = 0; i < session->warnings.count; i++)
    pags_json_put_string(writer, NULL, session->warnings.items[i]);
  pags_json_end_array(writer);
  pags_json_end_object(writer);
  if (session->json && !strcmp(session->json, "-")) {
    result = pags_json_writer_finish(writer);
    if (result == PAGS_OK && (fwrite(writer->data, 1, writer->size, stdout) != writer->size || fflush(stdout)))
      result = pags_fail(PAGS_ERROR_IO, "standard output: %s", strerror(errno));
  } else if (session->json) {
    result = pags_json_writer_save(writer, session->json);
  }
  pags_json_writer_destroy(writer);
  return result;
}

/* ---- Outputs ---- */

/* Tests whether files can be created in a folder by creating and removing one. This also detects full and read-only
 * file systems, which permission bits don't show. */
static pags_result try_create(const char *folder, const char *shown) {
  PAGS_AUTOFREE char *pattern = pags_path_join(folder, ".pags-XXXXXX");
  PAGS_CHECK_MEMORY(pattern, NULL);
  return pags_port_try_file(pattern) ? PAGS_OK
                                     : pags_fail(PAGS_ERROR_IO, "%s: can't write there: %s", shown, strerror(errno));
}

pags_result pags_check_writable(const char *path) {
  PAGS_AUTOFREE char *target = NULL;
  bool straight;
  PAGS_TRY(pags_file_find_target(path, &target, &straight));
  PAGS_AUTOFREE char *folder = pags_path_folder(target);
  PAGS_CHECK_MEMORY(folder, NULL);
  return straight ? PAGS_OK : try_create(folder, path);
}

pags_result pags_prepare_folder(pags_session *session, const char *path) {
  if (!pags_ranks_lead())
    return PAGS_OK;
  PAGS_TRY(pags_lock_folder(path, &session->lock));
  return try_create(path, path);
}

pags_result pags_prepare_file(pags_session *session, const char *path) {
  PAGS_TRY(pags_check_writable(path));
  return pags_lock_file(path, &session->lock);
}

void pags_stem(const char *name, char *out, size_t size) {
  const char *base = pags_path_is_inside(name) ? name : pags_path_name(name);
  size_t length = strlen(base) - strlen(pags_path_extension(base));
  if (length == 0)
    length = strlen(base);
  snprintf(out, size, "%.*s", (int)(length < size ? length : size - 1), base);
}
