/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the engine's frame on the oracle's data; see frame_scene.h. */
#include "reference/frame_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "port/port.h"
#include "reference/reference_scene.h"

static void check(pags_result result) {
  if (result != PAGS_OK)
    fail_msg("%s: %s", pags_result_name(result), pags_error_message());
}

/* ---- Scenes ---- */

static int64_t *row_order(int64_t count, uint64_t shuffle_seed) {
  reference_random random = {shuffle_seed};
  int64_t *order = reference_alloc(count, sizeof *order);
  for (int64_t i = 0; i < count; i++) {
    int64_t j = shuffle_seed ? (int64_t)reference_uniform(&random, 0, (double)(i + 1)) : i;
    order[i] = order[j];
    order[j] = i;
  }
  return order;
}

static int sh_planes(int degree) {
  return 3 * pags_sh_coefficients(degree);
}

static void create_sh(frame_scene *scene, int p, const reference_part *from) {
  const int64_t stride = scene->gaussians[p].stride, floats = sh_planes(from->sh_degree) * stride;
  scene->sh[p] = pags_port_aligned_alloc(64, (size_t)floats * sizeof(float));
  scene->sh_values[p] = reference_alloc(floats, sizeof(float));
  assert_non_null(scene->sh[p]);
  scene->parts[p].sh = scene->sh[p];
  for (int64_t k = 0; k < floats; k++)
    scene->sh[p][k] = NAN;
  for (int plane = 0; plane < sh_planes(from->sh_degree); plane++) {
    for (int64_t i = 0; i < from->count; i++)
      scene->sh_values[p][plane * stride + i] = (float)from->sh[plane * from->count + scene->source[p][i]];
  }
}

static void create_factor(frame_scene *scene, int p, const reference_part *from) {
  scene->factor[p] = reference_alloc(scene->gaussians[p].stride, sizeof(float));
  scene->parts[p].opacity_factor = scene->factor[p];
  for (int64_t i = 0; i < from->count; i++) {
    scene->factor[p][i] = (float)from->factor[scene->source[p][i]];
    scene->parts[p].opacity_factor_most = fmaxf(scene->parts[p].opacity_factor_most, scene->factor[p][i]);
  }
}

static void create_part(frame_scene *scene, int p, const reference_part *from, int cluster_size,
                        uint64_t shuffle_seed) {
  pags_gaussians *g = &scene->gaussians[p];
  check(pags_gaussians_create(g, from->count, from->sh_degree));
  g->alpha_min = (float)from->alpha_min;
  scene->source[p] = row_order(from->count, shuffle_seed ? shuffle_seed + (uint64_t)p : 0);
  if (shuffle_seed || from->id)
    scene->id[p] = reference_alloc(from->count, sizeof(int32_t));
  for (int64_t i = 0; i < from->count; i++) {
    int64_t source = scene->source[p][i];
    for (int plane = 0; plane < pags_plane_count(from->sh_degree); plane++)
      pags_plane(g, plane)[i] = (float)from->planes[plane * from->count + source];
    if (scene->id[p])
      scene->id[p][i] = from->id ? from->id[source] : from->first_id + (int32_t)source;
  }
  check(pags_clusters_create(&scene->clusters[p], from->count, cluster_size));
  pags_clusters_update(&scene->clusters[p], g, 0, scene->clusters[p].count);
  scene->parts[p] =
      (pags_part){.gaussians = g, .clusters = &scene->clusters[p], .id = scene->id[p], .first_id = from->first_id};
  memcpy(scene->parts[p].world_from_model, from->world_from_model, sizeof from->world_from_model);
  memcpy(scene->parts[p].velocity, from->velocity, sizeof from->velocity);
  if (from->sh)
    create_sh(scene, p, from);
  if (from->factor)
    create_factor(scene, p, from);
}

