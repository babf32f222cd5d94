// The landmark fit linearised at the identity (nets/born.py, nets/linearised.py): where CP-Net starts from.
// At mu = 0 the map's derivative is known once and for all: tables `one` and `two`, one row a ring, for the smoothest
// eigenvectors ("modes") of the polar mesh. In these the fit's prior is diagonal.
import { choleskyDense, dot, solveDense, zeros } from "./complex.js";
import { fitMobius, columns, mobius, mobiusSlope } from "./mobius.js";
import { TAU } from "./mesh.js";

const RIDGE = 1e-9;

export class Born {
  // tensors: one, two (rings, modes, 2), radial (spokes, rings, rings), values, kept (modes), area (rings)
  constructor(mesh, tensors) {
    this.mesh = mesh;
    this.tables = Object.fromEntries(
      ["one", "two", "radial", "values", "area"].map((name) => [name, Float64Array.from(tensors[name].data)]),
    );
    this.modes = tensors.kept.data.length;
    this.angular = Int32Array.from(tensors.kept.data, (k) => Math.floor(k / mesh.rings)); // mode number
    this.ring = Int32Array.from(tensors.kept.data, (k) => k % mesh.rings); // which radial part
    this.cos = Float64Array.from({ length: mesh.spokes }, (_, k) => Math.cos((TAU * k) / mesh.spokes));
    this.sin = Float64Array.from({ length: mesh.spokes }, (_, k) => Math.sin((TAU * k) / mesh.spokes));
  }

  spoke(k) {
    return ((k % this.mesh.spokes) + this.mesh.spokes) % this.mesh.spokes;
  }

  // Gradients of Re f, Im f at places with respect to the coefficients: rows (2 modes: real, imaginary parts), columns
  // (2M: Re and Im of each landmark).
  jacobian(places) {
    const {
        mesh: { spokes },
        modes,
        angular,
        tables: { one, two },
        cos,
        sin,
      } = this,
      R = 2 * places.length;
    const J = new Float64Array(2 * modes * R);
    places.forEach(({ corners, weights }, m) =>
      corners.forEach((v, k) => {
        if (v === 0) return;
        const ring = Math.floor((v - 1) / spokes),
          turn = (v - 1) % spokes,
          weight = weights[k];
        for (let n = 0; n < modes; n++) {
          const a = this.spoke(turn * (1 - angular[n])),
            b = this.spoke(turn * (3 - angular[n])),
            at = 2 * (ring * modes + n);
          const fx = one[at] * cos[a] - one[at + 1] * sin[a],
            fy = one[at] * sin[a] + one[at + 1] * cos[a];
          const gx = two[at] * cos[b] - two[at + 1] * sin[b],
            gy = two[at] * sin[b] + two[at + 1] * cos[b];
          const row = 2 * n * R + 2 * m;
          J[row] += weight * (fx + gx);
          J[row + R] += weight * (fy + gy);
          J[row + 1] -= weight * (fy - gy); // i (first - second)
          J[row + 1 + R] += weight * (fx - gx);
        }
      }),
    );
    return J;
  }

  // sum over frequencies m of waves (spokes, rings) exp(2 pi i m k / spokes), as a field of the rings' nodes
  fieldOf(waves, scale) {
    const {
        mesh: { rings, spokes },
        cos,
        sin,
      } = this,
      out = zeros(rings * spokes);
    for (let m = 0; m < spokes; m++) {
      for (let ring = 0; ring < rings; ring++) {
        const x = waves.x[m * rings + ring] * scale,
          y = waves.y[m * rings + ring] * scale;
        if (x === 0 && y === 0) continue;
        for (let k = 0, i = 0, to = ring * spokes; k < spokes; k++, to++, i = (i + m) % spokes) {
          out.x[to] += x * cos[i] - y * sin[i];
          out.y[to] += x * sin[i] + y * cos[i];
        }
      }
    }
    return out;
  }

