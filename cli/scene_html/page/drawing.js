// SPDX-License-Identifier: Apache-2.0
// Draws Gaussians with WebGL 2 as the engine does: projection of Zwicker et al. 2001 with INRIA's constants, spherical harmonics to degree 3,
// colours over time of Street Gaussians, the scene's own cut of alpha, blending in display-referred sRGB, the sky behind.
import * as V from './vector.js';

const ROW_TEXELS = 2048, PALETTE_ROW = 256, ORDER_ROW = 1024; // texels in a row of the table of Gaussians; entries in rows of other tables
const MODEL_TEXELS = 8;
const BATCH = 1024; // Gaussians in one instance: WebGL on processors draws instance after instance, and small ones are slow on graphics cards, too

// A triangle that covers the target.
const coverShader = `#version 300 es
out vec2 at;
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0;
  gl_Position = vec4(at * 2.0 - 1.0, 0.0, 1.0);
}`;

// Projects and shades one Gaussian a pixel, in their order, into two tables: mean in pixels and two terms of the Cholesky factor of the
// covariance; the third, then in halfs colour, opacity, where it ends and what is taken off. A first term of 0: it isn't drawn.
const projectShader = (degree, changing) => `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2D;
#define DEGREE ${degree}
uniform usampler2D order;
uniform int count;
uniform usampler2D gaussians, palette, fourier;
uniform sampler2D books, models;
uniform vec4 lens, limits; // fx, fy, cx, cy in pixels; where x/z and y/z are clamped
uniform float low_pass, near;
uniform bool antialiased;
layout(location = 0) out uvec4 place_out;
layout(location = 1) out uvec4 color_out;

float book(uint value, int column) { return texelFetch(books, ivec2(int(value & 255u), 0), 0)[column]; }

vec3 quaternion_row(vec4 q, int i) { // of the rotation matrix; q = w, x, y, z
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return i == 0 ? vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y))
       : i == 1 ? vec3(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x))
                : vec3(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y));
}

vec4 unpack_rotation(uint bits) {
  vec3 small = (vec3(bits & 1023u, bits >> 10 & 1023u, bits >> 20 & 1023u) / 1023.0 * 2.0 - 1.0) * 0.70710678;
  float large = sqrt(max(0.0, 1.0 - dot(small, small)));
  uint which = bits >> 30;
  return which == 0u ? vec4(large, small) : which == 1u ? vec4(small.x, large, small.yz)
       : which == 2u ? vec4(small.xy, large, small.z) : vec4(small, large);
}

// How a coefficient of a row, numbered from 1, changes with time.
vec3 change(uint row, int model, uint coefficient) {
  uint at = (row - 1u) * ${(changing + 1) ** 2}u + coefficient;
  uvec4 words = texelFetch(fourier, ivec2(int(at % ${ROW_TEXELS}u), int(at / ${ROW_TEXELS}u)), 0);
  vec4 basis = texelFetch(models, ivec2(5, model), 0);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < 12; k++) sum[k % 3] += basis[k / 3] * book(words[k / 4] >> uint(8 * (k % 4)), 3);
  return sum;
}

#if DEGREE > 0
#define TERMS ${(degree + 1) ** 2 - 1}
#define TEXELS ${Math.ceil((3 * ((degree + 1) ** 2 - 1)) / 8)}
vec3 harmonics(uint label, uint row, int model, vec3 d) {
  float h[8 * TEXELS];
  ivec2 from = ivec2(int(label % ${PALETTE_ROW}u) * TEXELS, int(label / ${PALETTE_ROW}u));
  for (int i = 0; i < TEXELS; i++) {
    uvec4 words = texelFetch(palette, from + ivec2(i, 0), 0);
    for (int k = 0; k < 4; k++) {
      vec2 two = unpackHalf2x16(words[k]);
      h[8 * i + 2 * k] = two.x;
      h[8 * i + 2 * k + 1] = two.y;
    }
  }
  float basis[TERMS];
  float x = d.x, y = d.y, z = d.z;
  basis[0] = -0.4886025119 * y;
  basis[1] = 0.4886025119 * z;
  basis[2] = -0.4886025119 * x;
#if DEGREE > 1
  float xx = x * x, yy = y * y, zz = z * z;
  basis[3] = 1.0925484306 * x * y;
  basis[4] = -1.0925484306 * y * z;
  basis[5] = 0.3153915653 * (2.0 * zz - xx - yy);
  basis[6] = -1.0925484306 * x * z;
  basis[7] = 0.5462742153 * (xx - yy);
#endif
#if DEGREE > 2
  basis[8] = -0.5900435899 * y * (3.0 * xx - yy);
  basis[9] = 2.8906114426 * x * y * z;
  basis[10] = -0.4570457995 * y * (4.0 * zz - xx - yy);
  basis[11] = 0.3731763326 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
  basis[12] = -0.4570457995 * x * (4.0 * zz - xx - yy);
  basis[13] = 1.4453057213 * z * (xx - yy);
  basis[14] = -0.5900435899 * x * (xx - 3.0 * yy);
#endif
  vec3 sum = vec3(0.0);
  for (int k = 0; k < TERMS; k++) sum += basis[k] * vec3(h[3 * k], h[3 * k + 1], h[3 * k + 2]);
  if (row > 0u)
    for (int k = 0; k < ${(changing + 1) ** 2 - 1}; k++) sum += basis[k] * change(row, model, uint(k + 1));
  return sum;
}
#endif

void main() {
  place_out = color_out = uvec4(0u);
  ivec2 here = ivec2(gl_FragCoord.xy);
  if (here.y * ${ORDER_ROW} + here.x >= count) return;
  uint index = texelFetch(order, here, 0).x;
  ivec2 place = ivec2(int(index % ${ROW_TEXELS / 2}u) * 2, int(index / ${ROW_TEXELS / 2}u));
  uvec4 a = texelFetch(gaussians, place, 0), b = texelFetch(gaussians, place + ivec2(1, 0), 0);
  int model = int(a.w & 0xffffu);
  vec3 mean = uintBitsToFloat(a.xyz);
  vec4 row[3];
  for (int i = 0; i < 3; i++) row[i] = texelFetch(models, ivec2(i, model), 0);
  vec3 c = vec3(dot(row[0].xyz, mean) + row[0].w, dot(row[1].xyz, mean) + row[1].w, dot(row[2].xyz, mean) + row[2].w);
  if (!(c.z > near)) return;
  vec2 d = c.xy / c.z, clamped = clamp(d, limits.xy, limits.zw);

  vec3 tx = lens.x / c.z * (row[0].xyz - clamped.x * row[2].xyz), ty = lens.y / c.z * (row[1].xyz - clamped.y * row[2].xyz);
  vec4 q = unpack_rotation(b.y);
  vec3 q0 = quaternion_row(q, 0), q1 = quaternion_row(q, 1), q2 = quaternion_row(q, 2);
  vec3 sigma = vec3(book(b.x, 0), book(b.x >> 8, 0), book(b.x >> 16, 0));
  vec3 m0 = (tx.x * q0 + tx.y * q1 + tx.z * q2) * sigma, m1 = (ty.x * q0 + ty.y * q1 + ty.z * q2) * sigma;
  vec3 minors = cross(m0, m1);
  float a0 = dot(m0, m0), c0 = dot(m1, m1), bb = dot(m0, m1), d0 = dot(minors, minors);
  float aa = a0 + low_pass, dd = d0 + low_pass * (a0 + c0) + low_pass * low_pass;

  vec4 ends = texelFetch(models, ivec2(4, model), 0); // least alpha, what is taken off, lift
  float compensation = antialiased ? sqrt(max(2.5e-5, d0 / dd)) : 1.0;
  float opacity = book(b.x >> 24, 1) * compensation;
  float less = antialiased && ends.y > 0.0 ? max(compensation, 1.0 / 255.0 / ends.x) : 1.0;
  if (opacity < ends.x * less || !(dd > 0.0)) return;
  vec2 cut = vec2(ends.y > 0.0 ? ends.y : 1.0 / 255.0, ends.y) * less;

  vec4 eye = texelFetch(models, ivec2(3, model), 0);
  vec3 colour = vec3(book(b.z, 2), book(b.z >> 8, 2), book(b.z >> 16, 2));
  if (b.w > 0u) colour += change(b.w, model, 0u);
  colour = 0.5 + 0.28209479 * colour;
#if DEGREE > 0
  colour += harmonics(a.w >> 16, b.w, model, normalize(mean - eye.xyz));
#endif
  colour = max(colour, 0.0);

  float root = sqrt(aa);
  place_out = floatBitsToUint(vec4(lens.xy * d + lens.zw, root, bb / root));
  color_out = uvec4(floatBitsToUint(sqrt(dd) / root), packHalf2x16(colour.rg), packHalf2x16(vec2(colour.b, opacity * ends.z)), packHalf2x16(cut));
}`;

