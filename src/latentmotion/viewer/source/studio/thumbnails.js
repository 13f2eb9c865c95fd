// Pictures of takes: the mannequin in five moments of each, drawn in the browser; hovered, it moves.

import * as THREE from "three";
import { COLORS } from "../colors.js";
import { Figure } from "../figure.js";
import { bodyGeometry, isHuman } from "../mannequin.js";
import { stick } from "../figures.js";

const [WIDTH, HEIGHT] = [440, 240]; // pixels
const FIGURES = 4;
const APART = 1.02; // meters
const TALL = 2.15; // meters that the picture is high
const TURNED = 0.6; // radians from the front, so that arms and legs are seen apart

let drawing = null; // renderer, camera and scene, shared by all pictures; false where WebGL is off
const geometries = new WeakMap();

/** Draws a motion's moments, or, where `time` is given, that one; returns a canvas's content. */
export function draw(motion, time = null) {
  drawing ??= open();
  if (!drawing) return sketched(motion, time);
  const { renderer, camera, scene, stand } = drawing;
  const { skeleton, seconds } = motion;
  if (!geometries.has(skeleton) && isHuman(skeleton)) geometries.set(skeleton, bodyGeometry(skeleton));
  const figures = Array.from({ length: time === null ? FIGURES : 1 }, (_, number) => {
    const figure = isHuman(skeleton)
      ? new Figure(motion, geometries.get(skeleton), COLORS[0], [0, 0])
      : stick(motion, null, COLORS[0], [0, 0]);
    const at = time ?? (number / (FIGURES - 1)) * seconds;
    figure.showTime(at);
    const [x, , z] = motion.sample(at);
    figure.object.castShadow = figure.object.receiveShadow = false;
    figure.object.position.set(-x, 0, -z);
    const holder = new THREE.Group().add(figure.object);
    holder.rotation.y = TURNED - facing(motion);
    holder.position.x = (number - (time === null ? (FIGURES - 1) / 2 : 0)) * APART;
    return holder;
  });
  stand.add(...figures);
  renderer.render(scene, camera);
  stand.clear();
  for (const holder of figures) {
    holder.traverse(({ material, skeleton: bones }) => {
      for (const one of [material ?? []].flat()) one.dispose();
      bones?.dispose();
    });
  }
  return renderer.domElement;
}

// The same moments as lines, where WebGL is off.
function sketched(motion, time) {
  const canvas = Object.assign(document.createElement("canvas"), { width: WIDTH, height: HEIGHT });
  const pen = canvas.getContext("2d");
  const [scale, angle] = [HEIGHT / TALL, TURNED - facing(motion)];
  Object.assign(pen, { strokeStyle: COLORS[0], lineWidth: 6, lineCap: "round" });
  const count = time === null ? FIGURES : 1;
  for (let number = 0; number < count; number++) {
    const joints = motion.sample(time ?? (number / (FIGURES - 1)) * motion.seconds);
    const middle = WIDTH / 2 + (number - (count - 1) / 2) * APART * scale;
    const at = (joint) => {
      const [x, z] = [joints[3 * joint] - joints[0], joints[3 * joint + 2] - joints[2]];
      return [middle + scale * (x * Math.cos(angle) + z * Math.sin(angle)), HEIGHT - scale * (joints[3 * joint + 1] + 0.12)];
    };
    pen.beginPath();
    motion.skeleton.parents.forEach((parent, joint) => {
      if (parent < 0) return;
      pen.moveTo(...at(parent));
      pen.lineTo(...at(joint));
    });
    pen.stroke();
  }
  return canvas;
}

// The direction that the hips look in at the start, from +z towards +x.
function facing(motion) {
  const [left, right] = ["left_hip", "right_hip"].map((name) => motion.skeleton.names.indexOf(name));
  const joints = motion.sample(0);
  const [x, z] = [0, 2].map((axis) => joints[3 * left + axis] - joints[3 * right + axis]);
  return Math.atan2(-z, x);
}

function open() {
  const canvas = document.createElement("canvas");
  if (!canvas.getContext("webgl2", { antialias: true })) return false;
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.setSize(WIDTH, HEIGHT, false);
  renderer.toneMapping = THREE.NeutralToneMapping;
  const wide = (TALL * WIDTH) / HEIGHT;
  const camera = new THREE.OrthographicCamera(-wide / 2, wide / 2, TALL - 0.12, -0.12, -5, 5);
  camera.rotation.x = -0.08;
  const key = new THREE.DirectionalLight("#fff4e6", 2.5);
  key.position.set(2.6, 6, 4);
  const stand = new THREE.Group();
  const scene = new THREE.Scene().add(new THREE.HemisphereLight("#e8f0ff", "#b7a79a", 1.9), key, stand);
  return { renderer, camera, scene, stand };
}
