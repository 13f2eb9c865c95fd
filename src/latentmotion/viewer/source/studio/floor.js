// The hand on the floor: what the draft asks for is drawn there, and a pointer sets waypoints and goals.

import * as THREE from "three";
import { Marks } from "../marks.js";
import { release } from "../stage.js";
import { takesGoals, timesOf } from "./draft.js";
import { round } from "./dom.js";

const NEAR = 18; // pixels from a waypoint within which the pointer grabs it
const DRAWN = 10; // pixels after which a press is a drawn line and no click
const APART = 0.35; // meters between the waypoints of a drawn line
const ABOVE = new THREE.Vector3(0, 1, 0.001).normalize();
const ROOM = 1.2; // meters around the path and the goals in the plan
const LEAST_PLAN = 4; // meters

export class FloorHand {
  /** `tool` is "path", "goal" or null; `changed` hears of a new tool, and of places of goals. */
  constructor(studio, changed) {
    Object.assign(this, { studio, changed, tool: null, isAbove: false });
    const { stage } = studio.player;
    this.stage = stage;
    this.usual = stage.eye;
    this.drafted = new THREE.Group();
    this.ring = ring();
    stage.scene.add(this.drafted, this.ring);
    stage.canvas.addEventListener("pointerdown", (event) => this.#down(event));
    studio.player.timeline.addEventListener("time", () => this.#showTime());
  }

  choose(tool) {
    this.tool = this.tool === tool ? null : tool;
    this.stage.controls.enabled = this.tool === null;
    if (this.tool) this.studio.player.timeline.play(false);
    const { takes, picked } = this.studio;
    this.studio.player.watch(this.tool && takes.length ? picked : null); // what is set is for this take
    if (this.tool) this.lookFromAbove(true);
    else this.changed();
    this.draw(true);
  }

  lookFromAbove(isAbove) {
    this.isAbove = isAbove;
    const { stage } = this;
    stage.eye = isAbove ? ABOVE : this.usual;
    stage.setFollow(!isAbove);
    if (isAbove) this.#framePlan();
    this.changed();
  }

  // The path, the goals and where motions go, in the middle and as large as they fit.
  #framePlan() {
    const { stage } = this;
    const [dx, dz] = this.#offset();
    const { path, goals } = this.studio.draft;
    const box = new THREE.Box2();
    const add = (x, z) => box.expandByPoint(new THREE.Vector2(x + dx, z + dz));
    add(0, 0);
    add(0, LEAST_PLAN / 2);
    path.forEach(({ x, z }) => add(x, z));
    goals.forEach(({ to: [x, , z] }) => add(x, z));
    // With a tool the plan is of what is asked, and has room beside it.
    for (const take of this.tool ? [] : stage.takes) {
      const [beside, ahead] = stage.offsets[take];
      stage.paths[take].forEach(([x, z]) => box.expandByPoint(new THREE.Vector2(x + beside, z + ahead)));
    }
    const [center, size] = [box.getCenter(new THREE.Vector2()), box.getSize(new THREE.Vector2())];
    const half = Math.tan((stage.camera.fov * Math.PI) / 360);
    const free = stage.freeHeight / stage.canvas.clientHeight;
    const tall = Math.max((size.y + 2 * ROOM) / free, LEAST_PLAN, (size.x + 2 * ROOM) / stage.camera.aspect);
    stage.controls.target.set(center.x, 0, center.y);
    stage.camera.position.copy(stage.controls.target).addScaledVector(ABOVE, tall / 2 / half);
    stage.stale = true;
  }

  /** Draws the draft at every take's place, and the ring under the picked take. */
  draw(isShown) {
    this.drafted.children.forEach(release);
    this.drafted.clear();
    this.marks = [];
    this.ring.visible = isShown && this.studio.takes.length > 1;
    const { path, goals } = this.studio.draft;
    if (isShown && takesGoals(this.studio.draft) && path.length + goals.length) {
      const times = timesOf(path, this.#seconds());
      const stops = path.map(({ x, z }, i) => ({ at: round(times[i], 1), to: [x, z] }));
      const places = this.#places();
      const asked = this.tool ? [places[this.studio.picked] ?? places[0]] : places;
      this.marks = asked.map(([offset, color]) => {
        return new Marks({ marks: { goals, path: stops } }, null, color, offset);
      });
      this.drafted.add(...this.marks.map(({ object }) => object));
    }
    this.#showTime();
  }

  #seconds() {
    return this.studio.draft.segments[0].seconds ?? (this.studio.take?.seconds || 4);
  }

  // [x, z] shift and color of each take on the stage.
  #places() {
    const { stage } = this;
    return stage.offsets.map((offset, i) => [offset, stage.floor.paths[i].done.material.color]);
  }

