// What is said of a map, whatever found it: its measured coefficient and the paper's losses (registration/metrics.py).
import { meanDistance, squares, zeros } from "./complex.js";
import { sample } from "./mesh.js";

// {mu, size |mu| (F), mean, largest, flipped, L_mu, L_grad_mu, L_Landmark, L_CP, landmarkError, points}
export function measure(mesh, w, { problem, places, weights }) {
  const mu = mesh.coefficient(w),
    { faces, area, F, V } = mesh,
    nodal = zeros(V),
    share = new Float64Array(V);
  const size = mu.x.map((x, t) => Math.hypot(x, mu.y[t]));
  let L_mu = 0;
  for (let t = 0; t < F; t++) {
    L_mu += (area[t] * size[t] ** 2) / Math.PI;
    for (let i = 3 * t; i < 3 * t + 3; i++) {
      nodal.x[faces[i]] += area[t] * mu.x[t];
      nodal.y[faces[i]] += area[t] * mu.y[t];
      share[faces[i]] += area[t];
    }
  }
  for (let v = 0; v < V; v++) {
    nodal.x[v] /= share[v];
    nodal.y[v] /= share[v];
  }
  const L_grad_mu = mesh.quadratic(mesh.integrals.laplace, nodal),
    found = {
      mu,
      size,
      mean: size.reduce((a, b) => a + b, 0) / F,
      largest: size.reduce((a, b) => Math.max(a, b), 0),
      flipped: mesh.flipped(w),
      L_mu,
      L_grad_mu,
    };
  if (!problem) return found;
  const points = sample(w, places),
    L_Landmark = squares(points, problem.q) / problem.count;
  const { alpha, beta, gamma } = weights;
  return {
    ...found,
    points,
    landmarkError: meanDistance(points, problem.q),
    L_Landmark,
    L_CP: alpha * L_mu + beta * L_grad_mu + gamma * L_Landmark,
  };
}
