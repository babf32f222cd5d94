// Fields on a polar mesh in the eigenvectors of its Laplace operator (plane/grids.py), by Fourier transforms along
// the rings. Coefficients are {x, y}, by angular mode, then radial.
import { zeros } from "./complex.js";
import { TAU } from "./mesh.js";

export class Spectrum {
  // tensors: radial (spokes, rings, rings), eigenvalues (spokes rings), area (rings)
  constructor(mesh, { radial, eigenvalues, area }) {
    Object.assign(this, { mesh, radial: Float64Array.from(radial.data), values: Float64Array.from(eigenvalues.data) });
    this.area = Float64Array.from(area.data);
    this.spokes = mesh.spokes;
    this.factor = Math.floor(Math.sqrt(mesh.spokes));
    while (mesh.spokes % this.factor) this.factor--;
    this.half = new Float64Array(2 * mesh.spokes);
    this.waves = Array.from({ length: mesh.rings }, () => new Float64Array(2 * mesh.spokes));
    this.cos = Float64Array.from({ length: mesh.spokes }, (_, k) => Math.cos((TAU * k) / mesh.spokes));
    this.sin = Float64Array.from({ length: mesh.spokes }, (_, k) => Math.sin((TAU * k) / mesh.spokes));
  }

  // Fourier sums of a ring x + i y (from `from` on) into wave, modes one after the other: in two steps, by a factor of the
  // number of spokes near its root, since landmarks ask for a hundred of them
  ring(x, y, from, wave) {
    const { spokes, factor, cos, sin, half } = this,
      other = spokes / factor;
    for (let b = 0; b < other; b++) {
      for (let s = 0; s < factor; s++) {
        let u = 0,
          v = 0;
        for (let a = 0, i = (b * s) % spokes; a < factor; a++, i = (i + other * s) % spokes) {
          const k = from + other * a + b;
          u += x[k] * cos[i] + y[k] * sin[i];
          v += y[k] * cos[i] - x[k] * sin[i];
        }
        half[2 * (s * other + b)] = u;
        half[2 * (s * other + b) + 1] = v;
      }
    }
    for (let s = 0; s < factor; s++) {
      for (let r = 0; r < other; r++) {
        let u = 0,
          v = 0;
        for (let b = 0, i = 0, k = 2 * s * other; b < other; b++, k += 2, i = (i + factor * r) % spokes) {
          u += half[k] * cos[i] + half[k + 1] * sin[i];
          v += half[k + 1] * cos[i] - half[k] * sin[i];
        }
        wave[2 * (s + factor * r)] = u;
        wave[2 * (s + factor * r) + 1] = v;
      }
    }
  }

  // E^* g of gradients g at the nodes, (x, y, centre), into out at `to`, complex pairs
  gradients(x, y, [centreX, centreY], out, to) {
    const { spokes, radial, waves } = this,
      { rings } = this.mesh,
      root = 1 / Math.sqrt(spokes);
    for (let j = 0; j < rings; j++) this.ring(x, y, j * spokes, waves[j]);
    waves[0][0] += centreX; // the centre is the mean of the first ring
    waves[0][1] += centreY;
    for (let s = 0; s < spokes; s++) {
      const start = to + 2 * s * rings;
      out.fill(0, start, start + 2 * rings);
      for (let j = 0; j < rings; j++) {
        const u = root * waves[j][2 * s],
          v = root * waves[j][2 * s + 1];
        for (let r = 0, k = (s * rings + j) * rings, n = start; r < rings; r++, k++, n += 2) {
          out[n] += radial[k] * u;
          out[n + 1] += radial[k] * v;
        }
      }
    }
  }

  // complex pairs of a nodal field (V), the centre left out
  coefficients(nu) {
    const { area } = this,
      { rings, spokes } = this.mesh,
      N = rings * spokes,
      weight = (i) => area[Math.floor(i / spokes)] / Math.PI;
    const out = new Float64Array(2 * N),
      [x, y] = ["x", "y"].map((part) => Float64Array.from({ length: N }, (_, i) => weight(i) * nu[part][i + 1]));
    this.gradients(x, y, [0, 0], out, 0);
    return out;
  }

  // the nodal field (V) of complex pairs
  field(c) {
    const { mesh, radial, spokes } = this,
      { rings } = mesh,
      waves = zeros(rings * spokes),
      root = 1 / Math.sqrt(spokes);
    for (let s = 0; s < spokes; s++) {
      for (let j = 0; j < rings; j++) {
        for (let r = 0; r < rings; r++) {
          const value = root * radial[(s * rings + j) * rings + r],
            from = 2 * (s * rings + r);
          waves.x[s * rings + j] += value * c[from];
          waves.y[s * rings + j] += value * c[from + 1];
        }
      }
    }
    return this.centred(this.ofWaves(waves));
  }

  // sum over frequencies s of waves (spokes, rings) exp(2 pi i s k / spokes), as a field of the rings' nodes
  ofWaves(waves) {
    const { mesh, spokes, cos, sin } = this,
      { rings } = mesh,
      out = zeros(rings * spokes);
    for (let s = 0; s < spokes; s++) {
      for (let j = 0; j < rings; j++) {
        const x = waves.x[s * rings + j],
          y = waves.y[s * rings + j];
        if (x === 0 && y === 0) continue;
        for (let k = 0, i = 0, to = j * spokes; k < spokes; k++, to++, i = (i + s) % spokes) {
          out.x[to] += x * cos[i] - y * sin[i];
          out.y[to] += x * sin[i] + y * cos[i];
        }
      }
    }
    return out;
  }

  // a field of the rings' nodes as one of the mesh, whose centre has the first ring's mean
  centred(field) {
    const out = zeros(this.mesh.V);
    for (const part of ["x", "y"]) {
      out[part].set(field[part], 1);
      for (let k = 0; k < this.spokes; k++) out[part][0] += field[part][k] / this.spokes;
    }
    return out;
  }
}
