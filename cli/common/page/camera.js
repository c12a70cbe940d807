// SPDX-License-Identifier: Apache-2.0
// The camera of the page: orbiting a point, flying, along the drive, or exactly at a recorded one.
import * as V from './vector.js';

const MOST_PITCH = 1.55;

export class Camera {
  constructor(scene) {
    this.scene = scene;
    this.up = V.unit(scene.up);
    this.east = V.unit(V.cross(Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], this.up));
    this.north = V.cross(this.up, this.east);
    this.drive = driveOf(scene);
    this.reset();
  }

  reset() {
    const start = this.scene.start;
    this.lens = start;
    this.mode = this.drive.length ? 'drive' : 'orbit';
    this.distance = this.scene.distance;
    this.speed = Math.max(this.scene.distance, 0.1);
    this.shift = 0;
    this.turned = [0, 0];
    this.view = -1;
    this.free(start.pose);
  }

  // Takes over a pose, upright.
  free(pose) {
    const forward = V.unit(V.column(pose, 2));
    this.eye = V.column(pose, 3);
    this.pitch = Math.max(-MOST_PITCH, Math.min(MOST_PITCH, Math.asin(Math.max(-1, Math.min(1, V.dot(forward, this.up))))));
    this.yaw = Math.atan2(V.dot(forward, this.north), V.dot(forward, this.east));
    this.pivot = V.add(this.eye, V.scale(this.forward(), this.distance));
  }

  forward() {
    const flat = V.add(V.scale(this.east, Math.cos(this.yaw)), V.scale(this.north, Math.sin(this.yaw)));
    return V.add(V.scale(flat, Math.cos(this.pitch)), V.scale(this.up, Math.sin(this.pitch)));
  }

  setMode(mode, time) {
    if (mode === 'drive' && !this.drive.length) return;
    const pose = this.pose(time);
    this.view = -1;
    this.mode = mode;
    this.turned = [0, 0];
    this.lens = this.scene.start;
    this.free(pose);
  }

  // Looks from a recorded camera.
  setView(index) {
    this.view = index;
    this.lens = this.scene.views[index].camera;
  }

  // The pose at a time.
  pose(time) {
    if (this.view >= 0) return this.lens.pose;
    if (this.mode === 'drive') {
      let pose = along(this.drive, time);
      pose = V.turnPose(pose, this.up, this.turned[0]);
      pose = V.turnPose(pose, V.column(pose, 0), this.turned[1]);
      return V.move(pose, V.scale(V.column(along(this.drive, time), 0), this.shift));
    }
    return V.lookAlong(this.eye, this.forward(), this.up);
  }

  // The camera to render for a canvas of this size in pixels. A recorded frame fits inside; otherwise, if the aspect
  // ratios differ, the longer side shows more than the recorded frame and the shorter side less.
  look(width, height, time) {
    const lens = this.lens, pose = this.pose(time);
    const x = width / lens.width, y = height / lens.height, fit = this.view >= 0 ? Math.min(x, y) : Math.sqrt(x * y);
    if (this.view >= 0) {
      const w = Math.max(1, Math.round(lens.width * fit)), h = Math.max(1, Math.round(lens.height * fit));
      const sx = w / lens.width, sy = h / lens.height;
      return {width: w, height: h, fx: lens.fx * sx, fy: lens.fy * sy, cx: lens.cx * sx, cy: lens.cy * sy, pose, time: lens.time ?? time};
    }
    const cx = width / 2 + (lens.cx - lens.width / 2) * fit, cy = height / 2 + (lens.cy - lens.height / 2) * fit;
    return {width, height, fx: lens.fx * fit, fy: lens.fy * fit, cx, cy, pose, time};
  }

  // Leaves a recorded camera, before the user moves.
  leave(time) {
    if (this.view < 0) return;
    const pose = this.pose(time);
    this.view = -1;
    this.lens = this.scene.start;
    if (this.mode === 'drive') this.mode = 'fly';
    this.free(pose);
  }

  turn(dx, dy, time) {
    this.leave(time);
    if (this.mode === 'drive') {
      this.turned = [this.turned[0] - dx, Math.max(-1.4, Math.min(1.4, this.turned[1] - dy))];
      return;
    }
    this.yaw -= dx;
    this.pitch = Math.max(-MOST_PITCH, Math.min(MOST_PITCH, this.pitch - dy));
    if (this.mode === 'orbit') this.eye = V.sub(this.pivot, V.scale(this.forward(), this.distance));
    else this.pivot = V.add(this.eye, V.scale(this.forward(), this.distance));
  }

  // Pans by a number of pixels of a picture with this focal length, so that the pivot stays under the pointer.
  pan(dx, dy, focal, time) {
    this.leave(time);
    if (this.mode === 'drive') return;
    const pose = this.pose(time), k = this.distance / focal;
    const by = V.add(V.scale(V.column(pose, 0), -dx * k), V.scale(V.column(pose, 1), -dy * k));
    this.eye = V.add(this.eye, by);
    this.pivot = V.add(this.pivot, by);
  }

  zoom(factor, time) {
    this.leave(time);
    if (this.mode === 'fly') this.speed = Math.max(0.01, Math.min(1e4, this.speed / factor));
    if (this.mode !== 'orbit') return;
    this.distance = Math.max(1e-3, Math.min(1e6, this.distance * factor));
    this.eye = V.sub(this.pivot, V.scale(this.forward(), this.distance));
  }

  // Flies: `keys` are amounts forward, right and up.
  fly(keys, seconds, time) {
    this.leave(time);
    if (this.mode === 'drive') this.setMode('fly', time);
    const pose = this.pose(time), step = this.speed * seconds;
    const by = V.add(V.add(V.scale(V.column(pose, 2), keys[0] * step), V.scale(V.column(pose, 0), keys[1] * step)), V.scale(this.up, keys[2] * step));
    this.eye = V.add(this.eye, by);
    this.pivot = V.add(this.pivot, by);
  }

  // Orbits around a point from now on.
  focus(point, time, distance) {
    const pose = this.pose(time);
    this.view = -1;
    this.lens = this.scene.start;
    this.mode = 'orbit';
    this.free(pose);
    const away = V.sub(point, this.eye);
    this.distance = distance ?? Math.max(V.length(away), 1e-3);
    const forward = V.unit(away);
    this.pitch = Math.asin(Math.max(-1, Math.min(1, V.dot(forward, this.up))));
    this.yaw = Math.atan2(V.dot(forward, this.north), V.dot(forward, this.east));
    this.pivot = point;
    this.eye = V.sub(point, V.scale(this.forward(), this.distance));
  }
}

// The recorded cameras of the drive's sensor in order of time.
function driveOf(scene) {
  if (scene.driveSensor < 0) return [];
  const views = scene.views.filter((view) => view.sensor === scene.driveSensor && view.camera.time !== null);
  views.sort((a, b) => a.camera.time - b.camera.time);
  return views.map((view) => view.camera).filter((camera, i, all) => i === 0 || camera.time > all[i - 1].time);
}

// The pose along timed poses, [{time, pose}], at a time.
export function along(list, time) {
  let i = 0;
  while (i + 1 < list.length && list[i + 1].time <= time) i++;
  const a = list[i], b = list[Math.min(i + 1, list.length - 1)];
  if (b.time <= a.time || time <= a.time) return a.pose;
  return V.poseBetween(a.pose, b.pose, Math.min(1, (time - a.time) / (b.time - a.time)));
}
