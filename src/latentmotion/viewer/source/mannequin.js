// The mannequin: one body for all figures, fitted to the bones of any human skeleton. It is the mesh
// of files and pictures, made by `python -m benchmarks.mannequin`; `render/mannequin.py` fits it alike.

import * as THREE from "three";
import asset from "../../render/mannequin.json";
import { bytes, Motion } from "./motion.js";

const NEEDED = ["hip", "knee", "ankle", "shoulder", "elbow", "wrist"];
const BREATH = { fps: 15, frames: 60, chest: 0.005, shoulder: 0.009 }; // meters
const RELAXED = { // directions of the left side's bones, of a person who just stands
  left_shoulder: [0.87, -0.48, 0], left_elbow: [0.2, -0.98, -0.02], left_wrist: [0.06, -0.97, 0.22],
  left_knee: [0.04, -1, 0.01], left_ankle: [0.02, -1, -0.02],
};

const indexOf = Object.fromEntries(asset.names.map((name, joint) => [name, joint]));
const rest = asset.rest.map((place) => new THREE.Vector3(...place));

/** The body's own skeleton. */
export const OWN = {
  names: asset.names,
  parents: asset.parents,
  directions: rest.map((place, joint) => place.clone().sub(rest[Math.max(asset.parents[joint], 0)]).toArray()),
  lengths: rest.map((place, joint) => place.distanceTo(rest[Math.max(asset.parents[joint], 0)])),
};

/** Whether a skeleton has the joints that the body needs. */
export function isHuman({ names }) {
  const sides = NEEDED.flatMap((joint) => [`left_${joint}`, `right_${joint}`]);
  return ["pelvis", "head", ...sides].every((name) => names.includes(name));
}

/** Joint positions in a T-pose, meters, by the skeleton's own lengths; directions can be others. */
export function restPose({ names, parents, directions, lengths }, directed = () => null) {
  const places = [];
  names.forEach((name, joint) => {
    const from = indexOf[names[parents[joint]]];
    const own = new THREE.Vector3(...directions[joint]);
    const way = directed(name) ?? (from !== undefined && name in indexOf ? rest[indexOf[name]].clone().sub(rest[from]) : own);
    const start = places[parents[joint]] ?? new THREE.Vector3();
    places.push(start.clone().addScaledVector(way.normalize(), parents[joint] < 0 ? 0 : lengths[joint]));
  });
  return places;
}

/** The resting body of a skeleton as a geometry: first what is grey, then what has the take's color. */
export function bodyGeometry(skeleton) {
  const { carriers, places, scale } = placed(skeleton);
  const array = (name, Type) => new Type(bytes(asset[name]));
  const [steps, anchors, shares] = [array("vertices", Int16Array), array("anchors", Uint8Array), array("places", Uint8Array)];
  const [joints, weights] = [array("joints", Uint8Array), array("shares", Uint8Array)];
  const count = shares.length;
  const positions = new Float32Array(3 * count);
  const [skinIndex, skinWeight] = [new Uint8Array(4 * count), new Float32Array(4 * count)];
  const [beside, along] = [new THREE.Vector3(), new THREE.Vector3()];
  for (let i = 0; i < count; i++) {
    const [a, b, share] = [anchors[2 * i], anchors[2 * i + 1], shares[i] / 255];
    beside.fromArray(steps, 3 * i).multiplyScalar(asset.step).sub(along.lerpVectors(rest[a], rest[b], share));
    along.lerpVectors(places[a], places[b], share).addScaledVector(beside, scale).toArray(positions, 3 * i);
    skinIndex.set([carriers[joints[2 * i]], carriers[joints[2 * i + 1]]], 4 * i);
    skinWeight.set([weights[i] / 255, 1 - weights[i] / 255], 4 * i);
  }
  const geometry = new THREE.BufferGeometry();
  const triangles = array("triangles", Uint16Array);
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute("skinIndex", new THREE.BufferAttribute(skinIndex, 4));
  geometry.setAttribute("skinWeight", new THREE.BufferAttribute(skinWeight, 4));
  geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
  geometry.computeVertexNormals();
  geometry.addGroup(0, 3 * asset.shell, 0);
  geometry.addGroup(3 * asset.shell, triangles.length - 3 * asset.shell, 1);
  geometry.userData.isShared = true;
  return geometry;
}

// Which joint carries each of the body's, and where it is; one that is missing goes with that above.
function placed(skeleton) {
  const own = restPose(skeleton);
  const scale = lengthOf((name) => own[skeleton.names.indexOf(name)]) / lengthOf((name) => rest[indexOf[name]]);
  const [carriers, places] = [[], []];
  asset.names.forEach((name, joint) => {
    const [there, parent] = [skeleton.names.indexOf(name), asset.parents[joint]];
    carriers.push(there >= 0 ? there : carriers[parent]);
    const beside = () => places[parent].clone().addScaledVector(rest[joint].clone().sub(rest[parent]), scale);
    places.push(there >= 0 ? own[there] : beside());
  });
  return { carriers, places, scale };
}

// Of a leg and the trunk, meters.
function lengthOf(place) {
  const ways = [["left_hip", "left_knee"], ["left_knee", "left_ankle"], ["pelvis", "head"]];
  return Math.max(0.1, ways.reduce((sum, [a, b]) => sum + place(a).distanceTo(place(b)), 0));
}

/** A motion of a person who stands and breathes. */
export function standing(skeleton) {
  const mirrored = ([x, y, z]) => [-x, y, z];
  const way = (name) => RELAXED[name] ?? (RELAXED[name.replace("right_", "left_")] && mirrored(RELAXED[name.replace("right_", "left_")]));
  const places = restPose(skeleton, (name) => (way(name) ? new THREE.Vector3(...way(name)) : null));
  const floor = Math.min(...places.map(({ y }) => y));
  const { fps, frames } = BREATH;
  const flat = Array.from({ length: frames }, (_, frame) => {
    const breath = (1 - Math.cos((2 * Math.PI * frame) / frames)) / 2;
    return skeleton.names.map((name, joint) => {
      const { x, y, z } = places[joint];
      const rise = /shoulder|elbow|wrist/.test(name) ? BREATH.shoulder : /spine3|neck|head|collar/.test(name) ? BREATH.chest : 0;
      return [x, y - floor + rise * breath, z];
    });
  });
  return new Motion({ caption: "a person stands", fps }, skeleton, Float32Array.from(flat.flat(2)));
}
