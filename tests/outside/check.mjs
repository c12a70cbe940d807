// SPDX-License-Identifier: Apache-2.0
// node check.mjs FILE...: prints the reports of gltf-validator and @gltf-transform/core on files, as JSON.
import fs from 'node:fs';
import path from 'node:path';
import {NodeIO} from '@gltf-transform/core';
import validator from 'gltf-validator';

const io = new NodeIO();
const out = {};
for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
    uri: file,
    maxIssues: 100,
    externalResourceFunction: uri => Promise.resolve(new Uint8Array(fs.readFileSync(path.join(path.dirname(file), uri))))
  });
  const root = (await io.read(file)).getRoot();
  out[file] = {
    errors: report.issues.numErrors,
    warnings: report.issues.numWarnings,
    messages: report.issues.messages.filter(m => m.severity < 2).map(m => ({code: m.code, pointer: m.pointer, message: m.message})),
    nodes: Object.fromEntries(root.listNodes().map(n => [n.getName(), n.getExtras()])),
    cameras: root.listCameras().length,
    animated: [...new Set(root.listAnimations().flatMap(a => a.listChannels()).map(c => c.getTargetNode().getName()))],
    triangles: root.listMeshes().flatMap(m => m.listPrimitives()).filter(p => p.getMode() === 4)
      .reduce((sum, p) => sum + p.getIndices().getCount() / 3, 0)
  };
}
console.log(JSON.stringify(out));
