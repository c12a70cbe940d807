// SPDX-License-Identifier: Apache-2.0
// Draws splat files with Babylon.js and Spark in a headless Chromium: node viewers.mjs CHROMIUM JOBS.json
//
// JOBS.json is an array of jobs: viewer (babylon or spark), file, pictures. A picture is a camera with width, height, fx,
// fy, cx, cy (pixels), eye, right, down, forward (in the file's axes), near, and the PNGs to write. bytes is the canvas,
// which is rounded to 8 bits after each Gaussian; floats is the same in a float buffer, which is rounded once. plain uses
// Spark's defaults in place of options closest to training. Prints versions and seconds. Exits with 77 if no browser can
// be started.
import fs from 'node:fs';
import path from 'node:path';
import {launch, serve} from './chromium.mjs';
import {babylon, imports, projection, spark} from './splat_viewers.mjs';

const [chromium, jobsFile] = process.argv.slice(2);
const jobs = JSON.parse(fs.readFileSync(jobsFile, 'utf8'));

const page = `<!doctype html><style>body{margin:0}canvas{display:block}</style>
${imports}
<script type="module">
${projection}
const url = pixels => { // encodes rows of floats that begin at the bottom
  const canvas = document.createElement('canvas'), {width, height} = document.querySelector('canvas');
  canvas.width = width;
  canvas.height = height;
  const image = new ImageData(width, height);
  for (let y = 0; y < height; y++)
    for (let i = 0; i < 4 * width; i++)
      image.data[4 * width * y + i] = i % 4 === 3 ? 255 : Math.round(255 * pixels[4 * width * (height - 1 - y) + i]);
  canvas.getContext('2d').putImageData(image, 0, 0);
  return canvas.toDataURL('image/png');
};
window.run = async (job, file) => {
  const canvas = document.createElement('canvas');
  canvas.width = job.pictures[0].width;
  canvas.height = job.pictures[0].height;
  document.body.append(canvas);
  const begin = performance.now();
  const viewer = await (await import('/' + job.viewer + '.js')).open(canvas, job, file);
  for (const [index, k] of job.pictures.entries()) {
    await viewer.draw(k, projection(k, 1000));
    await window.store(index, 'bytes', canvas.toDataURL('image/png'));
    if (k.floats) await window.store(index, 'floats', url(await viewer.drawFloats()));
  }
  return {version: viewer.version, splats: viewer.splats, seconds: (performance.now() - begin) / 1000};
};
window.loaded = true;
</script>`;

const browser = await launch(chromium, {timeout: 0, protocolTimeout: 0}, ['--disable-gpu-watchdog', '--force-device-scale-factor=1']);
const script = text => ({type: 'text/javascript', text});
const server = serve({'/': {type: 'text/html', text: page}, '/babylon.js': script(babylon), '/spark.js': script(spark)}, url => {
  const job = url.match(/^\/job(\d+)\./);
  return job ? path.resolve(jobs[job[1]].file) : undefined;
});
const found = [];
try {
  for (const [index, job] of jobs.entries()) {
    const tab = await browser.newPage();
    tab.on('pageerror', error => console.error(String(error)));
    tab.on('console', line => console.error(line.text()));
    await tab.exposeFunction('store', (at, which, url) => fs.writeFileSync(job.pictures[at][which], Buffer.from(url.split(',')[1], 'base64')));
    tab.setDefaultTimeout(0);
    await tab.goto(`http://127.0.0.1:${server.address().port}/`);
    await tab.waitForFunction('window.loaded');
    found.push(await tab.evaluate((j, file) => window.run(j, file), job, `/job${index}${path.extname(job.file)}`));
    await tab.close();
  }
  console.log(JSON.stringify(found));
} finally {
  await browser.close();
  server.close();
}
