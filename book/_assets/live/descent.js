// Descent by L-BFGS: Newton's method with a Hessian that is learnt from the last few steps.
import { dot } from "./complex.js";

const MEMORY = 10,
  ENOUGH = 1e-4,
  HALVINGS = 30; // pairs kept, the share of the promised descent that is asked for, tries a step

// judge(x) -> {value, grad}; the path [{x, value, grad}, ...] of at most `most` steps, shorter where none goes down
export function descend(judge, x, most) {
  const path = [{ x, ...judge(x) }],
    pairs = [];
  while (path.length <= most) {
    const now = path[path.length - 1],
      way = direction(now.grad, pairs),
      next = along(judge, now, way);
    if (!next) break;
    const s = next.x.map((v, i) => v - now.x[i]),
      y = next.grad.map((v, i) => v - now.grad[i]),
      sy = dot(s, y);
    if (sy > 1e-12 * Math.sqrt(dot(s, s) * dot(y, y))) pairs.push({ s, y, sy });
    if (pairs.length > MEMORY) pairs.shift();
    path.push(next);
  }
  return path;
}

// minus the learnt inverse Hessian times the gradient
function direction(grad, pairs) {
  const q = grad.map((v) => -v),
    shares = [];
  for (let k = pairs.length - 1; k >= 0; k--) {
    const { s, y, sy } = pairs[k];
    shares[k] = dot(s, q) / sy;
    for (let i = 0; i < q.length; i++) q[i] -= shares[k] * y[i];
  }
  const last = pairs[pairs.length - 1],
    scale = last ? last.sy / dot(last.y, last.y) : 0.1 / Math.sqrt(dot(grad, grad) + 1e-300);
  for (let i = 0; i < q.length; i++) q[i] *= scale;
  pairs.forEach(({ s, y, sy }, k) => {
    const more = shares[k] - dot(y, q) / sy;
    for (let i = 0; i < q.length; i++) q[i] += more * s[i];
  });
  return q;
}

// the first of the steps 1, 1/2, 1/4, ... that goes down enough; null where none does
function along(judge, { x, value, grad }, way) {
  const slope = dot(grad, way);
  for (let k = 0, t = 1; k < HALVINGS; k++, t /= 2) {
    const there = x.map((v, i) => v + t * way[i]),
      found = judge(there);
    if (found.value < value + ENOUGH * t * slope) return { x: there, ...found };
  }
  return null;
}
