// Pictures and videos of the stage, made by the browser itself.

import { save } from "../site/files.js";
import { sizeOf } from "./api.js";
import { find, press, say } from "./dom.js";

const KINDS = ["video/mp4;codecs=avc1.42E01E", "video/webm;codecs=vp9", "video/webm"];
const RATE = 30; // pictures a second
const BITS = 8e6; // a second

/** Saves what the stage shows; returns the file's name. */
export async function savePicture({ stage, timeline }) {
  stage.stale = true;
  stage.draw(); // what a canvas shows is there only until its next picture
  const picture = await new Promise((done) => stage.canvas.toBlob(done, "image/png"));
  const name = `motion-${timeline.time.toFixed(2)}s.png`;
  save(name, picture, "image/png");
  return `${name}, ${sizeOf(picture)}`;
}

let running = null;

/** Records the motion from its start to its end, once; a second call ends it there. */
export function record({ stage, timeline }) {
  if (running) {
    running.stop();
    return;
  }
  const mimeType = globalThis.MediaRecorder && KINDS.find((kind) => MediaRecorder.isTypeSupported(kind));
  if (!mimeType) throw new Error("This browser records no video; latentmotion render -o take.mp4 does.");
  const recorder = (running = new MediaRecorder(stage.canvas.captureStream(RATE), { mimeType, videoBitsPerSecond: BITS }));
  const parts = [];
  const end = () => timeline.time >= timeline.seconds && recorder.stop();
  recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
  recorder.addEventListener("stop", () => {
    timeline.removeEventListener("time", end);
    running = null;
    press("save-video", false);
    const name = `motion.${mimeType.startsWith("video/mp4") ? "mp4" : "webm"}`;
    const video = new Blob(parts, { type: mimeType });
    save(name, video, mimeType);
    say(`Saved ${name}, ${sizeOf(video)}.`);
  });
  press("save-video", true);
  say("Recording until the end of the motion …");
  timeline.seek(0);
  timeline.play(true);
  timeline.addEventListener("time", end);
  recorder.start();
}
