// SPDX-License-Identifier: Apache-2.0
// Draws splat files with Babylon.js and Spark in a headless Chromium: node viewers.mjs CHROMIUM JOBS.json
//
// JOBS.json is an array of jobs: viewer (babylon or spark), file, pictures. A picture is a camera: width, height, fx, fy, cx, cy (pixels),
// eye, right, down, forward (axes of the file), near, and the PNGs to write: bytes is what the canvas shows, which is rounded to 8 bits after
// each Gaussian, floats the same drawn into a buffer of floats, which is rounded once. plain: Spark's own choices in place of those nearest to
// 3D Gaussian splatting as it is trained. Prints versions and seconds. Exits with 77 where no browser can be started.
import fs from 'node:fs';
import path from 'node:path';
import {launch, serve} from './chromium.mjs';

const [chromium, jobsFile] = process.argv.slice(2);
const jobs = JSON.parse(fs.readFileSync(jobsFile, 'utf8'));

const babylon = `
import {Engine} from '@babylonjs/core/Engines/engine.js';
import {Scene} from '@babylonjs/core/scene.js';
import {FreeCamera} from '@babylonjs/core/Cameras/freeCamera.js';
import {Color4} from '@babylonjs/core/Maths/math.color.js';
import {Matrix, Vector3} from '@babylonjs/core/Maths/math.vector.js';
import {AppendSceneAsync} from '@babylonjs/core/Loading/sceneLoader.js';
import {RenderTargetTexture} from '@babylonjs/core/Materials/Textures/renderTargetTexture.js';
import {ShaderStore} from '@babylonjs/core/Engines/shaderStore.js';
import '@babylonjs/core/Loading/loadingScreen.js';
import '@babylonjs/loaders/glTF/index.js';
import '@babylonjs/loaders/SPLAT/index.js';
import * as fflate from '/node_modules/fflate/esm/browser.js';

export const open = async (canvas, job, url) => {
  const engine = new Engine(canvas, false, {preserveDrawingBuffer: true, alpha: false});
  const scene = new Scene(engine);
  scene.useRightHandedSystem = true;
  scene.clearColor = new Color4(0, 0, 0, 1);
  scene.imageProcessingConfiguration.isEnabled = false;
  const camera = new FreeCamera('seen', Vector3.Zero(), scene);
  const splat = {fflate, spzLibraryUrl: location.origin + '/node_modules/@adobe/spz/dist/spz.js', useSogTextures: !job.plain};
  await AppendSceneAsync(url, scene, {pluginOptions: {splat}});
  await scene.whenReadyAsync();
  scene.activeCamera = camera;
  const meshes = scene.meshes.filter(mesh => mesh.getClassName() === 'GaussianSplattingMesh');
  if (!url.endsWith('.glb'))
    for (const mesh of meshes) mesh.scaling.set(1, 1, 1); // the loader turns y round; here the file's own axes are the world's
  const {width, height} = canvas;
  const target = new RenderTargetTexture('floats', {width, height}, scene, {type: Engine.TEXTURETYPE_FLOAT});
  const draw = async (k, projection) => {
    camera.position = Vector3.FromArray(k.eye);
    camera.upVector = Vector3.FromArray(k.down).scale(-1);
    camera.setTarget(camera.position.add(Vector3.FromArray(k.forward)));
    camera.minZ = k.near;
    camera.freezeProjectionMatrix(Matrix.FromArray(projection));
    camera.outputRenderTarget = null;
    do {
      scene.render(); // a worker sorts them
      await new Promise(done => setTimeout(done, 30));
    } while (!meshes.every(mesh => mesh._isDepthSortSettled));
    scene.render();
  };
  const drawFloats = async () => {
    camera.outputRenderTarget = target;
    scene.render();
    return await target.readPixels();
  };
  return {draw, drawFloats, version: Engine.Version, splats: meshes.map(mesh => mesh.splatCount)};
};`;

const spark = `
import * as THREE from 'three';
import {SparkRenderer, SplatMesh, SplatFileType} from '/node_modules/@sparkjsdev/spark/dist/spark.module.js';

export const open = async (canvas, job, url) => {
  THREE.ColorManagement.workingColorSpace = THREE.SRGBColorSpace; // colours are blended as they are, in buffers of floats, too
  const renderer = new THREE.WebGLRenderer({canvas, antialias: false, alpha: false, preserveDrawingBuffer: true});
  renderer.setPixelRatio(1);
  renderer.setSize(canvas.width, canvas.height, false);
  renderer.setClearColor(0x000000, 1);
  const scene = new THREE.Scene();
  const trained = {preBlurAmount: 0.3, blurAmount: 0, maxStdDev: Math.sqrt(2 * Math.log(255)), minAlpha: 1 / 255, sortRadial: false, clipXY: 3,
    maxPixelRadius: 4096, accumExtSplats: true};
  const sparks = new SparkRenderer({renderer, enableLod: false, ...(job.plain ? {} : trained), ...job.options});
  scene.add(sparks);
  const bytes = new Uint8Array(await (await fetch(url)).arrayBuffer());
  const mesh = new SplatMesh({fileBytes: bytes, fileType: url.endsWith('.sog') ? SplatFileType.PCSOGSZIP : undefined, fileName: url, extSplats: !job.plain});
  await mesh.initialized;
  scene.add(mesh);
  const camera = new THREE.PerspectiveCamera();
  const target = new THREE.WebGLRenderTarget(canvas.width, canvas.height, {type: THREE.FloatType});
  const draw = async (k, projection) => {
    camera.position.fromArray(k.eye);
    const axes = new THREE.Matrix4().makeBasis(new THREE.Vector3(...k.right), new THREE.Vector3(...k.down).negate(), new THREE.Vector3(...k.forward).negate());
    camera.quaternion.setFromRotationMatrix(axes);
    camera.near = k.near;
    camera.projectionMatrix.fromArray(projection);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    camera.updateMatrixWorld();
    await sparks.update({scene, camera});
    while (sparks.sorting || sparks.sortDirty) await new Promise(done => setTimeout(done, 30));
    sparks.autoUpdate = false;
    renderer.setRenderTarget(null);
    renderer.render(scene, camera);
  };
  const drawFloats = () => {
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    const pixels = new Float32Array(4 * canvas.width * canvas.height);
    renderer.readRenderTargetPixels(target, 0, 0, canvas.width, canvas.height, pixels);
    return pixels;
  };
  return {draw, drawFloats, version: THREE.REVISION, splats: [mesh.numSplats]};
};`;

const page = `<!doctype html><style>body{margin:0}canvas{display:block}</style>
<script type="importmap">{"imports":{"@babylonjs/core/":"/node_modules/@babylonjs/core/","@babylonjs/loaders/":"/node_modules/@babylonjs/loaders/",
"three":"/node_modules/three/build/three.module.js","three/addons/":"/node_modules/three/examples/jsm/","fflate":"/node_modules/fflate/esm/browser.js"}}</script>
<script type="module">
// OpenGL's projection of a camera whose pixel x, y has its centre at x + 0.5, y + 0.5; by columns
const projection = (k, far) => [2 * k.fx / k.width, 0, 0, 0, 0, 2 * k.fy / k.height, 0, 0, 1 - 2 * k.cx / k.width, 2 * k.cy / k.height - 1,
  -(far + k.near) / (far - k.near), -1, 0, 0, -2 * far * k.near / (far - k.near), 0];
const url = pixels => { // of rows of floats from below
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
