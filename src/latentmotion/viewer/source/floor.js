// The floor: a grid of half meters that fades into the distance, shadows, and each take's path.

import * as THREE from "three";

const GRID = {
  vertexShader: `
    varying vec3 place;
    void main() {
      place = (modelMatrix * vec4(position, 1.0)).xyz;
      gl_Position = projectionMatrix * viewMatrix * vec4(place, 1.0);
    }`,
  fragmentShader: `
    uniform vec3 ink;
    uniform vec3 center;
    uniform float reach;
    varying vec3 place;
    float lines(float spacing, float width) {
      vec2 at = place.xz / spacing;
      vec2 step = fwidth(at);
      vec2 away = abs(fract(at - 0.5) - 0.5);
      vec2 line = 1.0 - smoothstep(step * width, step * (width + 1.0), away);
      float crowded = max(step.x, step.y);
      return max(line.x, line.y) * (1.0 - smoothstep(0.2, 0.6, crowded));
    }
    void main() {
      float fade = 1.0 - smoothstep(0.2 * reach, reach, distance(place.xz, center.xz));
      float strength = max(lines(1.0, 0.2) * 0.2, lines(0.5, 0.1) * 0.08);
      gl_FragColor = vec4(ink, strength * fade);
    }`,
};

export class Floor {
  constructor(motions, offsets, colors) {
    this.grid = flat(new THREE.ShaderMaterial({
      ...GRID,
      uniforms: {
        ink: { value: new THREE.Color() },
        center: { value: new THREE.Vector3() },
        reach: { value: 10 },
      },
      transparent: true,
      depthWrite: false,
    }));
    this.shadow = flat(new THREE.ShadowMaterial({ depthWrite: false }));
    this.shadow.receiveShadow = true;
    this.paths = motions.map((motion, i) => new Path(motion, offsets[i], colors[i]));
    this.object = new THREE.Group().add(this.grid, this.shadow);
    this.object.add(...this.paths.map((path) => path.object));
  }

  /** The grid ends around `center`, farther out the farther the eye. */
  fadeAround(center, eye) {
    this.grid.material.uniforms.center.value.copy(center);
    this.grid.material.uniforms.reach.value = 5 + 1.3 * eye.distanceTo(center);
  }

  /** Marks each path up to `time`. */
  showTime(time) {
    this.paths.forEach((path) => path.showTime(time));
  }

  setDark(dark) {
    this.grid.material.uniforms.ink.value.set(dark ? "#9fb2d0" : "#46536b");
    this.shadow.material.opacity = dark ? 0.5 : 0.3;
  }
}

class Path {
  constructor(motion, [dx, dz], color) {
    this.motion = motion;
    const points = Array.from({ length: motion.frames }, (_, frame) => motion.ground(frame));
    this.geometry = new THREE.BufferGeometry().setFromPoints(
      points.map(([x, z]) => new THREE.Vector3(x + dx, 0.003, z + dz)),
    );
    const ahead = new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.45 });
    const done = new THREE.LineBasicMaterial({ color, transparent: true, opacity: 1 });
    this.done = new THREE.Line(this.geometry.clone(), done);
    this.object = new THREE.Group().add(new THREE.Line(this.geometry, ahead), this.done);
  }

  showTime(time) {
    this.done.geometry.setDrawRange(0, Math.floor(time * this.motion.fps) + 1);
  }
}

function flat(material) {
  const mesh = new THREE.Mesh(new THREE.PlaneGeometry(200, 200), material);
  mesh.rotation.x = -Math.PI / 2;
  return mesh;
}
