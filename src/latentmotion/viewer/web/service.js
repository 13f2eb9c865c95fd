// Keeps the page itself for visits without a network, and Python once it was used; the model is kept
// under its own hash.

const PAGE = "latentmotion-site-{{version}}";
const PYTHON = "latentmotion-site-python-{{python}}";
const FILES = {{files}};
const address = (name) => new URL(name, registration.scope).pathname;

addEventListener("install", (event) => {
  event.waitUntil(caches.open(PAGE).then((cache) => cache.addAll(FILES)));
  skipWaiting();
});

addEventListener("activate", (event) => {
  event.waitUntil(forgetOthers().then(() => clients.claim()));
});

async function forgetOthers() {
  const names = (await caches.keys()).filter((name) => name.startsWith("latentmotion-site-"));
  const old = names.filter((name) => name !== PAGE && name !== PYTHON);
  await Promise.all(old.map((name) => caches.delete(name)));
}

addEventListener("fetch", (event) => {
  const { request } = event;
  const { pathname } = new URL(request.url);
  if (request.method !== "GET" || pathname.startsWith(address("model/"))) return;
  event.respondWith(answer(request, pathname.startsWith(address("python/")) ? PYTHON : PAGE));
});

async function answer(request, name) {
  const cache = await caches.open(name);
  const kept = await cache.match(request, { ignoreSearch: true });
  if (kept) return kept;
  const response = await fetch(request);
  // A full disk must not keep anyone from the file.
  if (name === PYTHON && response.ok) await cache.put(request, response.clone()).catch(() => {});
  return response;
}
