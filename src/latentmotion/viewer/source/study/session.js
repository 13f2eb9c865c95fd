// What a rater has answered, kept in the browser, so that a closed page can be gone on with.

const FORMAT = "latentmotion study answers 1";

export class Session {
  constructor(study) {
    this.study = study;
    this.storage = `latentmotion-study-${study.study}`;
    this.isKept = true;
    const kept = this.#read();
    this.rater = kept.rater ?? randomName();
    this.name = kept.name ?? "";
    this.given = kept.given ?? {};
  }

  /** The answer to one question of a pair: {choice, seconds}, or undefined. */
  get(pair, question) {
    return this.given[pair.id]?.[question];
  }

  set(pair, question, choice, seconds) {
    this.given[pair.id] = { ...this.given[pair.id], [question]: { choice, seconds } };
    this.keep();
  }

  isDone(pair) {
    return pair.questions.every((question) => this.get(pair, question));
  }

  get done() {
    return this.study.pairs.filter((pair) => this.isDone(pair)).length;
  }

  /** What is downloaded. */
  answers() {
    const answers = this.study.pairs.flatMap((pair) =>
      pair.questions
        .filter((question) => this.get(pair, question))
        .map((question) => ({ pair: pair.id, question, ...this.get(pair, question) })),
    );
    const { rater, name } = this;
    const saved = new Date().toISOString();
    return { format: FORMAT, study: this.study.study, rater, name, saved, answers };
  }

  download() {
    const text = JSON.stringify(this.answers(), null, 1);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = `answers-${this.rater}.json`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  keep() {
    const { rater, name, given } = this;
    try {
      localStorage.setItem(this.storage, JSON.stringify({ rater, name, given }));
    } catch {
      this.isKept = false;
    }
  }

  #read() {
    try {
      return JSON.parse(localStorage.getItem(this.storage)) ?? {};
    } catch {
      this.isKept = false;
      return {};
    }
  }
}

function randomName() {
  const bytes = crypto.getRandomValues(new Uint8Array(6));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}
