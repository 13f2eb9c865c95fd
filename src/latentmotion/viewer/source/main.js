// The page: motions → stage, timeline, panel, keys; and `window.latentmotion` for programs.

import { colorsOf } from "./colors.js";
import { skinned, stick } from "./figures.js";
import { listenToKeys } from "./keyboard.js";
import { readMotions } from "./motion.js";
import { Pace } from "./pace.js";
import { Panel } from "./panel.js";
import { openStage } from "./stage.js";
import { Timeline } from "./timeline.js";

const content = document.getElementById("motions").textContent;
const motions = readMotions(content);
const colors = colorsOf(motions);
const timeline = new Timeline(Math.max(...motions.map(({ seconds }) => seconds)));
const stage = makeStage();
const panel = new Panel(timeline, stage, motions, colors);

function makeStage() {
  const canvas = document.getElementById("view");
  const { figure } = JSON.parse(content); // none: the drawn person
  const makers = figure?.skin ? skinned(figure) : motions.map(() => figure && stick);
  return openStage(canvas, motions, colors, { makers });
}

// A notebook may lay its frames out late, a window may change: the view is chosen anew for each size,
// until a hand has chosen one.
function fit() {
  const height = (id) => document.getElementById(id).offsetHeight;
  if (!stage.canvas.clientWidth || !stage.canvas.clientHeight) return;
  stage.resize(height("panel"), height("words"));
  if (!stage.touched) stage.reset();
}

/** Joint positions now, meters, in each motion's own space: takes × joints × 3. */
function joints() {
  return motions.map((motion) => {
    const flat = [...motion.sample(timeline.time)];
    return motion.skeleton.names.map((_, j) => flat.slice(j * 3, j * 3 + 3));
  });
}

// For tests and scripts: `page.html#t=1.5` opens paused at 1.5 s, and says the pose in the DOM.
function obeyAddress() {
  const time = new URLSearchParams(location.hash.slice(1)).get("t");
  if (time === null) return false;
  timeline.play(false);
  timeline.seek(Number(time));
  document.body.dataset.joints = JSON.stringify(joints());
  stage.draw();
  return true;
}

function everyFrame() {
  const pace = new Pace(timeline, stage);
  let last = null;
  const frame = (now) => {
    const took = now - (last ?? now);
    pace.frame(took);
    timeline.advance(Math.min(took, 250) / 1000);
    last = now;
    stage.draw();
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => stage.setDark(dark.matches));
stage.setDark(dark.matches);
timeline.addEventListener("time", () => stage.showTime(timeline.time));
addEventListener("hashchange", obeyAddress);
new ResizeObserver(fit).observe(stage.canvas);
listenToKeys(timeline, stage, panel, 1 / motions[0].fps);
stage.showTime(0);
fit();
document.body.dataset.stage = stage.name;
if (!obeyAddress()) timeline.play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
everyFrame();

window.latentmotion = {
  /** Pauses and shows the pose at `seconds`. */
  setTime(seconds) {
    timeline.play(false);
    timeline.seek(seconds);
    stage.draw();
  },
  joints,
  play: () => timeline.play(),
  pause: () => timeline.play(false),
  get time() {
    return timeline.time;
  },
  seconds: timeline.seconds,
  stage: stage.name,
};
