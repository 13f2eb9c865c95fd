// Files of a model from the network, kept in the browser's Cache Storage under the model's hash.

const CACHE = "latentmotion-";

/**
 * Returns a function that gets files of a model's folder.
 * @param {string} address The folder's.
 * @param {{progress?: (state: {loaded: number, total: number}) => void, cache?: boolean}} options
 */
export function downloads(address, { progress = () => {}, cache = true } = {}) {
  const folder = address.endsWith("/") ? address : `${address}/`;
  const storage = cache && globalThis.caches ? globalThis.caches : null;
  const state = { loaded: 0, total: 0 };
  let kept = null; // the cache of this model, once its hash is known

  async function manifest() {
    const place = `${folder}web.json`;
    const all = storage && (await storage.open(`${CACHE}models`));
    const response = await fetch(place, { cache: "no-cache" }).catch(() => null);
    const found = response?.ok ? response : await all?.match(place);
    if (!found) throw unloaded(place, response);
    if (response?.ok) await all?.put(place, response.clone());
    const content = new Uint8Array(await found.arrayBuffer());
    const { hash, files = {} } = JSON.parse(new TextDecoder().decode(content));
    if (storage && hash) kept = await storage.open(`${CACHE}${hash}`);
    state.total = files["weights.bin"] ?? 0;
    return content;
  }

  return async (name) => {
    if (name === "web.json") return manifest();
    const place = `${folder}${name}`;
    const before = await kept?.match(place);
    if (before) return new Uint8Array(await before.arrayBuffer());
    const response = await fetch(place).catch(() => null);
    if (!response?.ok) throw unloaded(place, response);
    const content = await body(response, (count) => {
      if (name !== "weights.bin") return;
      state.loaded += count;
      progress({ ...state });
    });
    // A full disk must not keep anyone from the motion.
    await kept?.put(place, new Response(content)).catch(() => {});
    return content;
  };
}

function unloaded(place, response) {
  return new Error(`${place} can't be loaded (${response?.status ?? "no network"})`);
}

async function body(response, got) {
  const parts = [];
  const reader = response.body.getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    parts.push(part.value);
    got(part.value.length);
  }
  const content = new Uint8Array(parts.reduce((sum, { length }) => sum + length, 0));
  let at = 0;
  for (const part of parts) {
    content.set(part, at);
    at += part.length;
  }
  return content;
}
