// SPDX-License-Identifier: Apache-2.0
// scene_html.mjs CHROMIUM FILE JOBS.json FOLDER: opens scene.html from disk without network, in a window and as on a
// phone, and uses it as a person would. JOBS.json has looks (views, drawn to FOLDER/NNNNN-page.png), object (number of a
// moving object, -1: none), spans (whether the scene has a time range), hostile (a page of a scene with malicious names)
// and hostileLooks (views of that scene). Prints its measurements as JSON on the last line. Exits with 77 if no browser
// can be started.
import crypto from 'node:crypto';
import fs from 'node:fs';
import path from 'node:path';
import {pathToFileURL} from 'node:url';
import {launch} from './chromium.mjs';

const [chromium, file, jobsFile, folder] = process.argv.slice(2);
const jobs = JSON.parse(fs.readFileSync(jobsFile, 'utf8')), seen = {errors: [], foreign: []};
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function open(viewport, shown = file) {
  const browser = await launch(chromium, {protocolTimeout: 0}, ['--disable-gpu-watchdog', '--force-device-scale-factor=1', '--enable-precise-memory-info']);
  const page = await browser.newPage(), requests = [];
  page.setDefaultTimeout(0);
  await page.setViewport(viewport);
  await page.setOfflineMode(true);
  page.on('pageerror', (error) => seen.errors.push(String(error)));
  page.on('console', (message) => ['error', 'warning'].includes(message.type()) && !/GPU stall due to ReadPixels|swiftshader|WebGL-/i.test(message.text()) && seen.errors.push(message.text()));
  page.on('request', (request) => !/^(blob|data):/.test(request.url()) && requests.push(request.url()));
  const session = await page.createCDPSession();
  await session.send('Browser.setDownloadBehavior', {behavior: 'allow', downloadPath: folder});
  const begun = performance.now();
  await page.goto(pathToFileURL(shown).href, {waitUntil: 'domcontentloaded'});
  await page.waitForFunction(() => document.getElementById('picture').dataset.serial || !document.getElementById('notice').textContent.startsWith('Loading'), {polling: 'raf'});
  await page.evaluate(() => { // waits until the picture is drawn, not only requested
    const gl = document.getElementById('picture').getContext('webgl2');
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  });
  const first = performance.now() - begun;
  const notice = await page.$eval('#notice', (element) => element.hidden ? '' : element.textContent);
  if (notice) seen.errors.push(notice);
  seen.foreign.push(...requests.filter((url) => url !== pathToFileURL(shown).href));
  return {browser, page, first};
}

// Waits for the sharp picture of the last view; returns the hash of a screenshot of the stage.
async function sharp(page) {
  await pause(150);
  await page.waitForFunction(() => {
    const {sharp, serial, asked} = document.getElementById('picture').dataset;
    return sharp === 'true' && serial === asked;
  }, {polling: 'raf'});
  const box = await page.$eval('#picture', ({offsetWidth, offsetHeight}) => [offsetWidth, offsetHeight]);
  const shot = await page.screenshot({clip: {x: 0, y: 60, width: Math.min(box[0], 900), height: box[1] - 60}});
  return crypto.createHash('sha1').update(shot).digest('hex');
}

// Returns memory in bytes: JavaScript's heap, and proportional set sizes of the browser's processes for pages and graphics.
async function memory(browser, page) {
  const session = await browser.target().createCDPSession(), {processInfo} = await session.send('SystemInfo.getProcessInfo');
  const sum = (wanted) => processInfo.filter(({type}) => type === wanted).reduce((all, {id}) => all + pss(id), 0);
  return {heap: await page.evaluate(() => performance.memory.usedJSHeapSize), renderer: sum('renderer'), GPU: sum('GPU')};
}

function pss(id) {
  try {
    return 1024 * Number(fs.readFileSync(`/proc/${id}/smaps_rollup`, 'utf8').match(/^Pss:\s+(\d+) kB/m)[1]);
  } catch {
    return 0;
  }
}

async function draw(page, looks, into) {
  for (const [i, look] of looks.entries()) {
    const url = await page.evaluate((asked) => window.pags.picture(asked), look);
    fs.writeFileSync(path.join(into, `${String(i).padStart(5, '0')}-page.png`), Buffer.from(url.split(',')[1], 'base64'));
  }
}

