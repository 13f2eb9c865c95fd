// Joint positions → one matrix per bone, which carries the resting skin into the pose.
//
// Where three joints move as one piece (hips, chest, feet) they fix the rotation. Elsewhere a bone
// swings with its parent by the smallest turn onto its direction; the spine shares the twist
// between hips and chest.

import { Matrix4, Quaternion, Vector3 } from "three";
import { restPose } from "./mannequin.js";

// Triples of joints that fix the rotation of a bone.
const FRAMES = {
  pelvis: ["right_hip", "left_hip", "spine1"],
  spine3: ["right_collar", "left_collar", "neck"],
  left_ankle: ["left_ankle", "left_foot", "left_knee"],
  right_ankle: ["right_ankle", "right_foot", "right_knee"],
};

// Those of a skeleton: the known ones, else a joint and two children.
function rigidFrames({ names, parents }) {
  return names.map((name, j) => {
    const known = FRAMES[name]?.map((joint) => names.indexOf(joint));
    if (known?.every((joint) => joint >= 0)) return known;
    const children = names.map((_, child) => child).filter((child) => parents[child] === j);
    return children.length > 1 ? [j, children[0], children[1]] : null;
  });
}

export class Rig {
  constructor(skeleton) {
    this.skeleton = skeleton;
    this.rest = restPose(skeleton);
    this.frames = rigidFrames(skeleton);
    this.child = skeleton.names.map((_, j) => skeleton.parents.indexOf(j));
    this.sharing = skeleton.names.map((_, j) => this.#twistShare(j));
    this.rotations = skeleton.names.map(() => new Quaternion());
    this.matrices = skeleton.names.map(() => new Matrix4());
  }

  /** Sets `matrices` from joint positions (joints * 3, meters). */
  pose(positions) {
    const joints = this.rest.map((_, j) => new Vector3().fromArray(positions, j * 3));
    this.frames.forEach((frame, j) => frame && this.#setRigid(j, frame, joints));
    this.frames.forEach((frame, j) => frame || this.#swing(j, joints));
    this.matrices.forEach((matrix, j) => this.#setMatrix(matrix, j, joints));
  }

  // For a bone in a chain between two rigid pieces: [upper piece, lower piece, part of the way].
  #twistShare(joint) {
    const { parents } = this.skeleton;
    let [below, steps, above, more] = [joint, 0, joint, 0];
    for (; below >= 0 && !this.frames[below]; steps++) below = parents[below];
    for (; above >= 0 && !this.frames[above]; more++) above = this.child[above];
    const isSpine = above >= 0 && this.skeleton.names[above] === "spine3";
    return isSpine ? [below, above, steps / (steps + more)] : null;
  }

  #setRigid(joint, [a, b, c], joints) {
    const now = basis(joints[a], joints[b], joints[c]);
    const rest = basis(this.rest[a], this.rest[b], this.rest[c]);
    this.rotations[joint].setFromRotationMatrix(now.multiply(rest.transpose()));
  }

  #swing(joint, joints) {
    const rotation = this.rotations[joint];
    const share = this.sharing[joint];
    const parent = this.skeleton.parents[joint];
    if (share) rotation.slerpQuaternions(this.rotations[share[0]], this.rotations[share[1]], share[2]);
    else rotation.copy(parent < 0 ? new Quaternion() : this.rotations[parent]);
    if (this.child[joint] < 0) return;
    const [from, to] = [this.#bone(joint, this.rest), this.#bone(joint, joints)];
    const turn = new Quaternion().setFromUnitVectors(from.applyQuaternion(rotation), to);
    rotation.premultiply(turn);
  }

  #bone(joint, joints) {
    return joints[this.child[joint]].clone().sub(joints[joint]).normalize();
  }

  // Rest position r of joint j goes to its place now: x → p + R S (x - r), S stretching the bone.
  #setMatrix(matrix, joint, joints) {
    matrix.makeRotationFromQuaternion(this.rotations[joint]);
    const child = this.child[joint];
    if (child >= 0 && !this.frames[joint]) {
      const rest = this.rest[child].clone().sub(this.rest[joint]);
      const stretch = joints[child].distanceTo(joints[joint]) / (rest.length() || 1);
      matrix.multiply(stretched(rest.normalize(), stretch));
    }
    const shift = this.rest[joint].clone().negate().applyMatrix4(matrix);
    matrix.setPosition(shift.add(joints[joint]));
  }
}

function basis(a, b, c) {
  const x = b.clone().sub(a).normalize();
  const z = x.clone().cross(c.clone().sub(a)).normalize();
  return new Matrix4().makeBasis(x, z.clone().cross(x), z);
}

// I + (s - 1) d dᵀ
function stretched({ x, y, z }, s) {
  const k = s - 1;
  return new Matrix4().set(
    ...[1 + k * x * x, k * x * y, k * x * z, 0],
    ...[k * x * y, 1 + k * y * y, k * y * z, 0],
    ...[k * x * z, k * y * z, 1 + k * z * z, 0],
    ...[0, 0, 0, 1],
  );
}
