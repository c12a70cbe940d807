/* SPDX-License-Identifier: Apache-2.0 */
/* Tells whether the photographs of a scene show an object from all round, and makes up views of a scene that has none.
 * An object is looked at from directions spread evenly over a ball (Fibonacci's lattice), a room from places spread
 * evenly within it, in six directions each. The step of its surface is a share of its extent. */
#include "exporters/proxy/bare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/tsdf.h"
#include "maths/maths.h"

enum {
  AROUND = 72,
  PLACES = 20,
  ROOM_WIDTH = 400,
  LEAST_WIDTH = 96
}; /* views of an object; places in a room; pixels */
enum { OBJECT_STEPS = 192, PHOTO_STEPS = 96, ROOM_STEPS = 400 }; /* steps of the surface along the longest side */

static const double far_off = 2.2;  /* distance of an object's views from its middle, radii of the ball about its box */
static const double margin = 4;     /* free space round an object, steps */
static const double truncation = 3; /* distances are cut off in front of surfaces, steps */
static const double behind = 1.5;   /* how far behind a surface a view says that it is solid, steps: leaves are thin */
static const double uncertain = 0.06;  /* the same two for photographs, whose depths scatter: share of the longest side.
                                        If views said less of what is behind, the deepest of them would win */
static const double one_sided = 0.75;  /* length of the mean direction of views that are not from all round */
static const double least_part = 1e-3; /* smaller parts are floaters: share of the area of the largest */

/* ---- Views ---- */

static double longest_side(const pags_survey *s) {
  return fmax(fmax(s->hi[0] - s->lo[0], s->hi[1] - s->lo[1]), s->hi[2] - s->lo[2]);
}

/* Adds a view from `eye` along `forward`, a unit vector. */
static void add_view(pags_bare *bare, int width, double focal, const double eye[3], const double forward[3]) {
  static char name[] = "made up";
  const pags_scene *scene = &bare->scene;
  const double world[3] = {eye[0] + scene->origin[0], eye[1] + scene->origin[1], eye[2] + scene->origin[2]};
  pags_scene_view *view = &bare->scene.views[bare->scene.view_count++];
  *view = (pags_scene_view){.name = name, .sensor = -1, .frame = -1, .gain = {1, 1, 1}};
  view->camera = (pags_camera){.width = width,
                               .height = width,
                               .fx = focal,
                               .fy = focal,
                               .cx = width / 2.0,
                               .cy = width / 2.0,
                               .time = scene->time_begin};
  double up[3] = {0, 0, 0}, right[3], down[3];
  up[fabs(forward[2]) < 0.9 ? 2 : 0] = 1;
  pags_cross3(forward, up, right);
  pags_divide3(right, pags_length3(right));
  pags_cross3(forward, right, down);
  for (int k = 0; k < 3; k++)
    memcpy(view->camera.world_from_camera + 4 * k, (const double[4]){right[k], down[k], forward[k], world[k]},
           4 * sizeof(double));
}

static void look_around(pags_bare *bare, double step) {
  const pags_survey *s = &bare->survey;
  const double half[3] = {0.5 * (s->hi[0] - s->lo[0]), 0.5 * (s->hi[1] - s->lo[1]), 0.5 * (s->hi[2] - s->lo[2])};
  const double radius = pags_length3(half), golden = 2.39996322972865332; /* radians */
  const int width = (int)fmin(fmax(4.4 * radius / step, LEAST_WIDTH), PAGS_DEPTH_VIEW_WIDEST);
  const double focal = 0.5 * width * sqrt(far_off * far_off - 1);
  for (int i = 0; i < AROUND; i++) {
    const double z = 1 - (2 * i + 1) / (double)AROUND, across = sqrt(1 - z * z);
    const double forward[3] = {-across * pags_cos(golden * i), -across * pags_sin(golden * i), -z};
    double eye[3];
    for (int k = 0; k < 3; k++)
      eye[k] = 0.5 * (s->lo[k] + s->hi[k]) - far_off * radius * forward[k];
    add_view(bare, width, focal, eye, forward);
  }
}

static void look_inside(pags_bare *bare, double step) {
  const pags_survey *s = &bare->survey;
  const double longest = longest_side(s);
  const int width = (int)fmin(fmax(longest / step, LEAST_WIDTH), ROOM_WIDTH);
  double places[PLACES][3];
  const int count = pags_survey_places(s, PLACES, places);
  for (int i = 0; i < count; i++)
    for (int side = 0; side < 6; side++) {
      double forward[3] = {0, 0, 0};
      forward[side / 2] = side % 2 ? 1 : -1;
      add_view(bare, width, 0.5 * width, places[i], forward);
    }
}

/* Whether training views are from all round the box of the Gaussians: none is in it, and they are not all on one side,
 * where the mean of their directions would be long. */
