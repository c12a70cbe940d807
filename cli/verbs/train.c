/* SPDX-License-Identifier: Apache-2.0 */
/* pags train: reconstructs a scene folder from a data set of posed photographs. Options that are fields of the
 * training configuration take type, range and help from its field table. */
#include "cli/common/ranks.h"
#include "cli/html_report/html_report.h"
#include "cli/verbs/verbs.h"
#include "cli/view/watch.h"

#include <assert.h>
#include <ctype.h>
#include <pags/train.h>
#include "base/file.h"
#include "base/log.h"
#include "base/text.h"
#include "base/vec3.h"
#include "port/port.h"

/* State of the progress callback. */
typedef struct viewers {
  pags_progress *progress;
  pags_watch *watch; /* NULL: no page */
} viewers;

/* Resources that the training took on a rank, for the report. */
typedef struct rank_share {
  int64_t bytes_sent; /* to other ranks */
  uint64_t peak_rss_bytes;
  double ms_processor; /* as in pags_train_result */
  pags_train_traffic traffic;
} rank_share;

typedef struct train_arguments {
  pags_session session;
  const char *output;
  pags_dataset_options dataset;
  int reconstruction;
  const char *preset, *prune_rate;
  pags_words set; /* of --set: NAME=VALUE each */
  int fields;
  bool view;
  int view_port;
  double view_share;
  pags_train_config config;
  pags_train_options options;
  const pags_parsed *parsed;
  rank_share *shares; /* of all ranks, on rank 0 */
  int64_t share_count;
} train_arguments;

#define AT(member) offsetof(train_arguments, member)
#define RUN(member) offsetof(train_arguments, options.member)

/* Rows made by PAGS_FIELD are incomplete here; complete_rows fills them from the training's field table before the
 * command line is parsed. */
