// The inner loops of the U-Nets in WebAssembly: layers.wasm, made from layers.ts. Single precision, channels last.
import { loaded } from "./kernels.js";

const PAGES = 512; // 32 MB
const BLOCK = 6; // pixels that layers.wasm takes at once: widths have to be multiples
const at = (array) => array.byteOffset;

export async function wasmLayers(bytes) {
  const { wasm, take } = await loaded(bytes, PAGES);
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
