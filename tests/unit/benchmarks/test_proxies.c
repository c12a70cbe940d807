/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the measurements of pags-bench proxies. Proxies that are the street's own meshes must be found perfect;
 * damages of known size must be found as they are. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"
#include "exporters/format/gltf.h"

#include "scratch_folder.h"

enum { FRAMES = 6, CAMERAS = 3, VIEWS = FRAMES * CAMERAS, MOST_OBJECTS = 64 };
const char pags_program_name[] = "test_proxies";

typedef enum damage { NONE, NO_WALLS, RAISED_WALLS, HIGH_ROAD, NO_ROAD, BUBBLE, MOVED_POLES } damage;

/* ---- A scene with the street's cameras and cars, and an origin that isn't 0 ---- */

typedef struct stage {
  pags_proxy_bench bench;
  pags_scene_view views[VIEWS];
  pags_scene_object objects[MOST_OBJECTS];
  pags_keyframe keyframes[MOST_OBJECTS][FRAMES];
  char ids[MOST_OBJECTS][16];
} stage;

static void open_stage(stage *s, bool trained) {
  pags_proxy_bench *b = &s->bench;
  memset(s, 0, sizeof *s);
  b->options = pags_street_options_default();
  b->options.frames = FRAMES;
  b->options.fps = 2;
  b->options.objects = 2; /* cars, whose meshes are rigid */
  assert_int_equal(pags_street_build(&b->options, &b->street), PAGS_OK);
  assert_int_equal(pags_stage_create(b->street.meshes, b->street.mesh_count, b->street.placements,
                                     b->street.placement_count, &b->stage),
                   PAGS_OK);
  b->stage_time = (double)NAN;
  b->scene = (pags_scene){.origin = {10, -3, 1}, .up = PAGS_UP_Z, .view_count = VIEWS, .views = s->views};
  for (int i = 0; i < VIEWS; i++) {
    const int frame = i / CAMERAS;
    s->views[i] =
        (pags_scene_view){.camera = pags_street_camera(&b->options, frame / b->options.fps, i % CAMERAS, 0, 0),
                          .frame = frame,
                          .test = !trained};
  }
  assert_true(b->street.actor_count <= MOST_OBJECTS);
  b->scene.objects = s->objects;
  b->scene.object_count = b->street.actor_count;
  for (int i = 0; i < b->street.actor_count; i++) {
    const pags_actor *actor = &b->street.actors[i];
    snprintf(s->ids[i], sizeof s->ids[i], "car_%d", i);
    s->objects[i].record = (pags_object){.id = s->ids[i],
                                         .class_name = s->ids[i],
                                         .category = PAGS_CATEGORY_VEHICLE,
                                         .moving = actor->moving,
                                         .keyframe_count = FRAMES,
                                         .keyframes = s->keyframes[i]};
    for (int frame = 0; frame < FRAMES; frame++) {
      s->keyframes[i][frame] = (pags_keyframe){.frame = frame, .time = frame / b->options.fps};
      pags_actor_pose(actor, frame / b->options.fps, s->keyframes[i][frame].world_from_object);
    }
  }
}

static void close_stage(stage *s) {
  pags_placed_close(&s->bench.placed);
  pags_glb_close(&s->bench.file);
  pags_stage_destroy(s->bench.stage);
  pags_street_destroy(&s->bench.street);
}

/* ---- The street's meshes as a file of proxies ---- */

/* Where a vertex of a damaged street is. */
static void bend(damage how, uint8_t label, double p[3]) {
  if (how == RAISED_WALLS && label == PAGS_CLASS_BUILDING)
    p[2] = fmax(p[2], 0.55);
  if (how == HIGH_ROAD && label == PAGS_CLASS_ROAD)
    p[2] += 0.05;
  if (how == MOVED_POLES && label == PAGS_CLASS_POLE)
    p[0] += 0.6;
}

/* Adds the faces of a placement that have a label, relative to the world's point or frame `to`. */
static void copy_faces(const pags_street *street, const pags_stage_placement *placed, uint8_t label, damage how,
                       const double to[12], pags_proxy_mesh *out) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const pags_mesh *mesh = &street->meshes[placed->mesh];
  for (int64_t f = 0; f < mesh->face_count; f++) {
    const uint8_t own = street->materials.list[mesh->materials[f]].label;
    uint32_t corner[4];
    if ((own == PAGS_CLASS_SIGN ? PAGS_CLASS_POLE : own) != label) /* a sign is one thing with its pole */
      continue;
    for (int c = 0; c < 4; c++) {
      float world[3];
      double p[3], q[3];
      pags_transform3f(placed->pose, mesh->vertices[mesh->faces[4 * f + c]].position, world);
      pags_widen3(world, p);
      bend(how, label, p);
      pags_rigid_point(to, p, q);
      pags_narrow3(q, world);
      corner[c] = pags_proxy_mesh_vertex(out, world, grey, 1);
    }
    pags_proxy_mesh_triangle(out, corner[0], corner[1], corner[2]);
    if (mesh->faces[4 * f + 3] != mesh->faces[4 * f + 2])
      pags_proxy_mesh_triangle(out, corner[0], corner[2], corner[3]);
  }
  assert_int_equal(pags_proxy_mesh_check(out), PAGS_OK);
}

