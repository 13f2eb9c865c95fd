// In a browser: the model in a worker, so that the page never waits.

import { InputError } from "./errors.js";
import { Motion } from "./motion.js";

export { InputError };

/** Opens a model by its address: a folder that `latentmotion export MODEL --web` wrote. */
export async function load(address, { runtime, progress = () => {}, cache = true, worker } = {}) {
  const motions = new RemoteGenerator(worker ?? ownWorker(), progress);
  const here = (place) => place && new URL(place, document.baseURI).href;
  motions.model = await motions.call("open", here(String(address)), { runtime: here(runtime), cache });
  return motions;
}

function ownWorker() {
  return new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
}

class RemoteGenerator {
  constructor(worker, progress) {
    this.worker = worker;
    this.waiting = new Map();
    this.last = 0;
    worker.addEventListener("message", ({ data }) => {
      if (data.progress) progress(data.progress);
      else this.#settle(data);
    });
    worker.addEventListener("error", ({ message }) => {
      const error = new Error(message ? `the worker stopped: ${message}` : "the worker can't start");
      for (const { reject } of this.waiting.values()) reject(error);
      this.waiting.clear();
    });
  }

  call(call, ...given) {
    return new Promise((resolve, reject) => {
      this.last += 1;
      this.waiting.set(this.last, { resolve, reject });
      this.worker.postMessage({ id: this.last, call, given });
    });
  }

  #settle({ id, answer, error }) {
    const { resolve, reject } = this.waiting.get(id);
    this.waiting.delete(id);
    if (!error) resolve(answer);
    else reject(error.name === "InputError" ? new InputError(error.message) : new Error(error.message));
  }

  /** `signal` gives the motion up: nothing waits for it any more, and its error is the signal's. */
  generate(prompt, { signal, ...asked } = {}) {
    signal?.throwIfAborted();
    const motion = this.call("generate", prompt, asked).then((fields) => new Motion(fields));
    if (!signal) return motion;
    const given = new Promise((_, reject) => {
      signal.addEventListener("abort", () => reject(signal.reason), { once: true });
    });
    return Promise.race([motion, given]);
  }

  async close() {
    this.worker.terminate();
  }
}
