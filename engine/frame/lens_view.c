/* SPDX-License-Identifier: Apache-2.0 */
/* What a frame knows of its lens: its table for the kernels, how far means are drawn, how fast pixels change with
 * directions, and the direction of each pixel's centre, along which the sky is seen. The directions are kept for the
 * next frame of the same lens. */
#include "frame/lens_view.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "port/port.h"
#include "scene/lens.h"

static const double pi = 3.14159265358979323846;
/* Means up to this angle beyond the field of view are drawn, radians: 20 degrees, for large Gaussians at the edge. */
static const double beyond = 0.35;

void pags_frame_lens_see(const struct frame_lens *l, const double point[3], double pixel[2], double j[6]) {
  double at[2];
  pags_lens_see(&l->camera.lens, point, at, j);
  pixel[0] = l->camera.fx * at[0] + l->camera.cx;
  pixel[1] = l->camera.fy * at[1] + l->camera.cy;
  for (int k = 0; k < 3 && j; k++)
    j[k] *= l->camera.fx, j[3 + k] *= l->camera.fy;
}

/* ---- Limits ---- */

/* The largest angle from the axis at the picture's border, and the range of x/z and y/z there; the lens's widest angle
 * where the border isn't seen. */
static void look_at_border(const pags_camera *c, double *angle, double least[2], double most[2]) {
  enum { SIDES = 4, POINTS = 16 };
  static const double corner[SIDES + 1][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
  const double widest = pags_lens_model_widest(&c->lens);
  *angle = 0;
  least[0] = least[1] = INFINITY;
  most[0] = most[1] = -INFINITY;
  for (int i = 0; i < SIDES * POINTS; i++) {
    const double *const from = corner[i / POINTS], *const to = corner[i / POINTS + 1];
    const double along = (double)(i % POINTS) / POINTS;
    const double u = (from[0] + along * (to[0] - from[0])) * c->width,
                 v = (from[1] + along * (to[1] - from[1])) * c->height;
    double direction[3];
    const bool seen = pags_camera_look(c, u, v, direction);
    *angle = fmax(*angle, seen ? pags_lens_angle(direction) : widest);
    if (!seen) { /* as far as the lens goes, in the direction of this point */
      const double x = u - c->cx, y = v - c->cy, length = fmax(pags_hypot(x, y), 1e-9);
      direction[0] = pags_sin(widest) * x / length;
      direction[1] = pags_sin(widest) * y / length;
      direction[2] = pags_cos(widest);
    }
    for (int k = 0; k < 2; k++) {
      least[k] = fmin(least[k], direction[k] / direction[2]);
      most[k] = fmax(most[k], direction[k] / direction[2]);
    }
  }
}

/* Samples the derivatives in rings around the axis; 5 % are added for what lies in between. */
static void find_reach(struct frame_lens *l) {
  enum { ROUND = 32 };
  double most = 0;
  for (int i = 0; i <= LENS_STEPS; i++) {
    const double angle = l->farthest * i / LENS_STEPS;
    for (int k = 0; k < ROUND; k++) {
      const double turn = 2 * pi * k / ROUND;
      const double v[3] = {pags_sin(angle) * pags_cos(turn), pags_sin(angle) * pags_sin(turn), pags_cos(angle)};
      double at[2], j[6];
      pags_frame_lens_see(l, v, at, j);
      const double a = pags_dot3(j, j), b = pags_dot3(j, j + 3), c = pags_dot3(j + 3, j + 3);
      most = fmax(most, sqrt(0.5 * (a + c + sqrt((a - c) * (a - c) + 4 * b * b)))); /* the largest singular value */
    }
    l->reach[i] = (float)(1.05 * most);
  }
}

/* ---- The kernels' table ---- */

/* The radial function and its derivative at an angle, in focal lengths. */
static void radius_at(const pags_lens_model *round, double angle, double out[2]) {
  const double v[3] = {pags_sin(angle), 0, pags_cos(angle)};
  double at[2], j[6];
  pags_lens_see(round, v, at, j);
  out[0] = at[0], out[1] = j[0] * v[2] - j[2] * v[0];
}

/* Cubics that have the radial function's value and derivative at the ends of each step. least, most: the range of x/z
 * and y/z at the picture's border. */
static void fill_table(struct frame_lens *l, const double least[2], const double most[2]) {
  const pags_camera *const c = &l->camera;
  const pags_lens_model *const lens = &c->lens;
  const bool matrix = lens->kind == PAGS_LENS_FTHETA;
  const double a[4] = {c->fx * (1 + (matrix ? lens->s[0] : 0)), matrix ? c->fx * lens->s[1] : 0,
                       matrix ? c->fy * lens->s[2] : 0, c->fy};
  pags_lens_table *const t = &l->table;
  t->turn = l->sphere ? (float)(2 * pi * c->fx) : 0.0f;
  t->clamps = !l->sphere && !pags_lens_is_of_angle(lens->kind);
  t->farthest = l->sphere ? INFINITY : (float)l->farthest;
  for (int k = 0; k < 2; k++) {
    const double more = 0.15 * (most[k] - least[k]); /* 0.3 of half the field, as a pinhole's */
    t->least[k] = (float)fmin(least[k] - more, 0), t->most[k] = (float)fmax(most[k] + more, 0); /* towards the axis */
    t->p[k] = (float)lens->p[k];
  }
  double prism[4];
  pags_lens_prism(lens, prism);
  for (int k = 0; k < 4; k++)
    t->a[k] = (float)a[k], t->prism[k] = (float)prism[k];
  if (lens->kind == PAGS_LENS_PERSPECTIVE || lens->kind == PAGS_LENS_RATIONAL)
    t->terms_of = PAGS_LENS_TERMS_OF_SLOPE;
  else if (lens->kind == PAGS_LENS_THIN_PRISM)
    t->terms_of = PAGS_LENS_TERMS_OF_ANGLE;
  else if (lens->kind == PAGS_LENS_ARIA)
    t->terms_of = PAGS_LENS_TERMS_OF_RADIUS;
  if (l->sphere)
    return;
  pags_lens_model round = *lens;
  memset(round.p, 0, sizeof round.p);
  memset(round.s, 0, sizeof round.s);
  const double step = l->farthest / PAGS_LENS_STEPS;
  double here[2], next[2];
  t->per_radian = (float)(1 / step);
  radius_at(&round, 0, here);
  for (int i = 0; i < PAGS_LENS_STEPS; i++) {
    radius_at(&round, (i + 1) * step, next);
    const double rise = next[0] - here[0], first = step * here[1], last = step * next[1];
    t->radius[i][0] = (float)here[0], t->radius[i][1] = (float)first;
    t->radius[i][2] = (float)(3 * rise - 2 * first - last), t->radius[i][3] = (float)(first + last - 2 * rise);
    memcpy(here, next, sizeof here);
  }
}

/* ---- Directions of the pixels ---- */

typedef struct rays_context {
  const pags_camera *camera;
  float *x, *y, *z; /* planes */
  int stride;
} rays_context;

/* Goes along a row from the column nearest to the principal point outwards, each direction beginning at the last. What
 * lies beyond the first pixel that isn't seen isn't, either. */
static void find_row(const rays_context *c, int row, int from, int to, int step) {
  const pags_camera *const camera = c->camera;
  double direction[3] = {0, 0, 0};
  for (int x = from; x != to; x += step) {
    const double at[2] = {(x + 0.5 - camera->cx) / camera->fx, (row + 0.5 - camera->cy) / camera->fy};
    if (!pags_lens_look(&camera->lens, at, direction))
      return;
    const int64_t pixel = (int64_t)row * c->stride + x;
    c->x[pixel] = (float)direction[0], c->y[pixel] = (float)direction[1], c->z[pixel] = (float)direction[2];
  }
}

/* Block function: rows [begin, end). */
static void find_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const rays_context *const c = context;
  for (int64_t row = begin; row < end; row++) {
    const int width = c->camera->width, middle = (int)fmin(fmax(c->camera->cx, 0), width);
    find_row(c, (int)row, middle, width, 1);
    find_row(c, (int)row, middle - 1, -1, -1);
  }
}

