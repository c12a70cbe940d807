/* SPDX-License-Identifier: Apache-2.0 */
/* Colour of a Gaussian seen from the camera: real spherical harmonics to degree 3 with INRIA's constants and signs,
 * colour = max(0, 0.5 + sum_k basis_k(direction) coefficient_k), direction = normalise(mean - eye) in the model's
 * frame. Colours are clamped to PAGS_COLOUR_MAX: infinity times a weight of 0 would be NaN, and a splat in front of
 * one of colour 1e20 would get a gradient of that size. */
#ifndef PAGS_SIMD_SH_H
#define PAGS_SIMD_SH_H

#include "scan.h"

#define SH_C0 0.28209479177387814f
#define SH_C1 0.4886025119029199f
static const float sh_c2[5] = {1.0925484305920792f, -1.0925484305920792f, 0.31539156525252005f, -1.0925484305920792f,
                               0.5462742152960396f};
static const float sh_c3[7] = {-0.5900435899266435f, 2.890611442640554f, -0.4570457994644658f, 0.3731763325901154f,
                               -0.4570457994644658f, 1.445305721320277f, -0.5900435899266435f};

/* Computes the basis functions basis[0 .. (degree+1)^2) of the unit direction (x, y, z). */
static inline void sh_basis(int degree, vf x, vf y, vf z, vf *basis) {
  basis[0] = v_set(SH_C0);
  if (degree < 1)
    return;
  basis[1] = v_mul(v_set(-SH_C1), y);
  basis[2] = v_mul(v_set(SH_C1), z);
  basis[3] = v_mul(v_set(-SH_C1), x);
  if (degree < 2)
    return;
  const vf xx = v_mul(x, x), yy = v_mul(y, y), zz = v_mul(z, z), xy = v_mul(x, y), yz = v_mul(y, z), xz = v_mul(x, z);
  const vf two_zz = v_add(zz, zz);
  basis[4] = v_mul(v_set(sh_c2[0]), xy);
  basis[5] = v_mul(v_set(sh_c2[1]), yz);
  basis[6] = v_mul(v_set(sh_c2[2]), v_sub(two_zz, v_add(xx, yy)));
  basis[7] = v_mul(v_set(sh_c2[3]), xz);
  basis[8] = v_mul(v_set(sh_c2[4]), v_sub(xx, yy));
  if (degree < 3)
    return;
  const vf three = v_set(3.0f), ring = v_sub(v_add(two_zz, two_zz), v_add(xx, yy));
  basis[9] = v_mul(v_mul(v_set(sh_c3[0]), y), v_sub(v_mul(three, xx), yy));
  basis[10] = v_mul(v_mul(v_set(sh_c3[1]), xy), z);
  basis[11] = v_mul(v_mul(v_set(sh_c3[2]), y), ring);
  basis[12] = v_mul(v_mul(v_set(sh_c3[3]), z), v_sub(two_zz, v_mul(three, v_add(xx, yy))));
  basis[13] = v_mul(v_mul(v_set(sh_c3[4]), x), ring);
  basis[14] = v_mul(v_mul(v_set(sh_c3[5]), z), v_sub(xx, yy));
  basis[15] = v_mul(v_mul(v_set(sh_c3[6]), x), v_sub(xx, v_mul(three, yy)));
}

/* Unit direction from the eye; (0, 0, 1) at the eye itself, where *inverse_distance is 0 and so is every gradient. `u`:
 * when the rows are read out; NULL without a rolling shutter. */
V_INLINE void sh_direction(const pags_projection *view, const vf *u, const float *data, int64_t stride, vf *d,
                           vf *inverse_distance) {
  for (int k = 0; k < 3; k++) {
    vf eye = v_set(view->eye[k]); /* the camera's centre in the model's frame */
    if (u)
      eye = v_fma(*u, v_fma(*u, v_set(view->scan->eye2[k]), v_set(view->scan->eye1[k])), eye);
    d[k] = v_sub(v_load(data + k * stride), eye);
  }
  const vf norm2 = v_dot3(d[0], d[1], d[2], d[0], d[1], d[2]);
  const vm apart = v_gt(norm2, v_set(1e-30f));
  *inverse_distance = v_maskz(apart, v_div(v_set(1.0f), v_sqrt(v_select(apart, norm2, v_set(1.0f)))));
  d[0] = v_mul(d[0], *inverse_distance);
  d[1] = v_mul(d[1], *inverse_distance);
  d[2] = v_select(apart, v_mul(d[2], *inverse_distance), v_set(1.0f));
}

#endif
