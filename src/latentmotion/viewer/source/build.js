// Bundles scripts with the parts of three.js that they use: all pages' ../viewer.js, and the studio's.
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
await build({ ...shared, entryPoints: ["studio/main.js"], outfile: "../../studio/assets/studio.js" });
