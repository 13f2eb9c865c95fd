// One smooth skin around many shapes: naive surface nets over the blended distance field.
//
// Blend: d(p) = -k log Σ exp(-d_i(p) / k), which does not depend on the order of the shapes.

const CELL = 0.0135; // meters
const BLOCK = 8; // cells along the side of a block that is skipped when the skin is far away
const BLEND = 0.011; // meters, k above
const SOFTNESS = 0.028; // meters over which the skin passes from one bone to the next

const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((c) => [c & 1, (c >> 1) & 1, c >> 2]);
const EDGES = CORNERS.flatMap((_, a) =>
  [1, 2, 4].filter((bit) => !(a & bit)).map((bit) => [a, a | bit]),
);

/** Returns {positions, normals, triangles}: the skin of `shapes`, cut flat at height `floor`. */
export function skin(shapes, floor, scale) {
  const field = (x, y, z) => Math.max(blended(shapes, x, y, z, BLEND * scale), floor - y);
  const grid = sampled(field, bounds(shapes, 0.05 * scale), CELL * scale);
  const { positions, triangles } = surfaceNets(grid);
  const normals = positions.map((point) => settle(field, point, grid.cell));
  return { positions, normals, triangles };
}

/** For each point the four strongest bones and their weights, smoothed along the skin. */
export function bindings({ positions, triangles }, shapes, bones, scale) {
  let weights = positions.map((point) => boneWeights(shapes, bones, point, SOFTNESS * scale));
  const neighbors = adjacency(positions.length, triangles);
  for (let pass = 0; pass < 4; pass++) weights = weights.map((_, v) => mean(weights, neighbors[v]));
  return weights.map(strongestFour);
}

function blended(shapes, x, y, z, k) {
  const distances = shapes.map((shape) => shape.distance(x, y, z));
  const nearest = Math.min(...distances);
  let sum = 0;
  for (const distance of distances) sum += Math.exp((nearest - distance) / k);
  return nearest - k * Math.log(sum);
}

function bounds(shapes, margin) {
  const ends = shapes.flatMap(({ a, b = a, axes = [0, 0, 0] }) => [
    a.map((value, i) => value - axes[i]),
    b.map((value, i) => value + axes[i]),
    b,
    a,
  ]);
  const low = [0, 1, 2].map((i) => Math.min(...ends.map((end) => end[i])) - margin);
  const high = [0, 1, 2].map((i) => Math.max(...ends.map((end) => end[i])) + margin);
  return { low, high };
}

function sampled(field, { low, high }, cell) {
  const size = low.map((value, i) => Math.ceil((high[i] - value) / cell / BLOCK) * BLOCK);
  const grid = { low, cell, size, values: new Float32Array(size[0] * size[1] * size[2]) };
  const reach = (BLOCK / 2 + 1) * Math.sqrt(3) * 1.4 * cell;
  for (const [i, j, k] of steps(size, BLOCK)) {
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

function surfaceNets(grid) {
  const positions = [];
  const vertexOf = new Map();
  const triangles = [];
  const [nx, ny, nz] = grid.size.map((count) => count - 1);
  for (const [x, y, z] of steps([nx, ny, nz], 1)) {
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
  let normal;
  for (let pass = 0; pass < 2; pass++) {
    normal = gradient(field, point, cell * 0.25);
    const distance = Math.min(Math.max(field(...point), -cell), cell);
    for (let i = 0; i < 3; i++) point[i] -= normal[i] * distance;
  }
  return normal;
}

function gradient(field, [x, y, z], h) {
  const slope = [
    field(x + h, y, z) - field(x - h, y, z),
    field(x, y + h, z) - field(x, y - h, z),
    field(x, y, z + h) - field(x, y, z - h),
  ];
  const length = Math.hypot(...slope) || 1;
  return slope.map((value) => value / length);
}

function boneWeights(shapes, bones, [x, y, z], softness) {
  const weights = new Float32Array(bones.length);
  for (const shape of shapes) {
    const bone = bones.indexOf(shape.bone);
    const weight = Math.exp(-Math.max(shape.distance(x, y, z), 0) / softness);
    weights[bone] = Math.max(weights[bone], weight ** 3);
  }
  return normalized(weights);
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

function mean(weights, among) {
  const sum = new Float32Array(weights[0].length);
  for (const v of among) for (let b = 0; b < sum.length; b++) sum[b] += weights[v][b];
  return sum.map((value) => value / among.length);
}

function strongestFour(weights) {
  const order = [...weights.keys()].sort((a, b) => weights[b] - weights[a]).slice(0, 4);
  return { bones: order, weights: normalized(Float32Array.from(order, (b) => weights[b])) };
}
