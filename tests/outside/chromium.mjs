// SPDX-License-Identifier: Apache-2.0
// Starts a headless Chromium that draws without a graphics card, and a server of this folder's files, for pages that
// draw splats.
import fs from 'node:fs';
import http from 'node:http';
import path from 'node:path';
import {fileURLToPath} from 'node:url';
import puppeteer from 'puppeteer-core';

const here = path.dirname(fileURLToPath(import.meta.url));
const types = {'.js': 'text/javascript', '.mjs': 'text/javascript', '.html': 'text/html', '.glb': 'model/gltf-binary', '.wasm': 'application/wasm'};

// Serves `pages` (path to {type, text}), files named by `fileOf(path)`, and this folder's files, on a free local port.
export function serve(pages, fileOf) {
  return http.createServer((request, response) => {
    const url = new URL(request.url, 'http://localhost').pathname;
    if (pages[url]) return response.writeHead(200, {'content-type': pages[url].type}).end(pages[url].text);
    if (url === '/favicon.ico') return response.writeHead(204).end();
    const wanted = fileOf(url) ?? path.join(here, path.normalize(url));
    if (!fs.existsSync(wanted) || !fs.statSync(wanted).isFile()) return response.writeHead(404).end();
    response.writeHead(200, {'content-type': types[path.extname(wanted)] ?? 'application/octet-stream'});
    fs.createReadStream(wanted).pipe(response);
  }).listen(0, '127.0.0.1');
}

// Opens a page with FILE as /file.glb, waits for window.done and prints its value. Then calls finish(canvas), or exits
// with 1 if the value is an error.
export async function show(executablePath, text, file, viewport, finish) {
  const browser = await launch(executablePath, {protocolTimeout: 600000});
  const server = serve({'/': {type: 'text/html', text}}, url => (url === '/file.glb' ? path.resolve(file) : undefined));
  try {
    const tab = await browser.newPage();
    await tab.setViewport(viewport);
    tab.on('pageerror', error => console.error(String(error)));
    tab.on('console', line => console.error(line.text()));
    await tab.goto(`http://127.0.0.1:${server.address().port}/`);
    await tab.waitForFunction('window.done', {timeout: 600000, polling: 200});
    const done = await tab.evaluate('window.done');
    if (!done.error) await finish(await tab.$('#c'));
    console.log(JSON.stringify(done));
    process.exitCode = done.error ? 1 : 0;
  } finally {
    await browser.close();
    server.close();
  }
}

// Starts the browser with further options of puppeteer and flags; exits with 77 if no browser can be started.
export async function launch(executablePath, options, flags = []) {
  try {
    return await puppeteer.launch({
      executablePath,
      headless: true,
      ...options,
      args: ['--no-sandbox', '--disable-dev-shm-usage', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
        '--ignore-gpu-blocklist', ...flags]
    });
  } catch (error) {
    console.error(`no browser: ${error}`);
    process.exit(77);
  }
}
