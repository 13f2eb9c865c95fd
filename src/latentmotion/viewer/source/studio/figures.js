// Figures beside the mannequin: one of sticks, and the user's own character, animated by the server.

import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const RADIUS = 0.028; // meters, of a stick; joints are larger
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

/** Reads an animated .glb; returns what makes the figure of its motion. */
export async function characterMaker(content) {
  const { scene, animations } = await new GLTFLoader().parseAsync(content, "");
  scene.traverse((one) => {
    if (!one.isMesh) return;
    one.castShadow = true;
    one.frustumCulled = false;
  });
  return (motion, _, color, at) => new Character(motion, scene, animations, at);
}

class Character {
  constructor(motion, scene, animations, at) {
    this.motion = motion;
    this.object = new THREE.Group().add(scene);
    this.object.position.set(at[0], 0, at[1]);
    this.mixer = new THREE.AnimationMixer(scene);
    this.actions = animations.map((clip) => this.mixer.clipAction(clip).play());
  }

  showTime(time) {
    for (const action of this.actions) action.time = Math.min(time, action.getClip().duration);
    this.mixer.update(0);
  }
}
