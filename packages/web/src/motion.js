// A motion: joints and their rotations, and a clip that drives a skinned figure of three.js.

import { InputError } from "./errors.js";
import { between, boneLengths, inverse, product, rotate, Rotations, subtract, tPose } from "./rotations.js";

// Names of Mixamo's bones, without what stands before a colon or an underscore.
const MIXAMO = {
  pelvis: "Hips", spine1: "Spine", spine2: "Spine1", spine3: "Spine2", neck: "Neck", head: "Head",
  collar: "Shoulder", shoulder: "Arm", elbow: "ForeArm", wrist: "Hand",
  hip: "UpLeg", knee: "Leg", ankle: "Foot", foot: "ToeBase",
};
const NEEDED = ["pelvis", "left_hip", "right_hip"];

export class Motion {
  #found = null;

  /** `fields` are the recipe that made it, and its joints. */
  constructor(fields) {
    Object.assign(this, fields);
  }

  /** Rotations of the joints within their parents, frames × joints × (x, y, z, w). */
  get rotations() {
    const { parents } = this.skeleton;
    return Float32Array.from(this.#solved.world.flatMap((world) => {
      return world.flatMap((turn, joint) => (parents[joint] < 0 ? turn : product(inverse(world[parents[joint]]), turn)));
    }));
  }

  /** Resting joints within their parents, joints × (x, y, z), meters: the T-pose that `rotations` turn. */
  get offsets() {
    const { rest } = this.#solved;
    return Float32Array.from(rest.flatMap((place, joint) => subtract(place, rest[Math.max(this.skeleton.parents[joint], 0)])));
  }

  /**
   * Returns an AnimationClip that moves a figure.
   * @param THREE The three.js that the figure was loaded with.
   * @param figure What holds its bones, in its rest pose, for example a loaded glTF's scene.
   * @param bones The bone of each of our joints by name; by default bones of our names or Mixamo's.
   */
  toClip(THREE, figure, bones = namedBones(figure, this.skeleton.names)) {
    const { names, parents } = this.skeleton;
    const found = names.map((name) => (bones[name] ? figure.getObjectByName(bones[name]) : null));
    const missing = NEEDED.filter((name) => !found[names.indexOf(name)]);
    if (missing.length) {
      throw new InputError(`the figure has no bone for ${missing.join(", ")}; name them: toClip(THREE, figure, { pelvis: "Hips", … })`);
    }
    figure.updateWorldMatrix(true, true);
    const root = turnOf(THREE, figure);
    const seen = (object) => product(inverse(root), turnOf(THREE, object)); // by the figure
    const placed = (object) => figure.worldToLocal(object.getWorldPosition(new THREE.Vector3())).toArray();
    const resting = found.map((bone) => bone && seen(bone));
    const places = found.map((bone) => bone && placed(bone));
    const { rest, world } = this.#solved;
    const at = (name) => names.indexOf(name);
    // Turned as the figure looks: both have the left hip on their left.
    const [left, right] = [places[at("left_hip")], places[at("right_hip")]];
    const looks = between([1, 0, 0], [left[0] - right[0], 0, left[2] - right[2]]);
    // From the figure's rest pose to the T-pose that the rotations turn.
    const posed = names.map((_, joint) => {
      const child = parents.findIndex((parent, one) => parent === joint && places[one]);
      if (!places[joint] || child < 0 || parents.filter((parent) => parent === joint).length > 1) return [0, 0, 0, 1];
      const ours = rotate(looks, subtract(rest[child], rest[joint]));
      return between(subtract(places[child], places[joint]), ours);
    });
    const turned = world.map((turns) => found.map((bone, joint) => {
      return bone && [product(looks, product(turns[joint], inverse(looks))), posed[joint], resting[joint]].reduce(product);
    }));
    const times = Float32Array.from({ length: this.frames }, (_, frame) => frame / this.fps);
    const tracks = found.flatMap((bone, joint) => {
      if (!bone) return [];
      // What lies between a bone and the next moving one above rests within that.
      let above = parents[joint];
      while (above >= 0 && !found[above]) above = parents[above];
      const within = above < 0 ? seen(bone.parent) : product(inverse(resting[above]), seen(bone.parent));
      const values = turned.flatMap((turns) => {
        const parent = above < 0 ? within : product(turns[above], within);
        return product(inverse(parent), turns[joint]);
      });
      return [new THREE.QuaternionKeyframeTrack(`${bone.name}.quaternion`, times, continuous(values))];
    });
    const pelvis = found[at("pelvis")];
    const lowest = (points) => Math.min(...points.filter(Boolean).map(([, y]) => y));
    const scale = (places[at("pelvis")][1] - lowest(places)) / (rest[0][1] - lowest(rest));
    const start = pelvis.parent;
    const moves = Array.from({ length: this.frames }, (_, frame) => {
      const first = 3 * frame * names.length;
      const place = rotate(looks, [...this.joints.subarray(first, first + 3)].map((value) => value * scale));
      place[1] += lowest(places);
      return start.worldToLocal(figure.localToWorld(new THREE.Vector3(...place))).toArray();
    });
    tracks.push(new THREE.VectorKeyframeTrack(`${pelvis.name}.position`, times, moves.flat()));
    return new THREE.AnimationClip(this.prompt || "motion", this.frames / this.fps, tracks);
  }

  // The T-pose with the motion's bone lengths, and all rotations in the world.
  get #solved() {
    if (this.#found) return this.#found;
    const { skeleton, joints, frames } = this;
    const size = 3 * skeleton.names.length;
    const lengths = boneLengths(this);
    const solve = (rest) => {
      const rotations = new Rotations(skeleton, rest);
      return Array.from({ length: frames }, (_, frame) => rotations.at(joints.subarray(frame * size, (frame + 1) * size)));
    };
    // How hips and collars lie in pelvis and chest is a matter of the body: their mean in all frames.
    const first = solve(tPose(skeleton, lengths));
    const fitted = skeleton.parents.map((parent, joint) => {
      if (parent < 0 || skeleton.parents.filter((one) => one === parent).length < 2) return undefined;
      const sum = [0, 0, 0];
      for (let frame = 0; frame < frames; frame++) {
        const place = (one) => joints.subarray(frame * size + 3 * one, frame * size + 3 * one + 3);
        const bone = rotate(inverse(first[frame][parent]), subtract(place(joint), place(parent)));
        bone.forEach((value, axis) => (sum[axis] += value));
      }
      return sum;
    });
    const rest = tPose(skeleton, lengths, fitted);
    return (this.#found = { rest, world: solve(rest) });
  }
}

function turnOf(THREE, object) {
  return object.getWorldQuaternion(new THREE.Quaternion()).toArray();
}

// Neighbors on the same side, so that players take the short way.
function continuous(values) {
  for (let i = 4; i < values.length; i += 4) {
    const cosine = [0, 1, 2, 3].reduce((sum, k) => sum + values[i + k] * values[i + k - 4], 0);
    if (cosine < 0) for (let k = 0; k < 4; k++) values[i + k] *= -1;
  }
  return values;
}

function namedBones(figure, names) {
  const there = new Map();
  figure.traverse(({ isBone, name }) => isBone && there.set(name.replace(/^.*?(mixamorig|:)\d*[:_]?/i, "").toLowerCase(), name));
  return Object.fromEntries(names.map((name) => {
    const [, side = "", part] = /^(?:(left|right)_)?(.*)$/.exec(name);
    return [name, there.get(name) ?? there.get(`${side}${MIXAMO[part]}`.toLowerCase())];
  }));
}
