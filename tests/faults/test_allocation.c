/* SPDX-License-Identifier: Apache-2.0 */
/* Tests reading, rendering, training and exporting while the n-th allocation is refused, for every n. Each run must end
 * with PAGS_ERROR_MEMORY or, where the allocation was optional, with the same result as without the failure; nothing
 * may crash or leak.
 *
 * Where an operation makes too many allocations to fail each of them, the first hundred fail in turn and the others are
 * sampled; PAGS_FAULTS=N samples N times as many. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <pags/compose.h>
#include <pags/dataset.h>
#include <pags/export.h>
#include <pags/frame.h>
#include <pags/image.h>
#include <pags/packed.h>
#include <pags/scene.h>
#include <pags/train.h>

#include "base/file.h"
#include "base/memory.h"
#include "exporters/proxy/convex_parts.h"
#include "exporters/proxy/mesh.h"
#include "exporters/proxy/tsdf.h"
#include "memory_guard.h"
#include "scratch_folder.h"
#include "small_scene.h"
#include "splat_files.h"

enum { VIEWS = 4, WIDTH = 32, HEIGHT = 24, WHOLE = 100, SAMPLES = 150 };

typedef struct operation {
  const char *name;
  pags_result (*run)(const char *path);
  const char *path; /* relative to the scratch folder */
  int samples;      /* number of samples beyond the first WHOLE allocations; 0: SAMPLES */
} operation;

static char place[SCRATCH_PATH + 128]; /* the operation's path in the scratch folder */
static uint64_t outcome;               /* hash of the last run's output, if it has one */

static void note(const void *bytes, size_t size) { /* FNV-1a hash */
  for (size_t i = 0; i < size; i++)
    outcome = (outcome ^ ((const uint8_t *)bytes)[i]) * UINT64_C(1099511628211);
}

/* Adds a file's contents to the hash; reads with stdio, whose own allocations aren't watched. */
static void note_file(const char *path) {
  uint8_t block[4096];
  FILE *const file = fopen(path, "rb");
  for (size_t got = 1; file && got;) {
    got = fread(block, 1, sizeof block, file);
    note(block, got);
  }
  if (file)
    fclose(file);
}

/* ---- Reading ---- */

static pags_result load_splats(const char *path) {
  pags_gaussians g;
  PAGS_TRY(pags_splat_load(path, &g, NULL, NULL));
  pags_gaussians_destroy(&g);
  return PAGS_OK;
}

static pags_result load_scene(const char *path) {
  pags_scene scene;
  PAGS_TRY(pags_scene_load(path, &scene));
  pags_scene_destroy(&scene);
  return PAGS_OK;
}

static pags_result load_path(const char *path) {
  pags_camera_path cameras;
  PAGS_TRY(pags_camera_path_load(path, &cameras));
  pags_camera_path_destroy(&cameras);
  return PAGS_OK;
}

static pags_dataset_options data_options(void) {
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  options.random_points = 40;
  return options;
}

static pags_result open_dataset(const char *path) {
  pags_dataset *dataset;
  const pags_dataset_options options = data_options();
  PAGS_TRY(pags_dataset_open(path, &options, &dataset));
  pags_dataset_close(dataset);
  return PAGS_OK;
}

/* ---- Rendering ---- */

static pags_result draw(pags_composition *composition, pags_tasks *tasks, pags_early_z mode) {
  const pags_part *parts;
  int part_count;
  pags_frame *frame;
  pags_picture picture;
  pags_frame_stats stats;
  const pags_camera camera = {.width = 40,
                              .height = 30,
                              .fx = 30,
                              .fy = 30,
                              .cx = 20,
                              .cy = 15,
                              .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -6}};
  pags_frame_options options = pags_composition_options(composition);
  options.early_z = mode;
  options.extra_channels = 1;
  pags_compose(composition, 0.25, &parts, &part_count);
  PAGS_TRY(pags_frame_create(tasks, &frame));
  const pags_result result = pags_frame_render(frame, parts, part_count, &camera, &options, NULL, &stats, &picture);
  for (int c = 0; c < 3 && result == PAGS_OK; c++)
    for (int y = 0; y < picture.height; y++)
      note(picture.rgb[c] + y * picture.stride, (size_t)picture.width * sizeof(float));
  pags_frame_destroy(frame);
  return result;
}

