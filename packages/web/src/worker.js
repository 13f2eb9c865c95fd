// The worker: one model, asked by messages {id, call, arguments}.

import { downloads } from "./download.js";
import { Generator } from "./generator.js";

let generator = null;

const calls = {
  async open(address, { runtime, cache }) {
    const progress = (state) => postMessage({ progress: state });
    const read = downloads(address, { progress, cache });
    generator = await Generator.open(read, { runtime });
    if (cache) keepGraphs(read, generator.model);
    return generator.model;
  },
  generate: (prompt, asked) => generator.generate(prompt, asked),
};

/** Gets the graphs of other numbers of steps, which are small, so that all work without a network. */
async function keepGraphs(read, { files }) {
  const graphs = Object.keys(files).filter((name) => name.endsWith(".onnx"));
  for (const name of graphs) await read(name).catch(() => {});
}

addEventListener("message", async ({ data: { id, call, given } }) => {
  try {
    const answer = await calls[call](...given);
    postMessage({ id, answer }, { transfer: answer.joints ? [answer.joints.buffer] : [] });
  } catch (error) {
    postMessage({ id, error: { name: error.name, message: error.message } });
  }
});
