/* SPDX-License-Identifier: Apache-2.0 */
/* pags render: renders a scene or a splat file from a list of cameras into picture files, with stage times as
 * JSON. */
#include "cli/common/ranks.h"
#include "cli/common/scene_options.h"
#include "cli/draw/camera_paths.h"
#include "cli/draw/deadline_report.h"
#include "cli/draw/picture.h"
#include "cli/draw/viewpoints.h"
#include "cli/verbs/verbs.h"

#include <pags/packed.h>
#include "base/log.h"

typedef struct render_arguments {
  pags_session session;
  const char *output, *dataset, *path, *camera, *channel_list;
  int split; /* index in "train|test|all" */
  int64_t frames;
  int format, bits;
  double downscale, time, shift, fps;
  pags_object_edits edits;
  pags_crop crop;
  pags_picture_changes changes;
  int exposure, sh_degree, exp_degree; /* exp_degree: index in "3|5" */
  const char *early_z;
  int order;   /* pags_order */
  int stand;   /* pags_stand */
  int shutter; /* pags_shutter_choice */
  pags_dataset_options dataset_options;
  pags_reading reading;
  int packed;
  double budget_ms;  /* 0: none */
  unsigned channels; /* bits 1 << pags_channel, from channel_list */
} render_arguments;

#define AT(member) offsetof(render_arguments, member)

