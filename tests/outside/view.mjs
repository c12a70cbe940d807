// SPDX-License-Identifier: Apache-2.0
// view.mjs CHROMIUM URL FOLDER: uses the page of pags view as a person would, on a desktop and on a phone. Prints its
// observations as JSON on the last line, and writes screenshots, saved pictures and a recorded path into FOLDER.
import crypto from 'node:crypto';
import fs from 'node:fs';
import path from 'node:path';
import {launch} from './chromium.mjs';

const [chromium, url, folder] = process.argv.slice(2);
const origin = new URL(url).origin, seen = {errors: [], foreign: []};
const browser = await launch(chromium, {acceptInsecureCerts: false});
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function open(viewport) {
  const page = await browser.newPage();
  await page.setViewport(viewport);
  page.on('pageerror', (error) => seen.errors.push(String(error)));
  page.on('console', (message) => message.type() === 'error' && seen.errors.push(message.text()));
  page.on('request', (request) => !/^(blob|data):/.test(request.url()) && !request.url().startsWith(origin) && seen.foreign.push(request.url()));
  const session = await page.createCDPSession();
  await session.send('Browser.setDownloadBehavior', {behavior: 'allow', downloadPath: folder});
  const begun = performance.now();
  await page.goto(url, {waitUntil: 'domcontentloaded'});
  await page.waitForFunction(() => document.getElementById('picture').dataset.serial, {polling: 'raf', timeout: 60000});
  return [page, performance.now() - begun];
}

// Waits for the sharp picture of the last view; returns the hash of its pixels.
async function sharp(page) {
  await pause(150); // waits until the page has sent its request
  await page.waitForFunction(() => {
    const {sharp, serial, asked} = document.getElementById('picture').dataset;
    return sharp === 'true' && serial === asked;
  }, {polling: 'raf', timeout: 60000});
  const pixels = await page.$eval('#picture', (canvas) => canvas.toDataURL());
  return crypto.createHash('sha1').update(pixels).digest('hex');
}

async function drag(page, from, by, steps = 20) {
  const latencies = [];
  await page.mouse.move(...from);
  await page.mouse.down();
  for (let i = 1; i <= steps; i++) {
    await page.mouse.move(from[0] + (by[0] * i) / steps, from[1] + (by[1] * i) / steps);
    await pause(30);
    latencies.push(Number(await page.$eval('#picture', (canvas) => canvas.dataset.latency)));
  }
  await page.mouse.up();
  return latencies;
}

async function downloaded(name) {
  for (let i = 0; i < 200; i++) {
    const files = fs.readdirSync(folder).filter((file) => file.endsWith(name));
    if (files.length) return path.join(folder, files[0]);
    await pause(50);
  }
  throw new Error(`no ${name} was saved`);
}

async function savePicture(page, as) {
  await page.click('#save');
  fs.renameSync(await downloaded('scene.png'), path.join(folder, as));
}

const text = (page, id) => page.$eval(id, (element) => element.value || element.textContent);