static pags_result find_rays(pags_frame *f, const pags_camera *camera) {
  const pags_camera *const a = &f->lens_camera, *const b = camera;
  if (f->lens_rays && a->width == b->width && a->height == b->height && a->fx == b->fx && a->fy == b->fy &&
      a->cx == b->cx && a->cy == b->cy && a->lens.kind == b->lens.kind &&
      memcmp(a->lens.k, b->lens.k, sizeof a->lens.k) == 0 && memcmp(a->lens.d, b->lens.d, sizeof a->lens.d) == 0 &&
      memcmp(a->lens.p, b->lens.p, sizeof a->lens.p) == 0 && memcmp(a->lens.s, b->lens.s, sizeof a->lens.s) == 0 &&
      a->lens.field == b->lens.field)
    return PAGS_OK;
  pags_port_aligned_free(f->lens_rays);
  const size_t bytes = (size_t)f->plane_size * 3 * sizeof *f->lens_rays;
  f->lens_rays = pags_port_aligned_alloc(64, bytes);
  f->plane_calls++;
  PAGS_CHECK_MEMORY(f->lens_rays, "the directions of %d x %d pixels", camera->width, camera->height);
  memset(f->lens_rays, 0, bytes);
  f->lens_camera = (pags_camera){0};
  const rays_context c = {camera, f->lens_rays, f->lens_rays + f->plane_size, f->lens_rays + 2 * f->plane_size,
                          f->stride};
  PAGS_TRY(pags_frame_for(f, camera->height, 8, find_rows, (void *)&c));
  f->lens_camera = *camera;
  return PAGS_OK;
}

