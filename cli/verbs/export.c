/* SPDX-License-Identifier: Apache-2.0 */
/* pags export: writes a scene's proxy geometry (glTF), its Gaussians (splat files), or both (USD). */
#include "cli/common/scene_options.h"
#include "cli/scene_html/write.h"
#include "cli/verbs/verbs.h"

#include <math.h>
#include <pags/export.h>
#include <strings.h>
#include "base/file.h"

typedef struct export_arguments {
  pags_session session;
  pags_proxy_options proxy;
  pags_splat_options splat;
  int splats;
  double time;
  pags_words only;
  pags_crop crop;
  int level, naming, stand, form, spz_axes; /* spz_axes: index in "rub|rdf" */
  uint64_t target_size;
  pags_reading reading;
} export_arguments;

#define AT(member) offsetof(export_arguments, member)

static const pags_option options[] = {
    PAGS_GROUP("Proxies (.glb, .gltf; with the Gaussians, .usda, .usdz)"),
    PAGS_CHOICE("proxy", AT(level), "mesh|cage|hull|box|convex", NULL,
                "Shape of each object: its surface, a subdivided closed cage, its convex hull, its labelled box, or up "
                "to 8 convex parts."),
    PAGS_FLAG(
        "collision", 0, AT(proxy.collision),
        "Write collision shapes alone: convex parts (or another --proxy), the ground as a slab, what is closed of "
        "the background; no colours. Limits of triangles, unless given: 3,000 of the ground's upper side, 12,000 "
        "of the rest of the background."),
    PAGS_FLAG("lod", 0, AT(proxy.lod),
              "Write mesh, cage, hull and box into one file with MSFT_lod, instead of --proxy."),
    PAGS_CHOICE(
        "naming", AT(naming), "plain|unreal|godot", NULL,
        "Node names from which an importer makes collision shapes: UCX_NAME_00 and UBX_NAME_00 (unreal), -col and "
        "-convcolonly (godot). Hulls, boxes and convex parts are then written in addition to the visible surface."),
    PAGS_VALUE("only", 0, WORDS, AT(only), 0, 0, "OBJECT,...", NULL, NULL,
               "Export only these objects: ids listed by pags info --objects, or class:vehicle, ...; repeatable."),
    PAGS_VALUE("triangles", 0, INT64, AT(proxy.triangles), 12, 1e7, "N", "triangles", NULL,
               "Maximum per object's mesh or hull."),
    PAGS_VALUE("cage-level", 0, INT, AT(proxy.cage_level), 0, 3, "0..3", "subdivisions", NULL,
               "Subdivision of the cage as written; 0: the cage itself."),
    PAGS_FLAG("no-background", 0, AT(proxy.background),
              "Export only labelled objects, without ground and background chunks."),
    PAGS_CHOICE(
        "background", AT(form), "blocks|surface", NULL,
        "Buildings and walls as closed blocks that reach the ground, or the background's surface as it was seen, "
        "open and by chunk."),
    PAGS_TEXT("ground-file", 0, AT(proxy.ground_file), "FILE.ply", "none",
              "Write the ground's mesh to this file as well, without colours, for physics."),
    PAGS_VALUE("ground-triangles", 0, INT64, AT(proxy.ground_triangles), 2, 1e8, "N", "triangles", NULL,
               "Maximum for the ground."),
    PAGS_VALUE("chunk-triangles", 0, INT64, AT(proxy.chunk_triangles), 12, 1e8, "N", "triangles", NULL,
               "Maximum for all background chunks together."),
    PAGS_VALUE("chunk", 0, DOUBLE, AT(proxy.chunk), 2, 1000, "M", "metres", "20; splat files: a quarter of the side",
               "Side of a background chunk."),
    PAGS_VALUE("voxel", 0, DOUBLE, AT(proxy.voxel), 1e-4, 2, "M", "metres", "0.15; splat files: by extent",
               "Voxel size of the background surface."),
    PAGS_VALUE("range", 0, DOUBLE, AT(proxy.range), 0.1, 10000, "M", "metres", "60; splat files: a third of the side",
               "Leave out background farther than this from the cameras."),
    PAGS_CHOICE(
        "stand", AT(stand), "auto|around|inside", NULL,
        "For scenes without photographs: find the surface from viewpoints around the scene, or inside a room. around: "
        "photographs of an object become one closed mesh, too."),
    PAGS_VALUE(
        "texture", 0, INT, AT(proxy.texture), 64, 8192, "SIDE", "pixels per side", "none",
        "Bake one texture atlas of at most this size for all surfaces, cages and chunks, instead of vertex colours."),
    PAGS_FLAG("cameras", 0, AT(proxy.cameras), "Add the training views as cameras, and the path of the recording car."),
    PAGS_FLAG("invisible", 0, AT(proxy.visibility), "Hide the proxies in readers that support KHR_node_visibility."),
    PAGS_FLAG("physics", 0, AT(proxy.physics), "Make objects kinematic bodies with KHR_physics_rigid_bodies."),
    PAGS_GROUP("Gaussians (.ply, .spz, .sog, .splat, .pagsz; .glb and .gltf with --splats)"),
    PAGS_FLAG("splats", 0, AT(splats), "Write the Gaussians instead, with KHR_gaussian_splatting."),
    PAGS_FLAG("tracks", 0, AT(splat.tracks), "With --splats: one node per object, with its track as animation."),
    PAGS_VALUE("time", 0, DOUBLE, AT(time), 0, PAGS_UNLIMITED, "T", "seconds since the start of the scene", NULL,
               "Place objects where they are at this time."),
    PAGS_VALUE("sh-degree", 0, INT, AT(splat.sh_degree), 0, 3, "0..3", NULL, NULL,
               "Maximum degree of the spherical harmonics of colour; higher degrees are dropped."),
    PAGS_VALUE("spz-version", 0, INT, AT(splat.spz_version), 3, 4, "3|4", NULL, NULL,
               "Version of .spz. 3: gzip; 4: zstd."),
    PAGS_CHOICE("spz-axes", AT(spz_axes), "rub|rdf", NULL,
                "Axes of .spz, named in a record of the file: rub, as specified; rdf, as PLY, for programs that ignore "
                "the record and expect rdf (splat-transform, SuperSplat)."),
    PAGS_GROUP("Web page (.html): the scene with a player; works offline"),
    PAGS_VALUE("target-size", 0, SIZE, AT(target_size), 0, 0, "SIZE", "bytes", "none",
               "Maximum file size. View-dependent colour is dropped first, then the Gaussians that contribute least to "
               "the pictures. --sh-degree applies as well."),
    PAGS_CROP_OPTIONS(AT(crop)),
    PAGS_GROUP("Input"),
    PAGS_READING_OPTIONS(AT(reading)),
    PAGS_SESSION_OPTIONS(export_arguments),
    {0}};

