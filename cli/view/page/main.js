// SPDX-License-Identifier: Apache-2.0
// The page of pags view: what the user does becomes looks, pictures are shown as they come.
import * as V from './vector.js';
import {Camera} from './camera.js';
import {Link} from './link.js';
import {Overlay, objectPose} from './overlay.js';
import {Recorder} from './recorder.js';
import {Run} from './run.js';
import {Wipe} from './wipe.js';
import {listen, listenToPanel} from './controls.js';

const $ = (id) => document.getElementById(id);
const MOST_PIXELS = 1600; // of a picture's width: more is scaled up

let noticeTimer = 0;
history.replaceState(null, '', location.pathname); // the token is in a cookie now
let answer = await fetch('scene.json');
while (answer.status === 503) { // a run that hasn't done its first step
  notice(await answer.text(), true);
  await new Promise((done) => setTimeout(done, 500));
  answer = await fetch('scene.json');
}
notice(answer.ok ? '' : await answer.text(), true);
const scene = await answer.json();

const state = {
  time: scene.start.time ?? scene.time[0], playing: false, channel: 'color', solo: -1, hidden: new Set(), chosen: -1, full: false, earlyZ: true,
  measuring: false, points: [], boxes: false, tracks: false, cameras: false, changed: true, preview: null, rate: 0
};
const camera = new Camera(scene), recorder = new Recorder(), overlay = new Overlay($('overlay')), wipe = new Wipe();
const link = new Link({
  onLook: (serial) => { $('picture').dataset.asked = serial; },
  onPicture: show,
  onAnswer: (message) => {
    notice(message.text);
    if (message.serial === wipe.serial) setWipe(0); // there is no photograph
  },
  onState: (open, reason, over) => {
    notice(open ? '' : reason || 'No connection to pags; retrying ...', true);
    if (over) run?.end(reason);
  }
});
const run = scene.live ? new Run(link, scene, setView) : null;
let frame = {x: 0, y: 0, scale: 1}, look = null, lastPicture = 0;

function notice(text, stays) {
  clearTimeout(noticeTimer);
  $('notice').textContent = text;
  $('notice').hidden = !text;
  if (text && !stays) noticeTimer = setTimeout(() => notice(''), 6000);
}

// ---- Pictures ----
function size() {
  const box = $('stage').getBoundingClientRect();
  const ratio = Math.min(window.devicePixelRatio, MOST_PIXELS / box.width, MOST_PIXELS / box.height);
  return [Math.max(16, Math.round(box.width * ratio)), Math.max(16, Math.round(box.height * ratio))];
}

// Position of a picture of the look on the stage.
function place() {
  const box = $('stage').getBoundingClientRect();
  const scale = Math.min(box.width / look.width, box.height / look.height);
  frame = {scale, x: (box.width - look.width * scale) / 2, y: (box.height - look.height * scale) / 2};
  Object.assign($('picture').style, {left: `${frame.x}px`, top: `${frame.y}px`, width: `${look.width * scale}px`, height: `${look.height * scale}px`});
}

const number = (value) => (value >= 1e6 ? `${(value / 1e6).toFixed(2)} M` : value >= 1e4 ? `${(value / 1e3).toFixed(0)} k` : String(value));

function show(bitmap, facts) {
  const canvas = $('picture'), now = performance.now();
  if (facts.serial === wipe.serial) {
    wipe.take(bitmap, camera.view);
    state.changed = true;
    return;
  }
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  canvas.getContext('2d').drawImage(bitmap, 0, 0);
  wipe.draw(canvas, camera.view, state.channel);
  Object.assign(canvas.dataset, {serial: facts.serial, sharp: facts.sharp, latency: facts.latency.toFixed(1), count: Number(canvas.dataset.count ?? 0) + 1});
  if (!facts.sharp) state.rate = 0.8 * state.rate + 0.2 * (1000 / Math.max(now - lastPicture, 1));
  lastPicture = now;
  $('stats').textContent = `${facts.width}x${facts.height} ${facts.sharp ? 'sharp' : `moving, step ${facts.step} of 11`}\n` +
    `${facts.drawMs.toFixed(1)} ms drawn${facts.sharp ? '' : `, ${facts.latency.toFixed(0)} ms to here, ${state.rate.toFixed(0)} a second`}, ${(facts.bytes / 1024).toFixed(0)} kB\n` +
    `${number(facts.inView)} of ${number(facts.gaussians)} Gaussians in view\n${number(facts.inView - facts.loaded + facts.hidden)} hidden, ${number(facts.shaded)} shaded`;
  $('psnr').textContent = facts.psnr === null ? '' : `PSNR ${facts.psnr.toFixed(2)} dB`;
}

