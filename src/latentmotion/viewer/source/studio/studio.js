// What the studio works on: the draft, the takes that are shown, the picked one; all can be undone.

import { colorsOf } from "../colors.js";
import { ghost } from "../figure.js";
import { stick } from "../figures.js";
import { standing } from "../mannequin.js";
import { lineUp, Motion } from "../motion.js";
import { boneLengths } from "../../../../../packages/web/src/rotations.js";
import { download, get, query, request, send } from "./api.js";
import { characterMaker } from "./characters.js";
import { draftOf, emptyDraft, recipeOf } from "./draft.js";
import { History } from "./history.js";

const MOST_MOTIONS = 64; // that are kept in memory
const AT_A_TIME = 16; // motions of a request
const UNUSUAL = 0.3; // part by which a bone differs from the person's, so that it gets a skin of its own

export class Studio extends EventTarget {
  constructor(capabilities, player) {
    super();
    const { joints: names, parents, directions } = capabilities;
    const lengths = directions.map((offset) => Math.hypot(...offset));
    this.skeleton = { names, parents, directions, lengths };
    Object.assign(this, { capabilities, player, history: new History(), motions: new Map() });
    this.models = new Map(); // by name, what the server offers
    Object.assign(this, { draft: emptyDraft(capabilities), takes: [], picked: 0, figure: "mannequin" });
    this.turn = 0;
  }

  tell(what) {
    this.dispatchEvent(new Event(what));
  }

  /** The picked take, if there is any. */
  get take() {
    return this.takes[this.picked] ?? null;
  }

  /** Whether the model that made a take is here, to make it again. */
  knows({ recipe: { weights } }) {
    return !weights || [...this.models.values()].some((model) => model.weights === weights);
  }

  /** Names the model in a draft: the one asked for, or, where it is not here, the present one. */
  withModel(draft, isTheOne) {
    const { settings } = draft;
    const found = [...this.models.values()].find(isTheOne);
    const { model, steps, usual_steps: usual } = found?.capabilities ?? this.capabilities;
    Object.assign(settings, { model, steps: steps.includes(settings.steps) ? settings.steps : usual });
    return draft;
  }

  /** Changes the draft, or whatever of it `edit` touches. */
  change(name, edit) {
    const before = this.draft;
    const after = structuredClone(before);
    edit(after);
    if (JSON.stringify(after) === JSON.stringify(before)) return Promise.resolve();
    const put = (draft) => async () => {
      this.draft = draft;
      this.tell("draft");
    };
    return this.history.act(name, put(after), put(before));
  }

  /** Makes takes of the draft, or of `recipe`, and shows them. */
  generate(recipe = recipeOf(this.draft), count = this.draft.settings.takes) {
    const [before, picked] = [this.takes, this.picked];
    const { model } = this.draft.settings;
    let made = null;
    const redo = async () => {
      if (made) await this.#mark(made, false);
      else made = (await send("POST", "takes", { recipe, takes: count, model })).takes;
      this.isNew = true; // what is new plays, whatever was paused
      await this.show(made, 0);
    };
    const undo = async () => {
      await this.#mark(made, true);
      await this.show(before, picked);
    };
    return this.history.act("Generate", redo, undo);
  }

  /** Shows takes side by side. */
  async show(takes, picked = 0) {
    this.takes = takes;
    this.picked = Math.min(picked, Math.max(takes.length - 1, 0));
    await this.motionsOf(takes);
    this.tell("takes");
    this.#rank(takes);
  }