static const pags_option options[] = {
    PAGS_OUTPUT(AT(output), "FOLDER",
                "Folder for the pictures; created if missing. Files of the same name are replaced."),

    PAGS_GROUP("Views (one of --split, --path and --camera; default --path orbit)"),
    PAGS_CHOICE("split", AT(split), "train|test|all", "",
                "Render the scene's training views, its held-out views, or both."),
    PAGS_TEXT("path", 0, AT(path), "FILE|orbit|ego", "orbit",
              "Render a camera path: a path file; orbit: around the scene; ego: along the training views, smoothed, or "
              "along the recorded drive, with time running."),
    PAGS_TEXT("camera", 0, AT(camera), "FILE", NULL, "Render the view of a camera file."),
    PAGS_CHOICE("stand", AT(stand), "auto|around|inside", NULL,
                "Orbit: around the scene from outside, or inside a room; auto: near the training cameras, else "
                "whichever fits."),
    PAGS_VALUE("frames", 'n', INT64, AT(frames), 1, 1e6, "N", NULL, "120; drives: as recorded",
               "Number of frames of orbit and ego."),
    PAGS_VALUE("fps", 0, DOUBLE, AT(fps), 1e-3, 1e4, "F", "frames/s", "as recorded",
               "Frame rate of ego along a drive, instead of --frames."),
    PAGS_VALUE("shift", 0, DOUBLE, AT(shift), 0, 0, "METRES", "metres", "0",
               "Ego: offset of the cameras to their right; negative: to their left."),
    PAGS_VALUE("time", 0, DOUBLE, AT(time), 0, PAGS_UNLIMITED, "T", "seconds since the start of the scene",
               "each view's own", "Render all views at this time instead of their own."),
    PAGS_TEXT("dataset", 0, AT(dataset), "DATASET", NULL,
              "Take the views of --split from this data set instead of the scene."),
    PAGS_VALUE("split-every", 0, INT, AT(dataset_options.split_every), 0, 1e9, "N", "views; 0: none",
               "as the data set says, else 8; driving sets 4", "With --dataset: hold out every Nth view."),
    PAGS_TEXT("colmap", 0, AT(dataset_options.colmap), "FOLDER", NULL,
              "With --dataset: read cameras from this COLMAP model."),
    PAGS_FLAG("allow-missing", 0, AT(dataset_options.allow_missing),
              "With --dataset: skip views whose photograph is missing."),
    PAGS_TEXT("image-folder", 0, AT(dataset_options.image_folder), "FOLDER", NULL,
              "With --dataset: folder of its photographs."),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(downscale), 1, 64, "F", "times", NULL,
               "Downscale the pictures by this factor."),
    PAGS_CHOICE("shutter", AT(shutter), "global|rolling", "as in the cameras",
                "Expose all lines at the same time, or one after another as the scene's cameras do."),

    PAGS_GROUP("Input"),
    PAGS_READING_OPTIONS(AT(reading)),

    PAGS_GROUP("Files"),
    PAGS_CHOICE("format", AT(format), "png|exr", NULL, "png: rounded to --bits; exr: float32, display-referred sRGB."),
    PAGS_VALUE("bits", 0, INT, AT(bits), 8, 16, "8|16", "bits per channel", NULL, "Bit depth of PNG files."),
    PAGS_TEXT(
        "channel", 0, AT(channel_list), "LIST", NULL,
        "Channels to write, separated by commas: color, alpha, depth (metres), id, object, priority, normal (of depth, "
        "world axes), heat (priority as colours), crypto-object and crypto-class (Cryptomatte), expected-normal (mean "
        "of the Gaussians' normals), motion (--path only: to the frame before and after), count (Gaussians blended per "
        "pixel), overdraw (Gaussians evaluated per pixel). Each has its own file: NAME.png, NAME_alpha.png, "
        "NAME_depth.exr, ... Only color, alpha and heat can be PNG; heat always is. With object, objects.json lists "
        "the object of each number. With priority, heat is written too, unless --format exr."),

    PAGS_GROUP("Objects (OBJECT: an id listed by pags info --objects, or class:vehicle, ...)"),
    PAGS_EDIT_OPTIONS(AT(edits)),
    PAGS_CROP_OPTIONS(AT(crop)),

    PAGS_GROUP("Picture"),
    PAGS_FLAG("no-exposure", 0, AT(exposure),
              "Render without the exposure of the cameras. By default, views of --split and frames of a drive have the "
              "exposure of their camera."),
    PAGS_VALUE("background", 0, COLOR, AT(changes.background), 0, 0, "R,G,B", "sRGB, 0..1", "as in the scene",
               "Background colour."),
    PAGS_FLAG("antialiased", 0, AT(changes.antialiased),
              "Compensate opacities for the low-pass filter (the 2D filter of Mip-Splatting), even if the scene wasn't "
              "trained so."),
    PAGS_FLAG("no-antialiased", 0, AT(changes.antialiased), "Don't compensate, even if the scene was trained so."),
    PAGS_VALUE("low-pass", 0, DOUBLE, AT(changes.low_pass), 0, 100, "V", "px^2", "as in training, else 0.3",
               "Variance added to both axes of each projected Gaussian."),
    PAGS_VALUE("near", 0, DOUBLE, AT(changes.near_plane), 1e-6, PAGS_UNLIMITED, "Z", "metres",
               "as in training, else 0.01", "Skip Gaussians nearer than this."),
    PAGS_VALUE("sh-degree", 0, INT, AT(sh_degree), 0, 3, "0..3", NULL, NULL,
               "Maximum degree of the spherical harmonics of colour."),
    PAGS_CHOICE("exp-degree", AT(exp_degree), "3|5", NULL,
                "Degree of the polynomial for exp: 3 is faster (relative error 7.5e-5), 5 more accurate (4e-7)."),
    PAGS_TEXT("early-z", 0, AT(early_z), "off|lossless|bounded[=EPS]|paper", NULL,
              "Skip hidden Gaussians before they are read, shaded, sorted or binned. lossless: bit-identical to off. "
              "bounded: a pixel is full when everything behind it would change it by at most EPS (default 1/255). "
              "paper: draw nothing behind opaque critical Gaussians; less accurate."),
    PAGS_CHOICE("order", AT(order), "depth|paper", NULL,
                "Blending order: depth; paper: all critical Gaussians first, as in arXiv:2510.12282, which blends "
                "incorrectly."),
    PAGS_VALUE(
        "budget-ms", 0, DOUBLE, AT(budget_ms), 0.1, 1e6, "T", "milliseconds per frame", "none",
        "Time limit per frame: critical Gaussians keep full quality within a few grey levels, the rest is reduced as "
        "needed. Every eighth frame is compared with full quality. The pictures depend on the speed of this machine."),
    PAGS_FLAG(
        "packed", 0, AT(packed),
        "Render from the packed form: less memory, rounded values (docs/splat-files.md). Packed files always are."),
    PAGS_SESSION_OPTIONS(render_arguments),
    {0}};

