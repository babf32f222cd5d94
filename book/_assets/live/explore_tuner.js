// The registration tuner: weights, landmarks and targets in the reader's hand, the fit at once.
import { ask, give } from "./ask.js";
import { apart, fromPairs, interleaved, toPairs } from "./complex.js";
import { INITIAL } from "./given.js";
import { meshOf } from "./mesh.js";
import { COLOURS, inDisk } from "./picture.js";
import { curvePicture, grid, heat } from "./plots.js";
import { CORTICES, kindOfLandmarks, loadProblems, moves, problemOf, requestOf, weights } from "./problems.js";
import { fromPicture, toPicture } from "./radius.js";
import { gap, short } from "./words.js";

const SOLVERS = { exact: "reference fit", network: "CP-Net", harmonic: "harmonic map" };
let network = null, // the promise of CP-Net's megabyte: it comes after the first answer, which need not wait for it
  absent = ""; // why it has not come

// The reference fit first, others after it, unless one of them is to be drawn.
async function answer(state, host) {
  await loadProblems(host);
  const partial = state.solver === "exact",
    asked = requestOf(state);
  if (state.solver === "network") await networkOf(host);
  const found = await ask(host, "tuner", asked, partial ? "map" : "all");
  return found && { ...found, asked, partial, problem: problemOf(state) };
}

// the other maps, and then the trade-off curve, as long as nothing newer is asked
async function* afterwards(state, found, host) {
  await networkOf(host);
  if (found.partial) {
    const others = await ask(host, "tuner", found.asked, "others");
    if (!others) return;
    yield (found = { ...found, ...others, partial: false });
  }
  const sweep = await ask(host, "tuner", found.asked, "sweep");
  if (sweep) yield { ...found, sweep };
}

const networkOf = (host) =>
  (network ??= give(host, { layers: "layers.wasm", cpnet: "cpnet.bin" }).catch((error) => {
    absent = error.message;
  }));

function sentence(name, one, faces) {
  if (!one) return `${name}: still computing`;
  if (one.missing) return `${name}: no map, ${absent || one.missing}`;
  const certificate = one.folds ? `not bijective: ${one.folds} of ${faces} triangles folded` : "certified bijective";
  const mended = one.switched ? `, ${one.switched} rows switched` : "";
  return (
    `${name}: landmark error ${short(one.landmarkError)}, mean |μ| ${short(one.mean)}, largest ${short(one.largest)}, ` +
    `L_CP ${short(one.L_CP)}; ${certificate}${mended}; ${one.ms.toFixed(0)} ms`
  );
}

const isThere = (one) => one && !one.missing;
const shownOf = (state, found) => (isThere(found[state.solver]) ? found[state.solver] : found.exact);

// points of one side of the problem that the reader moves, and what becomes of the state
const movable = (side, moved) => ({
  points: (state) => (problemOf(state)?.[side] ?? []).map(toPicture(problemOf(state)?.radius)),
  drag: (state, index, point) => ({
    [moved]: { ...state[moved], [index]: inDisk(...fromPicture(problemOf(state).radius)(point)) },
  }),
});

const views = [
  { name: "map", label: "orange: registered; red: targets, to drag", ...movable("target", "targets") },
  { name: "trade", label: "landmark error against mean |μ| as γ grows; the dot is here" },
  { name: "mu", label: "distortion |μ| on the moving disk; folds in magenta" },
  { name: "moving", label: "moving disk: landmarks to drag (green)", ...movable("moving", "starts") },
];

function draw([map, trade, mu, moving], state, found) {
  const shown = shownOf(state, found),
    { problem } = found,
    mesh = meshOf(...found.asked.mesh),
    to = toPicture(problem.radius);
  const curves = (points) =>
    [...new Set(problem.curve)].map((label) => points.filter((_, m) => problem.curve[m] === label));
  const start = problem.moving.map(to),
    target = problem.target.map(to);
  const registered = toPairs(shown.points).map(to);
  moving.disk();
  moving.lines(curves(start), COLOURS.moving, 1);
  start.forEach((point) => moving.dot(point, COLOURS.moving, 3));
  moving.mark();
  map.disk();
  grid(map, mesh, shown.w, { to, from: fromPicture(problem.radius) });
  map.lines(curves(target), COLOURS.target, 1.6, [4, 3]);
  target.forEach((point) => map.square(point, COLOURS.target, 3.5, 1.6));
  map.lines(curves(registered), COLOURS.registered, 1.6);
  registered.forEach((point) => map.dot(point, COLOURS.registered, 2.5));
  map.mark();
  heat(mu, mesh, shown.size, fromPicture(problem.radius));
  curvePicture(trade, found.sweep ?? [], found.exact);
}

