// Bundles the package for the Python package's site: ../../src/latentmotion/viewer/web/*.js, and
// writes the licenses of what is in it.

import { readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const output = "../../src/latentmotion/viewer/web";
const MIT = readFileSync("node_modules/three/LICENSE", "utf8").replace(/Copyright.*/, "Copyright © Microsoft Corporation");
const parts = {
  "onnxruntime-web": MIT,
  "@huggingface/tokenizers": readFileSync("node_modules/@huggingface/tokenizers/LICENSE", "utf8"),
};
const named = Object.keys(parts).map((name) => {
  const { version } = JSON.parse(readFileSync(`node_modules/${name}/package.json`, "utf8"));
  return `${name} ${version}`;
});
const texts = Object.values(parts).map((license, i) => `${named[i]}\n\n${license.trim()}\n`);
writeFileSync(`${output}/LICENSES.txt`, `worker.js holds:\n\n${texts.join("\n\n")}`);

await build({
  entryPoints: { latentmotion: "src/index.js", worker: "src/worker.js" },
  outdir: output,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
  external: ["module", "node:*", "worker_threads", "fs", "path"],
  banner: {
    js:
      '/*! Built from packages/web by "npm ci && npm run build"; do not edit.\n' +
      `Latent Motion (MIT); worker.js holds ${named.join(" and ")}: LICENSES.txt */`,
  },
});
