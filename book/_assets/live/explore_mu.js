// Paint a Beltrami coefficient, and see the map that has it.
import { ask, give } from "./ask.js";
import { muAt, value } from "./coefficients.js";
import { PolarMesh } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { grid, heat } from "./plots.js";

const ELLIPSES = 17,
  MOST_STROKES = 150,
  same = (point) => point;
let mesh = null; // for the pictures

const ellipse = (x, y, [a, b], radius) => {
  const size = Math.min(Math.hypot(a, b), 0.999),
    turn = Math.atan2(b, a) / 2,
    c = Math.cos(turn),
    s = Math.sin(turn);
  const scale = radius / Math.sqrt(1 - size * size),
    long = scale * (1 + size),
    wide = scale * (1 - size);
  return Array.from({ length: 25 }, (_, k) => {
    const u = Math.min(long, 2.2 * radius) * Math.cos((Math.PI * k) / 12),
      v = wide * Math.sin((Math.PI * k) / 12);
    return [x + c * u - s * v, y + s * u + c * v];
  });
};

// the brush: a pointer paints as it goes; keys move it, and Enter or the space bar paints
function paint(state, point, by) {
  const brush = point.map((c) => Number(c.toFixed(4)));
  if (by === "keys") return { brush };
  const stroke = [...brush, state.radius, ...value(state).map((c) => Number(c.toFixed(4)))];
  return { brush, strokes: [...state.strokes, stroke].slice(-MOST_STROKES) };
}

let given = null; // a promise of DBS-Net's file, which is asked for when DBS-Net is

async function answer(state, host) {
  const { preset, size, direction, strokes, frequencies, dbsnet } = state;
  if (dbsnet) {
    given ??= give(host, { layers: "layers.wasm", dbsnet: "dbsnet.bin" });
    await given.catch((error) => {
      given = null;
      throw error;
    });
  }
  return ask(host, "mu", { preset, size, direction, strokes, frequencies, dbsnet });
}

function draw([field, image, colours], state, found) {
  mesh ??= new PolarMesh(32, 96);
  field.clear();
  field.circle();
  const lines = [],
    step = 2 / ELLIPSES;
  for (let i = 0; i < ELLIPSES; i++) {
    for (let j = 0; j < ELLIPSES; j++) {
      const x = (i + 0.5) * step - 1,
        y = (j + 0.5) * step - 1;
      if (x * x + y * y < 0.92) lines.push(ellipse(x, y, muAt(state, x, y), 0.35 * step));
    }
  }
  field.lines(lines, COLOURS.grid, 1);
  field.ring(state.brush, state.radius, COLOURS.target);
  image.clear();
  image.circle();
  if (found.compressed) grid(image, mesh, found.compressed.w, same, same, COLOURS.target, [3, 2]);
  grid(image, mesh, found.w, same, same);
  heat(colours, mesh, found.size, same);
}

const short = (x) => (x !== 0 && Math.abs(x) < 0.001 ? x.toExponential(2) : String(Number(x.toPrecision(4))));
const K = (size) => (1 + size) / (1 - size);

export default {
  name: "mu",
  label: "Paint mu",
  initial: {
    preset: "waves",
    size: 0.5,
    direction: 60,
    frequencies: 4,
    radius: 0.15,
    dbsnet: false,
    brush: [0.5, 0.5],
    strokes: [],
  },
  controls: [
    {
      kind: "choice",
      name: "preset",
      label: "mu as it is",
      also: { strokes: [] },
      options: [
        ["waves", "waves"],
        ["constant", "the same everywhere"],
        ["radial", "radial"],
        ["bump", "a bump"],
        ["blank", "nothing: paint it"],
      ],
    },
    { kind: "linear", name: "size", label: "|μ| (size of mu)", min: 0, max: 0.95, step: 0.01 },
    { kind: "linear", name: "direction", label: "arg μ (argument of mu) in degrees", min: -180, max: 180, step: 5 },
    { kind: "linear", name: "radius", label: "radius of the brush", min: 0.03, max: 0.5, step: 0.01 },
    {
      kind: "linear",
      name: "frequencies",
      label: "k, highest frequency that the compression keeps",
      min: 0,
      max: 20,
      step: 1,
    },
    { kind: "switch", name: "dbsnet", label: "DBS-Net beside the exact map (loads 3 MB)" },
  ],
  views: [
    {
      name: "field",
      label: "ellipses that small circles become; paint here",
      anywhere: true,
      points: (state) => [state.brush],
      drag: (state, index, point, by) => paint(state, point, by),
    },
    { name: "image", label: "grid under the exact map; red: under that of the compressed mu" },
    { name: "size", label: "|μ| on the disk" },
  ],
  answer,
  draw,
  words(state, found) {
    const { compressed, raised } = found,
      k = state.frequencies,
      said = [
        `The map of mu: largest |μ| ${short(found.largest)}, K ${short(K(found.largest))}, ${found.folds} folds`,
        `Mean displacement ${short(found.moved)}; exact map in ${found.ms.toFixed(1)} ms`,
      ];
    if (compressed) {
      said.push(
        `Compressed to k = ${k}, ${(2 * k + 1) ** 2} complex numbers: largest |μ| ${short(compressed.largest)}`,
      );
      said.push(`Its map has ${compressed.folds} folds; the map moves by up to ${short(compressed.off)}`);
    } else said.push(`Compressed to k = ${k} |μ| overshoots 1: no map has such a coefficient`);
    if (found.network) {
      const { mesh: size, off, folds, ms, exact } = found.network;
      said.push(
        `DBS-Net on ${size.join(" x ")} differs from the exact map there by up to ${short(off)}, with ${folds} folds`,
      );
      said.push(`It takes ${ms.toFixed(0)} ms, the exact map ${exact.toFixed(0)} ms`);
    }
    if (raised) said.push(`${raised} boundary steps raised`);
    return `${said.join(". ")}. In ${found.kernels}.`;
  },
  data(state, { w, size, compressed, ...numbers }) {
    const map = new Float64Array(2 * w.x.length).map((_, i) => (i % 2 ? w.y : w.x)[i >> 1]);
    return { map, ...numbers, off: compressed?.off ?? null, compressedLargest: compressed?.largest ?? null };
  },
  compare: (found, kernel) => {
    const gap = Math.max(...found.w.x.map((x, v) => Math.hypot(x - kernel.map[v][0], found.w.y[v] - kernel.map[v][1])));
    return `The kernel's exact map differs by ${gap.toExponential(1)} at most.`;
  },
  question: {
    text: "Bring the largest |μ| half the way to 1. How many times longer than wide is the longest ellipse then? ",
    truth: async (state, host) => K((1 + (await answer(state, host)).largest) / 2),
    why: "The ratio of the axes is K = (1 + |μ|) / (1 − |μ|): near 1, half the way that is left doubles it each time.",
  },
};
