// Keeps slow machines moving: where frames take too long, or there is no graphics card, a playing stage draws fewer pixels.

const TOO_LONG = 55; // milliseconds a frame
const JUDGED = 6; // frames in a row

export class Pace {
  constructor(timeline, stage) {
    Object.assign(this, { timeline, stage, slow: 0, isSlow: stage.isSoftware ?? false });
    timeline.addEventListener("state", () => this.#choose());
  }

  /** Hears how long the last frame took, milliseconds. */
  frame(took) {
    if (this.isSlow || !this.timeline.playing || document.hidden) return;
    this.slow = took > TOO_LONG ? this.slow + 1 : 0;
    if (this.slow < JUDGED) return;
    this.isSlow = true;
    this.#choose();
  }

  // A standing picture has time to be fine.
  #choose() {
    if (this.isSlow) this.stage.setDetail(this.timeline.playing ? 0.5 : 1);
  }
}
