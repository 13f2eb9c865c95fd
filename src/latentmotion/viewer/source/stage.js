// The three.js stage: light, floor, camera, and one figure per take.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Figure } from "./figure.js";
import { stick } from "./figures.js";
import { Floor } from "./floor.js";
import { bodyGeometry, isHuman } from "./mannequin.js";
import { Marks } from "./marks.js";
import { alongPath, lineUp, smoothPath } from "./motion.js";
import { Sketch } from "./sketch.js";

const EYE = new THREE.Vector3(0.34, 0.2, 1).normalize(); // from where the camera first looks
const HEIGHT = 0.96; // of what it looks at, meters
const SHADOW_PIXELS = 640; // along each side of the map
const FIELD_OF_VIEW = 17; // degrees, vertical; little, so that takes are of one size
const FARTHEST = 40; // meters that a hand can go away from few takes
const BESIDE = 0.6; // meters that a body reaches out to either side

// Names that browsers give a renderer without a graphics card.
const SOFTWARE = /SwiftShader|llvmpipe|softpipe|Basic Render/i;

const SEEN = 3; // pictures, after which the first is on the screen

const geometries = new WeakMap(); // the resting skin of each skeleton, for all stages of a page

/** Opens a stage on a canvas: three.js, or lines where WebGL is off. The other arguments are those of `show`. */
export function openStage(canvas, ...shown) {
  // Drawing in software, a browser takes most of a second for its first context: none is opened only to see if it can be.
  const hasWebGL = canvas.getContext("webgl2", { antialias: true });
  return new (hasWebGL ? Stage : Sketch)(canvas, ...shown);
}

