// Standard normal numbers with a seed: bit for bit those of NumPy's
// `default_rng(seed).standard_normal(count, dtype=float32)`, so that a seed means the same motion.
//
// Sources: M. E. O'Neill, "PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms
// for Random Number Generation", 2014 (PCG XSL-RR 128/64); M. E. O'Neill, "Developing a seed_seq
// Alternative", 2015 (the hash of the seed); J. A. Doornik, "An Improved Ziggurat Method to Generate
// Normal Random Samples", 2005. Constants and the order of draws are NumPy's.

const MASK_64 = (1n << 64n) - 1n;
const MASK_128 = (1n << 128n) - 1n;
const MULTIPLIER = 0x2360ed051fc65da44385df649fccf645n;

const LAYERS = 256;
const EDGE = 3.6541528853610087963519472518; // where the tail of the normal curve begins
const STEPS = 2 ** 23; // of a number within its layer

/** The entropy pool of a seed: how NumPy's `SeedSequence` spreads the bits of an integer. */
class SeedPool {
  constructor(seed) {
    const words = [];
    for (let rest = BigInt(seed); rest || !words.length; rest >>= 32n) {
      words.push(Number(rest & 0xffffffffn));
    }
    this.constant = 0x43b0d7e5;
    this.pool = [0, 1, 2, 3].map((i) => this.#hash(words[i] ?? 0));
    for (let from = 0; from < 4; from++) {
      for (let to = 0; to < 4; to++) if (from !== to) this.#mix(to, this.pool[from]);
    }
    for (const word of words.slice(4)) for (let to = 0; to < 4; to++) this.#mix(to, word);
  }

  #hash(word) {
    const value = word ^ this.constant;
    this.constant = Math.imul(this.constant, 0x931e8875);
    return folded(Math.imul(value, this.constant));
  }

  #mix(to, word) {
    const left = Math.imul(0xca01f9dd, this.pool[to]);
    this.pool[to] = folded((left - Math.imul(0x4973f715, this.#hash(word))) >>> 0);
  }

  /** Returns 64-bit integers to start a generator from. */
  state(count) {
    let constant = 0x8b51f9dd;
    const words = Array.from({ length: 2 * count }, (_, i) => {
      const value = this.pool[i % 4] ^ constant;
      constant = Math.imul(constant, 0x58f38ded);
      return BigInt(folded(Math.imul(value, constant)));
    });
    return Array.from({ length: count }, (_, i) => words[2 * i] | (words[2 * i + 1] << 32n));
  }
}

function folded(word) {
  return (word ^ (word >>> 16)) >>> 0;
}

/** PCG XSL-RR 128/64, 32 bits at a time: of each 64 the lower half first. */
class Pcg64 {
  constructor(seed) {
    const [high, low, sequenceHigh, sequenceLow] = new SeedPool(seed).state(4);
    this.increment = ((((sequenceHigh << 64n) | sequenceLow) << 1n) | 1n) & MASK_128;
    this.state = this.increment + ((high << 64n) | low);
    this.#step();
    this.later = null;
  }

  #step() {
    this.state = (this.state * MULTIPLIER + this.increment) & MASK_128;
  }

  next() {
    if (this.later !== null) {
      const word = this.later;
      this.later = null;
      return word;
    }
    this.#step();
    const mixed = (this.state >> 64n) ^ (this.state & MASK_64);
    const turn = this.state >> 122n;
    const word = ((mixed >> turn) | (mixed << (64n - turn))) & MASK_64;
    this.later = Number(word >> 32n);
    return Number(word & 0xffffffffn);
  }

  /** Returns a number from 0 to 1 in steps of 2⁻²⁴. */
  fraction() {
    return (this.next() >>> 8) / 2 ** 24;
  }
}

/**
 * The layers of the ziggurat: the height of the curve at each edge, the width of a step in each
 * layer, and below which step a number is surely under the curve.
 */
function ziggurat() {
  const density = (x) => Math.exp(-0.5 * x * x);
  const heights = new Float32Array(LAYERS);
  const widths = new Float32Array(LAYERS);
  const sure = new Uint32Array(LAYERS);
  const area = 0.00492867323399; // of each layer; NumPy's tables were made with these digits
  let [x, above] = [EDGE, EDGE];
  sure[0] = Math.round(((EDGE * density(EDGE)) / area) * STEPS);
  widths[0] = area / density(EDGE) / STEPS;
  heights[0] = 1;
  heights[LAYERS - 1] = density(EDGE);
  widths[LAYERS - 1] = EDGE / STEPS;
  for (let i = LAYERS - 2; i >= 1; i--) {
    x = Math.sqrt(-2 * Math.log(area / above + density(above)));
    sure[i + 1] = Math.round((x / above) * STEPS);
    above = x;
    heights[i] = density(x);
    widths[i] = x / STEPS;
  }
  sure[1] = 0;
  return { heights, widths, sure };
}

const { heights, widths, sure } = ziggurat();

/**
 * Returns `count` standard normal numbers of a seed, a whole number from 0 up.
 * @param {number | bigint} seed
 * @param {number} count
 */
export function standardNormal(seed, count) {
  const random = new Pcg64(seed);
  return Float32Array.from({ length: count }, () => draw(random));
}

function draw(random) {
  for (;;) {
    const word = random.next();
    const layer = word & 0xff;
    const step = (word >>> 9) & 0x7fffff;
    const size = Math.fround(step * widths[layer]);
    const x = word & 0x100 ? -size : size;
    if (step < sure[layer]) return x;
    if (layer === 0) return tail(random, step & 0x100);
    const slice = Math.fround(heights[layer - 1] - heights[layer]);
    const height = Math.fround(Math.fround(slice * random.fraction()) + heights[layer]);
    if (height < Math.exp(-0.5 * x * x)) return x;
  }
}

function tail(random, negative) {
  for (;;) {
    const inverse = Math.fround(1 / EDGE);
    const x = Math.fround(-inverse * Math.fround(Math.log1p(-random.fraction())));
    const y = Math.fround(-Math.fround(Math.log1p(-random.fraction())));
    if (Math.fround(y + y) > Math.fround(x * x)) {
      const far = Math.fround(Math.fround(EDGE) + x);
      return negative ? -far : far;
    }
  }
}

