// What clips of the npm package make of figures: {joints, skeleton, fps, figure}, the path of a .glb.
// Prints the joints of that figure, and the directions of the bones of one with Mixamo's names.

import { readFileSync } from "node:fs";

const [root, given] = process.argv.slice(2);
const THREE = await import(`${root}/node_modules/three/build/three.module.js`);
const { GLTFLoader } = await import(`${root}/node_modules/three/examples/jsm/loaders/GLTFLoader.js`);
const { Motion } = await import(`${root}/src/motion.js`);
const { joints, skeleton, fps, figure } = JSON.parse(readFileSync(given, "utf8"));
const flat = Float32Array.from(joints.flat(2));
const motion = new Motion({ prompt: "a walk", joints: flat, skeleton, fps, frames: joints.length });

// Positions in the world of bones at each frame.
function played(scene, names, clip) {
  const mixer = new THREE.AnimationMixer(scene);
  mixer.clipAction(clip).play();
  return joints.map((_, frame) => {
    mixer.setTime(frame / fps);
    scene.updateMatrixWorld(true);
    return names.map((name) => scene.getObjectByName(name).getWorldPosition(new THREE.Vector3()).toArray());
  });
}

const content = readFileSync(figure);
const loaded = await new GLTFLoader().parseAsync(content.buffer.slice(content.byteOffset, content.byteOffset + content.length), "");
const ours = played(loaded.scene, skeleton.names, motion.toClip(THREE, loaded.scene));

// A figure in centimeters that looks along -z, arms held low, each bone with axes of its own.
const PARTS = [
  ["Hips", null, 0, 95, 0], ["Spine", "Hips", 0, 12, 0], ["Spine1", "Spine", 0, 12, 0], ["Spine2", "Spine1", 0, 12, 0],
  ["Neck", "Spine2", 0, 14, 0], ["Head", "Neck", 0, 9, 0],
  ...["Left", "Right"].flatMap((side) => {
    const s = side === "Left" ? 1 : -1;
    return [
      [`${side}UpLeg`, "Hips", 9 * s, -5, 0], [`${side}Leg`, `${side}UpLeg`, 0, -42, 0],
      [`${side}Foot`, `${side}Leg`, 0, -42, 0], [`${side}ToeBase`, `${side}Foot`, 0, -6, 13],
      [`${side}Shoulder`, "Spine2", 6 * s, 10, 0], [`${side}Arm`, `${side}Shoulder`, 12 * s, 0, 0],
      [`${side}ForeArm`, `${side}Arm`, 18 * s, -20, 0], [`${side}Hand`, `${side}ForeArm`, 17 * s, -18, 2],
    ];
  }),
];
const rig = new THREE.Group();
rig.scale.setScalar(0.01);
rig.rotation.y = Math.PI;
const bones = {};
PARTS.forEach(([name, parent, ...place], number) => {
  const bone = (bones[name] = new THREE.Bone());
  bone.name = `mixamorig${name}`;
  (bones[parent] ?? rig).add(bone);
  const above = parent ? bones[parent].getWorldQuaternion(new THREE.Quaternion()) : rig.quaternion.clone();
  const way = new THREE.Vector3(...place).applyQuaternion(rig.quaternion);
  bone.position.copy(way.applyQuaternion(above.clone().invert()));
  bone.rotation.set(0.3 * number, 1.1 * number, -0.7 * number);
  rig.updateMatrixWorld(true);
});
const NAMES = ["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "RightArm", "RightForeArm", "RightHand"];
const scene = new THREE.Group().add(rig);
const foreign = played(scene, NAMES.map((name) => `mixamorig${name}`), motion.toClip(THREE, rig));

const told = (() => {
  try {
    return motion.toClip(THREE, new THREE.Group());
  } catch ({ name, message }) {
    return `${name}: ${message}`;
  }
})();
const { rotations, offsets } = motion;
console.log(JSON.stringify({ ours, foreign, told, rotations: [...rotations], offsets: [...offsets] }));
