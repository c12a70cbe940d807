// SPDX-License-Identifier: Apache-2.0
// A camera path made of cameras that were added one by one; saved as a file that `pags render --path` takes.
import * as V from './vector.js';

const FPS = 30;

// Catmull and Rom 1974, through b and c.
const curve = (a, b, c, d, t) =>
  b.map((_, i) => 0.5 * (2 * b[i] + t * (c[i] - a[i] + t * (2 * a[i] - 5 * b[i] + 4 * c[i] - d[i] + t * (3 * (b[i] - c[i]) + d[i] - a[i])))));

export class Recorder {
  constructor() {
    this.keys = []; // looks: {width, height, fx, fy, cx, cy, pose, time}
  }

  // The camera at `at`, from 0 at the first to keys.length - 1 at the last.
  at(at) {
    const keys = this.keys, last = keys.length - 1;
    const i = Math.max(0, Math.min(last - 1, Math.floor(at))), t = Math.max(0, Math.min(1, at - i));
    if (!last || t === 0) return keys[Math.min(i, last)];
    const [a, b, c, d] = [Math.max(i - 1, 0), i, i + 1, Math.min(i + 2, last)].map((k) => keys[k]);
    const eye = curve(...[a, b, c, d].map((key) => V.column(key.pose, 3)), t);
    const pose = V.move(V.poseBetween(b.pose, c.pose, t), [0, 0, 0]);
    [pose[3], pose[7], pose[11]] = eye;
    const time = b.time === null || c.time === null ? b.time : b.time + (c.time - b.time) * t;
    const f = b.fx / b.width + (c.fx / c.width - b.fx / b.width) * t;
    return {...keys[0], fx: f * keys[0].width, fy: (f * keys[0].width * b.fy) / b.fx, pose, time};
  }

  // The path as the text of a file.
  file(seconds) {
    const count = this.keys.length === 1 ? 1 : Math.round((this.keys.length - 1) * seconds * FPS) + 1;
    const frames = [];
    for (let i = 0; i < count; i++) {
      const {width, height, fx, fy, cx, cy, pose, time} = this.at(count > 1 ? (i * (this.keys.length - 1)) / (count - 1) : 0);
      const [w, x, y, z] = V.quaternion(pose);
      const eye = V.column(pose, 3);
      const frame = {width, height, fx, fy, cx, cy, camera_from_world_quaternion_wxyz: [w, -x, -y, -z],
        camera_from_world_translation: [0, 1, 2].map((c) => -V.dot(V.column(pose, c), eye))};
      frames.push(time === null ? frame : {...frame, time});
    }
    return JSON.stringify({fps: FPS, frames});
  }
}
