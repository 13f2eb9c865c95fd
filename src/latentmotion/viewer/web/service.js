// Keeps the page itself for visits without a network; the model is kept under its own hash.

const PAGE = "latentmotion-site-{{version}}";
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
  const old = names.filter((name) => name !== PAGE);
  await Promise.all(old.map((name) => caches.delete(name)));
}

addEventListener("fetch", (event) => {
  const { request } = event;
  const { pathname } = new URL(request.url);
  if (request.method !== "GET" || pathname.startsWith(address("model/"))) return;
  event.respondWith(answer(request));
});

async function answer(request) {
  const cache = await caches.open(PAGE);
  return (await cache.match(request, { ignoreSearch: true })) ?? fetch(request);
}
