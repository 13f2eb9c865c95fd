// A worker: this very package cleans motions up and writes their files, run by Pyodide.
// It is asked by messages {id, content, form, clean}. Its files lie beside it.

const here = (name) => new URL(name, import.meta.url).href;
let starting = null;

async function start() {
  const { loadPyodide } = await import("./pyodide.mjs");
  const [pyodide, archive, script] = await Promise.all([
    loadPyodide({ packages: ["numpy"] }),
    bytes(here("latentmotion.zip")),
    bytes(here("../viewer.js")),
  ]);
  const place = "/lib/latentmotion";
  pyodide.unpackArchive(archive, "zip", { extractDir: place });
  pyodide.FS.writeFile(`${place}/latentmotion/viewer/viewer.js`, new Uint8Array(script));
  pyodide.pyimport("sys").path.insert(0, place);
  const { rewritten } = pyodide.pyimport("latentmotion.formats.content");
  return (content, form, clean) => rewritten(pyodide.toPy(content), form, clean).toJs();
}

async function bytes(address) {
  const response = await fetch(address);
  if (!response.ok) throw new Error(`cannot get ${address}: ${response.status}`);
  return response.arrayBuffer();
}

/** Returns a file's content and its format; of errors that Python raises, their own words. */
async function rewritten(content, form, clean) {
  starting ??= start();
  const rewrite = await starting.catch((error) => {
    starting = null; // the next request tries again
    throw error;
  });
  try {
    const [file, written] = rewrite(content, form, clean);
    return { file, form: written };
  } catch (error) {
    throw new Error(String(error.message).trim().split("\n").at(-1).replace(/^[\w.]+: /, ""));
  }
}

addEventListener("message", async ({ data: { id, content, form, clean } }) => {
  try {
    const answer = await rewritten(content, form, clean);
    postMessage({ id, answer }, { transfer: [answer.file.buffer] });
  } catch (error) {
    postMessage({ id, error: { name: error.name, message: error.message } });
  }
});
