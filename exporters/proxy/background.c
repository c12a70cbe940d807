/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of the background. The scene without its labelled objects is drawn by an even choice of the
 * training cameras, and the depths are fused tile by tile into TSDFs (tsdf.h).
 *
 * Surface near the ground is left to the ground's mesh (ground.h). The rest is split by class (classes.c). The surface
 * of each tile and class is a chunk, or classes are joined over all tiles and closed blocks are made of them
 * (blocks.c). */
#include "exporters/proxy/background.h"

#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/parallel.h"
#include "exporters/proxy/blocks.h"
#include "maths/maths.h"

enum { MOST_VIEWS = 120, CLUSTER = 64 }; /* most views that are drawn; Gaussians a cluster */

/* The ground has no holes up to this distance from the cameras, metres: about 10 m from the path between them. */
static const double ground_reach = 11;
/* If chunks are surfaces, the ground ends at this distance from the cameras, metres. */
static const double ground_margin = 25;
static const double ground_skin = 0.2; /* surface lower than this over the ground belongs to the ground, metres */
static const double least_area = 0.4;  /* connected components of less area are floaters, square metres */

/* ---- Drawing the background ---- */

/* Gathers the Gaussians of the background model that belong to no parked object (pags_object_mark). */
static pags_result gather_background(const pags_proxy_maker *w, pags_gaussians *out) {
  const pags_gaussians *g = &w->scene->models[0].gaussians;
  PAGS_AUTOFREE uint8_t *taken = calloc((size_t)g->count + 1, 1);
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians loose = {0};
  PAGS_CHECK_MEMORY(taken, "%lld Gaussians", (long long)g->count);
  for (int64_t o = 0; o < w->scene->object_count; o++)
    if (w->scene->objects[o].model < 0)
      pags_object_mark(w, o, taken);
  if (w->bare)
    PAGS_TRY(pags_bare_mark_haze(w->bare, g, taken));
  PAGS_TRY(pags_gaussians_select(g, taken, false, &loose));
  return pags_gaussians_sorted_copy(out, &loose);
}

/* Draws the depth views: all training views, or an even choice of MOST_VIEWS of them. */
static pags_result look(const pags_proxy_maker *w, const pags_part *part, pags_progress_fn *tell, void *user,
                        pags_background *out) {
  const bool within =
      w->bare && (w->bare->inside || w->bare->photographed); /* walls and floors are seen at grazing angles */
  int64_t count = 0, taken = 0, seen = 0;
  for (int64_t v = 0; v < w->scene->view_count; v++)
    count += !w->scene->views[v].test;
  for (int64_t v = 0; v < w->scene->view_count; v++) {
    const pags_scene_view *view = &w->scene->views[v];
    if (view->test || (count > MOST_VIEWS && seen++ * MOST_VIEWS / count < taken))
      continue;
    taken++;
    PAGS_TRY(pags_proxy_tell(tell, user, 0.4 * (double)v / (double)w->scene->view_count, "background: views"));
    const pags_camera *camera = &w->scene_depth.views[v].camera;
    pags_frame_options drawing = pags_drawing_at(&w->drawing, &view->camera, camera);
    PAGS_TRY(pags_depth_views_add(&out->depth_views, w->frame, part, 1, camera, &drawing, v,
                                  within || (w->scene->up == PAGS_UP_Z && !w->bare)));
    pags_depth_view *added = &out->depth_views.list[out->depth_views.count - 1];
    if (within)
      pags_depth_view_flatten(added);
    pags_depth_view_hide(added, &w->scene_depth.views[v]);
    pags_classes_load(w, view, added);
    out->labelled = out->labelled || added->labels;
  }
  return PAGS_OK;
}

/* Whether chunks are the surface as it was seen. */
static bool makes_surface(const pags_proxy_maker *w) {
  return w->options->background_form == PAGS_BACKGROUND_SURFACE || w->bare || w->scene->up != PAGS_UP_Z;
}

/* ---- The ground ---- */

