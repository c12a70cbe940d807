/* SPDX-License-Identifier: Apache-2.0 */
/* Fits a camera's pose by Adam to the mean square error of the left half of its photograph; see camera_poses.h.
 *
 * The pose becomes P exp(b), in the camera's frame. A motion of the camera changes a picture as the inverse motion of
 * the world does: with the gradient (G_w, G_v) by a motion of the world about its origin, and the camera's rotation R
 * and position c, that by b is R^T (-G_w - G_v x c, -G_v). Lengths count in units of the picture's mean depth, so that
 * turning and moving by the same number move the picture alike. */
#include "train/camera_poses.h"

#include <math.h>

#include "base/memory.h"
#include "base/psnr.h"
#include "maths/maths.h"
#include "port/port.h"
#include "train/gradient_store.h"

enum { STEPS = 40 };
/* How far a step moves the middle of the picture, px: of the first and of the last step, log-linear between. */
static const double first_move = 1.0, last_move = 0.03;

typedef struct fit {
  const pags_part *parts;
  int part_count;
  const pags_photo *photo;
  double gain[3], offset[3];
  float *plane[3];      /* dL/d(picture) */
  int64_t floats;       /* of a plane */
  int64_t *before;      /* per part: clusters of the parts before it */
  double (*by_pose)[6]; /* per cluster */
  int64_t clusters;
} fit;

static void destroy(fit *f) {
  for (int c = 0; c < 3; c++)
    pags_port_aligned_free(f->plane[c]);
  free(f->before);
  free(f->by_pose);
}

static pags_result reserve(fit *f, const pags_picture *picture) {
  const int64_t floats = (int64_t)picture->stride * ((picture->height + 15) / 16 * 16);
  for (int c = 0; c < 3 && f->floats != floats; c++)
    PAGS_CHECK_MEMORY(pags_floats_renew(&f->plane[c], floats), "gradients of a picture of %d x %d", picture->width,
                      picture->height);
  f->floats = floats;
  return PAGS_OK;
}

static void receive(void *user, const pags_cluster_gradient *g, PAGS_UNUSED int worker) {
  const fit *const f = user;
  pags_pose_gradient(g->data, g->stride, g->planes, &f->parts[g->part], g->first, g->count,
                     f->by_pose[f->before[g->part] + g->cluster]);
}

/* Mean square of the columns [first, last) of the picture less the photograph; with `gradient`, its gradient goes to
 * the planes, too. NaN if no pixel counts. */
static double mean_square(const fit *f, const pags_picture *picture, int first, int last, bool gradient) {
  const pags_photo *const photo = f->photo;
  double sum = 0.0;
  int64_t counted = 0;
  for (int y = 0; y < photo->height; y++)
    for (int x = first; x < last; x++)
      counted += !photo->mask || photo->mask[(int64_t)y * photo->stride + x];
  for (int y = 0; y < photo->height; y++)
    for (int x = first; x < last; x++) {
      const int64_t at = (int64_t)y * photo->stride + x, to = (int64_t)y * picture->stride + x;
      const bool counts = !photo->mask || photo->mask[at];
      for (int c = 0; c < 3; c++) {
        const double wanted = photo->rgb[(int64_t)c * photo->height * photo->stride + at] / 255.0;
        const double shown = f->gain[c] * (double)picture->rgb[c][to] + f->offset[c];
        const double away = counts ? fmin(fmax(shown, 0.0), 1.0) - wanted : 0.0;
        sum += away * away;
        if (gradient) /* where the picture is clamped, too: only a step's direction hangs on it */
          f->plane[c][to] = (float)(2.0 * away * f->gain[c] / (3.0 * (double)counted));
      }
    }
  return counted > 0 ? sum / (3.0 * (double)counted) : (double)NAN;
}

/* Mean depth of the drawn pixels; 1 if nothing is drawn. */
static double mean_depth(const pags_picture *picture) {
  double depth = 0.0, weight = 0.0;
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->width; x++) {
      const int64_t at = (int64_t)y * picture->stride + x;
      depth += (double)picture->depth_sum[at];
      weight += 1.0 - (double)picture->transmittance[at];
    }
  return depth > 0.0 && weight > 0.0 ? depth / weight : 1.0;
}

