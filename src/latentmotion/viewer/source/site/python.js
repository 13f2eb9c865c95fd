// Python, which cleans motions up and writes their files: a worker, started by the first request.

/** Megabytes that the first request loads; 0 where the site was written without Python. */
export const PYTHON_SIZE = Number(document.body.dataset.python);

let worker = null;
let last = 0;
const waiting = new Map();

/**
 * Returns the motions of an .npz in another format, cleaned up if wanted.
 * @returns {Promise<{file: Uint8Array, form: string}>} The file, and the format that it has.
 */
export function rewritten(content, form, clean = false) {
  worker ??= started();
  return new Promise((resolve, reject) => {
    last += 1;
    waiting.set(last, { resolve, reject });
    worker.postMessage({ id: last, content, form, clean });
  });
}

/** Whether no request has been made yet. */
export const isAsleep = () => worker === null;

function started() {
  const started = new Worker("python/python.js", { type: "module" });
  started.addEventListener("message", ({ data: { id, answer, error } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error) reject(new Error(error.message));
    else resolve(answer);
  });
  started.addEventListener("error", ({ message }) => {
    worker = null; // the next request tries again
    for (const { reject } of waiting.values()) {
      reject(new Error(message ? `Python stopped: ${message}` : "Python can't be loaded"));
    }
    waiting.clear();
  });
  return started;
}
