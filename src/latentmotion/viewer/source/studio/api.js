// Requests to the studio's server; a problem becomes an error with the sentence to show.

import { save } from "../site/files.js";

const PATIENCE = 30; // seconds that a request waits for a server that is not ready yet

/** Someone without a session: neither the token of an address nor the cookie that it becomes. */
export class NoSession extends Error {}

/** Trades the token of an address for a cookie, which all tabs have, and takes it out of the bar. */
export async function openSession(address = location.href) {
  const token = new URLSearchParams(address.split("#")[1]).get("token");
  if (!token) return;
  history.replaceState(null, "", location.pathname);
  await request("POST", "session", { token });
}

/** Returns the answer to a request whose body is `json`, or bytes. */
export async function request(method, path, { json, body = JSON.stringify(json), token, patience = PATIENCE } = {}) {
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  if (json !== undefined) headers["Content-Type"] = "application/json";
  const answer = await fetch(`/studio/v1/${path}`, { method, headers, body }).catch(() => {
    throw new Error("The server does not answer. Is latentmotion studio still running?");
  });
  if (answer.ok) return answer;
  const wait = Number(answer.headers.get("Retry-After"));
  if (answer.status === 503 && wait && wait <= patience) { // the studio was started again and reads its model
    await new Promise((done) => setTimeout(done, 1000 * wait));
    return request(method, path, { json, body, token, patience: patience - wait });
  }
  if (answer.status === 401) {
    throw new NoSession("This browser is not let in yet. Open the address that latentmotion studio printed.");
  }
  const problem = await answer.json().catch(() => ({}));
  throw new Error(problem.detail || problem.title || `The server answered ${answer.status}.`);
}

export async function get(path) {
  return (await request("GET", path)).json();
}

export async function send(method, path, json) {
  const answer = await request(method, path, { json });
  return answer.status === 204 ? null : answer.json();
}

/** Keeps a file of the server under the name that the server gives it; returns name and size. */
export async function download(method, path, name, json) {
  const answer = await request(method, path, { json });
  const given = /filename="?([^";]+)"?/.exec(answer.headers.get("Content-Disposition") ?? "");
  const content = await answer.blob();
  save(given?.[1] ?? name, content, content.type);
  return `${given?.[1] ?? name}, ${sizeOf(content)}`;
}

/** The size of a file in words. */
export function sizeOf({ size }) {
  return size < 1e6 ? `${Math.ceil(size / 1e3)} kB` : `${(size / 1e6).toFixed(1)} MB`;
}

export const query = (values) => new URLSearchParams(values).toString();
