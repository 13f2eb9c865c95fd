// The questions of a pair: a row each, two buttons a row; one row is current, for the keys.

const SIDES = { left: "Left", right: "Right" };

export class Ballot {
  /** `changed` is called after every answer. */
  constructor(place, study, session, changed) {
    Object.assign(this, { place, study, session, changed });
  }

  show(pair) {
    this.pair = pair;
    this.since = performance.now();
    this.rows = pair.questions.map((question) => this.#row(question));
    this.place.replaceChildren(...this.rows.map(({ row }) => row));
    const open = pair.questions.findIndex((question) => !this.session.get(pair, question));
    this.current = Math.max(open, 0);
    this.#mark();
  }

  /** Answers a question, by default the current one, and goes on to the next that is open. */
  choose(side, index = this.current) {
    const seconds = Math.round(performance.now() - this.since) / 1000;
    this.session.set(this.pair, this.pair.questions[index], side, seconds);
    this.current = Math.min(index + 1, this.rows.length - 1);
    this.#mark();
    this.changed();
  }

  move(steps) {
    this.current = Math.min(Math.max(this.current + steps, 0), this.rows.length - 1);
    this.#mark();
  }

  #row(question) {
    const row = element("div", { className: "question", role: "group" });
    const words = element("p", { id: `ask-${question}`, textContent: this.study.questions[question] });
    row.setAttribute("aria-labelledby", words.id);
    const index = this.pair.questions.indexOf(question);
    const buttons = Object.entries(SIDES).map(([side, label]) => {
      const button = element("button", { type: "button", className: side, textContent: label });
      button.dataset.side = side;
      button.addEventListener("click", () => this.choose(side, index));
      return button;
    });
    const choices = element("div", { className: "choices" });
    choices.append(...buttons);
    row.append(words, choices);
    return { row, buttons, question };
  }

  #mark() {
    this.rows.forEach(({ row, buttons, question }, index) => {
      row.classList.toggle("current", index === this.current);
      const choice = this.session.get(this.pair, question)?.choice;
      row.classList.toggle("answered", choice !== undefined);
      for (const button of buttons) {
        button.setAttribute("aria-pressed", button.dataset.side === choice);
      }
    });
  }
}

function element(tag, properties) {
  const { role, ...plain } = properties;
  const made = Object.assign(document.createElement(tag), plain);
  if (role) made.setAttribute("role", role);
  return made;
}
