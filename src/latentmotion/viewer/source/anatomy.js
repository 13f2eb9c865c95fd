// A body around a skeleton: rest directions, and rounded shapes that belong to each bone.
//
// Meters for a grown person; +x is the body's left, y is up, +z is ahead. Right sides mirror left.

const REST = bothSides({
  left_hip: [0.62, -0.77, -0.08],
  spine1: [0, 0.97, -0.16],
  left_knee: [0.16, -0.99, 0.02],
  spine2: [0, 0.99, 0.1],
  left_ankle: [0.06, -0.99, -0.07],
  spine3: [0, 1, 0.03],
  left_foot: [0.16, -0.34, 0.93],
  neck: [0, 0.985, -0.15],
  left_collar: [0.55, 0.83, -0.08],
  head: [0, 0.93, 0.36],
  left_shoulder: [0.95, 0.3, -0.1],
  left_elbow: [0.66, -0.75, -0.05],
  left_wrist: [0.62, -0.76, 0.18],
});

// Three joints that move as one piece; together they fix a bone's rotation, twist included.
const FRAMES = {
  pelvis: ["right_hip", "left_hip", "spine1"],
  spine3: ["right_collar", "left_collar", "neck"],
  left_ankle: ["left_ankle", "left_foot", "left_knee"],
  right_ankle: ["right_ankle", "right_foot", "right_knee"],
};

// [bone, from, to, radius, radius]: a cone with round ends. A place is a joint; a joint and a shift;
// or two joints and the part of the way between them.
const CONES = [
  ["neck", ["neck", 0, -0.03, 0], ["head", 0, 0.03, -0.012], 0.054, 0.05],
  ["spine3", ["neck", 0, -0.02, -0.02], ["left_shoulder", -0.03, 0.015, 0], 0.05, 0.044],
  ["left_collar", ["left_collar", 0.01, 0, 0], ["left_shoulder"], 0.058, 0.058],
  ["left_shoulder", ["left_shoulder"], ["left_shoulder", "left_elbow", 0.4], 0.056, 0.046],
  ["left_shoulder", ["left_shoulder", "left_elbow", 0.35], ["left_elbow"], 0.047, 0.035],
  ["left_elbow", ["left_elbow"], ["left_elbow", "left_wrist", 0.28], 0.035, 0.0385],
  ["left_elbow", ["left_elbow", "left_wrist", 0.28], ["left_wrist"], 0.0385, 0.0235],
  ["left_hip", ["left_hip", 0.022, -0.03, 0], ["left_hip", "left_knee", 0.45], 0.083, 0.069],
  ["left_hip", ["left_hip", "left_knee", 0.45], ["left_knee"], 0.067, 0.047],
  ["left_knee", ["left_knee", 0, 0, 0.003], ["left_knee", "left_ankle", 0.2], 0.048, 0.044],
  ["left_knee", ["left_knee", 0, -0.07, -0.014], ["left_knee", 0, -0.17, -0.016], 0.04, 0.045],
  ["left_knee", ["left_knee", 0, -0.17, -0.014], ["left_ankle", 0, 0.03, 0], 0.045, 0.031],
  ["left_ankle", ["left_ankle", 0, 0.01, -0.004], ["left_ankle", 0, -0.035, -0.03], 0.033, 0.034],
  ["left_ankle", ["left_ankle"], ["left_foot", -0.002, 0.01, 0], 0.037, 0.03],
  ["left_ankle", ["left_ankle", 0, -0.04, -0.02], ["left_foot", 0.006, -0.004, 0], 0.03, 0.036],
  ["left_foot", ["left_foot", -0.012, -0.004, 0], ["left_foot", 0, -0.01, 0.062], 0.033, 0.02],
  ["left_foot", ["left_foot", 0.02, -0.006, -0.01], ["left_foot", 0.028, -0.01, 0.04], 0.03, 0.018],
];