static void add_node(pags_gltf *gltf, int root, const char *name, const char *class_name, const char *track,
                     const pags_proxy_mesh *mesh, const stage *s, int object) {
  char text[96];
  const int node = pags_gltf_node(gltf, root, name);
  snprintf(text, sizeof text, track ? "{\"class\":\"%s\",\"track\":\"%s\"}" : "{\"class\":\"%s\"}", class_name, track);
  pags_gltf_extras(gltf, node, text);
  pags_gltf_node_mesh(gltf, node, pags_gltf_mesh(gltf, name, mesh, NULL, 0, 0));
  if (object >= 0)
    assert_int_equal(pags_gltf_node_place(gltf, node, &s->bench.scene, &s->objects[object].record, 0), PAGS_OK);
}

static void write_street(stage *s, damage how, const char *path) {
  static const struct {
    uint8_t label;
    const char *name;
  } kinds[] = {
      {PAGS_CLASS_ROAD, "road"},         {PAGS_CLASS_SIDEWALK, "sidewalk"},     {PAGS_CLASS_TERRAIN, "terrain"},
      {PAGS_CLASS_BUILDING, "building"}, {PAGS_CLASS_VEGETATION, "vegetation"}, {PAGS_CLASS_POLE, "pole"}};
  const pags_street *street = &s->bench.street;
  double to[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  char name[32];
  pags_gltf *gltf;
  assert_int_equal(pags_gltf_create(&gltf), PAGS_OK);
  const int root = pags_gltf_node(gltf, -1, "scene");
  pags_gltf_node_up(gltf, root, PAGS_UP_Z);
  pags_gltf_material(gltf, "grey", true, NULL);
  pags_pose_subtract(to, s->bench.scene.origin);
  pags_street_set_time(&s->bench.street, 0);
  for (int i = 0; i < street->placement_count; i++) {
    const pags_stage_placement *placed = &street->placements[i];
    if (placed->actor >= 0) {
      pags_proxy_mesh mesh = {0};
      double pose[12];
      pags_actor_pose(&street->actors[placed->actor], 0, pose);
      pags_rigid_inverse(pose, pose);
      copy_faces(street, placed, PAGS_CLASS_CAR, how, pose, &mesh);
      add_node(gltf, root, s->ids[placed->actor], "Car", s->ids[placed->actor], &mesh, s, placed->actor);
      pags_proxy_mesh_destroy(&mesh);
      continue;
    }
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
      pags_proxy_mesh mesh = {0};
      copy_faces(street, placed, kinds[k].label, how, to, &mesh);
      snprintf(name, sizeof name, "%s%s_%d", k < 3 ? "ground_" : "", kinds[k].name, i);
      const bool gone = (how == NO_WALLS && kinds[k].label == PAGS_CLASS_BUILDING) ||
                        (how == NO_ROAD && kinds[k].label == PAGS_CLASS_ROAD);
      if (mesh.triangle_count && !gone)
        add_node(gltf, root, name, kinds[k].name, NULL, &mesh, s, -1);
      pags_proxy_mesh_destroy(&mesh);
    }
  }
  if (how == BUBBLE) {
    pags_proxy_mesh mesh = {0};
    assert_int_equal(pags_proxy_mesh_box((const double[3]){2, 2, 2}, (const float[3]){0}, &mesh), PAGS_OK);
    for (int64_t i = 0; i < mesh.vertex_count; i++) {
      mesh.positions[3 * i] += 25 - 10;
      mesh.positions[3 * i + 2] += 4 - 1;
    }
    add_node(gltf, root, "thing_000", "other", NULL, &mesh, s, -1);
    pags_proxy_mesh_destroy(&mesh);
  }
  assert_int_equal(pags_gltf_save(gltf, path), PAGS_OK);
  pags_gltf_destroy(gltf);
}

/* ---- Results ---- */

