// The paper's baseline: the harmonic map with the circle held by the best Möbius map and the landmarks drawn to their
// targets by springs. It minimises 1/2 int |grad f|^2 + (lambda / 2) sum_k |f(p_k) - q_k|^2; no overlap correction.
import { choleskyDense, copy, solveDense, zeros } from "./complex.js";
import { onCircle, DiskMap, rimOf } from "./map.js";
import { sample } from "./mesh.js";
import { bestMobius, moved } from "./mobius.js";

export class Harmonic {
  // The springs' Green's functions are solved for once; then each lambda costs one system of the landmarks' size.
  constructor(mesh, problem) {
    Object.assign(this, { mesh, problem });
    this.places = Array.from(problem.p.x, (x, m) => mesh.locate(x, problem.p.y[m]));
    const solution = (mesh.map ??= new DiskMap(mesh));
    solution.solve(zeros(mesh.F)); // leaves K(0) factored
    this.start = solution.extended(rimOf(mesh, onCircle(mesh, moved(mesh.z, bestMobius(problem.p, problem.q)))));
    this.green = this.places.map(({ corners, weights }) => {
      const green = new Float64Array(mesh.V);
      corners.forEach((v, k) => {
        if (v < mesh.free) green[v] += weights[k];
      });
      green.set(mesh.interior.solved([green.subarray(0, mesh.free)])[0]);
      return green;
    });
  }

  // The map for one lambda: springs pull by s with (1 / lambda + E G) s = q - E f.
  map(lambda) {
    const { mesh, places, green } = this,
      { q, count: M } = this.problem,
      w = copy(this.start),
      now = sample(w, places);
    if (!(lambda > 0)) return w;
    const S = new Float64Array(M * M);
    green.forEach((g, j) => sample({ x: g, y: g }, places).x.forEach((value, i) => (S[i * M + j] = value)));
    for (let m = 0; m < M; m++) S[m * M + m] += 1 / lambda;
    choleskyDense(S, M);
    for (const part of ["x", "y"]) {
      const pull = solveDense(
        S,
        M,
        q[part].map((x, m) => x - now[part][m]),
      );
      green.forEach((g, m) => {
        for (let v = 0; v < mesh.free; v++) w[part][v] += pull[m] * g[v];
      });
    }
    return w;
  }
}
