// Sentences to token ids, as the package `tokenizers` makes them in Python.

import { Tokenizer } from "@huggingface/tokenizers";

export class Sentences {
  /**
   * @param {object} file The parsed `tokenizer.json`.
   * @param {{mostPieces: number | null, padding: object | null}} model What the model's card says.
   */
  constructor(file, { mostPieces, padding }) {
    this.tokenizer = new Tokenizer(file, {});
    this.most = mostPieces ?? Infinity;
    this.padding = padding;
    this.around = this.tokenizer.encode("").ids.length; // marks at the start and the end
  }

  /** Returns the ids of a sentence; pieces beyond the longest sentence are left out. */
  ids(sentence) {
    const { ids } = this.tokenizer.encode(sentence);
    const closing = Math.floor(this.around / 2);
    const cut = ids.length > this.most;
    const kept = cut ? [...ids.slice(0, this.most - closing), ...ids.slice(-closing)] : ids;
    const missing = (this.padding?.strategy?.Fixed ?? 0) - kept.length;
    return missing > 0 ? [...kept, ...new Array(missing).fill(this.padding.pad_id)] : kept;
  }
}
