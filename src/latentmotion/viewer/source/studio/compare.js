// The screen Compare: two takes on one clock, one over the other or side by side.

import { get } from "./api.js";
import { fill, find, make, onChange, onClick, press, round, trying } from "./dom.js";
import { samplingOf } from "./draft.js";

const COLORS = ["#2f8f9d", "#e2694a"];
const CHOICE = 60; // latest takes of the library to choose from
const FACTS = {
  prompt: ({ recipe }) => recipe.prompt || recipe.timeline?.map(({ prompt }) => prompt).join(", ") || "",
  seconds: ({ seconds }) => round(seconds),
  model: ({ recipe }) => recipe.model ?? "",
  seed: ({ recipe }) => recipe.seed ?? "",
  steps: ({ recipe }) => recipe.steps ?? "",
  guidance: ({ recipe }) => recipe.guidance ?? "",
  clean: ({ recipe }) => (recipe.clean === undefined ? "" : recipe.clean ? "yes" : "no"),
};

export class Compare {
  /** `makeTakes` makes takes of a recipe and shows them. */
  constructor(studio, restage, makeTakes) {
    Object.assign(this, { studio, restage, makeTakes, pair: [null, null], overlay: true, known: [] });
    ["take-a", "take-b"].forEach((id, i) => onChange(id, ({ value }) => this.choose(i, value)));
    onClick("overlay", () => this.setOverlay(!this.overlay));
    onClick("swap", () => this.set([...this.pair].reverse()));
    const limit = () => (find("lead").hidden = !studio.capabilities.can.between);
    studio.addEventListener("capabilities", limit);
    limit();
    find("lead").addEventListener("submit", (event) => {
      event.preventDefault();
      trying(() => this.lead());
    });
  }

  actors() {
    const [a, b] = this.pair;
    const figure = this.overlay ? "ghost" : this.studio.figure;
    const actors = a ? [{ take: a, figure: this.studio.figure, color: COLORS[0] }] : [];
    return b ? [...actors, { take: b, figure, color: COLORS[1] }] : actors;
  }

  /** Fills the lists; the picked take and the next one are the pair, where none is chosen. */
  async list() {
    const { takes, picked } = this.studio;
    const latest = (await get(`takes?limit=${CHOICE}`)).takes;
    const fresh = new Map([...latest, ...takes].map((take) => [take.id, take]));
    this.pair = this.pair.map((take) => (take && fresh.get(take.id)) || take);
    for (const take of this.pair) if (take) fresh.set(take.id, take);
    this.known = [...fresh.values()];
    const usual = [takes[picked], takes.find((_, i) => i !== picked), ...latest].filter(Boolean);
    const a = this.pair[0] ?? usual[0] ?? null;
    const b = this.pair[1] ?? usual.find(({ id }) => id !== a?.id) ?? null;
    this.pair = [a, b];
    this.#show();
  }

  set(pair) {
    this.pair = pair;
    this.#show();
    return this.restage();
  }

  choose(side, id) {
    const pair = [...this.pair];
    pair[side] = this.known.find((take) => take.id === id);
    return this.set(pair);
  }

  /** Makes takes that lead from A to B. */
  lead() {
    const { draft } = this.studio;
    const [start, end] = this.pair.map((take) => take?.id);
    if (!end) throw new Error("Choose two takes first.");
    const asked = { prompt: find("lead-prompt").value.trim(), seconds: Number(find("lead-seconds").value) };
    return this.makeTakes({ ...samplingOf(draft), ...asked, between: { start, end } }, draft.settings.takes);
  }

  setOverlay(overlay) {
    this.overlay = overlay;
    press("overlay", overlay);
    return this.restage();
  }

  #show() {
    const options = this.known.map((take) => {
      const { seed } = take.recipe; // first, since the end of a long title is cut
      return [take.id, seed === undefined ? take.title : `Seed ${seed}: ${take.title}`];
    });
    const listed = options.length ? options : [["", "no takes yet"]];
    fill(find("take-a"), listed, this.pair[0]?.id);
    fill(find("take-b"), listed, this.pair[1]?.id);
    const rows = Object.entries(FACTS).map(([name, fact]) => {
      const values = this.pair.map((take) => String(take ? fact(take) : ""));
      const cells = values.map((value) => make("td", {}, value));
      const isSame = values[0] === values[1];
      return make("tr", { className: isSame ? "" : "differs" }, make("th", { scope: "row" }, name), ...cells);
    });
    find("differences").tBodies[0].replaceChildren(...rows);
  }
}
