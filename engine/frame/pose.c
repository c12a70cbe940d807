/* From the gradients of a part's Gaussians to that of the part's pose.
 *
 * world_from_model * exp(w, v), w and v small, draws what the old pose would draw of Gaussians moved in the model's frame:
 *   mean'       = mean + w x mean + v
 *   quaternion' = (1, w/2) * q = q + 1/2 (-w . q_v,  q_w w + w x q_v)       linear in q, which need not be of unit length
 * hence
 *   dL/dv = g_mean
 *   dL/dw = mean x g_mean + 1/2 (q_w g_v - g_w q_v + q_v x g_v)
 * What remains is the colour: the direction from the eye is as it should be, but the harmonics turn with the part and here don't. */
#include <pags/frame.h>

static void add_cross(double scale, const double a[3], const double b[3], double out[3]) {
  out[0] += scale * (a[1] * b[2] - a[2] * b[1]);
  out[1] += scale * (a[2] * b[0] - a[0] * b[2]);
  out[2] += scale * (a[0] * b[1] - a[1] * b[0]);
}

void pags_pose_gradient(const float *data, int64_t stride, const pags_gaussians *gaussians, int64_t first, int count,
                        double out[6]) {
  for (int i = 0; i < count; i++) {
    double value[PAGS_OPACITY], gradient[PAGS_OPACITY]; /* by plane: mean, scale, rotation */
    for (int p = 0; p < PAGS_OPACITY; p++) {
      value[p] = (double)pags_plane(gaussians, p)[first + i];
      gradient[p] = (double)data[p * stride + i];
    }
    const double *const q = value + PAGS_ROTATION, *const g = gradient + PAGS_ROTATION;
    add_cross(1.0, value + PAGS_MEAN, gradient + PAGS_MEAN, out);
    add_cross(0.5, q + 1, g + 1, out);
    for (int k = 0; k < 3; k++) {
      out[k] += 0.5 * (q[0] * g[k + 1] - g[0] * q[k + 1]);
      out[3 + k] += gradient[PAGS_MEAN + k];
    }
  }
}
