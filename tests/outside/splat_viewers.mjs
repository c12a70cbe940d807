// SPDX-License-Identifier: Apache-2.0
// Pages that draw a splat file by Babylon.js, Spark, PlayCanvas or GaussianSplats3D. The function open(canvas, job, url)
// of each module returns draw(k, projection), which draws a camera's view and waits until the splats are sorted; again(),
// which draws it once more; version; and splats. Babylon.js and Spark also have drawFloats(), which returns the pixels of
// a float buffer. viewers.mjs describes a camera k.

// The modules' imports, and OpenGL's projection of a camera.
export const imports = `<script type="importmap">{"imports":{"@babylonjs/core/":"/node_modules/@babylonjs/core/","@babylonjs/loaders/":"/node_modules/@babylonjs/loaders/",
"three":"/node_modules/three/build/three.module.js","three/addons/":"/node_modules/three/examples/jsm/","fflate":"/node_modules/fflate/esm/browser.js"}}</script>`;

export const projection = `// OpenGL's projection of a camera whose pixel x, y has its centre at x + 0.5, y + 0.5; by columns
const projection = (k, far) => [2 * k.fx / k.width, 0, 0, 0, 0, 2 * k.fy / k.height, 0, 0, 1 - 2 * k.cx / k.width, 2 * k.cy / k.height - 1,
  -(far + k.near) / (far - k.near), -1, 0, 0, -2 * far * k.near / (far - k.near), 0];`;

export const babylon = `
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
    for (const mesh of meshes) mesh.scaling.set(1, 1, 1); // undoes the loader's flip of y: here the file's axes are the world's
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
      scene.render(); // a worker sorts the splats
      await new Promise(done => setTimeout(done, 1));
    } while (!meshes.every(mesh => mesh._isDepthSortSettled));
    scene.render();
  };
  const drawFloats = async () => {
    camera.outputRenderTarget = target;
    scene.render();
    return await target.readPixels();
  };
  const again = () => scene.render();
  return {draw, again, drawFloats, version: Engine.Version, splats: meshes.map(mesh => mesh.splatCount)};
};`;

export const spark = `
import * as THREE from 'three';
import {SparkRenderer, SplatMesh, SplatFileType} from '/node_modules/@sparkjsdev/spark/dist/spark.module.js';

export const open = async (canvas, job, url) => {
  THREE.ColorManagement.workingColorSpace = THREE.SRGBColorSpace; // blends colours without conversion, also in float buffers
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
    while (sparks.sorting || sparks.sortDirty) await new Promise(done => setTimeout(done, 1));
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
  const again = () => renderer.render(scene, camera);
  return {draw, again, drawFloats, version: THREE.REVISION, splats: [mesh.numSplats]};
};`;


export const playcanvas = `
import * as pc from '/node_modules/playcanvas/build/playcanvas.min.mjs';

export const open = async (canvas, job, url) => {
  const device = await pc.createGraphicsDevice(canvas, {deviceTypes: ['webgl2'], antialias: false, alpha: false, preserveDrawingBuffer: true});
  device.maxPixelRatio = 1;
  const options = new pc.AppOptions();
  options.graphicsDevice = device;
  options.componentSystems = [pc.CameraComponentSystem, pc.GSplatComponentSystem];
  options.resourceHandlers = [pc.GSplatHandler, pc.BinaryHandler];
  const app = new pc.AppBase(canvas);
  app.init(options);
  app.setCanvasFillMode(pc.FILLMODE_NONE);
  app.setCanvasResolution(pc.RESOLUTION_FIXED, canvas.width, canvas.height);
  app.start();
  app.autoRender = false;
  const asset = new pc.Asset('splats', 'gsplat', {url, filename: 'splats.ply'});
  app.assets.add(asset);
  await new Promise((done, failed) => {
    asset.once('load', done);
    asset.once('error', error => failed(new Error(error)));
    app.assets.load(asset);
  });
  const splats = new pc.Entity();
  splats.addComponent('gsplat', {asset});
  app.root.addChild(splats);
  const camera = new pc.Entity();
  camera.addComponent('camera', {clearColor: new pc.Color(0, 0, 0, 1)});
  app.root.addChild(camera);
  let ready = false;
  app.systems.gsplat.on('frame:ready', (_camera, _layer, sorted, loading) => { ready = sorted && !loading; });
  const again = () => {
    app.renderNextFrame = true;
    app.tick(performance.now());
  };
  const draw = async (k, projection) => {
    const up = k.down.map(v => -v), back = k.forward.map(v => -v);
    const axes = new pc.Mat4();
    axes.data.set([...k.right, 0, ...up, 0, ...back, 0, 0, 0, 0, 1]);
    camera.setPosition(...k.eye);
    camera.setRotation(new pc.Quat().setFromMat4(axes));
    camera.camera.nearClip = k.near;
    camera.camera.calculateProjection = matrix => { matrix.data.set(projection); };
    for (let drawn = 0; drawn < 2 || !ready; drawn++) {
      again();
      await new Promise(done => setTimeout(done, 1)); // a worker sorts
    }
    again();
  };
  return {draw, again, version: pc.version, splats: [asset.resource.gsplatData.numSplats]};
};`;

export const splats3d = `
import * as THREE from 'three';
import * as GS from '/modules/@mkkellogg/gaussian-splats-3d/build/gaussian-splats-3d.module.js';

export const open = async (canvas, job, url) => {
  const renderer = new THREE.WebGLRenderer({canvas, antialias: false, alpha: false, preserveDrawingBuffer: true});
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace; // writes colours without conversion
  renderer.setPixelRatio(1);
  renderer.setSize(canvas.width, canvas.height, false);
  renderer.setClearColor(0x000000, 1);
  const camera = new THREE.PerspectiveCamera();
  const viewer = new GS.Viewer({selfDrivenMode: false, useBuiltInControls: false, renderer, camera, sharedMemoryForWorkers: false,
    gpuAcceleratedSort: false, sphericalHarmonicsDegree: 2, sceneRevealMode: GS.SceneRevealMode.Instant, optimizeSplatData: false});
  await viewer.addSplatScene(url, {format: GS.SceneFormat.Ply, showLoadingUI: false, progressiveLoad: false, splatAlphaRemovalThreshold: 0});
  const again = () => viewer.render();
  const draw = async (k, projection) => {
    camera.position.fromArray(k.eye);
    camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(new THREE.Vector3(...k.right),
      new THREE.Vector3(...k.down).negate(), new THREE.Vector3(...k.forward).negate()));
    camera.near = k.near;
    camera.projectionMatrix.fromArray(projection);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    camera.updateMatrixWorld();
    while (viewer.sortRunning) await new Promise(done => setTimeout(done, 1));
    await viewer.runSplatSort(true, true);
    await viewer.sortPromise;
    viewer.update();
    viewer.render();
  };
  return {draw, again, version: '', splats: [viewer.getSplatMesh().getSplatCount()]};
};`;
