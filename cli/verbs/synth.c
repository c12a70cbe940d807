/* SPDX-License-Identifier: Apache-2.0 */
/* pags synth: generates data with ground truth: a street (a ray-traced driving set) or a town (a scene of Gaussians).
 */
#include "cli/verbs/verbs.h"

#include <pags/synth.h>

/* Options of both kinds are stored here; make_street and make_town copy them into the kind's own options. -1: the
 * default of the kind. */
typedef struct synth_arguments {
  pags_session session;
  const char *output, *size;
  int width, height, samples, overwrite;
  uint64_t seed;
  pags_street_options street;
  pags_words faults; /* NAME=VALUE each */
  int frames;        /* -1: the default of the kind */
  pags_town_options town;
  pags_town_facts town_facts;
} synth_arguments;

#define AT(member) offsetof(synth_arguments, member)

static const pags_option options[] = {
    PAGS_OUTPUT(AT(output), "FOLDER", "Folder for the data set or the town's scene."),
    PAGS_FLAG("overwrite", 0, AT(overwrite), "Write into a folder that isn't empty."),
    PAGS_TEXT("size", 0, AT(size), "WxH", "street 480x270, town 960x540",
              "Width and height of each picture in pixels."),
    PAGS_VALUE("samples", 0, INT, AT(samples), 1, 1024, "N", "rays per pixel", "8",
               "Street: more samples give smoother edges."),
    PAGS_VALUE("seed", 0, UINT64, AT(seed), 0, 0, "N", NULL, NULL, "Seed of all random numbers."),
    PAGS_GROUP("Street"),
    PAGS_VALUE("frames", 0, INT, AT(frames), 1, 10000, "N", "time steps", "street 40, town 24",
               "Number of time steps. Street: about one metre each; town: evenly spaced along its middle street."),
    PAGS_VALUE("fps", 0, DOUBLE, AT(street.fps), 0.1, 1000, "R", "frames/s", NULL, "Recording rate, at about 10 m/s."),
    PAGS_VALUE("cameras", 0, INT, AT(street.cameras), 1, 3, "N", NULL, NULL,
               "Number of cameras: front; front left; front right."),
    PAGS_VALUE("objects", 0, INT, AT(street.objects), 0, 64, "N", NULL, NULL,
               "Number of moving cars, pedestrians and cyclists."),
    PAGS_VALUE("lidar-points", 0, INT64, AT(street.lidar_points), 0, 1e6, "N", "rays", NULL, "LiDAR rays per sweep."),
    PAGS_VALUE("lidar-noise", 0, DOUBLE, AT(street.lidar_noise), 0, 10, "M", "metres", NULL,
               "Standard deviation of the error of each range."),
    PAGS_VALUE("pose-noise", 0, DOUBLE, AT(street.pose_noise), 0, 10, "M", "metres", NULL,
               "Standard deviation of the error added to x and y of the boxes of moving objects."),
    PAGS_VALUE("yaw-noise", 0, DOUBLE, AT(street.yaw_noise), 0, 180, "A", "degrees", NULL,
               "Standard deviation of the error added to their yaw."),
    PAGS_FLAG("lively", 0, AT(street.lively), "Make the recording car brake, accelerate and swerve."),
    PAGS_FLAG("no-shifts", 0, AT(street.shifts),
              "Don't write the ground-truth pictures from 1, 2 and 3 m to the right and 1 m up."),
    PAGS_VALUE("fault", 0, WORDS, AT(faults), 0, 0, "NAME=VALUE", NULL, NULL,
               "Fault of the cameras; repeatable. rolling-down, -up, -right, -left: readout time in that direction, "
               "seconds; delay: standard deviation of each camera's delay, seconds; position, angle: pose error of the "
               "car, metres and degrees; mount-position, mount-angle: error of each camera's mounting; vignette: share "
               "of light lost in the corners; response: exponent less 1; distortion: k1; fisheye: degrees across."),
    PAGS_GROUP("Town"),
    PAGS_VALUE("gaussians", 0, INT64, AT(town.gaussians), 1000, 2e8, "N", "Gaussians", NULL,
               "Number at density 1; it determines the size of the town."),
    PAGS_VALUE("density", 0, DOUBLE, AT(town.density), 0.05, 20, "F", "times", NULL,
               "Multiply the Gaussians on the same surfaces; 1: 150 per square metre, as in trained streets."),
    PAGS_SESSION_OPTIONS(synth_arguments),
    {0}};

/* Options of both kinds; those that weren't given keep the kind's default. */
static void share_options(const synth_arguments *a, int *width, int *height, int *frames) {
  *width = a->width > 0 ? a->width : *width;
  *height = a->height > 0 ? a->height : *height;
  *frames = a->frames > 0 ? a->frames : *frames;
}

static pags_result make_street(synth_arguments *a, pags_progress *progress) {
  pags_street_options *o = &a->street;
  share_options(a, &o->width, &o->height, &o->frames);
  o->samples = a->samples;
  o->seed = a->seed;
  o->overwrite = a->overwrite;
  return pags_synth_street(a->output, o, a->session.tasks, pags_progress_watch, progress);
}

static pags_result make_town(synth_arguments *a, pags_progress *progress) {
  pags_town_options *o = &a->town;
  share_options(a, &o->width, &o->height, &o->frames);
  o->seed = a->seed;
  o->overwrite = a->overwrite;
  return pags_synth_town(a->output, o, a->session.tasks, pags_progress_watch, progress, &a->town_facts);
}

