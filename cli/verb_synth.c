/* pags synth: data sets with known truth, ray-traced. */
#include "interrupt.h"
#include "session.h"
#include "verbs.h"

#include <pags/synth.h>
#include <string.h>

typedef struct synth_arguments {
  pags_session session;
  const char *output;
  pags_synth_options options;
} synth_arguments;

#define AT(member) offsetof(synth_arguments, member)

static const pags_option options[] = {
    {.name = "output",
     .short_name = 'o',
     .required = true,
     .type = PAGS_OPTION_STRING,
     .offset = AT(output),
     .metavar = "DATASET",
     .help = "folder to write the data set to"},
    PAGS_FLAG("overwrite", 0, AT(options.overwrite), "write into a folder that is not empty"),
    PAGS_VALUE("width", 0, INT, AT(options.width), 16, 8192, "N", "pixels", NULL, "of each picture"),
    PAGS_VALUE("height", 0, INT, AT(options.height), 16, 8192, "N", "pixels", NULL, "of each picture"),
    PAGS_VALUE("views", 'n', INT, AT(options.views), 3, 10000, "N", "pictures", NULL, "evenly around the scene"),
    PAGS_VALUE("samples", 0, INT, AT(options.samples), 1, 1024, "N", "rays a pixel", NULL, "more give smoother edges"),
    PAGS_VALUE("points", 0, INT64, AT(options.points), 0, 1e7, "N", NULL, NULL, "coloured surface points, points.ply"),
    PAGS_FLAG("depth", 0, AT(options.depth), "write the true depth of each picture too, depth/NAME.exr, in metres"),
    PAGS_VALUE("seed", 0, UINT64, AT(options.seed), 0, 0, "N", NULL, NULL, "of textures and points"),
    PAGS_SESSION_OPTIONS(synth_arguments),
    {0}};

typedef pags_result make_fn(const char *folder, const pags_synth_options *options, pags_tasks *tasks,
                            pags_progress_fn *progress, void *user);

static const struct kind {
  const char *name;
  make_fn *make;
} kinds[] = {{"room", pags_synth_room}};
enum { KIND_COUNT = sizeof kinds / sizeof kinds[0] };

static const pags_positional positionals[] = {
    {"KIND", "room: a courtyard with boxes and balls, seen from cameras that go around"}, {NULL, NULL}};

static const pags_verb verb = {
    .name = "synth",
    .usage = "KIND -o DATASET [options]",
    .about =
        "Writes a data set with known truth: ray-traced pictures, transforms.json, surface points and, if asked for, "
        "depth. The same bytes for any number of threads.",
    .positionals = positionals,
    .options = options};

static int show_progress(void *user, double fraction, const char *what) {
  pags_progress *progress = user;
  if (pags_progress_due(progress))
    pags_progress_show(progress, "%s: %.0f %%", what, 100 * fraction);
  return !pags_interrupted();
}

static pags_result make(synth_arguments *arguments, const struct kind *kind) {
  pags_progress progress = pags_progress_begin(arguments->session.people);
  pags_json_writer writer;
  pags_interrupt_install(arguments->session.tasks);
  double begun = pags_seconds();
  pags_result result =
      kind->make(arguments->output, &arguments->options, arguments->session.tasks, show_progress, &progress);
  pags_progress_end(&progress);
  if (result != PAGS_OK)
    return result == PAGS_CANCELLED ? pags_fail(result, "interrupted; %s is no whole data set", arguments->output)
                                    : result;
  double seconds = pags_seconds() - begun;
  pags_say(&arguments->session, "%s: %d pictures of %dx%d in %.1f s\n", arguments->output, arguments->options.views,
           arguments->options.width, arguments->options.height, seconds);
  pags_json_writer_init(&writer, 2);
  pags_json_begin_object(&writer, NULL);
  pags_json_put_string(&writer, "kind", kind->name);
  pags_json_put_integer(&writer, "views", arguments->options.views);
  pags_json_put_integer(&writer, "width", arguments->options.width);
  pags_json_put_integer(&writer, "height", arguments->options.height);
  pags_json_put_integer(&writer, "points", arguments->options.points);
  pags_json_put_number(&writer, "seconds", seconds);
  pags_json_end_object(&writer);
  return pags_session_json(&arguments->session, &writer);
}

int pags_verb_synth(int argc, char **argv) {
  synth_arguments arguments = {.options = pags_synth_options_default()};
  const struct kind *kind = NULL;
  pags_parsed parsed;
  pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  for (int i = 0; i < KIND_COUNT; ++i)
    if (!strcmp(kinds[i].name, parsed.positionals[0]))
      kind = &kinds[i];
  if (!kind)
    return pags_usage_error(&verb, "KIND: expected room, got '%s'", parsed.positionals[0]);
  pags_result result = pags_session_begin(&arguments.session);
  if (result == PAGS_OK)
    result = make(&arguments, kind);
  return pags_session_end(&arguments.session, result);
}
