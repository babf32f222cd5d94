// How sure a map is between its landmarks: 90 % ellipses of the posterior at the map without distortion, from the prior's
// covariance J W^-1 J^T between all points, landmarks or not, of which the landmarks take their part away.
import { ask } from "./ask.js";
import { choleskyDense, dot, fromPairs, solveDense, zeros } from "./complex.js";
import { Fit } from "./fit.js";
import { INITIAL } from "./given.js";
import { checkWeights, Problem } from "./landmarks.js";
import { TAU } from "./mesh.js";
import { COLOURS, inDisk } from "./picture.js";
import { weights } from "./problems.js";
import { gap, short, three } from "./words.js";

const MESH = [16, 48]; // rings and spokes, those of the library's posterior
const MOBIUS_PRIOR = 1e-6; // of the three Möbius parameters, as in the fit
const INSIDE = 4.605; // the square of a plane normal variable of variance 1 is below it in 90 of 100 cases
const RINGS = 4, // of six times so many points each, and the centre: places at which the map is looked at
  APART = 0.23;

const places = () => {
  const found = [[0, 0]];
  for (let j = 1; j <= RINGS; j++)
    for (let k = 0; k < 6 * j; k++) {
      const turn = (TAU * k) / (6 * j);
      found.push([APART * j * Math.cos(turn), APART * j * Math.sin(turn)]);
    }
  return found;
};
const SEEN = places();
const given = ({ places, count }) => places.slice(0, count);

// The covariance (2 Q, 2 Q) of the map at SEEN, all real parts first. What the landmarks know is taken off the prior's;
// the Möbius map, of which the prior says next to nothing, comes on top by the three directions that they leave open.
function posterior(mesh, state) {
  const landmarks = given(state),
    n = landmarks.length,
    all = fromPairs([...landmarks, ...SEEN]),
    fit = new Fit(mesh, { count: all.x.length, p: all, q: all });
  fit.weigh(state);
  fit.to(zeros(mesh.V), [0, 0, 0]);
  fit.linearise();
  const { M, gram } = fit.room,
    rows = (from, count) => Array.from({ length: 2 * count }, (_, i) => (i < count ? from + i : M + from + i - count)),
    known = rows(0, n),
    seen = rows(n, SEEN.length),
    part = (i, j) => gram[Math.max(i, j) * 2 * M + Math.min(i, j)];
  const A = Float64Array.from({ length: 4 * n * n }, (_, i) => part(known[Math.floor(i / (2 * n))], known[i % (2 * n)]));
  for (let i = 0; i < 2 * n; i++) A[i * (2 * n + 1)] += n / state.gamma;
  choleskyDense(A, 2 * n);
  const across = seen.map((i) => Float64Array.from(known, (j) => part(i, j))),
    told = across.map((row) => solveDense(A, 2 * n, row)),
    moves = fit.mobiusColumns(M),
    atKnown = moves.map((column) => Float64Array.from(known, (i) => column[i])),
    toldMoves = atKnown.map((column) => solveDense(A, 2 * n, column));
  const P = Float64Array.from({ length: 9 }, (_, i) => {
    const [a, b] = [Math.floor(i / 3), i % 3];
    return dot(atKnown[a], toldMoves[b]) + (a === b ? MOBIUS_PRIOR : 0);
  });
  choleskyDense(P, 3);
  const open = seen.map((i, k) => moves.map((column, a) => column[i] - dot(across[k], toldMoves[a]))),
    freed = open.map((row) => solveDense(P, 3, row));
  return seen.map((i, k) =>
    Float64Array.from(seen, (j, m) => part(i, j) - dot(across[k], told[m]) + dot(open[k], freed[m])),
  );
}

// For each place the mean over all of them of the ellipses' size, relative to the present one, with one landmark
// more there, as exact as the others.
function withOneMore(C, noise) {
  const Q = SEEN.length,
    size = (i, less = 0) => Math.sqrt(Math.max(C[i][i] + C[Q + i][Q + i] - less, 0)),
    all = SEEN.map((_, i) => i),
    sum = (values) => values.reduce((a, b) => a + b, 0);
  const now = sum(all.map((i) => size(i)));
  return all.map((j) => {
    const a = C[j][j] + noise,
      b = C[j][Q + j],
      d = C[Q + j][Q + j] + noise,
      det = a * d - b * b;
    const less = (row) => (d * row[j] ** 2 - 2 * b * row[j] * row[Q + j] + a * row[Q + j] ** 2) / det;
    return sum(all.map((i) => size(i, less(C[i]) + less(C[Q + i])))) / now;
  });
}

