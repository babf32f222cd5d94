// Paint a Beltrami coefficient, and see the map that has it.
import { ask } from "./ask.js";
import { apart, fromPairs, interleaved, largest, meanDistance, sizes } from "./complex.js";
import { FINE, INITIAL } from "./given.js";
import { DiskMap } from "./map.js";
import { meshOf } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { grid, heat } from "./plots.js";
import { gap, short } from "./words.js";

const BUMP = { x: 0.3, y: 0.2, width: 0.3 };

// how a preset varies over the disk: a complex factor at (x, y)
const PRESETS = {
  constant: () => [1, 0],
  radial(x, y) {
    // of z |z|^(K - 1)
    const square = x * x + y * y;
    return square > 0 ? [(x * x - y * y) / square, (2 * x * y) / square] : [1, 0];
  },
  waves: (x, y) => [Math.sin(4 * x) * Math.cos(3 * y), 0],
  bump: (x, y) => [Math.exp(-((x - BUMP.x) ** 2 + (y - BUMP.y) ** 2) / BUMP.width ** 2), 0],
  blank: () => [0, 0],
};

// mu at a point: the preset times the number of the sliders, then what was painted over it, [x, y, radius, re, im] each
function muAt({ preset, size, direction, strokes }, x, y) {
  for (let k = strokes.length - 1; k >= 0; k--) {
    const [u, v, radius, re, im] = strokes[k];
    if ((x - u) ** 2 + (y - v) ** 2 <= radius * radius) return [re, im];
  }
  const [a, b] = PRESETS[preset](x, y),
    [c, d] = value({ size, direction });
  return [a * c - b * d, a * d + b * c];
}

// what the sliders say, and the brush paints
function value({ size, direction }) {
  const angle = (direction * Math.PI) / 180;
  return [size * Math.cos(angle), size * Math.sin(angle)];
}

// the worker's side
function work(bench, state) {
  const begin = performance.now(),
    mesh = bench.mesh(...FINE),
    map = (mesh.map ??= new DiskMap(mesh)),
    mu = mesh.atCentres((x, y) => muAt(state, x, y));
  if (!map.solve(mu)) throw new Error("|mu| must stay below 1: no map that keeps its orientation has such a coefficient");
  const w = map.normalised(),
    ms = performance.now() - begin,
    size = Float32Array.from(sizes(mu)),
    raised = map.raised.reduce((a, b) => a + b, 0);
  return { w, size, largest: largest(sizes(mu)), folds: mesh.flipped(w).length, raised, moved: meanDistance(w, mesh.z), ms };
}

// ---- what is to be seen ----

const ELLIPSES = 17,
  MOST_STROKES = 150;

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

const answer = ({ preset, size, direction, strokes }, host) => ask(host, "mu", { preset, size, direction, strokes });

function draw([field, image, colours], state, found) {
  const mesh = meshOf(...FINE);
  field.disk();
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
  image.disk();
  grid(image, mesh, found.w);
  heat(colours, mesh, found.size);
}

const K = (size) => (1 + size) / (1 - size);

export default {
  name: "mu",
  label: "Paint mu",
  initial: INITIAL.mu,
  controls: [
    {
      kind: "choice",
      name: "preset",
      label: "pattern of mu",
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
    { kind: "linear", name: "radius", rare: true, label: "radius of the brush", min: 0.03, max: 0.5, step: 0.01 },
  ],
  views: [
    {
      name: "field",
      label: "ellipses that small circles become; paint here",
      anywhere: true,
      points: (state) => [state.brush],
      drag: (state, index, point, by) => paint(state, point, by),
    },
    { name: "image", label: "grid under the exact map" },
    { name: "size", label: "|μ| on the disk" },
  ],
  answer,
  work,
  draw,
  words(state, found) {
    const said = [
      `The map of mu: largest |μ| ${short(found.largest)}, K ${short(K(found.largest))}, ${found.folds} folds`,
      `Mean displacement ${short(found.moved)}; exact map in ${found.ms.toFixed(1)} ms`,
    ];
    if (found.raised) said.push(`${found.raised} boundary steps raised`);
    return `${said.join(". ")}.`;
  },
  data(state, { w, size, ...numbers }) {
    return { map: interleaved(w), ...numbers };
  },
  compare: ({ w }, kernel) => `The kernel's exact map differs by ${gap(apart(w, fromPairs(kernel.map)))} at most.`,
  question: {
    text: "Move the largest |μ| half of the way that is left to 1. How many times longer than wide is the longest ellipse? ",
    truth: async (state, host) => K((1 + (await answer(state, host)).largest) / 2),
    why: "The ratio of the axes is K = (1 + |μ|) / (1 − |μ|): near 1, half the way that is left doubles it each time.",
  },
};
