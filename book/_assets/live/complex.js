// Complex arrays are {x, y}: two Float64Arrays of one length, real and imaginary parts.

export const zeros = (n) => ({ x: new Float64Array(n), y: new Float64Array(n) });

export const copy = (z) => ({ x: Float64Array.from(z.x), y: Float64Array.from(z.y) });

// from [[x, y], ...], as JSON has them
export const fromPairs = (pairs) => ({
  x: Float64Array.from(pairs, (p) => p[0]),
  y: Float64Array.from(pairs, (p) => p[1]),
});

export const toPairs = (z) => Array.from(z.x, (x, i) => [x, z.y[i]]);

// sum of squares of the distances, and the mean distance, of two arrays
export function squares(a, b) {
  let sum = 0;
  for (let i = 0; i < a.x.length; i++) sum += (a.x[i] - b.x[i]) ** 2 + (a.y[i] - b.y[i]) ** 2;
  return sum;
}

export function meanDistance(a, b) {
  let sum = 0;
  for (let i = 0; i < a.x.length; i++) sum += Math.hypot(a.x[i] - b.x[i], a.y[i] - b.y[i]);
  return sum / a.x.length;
}

const LARGEST = 1 - 1e-10; // of |mu|: tanh rounds to 1 from 19 on

// The paper's activation, mu = tanh(|nu|) nu / |nu|, as a factor of nu.
export function boundedFactor(x, y) {
  const size = Math.hypot(x, y);
  return size > 0 ? Math.min(Math.tanh(size), LARGEST) / size : 1;
}

export function bounded(nu) {
  const mu = zeros(nu.x.length);
  for (let i = 0; i < mu.x.length; i++) {
    const factor = boundedFactor(nu.x[i], nu.y[i]);
    mu.x[i] = factor * nu.x[i];
    mu.y[i] = factor * nu.y[i];
  }
  return mu;
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

export function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}