static pags_result add_ground(const pags_proxy_maker *w, pags_background *out, pags_ground *ground) {
  const pags_scene *scene = w->scene;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh mesh = {0};
  /* The positions of the cameras of all views, held-out ones, too, relative to the scene's origin. */
  PAGS_AUTOFREE double *path = malloc(((size_t)scene->view_count + 1) * 3 * sizeof *path);
  PAGS_CHECK_MEMORY(path, "%lld views", (long long)scene->view_count);
  for (int64_t i = 0; i < scene->view_count; i++) {
    pags_pose_position(scene->views[i].camera.world_from_camera, path + 3 * i);
    pags_subtract3(path + 3 * i, scene->origin, path + 3 * i);
  }
  PAGS_TRY(pags_ground_find(&out->depth_views, &w->lidar, path, scene->view_count, ground_reach,
                            makes_surface(w) ? ground_margin : w->options->range, ground));
  if (!ground->nx)
    return PAGS_OK;
  if (out->labelled && !makes_surface(w))
    return PAGS_OK; /* its parts come when the cloud is there */
  PAGS_TRY(pags_ground_mesh(ground, w->options->ground_triangles, &mesh));
  PAGS_TRY(pags_proxy_mesh_paint(&mesh, &out->depth_views, 0.3, w->tasks));
  return pags_background_add(out, "ground", &mesh);
}

/* Finds upright thin things in the LiDAR's points, or without LiDAR in the Gaussians' middles. */
static pags_result find_columns(const pags_proxy_maker *w, const pags_gaussians *g, const pags_ground *ground,
                                pags_background *b) {
  const bool lidar = w->lidar.count > 0;
  PAGS_AUTOFREE float *middles = lidar ? NULL : malloc(((size_t)g->count + 1) * 3 * sizeof *middles);
  int64_t count = 0;
  PAGS_CHECK_MEMORY(lidar || middles, "%lld Gaussians", (long long)g->count);
  for (int64_t i = 0; i < g->count && !lidar; i++) {
    if (!(pags_plane(g, PAGS_OPACITY)[i] > 0)) /* less than half opaque */
      continue;
    for (int k = 0; k < 3; k++)
      middles[3 * count + k] = pags_plane(g, PAGS_MEAN + k)[i];
    count++;
  }
  PAGS_TRY(pags_cloud_make(lidar ? w->lidar.points : middles, lidar ? w->lidar.count : count, ground, &b->depth_views,
                           &b->cloud));
  return pags_columns_find(&b->cloud, ground, &b->depth_views, &b->columns);
}

/* A square tile of the background and its result: a mesh for each class, which may be empty. */
typedef struct tile {
  double lo[3], hi[3];
  int64_t first, last; /* range of its points among those sorted by tile */
  pags_proxy_mesh parts[PAGS_CHUNK_CLASSES];
} tile;

/* Connected components of less area are floaters. Without photographs there may be no metres: the same share of the
 * step. */
static double floater_area(const pags_proxy_maker *w) {
  return w->bare ? least_area * pags_pow(w->options->voxel / 0.15, 2) : least_area;
}

/* Copies the triangles of one class out of a tile's mesh, without floaters. */
static pags_result take_class(const pags_proxy_maker *w, const pags_proxy_mesh *mesh, const uint8_t *class_of,
                              int class, pags_proxy_mesh *part) {
  PAGS_AUTOFREE uint32_t *triangles = malloc(((size_t)mesh->triangle_count + 1) * 3 * sizeof *triangles);
  PAGS_CHECK_MEMORY(triangles, "%lld triangles", (long long)mesh->triangle_count);
  int64_t count = 0;
  for (int64_t i = 0; i < mesh->triangle_count; i++) {
    const uint32_t *t = mesh->triangles + 3 * i;
    /* A triangle has the class that two of its corners have, else the class of the first. */
    int own = class_of[t[1]] == class_of[t[2]] ? class_of[t[1]] : class_of[t[0]];
    if (own == class)
      memcpy(triangles + 3 * count++, t, 3 * sizeof *t);
  }
  if (!count)
    return PAGS_OK;
  PAGS_TRY(pags_proxy_mesh_copy_part(mesh, triangles, count, part));
  return pags_proxy_mesh_drop_floaters(part, floater_area(w));
}

/* Removes ground and floaters from a tile's mesh, paints it and splits it by class. */
static pags_result cut_by_class(const pags_proxy_maker *w, const pags_background *b, const pags_ground *ground,
                                pags_proxy_mesh *mesh, tile *out) {
  /* Leave out triangles whose centre is less than `ground_skin` above the ground, or below it. */
  for (int64_t i = 0; i < mesh->triangle_count; i++) {
    double p[3], z;
    pags_proxy_mesh_middle(mesh, i, p);
    if (pags_ground_height(ground, p[0], p[1], &z) && p[2] < z + ground_skin)
      mesh->triangles[3 * i] = UINT32_MAX;
  }
  pags_proxy_mesh_drop_marked(mesh);
  PAGS_TRY(pags_proxy_mesh_compact(mesh));
  PAGS_TRY(pags_proxy_mesh_drop_floaters(mesh, floater_area(w)));
  if (!mesh->triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_proxy_mesh_paint(mesh, &b->depth_views, 3 * w->options->voxel, w->tasks));
  PAGS_AUTOFREE uint8_t *class_of = malloc((size_t)mesh->vertex_count);
  PAGS_CHECK_MEMORY(class_of, "%lld vertices", (long long)mesh->vertex_count);
  if (w->bare)
    memset(class_of, PAGS_CHUNK_SURFACE, (size_t)mesh->vertex_count);
  else
    PAGS_TRY(pags_classes_find(w, &b->depth_views, b->labelled, mesh, class_of));
  for (int class = 0; class < PAGS_CHUNK_CLASSES; class ++)
    PAGS_TRY(take_class(w, mesh, class_of, class, &out->parts[class]));
  return PAGS_OK;
}

