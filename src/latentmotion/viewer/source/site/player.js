// The moving figures of the site: a stage for the takes at hand, and one clock for all of them.

import { colorsOf } from "../colors.js";
import { Pace } from "../pace.js";
import { Sketch } from "../sketch.js";
import { Stage } from "../stage.js";
import { Timeline } from "../timeline.js";

const HAS_WEBGL = document.createElement("canvas").getContext("webgl2") !== null;
const dark = matchMedia("(prefers-color-scheme: dark)");
const still = matchMedia("(prefers-reduced-motion: reduce)");

export class Player {
  /** `margins` returns the pixels that lie under what is above and below; `changed` hears of time. */
  constructor(place, margins, changed) {
    Object.assign(this, { place, margins, changed });
    new ResizeObserver(() => this.fit()).observe(place);
    dark.addEventListener("change", () => this.stage?.setDark(dark.matches));
    let last = null;
    const frame = (now) => {
      this.#frame(now - (last ?? now));
      last = now;
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /** Shows other takes, from their beginning. */
  show(takes) {
    this.stage?.dispose();
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    const captions = takes.map(({ caption }) => caption).join("; ");
    canvas.setAttribute("aria-label", `Animated figure: ${captions}`);
    this.place.replaceChildren(canvas);
    this.takes = takes;
    this.timeline = new Timeline(Math.max(...takes.map(({ seconds }) => seconds)));
    this.stage = new (HAS_WEBGL ? Stage : Sketch)(canvas, takes, colorsOf(takes));
    this.pace = new Pace(this.timeline, this.stage);
    this.timeline.addEventListener("time", () => this.#showTime());
    this.timeline.addEventListener("state", () => this.changed());
    this.stage.setDark(dark.matches);
    this.isFitted = false;
    this.#showTime();
    this.fit();
    this.timeline.play(!still.matches);
  }

  #showTime() {
    this.stage.showTime(this.timeline.time);
    this.changed();
  }

  fit() {
    if (!this.stage?.canvas.clientWidth || !this.stage.canvas.clientHeight) return;
    const { above, below } = this.margins();
    this.stage.resize(below, above);
    if (!this.isFitted) this.stage.reset();
    this.isFitted = true;
  }

  watch(take) {
    this.stage.watch(take);
  }

  #frame(took) {
    if (!this.stage) return;
    this.pace.frame(took);
    this.timeline.advance(Math.min(took, 250) / 1000);
    this.stage.draw();
  }
}
