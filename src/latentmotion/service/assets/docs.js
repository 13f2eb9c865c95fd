// The page of the interface: every call of /openapi.json with its fields and its answers, to be tried.

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};
let schemas = {};

const resolved = (schema) => (schema.$ref ? schemas[schema.$ref.split("/").at(-1)] : schema);

// A type in a few words.
function kind(schema) {
  if (schema.$ref) return schema.$ref.split("/").at(-1);
  if (schema.enum) return schema.enum.join(" | ");
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  const several = schema.anyOf ?? schema.oneOf;
  if (several) return several.map(kind).filter((one) => one !== "null").join(" or ");
  if (schema.prefixItems) return `[${schema.prefixItems.map(kind).join(", ")}]`;
  return schema.items ? `list of ${kind(schema.items)}` : schema.type ?? "any";
}

// The schemas of objects that a type holds.
function objects(schema) {
  if (schema.properties) return [schema];
  return [...(schema.anyOf ?? schema.oneOf ?? []), ...(schema.items ? [schema.items] : [])].flatMap((one) => objects(resolved(one)));
}

function fields(schema, seen = new Set()) {
  const rows = Object.entries(schema.properties).map(([name, field]) => {
    const needed = schema.required?.includes(name) ? ", needed" : "";
    const usual = field.default !== undefined && field.default !== null ? `, by default ${JSON.stringify(field.default)}` : "";
    const inner = objects(resolved(field)).filter((one) => one !== schema && !seen.has(one));
    const about = make("td", {}, `${kind(field)}${needed}${usual}. ${field.description ?? ""}`);
    for (const one of inner) about.append(make("details", {}, make("summary", {}, one.title ?? name), fields(one, new Set([...seen, schema]))));
    return make("tr", {}, make("td", {}, make("code", {}, name)), about);
  });
  return make("table", {}, ...rows);
}

function parameters(list) {
  const rows = list.map(({ name, in: where, required, schema, description = "" }) => {
    const about = `${kind(schema)}, ${where}${required ? ", needed" : ""}. ${description}`;
    return make("tr", {}, make("td", {}, make("code", {}, name)), make("td", {}, about));
  });
  return make("table", {}, ...rows);
}

function trial(method, path, example) {
  const area = make("textarea", { value: JSON.stringify(example, null, 2), rows: 6, ariaLabel: "Body" });
  const answer = make("pre", { tabIndex: 0 });
  const button = make("button", { type: "button" }, "Try it");
  button.addEventListener("click", async () => {
    const headers = { "Content-Type": "application/json" };
    const token = document.getElementById("token").value;
    if (token) headers.Authorization = `Bearer ${token}`;
    answer.textContent = "…";
    const found = await fetch(path, { method, headers, body: example && area.value }).catch((error) => ({ failed: error.message }));
    if (found.failed) return void (answer.textContent = found.failed);
    const type = found.headers.get("Content-Type") ?? "";
    const content = await found.blob();
    const text = /json|text/.test(type) ? (await content.text()).slice(0, 2000) : `${content.size.toLocaleString("en")} bytes`;
    answer.textContent = `${found.status} ${type}\n${text}`;
  });
  return [...(example ? [area] : []), button, answer];
}

function call(path, method, { summary, description, parameters: list = [], requestBody }) {
  const body = make("div", {});
  const [first, ...more] = (description ?? summary ?? "").split("\n");
  if (more.length) body.append(make("p", {}, more.join(" ")));
  if (list.length) body.append(parameters(list));
  const sent = requestBody?.content["application/json"]?.schema;
  if (sent) body.append(fields(resolved(sent)));
  const example = sent && (resolved(sent).examples?.[0] ?? { prompt: "a person waves", seconds: 2 });
  if (!path.includes("{") && (sent || method === "get")) body.append(...trial(method.toUpperCase(), path, example));
  const head = make("summary", {}, make("code", {}, `${method.toUpperCase()} ${path}`), ` ${first}`);
  return make("details", { className: "call" }, head, body);
}

async function open() {
  const document_ = await (await fetch("/openapi.json")).json();
  schemas = document_.components.schemas;
  const calls = Object.entries(document_.paths).flatMap(([path, methods]) => {
    return Object.entries(methods).map(([method, about]) => call(path, method, about));
  });
  document.getElementById("calls").replaceChildren(...calls);
}

open();
