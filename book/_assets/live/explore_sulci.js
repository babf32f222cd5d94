// The tuner's map carried to the control surface: registered sulci yellow, their targets red, moving with the sliders.
import { ask } from "./ask.js";
import { apart, fromPairs, interleaved, toPairs } from "./complex.js";
import { INITIAL } from "./given.js";
import { Hemisphere } from "./hemisphere.js";
import { meshOf, sample } from "./mesh.js";
import { bestMobius, moved } from "./mobius.js";
import { COLOURS } from "./picture.js";
import { CORTICES, kindOfLandmarks, loadProblems, moves, requestOf, weights } from "./problems.js";
import { Solid, turned } from "./solid.js";
import { distance } from "./triangles.js";
import { gap, short } from "./words.js";

const COLOUR = { registered: [0.94, 0.89, 0.26], target: [0.84, 0.15, 0.16], before: [0, 0.62, 0.45] };
const RADIUS = 0.9; // of a tube, mm
const [SURE, UNSURE] = [[1, 0.97, 0.8], [0.55, 0.05, 0.45]]; // where the map is surest and least sure
const surfaces = new Map(); // problem -> {control, names and courses of its sulci, radius: tenths of mm, V}
let last = { key: "" }; // the last map, which a turn of the surface does not change

async function load(host, problem) {
  if (surfaces.has(problem)) return;
  const decode = (buffer) => JSON.parse(new TextDecoder().decode(buffer)),
    curves = decode(await host.file("sulci.json"))[problem];
  const control = new Hemisphere(await host.file(curves.control));
  surfaces.set(problem, { ...curves, file: curves.control, control });
}

const SEEN = ["turn", "tilt", "zoom", "unfold", "before", "sure"]; // what changes the view, not the map

async function answer(state, host) {
  await loadProblems(host);
  const map = Object.fromEntries(Object.entries(state).filter(([name]) => !SEEN.includes(name))),
    key = JSON.stringify(map);
  if (last.key === key) return last.found;
  const asked = requestOf(state),
    asking = ask(host, "tuner", asked, "map"); // while the surface is made ready
  const [found] = await Promise.all([asking, load(host, state.problem)]);
  if (!found) return null;
  last = { key, found: { ...found, asked, ...carried(state, asked, found.exact) } };
  return last.found;
}

// the sulci before and after the map, in the disk; and in mm how far landmarks are from their targets on the surface
function carried(state, asked, { w }) {
  const { control, names, moving, target } = surfaces.get(state.problem),
    mesh = meshOf(...asked.mesh);
  const best = bestMobius(fromPairs(asked.moving), fromPairs(asked.target));
  const after = (points) => sample(w, points.map(([x, y]) => mesh.locate(x, y))),
    without = (points) => moved(fromPairs(points), best);
  const places = ({ x, y }) => Array.from(x, (u, k) => control.locate(u, y[k]));
  const end = places(fromPairs(asked.target)).map((place) => control.at(place));
  const off = (points) => places(points).map((place, m) => distance(control.at(place), end[m]));
  const errors = off(after(asked.moving)),
    bySulcus = names.map((_, k) => mean(errors.filter((_, m) => asked.curve[m] === k))),
    worst = bySulcus.indexOf(Math.max(...bySulcus));
  return {
    lines: {
      before: moving.map(without).map(places),
      target: target.map(fromPairs).map(places),
      registered: moving.map(after).map(places),
    },
    mm: mean(errors),
    mmBefore: mean(off(without(asked.moving))),
    bySulcus,
    worst: { name: names[worst], mm: bySulcus[worst] },
  };
}

const round = (x) => Number(x.toPrecision(3));
const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;

// tubes along places of the surface as it is unfolded so far, a little off it so that they are seen
function tubesOf(solid, control, lines, { unfold, before }) {
  const { normal, unfoldedNormal } = solid.normals,
    mixed = (place, from, to) => {
      const [a, b] = [control.at(place, from), control.at(place, to)];
      return a.map((c, k) => c + unfold * (b[k] - c));
    };
  const kinds = [...(before ? ["before"] : []), "target", "registered"];
  return kinds.flatMap((kind, k) =>
    lines[kind].map((line) => {
      const ways = line.map((place) => mixed(place, normal, unfoldedNormal)),
        centres = line.map((place) => mixed(place, control.vertices, control.unfolded));
      const points = centres.map((point, i) => point.map((c, n) => c + (0.6 + 0.25 * k) * RADIUS * ways[i][n]));
      return { points, ways, colour: COLOUR[kind], radius: RADIUS };
    }),
  );
}

// the radius' range in mm, a tenth of the vertices beyond either end
function rangeOf(radius) {
  const sorted = Float64Array.from(radius).sort();
  return [0.1, 0.9].map((share) => sorted[Math.floor(share * sorted.length)] / 10);
}

