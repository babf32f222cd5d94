// The worker's side of the free boundary: harmonic measure seen from a pole, and descents of two losses over the angles
// between neighbouring boundary points, from the right map whose pole goes to 0.
import { zeros } from "./complex.js";
import { descend } from "./descent.js";
import { DiskMap } from "./map.js";
import { sample, TAU } from "./mesh.js";
import { mobius, moved } from "./mobius.js";

export const SIZE = [24, 73, 1]; // rings, spokes and grading; an odd number: no boundary point lies opposite to 1
export const STEPS = 100;
const RHO = 1e-8,
  LEAST = 1e-12; // the paper's weight of L_Boundary, and the least angle

// mu of the sliding map z exp(i s Im(z) |z|): i z conj(h_z) / (1 + i z h_z), h_z = s/2 (-i |z| + Im(z) conj(z) / |z|)
function slidingMu(x, y, s) {
  const r = Math.hypot(x, y),
    a = (s / 2) * ((y * x) / r),
    b = (s / 2) * (-r - (y * y) / r);
  const nx = x * b - y * a, // i z conj(h) = i (x + i y) (a - i b)
    ny = x * a + y * b,
    dx = 1 - (x * b + y * a), // 1 + i z h
    dy = x * a - y * b,
    q = 1 / (dx * dx + dy * dy);
  return [(nx * dx + ny * dy) * q, (ny * dx - nx * dy) * q];
}

// S = K_bb - K_bi K_ii^-1 K_ib, from boundary values to boundary rows, and K_ii^-1 K_ib, its columns padded to an even
// number; for the mu that `map` has solved for.
function schur(map) {
  const { mesh, off, diagonal } = map,
    { rim, free, spokes, tail, head } = mesh,
    { place } = mesh.interior,
    R = spokes + (spokes % 2);
  mesh.columns ??= mesh.kernels.numbers(free * R);
  const X = mesh.columns.fill(0);
  for (let i = 0; i < rim.length; i += 3) X[place[rim[i + 1]] * R + rim[i + 2]] = off[rim[i]];
  mesh.interior.forward(X, R);
  mesh.interior.backward(X, R);
  const S = Array.from({ length: spokes }, () => new Float64Array(spokes));
  for (let k = 0; k < spokes; k++) S[k][k] = diagonal[free + k];
  for (let e = 0; e < mesh.E; e++) {
    if (tail[e] < free) continue;
    S[tail[e] - free][head[e] - free] += off[e];
    S[head[e] - free][tail[e] - free] += off[e];
  }
  for (let i = 0; i < rim.length; i += 3) {
    for (let m = 0; m < spokes; m++) S[rim[i + 2]][m] -= off[rim[i]] * X[place[rim[i + 1]] * R + m];
  }
  return { S, inside: X, R, count: mesh.V };
}

function times(S, f) {
  const out = zeros(S.length);
  for (let k = 0; k < S.length; k++) {
    const row = S[k];
    let u = 0,
      v = 0;
    for (let m = 0; m < row.length; m++) {
      u += row[m] * f.x[m];
      v += row[m] * f.y[m];
    }
    out.x[k] = u;
    out.y[k] = v;
  }
  return out;
}

// Losses of boundary points f: {value, slope}, the slope as complex numbers.
const LOSSES = {
  // mean size of all rows; those inside are zero
  printed({ S, count }, f) {
    const row = times(S, f),
      signs = { x: row.x.map(Math.sign), y: row.y.map(Math.sign) },
      slope = times(S, signs);
    let sum = 0;
    for (let k = 0; k < S.length; k++) sum += Math.abs(row.x[k]) + Math.abs(row.y[k]);
    const share = (part) => part.map((v) => v / (2 * count));
    return { value: sum / (2 * count), slope: { x: share(slope.x), y: share(slope.y) } };
  },
  // energy minus area, 1/2 f* S f - 1/2 sum Im(conj(f_k) f_(k + 1)), whose slope is the residual R
  right({ S }, f) {
    const slope = times(S, f),
      n = S.length;
    let value = 0;
    for (let k = 0; k < n; k++) {
      const next = (k + 1) % n,
        last = (k + n - 1) % n;
      value += (f.x[k] * slope.x[k] + f.y[k] * slope.y[k] - f.x[k] * f.y[next] + f.y[k] * f.x[next]) / 2;
    }
    const row = { x: slope.x.slice(), y: slope.y.slice() };
    for (let k = 0; k < n; k++) {
      const next = (k + 1) % n,
        last = (k + n - 1) % n;
      row.x[k] -= (f.y[next] - f.y[last]) / 2;
      row.y[k] += (f.x[next] - f.x[last]) / 2;
    }
    return { value, slope: row };
  },
};

