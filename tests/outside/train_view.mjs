// SPDX-License-Identifier: Apache-2.0
// train_view.mjs CHROMIUM URL FOLDER: watches a run of pags train --view as a person would, and stops it. Prints its
// observations as JSON on the last line and writes screenshots into FOLDER.
import path from 'node:path';
import {launch} from './chromium.mjs';

const [chromium, url, folder] = process.argv.slice(2);
const origin = new URL(url).origin, seen = {errors: [], foreign: []};
const browser = await launch(chromium, {acceptInsecureCerts: false});
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const text = (page, id) => page.$eval(id, (element) => element.textContent);

try {
  const page = await browser.newPage();
  await page.setViewport({width: 1280, height: 860});
  page.on('pageerror', (error) => seen.errors.push(String(error)));
  page.on('console', (message) => message.type() === 'error' && !/503/.test(message.text()) && seen.errors.push(message.text()));
  page.on('request', (request) => !/^(blob|data):/.test(request.url()) && !request.url().startsWith(origin) && seen.foreign.push(request.url()));
  await page.goto(url, {waitUntil: 'domcontentloaded'});
  await page.waitForFunction(() => document.getElementById('picture').dataset.serial, {timeout: 60000});

  // The page redraws an unchanged view while the scene learns; the curves grow.
  seen.first = await page.$eval('#picture', (canvas) => canvas.toDataURL());
  await page.waitForFunction(() => Number(document.getElementById('curve-psnr').dataset.dots) >= 3, {timeout: 120000});
  seen.later = await page.$eval('#picture', (canvas) => canvas.toDataURL());
  seen.changed = seen.first !== seen.later;
  delete seen.first;
  delete seen.later;
  seen.curves = await page.$$eval('canvas.curve', (all) => all.map((canvas) => Number(canvas.dataset.points)));
  await pause(2500);
  seen.grown = await page.$$eval('canvas.curve', (all) => all.map((canvas) => Number(canvas.dataset.points)));
  seen.head = await text(page, '#run-head');
  seen.facts = await text(page, '#run-facts');

  // Moves the view during training.
  const count = () => page.$eval('#picture', (canvas) => Number(canvas.dataset.count));
  const before = await count();
  await page.mouse.move(400, 300);
  await page.mouse.down();
  for (let i = 0; i < 30; i++) {
    await page.mouse.move(400 + 4 * i, 300);
    await pause(60);
  }
  await page.mouse.up();
  seen.moving = (await count()) - before;
  await page.keyboard.press('KeyR');

  // Shows the worst view next to its photograph.
  seen.worst = await page.$$eval('#worst button', (all) => all.map((button) => button.textContent));
  await page.$eval('#worst button', (button) => button.click());
  await page.waitForFunction(() => document.getElementById('views').value !== '-1', {timeout: 10000});
  await page.select('#channel', 'difference');
  await page.waitForFunction(() => /PSNR/.test(document.getElementById('psnr').textContent), {timeout: 30000});
  seen.psnr = await text(page, '#psnr');
  await page.select('#channel', 'color');

  await page.click('#checkpoint');
  await page.waitForFunction(() => /written/.test(document.getElementById('run-said').textContent), {timeout: 30000});
  seen.said = await text(page, '#run-said');
  await page.keyboard.press('KeyR');
  await page.setViewport({width: 1000, height: 740});
  await pause(1500);
  await page.screenshot({path: path.join(folder, 'train.jpg'), type: 'jpeg', quality: 50});

  await page.setViewport({width: 390, height: 780, deviceScaleFactor: 2, isMobile: true, hasTouch: true});
  await pause(1500);
  await page.screenshot({path: path.join(folder, 'train-phone.jpg'), type: 'jpeg', quality: 70});
  seen.overflow = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  await page.setViewport({width: 1280, height: 860});
  await pause(500);

  await page.click('#stop-run');
  await pause(300);
  seen.asked = await text(page, '#stop-run');
  seen.running = !/stopp/.test(await text(page, '#run-head'));
  for (let i = 0; i < 20 && !(await page.$eval('#stop-run', (button) => button.disabled)); i++) await page.click('#stop-run'); // on a slow machine a second click may be late
  await page.waitForFunction(() => /was stopped/.test(document.getElementById('notice').textContent), {timeout: 60000});
  seen.end = await text(page, '#run-head');
  await pause(3000); // the page sends no more requests
  seen.notice = await text(page, '#notice');
  await page.screenshot({path: path.join(folder, 'train-end.jpg'), type: 'jpeg', quality: 70});
} finally {
  await browser.close();
}
console.log(JSON.stringify(seen));
