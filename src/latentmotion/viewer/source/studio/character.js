// The screen Character: the user's figure, which bone moves with which joint, the motion on it.

import { FIGURES } from "../figures.js";
import { get, query, request, send } from "./api.js";
import { fill, find, make, onChange, onClick, round, say, trying, words } from "./dom.js";

export class CharacterScreen {
  /** `restage` draws the stage again; `isShown` says if this screen is there. */
  constructor(studio, restage, isShown) {
    Object.assign(this, { studio, restage, isShown, characters: [], current: null });
    fill(find("character-format"), studio.capabilities.character_formats ?? ["glb", "bvh"]);
    onClick("character-open", () => find("character-file").click());
    onChange("character-file", (field) => this.add(field.files[0]).finally(() => (field.value = "")));
    onChange("character-list", ({ value }) => this.choose(value));
    onChange("scale", () => this.restage());
    onClick("character-export", () => this.export());
    onClick("character-delete", () => this.remove());
    for (const kind of ["dragover", "drop"]) {
      document.addEventListener(kind, (event) => {
        if (!this.isShown()) return;
        event.preventDefault();
        if (kind === "drop" && event.dataTransfer.files.length) trying(() => this.add(event.dataTransfer.files[0]));
      });
    }
  }

  /** The motion on the mannequin, and on the character beside it. */
  actors() {
    const { take } = this.studio;
    if (!take) return [];
    const plain = { take, figure: "mannequin" };
    return this.current ? [plain, { take, figure: this.current.id, isScaled: find("scale").checked }] : [plain];
  }

  /** Says how high the character is, and offers to scale it, where it is not of a person's size. */
  showSize() {
    const height = this.studio.player.stage.figures?.find((figure) => figure.trueHeight)?.trueHeight;
    find("scale-row").hidden = !height || (height > 1.3 && height < 2.2);
    if (height) find("scale-words").textContent = `${round(height, 1)} m high: show it 1.7 m high`;
  }

  async list() {
    this.offer((await get("characters")).characters);
  }

  offer(characters) {
    this.characters = characters;
    const known = this.characters.map(({ id, name }) => [id, name]);
    fill(find("character-list"), known.length ? known : [["", "none yet"]], this.current?.id);
    fill(find("figure"), [...Object.entries(FIGURES), ...known], this.studio.figure);
    const current = this.characters.find(({ id }) => id === find("character-list").value);
    this.current = current ?? null;
    this.#show();
  }

  choose(id) {
    this.current = this.characters.find((character) => character.id === id) ?? null;
    this.#show();
    return this.restage();
  }

  async add(file) {
    if (!file) return;
    say(`Reading ${file.name} …`);
    let character = null;
    const redo = async () => {
      if (character) return this.#mark(character, false);
      const answer = await request("POST", `characters?${query({ name: file.name })}`, { body: file });
      this.current = character = await answer.json();
      return this.#changed();
    };
    const undo = () => this.#mark(character, true);
    await this.studio.history.act("Open character", redo, undo);
    const { missing } = character;
    const lack = missing.length ? `; no bone for ${missing.map(words).join(", ")}` : "";
    say(`${character.name}: ${character.bones.length} bones${lack}.`);
  }

  // Deletes a character, or brings it back.
  async #mark(character, isDeleted) {
    const path = `characters/${character.id}`;
    await (isDeleted ? request("DELETE", path) : request("POST", `${path}/restore`));
    this.current = isDeleted ? null : character;
    await this.#changed();
  }

  async #changed() {
    if (!(this.studio.figure in FIGURES)) this.studio.figure = "mannequin";
    await this.list();
    await this.restage();
  }

  #show() {
    const character = this.current;
    find("character-body").hidden = !character;
    if (!character) return;
    const { bones, mapping, guessed, problem } = character;
    const facts = `${bones.length} bones, ${guessed.length} joints guessed`;
    find("character-facts").textContent = problem ? `${facts}; ${problem}.` : `${facts}.`;
    const { joints } = this.studio.capabilities;
    this.prefix = commonPrefix(bones);
    find("bones").tBodies[0].replaceChildren(
      ...joints.map((joint) => this.#row(joint, mapping[joint] ?? null, bones)),
    );
  }

  #row(joint, bone, bones) {
    const isGuessed = this.current.guessed.includes(joint);
    const select = make("select", {
      aria: { label: `Bone of ${words(joint)}` },
      on: { change: ({ target }) => trying(() => this.#assign(joint, target.value || null)) },
    });
    fill(select, [["", "– none –"], ...bones.map((name) => [name, name.slice(this.prefix.length)])], bone ?? "");
    const carrier = bone ? null : this.#carrier(joint);
    const state = bone ? (isGuessed ? "guessed" : "") : carrier ? "carried" : "missing";
    const name = make("th", { scope: "row" }, words(joint));
    // Whatever bones a spine has share out how pelvis and chest are turned.
    const isSpine = carrier && joint.startsWith("spine");
    const told = isSpine ? "the spine bends as a whole" : carrier ? `moves with ${carrier}` : state;
    if (state) name.append(make("small", { className: state, textContent: told }));
    return make("tr", { data: { joint, state } }, name, make("td", {}, select));
  }

  // The bone that a joint without one moves with: that of the nearest joint above which has one.
  #carrier(joint) {
    const { joints, parents } = this.studio.capabilities;
    const { mapping } = this.current;
    if (!/spine|neck|collar|foot/.test(joint)) return null; // without limbs of its own it looks wrong
    let above = parents[joints.indexOf(joint)];
    while (above >= 0 && !mapping[joints[above]]) above = parents[above];
    return above >= 0 ? mapping[joints[above]].slice(this.prefix.length) : null;
  }

  #assign(joint, bone) {
    const character = this.current;
    const put = (mapping) => async () => {
      this.current = await send("PATCH", `characters/${character.id}`, { mapping });
      await this.list();
      await this.restage();
    };
    const { mapping } = character;
    const done = this.studio.history.act("Bone", put({ ...mapping, [joint]: bone }), put(mapping));
    return done.catch((error) => {
      this.#show();
      throw error;
    });
  }

  async export() {
    if (!this.studio.take) throw new Error("There is no take yet: make one first.");
    const format = find("character-format").value;
    say(`Saved ${await this.studio.export(this.studio.take, format, this.current.id)}.`);
  }

  async remove() {
    const character = this.current;
    const mark = (isDeleted) => () => this.#mark(character, isDeleted);
    await this.studio.history.act("Remove character", mark(true), mark(false));
    say("Character removed. Ctrl+Z brings it back.");
  }
}

// What all names of bones begin with, up to a mark such as a colon.
function commonPrefix(names) {
  const first = names[0]?.match(/^.*?[:_|]/)?.[0] ?? "";
  return names.every((name) => name.startsWith(first)) ? first : "";
}