static bool are_around(const pags_bare *bare) {
  const pags_survey *s = &bare->survey;
  double sum[3] = {0}, count = 0;
  for (int64_t v = 0; v < bare->scene.view_count; v++) {
    double eye[3], out[3];
    bool inside = true;
    if (bare->scene.views[v].test)
      continue;
    pags_pose_position(bare->scene.views[v].camera.world_from_camera, eye);
    pags_subtract3(eye, bare->scene.origin, eye);
    for (int k = 0; k < 3; k++) {
      inside = inside && eye[k] > s->lo[k] && eye[k] < s->hi[k];
      out[k] = eye[k] - 0.5 * (s->lo[k] + s->hi[k]);
    }
    if (inside)
      return false;
    pags_add_scaled3(1 / pags_length3(out), out, sum);
    count++;
  }
  return !s->inside && pags_length3(sum) < one_sided * count;
}

pags_result pags_bare_open(const pags_scene *scene, pags_proxy_options *options, pags_bare **out) {
  *out = NULL;
  bool photographed = false, driven = scene->object_count > 0;
  for (int64_t v = 0; v < scene->view_count; v++) {
    photographed = photographed || !scene->views[v].test;
    driven = driven || scene->views[v].sensor >= 0;
  }
  if (!pags_scene_gaussian_count(scene) || (photographed && driven) ||
      (photographed && options->stand == PAGS_STAND_INSIDE))
    return PAGS_OK;
  PAGS_AUTO(pags_bare_close_auto) pags_bare *bare = calloc(1, sizeof *bare);
  PAGS_CHECK_MEMORY(bare, "made-up views");
  bare->scene = *scene;
  bare->photographed = photographed;
  PAGS_TRY(pags_survey_make(scene, &bare->survey));
  if (photographed && options->stand == PAGS_STAND_AUTO && !are_around(bare))
    return PAGS_OK;
  if (!photographed) {
    bare->scene.view_count = 0;
    bare->scene.views = bare->made_up = calloc(AROUND + 6 * PLACES, sizeof *bare->made_up);
    PAGS_CHECK_MEMORY(bare->made_up, "made-up views");
  }
  const double longest = longest_side(&bare->survey), given = options->voxel;
  if (!photographed)
    bare->inside = options->stand == PAGS_STAND_AUTO ? bare->survey.inside : options->stand == PAGS_STAND_INSIDE;
  if (bare->inside)
    look_inside(bare, given > 0 ? given : longest / ROOM_STEPS);
  if (!bare->scene.view_count) {
    bare->inside = false;
    look_around(bare, given > 0 ? given : longest / OBJECT_STEPS);
  }
  options->voxel = given > 0 ? given
                             : longest / (bare->inside   ? ROOM_STEPS
                                          : photographed ? PHOTO_STEPS
                                                         : OBJECT_STEPS);
  options->chunk = options->chunk > 0 ? options->chunk : longest / 4;
  options->range = options->range > 0 ? options->range : (bare->inside ? 1.0 / 3 : 4) * longest;
  bare->note = photographed   ? "photographed from all round; what no view shows is solid"
               : bare->inside ? "no photographs: views made up within it"
                              : "no photographs: views made up round it";
  pags_log_message(PAGS_LOG_INFO, "%s, %lld of them; step %g", bare->note, (long long)bare->scene.view_count,
                   options->voxel);
  *out = pags_take(&bare);
  return PAGS_OK;
}

void pags_bare_close(pags_bare *bare) {
  if (!bare)
    return;
  free(bare->made_up);
  pags_survey_destroy(&bare->survey);
  free(bare);
}

/* ---- Haze ---- */

/* A Gaussian's sigmas as logarithms, ascending. */
static void sort_scales(const pags_gaussians *g, int64_t i, double s[3]) {
  for (int k = 0; k < 3; k++)
    s[k] = (double)pags_plane(g, PAGS_SCALE + k)[i];
  pags_sort_doubles(s, 3);
}

pags_result pags_bare_mark_haze(const pags_bare *bare, const pags_gaussians *g, uint8_t *taken) {
  static const double least_logit = -0.85; /* of an opacity of 0.3 */
  static const double large = 1.5;         /* ln 4.5 */
  static const double flat = -1.6;         /* ln 0.2: the smallest sigma relative to the next */
  double s[3];
  int64_t count = 0;
  PAGS_AUTOFREE double *sizes = malloc(((size_t)g->count + 1) * sizeof *sizes);
  PAGS_CHECK_MEMORY(sizes, "%lld Gaussians", (long long)g->count);
  for (int64_t i = 0; i < g->count; i++)
    if ((double)pags_plane(g, PAGS_OPACITY)[i] > least_logit) {
      sort_scales(g, i, s);
      sizes[count++] = s[2];
    }
  pags_sort_doubles(sizes, count);
  for (int64_t i = 0; i < g->count && count && bare->inside; i++) {
    sort_scales(g, i, s);
    taken[i] |= s[2] > sizes[count / 2] + large && s[0] - s[1] > flat;
  }
  return PAGS_OK;
}

