// The free boundary: harmonic measure seen from a pole, and descents of two losses over the angles between neighbouring
// boundary points, from the right map whose pole goes to 0.
import { ask } from "./ask.js";
import { apart, fromPairs, interleaved, meanDistance, zeros } from "./complex.js";
import { angles, descend, LOSSES, objective, points } from "./descent.js";
import { COARSE, INITIAL } from "./given.js";
import { DiskMap, rimOf } from "./map.js";
import { meshOf, sample, TAU } from "./mesh.js";
import { mobius, moved } from "./mobius.js";
import { COLOURS } from "./picture.js";
import { chart, grid, powers } from "./plots.js";
import { gap, short, three } from "./words.js";

const SIZE = [COARSE[0], COARSE[1] + 1, 1]; // rings, spokes and grading; an odd number: no boundary point lies opposite to 1
const STEPS = 100;
const RHO = 1e-8; // the paper's weight of L_Boundary

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

// S = K_bb - K_bi K_ii^-1 K_ib, from boundary values to boundary rows, for the mu that `map` has solved for.
function schur(map) {
  const { mesh, off, diagonal } = map,
    { rim, free, spokes, tail, head } = mesh,
    { place } = mesh.interior,
    R = spokes + (spokes % 2);
  mesh.columns ??= mesh.kernels.numbers(free * R);
  const X = mesh.columns.fill(0);
  for (let i = 0; i < rim.length; i += 3) X[place[rim[i + 1]] * R + rim[i + 2]] = off[rim[i]];
  mesh.interior.solve(X, R);
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
  return { S, count: mesh.V };
}

// the map that sends the pole to 0 and 1 to 1, after the right one
function seenFrom(mesh, w, pole) {
  const { x, y } = sample(w, [mesh.locate(...pole)]),
    first = mobius(w.x[mesh.free], w.y[mesh.free], x[0], y[0]);
  return moved(w, [x[0], y[0], -Math.atan2(first[1], first[0])]);
}

const stepsOf = ({ x, y }) =>
  Float64Array.from(x, (u, k) => {
    const m = (k + 1) % x.length,
      turn = Math.atan2(u * y[m] - y[k] * x[m], u * x[m] + y[k] * y[m]);
    return turn < 0 ? turn + TAU : turn;
  });

let last = {}; // the descent that was asked for last

// the right map, its measure seen from the pole, and the descent that begins where the pole goes to 0
function descent(bench, { strength, pole, loss }) {
  const key = [strength, pole, loss].join();
  if (last.key === key) return last;
  const mesh = bench.mesh(...SIZE),
    map = (mesh.map ??= new DiskMap(mesh));
  map.solve(mesh.atCentres((x, y) => slidingMu(x, y, strength)));
  const right = map.normalised(),
    start = seenFrom(mesh, right, pole),
    system = schur(map),
    measure = stepsOf(rimOf(mesh, start)),
    judge = objective(system, loss === "right" ? "right" : "printed", loss === "penalised" ? RHO : 0),
    path = descend(judge, measure.map(Math.log), STEPS).map(({ x }) => points(angles(x)));
  const values = path.map((f) => ["printed", "right"].map((name) => LOSSES[name](system, f).value));
  return (last = { key, mesh, map, right, start, measure, path, values });
}

// the worker's side
function work(bench, state) {
  const begin = performance.now(),
    { mesh, map, right, start, measure, path, values } = descent(bench, state),
    f = path[Math.min(state.step, path.length - 1)],
    w = map.extended(f),
    centred = seenFrom(mesh, w, [0, 0]),
    one = zeros(mesh.V);
  one.x.fill(1);
  const found = { off: apart(centred, right), spread: meanDistance(w, one), folds: mesh.flipped(w).length };
  return { w, centred, right, start, measure, values, ...found, ms: performance.now() - begin };
}

// ---- what is to be seen ----

const FAIR = 0.2; // width of the band where harmonic measure is that of the arc length
const LOWEST = -4; // exponent of the share of a loss at the start below which it is not drawn
const COLLAPSED = 0.05; // mean distance from 1, as in the text
const NAMES = { printed: "the printed loss", penalised: "the printed loss with ρ L_Boundary", right: "energy minus area" };

const answer = (state, host) => ask(host, "boundary", state);
const turn = (k) => (2 * Math.PI * k) / SIZE[1];

// the band's inner edge at the middle of each boundary edge
const inner = (measure) =>
  Array.from(measure, (step, k) => {
    const r = Math.max(0.02, 1 - (FAIR * step) / turn(1));
    return [r * Math.cos(turn(k + 0.5)), r * Math.sin(turn(k + 0.5))];
  });

// harmonic measure of the half circle that is nearest to the pole
function nearHalf({ measure }, [x, y]) {
  const angle = Math.atan2(y, x);
  return measure.reduce((sum, step, k) => sum + (Math.cos(turn(k + 0.5) - angle) > 0 ? step : 0), 0) / (2 * Math.PI);
}