const vertexShader = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
uniform usampler2D places, colors;
uniform vec2 size;
uniform int count;
out vec2 at;
flat out vec4 shown; // colour, opacity
flat out vec2 cut;   // where it ends, what is taken off
void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0); // outside
  int i = gl_InstanceID * ${BATCH} + (gl_VertexID >> 2);
  if (i >= count) return;
  ivec2 from = ivec2(i % ${ORDER_ROW}, i / ${ORDER_ROW});
  vec4 place = uintBitsToFloat(texelFetch(places, from, 0));
  if (place.z == 0.0) return;
  uvec4 b = texelFetch(colors, from, 0);
  shown = vec4(unpackHalf2x16(b.y), unpackHalf2x16(b.z));
  cut = unpackHalf2x16(b.w);
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2.0 - 1.0;
  at *= sqrt(max(0.0, 2.0 * log(shown.a / cut.x))); // sigmas until it ends
  vec2 pixel = place.xy + vec2(place.z * at.x, place.w * at.x + uintBitsToFloat(b.x) * at.y);
  gl_Position = vec4(pixel / size * 2.0 - 1.0, 0.0, 1.0) * vec4(1.0, -1.0, 1.0, 1.0);
}`;

const fragmentShader = `#version 300 es
precision highp float;
in vec2 at;
flat in vec4 shown;
flat in vec2 cut;
out vec4 color;
void main() {
  float e = shown.a * exp(-0.5 * dot(at, at));
  if (e < cut.x) discard;
  float alpha = min(0.99, e - cut.y);
  color = vec4(shown.rgb * alpha, alpha);
}`;

const skyShader = `#version 300 es
precision highp float;
precision highp sampler2DArray;
uniform sampler2D drawn;
uniform sampler2DArray sky;
uniform bool has_sky;
uniform vec3 background;
uniform vec2 range; // of the sky's values
uniform vec4 lens;
uniform vec2 size;
uniform mat3 world_from_camera;
in vec2 at;
out vec4 color;
void main() {
  vec4 front = texture(drawn, at);
  vec3 behind = background;
  if (has_sky) {
    vec2 pixel = vec2(at.x, 1.0 - at.y) * size;
    vec3 d = world_from_camera * vec3((pixel - lens.zw) / lens.xy, 1.0), m = abs(d);
    float face = m.x >= m.y && m.x >= m.z ? (d.x > 0.0 ? 0.0 : 1.0) : m.y >= m.z ? (d.y > 0.0 ? 2.0 : 3.0) : (d.z > 0.0 ? 4.0 : 5.0);
    vec2 st = face == 0.0 ? vec2(-d.z, -d.y) : face == 1.0 ? vec2(d.z, -d.y) : face == 2.0 ? vec2(d.x, d.z)
            : face == 3.0 ? vec2(d.x, -d.z) : face == 4.0 ? vec2(d.x, -d.y) : vec2(-d.x, -d.y);
    behind = texture(sky, vec3((st / max(m.x, max(m.y, m.z)) + 1.0) * 0.5, face)).rgb * (range.y - range.x) + range.x;
  }
  color = vec4(front.rgb + (1.0 - front.a) * behind, 1.0);
}`;

function compile(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(`This browser's WebGL takes no shader of the player: ${gl.getShaderInfoLog(shader)}`);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(`This browser's WebGL can't link the player: ${gl.getProgramInfoLog(program)}`);
  const at = new Map();
  return {program, at: (name) => (at.has(name) || at.set(name, gl.getUniformLocation(program, name)), at.get(name))};
}

