// Two losses of boundary points over the angles between neighbours, and their descent by L-BFGS: Newton's method with a
// Hessian that is learnt from the last few steps.
import { copy, dot, zeros } from "./complex.js";
import { TAU } from "./mesh.js";

const MEMORY = 10,
  ENOUGH = 1e-4,
  HALVINGS = 30; // pairs kept, the share of the promised descent that is asked for, tries a step

const LEAST = 1e-12; // angle

function times(S, f) {
  const out = zeros(S.length);
  for (let k = 0; k < S.length; k++) {
    const row = S[k];
    let u = 0,
      v = 0;
    for (let m = 0; m < row.length; m++) {
      u += row[m] * f.x[m];
      v += row[m] * f.y[m];
    }
    out.x[k] = u;
    out.y[k] = v;
  }
  return out;
}

// Losses of boundary points f: {value, slope}, the slope as complex numbers.
export const LOSSES = {
  // mean size of all rows; those inside are zero
  printed({ S, count }, f) {
    const row = times(S, f),
      signs = { x: row.x.map(Math.sign), y: row.y.map(Math.sign) },
      slope = times(S, signs);
    let sum = 0;
    for (let k = 0; k < S.length; k++) sum += Math.abs(row.x[k]) + Math.abs(row.y[k]);
    const share = (part) => part.map((v) => v / (2 * count));
    return { value: sum / (2 * count), slope: { x: share(slope.x), y: share(slope.y) } };
  },
  // energy minus area, 1/2 f* S f - 1/2 sum Im(conj(f_k) f_(k + 1)), whose slope is the residual R
  right({ S }, f) {
    const slope = times(S, f),
      n = S.length,
      row = copy(slope);
    let value = 0;
    for (let k = 0; k < n; k++) {
      const next = (k + 1) % n,
        last = (k + n - 1) % n;
      value += (f.x[k] * slope.x[k] + f.y[k] * slope.y[k] - f.x[k] * f.y[next] + f.y[k] * f.x[next]) / 2;
      row.x[k] -= (f.y[next] - f.y[last]) / 2;
      row.y[k] += (f.x[next] - f.x[last]) / 2;
    }
    return { value, slope: row };
  },
};

export const angles = (logits) => {
  const most = logits.reduce((a, b) => Math.max(a, b)),
    theta = logits.map((v) => Math.exp(v - most)),
    sum = theta.reduce((a, b) => a + b);
  return theta.map((t) => Math.max((TAU * t) / sum, LEAST));
};

export function points(theta) {
  const f = zeros(theta.length);
  theta.reduce((turn, step, k) => {
    f.x[k] = Math.cos(turn);
    f.y[k] = Math.sin(turn);
    return turn + step;
  }, 0);
  return f;
}

// the loss as a function of logits, with rho sum 1 / theta
export const objective = (system, loss, rho) => (logits) => {
  const theta = angles(logits),
    f = points(theta),
    { value, slope } = LOSSES[loss](system, f),
    grad = new Float64Array(theta.length);
  let later = 0,
    mean = 0;
  for (let k = theta.length - 1; k >= 0; k--) {
    grad[k] = later - rho / theta[k] ** 2; // an angle moves all later points
    later += slope.y[k] * f.x[k] - slope.x[k] * f.y[k];
    mean += (theta[k] * grad[k]) / TAU;
  }
  const penalty = rho * theta.reduce((sum, t) => sum + 1 / t, 0);
  return { value: value + penalty, grad: grad.map((g, k) => theta[k] * (g - mean)) };
};

// ---- descent ----

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