/* Sets the pointers into the struct again, as it is returned by value. */
static void point_parts(frame_scene *scene) {
  for (int p = 0; p < scene->part_count; p++) {
    scene->parts[p].gaussians = &scene->gaussians[p];
    scene->parts[p].clusters = &scene->clusters[p];
  }
}

frame_scene frame_scene_create(const reference_part *parts, int part_count, int cluster_size, uint64_t shuffle_seed) {
  frame_scene scene = {.part_count = part_count};
  assert_true(part_count <= FRAME_SCENE_PARTS);
  for (int p = 0; p < part_count; p++)
    create_part(&scene, p, &parts[p], cluster_size, shuffle_seed);
  return scene;
}

void frame_scene_destroy(frame_scene *scene) {
  for (int p = 0; p < scene->part_count; p++) {
    pags_clusters_destroy(&scene->clusters[p]);
    pags_gaussians_destroy(&scene->gaussians[p]);
    free(scene->id[p]);
    free(scene->source[p]);
    pags_port_aligned_free(scene->sh[p]);
    free(scene->sh_values[p]);
    free(scene->factor[p]);
  }
  *scene = (frame_scene){0};
}

void frame_scene_round(reference_part *part) {
  for (int64_t k = 0; k < part->count * pags_plane_count(part->sh_degree); k++)
    part->planes[k] = (double)(float)part->planes[k];
  for (int64_t k = 0; part->sh && k < sh_planes(part->sh_degree) * part->count; k++)
    part->sh[k] = (double)(float)part->sh[k];
  for (int64_t i = 0; part->factor && i < part->count; i++)
    part->factor[i] = (double)(float)part->factor[i];
}

/* ---- Runs ---- */

typedef struct run_context {
  const frame_scene *scene;
  frame_result *result;
} run_context;

static void touch(void *user, int part, int64_t cluster, int worker) {
  (void)worker;
  const run_context *context = user;
  context->result->parts[part].touched[cluster]++;
  if (!context->scene->sh[part])
    return;
  const int64_t stride = context->scene->gaussians[part].stride, size = context->scene->clusters[part].size;
  for (int plane = 0; plane < sh_planes(context->scene->gaussians[part].sh_degree); plane++) {
    for (int64_t i = cluster * size; i < stride && i < (cluster + 1) * size; i++)
      context->scene->sh[part][plane * stride + i] = context->scene->sh_values[part][plane * stride + i];
  }
}

static void receive(void *user, const pags_cluster_gradient *from, int worker) {
  (void)worker;
  const run_context *context = user;
  frame_part_result *to = &context->result->parts[from->part];
  const int64_t *source = context->scene->source[from->part];
  to->received[from->cluster]++;
  for (int i = 0; i < from->count; i++) {
    int64_t row = source[from->first + i];
    for (int plane = 0; plane < from->planes; plane++)
      to->planes[plane * to->count + row] = from->data[plane * from->stride + i];
    to->mean2d[row] = from->mean2d[i];
    to->radius[row] = from->radius[i];
    to->drawn[row] = from->drawn[i];
  }
}

static void create_result(frame_result *result, const frame_scene *scene, const pags_camera *camera,
                          const pags_sky *sky) {
  int64_t pixels = (int64_t)camera->width * camera->height;
  *result = (frame_result){.width = camera->width, .height = camera->height, .part_count = scene->part_count};
  result->rgb = reference_alloc(3 * pixels, sizeof(float));
  result->transmittance = reference_alloc(pixels, sizeof(float));
  result->depth = reference_alloc(pixels, sizeof(float));
  result->depth_sum = reference_alloc(pixels, sizeof(float));
  result->id = reference_alloc(pixels, sizeof(int32_t));
  result->sky_floats = sky ? 18 * (int64_t)sky->size * sky->size : 0;
  result->sky = reference_alloc(result->sky_floats, sizeof(float));
  result->sky_blocks = reference_alloc(result->sky_floats / 3 / PAGS_SKY_BLOCK + 1, 1);
  for (int p = 0; p < scene->part_count; p++) {
    frame_part_result *part = &result->parts[p];
    part->count = scene->gaussians[p].count;
    part->plane_count = pags_plane_count(scene->gaussians[p].sh_degree);
    part->planes = reference_alloc(part->count * part->plane_count, sizeof(float));
    part->mean2d = reference_alloc(part->count, sizeof(float));
    part->radius = reference_alloc(part->count, sizeof(float));
    part->drawn = reference_alloc(part->count, 1);
    part->cluster_count = scene->clusters[p].count;
    part->touched = reference_alloc(part->cluster_count, 1);
    part->received = reference_alloc(part->cluster_count, 1);
  }
}