export class Drawing {
  constructor(canvas, data) {
    const gl = canvas.getContext('webgl2', {antialias: false, alpha: false, depth: false, stencil: false, powerPreference: 'high-performance'});
    if (!gl) throw new Error('This browser has no WebGL 2. Use another browser, or turn on hardware acceleration in its settings.');
    this.gl = gl;
    this.canvas = canvas;
    this.data = data;
    this.most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    this.floats = Boolean(gl.getExtension('EXT_color_buffer_float') || gl.getExtension('EXT_color_buffer_half_float'));
    this.count = 0; // of the order
    this.target = {width: 0, height: 0};
    this.build();
    data.rows = data.places = data.palette.words = data.fourier = data.sky.words = null; // the textures have them
  }

  build() {
    const {gl, data} = this, {header} = data;
    this.project = compile(gl, coverShader, projectShader(header.shDegree, header.fourierDegree));
    this.splats = compile(gl, vertexShader, fragmentShader);
    this.behind = compile(gl, coverShader, skyShader);
    const rows = Math.max(1, Math.ceil(header.gaussians / ORDER_ROW));
    this.textures = {
      gaussians: this.table(data.rows, ROW_TEXELS, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT),
      palette: this.table(data.palette.words, PALETTE_ROW * Math.max(1, data.palette.texels), gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT),
      fourier: this.table(data.fourier, ROW_TEXELS, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT),
      books: this.table(data.books, 256, gl.RGBA32F, gl.RGBA, gl.FLOAT),
      models: this.table(new Float32Array(4 * MODEL_TEXELS * header.models.length), MODEL_TEXELS, gl.RGBA32F, gl.RGBA, gl.FLOAT),
      order: this.storage(ORDER_ROW, rows, gl.R32UI), places: this.storage(ORDER_ROW, rows, gl.RGBA32UI), colors: this.storage(ORDER_ROW, rows, gl.RGBA32UI),
      drawn: gl.createTexture(), sky: gl.createTexture()
    };
    this.projected = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.projected);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.textures.places, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, this.textures.colors, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE) throw new Error('The graphics of this device can\'t render to integer textures, which the player needs. Use another device.');
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.textures.sky);
    const size = Math.max(1, header.skySize);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGB10_A2, size, size, 6, 0, gl.RGBA, gl.UNSIGNED_INT_2_10_10_10_REV, header.skySize ? data.sky.words : null);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, value);
    this.frame = gl.createFramebuffer();
    this.quads = gl.createVertexArray(); // two triangles of four vertices for each Gaussian of a batch
    gl.bindVertexArray(this.quads);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, Uint16Array.from({length: 6 * BATCH}, (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 2, 1, 3][i % 6]), gl.STATIC_DRAW);
    this.empty = gl.createVertexArray();
    gl.disable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  storage(width, height, internal) {
    const {gl} = this, texture = gl.createTexture();
    if (height > this.most || width > this.most) throw new Error(`The scene is too large for this device: ${height} rows of a table, of which its WebGL takes ${this.most}.`);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, internal, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }

  // Writes `words`, a given number per texel, into the bound texture, whose rows have `width` texels.
  write(words, each, width, format, type) {
    const {gl} = this, texels = words.length / each, whole = Math.floor(texels / width);
    if (whole) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, whole, format, type, words.subarray(0, each * whole * width));
    if (texels > whole * width) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, whole, texels - whole * width, 1, format, type, words.subarray(each * whole * width));
  }

  // A texture of `words`, four per texel, in rows of a given number of texels.
  table(words, width, internal, format, type) {
    const texture = this.storage(width, Math.max(1, Math.ceil(words.length / 4 / width)), internal);
    this.write(words, 4, width, format, type);
    return texture;
  }

  setOrder(order) {
    const {gl} = this;
    this.count = order.length;
    gl.bindTexture(gl.TEXTURE_2D, this.textures.order);
    this.write(order, 1, ORDER_ROW, gl.RED_INTEGER, gl.UNSIGNED_INT);
  }

  resize(width, height) {
    const {gl, target} = this;
    if (target.width === width && target.height === height) return;
    Object.assign(target, {width, height});
    gl.bindTexture(gl.TEXTURE_2D, this.textures.drawn);
    if (this.floats) gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.HALF_FLOAT, null);
    else gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
      gl.texParameteri(gl.TEXTURE_2D, name, value);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.textures.drawn, 0);
    if (this.floats && gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE && !gl.isContextLost()) {
      this.floats = false; // rounded to 8 bits after each Gaussian, but drawn
      target.width = 0;
      this.resize(width, height);
    }
  }

  // What the models' texture says for poses: [camera_from_model (3 x 4), the four terms of colours over time].
  upload(poses) {
    const {gl} = this, {models} = this.data.header, texels = new Float32Array(4 * MODEL_TEXELS * models.length);
    models.forEach((model, i) => {
      const [view, basis] = poses[i], at = 4 * MODEL_TEXELS * i, alpha = model.alphaMin;
      const t = V.column(view, 3), eye = [0, 1, 2].map((k) => -V.dot(V.column(view, k), t));
      texels.set(view, at);
      texels.set(eye, at + 12);
      texels.set(alpha > 0 ? [alpha, alpha / (1 - alpha), 1 / (1 - alpha)] : [1 / 255, 0, 1], at + 16);
      texels.set(basis, at + 20);
    });
    gl.bindTexture(gl.TEXTURE_2D, this.textures.models);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, MODEL_TEXELS, models.length, gl.RGBA, gl.FLOAT, texels);
  }

  bind(program, names) {
    const {gl} = this;
    gl.useProgram(program.program);
    names.forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(name === 'sky' ? gl.TEXTURE_2D_ARRAY : gl.TEXTURE_2D, this.textures[name]);
      gl.uniform1i(program.at(name), unit);
    });
    gl.activeTexture(gl.TEXTURE0);
  }

  // Whether the device is still at the last picture.
  busy() {
    const {gl} = this;
    if (this.fence && gl.getSyncParameter(this.fence, gl.SYNC_STATUS) === gl.SIGNALED) {
      gl.deleteSync(this.fence);
      this.fence = null;
    }
    return Boolean(this.fence) && !gl.isContextLost();
  }

  // Draws a look at a part of its pixels a side.
  draw(look, poses, scale) {
    const {gl, canvas, project, splats, behind, data: {header}} = this;
    if (canvas.width !== look.width || canvas.height !== look.height) [canvas.width, canvas.height] = [look.width, look.height];
    const width = Math.max(1, Math.round(look.width * scale)), height = Math.max(1, Math.round(look.height * scale));
    const sx = width / look.width, sy = height / look.height, limits = limitsOf(look);
    const lens = [look.fx * sx, look.fy * sy, look.cx * sx, look.cy * sy];
    this.resize(width, height);
    this.upload(poses);

    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.empty);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.projected);
    gl.viewport(0, 0, ORDER_ROW, Math.ceil(this.count / ORDER_ROW));
    this.bind(project, ['order', 'gaussians', 'palette', 'fourier', 'books', 'models']);
    gl.uniform1i(project.at('count'), this.count);
    gl.uniform4fv(project.at('lens'), lens);
    gl.uniform4f(project.at('limits'), limits.x0, limits.y0, limits.x1, limits.y1);
    gl.uniform1f(project.at('low_pass'), header.lowPass);
    gl.uniform1f(project.at('near'), header.near);
    gl.uniform1i(project.at('antialiased'), Number(header.antialiased));
    if (this.count) gl.drawArrays(gl.TRIANGLES, 0, 3);

    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.bind(splats, ['places', 'colors']);
    gl.uniform2f(splats.at('size'), width, height);
    gl.uniform1i(splats.at('count'), this.count);
    gl.enable(gl.BLEND);
    gl.bindVertexArray(this.quads);
    gl.drawElementsInstanced(gl.TRIANGLES, 6 * BATCH, gl.UNSIGNED_SHORT, 0, Math.ceil(this.count / BATCH));

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, look.width, look.height);
    gl.disable(gl.BLEND);
    this.bind(behind, ['drawn', 'sky']);
    gl.uniform1i(behind.at('has_sky'), Number(header.skySize > 0));
    gl.uniform3fv(behind.at('background'), header.background);
    gl.uniform2fv(behind.at('range'), this.data.sky.range);
    gl.uniform4f(behind.at('lens'), look.fx, look.fy, look.cx, look.cy);
    gl.uniform2f(behind.at('size'), look.width, look.height);
    gl.uniformMatrix3fv(behind.at('world_from_camera'), false, [...V.column(look.pose, 0), ...V.column(look.pose, 1), ...V.column(look.pose, 2)]);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
    if (this.fence) gl.deleteSync(this.fence);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }
}

// Where x/z and y/z are clamped: 0.15 of the picture beyond its edges, on each side.
export function limitsOf(look) {
  const x = 0.15 * look.width / look.fx, y = 0.15 * look.height / look.fy;
  return {x0: -look.cx / look.fx - x, x1: (look.width - look.cx) / look.fx + x, y0: -look.cy / look.fy - y, y1: (look.height - look.cy) / look.fy + y};
}
