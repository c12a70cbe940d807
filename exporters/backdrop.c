/* The background: drawn without labelled objects by a choice of the training cameras, its depth fused tile by tile.
 *
 * A surface that is near the ground belongs to the ground. The rest is cut by class: by what the data set's semantic pictures say where they
 * are at hand, else by shape and colour. */
#include "backdrop.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#ifdef PAGS_WITH_IMAGES
#include <pags/image.h>
#endif

enum { MOST_VIEWS = 120, WIDEST = 480, CLUSTER = 64, LEAST_TRIANGLES = 8 };
enum { ROAD, SIDEWALK, BUILDING, VEGETATION, POLE, OTHER, CLASSES, UNLABELLED = 255 };
static const char *const class_names[CLASSES] = {"road", "sidewalk", "building", "vegetation", "pole", "other"};

static const double ground_reach = 10; /* metres from the path that the ground covers without holes */
static const double ground_skin = 0.2; /* metres above the ground that still are the ground */
static const double least_area = 0.4;  /* square metres of a part: less floats */

void pags_backdrop_destroy(pags_backdrop *backdrop) {
  pags_sights_destroy(&backdrop->sights);
  for (int64_t i = 0; i < backdrop->chunk_count; ++i)
    pags_shell_destroy(&backdrop->chunks[i].shell);
  free(backdrop->chunks);
  memset(backdrop, 0, sizeof *backdrop);
}

/* Cityscapes' train ids. */
static uint8_t class_of_label(uint8_t label) {
  static const uint8_t of[10] = {ROAD, SIDEWALK, BUILDING, BUILDING, BUILDING, POLE, POLE, POLE, VEGETATION, VEGETATION};
  return label < 10 ? of[label] : UNLABELLED;
}

/* The scene's Gaussians that are nobody's: no object's number, in no parked object's box. */
static pags_result gather_background(const pags_workshop *w, pags_gaussians *out) {
  const pags_gaussians *g = &w->scene->models[0].gaussians;
  uint8_t *taken = calloc((size_t)g->count + 1, 1);
  int64_t count = 0, *index = malloc(((size_t)g->count + 1) * sizeof *index);
  if (!taken || !index) {
    free(taken);
    free(index);
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld Gaussians", (long long)g->count);
  }
  for (int64_t o = 0; o < w->scene->object_count; ++o)
    if (w->scene->objects[o].model < 0)
      pags_object_mark(w, o, taken);
  for (int64_t i = 0; i < g->count; ++i)
    if (!taken[i])
      index[count++] = i;
  free(taken);
  pags_gaussians loose = {0};
  pags_result result = pags_gaussians_create_like(&loose, count, g);
  if (result == PAGS_OK) {
    pags_gaussians_gather(g, index, count, &loose);
    result = pags_gaussians_morton_order(&loose, index);
  }
  if (result == PAGS_OK)
    result = pags_gaussians_create_like(out, count, g);
  if (result == PAGS_OK)
    pags_gaussians_gather(&loose, index, count, out);
  pags_gaussians_destroy(&loose);
  free(index);
  return result;
}

/* The data set's semantic picture of a view, brought to the sight's size; nothing where there is none. */
static void load_labels(const pags_workshop *w, const pags_scene_view *view, pags_sight *sight) {
#ifdef PAGS_WITH_IMAGES
  char path[1024];
  pags_image image;
  const char *name = pags_path_name(view->name);
  int stem = (int)(strlen(name) - strlen(pags_path_extension(name)));
  int width = sight->camera.width, height = sight->camera.height;
  if (!w->scene->dataset)
    return;
  snprintf(path, sizeof path, "%s/semantic/%.*s.png", w->scene->dataset, stem, name);
  if (!pags_file_exists(path) || pags_image_load(path, PAGS_U8, 1, &image) != PAGS_OK)
    return;
  sight->labels = malloc((size_t)width * (size_t)height);
  for (int y = 0; sight->labels && y < height; ++y)
    for (int x = 0; x < width; ++x) {
      int u = (2 * x + 1) * image.width / (2 * width), v = (2 * y + 1) * image.height / (2 * height);
      sight->labels[(size_t)y * (size_t)width + (size_t)x] =
          class_of_label(((const uint8_t *)image.data)[(size_t)v * (size_t)image.width + (size_t)u]);
    }
  pags_image_destroy(&image);
#else
  (void)w;
  (void)view;
  (void)sight;
#endif
}

