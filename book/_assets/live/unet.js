// The polar U-Nets (nets/layers.py: PolarUNet, ConditionedUNet) on the grid of rings and spokes, channels last.
import { readArrays } from "./files.js";
import { wasmLayers } from "./kernels.js";

const FIRST_SCALE = 0.1; // of a conditioned U-Net's outputs, before the conditions change it

// Sizes are read from the tensors, name -> {shape, data}, which come in blocks, made up with zeros (livefiles.py).
export class UNet {
  constructor(layers, tensors, rings, spokes) {
    Object.assign(this, { layers, tensors, rings, spokes });
    const count = (name) => Object.keys(tensors).filter((key) => key.startsWith(`${name}.`) && key.endsWith("weight"));
    const levels = count("coarser").length,
      blocks = count("bottom").length / 2;
    const list = (n, make) => Array.from({ length: n }, (_, i) => make(i));
    const block = (name) => ({ first: this.layer(`${name}.first`), second: this.layer(`${name}.second`) });
    this.stem = this.layer("stem");
    this.head = this.layer("head");
    this.down = list(levels, (i) => block(`down.${i}`));
    this.up = list(levels, (i) => block(`up.${i}`));
    this.coarser = list(levels, (i) => this.layer(`coarser.${i}`));
    this.finer = list(levels, (i) => this.layer(`finer.${i}`));
    this.bottom = list(blocks, (i) => block(`bottom.${i}`));
    this.channels = [this.stem.outputs, ...this.coarser.map(({ outputs }) => outputs)];
    this.film = tensors["film.0.weight"] && [0, 2].map((i) => [tensors[`film.${i}.weight`], tensors[`film.${i}.bias`]]);
    this.makeRoom();
  }

  // its weights lie as [outputs / 8][kernel][kernel][inputs][8]
  layer(name) {
    const [weight, bias] = ["weight", "bias"].map((kind) => {
      const { data } = this.tensors[`${name}.${kind}`],
        numbers = this.layers.numbers(data.length);
      numbers.set(data);
      return numbers;
    });
    const [blocks, kernel, , inputs, width] = this.tensors[`${name}.weight`].shape;
    return { weight, bias, kernel, inputs, outputs: blocks * width };
  }

  size(level) {
    return [this.rings >> level, this.spokes >> level];
  }

  makeRoom() {
    const { channels, layers } = this,
      numbers = (n) => layers.numbers(n);
    const area = (level) => this.size(level)[0] * this.size(level)[1];
    const wide = (level) => (this.size(level)[0] + 2) * (this.size(level)[1] + 2);
    [this.skips, this.fine, this.spare] = [0, 1, 2].map(() => channels.map((c, level) => numbers(area(level) * c)));
    this.pad = numbers(Math.max(wide(0) * this.stem.inputs, ...channels.map((c, level) => wide(level) * c)));
    this.input = numbers(area(0) * this.stem.inputs);
    this.output = numbers(area(0) * this.head.outputs);
  }

  // x with one more ring and spoke on every side: beyond the centre the disk goes on at the opposite spoke, beyond the
  // circle the last ring is repeated
  padded(x, [height, width], channels) {
    const { pad } = this,
      row = (width + 2) * channels,
      half = (width / 2) * channels,
      full = width * channels;
    const put = (ring, from, opposite) => {
      const to = ring * row + channels,
        cut = opposite ? half : 0;
      pad.set(x.subarray(from + cut, from + full), to);
      pad.set(x.subarray(from, from + cut), to + full - cut);
      pad.copyWithin(ring * row, ring * row + full, ring * row + full + channels);
      pad.copyWithin(ring * row + full + channels, to, to + channels);
    };
    put(0, 0, true);
    for (let ring = 0; ring < height; ring++) put(ring + 1, ring * full, false);
    put(height + 1, (height - 1) * full, false);
    return pad;
  }

