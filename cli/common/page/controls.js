// SPDX-License-Identifier: Apache-2.0
// Mouse, touch and keyboard: what is done on the stage moves the camera or gives a command.
const TURN = 0.004; // radians a pixel
const CLICK = 5; // pixels that a click may move
const FLY = {KeyW: [1, 0, 0], KeyS: [-1, 0, 0], KeyD: [0, 1, 0], KeyA: [0, -1, 0], KeyE: [0, 0, 1], KeyQ: [0, 0, -1]};
const ARROWS = {ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};

export function listen(stage, {camera, commands, pick, focusAt, change, time, focal}) {
  const pointers = new Map(), down = new Set();
  let moved = 0;

  const middle = () => {
    const all = [...pointers.values()];
    const x = all.reduce((sum, p) => sum + p.x, 0) / all.length, y = all.reduce((sum, p) => sum + p.y, 0) / all.length;
    return {x, y, spread: all.length > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0};
  };
  const inStage = (event) => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  stage.onpointerdown = (event) => {
    stage.setPointerCapture(event.pointerId);
    stage.focus();
    if (!pointers.size) moved = 0;
    pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
  };
  stage.onpointermove = (event) => {
    if (!pointers.has(event.pointerId)) return;
    const old = middle();
    pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    const now = middle(), dx = now.x - old.x, dy = now.y - old.y;
    moved += Math.abs(dx) + Math.abs(dy) + Math.abs(now.spread - old.spread);
    if (moved < CLICK) return;
    if (pointers.size > 1 || event.buttons & 6 || event.shiftKey) camera.pan(dx, dy, focal(), time());
    else camera.turn(dx * TURN, dy * TURN, time());
    if (old.spread > 0 && now.spread > 0) camera.zoom(old.spread / now.spread, time());
    change();
  };
  stage.onpointerup = (event) => {
    const click = pointers.size === 1 && moved < CLICK && event.button === 0;
    pointers.delete(event.pointerId);
    if (click) pick(...inStage(event));
  };
  stage.onpointercancel = (event) => pointers.delete(event.pointerId);
  stage.oncontextmenu = (event) => event.preventDefault();
  stage.ondblclick = (event) => focusAt(...inStage(event));
  stage.addEventListener('wheel', (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(Math.max(-1, Math.min(1, event.deltaY * (event.deltaMode ? 0.05 : 0.0015)))), time());
    change();
  }, {passive: false});

  const keys = {
    Digit1: () => commands.mode('orbit'), Digit2: () => commands.mode('fly'), Digit3: () => commands.mode('drive'),
    Space: commands.play, Comma: () => commands.step(-1), Period: () => commands.step(1),
    BracketLeft: () => commands.view(-1), BracketRight: () => commands.view(1),
    KeyM: commands.measure, KeyF: commands.focus, KeyH: commands.hide, KeyI: commands.isolate, KeyU: commands.showAll, KeyC: commands.compare,
    KeyB: commands.boxes, KeyT: commands.tracks, KeyK: commands.key, KeyP: commands.save, KeyR: commands.reset, KeyO: commands.panel
  };
  window.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector('dialog[open]')) return;
    if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== 'checkbox') return;
    const onStage = event.target === stage || event.target === document.body;
    if (event.key === '?') return commands.help();
    if (!onStage && (event.code === 'Space' || event.code === 'Enter')) return; // a button's own
    if (FLY[event.code]) return void down.add(event.code);
    if (ARROWS[event.code]) {
      event.preventDefault();
      const [x, y] = ARROWS[event.code];
      if (camera.mode === 'drive' && camera.view < 0 && x) return commands.step(-x);
      camera.turn(-0.05 * x, -0.05 * y, time());
      return change();
    }
    if (!keys[event.code]) return;
    event.preventDefault();
    keys[event.code]();
  });
  window.addEventListener('keyup', (event) => down.delete(event.code));
  window.addEventListener('blur', () => down.clear());

  // The pressed flying keys, as amounts forward, right and up; null: no key.
  return {flying: () => (down.size ? [0, 1, 2].map((i) => [...down].reduce((sum, code) => sum + FLY[code][i], 0)) : null)};
}

// The side panel: object search, help, and hiding the panel; `changed` is called when the picture size changes.
export function listenToPanel(changed) {
  const $ = (id) => document.getElementById(id);
  $('filter').oninput = () => {
    const wanted = $('filter').value.toLowerCase();
    for (const row of $('objects').rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
  };
  $('help-toggle').onclick = () => ($('help').open ? $('help').close() : $('help').showModal());
  $('panel-toggle').onclick = () => {
    const wide = document.body.classList.toggle('wide');
    $('panel-toggle').setAttribute('aria-expanded', String(!wide));
    changed();
  };
  if (window.innerWidth <= 720) $('panel-toggle').click();
  window.addEventListener('resize', changed);
}
