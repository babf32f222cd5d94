// What is said of a map, whatever found it: its measured coefficient and the paper's losses (registration/report.py).
import { largest, meanDistance, sizes, squares } from "./complex.js";
import { sample } from "./mesh.js";

// {mu, size |mu| (F), mean, largest, flipped, L_mu, L_grad_mu, L_Landmark, L_CP, landmarkError, points}
export function measure(mesh, w, { problem, places, weights }) {
  const mu = mesh.coefficient(w),
    size = sizes(mu);
  let L_mu = 0;
  for (let t = 0; t < mesh.F; t++) L_mu += (mesh.area[t] * size[t] ** 2) / Math.PI;
  const L_grad_mu = mesh.quadratic(mesh.integrals.laplace, mesh.onVertices(mu)),
    found = {
      mu,
      size,
      mean: size.reduce((a, b) => a + b, 0) / mesh.F,
      largest: largest(size),
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
