/* SPDX-License-Identifier: Apache-2.0 */
/* pags_pose_gradient: the loss's gradient by the pose of a part, from the gradients of the part's Gaussians. Training
 * uses it to refine the poses of tracked objects.
 *
 * Drawing a part with the pose world_from_model * exp(w, v), for a small rotation w and translation v, is the same as
 * keeping the old pose and moving the Gaussians in the model's frame:
 *   mean'       = mean + w x mean + v
 *   quaternion' = (1, w/2) * q = q + 1/2 (-w . q_v,  q_w w + w x q_v)       linear in q, which need not be of unit
 *     length
 *   SH'         = SH + sum_a w_a G_a SH                                     G_a antisymmetric, within each degree
 * hence
 *   dL/dv   = g_mean
 *   dL/dw   = mean x g_mean + 1/2 (q_w g_v - g_w q_v + q_v x g_v) + (g_SH . G_a SH)_a
 * SH are the coefficients that were drawn: those of pags_part.sh, if the part has them. */
#include <stdbool.h>

#include <pags/frame.h>

#include "base/vec3.h"

enum { ROWS = 64 }; /* rows whose SH terms are summed at a time */

/* The generators G_a, the angular momentum matrices of the real spherical harmonics Y_k, with the signs of sh.h:
 * d(sum_k c_k Y_k(exp(-w) d))/dw_axis is the sum of value (c_row Y_column - c_column Y_row) over the entries of that
 * axis. The values are roots of small whole numbers. */
static const struct turn {
  int8_t axis, row, column;
  float value;
} turns[] = {
    {0, 1, 2, -1.0f},          {0, 4, 7, -1.0f},          {0, 5, 6, -1.73205081f},   {0, 5, 8, -1.0f},
    {0, 9, 14, -1.22474487f},  {0, 10, 13, -1.58113883f}, {0, 10, 15, -1.22474487f}, {0, 11, 12, -2.44948974f},
    {0, 11, 14, -1.58113883f}, {1, 2, 3, -1.0f},          {1, 4, 5, 1.0f},           {1, 6, 7, -1.73205081f},
    {1, 7, 8, -1.0f},          {1, 9, 10, 1.22474487f},   {1, 10, 11, 1.58113883f},  {1, 12, 13, -2.44948974f},
    {1, 13, 14, -1.58113883f}, {1, 14, 15, -1.22474487f}, {2, 1, 3, -1.0f},          {2, 4, 8, -2.0f},
    {2, 5, 7, -1.0f},          {2, 9, 15, -3.0f},         {2, 10, 14, -2.0f},        {2, 11, 13, -1.0f},
};

/* The SH terms g_SH . G_a SH of rows [first, first + count), summed over the channels, to turned[axis][row - first];
 * count <= ROWS. */
static void turn_harmonics(const float *data, int64_t stride, int planes, const pags_part *part, int64_t first,
                           int count, float turned[3][ROWS]) {
  const int64_t apart = part->gaussians->stride;
  const float *const sh = (part->sh ? part->sh : pags_plane(part->gaussians, PAGS_SH)) + first;
  for (int i = 0; i < ROWS; i++)
    turned[0][i] = turned[1][i] = turned[2][i] = 0.0f;
  for (size_t e = 0; e < sizeof turns / sizeof *turns; e++) {
    const struct turn *const t = turns + e;
    float *const sum = turned[t->axis];
    for (int c = 0; c < 3 && PAGS_SH + 3 * t->column + c < planes; c++) {
      const float *const row = sh + (3 * t->row + c) * apart, *const column = sh + (3 * t->column + c) * apart;
      const float *const by_row = data + (PAGS_SH + 3 * t->row + c) * stride;
      const float *const by_column = data + (PAGS_SH + 3 * t->column + c) * stride;
      for (int i = 0; i < count; i++)
        sum[i] += t->value * (row[i] * by_column[i] - column[i] * by_row[i]);
    }
  }
}

static void add_cross(double scale, const double a[3], const double b[3], double out[3]) {
  out[0] += scale * (a[1] * b[2] - a[2] * b[1]);
  out[1] += scale * (a[2] * b[0] - a[0] * b[2]);
  out[2] += scale * (a[0] * b[1] - a[1] * b[0]);
}

/* Adds dL/dw and dL/dv of one row's mean and quaternion to out[0..2] and out[3..5]. */
static void add_motion(const float *data, int64_t stride, const pags_gaussians *gaussians, int64_t row, double out[6]) {
  double value[PAGS_OPACITY], gradient[PAGS_OPACITY]; /* by plane: mean, scale, rotation */
  for (int p = 0; p < PAGS_OPACITY; p++) {
    value[p] = (double)pags_plane(gaussians, p)[row];
    gradient[p] = (double)data[p * stride];
  }
  const double *const q = value + PAGS_ROTATION, *const g = gradient + PAGS_ROTATION;
  add_cross(1.0, value + PAGS_MEAN, gradient + PAGS_MEAN, out);
  add_cross(0.5, q + 1, g + 1, out);
  for (int k = 0; k < 3; k++) {
    out[k] += 0.5 * (q[0] * g[k + 1] - g[0] * q[k + 1]);
    out[3 + k] += gradient[PAGS_MEAN + k];
  }
}

void pags_pose_gradient(const float *data, int64_t stride, int planes, const pags_part *part, int64_t first, int count,
                        double out[6]) {
  for (int start = 0; start < count; start += ROWS) {
    const int rows = count - start < ROWS ? count - start : ROWS;
    float turned[3][ROWS];
    turn_harmonics(data + start, stride, planes, part, first + start, rows, turned);
    for (int i = 0; i < rows; i++) {
      double own[6] = {(double)turned[0][i], (double)turned[1][i], (double)turned[2][i], 0.0, 0.0, 0.0};
      add_motion(data + start + i, stride, part->gaussians, first + start + i, own);
      /* A row with a parameter that isn't finite has a gradient of zero, but their product is NaN, which must not get
       * into the pose's gradient. */
      double check = 0.0;
      for (int k = 0; k < 6; k++)
        check += own[k] * 0.0;
      for (int k = 0; k < 6 && check == 0.0; k++)
        out[k] += own[k];
    }
  }
}

/* A motion (w, v) of the world is R^T (w, v + w x t) in the frame of a part with the pose [R|t]. */
void pags_pose_gradient_by_world(const double world_from_model[12], const double by_pose[6], double by_world[6]) {
  double place[3], turn[3], push[3], lever[3];
  pags_pose_position(world_from_model, place);
  pags_rotate3(world_from_model, by_pose, turn);
  pags_rotate3(world_from_model, by_pose + 3, push);
  pags_cross3(place, push, lever);
  for (int k = 0; k < 3; k++) {
    by_world[k] += turn[k] + lever[k];
    by_world[3 + k] += push[k];
  }
}
