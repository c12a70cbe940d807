/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the lowest SH degree that each Gaussian needs over the training views, and trims the rest; see sh_trim.h. */
#include "train/sh_trim.h"

#include "base/log.h"
#include "base/parallel.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum { TRIM_GRAIN = 256, MOST_DEGREE = 3 };

/* ---- Views ---- */

/* Largest extent of a Gaussian in standard deviations on the screen, as in the frame's culling: opacity at most 1,
 * alpha down to 1/255. */
static const double reach = 3.3291; /* sqrt(2 ln 255) */

static double reach_of(double focal, double centre, double size) {
  double tangent = 0.5 * size / focal;
  double most = fmax(fabs(-centre / focal - 0.3 * tangent), fabs((size - centre) / focal + 0.3 * tangent));
  return 1.0001 * reach * focal * sqrt(1.0 + most * most);
}

pags_sh_view pags_sh_view_make(const pags_camera *camera, const double world_from_model[12], const double origin[3],
                               double near_plane, double low_pass) {
  double local[12], camera_from_world[12], camera_from_model[12], model_from_camera[12];
  memcpy(local, camera->world_from_camera, sizeof local);
  pags_pose_subtract(local, origin);
  pags_rigid_inverse(local, camera_from_world);
  pags_rigid_multiply(camera_from_world, world_from_model, camera_from_model);
  pags_rigid_inverse(camera_from_model, model_from_camera);
  pags_sh_view v = {.fx = (float)camera->fx,
                    .fy = (float)camera->fy,
                    .cx = (float)camera->cx,
                    .cy = (float)camera->cy,
                    .width = (float)camera->width,
                    .height = (float)camera->height,
                    .bends = pags_camera_bends(camera),
                    .reach_x = (float)reach_of(camera->fx, camera->cx, camera->width),
                    .reach_y = (float)reach_of(camera->fy, camera->cy, camera->height),
                    .near_plane = (float)near_plane,
                    .low = (float)(1.0001 * reach * sqrt(low_pass) + 0.01)};
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 3; k++)
      v.r[3 * i + k] = (float)camera_from_model[4 * i + k];
    v.t[i] = (float)camera_from_model[4 * i + 3];
    v.eye[i] = (float)model_from_camera[4 * i + 3];
  }
  return v;
}

/* ---- One Gaussian ---- */

/* Returns whether a Gaussian at `p` whose sigmas are at most `sigma` may show in the view. Conservative. */
static bool may_show(const pags_sh_view *v, const float p[3], float sigma) {
  if (v->bends)
    return true;
  const float z = pags_dot3f(v->r + 6, p) + v->t[2];
  if (!(z > v->near_plane))
    return false;
  const float x = pags_dot3f(v->r, p) + v->t[0], y = pags_dot3f(v->r + 3, p) + v->t[1];
  const float u = v->fx * x / z + v->cx, w = v->fy * y / z + v->cy;
  const float extent_x = v->reach_x * sigma / z + v->low, extent_y = v->reach_y * sigma / z + v->low;
  return u > -extent_x && u < v->width + extent_x && w > -extent_y && w < v->height + extent_y;
}

/* Real spherical harmonics of degrees 1 to 3 at a unit vector, with the signs of INRIA's 3DGS program. The constants
 * are sqrt((2l + 1) (l - |m|)! / (4 pi (l + |m|)!)), times sqrt 2 where m isn't 0, multiplied out. basis[0] isn't
 * set. */
static void sh_basis(int degree, const float d[3], float basis[16]) {
  float x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
  basis[1] = -0.48860251f * y;
  basis[2] = 0.48860251f * z;
  basis[3] = -0.48860251f * x;
  if (degree < 2)
    return;
  basis[4] = 1.09254843f * x * y;
  basis[5] = -1.09254843f * y * z;
  basis[6] = 0.31539157f * (2.0f * zz - xx - yy);
  basis[7] = -1.09254843f * x * z;
  basis[8] = 0.54627422f * (xx - yy);
  if (degree < 3)
    return;
  basis[9] = -0.59004359f * y * (3.0f * xx - yy);
  basis[10] = 2.89061144f * x * y * z;
  basis[11] = -0.45704580f * y * (4.0f * zz - xx - yy);
  basis[12] = 0.37317633f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
  basis[13] = -0.45704580f * x * (4.0f * zz - xx - yy);
  basis[14] = 1.44530572f * z * (xx - yy);
  basis[15] = -0.59004359f * x * (xx - 3.0f * yy);
}

/* The range, over the views that see a row, of what the terms beyond each degree add to each channel. */
typedef struct row_ranges {
  float lo[MOST_DEGREE][3], hi[MOST_DEGREE][3];
} row_ranges;

