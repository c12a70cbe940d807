/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the SH degrees of the finished scene and removes the terms beyond them; see sh_trim.h.
 *
 * A pixel is a sum of colours c_i with weights w_i that add up to at most 1. If every colour changes by d_i, the square
 * of the pixel's change is at most the sum of w_i d_i^2 (Jensen's inequality). Summed over pixels and views this is,
 * for each Gaussian, its total weight times the mean square of its change: the cost of removing terms, which is known
 * without drawing a picture. Which terms to remove at a given sum of costs is a rate-distortion problem. With a price
 * tau per number stored every Gaussian minimises cost + tau numbers by itself; the largest tau whose sum of costs is
 * allowed is found by bisection. */
#include "train/sh_trim.h"

#include "cluster/shares.h"
#include "train/stages.h"

#include "base/log.h"
#include "base/parallel.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum { TRIM_GRAIN = 256, BISECTIONS = 20, MOST_TRIES = 5 };

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

/* Computes, over the views that may show a row, mean and variance of the colour that the terms beyond each degree add
 * to each channel. A view counts by the solid angle that the Gaussian has in it. */
static void find_moments(const pags_gaussians *g, const pags_sh_view *views, int64_t view_count, int64_t row,
                         double mean[PAGS_SH_CUTS][3], double variance[PAGS_SH_CUTS][3]) {
  float p[3], coefficients[48];
  const float sigma = pags_expf(fmaxf(fmaxf(pags_plane(g, PAGS_SCALE)[row], pags_plane(g, PAGS_SCALE + 1)[row]),
                                      pags_plane(g, PAGS_SCALE + 2)[row]));
  double all = 0.0, squares[PAGS_SH_CUTS][3] = {{0.0}};
  memset(mean, 0, PAGS_SH_CUTS * sizeof *mean);
  for (int k = 0; k < 3; k++)
    p[k] = pags_plane(g, PAGS_MEAN + k)[row];
  for (int k = 0; k < 3 * pags_sh_coefficients(g->sh_degree); k++)
    coefficients[k] = pags_plane(g, PAGS_SH + k)[row];
  for (int64_t i = 0; i < view_count; i++) {
    if (!may_show(&views[i], p, sigma))
      continue;
    float d[3], basis[16];
    pags_subtract3f(p, views[i].eye, d);
    const float square = fmaxf(pags_dot3f(d, d), 1e-30f);
    pags_scale3f(1.0f / sqrtf(square), d, d);
    sh_basis(g->sh_degree, d, basis);
    const double weight = 1.0 / (double)square;
    all += weight;
    for (int c = 0; c < 3; c++) {
      float beyond = 0.0f; /* summed from the highest degree down */
      for (int l = g->sh_degree; l >= 1; l--) {
        for (int k = l * l; k < (l + 1) * (l + 1); k++)
          beyond += basis[k] * coefficients[3 * k + c];
        mean[l - 1][c] += weight * (double)beyond;
        squares[l - 1][c] += weight * (double)beyond * (double)beyond;
      }
    }
  }
  for (int l = 0; l < PAGS_SH_CUTS; l++)
    for (int c = 0; c < 3; c++) {
      mean[l][c] = all > 0.0 ? mean[l][c] / all : 0.0;
      variance[l][c] = all > 0.0 ? fmax(squares[l][c] / all - mean[l][c] * mean[l][c], 0.0) : 0.0;
    }
}

void pags_sh_changes(const pags_gaussians *g, const pags_sh_view *views, int64_t view_count, int64_t row,
                     double changes[PAGS_SH_CUTS]) {
  double mean[PAGS_SH_CUTS][3], variance[PAGS_SH_CUTS][3];
  find_moments(g, views, view_count, row, mean, variance);
  for (int l = 0; l < PAGS_SH_CUTS; l++)
    changes[l] = variance[l][0] + variance[l][1] + variance[l][2];
}

void pags_sh_lower(pags_gaussians *g, const pags_sh_view *views, int64_t view_count, int64_t row, int degree) {
  double mean[PAGS_SH_CUTS][3], variance[PAGS_SH_CUTS][3];
  if (pags_gaussians_row_degree(g, row) <= degree)
    return;
  find_moments(g, views, view_count, row, mean, variance);
  for (int c = 0; c < 3; c++)
    pags_plane(g, PAGS_SH + c)[row] += (float)(mean[degree][c] / PAGS_SH_C0);
  for (int k = 3 * pags_sh_coefficients(degree); k < 3 * pags_sh_coefficients(g->sh_degree); k++)
    pags_plane(g, PAGS_SH + k)[row] = 0.0f;
}

/* ---- All Gaussians of a run ---- */

