// SPDX-License-Identifier: Apache-2.0
// Vectors of three, and poses: 12 numbers, row by row [R|t], world from camera, with x right, y down and z forward.
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const unit = (a) => scale(a, 1 / (length(a) || 1));
export const mix = (a, b, t) => a.map((v, i) => v + (b[i] - v) * t);

export const column = (pose, c) => [pose[c], pose[4 + c], pose[8 + c]];
export const poseOf = (right, down, forward, eye) =>
  [0, 1, 2].flatMap((i) => [right[i], down[i], forward[i], eye[i]]);
export const move = (pose, by) => poseOf(column(pose, 0), column(pose, 1), column(pose, 2), add(column(pose, 3), by));

// A point of the world as the pose's own coordinates, and the other way.
export function toLocal(pose, point) {
  const d = sub(point, column(pose, 3));
  return [dot(column(pose, 0), d), dot(column(pose, 1), d), dot(column(pose, 2), d)];
}
export const toWorld = (pose, p) =>
  add(column(pose, 3), add(scale(column(pose, 0), p[0]), add(scale(column(pose, 1), p[1]), scale(column(pose, 2), p[2]))));

// An upright pose that looks along `forward`.
export function lookAlong(eye, forward, up) {
  const right = unit(cross(forward, up));
  return poseOf(right, cross(forward, right), forward, eye);
}

// Turns a vector about a unit axis (Rodrigues).
export function turn(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}
export const turnPose = (pose, axis, angle) =>
  poseOf(turn(column(pose, 0), axis, angle), turn(column(pose, 1), axis, angle), turn(column(pose, 2), axis, angle), column(pose, 3));

// The quaternion (w, x, y, z) of a pose's rotation, by the largest of its components (Shepperd 1978), and back.
export function quaternion(m) {
  const [a, b, c] = [m[0], m[5], m[10]];
  const q = [1 + a + b + c, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c];
  const k = q.indexOf(Math.max(...q));
  const d = [m[9] - m[6], m[2] - m[8], m[4] - m[1]], s = [m[4] + m[1], m[2] + m[8], m[9] + m[6]];
  const rows = [[q[0], d[0], d[1], d[2]], [d[0], q[1], s[0], s[1]], [d[1], s[0], q[2], s[2]], [d[2], s[1], s[2], q[3]]];
  const size = Math.hypot(...rows[k]);
  return rows[k].map((v) => v / size);
}
export function poseOfQuaternion(q, eye) {
  const [w, x, y, z] = q.map((v) => v / Math.hypot(...q));
  return [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), eye[0],
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), eye[1],
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), eye[2]];
}

// Between two poses: places straight, rotations along the shorter arc.
export function poseBetween(a, b, t) {
  const p = quaternion(a), q = quaternion(b);
  const sign = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] < 0 ? -1 : 1;
  return poseOfQuaternion(p.map((v, i) => v + (sign * q[i] - v) * t), mix(column(a, 3), column(b, 3), t));
}
