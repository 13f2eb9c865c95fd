// Joint positions → rotations of bones: what skinned figures are driven by.
//
// Quaternions are [x, y, z, w], as in three.js and glTF. Where three joints move as one piece (hips,
// chest, feet) they fix the rotation. Elsewhere a bone swings with its parent by the smallest turn
// onto its direction; the spine shares the twist between hips and chest.

// Triples of joints that fix the rotation of a bone.
const FRAMES = {
  pelvis: ["right_hip", "left_hip", "spine1"],
  spine3: ["right_collar", "left_collar", "neck"],
  left_ankle: ["left_ankle", "left_foot", "left_knee"],
  right_ankle: ["right_ankle", "right_foot", "right_knee"],
};
const T_POSE = { // directions of bones, where they are not those of the skeleton
  shoulder: [1, 0, 0], elbow: [1, 0, 0], wrist: [1, 0, 0], collar: [1, 1, 0],
  knee: [0.122, -0.993, 0], ankle: [0.052, -0.999, 0], neck: [0, 1, 0], head: [0, 1, 0],
};

export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
export const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
export const inverse = ([x, y, z, w]) => [-x, -y, -z, w];

export function unit(v) {
  const length = Math.sqrt(dot(v, v)) || 1;
  return v.map((value) => value / length);
}

/** The rotation `b` followed by `a`. */
export function product([ax, ay, az, aw], [bx, by, bz, bw]) {
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

export function rotate(q, v) {
  const axis = q.slice(0, 3);
  const twice = cross(axis, v).map((value) => 2 * value);
  const again = cross(axis, twice);
  return v.map((value, i) => value + q[3] * twice[i] + again[i]);
}

/** The smallest turn of one direction to another. */
export function between(from, to) {
  const [a, b] = [unit(from), unit(to)];
  const cosine = dot(a, b);
  if (cosine > -1 + 1e-9) return unit([...cross(a, b), 1 + cosine]);
  return [...unit(cross(a, Math.abs(a[0]) > 0.9 ? [0, 1, 0] : [1, 0, 0])), 0];
}

function slerp(a, b, share) {
  const cosine = dot(a, b);
  const near = cosine < 0 ? b.map((value) => -value) : b;
  const angle = Math.acos(Math.min(Math.abs(cosine), 1));
  if (angle < 1e-6) return a;
  const [left, right] = [Math.sin((1 - share) * angle), Math.sin(share * angle)];
  return unit(a.map((value, i) => left * value + right * near[i]));
}

// Columns of the axes x, y, z of three points.
function axes(a, b, c) {
  const x = unit(subtract(b, a));
  const z = unit(cross(x, subtract(c, a)));
  return [x, cross(z, x), z];
}

// The turn from one set of axes to another: R = to · fromᵀ as a quaternion, its largest part first.
function turn(from, to) {
  const m = [0, 1, 2].map((r) => [0, 1, 2].map((c) => [0, 1, 2].reduce((sum, k) => sum + to[k][r] * from[k][c], 0)));
  const [[a, b, c], [d, e, f], [g, h, i]] = m;
  const rows = [
    [1 + a - e - i, b + d, c + g, h - f], [b + d, 1 - a + e - i, f + h, c - g],
    [c + g, f + h, 1 - a - e + i, d - b], [h - f, c - g, d - b, 1 + a + e + i],
  ];
  const largest = rows.map((row, n) => row[n]).reduce((best, value, n, all) => (value > all[best] ? n : best), 0);
  return unit(rows[largest]);
}

/** Median length of each bone, meters. */
export function boneLengths({ joints, skeleton: { parents }, frames }) {
  return parents.map((parent, joint) => {
    if (parent < 0) return 0;
    const lengths = Array.from({ length: frames }, (_, frame) => {
      const at = (j, axis) => joints[(frame * parents.length + j) * 3 + axis];
      return Math.hypot(...[0, 1, 2].map((axis) => at(joint, axis) - at(parent, axis)));
    });
    return lengths.sort((a, b) => a - b)[Math.floor(frames / 2)];
  });
}

/** Positions of a skeleton's joints in its T-pose, meters; `fitted` are directions that are known better. */
export function tPose({ names, parents, directions }, lengths, fitted = []) {
  const places = [];
  names.forEach((name, joint) => {
    const known = T_POSE[name.replace(/^(left|right)_/, "")];
    const mirrored = known && [name.startsWith("right_") ? -known[0] : known[0], known[1], known[2]];
    const way = unit(fitted[joint] ?? mirrored ?? directions[joint]);
    const from = places[parents[joint]] ?? [0, 0, 0];
    places.push(from.map((value, i) => value + (parents[joint] < 0 ? 0 : lengths[joint] * way[i])));
  });
  return places;
}

/** Finds the rotations that carry a skeleton's resting joints ([x, y, z] each) to positions. */
export class Rotations {
  constructor({ names, parents }, rest) {
    Object.assign(this, { names, parents, rest });
    this.child = names.map((_, joint) => parents.indexOf(joint));
    this.frames = names.map((name, joint) => this.#rigidFrame(name, joint));
    this.sharing = names.map((_, joint) => this.#twistShare(joint));
    this.restAxes = this.frames.map((frame) => frame && axes(...frame.map((one) => rest[one])));
  }

  /** Rotations in the world of all joints, from positions that follow each other (joints × 3). */
  at(positions) {
    const joints = this.rest.map((_, joint) => [0, 1, 2].map((axis) => positions[3 * joint + axis]));
    const world = this.frames.map((frame, joint) => {
      return frame && turn(this.restAxes[joint], axes(...frame.map((one) => joints[one])));
    });
    world.forEach((found, joint) => (world[joint] = found ?? this.#swing(joint, joints, world)));
    return world;
  }

  // Of the known ones, else of a joint and two children.
  #rigidFrame(name, joint) {
    const known = FRAMES[name]?.map((one) => this.names.indexOf(one));
    if (known?.every((one) => one >= 0)) return known;
    const children = this.names.map((_, child) => child).filter((child) => this.parents[child] === joint);
    return children.length > 1 ? [joint, children[0], children[1]] : null;
  }

  // For a bone in a chain between two rigid pieces: [upper piece, lower piece, part of the way].
  #twistShare(joint) {
    let [below, steps, above, more] = [joint, 0, joint, 0];
    for (; below >= 0 && !this.frames[below]; steps++) below = this.parents[below];
    for (; above >= 0 && !this.frames[above]; more++) above = this.child[above];
    const isSpine = above >= 0 && this.names[above] === "spine3";
    return isSpine ? [below, above, steps / (steps + more)] : null;
  }

  #swing(joint, joints, world) {
    const [share, child] = [this.sharing[joint], this.child[joint]];
    const start = share ? slerp(world[share[0]], world[share[1]], share[2]) : world[this.parents[joint]] ?? [0, 0, 0, 1];
    if (child < 0) return start;
    const from = rotate(start, subtract(this.rest[child], this.rest[joint]));
    return product(between(from, subtract(joints[child], joints[joint])), start);
  }
}
