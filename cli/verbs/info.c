/* SPDX-License-Identifier: Apache-2.0 */
/* pags info: recognises a file or folder by its content (data set, scene, splat file, camera, path, checkpoint,
 * image) and reports what it holds. */
#include "cli/measure/info.h"
#include "cli/measure/decisions.h"
#include "cli/verbs/verbs.h"

#include <errno.h>
#include <pags/image.h>
#include <pags/scene.h>
#include <strings.h>
#include "base/file.h"
#include "base/log.h"
#include "base/text.h"
#include "base/vec3.h"
#include "dataset/find_file.h"
#include "dataset/unsupported_formats.h"
#include "port/port.h"
#include "scene/other_formats.h"
#include "train/checkpoint.h"

typedef struct info_arguments {
  pags_session session;
  int memory, objects;
  const char *overlay, *sheet;
  pags_dataset_options options;
  pags_reading reading;
  const pags_parsed *parsed;
} info_arguments;

#define AT(member) offsetof(info_arguments, member)

static const pags_option options[] = {
    PAGS_FLAG("memory", 0, AT(memory),
              "Scenes and splat files: print bytes per Gaussian for storage, rendering (measured on one frame) and "
              "training."),
    PAGS_FLAG("objects", 0, AT(objects), "Scenes: list every object."),
    PAGS_TEXT("overlay", 0, AT(overlay), "FOLDER", NULL,
              "Driving sets: draw boxes (with a cross on the front; parked objects dim) and LiDAR (red near, blue far) "
              "onto the photographs of at most 20 time steps, and report how well they agree."),
    PAGS_TEXT("sheet", 0, AT(sheet), "FILE", NULL,
              "Data sets: write a contact sheet of all cameras with a map from above (.png, .jpg)."),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(options.downscale), 1, 64, "F", "times", NULL, "Data sets: as for train."),
    PAGS_VALUE("split-every", 0, INT, AT(options.split_every), 0, 1e9, "N", "views; 0: none",
               "as the data set says, else 8; driving sets 4", "Data sets: as for train."),
    PAGS_TEXT("colmap", 0, AT(options.colmap), "FOLDER", NULL, "Data sets: as for train."),
    PAGS_FLAG("allow-missing", 0, AT(options.allow_missing), "Data sets: as for train."),
    PAGS_FLAG("undistort", 0, AT(options.undistort), "Data sets: as for train."),
    PAGS_TEXT("image-folder", 0, AT(options.image_folder), "FOLDER", NULL, "Data sets: as for train."),
    PAGS_CHOICE("image-alpha", AT(options.image_alpha), "composite|mask|ignore", NULL, "Data sets: as for train."),
    PAGS_GROUP("Driving sets, as for train"),
    PAGS_DRIVING_OPTIONS(AT(options)),
    PAGS_GROUP("Splat files"),
    PAGS_READING_OPTIONS(AT(reading)),
    PAGS_SESSION_OPTIONS(info_arguments),
    {0}};

/* ---- Scenes, data sets and cameras ---- */

typedef enum info_kind { INFO_SCENE, INFO_DATASET, INFO_OTHER } info_kind;

/* Refuses options for other kinds of input. */
static pags_result check_effect(const info_arguments *arguments, const char *path, info_kind kind) {
  static const char *const kinds[] = {"a scene or splat file", "a data set", "such a file"};
  const pags_option_rule rules[] = {{"memory objects up axes", kind == INFO_SCENE, "scenes and splat files"},
                                    {"overlay sheet downscale split-every colmap allow-missing undistort image-folder "
                                     "image-alpha kind cameras frames holdout-camera ego-mask critical sfm",
                                     kind == INFO_DATASET, "data sets"},
                                    {0}};
  char names[256];
  const pags_option_rule *idle = pags_option_idle(arguments->parsed, rules, names, sizeof names);
  if (!idle)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "%s: %s: no effect on %s, only on %s", path, names, kinds[kind], idle->needs);
}

static pags_result describe_scene(pags_report *report, const info_arguments *arguments, const char *path) {
  const pags_scene_facts_options chosen = {arguments->session.tasks, arguments->memory, arguments->objects,
                                           arguments->reading};
  PAGS_TRY(check_effect(arguments, path, INFO_SCENE));
  return pags_scene_facts(report, path, &chosen);
}

static void put_categories(pags_report *report, const char *key, const pags_dataset *dataset, int moving) {
  int64_t counts[4] = {0}, sum = 0;
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    counts[object->category] += (object->moving != 0) == moving;
    sum += (object->moving != 0) == moving;
  }
  pags_report_begin_group(report, key);
  pags_report_count(report, "all", sum);
  for (int c = 0; c < 4; c++)
    if (counts[c])
      pags_report_count(report, pags_category_name((pags_category)c), counts[c]);
  pags_report_end_group(report);
}

