// One take's figure: the mannequin, carried by its bones.

import * as THREE from "three";
import { Rig } from "./pose.js";

export const GREY = "#c4c9d2";

export class Figure {
  /** `at` is the [x, z] shift that sets this take beside the others, meters. */
  constructor(motion, geometry, color, at) {
    this.motion = motion;
    this.rig = new Rig(motion.skeleton);
    this.bones = this.rig.matrices.map(() => new THREE.Bone());
    this.positions = new Float32Array(motion.size);
    const materials = [GREY, color].map((one) => new THREE.MeshStandardMaterial({ color: one, roughness: 0.58 }));
    this.object = skinnedMesh(geometry, materials, this.bones);
    this.object.position.set(at[0], 0, at[1]);
  }

  showTime(time) {
    this.rig.pose(this.motion.sample(time, this.positions));
    this.bones.forEach((bone, j) => bone.matrixWorld.copy(this.rig.matrices[j]));
  }
}

/** A figure that what stands behind it can be seen through. */
export function ghost(motion, skinOf, color, at) {
  const figure = new Figure(motion, skinOf(), color, at);
  const [transparent, opacity, depthWrite] = [true, 0.3, false];
  figure.object.material.forEach((material) => material.dispose());
  figure.object.material = new THREE.MeshLambertMaterial({ color, transparent, opacity, depthWrite });
  figure.object.castShadow = false;
  figure.object.receiveShadow = false;
  return figure;
}

/**
 * A mesh whose bones hold matrices of the motion's own space, and whose position shifts the result:
 * three.js calls that detached.
 */
export function skinnedMesh(geometry, material, bones) {
  const mesh = new THREE.SkinnedMesh(geometry, material);
  const identities = bones.map(() => new THREE.Matrix4());
  mesh.bindMode = THREE.DetachedBindMode;
  mesh.bind(new THREE.Skeleton(bones, identities), new THREE.Matrix4());
  mesh.frustumCulled = false;
  mesh.castShadow = true;
  mesh.receiveShadow = true;
  return mesh;
}
