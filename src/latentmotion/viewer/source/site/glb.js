// Motions as glTF 2.0 in one .glb: the skinned mannequin, a node for each joint, an animation for each take.
// Source: Khronos glTF 2.0 specification, https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html

import { Color } from "three";
import { COLORS } from "../colors.js";
import { GREY } from "../figure.js";
import { bodyGeometry, isHuman, restPose } from "../mannequin.js";
import { boneOffset, join, rotated } from "./files.js";

const KINDS = { 1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4" };
const TYPES = new Map([[Uint8Array, 5121], [Uint16Array, 5123], [Float32Array, 5126]]);
const [VERTICES, INDICES] = [34962, 34963];

// The arrays of a file, each four bytes aligned, and what glTF says of them.
class Arrays {
  constructor() {
    Object.assign(this, { parts: [], size: 0, accessors: [], bufferViews: [] });
  }

  /** Returns the accessor of rows of `width` numbers. */
  add(array, width, { target, bounds = false } = {}) {
    const accessor = { bufferView: this.bufferViews.length, componentType: TYPES.get(array.constructor), count: array.length / width, type: KINDS[width] };
    if (bounds) {
      const columns = Array.from({ length: width }, (_, i) => array.filter((_, at) => at % width === i));
      accessor.min = columns.map((column) => column.reduce((a, b) => Math.min(a, b)));
      accessor.max = columns.map((column) => column.reduce((a, b) => Math.max(a, b)));
    }
    this.bufferViews.push({ buffer: 0, byteOffset: this.size, byteLength: array.byteLength, ...(target && { target }) });
    const content = new Uint8Array(Math.ceil(array.byteLength / 4) * 4);
    content.set(new Uint8Array(array.buffer, array.byteOffset, array.byteLength));
    this.parts.push(content);
    this.size += content.length;
    return this.accessors.push(accessor) - 1;
  }
}

/** Returns the .glb of takes of one skeleton; `metadata` is what is said of each. */
export function glb(motions, metadata) {
  const [{ skeleton }] = motions;
  const arrays = new Arrays();
  const rest = restPose(skeleton);
  const floor = Math.min(...rest.map(({ y }) => y));
  rest.forEach((place) => (place.y -= floor));
  const nodes = skeleton.names.map((name, joint) => {
    const children = skeleton.names.map((_, child) => child).filter((child) => skeleton.parents[child] === joint);
    const parent = rest[skeleton.parents[joint]];
    const translation = (parent ? rest[joint].clone().sub(parent) : rest[joint]).toArray();
    return { name, translation, ...(children.length && { children }) };
  });
  const figure = isHuman(skeleton) ? body(skeleton, rest, -floor, arrays) : {};
  if (figure.meshes) nodes.push({ name: "mannequin", mesh: 0, skin: 0 });
  const document = {
    asset: { version: "2.0", generator: "latentmotion" },
    ...{ scene: 0, scenes: [{ nodes: figure.meshes ? [0, nodes.length - 1] : [0] }], nodes, ...figure },
    animations: motions.map((motion, take) => animation(motion, take, rest, arrays, metadata[take])),
    ...{ accessors: arrays.accessors, bufferViews: arrays.bufferViews, buffers: [{ byteLength: arrays.size }] },
  };
  return packed(document, arrays);
}

function body(skeleton, rest, above, arrays) {
  const geometry = bodyGeometry(skeleton);
  const { position, normal, skinIndex, skinWeight } = geometry.attributes;
  const target = VERTICES;
  const attributes = {
    POSITION: arrays.add(position.array.map((value, i) => (i % 3 === 1 ? value + above : value)), 3, { target, bounds: true }),
    NORMAL: arrays.add(normal.array, 3, { target }),
    JOINTS_0: arrays.add(skinIndex.array, 4, { target }),
    WEIGHTS_0: arrays.add(skinWeight.array, 4, { target }),
  };
  const primitives = geometry.groups.filter(({ count }) => count).map(({ start, count }, material) => {
    const indices = arrays.add(geometry.index.array.slice(start, start + count), 1, { target: INDICES });
    return { attributes, indices, material };
  });
  const materials = [GREY, COLORS[0]].map((color) => {
    const baseColorFactor = [...new Color(color).toArray(), 1];
    return { pbrMetallicRoughness: { baseColorFactor, metallicFactor: 0, roughnessFactor: 0.6 } };
  });
  const binding = rest.flatMap(({ x, y, z }) => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -x, -y, -z, 1]);
  const inverseBindMatrices = arrays.add(Float32Array.from(binding), 16);
  const joints = rest.map((_, joint) => joint);
  return { materials, meshes: [{ name: "mannequin", primitives }], skins: [{ joints, skeleton: 0, inverseBindMatrices }] };
}

function animation(motion, take, rest, arrays, metadata) {
  const { parents } = motion.skeleton;
  const frames = rotated(motion);
  const times = arrays.add(Float32Array.from(frames, (_, frame) => frame / motion.fps), 1, { bounds: true });
  const start = arrays.add(Float32Array.of(0), 1, { bounds: true });
  const [channels, samplers] = [[], []];
  const add = (node, path, values, width, input = times) => {
    const sampler = samplers.push({ input, output: arrays.add(Float32Array.from(values.flat()), width) }) - 1;
    channels.push({ sampler, target: { node, path } });
  };
  add(0, "translation", frames.map(({ joints }) => joints[0].toArray()), 3);
  parents.forEach((parent, joint) => {
    if (parent >= 0) add(joint, "translation", [boneOffset(joint, parent, frames).toArray()], 3, start);
    let last = null;
    add(joint, "rotation", frames.map(({ rotations }) => {
      const turn = rotations[joint].clone();
      if (parent >= 0) turn.premultiply(rotations[parent].clone().invert());
      if (last && last.dot(turn) < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w); // the short way
      last = turn;
      return turn.toArray();
    }), 4);
  });
  const extras = { caption: motion.caption, fps: motion.fps, ...metadata };
  return { name: `${take + 1}: ${motion.caption}`, channels, samplers, extras };
}

// Header, then the JSON and the arrays as chunks.
function packed(document, { parts, size }) {
  const text = new TextEncoder().encode(JSON.stringify(document));
  const json = new Uint8Array(Math.ceil(text.length / 4) * 4).fill(32);
  json.set(text);
  const words = (...values) => new Uint8Array(Uint32Array.from(values).buffer);
  const [MAGIC, TEXT, BIN] = [0x46546c67, 0x4e4f534a, 0x004e4942];
  const all = 28 + json.length + size;
  return join([words(MAGIC, 2, all), words(json.length, TEXT), json, words(size, BIN), ...parts]);
}