static pags_result describe_dataset(pags_report *report, info_arguments *arguments, const char *path) {
  PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = NULL;
  int64_t points, held_out = 0, masked = 0;
  const float *xyz;
  const uint8_t *rgb;
  int to_match;
  PAGS_TRY(check_effect(arguments, path, INFO_DATASET));
  PAGS_TRY(pags_dataset_open(path, &arguments->options, &dataset));
  const pags_place place = pags_dataset_place(dataset);
  const int64_t count = pags_dataset_view_count(dataset);
  for (int64_t i = 0; i < count; i++) {
    held_out += pags_dataset_view(dataset, i)->test;
    masked += pags_dataset_view(dataset, i)->mask_path != NULL;
  }
  pags_dataset_points(dataset, &points, &xyz, &rgb, &to_match);
  pags_report_text(report, "kind", "data set");
  pags_report_text(report, "format", pags_dataset_kind(dataset));
  pags_report_count(report, "views_train", count - held_out);
  pags_report_count(report, "views_test", held_out);
  pags_report_count(report, "views_missing", pags_dataset_missing(dataset));
  if (masked)
    pags_report_count(report, "views_masked", masked);
  if (count) {
    pags_report_count(report, "width", pags_dataset_view(dataset, 0)->camera.width);
    pags_report_count(report, "height", pags_dataset_view(dataset, 0)->camera.height);
  }
  pags_report_count(report, "points", points);
  pags_report_flag(report, "points_random", to_match != 0);
  pags_report_text(report, "up", pags_up_name(pags_dataset_up(dataset)));
  pags_report_vector(report, "origin", pags_dataset_origin(dataset), 3);
  pags_report_place(report, &place);
  if (pags_dataset_fps(dataset) > 0) { /* a driving set */
    pags_report_number(report, "fps", pags_dataset_fps(dataset));
    put_categories(report, "objects_moving", dataset, 1);
    put_categories(report, "objects_parked", dataset, 0);
    pags_report_count(report, "lidar_sweeps", pags_dataset_sweep_count(dataset));
    pags_report_begin_list(report, "notes");
    for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
      pags_report_sentence(report, pags_dataset_note(dataset, i));
    pags_report_end_list(report);
  }
  PAGS_TRY(pags_decisions_put_ahead(report, dataset));
  if (arguments->overlay)
    PAGS_TRY(pags_overlay(dataset, arguments->overlay, &arguments->session, report));
  return arguments->sheet ? pags_sheet(dataset, arguments->sheet, &arguments->session, report) : PAGS_OK;
}

static pags_result describe_cameras(pags_report *report, const info_arguments *arguments, const char *path) {
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path cameras = {0};
  PAGS_TRY(check_effect(arguments, path, INFO_OTHER));
  PAGS_TRY(pags_camera_path_load(path, &cameras));
  const pags_camera *first = &cameras.cameras[0];
  double position[3];
  pags_pose_position(first->world_from_camera, position);
  pags_report_text(report, "kind", cameras.fps > 0 ? "path" : "camera");
  if (cameras.fps > 0)
    pags_report_number(report, "fps", cameras.fps);
  pags_report_count(report, "frames", cameras.count);
  pags_report_count(report, "width", first->width);
  pags_report_count(report, "height", first->height);
  pags_report_vector(report, "fx_fy_cx_cy", (double[]){first->fx, first->fy, first->cx, first->cy}, 4);
  pags_report_vector(report, "position", position, 3);
  return PAGS_OK;
}

static pags_result describe_image(pags_report *report, const info_arguments *arguments, const char *path) {
  int width, height;
  uint64_t bytes;
  PAGS_TRY(check_effect(arguments, path, INFO_OTHER));
  PAGS_TRY(pags_image_size(path, &width, &height));
  PAGS_TRY(pags_file_size(path, &bytes));
  pags_report_text(report, "kind", "image");
  pags_report_count(report, "width", width);
  pags_report_count(report, "height", height);
  pags_report_bytes(report, "bytes", (double)bytes);
  return PAGS_OK;
}

