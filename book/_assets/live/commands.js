// What makes a picture's map outside the figure: a command line, and lines of Python.
import { COARSE, FINE, POWER } from "./given.js";
import { nameOf, problemOf } from "./problems.js";

// a word as shells and Python take it
const quoted = (word) => (/^[\w./:=+,-]+$/.test(word) ? word : `"${word.replace(/(["\\$`])/g, "\\$1")}"`);
const text = (word) => JSON.stringify(word);
const weightsOf = ({ alpha, beta, gamma }) => Object.entries({ alpha, beta, gamma });

// why no command or call of `register` makes the map, or "": surfaces have no landmarks where a reader has dragged them
function reason({ again }, { starts, targets, solver }) {
  if (!again) return "no files of its surfaces are known";
  if (Object.keys({ ...starts, ...targets }).length) return "a landmark was moved by hand, and lies on no vertex";
  return solver === "exact" ? "" : "the map shown is not the reference fit";
}

// folds: whether folds are fitted, too, at delta and eta; where the picture is of landmarks alone at the weights that
// the surfaces were registered with, or the defaults: those that are best by landmarks alone need not be best with folds
export function asCommand(state, folds = state.folds) {
  const problem = problemOf(state),
    why = reason(problem, state);
  if (why) return `No command makes this map: ${why}. "Copy as Python" gives its landmarks.`;
  const ofFolds = ["delta", "eta"].map((name) => [name, state[name]]),
    { before, register, features = [], withFolds = ofFolds } = problem.again,
    alone = folds && !state.folds,
    weights = alone ? withFolds : [...weightsOf(state), ...(folds ? ofFolds : [])],
    words = ["qclearn", "register", ...register, ...weights.flatMap(([name, value]) => [`--${name}`, String(value)])];
  words.push(...(folds ? features : ["--no-features"]));
  const sliding = state.landmarks === "sliding";
  if (sliding) words.push("--sliding");
  for (const label of state.held) words.push("--hold-out", nameOf(problem, label));
  // a folder of its own, so that no command replaces another's
  const flags = [...(folds ? ["folds"] : []), ...(sliding ? ["sliding"] : []), ...(state.held.length ? ["without"] : [])],
    out = ["tuned", ...weights.map(([, value]) => value), ...flags, ...state.held.map((label) => label + 1)].join("-");
  return [...before, [...words, "--out", out]].map((line) => line.map(quoted).join(" ")).join("\n");
}

export function asPython(state) {
  const problem = problemOf(state),
    weights = weightsOf(state).map(([name, value]) => `${name}=${value}`),
    sliding = state.landmarks === "sliding" ? ["sliding=True"] : [];
  if (reason(problem, state)) return onTheDisk(state, problem, [...weights, ...sliding]);
  const options = [state.folds ? `delta=${state.delta}, eta=${state.eta}` : "features=None", ...weights, ...sliding];
  if (state.held.length) options.push(`hold_out=[${state.held.map((label) => text(nameOf(problem, label))).join(", ")}]`);
  const call = ["result = qc.register(", "    moving, control, curves,", ...options.map((one) => `    ${one},`), ")"];
  return ["import qclearn as qc", ...problem.again.python, ...call].join("\n");
}

// the landmarks as they are, on the figure's mesh
function onTheDisk(state, { moving, target, curve }, options) {
  const kept = curve.flatMap((label, m) => (state.held.includes(label) ? [] : [m])),
    list = (points) => kept.map((m) => `    complex(${points[m].map((c) => Number(c.toFixed(7))).join(", ")}),`),
    [rings, spokes] = state.mesh === "finer" ? FINE : COARSE;
  return [
    ...["import numpy as np", "import qclearn as qc", ""],
    ...["moving = np.array([", ...list(moving), "])", "target = np.array([", ...list(target), "])"],
    `curve = np.array([${kept.map((m) => curve[m]).join(", ")}])`,
    `z, faces = qc.polar_disk(${rings}, ${spokes}, ${POWER})`,
    ...["fit = qc.fit_landmarks(", "    z, faces, moving, target,"],
    ...["curve=curve", `rings=${rings}`, ...options].map((one) => `    ${one},`),
    ")",
  ].join("\n");
}
