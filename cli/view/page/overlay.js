// SPDX-License-Identifier: Apache-2.0
// Drawn over the picture: boxes and tracks of objects, recorded cameras, measured points.
import * as V from './vector.js';
import {along} from './camera.js';

const COLORS = {vehicle: '#6cc3ff', pedestrian: '#ffd166', cyclist: '#8be28b', other: '#c9c9c9'};
const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
const NEAR = 0.05;

// An object's pose at a time; null where it isn't there: more than half a second from its track.
export function objectPose(object, time) {
  const track = object.timed ??= object.track.map((row) => ({time: row[0], pose: row.slice(1)}));
  if (!track.length) return null;
  const t = time ?? track[0].time;
  if (t < track[0].time - 0.5 || t > track[track.length - 1].time + 0.5) return null;
  return along(track, t);
}

export class Overlay {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
  }

  // `frame`: position of the picture on the stage, {x, y, scale}, in CSS pixels per pixel of the look.
  draw(scene, look, frame, show) {
    const ratio = window.devicePixelRatio, box = this.canvas.getBoundingClientRect();
    const width = Math.round(box.width * ratio), height = Math.round(box.height * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    const c = this.context;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, box.width, box.height);
    this.look = look;
    this.frame = frame;
    scene.objects.forEach((object, index) => {
      if (show.tracks && object.track.length > 1) this.path(object.track.map((row) => [row[4], row[8], row[12]]), COLORS[object.category], 1);
      const chosen = index === show.chosen;
      if (!show.boxes && !chosen) return;
      const pose = objectPose(object, look.time);
      if (pose) this.box(pose, object, chosen);
    });
    if (show.cameras) scene.views.forEach((view, index) => index !== show.view && this.camera(view));
    if (show.keys?.length > 1) this.path(show.keys.map((key) => V.column(key.pose, 3)), '#ff7ad9', 2);
    this.measured(show.points);
  }

  // A point of the world on the stage, from its coordinates in the camera.
  project(p) {
    const {look, frame} = this;
    return [frame.x + frame.scale * (look.cx + look.fx * p[0] / p[2]), frame.y + frame.scale * (look.cy + look.fy * p[1] / p[2])];
  }

  // A line between two points of the world, cut where it comes behind the camera.
  line(a, b) {
    let p = V.toLocal(this.look.pose, a), q = V.toLocal(this.look.pose, b);
    if (p[2] < NEAR && q[2] < NEAR) return;
    if (p[2] < NEAR) p = V.mix(p, q, (NEAR - p[2]) / (q[2] - p[2]));
    else if (q[2] < NEAR) q = V.mix(q, p, (NEAR - q[2]) / (p[2] - q[2]));
    this.context.moveTo(...this.project(p));
    this.context.lineTo(...this.project(q));
  }

  path(points, color, width) {
    this.context.beginPath();
    for (let i = 1; i < points.length; i++) this.line(points[i - 1], points[i]);
    this.stroke(color, width);
  }

  stroke(color, width) {
    this.context.strokeStyle = color;
    this.context.lineWidth = width;
    this.context.stroke();
  }

  box(pose, object, chosen) {
    const half = object.size.map((v) => v / 2);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => V.toWorld(pose, [i & 1 ? half[0] : -half[0], i & 2 ? half[1] : -half[1], i & 4 ? half[2] : -half[2]]));
    this.context.beginPath();
    for (const [a, b] of EDGES) this.line(corners[a], corners[b]);
    this.line(V.toWorld(pose, [0, 0, 0]), V.toWorld(pose, [half[0], 0, 0])); // forward
    this.stroke(COLORS[object.category], chosen ? 2.5 : 1.2);
  }

  camera(view) {
    const {width, height, fx, fy, cx, cy, pose} = view.camera, z = 0.4;
    const eye = V.column(pose, 3);
    const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([x, y]) => V.toWorld(pose, [(x - cx) / fx * z, (y - cy) / fy * z, z]));
    this.context.beginPath();
    corners.forEach((corner, i) => {
      this.line(eye, corner);
      this.line(corner, corners[(i + 1) % 4]);
    });
    this.stroke(view.test ? '#ff9f6b' : '#9fb0c0', 1);
  }

  measured(points) {
    const c = this.context;
    if (points.length === 2) this.path(points, '#ffffff', 2);
    for (const point of points) {
      const p = V.toLocal(this.look.pose, point);
      if (p[2] < NEAR) continue;
      const [x, y] = this.project(p);
      c.beginPath();
      c.arc(x, y, 4, 0, 7);
      c.fillStyle = '#e8b34a';
      c.fill();
      this.stroke('#1b1500', 1);
    }
    if (points.length < 2) return;
    const p = V.toLocal(this.look.pose, V.mix(points[0], points[1], 0.5));
    if (p[2] < NEAR) return;
    const [x, y] = this.project(p), text = `${V.length(V.sub(points[0], points[1])).toFixed(2)} m`;
    c.font = '600 15px system-ui, sans-serif';
    c.lineWidth = 4;
    c.strokeStyle = '#000c';
    c.strokeText(text, x + 8, y - 8);
    c.fillStyle = '#fff';
    c.fillText(text, x + 8, y - 8);
  }
}
