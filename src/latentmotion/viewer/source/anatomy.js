// A body around any skeleton: its resting pose, its shapes, and what its skin is painted with.

import { CONES, CORE, EAR, ELLIPSOIDS, FRAMES, GROWN_UP, HAND, REST, SOLE } from "./proportions.js";
import { TRUNK } from "./proportions.js";
import { along, Cone, Ellipsoid, Trunk, unit } from "./shapes.js";

/** The resting body: joint positions, meters, and how large it is beside the drawn person. */
export function restPose(skeleton) {
  const positions = {};
  skeleton.names.forEach((name, j) => {
    const start = positions[skeleton.names[skeleton.parents[j]]] ?? [0, 0, 0];
    const direction = unit(restDirection(name) ?? skeleton.directions[j]);
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

/**
 * A body: `groups` of shapes whose `distance(x, y, z)` is that to their surface, and `carriers`,
 * the shapes that say, by their nearness, which `bone` carries a place of the skin.
 */
export function body(skeleton, { positions, scale }) {
  if (!isDrawn(positions)) return plainBody(skeleton, positions, scale);
  const places = { ...positions, left_ear: along(positions.head, EAR, scale) };
  const left = [...CONES, ...ELLIPSOIDS].map((row) => shape(row, places, scale));
  const visible = bothSides([...left, ...hand(positions, scale)]);
  const core = CORE.map((row) => shape(row, places, scale));
  const trunk = new Trunk(TRUNK.map((row) => trunkRow(row, positions, scale)));
  return { groups: [[trunk], ...grouped(visible)], carriers: [...visible, ...core] };
}

/** What each point of the skin is: bare skin, shoe or hair, where positive; the suit elsewhere. */
export function paint({ positions, scale }) {
  if (!isDrawn(positions)) return () => [-1, -1, -1];
  const { head, neck, left_elbow: elbow, left_wrist: wrist, left_ankle: ankle } = positions;
  const forearm = unit(wrist.map((value, i) => value - elbow[i]));
  return (x, y, z) => {
    const fromWrist = [Math.abs(x) - wrist[0], y - wrist[1], z - wrist[2]];
    const past = fromWrist.reduce((sum, value, i) => sum + value * forearm[i], 0);
    const bareHand = Math.min(past - 0.01 * scale, 0.25 * scale - Math.hypot(...fromWrist));
    const bareNeck = y - neck[1] - (0.03 - 0.25 * (z - neck[2])) * scale;
    const behind = 0.55 * (head[2] + 0.035 * scale - z);
    const hair = Math.min(y - head[1] - 0.1 * scale + behind, y - head[1] - 0.02 * scale);
    return [Math.max(bareHand, bareNeck), ankle[1] + 0.035 * scale - y, hair];
  };
}

/** Height of the sole in the resting body. */
export function sole({ positions, scale }) {
  return isDrawn(positions) ? positions.left_foot[1] - SOLE * scale : -Infinity;
}

// Whether the skeleton has the joints around which the person was drawn.
function isDrawn(positions) {
  return Object.keys(REST).every((joint) => positions[joint]);
}

function restDirection(name) {
  const [x, y, z] = REST[name.replace("right_", "left_")] ?? [];
  if (x === undefined) return undefined;
  return [name.startsWith("right_") ? -x : x, y, z];
}

function bothSides(shapes) {
  const isPaired = ({ bone, a, b }) => bone.startsWith("left_") || a[0] + b[0] > 1e-6;
  return [...shapes, ...shapes.filter(isPaired).map((one) => one.mirror())];
}

// Shapes of one limb meet without a bulge; all others are groups of their own, and flow together.
function grouped(shapes) {
  const groups = new Map();
  for (const one of shapes) {
    const limb = one.bone.replace(/shoulder|elbow/, "arm").replace(/hip|knee/, "leg");
    const isLimb = limb !== one.bone && one instanceof Cone;
    const key = isLimb ? limb : one;
    groups.set(key, [...(groups.get(key) ?? []), one]);
  }
  return [...groups.values()];
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

function trunkRow([joint, above, ...sizes], positions, scale) {
  const [, y, z] = positions[joint];
  return [y + above * scale, z, ...sizes.map((size) => size * scale)];
}

function hand({ left_elbow: elbow, left_wrist: wrist }, scale) {
  const forearm = unit(wrist.map((value, i) => value - elbow[i]));
  const thumb = unit([-forearm[2] * forearm[0], -forearm[2] * forearm[1], 1 - forearm[2] ** 2]);
  const at = ([past, aside]) => along(along(wrist, forearm, past * scale), thumb, aside * scale);
  return HAND.map(
    ([from, to, a, b]) => new Cone("left_wrist", at(from), at(to), a * scale, b * scale),
  );
}

// Any other skeleton gets a round limb along each bone, and a ball for its head.
function plainBody({ names, parents, lengths }, positions, scale) {
  const limbs = names.slice(1).map((name, i) => {
    const parent = names[parents[i + 1]];
    const radius = Math.min(Math.max(lengths[i + 1] * 0.25, 0.025), 0.07);
    return new Cone(parent, positions[parent], positions[name], radius, radius * 0.8);
  });
  const ball = [0.09, 0.12, 0.1].map((axis) => axis * scale);
  const head = positions.head ? [new Ellipsoid("head", positions.head, ball)] : [];
  const all = [...limbs, ...head];
  return { groups: all.map((one) => [one]), carriers: all };
}
