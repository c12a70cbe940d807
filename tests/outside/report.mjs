// SPDX-License-Identifier: Apache-2.0
// report.mjs CHROMIUM PAGE FOLDER: opens a report from its file without network and scripts, as on a desktop, in dark
// mode, on a phone and in print. Prints its measurements as JSON on the last line and writes screenshots into FOLDER.
import path from 'node:path';
import {pathToFileURL} from 'node:url';
import {launch} from './chromium.mjs';

const [chromium, file, folder] = process.argv.slice(2);
const address = pathToFileURL(path.resolve(file)).href, seen = {errors: [], foreign: [], shows: {}};
const browser = await launch(chromium, {});

// Measures a page of this width: overflow to the right, pictures that weren't decoded, the least size of text in charts,
// and the least contrast (WCAG 2) of text and curves with their background.
function look() {
  const luminance = (rgb) => rgb.map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)).reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const parse = (color) => color.match(/[\d.]+/g).map(Number);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const color = parse(getComputedStyle(at).backgroundColor);
      if (color.length < 4 || color[3] > 0) return color.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const contrast = (element, color) => {
    const [a, b] = [luminance(parse(color).slice(0, 3)), luminance(behind(element))].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05);
  };
  const least = (selector, of) => Math.min(...[...document.querySelectorAll(selector)].map(of));
  return {
    paper: getComputedStyle(document.body).backgroundColor,
    overflow: document.documentElement.scrollWidth - window.innerWidth,
    pictures: document.images.length,
    broken: [...document.images].filter((image) => !image.complete || image.naturalWidth !== Number(image.getAttribute('width')) || image.naturalHeight !== Number(image.getAttribute('height'))).length,
    charts: document.querySelectorAll('svg[viewBox] path.line, svg path.bins, svg circle').length,
    text: least('svg text', (text) => text.getBoundingClientRect().height),
    contrast: least('p, h1, h2, h3, td, th, dt, dd, figcaption, summary, pre', (element) => contrast(element, getComputedStyle(element).color)),
    curves: least('svg path.line', (curve) => contrast(curve, getComputedStyle(curve).stroke)),
  };
}

async function show(name, viewport, features, media) {
  const page = await browser.newPage();
  await page.setOfflineMode(true);
  await page.setJavaScriptEnabled(false);
  await page.setViewport(viewport);
  page.on('console', (message) => ['error', 'warn'].includes(message.type()) && seen.errors.push(message.text()));
  page.on('request', (request) => !request.url().startsWith('data:') && request.url() !== address && seen.foreign.push(request.url()));
  const session = await page.createCDPSession(); // puppeteer's functions for media type and media features undo each other
  await session.send('Emulation.setEmulatedMedia', {media, features});
  await page.goto(address, {waitUntil: 'load'});
  seen.shows[name] = await page.evaluate(look);
  await page.screenshot({path: path.join(folder, `${name}.jpg`), type: 'jpeg', quality: 75, fullPage: true});
  await page.screenshot({path: path.join(folder, `${name}-top.jpg`), type: 'jpeg', quality: 70});
  if (media === 'print') await page.pdf({path: path.join(folder, `${name}.pdf`), format: 'A4'});
  await page.close();
}

try {
  const light = [{name: 'prefers-color-scheme', value: 'light'}], dark = [{name: 'prefers-color-scheme', value: 'dark'}];
  await show('desktop', {width: 1180, height: 900}, light, 'screen');
  await show('dark', {width: 1180, height: 900}, dark, 'screen');
  await show('phone', {width: 390, height: 780, deviceScaleFactor: 1, isMobile: true, hasTouch: true}, light, 'screen');
  await show('paper', {width: 794, height: 1123}, dark, 'print');
} finally {
  await browser.close();
}
console.log(JSON.stringify(seen));