static void copy_plane(const pags_picture *picture, const void *from, void *to) { /* copies a plane of 4-byte values */
  for (int y = 0; from && y < picture->height; y++) {
    memcpy((char *)to + (size_t)4 * (size_t)y * (size_t)picture->width,
           (const char *)from + (size_t)4 * (size_t)y * (size_t)picture->stride, (size_t)4 * (size_t)picture->width);
  }
}

/* Copies a plane of doubles to a float plane of the picture's stride and of whole tiles; NULL stays NULL. The padding
 * is NaN, as it must not be used. */
static float *pad_plane(const pags_picture *picture, const double *from) {
  if (!from)
    return NULL;
  int rows = (picture->height + 15) / 16 * 16;
  float *to = reference_alloc((int64_t)picture->stride * rows, sizeof *to);
  for (int y = 0; y < rows; y++) {
    for (int x = 0; x < picture->stride; x++) {
      int inside = x < picture->width && y < picture->height;
      to[(int64_t)y * picture->stride + x] = inside ? (float)from[(int64_t)y * picture->width + x] : NAN;
    }
  }
  return to;
}

static void receive_sky(void *user, const pags_sky_gradient *gradient, int worker) {
  const frame_result *const result = user;
  (void)worker;
  for (int64_t block = 0; block < gradient->blocks; block++) {
    const int64_t floats = 3 * PAGS_SKY_BLOCK, at = 3 * gradient->first + floats * block,
                  left = result->sky_floats - at;
    if (!gradient->seen[block])
      continue;
    result->sky_blocks[at / floats]++;
    memcpy(result->sky + at, gradient->data + floats * block, (size_t)(left < floats ? left : floats) * sizeof(float));
  }
}

static void go_back(pags_frame *frame, run_context *context, const pags_picture *picture,
                    const reference_picture_gradient *gradient) {
  int64_t pixels = (int64_t)picture->width * picture->height;
  float *planes[5];
  for (int channel = 0; channel < 3; channel++)
    planes[channel] = pad_plane(picture, gradient->rgb + channel * pixels);
  planes[3] = pad_plane(picture, gradient->transmittance);
  planes[4] = pad_plane(picture, gradient->depth_sum);
  const pags_picture_gradient padded = {.rgb = {planes[0], planes[1], planes[2]},
                                        .transmittance = planes[3],
                                        .depth_sum = planes[4],
                                        .sky = context->result->sky_floats ? receive_sky : NULL,
                                        .sky_user = context->result,
                                        .sky_cut = context->scene->sky_cut};
  check(pags_frame_backward(frame, &padded, receive, context, &context->result->bad_rows));
  for (int k = 0; k < 5; k++)
    free(planes[k]);
}

