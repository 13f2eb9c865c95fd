// The stage where WebGL is off: the same takes as figures of lines on a 2D canvas.

import { alongPath, lineUp, smoothPath } from "./motion.js";

const EYE_HEIGHT = 0.22; // radians that the camera looks down
const START = 0.4; // radians that it stands to the side
const MIDDLE = 0.96; // height of what it looks at, meters

export class Sketch {
  constructor(canvas, motions, colors, options) {
    this.name = "canvas";
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    Object.assign(this, { follow: true, angle: START, scale: 1, free: 0 });
    this.show(motions, colors, options);
    canvas.addEventListener("pointermove", ({ buttons, movementX }) => {
      if (buttons) this.turn(-movementX * 0.01);
    });
    canvas.addEventListener("wheel", ({ deltaY }) => this.zoom(Math.exp(deltaY * 0.001)));
  }

  /** Shows other motions, from their beginning; the view stays until `reset`. */
  show(motions, colors, { offsets = lineUp(motions) } = {}) {
    Object.assign(this, { motions, colors, offsets, watched: null });
    this.paths = motions.map(smoothPath);
    this.showTime(0);
  }

  showTime(time) {
    this.time = time;
    this.stale = true;
  }

  setFollow(follow) {
    this.follow = follow;
    this.reset();
  }

  watch(take) {
    this.watched = take;
    this.reset();
  }

  reset() {
    Object.assign(this, { angle: START, scale: 1, touched: false, stale: true });
  }

  turn(angle) {
    this.angle -= angle;
    Object.assign(this, { touched: true, stale: true });
  }

  lookAs({ angle, scale }) {
    Object.assign(this, { angle, scale, stale: true });
  }

  zoom(factor) {
    this.scale = Math.min(Math.max(this.scale / factor, 0.2), 8);
    Object.assign(this, { touched: true, stale: true });
  }

  setDetail() {
    this.stale = true;
  }

  setDark(dark) {
    this.ink = dark ? "#8fa3c4" : "#8a94a6";
    this.stale = true;
  }

  resize(covered, above) {
    const ratio = window.devicePixelRatio;
    this.free = this.canvas.clientHeight - covered - above;
    this.shift = (above - covered) / 2;
    this.canvas.width = this.canvas.clientWidth * ratio;
    this.canvas.height = this.canvas.clientHeight * ratio;
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.stale = true;
  }

  dispose() {}

  draw() {
    if (!this.stale || !this.free) return;
    this.stale = false;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.context.clearRect(0, 0, width, height);
    const view = this.#view(width, height);
    this.#drawFloor(view);
    this.motions.forEach((motion, i) => {
      if (this.watched !== null && this.watched !== i) return;
      this.#drawFigure(motion, i, view);
      this.#drawMarks(motion.marks, i, view);
    });
  }

  /** Returns the function from a point in space to the screen, and pixels per meter. */
  #view(width, height) {
    const points = this.#watchedPoints();
    const [xs, zs] = [0, 1].map((axis) => points.map((point) => point[axis]));
    const center = [xs, zs].map((all) => (Math.min(...all) + Math.max(...all)) / 2);
    const wide = 1.8 + Math.hypot(Math.max(...xs) - Math.min(...xs), Math.max(...zs) - Math.min(...zs));
    const pixels = this.scale * Math.min(this.free / 2.3, width / wide);
    const [cos, sin] = [Math.cos(this.angle), Math.sin(this.angle)];
    const project = (x, y, z) => {
      const [dx, dz] = [x - center[0], z - center[1]];
      const [aside, near] = [dx * cos - dz * sin, dx * sin + dz * cos];
      const up = (y - MIDDLE) * Math.cos(EYE_HEIGHT) - near * Math.sin(EYE_HEIGHT);
      return [width / 2 + aside * pixels, height / 2 + this.shift - up * pixels];
    };
    return { project, pixels, center };
  }

  #watchedPoints() {
    return this.motions.flatMap((motion, i) => {
      if (this.watched !== null && this.watched !== i) return [];
      const [dx, dz] = this.offsets[i];
      const path = this.paths[i];
      const places = this.follow ? [alongPath(path, motion.fps, this.time)] : path;
      return places.map(([x, z]) => [x + dx, z + dz]);
    });
  }

  #drawFloor({ project, center }) {
    const [x, z] = center.map(Math.round);
    for (let i = -4; i <= 4; i++) {
      this.#line([project(x + i, 0, z - 4), project(x + i, 0, z + 4)], 0.6, this.ink);
      this.#line([project(x - 4, 0, z + i), project(x + 4, 0, z + i)], 0.6, this.ink);
    }
  }

  #drawFigure(motion, take, { project, pixels }) {
    const joints = motion.sample(this.time);
    const [dx, dz] = this.offsets[take];
    const at = (j) => project(joints[j * 3] + dx, joints[j * 3 + 1], joints[j * 3 + 2] + dz);
    const { names, parents } = motion.skeleton;
    parents.forEach((parent, j) => {
      if (parent >= 0) this.#line([at(parent), at(j)], 0.07 * pixels, this.colors[take]);
    });
    if (names.includes("head")) this.#disc(at(names.indexOf("head")), 0.11 * pixels, take);
  }

  #drawMarks({ goals = [], path = [] }, take, { project, pixels }) {
    const [dx, dz] = this.offsets[take];
    const stops = path.map(({ to: [x, z] }) => project(x + dx, 0, z + dz));
    stops.slice(1).forEach((stop, i) => this.#line([stops[i], stop], 2, this.colors[take]));
    for (const { joint, to: [x, y, z] } of goals) {
      const [left, top] = project(x + dx, y, z + dz);
      this.#disc([left, top], 0.04 * pixels, take);
      this.context.fillText(joint.replaceAll("_", " "), left + 0.06 * pixels, top);
    }
  }

  #line([from, to], width, color) {
    Object.assign(this.context, { lineWidth: width, lineCap: "round", strokeStyle: color });
    this.context.beginPath();
    this.context.moveTo(...from);
    this.context.lineTo(...to);
    this.context.stroke();
  }

  #disc([x, y], radius, take) {
    this.context.fillStyle = this.colors[take];
    this.context.beginPath();
    this.context.arc(x, y - radius * 0.6, radius, 0, 2 * Math.PI);
    this.context.fill();
  }
}