/* Costs are whole numbers, so that their sums are the same bits for any share of the rows. */
typedef int32_t cost;
static const double whole = 0x1p30; /* the cost that may be spent; that of one row is at most twice this */
/* The cost of an object that keeps its degree: one whose terms change over time, too. */
static const int64_t never = (int64_t)1 << 56;

typedef struct trimming {
  pags_trainer *trainer;
  int highest;                      /* SH degree of training */
  cost (*costs)[PAGS_SH_CUTS];      /* of this rank's rows, model after model: of keeping only degree 0, 1, 2 */
  int64_t (*objects)[PAGS_SH_CUTS]; /* sums over all rows of each model but the background, of all ranks */
  int64_t *blocks;                  /* sums over blocks of TRIM_GRAIN of the background's rows */
  pags_sh_view *views;              /* the training views at whose time the model exists */
  int64_t view_count;
  const double *weight; /* as `costs` */
  double budget;        /* sum of squared errors of all channels that may be added */
  double tau;           /* price of a number, as costs */
  /* The model at hand. */
  pags_train_model *model;
  int64_t first; /* its first row in `costs` and `weight` */
} trimming;

/* Lists the training views at whose time the model exists, and makes it the one at hand. */
static void take_model(trimming *t, int64_t model, int64_t first) {
  const pags_trainer *const r = t->trainer;
  const pags_train_config *c = &r->state.schedule.config;
  const double *origin = pags_dataset_origin(r->dataset);
  t->model = &r->state.models[model];
  t->first = first;
  t->view_count = 0;
  for (int64_t i = 0; i < r->view_count; i++) {
    const pags_camera camera = pags_camera_poses_view(&r->state.cameras, r->dataset, r->views[i]);
    double pose[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    if (t->model->object >= 0) {
      if (!pags_object_pose(&r->state.tracks.objects[t->model->object], camera.time, pose))
        continue;
      pags_pose_subtract(pose, origin);
    }
    t->views[t->view_count++] = pags_sh_view_make(&camera, pose, origin, c->picture.near_plane, c->picture.low_pass);
  }
}

/* Errors on critical Gaussians count as they do in the loss. */
static void find_costs(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  trimming *const t = context;
  const pags_gaussians *const g = &t->model->gaussians;
  const double critical = t->trainer->state.schedule.config.priority.critical_weight - 1.0;
  for (int64_t row = begin; row < end; row++) {
    const double weight = t->weight[t->first + row] * (1.0 + (g->s_sem ? critical * (double)g->s_sem[row] : 0.0));
    double changes[PAGS_SH_CUTS];
    pags_sh_changes(g, t->views, t->view_count, row, changes);
    for (int l = 0; l < PAGS_SH_CUTS; l++) {
      const double error = weight * changes[l];
      t->costs[t->first + row][l] = error > 0.0 ? (cost)ceil(fmin(error / t->budget, 1.9) * whole) : 0;
    }
  }
}

/* How many numbers of a Gaussian depend on the view at an SH degree. */
static int numbers_of(int degree) {
  return 3 * (pags_sh_coefficients(degree) - 1);
}

/* Returns the degree at which cost and price of `rows` Gaussians are least, and adds the cost to *spent. */
static int choose(const trimming *t, const int64_t costs[PAGS_SH_CUTS], int64_t rows, int64_t *spent) {
  const double each = t->tau * (double)rows;
  if (costs[0] >= never)
    return t->highest;
  double least = each * numbers_of(t->highest);
  int degree = t->highest;
  for (int l = t->highest - 1; l >= 0; l--)
    if ((double)costs[l] + each * numbers_of(l) < least) {
      least = (double)costs[l] + each * numbers_of(l);
      degree = l;
    }
  *spent += degree < t->highest ? costs[degree] : 0;
  return degree;
}

static int choose_row(const trimming *t, int64_t row, int64_t *spent) {
  int64_t costs[PAGS_SH_CUTS];
  for (int l = 0; l < PAGS_SH_CUTS; l++)
    costs[l] = t->costs[row][l];
  return choose(t, costs, 1, spent);
}

static void add_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const trimming *const t = context;
  int64_t spent = 0;
  for (int64_t row = begin; row < end; row++)
    choose_row(t, row, &spent);
  t->blocks[begin / TRIM_GRAIN] = spent;
}

/* Adds the costs of all ranks at the price t->tau. */
static pags_result add_costs(trimming *t, int64_t *sum) {
  const pags_train_state *const s = &t->trainer->state;
  const int64_t rows = s->models[0].gaussians.count;
  PAGS_TRY(pags_parallel_run(t->trainer->tasks, rows, TRIM_GRAIN, add_block, t));
  *sum = 0;
  for (int64_t b = 0; b < (rows + TRIM_GRAIN - 1) / TRIM_GRAIN; b++)
    *sum += t->blocks[b];
  PAGS_TRY(pags_share_sum(t->trainer->options->transport, sum, 1));
  for (int64_t m = 1; m < s->model_count; m++)
    choose(t, t->objects[m], s->models[m].total, sum);
  return PAGS_OK;
}