try {
  const [page, first] = await open({width: 1280, height: 720});
  seen.first = first;
  seen.address = page.url();
  seen.start = await sharp(page);
  seen.stats = await text(page, '#stats');

  await page.keyboard.press('Digit1');
  await page.keyboard.press('KeyF');
  await sharp(page);
  seen.latencies = await drag(page, [400, 300], [150, 20]);
  seen.orbited = await sharp(page);

  await page.keyboard.press('KeyR');
  seen.again = await sharp(page);
  await page.$eval('#time', (slider) => { slider.value = Number(slider.min) + 0.6 * (slider.max - slider.min); slider.dispatchEvent(new Event('input')); });
  seen.scrubbed = await sharp(page);
  seen.clock = await text(page, '#clock');
  await page.keyboard.press('Space');
  await pause(700);
  await page.keyboard.press('Space');
  await sharp(page);
  seen.played = await text(page, '#clock');
  await page.keyboard.press('KeyR');
  await sharp(page);

  await page.mouse.click(480, 560);
  await page.waitForFunction(() => /deep, at/.test(document.getElementById('picked').textContent), {timeout: 20000});
  seen.picked = await text(page, '#picked');
  await page.keyboard.press('KeyB');
  await page.screenshot({path: path.join(folder, 'desktop.jpg'), type: 'jpeg', quality: 70});
  await page.keyboard.press('KeyB');

  await page.click('#measure');
  await page.mouse.click(420, 600);
  await page.waitForFunction(() => /second/.test(document.getElementById('picked').textContent), {timeout: 20000});
  await page.mouse.click(560, 600);
  await page.waitForFunction(() => / m$/.test(document.getElementById('picked').textContent), {timeout: 20000});
  seen.measured = await text(page, '#picked');
  await page.click('#measure');

  await page.keyboard.press('BracketRight');
  seen.view = await sharp(page);
  await page.select('#channel', 'photograph');
  seen.photograph = await sharp(page);
  await page.select('#channel', 'difference');
  seen.difference = await sharp(page);
  seen.psnr = await text(page, '#psnr');
  seen.viewName = await page.$eval('#views', (list) => list.selectedOptions[0].textContent);
  for (const channel of ['depth', 'priority', 'critical', 'object', 'size', 'color']) {
    await page.select('#channel', channel);
    seen[channel] = await sharp(page);
  }

  // Compares: the photograph covers the left half.
  const halves = () => page.$eval('#picture', (canvas) => [0, 0.6].map((x) => {
    const pixels = canvas.getContext('2d').getImageData(Math.round(x * canvas.width), 0, Math.round(0.4 * canvas.width), canvas.height).data;
    return pixels.reduce((sum, value, i) => (31 * sum + value * (1 + (i % 7))) % 1000000007, 7);
  }));
  const wipe = async (share) => {
    await page.$eval('#wipe', (slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }, share);
    await pause(500); // the photograph arrives first
    await sharp(page);
    return halves();
  };
  seen.wiped = [await wipe(0), await wipe(0.5)];
  await page.screenshot({path: path.join(folder, 'wipe.jpg'), type: 'jpeg', quality: 70});
  seen.wiped.push(await wipe(0));

  // Draws the same picture without Early-Z.
  await page.click('#early-z');
  seen.without = await sharp(page);
  seen.withoutStats = await text(page, '#stats');
  await page.click('#early-z');
  await sharp(page);

  // Looks at the object with the most Gaussians, hides it and isolates it.
  await page.click('#show-boxes');
  await page.evaluate(() => {
    const rows = [...document.getElementById('objects').rows], count = (row) => scene_count(row.cells[2].textContent);
    function scene_count(value) { return parseFloat(value) * (value.endsWith('k') ? 1000 : value.endsWith('M') ? 1e6 : 1); }
    rows.sort((a, b) => count(b) - count(a))[0].id = 'largest';
    document.querySelector('#largest .label').click();
  });
  seen.object = await sharp(page);
  await page.$eval('#largest input', (box) => box.click());
  seen.hidden = await sharp(page);
  await page.$eval('#largest input', (box) => box.click());
  await page.$eval('#largest .solo', (button) => button.click());
  seen.solo = await sharp(page);
  await page.$eval('#show-all', (button) => button.click());
  seen.shown = await sharp(page);
  await page.click('#show-boxes');

  // Records a path of two cameras.
  await page.keyboard.press('KeyR');
  await sharp(page);
  await page.keyboard.press('Digit2');
  await sharp(page);
  await page.keyboard.press('KeyK');
  await savePicture(page, 'first.png');
  await page.mouse.move(400, 300);
  await drag(page, [400, 300], [60, 10]);
  await page.keyboard.down('KeyW');
  await pause(250);
  await page.keyboard.up('KeyW');
  await sharp(page);
  await page.keyboard.press('KeyK');
  await savePicture(page, 'last.png');
  await page.click('#key-save');
  fs.renameSync(await downloaded('path.json'), path.join(folder, 'recorded-path.txt'));
  seen.keys = await text(page, '#keys');
  await page.keyboard.press('?');
  seen.help = await page.$eval('#help', (dialog) => dialog.open);
  await page.close();

  const [phone] = await open({width: 390, height: 780, deviceScaleFactor: 2, isMobile: true, hasTouch: true});
  await sharp(phone);
  await phone.screenshot({path: path.join(folder, 'phone.jpg'), type: 'jpeg', quality: 70});
  const before = await sharp(phone);
  const finger = await phone.touchscreen.touchStart(150, 300);
  for (let i = 1; i <= 10; i++) {
    await finger.move(150 + 10 * i, 300);
    await pause(30);
  }
  await finger.end();
  seen.touched = (await sharp(phone)) !== before;
  seen.overflow = await phone.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  await phone.click('#panel-toggle');
  await pause(300);
  await sharp(phone);
  await phone.screenshot({path: path.join(folder, 'phone-panel.jpg'), type: 'jpeg', quality: 70});
  seen.small = await phone.$$eval('#bar button, #bar select', (all) => all.filter((b) => b.offsetParent && (b.getBoundingClientRect().height < 36 || b.getBoundingClientRect().right > innerWidth + 1)).map((b) => b.id || b.textContent));
} finally {
  await browser.close();
}
console.log(JSON.stringify(seen));