// ---- One turn of the page ----
const spans = scene.time[1] > scene.time[0];
let before = performance.now();
function turn(now) {
  const seconds = Math.min(0.2, (now - before) / 1000);
  before = now;
  if (state.playing && spans) {
    state.time += seconds * Number($('speed').value);
    if (state.time > scene.time[1]) state.time = scene.time[0];
    if (camera.view >= 0) camera.leave(state.time);
    state.changed = true;
  }
  if (state.preview !== null) {
    state.preview += seconds / Number($('key-seconds').value);
    if (state.preview > recorder.keys.length - 1) state.preview = null;
    state.changed = true;
  }
  const keys = controls.flying();
  if (keys) {
    camera.fly(keys, seconds, state.time);
    change();
  }
  if (state.changed) send();
  requestAnimationFrame(turn);
}

// A manual change ends the preview of the path.
function change() {
  state.preview = null;
  state.changed = true;
}

function send() {
  state.changed = false;
  const photograph = state.channel === 'photograph' || state.channel === 'difference';
  if (photograph && camera.view < 0) setChannel('color');
  look = state.preview === null ? camera.look(...size(), scene.time[0] === scene.time[1] && !spans ? null : state.time) : recorder.at(state.preview);
  const {width, height, fx, fy, cx, cy, pose, time} = look;
  const lacking = wipe.lacks(camera.view, state.channel);
  const asked = {camera: {width, height, fx, fy, cx, cy, pose}, channel: lacking ? 'photograph' : state.channel, view: camera.view, solo: state.solo, hidden: [...state.hidden].slice(0, 1024), full: state.full, earlyZ: state.earlyZ};
  if (time !== null) asked.camera.time = time;
  link.look(asked);
  if (lacking) wipe.serial = link.serial;
  place();
  drawOverlay();
  $('time').value = state.time;
  $('clock').value = `${(state.time - scene.time[0]).toFixed(2)} s`;
  for (const button of document.querySelectorAll('[data-mode]')) button.setAttribute('aria-checked', String(camera.view < 0 && camera.mode === button.dataset.mode));
  $('views').value = String(camera.view);
}

function drawOverlay() {
  if (look) overlay.draw(scene, look, frame, {...state, view: camera.view, keys: recorder.keys});
}

// ---- Channels, modes, time ----
function setChannel(name) {
  if ((name === 'photograph' || name === 'difference') && camera.view < 0) {
    if (!scene.views.length) return notice('The scene has no recorded cameras to compare with.');
    setView(nearestView());
  }
  state.channel = name;
  $('channel').value = name;
  state.changed = true;
}

function setWipe(share) {
  wipe.share = Number(share);
  $('wipe').value = wipe.share;
  if (wipe.share > 0 && camera.view < 0 && scene.views.length) setView(nearestView());
  if (wipe.share > 0 && state.channel !== 'color') setChannel('color');
  state.changed = true;
}

function setMode(mode) {
  camera.setMode(mode, state.time);
  if (state.channel === 'photograph' || state.channel === 'difference') setChannel('color');
  change();
}

function setTime(time) {
  state.time = Math.max(scene.time[0], Math.min(scene.time[1], time));
  if (camera.view >= 0 && scene.views[camera.view].camera.time !== null) camera.leave(state.time);
  change();
}

function setPlaying(playing) {
  state.playing = playing && spans;
  $('play').textContent = state.playing ? 'Stop' : 'Play';
}

function setView(index) {
  camera.setView(index);
  state.time = scene.views[index].camera.time ?? state.time;
  setPlaying(false);
  change();
}

// The recorded camera nearest to where and when the page looks.
function nearestView() {
  const pose = camera.pose(state.time);
  const far = (view) => V.length(V.sub(V.column(view.camera.pose, 3), V.column(pose, 3))) + 5 * (1 - V.dot(V.column(view.camera.pose, 2), V.column(pose, 2))) +
    20 * Math.abs((view.camera.time ?? state.time) - state.time);
  let best = 0;
  scene.views.forEach((view, i) => { if (far(view) < far(scene.views[best])) best = i; });
  return best;
}

