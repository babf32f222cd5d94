// Fields on a polar mesh in the eigenvectors of its Laplace operator (plane/spectrum.py), by Fourier transforms along
// the rings. Coefficients are {x, y}, by angular mode, then radial.
import { zeros } from "./complex.js";
import { TAU } from "./mesh.js";

export class Spectrum {
  // tensors: radial (spokes, rings, rings), eigenvalues (spokes rings), area (rings)
  constructor(mesh, { radial, eigenvalues, area }) {
    Object.assign(this, { mesh, radial: Float64Array.from(radial.data), values: Float64Array.from(eigenvalues.data) });
    this.area = Float64Array.from(area.data);
    this.cos = Float64Array.from({ length: mesh.spokes }, (_, k) => Math.cos((TAU * k) / mesh.spokes));
    this.sin = Float64Array.from({ length: mesh.spokes }, (_, k) => Math.sin((TAU * k) / mesh.spokes));
  }

  // E^* g of gradients g at the nodes, (x, y, centre), into out at `to`, complex pairs
  gradients(x, y, [centreX, centreY], out, to) {
    const {
        mesh: { rings, spokes },
        radial,
        cos,
        sin,
      } = this,
      waveX = new Float64Array(rings),
      waveY = new Float64Array(rings),
      root = 1 / Math.sqrt(spokes);
    for (let s = 0; s < spokes; s++) {
      for (let j = 0; j < rings; j++) {
        let u = 0,
          v = 0;
        for (let k = 0, i = 0, from = j * spokes; k < spokes; k++, from++, i = (i + s) % spokes) {
          u += x[from] * cos[i] + y[from] * sin[i];
          v += y[from] * cos[i] - x[from] * sin[i];
        }
        waveX[j] = root * u;
        waveY[j] = root * v;
      }
      if (s === 0) {
        // the centre is the mean of the first ring
        waveX[0] += root * centreX;
        waveY[0] += root * centreY;
      }
      for (let r = 0; r < rings; r++) {
        let u = 0,
          v = 0;
        for (let j = 0; j < rings; j++) {
          const value = radial[(s * rings + j) * rings + r];
          u += value * waveX[j];
          v += value * waveY[j];
        }
        out[to + 2 * (s * rings + r)] = u;
        out[to + 2 * (s * rings + r) + 1] = v;
      }
    }
  }

  // complex pairs of a nodal field (V), the centre left out
  coefficients(nu) {
    const {
        mesh: { rings, spokes },
        area,
      } = this,
      N = rings * spokes,
      weight = (i) => area[Math.floor(i / spokes)] / Math.PI;
    const out = new Float64Array(2 * N),
      [x, y] = ["x", "y"].map((part) => Float64Array.from({ length: N }, (_, i) => weight(i) * nu[part][i + 1]));
    this.gradients(x, y, [0, 0], out, 0);
    return out;
  }

  // the nodal field (V) of complex pairs
  field(c) {
    const {
        mesh: { rings, spokes, V },
        radial,
        cos,
        sin,
      } = this,
      out = zeros(V),
      root = 1 / Math.sqrt(spokes);
    for (let s = 0; s < spokes; s++) {
      for (let j = 0; j < rings; j++) {
        let x = 0,
          y = 0;
        for (let r = 0; r < rings; r++) {
          const value = root * radial[(s * rings + j) * rings + r],
            from = 2 * (s * rings + r);
          x += value * c[from];
          y += value * c[from + 1];
        }
        for (let k = 0, i = 0, to = 1 + j * spokes; k < spokes; k++, to++, i = (i + s) % spokes) {
          out.x[to] += x * cos[i] - y * sin[i];
          out.y[to] += x * sin[i] + y * cos[i];
        }
      }
    }
    for (const part of ["x", "y"]) {
      for (let k = 1; k <= spokes; k++) out[part][0] += out[part][k] / spokes;
    }
    return out;
  }
}