static void tell_street(const synth_arguments *a, double seconds, pags_json_writer *json) {
  const pags_street_options *o = &a->street;
  pags_say(&a->session, "%s: %d frames of %d cameras, %dx%d, in %.1f s\n", a->output, o->frames, o->cameras, o->width,
           o->height, seconds);
  pags_json_put_integer(json, "frames", o->frames);
  pags_json_put_integer(json, "cameras", o->cameras);
  pags_json_put_integer(json, "width", o->width);
  pags_json_put_integer(json, "height", o->height);
  pags_json_put_integer(json, "objects", o->objects);
}

static void tell_town(const synth_arguments *a, double seconds, pags_json_writer *json) {
  const pags_town_facts *f = &a->town_facts;
  pags_say(&a->session,
           "%s: %lld Gaussians, %d streets and %d blocks on %.0f x %.0f m, %.0f per visible square metre, %d views of "
           "%dx%d, in %.1f s\n",
           a->output, (long long)f->gaussians, f->streets, f->blocks, f->length, f->breadth,
           (double)f->gaussians / f->square_metres, 3 * a->town.frames, a->town.width, a->town.height, seconds);
  pags_json_put_integer(json, "gaussians", f->gaussians);
  pags_json_put_integer(json, "streets", f->streets);
  pags_json_put_integer(json, "blocks", f->blocks);
  pags_json_put_number(json, "length", f->length);
  pags_json_put_number(json, "breadth", f->breadth);
  pags_json_put_number(json, "square_metres", f->square_metres);
  pags_json_put_number(json, "gaussians_per_square_metre", (double)f->gaussians / f->square_metres);
  pags_json_put_integer(json, "views", 3 * a->town.frames);
}

static const struct kind {
  const char *name;
  pags_result (*make)(synth_arguments *arguments, pags_progress *progress);
  void (*tell)(const synth_arguments *arguments, double seconds, pags_json_writer *json);
  const char *foreign[16]; /* options that are an error for this kind */
} kinds[] = {{"street", make_street, tell_street, {"gaussians", "density"}},
             {"town",
              make_town,
              tell_town,
              {"samples", "fps", "cameras", "objects", "lidar-points", "lidar-noise", "pose-noise", "yaw-noise",
               "lively", "no-shifts", "fault"}}};
enum { KIND_COUNT = sizeof kinds / sizeof kinds[0] };

static const struct kind *find_kind(const char *name) {
  for (int i = 0; i < KIND_COUNT; i++)
    if (!strcmp(kinds[i].name, name))
      return &kinds[i];
  return NULL;
}

static int check(void *user, const pags_parsed *parsed) {
  synth_arguments *arguments = user;
  const struct kind *kind = find_kind(parsed->positionals[0]);
  if (!kind)
    return pags_usage_error(parsed->verb, "KIND: expected street or town, got '%s'", parsed->positionals[0]);
  for (int i = 0; kind->foreign[i]; i++)
    if (pags_option_given(parsed, kind->foreign[i]))
      return pags_usage_error(parsed->verb, "--%s: not an option of KIND %s", kind->foreign[i], kind->name);
  for (int i = 0; i < arguments->faults.count; i++)
    if (pags_street_faults_set(&arguments->street.faults, arguments->faults.items[i].name) != PAGS_OK)
      return pags_usage_error(parsed->verb, "--fault: %s", pags_error_message());
  char rest;
  if (arguments->size &&
      (sscanf(arguments->size, "%5dx%5d%c", &arguments->width, &arguments->height, &rest) != 2 ||
       arguments->width < 16 || arguments->width > 8192 || arguments->height < 16 || arguments->height > 8192))
    return pags_usage_error(parsed->verb, "--size: expected WIDTHxHEIGHT, each 16..8192, got '%s'", arguments->size);
  return PAGS_EXIT_OK;
}

static pags_result run(void *user, const pags_parsed *parsed) {
  synth_arguments *arguments = user;
  const struct kind *kind = find_kind(parsed->positionals[0]);
  pags_progress progress = pags_progress_begin(arguments->session.people);
  pags_interrupt_install(arguments->session.tasks);
  const double begun = pags_seconds();
  const pags_result result = kind->make(arguments, &progress);
  pags_progress_end(&progress);
  if (result == PAGS_CANCELLED)
    return pags_fail(result, "interrupted; %s is not complete", arguments->output);
  PAGS_TRY(result);
  const double seconds = pags_seconds() - begun;
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "kind", kind->name);
  kind->tell(arguments, seconds, &json);
  pags_json_put_number(&json, "seconds", seconds);
  return pags_session_json(&arguments->session, &json);
}

static const pags_verb verb = {
    .name = "synth",
    .usage = "KIND -o FOLDER [options]",
    .about =
        "Generate data with ground truth. street: a ray-traced driving set in drivestudio's layout with poses, LiDAR, "
        "tracks and masks; truth/ has the exact tracks, depth, object ids and pictures from shifted cameras. town: a "
        "scene for rendering and benchmarks, with Gaussians on houses, roads, trees and cars; their sizes and "
        "opacities are distributed as in a trained street. Output is bit-identical for any number of threads.",
    .positionals = {{"KIND", "street: recorded by a driving car; town: a scene of Gaussians on streets and houses."}},
    .options = options,
    .check = check,
    .run = run};

int pags_verb_synth(int argc, char **argv) {
  synth_arguments arguments = {.width = -1,
                               .height = -1,
                               .samples = 8,
                               .frames = -1,
                               .town = pags_town_options_default(),
                               .street = pags_street_options_default()};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
