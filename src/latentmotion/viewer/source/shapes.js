// Rounded shapes: each knows its bone and, for any point, about how far its surface is.

export class Cone {
  constructor(bone, a, b, radiusA, radiusB) {
    Object.assign(this, { bone, a, b, radiusA, radiusB });
    this.girth = [0, 1, 2].map(() => Math.max(radiusA, radiusB));
    this.axis = b.map((value, i) => value - a[i]);
    this.length2 = this.axis.reduce((sum, value) => sum + value * value, 1e-12);
  }

  distance(x, y, z) {
    const { a, axis } = this;
    const px = x - a[0];
    const py = y - a[1];
    const pz = z - a[2];
    const along = (px * axis[0] + py * axis[1] + pz * axis[2]) / this.length2;
    const part = Math.min(Math.max(along, 0), 1);
    const away = norm(px - part * axis[0], py - part * axis[1], pz - part * axis[2]);
    return away - this.radiusA - part * (this.radiusB - this.radiusA);
  }

  mirror() {
    return new Cone(right(this.bone), flip(this.a), flip(this.b), this.radiusA, this.radiusB);
  }
}

export class Ellipsoid {
  constructor(bone, a, axes) {
    Object.assign(this, { bone, a, b: a, axes, girth: axes });
  }

  distance(x, y, z) {
    const { a, axes } = this;
    const px = (x - a[0]) / axes[0];
    const py = (y - a[1]) / axes[1];
    const pz = (z - a[2]) / axes[2];
    const inside = norm(px, py, pz);
    const slope = norm(px / axes[0], py / axes[1], pz / axes[2]);
    return slope < 1e-9 ? -Math.min(...axes) : (inside * (inside - 1)) / slope;
  }

  mirror() {
    return new Ellipsoid(right(this.bone), flip(this.a), this.axes);
  }
}

/** A stack of ovals along the vertical: rows of [y, z, half width, depth ahead, depth behind]. */
export class Trunk {
  constructor(rows) {
    const [low, high] = [rows[0][0], rows[rows.length - 1][0]];
    this.step = (high - low) / 128;
    this.low = low;
    this.rows = Array.from({ length: 129 }, (_, i) => smoothRow(rows, low + i * this.step));
  }

  distance(x, y, z) {
    const at = Math.min(Math.max((y - this.low) / this.step, 0), 127.999);
    const below = this.rows[Math.floor(at)];
    const above = this.rows[Math.floor(at) + 1];
    const mix = (i) => below[i] + (at % 1) * (above[i] - below[i]);
    const dz = z - mix(1);
    const width = mix(2);
    const depth = dz > 0 ? mix(3) : mix(4);
    const flare = (above[2] - below[2]) / this.step;
    const oval = (norm(x / width, dz / depth, 0) - 1) * Math.min(width, depth);
    const aside = oval / norm(1, flare, 0);
    const beyond = Math.max(this.low - y, y - this.low - 128 * this.step, 0);
    return beyond > 0 ? norm(Math.max(aside, 0), beyond, 0) : aside;
  }
}

// Cubic Hermite between the rows around y, with the slopes of their neighbors.
function smoothRow(rows, y) {
  const i = rows.slice(1, -1).filter((row) => row[0] <= y).length;
  const [a, b] = [rows[i], rows[i + 1]];
  const span = b[0] - a[0];
  const u = Math.min(Math.max((y - a[0]) / span, 0), 1);
  const slope = (j, column) => {
    const [back, next] = [rows[Math.max(j - 1, 0)], rows[Math.min(j + 1, rows.length - 1)]];
    return ((next[column] - back[column]) / (next[0] - back[0])) * span;
  };
  return a.map((value, column) => {
    const [from, to] = [slope(i, column), slope(i + 1, column)];
    const bend = u * (1 - u) * ((1 - u) * from - u * to);
    return value + (b[column] - value) * u * u * (3 - 2 * u) + bend;
  });
}

// Math.hypot guards against overflow, which makes it ten times slower.
function norm(x, y, z) {
  return Math.sqrt(x * x + y * y + z * z);
}

function right(name) {
  return name.replace("left_", "right_");
}

function flip([x, y, z]) {
  return [-x, y, z];
}

export function along(start, direction, distance) {
  return start.map((value, i) => value + direction[i] * distance);
}

export function unit(vector) {
  const length = Math.hypot(...vector) || 1;
  return vector.map((value) => value / length);
}