/* Renders a scene or a splat file, which is packed first if `pack` is set. Writes no picture file. */
static pags_result render_as(const char *path, int pack, pags_early_z mode) {
  pags_composition *composition;
  PAGS_TRY(pags_composition_load(path, &composition));
  pags_tasks *const tasks = pags_tasks_create(1);
  pags_result result = tasks ? PAGS_OK : PAGS_ERROR_MEMORY;
  if (result == PAGS_OK && pack)
    result = pags_composition_pack(composition);
  if (result == PAGS_OK)
    result = draw(composition, tasks, mode);
  pags_tasks_destroy(tasks);
  pags_composition_destroy(composition);
  return result;
}

static pags_result render(const char *path) {
  return render_as(path, 0, PAGS_EARLY_Z_OFF);
}
static pags_result render_hidden(const char *path) {
  return render_as(path, 0, PAGS_EARLY_Z_LOSSLESS);
}
static pags_result render_packed(const char *path) {
  return render_as(path, 1, PAGS_EARLY_Z_OFF);
}

/* ---- Training ---- */

static pags_train_config small_config(void) {
  pags_train_config c = pags_train_config_default();
  c.schedule.iterations = 6;
  c.color.sh_degree = 1;
  c.schedule.resolution_floor = 8;
  c.size_limit.max_gaussians = 90;
  c.density.densify_from = 0;
  c.density.densify_gradient = 1e-5;
  c.picture.cluster_size = 16;
  return c;
}

static pags_result train_on(const char *path, int resume) {
  const pags_dataset_options reading = data_options();
  const pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result told;
  pags_dataset *dataset;
  PAGS_TRY(pags_dataset_open(path, &reading, &dataset));
  pags_tasks *const tasks = pags_tasks_create(1);
  char output[SCRATCH_PATH + 128];
  snprintf(output, sizeof output, "%.500s/trained", scratch_folder);
  options.dataset = dataset;
  options.output = output;
  options.tasks = tasks;
  options.resume = resume;
  options.overwrite = !resume;
  options.checkpoint_every = 3;
  options.preview_every = 4;
  options.log_every = 2;
  const pags_result result = tasks ? pags_train(&config, &options, &told) : PAGS_ERROR_MEMORY;
  note_file(scratch("trained/background.ply"));
  note_file(scratch("trained/scene.json"));
  note_file(scratch("trained/checkpoint.pags"));
  pags_tasks_destroy(tasks);
  pags_dataset_close(dataset);
  return result;
}

static pags_result train(const char *path) {
  return train_on(path, 0);
}
static pags_result go_on(const char *path) {
  return train_on(path, 1);
} /* resumes from the checkpoint of a finished run: loads and writes only */

/* ---- Exporting ---- */

static pags_result export_splats(const char *path) {
  pags_scene scene;
  const pags_splat_options options = pags_splat_options_default();
  PAGS_TRY(pags_scene_load(scratch("scene"), &scene));
  const pags_result result = pags_export_splats(&scene, path, &options, NULL);
  note_file(path);
  return result;
}

static pags_result export_proxies_at(const char *path, pags_proxy_level level, int usd) {
  pags_scene scene;
  pags_proxy_options options = pags_proxy_options_default();
  const pags_splat_options splats = pags_splat_options_default();
  options.level = level;
  options.triangles = 60;
  PAGS_TRY(pags_scene_load(scratch("scene"), &scene));
  pags_tasks *const tasks = pags_tasks_create(1);
  pags_result result = PAGS_ERROR_MEMORY;
  if (tasks && usd)
    result = pags_export_usd(&scene, path, &options, &splats, tasks, NULL, NULL, NULL);
  else if (tasks)
    result = pags_export_proxies(&scene, path, &options, tasks, NULL, NULL, NULL);
  note_file(path);
  pags_tasks_destroy(tasks);
  pags_scene_destroy(&scene);
  return result;
}

static pags_result export_meshes(const char *path) {
  return export_proxies_at(path, PAGS_PROXY_MESH, 0);
}
static pags_result export_cages(const char *path) {
  return export_proxies_at(path, PAGS_PROXY_CAGE, 0);
}
static pags_result export_hulls(const char *path) {
  return export_proxies_at(path, PAGS_PROXY_HULL, 0);
}
static pags_result export_usd(const char *path) {
  return export_proxies_at(path, PAGS_PROXY_BOX, 1);
}

