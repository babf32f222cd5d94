// Complex arrays are {x, y}: two Float64Arrays of one length, real and imaginary parts.

export const zeros = (n) => ({ x: new Float64Array(n), y: new Float64Array(n) });

export const copy = (z) => ({ x: Float64Array.from(z.x), y: Float64Array.from(z.y) });

// from [[x, y], ...], as JSON has them
export const fromPairs = (pairs) => ({
  x: Float64Array.from(pairs, (p) => p[0]),
  y: Float64Array.from(pairs, (p) => p[1]),
});

// real and imaginary parts in turn, as Python reads complex numbers
export const interleaved = ({ x, y }) => new Float64Array(2 * x.length).map((_, i) => (i % 2 ? y : x)[i >> 1]);

// the sizes of an array, and the largest of numbers
export const sizes = ({ x, y }) => x.map((u, i) => Math.hypot(u, y[i]));
export const largest = (list) => list.reduce((a, b) => Math.max(a, b), 0);

export const toPairs = (z) => Array.from(z.x, (x, i) => [x, z.y[i]]);

// of two arrays: the sum of squares of the distances, their mean, and the largest
export const squares = (a, b) => a.x.reduce((sum, x, i) => sum + (x - b.x[i]) ** 2 + (a.y[i] - b.y[i]) ** 2, 0);
export const meanDistance = (a, b) =>
  a.x.reduce((sum, x, i) => sum + Math.hypot(x - b.x[i], a.y[i] - b.y[i]), 0) / a.x.length;
export const apart = (a, b) => largest(a.x.map((x, i) => Math.hypot(x - b.x[i], a.y[i] - b.y[i])));

const LARGEST = 1 - 1e-10; // of |mu|: tanh rounds to 1 from 19 on

// The paper's activation, mu = tanh(|nu|) nu / |nu|.
export function bounded(nu) {
  const mu = zeros(nu.x.length);
  for (let i = 0; i < mu.x.length; i++) {
    const size = Math.hypot(nu.x[i], nu.y[i]),
      factor = size > 0 ? Math.min(Math.tanh(size), LARGEST) / size : 1;
    mu.x[i] = factor * nu.x[i];
    mu.y[i] = factor * nu.y[i];
  }
  return mu;
}

// The pullback through mu = tanh(|nu|) nu / |nu|, grad nu = p grad mu + e conj(grad mu): [p, Re e, Im e].
export function activation(x, y) {
  const size = Math.hypot(x, y),
    t = Math.tanh(size),
    across = size > 0 ? t / size : 1,
    radial = 1 - t * t;
  const dx = size > 0 ? x / size : 0,
    dy = size > 0 ? y / size : 0,
    half = (radial - across) / 2;
  return [(radial + across) / 2, half * (dx * dx - dy * dy), half * 2 * dx * dy];
}

// ---- small dense systems, row by row in a Float64Array (n n) ----

// A = L L^T in the lower triangle, in place
export function choleskyDense(A, n) {
  for (let j = 0; j < n; j++) {
    for (let i = j; i < n; i++) {
      let sum = A[i * n + j];
      for (let k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
      A[i * n + j] = i === j ? Math.sqrt(sum) : sum / A[j * n + j];
    }
  }
  return A;
}

// x with L L^T x = b
export function solveDense(L, n, b) {
  const x = Float64Array.from(b);
  for (let i = 0; i < n; i++) {
    let sum = x[i];
    for (let k = 0; k < i; k++) sum -= L[i * n + k] * x[k];
    x[i] = sum / L[i * n + i];
  }
  for (let i = n - 1; i >= 0; i--) {
    let sum = x[i];
    for (let k = i + 1; k < n; k++) sum -= L[k * n + i] * x[k];
    x[i] = sum / L[i * n + i];
  }
  return x;
}

// a square matrix (n, n), in place
export function transpose(S, n) {
  for (let i = 0; i < n; i++) for (let j = 0; j < i; j++) [S[i * n + j], S[j * n + i]] = [S[j * n + i], S[i * n + j]];
  return S;
}

// P S P^T in place, for P given as `change` of a row in place
export function bothSides(S, n, change) {
  for (let turn = 0; turn < 2; turn++) {
    for (let i = 0; i < n; i++) change(S.subarray(i * n, i * n + n));
    transpose(S, n);
  }
  return S;
}

// y with (share G + 1) y = r
export function dualSolve(G, share, r) {
  const n = r.length,
    S = G.map((value, i) => share * value + (i % (n + 1) ? 0 : 1));
  return solveDense(choleskyDense(S, n), n, r);
}

export function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}