// red, green, blue of each vertex: its fold in grey, or its radius within its fold's shade
function coloursOf({ control, radius }, sure) {
  const grey = (v) => control.shade[v] / 255;
  if (!sure) return Float32Array.from(control.vertices, (_, i) => 0.45 + 0.5 * grey(Math.floor(i / 3)));
  const [low, high] = rangeOf(radius),
    share = (v) => Math.min(1, Math.max(0, (radius[v] / 10 - low) / (high - low)));
  return Float32Array.from(control.vertices, (_, i) => {
    const v = Math.floor(i / 3);
    return (0.75 + 0.25 * grey(v)) * (SURE[i % 3] + share(v) * (UNSURE[i % 3] - SURE[i % 3]));
  });
}

function draw([solid, disk], state, found) {
  const shown = surfaces.get(state.problem),
    { control } = shown,
    key = `${shown.file} ${state.sure && state.problem}`;
  if (solid.shown !== key) {
    solid.surface({ ...control, colour: coloursOf(shown, state.sure) });
    solid.shown = key;
  }
  solid.tubes(tubesOf(solid, control, found.lines, state));
  solid.draw({ ...state, share: state.unfold });
  const line = (places) => toPairs(sample(control, places)).map(control.toPicture);
  disk.disk();
  if (state.before) disk.lines(found.lines.before.map(line), COLOURS.moving, 1.5);
  disk.lines(found.lines.registered.map(line), COLOURS.registered, 3);
  disk.lines(found.lines.target.map(line), COLOURS.target, 1.5, [4, 3]);
}

const radiusWords = ({ radius }) => {
  const [low, high] = rangeOf(radius).map((mm) => mm.toFixed(1));
  return (
    `Colour: the 90 % radius of register's own map, from these curves at the default weights: ${low} mm (lightest) ` +
    `to ${high} mm (darkest). It does not follow the sliders.`
  );
};

export default {
  name: "sulci",
  label: "Registered sulci in 3-D",
  initial: INITIAL.sulci,
  controls: [
    { kind: "choice", name: "problem", label: "control surface", also: moves, options: CORTICES },
    kindOfLandmarks,
    ...weights,
    { kind: "linear", name: "turn", rare: true, label: "turn of the surface in degrees", min: -180, max: 180, step: 5 },
    { kind: "linear", name: "tilt", rare: true, label: "tilt of the surface in degrees", min: -90, max: 90, step: 5 },
    { kind: "linear", name: "zoom", rare: true, label: "zoom", min: 0.5, max: 4, step: 0.1 },
    { kind: "linear", name: "unfold", label: "unfolded, 0 to 1", min: 0, max: 1, step: 0.05 },
    { kind: "switch", name: "before", label: "where the best Möbius map alone takes the sulci (green)" },
    { kind: "switch", name: "sure", label: "coloured by how far register's map may be off: sure light, unsure dark" },
  ],
  views: [
    {
      name: "surface",
      label: "control surface to turn: registered sulci yellow, their targets red",
      picture: Solid,
      drag: turned,
    },
    { name: "disk", label: "the same in its disk: registered orange, targets red" },
  ],
  answer,
  draw,
  words(state, { exact, mm, mmBefore, worst, asked }) {
    const { F } = meshOf(...asked.mesh),
      certificate = exact.folds ? `not bijective: ${exact.folds} of ${F} triangles folded` : "certified bijective";
    return (
      `Registered landmarks are ${round(mm)} mm from their targets on the control surface, on average, straight through space; ` +
      `after the best Möbius map alone ${round(mmBefore)} mm. Worst is the ${worst.name} with ${round(worst.mm)} mm. ` +
      `Mean |μ| ${short(exact.mean)}, largest ${short(exact.largest)}, L_CP ${short(exact.L_CP)}; ${certificate}. ` +
      `Reference fit on this mesh of ${asked.mesh.join(" x ")}, ${exact.ms.toFixed(0)} ms.` +
      (state.sure ? ` ${radiusWords(surfaces.get(state.problem))}` : "")
    );
  },
  data(state, { exact, mm, mmBefore, bySulcus }) {
    const { L_CP, landmarkError, steps } = exact,
      { radius } = surfaces.get(state.problem);
    return { ...(state.sure && { radius }), map: interleaved(exact.w), mm, mmBefore, bySulcus, L_CP, landmarkError, steps };
  },
  compare: (found, kernel) => {
    const off = gap(apart(found.exact.w, fromPairs(kernel.map)));
    return (
      `The kernel's registered landmarks are ${short(kernel.mm)} mm from their targets, the page's ${short(found.mm)} mm; ` +
      `the largest difference of the two maps is ${off}.`
    );
  },
  question: {
    text: "With γ a hundred times what it is, how many mm are the registered landmarks from their targets, on average? ",
    async truth(state, host) {
      await load(host, state.problem);
      const stiff = { ...state, gamma: Math.min(1e7, 100 * state.gamma) },
        asked = requestOf(stiff);
      return carried(stiff, asked, (await ask(host, "tuner", asked, "truth")).exact).mm;
    },
    why: "γ multiplies the square of a distance: each factor of ten brings the points nearer, long after anatomy has no say.",
  },
  onward: {
    page: "live",
    name: "tuner",
    text: "Take this to the tuner",
    state: (state) => Object.fromEntries(Object.entries(state).filter(([name]) => !SEEN.includes(name))),
  },
};
