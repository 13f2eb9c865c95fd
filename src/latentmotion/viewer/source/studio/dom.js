// Elements of the page: found by id, or made; and the line that says what happened.

const FIRST = ["glb", "bvh", "fbx", "usdz", "npz", "csv", "html"];

export const find = (id) => document.getElementById(id);

/** Makes an element; `on` are its listeners, `data` its data attributes, `aria` those of ARIA. */
export function make(tag, { on = {}, data = {}, aria = {}, ...properties } = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  Object.assign(element.dataset, data);
  for (const [name, value] of Object.entries(aria)) element.setAttribute(`aria-${name}`, value);
  for (const [kind, listener] of Object.entries(on)) element.addEventListener(kind, listener);
  element.append(...children);
  return element;
}

export function say(words, isWrong = false) {
  find("status").textContent = words;
  find("status").classList.toggle("wrong", isWrong);
}

/** Calls `work`; what goes wrong is said, never thrown. */
export async function trying(work) {
  try {
    return await work();
  } catch (error) {
    say(error.message, true);
    return undefined;
  }
}

export function onClick(id, action) {
  find(id).addEventListener("click", () => trying(action));
}

export function onChange(id, action) {
  find(id).addEventListener("change", (event) => trying(() => action(event.target)));
}

/** Opens a menu at a pointer, or at what has the focus, of [name, action or null] rows. */
export function showMenu({ clientX, clientY, target }, rows) {
  const menu = make("div", { className: "menu", popover: "auto", role: "menu" });
  const buttons = rows.map(([name, action]) => {
    const choose = () => {
      menu.hidePopover();
      trying(action);
    };
    return make("button", { type: "button", role: "menuitem", textContent: name, disabled: !action, on: { click: choose } });
  });
  menu.append(...buttons);
  const able = buttons.filter(({ disabled }) => !disabled);
  menu.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step) able.at((able.indexOf(document.activeElement) + step) % able.length)?.focus();
    if (step) event.preventDefault();
    event.stopPropagation();
  });
  menu.addEventListener("toggle", ({ newState }) => newState === "closed" && menu.remove());
  document.body.append(menu);
  menu.showPopover();
  const { left, bottom } = target.getBoundingClientRect();
  const [x, y] = clientX || clientY ? [clientX, clientY] : [left, bottom];
  menu.style.left = `${Math.min(x, innerWidth - menu.offsetWidth - 8)}px`;
  menu.style.top = `${Math.min(y, innerHeight - menu.offsetHeight - 8)}px`;
  able[0]?.focus();
}

export function press(id, isPressed) {
  find(id).setAttribute("aria-pressed", String(isPressed));
}

/** Fills a list with [value, words] or plain values, and keeps what is chosen where it is there. */
export function fill(select, options, chosen = select.value) {
  const rows = options.map((option) => (Array.isArray(option) ? option : [option, option]));
  select.replaceChildren(...rows.map(([value, words]) => new Option(words, value)));
  if (rows.some(([value]) => String(value) === String(chosen))) select.value = chosen;
}

/** Formats, those that animation programs open first. */
export function byUse(formats) {
  const rank = (format) => (FIRST.includes(format) ? FIRST.indexOf(format) : FIRST.length);
  return [...formats].sort((a, b) => rank(a) - rank(b));
}

export const words = (name) => name.replaceAll("_", " ");
export const round = (value, places = 2) => Number(value.toFixed(places));
