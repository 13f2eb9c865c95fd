// Time of the page: playing, paused, its speed, and who wants to know.

const SPEEDS = [0.1, 0.25, 0.5, 1, 1.5, 2, 4];
const REST_AT_END = 0.5; // seconds that the last pose stays before the motion starts again

export class Timeline extends EventTarget {
  constructor(seconds) {
    super();
    this.seconds = seconds;
    this.playing = false;
    this.speed = 1;
    this.clock = 0;
  }

  /** Seconds into the motion, never past its end. */
  get time() {
    return Math.min(this.clock, this.seconds);
  }

  /** The time as a clock and a screen reader say it. */
  get words() {
    return [`${this.time.toFixed(2)} / ${this.seconds.toFixed(2)} s`, `${this.time.toFixed(2)} of ${this.seconds.toFixed(2)} s`];
  }

  advance(elapsed) {
    if (!this.playing || !this.seconds) return;
    this.clock += elapsed * this.speed;
    if (this.clock > this.seconds + REST_AT_END * this.speed) this.clock = 0;
    this.#tell("time");
  }

  seek(time) {
    this.clock = Math.min(Math.max(time, 0), this.seconds);
    this.#tell("time");
  }

  play(playing = true) {
    if (playing && this.time >= this.seconds) this.clock = 0;
    this.playing = playing;
    this.#tell("state");
  }

  /** Moves `steps` along the list of speeds. */
  faster(steps) {
    const at = SPEEDS.indexOf(this.speed) + steps;
    this.setSpeed(SPEEDS[Math.min(Math.max(at, 0), SPEEDS.length - 1)]);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.#tell("state");
  }

  #tell(what) {
    this.dispatchEvent(new Event(what));
  }
}

export { SPEEDS };