/* Measures the street's meshes, damaged, with `threads`; the text is the caller's. */
static char *measure(damage how, int threads, bool trained) {
  static stage s;
  open_stage(&s, trained);
  pags_proxy_bench *b = &s.bench;
  b->session.tasks = pags_tasks_create(threads);
  write_street(&s, how, scratch("street.glb"));
  assert_int_equal(pags_glb_open(scratch("street.glb"), &b->file), PAGS_OK);
  assert_int_equal(pags_placed_open(&b->file, &b->scene, &b->placed), PAGS_OK);
  pags_json_writer_init(&b->json, 1);
  pags_json_begin_object(&b->json, NULL);
  assert_int_equal(pags_bench_first_hits(b), PAGS_OK);
  assert_int_equal(pags_bench_feet(b), PAGS_OK);
  assert_int_equal(pags_bench_drops(b), PAGS_OK);
  assert_int_equal(pags_bench_parts(b), PAGS_OK);
  assert_int_equal(pags_bench_shadows(b), PAGS_OK);
  pags_json_end_object(&b->json);
  assert_int_equal(pags_json_writer_finish(&b->json), PAGS_OK);
  pags_tasks_destroy(b->session.tasks);
  close_stage(&s);
  return b->json.data;
}

static pags_json *results(damage how) {
  pags_json *json;
  char *text = measure(how, 2, true);
  assert_int_equal(pags_json_parse_text("results", text, strlen(text), &json), PAGS_OK);
  free(text);
  return json;
}

/* The element of a list whose text member `key` is `value`. */
static const pags_json_value *row(const pags_json_value *list, const char *key, const char *value) {
  assert_non_null(list);
  for (const pags_json_value *at = list->first; at; at = at->next)
    if (!strcmp(pags_json_member(at, key)->text, value))
      return at;
  fail_msg("no %s %s", key, value);
  return NULL;
}

static double number(const pags_json_value *object, const char *key) {
  const pags_json_value *value = pags_json_member(object, key);
  assert_non_null(value);
  value = value->type == PAGS_JSON_ARRAY ? value->first : value; /* the mean of three */
  return value->type == PAGS_JSON_NUMBER ? value->number : (double)NAN;
}

static double largest(const pags_json_value *object, const char *key) {
  return pags_json_member(object, key)->first->next->next->number;
}

static const pags_json_value *get(const pags_json *json, const char *a, const char *b) {
  return pags_json_member(pags_json_member(pags_json_root(json), a), b);
}

static const pags_json_value *class_row(const pags_json *json, const char *name) {
  return row(get(json, "first_hits", "classes"), "class", name);
}

/* ---- Tests ---- */

static void the_truth_is_perfect(void **state) {
  (void)state;
  static const char *const classes[] = {"road", "sidewalk", "building", "tree", "pole", "vehicle"};
  pags_json *json = results(NONE);
  for (size_t i = 0; i < sizeof classes / sizeof classes[0]; i++) {
    const pags_json_value *c = class_row(json, classes[i]);
    assert_true(number(c, "rays") > 30);
    assert_true(number(c, "within_0.1_m") > 0.99 && number(c, "within_0.3_m") > 0.99);
    assert_true(number(c, "missed") < 0.01 && number(c, "false") < 0.01);
    assert_true(number(c, "distance") < 0.002);
  }
  assert_true(number(class_row(json, "open"), "false") < 0.005);
  for (const pags_json_value *at = get(json, "first_hits", "places")->first; at; at = at->next)
    if (!(number(at, "rays") > 300 && number(at, "within_0.3_m") > 0.99))
      fail_msg("%s: %g rays, %g within 0.3 m", pags_json_member(at, "place")->text, number(at, "rays"),
               number(at, "within_0.3_m"));
  for (int i = 0; i < 2; i++) {
    const pags_json_value *feet = get(json, "feet", i ? "uprights" : "walls");
    assert_true(number(feet, "rays") > 50 && number(feet, "stopped") > 0.999 && number(feet, "leaks") < 0.001);
    assert_true(number(feet, "balls") >= 15 && number(feet, "passed") == 0);
  }
  for (const pags_json_value *at = get(json, "drops", "bodies")->first; at; at = at->next)
    assert_true(number(at, "places") > 10 && number(at, "through") == 0 && largest(at, "error") < 0.001);
  const pags_json_value *wheelbase = get(json, "drops", "wheelbase");
  assert_true(largest(wheelbase, "error") < 0.001 && number(wheelbase, "step") < 0.001);
  for (int i = 0; i < 2; i++) {
    const pags_json_value *u = get(json, "uprights", i ? "trees" : "poles_and_signs");
    assert_true(number(u, "true") > 3 && number(u, "recall") == 1 && number(u, "precision") == 1);
    assert_true(largest(u, "foot_error") < 0.05);
  }
  for (const pags_json_value *at = pags_json_member(pags_json_root(json), "shadows")->first; at; at = at->next)
    assert_true(number(at, "points") > 1000 && number(at, "iou") > 0.99);
  pags_json_destroy(json);
}

