// The graded polar mesh of the unit disk: vertex 0 at the centre, then rings of vertices at radius (j / rings)^power.
import { zeros } from "./complex.js";
import { Cholesky } from "./cholesky.js";
import { POWER } from "./given.js";
import { edgesOf } from "./triangles.js";

export const TAU = 2 * Math.PI;
const TINY = 1e-300;

export class PolarMesh {
  // kernels: for what solves on it; a picture needs none
  constructor(rings, spokes, power = POWER, kernels = null) {
    Object.assign(this, { rings, spokes, power, kernels });
    this.V = 1 + rings * spokes;
    this.F = spokes * (2 * rings - 1);
    this.free = this.V - spokes; // the vertices before the circle's
    this.radius = Float64Array.from({ length: rings + 1 }, (_, j) => (j / rings) ** power);
    this.placeVertices();
    this.listFaces();
    this.listEdges();
    this.elements();
  }

  // The factorisation for what is free inside the circle; made when it is first needed, since a picture needs none.
  get interior() {
    const inside = (ends) => ends.map((v) => (v < this.free ? v : -1));
    return (this._interior ??= new Cholesky(this.free, inside(this.tail), inside(this.head), this.kernels));
  }

  placeVertices() {
    this.z = zeros(this.V);
    for (let j = 1; j <= this.rings; j++) {
      for (let k = 0; k < this.spokes; k++) {
        const v = this.vertex(j, k);
        this.z.x[v] = this.radius[j] * Math.cos((TAU * k) / this.spokes);
        this.z.y[v] = this.radius[j] * Math.sin((TAU * k) / this.spokes);
      }
    }
  }

  vertex(ring, spoke) {
    return ring > 0 ? 1 + (ring - 1) * this.spokes + (spoke % this.spokes) : 0;
  }

  listFaces() {
    const list = [];
    for (let k = 0; k < this.spokes; k++) list.push(0, this.vertex(1, k), this.vertex(1, k + 1));
    for (let j = 1; j < this.rings; j++) {
      for (let k = 0; k < this.spokes; k++)
        list.push(this.vertex(j, k), this.vertex(j + 1, k), this.vertex(j + 1, k + 1));
      for (let k = 0; k < this.spokes; k++)
        list.push(this.vertex(j, k), this.vertex(j + 1, k + 1), this.vertex(j, k + 1));
    }
    this.faces = Int32Array.from(list);
  }

  // tail, head (E) and faceEdge (3 F) of `edgesOf`; rim: [edge, free vertex, place on the circle, ...] of the edges that
  // reach the circle
  listEdges() {
    const rim = [];
    Object.assign(this, edgesOf(this.faces, this.V));
    this.E = this.tail.length;
    this.tail.forEach((a, e) => {
      if (a < this.free && this.head[e] >= this.free) rim.push(e, a, this.head[e] - this.free);
    });
    this.rim = Int32Array.from(rim);
  }

  // Gradients of the hat functions (3 F), areas (F), and what each face adds to an edge's entry of K(mu), which is
  // plain + Re mu real + Im mu imaginary, over 1 - |mu|^2, the first times 1 + |mu|^2.
  elements() {
    const { F, faces, z } = this;
    Object.assign(this, { gradient: zeros(3 * F), area: new Float64Array(F) });
    for (const name of ["plain", "real", "imaginary"]) this[name] = new Float64Array(3 * F);
    const { x: gx, y: gy } = this.gradient;
    for (let t = 0; t < F; t++) {
      const [a, b, c] = faces.subarray(3 * t, 3 * t + 3);
      const twice = (z.x[b] - z.x[a]) * (z.y[c] - z.y[a]) - (z.y[b] - z.y[a]) * (z.x[c] - z.x[a]);
      this.area[t] = twice / 2;
      for (let k = 0; k < 3; k++) {
        const v = faces[3 * t + ((k + 1) % 3)],
          w = faces[3 * t + ((k + 2) % 3)]; // i (w - v) / (2 area), at the corner opposite
        gx[3 * t + k] = -(z.y[w] - z.y[v]) / twice;
        gy[3 * t + k] = (z.x[w] - z.x[v]) / twice;
      }
      for (let k = 0; k < 3; k++) {
        const i = 3 * t + k,
          m = 3 * t + ((k + 1) % 3);
        this.plain[i] = this.area[t] * (gx[i] * gx[m] + gy[i] * gy[m]);
        this.real[i] = -2 * this.area[t] * (gx[i] * gx[m] - gy[i] * gy[m]);
        this.imaginary[i] = -2 * this.area[t] * (gx[i] * gy[m] + gy[i] * gx[m]);
      }
    }
  }