/* State of a render run. */
typedef struct render_run {
  render_arguments *arguments;
  const pags_parsed *parsed;
  pags_composition *composition;
  bool packed; /* the Gaussians are rendered from their packed form */
  pags_viewpoints viewpoints;
  pags_frame *frame;
  pags_frame_options options;
  pags_picture_writer writer;
  pags_render_passes passes;
  pags_picture_queue queue;
  pags_frame_stats *stats;       /* of each finished frame */
  pags_deadline_report deadline; /* with --budget-ms */
  pags_deadline_result *report;  /* of each finished frame, with --budget-ms */
  int64_t done;                  /* frames; of this rank until the ranks' are gathered */
} render_run;

static void render_run_destroy(render_run *run) {
  pags_frame_destroy(run->frame);
  pags_picture_queue_destroy(&run->queue);
  pags_picture_writer_destroy(&run->writer);
  pags_render_passes_destroy(&run->passes);
  pags_viewpoints_destroy(&run->viewpoints);
  pags_composition_destroy(run->composition);
  pags_deadline_report_destroy(&run->deadline);
  free(run->report);
  free(run->stats);
}

/* ---- Viewpoints and frame options ---- */

static pags_result find_path(const render_run *run, const pags_scene *scene, pags_camera_path *path) {
  const render_arguments *arguments = run->arguments;
  if (arguments->camera)
    return pags_camera_path_load(arguments->camera, path);
  if (!strcmp(arguments->path, "orbit"))
    return pags_camera_path_orbit(scene, arguments->frames, (pags_stand)arguments->stand, path);
  if (strcmp(arguments->path, "ego"))
    return pags_camera_path_load(arguments->path, path);
  const int64_t asked = pags_option_given(run->parsed, "frames") ? arguments->frames : 0;
  if (pags_scene_is_drive(scene))
    PAGS_TRY(pags_camera_path_drive(scene, asked, arguments->fps, path));
  else
    PAGS_TRY(pags_camera_path_ego(scene, arguments->frames, path));
  pags_camera_path_shift(path, arguments->shift);
  return PAGS_OK;
}

static pags_result find_viewpoints(const render_run *run, const pags_scene *scene, pags_viewpoints *out) {
  const render_arguments *arguments = run->arguments;
  const bool split = pags_option_given(run->parsed, "split");
  if (split && arguments->dataset) {
    PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = NULL;
    PAGS_TRY(pags_dataset_open(arguments->dataset, &arguments->dataset_options, &dataset));
    return pags_viewpoints_of_dataset(dataset, (pags_split)arguments->split, out);
  }
  if (split)
    return pags_viewpoints_of_scene(scene, run->parsed->positionals[0], (pags_split)arguments->split, out);
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path path = {0};
  PAGS_TRY(find_path(run, scene, &path));
  PAGS_TRY(pags_viewpoints_of_path(&path, out));
  if (!arguments->camera && !strcmp(arguments->path, "ego") && pags_scene_is_drive(scene))
    for (int64_t i = 0; i < out->count; i++) { /* expose each frame as the drive's sensor was at its time */
      pags_viewpoint *v = &out->items[i];
      pags_scene_exposure(scene, pags_camera_path_drive_sensor(scene), v->camera.time, v->gain, v->offset);
    }
  return PAGS_OK;
}