// each term of the loss, and in brackets how many times the reference fit's it is
const rows = (found) => [
  ["", ...Object.values(SOLVERS)],
  ...["L_mu", "L_grad_mu", "L_Landmark", "L_CP"].map((term) => [
    term,
    ...Object.keys(SOLVERS).map((name) => {
      if (!isThere(found[name])) return "";
      const value = found[name][term];
      return name === "exact" ? short(value) : `${short(value)} (× ${Number((value / found.exact[term]).toPrecision(3))})`;
    }),
  ]),
];

export default {
  name: "tuner",
  label: "Tuning alpha, beta and gamma",
  initial: INITIAL.tuner,
  controls: [
    ...weights.toReversed(),
    {
      kind: "choice",
      name: "problem",
      label: "problem",
      also: moves,
      options: [
        ...CORTICES,
        ["twist", "a smooth twist"],
        ["anew", "points spaced anew along two curves"],
        ["neighbours", "two neighbours pulled apart"],
      ],
    },
    kindOfLandmarks,
    { kind: "log", name: "lambda", rare: true, label: "λ (lambda), springs of the harmonic map", min: -1, max: 5, step: 0.1 },
    { kind: "choice", name: "solver", rare: true, label: "map shown", options: Object.entries(SOLVERS) },
    {
      kind: "choice",
      name: "looks",
      rare: true,
      label: "refining steps of CP-Net",
      options: ["0", "1", "2"].map((count) => [count, count]),
    },
    {
      kind: "choice",
      name: "mesh",
      rare: true,
      label: "mesh",
      options: [
        ["coarser", "24 x 72"],
        ["finer", "finer: 32 x 96"],
      ],
    },
  ],
  views,
  answer,
  afterwards,
  draw,
  sentence(state, found) {
    const { points, mean, folds } = shownOf(state, found),
      { target, mm } = found.problem,
      away = toPairs(points).map(([x, y], m) => Math.hypot(x - target[m][0], y - target[m][1]) * (mm ? mm[m] : 100)),
      rounded = (x) => Number(x.toPrecision(2)),
      off = rounded(away.reduce((sum, one) => sum + one, 0) / away.length),
      where = mm ? `Sulci ${off} mm off` : `Landmarks ${off} % of the radius off`;
    return `${where}, distortion ${rounded(mean)}, ${folds || "no"} fold${folds === 1 ? "" : "s"}.`;
  },
  words(state, found) {
    const faces = meshOf(...found.asked.mesh).F,
      lost = found.failed && { missing: found.failed },
      sentences = Object.entries(SOLVERS).map(([key, name]) => sentence(name, found[key] ?? lost, faces));
    const others = Object.keys(SOLVERS).filter((key) => key !== "exact" && isThere(found[key]));
    const gaps = others.map(
      (key) => `L_CP of ${SOLVERS[key]} is ${short(found[key].L_CP / found.exact.L_CP)} times that of the reference fit`,
    );
    const where = `The mesh is ${found.asked.mesh.join(" x ")}`;
    return `${[...sentences, ...gaps, where].join(". ")}.`;
  },
  rows,
  data(state, found) {
    const { w, points, size, ...numbers } = shownOf(state, found);
    return { map: interleaved(w), landmarks: toPairs(points), ...numbers };
  },
  compare: (found, kernel) => {
    const off = gap(apart(found.exact.w, fromPairs(kernel.map)));
    const said = `The kernel's fit has L_CP ${short(kernel.L_CP)} and landmark error ${short(kernel.landmarkError)}`;
    return `${said}, in ${kernel.ms.toFixed(0)} ms; the largest difference of the two maps is ${off}.`;
  },
  question: {
    text: "Multiply γ by ten: what share of the present landmark error is left (0 to 1, or more)? ",
    async truth(state, host) {
      const now = await ask(host, "tuner", requestOf(state), "error");
      return (await ask(host, "tuner", { ...requestOf(state), gamma: 10 * state.gamma }, "error")) / now;
    },
    why: "Where the landmarks are nearly met, each factor of ten takes the error down by about as much, and |μ| hardly moves.",
  },
  onward: {
    page: "weights",
    name: "sulci",
    text: "See it on the surface",
    state({ problem, landmarks, alpha, beta, gamma, starts, targets }) {
      const known = CORTICES.some(([name]) => name === problem); // the others have no surface
      return known ? { problem, landmarks, alpha, beta, gamma, starts, targets } : null;
    },
  },
};