static void missing_walls_leak(void **state) {
  (void)state;
  pags_json *json = results(NO_WALLS);
  assert_true(number(class_row(json, "building"), "within_0.3_m") < 0.05);
  assert_true(number(class_row(json, "building"), "missed") > 0.9);
  assert_true(number(class_row(json, "road"), "within_0.1_m") > 0.99);
  const pags_json_value *walls = get(json, "feet", "walls"), *uprights = get(json, "feet", "uprights");
  assert_true(number(walls, "leaks") > 0.95 && number(walls, "passed") > 0.95 * number(walls, "balls"));
  assert_true(number(uprights, "leaks") < 0.001 && number(uprights, "passed") == 0);
  assert_true(number(row(pags_json_member(pags_json_root(json), "shadows"), "sun", "30 degrees, right"), "iou") < 0.9);
  pags_json_destroy(json);
}

/* Walls that end 0.55 m above the road let low rays through, but no ball whose middle is 0.63 m above it. */
static void walls_without_feet_leak(void **state) {
  (void)state;
  pags_json *json = results(RAISED_WALLS);
  const pags_json_value *walls = get(json, "feet", "walls");
  assert_true(number(walls, "leaks") > 0.95 && number(walls, "passed") == 0);
  pags_json_destroy(json);
}

static void a_high_road_lifts_bodies(void **state) {
  (void)state;
  pags_json *json = results(HIGH_ROAD);
  for (const pags_json_value *at = get(json, "drops", "bodies")->first; at; at = at->next) {
    const char *area = pags_json_member(at, "area")->text;
    if (!strcmp(area, "kerb"))
      continue; /* some rest on the road, some on the kerb */
    assert_true(fabs(number(at, "error") - (strcmp(area, "road") ? 0 : 0.05)) < 0.002);
  }
  assert_true(fabs(number(get(json, "drops", "wheelbase"), "error") - 0.05) < 0.001);
  assert_true(number(get(json, "drops", "wheelbase"), "step") < 0.001);
  pags_json_destroy(json);
}

static void bodies_fall_where_there_is_no_road(void **state) {
  (void)state;
  pags_json *json = results(NO_ROAD);
  const pags_json_value *road = get(json, "drops", "bodies")->first;
  assert_true(number(road, "places") > 10 && number(road, "through") == number(road, "places"));
  assert_true(number(class_row(json, "road"), "missed") > 0.9);
  pags_json_destroy(json);
}

static void a_bubble_is_a_false_hit(void **state) {
  (void)state;
  pags_json *json = results(BUBBLE);
  const pags_json_value *all = row(get(json, "first_hits", "places"), "place", "all");
  assert_true(number(all, "false") > 0.001);
  assert_true(number(class_row(json, "other"), "false_by_this") > 0.9 * number(all, "false"));
  pags_json_destroy(json);
}

static void moved_poles_are_off(void **state) {
  (void)state;
  pags_json *json = results(MOVED_POLES);
  const pags_json_value *poles = get(json, "uprights", "poles_and_signs");
  assert_true(fabs(largest(poles, "foot_error") - 0.6) < 0.05);
  assert_true(number(get(json, "uprights", "trees"), "foot_error") < 0.05);
  pags_json_destroy(json);
}

static void threads_change_nothing(void **state) {
  (void)state;
  char *one = measure(RAISED_WALLS, 1, true), *three = measure(RAISED_WALLS, 3, true);
  assert_string_equal(one, three);
  free(one);
  free(three);
}

static void what_no_camera_saw_does_not_count(void **state) {
  (void)state;
  pags_json *json;
  char *text = measure(NONE, 2, false);
  assert_int_equal(pags_json_parse_text("results", text, strlen(text), &json), PAGS_OK);
  assert_true(number(class_row(json, "road"), "rays") == 0 && number(class_row(json, "road"), "unseen") > 1000);
  assert_true(number(get(json, "feet", "walls"), "rays") == 0);
  pags_json_destroy(json);
  free(text);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(the_truth_is_perfect),
      cmocka_unit_test(missing_walls_leak),
      cmocka_unit_test(walls_without_feet_leak),
      cmocka_unit_test(a_high_road_lifts_bodies),
      cmocka_unit_test(bodies_fall_where_there_is_no_road),
      cmocka_unit_test(a_bubble_is_a_false_hit),
      cmocka_unit_test(moved_poles_are_off),
      cmocka_unit_test(threads_change_nothing),
      cmocka_unit_test(what_no_camera_saw_does_not_count),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
