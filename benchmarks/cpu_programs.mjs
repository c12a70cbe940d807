// SPDX-License-Identifier: Apache-2.0
// cpu_programs.mjs CHROMIUM JOB.json: draws one view of a splat file with a viewer in a headless Chromium that has no graphics card, and times it.
//
// JOB.json: viewer (babylon, spark, playcanvas, splats3d), file, modules (a folder of further node modules), driver (swiftshader or llvmpipe),
// camera and moved (cameras as tests/outside/viewers.mjs takes them), frames, and picture, the PNG to write of what the canvas shows. Prints JSON:
// milliseconds of each frame drawn again (ms), of each picture after the camera moved there, sorted and drawn (moved), what draws (driver), its
// version, the viewer's, the browser's and the number of splats. Pixels are read back after each frame, so that it is finished. Exits with 77 where
// no browser can be started or it draws by another driver.
import fs from 'node:fs';
import path from 'node:path';
import {launch, serve} from '../tests/outside/chromium.mjs';
import * as viewers from '../tests/outside/splat_viewers.mjs';

const [chromium, jobFile] = process.argv.slice(2);
const job = JSON.parse(fs.readFileSync(jobFile, 'utf8'));

const page = `<!doctype html><style>body{margin:0}canvas{display:block}</style>
${viewers.imports}
<script type="module">
${viewers.projection}
window.run = async job => {
  const canvas = document.createElement('canvas');
  canvas.width = job.camera.width;
  canvas.height = job.camera.height;
  document.body.append(canvas);
  const viewer = await (await import('/viewer.js')).open(canvas, job, '/scene' + job.extension);
  const gl = canvas.getContext('webgl2'), pixel = new Uint8Array(4), info = gl.getExtension('WEBGL_debug_renderer_info');
  const finish = () => {
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  };
  const timed = async draw => {
    const begin = performance.now();
    await draw();
    finish();
    return performance.now() - begin;
  };
  const see = k => viewer.draw(k, projection(k, 1000));
  await timed(() => see(job.moved)); // compiles the shaders
  const moved = [], ms = [], begin = performance.now(), within = seconds => performance.now() - begin < 1000 * seconds;
  for (let i = 0; i < 3 && (i === 0 || within(8)); i++) {
    await timed(() => see(job.moved));
    moved.push(await timed(() => see(job.camera)));
  }
  for (let i = 0; i < job.frames && (i < 3 || within(20)); i++) ms.push(await timed(viewer.again));
  const picture = canvas.toDataURL('image/png');
  return {ms, moved, picture, driver: gl.getParameter(info.UNMASKED_RENDERER_WEBGL), version: viewer.version, splats: viewer.splats};
};
window.loaded = true;
</script>`;

const flags = {swiftshader: [], llvmpipe: ['--use-angle=gl-egl', '--disable-vulkan']}[job.driver]; // the last --use-angle counts
const browser = await launch(chromium, {timeout: 0, protocolTimeout: 0}, ['--disable-gpu-watchdog', '--force-device-scale-factor=1', ...flags]);
const script = text => ({type: 'text/javascript', text});
const server = serve({'/': {type: 'text/html', text: page}, '/viewer.js': script(viewers[job.viewer])}, url => {
  if (url.startsWith('/scene.')) return path.resolve(job.file);
  return url.startsWith('/modules/') ? path.join(job.modules, path.normalize(url.slice('/modules/'.length))) : undefined;
});
try {
  const tab = await browser.newPage();
  tab.on('pageerror', error => console.error(String(error)));
  tab.on('console', line => console.error(line.text()));
  tab.setDefaultTimeout(0);
  await tab.goto(`http://127.0.0.1:${server.address().port}/`);
  await tab.waitForFunction('window.loaded');
  const {picture, ...found} = await tab.evaluate(j => window.run(j), {...job, extension: path.extname(job.file)});
  if (!found.driver.toLowerCase().includes(job.driver)) {
    console.error(`${job.driver} was asked for, ${found.driver} draws`);
    process.exitCode = 77;
  } else {
    fs.writeFileSync(job.picture, Buffer.from(picture.split(',')[1], 'base64'));
    console.log(JSON.stringify({...found, browser: await browser.version()}));
  }
} finally {
  await browser.close();
  server.close();
}
