// The worker's side of all landmark problems: maps of one landmark problem by several solvers, measured alike, and the trade-off.
import { fitCoarse, fitLandmarks } from "./fit.js";
import { Problem } from "./landmarks.js";
import { onCircle, DiskMap } from "./map.js";
import { measure } from "./measures.js";
import { sample } from "./mesh.js";
import { bestMobius, moved } from "./mobius.js";
import { CPNet } from "./cpnet.js";
import { unfold } from "./repair.js";
import { networkOf } from "./unet.js";

const COARSE_SHARE = 2; // the coarse mesh has half as many rings
const SWEEP = [1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6]; // gamma / alpha of the trade-off curve

const pairOfMeshes = (bench, [rings, spokes]) => ({
  coarse: bench.mesh(rings / COARSE_SHARE, spokes / COARSE_SHARE),
  fine: bench.mesh(rings, spokes),
});

// request: moving, target, curve, sliding, alpha, beta, gamma, mesh [rings, spokes]; part: which map, or the trade-off
export async function solve(bench, request, part, stale) {
  const meshes = pairOfMeshes(bench, request.mesh);
  if (part === "sweep") return sweep(meshes, request, stale);
  if (part === "error") return fitLandmarks(meshes, request).landmarkError;
  if (part === "coarse") return { exact: exact(meshes, request, true) };
  if (part === "map" || part === "kept") return { exact: exact(meshes, request) };
  if (await stale()) return null;
  const network = await pass(bench, meshes.fine, request, stale);
  return network && { network };
}

function exact(meshes, request, quick = false) {
  const begin = performance.now(),
    fit = quick ? fitCoarse(meshes.coarse, request) : fitLandmarks(meshes, request),
    ms = performance.now() - begin;
  const { problem, places, w, switched, left, coarseSteps, steps } = fit;
  return {
    ...shown(fit.mesh, w, { problem, places, weights: request }),
    switched,
    left,
    steps: [coarseSteps, steps],
    ms,
  };
}

// CP-Net's coefficient, the exact map that has it on this mesh, and the best Möbius map after it; or why there is none;
// null as soon as it is out of date
async function pass(bench, mesh, request, stale) {
  if (!bench.files.cpnet) return { missing: "CP-Net has not been loaded" };
  if (request.sliding) return { missing: "CP-Net takes points to points, it knows no sliding; choose points" };
  const net = await networkOf(bench, CPNet, "cpnet"),
    problem = new Problem(request),
    begin = performance.now();
  if (problem.count > net.config.most)
    return { missing: `${problem.count} landmarks, and CP-Net takes at most ${net.config.most}` };
  if (net.isStiff(request))
    return { missing: `the network is not used where γ is ${net.config.stiff.toLocaleString("en")} times β or more` };
  const nu = await net.run(problem.p, problem.q, request, request.looks, mesh, stale);
  if (!nu) return null;
  const solution = (mesh.map ??= new DiskMap(mesh));
  if (!solution.solve(net.link(mesh).coefficient(nu))) return { missing: "CP-Net's coefficient has no map" };
  const places = Array.from(problem.p.x, (u, m) => mesh.locate(u, problem.p.y[m])),
    f = solution.normalised();
  const found = unfold(solution, onCircle(mesh, moved(f, bestMobius(sample(f, places), problem.q))));
  const ms = performance.now() - begin;
  return { ...shown(mesh, found.w, { problem, places, weights: request }), switched: found.switched, ms };
}

// what of a measured map goes to the page
function shown(mesh, w, of) {
  const { size, points, flipped, ...numbers } = measure(mesh, w, of);
  delete numbers.mu;
  return { w, size: Float32Array.from(size), points, folds: flipped.length, ...numbers };
}

// Landmark error against mean |mu| as gamma grows, at the present alpha and beta; null as soon as it is out of date.
async function sweep(meshes, request, stale) {
  const found = [];
  for (const ratio of SWEEP) {
    if (await stale()) return null;
    const gamma = ratio * request.alpha,
      fit = fitLandmarks(meshes, { ...request, gamma });
    const { mean } = measure(meshes.fine, fit.w, {});
    found.push({ gamma, w: fit.w, mean });
  }
  return found;
}