/* Tests mesh operations on a ball and a ring: meshing, simplification, repair, convex parts, hull, cage. */
static pags_result shape(const char *path) {
  const double lo[3] = {-2, -2, -2}, hi[3] = {2, 2, 2}, step = 0.25;
  PAGS_AUTO(pags_tsdf_destroy) pags_tsdf grid = {0};
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh shell = {0}, simple = {0}, convex = {0}, hull = {0}, cage = {0};
  pags_convex_parts parts;
  (void)path;
  PAGS_TRY(pags_tsdf_create(&grid, lo, hi, step, false));
  for (int64_t i = 0; i < (int64_t)grid.n[0] * grid.n[1] * grid.n[2]; i++) {
    const double x = lo[0] + step * (double)(i % grid.n[0]), y = lo[1] + step * (double)(i / grid.n[0] % grid.n[1]),
                 z = lo[2] + step * (double)(i / grid.n[0] / grid.n[1]);
    const double r = sqrt(x * x + y * y) - 1.2;
    grid.distance[i] = (float)fmin(sqrt(x * x + y * y + z * z) - 0.6, sqrt(r * r + z * z) - 0.4);
  }
  PAGS_TRY(pags_tsdf_surface(&grid, false, &shell));
  PAGS_TRY(pags_proxy_mesh_simplify(&shell, 300, &simple));
  PAGS_TRY(pags_proxy_mesh_repair(&simple));
  note(simple.positions, 12 * (size_t)simple.vertex_count);
  PAGS_TRY(pags_proxy_mesh_convex(&simple, 60, &convex, &parts));
  note(convex.positions, 12 * (size_t)convex.vertex_count);
  PAGS_TRY(pags_proxy_mesh_hull(&shell, 60, &hull));
  note(hull.positions, 12 * (size_t)hull.vertex_count);
  PAGS_TRY(pags_proxy_mesh_keep_parts(&shell, 0.9, 0.1, hi));
  PAGS_TRY(pags_proxy_mesh_cage(&shell, 1, 200, &cage));
  note(cage.positions, 12 * (size_t)cage.vertex_count);
  return PAGS_OK;
}

/* ---- The run ---- */

static const operation operations[] = {
    {"read ply", load_splats, "a.ply", 0},
    {"read text ply", load_splats, "ascii.ply", 0},
    {"read compressed ply", load_splats, "compressed.ply", 0},
    {"read splat", load_splats, "a.splat", 0},
    {"read spz 3", load_splats, "v3.spz", 0},
    {"read spz 4", load_splats, "v4.spz", 0},
    {"read scene", load_scene, "scene", 0},
    {"read path", load_path, "path.json", 0},
    {"open data set", open_dataset, "data", 0},
    {"render", render, "scene", 0},
    {"render early-z", render_hidden, "scene", 0},
    {"render packed", render_packed, "scene", 0},
    {"render packed file", render, "a.pagsz", 0},
    {"export ply", export_splats, "out.ply", 0},
    {"export spz", export_splats, "out.spz", 0},
    {"export splat", export_splats, "out.splat", 0},
    {"export packed", export_splats, "out.pagsz", 0},
    {"export splat glb", export_splats, "out.glb", 0},
    {"export meshes", export_meshes, "mesh.glb", 0},
    {"export cages", export_cages, "cage.glb", 0},
    {"export hulls", export_hulls, "hull.glb", 0},
    {"export usd", export_usd, "out.usda", 0},
    {"shape a proxy", shape, "", 40},
    {"train", train, "data", 0},
    {"resume", go_on, "data", 0},
};

static int64_t tried, refused, tolerated;

static pags_result run_with(const operation *o, int64_t n) {
  outcome = UINT64_C(14695981039346656037);
  memory_guard_begin(0, n);
  const pags_result result = o->run(place);
  memory_guard_end();
  return result;
}

static void try_once(const operation *o, int64_t n, uint64_t expected) {
  const pags_result result = run_with(o, n);
  tried++;
  if (result == PAGS_OK && outcome != expected)
    fail_msg("%s: allocation %lld refused: the result is another one", o->name, (long long)n);
  else if (result == PAGS_OK)
    tolerated++;
  else if (result == PAGS_ERROR_MEMORY)
    refused++;
  else
    fail_msg("%s: allocation %lld refused: %s: %s", o->name, (long long)n, pags_result_name(result),
             pags_error_message());
  if (memory_guard_live() != 0)
    fail_msg("%s: allocation %lld refused: %lld blocks are left (%s)", o->name, (long long)n,
             (long long)memory_guard_live(), result == PAGS_OK ? "went well" : pags_error_message());
}

