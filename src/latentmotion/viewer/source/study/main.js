// The user study's page: welcome → pairs, one at a time → thanks; answers can be saved at any time.

import { readMotions } from "../motion.js";
import { Ballot } from "./ballot.js";
import { Scene } from "./scene.js";
import { Session } from "./session.js";

const find = (id) => document.getElementById(id);
const text = find("study").textContent;
const study = JSON.parse(text);
const motions = readMotions(text);
const session = new Session(study);
const ballot = new Ballot(find("questions"), study, session, update);
const dark = matchMedia("(prefers-color-scheme: dark)");
const still = matchMedia("(prefers-reduced-motion: reduce)");
let scene = null;
let at = 0; // number of the pair that is shown

function showView(name) {
  document.body.dataset.view = name;
  for (const view of document.querySelectorAll("[data-of]")) view.hidden = view.dataset.of !== name;
}

function showPair(number) {
  at = Math.min(Math.max(number, 0), study.pairs.length - 1);
  const pair = study.pairs[at];
  showView("pair");
  find("prompt").textContent = pair.prompt;
  find("prompt").hidden = !pair.prompt;
  ballot.show(pair);
  scene?.dispose();
  scene = new Scene(find("scene"), motions.slice(2 * at, 2 * at + 2), margins);
  scene.setDark(dark.matches);
  scene.timeline.addEventListener("time", showTime);
  scene.timeline.addEventListener("state", showState);
  find("scrub").max = scene.timeline.seconds;
  scene.fit();
  scene.timeline.play(!still.matches);
  showTime();
  update();
}

function margins() {
  return { below: find("ballot").offsetHeight + 14, above: find("top").offsetHeight };
}

function showTime() {
  const { time, seconds } = scene.timeline;
  find("scrub").value = time;
  find("scrub").style.setProperty("--done", `${(100 * time) / (seconds || 1)}%`);
  find("scrub").setAttribute("aria-valuetext", scene.timeline.words[1]);
}

function showState() {
  find("play").setAttribute("aria-label", scene.timeline.playing ? "Pause" : "Play");
  find("play").classList.toggle("playing", scene.timeline.playing);
}

function update() {
  const pair = study.pairs[at];
  const total = study.pairs.length;
  find("count").textContent = `${at + 1} of ${total}`;
  find("bar").style.setProperty("--done", `${(100 * session.done) / total}%`);
  find("bar").setAttribute("aria-valuenow", session.done);
  find("back").disabled = at === 0;
  find("next").disabled = !session.isDone(pair);
  find("next").textContent = at + 1 === total ? "Finish" : "Next";
  find("unkept").hidden = session.isKept;
  document.body.dataset.done = session.done;
}

function next() {
  if (!session.isDone(study.pairs[at])) return;
  if (at + 1 < study.pairs.length) showPair(at + 1);
  else finish();
}

function finish() {
  const open = study.pairs.findIndex((pair) => !session.isDone(pair));
  if (open >= 0) {
    showPair(open);
    return;
  }
  scene?.timeline.play(false);
  showView("end");
}

function start() {
  session.name = find("name").value.trim();
  session.keep();
  const open = study.pairs.findIndex((pair) => !session.isDone(pair));
  if (open < 0) finish();
  else showPair(open);
}

function welcome() {
  const total = study.pairs.length;
  const minutes = Math.max(1, Math.round(total / 3));
  find("size").textContent =
    `${total} ${total === 1 ? "pair" : "pairs"}, about ${minutes} ${minutes === 1 ? "minute" : "minutes"}.`;
  find("asked").replaceChildren(
    ...Object.values(study.questions).map((question) => {
      const item = document.createElement("li");
      item.textContent = question;
      return item;
    }),
  );
  find("name").value = session.name;
  if (session.done) find("start").textContent = `Go on (${session.done} of ${total} done)`;
  find("bar").setAttribute("aria-valuemax", total);
  showView("welcome");
  update();
}

const keys = {
  ArrowLeft: () => ballot.choose("left"),
  ArrowRight: () => ballot.choose("right"),
  ArrowUp: () => ballot.move(-1),
  ArrowDown: () => ballot.move(1),
  Enter: next,
  Backspace: () => showPair(at - 1),
  " ": () => scene.timeline.play(!scene.timeline.playing),
};

document.addEventListener("keydown", (event) => {
  const { key, target } = event;
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  if (document.body.dataset.view !== "pair" || !keys[key]) return;
  const isChoice = target.dataset?.side !== undefined;
  if (target.tagName === "INPUT" && key.startsWith("Arrow")) return;
  if (target.tagName === "BUTTON" && (key === " " || (key === "Enter" && !isChoice))) return;
  event.preventDefault();
  keys[key]();
});

find("start").addEventListener("click", start);
find("name").addEventListener("keydown", ({ key }) => key === "Enter" && start());
find("next").addEventListener("click", next);
find("back").addEventListener("click", () => showPair(at - 1));
find("again").addEventListener("click", () => showPair(0));
find("play").addEventListener("click", keys[" "]);
find("scrub").addEventListener("input", () => {
  scene.timeline.play(false);
  scene.timeline.seek(Number(find("scrub").value));
});
for (const id of ["save", "download"]) find(id).addEventListener("click", () => session.download());
dark.addEventListener("change", () => scene?.setDark(dark.matches));

let last = null;
function frame(now) {
  scene?.frame(now - (last ?? now));
  last = now;
  requestAnimationFrame(frame);
}

welcome();
requestAnimationFrame(frame);
