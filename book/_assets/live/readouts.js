// What the tuner says: a sentence, the shares of the loss, A's numbers beside B's, and what each solver found.
import { meshOf } from "./mesh.js";
import { off, short } from "./words.js";

export const SOLVERS = { exact: "reference fit", network: "CP-Net" };
const TERMS = { L_mu: ["L_μ", "alpha", "α"], L_grad_mu: ["L_∇μ", "beta", "β"], L_Landmark: ["L_Landmark", "gamma", "γ"] };
export const isThere = (one) => one && !one.missing;

const unit = ({ surface }) => (surface ? " mm" : " % of the radius");
const folding = ({ folds }) => `${folds || "no"} triangle${folds > 1 ? "s" : ""} flipped`;

// share of L_CP that the fit's next step still promises: 0.28 to 0.9 where it has not converged, elsewhere up to 0.11
const UNSETTLED = 0.2;

// louder as |mu| nears 1: there a circle becomes an ellipse (1 + |mu|) / (1 - |mu|) times as long as wide
export function sentence(side) {
  const { shown, fitted, held, problem, surface } = side,
    what = surface ? "sulci" : "curves",
    unsettled = shown.left > UNSETTLED,
    loud = unsettled || shown.folds || shown.largest > 0.98 ? 2 : Number(shown.largest > 0.9),
    stretched = `${Math.round((1 + shown.largest) / (1 - shown.largest))} times as long as wide`;
  const says = [
    `Fitted ${what} ${off(fitted)}${unit(side)} off${held === null ? "" : `, held out (blue) ${off(held)}${unit(side)}`}`,
    `mean |μ| ${shown.mean.toFixed(3)}, largest ${shown.largest.toFixed(shown.largest > 0.95 ? 4 : 2)}; ${folding(shown)}`,
  ];
  if (loud === 1) says.push(`somewhere a circle becomes an ellipse ${stretched}`);
  if (unsettled) says.push(`NOT CONVERGED, the next step promises ${Math.round(100 * shown.left)} % less loss: lower γ`);
  else if (loud === 2)
    says.push(shown.folds ? "NOT one-to-one" : `CLOSE TO A FOLD: somewhere a circle becomes an ellipse ${stretched}`);
  return { words: `${says.join("; ")}.${problem.note ? ` ${problem.note}` : ""}`, loud };
}

// the weighted terms as shares of their sum, a bar for each side
export function bars(sides) {
  return sides.map(({ name, exact, state: weights }) => {
    const terms = Object.entries(TERMS).map(([term, [label, weight, letter]]) => [letter, label, weights[weight] * exact[term]]),
      sum = terms.reduce((all, [, , value]) => all + value, 0),
      parts = terms.map(([letter, , value]) => [letter, (100 * value) / sum]),
      shares = terms.map(([letter, label], k) => `${letter} ${label} ${Math.round(parts[k][1])} %`);
    return { name, parts, words: `Of L_CP = ${short(exact.L_CP)}: ${shares.join(", ")}` };
  });
}

// A's numbers beside B's
export function beside(both) {
  if (both.length < 2) return null;
  const row = (head, of) => [head, ...both.map(of)],
    weight = (name) => row(name, ({ state }) => state[name].toLocaleString("en", { maximumSignificantDigits: 3 }));
  return [
    row("", ({ name }) => name),
    ...["alpha", "beta", "gamma", ...(both.some(({ state }) => state.folds) ? ["delta", "eta"] : [])].map(weight),
    row("fitted", (side) => off(side.fitted) + unit(side)),
    row("held out", (side) => (side.held === null ? "none" : off(side.held) + unit(side))),
    row("mean |μ|", ({ shown }) => shown.mean.toFixed(3)),
    row("largest |μ|", ({ shown }) => shown.largest.toFixed(3)),
    row("flipped", ({ shown }) => String(shown.folds)),
  ];
}

function numbers(name, one, faces) {
  if (!one) return `${name}: still computing`;
  if (one.missing) return `${name}: no map, ${one.missing}`;
  const certificate = one.folds ? `not bijective: ${one.folds} of ${faces} triangles folded` : "certified bijective";
  const mended = one.switched ? `, ${one.switched} rows switched` : "";
  return (
    `${name}: landmark error ${short(one.landmarkError)}, mean |μ| ${short(one.mean)}, largest ${short(one.largest)}, ` +
    `L_CP ${short(one.L_CP)}; ${certificate}${mended}; ${(one.ms ?? 0).toFixed(0)} ms`
  );
}

export function words(found, side) {
  const faces = meshOf(...found.mesh).F,
    lost = found.failed && { missing: found.failed },
    { fittedWas, heldWas } = side,
    all = Object.entries(SOLVERS).map(([key, name]) => numbers(name, found[key] ?? lost, faces));
  const gaps = Object.keys(SOLVERS)
    .filter((key) => key !== "exact" && isThere(found[key]))
    .map((key) => `L_CP of ${SOLVERS[key]} is ${short(found[key].L_CP / found.exact.L_CP)} times that of the reference fit`);
  const was =
    `After the best Möbius map alone: fitted ${off(fittedWas)}${unit(side)}` +
    (heldWas === null ? "" : `, held out ${off(heldWas)}${unit(side)}`);
  return `${[...all, ...gaps, was, `The mesh is ${found.mesh.join(" x ")}`].join(". ")}.`;
}

// each term of the loss, and in brackets how many times the reference fit's it is
export const rows = (found) => [
  ["", ...Object.values(SOLVERS)],
  ...[...Object.entries(TERMS), ["L_CP", ["L_CP"]]].map(([term, [label]]) => [
    label,
    ...Object.keys(SOLVERS).map((name) => {
      if (!isThere(found[name])) return "";
      const value = found[name][term];
      return name === "exact" ? short(value) : `${short(value)} (× ${Number((value / found.exact[term]).toPrecision(3))})`;
    }),
  ]),
];
