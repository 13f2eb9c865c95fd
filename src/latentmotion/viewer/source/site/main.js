// The site: a sentence → takes side by side, made in this page by the model in its worker.

import { boneLengths, Motion } from "../motion.js";
import { colorsOf } from "../colors.js";
import { Player } from "../player.js";
import { bvh, fileName, npz, save } from "./files.js";
import { fromAddress, fromForm, intoForm, toAddress } from "./recipe.js";

const find = (id) => document.getElementById(id);
const form = find("make");
const player = new Player(find("view"), margins, showTime);
let generator = null;
let skeleton = null; // the drawn body: one for all takes, so that its skin is made once
let made = []; // the motions that are shown
let asked = 0; // number of the last request; answers to earlier ones are dropped

function margins() {
  return { above: find("top").offsetHeight, below: find("panel").offsetHeight };
}

function say(words, kind = "") {
  find("status").textContent = words;
  find("status").className = kind;
}

function megabytes(count) {
  return (count / 1e6).toFixed(1);
}

async function open() {
  say("Loading the model …");
  const { load } = await import("./latentmotion.js");
  generator = await load("model/", {
    runtime: "ort-wasm-simd-threaded.wasm",
    progress: ({ loaded, total }) => {
      find("loaded").value = total ? loaded / total : 0;
      say(`Loading the model: ${megabytes(loaded)} of ${megabytes(total)} MB, once`);
    },
  });
  const { model } = generator;
  const { steps, guidance, seconds } = form.elements;
  steps.replaceChildren(...model.steps.map((count) => new Option(count, count)));
  [guidance.min, guidance.max] = model.guidance;
  [seconds.min, seconds.max] = model.frames.map((count) => count / model.fps);
  intoForm(form, { ...model.usual, ...fromAddress(location.hash, model) });
  find("license").textContent = `Model ${model.name}, ${model.license}.`;
  find("generate").disabled = false;
  find("loaded").hidden = true;
  document.body.dataset.state = "ready";
  say("Ready. Write what a person does.");
  if (form.elements.prompt.value) await generate();
}

async function generate() {
  const recipe = fromForm(form);
  if (!recipe.prompt) {
    say("Write what a person does, e.g. a person walks and sits down.", "wrong");
    form.elements.prompt.focus();
    return;
  }
  asked += 1;
  const mine = asked;
  history.replaceState(null, "", toAddress(recipe));
  document.body.dataset.state = "busy";
  const { prompt, takes, seed, ...rest } = recipe;
  const started = performance.now();
  const motions = [];
  try {
    for (let take = 0; take < takes; take++) {
      say(takes > 1 ? `Making take ${take + 1} of ${takes} …` : "Making …");
      motions.push(await generator.generate(prompt, { ...rest, seed: seed + take }));
      if (mine !== asked) return;
    }
    show(motions);
    say(`${motions[0].seconds} s of motion in ${Math.round(performance.now() - started)} ms.`);
  } catch (error) {
    say(error.message, "wrong");
  }
  document.body.dataset.state = "ready";
}

function show(motions) {
  made = motions;
  skeleton ??= { ...motions[0].skeleton, lengths: boneLengths(motions[0]) };
  const shown = motions.map(
    (motion) => new Motion({ caption: motion.prompt, fps: motion.fps }, skeleton, motion.joints),
  );
  const colors = colorsOf(motions);
  player.show(shown, colors);
  const buttons = motions.map((motion, take) => takeButton(motion, take, colors[take]));
  find("takes").replaceChildren(...buttons);
  find("takes").hidden = find("panel").hidden = find("save").hidden = false;
  find("scrub").max = player.timeline.seconds;
  player.fit();
  document.body.dataset.takes = motions.length;
}

function takeButton(motion, take, color) {
  const button = document.createElement("button");
  button.type = "button";
  button.style.setProperty("--take", color);
  button.textContent = `seed ${motion.seed}`;
  button.title = `Look at this take alone; saved files hold it alone then (${take + 1})`;
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => {
    const alone = button.getAttribute("aria-pressed") !== "true";
    for (const other of find("takes").children) other.setAttribute("aria-pressed", "false");
    button.setAttribute("aria-pressed", String(alone));
    player.watch(alone ? take : null);
  });
  return button;
}

/** The takes to save: the one that is looked at, or all. */
function chosen() {
  const pressed = [...find("takes").children].findIndex(
    (button) => button.getAttribute("aria-pressed") === "true",
  );
  return pressed < 0 ? made.map((_, take) => take) : [pressed];
}

function showTime() {
  const { time, seconds, playing } = player.timeline;
  find("scrub").value = time;
  find("scrub").style.setProperty("--done", `${(100 * time) / (seconds || 1)}%`);
  find("scrub").setAttribute("aria-valuetext", `${time.toFixed(1)} of ${seconds.toFixed(1)} s`);
  find("time").textContent = `${time.toFixed(1)} / ${seconds.toFixed(1)} s`;
  find("play").textContent = playing ? "Pause" : "Play";
}

const savers = {
  npz: () => {
    const motions = chosen().map((take) => made[take]);
    save(fileName(motions[0], "npz"), npz(motions));
  },
  bvh: () => {
    for (const take of chosen()) save(fileName(made[take], "bvh"), bvh(player.takes[take]));
  },
};

form.addEventListener("submit", (event) => {
  event.preventDefault();
  if (generator) generate();
});
find("die").addEventListener("click", () => {
  [form.elements.seed.value] = crypto.getRandomValues(new Uint32Array(1));
  if (generator) generate();
});
find("play").addEventListener("click", () => player.timeline.play(!player.timeline.playing));
find("scrub").addEventListener("input", () => {
  player.timeline.play(false);
  player.timeline.seek(Number(find("scrub").value));
});
for (const [ending, write] of Object.entries(savers)) find(ending).addEventListener("click", write);
find("share").addEventListener("click", async () => {
  try {
    await navigator.clipboard.writeText(location.href);
    say("The address is copied: it makes the same motions anywhere.");
  } catch {
    say("Copy the page's address: it makes the same motions anywhere.");
  }
});
addEventListener("hashchange", () => {
  if (!generator) return;
  intoForm(form, fromAddress(location.hash, generator.model));
  generate();
});
document.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|SELECT|BUTTON|TEXTAREA|SUMMARY)$/.test(event.target.tagName);
  if (event.key !== " " || typing || !made.length) return;
  event.preventDefault();
  player.timeline.play(!player.timeline.playing);
});

window.latentmotion = { player, motions: () => made, npz: () => npz(made), bvh };
navigator.serviceWorker?.register("service.js").catch(() => {});
open().catch((error) => {
  document.body.dataset.state = "failed";
  say(`The model can't be loaded: ${error.message}`, "wrong");
});