class Stage {
  /** `options` are those of `show`. */
  constructor(canvas, motions, colors, options) {
    this.name = "webgl";
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.isSoftware = SOFTWARE.test(nameOf(this.renderer.getContext()));
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.VSMShadowMap;
    this.renderer.toneMapping = THREE.NeutralToneMapping;
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.05, 3 * FARTHEST);
    this.controls = orbit(this.camera, canvas, () => (this.stale = true));
    this.controls.addEventListener("start", () => (this.touched = true));
    this.scene = new THREE.Scene().add(skylight(), rimlight());
    this.shown = []; // objects of the motions that are shown
    this.past = []; // objects that were shown before the last picture
    this.eye = EYE;
    this.watched = null;
    this.follow = true;
    this.detail = 1;
    // Shadows are half of what a software renderer's first picture takes: they come after it.
    this.beforeShadows = this.isSoftware ? SEEN : 0;
    this.freeHeight = 0;
    this.center = new THREE.Vector3(0, HEIGHT, 0);
    this.show(motions, colors, options);
  }

  /**
   * Shows other motions, from their beginning; the view stays until `reset`. `makers` make figures
   * other than the mannequin from a motion, what returns its skin, a color and a place; `offsets`
   * set them elsewhere than side by side.
   */
  show(motions, colors, { makers = [], offsets = lineUp(motions) } = {}) {
    this.past.push(...this.shown);
    this.offsets = offsets;
    const made = (make) => (motion, i) => make(motion, () => geometryOf(motion), colors[i], offsets[i]);
    this.figures = motions.map((motion, i) => made(makers[i] ?? mannequin)(motion, i));
    this.paths = motions.map(smoothPath);
    this.floor = new Floor(motions, offsets, colors);
    this.marks = motions.map(made((...of) => new Marks(...of)));
    this.all = motions.map((_, take) => take);
    this.watched = null;
    this.seconds = Math.max(...motions.map(({ seconds }) => seconds));
    this.sun = sunlight(this.#spread(this.all, true).length() / 2 + 1.9);
    this.sun.shadow.mapSize.setScalar(SHADOW_PIXELS * this.detail);
    this.sun.castShadow = this.beforeShadows === 0;
    this.shown = [this.floor, ...this.figures, ...this.marks].map((drawn) => drawn.object);
    this.shown.push(this.sun, this.sun.target);
    this.scene.remove(...this.past).add(...this.shown);
    this.setDark(this.dark);
    this.showTime(0);
  }

  showTime(time) {
    this.time = time;
    [...this.figures, ...this.marks].forEach((drawn) => drawn.showTime(time));
    this.#look();
    this.floor.showTime(time);
    this.#aimSun();
    this.stale = true;
  }

  // Camera and target move together, so that the view a hand has chosen is kept.
  #look() {
    const extent = this.#extent(this.follow ? this.time : null, this.takes);
    const center = extent.getCenter(new THREE.Vector3());
    const shift = center.clone().sub(this.center);
    this.camera.position.add(shift);
    this.controls.target.add(shift);
    this.center = center;
  }

  get takes() {
    return this.watched === null ? this.all : [this.watched];
  }

  /** The box around some takes' places at `time`, or, where null, over their whole paths. */
  #extent(time, takes) {
    const box = new THREE.Box3();
    for (const take of takes) {
      const path = this.paths[take];
      const { fps } = this.figures[take].motion;
      const [dx, dz] = this.offsets[take];
      const points = time === null ? path : [alongPath(path, fps, time)];
      for (const [x, z] of points) box.expandByPoint(new THREE.Vector3(x + dx, HEIGHT, z + dz));
    }
    return box;
  }

  /** How far apart some takes are at most: at one time, or, with a standing camera, in all. */
  #spread(takes, together) {
    if (!together) return this.#extent(null, takes).getSize(new THREE.Vector3());
    const spread = new THREE.Vector3();
    for (let i = 0; i < 24; i++) {
      const extent = this.#extent((i / 23) * this.seconds, takes);
      spread.max(extent.getSize(new THREE.Vector3()));
    }
    return spread;
  }

  #aimSun() {
    const { x, z } = this.#extent(this.time, this.all).getCenter(new THREE.Vector3());
    this.sun.target.position.set(x, 0, z);
    this.sun.position.set(x + 2.6, 6, z + 2.6);
  }

  setFollow(follow) {
    this.follow = follow;
    this.showTime(this.time);
    this.reset();
  }

  /** Shows one take alone (its number from 0), or all (null). */
  watch(take) {
    this.watched = take;
    for (const drawn of [this.figures, this.marks, this.floor.paths]) {
      drawn.forEach(({ object }, i) => (object.visible = take === null || take === i));
    }
    this.showTime(this.time);
    this.reset();
  }

  /** Brings the camera back to where everything that is watched can be seen. */
  reset() {
    const size = this.#spread(this.takes, this.follow);
    const highest = Math.max(...this.takes.map((take) => this.figures[take].height ?? 0));
    const tall = Math.max(2.15, 1.15 * highest) + size.z * 0.2;
    const wide = Math.max(1.3, 0.8 * highest) + size.x + size.z * 0.35;
    const half = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
    const free = this.freeHeight / this.canvas.clientHeight;
    const near = Math.max(tall / 2 / half / free, wide / 2 / half / this.camera.aspect);
    const distance = Math.max(near + 0.3 + size.z / 2, this.#far(size, half * this.camera.aspect));
    this.controls.maxDistance = Math.max(FARTHEST, 1.5 * distance);
    this.camera.far = Math.max(3 * FARTHEST, 4 * distance);
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(this.center);
    this.camera.position.copy(this.center).addScaledVector(this.eye, distance);
    this.controls.update();
    this.touched = false;
    this.stale = true;
  }

  /** How far back the eye has to stand for both ends of a row, the nearer one seen larger. */
  #far(size, half) {
    const aside = new THREE.Vector3(0, 1, 0).cross(this.eye).normalize();
    const ends = [-1, 1].flatMap((x) => [-1, 1].map((z) => {
      return new THREE.Vector3(x * (size.x / 2 + BESIDE), 0, (z * size.z) / 2);
    }));
    return Math.max(...ends.map((end) => end.dot(this.eye) + Math.abs(end.dot(aside)) / half));
  }

  turn(angle) {
    this.touched = true;
    const arm = this.camera.position.clone().sub(this.controls.target);
    arm.applyAxisAngle(new THREE.Vector3(0, 1, 0), angle);
    this.camera.position.copy(this.controls.target).add(arm);
    this.stale = true;
  }

  /** Looks from where another stage's camera looks. */
  lookAs(other) {
    const arm = other.camera.position.clone().sub(other.controls.target);
    this.camera.position.copy(this.controls.target).add(arm);
    this.stale = true;
  }

  zoom(factor) {
    this.touched = true;
    const arm = this.camera.position.clone().sub(this.controls.target);
    this.camera.position.copy(this.controls.target).addScaledVector(arm, factor);
    this.stale = true;
  }

  /** Fits the canvas; the lowest `covered` and highest `above` pixels lie under the panel. */
  resize(covered, above) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.freeHeight = Math.max(height - covered - above, height / 3);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2) * this.detail);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.setViewOffset(width, height, 0, (covered - above) / 2, width, height);
    this.stale = true;
  }

  /** Draws this part of the pixels along each side, and of the shadow. */
  setDetail(detail) {
    this.detail = detail;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2) * detail);
    this.sun.shadow.mapSize.setScalar(SHADOW_PIXELS * detail);
    this.sun.shadow.map?.dispose();
    this.sun.shadow.map = null;
    this.stale = true;
  }

  setDark(dark) {
    this.dark = dark;
    this.floor.setDark(dark);
    this.stale = true;
  }

  /** Gives back what the graphics card holds; the canvas can't be used again. */
  dispose() {
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  /** Draws, if anything changed since the last time. */
  draw() {
    this.controls.update();
    if (!this.stale || !this.freeHeight) return;
    this.floor.fadeAround(this.controls.target, this.camera.position);
    this.renderer.render(this.scene, this.camera);
    this.stale = this.beforeShadows > 0;
    if (this.stale) this.sun.castShadow = --this.beforeShadows === 0;
    // Only now, so that what is shown shares the programs of what was shown before.
    this.past.splice(0).forEach(release);
  }
}

