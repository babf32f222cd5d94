// The landmark problems of the pages, as they are and as a reader has changed them.
import { COARSE, FINE } from "./given.js";
import { Hemisphere } from "./hemisphere.js";

export let problems = null; // name -> {label, moving, target, curve, radius, names, lines, surface}, once they have been loaded
const surfaces = new Map(); // file -> promise of the control surface, and then that

// the problems, and the control surface of the one that is shown
export async function loadProblems(host, { problem }) {
  problems ??= JSON.parse(new TextDecoder().decode(await host.file("problems.json")));
  const { surface } = problems[problem];
  if (!surface) return;
  if (!surfaces.has(surface))
    surfaces.set(
      surface,
      host.file(surface).then((buffer) => new Hemisphere(buffer)),
    );
  surfaces.set(surface, await surfaces.get(surface));
}

const changed = (points, moves) => points.map((point, m) => moves[m] ?? point);

// the problem with the landmarks and targets that were moved; null before they have been loaded
export function problemOf({ problem, starts, targets }) {
  const given = problems?.[problem];
  return given && { ...given, moving: changed(given.moving, starts), target: changed(given.target, targets) };
}
export const surfaceOf = ({ problem }) => surfaces.get(problems[problem].surface) ?? null;

// the labels of curves, and their names
export const labelsOf = ({ curve }) => [...new Set(curve)];
export const nameOf = ({ names }, label) => names?.[label] ?? `curve ${label + 1}`;

// what the worker's tuner is asked: what is held out is not
export function requestOf(state) {
  const { moving, target, curve } = problemOf(state),
    { alpha, beta, gamma, looks = 0 } = state,
    fitted = (_, m) => !state.held.includes(curve[m]),
    sliding = state.landmarks === "sliding",
    mesh = state.mesh === "finer" ? FINE : COARSE;
  if (!curve.some(fitted)) throw new Error("all curves are held out; leave one to be fitted");
  const points = { moving: moving.filter(fitted), target: target.filter(fitted), curve: curve.filter(fitted) };
  return { ...points, alpha, beta, gamma, looks: Number(looks), sliding, mesh };
}

export const CORTICES = [
  ["cortex", "sulci of fsaverage5"],
  ["first", "a synthetic subject"],
  ["second", "another synthetic subject"],
];

// what the sliders of all explorables with a landmark problem say; marks: the defaults of register, and the paper's weights
const weight = (name, letter, what, min, max, usual, paper) => ({
  kind: "log",
  name,
  label: `${letter} (${name}), ${what}`,
  min,
  max,
  step: 0.1,
  marks: [
    [usual, "▲", "default"],
    [paper, "△", "the paper's"],
  ],
});
export const weights = [
  weight("alpha", "α", "small |μ|", -2, 2, 1, 1),
  weight("beta", "β", "even |μ|", -4, 1, 0.01, 1),
  weight("gamma", "γ", "matching", 0, 7, 1e3, 1e4),
];
