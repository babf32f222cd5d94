// The worker's side of the Linear Beltrami Solver with pins: right, or with coefficients as the paper prints them.
import { zeros } from "./complex.js";
import { Cholesky, solveUnsymmetric } from "./cholesky.js";

export const SIZE = [24, 72, 1]; // rings, spokes and grading of the mesh, that of the page's text
const HELD = 0.5; // distance from 0 of the points that are pinned
let first = null; // the mesh's pattern

// The map asked for, and its coefficient at a point: strength s, a twist z exp(i s (1 - |z|^2)) or a stretch z |z|^s.
const ASKED = {
  twist: {
    map: (x, y, s) => turned(x, y, s * (1 - x * x - y * y)),
    mu(x, y, s) {
      const r = x * x + y * y, // -i s z^2 / (1 - i s |z|^2)
        scale = s / (1 + s * s * r * r),
        u = 2 * x * y,
        v = y * y - x * x;
      return [scale * (u - s * r * v), scale * (v + s * r * u)];
    },
  },
  stretch: {
    map: (x, y, s) => [x * Math.hypot(x, y) ** s, y * Math.hypot(x, y) ** s],
    mu(x, y, s) {
      const scale = s / (2 + s) / (x * x + y * y); // s / (2 + s) z / conj z
      return [scale * (x * x - y * y), scale * 2 * x * y];
    },
  },
};
const turned = (x, y, angle) => [
  x * Math.cos(angle) - y * Math.sin(angle),
  x * Math.sin(angle) + y * Math.cos(angle),
];

// vertices that are pinned, evenly around 0, and where to: aside by `pull`, or where the reader has put them
export function pinsOf(mesh, { count, pull, moves }) {
  return Array.from({ length: count }, (_, k) => {
    const angle = (2 * Math.PI * k) / count,
      vertex = nearest(mesh.z, HELD * Math.cos(angle), HELD * Math.sin(angle)),
      start = [mesh.z.x[vertex], mesh.z.y[vertex]],
      r = Math.hypot(...start);
    const aside = [start[0] - (pull * start[1]) / r, start[1] + (pull * start[0]) / r];
    return { vertex, start, target: moves[k] ?? aside };
  });
}

function nearest({ x, y }, u, v) {
  let best = 0;
  for (let i = 1; i < x.length; i++) if (Math.hypot(x[i] - u, y[i] - v) < Math.hypot(x[best] - u, y[best] - v)) best = i;
  return best;
}

// The rows of K, entry by entry: lower and upper (E) as solveUnsymmetric has them, diagonal (V).
function rows(mesh, mu, { e2, e3, e5 }) {
  const lower = new Float64Array(mesh.E),
    upper = new Float64Array(mesh.E),
    diagonal = new Float64Array(mesh.V),
    { faces, faceEdge, tail } = mesh;
  for (let t = 0; t < mesh.F; t++) {
    const entry = [0, 1, 2].map((k) => entryOf(mesh, mu, t, k)), // between corner k and the next
      scale = (e2 ? mesh.area[t] ** 4 : 1) / (e3 ? mesh.area[t] : 1); // E2: each of two gradients times area^2
    for (let k = 0; k < 3; k++) {
      const a = faces[3 * t + k],
        b = faces[3 * t + ((k + 1) % 3)],
        edge = faceEdge[3 * t + k];
      const after = scale * entry[k], // E5 takes the third vertex's in either row
        inA = e5 ? scale * entry[(k + 2) % 3] : after,
        inB = e5 ? scale * entry[(k + 1) % 3] : after;
      (tail[edge] === a ? upper : lower)[edge] += inA;
      (tail[edge] === a ? lower : upper)[edge] += inB;
      diagonal[a] -= inA;
      diagonal[b] -= inB;
    }
  }
  return { lower, upper, diagonal };
}

function entryOf({ plain, real, imaginary }, mu, t, k) {
  const a = mu.x[t],
    b = mu.y[t],
    square = a * a + b * b;
  return ((1 + square) * plain[3 * t + k] + a * real[3 * t + k] + b * imaginary[3 * t + k]) / (1 - square);
}

// The map with (K f)_i = 0 but at what is held: the pins and the circle, or, with rows at the circle too (E4), 0 and 1.
export function solveLbs(mesh, state) {
  const mu = zeros(mesh.F),
    centre = mesh.onFaces(mesh.z),
    asked = ASKED[state.asked];
  for (let t = 0; t < mesh.F; t++) [mu.x[t], mu.y[t]] = asked.mu(centre.x[t], centre.y[t], state.strength);
  const matrix = rows(mesh, mu, state),
    held = new Map();
  for (let v = mesh.free; v < mesh.V; v++) if (!state.e4) held.set(v, [mesh.z.x[v], mesh.z.y[v]]);
  if (state.e4) held.set(0, [0, 0]).set(mesh.free, [1, 0]);
  const pins = pinsOf(mesh, state);
  for (const { vertex, target } of pins) held.set(vertex, target);
  const most = matrix.diagonal.reduce((a, b) => Math.max(a, b), 0),
    negative = matrix.lower.filter((entry) => entry > 1e-12 * most).length;
  const load = [new Float64Array(mesh.V), new Float64Array(mesh.V)];
  for (const [v, [x, y]] of held) {
    matrix.diagonal[v] = 1;
    load[0][v] = x;
    load[1][v] = y;
  }
  for (let e = 0; e < mesh.E; e++) {
    if (held.has(mesh.head[e])) matrix.lower[e] = 0;
    if (held.has(mesh.tail[e])) matrix.upper[e] = 0;
  }
  const [x, y] = solveUnsymmetric(first, matrix, load);
  if (!x.every(Number.isFinite) || !y.every(Number.isFinite)) throw new Error("these rows have no solution");
  return { w: { x, y }, mu, pins, negative };
}

export function answerLbs(bench, state) {
  const mesh = bench.mesh(...SIZE);
  first ??= new Cholesky(mesh.V, mesh.tail, mesh.head);
  const begin = performance.now(),
    { w, mu, pins, negative } = solveLbs(mesh, state),
    ms = performance.now() - begin;
  const found = mesh.coefficient(w),
    size = Float32Array.from(found.x, (x, t) => Math.hypot(x, found.y[t])),
    folds = mesh.flipped(w);
  const largest = (list) => list.reduce((a, b) => Math.max(a, b), 0);
  let off = 0;
  for (let v = 0; v < mesh.V; v++) {
    const [x, y] = v ? ASKED[state.asked].map(mesh.z.x[v], mesh.z.y[v], state.strength) : [0, 0];
    off = Math.max(off, Math.hypot(w.x[v] - x, w.y[v] - y));
  }
  const asked = largest(mu.x.map((x, t) => Math.hypot(x, mu.y[t])));
  return { w, size, folds, faces: mesh.F, pins, negative, edges: mesh.E, off, asked, largest: largest(size), ms };
}
