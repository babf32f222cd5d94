// The registration tuner: weights, landmarks and targets in the reader's hand, the fit at once, on the brain and in the disk.
import { ask, give } from "./ask.js";
import { carried } from "./carried.js";
import { asCommand, asPython } from "./commands.js";
import { apart, fromPairs, interleaved, toPairs } from "./complex.js";
import { toggled } from "./controls.js";
import { foldsOf, withFolds } from "./folds.js";
import { GRID, INITIAL } from "./given.js";
import { inDisk } from "./picture.js";
import { drawChart, drawMaps, drawMoving } from "./panels.js";
import { labelsOf, loadProblems, nameOf, problemOf, problems, requestOf, surfaceOf, weights } from "./problems.js";
import { fromPicture, toPicture } from "./radius.js";
import { bars, beside, isThere, rows, sentence, SOLVERS, words } from "./readouts.js";
import { Solid, turned } from "./solid.js";
import { gap, off, short } from "./words.js";

const SEEN = ["turn", "tilt", "zoom", "unfold", "before", "shade", "kept", "wipe"]; // what changes the view, not the map
const MOST = 40; // maps that are kept, so that undo, a turn or A asks for none again
const known = new Map(), // of a map's part of the state -> what was found
  sweeps = new Map(), // of that without gamma -> the trade-off
  measured = new WeakMap(); // map -> what `carried` says of it
const STOPPED = " The fit with the larger L_CP stopped before its least.";
let network = null, // the promise of CP-Net's megabyte: it comes after the first answer, which need not wait for it
  absent = "", // why it has not come
  drawn = []; // what the maps' pictures show: later answers have the same maps

const ofMap = (state) => Object.fromEntries(Object.entries(state).filter(([name]) => !SEEN.includes(name)));
const keyOf = (state) => JSON.stringify(ofMap(state));
const sweepKey = ({ gamma, solver, looks, ...state }) => keyOf(state);

function remember(state, found) {
  known.set(keyOf(state), found);
  if (known.size > MOST) known.delete(known.keys().next().value);
  return found;
}

// The fit on the coarse mesh first, which is there at once; then the fit; then the other maps, the kept one, the trade-off.
async function answer(state, host) {
  await loadProblems(host, state);
  const there = known.get(keyOf(state));
  if (there) return there;
  const asked = requestOf(state);
  if (state.folds) return remember(state, await withFolds(state, asked, host));
  const found = await ask(host, "tuner", asked, "coarse"),
    mesh = asked.mesh.map((count) => count / 2);
  return found && remember(state, { ...found, asked, mesh, coarse: true, partial: true });
}

async function* afterwards(state, found, host) {
  const { asked } = found;
  if (found.coarse) {
    const fine = await ask(host, "tuner", asked, "map");
    if (!fine) return;
    yield (found = remember(state, { ...fine, asked, mesh: asked.mesh, partial: true }));
  }
  if (found.partial) {
    await networkOf(host);
    const others = await ask(host, "tuner", asked, "others");
    if (!others) return;
    if (absent && !isThere(others.network)) others.network = { missing: absent };
    yield (found = remember(state, { ...found, ...others, partial: false }));
  }
  if (state.kept && !known.has(keyOf(keptOf(state)))) {
    const kept = keptOf(state),
      asked = requestOf(kept),
      fit = await ask(host, "tuner", asked, "kept");
    if (fit) remember(kept, { ...fit, asked, mesh: asked.mesh });
    yield found;
  }
  if (state.folds || sweeps.has(sweepKey(state))) return;
  const sweep = await ask(host, "tuner", asked, "sweep");
  if (!sweep) return;
  sweeps.set(
    sweepKey(state),
    sweep.map(({ w, ...one }) => ({ ...one, ...carried(state, asked.mesh, w) })),
  );
  yield found;
}

const networkOf = (host) =>
  (network ??= give(host, { layers: "layers.wasm", cpnet: "cpnet.bin" }).catch((error) => {
    absent = error.message;
  }));

