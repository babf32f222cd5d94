// Maps of folds and curves between those of a grid of delta and eta that was computed beforehand (book/studies/fold_grid.py).
import { fromPairs, zeros } from "./complex.js";
import { COARSE, GRID } from "./given.js";
import { Problem } from "./landmarks.js";
import { measure } from "./measures.js";
import { meshOf } from "./mesh.js";

let maps = null; // a row for each delta, in it a map {x, y} for each eta

// what the state has where folds are fitted: weights and curves held out of the grid; undefined where there is none
export const foldsOf = (problems, { problem } = { problem: "cortex" }) => problems?.[problem]?.folds;

// the place of a value between the nodes of a grid, evenly in its logarithm: [node before, share of the next]
function between(nodes, value) {
  const at = Math.min(Math.max(Math.log(value / nodes[0]) / Math.log(nodes[1] / nodes[0]), 0), nodes.length - 1),
    k = Math.min(Math.floor(at), nodes.length - 2);
  return [k, at - k];
}

// The map at a state's delta and eta, linear between four of the grid, measured and certified as every map is.
export async function withFolds(state, asked, host) {
  maps ??= JSON.parse(new TextDecoder().decode(await host.file("folds.json"))).map((row) => row.map(fromPairs));
  const mesh = meshOf(...COARSE),
    [[i, s], [j, r]] = [between(GRID.delta, state.delta), between(GRID.eta, state.eta)],
    w = zeros(mesh.V);
  for (const [a, p] of [
    [i, 1 - s],
    [i + 1, s],
  ]) {
    for (const [b, q] of [
      [j, 1 - r],
      [j + 1, r],
    ]) {
      for (const c of ["x", "y"]) maps[a][b][c].forEach((value, v) => (w[c][v] += p * q * value));
    }
  }
  const problem = new Problem(asked),
    places = asked.moving.map(([x, y]) => mesh.locate(x, y)),
    { mu, flipped, ...numbers } = measure(mesh, w, { problem, places, weights: asked });
  const exact = { w, ...numbers, folds: flipped.length };
  return { exact, network: { missing: "it knows no folds" }, asked, mesh: COARSE };
}
