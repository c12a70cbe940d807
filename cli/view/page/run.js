// SPDX-License-Identifier: Apache-2.0
// A run of the training that is watched: its figures, curves and worst views, and the buttons for a checkpoint and the end.
const EVERY = 1000; // milliseconds between questions
const [STEP, LOSS, PSNR, GAUSSIANS, RATE, MEMORY] = [0, 1, 2, 3, 4, 5];
const $ = (id) => document.getElementById(id);

const short = (value) => (value >= 1e6 ? `${(value / 1e6).toFixed(2)} M` : value >= 1e4 ? `${(value / 1e3).toFixed(0)} k` : String(Math.round(value)));
const plots = [
  {id: 'curve-loss', name: 'Loss', column: LOSS, text: (v) => v.toFixed(4)},
  {id: 'curve-psnr', name: 'PSNR', column: PSNR, text: (v) => `${v.toFixed(2)} dB`, held: true},
  {id: 'curve-gaussians', name: 'Gaussians', column: GAUSSIANS, text: short, zero: true},
  {id: 'curve-rate', name: 'Steps/s', column: RATE, text: (v) => v.toFixed(1), zero: true},
  {id: 'curve-memory', name: 'Memory', column: MEMORY, text: (v) => `${(v / 1e6).toFixed(0)} MB`, zero: true}
];

function duration(seconds) {
  const s = Math.round(seconds), pad = (n) => String(n).padStart(2, '0');
  return s >= 3600 ? `${Math.floor(s / 3600)} h ${pad(Math.floor(s / 60) % 60)} min` : s >= 60 ? `${Math.floor(s / 60)} min ${pad(s % 60)} s` : `${s} s`;
}

export class Run {
  // `choose` is called with the index of a view that was clicked.
  constructor(link, scene, choose) {
    Object.assign(this, {link, scene, choose, edition: 0, points: [], held: [], over: false});
    $('run-section').hidden = false;
    $('checkpoint').onclick = () => this.ask('checkpoint');
    $('stop-run').onclick = () => this.stop();
    for (const plot of plots) $(plot.id).setAttribute('aria-label', plot.name);
    this.poll();
  }

  poll() {
    if (this.over) return;
    this.link.ask('run', {edition: this.edition, from: this.points.length}, (state) => this.show(state));
    setTimeout(() => this.poll(), this.points.length ? EVERY : 200);
  }

  ask(kind) {
    this.link.ask(kind, {}, (state) => this.show(state));
  }

  // Asks for a second click within some seconds.
  stop() {
    const button = $('stop-run');
    if (this.sure) {
      this.ask('stop');
      button.disabled = true;
    }
    clearTimeout(this.sure);
    button.textContent = this.sure ? 'Stopping' : 'Stop? Click again';
    this.sure = this.sure ? 0 : setTimeout(() => { this.sure = 0; button.textContent = 'Stop run'; }, 4000);
  }

  end(reason) {
    this.over = true;
    $('run-head').textContent = reason;
    for (const id of ['checkpoint', 'stop-run']) $(id).disabled = true;
  }

  show(state) {
    if (state.points) {
      this.points = [...(state.edition === this.edition ? this.points.slice(0, state.from) : []), ...state.points];
      this.edition = state.edition;
      this.held = state.heldOut;
    }
    const last = state.step === state.steps;
    $('run-head').textContent = `Step ${state.step} of ${state.steps}, ` + (last ? 'scoring and writing the scene' : state.stopping ? 'stopping' : `${duration(state.left)} left`);
    $('run-bar').value = state.step / state.steps;
    const held = this.held.at(-1);
    $('run-facts').textContent = `loss ${state.loss.toFixed(4)}, training PSNR ${state.psnr === null ? 'unknown' : `${state.psnr.toFixed(2)} dB`}${state.shrink > 1 ? ` at 1/${state.shrink} size` : ''}\n` +
      (held ? `held-out PSNR ${held[1] === null ? 'unknown' : `${held[1].toFixed(2)} dB`} at step ${held[0]}\n` : '') +
      `${short(state.gaussians)} Gaussians, ${state.rate.toFixed(1)} steps a second, ${duration(state.seconds)} trained\n` +
      `pages took ${(100 * state.share).toFixed(1)} % of the time, ${(100 * state.mostShare).toFixed(0)} % at most` +
      (state.badRows ? `\n${state.badRows} updates left out` : '');
    $('run-said').textContent = state.saving ? 'The checkpoint follows this step.' : state.said;
    this.listWorst(state.worst);
    for (const plot of plots) this.draw(plot);
  }

  listWorst(worst) {
    const buttons = worst.map(({view, psnr}) => {
      const {name, test} = this.scene.views[view];
      return Object.assign(document.createElement('button'), {textContent: `${name}${test ? ' (held out)' : ''}  ${psnr.toFixed(1)} dB`, onclick: () => this.choose(view)});
    });
    if ($('worst').contains(document.activeElement)) return; // somebody is about to press one
    $('worst').replaceChildren(...buttons);
  }

  // One curve over the steps, in the colours of the page; held-out views are dots.
  draw({id, name, column, text, zero, held}) {
    const canvas = $(id), ratio = window.devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight, c = canvas.getContext('2d');
    const line = this.points.filter((point) => point[column] !== null).map((point) => [point[STEP], point[column]]);
    const dots = held ? this.held.filter((dot) => dot[1] !== null) : [];
    if (!line.length || !width) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const values = [...line, ...dots].map((point) => point[1]), top = 18, foot = 4;
    const first = Math.min(line[0][0], dots[0]?.[0] ?? Infinity), span = Math.max(line.at(-1)[0] - first, 1);
    const least = zero ? 0 : Math.min(...values), most = Math.max(...values, least + 1e-9);
    const at = ([step, value]) => [2 + ((width - 6) * (step - first)) / span, height - foot - ((height - top - foot) * (value - least)) / (most - least)];
    c.scale(ratio, ratio);
    c.lineWidth = 1.5;
    c.strokeStyle = '#7fb3e6';
    c.beginPath();
    for (const point of line) c.lineTo(...at(point));
    c.stroke();
    c.fillStyle = '#e8b34a';
    for (const dot of dots) {
      c.beginPath();
      c.arc(...at(dot), 2.5, 0, 7);
      c.fill();
    }
    c.font = '12px system-ui, sans-serif';
    c.fillStyle = '#e8ecf0';
    c.fillText(`${name} ${text(line.at(-1)[1])}`, 2, 12);
    c.fillStyle = '#a9b4bf';
    c.textAlign = 'right';
    c.fillText(`${text(least)} to ${text(most)}`, width - 2, 12);
    Object.assign(canvas.dataset, {points: line.length, dots: dots.length});
  }
}
