// Keys of the studio, and the list of them that ? shows.

import { find, make, trying } from "./dom.js";

const TYPED = /^(INPUT|SELECT|TEXTAREA)$/;
const ARROWS = { Left: "←", Right: "→", Up: "↑", Down: "↓" };
const OWN = new Set(["checkbox", "range", "button", "submit"]);

/** Listens to `keys`: rows of [key, what it does, action, screens or all]. */
export function listen(keys) {
  find("key-list").replaceChildren(...keys.map(([key, does]) => {
    const names = key.split(" or ").map((one) => make("kbd", {}, one.replace(/Arrow(\w+)/, (_, way) => ARROWS[way])));
    return make("div", {}, make("dt", {}, ...names), make("dd", {}, does));
  }));
  document.addEventListener("keydown", (event) => {
    const { screen } = document.body.dataset;
    const pressed = nameOf(event);
    const found = keys.find(([key, , , screens]) => {
      return key.split(" or ").some((one) => fits(one, pressed)) && (!screens || screens.includes(screen));
    });
    if (!found || isTheirs(event, pressed)) return;
    event.preventDefault();
    trying(() => found[2](pressed));
  });
}

function nameOf({ key, ctrlKey, metaKey, altKey, shiftKey }) {
  if (altKey) return "";
  const isChord = ctrlKey || metaKey;
  const name = key === " " ? "Space" : isChord && key.length === 1 ? key.toUpperCase() : key;
  return `${isChord ? "Ctrl+" : ""}${shiftKey && (isChord || key.length > 1) ? "Shift+" : ""}${name}`;
}

function fits(key, pressed) {
  return key === pressed || (key === "1–9" && /^[1-9]$/.test(pressed));
}

// Fields that type keep their keys but Escape; buttons and sliders keep those that they answer to.
function isTheirs({ target }, pressed) {
  if (document.querySelector("dialog[open]")) return pressed !== "?" || TYPED.test(target.tagName);
  if (pressed === "Escape" || pressed === "Ctrl+S") return false;
  if (target.tagName === "SELECT" && pressed.startsWith("Ctrl+")) return false;
  if (TYPED.test(target.tagName) && !OWN.has(target.type)) return true;
  if (target.type === "range") return /Arrow|Home|End/.test(pressed);
  if (/^(BUTTON|A|SUMMARY)$/.test(target.tagName) || target.type === "checkbox") {
    return pressed === "Space" || pressed === "Enter";
  }
  return false;
}
