// The disk self-map with a given Beltrami coefficient and a free boundary, in the flux form: one factorisation.
import { copy, zeros } from "./complex.js";
import { TAU } from "./mesh.js";
import { mobius, moved } from "./mobius.js";

const LOST_STEP = 1e-8,
  SMALLEST_STEP = 1e-3; // of the mean boundary step: below the one, all below the other are raised

export class DiskMap {
  constructor(mesh) {
    this.mesh = mesh;
    this.off = new Float64Array(mesh.E);
    this.diagonal = new Float64Array(mesh.V);
    this.U = new Float64Array(mesh.V); // the Green's function of A(mu) seen from 0, zero on the circle
    this.f = zeros(mesh.V); // the map, before it is normalised
    this.steps = new Float64Array(mesh.spokes); // of the angle along the circle
    this.raised = new Uint8Array(mesh.spokes);
    this.scale = 1;
  }

  // The map of mu on the faces; false where the matrix is not positive definite, as for |mu| = 1.
  solve(mu) {
    const { mesh } = this;
    this.mu = mu;
    if (!mesh.stiffness(mu, this.off, this.diagonal)) return false;
    if (!mesh.interior.factor(this.off, this.diagonal)) return false;
    this.green();
    this.boundary();
    this.inside();
    return true;
  }

  // K_ii U_i = -2 pi e_0
  green() {
    const { interior, free } = this.mesh,
      pole = new Float64Array(free);
    pole[0] = -TAU;
    this.U.set(interior.solved([pole])[0]);
  }

  // The fluxes of U through the circle, halved onto the edges, are the steps of the angle: harmonic measure.
  boundary() {
    const { mesh, off, U, steps, raised, f } = this,
      { rim, spokes, free } = mesh,
      mean = TAU / spokes;
    const flux = new Float64Array(spokes);
    for (let i = 0; i < rim.length; i += 3) flux[rim[i + 2]] += off[rim[i]] * U[rim[i + 1]];
    for (let k = 0; k < spokes; k++) steps[k] = (flux[k] + flux[(k + 1) % spokes]) / 2;
    const lost = Math.min(...steps) <= LOST_STEP * mean;
    let sum = 0;
    for (let k = 0; k < spokes; k++) {
      raised[k] = lost && steps[k] < SMALLEST_STEP * mean ? 1 : 0;
      if (raised[k]) steps[k] = SMALLEST_STEP * mean;
      sum += steps[k];
    }
    this.scale = TAU / sum;
    for (let k = 0, angle = 0; k < spokes; k++) {
      f.x[free + k] = Math.cos(angle);
      f.y[free + k] = Math.sin(angle);
      steps[k] *= this.scale;
      angle += steps[k];
    }
  }

  // K_ii f_i = -K_ib f_b
  inside() {
    const { mesh, off, f } = this,
      loads = [f.x, f.y].map((values) => mesh.rimLoad(off, values.subarray(mesh.free)));
    mesh.interior.solved(loads).forEach((values, k) => (k ? f.y : f.x).set(values));
  }

  // the map inside for values {x, y} on the circle
  extended(circle) {
    this.f.x.set(circle.x, this.mesh.free);
    this.f.y.set(circle.y, this.mesh.free);
    this.inside();
    return copy(this.f);
  }

  // the solution normalised, as a new array
  normalised() {
    return onCircle(this.mesh, moved(this.f, this.normaliser()));
  }

  normaliser() {
    return normaliserOf(this.mesh, this.f);
  }
}

// the Möbius map after f to f(0) = 0 and f(1) = 1; beyond the disk f(0) is folded, and the circle must not turn over
function normaliserOf({ free }, f) {
  const inside = Math.hypot(f.x[0], f.y[0]) < 1,
    [ax, ay] = inside ? [f.x[0], f.y[0]] : [0, 0],
    [x, y] = mobius(f.x[free], f.y[free], ax, ay);
  return [ax, ay, -Math.atan2(y, x)];
}

// what a map of the vertices is on the circle
export const rimOf = ({ free }, { x, y }) => ({ x: x.subarray(free), y: y.subarray(free) });

// rounding taken off the points of the circle
export function onCircle(mesh, w) {
  for (let v = mesh.free; v < mesh.V; v++) {
    const size = Math.hypot(w.x[v], w.y[v]);
    w.x[v] /= size;
    w.y[v] /= size;
  }
  return w;
}