static int shows_training(const pags_scene_view *view) {
  return !view->test;
}

static pags_result look(const pags_workshop *w, const pags_part *part, pags_progress_fn *tell, void *user, pags_backdrop *out) {
  int64_t count = 0, taken = 0, seen = 0;
  for (int64_t v = 0; v < w->scene->view_count; ++v)
    count += shows_training(&w->scene->views[v]);
  for (int64_t v = 0; v < w->scene->view_count; ++v) {
    const pags_scene_view *view = &w->scene->views[v];
    if (!shows_training(view) || (count > MOST_VIEWS && seen++ * MOST_VIEWS / count < taken))
      continue;
    ++taken;
    if (!tell(user, 0.4 * (double)v / (double)w->scene->view_count, "background: views"))
      return pags_fail(PAGS_CANCELLED, "interrupted");
    pags_camera camera = pags_camera_downscale(&view->camera, fmax(1, view->camera.width / (double)WIDEST));
    for (int k = 0; k < 3; ++k)
      camera.world_from_camera[4 * k + 3] -= w->scene->origin[k];
    PAGS_TRY(pags_sights_add(&out->sights, w->frame, part, 1, &camera, &w->drawing, v));
    load_labels(w, view, &out->sights.list[out->sights.count - 1]);
    out->labelled = out->labelled || out->sights.list[out->sights.count - 1].labels != NULL;
  }
  return PAGS_OK;
}

