// One smooth skin around many shapes: naive surface nets over the blended distance field.
//
// Blend: d(p) = -k log Σ exp(-d_i(p) / k), which does not depend on the order of the shapes.

import { unit } from "./shapes.js";

const CELL = 0.0145; // meters
const BLOCK = 4; // cells along the side of a block that is skipped when the skin is far away
const BLEND = 0.011; // meters, k above
const NEGLIGIBLE = 8; // e^-8 of a shape's pull is not seen
const SMOOTHING = 8; // rounds in which each point's weights become the mean of its neighbors'
const AT_A_TIME = 64; // points, or blocks, of a step
const SOFTNESS = 0.01; // meters over which the skin passes from one bone to the next

const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((c) => [c & 1, (c >> 1) & 1, c >> 2]);
const EDGES = CORNERS.flatMap((_, a) =>
  [1, 2, 4].filter((bit) => !(a & bit)).map((bit) => [a, a | bit]),
);

/** Steps to {positions, normals, triangles}: the skin of a body, cut flat at height `floor`. */
export function* skin({ groups, carriers }, floor, scale) {
  const blended = blend(groups, BLEND * scale, BLOCK * CELL * scale);
  const field = (x, y, z) => Math.max(blended(x, y, z), floor - y);
  const grid = yield* sampled(field, bounds(carriers, 0.04 * scale), CELL * scale);
  const { positions, triangles } = yield* surfaceNets(grid);
  const normals = yield* mapped(positions, (point) => settle(field, point, grid.cell));
  return { positions, normals, triangles };
}

/** Steps to the four strongest bones of each point and their weights, smoothed along the skin. */
export function* bindings({ positions, triangles }, { carriers }, bones, scale) {
  const owned = carriers.map((shape) => ({ shape, index: bones.indexOf(shape.bone) }));
  const softness = SOFTNESS * scale;
  let rows = yield* mapped(positions, (point) => boneWeights(owned, bones, point, softness));
  const neighbors = adjacency(positions.length, triangles);
  for (let round = 0; round < SMOOTHING; round++) rows = yield* smoothed(rows, neighbors);
  return yield* mapped(rows, strongestFour);
}

/** Steps to what a function makes of each of many values. */
export function* mapped(values, make) {
  const found = [];
  for (let i = 0; i < values.length; i++) {
    found.push(make(values[i], i));
    if (i % AT_A_TIME === 0) yield;
  }
  return found;
}

// Within a group the nearest shape counts; the groups flow into each other. Each block of space
// remembers the few groups that are near enough to matter in it.
function blend(groups, k, block) {
  const memory = new Map();
  const farthest = Math.sqrt(3) * block + NEGLIGIBLE * k;
  const nearby = (x, y, z) => {
    const at = [x, y, z].map((value) => (Math.floor(value / block) + 0.5) * block);
    const distances = groups.map((group) => nearestOf(group, ...at));
    const least = Math.min(...distances);
    return groups.filter((_, i) => distances[i] < least + farthest);
  };
  return (x, y, z) => {
    const [i, j, l] = [Math.floor(x / block), Math.floor(y / block), Math.floor(z / block)];
    const key = ((i + 512) * 1024 + j + 512) * 1024 + l + 512;
    if (!memory.has(key)) memory.set(key, nearby(x, y, z));
    return smoothMinimum(memory.get(key), k, x, y, z);
  };
}

function nearestOf(group, x, y, z) {
  let least = Infinity;
  for (const shape of group) least = Math.min(least, shape.distance(x, y, z));
  return least;
}

function smoothMinimum(groups, k, x, y, z) {
  let least = Infinity;
  let sum = 0;
  for (const group of groups) {
    const distance = nearestOf(group, x, y, z);
    if (distance < least) {
      sum = sum * Math.exp((distance - least) / k) + 1;
      least = distance;
    } else sum += Math.exp((least - distance) / k);
  }
  return least - k * Math.log(sum);
}

function bounds(shapes, margin) {
  const reach = (sign) => (i) => {
    const ends = shapes.flatMap(({ a, b, girth }) => [a[i], b[i]].map((end) => end + sign * girth[i]));
    return sign * Math.max(...ends.map((end) => sign * end)) + sign * margin;
  };
  return { low: [0, 1, 2].map(reach(-1)), high: [0, 1, 2].map(reach(1)) };
}

function* sampled(field, { low, high }, cell) {
  const size = low.map((value, i) => Math.ceil((high[i] - value) / cell / BLOCK) * BLOCK);
  const grid = { low, cell, size, values: new Float32Array(size[0] * size[1] * size[2]) };
  const reach = (BLOCK / 2 + 1) * Math.sqrt(3) * 1.3 * cell;
  let done = 0;
  for (const [i, j, k] of steps(size, BLOCK)) {
    done += 1;
    if (done % AT_A_TIME === 0) yield;
    const middle = [i, j, k].map((at, axis) => low[axis] + (at + BLOCK / 2) * cell);
    const distance = field(...middle);
    const near = Math.abs(distance) < reach;
    for (const [x, y, z] of steps([BLOCK, BLOCK, BLOCK], 1)) {
      const [gx, gy, gz] = [i + x, j + y, k + z];
      grid.values[index(grid, gx, gy, gz)] = near
        ? field(low[0] + gx * cell, low[1] + gy * cell, low[2] + gz * cell)
        : distance;
    }
  }
  return grid;
}