/* The gradient by a motion of the camera in its own frame. */
static pags_result camera_gradient(fit *f, pags_frame *frame, const pags_camera *camera, const double origin[3],
                                   double out[6]) {
  const pags_picture_gradient gradient = {.rgb = {f->plane[0], f->plane[1], f->plane[2]}};
  double by_world[6] = {0.0};
  memset(f->by_pose, 0, (size_t)f->clusters * sizeof *f->by_pose);
  PAGS_TRY(pags_frame_backward(frame, &gradient, receive, f, NULL));
  for (int i = 0; i < f->part_count; i++)
    for (int64_t c = 0; c < f->parts[i].clusters->count; c++)
      pags_pose_gradient_by_world(f->parts[i].world_from_model, f->by_pose[f->before[i] + c], by_world);
  pags_camera_gradient(camera->world_from_camera, origin, by_world, out);
  return PAGS_OK;
}

static pags_result run(fit *f, pags_frame *frame, const pags_frame_options *options, pags_touch_fn *touch, void *user,
                       pags_fitted_pose *out) {
  const pags_train_config config = pags_train_config_default();
  const int half = out->camera.width / 2, width = out->camera.width;
  pags_camera camera = out->camera;
  pags_adam6 moments = {0};
  double least = INFINITY, depth = 1.0;
  for (int step = 0; step <= STEPS; step++) {
    pags_picture picture;
    double by_camera[6], direction[6], motion[12];
    PAGS_TRY(pags_frame_render(frame, f->parts, f->part_count, &camera, options, touch, user, &picture));
    PAGS_TRY(reserve(f, &picture));
    const double left = mean_square(f, &picture, 0, half, true), right = mean_square(f, &picture, half, width, false);
    if (step == 0) {
      depth = mean_depth(&picture);
      out->given = out->fitted = pags_psnr(right);
    }
    if (isnan(left) || isnan(right))
      return PAGS_OK;
    if (left < least) {
      least = left;
      out->camera = camera;
      out->fitted = pags_psnr(right);
    }
    if (step == STEPS)
      break;
    PAGS_TRY(camera_gradient(f, frame, &camera, options->origin, by_camera));
    for (int k = 3; k < 6; k++)
      by_camera[k] *= depth;
    if (!pags_adam6_step(&moments, by_camera, &config, direction))
      break;
    const double move = first_move * pags_pow(last_move / first_move, (double)step / (STEPS - 1)) / camera.fx;
    for (int k = 0; k < 6; k++)
      direction[k] *= k < 3 ? -move : -move * depth;
    pags_increment_matrix(direction, direction + 3, motion);
    pags_rigid_multiply(camera.world_from_camera, motion, camera.world_from_camera);
  }
  return PAGS_OK;
}

pags_result pags_fit_pose(pags_frame *frame, const pags_part *parts, int part_count, const pags_camera *camera,
                          const pags_frame_options *options, pags_touch_fn *touch, void *user, const pags_photo *photo,
                          pags_fitted_pose *out) {
  PAGS_AUTO(destroy) fit f = {.parts = parts, .part_count = part_count, .photo = photo};
  pags_frame_options drawn = *options;
  for (int c = 0; c < 3; c++) {
    f.gain[c] = options->exposed ? (double)options->gain[c] : 1.0;
    f.offset[c] = options->exposed ? (double)options->offset[c] : 0.0;
  }
  drawn.exposed = drawn.extra_channels = drawn.keep_for_passes = 0;
  drawn.early_z = PAGS_EARLY_Z_OFF;
  drawn.order = PAGS_ORDER_DEPTH;
  drawn.keep_for_backward = drawn.depth_sum = 1;
  *out = (pags_fitted_pose){.camera = *camera, .given = (double)NAN, .fitted = (double)NAN};
  f.before = calloc((size_t)part_count + 1, sizeof *f.before);
  for (int i = 0; f.before && i < part_count; i++) {
    f.before[i] = f.clusters;
    f.clusters += parts[i].clusters->count;
  }
  f.by_pose = calloc((size_t)f.clusters + 1, sizeof *f.by_pose);
  PAGS_CHECK_MEMORY(f.before && f.by_pose, "%lld gradients of a pose", (long long)f.clusters);
  return run(&f, frame, &drawn, touch, user, out);
}