static void choose_options(render_run *run) {
  const render_arguments *arguments = run->arguments;
  pags_frame_options *frame = &run->options;
  *frame = pags_composition_options(run->composition);
  pags_picture_changes_apply(&arguments->changes, run->parsed, frame);
  frame->sh_degree = arguments->sh_degree;
  frame->exp_degree = arguments->exp_degree ? 5 : 3;
  pags_early_z_parse(arguments->early_z, frame); /* `check` has checked that the value parses */
  frame->order = (pags_order)arguments->order;
  frame->extra_channels = pags_picture_writer_needs_extras(&run->writer);
  frame->keep_for_passes = (run->writer.channels & PAGS_CHANNELS_PASSES) != 0;
  frame->count_pairs = arguments->session.json != NULL;
}

/* ---- Statistics as JSON ---- */

static double total_ms(const pags_frame_stats *s) {
  return s->ms_cull + s->ms_project + s->ms_shade + s->ms_sort + s->ms_bin + s->ms_raster + s->ms_occlude;
}

static void put_stats(pags_json_writer *writer, const pags_frame_stats *s) {
#define MS(stage) {#stage, offsetof(pags_frame_stats, ms_##stage)}
#define COUNT(member) {#member, offsetof(pags_frame_stats, member)}
  static const struct {
    const char *key;
    size_t offset;
  } times[] = {MS(cull), MS(project), MS(shade), MS(sort), MS(bin), MS(raster), MS(occlude)},
    counts[] = {COUNT(gaussians),     COUNT(in_view),      COUNT(loaded),
                COUNT(hidden),        COUNT(shaded),       COUNT(binned),
                COUNT(pairs_hidden),  COUNT(pairs_binned), COUNT(pairs_evaluated),
                COUNT(pairs_blended), COUNT(clusters),     COUNT(clusters_hidden),
                COUNT(tiles),         COUNT(tiles_full),   COUNT(slabs),
                COUNT(occluders),     COUNT(held),         COUNT(beyond)};
  pags_json_begin_object(writer, "ms");
  for (size_t i = 0; i < sizeof times / sizeof *times; i++)
    pags_json_put_number(writer, times[i].key, *(const double *)((const char *)s + times[i].offset));
  pags_json_put_number(writer, "total", total_ms(s));
  pags_json_end_object(writer);
  for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
    pags_json_put_integer(writer, counts[i].key, *(const int64_t *)((const char *)s + counts[i].offset));
}

static pags_result write_json(const render_run *run, const pags_frame_stats *mean) {
  pags_json_writer writer = pags_session_json_begin();
  pags_json_put_integer(&writer, "threads", pags_tasks_workers(run->arguments->session.tasks));
  pags_json_put_integer(&writer, "gaussians", pags_composition_gaussian_count(run->composition));
  pags_json_put_integer(&writer, "bytes", (int64_t)pags_composition_bytes(run->composition));
  pags_json_begin_array(&writer, "frames");
  for (int64_t i = 0; i < run->done; i++) {
    const pags_viewpoint *viewpoint = &run->viewpoints.items[i];
    pags_json_begin_object(&writer, NULL);
    pags_json_put_string(&writer, "name", viewpoint->name);
    pags_json_put_integer(&writer, "width", viewpoint->camera.width);
    pags_json_put_integer(&writer, "height", viewpoint->camera.height);
    pags_json_put_number(&writer, "time", viewpoint->camera.time);
    put_stats(&writer, &run->stats[i]);
    if (run->report)
      pags_deadline_report_put_frame(&run->report[i], &writer);
    pags_json_end_object(&writer);
  }
  pags_json_end_array(&writer);
  if (run->report)
    pags_deadline_report_put(&run->deadline, &writer);
  pags_json_begin_object(&writer, "mean");
  put_stats(&writer, mean);
  pags_json_end_object(&writer);
  return pags_session_json(&run->arguments->session, &writer);
}

/* ---- Drawing ---- */