static pags_result draw_views(const pags_workshop *w, const pags_gaussians *g, pags_progress_fn *tell, void *user,
                              pags_backdrop *out) {
  pags_clusters clusters;
  pags_part part = {.gaussians = g, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  PAGS_TRY(pags_clusters_create(&clusters, g->count, CLUSTER));
  pags_clusters_update(&clusters, g, 0, clusters.count);
  pags_result result = look(w, &part, tell, user, out);
  pags_clusters_destroy(&clusters);
  return result;
}

/* Takes the shell over. */
static pags_result add_chunk(pags_backdrop *b, const char *class_name, pags_shell *shell) {
  if (b->chunk_count == b->chunk_capacity) {
    int64_t capacity = 2 * b->chunk_capacity + 64;
    pags_chunk *grown = realloc(b->chunks, (size_t)capacity * sizeof *grown);
    if (!grown) {
      pags_shell_destroy(shell);
      return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld chunks", (long long)capacity);
    }
    b->chunks = grown;
    b->chunk_capacity = capacity;
  }
  int number = 0;
  for (int64_t i = 0; i < b->chunk_count; ++i)
    number += !strcmp(b->chunks[i].class_name, class_name);
  b->chunks[b->chunk_count++] = (pags_chunk){.class_name = class_name, .number = number, .shell = *shell};
  *shell = (pags_shell){0};
  return PAGS_OK;
}

static pags_result add_ground(const pags_workshop *w, pags_backdrop *out, pags_ground *ground) {
  double *path = malloc(((size_t)out->sights.count + 1) * 3 * sizeof *path);
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld views", (long long)out->sights.count);
  for (int64_t i = 0; i < out->sights.count; ++i)
    for (int k = 0; k < 3; ++k)
      path[3 * i + k] = out->sights.list[i].camera.world_from_camera[4 * k + 3];
  pags_result result = pags_ground_find(&out->sights, path, out->sights.count, ground_reach, ground);
  free(path);
  PAGS_TRY(result);
  if (!ground->nx)
    return PAGS_OK;
  pags_shell shell;
  PAGS_TRY(pags_ground_shell(ground, w->options->ground_triangles, &shell));
  if (!pags_shell_paint(&shell, &out->sights, 0.3, w->tasks)) {
    pags_shell_destroy(&shell);
    return pags_fail(PAGS_CANCELLED, "interrupted");
  }
  return add_chunk(out, "ground", &shell);
}

typedef struct naming {
  const pags_shell *shell;
  const pags_sights *sights;
  const pags_ground *ground;
  double tolerance;
  uint8_t *class_of; /* one a vertex */
} naming;

static uint8_t vote(const naming *self, const double point[3]) {
  int votes[CLASSES] = {0}, best = 0, x, y;
  double z;
  for (int64_t s = 0; s < self->sights->count; ++s) {
    const pags_sight *sight = &self->sights->list[s];
    if (!sight->labels || !pags_sight_project(sight, point, &x, &y, &z))
      continue;
    int64_t pixel = (int64_t)y * sight->camera.width + x;
    if (fabs((double)sight->depth[pixel] - z) < self->tolerance && sight->labels[pixel] < CLASSES)
      ++votes[sight->labels[pixel]];
  }
  for (int c = 1; c < CLASSES; ++c)
    best = votes[c] > votes[best] ? c : best;
  return votes[best] ? (uint8_t)best : OTHER;
}

/* Upright and not green: a building. Level: road. Else vegetation. Poles are not told. */
static uint8_t guess(const float normal[3], const float color[3]) {
  int green = color[1] > 1.05f * color[0] && color[1] > color[2];
  if (normal[2] > 0.9f)
    return ROAD;
  return !green && fabsf(normal[2]) < 0.35f ? BUILDING : green ? VEGETATION : OTHER;
}

static void name_vertices(void *context, int64_t begin, int64_t end, int worker) {
  const naming *self = context;
  (void)worker;
  for (int64_t i = begin; i < end; ++i) {
    const float *p = self->shell->positions + 3 * i;
    const double point[3] = {(double)p[0], (double)p[1], (double)p[2]};
    self->class_of[i] = vote(self, point);
  }
}

static pags_result find_classes(const pags_workshop *w, const pags_backdrop *b, const pags_shell *shell, uint8_t *class_of) {
  naming self = {.shell = shell, .sights = &b->sights, .tolerance = 3 * w->options->voxel, .class_of = class_of};
  if (b->labelled)
    return pags_parallel_for(w->tasks, shell->vertex_count, 256, name_vertices, &self) ? PAGS_OK
                                                                                     : pags_fail(PAGS_CANCELLED, "interrupted");
  float *normals = malloc(((size_t)shell->vertex_count + 1) * 3 * sizeof *normals);
  if (!normals)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld vertices", (long long)shell->vertex_count);
  pags_shell_normals(shell, normals);
  for (int64_t i = 0; i < shell->vertex_count; ++i)
    class_of[i] = guess(normals + 3 * i, shell->colors + 3 * i);
  free(normals);
  return PAGS_OK;
}

/* Leaves out triangles that are the ground, or below it. */
static void drop_ground(pags_shell *shell, const pags_ground *ground) {
  int64_t kept = 0;
  for (int64_t i = 0; i < shell->triangle_count; ++i) {
    double p[3] = {0}, z;
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k)
        p[k] += (double)shell->positions[3 * (int64_t)shell->triangles[3 * i + c] + k] / 3;
    if (pags_ground_height(ground, p[0], p[1], &z) && p[2] < z + ground_skin)
      continue;
    memmove(shell->triangles + 3 * kept++, shell->triangles + 3 * i, 3 * sizeof(uint32_t));
  }
  shell->triangle_count = kept;
}

static pags_result add_class(pags_backdrop *b, const pags_shell *tile, const uint8_t *class_of, int class) {
  pags_shell part;
  PAGS_TRY(pags_shell_copy(tile, &part));
  int64_t kept = 0;
  for (int64_t i = 0; i < part.triangle_count; ++i) {
    const uint32_t *t = part.triangles + 3 * i;
    /* The class of two corners, else of the first. */
    int own = class_of[t[1]] == class_of[t[2]] ? class_of[t[1]] : class_of[t[0]];
    if (own == class)
      memmove(part.triangles + 3 * kept++, t, 3 * sizeof(uint32_t));
  }
  part.triangle_count = kept;
  pags_result result = pags_shell_compact(&part);
  if (result == PAGS_OK)
    result = pags_shell_drop_small(&part, least_area);
  if (result == PAGS_OK && part.triangle_count)
    return add_chunk(b, class_names[class], &part);
  pags_shell_destroy(&part);
  return result;
}

