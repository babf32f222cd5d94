// Row switching: where a map folds, the rows of the vertices there become Floater's mean-value averages, whose weights
// are all positive, and the map is solved again with the same circle. As plane/bijectivity.py.
import { copy } from "./complex.js";
import { solveUnsymmetric } from "./cholesky.js";

const MOST_ROUNDS = 30;

// A map w of the vertices without its folds, if they can be mended: {w, switched}, the number of rows. `solution` is
// the DiskMap that w follows, by a Möbius map or not.
export function unfold(solution, w) {
  const { mesh } = solution,
    switched = new Uint8Array(mesh.V);
  let average = null;
  for (let round = 0; round < MOST_ROUNDS; round++) {
    const flipped = mesh.flipped(w);
    if (!flipped.length) break;
    if (!spread(mesh, flipped, switched)) break;
    average ??= meanValues(mesh, solution.mu);
    w = mixed(solution, average, switched, w);
  }
  return { w, switched: switched.reduce((sum, one) => sum + one, 0) };
}

// Switch the inner vertices of the flipped faces, and a ring around them more as long as none of these is new; false
// where there is none.
function spread(mesh, flipped, switched) {
  const { faces, free, F } = mesh,
    wanted = new Uint8Array(mesh.V);
  const mark = (t) => {
    for (let i = 3 * t; i < 3 * t + 3; i++) if (faces[i] < free) wanted[faces[i]] = 1;
  };
  const size = () => wanted.reduce((sum, one) => sum + one, 0);
  const fresh = () => wanted.some((one, v) => one && !switched[v]);
  flipped.forEach(mark);
  for (let reached = 0; size() > reached && !fresh();) {
    reached = size();
    const before = wanted.slice();
    for (let t = 0; t < F; t++)
      if (before[faces[3 * t]] || before[faces[3 * t + 1]] || before[faces[3 * t + 2]]) mark(t);
  }
  if (!fresh()) return false;
  wanted.forEach((one, v) => {
    if (one) switched[v] = 1;
  });
  return true;
}

// Weights of the averages, for the edges lengths in the metric of mu: row head[e] has lower[e] for tail[e] and row
// tail[e] has upper[e] for head[e]; each row's weights, all negative, with the diagonal 1.
function meanValues(mesh, mu) {
  const { faces, F, z, tail, head, faceEdge } = mesh;
  const lower = new Float64Array(mesh.E),
    upper = new Float64Array(mesh.E),
    total = new Float64Array(mesh.V);
  const add = (row, column, e, weight) => {
    (row === head[e] ? lower : upper)[e] -= weight;
    total[row] += weight;
  };
  for (let t = 0; t < F; t++) {
    const length = [0, 1, 2].map((k) => {
      // of the edge opposite corner k
      const a = faces[3 * t + ((k + 1) % 3)],
        b = faces[3 * t + ((k + 2) % 3)];
      const x = z.x[a] - z.x[b],
        y = z.y[a] - z.y[b];
      return Math.hypot(x + mu.x[t] * x + mu.y[t] * y, y + mu.y[t] * x - mu.x[t] * y); // |s + mu conj(s)|
    });
    for (let k = 0; k < 3; k++) {
      const following = (k + 1) % 3,
        last = (k + 2) % 3;
      const o = length[k],
        l = length[following],
        r = length[last],
        smallest = 1e-24 * (l + r) ** 2;
      const half = Math.sqrt(Math.max(o * o - (l - r) ** 2, smallest) / Math.max((l + r) ** 2 - o * o, smallest));
      const corner = faces[3 * t + k]; // tan of half its angle, over the length of each edge there
      add(corner, faces[3 * t + following], faceEdge[3 * t + k], half / r);
      add(corner, faces[3 * t + last], faceEdge[3 * t + last], half / l);
    }
  }
  for (let e = 0; e < mesh.E; e++) {
    lower[e] /= total[head[e]];
    upper[e] /= total[tail[e]];
  }
  return { lower, upper };
}

// the solution with the switched rows' averages in place of K(mu), the same values on the circle
function mixed({ mesh, off, diagonal }, average, switched, w) {
  const { E, free, tail, head } = mesh;
  const lower = new Float64Array(E),
    upper = new Float64Array(E);
  for (let e = 0; e < E; e++) {
    // rows of K over their diagonal, so that all are alike
    lower[e] = switched[head[e]] ? average.lower[e] : off[e] / diagonal[head[e]];
    upper[e] = switched[tail[e]] ? average.upper[e] : off[e] / diagonal[tail[e]];
  }
  const ones = new Float64Array(free).fill(1), // a rim edge's tail is the free vertex
    loads = [w.x, w.y].map((values) => mesh.rimLoad(upper, values.subarray(free)));
  const [x, y] = solveUnsymmetric(mesh.interior, { lower, upper, diagonal: ones }, loads),
    out = copy(w);
  out.x.set(x);
  out.y.set(y);
  return out;
}
