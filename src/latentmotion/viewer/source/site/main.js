// The site: a sentence → takes side by side, made in this page by the model in its worker.

import { Motion } from "../motion.js";
import { colorsOf } from "../colors.js";
import { stick } from "../figures.js";
import { OWN, standing } from "../mannequin.js";
import { Player } from "../player.js";
import { bvh, fileName, metadataOf, npz, save } from "./files.js";
import { glb } from "./glb.js";
import { fromAddress, fromForm, intoForm, toAddress } from "./recipe.js";

const find = (id) => document.getElementById(id);
const form = find("make");
const player = new Player(find("view"), margins, showTime);
const READY = {
  sentences: "Ready. Write what a person does.",
  labels: "Ready. Choose what the person does.",
  nothing: "Ready. This model moves as it likes: press Generate.",
};
let generator = null;
let body = null; // the drawn skeleton, one for all takes
let shown = []; // motions as they are shown and saved
let asked = 0; // number of the last request

/** The skeleton of a model, with the lengths of its bones. */
function bodyOf(own) {
  return { ...own, lengths: own.directions.map((offset) => Math.hypot(...offset)) };
}

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
  player.show([standing(OWN)], colorsOf([null]), { play: true });
  new ResizeObserver(() => player.fit()).observe(find("panel"));
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
  body = bodyOf(model.skeleton);
  const { steps, guidance, seconds } = form.elements;
  steps.replaceChildren(...model.steps.map((count) => new Option(count, count)));
  [guidance.min, guidance.max] = model.guidance;
  [seconds.min, seconds.max] = model.frames.map((count) => count / model.fps);
  askFor(model);
  intoForm(form, { ...model.usual, ...fromAddress(location.hash, model) });
  find("license").textContent = `Weights of ${model.name}: ${model.weightsLicense}. ${model.rights}`;
  find("generate").disabled = false;
  find("loaded").hidden = true;
  document.body.dataset.state = "ready";
  const { prompts = "sentences" } = model;
  say(READY[prompts]);
  const isAsked = prompts === "sentences" ? form.elements.prompt.value : location.hash.length > 1;
  if (isAsked) await generate();
}

/** Makes the field of the prompt what the model takes: a sentence, one of its labels, or nothing. */
function askFor({ prompts, labels }) {
  if (prompts === "nothing") find("prompt").hidden = true;
  if (prompts !== "labels") return;
  const menu = document.createElement("select");
  Object.assign(menu, { id: "prompt", name: "prompt" });
  menu.replaceChildren(...labels.map((label) => new Option(label)));
  find("prompt").replaceWith(menu);
}

async function generate() {
  const recipe = fromForm(form);
  if (!recipe.prompt && generator.model.prompts !== "nothing") {
    say("Write what a person does, e.g. a person walks and sits down.", "wrong");
    form.elements.prompt.focus();
    return;
  }
  history.replaceState(null, "", toAddress(recipe));
  const { prompt, takes, seed, ...rest } = recipe;
  await request(async (isWanted) => {
    const started = performance.now();
    const motions = [];
    for (let take = 0; take < takes; take++) {
      say(takes > 1 ? `Making take ${take + 1} of ${takes} …` : "Making …");
      motions.push(await generator.generate(prompt, { ...rest, seed: seed + take }));
      if (!isWanted()) return;
    }
    const took = Math.round(performance.now() - started);
    if (!isWanted()) return;
    await show(motions);
    if (isWanted()) say(`${motions[0].seconds} s of motion in ${took} ms.`);
  });
}

/** Does what was asked for last; of earlier requests nothing is shown any more. */
async function request(work) {
  asked += 1;
  const mine = asked;
  const isWanted = () => mine === asked;
  document.body.dataset.state = "busy";
  try {
    await work(isWanted);
  } catch (error) {
    if (isWanted()) say(error.message, "wrong");
  }
  if (isWanted()) document.body.dataset.state = "ready";
}

async function show(motions, stay = false) {
  shown = motions;
  const skeleton = await body;
  if (motions !== shown) return; // others are shown by now
  const takes = motions.map(
    (motion) => new Motion({ caption: motion.prompt, fps: motion.fps }, skeleton, motion.joints),
  );
  const colors = colorsOf(motions);
  const makers = find("figure").value === "stick" ? takes.map(() => stick) : [];
  player.show(takes, colors, { stay, makers, play: true });
  const alone = stay ? [...find("takes").children].findIndex(isPressed) : -1;
  const buttons = motions.map((motion, take) => takeButton(motion, take, colors[take]));
  find("takes").replaceChildren(...buttons);
  buttons[alone]?.click();
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
    const alone = !isPressed(button);
    for (const other of find("takes").children) other.setAttribute("aria-pressed", "false");
    button.setAttribute("aria-pressed", String(alone));
    player.watch(alone ? take : null);
  });
  return button;
}

const isPressed = (button) => button.getAttribute("aria-pressed") === "true";

/** The takes to save: the one that is looked at, or all. */
function chosen() {
  const pressed = [...find("takes").children].findIndex(isPressed);
  return pressed < 0 ? shown.map((_, take) => take) : [pressed];
}

function showTime() {
  const { time, seconds, playing } = player.timeline;
  find("scrub").value = time;
  find("scrub").style.setProperty("--done", `${(100 * time) / (seconds || 1)}%`);
  find("scrub").setAttribute("aria-valuetext", player.timeline.words[1]);
  find("time").textContent = player.timeline.words[0];
  find("play").textContent = playing ? "Pause" : "Play";
}

function write() {
  const format = find("format").value;
  const motions = chosen().map((take) => shown[take]);
  if (format === "npz") {
    save(fileName(motions[0], "npz"), npz(motions));
  } else if (format === "glb") {
    save(fileName(motions[0], "glb"), glb(chosen().map((take) => player.takes[take]), motions.map(metadataOf)), "model/gltf-binary");
  } else {
    for (const take of chosen()) save(fileName(shown[take], "bvh"), bvh(player.takes[take]));
  }
}

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
find("write").addEventListener("click", write);
find("figure").addEventListener("change", () => show(shown, true));
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
  if (event.key !== " " || typing || !shown.length) return;
  event.preventDefault();
  player.timeline.play(!player.timeline.playing);
});

window.latentmotion = { player, motions: () => shown, npz: () => npz(shown), bvh };
navigator.serviceWorker?.register("service.js").catch(() => {});
open().catch((error) => {
  document.body.dataset.state = "failed";
  say(`The model can't be loaded: ${error.message}`, "wrong");
});
