// The studio: screens around one stage and one clock; motions come from the server that sent the page.

import { colorsOf } from "../colors.js";
import { OWN, standing } from "../mannequin.js";
import { Player } from "../player.js";
import { SPEEDS } from "../timeline.js";
import { get, NoSession, openSession } from "./api.js";
import { CharacterScreen } from "./character.js";
import { Compare } from "./compare.js";
import { Directions } from "./direct.js";
import { find, fill, make, onChange, onClick, press, say, trying } from "./dom.js";
import { listen } from "./keys.js";
import { Library } from "./library.js";
import { MakeScreen } from "./make.js";
import { Models } from "./models.js";
import { Projects } from "./projects.js";
import { record, savePicture } from "./record.js";
import { keepWork, restoreWork } from "./restore.js";
import { Studio } from "./studio.js";

const NAMES = { make: "Make", library: "Library", character: "Character", compare: "Compare" };
const FLICK = 350; // milliseconds that a flick takes at most
const isPhone = matchMedia("(max-width: 820px)");

const player = new Player(find("view"), margins, showTime);
open().then(
  () => (document.body.dataset.state = "ready"),
  (error) => fail(error),
);

// What lies over the stage: on a phone, buttons below, and the words about the best take above.
function margins() {
  if (document.body.dataset.takes === "0") return { above: 44, below: find("examples").offsetHeight + 24 };
  if (!isPhone.matches) return { above: 44, below: 8 };
  return { above: document.body.dataset.screen === "make" ? 96 : 52, below: 52 };
}

// One card in place of the page: what is wrong, and what to do.
function fail(error) {
  document.body.dataset.state = "failed";
  find("failed-words").textContent = error.message;
  find("sign-in").hidden = !(error instanceof NoSession);
  find("sign-in").addEventListener("submit", async (event) => {
    event.preventDefault();
    await openSession(find("sign-in-address").value).then(() => location.reload(), (wrong) => {
      find("failed-words").textContent = wrong.message;
    });
  });
  onClick("failed-again", () => location.reload());
}

async function open() {
  document.body.dataset.takes = "0";
  const asked = openSession().then(() => Promise.all(["capabilities", "models", "characters"].map(get)));
  const stand = () => player.stage ?? player.show([standing(OWN)], colorsOf([null]), { play: true });
  requestAnimationFrame(() => requestAnimationFrame(stand)); // after the page's first picture, while the server answers
  const [capabilities, { models }, { characters }] = await asked;
  stand();
  const studio = new Studio(capabilities, player);
  const screens = {};
  const restage = (stay) => trying(() => stageOf(studio, screens, stay));
  new Models(studio, models);
  screens.make = new MakeScreen(studio);
  const directions = new Directions(studio, () => document.body.dataset.screen === "make");
  screens.character = new CharacterScreen(studio, restage, () => document.body.dataset.screen === "character");
  screens.compare = new Compare(studio, restage, (recipe, count) => {
    go("make");
    return screens.make.make(recipe, count);
  });
  screens.library = new Library(studio, go, async (pair) => {
    screens.compare.pair = pair;
    go("compare");
  });
  const projects = new Projects(studio);
  const enter = () => trying(() => enterScreen(studio, screens, restage));

  studio.addEventListener("takes", () => restage(false));
  studio.addEventListener("edited", () => restage(true));
  studio.addEventListener("pick", () => {
    if (document.body.dataset.screen === "character") restage(false);
    if (isPressed("alone") || isPhone.matches) look(studio, true);
  });
  studio.history.addEventListener("change", () => showHistory(studio.history));
  addEventListener("hashchange", enter);
  wire(studio, directions, restage);
  listenToFlicks(studio);
  listen(keysOf(studio, screens, directions, projects));
  fold();
  about(studio.capabilities);
  studio.addEventListener("capabilities", () => about(studio.capabilities));
  screens.character.offer(characters);
  await restoreWork(studio);
  keepWork(studio, screens.make);
  await enter();
  find("prompt").focus({ preventScroll: true });
  waitForModel();
  performance.measure("ready", { start: 0, end: performance.now() });
  window.latentmotion = { studio, player, directions };
}