static pags_result draw(render_run *run, int64_t index) {
  const pags_viewpoint *viewpoint = &run->viewpoints.items[index];
  const pags_part *parts;
  int part_count;
  pags_picture picture;
  pags_passes passes = {.normal = {NULL}};
  const bool motion = run->writer.channels >> PAGS_CHANNEL_MOTION & 1;
  PAGS_TRY(pags_render_passes_moment(&run->passes, 0, motion && index > 0 ? &viewpoint[-1].camera : NULL));
  PAGS_TRY(pags_render_passes_moment(&run->passes, 1,
                                     motion && index + 1 < run->viewpoints.count ? &viewpoint[1].camera : NULL));
  pags_compose(run->composition, viewpoint->camera.time, &parts, &part_count);
  if (run->arguments->exposure) {
    run->options.photometric = viewpoint->photometric;
    pags_frame_options_expose(&run->options, viewpoint->gain, viewpoint->offset);
  }
  if (run->report) {
    PAGS_TRY(pags_deadline_report_draw(&run->deadline, parts, part_count, &viewpoint->camera, &run->options, &picture,
                                       &run->report[index]));
    run->stats[index] = run->report[index].stats;
  } else {
    PAGS_TRY(pags_frame_render(run->frame, parts, part_count, &viewpoint->camera, &run->options, NULL, NULL, &picture));
    run->stats[index] = *pags_frame_stats_get(run->frame);
  }
  if (run->options.keep_for_passes)
    PAGS_TRY(pags_render_passes_draw(&run->passes, run->frame, parts, part_count, &passes));
  PAGS_TRY(pags_picture_queue_put(&run->queue, &picture, &passes, &viewpoint->camera, viewpoint->name));
  run->done++;
  return PAGS_OK;
}

static pags_result draw_all(render_run *run) {
  const pags_session *session = &run->arguments->session;
  pags_progress progress = pags_progress_begin(session->people);
  pags_interrupt_install(session->tasks);
  const int64_t count = run->viewpoints.count;
  for (int64_t i = 0; i < count; i++) { /* all, since motion looks at the cameras before and after */
    pags_camera *camera = &run->viewpoints.items[i].camera;
    *camera = pags_camera_downscale(camera, run->arguments->downscale);
  }
  pags_result result = PAGS_OK;
  for (int64_t i = 0; result == PAGS_OK && i < count && !pags_ranks_stopping(); i++) {
    if (!pags_ranks_mine(i))
      continue;
    result = draw(run, i);
    const int64_t drawn = pags_ranks_tell(run->done, false);
    if (result == PAGS_OK && pags_progress_due(&progress))
      pags_progress_show(&progress, "frame %lld of %lld, %.1f ms each", (long long)drawn, (long long)count,
                         total_ms(&run->stats[i]));
  }
  pags_result written = pags_picture_queue_finish(&run->queue);
  pags_progress_end(&progress);
  if (written == PAGS_OK && run->done && run->writer.channels >> PAGS_CHANNEL_OBJECT & 1 && pags_ranks_lead())
    written = pags_object_table_write(pags_composition_scene(run->composition), run->arguments->output);
  const bool stopped = pags_interrupted() || pags_ranks_stopping();
  pags_ranks_tell(run->done, stopped || result != PAGS_OK || written != PAGS_OK);

  int64_t drawn = run->done;
  if (written != PAGS_OK)
    result = written;
  PAGS_TRY(pags_ranks_sum(&drawn));
  if (stopped && written == PAGS_OK && drawn < count && (result == PAGS_OK || pags_interrupted()))
    result = pags_fail(PAGS_CANCELLED, "interrupted after %lld of %lld frames; those are in %s", (long long)drawn,
                       (long long)count, run->arguments->output);
  return result;
}

/* Brings the statistics of all frames to rank 0. */
static pags_result gather_stats(render_run *run) {
  const int64_t count = run->viewpoints.count, ranks = pags_transport_ranks(pags_ranks());
  if (!pags_ranks())
    return PAGS_OK;
  PAGS_AUTOFREE pags_frame_stats *own = malloc((size_t)count * sizeof *own), *all = NULL;
  int64_t drawn = 0, gathered = 0;
  PAGS_CHECK_MEMORY(own, "%lld frames", (long long)count);
  for (int64_t i = 0; i < count; i++)
    if (pags_ranks_mine(i))
      own[drawn++] = run->stats[i];
  PAGS_TRY(pags_ranks_gather(own, drawn, sizeof *own, &all, &gathered));
  const pags_frame_stats *next = all;
  if (all)
    for (int64_t rank = 0; rank < ranks; rank++)
      for (int64_t i = rank; i < count; i += ranks)
        run->stats[i] = *next++;
  run->done = count;
  return PAGS_OK;
}