pags_result pags_frame_prepare_lens(pags_frame *f) {
  f->lens = NULL;
  if (!pags_camera_bends(&f->camera))
    return PAGS_OK;
  struct frame_lens *l;
  PAGS_TRY(pags_frame_alloc(f, &l, 1, sizeof *l, "lens"));
  *l = (struct frame_lens){.camera = f->camera};
  PAGS_TRY(pags_lens_model_check(&l->camera.lens, "the camera's lens"));
  double angle, least[2], most[2];
  look_at_border(&l->camera, &angle, least, most);
  l->farthest = fmin(l->camera.lens.limit, fmin(angle, pags_lens_model_widest(&l->camera.lens)) + beyond);
  l->sphere = l->camera.lens.kind == PAGS_LENS_EQUIRECTANGULAR;
  fill_table(l, least, most);
  if (!l->sphere)
    find_reach(l);
  PAGS_TRY(find_rays(f, &l->camera));
  l->rays = f->lens_rays;
  f->lens = l;
  for (int p = 0; p < f->part_count; p++)
    f->projections[p].lens = &l->table;
  return PAGS_OK;
}

/* ---- What isn't seen, and the sky ---- */

void pags_frame_mask_lens(const pags_frame *f, int64_t tile) {
  const int64_t at = frame_tile_offset(f, tile);
  const float *const ray[3] = {f->lens->rays + at, f->lens->rays + f->plane_size + at,
                               f->lens->rays + 2 * f->plane_size + at};
  for (int y = 0; y < PAGS_TILE; y++)
    for (int x = 0; x < PAGS_TILE; x++) {
      const int64_t i = (int64_t)y * f->stride + x;
      if (ray[0][i] != 0.0f || ray[1][i] != 0.0f || ray[2][i] != 0.0f)
        continue;
      for (int c = 0; c < 3; c++)
        frame_plane(f, PLANE_R + c)[at + i] = 0.0f;
      frame_plane(f, PLANE_T)[at + i] = 1.0f;
      if (f->options.extra_channels || f->options.depth_sum)
        frame_plane(f, PLANE_DEPTH_SUM)[at + i] = 0.0f;
      if (f->options.extra_channels) {
        frame_plane(f, PLANE_DEPTH)[at + i] = 0.0f;
        frame_ids(f)[at + i] = -1;
      }
    }
}