// [bone, joint, shift, half axes]: an upright ellipsoid.
const ELLIPSOIDS = [
  ["pelvis", "pelvis", [0, -0.045, 0], [0.15, 0.095, 0.105]],
  ["pelvis", "left_hip", [0.02, -0.02, -0.05], [0.082, 0.085, 0.078]],
  ["spine1", "spine1", [0, 0, 0.016], [0.126, 0.12, 0.094]],
  ["spine2", "spine2", [0, 0.04, 0.01], [0.132, 0.12, 0.1]],
  ["spine3", "spine3", [0, 0.07, 0], [0.15, 0.15, 0.108]],
  ["spine3", "left_collar", [0.02, -0.045, 0.05], [0.085, 0.075, 0.052]],
  ["spine3", "left_shoulder", [-0.07, -0.07, -0.03], [0.07, 0.11, 0.06]],
  ["head", "head", [0, 0.115, 0.005], [0.075, 0.098, 0.094]],
  ["head", "head", [0, 0.055, 0.04], [0.052, 0.062, 0.058]],
  ["head", "head", [0, 0.075, 0.098], [0.013, 0.022, 0.017]],
  ["head", "left_ear", [0, 0, 0], [0.01, 0.027, 0.018]],
];

// Hands continue the forearm: [from, to, radius, radius], a place being how far past the wrist and
// how far to the thumb's side.
const HAND = [
  [[-0.01, 0], [0.05, 0.006], 0.024, 0.026],
  [[0.03, -0.014], [0.088, -0.018], 0.018, 0.018],
  [[0.03, 0.014], [0.092, 0.016], 0.019, 0.0175],
  [[0.085, -0.02], [0.145, -0.02], 0.0155, 0.0105],
  [[0.085, 0], [0.165, 0], 0.0155, 0.011],
  [[0.085, 0.018], [0.155, 0.018], 0.0155, 0.0105],
  [[0.02, 0.016], [0.06, 0.046], 0.018, 0.014],
  [[0.06, 0.046], [0.098, 0.052], 0.014, 0.0105],
];

const GROWN_UP = 0.212; // mean bone length, meters, of the person these sizes were drawn for
const SOLE = 0.03; // the sole is this far under the joint of the toes, meters

/** The resting body: joint positions, meters, and how large it is beside the drawn person. */
export function restPose(skeleton) {
  const positions = {};
  skeleton.names.forEach((name, j) => {
    const start = positions[skeleton.names[skeleton.parents[j]]] ?? [0, 0, 0];
    const direction = unit(REST[name] ?? skeleton.directions[j]);
    positions[name] = along(start, direction, skeleton.lengths[j]);
  });
  const lengths = skeleton.lengths.slice(1);
  const scale = lengths.reduce((sum, length) => sum + length, 0) / lengths.length / GROWN_UP;
  return { positions, scale };
}

/** Triples of joints that fix a bone's rotation: the known ones, else a joint and two children. */
export function rigidFrames({ names, parents }) {
  return names.map((name, j) => {
    if (FRAMES[name]) return FRAMES[name].map((joint) => names.indexOf(joint));
    const children = names.map((_, child) => child).filter((child) => parents[child] === j);
    return children.length > 1 ? [j, children[0], children[1]] : null;
  });
}

/** The shapes of a body, each with the name of its bone and `distance(x, y, z)` to its surface. */
export function shapes(skeleton, { positions, scale }) {
  if (!skeleton.names.includes("left_ankle")) return plainShapes(skeleton, positions);
  const places = { ...positions, left_ear: along(positions.head, [0.074, 0.085, 0], scale) };
  const left = [...CONES, ...ELLIPSOIDS].map((row) => shape(row, places, scale));
  const all = [...left, ...hand(positions, scale)];
  const isPaired = ({ bone, a, b = a }) => bone.startsWith("left_") || a[0] + b[0] > 1e-6;
  return [...all, ...all.filter(isPaired).map((one) => one.mirror())];
}

/** What each point of the skin is: bare skin, or shoe, where positive; the suit elsewhere. */
export function paint({ positions, scale }) {
  if (!positions.left_ankle) return () => [-1, -1];
  const { neck, left_elbow: elbow, left_wrist: wrist, left_ankle: ankle } = positions;
  const forearm = unit(wrist.map((value, i) => value - elbow[i]));
  return (x, y, z) => {
    const fromWrist = [Math.abs(x) - wrist[0], y - wrist[1], z - wrist[2]];
    const past = fromWrist.reduce((sum, value, i) => sum + value * forearm[i], 0);
    const bareHand = Math.min(past - 0.01 * scale, 0.25 * scale - Math.hypot(...fromWrist));
    const bareNeck = y - neck[1] - (0.03 - 0.25 * (z - neck[2])) * scale;
    return [Math.max(bareHand, bareNeck), ankle[1] + 0.035 * scale - y];
  };
}