// Chromium tells a renderer's name by an extension alone, Firefox without it.
function nameOf(gl) {
  const name = gl.getParameter(gl.RENDERER);
  const extension = name === "WebKit WebGL" ? gl.getExtension("WEBGL_debug_renderer_info") : null;
  return extension ? gl.getParameter(extension.UNMASKED_RENDERER_WEBGL) : name;
}

function mannequin(motion, skinOf, color, at) {
  return isHuman(motion.skeleton) ? new Figure(motion, skinOf(), color, at) : stick(motion, skinOf, color, at);
}

// Figures of one skeleton share the resting skin.
function geometryOf({ skeleton }) {
  if (!geometries.has(skeleton)) geometries.set(skeleton, bodyGeometry(skeleton));
  return geometries.get(skeleton);
}

/** Frees what an object holds on the graphics card, but for skins, which are shared. */
export function release(object) {
  object.traverse(({ geometry, material, skeleton, shadow }) => {
    if (!geometry?.userData.isShared) geometry?.dispose();
    for (const one of [material ?? []].flat()) {
      one.map?.dispose();
      one.dispose();
    }
    skeleton?.dispose();
    shadow?.dispose();
  });
}

function orbit(camera, canvas, changed) {
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = true;
  controls.dampingFactor = 0.12;
  controls.minDistance = 0.6;
  controls.maxDistance = FARTHEST;
  controls.maxPolarAngle = Math.PI * 0.52;
  controls.addEventListener("change", changed);
  return controls;
}

function sunlight(reach) {
  const light = new THREE.DirectionalLight("#fff4e6", 2.5);
  Object.assign(light.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach });
  Object.assign(light.shadow.camera, { near: 0.5, far: 12 + reach });
  light.shadow.mapSize.setScalar(SHADOW_PIXELS);
  light.shadow.radius = 4;
  light.shadow.blurSamples = 8;
  light.shadow.bias = -0.0004;
  light.shadow.normalBias = 0.015;
  return light;
}

function skylight() {
  return new THREE.HemisphereLight("#e8f0ff", "#b7a79a", 1.9);
}

function rimlight() {
  const light = new THREE.DirectionalLight("#cfe0ff", 1.1);
  light.position.set(-3, 2.5, -4);
  return light;
}