frame_result frame_run(pags_frame *frame, const frame_scene *scene, const pags_camera *camera,
                       const pags_frame_options *options, const reference_picture_gradient *gradient) {
  frame_result result;
  frame_scene here = *scene;
  point_parts(&here);
  create_result(&result, scene, camera, options->sky);
  run_context context = {scene, &result};
  pags_frame_options kept = *options;
  kept.keep_for_backward = gradient != NULL;
  kept.depth_sum = gradient && gradient->depth_sum;
  pags_picture picture;
  check(pags_frame_render(frame, here.parts, here.part_count, camera, &kept, touch, &context, &picture));
  assert_int_equal(picture.width, camera->width);
  assert_int_equal(picture.height, camera->height);
  assert_int_equal(picture.stride, (camera->width + 15) / 16 * 16);
  for (int channel = 0; channel < 3; channel++)
    copy_plane(&picture, picture.rgb[channel], result.rgb + (int64_t)channel * camera->width * camera->height);
  copy_plane(&picture, picture.transmittance, result.transmittance);
  assert_true((picture.depth != NULL) == (kept.extra_channels != 0));
  assert_true((picture.depth_sum != NULL) == (kept.extra_channels || kept.depth_sum));
  copy_plane(&picture, picture.depth, result.depth);
  copy_plane(&picture, picture.depth_sum, result.depth_sum);
  copy_plane(&picture, picture.id, result.id);
  if (gradient) {
    go_back(frame, &context, &picture, gradient);
    for (int p = 0; p < result.part_count; p++)
      assert_memory_equal(result.parts[p].touched, result.parts[p].received, (size_t)result.parts[p].cluster_count);
  }
  for (int p = 0; p < result.part_count; p++) {
    for (int64_t c = 0; c < result.parts[p].cluster_count; c++)
      assert_true(result.parts[p].touched[c] <= 1);
  }
  return result;
}

void frame_result_destroy(frame_result *result) {
  free(result->rgb);
  free(result->transmittance);
  free(result->depth);
  free(result->depth_sum);
  free(result->sky);
  free(result->sky_blocks);
  free(result->id);
  for (int p = 0; p < result->part_count; p++) {
    frame_part_result *part = &result->parts[p];
    free(part->planes);
    free(part->mean2d);
    free(part->radius);
    free(part->drawn);
    free(part->touched);
    free(part->received);
  }
  *result = (frame_result){0};
}

static int all_finite(const float *values, int64_t count) {
  for (int64_t k = 0; k < count; k++) {
    if (!isfinite(values[k]))
      return 0;
  }
  return 1;
}

int frame_result_finite(const frame_result *result) {
  int64_t pixels = (int64_t)result->width * result->height;
  int finite = all_finite(result->rgb, 3 * pixels) && all_finite(result->transmittance, pixels) &&
               all_finite(result->depth, pixels) && all_finite(result->depth_sum, pixels) &&
               all_finite(result->sky, result->sky_floats);
  for (int p = 0; p < result->part_count; p++) {
    const frame_part_result *part = &result->parts[p];
    finite = finite && all_finite(part->planes, part->count * part->plane_count) &&
             all_finite(part->mean2d, part->count) && all_finite(part->radius, part->count);
  }
  return finite;
}

static void hash_bytes(uint64_t *hash, const void *bytes, int64_t count) { /* FNV-1a hash */
  const unsigned char *next = bytes;
  for (int64_t k = 0; k < count; k++)
    *hash = (*hash ^ next[k]) * 0x100000001b3u;
}

uint64_t frame_result_hash(const frame_result *result) {
  uint64_t hash = 0xcbf29ce484222325u;
  int64_t pixels = (int64_t)result->width * result->height;
  hash_bytes(&hash, result->rgb, 12 * pixels);
  hash_bytes(&hash, result->transmittance, 4 * pixels);
  hash_bytes(&hash, result->depth, 4 * pixels);
  hash_bytes(&hash, result->depth_sum, 4 * pixels);
  hash_bytes(&hash, result->id, 4 * pixels);
  hash_bytes(&hash, result->sky, 4 * result->sky_floats);
  for (int p = 0; p < result->part_count; p++) {
    const frame_part_result *part = &result->parts[p];
    hash_bytes(&hash, part->planes, 4 * part->count * part->plane_count);
    hash_bytes(&hash, part->mean2d, 4 * part->count);
    hash_bytes(&hash, part->radius, 4 * part->count);
    hash_bytes(&hash, part->drawn, part->count);
  }
  return hash;
}
