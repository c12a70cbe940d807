/* SPDX-License-Identifier: Apache-2.0 */
/* Random cameras and Gaussians from a seed; see reference_scene.h. */
#include "reference/reference_scene.h"

#include <math.h>
#include <string.h>

static uint64_t next_bits(reference_random *random) { /* splitmix64, public domain by S. Vigna */
  uint64_t z = random->state += 0x9e3779b97f4a7c15u;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
  z = (z ^ z >> 27) * 0x94d049bb133111ebu;
  return z ^ z >> 31;
}

double reference_uniform(reference_random *random, double lo, double hi) {
  return lo + (hi - lo) * ((double)(next_bits(random) >> 11) * 0x1p-53);
}

double reference_normal(reference_random *random) {
  double radius = sqrt(-2 * log(reference_uniform(random, 0x1p-53, 1)));
  return radius * cos(6.283185307179586 * reference_uniform(random, 0, 1));
}

void reference_random_pose(reference_random *random, double reach, double pose[12]) {
  double q[4], length = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = reference_normal(random);
    length += q[k] * q[k];
  }
  for (int k = 0; k < 4; k++)
    q[k] /= sqrt(length);
  double w = q[0], x = q[1], y = q[2], z = q[3];
  double rotation[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  for (int row = 0; row < 3; row++) {
    memcpy(&pose[4 * row], &rotation[3 * row], 3 * sizeof(double));
    pose[4 * row + 3] = reference_uniform(random, -reach, reach);
  }
}

pags_camera reference_random_camera(reference_random *random, int width, int height) {
  pags_camera camera = {.width = width, .height = height, .time = NAN};
  camera.fx = width * reference_uniform(random, 0.8, 1.0);
  camera.fy = camera.fx * reference_uniform(random, 0.95, 1.05);
  camera.cx = width * reference_uniform(random, 0.4, 0.6);
  camera.cy = height * reference_uniform(random, 0.4, 0.6);
  reference_random_pose(random, 3, camera.world_from_camera);
  return camera;
}

reference_recipe reference_recipe_default(void) {
  return (reference_recipe){
      .depth = {1, 6}, .spread = 1, .sigma = {1, 6}, .anisotropy = 10, .logit = {-2, 3}, .colour = 0.25};
}

static double log_uniform(reference_random *random, double lo, double hi) {
  return exp(reference_uniform(random, log(lo), log(hi)));
}

void reference_random_gaussian(reference_random *random, const reference_recipe *recipe, const pags_camera *camera,
                               const pags_frame_options *options, reference_part *part, int64_t i) {
  reference_view view = reference_view_of(part, camera, options);
  double depth = reference_uniform(random, recipe->depth[0], recipe->depth[1]);
  double half_width = 0.5 * recipe->spread * camera->width, half_height = 0.5 * recipe->spread * camera->height;
  double u = 0.5 * camera->width + reference_uniform(random, -half_width, half_width);
  double v = 0.5 * camera->height + reference_uniform(random, -half_height, half_height);
  double offset[3] = {(u - camera->cx) / camera->fx * depth, (v - camera->cy) / camera->fy * depth, depth};
  for (int k = 0; k < 3; k++)
    offset[k] -= view.translation[k];
  int64_t n = part->count;
  for (int k = 0; k < 3; k++) {
    double mean = 0;
    for (int row = 0; row < 3; row++)
      mean += view.rotation[3 * row + k] * offset[row];
    part->planes[(PAGS_MEAN + k) * n + i] = mean;
  }
  double sigma = log_uniform(random, recipe->sigma[0], recipe->sigma[1]) * depth / camera->fx;
  double ratio = log_uniform(random, 1, recipe->anisotropy);
  part->planes[PAGS_SCALE * n + i] = log(sigma);
  part->planes[(PAGS_SCALE + 1) * n + i] = log(sigma / ratio);
  part->planes[(PAGS_SCALE + 2) * n + i] = log(sigma / log_uniform(random, 1, ratio));
  double length = log_uniform(random, 0.3, 3);
  for (int k = 0; k < 4; k++)
    part->planes[(PAGS_ROTATION + k) * n + i] = length * reference_normal(random);
  part->planes[PAGS_OPACITY * n + i] = reference_uniform(random, recipe->logit[0], recipe->logit[1]);
  for (int plane = PAGS_SH; plane < pags_plane_count(part->sh_degree); plane++)
    part->planes[plane * n + i] = (plane < PAGS_SH + 3 ? 3 : 1) * recipe->colour * reference_normal(random);
}

void reference_stretch(reference_part *part, const double factor[3]) {
  for (int k = 0; k < 3; k++) {
    for (int row = 0; row < 3; row++)
      part->world_from_model[4 * row + k] *= factor[k];
    for (int64_t i = 0; i < part->count; i++)
      part->planes[(PAGS_MEAN + k) * part->count + i] /= factor[k];
  }
}

void reference_random_sh(reference_random *random, reference_part *part) {
  const int64_t count = 3 * pags_sh_coefficients(part->sh_degree) * part->count;
  part->sh = reference_alloc(count, sizeof(double));
  for (int64_t k = 0; k < count; k++)
    part->sh[k] = (k < 3 * part->count ? 0.75 : 0.25) * reference_normal(random);
}

pags_sky reference_random_sky(reference_random *random, int size) {
  pags_sky sky = {.size = size, .texels = reference_alloc(18 * (int64_t)size * size, sizeof(float))};
  for (int64_t k = 0; k < 18 * (int64_t)size * size; k++)
    sky.texels[k] = (float)reference_uniform(random, 0, 1);
  return sky;
}

pags_frame_options reference_options(void) {
  return (pags_frame_options){.near_plane = 0.01f, .low_pass = 0.3f, .sh_degree = 3, .exp_degree = 5};
}