static pags_result cut_by_class(const pags_workshop *w, pags_backdrop *b, const pags_ground *ground, pags_shell *tile) {
  drop_ground(tile, ground);
  PAGS_TRY(pags_shell_compact(tile));
  PAGS_TRY(pags_shell_drop_small(tile, least_area));
  if (!tile->triangle_count)
    return PAGS_OK;
  if (!pags_shell_paint(tile, &b->sights, 3 * w->options->voxel, w->tasks))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  uint8_t *class_of = malloc((size_t)tile->vertex_count);
  if (!class_of)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %lld vertices", (long long)tile->vertex_count);
  pags_result result = find_classes(w, b, tile, class_of);
  for (int class = 0; class < CLASSES && result == PAGS_OK; ++class)
    result = add_class(b, tile, class_of, class);
  free(class_of);
  return result;
}

/* Activates the blocks that depths fall into; returns how many depths do. */
static int64_t touch_tile(const pags_workshop *w, const pags_sights *sights, const double lo[3], const double hi[3],
                          pags_grid *grid) {
  int64_t count = 0;
  double reach = 3 * grid->step;
  for (int64_t i = 0; i < sights->count; ++i) {
    const pags_sight *s = &sights->list[i];
    pags_camera crop;
    if (!pags_camera_crop(&s->camera, lo, hi, 0.2, &crop))
      continue;
    for (int y = 0; y < s->camera.height; y += 2)
      for (int x = 0; x < s->camera.width; x += 2) {
        double p[3], depth = (double)s->depth[(int64_t)y * s->camera.width + x];
        if (!(depth > 0 && depth < w->options->range))
          continue;
        pags_sight_point(s, x, y, depth, p);
        if (p[0] < lo[0] - reach || p[0] > hi[0] + reach || p[1] < lo[1] - reach || p[1] > hi[1] + reach)
          continue;
        pags_grid_touch(grid, p, reach);
        ++count;
      }
  }
  return count;
}

static pags_result add_tile(const pags_workshop *w, pags_backdrop *b, const pags_ground *ground, const double lo[3],
                            const double hi[3], double step) {
  pags_grid grid;
  pags_shell tile = {0};
  PAGS_TRY(pags_grid_create(&grid, lo, hi, step, 1));
  pags_result result = PAGS_OK;
  if (touch_tile(w, &b->sights, lo, hi, &grid)) {
    if (!pags_grid_fuse(&grid, &b->sights, 3 * step, w->options->range, 1, w->tasks))
      result = pags_fail(PAGS_CANCELLED, "interrupted");
    if (result == PAGS_OK)
      result = pags_grid_surface(&grid, 1, &tile);
    if (result == PAGS_OK)
      result = cut_by_class(w, b, ground, &tile);
  }
  pags_shell_destroy(&tile);
  pags_grid_destroy(&grid);
  return result;
}