/* ---- Opening the scene ---- */

static pags_result find_work(render_run *run, const pags_scene *scene, pags_edit_list *edits) {
  const render_arguments *arguments = run->arguments;
  pags_viewpoints *viewpoints = &run->viewpoints;
  PAGS_TRY(find_viewpoints(run, scene, viewpoints));
  PAGS_TRY(pags_shutter_choose(
      pags_option_given(run->parsed, "shutter") ? (pags_shutter_choice)arguments->shutter : PAGS_SHUTTER_AS_RECORDED,
      scene, viewpoints));
  if (pags_option_given(run->parsed, "time")) {
    /* Set --time for all viewpoints. A time up to one frame interval after the last frame is allowed, since a drive's
     * last frame lasts as long as any other. */
    const double span = scene->time_end - scene->time_begin;
    if (arguments->time > span + (scene->fps > 0 ? 1 / scene->fps : 0) + 1e-6)
      return pags_fail(PAGS_ERROR_ARGUMENT, "--time: the scene lasts from 0 to %g s; got %g", span, arguments->time);
    for (int64_t i = 0; i < viewpoints->count; i++)
      viewpoints->items[i].camera.time = scene->time_begin + arguments->time;
  }
  return pags_object_edits_find(&arguments->edits, scene, edits);
}

/* Opens a packed file (.pagsz), which is memory-mapped, not read. A packed file has neither views nor objects. */
static pags_result open_packed(render_run *run, const char *path, pags_edit_list *edits) {
  const render_arguments *arguments = run->arguments;
  if (pags_filter_is_set(&arguments->crop.filter))
    return pags_fail(PAGS_ERROR_UNSUPPORTED,
                     "%s: a packed file can't be cropped; give the same options to pags export when you write it",
                     path);
  if (!arguments->camera && (!strcmp(arguments->path, "orbit") || !strcmp(arguments->path, "ego")))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a packed file has no views: expected --camera FILE or --path FILE",
                     path);
  if (arguments->reading.axes)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a packed file's axes are known: expected no --axes", path);
  PAGS_TRY(pags_composition_open_packed(path, &run->composition));
  run->packed = true;
  return find_work(run, pags_composition_scene(run->composition), edits);
}

/* Loads a scene. Views, times and edits are resolved before the composition is made, so that errors in them are found
 * before the Gaussians are sorted. */
static pags_result open_scene(render_run *run, const char *path, pags_edit_list *edits) {
  const render_arguments *arguments = run->arguments;
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_TRY(pags_reading_load(&arguments->reading, path, &scene));
  PAGS_TRY(pags_crop_apply(&arguments->crop, &scene, scene.time_begin + arguments->time, NULL, &arguments->session));
  PAGS_TRY(find_work(run, &scene, edits));
  PAGS_TRY(pags_composition_create(&scene, &run->composition));
  run->packed = arguments->packed;
  return run->packed ? pags_composition_pack(run->composition) : PAGS_OK;
}

/* ---- The verb ---- */