static pags_option options[] = {
    PAGS_TEXT("output", 'o', AT(output), "SCENE", NULL, "Folder for the scene; required without --estimate."),

    PAGS_GROUP("Run"),
    PAGS_TEXT("preset", 0, AT(preset), "default|plain|paper", NULL,
              "Preset for options left at \"auto\": default; fast (smaller, less accurate); plain (as 3DGS); paper (as "
              "in arXiv:2510.12282)."),
    PAGS_FIELD("iterations", 'n', "N", "iterations"),
    PAGS_FIELD("batch", 0, "B", "batch"),
    PAGS_FLAG("resume", 0, RUN(resume), "Resume from SCENE's checkpoint, or start if there is no scene yet."),
    PAGS_FLAG("overwrite", 0, RUN(overwrite), "Start over in a SCENE folder that isn't empty."),
    PAGS_VALUE("checkpoint-every", 0, INT64, RUN(checkpoint_every), 0, PAGS_UNLIMITED, "N", NULL, NULL,
               "Write a checkpoint every N steps (0: only at the end)."),
    PAGS_VALUE("checkpoint-minutes", 0, DOUBLE, RUN(checkpoint_minutes), 0, 1e6, "M", "minutes; 0: none", NULL,
               "Also write one every M minutes."),
    PAGS_VALUE("log-every", 0, INT64, RUN(log_every), 1, PAGS_UNLIMITED, "N", "steps", NULL,
               "Add a line to SCENE/log.jsonl every N steps."),
    PAGS_VALUE("preview-every", 0, INT64, RUN(preview_every), 0, PAGS_UNLIMITED, "N", "steps", NULL,
               "Write a preview PNG every N steps (0: never); if given, also log PSNR of held-out views."),
    PAGS_VALUE("view", 0, INT, AT(view_port), 0, 65535, "[PORT]", "0: a free port", NULL,
               "Show the run with its curves in a browser on this machine (docs/view.md)."),
    PAGS_VALUE("view-share", 0, DOUBLE, AT(view_share), 0, 0.9, "S", NULL, NULL,
               "--view: maximum share of the run time spent on pictures."),
    PAGS_VALUE("time-limit", 0, DURATION, RUN(time_limit_seconds), 1, PAGS_UNLIMITED, "TIME", "90s, 30m, 2h", "",
               "Fit the number of steps to this time; not reproducible."),
    PAGS_FLAG("estimate", 0, RUN(estimate), "Run 50 steps, print the time and memory of the whole run, and exit."),
    PAGS_FIELD("seed", 0, "N", "seed"),
    PAGS_VALUE("max-bad-rows", 0, INT64, RUN(bad_rows_most), 0, PAGS_UNLIMITED, "N", "updates", NULL,
               "Fail when more than N updates aren't finite."),

    PAGS_GROUP("Photographs"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(dataset.downscale), 1, 64, "F", "times", NULL,
               "Downscale the photographs by this factor."),
    PAGS_VALUE("split-every", 0, INT, AT(dataset.split_every), 0, 1e9, "N", NULL,
               "as the data set says, else 8; driving sets 4",
               "Hold out every Nth photograph (driving sets: time step); 0: none."),
    PAGS_FLAG("reconstruction", 0, AT(reconstruction), "Train on every photograph; hold out none."),
    PAGS_TEXT("colmap", 0, AT(dataset.colmap), "FOLDER", NULL, "Read cameras and points from this COLMAP model."),
    PAGS_FLAG("allow-missing", 0, AT(dataset.allow_missing), "Skip views whose photograph or pose is missing."),
    PAGS_FLAG("undistort", 0, AT(dataset.undistort), "Also resample fisheyes and panoramas to pinhole cameras."),
    PAGS_PHOTOGRAPH_OPTIONS(AT(dataset), NULL),
    PAGS_VALUE("random-points", 0, INT64, AT(dataset.random_points), 1, 1e8, "N", NULL, NULL,
               "Initial points to match between photographs if the data set has none."),
    PAGS_VALUE("image-cache", 0, SIZE, RUN(image_cache), 1, PAGS_UNLIMITED, "SIZE", "bytes; K, M, G",
               "1G, at most a quarter of the available memory", "Memory for decoded photographs."),

    PAGS_GROUP("Driving sets (docs/driving.md)"),
    PAGS_DRIVING_OPTIONS(AT(dataset)),
    PAGS_FIELD("no-objects", 0, NULL, "objects"),
    PAGS_FIELD("no-tracks", 0, NULL, "tracks"),
    PAGS_FIELD("no-sky", 0, NULL, "sky"),
    PAGS_FIELD("no-lidar-start", 0, NULL, "lidar_start"),

    PAGS_GROUP("Size limits (docs/budgets.md)"),
    PAGS_FIELD("max-gaussians", 0, "N", "max_gaussians"),
    PAGS_VALUE("max-memory", 0, SIZE, RUN(max_memory), 0, PAGS_UNLIMITED, "SIZE", "bytes; K, M, G",
               "four fifths of the available memory, less the image cache",
               "Limit the memory for Gaussians; 0: no limit."),
    PAGS_FIELD("target-size", 0, "MB", "target_size"),

    PAGS_GROUP("Priority (docs/priority.md)"),
    PAGS_FIELD("alpha", 0, "A", "alpha"),
    PAGS_FIELD("critical-weight", 0, "W", "critical_weight"),
    PAGS_FIELD("critical-growth", 0, "G", "critical_growth"),
    PAGS_TEXT("prune-rate", 0, AT(prune_rate), "EARLY/LATE", "as in the preset",
              "Set prune_early and prune_late: share of the Gaussians that each pruning by score removes."),

    PAGS_GROUP("Model and picture"),
    PAGS_FIELD("strategy", 0, NULL, "strategy"),
    PAGS_FIELD("sh-degree", 0, "0..3", "sh_degree"),
    PAGS_FIELD("background", 0, "R,G,B", "background_r"),
    PAGS_FIELD("antialiased", 0, NULL, "antialiased"),
    PAGS_FIELD("no-exposure", 0, NULL, "exposure"),

    PAGS_GROUP("All other settings"),
    PAGS_VALUE("set", 0, WORDS, AT(set), 0, 0, "NAME=VALUE", NULL, NULL,
               "Set a training field, after the options above; repeatable."),
    PAGS_FLAG("fields", 0, AT(fields), "List all training fields with unit, range and default, and exit."),
    PAGS_SESSION_OPTIONS(train_arguments),
    {0}};