/* ---- Exporting proxies ---- */

enum { MOST_STAGES = 16 };

/* The time that each stage of an export took, by what its progress says. */
typedef struct stage_times {
  pags_progress progress;
  double since; /* when the last one in the list began */
  int count;    /* at least 1 while it watches */
  const char *names[MOST_STAGES];
  double seconds[MOST_STAGES];
} stage_times;

/* Ends the last stage, and begins `what` (NULL: none). */
static void begin_stage(stage_times *times, const char *what) {
  const double now = pags_seconds();
  if (times->count)
    times->seconds[times->count - 1] += now - times->since;
  times->since = now;
  if (what && times->count < MOST_STAGES)
    times->names[times->count++] = what;
}

static int watch_stages(void *user, double fraction, const char *what) {
  stage_times *times = user;
  if (strcmp(times->names[times->count - 1], what) != 0)
    begin_stage(times, what);
  return pags_progress_watch(&times->progress, fraction, what);
}

/* Prints size, distances to the Gaussians and back, silhouette IoU and observed share. */
static void say_proxy(const pags_session *session, const pags_proxy_facts *proxy) {
  pags_say(session, "%-28s %-5s %7lld triangles", proxy->name, pags_proxy_level_name(proxy->level),
           (long long)proxy->triangles);
  if (!isnan(proxy->to_gaussians.mean))
    pags_say(session, ", to Gaussians %.3f (p95 %.3f, max %.2f), back %.3f (%.3f, %.2f) m", proxy->to_gaussians.mean,
             proxy->to_gaussians.p95, proxy->to_gaussians.max, proxy->from_gaussians.mean, proxy->from_gaussians.p95,
             proxy->from_gaussians.max);
  if (!isnan(proxy->silhouette_iou))
    pags_say(session, ", IoU %.3f", proxy->silhouette_iou);
  pags_say(session, ", %s, observed %.0f %%%s%s\n", proxy->closed ? "watertight" : "open", 100 * proxy->observed,
           proxy->note ? "; " : "", proxy->note ? proxy->note : "");
}

