// The panel of paths and goals: tools for the floor, and tables for the keyboard.

import { fill, find, make, onClick, press, round, words } from "./dom.js";
import { takesGoals } from "./draft.js";
import { addWaypoint, FloorHand } from "./floor.js";

const FIRST_JOINTS = ["left_wrist", "right_wrist", "left_foot", "right_foot", "head", "pelvis"];
const HINTS = {
  path: "Click the floor for waypoints, drag to draw, drag a waypoint to move it. Esc ends.",
  goal: "Click the floor: the joint is there, at the height and time set. Esc ends.",
};

export class Directions {
  /** `isShown` says if the stage shows the draft at present. */
  constructor(studio, isShown) {
    Object.assign(this, { studio, isShown });
    this.hand = studio.player.stage.scene && new FloorHand(studio, (place) => this.#showTool(place));
    this.#limit();
    studio.addEventListener("capabilities", () => this.#limit());
    onClick("draw-path", () => this.choose("path"));
    onClick("place-goal", () => this.choose("goal"));
    onClick("keep-pose", () => this.keepPose());
    onClick("add-waypoint", () => this.#addWaypoint());
    onClick("clear-path", () => studio.change("Remove path", ({ path }) => path.splice(0)));
    for (const what of ["draft", "staged", "pick"]) studio.addEventListener(what, () => this.draw());
    this.draw();
  }

  #limit() {
    const { can, joints, goal_joints: allowed = joints } = this.studio.capabilities;
    const first = FIRST_JOINTS.filter((joint) => allowed.includes(joint));
    const rest = allowed.filter((joint) => !first.includes(joint));
    fill(find("goal-joint"), [...first, ...rest].map((joint) => [joint, words(joint)]));
    find("direct").hidden = !can.goals && !can.path;
    find("add-waypoint").hidden = !can.path;
    for (const id of ["keep-pose", "goal-kind"]) find(id).hidden = !can.goals;
    // Without WebGL there is no floor to point at; the tables remain.
    find("draw-path").hidden = !can.path || !this.hand;
    find("place-goal").hidden = !can.goals || !this.hand;
    find("above").hidden = !this.hand;
  }

  choose(tool) {
    const { can } = this.studio.capabilities;
    const isOffered = tool === "path" ? can.path : can.goals;
    if (isOffered && takesGoals(this.studio.draft)) this.hand?.choose(tool);
  }

  /** Puts the tool away; returns whether there was one. */
  end() {
    if (!this.hand?.tool) return false;
    this.hand.choose(this.hand.tool);
    return true;
  }

  lookFromAbove() {
    this.hand?.lookFromAbove(!this.hand.isAbove);
  }

  /** Makes a goal of where the joint is at present. */
  keepPose() {
    const { studio } = this;
    const motion = studio.player.takes[studio.takes.length ? studio.picked : 0];
    const joint = find("goal-joint").value;
    const index = motion.skeleton.names.indexOf(joint);
    const place = motion.sample(studio.player.timeline.time).slice(index * 3, index * 3 + 3);
    return this.#addGoal([...place].map((value) => round(value)));
  }

  #addGoal(to) {
    const goal = { joint: find("goal-joint").value, at: round(this.studio.player.timeline.time), to };
    return this.studio.change("Goal", ({ goals }) => goals.push(goal));
  }

  #addWaypoint() {
    const { path } = this.studio.draft;
    const { x, z } = path.at(-1) ?? { x: 0, z: 0 };
    return this.studio.change("Waypoint", (draft) => addWaypoint(draft.path, [x, z + 1]));
  }

  #showTool(place) {
    if (place) {
      this.#addGoal([place[0], Number(find("goal-height").value), place[1]]);
      return;
    }
    const { tool, isAbove } = this.hand;
    press("draw-path", tool === "path");
    press("place-goal", tool === "goal");
    press("above", isAbove);
    press("follow", this.studio.player.stage.follow);
    find("hint").hidden = !tool;
    find("hint").textContent = HINTS[tool] ?? "";
    find("scene").dataset.tool = tool ?? "";
  }

  draw() {
    const { path, goals } = this.studio.draft;
    const isOne = takesGoals(this.studio.draft);
    find("one-prompt").hidden = isOne;
    find("direct-body").hidden = !isOne;
    find("waypoints").hidden = !path.length;
    find("clear-path").hidden = !path.length;
    find("goals").hidden = !goals.length;
    if (!isOne) this.end();
    refill(find("waypoints").tBodies[0], path.map((point, i) => this.#waypointRow(point, i)));
    refill(find("goals").tBodies[0], goals.map((goal, i) => this.#goalRow(goal, i)));
    this.hand?.draw(this.isShown());
  }

  #waypointRow(point, i) {
    const cell = (name) => {
      const set = (value) => this.studio.change("Path", ({ path }) => (path[i][name] = value));
      return number(`Waypoint ${i + 1}, ${name}`, point[name], set, name === "at" ? null : 0);
    };
    const remove = () => this.studio.change("Remove waypoint", ({ path }) => path.splice(i, 1));
    return row([cell("x"), cell("z"), cell("at")], `Remove waypoint ${i + 1}`, remove);
  }

  #goalRow({ joint, at, to }, i) {
    const set = (edit) => this.studio.change("Goal", ({ goals }) => edit(goals[i]));
    const name = words(joint);
    const cells = [
      document.createTextNode(name),
      number(`${name}, goal ${i + 1}, at`, at, (value) => set((goal) => (goal.at = value)), 0),
      ...["x", "y", "z"].map((axis, k) => {
        return number(`${name}, goal ${i + 1}, ${axis}`, to[k], (value) => set((goal) => (goal.to[k] = value)), 0);
      }),
    ];
    const remove = () => this.studio.change("Remove goal", ({ goals }) => goals.splice(i, 1));
    return row(cells, `Remove goal ${i + 1}`, remove);
  }
}

function number(label, value, set, empty) {
  const changed = ({ target }) => set(target.value === "" ? empty : round(Number(target.value)));
  const field = { type: "number", step: 0.05, value: value ?? "", placeholder: "auto" };
  return make("input", { ...field, aria: { label }, on: { change: changed } });
}

function row(cells, label, remove) {
  const button = { type: "button", textContent: "×", title: label, className: "remove" };
  const last = make("button", { ...button, aria: { label }, on: { click: remove } });
  return make("tr", {}, ...[...cells, last].map((cell) => make("td", {}, cell)));
}

// Keeps the field that has the focus where it was.
function refill(body, rows) {
  const fields = () => [...body.querySelectorAll("input, button")];
  const at = fields().indexOf(document.activeElement);
  body.replaceChildren(...rows);
  if (at >= 0) fields()[Math.min(at, fields().length - 1)]?.focus();
}
