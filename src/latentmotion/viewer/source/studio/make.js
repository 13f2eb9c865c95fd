// The screen Make: a prompt and its options → takes side by side; the picked take's panel.

import { colorsOf } from "../colors.js";
import { FIGURES } from "../figures.js";
import { get, query, send } from "./api.js";
import { byUse, fill, find, make, onChange, onClick, press, round, say, trying, words } from "./dom.js";
import { lengthsOf, recipeOf, samplingOf, wordsOfKept } from "./draft.js";
import { Strip } from "./strip.js";

const WHOLE_NUMBERS = ["takes", "seed", "steps", "best_of"];
const USUAL_LOOP = 3; // seconds
const PLACEHOLDERS = {
  sentences: "a person walks forward and sits down",
  labels: "an action that the model knows",
  nothing: "this model takes no prompt",
};
const EXAMPLES = ["a person walks forward and waves", "a person kicks with the right leg", "a person sits down on a chair"];
const PAUSE = 500; // milliseconds without a key, after which a prompt is read
const PACES = [0.5, 0.75, 1, 1.25, 1.5, 2];

export class MakeScreen {
  constructor(studio) {
    this.studio = studio;
    this.strip = new Strip(studio);
    this.form = find("make");
    this.#limit(studio.capabilities);
    this.#listen();
    studio.addEventListener("capabilities", () => this.#limit(studio.capabilities));
    studio.addEventListener("draft", () => this.#showDraft());
    studio.addEventListener("segment", () => this.#showDraft());
    studio.addEventListener("pick", () => this.#showTake());
    studio.addEventListener("edited", () => this.#showTake());
    for (const change of ["takes", "best"]) studio.addEventListener(change, () => this.#showTake());
    find("examples").append(...EXAMPLES.map((prompt) => this.#example(prompt)));
    this.#showDraft();
    this.#showTake();
    this.strip.draw();
  }

  // A prompt to click, which is made at once.
  #example(prompt) {
    const click = async () => {
      find("prompt").value = prompt;
      await this.generate();
    };
    return make("button", { type: "button", textContent: prompt, on: { click: () => trying(click) } });
  }

  /** What the model does not know about a prompt, and what it knows that is near, where told. */
  notice({ notice = "", nearest = [] } = {}) {
    find("notice").hidden = !notice && !nearest.length;
    find("notice-words").textContent = notice;
    find("nearest").replaceChildren(...nearest.map((caption) => this.#example(caption)));
  }

  /** What stands on the stage. */
  actors() {
    const { takes, figure } = this.studio;
    return takes.map((take) => ({ take, figure }));
  }

  #limit({ steps, guidance, seconds, formats, lacking, can, prompts, parts = [], labels = [] }) {
    const { elements } = this.form;
    if (labels.length) elements.prompt.setAttribute("list", "labels");
    else elements.prompt.removeAttribute("list");
    elements.prompt.disabled = prompts === "nothing";
    elements.prompt.placeholder = PLACEHOLDERS[prompts];
    find("labels").replaceChildren(...labels.map((label) => new Option(label)));
    fill(elements.steps, steps);
    Object.assign(elements.guidance, { min: guidance.least, max: guidance.most });
    Object.assign(elements.seconds, { min: seconds.least, max: seconds.most });
    elements.best_of.max = Number(can.best_of) || 8;
    find("best").hidden = !can.best_of;
    find("loops").hidden = !can.loop;
    find("add-segment").hidden = !can.timeline;
    find("part").hidden = !can.edit;
    find("go-on").hidden = !can.start;
    find("part-which").hidden = !can.parts;
    find("teach").hidden = !can.teach;
    fill(find("part-name"), [["", "whole body"], ...parts.map((one) => [one, words(one)])]);
    fill(find("format"), byUse(formats));
    for (const [name, lack] of Object.entries(lacking)) {
      find("format").append(Object.assign(new Option(`${name} – not installed`, name, false, false), { disabled: true, title: lack }));
    }
    const missing = Object.keys(lacking);
    find("format-lack").hidden = !missing.length;
    find("format-lack").querySelector("summary").textContent = `Not installed: ${missing.join(", ")}`;
    find("format-lack").querySelector("ul").replaceChildren(...Object.values(lacking).map((lack) => make("li", {}, lack)));
    fill(find("pace"), PACES.map((pace) => [pace, `${pace}×`]));
    find("pace").value = this.studio.take?.edits.speed ?? 1;
  }

  #listen() {
    const { studio, form } = this;
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      trying(() => this.generate());
    });
    form.addEventListener("change", ({ target }) => trying(() => this.#take(target)));
    let pause = 0;
    find("prompt").addEventListener("input", () => {
      clearTimeout(pause);
      pause = setTimeout(() => trying(() => this.#read()), PAUSE);
    });
    onClick("die", async () => {
      const [seed] = crypto.getRandomValues(new Uint32Array(1));
      await studio.change("Seed", ({ settings }) => (settings.seed = seed));
      await this.generate();
    });
    onClick("more-options", () => this.#showMore(find("fields").hidden));
    onClick("kept-none", () => studio.change("Plain prompt", (draft) => (draft.kept = {})));
    onClick("star", () => this.star());
    onClick("duplicate", () => this.duplicate());
    onClick("delete", () => this.remove());
    onClick("export", () => this.export());
    onClick("teach-take", () => this.teach());
    onClick("trim-in", () => this.trimHere(0));
    onClick("trim-out", () => this.trimHere(1));
    onClick("trim-none", () => this.#edit("Trim", { trim: null }));
    onChange("take-title", ({ value }) => this.#edit("Rename", { title: value }));
    onChange("in-place", ({ checked }) => this.#edit("In place", { in_place: checked }));
    onChange("mirrored", ({ checked }) => this.#edit("Mirror", { mirrored: checked }));
    onChange("pace", ({ value }) => this.#edit("Pace", { speed: Number(value) }));
    for (const id of ["trim-from", "trim-to"]) {
      onChange(id, () => this.trim(["trim-from", "trim-to"].map((end) => Number(find(end).value))));
    }
    onClick("again", () => this.#again());
    onClick("go-on", () => this.goOn());
    find("part-form").addEventListener("submit", (event) => {
      event.preventDefault();
      trying(() => this.#changePart());
    });
  }

  // A field of the form → the draft.
  #take({ name, type, checked, value }) {
    if (name === "prompt" || name === "seconds") {
      const next = name === "prompt" ? value.trim() : value === "" ? null : Number(value);
      return this.studio.change(name === "prompt" ? "Prompt" : "Length", ({ segments }) => {
        segments[this.strip.chosen][name] = next;
      });
    }
    const number = WHOLE_NUMBERS.includes(name) ? Math.round(Number(value)) : Number(value);
    const next = type === "checkbox" ? checked : number;
    return this.studio.change(words(name), ({ settings, segments }) => {
      settings[name] = next;
      // A loop has a length.
      if (settings.loop && segments.length === 1) segments[0].seconds ??= USUAL_LOOP;
    });
  }

  async generate() {
    for (const field of ["prompt", "seconds"]) await this.#take(this.form.elements[field]);
    const { segments, kept } = this.studio.draft;
    const isAsked = this.studio.capabilities.prompts !== "nothing" && !kept.between;
    const empty = isAsked ? segments.findIndex(({ prompt }) => !prompt) : -1;
    if (empty >= 0) {
      this.strip.choose(empty);
      throw new Error("Write what a person does, e.g. a person walks and sits down.");
    }
    const wrong = [...this.form.elements].find((field) => field.willValidate && !field.validity.valid);
    if (wrong) {
      if (find("fields").contains(wrong)) this.#showMore(true);
      wrong.focus();
      throw new Error(`${wrong.labels[0].textContent.trim()}: ${wrong.validationMessage}`);
    }
    await this.make(recipeOf(this.studio.draft), this.studio.draft.settings.takes);
  }

  // Says while a prompt is typed what the model does not know of it.
  async #read() {
    const { prompts, model } = this.studio.capabilities;
    const prompt = find("prompt").value.trim();
    const isRead = prompt && prompts === "sentences" && document.body.dataset.model === "warm";
    const reading = isRead ? await get(`reading?${query({ prompt, model })}`) : {};
    if (prompt === find("prompt").value.trim()) this.notice(reading);
  }

  #showMore(isShown) {
    find("fields").hidden = !isShown;
    find("more-options").setAttribute("aria-expanded", String(isShown));
  }

  /** Makes takes of a recipe; the keys go to the stage then. */
  async make(recipe, count) {
    const began = performance.now();
    document.body.dataset.state = "busy";
    say(count > 1 ? `Making ${count} takes …` : "Making a take …");
    find("view").querySelector("canvas").focus({ preventScroll: true });
    try {
      await this.studio.generate(recipe, count);
      requestAnimationFrame(() => {
        performance.measure("takes", { start: began, end: performance.now() });
      });
      const took = Math.round(performance.now() - began);
      const { takes } = this.studio;
      this.notice(takes[0]);
      const lengths = takes.map(({ seconds }) => seconds);
      const [least, most] = [Math.min, Math.max].map((end) => round(end(...lengths)));
      say(`${takes.length} × ${least === most ? least : `${least} to ${most}`} s in ${took} ms.`);
    } finally {
      document.body.dataset.state = "ready";
    }
  }

  #changePart() {
    const { take, draft } = this.studio;
    const prompt = find("part-prompt").value.trim();
    if (!take) throw new Error("Pick a take first.");
    if (!prompt) throw new Error("Write what happens instead.");
    const between = [Number(find("part-from").value), Number(find("part-to").value)];
    const part = find("part-name").value;
    const edit = { take: take.id, between, parts: part ? [part] : [] };
    return this.make({ ...samplingOf(draft), prompt, edit }, draft.settings.takes);
  }

  /** Makes takes that begin in the picked take's last pose. */
  goOn() {
    const { draft } = this.studio;
    const { id } = this.#picked();
    const prompt = find("prompt").value.trim();
    if (!prompt) throw new Error("Write what the person does next, then go on from here.");
    const { seconds } = this.strip.segment;
    return this.make({ ...samplingOf(draft), prompt, seconds, start: id }, draft.settings.takes);
  }

  async #again() {
    const { equal } = await send("POST", `takes/${this.#picked().id}/again`);
    say(equal ? "Made again: equal to the bit." : "Made again: not equal.", !equal);
  }

  #picked() {
    if (!this.studio.take) throw new Error("There is no take yet: press Enter in the prompt.");
    return this.studio.take;
  }

  async #edit(name, fields) {
    try {
      await this.studio.edit(name, this.#picked(), fields);
    } catch (error) {
      this.#showTake(); // the fields say again what holds
      throw error;
    }
  }

  star() {
    const { star } = this.#picked();
    return this.#edit(star ? "Remove star" : "Star", { star: !star });
  }

  duplicate() {
    return this.studio.duplicate(this.#picked());
  }

  async remove() {
    const take = this.#picked();
    await this.studio.remove([take]);
    say(`Deleted ${take.title}. Ctrl+Z brings it back.`);
  }

  async export() {
    const { figure } = this.studio;
    const character = figure in FIGURES ? null : figure;
    say(`Saved ${await this.studio.export(this.#picked(), find("format").value, character)}.`);
  }

  /** Lets sentences start from the picked take. */
  async teach() {
    const field = find("teach-words");
    const sentences = field.value.split("\n").map((line) => line.trim()).filter(Boolean);
    if (!sentences.length) throw new Error("Write what the person does in this take, e.g. does the robot dance.");
    const { model } = this.studio.draft.settings;
    const { clips } = await send("POST", `takes/${this.#picked().id}/teach`, { sentences, model });
    field.value = "";
    say(`Taught: “${sentences[0]}” starts from this take. ${clips} ${clips === 1 ? "take teaches" : "takes teach"} here.`);
  }

  /** Keeps what lies between two times of the whole take, seconds. */
  trim([from, to]) {
    const whole = wholeOf(this.#picked());
    const isWhole = from <= 0 && to >= whole - 0.005;
    return this.#edit("Trim", { trim: isWhole ? null : [Math.max(from, 0), Math.min(to, whole)] });
  }

  /** Makes the present time the first (end 0) or last (end 1) of the take. */
  trimHere(end) {
    const { edits } = this.#picked();
    const trim = edits.trim ?? [0, wholeOf(this.studio.take)];
    const now = trim[0] + this.studio.player.timeline.time * (edits.speed ?? 1);
    return this.trim(end ? [trim[0], round(now)] : [round(now), trim[1]]);
  }

  #showDraft() {
    const { draft } = this.studio;
    const { elements } = this.form;
    const segment = this.strip.segment;
    elements.prompt.value = segment.prompt;
    elements.seconds.value = segment.seconds ?? "";
    for (const [name, value] of Object.entries(draft.settings)) {
      const field = elements[name];
      if (field?.type === "checkbox") field.checked = value;
      else if (field) field.value = value;
    }
    const kept = wordsOfKept(draft);
    find("kept").hidden = !kept;
    find("kept-words").textContent = `As it was made: ${kept}.`;
    const many = draft.segments.length > 1;
    const usual = round(lengthsOf(draft, this.studio.take?.seconds ?? 0)[this.strip.chosen]);
    find("generate").textContent = many ? `Generate ${draft.segments.length} prompts` : "Generate";
    find("prompt").previousElementSibling.textContent = many
      ? `Prompt ${this.strip.chosen + 1} of ${draft.segments.length}`
      : "What the person does";
    elements.seconds.title = segment.seconds === null ? `About ${usual} s, as the sentence usually takes` : "";
  }

  #showTake() {
    const { take, takes, picked } = this.studio;
    const colors = colorsOf(takes);
    find("picks").replaceChildren(...takes.map((one, i) => this.#pickButton(one, i, colors[i])));
    this.#showBest();
    find("no-take").hidden = Boolean(take);
    find("take-body").hidden = !take;
    find("take").querySelector("summary").textContent =
      takes.length > 1 ? `Take ${picked + 1} of ${takes.length}` : "Take";
    if (!take) return;
    const { title, star, edits, seconds, frames, fps, recipe, goals } = take;
    find("take-title").value = title;
    press("star", star);
    find("star").title = star ? "Starred (s)" : "Star (s)";
    const seed = recipe.seed === undefined ? "imported" : `seed ${recipe.seed}`;
    const model = recipe.model ? ` · ${recipe.model}${this.studio.knows(take) ? "" : ", which is not here"}` : "";
    find("facts").textContent = `${round(seconds)} s · ${frames} frames · ${round(fps)} fps · ${seed}${model}`;
    const whole = wholeOf(take);
    const [from, to] = edits.trim ?? [0, whole];
    find("trim-from").max = find("trim-to").max = whole;
    find("trim-from").value = round(from);
    find("trim-to").value = round(to);
    find("in-place").checked = Boolean(edits.in_place);
    find("mirrored").checked = Boolean(edits.mirrored);
    find("pace").value = edits.speed ?? 1;
    find("again").hidden = recipe.seed === undefined;
    find("reached").replaceChildren(...(goals ?? []).map(reachedItem));
  }

  // The take that scores best, and why, once the server has said so.
  #showBest() {
    const { best } = this.studio;
    const at = this.studio.takes.findIndex(({ id }) => id === best?.take);
    find("picks").children[at]?.classList.add("best");
    find("why").hidden = at < 0;
    if (at >= 0) find("why").textContent = `Take ${at + 1} is the best: ${best.reason}`;
  }

  #pickButton(take, number, color) {
    const button = make("button", {
      ...{ type: "button", textContent: `${take.star ? "★ " : ""}${number + 1}`, title: take.title },
      aria: { pressed: number === this.studio.picked, label: `Take ${number + 1}: ${take.title}` },
      on: { click: () => this.studio.pick(number) },
    });
    button.style.setProperty("--take", color);
    return button;
  }
}

function wholeOf({ stored_seconds: whole }) {
  return whole;
}

function reachedItem({ goal, after_cm: after }) {
  const name = typeof goal === "string" ? goal : `${words(goal.joint ?? "path")} at ${goal.at} s`;
  return make("li", { textContent: `${name}: ${after.toFixed(1)} cm off` });
}