function drawLosses(picture, values, step) {
  const end = Math.max(10, values.length - 1),
    shares = [0, 1].map((i) => values.map((row, k) => [k, Math.log10(Math.max(10 ** LOWEST, row[i] / values[0][i]))])),
    top = Math.ceil(Math.max(0, ...shares.flat().map(([, log]) => log)) + 0.1),
    looks = [{ colour: COLOURS.target }, { colour: COLOURS.grid, dash: [5, 3] }];
  chart(picture, {
    x: [0, end],
    y: [LOWEST, top],
    ticks: {
      x: [0, Math.round(end / 2), end].map((k) => [k, String(k)]),
      y: powers(LOWEST, top),
    },
    name: "step",
    curves: shares.map((points, i) => ({ ...looks[i], points, dot: points[Math.min(step, values.length - 1)] })),
  });
}

function draw([seen, image, losses], state, { w, centred, measure, values }) {
  const mesh = meshOf(...SIZE),
    circle = Array.from({ length: SIZE[1] + 1 }, (_, k) => [Math.cos(turn(k)), Math.sin(turn(k))]),
    band = inner(measure);
  seen.clear();
  seen.face([...circle, ...band, band[0]].reverse(), COLOURS.registered);
  seen.face([...band], "white");
  seen.circle();
  seen.dot(state.pole, COLOURS.target, 5);
  seen.mark();
  const shown = state.centred ? centred : w;
  image.disk();
  grid(image, mesh, shown);
  for (let v = mesh.free; v < mesh.V; v++) image.dot([shown.x[v], shown.y[v]], COLOURS.registered, 2.5);
  image.dot([1, 0], COLOURS.ink, 3.5);
  drawLosses(losses, values, state.step);
}

export default {
  name: "boundary",
  label: "Harmonic measure and two losses",
  initial: INITIAL.boundary,
  controls: [
    { kind: "linear", name: "strength", label: "strength of μ (0: the disk as it is)", min: 0, max: 0.9, step: 0.05 },
    { kind: "choice", name: "loss", label: "loss that descends", options: Object.entries(NAMES) },
    { kind: "linear", name: "step", label: "steps of the descent", min: 0, max: STEPS, step: 1 },
    { kind: "switch", name: "centred", rare: true, label: "show the map with f(0) = 0 restored" },
  ],
  views: [
    {
      name: "measure",
      label: "the pole to drag (red); width of the band: harmonic measure",
      points: (state) => [state.pole],
      drag: (state, index, point) => ({ pole: point.map((c) => Number(c.toFixed(4))) }),
    },
    { name: "image", label: "grid and boundary points (orange) under the map at this step" },
    { name: "losses", label: "shares of the start that are left: printed (red), energy minus area (blue, dashed)" },
  ],
  answer,
  work,
  draw,
  words(state, found) {
    const { measure, values, off, spread, folds, w } = found,
      [x, y] = state.pole,
      fair = turn(1),
      step = Math.min(state.step, values.length - 1),
      ended = state.step > step ? `, where it ended` : "";
    const [least, most] = [Math.min(...measure), Math.max(...measure)].map((one) => three(one / fair)),
      near = three(100 * nearHalf(found, state.pole)),
      centre = short(Math.hypot(w.x[0], w.y[0])),
      [printed, energy] = [0, 1].map((k) => `${three(values[step][k])} (${three(values[0][k])} at the start)`);
    const said = [
      `Seen from ${short(x)} ${y < 0 ? "−" : "+"} ${short(Math.abs(y))} i the boundary steps are ` +
        `${least} to ${most} times the mean; ` +
        `the half circle nearest to the pole gets ${near} %`,
      `Step ${step} of a descent of ${NAMES[state.loss]}${ended}: printed loss ${printed}, energy minus area ${energy}`,
      spread < COLLAPSED
        ? `The disk has collapsed: on average ${short(spread)} from the point 1`
        : `With f(0) = 0 restored the map is up to ${short(off)} from the right one; as it is |f(0)| is ${centre}`,
    ];
    const mesh = `${SIZE[0]} rings and ${SIZE[1]} spokes`;
    return `${said.join(". ")}. ${folds} folds. On this mesh of ${mesh}, in ${found.ms.toFixed(0)} ms.`;
  },
  data(state, { w, centred, measure, values, off, spread, folds }) {
    const map = interleaved(state.centred ? centred : w);
    return { map, measure, off, spread, folds, losses: values[Math.min(state.step, values.length - 1)] };
  },
  compare({ right, start }, kernel) {
    const [there, begin] = [right, start].map((map, k) => gap(apart(map, fromPairs([kernel.right, kernel.start][k]))));
    return `The kernel's right map differs by ${there} at most, and that from which the descent starts by ${begin}.`;
  },
  question: {
    text:
      "Bring the pole half the way to the centre. Of 100 particles that diffuse from it, how many first meet the circle " +
      "on the half that is nearest to it? ",
    async truth(state, host) {
      const pole = state.pole.map((c) => c / 2);
      return 100 * nearHalf(await answer({ ...state, pole, step: 0 }, host), pole);
    },
    why: "For μ = 0 the density is the Poisson kernel (1 − |a|²) / |eⁱˢ − a|²; μ bends it.",
  },
};
