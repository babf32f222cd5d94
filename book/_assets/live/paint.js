// The worker's side of painting mu: the exact map of a coefficient and of its Fourier compression.
import { meanDistance } from "./complex.js";
import { compressed, muOnFaces } from "./coefficients.js";
import { DiskMap } from "./map.js";

export const SIDE = 64; // pixels of the square that the compression works on

export async function answerMu(bench, state) {
  const mesh = bench.mesh(32, 96),
    map = (mesh.map ??= new DiskMap(mesh)),
    mu = muOnFaces(state, mesh);
  const whole = mapOf(map, mu);
  if (!whole) throw new Error("|mu| must stay below 1: no map that keeps its orientation has such a coefficient");
  const smooth = compressed(mesh, mu, state.frequencies, SIDE),
    kept = mapOf(map, smooth);
  return {
    kernels: bench.kernels.name,
    ...whole,
    compressed: kept && { ...kept, off: largestDistance(whole.w, kept.w) },
  };
}

// the map and what is said of it; null where there is none
function mapOf(map, mu) {
  const begin = performance.now(),
    size = mu.x.map((x, t) => Math.hypot(x, mu.y[t]));
  if (!map.solve(mu)) return null;
  const w = map.normalised(),
    ms = performance.now() - begin,
    { mesh } = map;
  const moved = meanDistance(w, mesh.z),
    largest = size.reduce((a, b) => Math.max(a, b), 0);
  const raised = map.raised.reduce((a, b) => a + b, 0);
  return { w, size: Float32Array.from(size), largest, folds: mesh.flipped(w).length, raised, moved, ms };
}

function largestDistance(a, b) {
  let most = 0;
  for (let v = 0; v < a.x.length; v++) most = Math.max(most, Math.hypot(a.x[v] - b.x[v], a.y[v] - b.y[v]));
  return most;
}
