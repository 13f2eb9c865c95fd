// What the npm package makes of cases: {model, cases: [{prompt, seconds, seed, steps, guidance}]}.
// Writes a JSON line with the ids of each case to stdout, and noise and joints, float32, to files.

import { closeSync, openSync, readFileSync, writeSync } from "node:fs";

const [root, given, folder] = process.argv.slice(2);
const { load, InputError } = await import(`${root}/src/node.js`);
const { standardNormal } = await import(`${root}/src/noise.js`);
const { Sentences } = await import(`${root}/src/tokens.js`);

const { model, cases, sentences, seeds, wrong } = JSON.parse(readFileSync(given, "utf8"));
const lm = await load(model);
const file = JSON.parse(readFileSync(`${model}/tokenizer.json`, "utf8"));
const reader = new Sentences(file, lm.model);

function bytes({ buffer, byteOffset, byteLength }) {
  return new Uint8Array(buffer, byteOffset, byteLength);
}

const noise = openSync(`${folder}/noise.f4`, "w");
for (const seed of seeds) writeSync(noise, bytes(standardNormal(BigInt(seed), 1568)));
closeSync(noise);
const joints = openSync(`${folder}/joints.f4`, "w");
const made = [];
for (const { prompt, ...asked } of cases) {
  const motion = await lm.generate(prompt, asked);
  writeSync(joints, bytes(motion.joints));
  made.push({ frames: motion.frames, seconds: motion.seconds, model: motion.model });
}
closeSync(joints);
const errors = [];
for (const { prompt, ...asked } of wrong) {
  const error = await lm.generate(prompt, asked).then(() => null, (error) => error);
  errors.push(error instanceof InputError ? error.message : String(error));
}
await lm.close();
console.log(JSON.stringify({ ids: sentences.map((sentence) => reader.ids(sentence)), made, errors }));
