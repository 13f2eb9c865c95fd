// Requests to the studio's server; a problem becomes an error with the sentence to show.

import { save } from "../site/files.js";

const TOKEN = "latentmotion-studio-token";

/** Keeps the address's token for this tab and takes it out of the address. */
export function keepToken() {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!token) return;
  sessionStorage.setItem(TOKEN, token);
  history.replaceState(null, "", location.pathname);
}

/** Returns the answer to a request whose body is `json`, or bytes. */
export async function request(method, path, { json, body = JSON.stringify(json) } = {}) {
  const headers = { Authorization: `Bearer ${sessionStorage.getItem(TOKEN) ?? ""}` };
  if (json !== undefined) headers["Content-Type"] = "application/json";
  const answer = await fetch(`/studio/v1/${path}`, { method, headers, body }).catch(() => {
    throw new Error("The server does not answer. Is latentmotion studio still running?");
  });
  if (answer.ok) return answer;
  if (answer.status === 401) {
    throw new Error("This tab has no token. Open the address that latentmotion studio printed.");
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

/** Keeps a file of the server under the name that the server gives it. */
export async function download(method, path, name, json) {
  const answer = await request(method, path, { json });
  const given = /filename="?([^";]+)"?/.exec(answer.headers.get("Content-Disposition") ?? "");
  const content = await answer.blob();
  save(given?.[1] ?? name, content, content.type);
  return given?.[1] ?? name;
}

export const query = (values) => new URLSearchParams(values).toString();
