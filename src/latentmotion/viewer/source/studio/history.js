// What was done, so that it can be undone and done again, one thing after the other.

export class History extends EventTarget {
  constructor() {
    super();
    Object.assign(this, { past: [], future: [], last: Promise.resolve() });
  }

  /** Does `redo` and remembers how to undo it. */
  act(name, redo, undo) {
    return this.#inTurn(async () => {
      const result = await redo();
      this.past.push({ name, redo, undo });
      this.future = [];
      return result;
    });
  }

  /** Undoes the last thing; returns its name, or undefined where there is none. */
  undo() {
    return this.#move(this.past, this.future, "undo");
  }

  redo() {
    return this.#move(this.future, this.past, "redo");
  }

  #move(from, to, which) {
    return this.#inTurn(async () => {
      const action = from.at(-1);
      if (!action) return undefined;
      await action[which]();
      to.push(from.pop());
      return action.name;
    });
  }

  #inTurn(work) {
    const done = this.last.then(work).finally(() => this.dispatchEvent(new Event("change")));
    this.last = done.catch(() => {});
    return done;
  }
}
