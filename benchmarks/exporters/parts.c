/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench proxies: what the file consists of. By class: things, meshes, triangles, connected pieces, edges without
 * a second face. And whether the street's trees, poles and signs are found, and stand where they should. */
#include <math.h>
#include <string.h>

#include "base/sort.h"
#include "base/vec3.h"
#include "benchmarks/exporters/proxies.h"
#include "maths/maths.h"

static const double small_piece = 0.4;            /* square metres */
static const double match = 1, foot_height = 0.1; /* metres: between feet; of what counts as foot */

/* ---- Pieces ---- */

typedef struct tally {
  int64_t things, meshes, triangles, most_triangles, most_pieces, pieces, small, open, crossed;
} tally;

typedef struct place {
  float p[3];
  uint32_t vertex;
} place;

static int compare_places(const void *left, const void *right) {
  const place *a = left, *b = right;
  for (int k = 0; k < 3; k++)
    if (a->p[k] < b->p[k] || a->p[k] > b->p[k])
      return a->p[k] < b->p[k] ? -1 : 1;
  return a->vertex < b->vertex ? -1 : a->vertex > b->vertex;
}

/* Copies a mesh with one vertex at each place. */
static pags_result weld(const pags_proxy_mesh *mesh, pags_proxy_mesh *out) {
  PAGS_AUTOFREE place *places = malloc((size_t)(mesh->vertex_count + 1) * sizeof *places);
  PAGS_CHECK_MEMORY(places, "%lld vertices", (long long)mesh->vertex_count);
  PAGS_TRY(pags_proxy_mesh_copy(mesh, out));
  PAGS_AUTOFREE uint32_t *onto = malloc((size_t)(mesh->vertex_count + 1) * sizeof *onto);
  PAGS_CHECK_MEMORY(onto, "%lld vertices", (long long)mesh->vertex_count);
  for (int64_t i = 0; i < mesh->vertex_count; i++) {
    pags_copy3f(mesh->positions + 3 * i, places[i].p);
    places[i].vertex = (uint32_t)i;
  }
  pags_sort(places, mesh->vertex_count, sizeof *places, compare_places);
  for (int64_t i = 0; i < mesh->vertex_count; i++) {
    const bool same = i && !memcmp(places[i].p, places[i - 1].p, sizeof places[i].p);
    onto[places[i].vertex] = same ? onto[places[i - 1].vertex] : places[i].vertex;
  }
  for (int64_t i = 0; i < 3 * out->triangle_count; i++)
    out->triangles[i] = onto[out->triangles[i]];
  return PAGS_OK;
}

/* Adds a mesh to the count of its class. */
static pags_result add_mesh(const pags_proxy_mesh *mesh, tally *out, int64_t *pieces) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh whole = {0};
  pags_proxy_mesh_topology topology;
  PAGS_TRY(weld(mesh, &whole));
  PAGS_TRY(pags_proxy_mesh_inspect(&whole, &topology));
  PAGS_AUTOFREE int64_t *parent = malloc((size_t)(whole.vertex_count + 1) * sizeof *parent);
  PAGS_AUTOFREE double *area = calloc((size_t)(whole.vertex_count + 1), sizeof *area);
  PAGS_CHECK_MEMORY(parent && area, "%lld vertices", (long long)whole.vertex_count);
  pags_proxy_mesh_connect(&whole, parent);
  for (int64_t i = 0; i < whole.triangle_count; i++) {
    double cross[3];
    pags_proxy_mesh_cross(&whole, i, cross);
    area[pags_set_root(parent, whole.triangles[3 * i])] += 0.5 * pags_length3(cross);
  }
  for (int64_t i = 0; i < whole.vertex_count; i++) {
    *pieces += area[i] > 0;
    out->small += area[i] > 0 && area[i] < small_piece;
  }
  out->meshes++;
  out->triangles += whole.triangle_count;
  out->open += topology.open_edges;
  out->crossed += topology.crossed_edges;
  return PAGS_OK;
}

/* Counts the proxies of a class, thing by thing. A mesh below no node with extras is a thing by itself. */
static pags_result count_kind(const pags_placed *placed, pags_kind kind, tally *out) {
  *out = (tally){0};
  for (int64_t i = 0; i < placed->count; i++) {
    const pags_placed_proxy *first = &placed->list[i];
    const int64_t before = out->triangles;
    int64_t pieces = 0;
    bool new = first->kind == kind;
    for (int64_t j = 0; j < i && first->thing >= 0; j++)
      new = new && placed->list[j].thing != first->thing;
    for (int64_t j = i; new && j < placed->count; j++)
      if (j == i || (first->thing >= 0 && placed->list[j].thing == first->thing))
        PAGS_TRY(add_mesh(&placed->list[j].mesh, out, &pieces));
    out->things += new;
    out->pieces += pieces;
    out->most_pieces = pieces > out->most_pieces ? pieces : out->most_pieces;
    out->most_triangles = out->triangles - before > out->most_triangles ? out->triangles - before : out->most_triangles;
  }
  return PAGS_OK;
}