/* ---- Completing the option table ---- */

/* Completes the rows that name a training field: type, offset, range, unit, default and help come from the field table.
 * The text of a switch is imperative; the help of --no-NAME is "Don't" and that text. */
static void complete_rows(void) {
  static char negated[8][96];
  int negated_count = 0;
  static const pags_option_type types[] = {
      [PAGS_FIELD_SWITCH] = PAGS_OPTION_FLAG,   [PAGS_FIELD_INT] = PAGS_OPTION_INT,
      [PAGS_FIELD_INT64] = PAGS_OPTION_INT64,   [PAGS_FIELD_UINT64] = PAGS_OPTION_UINT64,
      [PAGS_FIELD_DOUBLE] = PAGS_OPTION_DOUBLE, [PAGS_FIELD_CHOICE] = PAGS_OPTION_ENUM};
  for (pags_option *option = options; option->type != PAGS_OPTION_END; option++) {
    if (!option->field || option->help)
      continue;
    const pags_train_field *f = pags_train_field_find(option->field);
    assert(f);
    const bool number = f->type != PAGS_FIELD_SWITCH && f->type != PAGS_FIELD_CHOICE;
    option->type = strcmp(option->field, "background_r") == 0 ? PAGS_OPTION_COLOR : types[f->type];
    option->offset = AT(config) + f->offset;
    if (number && f->type != PAGS_FIELD_UINT64) {
      option->minimum = f->least;
      option->maximum = f->most;
    }
    if (f->type == PAGS_FIELD_CHOICE)
      option->metavar = f->choices;
    option->unit = number && strcmp(f->unit, "1") != 0 ? f->unit : NULL;
    option->fallback = f->rule;
    option->help = f->text;
    if (strncmp(option->name, "no-", 3) == 0) {
      assert(negated_count < 8);
      snprintf(negated[negated_count], sizeof negated[0], "Don't %c%s", tolower((unsigned char)f->text[0]),
               f->text + 1);
      option->help = negated[negated_count++];
    }
  }
}

/* Suggests the replacement of a removed option: --densify-from, an option before --set existed, gives "--set
 * densify_from=N". Returns false if no field has that name. */
static bool replacement(const char *name, char *text, size_t size) {
  static const char *const renamed[][2] = {
      {"position_rate", "position_rate_begin"}, {"near", "near_plane"}, {"hybrid", "score"}};
  const bool off = strncmp(name, "no-", 3) == 0;
  char plain[80];
  snprintf(plain, sizeof plain, "%s", off ? name + 3 : name);
  for (char *c = plain; *c; c++)
    *c = *c == '-' ? '_' : *c;
  for (size_t i = 0; i < sizeof renamed / sizeof renamed[0]; i++)
    if (strcmp(plain, renamed[i][0]) == 0)
      snprintf(plain, sizeof plain, "%s", renamed[i][1]);
  const pags_train_field *f = pags_train_field_find(plain);
  if (!f || (off && f->type != PAGS_FIELD_SWITCH && f->type != PAGS_FIELD_INT))
    return false;
  snprintf(text, size, "--set %s=%s", f->name,
           off                            ? "0"
           : f->type == PAGS_FIELD_SWITCH ? "1"
           : f->choices                   ? f->choices
                                          : "N");
  return true;
}

/* --fields: prints the training's field table, group by group. */
static void list_fields(void) {
  enum { WIDTH = 120 };
  const pags_train_field *f;
  const char *group = "";
  printf("Training fields, for --set NAME=VALUE, with [unit; range; default].\n");
  for (int i = 0; (f = pags_train_field_at(i)); i++) {
    char left[40], text[1024], least[32], most[32], standard[96], range[96];
    if (strcmp(group, f->group) != 0)
      printf("\nGroup %s\n", f->group);
    group = f->group;
    pags_options_real(least, sizeof least, f->least);
    pags_options_real(most, sizeof most, f->most);
    pags_options_real(standard, sizeof standard, f->standard);
    snprintf(range, sizeof range, "%s; %s to %s", f->unit, least, f->type == PAGS_FIELD_UINT64 ? "2^64 - 1" : most);
    if (f->type == PAGS_FIELD_SWITCH)
      snprintf(range, sizeof range, "%s", f->unit);
    if (f->type == PAGS_FIELD_CHOICE) {
      pags_options_choice(f->choices, (int)f->standard, standard, sizeof standard);
      snprintf(range, sizeof range, "%s", f->choices);
    }
    snprintf(left, sizeof left, "  %s", f->name);
    snprintf(text, sizeof text, "%s [%s; default %s]", f->text, range, f->rule ? f->rule : standard);
    pags_options_entry(left, text, WIDTH);
  }
}

