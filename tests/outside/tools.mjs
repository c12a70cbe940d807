// SPDX-License-Identifier: Apache-2.0
// node tools.mjs CHROMIUM FILE.glb JOB.json: loads a GLB of proxies by Babylon.js in a headless Chromium.
//
// JOB.json has seconds (the time in the animation), rays (name to {from, along}, in Babylon's right-handed world with y
// up, in metres), and for a picture also picture (a file), eye and target. Prints as JSON all nodes with the extras that
// Babylon keeps and their positions at that time, the animations, and the first hit of each ray. Exits with 77 if no
// browser can be started.
import fs from 'node:fs';
import {show} from './chromium.mjs';

const [chromium, file, jobFile] = process.argv.slice(2);
const job = JSON.parse(fs.readFileSync(jobFile, 'utf8'));

const page = `<!doctype html><style>body{margin:0}canvas{display:block}</style><canvas id="c" width="640" height="360"></canvas>
<script type="importmap">{"imports":{"@babylonjs/core/":"/node_modules/@babylonjs/core/"}}</script>
<script type="module">
import {Engine} from '@babylonjs/core/Engines/engine.js';
import {Scene} from '@babylonjs/core/scene.js';
import {FreeCamera} from '@babylonjs/core/Cameras/freeCamera.js';
import {HemisphericLight} from '@babylonjs/core/Lights/hemisphericLight.js';
import {Color4} from '@babylonjs/core/Maths/math.color.js';
import {Vector3} from '@babylonjs/core/Maths/math.vector.js';
import {Ray} from '@babylonjs/core/Culling/ray.js';
import {AppendSceneAsync} from '@babylonjs/core/Loading/sceneLoader.js';
import {SceneLoaderFlags} from '@babylonjs/core/Loading/sceneLoaderFlags.js';
import '@babylonjs/core/Animations/animatable.js';
import '/node_modules/@babylonjs/loaders/glTF/index.js';
const job = ${JSON.stringify(job)};
SceneLoaderFlags.ShowLoadingScreen = false; // the loading screen would cover the picture
try {
  const engine = new Engine(document.getElementById('c'), true, {preserveDrawingBuffer: true});
  const scene = new Scene(engine);
  scene.useRightHandedSystem = true;
  scene.clearColor = new Color4(0.75, 0.8, 0.85, 1);
  new HemisphericLight('light', new Vector3(0.3, 1, 0.4), scene).intensity = 1.3;
  const camera = new FreeCamera('camera', Vector3.FromArray(job.eye ?? [0, 2, 10]), scene);
  camera.setTarget(Vector3.FromArray(job.target ?? [0, 0, 0]));
  camera.minZ = 0.1;
  const before = new Set([...scene.meshes, ...scene.transformNodes]);
  await AppendSceneAsync('/file.glb', scene);
  await scene.whenReadyAsync();
  for (const group of scene.animationGroups) {
    const perSecond = group.targetedAnimations[0].animation.framePerSecond;
    group.start(false);
    group.pause();
    group.goToFrame(Math.min(job.seconds * perSecond, group.to));
  }
  scene.render();
  const nodes = [...scene.meshes, ...scene.transformNodes].filter(node => !before.has(node)).map(node => ({
    name: node.name, parent: node.parent?.name ?? null, extras: node.metadata?.gltf?.extras ?? null,
    at: node.computeWorldMatrix(true) && node.getAbsolutePosition().asArray(),
    triangles: node.getTotalIndices ? node.getTotalIndices() / 3 : 0
  }));
  const hits = {};
  for (const [name, ray] of Object.entries(job.rays)) {
    const hit = scene.pickWithRay(new Ray(Vector3.FromArray(ray.from), Vector3.FromArray(ray.along), 1000));
    hits[name] = hit.hit ? {name: hit.pickedMesh.name, distance: hit.distance} : null;
  }
  window.done = {version: Engine.Version, nodes, hits, animations: scene.animationGroups.map(g => g.name)};
} catch (error) {
  window.done = {error: String(error && error.stack || error)};
}
</script>`;

await show(chromium, page, file, {width: 640, height: 360}, async canvas => {
  if (job.picture) fs.writeFileSync(job.picture, await canvas.screenshot({type: 'jpeg', quality: 80}));
});