// A's state, seen as the present one is
const keptOf = (state) => ({ ...state, ...state.kept });

const shownOf = (state, found) => (isThere(found[state.solver]) ? found[state.solver] : found.exact);

// a side of the comparison, A or B: all that pictures and words need of a state and what was found for it
function side(name, state, found) {
  const shown = shownOf(state, found);
  if (!measured.has(shown)) measured.set(shown, carried(state, found.mesh, shown.w));
  const own = { surface: surfaceOf(state), problem: problemOf(state), ...measured.get(shown) };
  return { name, state, mesh: found.mesh, asked: found.asked, shown, exact: found.exact, coarse: found.coarse, ...own };
}

function sidesOf(state, found) {
  const there = state.kept && known.get(keyOf(keptOf(state)));
  return [...(there ? [side("A", keptOf(state), there)] : []), side(there ? "B" : "", state, found)];
}

// points of one side of the problem that the reader moves, and what becomes of the state
const movable = (which, moved) => ({
  points: (state) => (problemOf(state)?.[which] ?? []).map(toPicture(problemOf(state)?.radius)),
  drag: (state, index, point) => ({
    [moved]: { ...state[moved], [index]: inDisk(...fromPicture(problemOf(state).radius)(point)) },
  }),
});
const click = (state, label) => ({ held: toggled(state.held, label), folds: false });

const views = [
  {
    name: "surface",
    label: "registered sulci: orange, held out: blue, targets: red",
    picture: Solid,
    drag: turned,
    click,
  },
  {
    name: "map",
    label: "the disk: click a sulcus to hold it out",
    ...movable("target", "targets"),
    click,
  },
  { name: "trade", label: "error (log) against mean |μ| as γ grows: fitted orange, held out blue; grey: your moves" },
  { name: "moving", label: "moving disk: landmarks to drag (green)", ...movable("moving", "starts") },
];

function draw([surface, disk, trade, moving], state, found) {
  const sides = sidesOf(state, found),
    now = [JSON.stringify([state, disk.chosen]), ...sides.map(({ shown }) => shown)];
  if (now.length !== drawn.length || now.some((one, k) => one !== drawn[k])) drawMaps(surface, disk, state, sides);
  drawn = now;
  disk.canvas.classList.add("qc-live-heat"); // its colours are those of the surface, in the dark, too
  drawChart(trade, sides.at(-1), sweeps.get(sweepKey(state)) ?? []);
  drawMoving(moving, sides.at(-1));
}

// ---- controls ----

// the curves as buttons, each with what it is off
function curveNames(state) {
  if (!problemOf(state)) return [];
  const found = known.get(keyOf(state)),
    curves = found && side("", state, found).curves;
  return labelsOf(problemOf(state)).map((label, k) => [
    label,
    nameOf(problemOf(state), label) + (curves ? ` ${off(curves[k].off)}${surfaceOf(state) ? "" : " %"}` : ""),
  ]);
}