static pags_result export_proxies(export_arguments *arguments, const pags_scene *scene, const char *path) {
  const pags_session *session = &arguments->session;
  stage_times times = {.progress = pags_progress_begin(session->people)};
  const double begun = pags_seconds();
  PAGS_AUTO(pags_proxy_report_destroy) pags_proxy_report report = {0};
  begin_stage(&times, "views of the scene");
  const pags_result result =
      pags_export_proxies(scene, path, &arguments->proxy, session->tasks, watch_stages, &times, &report);
  begin_stage(&times, NULL);
  pags_progress_end(&times.progress);
  PAGS_TRY(result);
  int64_t triangles = 0;
  for (int64_t i = 0; i < report.count; i++) {
    say_proxy(session, &report.proxies[i]);
    triangles += report.proxies[i].triangles;
  }
  const double seconds = pags_seconds() - begun;
  pags_say(session, "%s: %lld proxies, %lld triangles, %.1f s\n", path, (long long)report.count, (long long)triangles,
           seconds);
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "file", path);
  pags_json_put_number(&json, "seconds", seconds);
  pags_json_begin_object(&json, "stages");
  for (int i = 0; i < times.count; i++)
    pags_json_put_number(&json, times.names[i], times.seconds[i]);
  pags_json_end_object(&json);
  pags_json_begin_array(&json, "proxies");
  for (int64_t i = 0; i < report.count; i++) {
    pags_json_begin_object(&json, NULL);
    pags_json_put_string(&json, "name", report.proxies[i].name);
    pags_proxy_facts_put(&json, &report.proxies[i]);
    pags_json_end_object(&json);
  }
  pags_json_end_array(&json);
  return pags_session_json(session, &json);
}

/* Finds the objects that --only names, or all objects if a crop may remove some: one byte per object, 1 if chosen; NULL
 * without these options: all. */
static pags_result choose(const export_arguments *arguments, const pags_scene *scene, uint8_t **chosen) {
  const pags_object_edits words = {.without = arguments->only};
  PAGS_AUTO(pags_edit_list_destroy) pags_edit_list edits = {0};
  *chosen = NULL;
  if (!arguments->only.count && !arguments->crop.box && !arguments->crop.sphere)
    return PAGS_OK;
  PAGS_TRY(pags_object_edits_find(&words, scene, &edits));
  *chosen = calloc((size_t)scene->object_count + 1, 1);
  PAGS_CHECK_MEMORY(*chosen, "%lld objects", (long long)scene->object_count);
  for (int64_t i = 0; i < edits.count; i++)
    (*chosen)[edits.items[i].object] = 1;
  if (!arguments->only.count)
    memset(*chosen, 1, (size_t)scene->object_count);
  return PAGS_OK;
}

/* ---- Exporting Gaussians ---- */

