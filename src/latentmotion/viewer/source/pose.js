// Joint positions → one matrix per bone, which carries the resting skin into the pose.

import { Matrix4, Quaternion, Vector3 } from "three";
import { Rotations } from "../../../../packages/web/src/rotations.js";
import { restPose } from "./mannequin.js";

export class Rig {
  constructor(skeleton) {
    this.rest = restPose(skeleton);
    this.solver = new Rotations(skeleton, this.rest.map((place) => place.toArray()));
    this.rotations = skeleton.names.map(() => new Quaternion());
    this.matrices = skeleton.names.map(() => new Matrix4());
  }

  /** Sets `rotations` and `matrices` from joint positions (joints * 3, meters). */
  pose(positions) {
    const joints = this.rest.map((_, j) => new Vector3().fromArray(positions, j * 3));
    this.solver.at(positions).forEach((rotation, j) => this.rotations[j].fromArray(rotation));
    this.matrices.forEach((matrix, j) => this.#setMatrix(matrix, j, joints));
  }

  // Rest position r of joint j goes to its place now: x → p + R S (x - r), S stretching the bone.
  #setMatrix(matrix, joint, joints) {
    matrix.makeRotationFromQuaternion(this.rotations[joint]);
    const child = this.solver.child[joint];
    if (child >= 0 && !this.solver.frames[joint]) {
      const rest = this.rest[child].clone().sub(this.rest[joint]);
      const stretch = joints[child].distanceTo(joints[joint]) / (rest.length() || 1);
      matrix.multiply(stretched(rest.normalize(), stretch));
    }
    const shift = this.rest[joint].clone().negate().applyMatrix4(matrix);
    matrix.setPosition(shift.add(joints[joint]));
  }
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