static void run_operation(void **state) {
  const operation *const o = *state;
  const char *const more = getenv("PAGS_FAULTS");
  const int64_t samples = (o->samples ? o->samples : SAMPLES) * (more ? strtoll(more, NULL, 10) : 1);
  snprintf(place, sizeof place, "%s", scratch(o->path));
  /* Twice: the first run makes allocations that last as long as the process. */
  for (int i = 0; i < 2; i++)
    if (run_with(o, 0) != PAGS_OK)
      fail_msg("%s: %s", o->name, pags_error_message());
  assert_int_equal(memory_guard_live(), 0);
  const int64_t count = memory_guard_count();
  const uint64_t expected = outcome;
  tried = refused = tolerated = 0;
  for (int64_t n = 1; n <= count && n <= WHOLE; n++)
    try_once(o, n, expected);
  const int64_t rest = count - WHOLE, step = rest > samples ? rest / samples : 1;
  for (int64_t n = WHOLE + 1; n <= count; n += step)
    try_once(o, n, expected);
  assert_int_equal(run_with(o, 0), PAGS_OK); /* without a failure everything still works */
  assert_true(outcome == expected);
  print_message("%s: %lld allocations, %lld refused one by one: %lld errors, %lld done without\n", o->name,
                (long long)count, (long long)tried, (long long)refused, (long long)tolerated);
  assert_true(refused > 0);
}

/* ---- Data ---- */

static void must(pags_result result) {
  if (result != PAGS_OK) {
    fprintf(stderr, "test_allocation: %s\n", pags_error_message());
    exit(1);
  }
}

static void put_file(const char *name, file_bytes bytes) {
  scratch_file(name, bytes.data, bytes.size);
  bytes_free(&bytes);
}

static void make_splat_files(void) {
  pags_gaussians g;
  const pags_packed head = {0};
  sample_gaussians(&g, 20, 1, 1);
  put_file("a.ply", make_ply(&g));
  put_file("ascii.ply", make_scrambled_ply(&g, "ascii 1.0"));
  put_file("compressed.ply", make_compressed_ply(20, 1, 1, 1));
  put_file("a.splat", make_splat(20, 1));
  must(pags_packed_export(scratch("a.pagsz"), &g, &head));
  pags_gaussians_destroy(&g);
  for (int version = 3; version <= 4; version++) {
    spz_parts parts = make_spz_parts(version, 20, 1, 1);
    put_file(version == 3 ? "v3.spz" : "v4.spz", pack_spz(&parts));
    free_spz_parts(&parts);
  }
}

/* Writes a data set of coloured noise seen from a row of positions: enough for densification. */
static void make_dataset(void) {
  file_bytes text = {0};
  must(pags_make_dirs(scratch("data")));
  bytes_text(&text, "{\"w\": %d, \"h\": %d, \"fl_x\": 30, \"frames\": [", WIDTH, HEIGHT);
  for (int v = 0; v < VIEWS; v++) {
    char name[32];
    pags_image image;
    must(pags_image_create(&image, WIDTH, HEIGHT, 3, PAGS_U8));
    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++)
      ((uint8_t *)image.data)[i] = (uint8_t)(i * 7 * (v + 1) + i / 90);
    snprintf(name, sizeof name, "data/view%d.png", v);
    must(pags_image_save(scratch(name), &image));
    pags_image_destroy(&image);
    bytes_text(&text,
               "%s{\"file_path\": \"view%d.png\", \"transform_matrix\": [[1,0,0,%d],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}",
               v ? "," : "", v, v);
  }
  bytes_text(&text, "]}");
  put_file("data/transforms.json", text);
}

static int make_data(void) {
  pags_scene scene;
  if (scratch_make() != 0)
    return 1;
  make_splat_files();
  small_scene_make(&scene);
  must(pags_scene_save(scratch("scene"), &scene));
  pags_camera_path path = {.fps = 10, .count = 1, .cameras = &scene.views[0].camera};
  must(pags_camera_path_save(scratch("path.json"), &path));
  pags_scene_destroy(&scene);
  make_dataset();
  return 0;
}

/* `test_faults_allocation NAME` runs only the operations whose names match the pattern. */
int main(int argc, char **argv) {
  enum { COUNT = sizeof operations / sizeof *operations };
  struct CMUnitTest tests[COUNT];
  system_prefer_memory();
  if (make_data() != 0)
    return 1;
  for (int i = 0; i < COUNT; i++)
    tests[i] = (struct CMUnitTest){operations[i].name, run_operation, NULL, NULL, (void *)(uintptr_t)&operations[i]};
  if (argc > 1)
    cmocka_set_test_filter(argv[1]);
  const int failed = cmocka_run_group_tests(tests, NULL, NULL);
  return scratch_remove() != 0 || failed;
}