  // off (E) and diagonal (V) of K(mu) for mu on the faces; false where |mu| < 1 fails
  stiffness(mu, off, diagonal) {
    const { F, E, faceEdge, plain, real, imaginary, tail, head } = this;
    off.fill(0);
    diagonal.fill(0);
    for (let t = 0; t < F; t++) {
      const a = mu.x[t],
        b = mu.y[t],
        square = a * a + b * b;
      if (!(square < 1)) return false;
      const scale = 1 / (1 - square),
        p = (1 + square) * scale,
        q = a * scale,
        r = b * scale;
      for (let i = 3 * t; i < 3 * t + 3; i++) off[faceEdge[i]] += p * plain[i] + q * real[i] + r * imaginary[i];
    }
    for (let e = 0; e < E; e++) {
      diagonal[tail[e]] -= off[e];
      diagonal[head[e]] -= off[e];
    }
    return true;
  }

  // the load of values on the circle, -K_ib f_b
  rimLoad(off, values) {
    const load = new Float64Array(this.free);
    for (let i = 0; i < this.rim.length; i += 3) load[this.rim[i + 1]] -= off[this.rim[i]] * values[this.rim[i + 2]];
    return load;
  }

  // mass and Laplace over pi, as {off, diagonal} each
  get integrals() {
    if (this._integrals) return this._integrals;
    const make = () => ({ off: new Float64Array(this.E), diagonal: new Float64Array(this.V) });
    const mass = make(),
      laplace = make();
    this.stiffness(zeros(this.F), laplace.off, laplace.diagonal);
    for (let i = 0; i < 3 * this.F; i++) {
      const share = this.area[Math.floor(i / 3)] / 12;
      mass.off[this.faceEdge[i]] += share;
      mass.diagonal[this.faces[i]] += 2 * share;
    }
    for (const part of [mass.off, mass.diagonal, laplace.off, laplace.diagonal]) {
      for (let i = 0; i < part.length; i++) part[i] /= Math.PI;
    }
    return (this._integrals = { mass, laplace });
  }

  // z^* A z for a matrix {off, diagonal} and a complex nodal field
  quadratic({ off, diagonal }, { x, y }) {
    let sum = 0;
    for (let v = 0; v < this.V; v++) sum += diagonal[v] * (x[v] * x[v] + y[v] * y[v]);
    this.tail.forEach((a, e) => {
      const b = this.head[e];
      sum += 2 * off[e] * (x[a] * x[b] + y[a] * y[b]);
    });
    return sum;
  }

  // a nodal field's means over the corners of the faces
  onFaces({ x, y }) {
    const mean = zeros(this.F),
      { faces } = this;
    for (let t = 0; t < this.F; t++) {
      const [a, b, c] = faces.subarray(3 * t, 3 * t + 3);
      mean.x[t] = (x[a] + x[b] + x[c]) / 3;
      mean.y[t] = (y[a] + y[b] + y[c]) / 3;
    }
    return mean;
  }

  // the mean over the faces around each vertex, by area, of a field on the faces
  onVertices({ x, y }) {
    const { faces, area } = this,
      mean = zeros(this.V),
      total = new Float64Array(this.V);
    for (let i = 0; i < faces.length; i++) {
      const t = Math.floor(i / 3);
      mean.x[faces[i]] += area[t] * x[t];
      mean.y[faces[i]] += area[t] * y[t];
      total[faces[i]] += area[t];
    }
    total.forEach((sum, v) => {
      mean.x[v] /= sum;
      mean.y[v] /= sum;
    });
    return mean;
  }

