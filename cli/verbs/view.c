/* SPDX-License-Identifier: Apache-2.0 */
/* pags view: shows a scene in a browser. */
#include "cli/common/scene_options.h"
#include "cli/draw/camera_paths.h"
#include "cli/verbs/verbs.h"
#include "cli/view/server.h"

#include <pags/packed.h>
#include "base/file.h"
#include "frame/owners.h"

typedef struct view_arguments {
  pags_session session;
  const char *bind, *hosts, *dataset;
  int port, clients;
  double budget_ms;
  pags_dataset_options dataset_options;
  pags_reading reading;
} view_arguments;

#define AT(member) offsetof(view_arguments, member)

static const pags_option options[] = {
    PAGS_GROUP("Server"),
    PAGS_VALUE("port", 0, INT, AT(port), 0, 65535, "N", "0: a free port", NULL, "Port on this machine."),
    PAGS_TEXT("bind", 0, AT(bind), "ADDRESS", NULL,
              "Address of this machine to listen on. Use trusted networks only: the connection isn't encrypted."),
    PAGS_TEXT("host", 0, AT(hosts), "NAME,...", "the address of --bind",
              "Host names to accept in requests, with :PORT if it differs (reverse proxy, SSH tunnel)."),
    PAGS_VALUE("clients", 0, INT, AT(clients), 1, 64, "N", "pages", NULL, "Maximum number of open pages."),

    PAGS_GROUP("Picture"),
    PAGS_VALUE("budget-ms", 0, DOUBLE, AT(budget_ms), 0.1, 1e6, "T", "milliseconds per picture", NULL,
               "Time limit while the camera moves; when it stops, a picture of full quality follows."),

    PAGS_GROUP("Input"),
    PAGS_READING_OPTIONS(AT(reading)),
    PAGS_TEXT("dataset", 0, AT(dataset), "DATASET", "as stored in the scene",
              "Compare with the photographs of this data set."),
    PAGS_TEXT("colmap", 0, AT(dataset_options.colmap), "FOLDER", NULL,
              "With --dataset: read cameras from this COLMAP model."),
    PAGS_TEXT("image-folder", 0, AT(dataset_options.image_folder), "FOLDER", NULL,
              "With --dataset: folder of its photographs."),
    PAGS_SESSION_OPTIONS(view_arguments),
    {0}};

static int check(void *user, const pags_parsed *parsed) {
  const view_arguments *arguments = user;
  const pags_option_rule rules[] = {{"colmap image-folder", arguments->dataset != NULL, "--dataset"}, {0}};
  if (pags_options_check_effect(parsed, rules))
    return PAGS_EXIT_USAGE;
  if (!strcmp(arguments->bind, "0.0.0.0") && !arguments->hosts)
    return pags_usage_error(parsed->verb,
                            "--bind 0.0.0.0 requires --host NAME, the name or address that browsers use; or give "
                            "--bind one address of this machine");
  return PAGS_EXIT_OK;
}

static pags_result run(void *user, const pags_parsed *parsed) {
  const view_arguments *arguments = user;
  const char *path = parsed->positionals[0];
  if (pags_packed_is_file(path))
    return pags_fail(
        PAGS_ERROR_UNSUPPORTED,
        "%s: a packed file has no views to start at: expected the scene or splat file from which it was made", path);
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *composition = NULL;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer description = {0};
  PAGS_AUTO(pags_renderer_destroy_auto) pags_renderer *renderer = NULL;
  PAGS_AUTO(pags_server_destroy_auto) pags_server *server = NULL;
  pags_view_start start;
  PAGS_TRY(pags_reading_load(&arguments->reading, path, &scene));
  PAGS_TRY(pags_view_start_find(&scene, &start));
  PAGS_TRY(pags_composition_create(&scene, &composition));
  PAGS_TRY(pags_session_check(&arguments->session));
  PAGS_TRY(pags_view_describe(composition, &start, pags_path_name(path), false, &description));
  PAGS_TRY(pags_renderer_create(&(pags_renderer_settings){.composition = composition,
                                                          .tasks = arguments->session.tasks,
                                                          .budget_ms = arguments->budget_ms,
                                                          .dataset = arguments->dataset,
                                                          .dataset_options = arguments->dataset_options},
                                &renderer));
  PAGS_TRY(pags_server_create(&(pags_server_settings){.renderer = renderer,
                                                      .tasks = arguments->session.tasks,
                                                      .description = description.data,
                                                      .bind = arguments->bind,
                                                      .port = arguments->port,
                                                      .hosts = arguments->hosts,
                                                      .clients = arguments->clients},
                              &server));
  pags_json_writer json = pags_session_json_begin();
  pags_json_put_string(&json, "url", pags_server_url(server));
  pags_json_put_integer(&json, "port", pags_server_port(server));
  PAGS_TRY(pags_session_json(&arguments->session, &json));
  pags_interrupt_install(NULL);
  pags_say(&arguments->session, "%s: %lld Gaussians. Open\n  %s\nCtrl-C ends it.\n", path,
           (long long)pags_composition_gaussian_count(composition), pags_server_url(server));
  return pags_server_run(server, pags_interrupt_flag());
}

static const pags_verb verb = {
    .name = "view",
    .usage = "SCENE [--port N] [options]",
    .about =
        "Show a scene in a browser: print an address to open and serve it until Ctrl-C. The scene isn't changed. From "
        "another machine: ssh -L 8765:localhost:8765 HOST, and open the same address.",
    .positionals = {{"SCENE", "Scene folder, or splat file: .ply (also compressed), .spz, .sog, .glb, .splat."}},
    .options = options,
    .check = check,
    .run = run};

int pags_verb_view(int argc, char **argv) {
  view_arguments arguments = {.bind = "127.0.0.1",
                              .port = 8765,
                              .clients = 8,
                              .budget_ms = 40,
                              .dataset_options = pags_dataset_options_default()};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