static pags_result tell_parts(pags_proxy_bench *self) {
  int64_t shards = 0, triangles = 0;
  pags_say(
      &self->session,
      "\nParts. pieces: connected ones, at most of one thing; small: below 0.4 square metres; open, crossed: edges "
      "of one face, and of more than two\n%-12s %6s %6s %9s %7s %7s %7s %6s %8s %8s\n",
      "class", "things", "meshes", "triangles", "most", "pieces", "most", "small", "open", "crossed");
  pags_json_begin_array(&self->json, "parts");
  for (int k = 0; k < PAGS_KIND_NONE; k++) {
    tally c;
    PAGS_TRY(count_kind(&self->placed, (pags_kind)k, &c));
    if (!c.things)
      continue;
    triangles += c.triangles;
    pags_say(&self->session, "%-12s %6lld %6lld %9lld %7lld %7lld %7lld %6lld %8lld %8lld\n", pags_kind_names[k],
             (long long)c.things, (long long)c.meshes, (long long)c.triangles, (long long)c.most_triangles,
             (long long)c.pieces, (long long)c.most_pieces, (long long)c.small, (long long)c.open,
             (long long)c.crossed);
    pags_json_begin_object(&self->json, NULL);
    pags_json_put_string(&self->json, "class", pags_kind_names[k]);
    pags_json_put_integer(&self->json, "things", c.things);
    pags_json_put_integer(&self->json, "meshes", c.meshes);
    pags_json_put_integer(&self->json, "triangles", c.triangles);
    pags_json_put_integer(&self->json, "most_triangles", c.most_triangles);
    pags_json_put_integer(&self->json, "pieces", c.pieces);
    pags_json_put_integer(&self->json, "most_pieces", c.most_pieces);
    pags_json_put_integer(&self->json, "small_pieces", c.small);
    pags_json_put_integer(&self->json, "open_edges", c.open);
    pags_json_put_integer(&self->json, "crossed_edges", c.crossed);
    pags_json_end_object(&self->json);
  }
  pags_json_end_array(&self->json);
  for (int64_t i = 0; i < self->placed.count; i++)
    shards += !strncmp(self->placed.list[i].name, "road_", 5) || !strncmp(self->placed.list[i].name, "sidewalk_", 9);
  pags_say(&self->session, "%lld triangles, %.2f MB, %lld shards named road_ or sidewalk_\n", (long long)triangles,
           1e-6 * (double)self->file.size, (long long)shards);
  pags_json_put_integer(&self->json, "triangles", triangles);
  pags_json_put_integer(&self->json, "bytes", (int64_t)self->file.size);
  pags_json_put_integer(&self->json, "shards", shards);
  return PAGS_OK;
}

/* ---- Trees, poles and signs ---- */

/* Where something upright stands, in the world. */
typedef struct foot {
  double at[3];
  bool tree, wanted; /* of the truth: a training camera saw it below 2 m; of a proxy: it is within 40 m of the path */
  double nearest[3]; /* the offset of the nearest one of the other side; infinite: none within 1 m sideways */
} foot;

typedef struct feet {
  foot *list;
  int64_t count, capacity;
} feet;

static void free_feet(feet *f) {
  free(f->list);
}

static pags_result add_foot(feet *to, const double at[3], bool tree, bool wanted) {
  PAGS_CHECK_MEMORY(pags_grow(&to->list, to->count + 1, &to->capacity, sizeof *to->list), "feet");
  foot *added = &to->list[to->count++];
  *added = (foot){.tree = tree, .wanted = wanted, .nearest = {HUGE_VAL}};
  pags_copy3(at, added->at);
  return PAGS_OK;
}

static pags_result find_true_feet(pags_proxy_bench *self, feet *out) {
  PAGS_AUTO(pags_bench_free_rays) pags_bench_rays rays = {0};
  PAGS_TRY(pags_bench_aim_at_feet(self, &rays));
  PAGS_TRY(pags_bench_cast(self, pags_bench_middle(self), &rays, 0));
  PAGS_TRY(pags_bench_see(self, &rays));
  for (int64_t i = 0; i < rays.count;) {
    const int placement = rays.list[i].group;
    bool seen = false, tree = false;
    for (; i < rays.count && rays.list[i].group == placement; i++)
      if (rays.list[i].placement == placement) {
        seen |= rays.list[i].seen;
        tree |= rays.list[i].kind == PAGS_KIND_TREE;
      }
    const float *pose = self->street.placements[placement].pose;
    if (placement > 0)
      PAGS_TRY(add_foot(out, (double[3]){(double)pose[3], (double)pose[7], (double)pose[11]}, tree, seen));
  }
  return PAGS_OK;
}