/* The degree of a row of the model at hand; an object, which is stored in one file, has one degree. */
static int degree_of(const trimming *t, int64_t row) {
  int64_t spent = 0;
  const int64_t model = t->model - t->trainer->state.models;
  return model == 0 ? choose_row(t, t->first + row, &spent) : choose(t, t->objects[model], t->model->total, &spent);
}

static void trim_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const trimming *const t = context;
  for (int64_t row = begin; row < end; row++)
    pags_sh_lower(&t->model->gaussians, t->views, t->view_count, row, degree_of(t, row));
}

/* Fills t->costs and t->objects. */
static pags_result find_all_costs(trimming *t) {
  const pags_train_state *const s = &t->trainer->state;
  pags_transport *const transport = t->trainer->options->transport;
  pags_result mine = PAGS_OK;
  int64_t first = 0;
  for (int64_t m = 0; mine == PAGS_OK && m < s->model_count; m++) {
    take_model(t, m, first);
    mine = pags_parallel_run(t->trainer->tasks, t->model->gaussians.count, TRIM_GRAIN, find_costs, t);
    for (int64_t row = 0; row < t->model->gaussians.count; row++, first++)
      for (int l = 0; l < PAGS_SH_CUTS; l++)
        t->objects[m][l] = t->model->gaussians.fourier_degree > 0 ? never : t->objects[m][l] + t->costs[first][l];
  }
  PAGS_TRY(pags_transport_agree(transport, mine));
  return pags_share_sum(transport, t->objects[0], (int)s->model_count * PAGS_SH_CUTS);
}

/* Finds the largest price at which no more than `allowed` is spent. */
static pags_result find_price(trimming *t, double allowed, int64_t *spent) {
  double low = -60.0, high = 2.0; /* log2 of prices: what costs something stays; nothing stays */
  for (int i = 0; i < BISECTIONS && low < high; i++) {
    const double middle = i == 0 ? high : 0.5 * (low + high);
    t->tau = whole * pags_exp2(middle);
    PAGS_TRY(add_costs(t, spent));
    if ((double)*spent <= allowed)
      low = middle;
    else
      high = middle;
  }
  t->tau = whole * pags_exp2(low);
  return add_costs(t, spent);
}

/* Trims all rows, and counts those of each degree and the bytes that are no longer stored. */
static pags_result trim_all(trimming *t, pags_sh_choice *choice) {
  const pags_train_state *const s = &t->trainer->state;
  pags_result mine = PAGS_OK;
  int64_t first = 0, sums[5] = {0};
  for (int64_t m = 0; mine == PAGS_OK && m < s->model_count; m++) {
    take_model(t, m, first);
    const int64_t rows = t->model->gaussians.count;
    mine = pags_parallel_run(t->trainer->tasks, rows, TRIM_GRAIN, trim_block, t);
    for (int64_t row = 0; row < rows; row++) {
      const int degree = degree_of(t, row);
      sums[degree]++;
      sums[4] += (int64_t)sizeof(float) * (numbers_of(t->highest) - numbers_of(degree));
    }
    first += rows;
  }
  PAGS_TRY(pags_transport_agree(t->trainer->options->transport, mine));
  PAGS_TRY(pags_share_sum(t->trainer->options->transport, sums, 5));
  memcpy(choice->rows, sums, sizeof choice->rows);
  choice->saved = sums[4];
  return PAGS_OK;
}

/* Draws some of the training views, evenly spaced; *psnr: the mean. */
static pags_result measure(pags_trainer *t, double *psnr) {
  enum { MEASURED = 32 };
  pags_scene scene = {0};
  const int64_t count = t->view_count < MEASURED ? t->view_count : MEASURED;
  const pags_result listed = pags_output_list_views(t->dataset, &t->state, &scene);
  PAGS_AUTOFREE pags_scene_view *views = scene.views;
  PAGS_AUTOFREE pags_measured_view *measured = malloc(MEASURED * sizeof *measured);
  PAGS_TRY(pags_transport_agree(t->options->transport, listed != PAGS_OK || measured
                                                           ? listed
                                                           : pags_out_of_memory("%lld photographs", (long long)count)));
  for (int64_t i = 0; i < count; i++) {
    const int64_t view = t->views[(2 * i + 1) * t->view_count / (2 * count)];
    measured[i] = (pags_measured_view){.view = view, .shown = views[view]};
  }
  PAGS_TRY(pags_held_out_views(t, measured, (int)count));
  double sum = 0.0;
  int known = 0;
  for (int64_t i = 0; i < count; i++)
    if (isfinite(measured[i].psnr)) { /* else no pixel of it counts */
      sum += measured[i].psnr;
      known++;
    }
  *psnr = known > 0 ? sum / known : 0.0;
  return PAGS_OK;
}

