// Two motions side by side, each on a stage of its own, seen alike and from the same side: on one
// stage the nearer figure would be the larger one. The canvases go when the next pair comes.

import { Pace } from "../pace.js";
import { openStage } from "../stage.js";
import { Timeline } from "../timeline.js";

const SIDES = [
  { label: "Left figure", color: "#2f8f9d" },
  { label: "Right figure", color: "#e2694a" },
];

export class Scene {
  /** `margins` returns the pixels that lie under what is below and above. */
  constructor(place, motions, margins) {
    this.margins = margins;
    this.timeline = new Timeline(Math.max(...motions.map(({ seconds }) => seconds)));
    const canvases = SIDES.map(({ label }) => canvasNamed(label));
    place.replaceChildren(...canvases);
    this.stages = motions.map((motion, i) => openStage(canvases[i], [motion], [SIDES[i].color]));
    this.paces = this.stages.map((stage) => new Pace(this.timeline, stage));
    this.timeline.addEventListener("time", () => this.#showTime());
    this.#showTime();
    canvases.forEach((canvas, i) => this.#shareView(canvas, i));
    this.isFitted = false;
    this.sizes = new ResizeObserver(() => this.fit());
    canvases.forEach((canvas) => this.sizes.observe(canvas));
  }

  fit() {
    if (!this.stages.every(({ canvas }) => canvas.clientWidth && canvas.clientHeight)) return;
    const { below, above } = this.margins();
    for (const stage of this.stages) {
      stage.resize(below, above);
      if (!this.isFitted) stage.reset();
    }
    // Both are as far away as the one that needs more room.
    const farther = this.stages.reduce((a, b) => (distance(a) > distance(b) ? a : b));
    if (!this.isFitted) this.stages.forEach((stage) => stage !== farther && stage.lookAs(farther));
    this.isFitted = true;
  }

  setDark(dark) {
    this.stages.forEach((stage) => stage.setDark(dark));
  }

  frame(took) {
    this.paces.forEach((pace) => pace.frame(took));
    this.timeline.advance(Math.min(took, 250) / 1000);
    if (this.held !== undefined) this.stages[1 - this.held].lookAs(this.stages[this.held]);
    this.stages.forEach((stage) => stage.draw());
  }

  dispose() {
    this.sizes.disconnect();
    this.stages.forEach((stage) => stage.dispose());
  }

  #showTime() {
    this.stages.forEach((stage) => stage.showTime(this.timeline.time));
  }

  // The stage that was touched last leads, the other's camera goes with it.
  #shareView(canvas, i) {
    for (const kind of ["pointerdown", "wheel"]) {
      canvas.addEventListener(kind, () => (this.held = i), { passive: true });
    }
  }
}

function distance({ camera, controls }) {
  return camera ? camera.position.distanceTo(controls.target) : 0;
}

function canvasNamed(label) {
  const canvas = document.createElement("canvas");
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  return canvas;
}