/* ---- Tiles ---- */

/* The background divided into tiles, and the depths of all views as points grouped by tile. A point within `reach` of
 * a tile is in that tile's group, too. */
typedef struct tiling {
  const pags_proxy_maker *maker;
  const pags_background *background;
  const pags_ground *ground;
  pags_progress_fn *tell;
  void *user;
  double side, step, reach;    /* side of a tile, step of the TSDF, distance from points that is fused; metres */
  int64_t origin[2], count[2]; /* number of the first tile along x and y, and how many there are */
  tile *tiles;
  float *points;
  atomic_llong done;
} tiling;

static void forget_tiling(tiling *t) {
  for (int64_t i = 0; t->tiles && i < t->count[0] * t->count[1]; i++)
    for (int class = 0; class < PAGS_CHUNK_CLASSES; class ++)
      pags_proxy_mesh_destroy(&t->tiles[i].parts[class]);
  free(t->tiles);
  free(t->points);
}

static int64_t tile_of(const tiling *t, double x, int axis) {
  int64_t i = (int64_t)floor(x / t->side) - t->origin[axis];
  return i < 0 ? 0 : i >= t->count[axis] ? t->count[axis] - 1 : i;
}

/* Visits every second depth in x and y of all views: while `points` is NULL, it counts them in each tile's `last`,
 * else it stores them. */
static void visit_depths(tiling *t) {
  const pags_depth_views *depth_views = &t->background->depth_views;
  for (int64_t i = 0; i < depth_views->count; i++) {
    const pags_depth_view *s = &depth_views->list[i];
    for (int y = 0; y < s->camera.height; y += 2)
      for (int x = 0; x < s->camera.width; x += 2) {
        double p[3], depth = (double)s->depth[(int64_t)y * s->camera.width + x];
        if (!(depth > 0 && depth < t->maker->options->range))
          continue;
        pags_depth_view_point(s, x, y, depth, p);
        for (int64_t v = tile_of(t, p[1] - t->reach, 1); v <= tile_of(t, p[1] + t->reach, 1); v++)
          for (int64_t u = tile_of(t, p[0] - t->reach, 0); u <= tile_of(t, p[0] + t->reach, 0); u++) {
            tile *own = &t->tiles[v * t->count[0] + u];
            if (t->points)
              pags_narrow3(p, t->points + 3 * own->last);
            own->last++;
          }
      }
  }
}

/* Fuses the blocks of a tile that are near depths, extracts the surface and splits it by class. */
static pags_result fuse_tile(const tiling *t, tile *own) {
  const pags_proxy_maker *w = t->maker;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh mesh = {0};
  PAGS_AUTO(pags_tsdf_destroy) pags_tsdf grid = {0};
  if (own->first == own->last)
    return PAGS_OK;
  PAGS_TRY(pags_tsdf_create(&grid, own->lo, own->hi, t->step, true));
  for (int64_t i = own->first; i < own->last; i++) {
    double point[3];
    pags_widen3(t->points + 3 * i, point);
    pags_tsdf_touch(&grid, point, t->reach);
  }
  PAGS_TRY(
      pags_tsdf_fuse(&grid, &t->background->depth_views, 3 * t->step, 3 * t->step, w->options->range, true, w->tasks));
  PAGS_TRY(pags_tsdf_surface(&grid, true, &mesh));
  pags_tsdf_destroy(&grid); /* the largest of all: not needed any more */
  return cut_by_class(w, t->background, t->ground, &mesh, own);
}

static pags_result make_tile(void *context, int64_t i, int worker) {
  tiling *t = context;
  PAGS_TRY(fuse_tile(t, &t->tiles[i]));
  const double done = (double)(atomic_fetch_add(&t->done, 1) + 1) / (double)(t->count[0] * t->count[1]);
  return worker ? PAGS_OK : pags_proxy_tell(t->tell, t->user, 0.45 + 0.45 * done, "background: surface");
}