/* ---- The closed surface ---- */

pags_result pags_bare_surface(const pags_bare *bare, const pags_proxy_options *options,
                              const pags_depth_views *depth_views, pags_tasks *tasks, pags_proxy_mesh *out) {
  const double step = options->voxel, room = (margin + 0.03 * OBJECT_STEPS) * step;
  double lo[3], hi[3];
  PAGS_AUTO(pags_tsdf_destroy) pags_tsdf grid = {0};
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh fine = {0};
  for (int k = 0; k < 3; k++) {
    lo[k] = bare->survey.lo[k] - room;
    hi[k] = bare->survey.hi[k] + room;
  }
  PAGS_TRY(pags_tsdf_create(&grid, lo, hi, step, false));
  const double band = uncertain * longest_side(&bare->survey);
  PAGS_TRY(pags_tsdf_fuse(&grid, depth_views, bare->photographed ? band : truncation * step,
                          bare->photographed ? band : behind * step, options->range * 10, true, tasks));
  /* Points that no view says anything of are solid, those at the border of the grid free. Photographs don't show what
   * an object stands on from below: there it ends with the Gaussians. */
  for (int64_t i = 0; i < (int64_t)grid.n[0] * grid.n[1] * grid.n[2]; i++) {
    const int64_t at[3] = {i % grid.n[0], i / grid.n[0] % grid.n[1], i / grid.n[0] / grid.n[1]};
    bool within = true;
    for (int k = 0; k < 3 && bare->photographed; k++) {
      const double p = grid.origin[k] + (double)at[k] * step;
      within = within && p > bare->survey.lo[k] && p < bare->survey.hi[k];
    }
    if (!(grid.weight[i] > 0))
      grid.distance[i] = (float)(within ? -(truncation * step) : truncation * step);
  }
  pags_tsdf_close_border(&grid, (float)(truncation * step));
  PAGS_TRY(pags_tsdf_surface(&grid, false, &fine));
  pags_tsdf_destroy(&grid); /* the largest of all: not needed any more */
  PAGS_TRY(pags_proxy_mesh_keep_parts(&fine, least_part, 0, NULL));
  PAGS_TRY(pags_proxy_mesh_simplify(&fine, options->chunk_triangles, out));
  PAGS_TRY(pags_proxy_mesh_clean(out));
  return pags_proxy_mesh_paint(out, depth_views, truncation * step, tasks);
}

static pags_result make_box(const pags_proxy_mesh *from, pags_proxy_mesh *out) {
  double lo[3], hi[3], size[3], sum[3] = {0};
  float color[3];
  pags_proxy_mesh_bounds(from, lo, hi);
  pags_subtract3(hi, lo, size);
  for (int64_t i = 0; i < 3 * from->vertex_count; i++)
    sum[i % 3] += (double)from->colors[i];
  pags_divide3(sum, (double)from->vertex_count);
  pags_narrow3(sum, color);
  PAGS_TRY(pags_proxy_mesh_box(size, color, out));
  for (int64_t i = 0; i < 3 * out->vertex_count; i++)
    out->positions[i] += (float)(0.5 * (lo[i % 3] + hi[i % 3]));
  return PAGS_OK;
}

pags_result pags_bare_level(const pags_bare *bare, const pags_proxy_options *options, pags_proxy_mesh *mesh,
                            pags_proxy_level *level, const char **note) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh made = {0};
  pags_result result = PAGS_OK;
  *level = PAGS_PROXY_MESH;
  *note = bare->note;
  if (!mesh->triangle_count || options->level == PAGS_PROXY_MESH || options->lod)
    return PAGS_OK;
  if (options->level == PAGS_PROXY_BOX)
    result = make_box(mesh, &made);
  else if (options->level == PAGS_PROXY_HULL || options->level == PAGS_PROXY_CONVEX)
    result = pags_proxy_mesh_hull(mesh, options->triangles < 252 ? options->triangles : 252, &made);
  else
    result = pags_proxy_mesh_cage(mesh, options->cage_level, options->triangles, &made);
  if (result == PAGS_OK && options->level != PAGS_PROXY_BOX)
    result = pags_proxy_mesh_clean(&made);
  if (result == PAGS_ERROR_MEMORY || result == PAGS_CANCELLED)
    return result;
  if (result != PAGS_OK) {
    *note = "what was asked for can't be made of it: its surface";
    return PAGS_OK;
  }
  const pags_proxy_mesh replaced = *mesh;
  *mesh = made;
  made = replaced;
  *level = options->level;
  if (options->level == PAGS_PROXY_CONVEX) {
    *level = PAGS_PROXY_HULL;
    *note = "convex parts are made of labelled objects alone: its hull";
  }
  return PAGS_OK;
}
