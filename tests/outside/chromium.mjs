// SPDX-License-Identifier: Apache-2.0
// A headless Chromium that draws without a graphics card, and a server of files below this folder, for pages that draw splats.
import fs from 'node:fs';
import http from 'node:http';
import path from 'node:path';
import {fileURLToPath} from 'node:url';
import puppeteer from 'puppeteer-core';

const here = path.dirname(fileURLToPath(import.meta.url));
const types = {'.js': 'text/javascript', '.mjs': 'text/javascript', '.html': 'text/html', '.glb': 'model/gltf-binary', '.wasm': 'application/wasm'};

// Serves `pages` (path to {type, text}) and the files that `fileOf(path)` names, otherwise those of this folder, on a free port of this machine.
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

// Starts the browser, with more options of puppeteer and more flags; exits with 77 where none can be started.
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
