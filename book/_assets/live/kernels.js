// The inner loops in WebAssembly: the solver's, kernels.wasm, made from kernels.ts, and the U-Nets', layers.wasm, from layers.ts.
// Either works on arrays of one memory, which are handed out here. It never grows: views into it would die.

const BLOCK = 6; // pixels that layers.wasm takes at once: widths have to be multiples

// The functions of a .wasm file, and take(Type): n -> a new array in its memory.
async function loaded(bytes, pages) {
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
  const { wasm, take } = await loaded(bytes, 1024); // 64 MB, enough for 128 landmarks on the finer mesh
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

// single precision, channels last
export async function wasmLayers(bytes) {
  const { wasm, take } = await loaded(bytes, 512); // 32 MB
  return {
    numbers: take(Float32Array),

    // to = from / (1 + exp(-from))
    silu: (from, to) => wasm.silu(at(from), at(to), to.length),

    // out (height, width, outputs) = bias + convolution of x, rows of `row` numbers, with steps of `step`; add: onto out.
    // Weights lie as [outputs / 8][kernel][kernel][inputs][8].
    convolve(x, row, { weight, bias, kernel, inputs, outputs }, step, out, [height, width], add) {
      if (width % BLOCK)
        throw new Error(`the network's grid has ${width} spokes on a level: layers.wasm takes multiples of ${BLOCK}`);
      const places = [at(weight), at(bias), at(out)];
      wasm.convolve(at(x), 4 * row, inputs, kernel, step, ...places, height, width, outputs, add ? 1 : 0);
    },
  };
}