  convolve(layer, x, out, size, add = false) {
    this.layers.convolve(this.padded(x, size, layer.inputs), (size[1] + 2) * layer.inputs, layer, 1, out, size, add);
  }

  // x + conv(act(conv(act(x)))), in place
  block({ first, second }, x, spare, size) {
    this.layers.silu(x, spare);
    this.convolve(first, spare, spare, size);
    this.layers.silu(spare, spare);
    this.convolve(second, spare, x, size, true);
  }

  // scales and shifts of all channels, level by level, from the conditions: FiLM
  films(conditions) {
    const [[weight, bias], [weight2, bias2]] = this.film;
    const linear = (w, b, x) =>
      b.data.map((sum, i) => x.reduce((all, value, j) => all + w.data[i * x.length + j] * value, sum));
    const hidden = Array.from(linear(weight, bias, conditions), (x) => x / (1 + Math.exp(-x)));
    return linear(weight2, bias2, hidden);
  }

  // this.input (rings, spokes, inputs made up) -> this.output (rings, spokes, outputs made up)
  run(conditions = null) {
    const { channels, layers, skips, fine, spare } = this,
      last = channels.length - 1,
      films = conditions && this.films(conditions);
    let at = 0;
    const modulate = (x, count) => {
      if (!films) return;
      for (let i = 0; i < x.length; i++) x[i] = x[i] * (1 + films[at + (i % count)]) + films[at + count + (i % count)];
      at += 2 * count;
    };
    this.convolve(this.stem, this.input, skips[0], this.size(0));
    modulate(skips[0], channels[0]);
    for (let level = 0; level < last; level++) {
      const size = this.size(level);
      this.block(this.down[level], skips[level], spare[level], size);
      const next = this.size(level + 1);
      layers.convolve(skips[level], size[1] * channels[level], this.coarser[level], 2, skips[level + 1], next, false);
      modulate(skips[level + 1], channels[level + 1]);
    }
    for (const block of this.bottom) this.block(block, skips[last], spare[last], this.size(last));
    let x = skips[last];
    for (let level = last - 1; level >= 0; level--) {
      const coarse = this.size(level + 1);
      layers.convolve(x, coarse[1] * channels[level + 1], this.finer[level], 1, spare[level], coarse, false);
      this.doubled(spare[level], skips[level], fine[level], coarse, channels[level]);
      x = fine[level];
      this.block(this.up[level], x, spare[level], this.size(level));
    }
    layers.silu(x, spare[0]);
    this.convolve(this.head, spare[0], this.output, this.size(0));
    if (films)
      this.output.forEach((value, i) => {
        const channel = i % this.head.outputs;
        if (at + channel < films.length) this.output[i] = value * FIRST_SCALE * Math.exp(films[at + channel]);
      });
    return this.output;
  }

  // out = skip + each pixel of x four times
  doubled(x, skip, out, [height, width], channels) {
    for (let i = 0; i < 2 * height; i++) {
      for (let j = 0; j < 2 * width; j++) {
        const to = (i * 2 * width + j) * channels,
          from = ((i >> 1) * width + (j >> 1)) * channels;
        for (let c = 0; c < channels; c++) out[to + c] = skip[to + c] + x[from + c];
      }
    }
  }
}

// the tensors of one part of a network, their names without its own
export const partOf = (tensors, part) =>
  Object.fromEntries(
    Object.entries(tensors)
      .filter(([name]) => name.startsWith(`${part}.`))
      .map(([name, t]) => [name.slice(part.length + 1), t]),
  );

// A network of a file that the worker was given, made once: its class, and the file's name on the bench.
export async function networkOf({ files, mesh, networks }, Network, name) {
  if (!networks[name]) {
    const file = readArrays(files[name]),
      { rings, spokes, power } = file.config;
    networks[name] = new Network(mesh(rings, spokes, power), await wasmLayers(files.layers), file);
  }
  return networks[name];
}
