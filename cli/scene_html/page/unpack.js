// SPDX-License-Identifier: Apache-2.0
// Unpacks what cli/scene_html/pack.c packed.

const CODEBOOK = 256;

// The bytes of the page's data elements, which are removed.
export async function readPage(progress) {
  const elements = [...document.querySelectorAll('script.data')], parts = [];
  if (!elements.length) throw new Error('The file is incomplete: it has no data.');
  if (typeof DecompressionStream === 'undefined') throw new Error('This browser is too old; use one from 2023 or later.');
  for (const [i, element] of elements.entries()) {
    const text = atob(element.textContent), bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    parts.push(bytes);
    element.remove();
    if (i % 4 === 3) await progress((i + 1) / elements.length);
  }
  try {
    return new Uint8Array(await new Response(new Blob(parts).stream().pipeThrough(new DecompressionStream('gzip'))).arrayBuffer());
  } catch {
    throw new Error('The file is damaged: its data can\'t be unpacked. Download it again.');
  }
}

// The header, with planes[name] = bytes.
function splitPlanes(bytes) {
  const size = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
  const planes = {};
  let at = 4 + size;
  for (const {name, planes: count, rows} of header.planes) {
    planes[name] = bytes.subarray(at, at + count * rows);
    at += count * rows;
  }
  if (header.format !== 1) throw new Error(`The file's format is ${header.format}: this player knows format 1.`);
  if (at !== bytes.length) throw new Error('The file is damaged: its data has the wrong size.');
  return {header, planes};
}

const floats = (bytes) => new Float32Array(bytes.slice().buffer);

// The halfs (as bits) of some values; too small ones become 0.
function halfsOf(values) {
  const bits = new Uint32Array(new Float32Array(values).buffer);
  return Uint16Array.from(bits, (b) => {
    const sign = b >>> 16 & 0x8000, exponent = (b >>> 23 & 255) - 112, rounded = (exponent << 10 | b >>> 13 & 1023) + (b >>> 12 & 1);
    return exponent <= 0 ? sign : sign | Math.min(rounded, 0x7bff);
  });
}

// Rows for the renderer, 8 words each: x, y, z (floats), model + 65536 label; scales and opacity, a byte each; rotation; colour; row of the
// table of colours over time + 1.
function unpackRows(header, planes, radii) {
  const count = header.gaussians, rows = new Uint32Array(8 * count), places = new Float32Array(rows.buffer);
  const cells = floats(planes.cells), cellRows = new Uint32Array(planes.cellRows.slice().buffer);
  const {mean, scale, opacity, rotation, color, label} = planes;
  let i = 0, cell = 0;
  header.models.forEach((model, m) => {
    model.first = i;
    for (let c = 0; c < model.cells; c++, cell++) {
      const at = [0, 0, 0];
      for (const end = i + cellRows[cell]; i < end; i++) {
        const out = 8 * i;
        for (let k = 0; k < 3; k++) {
          const folded = mean[k * count + i] << 8 | mean[(3 + k) * count + i];
          at[k] = at[k] + (folded & 1 ? -(folded + 1 >> 1) : folded >> 1) & 0xffff;
          places[out + k] = cells[6 * cell + k] + at[k] * cells[6 * cell + 3 + k];
        }
        rows[out + 3] = m | (label ? label[i] << 24 | label[count + i] << 16 : 0);
        rows[out + 4] = scale[i] | scale[count + i] << 8 | scale[2 * count + i] << 16 | opacity[i] << 24;
        rows[out + 5] = rotation[i] | rotation[count + i] << 8 | rotation[2 * count + i] << 16 | rotation[3 * count + i] << 24;
        rows[out + 6] = color[i] | color[count + i] << 8 | color[2 * count + i] << 16;
        rows[out + 7] = i < header.fourierRows ? i + 1 : 0;
        radii[i] = Math.max(scale[i], scale[count + i], scale[2 * count + i]);
      }
    }
  });
  return {rows, places};
}

// Harmonics as pairs of halfs, `texels` of four words for each entry of the palette.
function unpackPalette(header, planes) {
  const width = 3 * ((header.shDegree + 1) ** 2 - 1), texels = Math.ceil(width / 8);
  if (!width) return {texels: 0, entries: 0, words: new Uint32Array(0)};
  const count = planes.palette.length / width, halfs = halfsOf(floats(planes.paletteBook));
  const out = new Uint16Array(8 * texels * count);
  for (let k = 0; k < width; k++) for (let i = 0; i < count; i++) out[8 * texels * i + k] = halfs[planes.palette[k * count + i]];
  return {texels, entries: count, words: new Uint32Array(out.buffer)};
}

// Colours over time: four words of bytes for each row and coefficient, of which the last is empty.
function unpackFourier(header, planes) {
  const count = header.fourierRows, changing = (header.fourierDegree + 1) ** 2, out = new Uint8Array(16 * changing * count);
  for (let k = 0; k < 12 * changing && count; k++) {
    const to = 16 * Math.floor(k / 12) + k % 12;
    for (let i = 0; i < count; i++) out[16 * changing * i + to] = planes.fourier[k * count + i];
  }
  return new Uint32Array(out.buffer);
}

// The faces of the sky, 10 bits a channel between the least and the largest value of its book.
function unpackSky(header, planes) {
  const size = header.skySize, area = size * size, book = floats(planes.skyBook), range = [book[0], book[CODEBOOK - 1]];
  const steps = Uint32Array.from(book, (value) => 1023 * (value - range[0]) / (range[1] - range[0] || 1) + 0.5);
  const words = new Uint32Array(6 * area), face = new Uint8Array(area);
  for (let plane = 0; plane < 18 && size; plane++) {
    const bytes = planes.sky.subarray(plane * area, (plane + 1) * area), to = area * Math.floor(plane / 3), shift = 10 * (plane % 3);
    for (let i = 0; i < area; i++) {
      const left = i % size > 0, above = i >= size;
      face[i] = bytes[i] + (left ? face[i - 1] : 0) + (above ? face[i - size] : 0) - (left && above ? face[i - size - 1] : 0);
      words[to + i] |= steps[face[i]] << shift;
    }
  }
  return {words, range};
}

// Everything to draw: the header with models, rows, tables; `radii` are the largest sigmas, metres, `solid` opacities
// as bytes.
export function unpack(bytes) {
  const {header, planes} = splitPlanes(bytes), radii = new Float32Array(header.gaussians);
  const {rows, places} = unpackRows(header, planes, radii);
  const sigmas = floats(planes.scaleBook).map(Math.exp), books = new Float32Array(4 * CODEBOOK);
  [sigmas, floats(planes.opacityBook), floats(planes.colorBook), floats(planes.fourierBook)].forEach((book, k) => {
    for (let i = 0; i < CODEBOOK; i++) books[4 * i + k] = book[i];
  });
  const solids = Uint8Array.from(floats(planes.opacityBook), (value) => 255 * value + 0.5), solid = planes.opacity.map((value) => solids[value]);
  for (let i = 0; i < radii.length; i++) radii[i] = sigmas[radii[i]];
  return {header, rows, places, radii, solid, books, palette: unpackPalette(header, planes), fourier: unpackFourier(header, planes), sky: unpackSky(header, planes)};
}