  // nu (rings x spokes) of coefficients
  field(c) {
    const {
        mesh: { rings, spokes },
        angular,
        ring,
        tables: { radial },
      } = this,
      waves = zeros(rings * spokes);
    for (let n = 0; n < this.modes; n++) {
      for (let j = 0; j < rings; j++) {
        const value = radial[(angular[n] * rings + j) * rings + ring[n]];
        waves.x[angular[n] * rings + j] += value * c.x[n];
        waves.y[angular[n] * rings + j] += value * c.y[n];
      }
    }
    return this.fieldOf(waves, 1 / Math.sqrt(spokes));
  }

  // coefficients of a field's projection, E^* A nu / pi
  coefficients(nu) {
    const {
        mesh: { rings, spokes },
        angular,
        ring,
        tables: { radial, area },
        cos,
        sin,
      } = this,
      waves = zeros(rings * spokes);
    for (const m of new Set(angular)) {
      for (let j = 0; j < rings; j++) {
        let x = 0,
          y = 0;
        for (let k = 0, i = 0, from = j * spokes; k < spokes; k++, from++, i = (i + m) % spokes) {
          x += nu.x[from] * cos[i] + nu.y[from] * sin[i];
          y += nu.y[from] * cos[i] - nu.x[from] * sin[i];
        }
        const scale = area[j] / Math.sqrt(spokes) / Math.PI;
        waves.x[m * rings + j] = x * scale;
        waves.y[m * rings + j] = y * scale;
      }
    }
    const c = zeros(this.modes);
    for (let n = 0; n < this.modes; n++) {
      for (let j = 0; j < rings; j++) {
        const value = radial[(angular[n] * rings + j) * rings + ring[n]],
          from = angular[n] * rings + j;
        c.x[n] += value * waves.x[from];
        c.y[n] += value * waves.y[from];
      }
    }
    return c;
  }

  // displacements of the nodes by coefficients, to first order
  moved(c) {
    const {
        mesh: { rings, spokes },
        modes,
        angular,
        tables: { one, two },
      } = this,
      waves = zeros(rings * spokes);
    for (let j = 0; j < rings; j++) {
      for (let n = 0; n < modes; n++) {
        const at = 2 * (j * modes + n),
          x = c.x[n],
          y = c.y[n];
        const a = this.spoke(angular[n] - 1) * rings + j,
          b = this.spoke(3 - angular[n]) * rings + j;
        waves.x[a] += x * one[at] + y * one[at + 1];
        waves.y[a] += y * one[at] - x * one[at + 1];
        waves.x[b] += x * two[at] + y * two[at + 1];
        waves.y[b] += x * two[at + 1] - y * two[at];
      }
    }
    return this.fieldOf(waves, 1);
  }

  // The fit of landmarks linearised at the identity, at weights b = beta / alpha and g = gamma / alpha.
  linearised(p, q, b, g) {
    const { mesh } = this,
      count = p.x.length,
      parameters = fitMobius(p, q),
      [ax, ay, theta] = parameters;
    const c = Math.cos(theta),
      s = Math.sin(theta),
      w = zeros(count),
      slope = zeros(count),
      residual = zeros(count);
    for (let m = 0; m < count; m++) {
      [w.x[m], w.y[m]] = mobius(p.x[m], p.y[m], ax, ay, c, s);
      [slope.x[m], slope.y[m]] = mobiusSlope(p.x[m], p.y[m], ax, ay, c, s);
      residual.x[m] = w.x[m] - q.x[m];
      residual.y[m] = w.y[m] - q.y[m];
    }
    const places = Array.from(p.x, (x, m) => mesh.locate(x, p.y[m])),
      J = this.jacobian(places);
    const step = this.dualStep({ J, w, slope, b, k: Math.sqrt(g / count) });
    return { p, q, b, g, count, parameters, w, slope, residual, places, J, step, ...step(residual) };
  }

