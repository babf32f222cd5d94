// The landmark problems of the pages, as they are and as a reader has changed them.
import { COARSE, FINE } from "./given.js";

let problems = null; // name -> {label, moving, target, curve, radius}, once they have been loaded

export async function loadProblems(host) {
  problems ??= JSON.parse(new TextDecoder().decode(await host.file("problems.json")));
}

const changed = (points, moves) => points.map((point, m) => moves[m] ?? point);

// the problem with the landmarks and targets that were moved; null before they have been loaded
export function problemOf({ problem, starts, targets }) {
  const given = problems && (problems[problem] ?? Object.values(problems)[0]);
  return given && { ...given, moving: changed(given.moving, starts), target: changed(given.target, targets) };
}

// what the worker's tuner is asked
export function requestOf(state) {
  const { moving, target, curve } = problemOf(state),
    { alpha, beta, gamma, lambda = 0, looks = 0 } = state,
    sliding = state.landmarks === "sliding",
    mesh = state.mesh === "finer" ? FINE : COARSE;
  return { moving, target, curve, alpha, beta, gamma, lambda, looks: Number(looks), sliding, mesh };
}

// what sliders and pickers of all explorables with a landmark problem say
export const moves = { starts: {}, targets: {} }; // what was moved belongs to the problem it was moved in
export const weights = [
  { kind: "log", name: "alpha", label: "α (alpha), small |μ|", min: -2, max: 2, step: 0.1 },
  { kind: "log", name: "beta", label: "β (beta), even |μ|", min: -4, max: 1, step: 0.1 },
  { kind: "log", name: "gamma", label: "γ (gamma), matching", min: 0, max: 7, step: 0.1 },
];
export const kindOfLandmarks = {
  kind: "choice",
  name: "landmarks",
  rare: true,
  label: "landmarks",
  options: [
    ["points", "points"],
    ["sliding", "sliding along their curves"],
  ],
};
export const CORTICES = [
  ["cortex", "sulci of fsaverage5"],
  ["first", "a synthetic subject"],
  ["second", "another synthetic subject"],
];
