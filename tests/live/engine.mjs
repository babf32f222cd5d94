// Runs the book's browser modules under node: a task as JSON on standard input, its answer on standard output.
//   node engine.mjs <folder of the modules> <task>
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const folder = process.argv[2], task = process.argv[3];
const load = (name) => import(pathToFileURL(join(folder, name)));
const given = JSON.parse(readFileSync(0, "utf8"));
const { wasmKernels } = await load("kernels.js");
const { PolarMesh } = await load("mesh.js");
const { fromPairs, toPairs } = await load("complex.js");

const bytes = (path) => {
  const { buffer, byteOffset, byteLength } = readFileSync(path);
  return buffer.slice(byteOffset, byteOffset + byteLength);
};
const kernels = await wasmKernels(bytes(join(folder, "kernels.wasm")));
const mesh = ([rings, spokes, power]) => new PolarMesh(rings, spokes, power, kernels);

// a network from given.file
async function network(Network) {
  const { networkOf } = await load("unet.js"), files = { layers: bytes(join(folder, "layers.wasm")), network: bytes(given.file) };
  return networkOf({ files, networks: {}, mesh: (...size) => mesh(size) }, Network, "network");
}

const plain = (answer) => JSON.parse(JSON.stringify(answer, (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value)));

const tasks = {
  async maps() {
    const { DiskMap } = await load("map.js");
    return given.maps.map(({ size, mu }) => {
      const map = new DiskMap(mesh(size));
      map.solve(fromPairs(mu));
      return { f: toPairs(map.normalised()), raised: map.raised.reduce((a, b) => a + b, 0) };
    });
  },
  async fits() {
    const { fitLandmarks } = await load("fit.js"), { bounded, squares } = await load("complex.js"), meshes = { coarse: mesh(given.coarse), fine: mesh(given.fine) };
    const losses = ({ mesh, nu, points, problem: { q, count } }, { alpha, beta, gamma }) => {
      const { mass, laplace } = mesh.integrals, mu = bounded(nu);
      const [L_mu, L_grad_mu] = [mass, laplace].map((matrix) => mesh.quadratic(matrix, mu));
      return { L_CP: alpha * L_mu + beta * L_grad_mu + (gamma * squares(points, q)) / count };
    };
    return given.fits.map((request) => {
      const begin = performance.now(), fit = fitLandmarks(meshes, request, given.options);
      return {
        f: toPairs(fit.w), losses: losses(fit, request), objective: fit.objective(request.gamma), error: fit.landmarkError, switched: fit.switched,
        flipped: fit.mesh.flipped(fit.w), steps: [fit.coarseSteps, fit.steps], left: fit.left, ms: performance.now() - begin,
      };
    });
  },
  async measured() {
    const { Problem } = await load("landmarks.js"), { measure } = await load("measures.js"), fine = mesh(given.fine);
    const problem = new Problem(given.request), places = given.request.moving.map(([x, y]) => fine.locate(x, y));
    return given.maps.map((w) => {
      const { L_CP, flipped } = measure(fine, fromPairs(w), { problem, places, weights: given.request });
      return { L_CP, flipped };
    });
  },
  async cpnet() {
    const { CPNet } = await load("cpnet.js"), net = await network(CPNet);
    const found = [];
    for (const { moving, target, looks, ...weights } of given.problems)
      found.push(toPairs(await net.run(fromPairs(moving), fromPairs(target), weights, looks)));
    return found;
  },
  async stiff() {
    const { CPNet } = await load("cpnet.js"), net = await network(CPNet);
    return given.weights.map((weights) => net.isStiff(weights));
  },
  async surface() {
    const { Hemisphere } = await load("hemisphere.js"), { curveDistance, graphOf, lengthOf, shortestPath } = await load("paths.js");
    const hemisphere = new Hemisphere(bytes(given.file));
    const graph = graphOf(hemisphere), paths = given.paths.map(({ ends, curvature, depth }) =>
      shortestPath(graph, hemisphere.curvature.map((h, v) => Math.exp(curvature * h - depth * hemisphere.depth[v])), ...ends));
    return {
      lifted: given.points.map(([x, y]) => hemisphere.at(hemisphere.locate(x, y))),
      paths: paths.map(({ path, cost }) => ({ path, cost, length: lengthOf(hemisphere, path), deep: hemisphere.deep })),
      apart: curveDistance(hemisphere, paths[0].path, paths[1].path),
    };
  },
  // an explorable's answers to states, as its worker gives them and its data has them
  async answers() {
    const { default: spec } = await load(`explore_${given.page}.js`), { meshes } = await load("mesh.js");
    const bench = { mesh: meshes(kernels), kernels };
    return Promise.all(given.states.map(async (state) => plain(spec.data(state, await spec.work(bench, state)))));
  },
  // the tuner's map of a state, what it says of it and has to be copied; folder: has problems.json
  async copied() {
    const { asCommand, asPython } = await load("commands.js"), { carried } = await load("carried.js"), { solve } = await load("solvers.js");
    const { loadProblems, problems, requestOf } = await load("problems.js"), { meshes } = await load("mesh.js");
    const host = { file: async (name) => bytes(join(given.folder, name)) }, { state } = given;
    await loadProblems(host, state);
    const request = requestOf(state), { exact } = await solve({ mesh: meshes(kernels) }, request, "map");
    const { curves, fitted, held } = carried(state, request.mesh, exact.w);
    const texts = { command: asCommand(state), folds: asCommand(state, true), python: asPython(state) };
    return { ...texts, map: toPairs(exact.w), moving: request.moving, target: request.target, fitted, held, curves: curves.map(({ off }) => off) };
  },
  // the tuner's sentence on maps of these measures
  async said() {
    const { sentence } = await load("readouts.js");
    return given.maps.map((shown) => sentence({ shown, fitted: 1, held: null, problem: {}, surface: null }));
  },
  // maps between those of a grid of delta and eta, and how many of their triangles fold
  async folds() {
    const { withFolds } = await load("folds.js"), host = { file: async (name) => bytes(join(given.folder, name)) };
    return Promise.all(given.places.map(async (place) => {
      const { exact } = await withFolds(place, given.request, host);
      return { map: toPairs(exact.w), folds: exact.folds };
    }));
  },
  async refusals() {
    const { Problem, checkWeights } = await load("landmarks.js");
    return given.requests.map((request) => {
      try {
        checkWeights(request);
        new Problem(request);
        return null;
      } catch (error) {
        return error.message;
      }
    });
  },
};
process.stdout.write(JSON.stringify(await tasks[task]()));