// the worker's side
function work(bench, state) {
  const begin = performance.now(),
    moving = given(state);
  checkWeights(state);
  new Problem({ moving, target: moving }); // which refuses what cannot be
  const C = posterior(bench.mesh(...MESH), state),
    Q = SEEN.length,
    covariances = SEEN.map((_, i) => [C[i][i], C[i][Q + i], C[Q + i][Q + i]]),
    radii = covariances.map(([a, , d]) => state.scale * Math.sqrt((INSIDE * (a + d)) / 2)),
    left = withOneMore(C, moving.length / state.gamma);
  return { covariances, radii, left, ms: performance.now() - begin };
}

const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;
const least = (list) => list.indexOf(Math.min(...list));

// the outline of an ellipse about a point, for a covariance [xx, xy, yy] times a square
function ellipse([x, y], [a, b, d], scale) {
  const turn = Math.atan2(2 * b, a - d) / 2,
    middle = (a + d) / 2,
    off = Math.hypot((a - d) / 2, b),
    [long, short] = [middle + off, Math.max(middle - off, 0)].map((value) => scale * Math.sqrt(INSIDE * value));
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return Array.from({ length: 33 }, (_, k) => {
    const [u, v] = [long * Math.cos((TAU * k) / 32), short * Math.sin((TAU * k) / 32)];
    return [x + c * u - s * v, y + s * u + c * v];
  });
}

function draw([sure, next], state, { covariances, left }) {
  const landmarks = given(state),
    best = SEEN[least(left)];
  sure.disk();
  covariances.forEach((one, i) => sure.lines([ellipse(SEEN[i], one, state.scale)], COLOURS.grid, 1));
  SEEN.forEach((point) => sure.ring(point, 0.006, COLOURS.grid, 1));
  landmarks.forEach((point) => sure.dot(point, COLOURS.moving, 5));
  sure.mark();
  next.disk();
  const most = Math.max(...left.map((share) => 1 - share));
  SEEN.forEach((point, i) => next.ring(point, (0.1 * Math.max(1 - left[i], 0)) / most, COLOURS.registered, 1.5));
  landmarks.forEach((point) => next.dot(point, COLOURS.moving, 3));
  next.square(best, COLOURS.target, 5);
}

export default {
  name: "howsure",
  label: "How sure the map is between landmarks",
  initial: INITIAL.howsure,
  controls: [
    { kind: "linear", name: "count", label: "landmarks", min: 2, max: 12, step: 1 },
    ...weights,
    { kind: "log", name: "scale", label: "s, by which all ellipses are multiplied", min: -3, max: 0, step: 0.1 },
  ],
  views: [
    {
      name: "sure",
      label: "90% ellipses of the map (blue); landmarks to drag (green)",
      points: given,
      drag: ({ places }, index, point) => ({
        places: places.map((place, k) => (k === index ? inDisk(...point).map((x) => Number(x.toFixed(4))) : place)),
      }),
    },
    { name: "next", label: "how much one landmark more would help, by its place; red square: most" },
  ],
  work,
  answer: (state, host) => ask(host, "howsure", state),
  draw,
  words({ count, scale }, { radii, left, ms }) {
    const [least_, most] = [Math.min(...radii), Math.max(...radii)],
      best = least(left);
    const place = SEEN[best].map((x) => x.toFixed(2).replace("-", "−")).join(", ");
    return (
      `90% of the posterior lies within ${three(mean(radii))} of the disk's radius on average over ${SEEN.length} places, ` +
      `from ${three(least_)} to ${three(most)}, by ${count} landmarks and at s = ${short(scale)}. ` +
      `One landmark more at (${place}) leaves ${three(left[best])} of that. ` +
      `Exact on a mesh of ${MESH[0]} rings and ${MESH[1]} spokes, at the map without distortion, in ${ms.toFixed(0)} ms.`
    );
  },
  data: (_, { covariances, radii, left }) => ({ covariances, radii, left }),
  compare(found, kernel) {
    const flat = (one) => one.covariances.flat(),
      [here, there] = [flat(found), flat(kernel)],
      most = Math.max(...there.map(Math.abs));
    const off = Math.max(...here.map((value, i) => Math.abs(value - there[i]))) / most;
    return (
      `The kernel's dense posterior has a mean radius of ${short(mean(kernel.radii))}, the page's ${short(mean(found.radii))}; ` +
      `of the largest variance the covariances differ by ${gap(off)}.`
    );
  },
  question: {
    text: "Multiply γ by a hundred: what share of the mean radius is left (0 to 1)? ",
    async truth(state, host) {
      const [now, then] = [await ask(host, "howsure", state), await ask(host, "howsure", { ...state, gamma: 100 * state.gamma })];
      return mean(then.radii) / mean(now.radii);
    },
    why: "γ says how exactly a landmark is met. Away from landmarks it has no say: there the prior is what is sure or not.",
  },
};