static pags_result export_gaussians(const export_arguments *arguments, pags_scene *scene, const char *path, bool usd) {
  const pags_session *session = &arguments->session;
  pags_progress progress = pags_progress_begin(session->people);
  const double begun = pags_seconds();
  int64_t count;
  char took[32] = "";
  const pags_result result = usd ? pags_export_usd(scene, path, &arguments->proxy, &arguments->splat, session->tasks,
                                                   pags_progress_watch, &progress, &count)
                                 : pags_export_splats(scene, path, &arguments->splat, &count);
  pags_progress_end(&progress);
  PAGS_TRY(result);
  if (usd)
    snprintf(took, sizeof took, ", %.1f s", pags_seconds() - begun);
  pags_say(session, "%s: %lld Gaussians%s\n", path, (long long)count, took);
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "file", path);
  pags_json_put_integer(&json, "gaussians", count);
  return pags_session_json(session, &json);
}

/* ---- Exporting a page ---- */

static pags_result export_page(export_arguments *arguments, pags_scene *scene, const char *from, const char *path) {
  pags_progress progress = pags_progress_begin(arguments->session.people);
  const double begun = pags_seconds();
  pags_html_report report;
  char size[32];
  const pags_html_settings settings = {.name = pags_path_name(from),
                                       .sh_degree = arguments->splat.sh_degree,
                                       .target_size = arguments->target_size,
                                       .tasks = arguments->session.tasks,
                                       .progress = pags_progress_watch,
                                       .user = &progress};
  const pags_result result = pags_html_write(scene, path, &settings, &report);
  pags_progress_end(&progress);
  PAGS_TRY(result);
  pags_say(&arguments->session, "%s: %lld Gaussians, view-dependent colour of degree %d, %s, %.1f s\n", path,
           (long long)report.gaussians, report.sh_degree, pags_format_bytes((double)report.bytes, size, sizeof size),
           pags_seconds() - begun);
  if (report.sh_degree < report.sh_degree_asked)
    pags_say(&arguments->session, "left out for --target-size: view-dependent colour above degree %d\n",
             report.sh_degree);
  if (report.left_out)
    pags_say(&arguments->session,
             "left out for --target-size: the %lld faintest Gaussians, %.2f %% of the pictures' light\n",
             (long long)report.left_out, 100 * report.left);
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "file", path);
  pags_json_put_integer(&json, "gaussians", report.gaussians);
  pags_json_put_integer(&json, "sh_degree", report.sh_degree);
  pags_json_put_integer(&json, "left_out", report.left_out);
  pags_json_put_number(&json, "left_out_share", report.left);
  pags_json_put_unsigned(&json, "bytes", report.bytes);
  return pags_session_json(&arguments->session, &json);
}

/* ---- The verb ---- */

static bool is_page(const char *path) {
  return !strcasecmp(pags_path_extension(path), ".html");
}

static bool is_usd(const char *path) {
  return !strcasecmp(pags_path_extension(path), ".usda") || !strcasecmp(pags_path_extension(path), ".usdz");
}

static int check(void *user, const pags_parsed *parsed) {
  export_arguments *arguments = user;
  const pags_verb *verb = parsed->verb;
  const char *to = parsed->positionals[1], *extension = pags_path_extension(to);
  const bool gltf = !strcasecmp(extension, ".glb") || !strcasecmp(extension, ".gltf");
  if (!gltf && !is_usd(to) && !is_page(to) && !pags_export_is_splat(to))
    return pags_usage_error(verb,
                            "expected a file name ending in .glb, .gltf, .ply, .spz, .sog, .splat, .pagsz, .usda, "
                            ".usdz or .html, or meta.json of a SOG folder, got '%s'",
                            to);
  if (arguments->target_size && !is_page(to))
    return pags_usage_error(verb, "--target-size: no effect on a file that doesn't end in .html, got '%s'", to);
  if (arguments->naming && (!gltf || arguments->splats || arguments->proxy.lod))
    return pags_usage_error(verb, "--naming: only affects proxies in a .glb or .gltf, without --lod");
  if (arguments->proxy.collision && (!gltf || arguments->splats || arguments->proxy.lod || arguments->proxy.texture ||
                                     arguments->naming == PAGS_NAMING_UNREAL))
    return pags_usage_error(
        verb,
        "--collision: only affects proxies in a .glb or .gltf, without --lod, --texture and --naming "
        "unreal, whose collision shapes need the visible surface");
  if (arguments->proxy.texture && (!gltf || arguments->splats))
    return pags_usage_error(verb, "--texture: only affects proxies in a .glb or .gltf");
  return pags_crop_check(parsed, &arguments->crop);
}

