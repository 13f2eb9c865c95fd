// A skinned figure that does what a sentence says: three.js, GLTFLoader, AnimationMixer.

import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { load } from "latentmotion";

const scene = new THREE.Scene().add(new THREE.HemisphereLight("white", "gray", 3));
const camera = new THREE.PerspectiveCamera(40, innerWidth / innerHeight, 0.1, 100);
camera.position.set(0, 1.2, 6);
const renderer = new THREE.WebGLRenderer({ antialias: true });
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);

const { scene: figure } = await new GLTFLoader().loadAsync("figure.glb"); // Mixamo's, or one of ours
scene.add(figure);
const lm = await load("model/");
const motion = await lm.generate("a person waves", { seconds: 4, seed: 7 });
const mixer = new THREE.AnimationMixer(figure);
mixer.clipAction(motion.toClip(THREE, figure)).play();

const clock = new THREE.Timer();
renderer.setAnimationLoop((now) => {
  clock.update(now);
  mixer.update(clock.getDelta());
  renderer.render(scene, camera);
});
document.body.dataset.state = "ready";
