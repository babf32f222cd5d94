// The derivative of a disk map in closed form (nets/tangent.py): what a change of nu on one polar mesh, the carrier's,
// does to points of another one that is mapped, without a solve, up to what Möbius maps do.
import { activation, toPairs, zeros } from "./complex.js";
import { sample } from "./mesh.js";

const REACH = 1.8; // cells: from where on a node stands for its cell in the integral
const FINER = 3; // into so many squared a triangle is cut, nearer than that
const PARTS = parts(); // barycentric places of their middles

function parts() {
  const found = [];
  for (let i = 0; i < FINER; i++)
    for (let j = 0; i + j < FINER; j++) {
      found.push([i + 1 / 3, j + 1 / 3, FINER - 2 / 3 - i - j]);
      if (i + j < FINER - 1) found.push([i + 2 / 3, j + 2 / 3, FINER - 4 / 3 - i - j]);
    }
  return found.map((place) => place.map((share) => share / FINER));
}

// What no landmark changes: `nodes` of the carrier and `fine`, the middles of the parts of its triangles, with their
// areas and where they lie in the mapped mesh.
export class Carrier {
  constructor(carrier, mapped) {
    Object.assign(this, { carrier, mapped });
    const { F, V, faces, area, z } = carrier,
      areas = new Float64Array(V);
    for (let i = 0; i < 3 * F; i++) areas[faces[i]] += area[Math.floor(i / 3)] / 3;
    const n = PARTS.length,
      fine = this.inside(z);
    const located = (points) => Array.from(points.x, (x, i) => mapped.locate(x, points.y[i]));
    this.nodes = { areas, places: located(z) };
    this.fine = { areas: Float64Array.from(fine.x, (_, i) => area[Math.floor(i / n)] / n), places: located(fine) };
  }

  // nu (V) at the middles of the parts
  inside(nu) {
    const { F, faces } = this.carrier,
      n = PARTS.length,
      out = zeros(n * F);
    for (let t = 0; t < F; t++)
      for (let i = 0; i < n; i++)
        for (let k = 0; k < 3; k++) {
          out.x[n * t + i] += PARTS[i][k] * nu.x[faces[3 * t + k]];
          out.y[n * t + i] += PARTS[i][k] * nu.y[faces[3 * t + k]];
        }
    return out;
  }

  // f_z at the vertices of the mapped mesh, averaged over the faces around them by area
  slope(f) {
    return this.mapped.onVertices(this.mapped.derivatives(f)[0]);
  }
}

// The cells around places w = f: [w, radius squared of their images as disks, mass in the integral] as one array, five
// numbers each.
function cells({ areas, places }, nu, f, slope) {
  const out = new Float64Array(5 * places.length),
    w = sample(f, places),
    s = sample(slope, places);
  for (let i = 0; i < places.length; i++) {
    const [sx, sy] = [s.x[i], s.y[i]],
      a = areas[i] / Math.PI,
      t = Math.tanh(Math.hypot(nu.x[i], nu.y[i]));
    out.set([w.x[i], w.y[i], a * (sx * sx + sy * sy) * (1 - t * t), -a * (sx * sx - sy * sy), -2 * a * sx * sy], 5 * i);
  }
  return out;
}

export class Tangent {
  // places: of the points in the mapped mesh
  constructor(carrier, places) {
    Object.assign(this, { carrier, places });
    const { z, faces, F, V } = carrier.carrier,
      { mapped, nodes } = carrier,
      reach = nodes.areas.map((area) => REACH * Math.sqrt(area));
    this.close = [];
    this.faces = [];
    this.rim = [];
    const points = toPairs(sample(mapped.z, places));
    places.forEach(({ corners }, m) => {
      const at = points[m],
        size = Math.max(...corners.map((v) => Math.hypot(mapped.z.x[v] - at[0], mapped.z.y[v] - at[1]))),
        flag = new Uint8Array(V),
        near = [];
      let far = 0;
      for (let v = 0; v < V; v++) {
        const d = Math.hypot(z.x[v] - at[0], z.y[v] - at[1]);
        if (d > 2 * size + reach[v]) continue;
        flag[v] = 1;
        near.push(v);
        far = Math.max(far, d);
      }
      const some = [];
      for (let t = 0; t < F; t++) if (flag[faces[3 * t]] | flag[faces[3 * t + 1]] | flag[faces[3 * t + 2]]) some.push(t);
      this.close.push({ near, flag });
      this.faces.push(some);
      this.rim.push(1 - Math.hypot(...at) < far); // of these points the mirror images are near, too
    });
  }