static pags_result describe_checkpoint(pags_report *report, const info_arguments *arguments, const char *path) {
  pags_checkpoint_facts checkpoint;
  uint64_t bytes;
  PAGS_TRY(check_effect(arguments, path, INFO_OTHER));
  PAGS_TRY(pags_file_size(path, &bytes));
  PAGS_TRY(pags_checkpoint_inspect(path, &checkpoint));
  pags_report_text(report, "kind", "checkpoint");
  pags_report_count(report, "gaussians", checkpoint.gaussians);
  pags_report_count(report, "models", checkpoint.models);
  pags_report_bytes(report, "bytes", (double)bytes);
  pags_report_count(report, "sh_degree", checkpoint.sh_degree);
  pags_report_count(report, "step", checkpoint.step);
  pags_report_count(report, "last_step", checkpoint.stop);
  pags_report_count(report, "views_train", checkpoint.views);
  pags_report_number(report, "loss", checkpoint.loss);
  return PAGS_OK;
}

/* ---- Recognising a file and the verb ---- */

/* First bytes of a kind of file. */
typedef struct magic {
  const char *bytes;
  size_t length;
} magic;

static const magic images[] = {
    {"\x89PNG", 4}, {"\xff\xd8\xff", 3}, {"\x76\x2f\x31\x01", 4}, {"II*\0", 4}, {"MM\0*", 4}};
static const magic splats[] = {{"ply", 3}, {"NGSP", 4}, {"glTF", 4}, {"PK", 2}, {"\x1f\x8b", 2}};
enum { MAGICS = 5 };

static bool begins_as(const unsigned char *head, const magic kinds[MAGICS]) {
  for (int i = 0; i < MAGICS; i++)
    if (!memcmp(head, kinds[i].bytes, kinds[i].length))
      return true;
  return false;
}

/* A JSON file is a transforms file (a data set) if its frames have matrices; a camera or path file if it has sizes and
 * frames or focal lengths, or is one of INRIA or nerfstudio; a splat file if it is the meta.json of a SOG or a glTF;
 * else the data set's reader names it. */
static pags_result describe_json(pags_report *report, info_arguments *arguments, const char *path) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_file(path, &json));
  const pags_json_value *root = pags_json_root(json), *frames = pags_json_member(root, "frames");
  const pags_json_value *const format = pags_json_member(root, "format");
  if (format && format->type == PAGS_JSON_STRING && !strcmp(format->text, "pags-checkpoint-shards")) {
    const pags_json_value *shards; /* of a checkpoint of several ranks (train/shards.h) */
    int64_t step, models;
    PAGS_TRY(pags_json_integer(json, root, "step", 0, INT64_MAX, &step));
    PAGS_TRY(pags_json_integer(json, root, "models", 1, INT32_MAX, &models));
    PAGS_TRY(pags_json_array(json, root, "shards", &shards));
    pags_report_text(report, "kind", "checkpoint");
    pags_report_count(report, "models", models);
    pags_report_count(report, "shards", shards->count);
    pags_report_count(report, "step", step);
    return PAGS_OK;
  }
  if (frames && frames->first && pags_json_member(frames->first, "transform_matrix"))
    return describe_dataset(report, arguments, path);
  if ((pags_json_member(root, "means") && pags_json_member(root, "quats")) ||
      (pags_json_member(root, "asset") && pags_json_member(root, "buffers")))
    return describe_scene(report, arguments, path);
  PAGS_TRY(pags_unsupported_splats_check(path, NULL, 0, root));
  const bool cameras = (frames && frames->first && frames->first->type == PAGS_JSON_OBJECT) ||
                       pags_json_member(root, "width") || pags_json_member(root, "fx") ||
                       pags_cameras_are_inria(root) || pags_cameras_are_nerfstudio(root);
  return cameras ? describe_cameras(report, arguments, path) : describe_dataset(report, arguments, path);
}

/* Whether a zip archive is a SOG: the directory at its end names a meta.json and pictures (WebP). */
static bool is_sog_archive(const char *path) {
  enum { END_BYTES = 1 << 14 };
  static const char *const names[] = {"meta.json", ".webp"};
  char end[END_BYTES];
  bool found[2] = {false};
  uint64_t bytes;
  PAGS_AUTO(pags_file_close) FILE *file = pags_file_size(path, &bytes) == PAGS_OK ? pags_port_open(path, "rb") : NULL;
  if (!file)
    return false;
  const int64_t first = bytes > END_BYTES ? (int64_t)bytes - END_BYTES : 0;
  const size_t got = pags_port_seek(file, first, SEEK_SET) ? fread(end, 1, END_BYTES, file) : 0;
  for (int k = 0; k < 2; k++)
    for (size_t i = 0; i + strlen(names[k]) <= got && !found[k]; i++)
      found[k] = memcmp(end + i, names[k], strlen(names[k])) == 0;
  return found[0] && found[1];
}

