// Figures that the server animates: the user's own characters.

import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const MANNEQUIN = "mannequin"; // name of the material that takes the color of its take

const TALL = 1.7; // meters of a character that is scaled

/** Reads a .glb; returns what makes the figure of it: its last animation is the take, or it stands at rest. */
export async function characterMaker(content, isScaled = false) {
  const { scene, animations, parser } = await new GLTFLoader().parseAsync(content, "");
  // VRM 0 looks to -z, all others to +z.
  if (parser.json.extensions?.VRM) scene.rotation.y = Math.PI;
  return (motion, _, color, at) => new Character(motion, scene, animations.at(-1), color, at, isScaled);
}

class Character {
  constructor(motion, scene, animation, color, at, isScaled) {
    this.motion = motion;
    this.object = new THREE.Group().add(scene);
    const box = new THREE.Box3().setFromObject(scene, true);
    this.trueHeight = box.max.y - box.min.y;
    if (isScaled) this.object.scale.setScalar(TALL / this.trueHeight);
    this.height = isScaled ? TALL : this.trueHeight;
    this.object.position.set(at[0], 0, at[1]);
    this.mixer = new THREE.AnimationMixer(scene);
    this.action = animation && this.mixer.clipAction(animation).play();
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
    if (!this.action) return;
    this.action.time = Math.min(time, this.action.getClip().duration);
    this.mixer.update(0);
  }
}