static pags_result prepare(render_run *run) {
  enum { CHECK_EVERY = 8 }; /* frames compared with full quality, with --budget-ms */
  render_arguments *arguments = run->arguments;
  pags_tasks *tasks = arguments->session.tasks;
  const char *path = run->parsed->positionals[0];
  PAGS_AUTO(pags_edit_list_destroy) pags_edit_list edits = {0};
  PAGS_TRY(pags_packed_is_file(path) ? open_packed(run, path, &edits) : open_scene(run, path, &edits));
  PAGS_TRY(pags_composition_edit(run->composition, edits.items, edits.count));
  PAGS_TRY(pags_session_check(&arguments->session));
  PAGS_TRY(pags_picture_writer_create(run->composition, arguments->channels, (pags_picture_format)arguments->format,
                                      arguments->bits, &run->writer));
  run->passes = (pags_render_passes){.composition = run->composition, .writer = &run->writer};
  choose_options(run);
  const int64_t count = run->viewpoints.count;
  run->stats = calloc((size_t)count, sizeof *run->stats);
  PAGS_CHECK_MEMORY(run->stats, "%lld frames", (long long)count);
  PAGS_TRY(pags_frame_create(tasks, &run->frame));
  if (arguments->budget_ms > 0) {
    run->report = calloc((size_t)count + 1, sizeof *run->report);
    PAGS_CHECK_MEMORY(run->report, "%lld frames", (long long)count);
    PAGS_TRY(pags_deadline_report_create(run->composition, tasks, arguments->budget_ms, CHECK_EVERY, &run->deadline));
  }
  PAGS_TRY(pags_picture_queue_create(&run->writer, tasks, arguments->output, &run->queue));
  return pags_prepare_folder(&arguments->session, arguments->output);
}

static pags_result run_render(void *user, const pags_parsed *parsed) {
  render_arguments *arguments = user;
  pags_session *session = &arguments->session;
  PAGS_AUTO(render_run_destroy) render_run run = {.arguments = arguments, .parsed = parsed};
  PAGS_TRY(pags_session_meet(session, prepare(&run)));
  PAGS_TRY(pags_session_meet(session, draw_all(&run)));
  PAGS_TRY(gather_stats(&run));
  if (!pags_ranks_lead())
    return PAGS_OK;
  int64_t shown = 0;
  pags_frame_stats mean = {0};
  for (int64_t i = 0; i < run.done; i++) {
    shown += run.stats[i].binned > 0;
    pags_frame_stats_add(&mean, &run.stats[i]);
  }
  pags_frame_stats_divide(&mean, run.done ? (double)run.done : 1); /* counts are rounded down */
  if (!shown && run.done)
    PAGS_WARN("%s: nothing of the scene is in view in any of %lld pictures", arguments->output, (long long)run.done);

  /* Print the mean times and the statistics of --budget-ms and --packed. */
  const int threads = pags_tasks_workers(session->tasks);
  const int64_t count = pags_composition_gaussian_count(run.composition);
  char of_ranks[32] = "";
  if (pags_ranks())
    snprintf(of_ranks, sizeof of_ranks, "%d ranks of ", pags_transport_ranks(pags_ranks()));
  pags_say(session,
           "%s: %lld %s of %lld Gaussians, %.2f ms each (cull %.2f, project %.2f, shade %.2f, sort %.2f, bin %.2f, "
           "raster %.2f) on %s%d %s\n",
           arguments->output, (long long)run.done, run.done == 1 ? "frame" : "frames", (long long)count,
           total_ms(&mean), mean.ms_cull, mean.ms_project, mean.ms_shade, mean.ms_sort, mean.ms_bin, mean.ms_raster,
           of_ranks, threads, threads == 1 ? "thread" : "threads");
  if (run.report)
    pags_deadline_report_print(&run.deadline, session);
  const double bytes = (double)pags_composition_bytes(run.composition);
  if (run.packed)
    pags_say(session, "packed: %.1f MB, %.1f bytes per Gaussian\n", bytes * 1e-6, count ? bytes / (double)count : 0.0);
  return write_json(&run, &mean);
}