  #showTime() {
    const { stage, studio } = this;
    const { time } = studio.player.timeline;
    this.marks?.forEach((marks) => marks.showTime(time));
    const figure = stage.figures[Math.min(studio.picked, stage.figures.length - 1)];
    const [dx, dz] = stage.offsets[stage.figures.indexOf(figure)];
    const [x, , z] = figure.motion.sample(time);
    this.ring.position.set(x + dx, 0.004, z + dz);
    stage.stale = true;
  }

  /** The place on the floor under the pointer, in the picked take's space: [x, z], meters. */
  #floorAt({ clientX, clientY }) {
    const { stage } = this;
    const box = stage.canvas.getBoundingClientRect();
    const at = new THREE.Vector2(
      ((clientX - box.left) / box.width) * 2 - 1,
      1 - ((clientY - box.top) / box.height) * 2,
    );
    stage.camera.updateMatrixWorld(); // it may have moved since the last picture
    const ray = new THREE.Raycaster();
    ray.setFromCamera(at, stage.camera);
    const hit = ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 1, 0)), new THREE.Vector3());
    const [dx, dz] = this.#offset();
    return hit && [round(hit.x - dx), round(hit.z - dz)];
  }

  #offset() {
    return this.stage.offsets[this.studio.picked] ?? this.stage.offsets[0];
  }

  /** Where a place of the picked take's floor is on the screen: [x, y], pixels of the page. */
  onScreen(x, z) {
    const [dx, dz] = this.#offset();
    this.stage.camera.updateMatrixWorld();
    const box = this.stage.canvas.getBoundingClientRect();
    const { x: right, y: up } = new THREE.Vector3(x + dx, 0, z + dz).project(this.stage.camera);
    return [box.left + ((right + 1) / 2) * box.width, box.top + ((1 - up) / 2) * box.height];
  }

  #down(event) {
    if (!this.tool || event.button !== 0) return;
    const start = this.#floorAt(event);
    if (!start) return;
    if (this.tool === "goal") this.changed(start);
    else this.#startPath(event, start);
  }

  #startPath(event, start) {
    const { canvas } = this.stage;
    const pixels = this.studio.draft.path.map(({ x, z }) => {
      const [left, top] = this.onScreen(x, z);
      return Math.hypot(left - event.clientX, top - event.clientY);
    });
    const nearest = Math.min(...pixels); // on a small stage several waypoints are near
    const grabbed = nearest < NEAR ? pixels.indexOf(nearest) : -1;
    const drawn = [start];
    let way = 0;
    const move = (moved) => {
      way = Math.max(way, Math.hypot(moved.clientX - event.clientX, moved.clientY - event.clientY));
      const here = this.#floorAt(moved);
      if (!here || way < DRAWN) return;
      const last = drawn.at(-1);
      if (Math.hypot(here[0] - last[0], here[1] - last[1]) > APART) drawn.push(here);
    };
    const up = (ended) => {
      for (const [kind, listener] of Object.entries(listeners)) canvas.removeEventListener(kind, listener);
      if (ended.type === "pointerup") this.#endPath(grabbed, drawn, way >= DRAWN ? this.#floorAt(ended) : null);
    };
    const listeners = { pointermove: move, pointerup: up, pointercancel: up };
    canvas.setPointerCapture(event.pointerId);
    for (const [kind, listener] of Object.entries(listeners)) canvas.addEventListener(kind, listener);
  }

  // A grabbed waypoint moves; a drawn line is a path of its own; a click adds a waypoint.
  #endPath(grabbed, drawn, end) {
    this.studio.change("Path", ({ path }) => {
      if (grabbed >= 0 && end) Object.assign(path[grabbed], { x: end[0], z: end[1] });
      else if (grabbed >= 0) return;
      else if (end) path.splice(0, path.length, ...[...drawn, end].map(([x, z]) => ({ x, z, at: null })));
      else addWaypoint(path, drawn[0]);
    });
  }
}

/** Adds a waypoint; a path that has none yet begins where the motion does. */
export function addWaypoint(path, [x, z]) {
  if (!path.length && Math.hypot(x, z) > APART) path.push({ x: 0, z: 0, at: null });
  path.push({ x, z, at: null });
}

function ring() {
  const shape = new THREE.RingGeometry(0.36, 0.42, 48).rotateX(-Math.PI / 2);
  const material = new THREE.MeshBasicMaterial({ color: "#1f7480", transparent: true, opacity: 0.75 });
  return new THREE.Mesh(shape, material);
}