// The model is read while the page is.
async function waitForModel() {
  const isWarm = await fetch("/readyz").then(({ ok }) => ok, () => false);
  find("generate").disabled = !isWarm;
  if (!isWarm) setTimeout(waitForModel, 300);
  else document.body.dataset.model = "warm";
}

function go(screen) {
  location.hash = screen;
}

async function enterScreen(studio, screens, restage) {
  const wished = location.hash.slice(1);
  const screen = NAMES[wished] ? wished : "make";
  document.body.dataset.screen = screen;
  document.title = `${NAMES[screen]} – Latent Motion studio`;
  find("screen-name").textContent = NAMES[screen];
  for (const link of find("screens").children) {
    if (link.hash === `#${screen}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  say("");
  await screens[screen].list?.();
  if (screen !== "library") await restage(false);
}

async function stageOf(studio, screens, stay) {
  const { screen } = document.body.dataset;
  if (screen === "library") return;
  const actors = screens[screen].actors();
  document.body.dataset.takes = String(actors.length);
  press("alone", false);
  if (actors.length) await studio.stage(actors, { overlay: screen === "compare" && screens.compare.overlay, stay });
  else await studio.stand(screen === "character" ? screens.character.current : null, find("scale").checked);
  if (screen === "character") screens.character.showSize();
  if (screen === "make" && isPhone.matches && actors.length > 1) look(studio, true); // there is room for one
}

function look(studio, isAlone) {
  press("alone", isAlone);
  player.watch(isAlone && studio.takes.length ? studio.picked : null);
}

// A flick over the stage picks the next take, or the one before.
function listenToFlicks(studio) {
  let began = null;
  find("view").addEventListener("touchstart", ({ touches, timeStamp }) => {
    began = touches.length === 1 ? { x: touches[0].clientX, y: touches[0].clientY, timeStamp } : null;
  }, { passive: true });
  find("view").addEventListener("touchend", ({ changedTouches: [{ clientX, clientY }], timeStamp }) => {
    if (!began || document.body.dataset.screen !== "make" || find("scene").dataset.tool) return;
    const [across, up] = [clientX - began.x, clientY - began.y];
    if (timeStamp - began.timeStamp > FLICK || Math.abs(across) < 60 || Math.abs(up) > Math.abs(across) / 2) return;
    studio.pick(studio.picked + (across < 0 ? 1 : -1));
  });
}

function isPressed(id) {
  return find(id).getAttribute("aria-pressed") === "true";
}

function wire(studio, directions, restage) {
  const { timeline } = player;
  fill(find("speed"), SPEEDS.map((speed) => [speed, `${speed}×`]), 1);
  onClick("play", () => timeline.play(!timeline.playing));
  find("scrub").addEventListener("input", () => {
    timeline.play(false);
    timeline.seek(Number(find("scrub").value));
  });
  onChange("speed", ({ value }) => timeline.setSpeed(Number(value)));
  onChange("figure", ({ value }) => {
    studio.figure = value;
    return restage(true);
  });
  onClick("follow", () => {
    player.stage.setFollow(!player.stage.follow);
    press("follow", player.stage.follow);
  });
  onClick("above", () => directions.lookFromAbove());
  onClick("save-picture", async () => say(`Saved ${await savePicture(player)}.`));
  onClick("save-video", () => record(player));
  onClick("alone", () => look(studio, !isPressed("alone")));
  onClick("undo", () => move(studio, "undo"));
  onClick("redo", () => move(studio, "redo"));
  for (const [button, dialog] of [["open-keys", "keys"], ["open-settings", "settings"]]) {
    onClick(button, () => find(dialog).showModal());
  }
}

async function move(studio, which) {
  const name = await studio.history[which]();
  const done = which === "undo" ? "Undone" : "Done again";
  say(name ? `${done}: ${name}.` : `Nothing to ${which}.`);
}

function showHistory({ past, future }) {
  for (const [id, list, words] of [["undo", past, "Undo"], ["redo", future, "Redo"]]) {
    find(id).disabled = !list.length;
    find(id).title = list.length ? `${words}: ${list.at(-1).name}` : words;
  }
}

function keysOf(studio, screens, directions, projects) {
  const { timeline, stage } = player;
  const { make: making, compare } = screens;
  const staged = ["make", "character", "compare"];
  const step = (frames) => {
    const frame = 1 / (player.takes[0]?.fps ?? 20);
    timeline.play(false);
    timeline.seek((Math.round(timeline.time / frame) + frames) * frame);
  };
  const click = (id) => () => find(id).click();
  return [
    ["Enter", "in the prompt: generate", () => making.generate(), ["make"]],
    ["1–9", "pick a take", (key) => studio.pick(Number(key) - 1), ["make", "character"]],
    ["Space", "play, pause", () => timeline.play(!timeline.playing), staged],
    ["ArrowLeft", "a frame back", () => step(-1), staged],
    ["ArrowRight", "a frame on", () => step(1), staged],
    ["Home", "to the start", () => timeline.seek(0), staged],
    ["End", "to the end", () => timeline.seek(timeline.seconds), staged],
    ["[", "slower", () => timeline.faster(-1), staged],
    ["]", "faster", () => timeline.faster(1), staged],
    ["z or 0", "the picked take alone, all", click("alone"), ["make"]],
    ["f", "camera follows", click("follow"), staged],
    ["v", "look from above", click("above"), staged],
    ["r", "camera back", () => stage.reset(), staged],
    ["ArrowUp", "nearer", () => stage.zoom(0.9), staged],
    ["ArrowDown", "farther", () => stage.zoom(1.1), staged],
    ["Shift+ArrowLeft", "turn the camera left", () => stage.turn(-0.12), staged],
    ["Shift+ArrowRight", "turn the camera right", () => stage.turn(0.12), staged],
    ["/", "to the prompt, or the search", () => find(isLibrary() ? "query" : "prompt").focus()],
    ["n", "add a prompt", () => !find("add-segment").hidden && making.strip.add(), ["make"]],
    ["p", "draw the path", () => directions.choose("path"), ["make"]],
    ["k", "place a goal", () => directions.choose("goal"), ["make"]],
    ["j", "a goal where the joint is now", () => directions.keepPose(), ["make"]],
    ["i", "the take starts here", () => making.trimHere(0), ["make"]],
    ["o", "the take ends here", () => making.trimHere(1), ["make"]],
    ["s", "star", () => making.star(), ["make"]],
    ["d", "duplicate", () => making.duplicate(), ["make"]],
    ["Delete", "delete the take", () => making.remove(), ["make"]],
    ["e", "export", () => making.export(), ["make"]],
    ["g", "ghost overlay", () => compare.setOverlay(!compare.overlay), ["compare"]],
    ["m", "Make", () => go("make")],
    ["l", "Library", () => go("library")],
    ["c", "Character", () => go("character")],
    ["x", "Compare", () => go("compare")],
    ["Ctrl+Z", "undo", () => move(studio, "undo")],
    ["Ctrl+Shift+Z or Ctrl+Y", "do again", () => move(studio, "redo")],
    ["Ctrl+S", "save the project", () => (find("project-name").value ? projects.save() : projects.show())],
    ["Escape", "put the tool away, leave the field", () => directions.end() || document.activeElement.blur()],
    ["?", "these keys", () => (find("keys").open ? find("keys").close() : find("keys").showModal())],
  ];
}

function isLibrary() {
  return document.body.dataset.screen === "library";
}

// Where there is room, the take's panel is open.
function fold() {
  const set = () => {
    for (const panel of document.querySelectorAll("details.fold")) {
      panel.open = !isPhone.matches && panel.id === "take";
    }
  };
  isPhone.addEventListener("change", set);
  set();
}

function about({ version, library, fps, seconds, formats }) {
  const rows = {
    Version: version ?? "",
    Library: library ?? "",
    "Frames a second": fps,
    Seconds: `${seconds.least} to ${seconds.most}`,
    Formats: formats.map((format) => format[0]?.length > 1 ? format[0] : format).join(", "),
  };
  const cells = Object.entries(rows).flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, String(value))]);
  find("about").replaceChildren(...cells);
}

function showTime() {
  const { time, seconds, playing, speed } = player.timeline;
  find("scrub").max = seconds;
  find("scrub").value = time;
  find("scrub").setAttribute("aria-valuetext", player.timeline.words[1]);
  find("time").textContent = player.timeline.words[0];
  find("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  find("play").classList.toggle("playing", playing);
  find("speed").value = speed;
}
