// The Linear Beltrami Solver: pin points of the disk, take the coefficients right or as printed, and count the folds.
import { ask } from "./ask.js";
import { pinsOf, SIZE } from "./lbs.js";
import { PolarMesh } from "./mesh.js";
import { COLOURS } from "./picture.js";
import { grid, heat } from "./plots.js";

const same = (point) => point,
  ERRATA = {
    e2: "E2: areas in the numerator of the gradients",
    e3: "E3: rows without the weight by area",
    e4: "E4: rows at the circle, too; held are 0 and 1",
    e5: "E5: the third vertex in place of the neighbour",
  };
let mesh = null; // for the pictures

const meshOf = () => (mesh ??= new PolarMesh(...SIZE));
const short = (x) => (x !== 0 && (Math.abs(x) < 0.001 || x >= 1e4) ? x.toExponential(2) : String(Number(x.toPrecision(4))));
const answer = (state, host) => ask(host, "lbs", state);

// every pin asks for a share of what it asks
const eased = (state, share) => ({
  ...state,
  moves: Object.fromEntries(
    pinsOf(meshOf(), state).map(({ start, target }, k) => [k, start.map((c, i) => c + share * (target[i] - c))]),
  ),
});

function draw([image, colours], state, { w, size, folds, pins }) {
  const { faces } = meshOf();
  image.clear();
  image.circle();
  for (const t of folds) image.face([0, 1, 2].map((k) => [w.x[faces[3 * t + k]], w.y[faces[3 * t + k]]]), COLOURS.fold);
  grid(image, mesh, w, same, same);
  image.lines(pins.map(({ start, target }) => [start, target]), COLOURS.ink, 1.2, [3, 2]);
  for (const { start, target } of pins) {
    image.square(start, COLOURS.ink, 3, 1.2);
    image.dot(target, COLOURS.registered, 5);
  }
  image.mark();
  heat(colours, mesh, size, same);
}

export default {
  name: "lbs",
  label: "Pins in the Linear Beltrami Solver",
  initial: {
    asked: "twist",
    strength: 0,
    count: 4,
    pull: 0.2,
    e2: false,
    e3: false,
    e4: false,
    e5: false,
    moves: {},
  },
  controls: [
    {
      kind: "choice",
      name: "asked",
      label: "μ asked for",
      options: [
        ["twist", "that of a twist, z exp(i s (1 − |z|²))"],
        ["stretch", "that of a stretch, z |z|ˢ"],
      ],
    },
    { kind: "linear", name: "strength", label: "s, strength of μ (0: harmonic)", min: 0, max: 2, step: 0.05 },
    { kind: "linear", name: "count", label: "number of pins inside", min: 0, max: 8, step: 1 },
    { kind: "linear", name: "pull", label: "how far pins are pulled aside", min: 0, max: 0.4, step: 0.01, also: { moves: {} } },
    ...Object.entries(ERRATA).map(([name, label]) => ({ kind: "switch", name, label })),
  ],
  views: [
    {
      name: "image",
      label: "deformed grid; pins to drag (orange), folded triangles (magenta)",
      points: (state) => pinsOf(meshOf(), state).map(({ target }) => target),
      drag: (state, index, point) => ({ moves: { ...state.moves, [index]: point.map((c) => Number(c.toFixed(4))) } }),
    },
    { name: "size", label: "|μ| of the map, on the disk it comes from; folds in magenta" },
  ],
  answer,
  draw,
  words(state, { folds, faces, pins, negative, edges, off, asked, largest, ms }) {
    const printed = Object.keys(ERRATA).filter((name) => state[name]),
      how = printed.length ? `As printed in ${printed.map((name) => name.toUpperCase()).join(", ")}` : "Right coefficients",
      far = Math.max(0, ...pins.map(({ start, target }) => Math.hypot(target[0] - start[0], target[1] - start[1])));
    const said = [
      `${how}, ${pins.length} pins moved by up to ${short(far)}: ${folds.length} of ${faces} triangles folded`,
      `Asked for is a ${state.asked} with |μ| up to ${short(asked)}; the map has |μ| up to ${short(largest)}`,
      `From the ${state.asked} itself it is up to ${short(off)} away`,
      `${negative} of ${edges} edges have a negative weight`,
    ];
    return `${said.join(". ")}. Exact on this mesh of ${SIZE.slice(0, 2).join(" x ")}, in ${ms.toFixed(0)} ms.`;
  },
  data(state, { w, size, folds, pins, mu, ...numbers }) {
    const map = new Float64Array(2 * w.x.length).map((_, i) => (i % 2 ? w.y : w.x)[i >> 1]);
    return { map, folds: folds.length, targets: pins.map(({ target }) => target), ...numbers };
  },
  compare(found, kernel) {
    const gap = Math.max(...found.w.x.map((x, v) => Math.hypot(x - kernel.map[v][0], found.w.y[v] - kernel.map[v][1])));
    return `The kernel's map has ${kernel.folds} folds; the largest difference of the two maps is ${gap.toExponential(1)}.`;
  },
  question: {
    text: "If each pin asked for half of what it asks now, how many triangles would be folded? ",
    truth: async (state, host) => (await answer(eased(state, 0.5), host)).folds.length,
    why: "A pin is a point force, and its spike folds whatever is finer than the pull; no weight keeps it back.",
  },
};
