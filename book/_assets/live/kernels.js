// The inner loops of the solver, in WebAssembly (kernels.wasm, made from kernels.ts) or, where there is none, here.
// Both have the same five functions and hand out the arrays that these work on.

const PAGES = 1024; // 64 MB, enough for 128 landmarks on the finer mesh. It never grows: views into it would die.

export async function wasmKernels(bytes) {
  const memory = new WebAssembly.Memory({ initial: PAGES });
  const stop = () => {
    throw new Error("a kernel stopped");
  };
  const { instance } = await WebAssembly.instantiate(bytes, { env: { memory, abort: stop } });
  const wasm = instance.exports,
    at = (array) => array.byteOffset;
  let top = 65536;
  const take = (Type) => (n) => {
    const array = new Type(memory.buffer, top, n);
    top += (n * Type.BYTES_PER_ELEMENT + 15) & ~15;
    return array;
  };
  return {
    name: "WebAssembly",
    numbers: take(Float64Array),
    integers: take(Int32Array),
    factor: (c) =>
      wasm.factor(
        c.n,
        ...["start", "rows", "rowStart", "rowColumn", "rowPlace", "L", "A", "work"].map((k) => at(c[k])),
      ) === 1,
    forward: (c, X, R) => wasm.forward(c.n, at(c.start), at(c.rows), at(c.L), at(X), R),
    backward: (c, X, R) => wasm.backward(c.n, at(c.start), at(c.rows), at(c.L), at(X), R),
    gram: (count, J, R, G) => wasm.gram(count, at(J), R, at(G)),
    face: (M, shares, rows, place) => wasm.face(M, at(shares), ...rows.map((row, k) => at(row) + 8 * place[k])),
  };
}

export const plainKernels = {
  name: "JavaScript",
  numbers: (n) => new Float64Array(n),
  integers: (n) => new Int32Array(n),

  // L L^T = A column by column; false if a pivot is not positive. A and L share the pattern (start, rows).
  factor({ n, start, rows, rowStart, rowColumn, rowPlace, L, A, work }) {
    for (let j = 0; j < n; j++) {
      const first = start[j],
        end = start[j + 1];
      for (let p = first; p < end; p++) work[rows[p]] = A[p];
      for (let q = rowStart[j]; q < rowStart[j + 1]; q++) {
        const from = rowPlace[q],
          l = L[from],
          stop = start[rowColumn[q] + 1];
        for (let p = from; p < stop; p++) work[rows[p]] -= L[p] * l;
      }
      if (!(work[j] > 0)) return false;
      const root = Math.sqrt(work[j]),
        inverse = 1 / root;
      L[first] = root;
      for (let p = first + 1; p < end; p++) L[p] = work[rows[p]] * inverse;
    }
    return true;
  },

  // X (n, R) in the order of elimination becomes L^-1 X
  forward({ n, start, rows, L }, X, R) {
    for (let j = 0; j < n; j++) {
      const from = j * R,
        inverse = 1 / L[start[j]];
      for (let c = 0; c < R; c++) X[from + c] *= inverse;
      for (let p = start[j] + 1; p < start[j + 1]; p++) {
        const l = L[p],
          to = rows[p] * R;
        for (let c = 0; c < R; c++) X[to + c] -= l * X[from + c];
      }
    }
  },

  // and L^-T X
  backward({ n, start, rows, L }, X, R) {
    for (let j = n - 1; j >= 0; j--) {
      const to = j * R,
        inverse = 1 / L[start[j]];
      for (let p = start[j] + 1; p < start[j + 1]; p++) {
        const l = L[p],
          from = rows[p] * R;
        for (let c = 0; c < R; c++) X[to + c] -= l * X[from + c];
      }
      for (let c = 0; c < R; c++) X[to + c] *= inverse;
    }
  },

  // the lower triangle of G (R, R) becomes J^T J, J (count, R)
  gram(count, J, R, G) {
    G.fill(0, 0, R * R);
    for (let i = 0; i < count; i++) {
      const at = i * R;
      for (let c = 0; c < R; c++) {
        const x = J[at + c],
          row = c * R;
        for (let d = 0; d <= c; d++) G[row + d] += x * J[at + d];
      }
    }
  },

  // One face's share of the landmarks' gradients, added to those of its corners. See gradients.js: rows are, for
  // the three corners each, adjoints g of f, adjoints l of U (both 2M) and gradients J (4M); shares has 18 numbers.
  face(M, shares, [g0, g1, g2, l0, l1, l2, J], [a0, a1, a2, b0, b1, b2, j0, j1, j2]) {
    for (let half = 0; half < 2; half++) {
      const A0 = shares[half],
        A1 = shares[half + 2],
        A2 = shares[half + 4];
      const B0 = shares[half + 6],
        B1 = shares[half + 8],
        B2 = shares[half + 10];
      const U0 = shares[half + 12],
        U1 = shares[half + 14],
        U2 = shares[half + 16];
      for (let m = 0; m < M; m++) {
        const x0 = g0[a0 + m],
          x1 = g1[a1 + m],
          x2 = g2[a2 + m];
        const y0 = g0[a0 + M + m],
          y1 = g1[a1 + M + m],
          y2 = g2[a2 + M + m];
        const re =
          A0 * x0 +
          A1 * x1 +
          A2 * x2 -
          B0 * y0 -
          B1 * y1 -
          B2 * y2 +
          U0 * l0[b0 + m] +
          U1 * l1[b1 + m] +
          U2 * l2[b2 + m];
        const im =
          B0 * x0 +
          B1 * x1 +
          B2 * x2 +
          A0 * y0 +
          A1 * y1 +
          A2 * y2 +
          U0 * l0[b0 + M + m] +
          U1 * l1[b1 + M + m] +
          U2 * l2[b2 + M + m];
        const to = 2 * half * M + m;
        for (const j of [j0, j1, j2]) {
          J[j + to] += re;
          J[j + M + to] += im;
        }
      }
    }
  },
};
