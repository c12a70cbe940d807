// SPDX-License-Identifier: Apache-2.0
// A recorded camera's photograph drawn over the left part of its picture, so that the two can be compared at a line.
export class Wipe {
  constructor() {
    this.share = 0; // of the width that shows the photograph
    this.view = -1; // whose photograph is here
    this.serial = -1; // of the look that asks for it
    this.photograph = document.createElement('canvas');
  }

  // Whether a look from a recorded camera must bring its photograph first.
  lacks(view, channel) {
    return this.share > 0 && view >= 0 && channel === 'color' && this.view !== view;
  }

  // Takes the photograph of the look that asked for it.
  take(bitmap, view) {
    [this.photograph.width, this.photograph.height] = [bitmap.width, bitmap.height];
    this.photograph.getContext('2d').drawImage(bitmap, 0, 0);
    this.view = view;
  }

  draw(canvas, view, channel) {
    if (!(this.share > 0) || view < 0 || view !== this.view || channel !== 'color') return;
    const from = this.photograph, c = canvas.getContext('2d'), edge = Math.round(this.share * canvas.width);
    c.drawImage(from, 0, 0, (from.width * edge) / canvas.width, from.height, 0, 0, edge, canvas.height);
    c.fillStyle = '#e8b34a';
    if (edge < canvas.width) c.fillRect(edge, 0, 2, canvas.height);
  }
}
