// The moving figures of the site and the studio: one stage, and one clock for all takes on it.

import { Pace } from "./pace.js";
import { openStage } from "./stage.js";
import { Timeline } from "./timeline.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
const still = matchMedia("(prefers-reduced-motion: reduce)");

export class Player {
  /** `margins` returns the pixels that lie under what is above and below; `changed` hears of time. */
  constructor(place, margins, changed) {
    Object.assign(this, { place, margins, changed, takes: [], timeline: new Timeline(0) });
    this.timeline.addEventListener("time", () => this.#showTime());
    this.timeline.addEventListener("state", () => this.changed());
    new ResizeObserver(() => {
      this.fit();
      this.stage?.draw(); // a canvas of another size is blank until it is drawn
    }).observe(place);
    dark.addEventListener("change", () => this.stage?.setDark(dark.matches));
    let last = null;
    const frame = (now) => {
      this.#frame(now - (last ?? now));
      last = now;
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /**
   * Shows other takes, from their beginning, or, where `stay`, at the present time and seen as those
   * before; `play` starts them. Other options are those of the stage's `show`.
   */
  show(takes, colors, { stay = false, play = this.timeline.playing, ...options } = {}) {
    this.takes = takes;
    if (this.stage) this.stage.show(takes, colors, options);
    else this.#open(takes, colors, options);
    const captions = takes.map(({ caption }) => caption).join("; ");
    this.stage.canvas.setAttribute("aria-label", `Animated figure: ${captions}`);
    this.timeline.seconds = Math.max(...takes.map(({ seconds }) => seconds));
    this.timeline.seek(stay ? this.timeline.time : 0);
    if (stay) return;
    this.isFitted = false;
    this.fit();
    this.timeline.play(play && !still.matches);
  }

  #open(takes, colors, options) {
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    this.place.replaceChildren(canvas);
    this.stage = openStage(canvas, takes, colors, options);
    this.stage.setDark(dark.matches);
    this.pace = new Pace(this.timeline, this.stage);
  }

  #showTime() {
    this.stage?.showTime(this.timeline.time);
    this.changed();
  }

  fit() {
    if (!this.stage?.canvas.clientWidth || !this.stage.canvas.clientHeight) return;
    const { above, below } = this.margins();
    this.stage.resize(below, above);
    if (!this.isFitted || !this.stage.touched) this.stage.reset();
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
