// The worker: one model, asked by messages {id, call, arguments}.

import { downloads } from "./download.js";
import { Generator } from "./generator.js";

let generator = null;

const calls = {
  async open(address, { runtime, cache }) {
    const progress = (state) => postMessage({ progress: state });
    generator = await Generator.open(downloads(address, { progress, cache }), { runtime });
    return generator.model;
  },
  generate: (prompt, asked) => generator.generate(prompt, asked),
};

addEventListener("message", async ({ data: { id, call, given } }) => {
  try {
    const answer = await calls[call](...given);
    postMessage({ id, answer }, { transfer: answer.joints ? [answer.joints.buffer] : [] });
  } catch (error) {
    postMessage({ id, error: { name: error.name, message: error.message } });
  }
});
