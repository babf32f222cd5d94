// Looks at the truth (registration/refinement.py): an exact map on a mesh, and one Gauss-Newton step with its derivative
// in closed form. nu lives on the polar mesh of a `Spectrum`, in whose eigenvectors the prior is diagonal.
import { apart, bothSides, bounded, dot, dualSolve, zeros } from "./complex.js";
import { rooms } from "./gradients.js";
import { DiskMap } from "./map.js";
import { sample } from "./mesh.js";
import { columns, fitMobius, mobiusSlope, moved } from "./mobius.js";
import { Carrier, Tangent } from "./tangent.js";

const MOST = 0.6; // of |change of nu| that one step may make: beyond, it is damped
const [LOWER, LEAST] = [0.3, 1e-7]; // by how much at once, and how far at most
const [RISE, BACK] = [1.02, 0.4]; // a look whose objective is that much higher is taken back to this share of its step
const TURNS = 6; // Gauss-Newton steps of the Möbius map at each look

// The mesh that is mapped beside the one that carries nu: what no landmark changes.
export class Link {
  constructor(mesh, spectrum) {
    Object.assign(this, { mesh, spectrum, carrier: new Carrier(spectrum.mesh, mesh), map: (mesh.map ??= new DiskMap(mesh)) });
    const { x, y } = mesh.onFaces(mesh.z);
    this.centres = Array.from(x, (u, t) => spectrum.mesh.locate(u, y[t]));
  }

  // mu on the faces of the mesh
  coefficient(nu) {
    return bounded(sample(nu, this.centres));
  }
}

export class Looks {
  // p, q {x, y}; b = beta / alpha, g = gamma / alpha. Whitened coefficients x: those of nu times root.
  constructor(link, p, q, b, g) {
    Object.assign(this, { link, q, count: p.x.length, scale: Math.sqrt(g / p.x.length) });
    this.root = link.spectrum.values.map((value) => Math.sqrt(1 + b * value));
    this.places = Array.from(p.x, (x, m) => link.mesh.locate(x, p.y[m]));
    this.tangent = new Tangent(link.carrier, this.places);
  }

  // the last proposal of `count` looks from nu (V), without the maps of any other; null once nobody waits for it
  async run(start, count, stale) {
    let best = this.atZero(),
      proposal = this.proposal(start),
      wanted = proposal,
      share = 1;
    for (let k = 0; k < count; k++) {
      if (await stale()) return null;
      const look = this.look(proposal, best.mobius);
      if (look && look.objective < RISE * best.objective) {
        [best, share] = [look, 1];
        wanted = proposal = this.step(look);
      } else {
        share *= BACK;
        const x = best.proposal.x.map((value, i) => value + share * (wanted.x[i] - value));
        proposal = { nu: this.field(x), x };
      }
    }
    return proposal.nu;
  }

  // the step at nu = 0, how far the landmarks should go, and what it leaves of that
  born() {
    const look = this.atZero(),
      { nu, left } = this.step(look),
      slope = this.slope(look);
    const over = (r) => {
      const out = zeros(this.count);
      for (let m = 0; m < this.count; m++) {
        const [sx, sy] = slope[m],
          size = -1 / (sx * sx + sy * sy),
          [x, y] = [r[m], r[this.count + m]];
        out.x[m] = size * (x * sx + y * sy);
        out.y[m] = size * (y * sx - x * sy);
      }
      return out;
    };
    return { nu, wanted: over(look.r), left: over(left) };
  }

  proposal(nu) {
    const x = this.link.spectrum.coefficients(nu);
    return { nu, x: x.map((value, i) => value * this.root[i >> 1]) };
  }

  field(x) {
    return this.link.spectrum.field(x.map((value, i) => value / this.root[i >> 1]));
  }

  atZero() {
    const nowhere = { nu: zeros(this.link.spectrum.mesh.V), x: new Float64Array(2 * this.root.length) };
    return this.seen(nowhere, this.link.mesh.z);
  }

  // null where the coefficient has no map
  look(proposal, parameters) {
    const { map } = this.link;
    return map.solve(this.link.coefficient(proposal.nu)) ? this.seen(proposal, map.normalised(), parameters) : null;
  }

  seen(proposal, f, parameters) {
    const found = fitMobius(sample(f, this.places), this.q, TURNS, parameters),
      w = sample(moved(f, found), this.places),
      r = new Float64Array(2 * this.count);
    for (let m = 0; m < this.count; m++) {
      r[m] = this.scale * (w.x[m] - this.q.x[m]);
      r[this.count + m] = this.scale * (w.y[m] - this.q.y[m]);
    }
    return { proposal, f, mobius: found, w, r, objective: dot(proposal.x, proposal.x) + dot(r, r) };
  }

