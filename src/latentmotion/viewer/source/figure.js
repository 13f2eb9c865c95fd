// One take's figure: the skin of its body, carried by its bones.

import * as THREE from "three";
import { body, paint, restPose, sole } from "./anatomy.js";
import { Rig } from "./pose.js";
import { bindings, mapped, skin } from "./surface.js";

const LIFT = 0.02; // meters; in the data the toes' joint lies on the floor, not the sole
const BARE = new THREE.Color("#f1dfd0");
const HAIR = new THREE.Color("#3d342f");
const SHOE = new THREE.Color("#30343f");

/** Steps to the resting skin of a skeleton as a geometry; figures of one skeleton share it. */
export function* bodyGeometry(skeleton) {
  const rest = restPose(skeleton);
  const parts = body(skeleton, rest);
  const surface = yield* skin(parts, sole(rest), rest.scale);
  const bound = yield* bindings(surface, parts, skeleton.names, rest.scale);
  const painted = paint(rest);
  const geometry = new THREE.BufferGeometry();
  const set = (name, rows, Type, size) =>
    geometry.setAttribute(name, new THREE.BufferAttribute(Type.from(rows.flat()), size));
  const paints = yield* mapped(surface.positions, (point) => painted(...point));
  set("position", surface.positions, Float32Array, 3);
  set("normal", surface.normals, Float32Array, 3);
  yield;
  set("paint", paints, Float32Array, 3);
  set("skinIndex", bound.map(({ bones }) => bones), Uint8Array, 4);
  yield;
  set("skinWeight", bound.map(({ weights }) => [...weights]), Float32Array, 4);
  geometry.setIndex(surface.triangles);
  return geometry;
}

export class Figure {
  /** `at` is the [x, z] shift that sets this take beside the others, meters. */
  constructor(motion, geometry, color, at) {
    this.motion = motion;
    this.rig = new Rig(motion.skeleton);
    this.bones = this.rig.matrices.map(() => new THREE.Bone());
    this.positions = new Float32Array(motion.size);
    this.object = skinnedMesh(geometry, suit(color), this.bones);
    this.object.position.set(at[0], LIFT, at[1]);
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
  figure.object.material.dispose();
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

// The suit has the take's color; bare skin and shoes are cut out of it at their exact border.
function suit(color) {
  const material = new THREE.MeshPhysicalMaterial({
    color,
    roughness: 0.62,
    sheen: 0.35,
    sheenRoughness: 0.5,
    sheenColor: new THREE.Color(color).lerp(new THREE.Color("white"), 0.6),
  });
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, { bare: { value: BARE }, shoe: { value: SHOE }, hair: { value: HAIR } });
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute vec3 paint; varying vec3 vPaint;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvPaint = paint;");
    shader.fragmentShader = shader.fragmentShader
      .replace(
        "#include <common>",
        "#include <common>\nuniform vec3 bare, shoe, hair; varying vec3 vPaint;",
      )
      .replace("#include <color_fragment>", PAINTED);
  };
  return material;
}

const PAINTED = `#include <color_fragment>
  vec3 edge = max(fwidth(vPaint), 1e-5);
  vec3 part = smoothstep(-edge, edge, vPaint);
  diffuseColor.rgb = mix(mix(diffuseColor.rgb, bare, part.x), shoe, part.y);
  diffuseColor.rgb = mix(diffuseColor.rgb, hair, part.z);`;
