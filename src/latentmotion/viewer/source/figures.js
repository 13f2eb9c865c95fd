// Figures beside the mannequin: one of sticks, and one whose skin and bones the page carries.

import * as THREE from "three";
import { skinnedMesh } from "./figure.js";
import { bytes } from "./motion.js";

/** The figures that need no file, by their names in the command line. */
export const FIGURES = { mannequin: "Mannequin", stick: "Stick figure" };

const RADIUS = 0.028; // meters, of a stick; joints are larger
const SKIN = 0.01; // meters that the skin of feet reaches below their joints
const UP = new THREE.Vector3(0, 1, 0);

export class StickFigure {
  /** `at` is the [x, z] shift that sets this take beside the others, meters. */
  constructor(motion, _, color, at) {
    this.motion = motion;
    this.bones = motion.skeleton.parents.flatMap((parent, joint) => (parent < 0 ? [] : [[parent, joint]]));
    const material = new THREE.MeshStandardMaterial({ color, roughness: 0.6 });
    const stick = new THREE.CylinderGeometry(RADIUS, RADIUS, 1, 12);
    this.sticks = instances(stick, material, this.bones.length);
    this.balls = instances(new THREE.SphereGeometry(1, 16, 12), material, motion.skeleton.names.length);
    this.head = motion.skeleton.names.indexOf("head");
    this.object = new THREE.Group().add(this.sticks, this.balls);
    this.object.position.set(at[0], RADIUS, at[1]);
  }

  showTime(time) {
    const positions = this.motion.sample(time);
    const place = (joint) => new THREE.Vector3().fromArray(positions, joint * 3);
    const turn = new THREE.Quaternion();
    const matrix = new THREE.Matrix4();
    this.bones.forEach(([from, to], i) => {
      const [start, end] = [place(from), place(to)];
      const bone = end.clone().sub(start);
      turn.setFromUnitVectors(UP, bone.clone().normalize());
      matrix.compose(start.add(end).divideScalar(2), turn, new THREE.Vector3(1, bone.length(), 1));
      this.sticks.setMatrixAt(i, matrix);
    });
    for (let joint = 0; joint < this.balls.count; joint++) {
      const size = joint === this.head ? 0.095 : RADIUS * 1.35;
      matrix.makeScale(size, size, size).setPosition(place(joint));
      this.balls.setMatrixAt(joint, matrix);
    }
    this.sticks.instanceMatrix.needsUpdate = this.balls.instanceMatrix.needsUpdate = true;
  }
}

function instances(geometry, material, count) {
  const mesh = new THREE.InstancedMesh(geometry, material, count);
  mesh.castShadow = true;
  mesh.receiveShadow = true;
  mesh.frustumCulled = false;
  return mesh;
}

/** What makes a figure of sticks. */
export function stick(...of) {
  return new StickFigure(...of);
}

/** What makes the figures of takes from a skin, one for all, and each take's moves. */
export function skinned({ skin, moves }) {
  const geometry = new THREE.BufferGeometry();
  const positions = Float32Array.from(new Int16Array(bytes(skin.positions)), (step) => step * skin.step);
  const Index = positions.length / 3 > 65535 ? Uint32Array : Uint16Array;
  const Joint = skin.bones > 256 ? Uint16Array : Uint8Array;
  const set = (name, array, size, isShare) =>
    geometry.setAttribute(name, new THREE.BufferAttribute(array, size, isShare));
  set("position", positions, 3, false);
  set("normal", new Int8Array(bytes(skin.normals)), 3, true);
  set("skinIndex", new Joint(bytes(skin.joints)), 4, false);
  set("skinWeight", new Uint8Array(bytes(skin.weights)), 4, true);
  geometry.setIndex(new THREE.BufferAttribute(new Index(bytes(skin.triangles)), 1));
  return moves.map((move) => (motion, _, color, at) => new SkinnedFigure(motion, geometry, move, color, at));
}

class SkinnedFigure {
  constructor(motion, geometry, { rotations, shifts }, color, at) {
    this.motion = motion;
    this.rotations = new Int16Array(bytes(rotations));
    this.shifts = new Float32Array(bytes(shifts));
    this.bones = Array.from({ length: this.shifts.length / 3 / motion.frames }, () => new THREE.Bone());
    this.object = skinnedMesh(geometry, new THREE.MeshStandardMaterial({ color, roughness: 0.7 }), this.bones);
    this.object.position.set(at[0], SKIN, at[1]);
  }

  showTime(time) {
    const { frames, fps } = this.motion;
    const place = Math.min(Math.max(time * fps, 0), frames - 1);
    const frame = Math.min(Math.floor(place + 1e-6), Math.max(frames - 2, 0));
    const next = Math.min(frame + 1, frames - 1);
    const [size, turns, shifts] = [new THREE.Vector3(1, 1, 1), [0, 1], [0, 1]];
    this.bones.forEach((bone, joint) => {
      [frame, next].forEach((at, end) => {
        const row = at * this.bones.length + joint;
        turns[end] = new THREE.Quaternion().fromArray(this.rotations, 4 * row).normalize();
        shifts[end] = new THREE.Vector3().fromArray(this.shifts, 3 * row);
      });
      const part = Math.max(place - frame, 0);
      bone.matrixWorld.compose(shifts[0].lerp(shifts[1], part), turns[0].slerp(turns[1], part), size);
    });
  }
}
