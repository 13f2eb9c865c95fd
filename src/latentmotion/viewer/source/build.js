// Bundles all pages' ../viewer.js, with the parts of three.js that are used, and the studio's script,
// which its page loads after viewer.js.
import { readFileSync } from "node:fs";
import { build } from "esbuild";

const license = readFileSync("node_modules/three/LICENSE", "utf8").trim();

const shared = {
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2020",
  charset: "ascii",
  legalComments: "none",
  banner: {
    js: `/*! Built from viewer/source by "npm install && npm run build"; do not edit.\n` +
      `Latent Motion's viewer (MIT), with parts of three.js:\n\n${license}\n*/`,
  },
};

await build({
  ...shared,
  entryPoints: ["page.js"],
  outfile: "../viewer.js",
  external: ["./latentmotion.js"], // lies beside the site's page
});
// The studio's three.js and mannequin are what viewer.js hands over; a part that is missing in three.js stops the build.
const parts = readFileSync("three.js", "utf8").match(/\{[^}]*\}/)[0];
const given = {
  name: "given",
  setup({ onResolve, onLoad }) {
    onResolve({ filter: /^three$/ }, () => ({ path: "three", namespace: "given" }));
    onResolve({ filter: /mannequin\.json$/ }, () => ({ path: "mannequin", namespace: "given" }));
    onLoad({ filter: /three/, namespace: "given" }, () => ({ contents: `export const ${parts} = globalThis.three;` }));
    onLoad({ filter: /mannequin/, namespace: "given" }, () => ({ contents: "export default globalThis.mannequin;" }));
  },
};
await build({
  ...shared,
  entryPoints: ["studio/main.js"],
  outfile: "../../studio/assets/studio.js",
  plugins: [given],
  logOverride: { "import-is-undefined": "error" },
});
