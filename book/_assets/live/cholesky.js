// A sparse Cholesky factorisation for many matrices of one pattern, that of the edges of a mesh. The order of
// elimination and the places of all entries are found once; then a factorisation is arithmetic alone.
export class Cholesky {
  // n unknowns; edge e joins tail[e] and head[e], -1 for what is no unknown. Matrix values come with `factor`.
  constructor(n, tail, head, kernels) {
    Object.assign(this, { n, tail, head, kernels });
    const { order, below } = minimumDegree(n, tail, head);
    const place = (this.place = new Int32Array(n)); // of an unknown in the order of elimination
    order.forEach((v, j) => {
      place[v] = j;
    });
    const start = new Int32Array(n + 1);
    for (let j = 0; j < n; j++) start[j + 1] = start[j] + below[j].length + 1;
    const rows = new Int32Array(start[n]);
    for (let j = 0; j < n; j++) {
      rows[start[j]] = j;
      rows.set(
        below[j].map((v) => place[v]).sort((a, b) => a - b),
        start[j] + 1,
      );
    }
    this.keep({ start, rows, ...byRows(n, start, rows) });
    this.L = kernels.numbers(start[n]);
    this.A = kernels.numbers(start[n]);
    this.work = kernels.numbers(n);
    const entry = (a, b) => this.entry(Math.max(place[a], place[b]), Math.min(place[a], place[b]));
    this.edgeEntry = Int32Array.from(tail, (a, e) => (a < 0 || head[e] < 0 ? -1 : entry(a, head[e])));
    this.diagonalEntry = Int32Array.from({ length: n }, (_, v) => start[place[v]]);
  }

  // integer tables in the kernels' memory
  keep(tables) {
    for (const [name, table] of Object.entries(tables)) {
      this[name] = this.kernels.integers(table.length);
      this[name].set(table);
    }
  }

  entry(i, j) {
    for (let p = this.start[j]; p < this.start[j + 1]; p++) if (this.rows[p] === i) return p;
    throw new Error("no such entry in the pattern");
  }

  // the matrix with entries off (E) on the edges and diagonal (n); false if it is not positive definite
  factor(off, diagonal) {
    const { A, edgeEntry, diagonalEntry } = this;
    A.fill(0);
    for (let e = 0; e < edgeEntry.length; e++) if (edgeEntry[e] >= 0) A[edgeEntry[e]] += off[e];
    for (let v = 0; v < this.n; v++) A[diagonalEntry[v]] = diagonal[v];
    return this.kernels.factor(this);
  }

  // X (n, R) with rows in the order of elimination, in place; in the kernels' memory
  forward(X, R) {
    this.kernels.forward(this, X, R);
  }
  backward(X, R) {
    this.kernels.backward(this, X, R);
  }
  solve(X, R) {
    this.forward(X, R);
    this.backward(X, R);
  }

  // the solutions for one or two right-hand sides [(n), ...], by unknown
  solved(columns) {
    const pair = (this.pair ??= this.kernels.numbers(2 * this.n)).fill(0);
    columns.forEach((b, c) => this.place.forEach((j, v) => (pair[2 * j + c] = b[v])));
    this.solve(pair, 2);
    return columns.map((_, c) => Float64Array.from(this.place, (j) => pair[2 * j + c]));
  }
}

// An order of elimination that always takes an unknown with the fewest neighbours, and the neighbours that each had
// left: for a few thousand unknowns exact degrees are cheap.
function minimumDegree(n, tail, head) {
  const near = Array.from({ length: n }, () => new Set()),
    left = Array.from({ length: n }, (_, v) => v),
    order = [],
    below = [];
  tail.forEach((a, e) => {
    if (a < 0 || head[e] < 0) return;
    near[a].add(head[e]);
    near[head[e]].add(a);
  });
  while (left.length) {
    let best = 0;
    for (let k = 1; k < left.length; k++) if (near[left[k]].size < near[left[best]].size) best = k;
    const [v] = left.splice(best, 1),
      neighbours = [...near[v]];
    order.push(v);
    below.push(neighbours);
    for (const u of neighbours) {
      for (const w of neighbours) near[u].add(w);
      near[u].delete(u);
      near[u].delete(v);
    }
  }
  return { order, below };
}

// for each row j of L its entries left of the diagonal: their columns, and their places in the column storage
function byRows(n, start, rows) {
  const rowStart = new Int32Array(n + 1);
  const visit = (see) => {
    for (let k = 0; k < n; k++) for (let p = start[k] + 1; p < start[k + 1]; p++) see(rows[p], k, p);
  };
  visit((j) => rowStart[j + 1]++);
  for (let j = 0; j < n; j++) rowStart[j + 1] += rowStart[j];
  const next = rowStart.slice(),
    rowColumn = new Int32Array(rowStart[n]),
    rowPlace = new Int32Array(rowStart[n]);
  visit((j, k, p) => {
    rowColumn[next[j]] = k;
    rowPlace[next[j]++] = p;
  });
  return { rowStart, rowColumn, rowPlace };
}

// A matrix of the same pattern that is not symmetric, factored as L U without looking for pivots, and solved for the
// columns of B [(n), ...], by unknown. lower[e]: the entry in row head[e], column tail[e]; upper[e]: row tail[e].
export function solveUnsymmetric(pattern, { lower, upper, diagonal }, B) {
  const { n, start, rows, rowStart, rowColumn, rowPlace, place, tail, head, edgeEntry } = pattern;
  const L = new Float64Array(start[n]),
    U = new Float64Array(start[n]);
  for (let e = 0; e < edgeEntry.length; e++) {
    if (edgeEntry[e] < 0) continue;
    const forwards = place[head[e]] > place[tail[e]];
    L[edgeEntry[e]] += forwards ? lower[e] : upper[e];
    U[edgeEntry[e]] += forwards ? upper[e] : lower[e];
  }
  for (let v = 0; v < n; v++) U[start[place[v]]] = diagonal[v];
  const column = new Float64Array(n),
    row = new Float64Array(n);
  for (let j = 0; j < n; j++) {
    for (let p = start[j]; p < start[j + 1]; p++) {
      column[rows[p]] = L[p];
      row[rows[p]] = U[p];
    }
    for (let q = rowStart[j]; q < rowStart[j + 1]; q++) {
      const from = rowPlace[q],
        stop = start[rowColumn[q] + 1],
        l = L[from],
        u = U[from];
      for (let p = from; p < stop; p++) {
        column[rows[p]] -= L[p] * u;
        row[rows[p]] -= U[p] * l;
      }
    }
    U[start[j]] = row[j];
    for (let p = start[j] + 1; p < start[j + 1]; p++) {
      L[p] = column[rows[p]] / row[j];
      U[p] = row[rows[p]];
    }
  }
  return B.map((b) => {
    const x = new Float64Array(n);
    for (let v = 0; v < n; v++) x[place[v]] = b[v];
    for (let j = 0; j < n; j++) for (let p = start[j] + 1; p < start[j + 1]; p++) x[rows[p]] -= L[p] * x[j];
    for (let j = n - 1; j >= 0; j--) {
      for (let p = start[j] + 1; p < start[j + 1]; p++) x[j] -= U[p] * x[rows[p]];
      x[j] /= U[start[j]];
    }
    return Float64Array.from(place, (j) => x[j]);
  });
}