function* steps([nx, ny, nz], step) {
  for (let z = 0; z < nz; z += step)
    for (let y = 0; y < ny; y += step) for (let x = 0; x < nx; x += step) yield [x, y, z];
}

function index({ size }, x, y, z) {
  return (z * size[1] + y) * size[0] + x;
}

function* surfaceNets(grid) {
  const positions = [];
  const vertexOf = new Map();
  const triangles = [];
  const [nx, ny, nz] = grid.size.map((count) => count - 1);
  for (const [x, y, z] of steps([nx, ny, nz], 1)) {
    if (x === 0) yield;
    if (Math.abs(grid.values[index(grid, x, y, z)]) > 3 * grid.cell) continue;
    const corners = CORNERS.map(([a, b, c]) => grid.values[index(grid, x + a, y + b, z + c)]);
    const crossings = EDGES.filter(([a, b]) => corners[a] < 0 !== corners[b] < 0);
    if (crossings.length === 0) continue;
    vertexOf.set(index(grid, x, y, z), positions.length);
    positions.push(cellVertex(grid, [x, y, z], corners, crossings));
    addQuads(grid, [x, y, z], corners, vertexOf, triangles);
  }
  return { positions, triangles };
}

function cellVertex({ low, cell }, at, corners, crossings) {
  const sum = [0, 0, 0];
  for (const [a, b] of crossings) {
    const part = corners[a] / (corners[a] - corners[b]);
    for (let i = 0; i < 3; i++) {
      sum[i] += CORNERS[a][i] + part * (CORNERS[b][i] - CORNERS[a][i]);
    }
  }
  return sum.map((value, i) => low[i] + (at[i] + value / crossings.length) * cell);
}

// A cell closes the quads around the three grid edges that start in its first corner; the other
// cells of each quad lie before it, so their vertices exist.
function addQuads(grid, at, corners, vertexOf, triangles) {
  for (let axis = 0; axis < 3; axis++) {
    const inside = corners[0] < 0;
    if (inside === corners[1 << axis] < 0) continue;
    const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    const back = (du, dv) => {
      const cell = [...at];
      cell[u] -= du;
      cell[v] -= dv;
      return vertexOf.get(index(grid, ...cell));
    };
    const [a, b, c, d] = [back(0, 0), back(1, 0), back(1, 1), back(0, 1)];
    triangles.push(...(inside ? [a, b, c, a, c, d] : [a, c, b, a, d, c]));
  }
}

/** Moves `point` onto the skin in place; returns the outward normal there. */
function settle(field, point, cell) {
  const distance = field(...point);
  const slope = gradient(field, point, distance, cell * 0.2);
  const steepness = Math.hypot(...slope) || 1;
  const step = Math.min(Math.max(distance / steepness, -cell), cell);
  for (let i = 0; i < 3; i++) point[i] -= (slope[i] / steepness) * step;
  return unit(slope);
}

function gradient(field, [x, y, z], here, h) {
  return [field(x + h, y, z), field(x, y + h, z), field(x, y, z + h)].map((d) => (d - here) / h);
}

function boneWeights(carriers, bones, [x, y, z], softness) {
  const nearest = new Float32Array(bones.length).fill(Infinity);
  for (const { index, shape } of carriers) {
    nearest[index] = Math.min(nearest[index], Math.max(shape.distance(x, y, z), 0));
  }
  return normalized(nearest.map((distance) => Math.exp(-distance / softness)));
}

function normalized(weights) {
  const sum = weights.reduce((total, weight) => total + weight, 1e-12);
  return weights.map((weight) => weight / sum);
}

function adjacency(count, triangles) {
  const neighbors = Array.from({ length: count }, (_, v) => [v]);
  for (let i = 0; i < triangles.length; i += 3) {
    const corners = [triangles[i], triangles[i + 1], triangles[i + 2]];
    corners.forEach((corner, n) => neighbors[corner].push(corners[(n + 1) % 3]));
  }
  return neighbors;
}

function smoothed(rows, neighbors) {
  return mapped(rows, (row, v) => {
    const among = neighbors[v];
    const sum = new Float32Array(row.length);
    for (const n of among) {
      const other = rows[n];
      for (let b = 0; b < sum.length; b++) sum[b] += other[b] / among.length;
    }
    return sum;
  });
}

function strongestFour(weights) {
  const left = Float32Array.from(weights);
  const bones = [0, 1, 2, 3].map(() => {
    const bone = left.reduce((best, weight, b) => (weight > left[best] ? b : best), 0);
    left[bone] = -1;
    return bone;
  });
  return { bones, weights: normalized(Float32Array.from(bones, (bone) => weights[bone])) };
}