const angles = (logits) => {
  const most = logits.reduce((a, b) => Math.max(a, b)),
    theta = logits.map((v) => Math.exp(v - most)),
    sum = theta.reduce((a, b) => a + b);
  return theta.map((t) => Math.max((TAU * t) / sum, LEAST));
};

function points(theta) {
  const f = zeros(theta.length);
  theta.reduce((turn, step, k) => {
    f.x[k] = Math.cos(turn);
    f.y[k] = Math.sin(turn);
    return turn + step;
  }, 0);
  return f;
}

// the loss as a function of logits, with rho sum 1 / theta
const objective = (system, loss, rho) => (logits) => {
  const theta = angles(logits),
    f = points(theta),
    { value, slope } = LOSSES[loss](system, f),
    grad = new Float64Array(theta.length);
  let later = 0,
    mean = 0;
  for (let k = theta.length - 1; k >= 0; k--) {
    grad[k] = later - rho / theta[k] ** 2; // an angle moves all later points
    later += slope.y[k] * f.x[k] - slope.x[k] * f.y[k];
    mean += (theta[k] * grad[k]) / TAU;
  }
  const penalty = rho * theta.reduce((sum, t) => sum + 1 / t, 0);
  return { value: value + penalty, grad: grad.map((g, k) => theta[k] * (g - mean)) };
};

// the map that sends the pole to 0 and 1 to 1, after the right one
function seenFrom(mesh, w, pole) {
  const { x, y } = sample(w, [mesh.locate(...pole)]),
    first = mobius(w.x[mesh.free], w.y[mesh.free], x[0], y[0]);
  return moved(w, [x[0], y[0], -Math.atan2(first[1], first[0])]);
}

const rimOf = (mesh, w) => ({ x: w.x.subarray(mesh.free), y: w.y.subarray(mesh.free) });

const stepsOf = ({ x, y }) =>
  Float64Array.from(x, (u, k) => {
    const m = (k + 1) % x.length,
      turn = Math.atan2(u * y[m] - y[k] * x[m], u * x[m] + y[k] * y[m]);
    return turn < 0 ? turn + TAU : turn;
  });

function extended(mesh, { inside, R }, f) {
  const w = zeros(mesh.V),
    { place } = mesh.interior;
  for (let v = 0; v < mesh.free; v++) {
    for (let m = 0; m < f.x.length; m++) {
      w.x[v] -= inside[place[v] * R + m] * f.x[m];
      w.y[v] -= inside[place[v] * R + m] * f.y[m];
    }
  }
  w.x.set(f.x, mesh.free);
  w.y.set(f.y, mesh.free);
  return w;
}

let last = {}; // the descent that was asked for last

// the right map, its measure seen from the pole, and the descent that begins where the pole goes to 0
function descent(bench, { strength, pole, loss }) {
  const key = [strength, pole, loss].join();
  if (last.key === key) return last;
  const mesh = bench.mesh(...SIZE),
    map = (mesh.map ??= new DiskMap(mesh)),
    mu = zeros(mesh.F),
    centre = mesh.onFaces(mesh.z);
  for (let t = 0; t < mesh.F; t++) [mu.x[t], mu.y[t]] = slidingMu(centre.x[t], centre.y[t], strength);
  map.solve(mu);
  const right = map.normalised(),
    system = schur(map),
    measure = stepsOf(rimOf(mesh, seenFrom(mesh, right, pole))),
    judge = objective(system, loss === "right" ? "right" : "printed", loss === "penalised" ? RHO : 0),
    path = descend(judge, measure.map(Math.log), STEPS).map(({ x }) => points(angles(x)));
  const values = path.map((f) => ["printed", "right"].map((name) => LOSSES[name](system, f).value));
  return (last = { key, mesh, right, system, measure, path, values });
}

export function answerBoundary(bench, state) {
  const begin = performance.now(),
    { mesh, right, system, measure, path, values } = descent(bench, state),
    f = path[Math.min(state.step, path.length - 1)],
    w = extended(mesh, system, f),
    centred = seenFrom(mesh, w, [0, 0]);
  let off = 0,
    spread = 0;
  for (let v = 0; v < mesh.V; v++) {
    off = Math.max(off, Math.hypot(centred.x[v] - right.x[v], centred.y[v] - right.y[v]));
    spread += Math.hypot(w.x[v] - 1, w.y[v]) / mesh.V;
  }
  const folds = mesh.flipped(w).length;
  return { w, centred, measure, steps: stepsOf(f), values, off, spread, folds, ms: performance.now() - begin };
}