// ---- Picking and measuring ----
function toPicture(x, y) {
  return [(x - frame.x) / frame.scale, (y - frame.y) / frame.scale];
}

function choose(index) {
  state.chosen = index;
  for (const row of $('objects').rows) row.classList.toggle('chosen', Number(row.dataset.index) === index);
  drawOverlay();
}

function pick(x, y) {
  link.pick(...toPicture(x, y), (found) => {
    if (state.measuring) {
      if (!found.hit) return notice('There is nothing at this point.');
      state.points = state.points.length === 2 ? [found.point] : [...state.points, found.point];
      $('picked').textContent = state.points.length < 2 ? 'Click the second point.' : `${V.length(V.sub(state.points[0], state.points[1])).toFixed(3)} m`;
      return drawOverlay();
    }
    choose(found.hit ? found.object : -1);
    if (!found.hit) return void ($('picked').textContent = 'Nothing.');
    const object = scene.objects[found.object];
    $('picked').textContent = (object ? `${object.id}, ${object.class}${object.critical ? ', critical' : ''}\n${object.size.map((v) => v.toFixed(2)).join(' x ')} m${scene.live ? '' : `, ${number(object.gaussians)} Gaussians`}\n` : 'Background\n') +
      `${found.depth.toFixed(2)} m deep, at ${found.point.map((v) => v.toFixed(2)).join(', ')}\nGaussian ${found.gaussian}, priority ${found.priority.toFixed(2)}`;
  });
}

function focusAt(x, y) {
  link.pick(...toPicture(x, y), (found) => {
    if (!found.hit) return;
    camera.focus(found.point, state.time);
    change();
  });
}

function focusObject(index) {
  const object = scene.objects[index];
  let pose = objectPose(object, state.time);
  if (!pose && object.track.length) {
    setTime(object.track[0][0]);
    pose = objectPose(object, state.time);
  }
  if (!pose) return;
  camera.focus(V.column(pose, 3), state.time, 2.5 * V.length(object.size));
  if (V.dot(camera.forward(), camera.up) > -0.2) camera.turn(0, camera.pitch + 0.3, state.time);
  change();
}

function setMeasuring(on) {
  state.measuring = on;
  state.points = [];
  $('measure').setAttribute('aria-pressed', String(on));
  $('stage').classList.toggle('measuring', on);
  $('picked').textContent = on ? 'Click the first point.' : 'Click the picture.';
  drawOverlay();
}

// ---- Objects ----
function hide(index, hidden) {
  if (hidden) state.hidden.add(index);
  else state.hidden.delete(index);
  refreshObjects();
}

function isolate(index) {
  state.solo = state.solo === index ? -1 : index;
  refreshObjects();
}

function showAll() {
  state.hidden.clear();
  state.solo = -1;
  refreshObjects();
}

function refreshObjects() {
  for (const row of $('objects').rows) {
    const index = Number(row.dataset.index);
    row.querySelector('input').checked = !state.hidden.has(index);
    row.querySelector('.solo').setAttribute('aria-pressed', String(state.solo === index));
  }
  state.changed = true;
  refreshKeys();
}