/* Whether a file is a splat file by its name or, if it is an archive, by what it holds. */
static bool is_splat(const char *path, const unsigned char *head) {
  static const char *const endings[] = {".ply", ".spz", ".splat", ".pagsz", ".sog", ".glb", ".gltf"};
  for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
    if (strcasecmp(pags_path_extension(path), endings[i]) == 0)
      return true;
  return memcmp(head, "PK", 2) == 0 && is_sog_archive(path);
}

/* Whether a folder is a scene. A folder of photographs with the output of another program in it is a data set. */
static bool is_scene_folder(const char *path) {
  static const char *const captures[] = {"dataset.json", "transforms.json", "transforms_train.json", "sparse"};
  const char *const kind = pags_scene_folder_kind(path);
  bool capture = false;
  for (size_t i = 0; i < sizeof captures / sizeof *captures; i++)
    capture |= pags_folder_has_entry(path, captures[i]);
  if (!kind || strcmp(kind, "training output") != 0 || !capture)
    return kind != NULL;
  pags_log_message(PAGS_LOG_INFO,
                   "%s: a data set that also contains a training output: render and export take that one", path);
  return false;
}

/* Reads the first 16 bytes, zero-filled if the file is shorter. */
static pags_result read_head(const char *path, unsigned char head[17], size_t *got) {
  PAGS_AUTO(pags_file_close) FILE *file = pags_port_open(path, "rb");
  memset(head, 0, 17);
  if (!file)
    return pags_fail(PAGS_ERROR_IO, "%s: %s", path, strerror(errno));
  *got = fread(head, 1, 16, file);
  if (ferror(file))
    return pags_fail(PAGS_ERROR_IO, "%s: can't be read", path);
  return *got ? PAGS_OK : pags_fail_at(path, "is empty");
}

static pags_result describe(pags_report *report, info_arguments *arguments, const char *path) {
  unsigned char head[17];
  size_t got = 0;
  if (pags_dir_exists(path))
    return is_scene_folder(path) ? describe_scene(report, arguments, path) : describe_dataset(report, arguments, path);
  PAGS_TRY(read_head(path, head, &got));
  if (begins_as(head, images) || (!memcmp(head, "RIFF", 4) && !memcmp(head + 8, "WEBP", 4)) ||
      pags_is_picture_name(pags_path_name(path))) /* the extension, for other formats (BMP, HDR, ...) */
    return describe_image(report, arguments, path);
  if (!memcmp(head, "PAGSRUN", 7))
    return describe_checkpoint(report, arguments, path);
  const size_t blanks = strspn((const char *)head, " \t\r\n\xef\xbb\xbf"); /* head ends with a zero */
  if (head[blanks] == '{' || head[blanks] == '[')
    return describe_json(report, arguments, path);

  /* Anything else is a file of another program, which the data set's reader names, or a splat file, whose loader
   * recognises the format. */
  const bool named = is_splat(path, head), known = named || begins_as(head, splats);
  if (!named && (!known || memcmp(head, "PK", 2) == 0))
    PAGS_TRY(pags_unsupported_splats_check(path, head, got, NULL));
  if (!named && pags_unsupported_knows(path))
    return describe_dataset(report, arguments, path);
  if (!named)
    PAGS_TRY(pags_unsupported_recording_check(path, true));
  const pags_result result = describe_scene(report, arguments, path);
  if (result != PAGS_ERROR_FORMAT || known)
    return result;
  PAGS_AUTOFREE char *why = pags_text_copy(pags_error_message());
  return pags_fail(result, "%s; info also takes data sets, scenes, cameras, paths, checkpoints and pictures",
                   why ? why : path);
}

static pags_result run(void *user, const pags_parsed *parsed) {
  info_arguments *arguments = user;
  arguments->parsed = parsed;
  PAGS_AUTO(pags_report_destroy) pags_report report = pags_report_begin();
  PAGS_TRY(describe(&report, arguments, parsed->positionals[0]));
  PAGS_TRY(pags_session_check(&arguments->session));
  return pags_report_end(&report, &arguments->session);
}

static const pags_verb verb = {
    .name = "info",
    .usage = "ANY [--memory] [--objects] [--overlay FOLDER] [--sheet FILE] [--json FILE|-]",
    .about = "Recognise a file or folder by its content and describe it.",
    .positionals = {{"ANY", "Data set, scene folder, splat file, camera or path file, checkpoint or image."}},
    .options = options,
    .run = run};

int pags_verb_info(int argc, char **argv) {
  info_arguments arguments = {.session = {.answers = true}, .options = pags_dataset_options_default()};
  arguments.options.look = 1;
  return pags_verb_run(&verb, argc, argv, &arguments);
}