const folded = (state) => Boolean(state.folds);
const fresh = { starts: {}, targets: {}, held: [], kept: null, folds: false }; // what belongs to the problem it was done in
const ofFolds = (name, label) => {
  const [low, high] = [GRID[name][0], GRID[name].at(-1)].map(Math.log10),
    marks = [[INITIAL.tuner[name], "▲", "default"]];
  return { kind: "log", name, label, min: low, max: high, step: 0.01, marks, when: folded };
};
const choice = (name, label, options) => ({ kind: "choice", name, label, options: Object.entries(options) });
const linear = (name, label, min, max, step) => ({ kind: "linear", name, label, min, max, step });
const fitsFolds = {
  kind: "switch",
  name: "folds",
  label: "fit folds, too (at the default α, β, γ)",
  also: (on) => (on ? foldsOf(problems) : {}),
};
const problemChoice = { kind: "choice", name: "problem", label: "problem", also: fresh };
const holds = { kind: "names", name: "held", label: "How far each is off; press to hold out (blue): ", also: { folds: false } };
const rare = [
  { kind: "switch", name: "before", label: "where the best Möbius map alone takes the sulci (green)" },
  linear("unfold", "unfolded, 0 to 1", 0, 1, 0.05),
  linear("turn", "turn of the surface in degrees", -180, 180, 5),
  linear("tilt", "tilt of the surface in degrees", -90, 90, 5),
  linear("zoom", "zoom", 0.5, 4, 0.1),
  choice("landmarks", "landmarks", { points: "points", sliding: "sliding along their curves" }),
  choice("solver", "map shown", SOLVERS),
  choice("looks", "refining steps of CP-Net", { 0: "0", 1: "1", 2: "2" }),
  choice("mesh", "mesh", { coarser: "24 x 72", finer: "finer: 32 x 96" }),
];
const controls = [
  ...weights.toReversed().map((one) => ({ ...one, when: (state) => !state.folds })),
  ofFolds("delta", "δ (delta), folds"),
  ofFolds("eta", "η (eta), areas"),
  { ...fitsFolds, when: (state) => foldsOf(problems, state) },
  { ...linear("wipe", "wipe: A left, B right", 0, 1, 0.01), when: (state) => state.kept },
  { ...holds, options: curveNames },
  choice("shade", "colour", { mu: "|μ|", areas: "change of areas", none: "neither" }),
  {
    ...problemChoice,
    options: () => Object.entries(problems ?? {}).map(([name, { label }]) => [name, label]),
    when: () => Object.keys(problems ?? {}).length !== 1,
  },
  ...rare.map((one) => ({ ...one, rare: true })),
];

export default {
  name: "tuner",
  label: "Tuning alpha, beta and gamma",
  initial: INITIAL.tuner,
  controls,
  views,
  answer,
  afterwards,
  draw,
  sentence(state, found) {
    const { words, loud } = sentence(sidesOf(state, found).at(-1));
    return { words: found.coarse ? `Still fitting. ${words}` : words, loud };
  },
  bars: (state, found) => (folded(state) ? [] : bars(sidesOf(state, found))), // a fit of folds has other terms, too
  sides: (state, found) => beside(sidesOf(state, found)),
  words: (state, found) => words(found, sidesOf(state, found).at(-1)),
  rows,
  acts: {
    "Keep as A": (state) => ({ kept: ofMap(state) }),
    "Copy as command": (state) => asCommand(state),
    "Copy as Python": (state) => asPython(state),
    "Command with folds": (state) => asCommand(state, true),
  },
  data(state, found) {
    const { shown, fitted, held, curves } = sidesOf(state, found).at(-1),
      { w, points, size, ...numbers } = shown;
    const byCurve = Object.fromEntries(curves.map(({ name, off }) => [name, off]));
    return { map: interleaved(w), landmarks: toPairs(points), fitted, held, byCurve, mesh: found.mesh, ...numbers };
  },
  compare: (found, kernel) => {
    const far = gap(apart(found.exact.w, fromPairs(kernel.map))),
      times = Math.max(kernel.L_CP / found.exact.L_CP, found.exact.L_CP / kernel.L_CP);
    const said = `The kernel's fit has L_CP ${short(kernel.L_CP)} and landmark error ${short(kernel.landmarkError)}`;
    return `${said}, in ${kernel.ms.toFixed(0)} ms; the largest difference of the two maps is ${far}.${times > 2 ? STOPPED : ""}`;
  },
  question: {
    text: "Landmarks alone: multiply γ by ten. What share of the present landmark error is left (0 to 1, or more)? ",
    async truth(state, host) {
      const now = await ask(host, "tuner", requestOf(state), "error");
      return (await ask(host, "tuner", { ...requestOf(state), gamma: 10 * state.gamma }, "error")) / now;
    },
    why: "Where the landmarks are nearly met, each factor of ten takes the error down by about as much, and |μ| hardly moves.",
  },
};