  // a function (x, y) -> [u, v] at the centroids of the faces
  atCentres(value) {
    const out = this.onFaces(this.z);
    for (let t = 0; t < this.F; t++) [out.x[t], out.y[t]] = value(out.x[t], out.y[t]);
    return out;
  }

  // Where a point lies: its face, the face's corners and barycentric weights. Beyond the last chord it is moved onto it.
  locate(x, y) {
    const { rings, spokes, radius } = this,
      step = TAU / spokes;
    const angle = (Math.atan2(y, x) + TAU) % TAU,
      k = Math.min(Math.floor(angle / step), spokes - 1);
    const c = Math.cos(step * k),
      s = Math.sin(step * k);
    let b = (y * c - x * s) / Math.sin(step),
      a = x * c + y * s - b * Math.cos(step); // a spoke_k + b spoke_(k + 1)
    const shrink = 1 / Math.max(1, a + b);
    a *= shrink;
    b *= shrink;
    let j = 0;
    while (j < rings - 1 && radius[j + 1] <= a + b) j++;
    const inner = radius[j],
      outer = radius[j + 1],
      out = (a + b - inner) / (outer - inner);
    const lower = j === 0 || b <= outer * out;
    const first = lower ? 1 - out : a / inner,
      far = lower ? b / outer : out;
    const corners = [
      this.vertex(j, k),
      this.vertex(j + 1, k + 1),
      lower ? this.vertex(j + 1, k) : this.vertex(j, k + 1),
    ];
    const face = j === 0 ? k : (2 * j - (lower ? 1 : 0)) * spokes + k;
    return { face, corners, weights: [first, far, 1 - first - far] };
  }

  // f_z and f_zbar of a map w of the vertices, on the faces
  derivatives({ x, y }) {
    const { faces, gradient } = this,
      { x: gx, y: gy } = gradient,
      [p, q] = [zeros(this.F), zeros(this.F)];
    for (let i = 0; i < faces.length; i++) {
      const t = Math.floor(i / 3),
        u = x[faces[i]] / 2,
        v = y[faces[i]] / 2;
      p.x[t] += gx[i] * u + gy[i] * v;
      p.y[t] += gx[i] * v - gy[i] * u;
      q.x[t] += gx[i] * u - gy[i] * v;
      q.y[t] += gx[i] * v + gy[i] * u;
    }
    return [p, q];
  }

  // the measured coefficient of a map w of the vertices
  coefficient(w) {
    const [p, q] = this.derivatives(w),
      mu = zeros(this.F);
    for (let t = 0; t < this.F; t++) {
      const scale = 1 / (p.x[t] * p.x[t] + p.y[t] * p.y[t]);
      mu.x[t] = (q.x[t] * p.x[t] + q.y[t] * p.y[t]) * scale;
      mu.y[t] = (q.y[t] * p.x[t] - q.x[t] * p.y[t]) * scale;
    }
    return mu;
  }

  // the faces that a map w turns over, beyond doubt of rounding
  flipped({ x, y }) {
    const found = [],
      { faces } = this;
    for (let t = 0; t < this.F; t++) {
      const [a, b, c] = faces.subarray(3 * t, 3 * t + 3);
      const left = (x[b] - x[a]) * (y[c] - y[a]),
        right = (y[b] - y[a]) * (x[c] - x[a]);
      if (!(left - right > 1e-15 * (Math.abs(left) + Math.abs(right)) + TINY)) found.push(t);
    }
    return found;
  }
}

// values of a nodal field at places that `locate` gave
export function sample({ x, y }, places) {
  const out = zeros(places.length);
  places.forEach(({ corners, weights }, m) => {
    for (let k = 0; k < 3; k++) {
      out.x[m] += weights[k] * x[corners[k]];
      out.y[m] += weights[k] * y[corners[k]];
    }
  });
  return out;
}

// Meshes, each made when it is first asked for: (rings, spokes, power) -> PolarMesh.
export function meshes(kernels) {
  const made = new Map();
  return (rings, spokes, power = POWER) => {
    const name = `${rings} x ${spokes}, ${power}`;
    if (!made.has(name)) made.set(name, new PolarMesh(rings, spokes, power, kernels));
    return made.get(name);
  };
}
export const meshOf = meshes(); // for pictures
