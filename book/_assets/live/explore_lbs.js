// The Linear Beltrami Solver: pin points of the disk, take the coefficients right or as printed, and count the folds.
import { ask } from "./ask.js";
import { Cholesky, solveUnsymmetric } from "./cholesky.js";
import { apart, fromPairs, interleaved, largest, sizes, zeros } from "./complex.js";
import { COARSE, INITIAL } from "./given.js";
import { meshOf } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { grid, heat } from "./plots.js";
import { gap, short } from "./words.js";

const SIZE = [...COARSE, 1]; // rings, spokes and grading of the mesh, that of the page's text
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
function pinsOf(mesh, { count, pull, moves }) {
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
function solve(mesh, state) {
  const mu = mesh.atCentres((x, y) => ASKED[state.asked].mu(x, y, state.strength)),
    matrix = rows(mesh, mu, state),
    held = new Map();
  for (let v = mesh.free; v < mesh.V; v++) if (!state.e4) held.set(v, [mesh.z.x[v], mesh.z.y[v]]);
  if (state.e4) held.set(0, [0, 0]).set(mesh.free, [1, 0]);
  const pins = pinsOf(mesh, state);
  for (const { vertex, target } of pins) held.set(vertex, target);
  const most = largest(matrix.diagonal),
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

// the worker's side
function work(bench, state) {
  const mesh = bench.mesh(...SIZE);
  first ??= new Cholesky(mesh.V, mesh.tail, mesh.head, mesh.kernels);
  const begin = performance.now(),
    { w, mu, pins, negative } = solve(mesh, state),
    ms = performance.now() - begin;
  const size = Float32Array.from(sizes(mesh.coefficient(w))),
    folds = mesh.flipped(w),
    exact = zeros(mesh.V);
  for (let v = 1; v < mesh.V; v++) {
    [exact.x[v], exact.y[v]] = ASKED[state.asked].map(mesh.z.x[v], mesh.z.y[v], state.strength);
  }
  const found = { off: apart(w, exact), asked: largest(sizes(mu)), largest: largest(size) };
  return { w, size, folds, faces: mesh.F, pins, negative, edges: mesh.E, ms, ...found };
}

// ---- what is to be seen ----

const ERRATA = {
  e2: "E2: areas in the numerator of the gradients",
  e3: "E3: rows without the weight by area",
  e4: "E4: rows at the circle, too; held are 0 and 1",
  e5: "E5: the third vertex in place of the neighbour",
};

const answer = (state, host) => ask(host, "lbs", state);

// every pin asks for a share of what it asks
const eased = (state, share) => ({
  ...state,
  moves: Object.fromEntries(
    pinsOf(meshOf(...SIZE), state).map(({ start, target }, k) => [k, start.map((c, i) => c + share * (target[i] - c))]),
  ),
});

function draw([image, colours], state, { w, size, folds, pins }) {
  const mesh = meshOf(...SIZE),
    { faces } = mesh;
  image.disk();
  for (const t of folds) image.face([0, 1, 2].map((k) => [w.x[faces[3 * t + k]], w.y[faces[3 * t + k]]]), COLOURS.fold);
  grid(image, mesh, w);
  image.lines(pins.map(({ start, target }) => [start, target]), COLOURS.ink, 1.2, [3, 2]);
  for (const { start, target } of pins) {
    image.square(start, COLOURS.ink, 3, 1.2);
    image.dot(target, COLOURS.registered, 5);
  }
  image.mark();
  heat(colours, mesh, size);
}

export default {
  name: "lbs",
  label: "Pins in the Linear Beltrami Solver",
  initial: INITIAL.lbs,
  controls: [
    {
      kind: "choice",
      name: "asked",
      label: "μ asked for",
      options: [
        ["twist", "that of a twist, z exp(i s (1 − |z|²))"],
        ["stretch", "that of a stretch, z |z|ˢ"],
      ],
    },
    { kind: "linear", name: "strength", label: "s, strength of μ (0: harmonic)", min: 0, max: 2, step: 0.05 },
    { kind: "linear", name: "count", label: "number of pins inside", min: 0, max: 8, step: 1 },
    { kind: "linear", name: "pull", label: "how far pins are pulled aside", min: 0, max: 0.4, step: 0.01, also: { moves: {} } },
    ...Object.entries(ERRATA).map(([name, label]) => ({ kind: "switch", name, label })),
  ],
  views: [
    {
      name: "image",
      label: "deformed grid; pins to drag (orange), folded triangles (magenta)",
      points: (state) => pinsOf(meshOf(...SIZE), state).map(({ target }) => target),
      drag: (state, index, point) => ({ moves: { ...state.moves, [index]: point.map((c) => Number(c.toFixed(4))) } }),
    },
    { name: "size", label: "|μ| of the map, on the disk it comes from; folds in magenta" },
  ],
  answer,
  work,
  draw,
  words(state, { folds, faces, pins, negative, edges, off, asked, largest, ms }) {
    const printed = Object.keys(ERRATA).filter((name) => state[name]),
      how = printed.length ? `As printed in ${printed.map((name) => name.toUpperCase()).join(", ")}` : "Right coefficients",
      far = Math.max(0, ...pins.map(({ start, target }) => Math.hypot(target[0] - start[0], target[1] - start[1])));
    const said = [
      `${how}, ${pins.length} pins moved by up to ${short(far)}: ${folds.length} of ${faces} triangles folded`,
      asked ? `Asked for is a ${state.asked} with |μ| up to ${short(asked)}` : "Asked for is no distortion",
      `The map has |μ| up to ${short(largest)}`,
      `From ${asked ? `the ${state.asked}` : "the identity"} it is up to ${short(off)} away`,
      `${negative} of ${edges} edges have a negative weight`,
    ];
    return `${said.join(". ")}. Solved on a mesh of ${SIZE[0]} rings and ${SIZE[1]} spokes, in ${ms.toFixed(0)} ms.`;
  },
  data(state, { w, size, folds, pins, mu, ...numbers }) {
    return { map: interleaved(w), folds: folds.length, targets: pins.map(({ target }) => target), ...numbers };
  },
  compare({ w }, kernel) {
    const off = gap(apart(w, fromPairs(kernel.map)));
    const said = `The kernel's map, with right coefficients, has ${kernel.folds} folds`;
    return `${said}; the largest difference of the two maps is ${off}.`;
  },
  question: {
    text: "If each pin asked for half of what it asks now, how many triangles would be folded? ",
    truth: async (state, host) => (await answer(eased(state, 0.5), host)).folds.length,
    why:
      "A pin is a point force: its spike folds once the pull is longer than about an edge of the mesh. " +
      "On a finer mesh half the pull folds, too.",
  },
};
