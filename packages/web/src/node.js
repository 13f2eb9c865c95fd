// In Node: files from a folder or an address, the model in this thread.

import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";
import { downloads } from "./download.js";
import { InputError } from "./errors.js";
import { Generator } from "./generator.js";

export { InputError };

/** Opens a model: a folder's path, or its address. */
export async function load(place, { runtime, progress } = {}) {
  const isAddress = /^https?:/.test(String(place));
  const folder = isAddress ? null : folderAddress(place);
  const read = isAddress
    ? downloads(String(place), { progress })
    : (name) => readFile(fileURLToPath(new URL(name, folder))).catch((error) => {
        if (error.code !== "ENOENT") throw error;
        throw new InputError(
          `there is no ${error.path}; expected the folder that latentmotion export MODEL --web -o FOLDER wrote`,
        );
      });
  const wasm = "onnxruntime-web/ort-wasm-simd-threaded.wasm";
  const binary = await readFile(runtime ?? createRequire(import.meta.url).resolve(wasm));
  return Generator.open(read, { binary });
}

function folderAddress(place) {
  const address = String(place).startsWith("file:") ? String(place) : pathToFileURL(place).href;
  return address.endsWith("/") ? address : `${address}/`;
}
