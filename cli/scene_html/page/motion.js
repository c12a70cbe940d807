// SPDX-License-Identifier: Apache-2.0
// Where the models are at a time. A model without a track stands still.
import * as V from './vector.js';

const STILL = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

// world_from_model, relative to the scene's origin, of a model at a time after the start of the scene; null: absent.
export function modelPose(model, time) {
  if (!model.times) return STILL;
  for (const [part, times] of model.times.entries()) {
    if (!times.length || time < times[0] || time > times[times.length - 1]) continue;
    let lo = 0, hi = times.length - 1;
    while (hi - lo > 1) {
      const middle = lo + hi >> 1;
      if (times[middle] <= time) lo = middle;
      else hi = middle;
    }
    const [a, b] = [model.poses[part][lo], model.poses[part][hi]], t = times[hi] > times[lo] ? (time - times[lo]) / (times[hi] - times[lo]) : 0;
    return V.poseBetween(V.poseOfQuaternion(a.slice(3), a.slice(0, 3)), V.poseOfQuaternion(b.slice(3), b.slice(0, 3)), t);
  }
  return null;
}

// The terms of colours over time (Street Gaussians, Yan et al. 2024).
export function colourTerms(model, time) {
  if (!model.span) return [0, 0, 0, 0];
  const [begin, end] = model.span, u = end > begin ? Math.max(0, Math.min(1, (time - begin) / (end - begin))) : 0;
  return [Math.sin(2 * Math.PI * u), Math.cos(2 * Math.PI * u), Math.sin(4 * Math.PI * u), Math.cos(4 * Math.PI * u)];
}

// camera_from_model, for a camera at `pose` (world_from_camera) relative to the same origin as `model`.
export function viewOf(pose, model) {
  const eye = V.column(pose, 3), out = [];
  for (let i = 0; i < 3; i++) {
    const axis = V.column(pose, i);
    for (let k = 0; k < 3; k++) out.push(V.dot(axis, V.column(model, k)));
    out.push(V.dot(axis, V.sub(V.column(model, 3), eye)));
  }
  return out;
}