/* ---- Watching in a browser ---- */

static pags_result watch_begin(const train_arguments *arguments, pags_dataset *dataset, pags_watch **watch) {
  PAGS_AUTOFREE char *log = arguments->options.resume ? pags_path_join(arguments->output, "log.jsonl") : NULL;
  PAGS_TRY(pags_watch_create(&(pags_watch_settings){.dataset = dataset,
                                                    .name = pags_path_name(arguments->output),
                                                    .log = log,
                                                    .threads = arguments->session.threads,
                                                    .port = arguments->view_port,
                                                    .share = arguments->view_share},
                             watch));
  pags_say(&arguments->session, "Watch it in a browser:\n  %s\n", pags_watch_url(*watch));
  return PAGS_OK;
}

/* ---- Progress and results ---- */

static int show_progress(void *user, const pags_train_progress *now) {
  const viewers *both = user;
  pags_progress *progress = both->progress;
  if (both->watch && !pags_watch_step(both->watch, now))
    pags_interrupt_ask(); /* a page's stop request has the effect of Ctrl-C */
  const int go_on = !pags_interrupted();
  char eta[32], size[24] = "", bad[48] = "";
  if (!pags_progress_due(progress))
    return go_on;
  if (now->level > 1)
    snprintf(size, sizeof size, ", 1/%d size", now->level);
  if (now->bad_rows > 0)
    snprintf(bad, sizeof bad, ", %lld rows skipped", (long long)now->bad_rows);
  pags_progress_show(progress, "step %lld of %lld%s, %.1f it/s, %lld Gaussians, loss %.4f, PSNR %.2f dB%s, %s left",
                     (long long)now->step, (long long)now->iterations, size, now->it_per_second,
                     (long long)now->gaussians, now->loss, now->psnr, bad,
                     pags_format_duration(now->eta_seconds, eta, sizeof eta));
  return go_on;
}

/* Sums of the bytes and photographs of all ranks; the largest of their peaks. */
static rank_share add_up(const train_arguments *arguments) {
  rank_share sum = {0};
  for (const rank_share *one = arguments->shares; one < arguments->shares + arguments->share_count; one++) {
    sum.bytes_sent += one->bytes_sent;
    sum.peak_rss_bytes = one->peak_rss_bytes > sum.peak_rss_bytes ? one->peak_rss_bytes : sum.peak_rss_bytes;
    sum.traffic.views += one->traffic.views;
    sum.traffic.bytes_there += one->traffic.bytes_there;
    sum.traffic.bytes_back += one->traffic.bytes_back;
  }
  return sum;
}