static pags_result run(void *user, const pags_parsed *parsed) {
  export_arguments *arguments = user;
  const char *from = parsed->positionals[0], *to = parsed->positionals[1];
  const pags_filter *filter = &arguments->crop.filter;
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_AUTOFREE uint8_t *chosen = NULL;
  PAGS_TRY(pags_prepare_file(&arguments->session, to));
  pags_interrupt_install(arguments->session.tasks);
  pags_file_stop_when(pags_interrupt_flag());
  PAGS_TRY(pags_reading_load(&arguments->reading, from, &scene));
  PAGS_TRY(choose(arguments, &scene, &chosen));
  const double time = scene.time_begin + arguments->time;
  PAGS_TRY(pags_crop_apply(&arguments->crop, &scene, time, chosen, &arguments->session));
  PAGS_TRY(pags_session_check(&arguments->session));
  const double box[6] = {filter->lo[0], filter->lo[1], filter->lo[2], filter->hi[0], filter->hi[1], filter->hi[2]};
  const double ball[4] = {filter->middle[0], filter->middle[1], filter->middle[2], filter->radius};
  arguments->splat.time = time;
  arguments->splat.spz_axes = arguments->spz_axes ? PAGS_AXES_RDF : PAGS_AXES_RUB;
  arguments->proxy.chosen = chosen;
  arguments->proxy.box = filter->has_box ? box : NULL;
  arguments->proxy.ball = filter->has_ball ? ball : NULL;
  arguments->proxy.level = (pags_proxy_level)arguments->level;
  if (arguments->proxy.collision) {
    if (!pags_option_given(parsed, "proxy"))
      arguments->proxy.level = PAGS_PROXY_CONVEX;
    if (!pags_option_given(parsed, "ground-triangles"))
      arguments->proxy.ground_triangles = 3000;
    if (!pags_option_given(parsed, "chunk-triangles"))
      arguments->proxy.chunk_triangles = 12000;
  }
  arguments->proxy.naming = (pags_proxy_naming)arguments->naming;
  arguments->proxy.stand = (pags_stand)arguments->stand;
  arguments->proxy.background_form = (pags_background_form)arguments->form;
  if (arguments->splats || pags_export_is_splat(to) || is_usd(to))
    return export_gaussians(arguments, &scene, to, is_usd(to) && !arguments->splats);
  return is_page(to) ? export_page(arguments, &scene, from, to) : export_proxies(arguments, &scene, to);
}

static const pags_verb verb = {
    .name = "export",
    .usage = "SCENE FILE [options]",
    .about =
        "Export a scene. Proxy meshes (.glb, .gltf): one named node per labelled object with its class, its track as "
        "animation, and its measured error. Gaussians for other programs: .ply, .spz, .sog (or meta.json in a folder), "
        ".splat. Packed Gaussians, rendered without unpacking: .pagsz. Both as a USD stage: .usda, or .usdz (one "
        "archive). A web page that plays the scene in any browser: .html.",
    .positionals = {{"SCENE", "Scene folder or splat file."},
                    {"FILE", "Output file; its extension selects the format."}},
    .options = options,
    .check = check,
    .run = run};

int pags_verb_export(int argc, char **argv) {
  export_arguments arguments = {.proxy = pags_proxy_options_default(), .splat = pags_splat_options_default()};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
