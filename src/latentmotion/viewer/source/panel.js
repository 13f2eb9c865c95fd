// What the hand sees and touches: captions, takes, play, scrub, speed, follow, help.

import { SPEEDS } from "./timeline.js";

const find = (id) => document.getElementById(id);

export class Panel {
  constructor(timeline, stage, motions, colors) {
    Object.assign(this, { timeline, stage, motions });
    this.#writeCaptions(colors);
    this.#writeSpeeds();
    this.#writeSpans(colors);
    this.#wire();
    timeline.addEventListener("time", () => this.#showTime());
    timeline.addEventListener("state", () => this.#showState());
    this.#showTime();
    this.#showState();
  }

  // One prompt with several takes is one caption; several prompts are named take by take.
  #writeCaptions(colors) {
    const captions = this.motions.map(({ caption }) => caption);
    const same = captions.every((caption) => caption === captions[0]);
    find("caption").textContent = same ? captions[0] : "";
    find("caption").hidden = !same || !captions[0];
    find("takes").hidden = captions.length < 2;
    find("takes").classList.toggle("named", !same);
    this.takes = captions.map((caption, i) => this.#takeButton(i, same ? "" : caption, colors[i]));
    find("takes").append(...this.takes);
    find("view").setAttribute("aria-label", `Animated figure: ${captions.join("; ")}`);
  }

  #takeButton(take, caption, color) {
    const button = document.createElement("button");
    button.type = "button";
    button.style.setProperty("--take", color);
    const words = document.createElement("span");
    words.textContent = caption ? `${take + 1}  ${caption}` : `${take + 1}`;
    button.append(words);
    button.setAttribute("aria-pressed", "false");
    button.title = `Look at take ${take + 1}${caption && ": "}${caption}`;
    button.addEventListener("click", () => {
      this.watch(button.getAttribute("aria-pressed") === "true" ? null : take);
    });
    return button;
  }

  #writeSpeeds() {
    const options = SPEEDS.map((speed) => new Option(`${speed}×`, speed));
    find("speed").append(...options);
  }

  // Prompts with their times and ticks of goals above the time bar, those of the first take.
  #writeSpans(colors) {
    const take = Math.max(this.motions.findIndex(({ marks }) => Object.keys(marks).length), 0);
    const { spans = [], goals = [], path = [], poses = [] } = this.motions[take].marks;
    const percent = (time) => `${(100 * time) / (this.timeline.seconds || 1)}%`;
    // Those of parts of the body are above those of the whole, at one time one above the other.
    const rows = [];
    const words = spans.map(({ prompt, start, end, part }) => {
      const span = document.createElement("span");
      const free = rows.findIndex((until, row) => (part ? row > 0 : true) && until <= start);
      const row = free < 0 ? Math.max(rows.length, part ? 1 : 0) : free;
      rows[row] = end;
      span.textContent = span.title = part ? `${part}: ${prompt}` : prompt;
      span.style.setProperty("--row", row);
      span.style.left = percent(start);
      span.style.width = percent(Math.min(end, this.timeline.seconds) - start);
      return span;
    });
    const times = [...[...goals, ...path].map(({ at }) => at), ...poses];
    const ticks = [...new Set(times)].map((time) => {
      const tick = document.createElement("i");
      tick.style.left = percent(time);
      return tick;
    });
    find("marks").hidden = !words.length && !ticks.length;
    find("marks").style.setProperty("--take", colors[take]);
    find("marks").append(...words, ...ticks);
    find("track").classList.toggle("spans", words.length > 0);
    find("track").style.setProperty("--rows", rows.length);
  }

  #wire() {
    const { timeline, stage } = this;
    find("scrub").max = timeline.seconds;
    find("play").addEventListener("click", () => timeline.play(!timeline.playing));
    find("scrub").addEventListener("input", () => timeline.seek(Number(find("scrub").value)));
    find("speed").addEventListener("change", () => timeline.setSpeed(Number(find("speed").value)));
    find("follow").addEventListener("click", () => this.follow());
    find("reset").addEventListener("click", () => stage.reset());
    find("help").addEventListener("click", () => this.help());
    find("keys").addEventListener("click", () => find("keys").close());
  }

  follow() {
    this.stage.setFollow(!this.stage.follow);
    find("follow").setAttribute("aria-pressed", this.stage.follow);
  }

  watch(take) {
    if (take !== null && take >= this.motions.length) return;
    this.stage.watch(take);
    this.takes.forEach((button, i) => button.setAttribute("aria-pressed", i === take));
  }

  help() {
    const keys = find("keys");
    if (keys.open) keys.close();
    else keys.showModal();
  }

  #showTime() {
    const { time, seconds } = this.timeline;
    find("scrub").value = time;
    find("scrub").style.setProperty("--done", `${(100 * time) / (seconds || 1)}%`);
    find("scrub").setAttribute("aria-valuetext", this.timeline.words[1]);
    find("time").textContent = this.timeline.words[0];
  }

  #showState() {
    const { playing, speed } = this.timeline;
    find("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    find("play").classList.toggle("playing", playing);
    find("speed").value = speed;
  }
}
