// Marks of a motion: goals with names, the path with times, ghosts at keyframes, boxes that carry it.

import * as THREE from "three";
import { ghost } from "./figure.js";

const NEAR = 0.25; // seconds around its time in which a goal is lit
const LETTERS = 20; // pixels that a label is high
const LIFT = 0.006; // meters of the path above the floor

export class Marks {
  /** `skinOf` returns the skin of ghosts; the last is the [x, z] shift of the take. */
  constructor(motion, skinOf, color, [dx, dz]) {
    const { goals = [], path = [], poses = [], boxes = [] } = motion.marks;
    this.goals = goals.map((goal) => new Goal(goal, color));
    this.stops = path.map((stop) => new Stop(stop, color));
    this.object = new THREE.Group();
    for (const mark of [...this.goals, ...this.stops]) this.object.add(mark.object);
    if (path.length > 1) this.object.add(curve(path, color));
    for (const time of poses) {
      const figure = ghost(motion, skinOf, color, [0, 0]);
      figure.showTime(time);
      this.object.add(figure.object);
    }
    for (const box of boxes) this.object.add(carrier(box));
    this.object.position.set(dx, 0, dz);
  }

  showTime(time) {
    for (const mark of [...this.goals, ...this.stops]) mark.showTime(time);
  }
}

class Goal {
  constructor({ joint, at, to }, color) {
    this.at = at;
    this.ball = new THREE.Mesh(
      new THREE.SphereGeometry(0.035, 24, 16),
      new THREE.MeshStandardMaterial({ color, emissive: color, transparent: true, opacity: 0.85 }),
    );
    this.object = new THREE.Group().add(this.ball, label(`${joint.replaceAll("_", " ")} · ${at} s`, 0.09));
    this.object.position.set(...to);
  }

  showTime(time) {
    const near = Math.max(0, 1 - Math.abs(time - this.at) / NEAR);
    this.ball.scale.setScalar(1 + 0.6 * near);
    this.ball.material.emissiveIntensity = 0.15 + 0.85 * near;
  }
}

class Stop {
  constructor({ at, to: [x, z] }, color) {
    this.at = at;
    this.disc = new THREE.Mesh(
      new THREE.CircleGeometry(0.06, 32),
      new THREE.MeshBasicMaterial({ color, transparent: true, depthWrite: false }),
    );
    this.disc.rotation.x = -Math.PI / 2;
    this.object = new THREE.Group().add(this.disc, label(`${at} s`, 0.1));
    this.object.position.set(x, LIFT, z);
  }

  showTime(time) {
    const near = Math.max(0, 1 - Math.abs(time - this.at) / NEAR);
    this.disc.scale.setScalar(1 + near);
    this.disc.material.opacity = 0.6 + 0.4 * near;
  }
}

// A plain box with the top on which somebody sits or stands.
function carrier({ name, height, place: [x, z], size: [width, depth], degrees }) {
  const material = new THREE.MeshStandardMaterial({ color: 0x8a93a0, transparent: true, opacity: 0.45 });
  const box = new THREE.Mesh(new THREE.BoxGeometry(width, height, depth), material);
  box.position.set(x, height / 2, z);
  box.rotation.y = (degrees * Math.PI) / 180;
  box.name = name;
  return box;
}

function curve(path, color) {
  const points = path.map(({ to: [x, z] }) => new THREE.Vector3(x, LIFT, z));
  const line = new THREE.CatmullRomCurve3(points, false, "centripetal");
  const material = new THREE.MeshBasicMaterial({ color, transparent: true, opacity: 0.5 });
  return new THREE.Mesh(new THREE.TubeGeometry(line, 24 * path.length, 0.012, 8), material);
}

// Words that face the camera, `up` meters above what they name.
function label(text, up) {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = "600 44px system-ui, sans-serif";
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 40;
  canvas.height = 72;
  Object.assign(context, { font, fillStyle: "#1d2433d0", textBaseline: "middle" });
  context.beginPath();
  context.roundRect(0, 0, canvas.width, canvas.height, 24);
  context.fill();
  context.fillStyle = "#ffffff";
  context.fillText(text, 20, canvas.height / 2 + 2);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const material = new THREE.SpriteMaterial({ map, depthTest: false, toneMapped: false });
  const sprite = new THREE.Sprite(material);
  sprite.position.y = up;
  // As high on the screen, wherever the camera is.
  const size = new THREE.Vector2();
  sprite.onBeforeRender = (renderer, scene, camera) => {
    const { y: height } = renderer.getSize(size);
    const away = camera.position.distanceTo(sprite.getWorldPosition(new THREE.Vector3()));
    const meters = (2 * away * Math.tan((camera.fov * Math.PI) / 360) * LETTERS) / height;
    sprite.scale.set((meters * canvas.width) / canvas.height, meters, 1);
    sprite.updateMatrixWorld();
    sprite.modelViewMatrix.multiplyMatrices(camera.matrixWorldInverse, sprite.matrixWorld);
  };
  sprite.renderOrder = 2;
  return sprite;
}