/* The foot of a thing: the middle of its lowest vertices. */
static void find_foot(const pags_placed *placed, int64_t first, double out[3]) {
  double low = HUGE_VAL, sum[2] = {0}, p[3];
  int64_t n = 0;
  for (int pass = 0; pass < 2; pass++)
    for (int64_t i = first; i < placed->count; i++) {
      const pags_placed_proxy *part = &placed->list[i];
      if (i != first && (part->thing < 0 || part->thing != placed->list[first].thing))
        continue;
      for (int64_t v = 0; v < part->mesh.vertex_count; v++) {
        pags_proxy_mesh_point(&part->mesh, v, p);
        if (pass == 0)
          low = fmin(low, p[2]);
        else if (p[2] < low + foot_height) {
          sum[0] += p[0];
          sum[1] += p[1];
          n++;
        }
      }
    }
  const double relative[3] = {sum[0] / (double)n, sum[1] / (double)n, low};
  pags_add3(relative, placed->origin, out);
}

static pags_result find_proxy_feet(const pags_proxy_bench *self, feet *out) {
  const pags_placed *placed = &self->placed;
  const double begin = pags_street_ego_x(&self->options, 0);
  for (int64_t i = 0; i < placed->count; i++) {
    const pags_placed_proxy *first = &placed->list[i];
    double at[3];
    bool new = first->kind == PAGS_KIND_TREE || first->kind == PAGS_KIND_POLE || first->kind == PAGS_KIND_SIGN;
    for (int64_t j = 0; j < i && first->thing >= 0; j++)
      new = new && placed->list[j].thing != first->thing;
    if (!new)
      continue;
    find_foot(placed, i, at);
    const double ahead = fmax(fmax(begin - at[0], at[0] - self->street.end), 0);
    PAGS_TRY(add_foot(out, at, first->kind == PAGS_KIND_TREE, pags_hypot(ahead, at[1]) <= 40));
  }
  return PAGS_OK;
}

/* Finds the nearest one of `others` for each of `some`. */
static void find_nearest(feet *some, const feet *others) {
  for (foot *a = some->list; a < some->list + some->count; a++)
    for (const foot *b = others->list; b < others->list + others->count; b++) {
      const double d[3] = {b->at[0] - a->at[0], b->at[1] - a->at[1], b->at[2] - a->at[2]};
      if (a->tree == b->tree && sqrt(d[0] * d[0] + d[1] * d[1]) <= match && pags_length3(d) < pags_length3(a->nearest))
        pags_copy3(d, a->nearest);
    }
}

static void count_feet(const feet *f, bool tree, int64_t *all, int64_t *found) {
  *all = *found = 0;
  for (const foot *a = f->list; a < f->list + f->count; a++)
    if (a->tree == tree && a->wanted) {
      ++*all;
      *found += a->nearest[0] < HUGE_VAL;
    }
}

static pags_result tell_uprights(pags_proxy_bench *self) {
  PAGS_AUTO(free_feet) feet truth = {0};
  PAGS_AUTO(free_feet) feet proxies = {0};
  PAGS_TRY(find_true_feet(self, &truth));
  PAGS_TRY(find_proxy_feet(self, &proxies));
  find_nearest(&truth, &proxies);
  find_nearest(&proxies, &truth);
  PAGS_AUTOFREE double *errors = malloc((size_t)(truth.count + 1) * sizeof *errors);
  PAGS_CHECK_MEMORY(errors, "%lld feet", (long long)truth.count);
  pags_say(&self->session,
           "Feet of what a training camera saw below 2 m, with a proxy's within 1 m (recall); proxies within 40 m of "
           "the path "
           "with a true one (precision)\n");
  pags_json_begin_object(&self->json, "uprights");
  for (int tree = 0; tree < 2; tree++) {
    static const char *const names[2] = {"poles and signs", "trees"};
    int64_t all, found, made, right, count = 0;
    char text[2][16];
    count_feet(&truth, tree, &all, &found);
    count_feet(&proxies, tree, &made, &right);
    for (const foot *a = truth.list; a < truth.list + truth.count; a++)
      if (a->tree == tree && a->wanted && a->nearest[0] < HUGE_VAL)
        errors[count++] = pags_length3(a->nearest);
    const pags_proxy_distance d = pags_distance_summary(errors, count);
    pags_say(&self->session, "%-15s recall %s of %lld, precision %s of %lld, feet off by %.3f m (p95 %.3f, max %.3f)\n",
             names[tree], pags_bench_share(text[0], found, all), (long long)all, pags_bench_share(text[1], right, made),
             (long long)made, d.mean, d.p95, d.max);
    pags_json_begin_object(&self->json, tree ? "trees" : "poles_and_signs");
    pags_json_put_integer(&self->json, "true", all);
    pags_json_put_number(&self->json, "recall", (double)found / (double)all);
    pags_json_put_integer(&self->json, "proxies", made);
    pags_json_put_number(&self->json, "precision", (double)right / (double)made);
    pags_proxy_bench_put(&self->json, "foot_error", &d);
    pags_json_end_object(&self->json);
  }
  pags_json_end_object(&self->json);
  return PAGS_OK;
}

pags_result pags_bench_parts(pags_proxy_bench *self) {
  PAGS_TRY(tell_parts(self));
  return tell_uprights(self);
}
