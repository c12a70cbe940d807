// SPDX-License-Identifier: Apache-2.0
// The connection to the server: sends looks, distributes pictures and answers, and reconnects when it breaks.
export class Link {
  constructor({onLook, onPicture, onAnswer, onState}) {
    Object.assign(this, {onLook, onPicture, onAnswer, onState});
    this.serial = 0;
    this.sent = new Map(); // serial of a look: when it was sent
    this.waiting = new Map(); // serial of a pick: what to do with its answer
    this.shown = 0;
    this.connect();
  }

  connect() {
    const socket = this.socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/socket`, 'pags');
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.wait = 500;
      this.onState(true);
      if (this.last) this.look(this.last);
    };
    socket.onclose = (event) => {
      this.over = event.code === 1001 && event.reason !== ''; // the server has said goodbye
      this.onState(false, event.reason, this.over);
      this.waiting.clear();
      if (this.over) return;
      setTimeout(() => this.connect(), this.wait = Math.min(8000, (this.wait ?? 500) * 2));
    };
    socket.onmessage = (event) => (typeof event.data === 'string' ? this.answer(JSON.parse(event.data)) : this.picture(event.data));
  }

  send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  look(look) {
    this.last = look;
    const serial = ++this.serial;
    if (this.send({type: 'look', serial, ...look})) this.sent.set(serial, performance.now());
    if (this.sent.size > 500) this.sent.delete(this.sent.keys().next().value);
    this.onLook(serial);
  }

  pick(x, y, done) {
    const serial = ++this.serial;
    if (this.send({type: 'pick', serial, x, y})) this.waiting.set(serial, done);
  }

  // Sends a request about a run; `done` receives the answer.
  ask(type, more, done) {
    const serial = ++this.serial;
    if (this.send({type, serial, ...more})) this.waiting.set(serial, done);
  }

  answer(message) {
    const done = this.waiting.get(message.serial);
    this.waiting.delete(message.serial);
    if (message.type === 'picked' || message.type === 'run') done?.(message);
    else this.onAnswer(message);
  }

  // A picture: the length of a text, the text, the JPEG file. It is acknowledged when it has been decoded.
  async picture(data) {
    const length = new DataView(data).getUint32(0, true);
    const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const bitmap = await createImageBitmap(new Blob([new Uint8Array(data, 4 + length)], {type: 'image/jpeg'}));
    this.send({type: 'got', serial: facts.serial});
    facts.bytes = data.byteLength;
    facts.latency = performance.now() - (this.sent.get(facts.serial) ?? NaN);
    for (const serial of this.sent.keys()) if (serial < facts.serial) this.sent.delete(serial);
    if (facts.serial >= this.shown) {
      this.shown = facts.serial;
      this.onPicture(bitmap, facts);
    }
    bitmap.close();
  }
}