/* Copies the SH coefficients of all models to `kept`, or back. */
static void copy_sh(pags_train_state *s, float *kept, bool back) {
  for (int64_t m = 0; m < s->model_count; m++) {
    pags_gaussians *const g = &s->models[m].gaussians;
    const size_t bytes = (size_t)g->count * sizeof(float);
    for (int p = PAGS_SH; p < pags_plane_count(g->sh_degree); p++, kept += g->count)
      memcpy(back ? pags_plane(g, p) : kept, back ? kept : pags_plane(g, p), bytes);
  }
}

/* Trims all terms, then with less and less to spend, until the photographs show that no more than `most` dB are lost.
 * The bound holds where training has converged. Before that, colours still lack some of the view dependence that the
 * photographs have, so that the loss goes with the root of what is spent. */
static pags_result trim_until(trimming *t, double most, float *kept) {
  pags_trainer *const r = t->trainer;
  pags_sh_choice *const choice = &r->state.sh;
  double before, after, allowed = HUGE_VAL;
  PAGS_TRY(measure(r, &before));
  copy_sh(&r->state, kept, false);
  for (int i = 0; i < MOST_TRIES; i++) {
    int64_t spent = 0;
    PAGS_TRY(find_price(t, allowed, &spent));
    PAGS_TRY(trim_all(t, choice));
    PAGS_TRY(measure(r, &after));
    choice->loss = before - after;
    choice->gain = i == 0 ? choice->loss : choice->gain;
    if (choice->loss <= most || allowed == 0.0)
      break;
    copy_sh(&r->state, kept, true);
    allowed = i == 0               ? whole
              : i + 2 < MOST_TRIES ? 0.8 * (double)spent * (most / choice->loss) * (most / choice->loss)
                                   : 0.0;
  }
  choice->made = true;
  return PAGS_OK;
}

pags_result pags_sh_trim(pags_trainer *trainer, const double *weight) {
  pags_train_state *const s = &trainer->state;
  pags_transport *const transport = trainer->options->transport;
  const double loss = s->schedule.config.size_limit.sh_loss;
  const int64_t views = trainer->view_count, models = s->model_count, blocks = s->models[0].gaussians.count;
  const int highest = s->schedule.config.color.sh_degree;
  int64_t rows = 0;
  for (int64_t m = 0; m < models; m++)
    rows += s->models[m].gaussians.count;
  PAGS_AUTOFREE pags_sh_view *listed = malloc((size_t)(views > 0 ? views : 1) * sizeof *listed);
  PAGS_AUTOFREE cost(*costs)[PAGS_SH_CUTS] = malloc((size_t)(rows > 0 ? rows : 1) * sizeof *costs);
  PAGS_AUTOFREE int64_t(*objects)[PAGS_SH_CUTS] = calloc((size_t)models, sizeof *objects);
  PAGS_AUTOFREE int64_t *sums = malloc((size_t)(blocks / TRIM_GRAIN + 1) * sizeof *sums);
  PAGS_AUTOFREE float *kept = malloc((size_t)(3 * pags_sh_coefficients(highest) * rows + 1) * sizeof *kept);
  PAGS_TRY(
      pags_transport_agree(transport, listed && costs && objects && sums && kept
                                          ? PAGS_OK
                                          : pags_out_of_memory("the SH degrees of %lld Gaussians", (long long)rows)));

  /* The pixels that Gaussians cover, each counted as far as they do, and the squared error that may be added. */
  int64_t pixels = 0;
  for (int64_t row = 0; row < rows; row++)
    pixels += (int64_t)(16.0 * weight[row]);
  PAGS_TRY(pags_share_sum(transport, &pixels, 1));
  trimming t = {.trainer = trainer,
                .highest = highest,
                .costs = costs,
                .objects = objects,
                .blocks = sums,
                .views = listed,
                .weight = weight,
                .budget = 3.0 * s->mse * (pags_pow(10.0, 0.1 * loss) - 1.0) * (double)pixels / 16.0};
  PAGS_TRY(find_all_costs(&t));
  PAGS_TRY(trim_until(&t, loss, kept));
  pags_log_message(
      PAGS_LOG_INFO,
      "SH bring %.2f dB; %lld Gaussians of degree 0, %lld of 1, %lld of 2, %lld of 3 cost %.3f dB and save "
      "%.1f MB",
      s->sh.gain, (long long)s->sh.rows[0], (long long)s->sh.rows[1], (long long)s->sh.rows[2],
      (long long)s->sh.rows[3], s->sh.loss, 1e-6 * (double)s->sh.saved);
  return PAGS_OK;
}
