// Figures that the server animates: the user's own characters.

import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const MANNEQUIN = "mannequin"; // name of the material that takes the color of its take

/** Reads a .glb whose last animation is the take; returns what makes the figure of it. */
export async function characterMaker(content) {
  const { scene, animations } = await new GLTFLoader().parseAsync(content, "");
  return (motion, _, color, at) => new Character(motion, scene, animations.at(-1), color, at);
}

class Character {
  constructor(motion, scene, animation, color, at) {
    this.motion = motion;
    this.object = new THREE.Group().add(scene);
    this.object.position.set(at[0], 0, at[1]);
    this.mixer = new THREE.AnimationMixer(scene);
    this.action = this.mixer.clipAction(animation).play();
    scene.traverse((one) => {
      if (!one.isMesh) return;
      one.castShadow = true;
      one.frustumCulled = false;
      if (one.material.name !== MANNEQUIN) return;
      one.material = one.material.clone();
      one.material.color.set(color);
      one.receiveShadow = true;
    });
  }

  showTime(time) {
    this.action.time = Math.min(time, this.action.getClip().duration);
    this.mixer.update(0);
  }
}