async function desktop() {
  const {browser, page, first} = await open({width: 1280, height: 720});
  seen.first = first;
  seen.start = await sharp(page);
  seen.stats = await page.$eval('#stats', (element) => element.textContent);
  await draw(page, jobs.looks, folder);
  await page.keyboard.press('KeyR');
  seen.again = await sharp(page);
  if (jobs.spans) {
    await page.$eval('#time', (slider) => { slider.value = Number(slider.min) + 0.6 * (slider.max - slider.min); slider.dispatchEvent(new Event('input')); });
    seen.scrubbed = await sharp(page);
    seen.clock = await page.$eval('#clock', (clock) => clock.value);
    await page.keyboard.press('Space');
    await pause(900);
    await page.keyboard.press('Space');
    await sharp(page);
    seen.played = await page.$eval('#clock', (clock) => clock.value);
    await page.keyboard.press('KeyR');
    await sharp(page);
  }
  await page.mouse.click(480, 500);
  await page.waitForFunction(() => /deep, at|Nothing/.test(document.getElementById('picked').textContent));
  seen.picked = await page.$eval('#picked', (element) => element.textContent);
  await page.keyboard.press('Digit1');
  await sharp(page);
  const count = await page.$eval('#picture', (canvas) => Number(canvas.dataset.count)), begun = performance.now();
  await page.mouse.move(400, 300);
  await page.mouse.down();
  for (let i = 1; i <= 30; i++) {
    await page.mouse.move(400 + 6 * i, 300 + i);
    await pause(30);
  }
  await page.mouse.up();
  seen.rate = (await page.$eval('#picture', (canvas) => Number(canvas.dataset.count)) - count) / (performance.now() - begun) * 1000;
  seen.orbited = await sharp(page);
  if (jobs.object >= 0) {
    await page.evaluate((index) => document.querySelector(`#objects tr[data-index="${index}"] .label`).click(), jobs.object);
    seen.object = await sharp(page);
    await page.screenshot({path: path.join(folder, 'desktop.jpg'), type: 'jpeg', quality: 72});
    await page.keyboard.press('KeyH');
    seen.hidden = await sharp(page);
    await page.keyboard.press('KeyU');
    seen.shown = await sharp(page);
    await page.keyboard.press('KeyI');
    seen.solo = await sharp(page);
    await page.keyboard.press('KeyU');
  }
  await page.keyboard.press('KeyR');
  await sharp(page);
  await page.keyboard.press('KeyP');
  const saved = () => fs.readdirSync(folder).filter((name) => name.endsWith('.png') && !name.endsWith('-page.png')).length;
  for (let i = 0; i < 600 && !saved(); i++) await pause(50);
  seen.saved = saved();
  await page.screenshot({path: path.join(folder, 'desktop-start.jpg'), type: 'jpeg', quality: 72});
  await page.keyboard.press('?');
  seen.help = await page.$eval('#help', (dialog) => dialog.open);
  const errors = seen.errors.length;
  seen.network = await page.evaluate(async () => { // requests that the content policy forbids
    const tries = [() => fetch('https://example.org/'), () => fetch('data:text/plain,x'), () => new Promise((done, fail) => { const image = new Image(); image.onload = done; image.onerror = fail; image.src = 'https://example.org/x.png'; }),
      () => { const script = document.createElement('script'); script.textContent = 'window.injected = true'; document.head.append(script); if (!window.injected) throw new Error('refused'); }];
    let passed = 0;
    for (const attempt of tries) await Promise.resolve().then(attempt).then(() => passed++, () => 0);
    return passed;
  });
  seen.refused = seen.errors.splice(errors).length; // the browser's messages about forbidden requests
  seen.memory = await memory(browser, page);
  await browser.close();
}

async function phone() {
  const {browser, page, first} = await open({width: 390, height: 780, deviceScaleFactor: 2, isMobile: true, hasTouch: true});
  seen.phoneFirst = first;
  const before = await sharp(page);
  await page.screenshot({path: path.join(folder, 'phone.jpg'), type: 'jpeg', quality: 72});
  const finger = await page.touchscreen.touchStart(150, 300);
  for (let i = 1; i <= 10; i++) {
    await finger.move(150 + 10 * i, 300);
    await pause(30);
  }
  await finger.end();
  seen.touched = (await sharp(page)) !== before;
  seen.overflow = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  await page.click('#panel-toggle');
  await pause(300);
  await sharp(page);
  await page.screenshot({path: path.join(folder, 'phone-panel.jpg'), type: 'jpeg', quality: 72});
  seen.small = await page.$$eval('#bar button, #bar select', (all) => all.filter((b) => b.offsetParent && (b.getBoundingClientRect().height < 36 || b.getBoundingClientRect().right > innerWidth + 1)).map((b) => b.id || b.textContent));
  seen.phoneMemory = await memory(browser, page);
  await browser.close();
}

// Names that a careless page would run as code are shown as text. The scene has every feature of scenes.
async function hostile() {
  const {browser, page} = await open({width: 1280, height: 720}, jobs.hostile);
  seen.listed = await page.$$eval('#objects .label', (labels) => labels.map((label) => label.textContent));
  seen.injected = await page.evaluate(() => Boolean(window.injected) || document.querySelectorAll('#panel img, #panel b, #panel i').length > 0);
  await draw(page, jobs.hostileLooks, path.join(folder, 'hostile'));
  await browser.close();
}

await desktop();
await phone();
await hostile();
console.log(JSON.stringify(seen));
