// Bundles all pages' script with the parts of three.js that it uses: ../viewer.js.
import { readFileSync } from "node:fs";
import { build } from "esbuild";

const license = readFileSync("node_modules/three/LICENSE", "utf8").trim();

await build({
  entryPoints: ["page.js"],
  outfile: "../viewer.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2020",
  charset: "ascii",
  legalComments: "none",
  external: ["./latentmotion.js"], // lies beside the site's page
  banner: {
    js: `/*! Built from viewer/source by "npm install && npm run build"; do not edit.\n` +
      `Latent Motion's viewer (MIT), with parts of three.js:\n\n${license}\n*/`,
  },
});
