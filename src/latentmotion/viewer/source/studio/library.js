// The screen Library: all takes with pictures; search, tags, stars; many at once; import.

import { download, get, query, request, send } from "./api.js";
import { draw } from "./thumbnails.js";
import { byUse, fill, find, make, onChange, onClick, round, say, trying } from "./dom.js";

const still = matchMedia("(prefers-reduced-motion: reduce)");
const PAGE = 60; // takes that are asked for at once
const AHEAD = "600px"; // below what is seen, where the next are asked for
const MOST_PICTURES = 600; // that are kept in memory
const MOST_SHOWN = 8; // takes on the stage at once
const PATIENCE = 200; // milliseconds without a key before a search

export class Library {
  /** `go` leads to a screen by its name, `compare` puts two takes side by side. */
  constructor(studio, go, compare) {
    Object.assign(this, { studio, go, compare, takes: [], chosen: new Map(), pictures: new Map(), unfolded: new Set() });
    fill(find("zip-format"), byUse(studio.capabilities.formats));
    this.seen = new IntersectionObserver((entries) => {
      for (const { isIntersecting, target } of entries) if (isIntersecting) this.#paint(target);
    });
    const end = ([{ isIntersecting }]) => isIntersecting && trying(() => this.list(this.takes.length));
    this.end = new IntersectionObserver(end, { rootMargin: AHEAD, scrollMargin: AHEAD });
    let waiting = 0;
    find("query").addEventListener("input", () => {
      clearTimeout(waiting);
      find("grid").ariaBusy = "true";
      waiting = setTimeout(() => trying(() => this.list()), PATIENCE);
    });
    find("filters").addEventListener("submit", (event) => event.preventDefault());
    for (const id of ["tag", "only-stars", "only-deleted"]) onChange(id, () => this.list());
    onClick("more", () => this.list(this.takes.length));
    onClick("import", () => find("import-file").click());
    onChange("import-file", (field) => this.import([...field.files]).finally(() => (field.value = "")));
    onClick("choose-all", () => this.chooseAll());
    onClick("show-chosen", () => this.open(this.#theChosen(1, MOST_SHOWN)));
    onClick("compare-chosen", () => this.compare(this.#theChosen(2, 2)));
    onClick("set-tags", () => this.tag());
    onClick("export-chosen", () => this.export());
    onClick("delete-chosen", () => this.remove(true));
    onClick("restore-chosen", () => this.remove(false));
    studio.addEventListener("library", () => this.refresh());
    studio.addEventListener("edited", () => this.refresh());
    this.#showChosen();
  }

  /** Lists what the filters let through, from `offset` on. */
  async list(offset = 0) {
    const filters = { query: find("query").value.trim(), tag: find("tag").value };
    if (find("only-stars").checked) filters.star = true;
    if (find("only-deleted").checked) filters.deleted = true;
    for (const [name, value] of Object.entries(filters)) if (!value) delete filters[name];
    const asked = (this.asked = Symbol("list"));
    find("grid").ariaBusy = "true";
    const { total, takes, tags } = await get(`takes?${query({ ...filters, offset, limit: PAGE })}`).finally(() => {
      if (asked === this.asked) find("grid").ariaBusy = "false";
    });
    if (asked !== this.asked) return;
    this.takes = offset ? [...this.takes, ...takes] : takes;
    const known = tags ?? [...new Set(this.takes.flatMap((take) => take.tags))].sort();
    fill(find("tag"), [["", "all"], ...known.map((tag) => [tag, tag])], filters.tag ?? "");
    const cards = stacks(takes).flatMap((stack) => this.#cards(stack));
    if (offset) find("grid").append(...cards);
    else find("grid").replaceChildren(...cards);
    find("more").hidden = this.takes.length >= total;
    find("total").textContent = total === 1 ? "1 take" : `${total.toLocaleString("en")} takes`;
    const isFiltered = Object.keys(filters).length > 0;
    find("nothing").hidden = total > 0;
    find("nothing").textContent = isFiltered
      ? "No take is like this. Search for other words, or take the filters away."
      : "No takes yet: write what a person does on the screen Make, or import a file.";
    find("grid").dataset.listed = String(this.takes.length);
    // Observed anew, it tells at once where it is still in sight.
    this.end.disconnect();
    this.end.observe(find("more"));
  }

  refresh() {
    if (document.body.dataset.screen === "library") trying(() => this.list());
  }

  // Takes of one recipe are a single card until they are unfolded.
  #cards(stack) {
    const [{ id }] = stack;
    if (stack.length === 1) return [this.#card(stack[0])];
    const fold = make("button", {
      ...{ type: "button", className: "fold", textContent: `${stack.length} takes` },
      aria: { expanded: this.unfolded.has(id) },
      on: { click: () => this.#fold(stack) },
    });
    if (!this.unfolded.has(id)) return [this.#stack(stack, fold)];
    return stack.map((take, number) => this.#card(take, number ? [] : [fold]));
  }

  #fold(stack) {
    const old = stack.map(({ id }) => find("grid").querySelector(`li[data-take="${id}"]`)).filter(Boolean);
    if (!this.unfolded.delete(stack[0].id)) this.unfolded.add(stack[0].id);
    const cards = this.#cards(stack);
    old[0].before(...cards);
    old.forEach((card) => card.remove());
    cards[0].querySelector(".fold").focus();
  }

  #stack(stack, fold) {
    const [first] = stack;
    const shown = stack.find(({ star }) => star) ?? first;
    const all = `${stack.length} takes of ${first.title}`;
    const tick = make("input", {
      ...{ type: "checkbox", checked: stack.every(({ id }) => this.chosen.has(id)) },
      aria: { label: `Select ${all}` },
      on: { change: ({ target }) => stack.forEach((take) => this.#choose(take, target.checked)) },
    });
    const picture = this.#picture(shown, `Show ${all}`, () => this.open(stack.slice(0, MOST_SHOWN)));
    const name = make("p", { className: "title", textContent: first.title });
    const line = make("p", { className: "soft", textContent: [`${round(shown.seconds)} s`, dayOf(first), ...first.tags].filter(Boolean).join(" · ") });
    line.append(fold);
    return make("li", { className: "stack", data: { take: first.id } }, picture, tick, name, line);
  }

  #picture(take, label, show) {
    const picture = make("button", {
      ...{ type: "button", className: "picture", data: { take: take.id } },
      aria: { label },
      on: { click: () => trying(show), pointerenter: () => take.missing || still.matches || this.#play(take, picture) },
    });
    if (take.missing) picture.textContent = "File missing: make again";
    else this.seen.observe(picture);
    return picture;
  }

  #card(take, more = []) {
    const { id, title, star, seconds, tags, missing, recipe } = take;
    const seed = recipe.seed === undefined ? "imported" : `seed ${recipe.seed}`;
    const facts = [`${round(seconds)} s`, seed, dayOf(take), ...tags];
    const tick = make("input", {
      ...{ type: "checkbox", checked: this.chosen.has(id) },
      aria: { label: `Select ${title}` },
      on: { change: ({ target }) => this.#choose(take, target.checked) },
    });
    const label = missing ? `Make ${title} again: its file is missing` : `Show ${title}`;
    const picture = this.#picture(take, label, () => (missing ? this.bringBack(take) : this.open([take])));
    const name = make("textarea", {
      ...{ value: title, className: "title", maxLength: 200, rows: 2 },
      aria: { label: `Title of ${title}` },
      on: {
        change: ({ target }) => this.edit("Rename", take, { title: target.value.trim() }),
        keydown: (event) => {
          if (event.key !== "Enter") return;
          event.preventDefault();
          event.target.blur();
        },
      },
    });
    const starred = make("button", {
      ...{ type: "button", className: "star", textContent: star ? "★" : "☆" },
      aria: { label: `Star ${title}`, pressed: star },
      on: { click: () => this.edit(star ? "Remove star" : "Star", take, { star: !star }) },
    });
    const line = make("p", { className: "soft", textContent: facts.filter(Boolean).join(" · ") });
    line.append(...more);
    return make("li", { data: { take: id } }, picture, tick, starred, name, line);
  }

  // Pictures are drawn as they come into view.
  async #paint(place) {
    this.seen.unobserve(place);
    const take = this.takes.find(({ id }) => id === place.dataset.take);
    if (!take) return;
    const key = `${take.id} ${JSON.stringify(take.edits)}`;
    if (!this.pictures.has(key)) {
      this.pictures.set(key, this.#drawn(take));
      if (this.pictures.size > MOST_PICTURES) this.#dropPicture();
    }
    const source = await this.pictures.get(key).catch(() => this.pictures.delete(key) && null);
    if (source) place.replaceChildren(make("img", { src: source, alt: "" }));
  }

  async #drawn(take) {
    const [motion] = await this.studio.motionsOf([take]);
    const blob = await new Promise((done) => draw(motion).toBlob(done));
    return URL.createObjectURL(blob);
  }

  // While the pointer is over a picture, the take moves.
  async #play(take, place) {
    const [motion] = await this.studio.motionsOf([take]);
    const canvas = make("canvas", { width: 440, height: 240 });
    const still = place.querySelector("img");
    const began = performance.now();
    const frame = (now) => {
      if (!place.matches(":hover") || !place.isConnected) {
        canvas.replaceWith(still ?? "");
        return;
      }
      const content = draw(motion, ((now - began) / 1000) % motion.seconds);
      const context = canvas.getContext("2d");
      context.clearRect(0, 0, canvas.width, canvas.height);
      context.drawImage(content, 0, 0);
      requestAnimationFrame(frame);
    };
    if (!still) return;
    still.replaceWith(canvas);
    requestAnimationFrame(frame);
  }

  // The oldest; what shows it goes on showing it.
  #dropPicture() {
    const [[key, picture]] = this.pictures;
    this.pictures.delete(key);
    picture.then(URL.revokeObjectURL, () => {});
  }

  /** Makes a take whose file is missing again from its recipe. */
  async bringBack({ id, title }) {
    const { equal } = await send("POST", `takes/${id}/again`);
    await this.list();
    say(equal ? `${title} is there again.` : `${title} came out otherwise than it was.`, !equal);
  }

  edit(name, take, fields) {
    return trying(() => this.studio.edit(name, take, fields));
  }

  #choose(take, isChosen) {
    if (isChosen) this.chosen.set(take.id, take);
    else this.chosen.delete(take.id);
    this.#showChosen();
  }

  chooseAll() {
    const isAll = this.takes.every(({ id }) => this.chosen.has(id));
    this.chosen = new Map(isAll ? [] : this.takes.map((take) => [take.id, take]));
    for (const tick of find("grid").querySelectorAll("input[type=checkbox]")) tick.checked = !isAll;
    this.#showChosen();
  }

  #showChosen() {
    const { size } = this.chosen;
    find("chosen").hidden = !size;
    find("chosen-count").textContent = `${size} selected`;
    const deleted = [...this.chosen.values()].some((take) => take.deleted);
    for (const id of ["show-chosen", "set-tags", "export-chosen", "delete-chosen", "chosen-tags"]) {
      find(id).disabled = !size;
    }
    find("compare-chosen").disabled = size !== 2;
    find("restore-chosen").hidden = !deleted;
    find("delete-chosen").hidden = deleted;
  }

  #theChosen(least, most) {
    const takes = [...this.chosen.values()];
    if (takes.length >= least && takes.length <= most) return takes;
    throw new Error(`${takes.length} takes are selected; select ${least === most ? least : `${least} to ${most}`}.`);
  }

  async open(takes) {
    await this.studio.open(takes);
    this.go("make");
  }

  async tag() {
    const tags = find("chosen-tags").value.split(",").map((tag) => tag.trim()).filter(Boolean);
    for (const take of this.#theChosen(1, Infinity)) await this.studio.edit("Tags", take, { tags });
    this.#forget();
    say(tags.length ? `Tagged ${tags.join(", ")}.` : "Tags removed.");
  }

  async export() {
    const ids = this.#theChosen(1, Infinity).map(({ id }) => id);
    const format = find("zip-format").value;
    say(`Saved ${await download("POST", "export", "takes.zip", { ids, format })}.`);
  }

  async remove(isDeleted) {
    const takes = this.#theChosen(1, Infinity);
    await this.studio.remove(takes, isDeleted);
    this.#forget();
    say(`${takes.length} ${isDeleted ? "deleted. Ctrl+Z brings them back" : "restored"}.`);
  }

  // What was chosen has changed by now.
  #forget() {
    this.chosen.clear();
    this.#showChosen();
    this.refresh();
  }

  async import(files) {
    for (const file of files) {
      let take = null;
      const redo = async () => {
        if (take) await request("POST", `takes/${take.id}/restore`);
        else take = await (await request("POST", `import?${query({ name: file.name })}`, { body: file })).json();
        this.refresh();
      };
      const undo = async () => {
        await request("DELETE", `takes/${take.id}`);
        this.refresh();
      };
      await this.studio.history.act("Import", redo, undo);
      say(`Imported ${file.name}.`);
    }
  }
}

/** Takes in their order, those that differ in nothing but their seed together. */
function stacks(takes) {
  const all = [];
  let last = null;
  for (const take of takes) {
    const { seed, ...recipe } = take.recipe;
    const key = seed === undefined || take.missing ? null : JSON.stringify([take.title, recipe]);
    if (key !== null && key === last) all.at(-1).push(take);
    else all.push([take]);
    last = key;
  }
  return all;
}

const dayOf = ({ made }) => (made ? new Date(made).toLocaleDateString("en") : "");
