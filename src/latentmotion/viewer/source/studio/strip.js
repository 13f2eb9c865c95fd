// The timeline: prompts one after the other, when the path and the goals are met, and the time.

import { find, make, onClick, round, showMenu, words } from "./dom.js";
import { lengthsOf, takesGoals, timesOf } from "./draft.js";

const LEAST = 0.6; // seconds of a prompt
const SNAP = 0.1; // seconds

export class Strip {
  constructor(studio) {
    Object.assign(this, { studio, chosen: 0 });
    studio.addEventListener("draft", () => this.draw());
    studio.addEventListener("staged", () => this.draw());
    studio.player.timeline.addEventListener("time", () => this.#showTime());
    onClick("add-segment", () => this.add());
    for (const id of ["segments", "stops", "keyframes", "ruler"]) {
      find(id).addEventListener("pointerdown", (event) => this.#seek(event));
    }
    find("segments").addEventListener("dblclick", ({ target }) => {
      if (target.id === "segments") this.add();
    });
  }

  /** The prompt that the form edits. */
  get segment() {
    return this.studio.draft.segments[this.chosen];
  }

  /** Seconds that the timeline is wide. */
  get seconds() {
    const asked = lengthsOf(this.studio.draft, this.#made()).reduce((sum, one) => sum + one, 0);
    return Math.max(asked, ...this.studio.takes.map(({ seconds }) => seconds));
  }

  // Seconds of the take that the draft may have come from.
  #made() {
    return this.studio.take?.seconds ?? 0;
  }

  async add() {
    await this.studio.change("Add prompt", ({ segments }) => segments.push({ prompt: "", seconds: null }));
    this.choose(this.studio.draft.segments.length - 1);
  }

  async remove(number) {
    if (this.studio.draft.segments.length < 2) return;
    await this.studio.change("Remove prompt", ({ segments }) => segments.splice(number, 1));
    find("segments").querySelector("button")?.focus();
  }

  // What can be done with a prompt, as [name, action or, where it can't be now, null].
  #menu(number) {
    const { segments } = this.studio.draft;
    const change = (name, edit) => () => this.studio.change(name, edit);
    const copy = change("Duplicate prompt", (draft) => draft.segments.splice(number, 0, { ...segments[number] }));
    const usual = change("Length", (draft) => (draft.segments[number].seconds = null));
    return [
      ["Edit", () => this.choose(number)],
      ["Usual length", segments[number].seconds === null ? null : usual],
      ["Duplicate", this.studio.capabilities.can.timeline ? copy : null],
      ["Delete", segments.length > 1 ? () => this.remove(number) : null],
    ];
  }

  choose(number, isEditing = true) {
    this.chosen = number;
    this.draw();
    this.studio.tell("segment");
    if (isEditing) find("prompt").focus();
  }

  draw() {
    const { segments, path, goals } = this.studio.draft;
    this.chosen = Math.min(this.chosen, segments.length - 1);
    const focused = [...find("segments").querySelectorAll("button")].indexOf(document.activeElement);
    const lengths = lengthsOf(this.studio.draft, this.#made());
    let start = 0;
    const boxes = segments.map((segment, number) => {
      const box = this.#box(segment, number, start, lengths[number]);
      start += lengths[number];
      return box;
    });
    find("segments").replaceChildren(...boxes);
    find("segments").querySelectorAll("button")[focused]?.focus();
    const isOne = takesGoals(this.studio.draft);
    find("path-row").hidden = !isOne || !path.length;
    find("goals-row").hidden = !isOne || !goals.length;
    const times = timesOf(path, lengths[0]);
    find("stops").replaceChildren(...times.map((at, i) => this.#tick(at, `Waypoint ${i + 1}`)));
    find("keyframes").replaceChildren(
      ...goals.map(({ at, joint }, i) => {
        const tick = this.#tick(at, words(joint));
        const remove = () => this.studio.change("Remove goal", (draft) => draft.goals.splice(i, 1));
        tick.addEventListener("keydown", (event) => onDelete(event, remove));
        return tick;
      }),
    );
    const marks = Array.from({ length: Math.floor(this.seconds) + 1 }, (_, second) => {
      return place(make("i", { textContent: `${second}` }), second / this.seconds);
    });
    find("ruler").replaceChildren(...marks);
    this.#showTime();
  }

  #box({ prompt, seconds }, number, start, length) {
    const text = prompt || "…";
    const span = seconds === null ? "usual length" : `${seconds} s`;
    const button = make("button", {
      ...{ type: "button", textContent: text, title: `${text} (${span})` },
      aria: { label: `Prompt ${number + 1}: ${text}, ${span}`, pressed: number === this.chosen },
      on: {
        click: () => this.choose(number),
        keydown: (event) => onDelete(event, () => this.remove(number)),
        contextmenu: (event) => {
          event.preventDefault();
          showMenu(event, this.#menu(number));
        },
      },
    });
    const edge = make("span", { className: "edge", title: "Drag: its length" });
    edge.addEventListener("pointerdown", (event) => this.#drag(event, number, length));
    const box = make("div", { className: "segment" }, button, edge);
    if (this.studio.draft.segments.length > 1) {
      const label = `Remove prompt ${number + 1}`;
      const remove = { type: "button", textContent: "×", title: label, className: "remove" };
      box.append(make("button", { ...remove, aria: { label }, on: { click: () => this.remove(number) } }));
    }
    box.style.width = `${(100 * length) / this.seconds}%`;
    return place(box, start / this.seconds);
  }

  #drag(event, number, length) {
    event.preventDefault();
    event.stopPropagation();
    const edge = event.target;
    const box = edge.parentElement;
    const { clientWidth } = find("segments");
    const { seconds } = this;
    const most = this.studio.capabilities.seconds.most;
    let next = length;
    edge.setPointerCapture(event.pointerId);
    edge.addEventListener("pointermove", (moved) => {
      const wished = length + ((moved.clientX - event.clientX) / clientWidth) * seconds;
      next = Number((Math.round(Math.min(Math.max(wished, LEAST), most) / SNAP) * SNAP).toFixed(1));
      box.style.width = `${(100 * next) / seconds}%`;
    });
    edge.addEventListener("pointerup", () => {
      this.studio.change("Length", ({ segments }) => (segments[number].seconds = next));
      if (next === length) this.choose(number);
    });
  }

  #tick(at, name) {
    const label = `${name} at ${round(at)} s`;
    const go = () => {
      this.studio.player.timeline.play(false);
      this.studio.player.timeline.seek(at);
    };
    const tick = { type: "button", className: "tick-mark", title: label };
    return place(make("button", { ...tick, aria: { label }, on: { click: go } }), at / this.seconds);
  }

  #seek(event) {
    if (event.target !== event.currentTarget || event.detail > 1) return;
    const { left, width } = event.currentTarget.getBoundingClientRect();
    this.studio.player.timeline.seek(((event.clientX - left) / width) * this.seconds);
  }

  #showTime() {
    place(find("now"), this.studio.player.timeline.time / this.seconds);
  }
}

// The key is answered here, so that it does not delete the take as well.
function onDelete(event, remove) {
  if (event.key !== "Delete" && event.key !== "Backspace") return;
  event.preventDefault();
  event.stopPropagation();
  remove();
}

function place(element, part) {
  element.style.left = `${100 * Math.min(part, 1)}%`;
  return element;
}