  // residual {x, y} -> {c, promised}: the dual Gauss-Newton step, free of what a Möbius map does
  dualStep({ J, w, slope, b, k }) {
    const count = w.x.length,
      R = 2 * count,
      {
        modes,
        tables: { values },
      } = this;
    const D = Float64Array.from(values, (value) => 1 + b * value),
      scaled = new Float64Array(J.length);
    const S = new Float64Array(R * R),
      row = new Float64Array(R);
    for (let n = 0; n < 2 * modes; n++) {
      const shrink = 1 / Math.sqrt(D[n >> 1]),
        from = n * R;
      for (let m = 0; m < count; m++) {
        // the slope of the Möbius map, and the weight
        const x = J[from + 2 * m],
          y = J[from + 2 * m + 1];
        scaled[from + 2 * m] = k * (slope.x[m] * x - slope.y[m] * y);
        scaled[from + 2 * m + 1] = k * (slope.y[m] * x + slope.x[m] * y);
      }
      for (let i = 0; i < R; i++) row[i] = scaled[from + i] * shrink;
      for (let i = 0; i < R; i++) for (let j = 0; j <= i; j++) S[i * R + j] += row[i] * row[j];
    }
    for (let i = 0; i < R; i++) for (let j = 0; j < i; j++) S[j * R + i] = S[i * R + j];
    const project = projection(w, k);
    for (let turn = 0; turn < 2; turn++) {
      // the rows, transposed, and again
      for (let i = 0; i < R; i++) S.set(project(S.subarray(i * R, i * R + R)), i * R);
      for (let i = 0; i < R; i++)
        for (let j = 0; j < i; j++) [S[i * R + j], S[j * R + i]] = [S[j * R + i], S[i * R + j]];
    }
    for (let i = 0; i < R; i++) S[i * R + i] += 1;
    choleskyDense(S, R);
    return ({ x, y }) => {
      const r = project(new Float64Array(R).map((_, i) => k * (i % 2 ? y : x)[i >> 1])),
        z = solveDense(S, R, r);
      const promised = dot(r, z),
        pull = project(z),
        c = zeros(modes);
      for (let n = 0; n < 2 * modes; n++)
        (n % 2 ? c.y : c.x)[n >> 1] = -dot(pull, scaled.subarray(n * R, n * R + R)) / D[n >> 1];
      return { c, promised };
    };
  }

  // what coefficients do to the landmarks, to first order, before the Möbius map
  linear({ J, count }, c) {
    const v = zeros(count),
      R = 2 * count;
    for (let n = 0; n < 2 * this.modes; n++) {
      const value = (n % 2 ? c.y : c.x)[n >> 1];
      for (let m = 0; m < count; m++) {
        v.x[m] += value * J[n * R + 2 * m];
        v.y[m] += value * J[n * R + 2 * m + 1];
      }
    }
    return v;
  }
}

// x (2M) without its part along the three directions of a Möbius map
function projection(w, k) {
  const R = 2 * w.x.length,
    three = [0, 1, 2].map(() => new Float64Array(R));
  for (let m = 0; m < w.x.length; m++) {
    columns(w.x[m], w.y[m]).forEach((part, p) =>
      part.forEach((value, i) => {
        three[i][2 * m + p] = k * value;
      }),
    );
  }
  const H = Float64Array.from({ length: 9 }, (_, i) => dot(three[Math.floor(i / 3)], three[i % 3]));
  const ridge = RIDGE * (H[0] + H[4] + H[8] + 1e-12);
  for (let i = 0; i < 3; i++) H[4 * i] += ridge;
  choleskyDense(H, 3);
  return (x) => {
    const t = solveDense(
      H,
      3,
      three.map((column) => dot(column, x)),
    );
    return Float64Array.from(x, (value, i) => value - three[0][i] * t[0] - three[1][i] * t[1] - three[2][i] * t[2]);
  };
}