static void find_ranges(const pags_gaussians *g, const pags_sh_view *views, int64_t view_count, int64_t row,
                        row_ranges *ranges) {
  float p[3], coefficients[48];
  float sigma = pags_expf(fmaxf(fmaxf(pags_plane(g, PAGS_SCALE)[row], pags_plane(g, PAGS_SCALE + 1)[row]),
                                pags_plane(g, PAGS_SCALE + 2)[row]));
  for (int k = 0; k < 3; k++)
    p[k] = pags_plane(g, PAGS_MEAN + k)[row];
  for (int k = 0; k < 3 * pags_sh_coefficients(g->sh_degree); k++)
    coefficients[k] = pags_plane(g, PAGS_SH + k)[row];
  for (int l = 0; l < MOST_DEGREE; l++)
    for (int c = 0; c < 3; c++) {
      ranges->lo[l][c] = INFINITY;
      ranges->hi[l][c] = -INFINITY;
    }
  for (int64_t i = 0; i < view_count; i++) {
    if (!may_show(&views[i], p, sigma))
      continue;
    float d[3];
    pags_subtract3f(p, views[i].eye, d);
    pags_scale3f(1.0f / sqrtf(fmaxf(pags_dot3f(d, d), 1e-30f)), d, d);

    /* Extend the ranges by this view's direction, summing the terms from the highest degree down. */
    float basis[16];
    sh_basis(g->sh_degree, d, basis);
    for (int c = 0; c < 3; c++) {
      float beyond = 0.0f;
      for (int l = g->sh_degree; l >= 1; l--) {
        for (int k = l * l; k < (l + 1) * (l + 1); k++)
          beyond += basis[k] * coefficients[3 * k + c];
        ranges->lo[l - 1][c] = fminf(ranges->lo[l - 1][c], beyond);
        ranges->hi[l - 1][c] = fmaxf(ranges->hi[l - 1][c], beyond);
      }
    }
  }
}

/* Returns whether a row's colour changes by at most `error` if the terms beyond `degree` are removed: with the middle
 * of their range in the constant term, half of the range is left, channel by channel. */
static bool fits(const row_ranges *ranges, int degree, double error) {
  for (int c = 0; c < 3; c++) {
    const float lo = ranges->lo[degree][c], hi = ranges->hi[degree][c];
    if (lo < hi && !(0.5 * ((double)hi - (double)lo) <= error))
      return false;
  }
  return true;
}

void pags_sh_trim_rows(pags_gaussians *g, const pags_sh_view *views, int64_t view_count, double error, int64_t first,
                       int64_t last) {
  for (int64_t row = first; row < last; row++) {
    row_ranges ranges;
    find_ranges(g, views, view_count, row, &ranges);
    int degree = 0;
    while (degree < g->sh_degree && !fits(&ranges, degree, error))
      degree++;
    if (degree == g->sh_degree)
      continue;

    /* Move the middle of the range to the constant term and clear the terms beyond the degree. */
    for (int c = 0; c < 3; c++) {
      const float lo = ranges.lo[degree][c], hi = ranges.hi[degree][c];
      if (lo <= hi)
        pags_plane(g, PAGS_SH + c)[row] += (float)(0.5 * ((double)lo + (double)hi) / PAGS_SH_C0);
    }
    for (int k = 3 * pags_sh_coefficients(degree); k < 3 * pags_sh_coefficients(g->sh_degree); k++)
      pags_plane(g, PAGS_SH + k)[row] = 0.0f;
  }
}

/* ---- All Gaussians of a run ---- */

typedef struct trim_context {
  pags_gaussians *g;
  const pags_sh_view *views;
  int64_t view_count;
  double error;
} trim_context;

static void trim_block(void *context, int64_t begin, int64_t end, int worker) {
  const trim_context *c = context;
  (void)worker;
  pags_sh_trim_rows(c->g, c->views, c->view_count, c->error, begin, end);
}

/* Lists the training views at whose time the model exists. */
static int64_t list_views(const pags_trainer *t, const pags_train_model *m, pags_sh_view *views) {
  const pags_train_config *c = &t->state.schedule.config;
  const double *origin = pags_dataset_origin(t->dataset);
  int64_t count = 0;
  for (int64_t i = 0; i < t->view_count; i++) {
    const pags_camera camera = pags_camera_poses_view(&t->state.cameras, t->dataset, t->views[i]);
    double pose[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    if (m->object >= 0) {
      if (!pags_object_pose(&t->state.tracks.objects[m->object], camera.time, pose))
        continue;
      pags_pose_subtract(pose, origin);
    }
    views[count++] = pags_sh_view_make(&camera, pose, origin, c->picture.near_plane, c->picture.low_pass);
  }
  return count;
}

pags_result pags_sh_trim(pags_trainer *t) {
  pags_train_state *s = &t->state;
  const double error = s->schedule.config.size_limit.sh_error / 255.0;
  int64_t degrees[4] = {0}, count = 0;
  if (error <= 0.0 || s->schedule.config.color.sh_degree == 0)
    return PAGS_OK;
  PAGS_AUTOFREE pags_sh_view *views = malloc((size_t)(t->view_count > 0 ? t->view_count : 1) * sizeof *views);
  PAGS_CHECK_MEMORY(views, "%lld views", (long long)t->view_count);
  for (int64_t i = 0; i < s->model_count; i++) {
    pags_gaussians *const g = &s->models[i].gaussians;
    trim_context context = {g, views, list_views(t, &s->models[i], views), error};
    if (g->fourier_degree == 0) /* else the terms are those of one time only */
      PAGS_TRY(pags_parallel_run(t->tasks, g->count, TRIM_GRAIN, trim_block, &context));
    for (int64_t row = 0; row < g->count; row++)
      degrees[pags_gaussians_row_degree(g, row)]++;
    count += g->count;
  }
  pags_log_message(PAGS_LOG_INFO, "colour: of %lld Gaussians, %lld keep degree 0, %lld 1, %lld 2, %lld 3",
                   (long long)count, (long long)degrees[0], (long long)degrees[1], (long long)degrees[2],
                   (long long)degrees[3]);
  return PAGS_OK;
}
