// Motions as files: NumPy's .npz, which `Motion.load` reads, and BVH.

import { Matrix4, Vector3 } from "three";
import { Rig } from "../pose.js";

/** Gives the browser a file to keep. */
export function save(name, content, type = "application/octet-stream") {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** A file name of a prompt and its seed. */
export function fileName({ prompt, seed }, ending) {
  const words = prompt.toLowerCase().replace(/[^a-z0-9]+/g, "_").replace(/^_|_$/g, "");
  return `${words.slice(0, 60) || "motion"}_${seed}.${ending}`;
}

/** What files say of a generated motion. */
export function metadataOf({ model, seed, steps, guidance, rights, weightsLicense }) {
  return { model, seed: Number(seed), steps, guidance, rights, weights_license: weightsLicense };
}

/** Returns an .npz of generated motions of one skeleton, as `latentmotion.formats.npz` has it. */
export function npz(motions) {
  const { name, names, parents, directions } = motions[0].skeleton;
  const joined = Float32Array.from(motions.flatMap(({ joints }) => [...joints]));
  const arrays = {
    joints: array("<f4", [joined.length / names.length / 3, names.length, 3], joined),
    frames: array("<i8", [motions.length], BigInt64Array.from(motions, (m) => BigInt(m.frames))),
    fps: array("<f8", [motions.length], Float64Array.from(motions, ({ fps }) => fps)),
    caption: text(motions.map(({ prompt }) => prompt)),
    metadata: text(motions.map((motion) => JSON.stringify(metadataOf(motion)))),
    skeleton: text(name),
    names: text(names),
    parents: array("<i8", [parents.length], BigInt64Array.from(parents, BigInt)),
    offsets: array("<f8", [names.length, 3], Float64Array.from(directions.flat())),
  };
  return zip(Object.entries(arrays).map(([key, content]) => [`${key}.npy`, content]));
}

// An .npy file: magic, version 1.0, a header filled up to 64 bytes, the numbers.
function array(type, shape, numbers) {
  const sizes = shape.length === 1 ? `${shape[0]},` : shape.join(", ");
  const header = `{'descr': '${type}', 'fortran_order': False, 'shape': (${sizes}), }`;
  const length = Math.ceil((header.length + 11) / 64) * 64 - 10;
  const start = new Uint8Array(10 + length).fill(32);
  start.set([0x93, ...encoded("NUMPY"), 1, 0, length & 255, length >> 8]);
  start.set(encoded(header), 10);
  start[start.length - 1] = 10;
  return join([start, new Uint8Array(numbers.buffer, numbers.byteOffset, numbers.byteLength)]);
}

// Text as NumPy keeps it: every row as wide as the longest, four bytes a letter.
function text(rows) {
  const list = Array.isArray(rows) ? rows : [rows];
  const letters = list.map((row) => [...row].map((letter) => letter.codePointAt(0)));
  const width = Math.max(1, ...letters.map(({ length }) => length));
  const codes = new Uint32Array(list.length * width);
  letters.forEach((row, i) => codes.set(row, i * width));
  return array(`<U${width}`, Array.isArray(rows) ? [list.length] : [], codes);
}

// A .zip of stored files (PKWARE's APPNOTE.TXT 4.3): entries, their directory, its end.
function zip(files) {
  const entries = [];
  const directory = [];
  let offset = 0;
  for (const [name, content] of files) {
    const size = content.length;
    const fields = [20, 0, 0, 0, 33].flatMap(two);
    const facts = [...fields, ...[crc32(content), size, size].flatMap(four), ...two(name.length)];
    const entry = Uint8Array.from([...four(0x04034b50), ...facts, ...two(0), ...encoded(name)]);
    const more = [0, 0, 0, 0].flatMap(two);
    const place = [...four(0x02014b50), ...two(20), ...facts, ...more, ...four(0), ...four(offset)];
    directory.push(Uint8Array.from([...place, ...encoded(name)]));
    entries.push(entry, content);
    offset += entry.length + size;
  }
  const size = directory.reduce((sum, { length }) => sum + length, 0);
  const counts = [0, 0, files.length, files.length].flatMap(two);
  const end = [...four(0x06054b50), ...counts, ...four(size), ...four(offset), ...two(0)];
  return join([...entries, ...directory, Uint8Array.from(end)]);
}

const two = (value) => [value & 255, (value >> 8) & 255];
const four = (value) => [...two(value), ...two(value >>> 16)];
const encoded = (words) => new TextEncoder().encode(words);

export function join(parts) {
  const whole = new Uint8Array(parts.reduce((sum, { length }) => sum + length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}

function crc32(bytes) {
  let crc = ~0;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc >>> 0;
}

/** Returns a BVH of a motion: the rotations that the figure shows, each bone of constant length. */
export function bvh(motion) {
  const { names, parents } = motion.skeleton;
  const frames = rotated(motion);
  const offsets = names.map((_, joint) => boneOffset(joint, parents[joint], frames));
  const order = [];
  const lines = ["HIERARCHY"];
  const write = (joint, depth) => {
    const margin = "  ".repeat(depth);
    order.push(joint);
    const channels = joint === 0 ? "6 Xposition Yposition Zposition" : "3";
    lines.push(`${margin}${joint === 0 ? "ROOT" : "JOINT"} ${names[joint]}`, `${margin}{`);
    lines.push(`${margin}  OFFSET ${numbers(centimeters(offsets[joint]))}`);
    lines.push(`${margin}  CHANNELS ${channels} Zrotation Yrotation Xrotation`);
    const children = names.map((_, child) => child).filter((child) => parents[child] === joint);
    children.forEach((child) => write(child, depth + 1));
    if (!children.length) {
      lines.push(`${margin}  End Site`, `${margin}  {`, `${margin}    OFFSET 0 0 0`, `${margin}  }`);
    }
    lines.push(`${margin}}`);
  };
  write(0, 0);
  lines.push("MOTION", `Frames: ${motion.frames}`, `Frame Time: ${1 / motion.fps}`);
  for (const { joints, rotations } of frames) {
    const turns = order.map((joint) => angles(rotations[joint], rotations[parents[joint]]));
    lines.push(numbers([...centimeters(joints[0]), ...turns.flat()]));
  }
  return `${lines.join("\n")}\n`;
}

// Joints and their rotations in the world, frame by frame.
export function rotated(motion) {
  const rig = new Rig(motion.skeleton);
  return Array.from({ length: motion.frames }, (_, frame) => {
    const positions = motion.sample(frame / motion.fps);
    rig.pose(positions);
    return {
      joints: rig.rest.map((_, j) => new Vector3().fromArray(positions, j * 3)),
      rotations: rig.rotations.map((rotation) => rotation.clone()),
    };
  });
}

// A joint as its parent sees it, in the mean of all frames.
export function boneOffset(joint, parent, frames) {
  const sum = new Vector3();
  if (parent < 0) return sum;
  for (const { joints, rotations } of frames) {
    const bone = joints[joint].clone().sub(joints[parent]);
    sum.add(bone.applyQuaternion(rotations[parent].clone().invert()));
  }
  return sum.divideScalar(frames.length);
}

const centimeters = ({ x, y, z }) => [x, y, z].map((value) => value * 100);
const numbers = (values) => values.map((value) => value.toFixed(5)).join(" ");

// Degrees about z, y, x, which turn the parent's axes into the joint's: R = Rz Ry Rx.
function angles(world, parent) {
  const turn = parent ? parent.clone().invert().multiply(world) : world;
  const m = new Matrix4().makeRotationFromQuaternion(turn).elements;
  const y = Math.asin(Math.min(Math.max(-m[2], -1), 1));
  return [Math.atan2(m[1], m[0]), y, Math.atan2(m[6], m[10])].map((angle) => (angle * 180) / Math.PI);
}
