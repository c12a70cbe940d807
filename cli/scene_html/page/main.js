// SPDX-License-Identifier: Apache-2.0
// The page of scene.html: reads what is in the file, draws it, and answers to mouse, touch and keyboard.
import * as V from './vector.js';
import {Camera} from './camera.js';
import {listen, listenToPanel} from './controls.js';
import {readPage, unpack} from './unpack.js';
import {Drawing, limitsOf} from './drawing.js';
import {Sorter} from './sorter.js';
import {modelPose, colourTerms, viewOf} from './motion.js';

const $ = (id) => document.getElementById(id);
const SCALES = [1, 0.71, 0.5, 0.35], SLOW = 45, QUICK = 20; // of the picture's side while it moves; milliseconds that a picture takes
const MOST_PIXELS = 2560 * 1440, REST = 250; // of a picture; milliseconds without a movement until it is sharp
const NOTHING = new Array(12).fill(0);

function notice(text, error) {
  $('notice').textContent = text;
  $('notice').hidden = !text;
  $('notice').classList.toggle('error', Boolean(error));
}

function element(name, properties, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

const number = (value) => (value >= 1e6 ? `${(value / 1e6).toFixed(2)} M` : value >= 1e4 ? `${(value / 1e3).toFixed(0)} k` : String(value));

class Player {
  constructor(data) {
    const {header} = data;
    this.header = header;
    this.scene = header.scene;
    this.camera = new Camera(this.scene);
    this.state = {time: this.scene.start.time ?? this.scene.time[0], playing: false, hidden: new Set(), solo: -1, chosen: -1};
    this.spans = this.scene.time[1] > this.scene.time[0];
    this.serial = 0; // of the look that was asked for last
    this.sorted = this.shown = 0; // that of the order, and of the last picture that is sharp
    this.changed = true;
    this.asking = this.dirty = false;
    this.moved = -1e9;
    this.coarse = 0;
    this.pace = 30;
    this.drawn = 0; // when the picture was begun that the device is at
    this.whole = true; // it is one at rest
    this.waiting = []; // called with the sharp picture of what is looked at
    this.fixed = null; // a look in place of the camera's
    this.sorter = new Sorter(data, ({serial, order}) => {
      this.sorted = serial;
      this.drawing.setOrder(order);
      this.dirty = true;
    }, (text) => notice(text, true));
    this.drawing = new Drawing($('picture'), data);
    $('picture').addEventListener('webglcontextlost', () => notice('The graphics of this device lost the scene. Reload the page.', true));
    this.controls = listen($('stage'), {
      camera: this.camera, commands: this.commands(), pick: (x, y) => this.pick(x, y), focusAt: (x, y) => this.focusAt(x, y),
      change: () => this.change(), time: () => this.state.time, focal: () => (this.look ? this.look.fx * this.frame.scale : 500)
    });
    this.fill();
    this.before = performance.now();
    requestAnimationFrame((now) => this.turn(now));
  }

  // ---- Pictures ----
  size() {
    const box = $('stage').getBoundingClientRect();
    const ratio = Math.min(window.devicePixelRatio, Math.sqrt(MOST_PIXELS / Math.max(1, box.width * box.height)));
    return [Math.max(16, Math.round(box.width * ratio)), Math.max(16, Math.round(box.height * ratio))];
  }

  // Position of the picture on the stage: a recorded camera keeps its aspect ratio.
  place() {
    const {look} = this, box = $('stage').getBoundingClientRect(), scale = Math.min(box.width / look.width, box.height / look.height);
    this.frame = {scale, x: (box.width - look.width * scale) / 2, y: (box.height - look.height * scale) / 2};
    Object.assign($('picture').style, {left: `${this.frame.x}px`, top: `${this.frame.y}px`, width: `${look.width * scale}px`, height: `${look.height * scale}px`});
  }

  change() {
    this.fixed = null;
    this.changed = true;
    this.moved = performance.now();
  }

  isShown(object) {
    return this.state.solo >= 0 ? object === this.state.solo : !this.state.hidden.has(object);
  }

  // Prepares the current look: the pose of each model in front of its camera.
  see() {
    const {header, scene, state} = this;
    this.look = this.fixed ?? this.camera.look(...this.size(), state.time);
    this.serial++;
    const {pose} = this.look, time = (this.look.time ?? state.time) - scene.time[0];
    const local = V.poseOf(V.column(pose, 0), V.column(pose, 1), V.column(pose, 2), V.sub(V.column(pose, 3), header.origin));
    this.poses = header.models.map((model) => {
      const place = this.isShown(model.object) ? modelPose(model, time) : null;
      return [place ? viewOf(local, place) : NOTHING, colourTerms(model, time)];
    });
    this.changed = false;
    this.asking = this.dirty = true;
    $('picture').dataset.asked = this.serial;
    this.place();
    $('time').value = state.time;
    $('clock').value = `${(state.time - scene.time[0]).toFixed(2)} s`;
    for (const button of document.querySelectorAll('[data-mode]')) button.setAttribute('aria-checked', String(this.camera.view < 0 && this.camera.mode === button.dataset.mode));
    $('views').value = String(this.camera.view);
  }

  ask() {
    const {look, header} = this, limits = limitsOf(look), pixel = 1 / Math.min(look.fx, look.fy);
    const views = new Float32Array(12 * header.models.length), drawn = new Uint8Array(header.models.length);
    this.poses.forEach(([view], m) => {
      views.set(view, 12 * m);
      drawn[m] = Number(view !== NOTHING);
    });
    const widest = Math.max(...Object.values(limits).map(Math.abs));
    this.asking = !this.sorter.ask({
      serial: this.serial, views, drawn, near: header.near, pixel, slack: Math.hypot(1, widest),
      x0: -look.cx / look.fx, x1: (look.width - look.cx) / look.fx, y0: -look.cy / look.fy, y1: (look.height - look.cy) / look.fy
    });
  }

  draw(now) {
    const moving = now - this.moved < REST || this.state.playing, scale = moving && !this.waiting.length ? SCALES[this.coarse] : 1;
    this.drawing.draw(this.look, this.poses, scale);
    this.dirty = false;
    this.drawn = now;
    this.whole = scale === 1 && !moving;
    const sharp = scale === 1 && this.sorted === this.serial && !this.changed;
    Object.assign($('picture').dataset, {serial: this.serial, sharp, count: Number($('picture').dataset.count ?? 0) + 1});
    $('stats').textContent = `${this.look.width}x${this.look.height}${scale < 1 ? `, moving, at ${Math.round(100 * scale)} %` : ''}\n` +
      `${number(this.drawing.count)} of ${number(this.header.gaussians)} Gaussians in view`;
    if (sharp) {
      this.shown = this.serial;
      for (const done of this.waiting.splice(0)) done($('picture')); // in the same turn, while the canvas still has its pixels
    }
  }

  // Records the time of a picture: pictures of a moving camera get coarser if it is long.
  adapt(took) {
    this.drawn = 0;
    if (this.whole) return; // a sharp one says nothing of the coarse ones
    this.pace = 0.7 * this.pace + 0.3 * took;
    if (this.pace > SLOW && this.coarse + 1 < SCALES.length) [this.coarse, this.pace] = [this.coarse + 1, 30];
    else if (this.pace < QUICK && this.coarse > 0) [this.coarse, this.pace] = [this.coarse - 1, 30];
  }

  // ---- One turn of the page ----
  turn(now) {
    const seconds = Math.min(0.2, (now - this.before) / 1000), {state, scene, camera} = this;
    const busy = this.drawing.busy();
    if (this.drawn && !busy) this.adapt(now - this.drawn);
    this.before = now;
    if (state.playing) {
      state.time += seconds * Number($('speed').value);
      if (state.time > scene.time[1]) state.time = scene.time[0];
      if (camera.view >= 0) camera.leave(state.time);
      this.change();
    }
    const keys = this.controls.flying();
    if (keys) {
      camera.fly(keys, seconds, state.time);
      this.change();
    }
    if (this.changed) this.see();
    if (this.asking) this.ask();
    const rests = this.shown !== this.serial && now - this.moved >= REST && this.sorted === this.serial; // not sharp yet
    if ((this.dirty || rests) && !busy) this.draw(now);
    requestAnimationFrame((next) => this.turn(next));
  }

  // ---- Modes and time ----
  setMode(mode) {
    this.camera.setMode(mode, this.state.time);
    this.change();
  }

  setTime(time) {
    const {scene, camera} = this;
    this.state.time = Math.max(scene.time[0], Math.min(scene.time[1], time));
    if (camera.view >= 0 && scene.views[camera.view].camera.time !== null) camera.leave(this.state.time);
    this.change();
  }

  setPlaying(playing) {
    this.state.playing = playing && this.spans;
    $('play').textContent = this.state.playing ? 'Stop' : 'Play';
    this.change();
  }

  setView(index) {
    this.camera.setView(index);
    this.state.time = this.scene.views[index].camera.time ?? this.state.time;
    this.setPlaying(false);
  }

  // The recorded camera nearest to where and when the page looks.
  nearestView() {
    const {scene, state} = this, pose = this.camera.pose(state.time);
    const far = ({camera}) => V.length(V.sub(V.column(camera.pose, 3), V.column(pose, 3))) + 5 * (1 - V.dot(V.column(camera.pose, 2), V.column(pose, 2))) +
      20 * Math.abs((camera.time ?? state.time) - state.time);
    return scene.views.reduce((best, view, i) => (far(view) < far(scene.views[best]) ? i : best), 0);
  }

  // ---- Picking, objects ----
  async find(x, y) {
    const {look, frame} = this;
    const ray = [((x - frame.x) / frame.scale - look.cx) / look.fx, ((y - frame.y) / frame.scale - look.cy) / look.fy];
    const hit = await this.sorter.pick(...ray, look.fx);
    return hit && {...hit, point: V.toWorld(look.pose, [ray[0] * hit.depth, ray[1] * hit.depth, hit.depth])};
  }

  async pick(x, y) {
    const hit = await this.find(x, y);
    this.choose(hit ? hit.object : -1);
    const object = hit && this.scene.objects[hit.object];
    $('picked').textContent = !hit ? 'Nothing.' : (object ? `${object.id}, ${object.class}${object.critical ? ', critical' : ''}\n${object.size.map((v) => v.toFixed(2)).join(' x ')} m\n` : 'Background\n') +
      `about ${hit.depth.toFixed(1)} m deep, at ${hit.point.map((v) => v.toFixed(1)).join(', ')}`;
  }

  async focusAt(x, y) {
    const hit = await this.find(x, y);
    if (!hit) return;
    this.camera.focus(hit.point, this.state.time);
    this.change();
  }

  choose(index) {
    this.state.chosen = index;
    for (const row of $('objects').rows) row.classList.toggle('chosen', Number(row.dataset.index) === index);
  }

  focusObject(index) {
    const {scene, camera, state} = this, object = scene.objects[index], {track} = object;
    if (!track.length) return;
    if (object.tracked && (state.time < track[0][0] || state.time > track[track.length - 1][0])) this.setTime(track[0][0]);
    const near = track.reduce((best, row) => (Math.abs(row[0] - state.time) < Math.abs(best[0] - state.time) ? row : best));
    camera.focus(V.column(near.slice(1), 3), state.time, 2.5 * V.length(object.size));
    if (V.dot(camera.forward(), camera.up) > -0.2) camera.turn(0, camera.pitch + 0.3, state.time);
    this.change();
  }

  hide(index, hidden) {
    if (hidden) this.state.hidden.add(index);
    else this.state.hidden.delete(index);
    this.refreshObjects();
  }

  isolate(index) {
    this.state.solo = this.state.solo === index ? -1 : index;
    this.refreshObjects();
  }

  showAll() {
    this.state.hidden.clear();
    this.state.solo = -1;
    this.refreshObjects();
  }

  refreshObjects() {
    for (const row of $('objects').rows) {
      const index = Number(row.dataset.index);
      row.querySelector('input').checked = !this.state.hidden.has(index);
      row.querySelector('.solo').setAttribute('aria-pressed', String(this.state.solo === index));
    }
    this.changed = true;
  }

  save() {
    this.waiting.push((canvas) => canvas.toBlob((blob) => {
      const address = URL.createObjectURL(blob);
      element('a', {href: address, download: `${this.scene.name}.png`}).click();
      setTimeout(() => URL.revokeObjectURL(address), 1000);
    }, 'image/png'));
    this.changed = true;
  }

  // The sharp picture of a look ({width, height, fx, fy, cx, cy, pose, time}; pose: 12 numbers, world from camera) as a data URL, for programs.
  picture(look) {
    return new Promise((done) => {
      this.waiting.push((canvas) => done(canvas.toDataURL('image/png')));
      this.fixed = look;
      this.changed = true;
    });
  }

  // ---- Controls ----
  commands() {
    const {scene, state, camera} = this;
    return {
      mode: (mode) => this.setMode(mode), play: () => this.setPlaying(!state.playing), save: () => this.save(), showAll: () => this.showAll(),
      step: (by) => this.setTime(state.time + by * (scene.fps > 0 ? 1 / scene.fps : 0.1)),
      view: (by) => scene.views.length && this.setView(camera.view < 0 ? this.nearestView() : (camera.view + by + scene.views.length) % scene.views.length),
      panel: () => $('panel-toggle').click(), help: () => $('help-toggle').click(),
      hide: () => state.chosen >= 0 && this.hide(state.chosen, !state.hidden.has(state.chosen)), isolate: () => state.chosen >= 0 && this.isolate(state.chosen),
      focus: () => (state.chosen >= 0 ? this.focusObject(state.chosen) : this.focusAt($('stage').clientWidth / 2, $('stage').clientHeight / 2)),
      reset: () => { camera.reset(); state.time = scene.start.time ?? scene.time[0]; this.showAll(); this.change(); }
    };
  }

  listObjects() {
    this.scene.objects.forEach((object, index) => {
      if (!object.gaussians) return; // nothing to show or hide
      const box = element('input', {type: 'checkbox', checked: true, onchange: () => this.hide(index, !box.checked)});
      const label = element('button', {className: 'label', textContent: `${object.id} ${object.class}`, onclick: () => (this.choose(index), this.focusObject(index))});
      const solo = element('button', {className: 'solo', textContent: 'solo', onclick: () => this.isolate(index)});
      box.setAttribute('aria-label', `show ${object.id}`);
      const row = element('tr', {className: object.critical ? 'critical' : ''}, element('td', {}, box), element('td', {}, label),
        element('td', {className: 'number', textContent: number(object.gaussians)}), element('td', {}, solo));
      row.dataset.index = index;
      $('objects').append(row);
    });
  }

  fill() {
    const {scene, header, camera} = this;
    $('name').textContent = document.title = scene.name;
    $('facts').textContent = `${number(header.gaussians)} Gaussians, ${scene.views.length} cameras, ${scene.objects.length} objects. PAGS ${scene.version}`;
    [$('time').min, $('time').max] = scene.time;
    $('time-group').hidden = !this.spans;
    document.querySelector('[data-mode=drive]').hidden = $('drive-section').hidden = !camera.drive.length;
    $('objects-section').hidden = !scene.objects.length;
    $('views-section').hidden = !scene.views.length;
    $('views').append(element('option', {value: '-1', textContent: 'none'}), ...scene.views.map((view, i) => element('option', {value: String(i), textContent: view.name + (view.test ? ' (held out)' : '')})));
    $('views').onchange = () => (Number($('views').value) >= 0 ? this.setView(Number($('views').value)) : (camera.leave(this.state.time), this.change()));
    for (const button of document.querySelectorAll('[data-mode]')) button.onclick = () => this.setMode(button.dataset.mode);
    $('play').onclick = () => this.setPlaying(!this.state.playing);
    $('save').onclick = () => this.save();
    $('show-all').onclick = () => this.showAll();
    $('time').oninput = () => this.setTime(Number($('time').value));
    $('shift').oninput = () => {
      camera.shift = Number($('shift').value);
      $('shift-value').value = `${camera.shift.toFixed(1)} m`;
      if (camera.mode !== 'drive' || camera.view >= 0) this.setMode('drive');
      this.change();
    };
    listenToPanel(() => { this.changed = true; });
    this.listObjects();
    $('stage').focus();
  }
}

async function main() {
  const soon = () => new Promise((done) => setTimeout(done, 0)); // so that the page can show how far it is
  const bytes = await readPage((share) => (notice(`Loading ... ${Math.round(100 * share)} %`), soon()));
  const player = new Player(unpack(bytes));
  window.pags = {picture: (look) => player.picture(look), scene: player.scene};
  notice('');
}

main().catch((error) => notice(error.message, true));
