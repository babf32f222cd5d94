// Maps of folds and curves between those of a grid of delta and eta that was computed beforehand (book/studies/fold_grid.py).
import { zeros } from "./complex.js";
import { readArrays } from "./files.js";
import { COARSE, GRID } from "./given.js";
import { Problem } from "./landmarks.js";
import { measure } from "./measures.js";
import { meshOf } from "./mesh.js";

let maps = null; // numbers by delta, eta, vertex, x and y

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
  maps ??= readArrays(await host.file("folds.bin")).tensors.maps;
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
      const first = 2 * mesh.V * (a * GRID.eta.length + b);
      for (let v = 0; v < mesh.V; v++) {
        w.x[v] += p * q * maps.data[first + 2 * v];
        w.y[v] += p * q * maps.data[first + 2 * v + 1];
      }
    }
  }
  const problem = new Problem(asked),
    places = asked.moving.map(([x, y]) => mesh.locate(x, y)),
    { mu, flipped, ...numbers } = measure(mesh, w, { problem, places, weights: asked });
  const exact = { w, ...numbers, folds: flipped.length };
  return { exact, network: { missing: "it knows no folds" }, asked, mesh: COARSE };
}
