// The inner loops of the U-Nets in single precision, channels last: in WebAssembly (layers.wasm, from layers.ts), or here.

const PAGES = 512; // 32 MB
const BLOCK = 6; // pixels that layers.wasm takes at once: widths have to be multiples

export async function wasmLayers(bytes) {
  const memory = new WebAssembly.Memory({ initial: PAGES });
  const stop = () => {
    throw new Error("a layer stopped");
  };
  const { instance } = await WebAssembly.instantiate(bytes, { env: { memory, abort: stop } });
  const wasm = instance.exports,
    at = (array) => array.byteOffset;
  let top = 65536;
  return {
    name: "WebAssembly",
    numbers(n) {
      const array = new Float32Array(memory.buffer, top, n);
      top += (4 * n + 63) & ~63;
      return array;
    },
    silu: (from, to) => wasm.silu(at(from), at(to), to.length),
    convolve(x, row, layer, step, out, [height, width], add) {
      if (width % BLOCK)
        throw new Error(`the network's grid has ${width} spokes on a level: layers.wasm takes multiples of ${BLOCK}`);
      const { weight, bias, kernel, inputs, outputs } = layer;
      wasm.convolve(
        at(x),
        4 * row,
        inputs,
        kernel,
        step,
        at(weight),
        at(bias),
        at(out),
        height,
        width,
        outputs,
        add ? 1 : 0,
      );
    },
  };
}

export const plainLayers = {
  name: "JavaScript",
  numbers: (n) => new Float32Array(n),

  // to = from / (1 + exp(-from))
  silu(from, to) {
    for (let i = 0; i < to.length; i++) to[i] = from[i] / (1 + Math.exp(-from[i]));
  },

  // out (height, width, outputs) = bias + convolution of x, rows of `row` numbers, with steps of `step`; add: onto out.
  // Weights lie as [outputs / 8][kernel][kernel][inputs][8].
  convolve(x, row, { weight, bias, kernel, inputs, outputs }, step, out, [height, width], add) {
    const run = kernel * inputs,
      sum = new Float32Array(8);
    for (let o = 0; o < outputs; o += 8) {
      const first = o * kernel * kernel * inputs;
      for (let i = 0; i < height; i++) {
        for (let j = 0; j < width; j++) {
          sum.set(bias.subarray(o, o + 8));
          for (let y = 0, w = first; y < kernel; y++) {
            const from = (i * step + y) * row + j * step * inputs;
            for (let t = from; t < from + run; t++, w += 8) {
              const value = x[t];
              for (let c = 0; c < 8; c++) sum[c] += value * weight[w + c];
            }
          }
          const to = (i * width + j) * outputs + o;
          for (let c = 0; c < 8; c++) out[to + c] = sum[c] + (add ? out[to + c] : 0);
        }
      }
    }
  },
};