  // Which take does best what its prompt says: asked for once the takes are there.
  async #rank(takes) {
    this.best = null;
    if (takes.length < 2 || new Set(takes.map(({ recipe }) => recipe.prompt)).size > 1) return;
    const best = await get(`best?${query(takes.map(({ id }) => ["take", id]))}`).catch(() => null);
    if (takes !== this.takes || !best?.take) return;
    this.best = best;
    this.tell("best");
  }

  /** An empty draft and an empty stage. */
  startAnew() {
    return this.replace("Start anew", emptyDraft(this.capabilities), []);
  }

  /** Shows takes out of the library together with what the first was made from. */
  open(takes) {
    const { recipe } = takes[0];
    const made = ({ weights }) => weights === recipe.weights;
    const mine = this.withModel(draftOf(recipe, emptyDraft(this.capabilities)), made);
    return this.replace("Open", mine, takes);
  }

  /** Another draft and other takes in place of the present ones. */
  replace(name, draft, takes) {
    const put = (drafted, shown, at) => async () => {
      this.draft = drafted;
      this.tell("draft");
      await this.show(shown, at);
    };
    return this.history.act(name, put(draft, takes, 0), put(this.draft, this.takes, this.picked));
  }

  pick(number) {
    if (number < 0 || number >= this.takes.length) return;
    this.picked = number;
    this.tell("pick");
  }

  /** Changes what is kept of a take: title, tags, star, edits. */
  edit(name, take, fields) {
    const { title, tags, star, edits } = take;
    const old = { title, tags, star, ...edits };
    const before = Object.fromEntries(Object.keys(fields).map((key) => [key, old[key] ?? null]));
    const put = (values) => async () => {
      this.#replace(await send("PATCH", `takes/${take.id}`, values));
      this.tell("edited");
    };
    return this.history.act(name, put(fields), put(before));
  }

  async duplicate(take) {
    const [before, picked] = [this.takes, this.picked];
    let copy = null;
    const redo = async () => {
      if (copy) await this.#mark([copy], false);
      else copy = await send("POST", `takes/${take.id}/duplicate`);
      const at = before.findIndex(({ id }) => id === take.id);
      await this.show(before.toSpliced(at + 1, 0, copy), at + 1);
    };
    const undo = async () => {
      await this.#mark([copy], true);
      await this.show(before, picked);
    };
    return this.history.act("Duplicate", redo, undo);
  }

  /** Marks takes as deleted, or, where `isDeleted` is false, brings them back. */
  remove(takes, isDeleted = true) {
    const [before, picked] = [this.takes, this.picked];
    const ids = new Set(takes.map(({ id }) => id));
    const left = isDeleted ? before.filter(({ id }) => !ids.has(id)) : before;
    const redo = async () => {
      await this.#mark(takes, isDeleted);
      if (left.length < before.length) await this.show(left, Math.min(picked, Math.max(left.length - 1, 0)));
    };
    const undo = async () => {
      await this.#mark(takes, !isDeleted);
      if (left.length < before.length) await this.show(before, picked);
    };
    return this.history.act(isDeleted ? "Delete" : "Restore", redo, undo);
  }

  async #mark(takes, isDeleted) {
    await Promise.all(takes.map(({ id }) => {
      return request(isDeleted ? "DELETE" : "POST", `takes/${id}${isDeleted ? "" : "/restore"}`);
    }));
    this.tell("library");
  }

  #replace(take) {
    this.takes = this.takes.map((one) => (one.id === take.id ? take : one));
  }

  /** The motions of takes as an export would write them, those not known yet by few requests. */
  async motionsOf(takes) {
    const unread = takes.filter((take) => !this.motions.has(keyOf(take)));
    for (let at = 0; at < unread.length; at += AT_A_TIME) this.#keep(unread.slice(at, at + AT_A_TIME));
    return Promise.all(takes.map((take) => this.motions.get(keyOf(take))));
  }

  #keep(takes) {
    const read = this.#read(takes);
    takes.forEach((take, i) => {
      if (this.motions.size >= MOST_MOTIONS) this.motions.delete(this.motions.keys().next().value);
      const motion = read.then((motions) => motions[i]);
      this.motions.set(keyOf(take), motion);
      motion.catch(() => this.motions.delete(keyOf(take)));
    });
  }

  async #read(takes) {
    const answer = await request("GET", `joints?${query(takes.map(({ id }) => ["take", id]))}`);
    const [frames, fps] = ["X-Frames", "X-Fps"].map((name) => answer.headers.get(name).split(",").map(Number));
    const joints = new Float32Array(await answer.arrayBuffer());
    let end = 0;
    return takes.map((take, i) => {
      const start = end;
      end += frames[i] * this.skeleton.names.length * 3;
      return this.#motion(take, fps[i], joints.subarray(start, end));
    });
  }

  #motion(take, fps, joints) {
    const frames = joints.length / this.skeleton.names.length / 3;
    const lengths = boneLengths({ joints, skeleton: this.skeleton, frames });
    const isUsual = lengths.every((length, joint) => {
      return Math.abs(length - this.skeleton.lengths[joint]) <= UNUSUAL * this.skeleton.lengths[joint];
    });
    const skeleton = isUsual ? this.skeleton : { ...this.skeleton, lengths };
    return new Motion({ caption: take.title, fps }, skeleton, joints);
  }

  /** Puts {take, figure, color} on the stage, one over the other where `overlay`. */
  async stage(actors, { overlay = false, stay = false } = {}) {
    const play = this.isNew ? true : undefined;
    this.isNew = false;
    this.turn += 1;
    const mine = this.turn;
    const motions = await this.motionsOf(actors.map(({ take }) => take));
    const makers = await Promise.all(actors.map((actor) => makerOf(actor)));
    if (mine !== this.turn) return; // something else is shown by now
    const colors = colorsOf(actors).map((color, i) => actors[i].color ?? color);
    const starts = motions.map((motion) => motion.ground(0).map((value) => -value));
    this.player.show(motions, colors, { makers, offsets: overlay ? starts : lineUp(motions), stay, play });
    this.tell("staged");
  }

  /** Puts a figure that breathes on the stage, where there are no takes, and a character beside it. */
  async stand(character, isScaled) {
    this.turn += 1;
    const mine = this.turn;
    const makers = [this.figure === "stick" ? stick : undefined];
    if (character && !character.name.toLowerCase().endsWith(".bvh")) {
      const answer = await request("GET", `characters/${character.id}/model`);
      makers.push(await characterMaker(await answer.arrayBuffer(), isScaled));
    }
    if (mine !== this.turn) return;
    this.player.show(makers.map(() => standing(this.skeleton)), colorsOf(makers), { makers, play: true });
    this.tell("staged");
  }

  /** Writes a take's file, on the character where one is named. */
  async export(take, format, character) {
    const named = character ? `&character=${encodeURIComponent(character)}` : "";
    return download("GET", `takes/${take.id}/file?format=${format}${named}`, `take.${format}`);
  }
}

const keyOf = (take) => `${take.id} ${JSON.stringify(take.edits)}`;

async function makerOf({ take, figure, isScaled }) {
  if (figure === "stick") return stick;
  if (figure === "ghost") return ghost;
  if (!figure || figure === "mannequin") return undefined;
  const answer = await request("GET", `takes/${take.id}/on/${encodeURIComponent(figure)}.glb`);
  return characterMaker(await answer.arrayBuffer(), isScaled);
}