/* One axis of simd/sky.c's cell: the first texel, and the place 0..1 in the cell. */
static int32_t sky_axis(float position, int size, float *rest) {
  const float half = 0.5f * (float)size, last = (float)(size - 1), last_cell = size > 1 ? (float)(size - 2) : 0.0f;
  const float u = fmaxf(fminf(position * half + (half - 0.5f), last), 0.0f);
  const int32_t first = (int32_t)fminf(floorf(u), last_cell);
  *rest = u - (float)first;
  return first;
}

/* The camera's rotations when the lines of a tile are read, columns or rows; all the same with a global shutter. */
typedef struct line_turns {
  float r[PAGS_TILE][9];
  bool across; /* the lines are columns */
} line_turns;

static void find_turns(const pags_frame *f, int x0, int y0, line_turns *out) {
  const pags_camera *const c = &f->camera;
  out->across = c->shutter.across != 0;
  for (int line = 0; line < PAGS_TILE; line++) {
    double m[12];
    memcpy(m, c->world_from_camera, sizeof m);
    if (pags_camera_rolls(c))
      pags_rigid_move(m, c->shutter.velocity, pags_camera_read_at(c, x0 + line + 0.5, y0 + line + 0.5), m);
    for (int k = 0; k < 9; k++)
      out->r[line][k] = (float)m[k / 3 * 4 + k % 3];
  }
}

/* The cell that pixel (x, y) sees, as simd/sky.c finds it from a direction; the first one where nothing is seen. */
static void find_cell(const pags_frame *f, const line_turns *turns, int x, int y, int32_t *row, int32_t *column,
                      float *along, float *down) {
  const int64_t pixel = (int64_t)y * f->stride + x;
  const float *const m = turns->r[(turns->across ? x : y) % PAGS_TILE];
  float d[3], a[3];
  for (int k = 0; k < 3; k++) {
    d[k] = 0.0f;
    for (int j = 0; j < 3; j++)
      d[k] += m[3 * k + j] * f->lens->rays[j * f->plane_size + pixel];
    a[k] = fabsf(d[k]);
  }
  *row = *column = 0;
  *along = *down = 0.0f;
  const bool on_x = a[0] >= a[1] && a[0] >= a[2], on_y = !on_x && a[1] >= a[2];
  const int axis = on_x ? 0 : on_y ? 1 : 2, face = 2 * axis + (d[axis] < 0.0f ? 1 : 0);
  if (!(a[axis] > 0.0f))
    return;
  const float s[6] = {-d[2], d[2], d[0], d[0], d[0], -d[0]}, t[6] = {-d[1], -d[1], d[2], -d[2], -d[1], -d[1]};
  *column = sky_axis(s[face] / a[axis], f->rays.size, along);
  *row = face * f->rays.size + sky_axis(t[face] / a[axis], f->rays.size, down);
}

void pags_frame_lens_sky(const pags_frame *f, int x0, int y0, pags_sky_tile *tile) {
  line_turns turns;
  find_turns(f, x0, y0, &turns);
  for (int i = 0; i < PAGS_TILE_PIXELS; i++) {
    int32_t row, column;
    find_cell(f, &turns, x0 + i % PAGS_TILE, y0 + i / PAGS_TILE, &row, &column, tile->along + i, tile->down + i);
    tile->texel[i] = row * f->rays.size + column;
  }
}

void pags_frame_lens_cells(const pags_frame *f, int x0, int y0, int step, int32_t *row, int32_t *column,
                           float *const weight[4]) {
  line_turns turns;
  find_turns(f, x0, y0, &turns);
  for (int y = 0; y * step < PAGS_TILE; y++)
    for (int x = 0; x < PAGS_TILE; x++) {
      const int i = y * PAGS_TILE + x;
      float along, down;
      find_cell(f, &turns, x0 + x, y0 + y * step, row + i, column + i, &along, &down);
      weight[0][i] = (1.0f - down) * (1.0f - along), weight[1][i] = (1.0f - down) * along;
      weight[2][i] = down * (1.0f - along), weight[3][i] = down * along;
    }
}
