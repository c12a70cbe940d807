/* SPDX-License-Identifier: Apache-2.0 */
/* Bakes the parts of a scene at one time into one set of Gaussians in the world's frame: means and rotations are
 * moved by the part's rigid motion, spherical harmonics are rotated by sh_rotate.c. Writes such a set as .splat. */
#include "exporters/format/bake.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "scene/axes.h"
#include "scene/splat_formats.h"

/* ---- Baking ---- */

/* Writes Gaussian `i` of a part as Gaussian `at` of `out`, moved by the part's pose. `turn_q` is the pose's rotation
 * as a quaternion, `turn` its rotation of harmonics; `turn` NULL: the pose doesn't rotate, and rotations and
 * harmonics are copied to the bit. */
static void bake_row(const pags_part *part, const pags_sh_rotation *turn, const double turn_q[4], int64_t i,
                     pags_gaussians *out, int64_t at) {
  const pags_gaussians *g = part->gaussians;
  const float *const sh = part->sh ? part->sh : pags_plane(g, PAGS_SH);
  double p[3], moved[3], q[4], rest[15];
  const int degree = out->sh_degree < g->sh_degree ? out->sh_degree : g->sh_degree;
  pags_gaussian_mean(g, i, p);
  for (int k = 0; k < 4; k++)
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
  if (turn)
    pags_quaternion_multiply(turn_q, q, q);
  pags_rigid_point(part->world_from_model, p, moved);
  for (int k = 0; k < 3; k++) {
    pags_plane(out, PAGS_MEAN + k)[at] = (float)moved[k];
    pags_plane(out, PAGS_SCALE + k)[at] = pags_plane(g, PAGS_SCALE + k)[i];
    pags_plane(out, PAGS_SH + k)[at] = sh[k * g->stride + i];
  }
  for (int k = 0; k < 4; k++)
    pags_plane(out, PAGS_ROTATION + k)[at] = (float)q[k];
  pags_plane(out, PAGS_OPACITY)[at] = pags_plane(g, PAGS_OPACITY)[i];
  for (int c = 0; c < 3 && degree; c++) {
    int count = pags_sh_coefficients(degree) - 1;
    for (int k = 0; k < count; k++)
      rest[k] = (double)sh[(3 * (k + 1) + c) * g->stride + i];
    if (turn)
      pags_sh_rotation_apply(turn, degree, rest);
    for (int k = 0; k < count; k++)
      pags_plane(out, PAGS_SH + 3 * (k + 1) + c)[at] = (float)rest[k];
  }
}

float pags_splats_alpha_min(const pags_part *parts, int count) {
  for (int i = 1; i < count; i++)
    if (parts[i].gaussians->alpha_min != parts[0].gaussians->alpha_min)
      return 0.0f;
  return count > 0 ? parts[0].gaussians->alpha_min : 0.0f;
}

pags_result pags_splats_bake(const pags_part *parts, int count, int sh_degree, bool keep_cut, pags_gaussians *out) {
  int64_t total = 0;
  bool s_sem = count > 0;
  for (int i = 0; i < count; i++) {
    total += parts[i].gaussians->count;
    s_sem = s_sem && parts[i].gaussians->s_sem;
  }
  PAGS_TRY(pags_gaussians_create(out, total, sh_degree));
  out->alpha_min = keep_cut ? pags_splats_alpha_min(parts, count) : 0.0f;
  if (s_sem)
    PAGS_TRY(pags_gaussians_add_s_sem(out));
  out->count = 0;
  for (const pags_part *part = parts; part < parts + count; part++) {
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const double *m = part->world_from_model;
    const double r[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
    const pags_gaussians *g = part->gaussians;
    double q[4];
    pags_sh_rotation turn;
    bool turned = false;
    for (int k = 0; k < 9; k++)
      turned = turned || r[k] != identity[k];
    pags_quaternion_from_rotation(r, q);
    pags_sh_rotation_make(r, &turn);
    for (int64_t i = 0; i < g->count; i++) {
      const int64_t at = out->count;
      bake_row(part, turned ? &turn : NULL, q, i, out, at);
      if (out->s_sem)
        out->s_sem[at] = g->s_sem[i];
      if (out->object_id && g->object_id)
        out->object_id[at] = g->object_id[i];
      out->count += !(g->alpha_min > 0) || out->alpha_min > 0.0f || pags_plain_cut_make(out, at, (double)g->alpha_min);
    }
  }
  return PAGS_OK;
}

/* ---- The .splat file ---- */

uint8_t pags_splat_byte(double value) {
  return (uint8_t)fmin(fmax(floor(value + 0.5), 0), 255);
}

double pags_splat_linear(double value) {
  const double v = fmin(fmax(value, 0), 1);
  return v <= 0.04045 ? v / 12.92 : pags_pow((v + 0.055) / 1.055, 2.4);
}

double pags_splat_opacity(const pags_gaussians *g, int64_t i) {
  return 1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i]));
}

void pags_splat_rotation(const pags_gaussians *g, int64_t i, double q[4]) {
  double length = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
    length += q[k] * q[k];
  }
  for (int k = 0; k < 4; k++)
    q[k] = length > 0 ? q[k] / sqrt(length) : k == 0;
}

/* A .splat file has 32 bytes a Gaussian: position and scales (standard deviations) as floats, then colour, opacity
 * and rotation as bytes. The Gaussians keep their order. */
pags_result pags_splat_save(const char *path, const pags_gaussians *g) {
  PAGS_AUTOFREE uint8_t *bytes = calloc((size_t)g->count + 1, 32);
  PAGS_CHECK_MEMORY(bytes, "%lld Gaussians", (long long)g->count);
  for (int64_t i = 0; i < g->count; i++) {
    uint8_t *row = bytes + 32 * i;
    double q[4];
    pags_splat_rotation(g, i, q);
    for (int k = 0; k < 3; k++) {
      pags_store_f32(row + 4 * k, pags_plane(g, PAGS_MEAN + k)[i]);
      pags_store_f32(row + 12 + 4 * k,
                     (float)fmin(pags_exp((double)pags_plane(g, PAGS_SCALE + k)[i]), (double)FLT_MAX));
      row[24 + k] = pags_splat_byte(255 * (0.5 + PAGS_SH_C0 * (double)pags_plane(g, PAGS_SH + k)[i]));
    }
    row[27] = pags_splat_byte(255 * pags_splat_opacity(g, i));
    for (int k = 0; k < 4; k++)
      row[28 + k] = pags_splat_byte(128 + 128 * q[k]);
  }
  return pags_file_write(path, bytes, 32 * (size_t)g->count);
}
