// The worker's side of painting mu: the exact map of a coefficient and of its Fourier compression.
import { meanDistance } from "./complex.js";
import { compressed, muOnFaces } from "./coefficients.js";
import { DBSNet } from "./dbsnet.js";
import { plainLayers, wasmLayers } from "./layers.js";
import { DiskMap } from "./map.js";
import { readNetwork } from "./unet.js";

export const SIDE = 64; // pixels of the square that the compression works on

export async function answerMu(bench, state) {
  const mesh = bench.mesh(32, 96),
    map = (mesh.map ??= new DiskMap(mesh)),
    mu = muOnFaces(state, mesh);
  const whole = mapOf(map, mu);
  if (!whole) throw new Error("|mu| must stay below 1: no map that keeps its orientation has such a coefficient");
  const smooth = compressed(mesh, mu, state.frequencies, SIDE),
    kept = mapOf(map, smooth);
  const network = state.dbsnet ? await pass(bench, state) : null;
  return {
    kernels: bench.kernels.name,
    network,
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

let net = null; // DBS-Net, made when it is first asked for

// DBS-Net's map of the same mu on its own mesh, and the exact one there: the largest distance, and both times
async function pass(bench, state) {
  if (!net) {
    const layers = await wasmLayers(bench.files.layers).catch(() => plainLayers),
      file = readNetwork(bench.files.dbsnet);
    net = new DBSNet(bench.mesh(file.config.rings, file.config.spokes, file.config.power), layers, file);
  }
  const { mesh } = net,
    mu = muOnFaces(state, mesh),
    exact = mapOf((mesh.map ??= new DiskMap(mesh)), mu),
    begin = performance.now();
  const w = net.run(mu),
    ms = performance.now() - begin;
  return {
    mesh: [mesh.rings, mesh.spokes],
    off: largestDistance(w, exact.w),
    folds: mesh.flipped(w).length,
    ms,
    exact: exact.ms,
  };
}
