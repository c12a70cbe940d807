// SPDX-License-Identifier: Apache-2.0
// Sorts Gaussians by depth, from far to near, in a worker.

// The worker's code as text: it uses nothing outside of itself. The first message is {models, places, radii}. Each
// later one has, for one look, the rows of camera_from_model of each model, its visibility, and the view frustum; the
// answer is the order of the visible Gaussians. A pick asks for the object along a ray (x, y, 1) of the last look.
function work() {
  let models, places, radii, solid, keys, low, order, counts, last;

  // Front to back, until less than half of the light gets through. A Gaussian counts as round, with its largest sigma.
  const pick = ({x, y, focal, serial}) => {
    const hits = [];
    models.forEach(({first, gaussians, object}, m) => {
      const v = last.views.subarray(12 * m, 12 * m + 12);
      for (let i = first; i < first + gaussians && last.drawn[m]; i++) {
        const a = places[3 * i], b = places[3 * i + 1], c = places[3 * i + 2], z = v[8] * a + v[9] * b + v[10] * c + v[11];
        if (!(z > last.near)) continue;
        const dx = v[0] * a + v[1] * b + v[2] * c + v[3] - x * z, dy = v[4] * a + v[5] * b + v[6] * c + v[7] - y * z;
        const far = (dx * dx + dy * dy) / (radii[i] * radii[i] + 0.3 * (z / focal) ** 2);
        if (far < 9) hits.push([z, solid[i] / 255 * Math.exp(-far / 2), object]);
      }
    });
    hits.sort((p, q) => p[0] - q[0]);
    let light = 1;
    const hit = hits.find(([, alpha]) => (light *= 1 - alpha) < 0.5);
    postMessage({pick: serial, hit: hit ? {depth: hit[0], object: hit[2]} : null});
  };

  onmessage = ({data}) => {
    if (data.pick) return pick(data.pick);
    if (data.models) {
      ({models, places, radii, solid} = data);
      keys = new Uint32Array(radii.length);
      low = new Uint32Array(radii.length);
      order = new Uint32Array(radii.length);
      counts = new Uint32Array(65536);
      return;
    }
    last = data;
    const depth = new Float32Array(keys.buffer), {near, x0, x1, y0, y1, slack, pixel} = data;
    const reach = 3.6; // sigmas at which an opaque Gaussian has fallen below any cut of alpha, with what the cut lifts
    let count = 0;
    models.forEach(({first, gaussians}, m) => {
      const v = data.views.subarray(12 * m, 12 * m + 12);
      if (!data.drawn[m]) return;
      for (let i = first; i < first + gaussians; i++) {
        const a = places[3 * i], b = places[3 * i + 1], c = places[3 * i + 2];
        const z = v[8] * a + v[9] * b + v[10] * c + v[11];
        if (!(z > near)) continue;
        const x = v[0] * a + v[1] * b + v[2] * c + v[3], y = v[4] * a + v[5] * b + v[6] * c + v[7];
        const room = reach * radii[i] * slack + 3 * pixel * z; // low-pass: 0.3 px^2
        if (x < x0 * z - room || x > x1 * z + room || y < y0 * z - room || y > y1 * z + room) continue;
        depth[count] = z;
        low[count++] = i;
      }
    });
    // Bits of positive floats ascend as the floats do: two passes of 16 bits, each from the largest down.
    const tmp = new Uint32Array(count);
    const pass = (shift, from, to, key) => {
      counts.fill(0);
      for (let i = 0; i < count; i++) counts[key(from, i) >>> shift & 0xffff]++;
      for (let i = 65535, at = 0; i >= 0; i--) { const n = counts[i]; counts[i] = at; at += n; }
      for (let i = 0; i < count; i++) to[counts[key(from, i) >>> shift & 0xffff]++] = from[i];
    };
    for (let i = 0; i < count; i++) order[i] = i;
    pass(0, order, tmp, (from, i) => keys[from[i]]);
    pass(16, tmp, order, (from, i) => keys[from[i]]);
    const out = new Uint32Array(count);
    for (let i = 0; i < count; i++) out[i] = low[order[i]];
    postMessage({serial: data.serial, order: out}, [out.buffer]);
  };
}

export class Sorter {
  constructor(data, onOrder, onError) {
    const address = URL.createObjectURL(new Blob([`(${work})()`], {type: 'text/javascript'}));
    this.worker = new Worker(address);
    URL.revokeObjectURL(address);
    this.worker.onerror = () => onError('This browser runs no workers in local pages, which the player needs. Use another browser.');
    this.busy = false;
    this.picks = new Map();
    this.worker.onmessage = ({data: answer}) => {
      if (answer.pick) {
        this.picks.get(answer.pick)(answer.hit);
        return void this.picks.delete(answer.pick);
      }
      this.busy = false;
      onOrder(answer);
    };
    const count = data.header.gaussians, places = new Float32Array(3 * count);
    for (let i = 0; i < count; i++) for (let k = 0; k < 3; k++) places[3 * i + k] = data.places[8 * i + k];
    const models = data.header.models.map(({first, gaussians, object}) => ({first, gaussians, object}));
    this.worker.postMessage({models, places, radii: data.radii, solid: data.solid}, [places.buffer, data.radii.buffer, data.solid.buffer]);
  }

  // Object along the ray (x, y, 1) of the last look, for a picture with this focal length: {depth, object} or null.
  pick(x, y, focal) {
    const serial = this.picked = (this.picked ?? 0) + 1;
    this.worker.postMessage({pick: {x, y, focal, serial}});
    return new Promise((done) => this.picks.set(serial, done));
  }

  // Requests the order for a look unless a request is pending; returns whether it did.
  ask(message) {
    if (this.busy) return false;
    this.busy = true;
    this.worker.postMessage(message);
    return true;
  }
}
