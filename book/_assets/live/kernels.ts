// The five inner loops of kernels.js in AssemblyScript, two numbers at a time. Arguments are byte offsets into the one
// memory, or counts; R and M are even. package.json says how kernels.wasm is made; a test compares the bytes.

// A and L share the column pattern (start, rows); 0 if a pivot is not positive
export function factor(
  n: i32, start: usize, rows: usize, rowStart: usize, rowColumn: usize, rowPlace: usize, L: usize, A: usize, work: usize,
): i32 {
  for (let j = 0; j < n; j++) {
    const first = load<i32>(start + (j << 2)), end = load<i32>(start + (j << 2), 4);
    for (let p = first; p < end; p++) {
      store<f64>(work + (load<i32>(rows + (p << 2)) << 3), load<f64>(A + (p << 3)));
    }
    const stop = load<i32>(rowStart + (j << 2), 4);
    for (let q = load<i32>(rowStart + (j << 2)); q < stop; q++) {
      const from = load<i32>(rowPlace + (q << 2)), l = load<f64>(L + (from << 3));
      const last = load<i32>(start + (load<i32>(rowColumn + (q << 2)) << 2), 4);
      for (let p = from; p < last; p++) {
        const at = work + (load<i32>(rows + (p << 2)) << 3);
        store<f64>(at, load<f64>(at) - load<f64>(L + (p << 3)) * l);
      }
    }
    const pivot = load<f64>(work + (j << 3));
    if (!(pivot > 0)) return 0;
    const root = Math.sqrt(pivot), inverse = 1 / root;
    store<f64>(L + (first << 3), root);
    for (let p = first + 1; p < end; p++) {
      store<f64>(L + (p << 3), load<f64>(work + (load<i32>(rows + (p << 2)) << 3)) * inverse);
    }
  }
  return 1;
}

const BYTES = 256; // of each row of X at a time: all rows of such a strip stay in the cache

// X (n, R) becomes L^-1 X
export function forward(n: i32, start: usize, rows: usize, L: usize, X: usize, R: i32): void {
  const width = <usize>R << 3;
  for (let strip: usize = 0; strip < width; strip += BYTES) {
    const wide = min(width - strip, BYTES), begin = X + strip;
    for (let j = 0; j < n; j++) {
      const first = load<i32>(start + (j << 2)), end = load<i32>(start + (j << 2), 4), from = begin + <usize>j * width;
      const inverse = f64x2.splat(1 / load<f64>(L + (first << 3)));
      for (let c: usize = 0; c < wide; c += 16) v128.store(from + c, f64x2.mul(v128.load(from + c), inverse));
      let p = first + 1;
      for (; p + 1 < end; p += 2) { // two rows at once spare half of the loads
        const l = f64x2.splat(load<f64>(L + (p << 3))), m = f64x2.splat(load<f64>(L + (p << 3), 8));
        const a = begin + <usize>load<i32>(rows + (p << 2)) * width;
        const b = begin + <usize>load<i32>(rows + (p << 2), 4) * width;
        for (let c: usize = 0; c < wide; c += 16) {
          const x = v128.load(from + c);
          v128.store(a + c, f64x2.sub(v128.load(a + c), f64x2.mul(l, x)));
          v128.store(b + c, f64x2.sub(v128.load(b + c), f64x2.mul(m, x)));
        }
      }
      if (p < end) {
        const l = f64x2.splat(load<f64>(L + (p << 3))), a = begin + <usize>load<i32>(rows + (p << 2)) * width;
        for (let c: usize = 0; c < wide; c += 16) {
          v128.store(a + c, f64x2.sub(v128.load(a + c), f64x2.mul(l, v128.load(from + c))));
        }
      }
    }
  }
}

// X (n, R) becomes L^-T X
export function backward(n: i32, start: usize, rows: usize, L: usize, X: usize, R: i32): void {
  const width = <usize>R << 3;
  for (let strip: usize = 0; strip < width; strip += BYTES) {
    const wide = min(width - strip, BYTES), begin = X + strip;
    for (let j = n - 1; j >= 0; j--) {
      const first = load<i32>(start + (j << 2)), end = load<i32>(start + (j << 2), 4), to = begin + <usize>j * width;
      const inverse = f64x2.splat(1 / load<f64>(L + (first << 3)));
      let p = first + 1;
      for (; p + 1 < end; p += 2) {
        const l = f64x2.splat(load<f64>(L + (p << 3))), m = f64x2.splat(load<f64>(L + (p << 3), 8));
        const a = begin + <usize>load<i32>(rows + (p << 2)) * width;
        const b = begin + <usize>load<i32>(rows + (p << 2), 4) * width;
        for (let c: usize = 0; c < wide; c += 16) {
          const sum = f64x2.add(f64x2.mul(l, v128.load(a + c)), f64x2.mul(m, v128.load(b + c)));
          v128.store(to + c, f64x2.sub(v128.load(to + c), sum));
        }
      }
      if (p < end) {
        const l = f64x2.splat(load<f64>(L + (p << 3))), a = begin + <usize>load<i32>(rows + (p << 2)) * width;
        for (let c: usize = 0; c < wide; c += 16) {
          v128.store(to + c, f64x2.sub(v128.load(to + c), f64x2.mul(l, v128.load(a + c))));
        }
      }
      for (let c: usize = 0; c < wide; c += 16) v128.store(to + c, f64x2.mul(v128.load(to + c), inverse));
    }
  }
}

