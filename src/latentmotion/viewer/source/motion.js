// Motions as the page carries them, and the pose at any moment between two frames.

/** Reads the page's motions: positions relative to the root as int16 steps, the root as float32. */
export function readMotions(text) {
  const { skeletons, motions } = JSON.parse(text);
  return motions.map((entry) => {
    const skeleton = skeletons[entry.skeleton];
    return new Motion(entry, skeleton, absolutePositions(entry, skeleton.names.length * 3));
  });
}

export class Motion {
  /** `positions` are frames * joints * 3, meters; `marks` say what was asked of the motion. */
  constructor({ caption, fps, marks = {} }, skeleton, positions) {
    Object.assign(this, { caption, fps, marks, skeleton, positions });
    this.size = skeleton.names.length * 3;
    this.frames = positions.length / this.size;
    this.seconds = this.frames / this.fps; // the last pose is there for a frame, too
  }

  /** Joint positions (joints * 3, meters) at `time` seconds: a Catmull-Rom curve through frames. */
  sample(time, out = new Float32Array(this.size)) {
    const at = Math.min(Math.max(time * this.fps, 0), this.frames - 1);
    const frame = Math.min(Math.floor(at + 1e-6), Math.max(this.frames - 2, 0));
    const weights = catmullRom(Math.max(at - frame, 0));
    out.fill(0);
    weights.forEach((weight, i) => this.#accumulate(frame + i - 1, weight, out));
    return out;
  }

  #accumulate(frame, weight, out) {
    const start = Math.min(Math.max(frame, 0), this.frames - 1) * this.size;
    for (let i = 0; i < this.size; i++) out[i] += weight * this.positions[start + i];
  }

  /** Ground position [x, z] of the root at frame `frame`. */
  ground(frame) {
    const start = Math.min(Math.max(frame, 0), this.frames - 1) * this.size;
    return [this.positions[start], this.positions[start + 2]];
  }
}

function absolutePositions({ root, relative, step }, size) {
  const roots = new Float32Array(bytes(root));
  const steps = new Int16Array(bytes(relative));
  return Float32Array.from(steps, (value, i) => {
    const frame = Math.floor(i / size);
    return roots[frame * 3 + (i % 3)] + value * step;
  });
}

/** What a base64 text stands for. */
export function bytes(base64) {
  return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0)).buffer;
}

function catmullRom(u) {
  const u2 = u * u;
  const u3 = u2 * u;
  return [
    (-u3 + 2 * u2 - u) / 2,
    (3 * u3 - 5 * u2 + 2) / 2,
    (-3 * u3 + 4 * u2 + u) / 2,
    (u3 - u2) / 2,
  ];
}

/** The root's path on the ground as [x, z] per frame, smoothed over a second: what a camera follows. */
export function smoothPath(motion) {
  const reach = Math.round(motion.fps / 2);
  return Array.from({ length: motion.frames }, (_, frame) => {
    const sum = [0, 0];
    for (let i = frame - reach; i <= frame + reach; i++) {
      motion.ground(i).forEach((value, axis) => (sum[axis] += value));
    }
    return sum.map((value) => value / (2 * reach + 1));
  });
}

/** The value of a per-frame path at `time` seconds, linear between frames. */
export function alongPath(path, fps, time) {
  const at = Math.min(Math.max(time * fps, 0), path.length - 1);
  const frame = Math.min(Math.floor(at), Math.max(path.length - 2, 0));
  const [here, next] = [path[frame], path[Math.min(frame + 1, path.length - 1)]];
  return here.map((value, axis) => value + (next[axis] - value) * (at - frame));
}

/** Distance along x that sets each take beside the one before, so that they never overlap. */
export function lineUp(motions, gap = 1.3, most = 3.6) {
  const starts = motions.map((motion) => motion.ground(0)[0]);
  const offsets = [0];
  for (let i = 1; i < motions.length; i++) {
    let apart = 0;
    const frames = Math.max(motions[i - 1].frames, motions[i].frames);
    for (let f = 0; f < frames; f++) {
      const left = motions[i - 1].ground(f)[0] - starts[i - 1];
      apart = Math.max(apart, left - (motions[i].ground(f)[0] - starts[i]));
    }
    offsets.push(offsets[i - 1] + Math.min(apart + gap, most));
  }
  const middle = offsets[offsets.length - 1] / 2;
  return motions.map((motion, i) => [offsets[i] - middle - starts[i], -motion.ground(0)[1]]);
}
