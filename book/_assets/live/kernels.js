// The inner loops of the solver in WebAssembly: kernels.wasm, made from kernels.ts. They work on arrays of one memory, which
// are handed out here.

const PAGES = 1024; // 64 MB, enough for 128 landmarks on the finer mesh. It never grows: views into it would die.

// The functions of a .wasm file, and take(Type): n -> a new array in its memory.
export async function loaded(bytes, pages) {
  if (!globalThis.WebAssembly) throw new Error("the browser offers no WebAssembly, which this figure needs");
  const memory = new WebAssembly.Memory({ initial: pages });
  const abort = () => {
    throw new Error("a kernel stopped");
  };
  const { instance } = await WebAssembly.instantiate(bytes, { env: { memory, abort } });
  let top = 65536;
  const take = (Type) => (n) => {
    const array = new Type(memory.buffer, top, n);
    top += (n * Type.BYTES_PER_ELEMENT + 63) & ~63;
    return array;
  };
  return { wasm: instance.exports, take };
}

const at = (array) => array.byteOffset;

export async function wasmKernels(bytes) {
  const { wasm, take } = await loaded(bytes, PAGES);
  return {
    numbers: take(Float64Array),
    integers: take(Int32Array),

    // L L^T = A column by column; false if a pivot is not positive. A and L share the pattern (start, rows).
    factor: (c) =>
      wasm.factor(
        c.n,
        ...["start", "rows", "rowStart", "rowColumn", "rowPlace", "L", "A", "work"].map((k) => at(c[k])),
      ) === 1,

    // X (n, R) in the order of elimination becomes L^-1 X, or L^-T X
    forward: (c, X, R) => wasm.forward(c.n, at(c.start), at(c.rows), at(c.L), at(X), R),
    backward: (c, X, R) => wasm.backward(c.n, at(c.start), at(c.rows), at(c.L), at(X), R),

    // the lower triangle of G (R, R) becomes J^T J, J (count, R)
    gram: (count, J, R, G) => wasm.gram(count, at(J), R, at(G)),

    // One face's share of the landmarks' gradients, added to those of its corners. See gradients.js: rows are, for
    // the three corners each, adjoints g of f, adjoints l of U (both 2M) and gradients J (4M); shares has 18 numbers.
    face: (M, shares, rows, place) => wasm.face(M, at(shares), ...rows.map((row, k) => at(row) + 8 * place[k])),
  };
}