static int check(void *user, const pags_parsed *parsed) {
  render_arguments *arguments = user;
  const pags_verb *verb = parsed->verb;
  const bool split = pags_option_given(parsed, "split"), png = arguments->format == PAGS_PICTURE_PNG;
  const bool along = !split && !arguments->camera;
  const bool orbit = along && !strcmp(arguments->path, "orbit"), ego = along && !strcmp(arguments->path, "ego");
  const pags_option_rule rules[] = {
      {"split-every colmap allow-missing image-folder", arguments->dataset != NULL, "--dataset"},
      {"shift fps", ego, "--path ego"},
      {"frames", orbit || ego, "--path orbit or ego"},
      {"stand", orbit, "--path orbit"},
      {"bits", png, "--format png"},
      {0}};
  if (split + pags_option_given(parsed, "path") + pags_option_given(parsed, "camera") > 1)
    return pags_usage_error(verb, "--split, --path and --camera exclude each other");
  if (arguments->dataset && !split)
    return pags_usage_error(verb, "--dataset needs --split");
  if (arguments->bits != 8 && arguments->bits != 16)
    return pags_usage_error(verb, "--bits: expected 8 or 16, got '%d'", arguments->bits);
  char unknown[80];
  if (!pags_channels_parse(arguments->channel_list, &arguments->channels, unknown, sizeof unknown))
    return pags_usage_error(verb,
                            "--channel: expected color, alpha, depth, id, object, priority, normal, heat, "
                            "crypto-object, crypto-class, expected-normal, motion, count or overdraw, got '%s'",
                            unknown);
  pags_frame_options early_z;
  if (pags_early_z_parse(arguments->early_z, &early_z) != PAGS_OK)
    return pags_usage_error(verb, "--%s", pags_error_message());
  const bool paper = early_z.early_z == PAGS_EARLY_Z_PAPER, budget = arguments->budget_ms > 0;
  if (budget && (paper || arguments->order != 0))
    return pags_usage_error(verb, "--budget-ms excludes --early-z paper and --order paper");
  if (budget && pags_ranks())
    return pags_usage_error(verb,
                            "--budget-ms: requires one process, since the quality of a frame depends on the times of "
                            "earlier frames; mpirun started several");
  if (arguments->channels & PAGS_CHANNELS_PASSES && (budget || paper))
    return pags_usage_error(verb,
                            "--channel crypto-object, crypto-class, expected-normal, motion, count and overdraw "
                            "exclude --budget-ms and --early-z paper");
  if (arguments->channels >> PAGS_CHANNEL_MOTION & 1 && (split || arguments->camera))
    return pags_usage_error(verb, "--channel motion: requires consecutive pictures: expected --path instead of %s",
                            arguments->camera ? "--camera" : "--split");
  if (arguments->channels >> PAGS_CHANNEL_PRIORITY & 1 && png)
    arguments->channels |= 1u << PAGS_CHANNEL_HEAT;
  if (pags_options_check_effect(parsed, rules))
    return PAGS_EXIT_USAGE;
  if (arguments->fps > 0 && pags_option_given(parsed, "frames"))
    return pags_usage_error(verb, "--fps and --frames exclude each other");
  if (pags_crop_check(parsed, &arguments->crop))
    return PAGS_EXIT_USAGE;
  return pags_object_edits_check(parsed, &arguments->edits);
}

static const pags_verb verb = {
    .name = "render",
    .usage = "SCENE [--split train|test|all | --path FILE|orbit|ego | --camera FILE] -o FOLDER [options]",
    .about =
        "Render pictures of a scene or a splat file. Pictures are named after the photographs of their views, or "
        "00000, 00001, ... --json adds milliseconds per stage and counts for every frame; counting costs a few per "
        "cent of speed.",
    .positionals = {{"SCENE",
                     "Scene folder, or splat file: .ply (also compressed), .spz, .splat, .pagsz (memory-mapped)."}},
    .options = options,
    .check = check,
    .run = run_render};

int pags_verb_render(int argc, char **argv) {
  pags_frame_options standard = pags_frame_options_default();
  render_arguments arguments = {.path = "orbit",
                                .channel_list = "color",
                                .early_z = "lossless",
                                .frames = 120,
                                .bits = 8,
                                .exposure = 1,
                                .downscale = 1,
                                .sh_degree = standard.sh_degree,
                                .exp_degree = standard.exp_degree == 5,
                                .dataset_options = pags_dataset_options_default()};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