/* The box that holds the depths within range, without outliers: a thousandth at either end of each axis. */
static pags_result find_extent(const pags_proxy_maker *w, const pags_depth_views *depth_views, double lo[3],
                               double hi[3]) {
  enum { BINS = 4096 };
  PAGS_AUTOFREE int64_t *bins = calloc(3 * BINS, sizeof *bins);
  int64_t count = 0;
  double from[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, to[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  PAGS_CHECK_MEMORY(bins, NULL);
  for (int64_t i = 0; i < depth_views->count; i++)
    for (int k = 0; k < 3; k++) {
      double c = depth_views->list[i].camera.world_from_camera[4 * k + 3];
      from[k] = fmin(from[k], c - w->options->range * 1.5);
      to[k] = fmax(to[k], c + w->options->range * 1.5);
    }
  for (int64_t i = 0; i < depth_views->count; i++) {
    const pags_depth_view *s = &depth_views->list[i];
    for (int y = 0; y < s->camera.height; y += 4)
      for (int x = 0; x < s->camera.width; x += 4) {
        double p[3], depth = (double)s->depth[(int64_t)y * s->camera.width + x];
        if (!(depth > 0 && depth < w->options->range))
          continue;
        pags_depth_view_point(s, x, y, depth, p);
        count++;
        for (int k = 0; k < 3; k++) {
          double bin = floor((p[k] - from[k]) / (to[k] - from[k]) * BINS);
          ++bins[k * BINS + (int)fmin(fmax(bin, 0), BINS - 1)];
        }
      }
  }
  for (int k = 0; k < 3; k++) {
    int64_t below = 0, above = 0;
    int a = 0, z = BINS - 1;
    while (a < BINS - 1 && (below += bins[k * BINS + a]) * 1000 < count)
      a++;
    while (z > a && (above += bins[k * BINS + z]) * 1000 < count)
      z--;
    lo[k] = from[k] + (to[k] - from[k]) * a / BINS;
    hi[k] = from[k] + (to[k] - from[k]) * (z + 1) / BINS;
  }
  return PAGS_OK;
}

/* Makes chunks of the surface of one class, joined over all tiles. */
typedef pags_result class_maker(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                                pags_proxy_mesh *joined);

/* What is road or pavement is the ground's. */
static pags_result leave_out(PAGS_UNUSED const pags_proxy_maker *w, PAGS_UNUSED pags_background *b,
                             PAGS_UNUSED const pags_ground *ground, PAGS_UNUSED pags_proxy_mesh *joined) {
  return PAGS_OK;
}

/* NULL: chunks are the surfaces of the tiles. */
static class_maker *const class_makers[PAGS_CHUNK_CLASSES] = {[PAGS_CHUNK_ROAD] = leave_out,
                                                              [PAGS_CHUNK_SIDEWALK] = leave_out,
                                                              [PAGS_CHUNK_BUILDING] = pags_blocks_make,
                                                              [PAGS_CHUNK_VEGETATION] = pags_trees_make,
                                                              [PAGS_CHUNK_POLE] = pags_poles_make};

/* Joins the surface of a class over all tiles and makes its chunks. */
static pags_result make_class(const tiling *t, int class, pags_background *b) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh joined = {0};
  for (int64_t i = 0; i < t->count[0] * t->count[1]; i++) {
    PAGS_TRY(pags_proxy_mesh_append(&t->tiles[i].parts[class], &joined));
    pags_proxy_mesh_destroy(&t->tiles[i].parts[class]);
  }
  PAGS_TRY(pags_proxy_mesh_weld(&joined, 0.001 * t->step));
  PAGS_TRY(pags_proxy_mesh_crop(t->maker->options, &joined));
  return class_makers[class](t->maker, b, t->ground, &joined);
}

/* Makes all tiles in parallel and appends chunks of their meshes. */
static pags_result add_tiles(const pags_proxy_maker *w, pags_progress_fn *tell, void *user, const pags_ground *ground,
                             pags_background *b) {
  double lo[3], hi[3];
  PAGS_AUTO(forget_tiling)
  tiling t = {.maker = w, .background = b, .ground = ground, .tell = tell, .user = user, .side = w->options->chunk};
  const bool surface = makes_surface(w);
  PAGS_TRY(find_extent(w, &b->depth_views, lo, hi));
  /* A tile's side is a whole number of steps, so the grids of neighbouring tiles share the points of their border. */
  t.step = t.side / ceil(t.side / w->options->voxel);
  t.reach = 3 * t.step;
  for (int k = 0; k < 2; k++) {
    t.origin[k] = (int64_t)floor(lo[k] / t.side);
    t.count[k] = (int64_t)floor(hi[k] / t.side) - t.origin[k] + 1;
  }
  int64_t count = t.count[0] * t.count[1];
  t.tiles = calloc((size_t)count, sizeof *t.tiles);
  PAGS_CHECK_MEMORY(t.tiles, "%lld tiles", (long long)count);
  for (int64_t i = 0; i < count; i++) {
    const int64_t at[2] = {t.origin[0] + i % t.count[0], t.origin[1] + i / t.count[0]};
    for (int k = 0; k < 2; k++) {
      t.tiles[i].lo[k] = (double)at[k] * t.side;
      t.tiles[i].hi[k] = (double)(at[k] + 1) * t.side - 0.01 * t.step;
    }
    t.tiles[i].lo[2] = lo[2] - t.reach;
    t.tiles[i].hi[2] = hi[2] + t.reach;
  }
  /* Group the depths of all views by tile: count them, then store them. */
  int64_t total = 0;
  visit_depths(&t);
  for (int64_t i = 0; i < count; i++) {
    const int64_t own = t.tiles[i].last;
    t.tiles[i].first = t.tiles[i].last = total;
    total += own;
  }
  t.points = malloc(((size_t)total + 1) * 3 * sizeof *t.points);
  PAGS_CHECK_MEMORY(t.points, "%lld points", (long long)total);
  visit_depths(&t);
  PAGS_TRY(pags_proxy_tell(tell, user, 0.45, "background: surface"));
  PAGS_TRY(pags_parallel_try(w->tasks, count, make_tile, &t, "interrupted"));
  PAGS_TRY(pags_proxy_tell(tell, user, 0.9, "background: shapes"));
  for (int class = 0; class < PAGS_CHUNK_CLASSES && !surface; class ++)
    if (class_makers[class])
      PAGS_TRY(make_class(&t, class, b));
  for (int64_t i = 0; i < count; i++)
    for (int class = 0; class < PAGS_CHUNK_CLASSES; class ++)
      if (t.tiles[i].parts[class].triangle_count)
        PAGS_TRY(pags_background_add(b, pags_class_names[class], &t.tiles[i].parts[class]));
  return PAGS_OK;
}

/* ---- Everything ---- */

/* Adds what was looked at from all round as one chunk. */
static pags_result add_bare(const pags_proxy_maker *w, pags_background *b) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh mesh = {0};
  pags_proxy_level level;
  const char *note;
  PAGS_TRY(pags_bare_surface(w->bare, w->options, &b->depth_views, w->tasks, &mesh));
  PAGS_TRY(pags_bare_level(w->bare, w->options, &mesh, &level, &note));
  if (!mesh.triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_background_add(b, pags_class_names[PAGS_CHUNK_SURFACE], &mesh));
  b->chunks[0].level = level;
  b->chunks[0].note = note;
  return PAGS_OK;
}