  // {P, Q}, one array of complex pairs (V) for each point: dk = sum P dnu + Q conj(dnu)
  variation(nu, f) {
    const { carrier } = this,
      slope = carrier.slope(f),
      coarse = cells(carrier.nodes, nu, f, slope),
      fine = cells(carrier.fine, carrier.inside(nu), f, slope);
    return this.places.map((place, m) => {
      const [P, Q] = [0, 1].map(() => new Float64Array(2 * nu.x.length)),
        ends = place.corners.map((v, k) => [f.x[v], f.y[v], place.weights[k]]);
      const point = [[0, 1].map((part) => ends.reduce((sum, end) => sum + end[part] * end[2], 0))];
      point[0].push(1);
      for (let i = 0; i < nu.x.length; i++) kernel(coarse, i, point, P, Q, 2 * i, true);
      this.mend(m, P, Q, fine, ends);
      return chain(nu, P, Q);
    });
  }

  // the entries at close nodes, by the parts of the triangles and the corners
  mend(m, P, Q, fine, ends) {
    const { near, flag } = this.close[m],
      { faces } = this.carrier.carrier,
      mirrored = this.rim[m],
      one = new Float64Array(2),
      two = new Float64Array(2);
    for (const v of near) {
      P[2 * v] = P[2 * v + 1] = 0;
      if (mirrored) Q[2 * v] = Q[2 * v + 1] = 0;
    }
    for (const t of this.faces[m]) {
      for (let i = 0; i < PARTS.length; i++) {
        one.fill(0);
        two.fill(0);
        kernel(fine, PARTS.length * t + i, ends, one, two, 0, mirrored);
        for (let k = 0; k < 3; k++) {
          const v = faces[3 * t + k],
            share = PARTS[i][k];
          if (!flag[v]) continue;
          P[2 * v] += share * one[0];
          P[2 * v + 1] += share * one[1];
          if (!mirrored) continue;
          Q[2 * v] += share * two[0];
          Q[2 * v + 1] += share * two[1];
        }
      }
    }
  }
}

// Adds a cell's parts of P, and of Q if it is wanted, for points [x, y, weight]: dk = P dmu + Q conj(dmu).
function kernel(cell, i, ends, P, Q, to, both) {
  const wx = cell[5 * i],
    wy = cell[5 * i + 1],
    size = cell[5 * i + 2],
    mx = cell[5 * i + 3],
    my = cell[5 * i + 4];
  for (const [x, y, weight] of ends) {
    const ax = wx - x,
      ay = wy - y,
      a = weight / Math.max(ax * ax + ay * ay, size);
    P[to] += a * (mx * ax + my * ay); // mass conj(apart)
    P[to + 1] += a * (my * ax - mx * ay);
    if (!both) continue;
    const bx = 1 - (x * wx + y * wy),
      by = x * wy - y * wx; // 1 - at conj(w)
    const b = weight / Math.max(bx * bx + by * by, size),
      cx = x * x * x - 3 * x * y * y,
      cy = 3 * x * x * y - y * y * y; // at^3
    const ux = bx * cx + by * cy,
      uy = bx * cy - by * cx; // at^3 over that
    Q[to] += b * (mx * ux + my * uy); // conj(mass)
    Q[to + 1] += b * (mx * uy - my * ux);
  }
}

// the same with respect to nu, mu = T(nu): dmu = a dnu + b conj(dnu)
function chain(nu, P, Q) {
  for (let i = 0; i < nu.x.length; i++) {
    const [a, bx, by] = activation(nu.x[i], nu.y[i]);
    const px = P[2 * i],
      py = P[2 * i + 1],
      qx = Q[2 * i],
      qy = Q[2 * i + 1];
    P[2 * i] = a * px + qx * bx + qy * by; // Q conj(b)
    P[2 * i + 1] = a * py + qy * bx - qx * by;
    Q[2 * i] = a * qx + px * bx - py * by; // P b
    Q[2 * i + 1] = a * qy + px * by + py * bx;
  }
  return { P, Q };
}
