// SPDX-License-Identifier: Apache-2.0
// Draws a GLB of splats with Babylon.js in a headless Chromium: node babylon.mjs CHROMIUM FILE.glb CAMERA.json PICTURE.png
//
// CAMERA.json: width, height, fx, fy, cx, cy (pixels), eye, forward, up (in the file's axes, y up), background (0..1).
// Prints Babylon's version and the number of splats of each mesh. Exits with 77 if no browser can be started.
import fs from 'node:fs';
import {show} from './chromium.mjs';

const [chromium, file, cameraFile, picture] = process.argv.slice(2);
const camera = JSON.parse(fs.readFileSync(cameraFile, 'utf8'));

const page = `<!doctype html><style>body{margin:0}canvas{display:block}</style><canvas id="c"></canvas>
<script type="importmap">{"imports":{"@babylonjs/core/":"/node_modules/@babylonjs/core/"}}</script>
<script type="module">
import {Engine} from '@babylonjs/core/Engines/engine.js';
import {Scene} from '@babylonjs/core/scene.js';
import {FreeCamera} from '@babylonjs/core/Cameras/freeCamera.js';
import {Color4} from '@babylonjs/core/Maths/math.color.js';
import {Matrix, Vector3} from '@babylonjs/core/Maths/math.vector.js';
import {AppendSceneAsync} from '@babylonjs/core/Loading/sceneLoader.js';
import '@babylonjs/core/Loading/loadingScreen.js';
import '/node_modules/@babylonjs/loaders/glTF/index.js';
const k = ${JSON.stringify(camera)};
const canvas = document.getElementById('c');
canvas.width = k.width;
canvas.height = k.height;
try {
  const engine = new Engine(canvas, false, {preserveDrawingBuffer: true});
  const scene = new Scene(engine);
  scene.useRightHandedSystem = true;
  scene.clearColor = new Color4(...k.background, 1);
  scene.imageProcessingConfiguration.isEnabled = false;
  const eye = Vector3.FromArray(k.eye);
  const seen = new FreeCamera('seen', eye, scene);
  seen.upVector = Vector3.FromArray(k.up);
  seen.setTarget(eye.add(Vector3.FromArray(k.forward)));
  seen.minZ = 0.05;
  seen.maxZ = 1000;
  const near = seen.minZ, far = seen.maxZ;
  const left = -k.cx / k.fx * near, right = (k.width - k.cx) / k.fx * near;
  const top = k.cy / k.fy * near, bottom = -(k.height - k.cy) / k.fy * near;
  const m = [2 * near / (right - left), 0, 0, 0, 0, 2 * near / (top - bottom), 0, 0, (right + left) / (right - left),
    (top + bottom) / (top - bottom), -(far + near) / (far - near), -1, 0, 0, -2 * far * near / (far - near), 0];
  seen.freezeProjectionMatrix(Matrix.FromArray(m));
  await AppendSceneAsync('/file.glb', scene);
  await scene.whenReadyAsync();
  scene.activeCamera = seen;
  const splats = scene.meshes.filter(mesh => mesh.getClassName() === 'GaussianSplattingMesh');
  for (let frame = 0, begin = performance.now(); frame < 8 || performance.now() - begin < 3000; frame++) {
    scene.render(); // a worker sorts the splats and sends no message at its end
    await new Promise(done => setTimeout(done, 50));
  }
  window.done = {version: Engine.Version, webgl: engine.webGLVersion, splats: splats.map(mesh => mesh.splatCount)};
} catch (error) {
  window.done = {error: String(error && error.stack || error)};
}
</script>`;

await show(chromium, page, file, {width: camera.width, height: camera.height}, async canvas => fs.writeFileSync(picture, await canvas.screenshot()));