/* Where depths within range are: the box that holds all but stray ones (a thousandth at either end of each axis). */
static pags_result find_extent(const pags_workshop *w, const pags_sights *sights, double lo[3], double hi[3]) {
  enum { BINS = 4096 };
  int64_t *bins = calloc(3 * BINS, sizeof *bins), count = 0;
  double from[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, to[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  if (!bins)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  for (int64_t i = 0; i < sights->count; ++i)
    for (int k = 0; k < 3; ++k) {
      double c = sights->list[i].camera.world_from_camera[4 * k + 3];
      from[k] = fmin(from[k], c - w->options->range * 1.5);
      to[k] = fmax(to[k], c + w->options->range * 1.5);
    }
  for (int64_t i = 0; i < sights->count; ++i) {
    const pags_sight *s = &sights->list[i];
    for (int y = 0; y < s->camera.height; y += 4)
      for (int x = 0; x < s->camera.width; x += 4) {
        double p[3], depth = (double)s->depth[(int64_t)y * s->camera.width + x];
        if (!(depth > 0 && depth < w->options->range))
          continue;
        pags_sight_point(s, x, y, depth, p);
        ++count;
        for (int k = 0; k < 3; ++k) {
          double bin = floor((p[k] - from[k]) / (to[k] - from[k]) * BINS);
          ++bins[k * BINS + (int)fmin(fmax(bin, 0), BINS - 1)];
        }
      }
  }
  for (int k = 0; k < 3; ++k) {
    int64_t below = 0, above = 0;
    int a = 0, z = BINS - 1;
    while (a < BINS - 1 && (below += bins[k * BINS + a]) * 1000 < count)
      ++a;
    while (z > a && (above += bins[k * BINS + z]) * 1000 < count)
      --z;
    lo[k] = from[k] + (to[k] - from[k]) * a / BINS;
    hi[k] = from[k] + (to[k] - from[k]) * (z + 1) / BINS;
  }
  free(bins);
  return PAGS_OK;
}

static pags_result add_tiles(const pags_workshop *w, pags_progress_fn *tell, void *user, const pags_ground *ground,
                             pags_backdrop *b) {
  double lo[3], hi[3];
  PAGS_TRY(find_extent(w, &b->sights, lo, hi));
  double side = w->options->chunk, step = side / ceil(side / w->options->voxel); /* tiles meet on points of both grids */
  int64_t first[2], last[2], done = 0;
  for (int k = 0; k < 2; ++k) {
    first[k] = (int64_t)floor(lo[k] / side);
    last[k] = (int64_t)floor(hi[k] / side);
  }
  int64_t count = (last[0] - first[0] + 1) * (last[1] - first[1] + 1);
  for (int64_t j = first[1]; j <= last[1]; ++j)
    for (int64_t i = first[0]; i <= last[0]; ++i, ++done) {
      const double tile_lo[3] = {(double)i * side, (double)j * side, lo[2] - 3 * step};
      const double tile_hi[3] = {(double)(i + 1) * side - 0.01 * step, (double)(j + 1) * side - 0.01 * step, hi[2] + 3 * step};
      if (!tell(user, 0.45 + 0.5 * (double)done / (double)count, "background: surface"))
        return pags_fail(PAGS_CANCELLED, "interrupted");
      PAGS_TRY(add_tile(w, b, ground, tile_lo, tile_hi, step));
    }
  return PAGS_OK;
}

/* Each chunk gets its share of the budget by triangles; what would have fewer than a few is left out. */
static pags_result decimate(const pags_workshop *w, pags_backdrop *b) {
  int64_t total = 0, kept = 0;
  for (int64_t i = 0; i < b->chunk_count; ++i)
    total += strcmp(b->chunks[i].class_name, "ground") ? b->chunks[i].shell.triangle_count : 0;
  for (int64_t i = 0; i < b->chunk_count; ++i) {
    pags_chunk *chunk = &b->chunks[i];
    pags_shell simple = {0};
    if (strcmp(chunk->class_name, "ground") != 0 && total > w->options->chunk_triangles) {
      int64_t budget = (int64_t)((double)chunk->shell.triangle_count * (double)w->options->chunk_triangles / (double)total);
      pags_result result = budget < LEAST_TRIANGLES ? PAGS_ERROR_LIMIT : pags_shell_simplify(&chunk->shell, budget, &simple);
      pags_shell_destroy(&chunk->shell);
      if (result == PAGS_ERROR_LIMIT)
        continue;
      PAGS_TRY(result);
      chunk->shell = simple;
    }
    b->chunks[kept] = *chunk;
    if (kept++ != i)
      chunk->shell = (pags_shell){0};
  }
  b->chunk_count = kept;
  return PAGS_OK;
}

static pags_result make(const pags_workshop *w, pags_progress_fn *tell, void *user, pags_backdrop *out, pags_gaussians *g,
                        pags_ground *ground) {
  PAGS_TRY(gather_background(w, g));
  out->gaussians = g->count;
  out->s_sem = (double)NAN;
  if (g->s_sem && g->count) {
    out->s_sem = 0;
    for (int64_t i = 0; i < g->count; ++i)
      out->s_sem += (double)g->s_sem[i] / (double)g->count;
  }
  PAGS_TRY(draw_views(w, g, tell, user, out));
  if (!out->sights.count)
    return PAGS_OK;
  if (w->scene->up == PAGS_UP_Z)
    PAGS_TRY(add_ground(w, out, ground));
  PAGS_TRY(add_tiles(w, tell, user, ground, out));
  return decimate(w, out);
}

pags_result pags_backdrop_make(const pags_workshop *workshop, pags_progress_fn *tell, void *user, pags_backdrop *out) {
  pags_gaussians g = {0};
  pags_ground ground = {0};
  *out = (pags_backdrop){.s_sem = (double)NAN};
  if (!workshop->scene->model_count)
    return PAGS_OK;
  pags_result result = make(workshop, tell, user, out, &g, &ground);
  pags_gaussians_destroy(&g);
  pags_ground_destroy(&ground);
  if (result != PAGS_OK)
    pags_backdrop_destroy(out);
  return result;
}