const ROWS = 32; // of J at a time, which then stay in the nearest cache

// the lower blocks (4 x 4) of G (R, R) become J^T J, J (count, R); R is a multiple of 4
export function gram(count: i32, J: usize, R: i32, G: usize): void {
  const width = <usize>R << 3;
  memory.fill(G, 0, <usize>R * width);
  for (let first = 0; first < count; first += ROWS) {
    const rows = min(ROWS, count - first), begin = J + <usize>first * width;
    for (let c = 0; c < R; c += 4) {
      for (let d = 0; d <= c; d += 4) {
        block(rows, begin + <usize>(c << 3), begin + <usize>(d << 3), width, G + <usize>c * width + <usize>(d << 3));
      }
    }
  }
}

// four columns of J by four others, added to a block of G
// @ts-ignore: a decorator
@inline function block(rows: i32, row: usize, column: usize, width: usize, at: usize): void {
  let a0 = f64x2.splat(0), a1 = a0, b0 = a0, b1 = a0, c0 = a0, c1 = a0, d0 = a0, d1 = a0;
  for (let i = 0; i < rows; i++) {
    const x = v128.load(column), y = v128.load(column, 16);
    const p = v128.load64_splat(row), q = v128.load64_splat(row, 8);
    const r = v128.load64_splat(row, 16), s = v128.load64_splat(row, 24);
    a0 = f64x2.add(a0, f64x2.mul(p, x));
    a1 = f64x2.add(a1, f64x2.mul(p, y));
    b0 = f64x2.add(b0, f64x2.mul(q, x));
    b1 = f64x2.add(b1, f64x2.mul(q, y));
    c0 = f64x2.add(c0, f64x2.mul(r, x));
    c1 = f64x2.add(c1, f64x2.mul(r, y));
    d0 = f64x2.add(d0, f64x2.mul(s, x));
    d1 = f64x2.add(d1, f64x2.mul(s, y));
    row += width;
    column += width;
  }
  add(at, a0);
  add(at + 16, a1);
  add(at + width, b0);
  add(at + width + 16, b1);
  add(at + 2 * width, c0);
  add(at + 2 * width + 16, c1);
  add(at + 3 * width, d0);
  add(at + 3 * width + 16, d1);
}

// @ts-ignore: a decorator
@inline function weighted(shares: usize, at: usize, x: usize, y: usize, z: usize): v128 {
  const a = f64x2.mul(f64x2.splat(load<f64>(shares + at)), v128.load(x));
  const b = f64x2.mul(f64x2.splat(load<f64>(shares + at + 16)), v128.load(y));
  const c = f64x2.mul(f64x2.splat(load<f64>(shares + at + 32)), v128.load(z));
  return f64x2.add(f64x2.add(a, b), c);
}

// @ts-ignore: a decorator
@inline function add(to: usize, x: v128): void {
  v128.store(to, f64x2.add(v128.load(to), x));
}

// one face's share of J: rows g and l (2M) of its corners, rows of J (4M), 18 shares
export function face(
  M: i32, shares: usize, g0: usize, g1: usize, g2: usize, l0: usize, l1: usize, l2: usize, j0: usize, j1: usize, j2: usize,
): void {
  const width = <usize>M << 3;
  for (let half: usize = 0; half < 2; half++) {
    const s = shares + (half << 3), shift = half * 2 * width;
    for (let c: usize = 0; c < width; c += 16) {
      const d = c + width;
      const re = f64x2.add(
        f64x2.sub(weighted(s, 0, g0 + c, g1 + c, g2 + c), weighted(s, 48, g0 + d, g1 + d, g2 + d)),
        weighted(s, 96, l0 + c, l1 + c, l2 + c),
      );
      const im = f64x2.add(
        f64x2.add(weighted(s, 48, g0 + c, g1 + c, g2 + c), weighted(s, 0, g0 + d, g1 + d, g2 + d)),
        weighted(s, 96, l0 + d, l1 + d, l2 + d),
      );
      add(j0 + shift + c, re);
      add(j1 + shift + c, re);
      add(j2 + shift + c, re);
      add(j0 + shift + d, im);
      add(j1 + shift + d, im);
      add(j2 + shift + d, im);
    }
  }
}