  // the slope of the Möbius map at the landmarks times the scale, [x, y] each
  slope({ f, mobius: [ax, ay, theta] }) {
    const c = Math.cos(theta),
      s = Math.sin(theta);
    return this.places.map(({ corners, weights }) => {
      const sum = [0, 0];
      corners.forEach((v, k) =>
        mobiusSlope(f.x[v], f.y[v], ax, ay, c, s).forEach((part, i) => {
          sum[i] += this.scale * weights[k] * part;
        }),
      );
      return sum;
    });
  }

  // the Gauss-Newton step from a look, in its dual form; damped while nu would change by more than MOST
  step(look) {
    const { rows, off } = this.rows(look),
      R = 2 * this.count,
      { nu, x } = look.proposal;
    const gram = bothSides(this.gram(rows), R, (row) => row.set(off(row)));
    const rest = off(look.r),
      before = off(rows.map((row) => dot(row, x)));
    for (let share = 1; ; share *= LOWER) {
      const y = dualSolve(gram, share, rest.map((value, i) => value - share * before[i])),
        pull = off(y),
        next = x.map((value) => (1 - share) * value);
      for (let i = 0; i < R; i++) for (let n = 0; n < next.length; n++) next[n] -= share * pull[i] * rows[i][n];
      const field = this.field(next);
      if (apart(field, nu) <= MOST || share < LEAST) return { nu: field, x: next, left: y };
    }
  }

  // the products of all pairs of rows, (R, R)
  gram(rows) {
    const { mesh } = this.link.spectrum,
      R = rows.length,
      { J, gram, M } = rooms(mesh, this.count),
      [width, length] = [2 * M, rows[0].length];
    J.fill(0, 0, length * width);
    rows.forEach((row, i) => row.forEach((value, n) => (J[n * width + i] = value)));
    mesh.kernels.gram(length, J, width, gram);
    return new Float64Array(R * R).map((_, k) => {
      const [i, j] = [Math.floor(k / R), k % R];
      return gram[Math.max(i, j) * width + Math.min(i, j)];
    });
  }

  // the derivative of r with respect to x, a row for each component, and `off`, which takes out what Möbius maps do
  rows(look) {
    const { spectrum } = this.link,
      N = spectrum.values.length,
      slope = this.slope(look),
      found = this.tangent.variation(look.proposal.nu, look.f);
    const rows = Array.from({ length: 2 * this.count }, () => new Float64Array(2 * N)),
      white = this.root.map((value) => 1 / value),
      [a, b] = [new Float64Array(2 * N), new Float64Array(2 * N)];
    found.forEach(({ P, Q }, m) => {
      const [sx, sy] = slope[m],
        times = (A, sign) => [
          Float64Array.from({ length: N + 1 }, (_, i) => sx * A[2 * i] - sy * A[2 * i + 1]),
          Float64Array.from({ length: N + 1 }, (_, i) => sign * (sx * A[2 * i + 1] + sy * A[2 * i])),
        ];
      const into = ([x, y], out) => spectrum.gradients(x.subarray(1), y.subarray(1), [x[0], y[0]], out, 0);
      into(times(P, -1), a);
      into(times(Q, 1), b);
      for (let n = 0; n < 2 * N; n += 2) {
        const w = white[n >> 1];
        rows[m][n] = w * (a[n] + b[n]);
        rows[m][n + 1] = w * (a[n + 1] + b[n + 1]);
        rows[this.count + m][n] = -w * (a[n + 1] - b[n + 1]); // i (a - b)
        rows[this.count + m][n + 1] = w * (a[n] - b[n]);
      }
    });
    return { rows, off: projection(look.w) };
  }
}

// r (2 M) without its part along the three directions of a Möbius map
function projection({ x, y }) {
  const M = x.length,
    basis = [];
  const three = [0, 1, 2].map(() => new Float64Array(2 * M));
  for (let m = 0; m < M; m++) {
    columns(x[m], y[m]).forEach((row, part) =>
      row.forEach((value, i) => {
        three[i][part * M + m] = value;
      }),
    );
  }
  const off = (r) => {
    const out = Float64Array.from(r);
    for (const e of basis) {
      const part = dot(e, out);
      for (let i = 0; i < out.length; i++) out[i] -= part * e[i];
    }
    return out;
  };
  for (const column of three) {
    const size = Math.sqrt(dot(column, column)),
      rest = off(off(column)),
      left = Math.sqrt(dot(rest, rest));
    if (left > 1e-12 * size) basis.push(rest.map((value) => value / left));
  }
  return off;
}