function element(name, properties, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

function listObjects() {
  scene.objects.forEach((object, index) => {
    const box = element('input', {type: 'checkbox', checked: true, onchange: () => hide(index, !box.checked)});
    const label = element('button', {className: 'label', textContent: `${object.id} ${object.class}`, onclick: () => (choose(index), focusObject(index))});
    const solo = element('button', {className: 'solo', textContent: 'solo', onclick: () => isolate(index)});
    box.setAttribute('aria-label', `show ${object.id}`);
    box.disabled = solo.disabled = scene.live && !object.tracked; // its Gaussians are the background's while it trains
    const row = element('tr', {className: object.critical ? 'critical' : ''}, element('td', {}, box), element('td', {}, label),
      element('td', {className: 'number', textContent: scene.live ? '' : number(object.gaussians)}), element('td', {}, solo));
    row.dataset.index = index;
    $('objects').append(row);
  });
}

// ---- The path and files ----
function save(blob, name) {
  const address = URL.createObjectURL(blob);
  element('a', {href: address, download: name}).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

function savePicture() {
  $('picture').toBlob((blob) => save(blob, `${scene.name}.png`), 'image/png');
}

function refreshKeys() {
  const count = recorder.keys.length, without = [...state.hidden].map((i) => ` --without ${scene.objects[i].id}`).join('');
  $('keys').textContent = count ? `${count} camera${count > 1 ? 's' : ''}. Render a saved path with\npags render ${scene.name} --path path.json${without} -o pictures` : 'No cameras yet.';
  for (const id of ['key-clear', 'key-save']) $(id).disabled = !count;
  $('key-play').disabled = count < 2;
  drawOverlay();
}

function addKey() {
  recorder.keys.push(look);
  refreshKeys();
}

// ---- Controls ----
const commands = {
  mode: setMode, play: () => setPlaying(!state.playing), save: savePicture, key: addKey, measure: () => setMeasuring(!state.measuring),
  step: (by) => setTime(state.time + by * (scene.fps > 0 ? 1 / scene.fps : 0.1)),
  view: (by) => scene.views.length && setView(camera.view < 0 ? nearestView() : (camera.view + by + scene.views.length) % scene.views.length),
  compare: () => setChannel({color: 'photograph', photograph: 'difference'}[state.channel] ?? 'color'),
  boxes: () => $('show-boxes').click(), tracks: () => $('show-tracks').click(), panel: () => $('panel-toggle').click(), help: () => $('help-toggle').click(),
  hide: () => state.chosen >= 0 && hide(state.chosen, !state.hidden.has(state.chosen)), isolate: () => state.chosen >= 0 && isolate(state.chosen), showAll,
  focus: () => (state.chosen >= 0 ? focusObject(state.chosen) : focusAt($('stage').clientWidth / 2, $('stage').clientHeight / 2)),
  reset: () => { camera.reset(); state.time = scene.start.time ?? scene.time[0]; showAll(); change(); }
};
const controls = listen($('stage'), {
  camera, commands, pick, focusAt, change, time: () => state.time, focal: () => (look ? look.fx * frame.scale : 500)
});

$('name').textContent = document.title = scene.name;
$('facts').textContent = `${scene.live ? '' : `${number(scene.gaussians)} Gaussians, `}${scene.views.length} cameras, ${scene.objects.length} objects`;
$('time').min = scene.time[0];
$('time').max = scene.time[1];
$('time-group').hidden = !spans;
document.querySelector('[data-mode=drive]').hidden = $('drive-section').hidden = !camera.drive.length;
$('objects-section').hidden = !scene.objects.length;
$('views-section').hidden = !scene.views.length;
$('views').append(element('option', {value: '-1', textContent: 'none'}), ...scene.views.map((view, i) => element('option', {value: String(i), textContent: view.name + (view.test ? ' (held out)' : '')})));
$('views').onchange = () => (Number($('views').value) >= 0 ? setView(Number($('views').value)) : (camera.leave(state.time), change()));
for (const button of document.querySelectorAll('[data-mode]')) button.onclick = () => setMode(button.dataset.mode);
for (const [id, name] of [['play', 'play'], ['save', 'save'], ['measure', 'measure'], ['key-add', 'key'], ['show-all', 'showAll']]) $(id).onclick = () => commands[name]();
$('time').oninput = () => setTime(Number($('time').value));
$('channel').onchange = () => setChannel($('channel').value);
$('shift').oninput = () => {
  camera.shift = Number($('shift').value);
  $('shift-value').value = `${camera.shift.toFixed(1)} m`;
  if (camera.mode !== 'drive' || camera.view >= 0) setMode('drive');
  change();
};
for (const name of ['boxes', 'tracks', 'cameras']) $(`show-${name}`).onchange = () => { state[name] = $(`show-${name}`).checked; drawOverlay(); };
$('early-z').onchange = () => { state.earlyZ = $('early-z').checked; state.changed = true; };
$('wipe').oninput = () => setWipe($('wipe').value);
$('full').onchange = () => { state.full = $('full').checked; state.changed = true; };
$('key-clear').onclick = () => { recorder.keys = []; refreshKeys(); };
$('key-play').onclick = () => { state.preview = 0; };
$('key-save').onclick = () => save(new Blob([recorder.file(Number($('key-seconds').value) || 2)], {type: 'application/json'}), 'path.json');
listenToPanel(() => { state.changed = true; });
listObjects();
refreshKeys();
$('stage').focus();
requestAnimationFrame(turn);