static void put_shares(const train_arguments *arguments, pags_json_writer *writer) {
  pags_json_put_integer(writer, "ranks", arguments->share_count);
  pags_json_put_integer(writer, "bytes_sent", add_up(arguments).bytes_sent);
  pags_json_begin_array(writer, "each_rank");
  for (const rank_share *one = arguments->shares; one < arguments->shares + arguments->share_count; one++) {
    pags_json_begin_object(writer, NULL);
    pags_json_put_unsigned(writer, "peak_rss_bytes", one->peak_rss_bytes);
    pags_json_put_number(writer, "processor_ms", one->ms_processor);
    pags_json_put_integer(writer, "photographs", one->traffic.views);
    pags_json_put_integer(writer, "splats", one->traffic.splats);
    pags_json_put_integer(writer, "bytes_there", one->traffic.bytes_there);
    pags_json_put_integer(writer, "bytes_back", one->traffic.bytes_back);
    pags_json_put_integer(writer, "bytes_sent", one->bytes_sent);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
}

static pags_result write_json(const train_arguments *arguments, const pags_train_result *result) {
  pags_json_writer writer = pags_session_json_begin();
  if (arguments->options.estimate) {
    pags_json_put_number(&writer, "estimated_seconds", result->estimated_seconds);
    pags_json_put_unsigned(&writer, "estimated_bytes", result->estimated_bytes);
  }
  pags_json_put_bool(&writer, "finished", result->finished != 0);
  pags_json_put_bool(&writer, "resumed", result->resumed != 0);
  pags_json_put_integer(&writer, "iterations", result->iterations);
  pags_json_put_number(&writer, "seconds", result->seconds);
  pags_json_put_number(&writer, "seconds_watched", result->seconds_watched);
  pags_json_put_integer(&writer, "gaussians", result->gaussians);
  pags_json_put_unsigned(&writer, "peak_rss_bytes", result->peak_rss_bytes);
  pags_json_put_number(&writer, "iterations_per_second", result->iterations_per_second);
  pags_json_put_number(&writer, "loss", result->loss);
  pags_json_put_number(&writer, "psnr", result->psnr);
  pags_json_put_integer(&writer, "bad_rows", result->bad_rows);
  if (result->bad_rows > 0)
    pags_json_put_string(&writer, "first_bad_row", result->first_bad_row);
  pags_json_put_unsigned(&writer, "heap_calls_steady", result->heap_calls_steady);
  if (arguments->share_count > 0)
    put_shares(arguments, &writer);
  pags_json_begin_object(&writer, "ms");
  pags_json_put_number(&writer, "wait", result->ms_wait);
  pags_json_put_number(&writer, "forward", result->ms_forward);
  pags_json_put_number(&writer, "loss", result->ms_loss);
  pags_json_put_number(&writer, "backward", result->ms_backward);
  pags_json_put_number(&writer, "density", result->ms_density);
  pags_json_put_number(&writer, "processor", result->ms_processor);
  pags_json_end_object(&writer);
  return pags_session_json(&arguments->session, &writer);
}

static void report(const train_arguments *arguments, const pags_train_result *result) {
  const pags_session *session = &arguments->session;
  char time[32], memory[32];
  if (arguments->options.estimate) {
    pags_say(session, "%lld iterations would take about %s and %s of memory\n",
             (long long)arguments->config.schedule.iterations,
             pags_format_duration(result->estimated_seconds, time, sizeof time),
             pags_format_bytes((double)result->estimated_bytes, memory, sizeof memory));
    return;
  }
  pags_say(session, "%s: %lld Gaussians after %lld iterations; %s in this run, %.1f it/s at the end, peak memory %s\n",
           arguments->output, (long long)result->gaussians, (long long)result->iterations,
           pags_format_duration(result->seconds, time, sizeof time), result->iterations_per_second,
           pags_format_bytes((double)result->peak_rss_bytes, memory, sizeof memory));
  if (arguments->share_count > 0) {
    char sent[32], view[32], peak[32];
    const int threads = pags_tasks_workers(session->tasks);
    const rank_share all = add_up(arguments);
    const double views = all.traffic.views > 0 ? (double)all.traffic.views : 1.0;
    pags_say(session, "on %d ranks of %d %s, which sent each other %s, %s per photograph; at most %s per rank\n",
             (int)arguments->share_count, threads, threads == 1 ? "thread" : "threads",
             pags_format_bytes((double)all.bytes_sent, sent, sizeof sent),
             pags_format_bytes((double)(all.traffic.bytes_there + all.traffic.bytes_back) / views, view, sizeof view),
             pags_format_bytes((double)all.peak_rss_bytes, peak, sizeof peak));
  }
  if (result->bad_rows > 0)
    pags_say(session, "%lld updates were skipped because a value wasn't finite; the first was %s\n",
             (long long)result->bad_rows, result->first_bad_row);
}

/* ---- Training ---- */

/* Warns of options for driving sets that have no effect on a static one. */
static void warn_of_idle(const train_arguments *arguments, const pags_dataset *dataset) {
  const pags_option_rule rules[] = {{"no-objects no-tracks no-sky no-lidar-start critical-weight critical-growth",
                                     pags_dataset_fps(dataset) > 0, "driving sets"},
                                    {0}};
  char names[160];
  const pags_option_rule *idle = pags_option_idle(arguments->parsed, rules, names, sizeof names);
  if (idle)
    PAGS_WARN("%s: %s: no effect on a static set (%s), only on %s", pags_dataset_path(dataset), names,
              pags_dataset_kind(dataset), idle->needs);
}

/* Prints the data set's objects, notes, views and starting points. */
static void say_dataset(const train_arguments *arguments, const pags_dataset *dataset) {
  const pags_session *session = &arguments->session;
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  int64_t count = pags_dataset_view_count(dataset), held_out = 0, moving = 0, points;
  const float *xyz;
  const uint8_t *rgb;
  int to_match;
  for (int64_t i = 0; i < count; i++)
    held_out += pags_dataset_view(dataset, i)->test;
  pags_dataset_points(dataset, &points, &xyz, &rgb, &to_match);
  if (pags_dataset_fps(dataset) > 0) {
    const int64_t objects = pags_dataset_object_count(dataset);
    for (int64_t i = 0; i < objects; i++)
      moving += pags_dataset_object(dataset, i)->moving;
    pags_say(session, "%lld objects, %lld of them moving; %lld LiDAR sweeps\n", (long long)objects, (long long)moving,
             (long long)pags_dataset_sweep_count(dataset));
    for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
      pags_say(session, "  %s\n", pags_dataset_note(dataset, i));
  }
  const char *kind = to_match ? "points to match" : "points";
  pags_say(session, "%s: %lld views of %dx%d to train on, %lld held out, %lld %s (%s)\n", pags_dataset_path(dataset),
           (long long)(count - held_out), camera->width, camera->height, (long long)held_out, (long long)points, kind,
           pags_dataset_kind(dataset));
}

static pags_result open_dataset(const train_arguments *arguments, const char *path, pags_dataset **out) {
  PAGS_TRY(pags_dataset_open(path, &arguments->dataset, out));
  warn_of_idle(arguments, *out);
  if (pags_dataset_view_count(*out) > 0)
    say_dataset(arguments, *out);
  return pags_session_check(&arguments->session);
}

static pags_result train(train_arguments *arguments, pags_dataset *dataset, pags_train_result *result) {
  pags_train_options *chosen = &arguments->options;
  uint64_t limits[] = {chosen->max_memory, chosen->image_cache}; /* all ranks use those of rank 0 */
  PAGS_TRY(pags_transport_broadcast(pags_ranks(), 0, limits, sizeof limits));
  pags_progress progress = pags_progress_begin(arguments->session.people);
  viewers both = {.progress = &progress};
  chosen->max_memory = limits[0];
  chosen->image_cache = limits[1];
  chosen->dataset = dataset;
  chosen->output = arguments->output;
  chosen->tasks = arguments->session.tasks;
  chosen->cancel = pags_interrupt_flag();
  chosen->progress = show_progress;
  chosen->progress_user = &both;
  chosen->transport = pags_ranks();
  pags_interrupt_install(NULL); /* the trainer polls the flag and finishes its step before it stops */
  pags_result status = arguments->view ? watch_begin(arguments, dataset, &both.watch) : PAGS_OK;
  if (status == PAGS_OK)
    status = pags_train(&arguments->config, chosen, result);
  pags_progress_end(&progress);
  pags_watch_end(both.watch, status, result->finished);
  return status;
}

/* Brings the resources that each rank took to rank 0. */
static pags_result gather_shares(train_arguments *arguments, const pags_train_result *result) {
  rank_share own;
  if (!pags_ranks())
    return PAGS_OK;
  memset(&own, 0, sizeof own); /* the padding is sent, too */
  own.bytes_sent = pags_transport_counted(pags_ranks()).bytes_sent;
  own.peak_rss_bytes = result->peak_rss_bytes;
  own.ms_processor = result->ms_processor;
  own.traffic = result->traffic;
  return pags_ranks_gather(&own, 1, sizeof own, &arguments->shares, &arguments->share_count);
}

static pags_result run(void *user, const pags_parsed *parsed) {
  train_arguments *arguments = user;
  pags_session *session = &arguments->session;
  pags_train_result result = {0};
  PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = NULL;
  /* The scene records the data set's absolute path, so that eval finds it again from any folder. */
  PAGS_AUTOFREE char *absolute = pags_port_real_path(parsed->positionals[0]);
  PAGS_AUTOFREE char *command_line = pags_command_line("train", parsed->argc, parsed->argv);
  const char *path = absolute ? absolute : parsed->positionals[0];
  arguments->parsed = parsed;
  arguments->options.command_line = command_line;
  PAGS_TRY(pags_session_meet(session, open_dataset(arguments, path, &dataset)));
  PAGS_TRY(pags_session_meet(session, train(arguments, dataset, &result)));
  pags_dataset_close(pags_take(&dataset)); /* the report opens it again */
  PAGS_TRY(gather_shares(arguments, &result));
  if (pags_ranks_lead()) {
    report(arguments, &result);
    if (!arguments->options.estimate)
      pags_html_report_of_training(session, arguments->output, &arguments->dataset, &result);
    PAGS_TRY(write_json(arguments, &result));
  }
  if (result.finished || arguments->options.estimate)
    return PAGS_OK;
  return pags_fail(PAGS_CANCELLED,
                   "interrupted after iteration %lld; the state is saved in %s, --resume continues from it",
                   (long long)result.iterations, arguments->output);
}

/* ---- Checking the arguments ---- */

/* Parses --prune-rate, "EARLY/LATE" such as "0.6/0.3", into the configuration; both 0..0.99. */
static bool read_prune_rate(const char *text, double *early, double *late) {
  char *end;
  *early = pags_text_to_double(text, &end);
  if (end == text || *end != '/')
    return false;
  text = end + 1;
  *late = pags_text_to_double(text, &end);
  return end != text && !*end && *early >= 0 && *early <= 0.99 && *late >= 0 && *late <= 0.99;
}

/* Applies every --set NAME=VALUE in the order given; suggests the nearest field if NAME is unknown. */
static int apply_settings(const pags_parsed *parsed, train_arguments *arguments) {
  for (int i = 0; i < arguments->set.count; i++) {
    const char *word = arguments->set.items[i].name, *equals = strchr(word, '=');
    char name[64];
    pags_nearest nearest = {.word = name};
    snprintf(name, sizeof name, "%.*s", equals && equals - word < 63 ? (int)(equals - word) : 63, word);
    const pags_result set = equals ? pags_train_config_set(&arguments->config, name, equals + 1) : PAGS_ERROR_ARGUMENT;
    if (set == PAGS_OK)
      continue;
    if (equals && (pags_train_field_find(name) || set == PAGS_ERROR_UNSUPPORTED)) /* a field, or a former one */
      return pags_usage_error(parsed->verb, "--set %s", pags_error_message());
    const pags_train_field *f;
    for (int k = 0; (f = pags_train_field_at(k)); k++)
      pags_nearest_add(&nearest, f->name);
    if (!equals && pags_train_field_find(name))
      return pags_usage_error(parsed->verb, "--set %s: expected %s=VALUE", word, word);
    if (nearest.name)
      return pags_usage_error(parsed->verb, "--set %s: unknown training field '%s'; did you mean '%s'?", word, name,
                              nearest.name);
    return pags_usage_error(parsed->verb, "--set %s: unknown training field '%s'; 'pags train --fields' lists them",
                            word, name);
  }
  return PAGS_EXIT_OK;
}

static int usage_conflict(const train_arguments *arguments, const pags_parsed *parsed) {
  const pags_verb *verb = parsed->verb;
  const pags_train_config *c = &arguments->config;
  if (!arguments->output && !arguments->options.estimate)
    return pags_usage_error(verb, "-o SCENE is missing; usage: pags train %s", verb->usage);
  if (arguments->options.resume && arguments->options.overwrite)
    return pags_usage_error(verb, "--resume and --overwrite exclude each other");
  if (arguments->reconstruction && pags_option_given(parsed, "split-every"))
    return pags_usage_error(verb, "--reconstruction and --split-every exclude each other");
  if (pags_train_config_check(c) != PAGS_OK)
    return pags_usage_error(verb, "%s", pags_error_message());
  if (arguments->view && pags_ranks())
    return pags_usage_error(verb, "--view requires one process, but mpirun started %d",
                            pags_transport_ranks(pags_ranks()));
  if (arguments->view && arguments->session.quiet)
    return pags_usage_error(verb, "--view prints the address to open, which --quiet would suppress");
  if (arguments->view && arguments->options.estimate)
    return pags_usage_error(verb, "--view and --estimate exclude each other");
  if (!arguments->view && pags_option_given(parsed, "view-share"))
    return pags_usage_error(verb, "--view-share: no effect without --view");
  const bool never_prunes = c->schedule.preset == PAGS_PRESET_PLAIN || c->density.strategy == PAGS_STRATEGY_MCMC;
  if (arguments->prune_rate && (c->priority.prunes < 0 ? never_prunes : c->priority.prunes == 0))
    return pags_usage_error(verb, "--prune-rate: no effect, since these settings don't prune by score");
  return PAGS_EXIT_OK;
}

static int check(void *user, const pags_parsed *parsed) {
  train_arguments *arguments = user;
  pags_train_config *config = &arguments->config;
  if (arguments->preset && pags_train_config_set(config, "preset", arguments->preset) != PAGS_OK)
    return pags_usage_error(parsed->verb, "--%s", pags_error_message());
  arguments->view = pags_option_given(parsed, "view");
  if (arguments->prune_rate &&
      !read_prune_rate(arguments->prune_rate, &config->priority.prune_early, &config->priority.prune_late))
    return pags_usage_error(parsed->verb, "--prune-rate: expected EARLY/LATE, two numbers from 0 to 0.99, got '%s'",
                            arguments->prune_rate);
  if (apply_settings(parsed, arguments) || usage_conflict(arguments, parsed))
    return PAGS_EXIT_USAGE;
  if (arguments->reconstruction)
    arguments->dataset.split_every = 0;
  arguments->options.held_out = arguments->view || pags_option_given(parsed, "preview-every");
  arguments->dataset.look = 1;
  pags_copy3(config->picture.background, arguments->dataset.background);

  /* Without --max-memory and --image-cache, their defaults follow from the memory that this process may use. The
   * cache size doesn't affect the result; the limit affects only runs that would not fit. */
  pags_train_options *run = &arguments->options;
  const uint64_t available = pags_available_memory();
  if (!pags_option_given(parsed, "image-cache") && run->image_cache > available / 4)
    run->image_cache = available / 4;
  if (!pags_option_given(parsed, "max-memory")) {
    const uint64_t most = available / 5 * 4;
    run->max_memory = most > 2 * run->image_cache ? most - run->image_cache : most / 2;
  }
  return PAGS_EXIT_OK;
}

static const pags_verb verb = {
    .name = "train",
    .usage = "DATASET -o SCENE [options]",
    .about =
        "Reconstruct a scene from photographs with known cameras. Ctrl-C, SIGTERM, SIGHUP or SIGUSR1 writes a "
        "checkpoint and the current scene, and exits with 3. A run continued by --resume is bit-identical to an "
        "uninterrupted one. A number of \"steps of 30 000\" is multiplied by iterations / 30 000.",
    .positionals = {{"DATASET",
                     "Folder with transforms.json, or with a COLMAP model and images; a "
                     "transforms file; or a driving set in drivestudio's layout."}},
    .options = options,
    .replacement = replacement,
    .check = check,
    .run = run};

int pags_verb_train(int argc, char **argv) {
  train_arguments arguments = {.view_port = 8765,
                               .view_share = 0.2,
                               .dataset = pags_dataset_options_default(),
                               .config = pags_train_config_default(),
                               .options = pags_train_options_default()};
  complete_rows();
  for (int i = 0; i < argc && strcmp(argv[i], "--"); i++) /* --fields needs no DATASET */
    if (!strcmp(argv[i], "--fields")) {
      list_fields();
      return PAGS_EXIT_OK;
    }
  const int code = pags_verb_run(&verb, argc, argv, &arguments);
  free(arguments.shares);
  return code;
}