pags_result pags_background_make(const pags_proxy_maker *w, pags_progress_fn *tell, void *user, pags_background *out) {
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  PAGS_AUTO(pags_clusters_destroy) pags_clusters clusters = {0};
  PAGS_AUTO(pags_ground_destroy) pags_ground ground = {0};
  *out = (pags_background){.s_sem = (double)NAN};
  if (!w->scene->model_count)
    return PAGS_OK;
  PAGS_TRY(gather_background(w, &g));
  out->gaussians = g.count;
  if (g.s_sem && g.count) {
    out->s_sem = 0;
    for (int64_t i = 0; i < g.count; i++)
      out->s_sem += (double)g.s_sem[i] / (double)g.count;
  }
  PAGS_TRY(pags_clusters_create(&clusters, g.count, CLUSTER));
  pags_clusters_update(&clusters, &g, 0, clusters.count);
  const pags_part part = {
      .gaussians = &g, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  PAGS_TRY(look(w, &part, tell, user, out));
  if (!out->depth_views.count)
    return PAGS_OK;
  if (w->bare && !w->bare->inside) {
    PAGS_TRY(pags_proxy_tell(tell, user, 0.4, "background: surface"));
    return add_bare(w, out);
  }
  PAGS_TRY(pags_proxy_tell(tell, user, 0.4, "background: ground"));
  if (w->scene->up == PAGS_UP_Z && !w->bare)
    PAGS_TRY(add_ground(w, out, &ground));
  if (!makes_surface(w))
    PAGS_TRY(find_columns(w, &g, &ground, out));
  if (!makes_surface(w) && out->labelled)
    PAGS_TRY(pags_ground_parts_make(w, out, &ground));
  PAGS_TRY(add_tiles(w, tell, user, &ground, out));
  return pags_background_finish(w, out);
}
