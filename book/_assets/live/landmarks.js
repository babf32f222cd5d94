// What a fit is given: landmarks with their targets, checked with the library's words, as points or sliding.
import { fromPairs } from "./complex.js";
import { MOST_LANDMARKS } from "./gradients.js";

const TANGENTIAL_WEIGHT = 0.1; // of a sliding landmark's residual along its target curve

export class LandmarkError extends Error {}

export function checkWeights(weights) {
  for (const name of ["alpha", "beta", "gamma"]) {
    const value = weights[name],
      allowed = value > 0 || (value === 0 && name === "beta");
    if (!(Number.isFinite(value) && allowed)) {
      throw new LandmarkError(`${name} = ${value}: alpha and gamma must be positive, the others not negative, and all finite`);
    }
  }
}

const shown = (x, y) => `${Number(x.toPrecision(4))}${y < 0 ? "-" : "+"}${Number(Math.abs(y).toPrecision(4))}j`;

function checkPoints(name, { x, y }) {
  const far = [...x.keys()].filter((m) => !(Math.hypot(x[m], y[m]) <= 1 + 1e-9));
  if (far.length) {
    throw new LandmarkError(
      `${name} landmarks ${JSON.stringify(far.slice(0, 5))} are not in the closed unit disk ` +
        `(${shown(x[far[0]], y[far[0]])}); map them with the surface's disk map first`,
    );
  }
  const order = [...x.keys()].sort((a, b) => x[a] - x[b] || y[a] - y[b]);
  for (let k = 1; k < order.length; k++) {
    const [a, b] = [order[k - 1], order[k]];
    if (Math.hypot(x[a] - x[b], y[a] - y[b]) >= 1e-12) continue;
    const [first, second] = [Math.min(a, b), Math.max(a, b)];
    throw new LandmarkError(
      `${name} landmarks ${first} and ${second} coincide at ${shown(x[first], y[first])}; ` +
        "drop one of them (a bijection cannot part or merge points)",
    );
  }
}

// Landmarks p, targets q {x, y}, curve labels, and for each landmark the frame in which its residual is counted: along
// the tangent t (weighted down where it slides) and across it.
export class Problem {
  constructor({ moving, target, curve, sliding = false }) {
    this.p = fromPairs(moving);
    this.q = fromPairs(target);
    this.count = moving.length;
    if (moving.length !== target.length || !moving.length) {
      throw new LandmarkError(
        `(${moving.length},) moving and (${target.length},) target landmarks: give one target a landmark`,
      );
    }
    if (this.count > MOST_LANDMARKS) {
      throw new LandmarkError(
        `${this.count} landmarks, and this page takes at most ${MOST_LANDMARKS}: thin the curves`,
      );
    }
    checkPoints("moving", this.p);
    checkPoints("target", this.q);
    this.curve = curve ?? moving.map(() => 0);
    this.frame = moving.map(() => ({ x: 1, y: 0, along: 1 }));
    if (sliding) this.slide();
  }

  slide() {
    for (const label of new Set(this.curve)) {
      const on = [...this.curve.keys()].filter((m) => this.curve[m] === label);
      for (let k = 1; k + 1 < on.length; k++) {
        const x = this.q.x[on[k + 1]] - this.q.x[on[k - 1]],
          y = this.q.y[on[k + 1]] - this.q.y[on[k - 1]];
        const size = Math.hypot(x, y);
        this.frame[on[k]] = { x: x / size, y: y / size, along: TANGENTIAL_WEIGHT };
      }
    }
  }

  // Pairs (u, v)[m], changes of the landmarks, become components along and across, times sqrt(gamma / count); in place.
  components(u, v, gamma) {
    const k = Math.sqrt(gamma / this.count);
    this.frame.forEach(({ x, y, along }, m) => {
      const a = k * along * (x * u[m] + y * v[m]),
        b = k * (x * v[m] - y * u[m]);
      u[m] = a;
      v[m] = b;
    });
  }

  // the transpose of that
  changes(u, v, gamma) {
    const k = Math.sqrt(gamma / this.count);
    this.frame.forEach(({ x, y, along }, m) => {
      const a = k * (along * x * u[m] - y * v[m]),
        b = k * (along * y * u[m] + x * v[m]);
      u[m] = a;
      v[m] = b;
    });
  }

  // the sum of squares of the components of w - q
  mismatch(w, gamma) {
    const u = w.x.map((x, m) => x - this.q.x[m]),
      v = w.y.map((y, m) => y - this.q.y[m]);
    this.components(u, v, gamma);
    return u.reduce((sum, x, m) => sum + x * x + v[m] * v[m], 0);
  }
}