/** Height of the sole in the resting body. */
export function sole({ positions, scale }) {
  return positions.left_foot ? positions.left_foot[1] - SOLE * scale : -Infinity;
}

class Cone {
  constructor(bone, a, b, radiusA, radiusB) {
    Object.assign(this, { bone, a, b, radiusA, radiusB });
    this.axis = b.map((value, i) => value - a[i]);
    this.length2 = this.axis.reduce((sum, value) => sum + value * value, 1e-12);
  }

  distance(x, y, z) {
    const [px, py, pz] = [x - this.a[0], y - this.a[1], z - this.a[2]];
    const [ax, ay, az] = this.axis;
    const part = Math.min(Math.max((px * ax + py * ay + pz * az) / this.length2, 0), 1);
    const away = Math.hypot(px - part * ax, py - part * ay, pz - part * az);
    return away - this.radiusA - part * (this.radiusB - this.radiusA);
  }

  mirror() {
    return new Cone(right(this.bone), flip(this.a), flip(this.b), this.radiusA, this.radiusB);
  }
}

class Ellipsoid {
  constructor(bone, a, axes) {
    Object.assign(this, { bone, a, axes });
  }

  distance(x, y, z) {
    const [px, py, pz] = [x - this.a[0], y - this.a[1], z - this.a[2]];
    const [rx, ry, rz] = this.axes;
    const inside = Math.hypot(px / rx, py / ry, pz / rz);
    const slope = Math.hypot(px / rx ** 2, py / ry ** 2, pz / rz ** 2);
    return slope < 1e-9 ? -Math.min(rx, ry, rz) : (inside * (inside - 1)) / slope;
  }

  mirror() {
    return new Ellipsoid(right(this.bone), flip(this.a), this.axes);
  }
}

function shape([bone, from, to, c, d], places, scale) {
  if (typeof from === "string") {
    return new Ellipsoid(bone, along(places[from], to, scale), c.map((axis) => axis * scale));
  }
  return new Cone(bone, place(from, places, scale), place(to, places, scale), c * scale, d * scale);
}

function place([joint, ...rest], places, scale) {
  if (rest.length === 0) return places[joint];
  if (rest.length === 3) return along(places[joint], rest, scale);
  const [start, end] = [places[joint], places[rest[0]]];
  return start.map((value, i) => value + (end[i] - value) * rest[1]);
}

function hand({ left_elbow: elbow, left_wrist: wrist }, scale) {
  const forearm = unit(wrist.map((value, i) => value - elbow[i]));
  const thumb = unit([-forearm[2] * forearm[0], -forearm[2] * forearm[1], 1 - forearm[2] ** 2]);
  const at = ([past, aside]) => along(along(wrist, forearm, past * scale), thumb, aside * scale);
  return HAND.map(
    ([from, to, a, b]) => new Cone("left_wrist", at(from), at(to), a * scale, b * scale),
  );
}

// A skeleton whose names we do not know still gets a round limb along each bone.
function plainShapes({ names, parents, lengths }, positions) {
  return names.slice(1).map((name, i) => {
    const parent = names[parents[i + 1]];
    const radius = Math.min(Math.max(lengths[i + 1] * 0.25, 0.025), 0.07);
    return new Cone(parent, positions[parent], positions[name], radius, radius * 0.8);
  });
}

function bothSides(table) {
  const pairs = Object.entries(table).map(([name, [x, y, z]]) => [right(name), [-x, y, z]]);
  return { ...Object.fromEntries(pairs), ...table };
}

function right(name) {
  return name.replace("left_", "right_");
}

function flip([x, y, z]) {
  return [-x, y, z];
}

function along(start, direction, distance) {
  return start.map((value, i) => value + direction[i] * distance);
}

function unit(vector) {
  const length = Math.hypot(...vector) || 1;
  return vector.map((value) => value / length);
}
